//! What `glasswing measure accuracy` measures, in small: positions read back from the vertex shader, views without holes,
//! a surface that does not pop, and what a camera that is none does to a picture.
#![expect(clippy::expect_used, reason = "a test: what fails must say so")]

mod support;

use glasswing::app::measure::bench::{Bench, QUOTA, camera};
use glasswing::app::measure::flight::{self, Flight, Path};
use glasswing::app::measure::poses::Search;
use glasswing::app::measure::{Progress, accuracy, position, speed, watertight};
use glasswing::geo::{Camera, Geodetic};
use glasswing::gl::Gpu;
use glasswing::screen::Screen;
use glasswing::terrain::clipmap::Shape;
use glasswing::terrain::pack::Pack;
use glasswing::terrain::partition::Partition;
use glasswing::terrain::planet::{Kind, Planet};
use glasswing::terrain::surface::TileSource;
use glasswing::terrain::truth::Field;
use glasswing::units::Radians;
use serde_json::Value;
use std::rc::Rc;
use std::sync::Arc;

fn gpu() -> (Rc<Gpu>, Box<dyn Screen>) {
    let screen = support::headless_screen(16, 16);
    let gpu = Gpu::new(&|name| screen.gl_proc(name)).expect("a GL context");
    (gpu, screen)
}

fn shape(vertices: u32) -> Shape {
    Shape::new(vertices).expect("a legal shape")
}

#[test]
fn the_vertex_shader_is_exact_to_a_thousandth_of_a_pixel_at_every_hard_case() {
    let (gpu, _screen) = gpu();
    let planet = Arc::new(Planet::new(Kind::Earth, 1200));
    let mut bench = Bench::new(&gpu, &planet, shape(63)).expect("a renderer");
    let (cases, levels) = position::all_cases(&mut bench, &mut |_, _| ()).expect("measures");
    for (name, e) in &cases {
        assert!(e.vertices > 0, "{name}: nothing was drawn");
        assert!(e.px <= 0.001, "{name}: {e:?}");
        assert!(e.projected_px <= 0.02, "{name}: {e:?}");
    }
    let measured = levels.iter().filter(|e| e.vertices > 0).count();
    assert!(measured >= 8, "{measured} levels were drawn");
}

#[test]
fn no_random_view_shows_the_sky_through_the_ground() {
    let (gpu, _screen) = gpu();
    let poses = if support::is_emulated() { 16 } else { 320 };
    let search = Search {
        gpu: &gpu,
        settings: shape(127).into(),
        numbers: 0..poses,
    };
    let none: Option<&Arc<Pack>> = None;
    let found = search.run(none, &mut |_| ()).expect("measures");
    assert_eq!(found.poses, poses, "{found:?}");
    assert_eq!(found.holes, 0, "{:#?}", found.where_);
}

#[test]
fn a_hole_would_be_found() {
    // Terrain whose picture has one pixel taken away is what the detector has to notice, settled or not.
    let view = camera((46.0, 8.0, 3000.0), (30.0, -10.0, 20.0), 60.0, (40, 30));
    let mut covered: Vec<bool> = (0..1200).map(|at| at >= 600).collect();
    let open = watertight::holes_of(&view, &covered, None);
    covered[900] = false;
    assert_eq!(watertight::holes_of(&view, &covered, None), open + 1);
    let limb = watertight::holes_of(&view, &[false; 1200], Some(0.0));
    assert!(limb > 300, "most of a picture that looks down: {limb}");
}

#[test]
fn the_ground_does_not_pop_where_a_parallel_or_the_seam_is_crossed() {
    let (gpu, _screen) = gpu();
    let planet = Planet::new(Kind::Earth, 1200);
    let planet = Arc::new(planet);
    let mut bench = Bench::new(&gpu, &planet, shape(127)).expect("a renderer");
    for (south, seams) in [(44.9993, 0), (70.2493, 1)] {
        // Where there are mountains: the sea pops nowhere.
        let lon = planet.mountains_deg(south);
        let path = Path {
            from_deg: (south, lon),
            heading_deg: 0.0,
            speed_mps: 300.0,
            above_m: 200.0,
            view: ((160, 96), 60.0),
        };
        let near = Geodetic::from_degrees(south, lon, 0.0);
        let field = Field::load(planet.as_ref(), Partition::Geographic, &near, 4000.0);
        let seconds = if support::is_emulated() { 0.5 } else { 1.0 };
        let flight = Flight {
            path,
            field: &field,
            seconds,
            lowest_m: planet.info().height_min_m,
        };
        let flown = flight::fly(&mut bench, &flight, None, &mut |_, _| ()).expect("flies");
        if !support::is_emulated() {
            assert_eq!(flown.seams, seams, "{flown:?}");
        }
        assert!(flown.points > 300, "{south}: {flown:?}");
        assert!(flown.pop_px_max <= 0.5, "{south}: {flown:?}");
        assert!(flown.swim_px_max <= 0.1, "{south}: {flown:?}");
        assert_eq!(flown.holes, 0, "{south}: {flown:?}");
    }
}

/// A corner of the picture that only a neighbour of the blocks in it covers: seen once in 650 random views.
#[test]
fn a_block_that_reaches_over_its_side_is_drawn_there() {
    let (gpu, _screen) = gpu();
    let planet = Arc::new(Planet::new(Kind::Sea, 1200));
    let mut bench = Bench::new(&gpu, &planet, shape(127)).expect("a renderer");
    let mut view = camera((46.0, 8.0, 9006.223), (0.0, 0.0, 0.0), 60.0, (160, 96));
    (view.eye.latitude, view.eye.longitude) = (Radians(0.802_868_074), Radians(0.140_323_27));
    view.attitude.heading_true = Radians(1.747_954_417);
    (view.attitude.pitch, view.attitude.roll) = (Radians(0.063_659_429), Radians(0.787_572_118));
    let figures = bench.settle(&view).expect("settles");
    let holes = watertight::holes(&mut bench, &view, &figures, 0.0).expect("a picture");
    assert_eq!(holes, 0, "{figures:?}");
}

/// The same view with something wrong.
fn wrong(good: Camera, spoil: impl FnOnce(&mut Camera)) -> Camera {
    let mut camera = good;
    spoil(&mut camera);
    camera
}

#[test]
fn a_camera_that_is_none_is_refused_and_the_last_picture_stays() {
    let (gpu, _screen) = gpu();
    let planet = Arc::new(Planet::new(Kind::Earth, 1200));
    let mut bench = Bench::new(&gpu, &planet, shape(63)).expect("a renderer");
    let good = camera((46.5, 8.0, 5000.0), (200.0, -10.0, 5.0), 60.0, (80, 48));
    bench.settle(&good).expect("settles");
    let before = bench.picture(&good).expect("a picture");
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300] {
        for camera in [
            wrong(good, |c| c.eye.latitude = Radians(bad)),
            wrong(good, |c| c.eye.longitude = Radians(bad)),
            wrong(good, |c| c.eye.height_ellipsoid.0 = bad),
            wrong(good, |c| c.attitude.heading_true = Radians(bad)),
            wrong(good, |c| c.attitude.pitch = Radians(bad)),
            wrong(good, |c| c.attitude.roll = Radians(bad)),
            wrong(good, |c| c.hfov = Radians(bad)),
            wrong(good, |c| c.width_px = 0),
            wrong(good, |c| c.height_px = 0),
        ] {
            let refused = bench.step(&camera, QUOTA).is_err();
            // A turn of 1e300 radians is a finite number, and so may be accepted; what is accepted must be drawable.
            assert!(refused || bad.is_finite(), "{camera:?}");
            if refused {
                assert_eq!(
                    bench.picture(&good).expect("a picture"),
                    before,
                    "{camera:?}"
                );
            } else {
                bench.picture(&good).expect("a picture");
                bench.settle(&good).expect("settles again");
            }
        }
    }
    // The smallest numbers there are do no harm either.
    let tiny = f64::MIN_POSITIVE / 4.0;
    for camera in [
        wrong(good, |c| c.eye.latitude = Radians(tiny)),
        wrong(good, |c| c.eye.longitude = Radians(-tiny)),
        wrong(good, |c| c.attitude.pitch = Radians(tiny)),
    ] {
        let figures = bench.settle(&camera).expect("settles");
        let lowest_m = -430.0;
        let holes = watertight::holes(&mut bench, &camera, &figures, lowest_m).expect("a picture");
        assert_eq!(holes, 0, "{camera:?}");
    }
}

fn has_number(value: &Value, path: &str) {
    let found = path
        .split('.')
        .fold(value, |v, key| match key.parse::<usize>() {
            Ok(at) => &v[at],
            Err(_) => &v[key],
        });
    assert!(found.is_number(), "{path} is {found}");
}

#[test]
fn the_documents_have_the_keys_that_stay() {
    if support::is_emulated() {
        support::skip("minutes under emulation; nothing in it depends on the machine");
        return;
    }
    let (gpu, _screen) = gpu();
    let progress = Progress::hidden();
    let none: Option<&Arc<Pack>> = None;
    let effort = accuracy::Effort {
        only: None,
        poses: 5,
        first_pose: 0,
        seconds: 0.1,
        reach_m: 3000.0,
        views: Vec::new(),
        sheets: None,
    };
    let document =
        accuracy::run(&gpu, none, shape(63).into(), &effort, &progress).expect("measures");
    for path in [
        "position.px_max",
        "position.m_max",
        "cases.0.px_max",
        "cases.0.m_max",
        "watertight.poses",
        "watertight.holes",
        "pop_px_max",
        "swim_px_max",
        "pop.paths.0.holes",
    ] {
        has_number(&document, path);
    }
    assert!(
        document["cases"][0]["name"].is_string(),
        "{}",
        document["cases"][0]
    );
    let effort = speed::Effort {
        frames: 2,
        reach_m: 3000.0,
        views: Vec::new(),
    };
    let document = speed::run(&gpu, none, &[shape(63)], 0.2, &effort, &progress).expect("measures");
    for key in [
        "frame_ms.p50",
        "frame_ms.p95",
        "frame_ms.p99",
        "frame_ms.max",
        "cpu_ms.p50",
        "triangles",
        "draw_calls",
        "allocations_per_frame",
        "surf_px.rms",
        "surf_px.p99",
        "surf_px.max",
    ] {
        has_number(&document, &format!("scenes.0.{key}"));
    }
}

#[test]
fn what_cannot_be_measured_is_named_in_one_line() {
    let run = |args: &[&str]| {
        let out = support::glasswing_command()
            .arg("measure")
            .args(args)
            .output()
            .expect("the program starts");
        let text = String::from_utf8_lossy(&out.stderr).into_owned();
        assert!(text.starts_with("glasswing: "), "{text}");
        out.status.code()
    };
    assert_eq!(run(&["accuracy", "--pack", "nowhere.pack"]), Some(3));
    assert_eq!(run(&["speed", "--vertices", "100"]), Some(2));
    assert_eq!(run(&["accuracy", "--reach", "NaN"]), Some(2));
    assert_eq!(
        run(&["accuracy", "--json", "/nowhere/figures.json"]),
        Some(1)
    );
    assert_eq!(run(&["codec", "nowhere.hgt"]), Some(3));
}
