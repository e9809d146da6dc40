//! The demo terrain: an alpine valley made of arithmetic, 0.8 x 1.2 degrees (89 x 91 km) on a 3" grid.
//!
//! A winding main valley with a flat floor near 600 m crosses it from west to east; side valleys climb from it into
//! mountains of up to about 3200 m with sharp ridges; a long lake and an airfield lie on its floor; on all sides the land
//! falls to a plain near sea level, so that the pack's edge is no cliff. No place of this shape exists.
//!
//! Everything is exact arithmetic (see [`crate::terrain::synth_noise`]): a seed gives the same bytes on every machine.

use crate::terrain::bake_levels::{Block, Levels, Post};
use crate::terrain::codec::SurfaceKind;
use crate::terrain::geoid::GeoidGrid;
use crate::terrain::grid::Grid;
use crate::terrain::pack::{PackInfo, PostRect, SourceInfo};
use crate::terrain::store::Scale;
use crate::terrain::synth_noise::{fractal, ridged, smooth_step};
use crate::terrain::synth_valley::{Course, Near};
use std::io;
use std::path::Path;

/// The seed of the demo.
pub const SEED: u64 = 1;

/// Posts per degree.
const GRID: Grid = Grid {
    posts_per_degree: 1200,
};
/// A quarter of a metre, from -1000 m: the floor's gentle slope shows no steps.
const SCALE: Scale = Scale {
    unit_m: 0.25,
    base_m: -1000.0,
};

/// South-west corner and size, degrees.
const SOUTH_DEG: f64 = 47.0;
const WEST_DEG: f64 = 10.6;
const HEIGHT_DEG: f64 = 0.8;
const WIDTH_DEG: f64 = 1.2;

/// Kilometres in a degree at 47.4 N, to a thousandth of the formulae for the WGS 84 ellipsoid; the terrain's own plane.
const KM_PER_DEGREE_NORTH: f64 = 111.2;
const KM_PER_DEGREE_EAST: f64 = 75.5;

/// Size in its own plane, km.
pub(crate) const WIDTH_KM: f64 = WIDTH_DEG * KM_PER_DEGREE_EAST;
/// Size in its own plane, km.
pub(crate) const HEIGHT_KM: f64 = HEIGHT_DEG * KM_PER_DEGREE_NORTH;

/// The land falls to the plain over this distance from the edge, km.
const SHELF_KM: f64 = 15.0;
/// Radius of the airfield's level ground and of its slope, km.
const AIRFIELD_KM: f64 = 0.85;
const AIRFIELD_SLOPE_KM: f64 = 1.3;
/// Side of the squares that the valleys near a post are looked up for, posts.
const SQUARE: i32 = 16;

/// A point on the main valley's centreline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CentrePoint {
    /// Degrees north.
    pub latitude_deg: f64,
    /// Degrees east.
    pub longitude_deg: f64,
    /// Orthometric height of the ground (or the lake) there, metres.
    pub floor_m: f64,
    /// Distance from the western end, metres.
    pub along_m: f64,
}

/// The airfield: level ground of 1.7 km across on the valley floor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Airfield {
    /// Degrees north.
    pub latitude_deg: f64,
    /// Degrees east.
    pub longitude_deg: f64,
    /// Orthometric height, metres.
    pub elevation_m: f64,
    /// Direction of the valley there, as a vector east and north of length 1.
    pub along: (f64, f64),
}

/// What a flight needs to know of the terrain.
#[derive(Clone, Debug, PartialEq)]
pub struct Valley {
    /// The centreline from west to east, a point every half kilometre or so.
    pub centreline: Vec<CentrePoint>,
    /// The airfield.
    pub airfield: Airfield,
    /// Orthometric height of the lake, metres.
    pub lake_m: f64,
}

/// The main valley of a seed. Within 1.2 km of the centreline the ground rises no more than 60 m above `floor_m`.
#[must_use]
pub fn valley(seed: u64) -> Valley {
    let land = Landscape::new(seed);
    let degrees = |x: f64, y: f64| {
        (
            SOUTH_DEG + y / KM_PER_DEGREE_NORTH,
            WEST_DEG + x / KM_PER_DEGREE_EAST,
        )
    };
    let mut centreline = Vec::new();
    for point in land.course.main_points() {
        let (latitude_deg, longitude_deg) = degrees(point.x, point.y);
        let (floor_m, _) = land.ground(latitude_deg, longitude_deg);
        centreline.push(CentrePoint {
            latitude_deg,
            longitude_deg,
            floor_m,
            along_m: point.along * 1000.0,
        });
    }
    let field = land.course.airfield();
    let (latitude_deg, longitude_deg) = degrees(field.x, field.y);
    Valley {
        centreline,
        airfield: Airfield {
            latitude_deg,
            longitude_deg,
            elevation_m: land.airfield_m,
            along: field.direction,
        },
        lake_m: land.course.lake_m(),
    }
}

/// The terrain as a function of place.
#[derive(Debug)]
pub struct Landscape {
    seed: u64,
    course: Course,
    airfield_m: f64,
}

impl Landscape {
    /// Of a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let course = Course::new(seed);
        // A little above the floor, on a whole metre.
        let airfield_m = (course.airfield().floor_m + 6.0).round();
        Self {
            seed,
            course,
            airfield_m,
        }
    }

    /// Orthometric height in metres, and what is there, at a point in degrees north and east.
    #[must_use]
    pub fn ground(&self, latitude_deg: f64, longitude_deg: f64) -> (f64, SurfaceKind) {
        let (x, y) = plane(latitude_deg, longitude_deg);
        self.ground_near(x, y, &self.course.near(x, y, 0.0))
    }

    /// The same from a place in the plane and the valleys near it.
    fn ground_near(&self, x: f64, y: f64, near: &Near) -> (f64, SurfaceKind) {
        let crest_m = self.crest_m(x, y);
        let valleys = self.course.shape(near, x, y, crest_m);
        // The floor of a valley is not a table: fans and terraces of a few metres, none on the lake's shore.
        let flat = 1.0 - valleys.mask;
        let fans = 5.0 * flat * fractal(x / 1.7, y / 1.7, 4, self.seed ^ 0x0f1a);
        let mut height_m = valleys.height_m + fans * valleys.off_lake;
        if let Some(shore_km) = valleys.shore_km {
            let wiggle = 0.3 * fractal(x / 1.6, y / 1.6, 4, self.seed ^ 0x1a4e);
            if shore_km + wiggle < 0.0 {
                return (self.course.lake_m(), SurfaceKind::Water);
            }
            height_m = height_m.max(self.course.lake_m() + 1.0);
        }
        let inland = self.inland(x, y);
        let plain_m = 45.0 + 40.0 * fractal(x / 6.0, y / 6.0, 4, self.seed ^ 0x91a1);
        height_m = plain_m + (height_m - plain_m) * inland;
        let field = self.course.airfield();
        let (dx, dy) = (x - field.x, y - field.y);
        let away = smooth_step(AIRFIELD_KM, AIRFIELD_SLOPE_KM, (dx * dx + dy * dy).sqrt());
        height_m = self.airfield_m + (height_m - self.airfield_m) * away;
        (height_m, SurfaceKind::Land)
    }

    /// The mountains as they would stand without valleys.
    fn crest_m(&self, x: f64, y: f64) -> f64 {
        let warp_x = 1.4 * fractal(x / 7.0, y / 7.0, 4, self.seed ^ 0x3a01);
        let warp_y = 1.4 * fractal(x / 7.0, y / 7.0, 4, self.seed ^ 0x3a02);
        let r = ridged(
            (x + warp_x) / 5.2,
            (y + warp_y) / 5.2,
            7,
            self.seed ^ 0x41d6,
        );
        // Some massifs stand higher than others.
        let massif_m = 600.0 * fractal(x / 17.0, y / 17.0, 2, self.seed ^ 0x3a55);
        1450.0 + massif_m + 1650.0 * r
    }

    /// 1 inside, falling to 0 on the edge, along a line that is not straight.
    fn inland(&self, x: f64, y: f64) -> f64 {
        let wander = 4.0 * fractal(x / 14.0, y / 14.0, 5, self.seed ^ 0x5e1f);
        let rise = |edge_km: f64| {
            let wandered = edge_km + wander * smooth_step(0.0, SHELF_KM, edge_km);
            smooth_step(0.0, SHELF_KM, wandered)
        };
        rise(x) * rise(WIDTH_KM - x) * rise(y) * rise(HEIGHT_KM - y)
    }
}

/// Kilometres east and north of the south-west corner.
fn plane(latitude_deg: f64, longitude_deg: f64) -> (f64, f64) {
    (
        (longitude_deg - WEST_DEG) * KM_PER_DEGREE_EAST,
        (latitude_deg - SOUTH_DEG) * KM_PER_DEGREE_NORTH,
    )
}

/// The posts of the terrain.
fn rect() -> PostRect {
    let posts = f64::from(GRID.posts_per_degree);
    #[expect(
        clippy::cast_possible_truncation,
        reason = "four constants far inside i32"
    )]
    PostRect {
        south: (SOUTH_DEG * posts).round() as i32,
        west: (WEST_DEG * posts).round() as i32,
        north: ((SOUTH_DEG + HEIGHT_DEG) * posts).round() as i32,
        east: ((WEST_DEG + WIDTH_DEG) * posts).round() as i32,
    }
}

/// Writes the pack of a seed. `progress` is called with the rows done and their number.
///
/// # Errors
/// If the pack cannot be written; none is left then.
pub fn bake(
    seed: u64,
    out: &Path,
    jobs: usize,
    progress: &mut dyn FnMut(usize, usize),
) -> io::Result<PackInfo> {
    let land = Landscape::new(seed);
    let rect = rect();
    let geoid = GeoidGrid::over(GRID, &[rect], jobs);
    let mut levels = Levels::create(out, GRID, SCALE, jobs)?;
    let rows = (rect.north - rect.south + 1).cast_unsigned() as usize;
    // Bands of squares, a few for each thread.
    let band = SQUARE * i32::try_from(jobs.max(1) * 2).unwrap_or(1);
    let mut south = rect.south;
    while south <= rect.north {
        progress((south - rect.south).cast_unsigned() as usize, rows);
        let north = (south + band).min(rect.north + 1);
        levels.scatter(&land.band(&rect, south, north, jobs));
        levels.flush(north, None)?;
        south = north;
    }
    progress(rows, rows);
    let source = SourceInfo {
        name: format!("synthetic valley, seed {seed}"),
        rect,
    };
    levels.finish(&geoid, &[source], &mut |done, all| {
        progress(done, all);
        true
    })
}

impl Landscape {
    /// Posts of the rows from `south` up to but not including `north`, in `jobs` threads.
    fn band(&self, rect: &PostRect, south: i32, north: i32, jobs: usize) -> Block {
        let columns = (rect.east - rect.west + 1).cast_unsigned() as usize;
        let rows = (north - south).cast_unsigned() as usize;
        let mut posts = vec![None; columns * rows];
        let share = rows.div_ceil(jobs.max(1)).max(1);
        std::thread::scope(|scope| {
            let mut parts = (south..)
                .step_by(share)
                .zip(posts.chunks_mut(share * columns));
            let own = parts.next();
            for (south, part) in parts {
                let work = move || self.rows(rect.west, south, columns, part);
                // Rows of a thread that cannot start stay empty and are made below.
                let _ = std::thread::Builder::new()
                    .name("synth".into())
                    .spawn_scoped(scope, work);
            }
            if let Some((south, part)) = own {
                self.rows(rect.west, south, columns, part);
            }
        });
        let first_rows = (south..).step_by(share);
        for (south, part) in first_rows.zip(posts.chunks_mut(share * columns)) {
            if part.first().is_some_and(Option::is_none) {
                self.rows(rect.west, south, columns, part);
            }
        }
        Block {
            south,
            west: rect.west,
            columns,
            posts,
        }
    }

    fn rows(&self, west: i32, south: i32, columns: usize, posts: &mut [Option<Post>]) {
        let side = SQUARE.cast_unsigned() as usize;
        for (square_south, strip) in (south..)
            .step_by(side)
            .zip(posts.chunks_mut(side * columns))
        {
            for start in (0..columns).step_by(side) {
                let square_west = west + i32::try_from(start).unwrap_or(0);
                let (x, y) = place(square_west + SQUARE / 2, square_south + SQUARE / 2);
                let near = self.course.near(x, y, SQUARE_RADIUS_KM);
                for (j, row) in (square_south..).zip(strip.chunks_mut(columns)) {
                    let end = columns.min(start + side);
                    for (i, post) in (square_west..).zip(&mut row[start..end]) {
                        let (x, y) = place(i, j);
                        let (height_m, kind) = self.ground_near(x, y, &near);
                        *post = Some(Post {
                            quanta: SCALE.quanta(height_m),
                            kind,
                            error_m: 0.0,
                        });
                    }
                }
            }
        }
    }
}

/// Half the diagonal of a square, generously: 16 posts are 1.49 km by 1.01 km.
const SQUARE_RADIUS_KM: f64 = 1.0;

/// A post in the plane.
fn place(i: i32, j: i32) -> (f64, f64) {
    plane(GRID.latitude_deg(0, j), GRID.longitude_deg(0, i))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_valley_is_open_to_fly_along() {
        let valley = valley(SEED);
        let land = Landscape::new(SEED);
        let length_m = valley.centreline.last().expect("points").along_m;
        assert!(length_m > 80_000.0, "{length_m} m");
        for pair in valley.centreline.windows(2) {
            let (a, b) = (&pair[0], &pair[1]);
            let east_m = (b.longitude_deg - a.longitude_deg) * KM_PER_DEGREE_EAST * 1000.0;
            let north_m = (b.latitude_deg - a.latitude_deg) * KM_PER_DEGREE_NORTH * 1000.0;
            let length = (east_m * east_m + north_m * north_m).sqrt();
            for side in -4..=4 {
                let off_m = f64::from(side) * 300.0;
                let latitude =
                    a.latitude_deg + off_m * east_m / length / 1000.0 / KM_PER_DEGREE_NORTH;
                let longitude =
                    a.longitude_deg - off_m * north_m / length / 1000.0 / KM_PER_DEGREE_EAST;
                let (height_m, _) = land.ground(latitude, longitude);
                assert!(
                    height_m < a.floor_m + 60.0,
                    "{height_m} m at {off_m} m beside {a:?}"
                );
            }
        }
    }

    #[test]
    fn the_floor_is_near_600_metres_inland() {
        for point in &valley(SEED).centreline {
            let inland = (18_000.0..75_000.0).contains(&point.along_m);
            if inland {
                assert!((540.0..680.0).contains(&point.floor_m), "{point:?}");
            }
        }
    }

    #[test]
    fn the_airfield_is_level() {
        let field = valley(SEED).airfield;
        let land = Landscape::new(SEED);
        for step in -7..=7 {
            let off_km = f64::from(step) * 0.1;
            for (dx, dy) in [(off_km, 0.0), (0.0, off_km)] {
                let (height_m, kind) = land.ground(
                    field.latitude_deg + dy / KM_PER_DEGREE_NORTH,
                    field.longitude_deg + dx / KM_PER_DEGREE_EAST,
                );
                assert!((height_m - field.elevation_m).abs() < 1e-9, "{height_m}");
                assert_eq!(kind, SurfaceKind::Land);
            }
        }
    }

    #[test]
    fn the_mountains_are_alpine_and_the_edge_is_low() {
        let land = Landscape::new(SEED);
        let (mut top, mut edge, mut water) = (0.0_f64, 0.0_f64, 0);
        for row in 0..=160 {
            for column in 0..=240 {
                let latitude = SOUTH_DEG + f64::from(row) * HEIGHT_DEG / 160.0;
                let longitude = WEST_DEG + f64::from(column) * WIDTH_DEG / 240.0;
                let (height_m, kind) = land.ground(latitude, longitude);
                top = top.max(height_m);
                water += i32::from(kind == SurfaceKind::Water);
                if row % 160 == 0 || column % 240 == 0 {
                    edge = edge.max(height_m);
                }
            }
        }
        assert!((2800.0..3500.0).contains(&top), "highest {top} m");
        assert!(edge < 120.0, "highest edge {edge} m");
        assert!(water > 60, "the lake: {water} of 38 801 samples of 0.2 km2");
    }

    #[test]
    fn squares_see_every_valley_that_a_single_point_sees() {
        let land = Landscape::new(SEED);
        let rect = rect();
        let block = land.band(&rect, rect.south + 480, rect.south + 496, 1);
        for (at, post) in block.posts.iter().enumerate().step_by(37) {
            let i = rect.west + i32::try_from(at % block.columns).expect("small");
            let j = block.south + i32::try_from(at / block.columns).expect("small");
            let (height_m, kind) = land.ground(GRID.latitude_deg(0, j), GRID.longitude_deg(0, i));
            let post = post.expect("made");
            assert_eq!((post.quanta, post.kind), (SCALE.quanta(height_m), kind));
        }
    }
}
