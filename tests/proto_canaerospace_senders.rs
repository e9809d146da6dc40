//! CANaerospace's message codes, redundant nodes and redundancy channels: who is listened to, and when that one is stuck.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

mod canaerospace_support;

use canaerospace_support::{Bench, assert_near, can, float};
use glasswing::proto::Decoder;
use glasswing::sampled::Invalid;
use glasswing::signal::Parameter;

#[test]
fn message_codes_tell_lost_repeated_and_frozen_frames() {
    let mut bench = Bench::default();
    for (code, x) in [
        (254, 1.0),
        (255, 2.0),
        (0, 3.0),
        (3, 4.0),
        (3, 5.0),
        (3, 5.0),
        (4, 6.0),
    ] {
        bench.push(float(311, code, x));
    }
    let flow = bench.decoder.counters().flow;
    assert_eq!((flow.lost, flow.repeated, flow.frozen), (2, 2, 1));
    // Another identifier counts by itself; a restart is not 200 lost frames.
    bench.push(float(312, 90, 1.0));
    bench.push(float(311, 100, 7.0));
    bench.push(float(311, 0, 7.0));
    let flow = bench.decoder.counters().flow;
    assert_eq!((flow.lost, flow.repeated), (97, 2), "95 between 4 and 100");
    assert_eq!(bench.decoder.counters().good, 10, "notes, not verdicts");
}

#[test]
fn a_frame_that_comes_late_does_not_undo_a_newer_one() {
    let mut bench = Bench::default();
    bench.push(float(311, 254, 1.0));
    bench.push(float(311, 1, 2.0));
    for code in [0, 255, 254] {
        assert!(bench.push(float(311, code, 3.0)).is_empty(), "{code}");
    }
    let counters = bench.decoder.counters();
    assert_eq!((counters.flow.late, counters.ignored), (3, 3));
    assert_eq!(bench.push(float(311, 2, 4.0)).len(), 1, "the next");
    bench.now_ms += 301;
    assert_eq!(
        bench.push(float(311, 0, 5.0)).len(),
        1,
        "after a silence it is a restart"
    );
}

#[test]
fn a_redundancy_channel_is_another_sender_of_the_same_identifier() {
    let on = |channel: u32, x| {
        let mut frame = float(311, 0, x);
        (frame.extended, frame.id) = (true, channel << 16 | 311);
        frame
    };
    let mut bench = Bench::default();
    assert_eq!(bench.push(float(311, 0, 1.0)).len(), 1, "channel 0");
    assert_eq!(bench.push(on(0, 2.0)).len(), 1, "channel 0 in 29 bits");
    assert_eq!(bench.push(on(1, 3.0)).len(), 0, "channel 0 is alive");
    bench.now_ms = 301;
    assert_near(
        bench.one(on(255, 4.0)),
        Parameter::Pitch,
        4_f64.to_radians(),
    );
    bench.now_ms = 302;
    for id in [1 << 11, 1 << 15, 1 << 24, 1 << 28] {
        let mut foreign = on(255, 5.0);
        foreign.id |= id;
        assert!(bench.push(foreign).is_empty(), "{:#X}", foreign.id);
    }
    assert_eq!(bench.decoder.counters().ignored, 5);
}

#[test]
fn a_sequence_that_stands_still_is_frozen_after_the_parameters_greatest_age() {
    let mut bench = Bench::default();
    let at = |bench: &mut Bench, ms, code| {
        bench.now_ms = ms;
        bench.one(float(311, code, 1.0)).1
    };
    for (ms, code) in [(1000, 7), (1020, 8), (1320, 8)] {
        assert!(at(&mut bench, ms, code).is_ok(), "{ms} ms");
    }
    assert_eq!(at(&mut bench, 1321, 8), Err(Invalid::Frozen));
    let mut other = float(311, 40, 2.0);
    other.data[0] = 9;
    bench.now_ms = 1330;
    assert!(bench.one(other).1.is_ok(), "another node takes over");
    // A sender that never counts is no worse for it.
    let mut bench = Bench::default();
    for ms in (1000..9000).step_by(20) {
        assert!(at(&mut bench, ms, 0).is_ok(), "{ms} ms");
    }
}

#[test]
fn a_redundant_node_takes_over_when_the_first_fails_or_falls_silent() {
    let from = |node: u8, x| {
        let mut frame = float(311, 0, x);
        frame.data[0] = node;
        frame
    };
    let mut bench = Bench::default();
    assert_eq!(bench.push(from(1, 1.0)).len(), 1);
    bench.now_ms = 300;
    assert_eq!(bench.push(from(2, 2.0)).len(), 0, "the first is alive");
    bench.now_ms = 301;
    assert_eq!(bench.push(from(2, 2.0)).len(), 1, "the first is silent");
    assert_eq!(bench.push(from(1, 1.0)).len(), 0, "and stays second");
    let failed = can(311, &[2, 0, 0, 0]);
    assert_eq!(bench.one(failed).1, Err(Invalid::SourceFailed));
    assert_eq!(bench.push(from(1, 1.0)).len(), 1, "the second has failed");
    assert_eq!(bench.push(failed).len(), 0, "its failure is old news");
    assert_eq!(bench.one(from(1, f32::NAN)).1, Err(Invalid::OutOfRange));
    assert_eq!(
        bench.push(from(2, 2.0)).len(),
        1,
        "nonsense is a failure too"
    );
}
