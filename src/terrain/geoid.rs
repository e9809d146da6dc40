//! The EGM96 geoid over a pack's area: undulations at 15' nodes, bilinear between them.
//!
//! The undulation N is the height of the geoid above the WGS 84 ellipsoid: ellipsoidal height = orthometric height + N.
//! Node values come from the spherical harmonic model itself (degree and order 360, crate `egm96`), evaluated when a pack
//! is baked. Bilinear interpolation in a 15' grid is how EGM96 is commonly distributed and used (NGA's WW15MGH grid).

use crate::terrain::bake_fill::{Window, fill_holes};
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
/// EGM96 at the poles, metres.
const NORTH_POLE_M: f64 = 13.606;
const SOUTH_POLE_M: f64 = -29.535;
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
    /// Millimetres, southern row first, west first; made up where not `known`.
    nodes_mm: Vec<i32>,
    /// Whether a node is the model's.
    known: Vec<bool>,
}

impl GeoidGrid {
    /// A grid whose nodes cover `areas` and a degree around each; elsewhere in their common frame nodes stay absent. In
    /// `jobs` threads; a value of the model takes about half a millisecond, a row around the Earth needs 81 to 721.
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
            known: Vec::new(),
        };
        let mut nodes_mm = vec![ABSENT; index(geoid.rows) * index(columns)];
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
            nodes_mm[place] = value;
        }
        geoid.take(nodes_mm);
        geoid
    }

    /// Takes its nodes. Absent ones get a smooth continuation of the others, so that nothing drawn has a step there.
    fn take(&mut self, nodes_mm: Vec<i32>) {
        self.nodes_mm = nodes_mm;
        self.known = self.nodes_mm.iter().map(|mm| *mm != ABSENT).collect();
        let absent: Vec<bool> = self.known.iter().map(|known| !known).collect();
        let window = Window {
            columns: index(self.columns),
            rows: index(self.rows),
        };
        #[expect(
            clippy::cast_precision_loss,
            clippy::cast_possible_truncation,
            reason = "within 110 m, and what is made up needs no millimetres"
        )]
        if absent.contains(&true) {
            let of_node = |(mm, known): (&i32, &bool)| if *known { *mm as f32 } else { f32::NAN };
            let nodes = self.nodes_mm.iter().zip(&self.known);
            let mut full: Vec<f32> = nodes.map(of_node).collect();
            fill_holes(&window, &mut full, &absent, 0.0);
            for (mm, (full, _)) in self
                .nodes_mm
                .iter_mut()
                .zip(full.iter().zip(&absent))
                .filter(|(_, (_, absent))| **absent)
            {
                *mm = full.round() as i32;
            }
        }
    }

    /// The model at some of the nodes, in their order, millimetres.
    fn evaluate(&self, places: &[usize], jobs: usize) -> Vec<i32> {
        let columns = index(self.columns).max(1);
        let mut values = vec![ABSENT; places.len()];
        let mut rows = Vec::new();
        let mut rest = values.as_mut_slice();
        for places in places.chunk_by(|a, b| a / columns == b / columns) {
            let (values, others) = rest.split_at_mut(places.len());
            rows.push((places, values));
            rest = others;
        }
        let fill = |rows: &mut [(&[usize], &mut [i32])]| {
            for (places, values) in rows {
                self.evaluate_row(places, values);
            }
        };
        let share = rows.len().div_ceil(jobs.max(1)).max(1);
        std::thread::scope(|scope| {
            for rows in rows.chunks_mut(share) {
                let builder = std::thread::Builder::new().name("geoid".into());
                // A thread that cannot start leaves its nodes absent; they are filled below.
                let _ = builder.spawn_scoped(scope, || fill(rows));
            }
        });
        let missed = |(_, values): &(&[usize], &mut [i32])| values.contains(&ABSENT);
        for row in rows.iter_mut().filter(|row| missed(row)) {
            fill(std::slice::from_mut(row));
        }
        values
    }

    /// The model at nodes of one row. Along a row it is a trigonometric polynomial, so that a long row follows exactly from
    /// as many equally spaced values as the polynomial has coefficients (an odd number; barycentric form of the
    /// trigonometric interpolation, Henrici 1979).
    fn evaluate_row(&self, places: &[usize], values: &mut [i32]) {
        let columns = index(self.columns).max(1);
        let degrees = |node: i32| f64::from(node) / f64::from(NODES_PER_DEGREE);
        let row = |place: &usize| i32::try_from(place / columns).unwrap_or(0);
        let column = |place: &usize| i32::try_from(place % columns).unwrap_or(0);
        let Some(latitude) = places.first().map(|p| degrees(self.south + row(p))) else {
            return;
        };
        let longitude = |place: &usize| degrees(self.west + column(place));
        let count = 2 * orders(latitude) + 1;
        if places.len() <= index(count) {
            for (value, place) in values.iter_mut().zip(places) {
                *value = millimetres(model_m(latitude, longitude(place)));
            }
            return;
        }
        let step = 360.0 / f64::from(count);
        let samples: Vec<(f64, f64)> = (0..count)
            .map(|k| f64::from(k) * step)
            .map(|longitude| (longitude, model_m(latitude, longitude)))
            .collect();
        for (value, place) in values.iter_mut().zip(places) {
            let longitude = longitude(place);
            let (mut sum, mut weights, mut sign) = (0.0, 0.0, 1.0);
            for (at, metres) in &samples {
                // A node on a sample has all the weight there is.
                let sin = (0.5 * (longitude - at)).to_radians().sin();
                let weight = sign / if sin.abs() < 1e-13 { 1e-13 } else { sin };
                sum += weight * metres;
                weights += weight;
                sign = -sign;
            }
            *value = millimetres(sum / weights);
        }
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

    /// The undulation at a point, metres; where [`Self::undulation_m`] has none, a continuation without a step: for
    /// drawing what no source covers. Absent nodes are filled smoothly; from its northern and southern edge on it goes
    /// linearly to the pole's, and from its eastern edge around the Earth to its western one. 0 for what is no place.
    #[must_use]
    pub fn undulation_anywhere_m(&self, latitude: Radians, longitude: Radians) -> f64 {
        let rows = latitude.to_degrees() * f64::from(NODES_PER_DEGREE);
        let columns = longitude.to_degrees() * f64::from(NODES_PER_DEGREE);
        if self.nodes_mm.is_empty() || !rows.is_finite() || !columns.is_finite() {
            return 0.0;
        }
        let (south, north) = (f64::from(self.south), f64::from(self.south + self.rows - 1));
        let inside = rows.clamp(south, north);
        let (row, up) = split(inside - south);
        let a = self.along_row(row, columns);
        let edge = if up > 0.0 {
            a + (self.along_row(row + 1, columns) - a) * up
        } else {
            a
        };
        let (pole_m, limit) = if rows > inside {
            (NORTH_POLE_M, f64::from(ROW_MAX) - inside)
        } else {
            (SOUTH_POLE_M, f64::from(ROW_MAX) + inside)
        };
        let beyond = (rows - inside).abs();
        if beyond <= 0.0 {
            return edge;
        }
        edge + (pole_m - edge) * (beyond / limit).min(1.0)
    }

    /// Between the nodes of one of its rows, all around the Earth.
    fn along_row(&self, row: i32, column: f64) -> f64 {
        let right = (column - f64::from(self.west)).rem_euclid(f64::from(NODES_AROUND));
        let last = self.columns - 1;
        let (west, east, weight) = if right < f64::from(last) {
            let (west, weight) = split(right);
            (west, west + 1, weight)
        } else {
            let gap = f64::from(NODES_AROUND - last);
            (last, 0, (right - f64::from(last)) / gap)
        };
        let node = |column: i32| {
            let at = index(row) * index(self.columns) + index(column);
            f64::from(self.nodes_mm[at]) / 1000.0
        };
        node(west) + (node(east) - node(west)) * weight
    }

    fn node_m(&self, row: i32, column: i32) -> Option<f64> {
        let at = self.place(row, column)?;
        self.known[at].then(|| f64::from(self.nodes_mm[at]) / 1000.0)
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
        for (node, known) in self.nodes_mm.iter().zip(&self.known) {
            let stored = if *known { *node } else { ABSENT };
            bytes.extend(stored.to_le_bytes());
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
            && rows <= ROW_MAX - south + 1
            && columns <= NODES_AROUND;
        if !(right_size && placed) {
            return None;
        }
        let mut geoid = Self {
            south,
            west,
            rows,
            columns,
            nodes_mm: Vec::new(),
            known: Vec::new(),
        };
        let nodes = bytes[HEAD_BYTES..].chunks_exact(4);
        geoid.take(nodes.map(|c| i32_at(c, 0)).collect());
        Some(geoid)
    }
}

/// EGM96 at a point in degrees north and east, metres.
fn model_m(latitude_deg: f64, longitude_deg: f64) -> f64 {
    egm96::egm96_compute_altitude_offset(latitude_deg, longitude_deg)
}

/// Orders of the model that a row of nodes shows: of 360, those that the associated Legendre functions let through.
/// Functions of order m and degree 360 at most decay faster than exponentially once m is past 360 cos B; 40 orders on, they
/// are far below a millimetre.
fn orders(latitude_deg: f64) -> i32 {
    const DEGREE: f64 = 360.0;
    #[expect(clippy::cast_possible_truncation, reason = "at most 360")]
    {
        (DEGREE * latitude_deg.to_radians().cos() + 40.0).min(DEGREE) as i32
    }
}

fn millimetres(metres: f64) -> i32 {
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
    fn beyond_its_nodes_the_drawn_undulation_has_no_step() {
        let geoid = GeoidGrid::over(GRID, &[cell(50, 14), cell(52, 20), cell(40, 17)], 2);
        let drawn = |latitude: f64, longitude: f64| {
            geoid.undulation_anywhere_m(
                Radians::from_degrees(latitude),
                Radians::from_degrees(longitude),
            )
        };
        for (latitude, longitude) in [(50.3, 14.9), (52.0, 20.6), (40.1, 17.2)] {
            let exact = at(&geoid, latitude, longitude).expect("covered");
            assert!((drawn(latitude, longitude) - exact).abs() < 1e-9);
        }
        // Around the Earth and from pole to pole, over covered and uncovered places. The geoid itself rises by at most
        // 0.1 m a kilometre or so, what is filled between areas by less than 0.3; a thousandth of a degree is 111 m.
        let along = |from: (f64, f64), to: (f64, f64)| {
            let steps = 90_000;
            let mut before = drawn(from.0, from.1);
            let mut worst = 0.0_f64;
            for step in 1..=steps {
                let t = f64::from(step) / f64::from(steps);
                let here = drawn(from.0 + t * (to.0 - from.0), from.1 + t * (to.1 - from.1));
                worst = worst.max((here - before).abs());
                before = here;
            }
            worst
        };
        for latitude in [-89.9, 0.0, 45.1, 51.0, 60.0, 89.0] {
            let worst = along((latitude, -180.0), (latitude, 180.0));
            assert!(worst < 0.15, "along {latitude}: {worst} m");
        }
        for longitude in [-170.0, 14.5, 17.5, 19.0, 180.0] {
            let worst = along((-90.0, longitude), (90.0, longitude));
            assert!(worst < 0.15, "along {longitude}: {worst} m");
        }
        assert!((drawn(20.0, 180.0) - drawn(20.0, -180.0)).abs() < 1e-9);
        assert!((drawn(90.0, 14.0) - drawn(90.0, -100.0)).abs() < 1e-9);
    }

    #[test]
    fn rows_around_the_earth_are_those_of_the_model() {
        for row in [0, 240, -280, 320, -340, 352, 359] {
            let geoid = GeoidGrid {
                south: row,
                west: -720,
                rows: 1,
                columns: NODES_AROUND,
                nodes_mm: Vec::new(),
                known: Vec::new(),
            };
            let places: Vec<usize> = (0..1440).collect();
            let values = geoid.evaluate(&places, 2);
            for column in [0, 467, 720, 760, 1214, 1439] {
                let (latitude, longitude) = (f64::from(row) / 4.0, f64::from(column) / 4.0 - 180.0);
                let want = millimetres(model_m(latitude, longitude));
                let got = values[index(column)];
                assert!(
                    (got - want).abs() <= 1,
                    "{latitude} {longitude}: {got} for {want}"
                );
            }
        }
    }

    #[test]
    fn the_poles_are_those_of_the_model() {
        for (latitude, metres) in [(90.0, NORTH_POLE_M), (-90.0, SOUTH_POLE_M)] {
            assert!((model_m(latitude, 0.0) - metres).abs() < 0.01);
        }
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
