//! Standard output. A reader that has gone away (`glasswing terrain info X | head -1`) is no failure, and no panic; a full
//! disk is one, told once at the end.

use crate::app::error::{Failure, Kind};
use std::fmt;
use std::io::{self, Write as _};
use std::sync::OnceLock;

/// The first write that failed for another reason than a reader that has gone.
static FAILED: OnceLock<io::Error> = OnceLock::new();

/// Writes formatted text to standard output.
pub fn write(text: fmt::Arguments<'_>) {
    let mut stdout = io::stdout().lock();
    if let Err(e) = stdout.write_fmt(text).and_then(|()| stdout.flush())
        && e.kind() != io::ErrorKind::BrokenPipe
    {
        // Only the first one says what happened.
        let _ = FAILED.set(e);
    }
}

/// Writes a line to standard output; takes what `println!` takes.
macro_rules! say {
    ($($text:tt)*) => {
        $crate::app::out::write(format_args!("{}\n", format_args!($($text)*)))
    };
}
pub(crate) use say;

/// What has become of everything written so far.
///
/// # Errors
/// When some of it could not be written (1).
pub fn outcome() -> Result<(), Failure> {
    FAILED.get().map_or(Ok(()), |e| {
        let todo = "check the room on the disk it goes to";
        Err(Failure::new(Kind::Other, "standard output", e, todo))
    })
}
