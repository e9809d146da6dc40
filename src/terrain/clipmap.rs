//! The clipmap's geometry: how large a level is, where its window stands for an eye, which levels a view wants, and how a
//! level blends into the next coarser one. Pure integer and f64 arithmetic.
//!
//! Level 0 is the finest. A level shows a *window* of n x n posts whose south-west post, its *origin*, is even, so that
//! every second post of its edge is a post of the next level. Its texels live in a *torus* of T x T texels: post (i, j)
//! at texel (i mod T, j mod T), wherever the window stands.
//!
//! Longitude is kept continuous across the date line by whoever follows the eye, so post columns may lie beyond
//! +-180 degrees; only reading tiles brings them back. Rows of the geographic partition end short of the poles, see
//! [`row_limit`]. In a cap, longitude and latitude are those of its grid ([`super::partition`]).
//!
//! Sources: F. Losasso and H. Hoppe, "Geometry clipmaps", SIGGRAPH 2004; A. Asirvatham and H. Hoppe, GPU Gems 2,
//! chapter 2.

use super::grid::Grid;
use crate::limits::{LEVEL_VERTICES_MAX, LEVELS_MAX};

/// Radius that turns latitude into metres to within 0.4 %: WGS 84's mean, (2a + b) / 3.
const MEAN_RADIUS_M: f64 = 6_371_008.8;

/// The eye may be this far from the centre of its window, in posts, before the window moves. Even rounding needs 1; the
/// half more keeps a hovering eye from moving it to and fro.
const CENTRING_POSTS: f64 = 1.5;

/// How far the centre of the blend may be from the window's centre, in posts. A window that lags more than this blends
/// around this point instead of around the eye, so that its edge still meets the next level exactly.
const MORPH_LAG_POSTS: f64 = 2.0;

/// Share of a window's half-width over which it blends into the next coarser level.
const MORPH_SHARE: f64 = 0.15;

/// Latitude beyond which the geographic partition draws nothing. It is drawn up to a degree or so beyond the seam, from where
/// the horizon of 20 km and the highest mountains behind it end at 79 degrees.
const LATITUDE_MAX_DEG: f64 = 85.0;

/// Blocks are not longer than this, in cells: see [`Shape::block_cells`].
const BLOCK_CELLS_MAX: i32 = 9;

/// How many vertices a level has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape(u16);

impl Shape {
    /// 447 vertices a side.
    pub const DEFAULT: Self = Self(447);

    /// A level of `vertices` a side: 63 to [`LEVEL_VERTICES_MAX`], one less than a multiple of 16, so that blocks and the
    /// edges of nested windows fit. `None` for any other number.
    #[must_use]
    pub const fn new(vertices: u32) -> Option<Self> {
        let fits = vertices >= 63 && vertices as usize <= LEVEL_VERTICES_MAX;
        if fits && (vertices + 1).is_multiple_of(16) {
            #[expect(
                clippy::cast_possible_truncation,
                reason = "a few hundred, just checked"
            )]
            Some(Self(vertices as u16))
        } else {
            None
        }
    }

    /// Vertices a side, n.
    #[must_use]
    pub fn vertices(self) -> i32 {
        i32::from(self.0)
    }

    /// Cells a side, W = n - 1, an even number.
    #[must_use]
    pub fn cells(self) -> i32 {
        i32::from(self.0) - 1
    }

    /// Texels a side of the torus: the next power of two, 64 to 512.
    #[must_use]
    pub const fn texels(self) -> usize {
        (self.0 as usize).next_power_of_two()
    }

    /// The longest side of a block in cells: a sixteenth of the window and one, at most 9. Small blocks follow the sides of
    /// the picture and the ridges closely. Measured on a view of the Andes with 447 vertices, of whose 288 000 triangles
    /// in the picture's sides 112 000 are drawn: blocks of 12 draw a tenth more, of 17 a third more.
    #[must_use]
    pub const fn block_cells(self) -> i32 {
        let wide = (self.0 as i32 + 1) / 16 + 1;
        if wide < BLOCK_CELLS_MAX {
            wide
        } else {
            BLOCK_CELLS_MAX
        }
    }

    /// A window that is farther than this from where it should be, in posts, is filled anew instead of moved. Less than half
    /// of a window, so that the eye stands inside every window that is drawn.
    #[must_use]
    pub fn strip_steps_max(self) -> i32 {
        (self.cells() / 2 - 8).min(48)
    }

    fn half(self) -> f64 {
        f64::from(self.cells()) / 2.0
    }
}

/// Where a level's window stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Column of its westernmost posts, even.
    pub i: i32,
    /// Row of its southernmost posts, even.
    pub j: i32,
}

impl Window {
    /// The window for an eye at post position (`x`, `y`): centred to within one post. A `current` window stays while the
    /// eye is within 1.5 posts of its centre.
    #[must_use]
    pub fn around(shape: Shape, x: f64, y: f64, current: Option<Self>) -> Self {
        Self {
            i: origin(shape, x, current.map(|w| w.i)),
            j: origin(shape, y, current.map(|w| w.j)),
        }
    }
}

fn origin(shape: Shape, x: f64, current: Option<i32>) -> i32 {
    let west = x - shape.half();
    if let Some(c) = current
        && (west - f64::from(c)).abs() <= CENTRING_POSTS
    {
        return c;
    }
    #[expect(
        clippy::cast_possible_truncation,
        reason = "a post number: the eye is on the Earth, and float casts saturate"
    )]
    let half = (west / 2.0).round() as i32;
    2 * half
}

/// The eye among the posts of a level: continuous post coordinates of a longitude and a latitude in degrees.
#[must_use]
pub fn post_position(grid: Grid, level: u8, longitude_deg: f64, latitude_deg: f64) -> (f64, f64) {
    let per_degree = f64::from(grid.posts_per_degree) / f64::from(1_u32 << level);
    (longitude_deg * per_degree, latitude_deg * per_degree)
}

/// Highest drawn post row of a level of the geographic partition; the lowest is its negative. All `levels` levels end at the
/// same latitude, the last even row of the coarsest one within 85 degrees.
#[must_use]
pub fn row_limit(grid: Grid, levels: u8, level: u8) -> i32 {
    let coarsest = levels.saturating_sub(1);
    let per_degree = f64::from(grid.posts_per_degree) / f64::from(1_u32 << coarsest);
    #[expect(
        clippy::cast_possible_truncation,
        reason = "below 85 x 10 800, a small whole number"
    )]
    let rows = 2 * (LATITUDE_MAX_DEG * per_degree / 2.0).floor() as i32;
    rows << coarsest.saturating_sub(level)
}

/// What decides which levels a view wants.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// Grid latitude of the eye, degrees.
    pub latitude_deg: f64,
    /// Height of the eye above the ground under it, or above the lowest ground where that is not known, metres.
    pub above_ground_m: f64,
    /// Height of the eye above the lowest terrain of the pack, metres.
    pub above_lowest_m: f64,
    /// Height of the highest terrain of the pack above its lowest, metres.
    pub relief_m: f64,
    /// Focal length, pixels.
    pub focal_px: f64,
}

/// The finest and the coarsest level a view wants, out of `levels` levels.
///
/// The finest is the first whose spacing, seen from the eye's height above ground, which no terrain below is nearer than,
/// is at least `pixels` wide: finer cells would be smaller than that everywhere. The coarsest is the first whose window
/// reaches the farthest terrain that the horizon lets through.
#[must_use]
pub fn wanted_levels(shape: Shape, grid: Grid, levels: u8, view: &View, pixels: f64) -> (u8, u8) {
    let last = levels.saturating_sub(1);
    let spacing_m = |level: u8| grid.spacing_deg(level).to_radians() * MEAN_RADIUS_M;
    let above = view.above_ground_m.max(0.0);
    let finest = (0..last)
        .find(|&l| spacing_m(l) * view.focal_px >= pixels * above)
        .unwrap_or(last);
    let horizon_m = horizon_distance_m(view.above_lowest_m) + horizon_distance_m(view.relief_m);
    let usable = shape.half() - MORPH_LAG_POSTS;
    let narrow = view.latitude_deg.to_radians().cos().max(0.02);
    let coarsest = (finest..last)
        .find(|&l| spacing_m(l) * usable * narrow >= horizon_m)
        .unwrap_or(last);
    (finest, coarsest)
}

/// Distance to the horizon of a sphere from a height, metres: `sqrt(2 R h + h^2)`.
fn horizon_distance_m(height_m: f64) -> f64 {
    let h = height_m.max(0.0);
    (2.0 * MEAN_RADIUS_M * h + h * h).sqrt()
}

/// How a window blends into the next coarser level: not at all up to `start` posts (by the larger coordinate) from the
/// centre, and entirely from `end` posts on. Coordinates are cells from the window's origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Morph {
    /// Centre, cells east of the window's western edge.
    pub x: f64,
    /// Centre, cells north of the window's southern edge.
    pub y: f64,
    /// Where the blend begins.
    pub start: f64,
    /// Where it is complete; every point of the window's edge is farther than this.
    pub end: f64,
}

impl Morph {
    /// For a window and the eye's post position.
    #[must_use]
    pub fn new(shape: Shape, window: Window, x: f64, y: f64) -> Self {
        let half = shape.half();
        let near = |v: f64| v.clamp(half - MORPH_LAG_POSTS, half + MORPH_LAG_POSTS);
        let end = half - MORPH_LAG_POSTS - 1.0;
        Self {
            x: near(x - f64::from(window.i)),
            y: near(y - f64::from(window.j)),
            start: end - MORPH_SHARE * half,
            end,
        }
    }

    /// The blend at a vertex, 0 to 1, as the shader computes it.
    #[must_use]
    pub fn alpha(&self, x: i32, y: i32) -> f64 {
        let d = (f64::from(x) - self.x)
            .abs()
            .max((f64::from(y) - self.y).abs());
        ((d - self.start) / (self.end - self.start)).clamp(0.0, 1.0)
    }
}

/// A rectangle of cells, from the window's origin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CellRect {
    /// Westernmost cell.
    pub x0: i32,
    /// Southernmost cell.
    pub y0: i32,
    /// One past the easternmost cell.
    pub x1: i32,
    /// One past the northernmost cell.
    pub y1: i32,
}

/// The cells that a finer window covers in the next coarser one, if it lies strictly inside the part of it that is not
/// blended; `None` means the finer level must not be drawn with this one.
#[must_use]
pub fn hole(shape: Shape, coarse: Window, morph: &Morph, fine: Window) -> Option<CellRect> {
    let x0 = fine.i / 2 - coarse.i;
    let y0 = fine.j / 2 - coarse.j;
    let size = shape.cells() / 2;
    let rect = CellRect {
        x0,
        y0,
        x1: x0 + size,
        y1: y0 + size,
    };
    let clear = |near: i32, far: i32, centre: f64| {
        near > 0
            && far < shape.cells()
            && centre - f64::from(near) <= morph.start
            && f64::from(far) - centre <= morph.start
    };
    // Rows and columns are tested apart: the blend follows the larger of the two distances.
    (clear(rect.x0, rect.x1, morph.x) && clear(rect.y0, rect.y1, morph.y)).then_some(rect)
}

/// A rectangle of texels in a torus, and where its first texel stands in the rectangle of posts it came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TorusPart {
    /// First texel column.
    pub x: usize,
    /// First texel row.
    pub y: usize,
    /// Texels across.
    pub width: usize,
    /// Texels up.
    pub height: usize,
    /// Columns of the source rectangle to the west of this part.
    pub from_x: usize,
    /// Rows of the source rectangle to the south of this part.
    pub from_y: usize,
}

/// Cuts the rectangle of posts at (`i`, `j`), `width` x `height`, none larger than the torus, where it wraps: one to four
/// parts.
pub fn torus_parts(
    texels: usize,
    (i, j): (i32, i32),
    width: usize,
    height: usize,
) -> impl Iterator<Item = TorusPart> {
    let spans = |start: usize, length: usize| {
        let first = length.min(texels - start);
        [(start, 0, first), (0, first, length - first)]
    };
    let across = spans(torus_texel(texels, i), width);
    let up = spans(torus_texel(texels, j), height);
    up.into_iter().flat_map(move |(y, from_y, height)| {
        across.into_iter().filter_map(move |(x, from_x, width)| {
            (width > 0 && height > 0).then_some(TorusPart {
                x,
                y,
                width,
                height,
                from_x,
                from_y,
            })
        })
    })
}

/// The texel of a post coordinate in a torus of `texels`, a power of two.
#[must_use]
pub const fn torus_texel(texels: usize, post: i32) -> usize {
    // Two's complement: masking is the floored remainder for negative posts too.
    post.cast_unsigned() as usize & (texels - 1)
}

const _: () = assert!(
    LEVELS_MAX <= 16,
    "level numbers are shifted into 32-bit post numbers"
);

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const GRID: Grid = Grid {
        posts_per_degree: 1200,
    };

    fn shapes() -> impl Strategy<Value = Shape> {
        prop_oneof![
            Just(63),
            Just(127),
            Just(191),
            Just(255),
            Just(319),
            Just(447)
        ]
        .prop_map(|n| Shape::new(n).expect("a legal shape"))
    }

    proptest! {
        #[test]
        fn windows_are_even_and_centred(shape in shapes(), x in -3e5..3e5_f64, y in -1e5..1e5_f64) {
            let w = Window::around(shape, x, y, None);
            prop_assert_eq!((w.i % 2, w.j % 2), (0, 0));
            prop_assert!((f64::from(w.i) + shape.half() - x).abs() <= 1.0);
            prop_assert!((f64::from(w.j) + shape.half() - y).abs() <= 1.0);
            prop_assert_eq!(Window::around(shape, x + 0.4, y - 0.4, Some(w)), w, "no flutter");
        }

        #[test]
        fn a_window_nests_in_the_next_with_its_blend_complete_at_the_edge_and_nil_at_the_hole(
            shape in shapes(), x in -3e5..3e5_f64, y in -1e5..1e5_f64,
        ) {
            let fine = Window::around(shape, x, y, None);
            let coarse = Window::around(shape, x / 2.0, y / 2.0, None);
            let morph = Morph::new(shape, coarse, x / 2.0, y / 2.0);
            let hole = hole(shape, coarse, &morph, fine);
            prop_assert!(hole.is_some(), "centred windows always nest");
            let hole = hole.expect("just seen");
            for k in 0..=shape.cells() / 2 {
                for (x, y) in [
                    (hole.x0 + k, hole.y0), (hole.x0 + k, hole.y1),
                    (hole.x0, hole.y0 + k), (hole.x1, hole.y0 + k),
                ] {
                    prop_assert_eq!(morph.alpha(x, y).to_bits(), 0.0_f64.to_bits());
                }
            }
            let w = shape.cells();
            for k in 0..=w {
                for (x, y) in [(k, 0), (k, w), (0, k), (w, k)] {
                    prop_assert_eq!(morph.alpha(x, y).to_bits(), 1.0_f64.to_bits());
                }
            }
        }

        #[test]
        fn a_lagging_window_still_blends_completely_at_its_edge(
            shape in shapes(), lag_x in -200.0..200.0_f64, lag_y in -200.0..200.0_f64,
        ) {
            let w = Window { i: 0, j: 0 };
            let morph = Morph::new(shape, w, shape.half() + lag_x, shape.half() + lag_y);
            for k in 0..=shape.cells() {
                for (x, y) in [(k, 0), (k, shape.cells()), (0, k), (shape.cells(), k)] {
                    prop_assert_eq!(morph.alpha(x, y).to_bits(), 1.0_f64.to_bits());
                }
            }
        }

        #[test]
        fn torus_parts_address_every_post_once(
            i in -5000..5000_i32, j in -5000..5000_i32, width in 1..=128_usize, height in 1..=128_usize,
        ) {
            let mut seen = vec![false; 128 * 128];
            for part in torus_parts(128, (i, j), width, height) {
                for dy in 0..part.height {
                    for dx in 0..part.width {
                        let post = (
                            i + i32::try_from(part.from_x + dx).expect("small"),
                            j + i32::try_from(part.from_y + dy).expect("small"),
                        );
                        let (x, y) = (part.x + dx, part.y + dy);
                        prop_assert_eq!((post.0.rem_euclid(128), post.1.rem_euclid(128)),
                            (i32::try_from(x).expect("small"), i32::try_from(y).expect("small")));
                        prop_assert!(!seen[y * 128 + x]);
                        seen[y * 128 + x] = true;
                    }
                }
            }
            prop_assert_eq!(seen.iter().filter(|&&s| s).count(), width * height);
        }
    }

    #[test]
    fn rows_end_at_one_latitude_on_every_level() {
        for level in 0..8 {
            let row = row_limit(GRID, 8, level);
            assert_eq!(row, row_limit(GRID, 8, 7) << (7 - level), "level {level}");
            let latitude = GRID.latitude_deg(level, row);
            assert!((84.7..=85.0).contains(&latitude), "{latitude}");
        }
    }

    #[test]
    fn a_low_eye_wants_the_finest_level_and_a_high_one_reaches_its_horizon() {
        let shape = Shape::new(255).expect("a legal shape");
        let mut view = View {
            latitude_deg: 46.0,
            above_ground_m: 300.0,
            above_lowest_m: 1300.0,
            relief_m: 4500.0,
            focal_px: 887.0,
        };
        let (finest, coarsest) = wanted_levels(shape, GRID, 8, &view, 1.0);
        assert_eq!(finest, 0);
        // sqrt(2 R 1300) + sqrt(2 R 4500) = 129 + 239 km; level 5 spans 255 x 2.97 km / 2 x cos 46 = 253 km, 6 twice it.
        assert_eq!(coarsest, 6);
        view.above_ground_m = 300_000.0;
        view.above_lowest_m = 300_000.0;
        let (finest, coarsest) = wanted_levels(shape, GRID, 8, &view, 1.0);
        // A pixel of 300 km / 887 = 338 m: level 2's posts are 371 m apart, level 1's 185 m.
        assert_eq!((finest, coarsest), (2, 7));
    }
}
