//! Which buffers the display may be reading, from flip to flip. Pure: the caller tells what it handed over and what the
//! kernel reported, and is told which buffer is free again.

use std::time::Duration;

use crate::time::Monotonic;

/// The buffers that must stay as they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Flips<B> {
    /// One buffer is on the glass.
    Settled {
        /// It.
        shown: B,
    },
    /// A second one was handed over; from the next refresh on it is on the glass.
    Pending {
        /// On the glass until then.
        shown: B,
        /// Handed over.
        next: B,
        /// When it was handed over.
        since: Monotonic,
    },
    /// The kernel has not reported the flip in time. Either buffer may be on the glass; a late report still settles it.
    Overdue {
        /// On the glass when `next` was handed over.
        shown: B,
        /// Handed over.
        next: B,
        /// When it was handed over.
        since: Monotonic,
    },
}

impl<B: Copy> Flips<B> {
    /// The mode was set with `shown` on the glass.
    pub(super) const fn new(shown: B) -> Self {
        Self::Settled { shown }
    }

    /// May a buffer be handed over? Only one at a time may wait.
    pub(super) const fn is_settled(&self) -> bool {
        matches!(self, Self::Settled { .. })
    }

    /// `next` was handed over at `now`.
    ///
    /// # Panics
    /// If another one waits already: the kernel would have refused this one.
    pub(super) fn queued(&mut self, next: B, now: Monotonic) {
        assert!(self.is_settled(), "two flips at once");
        let (Self::Settled { shown } | Self::Pending { shown, .. } | Self::Overdue { shown, .. }) =
            *self;
        *self = Self::Pending {
            shown,
            next,
            since: now,
        };
    }

    /// The kernel reports a flip. Gives the buffer that left the glass and may be drawn into again, or `None` when no
    /// flip was waiting.
    pub(super) fn flipped(&mut self) -> Option<B> {
        match *self {
            Self::Settled { .. } => None,
            Self::Pending { shown, next, .. } | Self::Overdue { shown, next, .. } => {
                *self = Self::Settled { shown: next };
                Some(shown)
            }
        }
    }

    /// How long to wait for the kernel's report, given a `limit` per flip: zero when none is waited for, or when the
    /// limit is passed, which makes the flip overdue.
    pub(super) fn patience(&mut self, now: Monotonic, limit: Duration) -> Duration {
        match *self {
            Self::Settled { .. } | Self::Overdue { .. } => Duration::ZERO,
            Self::Pending { shown, next, since } => {
                let waited = now.since(since).unwrap_or(Duration::ZERO);
                let left = limit.saturating_sub(waited);
                if left.is_zero() {
                    *self = Self::Overdue { shown, next, since };
                }
                left
            }
        }
    }

    /// When the flip that is waited for was handed over.
    pub(super) const fn waiting_since(&self) -> Option<Monotonic> {
        match *self {
            Self::Settled { .. } => None,
            Self::Pending { since, .. } | Self::Overdue { since, .. } => Some(since),
        }
    }

    /// Every buffer that may be on the glass.
    pub(super) fn held(&self) -> impl Iterator<Item = B> + use<B> {
        let (shown, next) = match *self {
            Self::Settled { shown } => (shown, None),
            Self::Pending { shown, next, .. } | Self::Overdue { shown, next, .. } => {
                (shown, Some(next))
            }
        };
        std::iter::once(shown).chain(next)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: Duration = Duration::from_secs(3);

    fn at_ms(ms: u64) -> Monotonic {
        Monotonic::from_nanos(ms * 1_000_000)
    }

    #[test]
    fn the_buffer_on_the_glass_is_freed_by_the_next_flip_only() {
        let mut flips = Flips::new('a');
        assert_eq!(flips.flipped(), None, "nothing was handed over");
        flips.queued('b', at_ms(0));
        assert!(!flips.is_settled());
        assert_eq!(flips.held().collect::<String>(), "ab");
        assert_eq!(flips.flipped(), Some('a'));
        assert_eq!(flips.held().collect::<String>(), "b");
        flips.queued('a', at_ms(17));
        assert_eq!(flips.flipped(), Some('b'));
    }

    #[test]
    fn a_flip_that_is_never_reported_becomes_overdue_and_keeps_both_buffers() {
        let mut flips = Flips::new('a');
        flips.queued('b', at_ms(1000));
        assert_eq!(
            flips.patience(at_ms(1500), LIMIT),
            Duration::from_millis(2500)
        );
        assert_eq!(flips.patience(at_ms(4000), LIMIT), Duration::ZERO);
        assert!(matches!(flips, Flips::Overdue { .. }), "{flips:?}");
        assert_eq!(flips.held().collect::<String>(), "ab");
        assert_eq!(flips.waiting_since(), Some(at_ms(1000)));
    }

    #[test]
    fn a_late_report_settles_an_overdue_flip() {
        let mut flips = Flips::new('a');
        flips.queued('b', at_ms(0));
        assert_eq!(flips.patience(at_ms(9000), LIMIT), Duration::ZERO);
        assert_eq!(flips.flipped(), Some('a'));
        assert_eq!(flips, Flips::Settled { shown: 'b' });
    }

    #[test]
    #[should_panic(expected = "two flips at once")]
    fn a_second_flip_before_the_first_is_reported_is_a_broken_protocol() {
        let mut flips = Flips::new('a');
        flips.queued('b', at_ms(0));
        flips.queued('c', at_ms(1));
    }
}
