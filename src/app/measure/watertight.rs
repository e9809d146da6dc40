//! Holes: places where the sky shows through the ground.
//!
//! A pixel that no triangle covers is a hole when one of two things says that ground must be there:
//!
//! - its ray meets the ellipsoid lowered to the lowest terrain. Asked only when every wanted level is resident, because only
//!   then does the drawn surface reach the horizon.
//! - in the vertical plane through its ray there is terrain above it. A surface that has one height everywhere hides
//!   everything below its highest point in every direction, so below terrain there is only terrain. Terrain is taken to be
//!   above when nine pixels around a point of that plane show it, so that the edge of a steep silhouette is no hole. Asked
//!   only when the eye is above the drawn ground.

use crate::app::error::Failure;
use crate::app::measure::bench::{Bench, Dice, QUOTA, camera};
use crate::app::measure::position::{above_ground, hard_cases};
use crate::geo::{Camera, Geodetic, WGS84_A_M, WGS84_B_M};
use crate::gl::Gpu;
use crate::terrain::planet::{Kind, Planet};
use crate::terrain::scene::{FrameFigures, Settings};
use crate::terrain::surface::TileSource;
use glam::DVec3;
use serde_json::{Value, json};
use std::rc::Rc;
use std::sync::Arc;

/// What was found.
#[derive(Clone, Debug, Default)]
pub struct Found {
    /// Views looked at.
    pub poses: usize,
    /// Views with at least one hole.
    pub holes: usize,
    /// Pixels that are holes.
    pub pixels: usize,
    /// Views in which nothing could be drawn yet.
    pub without_terrain: usize,
    /// Some of the views with holes.
    pub where_: Vec<String>,
}

impl Found {
    fn count(&mut self, camera: &Camera, pixels: usize, figures: &FrameFigures) {
        self.poses += 1;
        self.without_terrain += usize::from(figures.levels.is_none());
        if pixels > 0 {
            self.holes += 1;
            self.pixels += pixels;
            if self.where_.len() < 8 {
                self.where_
                    .push(format!("{pixels} pixels: {camera:?} {figures:?}"));
            }
        }
    }

    /// Adds another's.
    pub fn add(&mut self, other: Self) {
        self.poses += other.poses;
        self.holes += other.holes;
        self.pixels += other.pixels;
        self.without_terrain += other.without_terrain;
        self.where_.extend(other.where_);
    }

    /// The key `watertight` of the report.
    #[must_use]
    pub fn report(&self) -> Value {
        json!({
            "poses": self.poses,
            "holes": self.holes,
            "hole_pixels": self.pixels,
            "without_terrain": self.without_terrain,
            "where": self.where_,
            "how": "pixels that no triangle covers although their ray meets the ellipsoid lowered to the lowest terrain \
                    (settled views), or although terrain stands above them in the same vertical plane (every view with \
                    the eye above ground); holes counts views, hole_pixels pixels",
        })
    }
}

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
    let above = bench
        .terrain
        .ground(&camera.eye)
        .is_ok_and(|g| g.0 < camera.eye.height_ellipsoid.0);
    let lowest_m = figures.settled.then_some(lowest_m);
    Ok(holes_of(camera, &covered, lowest_m, above))
}

/// How many of the pixels that are not `covered` are holes; `lowest_m`: height of the lowest terrain where it is drawn as far
/// as the horizon, `above`: whether the eye is above the drawn ground.
#[must_use]
pub fn holes_of(camera: &Camera, covered: &[bool], lowest_m: Option<f64>, above: bool) -> usize {
    let limb = lowest_m.map(|lowest_m| Limb::new(camera, lowest_m));
    let view = View::new(camera, covered);
    let meets = |at: usize| limb.as_ref().is_some_and(|l| l.meets(view.ray(at)));
    (0..covered.len())
        .filter(|&at| !covered[at] && (meets(at) || (above && view.has_terrain_above(at))))
        .count()
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

/// Sizes of the pictures that are looked at; the first is the usual one.
const SIZES: [(u32, u32); 5] = [(160, 96), (161, 97), (33, 241), (321, 19), (1, 1)];

/// A view near a place, at most a few kilometres from it: from `above_min_m` to 12 km above the ground, any attitude.
fn random_view(
    bench: &mut Bench,
    dice: &mut Dice,
    near: (f64, f64),
    above_min_m: f64,
) -> Result<Camera, Failure> {
    let narrow = near.0.to_radians().cos().max(1e-3);
    let lat = (near.0 + dice.between(-0.03, 0.03)).clamp(-90.0, 90.0);
    let lon = near.1 + dice.between(-0.03, 0.03) / narrow;
    let above_m = 10_f64.powf(dice.between(above_min_m.log10(), 4.08));
    let attitude = (
        dice.between(0.0, 360.0),
        dice.between(-90.0, 30.0),
        dice.between(-180.0, 180.0),
    );
    let hfov_deg = dice.pick(&[2.0, 30.0, 60.0, 90.0, 120.0]);
    let size = if dice.between(0.0, 1.0) < 0.85 {
        SIZES[0]
    } else {
        dice.pick(&SIZES)
    };
    let ground = bench
        .terrain
        .ground(&Geodetic::from_degrees(lat, lon, 0.0))
        .map_or(9000.0, |g| g.0);
    Ok(camera(
        (lat, lon, (ground + above_m).min(19_900.0)),
        attitude,
        hfov_deg,
        size,
    ))
}

/// Views of one place in a row: how many, and from how high above the ground.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// Views of each place.
    pub views: usize,
    /// Lowest height above the ground, metres. 0.2 m from the eye the picture begins; steep ground needs more.
    pub above_min_m: f64,
}

/// Settled views of a source around places (degrees north and east).
///
/// # Errors
/// When the GPU refuses, or a view does not settle.
pub fn settled<S: TileSource>(
    bench: &mut Bench,
    source: &S,
    dice: &mut Dice,
    places: &[(f64, f64)],
    plan: Plan,
    done: &mut dyn FnMut(usize),
) -> Result<Found, Failure> {
    let lowest_m = source.info().height_min_m;
    let mut found = Found::default();
    for &near in places {
        let over = camera((near.0, near.1, 9500.0), (0.0, -20.0, 0.0), 60.0, SIZES[0]);
        bench.settle(&over)?;
        for _ in 0..plan.views {
            let view = random_view(bench, dice, near, plan.above_min_m)?;
            // Settling may bring finer levels, and with them higher ground.
            bench.settle(&view)?;
            let ground = bench.terrain.ground(&view.eye).map_or(f64::MIN, |g| g.0);
            let mut view = view;
            view.eye.height_ellipsoid.0 =
                view.eye.height_ellipsoid.0.max(ground + plan.above_min_m);
            let figures = bench.settle(&view)?;
            let pixels = holes(bench, &view, &figures, lowest_m)?;
            found.count(&view, pixels, &figures);
            done(1);
        }
    }
    Ok(found)
}

/// The hard cases of [`hard_cases`], in small pictures of the same shape.
///
/// # Errors
/// As [`settled`].
pub fn hard(bench: &mut Bench, lowest_m: f64) -> Result<Found, Failure> {
    let mut found = Found::default();
    for case in hard_cases() {
        let mut view = case.camera;
        let shrink = (view.width_px / 240).max(1);
        (view.width_px, view.height_px) = (view.width_px / shrink, view.height_px / shrink);
        let view = above_ground(bench, &view)?;
        let figures = bench.settle(&view)?;
        let pixels = holes(bench, &view, &figures, lowest_m)?;
        found.count(&view, pixels, &figures);
    }
    Ok(found)
}

/// Views while streaming starves and while it catches up after a leap: with no quota at all along a flight, then from one
/// place to another with everything still to come. High enough that the eye is above whatever is drawn.
///
/// # Errors
/// As [`settled`].
pub fn hungry(
    bench: &mut Bench,
    lowest_m: f64,
    places: &[(f64, f64)],
    frames: u32,
    above_all_m: f64,
) -> Result<Found, Failure> {
    let mut found = Found::default();
    // Away from the pole of its side: a latitude beyond it is none.
    let over = |near: (f64, f64), k: f64| {
        let attitude = (9.0 * k, -15.0 - k % 30.0, 4.0 * k);
        camera(
            (
                near.0 - 0.01 * k * near.0.signum(),
                near.1 - 0.015 * k,
                above_all_m,
            ),
            attitude,
            60.0,
            SIZES[0],
        )
    };
    for &near in places {
        // A leap to the place, then a flight without a quota.
        for frame in 0..frames {
            let view = over(near, 0.0);
            let figures = bench.step(&view, QUOTA)?;
            let pixels = holes(bench, &view, &figures, lowest_m)?;
            found.count(&view, pixels, &figures);
            if figures.settled && frame > frames / 4 {
                break;
            }
        }
        bench.settle(&over(near, 0.0))?;
        for frame in 1..=frames {
            let view = over(near, f64::from(frame));
            let figures = bench.step(&view, 0)?;
            let pixels = holes(bench, &view, &figures, lowest_m)?;
            found.count(&view, pixels, &figures);
        }
    }
    Ok(found)
}

/// Places all over the Earth, as many as asked, after the hard ones.
#[must_use]
pub fn places(dice: &mut Dice, count: usize) -> Vec<(f64, f64)> {
    let hard = [
        (46.0, 8.0),
        (0.0, 0.0),
        (-19.5, 180.0),
        (90.0, 0.0),
        (-90.0, 0.0),
        (70.0, 20.0),
        (-70.0, -60.0),
        (45.0, 7.0),
        (27.99, 86.92),
        (31.5, 35.47),
        (50.02, 10.02),
        (89.98, 100.0),
    ];
    let anywhere = std::iter::repeat_with(|| {
        let sin = dice.between(-1.0, 1.0);
        (sin.asin().to_degrees(), dice.between(-180.0, 180.0))
    });
    hard.into_iter().chain(anywhere).take(count).collect()
}

/// The whole measurement on planets in memory: `poses` random views, half of them of the planet with everything, the rest of
/// cliffs, sea and voids; then the hard cases and streaming.
///
/// # Errors
/// As [`settled`].
pub fn on_planets(
    gpu: &Rc<Gpu>,
    settings: Settings,
    poses: usize,
    done: &mut dyn FnMut(usize),
) -> Result<Found, Failure> {
    let mut dice = Dice::new(7);
    let mut found = Found::default();
    let kinds = [
        (Kind::Earth, 1200, 2, 1.0),
        (Kind::Earth, 3600, 4, 1.0),
        (Kind::Cliffs, 1200, 8, 60.0),
        (Kind::Sea, 1200, 16, 1.0),
        (Kind::Void, 1200, 16, 1.0),
    ];
    for (kind, posts_per_degree, part, above_min_m) in kinds {
        let planet = Arc::new(Planet::new(kind, posts_per_degree));
        let lowest_m = planet.info().height_min_m;
        let mut bench = Bench::new(gpu, &planet, settings)?;
        let share = poses / part;
        let views = if share >= 600 { 50 } else { 20 };
        let plan = Plan { views, above_min_m };
        let places = places(&mut dice, share.div_ceil(views));
        found.add(settled(
            &mut bench,
            planet.as_ref(),
            &mut dice,
            &places,
            plan,
            done,
        )?);
        if kind == Kind::Earth && posts_per_degree == 1200 {
            found.add(hard(&mut bench, lowest_m)?);
        }
        let high = planet.info().height_max_m + 400.0;
        let few = if share >= 600 { 12 } else { 2 };
        let frames = if share >= 600 { 60 } else { 15 };
        found.add(hungry(
            &mut bench,
            lowest_m,
            &places[..few.min(places.len())],
            frames,
            high,
        )?);
    }
    Ok(found)
}

/// Views over and around what a pack covers, low and high, and streaming over it.
///
/// # Errors
/// As [`settled`].
pub fn of_pack<S: TileSource>(
    bench: &mut Bench,
    source: &S,
    poses: usize,
    done: &mut dyn FnMut(usize),
) -> Result<Found, Failure> {
    let mut dice = Dice::new(11);
    let info = source.info();
    let b = info.bounds;
    let views = if poses >= 600 { 50 } else { 5 };
    let places: Vec<(f64, f64)> = (0..poses.div_ceil(views))
        .map(|_| {
            // A little of what lies beyond its edges.
            let lat = dice.between(b.south_deg - 0.1, b.north_deg + 0.1);
            (
                lat.clamp(-90.0, 90.0),
                dice.between(b.west_deg - 0.1, b.east_deg + 0.1),
            )
        })
        .collect();
    let plan = Plan {
        views,
        above_min_m: 2.0,
    };
    let mut found = settled(bench, source, &mut dice, &places, plan, done)?;
    let few = &places[..places.len().min(4)];
    found.add(hungry(
        bench,
        info.height_min_m,
        few,
        30,
        info.height_max_m + 400.0,
    )?);
    Ok(found)
}
