//! From finished level-0 posts to tiles of every level: posts are scattered to the tiles of all levels that sample them,
//! and a tile is encoded as soon as nothing more can reach it. The finest geographic tiles go straight to the pack, the
//! others to a file of their own, until the partition is whole: then they are read again, raised where a summit needs it
//! ([`crate::terrain::bake_raise`]) and written, and the levels are compared with the data
//! ([`crate::terrain::bake_measure`]).
//!
//! Memory: the tiles that posts to come may still touch. Within a row of degree cells these are the tiles that straddle
//! its northern edge and the coarse ones, about 1.2 MB for each degree of longitude at 3"; then the index of the tiles
//! read, some 100 tiles for each thread, and an error for each tile. On the disk, until the end, a sixth more than the pack
//! and 10 bytes for each summit.

use crate::terrain::bake_measure::{Found, Meter, Sums};
use crate::terrain::bake_posts::Posts;
use crate::terrain::bake_raise::{Raiser, candidates};
use crate::terrain::bake_summits::Summits;
use crate::terrain::bake_threads::{TURN, share};
use crate::terrain::codec::{Encoder, SurfaceKind, Tile};
use crate::terrain::geoid::GeoidGrid;
use crate::terrain::grid::{Grid, TILE_SIDE, TileKey};
use crate::terrain::height::split;
use crate::terrain::pack::{LevelError, PackInfo, PostRect, SourceInfo, Tiles};
use crate::terrain::partition::{CAP_LATITUDE_MIN_DEG, Partition};
use crate::terrain::store::{EncodedTile, PackWriter, Scale, Statistics};
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

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
    target: PathBuf,
    writer: PackWriter,
    /// What is not final yet: never finished, hence removed in the end.
    sampled: PackWriter,
    /// The geographic summits, once they are known.
    summits: Option<Summits>,
    open: BTreeMap<TileKey, OpenTile>,
    encoders: Vec<Encoder>,
    quick: Vec<Encoder>,
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
            target: target.to_owned(),
            writer: PackWriter::create(target, grid, scale)?,
            sampled: PackWriter::beside(target, "sampled", grid, scale)?,
            summits: None,
            open: BTreeMap::new(),
            encoders: (0..jobs.max(1)).map(|_| Encoder::new()).collect(),
            quick: (0..jobs.max(1)).map(|_| Encoder::quick()).collect(),
            statistics: Statistics::default(),
        })
    }

    /// Its grid and scale.
    pub(crate) const fn frame(&self) -> (Grid, Scale) {
        (self.grid, self.scale)
    }

    /// Takes the posts of a degree cell and writes what no later one can reach; `next` is the cell that comes then, in the
    /// order of [`cells`].
    ///
    /// # Errors
    /// If writing fails.
    pub(crate) fn lay(
        &mut self,
        block: &Block,
        (latitude, longitude): (i32, i32),
        next: Option<&(i32, i32)>,
    ) -> io::Result<()> {
        let posts = self.grid.posts_per_degree.cast_signed();
        self.scatter(block);
        let row_ends = next.is_none_or(|next| next.0 != latitude);
        let east = (!row_ends).then_some((longitude + 1) * posts);
        self.flush((latitude + 1) * posts, east)
    }

    /// Completes the partition and goes on to another. Gives the level-0 tiles of the geographic one that reach as far as
    /// the cap does. `proceed` is called with the tiles done and their number, and says whether to go on.
    ///
    /// # Errors
    /// If writing, or reading back, fails.
    pub(crate) fn turn_to(
        &mut self,
        cap: Partition,
        proceed: &mut dyn FnMut(usize, usize) -> bool,
    ) -> io::Result<Tiles> {
        self.complete(proceed)?;
        self.partition = cap;
        self.data()
    }

    /// The finished data of the partition: the geographic level-0 tiles that it reaches.
    fn data(&mut self) -> io::Result<Tiles> {
        let row_min = split(self.grid, CAP_LATITUDE_MIN_DEG).0;
        let partition = self.partition;
        self.writer.written(|key| {
            let reaches = match partition {
                Partition::Geographic => true,
                Partition::North => key.south() + TILE_SIDE > row_min,
                Partition::South => -key.south() >= row_min,
            };
            key.partition == Partition::Geographic && key.level == 0 && reaches
        })
    }

    /// The partition's first level that is not the data itself.
    const fn first_made(&self) -> u8 {
        match self.partition {
            Partition::Geographic => 1,
            Partition::North | Partition::South => 0,
        }
    }

    /// Writes what is left of the partition: its last tiles; then the levels that were only sampled until now, with the
    /// summits they have to keep; then how far they are from the data.
    fn complete(&mut self, proceed: &mut dyn FnMut(usize, usize) -> bool) -> io::Result<()> {
        let rest: Vec<(TileKey, OpenTile)> = std::mem::take(&mut self.open).into_iter().collect();
        self.write(&rest)?;
        let data = self.data()?;
        let geographic = match self.summits.take() {
            Some(summits) => summits,
            None => Summits::find(&self.target, &data, (self.grid, self.sea()), self.jobs())?,
        };
        if self.partition == Partition::Geographic {
            self.raise(&geographic, proceed)?;
        } else {
            let turned = geographic.turned(&self.target, self.grid, self.partition)?;
            self.raise(&turned, proceed)?;
        }
        self.measure(&data, &geographic, proceed)?;
        self.summits = Some(geographic);
        Ok(())
    }

    fn jobs(&self) -> usize {
        self.encoders.len()
    }

    /// Quanta of sea level: where no source says anything the geometry has to go on somewhere.
    fn sea(&self) -> u16 {
        self.scale.quanta(0.0)
    }

    fn raise(
        &mut self,
        summits: &Summits,
        proceed: &mut dyn FnMut(usize, usize) -> bool,
    ) -> io::Result<()> {
        let partition = self.partition;
        let sampled = self.sampled.written(|key| key.partition == partition)?;
        let (frame, sea) = ((self.grid, self.scale), self.sea());
        let raiser = || Raiser::new(Posts::new(&sampled, frame.0, sea), summits, frame);
        let mut raisers: Vec<(Raiser<'_>, Encoder)> = std::mem::take(&mut self.encoders)
            .into_iter()
            .map(|encoder| (raiser(), encoder))
            .collect();
        let (mut done, all) = (0, sampled.entries().len());
        for level in self.first_made()..self.grid.level_count() {
            let keys = sampled.entries().iter().map(|e| e.key);
            let keys = candidates((self.grid, level), keys, summits);
            for keys in keys.chunks(TURN) {
                go_on(proceed(done.min(all), all))?;
                let tiles = share(&mut raisers, keys, |(raiser, encoder), key| {
                    let entry = sampled.entry(*key);
                    let error_m = entry.map_or(0.0, |e| e.max_error_m);
                    let tile = raiser.tile(*key, entry.is_some())?;
                    Ok(tile.map(|tile| EncodedTile::new(encoder, *key, &tile, error_m)))
                });
                for tile in tiles {
                    let tile: io::Result<Option<EncodedTile>> = tile;
                    if let Some(tile) = tile? {
                        self.writer.add(&tile)?;
                    }
                }
                done += keys.len();
            }
        }
        self.encoders = raisers.into_iter().map(|(_, encoder)| encoder).collect();
        Ok(())
    }

    fn measure(
        &mut self,
        data: &Tiles,
        summits: &Summits,
        proceed: &mut dyn FnMut(usize, usize) -> bool,
    ) -> io::Result<()> {
        let (partition, first) = (self.partition, self.first_made());
        let made = self
            .writer
            .written(|key| key.partition == partition && key.level >= first)?;
        let (grid, scale, sea) = (self.grid, self.scale, self.sea());
        let meter = || Meter {
            base: Posts::new(data, grid, sea),
            levels: Posts::new(&made, grid, sea),
            summits,
            grid,
            scale,
            of: (partition, first),
        };
        let mut meters: Vec<Meter<'_>> = std::iter::repeat_with(meter)
            .take(self.encoders.len())
            .collect();
        let mut levels = vec![Sums::default(); usize::from(grid.level_count() - first)];
        let mut tiles: BTreeMap<TileKey, f32> = BTreeMap::new();
        for (turn, entries) in data.entries().chunks(TURN).enumerate() {
            go_on(proceed(turn * TURN, data.entries().len()))?;
            let found = share(&mut meters, entries, |meter, entry| {
                meter.tile(entry.key, entry.max_error_m)
            });
            for found in found {
                let found: Found = found?;
                for (all, own) in levels.iter_mut().zip(&found.levels) {
                    all.join(own);
                }
                for (key, error_m) in found.tiles {
                    let stated = tiles.entry(key).or_insert(0.0);
                    *stated = stated.max(error_m);
                }
            }
        }
        self.writer.state_tile_errors(&tiles);
        for (level, sums) in (first..).zip(&levels) {
            self.writer.state_error(partition, level, sums.error());
        }
        if partition == Partition::Geographic {
            self.writer.state_error(partition, 0, LevelError::default());
        }
        Ok(())
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
            let sea = self.scale.quanta(0.0);
            let mut open: Option<&mut OpenTile> = None;
            for (along, post) in posts {
                let Some(post) = post else { continue };
                let tile = match open {
                    Some(tile) => tile,
                    None => self.open.entry(key).or_insert_with(|| OpenTile {
                        tile: Tile::filled(sea, SurfaceKind::Void),
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

    /// Encodes in parallel, writes in order: the data itself to the pack, what is made of it to the other file.
    fn write(&mut self, tiles: &[(TileKey, OpenTile)]) -> io::Result<()> {
        let first_made = self.first_made();
        let (made, data): (Vec<_>, Vec<_>) =
            tiles.iter().partition(|(key, _)| key.level >= first_made);
        let encode = |encoder: &mut Encoder, tile: &&(TileKey, OpenTile)| {
            let (key, open) = tile;
            EncodedTile::new(encoder, *key, &open.tile, open.max_error_m)
        };
        for tile in share(&mut self.encoders, &data, encode) {
            self.writer.add(&tile)?;
        }
        for tile in share(&mut self.quick, &made, encode) {
            self.sampled.add(&tile)?;
        }
        Ok(())
    }

    /// Writes what is left and completes the pack. `proceed` is called with the tiles done and their number, and says whether
    /// to go on.
    ///
    /// # Errors
    /// If writing, or reading back, fails, or `proceed` said no; no pack is left then.
    pub fn finish(
        mut self,
        geoid: &GeoidGrid,
        sources: &[SourceInfo],
        proceed: &mut dyn FnMut(usize, usize) -> bool,
    ) -> io::Result<PackInfo> {
        self.complete(proceed)?;
        self.writer.finish(geoid, sources, &self.statistics)
    }
}

/// An error where somebody said to stop.
pub(crate) fn go_on(yes: bool) -> io::Result<()> {
    if yes {
        Ok(())
    } else {
        Err(io::Error::from(io::ErrorKind::Interrupted))
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
