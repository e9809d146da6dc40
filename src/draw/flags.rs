//! What stands where there is no value. Four classes, told apart by shape and word as well as by colour (AC 25-11B, 5.8),
//! and from anything healthy: they are opaque, framed, and hold no figure.
//!
//! - nothing ever received: dashed grey frame, "- - -"
//! - too old: amber frame, one diagonal, "OLD"
//! - failed (by its source's word, out of range, frozen, or refuted by other sensors): red frame, two diagonals, "FAIL"
//! - sources disagree: two amber frames, no diagonal, "CMP"

use super::list::Rect;
use super::pen::{Align, Pen, bold, regular};
use crate::display::colour::{self, Colour};
use crate::sampled::Invalid;
use glam::Vec2;

struct Look {
    word: &'static str,
    colour: Colour,
}

const fn look(reason: Invalid) -> Look {
    let (word, colour) = match reason {
        Invalid::NeverReceived => ("- - -", colour::ABSENT),
        Invalid::Stale => ("OLD", colour::CAUTION),
        Invalid::OutOfRange | Invalid::SourceFailed | Invalid::Frozen | Invalid::Implausible => {
            ("FAIL", colour::WARNING)
        }
        Invalid::Doubtful => ("CHK", colour::CAUTION),
        Invalid::Miscompare => ("CMP", colour::CAUTION),
    };
    Look { word, colour }
}

/// What the reason is called where there is room for it.
const fn sentence(reason: Invalid) -> &'static str {
    match reason {
        Invalid::NeverReceived => "NEVER RECEIVED",
        Invalid::Stale => "DATA TOO OLD",
        Invalid::OutOfRange => "VALUE OUT OF RANGE",
        Invalid::SourceFailed => "SOURCE REPORTS FAILURE",
        Invalid::Doubtful => "SOURCE DOUBTS ITSELF",
        Invalid::Frozen => "SENSOR STANDS STILL",
        Invalid::Implausible => "CONTRADICTS THE TURN",
        Invalid::Miscompare => "SOURCES DISAGREE",
    }
}

/// Covers `rect` with the flag of the instrument `name`.
pub(super) fn cover(pen: &mut Pen<'_>, rect: Rect, name: &str, reason: Invalid) {
    let Look { word, colour } = look(reason);
    marks(pen, rect, reason, 2.0);
    let name_style = regular(11.0, colour::LABEL);
    let word_style = bold(13.0, colour);
    let step = pen.cap_px(word_style) * 0.5 + pen.px(7.0);
    let middle = rect.centre();
    let width = pen.width(name, name_style).max(pen.width(word, word_style)) + pen.px(5.0);
    let plate = Rect::around(middle, width, pen.px(50.0)).snapped();
    pen.list.rect(plate, colour::WINDOW);
    pen.text(name, middle - Vec2::Y * step, Align::Centre, name_style);
    pen.text(word, middle + Vec2::Y * step, Align::Centre, word_style);
}

/// Covers a field of one line: `name` at its left end, the word at its right.
pub(super) fn cover_line(pen: &mut Pen<'_>, rect: Rect, name: &str, reason: Invalid) {
    let Look { word, colour } = look(reason);
    marks(pen, rect, reason, 1.0);
    let name_style = regular(10.5, colour::LABEL);
    let word_style = bold(11.5, colour);
    let width = pen.width(word, word_style) + pen.px(8.0);
    let name_width = if name.is_empty() {
        0.0
    } else {
        pen.width(name, name_style) + pen.px(8.0)
    };
    let y = rect.centre().y;
    let inset = pen.px(5.0);
    // The words stand on plates of their own, the diagonals show between them.
    let name_plate = Rect::new(
        rect.min.x + inset - pen.px(2.0),
        y - pen.px(8.0),
        name_width,
        pen.px(16.0),
    );
    if !name.is_empty() {
        pen.list.rect(name_plate.snapped(), colour::WINDOW);
    }
    let word_plate = Rect::new(
        rect.max.x - inset - width + pen.px(2.0),
        y - pen.px(8.0),
        width,
        pen.px(16.0),
    );
    pen.list.rect(word_plate.snapped(), colour::WINDOW);
    pen.text(
        name,
        Vec2::new(rect.min.x + inset + pen.px(2.0), y),
        Align::Left,
        name_style,
    );
    pen.text(
        word,
        Vec2::new(rect.max.x - inset - pen.px(2.0), y),
        Align::Right,
        word_style,
    );
}

/// The flag of a missing attitude: large, with its reason in words.
pub(super) fn cover_attitude(pen: &mut Pen<'_>, rect: Rect, reason: Invalid) {
    let Look { word, colour } = look(reason);
    marks(pen, rect, reason, 5.0);
    let plate = Rect::around(rect.centre(), pen.px(250.0), pen.px(112.0)).snapped();
    pen.list.rect(plate, colour::WINDOW);
    let middle = rect.centre();
    let below = |d: f32| middle + Vec2::Y * d;
    let (up, down) = (pen.px(-34.0), pen.px(34.0));
    pen.text(
        "ATTITUDE",
        below(up),
        Align::Centre,
        bold(18.0, colour::LABEL),
    );
    pen.text(word, below(0.0), Align::Centre, bold(20.0, colour));
    pen.text(
        sentence(reason),
        below(down),
        Align::Centre,
        regular(11.0, colour::LABEL),
    );
}

/// The ground, frame and diagonals of a class; `weight` is the width of lines in design units.
fn marks(pen: &mut Pen<'_>, rect: Rect, reason: Invalid, weight: f32) {
    let colour = look(reason).colour;
    let width = pen.layout.line(weight).round();
    pen.list.rect(rect, colour::WINDOW);
    let Rect { min, max } = rect.grown(-width * 0.5);
    let (upper_right, lower_left) = (Vec2::new(max.x, min.y), Vec2::new(min.x, max.y));
    pen.list.clip(Some(rect));
    match reason {
        Invalid::NeverReceived => dashed_frame(pen, rect, width, colour),
        Invalid::Stale => {
            pen.list.line(lower_left, upper_right, width * 1.4, colour);
            pen.list.frame(rect, width, colour);
        }
        Invalid::OutOfRange | Invalid::SourceFailed | Invalid::Frozen | Invalid::Implausible => {
            pen.list.line(lower_left, upper_right, width * 1.4, colour);
            pen.list.line(min, max, width * 1.4, colour);
            pen.list.frame(rect, width, colour);
        }
        Invalid::Doubtful | Invalid::Miscompare => {
            pen.list.frame(rect, width, colour);
            pen.list
                .frame(rect.grown(-(width * 2.5).round()), width, colour);
        }
    }
    pen.list.clip(None);
}

/// Dashes of equal length along each side, starting and ending with a whole one.
fn dashed_frame(pen: &mut Pen<'_>, rect: Rect, width: f32, colour: Colour) {
    let Rect { min, max } = rect.grown(-width * 0.5);
    let corners = [min, Vec2::new(max.x, min.y), max, Vec2::new(min.x, max.y)];
    for (i, &from) in corners.iter().enumerate() {
        let to = corners[(i + 1) % 4];
        let wanted = (from.distance(to) / pen.px(12.0)).round().clamp(1.0, 40.0);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "1 to 40"
        )]
        let dashes = wanted as u8;
        let parts = 2.0 * wanted - 1.0;
        for k in 0..dashes {
            let start = 2.0 * f32::from(k) / parts;
            let end = (2.0 * f32::from(k) + 1.0) / parts;
            pen.list
                .line(from.lerp(to, start), from.lerp(to, end), width, colour);
        }
    }
}
