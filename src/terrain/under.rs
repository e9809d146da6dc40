//! The ground under an eye as it is drawn, and whether the eye is clear of it.

use super::clipmap::Morph;
use super::plan::LevelPlan;
use super::scene::Scene;
use super::slices::NEAR_MIN_M;
use super::stream::Streamer;
use super::tables::HeightCode;
use crate::geo::{Camera, WGS84_B_M};

/// What is drawn under an eye, of the finest level drawn, which in a small picture may be a coarse one.
#[derive(Clone, Copy, Debug)]
pub struct Under {
    /// No lower than anything drawn of the cell under the eye, whatever the blend, metres above the ellipsoid.
    pub top_m: f64,
    /// No lower than the drawn surface right under the eye, metres above the ellipsoid.
    pub surface_m: f64,
    /// The steepest that the surface is there and in the cells around, metres a metre.
    pub slope: f64,
}

/// Where the picture begins, metres before the eye: a little more than drawing's.
const NEAR_M: f64 = 1.05 * NEAR_MIN_M;

impl Under {
    /// Under the eye of a scene's last frame; `None` where nothing is drawn there, or too near the edge of what is.
    #[must_use]
    pub fn of(scene: &Scene) -> Option<Self> {
        let finest = scene.plan().levels.first()?;
        let latitude = scene.eye_latitude_deg().to_radians();
        let spacing_m = scene.grid().spacing_deg(finest.level).to_radians() * WGS84_B_M;
        let narrow_m = spacing_m * latitude.cos().max(0.02);
        let on = (scene.streamer(), scene.heights());
        Self::at(on, finest, scene.eye_on(finest.level), narrow_m)
    }

    /// The same under a post position of a drawn level whose posts are nowhere nearer to each other than `spacing_m`.
    fn at(
        (streamer, heights): (&Streamer, HeightCode),
        finest: &LevelPlan,
        (x, y): (f64, f64),
        spacing_m: f64,
    ) -> Option<Self> {
        let first = |v: f64, origin: i32| {
            let post = whole(v);
            (origin + 1..origin + finest.cells - 1)
                .contains(&post)
                .then_some(post)
        };
        let level = finest.level;
        let (i, j) = (first(x, finest.window.i)?, first(y, finest.window.j)?);
        let top_m = heights.decode(streamer.top_code(level, (i, j), (i + 1, j + 1)));
        let floor = (0..16).map(|k| streamer.floor_code(level, i + k % 4 - 1, j + k / 4 - 1));
        let highest = streamer.top_code(level, (i - 1, j - 1), (i + 2, j + 2));
        let range_m = f64::from(highest - floor.min()?) * heights.unit_m;
        let cell = (i - finest.window.i, j - finest.window.j);
        let surface_m = match streamer.ground_code(level, x, y) {
            Ok(code) if is_plain(&finest.morph, cell) => heights.base_m + code * heights.unit_m,
            // Blended, or a void, which is drawn all the same.
            _ => top_m,
        };
        Some(Self {
            top_m,
            surface_m,
            slope: range_m * std::f64::consts::SQRT_2 / spacing_m,
        })
    }

    /// How high above the surface an eye must be for none of it to be nearer than the picture's beginning, metres.
    #[must_use]
    pub fn clearance_m(&self, camera: &Camera) -> f64 {
        let half = |side: u32| f64::from(side) / 2.0 / camera.focal_px();
        let (across, up) = (half(camera.width_px), half(camera.height_px));
        let corner_m = NEAR_M * (1.0 + across * across + up * up).sqrt();
        corner_m * self.slope.hypot(1.0)
    }

    /// Whether an eye is above the surface by that much.
    #[must_use]
    pub fn is_cleared_by(&self, camera: &Camera) -> bool {
        let above_m = camera.eye.height_ellipsoid.0 - self.surface_m;
        above_m > self.clearance_m(camera)
    }
}

/// Whether no corner of a cell is blended.
fn is_plain(morph: &Morph, (x, y): (i32, i32)) -> bool {
    (0..4).all(|k| morph.alpha(x + k % 2, y + k / 2) <= 0.0)
}

#[expect(clippy::cast_possible_truncation, reason = "a post number on Earth")]
fn whole(v: f64) -> i32 {
    v.floor() as i32
}
