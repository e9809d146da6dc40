//! Bakes elevation files to a pack.
//!
//! The inputs are read once to learn where they lie and what they hold; that decides the grid (the coarsest of
//! [`POSTS_PER_DEGREE`] that is not coarser than the finest input, a tenth of tolerance allowed) and the scale (see
//! `scale`). Then degree cell after degree cell is put together ([`crate::terrain::bake_cell`]) and scattered to the
//! tiles of all levels ([`crate::terrain::bake_levels`]). Where inputs reach beyond 69 degrees of latitude, the posts of
//! that pole's cap are made from the finished ones ([`crate::terrain::bake_cap`]).
//!
//! A sample that stands on a post is copied; posts between samples are interpolated bilinearly. Where several inputs
//! have a height at a post, the finest gives it, then the southernmost, then the westernmost, then by name: the pack does
//! not depend on the order of the arguments, nor on the number of threads. Where a coarser input goes on or fills a void it
//! is bent to meet the finer one ([`crate::terrain::bake_mosaic`]); voids that no input fills are filled as a thin plate
//! would bend across them ([`crate::terrain::bake_plate`]).
//!
//! Memory: inputs up to `CACHE_BYTES` (or those around one cell, if they are larger), one cell with its margin (about
//! 60 bytes a post) and the tiles still open.

use crate::terrain::bake_cap;
use crate::terrain::bake_cell::{Disagreement, Frame, Layer, MARGIN};
use crate::terrain::bake_levels::{Levels, cells};
use crate::terrain::geoid::GeoidGrid;
use crate::terrain::grid::{Grid, POSTS_PER_DEGREE};
use crate::terrain::input::{self, InputError};
use crate::terrain::pack::{Bounds, PackInfo, PostRect, SourceInfo};
use crate::terrain::partition::Partition;
use crate::terrain::placement::Placement;
use crate::terrain::raster::{Contents, Geometry, Raster};
use crate::terrain::store::Scale;
use std::io;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Decoded inputs kept in memory, bytes: 170 tiles of 3" or 20 of 1".
const CACHE_BYTES: usize = 512 << 20;

/// A pack gets a cap when an input reaches beyond this latitude, degrees north or south: the seam is at 70, and who flies
/// north of it sees what lies south of it.
const CAP_FROM_DEG: i32 = 69;

/// How many times finer than the grid an input may be, so that "about 1 arc second" takes the 1" grid.
const FINER_BY: f64 = 1.1;

/// What the inputs' heights refer to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heights {
    /// The EGM96 geoid, as SRTM's: stored as they are.
    Egm96,
    /// The WGS 84 ellipsoid: the undulation is subtracted.
    Ellipsoidal,
}

/// What to bake.
#[derive(Debug)]
pub struct Job<'a> {
    /// Elevation files.
    pub inputs: &'a [PathBuf],
    /// The pack to write.
    pub out: &'a Path,
    /// What the inputs' heights refer to.
    pub heights: Heights,
    /// The part of them to take; all if `None`.
    pub region: Option<Bounds>,
    /// Threads; at least 1.
    pub jobs: usize,
    /// Set from elsewhere to stop.
    pub stop: &'a AtomicBool,
}

/// What came of it.
#[derive(Debug)]
pub struct Report {
    /// The pack.
    pub info: PackInfo,
    /// Inputs that disagree about the posts they share.
    pub seams: Vec<Seam>,
}

/// Two inputs that disagree about the posts they share: by more than a unit where both were measured there, by more than 16 m
/// for each time that one is coarser than the other elsewhere.
#[derive(Clone, Debug, PartialEq)]
pub struct Seam {
    /// The input whose heights were taken.
    pub taken: PathBuf,
    /// The other.
    pub other: PathBuf,
    /// The largest difference, metres.
    pub difference_m: f32,
    /// Where it is, degrees north.
    pub latitude_deg: f64,
    /// Where it is, degrees east.
    pub longitude_deg: f64,
    /// At how many posts they differ.
    pub posts: u64,
}

/// Why a bake ended without a pack.
#[derive(Debug, thiserror::Error)]
pub enum BakeError {
    /// An input cannot be used.
    #[error("{}", .0.display())]
    Input(PathBuf, #[source] InputError),
    /// An input is given twice.
    #[error("is given twice")]
    Twice(PathBuf),
    /// No input has posts in the region.
    #[error("no input has posts in the region")]
    NothingInRegion,
    /// The pack cannot be written.
    #[error("{}", .0.display())]
    Output(PathBuf, #[source] io::Error),
    /// Stopped from outside.
    #[error("stopped before it was done")]
    Stopped,
}

/// An input as learnt in the first pass.
struct Input {
    path: PathBuf,
    geometry: Geometry,
    contents: Contents,
    placement: Placement,
    rect: PostRect,
}

/// Bakes. `progress` is called with the cells done and their number; then the same for the tiles of each further step: the
/// coarse levels, their errors, each cap and its levels.
///
/// # Errors
/// See [`BakeError`]; whatever happens, `out` is either the old file or a whole pack.
pub fn bake(job: &Job<'_>, progress: &mut dyn FnMut(usize, usize)) -> Result<Report, BakeError> {
    let (grid, inputs) = survey(job)?;
    let scale = scale(&inputs, job.heights);
    let rects: Vec<PostRect> = inputs.iter().map(|i| i.rect).collect();
    let geoid = GeoidGrid::over(grid, &rects, job.jobs);
    let frame = Frame {
        grid,
        scale,
        subtract: (job.heights == Heights::Ellipsoidal).then_some(&geoid),
    };
    let failed = |e| BakeError::Output(job.out.to_owned(), e);
    let mut levels = Levels::create(job.out, grid, scale, job.jobs).map_err(failed)?;
    let mut cache = Cache::new(inputs.len());
    let mut found = Vec::new();
    let posts = grid.posts_per_degree.cast_signed();
    let cells = cells(grid, &rects);
    for (done, &(latitude, longitude)) in cells.iter().enumerate() {
        progress(done, cells.len());
        if job.stop.load(Ordering::Relaxed) {
            return Err(BakeError::Stopped);
        }
        let wanted = around(grid, (latitude, longitude), &rects);
        let rasters = cache.load(&inputs, &wanted)?;
        let layers: Vec<Layer<'_>> = std::iter::zip(&wanted, &rasters)
            .map(|(at, loaded)| Layer {
                input: *at,
                raster: &loaded.raster,
                placement: inputs[*at].placement,
                rect: inputs[*at].rect,
                margin: loaded.margin.as_deref(),
            })
            .collect();
        let (block, disagreements) = frame.cell((latitude, longitude), &layers);
        merge(&mut found, disagreements);
        levels.scatter(&block);
        let row_ends = cells.get(done + 1).is_none_or(|next| next.0 != latitude);
        let east = (!row_ends).then_some((longitude + 1) * posts);
        levels.flush((latitude + 1) * posts, east).map_err(failed)?;
    }
    progress(cells.len(), cells.len());
    let sources: Vec<SourceInfo> = inputs.iter().map(Input::source).collect();
    let mut proceed = |done, all| {
        progress(done, all);
        !job.stop.load(Ordering::Relaxed)
    };
    let failed = |e| match job.stop.load(Ordering::Relaxed) {
        true => BakeError::Stopped,
        false => failed(e),
    };
    for cap in caps(grid, &rects) {
        bake_cap::add(&mut levels, (grid, scale), cap, job.jobs, &mut proceed).map_err(failed)?;
    }
    let info = levels
        .finish(&geoid, &sources, &mut proceed)
        .map_err(failed)?;
    let seams = found.iter().map(|d| seam(grid, &inputs, d)).collect();
    Ok(Report { info, seams })
}

/// The caps that inputs reach into.
fn caps(grid: Grid, rects: &[PostRect]) -> impl Iterator<Item = Partition> + '_ {
    let from = CAP_FROM_DEG * grid.posts_per_degree.cast_signed();
    [Partition::North, Partition::South]
        .into_iter()
        .filter(move |cap| {
            rects.iter().any(|r| match cap {
                Partition::South => r.south < -from,
                Partition::North | Partition::Geographic => r.north > from,
            })
        })
}

/// Reads every input once; chooses the grid; refuses what cannot be put together.
fn survey(job: &Job<'_>) -> Result<(Grid, Vec<Input>), BakeError> {
    refuse_repeats(job.inputs)?;
    let mut read = Vec::new();
    for path in job.inputs {
        if job.stop.load(Ordering::Relaxed) {
            return Err(BakeError::Stopped);
        }
        let raster = input::read(path).map_err(|e| BakeError::Input(path.clone(), e))?;
        read.push((path.clone(), raster.geometry, raster.contents()));
    }
    let finest = read
        .iter()
        .map(|(_, g, _)| g.samples_per_degree())
        .fold(0.0, f64::max);
    let grid = Grid {
        posts_per_degree: posts_per_degree(finest),
    };
    let mut inputs: Vec<Input> = read
        .into_iter()
        .filter_map(|(path, geometry, contents)| {
            let placement = Placement::new(&geometry, grid);
            let rect = match job.region {
                Some(region) => cut(grid, &placement.rect(grid), &region)?,
                None => placement.rect(grid),
            };
            Some(Input {
                path,
                geometry,
                contents,
                placement,
                rect,
            })
        })
        .collect();
    if inputs.is_empty() {
        return Err(BakeError::NothingInRegion);
    }
    inputs.sort_by(Input::precedence);
    Ok((grid, inputs))
}

/// The grid's spacing for inputs of at most this many samples per degree.
fn posts_per_degree(finest: f64) -> u32 {
    let [.., densest] = POSTS_PER_DEGREE;
    POSTS_PER_DEGREE
        .into_iter()
        .find(|p| f64::from(*p) * FINER_BY >= finest)
        .unwrap_or(densest)
}

/// The part of a rectangle in a region; `None` if it has fewer than two posts in either direction.
fn cut(grid: Grid, rect: &PostRect, region: &Bounds) -> Option<PostRect> {
    let posts = f64::from(grid.posts_per_degree);
    // A region given in decimals means the post it names.
    const ROUNDING: f64 = 1e-6;
    #[expect(
        clippy::cast_possible_truncation,
        reason = "the region is on Earth, which the command line has checked"
    )]
    let region = PostRect {
        south: (region.south_deg * posts - ROUNDING).ceil() as i32,
        west: (region.west_deg * posts - ROUNDING).ceil() as i32,
        north: (region.north_deg * posts + ROUNDING).floor() as i32,
        east: (region.east_deg * posts + ROUNDING).floor() as i32,
    };
    let around = grid.posts_around();
    [0, -around]
        .into_iter()
        .filter_map(|shift| rect.shifted(shift).intersection(&region))
        .find(|r| r.south < r.north && r.west < r.east)
}

impl Input {
    fn name(&self) -> String {
        let name = self.path.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    }

    fn source(&self) -> SourceInfo {
        SourceInfo {
            name: self.name(),
            rect: self.rect,
        }
    }

    fn precedence(&self, other: &Self) -> std::cmp::Ordering {
        let finer = other
            .geometry
            .samples_per_degree()
            .total_cmp(&self.geometry.samples_per_degree());
        let place = |i: &Self| (i.rect.south, i.rect.west, i.name());
        finer.then_with(|| place(self).cmp(&place(other)))
    }
}

/// The same file twice is a slip of the hand: one of them was meant to be another.
fn refuse_repeats(inputs: &[PathBuf]) -> Result<(), BakeError> {
    let mut names: Vec<PathBuf> = Vec::with_capacity(inputs.len());
    for path in inputs {
        let name = path.canonicalize().unwrap_or_else(|_| path.clone());
        if names.contains(&name) {
            return Err(BakeError::Twice(path.clone()));
        }
        names.push(name);
    }
    Ok(())
}

/// The scale that holds all inputs: whole metres from -1000 m (from -12 000 m where ground is deeper) if every post is a
/// copy of a whole number; else the finest of 1/32 to 1/2 m whose 65 536 steps reach from the lowest to the highest
/// height and include sea level.
fn scale(inputs: &[Input], heights: Heights) -> Scale {
    let range = inputs
        .iter()
        .filter_map(|i| i.contents.range_m)
        .reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
    let (low, high) = range.map_or((0.0, 0.0), |(low, high)| (f64::from(low), f64::from(high)));
    let whole = heights == Heights::Egm96
        && inputs
            .iter()
            .all(|i| !i.contents.fractional && i.placement.is_copy());
    if whole {
        let base_m = if low >= -1000.0 { -1000.0 } else { -12_000.0 };
        return Scale {
            unit_m: 1.0,
            base_m,
        };
    }
    // EGM96 lies between -107 and +86 m.
    let undulation = match heights {
        Heights::Egm96 => 0.0,
        Heights::Ellipsoidal => 110.0,
    };
    let base_m = (low - undulation).floor().min(0.0);
    let span = (high + undulation).max(0.0) - base_m;
    let unit_m = [0.031_25, 0.0625, 0.125, 0.25]
        .into_iter()
        .find(|unit| span / unit <= f64::from(u16::MAX))
        .unwrap_or(0.5);
    Scale { unit_m, base_m }
}

/// The inputs that a cell and its margin touch, in order of precedence.
fn around(grid: Grid, (latitude, longitude): (i32, i32), rects: &[PostRect]) -> Vec<usize> {
    let posts = grid.posts_per_degree.cast_signed();
    let window = PostRect {
        south: latitude * posts - MARGIN,
        west: longitude * posts - MARGIN,
        north: (latitude + 1) * posts + MARGIN,
        east: (longitude + 1) * posts + MARGIN,
    };
    let turns = [-grid.posts_around(), 0, grid.posts_around()];
    let touches = |r: &PostRect| {
        turns
            .iter()
            .any(|t| window.intersection(&r.shifted(*t)).is_some())
    };
    let numbered = rects.iter().enumerate();
    numbered
        .filter_map(|(at, r)| touches(r).then_some(at))
        .collect()
}

/// Decoded inputs, the least recently used dropped first.
struct Cache {
    rasters: Vec<Option<Rc<Loaded>>>,
    /// Oldest first.
    order: Vec<usize>,
}

/// A decoded input.
struct Loaded {
    raster: Raster,
    /// See [`Raster::margin`].
    margin: Option<Vec<bool>>,
}

impl Loaded {
    fn bytes(&self) -> usize {
        self.raster.bytes() + self.margin.as_ref().map_or(0, Vec::len)
    }
}

impl Cache {
    fn new(inputs: usize) -> Self {
        Self {
            rasters: vec![None; inputs],
            order: Vec::new(),
        }
    }

    fn load(&mut self, inputs: &[Input], wanted: &[usize]) -> Result<Vec<Rc<Loaded>>, BakeError> {
        let mut loaded = Vec::with_capacity(wanted.len());
        for &at in wanted {
            self.order.retain(|o| *o != at);
            self.order.push(at);
            let raster = match &self.rasters[at] {
                Some(raster) => Rc::clone(raster),
                None => {
                    let input = &inputs[at];
                    let failed = |e| BakeError::Input(input.path.clone(), e);
                    let raster = input::read(&input.path).map_err(failed)?;
                    if raster.geometry != input.geometry || raster.contents() != input.contents {
                        return Err(failed(InputError::Changed));
                    }
                    let margin = raster.margin();
                    Rc::new(Loaded { raster, margin })
                }
            };
            self.rasters[at] = Some(Rc::clone(&raster));
            loaded.push(raster);
        }
        let bytes =
            |all: &[Option<Rc<Loaded>>]| -> usize { all.iter().flatten().map(|r| r.bytes()).sum() };
        while bytes(&self.rasters) > CACHE_BYTES && self.order.len() > wanted.len() {
            let oldest = self.order.remove(0);
            self.rasters[oldest] = None;
        }
        Ok(loaded)
    }
}

fn merge(all: &mut Vec<Disagreement>, found: Vec<Disagreement>) {
    for d in found {
        match all
            .iter_mut()
            .find(|a| a.taken == d.taken && a.other == d.other)
        {
            Some(a) => a.add(d.difference_m, d.post, d.posts),
            None => all.push(d),
        }
    }
}

fn seam(grid: Grid, inputs: &[Input], d: &Disagreement) -> Seam {
    Seam {
        taken: inputs[d.taken].path.clone(),
        other: inputs[d.other].path.clone(),
        difference_m: d.difference_m,
        latitude_deg: grid.latitude_deg(0, d.post.1),
        longitude_deg: grid.longitude_deg(0, d.post.0),
        posts: d.posts,
    }
}
