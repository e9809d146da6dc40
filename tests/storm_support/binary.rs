//! Binary streams and packets: GDL90, UBX, MGL, FlightGear's native packet.

use super::said::{FOOT, FPM, KNOT, Said};
use glasswing::signal::Parameter::*;

/// A big-endian number of `bytes.len()` bytes, signed.
fn signed(bytes: &[u8]) -> f64 {
    let raw = bytes.iter().fold(0_i64, |n, b| n * 256 + i64::from(*b));
    let bits = 8 * bytes.len();
    let value = if raw >> (bits - 1) == 1 {
        raw - (1 << bits)
    } else {
        raw
    };
    #[expect(clippy::cast_precision_loss, reason = "at most 32 bits")]
    let value = value as f64;
    value
}

/// The same, the lowest byte first.
fn signed_le<const N: usize>(bytes: &[u8], at: usize) -> f64 {
    let mut swapped = [0; N];
    swapped.copy_from_slice(&bytes[at..at + N]);
    swapped.reverse();
    signed(&swapped)
}

fn unsigned_le(bytes: &[u8], at: usize) -> f64 {
    f64::from(bytes[at]) + 256.0 * f64::from(bytes[at + 1])
}

/// GDL90's CRC, bit by bit: the message shifted through the polynomial, then sixteen zero bits less than XMODEM.
fn gdl90_crc(message: &[u8]) -> u16 {
    let mut crc = 0_u16;
    for byte in message {
        let mut high = crc & 0xFF00;
        for _ in 0..8 {
            high = if high & 0x8000 == 0 {
                high << 1
            } else {
                (high << 1) ^ 0x1021
            };
        }
        crc = high ^ (crc << 8) ^ u16::from(*byte);
    }
    crc
}

fn unstuffed(piece: &[u8]) -> Option<Vec<u8>> {
    let mut message = Vec::with_capacity(piece.len());
    let mut escaped = false;
    for &b in piece {
        if b == 0x7D && !escaped {
            escaped = true;
            continue;
        }
        message.push(if escaped { b ^ 0x20 } else { b });
        escaped = false;
    }
    (!escaped && message.len() > 2).then_some(message)
}

/// Makes the CRC of a frame between two flags right.
pub(crate) fn seal_gdl90(frame: &mut Vec<u8>) {
    let inner: Vec<u8> = frame.iter().copied().filter(|b| *b != 0x7E).collect();
    let Some(mut message) = unstuffed(&inner) else {
        return;
    };
    message.truncate(message.len() - 2);
    let crc = gdl90_crc(&message).to_le_bytes();
    message.extend(crc);
    frame.clear();
    frame.push(0x7E);
    for b in message {
        if matches!(b, 0x7D | 0x7E) {
            frame.extend([0x7D, b ^ 0x20]);
        } else {
            frame.push(b);
        }
    }
    frame.push(0x7E);
}

/// Every message with a right CRC, without it.
pub(crate) fn gdl90_frames(bytes: &[u8], on: &mut dyn FnMut(&[u8])) {
    for message in bytes.split(|b| *b == 0x7E).filter_map(unstuffed) {
        let (body, sent) = message.split_at(message.len() - 2);
        if gdl90_crc(body).to_le_bytes() == sent {
            on(body);
        }
    }
}

pub(crate) fn gdl90(m: &[u8], said: &mut Said) {
    let number = |at: usize, absent: u16, unit: f64| {
        let raw = u16::from_be_bytes([m[at], m[at + 1]]);
        (raw != absent).then(|| signed(&m[at..at + 2]) * unit)
    };
    let count = |at: usize| Some(u16::from_be_bytes([m[at], m[at + 1]])).filter(|n| *n != 0xFFFF);
    match (m[0], m.len()) {
        (0x0A, 28) => ownship(m, said),
        (0x0B, 5) => {
            let altitude = (m[3] & 0x80 == 0).then(|| signed(&m[1..3]) * 5.0 * FOOT);
            said.put(HeightEllipsoid, altitude);
            said.put(AltitudeMsl, altitude);
        }
        (0x65, 12) if m[1] == 1 => {
            said.degrees(Roll, number(2, 0x7FFF, 0.1));
            said.degrees(Pitch, number(4, 0x7FFF, 0.1));
            let heading = u16::from_be_bytes([m[6] & 0x7F, m[7]]);
            let heading = (heading != 0x7FFF).then(|| f64::from(heading) * 0.1);
            let is_magnetic = m[6] & 0x80 != 0;
            said.compass(
                if is_magnetic {
                    HeadingMagnetic
                } else {
                    HeadingTrue
                },
                heading,
            );
            said.put(IndicatedAirspeed, count(8).map(|x| f64::from(x) * KNOT));
            said.put(TrueAirspeed, count(10).map(|x| f64::from(x) * KNOT));
        }
        (0x4C, 24) if m[1..4] == [0x45, 1, 1] => {
            said.degrees(Roll, number(4, 0x7FFF, 0.1));
            said.degrees(Pitch, number(6, 0x7FFF, 0.1));
            said.compass(HeadingTrue, number(8, 0x7FFF, 0.1));
            said.degrees(SlipBall, number(10, 0x7FFF, -0.1));
            said.degrees(TurnRate, number(12, 0x7FFF, 0.1));
            said.put(NormalAcceleration, number(14, 0x7FFF, 0.1));
            said.put(IndicatedAirspeed, number(16, 0x7FFF, KNOT));
            let altitude = count(18).map(|x| (f64::from(x) - 5000.0) * FOOT);
            said.put(PressureAltitude, altitude);
            said.put(VerticalSpeed, number(20, 0x7FFF, FPM));
        }
        _ => {}
    }
}

fn ownship(m: &[u8], said: &mut Said) {
    let integrity = m[13] / 16;
    let known = integrity > 0;
    let degrees = |at: usize| known.then(|| signed(&m[at..at + 3]) * 180.0 / 8_388_608.0);
    said.degrees(Latitude, degrees(5));
    said.degrees(Longitude, degrees(8));
    let altitude = u32::from(m[11]) * 16 + u32::from(m[12]) / 16;
    let altitude = (altitude != 4095).then(|| (f64::from(altitude) * 25.0 - 1000.0) * FOOT);
    said.put(PressureAltitude, altitude);
    let speed = u32::from(m[14]) * 16 + u32::from(m[15]) / 16;
    said.put(
        GroundSpeed,
        (speed != 4095).then(|| f64::from(speed) * KNOT),
    );
    let climb = i32::from(m[15] % 16) * 256 + i32::from(m[16]);
    let climb = if climb >= 2048 { climb - 4096 } else { climb };
    said.put(
        VerticalSpeed,
        (climb != -2048).then(|| f64::from(climb) * 64.0 * FPM),
    );
    let direction = Some(f64::from(m[17]) * 360.0 / 256.0);
    match m[12] % 4 {
        1 => said.compass(Track, direction),
        2 => said.compass(HeadingMagnetic, direction),
        3 => said.compass(HeadingTrue, direction),
        _ => said.put(Track, None),
    }
}

/// RFC 1145's sum, by its definition: the sums of all, and of those sums.
fn fletcher(bytes: &[u8]) -> [u8; 2] {
    let (mut a, mut b) = (0_u32, 0_u32);
    for byte in bytes {
        a += u32::from(*byte);
        b += a;
    }
    [(a % 256).to_le_bytes()[0], (b % 256).to_le_bytes()[0]]
}

pub(crate) fn seal_ubx(frame: &mut Vec<u8>) {
    let n = frame.len();
    if n >= 8 {
        let sums = fletcher(&frame[2..n - 2]);
        frame[n - 2..].copy_from_slice(&sums);
    }
}

pub(crate) fn ubx_frames(bytes: &[u8], on: &mut dyn FnMut(&[u8])) {
    for i in 0..bytes.len().saturating_sub(7) {
        if bytes[i..i + 2] != [0xB5, 0x62] {
            continue;
        }
        let n = usize::from(bytes[i + 4]) + 256 * usize::from(bytes[i + 5]) + 8;
        if let Some(frame) = bytes.get(i..i + n)
            && fletcher(&frame[2..n - 2]) == frame[n - 2..]
        {
            on(frame);
        }
    }
}

pub(crate) fn ubx(frame: &[u8], said: &mut Said) {
    let p = &frame[6..frame.len() - 2];
    if frame[2..4] != [1, 7] || !matches!(p.len(), 84 | 92) {
        return;
    }
    let long = |at: usize| signed_le::<4>(p, at);
    let fixed = p[21] % 2 == 1 && p[78].is_multiple_of(2);
    // Type 1 is dead reckoning: there, but doubtful.
    let flat = |x: f64| (fixed && matches!(p[20], 2..=4)).then_some(x);
    let high = |x: f64| (fixed && matches!(p[20], 3 | 4)).then_some(x);
    said.degrees(Longitude, flat(long(24) * 1e-7));
    said.degrees(Latitude, flat(long(28) * 1e-7));
    said.put(HeightEllipsoid, high(long(32) * 1e-3));
    said.put(AltitudeMsl, high(long(36) * 1e-3));
    said.put(VerticalSpeed, high(-long(56) * 1e-3));
    said.put(GroundSpeed, flat(long(60) * 1e-3));
    let track = Some(long(64) * 1e-5).filter(|t| t.abs() <= 360.0);
    said.degrees(Track, track.and_then(|t| flat(t.rem_euclid(360.0))));
}

/// The CRC-32 of IEEE 802.3, bit by bit.
fn crc_32(bytes: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for byte in bytes {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = if crc % 2 == 0 {
                crc >> 1
            } else {
                crc >> 1 ^ 0xEDB8_8320
            };
        }
    }
    !crc
}

pub(crate) fn seal_mgl(frame: &mut Vec<u8>) {
    let n = frame.len();
    if n >= 20 {
        let crc = crc_32(&frame[4..n - 4]).to_le_bytes();
        frame[n - 4..].copy_from_slice(&crc);
    }
}

pub(crate) fn mgl_frames(bytes: &[u8], on: &mut dyn FnMut(&[u8])) {
    for i in 0..bytes.len().saturating_sub(19) {
        let [5, 2, length, complement] = bytes[i..i + 4] else {
            continue;
        };
        let n = if length == 0 {
            276
        } else {
            usize::from(length) + 20
        };
        if length ^ complement == 0xFF
            && let Some(frame) = bytes.get(i..i + n)
            && crc_32(&frame[4..n - 4]).to_le_bytes() == frame[n - 4..]
        {
            on(frame);
        }
    }
}

pub(crate) fn mgl(frame: &[u8], said: &mut Said) {
    let p = &frame[8..frame.len() - 4];
    let long = |at: usize| signed_le::<4>(p, at);
    let short = |at: usize| signed_le::<2>(p, at);
    let word = |at: usize| unsigned_le(p, at);
    match (frame[4], p.len()) {
        (1, 32) => {
            said.put(PressureAltitude, Some(long(0) * FOOT));
            said.put(BaroAltitude, Some(long(4) * FOOT));
            said.put(IndicatedAirspeed, Some(word(8) / 36.0));
            said.put(TrueAirspeed, Some(word(10) / 36.0));
            said.put(VerticalSpeed, Some(short(14) * FPM));
            said.put(StaticPressure, Some(word(16) / 10.0));
            said.put(BaroSetting, Some(word(18) / 10.0));
            said.put(StaticAirTemperature, Some(short(20) + 273.15));
        }
        (2, 44) => {
            let flat = |x: f64| matches!(p[34], 2..=5).then_some(x);
            let high = matches!(p[34], 3 | 5);
            said.degrees(Latitude, flat(long(0) / 180_000.0));
            said.degrees(Longitude, flat(long(4) / 180_000.0));
            said.put(AltitudeMsl, high.then(|| long(8) * FOOT));
            said.put(GroundSpeed, flat(word(28) / 36.0));
            said.compass(Track, flat(word(30) / 10.0));
        }
        (3, 28) => {
            said.compass(HeadingMagnetic, Some(word(0) / 10.0));
            said.degrees(Pitch, Some(short(2) / 10.0));
            said.degrees(Roll, Some(short(4) / 10.0));
            said.degrees(TurnRate, Some(short(8) / 10.0));
            said.put(NormalAcceleration, Some(short(12) / 100.0));
        }
        _ => {}
    }
}

/// A whole packet, by `net_fdm.hxx`.
pub(crate) fn fgfdm_frames(bytes: &[u8], on: &mut dyn FnMut(&[u8])) {
    let version = bytes.get(..4).unwrap_or_default();
    if (version, bytes.len()) == (&[0, 0, 0, 24], 408)
        || (version, bytes.len()) == (&[0, 0, 0, 25], 552)
    {
        on(bytes);
    }
}

pub(crate) fn fgfdm(p: &[u8], said: &mut Said) {
    let single = |at: usize| {
        let bits = u32::from_be_bytes([p[at], p[at + 1], p[at + 2], p[at + 3]]);
        Some(f64::from(f32::from_bits(bits))).filter(|x| x.is_finite())
    };
    let double = |at: usize| {
        let bits = p[at..at + 8].iter().fold(0, |n, b| n << 8 | u64::from(*b));
        Some(f64::from_bits(bits))
    };
    let feet = |at: usize| single(at).map(|x| x * FOOT);
    // A right angle and half a turn are rounded up by 32 bits.
    let angle = |at: usize, limit: f64| {
        single(at).map(|x| {
            if x.abs() - limit < 1e-6 {
                x.clamp(-limit, limit)
            } else {
                x
            }
        })
    };
    let turns = std::f64::consts::TAU;
    said.put(Longitude, double(8));
    said.put(Latitude, double(16));
    said.put(AltitudeMsl, double(24));
    said.put(Pitch, angle(40, turns / 4.0));
    said.put(HeadingTrue, single(44).map(|x| x.rem_euclid(turns)));
    said.put(AngleOfAttack, single(48));
    said.put(Sideslip, single(52));
    said.put(CalibratedAirspeed, single(68).map(|x| x * KNOT));
    said.put(VerticalSpeed, feet(72));
    let (north, east) = (feet(76), feet(80));
    let speed = north.and_then(|n| east.map(|e| (n * n + e * e).sqrt()));
    said.put(GroundSpeed, speed);
    let direction = north.and_then(|n| east.map(|e| e.atan2(n).rem_euclid(turns)));
    said.put(Track, direction);
    said.put(LongitudinalAcceleration, feet(100).map(|x| x / 9.806_65));
    said.put(LateralAcceleration, feet(104).map(|x| x / 9.806_65));
    said.put(NormalAcceleration, feet(108).map(|x| -x / 9.806_65));
    // Half a turn to either side is the same roll.
    said.put(Roll, angle(36, turns / 2.0));
    said.put(EngineSpeed, single(140));
}
