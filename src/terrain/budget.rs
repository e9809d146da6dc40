//! What streaming takes of memory and what it may upload: bytes, worked out before anything is made.

use super::blocks::{BLOCKS_MAX, Block};
use super::clipmap::Shape;
use super::globe::Extent;
use super::pack::PackInfo;
use super::partition::Partition;
use super::scene::Settings;
use super::surface::{BATCH_TEXELS, TILES_KEPT, TILES_KEPT_MIN, cache_bytes};
use super::worker::BATCHES;
use crate::limits::LEVELS_MAX;

/// Heights and surface of a texel.
pub const TEXEL_BYTES: usize = 8;
/// An entry of the tables of columns and rows.
const ENTRY_BYTES: usize = size_of::<super::tables::Entry>();
/// Sets of textures of a level, and of tables and blocks of a scene, in rotation.
const SETS: usize = 2;
const ROTATING: usize = 3;
/// Extremes of 16 x 16 posts.
const EXTREMES_BYTES: usize = 4;

/// Bytes of the buffers of blocks of a scene.
pub const BLOCK_BUFFER_BYTES: usize = ROTATING * LEVELS_MAX * BLOCKS_MAX * size_of::<Block>();

/// What is to be drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Need {
    /// The shape of its levels.
    pub shape: Shape,
    /// How many the pack has.
    pub levels: u8,
    /// Scenes: two where the pack has caps.
    pub scenes: usize,
    /// Bytes of the picture of the whole Earth.
    pub globe_bytes: usize,
}

/// Memory is not enough; what is needed at least, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0} bytes are needed")]
pub struct TooLittle(pub usize);

impl Need {
    /// Of a pack drawn in levels of a shape.
    #[must_use]
    pub fn of(info: &PackInfo, shape: Shape) -> Self {
        let has_cap = info.has(Partition::North) || info.has(Partition::South);
        let globe = Extent::of(info);
        let side = |posts: i32| posts.unsigned_abs() as usize;
        Self {
            shape,
            levels: info.levels,
            scenes: 1 + usize::from(has_cap),
            // Colour and height, and a third more for the smaller levels of detail.
            globe_bytes: side(globe.width) * side(globe.height) * 5 / 3 * 4,
        }
    }

    /// Bytes of everything whose size the shape and the pack decide: textures, their copies, batches, tables, blocks.
    #[must_use]
    pub fn fixed_bytes(&self) -> usize {
        let (levels, side) = (usize::from(self.levels), self.shape.texels());
        let level = side * side * TEXEL_BYTES * (SETS + 1) + (side / 16).pow(2) * EXTREMES_BYTES;
        let tables = ROTATING * self.table_bytes();
        let batches = BATCHES * BATCH_TEXELS * TEXEL_BYTES;
        self.scenes * (levels * level + tables + batches + BLOCK_BUFFER_BYTES) + self.globe_bytes
    }

    /// Bytes of the tables of a scene, columns and rows.
    fn table_bytes(&self) -> usize {
        2 * usize::from(self.levels) * self.shape.texels() * ENTRY_BYTES
    }

    /// The most bytes of tables and blocks that a frame can upload beside texels: those of both scenes while one fades into the other.
    #[must_use]
    pub fn plan_bytes_max(&self) -> usize {
        let cells = self.shape.cells().unsigned_abs() as usize;
        // A row of blocks more at either side, where a finer level cuts into them.
        let side = cells.div_ceil(self.shape.block_cells().unsigned_abs() as usize) + 2;
        let blocks = usize::from(self.levels) * (side * side).min(BLOCKS_MAX) * size_of::<Block>();
        self.scenes * (self.table_bytes() + blocks)
    }

    /// How many decoded tiles can be kept within so many bytes of all.
    ///
    /// # Errors
    /// [`TooLittle`]
    pub fn tiles_within(&self, bytes: usize) -> Result<usize, TooLittle> {
        let fixed = self.fixed_bytes();
        let tile = cache_bytes(1) - cache_bytes(0);
        let least = fixed + cache_bytes(TILES_KEPT_MIN);
        if bytes < least {
            return Err(TooLittle(least));
        }
        Ok(((bytes - fixed - cache_bytes(0)) / tile).min(TILES_KEPT))
    }

    /// How many texels a frame may upload within so many bytes of all.
    ///
    /// # Errors
    /// [`TooLittle`], where not even a batch fits.
    pub fn texels_within(&self, bytes: usize) -> Result<usize, TooLittle> {
        let least = self.plan_bytes_max() + BATCH_TEXELS * TEXEL_BYTES;
        if bytes < least {
            return Err(TooLittle(least));
        }
        Ok((bytes - self.plan_bytes_max()) / TEXEL_BYTES)
    }

    /// The settings that keep within so many bytes of memory.
    ///
    /// # Errors
    /// [`TooLittle`]
    pub fn settings(&self, settings: Settings, resident: usize) -> Result<Settings, TooLittle> {
        Ok(Settings {
            tiles_kept: self.tiles_within(resident)?,
            ..settings
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn need(vertices: u32) -> Need {
        Need {
            shape: Shape::new(vertices).expect("a legal shape"),
            levels: 10,
            scenes: 1,
            globe_bytes: 0,
        }
    }

    #[test]
    fn what_is_short_of_memory_keeps_fewer_tiles_and_then_says_what_it_needs() {
        let need = need(255);
        // Ten levels of 256 x 256 texels of 8 bytes, three times.
        assert!(need.fixed_bytes() > 10 * 256 * 256 * 8 * 3);
        assert_eq!(need.tiles_within(96 << 20), Ok(TILES_KEPT));
        let short = need.fixed_bytes() + cache_bytes(60);
        assert_eq!(need.tiles_within(short), Ok(60));
        let Err(TooLittle(least)) = need.tiles_within(1 << 20) else {
            unreachable!("1 MiB is too little")
        };
        assert_eq!(need.tiles_within(least), Ok(TILES_KEPT_MIN));
        assert!(need.tiles_within(least - 1).is_err());
    }

    #[test]
    fn what_is_uploaded_beside_texels_is_taken_off() {
        let need = need(255);
        let quota = need.plan_bytes_max() + 65_536 * TEXEL_BYTES;
        assert_eq!(need.texels_within(quota), Ok(65_536));
        assert!(need.texels_within(need.plan_bytes_max()).is_err());
    }
}
