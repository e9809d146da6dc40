//! The posts of a cap, from the geographic ones.
//!
//! A cap post has the height of the geographic level-0 surface at its place: bilinear in latitude and longitude between
//! the four finished posts around it, filled ones too. It is void if one of them is, and water if the one with the most
//! weight is. So the two partitions are one surface, each sampled in its own posts, and what a cap states as its error holds
//! against that surface and, with the error of the posts it rests on added, against the sources.
//!
//! The tiles written so far are read back. A cap tile asks for each of its posts' neighbours, sorts them by the tile they
//! are in and reads each tile once: at the pole, where a row of cap posts crosses all longitudes, as cheaply as elsewhere
//! a tile. Every geographic tile is unpacked several times; a cap takes about as long as the geographic posts under it at 70
//! degrees, and a third of that near the pole, where it has fewer posts than they.
//!
//! Memory: the index of the tiles read, a few blocks, and the tiles of coarse levels that are open along a
//! row of cap tiles: at most 24 MB for 3", 72 MB for 1".

use crate::terrain::bake_levels::{Block, Levels, Post};
use crate::terrain::codec::{SurfaceKind, Tile};
use crate::terrain::grid::{Grid, TILE_AREA, TILE_SIDE, TileKey};
use crate::terrain::height::split;
use crate::terrain::pack::{TileError, TileReader, Tiles};
use crate::terrain::partition::{CAP_LATITUDE_MIN_DEG, Partition};
use crate::terrain::store::Scale;
use std::collections::BTreeSet;
use std::io;

/// Tiles that all threads make together before they are written; their number has no part in it, so that the file does not
/// depend on it.
const TILES_PER_TURN: usize = 32;

/// Every so many posts of a geographic tile is asked which cap tile it is in; its neighbours up to the next are less than
/// [`REACH`] cap posts away, though cap columns lie closer together by 1 / cos 26 deg at the edge.
const STRIDE: i32 = 32;
const REACH: i32 = 48;

/// Adds a cap to a pack whose geographic posts are all there; whatever they cover from 64 degrees on. `proceed` is called
/// with the tiles done and their number, and says whether to go on.
///
/// # Errors
/// If writing, or reading back, fails.
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
        tiles: levels.turn_to(cap, row_min(grid))?,
    };
    let keys = source.keys();
    let mut hands: Vec<Hand> = std::iter::repeat_with(Hand::new)
        .take(jobs.max(1))
        .collect();
    for (number, keys_now) in keys.chunks(TILES_PER_TURN).enumerate() {
        if !proceed(number * TILES_PER_TURN, keys.len()) {
            return Ok(());
        }
        for block in source.blocks(keys_now, &mut hands)? {
            levels.scatter(&block);
        }
        if let Some(next) = keys.get((number + 1) * TILES_PER_TURN) {
            levels.flush(next.south(), None)?;
            levels.flush(next.south() + TILE_SIDE, Some(next.west()))?;
        }
    }
    proceed(keys.len(), keys.len());
    Ok(())
}

/// The level-0 row at which caps begin, counted from the equator.
fn row_min(grid: Grid) -> i32 {
    split(grid, CAP_LATITUDE_MIN_DEG).0
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
    /// The cap post's place in its tile.
    post: usize,
}

/// A cap post, share by share.
#[derive(Clone, Copy)]
struct Made {
    height_m: f64,
    error_m: f32,
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
        let share = keys.len().div_ceil(hands.len()).max(1);
        let mut blocks: Vec<Option<io::Result<Option<Block>>>> = Vec::new();
        blocks.resize_with(keys.len(), || None);
        let make = |hand: &mut Hand, to: &mut [Option<_>], keys: &[TileKey]| {
            for (to, key) in to.iter_mut().zip(keys) {
                *to = Some(self.block(*key, hand));
            }
        };
        std::thread::scope(|scope| {
            let shares = blocks.chunks_mut(share).zip(keys.chunks(share));
            let mut shares = hands.iter_mut().zip(shares);
            let own = shares.next();
            for (hand, (to, keys)) in shares {
                let builder = std::thread::Builder::new().name("cap".into());
                // Tiles of a thread that cannot start are made below.
                let _ = builder.spawn_scoped(scope, move || make(hand, to, keys));
            }
            if let Some((hand, (to, keys))) = own {
                make(hand, to, keys);
            }
        });
        let mut whole = Vec::with_capacity(keys.len());
        for (block, key) in blocks.into_iter().zip(keys) {
            whole.extend(block.unwrap_or_else(|| self.block(*key, &mut Hand::new()))?);
        }
        Ok(whole)
    }

    /// The posts of a level-0 tile of the cap; `None` if no geographic tile has a part in them.
    fn block(&self, key: TileKey, hand: &mut Hand) -> io::Result<Option<Block>> {
        self.share_out(key, &mut hand.shares);
        // By tile; and in one order whoever asks, so that sums come out the same to the last bit.
        hand.shares.sort_unstable_by_key(|s| (s.key, s.post, s.at));
        hand.made.clear();
        hand.made.resize(TILE_AREA, None);
        let mut any = false;
        for shares in hand.shares.chunk_by(|a, b| a.key == b.key) {
            any |= self.take(shares, &mut hand.reader, &mut hand.tile, &mut hand.made)?;
        }
        Ok(any.then(|| Block {
            south: key.south(),
            west: key.west(),
            columns: offset(TILE_SIDE),
            posts: hand.made.iter().map(|m| m.map(|m| self.post(&m))).collect(),
        }))
    }

    /// Which geographic posts the posts of a tile are made of.
    fn share_out(&self, key: TileKey, shares: &mut Vec<Share>) {
        shares.clear();
        for (y, j) in (key.south()..key.south() + TILE_SIDE).enumerate() {
            for (x, i) in (key.west()..key.west() + TILE_SIDE).enumerate() {
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
                                post: y * offset(TILE_SIDE) + x,
                            });
                        }
                    }
                }
            }
        }
    }

    /// Adds the shares that one geographic tile has; where it does not exist, those of a void at sea level, which is what
    /// the geographic partition has there. Whether it exists.
    fn take(
        &self,
        shares: &[Share],
        reader: &mut TileReader,
        tile: &mut Tile,
        made: &mut [Option<Made>],
    ) -> io::Result<bool> {
        let Some(first) = shares.first() else {
            return Ok(false);
        };
        let read = self.tiles.read(first.key, reader, tile);
        let error_m = match (read, self.tiles.entry(first.key)) {
            (Ok(()), Some(entry)) => Some(entry.max_error_m),
            (Err(TileError::Absent), _) | (Ok(()), None) => None,
            (Err(TileError::Io(e)), _) => return Err(e),
            (Err(e), _) => return Err(io::Error::other(e)),
        };
        for share in shares {
            let (height_m, kind) = match error_m {
                Some(_) => (
                    self.scale.height_m(tile.quanta[share.at]),
                    tile.kind[share.at],
                ),
                None => (0.0, SurfaceKind::Void),
            };
            let made = made[share.post].get_or_insert(Made {
                height_m: 0.0,
                error_m: 0.0,
                void: false,
                most: (0.0, kind),
            });
            made.height_m += share.weight * height_m;
            made.error_m = made.error_m.max(error_m.unwrap_or(0.0));
            made.void |= kind == SurfaceKind::Void;
            if share.weight > made.most.0 {
                made.most = (share.weight, kind);
            }
        }
        Ok(error_m.is_some())
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
