//! What the tests of CANaerospace share: frames, and a decoder that is fed one by one.

#![allow(
    dead_code,
    reason = "every test includes this module and uses only some of it"
)]

use glasswing::proto::Decoder;
use glasswing::proto::canaerospace::CanAerospace;
use glasswing::sampled::Invalid;
use glasswing::signal::{CanData, Frame, Parameter, Signal, SourceId, Wire};
use glasswing::time::Monotonic;

pub(crate) fn can(id: u32, bytes: &[u8]) -> CanData {
    let mut data = [0; 8];
    data[..bytes.len()].copy_from_slice(bytes);
    CanData {
        id,
        extended: false,
        len: u8::try_from(bytes.len()).expect("at most 8"),
        data,
    }
}

/// A FLOAT of node 1, written out byte by byte.
pub(crate) fn float(id: u32, code: u8, value: f32) -> CanData {
    let v = value.to_bits();
    let bytes = [24, 16, 8, 0].map(|shift| ((v >> shift) & 0xFF) as u8);
    can(id, &[1, 2, 0, code, bytes[0], bytes[1], bytes[2], bytes[3]])
}

#[derive(Default)]
pub(crate) struct Bench {
    pub(crate) decoder: CanAerospace,
    pub(crate) now_ms: u64,
}

impl Bench {
    pub(crate) fn push(&mut self, frame: CanData) -> Vec<Signal> {
        let mut signals = Vec::new();
        let frame = Frame {
            at: Monotonic::from_nanos(self.now_ms * 1_000_000),
            source: SourceId(2),
            wire: Wire::Can(frame),
        };
        self.decoder.push(frame, &mut |s| signals.push(s));
        signals
    }

    /// The one signal that the frame must make.
    pub(crate) fn one(&mut self, frame: CanData) -> (Parameter, Result<f64, Invalid>) {
        let signals = self.push(frame);
        assert_eq!(signals.len(), 1, "{frame:?}");
        assert_eq!(signals[0].source, SourceId(2), "its own source");
        (signals[0].parameter, signals[0].value)
    }
}

#[track_caller]
pub(crate) fn assert_near(
    got: (Parameter, Result<f64, Invalid>),
    parameter: Parameter,
    expected: f64,
) {
    assert!(
        got.0 == parameter
            && got
                .1
                .is_ok_and(|x| (x - expected).abs() <= 2e-7 * expected.abs().max(1.0)),
        "{got:?}, not {parameter:?} {expected}"
    );
}
