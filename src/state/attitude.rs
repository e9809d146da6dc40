//! Attitude a little later: turned on by the body's own angular rates.
//!
//! At a constant angular velocity `w` in the body's axes the rotation from body to the local level is
//! `R(t + dt) = R(t) exp([w x] dt)`: a turn by `|w| dt` about `w`, exact for any angle (Titterton and Weston 2004, "Strapdown
//! Inertial Navigation Technology", 2nd edition, section 3.6; Diebel 2006, "Representing Attitude", equation 216 and
//! section 6). Rates are never integrated from Euler angles, so nothing goes wrong near the vertical.
//!
//! What is added is at most [`LEAD_MAX`], never more than the attitude is old plus the time until it is seen, and nothing
//! at all unless all three rates come from the attitude's own source and are as fresh as the attitude itself.

use super::FlightState;
use crate::angle::{wrap_signed, wrap_turn};
use crate::sampled::Sampled;
use crate::signal::Parameter as P;
use crate::time::Monotonic;
use crate::units::Radians;
use glam::{DMat3, DQuat, DVec3};
use std::time::Duration;

/// The furthest that an attitude is turned on. Beyond a tenth of a second a change of the rates themselves counts as much:
/// at 10 rad/s2, a brisk roll, it is 3 degrees.
pub const LEAD_MAX: Duration = Duration::from_millis(100);
/// Rates and attitude that are further apart than this are not of one moment.
const APART_MAX: Duration = Duration::from_millis(50);

/// Heading, pitch and roll, rad, with the signs of the parameters of these names.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Angles {
    /// Clockwise from whichever north.
    pub heading: f64,
    /// Nose up.
    pub pitch: f64,
    /// Right wing down.
    pub roll: f64,
}

/// The attitude after `dt_s` seconds at the constant body rates `rates_radps` (roll, pitch, yaw).
#[must_use]
pub fn turned(from: Angles, rates_radps: DVec3, dt_s: f64) -> Angles {
    let attitude = DMat3::from_rotation_z(from.heading)
        * DMat3::from_rotation_y(from.pitch)
        * DMat3::from_rotation_x(from.roll);
    let turn = DQuat::from_scaled_axis(rates_radps * dt_s);
    let body_to_level = attitude * DMat3::from_quat(turn);
    let forward = body_to_level.x_axis;
    Angles {
        heading: wrap_turn(Radians(forward.y.atan2(forward.x))).0,
        pitch: (-forward.z).clamp(-1.0, 1.0).asin(),
        roll: wrap_signed(Radians(
            body_to_level.y_axis.z.atan2(body_to_level.z_axis.z),
        ))
        .0,
    }
}

/// `state` as it will be when the picture is seen, at `seen`: pitch, roll and the headings of the attitude's own source
/// turned on, everything else as it is. Times of receipt stay, and with them every age.
#[must_use]
pub fn turned_on(state: &FlightState, now: Monotonic, seen: Monotonic) -> FlightState {
    let mut out = *state;
    let Some((source, at, rates)) = moment(state, now) else {
        return out;
    };
    let lead = seen.since(at).unwrap_or_default().min(LEAD_MAX);
    let (Ok(pitch), Ok(roll)) = (state.read(P::Pitch, now), state.read(P::Roll, now)) else {
        return out;
    };
    let own = |p: P| {
        let heading = state.read(p, now).ok()?;
        let of_one_moment =
            state.source(p) == Some(source) && state.at(p).is_some_and(|then| near(then, at));
        of_one_moment.then_some(heading)
    };
    let from = Angles {
        heading: 0.0,
        pitch,
        roll,
    };
    let to = turned(from, rates, lead.as_secs_f64());
    let mut set = |p: P, value: f64| {
        // In range by construction: an arc sine, and two wrapped angles.
        if let (Ok(value), Some(at)) = (p.check(value), state.at(p)) {
            out.change(p, Sampled::good(value, at));
        }
    };
    set(P::Pitch, to.pitch);
    set(P::Roll, to.roll);
    for p in [P::HeadingTrue, P::HeadingMagnetic] {
        if let Some(heading) = own(p) {
            set(p, wrap_turn(Radians(heading + to.heading)).0);
        }
    }
    out
}

/// The source and time of a whole attitude, with body rates of the same source and moment.
fn moment(
    state: &FlightState,
    now: Monotonic,
) -> Option<(crate::signal::SourceId, Monotonic, DVec3)> {
    let source = state.source(P::Pitch)?;
    let at = state.at(P::Pitch)?;
    let good = |p: P| {
        let value = state.read(p, now).ok()?;
        let then = state.at(p)?;
        (state.source(p) == Some(source) && near(then, at)).then_some(value)
    };
    good(P::Roll)?;
    let rates = DVec3::new(good(P::RollRate)?, good(P::PitchRate)?, good(P::YawRate)?);
    Some((source, at, rates))
}

fn near(a: Monotonic, b: Monotonic) -> bool {
    let apart = a.since(b).or_else(|| b.since(a));
    apart.is_some_and(|apart| apart <= APART_MAX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampled::Invalid;
    use crate::signal::SourceId;

    const A: SourceId = SourceId(0);
    const B: SourceId = SourceId(1);

    fn ms(t: u64) -> Monotonic {
        Monotonic::from_nanos(t * 1_000_000)
    }

    fn degrees(x: f64) -> f64 {
        x.to_radians()
    }

    /// A coning motion whose attitude is known at every time: heading turns evenly while the aircraft stays banked and
    /// pitched; body rates from the kinematic equations of Euler angles (Titterton and Weston, equation 3.52, solved for
    /// the rates) at constant pitch and roll.
    fn turning(t_s: f64) -> (Angles, DVec3) {
        let (turn, pitch, roll) = (degrees(40.0), degrees(25.0), degrees(60.0));
        let angles = Angles {
            heading: wrap_turn(Radians(degrees(330.0) + turn * t_s)).0,
            pitch,
            roll,
        };
        let rates = DVec3::new(
            -turn * pitch.sin(),
            turn * pitch.cos() * roll.sin(),
            turn * pitch.cos() * roll.cos(),
        );
        (angles, rates)
    }

    fn state_of(angles: Angles, rates: DVec3, at: Monotonic) -> FlightState {
        let mut state = FlightState::empty();
        for (p, value) in [
            (P::HeadingTrue, angles.heading),
            (P::Pitch, angles.pitch),
            (P::Roll, angles.roll),
            (P::RollRate, rates.x),
            (P::PitchRate, rates.y),
            (P::YawRate, rates.z),
        ] {
            state.set(p, Sampled::good(value, at), A);
        }
        state
    }

    fn off_degrees(state: &FlightState, truth: Angles, now: Monotonic) -> f64 {
        let off = |p: P, truth: f64| {
            let got = state.read(p, now).unwrap_or(f64::NAN);
            wrap_signed(Radians(got - truth)).to_degrees().abs()
        };
        off(P::HeadingTrue, truth.heading)
            .max(off(P::Pitch, truth.pitch))
            .max(off(P::Roll, truth.roll))
    }

    #[test]
    fn constant_rates_are_followed_exactly_to_the_bound_and_no_further() {
        let (angles, rates) = turning(0.0);
        let state = state_of(angles, rates, ms(1000));
        for (seen, effective) in [
            (1000, 0.0),
            (1016, 0.016),
            (1060, 0.06),
            (1100, 0.1),
            (1250, 0.1),
        ] {
            let shown = turned_on(&state, ms(1000).max(ms(seen - 16)), ms(seen));
            let now = ms(seen - 16).max(ms(1000));
            let off = off_degrees(&shown, turning(effective).0, now);
            assert!(off < 1e-9, "seen at {seen} ms: {off} degrees off");
            assert_eq!(shown.at(P::Pitch), Some(ms(1000)), "its age stays");
        }
    }

    #[test]
    fn a_roll_that_swings_is_shown_far_better_than_without() {
        // 30 degrees to each side in 4 s: 47 degrees a second at most, rates change by 74 degrees a second squared.
        let swing = |t: f64| {
            let w = std::f64::consts::TAU / 4.0;
            let roll = degrees(30.0) * (w * t).sin();
            let rate = degrees(30.0) * w * (w * t).cos();
            (
                Angles {
                    heading: 1.0,
                    pitch: 0.0,
                    roll,
                },
                DVec3::new(rate, 0.0, 0.0),
            )
        };
        let (mut with, mut without) = (0.0_f64, 0.0_f64);
        for k in 0..400_u64 {
            let at = 1000 + k * 10;
            #[expect(clippy::cast_precision_loss, reason = "a few thousand")]
            let t = k as f64 * 0.01;
            let (angles, rates) = swing(t);
            let state = state_of(angles, rates, ms(at));
            // 50 ms old when the picture is begun, seen 16 ms later.
            let (now, seen) = (ms(at + 50), ms(at + 66));
            let truth = swing(t + 0.066).0;
            with = with.max(off_degrees(&turned_on(&state, now, seen), truth, now));
            without = without.max(off_degrees(&state, truth, now));
        }
        assert!(without > 3.0, "66 ms at 47 degrees a second: {without}");
        // Half of the change of the rate times the square of the time: 0.16 degrees.
        assert!(with < 0.17, "{with} degrees off");
    }

    #[test]
    fn without_fresh_rates_of_the_same_source_nothing_is_added() {
        let (angles, rates) = turning(0.0);
        let whole = state_of(angles, rates, ms(1000));
        let (now, seen) = (ms(1020), ms(1036));
        assert_ne!(
            turned_on(&whole, now, seen),
            whole,
            "with all of them it turns"
        );
        for p in [P::RollRate, P::PitchRate, P::YawRate] {
            let mut absent = whole;
            absent.set(p, Sampled::never(), A);
            let mut failed = whole;
            failed.set(p, Sampled::fault(Invalid::SourceFailed, ms(1000)), A);
            let mut older = whole;
            older.set(p, Sampled::good(0.1, ms(949)), A);
            let mut foreign = whole;
            foreign.set(p, Sampled::good(0.1, ms(1000)), B);
            for state in [&absent, &failed, &older, &foreign] {
                assert_eq!(turned_on(state, now, seen), *state, "{p:?}");
            }
        }
        let mut no_roll = whole;
        no_roll.set(P::Roll, Sampled::fault(Invalid::SourceFailed, ms(1000)), A);
        assert_eq!(turned_on(&no_roll, now, seen), no_roll, "no attitude");
    }

    #[test]
    fn nothing_breaks_at_the_vertical() {
        let up = Angles {
            heading: 0.3,
            pitch: degrees(89.9),
            roll: 0.0,
        };
        let over = turned(up, DVec3::new(0.0, degrees(10.0), 0.0), 0.1);
        // A degree of pitching up from 89.9: on the back, 89.1 degrees up, looking the other way.
        assert!((over.pitch - degrees(89.1)).abs() < 1e-9, "{over:?}");
        assert!((over.roll.abs() - degrees(180.0)).abs() < 1e-6, "{over:?}");
        let back = wrap_signed(Radians(over.heading - 0.3)).0.abs();
        assert!((back - degrees(180.0)).abs() < 1e-6, "{over:?}");
    }
}
