//! A recording as a flight: its frames in the order of time, through the decoders and the fusion, on the recording's clock.
//!
//! The clock starts at the first frame. Where the recording's own clock is set back by more than a second, or says nothing
//! for more than a minute, the flight goes on at once, or after that minute: all values are flagged by then.

use crate::app::board::{self, Board};
use crate::app::capture_feed;
use crate::app::error::{Failure, Kind};
use crate::app::sources;
use crate::bus::{Decode, Tally};
use crate::proto::Protocol;
use crate::recording::{Damage, Event, Header, RecordingError, Source, Tape, Timed};
use crate::signal::{Frame, SourceId};
use crate::state::{FlightState, Fusion};
use crate::time::Monotonic;
use std::path::Path;
use std::time::Duration;

/// When the flight begins: some time after the start of the clock, so that nothing lies before that.
pub const START: Monotonic = Monotonic::from_nanos(1_000_000_000);
/// The longest silence.
const SILENCE_MAX: Duration = Duration::from_secs(60);
/// By how much a clock may go back without having been set.
const STRAGGLE_MAX: Duration = Duration::from_secs(1);
/// From the end of one session of a recording to the beginning of the next.
const BETWEEN_SESSIONS: Duration = Duration::from_secs(1);

/// A source that is played.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Played {
    /// Its name.
    pub name: String,
    /// What it speaks.
    pub protocol: Protocol,
    /// The text of a protocol file of FlightGear's, for fg-generic.
    pub layout: Option<String>,
}

/// A frame that is played.
#[derive(Clone, Debug, PartialEq)]
pub struct Item {
    /// When it was received, by the recording's clock.
    pub clock: Duration,
    /// Which start of the recording program it belongs to, from 0.
    pub session: usize,
    /// The sources that hear it.
    pub heard_by: Vec<usize>,
    /// What was received.
    pub event: Event,
}

/// Where frames come from.
#[derive(Debug)]
pub enum Feed {
    /// A recording of our own.
    Tape(Box<Tape>),
    /// Frames of a capture.
    Frames(std::vec::IntoIter<Item>),
}

/// What is played: sources of each session, and their frames.
#[derive(Debug)]
pub struct Reel {
    /// The sources of each session, the most trusted first.
    pub sessions: Vec<Vec<Played>>,
    /// For each source of each session of a tape the source under which its frames stand.
    pub(super) frames_of: Vec<Vec<usize>>,
    /// Their frames.
    pub feed: Feed,
    /// What the user is to know about it.
    pub notes: Vec<String>,
}

impl Reel {
    /// Opens a recording of any kind. `protocol`: what a capture speaks, where the board's sources do not tell; `baud`: the
    /// speed of a line whose bytes have no times.
    ///
    /// # Errors
    /// When it cannot be read, or nobody says what it speaks.
    pub fn open(
        path: &Path,
        board: &Board,
        protocol: Option<Protocol>,
        baud: Option<u32>,
    ) -> Result<Self, Failure> {
        if !path.is_file() || Tape::is_one(path) {
            return Self::of_tape(path, protocol);
        }
        capture_feed::open(path, board, protocol, baud)
    }

    fn of_tape(path: &Path, protocol: Option<Protocol>) -> Result<Self, Failure> {
        let tape = Tape::open(path)?;
        let sessions = tape.sessions().iter().map(|header| played(path, header));
        let sessions = sessions.collect::<Result<Vec<_>, _>>()?;
        if let Some(wanted) = protocol
            && let Some(other) = sessions.iter().flatten().find(|s| s.protocol != wanted)
        {
            let why = format!(
                "the recording says that {} speaks {}",
                other.name,
                other.protocol.name()
            );
            return Err(Failure::new(Kind::Usage, "--as", why, "leave it out"));
        }
        let frames_of = tape.sessions().iter().map(frames_of).collect();
        Ok(Self {
            sessions,
            frames_of,
            feed: Feed::Tape(Box::new(tape)),
            notes: Vec::new(),
        })
    }

    fn next(&mut self) -> Result<Option<Item>, Failure> {
        match &mut self.feed {
            Feed::Frames(frames) => Ok(frames.next()),
            Feed::Tape(tape) => {
                let Some(Timed { at, entry }) = tape.next_entry()? else {
                    return Ok(None);
                };
                let rows = self.frames_of.get(entry.session).into_iter().flatten();
                let heard_by = rows
                    .enumerate()
                    .filter(|(_, of)| Some(**of) == entry.source);
                Ok(Some(Item {
                    clock: Duration::from_nanos(at.as_nanos()),
                    session: entry.session,
                    heard_by: heard_by.map(|(source, _)| source).collect(),
                    event: entry.event,
                }))
            }
        }
    }

    fn damage(&self) -> Damage {
        match &self.feed {
            Feed::Frames(_) => Damage::default(),
            Feed::Tape(tape) => tape.damage(),
        }
    }
}

/// The sources that a recording names.
fn played(path: &Path, header: &Header) -> Result<Vec<Played>, Failure> {
    let source = |source: &Source| {
        let protocol = Protocol::by_name(&source.protocol).ok_or_else(|| {
            let why = format!(
                "its source {} speaks `{}`, which is unknown",
                source.name, source.protocol
            );
            let todo = "use the version of the program that recorded it, or a later one";
            Failure::new(Kind::Input, path.display(), why, todo)
        })?;
        Ok(Played {
            name: source.name.clone(),
            protocol,
            layout: source.layout.clone(),
        })
    };
    header.sources.iter().map(source).collect()
}

fn frames_of(header: &Header) -> Vec<usize> {
    let sources = header.sources.iter().enumerate();
    sources
        .map(|(own, source)| source.frames_of.map_or(own, usize::from))
        .collect()
}

impl From<RecordingError> for Failure {
    fn from(e: RecordingError) -> Self {
        let kind = match e {
            RecordingError::Held { .. } | RecordingError::Unwritable { .. } => Kind::Other,
            _ => Kind::Input,
        };
        let failure = Self::new(kind, e.path().display(), e.why(), e.todo());
        match e.into_source() {
            Some(source) => failure.caused_by(source),
            None => failure,
        }
    }
}

/// From the recording's clock to the flight's.
#[derive(Debug, Default)]
struct Clock {
    /// A time of the recording's clock and the flight's at the same moment, and the session.
    anchor: Option<(Duration, Monotonic, usize)>,
    latest: Option<Monotonic>,
    jumps: u64,
}

impl Clock {
    /// The flight's time of something received at `clock`.
    fn at(&mut self, clock: Duration, session: usize) -> Monotonic {
        let latest = self.latest.unwrap_or(START);
        let at = match self.anchor {
            Some((there, here, same)) if same == session => Self::shift(clock, there, here)
                .filter(|at| at.plus(STRAGGLE_MAX) >= latest && *at <= latest.plus(SILENCE_MAX)),
            _ => None,
        };
        let at = at.unwrap_or_else(|| {
            let here = match self.anchor {
                None => START,
                Some((_, _, same)) if same != session => latest.plus(BETWEEN_SESSIONS),
                Some((there, here, _)) => {
                    self.jumps += 1;
                    let ahead = Self::shift(clock, there, here).is_some_and(|at| at > latest);
                    if ahead {
                        latest.plus(SILENCE_MAX)
                    } else {
                        latest
                    }
                }
            };
            self.anchor = Some((clock, here, session));
            here
        });
        self.latest = Some(latest.max(at));
        at
    }

    fn shift(clock: Duration, there: Duration, here: Monotonic) -> Option<Monotonic> {
        match clock.checked_sub(there) {
            Some(later) => Some(here.plus(later)),
            None => {
                let earlier = u64::try_from((there - clock).as_nanos()).ok()?;
                here.as_nanos()
                    .checked_sub(earlier)
                    .map(Monotonic::from_nanos)
            }
        }
    }
}

/// Plays a reel.
pub struct Player {
    reel: Reel,
    clock: Clock,
    next: Option<(Monotonic, Item)>,
    session: usize,
    decoders: Vec<(Decode, Tally)>,
    fusion: Fusion,
    lost: u64,
    /// What is known of the recording's clock: a time of it, and the flight's at the same moment.
    heard: Option<(Duration, Monotonic)>,
    /// Counts of sessions that are over.
    past: Vec<(String, Tally)>,
}

impl std::fmt::Debug for Player {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Player")
            .field("reel", &self.reel)
            .finish_non_exhaustive()
    }
}

impl Player {
    /// At the beginning of a reel.
    ///
    /// # Errors
    /// When it cannot be read, or holds no frame.
    pub fn new(reel: Reel) -> Result<Self, Failure> {
        let mut player = Self {
            reel,
            clock: Clock::default(),
            next: None,
            session: 0,
            decoders: Vec::new(),
            fusion: Fusion::new(&[]),
            lost: 0,
            heard: None,
            past: Vec::new(),
        };
        player.begin(0);
        player.read()?;
        Ok(player)
    }

    /// Takes in everything received up to `now`, and gives the state then; times of successive calls never go back.
    ///
    /// # Errors
    /// When the recording cannot be read any more.
    pub fn state_at(&mut self, now: Monotonic) -> Result<FlightState, Failure> {
        while let Some((at, item)) = self.next.take_if(|(at, _)| *at <= now) {
            if item.session != self.session {
                self.begin(item.session);
            }
            self.heard = Some((item.clock, at));
            self.take(at, &item);
            self.read()?;
        }
        Ok(self.fusion.step(now))
    }

    /// Whether everything has been taken in.
    #[must_use]
    pub const fn is_over(&self) -> bool {
        self.next.is_none()
    }

    /// The sources that are heard now.
    #[must_use]
    pub fn sources(&self) -> &[Played] {
        self.reel
            .sessions
            .get(self.session)
            .map_or(&[], Vec::as_slice)
    }

    /// The recording's clock at a moment of the flight; None before the first frame.
    #[must_use]
    pub fn clock_at(&self, now: Monotonic) -> Option<Duration> {
        let (clock, at) = self.heard?;
        Some(clock + now.since(at).unwrap_or_default())
    }

    /// What the user is to know: how the recording was read, damage, jumps of its clock, frames that were dropped.
    #[must_use]
    pub fn notes(&self) -> Vec<String> {
        let mut notes = self.reel.notes.clone();
        notes.extend(self.reel.damage().told());
        if self.clock.jumps > 0 {
            let jumps = self.clock.jumps;
            notes.push(format!("its clock was set back, or silent for more than a minute, {jumps} times; the flight goes on there"));
        }
        if self.lost > 0 {
            notes.push(format!(
                "{} frames were dropped when it was recorded",
                self.lost
            ));
        }
        notes
    }

    /// What was made of the frames of each source, over all sessions, in order.
    #[must_use]
    pub fn tallies(&self) -> Vec<(String, Tally)> {
        let now = self.tallies_now();
        let mut all: Vec<(String, Tally)> = Vec::new();
        for (name, tally) in self.past.iter().cloned().chain(now) {
            match all.iter_mut().find(|(known, _)| *known == name) {
                Some((_, sum)) => add(sum, &tally),
                None => all.push((name, tally)),
            }
        }
        all
    }

    fn tallies_now(&self) -> impl Iterator<Item = (String, Tally)> {
        let names = self.sources().iter().map(|source| source.name.clone());
        names.zip(self.decoders.iter().map(|(_, tally)| *tally))
    }

    /// The program was started: decoders and fusion know nothing.
    fn begin(&mut self, session: usize) {
        let counted: Vec<_> = self.tallies_now().collect();
        self.past.extend(counted);
        self.session = session;
        let decoder = |source: &Played| {
            let decoder = board::decoder(source.protocol, source.layout.as_deref());
            (sources::decode(decoder, None), Tally::default())
        };
        self.decoders = self.sources().iter().map(decoder).collect();
        let protocols: Vec<_> = self
            .sources()
            .iter()
            .map(|source| source.protocol)
            .collect();
        self.fusion = sources::fusion(protocols);
    }

    fn read(&mut self) -> Result<(), Failure> {
        self.next = self
            .reel
            .next()?
            .map(|item| (self.clock.at(item.clock, item.session), item));
        Ok(())
    }

    fn take(&mut self, at: Monotonic, item: &Item) {
        if let Event::Lost(frames) = item.event {
            self.lost += frames;
        }
        let Some(wire) = item.event.wire() else {
            return;
        };
        for &source in &item.heard_by {
            let Some((decode, tally)) = self.decoders.get_mut(source) else {
                continue;
            };
            let frame = Frame {
                at,
                source: id(source),
                wire,
            };
            *tally = decode(frame, &mut self.fusion);
        }
    }
}

fn id(source: usize) -> SourceId {
    SourceId(u8::try_from(source).unwrap_or(u8::MAX))
}

fn add(sum: &mut Tally, more: &Tally) {
    sum.good += more.good;
    sum.ignored += more.ignored;
    for (sum, more) in sum.bad.iter_mut().zip(more.bad) {
        *sum += more;
    }
}
