//! From the panel's size to the places of the instruments.
//!
//! The measures are those of a 1024 x 600 panel; others are scaled by what fits. Left and right groups keep to their edges,
//! the attitude symbols to the middle.

use super::list::Rect;
use crate::display::NOTES_MAX;
use glam::Vec2;

/// The panel on which the measures of this module are given, in pixels.
const DESIGN: Vec2 = Vec2::new(1024.0, 600.0);

/// The most lines of notes.
#[expect(clippy::cast_precision_loss, reason = "a dozen")]
const NOTES: f32 = NOTES_MAX as f32;

/// Where everything is, in pixels from the upper left corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layout {
    /// Size of the panel.
    pub size: Vec2,
    /// One unit of the design in pixels.
    pub unit: f32,
    /// The middle of the picture: the optical axis and the fixed aircraft symbol.
    pub centre: Vec2,
    /// Radius of the roll scale.
    pub roll_radius: f32,
    /// Airspeed tape.
    pub airspeed: Rect,
    /// Its title.
    pub airspeed_title: Rect,
    /// Altitude tape.
    pub altitude: Rect,
    /// Its title.
    pub altitude_title: Rect,
    /// Barometric setting.
    pub baro: Rect,
    /// Engine strip.
    pub engine: Rect,
    /// True airspeed.
    pub true_airspeed: Rect,
    /// Wind.
    pub wind: Rect,
    /// Temperature of the air.
    pub temperature: Rect,
    /// Density altitude.
    pub density_altitude: Rect,
    /// Other aircraft: a title and a line for each.
    pub traffic: Rect,
    /// Height above the ground.
    pub height_above_ground: Rect,
    /// Vertical speed scale.
    pub vertical_speed: Rect,
    /// Heading tape.
    pub heading: Rect,
    /// Window with the heading in figures.
    pub heading_window: Rect,
    /// Ground speed.
    pub ground_speed: Rect,
    /// Track.
    pub track: Rect,
    /// Why there is no terrain.
    pub annunciation: Rect,
    /// Lines about values that are shown: room for all of them.
    pub notes: Rect,
    /// Where the flag of a missing attitude stands.
    pub attitude_flag: Rect,
    /// Where the flag of a missing slip ball stands.
    pub slip_flag: Rect,
}

impl Layout {
    /// For a panel of the given size.
    #[must_use]
    pub fn new(width_px: u32, height_px: u32) -> Self {
        #[expect(
            clippy::cast_precision_loss,
            reason = "panels are far smaller than 2^24"
        )]
        let size = Vec2::new(width_px as f32, height_px as f32);
        let unit = (size / DESIGN).min_element();
        let centre = size * 0.5;
        // From the left edge, from the right edge (x negative), or from the middle; y always from the middle.
        let left = |x: f32, y: f32, w: f32, h: f32| {
            Rect::new(x * unit, centre.y + y * unit, w * unit, h * unit).snapped()
        };
        let right = |x: f32, y: f32, w: f32, h: f32| {
            Rect::new(size.x - x * unit, centre.y + y * unit, w * unit, h * unit).snapped()
        };
        let middle = |x: f32, y: f32, w: f32, h: f32| {
            Rect::new(centre.x + x * unit, centre.y + y * unit, w * unit, h * unit).snapped()
        };
        Self {
            size,
            unit,
            centre,
            roll_radius: 215.0 * unit,
            airspeed_title: left(36.0, -226.0, 92.0, 24.0),
            airspeed: left(36.0, -200.0, 92.0, 400.0),
            ground_speed: left(36.0, 206.0, 116.0, 24.0),
            track: left(36.0, 232.0, 116.0, 24.0),
            altitude_title: right(186.0, -226.0, 108.0, 24.0),
            altitude: right(186.0, -200.0, 108.0, 400.0),
            baro: right(186.0, 206.0, 108.0, 26.0),
            height_above_ground: right(186.0, 234.0, 130.0, 24.0),
            density_altitude: right(186.0, 260.0, 130.0, 24.0),
            engine: middle(-476.0, -294.0, 952.0, 54.0),
            true_airspeed: left(36.0, 258.0, 116.0, 24.0),
            wind: left(156.0, 206.0, 112.0, 50.0),
            temperature: left(156.0, 258.0, 112.0, 24.0),
            traffic: left(144.0, -146.0, 128.0, 110.0),
            vertical_speed: right(76.0, -150.0, 52.0, 300.0),
            heading: middle(-240.0, 250.0, 480.0, 42.0),
            heading_window: middle(-46.0, 217.0, 92.0, 32.0),
            annunciation: left(144.0, -198.0, 128.0, 46.0),
            notes: right(318.0, -198.0, 128.0, 18.0 * NOTES),
            attitude_flag: middle(-190.0, -140.0, 380.0, 280.0),
            slip_flag: middle(-52.0, -188.0, 104.0, 20.0),
        }
    }

    /// `x` design units in pixels.
    #[must_use]
    pub fn px(&self, x: f32) -> f32 {
        x * self.unit
    }

    /// A line of `x` design units in pixels, never thinner than one pixel.
    #[must_use]
    pub fn line(&self, x: f32) -> f32 {
        (x * self.unit).max(1.0)
    }

    /// All rectangles, for checks.
    #[must_use]
    pub const fn rects(&self) -> [Rect; 21] {
        [
            self.airspeed_title,
            self.airspeed,
            self.altitude_title,
            self.altitude,
            self.baro,
            self.height_above_ground,
            self.density_altitude,
            self.engine,
            self.true_airspeed,
            self.wind,
            self.temperature,
            self.traffic,
            self.vertical_speed,
            self.heading,
            self.heading_window,
            self.ground_speed,
            self.track,
            self.annunciation,
            self.notes,
            self.attitude_flag,
            self.slip_flag,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instruments_lie_on_the_panel_and_not_on_each_other() {
        for (w, h) in [
            (1024, 600),
            (800, 480),
            (1280, 800),
            (1920, 1080),
            (640, 480),
        ] {
            let layout = Layout::new(w, h);
            let rects = layout.rects();
            // The last two stand over the attitude symbols, in their place.
            for (i, a) in rects.iter().enumerate() {
                assert!(a.min.min_element() >= 0.0, "{w}x{h}: {i} {a:?}");
                assert!(a.max.cmple(layout.size).all(), "{w}x{h}: {i} {a:?}");
                for (j, b) in rects[..19].iter().enumerate() {
                    let apart = a.max.cmple(b.min).any() || b.max.cmple(a.min).any();
                    assert!(i == j || apart, "{w}x{h}: {i} {a:?} on {j} {b:?}");
                }
            }
        }
    }
}
