//! FlightGear's FDM packets: the real recording against the simulator's truth, and every way of being wrong.
//!
//! Offsets here are accumulated from the order of the fields in FlightGear's structure, not taken from the decoder.

mod support;

use glasswing::proto::capture::UdpCapture;
use glasswing::proto::fgfdm::FgFdm;
use glasswing::proto::{Decoder, Fault};
use glasswing::sampled::Invalid;
use glasswing::signal::{CanData, Frame, Parameter, Signal, SourceId, Wire};
use glasswing::time::Monotonic;
use std::collections::HashMap;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Fields of `FGNetFDM` in their order: name, size of an element, number of elements. `v25` has the tanks of version 25.
fn layout(v25: bool) -> HashMap<&'static str, usize> {
    let mut fields = vec![
        ("version", 4, 1),
        ("padding", 4, 1),
        ("longitude", 8, 1),
        ("latitude", 8, 1),
        ("altitude", 8, 1),
        ("agl", 4, 1),
        ("phi", 4, 1),
        ("theta", 4, 1),
        ("psi", 4, 1),
        ("alpha", 4, 1),
        ("beta", 4, 1),
        ("phidot", 4, 1),
        ("thetadot", 4, 1),
        ("psidot", 4, 1),
        ("vcas", 4, 1),
        ("climb_rate", 4, 1),
        ("v_north", 4, 1),
        ("v_east", 4, 1),
        ("v_down", 4, 1),
        ("v_body", 4, 3),
        ("a_x_pilot", 4, 1),
        ("a_y_pilot", 4, 1),
        ("a_z_pilot", 4, 1),
        ("stall_warning", 4, 1),
        ("slip_deg", 4, 1),
        ("num_engines", 4, 1),
        ("eng_state", 4, 4),
        ("rpm", 4, 4),
        ("fuel_flow", 4, 4),
        ("fuel_px_egt", 4, 8),
        ("cht", 4, 4),
        ("mp_osi_tit", 4, 8),
        ("oil_temp", 4, 4),
        ("oil_px", 4, 4),
        ("num_tanks", 4, 1),
        ("fuel_quantity", 4, 4),
    ];
    if v25 {
        fields.extend([
            ("tank_selected", 4, 4),
            ("tank_capacity", 8, 4),
            ("tank_unusable_density", 8, 8),
            ("tank_level", 8, 4),
        ]);
    }
    fields.extend([
        ("num_wheels", 4, 1),
        ("wheels", 4, 3 * 4),
        ("time_warp_visibility", 4, 3),
        ("controls", 4, 10),
    ]);
    let mut offsets = HashMap::new();
    let mut at: usize = 0;
    for (name, size, count) in fields {
        if name == "tank_capacity" {
            // Doubles after 320 bytes: no padding is needed for them to be aligned.
            assert_eq!(at % 8, 0, "aligned");
        }
        offsets.insert(name, at);
        at += size * count;
    }
    // A structure with doubles is padded to their alignment.
    offsets.insert("end", at.next_multiple_of(8));
    offsets
}

struct Packet {
    bytes: Vec<u8>,
    offsets: HashMap<&'static str, usize>,
}

impl Packet {
    /// An ordinary moment of flight.
    fn flying(version: u32) -> Self {
        let offsets = layout(version == 25);
        let mut packet = Self {
            bytes: vec![0; offsets["end"]],
            offsets,
        };
        packet.u32("version", version);
        packet.f64("longitude", 0.25);
        packet.f64("latitude", 0.875);
        packet.f64("altitude", 1500.0);
        for (name, value) in [
            ("phi", -0.25),
            ("theta", 0.125),
            ("psi", 4.5),
            ("alpha", 0.0625),
            ("beta", -0.03125),
            ("phidot", 0.5),
            ("thetadot", 0.25),
            ("psidot", -0.125),
            ("vcas", 100.0),
            ("climb_rate", 10.0),
            ("v_north", -30.0),
            ("v_east", -40.0),
            ("a_x_pilot", 3.217_405),
            ("a_y_pilot", -1.608_702_4),
            ("a_z_pilot", -32.174_05),
            ("rpm", 2300.0),
        ] {
            packet.f32(name, value);
        }
        packet.u32("num_engines", 1);
        packet
    }

    fn put(&mut self, name: &str, bytes: &[u8]) {
        let at = self.offsets[name];
        self.bytes[at..at + bytes.len()].copy_from_slice(bytes);
    }

    fn u32(&mut self, name: &str, value: u32) {
        self.put(name, &value.to_be_bytes());
    }

    fn f32(&mut self, name: &str, value: f32) {
        self.put(name, &value.to_be_bytes());
    }

    fn f64(&mut self, name: &str, value: f64) {
        self.put(name, &value.to_be_bytes());
    }
}

fn decode(decoder: &mut FgFdm, bytes: &[u8]) -> Vec<Signal> {
    let mut signals = Vec::new();
    let frame = Frame {
        at: Monotonic::from_nanos(7),
        source: SourceId(3),
        wire: Wire::Datagram(bytes),
    };
    decoder.push(frame, &mut |s| signals.push(s));
    signals
}

fn value(signals: &[Signal], parameter: Parameter) -> Option<Result<f64, Invalid>> {
    let mut of_it = signals.iter().filter(|s| s.parameter == parameter);
    let value = of_it.next().map(|s| s.value);
    assert!(of_it.next().is_none(), "{parameter:?} came twice");
    value
}

fn assert_near(signals: &[Signal], parameter: Parameter, expected: f64) {
    let got = value(signals, parameter);
    assert!(
        matches!(got, Some(Ok(x)) if (x - expected).abs() < 1e-6 * expected.abs().max(1.0)),
        "{parameter:?}: {got:?}, not {expected}"
    );
}

#[test]
fn the_structure_has_the_published_sizes() {
    assert_eq!(layout(false)["end"], 408);
    assert_eq!(layout(true)["end"], 552);
}

#[test]
fn both_versions_give_every_field_in_si() {
    for version in [24, 25] {
        let mut decoder = FgFdm::new();
        let signals = decode(&mut decoder, &Packet::flying(version).bytes);
        // Body rates from the Euler rates by the rotation matrix written out (Stevens and Lewis, 1.4-3).
        let (phi, theta) = (-0.25_f64, 0.125_f64);
        let expected = [
            (Parameter::Pitch, 0.125),
            (Parameter::Roll, -0.25),
            (Parameter::HeadingTrue, 4.5),
            (Parameter::RollRate, 0.5 + 0.125 * theta.sin()),
            (
                Parameter::PitchRate,
                phi.cos() * 0.25 + phi.sin() * theta.cos() * -0.125,
            ),
            (
                Parameter::YawRate,
                -phi.sin() * 0.25 + phi.cos() * theta.cos() * -0.125,
            ),
            (Parameter::Latitude, 0.875),
            (Parameter::Longitude, 0.25),
            (Parameter::AltitudeMsl, 1500.0),
            (Parameter::CalibratedAirspeed, 51.444_444),
            (Parameter::AngleOfAttack, 0.0625),
            (Parameter::Sideslip, -0.03125),
            (Parameter::VerticalSpeed, 3.048),
            // 3-4-5: 50 ft/s to the south-west.
            (Parameter::GroundSpeed, 15.24),
            (Parameter::Track, PI + (4.0_f64 / 3.0).atan()),
            (Parameter::LongitudinalAcceleration, 0.1),
            (Parameter::LateralAcceleration, -0.05),
            (Parameter::NormalAcceleration, 1.0),
            (Parameter::EngineSpeed, 2300.0),
        ];
        for (parameter, x) in expected {
            assert_near(&signals, parameter, x);
        }
        assert_eq!(signals.len(), expected.len(), "and nothing else");
        assert!(
            signals
                .iter()
                .all(|s| s.at == Monotonic::from_nanos(7) && s.source == SourceId(3)),
            "stamped with the frame's time and source"
        );
        assert_eq!(
            (decoder.counters().good, decoder.counters().total()),
            (1, 1)
        );
    }
}

#[test]
fn a_packet_of_any_other_length_is_counted_and_gives_nothing() {
    for (version, right) in [(24, 408), (25, 552)] {
        let mut bytes = Packet::flying(version).bytes;
        bytes.resize(1473, 0);
        for length in 0..bytes.len() {
            let mut decoder = FgFdm::new();
            let signals = decode(&mut decoder, &bytes[..length]);
            let counters = decoder.counters();
            if length == right {
                assert_eq!(counters.good, 1, "{length}");
                continue;
            }
            assert!(signals.is_empty(), "{length} bytes gave {signals:?}");
            let kind = if length < right {
                Fault::Short
            } else {
                Fault::Long
            };
            assert_eq!((counters.bad(kind), counters.total()), (1, 1), "{length}");
        }
    }
}

#[test]
fn an_unknown_version_is_counted_and_gives_nothing() {
    for version in [0, 23, 26, 24_u32.swap_bytes(), u32::MAX] {
        let mut packet = Packet::flying(24);
        packet.u32("version", version);
        let mut decoder = FgFdm::new();
        assert!(decode(&mut decoder, &packet.bytes).is_empty(), "{version}");
        assert_eq!(
            decoder.counters().bad(Fault::UnknownVersion),
            1,
            "{version}"
        );
    }
}

/// Each field of the wire and the parameters made from it.
const FIELDS: [(&str, &[Parameter]); 19] = [
    ("latitude", &[Parameter::Latitude]),
    ("longitude", &[Parameter::Longitude]),
    ("altitude", &[Parameter::AltitudeMsl]),
    (
        "phi",
        &[Parameter::Roll, Parameter::PitchRate, Parameter::YawRate],
    ),
    (
        "theta",
        &[
            Parameter::Pitch,
            Parameter::RollRate,
            Parameter::PitchRate,
            Parameter::YawRate,
        ],
    ),
    ("psi", &[Parameter::HeadingTrue]),
    ("alpha", &[Parameter::AngleOfAttack]),
    ("beta", &[Parameter::Sideslip]),
    ("phidot", &[Parameter::RollRate]),
    ("thetadot", &[Parameter::PitchRate, Parameter::YawRate]),
    (
        "psidot",
        &[
            Parameter::RollRate,
            Parameter::PitchRate,
            Parameter::YawRate,
        ],
    ),
    ("vcas", &[Parameter::CalibratedAirspeed]),
    ("climb_rate", &[Parameter::VerticalSpeed]),
    ("v_north", &[Parameter::GroundSpeed, Parameter::Track]),
    ("v_east", &[Parameter::GroundSpeed, Parameter::Track]),
    ("a_x_pilot", &[Parameter::LongitudinalAcceleration]),
    ("a_y_pilot", &[Parameter::LateralAcceleration]),
    ("a_z_pilot", &[Parameter::NormalAcceleration]),
    ("rpm", &[Parameter::EngineSpeed]),
];

#[test]
fn a_field_that_is_not_a_number_costs_that_field_only() {
    let healthy = decode(&mut FgFdm::new(), &Packet::flying(24).bytes);
    for (field, parameters) in FIELDS {
        for x in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut packet = Packet::flying(24);
            if matches!(field, "latitude" | "longitude" | "altitude") {
                packet.f64(field, x);
            } else {
                #[expect(clippy::cast_possible_truncation, reason = "NaN and infinities")]
                packet.f32(field, x as f32);
            }
            let mut decoder = FgFdm::new();
            let signals = decode(&mut decoder, &packet.bytes);
            for s in &signals {
                if parameters.contains(&s.parameter) {
                    assert_eq!(s.value, Err(Invalid::OutOfRange), "{field} {x}: {s:?}");
                } else {
                    assert_eq!(Some(s.value), value(&healthy, s.parameter), "{field} {x}");
                }
            }
            assert!(
                parameters
                    .iter()
                    .all(|p| signals.iter().any(|s| s.parameter == *p)),
                "{field} {x}: the fault is told"
            );
            let counters = decoder.counters();
            assert_eq!(
                (counters.bad(Fault::NotFinite), counters.total()),
                (1, 1),
                "{field} {x}"
            );
        }
    }
}

#[test]
fn an_impossible_field_costs_that_field_only() {
    for (field, x, parameter) in [
        ("theta", 1.6, Parameter::Pitch),
        ("phi", -3.2, Parameter::Roll),
        ("psi", 13.0, Parameter::HeadingTrue),
        ("vcas", -1.0, Parameter::CalibratedAirspeed),
        ("vcas", 1e6, Parameter::CalibratedAirspeed),
        ("climb_rate", -1e4, Parameter::VerticalSpeed),
        ("a_z_pilot", 1e4, Parameter::NormalAcceleration),
        ("rpm", -1.0, Parameter::EngineSpeed),
    ] {
        let mut packet = Packet::flying(25);
        packet.f32(field, x);
        let mut decoder = FgFdm::new();
        let signals = decode(&mut decoder, &packet.bytes);
        assert_eq!(
            value(&signals, parameter),
            Some(Err(Invalid::OutOfRange)),
            "{field} {x}"
        );
        let refused = signals.iter().filter(|s| s.value.is_err()).count();
        assert_eq!(refused, 1, "{field} {x}: {signals:?}");
        let counters = decoder.counters();
        assert_eq!(
            (counters.bad(Fault::OutOfRange), counters.total()),
            (1, 1),
            "{field} {x}"
        );
    }
    for (field, x, parameter) in [
        ("latitude", FRAC_PI_2 + 1e-9, Parameter::Latitude),
        ("longitude", -PI - 1e-9, Parameter::Longitude),
        ("altitude", 40_000.0, Parameter::AltitudeMsl),
    ] {
        let mut packet = Packet::flying(24);
        packet.f64(field, x);
        let signals = decode(&mut FgFdm::new(), &packet.bytes);
        assert_eq!(
            value(&signals, parameter),
            Some(Err(Invalid::OutOfRange)),
            "{field} {x}"
        );
    }
}

#[test]
fn headings_a_turn_off_are_the_same_heading() {
    for (psi, expected) in [
        (-0.5_f32, TAU - 0.5),
        (6.5, 6.5 - TAU),
        (-12.5, 2.0 * TAU - 12.5),
    ] {
        let mut packet = Packet::flying(24);
        packet.f32("psi", psi);
        let signals = decode(&mut FgFdm::new(), &packet.bytes);
        assert_near(&signals, Parameter::HeadingTrue, expected);
    }
}

#[test]
fn standing_still_has_no_track_and_no_engine_has_no_speed() {
    let mut packet = Packet::flying(24);
    packet.f32("v_north", 0.0);
    packet.f32("v_east", 0.0);
    packet.u32("num_engines", 0);
    let mut decoder = FgFdm::new();
    let signals = decode(&mut decoder, &packet.bytes);
    assert_near(&signals, Parameter::GroundSpeed, 0.0);
    assert_eq!(value(&signals, Parameter::Track), None);
    assert_eq!(value(&signals, Parameter::EngineSpeed), None);
    assert_eq!(decoder.counters().good, 1);
    packet.u32("num_engines", 0x0100_0000);
    let signals = decode(&mut decoder, &packet.bytes);
    assert_eq!(
        value(&signals, Parameter::EngineSpeed),
        Some(Err(Invalid::OutOfRange)),
        "a byte-swapped number of engines is none"
    );
}

#[test]
fn what_a_sender_does_not_model_is_not_said() {
    let mut packet = Packet::flying(25);
    let engines = [
        ("agl", 120.0, Parameter::HeightAgl, 120.0),
        // 8.5 US gallons of 231 cubic inches; 212 degrees Fahrenheit is where water boils.
        ("fuel_flow", 8.5, Parameter::FuelFlow, 8.5 * 3.785_411_784),
        ("cht", 212.0, Parameter::CylinderHeadTemperature1, 373.15),
        ("oil_temp", 32.0, Parameter::OilTemperature, 273.15),
        ("oil_px", 60.0, Parameter::OilPressure, 60.0 * 68.947_572_9),
    ];
    let silent = decode(&mut FgFdm::new(), &packet.bytes);
    for (field, wire, parameter, expected) in engines {
        assert_eq!(value(&silent, parameter), None, "{field}");
        packet.f32(field, wire);
        let signals = decode(&mut FgFdm::new(), &packet.bytes);
        assert_near(&signals, parameter, expected);
        packet.f32(field, f32::NAN);
        let signals = decode(&mut FgFdm::new(), &packet.bytes);
        assert_eq!(
            value(&signals, parameter),
            Some(Err(Invalid::OutOfRange)),
            "{field}"
        );
        packet.f32(field, wire);
    }
    assert_eq!(value(&silent, Parameter::FuelQuantity1), None, "no tank");
    packet.f64("tank_capacity", 0.106);
    packet.f64("tank_level", 0.0535);
    packet.u32("num_engines", 2);
    let signals = decode(&mut FgFdm::new(), &packet.bytes);
    assert_near(&signals, Parameter::FuelQuantity1, 53.5);
    assert_near(&signals, Parameter::SecondEngineSpeed, 0.0);
    assert_eq!(value(&signals, Parameter::FuelQuantity2), None, "one tank");
}

#[test]
fn a_can_frame_is_ignored() {
    let mut decoder = FgFdm::new();
    let can = CanData {
        id: 0,
        extended: false,
        len: 0,
        data: [0; 8],
    };
    let frame = Frame {
        at: Monotonic::from_nanos(0),
        source: SourceId(0),
        wire: Wire::Can(can),
    };
    decoder.push(frame, &mut |_| panic!("nothing to say"));
    assert_eq!(
        (decoder.counters().ignored, decoder.counters().total()),
        (1, 1)
    );
}

#[test]
fn no_damage_gives_a_number_that_its_parameter_cannot_have() {
    // A 64-bit linear congruential generator (Knuth, MMIX): the same million packets in every run.
    let mut seed = 1_u64;
    let mut next = || {
        seed = seed
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        seed >> 33
    };
    let mut decoder = FgFdm::new();
    let templates = [Packet::flying(24).bytes, Packet::flying(25).bytes];
    let mut bytes = Vec::new();
    let packets = 1_000_000_u64;
    for i in 0..packets {
        let template = &templates[usize::from(next() % 4 == 0)];
        bytes.clear();
        bytes.extend_from_slice(template);
        // Damage from the fifth byte on, so that most packets reach the fields; sometimes anywhere.
        for _ in 0..next() % 6 {
            let from = if next() % 16 == 0 { 0 } else { 4 };
            let used = 160;
            let at = from + usize::try_from(next()).unwrap() % (used - from);
            bytes[at] = next().to_le_bytes()[0];
        }
        if i % 64 == 0 {
            let length = usize::try_from(next()).unwrap() % (bytes.len() + 1);
            bytes.truncate(length);
        }
        let frame = Frame {
            at: Monotonic::from_nanos(i),
            source: SourceId(0),
            wire: Wire::Datagram(&bytes),
        };
        decoder.push(frame, &mut |s: Signal| {
            if let Ok(x) = s.value {
                let spec = s.parameter.spec();
                assert!(
                    x.is_finite() && x >= spec.min && x <= spec.max,
                    "{s:?} of {bytes:?}"
                );
            }
        });
    }
    assert_eq!(decoder.counters().total(), packets, "each counted once");
}

#[test]
fn the_recorded_flight_agrees_with_the_simulator() {
    let Some(data) = support::data_dir() else {
        return;
    };
    let capture = std::fs::read(data.join("bus/jsbsim_c172x_netfdm.bin")).expect("capture");
    let truth =
        std::fs::read_to_string(data.join("bus/jsbsim_c172x_netfdm.bin.truth.csv")).expect("truth");
    let rows: Vec<Vec<f64>> = truth
        .lines()
        .skip(1)
        .map(|line| {
            line.split(',')
                .map(|x| x.parse().expect("number"))
                .collect()
        })
        .collect();
    let mut decoder = FgFdm::new();
    let mut worst = [0.0_f64; 4];
    let mut compared = 0;
    for (packet, record) in UdpCapture::new(&capture).enumerate() {
        let (_, payload) = record.expect("whole record");
        let signals = decode(&mut decoder, payload);
        // The first packet is sent before the first step, which makes the first row.
        let Some(row) = packet.checked_sub(1).and_then(|row| rows.get(row)) else {
            continue;
        };
        let get = |p| value(&signals, p).expect("told").expect("good");
        let &[_, lat, lon, h_sl, _, phi, theta, psi, vc_kt, hdot] = row.as_slice() else {
            panic!("ten columns");
        };
        let errors = [
            [
                get(Parameter::Roll) - phi,
                get(Parameter::Pitch) - theta,
                get(Parameter::HeadingTrue) - psi,
            ]
            .map(|x| x.to_degrees().abs())
            .into_iter()
            .fold(0.0, f64::max),
            ((get(Parameter::Latitude).to_degrees() - lat) * 111_320.0)
                .hypot((get(Parameter::Longitude).to_degrees() - lon) * 111_320.0 * 0.65)
                .hypot(get(Parameter::AltitudeMsl) - h_sl),
            (get(Parameter::CalibratedAirspeed) * 3600.0 / 1852.0 - vc_kt).abs(),
            (get(Parameter::VerticalSpeed) - hdot).abs(),
        ];
        for (worst, error) in worst.iter_mut().zip(errors) {
            *worst = worst.max(error);
        }
        compared += 1;
    }
    println!("worst of {compared}: deg, m, kt, m/s {worst:?}");
    assert_eq!(decoder.counters().good, 901);
    assert_eq!(decoder.counters().total(), 901);
    assert!(compared > 860, "{compared} packets have a row");
    assert!(worst[0] < 1e-3, "attitude, deg: {}", worst[0]);
    assert!(worst[1] < 0.02, "position, m: {}", worst[1]);
    assert!(worst[2] < 1e-3, "airspeed, kt: {}", worst[2]);
    assert!(worst[3] < 1e-3, "vertical speed, m/s: {}", worst[3]);
}
