//! Figures of a run, kept without allocating: histograms of times, and the JSON they become.

use serde_json::{Value, json};
use std::time::Duration;

/// Width of a bucket.
const BUCKET_US: u64 = 50;
/// Buckets: 0 to 500 ms. Longer times are counted in the last one; the exact maximum is kept beside.
const BUCKETS: usize = 10_000;

/// A histogram of durations with 0.05 ms buckets and an exact maximum.
#[derive(Debug)]
pub struct Histogram {
    counts: Vec<u32>,
    total: u64,
    max: Duration,
}

impl Default for Histogram {
    fn default() -> Self {
        Self::new()
    }
}

impl Histogram {
    /// An empty one. Allocates its buckets; nothing else here does.
    #[must_use]
    pub fn new() -> Self {
        Self {
            counts: vec![0; BUCKETS],
            total: 0,
            max: Duration::ZERO,
        }
    }

    /// Counts one duration.
    pub fn add(&mut self, d: Duration) {
        let bucket = (d.as_micros() / u128::from(BUCKET_US)).min(BUCKETS as u128 - 1);
        let bucket = usize::try_from(bucket).unwrap_or(BUCKETS - 1);
        self.counts[bucket] = self.counts[bucket].saturating_add(1);
        self.total += 1;
        self.max = self.max.max(d);
    }

    /// How many were counted.
    #[must_use]
    pub const fn len(&self) -> u64 {
        self.total
    }

    /// Whether none was counted.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.total == 0
    }

    /// The upper edge of the bucket below which `percent` of the counted durations lie, in milliseconds (never more than the
    /// exact maximum); `None` when none was counted.
    #[must_use]
    pub fn percentile_ms(&self, percent: u64) -> Option<f64> {
        if self.total == 0 {
            return None;
        }
        let wanted = (self.total * percent).div_ceil(100).max(1);
        let mut seen = 0;
        for (i, n) in self.counts.iter().enumerate() {
            seen += u64::from(*n);
            if seen >= wanted && i + 1 < BUCKETS {
                let edge_us = (i as u64 + 1) * BUCKET_US;
                return Some(Duration::from_micros(edge_us).min(self.max).as_secs_f64() * 1e3);
            }
        }
        Some(self.max_ms())
    }

    /// The longest, in milliseconds.
    #[must_use]
    pub fn max_ms(&self) -> f64 {
        self.max.as_secs_f64() * 1e3
    }

    /// `{p50, p95, p99, max}` in milliseconds, or null when none was counted.
    #[must_use]
    pub fn to_json(&self) -> Value {
        if self.is_empty() {
            return Value::Null;
        }
        json!({
            "p50": self.percentile_ms(50),
            "p95": self.percentile_ms(95),
            "p99": self.percentile_ms(99),
            "max": self.max_ms(),
            "count": self.total,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_of_a_known_series() {
        let mut h = Histogram::new();
        for ms in 1..=100 {
            h.add(Duration::from_millis(ms));
        }
        // Exact to one bucket (0.05 ms) above.
        for (percent, ms) in [(50, 50.0), (95, 95.0), (99, 99.0), (100, 100.0)] {
            let p = h.percentile_ms(percent).unwrap();
            assert!((ms..=ms + 0.051).contains(&p), "p{percent} = {p}");
        }
        assert!((h.max_ms() - 100.0).abs() < 1e-9, "max");
    }

    #[test]
    fn nothing_counted_is_null_and_not_zero() {
        assert_eq!(Histogram::new().to_json(), Value::Null);
        assert_eq!(Histogram::new().percentile_ms(50), None);
    }

    #[test]
    fn times_beyond_the_last_bucket_keep_their_maximum() {
        let mut h = Histogram::new();
        h.add(Duration::from_secs(7));
        assert_eq!(h.percentile_ms(50), Some(7000.0));
    }
}
