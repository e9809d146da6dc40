//! The clipmap's geometry: how large a level is, where its window stands for an eye, which part of it is drawn, and how a
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

/// The eye may be this far from the centre of its window, in posts, before the window moves. Even rounding needs 1; the
/// half more keeps a hovering eye from moving it to and fro.
const CENTRING_POSTS: f64 = 1.5;

/// How far the centre of the blend may be from the window's centre, in posts, where all of the window is drawn. A window
/// that lags more than there is room blends around a point that has room instead of around the eye, so that its edge still meets the next
/// level exactly.
const MORPH_LAG_POSTS: f64 = 2.0;

/// Share of what is drawn on either side of the eye over which a level blends into the next coarser one, and the least
/// number of posts it takes.
const MORPH_SHARE: f64 = 0.15;
const BLEND_POSTS_MIN: f64 = 12.0;

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

/// What is drawn of a level: a square of cells inside the window that is resident.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extent {
    /// Its south-western post; even, like a window's.
    pub window: Window,
    /// Cells a side, an even number.
    pub cells: i32,
}

/// Sides of what is drawn grow and shrink by this many cells, so that blocks are not cut anew in every frame.
const EXTENT_STEP_CELLS: i32 = 4;

impl Extent {
    /// The part of a resident `window` that reaches `reach` posts around an eye, at most [`reach_max`], and a margin of one
    /// post at least. Returns it with the point it is around: the eye, or, where the window lags behind that, the nearest
    /// point that has room.
    #[must_use]
    pub fn around(
        shape: Shape,
        window: Window,
        reach: f64,
        (x, y): (f64, f64),
    ) -> (Self, (f64, f64)) {
        let room = shape.half() - reach - 1.0;
        let near = |v: f64, origin: i32| {
            let centre = f64::from(origin) + shape.half();
            v.clamp(centre - room, centre + room)
        };
        let (x, y) = (near(x, window.i), near(y, window.j));
        let half = reach + MORPH_LAG_POSTS + 1.0;
        #[expect(clippy::cast_possible_truncation, reason = "a few hundred cells")]
        let steps = (2.0 * half / f64::from(EXTENT_STEP_CELLS)).ceil() as i32;
        let cells = (steps * EXTENT_STEP_CELLS).min(shape.cells());
        let side = |v: f64, lowest: i32| {
            #[expect(
                clippy::cast_possible_truncation,
                reason = "a post number: the eye is on the Earth, and float casts saturate"
            )]
            let even = 2 * (0.5 * v - 0.25 * f64::from(cells)).round() as i32;
            even.clamp(lowest, lowest + shape.cells() - cells)
        };
        let window = Window {
            i: side(x, window.i),
            j: side(y, window.j),
        };
        (Self { window, cells }, (x, y))
    }
}

/// The farthest that a level can reach, posts: so that its blend is complete inside its window wherever that stands within
/// a post and a half of the eye.
#[must_use]
pub fn reach_max(shape: Shape) -> f64 {
    shape.half() - MORPH_LAG_POSTS - 1.0
}

/// Over how many posts a level that reaches `reach` posts blends into the next. A level that hardly reaches anywhere is
/// blended all over, so that it comes and goes unseen.
#[must_use]
pub fn blend_posts(shape: Shape, reach: f64) -> f64 {
    let least = (MORPH_SHARE * shape.half()).min(BLEND_POSTS_MIN);
    (MORPH_SHARE * (reach + MORPH_LAG_POSTS + 1.0)).max(least)
}

/// The least reach of a level on which one that reaches `finer` posts lies, posts.
#[must_use]
pub fn reach_under(shape: Shape, finer: f64) -> f64 {
    // Half of the finer one's widest extent, and what it and its centre may stand beside.
    let hole = (finer + MORPH_LAG_POSTS + 1.0 + f64::from(EXTENT_STEP_CELLS) / 2.0) / 2.0;
    let clear = hole + CENTRING_POSTS;
    let least = clear + blend_posts(shape, 0.0);
    least.max((clear + MORPH_SHARE * (MORPH_LAG_POSTS + 1.0)) / (1.0 - MORPH_SHARE))
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

/// How a level blends into the next coarser one: not at all up to `start` posts (by the larger coordinate) from the
/// centre, and entirely from `end` posts on. Coordinates are cells from the origin of what is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Morph {
    /// Centre, cells east of the western edge.
    pub x: f64,
    /// Centre, cells north of the southern edge.
    pub y: f64,
    /// Where the blend begins; below zero where it is everywhere.
    pub start: f64,
    /// Where it is complete; every point of the edge is farther than this.
    pub end: f64,
}

impl Morph {
    /// For what is drawn of a level, around the eye's post position. The blend is complete `reach` posts from there, all of
    /// which lie inside by more than a post.
    #[must_use]
    pub fn new(shape: Shape, extent: Extent, (x, y): (f64, f64), reach: f64) -> Self {
        Self {
            x: x - f64::from(extent.window.i),
            y: y - f64::from(extent.window.j),
            start: reach - blend_posts(shape, reach),
            end: reach,
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

/// The cells that a finer level covers in the next coarser one, if it lies strictly inside the part of it that is not
/// blended; `None` means the finer level must not be drawn with this one.
#[must_use]
pub fn hole(coarse: Extent, morph: &Morph, fine: Extent) -> Option<CellRect> {
    let x0 = fine.window.i / 2 - coarse.window.i;
    let y0 = fine.window.j / 2 - coarse.window.j;
    let size = fine.cells / 2;
    let rect = CellRect {
        x0,
        y0,
        x1: x0 + size,
        y1: y0 + size,
    };
    let clear = |near: i32, far: i32, centre: f64| {
        near > 0
            && far < coarse.cells
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

    fn blended_at_the_edge(extent: &Extent, morph: &Morph) -> Result<(), TestCaseError> {
        let w = extent.cells;
        for k in 0..=w {
            for (x, y) in [(k, 0), (k, w), (0, k), (w, k)] {
                prop_assert_eq!(morph.alpha(x, y).to_bits(), 1.0_f64.to_bits());
            }
        }
        Ok(())
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
        fn what_is_drawn_nests_in_the_next_with_its_blend_complete_at_the_edge_and_nil_at_the_hole(
            shape in shapes(), x in -3e5..3e5_f64, y in -1e5..1e5_f64, share in 0.0..1.0_f64,
            lag in (-1.5..1.5_f64, -1.5..1.5_f64),
        ) {
            let eye = |scale: f64| (x / scale, y / scale);
            let on = |scale: f64, reach: f64| {
                // A window that has not moved yet.
                let window = Window::around(shape, x / scale + lag.0, y / scale + lag.1, None);
                let window = Window::around(shape, x / scale, y / scale, Some(window));
                let (extent, around) = Extent::around(shape, window, reach, eye(scale));
                (window, extent, Morph::new(shape, extent, around, reach))
            };
            let fine_reach = share * reach_max(shape);
            let (_, fine, _) = on(1.0, fine_reach);
            for coarse_reach in [reach_under(shape, fine_reach), reach_max(shape)] {
                let (window, coarse, morph) = on(2.0, coarse_reach);
                let inside = |post: i32, origin: i32, cells: i32| (origin..=origin + cells).contains(&post);
                for post in [coarse.window.i, coarse.window.i + coarse.cells] {
                    prop_assert!(post % 2 == 0 && inside(post, window.i, shape.cells()));
                }
                let hole = hole(coarse, &morph, fine);
                prop_assert!(hole.is_some(), "they nest: {:?} {:?} {:?}", coarse, morph, fine);
                let hole = hole.expect("just seen");
                for k in 0..=fine.cells / 2 {
                    for (x, y) in [
                        (hole.x0 + k, hole.y0), (hole.x0 + k, hole.y1),
                        (hole.x0, hole.y0 + k), (hole.x1, hole.y0 + k),
                    ] {
                        prop_assert_eq!(morph.alpha(x, y).to_bits(), 0.0_f64.to_bits());
                    }
                }
                blended_at_the_edge(&coarse, &morph)?;
            }
        }

        #[test]
        fn a_lagging_window_still_blends_completely_at_the_edge(
            shape in shapes(), lag_x in -200.0..200.0_f64, lag_y in -200.0..200.0_f64, share in 0.0..1.0_f64,
        ) {
            let w = Window { i: 0, j: 0 };
            let reach = share * reach_max(shape);
            let eye = (shape.half() + lag_x, shape.half() + lag_y);
            let (extent, around) = Extent::around(shape, w, reach, eye);
            blended_at_the_edge(&extent, &Morph::new(shape, extent, around, reach))?;
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
}
