//! Holes: places where the sky shows through the ground.
//!
//! A pixel that no triangle covers is a hole when one of two things says that ground must be there:
//!
//! - its ray meets the ellipsoid lowered to the lowest terrain. Asked only when every wanted level is resident, because only
//!   then does the drawn surface reach the horizon.
//! - in the vertical plane through its ray there is terrain above it. A surface that has one height everywhere hides
//!   everything below its highest point in every direction, so below terrain there is only terrain. Terrain is taken to be
//!   above when nine pixels around a point of that plane show it, so that the edge of a steep silhouette is no hole.
//!
//! From inside the drawn ground there is no promise, and nothing is a hole. Above it, the picture begins 0.2 m before the
//! eye; what of the ground is nearer than that is cut away, see [`Under::clearance_m`].

use crate::app::error::Failure;
use crate::app::measure::bench::Bench;
use crate::geo::{Camera, WGS84_A_M, WGS84_B_M};
use crate::terrain::scene::FrameFigures;
use crate::terrain::under::Under;
use glam::DVec3;

/// Terrain lies nowhere lower than this below the lowest height of its source: geoid and rounding, metres.
const BELOW_LOWEST_M: f64 = 130.0;

/// Pixels of the planned view that are holes.
///
/// # Errors
/// With what the GPU refuses.
pub fn holes(
    bench: &mut Bench,
    camera: &Camera,
    figures: &FrameFigures,
    lowest_m: f64,
) -> Result<usize, Failure> {
    if figures.levels.is_none() {
        return Ok(0);
    }
    let covered: Vec<bool> = bench
        .picture(camera)?
        .chunks_exact(4)
        .map(|p| p[3] != 0)
        .collect();
    let under = bench.terrain.scene().and_then(Under::of);
    if under.is_some_and(|u| u.top_m >= camera.eye.height_ellipsoid.0) {
        return Ok(0);
    }
    let lowest_m = figures.settled.then_some(lowest_m);
    Ok(holes_of(camera, &covered, lowest_m))
}

/// How many of the pixels that are not `covered` are holes; `lowest_m`: height of the lowest terrain where it is drawn as far
/// as the horizon.
#[must_use]
pub fn holes_of(camera: &Camera, covered: &[bool], lowest_m: Option<f64>) -> usize {
    let limb = lowest_m.map(|lowest_m| Limb::new(camera, lowest_m));
    let view = View::new(camera, covered);
    let meets = |at: usize| limb.as_ref().is_some_and(|l| l.meets(view.ray(at)));
    let is_hole = |at: usize| !covered[at] && (meets(at) || view.has_terrain_above(at));
    // Every hole has a rim, and walking up from every pixel of the sky takes long.
    let (width, height) = (camera.width_px as usize, camera.height_px as usize);
    let is_rim = |at: usize| {
        let around = |v: usize, side: usize| v.saturating_sub(1)..(v + 2).min(side);
        around(at / width, height)
            .any(|y| around(at % width, width).any(|x| covered[y * width + x]))
    };
    let pixels = || 0..covered.len();
    if pixels().any(|at| !covered[at] && (meets(at) || (is_rim(at) && is_hole(at)))) {
        pixels().filter(|&at| is_hole(at)).count()
    } else {
        0
    }
}

/// The ellipsoid below all terrain, from the eye.
struct Limb {
    axes: DVec3,
    eye: DVec3,
    to_ecef: glam::DMat3,
}

impl Limb {
    fn new(camera: &Camera, lowest_m: f64) -> Self {
        let drop = lowest_m.min(0.0) - BELOW_LOWEST_M;
        let axes = DVec3::new(WGS84_A_M + drop, WGS84_A_M + drop, WGS84_B_M + drop);
        Self {
            axes,
            eye: camera.eye.to_ecef() / axes,
            to_ecef: camera.eye_to_ecef(),
        }
    }

    fn meets(&self, ray: DVec3) -> bool {
        let d = (self.to_ecef * ray) / self.axes;
        let (a, b, c) = (d.dot(d), self.eye.dot(d), self.eye.dot(self.eye) - 1.0);
        let inside = b * b - a * c;
        inside >= 0.0 && -b - inside.sqrt() > 0.0
    }
}

/// Which pixels are terrain, and which way is up among them.
struct View {
    width: usize,
    height: usize,
    focal_px: f64,
    up: DVec3,
    /// Nine pixels of terrain around each.
    solid: Vec<bool>,
}

impl View {
    fn new(camera: &Camera, covered: &[bool]) -> Self {
        let (width, height) = (camera.width_px as usize, camera.height_px as usize);
        let mut solid = vec![false; covered.len()];
        for y in 1..height.max(1) - 1 {
            for x in 1..width.max(1) - 1 {
                solid[y * width + x] =
                    (0..9).all(|k| covered[(y + k / 3 - 1) * width + x + k % 3 - 1]);
            }
        }
        let down = camera.eye.ned_to_ecef().z_axis;
        Self {
            width,
            height,
            focal_px: camera.focal_px(),
            up: camera.eye_to_ecef().transpose() * -down,
            solid,
        }
    }

    /// The direction through a pixel's centre in camera axes (x right, y up, z backwards).
    #[expect(clippy::cast_precision_loss, reason = "pixels of a picture")]
    fn ray(&self, at: usize) -> DVec3 {
        DVec3::new(
            (at % self.width) as f64 + 0.5 - self.width as f64 / 2.0,
            self.height as f64 / 2.0 - (at / self.width) as f64 - 0.5,
            -self.focal_px,
        )
    }

    /// Walks from a pixel towards the zenith.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "pixels of a picture, tested against its sides"
    )]
    fn has_terrain_above(&self, at: usize) -> bool {
        let mut d = self.ray(at);
        let (half_w, half_h) = (self.width as f64 / 2.0, self.height as f64 / 2.0);
        for _ in 0..self.width + self.height {
            // How far the picture moves for each share of up that is added to a ray that ends on the picture's plane.
            let slip = DVec3::new(self.up.x, self.up.y, 0.0) + d * (self.up.z / self.focal_px);
            let step = slip.x.abs().max(slip.y.abs());
            // At the zenith itself there is no more up.
            if step * self.focal_px < 1e-9 || self.at_zenith(d) {
                return false;
            }
            d += DVec3::new(slip.x, slip.y, 0.0) / step;
            let (x, y) = (d.x + half_w, half_h - d.y);
            if x < 0.0 || y < 0.0 || x >= self.width as f64 || y >= self.height as f64 {
                return false;
            }
            if self.solid[y as usize * self.width + x as usize] {
                return true;
            }
        }
        false
    }

    /// Whether a ray looks within a pixel of straight up.
    fn at_zenith(&self, d: DVec3) -> bool {
        let up = self.up;
        up.z < 0.0 && {
            let zenith = up * (self.focal_px / -up.z);
            (zenith.x - d.x).abs() < 1.5 && (zenith.y - d.y).abs() < 1.5
        }
    }
}
