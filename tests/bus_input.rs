//! Knobs and keys through the kernel: virtual devices of uinput, where this machine and user may make them.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

mod support;

use evdev::uinput::VirtualDevice;
use evdev::{AttributeSet, EventType, InputEvent, KeyCode, RelativeAxisCode};
use glasswing::bus::input::{self, Action};
use glasswing::time::Monotonic;
use std::time::Duration;

/// A knob with a push button; `None`, said aloud, where none can be made.
fn knob() -> Option<VirtualDevice> {
    let made = VirtualDevice::builder().and_then(|builder| {
        builder
            .name("glasswing test knob")
            .with_relative_axes(&AttributeSet::from_iter([RelativeAxisCode::REL_DIAL]))?
            .with_keys(&AttributeSet::from_iter([KeyCode::BTN_0]))?
            .build()
    });
    match made {
        Ok(knob) => Some(knob),
        Err(e) => {
            support::skip(&format!("no virtual input device here: {e}"));
            None
        }
    }
}

fn turn(knob: &mut VirtualDevice, detents: i32) {
    let code = RelativeAxisCode::REL_DIAL.0;
    knob.emit(&[InputEvent::new(EventType::RELATIVE.0, code, detents)])
        .expect("turned");
}

fn push(knob: &mut VirtualDevice) {
    for value in [1, 0] {
        knob.emit(&[InputEvent::new(EventType::KEY.0, KeyCode::BTN_0.0, value)])
            .expect("pushed");
    }
}

/// Does `act` every now and then until `wanted` comes out: a device is noticed some time after it appears.
fn until(actions: &mut rtrb::Consumer<input::InputEvent>, wanted: Action, act: &mut dyn FnMut()) {
    let start = Monotonic::read();
    loop {
        act();
        std::thread::park_timeout(Duration::from_millis(50));
        while let Ok(event) = actions.pop() {
            if event.action == wanted {
                return;
            }
        }
        let waited = Monotonic::read().since(start).unwrap_or_default();
        assert!(waited < Duration::from_secs(20), "never: {wanted:?}");
    }
}

#[test]
fn knobs_are_heard_whenever_they_are_plugged_in() {
    let Some(mut first) = knob() else {
        return;
    };
    let (mut actions, thread) = input::spawn().expect("starts");
    until(&mut actions, Action::BaroSteps(2), &mut || {
        turn(&mut first, 2);
    });
    until(&mut actions, Action::BaroStandard, &mut || push(&mut first));
    let mut second = knob().expect("a second one");
    until(&mut actions, Action::BaroSteps(-3), &mut || {
        turn(&mut second, -3);
    });
    drop(first);
    until(&mut actions, Action::BaroSteps(5), &mut || {
        turn(&mut second, 5);
    });
    assert_eq!(thread.dropped(), 0);
}

#[test]
fn a_machine_without_devices_is_no_error() {
    // Whatever this machine has: starting and stopping works, or says which device may not be opened.
    match input::spawn() {
        Ok((_, thread)) => drop(thread),
        Err(e) => assert!(e.to_string().contains("/dev/input"), "{e}"),
    }
}
