//! CANaerospace frames: the published vectors, every identifier, every way of being wrong, and recorded traffic.
#![expect(
    clippy::expect_used,
    clippy::panic,
    reason = "a helper that fails is a test that fails"
)]

mod canaerospace_support;
mod support;

use canaerospace_support::{Bench, assert_near, can, float};
use glasswing::proto::canaerospace::{CanAerospace, IDS, encode, encode_double, encode_no_data};
use glasswing::proto::capture::CandumpLine;
use glasswing::proto::{Decoder, Fault};
use glasswing::sampled::Invalid;
use glasswing::signal::{Frame, Parameter, Signal, SourceId, Wire};
use glasswing::time::Monotonic;
use std::f64::consts::{FRAC_PI_2, TAU};

#[test]
fn the_published_vectors_decode() {
    let mut bench = Bench::default();
    // Pitch +5.2 degrees, node 1, message 7; airspeed 49.5 m/s, node 1, message 8.
    let pitch = can(0x137, &[1, 2, 0, 7, 0x40, 0xA6, 0x66, 0x66]);
    assert_near(bench.one(pitch), Parameter::Pitch, 5.2_f64.to_radians());
    let airspeed = can(0x13B, &[1, 2, 0, 8, 0x42, 0x46, 0, 0]);
    assert_near(bench.one(airspeed), Parameter::IndicatedAirspeed, 49.5);
    assert_eq!(bench.decoder.counters().good, 2);
}

/// Each identifier with a number on the wire and what it means in SI, in 11 and in 29 bits.
fn check(table: &[(u32, f32, Parameter, f64)]) {
    for &(id, wire, parameter, expected) in table {
        for extended in [false, true] {
            let mut bench = Bench::default();
            let mut frame = float(id, 0, wire);
            frame.extended = extended;
            assert_near(bench.one(frame), parameter, expected);
            assert_eq!(bench.decoder.counters().good, 1, "{id}");
        }
        assert!(IDS.contains(&u16::try_from(id).expect("11 bits")), "{id}");
    }
}

// The standard's table, section 4.

#[test]
fn every_identifier_of_flight_has_its_parameter_unit_and_sign() {
    let rad = f64::to_radians;
    check(&[
        (300, 0.25, Parameter::LongitudinalAcceleration, 0.25),
        (301, -0.125, Parameter::LateralAcceleration, -0.125),
        (302, 1.5, Parameter::NormalAcceleration, 1.5),
        (303, 3.0, Parameter::PitchRate, rad(3.0)),
        (304, -4.0, Parameter::RollRate, rad(-4.0)),
        (305, 5.0, Parameter::YawRate, rad(5.0)),
        (311, -90.0, Parameter::Pitch, -FRAC_PI_2),
        (312, 180.0, Parameter::Roll, rad(180.0)),
        (313, 2.5, Parameter::Sideslip, rad(2.5)),
        (314, -5.0, Parameter::VerticalSpeed, -5.0),
        (315, 60.0, Parameter::IndicatedAirspeed, 60.0),
        (316, 70.0, Parameter::TrueAirspeed, 70.0),
        (317, 61.0, Parameter::CalibratedAirspeed, 61.0),
        (319, 1018.0, Parameter::BaroSetting, 1018.0),
        (320, 1234.5, Parameter::BaroAltitude, 1234.5),
        (321, -90.0, Parameter::HeadingTrue, rad(270.0)),
        (322, -50.0, Parameter::PressureAltitude, -50.0),
        (324, 273.25, Parameter::StaticAirTemperature, 273.25),
        (328, 7.0, Parameter::AngleOfAttack, rad(7.0)),
        (329, 8.0, Parameter::AngleOfAttack, rad(8.0)),
        (332, 2000.0, Parameter::AltitudeMsl, 2000.0),
        (335, 280.0, Parameter::StaticAirTemperature, 280.0),
        (500, 2400.0, Parameter::EngineSpeed, 2400.0),
        (564, 2410.0, Parameter::EngineSpeed, 2410.0),
        (1036, 47.25, Parameter::Latitude, rad(47.25)),
        (1037, -70.5, Parameter::Longitude, rad(-70.5)),
        (1038, 900.0, Parameter::HeightEllipsoid, 900.0),
        (1039, 55.0, Parameter::GroundSpeed, 55.0),
        (1040, 359.0, Parameter::Track, rad(359.0)),
        (1069, 10.0, Parameter::HeadingMagnetic, rad(10.0)),
        (1133, -180.0, Parameter::HeadingTrue, rad(180.0)),
    ]);
}

#[test]
fn every_identifier_of_air_engine_and_navigation_has_its_parameter_unit_and_sign() {
    let rad = f64::to_radians;
    check(&[
        (318, 0.3, Parameter::MachNumber, f64::from(0.3_f32)),
        (323, 290.5, Parameter::TotalAirTemperature, 290.5),
        (325, 25.5, Parameter::DifferentialPressure, 25.5),
        (326, 950.0, Parameter::StaticPressure, 950.0),
        (327, -3.0, Parameter::TurnRate, rad(-3.0)),
        (333, 7.5, Parameter::WindSpeed, 7.5),
        (334, -90.0, Parameter::WindDirectionTrue, rad(270.0)),
        (339, 975.5, Parameter::TotalPressure, 975.5),
        (501, 2300.0, Parameter::SecondEngineSpeed, 2300.0),
        (504, 2000.0, Parameter::PropellerSpeed, 2000.0),
        (512, 1000.0, Parameter::TurbineInletTemperature, 1000.0),
        (516, 950.0, Parameter::InterTurbineTemperature, 950.0),
        (520, 900.0, Parameter::ExhaustGasTemperature1, 900.0),
        (524, 28.5, Parameter::FuelFlow, 28.5),
        (528, 850.0, Parameter::ManifoldPressure, 850.0),
        (532, 3500.0, Parameter::OilPressure, 3500.0),
        (537, 363.0, Parameter::SecondOilTemperature, 363.0),
        (540, 400.0, Parameter::CylinderHeadTemperature1, 400.0),
        (544, 5.5, Parameter::OilQuantity, 5.5),
        (548, 360.0, Parameter::CoolantTemperature, 360.0),
        (588, 29.5, Parameter::FuelFlow, 29.5),
        (601, 365.0, Parameter::SecondOilTemperature, 365.0),
        (668, 45.0, Parameter::FuelMass1, 45.0),
        (671, 5.0, Parameter::FuelMass4, 5.0),
        (684, 300.0, Parameter::FuelPressure, 300.0),
        (920, 14.25, Parameter::BusVoltage1, 14.25),
        (931, -5.0, Parameter::BusCurrent2, -5.0),
        (1000, 46.5, Parameter::WaypointLatitude, rad(46.5)),
        (1001, -7.0, Parameter::WaypointLongitude, rad(-7.0)),
        (1003, 800.0, Parameter::WaypointAltitude, 800.0),
        (1007, -120.0, Parameter::CrossTrack, -120.0),
        (1009, 12.0, Parameter::WaypointTimeToGo, 720.0),
        (1041, -2.0, Parameter::TrackMagnetic, rad(358.0)),
        (1042, 60.0, Parameter::CrossTrack, 60.0),
        (1046, 6.5, Parameter::VerticalAccuracy, 6.5),
        (1047, 4.5, Parameter::HorizontalAccuracy, 4.5),
        (1070, 65.0, Parameter::HeightAgl, 65.0),
        (1087, 1.5, Parameter::LocalizerDeviation, rad(1.5)),
        (1091, -0.5, Parameter::GlidePathDeviation, rad(-0.5)),
        (1122, 3.0, Parameter::SelectedGlidePath, rad(3.0)),
    ]);
    // 48 of them are the engines': twelve quantities, two engines, two channels.
    assert_eq!(IDS.len(), 113, "and no other identifier");
}

#[test]
fn what_is_encoded_decodes_to_the_same_number() {
    let mut encoded = std::collections::HashSet::new();
    for &parameter in Parameter::ALL {
        let spec = parameter.spec();
        // The ends themselves may round beyond themselves in 32 bits of degrees, and are then refused.
        for k in 1..40 {
            let x = spec.min + (spec.max - spec.min) * f64::from(k) / 40.0;
            let mut bench = Bench::default();
            let Some(frame) = encode(parameter, x, 9, 3) else {
                continue;
            };
            encoded.insert(parameter);
            assert_eq!(frame.data[..4], [9, 2, 0, 3]);
            let (got, value) = bench.one(frame);
            assert_eq!(got, parameter);
            let value = value.expect("good");
            let error = (value - x).abs();
            // A turn is nothing for a direction; else the rounding of 32 bits, in degrees and back.
            let error = if spec.max >= TAU && spec.name.ends_with("_rad") {
                error.min(TAU - error)
            } else {
                error
            };
            assert!(
                error <= 2e-7 * spec.max.abs().max(spec.min.abs()),
                "{parameter:?} {x} came back as {value}"
            );
        }
        assert_eq!(encode(parameter, f64::NAN, 1, 0), None, "{parameter:?}");
        assert_eq!(
            encode(parameter, spec.max * 2.0 + 1.0, 1, 0),
            None,
            "{parameter:?}"
        );
    }
    // 113 identifiers; 24 channels B and four others stand in for another one of the same parameter, and UTC is no FLOAT.
    assert_eq!(encoded.len(), 113 - 28 - 1, "parameters with an identifier");
}

#[test]
fn positions_keep_64_bits_when_sent_as_doubles() {
    let mut bench = Bench::default();
    for (i, degrees) in [47.123_456_789_012, -0.000_000_123, 89.999_999_9]
        .into_iter()
        .enumerate()
    {
        bench.now_ms += 100;
        let code = u8::try_from(2 * i).expect("small") | 0x80;
        let x: f64 = f64::to_radians(degrees);
        let [high, low] = encode_double(Parameter::Latitude, x, 1, code).expect("positional");
        assert_eq!(
            (high.data[1], low.data[1]),
            (30, 31),
            "DOUBLEH, then DOUBLEL"
        );
        assert!(bench.push(high).is_empty(), "half a number is no number");
        let (parameter, value) = bench.one(low);
        assert_eq!(parameter, Parameter::Latitude);
        assert!((value.expect("good") - x).abs() < 1e-15, "{degrees}");
    }
    assert_eq!(bench.decoder.counters().good, 6);
    assert_eq!(
        encode_double(Parameter::Pitch, 0.1, 1, 0),
        None,
        "no angle but a position's"
    );
}

#[test]
fn halves_of_different_positions_never_meet() {
    let double = |x, code| encode_double(Parameter::Longitude, x, 1, code).expect("positional");
    let [high_a, low_a] = double(0.1, 10);
    let [high_b, low_b] = double(0.2, 12);
    for (what, frames) in [
        ("lower half alone", vec![(0, low_a)]),
        ("lower before upper", vec![(0, low_a), (1, high_a)]),
        (
            "upper of the one, lower of the next",
            vec![(0, high_a), (1, low_b)],
        ),
        ("late lower half", vec![(0, high_a), (11, low_a)]),
        ("lower half twice", vec![(0, high_b), (1, low_a)]),
        (
            "something else between",
            vec![(0, high_a), (1, can(1037, &[1, 0, 0, 11])), (2, low_a)],
        ),
    ] {
        let mut bench = Bench::default();
        for (ms, frame) in frames {
            bench.now_ms = ms;
            for signal in bench.push(frame) {
                assert_eq!(signal.value, Err(Invalid::SourceFailed), "{what}");
            }
        }
    }
    let mut bench = Bench::default();
    bench.push(low_b);
    assert_eq!(bench.decoder.counters().bad(Fault::Unpaired), 1);
}

#[test]
fn positions_may_come_as_integers() {
    let mut bench = Bench::default();
    // 50.1008000 degrees in units of 1e-7: 501 008 000 = 0x1DDCC680.
    let frame = can(1036, &[1, 3, 0, 0, 0x1D, 0xDC, 0xC6, 0x80]);
    let (parameter, value) = bench.one(frame);
    assert_eq!(parameter, Parameter::Latitude);
    assert!(
        (value.expect("good").to_degrees() - 50.1008).abs() < 1e-12,
        "{value:?}"
    );
    let south = can(1036, &[1, 3, 0, 1, 0xFF, 0xFF, 0xFF, 0xFF]);
    assert!(
        (bench.one(south).1.expect("good").to_degrees() + 1e-7).abs() < 1e-15,
        "two's complement"
    );
}

#[test]
fn what_a_sender_says_of_itself_is_passed_on() {
    let mut bench = Bench::default();
    assert_eq!(
        bench.one(can(311, &[1, 0, 0, 0])),
        (Parameter::Pitch, Err(Invalid::SourceFailed)),
        "NODATA"
    );
    assert_eq!(
        bench.one(can(312, &[1, 1, 0, 0, 0, 0, 0, 5])),
        (Parameter::Roll, Err(Invalid::SourceFailed)),
        "ERROR"
    );
    let no_data = encode_no_data(Parameter::IndicatedAirspeed, 1, 0).expect("has one");
    assert_eq!(
        bench.one(no_data),
        (Parameter::IndicatedAirspeed, Err(Invalid::SourceFailed))
    );
    let counters = bench.decoder.counters();
    assert_eq!((counters.good, counters.flow.failed), (3, 3));
}

#[test]
fn wrong_lengths_and_types_are_counted_and_give_nothing() {
    let full = [1, 2, 0, 0, 0x40, 0xA6, 0x66, 0x66];
    for length in 0..8 {
        let mut bench = Bench::default();
        assert!(bench.push(can(311, &full[..length])).is_empty(), "{length}");
        assert_eq!(bench.decoder.counters().bad(Fault::Short), 1, "{length}");
    }
    for data_type in 0..=255 {
        let mut frame = can(311, &full);
        frame.data[1] = data_type;
        let mut bench = Bench::default();
        let signals = bench.push(frame);
        let counters = bench.decoder.counters();
        match data_type {
            // NODATA with data contradicts itself.
            0 => assert_eq!((signals.len(), counters.bad(Fault::Long)), (0, 1)),
            1 => assert_eq!(signals[0].value, Err(Invalid::SourceFailed)),
            2 => assert!(signals[0].value.is_ok(), "FLOAT"),
            // A whole number of degrees as large as these bits is no pitch.
            3 | 4 => assert_eq!(signals[0].value, Err(Invalid::OutOfRange)),
            6 | 7 | 9 | 10 => assert_eq!((signals.len(), counters.bad(Fault::Long)), (0, 1)),
            _ => assert_eq!(
                (signals.len(), counters.bad(Fault::Type)),
                (0, 1),
                "type {data_type}"
            ),
        }
    }
}

#[test]
fn numbers_that_cannot_be_are_told_as_faults() {
    for (x, fault) in [
        (f32::NAN, Fault::NotFinite),
        (f32::INFINITY, Fault::NotFinite),
        (f32::NEG_INFINITY, Fault::NotFinite),
        (f32::MAX, Fault::OutOfRange),
        (-f32::MAX, Fault::OutOfRange),
    ] {
        for id in IDS {
            if id == 1200 {
                continue;
            }
            let mut bench = Bench::default();
            let (_, value) = bench.one(float(u32::from(id), 0, x));
            assert_eq!(value, Err(Invalid::OutOfRange), "{id} {x}");
            let counters = bench.decoder.counters();
            assert_eq!((counters.bad(fault), counters.total()), (1, 1), "{id} {x}");
        }
    }
}

#[test]
fn other_traffic_is_ignored_quietly() {
    let mut bench = Bench::default();
    let mut service = float(311, 0, 1.0);
    service.data[2] = 1;
    let mut foreign = float(311, 0, 1.0);
    (foreign.extended, foreign.id) = (true, 0x09F8_0000 | 311);
    for frame in [
        service,
        foreign,
        float(310, 0, 1.0),
        float(128, 0, 1.0),
        can(2047, &[]),
    ] {
        assert!(bench.push(frame).is_empty(), "{frame:?}");
    }
    let counters = bench.decoder.counters();
    assert_eq!((counters.ignored, counters.total()), (5, 5));
}

#[test]
fn whole_numbers_say_their_size_and_are_in_the_identifiers_unit() {
    for (data_type, value, expected) in [
        (3_u8, &[0, 0, 0x09, 0x60][..], 2400.0),
        (4, &[0, 0, 0x09, 0x60], 2400.0),
        (6, &[0x09, 0x60], 2400.0),
        (7, &[0x80, 0x00], 32_768.0),
        (9, &[0x7F], 127.0),
        (10, &[0xFF], 255.0),
    ] {
        let frame = can(500, &[&[1, data_type, 0, 0][..], value].concat());
        let got = Bench::default().one(frame);
        assert_near(got, Parameter::EngineSpeed, expected);
    }
    let below_zero = Bench::default().one(can(314, &[1, 6, 0, 0, 0xFF, 0xFE]));
    assert_near(below_zero, Parameter::VerticalSpeed, -2.0);
    let time = Bench::default().one(can(1200, &[1, 15, 0, 0, 13, 43, 22, 0]));
    assert_near(time, Parameter::UtcTimeOfDay, 49_402.0);
    let no_time = Bench::default().one(can(1200, &[1, 15, 0, 0, 24, 0, 0, 0]));
    assert_eq!(no_time.1, Err(Invalid::OutOfRange), "{no_time:?}");
    let mut bench = Bench::default();
    bench.push(float(1200, 0, 49_402.0));
    assert_eq!(bench.decoder.counters().bad(Fault::Type), 1);
}

#[test]
fn the_service_code_of_a_waypoint_is_its_number() {
    let mut frame = float(1003, 0, 800.0);
    frame.data[2] = 4;
    assert_near(
        Bench::default().one(frame),
        Parameter::WaypointAltitude,
        800.0,
    );
}

#[test]
fn a_stand_in_is_heard_only_without_its_principal() {
    let mut bench = Bench::default();
    assert_near(
        bench.one(float(321, 0, 10.0)),
        Parameter::HeadingTrue,
        10_f64.to_radians(),
    );
    assert_near(
        bench.one(float(1133, 0, 20.0)),
        Parameter::HeadingTrue,
        20_f64.to_radians(),
    );
    bench.now_ms = 2000;
    assert!(
        bench.push(float(321, 1, 10.0)).is_empty(),
        "true heading is fresh"
    );
    bench.now_ms = 2001;
    assert_near(
        bench.one(float(321, 2, 10.0)),
        Parameter::HeadingTrue,
        10_f64.to_radians(),
    );
    bench.push(float(1133, 1, 20.0));
    bench.push(can(1133, &[1, 0, 0, 2]));
    assert_near(
        bench.one(float(321, 3, 10.0)),
        Parameter::HeadingTrue,
        10_f64.to_radians(),
    );
}

#[test]
fn no_damage_gives_a_number_that_its_parameter_cannot_have() {
    let mut seed = 2_u64;
    let mut next = || {
        seed = seed
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        seed >> 33
    };
    let mut decoder = CanAerospace::new();
    let frames = 1_000_000;
    let mut numbers = 0_u64;
    for i in 0..frames {
        let id = IDS[usize::try_from(next()).unwrap() % IDS.len()];
        let types = [2, 2, 2, 3, 30, 31, 0, 1, 12, 40, 6, 15];
        let data_type = types[usize::try_from(next()).unwrap() % types.len()];
        let [a, b, c, d, ..] = (next() << 1 ^ next()).to_le_bytes();
        let mut frame = can(u32::from(id), &[1, data_type, 0, 0, a, b, c, d]);
        frame.data[3] = next().to_le_bytes()[0];
        match next() % 32 {
            0 => frame.len = (next() % 16).to_le_bytes()[0],
            1 => frame.data[2] = 1,
            2 => frame.id ^= 1 << (next() % 32),
            3 => frame.data[0] = 2,
            _ => {}
        }
        let frame = Frame {
            at: Monotonic::from_nanos(i * 1_000_000),
            source: SourceId(0),
            wire: Wire::Can(frame),
        };
        decoder.push(frame, &mut |s: Signal| {
            if let Ok(x) = s.value {
                let spec = s.parameter.spec();
                assert!(x.is_finite() && x >= spec.min && x <= spec.max, "{s:?}");
                numbers += 1;
            }
        });
    }
    assert_eq!(decoder.counters().total(), frames, "each counted once");
    assert!(numbers > 1000, "some were good: {numbers}");
}

/// Counts of a whole candump log: good, bad by kind, ignored, and signals made.
fn candump(path: &std::path::Path) -> (CanAerospace, usize) {
    let text = std::fs::read_to_string(path).expect("log");
    let mut bench = Bench::default();
    let mut signals = 0;
    for line in text.lines() {
        match CandumpLine::parse(line) {
            CandumpLine::Data(_, frame) => signals += bench.push(frame).len(),
            CandumpLine::Blank => {}
            other => panic!("{line}: {other:?}"),
        }
    }
    (bench.decoder, signals)
}

#[test]
fn recorded_traffic_of_others_is_ignored() {
    let Some(data) = support::data_dir() else {
        return;
    };
    let (decoder, signals) = candump(&data.join("bus/gpsd_nmea2000_20140914.can.log"));
    assert_eq!(signals, 0, "NMEA 2000 says nothing to us");
    assert_eq!(decoder.counters().ignored, 10_495);
    assert_eq!(decoder.counters().total(), 10_495);
}

#[test]
fn frames_that_contradict_themselves_give_no_airspeed() {
    let Some(data) = support::data_dir() else {
        return;
    };
    // Airspeeds sent as NODATA with four bytes of data, and two identifiers that are not ours.
    let (decoder, signals) = candump(&data.join("bus/ubx_canlog.log"));
    assert_eq!(signals, 0);
    let counters = decoder.counters();
    assert_eq!(counters.bad(Fault::Long), 288);
    assert_eq!(
        (counters.good, counters.ignored, counters.total()),
        (0, 24, 312)
    );
}
