//! The picture of one frame: from a flight state to pixels in a target.
//!
//! Owns everything that draws: terrain, sky, instruments, and the pilot's settings. After construction nothing here
//! allocates.

use crate::app::board::{Board, PressureUnit};
use crate::app::error::{Failure, Kind};
use crate::app::fly;
use crate::app::instruments::{Instruments, InstrumentsError};
use crate::app::picture::Size;
use crate::app::vision::{Dress, Shown, Vision};
use crate::bus::input::Action;
use crate::display::{
    BaroSetting, BaroUnit, CameraHeight, Config, Model, SourceName, Terrain, Ui, VSpeeds,
    source_name,
};
use crate::geo::{Camera, Geodetic};
use crate::gl::look::Palette;
use crate::gl::scenery::SceneryError;
use crate::gl::target::Target;
use crate::gl::{GlError, Gpu};
use crate::screen::{self, Screen};
use crate::state::FlightState;
use crate::terrain::budget::{Need, TooLittle};
use crate::terrain::clipmap::Shape;
use crate::terrain::pack::Pack;
use crate::terrain::scene::Settings;
use crate::time::Monotonic;
use crate::units::{HECTOPASCALS_PER_INCH_OF_MERCURY, Hectopascals};
use std::path::Path;
use std::rc::Rc;
use std::time::Duration;

/// What one frame did.
#[derive(Clone, Copy, Debug, Default)]
pub struct Drawn {
    /// Terrain triangles.
    pub triangles: u64,
    /// Draw calls of terrain, sky and instruments.
    pub draw_calls: u32,
    /// Bytes sent to the GPU for terrain.
    pub upload_bytes: u64,
    /// Height samples sent to the GPU.
    pub upload_texels: u64,
    /// Height samples decoded in the frame before.
    pub decoded_samples: u64,
    /// Bytes of terrain: textures, copies, decoded tiles.
    pub resident_bytes: u64,
    /// Whether terrain was in the picture.
    pub terrain_shown: bool,
    /// Whether every wanted level of terrain was there.
    pub terrain_settled: bool,
    /// Whether the instruments did not fit the draw list: a defect.
    pub list_overflowed: bool,
    /// Time of our own work on state, model and draw list, without GL.
    pub own_time: Duration,
}

/// Everything that draws.
#[derive(Debug)]
pub struct Cockpit {
    size: Size,
    target: Target,
    window: Option<Target>,
    instruments: Instruments,
    vision: Option<Vision>,
    config: Config,
    quota_texels: usize,
    /// The pilot's settings.
    pub ui: Ui,
    gpu: Rc<Gpu>,
}

impl Cockpit {
    /// Makes everything that draws on `screen`, as the board says, with terrain if there is a pack.
    ///
    /// # Errors
    /// When the GPU refuses something.
    pub fn new(screen: &dyn Screen, board: &Board, pack: Option<Pack>) -> Result<Self, Failure> {
        let means = Means::of(board, pack.as_ref())?;
        let gpu = Gpu::new(&|name| screen.gl_proc(name)).map_err(|e| gl_failed(screen, e))?;
        let (width_px, height_px) = screen.size_px();
        let size = Size {
            width_px,
            height_px,
        };
        Self::on(&gpu, board, (pack, means), size, screen.is_headless())
            .map_err(|e| gl_failed(screen, e))
    }

    fn on(
        gpu: &Rc<Gpu>,
        board: &Board,
        (pack, means): (Option<Pack>, Means),
        size: Size,
        headless: bool,
    ) -> Result<Self, MakeError> {
        let vision = pack
            .map(|pack| Vision::new(gpu, means.settings, pack))
            .transpose()?;
        Ok(Self {
            size,
            target: Target::offscreen(gpu, size.width_px, size.height_px, board.screen.samples)?,
            window: (!headless).then(|| Target::window(gpu, size.width_px, size.height_px)),
            instruments: Instruments::new(gpu, size)?,
            vision,
            config: config(board),
            quota_texels: means.quota_texels,
            ui: Ui {
                awareness: board.terrain.awareness,
                grid: board.terrain.grid,
                night: board.palette == Palette::Night,
                ..Ui::default()
            },
            gpu: Rc::clone(gpu),
        })
    }

    /// One line for logs: what draws.
    #[must_use]
    pub fn describe(&self) -> String {
        self.gpu.caps().renderer.clone()
    }

    /// Draws what `state` says at `now`, ready to be presented or read back.
    pub fn draw(&mut self, state: &FlightState, now: Monotonic) -> Drawn {
        let started = Monotonic::read();
        let mut drawn = Drawn::default();
        let (mut model, camera) = self.view(state, now);
        let mut own = Monotonic::read().since(started).unwrap_or_default();

        self.target.bind();
        self.gpu.clear([0.0, 0.0, 0.0, 1.0]);
        if model.svs.is_ok() {
            let shown = match (camera, &mut self.vision) {
                (Some(camera), Some(vision)) => {
                    vision.dress = Dress::of(&self.ui);
                    vision.show(&camera, now, self.quota_texels, &mut drawn)
                }
                _ => Shown::off(Terrain::NoCamera),
            };
            (self.ui.terrain, self.ui.terrain_caution) = (shown.terrain, shown.caution);
            if shown == Shown::WELL {
                let above = camera.zip(self.vision.as_ref());
                self.ui.height_above_ground =
                    above.and_then(|(camera, vision)| vision.height_above_ground(&camera.eye));
            }
            model = Model::build(state, &self.ui, &self.config, now);
        }
        let listing = Monotonic::read();
        self.instruments.list(&model);
        own += Monotonic::read().since(listing).unwrap_or_default();
        self.instruments.draw();
        drawn.draw_calls += 1;
        self.target.resolve();
        match &self.window {
            Some(window) => self.target.copy_to(window),
            // Nothing will wait for the GPU later: a frame without a screen is done when it is drawn.
            None => self.gpu.finish(),
        }
        drawn.list_overflowed = self.instruments.overflowed();
        drawn.own_time = own;
        drawn
    }

    /// Streams terrain for what `state` says at `now`, without drawing. Returns whether every wanted level is there; true
    /// too where there is nothing to wait for.
    pub fn stream(&mut self, state: &FlightState, now: Monotonic) -> bool {
        let (_, camera) = self.view(state, now);
        match (camera, &mut self.vision) {
            (Some(camera), Some(vision)) => vision.stream(&camera, now, self.quota_texels),
            _ => true,
        }
    }

    /// The model as if terrain were there, and its camera: terrain can only load where a camera asks for it. What there
    /// really is, is said once it has been drawn.
    fn view(&mut self, state: &FlightState, now: Monotonic) -> (Model, Option<Camera>) {
        self.ui.terrain = if self.vision.is_some() {
            Terrain::Ready
        } else {
            Terrain::NoPack
        };
        self.ui.terrain_caution = None;
        self.ui.height_above_ground = None;
        let model = Model::build(state, &self.ui, &self.config, now);
        let camera = self.camera(&model);
        (model, camera)
    }

    /// The camera of synthetic vision, if everything that it needs may be shown.
    fn camera(&self, model: &Model) -> Option<Camera> {
        let inputs = model.svs.ok()?;
        let vision = self.vision.as_ref()?;
        let (latitude, longitude) = (inputs.latitude, inputs.longitude);
        let height_ellipsoid = match inputs.height {
            CameraHeight::Ellipsoid(height) => height,
            CameraHeight::MeanSeaLevel(altitude) => {
                altitude + vision.undulation(latitude, longitude)?
            }
        };
        let camera = Camera {
            eye: Geodetic {
                latitude,
                longitude,
                height_ellipsoid,
            },
            attitude: inputs.attitude,
            hfov: self.config.hfov,
            width_px: self.size.width_px,
            height_px: self.size.height_px,
        };
        camera.is_valid().then_some(camera)
    }

    /// Takes in what the pilot did.
    pub fn act(&mut self, action: Action) {
        let unit_hpa = match self.config.baro_unit {
            BaroUnit::Hectopascals => 1.0,
            BaroUnit::InchesOfMercury => 0.01 * HECTOPASCALS_PER_INCH_OF_MERCURY,
        };
        match action {
            Action::ToggleAwareness => self.ui.awareness = !self.ui.awareness,
            Action::ToggleGrid => self.ui.grid = !self.ui.grid,
            Action::ToggleNight => self.ui.night = !self.ui.night,
            Action::BaroStandard => self.ui.baro_standard = !self.ui.baro_standard,
            Action::BaroSteps(steps) => {
                self.ui.baro_standard = false;
                // Whole units, so that the number shown is the number used; at the end of the range the knob does nothing.
                let wanted = (self.ui.baro.pressure().0 / unit_hpa).round() + f64::from(steps);
                if let Some(setting) = BaroSetting::new(Hectopascals(wanted * unit_hpa)) {
                    self.ui.baro = setting;
                }
            }
        }
    }

    /// Reads the picture last drawn: RGBA rows, top row first, of the screen's size. Waits for the GPU.
    pub fn read_rgba(&self, pixels: &mut [u8]) {
        self.target.read_rgba(pixels);
    }
}

/// How terrain is drawn within what a board allows.
#[derive(Clone, Copy, Debug)]
struct Means {
    settings: Settings,
    quota_texels: usize,
}

impl Means {
    /// # Errors
    /// When the board allows less than its number of vertices needs with this pack.
    fn of(board: &Board, pack: Option<&Pack>) -> Result<Self, Failure> {
        let wish = &board.terrain;
        let refused = |key: &str, why: String| {
            let what = format!(
                "terrain.{key}: {why} with terrain.vertices = {}",
                wish.vertices
            );
            let todo = "give more there, or fewer vertices";
            Failure::new(Kind::Usage, board.file.display(), what, todo)
        };
        let shape = Shape::new(wish.vertices)
            .ok_or_else(|| refused("vertices", "no level is drawn".to_owned()))?;
        let settings = Settings {
            shape,
            target_px: wish.target_px,
            decode_samples_per_frame: wish.decode_samples_per_frame,
            ..Settings::default()
        };
        let Some(pack) = pack else {
            let quota_texels = 0;
            return Ok(Self {
                settings,
                quota_texels,
            });
        };
        let need = Need::of(pack.info(), shape);
        let resident = (wish.resident_mib as usize) << 20;
        let settings = need
            .settings(settings, resident)
            .map_err(|TooLittle(least)| {
                let why = format!(
                    "{} is too little, {} are needed",
                    wish.resident_mib,
                    least.div_ceil(1 << 20)
                );
                refused("resident_mib", why)
            })?;
        let upload = wish.upload_bytes_per_frame as usize;
        let quota_texels = need.texels_within(upload).map_err(|TooLittle(least)| {
            refused(
                "upload_bytes_per_frame",
                format!("{upload} is too little, {least} are needed"),
            )
        })?;
        Ok(Self {
            settings,
            quota_texels,
        })
    }
}

fn config(board: &Board) -> Config {
    let marks = &board.airspeeds;
    Config {
        baro_unit: match board.pressure {
            PressureUnit::Hectopascals => BaroUnit::Hectopascals,
            PressureUnit::InchesOfMercury => BaroUnit::InchesOfMercury,
        },
        v_speeds: VSpeeds {
            vs0: marks.vs0,
            vs1: marks.vs1,
            vfe: marks.vfe,
            vno: marks.vno,
            vne: marks.vne,
        },
        hfov: board.hfov,
        source_names: std::array::from_fn(|i| {
            let named = board.sources.get(i);
            named.map_or_else(SourceName::new, |source| source_name(&source.name))
        }),
    }
}

#[derive(Debug, thiserror::Error)]
enum MakeError {
    #[error(transparent)]
    Gl(#[from] GlError),
    #[error(transparent)]
    Scenery(#[from] SceneryError),
    #[error(transparent)]
    Instruments(#[from] InstrumentsError),
}

fn gl_failed(screen: &dyn Screen, e: impl std::error::Error + Send + Sync + 'static) -> Failure {
    Failure::new(
        Kind::Device,
        screen.describe(),
        "cannot be drawn on",
        "OpenGL ES 3.0 is needed; `glasswing list` says what there is",
    )
    .caused_by(e)
}

/// Opens the screen that the board wishes for.
///
/// # Errors
/// When there is none such, or it refuses.
pub fn open_screen(board: &Board) -> Result<Box<dyn Screen>, Failure> {
    let size = (board.screen.size.width_px, board.screen.size.height_px);
    screen::open(&board.screen.kind, size).map_err(|e| fly::screen_failed(&e))
}

/// Opens a pack.
///
/// # Errors
/// When it is missing or damaged.
pub fn open_pack(path: &Path) -> Result<Pack, Failure> {
    Pack::open(path).map_err(|e| {
        let remedy = e.remedy();
        Failure::new(Kind::Input, path.display(), &e, remedy).caused_by(e)
    })
}
