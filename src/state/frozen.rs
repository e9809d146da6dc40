//! Sensors that have stopped: values that repeat to the last bit while the aircraft flies and their frames keep coming.
//!
//! *Flying* is when any source gives a good, fresh ground speed of 15 m/s or more, or, where there is no ground speed, an
//! airspeed of as much. Only the time in flight counts; on the ground, parked, or with a simulator at rest nothing is ever
//! called frozen. Silence is not stillness: what gets no frames goes stale by its age, as everything does.
//!
//! *Restless* parameters never repeat for long in the air: pitch, roll, body and turn rates, accelerations, slip, airspeeds,
//! angles of attack and sideslip, a compensated variometer, latitude and longitude. *Calm* ones may: headings, heights, vertical and ground speed, track. A
//! parameter is frozen, with at least three repeats, when one of these holds:
//!
//! 1. **The whole source stands still.** It sends pitch and roll, or latitude and longitude, and all of its restless and calm
//!    parameters have repeated for 3 s. All of them are frozen.
//! 2. **Noise has ended.** A restless parameter that used to change direction twice a second or more, over 10 s of flight,
//!    has repeated for 4 s. (The longest repeat of pitch in a recorded flight of a Dynon `SkyView`, in steps of 0.1 degrees,
//!    is 3.2 s, of roll 2.6 s.)
//! 3. **A fine value repeats.** A restless parameter whose smallest step so far is below a thousandth of its usual span (as
//!    floating-point values are, and whole tenths of a degree are not) has repeated for 10 s.
//!
//! The first new value ends it at once. Limits: a coarse parameter without noise (whole degrees) that stops alone is not
//! found, because smooth flight looks the same; nor is a calm one that stops alone, nor anything below 15 m/s. A simulator
//! that is paused in flight is found: what it says does not move, and it says that it flies.

use crate::signal::Parameter as P;
use crate::time::Monotonic;
use std::time::Duration;

/// How fast the aircraft is to be, by its fastest good speed, m/s.
pub const FLYING_MPS: f64 = 15.0;
/// How long a whole source stands still.
pub const SOURCE_STILL: Duration = Duration::from_secs(3);
/// How long a noisy parameter repeats.
pub const NOISY_STILL: Duration = Duration::from_secs(4);
/// How long a fine parameter repeats.
pub const FINE_STILL: Duration = Duration::from_secs(10);
/// How often at least.
const REPEATS_MIN: u32 = 3;
/// Noise is looked for over this time of flight,
const NOISE_WINDOW: Duration = Duration::from_secs(10);
/// in which the value changes direction so often.
const NOISE_REVERSALS: u32 = 20;

/// How a parameter behaves in the air.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Nature {
    Restless,
    Calm,
    /// Settings, temperatures, engines, counts: they may stand for hours.
    Still,
}

const fn nature(parameter: P) -> Nature {
    match parameter {
        P::Pitch
        | P::Roll
        | P::RollRate
        | P::PitchRate
        | P::YawRate
        | P::LongitudinalAcceleration
        | P::LateralAcceleration
        | P::NormalAcceleration
        | P::TurnRate
        | P::SlipBall
        | P::TotalEnergyVerticalSpeed
        | P::Sideslip
        | P::AngleOfAttack
        | P::IndicatedAirspeed
        | P::CalibratedAirspeed
        | P::TrueAirspeed
        | P::Latitude
        | P::Longitude => Nature::Restless,
        P::HeadingTrue
        | P::HeadingMagnetic
        | P::PressureAltitude
        | P::BaroAltitude
        | P::VerticalSpeed
        | P::AltitudeMsl
        | P::HeightEllipsoid
        | P::GroundSpeed
        | P::Track
        | P::TrackMagnetic => Nature::Calm,
        _ => Nature::Still,
    }
}

/// Steps smaller than this are fine: a thousandth of what the parameter usually spans in a light aircraft.
const fn fine_step(parameter: P) -> f64 {
    match parameter {
        // Of 50 m/s.
        P::IndicatedAirspeed | P::CalibratedAirspeed | P::TrueAirspeed => 0.05,
        // Of 1 rad, 1 rad/s and 1 g. A thousandth of a radian is 6 km on the ground: any position is fine.
        _ => 0.001,
    }
}

/// What is remembered of one parameter of one source.
#[derive(Clone, Copy, Debug, Default)]
struct Trace {
    value: f64,
    /// Since when it repeats; `None` before the first value, and after a fault.
    since: Option<Monotonic>,
    last: Option<Monotonic>,
    repeats: u32,
    /// The smallest step so far; zero before the first.
    step: f64,
    rising: bool,
    /// The window in which changes of direction are counted.
    window: Option<Monotonic>,
    reversals: u32,
    noisy: bool,
}

impl Trace {
    fn see(&mut self, value: f64, at: Monotonic) {
        self.last = Some(at);
        if self.since.is_some() && value.to_bits() == self.value.to_bits() {
            self.repeats = self.repeats.saturating_add(1);
            return;
        }
        if self.since.is_some() {
            let step = (value - self.value).abs();
            if self.step <= 0.0 || step < self.step {
                self.step = step;
            }
            let rising = value > self.value;
            self.reversals += u32::from(rising != self.rising);
            self.rising = rising;
        }
        let window = *self.window.get_or_insert(at);
        if at.since(window).is_none_or(|d| d >= NOISE_WINDOW) {
            self.noisy = self.reversals >= NOISE_REVERSALS;
            self.window = Some(at);
            self.reversals = 0;
        }
        (self.value, self.since, self.repeats) = (value, Some(at), 0);
    }

    /// How long it has repeated in flight.
    fn still(&self, flying_since: Monotonic, now: Monotonic) -> Option<Duration> {
        let since = self.since?.max(flying_since);
        (self.repeats >= REPEATS_MIN)
            .then(|| now.since(since))
            .flatten()
    }

    /// Whether it stands still all by itself.
    fn frozen(&self, parameter: P, still: Duration) -> bool {
        let fine = self.step > 0.0 && self.step < fine_step(parameter);
        (self.noisy && still >= NOISY_STILL) || (fine && still >= FINE_STILL)
    }
}

/// What is remembered of all parameters of one source.
#[derive(Clone, Debug)]
pub(super) struct Stillness {
    traces: [Trace; P::COUNT],
    frozen: [bool; P::COUNT],
}

impl Stillness {
    pub(super) fn new() -> Self {
        Self {
            traces: [Trace::default(); P::COUNT],
            frozen: [false; P::COUNT],
        }
    }

    /// A value has come; a fault ends the memory of the one before it.
    pub(super) fn see(&mut self, parameter: P, value: Option<f64>, at: Monotonic) {
        if nature(parameter) == Nature::Still {
            return;
        }
        let i = parameter.index();
        match value {
            Some(value) => self.traces[i].see(value, at),
            None => self.traces[i].since = None,
        }
        // What moves is believed at once.
        if self.traces[i].repeats == 0 {
            self.frozen[i] = false;
        }
    }

    /// Judges at `now`, in flight since `flying_since`.
    pub(super) fn judge(&mut self, flying_since: Option<Monotonic>, now: Monotonic) {
        let Some(flying_since) = flying_since else {
            self.frozen = [false; P::COUNT];
            return;
        };
        let fresh = |p: P| {
            let last = self.traces[p.index()].last;
            last.is_some_and(|at| now.since(at).is_some_and(|age| age <= p.spec().age_max))
        };
        let watched = |p: P| nature(p) != Nature::Still && fresh(p);
        let still = |p: P| self.traces[p.index()].still(flying_since, now);
        let pair = |a: P, b: P| watched(a) && watched(b);
        let telling = pair(P::Pitch, P::Roll) || pair(P::Latitude, P::Longitude);
        let whole = telling
            && P::ALL
                .iter()
                .filter(|p| watched(**p))
                .all(|p| still(*p).is_some_and(|d| d >= SOURCE_STILL));
        for &p in P::ALL {
            let i = p.index();
            self.frozen[i] = watched(p)
                && (whole
                    || (nature(p) == Nature::Restless
                        && still(p).is_some_and(|d| self.traces[i].frozen(p, d))));
        }
    }

    /// Whether a parameter was found frozen.
    pub(super) const fn is_frozen(&self, parameter: P) -> bool {
        self.frozen[parameter.index()]
    }
}

#[cfg(test)]
mod tests;
