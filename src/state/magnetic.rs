//! Magnetic variation from the World Magnetic Model: how far magnetic north lies east of true north.
//!
//! The main field is a sum of spherical harmonics to degree 12 whose coefficients change evenly from 2025.0 to 2030.0; the
//! equations are those of the model's report (Chulliat et al. 2025, "The US/UK World Magnetic Model for 2025-2030", NOAA
//! NCEI, section 1.2: equations 4 to 16 and 19). The report gives the model's own error of declination as
//! `sqrt(0.26^2 + (5417 / H)^2)` degrees, H the horizontal intensity in nT: local anomalies are not in it. Where H is below
//! 2000 nT, near the magnetic poles, the report says not to trust a compass (*blackout zone*), and there is no variation here.

use super::wmm2025::COEFFICIENTS;
use crate::geo::Geodetic;
use crate::units::Radians;

/// The first moment of the model, a year with its fraction.
pub const VALID_FROM: f64 = 2025.0;
/// The end of the model: from then on its successor applies.
pub const VALID_UNTIL: f64 = 2030.0;
/// Below this horizontal intensity, nT, a compass and this model are worth nothing (the report's blackout zone).
pub const BLACKOUT_NT: f64 = 2000.0;

/// Highest degree.
const DEGREES: usize = 12;
/// The sphere on which the coefficients are given, m (the report, below equation 4).
const RADIUS_M: f64 = 6_371_200.0;

/// The field at one place, geodetic frame, nT.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Field {
    /// Northwards.
    pub north_nt: f64,
    /// Eastwards.
    pub east_nt: f64,
    /// Downwards.
    pub down_nt: f64,
}

impl Field {
    /// Horizontal intensity, nT.
    #[must_use]
    pub fn horizontal_nt(&self) -> f64 {
        self.north_nt.hypot(self.east_nt)
    }

    /// Variation: magnetic north as seen from true north, east positive.
    #[must_use]
    pub fn variation(&self) -> Radians {
        Radians(self.east_nt.atan2(self.north_nt))
    }
}

/// Why there is no variation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoVariation {
    /// The date lies outside of the model's years.
    Date,
    /// The place is none.
    Place,
    /// Too near to a magnetic pole.
    Blackout,
}

/// The variation at a place and a date, given as a year with its fraction.
///
/// # Errors
/// [`NoVariation`]; there is no extrapolation in time.
pub fn variation(place: &Geodetic, year: f64) -> Result<Radians, NoVariation> {
    if !(VALID_FROM..VALID_UNTIL).contains(&year) {
        return Err(NoVariation::Date);
    }
    if !place.is_valid() || !place.height_ellipsoid.0.is_finite() {
        return Err(NoVariation::Place);
    }
    let field = field(place, year);
    if field.horizontal_nt() < BLACKOUT_NT {
        return Err(NoVariation::Blackout);
    }
    Ok(field.variation())
}

/// A date as a year with its fraction, from the days since 1 January 1970 in the Gregorian calendar.
#[must_use]
pub fn decimal_year(days_since_1970: f64) -> f64 {
    // Whole years by their own lengths; a handful of steps from the model's epoch, 20 089 days after 1970.
    let mut year = 2025.0;
    let mut left = days_since_1970 - 20_089.0;
    for _ in 0..200 {
        let days = if is_leap(year) { 366.0 } else { 365.0 };
        if left < 0.0 {
            year -= 1.0;
            left += if is_leap(year) { 366.0 } else { 365.0 };
        } else if left >= days {
            year += 1.0;
            left -= days;
        } else {
            return year + left / days;
        }
    }
    f64::NAN
}

fn is_leap(year: f64) -> bool {
    let divides = |by: f64| year.rem_euclid(by) < 0.5;
    divides(4.0) && (!divides(100.0) || divides(400.0))
}

/// The field of the model, whatever the date.
#[must_use]
pub fn field(place: &Geodetic, year: f64) -> Field {
    let centred = place.to_ecef();
    let radius_m = centred.length();
    let sin_centred = centred.z / radius_m;
    let centred_latitude = sin_centred.asin();
    let legendre = Legendre::new(sin_centred, centred_latitude.cos());
    let t = year - VALID_FROM;
    let (mut north, mut east, mut down) = (0.0, 0.0, 0.0);
    let mut rows = COEFFICIENTS.iter();
    for n in 1..=DEGREES {
        #[expect(clippy::cast_precision_loss, reason = "at most 12")]
        let n_real = n as f64;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_possible_wrap,
            reason = "at most 12"
        )]
        let shrink = (RADIUS_M / radius_m).powi(n as i32 + 2);
        for (m, &[g, h, g_rate, h_rate]) in rows.by_ref().take(n + 1).enumerate() {
            #[expect(clippy::cast_precision_loss, reason = "at most 12")]
            let m_real = m as f64;
            let (g, h) = (g + t * g_rate, h + t * h_rate);
            let (sin, cos) = (m_real * place.longitude.0).sin_cos();
            let along = g * cos + h * sin;
            let across = g * sin - h * cos;
            north -= shrink * along * legendre.slope[n][m];
            east += shrink * m_real * across * legendre.over_cosine[n][m];
            down -= shrink * (n_real + 1.0) * along * legendre.value[n][m];
        }
    }
    // From the geocentric to the geodetic frame (equation 16).
    let (sin, cos) = (centred_latitude - place.latitude.0).sin_cos();
    Field {
        north_nt: north * cos - down * sin,
        east_nt: east,
        down_nt: north * sin + down * cos,
    }
}

/// Schmidt semi-normalised associated Legendre functions of the sine of the geocentric latitude.
struct Legendre {
    value: [[f64; DEGREES + 1]; DEGREES + 1],
    /// Derivative by the latitude.
    slope: [[f64; DEGREES + 1]; DEGREES + 1],
    /// Divided by the cosine of the latitude, for orders above zero: finite at the poles.
    over_cosine: [[f64; DEGREES + 1]; DEGREES + 1],
}

impl Legendre {
    /// By recursion in degree from the sectoral functions (Heiskanen and Moritz 1967, section 1-11, in Schmidt's
    /// normalisation: Winch et al. 2005, "Geomagnetism and Schmidt quasi-normalization", Geophys. J. Int. 160).
    fn new(sin: f64, cos: f64) -> Self {
        let mut value = [[0.0; DEGREES + 1]; DEGREES + 1];
        let mut slope = value;
        let mut over_cosine = value;
        value[0][0] = 1.0;
        for n in 1..=DEGREES {
            for m in 0..=n {
                #[expect(clippy::cast_precision_loss, reason = "at most 12")]
                let (n_real, m_real) = (n as f64, m as f64);
                if m == n {
                    // The step from order 0 to 1 has another normalisation than all later ones.
                    let k = if n == 1 {
                        1.0
                    } else {
                        ((2.0 * n_real - 1.0) / (2.0 * n_real)).sqrt()
                    };
                    let before = value[n - 1][n - 1];
                    value[n][n] = k * cos * before;
                    slope[n][n] = k * (cos * slope[n - 1][n - 1] - sin * before);
                    over_cosine[n][n] = k * if n == 1 {
                        before
                    } else {
                        cos * over_cosine[n - 1][n - 1]
                    };
                    continue;
                }
                let norm = (n_real * n_real - m_real * m_real).sqrt();
                let a = (2.0 * n_real - 1.0) / norm;
                let b = if n >= 2 {
                    ((n_real - 1.0) * (n_real - 1.0) - m_real * m_real)
                        .max(0.0)
                        .sqrt()
                        / norm
                } else {
                    0.0
                };
                let older = |table: &[[f64; DEGREES + 1]; DEGREES + 1]| {
                    if n >= 2 { table[n - 2][m] } else { 0.0 }
                };
                value[n][m] = a * sin * value[n - 1][m] - b * older(&value);
                slope[n][m] =
                    a * (sin * slope[n - 1][m] + cos * value[n - 1][m]) - b * older(&slope);
                over_cosine[n][m] = a * sin * over_cosine[n - 1][m] - b * older(&over_cosine);
            }
        }
        Self {
            value,
            slope,
            over_cosine,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// NOAA's own: see the head of the file.
    const VALUES: &str = include_str!("wmm2025_test_values.txt");

    #[test]
    fn the_field_is_that_of_noaas_published_test_values() {
        let mut rows = 0;
        for line in VALUES.lines().filter(|line| !line.starts_with('#')) {
            let v: Vec<f64> = line.split(' ').filter_map(|x| x.parse().ok()).collect();
            let [year, km, lat, lon, declination, _, horizontal, x, y, z, _] = v[..] else {
                unreachable!("eleven numbers: {line}");
            };
            let place = Geodetic::from_degrees(lat, lon, km * 1000.0);
            let field = field(&place, year);
            // Printed to 1e-6 nT and to 0.01 degrees.
            for (got, wanted) in [
                (field.north_nt, x),
                (field.east_nt, y),
                (field.down_nt, z),
                (field.horizontal_nt(), horizontal),
            ] {
                assert!((got - wanted).abs() < 0.001, "{line}: {got} for {wanted}");
            }
            let got = field.variation().to_degrees();
            let off = (got - declination + 180.0).rem_euclid(360.0) - 180.0;
            assert!(off.abs() <= 0.005_001, "{line}: declination {got}");
            rows += 1;
        }
        assert_eq!(rows, 100, "all of them");
    }

    #[test]
    fn outside_of_its_years_and_near_the_magnetic_poles_there_is_no_variation() {
        let prague = Geodetic::from_degrees(50.1, 14.4, 300.0);
        for (year, good) in [
            (2024.999, false),
            (2025.0, true),
            (2029.999, true),
            (2030.0, false),
            (f64::NAN, false),
        ] {
            let got = variation(&prague, year);
            assert_eq!(got.is_ok(), good, "{year}: {got:?}");
            assert!(good || got == Err(NoVariation::Date), "{year}");
        }
        // The first of the test values: 1504 nT.
        let pole = Geodetic::from_degrees(89.0, -121.0, 28_000.0);
        assert_eq!(variation(&pole, 2025.0), Err(NoVariation::Blackout));
        let nowhere = Geodetic::from_degrees(91.0, 0.0, 0.0);
        assert_eq!(variation(&nowhere, 2026.0), Err(NoVariation::Place));
    }

    #[test]
    fn nothing_is_lost_at_the_geographic_poles() {
        for latitude in [90.0, -90.0] {
            let at = field(&Geodetic::from_degrees(latitude, 30.0, 0.0), 2026.0);
            let near = field(
                &Geodetic::from_degrees(latitude * 0.999_999_9, 30.0, 0.0),
                2026.0,
            );
            let off = (at.north_nt - near.north_nt).hypot(at.east_nt - near.east_nt);
            assert!(off < 0.1, "{at:?} {near:?}");
        }
    }

    #[test]
    fn dates_become_years() {
        for (days, year) in [
            (20_089.0, 2025.0),
            (20_454.0, 2026.0),
            // 1 July 2028, in a leap year: day 182 of 366.
            (21_366.0, 2028.0 + 182.0 / 366.0),
            (21_915.0, 2030.0),
            (0.0, 1970.0),
        ] {
            let got = decimal_year(days);
            assert!((got - year).abs() < 1e-9, "{days}: {got}");
        }
        assert!(decimal_year(f64::NAN).is_nan(), "no date, no year");
    }
}
