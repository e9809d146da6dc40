//! A short memory of one thing: what it was at a few moments, evenly spaced, back to a few seconds ago.

use crate::time::Monotonic;
use arrayvec::ArrayVec;
use std::time::Duration;

/// Moments kept.
const KEPT: usize = 16;
/// No closer to each other than this.
const SPACING: Duration = Duration::from_millis(200);

/// Values of a few seconds, the oldest first.
#[derive(Clone, Debug)]
pub(super) struct Trail<T> {
    moments: ArrayVec<(Monotonic, T), KEPT>,
}

impl<T: Copy> Trail<T> {
    pub(super) fn new() -> Self {
        Self {
            moments: ArrayVec::new(),
        }
    }

    /// Keeps a value that was received at `at`, unless the last one is too near.
    pub(super) fn keep(&mut self, value: T, at: Monotonic) {
        if let Some((last, _)) = self.moments.last()
            && at.since(*last).is_none_or(|d| d < SPACING)
        {
            return;
        }
        if self.moments.is_full() {
            self.moments.remove(0);
        }
        self.moments.push((at, value));
    }

    /// Forgets everything: another source speaks, or none.
    pub(super) fn forget(&mut self) {
        self.moments.clear();
    }

    /// The moments of the last `window` before the newest.
    pub(super) fn within(&self, window: Duration) -> &[(Monotonic, T)] {
        let Some((newest, _)) = self.moments.last() else {
            return &[];
        };
        let recent = |(at, _): &(Monotonic, T)| newest.since(*at).is_some_and(|d| d <= window);
        let first = self.moments.iter().position(recent).unwrap_or(0);
        self.moments.get(first..).unwrap_or_default()
    }
}
