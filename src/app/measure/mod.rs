//! `glasswing measure`: figures of terrain and buses, each with how it was obtained.
#![expect(clippy::print_stderr, reason = "the command's notes")]

pub mod accuracy;
pub mod bench;
pub mod codec;
mod codec_report;
pub mod drawn;
pub mod flight;
pub mod flights;
pub mod latency;
pub mod plot;
pub mod poses;
pub mod position;
pub mod sheet;
pub mod speed;
pub mod stream_flights;
pub mod streaming;
pub mod surface;
pub mod table;
pub mod talk;
pub mod throttle;
pub mod watertight;

use crate::app::cockpit;
use crate::app::error::{Failure, Kind};
use crate::app::out;
use crate::app::picture::Size;
use crate::app::shot::{self, Backend};
use crate::geo::Camera;
use crate::gl::Gpu;
use crate::terrain::clipmap::Shape;
use crate::terrain::pack::Pack;
use crate::terrain::scene::{self, Settings};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;

/// What is measured.
#[derive(Debug, clap::Subcommand)]
pub enum MeasureCommand {
    /// How exact the picture is: positions, surface, skyline, summits, holes, popping, normals.
    ///
    /// Reads the terrain's own vertex shader back and compares it with geodesy in 64 bits; casts rays through the finest
    /// posts; looks for holes in random views and at every hard case. A planet in memory serves where no pack is given.
    #[command(
        after_help = "Example:\n  glasswing measure accuracy --pack andes.pack --json accuracy.json"
    )]
    Accuracy(AccuracyArgs),
    /// How fast it is drawn: frame times, work, triangles, and the error that they buy, for several sizes of level.
    #[command(after_help = "Example:\n  glasswing measure speed --pack andes.pack --plot plots")]
    Speed(SpeedArgs),
    /// How small terrain becomes, how far it is from what it was, and how fast it is packed and unpacked.
    ///
    /// For every input the lossless codec, and the pyramid at every bound: bits a sample, largest and RMS error, samples a
    /// second. A planet in memory serves where no input is given.
    #[command(
        after_help = "Example:\n  glasswing measure codec N50E014.hgt S33W071.tif --plot plots"
    )]
    Codec(codec::CodecArgs),
    /// Whether terrain keeps up with an eye that flies, turns and leaps, and what that costs a frame.
    ///
    /// Three flights: 300 km/h at 100 m, 900 km/h at 3 km with turns, a leap every 5 s; each from the pack as it is, throttled to
    /// 10 MB/s and to 1 MB/s, and with random stalls of 200 ms. Then an hour of flight without pictures, for memory.
    #[command(
        after_help = "Example:\n  glasswing measure streaming --pack andes.pack --json streaming.json"
    )]
    Streaming(StreamingArgs),
    /// How long a value takes from its receipt to the screen, by source and group, and what a full bus costs.
    ///
    /// Through real sockets, a pseudoterminal, vcan0 where that is up, the real threads and a headless screen.
    #[command(after_help = "Example:\n  glasswing measure latency --json latency.json")]
    Latency(latency::LatencyArgs),
}

/// What is measured and where to, for all that is drawn.
#[derive(Debug, clap::Args)]
pub struct FileArgs {
    /// Measure this terrain pack too
    #[arg(long, value_name = "PACK")]
    pack: Option<PathBuf>,
    /// Write all figures to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write plots (SVG), and contact sheets of flights (PNG), into this folder
    #[arg(long, value_name = "DIR")]
    plot: Option<PathBuf>,
    /// What draws
    #[arg(long, value_enum, default_value_t = Backend::Surfaceless)]
    backend: Backend,
}

/// What the measurements of pictures take.
#[derive(Debug, clap::Args)]
pub struct CommonArgs {
    #[command(flatten)]
    files: FileArgs,
    /// Measure this view too: degrees north and east, metres above the ellipsoid, heading and pitch in degrees; 1024x600
    /// pixels, 60 degrees across. May be given several times
    #[arg(long, value_name = "LAT,LON,HEIGHT,HEADING,PITCH", value_parser = parse_view, allow_hyphen_values = true)]
    view: Vec<Camera>,
    /// How far from the eye the truth reaches: rays are cast through the finest posts within this, kilometres
    #[arg(long, value_name = "KM", default_value_t = 130.0, value_parser = parse_positive)]
    reach: f64,
}

impl CommonArgs {
    fn reach_m(&self) -> f64 {
        self.reach.clamp(1.0, 300.0) * 1000.0
    }
}

/// Arguments of `measure accuracy`.
#[derive(Debug, clap::Args)]
pub struct AccuracyArgs {
    #[command(flatten)]
    common: CommonArgs,
    /// Random views that are looked at for holes
    #[arg(long, value_name = "N", default_value_t = 10_000)]
    poses: usize,
    /// Number of the first of them: to look at one again, or to share them out
    #[arg(long, value_name = "N", default_value_t = 0)]
    first_pose: usize,
    /// Measure this part only
    #[arg(long, value_enum)]
    only: Option<accuracy::Part>,
    /// Seconds of each flight that is watched for holes, popping and swimming
    #[arg(long, value_name = "S", default_value_t = 20.0, value_parser = parse_positive)]
    seconds: f64,
    /// Vertices along a side of a level
    #[arg(long, value_name = "N", value_parser = parse_shape)]
    vertices: Option<Shape>,
    /// The error that ground may have where levels of detail follow the distance, RMS, pixels: a board's terrain.target_px
    #[arg(long, value_name = "PX", default_value_t = scene::TARGET_PX, value_parser = shot::parse_target)]
    target_px: f64,
}

/// Arguments of `measure speed`.
#[derive(Debug, clap::Args)]
pub struct SpeedArgs {
    #[command(flatten)]
    common: CommonArgs,
    /// Frames of each measurement
    #[arg(long, value_name = "N", default_value_t = 240)]
    frames: u32,
    /// Vertices along a side of a level; may be given several times
    #[arg(long, value_name = "N", value_parser = parse_shape)]
    vertices: Vec<Shape>,
    /// The error that ground may have where levels of detail follow the distance, RMS, pixels: a board's terrain.target_px
    #[arg(long, value_name = "PX", default_value_t = scene::TARGET_PX, value_parser = shot::parse_target)]
    target_px: f64,
}

/// Arguments of `measure streaming`.
#[derive(Debug, clap::Args)]
pub struct StreamingArgs {
    #[command(flatten)]
    files: FileArgs,
    /// Seconds of each flight
    #[arg(long, value_name = "S", default_value_t = 20.0, value_parser = parse_positive)]
    seconds: f64,
    /// Hours of the flight without pictures; 0: none
    #[arg(long, value_name = "H", default_value_t = 1.0, value_parser = parse_hours)]
    hours: f64,
    /// Vertices along a side of a level
    #[arg(long, value_name = "N", default_value = "255", value_parser = parse_shape)]
    vertices: Shape,
    /// The error that ground may have where levels of detail follow the distance, RMS, pixels: a board's terrain.target_px
    #[arg(long, value_name = "PX", default_value_t = scene::TARGET_PX, value_parser = shot::parse_target)]
    target_px: f64,
}

fn parse_hours(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|v: &f64| (0.0..=24.0).contains(v));
    number.ok_or_else(|| "a number from 0 to 24 is needed".to_owned())
}

fn parse_positive(text: &str) -> Result<f64, String> {
    let number = text
        .parse()
        .ok()
        .filter(|v: &f64| v.is_finite() && *v > 0.0);
    number.ok_or_else(|| "a number above 0 is needed".to_owned())
}

fn parse_view(text: &str) -> Result<Camera, String> {
    let numbers: Vec<f64> = text
        .split(',')
        .filter_map(|v| v.trim().parse().ok())
        .collect();
    let camera = match numbers[..] {
        [lat, lon, height_m, heading, pitch] if text.split(',').count() == 5 => {
            Some(bench::camera(
                (lat, lon, height_m),
                (heading, pitch, 0.0),
                60.0,
                (1024, 600),
            ))
        }
        _ => None,
    };
    camera.filter(Camera::is_valid).ok_or_else(|| {
        "five numbers with commas between them are needed, as in 46.3,8.3,2600,120,-4".to_owned()
    })
}

fn parse_shape(text: &str) -> Result<Shape, String> {
    let shape = text.parse().ok().and_then(Shape::new);
    shape.ok_or_else(|| {
        "one less than a multiple of 16 is needed, 63 to 447, as in 127 or 255".to_owned()
    })
}

/// Runs the command.
///
/// # Errors
/// [`Failure`]: no or a damaged pack (3), no GPU (4), a file that cannot be written (1).
pub fn run(command: MeasureCommand) -> Result<(), Failure> {
    match command {
        MeasureCommand::Latency(args) => latency::run(&args),
        MeasureCommand::Codec(args) => codec::run(&args),
        MeasureCommand::Accuracy(args) => {
            let effort = accuracy::Effort {
                only: args.only,
                poses: args.poses,
                first_pose: args.first_pose,
                seconds: args.seconds.clamp(0.1, 600.0),
                reach_m: args.common.reach_m(),
                views: args.common.view.clone(),
                sheets: args.common.files.plot.clone(),
            };
            let settings = Settings {
                target_px: args.target_px,
                ..args.vertices.unwrap_or(Shape::DEFAULT).into()
            };
            measured(
                &args.common.files,
                |gpu, pack, progress| accuracy::run(gpu, pack, settings, &effort, progress),
                |value| (table::accuracy(value), plot::accuracy(value)),
            )
        }
        MeasureCommand::Speed(args) => measured(
            &args.common.files,
            |gpu, pack, progress| {
                let effort = speed::Effort {
                    frames: args.frames.max(2),
                    reach_m: args.common.reach_m(),
                    views: args.common.view.clone(),
                };
                speed::run(gpu, pack, &args.vertices, args.target_px, &effort, progress)
            },
            |value| (table::speed(value), plot::speed(value)),
        ),
        MeasureCommand::Streaming(args) => measured(
            &args.files,
            |gpu, pack, progress| {
                let effort = streaming::Effort {
                    seconds: args.seconds.clamp(0.1, 3600.0),
                    hours: args.hours,
                };
                let settings = Settings {
                    target_px: args.target_px,
                    ..Settings::from(args.vertices)
                };
                streaming::run(gpu, pack, settings, effort, progress)
            },
            |value| (table::streaming(value), plot::streaming(value)),
        ),
    }
}

/// A plot: its file's name and its text.
pub type Plot = (&'static str, String);

/// Opens what is measured, measures it, and writes table, document and plots.
fn measured(
    args: &FileArgs,
    measure: impl FnOnce(&Rc<Gpu>, Option<&Arc<Pack>>, &Progress) -> Result<Value, Failure>,
    show: impl FnOnce(&Value) -> (String, Vec<Plot>),
) -> Result<(), Failure> {
    let pack = args
        .pack
        .as_deref()
        .map(cockpit::open_pack)
        .transpose()?
        .map(Arc::new);
    for path in [&args.json, &args.plot].into_iter().flatten() {
        prepare(path, Some(path) == args.plot.as_ref())?;
    }
    let size = Size {
        width_px: 64,
        height_px: 64,
    };
    let screen = shot::open(args.backend, size)?;
    let gpu = Gpu::new(&|name| screen.gl_proc(name)).map_err(|e| bench::refused(&e))?;
    let progress = Progress::new();
    let mut value = measure(&gpu, pack.as_ref(), &progress)?;
    progress.bar.finish_and_clear();
    value["pack"] = args
        .pack
        .as_ref()
        .map_or(Value::Null, |p| p.display().to_string().into());
    value["optimised"] = (!cfg!(debug_assertions)).into();
    let (text, plots) = show(&value);
    out::write(format_args!("{text}"));
    if let Some(path) = &args.json {
        write(path, &format!("{value:#}\n"))?;
    }
    if let Some(folder) = &args.plot {
        for (name, svg) in plots {
            write(&folder.join(name), &svg)?;
        }
    }
    Ok(())
}

/// Makes a folder, or sees that a file can be written: before minutes of measuring, not after.
fn prepare(path: &Path, is_folder: bool) -> Result<(), Failure> {
    if is_folder {
        std::fs::create_dir_all(path).map_err(|e| not_written(path, e))
    } else {
        let opened = std::fs::OpenOptions::new()
            .append(true)
            .create(true)
            .open(path);
        opened.map(drop).map_err(|e| not_written(path, e))
    }
}

fn write(path: &Path, text: &str) -> Result<(), Failure> {
    std::fs::write(path, text).map_err(|e| not_written(path, e))
}

fn not_written(path: &Path, e: std::io::Error) -> Failure {
    let todo = "check the folder, its rights and the room on the disk";
    Failure::new(Kind::Other, path.display(), "it cannot be written", todo).caused_by(e)
}

/// A progress bar on stderr where that is a terminal.
#[derive(Debug)]
pub struct Progress {
    bar: ProgressBar,
}

impl Progress {
    /// At its beginning.
    #[must_use]
    fn new() -> Self {
        let style =
            ProgressStyle::with_template("{wide_bar} {msg} {pos} of {len}, {per_sec}, {eta} left");
        Self {
            bar: ProgressBar::new(0)
                .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar())),
        }
    }

    /// One that shows nothing.
    #[must_use]
    pub fn hidden() -> Self {
        Self {
            bar: ProgressBar::hidden(),
        }
    }

    /// Says something that stays.
    pub fn note(&self, what: &str) {
        self.bar.suspend(|| eprintln!("{what}"));
    }

    /// Says what is being done.
    pub fn say(&self, what: &str) {
        self.bar.set_message(what.to_owned());
    }

    /// Says how far it is.
    pub fn at(&self, what: &str, done: usize, all: usize) {
        self.bar.set_length(all as u64);
        self.bar.set_position(done as u64);
        self.say(what);
    }
}
