//! A whole Earth from one formula of the direction, the same in every partition.

use glam::DVec3;
use glasswing::geo::Geodetic;
use glasswing::terrain::codec::{SurfaceKind, Tile};
use glasswing::terrain::grid::TileKey;
use glasswing::terrain::pack::{PackInfo, TileError, TileReader};
use glasswing::terrain::partition::{CAP_LATITUDE_MIN_DEG, Partition};
use glasswing::terrain::surface::TileSource;
use glasswing::units::Radians;

/// See the module. Posts are stored in steps of 0.25 m.
#[derive(Debug)]
pub(crate) struct Earth {
    info: PackInfo,
}

const UNIT_M: f64 = 0.25;
const BASE_M: f64 = -1000.0;

/// Waves on the ellipsoid: amplitude, m; wave number of the unit sphere, and the axis along which it counts.
const WAVES: [(f64, f64, [f64; 3]); 5] = [
    (600.0, 700.0, [0.66, 0.33, -0.67]),
    (300.0, 1000.0, [-0.48, 0.60, 0.64]),
    (120.0, 3300.0, [0.36, 0.80, 0.48]),
    (50.0, 5100.0, [-0.80, 0.00, 0.60]),
    (8.0, 13_000.0, [0.60, -0.64, 0.48]),
];

/// Orthometric height in the direction of a normal, metres: 22 to 2178.
pub(crate) fn height_m(normal: DVec3) -> f64 {
    let waves = WAVES.iter();
    1100.0
        + waves
            .map(|(height, number, axis)| height * (number * normal.dot((*axis).into())).sin())
            .sum::<f64>()
}

/// Height of the geoid, metres.
fn undulation_m(normal: DVec3) -> f64 {
    35.0 * (3.0 * normal.x + 2.0 * normal.y - normal.z).sin()
}

/// How far a point lies above the ground of the formula, metres.
pub(crate) fn above_ground_m(point: DVec3) -> f64 {
    let g = Geodetic::from_ecef(point);
    let normal = Partition::Geographic.normal(g.longitude.to_degrees(), g.latitude.to_degrees());
    g.height_ellipsoid.0 - height_m(normal) - undulation_m(normal)
}

impl Earth {
    /// With posts in some of the partitions.
    pub(crate) fn new(posts_per_degree: u32, partitions: [bool; 3]) -> Self {
        let mut info = super::info(posts_per_degree);
        info.partitions = partitions;
        info.unit_m = UNIT_M;
        info.base_m = BASE_M;
        info.height_min_m = 0.0;
        info.height_max_m = 2200.0;
        Self { info }
    }

    /// The normal at a post.
    fn normal(&self, partition: Partition, level: u8, i: i32, j: i32) -> DVec3 {
        let grid = self.info.grid;
        partition.normal(grid.longitude_deg(level, i), grid.latitude_deg(level, j))
    }
}

impl TileSource for Earth {
    fn info(&self) -> &PackInfo {
        &self.info
    }

    fn contains(&self, key: TileKey) -> bool {
        if key.partition == Partition::Geographic {
            let limit = self.info.grid.row_max() >> key.level;
            return key.south() <= limit && key.south() + 127 >= -limit;
        }
        // As a bake does: tiles with a post within the cap.
        let near = |v: i32| 0.clamp(v, v + 127);
        let n = self.normal(
            key.partition,
            key.level,
            near(key.west()),
            near(key.south()),
        );
        self.info.has(key.partition) && n.z.abs() >= CAP_LATITUDE_MIN_DEG.to_radians().sin()
    }

    fn undulation_m(&self, latitude: Radians, longitude: Radians) -> Option<f64> {
        let normal = Partition::Geographic.normal(longitude.to_degrees(), latitude.to_degrees());
        Some(undulation_m(normal))
    }

    fn read_tile(
        &self,
        key: TileKey,
        _: &mut TileReader,
        tile: &mut Tile,
    ) -> Result<(), TileError> {
        for y in 0..128 {
            for x in 0..128 {
                let (i, j) = (key.west() + x, key.south() + y);
                let height = height_m(self.normal(key.partition, key.level, i, j));
                let at = TileKey::index_of(i, j);
                tile.quanta[at] = ((height - BASE_M) / UNIT_M).round() as u16;
                tile.kind[at] = SurfaceKind::Land;
            }
        }
        Ok(())
    }
}
