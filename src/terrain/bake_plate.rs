//! Voids filled as a thin plate would bend across them. Pure.
//!
//! A membrane ([`fill_holes`]) leaves its rim at any angle, so that a void becomes a flat patch in which every ridge and
//! valley ends. A thin plate continues slopes: the surface of least bending energy, the integral of
//! `h_xx^2 + 2 h_xy^2 + h_yy^2` (Duchon 1977; Wahba 1990, "Spline Models for Observational Data", section 2.4), whose
//! discrete form takes second differences between posts, those along a parallel by its length. It is found by conjugate
//! gradients on the least squares of the differences (Hestenes and Stiefel 1952, section 10), from the membrane on.

use crate::terrain::bake_fill::{Window, fill_holes};
use crate::terrain::bake_mosaic::around;

/// Posts deeper in a void than this keep the membrane: what the rim says of them is little, and a plate would swing.
const REACH: u8 = 48;

/// How far a plate may pass the heights of its rim, as a share of their range: beyond, it is drawn back to the membrane.
const BEYOND_RIM: f64 = 0.25;

/// Steps of the solver at most, and at most so many posts times steps, which is some seconds.
const STEPS_MAX: usize = 1000;
const WORK_MAX: usize = 100_000_000;

/// The solver ends when the slope of the energy has fallen to this share.
const SLOPE_LEFT: f64 = 1e-5;

const FIXED: u32 = u32::MAX;

/// Fills holes: every post of `heights` that is NaN and is marked in `hole` gets the height of a thin plate that continues
/// what surrounds it; `fallback` if there is nothing. Posts that are NaN and not marked are outside and take no part.
/// `aspect` is the length of a step along a row over that of a step across rows: the cosine of the latitude.
pub fn fill(window: &Window, aspect: f64, heights: &mut [f32], hole: &[bool], fallback: f32) {
    if !hole.contains(&true) {
        return;
    }
    fill_holes(window, heights, hole, fallback);
    let mut seen = vec![false; hole.len()];
    let mut slots = vec![FIXED; hole.len()];
    let mut area = Area::default();
    for seed in 0..hole.len() {
        if hole[seed] && !seen[seed] {
            area.grow(window, (heights, hole), seed, &mut seen);
            area.flex(window, aspect, heights, &mut slots);
        }
    }
}

/// A connected hole.
#[derive(Default)]
struct Area {
    /// Its posts, in the order of their depth: those beside the rim first.
    posts: Vec<usize>,
    /// How many of them are within reach of the rim.
    near: usize,
    /// Lowest and highest height of its rim, metres.
    rim: Option<(f32, f32)>,
}

impl Area {
    /// The hole that a post is in.
    fn grow(
        &mut self,
        window: &Window,
        (heights, hole): (&[f32], &[bool]),
        seed: usize,
        seen: &mut [bool],
    ) {
        self.posts.clear();
        self.rim = None;
        self.posts.push(seed);
        seen[seed] = true;
        let mut beside_rim = Vec::new();
        let mut next = 0;
        while let Some(&at) = self.posts.get(next) {
            next += 1;
            let mut on_rim = false;
            for n in around(window, at) {
                if hole[n] {
                    if !seen[n] {
                        seen[n] = true;
                        self.posts.push(n);
                    }
                } else if !heights[n].is_nan() {
                    let (low, high) = self.rim.unwrap_or((heights[n], heights[n]));
                    self.rim = Some((low.min(heights[n]), high.max(heights[n])));
                    on_rim = true;
                }
            }
            if on_rim {
                beside_rim.push(at);
            }
        }
        self.by_depth(window, beside_rim);
    }

    /// Sorts the posts by their depth below the rim, so far as that is within reach.
    fn by_depth(&mut self, window: &Window, beside_rim: Vec<usize>) {
        let mut deep: std::collections::HashMap<usize, u8> =
            self.posts.iter().map(|at| (*at, u8::MAX)).collect();
        for at in &beside_rim {
            deep.insert(*at, 1);
        }
        let mut order = beside_rim;
        let mut next = 0;
        while let Some(&at) = order.get(next) {
            next += 1;
            let depth = deep.get(&at).copied().unwrap_or(REACH);
            if depth >= REACH {
                continue;
            }
            for n in around(window, at) {
                if let Some(d) = deep.get_mut(&n).filter(|d| **d == u8::MAX) {
                    *d = depth + 1;
                    order.push(n);
                }
            }
        }
        self.near = order.len();
        self.posts = order;
    }

    /// Bends the membrane that fills it to a plate.
    fn flex(&self, window: &Window, aspect: f64, heights: &mut [f32], slots: &mut [u32]) {
        let Some((low, high)) = self.rim.filter(|(low, high)| low < high) else {
            return;
        };
        for (slot, at) in (0..).zip(&self.posts) {
            slots[*at] = slot;
        }
        let bends = bends(window, aspect, heights, &self.posts, slots);
        for at in &self.posts {
            slots[*at] = FIXED;
        }
        let membrane: Vec<f64> = self
            .posts
            .iter()
            .map(|at| f64::from(heights[*at]))
            .collect();
        let plate = least_bent(&bends, membrane.clone());
        let (low, high) = (f64::from(low), f64::from(high));
        let spare = BEYOND_RIM * (high - low);
        let share = std::iter::zip(&membrane, &plate).fold(1.0_f64, |share, (m, p)| {
            let room = if p > m {
                high + spare - m
            } else {
                m - low + spare
            };
            share.min(room / (p - m).abs().max(room))
        });
        for (at, (m, p)) in self.posts.iter().zip(std::iter::zip(&membrane, &plate)) {
            #[expect(clippy::cast_possible_truncation, reason = "a height on Earth")]
            {
                heights[*at] = (p - m).mul_add(share, *m) as f32;
            }
        }
    }
}

/// A second difference: coefficients of posts that are to be found, and the sum over those that are known.
struct Bend {
    slots: [u32; 4],
    weights: [f64; 4],
    known: f64,
}

/// All second differences that have one of `posts` in them and none that is outside.
fn bends(
    window: &Window,
    aspect: f64,
    heights: &[f32],
    posts: &[usize],
    slots: &[u32],
) -> Vec<Bend> {
    let mut all = Vec::with_capacity(posts.len() * 4);
    let (east, north) = (1, window.columns);
    let along = 1.0 / (aspect * aspect);
    let twist = std::f64::consts::SQRT_2 / aspect;
    let mut centres: Vec<usize> = posts
        .iter()
        .flat_map(|at| around(window, *at).chain([*at]))
        .collect();
    centres.sort_unstable();
    centres.dedup();
    for at in centres {
        let (column, row) = (at % window.columns, at / window.columns);
        let inner = |place: usize, count: usize| place > 0 && place + 1 < count;
        let mut add = |places: [usize; 4], weights: [f64; 4]| {
            let mut bend = Bend {
                slots: [FIXED; 4],
                weights: [0.0; 4],
                known: 0.0,
            };
            let mut open = false;
            for (n, (place, weight)) in places.into_iter().zip(weights).enumerate() {
                if weight.abs() <= 0.0 {
                    continue;
                }
                if slots[place] == FIXED {
                    bend.known += weight * f64::from(heights[place]);
                } else {
                    bend.slots[n] = slots[place];
                    bend.weights[n] = weight;
                    open = true;
                }
            }
            if open && !bend.known.is_nan() {
                all.push(bend);
            }
        };
        if inner(column, window.columns) {
            add(
                [at - east, at, at + east, at],
                [along, -2.0 * along, along, 0.0],
            );
        }
        if inner(row, window.rows) {
            add([at - north, at, at + north, at], [1.0, -2.0, 1.0, 0.0]);
        }
        if column + 1 < window.columns && row + 1 < window.rows {
            add(
                [at, at + east, at + north, at + north + east],
                [twist, -twist, -twist, twist],
            );
        }
    }
    all
}

impl Bend {
    /// Its value for changes of the posts, without what is known.
    fn of(&self, x: &[f64]) -> f64 {
        let mut sum = 0.0;
        for (slot, weight) in self.slots.iter().zip(self.weights) {
            if *slot != FIXED {
                sum += weight * x[*slot as usize];
            }
        }
        sum
    }

    /// Adds to a slope what a unit of it would.
    fn give(&self, value: f64, slope: &mut [f64]) {
        for (slot, weight) in self.slots.iter().zip(self.weights) {
            if *slot != FIXED {
                slope[*slot as usize] += weight * value;
            }
        }
    }
}

/// The heights of least bending, from `x` on.
fn least_bent(bends: &[Bend], mut x: Vec<f64>) -> Vec<f64> {
    let steps = STEPS_MAX.min(WORK_MAX / x.len().max(1));
    let mut left: Vec<f64> = bends.iter().map(|b| -b.known - b.of(&x)).collect();
    let slope_of = |left: &[f64], slope: &mut Vec<f64>| {
        slope.fill(0.0);
        for (bend, value) in bends.iter().zip(left) {
            bend.give(*value, slope);
        }
        slope.iter().map(|s| s * s).sum::<f64>()
    };
    let mut slope = vec![0.0; x.len()];
    let mut square = slope_of(&left, &mut slope);
    let enough = square * SLOPE_LEFT * SLOPE_LEFT;
    let mut way = slope.clone();
    for _ in 0..steps {
        if square <= enough {
            break;
        }
        let turned: Vec<f64> = bends.iter().map(|b| b.of(&way)).collect();
        let bent: f64 = turned.iter().map(|t| t * t).sum();
        if bent <= 0.0 {
            break;
        }
        let step = square / bent;
        for (x, way) in x.iter_mut().zip(&way) {
            *x += step * way;
        }
        for (left, turned) in left.iter_mut().zip(&turned) {
            *left -= step * turned;
        }
        let before = square;
        square = slope_of(&left, &mut slope);
        for (way, slope) in way.iter_mut().zip(&slope) {
            *way = (square / before).mul_add(*way, *slope);
        }
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    const WINDOW: Window = Window {
        columns: 48,
        rows: 40,
    };

    fn each(f: impl Fn(f32, f32) -> f32) -> Vec<f32> {
        let small = |x: usize| f32::from(u8::try_from(x).expect("small"));
        (0..WINDOW.rows)
            .flat_map(|row| (0..WINDOW.columns).map(move |column| (small(column), small(row))))
            .map(|(x, y)| f(x, y))
            .collect()
    }

    /// The surface with a void in it, filled; the largest error, metres.
    fn error_m(surface: &[f32], is_void: impl Fn(f32, f32) -> bool, aspect: f64) -> f32 {
        let hole: Vec<bool> = each(|x, y| if is_void(x, y) { 1.0 } else { 0.0 })
            .iter()
            .map(|v| *v > 0.5)
            .collect();
        let mut heights = surface.to_vec();
        for (h, _) in heights.iter_mut().zip(&hole).filter(|(_, v)| **v) {
            *h = f32::NAN;
        }
        fill(&WINDOW, aspect, &mut heights, &hole, 0.0);
        std::iter::zip(&heights, surface)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f32::max)
    }

    fn middle(x: f32, y: f32) -> bool {
        (14.0..34.0).contains(&x) && (12.0..28.0).contains(&y)
    }

    #[test]
    fn a_plane_is_continued() {
        let plane = each(|x, y| 100.0 + 7.0 * x - 3.0 * y);
        assert!(error_m(&plane, middle, 0.7) < 0.01);
    }

    #[test]
    fn a_valley_goes_on_through_a_void() {
        // A trough along a diagonal: the membrane would dam it up.
        let valley = each(|x, y| 20.0 * (0.25 * (x - y - 4.0)).cos() + 600.0);
        let plate = error_m(
            &valley,
            |x, y| (18.0..30.0).contains(&x) && (14.0..26.0).contains(&y),
            1.0,
        );
        let mut membrane = valley.clone();
        let hole: Vec<bool> = each(|x, y| {
            if (18.0..30.0).contains(&x) && (14.0..26.0).contains(&y) {
                1.0
            } else {
                0.0
            }
        })
        .iter()
        .map(|v| *v > 0.5)
        .collect();
        for (h, _) in membrane.iter_mut().zip(&hole).filter(|(_, v)| **v) {
            *h = f32::NAN;
        }
        fill_holes(&WINDOW, &mut membrane, &hole, 0.0);
        let dammed = std::iter::zip(&membrane, &valley)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f32::max);
        assert!(plate < 0.6 * dammed, "plate {plate} m, membrane {dammed} m");
    }

    #[test]
    fn a_void_in_a_lake_is_the_lake_and_one_in_nothing_the_fallback() {
        let lake = each(|_, _| 372.0);
        assert!(error_m(&lake, middle, 0.6) < 1e-4);
        let mut nothing = each(|_, _| f32::NAN);
        fill(
            &WINDOW,
            1.0,
            &mut nothing,
            &vec![true; WINDOW.columns * WINDOW.rows],
            5.0,
        );
        assert!(nothing.iter().all(|h| (h - 5.0).abs() < 1e-9));
    }

    #[test]
    fn a_steep_rim_does_not_throw_the_plate_far_beyond_it() {
        let cliff = each(|x, _| if x < 14.0 { 60.0 * x } else { 0.0 });
        let hole: Vec<bool> = each(|x, y| if middle(x, y) { 1.0 } else { 0.0 })
            .iter()
            .map(|v| *v > 0.5)
            .collect();
        let mut heights = cliff;
        for (h, _) in heights.iter_mut().zip(&hole).filter(|(_, v)| **v) {
            *h = f32::NAN;
        }
        fill(&WINDOW, 1.0, &mut heights, &hole, 0.0);
        for (h, _) in heights.iter().zip(&hole).filter(|(_, v)| **v) {
            assert!(
                (-196.0..=976.0).contains(h),
                "{h} m: a quarter of 780 m beyond its rim at most"
            );
        }
    }
}
