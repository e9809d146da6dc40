//! What a bake will do, from one look at every input: where they lie, the grid and the scale that suit them all.

use crate::terrain::bake::{BakeError, Heights, Job};
use crate::terrain::bake_cell::MARGIN;
use crate::terrain::grid::{Grid, POSTS_PER_DEGREE};
use crate::terrain::input;
use crate::terrain::pack::{Bounds, PostRect, SourceInfo};
use crate::terrain::placement::Placement;
use crate::terrain::raster::{Contents, Geometry};
use crate::terrain::store::Scale;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

/// How many times finer than the grid an input may be, so that "about 1 arc second" takes the 1" grid.
const FINER_BY: f64 = 1.1;

/// A bake of more posts than this is refused if that is over [`POSTS_PER_SAMPLE_MAX`] times what was measured: interpolation
/// of a coarse file of the whole Earth to the spacing of one fine tile would run for days.
const POSTS_FREE: u64 = 2_000_000_000;
const POSTS_PER_SAMPLE_MAX: u64 = 100;

/// What all parts of a bake share.
pub(crate) struct Plan {
    pub(crate) grid: Grid,
    pub(crate) scale: Scale,
    /// In order of precedence.
    pub(crate) inputs: Vec<Input>,
}

/// An input as learnt in the first pass.
pub(crate) struct Input {
    pub(crate) path: PathBuf,
    /// Where it was said to lie.
    pub(crate) place: Option<Bounds>,
    pub(crate) geometry: Geometry,
    pub(crate) contents: Contents,
    pub(crate) placement: Placement,
    /// The posts that it gives.
    pub(crate) rect: PostRect,
}

/// Reads every input once; chooses grid and scale.
pub(crate) fn survey(job: &Job<'_>) -> Result<Plan, BakeError> {
    refuse_repeats(job.inputs)?;
    let places = places(job)?;
    let mut read = Vec::new();
    for (path, place) in job.inputs.iter().zip(places) {
        if job.stop.load(Ordering::Relaxed) {
            return Err(BakeError::Stopped);
        }
        let raster = input::read(path, job.plain, place.as_ref())
            .map_err(|e| BakeError::Input(path.clone(), e))?;
        read.push(((path.clone(), place), raster.geometry, raster.contents()));
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
        .map(|((path, place), geometry, contents)| {
            let placement = Placement::new(&geometry, grid);
            Input {
                path,
                place,
                geometry,
                contents,
                placement,
                rect: placement.rect(grid),
            }
        })
        .collect();
    inputs.sort_by(Input::precedence);
    let region = job.region.as_ref().and_then(|r| posts_of(grid, r));
    refuse_thin_air(grid, &inputs, region.as_ref())?;
    Ok(Plan {
        grid,
        scale: scale(&inputs, job.heights),
        inputs,
    })
}

/// The grid's spacing for inputs of at most this many samples per degree.
fn posts_per_degree(finest: f64) -> u32 {
    let [.., densest] = POSTS_PER_DEGREE;
    POSTS_PER_DEGREE
        .into_iter()
        .find(|p| f64::from(*p) * FINER_BY >= finest)
        .unwrap_or(densest)
}

/// A region as posts; `None` if it has fewer than two in either direction.
pub(crate) fn posts_of(grid: Grid, region: &Bounds) -> Option<PostRect> {
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
    (region.south < region.north && region.west < region.east).then_some(region)
}

/// The posts that are looked at for a rectangle of posts: the degree cells that it lies in, and a margin.
pub(crate) fn looked_at(grid: Grid, rect: &PostRect) -> PostRect {
    let posts = grid.posts_per_degree.cast_signed();
    let down = |at: i32| at.div_euclid(posts) * posts - MARGIN;
    let up = |at: i32| (at.div_euclid(posts) + 1) * posts + MARGIN;
    PostRect {
        south: down(rect.south).max(-grid.row_max()),
        west: down(rect.west),
        north: up(rect.north).min(grid.row_max()),
        east: up(rect.east),
    }
}

/// What an input has for a region: the posts that it gives there, and whether it lies near enough to be looked at.
pub(crate) struct Share {
    pub(crate) own: Option<PostRect>,
    pub(crate) is_near: bool,
}

impl Plan {
    /// What each input has for a region; everything if there is none. An input whose posts end just outside is looked at
    /// all the same, so that lakes and voids at the region's edge come out as they would without it.
    pub(crate) fn shares(&self, region: Option<&PostRect>) -> Vec<Share> {
        let Some(region) = region else {
            return self
                .inputs
                .iter()
                .map(|i| Share {
                    own: Some(i.rect),
                    is_near: true,
                })
                .collect();
        };
        let around = looked_at(self.grid, region);
        let turn = self.grid.posts_around();
        self.inputs
            .iter()
            .map(|input| {
                let within = |place: &PostRect, shifts: &[i32]| {
                    shifts
                        .iter()
                        .find_map(|shift| input.rect.shifted(*shift).intersection(place))
                };
                Share {
                    own: within(region, &[0, -turn]),
                    is_near: within(&around, &[0, -turn, turn]).is_some(),
                }
            })
            .collect()
    }
}

impl Input {
    fn name(&self) -> String {
        let name = self.path.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    }

    /// What the pack says of it, for the posts that it gives.
    pub(crate) fn source(&self, own: PostRect) -> SourceInfo {
        SourceInfo {
            name: self.name(),
            rect: own,
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

/// Refuses a bake of very many posts most of which would be interpolated.
fn refuse_thin_air(
    grid: Grid,
    inputs: &[Input],
    region: Option<&PostRect>,
) -> Result<(), BakeError> {
    let turn = grid.posts_around();
    let posts = |i: &Input| {
        let rect = match region {
            Some(region) => [0, -turn]
                .into_iter()
                .find_map(|shift| i.rect.shifted(shift).intersection(region)),
            None => Some(i.rect),
        };
        let side = |from: i32, to: i32| u64::from(to.abs_diff(from)) + 1;
        rect.map_or(0, |r| side(r.west, r.east) * side(r.south, r.north))
    };
    let Some(widest) = inputs.iter().max_by_key(|i| posts(i)) else {
        return Ok(());
    };
    let samples = |i: &Input| (i.geometry.columns as u64).saturating_mul(i.geometry.rows as u64);
    let (wanted, measured) = (posts(widest), samples(widest));
    if wanted > POSTS_FREE && wanted / measured.max(1) > POSTS_PER_SAMPLE_MAX {
        return Err(BakeError::ThinAir {
            coarse: widest.path.clone(),
            posts: wanted,
            samples: measured,
            posts_per_degree: grid.posts_per_degree,
        });
    }
    Ok(())
}

/// Where each input was said to lie: the plain grids among them take the given places in turn. None is given where all of
/// them say it themselves.
fn places(job: &Job<'_>) -> Result<Vec<Option<Bounds>>, BakeError> {
    let is_plain: Vec<bool> = job
        .inputs
        .iter()
        .map(|p| input::plain_kind(p).is_some())
        .collect();
    let files = is_plain.iter().filter(|p| **p).count();
    let given = job.plain.bounds.len();
    if given != 0 && given != files {
        return Err(BakeError::Places {
            files,
            places: given,
        });
    }
    let mut next = job.plain.bounds.iter();
    Ok(is_plain
        .into_iter()
        .map(|plain| plain.then(|| next.next().copied()).flatten())
        .collect())
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
