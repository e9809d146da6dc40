//! Why a recording cannot be made or read, in words that say what to do.

use std::io;
use std::path::PathBuf;

/// Why a recording cannot be made or read. Displayed as `WHAT: WHY (WHAT TO DO)`.
#[derive(Debug, thiserror::Error)]
#[error("{}: {} ({})", self.path().display(), self.why(), self.todo())]
pub enum RecordingError {
    /// There is no such file.
    Missing {
        /// The file.
        path: PathBuf,
    },
    /// The file cannot be read.
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// It is something else, or its header is damaged, and so are those of all files of its set.
    NotARecording {
        /// The file.
        path: PathBuf,
    },
    /// A later version of this program has written it.
    Version {
        /// The file.
        path: PathBuf,
        /// Its version.
        version: u16,
    },
    /// Another program records into it.
    Held {
        /// The file.
        path: PathBuf,
    },
    /// It cannot be written.
    Unwritable {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

impl RecordingError {
    /// The file.
    #[must_use]
    pub const fn path(&self) -> &PathBuf {
        match self {
            Self::Missing { path }
            | Self::Unreadable { path, .. }
            | Self::NotARecording { path }
            | Self::Version { path, .. }
            | Self::Held { path }
            | Self::Unwritable { path, .. } => path,
        }
    }

    /// What is wrong.
    #[must_use]
    pub fn why(&self) -> String {
        match self {
            Self::Missing { .. } => "there is no such recording".to_owned(),
            Self::Unreadable { .. } => "it cannot be read".to_owned(),
            Self::NotARecording { .. } => {
                "it is no recording of Glasswing, or its header is damaged".to_owned()
            }
            Self::Version { version, .. } => {
                format!("its version {version} is not known to this program")
            }
            Self::Held { .. } => "another program records into it".to_owned(),
            Self::Unwritable { .. } => "it cannot be written".to_owned(),
        }
    }

    /// What the user can do.
    #[must_use]
    pub const fn todo(&self) -> &'static str {
        match self {
            Self::Missing { .. } => "give the name that it was recorded under",
            Self::Unreadable { .. } => "check its rights and the disk",
            Self::NotARecording { .. } => "give another file name",
            Self::Version { .. } => "use the version that wrote it, or a later one",
            Self::Held { .. } => "stop it, or give another file name",
            Self::Unwritable { .. } => "check the folder, its rights and the room on the disk",
        }
    }

    /// What the system said, if it was asked.
    #[must_use]
    pub fn into_source(self) -> Option<io::Error> {
        match self {
            Self::Unreadable { source, .. } | Self::Unwritable { source, .. } => Some(source),
            _ => None,
        }
    }
}
