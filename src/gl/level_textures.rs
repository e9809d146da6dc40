//! The textures of the terrain's levels: two sets of each, so that nothing is ever written that the GPU may still read.
//!
//! A level that was drawn in the last frame is written into its other set, which then becomes the one that is drawn. What
//! the other set had missed is written into it first, from the streamer's copy, out of the same quota of texels; what
//! is left of the quota in a frame goes into sets that lag behind, so that they are seldom found lagging.

use std::cell::Cell;
use std::rc::Rc;

use arrayvec::ArrayVec;

use super::texture::{Filter, Format, Region, Texture, Wrap};
use super::{GlError, Gpu};
use crate::terrain::clipmap::TorusPart;
use crate::terrain::stream::{Sink, Torus};

/// Rectangles that a set may lag behind by before all of it is written anew. A level is filled in 49 squares at most, some
/// of them cut in two by the torus or by a quota.
const MISSED_MAX: usize = 96;

/// The textures of all levels of a clipmap.
#[derive(Debug)]
pub struct LevelTextures {
    levels: Vec<Level>,
    texels: usize,
}

#[derive(Debug)]
struct Level {
    sets: [Set; 2],
    /// The set that is drawn.
    front: usize,
    /// Whether anything was bound for drawing since the frame began.
    drawn: Cell<bool>,
    /// Whether the front set was drawn in the frame before this one.
    was_drawn: bool,
    /// Whether the sets changed places in this frame.
    turned: bool,
    /// What the other set has not been given yet.
    missed: ArrayVec<TorusPart, MISSED_MAX>,
}

#[derive(Debug)]
struct Set {
    heights: Texture,
    surface: Texture,
}

impl LevelTextures {
    /// For `levels` levels, each a torus of `texels` x `texels`. Undefined until written.
    ///
    /// # Errors
    /// [`GlError`] where the GPU refuses a texture.
    pub fn new(gpu: &Rc<Gpu>, levels: u8, texels: usize) -> Result<Self, GlError> {
        let side = size(texels);
        let make = |format, filter| Texture::new(gpu, format, side, side, filter, Wrap::Repeat);
        let set = || {
            Ok::<_, GlError>(Set {
                heights: make(Format::Rg16Ui, Filter::Nearest)?,
                surface: make(Format::Rgba8, Filter::Linear)?,
            })
        };
        let level = |_| {
            Ok(Level {
                sets: [set()?, set()?],
                front: 0,
                drawn: Cell::new(false),
                was_drawn: false,
                turned: false,
                missed: ArrayVec::new(),
            })
        };
        Ok(Self {
            levels: (0..levels).map(level).collect::<Result<_, GlError>>()?,
            texels,
        })
    }

    /// Begins a frame: what was bound since the last call has been drawn. To be called before anything is written.
    pub fn begin_frame(&mut self) {
        for level in &mut self.levels {
            level.was_drawn = level.drawn.take();
            level.turned = false;
        }
    }

    /// Binds a level's heights to a texture unit, for drawing in this frame.
    pub fn bind_heights(&self, level: usize, unit: u32) {
        self.front(level).heights.bind(unit);
    }

    /// Binds a level's surface to a texture unit, for drawing in this frame.
    pub fn bind_surface(&self, level: usize, unit: u32) {
        self.front(level).surface.bind(unit);
    }

    /// Bytes of all textures.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let sets = self.levels.iter().flat_map(|level| &level.sets);
        sets.map(|set| set.heights.bytes() + set.surface.bytes())
            .sum()
    }

    fn front(&self, level: usize) -> &Set {
        let level = &self.levels[level];
        level.drawn.set(true);
        &level.sets[level.front]
    }
}

impl Sink for LevelTextures {
    fn catch_up(&mut self, level: u8, torus: &Torus<'_>, quota: usize) -> usize {
        let all = self.texels;
        let level = &mut self.levels[usize::from(level)];
        // After a turn the other set is the one of the last frame.
        if level.turned {
            return 0;
        }
        let mut left = quota;
        while let Some(part) = level.missed.last_mut() {
            let rows = part.height.min(left / part.width);
            let piece = region(&TorusPart {
                height: rows,
                ..*part
            });
            if rows > 0 {
                let set = &level.sets[1 - level.front];
                set.heights
                    .write_from(piece, bytemuck::cast_slice(torus.heights), size(all));
                set.surface
                    .write_from(piece, bytemuck::cast_slice(torus.surface), size(all));
                left -= rows * part.width;
            }
            if rows < part.height {
                part.y += rows;
                part.height -= rows;
                // Less than a row is left: all of it counts as used, for the level is not ready.
                return quota;
            }
            level.missed.pop();
        }
        quota - left
    }

    fn forget(&mut self, level: u8) {
        self.levels[usize::from(level)].missed.clear();
    }

    fn write(&mut self, level: u8, part: TorusPart, heights: &[[u16; 2]], surface: &[[u8; 4]]) {
        let all = self.texels;
        let level = &mut self.levels[usize::from(level)];
        if level.was_drawn && !level.turned {
            debug_assert!(level.missed.is_empty(), "turned before it had caught up");
            level.front = 1 - level.front;
            level.turned = true;
        }
        let set = &level.sets[level.front];
        set.heights
            .write(region(&part), bytemuck::cast_slice(heights));
        set.surface
            .write(region(&part), bytemuck::cast_slice(surface));
        if level.missed.try_push(part).is_err() {
            level.missed.clear();
            level.missed.push(TorusPart {
                x: 0,
                y: 0,
                width: all,
                height: all,
                from_x: 0,
                from_y: 0,
            });
        }
    }
}

fn region(part: &TorusPart) -> Region {
    Region {
        x: size(part.x),
        y: size(part.y),
        width: size(part.width),
        height: size(part.height),
    }
}

/// A size of ours as GL takes it: at most a few hundred.
fn size(v: usize) -> u32 {
    u32::try_from(v).unwrap_or(0)
}
