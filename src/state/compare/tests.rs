//! What disagrees, by how much, for how long: through the whole of fusion.

use super::*;
use crate::signal::Signal;
use crate::state::Fusion;

const A: SourceId = SourceId(0);
const B: SourceId = SourceId(1);
const STEP_MS: u64 = 20;

/// Two sources that speak every 20 ms, and what the state says then.
struct Bench {
    fusion: Fusion,
    t_ms: u64,
}

impl Bench {
    fn new() -> Self {
        Self {
            fusion: Fusion::new(&[A, B]),
            t_ms: 1000,
        }
    }

    fn now(&self) -> Monotonic {
        Monotonic::from_nanos(self.t_ms * 1_000_000)
    }

    /// Both speak for `ms`; the state at the end.
    fn fly(&mut self, a: &[(P, f64)], b: &[(P, f64)], ms: u64) -> FlightState {
        let mut state = FlightState::empty();
        for _ in 0..ms / STEP_MS {
            self.t_ms += STEP_MS;
            for (source, values) in [(A, a), (B, b)] {
                for &(parameter, value) in values {
                    self.fusion.apply(&Signal {
                        at: self.now(),
                        source,
                        parameter,
                        value: parameter.check(value),
                    });
                }
            }
            state = self.fusion.step(self.now());
        }
        state
    }
}

fn degrees(x: f64) -> f64 {
    x.to_radians()
}

fn knots(x: f64) -> f64 {
    MetresPerSecond::from(Knots(x)).0
}

fn feet(x: f64) -> f64 {
    Metres::from(Feet(x)).0
}

/// Each quantity: parameter, a value, another just within its limit and one just beyond.
fn limits() -> [(Compared, P, f64, f64, f64); 7] {
    use Compared::{Airspeed, Altitude, Heading, Pitch, Roll};
    [
        (Pitch, P::Pitch, degrees(-2.0), degrees(2.9), degrees(3.1)),
        (
            Roll,
            P::Roll,
            degrees(-178.0),
            degrees(176.1),
            degrees(175.9),
        ),
        // Without any roll the wider limit applies.
        (
            Heading,
            P::HeadingTrue,
            degrees(355.0),
            degrees(14.9),
            degrees(15.1),
        ),
        (
            Heading,
            P::HeadingMagnetic,
            degrees(5.0),
            degrees(345.1),
            degrees(344.9),
        ),
        (
            Altitude,
            P::PressureAltitude,
            feet(5000.0),
            feet(5199.0),
            feet(5201.0),
        ),
        (
            Airspeed,
            P::IndicatedAirspeed,
            knots(70.0),
            knots(60.1),
            knots(59.9),
        ),
        (
            Airspeed,
            P::CalibratedAirspeed,
            knots(90.0),
            knots(83.1),
            knots(82.9),
        ),
    ]
}

#[test]
fn each_quantity_is_flagged_beyond_its_limit_after_its_time_and_stays_shown() {
    for (compared, p, own, within, beyond) in limits() {
        let mut bench = Bench::new();
        let state = bench.fly(&[(p, own)], &[(p, within)], 10_000);
        assert!(!state.miscompares(compared), "{compared:?} {p:?} within");
        let lasting = u64::try_from(lasting(compared).as_millis()).unwrap_or(0);
        let state = bench.fly(&[(p, own)], &[(p, beyond)], lasting);
        assert!(!state.miscompares(compared), "{compared:?} {p:?} too short");
        let state = bench.fly(&[(p, own)], &[(p, beyond)], STEP_MS);
        assert!(state.miscompares(compared), "{compared:?} {p:?} beyond");
        assert_eq!(state.read(p, bench.now()), Ok(own), "stays shown: {p:?}");
        let others = Compared::ALL.iter().filter(|c| state.miscompares(**c));
        assert_eq!(others.count(), 1, "{compared:?} alone");
        let state = bench.fly(&[(p, own)], &[(p, within)], 10_000);
        assert!(state.miscompares(compared), "{compared:?} {p:?} hysteresis");
        let state = bench.fly(&[(p, own)], &[(p, own)], lasting + STEP_MS);
        assert!(!state.miscompares(compared), "{compared:?} {p:?} gone");
    }
}

#[test]
fn headings_are_held_closer_when_the_wings_are_level() {
    let mut bench = Bench::new();
    let level = [(P::Roll, degrees(5.0)), (P::HeadingTrue, degrees(90.0))];
    let other = [(P::HeadingTrue, degrees(97.0))];
    assert!(
        bench
            .fly(&level, &other, 3000)
            .miscompares(Compared::Heading),
        "7 degrees"
    );
    let mut bench = Bench::new();
    let banked = [(P::Roll, degrees(20.0)), (P::HeadingTrue, degrees(90.0))];
    assert!(
        !bench
            .fly(&banked, &other, 3000)
            .miscompares(Compared::Heading),
        "in a turn"
    );
}

#[test]
fn airspeeds_are_not_compared_until_one_is_above_35_knots() {
    let p = P::IndicatedAirspeed;
    let state = Bench::new().fly(&[(p, 0.0)], &[(p, knots(34.9))], 9000);
    assert!(!state.miscompares(Compared::Airspeed), "34.9 kt");
    let state = Bench::new().fly(&[(p, 0.0)], &[(p, knots(35.1))], 9000);
    assert!(state.miscompares(Compared::Airspeed), "35.1 kt");
}

#[test]
fn only_like_is_compared_with_like() {
    for (a, b) in [
        (P::HeadingTrue, P::HeadingMagnetic),
        (P::IndicatedAirspeed, P::CalibratedAirspeed),
        (P::PressureAltitude, P::AltitudeMsl),
    ] {
        let state = Bench::new().fly(&[(a, 1.0)], &[(b, 300.0_f64.min(b.spec().max))], 9000);
        assert!(
            !Compared::ALL.iter().any(|c| state.miscompares(*c)),
            "{a:?} {b:?}"
        );
    }
}

#[test]
fn altimeters_with_different_settings_agree_on_the_pressure() {
    // 954.61 hPa stands at 500 m (U.S. Standard Atmosphere 1976, table I): set to it, an altimeter shows 500 m less.
    let a = [(P::PressureAltitude, 1500.0)];
    let b = [(P::BaroAltitude, 1000.0), (P::BaroSetting, 954.61)];
    let state = Bench::new().fly(&a, &b, 9000);
    assert!(!state.miscompares(Compared::Altitude), "the same pressure");
    let wrong = [(P::BaroAltitude, 1500.0), (P::BaroSetting, 954.61)];
    let state = Bench::new().fly(&a, &wrong, 9000);
    assert!(state.miscompares(Compared::Altitude), "500 m apart");
    let unset = [(P::BaroAltitude, 1500.0)];
    let state = Bench::new().fly(&a, &unset, 9000);
    assert!(
        !state.miscompares(Compared::Altitude),
        "no setting, nothing to compare"
    );
}

#[test]
fn old_and_failed_values_are_not_compared() {
    let mut bench = Bench::new();
    let (a, b) = ([(P::Pitch, 0.0)], [(P::Pitch, 0.5)]);
    assert!(
        bench.fly(&a, &b, 2000).miscompares(Compared::Pitch),
        "raised"
    );
    let state = bench.fly(&a, &[], 400);
    assert!(!state.miscompares(Compared::Pitch), "the other fell silent");
    assert!(
        bench.fly(&a, &b, 2000).miscompares(Compared::Pitch),
        "raised again"
    );
    let state = bench.fly(&a, &[(P::Pitch, f64::NAN)], 100);
    assert!(!state.miscompares(Compared::Pitch), "the other failed");
}

#[test]
fn a_source_that_lags_in_a_fast_roll_does_not_disagree() {
    // 90 degrees a second for one second, the other source 200 ms later: 18 degrees apart for less than a second.
    let mut bench = Bench::new();
    let roll = |t: f64| degrees((90.0 * t).clamp(0.0, 60.0));
    for k in 0..200 {
        let t = f64::from(k) * 0.02;
        let state = bench.fly(&[(P::Roll, roll(t))], &[(P::Roll, roll(t - 0.2))], STEP_MS);
        assert!(!state.miscompares(Compared::Roll), "{t} s");
    }
}

#[test]
fn what_falls_back_says_from_where() {
    let mut bench = Bench::new();
    let both = [(P::Pitch, 0.1)];
    let state = bench.fly(&both, &both, 100);
    assert_eq!(
        state.fallback(P::Pitch, bench.now()),
        None,
        "the trusted one"
    );
    let state = bench.fly(&[], &both, 400);
    assert_eq!(
        state.fallback(P::Pitch, bench.now()),
        Some(B),
        "A is silent"
    );
    let state = bench.fly(&[], &[], 400);
    assert_eq!(
        state.fallback(P::Pitch, bench.now()),
        None,
        "nothing is shown"
    );
    let mut bench = Bench::new();
    let state = bench.fly(&[], &both, 400);
    assert_eq!(
        state.fallback(P::Pitch, bench.now()),
        None,
        "A never spoke of pitch"
    );
}
