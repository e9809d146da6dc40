//! `glasswing run`: flies with a board file until told to stop.

use crate::app::board::{Board, Endpoint};
use crate::app::cockpit::{self, Cockpit};
use crate::app::error::{Failure, Kind};
use crate::app::fly::{self, Plan};
use crate::app::frames::FrameWriter;
use crate::app::health::{Health, Pulse};
use crate::time::Monotonic;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// The board file of an installed cockpit.
const BOARD: &str = "/etc/glasswing/board.toml";

/// Flies: draws terrain and instruments until told to stop
#[derive(Debug, clap::Args)]
#[command(after_help = "Frames: --frames-dir writes frame-NNNNNN.png and frames.csv, the state that each picture shows.\n\n\
    Example:\n  glasswing run --board boards/headless.toml --pack bohemia.pack --frames-dir frames --seconds 60")]
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
}
