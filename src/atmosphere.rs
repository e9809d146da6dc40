//! The formulas of the ICAO standard atmosphere that altimeters and airspeed indicators need: what a barometric setting is
//! worth in metres, density altitude, true airspeed.
//!
//! Source: ICAO Doc 7488/3, Manual of the ICAO Standard Atmosphere (1993), equations of the layer below 11 km: temperature
//! 288.15 K at sea level, lapse 6.5 K per geopotential kilometre, gas constant 287.052 87 J/(kg K), standard gravity.

use crate::units::{Hectopascals, Kelvin, Metres, MetresPerSecond, STANDARD_GRAVITY_MPS2};

/// Sea level pressure of the standard atmosphere (ICAO Doc 7488/3, table A).
pub const STANDARD_PRESSURE: Hectopascals = Hectopascals(1013.25);
/// Sea level temperature, K (ICAO Doc 7488/3, table A).
const SEA_LEVEL_TEMPERATURE_K: f64 = 288.15;
/// Temperature lapse below 11 km, K/m (ICAO Doc 7488/3, table D).
const LAPSE_KPM: f64 = 0.006_5;
/// Specific gas constant of air, J/(kg K) (ICAO Doc 7488/3, table A).
const GAS_CONSTANT: f64 = 287.052_87;

/// The altitude in the standard atmosphere at which the pressure is `pressure`, below 11 km.
#[must_use]
pub fn pressure_altitude(pressure: Hectopascals) -> Metres {
    let exponent = LAPSE_KPM * GAS_CONSTANT / STANDARD_GRAVITY_MPS2;
    let ratio = (pressure.0 / STANDARD_PRESSURE.0).powf(exponent);
    Metres(SEA_LEVEL_TEMPERATURE_K / LAPSE_KPM * (1.0 - ratio))
}

/// What an altimeter with the given setting shows at the given pressure altitude: the height between the two pressure
/// surfaces in the standard atmosphere, which is how an altimeter's subscale works (it shows 0 where the pressure is the
/// setting).
#[must_use]
pub fn indicated_altitude(pressure_altitude_now: Metres, setting: Hectopascals) -> Metres {
    pressure_altitude_now - pressure_altitude(setting)
}

/// The pressure at an altitude of the standard atmosphere below 11 km.
#[must_use]
pub fn pressure_at(altitude: Metres) -> Hectopascals {
    let exponent = STANDARD_GRAVITY_MPS2 / (LAPSE_KPM * GAS_CONSTANT);
    let ratio = 1.0 - LAPSE_KPM * altitude.0 / SEA_LEVEL_TEMPERATURE_K;
    Hectopascals(STANDARD_PRESSURE.0 * ratio.max(0.0).powf(exponent))
}

/// The altitude of the standard atmosphere, below 11 km, that has the density of air of this pressure and temperature: by the
/// gas law, `density / standard = (p / p0) (T0 / T)`, and the density of the standard atmosphere (ICAO Doc 7488/3, equation
/// for density below 11 km), whose exponent is that of the pressure less one.
#[must_use]
pub fn density_altitude(pressure: Hectopascals, temperature: Kelvin) -> Metres {
    let density = pressure.0 / STANDARD_PRESSURE.0 * SEA_LEVEL_TEMPERATURE_K / temperature.0;
    let exponent = STANDARD_GRAVITY_MPS2 / (LAPSE_KPM * GAS_CONSTANT) - 1.0;
    Metres(SEA_LEVEL_TEMPERATURE_K / LAPSE_KPM * (1.0 - density.powf(1.0 / exponent)))
}

/// Ratio of the specific heats of air (ICAO Doc 7488/3, table A).
const HEAT_RATIO: f64 = 1.4;

/// The speed of sound, `sqrt(1.4 R T)` (ICAO Doc 7488/3, equation for the speed of sound).
#[must_use]
pub fn speed_of_sound(temperature: Kelvin) -> MetresPerSecond {
    MetresPerSecond((HEAT_RATIO * GAS_CONSTANT * temperature.0).sqrt())
}

/// True airspeed from calibrated airspeed below the speed of sound: the impact pressure that the airspeed indicator measures,
/// at the pressure and temperature of the air (Gracey 1980, "Measurement of Aircraft Speed and Altitude", NASA RP-1046,
/// equations 3.11 to 3.14).
#[must_use]
pub fn true_airspeed(
    calibrated: MetresPerSecond,
    pressure: Hectopascals,
    temperature: Kelvin,
) -> MetresPerSecond {
    let sea_level_sound = speed_of_sound(Kelvin(SEA_LEVEL_TEMPERATURE_K)).0;
    let mach_at_sea_level = calibrated.0 / sea_level_sound;
    let impact = (1.0 + 0.2 * mach_at_sea_level * mach_at_sea_level).powf(3.5) - 1.0;
    let impact_hpa = STANDARD_PRESSURE.0 * impact;
    let mach = (5.0 * ((impact_hpa / pressure.0 + 1.0).powf(2.0 / 7.0) - 1.0)).sqrt();
    MetresPerSecond(mach * speed_of_sound(temperature).0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::{Feet, InchesOfMercury, Knots};

    #[test]
    fn pressures_stand_at_the_altitudes_of_the_us_standard_atmosphere_1976() {
        // U.S. Standard Atmosphere 1976 (NOAA-S/T 76-1562), table I, geopotential altitude against pressure in mb. It is
        // identical to ICAO's below 32 km.
        for (altitude_m, pressure_hpa) in [
            (0.0, 1013.25),
            (500.0, 954.61),
            (1000.0, 898.74),
            (2000.0, 794.95),
            (5000.0, 540.19),
            (10_000.0, 264.36),
        ] {
            let got = pressure_altitude(Hectopascals(pressure_hpa)).0;
            assert!(
                (got - altitude_m).abs() < 0.3,
                "{pressure_hpa} hPa stands at {altitude_m} m, got {got}"
            );
        }
    }

    #[test]
    fn settings_are_worth_what_the_faa_table_says() {
        // FAA-H-8083-25B, Pilot's Handbook of Aeronautical Knowledge, chapter 11, the field elevation versus pressure
        // table: altimeter setting in inHg against feet to add for pressure altitude (rounded to 5 ft there; its last row,
        // 31.0, departs from the table's own steps and is left out).
        for (setting, add_ft) in [
            (28.0, 1825.0),
            (28.5, 1340.0),
            (29.0, 865.0),
            (29.5, 390.0),
            (29.92, 0.0),
            (30.5, -530.0),
            (30.9, -895.0),
        ] {
            let field = Metres::from(Feet(1000.0));
            let shown = Feet::from(indicated_altitude(field, InchesOfMercury(setting).into()));
            assert!(
                (1000.0 - shown.0 - add_ft).abs() < 15.0,
                "setting {setting}: shown {} ft at pressure altitude 1000 ft, table adds {add_ft}",
                shown.0
            );
        }
    }

    #[test]
    fn a_higher_setting_shows_a_higher_altitude() {
        let low = indicated_altitude(Metres(1000.0), Hectopascals(1000.0));
        let high = indicated_altitude(Metres(1000.0), Hectopascals(1020.0));
        assert!(
            high.0 - low.0 > 160.0 && high.0 - low.0 < 170.0,
            "8.3 m per hPa near sea level"
        );
        assert!(
            (indicated_altitude(Metres(1000.0), STANDARD_PRESSURE).0 - 1000.0).abs() < 1e-9,
            "at the standard setting it is the pressure altitude"
        );
    }

    #[test]
    fn pressure_and_density_are_those_of_the_us_standard_atmosphere_1976() {
        // U.S. Standard Atmosphere 1976, table I: geopotential altitude, pressure in mb, temperature in K. In the standard
        // atmosphere itself the density altitude is the altitude.
        for (altitude_m, pressure_hpa, temperature_k) in [
            (0.0, 1013.25, 288.15),
            (1000.0, 898.74, 281.65),
            (3000.0, 701.08, 268.65),
            (5000.0, 540.19, 255.65),
            (10_000.0, 264.36, 223.15),
        ] {
            let pressure = pressure_at(Metres(altitude_m)).0;
            assert!(
                (pressure - pressure_hpa).abs() < 0.01,
                "{altitude_m} m: {pressure}"
            );
            let density = density_altitude(Hectopascals(pressure_hpa), Kelvin(temperature_k));
            assert!(
                (density.0 - altitude_m).abs() < 0.5,
                "{altitude_m} m: {density:?}"
            );
        }
    }

    #[test]
    fn density_altitude_is_that_of_the_standard_atmospheres_own_table_on_a_hot_day() {
        // 898.74 hPa at 300 K: by the gas law 1.0436 kg/m3, which table I of the U.S. Standard Atmosphere 1976 has between
        // 1500 m (1.0581) and 2000 m (1.0066): 1640 m by its own even steps.
        let got = density_altitude(Hectopascals(898.74), Kelvin(300.0)).0;
        assert!((got - 1640.0).abs() < 3.0, "{got}");
    }

    #[test]
    fn true_airspeed_is_that_of_published_tables() {
        // NACA Report 1135 (1953), table I: static over total pressure is 0.8430 at Mach 0.5 and 0.7840 at Mach 0.6. What
        // is calibrated as Mach 0.5 at sea level has an impact pressure of 188.7 hPa; at 684.9 hPa that is Mach 0.6.
        let sound = speed_of_sound(Kelvin(SEA_LEVEL_TEMPERATURE_K)).0;
        let impact = STANDARD_PRESSURE.0 * (1.0 / 0.8430 - 1.0);
        let pressure = Hectopascals(impact / (1.0 / 0.7840 - 1.0));
        let calibrated = MetresPerSecond(0.5 * sound);
        let speed = true_airspeed(calibrated, pressure, Kelvin(250.0)).0;
        let mach = speed / speed_of_sound(Kelvin(250.0)).0;
        assert!((mach - 0.6).abs() < 2e-4, "{mach}");
        let at = |kt: f64, ft: f64| {
            let altitude = Metres::from(Feet(ft));
            let temperature = Kelvin(SEA_LEVEL_TEMPERATURE_K - LAPSE_KPM * altitude.0);
            let speed = true_airspeed(Knots(kt).into(), pressure_at(altitude), temperature);
            Knots::from(speed).0
        };
        for kt in [0.0, 60.0, 250.0] {
            assert!((at(kt, 0.0) - kt).abs() < 1e-6, "{kt} kt at sea level");
        }
        // Slow flight: the square root of the density ratio, 0.8617 at 5000 ft (U.S. Standard Atmosphere 1976, table II).
        let slow = at(60.0, 5000.0);
        assert!((slow - 60.0 / 0.8617_f64.sqrt()).abs() < 0.05, "{slow}");
    }
}
