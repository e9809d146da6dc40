//! How the flight follows its line: pure pursuit of a point ahead (Coulter 1992, "Implementation of the pure pursuit path
//! tracking algorithm", CMU-RI-TR-92-01; for aircraft Park, Deyst and How 2004, "A new nonlinear guidance logic for
//! trajectory tracking", AIAA 2004-4900, whose lateral acceleration `2 V^2 sin(eta) / L` is used here).

use super::{FlightError, STEP_S, Step};
use crate::angle::wrap_signed;
use crate::geo::{Geodetic, meridian_radius_m, prime_vertical_radius_m};
use crate::units::{Metres, Radians, STANDARD_GRAVITY_MPS2};
use glam::{DVec2, DVec3};

/// Speed in level flight, m/s.
const CRUISE_MPS: f64 = 55.0;
/// Speed lost per sine of the climb angle: 6 m/s in the steepest climb.
const CRUISE_PER_CLIMB_MPS: f64 = 50.0;
/// Time constant of speed changes.
pub(super) const SPEED_S: f64 = 4.0;
/// Distance of the point that the aircraft turns to: 11 s of flight.
const AHEAD_M: f64 = 600.0;
/// Limits of an ultralight flown smoothly.
const BANK_MAX_RAD: f64 = std::f64::consts::FRAC_PI_6;
pub(super) const BANK_RATE_MAX_RADPS: f64 = 0.2;
pub(super) const BANK_ACCELERATION_MAX_RADPS2: f64 = 0.3;
const CLIMB_MAX_RAD: f64 = 0.12;
pub(super) const CLIMB_RATE_MAX_RADPS: f64 = 0.03;
/// Gains of bank and climb towards what is wanted, 1/s.
pub(super) const BANK_GAIN_PER_S: f64 = 0.9;
pub(super) const CLIMB_GAIN_PER_S: f64 = 0.5;
/// The longest flight: four hours, 720 000 steps.
const STEPS_MAX: usize = 4 * 3600 * 50;

/// The line in a plane: east, north of its first point and height, metres. Only the guidance works in it; positions are
/// integrated on the ellipsoid.
struct Line {
    points: Vec<DVec3>,
    origin: Geodetic,
    metres_per_radian: DVec2,
}

impl Line {
    fn new(line: &[Geodetic]) -> Result<Self, FlightError> {
        let &origin = line.first().ok_or(FlightError::TooShort)?;
        let (sin_lat, cos_lat) = origin.latitude.0.sin_cos();
        let mut this = Self {
            points: Vec::with_capacity(line.len()),
            origin,
            metres_per_radian: DVec2::new(
                prime_vertical_radius_m(sin_lat) * cos_lat,
                meridian_radius_m(sin_lat),
            ),
        };
        for place in line {
            let p = this.to_plane(place);
            let is_new = |q: &DVec3| (p - *q).truncate().length() > 1.0;
            if this.points.last().is_none_or(is_new) {
                this.points.push(p);
            }
        }
        if this.points.len() < 2 {
            return Err(FlightError::TooShort);
        }
        Ok(this)
    }

    fn to_plane(&self, place: &Geodetic) -> DVec3 {
        let east = wrap_signed(place.longitude - self.origin.longitude).0;
        let north = place.latitude.0 - self.origin.latitude.0;
        let m = self.metres_per_radian;
        DVec3::new(east * m.x, north * m.y, place.height_ellipsoid.0)
    }

    /// The nearest place on the line to `p`, seen from above, as (segment, fraction), no earlier than `from` and at most a
    /// pursuit distance and two segments later.
    fn nearest(&self, p: DVec3, from: (usize, f64)) -> (usize, f64) {
        let mut best = (from, f64::INFINITY);
        let mut searched_m = 0.0;
        for i in from.0..self.points.len() - 1 {
            let (a, b) = (self.points[i].truncate(), self.points[i + 1].truncate());
            let along = b - a;
            let earliest = if i == from.0 { from.1 } else { 0.0 };
            let f = ((p.truncate() - a).dot(along) / along.length_squared()).clamp(earliest, 1.0);
            let distance = (a + along * f - p.truncate()).length();
            if distance < best.1 {
                best = ((i, f), distance);
            }
            searched_m += along.length();
            if searched_m > AHEAD_M && i > from.0 + 1 {
                break;
            }
        }
        best.0
    }

    /// The place `distance_m` further along the line than `from`; beyond its end the line goes straight on. And how much
    /// of the line is left from `from`, up to that distance.
    fn ahead(&self, from: (usize, f64), distance_m: f64) -> (DVec3, f64) {
        let mut left_m = distance_m;
        let mut fraction = from.1;
        for i in from.0..self.points.len() - 1 {
            let (a, b) = (self.points[i], self.points[i + 1]);
            let length_m = (b - a).truncate().length();
            let rest_m = length_m * (1.0 - fraction);
            if left_m <= rest_m {
                return (a + (b - a) * (fraction + left_m / length_m), distance_m);
            }
            left_m -= rest_m;
            fraction = 0.0;
        }
        let last = self.points.len() - 1;
        let (a, b) = (self.points[last - 1], self.points[last]);
        let direction = (b - a) / (b - a).truncate().length();
        let level = DVec3::new(direction.x, direction.y, 0.0);
        (b + level * left_m, distance_m - left_m)
    }
}

/// All steps of a flight along `line`.
pub(super) fn fly(line: &[Geodetic]) -> Result<Vec<Step>, FlightError> {
    let line = Line::new(line)?;
    let (target, _) = line.ahead((0, 0.0), AHEAD_M);
    let to_target = target - line.points[0];
    let mut step = Step {
        position: line.origin,
        speed_mps: CRUISE_MPS,
        speed_rate_mps2: 0.0,
        track_rad: to_target.x.atan2(to_target.y),
        climb_rad: climb_to(to_target),
        climb_rate_radps: 0.0,
        bank_rad: 0.0,
    };
    let mut steps = Vec::new();
    let mut bank_rate_radps = 0.0;
    let mut at = (0, 0.0);
    while steps.len() < STEPS_MAX {
        let here = line.to_plane(&step.position);
        at = line.nearest(here, at);
        let (target, left_m) = line.ahead(at, AHEAD_M);
        let to_target = target - here;
        control(&mut step, &mut bank_rate_radps, to_target);
        steps.push(step);
        if left_m < 1.0 {
            break;
        }
        advance(&mut step, bank_rate_radps, DVec2::ZERO);
    }
    Ok(steps)
}

/// The climb angle that leads to a point at `to`, within limits.
fn climb_to(to: DVec3) -> f64 {
    to.z.atan2(to.truncate().length())
        .clamp(-CLIMB_MAX_RAD, CLIMB_MAX_RAD)
}

/// Sets the rates of change from where the target is.
fn control(step: &mut Step, bank_rate_radps: &mut f64, to_target: DVec3) {
    let off = wrap_signed(Radians(to_target.x.atan2(to_target.y) - step.track_rad)).0;
    // Behind the wing the turn is as tight as it can be.
    let off = off.clamp(-std::f64::consts::FRAC_PI_2, std::f64::consts::FRAC_PI_2);
    let distance_m = to_target.truncate().length().max(AHEAD_M / 2.0);
    let sideways_mps2 = 2.0 * step.speed_mps * step.speed_mps * off.sin() / distance_m;
    let bank_wanted = (sideways_mps2 / STANDARD_GRAVITY_MPS2)
        .atan()
        .clamp(-BANK_MAX_RAD, BANK_MAX_RAD);
    let rate_wanted = (BANK_GAIN_PER_S * (bank_wanted - step.bank_rad))
        .clamp(-BANK_RATE_MAX_RADPS, BANK_RATE_MAX_RADPS);
    let rate_step = BANK_ACCELERATION_MAX_RADPS2 * STEP_S;
    *bank_rate_radps += (rate_wanted - *bank_rate_radps).clamp(-rate_step, rate_step);
    step.climb_rate_radps = (CLIMB_GAIN_PER_S * (climb_to(to_target) - step.climb_rad))
        .clamp(-CLIMB_RATE_MAX_RADPS, CLIMB_RATE_MAX_RADPS);
    let speed_wanted = CRUISE_MPS - CRUISE_PER_CLIMB_MPS * step.climb_rad.sin();
    step.speed_rate_mps2 = (speed_wanted - step.speed_mps) / SPEED_S;
}

/// One step of time. The position moves by the mean of the velocities at both ends, so that it is the integral of what the
/// samples say.
pub(super) fn advance(step: &mut Step, bank_rate_radps: f64, wind_mps: DVec2) {
    let before = velocity_ned(step);
    step.track_rad += step.track_rate_radps() * STEP_S;
    step.climb_rad += step.climb_rate_radps * STEP_S;
    step.speed_mps += step.speed_rate_mps2 * STEP_S;
    step.bank_rad += bank_rate_radps * STEP_S;
    let wind = wind_mps.extend(0.0);
    let moved = (before + velocity_ned(step)) * (STEP_S / 2.0) + wind * STEP_S;
    let position = &mut step.position;
    let (sin_lat, cos_lat) = position.latitude.0.sin_cos();
    let height_m = position.height_ellipsoid.0;
    position.latitude.0 += moved.x / (meridian_radius_m(sin_lat) + height_m);
    let parallel_m = (prime_vertical_radius_m(sin_lat) + height_m) * cos_lat;
    position.longitude = wrap_signed(Radians(position.longitude.0 + moved.y / parallel_m));
    position.height_ellipsoid = position.height_ellipsoid - Metres(moved.z);
}

fn velocity_ned(step: &Step) -> DVec3 {
    let (sin_climb, cos_climb) = step.climb_rad.sin_cos();
    let (sin_track, cos_track) = step.track_rad.sin_cos();
    DVec3::new(cos_climb * cos_track, cos_climb * sin_track, -sin_climb) * step.speed_mps
}
