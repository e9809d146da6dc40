//! Knobs and keys of `/dev/input` as actions of the pilot.
//!
//! One thread listens to every device that has a knob or key of the table below; devices that come and go are noticed
//! within a quarter of a second. Nobody waits for it: actions go through a ring, and when that is full the newest are
//! dropped and counted.
//!
//! | device | action |
//! |---|---|
//! | knob or wheel (`REL_DIAL`, `REL_WHEEL`), a detent right or up | setting up |
//! | the same, left or down | setting down |
//! | keys Up, +, = | setting up, repeating while held |
//! | keys Down, - | setting down, repeating while held |
//! | keys S, Enter; a knob's push button (`BTN_0`) | standard setting |
//! | key T | terrain awareness colours on, off |
//! | key G | grid of lines on, off |
//! | key N | night, day |

use super::BusError;
use crate::time::Monotonic;
use evdev::{Device, EventType, KeyCode, RelativeAxisCode};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime};

/// Where the devices are.
const FOLDER: &str = "/dev/input";

/// Devices listened to at once; a cockpit has a few.
const DEVICES_MAX: usize = 16;

/// Actions on their way: half a minute of turning a knob at 10 detents a second.
const ACTIONS_QUEUED_MAX: usize = 256;

/// How often the folder is looked at, and the longest that stopping takes.
const LOOK_EVERY: Duration = Duration::from_millis(250);

/// The most steps taken from one event of a knob: more is a fault of the device, not a hand.
const STEPS_MAX: i32 = 20;

/// What the pilot does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Action {
    /// Turns the altimeter setting by this many steps, up positive.
    BaroSteps(i8),
    /// Sets the standard setting, 1013.25 hPa.
    BaroStandard,
    /// Turns the terrain awareness colours on or off.
    ToggleAwareness,
    /// Turns the grid of lines on the ground on or off.
    ToggleGrid,
    /// Dims terrain and sky for the night, or ends that.
    ToggleNight,
}

/// An action and when it was noticed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InputEvent {
    /// When it was read from the device.
    pub at: Monotonic,
    /// What it was.
    pub action: Action,
}

/// The action that an evdev event means, if any: type, code and value as in `linux/input-event-codes.h`.
#[must_use]
pub fn action(event_type: u16, code: u16, value: i32) -> Option<Action> {
    if event_type == EventType::RELATIVE.0 {
        let is_knob = [RelativeAxisCode::REL_DIAL, RelativeAxisCode::REL_WHEEL]
            .iter()
            .any(|axis| axis.0 == code);
        let steps = i8::try_from(value.clamp(-STEPS_MAX, STEPS_MAX)).ok()?;
        return (is_knob && steps != 0).then_some(Action::BaroSteps(steps));
    }
    if event_type != EventType::KEY.0 {
        return None;
    }
    // Value 0 is a release, 1 a press, 2 a repetition while held.
    let key = KeyCode(code);
    match value {
        1 | 2 if is_up(key) => Some(Action::BaroSteps(1)),
        1 | 2 if is_down(key) => Some(Action::BaroSteps(-1)),
        1 if is_standard(key) => Some(Action::BaroStandard),
        1 => toggle(key),
        _ => None,
    }
}

const fn is_up(key: KeyCode) -> bool {
    matches!(
        key,
        KeyCode::KEY_UP | KeyCode::KEY_EQUAL | KeyCode::KEY_KPPLUS
    )
}

const fn is_down(key: KeyCode) -> bool {
    matches!(
        key,
        KeyCode::KEY_DOWN | KeyCode::KEY_MINUS | KeyCode::KEY_KPMINUS
    )
}

const fn is_standard(key: KeyCode) -> bool {
    matches!(key, KeyCode::KEY_S | KeyCode::KEY_ENTER | KeyCode::BTN_0)
}

const fn toggle(key: KeyCode) -> Option<Action> {
    match key {
        KeyCode::KEY_T => Some(Action::ToggleAwareness),
        KeyCode::KEY_G => Some(Action::ToggleGrid),
        KeyCode::KEY_N => Some(Action::ToggleNight),
        _ => None,
    }
}

/// Whether a device has anything of the table.
fn is_of_use(device: &Device) -> bool {
    let axes = device.supported_relative_axes().is_some_and(|axes| {
        axes.contains(RelativeAxisCode::REL_DIAL) || axes.contains(RelativeAxisCode::REL_WHEEL)
    });
    let keys = device.supported_keys().is_some_and(|keys| {
        keys.iter()
            .any(|k| is_up(k) || is_down(k) || is_standard(k) || toggle(k).is_some())
    });
    axes || keys
}

/// The listening thread. It stops when this is dropped.
#[derive(Debug)]
pub struct InputThread {
    dropped: Arc<AtomicU64>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl InputThread {
    /// Actions lost because the ring was full.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }
}

impl Drop for InputThread {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // A thread that panicked leaves the knobs dead, nothing else.
            let _ = thread.join();
        }
    }
}

/// Starts the thread, named `input`. A machine without devices is no error: they may come.
///
/// # Errors
/// When there are devices but none may be opened, or the thread cannot be started.
pub fn spawn() -> Result<(rtrb::Consumer<InputEvent>, InputThread), BusError> {
    let mut devices = Devices::default();
    devices.look()?;
    let (mut actions, consumer) = rtrb::RingBuffer::new(ACTIONS_QUEUED_MAX);
    let dropped = Arc::new(AtomicU64::new(0));
    let stop = Arc::new(AtomicBool::new(false));
    let thread = std::thread::Builder::new()
        .name("input".into())
        .spawn({
            let (dropped, stop) = (Arc::clone(&dropped), Arc::clone(&stop));
            move || {
                while !stop.load(Ordering::Acquire) {
                    devices.listen(&mut |event| {
                        let lost = actions.push(event).is_err();
                        dropped.fetch_add(u64::from(lost), Ordering::Relaxed);
                    });
                    // In flight a device that may not be opened is a device that is not there.
                    let _ = devices.look();
                }
            }
        })
        .map_err(|source| BusError::Refused {
            device: "the thread of the input devices".into(),
            source,
        })?;
    let thread = InputThread {
        dropped,
        stop,
        thread: Some(thread),
    };
    Ok((consumer, thread))
}

/// The devices listened to.
#[derive(Default)]
struct Devices {
    open: Vec<(PathBuf, Device)>,
    /// When the folder last changed, as of the last look: a look costs one system call while nothing changes.
    changed: Option<SystemTime>,
}

impl Devices {
    /// Opens what is new in the folder.
    fn look(&mut self) -> Result<(), BusError> {
        let changed = std::fs::metadata(FOLDER).and_then(|m| m.modified()).ok();
        if changed == self.changed {
            return Ok(());
        }
        self.changed = changed;
        let mut refused = None;
        for path in event_files(Path::new(FOLDER)) {
            let is_known = self.open.iter().any(|(known, _)| *known == path);
            if is_known || self.open.len() == DEVICES_MAX {
                continue;
            }
            match Device::open(&path).and_then(|d| d.set_nonblocking(true).map(|()| d)) {
                Ok(device) if is_of_use(&device) => self.open.push((path, device)),
                Ok(_) => {}
                Err(e) => {
                    // udev may not have set its rights yet: look again.
                    self.changed = None;
                    refused = Some((path, e));
                }
            }
        }
        match refused {
            Some((path, source))
                if self.open.is_empty() && source.kind() == io::ErrorKind::PermissionDenied =>
            {
                Err(BusError::NotPermitted {
                    device: path.display().to_string(),
                    todo: "add the user to the group input".to_owned(),
                    source,
                })
            }
            _ => Ok(()),
        }
    }

    /// Waits for events for up to [`LOOK_EVERY`] and passes on what they mean. A device that is gone is let go.
    fn listen(&mut self, sink: &mut dyn FnMut(InputEvent)) {
        if self.open.is_empty() {
            std::thread::park_timeout(LOOK_EVERY);
            return;
        }
        let wait = Timespec {
            tv_sec: 0,
            tv_nsec: i64::from(LOOK_EVERY.subsec_nanos()),
        };
        let mut ready: arrayvec::ArrayVec<PollFd<'_>, DEVICES_MAX> = self
            .open
            .iter()
            .map(|(_, device)| PollFd::new(device, PollFlags::IN))
            .collect();
        let polled = poll(&mut ready, Some(&wait));
        drop(ready);
        if polled.is_err() {
            return;
        }
        let at = Monotonic::read();
        self.open.retain_mut(|(_, device)| {
            match device.fetch_events() {
                Ok(events) => events
                    .filter_map(|e| action(e.event_type().0, e.code(), e.value()))
                    .for_each(|action| sink(InputEvent { at, action })),
                Err(e) => return super::udp::is_pause(&e),
            }
            true
        });
    }
}

/// The `event*` files of a folder; none if it cannot be read.
fn event_files(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return Vec::new();
    };
    let mut files: Vec<_> = entries
        .flatten()
        .filter(|entry| entry.file_name().as_encoded_bytes().starts_with(b"event"))
        .map(|entry| entry.path())
        .collect();
    files.sort();
    files
}

#[cfg(test)]
mod tests {
    use super::*;

    // Numbers of linux/input-event-codes.h, written out.
    const EV_KEY: u16 = 1;
    const EV_REL: u16 = 2;
    const REL_DIAL: u16 = 7;
    const KEY_UP: u16 = 103;
    const KEY_DOWN: u16 = 108;
    const KEY_S: u16 = 31;

    #[test]
    fn knobs_turn_the_setting_by_their_detents() {
        assert_eq!(action(EV_REL, REL_DIAL, 1), Some(Action::BaroSteps(1)));
        assert_eq!(action(EV_REL, REL_DIAL, -3), Some(Action::BaroSteps(-3)));
        assert_eq!(action(EV_REL, REL_DIAL, 0), None);
        assert_eq!(action(EV_REL, 0, 5), None, "a mouse moved");
        assert_eq!(
            action(EV_REL, REL_DIAL, i32::MAX),
            Some(Action::BaroSteps(20)),
            "no hand turns faster"
        );
    }

    #[test]
    fn keys_act_when_pressed_and_repeat_only_for_steps() {
        assert_eq!(action(EV_KEY, KEY_UP, 1), Some(Action::BaroSteps(1)));
        assert_eq!(action(EV_KEY, KEY_UP, 2), Some(Action::BaroSteps(1)));
        assert_eq!(action(EV_KEY, KEY_UP, 0), None, "released");
        assert_eq!(action(EV_KEY, KEY_DOWN, 1), Some(Action::BaroSteps(-1)));
        assert_eq!(action(EV_KEY, KEY_S, 1), Some(Action::BaroStandard));
        assert_eq!(action(EV_KEY, KEY_S, 2), None, "held");
        assert_eq!(action(0, 0, 0), None, "a synchronisation event");
    }
}
