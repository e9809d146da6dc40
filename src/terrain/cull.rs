//! Which blocks a camera can see, and how near and far they are: spheres and corners against the picture's four planes and
//! against the horizon.
//!
//! Bounds are computed in f64 and kept in f32, counted from an origin near the eye ([`Viewer::from`]): then what rounding
//! moves is less than a millionth of a distance, and all that is tested has room for a hundred times more.

use super::partition::Partition;
use crate::geo::{Camera, WGS84_A_M, WGS84_B_M};
use glam::{DVec3, Vec3, Vec4};

/// Four points side by side, metres.
#[derive(Clone, Copy, Debug)]
pub struct Quad {
    /// First coordinates.
    pub x: Vec4,
    /// Second coordinates.
    pub y: Vec4,
    /// Third coordinates.
    pub z: Vec4,
}

impl Quad {
    fn of(points: [DVec3; 4]) -> Self {
        let [a, b, c, d] = points.map(|p| p.as_vec3());
        Self {
            x: Vec4::new(a.x, b.x, c.x, d.x),
            y: Vec4::new(a.y, b.y, c.y, d.y),
            z: Vec4::new(a.z, b.z, c.z, d.z),
        }
    }

    /// Each point's dot product with a direction.
    #[must_use]
    pub fn dot(&self, n: Vec3) -> Vec4 {
        self.x * n.x + self.y * n.y + self.z * n.z
    }
}

/// A block of terrain as culling sees it: its corners and a sphere around them, Earth-centred axes, metres from an origin.
#[derive(Clone, Copy, Debug)]
pub struct Bound {
    centre: Vec3,
    radius_m: f32,
    height_min_m: f32,
    height_max_m: f32,
    /// South-west, south-east, north-west and north-east, at the lowest height and at the greatest.
    low: Quad,
    high: Quad,
    /// How far the block can bulge beyond its corners.
    bulge_m: f32,
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

/// Room for rounding, metres.
const BULGE_MIN_M: f64 = 0.2;

impl Bound {
    /// Around a patch, at most a few degrees wide, counted from an `origin`. Its farthest points from its middle are corners;
    /// between corners its sides leave the straight line by at most an eighth of their length squared over the Earth's
    /// radius, twice that where a side of constant latitude turns on a small circle (up to 63 degrees; beyond, the length
    /// shrinks faster).
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        reason = "f64 until here; see the module"
    )]
    pub fn of(patch: &Patch, origin: DVec3) -> Self {
        let (low, high) = (patch.height_min_m, patch.height_max_m);
        let sides = [
            (patch.south_deg, patch.west_deg),
            (patch.south_deg, patch.east_deg),
            (patch.north_deg, patch.west_deg),
            (patch.north_deg, patch.east_deg),
        ];
        let lows = sides.map(|(lat, lon)| patch.partition.ecef(lon, lat, low) - origin);
        let ups = sides.map(|(lat, lon)| patch.partition.normal(lon, lat) * (high - low));
        let highs = [0, 1, 2, 3].map(|at| lows[at] + ups[at]);
        let centre = patch.partition.ecef(
            f64::midpoint(patch.west_deg, patch.east_deg),
            f64::midpoint(patch.south_deg, patch.north_deg),
            f64::midpoint(low, high),
        ) - origin;
        let radius_m = lows
            .iter()
            .chain(&highs)
            .map(|&c| (c - centre).length())
            .fold(0.0, f64::max);
        let across_m = (lows[3] - lows[0])
            .length()
            .max((lows[2] - lows[1]).length());
        Self {
            centre: centre.as_vec3(),
            radius_m: (radius_m * 1.01 + 1.0) as f32,
            height_min_m: low as f32,
            height_max_m: high as f32,
            low: Quad::of(lows),
            high: Quad::of(highs),
            bulge_m: (across_m * across_m / (4.0 * WGS84_B_M) + BULGE_MIN_M) as f32,
        }
    }

    /// The same where something of it reaches up to `by_m` farther on any side.
    #[must_use]
    pub const fn widened(mut self, by_m: f32) -> Self {
        self.radius_m += by_m;
        self.bulge_m += by_m;
        self
    }

    /// Its corners at the lowest height and at the greatest, each south-west, south-east, north-west and north-east.
    #[must_use]
    pub const fn corners(&self) -> (&Quad, &Quad) {
        (&self.low, &self.high)
    }

    /// How far it can bulge beyond its corners, metres.
    #[must_use]
    pub const fn bulge_m(&self) -> f32 {
        self.bulge_m
    }

    /// Its lowest and greatest height above the ellipsoid, metres.
    #[must_use]
    pub const fn heights_m(&self) -> (f32, f32) {
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

/// See [`Seen::is_whole`].
pub const WIDE: u32 = 2;

/// How a block is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// How far away it is.
    pub span: Span,
    /// None of it is nearer than this along the optical axis, metres.
    pub deep_m: f64,
    /// Whether all of it is known to lie inside a picture that is [`WIDE`] times as wide and as high around the same middle.
    pub is_whole: bool,
}

/// A camera prepared for culling.
#[derive(Clone, Copy, Debug)]
pub struct Viewer {
    eye: DVec3,
    eye_height_m: f64,
    /// Inward normals of the picture's sides, all through the eye, Earth-centred axes.
    sides: [DVec3; 4],
    /// Those of the wide picture.
    wide: [DVec3; 4],
    ahead: DVec3,
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
        let axes = camera.eye_to_ecef();
        // Eye space looks along -z.
        let side = |x: f64, y: f64, half_px: f64| {
            let length = f.hypot(half_px);
            axes * DVec3::new(x * f, y * f, -half_px) / length
        };
        let (w, h) = (
            f64::from(camera.width_px) / 2.0,
            f64::from(camera.height_px) / 2.0,
        );
        let sides = |wide: f64| {
            [
                side(1.0, 0.0, w * wide),
                side(-1.0, 0.0, w * wide),
                side(0.0, 1.0, h * wide),
                side(0.0, -1.0, h * wide),
            ]
        };
        let eye = camera.eye.to_ecef();
        let drop = height_min_m - OCCLUDER_MARGIN_M;
        let occluder = DVec3::new(WGS84_A_M + drop, WGS84_A_M + drop, WGS84_B_M + drop);
        let beyond = (eye / occluder).length_squared() - 1.0;
        Self {
            eye,
            eye_height_m: camera.eye.height_ellipsoid.0,
            sides: sides(1.0),
            wide: sides(f64::from(WIDE)),
            ahead: -axes.z_axis,
            occluder,
            horizon: if beyond > 0.0 {
                beyond.sqrt()
            } else {
                f64::INFINITY
            },
        }
    }

    /// For bounds that are counted from an origin, which is best near the eye.
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        reason = "f64 until here; see the module"
    )]
    pub fn from(&self, origin: DVec3) -> ViewerFrom {
        let offset = origin - self.eye;
        let plane = |n: DVec3| (n.as_vec3(), n.dot(offset) as f32);
        let drop = self.occluder.z - WGS84_B_M;
        ViewerFrom {
            offset: offset.as_vec3(),
            sides: self.sides.map(plane),
            wide: self.wide.map(plane),
            ahead: plane(self.ahead),
            eye_height_m: self.eye_height_m as f32,
            to_sphere: (1.0 / self.occluder).as_vec3(),
            drop_m: drop as f32,
            horizon: self.horizon as f32,
        }
    }
}

/// A [`Viewer`] for bounds counted from one origin.
#[derive(Clone, Copy, Debug)]
pub struct ViewerFrom {
    /// From the eye to the origin.
    offset: Vec3,
    /// Planes: the normal, and the origin's distance inside.
    sides: [(Vec3, f32); 4],
    wide: [(Vec3, f32); 4],
    ahead: (Vec3, f32),
    eye_height_m: f32,
    /// Makes the occluder a unit sphere.
    to_sphere: Vec3,
    /// The occluder's height above the ellipsoid.
    drop_m: f32,
    horizon: f32,
}

impl ViewerFrom {
    /// How a block is seen, or `None` if no part of it can be in the picture. Errs on the side of drawing.
    #[must_use]
    pub fn sees(&self, bound: &Bound) -> Option<Seen> {
        let r = bound.radius_m;
        let inside = |(n, origin): &(Vec3, f32)| n.dot(bound.centre) + origin >= -r;
        let wholly_inside = |(n, origin): &(Vec3, f32)| n.dot(bound.centre) + origin >= r;
        // By no more than the block can bulge, some corner must be inside each side of the picture.
        let reaches_in = |(n, origin): &(Vec3, f32)| {
            let most = bound.low.dot(*n).max(bound.high.dot(*n));
            most.max_element() + origin >= -bound.bulge_m
        };
        if !inside(&self.ahead)
            || !self.sides.iter().all(inside)
            || !self.sides.iter().all(reaches_in)
        {
            return None;
        }
        let to = bound.centre + self.offset;
        // Heights and lengths where the occluder is a unit sphere.
        let unit = self.to_sphere.z;
        let top = (bound.height_max_m - self.drop_m) * unit;
        let reach = self.horizon + (top * (2.0 + top)).max(0.0).sqrt();
        if (to * self.to_sphere).length() - r * unit > reach {
            return None;
        }
        let distance = to.length();
        // A surface higher than all of the block is at least the difference of heights away.
        let above = self.eye_height_m - bound.height_max_m;
        Some(Seen {
            span: Span {
                near_m: (distance - r).max(above).into(),
                far_m: (distance + r).into(),
            },
            deep_m: (self.ahead.0.dot(bound.centre) + self.ahead.1 - r).into(),
            is_whole: self.wide.iter().all(wholly_inside),
        })
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
                // Counted from somewhere near, as a window's blocks are.
                let origin = Geodetic::from_degrees(lat + 0.1, lon - 0.1, 0.0).to_ecef();
                let seen = Viewer::new(&camera, 0.0).from(origin).sees(&Bound::of(&patch, origin));
                prop_assert!(seen.is_some());
                let span = seen.expect("just seen").span;
                prop_assert!(span.near_m <= to.length() && to.length() <= span.far_m);
            }
        }
    }

    proptest! {
        #[test]
        fn no_point_of_a_whole_block_is_outside_the_wide_picture(
            lat in -80.0..80.0_f64, h in 6000.0..18_000.0_f64,
            heading in 0.0..360.0_f64, pitch in -90.0..-20.0_f64, roll in -180.0..180.0_f64,
            dlat in -0.2..0.2_f64, dlon in -0.2..0.2_f64, size in 0.001..0.1_f64,
            fx in 0.0..1.0_f64, fy in 0.0..1.0_f64, fh in 0.0..1.0_f64, relief in 0.0..5000.0_f64,
        ) {
            let camera = camera(lat, 12.0, h, (heading, pitch, roll), 60.0);
            let patch = Patch {
                partition: Partition::Geographic,
                south_deg: lat + dlat, north_deg: lat + dlat + size,
                west_deg: 12.0 + dlon, east_deg: 12.0 + dlon + size,
                height_min_m: 0.0, height_max_m: relief,
            };
            let origin = Geodetic::from_degrees(lat + 0.1, 11.9, 0.0).to_ecef();
            let seen = Viewer::new(&camera, 0.0).from(origin).sees(&Bound::of(&patch, origin));
            if let Some(seen) = seen.filter(|seen| seen.is_whole) {
                let point = Geodetic::from_degrees(
                    patch.south_deg + fy * size, patch.west_deg + fx * size, fh * relief,
                ).to_ecef();
                let p = camera.eye_to_ecef().transpose() * (point - camera.eye.to_ecef());
                let f = camera.focal_px();
                prop_assert!(p.z < 0.0 && -p.z >= seen.deep_m);
                prop_assert!((p.x / -p.z * f).abs() <= 1024.0 && (p.y / -p.z * f).abs() <= 600.0);
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
        let origin = camera.eye.to_ecef();
        let viewer = Viewer::new(&camera, 0.0).from(origin);
        // At 222 km: the horizon of 100 m is 36 km (44 with the margin) off, that of 9000 m 339 km.
        assert!(
            viewer.sees(&Bound::of(&patch(100.0), origin)).is_none(),
            "plain"
        );
        assert!(
            viewer.sees(&Bound::of(&patch(9000.0), origin)).is_some(),
            "mountain"
        );
    }
}
