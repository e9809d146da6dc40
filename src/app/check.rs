//! `glasswing check`: everything that is wrong with a board file and its devices, in one go.
#![expect(clippy::print_stdout, reason = "the command's output")]

use crate::app::board::{Board, Endpoint, SourceWish};
use crate::app::cockpit;
use crate::app::error::Failure;
use crate::app::sources;
use crate::signal::SourceId;
use std::path::PathBuf;

/// Finds everything that is wrong with a board file and its devices
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Opens every device that the file names, for a moment each; stop a running glasswing first.\n\n\
    Example:\n  glasswing check --board boards/headless.toml"
)]
pub struct CheckArgs {
    /// The board file
    #[arg(long, value_name = "FILE", default_value = "/etc/glasswing/board.toml")]
    board: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// Everything that is wrong: keys first; where those are good, terrain, sources and the screen.
pub fn run(args: CheckArgs) -> Result<(), Vec<Failure>> {
    let board = Board::load(&args.board)?;
    println!("{}: every key is good", args.board.display());
    let mut failures = Vec::new();
    let mut told = |what: String, outcome: Result<String, Failure>| match outcome {
        Ok(good) => println!("{what}: {good}"),
        Err(failure) => failures.push(failure),
    };
    match &board.terrain.pack {
        None => println!("terrain: none (no pack in the board file)"),
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
        println!("sources: none (the board file names none; nothing but flags will be shown)");
    }
    for source in &board.sources {
        told(format!("source {}", source.name), try_source(source));
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

fn try_source(source: &SourceWish) -> Result<String, Failure> {
    let id = SourceId(0);
    let (handle, place) = match &source.endpoint {
        Endpoint::Udp { bind, allow } => (
            sources::listen_udp(&source.name, id, source.decoder(), *bind, allow.clone())?,
            format!("udp {bind}"),
        ),
        Endpoint::Serial { device, baud } => (
            sources::listen_serial(&source.name, id, source.decoder(), device, *baud)?,
            format!("serial {device} at {baud} bit/s"),
        ),
        Endpoint::Can { interface } => (
            sources::listen_can(&source.name, id, source.protocol, interface)?,
            interface.clone(),
        ),
    };
    drop(handle);
    Ok(format!(
        "{} on {place} can be heard",
        source.protocol.name()
    ))
}
