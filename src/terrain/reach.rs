//! How far around the eye each level is drawn, and with it which levels are: from a target for the error in pixels.
//!
//! *Rule.* A level gives way to the next coarser one where the coarser one's error, seen from there, is as large as the target:
//! at a distance of error x focal length / target. The distance is that through space: over ground that lies `h` below the
//! eye, a circle of `sqrt(distance^2 - h^2)` is left of it, and where nothing is left the level is not drawn at all. The
//! level ends earlier where its own cells would be narrower than a pixel, and where its window ends: then the number of
//! vertices decides and not the target.
//!
//! *Nothing pops.* The reach is a continuous function of the eye's position, and the blend follows it ([`Morph`]): a level
//! that comes or goes is blended all over at that moment. What it takes for the ground below the eye is therefore not the
//! ground of one point but the highest of all that lies within that distance, less the slope to it beyond
//! ([`envelope_m`]).
//!
//! *What a target promises.* The root of the mean square error of the picture's ground, in pixels of height, stays below it as
//! long as the windows are large enough, for ground as rough as the roughest measured ([`ERROR_SHARE`]) or as the pack
//! states; smoother ground stays farther below. Measured on the Andes from 1.5, 3 and 12 km above the ground with 447
//! vertices: a target of 0.5 gave 0.35, 0.30 and 0.47, a target of 1 gave 0.93, 0.81 and 0.95. It is no bound for a single point:
//! one in a hundred is three to four times, the worst of a picture ten times as far off. What
//! triangles differ from the bilinear surface of the finest posts by (0.25 pixels on the same ground, more within a few posts
//! of the eye) is there at any target.
//!
//! [`Morph`]: super::clipmap::Morph

use super::clipmap::{Shape, Window, reach_max, reach_under};
use super::grid::Grid;
use super::pack::PackInfo;
use super::partition::Partition;
use super::stream::Streamer;
use super::tables::HeightCode;
use crate::limits::LEVELS_MAX;
use std::ops::RangeInclusive;

/// Radius that turns latitude into metres to within 0.4 %: WGS 84's mean, (2a + b) / 3.
const MEAN_RADIUS_M: f64 = 6_371_008.8;

/// Errors of a level as pictures show them, for each metre between its posts. Measured with `glasswing measure` on the
/// steepest tile at hand, the Andes at 33 S 71 W (slopes of 30 degrees on average), as the RMS error of pictures with small windows, times
/// distance over focal length, where the level begins. The RMS error of the level as such is twice as large (0.057 to 0.072
/// on that tile, 0.015 to 0.03 on hills): most of what is seen is farther away, or drawn from finer levels.
pub const ERROR_SHARE: f64 = 0.03;

/// However coarse the target, a level that is drawn is drawn to this many posts around the eye, over flat ground.
const REACH_MIN_POSTS: f64 = 24.0;

/// A level is drawn as far as its cells are at least this wide, pixels.
const CELL_PIXELS_MIN: f64 = 1.0;

/// Heights below the eye count as nothing up to this share of the distance: over them the circle is as good as full.
const LOW_SHARE: f64 = 0.1;

/// How fast ground beyond a distance loses weight: metres a metre. Steep, so that a summit comes in over little way, and no
/// cliff, so that it comes in over some.
const ENVELOPE_SLOPE: f64 = 1.0;

/// A level is streamed before it is drawn: when it would be from this much nearer to the ground.
const AHEAD: f64 = 1.15;

/// The target at which a level can be drawn, pixels: finer is below what triangles differ by anyway, coarser is no picture.
pub const TARGET_PX: RangeInclusive<f64> = 0.05..=4.0;

/// What decides which levels a view wants.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// Grid latitude of the eye, degrees.
    pub latitude_deg: f64,
    /// Height of the eye above the ellipsoid, metres.
    pub eye_m: f64,
    /// Of the lowest and of the highest terrain of the pack above the ellipsoid, metres.
    pub ground_m: (f64, f64),
    /// Focal length, pixels.
    pub focal_px: f64,
    /// Root of the mean square error that is aimed at, pixels.
    pub target_px: f64,
}

/// How far levels reach.
#[derive(Clone, Copy, Debug)]
pub struct Reaches {
    /// Posts of each level, from the eye, by the larger coordinate; 0 for one that is not drawn.
    pub posts: [f64; LEVELS_MAX],
    /// Finest and coarsest level to draw.
    pub drawn: (u8, u8),
    /// The finest level to have at hand: finer than the finest drawn shortly before that one is.
    pub finest_streamed: u8,
}

/// Share of a level's RMS error that is the error of pictures of it: what [`ERROR_SHARE`] is of the largest on its tile.
const SEEN_SHARE: f64 = 0.42;

/// RMS error of each level as pictures show it, metres: that of rough ground, or what the pack states of it in any of its
/// partitions where that is more.
/// A pack's mean over plains and sea says nothing about its mountains, so less is not believed.
#[must_use]
pub fn errors_m(info: &PackInfo) -> [f64; LEVELS_MAX] {
    let mut level = 0;
    [(); LEVELS_MAX].map(|()| {
        let partitions = [Partition::Geographic, Partition::North, Partition::South];
        let stated = partitions.map(|partition| info.level_error(partition, level));
        let error_m = stated
            .iter()
            .flatten()
            .map(|error| SEEN_SHARE * f64::from(error.rms_m))
            .fold(rough_m(info.grid, level), f64::max);
        level += 1;
        error_m
    })
}

fn rough_m(grid: Grid, level: u8) -> f64 {
    ERROR_SHARE * spacing_m(grid, level)
}

fn spacing_m(grid: Grid, level: u8) -> f64 {
    grid.spacing_deg(level).to_radians() * MEAN_RADIUS_M
}

impl Reaches {
    /// For a view of `levels` levels. `errors_m`: of each level. `top_m`: the height of the highest ground that counts for a
    /// level within a distance in metres of the eye; see [`envelope_m`].
    #[must_use]
    pub fn of(
        shape: Shape,
        grid: Grid,
        levels: u8,
        errors_m: &[f64; LEVELS_MAX],
        view: &View,
        top_m: impl Fn(u8, f64) -> f64,
    ) -> Self {
        let last = levels.saturating_sub(1);
        let narrow = narrow(view.latitude_deg);
        let mut out = Self {
            posts: [0.0; LEVELS_MAX],
            drawn: (last, last),
            finest_streamed: last,
        };
        for level in (0..last).rev() {
            let at = usize::from(level);
            let spacing = spacing_m(grid, level);
            let within = errors_m[at + 1] * view.focal_px / view.target_px;
            let within = within
                .max(REACH_MIN_POSTS * spacing)
                .min(spacing * view.focal_px / CELL_PIXELS_MIN);
            let longest = reach_max(shape) * spacing * narrow;
            let reach_m = circle_m(within, longest, view, |m| top_m(level, m));
            if circle_m(AHEAD * within, longest, view, |m| top_m(level, m)) > 0.0 {
                out.finest_streamed = level;
            }
            out.posts[at] = (reach_m / spacing / narrow).min(reach_max(shape));
            if reach_m > 0.0 {
                out.drawn.0 = level;
            }
        }
        out.posts[usize::from(last)] = reach_max(shape);
        out.nest(shape);
        let horizon_m = horizon_distance_m(view.eye_m - view.ground_m.0)
            + horizon_distance_m(view.ground_m.1 - view.ground_m.0);
        let reaches = |l: &u8| {
            let posts = out.posts[usize::from(*l)] + 1.0;
            posts * spacing_m(grid, *l) * narrow >= horizon_m
        };
        out.drawn.1 = (out.drawn.0..last).find(reaches).unwrap_or(last);
        out
    }

    /// Lets every level reach far enough around the finer ones.
    fn nest(&mut self, shape: Shape) {
        for fine in usize::from(self.drawn.0)..LEVELS_MAX - 1 {
            let least = reach_under(shape, self.posts[fine]);
            self.posts[fine + 1] = self.posts[fine + 1].max(least);
        }
    }
}

/// Radius on the ground of what is within a distance of the eye, metres, where that is less than `longest`; or something
/// longer than that.
fn circle_m(within: f64, longest: f64, view: &View, top_m: impl Fn(f64) -> f64) -> f64 {
    let free = LOW_SHARE * within;
    let circle = |above_m: f64| {
        let above = (above_m - free).max(0.0);
        (within * within - above * above).max(0.0).sqrt()
    };
    // With most eyes it makes no difference how high the ground is.
    let least = circle(view.eye_m - view.ground_m.0);
    if least >= longest.min(circle(0.0)) {
        return least;
    }
    circle(view.eye_m - top_m(within))
}

/// How much narrower a cell is than it is high.
fn narrow(latitude_deg: f64) -> f64 {
    latitude_deg.to_radians().cos().max(0.02)
}

/// The highest ground around an eye at post position (`x`, `y`) of a resident level's `window`, metres above the ellipsoid: that within `radius_m`
/// counts as it is, and what is farther by less the farther it is. It changes by no more than the eye's way does.
#[must_use]
pub fn envelope_m(
    (streamer, heights, shape, grid): (&Streamer, HeightCode, Shape, Grid),
    (level, window): (u8, Window),
    (x, y): (f64, f64),
    radius_m: f64,
) -> f64 {
    let post_m = spacing_m(grid, level);
    let wide_m = post_m * narrow(y * grid.spacing_deg(level));
    // How far a square that begins at a post is beside the eye, metres.
    let beside = |v: f64, post: i32, post_m: f64| {
        let from = f64::from(post) - v;
        from.max(-from - f64::from(SQUARE)).max(0.0) * post_m
    };
    let mut top_m = f64::NEG_INFINITY;
    let mut south = window.j.div_euclid(SQUARE) * SQUARE;
    while south <= window.j + shape.cells() {
        let up = beside(y, south, post_m);
        let mut west = window.i.div_euclid(SQUARE) * SQUARE;
        while west <= window.i + shape.cells() {
            let away = up.max(beside(x, west, wide_m));
            let less = ENVELOPE_SLOPE * (away - radius_m).max(0.0);
            let codes = streamer.extremes(level, (west, south), (SQUARE - 1, SQUARE - 1));
            top_m = top_m.max(heights.decode(codes.1) - less);
            west += SQUARE;
        }
        south += SQUARE;
    }
    top_m
}

/// Side of the squares whose extremes the streamer keeps, posts.
const SQUARE: i32 = 16;

/// Distance to the horizon of a sphere from a height, metres: `sqrt(2 R h + h^2)`.
fn horizon_distance_m(height_m: f64) -> f64 {
    let h = height_m.max(0.0);
    (2.0 * MEAN_RADIUS_M * h + h * h).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const GRID: Grid = Grid {
        posts_per_degree: 1200,
    };

    fn view(eye_m: f64, target_px: f64) -> View {
        View {
            latitude_deg: 46.0,
            eye_m,
            ground_m: (-500.0, 4000.0),
            focal_px: 887.0,
            target_px,
        }
    }

    fn rough() -> [f64; LEVELS_MAX] {
        let mut level = 0;
        [(); LEVELS_MAX].map(|()| {
            level += 1;
            rough_m(GRID, level - 1)
        })
    }

    fn reaches(shape: Shape, view: &View, ground_m: f64) -> Reaches {
        Reaches::of(shape, GRID, 8, &rough(), view, |_, _| ground_m)
    }

    fn shape(vertices: u32) -> Shape {
        Shape::new(vertices).expect("a legal shape")
    }

    #[test]
    fn a_low_eye_wants_the_finest_level_and_a_high_one_reaches_its_horizon() {
        let low = reaches(shape(255), &view(800.0, 0.2), 500.0);
        assert_eq!(low.drawn.0, 0);
        // sqrt(2 R 1300) + sqrt(2 R 4500) = 129 + 239 km; level 5 spans 255 x 2.97 km / 2 x cos 46 = 253 km, 6 twice it.
        assert_eq!(low.drawn.1, 6);
        let high = |target_px| reaches(shape(255), &view(300_000.0, target_px), 500.0).drawn;
        // A pixel of 300 km / 887 = 338 m: level 2's posts are 371 m apart, level 1's 185 m.
        assert_eq!(high(0.05), (2, 7));
        // Level 4's error of 3 % of 1484 m is 0.2 pixels at 197 km, level 5's at 395 km.
        assert_eq!(high(0.2), (4, 7));
    }

    #[test]
    fn a_level_ends_where_the_error_of_the_next_one_is_the_target() {
        let (target_px, grid_m) = (0.5, GRID.spacing_deg(0).to_radians() * MEAN_RADIUS_M);
        let reach = reaches(shape(447), &view(0.0, target_px), 0.0).posts[0];
        let distance_m = reach * grid_m * 46_f64.to_radians().cos();
        let error_px = rough()[1] * 887.0 / distance_m;
        assert!((error_px - target_px).abs() < 1e-9, "{error_px}");
        // Twice the target, half the way; and never beyond the window.
        let coarse = reaches(shape(447), &view(0.0, 1.0), 0.0).posts[0];
        assert!((coarse * 2.0 - reach).abs() < 1e-9, "{coarse} {reach}");
        let fine = reaches(shape(127), &view(0.0, 0.1), 0.0).posts[0];
        assert!((fine - reach_max(shape(127))).abs() < 1e-9, "{fine}");
    }

    proptest! {
        #[test]
        fn a_reach_never_jumps_and_levels_nest(
            n in prop_oneof![Just(63), Just(127), Just(255), Just(447)],
            eye_m in -400.0..60_000.0_f64, ground_m in -500.0..4000.0_f64,
            target_px in TARGET_PX, focal_px in 80.0..30_000.0_f64, latitude_deg in -70.0..70.0_f64,
        ) {
            let at = |eye_m: f64| {
                let view = View { latitude_deg, focal_px, ..view(eye_m, target_px) };
                reaches(shape(n), &view, ground_m)
            };
            let (a, b) = (at(eye_m), at(eye_m + 0.01));
            for level in 0..8 {
                let (x, y) = (a.posts[level], b.posts[level]);
                prop_assert!((x - y).abs() < 0.15, "level {}: {} {}", level, x, y);
                prop_assert!(x <= reach_max(shape(n)) + 1e-9);
            }
            for level in usize::from(a.drawn.0) + 1..8 {
                let least = reach_under(shape(n), a.posts[level - 1]);
                prop_assert!(a.posts[level] >= least - 1e-9, "{:?}", a);
            }
            prop_assert!(a.finest_streamed <= a.drawn.0);
        }
    }
}
