//! What the tests of the buses share: waiting for other threads, virtual CAN interfaces, serial ports without hardware.

#![allow(
    dead_code,
    reason = "every test includes this module and uses only some of it"
)]

use glasswing::bus::SourceThread;
use glasswing::signal::SourceId;
use glasswing::time::Monotonic;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::OwnedFd;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::process::Command;
use std::time::Duration;

/// The source that the tests listen to.
pub(crate) const ID: SourceId = SourceId(0);

/// Waits for a condition that other threads bring about; ten seconds are for a machine that does much else.
pub(crate) fn wait_until(what: &str, mut condition: impl FnMut() -> bool) {
    let start = Monotonic::read();
    while !condition() {
        let waited = Monotonic::read().since(start).unwrap_or_default();
        assert!(waited < Duration::from_secs(10), "never: {what}");
        std::thread::park_timeout(Duration::from_millis(1));
    }
}

pub(crate) fn wait_for_frames(thread: &SourceThread, frames: u64) {
    wait_until("frames are decoded", || {
        thread.figures().snapshot().frames() >= frames
    });
}

/// A virtual CAN interface of the test's own, removed when dropped.
pub(crate) struct Vcan(pub(crate) &'static str);

impl Vcan {
    /// Made and up; `None`, said aloud, where this machine or this user cannot.
    pub(crate) fn make(name: &'static str) -> Option<Self> {
        let made = ip(&["link", "add", name, "type", "vcan"]) && ip(&["link", "set", name, "up"]);
        if !made {
            crate::support::skip("no virtual CAN here (it takes root and the kernel's vcan)");
        }
        made.then_some(Self(name))
    }
}

impl Drop for Vcan {
    fn drop(&mut self) {
        ip(&["link", "delete", self.0]);
    }
}

/// Whether `ip WORDS` succeeds.
pub(crate) fn ip(words: &[&str]) -> bool {
    Command::new("ip")
        .args(words)
        .output()
        .is_ok_and(|output| output.status.success())
}

/// Whether serial ports cannot be had here, said aloud: QEMU's user emulation does not pass on what makes a port exclusive
/// and sets its speed.
pub(crate) fn has_no_serial_ports() -> bool {
    let none = crate::support::is_emulated();
    if none {
        crate::support::skip("no serial ports under emulation");
    }
    none
}

/// The far end of a serial line; the near end is the port at `path`, which vanishes with this.
pub(crate) struct Line {
    far: OwnedFd,
    /// The path of the near end.
    pub(crate) path: String,
}

impl Line {
    /// A new pseudoterminal.
    pub(crate) fn new() -> Self {
        let far = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)
            .expect("a pseudoterminal");
        grantpt(&far).expect("granted");
        unlockpt(&far).expect("unlocked");
        let path = ptsname(&far, Vec::new()).expect("a name");
        let path = path.into_string().expect("a name in ASCII");
        Self { far, path }
    }

    /// Sends bytes.
    pub(crate) fn send(&self, bytes: &[u8]) {
        let sent = rustix::io::write(&self.far, bytes).expect("written");
        assert_eq!(sent, bytes.len(), "the line took all bytes");
    }

    /// All that comes from the near end until the program that opened it lets it go.
    pub(crate) fn receive_all(&self) -> Vec<u8> {
        let mut all = Vec::new();
        let mut buffer = [0; 4096];
        // Hung up, a pseudoterminal says that there is an error.
        while let Ok(read) = rustix::io::read(&self.far, &mut buffer) {
            all.extend(&buffer[..read]);
        }
        all
    }

    /// Sends bytes if the line has room for any, and says whether it had.
    pub(crate) fn offer(&self, bytes: &[u8]) -> bool {
        let mut ready = [PollFd::new(&self.far, PollFlags::OUT)];
        let now = Timespec::default();
        let has_room = poll(&mut ready, Some(&now)).is_ok_and(|n| n > 0)
            && ready[0].revents().contains(PollFlags::OUT);
        has_room && rustix::io::write(&self.far, bytes).is_ok()
    }

    /// The settings of the near end.
    pub(crate) fn settings(&self) -> rustix::termios::Termios {
        rustix::termios::tcgetattr(&self.far).expect("asked")
    }
}
