//! A condition that must last before it is believed, and be gone as long before it is dropped.

use crate::time::Monotonic;
use std::time::Duration;

/// What is known of a condition at one moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Evidence {
    /// It holds.
    For,
    /// It does not hold.
    Against,
    /// Neither: between the two limits of a hysteresis. What was begun goes on.
    Between,
    /// There is nothing to judge by. Nothing is raised, and what was raised is dropped.
    Nothing,
}

/// Raised or not, and since when the evidence says the opposite.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Latch {
    raised: bool,
    opposed_since: Option<Monotonic>,
}

impl Latch {
    /// Takes in the evidence at `now`; returns whether the condition is raised. It changes when the evidence has said so
    /// without a break for `lasting`.
    pub(super) fn step(&mut self, evidence: Evidence, lasting: Duration, now: Monotonic) -> bool {
        let opposed = match evidence {
            Evidence::Nothing => {
                *self = Self::default();
                return false;
            }
            Evidence::For => !self.raised,
            Evidence::Against => self.raised,
            // Raising needs the condition itself, dropping its clear absence.
            Evidence::Between => false,
        };
        if !opposed {
            self.opposed_since = None;
            return self.raised;
        }
        let since = *self.opposed_since.get_or_insert(now);
        if now.since(since).is_some_and(|d| d >= lasting) {
            self.raised = !self.raised;
            self.opposed_since = None;
        }
        self.raised
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LASTING: Duration = Duration::from_secs(1);

    fn run(latch: &mut Latch, evidence: Evidence, from_ms: u64, to_ms: u64) -> bool {
        let mut raised = false;
        for t in (from_ms..=to_ms).step_by(20) {
            raised = latch.step(evidence, LASTING, Monotonic::from_nanos(t * 1_000_000));
        }
        raised
    }

    #[test]
    fn it_is_raised_after_its_time_and_dropped_after_its_time() {
        let mut latch = Latch::default();
        assert!(!run(&mut latch, Evidence::For, 0, 980), "too short");
        assert!(run(&mut latch, Evidence::For, 1000, 1000), "long enough");
        assert!(run(&mut latch, Evidence::Against, 1020, 2000), "not yet");
        assert!(!run(&mut latch, Evidence::Against, 2020, 2020), "gone");
    }

    #[test]
    fn a_break_starts_the_time_anew() {
        let mut latch = Latch::default();
        run(&mut latch, Evidence::For, 0, 900);
        run(&mut latch, Evidence::Between, 920, 920);
        assert!(!run(&mut latch, Evidence::For, 940, 1900), "900 + 960 ms");
        assert!(run(&mut latch, Evidence::For, 1920, 1940), "a whole second");
    }

    #[test]
    fn between_the_limits_nothing_changes_and_without_evidence_nothing_stands() {
        let mut latch = Latch::default();
        run(&mut latch, Evidence::For, 0, 1000);
        assert!(run(&mut latch, Evidence::Between, 1020, 9000), "kept");
        assert!(!run(&mut latch, Evidence::Nothing, 9020, 9020), "dropped");
    }
}
