//! What nearer terrain hides: a profile of the ground seen so far, by which blocks behind a ridge are left out.
//!
//! Positions are taken apart along three axes at the eye: forward (horizontal, where the view heads), right and up (the
//! ellipsoid's normal). A direction is then a point (right / forward, up / forward), and a straight line of space is a
//! straight line of directions. The profile divides the breadth of the picture into columns. Of each it knows a height,
//! up / forward, below which every direction of the whole column meets ground that has been seen already: as high as the
//! lowest point of a line of the ground where it crosses the column from one side to the other.
//!
//! Ground is a height over the ellipsoid, so what lies below a point of it, seen from above ground, lies behind ground.
//! Lines are edges of the very triangles that are drawn, each post no higher than it is drawn at any blend; nothing that
//! shows is ever left out, and no picture depends on this. Nor does any depend on which lines are added: a line that has
//! hidden nothing ([`Silhouette::earned`]) need not be added again soon.

use super::cull::{Bound, Quad};
use crate::geo::Camera;
use glam::{DMat3, DVec3, Vec3, Vec4};

/// Columns across the picture: some pixels each.
const COLUMNS: usize = 256;

/// Those, and one on either side for all that lies beside the picture.
const WITH_SIDES: usize = COLUMNS + 2;

/// Points nearer than this ahead say nothing about what is hidden, metres.
const AHEAD_MIN_M: f32 = 5.0;

/// Lines count this much lower than they are, up / forward: a tenth of a pixel, thousands of times the rounding of f32.
const MARGIN: f32 = 1e-4;

/// Lines may be this much beside where they are, columns: a hundred times the rounding.
const MARGIN_COLUMNS: f32 = 2e-3;

/// A picture whose corners do not look ahead by at least this share is not treated: straight down nothing hides much.
const AHEAD_SHARE_MIN: f64 = 0.1;

/// Most lines of a frame; what more there is hides nothing.
pub const LINES_MAX: usize = 32_768;

/// No line.
const NOBODY: u16 = u16::MAX;

/// See the module.
#[derive(Debug)]
pub struct Silhouette {
    eye: DVec3,
    /// From Earth-centred axes to (forward, right, up).
    axes: DMat3,
    axes_near: [Vec3; 3],
    scale: Scale,
    profile: Profile,
    /// Of each line added, whether it has hidden something.
    earned: Vec<bool>,
    is_used: bool,
}

/// From right / forward to columns.
#[derive(Clone, Copy, Debug)]
struct Scale {
    /// The first column's left side, and columns for each unit.
    first: f32,
    per_unit: f32,
}

impl Scale {
    /// Column 1 is the picture's first.
    fn columns(self, across: f32) -> f32 {
        (across - self.first) * self.per_unit + 1.0
    }
}

/// What is hidden of each column, and the line that did it.
#[derive(Debug)]
struct Profile {
    heights: [f32; WITH_SIDES],
    lines: [u16; WITH_SIDES],
}

impl Profile {
    const NOTHING: Self = Self {
        heights: [f32::NEG_INFINITY; WITH_SIDES],
        lines: [NOBODY; WITH_SIDES],
    };

    fn raise(&mut self, column: usize, height: f32, line: u16) {
        if self.heights[column] < height {
            self.heights[column] = height;
            self.lines[column] = line;
        }
    }
}

/// The greatest heights of the four quarters of a block, metres: south-west, south-east, north-west, north-east.
pub type Tops = [f32; 4];

/// The directions that something takes up: the first and the last of its columns, and the top, up / forward.
#[derive(Clone, Copy, Debug)]
struct Sight {
    columns: (usize, usize),
    top: f32,
}

impl Default for Silhouette {
    /// One that hides nothing.
    fn default() -> Self {
        Self {
            eye: DVec3::ZERO,
            axes: DMat3::IDENTITY,
            axes_near: [Vec3::X, Vec3::Y, Vec3::Z],
            scale: Scale {
                first: 0.0,
                per_unit: 1.0,
            },
            profile: Profile::NOTHING,
            earned: Vec::with_capacity(LINES_MAX),
            is_used: false,
        }
    }
}

impl Silhouette {
    /// Begins a frame with nothing seen. `is_above_ground`: whether the eye is known to be above what is drawn under it;
    /// where it is not, or the camera looks too steeply, nothing will be hidden.
    pub fn begin(&mut self, camera: &Camera, is_above_ground: bool) {
        self.profile = Profile::NOTHING;
        self.earned.clear();
        self.is_used = false;
        let up = -camera.eye.ned_to_ecef().z_axis;
        let view = -camera.eye_to_ecef().z_axis;
        let ahead = view - up * view.dot(up);
        if !is_above_ground || ahead.length() < AHEAD_SHARE_MIN {
            return;
        }
        let forward = ahead.normalize();
        let right = forward.cross(up);
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        let (w, h) = (f64::from(camera.width_px), f64::from(camera.height_px));
        for (x, y) in [(0.0, 0.0), (w, 0.0), (0.0, h), (w, h)] {
            let ray = camera.ray_ecef(x, y);
            if ray.dot(forward) < AHEAD_SHARE_MIN {
                return;
            }
            let u = ray.dot(right) / ray.dot(forward);
            low = low.min(u);
            high = high.max(u);
        }
        self.eye = camera.eye.to_ecef();
        self.axes = DMat3::from_cols(forward, right, up).transpose();
        self.axes_near = [forward, right, up].map(|axis| axis.as_vec3());
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_precision_loss,
            reason = "256, and tangents of angles"
        )]
        let scale = Scale {
            first: low as f32,
            per_unit: (COLUMNS as f64 / (high - low)) as f32,
        };
        self.scale = scale;
        self.is_used = true;
    }

    /// Whether anything can be hidden in this frame.
    #[must_use]
    pub const fn is_used(&self) -> bool {
        self.is_used
    }

    /// Where an origin of bounds is seen from the eye: for [`Self::lattice`].
    #[must_use]
    pub fn offset(&self, origin: DVec3) -> Vec3 {
        (self.axes * (origin - self.eye)).as_vec3()
    }

    /// The lattice of a block's posts; `offset`: of its bound's origin.
    #[must_use]
    pub fn lattice(&self, bound: &Bound, offset: Vec3) -> Lattice {
        let seen = |q: &Quad| Quad {
            x: q.dot(self.axes_near[0]) + offset.x,
            y: q.dot(self.axes_near[1]) + offset.y,
            z: q.dot(self.axes_near[2]) + offset.z,
        };
        let (low, high) = bound.corners();
        let (low, high) = (seen(low), seen(high));
        Lattice {
            low,
            rise: Quad {
                x: high.x - low.x,
                y: high.y - low.y,
                z: high.z - low.z,
            },
            height_min_m: bound.heights_m().0,
            per_metre: 1.0 / (bound.heights_m().1 - bound.heights_m().0).max(1e-3),
            bulge_m: bound.bulge_m(),
        }
    }

    /// Whether all of a block lies behind ground already seen: all of it under its greatest height, or each quarter under
    /// its own.
    pub fn hides(&mut self, lattice: &Lattice, tops_m: &Tops) -> bool {
        if !self.is_used {
            return false;
        }
        let whole = self.sight(&lattice.low, &lattice.at_share(1.0), lattice.bulge_m);
        let Some(whole) = whole else { return false };
        let is_hidden = self.is_behind(whole)
            || (0..4).all(|quarter| {
                let (low, rise) = lattice.quarter(quarter);
                let share = (tops_m[quarter] - lattice.height_min_m) * lattice.per_metre;
                let high = Quad {
                    x: low.x + rise.x * share,
                    y: low.y + rise.y * share,
                    z: low.z + rise.z * share,
                };
                self.sight(&low, &high, lattice.bulge_m)
                    .is_some_and(|sight| self.is_behind(sight))
            });
        if is_hidden {
            let (first, last) = whole.columns;
            for &line in &self.profile.lines[first..=last] {
                if let Some(earned) = self.earned.get_mut(usize::from(line)) {
                    *earned = true;
                }
            }
        }
        is_hidden
    }

    /// What a body takes up between its corners below and above; `None` if not all of it lies ahead.
    fn sight(&self, low: &Quad, high: &Quad, bulge_m: f32) -> Option<Sight> {
        let near = low.x.min(high.x) - bulge_m;
        if near.min_element() < AHEAD_MIN_M {
            return None;
        }
        let slack = bulge_m / near;
        let (u, u_high) = (low.y / low.x, high.y / high.x);
        let left = u.min(u_high);
        let right = u.max(u_high);
        let wide = slack * (Vec4::ONE + left.abs().max(right.abs()));
        // Farthest for what lies below the eye, nearest for what lies above.
        let rise = high.z.max(low.z) + bulge_m;
        let top = (rise / near).max(rise / (low.x.max(high.x) + bulge_m));
        let column = |u: f32| column_of(self.scale.columns(u)).clamp(1, COLUMNS);
        Some(Sight {
            columns: (
                column((left - wide).min_element()),
                column((right + wide).max_element()),
            ),
            top: top.max_element(),
        })
    }

    fn is_behind(&self, sight: Sight) -> bool {
        // What lies beside the picture does not matter.
        let (first, last) = sight.columns;
        let heights = &self.profile.heights[first..=last];
        heights.iter().all(|&height| height > sight.top)
    }

    /// Adds a line of the ground to what has been seen. `height_m`: of its posts, from the first to the `last`, above the
    /// ellipsoid. Whether there was room.
    pub fn add(&mut self, line: &Line, last: u8, height_m: impl Fn(u8) -> f32) -> bool {
        if self.earned.len() == LINES_MAX {
            return false;
        }
        #[expect(clippy::cast_possible_truncation, reason = "below 32 768")]
        let number = self.earned.len() as u16;
        self.earned.push(false);
        let backward = line.runs_left();
        let post = |k: u8| if backward { last - k } else { k };
        let each = 1.0 / f32::from(last);
        let mut walk: Option<Walk> = None;
        for first in (0..=last).step_by(4) {
            let posts = [0, 1, 2, 3].map(|k| post((first + k).min(last)));
            let heights = Vec4::from_array(posts.map(&height_m));
            let at = Vec4::from_array(posts.map(f32::from)) * each;
            let p = line.points(at, heights);
            let near = p.x - line.bulge_m;
            let slack = line.bulge_m / near;
            let (u, v) = (p.y / p.x, p.z / p.x);
            let beside =
                (slack * (u.abs() + 1.0) * self.scale.per_unit + MARGIN_COLUMNS).to_array();
            let v = (v - slack * (v.abs() + 1.0) - MARGIN).to_array();
            let (near, u) = (near.to_array(), u.to_array());
            for k in 0..usize::from(last - first + 1).min(4) {
                if near[k] < AHEAD_MIN_M {
                    walk = None;
                    continue;
                }
                let u = self.scale.columns(u[k]);
                match &mut walk {
                    None => walk = Some(Walk::new(u, v[k], beside[k])),
                    Some(walk) => walk.to(u, v[k], beside[k], number, &mut self.profile),
                }
            }
        }
        true
    }

    /// Of the lines added in this frame, in their order, which have hidden something.
    #[must_use]
    pub fn earned(&self) -> &[bool] {
        &self.earned
    }
}

/// Positions of a block's posts between its corners: (forward, right, up), metres. They leave the true ones by at most the
/// block's bulge.
#[derive(Clone, Copy, Debug)]
pub struct Lattice {
    low: Quad,
    /// From the corners at the lowest height to those at the greatest.
    rise: Quad,
    height_min_m: f32,
    per_metre: f32,
    bulge_m: f32,
}

impl Lattice {
    /// Horizontal distances from the eye, metres, that no point of the block is nearer than, and none farther.
    #[must_use]
    pub fn distances_m(&self) -> (f32, f32) {
        let high = self.at_share(1.0);
        let (x, y) = (self.low.x.element_sum(), self.low.y.element_sum());
        let length = (x * x + y * y).sqrt().max(f32::MIN_POSITIVE);
        let (x, y) = (x / length, y / length);
        let along = |q: &Quad| (q.x * x + q.y * y).min_element();
        let away = |q: &Quad| (q.x * q.x + q.y * q.y).max_element();
        let near = along(&self.low).min(along(&high));
        let far = away(&self.low).max(away(&high)).sqrt();
        ((near - self.bulge_m).max(0.0), far + self.bulge_m)
    }

    /// Whether lines along columns of posts, which run north, tell more than lines along rows: in a view to the east or west.
    #[must_use]
    pub fn prefers_columns(&self) -> bool {
        let across = |a: usize, b: usize| {
            let (x, y) = (self.low.x[b] - self.low.x[a], self.low.y[b] - self.low.y[a]);
            y * y / (x * x + y * y).max(1.0)
        };
        across(0, 2) > across(0, 1)
    }

    /// The corners at a share of the way from the lowest height to the greatest.
    fn at_share(&self, share: f32) -> Quad {
        Quad {
            x: self.low.x + self.rise.x * share,
            y: self.low.y + self.rise.y * share,
            z: self.low.z + self.rise.z * share,
        }
    }

    /// Corners of a quarter at the lowest height, and what rises from them; quarters in the order of corners.
    fn quarter(&self, at: usize) -> (Quad, Quad) {
        // Each corner goes halfway to the one that the quarter is at, in one direction after the other.
        let part = |v: Vec4| {
            let v = if at & 1 == 0 {
                (v + Vec4::new(v.x, v.x, v.z, v.z)) * 0.5
            } else {
                (v + Vec4::new(v.y, v.y, v.w, v.w)) * 0.5
            };
            if at & 2 == 0 {
                (v + Vec4::new(v.x, v.y, v.x, v.y)) * 0.5
            } else {
                (v + Vec4::new(v.z, v.w, v.z, v.w)) * 0.5
            }
        };
        let of = |q: &Quad| Quad {
            x: part(q.x),
            y: part(q.y),
            z: part(q.z),
        };
        (of(&self.low), of(&self.rise))
    }

    /// A line of posts: west to east at a share of the way north, or south to north at a share of the way east.
    #[must_use]
    pub fn line(&self, at: f32, northward: bool) -> Line {
        let corner = |q: &Quad, k: usize| Vec3::new(q.x[k], q.y[k], q.z[k]);
        let between = |q: &Quad, a: usize, b: usize| corner(q, a).lerp(corner(q, b), at);
        let ends = |q: &Quad| {
            if northward {
                (between(q, 0, 1), between(q, 2, 3))
            } else {
                (between(q, 0, 2), between(q, 1, 3))
            }
        };
        let (start, end) = ends(&self.low);
        let (up, up_end) = ends(&self.rise);
        Line {
            start,
            along: end - start,
            up,
            up_along: up_end - up,
            height_min_m: self.height_min_m,
            per_metre: self.per_metre,
            bulge_m: self.bulge_m,
        }
    }
}

/// See [`Lattice::line`].
#[derive(Clone, Copy, Debug)]
pub struct Line {
    start: Vec3,
    along: Vec3,
    up: Vec3,
    up_along: Vec3,
    height_min_m: f32,
    per_metre: f32,
    bulge_m: f32,
}

impl Line {
    /// Its points at shares of the way, at heights above the ellipsoid, metres.
    fn points(&self, at: Vec4, heights_m: Vec4) -> Quad {
        let rise = (heights_m - self.height_min_m) * self.per_metre;
        let axis = |start: f32, along: f32, up: f32, up_along: f32| {
            start + at * along + (at * up_along + up) * rise
        };
        Quad {
            x: axis(self.start.x, self.along.x, self.up.x, self.up_along.x),
            y: axis(self.start.y, self.along.y, self.up.y, self.up_along.y),
            z: axis(self.start.z, self.along.z, self.up.z, self.up_along.z),
        }
    }

    /// Whether it is seen from right to left.
    fn runs_left(&self) -> bool {
        let end = self.start + self.along;
        end.y * self.start.x < self.start.y * end.x
    }
}

/// A line on its way through the columns, from the left to the right.
#[derive(Clone, Copy, Debug)]
struct Walk {
    u: f32,
    v: f32,
    /// How far beside `u` the point may be, columns.
    beside: f32,
    /// The column it is in.
    column: usize,
    /// The lowest it has been since it entered the column.
    low: f32,
    /// Whether it entered by the column's left side; otherwise it began inside.
    has_entered: bool,
}

impl Walk {
    fn new(u: f32, v: f32, beside: f32) -> Self {
        Self {
            u,
            v,
            beside,
            column: column_of(u),
            low: v,
            has_entered: false,
        }
    }

    /// Goes on to a point, and raises the columns that have been crossed. A line that turns back begins anew.
    fn to(&mut self, u: f32, v: f32, beside: f32, line: u16, profile: &mut Profile) {
        let goal = column_of(u);
        if goal < self.column {
            *self = Self::new(u, v, beside);
            return;
        }
        if goal > self.column {
            let slope = (v - self.v) / (u - self.u);
            // As low as it can be where both ends may be beside where they are said to be.
            let drop = slope.abs() * (self.beside + beside);
            #[expect(clippy::cast_precision_loss, reason = "a column")]
            let side = (self.column + 1) as f32;
            let mut crossing = self.v + (side - self.u) * slope - drop;
            if self.has_entered {
                profile.raise(self.column, self.low.min(crossing), line);
            }
            for column in self.column + 1..goal {
                let next = crossing + slope;
                profile.raise(column, crossing.min(next), line);
                crossing = next;
            }
            self.column = goal;
            self.low = crossing;
            self.has_entered = true;
        }
        self.low = self.low.min(v);
        (self.u, self.v, self.beside) = (u, v, beside);
    }
}

/// The column of a place among them; all beyond either side of the picture are one.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "clamped to columns of the picture and those beside it"
)]
fn column_of(u: f32) -> usize {
    u.clamp(0.0, (WITH_SIDES - 1) as f32) as usize
}

#[cfg(test)]
mod tests;
