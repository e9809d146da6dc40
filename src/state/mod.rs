//! Fused, validated flight state. Pure: signals and `now` in, a snapshot out.

pub mod snapshot;

pub use snapshot::FlightState;
