//! Attitude: sky and ground, the horizon line, the pitch ladder, the aircraft symbol, chevrons at unusual attitudes.
//!
//! The picture is a gnomonic projection (a pinhole camera): a point at angle `a` from the optical axis is `f tan a` pixels
//! from the centre, `f` the focal length. In the vertical plane of the nose the elevation `e` is at `f tan(e - pitch)`
//! above the centre, turned by the roll.

use super::flags;
use super::pen::{Align, Pass, Pen, bold, px, regular};
use crate::display::colour::{self, Colour};
use crate::display::{Model, PitchRoll, SvsOff, Terrain, format};
use crate::units::Radians;
use glam::Vec2;

/// How the world lies on the screen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Projection {
    centre: Vec2,
    /// Focal length in pixels.
    focal: f64,
    pitch: f64,
    /// Unit vectors on the screen: to the right along the horizon, and up from it.
    pub(super) right: Vec2,
    pub(super) up: Vec2,
}

impl Projection {
    pub(super) fn new(pen: &Pen<'_>, hfov: Radians, attitude: PitchRoll) -> Self {
        // Right wing down turns the world anticlockwise on the screen: its up leans to the left.
        let (sin, cos) = attitude.roll.0.sin_cos();
        let half_width = f64::from(pen.layout.size.x) * 0.5;
        Self {
            centre: pen.layout.centre,
            focal: half_width / (hfov.0 * 0.5).tan(),
            pitch: attitude.pitch.0,
            right: Vec2::new(px(cos), px(-sin)),
            up: Vec2::new(px(-sin), px(-cos)),
        }
    }

    /// Pixels from the centre upwards to the elevation `elevation` (radians); saturates near 90 degrees off the axis,
    /// far outside of any panel.
    fn rise(&self, elevation: f64) -> f32 {
        let off_axis = (elevation - self.pitch).clamp(-1.55, 1.55);
        px(self.focal * off_axis.tan())
    }

    /// The point `right` and `up` pixels from the centre in the turned frame.
    fn at(&self, right: f32, up: f32) -> Vec2 {
        self.centre + self.right * right + self.up * up
    }
}

/// The elevation kept on the plain background of the colour that would be out of sight (AC 25-11B, appendix A).
const KEPT: f64 = 5.0;

/// Draws everything of attitude but the roll scale.
pub(super) fn draw(pen: &mut Pen<'_>, model: &Model) {
    let attitude = match model.attitude {
        Ok(attitude) => attitude,
        Err(reason) => {
            let size = pen.layout.size;
            let whole = super::list::Rect::new(0.0, 0.0, size.x, size.y);
            pen.list.rect(whole.grown(2.0), colour::VOID);
            let place = pen.layout.attitude_flag;
            flags::cover_attitude(pen, place, reason);
            return;
        }
    };
    let projection = Projection::new(pen, model.hfov, attitude);
    if model.svs.is_err() {
        draw_background(pen, &projection);
    }
    draw_horizon_line(pen, &projection);
    for pass in Pass::BOTH {
        draw_ladder(pen, &projection, pass);
    }
    draw_chevrons(pen, &projection);
    draw_aircraft(pen);
}

/// Sky over earth, each with a gradient from the horizon.
fn draw_background(pen: &mut Pen<'_>, p: &Projection) {
    let size = pen.layout.size;
    let far = size.length();
    // How far the panel reaches in the direction of up: beyond that, nothing of the other colour would be seen.
    let reach = p.up.abs().dot(size) * 0.5;
    let kept = px(p.focal * KEPT.to_radians().tan()).min(reach * 0.5);
    let horizon = p.rise(0.0).clamp(kept - reach, reach - kept);
    let shade = px(p.focal * 25_f64.to_radians().tan());
    let whole = super::list::Rect::new(0.0, 0.0, size.x, size.y);
    pen.list.rect(whole.grown(2.0), colour::SKY_HIGH);
    let mut band = |from: f32, to: f32, near: Colour, deep: Colour, smooth: bool| {
        pen.list.polygon(
            [
                p.at(-far, from),
                p.at(far, from),
                p.at(far, to),
                p.at(-far, to),
            ],
            [smooth, false, false, false],
            [near, near, deep, deep],
        );
    };
    // The sky begins a pixel below the horizon so that the smooth edge of the earth lies on it.
    band(
        horizon - 1.0,
        horizon + shade,
        colour::SKY_LOW,
        colour::SKY_HIGH,
        false,
    );
    band(
        horizon,
        horizon - shade,
        colour::EARTH_HIGH,
        colour::EARTH_LOW,
        true,
    );
    band(
        horizon - shade,
        horizon - shade - 2.0 * far,
        colour::EARTH_LOW,
        colour::EARTH_LOW,
        false,
    );
}

/// The line of zero elevation, across the whole picture; only ever in its true place.
fn draw_horizon_line(pen: &mut Pen<'_>, p: &Projection) {
    let far = pen.layout.size.length();
    let rise = p.rise(0.0);
    if rise.abs() > far {
        return;
    }
    let (from, to) = (p.at(-far, rise), p.at(far, rise));
    let width = pen.layout.line(2.0);
    for pass in Pass::BOTH {
        pen.stroke(pass, from, to, width, colour::SCALE);
    }
}

/// The ladder's marks lie between these distances from the centre, in design units (up positive), and fade beyond them:
/// above is the roll scale, below the heading window.
const LADDER_REACH: (f32, f32) = (-170.0, 158.0);
const LADDER_FADE: f32 = 12.0;

fn ladder_opacity(pen: &Pen<'_>, rise: f32) -> f32 {
    let rise = rise / pen.layout.unit;
    let inside = (rise - LADDER_REACH.0).min(LADDER_REACH.1 - rise);
    (inside / LADDER_FADE + 1.0).clamp(0.0, 1.0)
}

/// Marks each 10, 5 and (within 20 degrees of the horizon) 2.5 degrees, with figures each 10.
fn draw_ladder(pen: &mut Pen<'_>, p: &Projection, pass: Pass) {
    // In units of 2.5 degrees: 36 of them to the zenith.
    for k in (-36_i32..=36).filter(|k| *k != 0) {
        let elevation = f64::from(k) * 2.5;
        let (half, weight) = match k {
            k if k % 4 == 0 => (56.0, 2.0),
            // Beyond the chevrons' attitudes their places are those of the fives.
            k if k % 2 == 0 && (-9..=13).contains(&k) => (32.0, 2.0),
            k if k.abs() < 8 => (15.0, 1.6),
            _ => continue,
        };
        let rise = p.rise(elevation.to_radians());
        let opacity = ladder_opacity(pen, rise);
        if opacity <= 0.0 {
            continue;
        }
        let ink = colour::SCALE.faded(opacity);
        let (half, width) = (pen.px(half), pen.layout.line(weight));
        pen.stroke(pass, p.at(-half, rise), p.at(half, rise), width, ink);
        if k % 4 == 0 {
            let label = format::mark(i64::from(k.abs() / 4 * 10));
            let out = half + pen.px(8.0);
            let style = bold(12.0, ink);
            pen.turned_text(
                &label,
                p.at(-out, rise),
                Align::Right,
                p.right,
                style,
                Some(pass),
            );
            pen.turned_text(
                &label,
                p.at(out, rise),
                Align::Left,
                p.right,
                style,
                Some(pass),
            );
        }
    }
}

/// Red chevrons that point to the horizon, from 30 degrees nose up and 20 degrees nose down (FAA Instrument Flying
/// Handbook, figure 5-70, has them on the way to the same attitudes).
fn draw_chevrons(pen: &mut Pen<'_>, p: &Projection) {
    for pass in Pass::BOTH {
        for elevation in [
            85.0_f64, 75.0, 65.0, 55.0, 45.0, 35.0, -25.0, -35.0, -45.0, -55.0, -65.0, -75.0, -85.0,
        ] {
            let rise = p.rise(elevation.to_radians());
            let opacity = ladder_opacity(pen, rise);
            if opacity <= 0.0 {
                continue;
            }
            let toward = if elevation > 0.0 { -1.0 } else { 1.0 };
            let ink = pass.colour(colour::WARNING.faded(opacity));
            let grow = if pass == Pass::Rim { pen.px(1.6) } else { 0.0 };
            let (half, tall, thick) = (pen.px(34.0) + grow, pen.px(20.0), pen.px(9.0) + 2.0 * grow);
            // The apex towards the horizon; both arms share the line through it.
            let apex = rise + toward * (pen.px(9.0) + grow);
            for side in [-1.0, 1.0] {
                let corners = [
                    p.at(0.0, apex),
                    p.at(side * half, apex - toward * tall),
                    p.at(side * half, apex - toward * (tall + thick)),
                    p.at(0.0, apex - toward * thick),
                ];
                pen.list
                    .polygon(corners, [true, true, true, false], [ink; 4]);
            }
        }
    }
}

/// The fixed aircraft: black bars with a white rim, so that it is not taken for a mark of the ladder.
fn draw_aircraft(pen: &mut Pen<'_>) {
    let c = pen.layout.centre.round();
    let s = |x: f32| (x * pen.layout.unit).round();
    let (near, far, leg, half) = (s(86.0), s(150.0), s(16.0), s(3.0));
    let rim = pen.layout.line(2.0).round();
    let bar = |left: f32, top: f32, right: f32, bottom: f32| super::list::Rect {
        min: c + Vec2::new(left, top),
        max: c + Vec2::new(right, bottom),
    };
    let bars = [
        bar(-far, -half, -near, half),
        bar(-near - 2.0 * half, -half, -near, leg),
        bar(near, -half, far, half),
        bar(near, -half, near + 2.0 * half, leg),
        bar(-half, -half, half, half),
    ];
    for (grow, ink) in [
        (rim + pen.layout.line(1.2), colour::HALO),
        (rim, colour::SCALE),
        (0.0, colour::WINDOW),
    ] {
        for b in bars {
            pen.list.rect(b.grown(grow), ink);
        }
    }
}

/// Says why there is no terrain, or what is wrong with it.
pub(super) fn draw_annunciation(pen: &mut Pen<'_>, model: &Model) {
    let (title, label, ink) = match (model.svs, model.svs_caution) {
        (Ok(_), None) => return,
        (Ok(_), Some(caution)) => ("TERRAIN", caution.label(), colour::CAUTION),
        // Nothing was lost where there never was any terrain: that is no caution.
        (Err(off @ SvsOff::Terrain(Terrain::NoPack | Terrain::Loading)), _) => {
            ("SVS OFF", off.label(), colour::LABEL)
        }
        (Err(off), _) => ("SVS OFF", off.label(), colour::CAUTION),
    };
    let rect = pen.layout.annunciation;
    pen.field(rect);
    let centre = rect.centre();
    let step = Vec2::Y * pen.px(10.0);
    pen.text(title, centre - step, Align::Centre, bold(10.5, ink));
    pen.text(label, centre + step, Align::Centre, regular(10.5, ink));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::draw::atlas::Atlas;
    use crate::draw::{DrawList, Layout};

    fn projection(pitch: f64, roll: f64) -> Projection {
        let layout = Layout::new(1024, 600);
        let atlas = Atlas::build().unwrap_or_else(|e| unreachable!("{e}"));
        let mut list = DrawList::new();
        let attitude = PitchRoll {
            pitch: Radians::from_degrees(pitch),
            roll: Radians::from_degrees(roll),
        };
        Projection::new(
            &Pen::new(&mut list, &atlas, &layout),
            Radians::from_degrees(60.0),
            attitude,
        )
    }

    #[test]
    fn nose_up_lowers_the_horizon_and_right_wing_down_raises_its_right_end() {
        let level = projection(0.0, 0.0);
        assert!(
            (level.at(0.0, level.rise(0.0)) - Vec2::new(512.0, 300.0)).length() < 1e-3,
            "{level:?}"
        );
        let up = projection(10.0, 0.0);
        assert!(up.at(0.0, up.rise(0.0)).y > 300.0, "y grows downwards");
        let right_down = projection(0.0, 20.0);
        assert!(
            right_down.at(100.0, 0.0).y < 300.0 && right_down.at(-100.0, 0.0).y > 300.0,
            "{right_down:?}"
        );
    }

    #[test]
    fn the_horizon_and_the_ladder_stand_where_the_camera_sees_them() {
        // Against the camera of crate::geo, which is tested on its own: the ray through the place of elevation e must
        // rise by e above the local horizontal.
        use crate::geo::{Attitude, Camera, Geodetic};
        for (pitch, roll) in [(0.0, 0.0), (7.0, -33.0), (-12.0, 80.0), (20.0, 170.0)] {
            let camera = Camera {
                eye: Geodetic::from_degrees(50.0, 14.0, 1000.0),
                attitude: Attitude::from_degrees(123.0, pitch, roll),
                hfov: Radians::from_degrees(60.0),
                width_px: 1024,
                height_px: 600,
            };
            let up = -camera.eye.ned_to_ecef().z_axis;
            let p = projection(pitch, roll);
            for elevation in [-10.0_f64, 0.0, 2.5, 15.0] {
                let at = p.at(0.0, p.rise(elevation.to_radians()));
                let ray = camera.ray_ecef(f64::from(at.x), f64::from(at.y));
                let seen = ray.dot(up).asin().to_degrees();
                assert!(
                    (seen - elevation).abs() < 0.003,
                    "{pitch} {roll}: {elevation} seen at {seen}"
                );
            }
            // The horizon is elevation 0 all along its line.
            for along in [-300.0, 450.0] {
                let at = p.at(along, p.rise(0.0));
                let ray = camera.ray_ecef(f64::from(at.x), f64::from(at.y));
                assert!(
                    ray.dot(up).asin().to_degrees().abs() < 0.003,
                    "{pitch} {roll} {along}"
                );
            }
        }
    }
}
