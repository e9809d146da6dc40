//! How a raster lies on a grid: which posts it covers, and where each of them lies among its samples. Pure.

use crate::terrain::grid::Grid;
use crate::terrain::pack::PostRect;
use crate::terrain::raster::{Crs, Geometry};
use crate::terrain::utm::Zone;
use crate::units::Radians;
use std::ops::RangeInclusive;

/// A sample this close to a post, in spacings of the finer of the two, stands on it. GeoTIFF writers round the spacing to 9 or more digits, which
/// adds up to a few thousandths over a tile.
pub(super) const ON_POST: f64 = 0.01;

/// Posts of a row between two that are projected; those between lie on the line. A row of posts bends by the square of
/// this times their spacing over eight radii of the Earth: a centimetre at 3", a metre at 30".
const PROJECTED_EVERY: i32 = 8;

/// How the samples along one axis lie on the posts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// Post coordinate of the first sample.
    origin: f64,
    /// Posts from one sample to the next.
    step: f64,
    count: usize,
    /// Whether every sample stands on a post.
    on_posts: bool,
}

/// A post's place among the samples of an axis: between `index` and the next, `fraction` of the way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// The sample at or before it.
    pub index: usize,
    /// 0 on the sample, below 1.
    pub fraction: f64,
}

impl Axis {
    fn new(origin: f64, step: f64, count: usize) -> Self {
        #[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
        let last = origin + step * (count.max(1) - 1) as f64;
        let near = |x: f64| (x - x.round()).abs() < ON_POST;
        let on_posts = near(origin)
            && near(last)
            && step.round() >= 1.0
            && (step - step.round()).abs() < ON_POST;
        if !on_posts {
            return Self {
                origin,
                step,
                count,
                on_posts,
            };
        }
        Self {
            origin: origin.round(),
            step: step.round(),
            count,
            on_posts,
        }
    }

    /// The first and last post it covers, inclusive. Samples on posts cover what lies between the outermost; samples
    /// elsewhere stand for their cell and cover half a spacing more.
    fn posts(&self) -> (i32, i32) {
        // Rounding must not cost a post, nor win one.
        let rounding = (ON_POST * self.step).min(0.5);
        let beyond = rounding + if self.on_posts { 0.0 } else { 0.5 * self.step };
        #[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
        let last = self.origin + self.step * (self.count.max(1) - 1) as f64;
        #[expect(
            clippy::cast_possible_truncation,
            reason = "post coordinates of places on Earth fit; the readers reject others"
        )]
        (
            (self.origin - beyond).ceil() as i32,
            (last + beyond).floor() as i32,
        )
    }

    /// Where a post it covers lies among the samples.
    #[must_use]
    pub fn place(&self, post: i32) -> Place {
        #[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
        let last = (self.count.max(1) - 1) as f64;
        let along = ((f64::from(post) - self.origin) / self.step).clamp(0.0, last);
        let along = if (along - along.round()).abs() * self.step.max(1.0) < ON_POST {
            along.round()
        } else {
            along
        };
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "clamped to the samples"
        )]
        let index = along.floor() as usize;
        Place {
            index,
            fraction: along - along.floor(),
        }
    }
}

/// Where a post lies among a raster's samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// Along its row.
    pub east: Place,
    /// Down its columns.
    pub south: Place,
}

/// How a raster lies on a grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Placement {
    /// In rows and columns of the grid's own directions.
    Aligned {
        /// Along a row of samples.
        east: Axis,
        /// Down a column; its post coordinates are minus the rows of the grid.
        south: Axis,
    },
    /// In rows and columns of a zone of UTM.
    Projected {
        /// The zone.
        zone: Zone,
        /// The grid.
        grid: Grid,
        /// The raster's.
        geometry: Geometry,
    },
}

impl Placement {
    /// Of a raster on a grid.
    #[must_use]
    pub fn new(geometry: &Geometry, grid: Grid) -> Self {
        let posts = f64::from(grid.posts_per_degree);
        match geometry.crs {
            Crs::Geographic => Self::Aligned {
                east: Axis::new(
                    geometry.west * posts,
                    geometry.step_east * posts,
                    geometry.columns,
                ),
                // Rows count southwards, so the axis runs along minus the latitude.
                south: Axis::new(
                    -geometry.north * posts,
                    geometry.step_south * posts,
                    geometry.rows,
                ),
            },
            Crs::Utm(zone) => Self::Projected {
                zone,
                grid,
                geometry: *geometry,
            },
        }
    }

    /// Whether every sample stands on a post, and every post between them has one: the raster is copied.
    #[must_use]
    pub fn is_copy(&self) -> bool {
        let one = |a: &Axis| a.on_posts && (a.step - 1.0).abs() < 1e-9;
        match self {
            Self::Aligned { east, south } => one(east) && one(south),
            Self::Projected { .. } => false,
        }
    }

    /// The posts of a grid around everything that it covers: none beyond the poles, and from 180 W to 180 E if it goes all
    /// around. A projected raster does not cover all of them.
    #[must_use]
    pub fn rect(&self, grid: Grid) -> PostRect {
        let ((mut west, mut east), (north, south)) = match self {
            Self::Aligned { east, south } => (east.posts(), south.posts()),
            Self::Projected { zone, geometry, .. } => outline(*zone, geometry, grid),
        };
        if east - west > grid.posts_around() {
            (west, east) = (-grid.posts_around() / 2, grid.posts_around() / 2);
        }
        PostRect {
            south: (-south).max(-grid.row_max()),
            west,
            north: (-north).min(grid.row_max()),
            east,
        }
    }

    /// Where the posts of a row lie among the samples, from the western one on; `None` where the raster does not reach.
    /// The columns are those of [`Placement::rect`].
    pub fn spots(&self, row: i32, columns: RangeInclusive<i32>, spots: &mut Vec<Option<Spot>>) {
        spots.clear();
        match self {
            Self::Aligned { east, south } => {
                let south = south.place(-row);
                spots.extend(columns.map(|i| {
                    let east = east.place(i);
                    Some(Spot { east, south })
                }));
            }
            Self::Projected {
                zone,
                grid,
                geometry,
            } => {
                let latitude = Radians::from_degrees(grid.latitude_deg(0, row));
                let project = |i: i32| {
                    zone.project(latitude, Radians::from_degrees(grid.longitude_deg(0, i)))
                };
                let mut from = project(*columns.start());
                for first in columns
                    .clone()
                    .step_by(PROJECTED_EVERY.unsigned_abs() as usize)
                {
                    let to = project(first + PROJECTED_EVERY);
                    for i in first..(first + PROJECTED_EVERY).min(columns.end() + 1) {
                        let t = f64::from(i - first) / f64::from(PROJECTED_EVERY);
                        let along = |a: f64, b: f64| (b - a).mul_add(t, a);
                        spots.push(geometry.spot(along(from.0, to.0), along(from.1, to.1)));
                    }
                    from = to;
                }
            }
        }
    }
}

impl Geometry {
    /// Where a place in its own coordinates lies among its samples, up to half a spacing beyond the outermost.
    fn spot(&self, x: f64, y: f64) -> Option<Spot> {
        Some(Spot {
            east: within((x - self.west) / self.step_east, self.columns)?,
            south: within((self.north - y) / self.step_south, self.rows)?,
        })
    }
}

/// A place along an axis of `count` samples, in their spacing.
fn within(along: f64, count: usize) -> Option<Place> {
    #[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
    let last = (count.max(1) - 1) as f64;
    if !(-0.5..=last + 0.5).contains(&along) {
        return None;
    }
    let along = along.clamp(0.0, last);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "clamped to the samples"
    )]
    let index = along.floor() as usize;
    Some(Place {
        index,
        fraction: along - along.floor(),
    })
}

/// The columns and minus the rows of the posts around a projected raster and half a spacing more.
fn outline(zone: Zone, geometry: &Geometry, grid: Grid) -> ((i32, i32), (i32, i32)) {
    // Between so many places along an edge it bends by less than a post.
    const STEPS: u16 = 256;
    #[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
    let (width, height) = (
        geometry.step_east * geometry.columns as f64,
        geometry.step_south * geometry.rows as f64,
    );
    let (west, north) = (
        0.5_f64.mul_add(-geometry.step_east, geometry.west),
        0.5_f64.mul_add(geometry.step_south, geometry.north),
    );
    let (mut columns, mut rows) = ((i32::MAX, i32::MIN), (i32::MAX, i32::MIN));
    let posts = f64::from(grid.posts_per_degree);
    for step in 0..=STEPS {
        let t = f64::from(step) / f64::from(STEPS);
        let edges = [(t, 0.0), (t, 1.0), (0.0, t), (1.0, t)];
        for (x, y) in edges.map(|(u, v)| (u.mul_add(width, west), v.mul_add(-height, north))) {
            let (latitude, longitude) = zone.unproject(x, y);
            #[expect(
                clippy::cast_possible_truncation,
                reason = "post coordinates of places on Earth fit; the readers reject others"
            )]
            let (i, j) = (
                (longitude.to_degrees() * posts).round() as i32,
                (-latitude.to_degrees() * posts).round() as i32,
            );
            columns = (columns.0.min(i - 1), columns.1.max(i + 1));
            rows = (rows.0.min(j - 1), rows.1.max(j + 1));
        }
    }
    let turn = if columns.0 < -grid.posts_around() / 2 {
        grid.posts_around()
    } else {
        0
    };
    ((columns.0 + turn, columns.1 + turn), rows)
}
