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
//! 10 degrees apart (15 without a lateral accelerometer): a roll in whole degrees that has stopped, which no noise betrays. There
//! the turn rate of the same source serves too, whose sensor is another, and the airspeed where there is no ground speed.
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
    tracks: Trail<f64>,
    tracks_of: Option<SourceId>,
}

impl CrossCheck {
    pub(super) fn new() -> Self {
        Self {
            latches: [Latch::default(); SOURCES_MAX],
            tracks: Trail::new(),
            tracks_of: None,
        }
    }

    /// Judges every source at `now`. `state` gives speed, track and lateral acceleration, `said` what each source says,
    /// `standing` how long its roll has repeated; `refute` is told of pitch and roll that are none.
    pub(super) fn step(
        &mut self,
        sources: &[SourceId],
        state: &FlightState,
        said: impl Fn(SourceId, P) -> Result<f64, Invalid>,
        standing: impl Fn(SourceId) -> Duration,
        refute: &mut impl FnMut(SourceId, P),
        now: Monotonic,
    ) {
        self.follow(state, now);
        let fast = |p| state.read(p, now).ok().filter(|speed| *speed >= SPEED_MIN);
        let lateral = state.read(P::LateralAcceleration, now).ok();
        for &source in sources {
            let stands = standing(source) >= WINDOW;
            let turn = self.turn_radps().or_else(|| {
                // A roll that stands has another sensor beside it; one that says level may have none at all.
                let mut others = sources.iter().filter(|other| stands || **other != source);
                others.find_map(|other| {
                    let turn = said(*other, P::TurnRate);
                    turn.or_else(|_| said(*other, P::YawRate)).ok()
                })
            });
            let airspeed = || fast(P::TrueAirspeed).or_else(|| fast(P::IndicatedAirspeed));
            let speed = match state.read(P::GroundSpeed, now) {
                Ok(_) => fast(P::GroundSpeed),
                Err(_) if stands => airspeed(),
                Err(_) => None,
            };
            let path = speed
                .zip(turn)
                .map(|(speed, turn)| speed * turn / STANDARD_GRAVITY_MPS2);
            let evidence = match said(source, P::Roll) {
                Ok(roll) => judged(roll, stands, path, lateral),
                Err(_) => Evidence::Between,
            };
            if self.latches[usize::from(source.0)].step(evidence, LASTING, now) {
                refute(source, P::Pitch);
                refute(source, P::Roll);
            }
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

/// What a roll is worth beside `path`, the acceleration across it, and `lateral`, what of that is felt, both in g.
fn judged(roll: f64, stands: bool, path: Option<f64>, lateral: Option<f64>) -> Evidence {
    let sideways = path.map(|path| path - lateral.unwrap_or(0.0));
    let is_level = roll.abs().to_degrees() < LEVEL_DEGREES;
    match sideways {
        None if is_level => Evidence::Between,
        Some(sideways) if is_level => {
            if sideways.abs() > TURNING_DEGREES.to_radians().tan() {
                Evidence::For
            } else {
                Evidence::Between
            }
        }
        Some(sideways) if stands => {
            let apart_degrees = if lateral.is_some() {
                TURNING_DEGREES
            } else {
                BLIND_DEGREES
            };
            if (sideways.atan() - roll).abs().to_degrees() > apart_degrees {
                Evidence::For
            } else {
                // It may pass by where it stands: only moving clears it.
                Evidence::Between
            }
        }
        _ => Evidence::Against,
    }
}

#[cfg(test)]
mod tests;
