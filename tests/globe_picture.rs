//! The Earth in one piece, pixel by pixel: its limb against rays cast in f64, its places where they belong, and its coming
//! in over the clipmap.
#![expect(
    clippy::expect_used,
    clippy::cast_precision_loss,
    reason = "a test: numbers are small and what fails must say so"
)]

mod clipmap_support;

use clipmap_support::booth::{HEIGHT, WIDTH, camera, ray};
use clipmap_support::support::is_emulated;
use clipmap_support::{Land, gpu, mountains};
use glasswing::geo::{Camera, Geodetic};
use glasswing::gl::Gpu;
use glasswing::gl::globe::{self, ALONE_FROM, FROM, GlobeRenderer};
use glasswing::gl::look::Look;
use glasswing::gl::scenery::Scenery;
use glasswing::gl::target::Target;
use glasswing::heap;
use glasswing::terrain::codec::SurfaceKind;
use glasswing::terrain::scene::Settings;
use glasswing::time::Monotonic;
use glasswing::units::Metres;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

struct Studio {
    gpu: Rc<Gpu>,
    globe: GlobeRenderer,
    target: Target,
}

impl Studio {
    fn new(gpu: &Rc<Gpu>, land: Land) -> Self {
        let mut globe = GlobeRenderer::new(gpu, Arc::new(land)).expect("a globe");
        let begun = Monotonic::read();
        while !globe.is_ready() {
            globe.prepare(Metres(1e6), 65_536);
            let waited = Monotonic::read().since(begun).unwrap_or_default();
            assert!(waited < Duration::from_secs(120), "is painted");
            std::thread::park_timeout(Duration::from_millis(1));
        }
        Self {
            gpu: Rc::clone(gpu),
            globe,
            target: Target::offscreen(gpu, WIDTH, HEIGHT, 0).expect("a target"),
        }
    }

    /// The ground alone over a background of one grey.
    fn over(&self, camera: &Camera, grey: f32) -> Vec<u8> {
        let mut pixels = vec![0; (WIDTH * HEIGHT * 4) as usize];
        self.target.bind();
        self.gpu.clear([grey, grey, grey, 1.0]);
        let calls = self.globe.draw(camera, &Look::BARE, false);
        assert_eq!(calls, 1, "it is in the picture");
        self.target.read_rgba(&mut pixels);
        self.gpu.check("while drawing").expect("no GL error");
        pixels
    }

    /// How much of each pixel is Earth, 0 to 1, by what is seen of two backgrounds.
    fn coverage(&self, camera: &Camera) -> Vec<f64> {
        let (black, white) = (self.over(camera, 0.0), self.over(camera, 1.0));
        let through = black.chunks_exact(4).zip(white.chunks_exact(4));
        through
            .map(|(b, w)| 1.0 - (f64::from(w[1]) - f64::from(b[1])) / 255.0)
            .collect()
    }
}

fn plain(_: i32, _: i32) -> (f64, SurfaceKind) {
    (300.0, SurfaceKind::Land)
}

/// Share of a pixel that is Earth, by 8 x 8 rays.
fn truth(camera: &Camera, x: u32, y: u32) -> f64 {
    let places = (0..64).map(|k| {
        let at = |first: u32, step: u32| f64::from(first) + (f64::from(step) + 0.5) / 8.0;
        (at(x, k % 8), at(y, k / 8))
    });
    let hits = places.filter(|&(x, y)| camera.ellipsoid_range_m(x, y).is_some());
    hits.count() as f64 / 64.0
}

/// Pixels that are wrong although the limb is more than a pixel away from their centre, the largest error of coverage of
/// the others that the limb passes, and how many those are.
fn limb_errors(camera: &Camera, coverage: &[f64]) -> (usize, f64, usize) {
    let hit = |x: f64, y: f64| camera.ellipsoid_range_m(x, y).is_some();
    let (mut wrong, mut worst, mut edge) = (0, 0.0_f64, 0);
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let covered = coverage[(y * WIDTH + x) as usize];
            let (cx, cy) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
            let around = (0..8).map(|k| {
                let (sin, cos) = (f64::from(k) * std::f64::consts::FRAC_PI_4).sin_cos();
                hit(cx + cos, cy + sin)
            });
            let inside = around.filter(|&h| h).count();
            match inside {
                8 => wrong += usize::from(covered < 1.0),
                0 if !hit(cx, cy) => wrong += usize::from(covered > 0.0),
                _ => {
                    edge += 1;
                    worst = worst.max((covered - truth(camera, x, y)).abs());
                }
            }
        }
    }
    (wrong, worst, edge)
}

/// Pitch at which the limb passes through the middle of the picture.
fn limb_pitch_deg(eye: &Geodetic) -> f64 {
    -(1.0 / (1.0 + eye.height_ellipsoid.0 / 6_371_000.0))
        .acos()
        .to_degrees()
}

#[test]
fn the_limb_is_exact_from_any_height_and_with_any_field_of_view() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let studio = Studio::new(&gpu, Land::new(120, plain));
    let fovs = if is_emulated() {
        &[2.0, 60.0][..]
    } else {
        &[2.0, 10.0, 60.0, 120.0]
    };
    let places = [(0.0, 0.0), (45.5, -179.99), (-89.9, 33.0), (90.0, 0.0)];
    let (mut pictures, mut edges) = (0, 0);
    for (h, height_m) in [30_000.0, 100_000.0, 1.0e6, 5.0e6, 2.0e7]
        .into_iter()
        .enumerate()
    {
        for (f, &fov) in fovs.iter().enumerate() {
            let (latitude, longitude) = places[(h + f) % places.len()];
            let eye = Geodetic::from_degrees(latitude, longitude, height_m);
            let limb = limb_pitch_deg(&eye);
            for (heading, pitch, roll) in [
                (77.0, limb + 0.2 * fov, 30.0),
                (200.0, -90.0, 0.0),
                (300.0, limb - 0.1 * fov, 180.0),
            ] {
                let camera = camera(eye, (heading, pitch, roll), fov);
                let (wrong, error, edge) = limb_errors(&camera, &studio.coverage(&camera));
                let at = format!("{latitude} {height_m} m, {heading} {pitch} {roll}, fov {fov}");
                assert_eq!(wrong, 0, "{at}");
                // The shader takes a pixel for a disc where the truth is a square: 0.06 at 45 degrees; 64 rays: 0.03.
                assert!(error < 0.12, "{at}: coverage off by {error}");
                (pictures, edges) = (pictures + 1, edges + edge);
            }
        }
    }
    assert!(
        edges > 20 * pictures,
        "{edges} pixels on the limb in {pictures} pictures"
    );
}

/// A board of squares of 10 degrees, every other one water, for 120 posts a degree.
fn chequers(i: i32, j: i32) -> (f64, SurfaceKind) {
    if (i.div_euclid(1200) + j.div_euclid(1200)).rem_euclid(2) == 0 {
        (0.0, SurfaceKind::Water)
    } else {
        (500.0, SurfaceKind::Land)
    }
}

#[test]
fn places_are_where_they_belong_on_both_sides_of_the_date_line_and_near_the_poles() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let studio = Studio::new(&gpu, Land::new(120, chequers));
    for (latitude, longitude, height_m) in [
        (3.0, 1.0, 300_000.0),
        (47.0, 179.0, 1.0e6),
        (-25.0, -179.5, 5.0e6),
        (84.0, 100.0, 2.0e6),
        (-88.0, 10.0, 2.0e7),
    ] {
        let eye = Geodetic::from_degrees(latitude, longitude, height_m);
        let camera = camera(eye, (20.0, -80.0, 5.0), 50.0);
        let pixels = studio.over(&camera, 0.0);
        let (mut told, mut right) = (0, 0);
        for (at, p) in pixels.chunks_exact(4).enumerate() {
            let (x, y) = (at % WIDTH as usize, at / WIDTH as usize);
            let Some(range_m) = camera.ellipsoid_range_m(x as f64 + 0.5, y as f64 + 0.5) else {
                continue;
            };
            let hit = Geodetic::from_ecef(eye.to_ecef() + ray(&camera, at) * range_m);
            let square = |v: f64| {
                (
                    (v / 10.0).floor(),
                    (v / 10.0 - 0.5 - (v / 10.0).floor()).abs(),
                )
            };
            let (i, off_i) = square(hit.longitude.to_degrees());
            let (j, off_j) = square(hit.latitude.to_degrees());
            // Well inside a square that is not a few pixels small.
            if off_i > 0.35 || off_j > 0.35 || hit.latitude.to_degrees().abs() > 80.0 {
                continue;
            }
            let is_water = (i + j).rem_euclid(2.0) < 0.5;
            told += 1;
            right += usize::from((p[2] > p[0]) == is_water);
        }
        assert!(told > 100, "{told} pixels from {latitude} {longitude}");
        // At the limb a square is a line.
        assert!(
            right * 100 >= told * 98,
            "{right} of {told} from {latitude} {longitude}"
        );
    }
}

#[test]
fn it_comes_in_from_20_to_30_km_and_is_alone_above() {
    assert_eq!(globe::share(FROM).to_bits(), 0.0_f64.to_bits());
    assert_eq!(globe::share(ALONE_FROM).to_bits(), 1.0_f64.to_bits());
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let land = Arc::new(Land::new(120, mountains));
    let mut scenery = Scenery::new(&gpu, Settings::default(), land).expect("a scenery");
    let target = Target::offscreen(&gpu, WIDTH, HEIGHT, 0).expect("a target");
    let mut picture = |height_m: f64| {
        let eye = Geodetic::from_degrees(20.0, 30.0, height_m);
        let camera = camera(eye, (40.0, -35.0, 0.0), 60.0);
        let begun = Monotonic::read();
        while !scenery
            .prepare(&camera, Monotonic::read(), 65_536)
            .expect("a camera")
            .settled
        {
            let waited = Monotonic::read().since(begun).unwrap_or_default();
            assert!(waited < Duration::from_secs(120), "settles");
            std::thread::park_timeout(Duration::from_millis(1));
        }
        target.bind();
        gpu.clear([1.0, 0.0, 1.0, 1.0]);
        let calls = scenery.draw(&camera, &Look::FLIGHT, true);
        let mut pixels = vec![0; (WIDTH * HEIGHT * 4) as usize];
        target.read_rgba(&mut pixels);
        (calls, pixels)
    };
    // Mean difference of a channel from one height to the next, where both show nearly the same.
    let difference = |a: &[u8], b: &[u8]| {
        let sum: u32 = a
            .iter()
            .zip(b)
            .map(|(a, b)| u32::from(a.abs_diff(*b)))
            .sum();
        f64::from(sum) / a.len() as f64
    };
    let (below, at_20) = picture(19_990.0);
    let (_, begins) = picture(20_010.0);
    let (_, ends) = picture(29_990.0);
    let (above, at_30) = picture(30_010.0);
    assert!(below > 1, "clipmap and sky: {below}");
    assert_eq!(above, 1, "the globe alone");
    assert!(
        difference(&at_20, &begins) < 1.0,
        "{}",
        difference(&at_20, &begins)
    );
    assert!(
        difference(&ends, &at_30) < 1.0,
        "{}",
        difference(&ends, &at_30)
    );
    // And the two of them are pictures of one Earth.
    let whole = difference(&at_20, &at_30);
    assert!(whole < 25.0, "{whole}");
}

#[test]
fn a_climb_into_space_allocates_nothing() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let land = Arc::new(Land::new(120, mountains));
    let mut scenery = Scenery::new(&gpu, Settings::default(), land).expect("a scenery");
    let target = Target::offscreen(&gpu, WIDTH, HEIGHT, 0).expect("a target");
    let mut climb = |frames: std::ops::Range<u32>| {
        for frame in frames {
            let height_m = 12_000.0 * 1.02_f64.powf(f64::from(frame));
            let eye = Geodetic::from_degrees(10.0, 20.0, height_m);
            let camera = camera(eye, (0.0, -20.0, 0.0), 60.0);
            target.bind();
            gpu.clear([0.0; 4]);
            scenery
                .prepare(&camera, Monotonic::read(), 65_536)
                .expect("a camera");
            scenery.draw(&camera, &Look::FLIGHT, true);
            std::thread::park_timeout(Duration::from_millis(2));
        }
    };
    climb(0..10);
    let before = heap::allocations_of_this_thread();
    climb(10..100);
    let after = heap::allocations_of_this_thread();
    assert_eq!(after - before, 0, "allocations in 90 frames");
}
