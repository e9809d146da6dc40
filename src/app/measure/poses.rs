//! Random views that are looked at for holes, each with a number: the same number is the same view every time, whatever else
//! is looked at, so that one that has a hole can be looked at again.
//!
//! Forty views in a row are of one place, a few kilometres around: most of what they need is then resident. Places take
//! turns over what there is to be seen ([`Lot`]); every third is one of the hard ones. At every fourth place the eye
//! arrives by a leap and then flies on with no quota at all, and the frames while terrain is missing are looked at too.

use crate::app::error::Failure;
use crate::app::measure::bench::{Bench, Dice, QUOTA, camera};
use crate::app::measure::position::{above_ground, hard_cases};
use crate::app::measure::watertight::holes;
use crate::geo::{Camera, Geodetic};
use crate::gl::Gpu;
use crate::terrain::clipmap::Shape;
use crate::terrain::pack::PackInfo;
use crate::terrain::planet::{Kind, Planet};
use crate::terrain::scene::{FrameFigures, Settings};
use crate::terrain::surface::TileSource;
use crate::terrain::under::Under;
use serde_json::{Value, json};
use std::ops::Range;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

/// Views of one place.
const VIEWS: usize = 40;
/// Frames looked at after a leap at most, and of a flight without a quota.
const HUNGRY_FRAMES: u32 = 8;
/// The lowest that an eye flies, metres above the ground.
const LOWEST_M: f64 = 0.3;
/// The highest, as a power of ten of metres: 12 km.
const HIGHEST_LOG10: f64 = 4.08;
/// Sizes of the pictures; the first is the usual one.
const SIZES: [(u32, u32); 5] = [(160, 96), (161, 97), (33, 241), (321, 19), (1, 1)];

/// What places are taken from: a planet in memory, its posts a degree, and the vertices along a side of a level, which for
/// the first one are those asked for.
type Lot = (Kind, u32, u32);

/// See [`Lot`]. The pack stands in for the first one.
const LOTS: [Lot; 6] = [
    (Kind::Earth, 1200, 0),
    (Kind::Earth, 3600, 255),
    (Kind::Earth, 1200, 127),
    (Kind::Cliffs, 1200, 191),
    (Kind::Sea, 1200, 127),
    (Kind::Void, 1200, 63),
];

/// Which of [`LOTS`] a place is taken from, by its number, over and over.
const TURNS: [usize; 16] = [0, 1, 0, 2, 0, 3, 0, 4, 0, 1, 0, 2, 0, 3, 0, 5];

/// Hard places of the planets, degrees north and east.
const HARD: [(f64, f64); 12] = [
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

/// What was found.
#[derive(Clone, Debug, Default)]
pub struct Found {
    /// Random views looked at.
    pub poses: usize,
    /// Hard cases looked at.
    pub hard_cases: usize,
    /// Frames looked at while terrain was missing.
    pub hungry_frames: usize,
    /// Views with at least one hole, of any kind.
    pub holes: usize,
    /// Pixels that are holes.
    pub pixels: usize,
    /// Views in which nothing could be drawn yet.
    pub without_terrain: usize,
    /// Some of the views with holes.
    pub where_: Vec<String>,
}

impl Found {
    fn see(&mut self, name: &str, camera: &Camera, pixels: usize, figures: &FrameFigures) {
        self.without_terrain += usize::from(figures.levels.is_none());
        if pixels > 0 {
            self.holes += 1;
            self.pixels += pixels;
            if self.where_.len() < 16 {
                self.where_
                    .push(format!("{name}: {pixels} pixels: {camera:?} {figures:?}"));
            }
        }
    }

    /// The key `watertight` of the report.
    #[must_use]
    pub fn report(&self, first: usize) -> Value {
        json!({
            "poses": self.poses,
            "first_pose": first,
            "hard_cases": self.hard_cases,
            "hungry_frames": self.hungry_frames,
            "holes": self.holes,
            "hole_pixels": self.pixels,
            "without_terrain": self.without_terrain,
            "where": self.where_,
            "how": "pixels that no triangle covers although their ray meets the ellipsoid lowered to the lowest terrain \
                    (settled views), or although terrain stands above them in the same vertical plane (every view); \
                    from 0.3 m above the drawn ground, or as much more as keeps it beyond the 0.2 m at which pictures \
                    begin, to 12 km; holes counts views (poses, hard cases and hungry frames), hole_pixels pixels",
        })
    }
}

/// What is looked at, and with what.
#[derive(Debug)]
pub struct Search<'a> {
    /// The GPU.
    pub gpu: &'a Rc<Gpu>,
    /// How they are drawn; vertices along a side of a level are those of the first lot.
    pub settings: Settings,
    /// Numbers of the views. From 0 on, the hard cases come with them.
    pub numbers: Range<usize>,
}

impl Search<'_> {
    /// Looks at every view; `done` is told of each, and of what was found when it has a hole.
    ///
    /// # Errors
    /// When the GPU refuses, or a view does not settle.
    pub fn run<S: TileSource>(
        &self,
        pack: Option<&Arc<S>>,
        done: &mut dyn FnMut(&Found),
    ) -> Result<Found, Failure> {
        let mut found = Found::default();
        if self.numbers.start == 0 {
            let planet = Arc::new(Planet::new(Kind::Earth, 1200));
            let mut bench = Bench::new(self.gpu, &planet, self.settings)?;
            hard(&mut bench, planet.info().height_min_m, &mut found)?;
        }
        for (lot, &(kind, posts_per_degree, vertices)) in LOTS.iter().enumerate() {
            let places = self.numbers.start / VIEWS..self.numbers.end.div_ceil(VIEWS);
            let mut places = places
                .filter(|place| TURNS[place % TURNS.len()] == lot)
                .peekable();
            if places.peek().is_none() {
                continue;
            }
            let settings = Settings {
                shape: Shape::new(vertices).unwrap_or(self.settings.shape),
                ..self.settings
            };
            match pack {
                Some(pack) if lot == 0 => self.look(pack, settings, places, &mut found, done)?,
                _ => {
                    let planet = Arc::new(Planet::new(kind, posts_per_degree));
                    self.look(&planet, settings, places, &mut found, done)?;
                }
            }
        }
        Ok(found)
    }

    /// Looks at places of a source.
    fn look<S: TileSource>(
        &self,
        source: &Arc<S>,
        settings: Settings,
        places: impl Iterator<Item = usize>,
        found: &mut Found,
        done: &mut dyn FnMut(&Found),
    ) -> Result<(), Failure> {
        let info = source.info();
        let mut bench = Bench::new(self.gpu, source, settings)?;
        for place in places {
            let near = place_of(place, info);
            if place % 4 == 0 {
                hungry(&mut bench, info, near, place, found)?;
            }
            let over = camera((near.0, near.1, 9500.0), (0.0, -20.0, 0.0), 60.0, SIZES[0]);
            bench.settle(&over)?;
            let views = place * VIEWS..(place + 1) * VIEWS;
            for number in views.filter(|n| self.numbers.contains(n)) {
                let (view, figures) = random_view(&mut bench, number, near)?;
                let pixels = holes(&mut bench, &view, &figures, info.height_min_m)?;
                found.poses += 1;
                found.see(&format!("pose {number}"), &view, pixels, &figures);
                done(found);
            }
        }
        Ok(())
    }
}

/// Where a place is, degrees north and east: on a whole planet anywhere, else around what the source covers.
fn place_of(place: usize, info: &PackInfo) -> (f64, f64) {
    let mut dice = Dice::of(1, place);
    let b = info.bounds;
    let is_hard = place.is_multiple_of(3);
    if b.east_deg - b.west_deg > 350.0 {
        if is_hard {
            return HARD[place / 3 % HARD.len()];
        }
        let sin = dice.between(-1.0, 1.0);
        return (sin.asin().to_degrees(), dice.between(-180.0, 180.0));
    }
    let (lat, lon) = if is_hard {
        // Its corners, the middles of its edges, and its own.
        let nth = place / 3;
        let third = |low: f64, high: f64, k: usize| [low, f64::midpoint(low, high), high][k % 3];
        (
            third(b.south_deg, b.north_deg, nth),
            third(b.west_deg, b.east_deg, nth / 3),
        )
    } else {
        // A little of what lies beyond its edges.
        (
            dice.between(b.south_deg - 0.1, b.north_deg + 0.1),
            dice.between(b.west_deg - 0.1, b.east_deg + 0.1),
        )
    };
    (lat.clamp(-90.0, 90.0), lon)
}

/// The view of a number near a place, at most a few kilometres from it, any attitude, above the ground as it is drawn.
fn random_view(
    bench: &mut Bench,
    number: usize,
    near: (f64, f64),
) -> Result<(Camera, FrameFigures), Failure> {
    let mut dice = Dice::of(2, number);
    let narrow = near.0.to_radians().cos().max(1e-3);
    let lat = (near.0 + dice.between(-0.03, 0.03)).clamp(-90.0, 90.0);
    let lon = near.1 + dice.between(-0.03, 0.03) / narrow;
    let share = dice.between(0.0, 1.0);
    let attitude = (
        dice.between(0.0, 360.0),
        dice.between(-90.0, 30.0),
        dice.between(-180.0, 180.0),
    );
    let hfov_deg = dice.pick(&[2.0, 30.0, 60.0, 90.0, 120.0]);
    let is_usual = dice.between(0.0, 1.0) < 0.85;
    let size = if is_usual {
        SIZES[0]
    } else {
        dice.pick(&SIZES)
    };
    let ground = bench.terrain.ground(&Geodetic::from_degrees(lat, lon, 0.0));
    let guess_m = ground.map_or(0.0, |g| g.0) + 10_f64.powf(HIGHEST_LOG10 * share);
    let mut view = camera((lat, lon, guess_m), attitude, hfov_deg, size);
    // Where the eye is decides what is drawn, and that decides where the ground is. It need not end: then the eye is inside
    // the ground, or higher above it than meant.
    for _ in 0..4 {
        let figures = bench.settle(&view)?;
        let Some(under) = bench.terrain.scene().and_then(Under::of) else {
            return Ok((view, figures));
        };
        let least_m = under.clearance_m(&view).max(LOWEST_M);
        let above_m = least_m * (10_f64.powf(HIGHEST_LOG10) / least_m).powf(share);
        let height_m = (under.top_m + above_m).min(19_900.0);
        if (view.eye.height_ellipsoid.0 - height_m).abs() < 1e-3 {
            return Ok((view, figures));
        }
        view.eye.height_ellipsoid.0 = height_m;
    }
    let figures = bench.settle(&view)?;
    Ok((view, figures))
}

/// The hard cases of [`hard_cases`], in small pictures of the same shape.
fn hard(bench: &mut Bench, lowest_m: f64, found: &mut Found) -> Result<(), Failure> {
    for case in hard_cases() {
        let mut view = case.camera;
        let shrink = (view.width_px / 240).max(1);
        (view.width_px, view.height_px) = (view.width_px / shrink, view.height_px / shrink);
        let view = above_ground(bench, &view)?;
        let figures = bench.settle(&view)?;
        let pixels = holes(bench, &view, &figures, lowest_m)?;
        found.hard_cases += 1;
        found.see(&case.name, &view, pixels, &figures);
    }
    Ok(())
}

/// Frames while terrain is missing: right after a leap to a place, and along a flight with no quota at all. High enough that
/// the eye is above whatever is drawn.
fn hungry(
    bench: &mut Bench,
    info: &PackInfo,
    near: (f64, f64),
    place: usize,
    found: &mut Found,
) -> Result<(), Failure> {
    let height_m = info.height_max_m + 400.0;
    // Away from the pole of its side: a latitude beyond it is none.
    let over = |k: u32| {
        let k = f64::from(k);
        let attitude = (9.0 * k, -15.0 - k % 30.0, 4.0 * k);
        let lat = near.0 - 0.04 * k * near.0.signum();
        camera((lat, near.1 - 0.06 * k, height_m), attitude, 60.0, SIZES[0])
    };
    for frame in 0..2 * HUNGRY_FRAMES {
        let is_leap = frame < HUNGRY_FRAMES;
        if frame == HUNGRY_FRAMES {
            bench.settle(&over(0))?;
        }
        let view = over(frame.saturating_sub(HUNGRY_FRAMES));
        let figures = bench.step(&view, if is_leap { QUOTA } else { 0 })?;
        let pixels = holes(bench, &view, &figures, info.height_min_m)?;
        found.hungry_frames += 1;
        found.see(
            &format!("place {place}, frame {frame}"),
            &view,
            pixels,
            &figures,
        );
        if is_leap {
            // A frame's time, for the streaming thread.
            std::thread::park_timeout(FRAME);
        }
    }
    Ok(())
}

/// Between two frames after a leap.
const FRAME: Duration = Duration::from_millis(10);
