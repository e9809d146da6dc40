//! `measure streaming`: whether terrain keeps up with an eye that flies, turns and leaps, from disks of every pace, and
//! what that costs a frame.
//!
//! Pictures of 640 x 360, terrain alone, 30 frames a second of flight. *Still*: the eye stands where the flight begins.
//! *Moving*: all frames of the flight, leaps included.

use crate::app::error::{Failure, Kind};
use crate::app::figures::Histogram;
use crate::app::measure::bench::{Bench, QUOTA};
use crate::app::measure::speed::{Nowhere, cpu};
use crate::app::measure::stream_flights::{self, LEAP_FRAMES, RATE_HZ, Route};
use crate::app::measure::throttle::{Pace, Stored, Throttled};
use crate::app::measure::{Progress, accuracy};
use crate::geo::Camera;
use crate::gl::Gpu;
use crate::gl::look::Look;
use crate::heap::allocations_of_this_thread;
use crate::terrain::budget::{Need, TEXEL_BYTES};
use crate::terrain::planet::{Kind as PlanetKind, Planet};
use crate::terrain::scene::{FrameFigures, Settings};
use crate::terrain::surface::TileSource;
use crate::terrain::world::World;
use crate::time::Monotonic;
use rustix::time::ClockId;
use serde_json::{Value, json};
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

/// How much is measured.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Seconds of each flight.
    pub seconds: f64,
    /// Hours of the flight without pictures; 0 for none.
    pub hours: f64,
}

/// Samples that may be decoded in a frame: the default of a board.
const DECODE_QUOTA: u32 = 131_072;

/// What a frame may cost.
#[derive(Clone, Copy, Debug)]
struct Quota {
    bytes: usize,
    samples: u32,
}

/// What was seen on a flight.
#[derive(Debug, Default)]
struct Flown {
    still: Histogram,
    moving: Histogram,
    still_cpu: Histogram,
    moving_cpu: Histogram,
    upload_bytes_max: usize,
    decoded_max: u32,
    dropped: u32,
    over_quota: u32,
    late: u32,
    frames: u32,
    refills: Vec<u32>,
    unsettled: u32,
    resident_bytes_max: usize,
    allocations: u64,
}

impl Flown {
    /// Takes a frame of flight in. `since`: frames since the eye leapt, while that has not settled.
    fn count(&mut self, figures: &FrameFigures, quota: Quota, since: &mut Option<u32>) {
        self.frames += 1;
        self.upload_bytes_max = self.upload_bytes_max.max(figures.uploads_bytes);
        self.decoded_max = self.decoded_max.max(figures.decoded_samples);
        self.dropped = figures.errands.dropped;
        let over = figures.uploads_texels > QUOTA
            || figures.uploads_bytes > quota.bytes
            || figures.decoded_samples > quota.samples;
        self.over_quota += u32::from(over);
        self.resident_bytes_max = self.resident_bytes_max.max(figures.resident_bytes);
        if let Some(frames) = since {
            *frames += 1;
            if figures.settled {
                self.refills.push(*frames);
                *since = None;
            }
        } else {
            let finest = figures.levels.map(|levels| levels.0);
            self.late += u32::from(finest != Some(figures.levels_wanted.0));
        }
    }

    fn report(&self, flight: &str, pace: &str, read: (u64, u64)) -> Value {
        json!({
            "flight": flight,
            "reader": pace,
            "frames": self.frames,
            "late_frames": self.late,
            "teleports": self.refills.len() + self.unsettled as usize,
            "teleport_frames": self.refills.iter().max(),
            "teleports_unsettled": self.unsettled,
            "over_quota_frames": self.over_quota,
            "upload_bytes_max": self.upload_bytes_max,
            "decoded_samples_max": self.decoded_max,
            "jobs_dropped": self.dropped,
            "resident_bytes_max": self.resident_bytes_max,
            "frame_ms": {"still": self.still.to_json(), "moving": self.moving.to_json()},
            "process_ms": {"still": self.still_cpu.to_json(), "moving": self.moving_cpu.to_json()},
            "allocations": self.allocations,
            "tiles_read": read.0,
            "bytes_read": read.1,
        })
    }
}

/// A frame of flight: planned, drawn and waited for.
fn frame(bench: &mut Bench, camera: &Camera, now: Monotonic) -> Result<FrameFigures, Failure> {
    bench.bind(camera)?;
    bench.gpu.clear([0.0; 4]);
    let figures = bench.step_at(camera, now, QUOTA)?;
    bench.terrain.draw(&Look::FLIGHT);
    bench.gpu.finish();
    Ok(figures)
}

/// Makes a flight.
fn fly(
    bench: &mut Bench,
    route: &Route,
    quota: Quota,
    done: &mut dyn FnMut(usize, usize),
) -> Result<Flown, Failure> {
    let mut out = Flown::default();
    let Some(first) = route.cameras.first() else {
        return Ok(out);
    };
    bench.settle(first)?;
    let period = Duration::from_secs_f64(1.0 / RATE_HZ);
    let still_frames = STILL_FRAMES.min(route.cameras.len());
    let still = (0..still_frames).map(|_| (first, false));
    let moving = route.cameras.iter().map(|camera| (camera, true));
    let mut since = None;
    let (mut now, mut number, mut allocated) = (Monotonic::read(), 0, 0);
    for (camera, moves) in still.chain(moving) {
        let (begun, spent) = (Monotonic::read(), cpu(ClockId::ProcessCPUTime));
        if moves && route.leaps.contains(&number) {
            out.unsettled += u32::from(since.is_some());
            since = Some(0);
        }
        // A slow machine makes no longer steps: frames bear the time of the flight.
        now = now.plus(period);
        let before = allocations_of_this_thread();
        let figures = frame(bench, camera, now)?;
        allocated += allocations_of_this_thread() - before;
        let time = Monotonic::read().since(begun).unwrap_or_default();
        let spent = cpu(ClockId::ProcessCPUTime).saturating_sub(spent);
        if moves {
            out.moving.add(time);
            out.moving_cpu.add(spent);
            // The frame far away is only there so that nothing is left of the place before.
            if !route.aways.contains(&number) {
                out.count(&figures, quota, &mut since);
            }
            number += 1;
            done(number, route.cameras.len());
        } else {
            out.still.add(time);
            out.still_cpu.add(spent);
        }
        std::thread::park_timeout(period.saturating_sub(time));
    }
    out.unsettled += u32::from(since.is_some());
    out.allocations = allocated;
    Ok(out)
}

/// Frames of a still eye before each flight, at most as many as it has itself.
const STILL_FRAMES: usize = 60;

/// Flies on without pictures, ten frames for each second of flight, as fast as that goes: what memory does.
fn long_flight<S: TileSource>(
    source: &Arc<S>,
    settings: Settings,
    route: impl Iterator<Item = Camera>,
) -> Result<Value, Failure> {
    let refused = |e| Failure::new(Kind::Other, "measure", e, "report this");
    let mut world = World::new(source, settings).map_err(Failure::no_thread)?;
    let mut nowhere = vec![Nowhere; world.scenes().len()];
    let (mut frames, mut late) = (0_u32, 0_u32);
    let mut memory = Vec::new();
    let mut allocated = 0;
    for camera in route {
        let before = allocations_of_this_thread();
        // A frame takes as long as streaming does: the flight is faster than the clock.
        for _ in 0..SETTLE_TRIES {
            world
                .frame(&camera, Monotonic::read(), QUOTA, &mut nowhere)
                .map_err(refused)?;
            if world.figures().settled {
                break;
            }
            std::thread::park_timeout(Duration::from_micros(300));
        }
        if frames >= 10 {
            allocated += allocations_of_this_thread() - before;
        }
        late += u32::from(!world.figures().settled);
        if frames.is_multiple_of(MEMORY_EVERY) {
            memory.extend(resident_bytes());
        }
        frames += 1;
    }
    memory.extend(resident_bytes());
    // The first looks are at a process that is still being set up.
    let settled = memory.get(1..).unwrap_or(&memory);
    Ok(json!({
        "frames": frames,
        "unsettled_frames": late,
        "allocations": allocated,
        "process_bytes": memory,
        "process_bytes_grown": settled.last().zip(settled.first()).map(|(last, first)| last.saturating_sub(*first)),
    }))
}

/// Looks at streaming until a frame of the long flight counts as late.
const SETTLE_TRIES: usize = 2000;
/// Frames of the long flight from one look at the process's memory to the next: five minutes.
const MEMORY_EVERY: u32 = 3000;

/// Memory of this process that is resident, bytes; `None` where the system does not say.
fn resident_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kib: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(kib * 1024)
}

/// All flights over a source.
fn of_source<S: Stored>(
    gpu: &Rc<Gpu>,
    source: &Arc<S>,
    middle: (f64, f64),
    settings: Settings,
    effort: Effort,
    progress: &Progress,
) -> Result<Value, Failure> {
    let mut rows = Vec::new();
    let settings = Settings {
        decode_samples_per_frame: DECODE_QUOTA,
        ..settings
    };
    let need = Need::of(source.info(), settings.shape);
    let quota = Quota {
        bytes: need.plan_bytes_max() + QUOTA * TEXEL_BYTES,
        samples: DECODE_QUOTA,
    };
    let routes = stream_flights::all(source.as_ref(), middle, effort.seconds);
    for route in &routes {
        for (pace_name, pace) in Pace::ALL {
            let throttled = Arc::new(Throttled::new(Arc::clone(source), pace));
            let mut bench = Bench::new(gpu, &throttled, settings)?;
            let name = format!("{}, {pace_name}", route.name);
            let flown = fly(&mut bench, route, quota, &mut |at, of| {
                progress.at(&name, at, of);
            })?;
            rows.push(flown.report(route.name, pace_name, throttled.read()));
        }
    }
    let mut document = summary(&rows, quota);
    document["flights"] = rows.into();
    if effort.hours > 0.0 {
        progress.say("a long flight without pictures");
        let route = stream_flights::to_and_fro(source.as_ref(), middle, effort.hours);
        document["long_flight"] = long_flight(source, settings, route)?;
        document["long_flight"]["hours"] = json!(effort.hours);
    }
    Ok(document)
}

/// The figures that stand for all flights.
fn summary(rows: &[Value], quota: Quota) -> Value {
    let of = |row: &Value, key: &str| row[key].as_u64().unwrap_or(0);
    let most = |key: &str| rows.iter().map(|row| of(row, key)).max();
    let sum = |key: &str| rows.iter().map(|row| of(row, key)).sum::<u64>();
    let free = |row: &&Value| row["reader"] == Pace::ALL[0].0;
    // The flight along the ground, the reader not held up: the figures of a frame that are compared.
    let plain = rows
        .iter()
        .find(free)
        .map_or(Value::Null, |row| row["frame_ms"].clone());
    json!({
        "quota_bytes": quota.bytes,
        "quota_texels": QUOTA,
        "quota_samples": quota.samples,
        "decoded_samples_max": most("decoded_samples_max"),
        "upload_bytes_max": most("upload_bytes_max"),
        "over_quota_frames": sum("over_quota_frames"),
        "teleport_frames": rows.iter().filter(free).map(|row| of(row, "teleport_frames")).max(),
        "teleports_unsettled": rows.iter().filter(free).map(|row| of(row, "teleports_unsettled")).sum::<u64>(),
        "late_frames": sum("late_frames"),
        "resident_bytes_max": most("resident_bytes_max"),
        "frame_ms": plain,
    })
}

/// Everything: the document of `measure streaming`.
///
/// # Errors
/// When the GPU refuses, or a view does not settle.
pub fn run<S: Stored>(
    gpu: &Rc<Gpu>,
    pack: Option<&Arc<S>>,
    settings: Settings,
    effort: Effort,
    progress: &Progress,
) -> Result<Value, Failure> {
    let mut document = if let Some(pack) = pack {
        let at = accuracy::middle(pack.info());
        of_source(gpu, pack, at, settings, effort, progress)?
    } else {
        let planet = Arc::new(Planet::new(PlanetKind::Earth, 1200));
        let at = accuracy::mountains(&planet);
        of_source(gpu, &planet, at, settings, effort, progress)?
    };
    document["how"] = json!(format!(
        "terrain alone, 640x360, no multisampling, {RATE_HZ} frames a second of flight, frames that take longer make the flight \
         slower; frame_ms: wall clock from planning to glFinish, at the top of the flight along the ground with a reader \
         that is not held up; process_ms: CPU time of all threads for a frame; late_frames: the finest wanted level is not \
         drawn, of all flights and readers, leaps left out until they have settled; teleport_frames: from the first frame in \
         a place of which nothing is resident, after a frame on the other side of the Earth, to the one in which every wanted \
         level is whole, the most of all leaps with a reader that is not held up, every {LEAP_FRAMES} frames; readers: see \
         each flight's; resident_bytes: everything that streaming holds, textures included; long_flight: 300 km/h at 100 m to \
         and fro, ten frames a second of flight, as fast as they go, process_bytes every five minutes of it"
    ));
    document["vertices"] = json!(settings.shape.vertices());
    document["target_px"] = json!(settings.target_px);
    document["gpu"] = json!(gpu.caps().renderer);
    document["threads"] = json!(std::thread::available_parallelism().map_or(1, usize::from));
    Ok(document)
}
