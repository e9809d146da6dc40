//! Composition: the command line, the board file, the threads and the frame loop.

pub mod error;
pub mod list;

pub use error::{Failure, Kind};

/// Runs the program on the process's own arguments.
#[must_use]
pub fn main() -> std::process::ExitCode {
    std::process::ExitCode::SUCCESS
}
