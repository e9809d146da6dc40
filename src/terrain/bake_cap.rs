//! The posts of a cap, from the geographic ones.
//!
//! A cap post has the height of the geographic level-0 surface at its place: bilinear in latitude and longitude between
//! the four finished posts around it, filled ones too. It is void if one of them is, and water if the one with the most
//! weight is. So the two partitions are one surface, each sampled in its own posts. Columns of the geographic grid are closer
//! together here than posts of a cap, so a cap passes some of its posts by, a summit perhaps: like a coarse level's, its
//! finest posts are raised where a summit needs it ([`crate::terrain::bake_raise`]), and how far it is from the geographic
//! posts is measured and stated ([`crate::terrain::bake_measure`]).
//!
//! The tiles written so far are read back. A cap tile asks for each of its posts' neighbours, sorts them by the tile they
//! are in and reads each tile once: at the pole, where a row of cap posts crosses all longitudes, as cheaply as elsewhere.
//! Every geographic tile is unpacked several times.
//!
//! Memory: the index of the tiles read, a few blocks, and the tiles of coarse levels that are open along a row of cap
//! tiles: at most 24 MB for 3", 72 MB for 1".

use crate::terrain::bake_levels::{Block, Levels, Post, go_on};
use crate::terrain::bake_threads::{TURN, share};
use crate::terrain::codec::{SurfaceKind, Tile};
use crate::terrain::grid::{Grid, TILE_AREA, TILE_SIDE, TileKey};
use crate::terrain::height::split;
use crate::terrain::pack::{TileError, TileReader, Tiles};
use crate::terrain::partition::{CAP_LATITUDE_MIN_DEG, Partition};
use crate::terrain::store::Scale;
use std::collections::BTreeSet;
use std::io;

/// Every so many posts of a geographic tile is asked which cap tile it is in; its neighbours up to the next are less than
/// [`REACH`] cap posts away, though cap columns lie closer together by 1 / cos 26 deg at the edge.
const STRIDE: i32 = 32;
const REACH: i32 = 48;

/// Adds a cap to a pack whose geographic posts are all there; whatever they cover from 64 degrees on. `proceed` is called
/// with the tiles done and their number, and says whether to go on.
///
/// # Errors
/// If writing, or reading back, fails, or `proceed` said no.
pub(crate) fn add(
    levels: &mut Levels,
    (grid, scale): (Grid, Scale),
    cap: Partition,
    jobs: usize,
    proceed: &mut dyn FnMut(usize, usize) -> bool,
) -> io::Result<()> {
    let source = Source {
        grid,
        scale,
        cap,
        tiles: levels.turn_to(cap, proceed)?,
    };
    let keys = source.keys();
    let mut hands: Vec<Hand> = std::iter::repeat_with(Hand::new)
        .take(jobs.max(1))
        .collect();
    for (number, keys_now) in keys.chunks(TURN).enumerate() {
        go_on(proceed(number * TURN, keys.len()))?;
        for block in source.blocks(keys_now, &mut hands)? {
            levels.scatter(&block);
        }
        if let Some(next) = keys.get((number + 1) * TURN) {
            levels.flush(next.south(), None)?;
            levels.flush(next.south() + TILE_SIDE, Some(next.west()))?;
        }
    }
    proceed(keys.len(), keys.len());
    Ok(())
}

/// The geographic posts that a cap is made from.
struct Source {
    grid: Grid,
    scale: Scale,
    cap: Partition,
    tiles: Tiles,
}

/// What a thread works with.
struct Hand {
    reader: TileReader,
    tile: Tile,
    shares: Vec<Share>,
    /// Posts of a tile, row by row from the south-west.
    made: Vec<Option<Made>>,
}

impl Hand {
    fn new() -> Self {
        Self {
            reader: TileReader::new(),
            tile: Tile::filled(0, SurfaceKind::Void),
            shares: Vec::with_capacity(4 * TILE_AREA),
            made: Vec::with_capacity(TILE_AREA),
        }
    }
}

/// The part that a geographic post has in a cap post.
#[derive(Clone, Copy)]
struct Share {
    /// The tile it is in, and where in it.
    key: TileKey,
    at: usize,
    weight: f64,
    /// The cap post's place among those made.
    post: usize,
}

/// A cap post, share by share.
#[derive(Clone, Copy)]
struct Made {
    height_m: f64,
    /// What the tiles it rests on state.
    error_m: f32,
    /// Whether a tile has a part in it.
    covered: bool,
    void: bool,
    /// The greatest weight so far, and its kind.
    most: (f64, SurfaceKind),
}

impl Source {
    /// The tiles of the cap that may hold a post that a geographic tile covers, in the order of the index.
    fn keys(&self) -> Vec<TileKey> {
        let mut found = BTreeSet::new();
        for entry in self.tiles.entries() {
            for dj in (0..=TILE_SIDE).step_by(offset(STRIDE)) {
                for di in (0..=TILE_SIDE).step_by(offset(STRIDE)) {
                    let (i, j) = (entry.key.west() + di, entry.key.south() + dj);
                    let limit = self.grid.row_max();
                    let (v, u) = self.cap.from_geodetic(
                        self.grid.longitude_deg(0, i),
                        self.grid.latitude_deg(0, j.clamp(-limit, limit)),
                    );
                    let (i, j) = (split(self.grid, v).0, split(self.grid, u).0);
                    for (di, dj) in [
                        (-REACH, -REACH),
                        (-REACH, REACH),
                        (REACH, -REACH),
                        (REACH, REACH),
                    ] {
                        found.insert(TileKey::of_post(self.cap, 0, i + di, j + dj));
                    }
                }
            }
        }
        found.into_iter().collect()
    }

    /// The blocks of some tiles, in their order; none for a tile that nothing covers.
    fn blocks(&self, keys: &[TileKey], hands: &mut [Hand]) -> io::Result<Vec<Block>> {
        let blocks = share(hands, keys, |hand, key| self.block(*key, hand));
        blocks.into_iter().filter_map(Result::transpose).collect()
    }

    /// The posts of a level-0 tile of the cap; `None` if no geographic tile has a part in them.
    fn block(&self, key: TileKey, hand: &mut Hand) -> io::Result<Option<Block>> {
        self.share_out((key.west(), key.south()), &mut hand.shares);
        // By tile; and in one order whoever asks, so that sums come out the same to the last bit.
        hand.shares.sort_unstable_by_key(|s| (s.key, s.post, s.at));
        hand.made.clear();
        hand.made.resize(TILE_AREA, None);
        for shares in hand.shares.chunk_by(|a, b| a.key == b.key) {
            let error_m = self.read(shares[0].key, &mut hand.reader, &mut hand.tile)?;
            self.take(shares, error_m.map(|e| (e, &hand.tile)), &mut hand.made);
        }
        if !hand.made.iter().flatten().any(|m| m.covered) {
            return Ok(None);
        }
        let covered = |m: &Option<Made>| Some(self.post(m.as_ref().filter(|m| m.covered)?));
        Ok(Some(Block {
            south: key.south(),
            west: key.west(),
            columns: offset(TILE_SIDE),
            posts: hand.made.iter().map(covered).collect(),
        }))
    }

    /// Reads a geographic tile; the error it states, or `None` if it does not exist.
    fn read(
        &self,
        key: TileKey,
        reader: &mut TileReader,
        tile: &mut Tile,
    ) -> io::Result<Option<f32>> {
        match self.tiles.read(key, reader, tile) {
            Ok(()) => Ok(self.tiles.entry(key).map(|e| e.max_error_m)),
            Err(TileError::Absent) => Ok(None),
            Err(TileError::Io(e)) => Err(e),
            Err(e) => Err(io::Error::other(e)),
        }
    }

    /// Which geographic posts the posts of a tile are made of.
    fn share_out(&self, (west, south): (i32, i32), shares: &mut Vec<Share>) {
        shares.clear();
        let side = offset(TILE_SIDE);
        for (y, j) in (0..side).zip(south..) {
            for (x, i) in (0..side).zip(west..) {
                let (longitude_deg, latitude_deg) = self
                    .cap
                    .to_geodetic(self.grid.longitude_deg(0, i), self.grid.latitude_deg(0, j));
                if latitude_deg.abs() < CAP_LATITUDE_MIN_DEG {
                    continue;
                }
                let (row, north) = split(self.grid, latitude_deg);
                let (column, east) = split(self.grid, longitude_deg);
                for (dj, weight_j) in [(0, 1.0 - north), (1, north)] {
                    for (di, weight_i) in [(0, 1.0 - east), (1, east)] {
                        let weight: f64 = weight_i * weight_j;
                        if weight > 0.0 {
                            let (i, j) = (self.grid.canonical(column + di), row + dj);
                            shares.push(Share {
                                key: TileKey::of_post(Partition::Geographic, 0, i, j),
                                at: TileKey::index_of(i, j),
                                weight,
                                post: y * side + x,
                            });
                        }
                    }
                }
            }
        }
    }

    /// Adds the shares that one geographic tile has, which comes with its error; where it does not exist, those of a void
    /// at sea level, which is what the geographic partition has there.
    fn take(&self, shares: &[Share], tile: Option<(f32, &Tile)>, made: &mut [Option<Made>]) {
        for share in shares {
            let (height_m, kind, error_m) = match tile {
                Some((error_m, tile)) => (
                    self.scale.height_m(tile.quanta[share.at]),
                    tile.kind[share.at],
                    error_m,
                ),
                None => (0.0, SurfaceKind::Void, 0.0),
            };
            let made = made[share.post].get_or_insert(Made {
                height_m: 0.0,
                error_m: 0.0,
                covered: false,
                void: false,
                most: (0.0, kind),
            });
            made.height_m += share.weight * height_m;
            made.error_m = made.error_m.max(error_m);
            made.covered |= tile.is_some();
            made.void |= kind == SurfaceKind::Void;
            if share.weight > made.most.0 {
                made.most = (share.weight, kind);
            }
        }
    }

    fn post(&self, made: &Made) -> Post {
        let quanta = self.scale.quanta(made.height_m);
        #[expect(
            clippy::cast_possible_truncation,
            reason = "an error is a fraction of a metre"
        )]
        let rounding_m = (self.scale.height_m(quanta) - made.height_m).abs() as f32;
        Post {
            quanta,
            kind: if made.void {
                SurfaceKind::Void
            } else {
                made.most.1
            },
            error_m: if made.void {
                0.0
            } else {
                made.error_m + rounding_m
            },
        }
    }
}

/// A count that is known not to be negative.
const fn offset(x: i32) -> usize {
    x.cast_unsigned() as usize
}
