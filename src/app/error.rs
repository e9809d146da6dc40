//! Failures as the user meets them: one line that says what, why and what to do, the chain of causes, and an exit code.

use std::error::Error as StdError;
use std::fmt;
use std::process::ExitCode;

/// What kind of failure it is; its number is the program's exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Anything else.
    Other = 1,
    /// Wrong usage or configuration.
    Usage = 2,
    /// Input missing or damaged.
    Input = 3,
    /// A device refused.
    Device = 4,
}

/// A failure that ends the command. Displayed as `WHAT: WHY (WHAT TO DO)`.
#[derive(Debug)]
pub struct Failure {
    kind: Kind,
    what: String,
    why: String,
    todo: String,
    source: Option<Box<dyn StdError + Send + Sync>>,
}

impl Failure {
    /// `what` names the file, key, field or device; `why` says what is wrong with it; `todo` what the user can do.
    pub fn new(
        kind: Kind,
        what: impl fmt::Display,
        why: impl fmt::Display,
        todo: impl fmt::Display,
    ) -> Self {
        Self {
            kind,
            what: what.to_string(),
            why: why.to_string(),
            todo: todo.to_string(),
            source: None,
        }
    }

    /// The same with its cause, printed on a line of its own below.
    #[must_use]
    pub fn caused_by(mut self, cause: impl StdError + Send + Sync + 'static) -> Self {
        self.source = Some(Box::new(cause));
        self
    }

    /// The system has no room for another thread.
    #[must_use]
    pub fn no_thread(e: std::io::Error) -> Self {
        let todo = "stop other programs";
        Self::new(Kind::Other, "threads", "the system refuses one more", todo).caused_by(e)
    }

    /// Its kind.
    #[must_use]
    pub const fn kind(&self) -> Kind {
        self.kind
    }

    /// The exit code that belongs to it.
    #[must_use]
    pub fn exit_code(&self) -> ExitCode {
        ExitCode::from(self.kind as u8)
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {} ({})", self.what, self.why, self.todo)
    }
}

impl StdError for Failure {
    fn source(&self) -> Option<&(dyn StdError + 'static)> {
        self.source
            .as_deref()
            .map(|e| e as &(dyn StdError + 'static))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failure_reads_as_one_line() {
        let f = Failure::new(
            Kind::Input,
            "alps.pack",
            "tile 3 fails its checksum",
            "bake it again",
        );
        assert_eq!(
            f.to_string(),
            "alps.pack: tile 3 fails its checksum (bake it again)"
        );
    }
}
