//! Fused, validated flight state. Pure: signals and `now` in, a snapshot out.

pub mod fusion;
pub mod snapshot;

pub use fusion::Fusion;
pub use snapshot::FlightState;
