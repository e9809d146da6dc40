//! The command line: what the program can be asked to do, and how a failure becomes one line and an exit code.

use crate::app::error::{Failure, Kind};
use crate::app::{
    check, decode, demo, list, measure, out, record, replay, run, shot, simulate, terrain,
};
use clap::{Parser, Subcommand};
use std::error::Error as StdError;
use std::io::Write as _;
use std::process::ExitCode;

/// Synthetic vision and primary flight display for ARM single-board computers.
///
/// Without a command it flies with /etc/glasswing/board.toml, as `glasswing run` does.
#[derive(Debug, Parser)]
#[command(
    name = "glasswing",
    version,
    after_help = "Exit codes: 0 done, 2 wrong usage or configuration, 3 input missing or damaged, \
                  4 a device refused, 1 anything else.\n\n\
                  Example:\n  glasswing demo\n  glasswing terrain bake N50E014.hgt --out bohemia.pack\n  \
                  glasswing run --board boards/headless.toml --pack bohemia.pack --frames-dir frames"
)]
struct Cli {
    /// Say more on stderr about what is going on
    #[arg(long, short, global = true)]
    verbose: bool,
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Debug, Subcommand)]
enum Command {
    Run(run::RunArgs),
    Demo(demo::DemoArgs),
    /// Bakes elevation data into a pack, and looks into packs
    #[command(subcommand)]
    Terrain(terrain::TerrainCommand),
    Shot(shot::ShotArgs),
    Decode(decode::DecodeArgs),
    Record(record::RecordArgs),
    Replay(replay::ReplayArgs),
    Simulate(simulate::SimulateArgs),
    Check(check::CheckArgs),
    List(list::ListArgs),
    /// Measures terrain and buses, and says how
    #[command(subcommand)]
    Measure(measure::MeasureCommand),
}

/// Runs the program on the process's own arguments.
#[must_use]
pub fn main() -> ExitCode {
    crate::heap::keep_freed_memory();
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(e) if e.use_stderr() => return complain(&[wrong_usage(&e)]),
        Err(help) => {
            // Help or the version, asked for.
            let _ = help.print();
            return ExitCode::SUCCESS;
        }
    };
    log_to_stderr(cli.verbose);
    let command = cli
        .command
        .unwrap_or_else(|| Command::Run(run::RunArgs::default()));
    let outcome = match command {
        Command::Run(args) => run::run(args),
        Command::Demo(args) => demo::run(args),
        Command::Terrain(command) => terrain::run(command).map_err(|f| vec![f]),
        Command::Shot(args) => shot::run(args).map_err(|f| vec![f]),
        Command::Decode(args) => decode::run(args).map_err(|f| vec![f]),
        Command::Record(args) => record::run(args),
        Command::Replay(args) => replay::run(args),
        Command::Simulate(args) => simulate::run(args).map_err(|f| vec![f]),
        Command::Check(args) => check::run(args),
        Command::List(args) => list::run(args).map_err(|f| vec![f]),
        Command::Measure(command) => measure::run(command).map_err(|f| vec![f]),
    };
    match outcome.and_then(|()| out::outcome().map_err(|f| vec![f])) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failures) => complain(&failures),
    }
}

fn log_to_stderr(verbose: bool) {
    let level = if verbose {
        tracing::Level::INFO
    } else {
        tracing::Level::WARN
    };
    // A second subscriber can only be refused when a test has set its own: that one stays.
    let _ = tracing_subscriber::fmt()
        .with_max_level(level)
        .with_writer(std::io::stderr)
        .with_target(false)
        .without_time()
        .try_init();
}

/// Clap's own complaint is a page; its first line says what is wrong.
fn wrong_usage(e: &clap::Error) -> Failure {
    let page = e.to_string();
    let mut lines = page.lines().map(str::trim).filter(|l| !l.is_empty());
    let first = lines
        .next()
        .unwrap_or("not understood")
        .trim_start_matches("error: ")
        .to_owned();
    // "the following arguments were not provided:" names them on the lines below; so does a value that is none of several.
    let list = first.ends_with(':');
    let named: Vec<&str> = lines
        .take_while(|l| !l.starts_with("Usage"))
        .filter(|l| list || l.starts_with("[possible values"))
        .collect();
    let why = [first.as_str(), &named.join(" ")].join(" ");
    let asked: Vec<String> = std::env::args()
        .skip(1)
        .take_while(|a| !a.starts_with('-'))
        .take(2)
        .collect();
    let commands = [
        "run", "demo", "shot", "decode", "simulate", "record", "replay", "check", "list",
    ];
    let todo = match asked.first().map(String::as_str) {
        Some("terrain") => "see glasswing terrain --help".to_owned(),
        Some("measure") => "see glasswing measure --help".to_owned(),
        Some(command) if commands.contains(&command) => format!("see glasswing {command} --help"),
        _ => "see glasswing --help".to_owned(),
    };
    Failure::new(Kind::Usage, "command line", why.trim(), todo)
}

/// One line per failure, its causes below it; the exit code is the first one's.
fn complain(failures: &[Failure]) -> ExitCode {
    let mut err = std::io::stderr().lock();
    for failure in failures {
        // Nobody is left to tell when stderr is closed.
        let _ = writeln!(err, "glasswing: {failure}");
        let mut cause = failure.source();
        while let Some(e) = cause {
            let _ = writeln!(err, "  because: {e}");
            cause = e.source();
        }
    }
    failures
        .first()
        .map_or(ExitCode::FAILURE, Failure::exit_code)
}
