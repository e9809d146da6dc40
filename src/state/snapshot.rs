//! The snapshot that the display reads: for every parameter the selected value with its time, or why there is none.

use crate::sampled::{Invalid, Sampled};
use crate::signal::{Parameter, SourceId};
use crate::time::Monotonic;
use crate::units::{Metres, MetresPerSecond, Radians};
use std::time::Duration;

/// Everything known of the flight at one moment. `Copy`, so that it crosses threads whole.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlightState {
    values: [Sampled<f64>; Parameter::COUNT],
    sources: [Option<SourceId>; Parameter::COUNT],
}

impl FlightState {
    /// Nothing heard yet.
    #[must_use]
    pub const fn empty() -> Self {
        Self {
            values: [Sampled::never(); Parameter::COUNT],
            sources: [None; Parameter::COUNT],
        }
    }

    /// Takes `sample` as the selected value of `parameter`, from `source`.
    pub fn set(&mut self, parameter: Parameter, sample: Sampled<f64>, source: SourceId) {
        self.values[parameter.index()] = sample;
        self.sources[parameter.index()] = Some(source);
    }

    /// The value of `parameter` in its table unit, if it may be shown at `now` under its own greatest age.
    ///
    /// # Errors
    /// Why it may not be shown.
    pub fn read(&self, parameter: Parameter, now: Monotonic) -> Result<f64, Invalid> {
        self.values[parameter.index()].read(now, parameter.spec().age_max)
    }

    /// The time since `parameter` was last heard of; `None` if never.
    #[must_use]
    pub fn age(&self, parameter: Parameter, now: Monotonic) -> Option<Duration> {
        self.values[parameter.index()].age(now)
    }

    /// When `parameter` was last heard of.
    #[must_use]
    pub fn at(&self, parameter: Parameter) -> Option<Monotonic> {
        self.values[parameter.index()].at()
    }

    /// The source that `parameter` is taken from.
    #[must_use]
    pub const fn source(&self, parameter: Parameter) -> Option<SourceId> {
        self.sources[parameter.index()]
    }

    /// An angle. See [`FlightState::read`]; `parameter` must be one in radians.
    ///
    /// # Errors
    /// Why it may not be shown.
    pub fn angle(&self, parameter: Parameter, now: Monotonic) -> Result<Radians, Invalid> {
        debug_assert!(
            parameter.spec().name.ends_with("_rad"),
            "{parameter:?} is no angle"
        );
        self.read(parameter, now).map(Radians)
    }

    /// A speed. See [`FlightState::read`]; `parameter` must be one in metres per second.
    ///
    /// # Errors
    /// Why it may not be shown.
    pub fn speed(&self, parameter: Parameter, now: Monotonic) -> Result<MetresPerSecond, Invalid> {
        debug_assert!(
            parameter.spec().name.ends_with("_mps"),
            "{parameter:?} is no speed"
        );
        self.read(parameter, now).map(MetresPerSecond)
    }

    /// A height. See [`FlightState::read`]; `parameter` must be one in metres.
    ///
    /// # Errors
    /// Why it may not be shown.
    pub fn height(&self, parameter: Parameter, now: Monotonic) -> Result<Metres, Invalid> {
        debug_assert!(
            parameter.spec().name.ends_with("_m"),
            "{parameter:?} is no height"
        );
        self.read(parameter, now).map(Metres)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_parameter_keeps_its_own_age() {
        let mut state = FlightState::empty();
        let t0 = Monotonic::from_nanos(1_000_000_000);
        for p in [Parameter::Pitch, Parameter::IndicatedAirspeed] {
            state.set(p, Sampled::good(0.25, t0), SourceId(0));
        }
        let later = t0.plus(Duration::from_millis(301));
        assert_eq!(state.read(Parameter::Pitch, later), Err(Invalid::Stale));
        assert_eq!(state.read(Parameter::IndicatedAirspeed, later), Ok(0.25));
        assert_eq!(
            state.read(Parameter::Roll, later),
            Err(Invalid::NeverReceived)
        );
    }
}
