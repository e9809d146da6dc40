//! How far the picture is from a perfect one: heights, distances, skyline and summits against rays cast in f64 through the
//! bilinear surface of the finest posts ([`crate::terrain::truth`]).
//!
//! - `surf_px`: at each pixel, the point that is drawn there; its height less the height of the surface at its latitude and
//!   longitude, times focal length over distance. Left out is what rests on posts that were never measured, and
//!   pixels of ground nearer than eight posts, where a cell is more than a hundred pixels wide and a triangle and a
//!   bilinear patch through the same posts differ by more than what is measured: those are kept apart (`near`), against the
//!   bilinear surface and against the triangles of the finest posts.
//!   `finest_px` is the same for all pixels against the triangles of the finest posts, with diagonals as drawn: what is left when nothing
//!   coarser is drawn and the choice of a triangle instead of a bilinear patch is taken away. Where the source's data ends
//!   within a cell or two of what is drawn, the cliff to the sea level beyond is in it: apart too (`edge`).
//! - `range_m`: distance drawn less distance cast, where both meet ground and their difference is no more than a hundredth of
//!   it (beyond that the two see different hills: counted as `other_hill`).
//! - `skyline_px`: in each column, the row of the highest pixel that shows ground, drawn less cast.
//! - `summits`: posts higher than all around them, in the picture and not hidden: how far the drawn surface lies below the
//!   data there, and how far it may by what the pack states of its levels.

use crate::app::error::Failure;
use crate::app::measure::bench::Bench;
use crate::app::measure::drawn::Points;
use crate::geo::{Camera, Geodetic};
use crate::limits::LEVELS_MAX;
use crate::terrain::pack::LevelError;
use crate::terrain::partition::Partition;
use crate::terrain::surface::TileSource;
use crate::terrain::truth::{Cast, Field};
use serde_json::{Value, json};

/// Nearer than this many posts, errors are kept apart.
pub const NEAR_POSTS: f64 = 8.0;
/// Summits nearer than this many posts are not asked for: a picture shows them as ground.
const SUMMIT_NEAR_POSTS: f64 = 3.0;
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
    /// The same nearer than [`NEAR_POSTS`].
    pub near_px: Spread,
    /// The same there against the triangles of the finest posts.
    pub near_finest_px: Spread,
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
    /// How far each summit in view is drawn too low, the largest in pixels first.
    pub summits: Vec<Summit>,
}

impl Surface {
    /// What is written of it.
    #[must_use]
    pub fn report(&self) -> Value {
        let sky = self.skyline_px;
        json!({
            "surf_px": self.surf_px.report(),
            "near_px": self.near_px.report(),
            "near_finest_px": self.near_finest_px.report(),
            "near_posts": NEAR_POSTS,
            "surf_finest_px": self.finest_px.report(),
            "surf_edge_px": self.edge_px.report(),
            "surf_worst": {"column": self.worst.0, "row": self.worst.1, "distance_m": self.worst.2},
            "range_m": self.range_m.report(),
            "other_hill_pixels": self.other_hill,
            "mismatch_pixels": self.mismatches,
            "skyline_px": {"mean": sky.rms, "p99": sky.p99, "max": sky.max, "columns": sky.count},
            "summits": self.summits_report(),
        })
    }
}

/// A summit in view.
#[derive(Clone, Copy, Debug)]
pub struct Summit {
    /// Its place and its height in the data.
    pub place: Geodetic,
    /// From the eye, metres.
    pub distance_m: f64,
    /// How far the drawn surface is below the data there, metres; negative above it.
    pub low_m: f64,
    /// The same in the picture, pixels.
    pub low_px: f64,
    /// How low the source says that it may be, metres.
    pub stated_low_m: Option<f64>,
}

impl Summit {
    /// Whether it is drawn lower than is stated; heights are drawn in steps of a quarter of a metre.
    fn is_too_low(&self) -> bool {
        self.stated_low_m
            .is_some_and(|stated_m| self.low_m > stated_m + 0.5)
    }
}

impl Surface {
    fn summits_report(&self) -> Value {
        let most = |of: fn(&Summit) -> f64| self.summits.iter().map(of).fold(0.0, f64::max);
        let row = |s: &Summit| {
            json!({
                "latitude": s.place.latitude.to_degrees(),
                "longitude": s.place.longitude.to_degrees(),
                "height_ellipsoid_m": s.place.height_ellipsoid.0,
                "distance_m": s.distance_m,
                "low_m": s.low_m,
                "low_px": s.low_px,
                "stated_low_m": s.stated_low_m,
            })
        };
        json!({
            "count": self.summits.len(),
            "low_m_max": most(|s| s.low_m),
            "low_px_max": most(|s| s.low_px),
            "low_px_rms": Spread::of(self.summits.iter().map(|s| s.low_px.max(0.0)).collect()).rms,
            "beyond_stated": self.summits.iter().filter(|s| s.is_too_low()).count(),
            "high_px_max": most(|s| -s.low_px),
            "worst": self.summits.iter().take(5).map(row).collect::<Vec<_>>(),
        })
    }
}

/// What a view should show.
#[derive(Debug)]
pub struct Truth {
    /// The ground around its eye.
    pub field: Field,
    /// What every pixel should show.
    cast: Vec<Cast>,
    /// By how much each level is lower than a summit at most, as the source states it, metres.
    stated_low_m: [Option<f64>; LEVELS_MAX],
}

impl Truth {
    /// Of a view of a source in a partition; rays are cast through the posts within `reach_m`.
    #[must_use]
    pub fn of<S: TileSource>(
        source: &S,
        partition: Partition,
        camera: &Camera,
        reach_m: f64,
    ) -> Self {
        let field = Field::load(source, partition, &camera.eye, reach_m);
        let errors = &source.info().level_errors.0[partition as usize];
        let low_m = |e: &Option<LevelError>| e.map(|e| f64::from(e.summit_low_m));
        Self {
            cast: cast_all(&field, camera),
            stated_low_m: errors.each_ref().map(low_m),
            field,
        }
    }

    /// How low a summit may be drawn by a level, which is between itself and the next coarser one.
    fn stated_low_m(&self, level: u8) -> Option<f64> {
        let at = usize::from(level);
        let own = *self.stated_low_m.get(at)?;
        let coarser = self.stated_low_m.get(at + 1).copied().flatten();
        Some(own?.max(coarser.unwrap_or(0.0)))
    }
}

/// Measures a settled view against what it should show.
///
/// # Errors
/// With what the GPU refuses.
pub fn measure(bench: &mut Bench, truth: &Truth, camera: &Camera) -> Result<Surface, Failure> {
    let drawn = bench.ranges(camera)?;
    let (field, cast) = (&truth.field, &truth.cast);
    let mut out = Surface::default();
    let half_cells = f64::from(bench.shape().cells()) / 2.0;
    heights(field, camera, half_cells, &drawn, &mut out);
    let (mut ranges, mut other, mut mismatches) = (Vec::new(), 0, 0);
    for (&d, &c) in drawn.iter().zip(cast) {
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
    out.skyline_px = skyline(camera, &drawn, cast);
    out.summits = summits(bench, truth, camera)?;
    Ok(out)
}

fn heights(field: &Field, camera: &Camera, half_cells: f64, drawn: &[f32], out: &mut Surface) {
    let eye = camera.eye.to_ecef();
    let f = camera.focal_px();
    let (spacing_m, width) = (field.spacing_m(), camera.width_px as usize);
    let (mut far, mut near, mut finest, mut edge) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut near_finest = Vec::new();
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
            near_finest.push(px(ground.triangle_m));
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
    out.near_finest_px = Spread::of(near_finest);
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

fn summits(bench: &mut Bench, truth: &Truth, camera: &Camera) -> Result<Vec<Summit>, Failure> {
    let field = &truth.field;
    let mut out = Vec::new();
    let eye = camera.eye.to_ecef();
    let to_eye = camera.eye_to_ecef().transpose();
    let near_m = SUMMIT_NEAR_POSTS * field.spacing_m();
    let mut points = Points::new(field.summits(SUMMIT.0, SUMMIT.1));
    let drawn = points.drawn(bench)?;
    for (at, drawn) in drawn.iter().enumerate() {
        let height_m = drawn.height_m;
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
        let low_m = data.height_ellipsoid.0 - height_m;
        out.push(Summit {
            stated_low_m: truth.stated_low_m(drawn.level),
            place: data,
            distance_m,
            low_m,
            low_px: low_m * camera.focal_px() / distance_m,
        });
    }
    out.sort_by(|a, b| b.low_px.total_cmp(&a.low_px));
    Ok(out)
}

#[expect(clippy::cast_precision_loss, reason = "counts of pixels")]
fn number(count: usize) -> f64 {
    count as f64
}
