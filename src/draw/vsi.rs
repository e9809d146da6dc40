//! The vertical speed scale, right of the altitude tape (AC 23.1311-1C, 8.11).

use super::flags;
use super::list::Rect;
use super::pen::{Align, Pen, bold, px, regular};
use crate::display::colour;
use crate::display::{Model, format};
use glam::Vec2;

/// The scale ends here, ft/min; beyond, the pointer stays at the end and its figures go on.
const END_FPM: f64 = 2000.0;

/// Draws the scale with its pointer, or the flag.
pub(super) fn draw(pen: &mut Pen<'_>, model: &Model) {
    let rect = pen.layout.vertical_speed;
    let speed = match model.vertical_speed {
        Ok(speed) => speed,
        Err(reason) => {
            flags::cover(pen, rect, "V/S", reason);
            return;
        }
    };
    pen.panel(rect);
    let middle = rect.centre().y;
    let half = rect.height() * 0.5 - pen.px(30.0);
    let y = |fpm: f64| middle - half * px(fpm / END_FPM);
    for hundreds in [-20_i64, -15, -10, -5, 0, 5, 10, 15, 20] {
        let at = y(format::real(hundreds) * 100.0);
        let major = hundreds % 10 == 0;
        let (long, weight) = if major { (12.0, 2.2) } else { (7.0, 1.4) };
        let from = Vec2::new(rect.min.x + pen.px(1.0), at);
        let width = pen.layout.line(weight);
        pen.list
            .line(from, from + Vec2::X * pen.px(long), width, colour::SCALE);
        if major && hundreds != 0 {
            let label = format::mark(hundreds.abs() / 10);
            let x = rect.min.x + pen.px(24.0);
            pen.text(
                &label,
                Vec2::new(x, at),
                Align::Centre,
                bold(11.0, colour::SCALE),
            );
        }
    }
    let unit = Vec2::new(rect.max.x - pen.px(5.0), rect.min.y + pen.px(10.0));
    pen.text("FPM", unit, Align::Right, regular(8.0, colour::LABEL));
    draw_pointer(
        pen,
        rect,
        y(speed.0.clamp(-END_FPM, END_FPM)),
        format::vertical_speed(speed).as_deref(),
    );
}

/// A window with the figures and a tip that points at the scale; only the tip where there are no figures.
fn draw_pointer(pen: &mut Pen<'_>, rect: Rect, y: f32, figures: Option<&str>) {
    let border = pen.layout.line(1.5);
    let left = rect.min.x + pen.px(14.0);
    let window = Rect {
        min: Vec2::new(left, y - pen.px(10.0)),
        max: Vec2::new(rect.max.x + pen.px(20.0), y + pen.px(10.0)),
    };
    let tip = rect.min.x + pen.px(3.0);
    for (grow, ink) in [(border, colour::SCALE), (0.0, colour::WINDOW)] {
        if figures.is_some() {
            pen.list.rect(window.grown(grow), ink);
        }
        let base = left + if figures.is_some() { 1.0 } else { grow };
        let half = pen.px(7.0) + grow * 1.3;
        let corners = [
            Vec2::new(tip - grow * 1.8, y),
            Vec2::new(base, y - half),
            Vec2::new(base, y + half),
        ];
        pen.list.triangle(corners, ink);
    }
    if let Some(figures) = figures {
        let at = Vec2::new(window.max.x - pen.px(4.0), y);
        pen.moving_text(figures, at, Align::Right, bold(11.0, colour::SCALE));
    }
}
