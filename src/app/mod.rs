//! Composition: the command line, the board file, the threads and the frame loop.

pub mod board;
pub mod decode;
pub mod error;
pub mod figures;
pub mod flight;
pub mod frames;
pub mod health;
pub mod intake;
pub mod picture;
pub mod sources;

pub use error::{Failure, Kind};

/// Runs the program on the process's own arguments.
#[must_use]
pub fn main() -> std::process::ExitCode {
    std::process::ExitCode::SUCCESS
}
