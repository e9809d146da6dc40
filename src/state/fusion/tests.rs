//! Which source is believed, and what is said when none is.

use super::*;

const A: SourceId = SourceId(0);
const B: SourceId = SourceId(5);

fn ms(t: u64) -> Monotonic {
    Monotonic::from_nanos(t * 1_000_000)
}

fn say(
    fusion: &mut Fusion,
    source: SourceId,
    parameter: Parameter,
    value: Result<f64, Invalid>,
    t: u64,
) {
    fusion.apply(&Signal {
        at: ms(t),
        source,
        parameter,
        value,
    });
}

/// What is shown of a parameter, and whose it is.
fn shown(
    fusion: &mut Fusion,
    parameter: Parameter,
    t: u64,
) -> (Result<f64, Invalid>, Option<SourceId>) {
    let state = fusion.step(ms(t));
    (state.read(parameter, ms(t)), state.source(parameter))
}

#[test]
fn attitude_goes_invalid_when_frames_stop_and_comes_back_with_them() {
    let mut f = Fusion::new(&[A]);
    assert_eq!(
        shown(&mut f, Parameter::Pitch, 0),
        (Err(Invalid::NeverReceived), None)
    );
    for t in [1000, 1020, 1040] {
        say(&mut f, A, Parameter::Pitch, Ok(0.1), t);
    }
    assert_eq!(shown(&mut f, Parameter::Pitch, 1340), (Ok(0.1), Some(A)));
    assert_eq!(
        shown(&mut f, Parameter::Pitch, 1341),
        (Err(Invalid::Stale), Some(A))
    );
    say(&mut f, A, Parameter::Pitch, Ok(0.2), 5000);
    assert_eq!(shown(&mut f, Parameter::Pitch, 5000), (Ok(0.2), Some(A)));
}

#[test]
fn a_failure_shows_as_one_until_a_good_value_or_silence() {
    let mut f = Fusion::new(&[A]);
    say(&mut f, A, Parameter::Roll, Ok(0.1), 1000);
    say(&mut f, A, Parameter::Roll, Err(Invalid::SourceFailed), 1020);
    assert_eq!(
        shown(&mut f, Parameter::Roll, 1021),
        (Err(Invalid::SourceFailed), Some(A)),
        "the last good value is gone"
    );
    assert_eq!(
        shown(&mut f, Parameter::Roll, 1400).0,
        Err(Invalid::Stale),
        "then silence"
    );
    say(&mut f, A, Parameter::Roll, Ok(0.3), 1500);
    assert_eq!(shown(&mut f, Parameter::Roll, 1500).0, Ok(0.3));
}

#[test]
fn the_most_trusted_good_source_is_taken_and_taken_back() {
    let mut f = Fusion::new(&[B, A]);
    say(&mut f, A, Parameter::Pitch, Ok(0.1), 1000);
    assert_eq!(
        shown(&mut f, Parameter::Pitch, 1000),
        (Ok(0.1), Some(A)),
        "the only one"
    );
    say(&mut f, B, Parameter::Pitch, Ok(0.2), 1010);
    assert_eq!(
        shown(&mut f, Parameter::Pitch, 1010),
        (Ok(0.2), Some(B)),
        "trusted more"
    );
    say(&mut f, B, Parameter::Pitch, Err(Invalid::OutOfRange), 1020);
    assert_eq!(
        shown(&mut f, Parameter::Pitch, 1020),
        (Ok(0.1), Some(A)),
        "fail-over"
    );
    say(&mut f, B, Parameter::Pitch, Ok(0.21), 1030);
    assert_eq!(
        shown(&mut f, Parameter::Pitch, 1030),
        (Ok(0.21), Some(B)),
        "back again"
    );
    assert_eq!(
        shown(&mut f, Parameter::Pitch, 1331).0,
        Err(Invalid::Stale),
        "both silent"
    );
}

#[test]
fn with_no_good_source_the_most_telling_reason_stands() {
    let mut f = Fusion::new(&[A, B]);
    say(&mut f, A, Parameter::Pitch, Ok(0.1), 500);
    say(
        &mut f,
        B,
        Parameter::Pitch,
        Err(Invalid::SourceFailed),
        1000,
    );
    assert_eq!(
        shown(&mut f, Parameter::Pitch, 1000),
        (Err(Invalid::SourceFailed), Some(B))
    );
    assert_eq!(
        shown(&mut f, Parameter::Pitch, 2000),
        (Err(Invalid::Stale), Some(A)),
        "equals: the trusted"
    );
}

#[test]
fn a_position_is_never_put_together_from_two_sources() {
    let mut f = Fusion::new(&[A, B]);
    say(&mut f, A, Parameter::Latitude, Ok(0.5), 1000);
    say(&mut f, B, Parameter::Latitude, Ok(0.6), 1000);
    say(&mut f, B, Parameter::Longitude, Ok(0.7), 1000);
    for (p, x) in [(Parameter::Latitude, 0.6), (Parameter::Longitude, 0.7)] {
        assert_eq!(shown(&mut f, p, 1000), (Ok(x), Some(B)), "A has only half");
    }
    say(&mut f, A, Parameter::Longitude, Ok(0.8), 1010);
    for (p, x) in [(Parameter::Latitude, 0.5), (Parameter::Longitude, 0.8)] {
        assert_eq!(shown(&mut f, p, 1010), (Ok(x), Some(A)), "A has both");
    }
    say(
        &mut f,
        A,
        Parameter::Latitude,
        Err(Invalid::SourceFailed),
        1020,
    );
    for (p, x) in [(Parameter::Latitude, 0.6), (Parameter::Longitude, 0.7)] {
        assert_eq!(shown(&mut f, p, 1020), (Ok(x), Some(B)), "A has lost half");
    }
    // With neither whole, both halves still name the same source.
    let state = f.step(ms(2005));
    assert_eq!(
        state.source(Parameter::Latitude),
        state.source(Parameter::Longitude)
    );
}

#[test]
fn old_news_and_strangers_change_nothing() {
    let mut f = Fusion::new(&[A, A]);
    say(&mut f, A, Parameter::Pitch, Ok(0.1), 1000);
    say(&mut f, A, Parameter::Pitch, Ok(0.9), 999);
    say(&mut f, B, Parameter::Pitch, Ok(0.9), 1001);
    say(&mut f, SourceId(200), Parameter::Pitch, Ok(0.9), 1001);
    assert_eq!(shown(&mut f, Parameter::Pitch, 1001), (Ok(0.1), Some(A)));
    assert_eq!(f.unknown_sources(), 2);
}

#[test]
fn a_value_from_the_future_is_not_shown() {
    let mut f = Fusion::new(&[A, B]);
    say(&mut f, A, Parameter::Pitch, Ok(0.1), 2000);
    say(&mut f, B, Parameter::Pitch, Ok(0.2), 1000);
    assert_eq!(shown(&mut f, Parameter::Pitch, 1000), (Ok(0.2), Some(B)));
}
