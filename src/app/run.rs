//! `glasswing run`: flies with a board file until told to stop.

use crate::app::board::Board;
use crate::app::cockpit::{self, Cockpit};
use crate::app::error::{Failure, Kind};
use crate::app::fly::{self, Every, Plan};
use crate::app::frames::FrameWriter;
use crate::app::health::{Health, Pulse};
use crate::app::intake::Intake;
use crate::app::links::Links;
use crate::app::picture::Size;
use crate::app::record;
use crate::app::sources::{self, Watch};
use crate::bus::input::{InputEvent, InputThread};
use crate::bus::{self, SourceThread};
use crate::recording::{self, Recorder, Report, Tap};
use crate::screen::Screen;
use crate::time::Monotonic;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// The board file of an installed cockpit.
const BOARD: &str = "/etc/glasswing/board.toml";

/// Flies: draws terrain and instruments until told to stop
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Frames: --frames-dir writes frame-NNNNNN.png and frames.csv, the state that each picture shows.\n\n\
    Example:\n  glasswing run --board boards/headless.toml --pack bohemia.pack --frames-dir frames --seconds 60"
)]
pub struct RunArgs {
    /// The board file: screen, sources, terrain
    #[arg(long, value_name = "FILE", default_value = BOARD)]
    board: PathBuf,
    /// Terrain, instead of the board file's
    #[arg(long, value_name = "PACK")]
    pack: Option<PathBuf>,
    /// End after this many seconds
    #[arg(long, value_name = "S", value_parser = seconds)]
    seconds: Option<Duration>,
    /// Write frames as PNG, and the state they show as frames.csv, into this folder (headless screens)
    #[arg(long, value_name = "DIR")]
    frames_dir: Option<PathBuf>,
    /// Write every N-th frame only
    #[arg(long, value_name = "N", default_value_t = 1, requires = "frames_dir",
          value_parser = clap::value_parser!(u64).range(1..))]
    every: u64,
    /// Write the run's figures as JSON on exit
    #[arg(long, value_name = "FILE")]
    stats: Option<PathBuf>,
    /// Record what the sources hear, for `glasswing replay`
    #[arg(long, value_name = "RECORDING")]
    record: Option<PathBuf>,
    /// The most that the recording may take on the disk, as in 500M or 2G; its oldest part makes way
    #[arg(long, value_name = "SIZE", value_parser = record::size, requires = "record")]
    size_limit: Option<u64>,
}

impl Default for RunArgs {
    fn default() -> Self {
        Self {
            board: BOARD.into(),
            pack: None,
            seconds: None,
            frames_dir: None,
            every: 1,
            stats: None,
            record: None,
            size_limit: None,
        }
    }
}

/// A number of seconds on the command line.
///
/// # Errors
/// Unless it is a number from 0 (not included) to a year.
pub fn seconds(text: &str) -> Result<Duration, String> {
    text.parse::<f64>()
        .ok()
        .filter(|s| *s > 0.0 && *s < 3.2e7)
        .map(Duration::from_secs_f64)
        .ok_or_else(|| "give seconds, as in 60 or 0.5".to_owned())
}

/// Runs the command.
///
/// # Errors
/// Everything that is wrong with the board file; or the first device, pack or file that refuses.
pub fn run(args: RunArgs) -> Result<(), Vec<Failure>> {
    let started = Monotonic::read();
    let board = Board::load(&args.board)?;
    fly_board(&board, args, started).map_err(|f| vec![f])
}

fn fly_board(board: &Board, args: RunArgs, started: Monotonic) -> Result<(), Failure> {
    let stop = stop_on_signals()?;
    let pack = args.pack.as_ref().or(board.terrain.pack.as_ref());
    let pack = pack.map(|p| cockpit::open_pack(p)).transpose()?;
    // Sources first: they refuse soonest, and what they hear until the screen is open is not lost.
    let (recorder, taps) = recorder(board, &args)?;
    let (mut intake, sources) = listen(board, taps)?;
    let mut screen = cockpit::open_screen(board)?;
    let mut cockpit = Cockpit::new(screen.as_ref(), board, pack)?;
    tracing::info!("{} on {}", cockpit.describe(), screen.describe());
    let frames = frame_writer(&args, screen.as_ref(), started)?;
    let (mut actions, _input) = listen_to_pilot(board);
    let pulse = Arc::new(Pulse::default());
    let mut watch = Watch::new(&sources);
    let mut links = Links::new(&sources, Monotonic::read());
    let mut recording = recorder.as_ref().map(RecordingWatch::new);
    let health = Health::start(Arc::clone(&pulse), move || {
        watch.look();
        recording.iter_mut().for_each(RecordingWatch::look);
    })
    .map_err(Failure::no_thread)?;
    let plan = Plan {
        stop,
        duration: args.seconds,
        headless_period: Duration::from_secs(1) / board.screen.rate_hz,
        frames,
        pulse,
        started,
    };
    let figures = fly::fly(
        screen.as_mut(),
        &mut cockpit,
        plan,
        |cockpit| {
            while let Some(event) = actions.as_mut().and_then(|ring| ring.pop().ok()) {
                cockpit.act(event.action);
            }
            cockpit.ui.links = links.look(Monotonic::read());
        },
        |now| intake.step(now),
    )?;
    drop(health);
    let mut stats = with_sources(figures.to_json(), &sources);
    drop(sources);
    if let Some(recorder) = recorder {
        stats["recording"] = record::to_json(&recorder.finish());
    }
    if let Some(file) = &args.stats {
        write_json(file, &stats)?;
    }
    Ok(())
}

/// A flag that SIGINT and SIGTERM set.
///
/// # Errors
/// When the system refuses the handlers.
pub fn stop_on_signals() -> Result<Arc<AtomicBool>, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).map_err(|e| {
            Failure::new(Kind::Other, "signals", "cannot be handled", "report this").caused_by(e)
        })?;
    }
    Ok(stop)
}

/// The flight recorder, with a tap for each source.
fn recorder(board: &Board, args: &RunArgs) -> Result<(Option<Recorder>, Vec<Tap>), Failure> {
    let Some(path) = args.record.clone() else {
        return Ok((None, Vec::new()));
    };
    let (recorder, taps) = Recorder::start(recording::Plan {
        path,
        size_limit: args.size_limit,
        header: record::header(board, false),
    })?;
    Ok((Some(recorder), taps))
}

/// Says in the log when the recording cannot be written, and when it can again.
struct RecordingWatch {
    report: Box<dyn Fn() -> Report + Send>,
    failing: bool,
}

impl RecordingWatch {
    fn new(recorder: &Recorder) -> Self {
        Self {
            report: Box::new(recorder.reporter()),
            failing: false,
        }
    }

    fn look(&mut self) {
        let failing = (self.report)().failing;
        match (&failing, self.failing) {
            (Some(e), false) => {
                tracing::warn!("the recording cannot be written: {e} (make room on the disk)");
            }
            (None, true) => tracing::warn!("the recording can be written again"),
            _ => {}
        }
        self.failing = failing.is_some();
    }
}

/// Starts listening to every source of the board, the first the most trusted. One that is not there is waited for.
fn listen(board: &Board, taps: Vec<Tap>) -> Result<(Intake, Vec<SourceThread>), Failure> {
    let mut taps = taps.into_iter();
    let mut rings = Vec::new();
    let mut reports = Vec::new();
    let mut threads = Vec::new();
    for (i, source) in board.sources.iter().enumerate() {
        let handle = sources::listen_or_wait(board, i, source, taps.next())?;
        rings.push(handle.signals);
        reports.push(handle.reports);
        threads.push(handle.thread);
    }
    let protocols = board.sources.iter().map(|wish| wish.protocol);
    let intake = Intake::new(rings, sources::fusion(protocols)).with_reports(reports);
    Ok((intake, threads))
}

type Actions = Option<rtrb::Consumer<InputEvent>>;

/// Knobs and keys; a cockpit without them flies on, with a word in the log.
fn listen_to_pilot(board: &Board) -> (Actions, Option<InputThread>) {
    if !board.input {
        return (None, None);
    }
    match bus::input::spawn() {
        Ok((ring, thread)) => (Some(ring), Some(thread)),
        Err(e) => {
            tracing::warn!("no knobs and keys: {e}");
            (None, None)
        }
    }
}

fn frame_writer(
    args: &RunArgs,
    screen: &dyn Screen,
    started: Monotonic,
) -> Result<Option<(FrameWriter, Every)>, Failure> {
    let Some(folder) = &args.frames_dir else {
        return Ok(None);
    };
    let (width_px, height_px) = screen.size_px();
    let writer = FrameWriter::start(
        folder,
        Size {
            width_px,
            height_px,
        },
        started,
    )?;
    Ok(Some((writer, Every::Nth(args.every))))
}

/// The figures of a run with those of its sources.
#[must_use]
pub fn with_sources(mut figures: Value, threads: &[SourceThread]) -> Value {
    let mut ways = figures["receive_to_present_ms"].take();
    let row = |source: &SourceThread| {
        let mut row = sources::to_json(source);
        row["receive_to_present_ms"] = ways[usize::from(source.id().0)].take();
        row
    };
    figures["sources"] = threads.iter().map(row).collect();
    if let Some(figures) = figures.as_object_mut() {
        figures.remove("receive_to_present_ms");
    }
    figures
}

/// Writes a JSON document to a file.
///
/// # Errors
/// When the file cannot be written; names it.
pub fn write_json(file: &Path, document: &Value) -> Result<(), Failure> {
    std::fs::write(file, format!("{document:#}\n")).map_err(|e| {
        Failure::new(
            Kind::Other,
            file.display(),
            "cannot be written",
            "check folder and room",
        )
        .caused_by(e)
    })
}
