//! The surface as it is drawn: the triangles that the vertex shader puts out, asked for their height at points of the
//! ground.

use crate::app::error::Failure;
use crate::app::measure::bench::{Bench, refused};
use crate::app::measure::position::cells;
use crate::geo::{Camera, Geodetic, WGS84_B_M};
use crate::gl::terrain::record::Vertex;
use crate::terrain::blocks::{pattern_indices, pattern_numbers};
use crate::terrain::grid::Grid;
use crate::terrain::partition::Partition;
use crate::terrain::scene::LevelPlan;
use glam::DVec3;

/// Side of the squares that points are sorted into, in finest posts.
const SQUARE_POSTS: f64 = 8.0;

/// Points of the ground, sorted for being found under triangles.
#[derive(Debug)]
pub struct Points {
    points: Vec<Geodetic>,
    ecef: Vec<DVec3>,
    /// In the partition that is drawn, and in the one that was.
    placed: [Option<Placed>; 2],
}

/// Points in the posts of a partition.
#[derive(Debug)]
struct Placed {
    partition: Partition,
    grid: Grid,
    at: Vec<(f64, f64)>,
    west: f64,
    south: f64,
    across: usize,
    up: usize,
    /// Points by square, and where each square's begin.
    order: Vec<u32>,
    first: Vec<u32>,
}

/// The surface as drawn at a point of the ground.
#[derive(Clone, Copy, Debug)]
pub struct Drawn {
    /// Height above the ellipsoid, metres, the flatness of triangles made up for.
    pub height_m: f64,
    /// Where it is drawn, from the eye, Earth-centred axes, metres.
    pub from_eye_m: DVec3,
    /// By which level.
    pub level: u8,
}

impl Drawn {
    const NOWHERE: Self = Self {
        height_m: f64::NAN,
        from_eye_m: DVec3::NAN,
        level: 0,
    };
}

/// A corner of a triangle: finest posts east and north, metres above the ellipsoid.
type Corner = DVec3;

impl Points {
    /// For these points; their heights are where they are seen at.
    #[must_use]
    pub fn new(points: Vec<Geodetic>) -> Self {
        let ecef = points.iter().map(Geodetic::to_ecef).collect();
        Self {
            points,
            ecef,
            placed: [None, None],
        }
    }

    /// The points.
    #[must_use]
    pub fn all(&self) -> &[Geodetic] {
        &self.points
    }

    /// How far a point is from the eye, metres, if it is in the picture.
    #[must_use]
    pub fn seen(
        &self,
        at: usize,
        eye: DVec3,
        camera: &Camera,
        to_eye: &glam::DMat3,
    ) -> Option<f64> {
        let to = self.ecef[at] - eye;
        let p = *to_eye * to;
        let f = camera.focal_px();
        let inside = |v: f64, side: u32| (v / -p.z * f).abs() <= f64::from(side) / 2.0;
        (p.z < -0.2 && inside(p.x, camera.width_px) && inside(p.y, camera.height_px))
            .then(|| to.length())
    }

    /// How far beside its vertical a point is drawn, metres; `eye`: Earth-centred.
    #[must_use]
    pub fn beside_m(&self, at: usize, eye: DVec3, drawn: &Drawn) -> f64 {
        let off = eye + drawn.from_eye_m - self.ecef[at];
        let up = -self.points[at].ned_to_ecef().z_axis;
        (off - up * up.dot(off)).length()
    }

    /// The drawn surface at each point; not numbers where no visible block covers it. While one partition fades into another
    /// two surfaces are in the picture: the mean of both, weighted by how opaque they are.
    ///
    /// # Errors
    /// With what the GPU refuses.
    pub fn drawn(&mut self, bench: &mut Bench) -> Result<Vec<Drawn>, Failure> {
        let going = bench.terrain.going();
        let mut out = self.surface(bench, false)?;
        let Some(opacity) = going else {
            return Ok(out);
        };
        for (new, old) in out.iter_mut().zip(self.surface(bench, true)?) {
            new.height_m += (old.height_m - new.height_m) * opacity;
            new.from_eye_m += (old.from_eye_m - new.from_eye_m) * opacity;
        }
        Ok(out)
    }

    /// Of the partition that is drawn, or of the one that is going.
    fn surface(&mut self, bench: &mut Bench, going: bool) -> Result<Vec<Drawn>, Failure> {
        let (terrain, recorder) = bench.recorder()?;
        let mut out = vec![Drawn::NOWHERE; self.points.len()];
        let scene = if going {
            terrain.going_scene()
        } else {
            terrain.scene()
        };
        let Some(scene) = scene else {
            return Ok(out);
        };
        let shape = scene.settings().shape;
        let anchor_m =
            scene.heights().base_m + scene.heights().unit_m * f64::from(scene.plan().anchor_code);
        if self.placed[0].as_ref().map(|p| p.partition) != Some(scene.partition()) {
            self.placed.swap(0, 1);
        }
        let placed = match self.placed[0].take() {
            Some(placed) if placed.partition == scene.partition() => placed,
            _ => Placed::new(&self.points, scene.partition(), scene.grid()),
        };
        let placed = &*self.placed[0].insert(placed);
        let indices = pattern_indices(shape);
        let corners = pattern_numbers(shape);
        let mut each = |level: &LevelPlan, vertices: &[Vertex]| {
            let corner = |v: &Vertex| {
                let [x, y] = v.cell.map(cells);
                DVec3::new(
                    f64::from((level.window.i + x) << level.level),
                    f64::from((level.window.j + y) << level.level),
                    anchor_m + f64::from(v.rise_m),
                )
            };
            for block in vertices.chunks_exact(corners) {
                for t in indices.chunks_exact(3) {
                    let vertices = [0, 1, 2].map(|k| &block[usize::from(t[k])]);
                    placed.under(level.level, vertices, vertices.map(corner), &mut out);
                }
            }
        };
        let recorded = if going {
            terrain.record_going(recorder, &mut each)
        } else {
            terrain.record(recorder, &mut each)
        };
        recorded.map_err(|e| refused(&e))?;
        Ok(out)
    }
}

impl Placed {
    fn new(points: &[Geodetic], partition: Partition, grid: Grid) -> Self {
        let per_degree = f64::from(grid.posts_per_degree);
        let mut near = None;
        let at: Vec<(f64, f64)> = points
            .iter()
            .map(|p| {
                let (lon, lat) =
                    partition.from_geodetic(p.longitude.to_degrees(), p.latitude.to_degrees());
                // Continuous over the date line.
                let near = *near.get_or_insert(lon);
                let lon = lon + 360.0 * ((near - lon) / 360.0_f64).round();
                (lon * per_degree, lat * per_degree)
            })
            .collect();
        let least = |pick: fn(&(f64, f64)) -> f64| at.iter().map(pick).fold(f64::MAX, f64::min);
        let most = |pick: fn(&(f64, f64)) -> f64| at.iter().map(pick).fold(f64::MIN, f64::max);
        let (west, south) = (least(|p| p.0), least(|p| p.1));
        let squares = |low: f64, high: f64| index((high - low).max(0.0) / SQUARE_POSTS) + 1;
        let (across, up) = (squares(west, most(|p| p.0)), squares(south, most(|p| p.1)));
        let square = |p: &(f64, f64)| {
            index((p.1 - south) / SQUARE_POSTS) * across + index((p.0 - west) / SQUARE_POSTS)
        };
        let mut order: Vec<u32> = (0_u32..).take(at.len()).collect();
        order.sort_by_key(|&k| square(&at[k as usize]));
        let mut first = vec![0_u32; across * up + 1];
        for p in &at {
            first[square(p) + 1] += 1;
        }
        for k in 1..first.len() {
            first[k] += first[k - 1];
        }
        Self {
            partition,
            grid,
            at,
            west,
            south,
            across,
            up,
            order,
            first,
        }
    }

    /// Gives the points that lie in a triangle its height and position.
    fn under(&self, level: u8, vertices: [&Vertex; 3], corners: [Corner; 3], out: &mut [Drawn]) {
        let [a, b, c] = corners;
        let area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
        if area <= 0.0 {
            return;
        }
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let across = |v: f64| (v - self.west) / SQUARE_POSTS;
        let up = |v: f64| (v - self.south) / SQUARE_POSTS;
        if across(high.x) < 0.0
            || up(high.y) < 0.0
            || index(across(low.x)) >= self.across
            || index(up(low.y)) >= self.up
        {
            return;
        }
        for y in index(up(low.y))..=index(up(high.y)).min(self.up - 1) {
            for x in index(across(low.x))..=index(across(high.x)).min(self.across - 1) {
                let square = y * self.across + x;
                for &k in &self.order[self.first[square] as usize..self.first[square + 1] as usize]
                {
                    let p = self.at[k as usize];
                    let side = |from: Corner, to: Corner| {
                        (to.x - from.x) * (p.1 - from.y) - (p.0 - from.x) * (to.y - from.y)
                    };
                    let shares = [side(b, c), side(c, a), side(a, b)].map(|s| s / area);
                    if shares.iter().all(|&s| s >= 0.0) {
                        let flat_m: f64 = corners.iter().zip(shares).map(|(v, s)| s * v.z).sum();
                        let at = vertices.iter().zip(shares);
                        out[k as usize] = Drawn {
                            level,
                            height_m: flat_m - self.sag_m(corners, shares),
                            from_eye_m: at
                                .map(|(v, s)| DVec3::from_array(v.position_m.map(f64::from)) * s)
                                .sum(),
                        };
                    }
                }
            }
        }
    }

    /// How far a flat triangle lies below the curved surface through its corners, at the point of these shares, metres.
    fn sag_m(&self, corners: [Corner; 3], shares: [f64; 3]) -> f64 {
        let post_m = WGS84_B_M.to_radians() / f64::from(self.grid.posts_per_degree);
        let latitude = self.grid.latitude_deg(0, cells_of(corners[0].y));
        let narrow = latitude.to_radians().cos();
        let squared = |k: usize, l: usize| {
            let e = (corners[k] - corners[l]) * post_m;
            (e.x * narrow).powi(2) + e.y.powi(2)
        };
        let pairs = [(0, 1), (1, 2), (2, 0)];
        pairs
            .iter()
            .map(|&(k, l)| shares[k] * shares[l] * squared(k, l))
            .sum::<f64>()
            / (2.0 * WGS84_B_M)
    }
}

/// The number of a square; those before the first one are the first one.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "float casts saturate"
)]
fn index(v: f64) -> usize {
    v as usize
}

#[expect(clippy::cast_possible_truncation, reason = "a post number on Earth")]
fn cells_of(v: f64) -> i32 {
    v as i32
}
