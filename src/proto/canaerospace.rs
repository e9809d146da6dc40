//! CANaerospace 1.7 (Stock Flight Systems, interface specification revision 1.7, 12 January 2006): decoder and encoder.
//!
//! A data frame is (section 2): byte 0 node, byte 1 data type, byte 2 service code, byte 3 message code, bytes 4 to 7 the
//! value, big-endian. Identifiers, units and signs are those of the standard's default distribution (section 4). Sentinel:
//! data type NODATA (no value) or ERROR (failed); both become [`Invalid::SourceFailed`].
//!
//! What is taken:
//! - 11-bit identifiers, and 29-bit identifiers of which bits 16 to 23 are a redundancy channel (section 7) and all others
//!   above the lowest eleven are zero. 11-bit identifiers are of channel 0.
//! - Service code 0. Other service codes say that the frame is not the plain value, except where the standard puts the
//!   number of a waypoint there; such frames are ignored.
//! - FLOAT for every identifier, and the whole numbers that say their own size (CHAR, UCHAR, SHORT, USHORT, LONG, ULONG) in the
//!   identifier's unit. Latitude and longitude of the aircraft come as FLOAT, as DOUBLEH and DOUBLEL (the two halves of a
//!   64-bit number in two frames), which the standard lists for them, and as LONG in units of 1e-7 degree, which it does not
//!   list but which the CANaerospace devices of the gliding world send (XCSoar's driver `CANaerospace` reads nothing else). A
//!   FLOAT latitude has a resolution of 0.4 m; the others are better than 0.02 m. UTC comes as CHAR4 or UCHAR4.
//! - SHORT2 and USHORT2 are suggested by the standard beside FLOAT, but their scale is left to the system's designer. It is
//!   not guessed: such a frame is counted under [`Fault::Type`] and gives no value. So are bits and letters.
//!
//! A frame of the type NODATA has four bytes. Senders that leave the header empty (node, type, service and message code all
//! zero, as in logs written by hand) send eight: what their value is, and whether it is one, they do not say. Such a frame is
//! counted under [`Fault::Long`] and gives no value.
//!
//! Identifier 321, "heading angle", does not say which north. It is taken as the third Euler angle beside pitch and roll,
//! from true north, but only while there is no 1133, "true heading", which does say; magnetic heading has its own, 1069.
//! Wind direction, 334, is taken as true like it. In the same way 329 stands in for 328, 335 for 324, 1042 for 1007, and ECS
//! channel B of an engine for channel A. Not read: 330, of which two copies of the standard say different things (density
//! altitude, decision altitude); pump flow, which is no consumption; angles whose sign or north is not said.
//!
//! Redundant nodes (section 7) send the same identifier with different node numbers or redundancy channels. The first heard is
//! listened to; the others are ignored until it fails, freezes or falls silent for the parameter's greatest age.
//!
//! The message code counts a sender's messages per identifier, modulo 256. Gaps, repetitions and frozen frames are noted in
//! [`Flow`](super::Flow). They are notes only: many senders never count. But a frame numbered before the last one is late and
//! is ignored; and a sender that has counted and whose code then stands still for longer than the parameter's greatest age is
//! stuck: its values become [`Invalid::Frozen`], and a redundant node may take over.

mod table;

pub use table::IDS;

use super::{Counters, Decoder, Fault};
use crate::sampled::Invalid;
use crate::signal::{CanData, Frame, Parameter, Signal, Sink, SourceId, Wire};
use crate::time::Monotonic;
use std::time::Duration;
use table::{ROWS, Row, Scale};

/// Data types of the standard's table 2.2 that are used here.
mod data_type {
    pub(super) const NODATA: u8 = 0;
    pub(super) const ERROR: u8 = 1;
    pub(super) const FLOAT: u8 = 2;
    pub(super) const LONG: u8 = 3;
    pub(super) const ULONG: u8 = 4;
    pub(super) const SHORT: u8 = 6;
    pub(super) const USHORT: u8 = 7;
    pub(super) const CHAR: u8 = 9;
    pub(super) const UCHAR: u8 = 10;
    pub(super) const CHAR4: u8 = 15;
    pub(super) const UCHAR4: u8 = 16;
    pub(super) const DOUBLEH: u8 = 30;
    pub(super) const DOUBLEL: u8 = 31;
}

/// Bytes before the value.
const HEADER_BYTES: usize = 4;

/// The longest time between the two halves of a number. Two 8-byte frames back to back take 2 ms on the slowest usual bus
/// (125 kbit/s); a receiver sends a position every 50 ms at best, so halves of different positions do not meet.
const PAIR_AGE_MAX: Duration = Duration::from_millis(10);

/// Degrees per unit of a LONG latitude or longitude.
const LONG_DEGREES: f64 = 1e-7;

/// Bits of a 29-bit identifier that are no redundancy channel and have to be zero.
const NEITHER_ID_NOR_CHANNEL: u32 = 0x1F00_F800;

/// A frame is late when its message code is at most so many before the last one; farther back is a restart.
const LATE_MAX: u8 = 8;

/// A larger step of the message code than this is taken as a restart of the sender, not as lost frames.
const LOST_MAX: u8 = 128;

/// What is remembered of one identifier: the node that is listened to, and its last frame.
#[derive(Clone, Copy, Debug, Default)]
struct Heard {
    last: Option<Last>,
    /// The upper half of a 64-bit number that waits for its lower half.
    high: Option<High>,
}

/// Who sends: a redundancy channel and a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Sender {
    channel: u8,
    node: u8,
}

#[derive(Clone, Copy, Debug)]
struct Last {
    at: Monotonic,
    sender: Sender,
    code: u8,
    content: [u8; 4],
    /// Whether the code has ever moved: some senders do not count.
    counts: bool,
    /// Since when the code has stood where it is.
    code_since: Monotonic,
    /// Whether it held a value that could be used; a redundant node may take over when not.
    usable: bool,
}

#[derive(Clone, Copy, Debug)]
struct High {
    at: Monotonic,
    code: u8,
    bits: u32,
}

/// The decoder. Memory: what was last heard of each identifier, fixed.
#[derive(Debug)]
pub struct CanAerospace {
    counters: Counters,
    heard: [Heard; ROWS.len()],
    /// When each parameter last came by its own identifier rather than by a stand-in.
    primary_at: [Option<Monotonic>; Parameter::COUNT],
}

impl Default for CanAerospace {
    fn default() -> Self {
        Self::new()
    }
}

/// What a value frame holds.
enum Content {
    /// A number in wire units.
    Number(f64),
    /// The upper half of one; the lower half is to follow.
    Half,
    /// The sender's own statement that it has none.
    Failed,
}

impl CanAerospace {
    /// A decoder that has heard nothing.
    #[must_use]
    pub const fn new() -> Self {
        const NOT_HEARD: Heard = Heard {
            last: None,
            high: None,
        };
        Self {
            counters: Counters {
                good: 0,
                bad: [0; Fault::ALL.len()],
                ignored: 0,
                flow: super::Flow {
                    lost: 0,
                    repeated: 0,
                    frozen: 0,
                    failed: 0,
                    refused: 0,
                    unchecked: 0,
                    alarms: 0,
                    late: 0,
                },
            },
            heard: [NOT_HEARD; ROWS.len()],
            primary_at: [None; Parameter::COUNT],
        }
    }

    fn take(&mut self, at: Monotonic, source: SourceId, can: &CanData, row: usize) -> Taken {
        let bytes = can.bytes();
        if bytes.len() < HEADER_BYTES {
            return Taken::Bad(Fault::Short);
        }
        let [node, _, service, code, ..] = can.data;
        let channel = can.id.to_be_bytes()[1];
        let sender = Sender { channel, node };
        let age_max = ROWS[row].parameter.spec().age_max;
        let recent = self.heard[row]
            .last
            .filter(|last| at.since(last.at).is_none_or(|age| age <= age_max));
        let other_is_alive = recent.is_some_and(|last| last.sender != sender && last.usable);
        let is_service = service != 0 && !ROWS[row].is_of_waypoint;
        if is_service || other_is_alive {
            return Taken::Ignored;
        }
        if recent.is_some_and(|last| {
            last.sender == sender && (1..=LATE_MAX).contains(&last.code.wrapping_sub(code))
        }) {
            self.counters.flow.late += 1;
            return Taken::Ignored;
        }
        let content = match self.heard[row].content(at, can, ROWS[row].scale) {
            Ok(content) => content,
            Err(fault) => return Taken::Bad(fault),
        };
        let failed = matches!(content, Content::Failed);
        self.note_flow(row, at, sender, can, failed);
        // A number that stands still brings nothing new: what comes under it is as old as its first frame.
        let mut frozen = false;
        if let Some(last) = &mut self.heard[row].last {
            let standing = at.since(last.code_since);
            frozen = last.counts && standing.is_some_and(|d| d > age_max);
            last.usable &= !frozen;
        }
        let value = match content {
            Content::Half => return Taken::Good(None),
            Content::Failed => Err(Invalid::SourceFailed),
            Content::Number(_) if frozen => Err(Invalid::Frozen),
            Content::Number(x) => Ok(x),
        };
        let taken = self.verdict(at, source, row, value);
        if let (Taken::Impossible(..), Some(last)) = (&taken, &mut self.heard[row].last) {
            last.usable = false;
        }
        taken
    }

    /// The signal that a number or a failure makes, unless it is a stand-in's and the primary is alive.
    fn verdict(
        &mut self,
        at: Monotonic,
        source: SourceId,
        row: usize,
        wire: Result<f64, Invalid>,
    ) -> Taken {
        let Row {
            parameter,
            scale,
            stands_in,
            ..
        } = ROWS[row];
        let value = wire.and_then(|x| parameter.check(scale.to_si(x)));
        let primary_at = &mut self.primary_at[parameter.index()];
        if !stands_in {
            *primary_at = value.is_ok().then_some(at);
        } else if primary_at.is_some_and(|t| {
            at.since(t)
                .is_none_or(|age| age <= parameter.spec().age_max)
        }) {
            return Taken::Good(None);
        }
        let signal = Signal {
            at,
            source,
            parameter,
            value,
        };
        match (value, wire) {
            (Err(Invalid::OutOfRange), Ok(x)) if x.is_finite() => {
                Taken::Impossible(Fault::OutOfRange, signal)
            }
            (Err(Invalid::OutOfRange), _) => Taken::Impossible(Fault::NotFinite, signal),
            _ => Taken::Good(Some(signal)),
        }
    }

    /// Compares the message code with the last one of this identifier and remembers it.
    fn note_flow(
        &mut self,
        row: usize,
        at: Monotonic,
        sender: Sender,
        can: &CanData,
        failed: bool,
    ) {
        let [_, _, _, code, content @ ..] = can.data;
        let flow = &mut self.counters.flow;
        if failed {
            flow.failed += 1;
        }
        let (mut counts, mut code_since) = (false, at);
        if let Some(last) = self.heard[row].last.filter(|last| last.sender == sender) {
            counts = last.counts || code != last.code;
            if code == last.code {
                code_since = last.code_since;
            }
            match code.wrapping_sub(last.code) {
                0 => {
                    flow.repeated += 1;
                    if last.content == content {
                        flow.frozen += 1;
                    }
                }
                step @ 2..=LOST_MAX => flow.lost += u64::from(step) - 1,
                _ => {}
            }
        }
        self.heard[row].last = Some(Last {
            at,
            sender,
            code,
            content,
            counts,
            code_since,
            usable: !failed,
        });
    }
}

enum Taken {
    Good(Option<Signal>),
    Impossible(Fault, Signal),
    Bad(Fault),
    Ignored,
}

impl Decoder for CanAerospace {
    fn push(&mut self, frame: Frame<'_>, sink: &mut dyn Sink) {
        let Wire::Can(can) = frame.wire else {
            self.counters.ignored += 1;
            return;
        };
        let id = match can.extended {
            true if can.id & NEITHER_ID_NOR_CHANNEL != 0 => u32::MAX,
            true => can.id & 0x7FF,
            false => can.id,
        };
        let row = u16::try_from(id)
            .ok()
            .and_then(|id| IDS.binary_search(&id).ok());
        let Some(row) = row else {
            self.counters.ignored += 1;
            return;
        };
        match self.take(frame.at, frame.source, &can, row) {
            Taken::Good(signal) => {
                self.counters.count(None);
                if let Some(signal) = signal {
                    sink.signal(signal);
                }
            }
            Taken::Impossible(fault, signal) => {
                self.counters.count(Some(fault));
                sink.signal(signal);
            }
            Taken::Bad(fault) => self.counters.count(Some(fault)),
            Taken::Ignored => self.counters.ignored += 1,
        }
    }

    fn counters(&self) -> &Counters {
        &self.counters
    }
}

impl Heard {
    /// What the frame holds, by its data type.
    fn content(&mut self, at: Monotonic, can: &CanData, scale: Scale) -> Result<Content, Fault> {
        let [_, data_type, _, code, value @ ..] = can.data;
        let bits = u32::from_be_bytes(value);
        let waiting = self.high.take();
        let positional = scale == Scale::Position;
        let value_bytes = can.bytes().len() - HEADER_BYTES;
        if data_type == data_type::NODATA {
            return if value_bytes == 0 {
                Ok(Content::Failed)
            } else {
                Err(Fault::Long)
            };
        }
        let expected = match data_type {
            data_type::ERROR => 4,
            data_type::CHAR4 | data_type::UCHAR4 if scale == Scale::Clock => 4,
            _ if scale == Scale::Clock => return Err(Fault::Type),
            data_type::FLOAT => 4,
            data_type::LONG | data_type::DOUBLEH | data_type::DOUBLEL if positional => 4,
            _ if positional => return Err(Fault::Type),
            data_type::LONG | data_type::ULONG => 4,
            data_type::SHORT | data_type::USHORT => 2,
            data_type::CHAR | data_type::UCHAR => 1,
            _ => return Err(Fault::Type),
        };
        if value_bytes < expected {
            return Err(Fault::Short);
        }
        if value_bytes > expected {
            return Err(Fault::Long);
        }
        let [a, b, c, _] = value;
        match data_type {
            data_type::FLOAT => Ok(Content::Number(f64::from(f32::from_bits(bits)))),
            data_type::LONG if positional => Ok(Content::Number(
                f64::from(i32::from_be_bytes(value)) * LONG_DEGREES,
            )),
            data_type::LONG => Ok(Content::Number(f64::from(i32::from_be_bytes(value)))),
            data_type::ULONG => Ok(Content::Number(f64::from(bits))),
            data_type::SHORT => Ok(Content::Number(f64::from(i16::from_be_bytes([a, b])))),
            data_type::USHORT => Ok(Content::Number(f64::from(u16::from_be_bytes([a, b])))),
            data_type::CHAR => Ok(Content::Number(f64::from(i8::from_be_bytes([a])))),
            data_type::UCHAR => Ok(Content::Number(f64::from(a))),
            data_type::CHAR4 | data_type::UCHAR4 => Ok(Content::Number(time_of_day([a, b, c]))),
            data_type::DOUBLEH => {
                self.high = Some(High { at, code, bits });
                Ok(Content::Half)
            }
            data_type::DOUBLEL => {
                // The upper half comes first: a lower half may only complete the upper half just before it, numbered as
                // the same message or the next. Any other pair could be torn between two positions.
                let high = waiting
                    .filter(|high| at.since(high.at).is_some_and(|age| age <= PAIR_AGE_MAX))
                    .filter(|high| code.wrapping_sub(high.code) <= 1)
                    .ok_or(Fault::Unpaired)?;
                Ok(Content::Number(f64::from_bits(
                    u64::from(high.bits) << 32 | u64::from(bits),
                )))
            }
            _ => Ok(Content::Failed),
        }
    }
}

/// Seconds since midnight; not a number for a time that is none.
fn time_of_day([hour, minute, second]: [u8; 3]) -> f64 {
    if hour > 23 || minute > 59 || second > 60 {
        return f64::NAN;
    }
    f64::from(hour) * 3600.0 + f64::from(minute) * 60.0 + f64::from(second)
}

/// The frame by which `node` sends `value` (in the parameter's SI unit) as a FLOAT, as its message number `code`; `None`
/// when the protocol has no identifier for the parameter, or none of that type, or the value is not one that it can have.
#[must_use]
pub fn encode(parameter: Parameter, value: f64, node: u8, code: u8) -> Option<CanData> {
    let row = primary_row(parameter).filter(|row| row.scale != Scale::Clock)?;
    let wire = row.scale.to_wire(parameter.check(value).ok()?);
    #[expect(
        clippy::cast_possible_truncation,
        reason = "FLOAT has 32 bits; every parameter's range is far within them"
    )]
    let bits = (wire as f32).to_bits();
    Some(frame(row.id, data_type::FLOAT, node, code, bits))
}

/// The two frames, to be sent in this order, by which `node` sends a latitude or longitude (radians) at full precision, as
/// its messages `code` and `code + 1`; `None` for any other parameter or an impossible value.
#[must_use]
pub fn encode_double(parameter: Parameter, value: f64, node: u8, code: u8) -> Option<[CanData; 2]> {
    let row = primary_row(parameter).filter(|row| row.scale == Scale::Position)?;
    let bits = row
        .scale
        .to_wire(parameter.check(value).ok()?)
        .to_bits()
        .to_be_bytes();
    let [a, b, c, d, e, f, g, h] = bits;
    let high = u32::from_be_bytes([a, b, c, d]);
    let low = u32::from_be_bytes([e, f, g, h]);
    Some([
        frame(row.id, data_type::DOUBLEH, node, code, high),
        frame(row.id, data_type::DOUBLEL, node, code.wrapping_add(1), low),
    ])
}

/// The frame by which `node` says that it has no data for `parameter`, as its message number `code`; `None` when the
/// protocol has no identifier for the parameter.
#[must_use]
pub fn encode_no_data(parameter: Parameter, node: u8, code: u8) -> Option<CanData> {
    let row = primary_row(parameter)?;
    let mut can = frame(row.id, data_type::NODATA, node, code, 0);
    can.len = 4;
    Some(can)
}

fn primary_row(parameter: Parameter) -> Option<&'static Row> {
    ROWS.iter()
        .find(|row| row.parameter == parameter && !row.stands_in)
}

fn frame(id: u16, data_type: u8, node: u8, code: u8, bits: u32) -> CanData {
    let [a, b, c, d] = bits.to_be_bytes();
    CanData {
        id: u32::from(id),
        extended: false,
        len: 8,
        data: [node, data_type, 0, code, a, b, c, d],
    }
}
