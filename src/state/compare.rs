//! Comparison of what is shown with what every other source says of the same quantity.
//!
//! Two sources that disagree do not say which of them is wrong. The value therefore stays on the display and is marked in
//! amber beside its instrument, as certified displays do (limits below); taking both away would leave the pilot without
//! attitude, the gravest loss there is (FAA AC 25-11B, table 4-1), where a look at the standby or out of the window decides.
//!
//! | quantity | apart by more than | for | compared |
//! |---|---|---|---|
//! | pitch | 5 degrees | 1 s | with pitch |
//! | roll | 6 degrees | 1 s | with roll, below 75 degrees of pitch: beyond, roll is hardly defined |
//! | heading | 6 degrees up to 6 degrees of bank, else 20 | 2.5 s | true with true, magnetic with magnetic, below 75 degrees of pitch |
//! | altitude | 200 ft | 2.5 s | as pressure altitude: corrected altitudes with their own source's setting taken out, never geometric ones |
//! | airspeed | 10 kt, 7 kt when either is above 80 kt, not below 35 kt | 2.5 s | indicated with indicated, calibrated with calibrated |
//!
//! Limits: pitch, roll, altitude and airspeed of Garmin's G1000 comparator (Pilot's Guide 190-00663-02 Rev. B, appendix A);
//! heading with bank of Bendix/King's EFS 40/50 (Pilot's Guide, section 4.2), whose pitch and roll limits are the same, as
//! are the Embraer 145's (Airplane Operations Manual, 2-18-30). Times: no source states any; these are our own and longer
//! than the greatest age of the quantity, so that two healthy sources of which one lags never disagree for so long. A flag
//! is dropped when the difference has been below three quarters of its limit for the same time, or when there is nothing
//! left to compare: only good, fresh values are.

use super::latch::{Evidence, Latch};
use super::snapshot::{Compared, FlightState};
use crate::angle::shortest_turn;
use crate::atmosphere::pressure_altitude;
use crate::sampled::Invalid;
use crate::signal::{Parameter as P, SourceId};
use crate::time::Monotonic;
use crate::units::{Feet, Hectopascals, Knots, Metres, MetresPerSecond, Radians};
use std::time::Duration;

/// A difference below this part of its limit is none.
const RELEASE: f64 = 0.75;
/// Beyond this pitch roll and heading are hardly defined, degrees.
const STEEP_DEGREES: f64 = 75.0;

/// How long a difference must last to be flagged, and to be gone to be unflagged.
#[must_use]
pub const fn lasting(compared: Compared) -> Duration {
    match compared {
        Compared::Pitch | Compared::Roll => Duration::from_secs(1),
        Compared::Heading | Compared::Altitude | Compared::Airspeed => Duration::from_millis(2500),
    }
}

/// The flags, and how long each difference has lasted.
#[derive(Clone, Debug, Default)]
pub(super) struct Comparator {
    latches: [Latch; Compared::COUNT],
}

impl Comparator {
    /// The quantities that disagree at `now`. `state` says whose values are shown, `said` what each of the `sources` says,
    /// if it may be shown.
    pub(super) fn step(
        &mut self,
        sources: &[SourceId],
        state: &FlightState,
        said: impl Fn(SourceId, P) -> Result<f64, Invalid>,
        now: Monotonic,
    ) -> [bool; Compared::COUNT] {
        let view = View {
            sources,
            state,
            said,
            now,
        };
        let mut raised = [false; Compared::COUNT];
        for compared in Compared::ALL {
            let evidence = match view.apart(compared) {
                None => Evidence::Nothing,
                Some(apart) if apart > 1.0 => Evidence::For,
                Some(apart) if apart < RELEASE => Evidence::Against,
                Some(_) => Evidence::Between,
            };
            let i = compared as usize;
            raised[i] = self.latches[i].step(evidence, lasting(compared), now);
        }
        raised
    }
}

struct View<'a, F> {
    sources: &'a [SourceId],
    state: &'a FlightState,
    said: F,
    now: Monotonic,
}

impl<F: Fn(SourceId, P) -> Result<f64, Invalid>> View<'_, F> {
    /// The greatest difference to what is shown, in units of its limit; `None` when there is nothing to compare.
    fn apart(&self, compared: Compared) -> Option<f64> {
        match compared {
            Compared::Pitch => self.parameter(P::Pitch, |a, b| (a - b).abs().to_degrees() / 5.0),
            Compared::Roll => {
                self.flat()?;
                self.parameter(P::Roll, |a, b| turn_degrees(a, b) / 6.0)
            }
            Compared::Heading => {
                let banked = !self
                    .state
                    .read(P::Roll, self.now)
                    .is_ok_and(|roll| roll.abs().to_degrees() <= 6.0);
                self.flat()?;
                let limit = if banked { 20.0 } else { 6.0 };
                let one = |p| self.parameter(p, |a, b| turn_degrees(a, b) / limit);
                greater(one(P::HeadingTrue), one(P::HeadingMagnetic))
            }
            Compared::Altitude => {
                let shown = [P::PressureAltitude, P::BaroAltitude]
                    .into_iter()
                    .find(|p| self.state.read(*p, self.now).is_ok())
                    .and_then(|p| self.state.source(p))?;
                self.worst(
                    shown,
                    |source| self.pressure_altitude(source),
                    |a, b| Feet::from(Metres((a - b).abs())).0 / 200.0,
                )
            }
            Compared::Airspeed => greater(
                self.parameter(P::IndicatedAirspeed, airspeeds),
                self.parameter(P::CalibratedAirspeed, airspeeds),
            ),
        }
    }

    /// The shown value of a parameter against every other source's.
    fn parameter(&self, parameter: P, ratio: impl Fn(f64, f64) -> f64) -> Option<f64> {
        let shown = self.state.source(parameter)?;
        self.worst(shown, |source| (self.said)(source, parameter).ok(), ratio)
    }

    fn worst(
        &self,
        shown: SourceId,
        value: impl Fn(SourceId) -> Option<f64>,
        ratio: impl Fn(f64, f64) -> f64,
    ) -> Option<f64> {
        let own = value(shown)?;
        let others = self.sources.iter().filter(|source| **source != shown);
        others
            .filter_map(|source| value(*source))
            .map(|other| ratio(own, other))
            .reduce(f64::max)
    }

    /// What a source's altimeter says, without any setting.
    fn pressure_altitude(&self, source: SourceId) -> Option<f64> {
        (self.said)(source, P::PressureAltitude).ok().or_else(|| {
            let corrected = (self.said)(source, P::BaroAltitude).ok()?;
            let setting = (self.said)(source, P::BaroSetting).ok()?;
            Some(corrected + pressure_altitude(Hectopascals(setting)).0)
        })
    }

    /// Whether roll and heading mean anything.
    fn flat(&self) -> Option<()> {
        let pitch = self.state.read(P::Pitch, self.now);
        let steep = pitch.is_ok_and(|pitch| pitch.abs().to_degrees() > STEEP_DEGREES);
        (!steep).then_some(())
    }
}

fn greater(a: Option<f64>, b: Option<f64>) -> Option<f64> {
    a.into_iter().chain(b).reduce(f64::max)
}

fn turn_degrees(a: f64, b: f64) -> f64 {
    shortest_turn(Radians(a), Radians(b)).to_degrees().abs()
}

fn airspeeds(a: f64, b: f64) -> f64 {
    let [a, b] = [a, b].map(|v| Knots::from(MetresPerSecond(v)).0);
    match a.max(b) {
        fastest if fastest < 35.0 => 0.0,
        fastest if fastest <= 80.0 => (a - b).abs() / 10.0,
        _ => (a - b).abs() / 7.0,
    }
}

#[cfg(test)]
mod tests;
