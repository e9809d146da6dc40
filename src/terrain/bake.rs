//! Bakes elevation files to a pack.
//!
//! The inputs are read once to learn where they lie and what they hold; that decides the grid (the coarsest of
//! [`POSTS_PER_DEGREE`] that is not coarser than the finest input, a tenth of tolerance allowed) and the scale (see
//! [`crate::terrain::bake_plan`]). Then degree cell after degree cell is put together ([`crate::terrain::bake_cell`]) and scattered to the
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
use crate::terrain::bake_parts;
use crate::terrain::bake_plan::{Input, Plan, Share, looked_at, posts_of, survey};
use crate::terrain::geoid::GeoidGrid;
use crate::terrain::grid::Grid;
use crate::terrain::input::{self, InputError};
use crate::terrain::join::JoinError;
use crate::terrain::pack::{Bounds, PackInfo, PostRect, SourceInfo};
use crate::terrain::partition::Partition;
use crate::terrain::plain::PlainGrids;
use crate::terrain::raster::Raster;
use std::io;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Decoded inputs kept in memory, bytes: 170 tiles of 3" or 20 of 1".
const CACHE_BYTES: usize = 512 << 20;

/// A pack gets a cap when an input reaches beyond this latitude, degrees north or south: the seam is at 70, and who flies
/// north of it sees what lies south of it.
const CAP_FROM_DEG: i32 = 69;

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
    /// How those that are plain grids are to be read.
    pub plain: &'a PlainGrids,
    /// The pack to write.
    pub out: &'a Path,
    /// What the inputs' heights refer to.
    pub heights: Heights,
    /// The part of them to take; all if `None`.
    pub region: Option<Bounds>,
    /// A folder for finished parts, from which an interrupted bake goes on.
    pub parts: Option<&'a Path>,
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

impl Seam {
    /// A disagreement whose inputs are known by number; `path` gives their names.
    pub(crate) fn of<'a>(
        d: &Disagreement,
        grid: Grid,
        path: impl Fn(usize) -> &'a PathBuf,
    ) -> Self {
        Self {
            taken: path(d.taken).clone(),
            other: path(d.other).clone(),
            difference_m: d.difference_m,
            latitude_deg: grid.latitude_deg(0, d.post.1),
            longitude_deg: grid.longitude_deg(0, d.post.0),
            posts: d.posts,
        }
    }
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
    /// There are more places given than plain grids, or fewer.
    #[error("it is given {places} times, and {files} of the files are plain grids")]
    Places {
        /// Files that do not say where they lie.
        files: usize,
        /// Places that the user gave.
        places: usize,
    },
    /// A coarse input would be interpolated to far more posts than it has samples.
    #[error(
        "its {samples} samples would become {posts} posts at the {} arc seconds of the finest file",
        3600.0 / f64::from(*.posts_per_degree)
    )]
    ThinAir {
        /// The coarse input.
        coarse: PathBuf,
        /// The posts it would be baked to.
        posts: u64,
        /// The samples it has.
        samples: u64,
        /// The grid's.
        posts_per_degree: u32,
    },
    /// No input has posts in the region.
    #[error("no input has posts in the region")]
    NothingInRegion,
    /// The parts cannot be joined.
    #[error("the parts cannot be joined")]
    Parts(#[source] JoinError),
    /// The folder for parts holds something else.
    #[error("holds something else than the parts of this bake")]
    OtherParts(PathBuf),
    /// The pack cannot be written.
    #[error("{}", .0.display())]
    Output(PathBuf, #[source] io::Error),
    /// Stopped from outside.
    #[error("stopped before it was done")]
    Stopped,
}

/// Bakes. `progress` is called with the cells done and their number; then the same for the tiles of each further step: the
/// coarse levels, their errors, each cap and its levels.
///
/// # Errors
/// See [`BakeError`]; whatever happens, `out` is either the old file or a whole pack.
pub fn bake(job: &Job<'_>, progress: &mut dyn FnMut(usize, usize)) -> Result<Report, BakeError> {
    let plan = survey(job)?;
    let region = match job.region {
        Some(region) => Some(posts_of(plan.grid, &region).ok_or(BakeError::NothingInRegion)?),
        None => None,
    };
    match job.parts {
        Some(folder) => bake_parts::bake(job, &plan, region, folder, progress),
        None => bake_region(job, &plan, region, job.out, progress),
    }
}

/// Bakes the part of a plan that lies in a region to `out`.
pub(crate) fn bake_region(
    job: &Job<'_>,
    plan: &Plan,
    region: Option<PostRect>,
    out: &Path,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Report, BakeError> {
    let (grid, scale, inputs) = (plan.grid, plan.scale, &plan.inputs);
    let shares = plan.shares(region.as_ref());
    let rects: Vec<PostRect> = shares.iter().filter_map(|s| s.own).collect();
    if rects.is_empty() {
        return Err(BakeError::NothingInRegion);
    }
    let geoid = GeoidGrid::over(grid, &rects, job.jobs);
    let wide: Vec<PostRect> = rects.iter().map(|r| looked_at(grid, r)).collect();
    let wide = GeoidGrid::over(grid, &wide, job.jobs);
    let frame = Frame {
        grid,
        scale,
        subtract: (job.heights == Heights::Ellipsoidal).then_some(&wide),
    };
    let failed = |e| BakeError::Output(out.to_owned(), e);
    let mut levels = Levels::create(out, grid, scale, job.jobs).map_err(failed)?;
    let mut cache = Cache::new(inputs.len());
    let mut found = Vec::new();
    let cells = cells(grid, &rects);
    for (done, &cell) in cells.iter().enumerate() {
        progress(done, cells.len());
        if job.stop.load(Ordering::Relaxed) {
            return Err(BakeError::Stopped);
        }
        let wanted = around(grid, cell, (inputs, &shares));
        let rasters = cache.load(job.plain, inputs, &wanted)?;
        let layers: Vec<Layer<'_>> = std::iter::zip(&wanted, &rasters)
            .map(|(at, loaded)| Layer {
                input: *at,
                raster: &loaded.raster,
                placement: inputs[*at].placement,
                rect: inputs[*at].rect,
                own: shares[*at].own,
                margin: loaded.margin.as_deref(),
            })
            .collect();
        let (block, disagreements) = frame.cell(cell, &layers);
        merge(&mut found, disagreements);
        levels
            .lay(&block, cell, cells.get(done + 1))
            .map_err(failed)?;
    }
    progress(cells.len(), cells.len());
    let sources = std::iter::zip(inputs, &shares).filter_map(|(i, s)| Some(i.source(s.own?)));
    let sources: Vec<SourceInfo> = sources.collect();
    let info = finish(
        levels,
        &rects,
        (&geoid, &sources),
        (job.jobs, job.stop),
        progress,
    )
    .map_err(|e| e.map_or(BakeError::Stopped, failed))?;
    let seams = found
        .iter()
        .map(|d| Seam::of(d, grid, |at| &inputs[at].path))
        .collect();
    Ok(Report { info, seams })
}

/// Makes the caps that `rects` reach into, and the coarse levels, and completes the pack; `None` as an error if it was told
/// to stop.
pub(crate) fn finish(
    mut levels: Levels,
    rects: &[PostRect],
    (geoid, sources): (&GeoidGrid, &[SourceInfo]),
    (jobs, stop): (usize, &AtomicBool),
    progress: &mut dyn FnMut(usize, usize),
) -> Result<PackInfo, Option<io::Error>> {
    let mut proceed = |done, all| {
        progress(done, all);
        !stop.load(Ordering::Relaxed)
    };
    let failed = |e| (!stop.load(Ordering::Relaxed)).then_some(e);
    let (grid, scale) = levels.frame();
    for cap in caps(grid, rects) {
        bake_cap::add(&mut levels, (grid, scale), cap, jobs, &mut proceed).map_err(failed)?;
    }
    levels.finish(geoid, sources, &mut proceed).map_err(failed)
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

/// The inputs that a cell and its margin touch, in order of precedence.
fn around(
    grid: Grid,
    (latitude, longitude): (i32, i32),
    (inputs, shares): (&[Input], &[Share]),
) -> Vec<usize> {
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
    let numbered = std::iter::zip(inputs, shares).enumerate();
    numbered
        .filter_map(|(at, (input, share))| (share.is_near && touches(&input.rect)).then_some(at))
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

    fn load(
        &mut self,
        plain: &PlainGrids,
        inputs: &[Input],
        wanted: &[usize],
    ) -> Result<Vec<Rc<Loaded>>, BakeError> {
        let mut loaded = Vec::with_capacity(wanted.len());
        for &at in wanted {
            self.order.retain(|o| *o != at);
            self.order.push(at);
            let raster = match &self.rasters[at] {
                Some(raster) => Rc::clone(raster),
                None => {
                    let input = &inputs[at];
                    let failed = |e| BakeError::Input(input.path.clone(), e);
                    let raster =
                        input::read(&input.path, plain, input.place.as_ref()).map_err(failed)?;
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
