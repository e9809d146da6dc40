//! What tests of decoders share: something that listens.

#![allow(
    dead_code,
    reason = "every test includes this module and uses only some of it"
)]

use glasswing::proto::{Counters, Protocol};
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
