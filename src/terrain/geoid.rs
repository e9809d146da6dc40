//! The EGM96 geoid over a pack's area: undulations at 15' nodes, bilinear between them.
//!
//! The undulation N is the height of the geoid above the WGS 84 ellipsoid: ellipsoidal height = orthometric height + N.
//! Node values come from the spherical harmonic model itself (degree and order 360, crate `egm96`), evaluated when a pack
//! is baked. Bilinear interpolation in a 15' grid is how EGM96 is commonly distributed and used (NGA's WW15MGH grid).

use crate::terrain::grid::Grid;
use crate::terrain::pack::PostRect;
use crate::terrain::pack_format::{i32_at, u32_at};
use crate::units::Radians;

/// Nodes per degree.
const NODES_PER_DEGREE: i32 = 4;
/// Nodes around a circle of latitude.
const NODES_AROUND: i32 = 360 * NODES_PER_DEGREE;
/// The row of the north pole.
const ROW_MAX: i32 = 90 * NODES_PER_DEGREE;
/// Nodes kept beyond the area on every side: a degree.
const MARGIN: i32 = NODES_PER_DEGREE;
/// Marks a node without a value in the file.
const ABSENT: i32 = i32::MIN;
/// Bytes before the nodes in the pack's section.
const HEAD_BYTES: usize = 16;

/// Undulations over a rectangle of 15' nodes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GeoidGrid {
    /// Southernmost node row, in 15' from the equator.
    south: i32,
    /// Westernmost node column, in 15' from Greenwich.
    west: i32,
    rows: i32,
    columns: i32,
    /// Millimetres, southern row first, west first; [`ABSENT`] where there is none.
    nodes_mm: Vec<i32>,
}

impl GeoidGrid {
    /// A grid whose nodes cover `areas` and a degree around each; elsewhere in their common frame nodes stay absent. An
    /// undulation is evaluated for every node, in `jobs` threads; about half a millisecond each.
    #[must_use]
    pub fn over(grid: Grid, areas: &[PostRect], jobs: usize) -> Self {
        let wanted: Vec<NodeRect> = areas.iter().map(|a| NodeRect::around(grid, a)).collect();
        let south = wanted.iter().map(|w| w.south).min().unwrap_or(0);
        let north = wanted.iter().map(|w| w.north).max().unwrap_or(-1);
        let west = wanted.iter().map(|w| w.west).min().unwrap_or(0);
        let east = wanted.iter().map(|w| w.east).max().unwrap_or(-1);
        let columns = (east - west + 1).min(NODES_AROUND);
        let mut geoid = Self {
            south,
            west,
            rows: north - south + 1,
            columns,
            nodes_mm: Vec::new(),
        };
        geoid.nodes_mm = vec![ABSENT; index(geoid.rows) * index(columns)];
        let mut places: Vec<usize> = Vec::new();
        for rect in &wanted {
            for row in rect.south..=rect.north {
                for column in rect.west..=rect.east {
                    places.extend(geoid.place(row, column));
                }
            }
        }
        places.sort_unstable();
        places.dedup();
        let values = geoid.evaluate(&places, jobs);
        for (place, value) in places.into_iter().zip(values) {
            geoid.nodes_mm[place] = value;
        }
        geoid
    }

    /// The model at some of the nodes, millimetres.
    fn evaluate(&self, places: &[usize], jobs: usize) -> Vec<i32> {
        let columns = index(self.columns).max(1);
        let at = |place: &usize| {
            let degrees = |node: i32| f64::from(node) / f64::from(NODES_PER_DEGREE);
            let row = i32::try_from(place / columns).unwrap_or(0);
            let column = i32::try_from(place % columns).unwrap_or(0);
            node_mm(degrees(self.south + row), degrees(self.west + column))
        };
        let share = places.len().div_ceil(jobs.max(1)).max(1);
        let mut values = vec![ABSENT; places.len()];
        std::thread::scope(|scope| {
            for (values, places) in values.chunks_mut(share).zip(places.chunks(share)) {
                let work = move || {
                    for (value, place) in values.iter_mut().zip(places) {
                        *value = at(place);
                    }
                };
                let builder = std::thread::Builder::new().name("geoid".into());
                // A thread that cannot start leaves its nodes absent; they are filled below.
                let _ = builder.spawn_scoped(scope, work);
            }
        });
        for (value, place) in values.iter_mut().zip(places) {
            if *value == ABSENT {
                *value = at(place);
            }
        }
        values
    }

    /// The undulation at a point, metres: bilinear in latitude and longitude. `None` where a node around it is absent or
    /// the point is no place on Earth.
    #[must_use]
    pub fn undulation_m(&self, latitude: Radians, longitude: Radians) -> Option<f64> {
        let rows = latitude.to_degrees() * f64::from(NODES_PER_DEGREE);
        let columns = longitude.to_degrees() * f64::from(NODES_PER_DEGREE);
        // A rounding past the pole is the pole.
        let rows = match rows.abs() - f64::from(ROW_MAX) {
            beyond if beyond <= 0.0 => rows,
            beyond if beyond < 1e-9 => f64::from(ROW_MAX).copysign(rows),
            _ => return None,
        };
        if !columns.is_finite() {
            return None;
        }
        let columns = columns.rem_euclid(f64::from(NODES_AROUND));
        let (south, north_weight) = split(rows);
        let (west, east_weight) = split(columns);
        let row = |j: i32| {
            let a = self.node_m(j, west)?;
            // A weight of nothing needs no neighbour: the edge of the grid is inside it.
            if east_weight <= 0.0 {
                return Some(a);
            }
            Some(a + (self.node_m(j, west + 1)? - a) * east_weight)
        };
        let a = row(south)?;
        if north_weight <= 0.0 {
            return Some(a);
        }
        Some(a + (row(south + 1)? - a) * north_weight)
    }

    fn node_m(&self, row: i32, column: i32) -> Option<f64> {
        match *self.nodes_mm.get(self.place(row, column)?)? {
            ABSENT => None,
            mm => Some(f64::from(mm) / 1000.0),
        }
    }

    fn place(&self, row: i32, column: i32) -> Option<usize> {
        let down = row - self.south;
        let right = (column - self.west).rem_euclid(NODES_AROUND);
        let inside = (0..self.rows).contains(&down) && right < self.columns;
        inside.then(|| index(down) * index(self.columns) + index(right))
    }

    /// The section of a pack.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(HEAD_BYTES + 4 * self.nodes_mm.len());
        for head in [self.south, self.west, self.rows, self.columns] {
            bytes.extend(head.to_le_bytes());
        }
        for node in &self.nodes_mm {
            bytes.extend(node.to_le_bytes());
        }
        bytes
    }

    /// From the section of a pack; `None` if it is none.
    #[must_use]
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        if bytes.len() < HEAD_BYTES {
            return None;
        }
        let rows = i32::try_from(u32_at(bytes, 8)).ok()?;
        let columns = i32::try_from(u32_at(bytes, 12)).ok()?;
        let nodes = index(rows).checked_mul(index(columns))?;
        let right_size = nodes.checked_mul(4)?.checked_add(HEAD_BYTES)? == bytes.len();
        let (south, west) = (i32_at(bytes, 0), i32_at(bytes, 4));
        let placed = (-ROW_MAX..=ROW_MAX).contains(&south)
            && west.abs() <= NODES_AROUND
            && columns <= NODES_AROUND;
        (right_size && placed).then(|| Self {
            south,
            west,
            rows,
            columns,
            nodes_mm: bytes[HEAD_BYTES..]
                .chunks_exact(4)
                .map(|c| i32_at(c, 0))
                .collect(),
        })
    }
}

/// EGM96 at a node, millimetres, from degrees north and east.
fn node_mm(latitude_deg: f64, longitude_deg: f64) -> i32 {
    let metres = egm96::egm96_compute_altitude_offset(latitude_deg, longitude_deg);
    #[expect(
        clippy::cast_possible_truncation,
        reason = "an undulation is within 110 m; rounding to the millimetre is the purpose, and hides how libms differ"
    )]
    {
        (metres * 1000.0).round() as i32
    }
}

/// A floor and what is left above it.
fn split(x: f64) -> (i32, f64) {
    let floor = x.floor();
    #[expect(
        clippy::cast_possible_truncation,
        reason = "callers keep x within the nodes of the Earth"
    )]
    {
        (floor as i32, x - floor)
    }
}

/// A count or an offset that is known not to be negative.
fn index(x: i32) -> usize {
    usize::try_from(x).unwrap_or(0)
}

/// A rectangle of nodes, inclusive; columns run on past 180 degrees.
struct NodeRect {
    south: i32,
    west: i32,
    north: i32,
    east: i32,
}

impl NodeRect {
    fn around(grid: Grid, area: &PostRect) -> Self {
        let posts_per_node = grid.posts_per_degree.cast_signed() / NODES_PER_DEGREE;
        let floor = |post: i32| post.div_euclid(posts_per_node);
        let ceil = |post: i32| -((-post).div_euclid(posts_per_node));
        Self {
            south: (floor(area.south) - MARGIN).max(-ROW_MAX),
            west: floor(area.west) - MARGIN,
            north: (ceil(area.north) + MARGIN).min(ROW_MAX),
            east: ceil(area.east) + MARGIN,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: Grid = Grid {
        posts_per_degree: 1200,
    };

    fn cell(latitude: i32, longitude: i32) -> PostRect {
        PostRect {
            south: latitude * 1200,
            west: longitude * 1200,
            north: (latitude + 1) * 1200,
            east: (longitude + 1) * 1200,
        }
    }

    fn at(geoid: &GeoidGrid, latitude: f64, longitude: f64) -> Option<f64> {
        geoid.undulation_m(
            Radians::from_degrees(latitude),
            Radians::from_degrees(longitude),
        )
    }

    #[test]
    fn undulations_agree_with_the_published_check_values() {
        // NGA's 15' grid at these nodes, as distributed by PROJ (egm96_15.gtx), to the centimetre.
        for (latitude, longitude, n) in [
            (50, 14, 45.78),
            (45, 7, 52.96),
            (28, 87, -28.94),
            (0, 0, 17.16),
            (-20, 180, 49.74),
        ] {
            let corner = PostRect {
                south: latitude * 1200,
                west: longitude * 1200,
                north: latitude * 1200,
                east: longitude * 1200,
            };
            let geoid = GeoidGrid::over(GRID, &[corner], 1);
            let got = at(&geoid, f64::from(latitude), f64::from(longitude)).expect("covered");
            assert!((got - n).abs() < 0.02, "{latitude} {longitude}: {got}");
        }
    }

    #[test]
    fn undulations_are_continuous_over_the_date_line() {
        let geoid = GeoidGrid::over(GRID, &[cell(-20, -180)], 1);
        let east = at(&geoid, -19.5, -179.999_999).expect("inside");
        let west = at(&geoid, -19.5, 179.999_999).expect("the margin reaches over the line");
        assert!((east - west).abs() < 1e-4, "{east} {west}");
        assert_eq!(at(&geoid, -19.5, 178.0), None, "beyond the margin");
    }

    #[test]
    fn the_poles_are_inside_and_nothing_beyond_them_is() {
        let geoid = GeoidGrid::over(GRID, &[cell(89, 10)], 1);
        let pole = at(&geoid, 90.0, 10.5).expect("the pole");
        assert!(
            (pole - 13.6).abs() < 0.1,
            "EGM96 gives 13.6 m there: {pole}"
        );
        assert_eq!(at(&geoid, 90.1, 10.5), None, "no such latitude");
        assert_eq!(at(&geoid, f64::NAN, 10.5), None, "not a number");
        assert_eq!(at(&geoid, 89.5, f64::INFINITY), None, "not finite");
    }

    #[test]
    fn far_areas_leave_the_space_between_them_empty() {
        let geoid = GeoidGrid::over(GRID, &[cell(0, 0), cell(0, 10)], 2);
        assert!(at(&geoid, 0.5, 0.5).is_some() && at(&geoid, 0.5, 10.5).is_some());
        assert_eq!(at(&geoid, 0.5, 5.5), None);
    }

    #[test]
    fn the_section_comes_back() {
        let geoid = GeoidGrid::over(GRID, &[cell(50, 14)], 2);
        assert_eq!(
            GeoidGrid::from_bytes(&geoid.to_bytes()),
            Some(geoid.clone())
        );
        let bytes = geoid.to_bytes();
        assert_eq!(GeoidGrid::from_bytes(&bytes[..bytes.len() - 1]), None);
        assert_eq!(GeoidGrid::from_bytes(&[]), None);
    }
}
