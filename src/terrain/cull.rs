//! Which blocks a camera can see, and how near and far they are: spheres against the picture's four planes and against
//! the horizon, in f64.

use super::partition::Partition;
use crate::geo::{Camera, WGS84_A_M, WGS84_B_M};
use glam::{DMat3, DVec3};

/// A block of terrain as culling sees it: its corners and a sphere around them, Earth-centred, metres.
#[derive(Clone, Copy, Debug)]
pub struct Bound {
    centre: DVec3,
    radius_m: f64,
    height_min_m: f64,
    height_max_m: f64,
    /// At the lowest height, then at the greatest.
    corners: [DVec3; 8],
    /// How far the block can bulge beyond its corners.
    bulge_m: f64,
}

/// A patch of terrain: its sides in degrees of its partition's grid, its heights in metres above the ellipsoid.
#[derive(Clone, Copy, Debug)]
pub struct Patch {
    /// Whose grid it is.
    pub partition: Partition,
    /// Southern side.
    pub south_deg: f64,
    /// Western side.
    pub west_deg: f64,
    /// Northern side.
    pub north_deg: f64,
    /// Eastern side.
    pub east_deg: f64,
    /// Lowest height.
    pub height_min_m: f64,
    /// Greatest height.
    pub height_max_m: f64,
}

impl Bound {
    /// Around a patch, at most a few degrees wide. Its farthest points from its middle are corners; between corners its
    /// sides leave the straight line by at most an eighth of their length squared over the Earth's radius, twice that
    /// where a side of constant latitude turns on a small circle (up to 63 degrees; beyond, the length shrinks faster).
    #[must_use]
    pub fn of(patch: &Patch) -> Self {
        let at = |lat: f64, lon: f64, h: f64| patch.partition.ecef(lon, lat, h);
        let (low, high) = (patch.height_min_m, patch.height_max_m);
        let mut corners = [DVec3::ZERO; 8];
        let sides = [
            (patch.south_deg, patch.west_deg),
            (patch.south_deg, patch.east_deg),
            (patch.north_deg, patch.west_deg),
            (patch.north_deg, patch.east_deg),
        ];
        for (at_corner, (lat, lon)) in sides.into_iter().enumerate() {
            let up = patch.partition.normal(lon, lat);
            corners[at_corner] = at(lat, lon, low);
            corners[at_corner + 4] = corners[at_corner] + up * (high - low);
        }
        let centre = at(
            f64::midpoint(patch.south_deg, patch.north_deg),
            f64::midpoint(patch.west_deg, patch.east_deg),
            f64::midpoint(low, high),
        );
        let radius_m = corners
            .iter()
            .map(|&c| (c - centre).length())
            .fold(0.0, f64::max);
        let across_m = (corners[3] - corners[0])
            .length()
            .max((corners[2] - corners[1]).length());
        Self {
            centre,
            radius_m: radius_m * 1.01 + 1.0,
            height_min_m: low,
            height_max_m: high,
            corners,
            bulge_m: across_m * across_m / (4.0 * WGS84_B_M) + 1.0,
        }
    }

    /// The same where something of it reaches up to `by_m` farther on any side.
    #[must_use]
    pub const fn widened(mut self, by_m: f64) -> Self {
        self.radius_m += by_m;
        self.bulge_m += by_m;
        self
    }

    /// The middle of the sphere around it.
    #[must_use]
    pub const fn centre(&self) -> DVec3 {
        self.centre
    }

    /// The radius of the sphere around it.
    #[must_use]
    pub const fn radius_m(&self) -> f64 {
        self.radius_m
    }

    /// Its corners: south-west, south-east, north-west and north-east at the lowest height, then at the greatest.
    #[must_use]
    pub const fn corners(&self) -> &[DVec3; 8] {
        &self.corners
    }

    /// How far it can bulge beyond its corners, metres.
    #[must_use]
    pub const fn bulge_m(&self) -> f64 {
        self.bulge_m
    }

    /// Its lowest and greatest height above the ellipsoid, metres.
    #[must_use]
    pub const fn heights_m(&self) -> (f64, f64) {
        (self.height_min_m, self.height_max_m)
    }
}

/// Nearest and farthest distance of something from the eye, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// Nothing is nearer.
    pub near_m: f64,
    /// Nothing is farther.
    pub far_m: f64,
}

/// A camera prepared for culling.
#[derive(Clone, Copy, Debug)]
pub struct Viewer {
    eye: DVec3,
    eye_height_m: f64,
    ecef_to_eye: DMat3,
    /// Inward unit normals of the right and left planes are (-+nx, 0, nz), of the upper and lower (0, -+ny, nz').
    right: (f64, f64),
    top: (f64, f64),
    /// Semi-axes of an ellipsoid that lies below all terrain: what hides what is behind it.
    occluder: DVec3,
    /// Tangent length from the eye to the occluder, in units where it is a unit sphere; infinite from below it.
    horizon: f64,
}

/// The occluder lies this far below the lowest terrain: enough for the difference between a height above the ellipsoid and
/// an ellipsoid with longer axes (below 1 m from -10 to +10 km).
const OCCLUDER_MARGIN_M: f64 = 20.0;

impl Viewer {
    /// For a valid camera; no terrain is lower than `height_min_m` above the ellipsoid.
    #[must_use]
    pub fn new(camera: &Camera, height_min_m: f64) -> Self {
        let f = camera.focal_px();
        let plane = |half_px: f64| {
            let length = f.hypot(half_px);
            (f / length, half_px / length)
        };
        let eye = camera.eye.to_ecef();
        let drop = height_min_m - OCCLUDER_MARGIN_M;
        let occluder = DVec3::new(WGS84_A_M + drop, WGS84_A_M + drop, WGS84_B_M + drop);
        let beyond = (eye / occluder).length_squared() - 1.0;
        Self {
            eye,
            eye_height_m: camera.eye.height_ellipsoid.0,
            ecef_to_eye: camera.eye_to_ecef().transpose(),
            right: plane(f64::from(camera.width_px) / 2.0),
            top: plane(f64::from(camera.height_px) / 2.0),
            occluder,
            horizon: if beyond > 0.0 {
                beyond.sqrt()
            } else {
                f64::INFINITY
            },
        }
    }

    /// How far away a block is, or `None` if no part of it can be in the picture. Errs on the side of drawing.
    #[must_use]
    pub fn sees(&self, bound: &Bound) -> Option<Span> {
        let to = bound.centre - self.eye;
        let p = self.ecef_to_eye * to;
        let r = bound.radius_m;
        // Eye space looks along -z. Distances inside each plane:
        let outside = |across: f64, plane: (f64, f64)| -p.z * plane.1 - across.abs() * plane.0 < -r;
        if p.z > r || outside(p.x, self.right) || outside(p.y, self.top) {
            return None;
        }
        if self.all_outside_one_plane(bound) {
            return None;
        }
        let scaled_r = r / self.occluder.z;
        let top = 1.0 + (bound.height_max_m + WGS84_B_M - self.occluder.z) / self.occluder.z;
        let reach = self.horizon + (top * top - 1.0).max(0.0).sqrt();
        if (to / self.occluder).length() - scaled_r > reach {
            return None;
        }
        let distance = to.length();
        // A surface higher than all of the block is at least the difference of heights away.
        let above = self.eye_height_m - bound.height_max_m;
        Some(Span {
            near_m: (distance - r).max(above),
            far_m: distance + r,
        })
    }

    /// Whether all corners lie outside one side of the picture by more than the block can bulge.
    fn all_outside_one_plane(&self, bound: &Bound) -> bool {
        let mut inside = [false; 4];
        for &corner in &bound.corners {
            let p = self.ecef_to_eye * (corner - self.eye);
            let (x, y) = (p.x * self.right.0, p.y * self.top.0);
            let (wide, high) = (-p.z * self.right.1, -p.z * self.top.1);
            for (at, distance) in [wide - x, wide + x, high - y, high + y]
                .into_iter()
                .enumerate()
            {
                inside[at] |= distance >= -bound.bulge_m;
            }
        }
        inside != [true; 4]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::{Attitude, Geodetic};
    use crate::units::Radians;
    use proptest::prelude::*;

    fn camera(lat: f64, lon: f64, h: f64, attitude: (f64, f64, f64), hfov: f64) -> Camera {
        Camera {
            eye: Geodetic::from_degrees(lat, lon, h),
            attitude: Attitude::from_degrees(attitude.0, attitude.1, attitude.2),
            hfov: Radians::from_degrees(hfov),
            width_px: 1024,
            height_px: 600,
        }
    }

    proptest! {
        #[test]
        fn a_block_with_a_point_in_the_picture_is_seen(
            lat in -80.0..80.0_f64, lon in -180.0..180.0_f64, h in 0.0..18_000.0_f64,
            heading in 0.0..360.0_f64, pitch in -90.0..90.0_f64, roll in -180.0..180.0_f64,
            dlat in -1.0..1.0_f64, dlon in -1.0..1.0_f64, size in 0.001..3.0_f64,
            fx in 0.0..1.0_f64, fy in 0.0..1.0_f64, fh in 0.0..1.0_f64, relief in 0.0..5000.0_f64,
        ) {
            let camera = camera(lat, lon, h, (heading, pitch, roll), 60.0);
            let patch = Patch {
                partition: Partition::Geographic,
                south_deg: lat + dlat, north_deg: lat + dlat + size,
                west_deg: lon + dlon, east_deg: lon + dlon + size,
                height_min_m: 0.0, height_max_m: relief,
            };
            let point = Geodetic::from_degrees(
                patch.south_deg + fy * size, patch.west_deg + fx * size, fh * relief,
            ).to_ecef();
            let to = point - camera.eye.to_ecef();
            let p = camera.eye_to_ecef().transpose() * to;
            let f = camera.focal_px();
            let inside = p.z < 0.0 && (p.x / -p.z * f).abs() < 512.0 && (p.y / -p.z * f).abs() < 300.0;
            // Beyond the horizon it may be dropped: keep points nearer than the tangent from the eye.
            let near = to.length() < (2.0 * 6.35e6 * h).sqrt();
            if inside && near {
                let span = Viewer::new(&camera, 0.0).sees(&Bound::of(&patch));
                prop_assert!(span.is_some());
                let span = span.expect("just seen");
                prop_assert!(span.near_m <= to.length() && to.length() <= span.far_m);
            }
        }
    }

    #[test]
    fn a_block_behind_the_horizon_is_hidden_and_a_mountain_there_is_not() {
        let camera = camera(0.0, 0.0, 100.0, (90.0, 0.0, 0.0), 60.0);
        let patch = |top: f64| Patch {
            partition: Partition::Geographic,
            south_deg: -0.05,
            north_deg: 0.05,
            west_deg: 2.0,
            east_deg: 2.1,
            height_min_m: 0.0,
            height_max_m: top,
        };
        let viewer = Viewer::new(&camera, 0.0);
        // At 222 km: the horizon of 100 m is 36 km (44 with the margin) off, that of 9000 m 339 km.
        assert!(viewer.sees(&Bound::of(&patch(100.0))).is_none(), "plain");
        assert!(
            viewer.sees(&Bound::of(&patch(9000.0))).is_some(),
            "mountain"
        );
    }
}
