//! The program: hands its arguments to [`glasswing::app::main`] and ends with the exit code it returns.

use std::process::ExitCode;

fn main() -> ExitCode {
    glasswing::app::main()
}
