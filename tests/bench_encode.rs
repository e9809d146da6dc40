//! Encoders against decoders, which were written apart from each other, and both against published frames.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

mod proto_support;
mod support;

use glasswing::bench::encode::{
    Encoder, can_fix, canaerospace, encoder, fg_generic, fgfdm, gdl90, nmea,
};
use glasswing::bench::{Aircraft, Bench, Truth};
use glasswing::proto::Protocol;
use glasswing::sampled::Invalid;
use glasswing::signal::{Alert, Frame, Parameter as P, Place, SourceId, Wire};
use glasswing::time::Monotonic;
use glasswing::units::{
    Feet, FeetPerMinute, Hectopascals, InchesOfMercury, Knots, Metres, MetresPerSecond,
};
use proto_support::Heard;
use std::time::Duration;

/// Something that can be of every parameter, no round number.
fn plausible(parameter: P) -> f64 {
    let spec = parameter.spec();
    match parameter {
        P::Pitch => 0.0712,
        P::Roll => -0.2134,
        P::BaroSetting => 1009.3,
        P::StaticPressure => 931.7,
        P::TotalPressure => 949.2,
        P::StaticAirTemperature | P::TotalAirTemperature => 284.4,
        P::Latitude => 0.831_234_567,
        P::Longitude => -2.134_567_891,
        P::AngleOfAttack | P::Sideslip | P::SlipBall | P::FlapAngle => 0.0432,
        P::UtcTimeOfDay => 45_296.0,
        P::UtcDate => 20_780.0,
        P::FixDimensions => 3.0,
        P::SatellitesUsed => 11.0,
        P::MagneticVariation => 0.2612,
        P::GroundSpeed => 53.21,
        P::WindSpeed => 6.31,
        P::EngineSpeed | P::SecondEngineSpeed => 2371.0,
        P::PropellerSpeed | P::SecondPropellerSpeed => 1712.0,
        P::FuelQuantity1 | P::FuelQuantity2 | P::FuelQuantity3 | P::FuelQuantity4 => 61.3,
        P::FuelFlow | P::SecondFuelFlow => 29.4,
        P::FuelPressure | P::SecondFuelPressure => 331.0,
        P::OilPressure | P::SecondOilPressure => 4123.0,
        P::ManifoldPressure | P::SecondManifoldPressure => 812.3,
        P::BusVoltage1 | P::BusVoltage2 => 13.8,
        P::BusCurrent1 | P::BusCurrent2 => 11.4,
        P::EngineTime | P::SecondEngineTime | P::TachometerTime => 812.3,
        P::FuelRemaining => 121.3,
        P::DifferentialPressure => 17.5,
        P::EnginePower | P::SecondEnginePower => 65.0,
        P::HorizontalAccuracy | P::VerticalAccuracy => 7.3,
        P::HorizontalDilution => 1.2,
        P::CrossTrack => 1234.0,
        P::TotalEnergyVerticalSpeed | P::VerticalSpeed | P::SelectedVerticalSpeed => 2.3,
        P::TurnRate | P::RollRate | P::PitchRate | P::YawRate => 0.123,
        P::HeightAgl => 712.0,
        P::WindDirectionMagnetic | P::WindDirectionTrue => 4.21,
        P::CourseDeflection | P::GlidePathDeflection => -0.37,
        P::LateralAcceleration | P::LongitudinalAcceleration => 0.043,
        P::NormalAcceleration => 1.13,
        P::AngleOfAttackUsed => 41.0,
        P::MachNumber => 0.17,
        P::HeadingTrue | P::HeadingMagnetic | P::Track | P::TrackMagnetic => 1.2345,
        _ => spec.min + 0.3 * (spec.max - spec.min),
    }
}

fn everything() -> Truth {
    let mut truth = Truth::nothing();
    for parameter in P::ALL {
        let value = plausible(*parameter);
        assert!(parameter.check(value).is_ok(), "{parameter:?} {value}");
        truth.set(*parameter, Ok(value));
    }
    // Temperatures that fields in degrees Celsius of four characters can hold.
    for parameter in P::ALL.iter().filter(|p| p.spec().name.ends_with("_k")) {
        truth.set(*parameter, Ok(380.0 + plausible(*parameter) * 0.05));
    }
    for parameter in [P::StaticAirTemperature, P::TotalAirTemperature] {
        truth.set(parameter, Ok(284.4));
    }
    truth
}

/// What the protocol's decoder makes of two seconds of an encoder.
fn heard_of(protocol: Protocol, encoder: Box<dyn Encoder>, truth: &Truth) -> Heard {
    let mut bench = Bench::new(encoder, Vec::new(), 1).expect("no faults");
    let mut decoder = protocol.decoder();
    let mut heard = Heard::default();
    while bench.next() < Duration::from_secs(2) {
        let at = Monotonic::from_nanos(1_000_000_000).plus(bench.next());
        bench.step(truth, &mut |wire| {
            let source = SourceId(0);
            decoder.push(Frame { at, source, wire }, &mut heard);
        });
    }
    decoder.finish();
    let counters = decoder.counters();
    assert_eq!(counters.bad_total(), 0, "{}: {counters:?}", protocol.name());
    assert!(counters.good > 0, "{}: {counters:?}", protocol.name());
    heard
}

/// Parameters whose field goes around the circle.
fn distance(parameter: P, a: f64, b: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    let d = (a - b).abs();
    if (parameter.spec().max - turn).abs() < 1e-9 {
        d.min(turn - d)
    } else {
        d
    }
}

#[test]
fn what_is_carried_comes_back_within_a_step() {
    let truth = everything();
    for protocol in Protocol::ALL {
        let heard = heard_of(protocol, encoder(protocol), &truth);
        let mut carried = 0;
        for parameter in P::ALL.iter().copied() {
            let Some(how) = encoder(protocol).carries(parameter) else {
                continue;
            };
            carried += 1;
            let name = protocol.name();
            let told = truth.get(parameter).expect("told");
            let got = heard.last(parameter);
            let Some(Ok(got)) = got else {
                panic!("{name} {parameter:?}: {got:?}, told {told}");
            };
            // Half a step, or a whole one where a clock is cut off; and the arithmetic of 64 bits.
            let near = how.resolution * 1.01 + 1e-9 * told.abs();
            let d = distance(parameter, told, got);
            assert!(
                d <= near,
                "{name} {parameter:?}: told {told}, got {got}, step {}",
                how.resolution
            );
        }
        assert!(carried >= 7, "{} carries {carried}", protocol.name());
    }
}

#[test]
fn what_is_missing_is_never_a_value() {
    for protocol in Protocol::ALL {
        let carried = |p: &&P| encoder(protocol).carries(**p).is_some();
        for parameter in P::ALL.iter().filter(carried).copied() {
            let how = encoder(protocol).carries(parameter).expect("carried");
            let name = protocol.name();
            let mut untrue = vec![(Err(Invalid::SourceFailed), how.absent)];
            untrue.push((Ok(f64::NAN), how.nan));
            untrue.extend(how.impossible(parameter).map(|x| (Ok(x), true)));
            untrue.push((Err(Invalid::Doubtful), how.doubtful));
            for (said, can_be_said) in untrue {
                let mut truth = everything();
                truth.set(parameter, said);
                let mut bench = Bench::new(encoder(protocol), Vec::new(), 1).expect("no faults");
                let mut decoder = protocol.decoder();
                let mut heard = Heard::default();
                while bench.next() < Duration::from_secs(1) {
                    let at = Monotonic::from_nanos(1_000_000_000).plus(bench.next());
                    let source = SourceId(0);
                    bench.step(&truth, &mut |wire| {
                        decoder.push(Frame { at, source, wire }, &mut heard);
                    });
                }
                let got = heard.last(parameter);
                let derived = parameter == P::FixDimensions || parameter == P::SatellitesUsed;
                if derived && !can_be_said {
                    continue;
                }
                assert!(
                    !matches!(got, Some(Ok(_))),
                    "{name} {parameter:?} {said:?}: {got:?}"
                );
                assert!(
                    !can_be_said || got.is_some() || !how.absent,
                    "{name} {parameter:?} {said:?}: nothing said"
                );
            }
        }
    }
}

#[test]
fn both_versions_of_flightgear_and_both_lengths_of_identifiers_are_read() {
    let truth = everything();
    let heard = heard_of(
        Protocol::FgFdm,
        Box::new(fgfdm::FgFdm::new(fgfdm::Version::V25)),
        &truth,
    );
    assert!(
        heard.last(P::Pitch).is_some_and(|x| x.is_ok()),
        "version 25"
    );
    let extended = canaerospace::CanAerospace::new().extended();
    let heard = heard_of(Protocol::CanAerospace, Box::new(extended), &truth);
    assert!(heard.last(P::Pitch).is_some_and(|x| x.is_ok()), "29 bits");
}

#[test]
fn a_line_follows_the_order_of_its_protocol_file() {
    let xml = "<PropertyList><generic><output><var_separator>tab</var_separator>\
               <chunk><node>/velocities/airspeed-kt</node><format>%.1f</format></chunk>\
               <!-- <chunk><node>/nothing</node></chunk> -->\
               <chunk><node>/sim/paused</node><format>%d</format></chunk>\
               <chunk><node>/orientation/pitch-deg</node><format>%.3f</format></chunk>\
               </output></generic></PropertyList>";
    let mut encoder = fg_generic::FgGeneric::new(xml).expect("a layout");
    let mut truth = Truth::nothing();
    truth.set(
        P::CalibratedAirspeed,
        Ok(MetresPerSecond::from(Knots(97.25)).0),
    );
    truth.set(P::Pitch, Ok(5.2_f64.to_radians()));
    assert_eq!(first(&mut encoder, 0, &truth), b"97.2\t0\t5.200\n");
    truth.set(P::Pitch, Err(Invalid::SourceFailed));
    assert_eq!(first(&mut encoder, 0, &truth), b"97.2\t0\tnan\n");
}

/// The first frame of a message.
fn first(encoder: &mut dyn Encoder, message: usize, truth: &Truth) -> Vec<u8> {
    nth(encoder, message, 0, truth)
}

fn nth(encoder: &mut dyn Encoder, message: usize, n: usize, truth: &Truth) -> Vec<u8> {
    let mut frames = Vec::new();
    encoder.write(message, truth, &mut |wire| match wire {
        Wire::Can(can) => {
            let id = can.id.to_be_bytes();
            frames.push([&id[2..], can.bytes()].concat());
        }
        Wire::Datagram(bytes) | Wire::Stream(bytes) => frames.push(bytes.to_vec()),
    });
    frames.swap_remove(n)
}

fn hex(text: &str) -> Vec<u8> {
    let byte = |word| u8::from_str_radix(word, 16).expect("hexadecimal");
    text.split_whitespace().map(byte).collect()
}

fn set(truth: &mut Truth, values: &[(P, f64)]) {
    for (parameter, value) in values {
        truth.set(*parameter, Ok(*value));
    }
}

fn degrees(x: f64) -> f64 {
    x.to_radians()
}

fn knots(x: f64) -> f64 {
    MetresPerSecond::from(Knots(x)).0
}

fn feet(x: f64) -> f64 {
    Metres::from(Feet(x)).0
}

fn fpm(x: f64) -> f64 {
    MetresPerSecond::from(FeetPerMinute(x)).0
}

/// What the published lines of Dynon and Garmin say; lateral acceleration is to the left there.
fn published_line() -> Truth {
    let mut truth = Truth::nothing();
    set(
        &mut truth,
        &[
            (P::UtcTimeOfDay, 12.0 * 3600.0 + 34.0 * 60.0 + 56.0),
            (P::Pitch, degrees(5.2)),
            (P::Roll, degrees(-12.3)),
            (P::HeadingMagnetic, degrees(271.0)),
            (P::IndicatedAirspeed, knots(95.5)),
            (P::PressureAltitude, feet(3500.0)),
            (P::TurnRate, degrees(-3.1)),
            (P::LateralAcceleration, -0.02),
            (P::NormalAcceleration, 1.0),
            (P::AngleOfAttackUsed, 25.0),
            (P::VerticalSpeed, fpm(-200.0)),
            (P::StaticAirTemperature, 288.15),
            (P::TrueAirspeed, knots(100.1)),
            (P::BaroSetting, Hectopascals::from(InchesOfMercury(27.5)).0),
            (P::DensityAltitude, feet(3900.0)),
            (P::WindDirectionMagnetic, degrees(240.0)),
            (P::WindSpeed, knots(12.0)),
        ],
    );
    truth
}

#[test]
fn lines_are_the_published_ones() {
    let mut truth = published_line();
    let mut skyview = encoder(Protocol::DynonSkyView);
    // The published line has +00 for a setting of 27.50, where recordings have digits only.
    let line = first(skyview.as_mut(), 0, &truth);
    assert_eq!((&line[56..59], &line[70..72]), (&b"000"[..], &b"60"[..]));
    let published = [&line[..56], b"+00", &line[59..70], b"5B\r\n"].concat();
    assert_eq!(
        published,
        b"!1112345600+052-01232710955+03500-031+02+1025-020+151001+00+03900240125B\r\n"
    );
    let mut garmin = encoder(Protocol::GarminG3x);
    truth.set(P::UtcTimeOfDay, Ok(45_296.781));
    truth.set(
        P::BaroSetting,
        Ok(Hectopascals::from(InchesOfMercury(29.92)).0),
    );
    assert_eq!(
        first(garmin.as_mut(), 0, &truth),
        b"=1112345678+052-01232710955+03500-031+02+1025-020+15242B1\r\n"
    );
    let nothing = [&b"=11"[..], &[b'_'; 52], b"EB\r\n"].concat();
    assert_eq!(first(garmin.as_mut(), 0, &Truth::nothing()), nothing);
}

#[test]
fn gdl90_is_the_published_one() {
    let mut truth = Truth::nothing();
    set(
        &mut truth,
        &[
            (P::Roll, degrees(10.0)),
            (P::Pitch, degrees(5.0)),
            (P::HeadingMagnetic, degrees(123.4)),
            (P::HeadingTrue, degrees(123.4)),
            (P::IndicatedAirspeed, knots(95.0)),
            (P::TrueAirspeed, knots(101.0)),
        ],
    );
    let mut gdl = encoder(Protocol::Gdl90);
    let ahrs = hex("7E 65 01 00 64 00 32 84 D2 00 5F 00 65 B7 EF 7E");
    assert_eq!(first(gdl.as_mut(), 2, &truth), ahrs);
    let nothing = hex("7E 65 01 7F FF 7F FF FF FF FF FF FF FF FB 12 7E");
    assert_eq!(first(gdl.as_mut(), 2, &Truth::nothing()), nothing);
    truth.set(P::IndicatedAirspeed, Err(Invalid::SourceFailed));
    set(
        &mut truth,
        &[
            (P::SlipBall, 0.0),
            (P::TurnRate, degrees(3.0)),
            (P::NormalAcceleration, 1.0),
            (P::PressureAltitude, feet(2500.0)),
            (P::VerticalSpeed, fpm(256.0)),
            (P::HeightEllipsoid, feet(2500.0)),
            (P::VerticalAccuracy, 10.0),
            (P::HorizontalAccuracy, 90.0),
            (P::Latitude, degrees(47.5)),
            (P::Longitude, degrees(-122.3)),
            (P::GroundSpeed, knots(95.0)),
            (P::Track, degrees(123.75)),
        ],
    );
    let stratux =
        hex("7E 4C 45 01 01 00 64 00 32 04 D2 00 00 00 1E 00 0A 7F FF 1D 4C 01 00 7F FF 95 76 7E");
    assert_eq!(first(gdl.as_mut(), 3, &truth), stratux);
    let ownship = hex(
        "7E 0A 00 AB CD EF 21 C7 1C A9 07 F7 08 C9 88 05 F0 04 58 01 4E 31 32 33 34 35 20 20 00 60 55 7E",
    );
    assert_eq!(first(gdl.as_mut(), 1, &truth), ownship);
    let altitude = hex("7E 0B 01 F4 00 0A 51 6C 7E");
    assert_eq!(nth(gdl.as_mut(), 1, 1, &truth), altitude);
    let escaped = hex("7E 65 01 00 7D 5E 00 7D 5D 04 D2 00 5F 00 65 2B 82 7E");
    let message = hex("65 01 00 7E 00 7D 04 D2 00 5F 00 65");
    assert_eq!(gdl90::frame(&message), escaped);
    // The vector of the ICD, section 2.2.4: the CRC is B3 8B on the wire.
    assert_eq!(
        gdl90::frame(&hex("00 81 41 DB D0 08 02")),
        hex("7E 00 81 41 DB D0 08 02 B3 8B 7E")
    );
}

#[test]
fn mgl_is_the_published_one() {
    let mut truth = Truth::nothing();
    set(
        &mut truth,
        &[
            (P::HeadingMagnetic, degrees(271.0)),
            (P::Pitch, degrees(5.2)),
            (P::Roll, degrees(-12.3)),
            (P::TurnRate, degrees(-3.1)),
            (P::NormalAcceleration, 1.02),
            (P::LateralAcceleration, 0.02),
            (P::LongitudinalAcceleration, 0.02),
        ],
    );
    let packet = first(encoder(Protocol::Mgl).as_mut(), 2, &truth);
    let published = hex(
        "05 02 14 EB 03 01 01 01 96 0A 34 00 85 FF 96 0A E1 FF 00 00 66 00 02 00 02 00 00 00 00 00 00 00 06 00 00 00 A7 EB B3 1C",
    );
    // The rate: recordings have 10 in its place.
    assert_eq!(packet[8..36], published[8..36]);
    let mut same = packet.clone();
    same[5] = published[5];
    assert_eq!(same[..8], published[..8]);
    assert_eq!(
        glasswing::bench::encode::mgl::packet(3, 1, 1, &published[8..36]),
        published
    );
}

#[test]
fn can_frames_are_the_published_ones() {
    let mut truth = Truth::nothing();
    truth.set(P::Pitch, Ok(degrees(5.2)));
    let mut fix = can_fix::CanFix::with_nodes(5);
    assert_eq!(first(&mut fix, 0, &truth), hex("01 80 05 00 00 08 02"));
    truth.set(P::Pitch, Err(Invalid::SourceFailed));
    assert_eq!(first(&mut fix, 0, &truth), hex("01 80 05 00 04 00 00"));
    truth.set(P::Pitch, Err(Invalid::Doubtful));
    assert_eq!(first(&mut fix, 0, &truth)[4], 2);
    truth.set(P::Pitch, Ok(degrees(5.2)));
    let mut aerospace = canaerospace::CanAerospace::with_nodes(1, 7);
    assert_eq!(
        first(&mut aerospace, 0, &truth),
        hex("01 37 01 02 00 07 40 A6 66 66")
    );
    let mut truth = Truth::nothing();
    truth.set(P::IndicatedAirspeed, Ok(49.5));
    let mut aerospace = canaerospace::CanAerospace::with_nodes(0, 8);
    assert_eq!(
        first(&mut aerospace, 1, &truth),
        hex("01 3B 01 02 00 08 42 46 00 00")
    );
}

fn other_aircraft() -> Aircraft {
    Aircraft {
        address: 0x00DD_8F12,
        callsign: *b"GHOST   ",
        latitude_rad: plausible(P::Latitude) + 2e-4,
        longitude_rad: plausible(P::Longitude),
        pressure_altitude_m: plausible(P::PressureAltitude) + 100.0,
        track_rad: degrees(90.0),
        ground_speed_mps: knots(80.0),
        vertical_speed_mps: 0.0,
        alert: Alert::Low,
    }
}

#[test]
fn other_aircraft_are_heard_where_they_are() {
    let mut truth = everything();
    truth.traffic.push(other_aircraft());
    let heard = heard_of(Protocol::Gdl90, encoder(Protocol::Gdl90), &truth);
    let got = heard.traffic.last().expect("heard");
    assert_eq!(
        (got.address, got.callsign),
        (Some(0x00DD_8F12), *b"GHOST   ")
    );
    let Place::Geodetic { latitude_rad, .. } = got.place else {
        panic!("{:?}", got.place);
    };
    assert!(
        (latitude_rad - other_aircraft().latitude_rad).abs() < 4e-7,
        "{latitude_rad}"
    );
    let heard = heard_of(Protocol::Nmea, encoder(Protocol::Nmea), &truth);
    let got = heard.traffic.last().expect("heard");
    let Place::Relative {
        north_m,
        east_m,
        up_m,
    } = got.place
    else {
        panic!("{:?}", got.place);
    };
    // 2e-4 rad of the meridian at 47.6 degrees: its radius is 6370 km there (WGS 84, 6335.4 + 63.9 sin2 km).
    assert!(
        (north_m - 1274.0).abs() < 1.5 && east_m.abs() < 1.0,
        "{north_m} {east_m}"
    );
    assert!((up_m - 100.0).abs() < 1.0, "{up_m}");
    let bearing = heard.traffic.iter().find_map(|t| match t.place {
        Place::Bearing {
            bearing_relative_rad,
            ..
        } => Some(bearing_relative_rad),
        _ => None,
    });
    let expected = -plausible(P::Track);
    assert!(
        bearing.is_some_and(|b| (b - expected).abs() < 0.01),
        "{bearing:?} {expected}"
    );
}

#[test]
fn lxwp0_has_its_airspeed_and_a_doubtful_altitude() {
    let line = nmea::lxwp0(&everything());
    let (heard, counters) = proto_support::stream(Protocol::Nmea, line.as_bytes());
    assert_eq!(counters.good, 1, "{line}");
    let speed = heard
        .last(P::IndicatedAirspeed)
        .expect("said")
        .expect("good");
    assert!(
        (speed - plausible(P::IndicatedAirspeed)).abs() < 0.02,
        "{speed}"
    );
    assert_eq!(
        heard.last(P::PressureAltitude),
        Some(Err(Invalid::Doubtful))
    );
}
