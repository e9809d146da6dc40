//! What a bus thread counts, and how its device fares: written by the thread, read by anybody, without a lock.

use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};

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

/// How the device of a source fares.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Link {
    /// It is open and has nothing to complain of.
    #[default]
    Open,
    /// A CAN controller counts more errors than usual (96 or more); it still takes part.
    ErrorWarning,
    /// A CAN controller counts so many errors (128 or more) that it no longer marks them on the bus.
    ErrorPassive,
    /// A CAN controller has taken itself off the bus (255 errors of sending): it hears nothing until it is restarted.
    BusOff,
    /// The interface is switched off; it is heard again as soon as it is switched on.
    Down,
    /// The device has failed or is gone; it is being opened again.
    Closed,
}

impl Link {
    /// All of them, in the order of their discriminants.
    pub const ALL: [Self; 6] = [
        Self::Open,
        Self::ErrorWarning,
        Self::ErrorPassive,
        Self::BusOff,
        Self::Down,
        Self::Closed,
    ];

    /// The lower-case name used in JSON output and in the log.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Open => "open",
            Self::ErrorWarning => "error-warning",
            Self::ErrorPassive => "error-passive",
            Self::BusOff => "bus-off",
            Self::Down => "down",
            Self::Closed => "closed",
        }
    }

    /// Whether frames can come over it as it is.
    #[must_use]
    pub const fn can_hear(self) -> bool {
        matches!(self, Self::Open | Self::ErrorWarning | Self::ErrorPassive)
    }
}

/// What a device can have reported. All but the first two come in error frames of CAN controllers, of which one can hold
/// several (Linux `include/uapi/linux/can/error.h`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Event {
    /// A read failed, the line was hung up, or the device vanished.
    Lost,
    /// The interface was switched off.
    Down,
    /// The error counters passed the warning level.
    ErrorWarning,
    /// The error counters made the controller passive.
    ErrorPassive,
    /// The error counters made the controller leave the bus.
    BusOff,
    /// The controller came back to the bus.
    Restarted,
    /// The error counters are low again.
    ErrorActive,
    /// Bits, stuffing, form or checksum of a frame on the bus were wrong.
    BusError,
    /// Nobody acknowledged a frame: the bus has no other member, or another bit rate.
    NoAcknowledge,
    /// The controller or its driver was too slow: frames are lost.
    Overrun,
    /// Anything else: lost arbitration, transceiver, a transmission that timed out.
    Other,
}

impl Event {
    /// All of them, in the order of their discriminants.
    pub const ALL: [Self; 11] = [
        Self::Lost,
        Self::Down,
        Self::ErrorWarning,
        Self::ErrorPassive,
        Self::BusOff,
        Self::Restarted,
        Self::ErrorActive,
        Self::BusError,
        Self::NoAcknowledge,
        Self::Overrun,
        Self::Other,
    ];

    /// The lower-case name used in JSON output.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lost => "lost",
            Self::Down => "down",
            Self::ErrorWarning => "error-warning",
            Self::ErrorPassive => "error-passive",
            Self::BusOff => "bus-off",
            Self::Restarted => "restarted",
            Self::ErrorActive => "error-active",
            Self::BusError => "bus-error",
            Self::NoAcknowledge => "no-acknowledge",
            Self::Overrun => "overrun",
            Self::Other => "other",
        }
    }
}

/// Figures of one source, written by its thread and read by anybody.
#[derive(Debug, Default)]
pub struct SourceFigures {
    good: AtomicU64,
    bad: [AtomicU64; BAD_KINDS],
    ignored: AtomicU64,
    oversized: AtomicU64,
    dropped: AtomicU64,
    reopened: AtomicU64,
    faults: AtomicU64,
    events: [AtomicU64; Event::ALL.len()],
    foreign: AtomicU64,
    taken: AtomicU64,
    passed_before: AtomicU64,
    link: AtomicU8,
}

/// [`SourceFigures`] at one moment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Figures {
    /// Whole, well-formed frames.
    pub good: u64,
    /// Frames with something wrong, those of `oversized` included.
    pub bad: u64,
    /// The same by kind, see [`Tally::bad`].
    pub bad_by_kind: [u64; BAD_KINDS],
    /// Datagrams too long to be taken whole, hence not taken at all.
    pub oversized: u64,
    /// Somebody else's frames.
    pub ignored: u64,
    /// Signals lost because the ring was full.
    pub dropped: u64,
    /// How often the device was opened again.
    pub reopened: u64,
    /// Errors of the device: failed reads, CAN error frames, an interface that went down.
    pub faults: u64,
    /// What they were, in the order of [`Event::ALL`].
    pub events: [u64; Event::ALL.len()],
    /// Datagrams from senders that are not listened to.
    pub foreign: u64,
    /// How the device fares.
    pub link: Link,
}

impl Figures {
    /// All frames that came to be decoded.
    #[must_use]
    pub const fn frames(&self) -> u64 {
        self.good + self.bad + self.ignored
    }

    /// How often the device reported `event`.
    #[must_use]
    pub const fn events(&self, event: Event) -> u64 {
        self.events[event as usize]
    }
}

impl SourceFigures {
    /// As they are now. Each figure is exact; two of them may be a frame apart.
    #[must_use]
    pub fn snapshot(&self) -> Figures {
        let get = |figure: &AtomicU64| figure.load(Ordering::Acquire);
        let bad_by_kind = std::array::from_fn(|kind| get(&self.bad[kind]));
        let oversized = get(&self.oversized);
        Figures {
            good: get(&self.good),
            bad: bad_by_kind.iter().sum::<u64>() + oversized,
            bad_by_kind,
            oversized,
            ignored: get(&self.ignored),
            dropped: get(&self.dropped),
            reopened: get(&self.reopened),
            faults: get(&self.faults),
            events: std::array::from_fn(|event| get(&self.events[event])),
            foreign: get(&self.foreign),
            link: self.link(),
        }
    }

    /// Whole, well-formed frames.
    #[must_use]
    pub fn good(&self) -> u64 {
        self.good.load(Ordering::Acquire)
    }

    /// How the device fares.
    #[must_use]
    pub fn link(&self) -> Link {
        let link = usize::from(self.link.load(Ordering::Acquire));
        Link::ALL.get(link).copied().unwrap_or_default()
    }

    pub(super) fn set_link(&self, link: Link) {
        self.link.store(link as u8, Ordering::Release);
    }

    /// One fault of the device, with all that it reported.
    pub(super) fn fault(&self, events: impl IntoIterator<Item = Event>) {
        for event in events {
            add(&self.events[event as usize], 1);
        }
        add(&self.faults, 1);
    }

    pub(super) fn reopened(&self) {
        add(&self.reopened, 1);
        self.set_link(Link::Open);
    }

    pub(super) fn dropped(&self, n: u64) {
        add(&self.dropped, n);
    }

    pub(super) fn foreign(&self) {
        add(&self.foreign, 1);
    }

    pub(super) fn oversized(&self) {
        add(&self.oversized, 1);
    }

    /// One frame was taken from the device, of whatever kind.
    pub(super) fn taken(&self) {
        add(&self.taken, 1);
    }

    /// The device was opened when `passed` frames had passed its interface.
    pub(super) fn opened_after(&self, passed: u64) {
        self.taken.store(0, Ordering::Release);
        self.passed_before.store(passed, Ordering::Release);
    }

    /// Of `passed` frames that have passed the interface those that did not come up to here since it was opened.
    pub(super) fn kept_away(&self, passed: u64) -> u64 {
        let known = self.passed_before.load(Ordering::Acquire) + self.taken.load(Ordering::Acquire);
        passed.saturating_sub(known)
    }

    pub(super) fn store(&self, tally: Tally) {
        self.good.store(tally.good, Ordering::Release);
        for (figure, bad) in self.bad.iter().zip(tally.bad) {
            figure.store(bad, Ordering::Release);
        }
        self.ignored.store(tally.ignored, Ordering::Release);
    }
}

fn add(figure: &AtomicU64, n: u64) {
    figure.fetch_add(n, Ordering::Release);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_link_and_event_stands_in_its_own_place() {
        let figures = SourceFigures::default();
        for (i, link) in Link::ALL.into_iter().enumerate() {
            assert_eq!(link as usize, i, "{link:?}");
            figures.set_link(link);
            assert_eq!(figures.link(), link, "read back");
        }
        for (i, event) in Event::ALL.into_iter().enumerate() {
            assert_eq!(event as usize, i, "{event:?}");
            figures.fault([event]);
        }
        let seen = figures.snapshot();
        assert_eq!(seen.events, [1; Event::ALL.len()], "each once");
        assert_eq!(seen.faults, Event::ALL.len() as u64, "and all of them");
    }
}
