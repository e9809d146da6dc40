//! Reading tiles that are told by the next coarser one: the coarser tiles that were read last are kept, decoded, so that a
//! tile costs itself and seldom more. Allocates only when made.

use crate::limits::LEVELS_MAX;
use crate::terrain::codec::{CodecError, SurfaceKind, Tile};
use crate::terrain::grid::TileKey;
use crate::terrain::pyramid::{Parent, PyramidDecoder, parent_of};

/// Decoded tiles that are kept of each level. A window of 447 posts and its border touches 5 x 5 tiles, 3 x 3 of the next
/// level; strips touch a row of these or a column. 48 KiB each, 2.1 MB in all.
const KEPT: usize = 4;

#[derive(Debug)]
struct Slot {
    key: Option<TileKey>,
    used: u64,
    tile: Tile,
}

/// See the module.
#[derive(Debug)]
pub(crate) struct Chain {
    decoder: PyramidDecoder,
    /// [`KEPT`] for each level.
    slots: Vec<Slot>,
    spare: Tile,
    clock: u64,
    /// The file that the tiles are of.
    of: u64,
}

impl Chain {
    pub(crate) fn new() -> Self {
        let slot = || Slot {
            key: None,
            used: 0,
            tile: Tile::filled(0, SurfaceKind::Void),
        };
        Self {
            decoder: PyramidDecoder::new(),
            slots: std::iter::repeat_with(slot).take(KEPT * LEVELS_MAX).collect(),
            spare: Tile::filled(0, SurfaceKind::Void),
            clock: 0,
            of: 0,
        }
    }

    /// Goes over to a file: nothing of another one is kept.
    pub(crate) fn enter(&mut self, file: u64) {
        if self.of != file {
            self.of = file;
            for slot in &mut self.slots {
                slot.key = None;
            }
        }
    }

    fn find(&self, key: TileKey) -> Option<usize> {
        let first = usize::from(key.level) * KEPT;
        let slots = self.slots.get(first..first + KEPT)?;
        let at = slots.iter().position(|s| s.key == Some(key))?;
        Some(first + at)
    }

    /// Whether a tile is kept.
    pub(crate) fn has(&self, key: TileKey) -> bool {
        self.find(key).is_some()
    }

    /// Copies a tile that is kept; says whether it is.
    pub(crate) fn copy(&mut self, key: TileKey, tile: &mut Tile) -> bool {
        self.clock += 1;
        let Some(at) = self.find(key) else {
            return false;
        };
        self.slots[at].used = self.clock;
        tile.quanta.copy_from_slice(self.slots[at].tile.quanta.as_slice());
        tile.kind.copy_from_slice(self.slots[at].tile.kind.as_slice());
        true
    }

    /// Decodes a tile whose parent is kept, or is not in the file. On an error `tile` is unchanged.
    pub(crate) fn decode(
        &mut self,
        key: TileKey,
        stored: &[u8],
        tile: &mut Tile,
    ) -> Result<(), CodecError> {
        self.clock += 1;
        let above = self.find(parent_of(key));
        if let Some(above) = above {
            self.slots[above].used = self.clock;
        }
        let parent = above.map(|at| Parent::new(&self.slots[at].tile, key));
        self.decoder.decode(stored, parent, tile)
    }

    /// The same, keeping the tile.
    pub(crate) fn keep(&mut self, key: TileKey, stored: &[u8]) -> Result<(), CodecError> {
        self.clock += 1;
        let above = self.find(parent_of(key));
        if let Some(above) = above {
            self.slots[above].used = self.clock;
        }
        let parent = above.map(|at| Parent::new(&self.slots[at].tile, key));
        self.decoder.decode(stored, parent, &mut self.spare)?;
        let first = usize::from(key.level) * KEPT;
        let slots = self.slots.iter_mut().skip(first).take(KEPT);
        if let Some(slot) = slots.min_by_key(|s| s.used) {
            slot.key = Some(key);
            slot.used = self.clock;
            std::mem::swap(&mut slot.tile, &mut self.spare);
        }
        Ok(())
    }
}
