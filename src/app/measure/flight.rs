//! Flights: what a watcher would see go wrong while the eye moves. Frames are 1/30 s apart, streamed with the quota of flight.
//!
//! Points of the ground are fixed: a lattice around the path. In every frame the triangles that the vertex shader puts out
//! ([`super::drawn`]) say where the surface is drawn at each of them.
//!
//! - *Pop*: the change of the drawn height since the last frame, times focal length over the distance, is what a watcher
//!   sees move beside the perspective. The largest change over all frames and all points in the picture counts, whether
//!   something stands before them or not.
//! - *Swim*: how far a point is drawn beside its true vertical, times focal length over the distance. The height is left
//!   out: how that may be wrong is what levels of detail trade, and its changes are pops.
//! - *Holes*: as in [`super::watertight`], in every frame, at the size of the picture.
//! - *Late* is a frame in which the finest wanted level is not drawn yet.

use crate::app::error::Failure;
use crate::app::measure::bench::{Bench, QUOTA};
use crate::app::measure::drawn::{Drawn, Points};
use crate::app::measure::sheet::Sheet;
use crate::app::measure::watertight::holes;
use crate::geo::{Camera, Geodetic, WGS84_B_M};
use crate::terrain::truth::Field;
use crate::time::Monotonic;
use serde_json::{Value, json};
use std::time::Duration;

/// Frames a second: the slowest that is flown, whose frames differ most.
pub const RATE_HZ: f64 = 30.0;

/// Frames before the first one of a flight at most: half a minute.
const RESTS_MAX: u32 = 900;

/// A straight flight at a steady height over the ground.
#[derive(Clone, Copy, Debug)]
pub struct Path {
    /// Latitude and longitude at the start, degrees.
    pub from_deg: (f64, f64),
    /// True heading, degrees.
    pub heading_deg: f64,
    /// Speed over ground, metres a second.
    pub speed_mps: f64,
    /// Height above the ground, smoothed over a kilometre, metres.
    pub above_m: f64,
    /// Size of the picture and horizontal field of view in degrees.
    pub view: ((u32, u32), f64),
}

impl Path {
    /// Where the path is over the ground after a distance in metres; at height 0.
    #[must_use]
    pub fn point(&self, along_m: f64) -> Geodetic {
        let (sin, cos) = self.heading_deg.to_radians().sin_cos();
        let degrees = along_m / WGS84_B_M.to_radians();
        let lat = self.from_deg.0 + degrees * cos;
        let lon = self.from_deg.1 + degrees * sin / lat.to_radians().cos().max(0.01);
        Geodetic::from_degrees(lat, lon, 0.0)
    }

    /// The view of a frame.
    #[must_use]
    pub fn camera(&self, field: &Field, frame: u32) -> Camera {
        let along_m = self.speed_mps * f64::from(frame) / RATE_HZ;
        let at = self.point(along_m);
        // The mean of the ground half a kilometre back and ahead, but never nearer to the ground below than half the height.
        let ground = |d: f64| {
            field
                .ground(&self.point(along_m + d))
                .map_or(0.0, |g| g.height_m)
        };
        let steps = 20;
        let mean = (-steps..=steps)
            .map(|k| ground(25.0 * f64::from(k)))
            .sum::<f64>()
            / f64::from(2 * steps + 1);
        let clear = (-4..=8)
            .map(|k| ground(25.0 * f64::from(k)))
            .fold(f64::MIN, f64::max)
            + self.above_m / 2.0;
        let height = (mean + self.above_m).max(clear);
        super::bench::camera(
            (at.latitude.to_degrees(), at.longitude.to_degrees(), height),
            (self.heading_deg, -3.0, 0.0),
            self.view.1,
            self.view.0,
        )
    }

    /// Points of the ground around the path, every `step_m`, out to `reach_m` beside and before it.
    fn ground(&self, field: &Field, seconds: f64, step_m: f64, reach_m: f64) -> Vec<Geodetic> {
        let middle = self.point(self.speed_mps * seconds / 2.0);
        let reach_m = reach_m + self.speed_mps * seconds / 2.0;
        let degree_m = WGS84_B_M.to_radians();
        let narrow = middle.latitude.0.cos().max(0.02);
        let mut points = Vec::new();
        let mut north = -reach_m;
        while north <= reach_m {
            let mut east = -reach_m;
            while east <= reach_m {
                let lat = middle.latitude.to_degrees() + north / degree_m;
                let lon = middle.longitude.to_degrees() + east / degree_m / narrow;
                let mut point = Geodetic::from_degrees(lat, lon, 0.0);
                if let Some(ground) = field.ground(&point) {
                    point.height_ellipsoid.0 = ground.height_m;
                    points.push(point);
                }
                east += step_m;
            }
            north += step_m;
        }
        points
    }
}

/// What was seen along a path.
#[derive(Clone, Debug, Default)]
pub struct Flown {
    /// Largest change of height a frame, pixels.
    pub pop_px_max: f64,
    /// 99.9 of a hundred points and frames changed no more, pixels.
    pub pop_px_p999: f64,
    /// Frame and distance in metres of the largest.
    pub at: (u32, f64),
    /// Farthest beside its true place that a point was drawn, pixels.
    pub swim_px_max: f64,
    /// Frames with a hole.
    pub holes: u32,
    /// Frames in which the finest wanted level was not drawn.
    pub late: u32,
    /// Frames looked at.
    pub frames: u32,
    /// Points of the ground.
    pub points: usize,
    /// How often a partition gave way to another.
    pub seams: u32,
    /// Frames that showed two partitions.
    pub fading: u32,
    /// Most draw calls and triangles of a frame.
    pub most: (usize, usize),
}

impl Flown {
    /// What is written of it.
    #[must_use]
    pub fn report(&self, name: &str) -> Value {
        json!({
            "path": name,
            "px_max": self.pop_px_max,
            "px_p999": self.pop_px_p999,
            "worst": {"frame": self.at.0, "distance_m": self.at.1},
            "swim_px_max": self.swim_px_max,
            "holes": self.holes,
            "late_frames": self.late,
            "frames": self.frames,
            "points": self.points,
            "seams": self.seams,
            "fading_frames": self.fading,
            "draw_calls_max": self.most.0,
            "triangles_max": self.most.1,
        })
    }

    /// Takes a frame in: where points were drawn in the last one and in this one.
    fn compare(
        &mut self,
        points: &Points,
        camera: &Camera,
        last: &[Drawn],
        now: &[Drawn],
    ) -> Vec<f64> {
        let eye = camera.eye.to_ecef();
        let to_eye = camera.eye_to_ecef().transpose();
        let mut pops = Vec::new();
        for (at, (a, b)) in last.iter().zip(now).enumerate() {
            let Some(distance_m) = points.seen(at, eye, camera, &to_eye) else {
                continue;
            };
            if b.height_m.is_nan() {
                continue;
            }
            let px = camera.focal_px() / distance_m;
            self.swim_px_max = self.swim_px_max.max(points.beside_m(at, eye, b) * px);
            let pop = (a.height_m - b.height_m).abs() * px;
            if pop.is_nan() {
                continue;
            }
            pops.push(pop);
            if pop > self.pop_px_max {
                (self.pop_px_max, self.at) = (pop, (self.frames, distance_m));
            }
        }
        pops
    }
}

/// A flight to be made.
#[derive(Debug)]
pub struct Flight<'a> {
    /// Where it leads.
    pub path: Path,
    /// The ground around it.
    pub field: &'a Field,
    /// How long it lasts, seconds.
    pub seconds: f64,
    /// The lowest terrain of the source, metres.
    pub lowest_m: f64,
}

/// Makes a flight. `sheet` is given frames for looking at; `done` is told how many frames of how many are flown.
///
/// # Errors
/// When the GPU refuses, or the first view does not settle.
pub fn fly(
    bench: &mut Bench,
    flight: &Flight<'_>,
    mut sheet: Option<&mut Sheet>,
    done: &mut dyn FnMut(u32, u32),
) -> Result<Flown, Failure> {
    let (field, path) = (flight.field, &flight.path);
    let mut points = Points::new(path.ground(field, flight.seconds, 300.0, 25_000.0));
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "some thousand frames"
    )]
    let frames = (flight.seconds * RATE_HZ) as u32;
    // Come from the south in steps that are no leaps: the partition is then the one that a flight would bring along.
    for steps in (0..5).rev() {
        let mut before = path.camera(field, 0);
        before.eye.latitude.0 -= (0.08 * f64::from(steps)).to_radians();
        before.eye.height_ellipsoid.0 += 9000.0 * f64::from(u8::from(steps > 0));
        bench.settle(&before)?;
    }
    // On the way here a flight would have had time to stream the grid beyond a seam, for which settling does not wait.
    for _ in 0..RESTS_MAX {
        bench.step(&path.camera(field, 0), QUOTA)?;
        if !bench.terrain.is_waiting() {
            break;
        }
        std::thread::park_timeout(Duration::from_secs_f64(1.0 / RATE_HZ));
    }
    let mut out = Flown {
        points: points.all().len(),
        ..Flown::default()
    };
    let (mut last, mut partition) = (points.drawn(bench)?, bench.partition());
    let mut pops: Vec<f64> = Vec::new();
    let mut now = Monotonic::read();
    for frame in 1..=frames {
        let begun = Monotonic::read();
        let camera = path.camera(field, frame);
        // A slow machine makes no longer steps: frames bear the time of the path.
        now = now.plus(Duration::from_secs_f64(1.0 / RATE_HZ));
        let figures = bench.step_at(&camera, now, QUOTA)?;
        out.frames += 1;
        out.fading += u32::from(bench.terrain.going().is_some());
        let most = (bench.terrain.draw_calls(), figures.triangles);
        out.most = (out.most.0.max(most.0), out.most.1.max(most.1));
        out.late += u32::from(figures.levels.map(|l| l.0) != Some(figures.levels_wanted.0));
        out.holes += u32::from(holes(bench, &camera, &figures, flight.lowest_m)? > 0);
        let drawn = points.drawn(bench)?;
        pops.extend(out.compare(&points, &camera, &last, &drawn));
        if let Some(sheet) = &mut sheet {
            sheet.offer(bench, &camera, frame, frames)?;
        }
        let drawn_in = bench.partition();
        out.seams += u32::from(drawn_in != partition);
        (last, partition) = (drawn, drawn_in);
        done(frame, frames);
        let spent = Monotonic::read().since(begun).unwrap_or_default();
        std::thread::park_timeout(Duration::from_secs_f64(1.0 / RATE_HZ).saturating_sub(spent));
    }
    out.pop_px_p999 = thousandth(&mut pops);
    Ok(out)
}

/// The thousandth from the top of sizes.
fn thousandth(sizes: &mut [f64]) -> f64 {
    sizes.sort_by(f64::total_cmp);
    let at = sizes.len().checked_sub(sizes.len() / 1000 + 1);
    at.and_then(|at| sizes.get(at)).copied().unwrap_or(0.0)
}
