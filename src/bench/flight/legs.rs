//! How the legs of a profile are flown: each asks for a bank, a climb and a speed, which follow at the rates of a light
//! aircraft; air that is not quite still keeps every sensor moving, as it does in flight.

use super::guidance::{
    BANK_ACCELERATION_MAX_RADPS2, BANK_GAIN_PER_S, BANK_RATE_MAX_RADPS, CLIMB_GAIN_PER_S,
    CLIMB_RATE_MAX_RADPS, SPEED_S, advance,
};
use super::{Air, Day, STEP_S, Step};
use crate::angle::shortest_turn;
use crate::geo::Geodetic;
use crate::units::{Metres, MetresPerSecond, Radians, STANDARD_GRAVITY_MPS2};
use std::time::Duration;

/// The steepest bank that a leg can ask for.
pub const BANK_MAX_RAD: f64 = std::f64::consts::FRAC_PI_3;
/// The steepest climb and descent.
const CLIMB_MAX_RAD: f64 = 0.3;

/// The bank by which a turn to a heading is flown, per radian that is left, up to 25 degrees.
const BANK_PER_TURN: f64 = 1.2;
const BANK_TO_HEADING_MAX_RAD: f64 = 0.436;
/// The vertical speed by which an altitude is flown to, per metre that is left, up to 700 ft/min.
const CLIMB_PER_METRE: f64 = 0.12;
const CLIMB_TO_ALTITUDE_MAX_MPS: f64 = 3.556;

/// How a flight begins: trimmed, wings level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// Where.
    pub place: Geodetic,
    /// Clockwise from true north.
    pub heading: Radians,
    /// Indicated.
    pub airspeed: MetresPerSecond,
    /// How much the air rolls the aircraft; 0 is still air.
    pub bumps: Radians,
}

/// How a leg turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Turn {
    /// At a bank, right positive; 0 is straight on.
    Bank(Radians),
    /// At so many radians a second, right positive.
    Rate(f64),
    /// The shorter way to a true heading, then straight on.
    To(Radians),
}

/// How a leg climbs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Climb {
    /// At a vertical speed, up positive.
    Rate(MetresPerSecond),
    /// To an altitude above mean sea level, then level.
    To(Metres),
}

/// One leg.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leg {
    /// How long.
    pub duration: Duration,
    /// Which way.
    pub turn: Turn,
    /// Up or down.
    pub climb: Climb,
    /// Indicated.
    pub airspeed: MetresPerSecond,
}

/// All steps of the legs.
pub(super) fn fly(start: &Start, legs: &[Leg], day: Day) -> Vec<Step> {
    let mut step = Step {
        position: start.place,
        speed_mps: true_speed(start.airspeed, &start.place, day),
        speed_rate_mps2: 0.0,
        track_rad: start.heading.0,
        climb_rad: 0.0,
        climb_rate_radps: 0.0,
        bank_rad: 0.0,
    };
    let mut bank_rate_radps = 0.0;
    let mut steps = Vec::new();
    let mut end_s = 0.0;
    let mut t_s = 0.0;
    for leg in legs {
        end_s += leg.duration.as_secs_f64();
        while t_s < end_s {
            control(
                &mut step,
                &mut bank_rate_radps,
                leg,
                start.bumps.0 * bump(t_s),
                day,
            );
            steps.push(step);
            advance(&mut step, bank_rate_radps, day.wind_mps);
            t_s += STEP_S;
        }
    }
    steps.push(step);
    steps
}

/// The true airspeed at which an airspeed indicator shows `indicated` at a place.
fn true_speed(indicated: MetresPerSecond, place: &Geodetic, day: Day) -> f64 {
    let air = Air::at(place.height_ellipsoid - day.undulation, day);
    indicated.0 / air.density_ratio.sqrt()
}

/// A sum of sines without a common period, about -1 to 1.
fn bump(t_s: f64) -> f64 {
    (0.5 * t_s).sin() * 0.4 + (1.31 * t_s + 1.0).sin() * 0.35 + (3.3 * t_s + 2.0).sin() * 0.25
}

/// Sets the rates of change from what the leg asks for.
fn control(step: &mut Step, bank_rate_radps: &mut f64, leg: &Leg, bump_rad: f64, day: Day) {
    let bank = match leg.turn {
        Turn::Bank(bank) => bank.0,
        // What a coordinated turn at this rate takes.
        Turn::Rate(rate) => (step.speed_mps * rate / STANDARD_GRAVITY_MPS2).atan(),
        Turn::To(heading) => (shortest_turn(Radians(step.track_rad), heading).0 * BANK_PER_TURN)
            .clamp(-BANK_TO_HEADING_MAX_RAD, BANK_TO_HEADING_MAX_RAD),
    };
    let bank = bank.clamp(-BANK_MAX_RAD, BANK_MAX_RAD) + bump_rad;
    let rate_wanted =
        (BANK_GAIN_PER_S * (bank - step.bank_rad)).clamp(-BANK_RATE_MAX_RADPS, BANK_RATE_MAX_RADPS);
    let rate_step = BANK_ACCELERATION_MAX_RADPS2 * STEP_S;
    *bank_rate_radps += (rate_wanted - *bank_rate_radps).clamp(-rate_step, rate_step);
    let up_mps = match leg.climb {
        Climb::Rate(up) => up.0,
        Climb::To(altitude) => {
            let here = step.position.height_ellipsoid - day.undulation;
            (CLIMB_PER_METRE * (altitude - here).0)
                .clamp(-CLIMB_TO_ALTITUDE_MAX_MPS, CLIMB_TO_ALTITUDE_MAX_MPS)
        }
    };
    let climb = (up_mps / step.speed_mps).clamp(-1.0, 1.0).asin();
    let climb = climb.clamp(-CLIMB_MAX_RAD, CLIMB_MAX_RAD) + bump_rad * 0.3;
    step.climb_rate_radps = (CLIMB_GAIN_PER_S * (climb - step.climb_rad))
        .clamp(-CLIMB_RATE_MAX_RADPS, CLIMB_RATE_MAX_RADPS);
    let wanted_mps = true_speed(leg.airspeed, &step.position, day) * (1.0 + bump_rad * 0.2);
    step.speed_rate_mps2 = (wanted_mps - step.speed_mps) / SPEED_S;
}
