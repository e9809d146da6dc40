//! The three partitions of the Earth: one geographic grid for almost all of it, and a grid for each pole.
//!
//! A geographic grid has no useful posts near the poles: its columns meet there. A *cap* has the same grid of posts, but
//! counted in two other angles of the ellipsoid's unit normal n, so that its equator and its zero meridian cross at the
//! pole (the transverse aspect of the equidistant cylindrical grid):
//!
//! ```text
//! geographic  n = (cos B cos L,  cos B sin L,  sin B)         B latitude, L longitude
//! north       n = (cos u sin v,  sin u,        cos u cos v)
//! south       n = (cos u sin v, -sin u,       -cos u cos v)
//! ```
//!
//! Each is a rotation of the first, so rows and columns are right-handed in all three: with *grid latitude* (B, or u) and
//! *grid longitude* (L, or v), everything that counts posts is the same for all partitions.
//!
//! One partition is drawn at a time. Elevation comes in geographic posts as far as 60 degrees (SRTM) or 85 (Copernicus), and
//! resampling would cost them their exactness, so the seam stands at 70 degrees instead of the thesis's 45
//! (A. Dimitrijevic, 2015): below it every post is as it was measured. The partitions overlap by more than anything can be
//! seen across the seam, so one is enough for a whole picture, and nothing has to be joined.

use crate::geo::{WGS84_E2, prime_vertical_radius_m};
use glam::DVec3;

/// Latitude at which the eye changes between the geographic grid and a cap, degrees north or south.
pub const SEAM_LATITUDE_DEG: f64 = 70.0;

/// The eye must be past the seam by this much before the partition changes, degrees: 28 km.
pub const SEAM_HYSTERESIS_DEG: f64 = 0.25;

/// A cap has posts down to this latitude, degrees north or south: from the seam, 5.75 degrees (640 km) is farther than the
/// horizon of 20 km (505 km) and the mountains behind it that rise less than 1.4 km above it.
pub const CAP_LATITUDE_MIN_DEG: f64 = 64.0;

/// Which grid posts are counted in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Default)]
#[repr(u8)]
pub enum Partition {
    /// By latitude and longitude.
    #[default]
    Geographic = 0,
    /// Around the north pole.
    North = 1,
    /// Around the south pole.
    South = 2,
}

impl Partition {
    /// All, by number.
    pub const ALL: [Self; 3] = [Self::Geographic, Self::North, Self::South];

    /// The partition of a number in a file.
    #[must_use]
    pub const fn from_number(number: u8) -> Option<Self> {
        match number {
            0 => Some(Self::Geographic),
            1 => Some(Self::North),
            2 => Some(Self::South),
            _ => None,
        }
    }

    /// Its name in texts and documents.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Geographic => "geographic",
            Self::North => "north cap",
            Self::South => "south cap",
        }
    }

    /// The cap on a latitude's side of the equator.
    #[must_use]
    pub const fn cap(latitude_deg: f64) -> Self {
        if latitude_deg < 0.0 {
            Self::South
        } else {
            Self::North
        }
    }

    /// The partition for an eye at a latitude in degrees, which keeps the `current` one within the hysteresis of the seam.
    #[must_use]
    pub fn at(latitude_deg: f64, current: Option<Self>) -> Self {
        let past = latitude_deg.abs() - SEAM_LATITUDE_DEG;
        let cap = Self::cap(latitude_deg);
        match current {
            Some(Self::Geographic) if past < SEAM_HYSTERESIS_DEG => Self::Geographic,
            Some(own) if own == cap && past > -SEAM_HYSTERESIS_DEG => cap,
            _ if past > 0.0 => cap,
            _ => Self::Geographic,
        }
    }

    /// The ellipsoid's unit normal, Earth-centred axes, at a grid longitude and a grid latitude in degrees.
    #[must_use]
    pub fn normal(self, longitude_deg: f64, latitude_deg: f64) -> DVec3 {
        let (sin_lon, cos_lon) = longitude_deg.to_radians().sin_cos();
        let (sin_lat, cos_lat) = latitude_deg.to_radians().sin_cos();
        match self {
            Self::Geographic => DVec3::new(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat),
            Self::North => DVec3::new(cos_lat * sin_lon, sin_lat, cos_lat * cos_lon),
            Self::South => DVec3::new(cos_lat * sin_lon, -sin_lat, -cos_lat * cos_lon),
        }
    }

    /// Earth-centred position, metres, at a grid longitude and latitude in degrees and a height above the ellipsoid in
    /// metres (Heiskanen and Moritz 1967, equation 5-3, by the normal).
    #[must_use]
    pub fn ecef(self, longitude_deg: f64, latitude_deg: f64, height_ellipsoid_m: f64) -> DVec3 {
        let up = self.normal(longitude_deg, latitude_deg);
        let n = prime_vertical_radius_m(up.z);
        let wide = n + height_ellipsoid_m;
        DVec3::new(wide, wide, n * (1.0 - WGS84_E2) + height_ellipsoid_m) * up
    }

    /// Grid longitude and grid latitude, degrees, of a geodetic longitude and latitude in degrees.
    #[must_use]
    pub fn from_geodetic(self, longitude_deg: f64, latitude_deg: f64) -> (f64, f64) {
        if self == Self::Geographic {
            return (longitude_deg, latitude_deg);
        }
        // By the angle from the pole, so that nothing is lost near it.
        let (sin_lon, cos_lon) = longitude_deg.to_radians().sin_cos();
        let (from_pole, sign) = if self == Self::North {
            (90.0 - latitude_deg, 1.0)
        } else {
            (90.0 + latitude_deg, -1.0)
        };
        let (sin, cos) = from_pole.to_radians().sin_cos();
        let (x, y) = (sin * cos_lon, sign * sin * sin_lon);
        (
            x.atan2(cos).to_degrees(),
            y.atan2(x.hypot(cos)).to_degrees(),
        )
    }

    /// Geodetic longitude and latitude, degrees, of a grid longitude and latitude in degrees. The longitude of a pole is 0.
    #[must_use]
    pub fn to_geodetic(self, longitude_deg: f64, latitude_deg: f64) -> (f64, f64) {
        if self == Self::Geographic {
            return (longitude_deg, latitude_deg);
        }
        let n = self.normal(longitude_deg, latitude_deg);
        let from_axis = n.x.hypot(n.y);
        let longitude = if from_axis > 0.0 {
            n.y.atan2(n.x).to_degrees()
        } else {
            0.0
        };
        (longitude, n.z.atan2(from_axis).to_degrees())
    }

    /// Direction of grid north at a geodetic longitude, degrees clockwise from true north: what has to be taken from a true
    /// heading to have it among the grid's rows and columns. 0 in the geographic partition.
    #[must_use]
    pub fn convergence_deg(self, longitude_deg: f64, latitude_deg: f64) -> f64 {
        if self == Self::Geographic {
            return 0.0;
        }
        let (v, u) = self.from_geodetic(longitude_deg, latitude_deg);
        let (sin_v, cos_v) = v.to_radians().sin_cos();
        let (sin_u, cos_u) = u.to_radians().sin_cos();
        // Grid north is dn/du; east and north are the geodetic ones.
        let sign = if self == Self::North { 1.0 } else { -1.0 };
        let grid_north = DVec3::new(-sin_u * sin_v, sign * cos_u, -sign * sin_u * cos_v);
        let (sin_lon, cos_lon) = longitude_deg.to_radians().sin_cos();
        let (sin_lat, cos_lat) = latitude_deg.to_radians().sin_cos();
        let east = DVec3::new(-sin_lon, cos_lon, 0.0);
        let north = DVec3::new(-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat);
        grid_north
            .dot(east)
            .atan2(grid_north.dot(north))
            .to_degrees()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_normal_of_a_grid_position_is_the_geodetic_normal(
            longitude in -180.0..180.0_f64, latitude in 60.0..90.0_f64, south: bool,
        ) {
            let latitude = if south { -latitude } else { latitude };
            let cap = Partition::cap(latitude);
            let (v, u) = cap.from_geodetic(longitude, latitude);
            let truth = Partition::Geographic.normal(longitude, latitude);
            prop_assert!((cap.normal(v, u) - truth).length() < 1e-15);
            let (back_lon, back_lat) = cap.to_geodetic(v, u);
            prop_assert!((Partition::Geographic.normal(back_lon, back_lat) - truth).length() < 1e-15);
        }

        #[test]
        fn rows_and_columns_are_right_handed_in_every_partition(u in -25.0..25.0_f64, v in -25.0..25.0_f64) {
            for partition in Partition::ALL {
                let up = partition.normal(v, u);
                let east = partition.normal(v + 1e-4, u) - up;
                let north = partition.normal(v, u + 1e-4) - up;
                prop_assert!(east.cross(north).dot(up) > 0.0);
            }
        }

        #[test]
        fn convergence_turns_true_north_into_grid_north(
            longitude in -180.0..180.0_f64, latitude in 60.0..89.9_f64, south: bool,
        ) {
            let latitude = if south { -latitude } else { latitude };
            let cap = Partition::cap(latitude);
            let (v, u) = cap.from_geodetic(longitude, latitude);
            let here = cap.normal(v, u);
            let turn = -cap.convergence_deg(longitude, latitude).to_radians();
            // A step to true north, in grid axes.
            let step = Partition::Geographic.normal(longitude, latitude + 1e-5) - here;
            let east = (cap.normal(v + 1e-5, u) - here).normalize();
            let north = (cap.normal(v, u + 1e-5) - here).normalize();
            let (e, n) = (step.dot(east), step.dot(north));
            prop_assert!((e.atan2(n) - turn).sin().abs() < 1e-4 && (e.atan2(n) - turn).cos() > 0.0);
        }
    }

    #[test]
    fn the_pole_is_the_middle_of_its_cap() {
        for (cap, latitude) in [(Partition::North, 90.0), (Partition::South, -90.0)] {
            let (v, u) = cap.from_geodetic(77.0, latitude);
            assert!(v.abs() < 1e-14 && u.abs() < 1e-14, "{cap:?}: {v} {u}");
            let (_, back) = cap.to_geodetic(0.0, 0.0);
            assert!((back - latitude).abs() < 1e-12, "{back}");
        }
    }

    #[test]
    fn a_partition_is_kept_near_the_seam() {
        use Partition::{Geographic, North, South};
        assert_eq!(Partition::at(70.1, Some(Geographic)), Geographic);
        assert_eq!(Partition::at(70.3, Some(Geographic)), North);
        assert_eq!(Partition::at(69.9, Some(North)), North);
        assert_eq!(Partition::at(69.7, Some(North)), Geographic);
        assert_eq!(Partition::at(-70.1, None), South);
        assert_eq!(Partition::at(-80.0, Some(North)), South, "a leap");
        assert_eq!(Partition::at(45.0, None), Geographic);
    }
}
