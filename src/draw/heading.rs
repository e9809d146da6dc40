//! The heading tape with its window.

use super::flags;
use super::list::Rect;
use super::pen::{Align, Pass, Pen, bold, px};
use crate::angle::shortest_turn;
use crate::display::colour;
use crate::display::{Heading, Model, North, format};
use crate::units::{Degrees, Radians};
use glam::Vec2;

/// Degrees over the width of the tape (AC 23.1311-1C, 8.6: at least 120 where there is no compass rose).
const SPAN_DEGREES: f64 = 120.0;

/// Draws the tape and the window, or the flag.
pub(super) fn draw(pen: &mut Pen<'_>, model: &Model) {
    let (tape, window) = (pen.layout.heading, pen.layout.heading_window);
    let heading = match model.heading {
        Ok(heading) => heading,
        Err(reason) => {
            flags::cover_line(pen, tape, "HEADING", reason);
            return;
        }
    };
    pen.panel(tape);
    pen.list.clip(Some(tape));
    let x = |degrees: f64| tape.centre().x + px(degrees / SPAN_DEGREES) * tape.width();
    let first = format::whole_below((heading.direction.0 - SPAN_DEGREES * 0.5) / 5.0);
    for k in first..=first + 25 {
        let at = x(format::real(k) * 5.0 - heading.direction.0);
        draw_mark(pen, tape, at, k * 5);
    }
    if let (Ok(track), North::True) = (model.track, heading.north) {
        let turn = shortest_turn(radians(heading.direction), radians(track)).to_degrees();
        draw_track(pen, tape, x(turn));
    }
    pen.list.clip(None);
    draw_window(pen, window, tape, heading);
}

fn radians(direction: Degrees) -> Radians {
    direction.into()
}

/// A mark each 5 degrees, longer each 10, with a letter or tens of degrees each 30.
fn draw_mark(pen: &mut Pen<'_>, tape: Rect, x: f32, degrees: i64) {
    let top = tape.min.y + pen.px(1.0);
    let (long, weight) = if degrees % 10 == 0 {
        (12.0, 1.8)
    } else {
        (7.0, 1.3)
    };
    let width = pen.layout.line(weight);
    let from = Vec2::new(x, top);
    pen.list
        .line(from, from + Vec2::Y * pen.px(long), width, colour::SCALE);
    if degrees % 30 == 0 {
        let label = format::compass_label(degrees);
        let at = Vec2::new(x, tape.min.y + pen.px(26.0));
        let style = bold(14.0, colour::SCALE);
        let room = (x - tape.min.x).min(tape.max.x - x) - pen.width(&label, style) * 0.5;
        pen.moving_text(&label, at, Align::Centre, pen.entering(style, room));
    }
}

/// A diamond where the aircraft goes over the ground.
fn draw_track(pen: &mut Pen<'_>, tape: Rect, x: f32) {
    let centre = Vec2::new(x, tape.min.y + pen.px(8.0));
    let (w, h) = (Vec2::X * pen.px(5.5), Vec2::Y * pen.px(7.0));
    for pass in Pass::BOTH {
        let grow = if pass == Pass::Rim { 1.35 } else { 1.0 };
        let corners = [
            centre - h * grow,
            centre + w * grow,
            centre + h * grow,
            centre - w * grow,
        ];
        pen.list
            .polygon(corners, [true; 4], [pass.colour(colour::TRACK); 4]);
    }
}

/// The heading in figures with its north, and a tip at the tape.
fn draw_window(pen: &mut Pen<'_>, window: Rect, tape: Rect, heading: Heading) {
    pen.window(window);
    let x = window.centre().x;
    let border = pen.layout.line(1.5).round();
    let (y, half) = (window.max.y, pen.px(8.0));
    for (inset, ink) in [(0.0, colour::SCALE), (border, colour::WINDOW)] {
        let base = y - border - 1.0;
        let tip = tape.min.y + pen.px(9.0) - inset * 1.7;
        let side = half + pen.px(1.5) - inset;
        let corners = [
            Vec2::new(x - side, base),
            Vec2::new(x + side, base),
            Vec2::new(x, tip),
        ];
        pen.list.triangle(corners, ink);
    }
    let north = match heading.north {
        North::True => "T",
        North::Magnetic => "M",
    };
    let ink = if heading.reverted {
        colour::CAUTION
    } else {
        colour::LABEL
    };
    let (figures, letter) = (bold(17.0, colour::SCALE), bold(11.0, ink));
    let digits = format::direction_digits(heading.direction);
    let (number, degree) = (pen.width(&digits, figures), pen.width("\u{b0}", figures));
    let gap = pen.px(1.0);
    let total = number + degree + gap + pen.width(north, letter);
    let at = Vec2::new(x - total * 0.5, window.centre().y);
    pen.text(&digits, at, Align::Left, figures);
    pen.text("\u{b0}", at + Vec2::X * number, Align::Left, figures);
    pen.text(
        north,
        at + Vec2::new(number + degree + gap, pen.px(2.0)),
        Align::Left,
        letter,
    );
}
