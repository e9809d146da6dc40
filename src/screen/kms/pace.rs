//! The pace of frames. A real display reports flips at its refreshes, with a count; then the reports set the pace. A
//! virtual one (virtio-gpu) reports at once, with a count that stands still; then a timer sets it. Pure: reports in,
//! advice out.

use std::time::Duration;

use crate::time::Monotonic;

/// What sets the pace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Source {
    /// Too few reports yet to know.
    Unknown,
    /// The display's refreshes: the count moves.
    Refresh,
    /// Our timer: the count stands still.
    Timer,
}

/// What follows from a flip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Advice {
    /// Refreshes that showed the frame before once more.
    pub(super) missed: u32,
    /// Wait until then before the next frame.
    pub(super) wait_until: Option<Monotonic>,
    /// From now on a timer sets the pace; said once.
    pub(super) timer_begins: bool,
}

/// Keeps the pace.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pacer {
    period: Duration,
    source: Source,
    last_count: Option<u32>,
    /// The beat the last frame belongs to.
    beat: Option<Monotonic>,
}

impl Pacer {
    /// For a display of `refresh_hz`. A rate that cannot be counts as 60.
    pub(super) fn new(refresh_hz: f64) -> Self {
        let hz = if (1.0..=1000.0).contains(&refresh_hz) {
            refresh_hz
        } else {
            60.0
        };
        Self {
            period: Duration::from_secs_f64(hz.recip()),
            source: Source::Unknown,
            last_count: None,
            beat: None,
        }
    }

    /// A frame became visible at `at`, with the display's refresh count `count`.
    pub(super) fn flipped(&mut self, at: Monotonic, count: u32) -> Advice {
        let advanced = self.last_count.map(|last| count.wrapping_sub(last));
        self.last_count = Some(count);
        let before = self.source;
        self.source = match advanced {
            None => Source::Unknown,
            Some(0) => Source::Timer,
            Some(_) => Source::Refresh,
        };
        match advanced {
            Some(refreshes @ 1..) => {
                self.beat = Some(at);
                Advice {
                    missed: refreshes - 1,
                    wait_until: None,
                    timer_begins: false,
                }
            }
            None | Some(0) => Advice {
                timer_begins: self.source == Source::Timer && before != Source::Timer,
                ..self.beaten(at)
            },
        }
    }

    /// The frame at `at` belongs to the beat at hand, or, when that is over, begins a new row of beats.
    fn beaten(&mut self, at: Monotonic) -> Advice {
        let due = self.beat.map_or(at, |beat| beat.plus(self.period));
        let late = at.since(due);
        let (beat, missed) = match late {
            // In time (the very first frame is, too).
            None => (due, 0),
            Some(late) => (at, late.as_nanos() / self.period.as_nanos().max(1)),
        };
        self.beat = Some(beat);
        Advice {
            missed: u32::try_from(missed).unwrap_or(u32::MAX),
            wait_until: (beat > at).then_some(beat),
            timer_begins: false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at_ms(ms: u64) -> Monotonic {
        Monotonic::from_nanos(ms * 1_000_000)
    }

    #[test]
    fn a_moving_count_sets_the_pace_and_tells_missed_refreshes() {
        let mut pacer = Pacer::new(50.0);
        pacer.flipped(at_ms(0), 700);
        let advice = pacer.flipped(at_ms(20), 701);
        assert_eq!((advice.missed, advice.wait_until), (0, None));
        let advice = pacer.flipped(at_ms(80), 704);
        assert_eq!((advice.missed, advice.wait_until), (2, None));
    }

    #[test]
    fn the_count_may_wrap() {
        let mut pacer = Pacer::new(50.0);
        pacer.flipped(at_ms(0), u32::MAX);
        assert_eq!(pacer.flipped(at_ms(40), 1).missed, 1);
    }

    #[test]
    fn a_count_that_stands_still_is_paced_by_a_timer_said_once() {
        let mut pacer = Pacer::new(50.0);
        let first = pacer.flipped(at_ms(1000), 0);
        assert_eq!((first.wait_until, first.timer_begins), (None, false));
        // The next frame is ready after 5 ms and belongs to the beat at 1020 ms.
        let second = pacer.flipped(at_ms(1005), 0);
        assert_eq!(second.wait_until, Some(at_ms(1020)));
        assert!(second.timer_begins, "the log is told");
        let third = pacer.flipped(at_ms(1026), 0);
        assert_eq!(third.wait_until, Some(at_ms(1040)));
        assert!(!third.timer_begins, "once only");
        assert_eq!(third.missed, 0);
    }

    #[test]
    fn a_late_frame_starts_the_beat_anew_instead_of_hurrying_after_it() {
        let mut pacer = Pacer::new(50.0);
        pacer.flipped(at_ms(0), 0);
        pacer.flipped(at_ms(5), 0);
        // Due at 40 ms, visible at 105 ms: three beats (40, 60, 80 to 100) showed the old frame.
        let late = pacer.flipped(at_ms(105), 0);
        assert_eq!((late.missed, late.wait_until), (3, None));
        let next = pacer.flipped(at_ms(110), 0);
        assert_eq!(next.wait_until, Some(at_ms(125)));
    }

    #[test]
    fn an_impossible_rate_is_taken_as_60_hz() {
        let mut pacer = Pacer::new(f64::NAN);
        pacer.flipped(at_ms(0), 0);
        let wait = pacer.flipped(at_ms(1), 0).wait_until;
        assert_eq!(wait, Some(Monotonic::from_nanos(16_666_667)));
    }
}
