//! A recorded flight through decoder and state: nothing is found wrong with it; and everything, when it is made to stop.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

mod support;

use glasswing::proto::Protocol;
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
    let still = frozen::SOURCE_STILL.as_secs_f64();
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
