//! One degree cell: the inputs around it put together on the grid, holes filled, water found, heights made quanta.
//!
//! A cell is worked on with a margin of [`MARGIN`] posts of its neighbours, so that a lake or a hole that crosses its edge
//! is seen from both sides. A lake that reaches out of the margin has more posts inside than water needs, so whether an
//! area is large enough comes out the same in every cell it touches.

use crate::terrain::bake_fill::{Window, fill_holes, water};
use crate::terrain::bake_levels::{Block, Post};
use crate::terrain::codec::SurfaceKind;
use crate::terrain::geoid::GeoidGrid;
use crate::terrain::grid::Grid;
use crate::terrain::pack::PostRect;
use crate::terrain::placement::Placement;
use crate::terrain::raster::Raster;
use crate::terrain::store::Scale;
use crate::units::Radians;

/// Posts of the neighbours that are looked at around a cell; at least [`crate::terrain::bake_fill::WATER_POSTS_MIN`].
pub const MARGIN: i32 = 64;

const _: () = assert!(
    MARGIN.cast_unsigned() as usize >= crate::terrain::bake_fill::WATER_POSTS_MIN,
    "an area that leaves the window must be large enough by then"
);

/// An input laid on the grid. `rect` is cut by the region.
#[derive(Debug)]
pub struct Layer<'a> {
    /// Its number among the inputs.
    pub input: usize,
    /// Its samples.
    pub raster: &'a Raster,
    /// How they lie.
    pub placement: Placement,
    /// The posts it gives.
    pub rect: PostRect,
}

/// Two inputs that give one post different heights by more than a unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disagreement {
    /// The input whose height was taken.
    pub taken: usize,
    /// The other.
    pub other: usize,
    /// By how much they differ at most, metres.
    pub difference_m: f32,
    /// Where that is, level-0 column and row.
    pub post: (i32, i32),
    /// At how many posts they do.
    pub posts: u64,
}

/// What all cells share.
#[derive(Debug)]
pub struct Frame<'a> {
    /// The pack's grid.
    pub grid: Grid,
    /// The pack's scale.
    pub scale: Scale,
    /// Undulations to subtract, for inputs above the ellipsoid.
    pub subtract: Option<&'a GeoidGrid>,
}

/// Posts of a window, put together. Columns run on past 180 degrees.
struct Mosaic {
    rect: PostRect,
    window: Window,
    /// Metres; NaN where void or outside.
    heights: Vec<f32>,
    /// The layer that covers a post, and gave its height if it has one.
    layer: Vec<Option<u16>>,
}

impl Frame<'_> {
    /// The posts of the cell whose south-west corner is at (`latitude`, `longitude`) degrees. Layers come in order of
    /// precedence: where several cover a post, the first with a height there gives it.
    #[must_use]
    pub fn cell(
        &self,
        (latitude, longitude): (i32, i32),
        layers: &[Layer<'_>],
    ) -> (Block, Vec<Disagreement>) {
        let posts = self.grid.posts_per_degree.cast_signed();
        let degree = PostRect {
            south: latitude * posts,
            west: longitude * posts,
            north: latitude * posts + posts - 1,
            east: longitude * posts + posts - 1,
        };
        let Some(own) = self.covered(&degree, layers) else {
            return (Block::empty(), Vec::new());
        };
        let mut mosaic = Mosaic::new(PostRect {
            south: own.south - MARGIN,
            west: own.west - MARGIN,
            north: own.north + MARGIN,
            east: own.east + MARGIN,
        });
        let mut disagreements = Vec::new();
        for (number, layer) in layers.iter().enumerate() {
            let Ok(number) = u16::try_from(number) else {
                break;
            };
            for turn in [-1, 0, 1] {
                let shift = turn * self.grid.posts_around();
                mosaic.lay(number, layers, layer, shift, |post, difference_m, taken| {
                    // Once for each post, by the cell that owns it, and only for differences that the pack can show.
                    let owned = (own.south..=own.north).contains(&post.1)
                        && (own.west..=own.east).contains(&post.0);
                    if owned && f64::from(difference_m) > self.scale.unit_m {
                        disagree(&mut disagreements, taken, layer.input, difference_m, post);
                    }
                });
            }
        }
        if let Some(geoid) = self.subtract {
            mosaic.subtract(self.grid, geoid);
        }
        (self.finish(&own, mosaic), disagreements)
    }

    /// The part of a cell that the layers cover: many cells have only the shared edge of a neighbour.
    fn covered(&self, cell: &PostRect, layers: &[Layer<'_>]) -> Option<PostRect> {
        let around = self.grid.posts_around();
        let parts = layers.iter().flat_map(|l| {
            [-around, 0, around].map(|shift| cell.intersection(&l.rect.shifted(shift)))
        });
        PostRect::around(parts.flatten())
    }

    /// Fills, finds water, and takes the cell out of its window.
    fn finish(&self, own: &PostRect, mut mosaic: Mosaic) -> Block {
        let source = mosaic.heights.clone();
        let hole: Vec<bool> = std::iter::zip(&mosaic.layer, &mosaic.heights)
            .map(|(layer, h)| layer.is_some() && h.is_nan())
            .collect();
        fill_holes(&mosaic.window, &mut mosaic.heights, &hole, 0.0);
        let measured: Vec<Option<u16>> = source
            .iter()
            .map(|h| (!h.is_nan()).then(|| self.scale.quanta(f64::from(*h))))
            .collect();
        let water = water(&mosaic.window, &measured);
        let columns = mosaic.window.columns;
        let margin = MARGIN.cast_unsigned() as usize;
        let width = (own.east - own.west + 1).cast_unsigned() as usize;
        let height = (own.north - own.south + 1).cast_unsigned() as usize;
        let mut posts = Vec::with_capacity(width * height);
        for row in margin..margin + height {
            for at in row * columns + margin..row * columns + margin + width {
                posts.push(mosaic.layer[at].map(|_| {
                    let quanta = self.scale.quanta(f64::from(mosaic.heights[at]));
                    let kind = match (hole[at], water[at]) {
                        (true, _) => SurfaceKind::Void,
                        (false, true) => SurfaceKind::Water,
                        (false, false) => SurfaceKind::Land,
                    };
                    let error_m = if hole[at] {
                        0.0
                    } else {
                        self.error_m(source[at], quanta)
                    };
                    Post {
                        quanta,
                        kind,
                        error_m,
                    }
                }));
            }
        }
        Block {
            south: own.south,
            west: own.west,
            columns: width,
            posts,
        }
    }

    fn error_m(&self, source: f32, quanta: u16) -> f32 {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "an error is a fraction of a metre"
        )]
        {
            (self.scale.height_m(quanta) - f64::from(source)).abs() as f32
        }
    }
}

fn disagree(
    all: &mut Vec<Disagreement>,
    taken: usize,
    other: usize,
    difference_m: f32,
    post: (i32, i32),
) {
    match all
        .iter_mut()
        .find(|d| d.taken == taken && d.other == other)
    {
        Some(d) => d.add(difference_m, post, 1),
        None => all.push(Disagreement {
            taken,
            other,
            difference_m,
            post,
            posts: 1,
        }),
    }
}

impl Disagreement {
    /// Adds what another cell found between the same inputs.
    pub fn add(&mut self, difference_m: f32, post: (i32, i32), posts: u64) {
        self.posts += posts;
        if difference_m > self.difference_m {
            self.difference_m = difference_m;
            self.post = post;
        }
    }
}

impl Mosaic {
    fn new(rect: PostRect) -> Self {
        let columns = (rect.east - rect.west + 1).cast_unsigned() as usize;
        let rows = (rect.north - rect.south + 1).cast_unsigned() as usize;
        Self {
            rect,
            window: Window { columns, rows },
            heights: vec![f32::NAN; columns * rows],
            layer: vec![None; columns * rows],
        }
    }

    /// Lays a layer, moved east by `shift` posts, under what is there. Calls `differ` with the post, the difference and
    /// the input already there, for posts that both give without interpolation.
    fn lay(
        &mut self,
        number: u16,
        layers: &[Layer<'_>],
        layer: &Layer<'_>,
        shift: i32,
        mut differ: impl FnMut((i32, i32), f32, usize),
    ) {
        let Some(PostRect {
            south,
            west,
            north,
            east,
        }) = self.rect.intersection(&layer.rect.shifted(shift))
        else {
            return;
        };
        let mut spots = Vec::new();
        for j in south..=north {
            let columns = west - shift..=east - shift;
            layer.placement.spots(j, columns, &mut spots);
            let start = (j - self.rect.south).cast_unsigned() as usize * self.window.columns
                + (west - self.rect.west).cast_unsigned() as usize;
            for (i, (spot, at)) in (west..).zip(spots.iter().zip(start..)) {
                let Some(spot) = *spot else { continue };
                let height = layer.raster.height_m(spot);
                let there = self.heights[at];
                match (height, self.layer[at]) {
                    (Some(h), Some(first)) if !there.is_nan() => {
                        let first = &layers[usize::from(first)];
                        if first.placement.is_copy() && layer.placement.is_copy() {
                            differ((i, j), (h - there).abs(), first.input);
                        }
                    }
                    (Some(h), _) => {
                        self.heights[at] = h;
                        self.layer[at] = Some(number);
                    }
                    (None, None) => self.layer[at] = Some(number),
                    (None, Some(_)) => {}
                }
            }
        }
    }

    /// From heights above the ellipsoid to heights above the geoid.
    fn subtract(&mut self, grid: Grid, geoid: &GeoidGrid) {
        for (row, j) in (self.rect.south..=self.rect.north).enumerate() {
            let latitude = Radians::from_degrees(grid.latitude_deg(0, j));
            let start = row * self.window.columns;
            let line = &mut self.heights[start..start + self.window.columns];
            for (h, i) in line
                .iter_mut()
                .zip(self.rect.west..)
                .filter(|(h, _)| !h.is_nan())
            {
                let longitude = Radians::from_degrees(grid.longitude_deg(0, i));
                // The geoid covers every post with a height; a post it did not cover would have to be a void.
                let n = geoid.undulation_m(latitude, longitude).unwrap_or(f64::NAN);
                #[expect(
                    clippy::cast_possible_truncation,
                    reason = "a height to f32's tenth of a millimetre"
                )]
                {
                    *h = (f64::from(*h) - n) as f32;
                }
            }
        }
    }
}
