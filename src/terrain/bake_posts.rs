//! Tiles already written, read back as patches of posts, and the triangles that a level's surface is drawn with.

use crate::terrain::codec::{SurfaceKind, Tile};
use crate::terrain::grid::{Grid, TileKey};
use crate::terrain::pack::{TileError, TileReader, Tiles};
use crate::terrain::partition::Partition;
use std::io;

/// Decoded tiles that are kept: a patch touches at most 9 tiles of a level, 4 of each in the measuring of all levels.
const TILES_KEPT: usize = 48;

/// A post of a patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PatchPost {
    /// Its height.
    pub(crate) quanta: u16,
    /// What it is.
    pub(crate) kind: SurfaceKind,
}

/// Posts of a level, row by row from the south-west one.
#[derive(Debug, Default)]
pub(crate) struct Patch {
    level: u8,
    west: i32,
    south: i32,
    columns: usize,
    /// `None` where the level's lattice has no post: beyond the date line if it does not close there.
    pub(crate) posts: Vec<Option<PatchPost>>,
}

/// The corners of a triangle: a patch's posts by number, and their weights at a place in it.
pub(crate) type Corners = [(usize, f64); 3];

impl Patch {
    /// Column and row of a post by number.
    pub(crate) fn place(&self, at: usize) -> (i32, i32) {
        (
            self.west + signed(at % self.columns),
            self.south + signed(at / self.columns),
        )
    }

    /// The triangle over a place in level-0 posts, with the diagonals that are drawn (see [`crate::terrain::blocks`]), or
    /// with the `other` ones; `None` outside the patch.
    pub(crate) fn corners(&self, (x, y): (f64, f64), other: bool) -> Option<Corners> {
        let step = f64::from(1_u32 << self.level);
        let (x, y) = (x / step, y / step);
        let (i, j) = (whole(x.floor()), whole(y.floor()));
        let (fx, fy) = (x - x.floor(), y - y.floor());
        let (column, row) = (
            usize::try_from(i - self.west).ok()?,
            usize::try_from(j - self.south).ok()?,
        );
        let sw = row * self.columns + column;
        let (se, nw, ne) = (sw + 1, sw + self.columns, sw + self.columns + 1);
        if column + 1 >= self.columns || ne >= self.posts.len() {
            return None;
        }
        let even = ((i + j).rem_euclid(2) == 0) != other;
        Some(match (even, fx >= fy, fx + fy <= 1.0) {
            (true, true, _) => [(sw, 1.0 - fx), (se, fx - fy), (ne, fy)],
            (true, false, _) => [(sw, 1.0 - fy), (nw, fy - fx), (ne, fx)],
            (false, _, true) => [(sw, 1.0 - fx - fy), (se, fx), (nw, fy)],
            (false, _, false) => [(ne, fx + fy - 1.0), (nw, 1.0 - fx), (se, 1.0 - fy)],
        })
    }
}

#[derive(Debug)]
struct Slot {
    key: Option<TileKey>,
    used: u64,
    there: bool,
    tile: Tile,
}

/// Reads patches; keeps the tiles used last.
#[derive(Debug)]
pub(crate) struct Posts<'a> {
    tiles: &'a Tiles,
    grid: Grid,
    /// Quanta of sea level: what stands where there is no tile.
    sea: u16,
    slots: Vec<Slot>,
    clock: u64,
    reader: TileReader,
}

impl<'a> Posts<'a> {
    pub(crate) fn new(tiles: &'a Tiles, grid: Grid, sea: u16) -> Self {
        Self {
            tiles,
            grid,
            sea,
            slots: Vec::new(),
            clock: 0,
            reader: TileReader::new(),
        }
    }

    /// Reads `columns` x `rows` posts of a level from (`west`, `south`).
    pub(crate) fn patch(
        &mut self,
        (partition, level): (Partition, u8),
        (west, south): (i32, i32),
        (columns, rows): (usize, usize),
        patch: &mut Patch,
    ) -> io::Result<()> {
        patch.posts.clear();
        (patch.level, patch.west, patch.south) = (level, west, south);
        patch.columns = columns;
        let row_max = self.grid.row_max() >> level;
        for j in south..south + signed(rows) {
            let mut held: Option<(TileKey, Option<usize>)> = None;
            for i in west..west + signed(columns) {
                let canonical = match partition {
                    Partition::Geographic if j.abs() > row_max => None,
                    Partition::Geographic => self.grid.canonical_at(level, i),
                    Partition::North | Partition::South => Some(i),
                };
                let Some(i) = canonical else {
                    patch.posts.push(None);
                    continue;
                };
                let key = TileKey::of_post(partition, level, i, j);
                let slot = match held {
                    Some((held, slot)) if held == key => slot,
                    _ => self.tile(key)?,
                };
                held = Some((key, slot));
                let at = TileKey::index_of(i, j);
                patch.posts.push(Some(match slot {
                    Some(slot) => PatchPost {
                        quanta: self.slots[slot].tile.quanta[at],
                        kind: self.slots[slot].tile.kind[at],
                    },
                    None => PatchPost {
                        quanta: self.sea,
                        kind: SurfaceKind::Void,
                    },
                }));
            }
        }
        Ok(())
    }

    /// Quanta of sea level.
    pub(crate) const fn sea(&self) -> u16 {
        self.sea
    }

    /// Whether a geographic level-0 column is that by which its posts are kept.
    pub(crate) const fn names(&self, i: i32) -> bool {
        self.grid.canonical(i) == i
    }

    /// The slot of a tile; `None` if there is no such tile.
    fn tile(&mut self, key: TileKey) -> io::Result<Option<usize>> {
        self.clock += 1;
        let slot = match self.slots.iter().position(|s| s.key == Some(key)) {
            Some(slot) => slot,
            None => self.load(key)?,
        };
        self.slots[slot].used = self.clock;
        Ok(self.slots[slot].there.then_some(slot))
    }

    fn load(&mut self, key: TileKey) -> io::Result<usize> {
        if self.slots.len() < TILES_KEPT {
            self.slots.push(Slot {
                key: None,
                used: 0,
                there: false,
                tile: Tile::filled(0, SurfaceKind::Void),
            });
        }
        let oldest = self.slots.iter_mut().enumerate().min_by_key(|s| s.1.used);
        let Some((at, slot)) = oldest else {
            return Err(io::Error::other("no place for a tile"));
        };
        slot.key = None;
        slot.there = match self.tiles.read(key, &mut self.reader, &mut slot.tile) {
            Ok(()) => true,
            Err(TileError::Absent) => false,
            Err(TileError::Io(e)) => return Err(e),
            Err(e) => return Err(io::Error::other(e)),
        };
        slot.key = Some(key);
        Ok(at)
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    reason = "sides of patches"
)]
pub(crate) const fn signed(count: usize) -> i32 {
    count as i32
}

#[expect(clippy::cast_possible_truncation, reason = "post numbers on Earth")]
pub(crate) const fn whole(v: f64) -> i32 {
    v as i32
}
