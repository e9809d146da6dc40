//! The snapshot that the display reads: for every parameter the selected value with its time, or why there is none.

use super::bounds::Bounds;
use super::traffic::Around;
use crate::sampled::{Invalid, Sampled};
use crate::signal::{Parameter, SourceId};
use crate::time::Monotonic;
use crate::units::{Metres, MetresPerSecond, Radians};
use std::time::Duration;

/// A quantity of which what is shown is compared with what other sources say. The limits stand in `state::compare`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Compared {
    /// Pitch.
    Pitch,
    /// Roll.
    Roll,
    /// Heading, true or magnetic.
    Heading,
    /// Barometric altitude.
    Altitude,
    /// Indicated or calibrated airspeed.
    Airspeed,
}

impl Compared {
    /// All of them, in the order of their discriminants.
    pub const ALL: [Self; 5] = [
        Self::Pitch,
        Self::Roll,
        Self::Heading,
        Self::Altitude,
        Self::Airspeed,
    ];

    /// How many there are.
    pub const COUNT: usize = Self::ALL.len();
}

/// Why a value cannot be worked out: the first of its inputs that is not to be had.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Missing {
    /// Which input.
    pub input: Parameter,
    /// Why it is not to be had. [`Invalid::NeverReceived`] too where there have not been enough of it yet, and
    /// [`Invalid::OutOfRange`] where it is there, but the formula has no answer for it.
    pub reason: Invalid,
}

/// Everything known of the flight at one moment. `Copy`, so that it crosses threads whole.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlightState {
    values: [Sampled<f64>; Parameter::COUNT],
    sources: [Option<SourceId>; Parameter::COUNT],
    fallbacks: [bool; Parameter::COUNT],
    miscompares: [bool; Compared::COUNT],
    missing: [Option<Missing>; Parameter::COUNT],
    /// Other aircraft.
    pub around: Around,
    /// Bounds of parameters that a bus gives.
    pub bounds: Bounds,
}

impl FlightState {
    /// Nothing heard yet.
    #[must_use]
    pub const fn empty() -> Self {
        Self {
            values: [Sampled::never(); Parameter::COUNT],
            sources: [None; Parameter::COUNT],
            fallbacks: [false; Parameter::COUNT],
            miscompares: [false; Compared::COUNT],
            missing: [None; Parameter::COUNT],
            around: Around::NOBODY,
            bounds: Bounds::NONE,
        }
    }

    /// Takes `sample` as the selected value of `parameter`, from `source`.
    pub fn set(&mut self, parameter: Parameter, sample: Sampled<f64>, source: SourceId) {
        self.values[parameter.index()] = sample;
        self.sources[parameter.index()] = Some(source);
    }

    /// Changes the value of `parameter`, not where it comes from.
    pub(super) fn change(&mut self, parameter: Parameter, sample: Sampled<f64>) {
        self.values[parameter.index()] = sample;
    }

    /// Takes `sample`, worked out from other parameters, as the value of `parameter`: it has no source of its own.
    pub fn set_derived(&mut self, parameter: Parameter, sample: Sampled<f64>) {
        self.values[parameter.index()] = sample;
        self.sources[parameter.index()] = None;
        self.fallbacks[parameter.index()] = false;
        self.missing[parameter.index()] = None;
    }

    /// Says what is missing to work `parameter` out.
    pub fn set_missing(&mut self, parameter: Parameter, missing: Missing) {
        self.missing[parameter.index()] = Some(missing);
    }

    /// Whether `parameter` was worked out from others, rather than received.
    #[must_use]
    pub fn is_derived(&self, parameter: Parameter) -> bool {
        self.source(parameter).is_none() && self.at(parameter).is_some()
    }

    /// What would have to be there for `parameter` to be worked out, where it is neither received nor worked out.
    #[must_use]
    pub const fn missing(&self, parameter: Parameter) -> Option<Missing> {
        self.missing[parameter.index()]
    }

    /// Says whether `parameter` is taken from a source less trusted than another that has been heard of.
    pub fn set_fallback(&mut self, parameter: Parameter, fallback: bool) {
        self.fallbacks[parameter.index()] = fallback;
    }

    /// Says which quantities disagree, in the order of [`Compared::ALL`].
    pub fn set_miscompares(&mut self, miscompares: [bool; Compared::COUNT]) {
        self.miscompares = miscompares;
    }

    /// Whether another source contradicts what is shown of `compared`.
    #[must_use]
    pub const fn miscompares(&self, compared: Compared) -> bool {
        self.miscompares[compared as usize]
    }

    /// The source of `parameter`, if it is shown at `now` and taken from that source because a more trusted one, which has
    /// been heard of, has nothing good to say.
    #[must_use]
    pub fn fallback(&self, parameter: Parameter, now: Monotonic) -> Option<SourceId> {
        let shown = self.fallbacks[parameter.index()] && self.read(parameter, now).is_ok();
        self.source(parameter).filter(|_| shown)
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
