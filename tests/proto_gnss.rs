//! NMEA and UBX: every sentence that is read, sentinels, mixed streams, recordings, storms of damage.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

mod proto_support;
mod support;

use glasswing::proto::capture::UdpCapture;
use glasswing::proto::{Counters, Fault, Protocol};
use glasswing::sampled::Invalid;
use glasswing::signal::{Alert, Parameter, Place, Wire};
use proto_support::{Heard, at, stream};

const KNOT: f64 = 1852.0 / 3600.0;

/// A sentence with its checksum.
fn sentence(body: &str) -> String {
    let sum = body.bytes().fold(0, |sum, b| sum ^ b);
    format!("${body}*{sum:02X}\r\n")
}

fn nmea(body: &str) -> Heard {
    let (heard, counters) = stream(Protocol::Nmea, sentence(body).as_bytes());
    assert_eq!((counters.good, counters.total()), (1, 1), "{body}");
    heard
}

/// A UBX frame with its checksum (RFC 1145).
fn ubx(class: u8, id: u8, payload: &[u8]) -> Vec<u8> {
    let length = u16::try_from(payload.len()).expect("short").to_le_bytes();
    let mut body = vec![class, id, length[0], length[1]];
    body.extend(payload);
    let (mut a, mut b) = (0_u32, 0_u32);
    for byte in &body {
        a += u32::from(*byte);
        b += a;
    }
    let mut frame = vec![0xB5, 0x62];
    frame.extend(body);
    frame.extend([a, b].map(|sum| sum.to_le_bytes()[0]));
    frame
}

/// NAV-PVT as the interface description lays it out, in its order.
fn nav_pvt(fix: u8, flags: u8) -> Vec<u8> {
    let mut p = Vec::new();
    p.extend(1000_u32.to_le_bytes()); // iTOW
    p.extend(2026_u16.to_le_bytes());
    p.extend([11, 22, 19, 8, 7, 0x0F]); // month to second, valid
    p.extend(25_u32.to_le_bytes()); // tAcc
    p.extend(500_000_000_i32.to_le_bytes()); // nano
    p.extend([fix, flags, 0, 14]); // fixType, flags, flags2, numSV
    p.extend((-1_223_000_000_i32).to_le_bytes()); // lon
    p.extend(475_000_000_i32.to_le_bytes()); // lat
    p.extend(762_000_i32.to_le_bytes()); // height
    p.extend(780_500_i32.to_le_bytes()); // hMSL
    p.extend(1500_u32.to_le_bytes()); // hAcc
    p.extend(2500_u32.to_le_bytes()); // vAcc
    p.extend(30_000_i32.to_le_bytes()); // velN
    p.extend(40_000_i32.to_le_bytes()); // velE
    p.extend((-1300_i32).to_le_bytes()); // velD
    p.extend(50_000_i32.to_le_bytes()); // gSpeed
    p.extend(5_313_000_i32.to_le_bytes()); // headMot
    p.resize(92, 0);
    p[88..90].copy_from_slice(&(-250_i16).to_le_bytes()); // magDec
    p
}

#[test]
fn positions_and_their_quality_decode() {
    let heard = nmea("GNGGA,131523.50,6359.1024,N,02239.2939,W,1,08,0.9,914.5,M,65.1,M,,");
    heard.assert_near(
        Parameter::Latitude,
        (63.0 + 59.1024 / 60.0_f64).to_radians(),
    );
    heard.assert_near(
        Parameter::Longitude,
        -(22.0 + 39.2939 / 60.0_f64).to_radians(),
    );
    heard.assert_near(Parameter::AltitudeMsl, 914.5);
    heard.assert_near(Parameter::SatellitesUsed, 8.0);
    heard.assert_near(Parameter::HorizontalDilution, 0.9);
    heard.assert_near(Parameter::UtcTimeOfDay, 13.0 * 3600.0 + 15.0 * 60.0 + 23.0);
    let heard = nmea("GPRMC,131523,A,6359.1024,S,02239.2939,E,98.3,70.0,221126,9.8,W,A");
    heard.assert_near(
        Parameter::Latitude,
        -(63.0 + 59.1024 / 60.0_f64).to_radians(),
    );
    heard.assert_near(
        Parameter::Longitude,
        (22.0 + 39.2939 / 60.0_f64).to_radians(),
    );
    heard.assert_near(Parameter::GroundSpeed, 98.3 * KNOT);
    heard.assert_near(Parameter::Track, 70_f64.to_radians());
    heard.assert_near(Parameter::MagneticVariation, -9.8_f64.to_radians());
    // 22 November 2026 is day 20779 (Python's datetime).
    heard.assert_near(Parameter::UtcDate, 20_779.0);
    let heard = nmea("GPVTG,70.0,T,79.8,M,98.3,N,182.1,K,A");
    heard.assert_near(Parameter::Track, 70_f64.to_radians());
    heard.assert_near(Parameter::TrackMagnetic, 79.8_f64.to_radians());
    heard.assert_near(Parameter::GroundSpeed, 98.3 * KNOT);
    let heard = nmea("GPGSA,A,3,01,02,03,,05,,07,,09,,11,12,2.0,0.9,1.8");
    heard.assert_near(Parameter::FixDimensions, 3.0);
    heard.assert_near(Parameter::HorizontalDilution, 0.9);
}

#[test]
fn without_a_fix_there_is_no_position_whatever_the_fields_say() {
    for body in [
        "GPGGA,131523,6359.1024,N,02239.2939,W,0,08,0.9,914.5,M,0.0,M,,",
        "GPGGA,131523,,,,,,,,,,,,,",
        "GPRMC,131523,V,6359.1024,N,02239.2939,W,98.3,70.0,221126,9.8,W,N",
        "GPRMC,131523,A,6359.1024,N,02239.2939,W,98.3,70.0,221126,9.8,W,N",
        "GPRMC,131523,A,,,,,,,221126,,",
    ] {
        let heard = nmea(body);
        heard.assert_absent(Parameter::Latitude);
        heard.assert_absent(Parameter::Longitude);
    }
    for body in [
        "GPGGA,131523,6359.1024,N,02239.2939,W,6,08,0.9,914.5,M,0.0,M,,",
        "GPGGA,131523,6359.1024,N,02239.2939,W,8,08,0.9,914.5,M,0.0,M,,",
        "GPRMC,131523,A,6359.1024,N,02239.2939,W,98.3,70.0,221126,9.8,W,E",
        "GPRMC,131523,A,6359.1024,N,02239.2939,W,98.3,70.0,221126,9.8,W,S",
    ] {
        let latitude = nmea(body).last(Parameter::Latitude);
        assert_eq!(latitude, Some(Err(Invalid::Doubtful)), "{body}");
    }
    let flat = sentence("GPGSA,A,2,01,02,03,,,,,,,,,,2.0,0.9,1.8")
        + &sentence("GPGGA,131523,6359.1024,N,02239.2939,W,1,03,0.9,914.5,M,0.0,M,,");
    let (heard, _) = stream(Protocol::Nmea, flat.as_bytes());
    assert_eq!(
        heard.last(Parameter::AltitudeMsl),
        Some(Err(Invalid::Doubtful))
    );
    assert!(
        matches!(heard.last(Parameter::Latitude), Some(Ok(_))),
        "{heard:?}"
    );
}

#[test]
fn fields_that_cannot_be_are_refused() {
    for (body, parameter) in [
        (
            "GPRMC,131523,A,9959.1,N,02239.2,W,98.3,70.0,221126,,",
            Parameter::Latitude,
        ),
        (
            "GPRMC,131523,A,6360.0,N,02239.2,W,98.3,70.0,221126,,",
            Parameter::Latitude,
        ),
        (
            "GPRMC,131523,A,6359.1,X,02239.2,W,98.3,70.0,221126,,",
            Parameter::Latitude,
        ),
        (
            "GPRMC,131523,A,6359.1,,02239.2,W,98.3,70.0,221126,,",
            Parameter::Latitude,
        ),
        (
            "GPRMC,131523,A,6,N,02239.2,W,98.3,70.0,221126,,",
            Parameter::Latitude,
        ),
        (
            "GPRMC,131523,A,6359.1,N,18139.2,W,98.3,70.0,221126,,",
            Parameter::Longitude,
        ),
        (
            "GPRMC,131523,A,6359.1,N,02239.2,W,1e9,70.0,221126,,",
            Parameter::GroundSpeed,
        ),
        (
            "GPRMC,131523,A,6359.1,N,02239.2,W,-5,70.0,221126,,",
            Parameter::GroundSpeed,
        ),
        (
            "GPRMC,131523,A,6359.1,N,02239.2,W,98.3,361,221126,,",
            Parameter::Track,
        ),
        (
            "GPRMC,251523,A,6359.1,N,02239.2,W,98.3,70.0,221126,,",
            Parameter::UtcTimeOfDay,
        ),
        (
            "GPRMC,131523,A,6359.1,N,02239.2,W,98.3,70.0,310226,,",
            Parameter::UtcDate,
        ),
        ("PGRMZ,1000,x,3", Parameter::PressureAltitude),
        ("PGRMZ,nan,f,3", Parameter::PressureAltitude),
    ] {
        let (heard, counters) = stream(Protocol::Nmea, sentence(body).as_bytes());
        assert_eq!(
            heard.last(parameter),
            Some(Err(Invalid::OutOfRange)),
            "{body}"
        );
        assert_eq!((counters.good, counters.flow.refused), (1, 1), "{body}");
    }
}

#[test]
fn gliding_instruments_decode() {
    nmea("PGRMZ,2282,f,3").assert_near(Parameter::PressureAltitude, 2282.0 * 0.3048);
    nmea("PGRMZ,695,m,3").assert_near(Parameter::PressureAltitude, 695.0);
    let heard = nmea("PLXVF,1.00,0.87,-0.12,-0.25,90.2,44.3,547.0");
    heard.assert_near(Parameter::IndicatedAirspeed, 44.3);
    heard.assert_near(Parameter::PressureAltitude, 547.0);
    let heard = nmea("LXWP0,Y,108.0,1665.5,1.71,,,,,,239,174,10.1");
    heard.assert_near(Parameter::IndicatedAirspeed, 30.0);
    heard.assert_near(Parameter::TotalEnergyVerticalSpeed, 1.71);
    assert_eq!(
        heard.last(Parameter::PressureAltitude),
        Some(Err(Invalid::Doubtful)),
        "some devices send it with the pilot's setting"
    );
    let heard = nmea("PXCV,1.5,0.5,0,1.00,1,12.5,1018.0,950.0,600.0,12.5,-3.0,0.0,0.0,1.0");
    heard.assert_near(Parameter::TotalEnergyVerticalSpeed, 1.5);
    heard.assert_near(Parameter::StaticAirTemperature, 285.65);
    heard.assert_near(Parameter::BaroSetting, 1018.0);
    heard.assert_near(Parameter::StaticPressure, 950.0);
    heard.assert_near(Parameter::TotalPressure, 956.0);
    heard.assert_near(Parameter::Roll, 12.5_f64.to_radians());
    heard.assert_near(Parameter::Pitch, -3_f64.to_radians());
}

#[test]
fn levil_attitude_without_a_checksum_is_marked_and_trusted_only_where_something_protects_it() {
    let heard = nmea("PLARA,12.3,-5.2,271.0");
    heard.assert_near(Parameter::Roll, 12.3_f64.to_radians());
    heard.assert_near(Parameter::Pitch, -5.2_f64.to_radians());
    heard.assert_near(Parameter::HeadingTrue, 271_f64.to_radians());
    let heard = nmea("APENV1,95,3500,0,0,0,-200,");
    heard.assert_near(Parameter::IndicatedAirspeed, 95.0 * 1852.0 / 3600.0);
    heard.assert_near(Parameter::PressureAltitude, 3500.0 * 0.3048);
    heard.assert_near(Parameter::VerticalSpeed, -200.0 * 0.3048 / 60.0);
    let heard = nmea("RPYL,123,-52,2710,0,31,1020,0");
    heard.assert_near(Parameter::Roll, 12.3_f64.to_radians());
    heard.assert_near(Parameter::Pitch, -5.2_f64.to_radians());
    heard.assert_near(Parameter::HeadingMagnetic, 271_f64.to_radians());
    heard.assert_near(Parameter::TurnRate, 3.1_f64.to_radians());
    heard.assert_near(Parameter::NormalAcceleration, 1.02);
    nmea("RPYL,123,-52,2710,0,31,1020,4").assert_absent(Parameter::Roll);
    let heard = nmea("RPYL,123,32767,32767,0,32767,32767,0");
    for p in [
        Parameter::Pitch,
        Parameter::HeadingMagnetic,
        Parameter::TurnRate,
    ] {
        heard.assert_absent(p);
    }
    let bare = b"$RPYL,123,-52,2710,0,31,1020,0\r\n";
    let (heard, counters) = stream(Protocol::Nmea, bare);
    assert_eq!(heard.last(Parameter::Roll), Some(Err(Invalid::Doubtful)));
    assert_eq!((counters.good, counters.flow.unchecked), (1, 1));
    let mut decoder = Protocol::Nmea.decoder();
    let mut heard = Heard::default();
    decoder.push(at(0, Wire::Datagram(bare)), &mut heard);
    heard.assert_near(Parameter::Roll, 12.3_f64.to_radians());
    assert_eq!(decoder.counters().flow.unchecked, 1);
    // Others without a checksum are bad.
    let (heard, counters) = stream(Protocol::Nmea, b"$PGRMZ,2282,f,3\r\n");
    assert_eq!(
        (heard.signals.len(), counters.bad(Fault::Unchecked)),
        (0, 1)
    );
}

#[test]
fn flarm_traffic_decodes() {
    let heard = nmea("PFLAA,0,-1540,-1020,-1126,1,39103C!FJLKN,93,0,33,4.9,8");
    let t = heard.traffic[0];
    assert_eq!(
        (t.address, &t.callsign, t.alert),
        (Some(0x39_103C), b"FJLKN   ", Alert::None)
    );
    assert_eq!(
        t.place,
        Place::Relative {
            north_m: -1540.0,
            east_m: -1020.0,
            up_m: -1126.0
        }
    );
    assert!(
        t.track_rad
            .is_some_and(|x| (x - 93_f64.to_radians()).abs() < 1e-12),
        "{t:?}"
    );
    assert_eq!(
        (t.ground_speed_mps, t.vertical_speed_mps),
        (Some(33.0), Some(4.9))
    );
    let t = nmea("PFLAA,3,1200,,50,2,DDA85C,,,,,8").traffic[0];
    assert_eq!(
        t.place,
        Place::Around {
            distance_m: 1200.0,
            up_m: 50.0
        }
    );
    assert_eq!((t.alert, t.track_rad), (Alert::Urgent, None));
    let t = nmea("PFLAU,3,1,2,1,2,-30,2,-32,755,1A304C").traffic[0];
    assert_eq!(t.address, Some(0x1A_304C));
    assert!(
        matches!(
            t.place,
            Place::Bearing {
                distance_m: 755.0,
                up_m: -32.0,
                ..
            }
        ),
        "{t:?}"
    );
    assert!(
        nmea("PFLAU,11,1,2,1,0,,0,,,").traffic.is_empty(),
        "nobody near"
    );
    for body in [
        "PFLAA,0,x,1,1,1,DDA85C,,,,,8",
        "PFLAA,0,9e9,1,1,1,DDA85C,,,,,8",
    ] {
        assert!(nmea(body).traffic.is_empty(), "{body}");
    }
}

#[test]
fn nav_pvt_decodes() {
    let frame = ubx(1, 7, &nav_pvt(3, 1));
    let (heard, counters) = stream(Protocol::Ubx, &frame);
    assert_eq!((counters.good, counters.total()), (1, 1));
    heard.assert_near(Parameter::Latitude, 47.5_f64.to_radians());
    heard.assert_near(Parameter::Longitude, -122.3_f64.to_radians());
    heard.assert_near(Parameter::HeightEllipsoid, 762.0);
    heard.assert_near(Parameter::AltitudeMsl, 780.5);
    heard.assert_near(Parameter::GroundSpeed, 50.0);
    heard.assert_near(Parameter::Track, 53.13_f64.to_radians());
    heard.assert_near(Parameter::VerticalSpeed, 1.3);
    heard.assert_near(Parameter::HorizontalAccuracy, 1.5);
    heard.assert_near(Parameter::VerticalAccuracy, 2.5);
    heard.assert_near(Parameter::SatellitesUsed, 14.0);
    heard.assert_near(Parameter::FixDimensions, 3.0);
    heard.assert_near(Parameter::MagneticVariation, -2.5_f64.to_radians());
    heard.assert_near(Parameter::UtcTimeOfDay, 19.0 * 3600.0 + 8.0 * 60.0 + 7.5);
    heard.assert_near(Parameter::UtcDate, 20_779.0);
}

#[test]
fn nav_pvt_without_a_fix_has_no_position() {
    for (fix, flags) in [(0, 0), (0, 1), (3, 0), (5, 1), (9, 1)] {
        let (heard, _) = stream(Protocol::Ubx, &ubx(1, 7, &nav_pvt(fix, flags)));
        for p in [
            Parameter::Latitude,
            Parameter::Longitude,
            Parameter::Track,
            Parameter::GroundSpeed,
        ] {
            heard.assert_absent(p);
        }
        heard.assert_near(Parameter::FixDimensions, 0.0);
    }
    let (heard, _) = stream(Protocol::Ubx, &ubx(1, 7, &nav_pvt(2, 1)));
    heard.assert_absent(Parameter::HeightEllipsoid);
    heard.assert_near(Parameter::Latitude, 47.5_f64.to_radians());
    let (heard, _) = stream(Protocol::Ubx, &ubx(1, 7, &nav_pvt(1, 1)));
    assert_eq!(
        heard.last(Parameter::Latitude),
        Some(Err(Invalid::Doubtful))
    );
    let mut invalid = nav_pvt(3, 1);
    invalid[78] = 1;
    stream(Protocol::Ubx, &ubx(1, 7, &invalid))
        .0
        .assert_absent(Parameter::Latitude);
}

#[test]
fn mixed_streams_and_fragments_resynchronise() {
    let pvt = ubx(1, 7, &nav_pvt(3, 1));
    let rmc = sentence("GPRMC,131523,A,6359.1024,N,02239.2939,W,98.3,70.0,221126,9.8,W,A");
    let rmc = rmc.as_bytes();
    // A UBX frame with a sentence's beginning inside, a frame without its middle, a sentence without its end.
    let dollars = ubx(4, 2, b"$GPRMC,1$GPGGA*");
    let mut bytes = Vec::new();
    for piece in [
        &rmc[9..],
        &pvt[..],
        rmc,
        &pvt[..40],
        &pvt,
        &rmc[..30],
        rmc,
        &dollars,
        &pvt,
        rmc,
    ] {
        bytes.extend(piece);
    }
    let (_, nmea) = stream(Protocol::Nmea, &bytes);
    assert_eq!((nmea.good, nmea.bad_total()), (3, 1), "{nmea:?}");
    let (_, ubx) = stream(Protocol::Ubx, &bytes);
    assert_eq!((ubx.good, ubx.bad_total()), (4, 1), "{ubx:?}");
    // However it is cut, the same comes of it.
    for size in [1, 2, 3, 7, 50] {
        for (protocol, whole) in [(Protocol::Nmea, nmea), (Protocol::Ubx, ubx)] {
            let mut decoder = protocol.decoder();
            for chunk in bytes.chunks(size) {
                decoder.push(at(0, Wire::Stream(chunk)), &mut Heard::default());
            }
            decoder.finish();
            assert_eq!(
                *decoder.counters(),
                whole,
                "{protocol:?} in pieces of {size}"
            );
        }
    }
}

#[test]
fn a_length_turned_over_on_the_line_delays_nothing() {
    let pvt = ubx(1, 7, &nav_pvt(3, 1));
    let mut damaged = pvt.clone();
    damaged[5] ^= 8;
    let (_, counters) = stream(Protocol::Ubx, &[&damaged[..], &pvt].concat());
    assert_eq!((counters.good, counters.bad(Fault::Long)), (1, 1));
}

fn capture(bytes: &[u8], protocol: Protocol) -> (Heard, Counters) {
    let mut decoder = protocol.decoder();
    let mut heard = Heard::default();
    for record in UdpCapture::new(bytes) {
        let (_, payload) = record.expect("whole");
        decoder.push(at(0, Wire::Datagram(payload)), &mut heard);
    }
    decoder.finish();
    let counters = *decoder.counters();
    (heard, counters)
}

#[test]
fn recordings_decode_with_every_right_checksum_and_no_wrong_one() {
    let Some(data) = support::data_dir() else {
        return;
    };
    let read = |file: &str| std::fs::read(data.join("bus").join(file)).expect("read");
    // 90 datagrams of three sentences each.
    let fgfs = read("fg2020.3.16_c172p_nmea.bin");
    let (heard, c) = capture(&fgfs, Protocol::Nmea);
    assert_eq!(
        (c.good, c.bad_total(), c.ignored, c.flow.refused),
        (270, 0, 0, 0)
    );
    assert!(matches!(heard.last(Parameter::Latitude), Some(Ok(_))));
    // Counted with a script: 1906 PFLAA, 470 PFLAU, 469 GSA, 467 PGRMZ, 466 GGA and 465 RMC lines with a right checksum, and
    // two more sentences, right as well, that some other text follows on their line.
    let (heard, c) = stream(Protocol::Nmea, &read("xcsoar_rl-traffic.nmea"));
    assert_eq!((c.good, c.bad_total(), c.ignored), (4245, 0, 2));
    assert_eq!(heard.traffic.len(), 1907, "every PFLAA");
    // 300 UBX frames and eight NMEA sentences, found by their checksums and lengths.
    let mixed = read("pyubx2_pygpsdata-MIXED.log");
    let (heard, c) = stream(Protocol::Ubx, &mixed);
    assert_eq!((c.good, c.bad_total(), c.ignored), (300, 0, 8));
    assert!(matches!(heard.last(Parameter::Latitude), Some(Ok(_))));
    let (_, c) = stream(Protocol::Nmea, &mixed);
    assert_eq!((c.good, c.bad_total(), c.ignored), (8, 0, 300));
    // An IGC file is no NMEA.
    let (heard, c) = stream(Protocol::Nmea, &read("0asljd01.igc"));
    assert_eq!((c.good, c.bad_total(), heard.signals.len()), (0, 0, 0));
}
