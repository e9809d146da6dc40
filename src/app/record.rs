//! `glasswing record`: raw frames of every bus with their times of receipt, until told to stop.

use crate::app::board::{Board, Endpoint, SourceWish};
use crate::app::error::{Failure, Kind};
use crate::app::out::say;
use crate::app::run::{seconds, stop_on_signals};
use crate::app::sources::{self, Watch};
use crate::recording::{Header, Plan, Recorder, Report, SIZE_LIMIT_MIN, Source, Tap};
use crate::time::Monotonic;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Duration;

/// How often it is looked whether to stop.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// Records the raw frames of every bus with their times, for `glasswing replay`
///
/// Everything on the buses is recorded, whether or not the display has a use for it. At most a second is lost when the power
/// is cut. A recording that is there already goes on as a new session; with a size limit its oldest part makes way.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example:\n  glasswing record --board cockpit.toml --out flight.gwr --size-limit 2G\n  glasswing replay flight.gwr --board cockpit.toml --state flight.csv"
)]
pub struct RecordArgs {
    /// The board file: its sources are recorded
    #[arg(long, value_name = "FILE", default_value = "/etc/glasswing/board.toml")]
    board: PathBuf,
    /// The recording
    #[arg(long, value_name = "RECORDING")]
    out: PathBuf,
    /// The most that the recording may take on the disk: bytes, or with K, M or G for 1024 of them, their square, their cube
    #[arg(long, value_name = "SIZE", value_parser = size)]
    size_limit: Option<u64>,
    /// End after this many seconds
    #[arg(long, value_name = "S", value_parser = seconds)]
    seconds: Option<Duration>,
}

/// A size limit on the command line.
///
/// # Errors
/// Unless it is a whole number of at least a mebibyte.
pub fn size(text: &str) -> Result<u64, String> {
    let (digits, unit) = match text.char_indices().last() {
        Some((at, 'k' | 'K')) => (&text[..at], 1 << 10),
        Some((at, 'M')) => (&text[..at], 1 << 20),
        Some((at, 'G')) => (&text[..at], 1 << 30),
        _ => (text, 1),
    };
    let bytes = digits.parse::<u64>().ok().and_then(|n| n.checked_mul(unit));
    bytes
        .filter(|bytes| *bytes >= SIZE_LIMIT_MIN)
        .ok_or_else(|| "give a size of at least 1M, as in 500M or 2G".to_owned())
}

/// Runs the command.
///
/// # Errors
/// Everything that is wrong with the board file; a source that can never be opened; a recording that cannot be written.
pub fn run(args: RecordArgs) -> Result<(), Vec<Failure>> {
    let board = Board::load(&args.board)?;
    record(&board, &args).map_err(|f| vec![f])
}

fn record(board: &Board, args: &RecordArgs) -> Result<(), Failure> {
    if board.sources.is_empty() {
        let todo = "add a [[source]] for each bus";
        return Err(Failure::new(
            Kind::Usage,
            board.file.display(),
            "it names no source to record",
            todo,
        ));
    }
    let stop = stop_on_signals()?;
    let header = header(board, true);
    let shared: Vec<bool> = header
        .sources
        .iter()
        .map(|s| s.frames_of.is_some())
        .collect();
    let plan = Plan {
        path: args.out.clone(),
        size_limit: args.size_limit,
        header,
    };
    let (recorder, taps) = Recorder::start(plan)?;
    let mut threads = Vec::new();
    for (i, ((wish, tap), shared)) in board.sources.iter().zip(taps).zip(shared).enumerate() {
        let tap: Option<Tap> = (!shared).then_some(tap);
        threads.push(sources::record(board, i, wish, tap)?.thread);
    }
    say!(
        "recording {} sources to {}",
        threads.len(),
        args.out.display()
    );
    let end = args.seconds.map(|d| Monotonic::read().plus(d));
    let mut watch = Watch::new(&threads);
    while !stop.load(Ordering::Acquire) && end.is_none_or(|end| Monotonic::read() < end) {
        std::thread::sleep(LOOK_EVERY);
        watch.look();
        if let Some(e) = recorder.report().failing {
            return Err(refused(&args.out, e));
        }
    }
    for thread in &mut threads {
        thread.stop();
    }
    let report = recorder.finish();
    for thread in &threads {
        let figures = thread.figures().snapshot();
        let (good, bad, ignored) = (figures.good, figures.bad, figures.ignored);
        say!(
            "{}: {good} good, {bad} bad, {ignored} ignored",
            thread.name()
        );
    }
    say!(
        "{} frames and {} bytes written, {} frames lost",
        report.frames,
        report.bytes,
        report.lost
    );
    report
        .failing
        .map_or(Ok(()), |e| Err(refused(&args.out, e)))
}

fn refused(path: &Path, e: String) -> Failure {
    let why = format!("it cannot be written any more: {e}");
    let todo =
        "make room on the disk, or give a size limit; what was recorded before can be replayed";
    Failure::new(Kind::Other, path.display(), why, todo)
}

/// The board's sources as a recording names them. `whole`: each CAN bus is recorded once, with all that is on it; else each
/// source with what it hears.
#[must_use]
pub fn header(board: &Board, whole: bool) -> Header {
    let same_bus = |own: usize, source: &SourceWish| {
        let is_can = matches!(source.endpoint, Endpoint::Can { .. });
        let first = board
            .sources
            .iter()
            .position(|other| other.endpoint == source.endpoint);
        first.filter(|first| whole && is_can && *first < own)
    };
    let sources = board.sources.iter().enumerate().map(|(own, source)| {
        let (at, baud) = match &source.endpoint {
            Endpoint::Udp { bind, .. } => (bind.to_string(), None),
            Endpoint::Can { interface } => (interface.clone(), None),
            Endpoint::Serial { path, baud } => (path.clone(), Some(*baud)),
        };
        Source {
            name: source.name.clone(),
            protocol: source.protocol.name().to_owned(),
            bus: source.endpoint.key().to_owned(),
            at,
            baud,
            layout: source.layout.clone(),
            frames_of: same_bus(own, source).and_then(|first| u8::try_from(first).ok()),
        }
    });
    Header {
        program: concat!("glasswing ", env!("CARGO_PKG_VERSION")).to_owned(),
        sources: sources.collect(),
    }
}

/// The figures of a recording as `run --stats` tells them.
#[must_use]
pub fn to_json(report: &Report) -> Value {
    json!({
        "frames": report.frames, "bytes": report.bytes, "lost": report.lost, "failing": report.failing,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_and_refused() {
        assert_eq!(size("2G"), Ok(2 << 30));
        assert_eq!(size("1024K"), Ok(1 << 20));
        assert_eq!(size("1048576"), Ok(1 << 20));
        for wrong in ["", "G", "1023K", "-5M", "1.5G", "12T", "99999999999G", "é"] {
            assert!(size(wrong).is_err(), "{wrong}");
        }
    }
}
