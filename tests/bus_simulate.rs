//! Bench traffic over real buses into the real decoders: what is shown is what was flown, and faults are what they are called.
#![expect(
    clippy::expect_used,
    clippy::panic,
    reason = "a helper that fails is a test that fails"
)]

mod bus_support;
mod support;

use bus_support::{ID, Line, Vcan, has_no_serial_ports, wait_until};
use glasswing::app::sources::{listen_can, listen_udp};
use glasswing::bench::encode::encoder;
use glasswing::bench::profile::{DEMO, Profile};
use glasswing::bus::{Link, SourceHandle};
use glasswing::proto::Protocol;
use glasswing::sampled::Invalid;
use glasswing::signal::{Frame, Parameter, Signal, SourceId, Wire};
use glasswing::time::Monotonic;
use std::collections::HashMap;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::process::Output;
use std::time::Duration;

/// Seconds of the profile that are sent.
const SECONDS: u64 = 3;

type Heard = HashMap<Parameter, Result<f64, Invalid>>;

/// Sends the beginning of the demo's profile and waits until it is over.
fn simulate(protocol: Protocol, to: &str, more: &[&str]) -> Output {
    let seconds = SECONDS.to_string();
    let output = support::glasswing_command()
        .args(["simulate", "--profile", "demo", "--as", protocol.name()])
        .args(["--to", to, "--seconds", &seconds, "--json"])
        .args(more)
        .output()
        .expect("the program starts");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{protocol:?}: {said}");
    output
}

/// The number of a key in the figures.
fn figure(output: &Output, key: &str) -> u64 {
    let figures: serde_json::Value =
        serde_json::from_slice(&output.stdout).expect("one JSON document");
    figures[key].as_u64().expect("a whole number")
}

/// What a source has said of each parameter, the last time.
fn drain(source: &mut SourceHandle, heard: &mut Heard) {
    while let Ok(Signal {
        parameter, value, ..
    }) = source.signals.pop()
    {
        heard.insert(parameter, value);
    }
}

/// That everything which the protocol carries is as it was flown at the end of what was sent, as nearly as the slowest of its
/// messages can tell.
fn assert_as_flown(protocol: Protocol, heard: &Heard) {
    let profile = Profile::parse(DEMO).expect("a profile");
    let encoder = encoder(protocol);
    let mut compared = 0;
    for (parameter, value) in heard {
        let Some(how) = encoder.carries(*parameter) else {
            continue;
        };
        // A message may be up to a second old.
        let at = |ms: u64| {
            let t = Duration::from_millis(SECONDS * 1000 - 100 * ms);
            profile.truth_at(t).get(*parameter)
        };
        let told: Vec<f64> = (0..=11).filter_map(|n| at(n).ok()).collect();
        let Ok(value) = value else {
            assert!(told.is_empty(), "{parameter:?}: {value:?}, not {told:?}");
            continue;
        };
        let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
        for x in &told {
            (least, most) = (least.min(*x), most.max(*x));
        }
        let slack = 1.01 * how.resolution + (most - least) + 1e-6;
        assert!(
            (least - slack..=most + slack).contains(value),
            "{} {parameter:?}: {value}, flown {least} to {most}, step {}",
            protocol.name(),
            how.resolution
        );
        compared += 1;
    }
    assert!(compared >= 7, "{} says {compared} things", protocol.name());
}

/// A source on a free port; another program may take a port between its being found free and its being used.
fn listening(protocol: Protocol) -> (SocketAddr, SourceHandle) {
    for _ in 0..20 {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket");
        let address = socket.local_addr().expect("an address");
        drop(socket);
        if let Ok(source) = listen_udp("bench", ID, protocol, address, vec![]) {
            return (address, source);
        }
    }
    panic!("no port stays free");
}

#[test]
fn datagrams_show_what_is_flown() {
    for protocol in [
        Protocol::FgFdm,
        Protocol::FgGeneric,
        Protocol::Gdl90,
        Protocol::Nmea,
    ] {
        let (address, mut source) = listening(protocol);
        let output = simulate(protocol, &format!("udp:{address}"), &["--rate", "3"]);
        let sent = figure(&output, "frames");
        assert_eq!(figure(&output, "dropped"), 0, "somebody listens");
        let frames = || source.thread.figures().snapshot();
        wait_until("all is decoded", || frames().frames() >= sent.min(1));
        let mut heard = Heard::new();
        // Until nothing more comes.
        let mut before = 0;
        wait_until("all is decoded", || {
            let now = frames().frames();
            std::thread::park_timeout(Duration::from_millis(100));
            std::mem::replace(&mut before, now) == now
        });
        assert_eq!(frames().bad, 0, "{protocol:?}");
        drain(&mut source, &mut heard);
        assert_as_flown(protocol, &heard);
    }
}

#[test]
fn a_serial_line_shows_what_is_flown() {
    if has_no_serial_ports() {
        return;
    }
    for protocol in [
        Protocol::DynonSkyView,
        Protocol::DynonD100,
        Protocol::GarminG3x,
        Protocol::Mgl,
        Protocol::Ubx,
    ] {
        let line = Line::new();
        let to = format!("serial:{}", line.path);
        let far = std::thread::Builder::new()
            .spawn(move || line.receive_all())
            .expect("a thread");
        let output = simulate(protocol, &to, &["--rate", "4"]);
        let bytes = far.join().expect("read");
        let sent = figure(&output, "bytes");
        assert_eq!(bytes.len() as u64, sent, "{protocol:?}: all bytes arrive");
        let mut heard = Heard::new();
        let mut decoder = protocol.decoder();
        let frame = Frame {
            at: Monotonic::from_nanos(1),
            source: SourceId(0),
            wire: Wire::Stream(&bytes),
        };
        decoder.push(frame, &mut |s: Signal| {
            heard.insert(s.parameter, s.value);
        });
        decoder.finish();
        assert_eq!(decoder.counters().bad_total(), 0, "{protocol:?}");
        assert_as_flown(protocol, &heard);
    }
}

#[test]
fn a_can_bus_shows_what_is_flown() {
    for (protocol, name) in [
        (Protocol::CanFix, "vcangws1"),
        (Protocol::CanAerospace, "vcangws2"),
    ] {
        let Some(vcan) = Vcan::make(name) else {
            return;
        };
        let mut source = listen_can("bench", ID, protocol, vcan.0).expect("opens");
        let output = simulate(protocol, &format!("can:{name}"), &["--rate", "3"]);
        let sent = figure(&output, "frames");
        let figures = || source.thread.figures().snapshot();
        wait_until("all is decoded", || figures().frames() >= sent);
        assert_eq!(figures().bad, 0, "{protocol:?}");
        let mut heard = Heard::new();
        drain(&mut source, &mut heard);
        assert_as_flown(protocol, &heard);
    }
}

#[test]
fn a_controller_that_leaves_a_virtual_bus_says_so() {
    let Some(vcan) = Vcan::make("vcangws3") else {
        return;
    };
    let source = listen_can("bench", ID, Protocol::CanFix, vcan.0).expect("opens");
    let faults = ["--rate", "3", "--fault", "bus-off@1"];
    simulate(Protocol::CanFix, "can:vcangws3", &faults);
    let link = || source.thread.figures().link();
    wait_until("the controller is off", || link() == Link::BusOff);
}

#[test]
fn a_saturated_bus_leaves_the_decoder_its_frames() {
    let Some(vcan) = Vcan::make("vcangws4") else {
        return;
    };
    let source = listen_can("bench", ID, Protocol::CanFix, vcan.0).expect("opens");
    let output = simulate(Protocol::CanFix, "can:vcangws4", &["--fault", "babble@0"]);
    let sent = figure(&output, "frames") - figure(&output, "dropped");
    assert!(sent > SECONDS * 9000, "1 Mbit/s, full: {sent}");
    let figures = || source.thread.figures().snapshot();
    wait_until("the last is heard", || figures().frames() >= sent);
    assert_eq!(figures().bad, 0, "foreign frames are no bad ones");
    assert!(figures().good > 1000, "its own come through");
}
