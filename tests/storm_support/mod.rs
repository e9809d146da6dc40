//! Trials of decoders by an independent judge: whatever a decoder calls good must stand in the bytes, by a reading of the
//! published layouts that shares nothing with it; however a stream is cut, it must say the same; nothing may allocate.
//!
//! `tests/storm.rs` brings storms of random and damaged frames before this judge, `tests/fuzz` what a fuzzer finds.

#![allow(
    dead_code,
    reason = "the storm and the fuzzer each use only some of it"
)]

pub(crate) mod binary;
pub(crate) mod can;
pub(crate) mod inputs;
pub(crate) mod random;
pub(crate) mod said;
pub(crate) mod seeds;
pub(crate) mod text;

use glasswing::heap::allocations_of_this_thread;
use glasswing::proto::{Carriage, Counters, Decoder, Protocol};
use glasswing::signal::{CanData, Frame, Limit, Parameter, Signal, Sink, SourceId, Traffic, Wire};
use glasswing::time::Monotonic;
use said::Said;

/// As many bytes as a decoder may hold back before it says what was in them.
const fn held_back_bytes(protocol: Protocol) -> usize {
    match protocol {
        Protocol::Nmea | Protocol::Ubx => 4200,
        Protocol::FgGeneric => 1500,
        Protocol::Gdl90 => 900,
        _ => 300,
    }
}

/// Things that one push may say without the listener allocating.
const HEARD_MAX: usize = 1 << 16;

type Frames = fn(&[u8], &mut dyn FnMut(&[u8]));

/// Makes a frame's checksum right.
type Seal = fn(&mut Vec<u8>);

/// What reads a frame.
type Read = fn(&[u8], &mut Said);

/// How bytes are judged.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rules {
    /// Gives every whole frame with a right checksum.
    frames: Frames,
    /// What a frame says.
    read: Read,
    /// Makes a frame's checksum right, where it has one.
    pub(crate) seal: Seal,
}

/// Rules of a protocol that is not on CAN.
pub(crate) fn rules(protocol: Protocol) -> Rules {
    let (frames, read, seal): (Frames, Read, Seal) = match protocol {
        Protocol::FgFdm => (binary::fgfdm_frames, binary::fgfdm, |_| {}),
        Protocol::Gdl90 => (binary::gdl90_frames, binary::gdl90, binary::seal_gdl90),
        Protocol::Ubx => (binary::ubx_frames, binary::ubx, binary::seal_ubx),
        Protocol::Mgl => (binary::mgl_frames, binary::mgl, binary::seal_mgl),
        Protocol::Nmea => (text::sentences, text::nmea, text::seal_sentence),
        Protocol::DynonSkyView => (text::skyview_frames, text::skyview, text::seal_sum),
        Protocol::GarminG3x => (text::garmin_frames, text::garmin, text::seal_sum),
        Protocol::DynonD100 => (text::d100_frames, text::d100, text::seal_sum),
        Protocol::FgGeneric => (text::lines, text::fg_generic, |_| {}),
        Protocol::CanFix | Protocol::CanAerospace => (|_, _| {}, |_, _| {}, |_| {}),
    };
    Rules { frames, read, seal }
}

/// All that one decoder has said of one piece of input.
#[derive(Debug)]
struct Heard {
    signals: Vec<Signal>,
    others: u64,
}

impl Sink for Heard {
    fn signal(&mut self, signal: Signal) {
        if self.signals.len() < HEARD_MAX {
            self.signals.push(signal);
        }
    }

    fn traffic(&mut self, _: &Traffic) {
        self.others += 1;
    }

    fn limit(&mut self, limit: &Limit) {
        let is_possible = limit.parameter.check(limit.value).is_ok();
        assert!(is_possible, "a limit that cannot be: {limit:?}");
        self.others += 1;
    }
}

impl Heard {
    fn new() -> Self {
        Self {
            signals: Vec::with_capacity(HEARD_MAX),
            others: 0,
        }
    }

    fn clear(&mut self) {
        self.signals.clear();
        self.others = 0;
    }
}

/// What the judge has seen.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Tally {
    /// Good values that the independent reading gives too.
    pub(crate) confirmed: u64,
    /// Good values of parameters that the independent reading does not know; only their ranges are held.
    pub(crate) unread: u64,
}

/// One decoder that gets its input whole, another that gets it in pieces, and the judge.
pub(crate) struct Trial {
    protocol: Protocol,
    rules: Rules,
    whole: Box<dyn Decoder>,
    cut: Box<dyn Decoder>,
    heard: Heard,
    heard_cut: Heard,
    recent: Vec<u8>,
    said: Said,
    can: can::CanAerospace,
    /// Parameters of which the independent reading has ever said something.
    known: [bool; Parameter::COUNT],
    pub(crate) tally: Tally,
}

impl Trial {
    pub(crate) fn new(protocol: Protocol) -> Self {
        let rules = rules(protocol);
        let mut said = Said::default();
        for seed in seeds::seeds(protocol) {
            (rules.frames)(&seed, &mut |frame| (rules.read)(frame, &mut said));
        }
        let mut known = [false; Parameter::COUNT];
        for parameter in Parameter::ALL {
            known[parameter.index()] = said.mentions(*parameter);
        }
        Self {
            protocol,
            rules,
            whole: protocol.decoder(),
            cut: protocol.decoder(),
            heard: Heard::new(),
            heard_cut: Heard::new(),
            recent: Vec::new(),
            said,
            can: can::CanAerospace::default(),
            known,
            tally: Tally::default(),
        }
    }

    pub(crate) fn counters(&self) -> Counters {
        *self.whole.counters()
    }

    /// Brings bytes before the judge; `next_cut` says how long the next piece is to be, given how much is left.
    pub(crate) fn bytes(
        &mut self,
        ns: u64,
        bytes: &[u8],
        mut next_cut: impl FnMut(usize) -> usize,
    ) {
        self.heard.clear();
        self.heard_cut.clear();
        let is_stream = self.protocol.carriage() == Carriage::Stream;
        let wire = |piece| {
            if is_stream {
                Wire::Stream(piece)
            } else {
                Wire::Datagram(piece)
            }
        };
        push(&mut *self.whole, ns, wire(bytes), &mut self.heard);
        let mut rest = bytes;
        while !rest.is_empty() || !is_stream {
            let n = if is_stream {
                next_cut(rest.len()).clamp(1, rest.len())
            } else {
                rest.len()
            };
            let (piece, later) = rest.split_at(n);
            push(&mut *self.cut, ns, wire(piece), &mut self.heard_cut);
            rest = later;
            if !is_stream {
                break;
            }
        }
        self.compare(bytes, Monotonic::from_nanos(ns));
        if is_stream {
            let held = self
                .recent
                .len()
                .saturating_sub(held_back_bytes(self.protocol));
            self.recent.drain(..held);
        } else {
            self.recent.clear();
        }
        self.recent.extend(bytes);
        if self.heard.signals.iter().any(|s| s.value.is_ok()) {
            self.said.clear();
            let Self {
                rules,
                said,
                recent,
                ..
            } = self;
            (rules.frames)(recent, &mut |frame| (rules.read)(frame, said));
            self.judge(bytes);
        }
    }

    /// Brings a CAN frame before the judge.
    pub(crate) fn can(&mut self, ns: u64, can: CanData) {
        self.heard.clear();
        push(&mut *self.whole, ns, Wire::Can(can), &mut self.heard);
        self.said.clear();
        if self.protocol == Protocol::CanFix {
            can::can_fix(&can, &mut self.said);
        } else {
            self.can.read(&can, &mut self.said);
        }
        self.judge(can.bytes());
    }

    /// The end of the stream: every piece has been counted once, by both decoders alike.
    pub(crate) fn finish(&mut self) {
        self.whole.finish();
        self.cut.finish();
        if self.protocol.carriage() != Carriage::Can {
            assert_eq!(self.whole.counters(), self.cut.counters(), "cut or not");
        }
    }

    fn compare(&self, bytes: &[u8], now: Monotonic) {
        let same = |a: &Signal, b: &Signal| {
            let bits = |s: &Signal| s.value.map(f64::to_bits);
            // Of many small pieces the times of the latest are not all remembered: then a value counts as older.
            (a.parameter, bits(a)) == (b.parameter, bits(b)) && a.at.max(b.at) <= now
        };
        let (a, b) = (&self.heard, &self.heard_cut);
        let is_same = a.signals.len() == b.signals.len()
            && a.others == b.others
            && a.signals.iter().zip(&b.signals).all(|(a, b)| same(a, b));
        assert!(
            is_same,
            "whole: {:?}\ncut: {:?}\nof {}",
            a.signals,
            b.signals,
            shown(bytes)
        );
    }

    /// Holds every good value against what the independent reading has found.
    fn judge(&mut self, bytes: &[u8]) {
        for signal in &self.heard.signals {
            let Ok(value) = signal.value else {
                continue;
            };
            let parameter: Parameter = signal.parameter;
            assert!(
                parameter.check(value).is_ok(),
                "cannot be: {signal:?} of {}",
                shown(bytes)
            );
            if self.said.has(parameter, value) {
                self.tally.confirmed += 1;
            } else {
                assert!(
                    !self.known[parameter.index()] && !self.said.mentions(parameter),
                    "wrong good: {signal:?}\nread {:?}\nof {}",
                    self.said,
                    shown(bytes)
                );
                self.tally.unread += 1;
            }
        }
    }
}

fn shown(bytes: &[u8]) -> String {
    format!("{bytes:02X?} {}", String::from_utf8_lossy(bytes))
}

/// One push, which must not allocate and must count what it took.
fn push(decoder: &mut dyn Decoder, ns: u64, wire: Wire<'_>, heard: &mut Heard) {
    let frame = Frame {
        at: Monotonic::from_nanos(ns),
        source: SourceId(3),
        wire,
    };
    let is_whole = !matches!(wire, Wire::Stream(_));
    let before = (allocations_of_this_thread(), decoder.counters().total());
    decoder.push(frame, heard);
    let counters = decoder.counters();
    assert_eq!(allocations_of_this_thread(), before.0, "allocates");
    assert_eq!(
        counters.good + counters.bad_total() + counters.ignored,
        counters.total(),
        "counters add up"
    );
    if is_whole {
        assert_eq!(counters.total(), before.1 + 1, "each frame counted once");
    }
}
