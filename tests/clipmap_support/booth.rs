//! A renderer with a small target, and what is asked of its pictures pixel by pixel.

use glam::DVec3;
use glasswing::geo::{Attitude, Camera, Geodetic, WGS84_A_M, WGS84_B_M};
use glasswing::gl::Gpu;
use glasswing::gl::look::Look;
use glasswing::gl::target::Target;
use glasswing::gl::terrain::{RANGE_CLEAR, TerrainRenderer};
use glasswing::terrain::clipmap::Shape;
use glasswing::terrain::scene::{FrameFigures, Settings};
use glasswing::terrain::surface::TileSource;
use glasswing::time::Monotonic;
use glasswing::units::Radians;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

pub(crate) const WIDTH: u32 = 160;
pub(crate) const HEIGHT: u32 = 96;
/// No terrain has this colour.
const BACKGROUND: [u8; 4] = [255, 0, 255, 255];

pub(crate) fn settings(vertices: u32) -> Settings {
    Settings {
        shape: Shape::new(vertices).expect("a legal shape"),
        ..Settings::default()
    }
}

#[derive(Debug)]
pub(crate) struct Booth {
    pub(crate) gpu: Rc<Gpu>,
    pub(crate) terrain: TerrainRenderer,
    pub(crate) target: Target,
    pub(crate) pixels: Vec<u8>,
}

impl Booth {
    pub(crate) fn new<S: TileSource>(gpu: &Rc<Gpu>, vertices: u32, land: Arc<S>) -> Self {
        Self::with(gpu, settings(vertices), land)
    }

    pub(crate) fn with<S: TileSource>(gpu: &Rc<Gpu>, settings: Settings, land: Arc<S>) -> Self {
        Self {
            gpu: Rc::clone(gpu),
            terrain: TerrainRenderer::new(gpu, settings, land).expect("a renderer"),
            target: Target::offscreen(gpu, WIDTH, HEIGHT, 0).expect("a target"),
            pixels: vec![0; (WIDTH * HEIGHT * 4) as usize],
        }
    }

    pub(crate) fn prepare(&mut self, camera: &Camera, quota: usize) -> FrameFigures {
        let now = Monotonic::read();
        self.terrain.prepare(camera, now, quota).expect("a camera")
    }

    pub(crate) fn settle(&mut self, camera: &Camera) -> FrameFigures {
        let begun = Monotonic::read();
        loop {
            let figures = self.prepare(camera, 65_536);
            if figures.settled {
                return figures;
            }
            let waited = Monotonic::read().since(begun).unwrap_or_default();
            assert!(waited < Duration::from_secs(120), "settles");
            std::thread::park_timeout(Duration::from_millis(1));
        }
    }

    /// Draws and returns the pixels in which there is a background although the ray meets the Earth.
    pub(crate) fn holes(&mut self, camera: &Camera, lowest_m: f64) -> usize {
        self.target.bind();
        self.gpu.clear([1.0, 0.0, 1.0, 1.0]);
        self.terrain.draw(&Look::BARE);
        self.target.read_rgba(&mut self.pixels);
        self.gpu.check("while drawing").expect("no GL error");
        self.pixels
            .chunks_exact(4)
            .enumerate()
            .filter(|&(at, p)| p == BACKGROUND && meets_earth(camera, at, lowest_m))
            .count()
    }

    /// Draws all that is in the picture, of the partition that goes too.
    pub(crate) fn show(&mut self) {
        self.target.bind();
        self.gpu.clear([1.0, 0.0, 1.0, 1.0]);
        self.terrain.draw(&Look::BARE);
        self.gpu.clear_depth();
        self.terrain.draw_going(&Look::BARE);
        self.target.read_rgba(&mut self.pixels);
        self.gpu.check("while drawing").expect("no GL error");
    }

    pub(crate) fn ranges(&mut self) -> Vec<f32> {
        self.target.bind();
        self.gpu.clear(RANGE_CLEAR);
        self.terrain.draw_range();
        self.target.read_rgba(&mut self.pixels);
        self.pixels
            .chunks_exact(4)
            .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
            .collect()
    }
}

/// The direction through the centre of a pixel.
pub(crate) fn ray(camera: &Camera, at: usize) -> DVec3 {
    let width = camera.width_px as usize;
    let (x, y) = ((at % width) as f64, (at / width) as f64);
    camera.ray_ecef(x + 0.5, y + 0.5)
}

/// Whether the ray through a pixel meets an ellipsoid that lies `lowest_m` (negative) above WGS 84's.
pub(crate) fn meets_earth(camera: &Camera, at: usize, lowest_m: f64) -> bool {
    let axes = DVec3::new(
        WGS84_A_M + lowest_m,
        WGS84_A_M + lowest_m,
        WGS84_B_M + lowest_m,
    );
    let (o, d) = (camera.eye.to_ecef() / axes, ray(camera, at) / axes);
    let (a, b, c) = (d.dot(d), o.dot(d), o.dot(o) - 1.0);
    let inside = b * b - a * c;
    inside >= 0.0 && -b - inside.sqrt() > 0.0
}

pub(crate) fn camera(eye: Geodetic, attitude: (f64, f64, f64), hfov: f64) -> Camera {
    Camera {
        eye,
        attitude: Attitude::from_degrees(attitude.0, attitude.1, attitude.2),
        hfov: Radians::from_degrees(hfov),
        width_px: WIDTH,
        height_px: HEIGHT,
    }
}
