//! Universal Transverse Mercator on WGS 84: geographic coordinates to a zone's eastings and northings, and back.
//!
//! Source: C. F. F. Karney, "Transverse Mercator with an accuracy of a few nanometers", J. Geodesy 85 (2011), equations 7
//! to 12, 14, 15, 21, 35 and 36 (Krüger's series in the third flattening to sixth order: a few nanometres within 3900 km
//! of the central meridian). Scale and false origins: NGA.SIG.0012 (2014), "The Universal Grids", section 3. Pure.

use crate::geo::{WGS84_A_M, WGS84_E2, WGS84_F};
use crate::units::Radians;

const N: f64 = WGS84_F / (2.0 - WGS84_F);

/// Powers of the third flattening, from the first on.
const fn series(coefficients: [f64; 6]) -> f64 {
    let mut sum = 0.0;
    let mut at = 6;
    while at > 0 {
        at -= 1;
        sum = (sum + coefficients[at]) * N;
    }
    sum
}

/// The rectifying radius, metres (Karney, equation 14).
const RECTIFYING_RADIUS_M: f64 =
    WGS84_A_M / (1.0 + N) * (1.0 + series([0.0, 1.0 / 4.0, 0.0, 1.0 / 64.0, 0.0, 1.0 / 256.0]));

/// Karney, equation 35.
const ALPHA: [f64; 6] = [
    series([
        1.0 / 2.0,
        -2.0 / 3.0,
        5.0 / 16.0,
        41.0 / 180.0,
        -127.0 / 288.0,
        7891.0 / 37_800.0,
    ]),
    series([
        0.0,
        13.0 / 48.0,
        -3.0 / 5.0,
        557.0 / 1440.0,
        281.0 / 630.0,
        -1_983_433.0 / 1_935_360.0,
    ]),
    series([
        0.0,
        0.0,
        61.0 / 240.0,
        -103.0 / 140.0,
        15_061.0 / 26_880.0,
        167_603.0 / 181_440.0,
    ]),
    series([
        0.0,
        0.0,
        0.0,
        49_561.0 / 161_280.0,
        -179.0 / 168.0,
        6_601_661.0 / 7_257_600.0,
    ]),
    series([
        0.0,
        0.0,
        0.0,
        0.0,
        34_729.0 / 80_640.0,
        -3_418_889.0 / 1_995_840.0,
    ]),
    series([0.0, 0.0, 0.0, 0.0, 0.0, 212_378_941.0 / 319_334_400.0]),
];

/// Karney, equation 36.
const BETA: [f64; 6] = [
    series([
        1.0 / 2.0,
        -2.0 / 3.0,
        37.0 / 96.0,
        -1.0 / 360.0,
        -81.0 / 512.0,
        96_199.0 / 604_800.0,
    ]),
    series([
        0.0,
        1.0 / 48.0,
        1.0 / 15.0,
        -437.0 / 1440.0,
        46.0 / 105.0,
        -1_118_711.0 / 3_870_720.0,
    ]),
    series([
        0.0,
        0.0,
        17.0 / 480.0,
        -37.0 / 840.0,
        -209.0 / 4480.0,
        5569.0 / 90_720.0,
    ]),
    series([
        0.0,
        0.0,
        0.0,
        4397.0 / 161_280.0,
        -11.0 / 504.0,
        -830_251.0 / 7_257_600.0,
    ]),
    series([
        0.0,
        0.0,
        0.0,
        0.0,
        4583.0 / 161_280.0,
        -108_847.0 / 3_991_680.0,
    ]),
    series([0.0, 0.0, 0.0, 0.0, 0.0, 20_648_693.0 / 638_668_800.0]),
];

/// Scale on the central meridian.
const SCALE: f64 = 0.9996;
/// Easting of the central meridian, metres.
const FALSE_EASTING_M: f64 = 500_000.0;
/// Northing of the equator in southern zones, metres.
const FALSE_NORTHING_M: f64 = 10_000_000.0;

/// A zone of UTM on WGS 84.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Zone {
    /// 1 (177 degrees west) to 60 (177 degrees east).
    pub number: u8,
    /// Whether northings count from 10 000 km south of the equator.
    pub south: bool,
}

impl Zone {
    /// The zone of an EPSG code: 32601 to 32660 and 32701 to 32760 (IOGP's EPSG dataset).
    #[must_use]
    pub fn from_epsg(code: u16) -> Option<Self> {
        let number = u8::try_from(code % 100).ok()?;
        let south = match code / 100 {
            326 => false,
            327 => true,
            _ => return None,
        };
        (1..=60).contains(&number).then_some(Self { number, south })
    }

    /// Longitude of its central meridian.
    fn central(self) -> f64 {
        (6.0 * f64::from(self.number) - 183.0).to_radians()
    }

    fn false_northing_m(self) -> f64 {
        if self.south { FALSE_NORTHING_M } else { 0.0 }
    }

    /// Whether a rectangle of eastings and northings in metres, given by its south-west and north-east corners, lies where
    /// the zone's grid is of use: within 85 degrees of latitude and two zones on either side.
    #[must_use]
    pub fn covers(self, south_west: (f64, f64), north_east: (f64, f64)) -> bool {
        // A quarter of the meridian is 10 002 km; a degree of latitude there 112 km; zones are 667 km wide at most.
        const BESIDE_M: f64 = 1_700_000.0;
        const NORTH_M: f64 = 9_440_000.0;
        let across = FALSE_EASTING_M - BESIDE_M..=FALSE_EASTING_M + BESIDE_M;
        let up = self.false_northing_m() - NORTH_M..=self.false_northing_m() + NORTH_M;
        [south_west, north_east]
            .iter()
            .all(|(x, y)| across.contains(x) && up.contains(y))
    }

    /// Easting and northing of a place, metres. Meaningful to 80 degrees from the central meridian.
    #[must_use]
    pub fn project(self, latitude: Radians, longitude: Radians) -> (f64, f64) {
        let e = WGS84_E2.sqrt();
        let (sin, lambda) = (latitude.0.sin(), longitude.0 - self.central());
        let conformal = (sin.atanh() - e * (e * sin).atanh()).sinh();
        let xi = conformal.atan2(lambda.cos());
        let eta = (lambda.sin() / conformal.hypot(lambda.cos())).asinh();
        let (mut x, mut y) = (eta, xi);
        for (turn, alpha) in (1_u8..).zip(ALPHA) {
            let k = 2.0 * f64::from(turn);
            y += alpha * (k * xi).sin() * (k * eta).cosh();
            x += alpha * (k * xi).cos() * (k * eta).sinh();
        }
        let metres = SCALE * RECTIFYING_RADIUS_M;
        (
            FALSE_EASTING_M + metres * x,
            self.false_northing_m() + metres * y,
        )
    }

    /// Latitude and longitude of an easting and northing in metres; the longitude within half a turn of the zone's central
    /// meridian, so that it may lie beyond 180 degrees.
    #[must_use]
    pub fn unproject(self, easting_m: f64, northing_m: f64) -> (Radians, Radians) {
        let metres = SCALE * RECTIFYING_RADIUS_M;
        let eta = (easting_m - FALSE_EASTING_M) / metres;
        let xi = (northing_m - self.false_northing_m()) / metres;
        let (mut x, mut y) = (eta, xi);
        for (turn, beta) in (1_u8..).zip(BETA) {
            let k = 2.0 * f64::from(turn);
            y -= beta * (k * xi).sin() * (k * eta).cosh();
            x -= beta * (k * xi).cos() * (k * eta).sinh();
        }
        let conformal = y.sin() / x.sinh().hypot(y.cos());
        let longitude = self.central() + x.sinh().atan2(y.cos());
        (Radians(geographic(conformal)), Radians(longitude))
    }
}

/// The latitude whose conformal latitude has this tangent: Newton's method, Karney's equations 19 to 21.
fn geographic(conformal: f64) -> f64 {
    let e = WGS84_E2.sqrt();
    let mut tau = conformal;
    for _ in 0..6 {
        let secant = tau.hypot(1.0);
        let sigma = (e * (e * tau / secant).atanh()).sinh();
        let at = tau * sigma.hypot(1.0) - sigma * secant;
        let step = (conformal - at) / at.hypot(1.0) * (1.0 + (1.0 - WGS84_E2) * tau * tau)
            / ((1.0 - WGS84_E2) * secant);
        tau += step;
        if step.abs() <= 1e-15 * secant {
            break;
        }
    }
    tau.atan()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Degrees north and east, zone, south, easting, northing: by PROJ 9.5.1 (an independent implementation of another
    /// series, Poder and Engsager's), rounded to a tenth of a millimetre.
    const PROJ: [(f64, f64, u8, bool, f64, f64); 9] = [
        (
            43.642_566_7,
            -79.387_138_9,
            17,
            false,
            630_084.309_5,
            4_833_438.552_5,
        ),
        (0.0, 12.0, 33, false, 166_021.443_1, 0.0),
        (0.0, 9.0, 32, false, 500_000.0, 0.0),
        (51.5, 14.0, 33, false, 430_588.048_9, 5_705_903.240_2),
        (83.9, 17.9, 33, false, 534_390.831_3, 9_317_795.753_3),
        (-33.0, -70.5, 19, true, 359_869.686_7, 6_347_713.885_1),
        (-79.9, -177.5, 1, true, 490_211.344_7, 1_129_533.628_4),
        (60.3, 5.0, 32, false, 279_003.806_5, 6_691_527.154_4),
        (45.0, 21.5, 33, false, 1_012_299.123_5, 5_003_542.821_3),
    ];

    #[test]
    fn eastings_and_northings_agree_with_another_implementation() {
        for (latitude, longitude, number, south, easting, northing) in PROJ {
            let zone = Zone { number, south };
            let (x, y) = zone.project(
                Radians::from_degrees(latitude),
                Radians::from_degrees(longitude),
            );
            assert!(
                (x - easting).abs() < 1e-4 && (y - northing).abs() < 1e-4,
                "{latitude} {longitude}: {x} {y}"
            );
            let (phi, lambda) = zone.unproject(x, y);
            assert!(
                (phi.to_degrees() - latitude).abs() < 1e-12
                    && (lambda.to_degrees() - longitude).abs() < 1e-12,
                "there and back: {latitude} {longitude}"
            );
        }
    }

    #[test]
    fn zones_have_their_codes() {
        let zone = |number, south| Some(Zone { number, south });
        assert_eq!(Zone::from_epsg(32_633), zone(33, false));
        assert_eq!(Zone::from_epsg(32_701), zone(1, true));
        for other in [32_600, 32_661, 32_700, 32_761, 4326, 25_833] {
            assert_eq!(Zone::from_epsg(other), None, "{other}");
        }
    }
}
