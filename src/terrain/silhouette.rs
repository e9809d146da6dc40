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
//! shows is ever left out, and no picture depends on this.

use super::cull::Bound;
use crate::geo::Camera;
use glam::{DMat3, DVec2, DVec3};

/// Columns across the picture: some pixels each.
const COLUMNS: usize = 256;

/// Points nearer than this ahead say nothing about what is hidden, metres.
const AHEAD_MIN_M: f64 = 5.0;

/// Lines count this much lower than they are, up / forward: a tenth of a pixel, thousands of times the shader's rounding.
const MARGIN: f64 = 1e-4;

/// A picture whose corners do not look ahead by at least this share is not treated: straight down nothing hides much.
const AHEAD_SHARE_MIN: f64 = 0.1;

/// See the module.
#[derive(Debug)]
pub struct Silhouette {
    eye: DVec3,
    /// From Earth-centred axes to (forward, right, up).
    axes: DMat3,
    /// The first column's side, right / forward, and columns for each unit of it.
    first: f64,
    per_unit: f64,
    heights: [f64; COLUMNS],
    is_used: bool,
}

/// The greatest heights of the four quarters of a block, metres: rows from the south, each from the west.
pub type Tops = [[f32; 2]; 2];

/// The directions that something takes up: right / forward from left to right, and the top, up / forward.
#[derive(Clone, Copy, Debug)]
struct Sight {
    left: f64,
    right: f64,
    top: f64,
}

impl Sight {
    const NONE: Self = Self {
        left: f64::INFINITY,
        right: f64::NEG_INFINITY,
        top: f64::NEG_INFINITY,
    };

    /// Grows to a point and all within `bulge_m` of it. Whether that lies ahead.
    fn take(&mut self, p: DVec3, bulge_m: f64) -> bool {
        let near = p.x - bulge_m;
        if near < AHEAD_MIN_M {
            return false;
        }
        let u = p.y / p.x;
        let slack = bulge_m * (1.0 + u.abs()) / near;
        let rise = p.z + bulge_m;
        let top = rise / if rise > 0.0 { near } else { p.x + bulge_m };
        self.left = self.left.min(u - slack);
        self.right = self.right.max(u + slack);
        self.top = self.top.max(top);
        true
    }
}

impl Default for Silhouette {
    /// One that hides nothing.
    fn default() -> Self {
        Self {
            eye: DVec3::ZERO,
            axes: DMat3::IDENTITY,
            first: 0.0,
            per_unit: 1.0,
            heights: [f64::NEG_INFINITY; COLUMNS],
            is_used: false,
        }
    }
}

impl Silhouette {
    /// Begins a frame with nothing seen. `is_above_ground`: whether the eye is known to be above what is drawn under it;
    /// where it is not, or the camera looks too steeply, nothing will be hidden.
    pub fn begin(&mut self, camera: &Camera, is_above_ground: bool) {
        self.heights = [f64::NEG_INFINITY; COLUMNS];
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
        self.first = low;
        #[expect(clippy::cast_precision_loss, reason = "256")]
        let columns = COLUMNS as f64;
        self.per_unit = columns / (high - low);
        self.is_used = true;
    }

    /// Whether anything can be hidden in this frame.
    #[must_use]
    pub const fn is_used(&self) -> bool {
        self.is_used
    }

    /// Whether lines along columns of posts, which run north, tell more than lines along rows: in a view to the east or west.
    #[must_use]
    pub fn prefers_columns(&self, bound: &Bound) -> bool {
        let [sw, se, nw, ..] = bound.corners();
        let across = |line: DVec3| (self.axes * line).y.abs() / line.length().max(1.0);
        across(*nw - *sw) > across(*se - *sw)
    }

    /// Whether all of a block lies behind ground already seen, under its greatest height.
    #[must_use]
    pub fn hides(&self, lattice: &Lattice, bulge_m: f64) -> bool {
        let mut sight = Sight::NONE;
        self.is_used
            && lattice.corners.iter().all(|&c| sight.take(c, bulge_m))
            && self.is_behind(&sight)
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "clamped to columns of the picture"
    )]
    fn is_behind(&self, sight: &Sight) -> bool {
        // What lies beside the picture does not matter.
        let column =
            |u: f64| ((u - self.first) * self.per_unit).clamp(0.0, (COLUMNS - 1) as f64) as usize;
        self.heights[column(sight.left)..=column(sight.right)]
            .iter()
            .all(|&height| height > sight.top)
    }

    /// Whether all quarters of a block lie behind ground already seen, each under its own top.
    #[must_use]
    pub fn hides_parts(&self, lattice: &Lattice, tops_m: &Tops, bulge_m: f64) -> bool {
        if !self.is_used {
            return false;
        }
        let share = |k: usize| [0.0, 0.5, 1.0][k];
        for (row, tops) in tops_m.iter().enumerate() {
            let sides = [row, row + 1].map(|k| lattice.line(share(k), false));
            for (column, &top_m) in tops.iter().enumerate() {
                let mut sight = Sight::NONE;
                for side in &sides {
                    for k in [column, column + 1] {
                        if !sight.take(side.point(share(k), f64::from(top_m)), bulge_m) {
                            return false;
                        }
                    }
                }
                if !self.is_behind(&sight) {
                    return false;
                }
            }
        }
        true
    }

    /// Adds a line of the ground, given by its points as [`Line::point`] makes them, to what has been seen.
    pub fn add(&mut self, points: impl Iterator<Item = DVec3>, bulge_m: f64) {
        let mut walk: Option<Walk> = None;
        for p in points {
            if p.x < AHEAD_MIN_M {
                walk = None;
                continue;
            }
            let inverse = 1.0 / p.x;
            let u = (p.y * inverse - self.first) * self.per_unit;
            let v = (p.z - bulge_m) * inverse - MARGIN;
            match &mut walk {
                None => walk = Some(Walk::new(u, v)),
                Some(walk) => walk.to(u, v, &mut self.heights),
            }
        }
    }

    /// The lattice of a block's posts, for lines.
    #[must_use]
    pub fn lattice(&self, bound: &Bound) -> Lattice {
        Lattice {
            corners: bound.corners().map(|c| self.axes * (c - self.eye)),
            height_min_m: bound.heights_m().0,
            per_metre: 1.0 / (bound.heights_m().1 - bound.heights_m().0).max(1e-3),
        }
    }
}

/// Positions of a block's posts, between its corners. They leave the true ones by at most the block's bulge.
#[derive(Clone, Copy, Debug)]
pub struct Lattice {
    corners: [DVec3; 8],
    height_min_m: f64,
    per_metre: f64,
}

impl Lattice {
    /// Horizontal distances from the eye, metres, that no point of the block is nearer than, and none farther.
    #[must_use]
    pub fn distances_m(&self, bulge_m: f64) -> (f64, f64) {
        let flat = self.corners.map(DVec3::truncate);
        let middle = flat.iter().sum::<DVec2>().normalize_or_zero();
        let near = flat
            .iter()
            .map(|c| c.dot(middle))
            .fold(f64::INFINITY, f64::min);
        let far = flat.iter().map(|c| c.length()).fold(0.0, f64::max);
        (near - bulge_m, far + bulge_m)
    }

    /// A line of posts: east to west at a share of the way north, or south to north at a share of the way east.
    #[must_use]
    pub fn line(&self, at: f64, northward: bool) -> Line {
        let c = &self.corners;
        let between = |a: usize, b: usize| c[a] + (c[b] - c[a]) * at;
        let (a, b) = if northward {
            ((0, 1), (2, 3))
        } else {
            ((0, 2), (1, 3))
        };
        let (start, end) = (between(a.0, a.1), between(b.0, b.1));
        let (start_high, end_high) = (between(a.0 + 4, a.1 + 4), between(b.0 + 4, b.1 + 4));
        Line {
            start,
            along: end - start,
            up: start_high - start,
            up_along: end_high - end - (start_high - start),
            height_min_m: self.height_min_m,
            per_metre: self.per_metre,
        }
    }
}

/// See [`Lattice::line`].
#[derive(Clone, Copy, Debug)]
pub struct Line {
    start: DVec3,
    along: DVec3,
    up: DVec3,
    up_along: DVec3,
    height_min_m: f64,
    per_metre: f64,
}

impl Line {
    /// (forward, right, up) of its point at a share of the way, at a height above the ellipsoid, metres.
    #[must_use]
    pub fn point(&self, at: f64, height_m: f64) -> DVec3 {
        let rise = (height_m - self.height_min_m) * self.per_metre;
        self.start + self.along * at + (self.up + self.up_along * at) * rise
    }
}

/// A line on its way through the columns.
#[derive(Clone, Copy, Debug)]
struct Walk {
    u: f64,
    v: f64,
    /// The column it is in.
    column: i32,
    /// The lowest it has been since it entered the column.
    low: f64,
    /// From which side it entered: 1 from the left, -1 from the right, 0 if it began inside.
    entered: i32,
}

impl Walk {
    fn new(u: f64, v: f64) -> Self {
        Self {
            u,
            v,
            column: column_of(u),
            low: v,
            entered: 0,
        }
    }

    /// Goes on to a point, and raises the columns that have been crossed.
    fn to(&mut self, u: f64, v: f64, heights: &mut [f64; COLUMNS]) {
        let goal = column_of(u);
        let step = (goal - self.column).signum();
        if step == 0 {
            self.low = self.low.min(v);
            (self.u, self.v) = (u, v);
            return;
        }
        let slope = (v - self.v) / (u - self.u);
        while self.column != goal {
            let side = f64::from(if step > 0 {
                self.column + 1
            } else {
                self.column
            });
            let crossing = self.v + (side - self.u) * slope;
            self.low = self.low.min(crossing);
            if self.entered == step
                && let Some(height) = usize::try_from(self.column)
                    .ok()
                    .and_then(|c| heights.get_mut(c))
            {
                *height = height.max(self.low);
            }
            self.entered = step;
            self.low = crossing;
            self.column += step;
        }
        self.low = self.low.min(v);
        (self.u, self.v) = (u, v);
    }
}

/// The column of a direction; all beyond either side of the picture are one.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_precision_loss,
    reason = "clamped to columns of the picture and one beside it"
)]
fn column_of(u: f64) -> i32 {
    u.floor().clamp(-1.0, COLUMNS as f64) as i32
}
