//! How exactly the vertex shader places a vertex: its outputs read back, against geodesy in f64.
//!
//! The truth is the position of the same post at the height that the shader worked with, from the closed formula on the
//! ellipsoid; 935 px are one radian at 1920 x 1080 pixels and a vertical field of view of 60 degrees. The whole error over
//! the distance counts, along the line of sight too, which is stricter than what shows.

use crate::app::error::Failure;
use crate::app::measure::bench::{Bench, camera, refused};
use crate::geo::{Camera, WGS84_E2, prime_vertical_radius_m};
use crate::gl::terrain::record::Vertex;
use crate::limits::LEVELS_MAX;
use crate::terrain::partition::Partition;
use crate::terrain::planet::{BASIN_DEG, Kind, Planet, SUMMIT_DEG};
use glam::DVec3;
use serde_json::{Value, json};

/// Focal length in pixels of 1920 x 1080 pixels at a vertical field of view of 60 degrees.
pub const PIXELS_PER_RADIAN: f64 = 935.0;
/// The size they are measured at.
const SIZE: (u32, u32) = (1920, 1080);
/// Its horizontal field of view, degrees: 60 vertically.
const HFOV_DEG: f64 = 91.492;

/// A hard case: an eye, and how it looks.
#[derive(Clone, Debug)]
pub struct Case {
    /// What is hard about it.
    pub name: String,
    /// The eye and the view; the height is above the ground.
    pub camera: Camera,
}

/// An eye in degrees and metres above the ground, heading, pitch and roll in degrees, field of view in degrees, and size.
type View = (
    &'static str,
    (f64, f64, f64),
    (f64, f64, f64),
    f64,
    (u32, u32),
);

/// Heading, pitch and roll of a view ahead, degrees.
const AHEAD_DEG: (f64, f64, f64) = (30.0, -10.0, 0.0);

/// What is hard about the view rather than about the place.
const VIEWS: [View; 12] = {
    let (low, high) = ((46.5, 8.0, 300.0), (46.5, 8.0, 18_000.0));
    let ahead = (200.0, -5.0, 0.0);
    [
        ("18 000 m level", high, (200.0, 0.0, 0.0), HFOV_DEG, SIZE),
        (
            "18 000 m straight down",
            high,
            (0.0, -90.0, 0.0),
            HFOV_DEG,
            SIZE,
        ),
        (
            "18 000 m over the pole",
            (90.0, 0.0, 18_000.0),
            (0.0, -30.0, 0.0),
            HFOV_DEG,
            SIZE,
        ),
        ("roll 90", low, (200.0, -5.0, 90.0), HFOV_DEG, SIZE),
        ("field of view 2", low, (200.0, -2.0, 0.0), 2.0, SIZE),
        ("field of view 120", low, (200.0, -20.0, 0.0), 120.0, SIZE),
        ("aspect 32:9", low, ahead, 100.0, (2560, 720)),
        ("aspect 1:4", low, ahead, 20.0, (270, 1080)),
        ("1 x 1 pixel", low, ahead, 60.0, (1, 1)),
        ("odd size 641 x 479", low, ahead, 60.0, (641, 479)),
        (
            "straight up",
            (46.5, 8.0, 1.0),
            (0.0, 90.0, 0.0),
            HFOV_DEG,
            SIZE,
        ),
        ("upside down", low, (200.0, -5.0, 180.0), HFOV_DEG, SIZE),
    ]
};

/// The hard cases on the planet of [`crate::terrain::planet`]. Heights are still above ground.
#[must_use]
pub fn hard_cases() -> Vec<Case> {
    let mut cases = Vec::new();
    let mut add = |name: &str, at: (f64, f64, f64), attitude, hfov_deg, size| {
        cases.push(Case {
            name: name.to_owned(),
            camera: camera(at, attitude, hfov_deg, size),
        });
    };
    for lat in [
        0.0, 44.999, 45.0, 45.001, 69.9, 70.0, 70.1, 89.999, 90.0, -44.999, -45.0, -45.001, -69.9,
        -70.0, -70.1, -89.999, -90.0,
    ] {
        let name = format!("latitude {lat}");
        add(&name, (lat, 9.0003, 1.0), AHEAD_DEG, HFOV_DEG, SIZE);
    }
    for (lon, heading) in [
        (179.999_99, 90.0),
        (180.0, 90.0),
        (180.0, 270.0),
        (-180.0, 270.0),
        (-179.999_99, 270.0),
    ] {
        let name = format!("longitude {lon} heading {heading}");
        let attitude = (heading, -10.0, 0.0);
        add(&name, (-19.5, lon, 1.0), attitude, HFOV_DEG, SIZE);
    }
    for (name, (lat, lon)) in [
        ("0.3 m over the lowest land, -430 m", BASIN_DEG),
        ("0.3 m over 4000 m", flank_deg(4000.0)),
        ("0.3 m over the highest land, 8848 m", SUMMIT_DEG),
    ] {
        add(name, (lat, lon, 0.3), AHEAD_DEG, HFOV_DEG, SIZE);
    }
    for (name, at, attitude, hfov_deg, size) in VIEWS {
        add(name, at, attitude, hfov_deg, size);
    }
    cases
}

/// South of the highest mountain, where its flank has a height.
fn flank_deg(height_m: f64) -> (f64, f64) {
    let planet = Planet::new(Kind::Earth, 1200);
    let mut lat = SUMMIT_DEG.0;
    while lat > SUMMIT_DEG.0 - 0.5 {
        let n = Partition::Geographic.normal(SUMMIT_DEG.1, lat);
        if planet.height(n).0 < height_m {
            break;
        }
        lat -= 0.001;
    }
    (lat, SUMMIT_DEG.1)
}

/// The same view with its height counted from the ground, once its surroundings are resident.
///
/// # Errors
/// When the view does not settle.
pub fn above_ground(bench: &mut Bench, camera: &Camera) -> Result<Camera, Failure> {
    let above = camera.eye.height_ellipsoid;
    let mut from = *camera;
    from.eye.height_ellipsoid.0 = 9500.0;
    bench.settle(&from)?;
    let ground = bench.terrain.ground(&camera.eye).map_or(0.0, |g| g.0);
    from.eye.height_ellipsoid.0 = ground + above.0;
    Ok(from)
}

/// Errors of positions: the largest of each, over however many vertices.
#[derive(Clone, Copy, Debug, Default)]
pub struct Errors {
    /// Of the distance, seen from the eye at 935 px a radian.
    pub px: f64,
    /// In space, metres.
    pub m: f64,
    /// On the picture, in the pixels of the view itself, among vertices in the picture.
    pub projected_px: f64,
    /// Vertices compared.
    pub vertices: usize,
}

impl Errors {
    fn take(&mut self, other: &Self) {
        self.px = self.px.max(other.px);
        self.m = self.m.max(other.m);
        self.projected_px = self.projected_px.max(other.projected_px);
        self.vertices += other.vertices;
    }
}

/// Errors level by level.
pub type ByLevel = [Errors; LEVELS_MAX];

/// Reads back the vertices of a view that has been prepared.
///
/// # Errors
/// With what the GPU refuses.
pub fn measure(
    bench: &mut Bench,
    camera: &Camera,
    by_level: &mut ByLevel,
) -> Result<Errors, Failure> {
    let eye = camera.eye.to_ecef();
    let mut all = Errors::default();
    each_vertex(bench, &mut |level, truth_ecef, vertex| {
        let error = vertex_error(camera, truth_ecef - eye, vertex);
        by_level[usize::from(level)].take(&error);
        all.take(&error);
    })?;
    Ok(all)
}

/// Gives each recorded vertex with its level and where it truly is, Earth-centred, metres.
///
/// # Errors
/// With what the GPU refuses.
pub fn each_vertex(
    bench: &mut Bench,
    each: &mut dyn FnMut(u8, DVec3, &Vertex),
) -> Result<(), Failure> {
    let (terrain, recorder) = bench.recorder()?;
    let Some(scene) = terrain.scene() else {
        return Ok(());
    };
    let (partition, grid) = (scene.partition(), scene.grid());
    let anchor_m =
        scene.heights().base_m + scene.heights().unit_m * f64::from(scene.plan().anchor_code);
    terrain
        .record(recorder, &mut |level, vertices| {
            for vertex in vertices {
                let [x, y] = vertex.cell.map(cells);
                let longitude = grid.longitude_deg(level.level, level.window.i + x);
                let latitude = grid.latitude_deg(level.level, level.window.j + y);
                let height_m = anchor_m + f64::from(vertex.rise_m);
                let n = partition.normal(longitude, latitude);
                each(level.level, on_normal(n, height_m), vertex);
            }
        })
        .map_err(|e| refused(&e))
}

/// A whole number of cells that the shader gives as a float.
#[expect(clippy::cast_possible_truncation, reason = "a few hundred cells")]
pub fn cells(float: f32) -> i32 {
    float as i32
}

/// The point at a height above the ellipsoid where its unit normal is `n`, Earth-centred, metres.
#[must_use]
pub fn on_normal(n: DVec3, height_m: f64) -> DVec3 {
    let radius = prime_vertical_radius_m(n.z);
    DVec3::new(
        (radius + height_m) * n.x,
        (radius + height_m) * n.y,
        (radius * (1.0 - WGS84_E2) + height_m) * n.z,
    )
}

fn vertex_error(camera: &Camera, truth: DVec3, vertex: &Vertex) -> Errors {
    let drawn = DVec3::from_array(vertex.position_m.map(f64::from));
    let m = (drawn - truth).length();
    let in_view = camera.eye_to_ecef().transpose() * truth;
    let (half_w, half_h) = (
        f64::from(camera.width_px) / 2.0,
        f64::from(camera.height_px) / 2.0,
    );
    let mut projected_px = 0.0;
    if in_view.z < -0.2 {
        let f = camera.focal_px();
        let (x, y) = (in_view.x / -in_view.z * f, in_view.y / -in_view.z * f);
        if x.abs() <= half_w && y.abs() <= half_h {
            let [cx, cy, _, cw] = vertex.clip.map(f64::from);
            projected_px = (cx / cw * half_w - x).hypot(cy / cw * half_h - y);
        }
    }
    Errors {
        px: m / truth.length() * PIXELS_PER_RADIAN,
        m,
        projected_px,
        vertices: 1,
    }
}

/// Measures every hard case. `done` is told how many of how many are.
///
/// # Errors
/// With what the GPU refuses.
pub fn all_cases(
    bench: &mut Bench,
    done: &mut dyn FnMut(usize, usize),
) -> Result<(Vec<(String, Errors)>, ByLevel), Failure> {
    let cases = hard_cases();
    let mut by_level = ByLevel::default();
    let mut out = Vec::new();
    for (at, case) in cases.iter().enumerate() {
        let view = above_ground(bench, &case.camera)?;
        bench.settle(&view)?;
        out.push((case.name.clone(), measure(bench, &view, &mut by_level)?));
        done(at + 1, cases.len());
    }
    Ok((out, by_level))
}

/// The keys `position` and `cases` of the report, and how they were obtained.
#[must_use]
pub fn report(cases: &[(String, Errors)], by_level: &ByLevel) -> (Value, Value) {
    let mut all = Errors::default();
    for (_, errors) in cases {
        all.take(errors);
    }
    let rows: Vec<Value> = cases
        .iter()
        .map(|(name, e)| {
            json!({"name": name, "px_max": e.px, "m_max": e.m, "projected_px_max": e.projected_px, "vertices": e.vertices})
        })
        .collect();
    let levels: Vec<Value> = by_level
        .iter()
        .enumerate()
        .filter(|(_, e)| e.vertices > 0)
        .map(|(level, e)| json!({"level": level, "px_max": e.px, "m_max": e.m, "vertices": e.vertices}))
        .collect();
    let position = json!({
        "px_max": all.px,
        "m_max": all.m,
        "vertices": all.vertices,
        "levels": levels,
        "how": "transform feedback of the terrain's vertex shader at every vertex of every visible block, against the \
                closed geodetic formula in f64; px: whole error over distance times 935 px a radian (1920x1080, 60 deg \
                vertical); projected_px: on the case's own picture, projection included",
    });
    (position, Value::Array(rows))
}
