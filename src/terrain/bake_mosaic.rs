//! Inputs laid over each other: the finest that has a height at a post gives it, and the others are bent to meet it. Pure.
//!
//! Where one input ends and a coarser one goes on, or fills a void, the difference between the two along that rim is spread
//! over the coarser one as a membrane that has died away [`REACH`] posts from it. So there is no step, and the coarser one
//! keeps its shape: in a void this is the delta surface fill of SRTM (Grohman, Kroenung and Strebeck 2006,
//! "Filling SRTM voids: the delta surface fill method"), elsewhere the seamless cloning of pictures (Perez, Gangnet and
//! Blake 2003, "Poisson image editing"). Samples that stand on the posts of the grid are measured there and are never bent.

use crate::terrain::bake_cell::{Disagreement, Layer};
use crate::terrain::bake_fill::{Window, fill_holes, water};
use crate::terrain::geoid::GeoidGrid;
use crate::terrain::grid::Grid;
use crate::terrain::pack::PostRect;
use crate::terrain::store::Scale;
use crate::units::Radians;

/// Posts over which a coarser input is bent to meet a finer one.
pub(crate) const REACH: u8 = 32;

/// Two inputs that do not both stand on the posts disagree where they differ by more than this for each time that one is
/// coarser than the other, metres: SRTM's absolute error at 90 % confidence (Farr et al. 2007, table 1: 16 m required).
const ALIKE_M: f64 = 16.0;

/// An input so many times coarser says nothing about a finer one.
const COMPARED_TO: f64 = 10.0;

/// A void that is filled from an input more than this many times coarser stays marked as a void.
const VOUCHED: f64 = 1.5;

/// Posts of a window, put together. Columns run on past 180 degrees.
pub(crate) struct Mosaic {
    pub(crate) rect: PostRect,
    pub(crate) window: Window,
    /// Metres; NaN where void or outside.
    pub(crate) heights: Vec<f32>,
    /// The layer that covers a post, and gave its height if it has one.
    pub(crate) layer: Vec<Option<u16>>,
    /// The finest layer that has a void there.
    void: Vec<Option<u16>>,
}

impl Mosaic {
    pub(crate) fn new(rect: PostRect) -> Self {
        let columns = (rect.east - rect.west + 1).cast_unsigned() as usize;
        let rows = (rect.north - rect.south + 1).cast_unsigned() as usize;
        Self {
            rect,
            window: Window { columns, rows },
            heights: vec![f32::NAN; columns * rows],
            layer: vec![None; columns * rows],
            void: vec![None; columns * rows],
        }
    }

    /// Lays a layer, moved east by `shift` posts, under what is there. Calls `differ` with the post, the difference and
    /// the input already there, for posts at which the two disagree.
    pub(crate) fn lay(
        &mut self,
        number: u16,
        layers: &[Layer<'_>],
        shift: i32,
        scale: Scale,
        mut differ: impl FnMut((i32, i32), f32, usize),
    ) {
        let layer = &layers[usize::from(number)];
        let Some(rect) = self.rect.intersection(&layer.rect.shifted(shift)) else {
            return;
        };
        let mut found = self.find(number, layer, shift, &rect);
        let shared = |(there, found): (&f32, &f32)| !there.is_nan() && !found.is_nan();
        if std::iter::zip(&self.heights, &found).any(shared) {
            for (at, mine) in found.iter().enumerate() {
                let (there, first) = (self.heights[at], self.layer[at]);
                let Some(first) = first.filter(|_| shared((&there, mine))) else {
                    continue;
                };
                let first = &layers[usize::from(first)];
                let difference = (mine - there).abs();
                if tolerance_m(first, layer, scale).is_some_and(|t| f64::from(difference) > t) {
                    differ(self.post(at), difference, first.input);
                }
            }
            if !layer.placement.is_copy() {
                bend(&self.window, &mut found, &self.heights, scale);
            }
        }
        for (at, h) in found.iter().enumerate().filter(|(_, h)| !h.is_nan()) {
            if self.heights[at].is_nan() {
                self.heights[at] = *h;
                self.layer[at] = Some(number);
            }
        }
    }

    /// A layer's heights in the window, NaN where it has none, its voids noted.
    fn find(&mut self, number: u16, layer: &Layer<'_>, shift: i32, rect: &PostRect) -> Vec<f32> {
        let mut found = vec![f32::NAN; self.heights.len()];
        let mut spots = Vec::new();
        for j in rect.south..=rect.north {
            let columns = rect.west - shift..=rect.east - shift;
            layer.placement.spots(j, columns, &mut spots);
            let start = (j - self.rect.south).cast_unsigned() as usize * self.window.columns
                + (rect.west - self.rect.west).cast_unsigned() as usize;
            for (spot, at) in spots.iter().zip(start..) {
                let Some(spot) = *spot else { continue };
                if let Some(h) = layer.raster.height_m(spot) {
                    found[at] = h;
                    continue;
                }
                self.layer[at].get_or_insert(number);
                if layer.raster.has_inner_void(spot, layer.margin) {
                    self.void[at].get_or_insert(number);
                }
            }
        }
        found
    }

    fn post(&self, at: usize) -> (i32, i32) {
        let (column, row) = (at % self.window.columns, at / self.window.columns);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_possible_wrap,
            reason = "within the window, whose sides are such numbers"
        )]
        (self.rect.west + column as i32, self.rect.south + row as i32)
    }

    /// Whether a post is a void: it has no height, or one from an input much coarser than the one that has a void there.
    pub(crate) fn is_void(&self, at: usize, layers: &[Layer<'_>]) -> bool {
        let Some(given) = self.layer[at] else {
            return false;
        };
        let spacing = |n: u16| 1.0 / layers[usize::from(n)].raster.geometry.samples_per_degree();
        self.heights[at].is_nan()
            || self.void[at].is_some_and(|void| spacing(given) > VOUCHED * spacing(void))
    }

    /// From heights above the ellipsoid to heights above the geoid.
    pub(crate) fn subtract(&mut self, grid: Grid, geoid: &GeoidGrid) {
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

/// By how much two layers may differ at a post, metres; `None` where one is so coarse that any difference may be.
fn tolerance_m(a: &Layer<'_>, b: &Layer<'_>, scale: Scale) -> Option<f64> {
    if a.placement.is_copy() && b.placement.is_copy() {
        // Both were measured there: every difference that the pack can show.
        return Some(scale.unit_m);
    }
    let [a, b] = [a, b].map(|l| l.raster.geometry.samples_per_degree());
    let coarser = a.max(b) / a.min(b);
    (coarser <= COMPARED_TO).then_some(ALIKE_M * coarser)
}

/// Bends `found`, where there is nothing yet, so that it meets what is `there` along the rim. Its water stays flat.
fn bend(window: &Window, found: &mut [f32], there: &[f32], scale: Scale) {
    let quanta: Vec<Option<u16>> = found
        .iter()
        .map(|h| (!h.is_nan()).then(|| scale.quanta(f64::from(*h))))
        .collect();
    let still = water(window, &quanta);
    let is_new = |at: usize| there[at].is_nan() && !found[at].is_nan();
    let mut away = vec![u8::MAX; found.len()];
    let mut order = Vec::new();
    let mut delta = vec![f32::NAN; found.len()];
    for at in 0..found.len() {
        let both = !there[at].is_nan() && !found[at].is_nan();
        if both && around(window, at).any(is_new) {
            away[at] = 0;
            order.push(at);
            delta[at] = there[at] - found[at];
        }
    }
    let mut next = 0;
    while let Some(&at) = order.get(next) {
        next += 1;
        if away[at] < REACH {
            for n in around(window, at).filter(|n| is_new(*n)) {
                if away[n] == u8::MAX {
                    away[n] = away[at] + 1;
                    order.push(n);
                }
            }
        }
    }
    let mut bent = vec![false; found.len()];
    for at in (0..found.len()).filter(|at| is_new(*at)) {
        bent[at] = away[at] < REACH && !still[at];
        if !bent[at] {
            delta[at] = 0.0;
        }
    }
    fill_holes(window, &mut delta, &bent, 0.0);
    for ((h, delta), _) in found.iter_mut().zip(&delta).zip(&bent).filter(|(_, b)| **b) {
        *h += delta;
    }
}

/// The eight posts around a post, so far as they are in the window.
pub(crate) fn around(window: &Window, at: usize) -> impl Iterator<Item = usize> + use<> {
    let (column, row) = (at % window.columns, at / window.columns);
    let columns = column.saturating_sub(1)..=(column + 1).min(window.columns - 1);
    let rows = row.saturating_sub(1)..=(row + 1).min(window.rows - 1);
    let width = window.columns;
    rows.flat_map(move |r| columns.clone().map(move |c| r * width + c))
        .filter(move |n| *n != at)
}

/// Adds a disagreement at a post to those between the same inputs.
pub(crate) fn disagree(
    all: &mut Vec<Disagreement>,
    (taken, other): (usize, usize),
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

#[cfg(test)]
mod tests {
    use super::*;

    const WINDOW: Window = Window {
        columns: 96,
        rows: 24,
    };
    const SCALE: Scale = Scale {
        unit_m: 0.25,
        base_m: -1000.0,
    };

    fn each(f: impl Fn(f32, f32) -> f32) -> Vec<f32> {
        let small = |x: usize| f32::from(u8::try_from(x).expect("small"));
        (0..WINDOW.rows)
            .flat_map(|row| (0..WINDOW.columns).map(move |column| (small(column), small(row))))
            .map(|(x, y)| f(x, y))
            .collect()
    }

    #[test]
    fn a_coarser_input_meets_the_finer_one_and_is_itself_farther_off() {
        let there = each(|x, _| if x < 20.0 { 510.0 + 2.0 * x } else { f32::NAN });
        let plain = each(|x, y| 500.0 + 2.0 * x + y);
        let mut found = plain.clone();
        bend(&WINDOW, &mut found, &there, SCALE);
        for row in 2..22 {
            let at = |column: usize| row * WINDOW.columns + column;
            let step = |column: usize| {
                let left = if column < 20 {
                    there[at(column)]
                } else {
                    found[at(column)]
                };
                found[at(column + 1)] - left
            };
            assert!(
                (step(19) - 2.0).abs() < 1.5,
                "no step at the rim: {}",
                step(19)
            );
            for column in 20..95 {
                assert!(
                    (step(column) - 2.0).abs() < 1.5,
                    "nor behind it: {}",
                    step(column)
                );
            }
            assert!(
                (found[at(80)] - plain[at(80)]).abs() < 1e-6,
                "far off it is itself"
            );
            assert!(
                (found[at(10)] - plain[at(10)]).abs() < 1e-6,
                "what is not needed is left alone"
            );
        }
    }

    #[test]
    fn a_void_takes_the_shape_of_the_coarser_input_at_the_height_of_its_rim() {
        let shape = |x: f32, y: f32| 30.0 * (0.3 * x).sin() + 2.0 * y;
        let in_void = |x: f32| (30.0..50.0).contains(&x);
        let there = each(|x, y| {
            if in_void(x) && y > 4.0 && y < 20.0 {
                f32::NAN
            } else {
                shape(x, y) + 12.0
            }
        });
        let mut found = each(shape);
        bend(&WINDOW, &mut found, &there, SCALE);
        for (at, h) in each(|x, y| shape(x, y) + 12.0).iter().enumerate() {
            if there[at].is_nan() {
                assert!((found[at] - h).abs() < 0.05, "{} for {h}", found[at]);
            }
        }
    }

    #[test]
    fn a_lake_stays_flat() {
        let there = each(|x, _| if x < 20.0 { 105.0 } else { f32::NAN });
        let mut found = each(|x, y| {
            if (24.0..60.0).contains(&x) {
                100.0
            } else {
                100.0 + (x - 42.0).abs() - 17.0 + 0.1 * y
            }
        });
        bend(&WINDOW, &mut found, &there, SCALE);
        for row in 0..WINDOW.rows {
            for column in 24..60 {
                assert!((found[row * WINDOW.columns + column] - 100.0).abs() < 1e-6);
            }
        }
    }
}
