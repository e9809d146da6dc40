//! GDL90: what ADS-B receivers and portable AHRS send over UDP (port 4000) or a serial line.
//!
//! Sources: Garmin, "GDL 90 Data Interface Specification", 560-1058-00 revision A (framing, CRC, heartbeat, ownship,
//! traffic, geometric altitude); ForeFlight, "GDL90 Extended Specification" (messages 0x65: identity, AHRS); the Stratux
//! project's `gen_gdl90.go` for its attitude message 0x4C 0x45 ("LE").
//!
//! A frame is `7E`, the message with `7D` and `7E` escaped as `7D` and the byte xor 20, its CRC (low byte first), `7E`. The CRC
//! is taken over the unescaped message with the polynomial 1021 and start 0, each byte entering at the low end: it is not
//! CRC-16/XMODEM. Every message with a right CRC is good; those listed above are read, the others have nothing for us.
//!
//! Sentinels: altitude FFF, ground speed FFF, vertical speed 800, position 0, 0 with NIC 0, track type 0, VFOM 7FFF;
//! AHRS messages 7FFF, and FFFF for unsigned fields. All become [`Invalid::SourceFailed`]. A position of unknown integrity
//! (NIC 0) and a geometric altitude with its warning bit become [`Invalid::Doubtful`].
//!
//! The altitude of ownship and traffic is pressure altitude. Geometric altitude is above the ellipsoid, unless the sender's
//! ForeFlight identity says that it means mean sea level. Stratux's heading is aligned with its GPS course: true. Its slip
//! is against the ball's direction.

use super::emit::{Emit, compass, feet, fpm, knots};
use super::framing::{Framer, Look, Piece};
use super::{Counters, Decoder, Fault};
use crate::sampled::Invalid;
use crate::signal::{Alert, Frame, Parameter, Place, Sink, SourceId, Traffic, Wire};
use crate::time::Monotonic;

const FLAG: u8 = 0x7E;
const ESCAPE: u8 = 0x7D;

/// The longest message, a UAT uplink of 436 bytes, with its CRC.
const MESSAGE_BYTES_MAX: usize = 438;
/// Every byte escaped, and two flags.
const FRAME_BYTES_MAX: usize = 2 * MESSAGE_BYTES_MAX + 2;

/// 95 % bound of the horizontal position by NACp, m (ICD table 12, nautical miles converted); 0 is unknown.
const ACCURACY_M: [Option<f64>; 12] = [
    None,
    Some(18_520.0),
    Some(7408.0),
    Some(3704.0),
    Some(1852.0),
    Some(926.0),
    Some(555.6),
    Some(185.2),
    Some(92.6),
    Some(30.0),
    Some(10.0),
    Some(3.0),
];

/// The decoder.
#[derive(Debug, Default)]
pub struct Gdl90 {
    framer: Framer<FRAME_BYTES_MAX>,
    reader: Reader,
}

/// What is remembered between messages.
#[derive(Debug, Default)]
struct Reader {
    counters: Counters,
    /// Whether the sender has said that its geometric altitude is above mean sea level.
    altitude_is_msl: bool,
}

impl Gdl90 {
    /// A decoder that has seen nothing.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }
}

impl Decoder for Gdl90 {
    fn push(&mut self, frame: Frame<'_>, sink: &mut dyn Sink) {
        let (Wire::Datagram(bytes) | Wire::Stream(bytes)) = frame.wire else {
            self.reader.counters.ignored += 1;
            return;
        };
        let Self { framer, reader } = self;
        framer.push(frame.at, bytes, look, &mut |piece| {
            reader.take(piece, frame.source, sink);
        });
    }

    fn finish(&mut self) {
        let Self { framer, reader } = self;
        // A last flag has closed a frame and opened none.
        let at_the_end = |bytes: &[u8], seen| match bytes {
            [FLAG] => Look::Blank(1),
            _ => look(bytes, seen),
        };
        framer.finish(at_the_end, &mut |piece| {
            reader.counters.count_piece(&piece);
        });
    }

    fn counters(&self) -> &Counters {
        &self.reader.counters
    }
}

pub(super) fn look(bytes: &[u8], seen: usize) -> Look {
    if bytes[0] != FLAG {
        let n = bytes.iter().position(|b| *b == FLAG).unwrap_or(bytes.len());
        return Look::Foreign(n);
    }
    let from = seen.max(1);
    let Some(end) = bytes[from..].iter().position(|b| *b == FLAG) else {
        return Look::More;
    };
    let end = from + end;
    // The closing flag may also open the next frame.
    match &bytes[1..end] {
        [] => Look::Blank(1),
        body if body.len() < 3 => Look::Damaged(end, Fault::Short),
        body => {
            let mut message = [0; MESSAGE_BYTES_MAX];
            match unescape(body, &mut message) {
                Ok(n) if n < 3 => Look::Damaged(end, Fault::Short),
                Ok(n) if crc_is_right(&message[..n]) => Look::Frame(end),
                Ok(_) => Look::Damaged(end, Fault::Checksum),
                Err(fault) => Look::Damaged(end, fault),
            }
        }
    }
}

/// Writes what `body` means to `message` and says how long that is.
fn unescape(body: &[u8], message: &mut [u8; MESSAGE_BYTES_MAX]) -> Result<usize, Fault> {
    let mut n = 0;
    let mut bytes = body.iter();
    while let Some(&byte) = bytes.next() {
        let byte = match byte {
            ESCAPE => bytes.next().ok_or(Fault::Short)? ^ 0x20,
            byte => byte,
        };
        *message.get_mut(n).ok_or(Fault::Long)? = byte;
        n += 1;
    }
    Ok(n)
}

const CRC_TABLE: [u16; 256] = {
    let mut table = [0; 256];
    let mut i = 0;
    while i < 256 {
        #[expect(clippy::cast_possible_truncation, reason = "an index below 256")]
        let mut crc = (i as u16) << 8;
        let mut bit = 0;
        while bit < 8 {
            crc = (crc << 1) ^ if crc & 0x8000 == 0 { 0 } else { 0x1021 };
            bit += 1;
        }
        table[i] = crc;
        i += 1;
    }
    table
};

/// The CRC of an unescaped message.
#[must_use]
pub fn crc(message: &[u8]) -> u16 {
    message.iter().fold(0, |crc, byte| {
        CRC_TABLE[usize::from(crc >> 8)] ^ (crc << 8) ^ u16::from(*byte)
    })
}

fn crc_is_right(message: &[u8]) -> bool {
    message
        .split_last_chunk::<2>()
        .is_some_and(|(body, sent)| crc(body) == u16::from_le_bytes(*sent))
}

impl Reader {
    fn take(&mut self, piece: Piece<'_>, source: SourceId, sink: &mut dyn Sink) {
        let Piece::Frame(at, bytes) = piece else {
            self.counters.count_piece(&piece);
            return;
        };
        let mut message = [0; MESSAGE_BYTES_MAX];
        let length = unescape(&bytes[1..], &mut message).unwrap_or(2).max(2) - 2;
        let message = &message[..length];
        let fault = self.read(at, source, message, sink).err();
        self.counters.count(fault);
    }

    fn read(
        &mut self,
        at: Monotonic,
        source: SourceId,
        message: &[u8],
        sink: &mut dyn Sink,
    ) -> Result<(), Fault> {
        let mut out = Emit::new(at, source, &mut self.counters.flow, sink);
        match message {
            [0x00, ..] => heartbeat(&exactly(message)?, &mut out),
            [0x0A, ..] => ownship(&exactly(message)?, &mut out),
            [0x14, ..] => traffic(&exactly(message)?, &mut out),
            [0x0B, ..] => geometric_altitude(&exactly(message)?, self.altitude_is_msl, &mut out),
            [0x65, 0x00, ..] => {
                let message: [u8; 39] = exactly(message)?;
                self.altitude_is_msl = message[38] & 1 != 0;
            }
            [0x65, 0x01, ..] => foreflight_ahrs(&exactly(message)?, &mut out),
            [0x4C, 0x45, 0x01, 0x01, ..] => stratux_ahrs(&exactly(message)?, &mut out),
            _ => {}
        }
        Ok(())
    }
}

/// The message, if it has the length that its kind has.
fn exactly<const N: usize>(message: &[u8]) -> Result<[u8; N], Fault> {
    message.try_into().map_err(|_wrong_length| {
        if message.len() < N {
            Fault::Short
        } else {
            Fault::Long
        }
    })
}

fn heartbeat(m: &[u8; 7], out: &mut Emit<'_>) {
    let (position_valid, utc_ok) = (m[1] & 0x80 != 0, m[2] & 1 != 0);
    if !position_valid {
        out.verdict(Parameter::FixDimensions, Ok(0.0));
    }
    let seconds = u32::from(m[2] >> 7) << 16 | u32::from(u16::from_le_bytes([m[3], m[4]]));
    out.maybe(
        Parameter::UtcTimeOfDay,
        utc_ok.then_some(f64::from(seconds)),
    );
}

/// What ownship and traffic reports have in common.
struct Report {
    position: Option<(f64, f64)>,
    integrity_is_known: bool,
    pressure_altitude_m: Option<f64>,
    airborne: bool,
    /// A direction and what it is, as the report says: 1 true track, 2 magnetic heading, 3 true heading, else nothing.
    direction: (u8, f64),
    ground_speed_mps: Option<f64>,
    vertical_speed_mps: Option<f64>,
    accuracy_m: Option<f64>,
}

impl Report {
    fn of(m: &[u8; 28]) -> Self {
        let degrees = |at: usize| {
            // 24 bits, signed: placed in the upper three bytes of 32 and shifted down.
            let raw = i32::from_be_bytes([m[at], m[at + 1], m[at + 2], 0]) >> 8;
            f64::from(raw) * (180.0 / 8_388_608.0)
        };
        let (latitude, longitude) = (degrees(5), degrees(8));
        let integrity = m[13] >> 4;
        let nowhere = m[5..11] == [0; 6] && integrity == 0;
        let altitude = u16::from(m[11]) << 4 | u16::from(m[12] >> 4);
        let misc = m[12] & 0x0F;
        let speed = u16::from(m[14]) << 4 | u16::from(m[15] >> 4);
        let climb = i16::from_be_bytes([m[15] << 4 | m[16] >> 4, m[16] << 4]) >> 4;
        Self {
            position: (!nowhere).then(|| (latitude.to_radians(), longitude.to_radians())),
            integrity_is_known: integrity != 0,
            pressure_altitude_m: (altitude != 0xFFF)
                .then(|| feet(f64::from(altitude) * 25.0 - 1000.0)),
            airborne: misc & 8 != 0,
            direction: (misc & 3, (f64::from(m[17]) * (360.0 / 256.0)).to_radians()),
            ground_speed_mps: (speed != 0xFFF).then(|| knots(f64::from(speed))),
            vertical_speed_mps: (climb != -0x800).then(|| fpm(f64::from(climb) * 64.0)),
            accuracy_m: ACCURACY_M.get(usize::from(m[13] & 0x0F)).copied().flatten(),
        }
    }
}

fn ownship(m: &[u8; 28], out: &mut Emit<'_>) {
    // Address types 0 and 1: what the own transponder sends, by which the receiver may hear it as traffic too.
    let address = u32::from_be_bytes([0, m[2], m[3], m[4]]);
    if m[1] & 0x0F <= 1 && !matches!(address, 0 | 0xFF_FFFF) {
        out.sink.own_address(address);
    }
    let report = Report::of(m);
    if report.position.is_some() && !report.integrity_is_known {
        out.doubt = Some(Invalid::Doubtful);
    }
    out.maybe(Parameter::Latitude, report.position.map(|p| p.0));
    out.maybe(Parameter::Longitude, report.position.map(|p| p.1));
    out.doubt = None;
    out.maybe(Parameter::HorizontalAccuracy, report.accuracy_m);
    out.maybe(Parameter::PressureAltitude, report.pressure_altitude_m);
    out.maybe(Parameter::GroundSpeed, report.ground_speed_mps);
    out.maybe(Parameter::VerticalSpeed, report.vertical_speed_mps);
    match report.direction {
        (1, track) => out.number(Parameter::Track, track),
        (2, heading) => out.number(Parameter::HeadingMagnetic, heading),
        (3, heading) => out.number(Parameter::HeadingTrue, heading),
        _ => out.absent(Parameter::Track),
    }
}

fn traffic(m: &[u8; 28], out: &mut Emit<'_>) {
    let report = Report::of(m);
    let Some((latitude, longitude)) = report.position else {
        return;
    };
    let (Some(latitude_rad), Some(longitude_rad)) = (
        out.accept(Parameter::Latitude, latitude),
        out.accept(Parameter::Longitude, longitude),
    ) else {
        return;
    };
    let mut callsign = [b' '; 8];
    callsign.copy_from_slice(&m[19..27]);
    if !callsign
        .iter()
        .all(|b| b.is_ascii_alphanumeric() || *b == b' ')
    {
        callsign = [b' '; 8];
    }
    let mut checked = |parameter, value: Option<f64>| out.accept(parameter, value?);
    let traffic = Traffic {
        at: Monotonic::from_nanos(0),
        source: SourceId(0),
        address: Some(u32::from_be_bytes([0, m[2], m[3], m[4]])),
        callsign,
        place: Place::Geodetic {
            latitude_rad,
            longitude_rad,
            pressure_altitude_m: checked(Parameter::PressureAltitude, report.pressure_altitude_m),
        },
        track_rad: (report.direction.0 == 1).then_some(report.direction.1),
        ground_speed_mps: checked(Parameter::GroundSpeed, report.ground_speed_mps),
        vertical_speed_mps: checked(Parameter::VerticalSpeed, report.vertical_speed_mps),
        airborne: Some(report.airborne),
        alert: if m[1] >> 4 == 1 {
            Alert::Low
        } else {
            Alert::None
        },
    };
    out.traffic(traffic);
}

fn geometric_altitude(m: &[u8; 5], is_msl: bool, out: &mut Emit<'_>) {
    let altitude = feet(f64::from(i16::from_be_bytes([m[1], m[2]])) * 5.0);
    let accuracy = u16::from_be_bytes([m[3], m[4]]);
    let known = accuracy & 0x7FFF != 0x7FFF;
    out.maybe(
        Parameter::VerticalAccuracy,
        known.then(|| f64::from(accuracy & 0x7FFF)),
    );
    if accuracy & 0x8000 != 0 {
        out.doubt = Some(Invalid::Doubtful);
    }
    let parameter = if is_msl {
        Parameter::AltitudeMsl
    } else {
        Parameter::HeightEllipsoid
    };
    out.number(parameter, altitude);
}

/// A signed field of an AHRS message.
fn signed(m: &[u8], at: usize) -> Option<f64> {
    let raw = i16::from_be_bytes([m[at], m[at + 1]]);
    (raw != 0x7FFF).then(|| f64::from(raw))
}

/// An unsigned field of an AHRS message.
fn unsigned(m: &[u8], at: usize) -> Option<f64> {
    let raw = u16::from_be_bytes([m[at], m[at + 1]]);
    (raw != 0xFFFF).then(|| f64::from(raw))
}

fn tenths_of_degrees(x: f64) -> f64 {
    (x * 0.1).to_radians()
}

fn foreflight_ahrs(m: &[u8; 12], out: &mut Emit<'_>) {
    out.maybe(Parameter::Roll, signed(m, 2).map(tenths_of_degrees));
    out.maybe(Parameter::Pitch, signed(m, 4).map(tenths_of_degrees));
    let heading = u16::from_be_bytes([m[6], m[7]]);
    let parameter = if heading & 0x8000 != 0 {
        Parameter::HeadingMagnetic
    } else {
        Parameter::HeadingTrue
    };
    let known = heading & 0x7FFF != 0x7FFF;
    out.maybe(
        parameter,
        known.then(|| compass(f64::from(heading & 0x7FFF) * 0.1)),
    );
    out.maybe(Parameter::IndicatedAirspeed, unsigned(m, 8).map(knots));
    out.maybe(Parameter::TrueAirspeed, unsigned(m, 10).map(knots));
}

fn stratux_ahrs(m: &[u8; 24], out: &mut Emit<'_>) {
    out.maybe(Parameter::Roll, signed(m, 4).map(tenths_of_degrees));
    out.maybe(Parameter::Pitch, signed(m, 6).map(tenths_of_degrees));
    out.maybe(
        Parameter::HeadingTrue,
        signed(m, 8).map(|x| compass(x * 0.1)),
    );
    out.maybe(
        Parameter::SlipBall,
        signed(m, 10).map(|x| tenths_of_degrees(-x)),
    );
    out.maybe(Parameter::TurnRate, signed(m, 12).map(tenths_of_degrees));
    out.maybe(
        Parameter::NormalAcceleration,
        signed(m, 14).map(|x| x * 0.1),
    );
    out.maybe(Parameter::IndicatedAirspeed, signed(m, 16).map(knots));
    // The sender adds 5000 ft and rounds.
    let altitude = unsigned(m, 18).map(|x| feet(x - 5000.0));
    out.maybe(Parameter::PressureAltitude, altitude);
    out.maybe(Parameter::VerticalSpeed, signed(m, 20).map(fpm));
}
