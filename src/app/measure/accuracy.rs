//! `measure accuracy`: positions, holes, popping, surfaces and normals, from planets in memory and from a pack.

use crate::app::error::Failure;
use crate::app::measure::bench::{Bench, camera};
use crate::app::measure::flights;
use crate::app::measure::poses::{Found, Search};
use crate::app::measure::surface::{self, Spread, Surface, Truth};
use crate::app::measure::{Progress, position};
use crate::geo::Camera;
use crate::gl::Gpu;
use crate::terrain::pack::PackInfo;
use crate::terrain::partition::Partition;
use crate::terrain::planet::{Kind, Planet};
use crate::terrain::scene::Settings;
use crate::terrain::surface::{Damage, Sampler, TileSource};
use crate::terrain::tables::HeightCode;
use crate::terrain::truth::Field;
use glam::DVec3;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::rc::Rc;
use std::sync::Arc;

/// The benchmark view: S33W071 towards the Aconcagua, the view of the published comparison; degrees, metres, pixels.
#[must_use]
pub fn benchmark() -> Camera {
    camera(
        (-32.6, -70.3, 4200.0),
        (215.0, -4.0, 0.0),
        60.0,
        (1024, 600),
    )
}

/// A part of the measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Part {
    /// Where the vertex shader puts vertices, at every hard case
    Positions,
    /// Surface, skyline, summits and normals of views
    Scenes,
    /// Holes, popping and swimming along flights
    Flights,
    /// Holes in random views
    Holes,
}

/// How much is measured.
#[derive(Clone, Debug)]
pub struct Effort {
    /// What is measured; everything if `None`.
    pub only: Option<Part>,
    /// Random views that are looked at for holes.
    pub poses: usize,
    /// Number of the first of them.
    pub first_pose: usize,
    /// Seconds of each flight.
    pub seconds: f64,
    /// How far from the eye rays are cast, metres.
    pub reach_m: f64,
    /// Views that are measured besides.
    pub views: Vec<Camera>,
    /// Folder for contact sheets of the flights.
    pub sheets: Option<PathBuf>,
}

impl Effort {
    fn does(&self, part: Part) -> bool {
        self.only.is_none_or(|only| only == part)
    }
}

/// A view of a source with a name.
#[derive(Clone, Debug)]
pub struct Scene {
    /// What is seen.
    pub name: String,
    /// The view.
    pub camera: Camera,
}

/// The views that a source is measured in: the benchmark view where there is ground for it, and a place, degrees
/// north and east, from 100 m, 3 km and 12 km above the ground; and `views`.
///
/// # Errors
/// When the ground under them does not become resident.
pub fn scenes<S: TileSource>(
    bench: &mut Bench,
    source: &S,
    middle: (f64, f64),
    views: &[Camera],
) -> Result<Vec<Scene>, Failure> {
    let b = source.info().bounds;
    let inside = |lat: f64, lon: f64| {
        (b.south_deg..=b.north_deg).contains(&lat) && (b.west_deg..=b.east_deg).contains(&lon)
    };
    let mut scenes = Vec::new();
    let whole = b.east_deg - b.west_deg > 350.0;
    if inside(-32.6, -70.3) && !whole {
        scenes.push(("benchmark view".to_owned(), benchmark()));
    }
    let mut over =
        |name: &str, (lat, lon): (f64, f64), above_m: f64, pitch: f64| -> Result<(), Failure> {
            let view = camera((lat, lon, above_m), (215.0, pitch, 0.0), 60.0, (1024, 600));
            scenes.push((name.to_owned(), position::above_ground(bench, &view)?));
            Ok(())
        };
    over("100 m above the ground", middle, 100.0, -3.0)?;
    over("3 km above the ground", middle, 3000.0, -6.0)?;
    over("12 km above the ground", middle, 12_000.0, -12.0)?;
    if whole {
        over("300 m above the north pole", (90.0, 0.0), 300.0, -4.0)?;
    }
    for view in views {
        let eye = view.eye;
        let (lat, lon) = (eye.latitude.to_degrees(), eye.longitude.to_degrees());
        let heading = view.attitude.heading_true.to_degrees();
        let name = format!(
            "{lat:.4}, {lon:.4}, {:.0} m, heading {heading:.0}",
            eye.height_ellipsoid.0
        );
        scenes.push((name, *view));
    }
    Ok(scenes
        .into_iter()
        .map(|(name, camera)| Scene { name, camera })
        .collect())
}

/// Measures one scene, settled.
///
/// # Errors
/// When the GPU refuses, or the view does not settle.
pub fn measure_scene<S: TileSource>(
    bench: &mut Bench,
    source: &S,
    scene: &Scene,
    reach_m: f64,
) -> Result<(Surface, Truth, usize), Failure> {
    let figures = bench.settle(&scene.camera)?;
    let partition = bench.partition().unwrap_or_default();
    let truth = Truth::of(source, partition, &scene.camera, reach_m);
    let surface = surface::measure(bench, &truth, &scene.camera)?;
    Ok((surface, truth, figures.triangles))
}

/// Angles between the normals that shading uses and those of the surface through the same posts, degrees.
#[must_use]
pub fn normals<S: TileSource>(source: &S, partition: Partition, field: &Field) -> Spread {
    let info = source.info();
    let heights = HeightCode::covering(info.height_min_m, info.height_max_m);
    let damage = Damage::default();
    let mut sampler = Sampler::new(source, partition, heights, &damage);
    let (mut codes, mut texels) = ([[0; 2]; 64 * 64], [[0; 4]; 64 * 64]);
    let (west, south) = field.origin();
    let side = i32::try_from(field.side()).unwrap_or(i32::MAX);
    let mut angles = Vec::new();
    // A dozen patches a side; nothing else has to be sampled to know the error.
    for j in (1..side - 65).step_by((side / 12).max(64).unsigned_abs() as usize) {
        for i in (1..side - 65).step_by((side / 12).max(64).unsigned_abs() as usize) {
            sampler.fill(0, (west + i, south + j), (64, 64), &mut codes, &mut texels);
            for (at, texel) in texels.iter().enumerate() {
                // As shaders/include/relief.glsl reads it.
                let component = |byte: u8| {
                    let c = (f64::from(byte) - 128.0) / 127.0;
                    c * (0.5 + 0.5 * c.abs())
                };
                let (east, north) = (component(texel[0]), component(texel[1]));
                let up = (1.0 - east * east - north * north).max(0.0).sqrt();
                let (x, y) = (
                    i32::try_from(at % 64).unwrap_or(0),
                    i32::try_from(at / 64).unwrap_or(0),
                );
                let post = (west + i + x, south + j + y);
                angles.extend(field.normal_error_deg(post, DVec3::new(east, north, up)));
            }
        }
    }
    Spread::of(angles)
}

/// The middle of what a source covers, degrees north and east; of a whole Earth, the Alps.
#[must_use]
pub fn middle(info: &PackInfo) -> (f64, f64) {
    let b = info.bounds;
    if b.east_deg - b.west_deg > 350.0 {
        return (46.5, 8.0);
    }
    (
        f64::midpoint(b.south_deg, b.north_deg),
        f64::midpoint(b.west_deg, b.east_deg),
    )
}

/// The mountains of the planet in memory, degrees north and east.
#[must_use]
pub fn mountains(planet: &Planet) -> (f64, f64) {
    (46.5, planet.mountains_deg(46.5))
}

/// What is measured of one source beside positions and holes.
struct OfSource {
    scenes: Vec<Value>,
    normal_deg: Spread,
}

fn of_source<S: TileSource>(
    bench: &mut Bench,
    source: &S,
    middle: (f64, f64),
    effort: &Effort,
    label: &str,
    progress: &Progress,
) -> Result<OfSource, Failure> {
    let mut out = OfSource {
        scenes: Vec::new(),
        normal_deg: Spread::default(),
    };
    let scenes = scenes(bench, source, middle, &effort.views)?;
    for scene in &scenes {
        progress.say(&format!("{label}: {}", scene.name));
        let (surface, truth, triangles) = measure_scene(bench, source, scene, effort.reach_m)?;
        let partition = bench.partition().unwrap_or_default();
        let mut row = surface.report();
        row["name"] = json!(format!("{label}: {}", scene.name));
        row["triangles"] = json!(triangles);
        row["draw_calls"] = json!(bench.terrain.draw_calls());
        out.scenes.push(row);
        let normals = normals(source, partition, &truth.field);
        if normals.max > out.normal_deg.max {
            out.normal_deg = normals;
        }
    }
    Ok(out)
}

/// The key `watertight`.
fn look_for_holes<S: TileSource>(
    gpu: &Rc<Gpu>,
    pack: Option<&Arc<S>>,
    settings: Settings,
    effort: &Effort,
    progress: &Progress,
) -> Result<Value, Failure> {
    let search = Search {
        gpu,
        settings,
        numbers: effort.first_pose..effort.first_pose.saturating_add(effort.poses),
    };
    let mut holes = 0;
    let found = search.run(pack, &mut |found: &Found| {
        if found.holes > holes {
            holes = found.holes;
            progress.note(found.where_.last().map_or("", String::as_str));
        }
        progress.at("views looked at for holes", found.poses, effort.poses);
    })?;
    Ok(found.report(effort.first_pose))
}

/// The one with the largest maximum.
fn worst(spreads: impl Iterator<Item = Spread>) -> Spread {
    spreads.fold(Spread::default(), |a, b| if b.max > a.max { b } else { a })
}

/// Everything: the document of `measure accuracy`.
///
/// # Errors
/// When the GPU refuses, or a view does not settle.
pub fn run<S: TileSource>(
    gpu: &Rc<Gpu>,
    pack: Option<&Arc<S>>,
    settings: Settings,
    effort: &Effort,
    progress: &Progress,
) -> Result<Value, Failure> {
    let planet = Arc::new(Planet::new(Kind::Earth, 1200));
    let mut document = json!({
        "vertices": settings.shape.vertices(),
        "target_px": settings.target_px,
        "gpu": gpu.caps().renderer,
    });
    let mut bench = Bench::new(gpu, &planet, settings)?;
    if effort.does(Part::Positions) {
        let (cases, levels) =
            position::all_cases(&mut bench, &mut |at, of| progress.at("positions", at, of))?;
        (document["position"], document["cases"]) = position::report(&cases, &levels);
    }
    let mut flown = Vec::new();
    if effort.does(Part::Flights) {
        let over = pack.map(|pack| pack.info());
        let paths = flights::over_planet(&planet, over, effort.seconds);
        flown = flights::fly(
            &mut bench,
            planet.as_ref(),
            paths,
            effort,
            "planet",
            progress,
        )?;
    }
    let mut sources = Vec::new();
    if let Some(pack) = pack {
        drop(bench);
        let mut bench = Bench::new(gpu, pack, settings)?;
        if effort.does(Part::Scenes) {
            let (pack, at) = (pack.as_ref(), middle(pack.info()));
            sources.push(of_source(&mut bench, pack, at, effort, "pack", progress)?);
        }
        if effort.does(Part::Flights) {
            let paths = flights::over_pack(pack.info(), effort.seconds);
            flown.extend(flights::fly(
                &mut bench,
                pack.as_ref(),
                paths,
                effort,
                "pack",
                progress,
            )?);
        }
    } else if effort.does(Part::Scenes) {
        let (planet, at) = (planet.as_ref(), mountains(&planet));
        sources.push(of_source(
            &mut bench, planet, at, effort, "planet", progress,
        )?);
    }
    if effort.does(Part::Flights) {
        flights::report(&mut document, &flown);
    }
    if effort.does(Part::Scenes) {
        scenes_report(&mut document, &sources);
    }
    if effort.does(Part::Holes) {
        document["watertight"] = look_for_holes(gpu, pack, settings, effort, progress)?;
    }
    Ok(document)
}

/// The keys of what was measured of views.
fn scenes_report(document: &mut Value, sources: &[OfSource]) {
    let worst = worst(sources.iter().map(|s| s.normal_deg));
    document["scenes"] = sources.iter().flat_map(|s| s.scenes.clone()).collect();
    document["scenes_how"] = json!(
        "surf_px: height of the point drawn at each pixel less that of the bilinear surface of the finest \
         posts at its place, times focal length over distance; ground nearer than eight posts apart: near_px the same there, \
         near_finest_px there against the triangles of the finest posts, surf_finest_px so for all pixels; \
         range, skyline and summits against rays cast in f64 through the same surface"
    );
    document["normal_deg"] = json!({
        "rms": worst.rms,
        "p99": worst.p99,
        "max": worst.max,
        "posts": worst.count,
        "how": "normals of the finest level as shading reads them, against the cross product of the chords between the \
                post's neighbours in space",
    });
}
