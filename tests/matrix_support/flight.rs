//! The flight: turns, speeds and a long climb over Puget Sound, coordinated, in a wind that freshens and veers, with the noise
//! that sensors have. Whatever can move does: what stands still there is wrong before long.

use glasswing::bench::Truth;
use glasswing::signal::Parameter::{self, *};
use std::f64::consts::TAU;
use std::time::Duration;

const STEP_MS: u64 = 10;
/// As long as the longest trial.
const SECONDS: u64 = 130;

/// North of true north is magnetic north there, by the World Magnetic Model.
const VARIATION: f64 = 15.2 * TAU / 360.0;
/// The wind: 26 m/s from 240 degrees at first, a knot more every three seconds, half a degree to the right every second.
fn wind(t: f64) -> (f64, f64) {
    (26.0 + 0.17 * t, (240.0 + 0.5 * t).to_radians())
}

/// The setting of the altimeter, hPa; its knob is turned once.
fn setting(t: f64) -> f64 {
    if t < 25.0 { 1018.0 } else { 1003.0 }
}

/// What an altimeter shows at a setting above what it shows at 1013.25 hPa, m: the US National Weather Service's formula of
/// pressure altitude.
fn set_to(setting_hpa: f64) -> f64 {
    -(1.0 - (setting_hpa / 1013.25).powf(0.190_284)) * 145_366.45 * 0.3048
}

type Moment = [f64; Parameter::COUNT];

/// What is true, every hundredth of a second.
#[derive(Debug)]
pub(crate) struct Flight {
    moments: Vec<Moment>,
}

/// By how much a value that was worked out from others may be off: rounding of its inputs, time between them.
pub(crate) const fn derived_tolerance(parameter: Parameter) -> f64 {
    match parameter {
        HeadingTrue | HeadingMagnetic => 0.03,
        Track | TrackMagnetic => 0.2,
        WindDirectionTrue | WindDirectionMagnetic => 1.2,
        TurnRate => 0.15,
        VerticalSpeed | WindSpeed => 4.0,
        TrueAirspeed => 6.0,
        DensityAltitude => 200.0,
        _ => 0.001,
    }
}

/// Evenly distributed from -1 to 1, without a pattern (Steele 2014, "Fast splittable pseudorandom number generators").
fn noise(n: u64) -> f64 {
    let mut x = n.wrapping_add(0x9E37_79B9_7F4A_7C15);
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    f64::from(u32::try_from((x ^ (x >> 31)) >> 32).unwrap_or(0)) / f64::from(u32::MAX) * 2.0 - 1.0
}

/// How noisy a sensor is.
const fn noise_of(parameter: Parameter) -> f64 {
    match parameter {
        Pitch | Roll => 0.005,
        TurnRate => 0.01,
        LateralAcceleration => 0.03,
        SlipBall => 0.01,
        IndicatedAirspeed | CalibratedAirspeed | TrueAirspeed => 0.4,
        HeadingTrue | HeadingMagnetic => 0.01,
        VerticalSpeed => 0.3,
        PressureAltitude | BaroAltitude | DensityAltitude => 1.0,
        _ => 0.0,
    }
}

/// What a receiver says of itself.
const RECEIVER: [(Parameter, f64); 6] = [
    (FixDimensions, 3.0),
    (SatellitesUsed, 11.0),
    (HorizontalAccuracy, 3.0),
    (VerticalAccuracy, 5.0),
    (HorizontalDilution, 0.9),
    (UtcDate, 20_779.0),
];

/// What no instrument of the six shows.
fn rest(t: f64, height: f64, roll: f64, turn: f64, set: &mut impl FnMut(Parameter, f64)) {
    // The hypsometric formula of the standard atmosphere, its numbers rounded.
    set(
        StaticPressure,
        1013.25 * (1.0 - height / 44_330.8).powf(5.255_9),
    );
    set(RollRate, 0.105 * (0.35 * t).cos());
    set(PitchRate, turn * roll.sin());
    set(YawRate, turn * roll.cos());
    set(NormalAcceleration, 1.0 / roll.cos());
    for (p, x) in RECEIVER {
        set(p, x);
    }
    set(UtcTimeOfDay, 43_200.0 + t);
    set(EngineSpeed, 2400.0 + 20.0 * t.sin());
}

impl Flight {
    pub(crate) fn new() -> Self {
        let (mut heading, mut north, mut east, mut height) = (1.0_f64, 0.0, 0.0, 1000.0);
        let mut moments = Vec::new();
        for n in 0..SECONDS * 1000 / STEP_MS {
            #[expect(clippy::cast_precision_loss, reason = "a few thousand")]
            let t = (n * STEP_MS) as f64 / 1000.0;
            let dt = 0.01;
            let airspeed = 66.0 + 3.0 * (0.5 * t).sin() + 9.0 * (0.1 * t).sin();
            let roll = 0.3 * (0.35 * t).sin() + 0.12;
            let turn = 9.806_65 * roll.tan() / airspeed;
            let climb = 10.0 + 5.0 * (0.3 * t).sin();
            heading += turn * dt;
            height += climb * dt;
            let (wind, from) = wind(t);
            let speed_north = airspeed * heading.cos() - wind * from.cos();
            let speed_east = airspeed * heading.sin() - wind * from.sin();
            north += speed_north * dt;
            east += speed_east * dt;
            let latitude = 47.5_f64.to_radians() + north / 6_366_000.0;
            let longitude = -122.3_f64.to_radians() + east / (6_389_000.0 * latitude.cos());
            let track = speed_east.atan2(speed_north);
            let mut m = [f64::NAN; Parameter::COUNT];
            let mut set = |p: Parameter, x: f64| {
                let x = x + noise_of(p) * noise(n * 997 + p as u64);
                m[p.index()] = if turns(p) && p != Longitude {
                    x.rem_euclid(TAU)
                } else {
                    x
                };
            };
            set(Pitch, 0.05 + 0.05 * (0.6 * t).sin());
            set(Roll, roll);
            // Roll alone among the angles that turn is signed.
            set(HeadingTrue, heading);
            set(HeadingMagnetic, heading - VARIATION);
            set(IndicatedAirspeed, airspeed - 4.5);
            set(CalibratedAirspeed, airspeed - 4.0);
            set(TrueAirspeed, airspeed);
            set(PressureAltitude, height);
            set(BaroAltitude, height + set_to(setting(t)));
            set(AltitudeMsl, height + 55.0);
            set(HeightEllipsoid, height + 35.0);
            set(HeightAgl, height - 300.0 - 40.0 * (0.05 * t).sin());
            set(DensityAltitude, height + 180.0);
            set(VerticalSpeed, climb);
            set(LateralAcceleration, 0.05 * (0.9 * t).sin());
            set(SlipBall, 0.05 * (0.9 * t).sin());
            set(TurnRate, turn);
            set(Latitude, latitude);
            set(Longitude, longitude);
            set(GroundSpeed, speed_north.hypot(speed_east));
            set(Track, track);
            set(TrackMagnetic, track - VARIATION);
            set(MagneticVariation, VARIATION);
            set(BaroSetting, setting(t));
            set(StaticAirTemperature, 288.0 - 0.006_5 * height);
            set(WindSpeed, wind);
            set(WindDirectionTrue, from);
            set(WindDirectionMagnetic, from - VARIATION);
            rest(t, height, roll, turn, &mut set);
            moments.push(m);
        }
        Self { moments }
    }

    fn index(t: Duration) -> usize {
        usize::try_from(t.as_millis() / u128::from(STEP_MS)).unwrap_or(usize::MAX)
    }

    /// What the sensors say at a time.
    pub(crate) fn at(&self, t: Duration, truth: &mut Truth) {
        if let Some(moment) = self.moments.get(Self::index(t)) {
            for (parameter, value) in Parameter::ALL.iter().zip(moment) {
                if value.is_finite() {
                    truth.set(*parameter, Ok(*value));
                }
            }
        }
    }

    /// How far a value is from anything that was true as long ago as the parameter may be old, and a picture.
    pub(crate) fn off(
        &self,
        parameter: Parameter,
        value: f64,
        now: Duration,
        late: Duration,
    ) -> f64 {
        let oldest = now.saturating_sub(parameter.spec().age_max + super::FRAME + late);
        let apart = |moment: &Moment| {
            let apart = (value - moment[parameter.index()]).abs();
            if turns(parameter) {
                apart.min((apart - TAU).abs())
            } else {
                apart
            }
        };
        let end = (Self::index(now) + 1).min(self.moments.len());
        let recent = self.moments.get(Self::index(oldest).min(end)..end);
        let recent = recent.unwrap_or_default();
        recent.iter().map(apart).fold(f64::INFINITY, f64::min)
    }
}

const fn turns(parameter: Parameter) -> bool {
    matches!(
        parameter,
        HeadingTrue
            | HeadingMagnetic
            | Track
            | TrackMagnetic
            | Longitude
            | WindDirectionTrue
            | WindDirectionMagnetic
    )
}
