//! Lines about values that are shown but not to be trusted blindly, and about sources out of order, one each, beside the
//! attitude: amber, but grey where nothing was lost.

use super::list::Rect;
use super::pen::{Align, Pen, bold};
use crate::display::{Model, NOTES_MAX, colour};
use glam::Vec2;

/// Draws them from the top down; nothing where there are none.
pub(super) fn draw(pen: &mut Pen<'_>, model: &Model) {
    let place = pen.layout.notes;
    #[expect(clippy::cast_precision_loss, reason = "a dozen")]
    let height = place.height() / NOTES_MAX as f32;
    let mut y = place.min.y;
    for note in &model.notes {
        let line = Rect::new(place.min.x, y, place.width(), height).snapped();
        pen.field(line);
        let (left, right) = (line.min.x + pen.px(5.0), line.max.x - pen.px(5.0));
        let middle = line.centre().y;
        let ink = if note.kind.is_caution() {
            colour::CAUTION
        } else {
            colour::LABEL
        };
        let style = bold(9.5, ink);
        pen.text(&note.about, Vec2::new(left, middle), Align::Left, style);
        let text = note.kind.text(model.baro_unit);
        pen.text(&text, Vec2::new(right, middle), Align::Right, style);
        y += height;
    }
}
