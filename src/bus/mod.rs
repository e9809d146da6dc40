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
pub mod serial;
mod udp;

pub use error::BusError;
pub use figures::{BAD_KINDS, Event, Figures, Link, SourceFigures, Tally};
pub use udp::bound as udp_socket;

use crate::limits::{REPORTS_QUEUED_MAX, SIGNALS_QUEUED_MAX};
use crate::signal::{Frame, Limit, Report, Signal, Sink, SourceId, Traffic, Wire};
use crate::time::Monotonic;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::os::fd::AsFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// The longest that a thread waits for a frame before it looks whether it should stop.
const WAIT: Duration = Duration::from_millis(50);

/// What a bus thread does with a frame: gives what it says to the second argument, returns the totals so far.
pub type Decode = Box<dyn FnMut(Frame<'_>, &mut dyn Sink) -> Tally + Send>;

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
    /// A CAN interface of the system, with every data frame that there is on it.
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
    /// What else it says: other aircraft, limits.
    pub reports: rtrb::Consumer<Report>,
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
    match spawn_patiently(config, decode)? {
        (_, Some(refused)) => Err(refused),
        (handle, None) => Ok(handle),
    }
}

/// Starts the thread of a source, named `bus-NAME`, though the source may not be there: it is then [`Link::Closed`], and
/// opened as soon as it can be. Returns also why it could not be opened at once.
///
/// # Errors
/// When the source can never be opened ([`BusError::is_lasting`]), or the system has no room for a thread.
pub fn spawn_patiently(
    config: SourceConfig,
    decode: Decode,
) -> Result<(SourceHandle, Option<BusError>), BusError> {
    let SourceConfig { name, id, endpoint } = config;
    let figures = Arc::new(SourceFigures::default());
    let interface = match &endpoint {
        Endpoint::Can { interface, .. } | Endpoint::WholeCan { interface } => {
            Some(interface.clone())
        }
        _ => None,
    };
    let mut source: Box<dyn Source> = match endpoint {
        Endpoint::Udp { bind, allow } => {
            Box::new(udp::Socket::new(bind, allow, Arc::clone(&figures)))
        }
        Endpoint::Can { interface, ids } => {
            let figures = Arc::clone(&figures);
            Box::new(can::Socket::new(interface, Some(ids), figures))
        }
        Endpoint::WholeCan { interface } => {
            Box::new(can::Socket::new(interface, None, Arc::clone(&figures)))
        }
        Endpoint::Serial { path, baud } => Box::new(serial::Port::new(path, baud)),
        Endpoint::Loopback(receiver) => Box::new(receiver),
    };
    let refused = source.open().err();
    match refused {
        Some(refused) if refused.is_lasting() => return Err(refused),
        Some(_) => figures.set_link(Link::Closed),
        None => {}
    }
    let is_open = refused.is_none();
    let stop = Arc::new(AtomicBool::new(false));
    let (producer, signals) = rtrb::RingBuffer::new(SIGNALS_QUEUED_MAX);
    let (reporter, reports) = rtrb::RingBuffer::new(REPORTS_QUEUED_MAX);
    let feed = Feed {
        id,
        decode,
        rings: Rings {
            signals: producer,
            reports: reporter,
            dropped: 0,
        },
        figures: Arc::clone(&figures),
    };
    let thread = std::thread::Builder::new()
        .name(format!("bus-{name}"))
        .spawn({
            let stop = Arc::clone(&stop);
            move || listen(source, feed, is_open, &stop)
        })
        .map_err(|source| BusError::Refused {
            device: format!("the thread of {name}"),
            source,
        })?;
    let handle = SourceHandle {
        signals,
        reports,
        thread: SourceThread {
            name,
            id,
            interface,
            figures,
            stop,
            thread: Some(thread),
        },
    };
    Ok((handle, refused))
}

/// Something that frames come from.
trait Source: Send {
    /// The next frame and when it was received; `None` when there was none for up to `wait`, which is [`WAIT`] or nothing.
    fn receive(&mut self, wait: Duration) -> io::Result<Option<(Monotonic, Wire<'_>)>>;

    /// Opens the device, for the first time or again after an error.
    fn open(&mut self) -> Result<(), BusError>;
}

/// From frames to the ring.
struct Feed {
    id: SourceId,
    decode: Decode,
    rings: Rings,
    figures: Arc<SourceFigures>,
}

/// The way out of a bus thread; what does not fit is counted.
struct Rings {
    signals: rtrb::Producer<Signal>,
    reports: rtrb::Producer<Report>,
    dropped: u64,
}

impl Sink for Rings {
    fn signal(&mut self, signal: Signal) {
        self.dropped += u64::from(self.signals.push(signal).is_err());
    }

    fn traffic(&mut self, traffic: &Traffic) {
        self.dropped += u64::from(self.reports.push(Report::Traffic(*traffic)).is_err());
    }

    fn limit(&mut self, limit: &Limit) {
        self.dropped += u64::from(self.reports.push(Report::Limit(*limit)).is_err());
    }

    fn own_address(&mut self, address: u32) {
        self.dropped += u64::from(self.reports.push(Report::OwnAddress(address)).is_err());
    }
}

impl Feed {
    fn take(&mut self, at: Monotonic, wire: Wire<'_>) {
        let frame = Frame {
            at,
            source: self.id,
            wire,
        };
        let tally = (self.decode)(frame, &mut self.rings);
        let dropped = std::mem::take(&mut self.rings.dropped);
        if dropped > 0 {
            self.figures.dropped(dropped);
        }
        self.figures.store(tally);
    }
}

fn listen(mut source: Box<dyn Source>, mut feed: Feed, is_open: bool, stop: &AtomicBool) {
    let mut backoff = Backoff::new();
    let mut pace = Pace::default();
    let (mut open, mut was_open) = (is_open, is_open);
    while !stop.load(Ordering::Acquire) {
        if !open {
            std::thread::park_timeout(backoff.next_wait());
            open = source.open().is_ok();
            if open && was_open {
                feed.take(Monotonic::read(), Wire::Stream(&[]));
                feed.figures.reopened();
            } else if open {
                feed.figures.set_link(Link::Open);
                was_open = true;
            }
            continue;
        }
        let wait = if pace.is_busy { Duration::ZERO } else { WAIT };
        match source.receive(wait) {
            Ok(Some((at, wire))) => {
                backoff = Backoff::new();
                pace.frame(at);
                feed.take(pace.rested.unwrap_or(at), wire);
            }
            Ok(None) if pace.is_busy => pace.rest(),
            Ok(None) => {}
            Err(_) => {
                feed.figures.fault([Event::Lost]);
                feed.figures.set_link(Link::Closed);
                open = false;
            }
        }
    }
}

/// Waits until there is something to read, for so long at most. The system's errors come with the read that follows.
fn wait_for(fd: impl AsFd, wait: Duration) -> bool {
    if wait.is_zero() {
        return true;
    }
    let wait = Timespec {
        tv_sec: 0,
        tv_nsec: i64::from(wait.subsec_nanos()),
    };
    let ready = poll(&mut [PollFd::new(&fd, PollFlags::IN)], Some(&wait));
    !matches!(ready, Ok(0) | Err(Errno::INTR))
}

/// Of a busy bus not every frame wakes the thread: that would cost more than all the rest. From 2000 frames a second on the
/// thread reads what there is, then rests for a millisecond. What came meanwhile is stamped with the beginning of the rest:
/// it counts as a little older than it is, never as younger.
#[derive(Clone, Copy, Debug, Default)]
struct Pace {
    is_busy: bool,
    /// When the last rest began, while the bus is busy.
    rested: Option<Monotonic>,
    counted_since: Option<Monotonic>,
    frames: u32,
}

impl Pace {
    const REST: Duration = Duration::from_millis(1);
    /// How long frames are counted, and how many of them in that time make a bus busy.
    const COUNTED: Duration = Duration::from_millis(10);
    const BUSY_FRAMES: u32 = 20;

    /// A frame was received at `at`.
    fn frame(&mut self, at: Monotonic) {
        self.frames += 1;
        self.look(at);
    }

    fn look(&mut self, now: Monotonic) {
        let since = *self.counted_since.get_or_insert(now);
        let counted = now.since(since).unwrap_or_default();
        if counted >= Self::COUNTED {
            let enough = counted.div_duration_f64(Self::COUNTED) * f64::from(Self::BUSY_FRAMES);
            self.is_busy = f64::from(self.frames) >= enough;
            (self.frames, self.counted_since) = (0, Some(now));
            if !self.is_busy {
                self.rested = None;
            }
        }
    }

    fn rest(&mut self) {
        let now = Monotonic::read();
        self.look(now);
        if self.is_busy {
            self.rested = Some(now);
            std::thread::sleep(Self::REST);
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

    /// Whether a bus is busy after a second of so many frames, evenly spread.
    fn is_busy_at(pace: &mut Pace, from_s: u64, hz: u64) -> bool {
        for k in 0..hz {
            pace.frame(Monotonic::from_nanos(
                from_s * 1_000_000_000 + k * 1_000_000_000 / hz,
            ));
        }
        pace.is_busy
    }

    #[test]
    fn a_bus_is_busy_from_two_thousand_frames_a_second_on() {
        let mut pace = Pace::default();
        for (second, hz, busy) in [
            (1, 1, false),
            (2, 1800, false),
            (3, 2200, true),
            (4, 9000, true),
            (5, 60, false),
        ] {
            assert_eq!(is_busy_at(&mut pace, second, hz), busy, "{hz} Hz");
        }
        // After silence a single frame says nothing.
        pace.frame(Monotonic::from_nanos(100_000_000_000));
        assert!(!pace.is_busy && pace.rested.is_none(), "nor does silence");
    }

    #[test]
    fn waits_double_up_to_two_seconds() {
        let mut backoff = Backoff::new();
        let waits: Vec<_> = (0..8).map(|_| backoff.next_wait().as_millis()).collect();
        assert_eq!(waits, [50, 100, 200, 400, 800, 1600, 2000, 2000]);
    }
}
