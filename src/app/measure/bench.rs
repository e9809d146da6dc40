//! What measurements are made with: a GPU, a renderer of a source, and targets of any size.

use crate::app::error::{Failure, Kind};
use crate::geo::{Attitude, Camera, Geodetic};
use crate::gl::Gpu;
use crate::gl::look::Look;
use crate::gl::target::Target;
use crate::gl::terrain::record::VertexRecorder;
use crate::gl::terrain::{RANGE_CLEAR, TerrainRenderer};
use crate::terrain::clipmap::Shape;
use crate::terrain::partition::Partition;
use crate::terrain::scene::{FrameFigures, Scene, Settings};
use crate::terrain::surface::TileSource;
use crate::time::Monotonic;
use crate::units::Radians;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

/// Texels a frame: the default of a board.
pub const QUOTA: usize = 65_536;
/// A view that is not settled by now never will be.
const SETTLE_MAX: Duration = Duration::from_secs(120);
/// How long to leave the streaming thread alone between two looks at what it has done.
const PAUSE: Duration = Duration::from_micros(500);
/// Texels a frame while nothing is flown: everything that has arrived.
const SETTLE_QUOTA: usize = 1 << 22;

/// A view: degrees north, degrees east, metres above the ellipsoid; heading, pitch and roll in degrees; the horizontal
/// field of view in degrees; the size in pixels.
#[must_use]
pub fn camera(
    (latitude, longitude, height_m): (f64, f64, f64),
    (heading, pitch, roll): (f64, f64, f64),
    hfov_deg: f64,
    (width_px, height_px): (u32, u32),
) -> Camera {
    Camera {
        eye: Geodetic::from_degrees(latitude, longitude, height_m),
        attitude: Attitude::from_degrees(heading, pitch, roll),
        hfov: Radians::from_degrees(hfov_deg),
        width_px,
        height_px,
    }
}

/// A source on the GPU.
#[derive(Debug)]
pub struct Bench {
    /// The GPU.
    pub gpu: Rc<Gpu>,
    /// Draws the source.
    pub terrain: TerrainRenderer,
    shape: Shape,
    recorder: Option<VertexRecorder>,
    targets: Vec<Target>,
}

impl Bench {
    /// For a source, drawn by these settings, or with so many vertices along a side of a level.
    ///
    /// # Errors
    /// With what the GPU or the system refuses.
    pub fn new<S: TileSource>(
        gpu: &Rc<Gpu>,
        source: &Arc<S>,
        settings: impl Into<Settings>,
    ) -> Result<Self, Failure> {
        let settings = settings.into();
        let terrain =
            TerrainRenderer::new(gpu, settings, Arc::clone(source)).map_err(|e| refused(&e))?;
        Ok(Self {
            gpu: Rc::clone(gpu),
            terrain,
            shape: settings.shape,
            recorder: None,
            targets: Vec::new(),
        })
    }

    /// Streams until every wanted level is resident, and plans the view.
    ///
    /// # Errors
    /// When the camera is none, or it takes minutes.
    pub fn settle(&mut self, camera: &Camera) -> Result<FrameFigures, Failure> {
        let begun = Monotonic::read();
        loop {
            let figures = self.step(camera, SETTLE_QUOTA)?;
            if figures.settled {
                return Ok(figures);
            }
            if Monotonic::read().since(begun).unwrap_or_default() > SETTLE_MAX {
                return Err(Failure::new(
                    Kind::Input,
                    "the terrain",
                    format!("it does not settle: {figures:?} of {camera:?}"),
                    "check the pack with `glasswing terrain verify`",
                ));
            }
            std::thread::park_timeout(PAUSE);
        }
    }

    /// One frame of streaming and planning, now.
    ///
    /// # Errors
    /// When the camera is none.
    pub fn step(&mut self, camera: &Camera, quota: usize) -> Result<FrameFigures, Failure> {
        self.step_at(camera, Monotonic::read(), quota)
    }

    /// The frame of a time.
    ///
    /// # Errors
    /// When the camera is none.
    pub fn step_at(
        &mut self,
        camera: &Camera,
        now: Monotonic,
        quota: usize,
    ) -> Result<FrameFigures, Failure> {
        self.terrain.prepare(camera, now, quota).map_err(|e| {
            Failure::new(
                Kind::Other,
                "measure",
                format!("{e}: {camera:?}"),
                "report this",
            )
        })
    }

    /// The shape of its levels.
    #[must_use]
    pub const fn shape(&self) -> Shape {
        self.shape
    }

    /// The partition that the planned view is drawn in.
    #[must_use]
    pub fn partition(&self) -> Option<Partition> {
        self.terrain.scene().map(Scene::partition)
    }

    /// Draws the planned view on nothing: red, green, blue and opacity of each pixel, rows from the top; 0 opacity is what
    /// no triangle covers.
    ///
    /// # Errors
    /// With what the GPU refuses.
    pub fn picture(&mut self, camera: &Camera) -> Result<Vec<u8>, Failure> {
        self.read(camera, [0.0; 4], |gpu, terrain| {
            terrain.draw(&Look::BARE);
            gpu.clear_depth();
            terrain.draw_going(&Look::BARE);
        })
    }

    /// Distance from the eye to what each pixel of the planned view shows, metres, rows from the top; infinite for sky.
    ///
    /// # Errors
    /// With what the GPU refuses.
    pub fn ranges(&mut self, camera: &Camera) -> Result<Vec<f32>, Failure> {
        let bytes = self.read(camera, RANGE_CLEAR, |_, terrain| terrain.draw_range())?;
        let pixels = bytes.chunks_exact(4);
        Ok(pixels
            .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
            .collect())
    }

    /// Binds a target of the camera's size, made when first asked for.
    ///
    /// # Errors
    /// With what the GPU refuses.
    pub fn bind(&mut self, camera: &Camera) -> Result<&Target, Failure> {
        let size = (camera.width_px, camera.height_px);
        let at = if let Some(at) = self.targets.iter().position(|t| t.size_px() == size) {
            at
        } else {
            let made = Target::offscreen(&self.gpu, size.0, size.1, 0).map_err(|e| refused(&e))?;
            self.targets.push(made);
            self.targets.len() - 1
        };
        self.targets[at].bind();
        Ok(&self.targets[at])
    }

    /// The recorder of vertices, made when first asked for, beside the renderer.
    ///
    /// # Errors
    /// With what the GPU refuses.
    pub fn recorder(&mut self) -> Result<(&TerrainRenderer, &VertexRecorder), Failure> {
        let recorder = match self.recorder.take() {
            Some(made) => made,
            None => VertexRecorder::new(&self.gpu, self.shape).map_err(|e| refused(&e))?,
        };
        Ok((&self.terrain, self.recorder.insert(recorder)))
    }

    fn read(
        &mut self,
        camera: &Camera,
        clear: [f32; 4],
        draw: impl FnOnce(&Gpu, &TerrainRenderer),
    ) -> Result<Vec<u8>, Failure> {
        let mut pixels = vec![0; camera.width_px as usize * camera.height_px as usize * 4];
        self.bind(camera)?;
        self.gpu.clear(clear);
        draw(&self.gpu, &self.terrain);
        self.bind(camera)?.read_rgba(&mut pixels);
        self.gpu.check("while measuring").map_err(|e| refused(&e))?;
        Ok(pixels)
    }
}

/// The GPU's refusal as a failure.
pub(super) fn refused(e: &dyn std::error::Error) -> Failure {
    let todo = "check the driver with `glasswing list`";
    Failure::new(Kind::Device, "the GPU", e, todo)
}

/// Random numbers that are the same every time (SplitMix64, as [`crate::terrain::synth_noise::hash`]).
#[derive(Clone, Copy, Debug)]
pub struct Dice(u64);

impl Dice {
    /// From a seed.
    #[must_use]
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// For the thing of a number among those of a kind.
    #[must_use]
    pub fn of(kind: i64, number: usize) -> Self {
        Self(crate::terrain::synth_noise::hash(
            number.cast_signed() as i64,
            kind,
            0,
        ))
    }

    /// Between `low` and `high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(1);
        let bits =
            crate::terrain::synth_noise::hash(0, 0, self.0.wrapping_mul(0x9e37_79b9_7f4a_7c15))
                >> 32;
        let share = f64::from(u32::try_from(bits).unwrap_or(0)) / (f64::from(u32::MAX) + 1.0);
        low + (high - low) * share
    }

    /// One of several.
    pub fn pick<T: Copy>(&mut self, of: &[T]) -> T {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            clippy::cast_precision_loss,
            reason = "an index of a short list"
        )]
        let at = self.between(0.0, of.len() as f64) as usize;
        of[at.min(of.len() - 1)]
    }
}
