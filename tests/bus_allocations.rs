//! Nothing on the way from a frame to the state allocates once it runs: neither bus threads nor fusion.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

mod bus_support;
mod support;

use bus_support::{Line, has_no_serial_ports};
use glasswing::app::intake::Intake;
use glasswing::bus::{self, Decode, Endpoint, SourceConfig, Tally, loopback};
use glasswing::heap::allocations_of_this_thread;
use glasswing::proto::Protocol;
use glasswing::proto::canaerospace::{IDS, encode, encode_double};
use glasswing::signal::{CanData, Frame, Parameter, SourceId, Wire};
use glasswing::state::Fusion;
use glasswing::time::Monotonic;
use std::net::{Ipv4Addr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// A decoder that also notes how much its thread has allocated at its 10th and at its last frame.
fn watched(protocol: Protocol) -> (Decode, Arc<[AtomicU64; 2]>) {
    let notes = Arc::new([AtomicU64::new(0), AtomicU64::new(0)]);
    let noted = Arc::clone(&notes);
    let mut decoder = protocol.decoder();
    let decode: Decode = Box::new(move |frame, sink| {
        decoder.push(frame, sink);
        let c = decoder.counters();
        let note = usize::from(c.total() > 10);
        noted[note].store(allocations_of_this_thread(), Ordering::Release);
        Tally {
            good: c.good,
            bad: std::array::from_fn(|kind| if kind == 0 { c.bad_total() } else { 0 }),
            ignored: c.ignored,
        }
    });
    (decode, notes)
}

fn run(protocol: Protocol, endpoint: Endpoint, frames: u64, send: &mut dyn FnMut(u64)) {
    let (decode, notes) = watched(protocol);
    let id = SourceId(0);
    let config = SourceConfig {
        name: "watched".into(),
        id,
        endpoint,
    };
    let source = bus::spawn(config, decode).expect("opens");
    let figures = Arc::clone(source.thread.figures());
    let mut intake = Intake::new([source.signals], Fusion::new(&[id]));
    let mut before = 0;
    for k in 1..=frames {
        // What runs at all has run by now; from here on it is the steady state.
        if k == 10 {
            before = allocations_of_this_thread();
        }
        send(k);
        while figures.snapshot().frames() < k {
            std::thread::yield_now();
        }
        let _ = intake.step(Monotonic::read());
    }
    assert_eq!(
        allocations_of_this_thread(),
        before,
        "sending and fusion allocate"
    );
    assert_eq!(figures.snapshot().good, frames, "all frames are good");
    let [first, last] = [0, 1].map(|i| notes[i].load(Ordering::Acquire));
    assert_eq!(first, last, "the bus thread allocates");
}

#[test]
fn udp_to_state_allocates_nothing() {
    let holder = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket");
    let bind = holder.local_addr().expect("an address");
    drop(holder);
    let endpoint = Endpoint::Udp {
        bind,
        allow: vec![Ipv4Addr::LOCALHOST.into()],
    };
    let sender = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket");
    let mut packet = [0; 408];
    packet[3] = 24;
    run(Protocol::FgFdm, endpoint, 500, &mut |_| {
        sender.send_to(&packet, bind).expect("sent");
    });
}

#[test]
fn serial_to_state_allocates_nothing() {
    if has_no_serial_ports() {
        return;
    }
    let line = Line::new();
    let endpoint = Endpoint::Serial {
        path: line.path.clone(),
        baud: 115_200,
    };
    // ForeFlight attitude: roll 10, pitch 5.
    let message = [
        0x7E, 0x65, 0x01, 0x00, 0x64, 0x00, 0x32, 0x84, 0xD2, 0x00, 0x5F, 0x00, 0x65, 0xB7, 0xEF,
        0x7E,
    ];
    run(Protocol::Gdl90, endpoint, 500, &mut |_| line.send(&message));
}

#[test]
fn can_to_state_allocates_nothing() {
    let (mut bus, receiver) = loopback::bus(64);
    let endpoint = Endpoint::Loopback(receiver);
    run(Protocol::CanAerospace, endpoint, 500, &mut |k| {
        #[expect(clippy::cast_possible_truncation, reason = "a message code wraps")]
        let frame = encode(Parameter::Pitch, 0.1, 1, k as u8).expect("encodes");
        bus.send(Monotonic::read(), frame).expect("room");
    });
}

#[test]
fn no_frame_of_any_kind_makes_a_decoder_allocate() {
    let mut decoder = Protocol::CanAerospace.decoder();
    let halves = encode_double(Parameter::Latitude, 0.5, 1, 0).expect("encodes");
    let before = allocations_of_this_thread();
    for i in 0..100_000_u32 {
        let bytes = (i.wrapping_mul(2_654_435_761)).to_be_bytes();
        let id = IDS[i as usize % IDS.len()];
        let can = CanData {
            id: u32::from(id),
            extended: false,
            len: bytes[3] % 9,
            data: [1, bytes[2] % 33, 0, bytes[1], bytes[0], bytes[1], 0, 0],
        };
        for can in [can, halves[0], halves[1]] {
            let frame = Frame {
                at: Monotonic::from_nanos(u64::from(i)),
                source: SourceId(0),
                wire: Wire::Can(can),
            };
            decoder.push(frame, &mut |_| {});
        }
    }
    assert_eq!(allocations_of_this_thread(), before);
}
