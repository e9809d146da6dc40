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

use super::grid::Grid;
use crate::geo::{Geodetic, WGS84_E2, prime_vertical_radius_m};
use crate::units::{Metres, Radians};
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
    sin_lon: f64,
    cos_lon: f64,
    c0: f64,
    s0: f64,
    ecef: DVec3,
}

/// One column or row of a table: see the module.
pub type Entry = [f32; 4];

impl Anchor {
    /// At a post, at the ellipsoidal height of its code.
    #[must_use]
    pub fn new(grid: Grid, heights: HeightCode, post: AnchorPost) -> Self {
        let height_m = heights.decode(post.code);
        let (longitude, latitude) = (radians(grid, post.i), radians(grid, post.j));
        let (sin_lon, cos_lon) = longitude.sin_cos();
        let (c0, s0) = meridian(latitude, height_m);
        let ecef = Geodetic {
            latitude: Radians(latitude),
            longitude: Radians(longitude),
            height_ellipsoid: Metres(height_m),
        }
        .to_ecef();
        Self {
            grid,
            post,
            height_m,
            sin_lon,
            cos_lon,
            c0,
            s0,
            ecef,
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

    /// Distance of the anchor from the Earth's axis, metres: the shader's C0.
    #[must_use]
    pub const fn axis_distance_m(&self) -> f64 {
        self.c0
    }

    /// Entry of level-0 column `i`: (cos L - cos L0, sin L - sin L0, cos L, sin L).
    #[must_use]
    pub fn column(&self, i: i32) -> Entry {
        let (sin, cos) = radians(self.grid, i).sin_cos();
        // The half difference is exact in posts; differences as products keep all digits of a small one.
        let half = radians(self.grid, i - self.post.i) / 2.0;
        let (mean_sin, mean_cos) = (radians(self.grid, self.post.i) + half).sin_cos();
        let chord = 2.0 * half.sin();
        entry([-chord * mean_sin, chord * mean_cos, cos, sin])
    }

    /// Entry of level-0 row `j`: (C - C0, S - S0, cos B, sin B), the first two in metres.
    #[must_use]
    pub fn row(&self, j: i32) -> Entry {
        let latitude = radians(self.grid, j);
        let (sin, cos) = latitude.sin_cos();
        let (c, s) = meridian(latitude, self.height_m);
        entry([c - self.c0, s - self.s0, cos, sin])
    }

    /// Position relative to the anchor of the post of a column and a row at a height code, metres: in f64 what the shader
    /// does in f32, from the same rounded entries.
    #[must_use]
    pub fn offset(&self, heights: HeightCode, column: Entry, row: Entry, code: f64) -> DVec3 {
        let [dcos, dsin, cos, sin] = column.map(f64::from);
        let [dc, ds, cos_lat, sin_lat] = row.map(f64::from);
        let rise = (code - f64::from(self.post.code)) * heights.unit_m;
        DVec3::new(
            self.c0 * dcos + dc * cos + rise * cos_lat * cos,
            self.c0 * dsin + dc * sin + rise * cos_lat * sin,
            ds + rise * sin_lat,
        )
    }

    /// Sine and cosine of the anchor's longitude.
    #[must_use]
    pub const fn longitude_sin_cos(&self) -> (f64, f64) {
        (self.sin_lon, self.cos_lon)
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

    /// The shader's expression, in f32, operation by operation.
    fn shader(o: [f32; 3], c0: f32, col: Entry, row: Entry, rise: f32) -> [f32; 3] {
        [
            o[0] + (c0 * col[0] + row[0] * col[2]) + rise * (row[2] * col[2]),
            o[1] + (c0 * col[1] + row[0] * col[3]) + rise * (row[2] * col[3]),
            o[2] + row[1] + rise * row[3],
        ]
    }

    /// Distance of a post from the eye, of the anchor from the eye, and the error of the shader's position, metres.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "emulates the shader's f32 arithmetic"
    )]
    fn error(
        anchor: &Anchor,
        heights: HeightCode,
        eye: DVec3,
        (di, dj, dh): (i32, i32, i16),
    ) -> Option<(f64, f64, f64)> {
        let post = anchor.post();
        let code = u16::try_from(i32::from(post.code) + i32::from(dh)).ok()?;
        let (i, j) = (post.i + di, post.j + dj);
        let truth = Geodetic::from_degrees(
            anchor.grid.latitude_deg(0, j),
            anchor.grid.longitude_deg(0, i),
            heights.decode(code),
        )
        .to_ecef()
            - eye;
        let origin = anchor.ecef() - eye;
        let p = shader(
            [origin.x as f32, origin.y as f32, origin.z as f32],
            anchor.axis_distance_m() as f32,
            anchor.column(i),
            anchor.row(j),
            f32::from(dh) * heights.unit_m as f32,
        );
        let p = DVec3::new(f64::from(p[0]), f64::from(p[1]), f64::from(p[2]));
        Some((truth.length(), origin.length(), (p - truth).length()))
    }

    #[test]
    fn positions_in_f32_agree_with_geodesy_to_a_few_ten_millionths_of_the_distance() {
        // 935 px per radian is 1920 x 1080 at 60 degrees vertical; the goal is a thousandth of a pixel, 1.07e-6 rad.
        let offsets = [
            (0, 0, 0),
            (1, 0, 4),
            (0, 1, -4),
            (3, -5, 40),
            (60, 80, 900),
            (-900, 300, -600),
            (9000, -12_000, 3000),
            (-40_000, 9_000, 0),
        ];
        let mut worst: f64 = 0.0;
        for posts_per_degree in [1200, 3600] {
            let grid = Grid { posts_per_degree };
            let ppd = posts_per_degree.cast_signed();
            let heights = HeightCode::covering(-430.0, 8850.0);
            for (lat, lon) in [
                (0, 0),
                (45, 14),
                (-33, -71),
                (88, 30),
                (-20, 180),
                (60, -180),
            ] {
                for (ground_m, above_m) in [
                    (-430.0, 0.3),
                    (0.0, 300.0),
                    (8848.0, 0.3),
                    (4000.0, 18_000.0),
                ] {
                    let post = AnchorPost {
                        i: lon * ppd + 7,
                        j: lat * ppd - 3,
                        code: heights.encode(ground_m),
                    };
                    let anchor = Anchor::new(grid, heights, post);
                    let eye = Geodetic::from_degrees(
                        grid.latitude_deg(0, post.j) + 0.4 / f64::from(ppd),
                        grid.longitude_deg(0, post.i) - 0.3 / f64::from(ppd),
                        ground_m + above_m,
                    )
                    .to_ecef();
                    for offset in offsets {
                        if let Some((d, o, e)) = error(&anchor, heights, eye, offset) {
                            worst = worst.max((e - 2e-9) / (d + o));
                        }
                    }
                }
            }
        }
        assert!(worst <= 2e-7, "{worst} of the distance");
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
        let anchor = Anchor::new(grid, heights, post);
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
