//! What a perfect picture would show: rays cast in f64 through the bilinear surface of the finest posts, on the WGS 84
//! ellipsoid. For measuring; nothing here flies.
//!
//! A [`Field`] holds the finest posts around an eye, as the source has them, with a pyramid of their maxima. In post
//! coordinates and height a straight line is a smooth curve; it is followed by cubic pieces of 12 km, which keep it to
//! 1e-5 m, and halved until it is above the maxima of the posts it passes, or shorter than half a post. There the
//! crossing with each bilinear patch is the first root of a quadratic, so that no ridge is stepped over.

mod cast;

use super::codec::{SurfaceKind, Tile};
use super::grid::{Grid, TILE_SIDE, TileKey};
use super::pack::{PackInfo, TileReader};
use super::partition::Partition;
use super::surface::TileSource;
use crate::geo::{Geodetic, WGS84_B_M};
use crate::units::Radians;
use glam::DVec3;

/// Posts a side of a field at most: 64 MB of heights.
const SIDE_MAX: usize = 4000;

/// Highest undulation of the geoid, metres (EGM96: 85.4).
const UNDULATION_MAX_M: f64 = 86.0;

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
    /// The same of the finest triangles, whose diagonals run as [`super::blocks`] draws them.
    pub triangle_m: f64,
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
    /// No ground beyond the field is higher, metres above the ellipsoid.
    beyond_m: f64,
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
            beyond_m: 0.0,
        };
        field.beyond_m = field.highest_beyond(source.info());
        field.read(source);
        field.undulate(source);
        field.stack();
        field
    }

    /// Highest ground outside the field: the geoid where all that the source covers lies inside.
    fn highest_beyond(&self, info: &PackInfo) -> f64 {
        let last = signed(self.side) - 1;
        let (r, all) = (info.rect, self.partition == Partition::Geographic);
        let inside = r.west >= self.west
            && r.east <= self.west + last
            && r.south >= self.south
            && r.north <= self.south + last;
        let highest = if all && inside {
            0.0
        } else {
            info.height_max_m.max(0.0)
        };
        highest + UNDULATION_MAX_M
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
            triangle_m: self.triangle(i, j, p.x - double(i), p.y - double(j)),
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

    fn patch(&self, i: usize, j: usize, fx: f64, fy: f64) -> f64 {
        let post = |di: usize, dj: usize| f64::from(self.heights[(j + dj) * self.side + i + di]);
        let row = |dj: usize| post(0, dj) + fx * (post(1, dj) - post(0, dj));
        row(0) + fy * (row(1) - row(0))
    }

    fn triangle(&self, i: usize, j: usize, fx: f64, fy: f64) -> f64 {
        let post = |di: usize, dj: usize| f64::from(self.heights[(j + dj) * self.side + i + di]);
        let (sw, se, nw, ne) = (post(0, 0), post(1, 0), post(0, 1), post(1, 1));
        let even = (self.west + self.south + signed(i + j)).rem_euclid(2) == 0;
        if even {
            let (east, north) = if fx >= fy {
                (se - sw, ne - se)
            } else {
                (ne - nw, nw - sw)
            };
            sw + fx * east + fy * north
        } else if fx + fy <= 1.0 {
            sw + fx * (se - sw) + fy * (nw - sw)
        } else {
            ne + (1.0 - fx) * (nw - ne) + (1.0 - fy) * (se - ne)
        }
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
