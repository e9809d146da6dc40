//! Captures of other programs as flights: candump logs, UDP capture containers, raw bytes of serial lines.
//!
//! Who hears a capture is told by `--as`, or by the board's sources where only one of them can. Raw bytes have no times:
//! they are played as a line at the source's speed would bring them without a pause, ten bits a byte (8N1).

use crate::app::board::{Board, Endpoint, SourceWish};
use crate::app::error::{Failure, Kind};
use crate::app::playback::{Feed, Item, Played, Reel};
use crate::proto::capture::{CandumpLine, CaptureError, UdpCapture};
use crate::proto::{Carriage, Protocol};
use crate::recording::Event;
use std::path::Path;
use std::time::Duration;

/// Bytes of a raw capture that come together: as a UART of a computer passes them on.
const PIECE_BYTES: usize = 32;

/// What a capture is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    Candump,
    Container,
    Raw,
}

impl Form {
    fn of(bytes: &[u8], protocol: Option<Protocol>) -> Self {
        let mut lines = bytes.split(|&b| b == b'\n').take(100);
        let is_candump = lines.any(|line| {
            let line = std::str::from_utf8(line).map(CandumpLine::parse);
            matches!(line, Ok(CandumpLine::Data(..) | CandumpLine::NoData))
        });
        match protocol.map(Protocol::carriage) {
            Some(Carriage::Can) => Self::Candump,
            Some(Carriage::Packets) => Self::Container,
            None if is_candump => Self::Candump,
            _ if UdpCapture::is_one(bytes) => Self::Container,
            _ => Self::Raw,
        }
    }

    const fn told(self) -> &'static str {
        match self {
            Self::Candump => "a candump log",
            Self::Container => "a UDP capture",
            Self::Raw => "raw bytes",
        }
    }

    /// Whether a source may have sent it.
    fn fits(self, source: &SourceWish) -> bool {
        match self {
            Self::Candump => source.protocol.carriage() == Carriage::Can,
            Self::Container => matches!(source.endpoint, Endpoint::Udp { .. }),
            Self::Raw => source.protocol.carriage() == Carriage::Stream,
        }
    }
}

/// Opens a capture. See [`Reel::open`].
///
/// # Errors
/// When it cannot be read, holds nothing, or nobody says what it speaks.
pub fn open(
    path: &Path,
    board: &Board,
    protocol: Option<Protocol>,
    baud: Option<u32>,
) -> Result<Reel, Failure> {
    let bytes = std::fs::read(path).map_err(|e| {
        let todo = "name a recording that can be read";
        Failure::new(Kind::Input, path.display(), "it cannot be read", todo).caused_by(e)
    })?;
    let form = Form::of(&bytes, protocol);
    let sources = sources(path, board, form, protocol)?;
    let mut notes = Vec::new();
    let frames = match form {
        Form::Candump => candump(&bytes, &sources, &mut notes),
        Form::Container => container(&bytes, &mut notes),
        Form::Raw => raw(&bytes, speed(&sources, baud), &mut notes),
    };
    if frames.is_empty() {
        let why = format!("it holds no frame of {}", form.told());
        let todo = "record it again, or say with --as what it speaks";
        return Err(Failure::new(Kind::Input, path.display(), why, todo));
    }
    let played = sources.into_iter().map(|source| Played {
        name: source.name,
        protocol: source.protocol,
        layout: source.layout,
    });
    Ok(Reel {
        sessions: vec![played.collect()],
        frames_of: Vec::new(),
        feed: Feed::Frames(frames.into_iter()),
        notes,
    })
}

/// Who hears it.
fn sources(
    path: &Path,
    board: &Board,
    form: Form,
    protocol: Option<Protocol>,
) -> Result<Vec<SourceWish>, Failure> {
    let fitting = || {
        board
            .sources
            .iter()
            .filter(|source| form.fits(source))
            .cloned()
    };
    if let Some(protocol) = protocol {
        let known = fitting().find(|source| source.protocol == protocol);
        let known = known.or_else(|| {
            board
                .sources
                .iter()
                .find(|s| s.protocol == protocol)
                .cloned()
        });
        return Ok(vec![known.unwrap_or_else(|| stranger(protocol))]);
    }
    let mut found: Vec<SourceWish> = fitting().collect();
    if form == Form::Raw
        && found
            .iter()
            .any(|s| matches!(s.endpoint, Endpoint::Serial { .. }))
    {
        found.retain(|source| matches!(source.endpoint, Endpoint::Serial { .. }));
    }
    let is_told = match form {
        Form::Candump => !found.is_empty(),
        _ => found.len() == 1,
    };
    if is_told {
        return Ok(found);
    }
    let file = board.file.display();
    let why = match found.len() {
        0 => format!(
            "it is {}, and no source of {file} can have sent it",
            form.told()
        ),
        n => format!(
            "it is {}, and {n} sources of {file} can have sent it",
            form.told()
        ),
    };
    let todo = "say with --as which protocol it is";
    Err(Failure::new(Kind::Usage, path.display(), why, todo))
}

/// A source that the board does not have.
fn stranger(protocol: Protocol) -> SourceWish {
    SourceWish {
        name: protocol.name().to_owned(),
        protocol,
        layout: None,
        endpoint: Endpoint::Can {
            interface: String::new(),
        },
    }
}

/// Bits per second of the line that raw bytes came over.
fn speed(sources: &[SourceWish], baud: Option<u32>) -> (u32, &'static str) {
    let source = sources.first();
    match (baud, source.map(|source| &source.endpoint)) {
        (Some(baud), _) => (baud, "given with --baud"),
        (None, Some(Endpoint::Serial { baud, .. })) => (*baud, "the board's"),
        _ => {
            let protocol = source.map(|source| source.protocol);
            let usual = match protocol {
                Some(Protocol::Nmea) => 4800,    // NMEA 0183
                Some(Protocol::Ubx) => 9600,     // u-blox receivers up to series 8
                Some(Protocol::Gdl90) => 38_400, // GDL 90 Data Interface Specification, section 2.1
                _ => 115_200,
            };
            (usual, "usual for the protocol")
        }
    }
}

fn raw(bytes: &[u8], (baud, why): (u32, &str), notes: &mut Vec<String>) -> Vec<Item> {
    notes.push(format!(
        "raw bytes have no times: they are played as a line at {baud} baud ({why}) brings them without a pause, which may be \
         quicker than they came"
    ));
    let mut end = 0_u64;
    let item = |piece: &[u8]| {
        end += piece.len() as u64;
        let nanos = u128::from(end) * 10_000_000_000 / u128::from(baud.max(1));
        Item {
            clock: Duration::from_nanos(u64::try_from(nanos).unwrap_or(u64::MAX)),
            session: 0,
            heard_by: vec![0],
            event: Event::Stream(piece.to_owned()),
        }
    };
    bytes.chunks(PIECE_BYTES).map(item).collect()
}

fn container(bytes: &[u8], notes: &mut Vec<String>) -> Vec<Item> {
    let mut items = Vec::new();
    for record in UdpCapture::new(bytes) {
        match record {
            Ok((seconds, payload)) => items.push(Item {
                clock: clock(seconds),
                session: 0,
                heard_by: vec![0],
                event: Event::Datagram(payload.to_owned()),
            }),
            Err(damage @ CaptureError::Truncated { .. }) => notes.push(damage.to_string()),
            Err(damage @ CaptureError::NotARecord { .. }) => {
                notes.push(format!("{damage}; nothing after it can be read"));
            }
        }
    }
    items
}

fn candump(bytes: &[u8], sources: &[SourceWish], notes: &mut Vec<String>) -> Vec<Item> {
    let listens_to = |source: &SourceWish, interface: &str| matches!(&source.endpoint, Endpoint::Can { interface: own } if own == interface);
    let mut lines = Vec::new();
    let mut malformed = 0_u64;
    for line in bytes.split(|&b| b == b'\n') {
        let text = std::str::from_utf8(line).unwrap_or("?");
        match CandumpLine::parse(text) {
            CandumpLine::Data(seconds, can) => {
                let interface = text.split_ascii_whitespace().nth(1).unwrap_or_default();
                lines.push((seconds, interface, can));
            }
            CandumpLine::Malformed => malformed += 1,
            CandumpLine::Blank | CandumpLine::NoData => {}
        }
    }
    if malformed > 0 {
        notes.push(format!(
            "{malformed} lines are none of a candump log and were skipped"
        ));
    }
    let named = |interface: &str| sources.iter().any(|source| listens_to(source, interface));
    // A log of a bus with another name is heard by all.
    let by_name = lines.iter().any(|(_, interface, _)| named(interface));
    if !by_name && sources.len() > 1 {
        notes.push("no source is on an interface that it names: all on CAN hear it".to_owned());
    }
    let item = |(seconds, interface, can): (f64, &str, _)| {
        let hears = |source: &SourceWish| !by_name || listens_to(source, interface);
        let hearing = sources
            .iter()
            .enumerate()
            .filter(|(_, source)| hears(source));
        Item {
            clock: clock(seconds),
            session: 0,
            heard_by: hearing.map(|(i, _)| i).collect(),
            event: Event::Can(can),
        }
    };
    lines.into_iter().map(item).collect()
}

fn clock(seconds: f64) -> Duration {
    Duration::try_from_secs_f64(seconds).unwrap_or_default()
}
