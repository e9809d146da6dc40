//! The valleys of the demo terrain: where they run, and what they make of the mountains around them.

use crate::terrain::synth::{HEIGHT_KM, WIDTH_KM};
use crate::terrain::synth_noise::{signed, smooth_step};

/// Where the main valley runs from west to east, as shares of the terrain's size; each is moved a little by the seed.
const MAIN: [(f64, f64); 10] = [
    (-0.12, 0.40),
    (0.0, 0.42),
    (0.13, 0.40),
    (0.26, 0.47),
    (0.38, 0.57),
    (0.50, 0.53),
    (0.62, 0.43),
    (0.75, 0.46),
    (0.88, 0.57),
    (1.0, 0.60),
];
/// One more, beyond the eastern edge.
const MAIN_END: (f64, f64) = (1.12, 0.58);

/// Pieces between two points of the main valley; about half a kilometre each.
const PIECES: u32 = 24;

/// Half the width of the flat floor of the main valley, km.
const MAIN_FLOOR_KM: f64 = 1.9;
/// From the floor's edge to where the mountains stand unhindered, km.
const MAIN_WALL_KM: f64 = 5.5;
const SIDE_WALL_KM: f64 = 3.8;
const BRANCH_WALL_KM: f64 = 2.6;

/// Height of the lake, and of the floor around it, metres.
const LAKE_M: f64 = 600.0;
/// Where the lake lies along the main valley, and its greatest half width, km.
const LAKE_KM: (f64, f64) = (45.0, 62.0);
const LAKE_HALF_WIDTH_KM: f64 = 1.15;
/// Where the airfield lies along the main valley, km.
const AIRFIELD_ALONG_KM: f64 = 36.0;

/// Side valleys: where they leave the main valley (km along it), to which side (1 is left of east), how long (km).
const SIDES: [(f64, f64, f64); 12] = [
    (21.0, 1.0, 27.0),
    (24.5, -1.0, 24.0),
    (31.0, 1.0, 29.0),
    (38.5, -1.0, 31.0),
    (43.0, 1.0, 25.0),
    (50.0, -1.0, 28.0),
    (54.0, 1.0, 31.0),
    (61.0, -1.0, 24.0),
    (65.5, 1.0, 29.0),
    (71.0, -1.0, 27.0),
    (76.0, 1.0, 24.0),
    (80.5, -1.0, 25.0),
];

/// Branches of a side valley: where they leave it (share of its length), to which side, how long (km).
const BRANCHES: [(f64, f64, f64); 4] = [
    (0.22, 1.0, 7.5),
    (0.36, -1.0, 8.5),
    (0.55, 1.0, 8.0),
    (0.70, -1.0, 6.5),
];

/// A point on the main valley's centreline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CoursePoint {
    pub(crate) x: f64,
    pub(crate) y: f64,
    /// Distance from the western edge, km.
    pub(crate) along: f64,
    pub(crate) floor_m: f64,
    /// East and north, length 1.
    pub(crate) direction: (f64, f64),
}

/// One end of a piece.
#[derive(Clone, Copy, Debug)]
struct End {
    x: f64,
    y: f64,
    along: f64,
    floor_m: f64,
    floor_km: f64,
}

/// A straight piece of a valley.
#[derive(Clone, Copy, Debug)]
struct Piece {
    /// Which valley it is of; 0 is the main one.
    valley: u16,
    ax: f64,
    ay: f64,
    dx: f64,
    dy: f64,
    /// Of (dx, dy), squared.
    length2: f64,
    /// At both ends: distance along the valley, floor height, half width of the floor.
    along: (f64, f64),
    floor_m: (f64, f64),
    floor_km: (f64, f64),
    wall_km: f64,
}

/// All valleys of a seed.
#[derive(Debug)]
pub(crate) struct Course {
    main: Vec<CoursePoint>,
    pieces: Vec<Piece>,
    airfield: CoursePoint,
}

/// The pieces near a place.
#[derive(Debug)]
pub(crate) struct Near(Vec<Piece>);

/// What the valleys make of a place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shape {
    pub(crate) height_m: f64,
    /// 0 on a valley floor, 1 where no valley reaches.
    pub(crate) mask: f64,
    /// 0 on the lake, 1 away from it.
    pub(crate) off_lake: f64,
    /// Distance from the lake's smooth outline, negative inside, km; `None` far from it.
    pub(crate) shore_km: Option<f64>,
}

impl Course {
    pub(crate) fn new(seed: u64) -> Self {
        let main = main_course(seed);
        let mut pieces = Vec::new();
        for pair in main.windows(2) {
            let (a, b) = (&pair[0], &pair[1]);
            let end = |p: &CoursePoint| End {
                x: p.x,
                y: p.y,
                along: p.along,
                floor_m: p.floor_m,
                floor_km: floor_half_width_km(p.along, seed),
            };
            pieces.push(Piece::new(0, MAIN_WALL_KM, &end(a), &end(b)));
        }
        let mut number = 0;
        for (leaves, side, length_km) in SIDES {
            let start = at_along(&main, leaves);
            let trunk = Tributary {
                start,
                side,
                length_km,
                head_m: 1500.0,
                floor_km: 0.5,
                wall_km: SIDE_WALL_KM,
            };
            number += 1;
            let ends = trunk.run(number, seed, &mut pieces);
            for (share, side, length_km) in BRANCHES {
                let branch = Tributary {
                    start: at_along(&ends, share * trunk.length_km),
                    side,
                    length_km,
                    head_m: 1950.0,
                    floor_km: 0.12,
                    wall_km: BRANCH_WALL_KM,
                };
                number += 1;
                branch.run(number, seed, &mut pieces);
            }
        }
        let airfield = at_along(&main, AIRFIELD_ALONG_KM);
        Self {
            main,
            pieces,
            airfield,
        }
    }

    pub(crate) fn airfield(&self) -> CoursePoint {
        self.airfield
    }

    pub(crate) fn lake_m(&self) -> f64 {
        LAKE_M
    }

    /// The centreline within the terrain.
    pub(crate) fn main_points(&self) -> impl Iterator<Item = &CoursePoint> {
        self.main.iter().filter(|p| (0.0..=WIDTH_KM).contains(&p.x))
    }

    /// The pieces that can matter within `radius` km of a place.
    pub(crate) fn near(&self, x: f64, y: f64, radius: f64) -> Near {
        let matters = |p: &&Piece| {
            let reach = p.floor_km.0.max(p.floor_km.1) + p.wall_km + radius;
            p.nearest(x, y).0 < reach
        };
        Near(self.pieces.iter().filter(matters).copied().collect())
    }

    /// The mountains, of height `crest_m` here, cut by the valleys.
    pub(crate) fn shape(&self, near: &Near, x: f64, y: f64, crest_m: f64) -> Shape {
        let mut shape = Shape {
            height_m: crest_m,
            mask: 1.0,
            off_lake: 1.0,
            shore_km: None,
        };
        for pieces in near.0.chunk_by(|a, b| a.valley == b.valley) {
            // The nearest piece of each valley speaks for it; the deepest valley is the terrain.
            let nearest = pieces
                .iter()
                .map(|piece| (piece, piece.nearest(x, y)))
                .min_by(|a, b| a.1.0.total_cmp(&b.1.0));
            let Some((piece, (distance, share))) = nearest else {
                continue;
            };
            let mix = |ends: (f64, f64)| ends.0 + (ends.1 - ends.0) * share;
            let floor_m = mix(piece.floor_m);
            let mask = wall((distance - mix(piece.floor_km)) / piece.wall_km);
            let height_m = floor_m + (crest_m.max(floor_m) - floor_m) * mask;
            shape.height_m = shape.height_m.min(height_m);
            shape.mask = shape.mask.min(mask);
            if piece.valley == 0 {
                shape.add_lake(distance, mix(piece.along));
            }
        }
        shape
    }
}

impl Shape {
    fn add_lake(&mut self, distance_km: f64, along_km: f64) {
        const REACH_KM: f64 = 1.0;
        let middle = (LAKE_KM.0 + LAKE_KM.1) / 2.0;
        let half = (LAKE_KM.1 - LAKE_KM.0) / 2.0;
        let u = (along_km - middle) / half;
        // An oval with blunt ends, whose outline goes on as a distance past them.
        let u4 = u * u * u * u;
        let half_width = if u4 < 1.0 {
            LAKE_HALF_WIDTH_KM * (1.0 - u4).sqrt()
        } else {
            -half * (u.abs() - 1.0)
        };
        let shore = distance_km - half_width;
        if shore < REACH_KM {
            self.shore_km = Some(self.shore_km.map_or(shore, |s: f64| s.min(shore)));
            let off = smooth_step(0.0, REACH_KM, shore);
            self.off_lake = self.off_lake.min(off);
        }
    }
}

/// A U-shaped valley's wall: 0 on the floor, a short foot, steep, then rounding off to 1.
fn wall(t: f64) -> f64 {
    if t <= 0.0 {
        return 0.0;
    }
    let t = (t * t / (t + 0.12) * 1.12).min(1.0);
    1.0 - (1.0 - t) * (1.0 - t)
}

impl Piece {
    fn new(valley: u16, wall_km: f64, a: &End, b: &End) -> Self {
        let (dx, dy) = (b.x - a.x, b.y - a.y);
        Self {
            valley,
            ax: a.x,
            ay: a.y,
            dx,
            dy,
            length2: (dx * dx + dy * dy).max(1e-12),
            along: (a.along, b.along),
            floor_m: (a.floor_m, b.floor_m),
            floor_km: (a.floor_km, b.floor_km),
            wall_km,
        }
    }

    /// Distance to the piece, and where along it the nearest point is, 0 to 1.
    fn nearest(&self, x: f64, y: f64) -> (f64, f64) {
        let (px, py) = (x - self.ax, y - self.ay);
        let share = ((px * self.dx + py * self.dy) / self.length2).clamp(0.0, 1.0);
        let (ex, ey) = (px - share * self.dx, py - share * self.dy);
        ((ex * ex + ey * ey).sqrt(), share)
    }
}

/// Half the width of the main floor, wider here and narrower there.
fn floor_half_width_km(along_km: f64, seed: u64) -> f64 {
    let n = crate::terrain::synth_noise::gradient(along_km / 9.0, 0.37, seed ^ 0x77);
    MAIN_FLOOR_KM + 0.35 * n
}

/// The main valley: a Catmull-Rom spline through its points.
fn main_course(seed: u64) -> Vec<CoursePoint> {
    let mut points: Vec<(f64, f64)> = Vec::new();
    for (number, (x, y)) in (0..).zip(MAIN.into_iter().chain([MAIN_END])) {
        let moved = 0.015 * signed(number, 0, seed ^ 0x6a1e);
        points.push((x * WIDTH_KM, (y + moved) * HEIGHT_KM));
    }
    let mut places: Vec<(f64, f64)> = Vec::new();
    for four in points.windows(4) {
        for piece in 0..PIECES {
            let t = f64::from(piece) / f64::from(PIECES);
            places.push((
                spline(four[0].0, four[1].0, four[2].0, four[3].0, t),
                spline(four[0].1, four[1].1, four[2].1, four[3].1, t),
            ));
        }
    }
    if let [.., last, _] = points.as_slice() {
        places.push(*last);
    }
    let mut course: Vec<CoursePoint> = Vec::new();
    let mut along = 0.0;
    for (at, (x, y)) in places.iter().enumerate() {
        let before = places[at.saturating_sub(1)];
        let after = places[(at + 1).min(places.len() - 1)];
        let step = length(x - before.0, y - before.1);
        along += step;
        let (dx, dy) = (after.0 - before.0, after.1 - before.1);
        let norm = length(dx, dy).max(1e-12);
        course.push(CoursePoint {
            x: *x,
            y: *y,
            along,
            floor_m: floor_m(along),
            direction: (dx / norm, dy / norm),
        });
    }
    course
}

/// Catmull and Rom 1974, uniform: through `b` at t = 0 and `c` at t = 1.
fn spline(a: f64, b: f64, c: f64, d: f64, t: f64) -> f64 {
    let t2 = t * t;
    0.5 * (2.0 * b
        + (c - a) * t
        + (2.0 * a - 5.0 * b + 4.0 * c - d) * t2
        + (3.0 * b - a - 3.0 * c + d) * t2 * t)
}

/// The floor falls from 650 m in the west to the lake and on to 560 m in the east.
fn floor_m(along_km: f64) -> f64 {
    const RIM_M: f64 = 4.0;
    let (from, to) = LAKE_KM;
    if along_km < from {
        LAKE_M + RIM_M + 46.0 * (from - along_km) / from
    } else if along_km > to {
        LAKE_M + RIM_M - 44.0 * ((along_km - to) / 45.0).min(1.0)
    } else {
        LAKE_M + RIM_M
    }
}

fn at_along(main: &[CoursePoint], along_km: f64) -> CoursePoint {
    let at = main.partition_point(|p| p.along < along_km);
    main[at.min(main.len() - 1)]
}

/// A side valley, or a branch of one.
struct Tributary {
    /// The point of the valley that it leaves.
    start: CoursePoint,
    /// 1 to the left of that valley, -1 to the right.
    side: f64,
    length_km: f64,
    /// Height of the floor at its head, before the seed changes it, metres.
    head_m: f64,
    /// Half width of the floor at its mouth, km.
    floor_km: f64,
    wall_km: f64,
}

impl Tributary {
    /// Half-kilometre pieces that wander away and climb, slowly first; returns its points.
    fn run(&self, number: u16, seed: u64, pieces: &mut Vec<Piece>) -> Vec<CoursePoint> {
        const STEP_KM: f64 = 0.5;
        let (tx, ty) = self.start.direction;
        let (nx, ny) = (-ty * self.side, tx * self.side);
        let head_m = self.head_m + 250.0 * signed(i64::from(number), 1, seed ^ 0x51de);
        let climb_m = (head_m - self.start.floor_m).max(100.0);
        let mut points: Vec<CoursePoint> = Vec::new();
        let (mut x, mut y, mut along) = (self.start.x, self.start.y, 0.0);
        while along <= self.length_km {
            // Across the other valley first, then drifting with it; both bends are of the seed.
            let drift = crate::terrain::synth_noise::gradient(
                along / 6.0,
                f64::from(number) + 0.5,
                seed ^ 0x51d3,
            );
            let bend = 0.25 + 1.0 * drift * smooth_step(0.0, 4.0, along);
            let (dx, dy) = (nx + tx * bend, ny + ty * bend);
            let norm = length(dx, dy);
            let share = along / self.length_km;
            points.push(CoursePoint {
                x,
                y,
                along,
                floor_m: self.start.floor_m + climb_m * share * (0.35 + 0.65 * share),
                direction: (dx / norm, dy / norm),
            });
            x += dx / norm * STEP_KM;
            y += dy / norm * STEP_KM;
            along += STEP_KM;
        }
        // Wide at its mouth, a gully at its head.
        let end = |p: &CoursePoint| End {
            x: p.x,
            y: p.y,
            along: p.along,
            floor_m: p.floor_m,
            floor_km: self.floor_km * (1.0 - 0.9 * p.along / self.length_km),
        };
        for pair in points.windows(2) {
            pieces.push(Piece::new(
                number,
                self.wall_km,
                &end(&pair[0]),
                &end(&pair[1]),
            ));
        }
        points
    }
}

fn length(dx: f64, dy: f64) -> f64 {
    (dx * dx + dy * dy).sqrt()
}
