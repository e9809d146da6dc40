//! The posts of a cap, from the geographic ones.
//!
//! A cap post has the height of the geographic level-0 surface at its place: bilinear in latitude and longitude between
//! the four finished posts around it, filled ones too. It is void if one of them is, and water if the one with the most
//! weight is. So the two partitions are one surface, each sampled in its own posts. Columns of the geographic grid are closer
//! together here than posts of a cap, so a cap passes some of its posts by, a summit perhaps; therefore every geographic post
//! is compared with the cap's bilinear surface, and the largest difference, with the error of the geographic posts added, is
//! what a finest cap tile states as its error.
//!
//! The tiles written so far are read back. A cap tile asks for each of its posts' neighbours, sorts them by the tile they
//! are in and reads each tile once, and once more to compare: at the pole, where a row of cap posts crosses all longitudes,
//! as cheaply as elsewhere. Every geographic tile is unpacked several times.
//!
//! Memory: the index of the tiles read, a few blocks, and the tiles of coarse levels that are open along a row of cap
//! tiles: at most 24 MB for 3", 72 MB for 1".

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

/// Posts around a tile that are made with it: the surface goes on to the next tile's first posts, and a geographic tile with
/// a corner in the surface has a part in one of the posts two steps around it.
const MARGIN: i32 = 2;
/// Posts of a tile and its margins, along a side.
const WIDTH: usize = offset(TILE_SIDE + 2 * MARGIN);

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
    /// Posts of a tile and its margins, row by row from the south-west.
    made: Vec<Option<Made>>,
}

impl Hand {
    fn new() -> Self {
        Self {
            reader: TileReader::new(),
            tile: Tile::filled(0, SurfaceKind::Void),
            shares: Vec::with_capacity(4 * WIDTH * WIDTH),
            made: Vec::with_capacity(WIDTH * WIDTH),
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
    /// What the tiles it rests on state; once it is whole, how far the surface north and east of it, to the next posts, is
    /// from geographic posts there.
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
        let corner = (key.west() - MARGIN, key.south() - MARGIN);
        self.share_out(corner, &mut hand.shares);
        // By tile; and in one order whoever asks, so that sums come out the same to the last bit.
        hand.shares.sort_unstable_by_key(|s| (s.key, s.post, s.at));
        hand.made.clear();
        hand.made.resize(WIDTH * WIDTH, None);
        for shares in hand.shares.chunk_by(|a, b| a.key == b.key) {
            let error_m = self.read(shares[0].key, &mut hand.reader, &mut hand.tile)?;
            self.take(shares, error_m.map(|e| (e, &hand.tile)), &mut hand.made);
        }
        let side = offset(TILE_SIDE);
        let own = |at: usize| (at / side + offset(MARGIN)) * WIDTH + at % side + offset(MARGIN);
        let covered = |at: usize| hand.made[own(at)].is_some_and(|m| m.covered);
        if !(0..TILE_AREA).any(covered) {
            return Ok(None);
        }
        for made in hand.made.iter_mut().flatten() {
            made.round(self.scale);
        }
        for shares in hand.shares.chunk_by(|a, b| a.key == b.key) {
            let at = shares[0].key;
            if let Some(error_m) = self.read(at, &mut hand.reader, &mut hand.tile)? {
                self.compare(at, (&hand.tile, error_m), corner, &mut hand.made);
            }
        }
        let post = |at: usize| Some(self.post(hand.made[own(at)].as_ref().filter(|m| m.covered)?));
        Ok(Some(Block {
            south: key.south(),
            west: key.west(),
            columns: side,
            posts: (0..TILE_AREA).map(post).collect(),
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

    /// Which geographic posts the posts of a tile and its margins are made of.
    fn share_out(&self, (west, south): (i32, i32), shares: &mut Vec<Share>) {
        shares.clear();
        for (y, j) in (0..WIDTH).zip(south..) {
            for (x, i) in (0..WIDTH).zip(west..) {
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
                                post: y * WIDTH + x,
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

    /// Compares the posts of a geographic tile that lie in the surface from the tile's south-west post to its neighbours'
    /// with the surface. Voids, and ground beside a void, are not compared: they are not drawn as ground.
    fn compare(
        &self,
        key: TileKey,
        (tile, error_m): (&Tile, f32),
        (west, south): (i32, i32),
        made: &mut [Option<Made>],
    ) {
        let angle = |post: i32| self.grid.longitude_deg(0, post).to_radians();
        let first = |corner: i32| angle(corner + MARGIN);
        let last = |corner: i32| angle(corner + MARGIN + TILE_SIDE);
        let (tan_west, tan_east) = (first(west).tan(), last(west).tan());
        let (sin_south, sin_north) = (first(south).sin(), last(south).sin());
        let sign = if self.cap == Partition::South {
            -1.0
        } else {
            1.0
        };
        let columns = key.west()..key.west() + TILE_SIDE;
        let turns: Vec<(i32, (f64, f64))> = columns.map(|i| (i, angle(i).sin_cos())).collect();
        for row in key.south()..key.south() + TILE_SIDE {
            let (sin_b, cos_b) = angle(row).sin_cos();
            for (column, (sin_l, cos_l)) in &turns {
                let at = TileKey::index_of(*column, row);
                if tile.kind[at] == SurfaceKind::Void {
                    continue;
                }
                // Without an inverse function for the many that are elsewhere; see Partition::normal.
                let (x, y, z) = (cos_b * cos_l, sign * cos_b * sin_l, sign * sin_b);
                let inside =
                    y >= sin_south && y < sin_north && x >= tan_west * z && x < tan_east * z;
                if !inside {
                    continue;
                }
                let posts =
                    |radians: f64| radians.to_degrees() * f64::from(self.grid.posts_per_degree);
                let place = (
                    posts(x.atan2(z)) - f64::from(west),
                    posts(y.atan2(x.hypot(z))) - f64::from(south),
                );
                let height_m = self.scale.height_m(tile.quanta[at]);
                if let Some((surface_m, cell)) = surface(made, place)
                    && let Some(made) = &mut made[cell]
                {
                    #[expect(
                        clippy::cast_possible_truncation,
                        reason = "a difference of heights on Earth"
                    )]
                    let difference_m = (surface_m - height_m).abs() as f32;
                    made.error_m = made.error_m.max(difference_m + error_m);
                }
            }
        }
    }

    fn post(&self, made: &Made) -> Post {
        Post {
            quanta: self.scale.quanta(made.height_m),
            kind: if made.void {
                SurfaceKind::Void
            } else {
                made.most.1
            },
            error_m: if made.void { 0.0 } else { made.error_m },
        }
    }
}

impl Made {
    /// From what its shares add up to, to what is stored.
    fn round(&mut self, scale: Scale) {
        let stored_m = scale.height_m(scale.quanta(self.height_m));
        #[expect(
            clippy::cast_possible_truncation,
            reason = "an error is a fraction of a metre"
        )]
        {
            self.error_m += (stored_m - self.height_m).abs() as f32;
        }
        self.height_m = stored_m;
    }
}

/// The bilinear surface at a place among the posts made, and the post south-west of it; `None` where one of the four posts
/// around it is void or not there.
fn surface(made: &[Option<Made>], (x, y): (f64, f64)) -> Option<(f64, usize)> {
    let cell = |x: f64| {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "clamped to what was made"
        )]
        let floor = x.floor().max(0.0) as usize;
        floor.min(WIDTH - 2)
    };
    let (column, row) = (cell(x), cell(y));
    let at = row * WIDTH + column;
    let height_m = |at: usize| made[at].as_ref().filter(|m| !m.void).map(|m| m.height_m);
    let along = |at: usize, x: f64| Some(height_m(at)? * (1.0 - x) + height_m(at + 1)? * x);
    #[expect(clippy::cast_precision_loss, reason = "at most 131")]
    let (x, y) = (x - column as f64, y - row as f64);
    Some((along(at, x)? * (1.0 - y) + along(at + WIDTH, x)? * y, at))
}

/// A count that is known not to be negative.
const fn offset(x: i32) -> usize {
    x.cast_unsigned() as usize
}
