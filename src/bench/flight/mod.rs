//! A flight: an ultralight follows a line (the demo's, through its valley) or the legs of a profile.
//!
//! [`Flight::along`] flies the whole line once, at start, in steps of 20 ms: a guidance law turns towards a point ahead on
//! the line, the bank follows at a limited rate, and the turn follows from the bank as in a coordinated turn.
//! [`Flight::of_legs`] flies legs in the same way, each with its turn, climb and speed. Afterwards
//! [`Flight::sample`] gives the flight at any time; the same line always gives the same flight, to the bit on one machine.
//!
//! The motion is that of a point mass in air of the ICAO standard atmosphere (ICAO Doc 7488/3) that moves evenly with the
//! wind, with thrust for its speed at every climb angle; attitude is such that there is no sideslip. So every number that the sensors tell follows
//! from the path, and nothing needs noise to look alive.

mod frames;
mod guidance;
mod legs;

pub use frames::Sensors;
pub use legs::{BANK_MAX_RAD, Climb, Leg, Start, Turn};

use crate::angle::wrap_turn;
use crate::geo::{Attitude, Geodetic};
use crate::units::{Hectopascals, Kelvin, Metres, MetresPerSecond, Radians, STANDARD_GRAVITY_MPS2};
use glam::{DMat3, DVec2, DVec3};
use std::time::Duration;

/// Time between the steps of the flight.
pub const STEP: Duration = Duration::from_millis(20);
const STEP_S: f64 = 0.02;

/// Angle of attack in unaccelerated flight; it grows with the load factor.
const ANGLE_OF_ATTACK_1G: Radians = Radians(0.044);

/// Why no flight can be made along a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FlightError {
    /// A line has at least two different points.
    #[error("the line has fewer than two different points")]
    TooShort,
    /// A point is no place.
    #[error("point {0} of the line is no place on Earth")]
    NoPlace(usize),
}

/// The day on which the flight takes place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Day {
    /// Pressure reduced to mean sea level (QNH), which is also what the altimeter is set to.
    pub qnh: Hectopascals,
    /// Height of the geoid above the ellipsoid where the flight is.
    pub undulation: Metres,
    /// How the air moves over the ground: north and east, m/s.
    pub wind_mps: DVec2,
    /// How much warmer the air is than the standard atmosphere's, K.
    pub warmer_k: f64,
}

/// Position, velocity and bank at one step.
#[derive(Clone, Copy, Debug)]
struct Step {
    position: Geodetic,
    /// Through the air, as are track and climb.
    speed_mps: f64,
    speed_rate_mps2: f64,
    /// Direction of motion, unwrapped.
    track_rad: f64,
    climb_rad: f64,
    climb_rate_radps: f64,
    bank_rad: f64,
}

/// Everything that is known of the flight at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Where.
    pub position: Geodetic,
    /// How the aircraft points.
    pub attitude: Attitude,
    /// Body rates: roll, pitch, yaw; signs as the parameters of the same names, rad/s.
    pub rates_radps: DVec3,
    /// What accelerometers feel, in body axes: forward, right, up; 1 up in level flight, g.
    pub felt_g: DVec3,
    /// Direction of motion over the ground, 0 to 2 pi.
    pub track: Radians,
    /// Over the ground.
    pub ground_speed: MetresPerSecond,
    /// Up positive.
    pub vertical_speed: MetresPerSecond,
    /// Through the air.
    pub true_airspeed: MetresPerSecond,
    /// What the airspeed indicator shows (compressibility, 0.1 % at this speed, is left out).
    pub indicated_airspeed: MetresPerSecond,
    /// Nose above the direction of motion.
    pub angle_of_attack: Radians,
    /// Above the 1013.25 hPa surface.
    pub pressure_altitude: Metres,
    /// Above mean sea level: what the altimeter shows at the day's QNH.
    pub altitude_msl: Metres,
    /// Outside.
    pub temperature: Kelvin,
}

/// A flight from the first point of a line to its last.
#[derive(Clone, Debug)]
pub struct Flight {
    steps: Vec<Step>,
    day: Day,
}

impl Flight {
    /// Flies along `line`, its points some hundred metres apart, at about 55 m/s (the climb costs some speed, the descent
    /// gains some). Corners are flown as turns with up to 30 degrees of bank, so the path leaves the line there.
    ///
    /// # Errors
    /// When there is no line.
    pub fn along(line: &[Geodetic], day: Day) -> Result<Self, FlightError> {
        if let Some(i) = line.iter().position(|p| !p.is_valid()) {
            return Err(FlightError::NoPlace(i));
        }
        let steps = guidance::fly(line)?;
        Ok(Self { steps, day })
    }

    /// Flies legs, one after the other.
    ///
    /// # Errors
    /// When the start is no place.
    pub fn of_legs(start: &Start, legs: &[Leg], day: Day) -> Result<Self, FlightError> {
        if !start.place.is_valid() {
            return Err(FlightError::NoPlace(0));
        }
        let steps = legs::fly(start, legs, day);
        Ok(Self { steps, day })
    }

    /// The day on which it takes place.
    #[must_use]
    pub const fn day(&self) -> Day {
        self.day
    }

    /// How long it takes.
    #[must_use]
    pub fn duration(&self) -> Duration {
        let last = u32::try_from(self.steps.len().saturating_sub(1)).unwrap_or(u32::MAX);
        STEP * last
    }

    /// The flight at `t` after its start; after its end it stays at its end.
    #[must_use]
    pub fn sample(&self, t: Duration) -> Sample {
        let step = self.step_at(t.as_secs_f64());
        let body_to_ned = step.body_to_ned();
        let altitude_msl = step.position.height_ellipsoid - self.day.undulation;
        let air = Air::at(altitude_msl, self.day);
        let through_air = step.speed_mps * step.climb_rad.cos();
        let (sin_track, cos_track) = step.track_rad.sin_cos();
        let over_ground = DVec2::new(cos_track, sin_track) * through_air + self.day.wind_mps;
        Sample {
            position: step.position,
            attitude: attitude_of(body_to_ned),
            rates_radps: self.rates_at(t.as_secs_f64()),
            felt_g: step.felt_g(body_to_ned),
            track: wrap_turn(Radians(over_ground.y.atan2(over_ground.x))),
            ground_speed: MetresPerSecond(over_ground.length()),
            vertical_speed: MetresPerSecond(step.speed_mps * step.climb_rad.sin()),
            true_airspeed: MetresPerSecond(step.speed_mps),
            indicated_airspeed: MetresPerSecond(step.speed_mps * air.density_ratio.sqrt()),
            angle_of_attack: step.angle_of_attack(),
            pressure_altitude: air.pressure_altitude,
            altitude_msl,
            temperature: air.temperature,
        }
    }

    /// Between steps everything changes evenly: within 0.3 mm and 1e-5 rad of the smooth path.
    fn step_at(&self, t_s: f64) -> Step {
        let last = self.steps.len() - 1;
        let at = (t_s / STEP_S).max(0.0);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a float to integer cast saturates, and the index is bounded below"
        )]
        let i = (at as usize).min(last);
        let (a, b) = (self.steps[i], self.steps[(i + 1).min(last)]);
        #[expect(clippy::cast_precision_loss, reason = "an index is far below 2^52")]
        let f = (at - i as f64).min(1.0);
        let mix = |a: f64, b: f64| a + (b - a) * f;
        Step {
            position: Geodetic {
                latitude: Radians(mix(a.position.latitude.0, b.position.latitude.0)),
                longitude: Radians(mix(a.position.longitude.0, b.position.longitude.0)),
                height_ellipsoid: Metres(mix(
                    a.position.height_ellipsoid.0,
                    b.position.height_ellipsoid.0,
                )),
            },
            speed_mps: mix(a.speed_mps, b.speed_mps),
            speed_rate_mps2: mix(a.speed_rate_mps2, b.speed_rate_mps2),
            track_rad: mix(a.track_rad, b.track_rad),
            climb_rad: mix(a.climb_rad, b.climb_rad),
            climb_rate_radps: mix(a.climb_rate_radps, b.climb_rate_radps),
            bank_rad: mix(a.bank_rad, b.bank_rad),
        }
    }

    /// Body rates from the attitudes a step earlier and later: the skew part of `R^T dR/dt`.
    fn rates_at(&self, t_s: f64) -> DVec3 {
        let end_s = self.duration().as_secs_f64();
        let before_s = (t_s.min(end_s) - STEP_S).max(0.0);
        let after_s = (t_s + STEP_S).min(end_s);
        if after_s <= before_s {
            return DVec3::ZERO;
        }
        let before = self.step_at(before_s).body_to_ned();
        let after = self.step_at(after_s).body_to_ned();
        let middle = self.step_at((before_s + after_s) / 2.0).body_to_ned();
        let change = middle.transpose() * (after - before) * (1.0 / (after_s - before_s));
        DVec3::new(change.y_axis.z, change.z_axis.x, change.x_axis.y)
    }
}

impl Step {
    /// Angular rate of the track in a coordinated turn: the horizontal part of the lift turns the path.
    fn track_rate_radps(&self) -> f64 {
        self.vertical_pull_mps2() * self.bank_rad.tan() / (self.speed_mps * self.climb_rad.cos())
    }

    /// The part of the lift, per mass, that works against gravity and bends the path upwards.
    fn vertical_pull_mps2(&self) -> f64 {
        STANDARD_GRAVITY_MPS2 * self.climb_rad.cos() + self.speed_mps * self.climb_rate_radps
    }

    fn angle_of_attack(&self) -> Radians {
        let load = self.vertical_pull_mps2() / (STANDARD_GRAVITY_MPS2 * self.bank_rad.cos());
        Radians(ANGLE_OF_ATTACK_1G.0 * load)
    }

    /// The nose stands above the direction of motion by the angle of attack, in the aircraft's own plane of symmetry.
    fn body_to_ned(&self) -> DMat3 {
        DMat3::from_rotation_z(self.track_rad)
            * DMat3::from_rotation_y(self.climb_rad)
            * DMat3::from_rotation_x(self.bank_rad)
            * DMat3::from_rotation_y(self.angle_of_attack().0)
    }

    /// Acceleration less gravity, in body axes with up instead of down.
    fn felt_g(&self, body_to_ned: DMat3) -> DVec3 {
        let (sin_track, cos_track) = self.track_rad.sin_cos();
        let (sin_climb, cos_climb) = self.climb_rad.sin_cos();
        let along = DVec3::new(cos_climb * cos_track, cos_climb * sin_track, -sin_climb);
        let right = DVec3::new(-sin_track, cos_track, 0.0);
        let down = along.cross(right);
        let acceleration = along * self.speed_rate_mps2
            + right * (self.speed_mps * cos_climb * self.track_rate_radps())
            - down * (self.speed_mps * self.climb_rate_radps);
        let gravity = DVec3::new(0.0, 0.0, STANDARD_GRAVITY_MPS2);
        let felt = body_to_ned.transpose() * (acceleration - gravity) / STANDARD_GRAVITY_MPS2;
        DVec3::new(felt.x, felt.y, -felt.z)
    }
}

/// Heading, pitch and roll of a rotation from body to NED.
fn attitude_of(body_to_ned: DMat3) -> Attitude {
    let forward = body_to_ned.x_axis;
    Attitude {
        heading_true: wrap_turn(Radians(forward.y.atan2(forward.x))),
        pitch: Radians((-forward.z).clamp(-1.0, 1.0).asin()),
        roll: Radians(body_to_ned.y_axis.z.atan2(body_to_ned.z_axis.z)),
    }
}

/// The air at a height: ICAO Doc 7488/3, troposphere, with the day's pressure at sea level.
struct Air {
    pressure_altitude: Metres,
    temperature: Kelvin,
    density_ratio: f64,
}

impl Air {
    const SEA_LEVEL_K: f64 = 288.15;
    const LAPSE_KPM: f64 = 0.0065;
    const SEA_LEVEL_HPA: f64 = 1013.25;
    /// `g / (R lapse)` with R = 287.052_87 J/(kg K).
    const EXPONENT: f64 = 5.255_876;

    fn at(altitude_msl: Metres, day: Day) -> Self {
        let scale_m = Self::SEA_LEVEL_K / Self::LAPSE_KPM;
        let ratio = 1.0 - altitude_msl.0 / scale_m;
        let pressure_ratio = day.qnh.0 / Self::SEA_LEVEL_HPA * ratio.powf(Self::EXPONENT);
        let temperature_k = Self::SEA_LEVEL_K * ratio + day.warmer_k;
        Self {
            pressure_altitude: Metres(scale_m * (1.0 - pressure_ratio.powf(1.0 / Self::EXPONENT))),
            temperature: Kelvin(temperature_k),
            density_ratio: pressure_ratio * Self::SEA_LEVEL_K / temperature_k,
        }
    }
}

#[cfg(test)]
mod tests;
