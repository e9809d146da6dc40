//! One degree cell: the inputs around it put together on the grid, holes filled, water found, heights made quanta.
//!
//! A cell is worked on with a margin of [`MARGIN`] posts of its neighbours, so that a lake or a hole that crosses its edge
//! is seen from both sides. A lake that reaches out of the margin has more posts inside than water needs, so whether an
//! area is large enough comes out the same in every cell it touches.

use crate::terrain::bake_fill::water;
use crate::terrain::bake_levels::{Block, Post};
use crate::terrain::bake_mosaic::{Mosaic, disagree};
use crate::terrain::bake_plate;
use crate::terrain::codec::SurfaceKind;
use crate::terrain::geoid::GeoidGrid;
use crate::terrain::grid::Grid;
use crate::terrain::pack::PostRect;
use crate::terrain::placement::Placement;
use crate::terrain::raster::Raster;
use crate::terrain::store::Scale;

/// Posts of the neighbours that are looked at around a cell; at least [`crate::terrain::bake_fill::WATER_POSTS_MIN`].
pub const MARGIN: i32 = 64;

const _: () = assert!(
    MARGIN.cast_unsigned() as usize >= crate::terrain::bake_fill::WATER_POSTS_MIN,
    "an area that leaves the window must be large enough by then"
);

/// An input laid on the grid.
#[derive(Debug)]
pub struct Layer<'a> {
    /// Its number among the inputs.
    pub input: usize,
    /// Its samples.
    pub raster: &'a Raster,
    /// How they lie.
    pub placement: Placement,
    /// The posts it has.
    pub rect: PostRect,
    /// Those of them that it gives: the others lie outside the region and are only looked at.
    pub own: Option<PostRect>,
    /// Voids that are the margin of its raster and not in it ([`Raster::margin`]).
    pub margin: Option<&'a [bool]>,
}

/// Two inputs that give the same posts different heights: by more than a unit where both were measured there.
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

impl Frame<'_> {
    /// The posts of the `cell` by its south-west corner, degrees of latitude and longitude. Layers come in order of
    /// precedence: where several cover a post, the first with a height there gives it.
    #[must_use]
    pub fn cell(&self, cell: (i32, i32), layers: &[Layer<'_>]) -> (Block, Vec<Disagreement>) {
        let degree = self.grid.degree(cell);
        let own = self.covered(&degree, layers.iter().filter_map(|l| l.own));
        // The window does not depend on the region, so that neither do lakes and filled voids.
        let window = self.covered(&degree, layers.iter().map(|l| l.rect));
        let (Some(own), Some(window)) = (own, window) else {
            return (Block::empty(), Vec::new());
        };
        let mut mosaic = Mosaic::new(PostRect {
            south: window.south - MARGIN,
            west: window.west - MARGIN,
            north: window.north + MARGIN,
            east: window.east + MARGIN,
        });
        let mut disagreements = Vec::new();
        for (number, layer) in (0..u16::MAX).zip(layers) {
            for turn in [-1, 0, 1] {
                let shift = turn * self.grid.posts_around();
                mosaic.lay(
                    number,
                    layers,
                    shift,
                    self.scale,
                    |post, difference_m, taken| {
                        // Once for each post, by the cell that owns it.
                        let owned = (own.south..=own.north).contains(&post.1)
                            && (own.west..=own.east).contains(&post.0);
                        if owned {
                            disagree(&mut disagreements, (taken, layer.input), difference_m, post);
                        }
                    },
                );
            }
        }
        if let Some(geoid) = self.subtract {
            mosaic.subtract(self.grid, geoid);
        }
        (self.finish(&own, mosaic, layers), disagreements)
    }

    /// The part of a cell that rectangles cover: many cells have only the shared edge of a neighbour.
    fn covered(&self, cell: &PostRect, rects: impl Iterator<Item = PostRect>) -> Option<PostRect> {
        let around = self.grid.posts_around();
        let parts = rects.flat_map(|rect| {
            [-around, 0, around].map(|shift| cell.intersection(&rect.shifted(shift)))
        });
        PostRect::around(parts.flatten())
    }

    /// Fills, finds water, and takes the cell out of its window.
    fn finish(&self, own: &PostRect, mut mosaic: Mosaic, layers: &[Layer<'_>]) -> Block {
        let source = mosaic.heights.clone();
        let hole: Vec<bool> = std::iter::zip(&mosaic.layer, &mosaic.heights)
            .map(|(layer, h)| layer.is_some() && h.is_nan())
            .collect();
        let void: Vec<bool> = (0..hole.len())
            .map(|at| mosaic.is_void(at, layers))
            .collect();
        let middle = (mosaic.rect.south + mosaic.rect.north).div_euclid(2);
        let latitude_deg = self.grid.latitude_deg(0, middle);
        // Beside a pole a row is a point: nothing is gained by taking it for one.
        let aspect = latitude_deg.to_radians().cos().max(0.1);
        bake_plate::fill(&mosaic.window, aspect, &mut mosaic.heights, &hole, 0.0);
        let measured: Vec<Option<u16>> = source
            .iter()
            .map(|h| (!h.is_nan()).then(|| self.scale.quanta(f64::from(*h))))
            .collect();
        let water = water(&mosaic.window, &measured);
        let columns = mosaic.window.columns;
        let south = (own.south - mosaic.rect.south).cast_unsigned() as usize;
        let west = (own.west - mosaic.rect.west).cast_unsigned() as usize;
        let width = (own.east - own.west + 1).cast_unsigned() as usize;
        let height = (own.north - own.south + 1).cast_unsigned() as usize;
        let mut posts = Vec::with_capacity(width * height);
        for row in south..south + height {
            for at in row * columns + west..row * columns + west + width {
                posts.push(mosaic.layer[at].map(|_| {
                    let quanta = self.scale.quanta(f64::from(mosaic.heights[at]));
                    let kind = match (void[at], water[at]) {
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
