//! What an encoder is told to say: for each parameter a number or why there is none, and other aircraft.

use crate::sampled::Invalid;
use crate::signal::{Alert, Parameter};

/// What the sensors of one aircraft would say at one moment, each in its parameter's unit.
///
/// It may hold anything, NaN and impossible numbers included: an encoder writes what its protocol can.
/// - [`Invalid::NeverReceived`]: not fitted. On CAN the frame is not sent; in a line of fields it says "no value".
/// - [`Invalid::Doubtful`]: the number is there but not to be trusted; protocols without a flag for it say "no value".
/// - any other reason: "no value", by the protocol's own sentinel or flag; a message that has none is left out.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    values: [Result<f64, Invalid>; Parameter::COUNT],
    /// Other aircraft.
    pub traffic: Vec<Aircraft>,
}

impl Truth {
    /// Nothing is fitted.
    #[must_use]
    pub const fn nothing() -> Self {
        Self {
            values: [Err(Invalid::NeverReceived); Parameter::COUNT],
            traffic: Vec::new(),
        }
    }

    /// What is said of a parameter.
    ///
    /// # Errors
    /// Why there is no number.
    pub const fn get(&self, parameter: Parameter) -> Result<f64, Invalid> {
        self.values[parameter.index()]
    }

    /// From now on this is said of a parameter.
    pub const fn set(&mut self, parameter: Parameter, value: Result<f64, Invalid>) {
        self.values[parameter.index()] = value;
    }

    /// A number, if there is one that is finite.
    #[must_use]
    pub fn finite(&self, parameter: Parameter) -> Option<f64> {
        self.get(parameter).ok().filter(|x| x.is_finite())
    }
}

/// Another aircraft, as it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aircraft {
    /// Its 24-bit address.
    pub address: u32,
    /// Its call sign, padded with spaces.
    pub callsign: [u8; 8],
    /// North positive, rad.
    pub latitude_rad: f64,
    /// East positive, rad.
    pub longitude_rad: f64,
    /// m.
    pub pressure_altitude_m: f64,
    /// Clockwise from true north, rad, 0 to 2 pi.
    pub track_rad: f64,
    /// Over the ground, m/s.
    pub ground_speed_mps: f64,
    /// Up positive, m/s.
    pub vertical_speed_mps: f64,
    /// How near the receiver is to say that it will come.
    pub alert: Alert,
}
