//! Packs of regions joined to one: the planet is baked in shards, anywhere and in any order, and put together here.
//!
//! The finest level is taken post by post, as it is, from the pack that covers it; where several do, the first with a
//! measured height gives it, and heights that differ are reported. Coarse levels and caps look across the edges of regions,
//! so they are made anew from the joined posts, as a bake of everything at once would make them. Packs come in the order of
//! their southern and western edges, whatever that of the arguments.
//!
//! Memory: the indexes of the packs (40 bytes a tile), one degree cell (16 bytes a post) and what
//! [`crate::terrain::bake_levels`] needs.

use crate::terrain::bake::{self, Report, Seam};
use crate::terrain::bake_cell::Disagreement;
use crate::terrain::bake_levels::{Block, Levels, Post, cells};
use crate::terrain::bake_mosaic::disagree;
use crate::terrain::codec::{SurfaceKind, Tile};
use crate::terrain::geoid::GeoidGrid;
use crate::terrain::grid::{Grid, TILE_SIDE, TileKey};
use crate::terrain::pack::{
    Pack, PackError, PackInfo, PostRect, SourceInfo, TileError, TileReader,
};
use crate::terrain::partition::Partition;
use crate::terrain::store::Scale;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// What to join.
#[derive(Debug)]
pub struct Job<'a> {
    /// The packs.
    pub packs: &'a [PathBuf],
    /// The pack to write.
    pub out: &'a Path,
    /// Threads; at least 1.
    pub jobs: usize,
    /// Set from elsewhere to stop.
    pub stop: &'a AtomicBool,
}

/// Why a join ended without a pack.
#[derive(Debug, thiserror::Error)]
pub enum JoinError {
    /// A pack cannot be opened.
    #[error("{}", .0.display())]
    Pack(PathBuf, #[source] PackError),
    /// A pack is given twice.
    #[error("is given twice")]
    Twice(PathBuf),
    /// A pack's posts are not where the others' are.
    #[error("has {theirs} posts a degree and {} has {ours}", .first.display())]
    Grid {
        /// The pack that the others are held against.
        first: PathBuf,
        /// The other.
        other: PathBuf,
        /// Posts a degree of the first.
        ours: u32,
        /// Posts a degree of the other.
        theirs: u32,
    },
    /// A tile of a pack is damaged.
    #[error("its tile {1} cannot be read: {2}")]
    Tile(PathBuf, TileKey, TileError),
    /// The joined pack cannot be written.
    #[error("{}", .0.display())]
    Output(PathBuf, #[source] io::Error),
    /// Stopped from outside.
    #[error("stopped before it was done")]
    Stopped,
}

struct Shard {
    path: PathBuf,
    pack: Pack,
}

/// Joins packs. `progress` is called with the degree cells done and their number; then with the tiles of each further step.
///
/// # Errors
/// See [`JoinError`]; whatever happens, `out` is either the old file or a whole pack.
pub fn join(job: &Job<'_>, progress: &mut dyn FnMut(usize, usize)) -> Result<Report, JoinError> {
    let shards = open(job.packs)?;
    let Some(grid) = shards.first().map(|s| s.pack.info().grid) else {
        return Err(JoinError::Output(
            job.out.to_owned(),
            io::Error::from(io::ErrorKind::InvalidInput),
        ));
    };
    let scale = scale(shards.iter().map(|s| *s.pack.info()));
    let sources = sources(&shards);
    let rects: Vec<PostRect> = sources.iter().map(|s| s.rect).collect();
    let geoid = GeoidGrid::over(grid, &rects, job.jobs);
    let failed = |e| JoinError::Output(job.out.to_owned(), e);
    let mut levels = Levels::create(job.out, grid, scale, job.jobs).map_err(failed)?;
    let mut seams = Vec::new();
    let mut table = Table::new(grid, scale);
    let cells = cells(grid, &rects);
    for (done, &cell) in cells.iter().enumerate() {
        progress(done, cells.len());
        if job.stop.load(Ordering::Relaxed) {
            return Err(JoinError::Stopped);
        }
        let block = table.cell(cell, &shards, &mut seams)?;
        levels
            .lay(&block, cell, cells.get(done + 1))
            .map_err(failed)?;
    }
    progress(cells.len(), cells.len());
    let info = bake::finish(
        levels,
        &rects,
        (&geoid, &sources),
        (job.jobs, job.stop),
        progress,
    )
    .map_err(|e| e.map_or(JoinError::Stopped, failed))?;
    let seams = seams
        .iter()
        .map(|d| Seam::of(d, grid, |at| &shards[at].path))
        .collect();
    Ok(Report { info, seams })
}

/// Opens packs and puts them in order.
fn open(paths: &[PathBuf]) -> Result<Vec<Shard>, JoinError> {
    let mut names: Vec<PathBuf> = Vec::with_capacity(paths.len());
    let mut shards: Vec<Shard> = Vec::with_capacity(paths.len());
    for path in paths {
        let name = path.canonicalize().unwrap_or_else(|_| path.clone());
        if names.contains(&name) {
            return Err(JoinError::Twice(path.clone()));
        }
        names.push(name);
        let pack = Pack::open(path).map_err(|e| JoinError::Pack(path.clone(), e))?;
        let path = path.clone();
        shards.push(Shard { path, pack });
    }
    shards.sort_by(|a, b| {
        let order = |s: &Shard| (s.pack.info().rect.south, s.pack.info().rect.west);
        order(a).cmp(&order(b)).then_with(|| a.path.cmp(&b.path))
    });
    let grid = |s: &Shard| s.pack.info().grid.posts_per_degree;
    if let Some(first) = shards.first()
        && let Some(other) = shards.iter().find(|s| grid(s) != grid(first))
    {
        return Err(JoinError::Grid {
            first: first.path.clone(),
            other: other.path.clone(),
            ours: grid(first),
            theirs: grid(other),
        });
    }
    Ok(shards)
}

/// The scale that keeps all heights: the packs' own if they share one; else the finest unit of theirs, from the lowest base,
/// made coarser until the highest height fits.
fn scale(infos: impl Iterator<Item = PackInfo>) -> Scale {
    let mut all: Option<(Scale, f64)> = None;
    for info in infos {
        let top = info.height_max_m.max(0.0);
        all = Some(match all {
            None => (
                Scale {
                    unit_m: info.unit_m,
                    base_m: info.base_m,
                },
                top,
            ),
            Some((scale, highest)) => (
                Scale {
                    unit_m: scale.unit_m.min(info.unit_m),
                    base_m: scale.base_m.min(info.base_m),
                },
                highest.max(top),
            ),
        });
    }
    let (mut scale, highest) = all.unwrap_or((
        Scale {
            unit_m: 1.0,
            base_m: -1000.0,
        },
        0.0,
    ));
    while (highest - scale.base_m) / scale.unit_m > f64::from(u16::MAX) {
        scale.unit_m *= 2.0;
    }
    scale
}

/// What the packs were baked from. A file that was cut between regions whose parts make one rectangle again is one source.
fn sources(shards: &[Shard]) -> Vec<SourceInfo> {
    let mut all: Vec<SourceInfo> = Vec::new();
    for source in shards.iter().flat_map(|s| s.pack.sources()) {
        let part = |s: &&mut SourceInfo| s.name == source.name && beside(&s.rect, &source.rect);
        match all.iter_mut().find(part) {
            Some(whole) => {
                let both = [whole.rect, source.rect].into_iter();
                whole.rect = PostRect::around(both).unwrap_or(whole.rect);
            }
            None => all.push(source.clone()),
        }
    }
    let order = |s: &SourceInfo| (s.rect.south, s.rect.west);
    all.sort_by(|a, b| order(a).cmp(&order(b)).then_with(|| a.name.cmp(&b.name)));
    all
}

/// Whether two rectangles make up one: they touch or overlap along a whole side.
const fn beside(a: &PostRect, b: &PostRect) -> bool {
    let rows = a.south == b.south && a.north == b.north;
    let columns = a.west == b.west && a.east == b.east;
    (columns && a.south <= b.north + 1 && b.south <= a.north + 1)
        || (rows && a.west <= b.east + 1 && b.west <= a.east + 1)
}

/// Puts degree cells together.
struct Table {
    grid: Grid,
    scale: Scale,
    reader: TileReader,
    tile: Tile,
    /// The pack that gave each post of the cell.
    taken: Vec<usize>,
}

impl Table {
    fn new(grid: Grid, scale: Scale) -> Self {
        Self {
            grid,
            scale,
            reader: TileReader::new(),
            tile: Tile::filled(0, SurfaceKind::Void),
            taken: Vec::new(),
        }
    }

    /// The posts of a degree cell.
    fn cell(
        &mut self,
        cell: (i32, i32),
        shards: &[Shard],
        seams: &mut Vec<Disagreement>,
    ) -> Result<Block, JoinError> {
        let degree = self.grid.degree(cell);
        let turn = self.grid.posts_around();
        let parts: Vec<(usize, Vec<PostRect>)> = shards
            .iter()
            .map(|shard| {
                let rects = shard.pack.sources().iter().map(|s| s.rect);
                rects
                    .flat_map(|r| [-turn, 0, turn].map(|t| degree.intersection(&r.shifted(t))))
                    .flatten()
                    .collect::<Vec<_>>()
            })
            .enumerate()
            .filter(|(_, rects)| !rects.is_empty())
            .collect();
        let all = parts.iter().flat_map(|(_, rects)| rects.iter().copied());
        let Some(own) = PostRect::around(all) else {
            return Ok(Block::empty());
        };
        let side = |from: i32, to: i32| (to - from + 1).cast_unsigned() as usize;
        let (columns, rows) = (side(own.west, own.east), side(own.south, own.north));
        let mut block = Block {
            south: own.south,
            west: own.west,
            columns,
            posts: vec![None; columns * rows],
        };
        self.taken.clear();
        self.taken.resize(columns * rows, 0);
        for (number, rects) in &parts {
            self.add((*number, &shards[*number]), rects, &mut block, seams)?;
        }
        Ok(block)
    }

    /// Adds what one pack has in `rects`.
    fn add(
        &mut self,
        (number, shard): (usize, &Shard),
        rects: &[PostRect],
        block: &mut Block,
        seams: &mut Vec<Disagreement>,
    ) -> Result<(), JoinError> {
        let Some(part) = PostRect::around(rects.iter().copied()) else {
            return Ok(());
        };
        let tiles = |from: i32, to: i32| from.div_euclid(TILE_SIDE)..=to.div_euclid(TILE_SIDE);
        for row in tiles(part.south, part.north) {
            for column in tiles(part.west, part.east) {
                let key = TileKey {
                    partition: Partition::Geographic,
                    level: 0,
                    column,
                    row,
                };
                let Some(header) = shard.pack.tile_header(key) else {
                    continue;
                };
                shard
                    .pack
                    .read_tile(key, &mut self.reader, &mut self.tile)
                    .map_err(|e| JoinError::Tile(shard.path.clone(), key, e))?;
                let tile = PostRect {
                    south: key.south(),
                    west: key.west(),
                    north: key.south() + TILE_SIDE - 1,
                    east: key.west() + TILE_SIDE - 1,
                };
                for rect in rects.iter().filter_map(|r| r.intersection(&tile)) {
                    self.take((number, shard), &rect, header.max_error_m, block, seams);
                }
            }
        }
        Ok(())
    }

    /// Takes the posts of a rectangle from the tile that was read.
    fn take(
        &mut self,
        (number, shard): (usize, &Shard),
        rect: &PostRect,
        error_m: f32,
        block: &mut Block,
        seams: &mut Vec<Disagreement>,
    ) {
        for j in rect.south..=rect.north {
            let row = (j - block.south).cast_unsigned() as usize * block.columns;
            for i in rect.west..=rect.east {
                let at = row + (i - block.west).cast_unsigned() as usize;
                let from = TileKey::index_of(i, j);
                let post = self.post(shard, from, error_m);
                match block.posts[at] {
                    Some(there) if there.kind != SurfaceKind::Void => {
                        if post.kind != SurfaceKind::Void && self.taken[at] != number {
                            let steps = f64::from(there.quanta) - f64::from(post.quanta);
                            #[expect(clippy::cast_possible_truncation, reason = "some metres")]
                            let difference_m = (steps.abs() * self.scale.unit_m) as f32;
                            // What rounding to a unit leaves is no disagreement.
                            if steps.abs() > 1.0 {
                                disagree(seams, (self.taken[at], number), difference_m, (i, j));
                            }
                        }
                    }
                    Some(_) if post.kind == SurfaceKind::Void => {}
                    Some(_) | None => {
                        block.posts[at] = Some(post);
                        self.taken[at] = number;
                    }
                }
            }
        }
    }

    /// A post of the tile that was read, in the joined pack's scale.
    fn post(&self, shard: &Shard, at: usize, error_m: f32) -> Post {
        let (quanta, kind) = (self.tile.quanta[at], self.tile.kind[at]);
        let info = shard.pack.info();
        let theirs = Scale {
            unit_m: info.unit_m,
            base_m: info.base_m,
        };
        if theirs == self.scale {
            return Post {
                quanta,
                kind,
                error_m,
            };
        }
        let height_m = theirs.height_m(quanta);
        let quanta = self.scale.quanta(height_m);
        #[expect(clippy::cast_possible_truncation, reason = "a part of a unit")]
        let rounding = (self.scale.height_m(quanta) - height_m).abs() as f32;
        Post {
            quanta,
            kind,
            error_m: error_m + rounding,
        }
    }
}
