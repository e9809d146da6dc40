//! From post numbers to positions on the ellipsoid without trigonometry on the GPU.
//!
//! For a post of longitude L, geodetic latitude B and ellipsoidal height h,
//!
//! ```text
//! x = (N + h) cos B cos L     y = (N + h) cos B sin L     z = (N (1 - e2) + h) sin B
//! ```
//!
//! Against one *anchor* (L0, B0, hA), with C = (N + hA) cos B and S = (N (1 - e2) + hA) sin B, this is exactly
//!
//! ```text
//! P - anchor = ( C0 (cos L - cos L0) + (C - C0) cos L,
//!                C0 (sin L - sin L0) + (C - C0) sin L,
//!                S - S0 )  +  (h - hA) (cos B cos L, cos B sin L, sin B)
//! ```
//!
//! Columns know L, rows know B; both are tabulated here in f64 and rounded once. Every product has a small first factor,
//! so the f32 error is proportional to the distance from the anchor. All levels share one anchor, and a table entry
//! depends on the level-0 post number alone: a post that two levels share gets the same bits from both.
//!
//! In a cap the grid angles (u, v) turn about another axis than the ellipsoid does, so N depends on both of them. With the
//! normal n = (cos u sin v, s sin u, s cos u cos v) of [`super::partition`], s = 1 in the north and -1 in the south, and
//! R = N0 + hA, dn = n - n0, this is exactly
//!
//! ```text
//! P - anchor = (R dn.x, R dn.y, (N0 (1 - e2) + hA) dn.z)  +  (N - N0) (n.x, n.y, (1 - e2) n.z)  +  (h - hA) n
//! dn.x = cos u0 (sin v - sin v0) + (cos u - cos u0) sin v
//! dn.z = cos u0 (s cos v - s cos v0) + (cos u - cos u0) s cos v
//! N - N0 = N0 (1 / sqrt(1 - x) - 1),   x = e2 dn.z (n.z + n0.z) / (1 - e2 n0.z^2)
//! ```
//!
//! dn is again a sum of products of columns and rows, and x has dn.z as a factor: nothing cancels. x is below 0.003
//! wherever a window reaches (25 degrees), so x (1/2 + 3/8 x) stands for the root to 2e-8 of the distance.

use super::grid::Grid;
use super::partition::Partition;
use crate::geo::{WGS84_E2, prime_vertical_radius_m};
use glam::DVec3;

/// How heights are stored for the GPU: 16-bit codes above a base, by the ellipsoid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeightCode {
    /// Ellipsoidal height of code 0, metres.
    pub base_m: f64,
    /// Height of one step, metres.
    pub unit_m: f64,
}

/// Geoid undulations stay within these bounds, metres (EGM96: -106.99 to +85.39).
const UNDULATION_BOUND_M: f64 = 110.0;

impl HeightCode {
    /// Codes for orthometric heights between `min_m` and `max_m` (and zero, which stands for missing ones) on a geoid
    /// anywhere: steps of 0.25 m above -2048 m where that covers them, else above their lowest, else coarser steps.
    #[must_use]
    pub fn covering(min_m: f64, max_m: f64) -> Self {
        let low = min_m.min(0.0) - UNDULATION_BOUND_M;
        let high = max_m.max(0.0) + UNDULATION_BOUND_M;
        let mut code = Self {
            base_m: if low >= -2048.0 { -2048.0 } else { low.floor() },
            unit_m: 0.25,
        };
        while code.base_m + code.unit_m * f64::from(u16::MAX) < high {
            code.unit_m *= 2.0;
        }
        code
    }

    /// The nearest code of an ellipsoidal height.
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "float casts saturate, and heights lie within the codes by construction"
    )]
    pub fn encode(&self, height_ellipsoid_m: f64) -> u16 {
        ((height_ellipsoid_m - self.base_m) / self.unit_m).round() as u16
    }

    /// The ellipsoidal height of a code, metres.
    #[must_use]
    pub fn decode(&self, code: u16) -> f64 {
        self.base_m + self.unit_m * f64::from(code)
    }
}

/// The post that positions are counted from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AnchorPost {
    /// Level-0 column.
    pub i: i32,
    /// Level-0 row.
    pub j: i32,
    /// Height code.
    pub code: u16,
}

/// The anchor, and what its tables are made from.
#[derive(Clone, Copy, Debug)]
pub struct Anchor {
    grid: Grid,
    post: AnchorPost,
    height_m: f64,
    /// Metres a height code: a power of two, so that what is multiplied or divided by it keeps its digits.
    unit_m: f64,
    /// C0; in a cap R cos u0.
    c0: f64,
    ecef: DVec3,
    place: Place,
}

/// What differs between the partitions.
#[derive(Clone, Copy, Debug)]
enum Place {
    /// S at the anchor, metres.
    Geographic { s0: f64 },
    /// 1 in the north, -1 in the south; N0 + hA, metres; and the shader's numbers.
    Cap {
        sign: f64,
        radius_m: f64,
        bulge: [f64; 4],
    },
}

/// One column or row of a table: see the module.
pub type Entry = [f32; 4];

impl Anchor {
    /// At a post of a partition, at the ellipsoidal height of its code.
    #[must_use]
    pub fn new(partition: Partition, grid: Grid, heights: HeightCode, post: AnchorPost) -> Self {
        let height_m = heights.decode(post.code);
        let (longitude_deg, latitude_deg) =
            (grid.longitude_deg(0, post.i), grid.latitude_deg(0, post.j));
        let latitude = latitude_deg.to_radians();
        let nz = partition.normal(longitude_deg, latitude_deg).z;
        let n0 = prime_vertical_radius_m(nz);
        let radius_m = n0 + height_m;
        let half = 0.5 * n0 / heights.unit_m;
        let cap = |sign: f64| Place::Cap {
            sign,
            radius_m,
            bulge: [
                half * WGS84_E2 / ((1.0 - WGS84_E2 * nz * nz) * radius_m * heights.unit_m),
                heights.unit_m * nz,
                0.75 / half,
                (n0 * (1.0 - WGS84_E2) + height_m) / radius_m,
            ],
        };
        Self {
            grid,
            post,
            height_m,
            unit_m: heights.unit_m,
            c0: radius_m * latitude.cos(),
            ecef: partition.ecef(longitude_deg, latitude_deg, height_m),
            place: match partition {
                Partition::Geographic => Place::Geographic {
                    s0: meridian(latitude, height_m).1,
                },
                Partition::North => cap(1.0),
                Partition::South => cap(-1.0),
            },
        }
    }

    /// Where it is: post and height code.
    #[must_use]
    pub const fn post(&self) -> AnchorPost {
        self.post
    }

    /// Earth-centred position, metres.
    #[must_use]
    pub const fn ecef(&self) -> DVec3 {
        self.ecef
    }

    /// In a cap, with q the metres a code and b = N0 / 2 q: b x for a metre of R dn.z and for q (n.z + n0.z) = 1, codes a square
    /// metre; q n0.z, m; 3 / 4 b, a code; what R dn.z is multiplied by to have the first part of z. Zeros in the geographic partition.
    #[must_use]
    pub const fn bulge(&self) -> [f64; 4] {
        match self.place {
            Place::Geographic { .. } => [0.0; 4],
            Place::Cap { bulge, .. } => bulge,
        }
    }

    /// Entry of level-0 column `i`: (C0 (cos L - cos L0), C0 (sin L - sin L0), cos L, sin L), the first two in metres; in a
    /// cap of v, with R cos u0 for C0 and the cosines times s.
    #[must_use]
    pub fn column(&self, i: i32) -> Entry {
        let (sin, cos) = radians(self.grid, i).sin_cos();
        let (dcos, dsin) = self.differences(self.post.i, i);
        let s = match self.place {
            Place::Geographic { .. } => 1.0,
            Place::Cap { sign, .. } => sign,
        };
        entry([self.c0 * s * dcos, self.c0 * dsin, s * cos, sin])
    }

    /// Entry of level-0 row `j`: (C - C0, S - S0, q cos B, q sin B), in metres, where q is the metres a height code; in a
    /// cap (R (cos u - cos u0), s R (sin u - sin u0), q cos u, s q sin u).
    #[must_use]
    pub fn row(&self, j: i32) -> Entry {
        let latitude = radians(self.grid, j);
        let (sin, cos) = latitude.sin_cos();
        let (up_sin, up_cos) = (self.unit_m * sin, self.unit_m * cos);
        match self.place {
            Place::Geographic { s0 } => {
                let (c, s) = meridian(latitude, self.height_m);
                entry([c - self.c0, s - s0, up_cos, up_sin])
            }
            Place::Cap { sign, radius_m, .. } => {
                let (dcos, dsin) = self.differences(self.post.j, j);
                entry([
                    radius_m * dcos,
                    sign * radius_m * dsin,
                    up_cos,
                    sign * up_sin,
                ])
            }
        }
    }

    /// cos b - cos a and sin b - sin a of two posts' angles.
    fn differences(&self, a: i32, b: i32) -> (f64, f64) {
        // The half difference is exact in posts; differences as products keep all digits of a small one.
        let half = radians(self.grid, b - a) / 2.0;
        let (mean_sin, mean_cos) = (radians(self.grid, a) + half).sin_cos();
        let chord = 2.0 * half.sin();
        (-chord * mean_sin, chord * mean_cos)
    }
}

/// Level-0 posts to radians.
fn radians(grid: Grid, posts: i32) -> f64 {
    grid.longitude_deg(0, posts).to_radians()
}

/// Distance from the axis and from the equatorial plane of a point at a latitude and height, metres.
fn meridian(latitude: f64, height_m: f64) -> (f64, f64) {
    let (sin, cos) = latitude.sin_cos();
    let n = prime_vertical_radius_m(sin);
    (
        (n + height_m) * cos,
        (n * (1.0 - WGS84_E2) + height_m) * sin,
    )
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "the one rounding of the method"
)]
fn entry(v: [f64; 4]) -> Entry {
    v.map(|x| x as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::Geodetic;

    /// The shader's expressions, in f32, operation by operation.
    fn shader(o: [f32; 3], bulge: [f32; 4], col: Entry, row: Entry, rise: f32) -> [f32; 3] {
        let across = [col[0] + row[0] * col[2], col[1] + row[0] * col[3]];
        let up = [row[2] * col[2], row[2] * col[3]];
        let is_geographic = bulge[2] <= 0.0;
        if is_geographic {
            return [
                o[0] + across[0] + rise * up[0],
                o[1] + across[1] + rise * up[1],
                o[2] + row[1] + rise * row[3],
            ];
        }
        let less = bulge[0] * across[0] * (up[0] + bulge[1]);
        let more = less + less * less * bulge[2];
        let (wide, deep) = (more + rise, 0.993_305_6 * more + rise);
        [
            o[0] + across[1] + wide * up[1],
            o[1] + row[1] + wide * row[3],
            o[2] + bulge[3] * across[0] + deep * up[0],
        ]
    }

    /// Distance of a post from the eye, of the anchor from the eye, and the error of the shader's position, metres.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "emulates the shader's f32 arithmetic"
    )]
    fn error(
        partition: Partition,
        anchor: &Anchor,
        heights: HeightCode,
        eye: DVec3,
        (di, dj, dh): (i32, i32, i16),
    ) -> Option<(f64, f64, f64)> {
        let post = anchor.post();
        let code = u16::try_from(i32::from(post.code) + i32::from(dh)).ok()?;
        let (i, j) = (post.i + di, post.j + dj);
        let (lon, lat) = partition.to_geodetic(
            anchor.grid.longitude_deg(0, i),
            anchor.grid.latitude_deg(0, j),
        );
        let truth = Geodetic::from_degrees(lat, lon, heights.decode(code)).to_ecef() - eye;
        let origin = anchor.ecef() - eye;
        let p = shader(
            [origin.x as f32, origin.y as f32, origin.z as f32],
            anchor.bulge().map(|v| v as f32),
            anchor.column(i),
            anchor.row(j),
            f32::from(dh),
        );
        let p = DVec3::new(f64::from(p[0]), f64::from(p[1]), f64::from(p[2]));
        Some((truth.length(), origin.length(), (p - truth).length()))
    }

    /// Posts from the anchor, and codes above it: from beside it to the corner of the coarsest window of any grid.
    const OFFSETS: [(i32, i32, i16); 10] = [
        (0, 0, 0),
        (1, 0, 4),
        (0, 1, -4),
        (3, -5, 40),
        (60, 80, 900),
        (-900, 300, -600),
        (9000, -12_000, 3000),
        (-40_000, 9_000, 0),
        (-19_000, 19_000, 2000),
        (16_000, 16_000, -2000),
    ];

    /// The worst error around a geodetic position, as a share of the distances, over eyes from 0.3 m to 18 km above the
    /// Dead Sea, the sea and Everest.
    fn worst_around(partition: Partition, grid: Grid, lat: f64, lon: f64) -> f64 {
        let heights = HeightCode::covering(-430.0, 8850.0);
        let (grid_lon, grid_lat) = partition.from_geodetic(lon, lat);
        #[expect(clippy::cast_possible_truncation, reason = "a post number")]
        let post_of = |deg: f64| (deg * f64::from(grid.posts_per_degree)).round() as i32;
        let mut worst: f64 = 0.0;
        for (ground_m, above_m) in [
            (-430.0, 0.3),
            (0.0, 300.0),
            (8848.0, 0.3),
            (4000.0, 18_000.0),
        ] {
            let post = AnchorPost {
                i: post_of(grid_lon) + 7,
                j: post_of(grid_lat) - 3,
                code: heights.encode(ground_m),
            };
            let anchor = Anchor::new(partition, grid, heights, post);
            let per_degree = f64::from(grid.posts_per_degree);
            let (lon, lat) = partition.to_geodetic(
                grid.longitude_deg(0, post.i) - 0.3 / per_degree,
                grid.latitude_deg(0, post.j) + 0.4 / per_degree,
            );
            let eye = Geodetic::from_degrees(lat, lon, ground_m + above_m).to_ecef();
            for offset in OFFSETS {
                if let Some((d, o, e)) = error(partition, &anchor, heights, eye, offset) {
                    worst = worst.max((e - 4e-9) / (d + o));
                }
            }
        }
        worst
    }

    /// 935 px per radian is 1920 x 1080 at 60 degrees vertical; the goal is a thousandth of a pixel, 1.07e-6 rad.
    const TOLERANCE: f64 = 2e-7;

    #[test]
    fn positions_in_f32_agree_with_geodesy_to_a_few_ten_millionths_of_the_distance() {
        for posts_per_degree in [1200, 3600] {
            let grid = Grid { posts_per_degree };
            for (lat, lon) in [
                (0.0, 0.0),
                (45.0, 14.0),
                (-33.0, -71.0),
                (70.0, 30.0),
                (-20.0, 180.0),
                (60.0, -180.0),
            ] {
                let worst = worst_around(Partition::Geographic, grid, lat, lon);
                assert!(worst <= TOLERANCE, "{worst} of the distance at {lat} {lon}");
            }
        }
    }

    #[test]
    fn positions_around_the_poles_are_as_good() {
        let off_pole = 90.0 - 1e-6_f64.to_degrees();
        for posts_per_degree in [1200, 3600] {
            let grid = Grid { posts_per_degree };
            for lat in [90.0, off_pole, 89.999, 85.0, 70.0, 64.0] {
                for lon in [0.0, 45.0, 90.0, -179.5, -100.0] {
                    for (partition, lat) in [(Partition::North, lat), (Partition::South, -lat)] {
                        let worst = worst_around(partition, grid, lat, lon);
                        assert!(worst <= TOLERANCE, "{worst} of the distance at {lat} {lon}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_post_has_the_same_entry_on_every_level_and_on_both_sides_of_the_date_line() {
        let grid = Grid {
            posts_per_degree: 1200,
        };
        let heights = HeightCode::covering(0.0, 100.0);
        let post = AnchorPost {
            i: 215_990,
            j: 100,
            code: 8192,
        };
        let anchor = Anchor::new(Partition::Geographic, grid, heights, post);
        let (column, again) = (
            anchor.column(216_004),
            anchor.column(216_004 - grid.posts_around()),
        );
        for k in 0..4 {
            assert!((column[k] - again[k]).abs() < 1e-6, "{column:?} {again:?}");
        }
    }

    #[test]
    fn codes_cover_the_ground_with_quarter_metres_where_they_can() {
        let usual = HeightCode::covering(-424.0, 8849.0);
        assert_eq!((usual.base_m, usual.unit_m), (-2048.0, 0.25));
        let sea_floor = HeightCode::covering(-10_900.0, 8849.0);
        assert!(sea_floor.unit_m <= 0.5, "half metres");
        for h in [-11_000.0, 0.0, 8900.0] {
            assert!(
                (sea_floor.decode(sea_floor.encode(h)) - h).abs() <= 0.25 + 1e-9,
                "{h}"
            );
        }
    }
}
