//! Small fields of figures: ground speed, track, what the air does, and the height above the ground.

use super::flags;
use super::list::Rect;
use super::pen::{Align, Pen, bold, px, regular};
use crate::display::Model;
use crate::display::air::{Absent, Wind};
use crate::display::colour::{self, Colour};
use crate::display::format::{self, Text};
use crate::sampled::Invalid;
use crate::units::Radians;
use glam::Vec2;

/// Ground speed and track, under the airspeed tape.
pub(super) fn draw_ground(pen: &mut Pen<'_>, model: &Model) {
    let (upper, lower) = (pen.layout.ground_speed, pen.layout.track);
    match model.ground_speed {
        Ok(speed) => draw_field(
            pen,
            upper,
            "GS",
            &format::whole_knots(speed),
            "KT",
            colour::SCALE,
        ),
        Err(reason) => flags::cover_line(pen, upper, "GS", reason),
    }
    match model.track {
        Ok(track) => draw_field(
            pen,
            lower,
            "TRK",
            &format::direction_digits(track),
            "\u{b0}T",
            colour::TRACK,
        ),
        Err(reason) => flags::cover_line(pen, lower, "TRK", reason),
    }
}

/// True airspeed, wind, temperature, density altitude, and the height above the ground.
pub(super) fn draw_air(pen: &mut Pen<'_>, model: &Model) {
    let layout = pen.layout;
    let air = &model.air;
    let speed = air.true_airspeed.map(format::whole_knots);
    draw_either(pen, layout.true_airspeed, "TAS", speed, "KT");
    let temperature = air.temperature_c.map(format::celsius);
    draw_either(pen, layout.temperature, "OAT", temperature, "\u{b0}C");
    let density = air.density_altitude.map(format::tens_of_feet);
    draw_either(pen, layout.density_altitude, "DA", density, "FT");
    let above = model.height_above_ground.map(format::tens_of_feet);
    draw_either(pen, layout.height_above_ground, "AGL", above, "FT");
    match air.wind {
        Ok(wind) => draw_wind(pen, layout.wind, wind),
        Err(absent) => draw_absent(pen, layout.wind, "WIND", absent),
    }
}

fn draw_either(pen: &mut Pen<'_>, rect: Rect, name: &str, value: Result<Text, Absent>, unit: &str) {
    match value {
        Ok(value) => draw_field(pen, rect, name, &value, unit, colour::SCALE),
        Err(absent) => draw_absent(pen, rect, name, absent),
    }
}

/// A field without a value: what it would need, by name; grey where that was never there, so that nothing was lost.
fn draw_absent(pen: &mut Pen<'_>, rect: Rect, name: &str, absent: Absent) {
    if absent.input == name {
        return flags::cover_line(pen, rect, name, absent.reason);
    }
    pen.field(rect);
    let ink = if absent.reason == Invalid::NeverReceived {
        colour::ABSENT
    } else {
        colour::CAUTION
    };
    let y = rect.centre().y;
    let (label, word) = (regular(10.5, colour::LABEL), bold(10.0, ink));
    let left = Vec2::new(rect.min.x + pen.px(7.0), y);
    pen.text(name, left, Align::Left, label);
    let right = rect.max.x - pen.px(7.0);
    pen.text(absent.input, Vec2::new(right, y), Align::Right, word);
    let before = right - pen.width(absent.input, word) - pen.px(4.0);
    pen.text("NO", Vec2::new(before, y), Align::Right, word);
}

/// An arrow that blows over the aircraft, whose nose is up, with speed and direction in figures.
fn draw_wind(pen: &mut Pen<'_>, rect: Rect, wind: Wind) {
    pen.field(rect);
    let middle = Vec2::new(rect.min.x + pen.px(27.0), rect.centre().y);
    match wind.blows_to {
        Some(to) => {
            let (sin, cos) = Radians::from(to).0.sin_cos();
            arrow(
                pen,
                middle,
                Vec2::new(px(sin), px(-cos)),
                17.0,
                colour::SCALE,
            );
        }
        None => pen.text("WIND", middle, Align::Centre, regular(10.0, colour::LABEL)),
    }
    let step = Vec2::Y * pen.px(11.0);
    let column = Vec2::new(rect.max.x - pen.px(25.0), rect.centre().y);
    let gap = Vec2::X * pen.px(4.0);
    for (at, value, unit) in [
        (column - step, format::whole_knots(wind.speed), "KT"),
        (
            column + step,
            format::direction_digits(wind.from),
            "\u{b0}T",
        ),
    ] {
        pen.text(&value, at, Align::Right, bold(12.5, colour::SCALE));
        pen.text(unit, at + gap, Align::Left, regular(10.0, colour::LABEL));
    }
}

/// An arrow through `middle` in the direction `along`, `half` design units to each side.
pub(super) fn arrow(pen: &mut Pen<'_>, middle: Vec2, along: Vec2, half: f32, ink: Colour) {
    let (reach, side) = (
        along * pen.px(half),
        along.perp() * pen.px(half * 0.3 + 1.2),
    );
    let neck = middle + reach * 0.1;
    let width = pen.layout.line(half * 0.08 + 1.1);
    pen.list.line(middle - reach, neck, width, ink);
    pen.list
        .triangle([middle + reach, neck + side, neck - side], ink);
}

fn draw_field(pen: &mut Pen<'_>, rect: Rect, name: &str, value: &str, unit: &str, ink: Colour) {
    pen.field(rect);
    let y = rect.centre().y;
    let (label, number) = (regular(10.5, colour::LABEL), bold(12.5, ink));
    pen.text(
        name,
        Vec2::new(rect.min.x + pen.px(7.0), y),
        Align::Left,
        label,
    );
    // Units stand in a column, so that the figures of all fields end at one place.
    let column = rect.max.x - pen.px(27.0);
    pen.text(value, Vec2::new(column, y), Align::Right, number);
    pen.text(unit, Vec2::new(column + pen.px(5.0), y), Align::Left, label);
}
