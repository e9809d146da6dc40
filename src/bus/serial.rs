//! Serial ports: whatever bytes have come are one piece of a stream.
//!
//! Eight data bits, no parity, one stop bit, no flow control; only reading. A port is ours alone: other programs are kept
//! out (`TIOCEXCL`, and a lock that also root heeds), and one that has the port already is named. A byte that came with a
//! framing error is read as zero, so that its frame fails.
//!
//! A USB adapter that is pulled out hangs up its line, and its node disappears; plugged in again it may have another number.
//! The path is looked up anew each time the port is opened, so a name that stays, as those in `/dev/serial/by-id`, finds it
//! again. What has piled up before a port is opened is thrown away: its time of receipt is not known.

use super::udp::is_pause;
use super::{BusError, Source, WAIT};
use crate::limits::SERIAL_CHUNK_BYTES_MAX;
use crate::signal::Wire;
use crate::time::Monotonic;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{FlockOperation, Mode, OFlags, flock};
use rustix::io::Errno;
use rustix::termios::{
    ControlModes, InputModes, OptionalActions, QueueSelector, Termios, ioctl_tiocexcl, tcflush,
    tcgetattr, tcsetattr,
};
use std::fs;
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;
use std::time::Duration;

/// The largest part by which the speed of a port may be off: with 8N1 a byte is sampled for the last time 9.5 bits after
/// its beginning, where half a bit is 5 %; either end may use up half of that.
const SPEED_ERROR_MAX: f64 = 0.025;

/// An open port.
pub(super) struct Port {
    path: String,
    baud: u32,
    /// None until it can be opened, and from a failure to the next opening that succeeds.
    fd: Option<OwnedFd>,
    buffer: [u8; SERIAL_CHUNK_BYTES_MAX],
}

impl Port {
    /// Not open yet.
    pub(super) const fn new(path: String, baud: u32) -> Self {
        Self {
            path,
            baud,
            fd: None,
            buffer: [0; SERIAL_CHUNK_BYTES_MAX],
        }
    }
}

impl Source for Port {
    fn receive(&mut self, wait: Duration) -> io::Result<Option<(Monotonic, Wire<'_>)>> {
        let Some(fd) = &self.fd else {
            return Err(io::ErrorKind::NotConnected.into());
        };
        let wait = Timespec {
            tv_sec: 0,
            tv_nsec: i64::from(wait.subsec_nanos()),
        };
        let mut ready = [PollFd::new(fd, PollFlags::IN)];
        match poll(&mut ready, Some(&wait)) {
            Ok(0) | Err(Errno::INTR) => return Ok(None),
            Ok(_) => {}
            Err(e) => return Err(e.into()),
        }
        // Before the bytes are fetched: what comes meanwhile counts as a little older than it is, never as younger.
        let at = Monotonic::read();
        match rustix::io::read(fd, &mut self.buffer[..]) {
            Ok(0) => Err(io::ErrorKind::BrokenPipe.into()),
            Ok(len) => Ok(Some((at, Wire::Stream(&self.buffer[..len])))),
            Err(e) => {
                let e = io::Error::from(e);
                // A port that is ready with nothing to read has been hung up.
                let hung_up = ready[0]
                    .revents()
                    .intersects(PollFlags::HUP.union(PollFlags::ERR).union(PollFlags::NVAL));
                if is_pause(&e) && !hung_up {
                    Ok(None)
                } else {
                    Err(e)
                }
            }
        }
    }

    fn open(&mut self) -> Result<(), BusError> {
        // The old one is let go first: it would hold the port against ourselves.
        self.fd = None;
        self.fd = Some(open(&self.path, self.baud, OFlags::RDONLY)?);
        Ok(())
    }
}

/// Sends bytes on a port: for the bench.
#[derive(Debug)]
pub struct Sender {
    fd: OwnedFd,
}

impl Sender {
    /// On the port at `path`, at `baud` bits per second, 8N1.
    ///
    /// # Errors
    /// When it is missing, held by another program, refused, or does not have the speed.
    pub fn open(path: &str, baud: u32) -> Result<Self, BusError> {
        let fd = open(path, baud, OFlags::WRONLY)?;
        Ok(Self { fd })
    }

    /// Sends all of `bytes`, waiting at most a few times 50 ms for room.
    ///
    /// # Errors
    /// `WouldBlock` when there is no room and nobody takes what is there; what the system says when the port has gone.
    pub fn send(&self, mut bytes: &[u8]) -> io::Result<()> {
        let wait = Timespec {
            tv_sec: 0,
            tv_nsec: i64::from(WAIT.subsec_nanos()),
        };
        while !bytes.is_empty() {
            match rustix::io::write(&self.fd, bytes) {
                Ok(written) => bytes = &bytes[written..],
                Err(Errno::AGAIN) => {
                    let mut room = [PollFd::new(&self.fd, PollFlags::OUT)];
                    if poll(&mut room, Some(&wait))? == 0 {
                        return Err(io::ErrorKind::WouldBlock.into());
                    }
                }
                Err(Errno::INTR) => {}
                Err(e) => return Err(e.into()),
            }
        }
        Ok(())
    }
}

fn open(path: &str, baud: u32, access: OFlags) -> Result<OwnedFd, BusError> {
    // Not blocking: a port whose carrier line is low would otherwise wait for a carrier.
    let flags = access | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let fd = rustix::fs::open(path, flags, Mode::empty()).map_err(|e| refusal(path, e))?;
    let mut termios = tcgetattr(&fd).map_err(|e| refusal(path, e))?;
    let held = |e: Errno| BusError::SerialHeld {
        path: path.to_owned(),
        holder: holder(path),
        source: e.into(),
    };
    flock(&fd, FlockOperation::NonBlockingLockExclusive).map_err(held)?;
    // Root is let in past another program's claim, and not everybody makes one.
    if let Some(holder) = holder(path) {
        return Err(BusError::SerialHeld {
            path: path.to_owned(),
            holder: Some(holder),
            source: Errno::BUSY.into(),
        });
    }
    ioctl_tiocexcl(&fd).map_err(|e| refusal(path, e))?;
    let refused = |instead, source: io::Error| BusError::SpeedRefused {
        path: path.to_owned(),
        baud,
        instead,
        source,
    };
    listen_only(&mut termios, baud).map_err(|e| refused(None, e))?;
    tcsetattr(&fd, OptionalActions::Now, &termios).map_err(|e| match e {
        Errno::INVAL | Errno::RANGE => refused(None, e.into()),
        e => refusal(path, e),
    })?;
    // A driver that does not have the speed sets another one and says so here only.
    let set = tcgetattr(&fd).map_err(|e| refusal(path, e))?.input_speed();
    if (f64::from(set) / f64::from(baud) - 1.0).abs() > SPEED_ERROR_MAX {
        return Err(refused(Some(set), Errno::INVAL.into()));
    }
    tcflush(&fd, QueueSelector::IFlush).map_err(|e| refusal(path, e))?;
    Ok(fd)
}

/// Raw bytes, 8N1, at `baud`, whatever the modem lines say.
fn listen_only(termios: &mut Termios, baud: u32) -> io::Result<()> {
    termios.make_raw();
    // With the parity check on and nothing else said, a byte with a framing error is read as zero.
    termios.input_modes -= InputModes::IGNPAR | InputModes::IXOFF | InputModes::IXANY;
    termios.input_modes |= InputModes::INPCK;
    termios.control_modes -= ControlModes::CSTOPB | ControlModes::PARODD | ControlModes::CRTSCTS;
    termios.control_modes |= ControlModes::CREAD | ControlModes::CLOCAL;
    Ok(termios.set_speed(baud)?)
}

fn refusal(path: &str, e: Errno) -> BusError {
    let (device, source) = (path.to_owned(), io::Error::from(e));
    match e {
        Errno::NOENT | Errno::NODEV | Errno::NXIO | Errno::NOTDIR => BusError::SerialMissing {
            path: device,
            source,
        },
        Errno::NOTTY | Errno::ISDIR | Errno::INVAL => BusError::NotSerial {
            path: device,
            source,
        },
        Errno::BUSY => BusError::SerialHeld {
            holder: holder(path),
            path: device,
            source,
        },
        Errno::ACCESS | Errno::PERM => BusError::NotPermitted {
            todo: admittance(path),
            device: format!("serial {device}"),
            source,
        },
        _ => BusError::Refused {
            device: format!("serial {device}"),
            source,
        },
    }
}

/// What lets a user open the port.
fn admittance(path: &str) -> String {
    /// `S_IRGRP` of `sys/stat.h`.
    const GROUP_READS: u32 = 0o040;
    let Ok(node) = fs::metadata(path) else {
        return "let the user into the folders above it".to_owned();
    };
    let groups = fs::read_to_string("/etc/group").unwrap_or_default();
    match group_name(&groups, node.gid()) {
        Some(group) if node.mode() & GROUP_READS != 0 && group != "root" => format!(
            "add the user to the group {group}: usermod -aG {group} USER, then log in again"
        ),
        _ => "give it to the group dialout with a udev rule, and add the user to that group"
            .to_owned(),
    }
}

/// The name of a group in a text like `/etc/group`.
fn group_name(groups: &str, gid: u32) -> Option<&str> {
    groups.lines().find_map(|line| {
        let mut words = line.split(':');
        let name = words.next()?;
        (words.nth(1)?.parse() == Ok(gid)).then_some(name)
    })
}

/// Another program that has the device open, as far as this one may see the others.
fn holder(path: &str) -> Option<String> {
    let device = fs::canonicalize(path).ok()?;
    let own = std::process::id();
    let processes = fs::read_dir("/proc").ok()?.flatten();
    processes
        .filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok())
        .find(|process| *process != own && has_open(*process, &device))
        .map(|process| {
            let name = fs::read_to_string(format!("/proc/{process}/comm")).unwrap_or_default();
            format!("{} (process {process})", name.trim())
        })
}

fn has_open(process: u32, device: &Path) -> bool {
    fs::read_dir(format!("/proc/{process}/fd")).is_ok_and(|files| {
        files
            .flatten()
            .any(|file| fs::read_link(file.path()).is_ok_and(|target| target == device))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_are_found_by_their_number() {
        let groups = "root:x:0:\ndialout:x:20:pilot,other\nbroken\nplugdev:x:46:\n";
        assert_eq!(group_name(groups, 20), Some("dialout"));
        assert_eq!(group_name(groups, 0), Some("root"));
        assert_eq!(group_name(groups, 2), None, "no part of another number");
    }
}
