//! The words that cross between buses, state and display: raw frames, and signals with one table of parameters.
//!
//! A decoder (`proto`) turns a [`Frame`] into [`Signal`]s; fusion (`state`) turns signals into a `FlightState`. Neither
//! knows the other: they meet here.

mod parameter;
mod traffic;

pub use parameter::{
    BUS_CURRENT, BUS_VOLTAGE, FUEL_MASS, FUEL_QUANTITY, GENERATOR_CURRENT, GENERATOR_VOLTAGE,
    Parameter, ParameterSpec, engines,
};
pub use traffic::{Alert, Place, Traffic};

use crate::sampled::Invalid;
use crate::time::Monotonic;

/// Which configured source said it: its index in the board file's list of sources.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SourceId(pub u8);

/// One whole unit as it came off a bus.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// When it was received, stamped by the bus thread.
    pub at: Monotonic,
    /// The source that received it.
    pub source: SourceId,
    /// What it holds.
    pub wire: Wire<'a>,
}

/// The bytes of a frame.
#[derive(Clone, Copy, Debug)]
pub enum Wire<'a> {
    /// A CAN 2.0 data frame.
    Can(CanData),
    /// One UDP datagram.
    Datagram(&'a [u8]),
    /// A piece of a byte stream, cut anywhere: what a serial port had to give. An empty one says that the stream was
    /// interrupted: what comes next does not continue what came before.
    Stream(&'a [u8]),
}

/// A CAN 2.0 data frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CanData {
    /// Identifier, 11 or 29 bits.
    pub id: u32,
    /// Whether the identifier has 29 bits.
    pub extended: bool,
    /// Number of data bytes, 0 to 8.
    pub len: u8,
    /// Data; bytes beyond `len` are zero.
    pub data: [u8; 8],
}

impl CanData {
    /// The data bytes that were sent.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.data[..usize::from(self.len.min(8))]
    }
}

/// What a source said about one parameter: a number in the parameter's SI unit, or why there is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Signal {
    /// When its frame was received.
    pub at: Monotonic,
    /// Who said it.
    pub source: SourceId,
    /// About what.
    pub parameter: Parameter,
    /// In the unit of [`Parameter::spec`]; already checked finite and in range.
    pub value: Result<f64, Invalid>,
}

/// A bound of a parameter as a bus gives it, to be shown on the parameter's scale: never its value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limit {
    /// When its frame was received.
    pub at: Monotonic,
    /// Who said it.
    pub source: SourceId,
    /// Of what.
    pub parameter: Parameter,
    /// Which bound: a short lower-case name as the bus's standard has it, as in `vne` or `high-warning`.
    pub kind: &'static str,
    /// In the unit of the parameter; checked finite and in its range.
    pub value: f64,
}

/// What a source said that is no value of a parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Report {
    /// Another aircraft.
    Traffic(Traffic),
    /// A bound of a parameter.
    Limit(Limit),
    /// The own aircraft's 24-bit address.
    OwnAddress(u32),
}

/// Where a decoder puts what it has understood. A closure that takes signals is one that has no use for the rest.
pub trait Sink {
    /// One parameter.
    fn signal(&mut self, signal: Signal);

    /// Another aircraft.
    fn traffic(&mut self, traffic: &Traffic) {
        let _ = traffic;
    }

    /// A bound of a parameter.
    fn limit(&mut self, limit: &Limit) {
        let _ = limit;
    }

    /// The own aircraft's 24-bit address: whatever else is said of it is no other aircraft.
    fn own_address(&mut self, address: u32) {
        let _ = address;
    }
}

impl<F: FnMut(Signal)> Sink for F {
    fn signal(&mut self, signal: Signal) {
        self(signal);
    }
}
