//! CAN through the kernel: a virtual interface of each test's own, where this machine and user may make one (in the virtual
//! machine of `./dev guest` they may), and two controllers on one bus where there are some.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

mod bus_support;
mod support;

use bus_support::{ID, Vcan, ip, wait_for_frames, wait_until};
use glasswing::app::intake::Intake;
use glasswing::app::sources::{self, listen_can};
use glasswing::bus::{self, BusError, Endpoint, Event, Link, SourceConfig, SourceHandle, can};
use glasswing::proto::Protocol;
use glasswing::proto::canaerospace::encode;
use glasswing::signal::{CanData, Parameter};
use glasswing::state::Fusion;
use glasswing::time::Monotonic;
use socketcan::{CanErrorFrame, CanFrame, CanSocket, Socket as _};

#[test]
fn frames_through_vcan_become_state() {
    let Some(vcan) = Vcan::make("vcangw1") else {
        return;
    };
    let source = listen_can("adahrs", ID, Protocol::CanAerospace, vcan.0).expect("opens");
    let sender = can::Sender::open(vcan.0).expect("opens");
    let mut foreign = encode(Parameter::Roll, 0.5, 1, 0).expect("encodes");
    (foreign.id, foreign.extended) = (0x09F8_0102, true);
    sender.send(&foreign).expect("sent");
    for (code, parameter, value) in [
        (0, Parameter::Roll, 0.25),
        (0, Parameter::IndicatedAirspeed, 49.5),
        (1, Parameter::Roll, 0.26),
    ] {
        let mut frame = encode(parameter, value, 1, code).expect("encodes");
        sender.send(&frame).expect("sent");
        frame.extended = true;
        sender.send(&frame).expect("sent");
    }
    wait_for_frames(&source.thread, 6);
    let mut intake = Intake::new([source.signals], Fusion::new(&[ID]));
    let now = Monotonic::read();
    let state = intake.step(now);
    assert_eq!(state.read(Parameter::IndicatedAirspeed, now), Ok(49.5));
    let roll = state.read(Parameter::Roll, now).expect("fresh");
    assert!((roll - 0.26).abs() < 1e-6, "{roll}");
    let figures = source.thread.figures().snapshot();
    assert_eq!(
        (figures.good, figures.ignored),
        (6, 0),
        "the kernel keeps foreign frames away"
    );
}

/// A source that is waited for.
fn waited_for(endpoint: Endpoint) -> (SourceHandle, Option<BusError>) {
    let config = SourceConfig {
        name: "adahrs".into(),
        id: ID,
        endpoint,
    };
    let decode = sources::decode(Protocol::CanAerospace.decoder(), None);
    bus::spawn_patiently(config, decode).expect("waited for")
}

#[test]
fn an_interface_that_comes_later_is_heard_when_it_is_there() {
    let (source, refused) = waited_for(Endpoint::Can {
        interface: "vcangw7".into(),
        ids: Protocol::CanAerospace.can_ids(),
    });
    let refused = refused.expect("not there yet").to_string();
    assert!(refused.contains("can vcangw7: "), "{refused}");
    let figures = || source.thread.figures().snapshot();
    assert_eq!(figures().link, Link::Closed);
    let Some(vcan) = Vcan::make("vcangw7") else {
        return;
    };
    wait_until("it is opened", || figures().link == Link::Open);
    let sender = can::Sender::open(vcan.0).expect("opens");
    let frame = encode(Parameter::Roll, 0.25, 1, 0).expect("encodes");
    sender.send(&frame).expect("sent");
    wait_for_frames(&source.thread, 1);
    assert_eq!(
        (figures().good, figures().reopened),
        (1, 0),
        "opened, not again"
    );
}

#[test]
fn a_whole_bus_is_heard_where_that_is_asked_for() {
    let Some(vcan) = Vcan::make("vcangw8") else {
        return;
    };
    let (source, refused) = waited_for(Endpoint::WholeCan {
        interface: vcan.0.into(),
    });
    assert!(refused.is_none(), "it is there");
    let sender = can::Sender::open(vcan.0).expect("opens");
    let mut frame = encode(Parameter::Roll, 0.25, 1, 0).expect("encodes");
    for (id, extended) in [(frame.id, false), (0x7FF, false), (0x09F8_0102, true)] {
        (frame.id, frame.extended) = (id, extended);
        sender.send(&frame).expect("sent");
    }
    wait_for_frames(&source.thread, 3);
    let figures = source.thread.figures().snapshot();
    assert_eq!(
        (figures.good, figures.ignored),
        (1, 2),
        "foreign frames come, too"
    );
}

#[test]
fn an_interface_that_goes_down_or_away_is_used_again_when_it_is_back() {
    let Some(vcan) = Vcan::make("vcangw2") else {
        return;
    };
    let source = listen_can("adahrs", ID, Protocol::CanAerospace, vcan.0).expect("opens");
    let figures = || source.thread.figures().snapshot();
    let frame = encode(Parameter::Roll, 0.25, 1, 0).expect("encodes");
    let send = || {
        let sender = can::Sender::open(vcan.0).expect("opens");
        sender.send(&frame).expect("sent");
    };
    send();
    wait_for_frames(&source.thread, 1);

    assert!(ip(&["link", "set", vcan.0, "down"]), "down");
    wait_until("the fault is noticed", || figures().faults > 0);
    assert!(ip(&["link", "set", vcan.0, "up"]), "up");
    send();
    wait_for_frames(&source.thread, 2);

    let reopened = figures().reopened;
    assert!(ip(&["link", "delete", vcan.0]), "away");
    wait_until("the fault is noticed", || figures().faults > 1);
    assert!(ip(&["link", "add", vcan.0, "type", "vcan"]), "back");
    assert!(ip(&["link", "set", vcan.0, "up"]), "up");
    wait_until("it is opened again", || figures().reopened > reopened);
    // Opened before it was up, the new socket has one more fault to tell; then it listens.
    send();
    wait_for_frames(&source.thread, 3);
    assert_eq!(figures().good, 3);
}

/// An error frame as a driver makes it: classes, and what the controller says of itself.
fn error_frame(classes: u32, controller: u8) -> CanFrame {
    let frame = CanErrorFrame::new_error(classes, &[0, controller]).expect("eight bytes");
    CanFrame::Error(frame)
}

#[test]
fn error_frames_are_counted_and_tell_how_the_controller_fares() {
    let Some(vcan) = Vcan::make("vcangw3") else {
        return;
    };
    let source = listen_can("adahrs", ID, Protocol::CanAerospace, vcan.0).expect("opens");
    let figures = || source.thread.figures().snapshot();
    assert_eq!(figures().link, Link::Open, "as it begins");
    let driver = CanSocket::open(vcan.0).expect("opens");
    for (n, (classes, controller, link)) in [
        (0x204, 0x08, Link::ErrorWarning),
        (0x204, 0x20, Link::ErrorPassive),
        (0x088, 0x00, Link::ErrorPassive),
        (0x040, 0x00, Link::BusOff),
        (0x100, 0x00, Link::Open),
        (0x040, 0x00, Link::BusOff),
    ]
    .into_iter()
    .enumerate()
    {
        let frame = error_frame(classes, controller);
        driver.write_frame(&frame).expect("sent");
        wait_until("the error frame is counted", || figures().faults > n as u64);
        assert_eq!(figures().link, link, "{classes:#x} {controller:#x}");
    }
    let seen = figures();
    let counted = |event| seen.events(event);
    assert_eq!(counted(Event::ErrorWarning), 1);
    assert_eq!(counted(Event::ErrorPassive), 1);
    assert_eq!(counted(Event::BusError), 1);
    assert_eq!(counted(Event::BusOff), 2);
    assert_eq!(counted(Event::Restarted), 1);
    assert_eq!(seen.frames(), 0, "an error frame is no frame of data");

    let sender = can::Sender::open(vcan.0).expect("opens");
    let frame = encode(Parameter::Roll, 0.25, 1, 0).expect("encodes");
    sender.send(&frame).expect("sent");
    wait_for_frames(&source.thread, 1);
    assert_eq!(figures().link, Link::Open, "what is heard is on the bus");
}

#[test]
fn frames_that_are_not_ours_are_kept_away_and_counted() {
    let Some(vcan) = Vcan::make("vcangw4") else {
        return;
    };
    let sender = can::Sender::open(vcan.0).expect("opens");
    let mut foreign = encode(Parameter::Roll, 0.5, 1, 0).expect("encodes");
    foreign.id = 0x7DF;
    sender.send(&foreign).expect("sent before anybody listens");
    let source = listen_can("adahrs", ID, Protocol::CanAerospace, vcan.0).expect("opens");
    for _ in 0..100 {
        sender.send(&foreign).expect("sent");
    }
    let own = encode(Parameter::Roll, 0.25, 1, 0).expect("encodes");
    sender.send(&own).expect("sent");
    wait_for_frames(&source.thread, 1);
    let figures = source.thread.figures().snapshot();
    assert_eq!((figures.good, figures.ignored), (1, 0));
    assert_eq!(source.thread.kept_away(), Some(100));
}

#[test]
fn a_protocol_of_11_bit_identifiers_is_spared_the_others() {
    let Some(vcan) = Vcan::make("vcangw6") else {
        return;
    };
    let source = listen_can("sensor", ID, Protocol::CanFix, vcan.0).expect("opens");
    let sender = can::Sender::open(vcan.0).expect("opens");
    // CAN-FIX: pitch 5.2 degrees, node 5.
    let mut frame = CanData {
        id: 0x180,
        extended: true,
        len: 5,
        data: [5, 0, 0, 8, 2, 0, 0, 0],
    };
    sender.send(&frame).expect("sent");
    frame.extended = false;
    sender.send(&frame).expect("sent");
    wait_for_frames(&source.thread, 1);
    let figures = source.thread.figures().snapshot();
    assert_eq!((figures.good, figures.ignored), (1, 0));
    assert_eq!(source.thread.kept_away(), Some(1));
}

#[test]
fn an_interface_that_is_off_is_heard_once_it_is_on() {
    let Some(vcan) = Vcan::make("vcangw5") else {
        return;
    };
    assert!(ip(&["link", "set", vcan.0, "down"]), "down");
    assert_eq!(can::is_up(vcan.0), Some(false));
    let source = listen_can("adahrs", ID, Protocol::CanAerospace, vcan.0).expect("opens");
    let link = || source.thread.figures().link();
    wait_until("it is seen to be off", || link() == Link::Down);
    assert!(ip(&["link", "set", vcan.0, "up"]), "up");
    assert_eq!(can::is_up(vcan.0), Some(true));
    wait_until("it is seen to be on, though nobody speaks", || {
        link() == Link::Open
    });
    let sender = can::Sender::open(vcan.0).expect("opens");
    let frame = encode(Parameter::Roll, 0.25, 1, 0).expect("encodes");
    sender.send(&frame).expect("sent");
    wait_for_frames(&source.thread, 1);
}

#[test]
fn a_network_interface_of_another_kind_is_named() {
    let error = listen_can("adahrs", ID, Protocol::CanAerospace, "lo").expect_err("no CAN");
    match &error {
        BusError::NotCan { .. } => {
            assert!(
                error
                    .to_string()
                    .starts_with("can lo: is no CAN interface ("),
                "{error}"
            );
        }
        BusError::NoCan { .. } => support::skip("this kernel has no CAN"),
        other => assert!(support::is_emulated(), "{other:?}"),
    }
}

/// Two controllers, can0 and can1, on one bus, both switched on: as `./dev guest` emulates them.
#[test]
fn frames_cross_from_one_controller_to_another() {
    if can::is_up("can0") != Some(true) || can::is_up("can1") != Some(true) {
        support::skip("no two CAN controllers here");
        return;
    }
    let source = listen_can("adahrs", ID, Protocol::CanAerospace, "can0").expect("opens");
    let sender = can::Sender::open("can1").expect("opens");
    for code in 0..100 {
        let frame = encode(Parameter::Roll, 0.25, 1, code).expect("encodes");
        sender.send(&frame).expect("room for one");
        // One at a time: an emulated bus has no bit rate, and its controller room for few.
        wait_for_frames(&source.thread, u64::from(code) + 1);
    }
    let mut intake = Intake::new([source.signals], Fusion::new(&[ID]));
    let now = Monotonic::read();
    let roll = intake.step(now).read(Parameter::Roll, now).expect("fresh");
    assert!((roll - 0.25).abs() < 1e-6, "{roll}");
    let figures = source.thread.figures().snapshot();
    assert_eq!((figures.good, figures.link), (100, Link::Open));
}
