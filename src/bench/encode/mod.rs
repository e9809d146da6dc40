//! Encoders: what a box of each protocol would send, frame by frame, for a [`Truth`](crate::bench::Truth).
//!
//! Their tables are their own, written from the same public sources as the decoders' but apart from them, so that a wrong
//! row of either side shows. The numbers are rounded to the protocol's step and held at the ends of its field; where a
//! field has no way to say what it is told (NaN in a whole number), it says "no value", and where it has none, the message
//! is left out.

pub mod can_fix;
pub mod canaerospace;
pub mod dynon_d100;
pub mod dynon_skyview;
pub mod fg_generic;
pub mod fgfdm;
mod field;
pub mod garmin_g3x;
pub mod gdl90;
pub mod mgl;
pub mod nmea;
pub mod ubx;

use super::truth::Truth;
use crate::proto::Protocol;
use crate::signal::{Parameter, Wire};
use std::fmt::Debug;
use std::time::Duration;

/// Where an encoder puts its frames, in their order.
pub type Send<'a> = &'a mut dyn FnMut(Wire<'_>);

/// How often a message is sent, and when first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Beat {
    /// Time between two of them.
    pub every: Duration,
    /// After the start.
    pub first: Duration,
}

impl Beat {
    /// Every so many milliseconds, the first so many after the start.
    #[must_use]
    pub const fn ms(every: u64, first: u64) -> Self {
        Self {
            every: Duration::from_millis(every),
            first: Duration::from_millis(first),
        }
    }
}

/// How a protocol carries a parameter, in the parameter's unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Carried {
    /// The step between two numbers; of floating-point fields, the largest within the parameter's range.
    pub resolution: f64,
    /// The least that the field can hold.
    pub min: f64,
    /// The most that the field can hold.
    pub max: f64,
    /// Whether the protocol can say that there is no value.
    pub absent: bool,
    /// Whether the field can hold NaN.
    pub nan: bool,
    /// Whether the protocol can say that the value is doubtful.
    pub doubtful: bool,
}

impl Carried {
    /// A number that the field can hold and the parameter cannot have; None where there is none.
    #[must_use]
    pub fn impossible(&self, parameter: Parameter) -> Option<f64> {
        let spec = parameter.spec();
        // Far enough that a direction is not taken as one that has been wound up.
        let beyond = ((spec.max - spec.min) * 3.0).min(1e4);
        // At least two steps beyond, or rounding might bring it back.
        let above = (spec.max + beyond).min(self.max);
        let below = (spec.min - beyond).max(self.min);
        if above > spec.max + 2.0 * self.resolution {
            Some(above)
        } else if below < spec.min - 2.0 * self.resolution {
            Some(below)
        } else {
            None
        }
    }
}

/// One box that speaks a protocol.
pub trait Encoder: Debug + std::marker::Send {
    /// Its messages, each with its usual rate.
    fn beats(&self) -> &'static [Beat];

    /// Sends message number `message` of [`Encoder::beats`].
    fn write(&mut self, message: usize, truth: &Truth, send: Send<'_>);

    /// Whether it sends CAN frames.
    fn is_on_can(&self) -> bool {
        false
    }

    /// Whether it sends datagrams rather than bytes of a line.
    fn sends_datagrams(&self) -> bool {
        false
    }

    /// How the protocol carries a parameter; None when it does not.
    fn carries(&self, parameter: Parameter) -> Option<Carried>;
}

/// The box that speaks `protocol` as most of its kind do.
#[must_use]
pub fn encoder(protocol: Protocol) -> Box<dyn Encoder> {
    match protocol {
        Protocol::FgFdm => Box::new(fgfdm::FgFdm::new(fgfdm::Version::V24)),
        Protocol::CanAerospace => Box::new(canaerospace::CanAerospace::new()),
        Protocol::CanFix => Box::new(can_fix::CanFix::new()),
        Protocol::FgGeneric => Box::new(fg_generic::FgGeneric::default()),
        Protocol::Gdl90 => Box::new(gdl90::Gdl90),
        Protocol::DynonSkyView => Box::new(dynon_skyview::DynonSkyView),
        Protocol::DynonD100 => Box::new(dynon_d100::DynonD100::new()),
        Protocol::GarminG3x => Box::new(garmin_g3x::GarminG3x),
        Protocol::Nmea => Box::new(nmea::Nmea),
        Protocol::Ubx => Box::new(ubx::Ubx),
        Protocol::Mgl => Box::new(mgl::Mgl::new()),
    }
}
