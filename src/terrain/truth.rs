//! What a perfect picture would show: rays cast in f64 through the bilinear surface of the finest posts, on the WGS 84
//! ellipsoid. For measuring; nothing here flies.
//!
//! A [`Field`] holds the finest posts around an eye, as the source has them, with a pyramid of their maxima. In post
//! coordinates and height a straight line is a smooth curve; it is followed by cubic pieces of 12 km, which keep it to
//! 1e-5 m, and halved until it is above the maxima of the posts it passes, or shorter than half a post. There the
//! crossing with each bilinear patch is the first root of a quadratic, so that no ridge is stepped over.

use super::codec::{SurfaceKind, Tile};
use super::grid::{Grid, TILE_SIDE, TileKey};
use super::pack::TileReader;
use super::partition::Partition;
use super::surface::TileSource;
use crate::geo::{Geodetic, WGS84_B_M};
use crate::units::Radians;
use glam::DVec3;

/// Length of a cubic piece, metres.
const PIECE_M: f64 = 12_000.0;
/// Posts a side of a field at most: 64 MB of heights.
const SIDE_MAX: usize = 4000;

/// What a ray meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cast {
    /// The ground, at this distance in metres.
    Hit(f64),
    /// Nothing.
    Sky,
    /// It leaves the field without having met anything.
    Left,
}

/// The ground at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ground {
    /// Height above the ellipsoid, metres.
    pub height_m: f64,
    /// Whether all four posts it rests on were measured.
    pub measured: bool,
}

/// The finest posts of a partition within a square.
#[derive(Debug)]
pub struct Field {
    partition: Partition,
    grid: Grid,
    west: i32,
    south: i32,
    side: usize,
    heights: Vec<f32>,
    measured: Vec<bool>,
    /// Maxima of squares of 2^k cells, k from 0.
    maxima: Vec<Vec<f32>>,
    centre_deg: f64,
}

/// A point in post coordinates, from the field's south-west post, and height above the ellipsoid in metres.
type Place = DVec3;

impl Field {
    /// The posts within `reach_m` of a point, or as many as there is room for.
    #[must_use]
    pub fn load<S: TileSource>(
        source: &S,
        partition: Partition,
        eye: &Geodetic,
        reach_m: f64,
    ) -> Self {
        let grid = source.info().grid;
        let (lon, lat) =
            partition.from_geodetic(eye.longitude.to_degrees(), eye.latitude.to_degrees());
        let per_degree = f64::from(grid.posts_per_degree);
        let spacing_m = WGS84_B_M.to_radians() / per_degree;
        let narrow = lat.to_radians().cos().max(0.05);
        let side = count(2.0 * reach_m / (spacing_m * narrow)).min(SIDE_MAX);
        let first = |degrees: f64| whole((degrees * per_degree).round()) - signed(side / 2);
        let mut field = Self {
            partition,
            grid,
            west: first(lon),
            south: first(lat),
            side,
            heights: vec![0.0; side * side],
            measured: vec![false; side * side],
            maxima: Vec::new(),
            centre_deg: lon,
        };
        field.read(source);
        field.undulate(source);
        field.stack();
        field
    }

    /// Posts a side.
    #[must_use]
    pub const fn side(&self) -> usize {
        self.side
    }

    /// Column and row of the south-west post, finest level.
    #[must_use]
    pub const fn origin(&self) -> (i32, i32) {
        (self.west, self.south)
    }

    /// Distance between posts northwards, metres.
    #[must_use]
    pub fn spacing_m(&self) -> f64 {
        WGS84_B_M.to_radians() / f64::from(self.grid.posts_per_degree)
    }

    /// The bilinear surface at a point; `None` outside the field.
    #[must_use]
    pub fn ground(&self, at: &Geodetic) -> Option<Ground> {
        let p = self.place(at);
        let limit = double(self.side - 1);
        if !(0.0..limit).contains(&p.x) || !(0.0..limit).contains(&p.y) {
            return None;
        }
        let (i, j) = (floor(p.x), floor(p.y));
        Some(Ground {
            height_m: self.patch(i, j, p.x - double(i), p.y - double(j)),
            measured: [(0, 0), (1, 0), (0, 1), (1, 1)]
                .iter()
                .all(|(di, dj)| self.measured[(j + dj) * self.side + i + di]),
        })
    }

    /// Whether every post within `cells` posts of a point was measured.
    #[must_use]
    pub fn measured_around(&self, at: &Geodetic, cells: usize) -> bool {
        let p = self.place(at);
        let span = |v: f64| {
            (
                floor(v.max(0.0)).saturating_sub(cells),
                floor(v.max(0.0)) + cells + 1,
            )
        };
        let ((i0, i1), (j0, j1)) = (span(p.x), span(p.y));
        let corners = [(i0, j0), (i1, j0), (i0, j1), (i1, j1)];
        p.x >= 0.0
            && p.y >= 0.0
            && i1 < self.side
            && j1 < self.side
            && corners
                .iter()
                .all(|&(i, j)| self.measured[j * self.side + i])
    }

    /// Height above the ellipsoid and place of every measured post that none of its eight neighbours is higher than, and
    /// that is `rise_m` higher than the lowest post `around` posts away in one of eight directions.
    #[must_use]
    pub fn summits(&self, around: usize, rise_m: f64) -> Vec<Geodetic> {
        let mut out = Vec::new();
        let edge = around.max(1);
        let post = |i: usize, j: usize| f64::from(self.heights[j * self.side + i]);
        for j in edge..self.side - edge {
            for i in edge..self.side - edge {
                let own = post(i, j);
                let ring = |r: usize| {
                    [
                        (0, 0),
                        (0, r),
                        (0, 2 * r),
                        (r, 0),
                        (r, 2 * r),
                        (2 * r, 0),
                        (2 * r, r),
                        (2 * r, 2 * r),
                    ]
                    .map(|(di, dj)| post(i + di - r, j + dj - r))
                };
                if self.measured[j * self.side + i]
                    && ring(1).iter().all(|&h| h <= own)
                    && ring(edge).iter().all(|&h| h < own - rise_m)
                {
                    out.push(self.post(i, j));
                }
            }
        }
        out
    }

    /// A post as a point of the ground.
    fn post(&self, i: usize, j: usize) -> Geodetic {
        let lon = self.grid.longitude_deg(0, self.west + signed(i));
        let lat = self.grid.latitude_deg(0, self.south + signed(j));
        let (lon, lat) = self.partition.to_geodetic(lon, lat);
        Geodetic::from_degrees(lat, lon, f64::from(self.heights[j * self.side + i]))
    }

    /// Angle in degrees between the stored normal of a post (east, north, up in the grid's directions) and the normal of
    /// the surface through its four neighbours; `None` on the field's edge and where something was not measured.
    #[must_use]
    pub fn normal_error_deg(&self, (i, j): (i32, i32), stored: DVec3) -> Option<f64> {
        let (x, y) = (
            usize::try_from(i - self.west).ok()?,
            usize::try_from(j - self.south).ok()?,
        );
        if x == 0 || y == 0 || x + 1 >= self.side || y + 1 >= self.side {
            return None;
        }
        let known = |x: usize, y: usize| self.measured[y * self.side + x];
        if !(known(x, y)
            && known(x - 1, y)
            && known(x + 1, y)
            && known(x, y - 1)
            && known(x, y + 1))
        {
            return None;
        }
        let at = |x: usize, y: usize| self.post(x, y).to_ecef();
        let normal = (at(x + 1, y) - at(x - 1, y))
            .cross(at(x, y + 1) - at(x, y - 1))
            .normalize();
        let (lon, lat) = (self.grid.longitude_deg(0, i), self.grid.latitude_deg(0, j));
        let up = self.partition.normal(lon, lat);
        let east = (self.partition.normal(lon + 1e-4, lat)
            - self.partition.normal(lon - 1e-4, lat))
        .normalize();
        let north = up.cross(east);
        let drawn = (east * stored.x + north * stored.y + up * stored.z).normalize();
        Some(
            drawn
                .cross(normal)
                .length()
                .atan2(drawn.dot(normal))
                .to_degrees(),
        )
    }

    /// What a ray from `eye` (Earth-centred, metres) in a unit direction meets.
    #[must_use]
    pub fn cast(&self, eye: DVec3, direction: DVec3) -> Cast {
        let top = f64::from(*self.maxima.last().and_then(|m| m.first()).unwrap_or(&0.0));
        let limit = double(self.side - 1);
        let place = |t: f64| self.place(&Geodetic::from_ecef(eye + direction * t));
        let mut start = 0.0;
        let mut first = place(0.0);
        loop {
            let knots = [1.0, 2.0, 3.0].map(|k| place(start + k * PIECE_M / 3.0));
            let piece = Piece {
                start,
                knots: [first, knots[0], knots[1], knots[2]],
            };
            if let Some(t) = self.halve(&piece, (0.0, first), (1.0, knots[2])) {
                return Cast::Hit(start + t * PIECE_M);
            }
            let last = knots[2];
            // Height along a straight line is convex: once it rises it goes on rising.
            if last.z > top && last.z > knots[1].z {
                return Cast::Sky;
            }
            let inside = (0.0..limit).contains(&last.x) && (0.0..limit).contains(&last.y);
            if !inside {
                return if first.z > top && last.z > top && last.z > first.z {
                    Cast::Sky
                } else {
                    Cast::Left
                };
            }
            start += PIECE_M;
            first = last;
        }
    }

    /// The first crossing between two points of a piece, as a share of the piece.
    fn halve(&self, piece: &Piece, a: (f64, Place), b: (f64, Place)) -> Option<f64> {
        let length = (b.0 - a.0) * PIECE_M;
        let sag = length * length / (8.0 * WGS84_B_M);
        let (low, high) = (a.1.min(b.1), a.1.max(b.1));
        // How far the curve may bulge beside its chord, in posts; 16 covers the narrowing of the grid up to 75 degrees.
        let pad = 16.0 * sag / self.spacing_m() + 1e-6;
        let limit = double(self.side - 1);
        if high.x < -pad || high.y < -pad || low.x > limit + pad || low.y > limit + pad {
            return None;
        }
        if low.z - sag > self.highest((low.x - pad, low.y - pad), (high.x + pad, high.y + pad)) {
            return None;
        }
        if (high.x - low.x).max(high.y - low.y) <= 0.5 {
            return self.leaf(a, b);
        }
        let middle = f64::midpoint(a.0, b.0);
        let m = (middle, piece.at(middle));
        self.halve(piece, a, m).or_else(|| self.halve(piece, m, b))
    }

    /// The first crossing within a stretch of at most half a post, taken as straight: at most one grid line each way.
    fn leaf(&self, a: (f64, Place), b: (f64, Place)) -> Option<f64> {
        let (from, to) = (a.1, b.1);
        let crossing = |p: f64, q: f64| {
            let line = p.max(q).floor();
            if line > p.min(q) {
                ((line - p) / (q - p)).clamp(0.0, 1.0)
            } else {
                1.0
            }
        };
        let mut cuts = [0.0, crossing(from.x, to.x), crossing(from.y, to.y), 1.0];
        cuts.sort_by(f64::total_cmp);
        for pair in cuts.windows(2) {
            let (s, e) = (pair[0], pair[1]);
            if e - s <= 0.0 {
                continue;
            }
            let middle = from.lerp(to, f64::midpoint(s, e));
            let limit = double(self.side - 1);
            if !(0.0..limit).contains(&middle.x) || !(0.0..limit).contains(&middle.y) {
                continue;
            }
            let (i, j) = (floor(middle.x), floor(middle.y));
            let above = |s: f64| {
                let p = from.lerp(to, s);
                p.z - self.patch(i, j, p.x - double(i), p.y - double(j))
            };
            let (d0, dm, d1) = (above(s), above(f64::midpoint(s, e)), above(e));
            if let Some(u) = first_root(d0, dm, d1) {
                return Some(a.0 + (s + u * (e - s)) * (b.0 - a.0));
            }
        }
        None
    }

    fn patch(&self, i: usize, j: usize, fx: f64, fy: f64) -> f64 {
        let post = |di: usize, dj: usize| f64::from(self.heights[(j + dj) * self.side + i + di]);
        let row = |dj: usize| post(0, dj) + fx * (post(1, dj) - post(0, dj));
        row(0) + fy * (row(1) - row(0))
    }

    /// A maximum over the cells between two corners, from the level of the pyramid where they are at most 2 x 2.
    fn highest(&self, low: (f64, f64), high: (f64, f64)) -> f64 {
        let last = self.side - 2;
        let cell = |v: f64| floor(v.max(0.0)).min(last);
        let (mut i0, mut j0, mut i1, mut j1) =
            (cell(low.0), cell(low.1), cell(high.0), cell(high.1));
        let mut level = 0;
        while i1 - i0 > 1 || j1 - j0 > 1 {
            (i0, j0, i1, j1) = (i0 / 2, j0 / 2, i1 / 2, j1 / 2);
            level += 1;
        }
        let side = (self.side - 1).div_ceil(1 << level);
        let map = &self.maxima[level];
        let mut most = f32::MIN;
        for j in j0..=j1 {
            for i in i0..=i1 {
                most = most.max(map[j * side + i]);
            }
        }
        f64::from(most)
    }

    fn place(&self, at: &Geodetic) -> Place {
        let (lon, lat) = self
            .partition
            .from_geodetic(at.longitude.to_degrees(), at.latitude.to_degrees());
        let lon = lon + 360.0 * ((self.centre_deg - lon) / 360.0).round();
        let per_degree = f64::from(self.grid.posts_per_degree);
        DVec3::new(
            lon * per_degree - f64::from(self.west),
            lat * per_degree - f64::from(self.south),
            at.height_ellipsoid.0,
        )
    }

    /// Orthometric heights and what was measured, tile by tile.
    fn read<S: TileSource>(&mut self, source: &S) {
        let (mut reader, mut tile) = (TileReader::new(), Tile::filled(0, SurfaceKind::Void));
        let info = source.info();
        let mut held = None;
        for band in 0..self.side.div_ceil(128) + 1 {
            // Row by row of tiles, so that a tile is read once for each band.
            let rows = (0..self.side).filter(|&y| {
                let row = self.south + signed(y);
                row.div_euclid(TILE_SIDE) - self.south.div_euclid(TILE_SIDE) == signed(band)
            });
            let rows: Vec<usize> = rows.collect();
            for x in 0..self.side {
                let column = self.column(x);
                for &y in &rows {
                    let row = self.south + signed(y);
                    let key = TileKey::of_post(self.partition, 0, column, row);
                    if held.map(|(k, _)| k) != Some(key) {
                        let there = source.contains(key)
                            && source.read_tile(key, &mut reader, &mut tile).is_ok();
                        held = Some((key, there));
                    }
                    if held.is_some_and(|(_, there)| there) {
                        let from = TileKey::index_of(column, row);
                        let at = y * self.side + x;
                        self.heights[at] =
                            single(info.base_m + f64::from(tile.quanta[from]) * info.unit_m);
                        self.measured[at] = tile.kind[from] != SurfaceKind::Void;
                    }
                }
            }
        }
    }

    /// The column that tiles know a column of the field by.
    fn column(&self, x: usize) -> i32 {
        let column = self.west + signed(x);
        match self.partition {
            Partition::Geographic => self.grid.canonical(column),
            Partition::North | Partition::South => column,
        }
    }

    /// From heights above the geoid to heights above the ellipsoid.
    fn undulate<S: TileSource>(&mut self, source: &S) {
        for y in 0..self.side {
            for x in 0..self.side {
                let at = self.post(x, y);
                let n = source
                    .undulation_m(Radians(at.latitude.0), Radians(at.longitude.0))
                    .unwrap_or(0.0);
                let height = &mut self.heights[y * self.side + x];
                *height = single(f64::from(*height) + n);
            }
        }
    }

    fn stack(&mut self) {
        let cells = self.side - 1;
        let post = |i: usize, j: usize| self.heights[j * self.side + i];
        let mut finest = Vec::with_capacity(cells * cells);
        for j in 0..cells {
            for i in 0..cells {
                finest.push(
                    post(i, j)
                        .max(post(i + 1, j))
                        .max(post(i, j + 1))
                        .max(post(i + 1, j + 1)),
                );
            }
        }
        let mut side = cells;
        let mut maxima = vec![finest];
        while side > 1 {
            let half = side.div_ceil(2);
            let below = &maxima[maxima.len() - 1];
            let mut map = vec![f32::MIN; half * half];
            for j in 0..side {
                for i in 0..side {
                    let to = &mut map[j / 2 * half + i / 2];
                    *to = to.max(below[j * side + i]);
                }
            }
            maxima.push(map);
            side = half;
        }
        self.maxima = maxima;
    }
}

/// A stretch of a ray: four points at equal distances.
struct Piece {
    start: f64,
    knots: [Place; 4],
}

impl Piece {
    /// The cubic through the knots at a share of the piece (Lagrange).
    fn at(&self, share: f64) -> Place {
        debug_assert!(self.start >= 0.0, "rays go forward");
        let u = 3.0 * share;
        let (a, b, c) = (u - 1.0, u - 2.0, u - 3.0);
        self.knots[0] * (-a * b * c / 6.0)
            + self.knots[1] * (u * b * c / 2.0)
            + self.knots[2] * (-u * a * c / 2.0)
            + self.knots[3] * (u * a * b / 6.0)
    }
}

/// Where the parabola through (0, `d0`), (1/2, `dm`), (1, `d1`) first is not above 0, in 0 to 1.
fn first_root(d0: f64, dm: f64, d1: f64) -> Option<f64> {
    if d0 <= 0.0 {
        return Some(0.0);
    }
    let c = 2.0 * (d0 + d1 - 2.0 * dm);
    let b = d1 - d0 - c;
    let inside = b * b - 4.0 * c * d0;
    if inside < 0.0 {
        return None;
    }
    // With d0 > 0 the first positive root is 2 d0 / (-b + sqrt(...)), whatever the sign of c.
    let below = -b + inside.sqrt();
    let u = 2.0 * d0 / below;
    (below > 0.0 && u <= 1.0).then_some(u)
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "post numbers of a field, not negative"
)]
fn floor(v: f64) -> usize {
    v as usize
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a few thousand posts; float casts saturate"
)]
fn count(v: f64) -> usize {
    v.ceil() as usize
}

#[expect(clippy::cast_possible_truncation, reason = "a post number on Earth")]
fn whole(v: f64) -> i32 {
    v as i32
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    reason = "a few thousand posts"
)]
fn signed(v: usize) -> i32 {
    v as i32
}

#[expect(clippy::cast_precision_loss, reason = "a few thousand posts")]
fn double(v: usize) -> f64 {
    v as f64
}

#[expect(clippy::cast_possible_truncation, reason = "half a millimetre at 8 km")]
fn single(v: f64) -> f32 {
    v as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::{Attitude, Camera};
    use crate::terrain::planet::{Kind, Planet};

    fn field(kind: Kind, at: (f64, f64)) -> Field {
        let planet = Planet::new(kind, 1200).without_geoid();
        Field::load(
            &planet,
            Partition::Geographic,
            &Geodetic::from_degrees(at.0, at.1, 0.0),
            30_000.0,
        )
    }

    fn rays(at: (f64, f64), height_m: f64) -> impl Iterator<Item = (DVec3, DVec3)> {
        let camera = Camera {
            eye: Geodetic::from_degrees(at.0, at.1, height_m),
            attitude: Attitude::from_degrees(130.0, -8.0, 0.0),
            hfov: Radians::from_degrees(70.0),
            width_px: 40,
            height_px: 24,
        };
        let eye = camera.eye.to_ecef();
        (0..960_u32).map(move |k| {
            (
                eye,
                camera.ray_ecef(f64::from(k % 40) + 0.5, f64::from(k / 40) + 0.5),
            )
        })
    }

    #[test]
    fn a_plain_is_met_where_an_ellipsoid_is() {
        let plain = field(Kind::Plain(200), (46.0, 8.0));
        let axes = DVec3::new(crate::geo::WGS84_A_M, crate::geo::WGS84_A_M, WGS84_B_M)
            + DVec3::splat(200.0);
        let mut hits = 0;
        for (eye, d) in rays((46.0, 8.0), 900.0) {
            let (o, s) = (eye / axes, d / axes);
            let (a, b, c) = (s.dot(s), o.dot(s), o.dot(o) - 1.0);
            let inside = b * b - a * c;
            match plain.cast(eye, d) {
                Cast::Hit(t) => {
                    // The ellipsoid with longer axes is not quite the surface of constant height; at 200 m they are
                    // microns apart. Grazing rays turn that into more.
                    let truth = (-b - inside.sqrt()) / a;
                    assert!((t - truth).abs() < 1e-6 * t + 1e-3, "{t} {truth}");
                    hits += 1;
                }
                Cast::Sky => assert!(inside < 0.0 || b > 0.0, "a miss"),
                Cast::Left => {}
            }
        }
        assert!(hits > 300, "{hits}");
    }

    #[test]
    fn mountains_are_met_where_small_steps_meet_them_first() {
        let at = (-32.6, -70.3);
        let land = field(Kind::Earth, at);
        let (mut hits, mut sky) = (0, 0);
        for (eye, d) in rays(at, 3500.0).step_by(7) {
            let above = |t: f64| {
                let g = Geodetic::from_ecef(eye + d * t);
                land.ground(&g)
                    .map(|ground| g.height_ellipsoid.0 - ground.height_m)
            };
            let stepped = (1..6000)
                .map(|k| 5.0 * f64::from(k))
                .find_map(|t| match above(t) {
                    Some(over) if over < 0.0 => Some(Some(t)),
                    Some(_) => None,
                    None => Some(None),
                });
            match (land.cast(eye, d), stepped.flatten()) {
                (Cast::Hit(t), Some(step)) => {
                    assert!(
                        t <= step && above(t).is_some_and(|a| a.abs() < 1e-3),
                        "{t} {step}"
                    );
                    hits += 1;
                }
                // A crest thinner than the steps may be met first by the cast only; the other way round never.
                (Cast::Hit(t), None) => assert!(above(t).is_some_and(|a| a.abs() < 1e-3), "{t}"),
                (Cast::Sky | Cast::Left, None) => sky += 1,
                (other, Some(step)) => panic!("{other:?} where steps meet ground at {step}"),
            }
        }
        assert!(hits > 40 && sky > 10, "{hits} {sky}");
    }
}
