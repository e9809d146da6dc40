//! A value and its right to be shown, as one type.
//!
//! Whatever a sensor said is a [`Sampled`]. The only way to its value is [`Sampled::read`], which needs the time and the
//! greatest age that the reader accepts, and which says *why* when there is nothing to show. There is no default value,
//! nothing is clamped, and the last good value of a failed source cannot be had.

use crate::time::Monotonic;
use std::time::Duration;

/// Why a value may not be shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Invalid {
    /// No source has ever sent it.
    NeverReceived,
    /// The last good value is too old, or stamped in the future.
    Stale,
    /// The source sent a number that this parameter cannot have (NaN and infinities included).
    OutOfRange,
    /// The source itself says that it has failed or has nothing to say.
    SourceFailed,
    /// The source itself says that the value is not to be trusted.
    Doubtful,
    /// It repeats to the last bit where its sensor could not: the sensor has stopped.
    Frozen,
    /// Other sensors say that it cannot be.
    Implausible,
    /// Two sources disagree by more than the parameter allows.
    Miscompare,
}

impl Invalid {
    /// The lower-case name used in JSON and CSV output.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::NeverReceived => "never-received",
            Self::Stale => "stale",
            Self::OutOfRange => "out-of-range",
            Self::SourceFailed => "source-failed",
            Self::Doubtful => "doubtful",
            Self::Frozen => "frozen",
            Self::Implausible => "implausible",
            Self::Miscompare => "miscompare",
        }
    }
}

/// What was last heard of one quantity: never anything, a value, or a fault; each with its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampled<T> {
    last: Last<T>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Last<T> {
    Never,
    Value { value: T, at: Monotonic },
    Fault { reason: Invalid, at: Monotonic },
}

impl<T: Copy> Sampled<T> {
    /// Nothing heard yet.
    #[must_use]
    pub const fn never() -> Self {
        Self { last: Last::Never }
    }

    /// A good value received at `at`.
    #[must_use]
    pub const fn good(value: T, at: Monotonic) -> Self {
        Self {
            last: Last::Value { value, at },
        }
    }

    /// A fault noticed at `at`. It stands until the next good value.
    #[must_use]
    pub const fn fault(reason: Invalid, at: Monotonic) -> Self {
        Self {
            last: Last::Fault { reason, at },
        }
    }

    /// From a decoder's verdict.
    #[must_use]
    pub const fn from_result(value: Result<T, Invalid>, at: Monotonic) -> Self {
        match value {
            Ok(value) => Self::good(value, at),
            Err(reason) => Self::fault(reason, at),
        }
    }

    /// The value, if it may be shown at `now` by a reader that accepts ages up to and including `age_max`.
    ///
    /// # Errors
    /// The reason why it may not. A fault goes stale like a value does: after `age_max` without news the reason is
    /// [`Invalid::Stale`], because then the silence is what the pilot should know.
    pub fn read(&self, now: Monotonic, age_max: Duration) -> Result<T, Invalid> {
        let fresh = |at| now.since(at).is_some_and(|age| age <= age_max);
        match self.last {
            Last::Never => Err(Invalid::NeverReceived),
            Last::Value { value, at } if fresh(at) => Ok(value),
            Last::Fault { reason, at } if fresh(at) => Err(reason),
            Last::Value { .. } | Last::Fault { .. } => Err(Invalid::Stale),
        }
    }

    /// Whether there is a value at all, of whatever age; for those who pass it on.
    #[must_use]
    pub const fn is_value(&self) -> bool {
        matches!(self.last, Last::Value { .. })
    }

    /// The time since the last value or fault; `None` if there was none or its stamp lies in the future.
    #[must_use]
    pub fn age(&self, now: Monotonic) -> Option<Duration> {
        match self.last {
            Last::Never => None,
            Last::Value { at, .. } | Last::Fault { at, .. } => now.since(at),
        }
    }

    /// When it was last heard of.
    #[must_use]
    pub const fn at(&self) -> Option<Monotonic> {
        match self.last {
            Last::Never => None,
            Last::Value { at, .. } | Last::Fault { at, .. } => Some(at),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AGE_MAX: Duration = Duration::from_millis(300);

    fn ms(t: u64) -> Monotonic {
        Monotonic::from_nanos(t * 1_000_000)
    }

    #[test]
    fn nothing_heard_is_not_zero() {
        assert_eq!(
            Sampled::<f64>::never().read(ms(1000), AGE_MAX),
            Err(Invalid::NeverReceived)
        );
    }

    #[test]
    fn a_value_is_good_to_the_last_instant_of_its_age_and_no_longer() {
        let s = Sampled::good(7, ms(1000));
        assert_eq!(s.read(ms(1300), AGE_MAX), Ok(7));
        assert_eq!(
            s.read(Monotonic::from_nanos(1_300_000_001), AGE_MAX),
            Err(Invalid::Stale)
        );
    }

    #[test]
    fn a_stamp_from_the_future_is_stale() {
        assert_eq!(
            Sampled::good(7, ms(1001)).read(ms(1000), AGE_MAX),
            Err(Invalid::Stale)
        );
    }

    #[test]
    fn a_fault_stands_and_then_becomes_silence() {
        let s = Sampled::<i32>::fault(Invalid::SourceFailed, ms(1000));
        assert_eq!(s.read(ms(1100), AGE_MAX), Err(Invalid::SourceFailed));
        assert_eq!(s.read(ms(2000), AGE_MAX), Err(Invalid::Stale));
    }
}
