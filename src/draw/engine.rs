//! The engine strip along the upper edge: figures with their limits as a coloured bar below.

use super::flags;
use super::list::Rect;
use super::pen::{Align, Pen, bold, px, regular};
use crate::display::Model;
use crate::display::colour::{self, Colour};
use crate::display::engine::{Bar, GAUGES, Gauge, Level, Reading};
use glam::Vec2;

/// Draws it; nothing where no engine was ever heard.
pub(super) fn draw(pen: &mut Pen<'_>, model: &Model) {
    let place = pen.layout.engine;
    #[expect(clippy::cast_precision_loss, reason = "a handful")]
    let width = place.width() / GAUGES as f32;
    let gap = pen.px(3.0);
    for (gauge, k) in model.engine.iter().zip(0_u8..) {
        let x = place.min.x + width * f32::from(k);
        let rect = Rect::new(x, place.min.y, width - gap, place.height()).snapped();
        match gauge.reading {
            Ok(reading) => draw_gauge(pen, rect, gauge, reading),
            Err(reason) => flags::cover_line(pen, rect, gauge.name, reason),
        }
    }
}

const fn ink(level: Level) -> Colour {
    match level {
        Level::Normal => colour::SCALE,
        Level::Caution => colour::CAUTION,
        Level::Warning => colour::WARNING,
    }
}

fn draw_gauge(pen: &mut Pen<'_>, rect: Rect, gauge: &Gauge, reading: Reading) {
    pen.field(rect);
    let ink = ink(reading.level);
    // Colour is not the only cue (AC 25-11B, 5.8): beyond its limits a gauge is framed, and twice where that is red.
    let width = pen.layout.line(2.0).round();
    if reading.level >= Level::Caution {
        pen.list.frame(rect, width, ink);
    }
    if reading.level == Level::Warning {
        let inner = rect.grown(-(width * 2.0));
        pen.list.frame(inner, width, ink);
    }
    let label = regular(9.0, colour::LABEL);
    let (left, right) = (rect.min.x + pen.px(9.0), rect.max.x - pen.px(9.0));
    let upper = rect.min.y + pen.px(14.0);
    pen.text(gauge.name, Vec2::new(left, upper), Align::Left, label);
    pen.text(gauge.unit, Vec2::new(right, upper), Align::Right, label);
    let lower = rect.min.y + pen.px(31.0);
    let at = Vec2::new(right, lower);
    pen.text(&reading.text, at, Align::Right, bold(13.5, ink));
    if let Some(bar) = reading.bar {
        let y = rect.max.y - pen.px(9.0);
        draw_bar(pen, Rect::new(left, y, right - left, pen.px(3.0)), bar);
    }
}

/// Red, amber, green, amber, red from the left, and a pointer over them.
fn draw_bar(pen: &mut Pen<'_>, rect: Rect, bar: Bar) {
    let x = |t: f64| rect.min.x + rect.width() * px(t);
    let [low_red, low_amber] = bar.low;
    let [high_red, high_amber] = bar.high;
    let mut band = |from: f64, to: f64, ink: Colour| {
        if from < to {
            let width = x(to) - x(from);
            let band = Rect::new(x(from), rect.min.y, width, rect.height());
            pen.list.rect(band, ink);
        }
    };
    let (low, high) = (low_red.unwrap_or(0.0), high_red.unwrap_or(1.0));
    let (begin, end) = (low_amber.unwrap_or(low), high_amber.unwrap_or(high));
    band(0.0, low, colour::WARNING);
    band(low, begin, colour::CAUTION);
    band(begin, end, colour::NORMAL);
    band(end, high, colour::CAUTION);
    band(high, 1.0, colour::WARNING);
    let tip = Vec2::new(x(bar.value), rect.max.y);
    let side = Vec2::new(pen.px(4.0), -pen.px(8.0));
    let corners = [tip, tip + side, tip + Vec2::new(-side.x, side.y)];
    pen.list.triangle(corners, colour::SCALE);
}
