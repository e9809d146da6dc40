//! How the model looks: from a [`Model`] and a [`Layout`] to a [`DrawList`] of anti-aliased quads and glyphs.
//!
//! Pure: no GL, no clock; after start-up no memory is taken. All positions are in pixels from the upper left corner of the
//! picture, x to the right, y down; the centre of pixel (i, j) is (i + 0.5, j + 0.5). The optical axis meets the picture
//! at its centre, and horizon, ladder and terrain share one focal length, so that the ladder lies over the world that it
//! measures.
//!
//! Proportions follow what pilots know from panels in light aircraft: airspeed left, altitude and vertical speed right,
//! heading below, roll scale above. What has no value is covered whole by a flag; no number is left standing.

pub mod atlas;
mod engine;
mod fields;
mod flags;
mod heading;
mod horizon;
mod layout;
pub mod list;
mod notes;
mod pen;
mod roll;
mod sdf;
mod tape;
mod traffic;
mod vsi;

pub use layout::Layout;
pub use list::DrawList;

use crate::display::Model;
use atlas::Atlas;
use pen::Pen;

/// Clears `list` and draws `model` into it. When `model.svs` is an error the list covers the whole picture; else it is to
/// be drawn over the terrain.
pub fn draw(model: &Model, layout: &Layout, atlas: &Atlas, list: &mut DrawList) {
    list.clear();
    let mut pen = Pen::new(list, atlas, layout);
    horizon::draw(&mut pen, model);
    traffic::draw_sights(&mut pen, model);
    roll::draw(&mut pen, model);
    horizon::draw_annunciation(&mut pen, model);
    tape::draw_airspeed(&mut pen, model);
    tape::draw_altitude(&mut pen, model);
    vsi::draw(&mut pen, model);
    heading::draw(&mut pen, model);
    engine::draw(&mut pen, model);
    fields::draw_ground(&mut pen, model);
    fields::draw_air(&mut pen, model);
    traffic::draw_list(&mut pen, model);
    notes::draw(&mut pen, model);
}

#[cfg(test)]
mod tests;
