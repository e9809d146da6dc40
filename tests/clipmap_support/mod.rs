//! A stand-in for a pack: land from a formula, with tiles that can be made to fail.
#![allow(dead_code, reason = "each test file uses its own part of this")]
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    clippy::expect_used,
    reason = "made-up land: numbers are small and what fails must say so"
)]

pub(crate) mod booth;
pub(crate) mod earth;
#[path = "../support/mod.rs"]
pub(crate) mod support;

use glasswing::gl::Gpu;
use glasswing::screen::Screen;
use glasswing::terrain::codec::{SurfaceKind, Tile};
use glasswing::terrain::grid::{Grid, TileKey};
use glasswing::terrain::pack::{Bounds, LevelErrors, PackInfo, PostRect, TileError, TileReader};
use glasswing::terrain::surface::TileSource;
use glasswing::units::Radians;
use std::rc::Rc;

/// Height of the formula's post at whole units of 1 m above -1000 m.
pub(crate) type Formula = fn(i: i32, j: i32) -> (f64, SurfaceKind);

/// Land from a formula over everything, or within bounds.
#[derive(Debug)]
pub(crate) struct Land {
    info: PackInfo,
    formula: Formula,
    broken: fn(TileKey) -> bool,
}

const BASE_M: f64 = -1000.0;

/// A pack of the whole Earth in the geographic partition.
fn info(posts_per_degree: u32) -> PackInfo {
    let grid = Grid { posts_per_degree };
    let rect = PostRect {
        south: -grid.row_max(),
        west: -grid.posts_around() / 2,
        north: grid.row_max(),
        east: grid.posts_around() / 2 - 1,
    };
    PackInfo {
        version: 2,
        grid,
        levels: grid.level_count(),
        partitions: [true, false, false],
        rect,
        bounds: Bounds {
            south_deg: -90.0,
            west_deg: -180.0,
            north_deg: 90.0,
            east_deg: 180.0,
        },
        unit_m: 1.0,
        base_m: BASE_M,
        height_min_m: -500.0,
        height_max_m: 7000.0,
        tiles: 0,
        posts: 0,
        void_posts: 0,
        water_posts: 0,
        bytes: 0,
        level_errors: LevelErrors::default(),
    }
}

impl Land {
    pub(crate) fn new(posts_per_degree: u32, formula: Formula) -> Self {
        let info = info(posts_per_degree);
        Self {
            info,
            formula,
            broken: |_| false,
        }
    }

    /// The same with tiles that fail their checksum.
    pub(crate) fn broken(mut self, broken: fn(TileKey) -> bool) -> Self {
        self.broken = broken;
        self
    }

    /// The orthometric height of a level-0 post as a tile holds it, metres.
    pub(crate) fn height_m(&self, i: i32, j: i32) -> f64 {
        (self.formula)(self.info.grid.canonical(i), j).0.round()
    }
}

impl TileSource for Land {
    fn info(&self) -> &PackInfo {
        &self.info
    }

    fn contains(&self, key: TileKey) -> bool {
        let limit = self.info.grid.row_max() >> key.level;
        key.south() <= limit && key.south() + 127 >= -limit
    }

    /// A geoid that is not zero, so that forgetting it shows.
    fn undulation_m(&self, latitude: Radians, longitude: Radians) -> Option<f64> {
        Some(40.0 * latitude.0.cos() * (2.0 * longitude.0).sin())
    }

    fn read_tile(
        &self,
        key: TileKey,
        _: &mut TileReader,
        tile: &mut Tile,
    ) -> Result<(), TileError> {
        if (self.broken)(key) {
            return Err(TileError::Checksum);
        }
        for y in 0..128 {
            for x in 0..128 {
                let (i, j) = (key.west() + x, key.south() + y);
                let (height, kind) =
                    (self.formula)(self.info.grid.canonical(i << key.level), j << key.level);
                let at = TileKey::index_of(i, j);
                tile.quanta[at] = (height.round() - BASE_M) as u16;
                tile.kind[at] = kind;
            }
        }
        Ok(())
    }
}

/// A whole number from a post, well mixed (Wang's hash), 0 to 1.
fn noise(i: i32, j: i32) -> f64 {
    let mut h = (i.wrapping_mul(73_856_093) ^ j.wrapping_mul(19_349_663)) as u32;
    h = (h ^ 61) ^ (h >> 16);
    h = h.wrapping_mul(9);
    h ^= h >> 4;
    h = h.wrapping_mul(0x27d4_eb2d);
    h ^= h >> 15;
    f64::from(h) / f64::from(u32::MAX)
}

/// Value noise with a period of `cell` posts.
fn smooth(i: i32, j: i32, cell: i32) -> f64 {
    let (ci, cj) = (i.div_euclid(cell), j.div_euclid(cell));
    let s = |v: i32| {
        let t = f64::from(v.rem_euclid(cell)) / f64::from(cell);
        t * t * (3.0 - 2.0 * t)
    };
    let (u, v) = (s(i), s(j));
    let row = |j| noise(ci, j) * (1.0 - u) + noise(ci + 1, j) * u;
    row(cj) * (1.0 - v) + row(cj + 1) * v
}

/// Mountains of seven octaves, with a sea below 800 m and steep sides.
pub(crate) fn mountains(i: i32, j: i32) -> (f64, SurfaceKind) {
    let mut h = 0.0;
    let (mut cell, mut height) = (512, 4200.0);
    for _ in 0..8 {
        h += height * (smooth(i, j, cell) - 0.25);
        cell /= 2;
        height *= 0.52;
    }
    if h < 800.0 {
        (0.0, SurfaceKind::Water)
    } else {
        (h - 800.0, SurfaceKind::Land)
    }
}

/// Cliffs: posts of the lowest and the highest land side by side.
pub(crate) fn cliffs(i: i32, j: i32) -> (f64, SurfaceKind) {
    let high = noise(i.div_euclid(3), j.div_euclid(3)) > 0.5;
    (if high { 7000.0 } else { -500.0 }, SurfaceKind::Land)
}

/// A flat sea.
pub(crate) fn sea(_: i32, _: i32) -> (f64, SurfaceKind) {
    (0.0, SurfaceKind::Water)
}

/// A GPU without a screen on EGL, or on what `GLASSWING_TEST_SCREEN` names.
pub(crate) fn gpu(width: u32, height: u32) -> (Rc<Gpu>, Box<dyn Screen>) {
    let screen = support::headless_screen(width, height);
    let gpu = Gpu::new(&|name| screen.gl_proc(name)).expect("a GL context");
    (gpu, screen)
}

/// Small deterministic random numbers (SplitMix64, Steele et al. 2014).
#[derive(Debug)]
pub(crate) struct Dice(pub(crate) u64);

impl Dice {
    /// Between `low` and `high`.
    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        low + (high - low) * (z >> 11) as f64 / (1_u64 << 53) as f64
    }
}
