//! Lines about values that are shown but not to be trusted blindly, one each, beside the attitude: amber, but grey where
//! nothing was lost.

use super::list::Rect;
use super::pen::{Align, Pen, bold};
use crate::display::{Model, NOTES_MAX, NoteKind, colour, format};
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
        let (left, right) = (line.min.x + pen.px(7.0), line.max.x - pen.px(7.0));
        let middle = line.centre().y;
        let ink = match note.kind {
            NoteKind::Miscompare | NoteKind::Fallback(_) => colour::CAUTION,
            NoteKind::Derived => colour::LABEL,
        };
        let style = bold(11.0, ink);
        pen.text(note.about, Vec2::new(left, middle), Align::Left, style);
        let at = Vec2::new(right, middle);
        match note.kind {
            NoteKind::Miscompare => pen.text("MISCOMP", at, Align::Right, style),
            NoteKind::Derived => pen.text("DERIVED", at, Align::Right, style),
            NoteKind::Fallback(source) => {
                let label = format::source_label(source);
                pen.text(&label, at, Align::Right, style);
            }
        }
        y += height;
    }
}
