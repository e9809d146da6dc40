//! The one formula of the ICAO standard atmosphere that an altimeter needs: what a barometric setting is worth in metres.
//!
//! Source: ICAO Doc 7488/3, Manual of the ICAO Standard Atmosphere (1993), equations of the layer below 11 km: temperature
//! 288.15 K at sea level, lapse 6.5 K per geopotential kilometre, gas constant 287.052 87 J/(kg K), standard gravity.

use crate::units::{Hectopascals, Metres, STANDARD_GRAVITY_MPS2};

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::{Feet, InchesOfMercury};

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
}
