//! CANaerospace 1.7 (Stock Flight Systems, interface specification revision 1.7, 12 January 2006): decoder and encoder.
//!
//! A data frame is (section 2): byte 0 node, byte 1 data type, byte 2 service code, byte 3 message code, bytes 4 to 7 the
//! value, big-endian. Identifiers, units and signs are those of the standard's default distribution (section 4). Sentinel:
//! data type NODATA (no value) or ERROR (failed); both become [`Invalid::SourceFailed`].
//!
//! What is taken:
//! - 11-bit identifiers, and 29-bit identifiers whose upper 18 bits are zero: the same numbers. All others are ignored.
//! - Service code 0. Other service codes say that the frame is not the plain value; such frames are ignored.
//! - FLOAT for every identifier. Latitude and longitude also as DOUBLEH and DOUBLEL (the two halves of a 64-bit number in
//!   two frames), which the standard lists for them, and as LONG in units of 1e-7 degree, which it does not list but which
//!   the CANaerospace devices of the gliding world send (XCSoar's driver `CANaerospace` reads nothing else). A FLOAT
//!   latitude has a resolution of 0.4 m; the others are better than 0.02 m.
//! - SHORT2 is suggested by the standard beside FLOAT, but its scale is left to the system's designer. It is not guessed:
//!   such a frame is counted under [`Fault::Type`] and gives no value.
//!
//! Identifier 321, "heading angle", does not say which north. It is taken as the third Euler angle beside pitch and roll,
//! from true north, but only while there is no 1133, "true heading", which does say; magnetic heading has its own, 1069.
//! In the same way 329 stands in for 328, 335 for 324 and 564 for 500.
//!
//! Redundant nodes (section 7) send the same identifier with different node numbers. The first heard is listened to; the
//! others are ignored until it fails or falls silent for the parameter's greatest age.
//!
//! The message code counts a sender's messages per identifier, modulo 256. Gaps, repetitions and frozen frames are noted in
//! [`Flow`](super::Flow). They are notes only: many senders never count. But a sender that has counted and whose code then
//! stands still for longer than the parameter's greatest age is stuck: its values become [`Invalid::Frozen`], and a
//! redundant node may take over.

use super::{Counters, Decoder, Fault};
use crate::angle::{wrap_signed, wrap_turn};
use crate::sampled::Invalid;
use crate::signal::{CanData, Frame, Parameter, Signal, Sink, SourceId, Wire};
use crate::time::Monotonic;
use crate::units::{Degrees, Radians};
use std::time::Duration;

/// Data types of the standard's table 2.2 that are used here.
mod data_type {
    pub(super) const NODATA: u8 = 0;
    pub(super) const ERROR: u8 = 1;
    pub(super) const FLOAT: u8 = 2;
    pub(super) const LONG: u8 = 3;
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

/// A larger step of the message code than this is taken as a restart of the sender, not as lost frames.
const LOST_MAX: u8 = 128;

/// How the number on the wire becomes the parameter's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Scale {
    /// It is the parameter's unit.
    One,
    /// An angle or a rate in degrees.
    Degrees,
    /// A direction in degrees, -180 to 180 or 0 to 360; the parameter goes from 0 to a turn.
    Direction,
    /// A latitude or longitude in degrees.
    Position,
}

/// One identifier.
#[derive(Clone, Copy, Debug)]
struct Row {
    id: u16,
    parameter: Parameter,
    scale: Scale,
    /// Whether it only stands in for another identifier of the same parameter.
    stands_in: bool,
}

const fn primary(id: u16, parameter: Parameter, scale: Scale) -> Row {
    Row {
        id,
        parameter,
        scale,
        stands_in: false,
    }
}

const fn stand_in(id: u16, parameter: Parameter, scale: Scale) -> Row {
    Row {
        id,
        parameter,
        scale,
        stands_in: true,
    }
}

/// The identifiers, ascending: the standard's name, the wire unit, the sign.
const ROWS: [Row; 31] = [
    // 300: body longitudinal acceleration, g, forward positive.
    primary(300, Parameter::LongitudinalAcceleration, Scale::One),
    // 301: body lateral acceleration, g, right positive.
    primary(301, Parameter::LateralAcceleration, Scale::One),
    // 302: body normal acceleration, g, up positive.
    primary(302, Parameter::NormalAcceleration, Scale::One),
    // 303: body pitch rate, deg/s, nose up positive.
    primary(303, Parameter::PitchRate, Scale::Degrees),
    // 304: body roll rate, deg/s, right positive.
    primary(304, Parameter::RollRate, Scale::Degrees),
    // 305: body yaw rate, deg/s, right positive.
    primary(305, Parameter::YawRate, Scale::Degrees),
    // 311: body pitch angle, deg, nose up positive.
    primary(311, Parameter::Pitch, Scale::Degrees),
    // 312: body roll angle, deg, right positive.
    primary(312, Parameter::Roll, Scale::Degrees),
    // 313: body sideslip, deg.
    primary(313, Parameter::Sideslip, Scale::Degrees),
    // 314: altitude rate, m/s.
    primary(314, Parameter::VerticalSpeed, Scale::One),
    // 315: indicated airspeed, m/s.
    primary(315, Parameter::IndicatedAirspeed, Scale::One),
    // 316: true airspeed, m/s.
    primary(316, Parameter::TrueAirspeed, Scale::One),
    // 317: calibrated airspeed, m/s.
    primary(317, Parameter::CalibratedAirspeed, Scale::One),
    // 319: baro correction, hPa.
    primary(319, Parameter::BaroSetting, Scale::One),
    // 320: baro corrected altitude, m.
    primary(320, Parameter::BaroAltitude, Scale::One),
    // 321: heading angle, deg, -180 to 180.
    stand_in(321, Parameter::HeadingTrue, Scale::Direction),
    // 322: standard altitude, m.
    primary(322, Parameter::PressureAltitude, Scale::One),
    // 324: static air temperature, K.
    primary(324, Parameter::StaticAirTemperature, Scale::One),
    // 328: port side angle of attack, deg, nose up positive.
    primary(328, Parameter::AngleOfAttack, Scale::Degrees),
    // 329: starboard side angle of attack, deg, nose up positive.
    stand_in(329, Parameter::AngleOfAttack, Scale::Degrees),
    // 332: true altitude, m.
    primary(332, Parameter::AltitudeMsl, Scale::One),
    // 335: outside air temperature, K.
    stand_in(335, Parameter::StaticAirTemperature, Scale::One),
    // 500: engine 1 N1, ECS channel A, 1/min.
    primary(500, Parameter::EngineSpeed, Scale::One),
    // 564: engine 1 N1, ECS channel B, 1/min.
    stand_in(564, Parameter::EngineSpeed, Scale::One),
    // 1036: GPS aircraft latitude, deg, north positive.
    primary(1036, Parameter::Latitude, Scale::Position),
    // 1037: GPS aircraft longitude, deg, east positive.
    primary(1037, Parameter::Longitude, Scale::Position),
    // 1038: GPS aircraft height above ellipsoid, m.
    primary(1038, Parameter::HeightEllipsoid, Scale::One),
    // 1039: GPS ground speed, m/s.
    primary(1039, Parameter::GroundSpeed, Scale::One),
    // 1040: GPS true track, deg.
    primary(1040, Parameter::Track, Scale::Direction),
    // 1069: magnetic heading, deg.
    primary(1069, Parameter::HeadingMagnetic, Scale::Direction),
    // 1133: true heading, deg.
    primary(1133, Parameter::HeadingTrue, Scale::Direction),
];

/// The identifiers that the decoder listens to, ascending.
pub static IDS: [u16; ROWS.len()] = {
    let mut ids = [0; ROWS.len()];
    let mut i = 0;
    while i < ids.len() {
        ids[i] = ROWS[i].id;
        i += 1;
    }
    ids
};

/// What is remembered of one identifier: the node that is listened to, and its last frame.
#[derive(Clone, Copy, Debug, Default)]
struct Heard {
    last: Option<Last>,
    /// The upper half of a 64-bit number that waits for its lower half.
    high: Option<High>,
}

#[derive(Clone, Copy, Debug)]
struct Last {
    at: Monotonic,
    node: u8,
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
        let (node, service, code) = (bytes[0], bytes[2], bytes[3]);
        let age_max = ROWS[row].parameter.spec().age_max;
        let other_is_alive = self.heard[row].last.is_some_and(|last| {
            last.node != node && last.usable && at.since(last.at).is_none_or(|age| age <= age_max)
        });
        if service != 0 || other_is_alive {
            return Taken::Ignored;
        }
        let content = match self.heard[row].content(at, can, ROWS[row].scale) {
            Ok(content) => content,
            Err(fault) => return Taken::Bad(fault),
        };
        let failed = matches!(content, Content::Failed);
        self.note_flow(row, at, [node, code], can, failed);
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
        [node, code]: [u8; 2],
        can: &CanData,
        failed: bool,
    ) {
        let [_, _, _, _, content @ ..] = can.data;
        let flow = &mut self.counters.flow;
        if failed {
            flow.failed += 1;
        }
        let (mut counts, mut code_since) = (false, at);
        if let Some(last) = self.heard[row].last.filter(|last| last.node == node) {
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
            node,
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
        let row = u16::try_from(can.id)
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
        let known = match data_type {
            data_type::ERROR | data_type::FLOAT => true,
            data_type::LONG | data_type::DOUBLEH | data_type::DOUBLEL => positional,
            _ => false,
        };
        if !known {
            return Err(Fault::Type);
        }
        if value_bytes < 4 {
            return Err(Fault::Short);
        }
        match data_type {
            data_type::FLOAT => Ok(Content::Number(f64::from(f32::from_bits(bits)))),
            data_type::LONG => Ok(Content::Number(
                f64::from(i32::from_be_bytes(value)) * LONG_DEGREES,
            )),
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

impl Scale {
    fn to_si(self, wire: f64) -> f64 {
        let radians = Radians::from(Degrees(wire));
        match self {
            Self::One => wire,
            Self::Degrees | Self::Position => radians.0,
            Self::Direction if wire.abs() <= 360.0 => wrap_turn(radians).0,
            // A direction beyond a turn is an error of the sender; as radians it is out of range all the more.
            Self::Direction => wire,
        }
    }

    fn to_wire(self, si: f64) -> f64 {
        match self {
            Self::One => si,
            Self::Degrees | Self::Position => Radians(si).to_degrees(),
            Self::Direction => wrap_signed(Radians(si)).to_degrees(),
        }
    }
}

/// The frame by which `node` sends `value` (in the parameter's SI unit) as a FLOAT, as its message number `code`; `None`
/// when the protocol has no identifier for the parameter or the value is not one that it can have.
#[must_use]
pub fn encode(parameter: Parameter, value: f64, node: u8, code: u8) -> Option<CanData> {
    let row = primary_row(parameter)?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_ascend_and_parameters_have_one_primary() {
        assert!(
            IDS.windows(2).all(|w| w[0] < w[1]),
            "binary search needs order"
        );
        for row in &ROWS {
            let primaries = ROWS
                .iter()
                .filter(|r| r.parameter == row.parameter && !r.stands_in);
            assert_eq!(primaries.count(), 1, "{:?}", row.parameter);
        }
    }

    #[test]
    fn directions_beyond_a_turn_are_refused() {
        for (wire, ok) in [
            (180.0, true),
            (-180.0, true),
            (360.0, true),
            (-90.0, true),
            (361.0, false),
            (-1e9, false),
        ] {
            let verdict = Parameter::HeadingTrue.check(Scale::Direction.to_si(wire));
            assert_eq!(verdict.is_ok(), ok, "{wire}");
        }
        assert!(
            Parameter::Track
                .check(Scale::Direction.to_si(f64::NAN))
                .is_err(),
            "NaN"
        );
    }
}
