//! Which calm values are found to stand still, how soon, and which never are: through the whole of fusion.

use super::*;
use crate::angle::wrap_turn;
use crate::sampled::Invalid;
use crate::signal::Signal;
use crate::state::Fusion;

const A: SourceId = SourceId(0);
const B: SourceId = SourceId(1);

/// A flight whose sensors are all well, except that one of A's stands still.
struct Bench {
    fusion: Fusion,
    t_ms: u64,
    heading: f64,
    altitude: f64,
    stuck: Option<(P, f64)>,
}

/// Degrees a second, m/s up, m/s.
#[derive(Clone, Copy)]
struct Flight {
    turn: f64,
    climb: f64,
    speed: f64,
}

impl Bench {
    fn new() -> Self {
        Self {
            fusion: Fusion::new(&[A, B]),
            t_ms: 1000,
            heading: 350.0,
            altitude: 1000.0,
            stuck: None,
        }
    }

    fn say(&mut self, source: SourceId, parameter: P, value: f64) {
        let value = match self.stuck {
            Some((p, stuck)) if source == A && p == parameter => stuck,
            _ => value,
        };
        self.fusion.apply(&Signal {
            at: Monotonic::from_nanos(self.t_ms * 1_000_000),
            source,
            parameter,
            value: parameter.check(value),
        });
    }

    /// Ten values a second in coarse steps; the time in seconds after which `parameter` is frozen.
    fn fly(&mut self, seconds: u64, flight: Flight, parameter: P) -> Option<f64> {
        for k in 1..=seconds * 10 {
            self.t_ms += 100;
            self.heading += flight.turn * 0.1;
            self.altitude += flight.climb * 0.1;
            let whole = |x: f64| x.round();
            let direction = |degrees: f64| wrap_turn(Radians::from_degrees(degrees.round())).0;
            self.say(A, P::HeadingTrue, direction(self.heading));
            self.say(A, P::PressureAltitude, whole(self.altitude / 7.62) * 7.62);
            self.say(A, P::VerticalSpeed, whole(flight.climb * 3.0) / 3.0);
            self.say(A, P::IndicatedAirspeed, whole(flight.speed * 0.9));
            self.say(B, P::Track, direction(self.heading + 12.0));
            self.say(B, P::AltitudeMsl, whole(self.altitude + 140.0));
            self.say(B, P::GroundSpeed, whole(flight.speed));
            let now = Monotonic::from_nanos(self.t_ms * 1_000_000);
            let state = self.fusion.step(now);
            // Vertical speed is worked out instead, from the altitude.
            let taken = state.is_derived(parameter);
            if taken || state.read(parameter, now) == Err(Invalid::Frozen) {
                #[expect(clippy::cast_precision_loss, reason = "a few hundred")]
                return Some(k as f64 / 10.0);
            }
        }
        None
    }

    fn stick(&mut self, parameter: P, value: f64) {
        self.stuck = Some((parameter, value));
    }
}

const LEVEL: Flight = Flight {
    turn: 0.0,
    climb: 0.0,
    speed: 50.0,
};

#[test]
fn a_heading_that_stands_still_is_found_in_a_turn_to_either_side_and_not_before() {
    for turn in [3.0, -3.0, 1.0] {
        let mut bench = Bench::new();
        bench.fly(5, LEVEL, P::HeadingTrue);
        bench.stick(P::HeadingTrue, 350_f64.to_radians());
        assert_eq!(
            bench.fly(120, LEVEL, P::HeadingTrue),
            None,
            "straight flight proves nothing"
        );
        let turning = Flight { turn, ..LEVEL };
        let found = bench.fly(60, turning, P::HeadingTrue);
        let found = found.unwrap_or_else(|| unreachable!("{turn} degrees a second"));
        // Twenty degrees; the window may have begun anew on the way at most once.
        let soonest = 20.0 / turn.abs();
        assert!(
            found >= soonest - 0.7 && found <= soonest * 2.0 + 1.0,
            "{turn}: {found} s"
        );
        bench.stuck = None;
        assert_eq!(
            bench.fly(20, turning, P::HeadingTrue),
            None,
            "it moves again"
        );
    }
}

#[test]
fn a_height_that_stands_still_is_found_in_a_climb() {
    for parameter in [P::PressureAltitude, P::VerticalSpeed] {
        let mut bench = Bench::new();
        bench.fly(5, LEVEL, parameter);
        bench.stick(
            parameter,
            if parameter == P::VerticalSpeed {
                0.0
            } else {
                1000.0
            },
        );
        let climbing = Flight {
            climb: 2.5,
            ..LEVEL
        };
        let found = bench.fly(60, climbing, parameter);
        assert!(
            // Twelve seconds make 30 m of climb, eight 20 m of drift; a window may have begun before.
            found.is_some_and(|s| (5.0..=28.0).contains(&s)),
            "{parameter:?}: {found:?}"
        );
    }
}

#[test]
fn smooth_flight_in_coarse_steps_is_never_found_to_stand_still() {
    for parameter in [
        P::HeadingTrue,
        P::PressureAltitude,
        P::VerticalSpeed,
        P::Track,
        P::GroundSpeed,
    ] {
        let mut bench = Bench::new();
        for flight in [
            LEVEL,
            Flight { turn: 3.0, ..LEVEL },
            Flight {
                climb: 4.0,
                ..LEVEL
            },
            Flight {
                climb: -6.0,
                turn: -5.0,
                speed: 60.0,
            },
            Flight { turn: 0.1, ..LEVEL },
            LEVEL,
        ] {
            assert_eq!(bench.fly(60, flight, parameter), None, "{parameter:?}");
        }
    }
}

#[test]
fn a_witness_that_jumps_is_none() {
    let mut bench = Bench::new();
    for k in 0..6 {
        // Level on an autopilot; the receiver's height jumps by 60 m now and then.
        let jump = if k % 2 == 0 { 60.0 } else { 0.0 };
        for _ in 0..200 {
            bench.t_ms += 100;
            bench.say(A, P::PressureAltitude, 1000.0);
            bench.say(B, P::AltitudeMsl, 1140.0 + jump);
            bench.say(B, P::GroundSpeed, 50.0);
            let now = Monotonic::from_nanos(bench.t_ms * 1_000_000);
            let state = bench.fusion.step(now);
            assert!(state.read(P::PressureAltitude, now).is_ok(), "jump {k}");
        }
    }
}

#[test]
fn of_two_that_stand_neither_is_believed() {
    // A climb whose speed stands, which is right, and an altitude that has stopped: nobody can tell which of them has.
    let mut bench = Bench::new();
    let climbing = Flight {
        climb: 3.0,
        ..LEVEL
    };
    bench.fly(5, climbing, P::PressureAltitude);
    bench.stick(P::PressureAltitude, 1000.0);
    let found = bench.fly(60, climbing, P::VerticalSpeed);
    assert!(found.is_some_and(|s| s <= 20.0), "{found:?}");
    let now = Monotonic::from_nanos(bench.t_ms * 1_000_000);
    let state = bench.fusion.step(now);
    for p in [P::PressureAltitude, P::VerticalSpeed] {
        assert_eq!(state.read(p, now), Err(Invalid::Frozen), "{p:?}");
    }
}

#[test]
fn a_temperature_that_stands_is_found_in_a_long_climb() {
    for (step, most_s) in [(0.1_f64, 160.0), (1.0, 330.0)] {
        let mut fusion = Fusion::new(&[A]);
        let mut found = None;
        for k in 0..4000_u32 {
            let t = f64::from(k) * 0.1;
            let at = Monotonic::from_nanos(1_000_000_000 + u64::from(k) * 100_000_000);
            let height = 3.0 * t;
            // It falls as it should for half a minute, then stands.
            let kelvin =
                ((288.0 - 0.006_5 * height.min(90.0 * step.max(0.5) * 4.0)) / step).round() * step;
            for (p, value) in [
                (P::GroundSpeed, 50.0),
                (P::PressureAltitude, height),
                (P::StaticAirTemperature, kelvin),
            ] {
                let value = p.check(value);
                fusion.apply(&Signal {
                    at,
                    source: A,
                    parameter: p,
                    value,
                });
            }
            let said = fusion.step(at).read(P::StaticAirTemperature, at);
            if said == Err(Invalid::Frozen) {
                found = found.or(Some(t));
            }
        }
        assert!(
            found.is_some_and(|t| t > 100.0 && t < most_s + 60.0),
            "{step}: {found:?}"
        );
    }
}
