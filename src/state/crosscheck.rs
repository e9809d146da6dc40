//! Attitude that says level because its sensor is missing: found by the turn that the aircraft makes meanwhile.
//!
//! Some attitude sources send level attitude, well formed and fresh, when the sensor behind them is not there. In a turn the
//! path bends, and in coordinated flight the bank belongs to it: `tan(bank) = V w / g`, V the ground speed and w the rate of
//! the track (FAA-H-8083-25B, Pilot's Handbook of Aeronautical Knowledge, chapter 5, rate of turn). A skid with level wings
//! bends the path too, but is felt: the lateral acceleration, in g, is then `V w / g` itself and is taken off.
//!
//! A source is contradicted when, for 5 s on end,
//! - it says a roll within 3 degrees of level,
//! - the ground speed is 25 m/s or more (no taxiing), and
//! - the bank that belongs to the turn, less what the lateral accelerometer explains, is more than 10 degrees: a turn of
//!   2 degrees a second at 50 m/s. The turn is seen in the track over the last 3 s or, if that is not to be had, in
//!   the turn rate or yaw rate of another source.
//!
//! So is one whose roll is not level but has repeated to the last bit for 3 s, where that bank and the turn's are more than
//! 10 degrees apart (15 without a lateral accelerometer): a roll in whole degrees that has stopped, which no noise betrays.
//!
//! Then its pitch and roll are [`Invalid::Implausible`](crate::sampled::Invalid::Implausible), and another source is taken
//! if there is one. It is believed again after it has shown a bank of 3 degrees or more for 5 s; straight flight alone proves nothing.
//! Limits: nothing is found in straight flight, below 25 m/s, without ground speed, or without any sight of the turn. A real skid
//! of that size without a lateral accelerometer would be taken for it.

use super::latch::{Evidence, Latch};
use super::snapshot::FlightState;
use super::trail::Trail;
use crate::angle::shortest_turn;
use crate::limits::SOURCES_MAX;
use crate::sampled::Invalid;
use crate::signal::{Parameter as P, SourceId};
use crate::time::Monotonic;
use crate::units::{Radians, STANDARD_GRAVITY_MPS2};
use std::time::Duration;

/// How long a contradiction lasts until it counts.
pub const LASTING: Duration = Duration::from_secs(5);
/// A roll below this is level, degrees.
const LEVEL_DEGREES: f64 = 3.0;
/// The bank that belongs to the turn is at least this, degrees.
const TURNING_DEGREES: f64 = 10.0;
/// A roll that stands still is this far from the bank of the turn, degrees, where no lateral accelerometer tells of a slip.
const BLIND_DEGREES: f64 = 15.0;
/// Slower than this the relation is not used, m/s.
const SPEED_MIN: f64 = 25.0;
/// The track is followed for this long, and at least for two thirds of it.
const WINDOW: Duration = Duration::from_secs(3);

/// Which sources are contradicted, and the track of the last seconds.
#[derive(Clone, Debug)]
pub(super) struct CrossCheck {
    latches: [Latch; SOURCES_MAX],
    contradicted: [bool; SOURCES_MAX],
    tracks: Trail<f64>,
    tracks_of: Option<SourceId>,
}

impl CrossCheck {
    pub(super) fn new() -> Self {
        Self {
            latches: [Latch::default(); SOURCES_MAX],
            contradicted: [false; SOURCES_MAX],
            tracks: Trail::new(),
            tracks_of: None,
        }
    }

    /// The sources whose attitude was found to be none, by their ids.
    pub(super) const fn contradicted(&self) -> [bool; SOURCES_MAX] {
        self.contradicted
    }

    /// Judges every source at `now`. `state` gives speed, track and lateral acceleration, `said` what each source says.
    pub(super) fn step(
        &mut self,
        sources: &[SourceId],
        state: &FlightState,
        said: impl Fn(SourceId, P) -> Result<f64, Invalid>,
        standing: impl Fn(SourceId) -> Duration,
        now: Monotonic,
    ) {
        self.follow(state, now);
        let speed = state.read(P::GroundSpeed, now).ok();
        let lateral = state.read(P::LateralAcceleration, now);
        let felt = lateral.unwrap_or(0.0);
        let apart_degrees = if lateral.is_ok() {
            TURNING_DEGREES
        } else {
            BLIND_DEGREES
        };
        for &source in sources {
            let turn = self.turn_radps().or_else(|| {
                let mut others = sources.iter().filter(|other| **other != source);
                others.find_map(|other| {
                    let turn = said(*other, P::TurnRate);
                    turn.or_else(|_| said(*other, P::YawRate)).ok()
                })
            });
            let evidence = match said(source, P::Roll) {
                Ok(roll) if roll.abs().to_degrees() >= LEVEL_DEGREES => match (speed, turn) {
                    (Some(speed), Some(turn))
                        if speed >= SPEED_MIN && standing(source) >= WINDOW =>
                    {
                        let bank = (speed * turn / STANDARD_GRAVITY_MPS2 - felt).atan();
                        if (bank - roll).abs().to_degrees() > apart_degrees {
                            Evidence::For
                        } else {
                            Evidence::Against
                        }
                    }
                    _ => Evidence::Against,
                },
                Ok(_) => match (speed, turn) {
                    (Some(speed), Some(turn)) if speed >= SPEED_MIN => {
                        let sideways = speed * turn / STANDARD_GRAVITY_MPS2 - felt;
                        let turning = sideways.abs() > TURNING_DEGREES.to_radians().tan();
                        if turning {
                            Evidence::For
                        } else {
                            Evidence::Between
                        }
                    }
                    _ => Evidence::Between,
                },
                Err(_) => Evidence::Between,
            };
            let i = usize::from(source.0);
            self.contradicted[i] = self.latches[i].step(evidence, LASTING, now);
        }
    }

    fn follow(&mut self, state: &FlightState, now: Monotonic) {
        let source = state.source(P::Track);
        let track = state.read(P::Track, now);
        if track.is_err() || source != self.tracks_of {
            self.tracks.forget();
            self.tracks_of = source;
        }
        if let (Ok(track), Some(at)) = (track, state.at(P::Track)) {
            self.tracks.keep(track, at);
        }
    }

    /// The rate of the track, right positive, from turn to turn of the last seconds.
    fn turn_radps(&self) -> Option<f64> {
        let recent = self.tracks.within(WINDOW);
        let ((first, _), (last, _)) = (recent.first()?, recent.last()?);
        let dt = last.since(*first).filter(|dt| *dt >= WINDOW * 2 / 3)?;
        let turned: f64 = recent
            .iter()
            .zip(recent.iter().skip(1))
            .map(|((_, a), (_, b))| shortest_turn(Radians(*a), Radians(*b)).0)
            .sum();
        Some(turned / dt.as_secs_f64())
    }
}

#[cfg(test)]
mod tests;
