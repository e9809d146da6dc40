//! `glasswing replay`: a recording through decoders, fusion, display and renderer, on the recording's clock.
//!
//! There is no real time in it: frames stand at the board's rate from the first frame of data on, each has taken in exactly
//! what was received until then, and terrain is waited for. So the states and the pictures of a recording are the same every
//! time, bit by bit, on one machine and driver.

#![expect(clippy::print_stderr, reason = "the command's notes on the recording")]

use crate::app::board::Board;
use crate::app::cockpit::{self, Cockpit};
use crate::app::decode::protocol_parser;
use crate::app::error::{Failure, Kind};
use crate::app::frames::{FrameRow, FrameWriter};
use crate::app::out::say;
use crate::app::picture::Size;
use crate::app::playback::{Played, Player, Reel, START};
use crate::proto::Protocol;
use crate::screen::{self, Screen};
use crate::signal::Parameter;
use crate::state::FlightState;
use crate::time::Monotonic;
use sha2::{Digest as _, Sha256};
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Terrain that is not all there by now never will be.
const SETTLE_MAX: Duration = Duration::from_secs(60);

/// Replays a recording: the same states and pictures every time
///
/// RECORDING is one of `glasswing record` (all files of its set are replayed as one), a candump log, a UDP capture container,
/// or the raw bytes of a serial line. A recording of our own brings its sources with it; a capture is heard by the source of
/// the board file that can have sent it, or by the one that --as names. Frames stand at the board's rate on the recording's
/// clock, as many as it lasts; nothing waits for real time. Raw bytes have no times: they are played as their line at its
/// speed brings them without a pause.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "--hash prints, for each frame, the SHA-256 of its picture (RGBA bytes, rows from the top) and its name.\n\
    --state writes a row for each frame and parameter: frame, time_s (since the first frame of data), clock_s (the recording's \
    own clock), parameter, value (empty where none may be shown), unit, source (`derived` where worked out from others), age_s, \
    why (why it is not shown).\n\n\
    Example:\n  glasswing replay flight.gwr --board boards/headless.toml --pack bohemia.pack --hash\n  \
    glasswing replay candump.log --as canaerospace --board boards/headless.toml --state state.csv"
)]
pub struct ReplayArgs {
    /// The recording
    #[arg(value_name = "RECORDING")]
    recording: PathBuf,
    /// What a capture speaks
    #[arg(long = "as", value_name = "PROTOCOL", value_parser = protocol_parser())]
    protocol: Option<Protocol>,
    /// Speed of the line that raw bytes came over, instead of the board's, bits per second
    #[arg(long, value_name = "BAUD", value_parser = clap::value_parser!(u32).range(50..=12_000_000))]
    baud: Option<u32>,
    /// The board file: picture, rate, sources of captures
    #[arg(long, value_name = "FILE", default_value = "/etc/glasswing/board.toml")]
    board: PathBuf,
    /// Terrain, instead of the board file's
    #[arg(long, value_name = "PACK")]
    pack: Option<PathBuf>,
    /// Write frames as PNG, and the state they show as frames.csv, into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the SHA-256 of every frame
    #[arg(long)]
    hash: bool,
    /// Write the state at each frame to this file
    #[arg(long, value_name = "CSV")]
    state: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// Everything that is wrong with the board file; a recording that is missing or damaged; a file that cannot be written.
pub fn run(args: ReplayArgs) -> Result<(), Vec<Failure>> {
    let board = Board::load(&args.board)?;
    replay(&board, &args).map_err(|f| vec![f])
}

fn replay(board: &Board, args: &ReplayArgs) -> Result<(), Failure> {
    let reel = Reel::open(&args.recording, board, args.protocol, args.baud)?;
    let mut player = Player::new(reel)?;
    let mut table = args.state.as_deref().map(StateTable::create).transpose()?;
    let mut studio = match args.out.is_some() || args.hash {
        true => Some(Studio::open(board, args)?),
        false => None,
    };
    if player.is_over() {
        let todo = "record it again";
        return Err(Failure::new(
            Kind::Input,
            args.recording.display(),
            "it holds no frames",
            todo,
        ));
    }
    let mut frames = 0_u64;
    while !player.is_over() {
        let nanos = u128::from(frames) * 1_000_000_000 / u128::from(board.screen.rate_hz);
        let now = START.plus(Duration::from_nanos(
            u64::try_from(nanos).unwrap_or(u64::MAX),
        ));
        let state = player.state_at(now)?;
        if let Some(table) = &mut table {
            let clock = player.clock_at(now).unwrap_or_default();
            table.write(frames, now, clock, &state, player.sources())?;
        }
        if let Some(studio) = &mut studio {
            studio.show(frames, now, &state)?;
        }
        frames += 1;
    }
    if let Some(table) = table {
        table.finish()?;
    }
    if let Some(studio) = studio {
        studio.finish()?;
    }
    tell(args, &player, frames, board.screen.rate_hz);
    Ok(())
}

/// What was replayed, and what the user is to know of it.
fn tell(args: &ReplayArgs, player: &Player, frames: u64, rate_hz: u32) {
    let recording = args.recording.display();
    for note in player.notes() {
        eprintln!("glasswing: {recording}: {note}");
    }
    for (name, tally) in player.tallies() {
        let bad: u64 = tally.bad.iter().sum();
        eprintln!(
            "{name}: {} good, {bad} bad, {} ignored",
            tally.good, tally.ignored
        );
    }
    eprintln!("{frames} frames at {rate_hz} Hz");
}

/// Makes pictures.
struct Studio {
    // Pictures before the screen that they are made on.
    cockpit: Cockpit,
    _screen: Box<dyn Screen>,
    rgba: Vec<u8>,
    hash: bool,
    writer: Option<FrameWriter>,
}

impl Studio {
    fn open(board: &Board, args: &ReplayArgs) -> Result<Self, Failure> {
        let mut board = board.clone();
        // A recording is replayed beside whatever is on the screen.
        if !matches!(board.screen.kind, screen::Kind::OsMesa) {
            board.screen.kind = screen::Kind::Surfaceless;
        }
        let pack = args.pack.as_ref().or(board.terrain.pack.as_ref());
        let pack = pack.map(|pack| cockpit::open_pack(pack)).transpose()?;
        let screen = cockpit::open_screen(&board)?;
        let (width_px, height_px) = screen.size_px();
        let size = Size {
            width_px,
            height_px,
        };
        let writer = args
            .out
            .as_ref()
            .map(|folder| FrameWriter::start(folder, size, START));
        Ok(Self {
            cockpit: Cockpit::new(screen.as_ref(), &board, pack)?,
            _screen: screen,
            rgba: vec![0; size.rgba_bytes()],
            hash: args.hash,
            writer: writer.transpose()?,
        })
    }

    fn show(&mut self, number: u64, now: Monotonic, state: &FlightState) -> Result<(), Failure> {
        self.settle(state, now)?;
        self.cockpit.draw(state, now);
        self.cockpit.read_rgba(&mut self.rgba);
        if self.hash {
            let mut line = String::with_capacity(80);
            for byte in Sha256::digest(&self.rgba) {
                // Writing to a text cannot fail.
                let _ = write!(line, "{byte:02x}");
            }
            say!("{line}  frame-{number:06}");
        }
        if let Some(writer) = &mut self.writer {
            let row = FrameRow {
                number,
                now,
                state: *state,
            };
            writer.write_patiently(row, |pixels| pixels.copy_from_slice(&self.rgba));
        }
        Ok(())
    }

    /// Waits until all terrain is there: what has come in real time is another thing every time.
    fn settle(&mut self, state: &FlightState, now: Monotonic) -> Result<(), Failure> {
        let deadline = Monotonic::read().plus(SETTLE_MAX);
        while !self.cockpit.stream(state, now) {
            if Monotonic::read() > deadline {
                let why = format!("is not all there after {} s", SETTLE_MAX.as_secs());
                let todo = "see what `glasswing terrain verify` says of the pack";
                return Err(Failure::new(Kind::Other, "terrain", why, todo));
            }
            std::thread::park_timeout(Duration::from_millis(1));
        }
        Ok(())
    }

    fn finish(self) -> Result<(), Failure> {
        self.writer
            .map_or(Ok(()), |writer| writer.finish().map(|_| ()))
    }
}

/// The state at each frame, as CSV.
struct StateTable {
    path: PathBuf,
    file: BufWriter<File>,
}

impl StateTable {
    fn create(path: &Path) -> Result<Self, Failure> {
        let header = "frame,time_s,clock_s,parameter,value,unit,source,age_s,why";
        let file = File::create(path).and_then(|file| {
            let mut file = BufWriter::new(file);
            writeln!(file, "{header}").map(|()| file)
        });
        Ok(Self {
            file: file.map_err(|e| unwritten(path, e))?,
            path: path.to_owned(),
        })
    }

    fn write(
        &mut self,
        frame: u64,
        now: Monotonic,
        clock: Duration,
        state: &FlightState,
        sources: &[Played],
    ) -> Result<(), Failure> {
        let time_s = now.since(START).unwrap_or_default().as_secs_f64();
        let clock = format!("{}.{:09}", clock.as_secs(), clock.subsec_nanos());
        let rows = Parameter::ALL.iter().try_for_each(|parameter| {
            let cells = cells(*parameter, now, state, sources);
            writeln!(self.file, "{frame},{time_s:.6},{clock},{cells}")
        });
        rows.map_err(|e| unwritten(&self.path, e))
    }

    fn finish(mut self) -> Result<(), Failure> {
        self.file.flush().map_err(|e| unwritten(&self.path, e))
    }
}

fn unwritten(path: &Path, e: io::Error) -> Failure {
    let todo = "check the folder, its rights and the room on the disk";
    Failure::new(Kind::Other, path.display(), "it cannot be written", todo).caused_by(e)
}

/// Parameter, value, unit, source, age, why.
fn cells(parameter: Parameter, now: Monotonic, state: &FlightState, sources: &[Played]) -> String {
    let name = parameter.spec().name;
    let unit = name.rsplit('_').next().unwrap_or_default();
    let (value, why) = match state.read(parameter, now) {
        // Rust prints the shortest digits that read back as the same number.
        Ok(value) => (value.to_string(), String::new()),
        Err(reason) => {
            let missing = state.missing(parameter).map(|missing| {
                let input = missing.input.spec().name;
                format!("{} ({input} {})", reason.name(), missing.reason.name())
            });
            (
                String::new(),
                missing.unwrap_or_else(|| reason.name().to_owned()),
            )
        }
    };
    let source = match state.source(parameter) {
        Some(id) => sources
            .get(usize::from(id.0))
            .map_or("", |source| source.name.as_str()),
        None if state.is_derived(parameter) => "derived",
        None => "",
    };
    let age = state.age(parameter, now);
    let age = age.map_or(String::new(), |age| format!("{:.6}", age.as_secs_f64()));
    format!("{name},{value},{unit},{},{age},{why}", quoted(source))
}

/// A text as one cell: quoted where it has to be (RFC 4180).
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}
