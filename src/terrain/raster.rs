//! One elevation file in memory: its samples, where they stand, and reading them at the posts of a grid. Pure.

use crate::terrain::placement::{ON_POST, Spot};
use crate::terrain::utm::Zone;

/// No ground on Earth is lower or higher than this, metres (the Challenger Deep is near -10 950, Everest 8849): what lies
/// outside is no measurement, whatever the file calls it.
const PLAUSIBLE_M: std::ops::RangeInclusive<f32> = -12_000.0..=9_000.0;

/// Samples, row by row from the north, each row from the west. Voids are `i16::MIN` or NaN.
#[derive(Clone, Debug, PartialEq)]
pub enum Samples {
    /// Whole metres.
    Whole(Vec<i16>),
    /// Metres.
    Fractional(Vec<f32>),
}

/// The coordinates in which a file's samples stand in rows and columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Crs {
    /// Degrees of longitude and latitude on WGS 84.
    Geographic,
    /// Metres of easting and northing in a zone of UTM on WGS 84.
    Utm(Zone),
}

/// Where a file's samples stand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// The coordinates of what follows, and their unit.
    pub crs: Crs,
    /// Samples in a row.
    pub columns: usize,
    /// Rows.
    pub rows: usize,
    /// Longitude of the westernmost samples, -180 degrees or above and below 180, or their easting.
    pub west: f64,
    /// Latitude or northing of the northernmost samples.
    pub north: f64,
    /// Spacing eastwards, positive.
    pub step_east: f64,
    /// Spacing southwards, positive.
    pub step_south: f64,
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
    /// Samples per degree of latitude or longitude, along the finer axis.
    #[must_use]
    pub fn samples_per_degree(&self) -> f64 {
        // A degree of latitude is 110.6 to 111.7 km.
        let degree = match self.crs {
            Crs::Geographic => 1.0,
            Crs::Utm(_) => 111_200.0,
        };
        degree / self.step_east.min(self.step_south)
    }

    /// The columns of one turn around the Earth, if it has them all, and perhaps the first once more at the end.
    fn turn(&self) -> Option<usize> {
        if self.crs != Crs::Geographic {
            return None;
        }
        let around = 360.0 / self.step_east;
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
        let first =
            ((-180.0 - g.west).rem_euclid(360.0) / g.step_east + ON_POST).floor() as usize % turn;
        #[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
        let (west_deg, rows_deg) = (
            g.west + g.step_east * first as f64,
            g.step_south * (g.rows.max(1) - 1) as f64,
        );
        let width = turn + 2;
        // Voids are NaN here.
        let mut closed = Vec::with_capacity(width * (g.rows + 2));
        for row in 0..g.rows {
            let columns = (first..first + width).map(|column| row * g.columns + column % turn);
            closed.extend(columns.map(|at| self.sample(at).unwrap_or(f32::NAN)));
        }
        let from_pole = [90.0 - g.north, 90.0 - (rows_deg - g.north)];
        let steps = from_pole.map(|deg| deg / g.step_south);
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
            west: west_deg - if west_deg > 0.0 { 360.0 } else { 0.0 },
            north: g.north + if half[0] { g.step_south } else { 0.0 },
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

    /// The voids that are connected to its edge, a mark for each sample: the margin that a picture in other coordinates has
    /// around it, or sea that was never measured. `None` if there are none.
    #[must_use]
    pub fn margin(&self) -> Option<Vec<bool>> {
        let Geometry { columns, rows, .. } = self.geometry;
        let on_edge = |at: usize| {
            let (column, row) = (at % columns, at / columns);
            column == 0 || row == 0 || column + 1 == columns || row + 1 == rows
        };
        let ends = (0..columns).chain((rows.max(1) - 1) * columns..rows * columns);
        let sides = (0..rows).flat_map(|row| [row * columns, row * columns + columns.max(1) - 1]);
        let mut order: Vec<usize> = ends
            .chain(sides)
            .filter(|at| self.sample(*at).is_none())
            .collect();
        if order.is_empty() {
            return None;
        }
        let mut margin = vec![false; columns * rows];
        for at in &order {
            margin[*at] = true;
        }
        while let Some(at) = order.pop() {
            let beside = [
                (at % columns > 0).then(|| at - 1),
                (at % columns + 1 < columns).then_some(at + 1),
                at.checked_sub(columns),
                Some(at + columns).filter(|n| *n < columns * rows),
            ];
            for n in beside.into_iter().flatten() {
                if !margin[n] && !on_edge(n) && self.sample(n).is_none() {
                    margin[n] = true;
                    order.push(n);
                }
            }
        }
        Some(margin)
    }

    /// Whether a void that is not of the `margin` is why there is no height at a place.
    #[must_use]
    pub fn has_inner_void(&self, Spot { east, south }: Spot, margin: Option<&[bool]>) -> bool {
        let at = south.index * self.geometry.columns + east.index;
        let right = usize::from(east.fraction > 0.0);
        let below = if south.fraction > 0.0 {
            self.geometry.columns
        } else {
            0
        };
        [at, at + right, at + below, at + below + right]
            .into_iter()
            .any(|at| self.sample(at).is_none() && !margin.is_some_and(|m| m[at]))
    }

    /// The height at a place between samples, metres: bilinear; `None` where a sample it needs is void.
    #[must_use]
    pub fn height_m(&self, Spot { east, south }: Spot) -> Option<f32> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::terrain::grid::Grid;
    use crate::terrain::pack::PostRect;
    use crate::terrain::placement::{Place, Placement};

    const GRID: Grid = Grid {
        posts_per_degree: 1200,
    };

    fn raster(step_deg: f64, west_deg: f64, north_deg: f64) -> Raster {
        Raster {
            geometry: Geometry {
                columns: 3,
                rows: 2,
                west: west_deg,
                north: north_deg,
                step_east: step_deg,
                step_south: step_deg,
                crs: Crs::Geographic,
            },
            samples: Samples::Whole(vec![10, 20, 30, 40, 50, i16::MIN]),
        }
    }

    fn spot(placement: &Placement, i: i32, j: i32) -> Option<Spot> {
        let mut spots = Vec::new();
        placement.spots(j, i..=i, &mut spots);
        spots[0]
    }

    #[test]
    fn samples_on_posts_are_copied() {
        let r = raster(0.000_833_333_3, 14.0, 51.0);
        let p = Placement::new(&r.geometry, GRID);
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
        let height = |i, j| r.height_m(spot(&p, i, j)?);
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
        let p = Placement::new(&r.geometry, GRID);
        let height = |i, j| r.height_m(spot(&p, i, j)?);
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
        let p = Placement::new(&raster(1.0 / 1200.0, half, -half).geometry, GRID);
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
            spot(&p, 0, 0).map(|s| s.east),
            Some(Place {
                index: 0,
                fraction: 0.0
            }),
            "its outer edge takes the outermost sample"
        );
        assert_eq!(
            spot(&p, 1, 0).map(|s| s.east),
            Some(Place {
                index: 0,
                fraction: 0.5
            })
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
                crs: Crs::Geographic,
                west: f64::from(west_deg),
                north: if on_poles { 90.0 } else { 75.0 },
                step_east: 30.0,
                step_south: 30.0,
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
            let p = Placement::new(&r.geometry, GRID);
            let rect = p.rect(GRID);
            assert_eq!(
                (rect.south, rect.north),
                (-90 * 1200, 90 * 1200),
                "pole to pole"
            );
            assert_eq!(rect.east - rect.west, GRID.posts_around(), "all around");
            assert_eq!(rect.west, -216_000);
            let height = |i: i32, j: i32| {
                let spot = spot(&p, i, j).expect("covered");
                r.height_m(spot).expect("no void")
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
            let old = Placement::new(&before.geometry, GRID);
            for row in 1..5 {
                let j = (if rows == 7 { 90 } else { 75 } - 30 * row) * 1200;
                for column in 0..12 {
                    let i = (west_deg + 30 * column) * 1200;
                    let want = spot(&old, i, j).and_then(|s| before.height_m(s));
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
