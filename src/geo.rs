//! Geodesy: WGS 84, geodetic and Earth-centred coordinates, local frames, and the camera.
//!
//! Frames: *ECEF* is Earth-centred, Earth-fixed (x through 0N 0E, y through 0N 90E, z through the north pole), metres.
//! *NED* is north, east, down at a point. *Body* is forward, right, down in the aircraft. Attitude is the Z-Y-X sequence
//! heading, pitch, roll of ISO 1151-1: heading clockwise from true north, pitch nose up positive, roll right wing down
//! positive.

use crate::units::{Metres, Radians};
use glam::{DMat3, DVec3};
use std::ops::RangeInclusive;

/// WGS 84 semi-major axis, metres (NIMA TR8350.2, third edition, table 3.1).
pub const WGS84_A_M: f64 = 6_378_137.0;
/// WGS 84 flattening (NIMA TR8350.2, third edition, table 3.1).
pub const WGS84_F: f64 = 1.0 / 298.257_223_563;
/// WGS 84 first eccentricity squared, `f (2 - f)`.
pub const WGS84_E2: f64 = WGS84_F * (2.0 - WGS84_F);
/// WGS 84 semi-minor axis, metres.
pub const WGS84_B_M: f64 = WGS84_A_M * (1.0 - WGS84_F);

/// A position on or above the ellipsoid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geodetic {
    /// Geodetic latitude, north positive, -pi/2 to pi/2.
    pub latitude: Radians,
    /// Longitude, east positive.
    pub longitude: Radians,
    /// Height above the WGS 84 ellipsoid.
    pub height_ellipsoid: Metres,
}

impl Geodetic {
    /// From degrees north, degrees east and metres above the ellipsoid.
    #[must_use]
    pub fn from_degrees(latitude: f64, longitude: f64, height_ellipsoid_m: f64) -> Self {
        Self {
            latitude: Radians::from_degrees(latitude),
            longitude: Radians::from_degrees(longitude),
            height_ellipsoid: Metres(height_ellipsoid_m),
        }
    }

    /// Whether all three numbers are finite and the latitude is one.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.latitude.0.abs() <= std::f64::consts::FRAC_PI_2
            && self.longitude.0.is_finite()
            && self.height_ellipsoid.0.is_finite()
    }

    /// Earth-centred coordinates, metres (Heiskanen and Moritz 1967, equation 5-3).
    #[must_use]
    pub fn to_ecef(&self) -> DVec3 {
        let (sin_lat, cos_lat) = self.latitude.0.sin_cos();
        let (sin_lon, cos_lon) = self.longitude.0.sin_cos();
        let n = prime_vertical_radius_m(sin_lat);
        let h = self.height_ellipsoid.0;
        DVec3::new(
            (n + h) * cos_lat * cos_lon,
            (n + h) * cos_lat * sin_lon,
            (n * (1.0 - WGS84_E2) + h) * sin_lat,
        )
    }

    /// From Earth-centred coordinates, metres: Bowring's formula (Bowring 1985, "The accuracy of geodetic latitude and
    /// height equations", Survey Review 28) followed by two Newton-like refinements; below 1e-11 rad and 1e-8 m from
    /// 10 km below the surface to 20 000 km above it.
    #[must_use]
    pub fn from_ecef(p: DVec3) -> Self {
        let rho = p.x.hypot(p.y);
        let longitude = p.y.atan2(p.x);
        let ep2 = WGS84_E2 / (1.0 - WGS84_E2);
        // Parametric latitude as the start.
        let mut beta = (p.z * WGS84_A_M).atan2(rho * WGS84_B_M);
        let mut latitude = 0.0;
        for _ in 0..3 {
            let (s, c) = beta.sin_cos();
            latitude =
                (p.z + ep2 * WGS84_B_M * s * s * s).atan2(rho - WGS84_E2 * WGS84_A_M * c * c * c);
            let (sin_lat, cos_lat) = latitude.sin_cos();
            beta = ((1.0 - WGS84_F) * sin_lat).atan2(cos_lat);
        }
        let (sin_lat, cos_lat) = latitude.sin_cos();
        // The form that is well conditioned everywhere: project onto the normal.
        let height =
            rho * cos_lat + p.z * sin_lat - WGS84_A_M * (1.0 - WGS84_E2 * sin_lat * sin_lat).sqrt();
        Self {
            latitude: Radians(latitude),
            longitude: Radians(longitude),
            height_ellipsoid: Metres(height),
        }
    }

    /// The rotation from NED at this point to ECEF; its columns are north, east and down in ECEF.
    #[must_use]
    pub fn ned_to_ecef(&self) -> DMat3 {
        let (sin_lat, cos_lat) = self.latitude.0.sin_cos();
        let (sin_lon, cos_lon) = self.longitude.0.sin_cos();
        DMat3::from_cols(
            DVec3::new(-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat),
            DVec3::new(-sin_lon, cos_lon, 0.0),
            DVec3::new(-cos_lat * cos_lon, -cos_lat * sin_lon, -sin_lat),
        )
    }
}

/// Radius of curvature in the prime vertical, `a / sqrt(1 - e2 sin2 lat)`, metres, from the sine of the latitude.
#[must_use]
pub fn prime_vertical_radius_m(sin_latitude: f64) -> f64 {
    WGS84_A_M / (1.0 - WGS84_E2 * sin_latitude * sin_latitude).sqrt()
}

/// Radius of curvature in the meridian, `a (1 - e2) / (1 - e2 sin2 lat)^(3/2)`, metres, from the sine of the latitude.
#[must_use]
pub fn meridian_radius_m(sin_latitude: f64) -> f64 {
    let w2 = 1.0 - WGS84_E2 * sin_latitude * sin_latitude;
    WGS84_A_M * (1.0 - WGS84_E2) / (w2 * w2.sqrt())
}

/// The aircraft's attitude (see the module for frame and signs).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attitude {
    /// Clockwise from true north.
    pub heading_true: Radians,
    /// Nose up positive.
    pub pitch: Radians,
    /// Right wing down positive.
    pub roll: Radians,
}

impl Attitude {
    /// From degrees.
    #[must_use]
    pub fn from_degrees(heading_true: f64, pitch: f64, roll: f64) -> Self {
        Self {
            heading_true: Radians::from_degrees(heading_true),
            pitch: Radians::from_degrees(pitch),
            roll: Radians::from_degrees(roll),
        }
    }

    /// The rotation from body to NED: `Rz(heading) Ry(pitch) Rx(roll)`.
    #[must_use]
    pub fn body_to_ned(&self) -> DMat3 {
        DMat3::from_rotation_z(self.heading_true.0)
            * DMat3::from_rotation_y(self.pitch.0)
            * DMat3::from_rotation_x(self.roll.0)
    }
}

/// A view: where the eye is, how it looks, and onto how many pixels. The optical axis is the body's forward axis and meets
/// the picture at its centre; pixels are square.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// The eye.
    pub eye: Geodetic,
    /// How it looks.
    pub attitude: Attitude,
    /// Horizontal field of view of the whole picture.
    pub hfov: Radians,
    /// Width of the picture in pixels.
    pub width_px: u32,
    /// Height of the picture in pixels.
    pub height_px: u32,
}

/// Heights of an eye above the ellipsoid that a picture is drawn from, metres: from below the deepest sea floor (Challenger
/// Deep, -10.9 km) to somewhat above 20 000 km.
pub const EYE_HEIGHT_M: RangeInclusive<f64> = -12_000.0..=25_000_000.0;

/// Longitudes and attitudes of a camera may have been wound up to this, radians: four turns.
const TURNS_MAX: f64 = 4.0 * std::f64::consts::TAU;

impl Camera {
    /// Focal length in pixels: `(width / 2) / tan(hfov / 2)`.
    #[must_use]
    pub fn focal_px(&self) -> f64 {
        f64::from(self.width_px) / 2.0 / (self.hfov.0 / 2.0).tan()
    }

    /// Whether a picture can be drawn from it: finite, a real latitude, angles that are not more than a few turns, a height
    /// within [`EYE_HEIGHT_M`], a field of view between 1 and 170 degrees, a size. What comes from a sensor has been held
    /// against its own range before; this is the last gate before the arithmetic of the terrain.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let a = &self.attitude;
        self.eye.is_valid()
            && self.eye.longitude.0.abs() <= TURNS_MAX
            && EYE_HEIGHT_M.contains(&self.eye.height_ellipsoid.0)
            && [a.heading_true, a.pitch, a.roll]
                .iter()
                .all(|x| x.0.abs() <= TURNS_MAX)
            && (1.0..=170.0).contains(&self.hfov.to_degrees())
            && self.width_px > 0
            && self.height_px > 0
    }

    /// The rotation from camera axes (x right, y up, z backwards: GL's eye space) to ECEF.
    #[must_use]
    pub fn eye_to_ecef(&self) -> DMat3 {
        let body_to_ecef = self.eye.ned_to_ecef() * self.attitude.body_to_ned();
        DMat3::from_cols(
            body_to_ecef.y_axis,
            -body_to_ecef.z_axis,
            -body_to_ecef.x_axis,
        )
    }

    /// The unit direction in ECEF through picture position (`x`, `y`) in pixels from the upper left corner, y downwards;
    /// the centre of pixel (i, j) is (i + 0.5, j + 0.5).
    #[must_use]
    pub fn ray_ecef(&self, x: f64, y: f64) -> DVec3 {
        let f = self.focal_px();
        let d = DVec3::new(
            x - f64::from(self.width_px) / 2.0,
            f64::from(self.height_px) / 2.0 - y,
            -f,
        );
        (self.eye_to_ecef() * d).normalize()
    }

    /// Distance from the eye along [`Self::ray_ecef`] to the WGS 84 ellipsoid, metres; `None` where the ray misses it, or
    /// the eye is inside.
    #[must_use]
    pub fn ellipsoid_range_m(&self, x: f64, y: f64) -> Option<f64> {
        let axes = DVec3::new(WGS84_A_M, WGS84_A_M, WGS84_B_M);
        let (o, d) = (self.eye.to_ecef() / axes, self.ray_ecef(x, y) / axes);
        let (a, b, c) = (d.dot(d), o.dot(d), o.dot(o) - 1.0);
        let chord = b * b - a * c;
        // The nearer of the two roots, as a quotient of two sums of numbers of one sign.
        (chord >= 0.0 && b < 0.0 && c >= 0.0).then(|| c / (chord.sqrt() - b))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ecef_agrees_with_a_published_point() {
        // K. M. Borre, "The Easy Suite", and every GPS text: 0N 0E is (a, 0, 0); the pole is (0, 0, b).
        let p = Geodetic::from_degrees(0.0, 0.0, 0.0).to_ecef();
        assert!(
            (p - DVec3::new(WGS84_A_M, 0.0, 0.0)).length() < 1e-9,
            "equator"
        );
        let p = Geodetic::from_degrees(90.0, 17.0, 0.0).to_ecef();
        // b from NIMA TR8350.2 table 3.3.
        assert!(
            (p - DVec3::new(0.0, 0.0, 6_356_752.314_245)).length() < 1e-6,
            "pole"
        );
    }

    #[test]
    fn ecef_goes_back_everywhere() {
        for lat in [
            -90.0, -89.999, -45.0, -0.001, 0.0, 30.0, 50.1008, 89.999, 90.0,
        ] {
            for lon in [-180.0, -70.3, 0.0, 14.26, 179.999] {
                for h in [-430.0, 0.0, 8848.0, 20_000.0, 2.0e7] {
                    let g = Geodetic::from_degrees(lat, lon, h);
                    let p = g.to_ecef();
                    let back = Geodetic::from_ecef(p);
                    assert!(
                        (back.to_ecef() - p).length() < 1e-6,
                        "{lat} {lon} {h}: {back:?}"
                    );
                    assert!(
                        (back.height_ellipsoid.0 - h).abs() < 1e-6,
                        "height {lat} {lon} {h}: {back:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn the_camera_looks_where_the_nose_points() {
        let mut camera = Camera {
            eye: Geodetic::from_degrees(0.0, 0.0, 1000.0),
            attitude: Attitude::from_degrees(90.0, 0.0, 0.0),
            hfov: Radians::from_degrees(60.0),
            width_px: 1024,
            height_px: 600,
        };
        // At 0N 0E, east is +y, north is +z, up is +x.
        assert!(
            (camera.ray_ecef(512.0, 300.0) - DVec3::Y).length() < 1e-12,
            "centre looks east"
        );
        let right_edge = camera.ray_ecef(1024.0, 300.0);
        assert!(
            (right_edge.dot(DVec3::Y) - 30_f64.to_radians().cos()).abs() < 1e-12,
            "half the field of view"
        );
        assert!(right_edge.z < 0.0, "right of east is south");
        camera.attitude = Attitude::from_degrees(90.0, 10.0, 0.0);
        assert!(camera.ray_ecef(512.0, 300.0).x > 0.17, "nose up looks up");
        camera.attitude = Attitude::from_degrees(90.0, 0.0, 30.0);
        // Right wing down: the picture's right edge looks down.
        assert!(camera.ray_ecef(1024.0, 300.0).x < 0.0, "right wing down");
    }

    #[test]
    fn a_camera_that_is_not_a_number_or_nowhere_is_refused() {
        let good = Camera {
            eye: Geodetic::from_degrees(-32.6, -70.3, 4200.0),
            attitude: Attitude::from_degrees(215.0, -4.0, 0.0),
            hfov: Radians::from_degrees(60.0),
            width_px: 1024,
            height_px: 600,
        };
        assert!(good.is_valid());
        type Change = fn(&mut Camera, f64);
        let changes: [Change; 7] = [
            |c, x| c.eye.latitude.0 = x,
            |c, x| c.eye.longitude.0 = x,
            |c, x| c.eye.height_ellipsoid.0 = x,
            |c, x| c.attitude.heading_true.0 = x,
            |c, x| c.attitude.pitch.0 = x,
            |c, x| c.attitude.roll.0 = x,
            |c, x| c.hfov.0 = x,
        ];
        for (at, change) in changes.iter().enumerate() {
            for absurd in [
                f64::NAN,
                f64::INFINITY,
                f64::NEG_INFINITY,
                f64::MAX,
                -1e30,
                1e9,
            ] {
                let mut camera = good;
                change(&mut camera, absurd);
                assert!(!camera.is_valid(), "input {at}: {absurd}");
            }
            let mut camera = good;
            change(&mut camera, f64::MIN_POSITIVE / 2.0);
            assert_eq!(
                camera.is_valid(),
                at != 6,
                "input {at}: a denormal number is 0 but for a field of view"
            );
        }
    }

    #[test]
    fn a_ray_ends_on_the_ellipsoid_or_passes_it() {
        for (latitude, height_m) in [(0.0, 20_000.0), (89.9, 1.0e6), (-45.0, 2.0e7)] {
            let camera = Camera {
                eye: Geodetic::from_degrees(latitude, 120.0, height_m),
                attitude: Attitude::from_degrees(30.0, -90.0, 0.0),
                hfov: Radians::from_degrees(60.0),
                width_px: 100,
                height_px: 100,
            };
            let range_m = camera.ellipsoid_range_m(50.0, 50.0);
            assert!(
                range_m.is_some_and(|r| (r - height_m).abs() < 1e-6 * height_m),
                "{range_m:?}"
            );
            let hit = camera.eye.to_ecef()
                + camera.ray_ecef(52.0, 47.0) * camera.ellipsoid_range_m(52.0, 47.0).unwrap_or(0.0);
            assert!(
                Geodetic::from_ecef(hit).height_ellipsoid.0.abs() < 1e-6,
                "{hit}"
            );
            let away = Camera {
                attitude: Attitude::from_degrees(30.0, 90.0, 0.0),
                ..camera
            };
            assert_eq!(away.ellipsoid_range_m(50.0, 50.0), None);
        }
    }
}
