//! A recorded flight through decoder and state: nothing is found wrong with it; and everything, when it is made to stop.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

mod support;

use glasswing::proto::{Carriage, Protocol};
use glasswing::sampled::Invalid;
use glasswing::signal::{Frame, Parameter, Signal, SourceId, Wire};
use glasswing::state::{FlightState, Fusion, frozen};
use glasswing::time::Monotonic;
use std::time::Duration;

/// Everything that the simulator says and a pilot is shown.
const SHOWN: [Parameter; 10] = [
    Parameter::Pitch,
    Parameter::Roll,
    Parameter::HeadingTrue,
    Parameter::CalibratedAirspeed,
    Parameter::AltitudeMsl,
    Parameter::VerticalSpeed,
    Parameter::Latitude,
    Parameter::Longitude,
    Parameter::GroundSpeed,
    Parameter::Track,
];

/// Seconds and packets of a capture: `f64` seconds, `u32` length, bytes.
fn packets(bytes: &[u8]) -> Vec<(f64, &[u8])> {
    let mut rest = bytes;
    let mut packets = Vec::new();
    while let Some((head, tail)) = rest.split_at_checked(12) {
        let seconds = f64::from_le_bytes(head[..8].try_into().expect("8 bytes"));
        let len = u32::from_le_bytes(head[8..].try_into().expect("4 bytes")) as usize;
        packets.push((seconds, &tail[..len]));
        rest = &tail[len..];
    }
    packets
}

/// Takes in one packet and gives the state at its receipt.
fn take(fusion: &mut Fusion, packet: &[u8], at: Monotonic) -> FlightState {
    let frame = Frame {
        at,
        source: SourceId(0),
        wire: Wire::Datagram(packet),
    };
    let mut decoder = Protocol::FgFdm.decoder();
    decoder.push(frame, &mut |signal: Signal| fusion.apply(&signal));
    fusion.step(at)
}

fn at(seconds: f64) -> Monotonic {
    Monotonic::from_nanos(1_000_000_000).plus(Duration::from_secs_f64(seconds))
}

#[test]
fn a_recorded_flight_is_believed_and_a_stopped_one_is_not() {
    let Some(data) = support::data_dir() else {
        support::skip("no test data");
        return;
    };
    let bytes = std::fs::read(data.join("bus/jsbsim_c172x_netfdm.bin")).expect("is there");
    let packets = packets(&bytes);
    let mut fusion = Fusion::new(&[SourceId(0)]);
    for (seconds, packet) in &packets {
        let now = at(*seconds);
        let state = take(&mut fusion, packet, now);
        for p in SHOWN {
            let value = state.read(p, now);
            assert!(value.is_ok(), "{p:?} at {seconds} s: {value:?}");
        }
    }
    // The last packet again and again: flagged by the stated time, and not before the sensor could have done that.
    let (end, last) = packets.last().expect("not empty");
    let still = frozen::LIVELY_STILL.as_secs_f64();
    for k in 1..=240_u32 {
        let after = f64::from(k) / 60.0;
        let now = at(end + after);
        let state = take(&mut fusion, last, now);
        for p in SHOWN {
            let frozen = state.read(p, now) == Err(Invalid::Frozen);
            assert!(frozen || after < still + 0.02, "{p:?} after {after} s");
            assert!(!frozen || after > still - 0.02, "{p:?} after {after} s");
        }
    }
}

/// What was recorded of real instruments and receivers: file, protocol, seconds, whether in packets with their times.
const RECORDED: [(&str, Protocol, f64, bool); 11] = [
    (
        "dynon_skyview_data1.txt",
        Protocol::DynonSkyView,
        633.0,
        false,
    ),
    ("dynon_d100_data1.txt", Protocol::DynonD100, 100.5, false),
    ("g3x_1.dat", Protocol::GarminG3x, 278.0, false),
    ("garmin_g5_capture.txt", Protocol::GarminG3x, 45.0, false),
    ("mgl_data1.bin", Protocol::Mgl, 120.0, false),
    ("stratux_1.dat", Protocol::Gdl90, 72.0, false),
    ("stratux_57.dat", Protocol::Gdl90, 73.0, false),
    ("xcsoar_rl-traffic.nmea", Protocol::Nmea, 478.0, false),
    ("pyubx2_pygpsdata-MIXED.log", Protocol::Ubx, 60.0, false),
    ("fg2020.3.16_c172p_nmea.bin", Protocol::Nmea, 93.0, true),
    ("jsbsim_c172x_netfdm.bin", Protocol::FgFdm, 30.0, true),
];

#[test]
fn nothing_recorded_is_ever_taken_for_frozen() {
    let Some(data) = support::data_dir() else {
        support::skip("no test data");
        return;
    };
    for (file, protocol, seconds, has_times) in RECORDED {
        let bytes = std::fs::read(data.join("bus").join(file)).expect("is there");
        // A byte stream comes evenly, in pieces of a fiftieth of a second; a line that is damaged is a line that is lost.
        let pieces: Vec<(f64, &[u8])> = if has_times {
            packets(&bytes)
        } else {
            let count = (seconds * 50.0).round();
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a few hundred"
            )]
            let size =
                (f64::from(u32::try_from(bytes.len()).expect("small")) / count).ceil() as usize;
            let pieces = bytes.chunks(size).zip(0_u32..);
            pieces
                .map(|(piece, k)| (f64::from(k) / 50.0, piece))
                .collect()
        };
        let mut fusion = Fusion::new(&[SourceId(0)]);
        let mut decoder = protocol.decoder();
        let mut shown = 0_u64;
        for (seconds, piece) in pieces {
            let now = at(seconds);
            let wire = match protocol.carriage() {
                Carriage::Stream => Wire::Stream(piece),
                _ => Wire::Datagram(piece),
            };
            let frame = Frame {
                at: now,
                source: SourceId(0),
                wire,
            };
            decoder.push(frame, &mut fusion);
            let state = fusion.step(now);
            for p in Parameter::ALL {
                let value = state.read(*p, now);
                shown += u64::from(value.is_ok());
                assert!(
                    value != Err(Invalid::Frozen),
                    "{file}: {p:?} at {seconds} s: {value:?}"
                );
            }
        }
        assert!(shown > 1000, "{file}: {shown} values shown");
    }
}

/// Signals of a recording of a byte stream, on a clock that goes on with each attitude (or, without one, position) in it:
/// such recordings have no times, but known rates.
fn signals(protocol: Protocol, bytes: &[u8], beat: (Parameter, f64)) -> Vec<Signal> {
    let mut decoder = protocol.decoder();
    let mut signals = Vec::new();
    let mut seconds = 0.0;
    let mut last_clock = None;
    let frame = Frame {
        at: at(0.0),
        source: SourceId(0),
        wire: Wire::Stream(bytes),
    };
    decoder.push(frame, &mut |signal: Signal| {
        // A receiver's own clock, where there is one: lines are missing, and with them seconds.
        match (signal.value, last_clock) {
            (Ok(clock), Some(last)) if signal.parameter == Parameter::UtcTimeOfDay => {
                seconds += if clock > last { clock - last } else { 0.0 };
            }
            _ if signal.parameter == beat.0 && beat.0 != Parameter::UtcTimeOfDay => {
                seconds += beat.1;
            }
            _ => {}
        }
        if signal.parameter == Parameter::UtcTimeOfDay && beat.0 == signal.parameter {
            last_clock = signal.value.ok().or(last_clock);
        }
        signals.push(Signal {
            at: at(seconds),
            ..signal
        });
    });
    signals
}

#[test]
fn no_value_of_a_recorded_flight_is_doubted() {
    let Some(data) = support::data_dir() else {
        support::skip("no test data");
        return;
    };
    for (file, protocol, beat) in [
        ("g3x_1.dat", Protocol::GarminG3x, (Parameter::Pitch, 0.1)),
        (
            "dynon_skyview_data1.txt",
            Protocol::DynonSkyView,
            (Parameter::Pitch, 0.125),
        ),
        (
            "dynon_d100_data1.txt",
            Protocol::DynonD100,
            (Parameter::Pitch, 1.0 / 64.0),
        ),
        ("mgl_data1.bin", Protocol::Mgl, (Parameter::Pitch, 0.1)),
        ("stratux_1.dat", Protocol::Gdl90, (Parameter::Pitch, 0.05)),
        ("stratux_57.dat", Protocol::Gdl90, (Parameter::Pitch, 0.05)),
        (
            "xcsoar_rl-traffic.nmea",
            Protocol::Nmea,
            (Parameter::UtcTimeOfDay, 1.0),
        ),
    ] {
        let bytes = std::fs::read(data.join("bus").join(file)).expect("is there");
        let mut fusion = Fusion::new(&[SourceId(0)]);
        let mut doubted = std::collections::BTreeMap::new();
        let mut values = 0;
        for signal in signals(protocol, &bytes, beat) {
            fusion.apply(&signal);
            let said = fusion.step(signal.at).read(signal.parameter, signal.at);
            values += u32::from(signal.value.is_ok());
            // The Garmin recording is of a box on a bench, which stands still.
            let is_doubted = match said {
                Err(Invalid::Implausible) => true,
                Err(Invalid::Frozen) => protocol != Protocol::GarminG3x,
                _ => false,
            };
            if signal.value.is_ok() && is_doubted {
                *doubted.entry(signal.parameter).or_insert(0) += 1;
            }
        }
        let count: u32 = doubted.values().sum();
        assert!(
            values > 1000 && count <= 1,
            "{file}: {values} values, doubted {doubted:?}"
        );
    }
}
