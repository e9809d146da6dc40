//! `measure accuracy`: positions, holes, popping, surfaces and normals, from planets in memory and from a pack.

use crate::app::error::Failure;
use crate::app::measure::bench::{Bench, camera};
use crate::app::measure::pop::{self, Path};
use crate::app::measure::poses::{Found, Search};
use crate::app::measure::surface::{self, Spread, Surface};
use crate::app::measure::{Progress, position};
use crate::geo::Camera;
use crate::gl::Gpu;
use crate::terrain::clipmap::Shape;
use crate::terrain::partition::{Partition, SEAM_HYSTERESIS_DEG, SEAM_LATITUDE_DEG};
use crate::terrain::planet::{Kind, Planet};
use crate::terrain::surface::{Damage, Sampler, TileSource};
use crate::terrain::tables::HeightCode;
use crate::terrain::truth::Field;
use glam::DVec3;
use serde_json::{Value, json};
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
    /// Holes in random views
    Holes,
}

/// How much is measured.
#[derive(Clone, Copy, Debug)]
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

/// The views that a source is measured in: the benchmark view where there is ground for it, and the middle of what the
/// source covers from 100 m, 3 km and 12 km above the ground.
///
/// # Errors
/// When the ground under them does not become resident.
pub fn scenes<S: TileSource>(bench: &mut Bench, source: &S) -> Result<Vec<Scene>, Failure> {
    let b = source.info().bounds;
    let inside = |lat: f64, lon: f64| {
        (b.south_deg..=b.north_deg).contains(&lat) && (b.west_deg..=b.east_deg).contains(&lon)
    };
    let mut scenes = Vec::new();
    if inside(-32.6, -70.3) {
        scenes.push(("benchmark view".to_owned(), benchmark()));
    }
    let whole = b.east_deg - b.west_deg > 350.0;
    let middle = if whole {
        (46.5, 8.0)
    } else {
        (
            f64::midpoint(b.south_deg, b.north_deg),
            f64::midpoint(b.west_deg, b.east_deg),
        )
    };
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
) -> Result<(Surface, Field, usize), Failure> {
    let figures = bench.settle(&scene.camera)?;
    let partition = bench.partition().unwrap_or_default();
    let field = Field::load(source, partition, &scene.camera.eye, reach_m);
    let surface = surface::measure(bench, &field, &scene.camera)?;
    Ok((surface, field, figures.triangles))
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

/// What is measured of one source beside positions and holes.
struct OfSource {
    scenes: Vec<Value>,
    pops: Vec<Value>,
    pop_px_max: f64,
    normal_deg: Spread,
}

fn of_source<S: TileSource>(
    bench: &mut Bench,
    source: &S,
    effort: Effort,
    label: &str,
    progress: &Progress,
) -> Result<OfSource, Failure> {
    let mut out = OfSource {
        scenes: Vec::new(),
        pops: Vec::new(),
        pop_px_max: 0.0,
        normal_deg: Spread::default(),
    };
    let scenes = scenes(bench, source)?;
    for scene in &scenes {
        progress.say(&format!("{label}: {}", scene.name));
        let (surface, field, triangles) = measure_scene(bench, source, scene, effort.reach_m)?;
        let partition = bench.partition().unwrap_or_default();
        let mut row = surface.report();
        row["name"] = json!(format!("{label}: {}", scene.name));
        row["triangles"] = json!(triangles);
        row["draw_calls"] = json!(bench.terrain.draw_calls());
        out.scenes.push(row);
        let normals = normals(source, partition, &field);
        if normals.max > out.normal_deg.max {
            out.normal_deg = normals;
        }
    }
    for (name, path, seconds) in paths(source, &scenes, effort.seconds) {
        let start = path.point(0.0);
        let partition = Partition::at(start.latitude.to_degrees(), None);
        let partition = if source.has(partition) {
            partition
        } else {
            Partition::Geographic
        };
        let field = Field::load(source, partition, &start, effort.reach_m.min(40_000.0));
        let name = format!("{label}: {name}");
        let pops = pop::fly(bench, &field, &path, seconds, &mut |at, of| {
            progress.at(&name, at as usize, of as usize);
        })?;
        out.pop_px_max = out.pop_px_max.max(pops.px_max);
        out.pops.push(pops.report(&name));
    }
    Ok(out)
}

/// The flights over a source: a low one over its middle, and over the seams where it has caps.
fn paths<S: TileSource>(
    source: &S,
    scenes: &[Scene],
    seconds: f64,
) -> Vec<(&'static str, Path, f64)> {
    let view = ((1024, 600), 60.0);
    let middle = scenes.iter().find(|s| s.name.starts_with("100 m"));
    let mut paths = Vec::new();
    if let Some(scene) = middle {
        let eye = scene.camera.eye;
        let from_deg = (eye.latitude.to_degrees(), eye.longitude.to_degrees());
        paths.push((
            "100 m above the ground",
            Path {
                from_deg,
                heading_deg: 215.0,
                speed_mps: 60.0,
                above_m: 100.0,
                view,
            },
            seconds,
        ));
    }
    if source.has(Partition::North) {
        // The parallel is passed in the middle of the flight.
        let half_deg = 100.0 * seconds / 4.0 / 111_320.0;
        let across = |(lat, lon)| Path {
            from_deg: (lat - half_deg, lon),
            heading_deg: 0.0,
            speed_mps: 100.0,
            above_m: 300.0,
            view,
        };
        paths.push(("across 45 N", across((45.0, 7.0)), seconds / 2.0));
        paths.push((
            "across the seam at 70 N",
            across((SEAM_LATITUDE_DEG + SEAM_HYSTERESIS_DEG, 20.0)),
            seconds / 2.0,
        ));
    }
    paths
}

/// The key `watertight`.
fn look_for_holes<S: TileSource>(
    gpu: &Rc<Gpu>,
    pack: Option<&Arc<S>>,
    shape: Shape,
    effort: Effort,
    progress: &Progress,
) -> Result<Value, Failure> {
    let search = Search {
        gpu,
        shape,
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
    shape: Shape,
    effort: Effort,
    progress: &Progress,
) -> Result<Value, Failure> {
    let planet = Arc::new(Planet::new(Kind::Earth, 1200));
    let mut document = json!({});
    let mut sources = Vec::new();
    if effort.does(Part::Positions) || effort.does(Part::Scenes) {
        let mut bench = Bench::new(gpu, &planet, shape)?;
        if effort.does(Part::Positions) {
            let (cases, levels) =
                position::all_cases(&mut bench, &mut |at, of| progress.at("positions", at, of))?;
            let (position, cases) = position::report(&cases, &levels);
            document["position"] = position;
            document["cases"] = cases;
        }
        sources.push(of_source(
            &mut bench,
            planet.as_ref(),
            effort,
            "planet",
            progress,
        )?);
    }
    if let Some(pack) = pack.filter(|_| effort.does(Part::Scenes)) {
        let mut bench = Bench::new(gpu, pack, shape)?;
        sources.push(of_source(
            &mut bench,
            pack.as_ref(),
            effort,
            "pack",
            progress,
        )?);
    }
    if effort.does(Part::Holes) {
        document["watertight"] = look_for_holes(gpu, pack, shape, effort, progress)?;
    }
    let all = |of: fn(&OfSource) -> &Vec<Value>| {
        sources
            .iter()
            .flat_map(|s| of(s).clone())
            .collect::<Vec<_>>()
    };
    let worst = worst(sources.iter().map(|s| s.normal_deg));
    let rest = json!({
        "pop_px_max": sources.iter().map(|s| s.pop_px_max).fold(0.0, f64::max),
        "pop": {
            "paths": all(|s| &s.pops),
            "how": "change of the drawn surface's height from one frame to the next (1/60 s) at fixed points of the ground, \
                    300 m apart within 25 km, times focal length over distance; points in the picture, hidden ones too",
        },
        "scenes": all(|s| &s.scenes),
        "scenes_how": "surf_px: height of the point drawn at each pixel less that of the bilinear surface of the finest \
                       posts at its place, times focal length over distance; nearer than three posts apart (surf_near_px); \
                       range, skyline and summits against rays cast in f64 through the same surface",
        "normal_deg": {
            "rms": worst.rms,
            "p99": worst.p99,
            "max": worst.max,
            "posts": worst.count,
            "how": "normals of the finest level as shading reads them, against the cross product of the chords between the \
                    post's neighbours in space",
        },
        "vertices": shape.vertices(),
        "gpu": gpu.caps().renderer,
    });
    for (key, value) in rest.as_object().into_iter().flatten() {
        document[key] = value.clone();
    }
    Ok(document)
}
