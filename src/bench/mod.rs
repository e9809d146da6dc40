//! The bench: what sensors would send for a flight, in every protocol, and what can go wrong with it. Pure.
//!
//! A [`Truth`] says what the sensors of an aircraft have to say at one moment; an [`encode::Encoder`] turns it into the frames
//! of its protocol, at their usual rates. [`Bench`] puts them on one clock.
//!
//! ```
//! use glasswing::bench::{Bench, Truth, encode};
//! use glasswing::proto::Protocol;
//! use glasswing::signal::Parameter;
//! use std::time::Duration;
//!
//! let mut bench = Bench::new(encode::encoder(Protocol::Gdl90), Vec::new(), 1)?;
//! let mut truth = Truth::nothing();
//! truth.set(Parameter::Pitch, Ok(0.1));
//! let mut frames = 0;
//! while bench.next() < Duration::from_secs(1) {
//!     bench.step(&truth, &mut |_wire| frames += 1);
//! }
//! assert!(frames > 20, "attitude alone comes 25 times a second");
//! # Ok::<(), glasswing::bench::fault::FaultError>(())
//! ```

pub mod encode;
pub mod fault;
pub mod flight;
pub mod profile;
mod run;
mod sensors;
mod truth;

pub use run::Bench;
pub use truth::{Aircraft, Truth};
