//! Calm sensors that stop alone: a value that repeats to the last bit while another quantity shows that it must have changed.
//!
//! Heading, height, track, vertical and ground speed may stand still for minutes in smooth flight, so repeating proves nothing
//! by itself. It does when a *witness*, another parameter from whichever source, has moved by many of the coarsest steps that
//! any source sends:
//!
//! | stands still | while | moves by | within | found at the soonest, as an example |
//! |---|---|---|---|---|
//! | heading | track | 20 degrees | 60 s | 7 s into a standard turn (3 degrees a second) |
//! | heading | turn rate adds up to | 20 degrees | 15 s | 7 s into a standard turn |
//! | track | heading | 20 degrees | 60 s | 7 s into a standard turn |
//! | pressure, baro altitude | geometric altitude | 45 m | 60 s | 18 s into a climb of 500 ft/min |
//! | pressure, baro altitude | vertical speed adds up to | 60 m | 30 s | 24 s into a climb of 500 ft/min |
//! | geometric altitude | pressure altitude | 45 m | 60 s | 18 s into a climb of 500 ft/min |
//! | vertical speed | altitude, less what that speed explains | 60 m | 30 s | 24 s after levelling off from 500 ft/min |
//! | ground speed | airspeed | 10 m/s | 20 s | when that much is reached |
//!
//! What is moved is counted in windows as long as that, one after the other, so that it may take one of them longer. Always in
//! flight, after at least 5 s and three repeats. A witness that jumps faster than an aircraft can, such as a receiver that
//! finds a new fix, is none: the count starts anew. The first new value ends the verdict. What is worked out from others
//! bears no witness. The numbers are our own; no value of any recorded flight comes near to them.

use super::snapshot::FlightState;
use crate::angle::shortest_turn;
use crate::limits::SOURCES_MAX;
use crate::signal::{Parameter as P, SourceId};
use crate::time::Monotonic;
use crate::units::Radians;
use std::time::Duration;

/// The soonest that anything is found.
const LEAST: Duration = Duration::from_secs(5);

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
    }
}

const fn turn(standing: P, witness: P) -> Rule {
    // 20 degrees; 90 degrees a second.
    rule(standing, witness, Motion::Turn, 0.349, 60, 1.57)
}

const fn climb(standing: P, witness: P) -> Rule {
    rule(standing, witness, Motion::Change, 45.0, 60, 50.0)
}

const RULES: [Rule; 20] = [
    turn(P::HeadingTrue, P::Track),
    turn(P::HeadingMagnetic, P::Track),
    turn(P::Track, P::HeadingTrue),
    turn(P::Track, P::HeadingMagnetic),
    turn(P::TrackMagnetic, P::HeadingMagnetic),
    turn(P::TrackMagnetic, P::HeadingTrue),
    rule(P::HeadingTrue, P::TurnRate, Motion::Sum, 0.349, 15, 10.0),
    rule(
        P::HeadingMagnetic,
        P::TurnRate,
        Motion::Sum,
        0.349,
        15,
        10.0,
    ),
    climb(P::PressureAltitude, P::AltitudeMsl),
    climb(P::PressureAltitude, P::HeightEllipsoid),
    climb(P::BaroAltitude, P::AltitudeMsl),
    climb(P::BaroAltitude, P::HeightEllipsoid),
    climb(P::AltitudeMsl, P::PressureAltitude),
    climb(P::HeightEllipsoid, P::PressureAltitude),
    rule(
        P::PressureAltitude,
        P::VerticalSpeed,
        Motion::Sum,
        60.0,
        30,
        20.0,
    ),
    rule(
        P::BaroAltitude,
        P::VerticalSpeed,
        Motion::Sum,
        60.0,
        30,
        20.0,
    ),
    rule(
        P::VerticalSpeed,
        P::PressureAltitude,
        Motion::Drift,
        60.0,
        30,
        50.0,
    ),
    rule(
        P::VerticalSpeed,
        P::AltitudeMsl,
        Motion::Drift,
        60.0,
        30,
        50.0,
    ),
    rule(
        P::GroundSpeed,
        P::TrueAirspeed,
        Motion::Change,
        10.0,
        20,
        10.0,
    ),
    rule(
        P::GroundSpeed,
        P::IndicatedAirspeed,
        Motion::Change,
        10.0,
        20,
        10.0,
    ),
];

/// A value that repeats, as its source says it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Standing {
    pub(super) value: f64,
    /// Since when.
    pub(super) since: Monotonic,
    pub(super) repeats: u32,
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
}

/// All rules for all sources.
#[derive(Clone, Debug)]
pub(super) struct Witnesses {
    watches: [[Option<Watch>; RULES.len()]; SOURCES_MAX],
}

impl Witnesses {
    pub(super) const fn new() -> Self {
        Self {
            watches: [[None; RULES.len()]; SOURCES_MAX],
        }
    }

    /// Nothing is watched on the ground.
    pub(super) fn forget(&mut self) {
        *self = Self::new();
    }

    /// Watches all `sources` at `now`. `state` is what is shown, `standing` says which values repeat.
    pub(super) fn step(
        &mut self,
        sources: &[SourceId],
        state: &FlightState,
        standing: impl Fn(SourceId, P) -> Option<Standing>,
        now: Monotonic,
    ) {
        for source in sources {
            let Some(watches) = self.watches.get_mut(usize::from(source.0)) else {
                continue;
            };
            for (watch, rule) in watches.iter_mut().zip(RULES) {
                *watch = standing(*source, rule.standing)
                    .and_then(|standing| rule.watched(*watch, standing, state, now));
            }
        }
    }

    /// Whether a value that stands still since then does so while a witness says that it cannot.
    pub(super) fn is_frozen(&self, source: SourceId, parameter: P, since: Monotonic) -> bool {
        self.watches
            .get(usize::from(source.0))
            .is_some_and(|watches| {
                let mut of = watches
                    .iter()
                    .zip(RULES)
                    .filter(|(_, r)| r.standing == parameter);
                of.any(|(watch, _)| watch.is_some_and(|w| w.found && w.standing_since == since))
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
        let value = state.read(self.witness, now).ok()?;
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
        watch.found = watch.moved.abs() >= self.least && span >= LEAST && standing.repeats >= 3;
        Some(watch)
    }
}

#[cfg(test)]
mod tests;
