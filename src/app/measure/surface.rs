//! How far the picture is from a perfect one: heights, distances, skyline and summits against rays cast in f64 through the
//! bilinear surface of the finest posts ([`crate::terrain::truth`]).
//!
//! - `surf_px`: at each pixel, the point that is drawn there; its height less the height of the surface at its latitude and
//!   longitude, times focal length over distance. Pixels nearer than three posts are kept apart (`near`): there, a triangle
//!   and a bilinear patch through the same posts differ by more than what is measured. Left out is what rests on posts
//!   that were never measured.
//!   `finest_px` is the same against the triangles of the finest posts, with diagonals as drawn: what is left when nothing
//!   coarser is drawn and the choice of a triangle instead of a bilinear patch is taken away. Where the source's data ends
//!   within a cell or two of what is drawn, the cliff to the sea level beyond is in it: apart too (`edge`).
//! - `range_m`: distance drawn less distance cast, where both meet ground and their difference is no more than a hundredth of
//!   it (beyond that the two see different hills: counted as `other_hill`).
//! - `skyline_px`: in each column, the row of the highest pixel that shows ground, drawn less cast.
//! - `summits`: posts higher than all around them, in the picture and not hidden: how far the drawn surface lies below the
//!   data there.

use crate::app::error::Failure;
use crate::app::measure::bench::Bench;
use crate::app::measure::drawn::Points;
use crate::geo::{Camera, Geodetic};
use crate::terrain::truth::{Cast, Field};
use serde_json::{Value, json};

/// Nearer than this many posts, errors are kept apart.
const NEAR_POSTS: f64 = 3.0;
/// A post is a summit that rises by this much over the posts around it at this many posts.
const SUMMIT: (usize, f64) = (6, 40.0);

/// Root mean square, 99th percentile and greatest of some numbers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Spread {
    /// Root mean square.
    pub rms: f64,
    /// Ninety-nine of a hundred are not greater.
    pub p99: f64,
    /// The greatest.
    pub max: f64,
    /// How many there are.
    pub count: usize,
}

impl Spread {
    /// Of sizes, in any order.
    #[must_use]
    pub fn of(mut sizes: Vec<f64>) -> Self {
        sizes.sort_by(f64::total_cmp);
        let count = sizes.len();
        let squares: f64 = sizes.iter().map(|v| v * v).sum();
        Self {
            rms: (squares / number(count.max(1))).sqrt(),
            p99: sizes
                .get((count * 99 / 100).min(count.saturating_sub(1)))
                .copied()
                .unwrap_or(0.0),
            max: sizes.last().copied().unwrap_or(0.0),
            count,
        }
    }

    /// `{rms, p99, max, count}`.
    #[must_use]
    pub fn report(&self) -> Value {
        json!({"rms": self.rms, "p99": self.p99, "max": self.max, "count": self.count})
    }
}

/// What was measured of a view.
#[derive(Clone, Debug, Default)]
pub struct Surface {
    /// Errors of height, pixels.
    pub surf_px: Spread,
    /// The same nearer than three posts.
    pub near_px: Spread,
    /// The same against the triangles of the finest posts.
    pub finest_px: Spread,
    /// Errors of height where the data ends nearby.
    pub edge_px: Spread,
    /// Where the greatest of `surf_px` is: column and row, and distance in metres.
    pub worst: (usize, usize, f64),
    /// Errors of distance, metres.
    pub range_m: Spread,
    /// Pixels where drawn and cast see different hills.
    pub other_hill: usize,
    /// Pixels with ground where there should be sky, and the other way round.
    pub mismatches: usize,
    /// Errors of the skyline, pixels; `rms` holds the mean.
    pub skyline_px: Spread,
    /// Summits: how many, and how far the worst is drawn too low, metres and pixels.
    pub summits: usize,
    /// See `summits`.
    pub summit_low_m: f64,
    /// See `summits`.
    pub summit_low_px: f64,
}

impl Surface {
    /// What is written of it.
    #[must_use]
    pub fn report(&self) -> Value {
        let sky = self.skyline_px;
        json!({
            "surf_px": self.surf_px.report(),
            "surf_near_px": self.near_px.report(),
            "surf_finest_px": self.finest_px.report(),
            "surf_edge_px": self.edge_px.report(),
            "surf_worst": {"column": self.worst.0, "row": self.worst.1, "distance_m": self.worst.2},
            "range_m": self.range_m.report(),
            "other_hill_pixels": self.other_hill,
            "mismatch_pixels": self.mismatches,
            "skyline_px": {"mean": sky.rms, "p99": sky.p99, "max": sky.max, "columns": sky.count},
            "summits": {"count": self.summits, "low_m_max": self.summit_low_m, "low_px_max": self.summit_low_px},
        })
    }
}

/// Measures a settled view against the field around its eye.
///
/// # Errors
/// With what the GPU refuses.
pub fn measure(bench: &mut Bench, field: &Field, camera: &Camera) -> Result<Surface, Failure> {
    let drawn = bench.ranges(camera)?;
    let cast = cast_all(field, camera);
    let mut out = Surface::default();
    let half_cells = f64::from(bench.shape().cells()) / 2.0;
    heights(field, camera, half_cells, &drawn, &mut out);
    let (mut ranges, mut other, mut mismatches) = (Vec::new(), 0, 0);
    for (&d, &c) in drawn.iter().zip(&cast) {
        let d = f64::from(d);
        match c {
            Cast::Hit(t) if d.is_finite() => {
                if (d - t).abs() > 0.01 * t {
                    other += 1;
                } else {
                    ranges.push((d - t).abs());
                }
            }
            Cast::Hit(_) => mismatches += 1,
            Cast::Sky => mismatches += usize::from(d.is_finite()),
            Cast::Left => {}
        }
    }
    (out.range_m, out.other_hill, out.mismatches) = (Spread::of(ranges), other, mismatches);
    out.skyline_px = skyline(camera, &drawn, &cast);
    summits(bench, field, camera, &mut out)?;
    Ok(out)
}

fn heights(field: &Field, camera: &Camera, half_cells: f64, drawn: &[f32], out: &mut Surface) {
    let eye = camera.eye.to_ecef();
    let f = camera.focal_px();
    let (spacing_m, width) = (field.spacing_m(), camera.width_px as usize);
    let (mut far, mut near, mut finest, mut edge) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut worst = 0.0;
    for (at, &range) in drawn.iter().enumerate() {
        let range = f64::from(range);
        if !range.is_finite() {
            continue;
        }
        let hit = Geodetic::from_ecef(eye + ray(camera, at) * range);
        let Some(ground) = field.ground(&hit).filter(|g| g.measured) else {
            continue;
        };
        let px = |height_m: f64| (hit.height_ellipsoid.0 - height_m).abs() * f / range;
        let error_px = px(ground.height_m);
        // The cells drawn at this distance, in finest posts: a level reaches its half-width, the next one twice as far.
        let cell = 2.5 * range / spacing_m / half_cells + 2.0;
        if !field.measured_around(&hit, whole(cell)) {
            edge.push(error_px);
            continue;
        }
        finest.push(px(ground.triangle_m));
        if range < NEAR_POSTS * spacing_m {
            near.push(error_px);
            continue;
        }
        far.push(error_px);
        if error_px > worst {
            worst = error_px;
            out.worst = (at % width, at / width, range);
        }
    }
    (out.surf_px, out.near_px) = (Spread::of(far), Spread::of(near));
    (out.finest_px, out.edge_px) = (Spread::of(finest), Spread::of(edge));
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a few hundred posts"
)]
fn whole(v: f64) -> usize {
    v as usize
}

/// The direction through the centre of a pixel, Earth-centred.
#[expect(clippy::cast_precision_loss, reason = "pixels of a picture")]
fn ray(camera: &Camera, at: usize) -> glam::DVec3 {
    let width = camera.width_px as usize;
    camera.ray_ecef((at % width) as f64 + 0.5, (at / width) as f64 + 0.5)
}

/// What every pixel should show, on as many threads as there are cores.
#[must_use]
pub fn cast_all(field: &Field, camera: &Camera) -> Vec<Cast> {
    let eye = camera.eye.to_ecef();
    let mut out = vec![Cast::Left; camera.width_px as usize * camera.height_px as usize];
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let share = out.len().div_ceil(threads).max(1);
    std::thread::scope(|scope| {
        for (part, pixels) in out.chunks_mut(share).enumerate() {
            scope.spawn(move || {
                for (at, pixel) in pixels.iter_mut().enumerate() {
                    *pixel = field.cast(eye, ray(camera, part * share + at));
                }
            });
        }
    });
    out
}

fn skyline(camera: &Camera, drawn: &[f32], cast: &[Cast]) -> Spread {
    let (width, height) = (camera.width_px as usize, camera.height_px as usize);
    let mut errors = Vec::new();
    for x in 0..width {
        let column = || (0..height).map(|y| y * width + x);
        // A column in which a ray leaves the field says nothing.
        let top = column().position(|at| matches!(cast[at], Cast::Hit(_)));
        let known = column()
            .take(top.unwrap_or(height))
            .all(|at| cast[at] == Cast::Sky);
        let shown = column().position(|at| drawn[at].is_finite());
        if let (Some(top), Some(shown), true) = (top, shown, known) {
            errors.push(number(top.abs_diff(shown)));
        }
    }
    let mean = errors.iter().sum::<f64>() / number(errors.len().max(1));
    Spread {
        rms: mean,
        ..Spread::of(errors)
    }
}

fn summits(
    bench: &mut Bench,
    field: &Field,
    camera: &Camera,
    out: &mut Surface,
) -> Result<(), Failure> {
    let eye = camera.eye.to_ecef();
    let to_eye = camera.eye_to_ecef().transpose();
    let near_m = NEAR_POSTS * field.spacing_m();
    let mut points = Points::new(field.summits(SUMMIT.0, SUMMIT.1));
    let drawn = points.heights(bench)?;
    for (at, &height_m) in drawn.iter().enumerate() {
        let Some(distance_m) = points
            .seen(at, eye, camera, &to_eye)
            .filter(|d| *d > near_m)
        else {
            continue;
        };
        let data = points.all()[at];
        let direction = (data.to_ecef() - eye) / distance_m;
        let hidden = matches!(field.cast(eye, direction), Cast::Hit(t) if t < distance_m - 2.0 * field.spacing_m());
        if hidden || height_m.is_nan() {
            continue;
        }
        out.summits += 1;
        let low_m = data.height_ellipsoid.0 - height_m;
        out.summit_low_m = out.summit_low_m.max(low_m);
        out.summit_low_px = out
            .summit_low_px
            .max(low_m * camera.focal_px() / distance_m);
    }
    Ok(())
}

#[expect(clippy::cast_precision_loss, reason = "counts of pixels")]
fn number(count: usize) -> f64 {
    count as f64
}
