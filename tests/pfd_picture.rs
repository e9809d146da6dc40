//! The primary flight display in pixels, drawn by the GPU (or its software) without a screen.
#![expect(clippy::panic, reason = "a test fails by panicking")]
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "coordinates of pixels inside of small pictures"
)]

mod support;

use glam::{DVec2, Vec2};
use glasswing::display::colour;
use glasswing::display::{Config, Model, Ui};
use glasswing::draw::atlas::Atlas;
use glasswing::draw::list::Rect;
use glasswing::draw::{DrawList, Layout, draw};
use glasswing::gl::Gpu;
use glasswing::gl::target::Target;
use glasswing::gl::vector::VectorRenderer;
use glasswing::sampled::{Invalid, Sampled};
use glasswing::screen::Screen;
use glasswing::signal::{Parameter as P, SourceId};
use glasswing::state::FlightState;
use glasswing::time::Monotonic;
use std::rc::Rc;

const NOW: Monotonic = Monotonic::from_nanos(1_000_000_000_000);

/// What was drawn: rows from the top, four bytes a pixel.
struct Picture {
    width: usize,
    pixels: Vec<u8>,
}

impl Picture {
    fn at(&self, x: usize, y: usize) -> [u8; 3] {
        let i = (y * self.width + x) * 4;
        [self.pixels[i], self.pixels[i + 1], self.pixels[i + 2]]
    }
}

/// Everything that draws. Fields are dropped in order: the screen last.
struct Bench {
    renderer: VectorRenderer,
    gpu: Rc<Gpu>,
    atlas: Atlas,
    _screen: Box<dyn Screen>,
}

impl Bench {
    fn open() -> Self {
        let screen = support::headless_screen(1024, 600);
        let gpu = Gpu::new(&|name| screen.gl_proc(name)).unwrap_or_else(|e| panic!("{e}"));
        let atlas = Atlas::build().unwrap_or_else(|e| panic!("{e}"));
        let renderer = VectorRenderer::new(&gpu, &atlas).unwrap_or_else(|e| panic!("{e}"));
        Self {
            renderer,
            gpu,
            atlas,
            _screen: screen,
        }
    }

    /// `list` over black.
    fn picture(&mut self, list: &DrawList, width: u32, height: u32) -> Picture {
        let target =
            Target::offscreen(&self.gpu, width, height, 0).unwrap_or_else(|e| panic!("{e}"));
        target.bind();
        self.gpu.clear([0.0, 0.0, 0.0, 1.0]);
        self.renderer.draw(list, width, height);
        if let Err(e) = self.gpu.check("while drawing a list") {
            panic!("{e}");
        }
        let mut pixels = vec![0; width as usize * height as usize * 4];
        target.read_rgba(&mut pixels);
        Picture {
            width: width as usize,
            pixels,
        }
    }

    fn display(&mut self, state: &FlightState, width: u32, height: u32) -> Picture {
        let model = Model::build(state, &Ui::default(), &Config::default(), NOW);
        let mut list = DrawList::new();
        draw(&model, &Layout::new(width, height), &self.atlas, &mut list);
        self.picture(&list, width, height)
    }
}

fn attitude(pitch: f64, roll: f64) -> FlightState {
    let mut state = FlightState::empty();
    for (parameter, degrees) in [(P::Pitch, pitch), (P::Roll, roll)] {
        state.set(
            parameter,
            Sampled::good(degrees.to_radians(), NOW),
            SourceId(0),
        );
    }
    state
}

#[derive(Clone, Copy, PartialEq)]
enum Side {
    Sky,
    Earth,
    Neither,
}

/// Blue or brown by a clear margin; symbols are white, black or grey.
fn side([red, _, blue]: [u8; 3]) -> Side {
    match i32::from(blue) - i32::from(red) {
        d if d > 25 => Side::Sky,
        d if d < -25 => Side::Earth,
        _ => Side::Neither,
    }
}

/// Places where sky and earth meet with no more than the horizon line between them, and which way the sky is; seen along
/// one row or column of `count` pixels.
fn meetings(count: usize, thickest: usize, pixel: impl Fn(usize) -> Option<[u8; 3]>) -> Vec<f64> {
    let mut found = Vec::new();
    let mut last: Option<(usize, Side)> = None;
    for i in 0..count {
        let Some(rgb) = pixel(i) else {
            last = None;
            continue;
        };
        let here = side(rgb);
        if here == Side::Neither {
            continue;
        }
        if let Some((k, before)) = last
            && before != here
            && i - k <= thickest
        {
            found.push((k as f64 + i as f64 + 1.0) / 2.0);
        }
        last = Some((i, here));
    }
    found
}

/// The line through points: a point on it and its direction (total least squares).
fn fit(points: &[DVec2]) -> (DVec2, DVec2) {
    let mean = points.iter().sum::<DVec2>() / points.len() as f64;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for p in points {
        let d = *p - mean;
        (xx, xy, yy) = (xx + d.x * d.x, xy + d.x * d.y, yy + d.y * d.y);
    }
    let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
    (mean, DVec2::new(angle.cos(), angle.sin()))
}

/// Pitch and roll in degrees, from nothing but the pixels of the middle of the picture and the focal length.
fn seen(picture: &Picture, layout: &Layout, focal: f64) -> (f64, f64) {
    // Between the tapes, below the annunciation and above the heading window.
    let free = |x: usize, y: usize| {
        let (px, py) = (x as f32, y as f32);
        let between = px > layout.airspeed.max.x + 40.0 && px < layout.altitude.min.x - 4.0;
        let level = py > 20.0 && py < layout.heading_window.min.y - 4.0;
        let note = px < layout.annunciation.max.x + 4.0 && py < layout.annunciation.max.y + 4.0;
        (between && level && !note).then(|| picture.at(x, y))
    };
    let (width, height) = (picture.width, picture.pixels.len() / 4 / picture.width);
    let mut points = Vec::new();
    for x in 0..width {
        for y in meetings(height, 14, |y| free(x, y)) {
            points.push(DVec2::new(x as f64 + 0.5, y));
        }
    }
    for y in 0..height {
        for x in meetings(width, 14, |x| free(x, y)) {
            points.push(DVec2::new(x, y as f64 + 0.5));
        }
    }
    assert!(
        points.len() > 50,
        "no horizon found: {} points",
        points.len()
    );
    // Symbols on the line bend a few of them.
    let (on, along) = fit(&points);
    points.retain(|p| (*p - on).perp_dot(along).abs() < 3.0);
    let (on, along) = fit(&points);
    points.retain(|p| (*p - on).perp_dot(along).abs() < 1.2);
    let (on, along) = fit(&points);
    // Up is the side of the sky: look a little to both sides of the line.
    let normal = DVec2::new(-along.y, along.x);
    let mut votes = 0;
    for p in &points {
        let q = *p + normal * 12.0;
        votes += match free(q.x as usize, q.y as usize).map(side) {
            Some(Side::Sky) => 1,
            Some(Side::Earth) => -1,
            _ => 0,
        };
    }
    let up = if votes > 0 { normal } else { -normal };
    // Level, up is (0, -1) on the screen. Right wing down turns the world anticlockwise: up leans to the left.
    let roll = (-up.x).atan2(-up.y).to_degrees();
    // A pinhole camera: the horizon is at angle -pitch from the axis.
    let centre = DVec2::new(width as f64 / 2.0, height as f64 / 2.0);
    let rise = (on - centre).dot(up);
    ((-rise / focal).atan().to_degrees(), roll)
}

#[test]
fn the_horizon_in_the_pixels_is_where_pitch_and_roll_put_it() {
    let mut bench = Bench::open();
    for (width, height) in [(1024, 600), (800, 480), (1920, 1080)] {
        for (pitch, roll) in [
            (0.0, 0.0),
            (5.0, 0.0),
            (3.3, 1.7),
            (-4.0, 22.0),
            (8.0, -35.0),
            (6.0, 60.0),
            (-2.5, 90.0),
            (-6.0, -120.0),
            (4.0, 179.0),
        ] {
            let picture = bench.display(&attitude(pitch, roll), width, height);
            // The field of view of the default configuration is 60 degrees across the picture.
            let focal = f64::from(width) / 2.0 / 30.0_f64.to_radians().tan();
            let (p, r) = seen(&picture, &Layout::new(width, height), focal);
            let dr = (r - roll + 540.0).rem_euclid(360.0) - 180.0;
            assert!(
                (p - pitch).abs() < 0.1 && dr.abs() < 0.1,
                "{width}x{height}: pitch {pitch} roll {roll} seen as {p:.3} {r:.3}"
            );
        }
    }
}

#[test]
fn some_of_the_missing_colour_stays_in_sight_at_any_attitude() {
    let mut bench = Bench::open();
    for (pitch, roll) in [
        (40.0, 0.0),
        (-60.0, 0.0),
        (89.0, 45.0),
        (-89.0, 130.0),
        (30.0, 90.0),
    ] {
        let picture = bench.display(&attitude(pitch, roll), 1024, 600);
        let count = |wanted| {
            let pixels = picture.pixels.chunks_exact(4);
            pixels
                .filter(|p| side([p[0], p[1], p[2]]) == wanted)
                .count()
        };
        let (sky, earth) = (count(Side::Sky), count(Side::Earth));
        assert!(
            sky > 1500 && earth > 1500,
            "{pitch} {roll}: sky {sky}, earth {earth}"
        );
    }
}

#[test]
fn edges_between_pixels_are_covered_in_proportion() {
    let mut bench = Bench::open();
    let mut list = DrawList::new();
    list.rect(Rect::new(10.25, 5.0, 2.25, 10.0), colour::SCALE);
    // Narrower than a pixel: three tenths of it.
    list.rect(Rect::new(20.4, 5.0, 0.3, 10.0), colour::SCALE);
    let picture = bench.picture(&list, 64, 32);
    for (x, coverage) in [
        (9, 0.0),
        (10, 0.75),
        (11, 1.0),
        (12, 0.5),
        (13, 0.0),
        (19, 0.0),
        (20, 0.3),
        (21, 0.0),
    ] {
        let value = f64::from(picture.at(x, 9)[0]) / 255.0;
        assert!((value - coverage).abs() < 0.01, "column {x}: {value}");
    }
    assert_eq!(picture.at(11, 4), [0; 3]);
    assert_eq!(picture.at(11, 15), [0; 3]);
}

#[test]
fn nothing_leaves_the_clip_rectangle() {
    let mut bench = Bench::open();
    let mut list = DrawList::new();
    list.clip(Some(Rect::new(8.0, 8.0, 10.0, 10.0)));
    list.line(
        Vec2::new(-20.0, -20.0),
        Vec2::new(80.0, 80.0),
        9.0,
        colour::SCALE,
    );
    let picture = bench.picture(&list, 64, 32);
    let mut lit = 0;
    for y in 0..32 {
        for x in 0..64 {
            let inside = (8..18).contains(&x) && (8..18).contains(&y);
            let on = picture.at(x, y) != [0; 3];
            assert!(inside || !on, "({x}, {y})");
            lit += usize::from(on);
        }
    }
    assert!(lit > 60, "{lit}");
}

#[test]
fn overlapping_layers_blend_as_their_opacity_says() {
    let mut bench = Bench::open();
    let mut list = DrawList::new();
    let all = Rect::new(-2.0, -2.0, 40.0, 40.0);
    list.rect(all, colour::SCALE);
    list.rect(all, colour::HALO);
    let picture = bench.picture(&list, 16, 16);
    // 190 / 255 of black over white leaves 65.
    assert!(
        (i32::from(picture.at(8, 8)[1]) - 65).abs() <= 1,
        "{:?}",
        picture.at(8, 8)
    );
}

#[test]
fn a_failed_attitude_is_a_red_cross_without_sky_or_earth() {
    let mut bench = Bench::open();
    let mut state = attitude(0.0, 0.0);
    state.set(
        P::Pitch,
        Sampled::fault(Invalid::SourceFailed, NOW),
        SourceId(0),
    );
    let picture = bench.display(&state, 1024, 600);
    let flag = Layout::new(1024, 600).attitude_flag;
    let red = |x: f32, y: f32| {
        let [r, g, b] = picture.at(x as usize, y as usize);
        r > 200 && g < 80 && b < 80
    };
    for t in [0.1_f32, 0.2, 0.8, 0.9] {
        let at = flag.min.lerp(flag.max, t);
        assert!(red(at.x, at.y), "falling diagonal at {t}");
        assert!(
            red(at.x, flag.min.y + flag.max.y - at.y),
            "rising diagonal at {t}"
        );
    }
    // Between the tapes, where nothing but sky and earth is blue or brown (the setting beside them is cyan).
    for y in 0..600 {
        for x in (160..840).filter(|x| !(144..264).contains(x)) {
            let rgb = picture.at(x, y);
            assert!(side(rgb) != Side::Sky, "sky at ({x}, {y})");
        }
    }
}

#[test]
fn a_disagreement_is_told_in_amber_and_the_value_stays() {
    let mut bench = Bench::open();
    let mut state = attitude(2.0, 10.0);
    for (p, value) in [
        (P::HeadingTrue, 1.0),
        (P::IndicatedAirspeed, 50.0),
        (P::PressureAltitude, 1000.0),
        (P::GroundSpeed, 60.0),
        (P::HeightAgl, 432.0),
    ] {
        state.set(p, Sampled::good(value, NOW), SourceId(1));
    }
    state.set_derived(P::VerticalSpeed, Sampled::good(2.0, NOW));
    let quiet = bench.display(&state, 1024, 600);
    state.set_miscompares([true, false, true, true, true]);
    state.set_fallback(P::Pitch, true);
    state.set_fallback(P::IndicatedAirspeed, true);
    let told = bench.display(&state, 1024, 600);
    let place = Layout::new(1024, 600).notes;
    let amber = |picture: &Picture| {
        let (x, y) = (place.min.x as usize, place.min.y as usize);
        let (width, height) = (place.width() as usize, place.height() as usize);
        let places = (0..width).flat_map(|i| (0..height).map(move |j| (x + i, y + j)));
        let inked = places.filter(|(x, y)| {
            let [r, g, b] = picture.at(*x, *y);
            r > 180 && g > 120 && b < 80
        });
        inked.count()
    };
    assert_eq!(amber(&quiet), 0, "nothing amber where nothing is wrong");
    assert!(amber(&told) > 600, "{}", amber(&told));
    // Beside the notes nothing has changed: the instruments still read.
    for y in 0..600 {
        for x in (0..700).chain(840..1024) {
            assert_eq!(quiet.at(x, y), told.at(x, y), "({x}, {y})");
        }
    }
}
