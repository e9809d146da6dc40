//! Buses: a thread per source that reads, stamps and decodes, and passes signals on through a ring.
//!
//! The thread does `read -> Monotonic::read() -> decode -> ring` and nothing else: no allocation per frame, no lock, and no
//! waiting for whoever reads the ring. When the ring is full the newest signals are dropped and counted. When the device
//! goes away the thread opens it again, waiting longer each time up to 2 s ([`Backoff`]), until it is told to stop. What it
//! counts and how its device fares stand in [`SourceFigures`].
//!
//! A bus does not know any protocol: it is given a function that decodes ([`Decode`]).

pub mod can;
mod error;
mod figures;
pub mod input;
pub mod loopback;
mod serial;
mod udp;

pub use error::BusError;
pub use figures::{BAD_KINDS, Event, Figures, Link, SourceFigures, Tally};
pub use udp::bound as udp_socket;

use crate::limits::SIGNALS_QUEUED_MAX;
use crate::signal::{Frame, Signal, SourceId, Wire};
use crate::time::Monotonic;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// The longest that a thread waits for a frame before it looks whether it should stop.
const WAIT: Duration = Duration::from_millis(50);

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
        /// The 11-bit identifiers that the kernel passes on, and with them all 29-bit ones that can be one of them on a
        /// redundancy channel; empty means all 11-bit ones.
        ids: &'static [u16],
    },
    /// A CAN interface of the system, all of whose data frames are passed on: for those who do not know yet what it carries.
    WholeCan {
        /// Its name, as in `can0`.
        interface: String,
    },
    /// A serial port: 8N1, read only.
    Serial {
        /// Its path; one that stays the same when it is unplugged and plugged in again is found again.
        path: String,
        /// Bits per second.
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
    interface: Option<String>,
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

    /// How many frames of a CAN bus the kernel kept away since the source was last opened, by the interface's own count:
    /// those with identifiers that are none of the source's. None for what is no CAN interface, or is gone.
    #[must_use]
    pub fn kept_away(&self) -> Option<u64> {
        let passed = can::frames_passed(self.interface.as_deref()?)?;
        Some(self.figures.kept_away(passed))
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
    let interface = match &endpoint {
        Endpoint::Can { interface, .. } | Endpoint::WholeCan { interface } => {
            Some(interface.clone())
        }
        _ => None,
    };
    let source: Box<dyn Source> = match endpoint {
        Endpoint::Udp { bind, allow } => {
            Box::new(udp::Socket::open(bind, allow, Arc::clone(&figures))?)
        }
        Endpoint::Can { interface, ids } => {
            let ids = Some(ids);
            Box::new(can::Socket::open(interface, ids, Arc::clone(&figures))?)
        }
        Endpoint::WholeCan { interface } => {
            Box::new(can::Socket::open(interface, None, Arc::clone(&figures))?)
        }
        Endpoint::Serial { path, baud } => Box::new(serial::Port::open(path, baud)?),
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
            interface,
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
            self.figures.dropped(dropped);
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
            if open {
                feed.take(Monotonic::read(), Wire::Stream(&[]));
                feed.figures.reopened();
            }
            continue;
        }
        match source.receive() {
            Ok(Some((at, wire))) => {
                backoff = Backoff::new();
                feed.take(at, wire);
            }
            Ok(None) => {}
            Err(_) => {
                feed.figures.fault([Event::Lost]);
                feed.figures.set_link(Link::Closed);
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
}
