//! All that a pack covers in one picture, for the one-piece Earth seen from far above: which posts it is made of, and the
//! thread that reads them. [`crate::gl::globe`] draws it.
//!
//! The thread sleeps until it is asked, makes the picture once with all its levels of detail, hands it over piece by piece,
//! and ends. It allocates when it is asked, on its own account; pieces circulate, so the frame loop never does.

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

    /// Levels of detail: down to one texel.
    #[must_use]
    pub fn details(&self) -> u8 {
        let longest = self.width.max(self.height).max(1);
        u8::try_from(longest.ilog2() + 1).unwrap_or(1)
    }

    /// Columns and rows of a level of detail.
    #[must_use]
    pub fn size(&self, detail: u8) -> (i32, i32) {
        (
            (self.width >> detail).max(1),
            (self.height >> detail).max(1),
        )
    }

    /// Texels of a level of detail.
    #[must_use]
    pub fn texels(&self, detail: u8) -> usize {
        let (width, height) = self.size(detail);
        unsigned(width) * unsigned(height)
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

/// A rectangle of a level of detail of the picture, row by row from its south-west texel.
#[derive(Debug)]
pub struct Piece {
    /// Which level of detail: 0 the finest.
    pub detail: u8,
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
                detail: 0,
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

    /// Paints the finest level of detail, then halves it until one texel is left, and sends each as it is done.
    fn paint<S: TileSource>(&mut self, source: &S, extent: Extent) {
        let mut canvas = Canvas::painted(source, &extent, &self.shared.stop);
        for detail in 0..extent.details() {
            if detail > 0 {
                canvas = canvas.reduced(extent.size(detail));
            }
            if !self.send(detail, &canvas) {
                return;
            }
        }
    }

    /// Sends a level of detail in pieces; `false` when it is to stop.
    fn send(&mut self, detail: u8, canvas: &Canvas) -> bool {
        for y in (0..canvas.height).step_by(PIECE_SIDE as usize) {
            for x in (0..canvas.width).step_by(PIECE_SIDE as usize) {
                if !self.wait(|hand| !hand.from.is_empty()) {
                    return false;
                }
                let Ok(mut piece) = self.from.pop() else {
                    return false;
                };
                (piece.detail, piece.x, piece.y) = (detail, x, y);
                piece.width = PIECE_SIDE.min(canvas.width - x);
                piece.height = PIECE_SIDE.min(canvas.height - y);
                piece.surface.clear();
                piece.tint.clear();
                for row in y..y + piece.height {
                    let first = canvas.index(x, row);
                    let all = first..first + unsigned(piece.width);
                    piece
                        .surface
                        .extend_from_slice(&canvas.surface[all.clone()]);
                    piece.tint.extend_from_slice(&canvas.tint[all]);
                }
                if self.to.push(piece).is_err() {
                    return false;
                }
            }
        }
        true
    }
}

/// A level of detail of the picture.
struct Canvas {
    width: i32,
    height: i32,
    surface: Vec<[u8; 4]>,
    tint: Vec<u8>,
}

impl Canvas {
    fn new((width, height): (i32, i32)) -> Self {
        let texels = unsigned(width) * unsigned(height);
        Self {
            width,
            height,
            surface: vec![[0; 4]; texels],
            tint: vec![0; texels],
        }
    }

    fn index(&self, x: i32, y: i32) -> usize {
        unsigned(y) * unsigned(self.width) + unsigned(x)
    }

    /// The finest one, from a pack; unfinished where it is told to stop.
    fn painted<S: TileSource>(source: &S, extent: &Extent, stop: &AtomicBool) -> Self {
        let info = source.info();
        let heights = HeightCode::covering(info.height_min_m, info.height_max_m);
        // What is damaged is counted where it is flown over.
        let damage = Damage::default();
        let mut sampler = Sampler::new(source, Partition::Geographic, heights, &damage);
        let mut codes = vec![[0_u16; 2]; BATCH_TEXELS];
        let mut surface = vec![[0_u8; 4]; BATCH_TEXELS];
        let mut canvas = Self::new(extent.size(0));
        let side = if extent.every == 1 { PIECE_SIDE } else { 1 };
        for y in (0..extent.height).step_by(unsigned(side)) {
            for x in (0..extent.width).step_by(unsigned(side)) {
                if stop.load(Ordering::Acquire) {
                    return canvas;
                }
                let post = (
                    extent.west + x * extent.every,
                    extent.south + y * extent.every,
                );
                let width = unsigned(side.min(extent.width - x));
                let height = unsigned(side.min(extent.height - y));
                let count = width * height;
                sampler.fill(
                    extent.level,
                    post,
                    (width, height),
                    &mut codes[..count],
                    &mut surface[..count],
                );
                let rows = codes[..count]
                    .chunks_exact(width)
                    .zip(surface.chunks_exact(width));
                for (row, (codes, surface)) in (y..).zip(rows) {
                    let first = canvas.index(x, row);
                    canvas.surface[first..first + width].copy_from_slice(surface);
                    for (tint, code) in canvas.tint[first..].iter_mut().zip(codes) {
                        *tint = encode_tint(heights.decode(code[0]));
                    }
                }
            }
        }
        canvas
    }

    /// About half as large in each direction: every texel is the mean of the two or three by two or three it covers, by how
    /// much of each, so that nothing wanders however often it is done.
    fn reduced(&self, size: (i32, i32)) -> Self {
        let mut out = Self::new(size);
        for y in 0..size.1 {
            let rows = shares(y, size.1, self.height);
            for x in 0..size.0 {
                let columns = shares(x, size.0, self.width);
                let mut sums = [0.0_f32; 5];
                for (row, of_row) in rows.clone() {
                    for (column, of_column) in columns.clone() {
                        let at = self.index(column, row);
                        let share = of_row * of_column;
                        let [a, b, c, d] = self.surface[at];
                        for (sum, byte) in sums.iter_mut().zip([a, b, c, d, self.tint[at]]) {
                            *sum += share * f32::from(byte);
                        }
                    }
                }
                let [a, b, c, d, tint] = sums.map(rounded);
                let at = out.index(x, y);
                out.surface[at] = [a, b, c, d];
                out.tint[at] = tint;
            }
        }
        out
    }
}

/// The texels, out of `of`, under texel `at` of a row of `count`, with the share that each has in it.
#[expect(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    reason = "rows of at most a few thousand texels"
)]
fn shares(at: i32, count: i32, of: i32) -> impl Iterator<Item = (i32, f32)> + Clone {
    let ratio = of as f32 / count as f32;
    let (begin, end) = (at as f32 * ratio, (at + 1) as f32 * ratio);
    let last = (end.ceil() as i32).min(of);
    (begin as i32..last).map(move |texel| {
        let covered = end.min((texel + 1) as f32) - begin.max(texel as f32);
        (texel, covered.max(0.0) / ratio)
    })
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a mean of bytes is a byte"
)]
fn rounded(mean: f32) -> u8 {
    mean.round() as u8
}

const fn unsigned(count: i32) -> usize {
    count.cast_unsigned() as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::terrain::grid::{Bounds, POSTS_PER_DEGREE, PostRect};
    use crate::terrain::pack::LevelErrors;

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
            level_errors: LevelErrors::default(),
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
        for posts_per_degree in POSTS_PER_DEGREE {
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

    #[test]
    fn halving_keeps_means_and_places() {
        for (width, height) in [(8, 6), (13, 7), (5, 1)] {
            let mut canvas = Canvas::new((width, height));
            for y in 0..height {
                for x in 0..width {
                    let at = canvas.index(x, y);
                    // A ramp: its value tells where it is, to a tenth of a texel.
                    let value = u8::try_from(10 * x + 5 * y).expect("small");
                    canvas.surface[at] = [value, 128, 0, 255];
                    canvas.tint[at] = value;
                }
            }
            let size = ((width / 2).max(1), (height / 2).max(1));
            let half = canvas.reduced(size);
            for y in 0..size.1 {
                for x in 0..size.0 {
                    let at = half.index(x, y);
                    let centre = |at: i32, count: i32, of: i32| {
                        (f64::from(at) + 0.5) * f64::from(of) / f64::from(count) - 0.5
                    };
                    let (cx, cy) = (centre(x, size.0, width), centre(y, size.1, height));
                    let expected = 10.0 * cx + 5.0 * cy;
                    assert!(
                        (f64::from(half.tint[at]) - expected).abs() <= 1.1,
                        "{x} {y}"
                    );
                    assert_eq!(half.surface[at][1..], [128, 0, 255]);
                }
            }
        }
    }
}
