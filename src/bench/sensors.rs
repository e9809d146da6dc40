//! What the sensors of a flown profile say at any time of it.

use super::flight::Sample;
use super::profile::{Other, Profile};
use super::truth::{Aircraft, Truth};
use crate::angle::{wrap_signed, wrap_turn};
use crate::atmosphere::{STANDARD_PRESSURE, density_altitude, pressure_at, speed_of_sound};
use crate::geo::{Geodetic, meridian_radius_m, prime_vertical_radius_m};
use crate::sampled::Invalid;
use crate::signal::Parameter as P;
use crate::signal::{Alert, BUS_CURRENT, BUS_VOLTAGE, FUEL_QUANTITY, Parameter, engines};
use crate::state::magnetic;
use crate::units::{
    Feet, FeetPerMinute, Hectopascals, Kelvin, Knots, Metres, MetresPerSecond, Radians,
};
use std::time::Duration;

/// Angle of attack at the stall, rad, of which a part is used.
const STALL_RAD: f64 = 0.26;
/// Engine speed of full power, 1/min.
const FULL_RPM: f64 = 2700.0;
/// Fuel of full power, l/h, and in each tank at the start, l.
const FULL_FLOW_LPH: f64 = 36.0;
const TANK_L: f64 = 80.0;

impl Profile {
    /// What the sensors say at `t` after the start; after the flight's end they say what they said then.
    #[must_use]
    pub fn truth_at(&self, t: Duration) -> Truth {
        let t = t.min(self.flight.duration());
        let sample = self.flight.sample(t);
        let mut truth = Truth::nothing();
        let now = self.first_second + t.as_secs_f64();
        let day = self.first_day + (now / 86_400.0).floor();
        put(
            &mut truth,
            &[
                (P::UtcTimeOfDay, now.rem_euclid(86_400.0)),
                (P::UtcDate, day),
            ],
        );
        motion(&mut truth, &sample);
        self.air(&mut truth, &sample);
        position(&mut truth, &sample);
        let above_ground = sample.altitude_msl.0 - self.ground_m;
        truth.set(P::HeightAgl, Ok(above_ground));
        let year = magnetic::decimal_year(day);
        magnetics(&mut truth, magnetic::variation(&sample.position, year).ok());
        self.selected(&mut truth);
        self.engine(&mut truth, t, &sample);
        let start = self.flight.sample(Duration::ZERO).position;
        truth.traffic = self.others.iter().map(|o| other_at(o, &start, t)).collect();
        truth
    }

    fn air(&self, truth: &mut Truth, sample: &Sample) {
        let day = self.flight.day();
        let still = pressure_at(sample.pressure_altitude);
        let mach = sample.true_airspeed.0 / speed_of_sound(sample.temperature).0;
        // Isentropic flow of air (Gracey 1980, NASA RP-1046, equations 3.2 and 3.11).
        let warming = 1.0 + 0.2 * mach * mach;
        let total = still.0 * warming.powf(3.5);
        let impact = (total - still.0) / STANDARD_PRESSURE.0;
        let at_sea_level = speed_of_sound(Kelvin(288.15)).0;
        let calibrated = at_sea_level * (5.0 * ((impact + 1.0).powf(2.0 / 7.0) - 1.0)).sqrt();
        let wind = day.wind_mps;
        put(
            truth,
            &[
                (P::IndicatedAirspeed, calibrated),
                (P::CalibratedAirspeed, calibrated),
                (P::TrueAirspeed, sample.true_airspeed.0),
                (P::MachNumber, mach),
                (P::StaticPressure, still.0),
                (P::TotalPressure, total),
                (P::DifferentialPressure, total - still.0),
                (P::StaticAirTemperature, sample.temperature.0),
                (P::TotalAirTemperature, sample.temperature.0 * warming),
                (P::PressureAltitude, sample.pressure_altitude.0),
                (
                    P::BaroAltitude,
                    crate::atmosphere::indicated_altitude(sample.pressure_altitude, day.qnh).0,
                ),
                (P::BaroSetting, day.qnh.0),
                (P::VerticalSpeed, sample.vertical_speed.0),
                (P::TotalEnergyVerticalSpeed, sample.vertical_speed.0),
                (
                    P::DensityAltitude,
                    density_altitude(Hectopascals(still.0), sample.temperature).0,
                ),
                (P::WindSpeed, wind.length()),
                (
                    P::WindDirectionTrue,
                    wrap_turn(Radians((-wind.y).atan2(-wind.x))).0,
                ),
            ],
        );
    }

    fn selected(&self, truth: &mut Truth) {
        let bugs = &self.bugs;
        let mut set = |parameter, value: Option<f64>| {
            truth.set(parameter, value.ok_or(Invalid::NeverReceived));
        };
        set(
            P::SelectedHeading,
            bugs.heading_deg
                .map(|x| wrap_turn(Radians::from_degrees(x)).0),
        );
        set(
            P::SelectedCourse,
            bugs.course_deg
                .map(|x| wrap_turn(Radians::from_degrees(x)).0),
        );
        set(
            P::SelectedAltitude,
            bugs.altitude_ft.map(|x| Metres::from(Feet(x)).0),
        );
        set(
            P::SelectedAirspeed,
            bugs.airspeed_kt.map(|x| MetresPerSecond::from(Knots(x)).0),
        );
        set(
            P::SelectedVerticalSpeed,
            bugs.climb_fpm
                .map(|x| MetresPerSecond::from(FeetPerMinute(x)).0),
        );
    }

    /// Engine speed at a time, and the mean so far.
    fn rpm(&self, t: Duration) -> (f64, f64) {
        let (mut sum, mut from) = (0.0, Duration::ZERO);
        for (end, rpm) in &self.engine {
            if t < *end {
                let here = (t - from).as_secs_f64();
                return (*rpm, (sum + rpm * here) / t.as_secs_f64().max(1e-3));
            }
            sum += rpm * (*end - from).as_secs_f64();
            from = *end;
        }
        let last = self.engine.last().map_or(0.0, |(_, rpm)| *rpm);
        (last, sum / from.as_secs_f64().max(1e-3))
    }

    /// An engine with four cylinders, roughly; its fuel is what the mean power has used.
    fn engine(&self, truth: &mut Truth, t: Duration, sample: &Sample) {
        let (rpm, mean_rpm) = self.rpm(t);
        let s = t.as_secs_f64();
        // It never runs quite evenly.
        let rpm = rpm * (1.0 + 0.002 * (1.7 * s).sin());
        let power = (rpm / FULL_RPM).powi(3);
        let flow = FULL_FLOW_LPH * power;
        let used = FULL_FLOW_LPH * (mean_rpm / FULL_RPM).powi(3) * s / 3600.0;
        let pressure = pressure_at(sample.pressure_altitude).0;
        put(
            truth,
            &[
                (P::EngineSpeed, rpm),
                (
                    P::ManifoldPressure,
                    pressure * (0.35 + 0.6 * rpm / FULL_RPM),
                ),
                (P::FuelFlow, flow),
                (P::FuelPressure, 310.0 + 10.0 * (0.3 * s).sin()),
                (P::OilPressure, 4100.0 + 60.0 * (0.2 * s).sin()),
                (P::OilTemperature, 363.0 + 6.0 * power),
                (P::CoolantTemperature, 358.0 + 8.0 * power),
                (P::EngineTime, 512.0 + s / 3600.0),
                (P::TachometerTime, 448.0 + s / 3600.0),
                (P::EnginePower, 100.0 * power),
                (P::FuelRemaining, (2.0 * TANK_L - used).max(0.0)),
                (FUEL_QUANTITY[0], (TANK_L - used / 2.0).max(0.0)),
                (FUEL_QUANTITY[1], (TANK_L - used / 2.0).max(0.0)),
                (BUS_VOLTAGE[0], 13.9 + 0.1 * (0.7 * s).sin()),
                (BUS_CURRENT[0], 12.0 + (0.4 * s).sin()),
            ],
        );
        for n in 0..4_u8 {
            let cylinder = f64::from(n);
            let (head, exhaust) = (
                engines::CYLINDER_HEAD_TEMPERATURE[0][usize::from(n)],
                engines::EXHAUST_GAS_TEMPERATURE[0][usize::from(n)],
            );
            truth.set(head, Ok(430.0 + 30.0 * power + 4.0 * cylinder));
            truth.set(exhaust, Ok(930.0 + 90.0 * power - 7.0 * cylinder));
        }
    }
}

fn put(truth: &mut Truth, values: &[(Parameter, f64)]) {
    for (parameter, value) in values {
        truth.set(*parameter, Ok(*value));
    }
}

fn motion(truth: &mut Truth, sample: &Sample) {
    let [roll_rate, pitch_rate, yaw_rate] = sample.rates_radps.to_array();
    let [forward, right, up] = sample.felt_g.to_array();
    let attitude = sample.attitude;
    let (sin_roll, cos_roll) = attitude.roll.0.sin_cos();
    // The heading's rate (Stevens and Lewis 2003, equation 1.4-4).
    let turn = (pitch_rate * sin_roll + yaw_rate * cos_roll) / attitude.pitch.0.cos();
    put(
        truth,
        &[
            (P::Pitch, attitude.pitch.0),
            (P::Roll, attitude.roll.0),
            (P::HeadingTrue, attitude.heading_true.0),
            (P::RollRate, roll_rate),
            (P::PitchRate, pitch_rate),
            (P::YawRate, yaw_rate),
            (P::TurnRate, turn),
            (P::LongitudinalAcceleration, forward),
            (P::LateralAcceleration, right),
            (P::NormalAcceleration, up),
            (P::SlipBall, -right.atan2(up)),
            (P::Sideslip, 0.0),
            (P::AngleOfAttack, sample.angle_of_attack.0),
            (
                P::AngleOfAttackUsed,
                (100.0 * sample.angle_of_attack.0 / STALL_RAD).clamp(0.0, 99.0),
            ),
            (P::FlapAngle, 0.0),
        ],
    );
}

fn position(truth: &mut Truth, sample: &Sample) {
    put(
        truth,
        &[
            (P::Latitude, sample.position.latitude.0),
            (P::Longitude, wrap_signed(sample.position.longitude).0),
            (P::HeightEllipsoid, sample.position.height_ellipsoid.0),
            (P::AltitudeMsl, sample.altitude_msl.0),
            (P::GroundSpeed, sample.ground_speed.0),
            (P::Track, sample.track.0),
            (P::FixDimensions, 3.0),
            (P::SatellitesUsed, 11.0),
            (P::HorizontalAccuracy, 2.1),
            (P::VerticalAccuracy, 3.4),
            (P::HorizontalDilution, 0.8),
        ],
    );
}

/// What is counted from magnetic north.
fn magnetics(truth: &mut Truth, variation: Option<Radians>) {
    for (of, from) in [
        (P::HeadingMagnetic, P::HeadingTrue),
        (P::TrackMagnetic, P::Track),
        (P::WindDirectionMagnetic, P::WindDirectionTrue),
    ] {
        let value = truth.get(from).and_then(|x| {
            let variation = variation.ok_or(Invalid::SourceFailed)?;
            Ok(wrap_turn(Radians(x - variation.0)).0)
        });
        truth.set(of, value);
    }
    let variation = variation.ok_or(Invalid::SourceFailed).map(|v| v.0);
    truth.set(P::MagneticVariation, variation);
}

/// Another aircraft, which flies straight on from where it began.
fn other_at(other: &Other, start: &Geodetic, t: Duration) -> Aircraft {
    let s = t.as_secs_f64();
    let gone = other.ground_speed_mps * s;
    let north = other.distance_m * other.bearing_rad.cos() + gone * other.track_rad.cos();
    let east = other.distance_m * other.bearing_rad.sin() + gone * other.track_rad.sin();
    let (sin, cos) = start.latitude.0.sin_cos();
    Aircraft {
        address: other.address,
        callsign: other.callsign,
        latitude_rad: start.latitude.0 + north / meridian_radius_m(sin),
        longitude_rad: wrap_signed(Radians(
            start.longitude.0 + east / (prime_vertical_radius_m(sin) * cos),
        ))
        .0,
        pressure_altitude_m: other.pressure_altitude_m + other.vertical_speed_mps * s,
        track_rad: wrap_turn(Radians(other.track_rad)).0,
        ground_speed_mps: other.ground_speed_mps,
        vertical_speed_mps: other.vertical_speed_mps,
        alert: match other.alert {
            0 => Alert::None,
            1 => Alert::Low,
            2 => Alert::Important,
            _ => Alert::Urgent,
        },
    }
}
