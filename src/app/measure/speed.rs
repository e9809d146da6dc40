//! `measure speed`: what a frame costs, and what it buys, for several sizes of level.
//!
//! - `frame_ms`: wall-clock time from planning to the last pixel, waited for (`glFinish`), at 1024 x 600 without
//!   multisampling, terrain alone.
//! - `cpu_ms`: CPU time of this thread while a frame is planned on its own, without a GPU: following the eye, streaming,
//!   levels, tables, culling.
//! - `process_ms`: CPU time of the whole process for each frame, driver and streaming threads included. With a software
//!   renderer that is the drawing too.
//!
//! Still: the eye stands. Moving: it flies along the view's heading at 100 m/s, 60 frames a second of flight.

use crate::app::error::Failure;
use crate::app::figures::Histogram;
use crate::app::measure::Progress;
use crate::app::measure::accuracy::{Scene, middle, mountains, scenes};
use crate::app::measure::bench::{Bench, QUOTA};
use crate::app::measure::surface::{self, Truth};
use crate::geo::Camera;
use crate::gl::Gpu;
use crate::gl::look::Look;
use crate::heap::allocations_of_this_thread;
use crate::terrain::clipmap::{Shape, TorusPart};
use crate::terrain::planet::{Kind, Planet};
use crate::terrain::scene::Settings;
use crate::terrain::stream::Sink;
use crate::terrain::surface::TileSource;
use crate::terrain::world::World;
use crate::time::Monotonic;
use rustix::time::{ClockId, clock_gettime};
use serde_json::{Value, json};
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

/// The sizes of level that are measured where none are asked for.
pub const VERTICES: [u32; 5] = [63, 127, 191, 255, 383];
/// Speed over ground of the moving eye, metres a second.
const SPEED_MPS: f64 = 100.0;

/// How much is measured.
#[derive(Clone, Debug)]
pub struct Effort {
    /// Frames of each run.
    pub frames: u32,
    /// How far from the eye rays are cast, metres.
    pub reach_m: f64,
    /// Views that are measured besides.
    pub views: Vec<Camera>,
}

/// CPU time of the process or the thread.
#[must_use]
pub fn cpu(clock: ClockId) -> Duration {
    let t = clock_gettime(clock);
    Duration::new(
        u64::try_from(t.tv_sec).unwrap_or(0),
        u32::try_from(t.tv_nsec).unwrap_or(0),
    )
}

/// The eye after some frames of flight.
fn moved(camera: &Camera, frame: u32, moving: bool) -> Camera {
    let mut out = *camera;
    if moving {
        let along = SPEED_MPS / 60.0 * f64::from(frame);
        let (sin, cos) = camera.attitude.heading_true.0.sin_cos();
        let metres = |v: f64| v / crate::geo::WGS84_B_M;
        out.eye.latitude.0 = (out.eye.latitude.0 + metres(along * cos)).clamp(-1.57, 1.57);
        out.eye.longitude.0 += metres(along * sin) / camera.eye.latitude.0.cos().max(1e-3);
    }
    out
}

/// Times of a run of frames.
struct Run {
    frame: Histogram,
    own: Histogram,
    process_ms: f64,
    allocations: u64,
    triangles: usize,
    draw_calls: usize,
}

/// Draws frames, timed.
fn draw(
    bench: &mut Bench,
    plan: &mut Planner,
    scene: &Scene,
    frames: u32,
    moving: bool,
) -> Result<Run, Failure> {
    bench.settle(&scene.camera)?;
    let (mut frame_times, mut triangles) = (Histogram::new(), 0);
    let mut one = |bench: &mut Bench, camera: &Camera| -> Result<Duration, Failure> {
        let begun = Monotonic::read();
        bench.bind(camera)?;
        bench.gpu.clear([0.0; 4]);
        triangles = triangles.max(bench.step(camera, QUOTA)?.triangles);
        bench.terrain.draw(&Look::FLIGHT);
        bench.gpu.finish();
        Ok(Monotonic::read().since(begun).unwrap_or_default())
    };
    for _ in 0..5 {
        one(bench, &scene.camera)?;
    }
    let (allocated, spent) = (allocations_of_this_thread(), cpu(ClockId::ProcessCPUTime));
    for frame in 0..frames {
        let time = one(bench, &moved(&scene.camera, frame, moving))?;
        frame_times.add(time);
        // At the pace of flight, so that streaming has the time it has in flight.
        std::thread::park_timeout(Duration::from_micros(16_667).saturating_sub(time));
    }
    let (allocated, spent) = (
        allocations_of_this_thread() - allocated,
        cpu(ClockId::ProcessCPUTime).saturating_sub(spent),
    );
    Ok(Run {
        frame: frame_times,
        own: plan.run(scene, frames, moving)?,
        process_ms: spent.as_secs_f64() * 1e3 / f64::from(frames),
        allocations: allocated / u64::from(frames),
        triangles,
        draw_calls: bench.terrain.draw_calls(),
    })
}

/// Plans frames as drawing does, with nothing to draw them: the program's own work.
struct Planner {
    world: World,
    nowhere: Vec<Nowhere>,
}

/// Takes uploads and forgets them.
#[derive(Clone, Copy, Debug)]
pub struct Nowhere;

impl Sink for Nowhere {
    fn write(&mut self, _: u8, _: TorusPart, _: &[[u16; 2]], _: &[[u8; 4]]) {}
}

impl Planner {
    fn new<S: TileSource>(source: &Arc<S>, settings: Settings) -> Result<Self, Failure> {
        let world = World::new(source, settings).map_err(Failure::no_thread)?;
        let nowhere = vec![Nowhere; world.scenes().len()];
        Ok(Self { world, nowhere })
    }

    /// CPU time of this thread for each frame, in units of wall-clock histograms.
    fn run(&mut self, scene: &Scene, frames: u32, moving: bool) -> Result<Histogram, Failure> {
        let refused = |e| Failure::new(crate::app::error::Kind::Other, "measure", e, "report this");
        loop {
            self.world
                .frame(&scene.camera, Monotonic::read(), QUOTA, &mut self.nowhere)
                .map_err(refused)?;
            if self.world.figures().settled {
                break;
            }
            std::thread::park_timeout(Duration::from_micros(300));
        }
        let mut times = Histogram::new();
        for frame in 0..frames {
            let camera = moved(&scene.camera, frame, moving);
            let before = cpu(ClockId::ThreadCPUTime);
            self.world
                .frame(&camera, Monotonic::read(), QUOTA, &mut self.nowhere)
                .map_err(refused)?;
            times.add(cpu(ClockId::ThreadCPUTime).saturating_sub(before));
            std::thread::park_timeout(Duration::from_millis(2));
        }
        Ok(times)
    }
}

/// Measures a source by some settings: for each scene a row for each, still and moving.
fn of_source<S: TileSource>(
    gpu: &Rc<Gpu>,
    source: &Arc<S>,
    middle: (f64, f64),
    settings: &[Settings],
    effort: &Effort,
    label: &str,
    progress: &Progress,
) -> Result<Vec<Value>, Failure> {
    let mut rows = Vec::new();
    let mut bench = Bench::new(gpu, source, Settings::default())?;
    let scenes = scenes(&mut bench, source.as_ref(), middle, &effort.views)?;
    drop(bench);
    let all = scenes.len() * settings.len();
    for scene in &scenes {
        // What it should show is the same for all settings, and takes longest.
        let mut truth = None;
        for &settings in settings {
            let name = format!(
                "{label}: {}, {} vertices",
                scene.name,
                settings.shape.vertices()
            );
            progress.at(&name, rows.len(), all);
            let mut bench = Bench::new(gpu, source, settings)?;
            bench.settle(&scene.camera)?;
            let partition = bench.partition().unwrap_or_default();
            let truth = truth.get_or_insert_with(|| {
                Truth::of(source.as_ref(), partition, &scene.camera, effort.reach_m)
            });
            let mut planner = Planner::new(source, settings)?;
            let surface = surface::measure(&mut bench, truth, &scene.camera)?;
            let mut row = row_of(&mut bench, &mut planner, scene, effort.frames)?;
            for (key, value) in surface.report().as_object().into_iter().flatten() {
                row[key] = value.clone();
            }
            row["name"] = json!(format!("{label}: {}", scene.name));
            row["vertices"] = json!(settings.shape.vertices());
            row["target_px"] = json!(settings.target_px);
            rows.push(row);
        }
    }
    Ok(rows)
}

/// What is timed of a scene, still and moving.
fn row_of(
    bench: &mut Bench,
    planner: &mut Planner,
    scene: &Scene,
    frames: u32,
) -> Result<Value, Failure> {
    let mut row = json!({});
    for (key, moving) in [("still", false), ("moving", true)] {
        let run = draw(bench, planner, scene, frames, moving)?;
        let part = json!({
            "frame_ms": run.frame.to_json(),
            "cpu_ms": run.own.to_json(),
            "process_ms": run.process_ms,
            "allocations_per_frame": run.allocations,
            "triangles": run.triangles,
            "draw_calls": run.draw_calls,
        });
        if !moving {
            for (name, value) in part.as_object().into_iter().flatten() {
                row[name] = value.clone();
            }
        }
        row[key] = part;
    }
    Ok(row)
}

/// Everything: the document of `measure speed`.
///
/// # Errors
/// When the GPU refuses, or a view does not settle.
pub fn run<S: TileSource>(
    gpu: &Rc<Gpu>,
    pack: Option<&Arc<S>>,
    shapes: &[Shape],
    target_px: f64,
    effort: &Effort,
    progress: &Progress,
) -> Result<Value, Failure> {
    let usual: Vec<Shape> = VERTICES.into_iter().filter_map(Shape::new).collect();
    let shapes = if shapes.is_empty() { &usual } else { shapes };
    let settings: Vec<Settings> = shapes
        .iter()
        .map(|&shape| Settings {
            target_px,
            ..Settings::from(shape)
        })
        .collect();
    let rows = if let Some(pack) = pack {
        let at = middle(pack.info());
        of_source(gpu, pack, at, &settings, effort, "pack", progress)?
    } else {
        let planet = Arc::new(Planet::new(Kind::Earth, 1200));
        let at = mountains(&planet);
        of_source(gpu, &planet, at, &settings, effort, "planet", progress)?
    };
    Ok(json!({
        "scenes": rows,
        "how": "frame_ms: wall clock from planning to glFinish, 1024x600, terrain alone, no multisampling; cpu_ms: CPU time \
                of the thread for planning a frame, without the driver; process_ms: CPU time of all threads for a frame, \
                driver included (with a software renderer, drawing too); triangles: drawn, with an area; moving: 100 m/s \
                along the heading, 60 frames a second; surf_px as in measure accuracy, still",
        "gpu": gpu.caps().renderer,
        "threads": std::thread::available_parallelism().map_or(1, usize::from),
    }))
}
