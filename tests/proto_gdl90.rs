//! GDL90: the published vectors, every sentinel, both recordings, and storms of damage.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

mod proto_support;
mod support;

use glasswing::proto::gdl90::crc;
use glasswing::proto::{Fault, Protocol};
use glasswing::sampled::Invalid;
use glasswing::signal::{Alert, Parameter, Place, Wire};
use glasswing::time::Monotonic;
use proto_support::{Heard, at, stream};

const AHRS: &str = "7E 65 01 00 64 00 32 84 D2 00 5F 00 65 B7 EF 7E";
const AHRS_INVALID: &str = "7E 65 01 7F FF 7F FF FF FF FF FF FF FF FB 12 7E";
const AHRS_STUFFED: &str = "7E 65 01 00 7D 5E 00 7D 5D 04 D2 00 5F 00 65 2B 82 7E";
const STRATUX: &str =
    "7E 4C 45 01 01 00 64 00 32 04 D2 00 00 00 1E 00 0A 7F FF 1D 4C 01 00 7F FF 95 76 7E";
const GEO_ALTITUDE: &str = "7E 0B 01 F4 00 0A 51 6C 7E";
const OWNSHIP: &str = "7E 0A 00 AB CD EF 21 C7 1C A9 07 F7 08 C9 88 05 F0 04 58 01 4E 31 32 33 34 35 20 20 00 60 55 7E";

fn hex(text: &str) -> Vec<u8> {
    text.split(' ')
        .map(|byte| u8::from_str_radix(byte, 16).expect("hexadecimal"))
        .collect()
}

/// The CRC bit by bit, from the standard's words rather than its table.
fn crc_by_bits(message: &[u8]) -> u16 {
    let mut crc = 0_u16;
    for byte in message {
        let mut high = crc & 0xFF00;
        for _ in 0..8 {
            high = if high & 0x8000 == 0 {
                high << 1
            } else {
                high << 1 ^ 0x1021
            };
        }
        crc = high ^ crc << 8 ^ u16::from(*byte);
    }
    crc
}

fn frame(message: &[u8]) -> Vec<u8> {
    let crc = crc_by_bits(message).to_le_bytes();
    let mut bytes = vec![0x7E];
    for &b in message.iter().chain(&crc) {
        if b == 0x7E || b == 0x7D {
            bytes.extend([0x7D, b ^ 0x20]);
        } else {
            bytes.push(b);
        }
    }
    bytes.push(0x7E);
    bytes
}

/// The one frame, which must be good.
fn one(bytes: &[u8]) -> Heard {
    let (heard, counters) = stream(Protocol::Gdl90, bytes);
    assert_eq!((counters.good, counters.total()), (1, 1), "{bytes:02X?}");
    heard
}

#[test]
fn the_standards_crc_is_not_xmodem() {
    let message = [0x00, 0x81, 0x41, 0xDB, 0xD0, 0x08, 0x02];
    assert_eq!(crc(&message), 0x8BB3);
    assert_eq!(crc_by_bits(&message), 0x8BB3);
}

#[test]
fn foreflight_attitude_decodes() {
    let heard = one(&hex(AHRS));
    heard.assert_near(Parameter::Roll, 10_f64.to_radians());
    heard.assert_near(Parameter::Pitch, 5_f64.to_radians());
    heard.assert_near(Parameter::HeadingMagnetic, 123.4_f64.to_radians());
    heard.assert_near(Parameter::IndicatedAirspeed, 95.0 * 1852.0 / 3600.0);
    heard.assert_near(Parameter::TrueAirspeed, 101.0 * 1852.0 / 3600.0);
    let heard = one(&hex(AHRS_STUFFED));
    heard.assert_near(Parameter::Roll, 12.6_f64.to_radians());
    heard.assert_near(Parameter::Pitch, 12.5_f64.to_radians());
    heard.assert_near(Parameter::HeadingTrue, 123.4_f64.to_radians());
}

#[test]
fn sentinels_are_absent_never_numbers() {
    let heard = one(&hex(AHRS_INVALID));
    for p in [
        Parameter::Roll,
        Parameter::Pitch,
        Parameter::HeadingMagnetic,
        Parameter::IndicatedAirspeed,
        Parameter::TrueAirspeed,
    ] {
        heard.assert_absent(p);
    }
    let mut stratux = vec![0x4C, 0x45, 1, 1];
    stratux.extend([0x7F, 0xFF].repeat(7));
    stratux.extend([0xFF, 0xFF, 0x7F, 0xFF, 0x7F, 0xFF]);
    let heard = one(&frame(&stratux));
    assert_eq!(heard.signals.len(), 9);
    assert!(
        heard
            .signals
            .iter()
            .all(|s| s.value == Err(Invalid::SourceFailed)),
        "{heard:?}"
    );
    // Ownship without a position, altitude, speed, climb and track.
    let mut ownship = vec![0x0A; 1];
    ownship.resize(28, 0);
    ownship[11..17].copy_from_slice(&[0xFF, 0xF8, 0x00, 0xFF, 0xF8, 0x00]);
    let heard = one(&frame(&ownship));
    for p in [
        Parameter::Latitude,
        Parameter::Longitude,
        Parameter::PressureAltitude,
        Parameter::GroundSpeed,
        Parameter::VerticalSpeed,
        Parameter::Track,
    ] {
        heard.assert_absent(p);
    }
}

#[test]
fn stratux_attitude_decodes_and_ground_speed_is_not_airspeed() {
    let heard = one(&hex(STRATUX));
    heard.assert_near(Parameter::Roll, 10_f64.to_radians());
    heard.assert_near(Parameter::Pitch, 5_f64.to_radians());
    heard.assert_near(Parameter::HeadingTrue, 123.4_f64.to_radians());
    heard.assert_near(Parameter::TurnRate, 3_f64.to_radians());
    heard.assert_near(Parameter::NormalAcceleration, 1.0);
    heard.assert_absent(Parameter::IndicatedAirspeed);
    heard.assert_near(Parameter::PressureAltitude, 762.0);
    heard.assert_near(Parameter::VerticalSpeed, 256.0 * 0.00508);
    let heard = one(&hex(OWNSHIP));
    assert_eq!(
        heard.last(Parameter::IndicatedAirspeed),
        None,
        "GPS speed is no airspeed"
    );
}

#[test]
fn ownship_and_geometric_altitude_decode() {
    let heard = one(&hex(OWNSHIP));
    // One unit of latitude is 180/2^23 degrees.
    let unit = 180.0 / 8_388_608.0;
    for (p, degrees) in [(Parameter::Latitude, 47.5), (Parameter::Longitude, -122.3)] {
        let got = heard.last(p).expect("said").expect("good").to_degrees();
        assert!((got - degrees).abs() <= unit, "{got}");
    }
    heard.assert_near(Parameter::PressureAltitude, 762.0);
    heard.assert_near(Parameter::GroundSpeed, 95.0 * 1852.0 / 3600.0);
    heard.assert_near(Parameter::VerticalSpeed, 256.0 * 0.00508);
    heard.assert_near(Parameter::Track, 123.75_f64.to_radians());
    heard.assert_near(Parameter::HorizontalAccuracy, 92.6);
    let heard = one(&hex(GEO_ALTITUDE));
    heard.assert_near(Parameter::HeightEllipsoid, 762.0);
    heard.assert_near(Parameter::VerticalAccuracy, 10.0);
}

#[test]
fn geometric_altitude_is_above_the_sea_when_the_sender_says_so() {
    let mut identity = vec![0x65, 0x00];
    identity.resize(39, 0);
    identity[38] = 1;
    let mut bytes = frame(&identity);
    bytes.extend(hex(GEO_ALTITUDE));
    let (heard, _) = stream(Protocol::Gdl90, &bytes);
    heard.assert_near(Parameter::AltitudeMsl, 762.0);
    assert_eq!(heard.last(Parameter::HeightEllipsoid), None);
}

#[test]
fn unknown_integrity_and_warnings_are_doubtful() {
    let mut message = hex(OWNSHIP)[1..29].to_vec();
    message[13] = 0x08;
    let heard = one(&frame(&message));
    assert_eq!(
        heard.last(Parameter::Latitude),
        Some(Err(Invalid::Doubtful))
    );
    let heard = one(&frame(&[0x0B, 0x01, 0xF4, 0x80, 0x0A]));
    assert_eq!(
        heard.last(Parameter::HeightEllipsoid),
        Some(Err(Invalid::Doubtful))
    );
}

#[test]
fn traffic_is_another_aircraft_and_never_a_signal() {
    let mut message = hex(OWNSHIP)[1..29].to_vec();
    (message[0], message[1]) = (0x14, 0x10);
    let heard = one(&frame(&message));
    assert!(heard.signals.is_empty(), "{heard:?}");
    let traffic = heard.traffic[0];
    assert_eq!(traffic.address, Some(0xAB_CDEF));
    assert_eq!(&traffic.callsign, b"N12345  ");
    assert_eq!((traffic.alert, traffic.airborne), (Alert::Low, Some(true)));
    assert!(
        matches!(traffic.place, Place::Geodetic { pressure_altitude_m: Some(a), .. } if (a - 762.0).abs() < 1e-9),
        "{traffic:?}"
    );
    // Beyond the pole: no place, no aircraft.
    message[5..8].copy_from_slice(&[0x7F, 0xFF, 0xFF]);
    assert!(one(&frame(&message)).traffic.is_empty());
}

#[test]
fn frames_cut_into_pieces_and_sharing_flags_are_whole() {
    let mut bytes = hex(AHRS);
    bytes.extend(&hex(STRATUX)[1..]);
    let mut decoder = Protocol::Gdl90.decoder();
    let mut heard = Heard::default();
    for (i, byte) in bytes.iter().enumerate() {
        decoder.push(
            at(i as u64, Wire::Stream(std::slice::from_ref(byte))),
            &mut heard,
        );
    }
    assert_eq!(
        (decoder.counters().good, decoder.counters().total()),
        (2, 2)
    );
    assert_eq!(
        heard.signals[0].at,
        Monotonic::from_nanos(14_000_000),
        "the last byte of its CRC"
    );
}

#[test]
fn wrong_lengths_are_named() {
    for (message, fault) in [
        (&[0x65, 1, 0, 0][..], Fault::Short),
        (&[0x0B, 0, 0, 0, 0, 0], Fault::Long),
    ] {
        let (heard, counters) = stream(Protocol::Gdl90, &frame(message));
        assert_eq!(
            (counters.bad(fault), counters.total(), heard.signals.len()),
            (1, 1, 0)
        );
    }
}

#[test]
fn recordings_decode_with_every_right_crc_and_no_wrong_one() {
    let Some(data) = support::data_dir() else {
        return;
    };
    // Counted by splitting at the flags and computing each CRC bit by bit, below.
    for (file, good, bad) in [("stratux_1.dat", 2070, 19), ("stratux_57.dat", 1046, 0)] {
        let bytes = std::fs::read(data.join("bus").join(file)).expect("read");
        let right = bytes
            .split(|b| *b == 0x7E)
            .filter(|piece| piece_is_right(piece))
            .count();
        assert_eq!(right, good, "{file}");
        let (heard, counters) = stream(Protocol::Gdl90, &bytes);
        assert_eq!(counters.good, good as u64, "{file}");
        assert_eq!((counters.bad_total(), counters.ignored), (bad, 0), "{file}");
        assert!(
            !heard.traffic.is_empty() && heard.signals.len() > 5000,
            "{file}"
        );
        for s in &heard.signals {
            if s.parameter == Parameter::IndicatedAirspeed {
                assert!(s.value.is_err(), "neither box has a pitot tube");
            }
        }
    }
}

fn piece_is_right(piece: &[u8]) -> bool {
    let mut message = Vec::new();
    let mut escaped = false;
    for &b in piece {
        match (b, escaped) {
            (0x7D, false) => escaped = true,
            (b, _) => {
                message.push(if escaped { b ^ 0x20 } else { b });
                escaped = false;
            }
        }
    }
    message.len() > 2 && !escaped && {
        let (body, sent) = message.split_at(message.len() - 2);
        crc_by_bits(body).to_le_bytes() == sent
    }
}
