//! Decoded tiles that are kept: read when they are asked for, within what may be decoded, and forgotten when others were used since.

use super::codec::{STORED_BYTES_MAX, SurfaceKind, Tile};
use super::credit::Credit;
use super::grid::{TILE_AREA, TileKey};
use super::pack::{TileError, TileReader};
use super::surface::{Damage, TileSource};
use std::sync::atomic::{AtomicBool, Ordering};

/// Decoded tiles that are kept: a window of 255 posts with its border touches 3 x 3 tiles on most of its 12 levels; and a
/// square of 64 posts of level 11 that stands beyond the date line, where level 7 gives its posts, 9 x 9. 48 KiB each.
pub const TILES_KEPT: usize = 128;

/// The fewest that can be kept: what one square of 64 posts and the coarser posts under it touch, and as many ahead of the flight.
pub const TILES_KEPT_MIN: usize = 24;

/// Frames after which a tile that the disk did not give is read again when it is wanted.
const READ_AGAIN_FRAMES: u32 = 30;

/// Bytes of so many tiles, and of what reading takes: what is read, and what is unpacked.
pub(super) const fn bytes(tiles: usize) -> usize {
    tiles * TILE_AREA * (size_of::<u16>() + size_of::<SurfaceKind>()) + 2 * STORED_BYTES_MAX
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Found {
    Ready(usize),
    Damaged,
    Absent,
}

#[derive(Debug)]
struct Slot {
    key: Option<TileKey>,
    damaged: bool,
    /// The frame in which the disk did not give it.
    unread: Option<u32>,
    used: u64,
    tile: Tile,
}

/// See the module.
#[derive(Debug)]
pub(super) struct TileCache<'a, S> {
    source: &'a S,
    damage: &'a Damage,
    slots: Vec<Slot>,
    clock: u64,
    /// What may be decoded, and whether that does not matter any more; `None`: everything.
    pub(super) credit: Option<(&'a Credit, &'a AtomicBool)>,
    /// Whether the disk has failed since this was last set to false.
    pub(super) unread: bool,
    reader: TileReader,
}

impl<'a, S: TileSource> TileCache<'a, S> {
    /// Of [`TILES_KEPT`] tiles.
    pub(super) fn new(source: &'a S, damage: &'a Damage) -> Self {
        Self {
            source,
            damage,
            slots: slots(TILES_KEPT),
            clock: 0,
            credit: None,
            unread: false,
            reader: TileReader::new(),
        }
    }

    /// Changes the number of tiles, all of them forgotten.
    pub(super) fn keep(&mut self, tiles: usize) {
        self.slots = slots(tiles.max(TILES_KEPT_MIN));
    }

    /// The tile that was [`Found::Ready`].
    pub(super) fn at(&self, slot: usize) -> &Tile {
        &self.slots[slot].tile
    }

    /// A tile from the cache, or read into its least recently used slot.
    pub(super) fn tile(&mut self, key: TileKey) -> Found {
        self.clock += 1;
        let mut oldest = 0;
        for at in 0..self.slots.len() {
            if self.slots[at].key == Some(key) {
                self.slots[at].used = self.clock;
                return self.kept(at, key);
            }
            if self.slots[at].used < self.slots[oldest].used {
                oldest = at;
            }
        }
        if !self.source.contains(key) {
            return Found::Absent;
        }
        self.read(oldest, key)
    }

    /// What a slot holds; what the disk has not given is asked for again after a while.
    fn kept(&mut self, at: usize, key: TileKey) -> Found {
        let slot = &self.slots[at];
        match slot.unread {
            Some(since) if self.frame().wrapping_sub(since) >= READ_AGAIN_FRAMES => {
                self.read(at, key)
            }
            unread => {
                self.unread |= unread.is_some();
                if slot.damaged {
                    Found::Damaged
                } else {
                    Found::Ready(at)
                }
            }
        }
    }

    fn frame(&self) -> u32 {
        self.credit.map_or(0, |(credit, _)| credit.frames())
    }

    /// Reads a tile that the source has into a slot, once its samples are granted.
    fn read(&mut self, at: usize, key: TileKey) -> Found {
        if let Some((credit, stop)) = self.credit {
            while !credit.take(TILE_SAMPLES) {
                if stop.load(Ordering::Acquire) {
                    return Found::Absent;
                }
                // Woken by the next frame, or by the end.
                std::thread::park();
            }
        }
        let slot = &mut self.slots[at];
        let read = self.source.read_tile(key, &mut self.reader, &mut slot.tile);
        if let Err(TileError::Absent) = read {
            return Found::Absent;
        }
        let failed = matches!(read, Err(TileError::Io(_) | TileError::CutShort));
        if let Err(e) = &read {
            self.damage.count(e);
        }
        slot.key = Some(key);
        slot.used = self.clock;
        slot.damaged = read.is_err();
        slot.unread = None;
        self.unread |= failed;
        if failed {
            self.slots[at].unread = Some(self.frame());
        }
        if read.is_err() {
            Found::Damaged
        } else {
            Found::Ready(at)
        }
    }
}

/// Samples of a tile.
const TILE_SAMPLES: u32 = 128 * 128;

const _: () = assert!(TILE_SAMPLES as usize == TILE_AREA, "all of a tile");

fn slots(tiles: usize) -> Vec<Slot> {
    let slot = || Slot {
        key: None,
        damaged: false,
        unread: None,
        used: 0,
        tile: Tile::filled(0, SurfaceKind::Void),
    };
    std::iter::repeat_with(slot).take(tiles).collect()
}
