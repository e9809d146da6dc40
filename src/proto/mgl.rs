//! MGL Avionics' serial data (iEFIS, Odyssey, Voyager: "iLink" packets), little-endian.
//!
//! Source: MGL Avionics, "iEFIS/Odyssey/Voyager serial port communications". A packet is `05 02`, a length L and its
//! complement, then type, rate, count and version, L + 8 bytes of payload (L 0 means 256) and the CRC-32 of IEEE 802.3 over all
//! from the type to the payload's end.
//!
//! Read are type 1 (primary flight), 2 (GPS) and 3 (attitude); the other types are good, but nothing is read from them: what
//! their fields mean depends on how the engine monitor is set up. Sentinels: the GPS status says whether there is a position;
//! the other types have none. Signs: pitch up, bank right, turn right, climb are positive. The heading is magnetic. Side
//! forces and slip are not read: the direction in which they are positive is not published. Speeds are in tenths of
//! kilometres an hour, altitudes in feet, pressures in tenths of hectopascals.

use super::emit::{Emit, celsius, compass, feet, fpm};
use super::framing::{Look, Piece};
use super::stream::StreamDecoder;
use super::{Counters, Fault};
use crate::signal::{Parameter, Sink, SourceId};
use crc::{CRC_32_ISO_HDLC, Crc};

const CRC_32: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// Bytes of a packet beyond its L.
const OVERHEAD_BYTES: usize = 20;
/// The longest packet.
const PACKET_BYTES_MAX: usize = 256 + OVERHEAD_BYTES;

/// Degrees per unit of latitude and longitude.
const DEGREES: f64 = 1.0 / 180_000.0;

/// A decoder that has seen nothing.
#[must_use]
pub fn decoder() -> StreamDecoder<PACKET_BYTES_MAX> {
    StreamDecoder::new(look, take)
}

fn look(bytes: &[u8], _seen: usize) -> Look {
    match *bytes {
        [5] | [5, 2] | [5, 2, _] => Look::More,
        [5, 2, length, complement, ..] if length == !complement => {
            let total = OVERHEAD_BYTES
                + if length == 0 {
                    256
                } else {
                    usize::from(length)
                };
            match bytes.get(..total) {
                None => Look::More,
                Some(packet) if crc_is_right(packet) => Look::Frame(total),
                Some(_) => Look::Damaged(1, Fault::Checksum),
            }
        }
        _ => {
            let next = bytes[1..].iter().position(|b| *b == 5);
            Look::Foreign(next.map_or(bytes.len(), |n| n + 1))
        }
    }
}

fn crc_is_right(packet: &[u8]) -> bool {
    packet[4..]
        .split_last_chunk::<4>()
        .is_some_and(|(body, sent)| CRC_32.checksum(body) == u32::from_le_bytes(*sent))
}

fn take(piece: Piece<'_>, source: SourceId, counters: &mut Counters, sink: &mut dyn Sink) {
    let Piece::Frame(at, packet) = piece else {
        counters.count_piece(&piece);
        return;
    };
    let payload = &packet[8..packet.len() - 4];
    let expected = match packet[4] {
        1 => 32,
        2 => 44,
        3 => 28,
        _ => payload.len(),
    };
    let fault = match payload.len().cmp(&expected) {
        std::cmp::Ordering::Less => Some(Fault::Short),
        std::cmp::Ordering::Greater => Some(Fault::Long),
        std::cmp::Ordering::Equal => None,
    };
    counters.count(fault);
    if fault.is_none() {
        let mut out = Emit::new(at, source, &mut counters.flow, sink);
        match packet[4] {
            1 => primary_flight(payload, &mut out),
            2 => gps(payload, &mut out),
            3 => attitude(payload, &mut out),
            _ => {}
        }
    }
}

fn primary_flight(p: &[u8], out: &mut Emit<'_>) {
    out.number(Parameter::PressureAltitude, feet(i32_at(p, 0)));
    out.number(Parameter::BaroAltitude, feet(i32_at(p, 4)));
    out.number(Parameter::IndicatedAirspeed, kmh(u16_at(p, 8)));
    out.number(Parameter::TrueAirspeed, kmh(u16_at(p, 10)));
    out.number(Parameter::VerticalSpeed, fpm(i16_at(p, 14)));
    out.number(Parameter::StaticPressure, u16_at(p, 16) * 0.1);
    out.number(Parameter::BaroSetting, u16_at(p, 18) * 0.1);
    out.number(Parameter::StaticAirTemperature, celsius(i16_at(p, 20)));
}

fn gps(p: &[u8], out: &mut Emit<'_>) {
    // 0 acquiring, 1 dead reckoning, 2 and 4 two dimensions, 3 and 5 three, 6 time only.
    let dimensions = match p[34] {
        2 | 4 => 2.0,
        3 | 5 => 3.0,
        _ => 0.0,
    };
    let (has_position, has_height) = (dimensions >= 2.0, dimensions >= 3.0);
    let some = |there: bool, x: f64| there.then_some(x);
    let latitude = (i32_at(p, 0) * DEGREES).to_radians();
    let longitude = (i32_at(p, 4) * DEGREES).to_radians();
    out.number(Parameter::FixDimensions, dimensions);
    out.maybe(Parameter::Latitude, some(has_position, latitude));
    out.maybe(Parameter::Longitude, some(has_position, longitude));
    out.maybe(Parameter::AltitudeMsl, some(has_height, feet(i32_at(p, 8))));
    out.maybe(
        Parameter::GroundSpeed,
        some(has_position, kmh(u16_at(p, 28))),
    );
    let track = compass(u16_at(p, 30) * 0.1);
    out.maybe(Parameter::Track, some(has_position, track));
}

fn attitude(p: &[u8], out: &mut Emit<'_>) {
    let tenths = |x: f64| (x * 0.1).to_radians();
    out.number(Parameter::HeadingMagnetic, compass(u16_at(p, 0) * 0.1));
    out.number(Parameter::Pitch, tenths(i16_at(p, 2)));
    out.number(Parameter::Roll, tenths(i16_at(p, 4)));
    out.number(Parameter::TurnRate, tenths(i16_at(p, 8)));
    out.number(Parameter::NormalAcceleration, i16_at(p, 12) * 0.01);
}

/// Tenths of kilometres an hour, m/s.
fn kmh(x: f64) -> f64 {
    x * 0.1 / 3.6
}

fn i32_at(p: &[u8], at: usize) -> f64 {
    f64::from(i32::from_le_bytes([p[at], p[at + 1], p[at + 2], p[at + 3]]))
}

fn u16_at(p: &[u8], at: usize) -> f64 {
    f64::from(u16::from_le_bytes([p[at], p[at + 1]]))
}

fn i16_at(p: &[u8], at: usize) -> f64 {
    f64::from(i16::from_le_bytes([p[at], p[at + 1]]))
}
