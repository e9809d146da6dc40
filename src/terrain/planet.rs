//! A whole planet in memory, for measuring without a pack: every tile is worked out when it is read.
//!
//! Heights come from noise in space, sampled on the unit sphere of the ellipsoid's normals, so that they are the same in
//! every partition and continuous over the poles and the date line. On top of it stand a mountain of 8848 m (where the
//! highest one stands) and a basin of -430 m (where the lowest land lies); below 0 m of the noise is sea, with its coast
//! at 0 m. Some land is marked as void, and one square degree has no tiles at all.
//!
//! Coarse levels are every 2^l-th post as it is. A bake raises posts for the summits between them, `terrain::bake_raise`; here a
//! summit can be as much too low as between any posts of that spacing, so summits are measured over packs.

use super::codec::{SurfaceKind, Tile};
use super::grid::{Grid, TILE_SIDE, TileKey};
use super::pack::{Bounds, LevelErrors, PackInfo, PostRect, TileError, TileReader};
use super::partition::Partition;
use super::surface::TileSource;
use super::synth_noise::hash;
use crate::units::Radians;
use glam::DVec3;

/// Which planet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Mountains, plains and seas from -430 to 8848 m.
    Earth,
    /// Columns of the lowest and of the highest storable height, 300 m wide, side by side.
    Cliffs,
    /// Sea everywhere.
    Sea,
    /// Nothing was ever measured: tiles of voids.
    Void,
    /// A plain of one height, in metres.
    Plain(i16),
}

/// See the module.
#[derive(Debug)]
pub struct Planet {
    kind: Kind,
    info: PackInfo,
    undulates: bool,
}

/// Height of quanta 0, metres: the lowest of the codes that drawing uses.
const BASE_M: f64 = -2048.0;
/// Steps of the stored heights, metres.
const UNIT_M: f64 = 0.25;
/// Cliffs stand between these quanta: as far as geoid undulations leave room in 16 bits.
const CLIFF_QUANTA: (u16, u16) = (500, 65_000);

/// Latitude and longitude of the highest mountain, degrees.
pub const SUMMIT_DEG: (f64, f64) = (27.9881, 86.925);
/// Height of the highest mountain, metres.
pub const SUMMIT_M: f64 = 8848.0;
/// Latitude and longitude of the lowest land, degrees.
pub const BASIN_DEG: (f64, f64) = (31.5, 35.475);
/// Height of the lowest land, metres.
pub const BASIN_M: f64 = -430.0;
/// South-west corner of the square degree without tiles.
pub const HOLE_DEG: (i32, i32) = (50, 10);

impl Planet {
    /// A planet with so many posts a degree, on a geoid that is not flat.
    #[must_use]
    pub fn new(kind: Kind, posts_per_degree: u32) -> Self {
        let grid = Grid { posts_per_degree };
        let rect = PostRect {
            south: -grid.row_max(),
            west: -grid.posts_around() / 2,
            north: grid.row_max(),
            east: grid.posts_around() / 2 - 1,
        };
        let metres = |quanta: u16| BASE_M + UNIT_M * f64::from(quanta);
        let (height_min_m, height_max_m) = match kind {
            Kind::Earth => (BASIN_M, SUMMIT_M),
            Kind::Cliffs => (metres(CLIFF_QUANTA.0), metres(CLIFF_QUANTA.1)),
            Kind::Sea | Kind::Void => (0.0, 0.0),
            Kind::Plain(height) => (f64::from(height), f64::from(height)),
        };
        Self {
            kind,
            undulates: true,
            info: PackInfo {
                version: super::pack::FORMAT,
                grid,
                levels: grid.level_count(),
                rect,
                bounds: Bounds {
                    south_deg: -90.0,
                    west_deg: -180.0,
                    north_deg: 90.0,
                    east_deg: 180.0,
                },
                unit_m: UNIT_M,
                base_m: BASE_M,
                height_min_m,
                height_max_m,
                partitions: [true; 3],
                tiles: 0,
                posts: 0,
                void_posts: 0,
                water_posts: 0,
                bytes: 0,
                level_errors: LevelErrors::default(),
            },
        }
    }

    /// The same without undulations of the geoid: orthometric and ellipsoidal heights are one.
    #[must_use]
    pub fn without_geoid(mut self) -> Self {
        self.undulates = false;
        self
    }

    /// Orthometric height in metres, and what is there, where the ellipsoid's unit normal is `n`.
    #[must_use]
    pub fn height(&self, n: DVec3) -> (f64, SurfaceKind) {
        match self.kind {
            Kind::Earth => earth(n, &mut Held::default()),
            Kind::Cliffs => (self.cliffs(n), SurfaceKind::Land),
            Kind::Sea => (0.0, SurfaceKind::Water),
            Kind::Void => (0.0, SurfaceKind::Void),
            Kind::Plain(height) => (f64::from(height), SurfaceKind::Land),
        }
    }

    /// The longitude on a parallel where the ground is roughest, all of it land for 20 km around; degrees.
    #[must_use]
    pub fn mountains_deg(&self, latitude_deg: f64) -> f64 {
        let narrow = latitude_deg.to_radians().cos().max(0.02);
        let rough = |lon: f64| {
            let near = |k: i32| {
                let (east, north) = (0.06 * f64::from(k % 7 - 3), 0.06 * f64::from(k / 7 - 3));
                self.height(Partition::Geographic.normal(lon + east / narrow, latitude_deg + north))
            };
            let is_land = (0..49).all(|k| near(k).1 == SurfaceKind::Land);
            let heights = || (0..49).map(|k| near(k).0);
            is_land.then(|| heights().fold(f64::MIN, f64::max) - heights().fold(f64::MAX, f64::min))
        };
        let longitudes = (-180..180).map(f64::from);
        let found = longitudes.map(|lon| (rough(lon).unwrap_or(0.0), lon));
        found
            .fold((0.0, 0.0), |a, b| if b.0 > a.0 { b } else { a })
            .1
    }

    fn cliffs(&self, n: DVec3) -> f64 {
        // Cubes of 300 m: the cut of a sphere through them is a pattern of columns everywhere.
        let cell = (n * (MEAN_RADIUS_M / 300.0)).floor();
        let low = cell_hash(cell, 0) & 1 == 0;
        let (least, most) = (self.info.height_min_m, self.info.height_max_m);
        if low { least } else { most }
    }
}

/// WGS 84's mean radius, (2a + b) / 3: scales of noise are in metres on the ground.
const MEAN_RADIUS_M: f64 = 6_371_008.8;

/// Wavelength of the first octave, metres, and its amplitude, metres.
const FIRST_OCTAVE: (f64, f64) = (120_000.0, 3600.0);
/// Octaves; each has half the wavelength and 0.52 of the amplitude of the one before: the last has 470 m and 20 m.
const OCTAVES: usize = 9;
/// Highest ground of the noise, metres.
const NOISE_MAX_M: f64 = 6500.0;

/// The corners that noise was last blended from, for each octave and the voids: neighbouring posts mostly share them.
type Held = [Lattice; OCTAVES + 1];

fn earth(n: DVec3, held: &mut Held) -> (f64, SurfaceKind) {
    let [octaves @ .., voids] = held;
    let mut height = -500.0;
    let (mut wavelength, mut amplitude) = FIRST_OCTAVE;
    for (octave, held) in (0_u64..).zip(octaves) {
        height += amplitude * held.noise(n * (MEAN_RADIUS_M / wavelength), octave);
        wavelength *= 0.5;
        amplitude *= 0.52;
    }
    let height = height.clamp(-NOISE_MAX_M, NOISE_MAX_M);
    let is_sea = height <= 0.0;
    // A cone of 45 km with a rounded top rises to exactly the summit's height, a bowl of 30 km sinks to the basin's.
    let mut land = height.max(0.0);
    land = towards(land, SUMMIT_M, nearness(n, SUMMIT_DEG, 45_000.0));
    land = towards(land, BASIN_M, nearness(n, BASIN_DEG, 30_000.0));
    let raised = (land - height.max(0.0)).abs() > 0.0;
    let kind = if is_sea && !raised {
        SurfaceKind::Water
    } else if voids.noise(n * (MEAN_RADIUS_M / 40_000.0), 99) > 0.62 {
        SurfaceKind::Void
    } else {
        SurfaceKind::Land
    };
    (land, kind)
}

/// From one height to another.
fn towards(from: f64, to: f64, share: f64) -> f64 {
    from + (to - from) * share
}

/// 1 at a place, 0 beyond `reach_m` of it, level at both ends.
fn nearness(n: DVec3, (latitude_deg, longitude_deg): (f64, f64), reach_m: f64) -> f64 {
    let there = Partition::Geographic.normal(longitude_deg, latitude_deg);
    let d = ((n - there).length() * MEAN_RADIUS_M / reach_m).min(1.0);
    (1.0 - d * d).powi(2)
}

/// A cell of a unit lattice with a number at each corner, of one seed.
#[derive(Clone, Copy, Debug)]
struct Lattice {
    cell: DVec3,
    corners: [f64; 8],
}

impl Default for Lattice {
    /// No cell.
    fn default() -> Self {
        Self {
            cell: DVec3::NAN,
            corners: [0.0; 8],
        }
    }
}

impl Lattice {
    /// Noise in space by trilinear blending of the numbers around a point, -1 to 1.
    fn noise(&mut self, p: DVec3, seed: u64) -> f64 {
        let cell = p.floor();
        if cell != self.cell {
            self.cell = cell;
            for (k, corner) in (0_u8..).zip(&mut self.corners) {
                let at = DVec3::new(f64::from(k & 1), f64::from(k >> 1 & 1), f64::from(k >> 2));
                *corner = unit(cell_hash(cell + at, seed));
            }
        }
        let t = p - cell;
        let s = t * t * (DVec3::splat(3.0) - 2.0 * t);
        let mix = |a: f64, b: f64, s: f64| a + (b - a) * s;
        let edge = |k: usize| mix(self.corners[k], self.corners[k + 1], s.x);
        let face = |k: usize| mix(edge(k), edge(k + 2), s.y);
        mix(face(0), face(4), s.z)
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "lattice numbers are small"
)]
fn cell_hash(cell: DVec3, seed: u64) -> u64 {
    hash(
        cell.x as i64,
        cell.y as i64,
        seed ^ ((cell.z as i64 as u64) << 20),
    )
}

/// -1 to 1.
#[expect(clippy::cast_precision_loss, reason = "32 bits fit a double")]
fn unit(hash: u64) -> f64 {
    (hash >> 32) as f64 / f64::from(u32::MAX) * 2.0 - 1.0
}

impl TileSource for Planet {
    fn info(&self) -> &PackInfo {
        &self.info
    }

    fn contains(&self, key: TileKey) -> bool {
        let scale = f64::from(1_u32 << key.level);
        let degrees =
            |posts: i32| f64::from(posts) * scale / f64::from(self.info.grid.posts_per_degree);
        if degrees(key.south()).max(-degrees(key.south() + TILE_SIDE - 1)) > 90.0 {
            return false;
        }
        let inside = |low: i32, first: i32| {
            degrees(first) >= f64::from(low) && degrees(first + TILE_SIDE) <= f64::from(low + 1)
        };
        !(self.kind == Kind::Earth
            && key.partition == Partition::Geographic
            && inside(HOLE_DEG.0, key.south())
            && inside(HOLE_DEG.1, key.west()))
    }

    fn undulation_m(&self, latitude: Radians, longitude: Radians) -> Option<f64> {
        let (lat, lon) = (latitude.0, longitude.0);
        self.undulates
            .then(|| 40.0 * lat.cos() * (2.0 * lon).sin() + 10.0 * lat.sin())
    }

    fn read_tile(
        &self,
        key: TileKey,
        _: &mut TileReader,
        tile: &mut Tile,
    ) -> Result<(), TileError> {
        if !self.contains(key) {
            return Err(TileError::Absent);
        }
        let grid = self.info.grid;
        let mut held = Held::default();
        for row in key.south()..key.south() + TILE_SIDE {
            for column in key.west()..key.west() + TILE_SIDE {
                let n = key.partition.normal(
                    grid.longitude_deg(key.level, column),
                    grid.latitude_deg(key.level, row),
                );
                let (height_m, kind) = match self.kind {
                    Kind::Earth => earth(n, &mut held),
                    _ => self.height(n),
                };
                let at = TileKey::index_of(column, row);
                tile.quanta[at] = quanta(height_m);
                tile.kind[at] = kind;
            }
        }
        Ok(())
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "float casts saturate, and heights lie within the codes"
)]
fn quanta(height_m: f64) -> u16 {
    ((height_m - BASE_M) / UNIT_M).round() as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mountains_are_found_on_every_parallel_that_is_flown() {
        let planet = Planet::new(Kind::Earth, 1200);
        for latitude_deg in [45.0, 46.5, 60.25, 70.25] {
            let longitude_deg = planet.mountains_deg(latitude_deg);
            let at = |k: f64| {
                let n = Partition::Geographic.normal(longitude_deg, latitude_deg + 0.01 * k);
                planet.height(n)
            };
            let heights = (-15..15).map(|k| at(f64::from(k)).0);
            let (low, high) = heights.fold((f64::MAX, f64::MIN), |r, h| (r.0.min(h), r.1.max(h)));
            assert!(
                high - low > 800.0,
                "{latitude_deg}: {low} to {high} m at {longitude_deg}"
            );
            assert_eq!(at(0.0).1, SurfaceKind::Land, "{latitude_deg}");
        }
    }

    #[test]
    fn the_planet_reaches_from_the_lowest_to_the_highest_land_and_has_sea_and_voids() {
        let planet = Planet::new(Kind::Earth, 1200);
        let at = |(lat, lon): (f64, f64)| planet.height(Partition::Geographic.normal(lon, lat));
        assert!((at(SUMMIT_DEG).0 - SUMMIT_M).abs() < 1e-6, "summit");
        assert!((at(BASIN_DEG).0 - BASIN_M).abs() < 1e-6, "basin");
        let (mut sea, mut void, mut high) = (0, 0, 0.0_f64);
        for k in 0..4000 {
            let k = f64::from(k);
            let (height, kind) = at((-90.0 + 0.045 * k, (k * 7.77) % 360.0 - 180.0));
            sea += i32::from(kind == SurfaceKind::Water);
            void += i32::from(kind == SurfaceKind::Void);
            high = high.max(height);
            assert!(
                kind != SurfaceKind::Water || height.abs() < 1e-9,
                "the sea lies at 0"
            );
        }
        assert!((1000..3200).contains(&sea), "{sea} of 4000 are sea");
        assert!(void > 10, "{void} of 4000 are void");
        assert!(high > 1500.0, "{high} m");
    }
}
