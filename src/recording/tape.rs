//! Reads a whole recording, all its files as one, in the order of time.

use super::error::RecordingError;
use super::format::{Beginning, Header, Kind, MAGIC, NO_SOURCE, Record};
use super::part::{Damage, Part};
use super::set;
use crate::signal::{CanData, Wire};
use crate::time::Monotonic;
use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};
use std::fs::File;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

/// Records that wait for a mark at most: a recording without marks is damaged, and need not be kept in memory whole.
const WAITING_MAX: usize = 1 << 16;

/// What happened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// A CAN frame was received.
    Can(CanData),
    /// A datagram was received.
    Datagram(Vec<u8>),
    /// Bytes of a serial line were received; none at all: the line was interrupted.
    Stream(Vec<u8>),
    /// So many frames were dropped.
    Lost(u64),
    /// Nothing: time has passed.
    Mark,
}

impl Event {
    /// What was on the wire.
    #[must_use]
    pub fn wire(&self) -> Option<Wire<'_>> {
        match self {
            Self::Can(can) => Some(Wire::Can(*can)),
            Self::Datagram(bytes) => Some(Wire::Datagram(bytes)),
            Self::Stream(bytes) => Some(Wire::Stream(bytes)),
            Self::Lost(_) | Self::Mark => None,
        }
    }
}

/// What happened to which source.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Which of [`Tape::sessions`] it belongs to.
    pub session: usize,
    /// Index of the source in the session's header; `None` for a mark.
    pub source: Option<usize>,
    /// What happened.
    pub event: Event,
}

/// An entry and its time, by the session's own clock.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Timed {
    /// When it was received.
    pub at: Monotonic,
    /// What.
    pub entry: Entry,
}

/// An entry that waits for its turn; of entries of the same time the one that was written first is first.
#[derive(Debug)]
struct Waiting {
    turn: Reverse<(Monotonic, u64)>,
    timed: Timed,
}

impl PartialEq for Waiting {
    fn eq(&self, other: &Self) -> bool {
        self.turn == other.turn
    }
}

impl Eq for Waiting {}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Waiting {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.turn.cmp(&other.turn)
    }
}

/// A recording that is being read. What is received within a session comes in the order of time, but for stragglers.
#[derive(Debug)]
pub struct Tape {
    path: PathBuf,
    sessions: Vec<Header>,
    /// Files that are still to be read, each with its session.
    parts: VecDeque<(usize, Part<File>)>,
    waiting: BinaryHeap<Waiting>,
    /// Everything up to this time may go out.
    released: Option<Monotonic>,
    records: u64,
    damage: Damage,
}

impl Tape {
    /// Whether a file begins as one of a recording does, or is not there while full files of its set are.
    #[must_use]
    pub fn is_one(path: &Path) -> bool {
        let begins = |path: &Path| {
            let mut magic = [0; MAGIC.len()];
            let read = File::open(path).and_then(|mut file| file.read_exact(&mut magic));
            read.is_ok() && magic == MAGIC
        };
        let of_set = |(_, path): &(u32, PathBuf)| begins(path);
        begins(path) || (!path.exists() && set::fulls(path).is_ok_and(|all| all.iter().any(of_set)))
    }

    /// Opens a recording with all files of its set.
    ///
    /// # Errors
    /// When there is none, or no file of it has a good header.
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        let path = path.to_owned();
        let unreadable = |path: &Path, source| RecordingError::Unreadable {
            path: path.to_owned(),
            source,
        };
        let files = set::all(&path).map_err(|e| unreadable(&path, e))?;
        if files.is_empty() {
            return Err(RecordingError::Missing { path });
        }
        let mut tape = Self {
            path: path.clone(),
            sessions: Vec::new(),
            parts: VecDeque::new(),
            waiting: BinaryHeap::new(),
            released: None,
            records: 0,
            damage: Damage::default(),
        };
        let mut last = None;
        for file in files {
            let opened = File::open(&file).and_then(Part::open);
            match opened.map_err(|e| unreadable(&file, e))? {
                (Beginning::Header(header, _), part) => {
                    if last != Some(header.session) {
                        last = Some(header.session);
                        tape.sessions.push(header.header);
                    }
                    tape.parts.push_back((tape.sessions.len() - 1, part));
                }
                (Beginning::Version(version), _) => {
                    return Err(RecordingError::Version {
                        path: file,
                        version,
                    });
                }
                (Beginning::Damaged, _) => tape.damage.headers += 1,
            }
        }
        if tape.sessions.is_empty() {
            return Err(RecordingError::NotARecording { path });
        }
        Ok(tape)
    }

    /// What was listened to, each time that the program was started to record.
    #[must_use]
    pub fn sessions(&self) -> &[Header] {
        &self.sessions
    }

    /// What has been found damaged; complete once there is no next entry.
    #[must_use]
    pub const fn damage(&self) -> Damage {
        self.damage
    }

    /// The next entry; `None` at the end.
    ///
    /// # Errors
    /// When a file cannot be read any more.
    pub fn next_entry(&mut self) -> Result<Option<Timed>, RecordingError> {
        loop {
            if let Some(first) = self.waiting.peek()
                && let Reverse((at, _)) = first.turn
                && (self.released.is_some_and(|released| at <= released)
                    || self.waiting.len() > WAITING_MAX)
            {
                return Ok(self.waiting.pop().map(|waiting| waiting.timed));
            }
            if !self.read().map_err(|source| RecordingError::Unreadable {
                path: self.path.clone(),
                source,
            })? {
                return Ok(None);
            }
        }
    }

    /// Takes in a record. False at the end.
    fn read(&mut self) -> io::Result<bool> {
        let Some((session, part)) = self.parts.front_mut() else {
            // Nothing more will come: what waits goes out.
            self.released = Some(Monotonic::from_nanos(u64::MAX));
            return Ok(!self.waiting.is_empty());
        };
        let session = *session;
        let Some(record) = part.next()? else {
            let ended = self.parts.front().map(|(_, part)| part.damage());
            let goes_on = self.parts.get(1).is_some_and(|(next, _)| *next == session);
            // Each session has its own clock: nothing of one waits for the marks of another.
            if !goes_on && !self.waiting.is_empty() && self.released != Some(END) {
                self.released = Some(END);
                return Ok(true);
            }
            self.damage.add(ended.unwrap_or_default());
            self.parts.pop_front();
            if !goes_on {
                self.released = None;
            }
            return Ok(true);
        };
        let Some(event) = event(&record) else {
            return Ok(true);
        };
        let at = record.at;
        let timed = Timed {
            at,
            entry: Entry {
                session,
                source: (record.source != NO_SOURCE).then_some(usize::from(record.source)),
                event,
            },
        };
        if record.kind == Kind::Mark {
            self.released = self.released.max(Some(at));
        }
        self.records += 1;
        self.waiting.push(Waiting {
            turn: Reverse((at, self.records)),
            timed,
        });
        Ok(true)
    }
}

/// Later than everything.
const END: Monotonic = Monotonic::from_nanos(u64::MAX);

/// What a record says; None for a record of this version that says nothing that can be.
fn event(record: &Record<'_>) -> Option<Event> {
    match record.kind {
        Kind::Mark => Some(Event::Mark),
        Kind::Lost => Some(Event::Lost(u64::from_le_bytes(
            record.payload.try_into().ok()?,
        ))),
        Kind::Can | Kind::Datagram | Kind::Stream => match record.wire()? {
            Wire::Can(can) => Some(Event::Can(can)),
            Wire::Datagram(bytes) => Some(Event::Datagram(bytes.to_owned())),
            Wire::Stream(bytes) => Some(Event::Stream(bytes.to_owned())),
        },
    }
}
