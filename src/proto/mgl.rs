//! MGL Avionics' serial data (iEFIS, Odyssey, Voyager: "iLink" packets), little-endian.
//!
//! Source: MGL Avionics, "Flight data interface specification", revision 6 of 2012 (whose copyright MGL waives). A packet is
//! `05 02`, a length L and its complement, then type, rate, count and version, L + 8 bytes of payload (L 0 means 256) and the
//! CRC-32 of IEEE 802.3 over all from the type to the payload's end.
//!
//! Read are type 1 (primary flight), 2 (GPS), 3 (attitude), 10 (piston engine) and 30 (navigation); the other types are good,
//! but nothing is read from them: 4 and turbines mean what their vendor says, and the unit of 11's fuel levels is not in the pages
//! at hand. Sentinels: the GPS status says whether there is a position, a bit of 30 whether its source is valid; an engine
//! temperature or pressure that is exactly zero belongs to no sensor and is not said; the other types have none. Signs: pitch up,
//! bank right, turn right, climb are positive. The heading is magnetic. Side forces, slip and needle deviations are not read: the
//! direction in which they are positive is not published, nor is the unit of the waypoint's distance. Speeds are in tenths of
//! kilometres an hour, altitudes in feet, pressures in tenths of hectopascals.

use super::emit::{Emit, celsius, compass, feet, fpm};
use super::framing::{Look, Piece};
use super::stream::StreamDecoder;
use super::{Counters, Fault};
use crate::signal::{Parameter, Sink, SourceId, engines};
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

pub(super) fn look(bytes: &[u8], _seen: usize) -> Look {
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
        10 => engine_bytes(payload),
        30 => 52,
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
            10 => engine(payload, &mut out),
            30 => navigation(payload, &mut out),
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
    out.maybe(Parameter::HeightAgl, some(has_height, feet(i32_at(p, 12))));
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

// Offsets in an engine's payload.
const ENGINE_NUMBER: usize = 0; // byte, from 1
const ENGINE_KIND: usize = 1; // byte, 0 piston
const EGT_COUNT: usize = 2; // byte
const CHT_COUNT: usize = 3; // byte
const RPM: usize = 4; // word, 1/min
const OIL_PRESSURE: usize = 8; // word, tenths of hPa
const FUEL_PRESSURE: usize = 12; // word, tenths of hPa
const COOLANT_TEMPERATURE: usize = 14; // smallint, degrees Celsius
const OIL_TEMPERATURE: usize = 16; // smallint, degrees Celsius
const FUEL_FLOW: usize = 28; // word, tenths of l/h
const MANIFOLD_PRESSURE: usize = 32; // word, tenths of hPa
const THERMOCOUPLES: usize = 40; // smallints, degrees Celsius: exhausts, then cylinder heads

/// How long an engine's payload is by its own counts. Each vendor may pad it so that the checksum is aligned to four bytes.
fn engine_bytes(p: &[u8]) -> usize {
    let count = |at: usize| usize::from(p.get(at).copied().unwrap_or(0));
    match p.get(ENGINE_KIND) {
        Some(0) => {
            let least = THERMOCOUPLES + 2 * (count(EGT_COUNT) + count(CHT_COUNT));
            least.max(p.len().min(least.next_multiple_of(4)))
        }
        Some(_) => p.len(),
        None => THERMOCOUPLES,
    }
}

fn engine(p: &[u8], out: &mut Emit<'_>) {
    let number = usize::from(p[ENGINE_NUMBER]).checked_sub(1);
    let Some(n) = number.filter(|n| *n < engines::SPEED.len() && p[ENGINE_KIND] == 0) else {
        return;
    };
    out.number(engines::SPEED[n], u16_at(p, RPM));
    out.number(engines::FUEL_FLOW[n], u16_at(p, FUEL_FLOW) * 0.1);
    for (parameter, at) in [
        (engines::OIL_PRESSURE[n], OIL_PRESSURE),
        (engines::FUEL_PRESSURE[n], FUEL_PRESSURE),
        (engines::MANIFOLD_PRESSURE[n], MANIFOLD_PRESSURE),
    ] {
        if p[at..at + 2] != [0; 2] {
            out.number(parameter, u16_at(p, at) * 0.1);
        }
    }
    let (egt, cht) = (usize::from(p[EGT_COUNT]), usize::from(p[CHT_COUNT]));
    let exhausts = engines::EXHAUST_GAS_TEMPERATURE[n].into_iter().take(egt);
    let heads = engines::CYLINDER_HEAD_TEMPERATURE[n].into_iter().take(cht);
    let from = |first: usize| move |(i, parameter)| (parameter, first + 2 * i);
    let fluids = [
        (engines::COOLANT_TEMPERATURE[n], COOLANT_TEMPERATURE),
        (engines::OIL_TEMPERATURE[n], OIL_TEMPERATURE),
    ];
    let exhausts = exhausts.enumerate().map(from(THERMOCOUPLES));
    let heads = heads.enumerate().map(from(THERMOCOUPLES + 2 * egt));
    for (parameter, at) in fluids.into_iter().chain(exhausts).chain(heads) {
        if p[at..at + 2] != [0; 2] {
            out.number(parameter, celsius(i16_at(p, at)));
        }
    }
}

fn navigation(p: &[u8], out: &mut Emit<'_>) {
    /// Bit of the flags, and the source that is a GPS waypoint.
    const IS_VALID: u8 = 1;
    const WAYPOINT: u8 = 1;
    out.number(Parameter::SelectedHeading, compass(i16_at(p, 14) * 0.1));
    out.number(Parameter::SelectedAltitude, feet(i32_at(p, 16)));
    let there = p[0] & IS_VALID != 0 && p[2] == WAYPOINT;
    let angle = |at| there.then(|| (i32_at(p, at) * DEGREES).to_radians());
    out.maybe(Parameter::WaypointLatitude, angle(24));
    out.maybe(Parameter::WaypointLongitude, angle(28));
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
