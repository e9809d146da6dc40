//! From a real socket to the flight state, through the real threads: what goes in must come out, and what is refused must
//! be named.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

mod bus_support;
mod support;

use bus_support::{ID, ip, wait_for_frames, wait_until};
use glasswing::app::intake::Intake;
use glasswing::app::sources::{self, listen, listen_can, listen_udp};
use glasswing::bus::{self, BusError, Endpoint, Event, Link, SourceConfig, can, loopback};
use glasswing::limits::{DATAGRAM_BYTES_MAX, SIGNALS_QUEUED_MAX};
use glasswing::proto::Protocol;
use glasswing::proto::canaerospace::encode;
use glasswing::sampled::Invalid;
use glasswing::signal::Parameter;
use glasswing::state::Fusion;
use glasswing::time::Monotonic;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use std::time::Duration;

/// An FDM packet of version 24 with a pitch and nothing else.
fn packet(pitch_rad: f32) -> Vec<u8> {
    let mut bytes = vec![0; 408];
    bytes[..4].copy_from_slice(&24_u32.to_be_bytes());
    bytes[40..44].copy_from_slice(&pitch_rad.to_be_bytes());
    bytes
}

/// A port that nobody has just now.
fn free_address() -> SocketAddr {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket");
    socket.local_addr().expect("an address")
}

#[test]
fn a_datagram_becomes_a_state_and_silence_makes_it_stale() {
    let address = free_address();
    let source = listen_udp("sim", ID, Protocol::FgFdm, address, vec![]).expect("opens");
    let mut intake = Intake::new([source.signals], Fusion::new(&[ID]));
    let now = Monotonic::read();
    let before = intake.step(now).read(Parameter::Pitch, now);
    assert_eq!(before, Err(Invalid::NeverReceived));
    let sender = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket");
    sender.send_to(&packet(0.125), address).expect("sent");
    wait_for_frames(&source.thread, 1);
    let now = Monotonic::read();
    let state = intake.step(now);
    assert_eq!(state.read(Parameter::Pitch, now), Ok(0.125));
    assert_eq!(state.source(Parameter::Pitch), Some(ID));
    let silence = now.plus(Duration::from_millis(301));
    assert_eq!(
        intake.step(silence).read(Parameter::Pitch, silence),
        Err(Invalid::Stale),
        "no frames, no attitude"
    );
}

#[test]
fn bad_datagrams_are_counted_and_the_next_good_one_is_used() {
    let address = free_address();
    let mut source = listen_udp("sim", ID, Protocol::FgFdm, address, vec![]).expect("opens");
    let sender = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket");
    let mut too_long = packet(0.5);
    too_long.resize(4 * DATAGRAM_BYTES_MAX, 0);
    for bytes in [
        &[][..],
        &packet(0.5)[..407],
        &too_long,
        &packet(f32::NAN),
        &packet(0.25),
    ] {
        sender.send_to(bytes, address).expect("sent");
    }
    wait_for_frames(&source.thread, 5);
    let figures = source.thread.figures().snapshot();
    assert_eq!((figures.good, figures.bad, figures.ignored), (1, 4, 0));
    assert_eq!(figures.oversized, 1, "one was too long to be taken whole");
    let mut intake = Intake::new([source.signals], Fusion::new(&[ID]));
    let now = Monotonic::read();
    assert_eq!(intake.step(now).read(Parameter::Pitch, now), Ok(0.25));
    source.thread.stop();
    source.thread.stop();
    UdpSocket::bind(address).expect("a stopped source has let its port go");
}

#[test]
fn a_full_ring_drops_the_newest_and_counts_them() {
    let address = free_address();
    let source = listen_udp("sim", ID, Protocol::FgFdm, address, vec![]).expect("opens");
    let sender = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket");
    // 17 signals a packet here; 1000 packets are more than the ring holds.
    for sent in 1..=1000 {
        sender.send_to(&packet(0.125), address).expect("sent");
        wait_for_frames(&source.thread, sent);
    }
    let dropped = source.thread.figures().snapshot().dropped;
    let held = u64::try_from(source.signals.slots()).expect("small");
    assert_eq!(held, SIGNALS_QUEUED_MAX as u64, "the ring is full");
    assert!(
        dropped > 0 && (held + dropped).is_multiple_of(1000),
        "{held} {dropped}"
    );
}

#[test]
fn only_named_senders_are_heard() {
    let address = free_address();
    let named = [Ipv4Addr::LOCALHOST, Ipv4Addr::new(127, 0, 0, 3)];
    let stranger = Ipv4Addr::new(127, 0, 0, 2);
    let allow = named.map(IpAddr::from).to_vec();
    let source = listen_udp("sim", ID, Protocol::FgFdm, address, allow).expect("opens");
    let send = |from: Ipv4Addr, pitch_rad: f32| {
        let sender = UdpSocket::bind((from, 0)).expect("a loopback address");
        sender.send_to(&packet(pitch_rad), address).expect("sent");
    };
    let figures = || source.thread.figures().snapshot();
    send(stranger, 0.5);
    wait_until("the stranger is counted", || figures().foreign == 1);
    // The same attitude twice: nothing that flies goes from one to another in no time.
    send(named[0], 0.125);
    send(named[1], 0.125);
    wait_for_frames(&source.thread, 2);
    send(stranger, 0.5);
    wait_until("the stranger is counted", || figures().foreign == 2);
    assert_eq!((figures().good, figures().foreign), (2, 2));
    let mut intake = Intake::new([source.signals], Fusion::new(&[ID]));
    let now = Monotonic::read();
    assert_eq!(intake.step(now).read(Parameter::Pitch, now), Ok(0.125));
}

/// An address of documentation networks (RFC 5737) that the loopback interface has for a while.
struct Address(&'static str);

impl Address {
    fn set(&self, what: &str) -> bool {
        ip(&["address", what, self.0, "dev", "lo"])
    }
}

impl Drop for Address {
    fn drop(&mut self) {
        self.set("delete");
    }
}

#[test]
fn an_address_that_goes_away_is_noticed_and_used_again_when_it_is_back() {
    let address = Address("203.0.113.77/32");
    if support::is_emulated() || !address.set("add") {
        support::skip("no address of the test's own here (it takes root)");
        return;
    }
    let own = IpAddr::from([203, 0, 113, 77]);
    let port = UdpSocket::bind((own, 0)).expect("a socket");
    let bind = port.local_addr().expect("an address");
    drop(port);
    let source = listen_udp("sim", ID, Protocol::FgFdm, bind, vec![]).expect("opens");
    let figures = || source.thread.figures().snapshot();
    let send = || {
        let sender = UdpSocket::bind((own, 0)).expect("a socket");
        sender.send_to(&packet(0.25), bind).expect("sent");
    };
    send();
    wait_for_frames(&source.thread, 1);
    assert!(address.set("delete"), "away");
    wait_until("it is noticed", || figures().link == Link::Closed);
    assert!(figures().events(Event::Lost) >= 1, "and counted");
    assert!(address.set("add"), "back");
    wait_until("it is opened again", || figures().link == Link::Open);
    send();
    wait_for_frames(&source.thread, 2);
    assert_eq!((figures().good, figures().reopened), (2, 1));
}

#[test]
fn a_port_in_use_is_named() {
    let holder = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket");
    let address = holder.local_addr().expect("an address");
    let error = listen_udp("sim", ID, Protocol::FgFdm, address, vec![]).expect_err("in use");
    assert!(matches!(error, BusError::PortInUse { .. }), "{error:?}");
    let text = error.to_string();
    assert!(text.contains(&format!("udp {address}")), "{text}");
    assert!(!text.contains('\n'), "one line: {text}");
}

#[test]
fn a_port_that_is_held_at_first_is_heard_when_it_is_free() {
    let holder = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket");
    let bind = holder.local_addr().expect("an address");
    let config = SourceConfig {
        name: "sim".into(),
        id: ID,
        endpoint: Endpoint::Udp {
            bind,
            allow: vec![],
        },
    };
    let decode = sources::decode(Protocol::FgFdm.decoder(), None);
    let (source, refused) = bus::spawn_patiently(config, decode).expect("waited for");
    assert!(
        matches!(refused, Some(BusError::PortInUse { .. })),
        "{refused:?}"
    );
    let figures = || source.thread.figures().snapshot();
    assert_eq!(figures().link, Link::Closed, "and says so");
    drop(holder);
    wait_until("it is opened", || figures().link == Link::Open);
    let sender = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket");
    sender.send_to(&packet(0.25), bind).expect("sent");
    wait_for_frames(&source.thread, 1);
    assert_eq!(
        (figures().good, figures().reopened),
        (1, 0),
        "opened, not again"
    );
}

#[test]
fn an_address_of_another_machine_is_named() {
    let address = SocketAddr::from(([192, 0, 2, 1], 5500));
    let error = listen_udp("sim", ID, Protocol::FgFdm, address, vec![]).expect_err("not ours");
    assert!(
        matches!(error, BusError::AddressNotLocal { .. }),
        "{error:?}"
    );
}

#[test]
fn a_missing_can_interface_is_named_with_the_remedy() {
    for name in [
        "nosuchcan7",
        "vcan_absent",
        "a name that no interface can have",
        "",
    ] {
        let error = listen_can("adahrs", ID, Protocol::CanAerospace, name).expect_err("absent");
        // A kernel without CAN, or an emulator without it, refuses before it looks for the interface.
        let text = error.to_string();
        assert!(text.contains(&format!("can {name}")), "{text}");
        assert!(!text.contains('\n'), "one line: {text}");
        if let BusError::InterfaceMissing { .. } = error {
            assert!(text.contains("ip link"), "{text}");
        }
        assert!(!can::exists(name), "{name}");
    }
}

#[test]
fn frames_on_the_bus_within_keep_their_times_and_wake_the_listener() {
    let (mut bus, receiver) = loopback::bus(64);
    let endpoint = Endpoint::Loopback(receiver);
    let source = listen("demo", ID, Protocol::CanAerospace, endpoint).expect("opens");
    let mut intake = Intake::new([source.signals], Fusion::new(&[ID]));
    for k in 1..=1000_u64 {
        let at = Monotonic::from_nanos(k * 20_000_000);
        let roll = f64::from(u32::try_from(k).expect("small")) * 1e-3;
        #[expect(clippy::cast_possible_truncation, reason = "a message code wraps")]
        let frame = encode(Parameter::Roll, roll, 1, k as u8).expect("encodes");
        bus.send(at, frame).expect("room");
        wait_for_frames(&source.thread, k);
        let shown = intake.step(at).read(Parameter::Roll, at).expect("fresh");
        assert!((shown - roll).abs() < 1e-6, "{shown} {roll}");
    }
    let figures = source.thread.figures().snapshot();
    assert_eq!((figures.good, figures.frames()), (1000, 1000));
}

#[test]
fn a_full_bus_within_refuses_the_frame() {
    let (mut bus, _receiver) = loopback::bus(1);
    let frame = encode(Parameter::Roll, 0.1, 1, 0).expect("encodes");
    let at = Monotonic::from_nanos(0);
    assert_eq!(bus.send(at, frame), Ok(()));
    assert_eq!(bus.send(at, frame), Err(loopback::Full));
}
