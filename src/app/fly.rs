//! The frame loop: state in, picture out, once per frame, and the figures of a run.
//!
//! After the first frames nothing here allocates, blocks (but for the flip or the pacing timer) or prints. What goes wrong
//! in flight costs the smallest thing it can; only a screen that refuses to show pictures ends the loop.

use crate::app::cockpit::{Cockpit, Drawn};
use crate::app::error::{Failure, Kind};
use crate::app::figures::Histogram;
use crate::app::frames::{FrameRow, FrameWriter};
use crate::app::health::Pulse;
use crate::app::way::Ways;
use crate::heap;
use crate::screen::{Screen, ScreenError};
use crate::signal::Parameter;
use crate::state::{FlightState, attitude};
use crate::time::Monotonic;
use serde_json::{Value, json};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Frames after which the program counts as running: by then every buffer has been through its rotation.
const FRAMES_UNTIL_READY: u64 = 10;

/// Groups of parameters whose age at presentation is told, each by the parameter that stands for it.
const AGE_GROUPS: [(&str, Parameter); 4] = [
    ("attitude", Parameter::Pitch),
    ("airspeed_indicated", Parameter::IndicatedAirspeed),
    ("airspeed_calibrated", Parameter::CalibratedAirspeed),
    ("position", Parameter::Latitude),
];

/// Which frames are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Every {
    /// Every n-th.
    Nth(u64),
    /// The first after each such time.
    Time(Duration),
}

/// When a loop ends, how it paces itself and what it writes.
#[derive(Debug)]
pub struct Plan {
    /// Set by a signal handler or another thread: end after this frame.
    pub stop: Arc<AtomicBool>,
    /// End by itself after this long.
    pub duration: Option<Duration>,
    /// Time between frames on a headless screen; a real screen paces the loop by its flips.
    pub headless_period: Duration,
    /// Pictures to files, and which.
    pub frames: Option<(FrameWriter, Every)>,
    /// Fed with every flip.
    pub pulse: Arc<Pulse>,
    /// When the program started.
    pub started: Monotonic,
}

/// What a loop has measured.
#[derive(Debug)]
pub struct RunFigures {
    frames: u64,
    missed_flips: u64,
    frame_time: Histogram,
    own_time: Histogram,
    ages: [Histogram; AGE_GROUPS.len()],
    ways: Ways,
    triangles_max: u64,
    triangles_sum: u64,
    draw_calls_max: u32,
    upload_bytes_max: u64,
    upload_bytes_sum: u64,
    decoded_samples_max: u64,
    resident_bytes_max: u64,
    list_overflows: u64,
    first_frame: Option<Duration>,
    first_terrain: Option<Duration>,
    allocations_at_ready: Option<u64>,
    allocations_after_ready: Option<u64>,
    last: Drawn,
}

impl RunFigures {
    fn new() -> Self {
        Self {
            frames: 0,
            missed_flips: 0,
            frame_time: Histogram::new(),
            own_time: Histogram::new(),
            ages: std::array::from_fn(|_| Histogram::new()),
            ways: Ways::new(),
            triangles_max: 0,
            triangles_sum: 0,
            draw_calls_max: 0,
            upload_bytes_max: 0,
            upload_bytes_sum: 0,
            decoded_samples_max: 0,
            resident_bytes_max: 0,
            list_overflows: 0,
            first_frame: None,
            first_terrain: None,
            allocations_at_ready: None,
            allocations_after_ready: None,
            last: Drawn::default(),
        }
    }

    fn count(&mut self, drawn: Drawn) {
        self.frames += 1;
        self.triangles_max = self.triangles_max.max(drawn.triangles);
        self.triangles_sum += drawn.triangles;
        self.draw_calls_max = self.draw_calls_max.max(drawn.draw_calls);
        self.upload_bytes_max = self.upload_bytes_max.max(drawn.upload_bytes);
        self.upload_bytes_sum += drawn.upload_bytes;
        self.decoded_samples_max = self.decoded_samples_max.max(drawn.decoded_samples);
        self.resident_bytes_max = self.resident_bytes_max.max(drawn.resident_bytes);
        self.list_overflows += u64::from(drawn.list_overflowed);
        self.last = drawn;
    }

    /// How many frames were drawn.
    #[must_use]
    pub const fn frames(&self) -> u64 {
        self.frames
    }

    /// As JSON, with the keys of `run --stats`.
    #[must_use]
    pub fn to_json(&self) -> Value {
        let ms = |d: Option<Duration>| d.map(|d| d.as_secs_f64() * 1e3);
        let ages: serde_json::Map<String, Value> = AGE_GROUPS
            .iter()
            .zip(&self.ages)
            .map(|((name, _), ages)| ((*name).to_owned(), ages.to_json()))
            .collect();
        json!({
            "frames": self.frames,
            "missed_flips": self.missed_flips,
            "frame_ms": self.frame_time.to_json(),
            "own_cpu_ms": self.own_time.to_json(),
            "age_at_present_ms": ages,
            "receive_to_present_ms": self.ways.to_json(),
            "first_frame_ms": ms(self.first_frame),
            "first_terrain_ms": ms(self.first_terrain),
            "triangles": {
                "mean": self.triangles_sum.checked_div(self.frames),
                "max": self.triangles_max,
            },
            "draw_calls_max": self.draw_calls_max,
            "upload_bytes_max": self.upload_bytes_max,
            "upload_bytes": self.upload_bytes_sum,
            "decoded_samples_max": self.decoded_samples_max,
            "resident_bytes_max": self.resident_bytes_max,
            "display_list_overflows": self.list_overflows,
            "allocations_after_ready": self.allocations_after_ready,
        })
    }
}

/// Draws until told to stop. `state` gives the state at a time; `before_frame` may change the pilot's settings.
///
/// # Errors
/// When the screen refuses to show a picture, or frames cannot be written.
pub fn fly(
    screen: &mut dyn Screen,
    cockpit: &mut Cockpit,
    plan: Plan,
    mut before_frame: impl FnMut(&mut Cockpit),
    mut state: impl FnMut(Monotonic) -> FlightState,
) -> Result<RunFigures, Failure> {
    let Plan {
        stop,
        duration,
        headless_period,
        mut frames,
        pulse,
        started,
    } = plan;
    let mut figures = RunFigures::new();
    let mut lead = Lead::default();
    let loop_started = Monotonic::read();
    let end = duration.map(|d| loop_started.plus(d));
    let mut next = loop_started;
    let mut next_written = loop_started;
    while !stop.load(Ordering::Acquire) && end.is_none_or(|end| Monotonic::read() < end) {
        let now = Monotonic::read();
        before_frame(cockpit);
        let state = lead.apply(&state(now), now);
        let drawn = cockpit.draw(&state, now);
        if let Some((writer, every)) = &mut frames
            && is_due(*every, figures.frames, now, &mut next_written)
        {
            let row = FrameRow {
                number: figures.frames,
                now,
                state,
            };
            writer.write(row, |pixels| cockpit.read_rgba(pixels));
        }
        let flip = screen.present().map_err(|e| screen_failed(&e))?;
        pulse.flipped(flip.at);
        lead.learn(screen, now, flip.at);
        let presented = Monotonic::read();
        figures
            .frame_time
            .add(presented.since(now).unwrap_or_default());
        figures.own_time.add(drawn.own_time);
        figures.missed_flips += u64::from(flip.missed);
        for ((_, parameter), ages) in AGE_GROUPS.iter().zip(&mut figures.ages) {
            if let (Ok(_), Some(at)) = (state.read(*parameter, now), state.at(*parameter)) {
                ages.add(presented.since(at).unwrap_or_default());
            }
        }
        figures.ways.note(&state, now, presented);
        figures
            .first_frame
            .get_or_insert_with(|| presented.since(started).unwrap_or_default());
        if drawn.terrain_shown && figures.first_terrain.is_none() {
            figures.first_terrain = presented.since(started);
        }
        figures.count(drawn);
        if figures.frames == FRAMES_UNTIL_READY {
            figures.allocations_at_ready = Some(heap::allocations_of_this_thread());
        }
        if screen.is_headless() {
            figures.missed_flips += u64::from(pace(&mut next, headless_period));
        }
    }
    if let Some(at_ready) = figures.allocations_at_ready {
        figures.allocations_after_ready = Some(heap::allocations_of_this_thread() - at_ready);
    }
    if let Some((writer, _)) = frames {
        let left_out = writer.left_out;
        let written = writer.finish()?;
        tracing::info!("{written} frames written, {left_out} left out");
    }
    Ok(figures)
}

/// How long after its beginning a picture is seen: as long as the one before. Attitude is turned on by that much.
///
/// A headless screen shows pictures to nobody, at no time: they hold what was received, and can be held against it.
#[derive(Clone, Copy, Debug, Default)]
struct Lead(Option<Duration>);

impl Lead {
    fn apply(self, state: &FlightState, now: Monotonic) -> FlightState {
        match self.0 {
            Some(lead) => attitude::turned_on(state, now, now.plus(lead)),
            None => *state,
        }
    }

    fn learn(&mut self, screen: &dyn Screen, begun: Monotonic, seen: Monotonic) {
        self.0 = seen.since(begun).filter(|_| !screen.is_headless());
    }
}

/// Whether this frame is one to be written.
fn is_due(every: Every, number: u64, now: Monotonic, next: &mut Monotonic) -> bool {
    match every {
        Every::Nth(n) => number.is_multiple_of(n),
        Every::Time(period) => {
            let due = now >= *next;
            if due {
                *next = next.plus(period).max(now);
            }
            due
        }
    }
}

/// Waits for the next frame's time; true when that has passed already, and the schedule starts anew from now.
fn pace(next: &mut Monotonic, period: Duration) -> bool {
    *next = next.plus(period);
    let now = Monotonic::read();
    match next.since(now) {
        Some(wait) => {
            std::thread::sleep(wait);
            false
        }
        None => {
            *next = now;
            true
        }
    }
}

/// A screen's refusal as the user meets it.
#[must_use]
pub fn screen_failed(e: &ScreenError) -> Failure {
    Failure::new(Kind::Device, e.device(), e.why(), e.remedy())
}
