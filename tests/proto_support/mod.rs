//! What tests of decoders share: something that listens, and a storm of damaged frames.

#![allow(
    dead_code,
    reason = "every test includes this module and uses only some of it"
)]

use glasswing::heap::allocations_of_this_thread;
use glasswing::proto::{Counters, Decoder, Protocol};
use glasswing::sampled::Invalid;
use glasswing::signal::{Frame, Limit, Parameter, Signal, Sink, SourceId, Traffic, Wire};
use glasswing::time::Monotonic;

/// All that a decoder has said.
#[derive(Clone, Debug, Default)]
pub(crate) struct Heard {
    pub(crate) signals: Vec<Signal>,
    pub(crate) traffic: Vec<Traffic>,
    pub(crate) limits: Vec<Limit>,
}

impl Sink for Heard {
    fn signal(&mut self, signal: Signal) {
        self.signals.push(signal);
    }

    fn traffic(&mut self, traffic: &Traffic) {
        self.traffic.push(*traffic);
    }

    fn limit(&mut self, limit: &Limit) {
        self.limits.push(*limit);
    }
}

impl Heard {
    /// What was said of a parameter, the last time.
    pub(crate) fn last(&self, parameter: Parameter) -> Option<Result<f64, Invalid>> {
        let said = |s: &&Signal| s.parameter == parameter;
        self.signals.iter().rev().find(said).map(|s| s.value)
    }

    #[track_caller]
    pub(crate) fn assert_near(&self, parameter: Parameter, expected: f64) {
        let got = self.last(parameter);
        let near = |x: f64| (x - expected).abs() <= 1e-9 * expected.abs().max(1.0);
        assert!(
            matches!(got, Some(Ok(x)) if near(x)),
            "{parameter:?}: {got:?}, not {expected}"
        );
    }

    #[track_caller]
    pub(crate) fn assert_absent(&self, parameter: Parameter) {
        assert_eq!(
            self.last(parameter),
            Some(Err(Invalid::SourceFailed)),
            "{parameter:?}"
        );
    }
}

/// What a fresh decoder makes of a byte stream.
pub(crate) fn stream(protocol: Protocol, bytes: &[u8]) -> (Heard, Counters) {
    let mut decoder = protocol.decoder();
    let mut heard = Heard::default();
    decoder.push(at(0, Wire::Stream(bytes)), &mut heard);
    decoder.finish();
    let counters = *decoder.counters();
    (heard, counters)
}

pub(crate) fn at(ms: u64, wire: Wire<'_>) -> Frame<'_> {
    Frame {
        at: Monotonic::from_nanos(ms * 1_000_000),
        source: SourceId(3),
        wire,
    }
}

/// Numbers without a pattern (Marsaglia 2003, "Xorshift RNGs").
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    pub(crate) fn below(&mut self, n: usize) -> usize {
        usize::try_from(self.next() >> 11).unwrap_or(0) % n.max(1)
    }

    pub(crate) fn byte(&mut self) -> u8 {
        self.next().to_be_bytes()[0]
    }

    /// Damages a frame as lines do: bits turned over, bytes replaced, lost, doubled; the end cut off.
    pub(crate) fn damage(&mut self, frame: &mut Vec<u8>) {
        for _ in 0..=self.below(3) {
            if frame.is_empty() {
                return;
            }
            let i = self.below(frame.len());
            match self.below(6) {
                0 | 1 => frame[i] ^= 1 << self.below(8),
                2 => frame[i] = self.byte(),
                3 => {
                    frame.remove(i);
                }
                4 if frame.len() < frame.capacity() => frame.insert(i, frame[i]),
                _ => frame.truncate(frame.len() - self.below(3).min(frame.len())),
            }
        }
    }
}

/// How many frames a storm has; a hundred times as many with `GLASSWING_STORM` in the environment, for an hour to spare.
pub(crate) fn storm_frames(native: usize) -> usize {
    if std::env::var_os("GLASSWING_STORM").is_some() {
        native * 100
    } else if crate::support::is_emulated() {
        native / 50
    } else {
        native
    }
}

/// As many bytes as a decoder may hold back before it says what was in them.
const RECENT_BYTES: usize = 4200;

/// Counts what comes and checks that every number may be a number of its parameter; allocates nothing.
#[derive(Default)]
pub(crate) struct Gauge {
    pub(crate) said: u64,
}

impl Sink for Gauge {
    fn signal(&mut self, signal: Signal) {
        self.said += 1;
        if let Ok(x) = signal.value {
            assert!(signal.parameter.check(x).is_ok(), "{signal:?}");
        }
    }

    fn traffic(&mut self, _: &Traffic) {
        self.said += 1;
    }

    fn limit(&mut self, _: &Limit) {
        self.said += 1;
    }
}

/// Sends damaged frames and noise to one decoder, each followed by `flush` (which must end whatever was begun), and holds
/// that nothing is said unless `holds_a_frame`, a check that knows nothing of the decoder, finds a whole frame in the bytes.
pub(crate) fn storm(
    protocol: Protocol,
    frames: &[Vec<u8>],
    flush: &[u8],
    count: usize,
    holds_a_frame: &dyn Fn(&[u8]) -> bool,
) {
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    let mut decoder: Box<dyn Decoder> = protocol.decoder();
    let longest = frames.iter().map(Vec::len).max().unwrap_or(64);
    let mut bytes = Vec::with_capacity(2 * longest + 64);
    let mut recent = Vec::new();
    let mut gauge = Gauge::default();
    for n in 0..count {
        bytes.clear();
        if n % 8 == 7 {
            bytes.extend((0..random.below(longest)).map(|_| random.byte()));
        } else {
            bytes.extend(&frames[random.below(frames.len())]);
            random.damage(&mut bytes);
        }
        bytes.extend(flush);
        let before = allocations_of_this_thread();
        gauge.said = 0;
        decoder.push(at(n as u64, Wire::Stream(&bytes)), &mut gauge);
        assert_eq!(allocations_of_this_thread(), before, "allocates");
        recent.drain(..recent.len().saturating_sub(RECENT_BYTES));
        recent.extend(&bytes);
        if gauge.said > 0 {
            assert!(
                holds_a_frame(&bytes) || holds_a_frame(&recent),
                "{} things said of {:02X?} {}",
                gauge.said,
                bytes,
                String::from_utf8_lossy(&bytes)
            );
        }
    }
}
