//! Health: the watchdog is fed only while pictures really change hands.
//!
//! The frame loop stores the time of its last completed flip; a thread of its own looks at it a few times a second and
//! tells systemd (`READY=1` once, `WATCHDOG=1` while healthy). A frame loop that hangs, or a screen that no longer flips,
//! stops the feeding, and systemd restarts the program: a frozen picture is the worst fault of all.

use crate::time::Monotonic;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// How often the flips are looked at: five times within the unit file's watchdog time of 10 s, with room to spare.
const LOOK_EVERY: Duration = Duration::from_millis(500);

/// The age of the last flip beyond which the picture counts as frozen: 1.5 s is 90 frames at 60 Hz, and longer than any
/// mode change or card reset that comes back by itself.
pub const FLIP_AGE_MAX: Duration = Duration::from_millis(1500);

/// What the frame loop keeps fresh.
#[derive(Debug, Default)]
pub struct Pulse {
    last_flip_ns: AtomicU64,
}

impl Pulse {
    /// The frame loop has just completed a flip at `at`.
    pub fn flipped(&self, at: Monotonic) {
        self.last_flip_ns
            .store(at.as_nanos().max(1), Ordering::Relaxed);
    }

    /// Whether a picture was flipped within [`FLIP_AGE_MAX`] before `now`; `None` before the first.
    #[must_use]
    pub fn is_beating(&self, now: Monotonic) -> Option<bool> {
        match self.last_flip_ns.load(Ordering::Relaxed) {
            0 => None,
            // A flip stamped a moment after `now` was read is the youngest of all.
            ns => Some(
                now.since(Monotonic::from_nanos(ns))
                    .is_none_or(|age| age <= FLIP_AGE_MAX),
            ),
        }
    }
}

/// The thread that feeds the watchdog. Ends when dropped.
#[derive(Debug)]
pub struct Health {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Health {
    /// Starts it; `look` is called each time, for what else is worth a look now and then. Without systemd (no
    /// `NOTIFY_SOCKET`) the notifications go nowhere.
    ///
    /// # Errors
    /// When the system has no room for a thread.
    pub fn start(
        pulse: Arc<Pulse>,
        mut look: impl FnMut() + Send + 'static,
    ) -> std::io::Result<Self> {
        let stop = Arc::new(AtomicBool::new(false));
        let seen = Arc::clone(&stop);
        let thread = std::thread::Builder::new()
            .name("health".into())
            .spawn(move || {
                let mut ready = false;
                while !seen.load(Ordering::Acquire) {
                    match pulse.is_beating(Monotonic::read()) {
                        Some(true) if !ready => {
                            ready = true;
                            let _ = sd_notify::notify(&[sd_notify::NotifyState::Ready]);
                        }
                        Some(true) => {
                            let _ = sd_notify::notify(&[sd_notify::NotifyState::Watchdog]);
                        }
                        Some(false) => {
                            tracing::error!("no picture has changed for {FLIP_AGE_MAX:?}");
                        }
                        None => {}
                    }
                    look();
                    std::thread::park_timeout(LOOK_EVERY);
                }
                let _ = sd_notify::notify(&[sd_notify::NotifyState::Stopping]);
            })?;
        Ok(Self {
            stop,
            thread: Some(thread),
        })
    }
}

impl Drop for Health {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pulse_beats_only_while_flips_come() {
        let pulse = Pulse::default();
        let t = Monotonic::from_nanos(10_000_000_000);
        assert_eq!(
            pulse.is_beating(t),
            None,
            "no flip yet: not ready, not frozen"
        );
        pulse.flipped(t);
        assert_eq!(pulse.is_beating(t.plus(FLIP_AGE_MAX)), Some(true));
        assert_eq!(
            pulse.is_beating(t.plus(FLIP_AGE_MAX + Duration::from_nanos(1))),
            Some(false)
        );
        assert_eq!(pulse.is_beating(Monotonic::from_nanos(1)), Some(true));
    }
}
