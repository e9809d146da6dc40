//! CAN-FIX: the published vector, every identifier against the standard's own tables, quality, limits, nodes, damage.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

mod proto_support;
mod support;

use glasswing::proto::can_fix::NODE_AGE_MAX;
use glasswing::proto::capture::CandumpLine;
use glasswing::proto::{Decoder, Fault, Protocol};
use glasswing::sampled::Invalid;
use glasswing::signal::{CanData, Parameter, Wire, engines};
use proto_support::{Heard, at};

const KNOT: f64 = 1852.0 / 3600.0;
const FOOT: f64 = 0.3048;
const INCH: f64 = 33.863_886_67;
const PSI: f64 = 68.947_572_931_683_6;
const GALLON: f64 = 3.785_411_784;

fn can(id: u32, bytes: &[u8]) -> CanData {
    let mut data = [0; 8];
    data[..bytes.len()].copy_from_slice(bytes);
    CanData {
        id,
        extended: false,
        len: u8::try_from(bytes.len()).expect("at most 8"),
        data,
    }
}

struct Bench {
    decoder: Box<dyn Decoder>,
    now_ms: u64,
}

impl Bench {
    fn new() -> Self {
        Self {
            decoder: Protocol::CanFix.decoder(),
            now_ms: 1000,
        }
    }

    fn push(&mut self, id: u32, bytes: &[u8]) -> Heard {
        let mut heard = Heard::default();
        self.decoder
            .push(at(self.now_ms, Wire::Can(can(id, bytes))), &mut heard);
        heard
    }
}

fn one(id: u32, bytes: &[u8]) -> Heard {
    let mut bench = Bench::new();
    let heard = bench.push(id, bytes);
    let c = bench.decoder.counters();
    assert_eq!((c.good, c.total()), (1, 1), "{id:#X}");
    heard
}

#[test]
fn the_published_vector_decodes_and_its_failure_does_not() {
    one(0x180, &[5, 0, 0, 0x08, 0x02]).assert_near(Parameter::Pitch, 5.2_f64.to_radians());
    one(0x180, &[5, 0, 4, 0x08, 0x02]).assert_absent(Parameter::Pitch);
    let doubtful = one(0x180, &[5, 0, 2, 0x08, 0x02]);
    assert_eq!(
        doubtful.last(Parameter::Pitch),
        Some(Err(Invalid::Doubtful))
    );
    // Annunciate says that the value is beyond a set point, not that it is wrong.
    one(0x180, &[5, 0, 1, 0x08, 0x02]).assert_near(Parameter::Pitch, 5.2_f64.to_radians());
}

fn int(x: i16) -> Vec<u8> {
    x.to_le_bytes().into()
}

fn uint(x: u16) -> Vec<u8> {
    x.to_le_bytes().into()
}

fn dint(x: i32) -> Vec<u8> {
    x.to_le_bytes().into()
}

fn float(x: f32) -> Vec<u8> {
    x.to_le_bytes().into()
}

/// Each identifier with a value decodes to the expected number, and with a byte less or more to none.
fn check(table: &[(u32, Vec<u8>, Parameter, f64)]) {
    for (id, value, parameter, expected) in table {
        let bytes = [&[5, 0, 0][..], value].concat();
        one(*id, &bytes).assert_near(*parameter, *expected);
        let mut bench = Bench::new();
        bench.push(*id, &bytes[..bytes.len() - 1]);
        assert_eq!(bench.decoder.counters().bad(Fault::Short), 1, "{id}");
        if bytes.len() < 8 {
            let mut bench = Bench::new();
            bench.push(*id, &[&bytes[..], &[0]].concat());
            assert_eq!(bench.decoder.counters().bad(Fault::Long), 1, "{id}");
        }
    }
}

// Identifiers in decimal, types and multipliers as in the standard's parameter reference: id, raw bytes, parameter, SI.

#[test]
fn every_identifier_of_flight_and_navigation_has_its_parameter_unit_and_sign() {
    let rad = f64::to_radians;
    check(&[
        (325, int(1500), Parameter::FlapAngle, rad(15.0)),
        (385, int(-4500), Parameter::Roll, rad(-45.0)),
        (386, int(750), Parameter::AngleOfAttack, rad(7.5)),
        (387, uint(955), Parameter::IndicatedAirspeed, 95.5 * KNOT),
        (388, dint(-120), Parameter::BaroAltitude, -120.0 * FOOT),
        (389, uint(2710), Parameter::HeadingMagnetic, rad(271.0)),
        (
            390,
            int(-500),
            Parameter::VerticalSpeed,
            -500.0 * FOOT / 60.0,
        ),
        (
            391,
            int(250),
            Parameter::TotalEnergyVerticalSpeed,
            2.5 * KNOT,
        ),
        (392, uint(500), Parameter::HeightAgl, 500.0 * FOOT),
        (394, int(1020), Parameter::NormalAcceleration, 1.02),
        (395, int(-50), Parameter::LateralAcceleration, -0.05),
        (396, int(100), Parameter::LongitudinalAcceleration, 0.1),
        (397, uint(1001), Parameter::TrueAirspeed, 100.1 * KNOT),
        (398, uint(960), Parameter::CalibratedAirspeed, 96.0 * KNOT),
        (399, uint(45), Parameter::MachNumber, 0.45),
        (400, uint(29_920), Parameter::BaroSetting, 29.92 * INCH),
        (401, dint(3500), Parameter::PressureAltitude, 3500.0 * FOOT),
        (449, int(-70), Parameter::GlidePathDeviation, rad(-0.7)),
        (451, float(47.25), Parameter::Latitude, rad(47.25)),
        (452, float(-70.5), Parameter::Longitude, rad(-70.5)),
        (453, uint(1200), Parameter::GroundSpeed, 120.0 * KNOT),
        (454, uint(900), Parameter::Track, rad(90.0)),
        (455, uint(880), Parameter::TrackMagnetic, rad(88.0)),
        (456, int(-25), Parameter::CrossTrack, -463.0),
        (457, uint(3599), Parameter::SelectedCourse, rad(359.9)),
        (
            459,
            int(700),
            Parameter::SelectedVerticalSpeed,
            700.0 * FOOT / 60.0,
        ),
        (460, uint(900), Parameter::SelectedAirspeed, 90.0 * KNOT),
        (461, dint(5500), Parameter::SelectedAltitude, 5500.0 * FOOT),
        (463, uint(30), Parameter::HorizontalAccuracy, 30.0 * FOOT),
        (464, uint(60), Parameter::VerticalAccuracy, 60.0 * FOOT),
    ]);
    one(1408, &[5, 0, 0, 12, 34, 56, 0xF4, 0x01]).assert_near(Parameter::UtcTimeOfDay, 45_296.5);
    one(1409, &[5, 0, 0, 0xEA, 0x07, 11, 22]).assert_near(Parameter::UtcDate, 20_779.0);
}

#[test]
fn every_identifier_of_rates_air_and_engine_has_its_parameter_unit_and_sign() {
    let rad = f64::to_radians;
    check(&[
        (512, uint(2400), Parameter::EngineSpeed, 2400.0),
        (513, uint(2300), Parameter::SecondEngineSpeed, 2300.0),
        (514, uint(2000), Parameter::PropellerSpeed, 2000.0),
        (518, uint(7000), Parameter::TurbineInletTemperature, 973.15),
        (538, uint(860), Parameter::FuelFlow, 8.6 * GALLON),
        (540, uint(450), Parameter::FuelPressure, 4.5 * PSI),
        (542, uint(2450), Parameter::ManifoldPressure, 24.5 * INCH),
        (544, uint(5500), Parameter::OilPressure, 55.0 * PSI),
        (546, uint(980), Parameter::OilTemperature, 371.15),
        (548, uint(850), Parameter::CoolantTemperature, 358.15),
        (550, uint(1280), Parameter::FuelQuantity1, 12.8 * GALLON),
        (553, uint(100), Parameter::FuelQuantity4, GALLON),
        (1024, int(31), Parameter::PitchRate, rad(3.1)),
        (1025, int(-31), Parameter::RollRate, rad(-3.1)),
        (1026, int(15), Parameter::YawRate, rad(1.5)),
        (1027, int(30), Parameter::TurnRate, rad(3.0)),
        (1028, uint(28_000), Parameter::StaticPressure, 28.0 * INCH),
        (1029, uint(28_500), Parameter::TotalPressure, 28.5 * INCH),
        (1030, int(-550), Parameter::TotalAirTemperature, 267.65),
        (1031, int(1500), Parameter::StaticAirTemperature, 288.15),
        (1032, dint(3900), Parameter::DensityAltitude, 3900.0 * FOOT),
        (1033, dint(3600), Parameter::AltitudeMsl, 3600.0 * FOOT),
        (1034, dint(3620), Parameter::AltitudeMsl, 3620.0 * FOOT),
        (1035, uint(120), Parameter::WindSpeed, 12.0 * KNOT),
        (
            1036,
            uint(24_000),
            Parameter::WindDirectionMagnetic,
            rad(240.0),
        ),
        (520, uint(7500), Parameter::InterTurbineTemperature, 1023.15),
        (
            523,
            uint(6000),
            Parameter::SecondTurbineOutletTemperature,
            873.15,
        ),
        (554, uint(4000), Parameter::FuelPumpPressure, 40.0 * PSI),
        (556, uint(150), Parameter::OilQuantity, 1.5 * GALLON),
        (
            559,
            uint(50),
            Parameter::SecondCoolantQuantity,
            0.5 * GALLON,
        ),
        (560, uint(210), Parameter::MotorCurrent, 210.0),
        (562, uint(3400), Parameter::PropulsionVoltage, 340.0),
        (564, int(-35), Parameter::BatteryCurrent1, -35.0),
        (567, uint(312), Parameter::BatteryTemperature2, 304.35),
        (568, uint(875), Parameter::BatteryCharge1, 87.5),
        (572, uint(3950), Parameter::UpperDeckPressure, 39.5 * INCH),
        (458, uint(30), Parameter::SelectedGlidePath, rad(3.0)),
        (1153, float(46.5), Parameter::WaypointLatitude, rad(46.5)),
        (1154, float(-7.25), Parameter::WaypointLongitude, rad(-7.25)),
        (1155, dint(2000), Parameter::WaypointAltitude, 2000.0 * FOOT),
        (1157, vec![1, 2, 3], Parameter::WaypointTimeToGo, 3723.0),
        (1297, uint(142), Parameter::BusVoltage4, 14.2),
        (1300, uint(25), Parameter::BusCurrent3, 2.5),
        (1302, uint(284), Parameter::GeneratorVoltage1, 28.4),
        (1309, uint(300), Parameter::GeneratorCurrent4, 30.0),
        (1314, uint(4321), Parameter::TachometerTime, 432.1),
        (1412, vec![55], Parameter::PanelDimmer, 55.0),
        (1292, uint(150), Parameter::CarburettorTemperature, 288.15),
        (1294, uint(141), Parameter::BusVoltage1, 14.1),
        (1298, uint(55), Parameter::BusCurrent1, 5.5),
        (1310, uint(750), Parameter::EnginePower, 75.0),
        (1312, uint(12_345), Parameter::EngineTime, 1234.5),
    ]);
}

#[test]
fn the_index_is_the_cylinder() {
    for (index, parameter) in engines::CYLINDER_HEAD_TEMPERATURE[0]
        .into_iter()
        .enumerate()
    {
        let index = u8::try_from(index).expect("six");
        one(1280, &[5, index, 0, 0x4C, 0x04]).assert_near(parameter, 110.0 + 273.15);
    }
    for (index, parameter) in engines::EXHAUST_GAS_TEMPERATURE[1].into_iter().enumerate() {
        let index = u8::try_from(index).expect("six");
        one(1283, &[5, index, 0, 0x58, 0x1B]).assert_near(parameter, 700.0 + 273.15);
    }
    let mut bench = Bench::new();
    assert!(
        bench.push(1280, &[5, 6, 0, 0x4C, 0x04]).signals.is_empty(),
        "no seventh cylinder"
    );
    assert!(
        bench.push(0x180, &[5, 1, 0, 0x08, 0x02]).signals.is_empty(),
        "no second pitch"
    );
    assert_eq!(bench.decoder.counters().ignored, 2);
}

#[test]
fn a_limit_is_never_the_value() {
    // Vne of 130 knots on the airspeed's own identifier.
    let heard = one(0x183, &[5, 0, 0x50, 0x14, 0x05]);
    assert!(heard.signals.is_empty(), "{heard:?}");
    let limit = heard.limits[0];
    assert_eq!(
        (limit.parameter, limit.kind),
        (Parameter::IndicatedAirspeed, "vne")
    );
    assert!((limit.value - 130.0 * KNOT).abs() < 1e-9, "{limit:?}");
    for meta in 1..16_u8 {
        for id in [0x180, 0x183, 0x200, 0x1C3, 0x580] {
            let mut bench = Bench::new();
            let heard = bench.push(id, &[5, 0, meta << 4, 0, 0, 0, 0, 0]);
            assert!(heard.signals.is_empty(), "{id:#X} {meta}");
        }
    }
    let heard = one(0x220, &[5, 0, 0x50, 0xC4, 0x09]);
    assert_eq!(heard.limits[0].kind, "low-alarm");
    assert!(
        one(0x183, &[5, 0, 0x54, 0x14, 0x05]).limits.is_empty(),
        "a failed one"
    );
}

#[test]
fn ranges_in_which_an_engine_may_not_run_for_long_are_limits() {
    for (meta, kind) in [
        (8, "restriction-1-low"),
        (9, "restriction-1-high"),
        (10, "restriction-2-low"),
        (11, "restriction-2-high"),
    ] {
        let heard = one(512, &[5, 0, meta << 4, 0x60, 0x09]);
        assert!(heard.signals.is_empty(), "a limit is no value");
        assert_eq!(heard.limits[0].kind, kind);
        assert!((heard.limits[0].value - 2400.0).abs() < 1e-9, "{kind}");
        assert!(
            one(544, &[5, 0, meta << 4, 0, 0]).limits.is_empty(),
            "oil has none"
        );
    }
}

#[test]
fn an_alarm_is_noted_and_says_that_its_node_is_alive() {
    let mut b = Bench::new();
    b.push(0x222, &[7, 0, 0, 0xD4, 0x03]);
    b.now_ms += 2000;
    assert!(b.push(7, &[0x34, 0x12]).signals.is_empty(), "no value");
    b.now_ms += 1900;
    let heard = b.push(0x180, &[5, 0, 0, 0, 0]);
    assert_eq!(heard.last(Parameter::OilTemperature), None, "alive");
    let c = b.decoder.counters();
    assert_eq!((c.flow.alarms, c.ignored, c.good), (1, 1, 2));
}

#[test]
fn the_second_node_is_listened_to_when_the_first_fails_or_falls_silent() {
    let mut b = Bench::new();
    let (first, second) = ([5, 0, 0, 100, 0], [6, 0, 0, 200, 0]);
    b.push(0x180, &first)
        .assert_near(Parameter::Pitch, 1_f64.to_radians());
    assert!(
        b.push(0x180, &second).signals.is_empty(),
        "the first is alive"
    );
    b.push(0x180, &[5, 0, 2, 100, 0]);
    b.push(0x180, &second)
        .assert_near(Parameter::Pitch, 2_f64.to_radians());
    assert!(
        b.push(0x180, &first).signals.is_empty(),
        "now the second is listened to"
    );
    b.now_ms += 301;
    b.push(0x180, &first)
        .assert_near(Parameter::Pitch, 1_f64.to_radians());
}

#[test]
fn all_that_a_lost_node_has_said_fails_at_once() {
    let mut b = Bench::new();
    b.push(0x222, &[7, 0, 0, 0xD4, 0x03])
        .assert_near(Parameter::OilTemperature, 371.15);
    b.push(0x580, &[8, 0, 0, 12, 0, 0, 0, 0]);
    let silence = u64::try_from(NODE_AGE_MAX.as_millis()).expect("two seconds");
    b.now_ms += silence;
    let heard = b.push(0x180, &[5, 0, 0, 0, 0]);
    assert_eq!(
        heard.last(Parameter::OilTemperature),
        None,
        "within its time"
    );
    // Node 8 says that it is alive; node 7 does not.
    b.push(0x6E0 + 8, &[11, 0, 0, 0, 0]);
    b.now_ms += 60;
    let heard = b.push(0x180, &[5, 0, 0, 0, 0]);
    heard.assert_absent(Parameter::OilTemperature);
    assert_eq!(heard.last(Parameter::UtcTimeOfDay), None, "alive");
    b.now_ms += 60;
    let heard = b.push(0x180, &[5, 0, 0, 0, 0]);
    assert_eq!(heard.last(Parameter::OilTemperature), None, "said once");
    b.push(0x222, &[7, 0, 0, 0xD4, 0x03])
        .assert_near(Parameter::OilTemperature, 371.15);
}

#[test]
fn numbers_that_cannot_be_are_told_as_faults() {
    for (id, value, fault) in [
        (0x1C3, f32::NAN.to_le_bytes(), Fault::NotFinite),
        (0x1C3, f32::INFINITY.to_le_bytes(), Fault::NotFinite),
        (0x1C3, 90.5_f32.to_le_bytes(), Fault::OutOfRange),
        (0x1C4, (-180.5_f32).to_le_bytes(), Fault::OutOfRange),
        (0x191, i32::MAX.to_le_bytes(), Fault::OutOfRange),
    ] {
        let mut bench = Bench::new();
        let heard = bench.push(id, &[&[5, 0, 0][..], &value].concat());
        assert_eq!(heard.signals[0].value, Err(Invalid::OutOfRange), "{id:#X}");
        assert_eq!(bench.decoder.counters().bad(fault), 1, "{id:#X}");
    }
    let mut bench = Bench::new();
    let heard = bench.push(0x185, &[5, 0, 0, 0xFF, 0xFF]);
    assert_eq!(
        heard.last(Parameter::HeadingMagnetic),
        Some(Err(Invalid::OutOfRange))
    );
}

#[test]
fn traffic_of_others_is_ignored_quietly() {
    let Some(data) = support::data_dir() else {
        return;
    };
    let log = std::fs::read_to_string(data.join("bus/gpsd_nmea2000_20140914.can.log"));
    let mut decoder = Protocol::CanFix.decoder();
    let mut heard = Heard::default();
    let mut frames = 0;
    for line in log.expect("read").lines() {
        if let CandumpLine::Data(seconds, can) = CandumpLine::parse(line) {
            frames += 1;
            let ms = std::time::Duration::from_secs_f64(seconds).as_millis();
            decoder.push(
                at(u64::try_from(ms).expect("small"), Wire::Can(can)),
                &mut heard,
            );
        }
    }
    let c = decoder.counters();
    assert_eq!((c.ignored, c.total()), (frames, frames));
    assert!(heard.signals.is_empty(), "29-bit frames are not CAN-FIX");
}
