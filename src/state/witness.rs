//! Calm sensors that stop alone: a value that repeats to the last bit while another quantity shows that it must have changed.
//!
//! Heading, height, track, vertical and ground speed, temperature may stand still for minutes in smooth flight, so repeating
//! proves nothing by itself. It does when a *witness*, another parameter from whichever source, has moved by many of the
//! coarsest steps that any source sends:
//!
//! | stands still | while | moves by | within | found at the soonest, as an example |
//! |---|---|---|---|---|
//! | heading | track | 20 degrees | 60 s | 7 s into a standard turn (3 degrees a second) |
//! | heading | turn rate adds up to | 12 degrees | 15 s | 5 s into a standard turn |
//! | track | heading | 20 degrees | 60 s | 7 s into a standard turn |
//! | heading, track | the same from the other north | 8 degrees | 60 s | 5 s into a standard turn |
//! | pressure, baro, density altitude | geometric or pressure altitude | 45 m | 60 s | 18 s into a climb of 500 ft/min |
//! | geometric altitude | pressure or the other geometric altitude | 45 m | 60 s | 18 s into a climb of 500 ft/min |
//! | any of these altitudes | vertical speed adds up to | 30 m | 15 s | 12 s into a climb of 500 ft/min |
//! | height above ground | altitude | 60 m, five of its own steps | 60 s | 24 s into a climb of 500 ft/min |
//! | vertical speed | altitude, less what that speed explains | 20 m | 15 s | 8 s after levelling off from 500 ft/min |
//! | ground speed | airspeed | 10 m/s | 20 s | when that much is reached |
//! | true airspeed | indicated or calibrated airspeed | 4 m/s | 20 s | when that much is reached |
//! | air temperature | altitude | 300 m, which the standard lapse makes of five of its own steps | 300 s | 2 min into a climb of 500 ft/min |
//!
//! Headings, altitudes and vertical speed also stand when they go round in at most three values, as what several messages say,
//! each rounded in its own way. What is moved is counted in windows as long as that, one after the other, so that it may take one of them longer. Always in
//! flight, after at least 5 s and three repeats. A witness that jumps faster than an aircraft can, such as a receiver that
//! finds a new fix, is none: the count starts anew. The first new value ends the verdict. What is worked out from others
//! bears no witness. Where a witness that is added up, or that drifts, has itself repeated for 5 s (a climb rate
//! that stands, and an altitude that does), one of the two has stopped and nobody can tell which: neither is shown. The numbers are our own; no value of any recorded
//! flight comes near to them. How a receiver's speed and track belong to its positions, and a wind to what it is made of, is
//! judged whether they stand or not: `motion`, `relation`.

use super::frozen::LATELY;
use super::snapshot::FlightState;
use crate::angle::shortest_turn;
use crate::limits::SOURCES_MAX;
use crate::signal::{Parameter as P, SourceId};
use crate::time::Monotonic;
use crate::units::Radians;
use std::time::Duration;

/// The soonest that anything is found.
const LEAST: Duration = Duration::from_secs(5);

/// A witness that repeats for so long may have stopped itself.
const UNSURE: Duration = Duration::from_millis(1500);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Motion {
    /// The shortest turns from value to value, added up.
    Turn,
    /// From the first value to the last.
    Change,
    /// The values times their times, added up.
    Sum,
    /// From the first value to the last, less what the standing value explains as its rate.
    Drift,
}

/// One row of the table.
#[derive(Clone, Copy, Debug)]
struct Rule {
    standing: P,
    witness: P,
    motion: Motion,
    least: f64,
    within: Duration,
    /// Faster than this, per second, the witness jumps.
    fastest: f64,
    /// It is to move at least so far for each unit of the smallest step in which the other has been told.
    per_step: f64,
}

const fn rule(
    standing: P,
    witness: P,
    motion: Motion,
    least: f64,
    within_s: u64,
    fastest: f64,
) -> Rule {
    Rule {
        standing,
        witness,
        motion,
        least,
        within: Duration::from_secs(within_s),
        fastest,
        per_step: 0.0,
    }
}

/// 20 degrees; 90 degrees a second.
const fn turn(standing: P, witness: P) -> Rule {
    rule(standing, witness, Motion::Turn, 0.349, 60, 1.57)
}

/// 8 degrees of the same from the other north.
const fn twin(standing: P, witness: P) -> Rule {
    rule(standing, witness, Motion::Turn, 0.14, 60, 1.57)
}

/// 12 degrees.
const fn turning(standing: P) -> Rule {
    rule(standing, P::TurnRate, Motion::Sum, 0.21, 15, 10.0)
}

const fn climb(standing: P, witness: P) -> Rule {
    rule(standing, witness, Motion::Change, 45.0, 60, 50.0)
}

const fn climbing(standing: P) -> Rule {
    rule(standing, P::VerticalSpeed, Motion::Sum, 30.0, 15, 20.0)
}

const fn drift(witness: P) -> Rule {
    rule(P::VerticalSpeed, witness, Motion::Drift, 20.0, 15, 50.0)
}

const fn speed(standing: P, witness: P, least: f64) -> Rule {
    rule(standing, witness, Motion::Change, least, 20, 10.0)
}

const fn ground(witness: P) -> Rule {
    Rule {
        per_step: 5.0,
        ..rule(P::HeightAgl, witness, Motion::Change, 60.0, 60, 50.0)
    }
}

/// Metres of standard atmosphere in which the temperature changes by five times a kelvin.
const FIVE_KELVIN_M: f64 = 5.0 / 0.006_5;

const fn cooling(witness: P) -> Rule {
    let standing = P::StaticAirTemperature;
    Rule {
        per_step: FIVE_KELVIN_M,
        ..rule(standing, witness, Motion::Change, 300.0, 300, 50.0)
    }
}

const RULES: [Rule; 38] = [
    turn(P::HeadingTrue, P::Track),
    turn(P::HeadingMagnetic, P::Track),
    turn(P::Track, P::HeadingTrue),
    turn(P::Track, P::HeadingMagnetic),
    turn(P::TrackMagnetic, P::HeadingMagnetic),
    turn(P::TrackMagnetic, P::HeadingTrue),
    twin(P::HeadingTrue, P::HeadingMagnetic),
    twin(P::HeadingMagnetic, P::HeadingTrue),
    twin(P::Track, P::TrackMagnetic),
    twin(P::TrackMagnetic, P::Track),
    turning(P::HeadingTrue),
    turning(P::HeadingMagnetic),
    climb(P::PressureAltitude, P::AltitudeMsl),
    climb(P::PressureAltitude, P::HeightEllipsoid),
    climb(P::BaroAltitude, P::PressureAltitude),
    climb(P::BaroAltitude, P::AltitudeMsl),
    climb(P::BaroAltitude, P::HeightEllipsoid),
    climb(P::DensityAltitude, P::PressureAltitude),
    climb(P::AltitudeMsl, P::PressureAltitude),
    climb(P::AltitudeMsl, P::HeightEllipsoid),
    climb(P::HeightEllipsoid, P::PressureAltitude),
    climb(P::HeightEllipsoid, P::AltitudeMsl),
    climbing(P::PressureAltitude),
    climbing(P::BaroAltitude),
    climbing(P::AltitudeMsl),
    climbing(P::HeightEllipsoid),
    drift(P::PressureAltitude),
    drift(P::AltitudeMsl),
    drift(P::HeightEllipsoid),
    ground(P::PressureAltitude),
    ground(P::AltitudeMsl),
    ground(P::HeightEllipsoid),
    cooling(P::PressureAltitude),
    cooling(P::AltitudeMsl),
    speed(P::GroundSpeed, P::TrueAirspeed, 10.0),
    speed(P::GroundSpeed, P::IndicatedAirspeed, 10.0),
    speed(P::TrueAirspeed, P::IndicatedAirspeed, 4.0),
    speed(P::TrueAirspeed, P::CalibratedAirspeed, 4.0),
];

/// A value that repeats, as its source says it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Standing {
    pub(super) value: f64,
    /// Since when.
    pub(super) since: Monotonic,
    pub(super) repeats: u32,
    /// The smallest step that the source has made in it; zero before the first.
    pub(super) step: f64,
}

/// What a witness has done since a value stands.
#[derive(Clone, Copy, Debug)]
struct Watch {
    standing_since: Monotonic,
    from: Monotonic,
    first: f64,
    last: f64,
    last_at: Monotonic,
    witness_of: Option<SourceId>,
    moved: f64,
    found: bool,
    /// Since when the witness has stood still itself, if it has all the time: it may be the one that has stopped.
    witness_stands: Option<Monotonic>,
}

/// All rules for all sources.
#[derive(Clone, Debug)]
pub(super) struct Witnesses {
    watches: Vec<[Option<Watch>; RULES.len()]>,
    is_idle: bool,
}

impl Witnesses {
    pub(super) fn new() -> Self {
        Self {
            watches: vec![[None; RULES.len()]; SOURCES_MAX],
            is_idle: true,
        }
    }

    /// Nothing is watched on the ground.
    pub(super) fn forget(&mut self) {
        if !self.is_idle {
            self.watches.fill([None; RULES.len()]);
            self.is_idle = true;
        }
    }

    /// Watches all `sources` at `now`. `state` is what is shown, `standing` says which values repeat.
    pub(super) fn step(
        &mut self,
        sources: &[SourceId],
        state: &FlightState,
        standing: impl Fn(SourceId, P) -> Option<Standing>,
        now: Monotonic,
    ) {
        self.is_idle = false;
        for source in sources {
            let Some(watches) = self.watches.get_mut(usize::from(source.0)) else {
                continue;
            };
            for (watch, rule) in watches.iter_mut().zip(RULES) {
                let before = *watch;
                *watch = standing(*source, rule.standing)
                    .and_then(|standing| rule.watched(before, standing, state, now));
                if let Some(watch) = watch
                    && !before.is_some_and(|b| b.found)
                    && matches!(rule.motion, Motion::Sum | Motion::Drift)
                {
                    let witness = watch.witness_of.and_then(|of| standing(of, rule.witness));
                    let since = witness.map(|witness| witness.since);
                    let stood = since.and_then(|since| now.since(since)).unwrap_or_default();
                    // Either may have stopped: in a moment it moves, or both are doubted.
                    watch.found &= stood < UNSURE || stood >= LEAST;
                    watch.witness_stands = since.filter(|_| stood >= LEAST);
                }
            }
        }
    }

    /// Whether a value that stands still since then does so while a witness says that it cannot.
    pub(super) fn is_frozen(&self, source: SourceId, parameter: P, since: Monotonic) -> bool {
        let found = |of: SourceId, watch: &Watch, rule: &Rule| {
            watch.found
                && ((rule.standing == parameter && of == source && watch.standing_since == since)
                    || (rule.witness == parameter
                        && watch.witness_of == Some(source)
                        && watch.witness_stands == Some(since)))
        };
        !self.is_idle
            && self.watches.iter().zip(0_u8..).any(|(watches, of)| {
                let mut of_source = watches.iter().zip(&RULES);
                of_source.any(|(watch, rule)| {
                    watch.is_some_and(|watch| found(SourceId(of), &watch, rule))
                })
            })
    }
}

impl Rule {
    /// How much the witness may change at once because it is told in steps: altitudes in 25 ft (GDL90).
    const fn coarseness(&self) -> f64 {
        match self.witness {
            P::PressureAltitude | P::AltitudeMsl | P::HeightEllipsoid => 10.0,
            _ => 0.0,
        }
    }

    fn watched(
        &self,
        before: Option<Watch>,
        standing: Standing,
        state: &FlightState,
        now: Monotonic,
    ) -> Option<Watch> {
        let before = before.filter(|w| w.standing_since == standing.since);
        // Once found it stands until the value does no more, whatever the witness does.
        if before.is_some_and(|w| w.found) {
            return before;
        }
        let Ok(value) = state.read(self.witness, now) else {
            // Between two messages of a slow witness nothing is forgotten.
            return before.filter(|w| now.since(w.last_at).is_some_and(|age| age <= LATELY));
        };
        let at = state.at(self.witness)?;
        let witness_of = Some(state.source(self.witness)?);
        let anew = Watch {
            standing_since: standing.since,
            from: at,
            first: value,
            last: value,
            last_at: at,
            witness_of,
            moved: 0.0,
            found: false,
            witness_stands: None,
        };
        let same = |w: &Watch| {
            w.witness_of == witness_of && at.since(w.from).is_some_and(|d| d <= self.within)
        };
        let Some(mut watch) = before.filter(same) else {
            return Some(anew);
        };
        let dt = at.since(watch.last_at)?.as_secs_f64();
        if dt <= 0.0 {
            return Some(watch);
        }
        let step = match self.motion {
            Motion::Turn => shortest_turn(Radians(watch.last), Radians(value)).0,
            _ => value - watch.last,
        };
        if step.abs() > self.fastest * dt.max(0.1) + self.coarseness() {
            return Some(anew);
        }
        let span = at.since(watch.from)?;
        match self.motion {
            Motion::Turn => watch.moved += step,
            Motion::Sum => watch.moved += watch.last * dt,
            Motion::Change => watch.moved = value - watch.first,
            Motion::Drift => {
                watch.moved = value - watch.first - standing.value * span.as_secs_f64();
            }
        }
        (watch.last, watch.last_at) = (value, at);
        let least = self.least.max(self.per_step * standing.step);
        watch.found = watch.moved.abs() >= least && span >= LEAST && standing.repeats >= 3;
        Some(watch)
    }
}

#[cfg(test)]
mod tests;
