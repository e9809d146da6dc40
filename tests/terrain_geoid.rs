//! The geoid of a pack against NGA's own 15' grid of EGM96, as distributed by PROJ (egm96_15.gtx).

#![expect(
    clippy::expect_used,
    reason = "a test says what it needs and fails where that is not so"
)]

use glasswing::terrain::geoid::GeoidGrid;
use glasswing::terrain::grid::Grid;
use glasswing::terrain::pack::PostRect;
use glasswing::units::Radians;

mod support;

const GRID: Grid = Grid {
    posts_per_degree: 1200,
};

/// South-west corners of cells of one degree: every hemisphere, both poles, the date line, the deepest low (south of
/// India) and the highest high (New Guinea).
const CELLS: [(i32, i32); 10] = [
    (50, 14),
    (46, 8),
    (-33, -71),
    (0, 10),
    (-20, -180),
    (-20, 179),
    (4, 78),
    (-8, 147),
    (89, 30),
    (-90, -100),
];

/// Metres. Measured over all nodes below: 0.0005 m at most, which is the pack's own rounding to the millimetre.
const TOLERANCE_M: f64 = 0.002;

struct Gtx(Vec<u8>);

impl Gtx {
    /// The node at a row from the south pole and a column from 180 W, metres. 721 rows of 1440 big-endian f32 after a
    /// header of 40 bytes.
    fn node(&self, row: i32, column: i32) -> f64 {
        let at = row * 1440 + column.rem_euclid(1440);
        let start = 40 + 4 * usize::try_from(at).expect("inside");
        let bytes: [u8; 4] = self.0[start..start + 4].try_into().expect("four bytes");
        f64::from(f32::from_be_bytes(bytes))
    }
}

#[test]
fn undulations_are_those_of_the_published_grid() {
    let Some(data) = support::data_dir() else {
        return;
    };
    let gtx = Gtx(std::fs::read(data.join("geoid/egm96_15.gtx")).expect("the grid is there"));
    let areas: Vec<PostRect> = CELLS
        .iter()
        .map(|(latitude, longitude)| PostRect {
            south: latitude * 1200,
            west: longitude * 1200,
            north: (latitude + 1) * 1200,
            east: (longitude + 1) * 1200,
        })
        .collect();
    let geoid = GeoidGrid::over(GRID, &areas, 2);
    let (mut points, mut worst) = (0, 0.0_f64);
    for (latitude, longitude) in CELLS {
        for dj in 0..=4 {
            for di in 0..=4 {
                let (row, column) = ((latitude + 90) * 4 + dj, (longitude + 180) * 4 + di);
                let point = (
                    Radians::from_degrees(f64::from(row) / 4.0 - 90.0),
                    Radians::from_degrees(f64::from(column) / 4.0 - 180.0),
                );
                let got = geoid.undulation_m(point.0, point.1).expect("covered");
                let difference = (got - gtx.node(row, column)).abs();
                assert!(
                    difference < TOLERANCE_M,
                    "{latitude} {longitude}: {difference} m"
                );
                worst = worst.max(difference);
                points += 1;
            }
        }
    }
    assert!(points >= 200, "{points} points");
    println!("{points} points, largest difference {worst:.4} m");
}

#[test]
fn between_nodes_undulations_are_bilinear() {
    let Some(data) = support::data_dir() else {
        return;
    };
    let gtx = Gtx(std::fs::read(data.join("geoid/egm96_15.gtx")).expect("the grid is there"));
    let cell = PostRect {
        south: 46 * 1200,
        west: 8 * 1200,
        north: 47 * 1200,
        east: 9 * 1200,
    };
    let geoid = GeoidGrid::over(GRID, &[cell], 1);
    // A quarter of the way east and three quarters north of the node at 46.25 N 8.5 E.
    let (row, column) = (136 * 4 + 1, 188 * 4 + 2);
    let south = gtx.node(row, column) * 0.75 + gtx.node(row, column + 1) * 0.25;
    let north = gtx.node(row + 1, column) * 0.75 + gtx.node(row + 1, column + 1) * 0.25;
    let want = south * 0.25 + north * 0.75;
    let got = geoid
        .undulation_m(
            Radians::from_degrees(46.25 + 0.1875),
            Radians::from_degrees(8.5 + 0.0625),
        )
        .expect("covered");
    assert!((got - want).abs() < TOLERANCE_M, "{got} {want}");
}
