//! From finished level-0 posts to tiles of every level: posts are scattered to the tiles of all levels that sample them,
//! and a tile is encoded and written as soon as nothing more can reach it.
//!
//! Memory: the tiles that posts to come may still touch. Within a row of degree cells these are the tiles that straddle
//! its northern edge and the coarse ones, about 1.2 MB for each degree of longitude at 3".

use crate::terrain::codec::{Encoder, SurfaceKind, Tile};
use crate::terrain::geoid::GeoidGrid;
use crate::terrain::grid::{Grid, TILE_SIDE, TileKey};
use crate::terrain::pack::{PackInfo, PostRect, SourceInfo, Tiles};
use crate::terrain::partition::Partition;
use crate::terrain::store::{EncodedTile, PackWriter, Scale, Statistics};
use std::collections::BTreeMap;
use std::io;
use std::path::Path;

/// Finished posts of a rectangle; in the geographic partition its columns are canonical.
#[derive(Debug)]
pub struct Block {
    /// Level-0 row of the southernmost posts.
    pub south: i32,
    /// Level-0 column of the westernmost posts.
    pub west: i32,
    /// Posts in a row.
    pub columns: usize,
    /// Row by row from the south, each from the west; `None` where no source covers the post.
    pub posts: Vec<Option<Post>>,
}

impl Block {
    /// No posts.
    #[must_use]
    pub const fn empty() -> Self {
        Self {
            south: 0,
            west: 0,
            columns: 0,
            posts: Vec::new(),
        }
    }
}

/// A finished post.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Post {
    /// Its height.
    pub quanta: u16,
    /// What it is.
    pub kind: SurfaceKind,
    /// How far the stored height is from its source, metres.
    pub error_m: f32,
}

struct OpenTile {
    tile: Tile,
    max_error_m: f32,
}

/// The levels of a pack being made.
pub struct Levels {
    grid: Grid,
    scale: Scale,
    partition: Partition,
    writer: PackWriter,
    open: BTreeMap<TileKey, OpenTile>,
    encoders: Vec<Encoder>,
    statistics: Statistics,
}

impl std::fmt::Debug for Levels {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Levels")
            .field("grid", &self.grid)
            .field("open", &self.open.len())
            .finish_non_exhaustive()
    }
}

impl Levels {
    /// Begins a pack, with the geographic partition; `jobs` threads encode.
    ///
    /// # Errors
    /// If the temporary file cannot be made.
    pub fn create(target: &Path, grid: Grid, scale: Scale, jobs: usize) -> io::Result<Self> {
        Ok(Self {
            grid,
            scale,
            partition: Partition::Geographic,
            writer: PackWriter::create(target, grid, scale)?,
            open: BTreeMap::new(),
            encoders: (0..jobs.max(1)).map(|_| Encoder::new()).collect(),
            statistics: Statistics::default(),
        })
    }

    /// Writes what is left of the partition and goes on to another. Gives the level-0 tiles of the geographic one that
    /// reach at least `row_min` rows from the equator, on the side of the cap.
    ///
    /// # Errors
    /// If writing fails.
    pub(crate) fn turn_to(&mut self, cap: Partition, row_min: i32) -> io::Result<Tiles> {
        let rest: Vec<(TileKey, OpenTile)> = std::mem::take(&mut self.open).into_iter().collect();
        self.write(&rest)?;
        self.partition = cap;
        self.writer.written(|key| {
            let beyond = match cap {
                Partition::South => -key.south(),
                Partition::North | Partition::Geographic => key.south() + TILE_SIDE - 1,
            };
            key.partition == Partition::Geographic && key.level == 0 && beyond >= row_min
        })
    }

    /// Puts a block's posts into the tiles of every level.
    pub fn scatter(&mut self, block: &Block) {
        if self.partition == Partition::Geographic {
            self.count(block);
        }
        let rows = block.posts.len() / block.columns.max(1);
        let Ok(rows) = i32::try_from(rows) else {
            return;
        };
        if rows == 0 {
            return;
        }
        for level in 0..self.grid.level_count() {
            let step = 1_i32 << level;
            let first = block.south.div_euclid(step) + i32::from(block.south.rem_euclid(step) != 0);
            let last = (block.south + rows - 1).div_euclid(step);
            for row in first..=last {
                self.scatter_row(block, level, row);
            }
        }
    }

    /// One row of a level, tile by tile.
    fn scatter_row(&mut self, block: &Block, level: u8, j: i32) {
        let step = 1_i32 << level;
        let start = offset(j * step - block.south) * block.columns;
        let row = &block.posts[start..start + block.columns];
        let west = block.west.div_euclid(step) + i32::from(block.west.rem_euclid(step) != 0);
        let mut i = west;
        while let Some(place) = within(i * step - block.west, block.columns) {
            let key = TileKey::of_post(self.partition, level, i, j);
            let next = (key.column + 1) * TILE_SIDE;
            let posts = row[place..].iter().step_by(offset(step));
            let posts = posts.take(offset(next - i)).enumerate();
            let at = TileKey::index_of(i, j);
            let mut open: Option<&mut OpenTile> = None;
            for (along, post) in posts {
                let Some(post) = post else { continue };
                let tile = match open {
                    Some(tile) => tile,
                    None => self.open.entry(key).or_insert_with(|| OpenTile {
                        // Where no source says anything, the sea's height: the geometry has to go on somewhere.
                        tile: Tile::filled(self.scale.quanta(0.0), SurfaceKind::Void),
                        max_error_m: 0.0,
                    }),
                };
                tile.tile.quanta[at + along] = post.quanta;
                tile.tile.kind[at + along] = post.kind;
                tile.max_error_m = tile.max_error_m.max(post.error_m);
                open = Some(tile);
            }
            i = next;
        }
    }

    fn count(&mut self, block: &Block) {
        let s = &mut self.statistics;
        for post in block.posts.iter().flatten() {
            s.posts += 1;
            match post.kind {
                SurfaceKind::Void => {
                    s.void_posts += 1;
                    continue;
                }
                SurfaceKind::Water => s.water_posts += 1,
                SurfaceKind::Land => {}
            }
            let height = self.scale.height_m(post.quanta);
            let (low, high) = s.heights_m.unwrap_or((height, height));
            s.heights_m = Some((low.min(height), high.max(height)));
        }
    }

    /// Writes every tile that lies wholly south of level-0 row `north` and west of column `east`; or wholly south of
    /// `north` where `east` is `None`.
    ///
    /// # Errors
    /// If writing fails.
    pub fn flush(&mut self, north: i32, east: Option<i32>) -> io::Result<()> {
        let done = |key: &TileKey| {
            let end = |start: i32| (start + TILE_SIDE - 1) << key.level;
            end(key.south()) < north && east.is_none_or(|east| end(key.west()) < east)
        };
        let ready: Vec<TileKey> = self.open.keys().filter(|k| done(k)).copied().collect();
        let tiles: Vec<(TileKey, OpenTile)> = ready
            .into_iter()
            .filter_map(|key| Some((key, self.open.remove(&key)?)))
            .collect();
        self.write(&tiles)
    }

    /// Encodes in parallel, writes in order.
    fn write(&mut self, tiles: &[(TileKey, OpenTile)]) -> io::Result<()> {
        let share = tiles.len().div_ceil(self.encoders.len()).max(1);
        let mut encoded: Vec<Option<EncodedTile>> = Vec::new();
        encoded.resize_with(tiles.len(), || None);
        let encode = |encoder: &mut Encoder, to: &mut [Option<EncodedTile>], from: &[_]| {
            for (to, (key, open)) in to.iter_mut().zip(from) {
                let open: &OpenTile = open;
                *to = Some(EncodedTile::new(
                    encoder,
                    *key,
                    &open.tile,
                    open.max_error_m,
                ));
            }
        };
        std::thread::scope(|scope| {
            let shares = encoded.chunks_mut(share).zip(tiles.chunks(share));
            let mut shares = self.encoders.iter_mut().zip(shares);
            let own = shares.next();
            for (encoder, (to, from)) in shares {
                let builder = std::thread::Builder::new().name("encode".into());
                // Tiles of a thread that cannot start are encoded below.
                let _ = builder.spawn_scoped(scope, move || encode(encoder, to, from));
            }
            if let Some((encoder, (to, from))) = own {
                encode(encoder, to, from);
            }
        });
        for (slot, (key, open)) in encoded.into_iter().zip(tiles) {
            let tile = slot.unwrap_or_else(|| {
                EncodedTile::new(&mut Encoder::new(), *key, &open.tile, open.max_error_m)
            });
            self.writer.add(&tile)?;
        }
        Ok(())
    }

    /// Writes what is left and completes the pack.
    ///
    /// # Errors
    /// If writing fails; no pack is left then.
    pub fn finish(mut self, geoid: &GeoidGrid, sources: &[SourceInfo]) -> io::Result<PackInfo> {
        let rest: Vec<(TileKey, OpenTile)> = std::mem::take(&mut self.open).into_iter().collect();
        self.write(&rest)?;
        self.writer.finish(geoid, sources, &self.statistics)
    }
}

/// The degree cells that hold posts of any rectangle, as (latitude, longitude) of their south-west corners in the order
/// they are baked: from the south, each row from the west. A cell owns the posts of its southern and western edges.
#[must_use]
pub fn cells(grid: Grid, rects: &[PostRect]) -> Vec<(i32, i32)> {
    let posts = grid.posts_per_degree.cast_signed();
    let mut cells: Vec<(i32, i32)> = rects
        .iter()
        .flat_map(|r| {
            let rows = r.south.div_euclid(posts)..=r.north.div_euclid(posts);
            rows.flat_map(move |row| {
                let columns = r.west.div_euclid(posts)..=r.east.div_euclid(posts);
                columns.map(move |column| (row, (column + 180).rem_euclid(360) - 180))
            })
        })
        .collect();
    cells.sort_unstable();
    cells.dedup();
    cells
}

/// A place that is known not to be negative.
fn offset(x: i32) -> usize {
    usize::try_from(x).unwrap_or(0)
}

fn within(x: i32, count: usize) -> Option<usize> {
    usize::try_from(x).ok().filter(|x| *x < count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_own_their_southern_and_western_edges() {
        let grid = Grid {
            posts_per_degree: 1200,
        };
        let cell = |latitude: i32, longitude: i32| PostRect {
            south: latitude * 1200,
            west: longitude * 1200,
            north: (latitude + 1) * 1200,
            east: (longitude + 1) * 1200,
        };
        assert_eq!(
            cells(grid, &[cell(50, 14)]),
            [(50, 14), (50, 15), (51, 14), (51, 15)],
            "its northern and eastern edges belong to neighbours"
        );
        assert!(
            cells(grid, &[cell(0, 179)]).contains(&(0, -180)),
            "180 E is 180 W"
        );
    }
}
