//! What is called frozen, after how long, and what never is: through the whole of fusion.

use super::*;
use crate::sampled::Invalid;
use crate::signal::{Signal, SourceId};
use crate::state::{FlightState, Fusion};

const A: SourceId = SourceId(0);
const GPS: SourceId = SourceId(1);

/// A sensor source and a GPS whose ground speed says whether the aircraft flies.
struct Bench {
    fusion: Fusion,
    t_ms: u64,
    random: u64,
}

impl Bench {
    fn new() -> Self {
        Self {
            fusion: Fusion::new(&[A, GPS]),
            t_ms: 1000,
            random: 1,
        }
    }

    fn now(&self) -> Monotonic {
        Monotonic::from_nanos(self.t_ms * 1_000_000)
    }

    /// Even noise from -1 to 1 (Knuth's MMIX generator).
    fn noise(&mut self) -> f64 {
        self.random = self
            .random
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        f64::from(u32::try_from(self.random >> 32).unwrap_or(0)) / f64::from(u32::MAX) * 2.0 - 1.0
    }

    fn say(&mut self, source: SourceId, parameter: P, value: f64) {
        self.fusion.apply(&Signal {
            at: self.now(),
            source,
            parameter,
            value: parameter.check(value),
        });
    }

    /// 100 ms at a time for `seconds`: `speak` says what the source says then. The state at the end.
    fn fly(
        &mut self,
        seconds: u64,
        speed_mps: f64,
        mut speak: impl FnMut(&mut Self, f64),
    ) -> FlightState {
        let mut state = FlightState::empty();
        for _ in 0..seconds * 10 {
            self.t_ms += 100;
            self.say(GPS, P::GroundSpeed, speed_mps);
            #[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
            let t = self.t_ms as f64 / 1000.0;
            speak(self, t);
            state = self.fusion.step(self.now());
        }
        state
    }
}

/// Whole steps of `step`.
fn quantised(x: f64, step: f64) -> f64 {
    (x / step).round() * step
}

fn tenth_of_a_degree() -> f64 {
    0.1_f64.to_radians()
}

/// An attitude source as a real one: noise of a few tenths of a degree, in tenths of a degree.
fn noisy(bench: &mut Bench, t: f64) {
    for (p, slow) in [(P::Pitch, 0.02), (P::Roll, 0.1 * (0.2 * t).sin())] {
        let value = slow + 0.005 * bench.noise();
        bench.say(A, p, quantised(value, tenth_of_a_degree()));
    }
    let heading = 1.0 + 0.01 * t;
    bench.say(A, P::HeadingTrue, quantised(heading, 1_f64.to_radians()));
}

#[test]
fn a_source_that_repeats_itself_in_flight_is_frozen_after_three_seconds() {
    let mut bench = Bench::new();
    bench.fly(20, 50.0, noisy);
    let repeat = |bench: &mut Bench, _: f64| {
        for (p, value) in [(P::Pitch, 0.03), (P::Roll, 0.1), (P::HeadingTrue, 1.2)] {
            bench.say(A, p, value);
        }
    };
    let state = bench.fly(2, 50.0, repeat);
    assert_eq!(
        state.read(P::Roll, bench.now()),
        Ok(0.1),
        "1.9 s of repeats"
    );
    let state = bench.fly(1, 50.0, repeat);
    let roll = state.read(P::Roll, bench.now());
    assert_eq!(roll, Err(Invalid::Frozen), "pitch and roll together");
    assert_eq!(state.read(P::HeadingTrue, bench.now()), Ok(1.2), "2.9 s");
    let state = bench.fly(1, 50.0, repeat);
    for p in [P::Pitch, P::Roll, P::HeadingTrue] {
        assert_eq!(state.read(p, bench.now()), Err(Invalid::Frozen), "{p:?}");
    }
    // And back, with the first new values.
    bench.t_ms += 100;
    noisy(&mut bench, 0.0);
    let state = bench.fusion.step(bench.now());
    assert!(state.read(P::Roll, bench.now()).is_ok(), "it moves again");
}

#[test]
fn a_receiver_that_repeats_its_position_while_it_says_that_it_flies_is_frozen() {
    let mut bench = Bench::new();
    // Once a second, as receivers do.
    let state = bench.fly(6, 60.0, |bench, t| {
        if t.fract() < 0.05 {
            bench.say(A, P::Latitude, 0.87);
            bench.say(A, P::Longitude, 0.25);
            bench.say(A, P::AltitudeMsl, 900.0);
        }
    });
    assert_eq!(state.read(P::Latitude, bench.now()), Err(Invalid::Frozen));
}

#[test]
fn a_noisy_parameter_that_stops_alone_is_frozen_after_four_seconds() {
    for stopped in [P::Pitch, P::Roll] {
        let mut bench = Bench::new();
        bench.fly(25, 50.0, noisy);
        let other = if stopped == P::Pitch {
            P::Roll
        } else {
            P::Pitch
        };
        let stuck = |bench: &mut Bench, _: f64| {
            let moving = quantised(0.005 * bench.noise(), tenth_of_a_degree());
            bench.say(A, other, moving);
            bench.say(A, stopped, 0.05);
        };
        let state = bench.fly(4, 50.0, stuck);
        assert_eq!(
            state.read(stopped, bench.now()),
            Ok(0.05),
            "{stopped:?} at 3.9 s"
        );
        let state = bench.fly(1, 50.0, stuck);
        assert_eq!(
            state.read(stopped, bench.now()),
            Err(Invalid::Frozen),
            "{stopped:?}"
        );
        assert!(state.read(other, bench.now()).is_ok(), "{other:?} moves");
    }
}

#[test]
fn a_value_that_never_repeated_is_frozen_after_two_seconds() {
    // Floating point without noise, as a simulator sends it: a slow climb of the nose, then nothing.
    let mut bench = Bench::new();
    let moving = |t: f64| 0.05 * (0.3 * t).sin();
    bench.fly(11, 50.0, |bench, t| {
        bench.say(A, P::Pitch, moving(t));
        bench.say(A, P::Roll, moving(t + 1.0));
    });
    let stuck = |bench: &mut Bench, t: f64| {
        bench.say(A, P::Pitch, 0.04);
        bench.say(A, P::Roll, moving(t));
    };
    let state = bench.fly(2, 50.0, stuck);
    assert_eq!(state.read(P::Pitch, bench.now()), Ok(0.04), "1.9 s");
    let state = bench.fly(1, 50.0, stuck);
    assert_eq!(state.read(P::Pitch, bench.now()), Err(Invalid::Frozen));
}

#[test]
fn nothing_is_frozen_on_the_ground() {
    let mut bench = Bench::new();
    bench.fly(25, 50.0, noisy);
    // Parked, engine off; a simulator at rest; a gust on the pitot tube.
    let state = bench.fly(600, 0.2, |bench, _| {
        for (p, value) in [
            (P::Pitch, 0.03),
            (P::Roll, 0.0),
            (P::HeadingTrue, 1.5),
            (P::IndicatedAirspeed, 16.0),
            (P::Latitude, 0.87),
            (P::Longitude, 0.25),
        ] {
            bench.say(A, p, value);
        }
    });
    assert_eq!(state.read(P::Pitch, bench.now()), Ok(0.03));
    // The take-off roll: the time at rest does not count.
    let state = bench.fly(2, 20.0, |bench, _| {
        bench.say(A, P::Pitch, 0.03);
        bench.say(A, P::Roll, 0.0);
    });
    assert_eq!(state.read(P::Pitch, bench.now()), Ok(0.03));
}

#[test]
fn smooth_flight_in_whole_degrees_is_not_frozen() {
    // Heading in whole degrees, pitch and roll too, airspeed in whole knots: held for a minute at a time by an autopilot.
    let mut bench = Bench::new();
    for minute in 0..5 {
        let step = f64::from(minute % 2).to_radians();
        let state = bench.fly(60, 50.0, |bench, t| {
            bench.say(A, P::Pitch, 2_f64.to_radians() + step);
            bench.say(A, P::Roll, -step);
            bench.say(A, P::HeadingTrue, 1.5);
            bench.say(A, P::IndicatedAirspeed, 52.0 + f64::from(minute % 2));
            // Something of the source moves, so it is alive.
            bench.say(A, P::PressureAltitude, 1000.0 + quantised(0.5 * t, 1.0));
        });
        for p in [P::Pitch, P::Roll, P::HeadingTrue, P::IndicatedAirspeed] {
            assert!(
                state.read(p, bench.now()).is_ok(),
                "{p:?} in minute {minute}"
            );
        }
    }
}

#[test]
fn attitude_alone_in_whole_degrees_is_not_frozen() {
    let mut bench = Bench::new();
    for minute in 0..5 {
        let step = f64::from(minute % 2).to_radians();
        let state = bench.fly(60, 50.0, |bench, _| {
            bench.say(A, P::Pitch, step);
            bench.say(A, P::Roll, -step);
        });
        assert_eq!(
            state.read(P::Pitch, bench.now()),
            Ok(step),
            "minute {minute}"
        );
    }
}

#[test]
fn settings_and_engines_may_stand_for_hours() {
    let mut bench = Bench::new();
    let state = bench.fly(600, 50.0, |bench, _| {
        bench.say(A, P::BaroSetting, 1013.0);
        bench.say(A, P::EngineSpeed, 2400.0);
        bench.say(A, P::StaticAirTemperature, 280.0);
        bench.say(A, P::PressureAltitude, 1000.0);
    });
    for p in [
        P::BaroSetting,
        P::EngineSpeed,
        P::StaticAirTemperature,
        P::PressureAltitude,
    ] {
        assert!(state.read(p, bench.now()).is_ok(), "{p:?}");
    }
}

#[test]
fn silence_is_stale_not_frozen() {
    let mut bench = Bench::new();
    bench.fly(25, 50.0, noisy);
    let state = bench.fly(20, 50.0, |_, _| {});
    assert_eq!(state.read(P::Pitch, bench.now()), Err(Invalid::Stale));
}

#[test]
fn another_source_is_taken_instead_of_a_frozen_one() {
    let mut bench = Bench::new();
    bench.fly(20, 50.0, noisy);
    let state = bench.fly(5, 50.0, |bench, t| {
        bench.say(A, P::Pitch, 0.03);
        bench.say(A, P::Roll, 0.0);
        bench.say(GPS, P::Pitch, 0.02 + 0.01 * (3.0 * t).sin());
    });
    assert_eq!(state.fallback(P::Pitch, bench.now()), Some(GPS));
    assert_eq!(state.read(P::Roll, bench.now()), Err(Invalid::Frozen));
}

#[test]
fn a_source_that_is_alive_all_over_is_found_after_one_second() {
    let mut bench = Bench::new();
    let mut alive = |bench: &mut Bench, t: f64| {
        noisy(bench, t);
        for (p, slow, step) in [
            (P::IndicatedAirspeed, 50.0, 0.05),
            (P::LateralAcceleration, 0.0, 0.01),
        ] {
            let value = slow + 4.0 * step * bench.noise();
            bench.say(A, p, quantised(value, step));
        }
    };
    bench.fly(25, 50.0, &mut alive);
    let repeat = |bench: &mut Bench, _: f64| {
        for (p, value) in [
            (P::Pitch, 0.03),
            (P::Roll, 0.1),
            (P::HeadingTrue, 1.5),
            (P::IndicatedAirspeed, 51.0),
            (P::LateralAcceleration, 0.02),
        ] {
            bench.say(A, p, value);
        }
    };
    let state = bench.fly(1, 50.0, repeat);
    assert_eq!(
        state.read(P::Roll, bench.now()),
        Ok(0.1),
        "0.9 s of repeats"
    );
    bench.t_ms += 100;
    repeat(&mut bench, 0.0);
    let state = bench.fusion.step(bench.now());
    for p in [P::Pitch, P::Roll, P::HeadingTrue, P::IndicatedAirspeed] {
        assert_eq!(state.read(p, bench.now()), Err(Invalid::Frozen), "{p:?}");
    }
}

#[test]
fn a_receiver_whose_clock_stands_is_frozen_even_on_the_ground() {
    let mut bench = Bench::new();
    let speak = |bench: &mut Bench, t: f64| {
        bench.say(A, P::UtcTimeOfDay, t.floor());
        let latitude = 0.87 + 1e-8 * bench.noise();
        bench.say(A, P::Latitude, latitude);
        bench.say(A, P::Longitude, 0.25);
        bench.say(A, P::SatellitesUsed, 9.0);
    };
    let state = bench.fly(20, 0.0, speak);
    assert!(
        state.read(P::Latitude, bench.now()).is_ok(),
        "its clock ticks"
    );
    let stuck = |bench: &mut Bench, _: f64| speak(bench, 1_000.0);
    let state = bench.fly(3, 0.0, stuck);
    assert!(state.read(P::Latitude, bench.now()).is_ok(), "2.9 s");
    let state = bench.fly(1, 0.0, stuck);
    assert_eq!(state.read(P::Latitude, bench.now()), Err(Invalid::Frozen));
    // A clock that never ticked is none.
    let mut bench = Bench::new();
    let state = bench.fly(20, 0.0, stuck);
    assert!(
        state.read(P::Latitude, bench.now()).is_ok(),
        "midnight for ever"
    );
}
