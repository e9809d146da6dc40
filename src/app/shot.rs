//! `glasswing shot`: one settled picture of a pack, and the distances behind its pixels.

use crate::angle::{wrap_signed, wrap_turn};
use crate::app::cockpit;
use crate::app::error::{Failure, Kind};
use crate::app::instruments::{Instruments, InstrumentsError};
use crate::app::out::say;
use crate::app::picture::{Effort, Size, write_png};
use crate::app::vision::{Dress, Shown};
use crate::display::{Config, Model, Terrain, Ui};
use crate::geo::{Attitude, Camera, EYE_HEIGHT_M, Geodetic};
use crate::gl::globe::ALONE_FROM;
use crate::gl::look::{Look, Palette};
use crate::gl::scenery::{Scenery, SceneryError};
use crate::gl::target::Target;
use crate::gl::terrain::RANGE_CLEAR;
use crate::gl::{GlError, Gpu};
use crate::sampled::Sampled;
use crate::screen::{self, Screen};
use crate::signal::{Parameter, SourceId};
use crate::state::FlightState;
use crate::terrain::pack::Pack;
use crate::terrain::reach::TARGET_PX;
use crate::terrain::scene::{self, FrameFigures, Settings};
use crate::time::Monotonic;
use crate::units::Radians;
use serde::Serialize;
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::str::FromStr;
use std::sync::Arc;
use std::time::Duration;

/// Samples per pixel of the picture.
const SAMPLES: u32 = 4;
/// Texels a frame: the default of a board.
const QUOTA: usize = 65_536;
/// A picture that is not settled by now never will be: all levels of a pack are read in well under a second.
const SETTLE_MAX: Duration = Duration::from_secs(60);
/// How long to leave the streaming thread alone between two looks at what it has done.
const SETTLE_PAUSE: Duration = Duration::from_millis(1);
/// The flat sky of `--terrain-only`: red, green, blue, opacity.
const FLAT_SKY: [f32; 4] = [0.53, 0.72, 0.92, 1.0];

/// Draws one settled picture from a terrain pack.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example:\n  glasswing shot --pack andes.pack --eye -32.6,-70.3,4200 --attitude 215,-4,0 --hfov 60 \\\n      --size 1024x600 --out view.png --range view.pfm"
)]
pub struct ShotArgs {
    /// The terrain pack to draw
    #[arg(long, value_name = "PACK")]
    pub pack: PathBuf,
    /// Where the eye is: degrees north, degrees east, metres above the WGS 84 ellipsoid, up to 25 000 km. From 20 to 30 km
    /// the Earth in one piece takes over from the near terrain; above 30 km there are no instruments
    #[arg(long, value_name = "LAT,LON,HEIGHT", allow_hyphen_values = true)]
    pub eye: Triple,
    /// How it looks: degrees clockwise from true north, pitch up, roll right wing down
    #[arg(
        long,
        value_name = "HEADING,PITCH,ROLL",
        allow_hyphen_values = true,
        default_value = "0,0,0"
    )]
    pub attitude: Triple,
    /// Horizontal field of view in degrees; pixels are square
    #[arg(long, value_name = "DEG", default_value_t = 60.0)]
    pub hfov: f64,
    /// Size of the picture in pixels
    #[arg(long, value_name = "WxH", default_value = "1024x600")]
    pub size: Size,
    /// Where the picture goes (PNG)
    #[arg(long, value_name = "X.png")]
    pub out: PathBuf,
    /// Also write the distance in metres from the eye along each pixel-centre ray (PFM, little endian, +inf for sky)
    #[arg(long, value_name = "X.pfm")]
    pub range: Option<PathBuf>,
    /// No instruments, haze or sky gradient
    #[arg(long)]
    pub terrain_only: bool,
    /// Colour ground by its height relative to the eye: red with bars from 100 ft below it upwards, yellow from 1000 ft below
    #[arg(long)]
    pub awareness: bool,
    /// Lay lines of latitude and longitude on the ground, 1 minute to 30 degrees apart as the eye's height asks; beyond 70
    /// degrees of latitude lines of the polar grid
    #[arg(long)]
    pub grid: bool,
    /// For eyes used to daylight, or to the dark: terrain and sky a third as bright
    #[arg(long, value_enum, default_value_t = Light::Day)]
    pub palette: Light,
    /// The error that ground may have where levels of detail follow the distance, RMS, pixels: the board's terrain.target_px,
    /// 0.05 to 4. Coarser draws fewer triangles
    #[arg(long, value_name = "PX", default_value_t = scene::TARGET_PX, value_parser = parse_target)]
    pub target_px: f64,
    /// What draws
    #[arg(long, value_enum, default_value_t = Backend::Surfaceless)]
    pub backend: Backend,
    /// Print figures of the frame as JSON
    #[arg(long)]
    pub json: bool,
}

/// A target for the error.
///
/// # Errors
/// With what is asked for instead.
pub(super) fn parse_target(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|v| TARGET_PX.contains(v));
    let (least, most) = (TARGET_PX.start(), TARGET_PX.end());
    number.ok_or_else(|| format!("a number of pixels from {least} to {most} is needed"))
}

/// For which eyes a picture is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Light {
    /// Used to daylight
    Day,
    /// Used to the dark
    Night,
}

/// What a picture without a screen is drawn with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Backend {
    /// EGL without a surface
    Surfaceless,
    /// `OSMesa`, in memory
    Osmesa,
}

/// Three numbers with commas between them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triple(pub [f64; 3]);

impl FromStr for Triple {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut out = [0.0; 3];
        let mut parts = text.split(',');
        for value in &mut out {
            *value = parts
                .next()
                .and_then(|part| part.trim().parse().ok())
                .filter(|v: &f64| v.is_finite())
                .ok_or("three numbers with commas between them are needed")?;
        }
        match parts.next() {
            None => Ok(Self(out)),
            Some(more) => Err(format!("`{more}` is one number too many")),
        }
    }
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Report {
    target_px: f64,
    triangles: usize,
    draw_calls: usize,
    levels: usize,
    level_finest: Option<u8>,
    level_coarsest: Option<u8>,
    settle_frames: u32,
    settle_ms: f64,
    frame_ms: f64,
    uploads_texels: usize,
    uploads_bytes: usize,
    resident_bytes: usize,
    damaged_tiles: u32,
    /// What a display would say of this terrain; absent where there is nothing to say.
    #[serde(skip_serializing_if = "Option::is_none")]
    annunciation: Option<&'static str>,
    width: u32,
    height: u32,
    gpu: String,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`]: wrong values (2), no or a damaged pack (3), no GPU (4), a file that cannot be written (1).
pub fn run(args: ShotArgs) -> Result<(), Failure> {
    let camera = camera(&args)?;
    let pack = cockpit::open_pack(&args.pack)?;
    let pack = Arc::new(pack);
    let screen = open(args.backend, args.size)?;
    let gpu = Gpu::new(&|name| screen.gl_proc(name)).map_err(|e| gpu_failure(&e))?;
    let mut studio = Studio::new(&gpu, Arc::clone(&pack), &args).map_err(|e| gpu_failure(&e))?;
    let settled = studio.settle(&camera)?;
    studio.shown = Shown::assess(&studio.scenery, &pack, &camera, &settled.figures);
    // From where an instrument would have to say that it has no height, the view goes without.
    studio.has_instruments = model(&camera, &pack, Shown::WELL).svs.is_ok();
    studio
        .instruments
        .list(&model(&camera, &pack, studio.shown));
    let report = studio.picture(&camera, &args, settled)?;
    if args.json {
        say!("{}", serde_json::json!(report));
    }
    Ok(())
}

/// The camera of the arguments.
fn camera(args: &ShotArgs) -> Result<Camera, Failure> {
    let Triple([latitude, longitude, height]) = args.eye;
    let Triple([heading, pitch, roll]) = args.attitude;
    let wrong = |what: &str, why: &str, todo: &str| Err(Failure::new(Kind::Usage, what, why, todo));
    if latitude.abs() > 90.0 || longitude.abs() > 360.0 {
        return wrong(
            "--eye",
            "no such latitude or longitude",
            "give LAT,LON,HEIGHT with LAT from -90 to 90",
        );
    }
    if !EYE_HEIGHT_M.contains(&height) {
        return wrong(
            "--eye",
            "the height is below the sea floor or above 25 000 km",
            "give metres above the ellipsoid",
        );
    }
    let camera = Camera {
        eye: Geodetic::from_degrees(latitude, longitude, height),
        attitude: Attitude::from_degrees(heading, pitch, roll),
        hfov: Radians::from_degrees(args.hfov),
        width_px: args.size.width_px,
        height_px: args.size.height_px,
    };
    if !camera.is_valid() {
        return wrong(
            "--hfov",
            "no picture has this field of view",
            "give 1 to 170 degrees",
        );
    }
    Ok(camera)
}

/// What the instruments show over the picture: position and attitude are known, nothing else is.
fn model(camera: &Camera, pack: &Pack, shown: Shown) -> Model {
    let now = Monotonic::read();
    let (eye, attitude) = (camera.eye, camera.attitude);
    let mut state = FlightState::empty();
    let mut know = |parameter: Parameter, value: f64| {
        state.set(
            parameter,
            Sampled::from_result(parameter.check(value), now),
            SourceId(0),
        );
    };
    know(Parameter::Pitch, attitude.pitch.0);
    know(Parameter::Roll, wrap_signed(attitude.roll).0);
    know(Parameter::HeadingTrue, wrap_turn(attitude.heading_true).0);
    know(Parameter::Latitude, eye.latitude.0);
    know(Parameter::Longitude, wrap_signed(eye.longitude).0);
    know(Parameter::HeightEllipsoid, eye.height_ellipsoid.0);
    if let Some(undulation_m) = pack.geoid().undulation_m(eye.latitude, eye.longitude) {
        know(
            Parameter::AltitudeMsl,
            eye.height_ellipsoid.0 - undulation_m,
        );
    }
    let ui = Ui {
        terrain: shown.terrain,
        terrain_caution: shown.caution,
        ..Ui::default()
    };
    let config = Config {
        hfov: camera.hfov,
        ..Config::default()
    };
    Model::build(&state, &ui, &config, now)
}

/// A screen that shows nothing.
///
/// # Errors
/// When it does not open (4).
pub(super) fn open(backend: Backend, size: Size) -> Result<Box<dyn Screen>, Failure> {
    let screen: Result<Box<dyn Screen>, _> = match backend {
        Backend::Surfaceless => {
            screen::surfaceless::open(size.width_px, size.height_px).map(|s| Box::new(s) as _)
        }
        Backend::Osmesa => {
            screen::osmesa::open(size.width_px, size.height_px).map(|s| Box::new(s) as _)
        }
    };
    screen.map_err(|e| {
        Failure::new(Kind::Device, e.device().to_owned(), e.why(), e.remedy()).caused_by(e)
    })
}

fn gpu_failure(e: &dyn std::error::Error) -> Failure {
    Failure::new(
        Kind::Device,
        "the GPU",
        e,
        "check the driver with `glasswing list`",
    )
}

/// How settling went.
#[derive(Clone, Copy, Debug)]
struct Settled {
    figures: FrameFigures,
    frames: u32,
    after: Duration,
    uploads_texels: usize,
    uploads_bytes: usize,
}

/// Everything that a picture is drawn with.
#[derive(Debug)]
struct Studio {
    gpu: Rc<Gpu>,
    scenery: Scenery,
    instruments: Instruments,
    has_instruments: bool,
    shown: Shown,
    target: Target,
    size: Size,
}

#[derive(Debug, thiserror::Error)]
enum StudioError {
    #[error(transparent)]
    Gl(#[from] GlError),
    #[error(transparent)]
    Scenery(#[from] SceneryError),
    #[error(transparent)]
    Instruments(#[from] InstrumentsError),
}

impl Studio {
    fn new(gpu: &Rc<Gpu>, pack: Arc<Pack>, args: &ShotArgs) -> Result<Self, StudioError> {
        let size = args.size;
        let settings = Settings {
            target_px: args.target_px,
            ..Settings::default()
        };
        Ok(Self {
            gpu: Rc::clone(gpu),
            scenery: Scenery::new(gpu, settings, pack)?,
            instruments: Instruments::new(gpu, size)?,
            has_instruments: true,
            shown: Shown::WELL,
            target: Target::offscreen(gpu, size.width_px, size.height_px, SAMPLES)?,
            size,
        })
    }

    /// Streams until every wanted level is resident.
    fn settle(&mut self, camera: &Camera) -> Result<Settled, Failure> {
        let begun = Monotonic::read();
        let (mut frames, mut uploads_texels, mut uploads_bytes) = (0, 0, 0);
        loop {
            let now = Monotonic::read();
            let figures = self.scenery.prepare(camera, now, QUOTA).map_err(|e| {
                Failure::new(Kind::Usage, "--eye", e, "give finite numbers in range")
            })?;
            frames += 1;
            uploads_texels += figures.uploads_texels;
            uploads_bytes += figures.uploads_bytes;
            let after = Monotonic::read().since(begun).unwrap_or_default();
            if figures.settled {
                return Ok(Settled {
                    figures,
                    frames,
                    after,
                    uploads_texels,
                    uploads_bytes,
                });
            }
            if after > SETTLE_MAX {
                return Err(Failure::new(
                    Kind::Input,
                    "the terrain",
                    format!(
                        "levels {:?} are wanted, but only {:?} are resident after {} s",
                        figures.levels_wanted,
                        figures.levels,
                        SETTLE_MAX.as_secs()
                    ),
                    "check the pack with `glasswing terrain verify`, and the disk it is on",
                ));
            }
            std::thread::park_timeout(SETTLE_PAUSE);
        }
    }

    fn picture(
        &mut self,
        camera: &Camera,
        args: &ShotArgs,
        settled: Settled,
    ) -> Result<Report, Failure> {
        self.draw(camera, args);
        self.gpu.finish();
        let begun = Monotonic::read();
        let draw_calls = self.draw(camera, args);
        self.gpu.finish();
        let frame = Monotonic::read().since(begun).unwrap_or_default();
        let mut pixels = vec![0; self.size.width_px as usize * self.size.height_px as usize * 4];
        self.target.read_rgba(&mut pixels);
        write_png(
            &args.out,
            self.size,
            &pixels,
            Effort::Small,
            &mut Vec::new(),
        )?;
        if let Some(path) = &args.range {
            let ranges = self.ranges(camera).map_err(|e| gpu_failure(&e))?;
            write_pfm(path, self.size, &ranges)?;
        }
        self.gpu
            .check("while drawing the picture")
            .map_err(|e| gpu_failure(&e))?;
        let figures = settled.figures;
        let damage = figures.damage;
        Ok(Report {
            target_px: args.target_px,
            triangles: figures.triangles,
            draw_calls,
            levels: figures
                .levels
                .map_or(0, |(finest, coarsest)| usize::from(coarsest - finest) + 1),
            level_finest: figures.levels.map(|l| l.0),
            level_coarsest: figures.levels.map(|l| l.1),
            settle_frames: settled.frames,
            settle_ms: settled.after.as_secs_f64() * 1e3,
            frame_ms: frame.as_secs_f64() * 1e3,
            uploads_texels: settled.uploads_texels,
            uploads_bytes: settled.uploads_bytes,
            resident_bytes: figures.resident_bytes,
            damaged_tiles: damage.checksum + damage.content + damage.reading,
            annunciation: self.shown.label(),
            width: self.size.width_px,
            height: self.size.height_px,
            gpu: self.gpu.caps().renderer.clone(),
        })
    }

    /// Draws what has been settled. Returns the draw calls.
    fn draw(&mut self, camera: &Camera, args: &ShotArgs) -> usize {
        self.target.bind();
        self.gpu.clear(FLAT_SKY);
        let dress = Dress {
            awareness: args.awareness,
            grid: args.grid,
            palette: match args.palette {
                Light::Day => Palette::Day,
                Light::Night => Palette::Night,
            },
        };
        let mut look = dress.look(camera, None);
        if args.terrain_only {
            look.haze_m = Look::BARE.haze_m;
            return self.scenery.draw(camera, &look, false);
        }
        // As in flight: where terrain may not be shown, the instruments bring the plain horizon.
        let mut draw_calls = 0;
        if self.shown.terrain == Terrain::Ready || !self.has_instruments {
            draw_calls += self.scenery.draw(camera, &look, true);
        }
        if self.has_instruments {
            self.instruments.draw();
            draw_calls += 1;
        }
        draw_calls
    }

    /// Distances from the eye, metres, rows from the top; +infinity for sky; of the one partition that a settled picture has. Where the Earth is in one piece these are of
    /// the ellipsoid.
    #[expect(clippy::cast_possible_truncation, reason = "a PFM holds f32")]
    fn ranges(&self, camera: &Camera) -> Result<Vec<f32>, GlError> {
        if camera.eye.height_ellipsoid >= ALONE_FROM {
            let rows = (0..self.size.height_px).flat_map(|y| {
                (0..self.size.width_px).map(move |x| (f64::from(x) + 0.5, f64::from(y) + 0.5))
            });
            let range = |(x, y)| camera.ellipsoid_range_m(x, y).unwrap_or(f64::INFINITY) as f32;
            return Ok(rows.map(range).collect());
        }
        let target = Target::offscreen(&self.gpu, self.size.width_px, self.size.height_px, 0)?;
        target.bind();
        self.gpu.clear(RANGE_CLEAR);
        self.scenery.terrain().draw_range();
        let mut bytes = vec![0; self.size.width_px as usize * self.size.height_px as usize * 4];
        target.read_rgba(&mut bytes);
        Ok(bytes
            .chunks_exact(4)
            .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
            .collect())
    }
}

fn file_failure(path: &Path, e: impl std::error::Error + Send + Sync + 'static) -> Failure {
    Failure::new(
        Kind::Other,
        path.display(),
        "it cannot be written",
        "check the folder, its rights and the room on the disk",
    )
    .caused_by(e)
}

/// Writes one channel as a PFM: little endian (negative scale), rows from the bottom (P. Debevec's format, as Netpbm's
/// pfm(5) describes it).
fn write_pfm(path: &Path, size: Size, rows_from_top: &[f32]) -> Result<(), Failure> {
    let write = || -> std::io::Result<()> {
        let mut file = BufWriter::new(File::create(path)?);
        write!(file, "Pf\n{} {}\n-1.0\n", size.width_px, size.height_px)?;
        for row in rows_from_top.chunks_exact(size.width_px as usize).rev() {
            for value in row {
                file.write_all(&value.to_le_bytes())?;
            }
        }
        file.flush()
    };
    write().map_err(|e| file_failure(path, e))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Cli {
        #[command(flatten)]
        shot: ShotArgs,
    }

    fn parse(extra: &[&str]) -> Result<ShotArgs, clap::Error> {
        let base = ["x", "--pack", "a.pack", "--out", "a.png"];
        Cli::try_parse_from(base.iter().chain(extra)).map(|c| c.shot)
    }

    #[test]
    fn a_southern_eye_may_begin_with_a_minus() {
        let args = parse(&["--eye", "-32.6,-70.3,4200", "--attitude", "-5,-4,0"]).expect("parses");
        assert_eq!(args.eye, Triple([-32.6, -70.3, 4200.0]));
        let camera = camera(&args).expect("a camera");
        assert!(
            (camera.eye.latitude.to_degrees() + 32.6).abs() < 1e-12,
            "south"
        );
    }

    #[test]
    fn wrong_values_are_refused_with_a_reason() {
        for eye in ["1,2", "1,2,3,4", "a,2,3", "nan,0,0"] {
            assert!(parse(&["--eye", eye]).is_err(), "{eye}");
        }
        for size in ["1024", "0x10", "1024x600x2", "99999x2"] {
            assert!(
                parse(&["--eye", "0,0,0", "--size", size]).is_err(),
                "{size}"
            );
        }
        for extra in [
            &["--eye", "91,0,0"][..],
            &["--eye", "0,0,0", "--hfov", "179"],
            &["--eye", "0,0,-99999"],
        ] {
            let args = parse(extra).expect("parses");
            let failure = camera(&args).expect_err("refused");
            assert_eq!(failure.kind(), Kind::Usage, "{extra:?}");
        }
    }

    #[test]
    fn a_pfm_is_written_from_the_bottom() {
        let path = std::env::temp_dir().join(format!("glasswing-{}.pfm", std::process::id()));
        write_pfm(
            &path,
            Size {
                width_px: 2,
                height_px: 2,
            },
            &[1.0, 2.0, 3.0, f32::INFINITY],
        )
        .expect("written");
        let bytes = std::fs::read(&path).expect("read");
        std::fs::remove_file(&path).expect("removed");
        let header = b"Pf\n2 2\n-1.0\n";
        assert_eq!(&bytes[..header.len()], header);
        assert_eq!(
            &bytes[header.len()..header.len() + 4],
            3.0_f32.to_le_bytes()
        );
        assert_eq!(bytes.len(), header.len() + 16);
    }
}
