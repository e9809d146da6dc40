use super::*;
use crate::bench::encode::encoder;
use crate::proto::Protocol;

fn level() -> Truth {
    let mut truth = Truth::nothing();
    truth.set(Parameter::Pitch, Ok(0.1));
    truth.set(Parameter::IndicatedAirspeed, Ok(50.0));
    truth
}

/// All frames of the first `seconds`, as they come out.
fn frames(protocol: Protocol, faults: &[&str], seconds: u64) -> Vec<(Duration, Vec<u8>)> {
    let faults = faults.iter().map(|f| Fault::parse(f).unwrap()).collect();
    let mut bench = Bench::new(encoder(protocol), faults, 7).unwrap();
    let mut all = Vec::new();
    while bench.next() < Duration::from_secs(seconds) {
        let now = bench.next();
        bench.step(&level(), &mut |wire| {
            all.push((now, Piece::of(wire).bytes().to_vec()));
        });
    }
    all
}

#[test]
fn messages_come_at_their_rates() {
    // Pitch 20 times a second, airspeed 10 times, the status of four nodes once.
    assert_eq!(frames(Protocol::CanFix, &[], 2).len(), 2 * (20 + 10 + 4));
    assert_eq!(
        frames(Protocol::DynonD100, &[], 1).len(),
        0,
        "lines lack values"
    );
}

#[test]
fn the_same_seed_gives_the_same_frames() {
    let faults = ["noise@0:pitch", "bit-flips@0.2"];
    let once = frames(Protocol::Gdl90, &faults, 1);
    assert_eq!(once, frames(Protocol::Gdl90, &faults, 1));
    assert_ne!(once, frames(Protocol::Gdl90, &[], 1));
}

#[test]
fn a_stop_is_silence_between_its_times() {
    let all = frames(Protocol::CanFix, &["stop@0.5-1"], 2);
    let silent = Duration::from_millis(500)..Duration::from_secs(1);
    assert!(!all.iter().any(|(t, _)| silent.contains(t)), "silent");
    assert!(all.iter().any(|(t, _)| *t >= silent.end), "and back");
}

#[test]
fn duplicates_double_and_reordering_swaps() {
    let plain = frames(Protocol::CanAerospace, &[], 1);
    let twice = frames(Protocol::CanAerospace, &["duplicates@0"], 1);
    assert_eq!(twice.len(), 2 * plain.len());
    let pitch_codes = |all: &[(Duration, Vec<u8>)]| -> Vec<u8> {
        let of_pitch = all.iter().filter(|(_, b)| b[0] == 1);
        of_pitch.map(|(_, b)| b[3]).take(6).collect()
    };
    assert_eq!(pitch_codes(&plain), [0, 1, 2, 3, 4, 5]);
    let swapped = frames(Protocol::CanAerospace, &["reordering@0"], 1);
    assert_eq!(pitch_codes(&swapped), [1, 0, 3, 2, 5, 4]);
}

#[test]
fn a_babbling_sender_fills_the_bus() {
    let all = frames(Protocol::CanFix, &["babble@0-1"], 2);
    let plain = frames(Protocol::CanFix, &[], 2);
    let babble = all.len() - plain.len();
    // 1 Mbit/s in frames of 111 bits.
    assert!((9000..=9010).contains(&babble), "{babble} frames");
    let bytes = |all: &[(Duration, Vec<u8>)]| all.iter().map(|(_, b)| b.len()).sum::<usize>();
    let line = frames(Protocol::Nmea, &["babble@0-1"], 1);
    let spare = bytes(&line) - bytes(&frames(Protocol::Nmea, &[], 1));
    assert!(
        (11_500..=11_520).contains(&spare),
        "{spare} bytes at 115200"
    );
}

#[test]
fn another_node_speaks_and_a_lost_bus_is_silent() {
    let all = frames(Protocol::CanFix, &["wrong-node@0"], 1);
    assert!(
        all.iter().all(|(_, b)| b[0] >= 0x40 || b[0] == 6),
        "nodes 65 to 68"
    );
    let all = frames(Protocol::CanFix, &["bus-off@0", "babble@0"], 1);
    assert!(all.is_empty(), "nothing is sent off the bus");
}

#[test]
fn a_jump_stays_within_the_range() {
    for (parameter, from) in [
        (Parameter::HeadingTrue, 6.2),
        (Parameter::Pitch, 1.5),
        (Parameter::IndicatedAirspeed, 390.0),
    ] {
        let there = moved(parameter, from, jump_of(parameter));
        assert!(parameter.check(there).is_ok(), "{parameter:?} {there}");
        assert!((there - from).abs() > 0.01, "{parameter:?} {there}");
    }
}
