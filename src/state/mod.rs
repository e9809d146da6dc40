//! Fused, validated flight state. Pure: signals and `now` in, a snapshot out.

pub mod attitude;
pub mod bounds;
pub mod compare;
pub mod crosscheck;
pub mod derive;
pub mod frozen;
pub mod fusion;
pub mod jump;
mod latch;
pub mod magnetic;
mod motion;
pub mod relation;
pub mod snapshot;
pub mod traffic;
mod trail;
mod witness;
mod wmm2025;

pub use fusion::Fusion;
pub use snapshot::{Compared, FlightState, Missing};
