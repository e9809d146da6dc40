//! What a [`super::scene::Scene`] hands to whoever draws a frame: its plan, and figures of it.

use super::blocks::Block;
use super::clipmap::{Extent, Morph, Window};
use super::partition::Partition;
use super::slices::Slices;
use super::stream::Errands;
use super::surface::DamageCounts;
use super::tables::Entry;
use crate::limits::LEVELS_MAX;
use crate::units::Radians;
use arrayvec::ArrayVec;

/// A level as it is drawn.
#[derive(Clone, Debug)]
pub struct LevelPlan {
    /// Which level.
    pub level: u8,
    /// What is drawn of it begins at this post, the origin of its blocks; its resident window may begin before that.
    pub window: Window,
    /// Cells a side of what is drawn of it.
    pub cells: i32,
    /// How it blends into the next.
    pub morph: Morph,
    /// Whether the next coarser level is drawn too.
    pub has_coarser: bool,
    /// Its blocks: the first in [`Plan::blocks`], and how many.
    pub blocks: (usize, usize),
    /// The same blocks by slices of the depth buffer, nearest first.
    pub slices: Slices,
}

impl LevelPlan {
    /// One with nothing in it.
    #[cfg(test)]
    pub(super) const EMPTY: Self = Self {
        level: 0,
        window: Window { i: 0, j: 0 },
        cells: 0,
        morph: Morph {
            x: 0.0,
            y: 0.0,
            start: 0.0,
            end: 1.0,
        },
        has_coarser: false,
        blocks: (0, 0),
        slices: Slices::new_const(),
    };

    /// What is drawn of it.
    #[must_use]
    pub const fn extent(&self) -> Extent {
        Extent {
            window: self.window,
            cells: self.cells,
        }
    }
}

/// All that drawing a frame needs. Positions are metres, Earth-centred axes, counted from the eye.
#[derive(Debug)]
pub struct Plan {
    /// The levels, finest first.
    pub levels: ArrayVec<LevelPlan, LEVELS_MAX>,
    /// Their blocks.
    pub blocks: Vec<Block>,
    /// Two rows of as many entries as a torus has texels for each level of the pack: columns, then rows. A post's entry is
    /// where its texel is.
    pub tables: Vec<Entry>,
    /// Changes when `tables` does.
    pub tables_version: u32,
    /// Anchor less eye.
    pub origin_m: [f32; 3],
    /// Numbers of the anchor for a cap, see [`super::tables::Anchor::bulge`].
    pub bulge: [f32; 4],
    /// The anchor's height code.
    pub anchor_code: u16,
    /// Rows of the projection: clip x, clip y and clip w of a position.
    pub projection: [[f32; 3]; 3],
    /// The picture's width and height, pixels.
    pub size_px: (u32, u32),
    /// Heading of the view against grid north.
    pub heading: Radians,
    /// Triangles with an area.
    pub triangles: usize,
    /// Whether the eye is known to be above what is drawn under it, by enough for nothing of that to be nearer than the
    /// picture's beginning. Then no triangle shows its lower side, since ground is a height over the ellipsoid, and what is
    /// seen from below lies behind what is seen from above.
    pub is_above_ground: bool,
}

/// What a frame did.
#[derive(Clone, Copy, Debug, Default)]
pub struct FrameFigures {
    /// Triangles drawn (with an area; surplus ones of the pattern are not counted).
    pub triangles: usize,
    /// Draw calls.
    pub draw_calls: usize,
    /// Which partition is drawn; `None` where the pack has none for the eye.
    pub partition: Option<Partition>,
    /// Finest and coarsest level drawn.
    pub levels: Option<(u8, u8)>,
    /// Finest and coarsest level wanted for drawing.
    pub levels_wanted: (u8, u8),
    /// Terrain texels uploaded.
    pub uploads_texels: usize,
    /// Bytes uploaded: terrain, tables and blocks.
    pub uploads_bytes: usize,
    /// Samples decoded in the frame before.
    pub decoded_samples: u32,
    /// Bytes of textures, their copies, batches and decoded tiles that are resident. Fixed at start.
    pub resident_bytes: usize,
    /// Whether every wanted level is whole and in its place, or there is nothing to wait for.
    pub settled: bool,
    /// Tiles that could not be read since the start.
    pub damage: DamageCounts,
    /// What the streaming thread is doing for what is drawn.
    pub errands: Errands,
}

impl FrameFigures {
    /// Whether every wanted level can be drawn.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.levels == Some(self.levels_wanted)
    }
}
