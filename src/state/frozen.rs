//! Sensors that have stopped: values that repeat to the last bit while the aircraft flies and their frames keep coming.
//!
//! *Flying* is when any source gives a good, fresh ground speed of 15 m/s or more, or, where there is no ground speed, an
//! airspeed of as much. Only the time in flight counts; on the ground, parked, or with a simulator at rest nothing is ever
//! called frozen. Silence is not stillness: what gets no frames goes stale by its age, as everything does.
//!
//! *Restless* parameters never repeat for long in the air: pitch, roll, body and turn rates, accelerations, slip, airspeeds,
//! angles of attack and sideslip, a compensated variometer, latitude and longitude. *Calm* ones may: headings, heights,
//! vertical and ground speed, track. A restless parameter is *alive* when over 10 s of flight it has changed direction twice a
//! second or more (the noise of a real sensor), or has hardly ever repeated in 50 values or more (a simulator's floating point).
//!
//! | what has stopped | found after | longest repeat in recorded flights |
//! |---|---|---|
//! | a whole source with four or more parameters alive: all of its restless and calm ones repeat | 1 s | 0.13 s (Dynon SkyView), 0.06 s (D100) |
//! | a whole source with two or three alive, pitch or roll among them; or a position, alive or not | 3 s | 0.9 s (SkyView, pitch and roll) |
//! | pitch and roll together, both alive | 2.5 s | 0.9 s (SkyView), 0.6 s (D100) |
//! | one parameter, alive by not repeating | 2 s | none: every value is new (JSBSim) |
//! | one parameter, alive by noise | 4 s | 3.2 s of pitch, 2.6 s of roll (SkyView, in tenths of a degree) |
//! | one restless or calm parameter in steps below a thousandth of its usual span | 10 s | |
//! | a whole source whose values go round in at most three each, as the same said in several messages does, rounded differently | 6 s | |
//! | the clock of a receiver, having ticked before: where it is and how it moves, in the air and on the ground | 3 s | 1 s |
//! | a calm parameter alone | when others show that it must have changed: `witness` | |
//! | attitude in whole degrees | when the turn does not belong to its bank: `crosscheck` | |
//! | a receiver's ground speed, track | when its positions go another way: `motion` | |
//! | wind, barometric setting | when they contradict what they belong to: `relation` | |
//!
//! With a whole source stands whatever else of it stands. All but the clock need three repeats as well, so that a slow source takes longer. The first new value ends it at once; of a
//! whole source, for what has been said again since.
//! Limits: in straight and level flight a coarse parameter without noise that stops alone is not found, because smooth flight
//! looks the same, and nothing but a clock below 15 m/s. A simulator that is paused in flight is found: what it says does not
//! move, and it says that it flies.

use super::witness::Standing;
use crate::signal::Parameter as P;
use crate::time::Monotonic;
use std::time::Duration;

/// How fast the aircraft is to be, by its fastest good speed, m/s.
pub const FLYING_MPS: f64 = 15.0;
/// How long a whole source stands still of which little is known to be alive.
pub const SOURCE_STILL: Duration = Duration::from_secs(3);
/// How long a whole source stands still that was alive all over.
pub const LIVELY_STILL: Duration = Duration::from_secs(1);
/// So many parameters make it that.
const LIVELY_MIN: usize = 4;
/// How long pitch and roll, both alive, stand still together.
pub const ATTITUDE_STILL: Duration = Duration::from_millis(2500);
/// How long a parameter repeats that never did.
pub const NEW_STILL: Duration = Duration::from_secs(2);
/// How long a clock stands still.
pub const CLOCK_STILL: Duration = Duration::from_secs(3);
/// How long, if some of it goes round in a loop of at most three values each: the same said in several messages.
pub const LOOP_STILL: Duration = Duration::from_secs(6);
/// How long a noisy parameter repeats.
pub const NOISY_STILL: Duration = Duration::from_secs(4);
/// How long a fine parameter repeats.
pub const FINE_STILL: Duration = Duration::from_secs(10);
/// What has been said within this time, or its greatest age, still stands: the slowest sources speak once a second.
pub(super) const LATELY: Duration = Duration::from_millis(2500);
/// How often at least.
const REPEATS_MIN: u32 = 3;
/// Noise is looked for over this time of flight,
const NOISE_WINDOW: Duration = Duration::from_secs(10);
/// in which the value changes direction so often,
const NOISE_REVERSALS: u32 = 20;
/// or repeats no more than once in so many values,
const NEW_PER_REPEAT: u32 = 50;
/// of which there are so many.
const NEW_VALUES_MIN: u32 = 50;

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

/// Whether a parameter that goes round in at most three values stands, for witnesses: several messages say it, rounded
/// differently.
const fn goes_round(parameter: P) -> bool {
    matches!(
        parameter,
        P::HeadingTrue
            | P::HeadingMagnetic
            | P::PressureAltitude
            | P::BaroAltitude
            | P::VerticalSpeed
            | P::AltitudeMsl
            | P::HeightEllipsoid
    )
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
    loop_values: u32,
    /// The smallest step so far; zero before the first.
    step: f64,
    rising: bool,
    /// The window in which changes of direction are counted.
    window: Option<Monotonic>,
    reversals: u32,
    values: u32,
    repeated: u32,
    noisy: bool,
    /// Whether it hardly ever repeats.
    new: bool,
}

impl Trace {
    fn see(&mut self, value: f64, at: Monotonic) {
        self.last = Some(at);
        self.values = self.values.saturating_add(1);
        self.loop_values = self.loop_values.saturating_add(1);
        if self.since.is_some() && value.to_bits() == self.value.to_bits() {
            self.repeats = self.repeats.saturating_add(1);
            self.repeated = self.repeated.saturating_add(1);
            return;
        }
        let is_known = self.before.iter().any(|x| x.to_bits() == value.to_bits());
        let stood = self.since.and_then(|since| at.since(since));
        // What stands for long before it changes does not go round.
        if !is_known || stood.is_none_or(|d| d > LATELY) {
            self.loop_since = Some(at);
            self.loop_values = 0;
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
            self.new = self.values >= NEW_VALUES_MIN
                && self.repeated.saturating_mul(NEW_PER_REPEAT) <= self.values;
            self.window = Some(at);
            (self.reversals, self.values, self.repeated) = (0, 0, 0);
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
    fn stands(&self, least: Duration, flying_since: Monotonic, now: Monotonic) -> bool {
        let still = self.still(flying_since, now);
        let since = self.loop_since.map(|since| since.max(flying_since));
        still.is_some_and(|d| d >= least)
            || since.is_some_and(|since| now.since(since).is_some_and(|d| d >= LOOP_STILL))
    }

    /// Whether it stands still all by itself.
    fn frozen(&self, parameter: P, nature: Nature, still: Duration) -> bool {
        let fine = self.step > 0.0 && self.step < fine_step(parameter);
        let restless = nature == Nature::Restless;
        (restless && self.noisy && still >= NOISY_STILL)
            || (restless && self.new && still >= NEW_STILL)
            || (fine && still >= FINE_STILL)
    }
}

/// What is remembered of all parameters of one source.
#[derive(Clone, Debug)]
pub(super) struct Stillness {
    traces: Vec<Trace>,
    frozen: [bool; P::COUNT],
    /// Whether all of it stood still, and when that was over.
    whole: bool,
    thawed_at: Option<Monotonic>,
}

impl Stillness {
    pub(super) fn new() -> Self {
        Self {
            traces: vec![Trace::default(); P::COUNT],
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
        let clock_stands = self.clock_stands(now);
        let Some(flying_since) = flying_since else {
            self.frozen = [false; P::COUNT];
            for &p in P::ALL {
                self.frozen[p.index()] = clock_stands && self.is_fresh(p, now);
            }
            return;
        };
        let watched = |p: P| nature(p) != Nature::Still && self.is_fresh(p, now);
        let still = |p: P, least: Duration| {
            let still = self.traces[p.index()].still(flying_since, now);
            still.is_some_and(|d| d >= least)
        };
        let alive = |p: P| {
            let trace = &self.traces[p.index()];
            nature(p) == Nature::Restless && watched(p) && (trace.noisy || trace.new)
        };
        let living = P::ALL.iter().filter(|p| alive(**p)).count();
        let has_attitude = watched(P::Pitch) && watched(P::Roll);
        let has_position = watched(P::Latitude) && watched(P::Longitude);
        let telling =
            has_position || (has_attitude && living >= 2 && (alive(P::Pitch) || alive(P::Roll)));
        let least = if living >= LIVELY_MIN {
            LIVELY_STILL
        } else {
            SOURCE_STILL
        };
        // Loops are believed only beside something that does stand.
        let pair = |a: P, b: P| still(a, least) && still(b, least);
        let anchored = pair(P::Pitch, P::Roll) || pair(P::Latitude, P::Longitude);
        let whole = clock_stands
            || (telling
                && anchored
                && P::ALL
                    .iter()
                    .filter(|p| watched(**p))
                    .all(|p| self.traces[p.index()].stands(least, flying_since, now)));
        let attitude = [P::Pitch, P::Roll];
        let attitude_stands = attitude
            .iter()
            .all(|p| alive(*p) && still(*p, ATTITUDE_STILL));
        let thawed_at = if self.whole && !whole {
            Some(now)
        } else {
            self.thawed_at
        };
        let mut frozen = [false; P::COUNT];
        for &p in P::ALL {
            let i = p.index();
            let trace = &self.traces[i];
            let stands = match nature(p) {
                // What may stand is as old as what may not, when its whole source stands.
                Nature::Still => whole && trace.stands(SOURCE_STILL, flying_since, now),
                nature => {
                    let still = trace.still(flying_since, now);
                    whole
                        || (attitude_stands && attitude.contains(&p))
                        || still.is_some_and(|d| trace.frozen(p, nature, d))
                }
            };
            // What has not been said again since its source moves is as old as it was.
            let waits = self.frozen[i] && thawed_at.is_some_and(|thaw| trace.last <= Some(thaw));
            frozen[i] = (stands || clock_stands || waits) && self.is_fresh(p, now);
        }
        self.frozen = frozen;
        (self.whole, self.thawed_at) = (whole, thawed_at);
    }

    fn is_fresh(&self, p: P, now: Monotonic) -> bool {
        let last = self.traces[p.index()].last;
        last.is_some_and(|at| now.since(at).is_some_and(|age| age <= p.spec().age_max))
    }

    /// Whether the source sends the same time of day again and again, having sent another before.
    fn clock_stands(&self, now: Monotonic) -> bool {
        let clock = &self.traces[P::UtcTimeOfDay.index()];
        let stood = clock.since.and_then(|since| now.since(since));
        clock.step > 0.0
            && clock.repeats >= REPEATS_MIN
            && self.is_fresh(P::UtcTimeOfDay, now)
            && stood.is_some_and(|d| d >= CLOCK_STILL)
    }

    /// Since when a parameter stands, as [`Stillness::standing`] has it.
    pub(super) fn since(&self, p: P) -> Option<Monotonic> {
        let trace = &self.traces[p.index()];
        if goes_round(p) {
            trace.since.and(trace.loop_since)
        } else {
            trace.since
        }
    }

    /// The value of a parameter, if it stands and has been said lately.
    pub(super) fn standing(&self, p: P, now: Monotonic) -> Option<Standing> {
        let trace = &self.traces[p.index()];
        let repeats = if goes_round(p) {
            trace.loop_values
        } else {
            trace.repeats
        };
        let age = trace.last.and_then(|at| now.since(at))?;
        let is_recent = age <= p.spec().age_max.max(LATELY);
        let since = self.since(p).filter(|_| repeats > 0 && is_recent)?;
        Some(Standing {
            value: trace.value,
            since,
            repeats,
            step: trace.step,
        })
    }

    /// Whether a parameter was found frozen.
    pub(super) const fn is_frozen(&self, parameter: P) -> bool {
        self.frozen[parameter.index()]
    }
}

#[cfg(test)]
mod tests;
