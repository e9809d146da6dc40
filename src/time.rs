//! Time: one monotonic clock, read once per loop and passed on as an argument.
//!
//! Logic never reads a clock. The bus threads stamp each frame at receipt, the frame loop reads the clock once per
//! frame; everything else takes `now`. Wall-clock time is a signal from a receiver, never a clock.

use std::time::Duration;

/// A point on `CLOCK_MONOTONIC`, in nanoseconds since an arbitrary start (the kernel's boot).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Monotonic(u64);

impl Monotonic {
    /// Reads the clock. Only bus threads (to stamp), the frame loop (once per frame) and tools call this.
    #[must_use]
    pub fn read() -> Self {
        let t = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
        let seconds = u64::try_from(t.tv_sec).unwrap_or(0);
        let nanoseconds = u64::try_from(t.tv_nsec).unwrap_or(0);
        Self(seconds * 1_000_000_000 + nanoseconds)
    }

    /// A point `ns` nanoseconds after the clock's start. For tests, recordings and flip events.
    #[must_use]
    pub const fn from_nanos(ns: u64) -> Self {
        Self(ns)
    }

    /// Nanoseconds since the clock's start.
    #[must_use]
    pub const fn as_nanos(self) -> u64 {
        self.0
    }

    /// How long ago `earlier` was, or `None` when it lies in the future of `self` (a stamp from the future is stale,
    /// not young).
    #[must_use]
    pub const fn since(self, earlier: Self) -> Option<Duration> {
        match self.0.checked_sub(earlier.0) {
            Some(ns) => Some(Duration::from_nanos(ns)),
            None => None,
        }
    }

    /// This point plus `d` (saturating at the end of the clock, 584 years after boot).
    #[must_use]
    pub const fn plus(self, d: Duration) -> Self {
        let ns = d.as_nanos();
        if ns > (u64::MAX - self.0) as u128 {
            return Self(u64::MAX);
        }
        #[expect(clippy::cast_possible_truncation, reason = "bounded by the line above")]
        Self(self.0 + ns as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stamp_from_the_future_has_no_age() {
        let earlier = Monotonic::from_nanos(10);
        let later = Monotonic::from_nanos(25);
        assert_eq!(later.since(earlier), Some(Duration::from_nanos(15)));
        assert_eq!(earlier.since(later), None);
    }

    #[test]
    fn addition_saturates() {
        let end = Monotonic::from_nanos(u64::MAX - 1).plus(Duration::from_secs(1));
        assert_eq!(end.as_nanos(), u64::MAX);
    }

    #[test]
    fn the_real_clock_moves_forward() {
        let a = Monotonic::read();
        let b = Monotonic::read();
        assert!(b >= a, "CLOCK_MONOTONIC went backwards");
    }
}
