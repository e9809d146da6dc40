//! UBX, the binary protocol of u-blox receivers: NAV-PVT.
//!
//! Source: u-blox, "M8 Receiver Description including protocol specification", UBX-13003221, NAV-PVT (0x01 0x07; 92 bytes, 84 in
//! protocol 14). Little-endian. Every UBX frame with a right checksum is good; NAV-PVT is read. NMEA and RTCM frames between
//! them are ignored. See [`gnss`](super::gnss) for the framing.
//!
//! Sentinels are flags: without `gnssFixOK`, with `invalidLlh`, or with a fix of no or one kind of dimension, position and
//! velocity are absent; a fix by dead reckoning alone is doubtful; with two dimensions heights and climb are absent. Date and
//! time count when they are marked valid and fully resolved, variation when it is marked valid.

use super::emit::Emit;
use super::framing::{Framer, Piece};
use super::gnss::{self, FRAME_BYTES_MAX, Own};
use super::{Counters, Decoder};
use crate::angle::wrap_turn;
use crate::sampled::Invalid;
use crate::signal::{Frame, Parameter, Sink, SourceId, Wire};
use crate::units::Radians;

/// The decoder.
#[derive(Debug, Default)]
pub struct Ubx {
    framer: Framer<FRAME_BYTES_MAX>,
    counters: Counters,
}

impl Ubx {
    /// A decoder that has seen nothing.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }
}

impl Decoder for Ubx {
    fn push(&mut self, frame: Frame<'_>, sink: &mut dyn Sink) {
        let (Wire::Datagram(bytes) | Wire::Stream(bytes)) = frame.wire else {
            self.counters.ignored += 1;
            return;
        };
        let Self { framer, counters } = self;
        let look = |bytes: &[u8], seen| gnss::look(Own::Ubx, bytes, seen);
        framer.push(frame.at, bytes, look, &mut |piece| {
            take(piece, frame.source, counters, sink);
        });
    }

    fn finish(&mut self) {
        let Self { framer, counters } = self;
        let look = |bytes: &[u8], seen| gnss::look(Own::Ubx, bytes, seen);
        framer.finish(look, &mut |piece| match piece {
            Piece::Frame(..) => counters.ignored += 1,
            piece => counters.count_piece(&piece),
        });
    }

    fn counters(&self) -> &Counters {
        &self.counters
    }
}

fn take(piece: Piece<'_>, source: SourceId, counters: &mut Counters, sink: &mut dyn Sink) {
    match piece {
        Piece::Frame(at, frame) if gnss::is_ubx(frame) => {
            counters.count(None);
            if let [_, _, 0x01, 0x07, _, _, payload @ .., _, _] = frame {
                let mut out = Emit::new(at, source, &mut counters.flow, sink);
                position_velocity_time(payload, &mut out);
            }
        }
        Piece::Frame(..) => counters.ignored += 1,
        piece => counters.count_piece(&piece),
    }
}

// Offsets in the payload, wire units.
const YEAR: usize = 4; // u16
const VALID: usize = 11; // bits: date 0, time 1, fully resolved 2, variation 3
const NANO: usize = 16; // i32, ns
const FIX_TYPE: usize = 20;
const FLAGS: usize = 21; // bit 0: gnssFixOK
const SATELLITES: usize = 23;
const LONGITUDE: usize = 24; // i32, 1e-7 deg
const LATITUDE: usize = 28; // i32, 1e-7 deg
const HEIGHT: usize = 32; // i32, mm above the ellipsoid
const ALTITUDE: usize = 36; // i32, mm above mean sea level
const HORIZONTAL_ACCURACY: usize = 40; // u32, mm
const VERTICAL_ACCURACY: usize = 44; // u32, mm
const VELOCITY_DOWN: usize = 56; // i32, mm/s
const GROUND_SPEED: usize = 60; // i32, mm/s
const TRACK: usize = 64; // i32, 1e-5 deg
const FLAGS3: usize = 78; // bit 0: invalidLlh
const VARIATION: usize = 88; // i16, 1e-2 deg

fn position_velocity_time(p: &[u8], out: &mut Emit<'_>) {
    let fix = p[FIX_TYPE];
    let is_ok = p[FLAGS] & 1 != 0 && p[FLAGS3] & 1 == 0;
    let dimensions = match fix {
        1 | 2 if is_ok => 2,
        3 | 4 if is_ok => 3,
        _ => 0,
    };
    if fix == 1 {
        out.doubt = Some(Invalid::Doubtful);
    }
    let flat = |x: f64| (dimensions >= 2).then_some(x);
    let high = |x: f64| (dimensions >= 3).then_some(x);
    let degrees = |at| (i32_at(p, at) * 1e-7).to_radians();
    out.maybe(Parameter::Latitude, flat(degrees(LATITUDE)));
    out.maybe(Parameter::Longitude, flat(degrees(LONGITUDE)));
    out.maybe(Parameter::HeightEllipsoid, high(i32_at(p, HEIGHT) * 1e-3));
    out.maybe(Parameter::AltitudeMsl, high(i32_at(p, ALTITUDE) * 1e-3));
    out.maybe(Parameter::GroundSpeed, flat(i32_at(p, GROUND_SPEED) * 1e-3));
    let track = i32_at(p, TRACK) * 1e-5;
    let track = if track.abs() <= 360.0 {
        wrap_turn(Radians::from_degrees(track)).0
    } else {
        f64::NAN
    };
    out.maybe(Parameter::Track, flat(track));
    out.maybe(
        Parameter::VerticalSpeed,
        high(i32_at(p, VELOCITY_DOWN) * -1e-3),
    );
    out.doubt = None;
    out.number(Parameter::FixDimensions, f64::from(dimensions));
    out.number(Parameter::SatellitesUsed, f64::from(p[SATELLITES]));
    let accuracy = |at| u32_at(p, at) * 1e-3;
    out.maybe(
        Parameter::HorizontalAccuracy,
        flat(accuracy(HORIZONTAL_ACCURACY)),
    );
    out.maybe(
        Parameter::VerticalAccuracy,
        high(accuracy(VERTICAL_ACCURACY)),
    );
    time_and_variation(p, out);
}

fn time_and_variation(p: &[u8], out: &mut Emit<'_>) {
    let valid = p[VALID];
    let [month, day, hour, minute, second] = [2, 3, 4, 5, 6].map(|n| p[YEAR + n]);
    let seconds = f64::from(hour) * 3600.0 + f64::from(minute) * 60.0 + f64::from(second);
    let seconds = seconds + i32_at(p, NANO) * 1e-9;
    out.maybe(Parameter::UtcTimeOfDay, (valid & 6 == 6).then_some(seconds));
    let year = u16::from_le_bytes([p[YEAR], p[YEAR + 1]]);
    let date = super::emit::date_days(i32::from(year), i32::from(month), i32::from(day));
    out.maybe(Parameter::UtcDate, (valid & 5 == 5).then_some(date));
    if p.len() > VARIATION + 1 && valid & 8 != 0 {
        let variation = f64::from(i16::from_le_bytes([p[VARIATION], p[VARIATION + 1]])) * 0.01;
        out.number(Parameter::MagneticVariation, variation.to_radians());
    }
}

fn i32_at(p: &[u8], at: usize) -> f64 {
    f64::from(i32::from_le_bytes([p[at], p[at + 1], p[at + 2], p[at + 3]]))
}

fn u32_at(p: &[u8], at: usize) -> f64 {
    f64::from(u32::from_le_bytes([p[at], p[at + 1], p[at + 2], p[at + 3]]))
}
