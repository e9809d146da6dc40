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
//! 1. **The whole source stands still.** It sends latitude and longitude, or pitch and roll of which one has been noisy or has
//!    moved by less than half a degree before, and two of these and all of its restless and calm parameters have repeated for 3 s, or,
//!    but for those two, have gone round in at most three values each for 6 s, as they do when several messages say the same with different rounding. All
//!    of them are frozen, and whatever else of it stands still.
//! 2. **Noise has ended.** A restless parameter that used to change direction twice a second or more, over 10 s of flight,
//!    has repeated for 4 s. (The longest repeat of pitch in a recorded flight of a Dynon `SkyView`, in steps of 0.1 degrees,
//!    is 3.2 s, of roll 2.6 s.)
//! 3. **A fine value repeats.** A restless or calm parameter whose smallest step so far is below a thousandth of its usual span (as
//!    floating-point values are, and whole tenths of a degree are not) has repeated for 10 s.
//!
//! The first new value ends it at once; of a whole source, for what has been said again since. Limits: a coarse parameter without noise (whole degrees) that stops alone is not
//! found, because smooth flight looks the same, nor is attitude that has never moved at all; nor is a coarse calm one that stops alone, nor anything below 15 m/s. A simulator
//! that is paused in flight is found: what it says does not move, and it says that it flies.

use crate::signal::Parameter as P;
use crate::time::Monotonic;
use std::time::Duration;

/// How fast the aircraft is to be, by its fastest good speed, m/s.
pub const FLYING_MPS: f64 = 15.0;
/// How long a whole source stands still.
pub const SOURCE_STILL: Duration = Duration::from_secs(3);
/// How long, if some of it goes round in a loop of at most three values each: the same said in several messages.
pub const LOOP_STILL: Duration = Duration::from_secs(6);
/// How long a noisy parameter repeats.
pub const NOISY_STILL: Duration = Duration::from_secs(4);
/// How long a fine parameter repeats.
pub const FINE_STILL: Duration = Duration::from_secs(10);
/// How often at least.
const REPEATS_MIN: u32 = 3;
/// Attitude in steps below this, half a degree, does not repeat as a whole in the air; in whole degrees it does.
const ATTITUDE_STEP: f64 = 0.0087;
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
        P::IndicatedAirspeed
        | P::CalibratedAirspeed
        | P::TrueAirspeed
        | P::GroundSpeed
        | P::PressureAltitude
        | P::BaroAltitude
        | P::AltitudeMsl
        | P::HeightEllipsoid => 0.05,
        P::VerticalSpeed => 0.02,
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
    /// The last values before this one, and since when there has been none but these: a source that says the same in two
    /// messages, rounded differently, goes round in such a loop when it stands still.
    before: [f64; 2],
    loop_since: Option<Monotonic>,
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
        let is_known = self.before.iter().any(|x| x.to_bits() == value.to_bits());
        if self.since.is_none() || !is_known {
            self.loop_since = Some(at);
        }
        if !is_known {
            self.before[1] = self.before[0];
            self.before[0] = self.value;
        } else if self.before[0].to_bits() == value.to_bits() {
            self.before[0] = self.value;
        } else {
            self.before[1] = self.value;
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

    /// Whether it stands still, or goes round in the same few values, as it does when its source stands still.
    fn stands(&self, flying_since: Monotonic, now: Monotonic) -> bool {
        let still = self.still(flying_since, now);
        let since = self.loop_since.map(|since| since.max(flying_since));
        still.is_some_and(|d| d >= SOURCE_STILL)
            || since.is_some_and(|since| now.since(since).is_some_and(|d| d >= LOOP_STILL))
    }

    /// Whether it stands still all by itself.
    fn frozen(&self, parameter: P, nature: Nature, still: Duration) -> bool {
        let fine = self.step > 0.0 && self.step < fine_step(parameter);
        let noisy = self.noisy && nature == Nature::Restless;
        (noisy && still >= NOISY_STILL) || (fine && still >= FINE_STILL)
    }
}

/// What is remembered of all parameters of one source.
#[derive(Clone, Debug)]
pub(super) struct Stillness {
    traces: [Trace; P::COUNT],
    frozen: [bool; P::COUNT],
    /// Whether all of it stood still, and when that was over.
    whole: bool,
    thawed_at: Option<Monotonic>,
}

impl Stillness {
    pub(super) fn new() -> Self {
        Self {
            traces: [Trace::default(); P::COUNT],
            frozen: [false; P::COUNT],
            whole: false,
            thawed_at: None,
        }
    }

    /// A value has come; a fault ends the memory of the one before it.
    pub(super) fn see(&mut self, parameter: P, value: Option<f64>, at: Monotonic) {
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
        let lively = |p: P| {
            let trace = &self.traces[p.index()];
            trace.noisy || (trace.step > 0.0 && trace.step < ATTITUDE_STEP)
        };
        let attitude = pair(P::Pitch, P::Roll) && (lively(P::Pitch) || lively(P::Roll));
        let telling = attitude || pair(P::Latitude, P::Longitude);
        // Loops are believed only beside something that does stand.
        let exact = |p: P| still(p).is_some_and(|d| d >= SOURCE_STILL);
        let stands =
            (exact(P::Pitch) && exact(P::Roll)) || (exact(P::Latitude) && exact(P::Longitude));
        let whole = telling
            && stands
            && P::ALL
                .iter()
                .filter(|p| watched(**p))
                .all(|p| self.traces[p.index()].stands(flying_since, now));
        if self.whole && !whole {
            self.thawed_at = Some(now);
        }
        self.whole = whole;
        for &p in P::ALL {
            let i = p.index();
            // What has not been said again since is as old as it was.
            let last = self.traces[i].last;
            let waits = self.frozen[i] && self.thawed_at.is_some_and(|thaw| last <= Some(thaw));
            self.frozen[i] = waits
                || match nature(p) {
                    // What may stand is as old as what may not, when its whole source stands.
                    Nature::Still => whole && fresh(p) && self.traces[i].stands(flying_since, now),
                    _ if !fresh(p) => false,
                    _ if whole => true,
                    nature => still(p).is_some_and(|d| self.traces[i].frozen(p, nature, d)),
                };
        }
    }

    /// Whether a parameter was found frozen.
    pub(super) const fn is_frozen(&self, parameter: P) -> bool {
        self.frozen[parameter.index()]
    }
}

#[cfg(test)]
mod tests;
