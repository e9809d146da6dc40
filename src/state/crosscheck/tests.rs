//! Level attitude in a turn, and everything that must not be taken for it: through the whole of fusion.

use super::*;
use crate::signal::Signal;
use crate::state::Fusion;

const AHRS: SourceId = SourceId(0);
const GPS: SourceId = SourceId(1);

/// A flight as its sensors say it.
#[derive(Clone, Copy)]
struct Flight {
    speed_mps: f64,
    turn_degrees: f64,
    /// What the attitude source says, degrees.
    roll: f64,
    /// What the accelerometer feels to the right, g; none where NaN.
    felt_g: f64,
    /// Yaw rate of the other source, degrees a second; none where NaN.
    yaw: f64,
    /// Whether there is any track.
    tracked: bool,
}

const TURNING: Flight = Flight {
    speed_mps: 50.0,
    turn_degrees: 3.0,
    roll: 0.1,
    felt_g: f64::NAN,
    yaw: f64::NAN,
    tracked: true,
};

struct Bench {
    fusion: Fusion,
    t_ms: u64,
    track: f64,
}

impl Bench {
    fn new() -> Self {
        Self {
            fusion: Fusion::new(&[AHRS, GPS]),
            t_ms: 1000,
            track: 6.0,
        }
    }

    fn say(&mut self, source: SourceId, parameter: P, value: f64) {
        if !value.is_nan() {
            self.fusion.apply(&Signal {
                at: Monotonic::from_nanos(self.t_ms * 1_000_000),
                source,
                parameter,
                value: parameter.check(value),
            });
        }
    }

    /// What the display may show of roll after `seconds`; attitude at 10 Hz, GPS at 1 Hz.
    fn fly(&mut self, seconds: u64, flight: Flight) -> Result<f64, Invalid> {
        let mut roll = Err(Invalid::NeverReceived);
        for _ in 0..seconds * 10 {
            self.t_ms += 100;
            self.track += flight.turn_degrees.to_radians() * 0.1;
            // A sensor that is there has some noise, one that is not may have: freezing is not what is tried here.
            let noise = if self.t_ms.is_multiple_of(200) {
                0.01
            } else {
                -0.01
            };
            self.say(AHRS, P::Roll, (flight.roll + noise).to_radians());
            self.say(AHRS, P::Pitch, noise.to_radians());
            self.say(AHRS, P::LateralAcceleration, flight.felt_g);
            self.say(GPS, P::YawRate, flight.yaw.to_radians());
            if self.t_ms.is_multiple_of(1000) {
                self.say(GPS, P::GroundSpeed, flight.speed_mps);
                if flight.tracked {
                    let track = crate::angle::wrap_turn(Radians(self.track)).0;
                    self.say(GPS, P::Track, track);
                }
            }
            let now = Monotonic::from_nanos(self.t_ms * 1_000_000);
            roll = self.fusion.step(now).read(P::Roll, now);
        }
        roll
    }
}

#[test]
fn level_attitude_in_a_standard_turn_is_found_within_nine_seconds() {
    // 3 degrees a second at 50 m/s asks for 15 degrees of bank. 3 s to see the turn, 5 s of contradiction.
    let mut bench = Bench::new();
    let straight = Flight {
        turn_degrees: 0.0,
        ..TURNING
    };
    assert!(bench.fly(20, straight).is_ok(), "straight");
    assert!(bench.fly(5, TURNING).is_ok(), "not at once");
    assert_eq!(bench.fly(4, TURNING), Err(Invalid::Implausible));
    // Straight flight proves nothing; a bank does.
    assert_eq!(bench.fly(60, straight), Err(Invalid::Implausible));
    let banked = Flight {
        roll: 15.0,
        ..TURNING
    };
    assert!(bench.fly(6, banked).is_ok(), "the sensor is back");
}

#[test]
fn without_a_track_the_yaw_rate_of_another_source_shows_the_turn() {
    let turning = Flight {
        tracked: false,
        yaw: 3.0,
        ..TURNING
    };
    assert_eq!(Bench::new().fly(8, turning), Err(Invalid::Implausible));
    let blind = Flight {
        yaw: f64::NAN,
        ..turning
    };
    assert!(Bench::new().fly(60, blind).is_ok(), "no sight of the turn");
}

#[test]
fn healthy_attitude_is_never_refuted() {
    for (what, flight) in [
        (
            "a coordinated turn",
            Flight {
                roll: 15.0,
                ..TURNING
            },
        ),
        (
            "a shallow turn",
            Flight {
                turn_degrees: 1.5,
                ..TURNING
            },
        ),
        (
            "a flat skid that is felt",
            Flight {
                felt_g: 0.267,
                ..TURNING
            },
        ),
        (
            "taxiing around a corner",
            Flight {
                speed_mps: 10.0,
                turn_degrees: 20.0,
                ..TURNING
            },
        ),
        (
            "a slip in straight flight",
            Flight {
                roll: 20.0,
                turn_degrees: 0.0,
                ..TURNING
            },
        ),
    ] {
        assert!(Bench::new().fly(60, flight).is_ok(), "{what}");
    }
}

#[test]
fn short_turns_do_not_add_up() {
    let mut bench = Bench::new();
    for _ in 0..10 {
        // Turbulence: 4 s of turn, then none.
        assert!(bench.fly(3, TURNING).is_ok());
        assert!(
            bench
                .fly(
                    5,
                    Flight {
                        turn_degrees: 0.0,
                        ..TURNING
                    }
                )
                .is_ok()
        );
    }
}

#[test]
fn slow_turns_to_either_side_are_seen_through_and_wind_changes_nothing() {
    // The limit is 10 degrees of bank: 2 degrees a second at 50 m/s, as the ground speed in a wind has it too.
    for (speed_mps, turn_degrees) in [(50.0, 2.1), (50.0, -2.1), (30.0, 3.4), (75.0, -1.4)] {
        let mut bench = Bench::new();
        let turning = Flight {
            speed_mps,
            turn_degrees,
            ..TURNING
        };
        let straight = Flight {
            turn_degrees: 0.0,
            ..turning
        };
        assert!(bench.fly(10, straight).is_ok(), "straight");
        let after = bench.fly(9, turning);
        assert_eq!(
            after,
            Err(Invalid::Implausible),
            "{speed_mps} m/s, {turn_degrees}"
        );
    }
}

/// What may be shown of a roll that stands still at 15 degrees, whatever the turn does.
fn stuck_at_fifteen(bench: &mut Bench, turn_degrees: f64, seconds: u64) -> Result<f64, Invalid> {
    let mut roll = Err(Invalid::NeverReceived);
    for _ in 0..seconds * 10 {
        bench.t_ms += 100;
        bench.track += turn_degrees.to_radians() * 0.1;
        bench.say(AHRS, P::Roll, 15_f64.to_radians());
        bench.say(AHRS, P::Pitch, 0.0);
        bench.say(AHRS, P::LateralAcceleration, 0.0);
        if bench.t_ms.is_multiple_of(1000) {
            bench.say(GPS, P::GroundSpeed, 50.0);
            let track = crate::angle::wrap_turn(Radians(bench.track)).0;
            bench.say(GPS, P::Track, track);
        }
        let now = Monotonic::from_nanos(bench.t_ms * 1_000_000);
        roll = bench.fusion.step(now).read(P::Roll, now);
    }
    roll
}

#[test]
fn a_bank_that_stands_still_is_refuted_when_the_turn_ends_or_reverses() {
    for turn_degrees in [0.0, -3.0] {
        let mut bench = Bench::new();
        let roll = stuck_at_fifteen(&mut bench, 3.0, 60);
        assert!(roll.is_ok(), "it belongs to the turn: {roll:?}");
        let roll = stuck_at_fifteen(&mut bench, turn_degrees, 9);
        assert_eq!(roll, Err(Invalid::Implausible), "turning at {turn_degrees}");
    }
}
