//! All that a pack covers in one picture, for the one-piece Earth seen from far above: which posts it is made of, and the
//! thread that reads them. [`crate::gl::globe`] draws it.
//!
//! The thread sleeps until it is asked, makes the picture once, piece by piece, and ends. It allocates when it is asked, on
//! its own account; pieces circulate, so the frame loop never does.

use super::grid::Grid;
use super::pack::PackInfo;
use super::partition::Partition;
use super::surface::{BATCH_TEXELS, Damage, Sampler, TileSource};
use super::tables::HeightCode;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};

/// The longest side of the picture, texels.
pub const SIDE_MAX: i32 = 2048;

/// Side of a piece, texels.
const PIECE_SIDE: i32 = 64;

/// Pieces in circulation.
const PIECES: usize = 8;

const _: () = assert!(
    PIECE_SIDE as usize * PIECE_SIDE as usize <= BATCH_TEXELS,
    "a piece is filled at once"
);

/// The posts of the picture: a rectangle of a level of the geographic partition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extent {
    /// The grid.
    pub grid: Grid,
    /// Whose posts they are: the finest level of which they fit [`SIDE_MAX`].
    pub level: u8,
    /// Every how manieth post it is; 1 unless the coarsest level is too large.
    pub every: i32,
    /// Westernmost column.
    pub west: i32,
    /// Southernmost row.
    pub south: i32,
    /// Columns.
    pub width: i32,
    /// Rows.
    pub height: i32,
}

impl Extent {
    /// Of a pack. What closes around the Earth has its first column at its end again.
    #[must_use]
    pub fn of(info: &PackInfo) -> Self {
        let (rect, grid) = (info.rect, info.grid);
        let east = if rect.east - rect.west + 1 >= grid.posts_around() {
            rect.west + grid.posts_around()
        } else {
            rect.east
        };
        let last = info.levels.saturating_sub(1);
        let on = |level: u8, every: i32| {
            let step = every << level;
            let inside = |low: i32, high: i32| (-(-low).div_euclid(step), high.div_euclid(step));
            let (west, last_column) = inside(rect.west, east);
            let (south, last_row) = inside(rect.south, rect.north);
            Self {
                grid,
                level,
                every,
                west: west * every,
                south: south * every,
                width: (last_column - west + 1).max(1),
                height: (last_row - south + 1).max(1),
            }
        };
        let fits = |extent: &Self| extent.width <= SIDE_MAX && extent.height <= SIDE_MAX;
        (0..=last)
            .map(|level| on(level, 1))
            .chain((1..16).map(|k| on(last, 1 << k)))
            .find(fits)
            .unwrap_or_else(|| on(last, 1 << 16))
    }

    /// Degrees from one texel to the next.
    #[must_use]
    pub fn spacing_deg(&self) -> f64 {
        self.grid.spacing_deg(self.level) * f64::from(self.every)
    }

    /// Longitude of the first column and latitude of the first row, degrees.
    #[must_use]
    pub fn corner_deg(&self) -> (f64, f64) {
        (
            self.grid.longitude_deg(self.level, self.west),
            self.grid.latitude_deg(self.level, self.south),
        )
    }

    /// Texels.
    #[must_use]
    pub const fn texels(&self) -> usize {
        self.width.cast_unsigned() as usize * self.height.cast_unsigned() as usize
    }
}

/// A height above the ellipsoid as a byte, in steps of 25 m from -500 m to 5875 m: enough to tint by.
#[must_use]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "float casts saturate, which is what is wanted"
)]
pub fn encode_tint(height_m: f64) -> u8 {
    ((height_m - TINT_BASE_M) / TINT_STEP_M).round() as u8
}

/// Height of the first [`encode_tint`] byte, metres.
pub const TINT_BASE_M: f64 = -500.0;
/// Height from one [`encode_tint`] byte to the next, metres.
pub const TINT_STEP_M: f64 = 25.0;

/// A rectangle of the picture, row by row from its south-west texel.
#[derive(Debug)]
pub struct Piece {
    /// First column.
    pub x: i32,
    /// First row.
    pub y: i32,
    /// Columns.
    pub width: i32,
    /// Rows.
    pub height: i32,
    /// Texels of the surface: [`super::texel`].
    pub surface: Vec<[u8; 4]>,
    /// Heights: [`encode_tint`].
    pub tint: Vec<u8>,
}

/// The render thread's end of the painter. Dropping it ends the thread.
#[derive(Debug)]
pub struct Painter {
    filled: rtrb::Consumer<Piece>,
    empty: rtrb::Producer<Piece>,
    asked: bool,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug, Default)]
struct Shared {
    asked: AtomicBool,
    stop: AtomicBool,
}

impl Painter {
    /// Starts the thread, which sleeps.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn start<S: TileSource>(source: Arc<S>, extent: Extent) -> io::Result<Self> {
        let (to_filled, filled) = rtrb::RingBuffer::new(PIECES);
        let (mut empty, from_empty) = rtrb::RingBuffer::new(PIECES);
        let area = (PIECE_SIDE * PIECE_SIDE).cast_unsigned() as usize;
        for _ in 0..PIECES {
            let piece = Piece {
                x: 0,
                y: 0,
                width: 0,
                height: 0,
                surface: Vec::with_capacity(area),
                tint: Vec::with_capacity(area),
            };
            // As many places as pieces.
            let _ = empty.push(piece);
        }
        let shared = Arc::new(Shared::default());
        let seen = Arc::clone(&shared);
        let thread = thread::Builder::new().name("globe".into()).spawn(move || {
            let mut hand = Hand {
                shared: &seen,
                to: to_filled,
                from: from_empty,
            };
            if hand.wait(|hand| hand.shared.asked.load(Ordering::Acquire)) {
                hand.paint(&*source, extent);
            }
        })?;
        Ok(Self {
            filled,
            empty,
            asked: false,
            shared,
            thread: Some(thread),
        })
    }

    /// Wakes the thread; only the first time does anything.
    pub fn ask(&mut self) {
        if !self.asked {
            self.asked = true;
            self.shared.asked.store(true, Ordering::Release);
            self.wake();
        }
    }

    /// The next piece, if one is ready. It is to be given back.
    pub fn receive(&mut self) -> Option<Piece> {
        self.filled.pop().ok()
    }

    /// Gives a piece back.
    pub fn give_back(&mut self, piece: Piece) {
        // As many places as pieces; after its last one the thread is gone.
        let _ = self.empty.push(piece);
        self.wake();
    }

    fn wake(&self) {
        if let Some(thread) = &self.thread {
            thread.thread().unpark();
        }
    }
}

impl Drop for Painter {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Release);
        self.wake();
        if let Some(thread) = self.thread.take() {
            // A thread that panicked has printed its reason.
            let _ = thread.join();
        }
    }
}

/// The painting thread's end.
struct Hand<'a> {
    shared: &'a Shared,
    to: rtrb::Producer<Piece>,
    from: rtrb::Consumer<Piece>,
}

impl Hand<'_> {
    /// Sleeps until something is so; `false` when it is to stop.
    fn wait(&mut self, is_so: impl Fn(&Self) -> bool) -> bool {
        loop {
            if self.shared.stop.load(Ordering::Acquire) {
                return false;
            }
            if is_so(self) {
                return true;
            }
            thread::park();
        }
    }

    fn paint<S: TileSource>(&mut self, source: &S, extent: Extent) {
        let info = source.info();
        let heights = HeightCode::covering(info.height_min_m, info.height_max_m);
        // What is damaged is counted where it is flown over.
        let damage = Damage::default();
        let mut sampler = Sampler::new(source, Partition::Geographic, heights, &damage);
        let mut codes = vec![[0_u16; 2]; BATCH_TEXELS];
        let mut surface = vec![[0_u8; 4]; BATCH_TEXELS];
        for y in (0..extent.height).step_by(PIECE_SIDE as usize) {
            for x in (0..extent.width).step_by(PIECE_SIDE as usize) {
                if !self.wait(|hand| !hand.from.is_empty()) {
                    return;
                }
                let Ok(mut piece) = self.from.pop() else {
                    return;
                };
                (piece.x, piece.y) = (x, y);
                piece.width = PIECE_SIDE.min(extent.width - x);
                piece.height = PIECE_SIDE.min(extent.height - y);
                piece.surface.clear();
                piece.tint.clear();
                let mut take = |at: (i32, i32), size: (i32, i32)| {
                    let (width, height) = (unsigned(size.0), unsigned(size.1));
                    let count = width * height;
                    sampler.fill(
                        extent.level,
                        at,
                        (width, height),
                        &mut codes[..count],
                        &mut surface[..count],
                    );
                    piece.surface.extend_from_slice(&surface[..count]);
                    let tints = codes[..count].iter();
                    piece
                        .tint
                        .extend(tints.map(|c| encode_tint(heights.decode(c[0]))));
                };
                let post = |x: i32, y: i32| {
                    (
                        extent.west + x * extent.every,
                        extent.south + y * extent.every,
                    )
                };
                if extent.every == 1 {
                    take(post(x, y), (piece.width, piece.height));
                } else {
                    for row in y..y + piece.height {
                        for column in x..x + piece.width {
                            take(post(column, row), (1, 1));
                        }
                    }
                }
                if self.to.push(piece).is_err() {
                    return;
                }
            }
        }
    }
}

const fn unsigned(count: i32) -> usize {
    count.cast_unsigned() as usize
}

#[cfg(test)]
mod tests {
    use super::super::grid::{Bounds, PostRect};
    use super::*;

    fn info(posts_per_degree: u32, rect: PostRect) -> PackInfo {
        let grid = Grid { posts_per_degree };
        PackInfo {
            version: 2,
            grid,
            levels: grid.level_count(),
            partitions: [true, false, false],
            rect,
            bounds: Bounds {
                south_deg: 0.0,
                west_deg: 0.0,
                north_deg: 0.0,
                east_deg: 0.0,
            },
            unit_m: 1.0,
            base_m: 0.0,
            height_min_m: 0.0,
            height_max_m: 0.0,
            tiles: 0,
            posts: 0,
            void_posts: 0,
            water_posts: 0,
            bytes: 0,
        }
    }

    #[test]
    fn one_degree_is_drawn_from_its_finest_posts() {
        let rect = PostRect {
            south: 46 * 1200,
            west: 8 * 1200,
            north: 47 * 1200,
            east: 9 * 1200,
        };
        let extent = Extent::of(&info(1200, rect));
        assert_eq!((extent.level, extent.every), (0, 1));
        assert_eq!((extent.west, extent.south), (rect.west, rect.south));
        assert_eq!((extent.width, extent.height), (1201, 1201));
    }

    #[test]
    fn the_whole_earth_fits_and_closes() {
        for posts_per_degree in super::super::grid::POSTS_PER_DEGREE {
            let grid = Grid { posts_per_degree };
            let half = grid.posts_around() / 2;
            let rect = PostRect {
                south: -grid.row_max(),
                west: -half,
                north: grid.row_max(),
                east: half - 1,
            };
            let extent = Extent::of(&info(posts_per_degree, rect));
            assert!(
                extent.width <= SIDE_MAX && extent.height <= SIDE_MAX,
                "{extent:?}"
            );
            assert!(extent.width > SIDE_MAX / 4, "{extent:?}");
            let across_deg = f64::from(extent.width - 1) * extent.spacing_deg();
            assert!(
                across_deg > 360.0 - 2.0 * extent.spacing_deg(),
                "{extent:?}"
            );
        }
    }

    #[test]
    fn a_tint_is_within_half_a_step() {
        for height_m in [-430.0, 0.0, 13.0, 2712.0, 5800.0] {
            let back = f64::from(encode_tint(height_m)) * TINT_STEP_M + TINT_BASE_M;
            assert!(
                (back - height_m).abs() <= TINT_STEP_M / 2.0,
                "{height_m}: {back}"
            );
        }
        assert_eq!((encode_tint(-9000.0), encode_tint(8848.0)), (0, 255));
    }
}
