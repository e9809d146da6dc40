//! The airspeed and altitude tapes with their rolling readouts, and the box of the barometric setting.

use super::flags;
use super::list::Rect;
use super::pen::{Align, Pen, Style, bold, px, regular};
use crate::display::colour::{self, Colour};
use crate::display::format::{self, Rolling, Text, Wheel};
use crate::display::{Airspeed, AirspeedKind, Altitude, AltitudeKind, BaroBox, Model, VSpeeds};
use crate::units::Knots;
use glam::Vec2;

/// Knots over the height of the tape.
const AIRSPEED_SPAN_KT: f64 = 60.0;
/// Feet over the height of the tape.
const ALTITUDE_SPAN_FT: f64 = 600.0;

/// A vertical scale on which `value` stands in the middle of `rect`.
#[derive(Clone, Copy)]
struct Scale {
    rect: Rect,
    value: f64,
    per_unit: f64,
}

impl Scale {
    fn new(rect: Rect, value: f64, span: f64) -> Self {
        Self {
            rect,
            value,
            per_unit: f64::from(rect.height()) / span,
        }
    }

    /// Where `mark` stands, in pixels from the top of the picture.
    fn y(&self, mark: f64) -> f32 {
        self.rect.centre().y - px((mark - self.value) * self.per_unit)
    }

    /// Pixels between a label at `y` and the nearer end of the tape.
    fn room(&self, pen: &Pen<'_>, y: f32) -> f32 {
        (y - self.rect.min.y).min(self.rect.max.y - y) - pen.px(7.0)
    }

    /// The marks `step` apart that are seen, with one more at each end, as multiples of `step`.
    fn marks(&self, step: f64) -> std::ops::RangeInclusive<i64> {
        let half = f64::from(self.rect.height()) * 0.5 / self.per_unit;
        let low = format::whole_below((self.value - half) / step);
        low..=format::whole_below((self.value + half) / step) + 1
    }
}

/// Draws the airspeed tape or its flag.
pub(super) fn draw_airspeed(pen: &mut Pen<'_>, model: &Model) {
    let (rect, title) = (pen.layout.airspeed, pen.layout.airspeed_title);
    let airspeed = match model.airspeed {
        Ok(airspeed) => airspeed,
        Err(reason) => {
            flags::cover(pen, rect, "AIRSPEED", reason);
            return;
        }
    };
    let name = match airspeed.kind {
        AirspeedKind::Indicated => "IAS",
        AirspeedKind::Calibrated => "CAS",
    };
    draw_title(pen, title, name, "KT", airspeed.reverted);
    pen.panel(rect);
    pen.list.clip(Some(rect));
    let scale = Scale::new(rect, airspeed.speed.0, AIRSPEED_SPAN_KT);
    draw_arcs(pen, scale, model.v_speeds);
    let ticks = rect.max.x - pen.px(9.0);
    for k in scale.marks(5.0).filter(|k| *k >= 0) {
        let y = scale.y(format::real(k) * 5.0);
        let (long, even) = if k % 2 == 0 {
            (14.0, true)
        } else {
            (8.0, false)
        };
        let from = Vec2::new(ticks - pen.px(long), y);
        let width = pen.layout.line(1.8);
        pen.list
            .line(from, Vec2::new(ticks, y), width, colour::SCALE);
        if even {
            let at = Vec2::new(ticks - pen.px(20.0), y);
            let style = pen.entering(bold(11.5, colour::SCALE), scale.room(pen, y));
            pen.moving_text(&format::mark(k * 5), at, Align::Right, style);
        }
    }
    pen.list.clip(None);
    draw_airspeed_readout(pen, rect, airspeed, model.v_speeds.vne);
}

/// The coloured arcs along the right edge (AC 23.1311-1C, 17.6 and 17.8): red below VS0 and from VNE, white VS0 to VFE,
/// green VS1 to VNO, yellow VNO to VNE.
fn draw_arcs(pen: &mut Pen<'_>, scale: Scale, v: VSpeeds) {
    let right = scale.rect.max.x - pen.px(1.0);
    let mut arc = |from: Option<Knots>, to: Option<Knots>, wide: f32, colour: Colour| {
        if let (Some(Knots(from)), Some(Knots(to))) = (from, to)
            && from < to
        {
            // Beyond the tape by a little at most, however far the limits are.
            let edge = |y: f32| y.clamp(scale.rect.min.y - 9.0, scale.rect.max.y + 9.0);
            let (top, bottom) = (edge(scale.y(to)), edge(scale.y(from)));
            let width = pen.px(wide);
            pen.list
                .rect(Rect::new(right - width, top, width, bottom - top), colour);
        }
    };
    arc(Some(Knots(0.0)), v.vs0, 7.0, colour::WARNING);
    arc(v.vs1, v.vno, 7.0, colour::NORMAL);
    arc(v.vs0, v.vfe, 3.5, colour::SCALE);
    arc(v.vno, v.vne, 7.0, colour::CAUTION);
    arc(v.vne, Some(Knots(2000.0)), 7.0, colour::WARNING);
}

fn draw_airspeed_readout(pen: &mut Pen<'_>, tape: Rect, airspeed: Airspeed, vne: Option<Knots>) {
    // Red from the limit on: the digits turn red with the tape's red beside them.
    let ink = match vne {
        Some(vne) if airspeed.speed >= vne => colour::WARNING,
        _ => colour::SCALE,
    };
    let style = bold(17.0, ink);
    let middle = tape.centre().y.round();
    let digit = pen.width("0", style).ceil();
    let drum_right = (tape.max.x - pen.px(24.0)).round();
    let frame = Readout {
        middle,
        left: drum_right - (3.0 * digit + pen.px(12.0)).round(),
        drum_left: drum_right - digit - pen.px(4.0).round(),
        drum_right,
        tip: tape.max.x - pen.px(10.0),
        half: pen.px(18.0).round(),
        drum_half: pen.px(29.0).round(),
    };
    frame.draw(pen);
    let rolling = format::rolling_airspeed(airspeed.speed);
    draw_wheels(pen, &frame, &rolling, style, digit, 27.0);
    draw_drum(
        pen,
        &frame,
        rolling.drum,
        style,
        23.0,
        format::airspeed_drum_row,
    );
}

/// Draws the altitude tape or its flag, and the box of the setting.
pub(super) fn draw_altitude(pen: &mut Pen<'_>, model: &Model) {
    let (rect, title) = (pen.layout.altitude, pen.layout.altitude_title);
    draw_baro(pen, model);
    let altitude = match model.altitude {
        Ok(altitude) => altitude,
        Err(reason) => {
            flags::cover(pen, rect, "ALTITUDE", reason);
            return;
        }
    };
    let name = match altitude.kind {
        AltitudeKind::PilotBaro | AltitudeKind::SourceBaro => "ALT",
        AltitudeKind::Geometric => "GEO ALT",
    };
    draw_title(pen, title, name, "FT", altitude.reverted);
    pen.panel(rect);
    pen.list.clip(Some(rect));
    let scale = Scale::new(rect, altitude.altitude.0, ALTITUDE_SPAN_FT);
    for k in scale.marks(20.0) {
        draw_altitude_mark(pen, scale, k * 20);
    }
    pen.list.clip(None);
    draw_altitude_readout(pen, rect, altitude);
}

/// A mark each 20 ft, longer and with figures each 100, stronger each 500.
fn draw_altitude_mark(pen: &mut Pen<'_>, scale: Scale, feet: i64) {
    let left = scale.rect.min.x + pen.px(1.0);
    let y = scale.y(format::real(feet));
    let (long, weight) = match feet {
        f if f % 500 == 0 => (18.0, 3.2),
        f if f % 100 == 0 => (14.0, 1.8),
        _ => (7.0, 1.3),
    };
    let (to, width) = (Vec2::new(left + pen.px(long), y), pen.layout.line(weight));
    pen.list.line(Vec2::new(left, y), to, width, colour::SCALE);
    if feet % 100 == 0 {
        let style = if feet % 500 == 0 {
            bold(12.5, colour::SCALE)
        } else {
            regular(11.0, colour::SCALE)
        };
        let at = Vec2::new(left + pen.px(24.0), y);
        let style = pen.entering(style, scale.room(pen, y));
        pen.moving_text(&format::mark(feet), at, Align::Left, style);
    }
}

fn draw_altitude_readout(pen: &mut Pen<'_>, tape: Rect, altitude: Altitude) {
    let (large, small) = (bold(16.0, colour::SCALE), bold(13.0, colour::SCALE));
    let middle = tape.centre().y.round();
    let digit = pen.width("0", large).ceil();
    let left = (tape.min.x + pen.px(20.0)).round();
    let drum_left = left + (3.0 * digit + pen.px(5.0)).round();
    let frame = Readout {
        middle,
        left,
        drum_left,
        drum_right: drum_left + (pen.width("00", small) + pen.px(6.0)).round(),
        tip: tape.min.x + pen.px(7.0),
        half: pen.px(17.0).round(),
        drum_half: pen.px(29.0).round(),
    };
    frame.draw(pen);
    let rolling = format::rolling_altitude(altitude.altitude);
    draw_wheels(pen, &frame, &rolling, large, digit, 25.0);
    draw_drum(
        pen,
        &frame,
        rolling.drum,
        small,
        19.0,
        format::altitude_drum_row,
    );
}

/// The window of a rolling readout: a part for the wheels, a taller one for the drum, and a tip that points at the scale.
struct Readout {
    middle: f32,
    left: f32,
    drum_left: f32,
    drum_right: f32,
    /// Where the tip ends: right of the drum or left of the wheels.
    tip: f32,
    half: f32,
    drum_half: f32,
}

impl Readout {
    fn wheels(&self) -> Rect {
        Rect {
            min: Vec2::new(self.left, self.middle - self.half),
            max: Vec2::new(self.drum_left, self.middle + self.half),
        }
    }

    fn drum(&self) -> Rect {
        Rect {
            min: Vec2::new(self.drum_left, self.middle - self.drum_half),
            max: Vec2::new(self.drum_right, self.middle + self.drum_half),
        }
    }

    fn draw(&self, pen: &mut Pen<'_>) {
        let border = pen.layout.line(1.5).round();
        let base = if self.tip > self.drum_right {
            self.drum_right
        } else {
            self.left
        };
        let half = pen.px(8.0);
        // A little inside of the window, so that no seam shows between window and tip.
        let inside = (base - self.tip).signum() * 2.0;
        for (grow, ink) in [(border, colour::SCALE), (0.0, colour::WINDOW)] {
            pen.list.rect(self.wheels().grown(grow), ink);
            pen.list.rect(self.drum().grown(grow), ink);
            let reach = (self.tip - base).signum() * grow * 1.6;
            let corners = [
                Vec2::new(self.tip + reach, self.middle),
                Vec2::new(base + inside, self.middle - half - grow * 1.4),
                Vec2::new(base + inside, self.middle + half + grow * 1.4),
            ];
            pen.list.triangle(corners, ink);
        }
    }
}

/// The wheels, the lowest place beside the drum, and the minus sign before the first digit.
fn draw_wheels<const N: usize>(
    pen: &mut Pen<'_>,
    frame: &Readout,
    rolling: &Rolling<N>,
    style: Style,
    digit: f32,
    line: f32,
) {
    let area = frame.wheels();
    pen.list.clip(Some(area));
    // A higher number comes from above, as on the tape; below zero the magnitude grows downwards.
    let up = if rolling.mirrored {
        -pen.px(line)
    } else {
        pen.px(line)
    };
    let mut x = area.max.x - pen.px(2.0) - digit * 0.5;
    let mut first = x;
    for wheel in rolling.wheels.iter().rev() {
        let Wheel {
            digit: shown,
            next,
            turned,
        } = *wheel;
        let at = |rows: f64| Vec2::new(x, area.centre().y + up * px(rows));
        if let Some(shown) = shown {
            pen.moving_text(
                &format::mark(i64::from(shown)),
                at(turned),
                Align::Centre,
                style,
            );
            first = x;
        }
        if turned > 0.0 {
            pen.moving_text(
                &format::mark(i64::from(next)),
                at(turned - 1.0),
                Align::Centre,
                style,
            );
            first = x;
        }
        if shown.is_some() || turned > 0.0 {
            x -= digit;
        }
    }
    if rolling.negative {
        let before = if rolling.wheels.iter().all(|w| w.digit.is_none()) {
            first
        } else {
            first - digit
        };
        pen.text(
            "-",
            Vec2::new(before, area.centre().y),
            Align::Centre,
            style,
        );
    }
    shade(pen, area);
    pen.list.clip(None);
}

/// Darkens the upper and lower edge of a window, as if its digits stood on a cylinder.
fn shade(pen: &mut Pen<'_>, area: Rect) {
    let height = (area.height() * 0.2).round();
    let (clear, dark) = (colour::WINDOW.faded(0.0), colour::WINDOW);
    let Rect { min, max } = area;
    let width = area.width();
    pen.list
        .gradient(Rect::new(min.x, min.y, width, height), dark, clear);
    pen.list
        .gradient(Rect::new(min.x, max.y - height, width, height), clear, dark);
}

/// The drum: the rows around the middle, higher ones above.
fn draw_drum(
    pen: &mut Pen<'_>,
    frame: &Readout,
    drum: f64,
    style: Style,
    line: f32,
    row: impl Fn(i64) -> Text,
) {
    let area = frame.drum();
    pen.list.clip(Some(area));
    let below = format::whole_below(drum);
    for k in below - 1..=below + 2 {
        let offset = px(drum - format::real(k)) * pen.px(line);
        pen.moving_text(
            &row(k),
            area.centre() + Vec2::Y * offset,
            Align::Centre,
            style,
        );
    }
    shade(pen, area);
    pen.list.clip(None);
}

/// What the tape shows and its unit; amber where it is not the one that it should be.
fn draw_title(pen: &mut Pen<'_>, rect: Rect, name: &str, unit: &str, reverted: bool) {
    pen.field(rect);
    let ink = if reverted {
        colour::CAUTION
    } else {
        colour::LABEL
    };
    let y = rect.centre().y;
    let inset = pen.px(8.0);
    pen.text(
        name,
        Vec2::new(rect.min.x + inset, y),
        Align::Left,
        bold(10.0, ink),
    );
    pen.text(
        unit,
        Vec2::new(rect.max.x - inset, y),
        Align::Right,
        regular(10.0, colour::LABEL),
    );
}

fn draw_baro(pen: &mut Pen<'_>, model: &Model) {
    let rect = pen.layout.baro;
    let unit = format::baro_unit(model.baro_unit);
    let number = |pressure| format::baro(pressure, model.baro_unit);
    match model.baro {
        BaroBox::Pilot(pressure) => {
            draw_setting(pen, rect, "", &number(pressure), unit, colour::SELECTED)
        }
        BaroBox::Standard => draw_setting(pen, rect, "", "STD", "BARO", colour::SELECTED),
        BaroBox::Source(Ok(pressure)) => {
            draw_setting(pen, rect, "SRC", &number(pressure), "", colour::LABEL);
        }
        BaroBox::Source(Err(reason)) => flags::cover_line(pen, rect, "SET", reason),
        BaroBox::Geometric => draw_setting(pen, rect, "", "NO BARO", "", colour::LABEL),
    }
}

/// A setting with what stands before and after it, centred as one line.
fn draw_setting(
    pen: &mut Pen<'_>,
    rect: Rect,
    before: &str,
    value: &str,
    after: &str,
    ink: Colour,
) {
    pen.field(rect);
    let (name, number) = (regular(9.5, colour::LABEL), bold(11.5, ink));
    let gap = |text: &str, pen: &Pen<'_>| {
        if text.is_empty() {
            0.0
        } else {
            pen.width(text, name) + pen.px(5.0)
        }
    };
    let (lead, tail) = (gap(before, pen), gap(after, pen));
    let width = pen.width(value, number);
    let y = rect.centre().y;
    let x = rect.centre().x - (lead + width + tail) * 0.5;
    pen.text(before, Vec2::new(x, y), Align::Left, name);
    pen.text(value, Vec2::new(x + lead, y), Align::Left, number);
    pen.text(
        after,
        Vec2::new(x + lead + width + tail, y),
        Align::Right,
        name,
    );
}
