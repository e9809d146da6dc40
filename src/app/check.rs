//! `glasswing check`: everything that is wrong with a board file and its devices, in one go.

use crate::app::board::{Board, Endpoint, SourceWish};
use crate::app::cockpit;
use crate::app::error::Failure;
use crate::app::out::say;
use crate::app::{ports, sniff, sources};
use crate::bus::{BusError, can};
use std::path::{Path, PathBuf};

/// Where the board file is unless named.
const BOARD: &str = "/etc/glasswing/board.toml";

/// Finds everything that is wrong with a board file and its devices
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Opens every device that the file names, for a moment each; stop a running glasswing first.\n\n\
    Example:\n  glasswing check --board boards/headless.toml\n  glasswing check --sniff\n  \
    glasswing check --sniff --on serial:/dev/ttyUSB0 --on udp:4000 --seconds 5"
)]
pub struct CheckArgs {
    /// The board file [default: /etc/glasswing/board.toml]
    #[arg(long, value_name = "FILE")]
    board: Option<PathBuf>,
    /// Listen instead: name what is spoken where, how surely, at which speed, and print the lines for the board file. Listens
    /// to the places named with --on, else to those of the board file if --board is given, else to all that `glasswing list`
    /// finds and to the usual UDP ports
    #[arg(long)]
    sniff: bool,
    #[command(flatten)]
    listen: sniff::ListenArgs,
}

/// Runs the command.
///
/// # Errors
/// Everything that is wrong: keys first; where those are good, terrain, sources and the screen.
pub fn run(args: CheckArgs) -> Result<(), Vec<Failure>> {
    if args.sniff {
        let board = args.board.as_deref().map(Board::load).transpose()?;
        return sniff::run(&args.listen, board.as_ref());
    }
    let file = args.board.unwrap_or_else(|| BOARD.into());
    let board = Board::load(&file)?;
    say!("{}: every key is good", file.display());
    let mut failures = Vec::new();
    let mut told = |what: String, outcome: Result<String, Failure>| match outcome {
        Ok(good) => say!("{what}: {good}"),
        Err(failure) => failures.push(failure),
    };
    match &board.terrain.pack {
        None => say!("terrain: none (no pack in the board file)"),
        Some(pack) => told(
            "terrain".into(),
            cockpit::open_pack(pack).map(|p| {
                format!(
                    "{}: {} tiles, {} levels",
                    pack.display(),
                    p.info().tiles,
                    p.info().levels
                )
            }),
        ),
    }
    if board.sources.is_empty() {
        say!("sources: none (the board file names none; nothing but flags will be shown)");
    }
    for (i, source) in board.sources.iter().enumerate() {
        told(
            format!("source {}", source.name),
            try_source(&board, i, source),
        );
    }
    told(
        "screen".into(),
        cockpit::open_screen(&board).map(|screen| screen.describe()),
    );
    if failures.is_empty() {
        Ok(())
    } else {
        Err(failures)
    }
}

fn try_source(board: &Board, index: usize, source: &SourceWish) -> Result<String, Failure> {
    drop(sources::listen_to(board, index, source)?);
    let protocol = source.protocol.name();
    let endpoint = &source.endpoint;
    let mut advice = String::new();
    match endpoint {
        // It can be opened all the same, and `run` waits for it to be switched on.
        Endpoint::Can { interface } if can::is_up(interface) == Some(false) => {
            let interface = interface.clone();
            let down = BusError::InterfaceDown { interface };
            return Err(sources::refusal(board, index, source, down));
        }
        Endpoint::Serial { path, .. } => {
            if let Some(name) = ports::lasting_name(Path::new(path)) {
                let name = name.display();
                advice = format!("; {name} is its name however often it is plugged in");
            }
        }
        _ => {}
    }
    Ok(format!("{protocol} on {endpoint} can be heard{advice}"))
}
