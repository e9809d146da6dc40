//! Buses: a thread per source that reads, stamps and decodes, and passes signals on through a ring.
//!
//! The thread does `read -> Monotonic::read() -> decode -> ring` and nothing else: no allocation per frame, no lock, and no
//! waiting for whoever reads the ring. When the ring is full the newest signals are dropped and counted. When the device
//! goes away the thread opens it again, waiting longer each time ([`Backoff`]), until it is told to stop.
//!
//! A bus does not know any protocol: it is given a function that decodes ([`Decode`]).

pub mod can;
pub mod input;
pub mod loopback;
mod serial;
pub mod udp;

use crate::limits::SIGNALS_QUEUED_MAX;
use crate::signal::{Frame, Signal, SourceId, Wire};
use crate::time::Monotonic;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// The longest that a thread waits for a frame before it looks whether it should stop.
const WAIT: Duration = Duration::from_millis(50);

/// Kinds of bad frames that a decoder may tell apart.
pub const BAD_KINDS: usize = 12;

/// Running totals of a decoder: every frame is good, bad or ignored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Whole, well-formed frames.
    pub good: u64,
    /// Frames with something wrong, by kind; which kind is which is the decoder's business.
    pub bad: [u64; BAD_KINDS],
    /// Somebody else's frames.
    pub ignored: u64,
}

/// What a bus thread does with a frame: gives its signals to the second argument, returns the totals so far.
pub type Decode = Box<dyn FnMut(Frame<'_>, &mut dyn FnMut(Signal)) -> Tally + Send>;

/// Where a source is heard.
#[derive(Debug)]
pub enum Endpoint {
    /// A UDP socket.
    Udp {
        /// Address and port to listen on.
        bind: SocketAddr,
        /// Senders that are listened to; empty means any that can reach the address.
        allow: Vec<IpAddr>,
    },
    /// A CAN interface of the system.
    Can {
        /// Its name, as in `can0`.
        interface: String,
        /// The identifiers that the kernel passes on, both 11-bit and 29-bit; empty means all.
        ids: &'static [u16],
    },
    /// A serial port.
    Serial {
        /// Its path, as in `/dev/serial/by-id/usb-...`.
        device: String,
        /// Bits a second.
        baud: u32,
    },
    /// A CAN bus within this process.
    Loopback(loopback::Receiver),
}

/// One source to listen to.
#[derive(Debug)]
pub struct SourceConfig {
    /// Its name in messages and figures.
    pub name: String,
    /// What its signals are marked with.
    pub id: SourceId,
    /// Where it is heard.
    pub endpoint: Endpoint,
}

/// Why a source cannot be listened to. Displayed as `WHAT: WHY (WHAT TO DO)`.
#[derive(Debug, thiserror::Error)]
#[error("{}: {} ({})", self.what(), self.why(), self.todo())]
pub enum BusError {
    /// Another program listens on the port.
    PortInUse {
        /// The address.
        bind: SocketAddr,
        /// What the system said.
        source: io::Error,
    },
    /// The address is not one of this machine.
    AddressNotLocal {
        /// The address.
        bind: SocketAddr,
        /// What the system said.
        source: io::Error,
    },
    /// There is no such CAN interface.
    InterfaceMissing {
        /// Its name.
        interface: String,
        /// What the system said.
        source: io::Error,
    },
    /// There is no such serial port.
    SerialMissing {
        /// Its path.
        device: String,
        /// What the system said.
        source: io::Error,
    },
    /// Another program holds the serial port.
    SerialHeld {
        /// Its path.
        device: String,
        /// What the system said.
        source: io::Error,
    },
    /// The program may not use the serial port.
    SerialNotPermitted {
        /// Its path.
        device: String,
        /// The group whose members may.
        group: String,
        /// What the system said.
        source: io::Error,
    },
    /// The path is something else.
    SerialNone {
        /// The path.
        device: String,
        /// What the system said.
        source: io::Error,
    },
    /// The port cannot be as fast or as slow.
    SerialSpeed {
        /// Its path.
        device: String,
        /// Bits a second.
        baud: u32,
        /// What the driver said.
        source: io::Error,
    },
    /// The program may not use the device.
    NotPermitted {
        /// The device.
        device: String,
        /// What the system said.
        source: io::Error,
    },
    /// Anything else that the system refused.
    Refused {
        /// The device.
        device: String,
        /// What the system said.
        source: io::Error,
    },
}

impl BusError {
    /// The device.
    #[must_use]
    pub fn what(&self) -> String {
        match self {
            Self::PortInUse { bind, .. } | Self::AddressNotLocal { bind, .. } => {
                format!("udp {bind}")
            }
            Self::InterfaceMissing { interface, .. } => format!("can {interface}"),
            Self::SerialMissing { device, .. }
            | Self::SerialHeld { device, .. }
            | Self::SerialNotPermitted { device, .. }
            | Self::SerialNone { device, .. }
            | Self::SerialSpeed { device, .. } => format!("serial {device}"),
            Self::NotPermitted { device, .. } | Self::Refused { device, .. } => device.clone(),
        }
    }

    /// What is wrong with it.
    #[must_use]
    pub fn why(&self) -> String {
        match self {
            Self::PortInUse { bind, .. } => {
                format!("another program listens on port {}", bind.port())
            }
            Self::AddressNotLocal { bind, .. } => {
                format!("{} is no address of this machine", bind.ip())
            }
            Self::InterfaceMissing { .. } => "there is no such interface".to_owned(),
            Self::SerialMissing { .. } => "there is no such port".to_owned(),
            Self::SerialHeld { .. } => "another program holds it".to_owned(),
            Self::SerialNone { .. } => "it is no serial port".to_owned(),
            Self::SerialSpeed { baud, .. } => format!("it cannot do {baud} bit/s"),
            Self::SerialNotPermitted { .. } | Self::NotPermitted { .. } => {
                "this program may not use it".to_owned()
            }
            Self::Refused { .. } => "the system refused it".to_owned(),
        }
    }

    /// What the system said.
    #[must_use]
    pub fn into_source(self) -> io::Error {
        match self {
            Self::PortInUse { source, .. }
            | Self::AddressNotLocal { source, .. }
            | Self::InterfaceMissing { source, .. }
            | Self::SerialMissing { source, .. }
            | Self::SerialHeld { source, .. }
            | Self::SerialNotPermitted { source, .. }
            | Self::SerialNone { source, .. }
            | Self::SerialSpeed { source, .. }
            | Self::NotPermitted { source, .. }
            | Self::Refused { source, .. } => source,
        }
    }

    /// What the user can do.
    #[must_use]
    pub fn todo(&self) -> String {
        match self {
            Self::PortInUse { bind, .. } => format!(
                "stop it, `ss -ulnp sport = :{}` names it, or choose another port",
                bind.port()
            ),
            Self::AddressNotLocal { .. } => {
                "choose one that `ip address` lists, or 0.0.0.0 for all".to_owned()
            }
            Self::InterfaceMissing { interface, .. } if interface.starts_with("vcan") => {
                format!("make it: ip link add {interface} type vcan && ip link set {interface} up")
            }
            Self::InterfaceMissing { interface, .. } => format!(
                "connect the adapter, `glasswing list` names what is there, then: ip link set {interface} up type can bitrate 500000"
            ),
            Self::SerialMissing { .. } | Self::SerialNone { .. } => {
                "connect the adapter; `glasswing list` names what is there".to_owned()
            }
            Self::SerialHeld { device, .. } => {
                format!("stop it, `fuser {device}` names it")
            }
            Self::SerialNotPermitted { group, .. } => format!("add the user to the group {group}"),
            Self::SerialSpeed { .. } => "give the speed that its sender has".to_owned(),
            Self::NotPermitted { device, .. } if device.starts_with("/dev/input") => {
                "add the user to the group input".to_owned()
            }
            Self::NotPermitted { .. } => {
                "choose a port above 1023, or run it as a user who may".to_owned()
            }
            Self::Refused { .. } => "see the system's log".to_owned(),
        }
    }
}

/// Figures of one source, written by its thread and read by anybody.
#[derive(Debug, Default)]
pub struct SourceFigures {
    good: AtomicU64,
    bad: [AtomicU64; BAD_KINDS],
    ignored: AtomicU64,
    dropped: AtomicU64,
    reopened: AtomicU64,
    faults: AtomicU64,
    foreign: AtomicU64,
}

/// [`SourceFigures`] at one moment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Figures {
    /// Whole, well-formed frames.
    pub good: u64,
    /// Frames with something wrong.
    pub bad: u64,
    /// The same by kind, see [`Tally::bad`].
    pub bad_by_kind: [u64; BAD_KINDS],
    /// Somebody else's frames.
    pub ignored: u64,
    /// Signals lost because the ring was full.
    pub dropped: u64,
    /// How often the device was opened again.
    pub reopened: u64,
    /// Errors of the device: failed reads, CAN error frames, an interface that went down.
    pub faults: u64,
    /// Datagrams from senders that are not listened to.
    pub foreign: u64,
}

impl Figures {
    /// All frames that the decoder was given.
    #[must_use]
    pub const fn frames(&self) -> u64 {
        self.good + self.bad + self.ignored
    }
}

impl SourceFigures {
    /// As they are now. Each figure is exact; two of them may be a frame apart.
    #[must_use]
    pub fn snapshot(&self) -> Figures {
        let get = |figure: &AtomicU64| figure.load(Ordering::Acquire);
        let bad_by_kind = std::array::from_fn(|kind| get(&self.bad[kind]));
        Figures {
            good: get(&self.good),
            bad: bad_by_kind.iter().sum(),
            bad_by_kind,
            ignored: get(&self.ignored),
            dropped: get(&self.dropped),
            reopened: get(&self.reopened),
            faults: get(&self.faults),
            foreign: get(&self.foreign),
        }
    }

    fn add(figure: &AtomicU64, n: u64) {
        figure.fetch_add(n, Ordering::Relaxed);
    }

    fn store(&self, tally: Tally) {
        self.good.store(tally.good, Ordering::Release);
        for (figure, bad) in self.bad.iter().zip(tally.bad) {
            figure.store(bad, Ordering::Release);
        }
        self.ignored.store(tally.ignored, Ordering::Release);
    }
}

/// A source that is listened to: what it says, and the thread that listens.
#[derive(Debug)]
pub struct SourceHandle {
    /// Its signals in the order of their frames.
    pub signals: rtrb::Consumer<Signal>,
    /// The thread.
    pub thread: SourceThread,
}

/// The thread of a source. It stops when this is dropped.
#[derive(Debug)]
pub struct SourceThread {
    name: String,
    id: SourceId,
    figures: Arc<SourceFigures>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl SourceThread {
    /// The source's name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What the source's signals are marked with.
    #[must_use]
    pub const fn id(&self) -> SourceId {
        self.id
    }

    /// Its figures, which live on after the thread.
    #[must_use]
    pub const fn figures(&self) -> &Arc<SourceFigures> {
        &self.figures
    }

    /// Stops listening and waits until the thread has ended: at most a few times 50 ms. A second call does nothing.
    pub fn stop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // A bus thread that panicked has nothing more to say; its silence is already shown as stale data.
            let _ = thread.join();
        }
    }
}

impl Drop for SourceThread {
    fn drop(&mut self) {
        self.stop();
    }
}

/// Opens the source and starts its thread, named `bus-NAME`.
///
/// # Errors
/// When the source cannot be opened now; see [`BusError`]. What happens to it later is handled by the thread.
pub fn spawn(config: SourceConfig, decode: Decode) -> Result<SourceHandle, BusError> {
    let SourceConfig { name, id, endpoint } = config;
    let figures = Arc::new(SourceFigures::default());
    let source: Box<dyn Source> = match endpoint {
        Endpoint::Udp { bind, allow } => {
            Box::new(udp::Socket::open(bind, allow, Arc::clone(&figures))?)
        }
        Endpoint::Can { interface, ids } => {
            Box::new(can::Socket::open(interface, ids, Arc::clone(&figures))?)
        }
        Endpoint::Serial { device, baud } => Box::new(serial::Port::open(device, baud)?),
        Endpoint::Loopback(receiver) => Box::new(receiver),
    };
    let stop = Arc::new(AtomicBool::new(false));
    let (producer, signals) = rtrb::RingBuffer::new(SIGNALS_QUEUED_MAX);
    let feed = Feed {
        id,
        decode,
        signals: producer,
        figures: Arc::clone(&figures),
    };
    let thread = std::thread::Builder::new()
        .name(format!("bus-{name}"))
        .spawn({
            let stop = Arc::clone(&stop);
            move || listen(source, feed, &stop)
        })
        .map_err(|source| BusError::Refused {
            device: format!("the thread of {name}"),
            source,
        })?;
    Ok(SourceHandle {
        signals,
        thread: SourceThread {
            name,
            id,
            figures,
            stop,
            thread: Some(thread),
        },
    })
}

/// Something that frames come from.
trait Source: Send {
    /// The next frame and when it was received; `None` when there was none for up to [`WAIT`].
    fn receive(&mut self) -> io::Result<Option<(Monotonic, Wire<'_>)>>;

    /// Opens the device again after an error.
    fn reopen(&mut self) -> io::Result<()>;
}

/// From frames to the ring.
struct Feed {
    id: SourceId,
    decode: Decode,
    signals: rtrb::Producer<Signal>,
    figures: Arc<SourceFigures>,
}

impl Feed {
    fn take(&mut self, at: Monotonic, wire: Wire<'_>) {
        let frame = Frame {
            at,
            source: self.id,
            wire,
        };
        let signals = &mut self.signals;
        let mut dropped = 0;
        let tally = (self.decode)(frame, &mut |signal| {
            dropped += u64::from(signals.push(signal).is_err());
        });
        if dropped > 0 {
            SourceFigures::add(&self.figures.dropped, dropped);
        }
        self.figures.store(tally);
    }
}

fn listen(mut source: Box<dyn Source>, mut feed: Feed, stop: &AtomicBool) {
    let mut backoff = Backoff::new();
    let mut open = true;
    while !stop.load(Ordering::Acquire) {
        if !open {
            std::thread::park_timeout(backoff.next_wait());
            open = source.reopen().is_ok();
            SourceFigures::add(&feed.figures.reopened, u64::from(open));
            continue;
        }
        match source.receive() {
            Ok(Some((at, wire))) => {
                backoff = Backoff::new();
                feed.take(at, wire);
            }
            Ok(None) => {}
            Err(_) => {
                SourceFigures::add(&feed.figures.faults, 1);
                open = false;
            }
        }
    }
}

/// How long to wait before a device is opened again: 50 ms at first, so that a glitch is hardly seen, then twice as long
/// each time up to 2 s, so that a device that is gone costs nothing, and one that comes back is used within 2 s.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Backoff {
    next: Duration,
}

impl Backoff {
    const FIRST: Duration = Duration::from_millis(50);
    const LONGEST: Duration = Duration::from_secs(2);

    /// Before the first attempt.
    #[must_use]
    pub const fn new() -> Self {
        Self { next: Self::FIRST }
    }

    /// The time to wait before the next attempt.
    pub fn next_wait(&mut self) -> Duration {
        let wait = self.next;
        self.next = (wait * 2).min(Self::LONGEST);
        wait
    }
}

impl Default for Backoff {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_double_up_to_two_seconds() {
        let mut backoff = Backoff::new();
        let waits: Vec<_> = (0..8).map(|_| backoff.next_wait().as_millis()).collect();
        assert_eq!(waits, [50, 100, 200, 400, 800, 1600, 2000, 2000]);
    }

    #[test]
    fn errors_name_the_device_and_the_remedy() {
        let e = BusError::InterfaceMissing {
            interface: "vcan0".into(),
            source: io::ErrorKind::NotFound.into(),
        };
        assert_eq!(
            e.to_string(),
            "can vcan0: there is no such interface (make it: ip link add vcan0 type vcan && ip link set vcan0 up)"
        );
        let e = BusError::PortInUse {
            bind: ([127, 0, 0, 1], 5500).into(),
            source: io::ErrorKind::AddrInUse.into(),
        };
        assert!(
            e.to_string()
                .starts_with("udp 127.0.0.1:5500: another program listens on port 5500 ("),
            "{e}"
        );
    }
}
