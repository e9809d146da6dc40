//! One elevation file in memory: its samples, where they stand, and reading them at the posts of a grid. Pure.

use crate::terrain::grid::Grid;
use crate::terrain::pack::PostRect;

/// No ground on Earth is lower or higher than this, metres (the Challenger Deep is near -10 950, Everest 8849): what lies
/// outside is no measurement, whatever the file calls it.
const PLAUSIBLE_M: std::ops::RangeInclusive<f32> = -12_000.0..=9_000.0;

/// A sample this close to a post, in spacings of the finer of the two, stands on it. GeoTIFF writers round the spacing to 9 or more digits, which
/// adds up to a few thousandths over a tile.
const ON_POST: f64 = 0.01;

/// Samples, row by row from the north, each row from the west. Voids are `i16::MIN` or NaN.
#[derive(Clone, Debug, PartialEq)]
pub enum Samples {
    /// Whole metres.
    Whole(Vec<i16>),
    /// Metres.
    Fractional(Vec<f32>),
}

/// Where a file's samples stand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// Samples in a row.
    pub columns: usize,
    /// Rows.
    pub rows: usize,
    /// Longitude of the westernmost samples, degrees east, -180 or above and below 180.
    pub west_deg: f64,
    /// Latitude of the northernmost samples, degrees north.
    pub north_deg: f64,
    /// Spacing eastwards, degrees, positive.
    pub step_east_deg: f64,
    /// Spacing southwards, degrees, positive.
    pub step_south_deg: f64,
}

/// An elevation file.
#[derive(Clone, Debug, PartialEq)]
pub struct Raster {
    /// Where its samples stand.
    pub geometry: Geometry,
    /// The samples.
    pub samples: Samples,
}

/// What a raster holds, for choosing a pack's scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contents {
    /// Lowest and highest sample, metres; `None` if all are void.
    pub range_m: Option<(f32, f32)>,
    /// Whether a sample is no whole number of metres.
    pub fractional: bool,
}

impl Geometry {
    /// Samples per degree along the finer axis.
    #[must_use]
    pub fn samples_per_degree(&self) -> f64 {
        1.0 / self.step_east_deg.min(self.step_south_deg)
    }

    /// The columns of one turn around the Earth, if it has them all, and perhaps the first once more at the end.
    fn turn(&self) -> Option<usize> {
        let around = 360.0 / self.step_east_deg;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a positive count; one too large for a raster is none that closes"
        )]
        let turn = around.round() as usize;
        let closes = (around - around.round()).abs() < ON_POST
            && (self.columns == turn || turn.checked_add(1) == Some(self.columns));
        closes.then_some(turn)
    }

    /// How it lies on a grid.
    #[must_use]
    pub fn placement(&self, grid: Grid) -> Placement {
        let posts = f64::from(grid.posts_per_degree);
        Placement {
            east: Axis::new(
                self.west_deg * posts,
                self.step_east_deg * posts,
                self.columns,
            ),
            // Rows count southwards, so the axis runs along minus the latitude.
            south: Axis::new(
                -self.north_deg * posts,
                self.step_south_deg * posts,
                self.rows,
            ),
        }
    }
}

impl Raster {
    /// Turns samples that are no elevation on Earth into voids: the usual markers -32768 and -32767 among them.
    pub fn mark_voids(&mut self, nodata: Option<f64>) {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "a marker is compared as the sample type that holds it"
        )]
        let nodata = nodata.map(|n| n as f32);
        let is_void = |x: f32| !PLAUSIBLE_M.contains(&x) || nodata == Some(x);
        match &mut self.samples {
            Samples::Whole(all) => {
                for s in all.iter_mut().filter(|s| is_void(f32::from(**s))) {
                    *s = i16::MIN;
                }
            }
            Samples::Fractional(all) => {
                for s in all.iter_mut().filter(|s| is_void(**s)) {
                    *s = f32::NAN;
                }
            }
        }
    }

    /// Closes a raster that goes around the Earth, so that there is ground between its last column and its first, and at
    /// the poles: it begins at 180 degrees west or just west of it and has its first columns again behind its last. A pole
    /// is one place: a row on it is made its mean; where the outermost row is half a spacing short of it, a row half a
    /// spacing beyond is added such that in between, on the pole, lies the mean of the outermost. Other rasters stay as
    /// they are.
    pub fn close(&mut self) {
        let g = self.geometry;
        let Some(turn) = g.turn() else { return };
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "columns from 180 W on: 0 up to a turn"
        )]
        let first = ((-180.0 - g.west_deg).rem_euclid(360.0) / g.step_east_deg + ON_POST).floor()
            as usize
            % turn;
        #[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
        let (west_deg, rows_deg) = (
            g.west_deg + g.step_east_deg * first as f64,
            g.step_south_deg * (g.rows.max(1) - 1) as f64,
        );
        let width = turn + 2;
        // Voids are NaN here.
        let mut closed = Vec::with_capacity(width * (g.rows + 2));
        for row in 0..g.rows {
            let columns = (first..first + width).map(|column| row * g.columns + column % turn);
            closed.extend(columns.map(|at| self.sample(at).unwrap_or(f32::NAN)));
        }
        let from_pole = [90.0 - g.north_deg, 90.0 - (rows_deg - g.north_deg)];
        let steps = from_pole.map(|deg| deg / g.step_south_deg);
        let last = closed.len() - width;
        for (start, steps) in [(0, steps[0]), (last, steps[1])] {
            if steps.abs() < ON_POST
                && let Some(mean) = mean(&closed[start..start + turn])
            {
                closed[start..start + width].fill(mean);
            }
        }
        let half = steps.map(|steps| (steps - 0.5).abs() < ON_POST);
        if half[1] {
            closed.extend(across_the_pole(&closed[last..], turn));
        }
        if half[0] {
            closed.splice(0..0, across_the_pole(&closed[..width], turn));
        }
        self.geometry = Geometry {
            columns: width,
            rows: closed.len() / width,
            west_deg: west_deg - if west_deg > 0.0 { 360.0 } else { 0.0 },
            north_deg: g.north_deg + if half[0] { g.step_south_deg } else { 0.0 },
            ..g
        };
        self.samples = match self.samples {
            #[expect(clippy::cast_possible_truncation, reason = "heights on Earth")]
            Samples::Whole(_) => {
                let whole = |h: &f32| if h.is_nan() { i16::MIN } else { *h as i16 };
                Samples::Whole(closed.iter().map(whole).collect())
            }
            Samples::Fractional(_) => Samples::Fractional(closed),
        };
    }

    /// Its range and whether it holds fractions.
    #[must_use]
    pub fn contents(&self) -> Contents {
        let mut range: Option<(f32, f32)> = None;
        let mut fractional = false;
        for at in 0..self.geometry.columns * self.geometry.rows {
            let Some(x) = self.sample(at) else { continue };
            let (low, high) = range.unwrap_or((x, x));
            range = Some((low.min(x), high.max(x)));
            fractional |= x.fract().abs() > 0.0;
        }
        Contents {
            range_m: range,
            fractional,
        }
    }

    /// Bytes its samples take in memory.
    #[must_use]
    pub fn bytes(&self) -> usize {
        match &self.samples {
            Samples::Whole(all) => size_of_val(all.as_slice()),
            Samples::Fractional(all) => size_of_val(all.as_slice()),
        }
    }

    /// A sample by its place; `None` for a void.
    #[inline]
    fn sample(&self, at: usize) -> Option<f32> {
        match &self.samples {
            Samples::Whole(all) => {
                let s = *all.get(at)?;
                (s != i16::MIN).then(|| f32::from(s))
            }
            Samples::Fractional(all) => all.get(at).copied().filter(|x| !x.is_nan()),
        }
    }

    /// The height at a place between samples, metres: bilinear; `None` where a sample it needs is void.
    #[must_use]
    pub fn height_m(&self, east: Place, south: Place) -> Option<f32> {
        let at = south.index * self.geometry.columns + east.index;
        let a = self.sample(at)?;
        if east.fraction <= 0.0 && south.fraction <= 0.0 {
            return Some(a);
        }
        let along = |at: usize| {
            let a = f64::from(self.sample(at)?);
            if east.fraction <= 0.0 {
                return Some(a);
            }
            Some(a + (f64::from(self.sample(at + 1)?) - a) * east.fraction)
        };
        let north = along(at)?;
        #[expect(
            clippy::cast_possible_truncation,
            reason = "a height of some thousand metres to f32's tenth of a millimetre"
        )]
        let narrow = |x: f64| x as f32;
        if south.fraction <= 0.0 {
            return Some(narrow(north));
        }
        Some(narrow(
            north + (along(at + self.geometry.columns)? - north) * south.fraction,
        ))
    }
}

/// The mean of those of a row that are no voids, to half a metre; `None` if all are.
fn mean(row: &[f32]) -> Option<f32> {
    let known = row.iter().filter(|h| !h.is_nan());
    let (sum, count) = known.fold((0.0, 0.0), |(sum, count), h| {
        (sum + f64::from(*h), count + 1.0)
    });
    #[expect(clippy::cast_possible_truncation, reason = "a height on Earth")]
    (count > 0.0).then(|| (2.0 * sum / count).round() as f32 / 2.0)
}

/// The row that has, with a row half a spacing from a pole, the mean of that row's `turn` places halfway between them
/// everywhere.
fn across_the_pole(row: &[f32], turn: usize) -> Vec<f32> {
    let twice = mean(&row[..turn]).map_or(f32::NAN, |mean| 2.0 * mean);
    row.iter().map(|h| twice - h).collect()
}

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

/// How a raster lies on a grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Along a row of samples.
    pub east: Axis,
    /// Down a column; its post coordinates are minus the rows of the grid.
    pub south: Axis,
}

impl Placement {
    /// Whether every sample stands on a post, and every post between them has one: the raster is copied.
    #[must_use]
    pub fn is_copy(&self) -> bool {
        let one = |a: &Axis| a.on_posts && (a.step - 1.0).abs() < 1e-9;
        one(&self.east) && one(&self.south)
    }

    /// The posts of a grid that it covers: none beyond the poles, and from 180 W to 180 E if it goes all around.
    #[must_use]
    pub fn rect(&self, grid: Grid) -> PostRect {
        let (mut west, mut east) = self.east.posts();
        if east - west > grid.posts_around() {
            (west, east) = (-grid.posts_around() / 2, grid.posts_around() / 2);
        }
        let (north, south) = self.south.posts();
        PostRect {
            south: (-south).max(-grid.row_max()),
            west,
            north: (-north).min(grid.row_max()),
            east,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: Grid = Grid {
        posts_per_degree: 1200,
    };

    fn raster(step_deg: f64, west_deg: f64, north_deg: f64) -> Raster {
        Raster {
            geometry: Geometry {
                columns: 3,
                rows: 2,
                west_deg,
                north_deg,
                step_east_deg: step_deg,
                step_south_deg: step_deg,
            },
            samples: Samples::Whole(vec![10, 20, 30, 40, 50, i16::MIN]),
        }
    }

    #[test]
    fn samples_on_posts_are_copied() {
        let r = raster(0.000_833_333_3, 14.0, 51.0);
        let p = r.geometry.placement(GRID);
        assert!(
            p.is_copy(),
            "a spacing rounded to ten digits is still 3 arc seconds"
        );
        assert_eq!(
            p.rect(GRID),
            PostRect {
                south: 61_199,
                west: 16_800,
                north: 61_200,
                east: 16_802
            }
        );
        let height = |i, j: i32| r.height_m(p.east.place(i), p.south.place(-j));
        assert_eq!(
            height(16_801, 61_200),
            Some(20.0),
            "north row, second column"
        );
        assert_eq!(
            height(16_800, 61_199),
            Some(40.0),
            "south row, first column"
        );
        assert_eq!(height(16_802, 61_199), None, "void");
    }

    #[test]
    fn samples_between_posts_are_interpolated_and_voids_spread_no_further_than_they_reach() {
        // Twice the spacing of the grid: every second post is a sample.
        let r = raster(2.0 / 1200.0, 0.0, 0.0);
        let p = r.geometry.placement(GRID);
        let height = |i, j: i32| r.height_m(p.east.place(i), p.south.place(-j));
        assert!(!p.is_copy());
        assert_eq!(height(1, 0), Some(15.0), "halfway east");
        assert_eq!(height(1, -1), Some(30.0), "the mean of four");
        assert_eq!(height(4, -1), None, "one of its two samples is void");
        assert_eq!(height(4, 0), Some(30.0), "the void is not needed here");
    }

    #[test]
    fn cells_off_the_posts_cover_their_outline() {
        // Pixel-is-area 3 arc seconds: centres half a spacing inside the degree.
        let half = 0.5 / 1200.0;
        let p = raster(1.0 / 1200.0, half, -half).geometry.placement(GRID);
        assert_eq!(
            p.rect(GRID),
            PostRect {
                south: -2,
                west: 0,
                north: 0,
                east: 3
            }
        );
        assert_eq!(
            p.east.place(0),
            Place {
                index: 0,
                fraction: 0.0
            },
            "its outer edge takes the outermost sample"
        );
        assert_eq!(
            p.east.place(1),
            Place {
                index: 0,
                fraction: 0.5
            }
        );
    }

    /// A raster of 30 degrees around the Earth, its rows half a spacing short of the poles or on them.
    fn global(west_deg: i32, columns: usize, rows: usize) -> Raster {
        let on_poles = rows == 7;
        let samples = (0..rows).flat_map(|row| {
            (0..columns).map(move |column| 100.0 * row as f32 + (column % 12) as f32)
        });
        Raster {
            geometry: Geometry {
                columns,
                rows,
                west_deg: f64::from(west_deg),
                north_deg: if on_poles { 90.0 } else { 75.0 },
                step_east_deg: 30.0,
                step_south_deg: 30.0,
            },
            samples: Samples::Fractional(samples.collect()),
        }
    }

    #[test]
    fn a_raster_around_the_earth_is_closed_at_the_date_line_and_the_poles() {
        for (west_deg, columns, rows) in [(-180, 12, 6), (-180, 13, 6), (20, 13, 7), (165, 12, 7)] {
            let mut r = global(west_deg, columns, rows);
            let before = r.clone();
            r.close();
            let p = r.geometry.placement(GRID);
            let rect = p.rect(GRID);
            assert_eq!(
                (rect.south, rect.north),
                (-90 * 1200, 90 * 1200),
                "pole to pole"
            );
            assert_eq!(rect.east - rect.west, GRID.posts_around(), "all around");
            assert_eq!(rect.west, -216_000);
            let height = |i: i32, j: i32| {
                r.height_m(p.east.place(i), p.south.place(-j))
                    .expect("no void")
            };
            for j in [-108_000, 108_000] {
                for step in 0..=72 {
                    assert_eq!(
                        height(rect.west + 6000 * step, j).to_bits(),
                        height(rect.west, j).to_bits(),
                        "a pole is one place"
                    );
                }
            }
            assert_eq!(
                height(rect.west, 6000).to_bits(),
                height(rect.east, 6000).to_bits()
            );
            // Every sample off the poles is where it was.
            let old = before.geometry.placement(GRID);
            for row in 1..5 {
                let j = (if rows == 7 { 90 } else { 75 } - 30 * row) * 1200;
                for column in 0..12 {
                    let i = (west_deg + 30 * column) * 1200;
                    let want = before.height_m(old.east.place(i), old.south.place(-j));
                    let turned = rect.west + (i - rect.west).rem_euclid(GRID.posts_around());
                    assert_eq!(Some(height(turned, j)), want, "{i} {j}");
                }
            }
        }
    }

    #[test]
    fn other_rasters_are_not_closed() {
        let mut r = raster(1.0, 14.0, 51.0);
        let before = r.clone();
        r.close();
        assert_eq!(r, before);
    }

    #[test]
    fn what_is_no_elevation_is_void() {
        let mut r = raster(1.0, 0.0, 0.0);
        r.samples = Samples::Whole(vec![-32_768, -32_767, 9_001, -9999, 0, 8848]);
        r.mark_voids(Some(-9999.0));
        let void = i16::MIN;
        assert_eq!(
            r.samples,
            Samples::Whole(vec![void, void, void, void, 0, 8848])
        );
        r.samples = Samples::Fractional(vec![f32::MIN, f32::INFINITY, 0.5, 1.0, 2.0, f32::NAN]);
        r.mark_voids(None);
        let c = r.contents();
        assert_eq!(c.range_m, Some((0.5, 2.0)));
        assert!(c.fractional);
    }
}
