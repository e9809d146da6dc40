//! `glasswing terrain bake` and `join`: from a user's files to a pack, and from packs to one.
#![expect(clippy::print_stderr, reason = "warnings beside the output")]

use crate::app::out::say;
use crate::app::terrain::{cannot_write, jobs, pack_failure, progress_bar, summary};
use crate::app::{Failure, Kind};
use crate::terrain::bake::{self, BakeError, Heights, Seam};
use crate::terrain::join::{self, JoinError};
use crate::terrain::pack::Bounds;
use crate::terrain::plain::{PlainGrids, RAW_TYPES, RawType};
use std::error::Error as _;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Arguments of `terrain bake`.
#[derive(Debug, clap::Args)]
pub struct BakeArgs {
    /// Elevation files; neighbours in any order.
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// The pack to write.
    #[arg(long, value_name = "PACK")]
    out: PathBuf,
    /// What the inputs' heights refer to: the EGM96 geoid (SRTM's do) or the WGS 84 ellipsoid.
    #[arg(long, value_enum, default_value = "egm96")]
    heights: HeightsArg,
    /// Take only this part: southern, western, northern, eastern edge in degrees.
    #[arg(long, value_name = "S,W,N,E", allow_hyphen_values = true, value_parser = parse_region)]
    region: Option<Bounds>,
    /// Where a plain grid lies: southern, western, northern, eastern bound in degrees (the eastern may pass 180). Once for
    /// each plain grid, in their order.
    #[arg(long, value_name = "S,W,N,E", allow_hyphen_values = true, value_parser = parse_bounds, help_heading = PLAIN)]
    bounds: Vec<Bounds>,
    /// What `--bounds` are: the outer edges of the cells around the outermost samples, or these samples themselves.
    #[arg(long, value_enum, default_value = "edges", help_heading = PLAIN)]
    bounds_at: BoundsAt,
    /// Which row of a plain grid comes first.
    #[arg(long, value_enum, default_value = "north", help_heading = PLAIN)]
    first_row: FirstRow,
    /// Metres per unit of a plain grid's samples.
    #[arg(long, value_name = "METRES", default_value_t = 1.0, value_parser = parse_unit, help_heading = PLAIN)]
    unit: f64,
    /// The sample of a plain grid that stands for no height.
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true, help_heading = PLAIN)]
    nodata: Option<f64>,
    /// Size and sample type of .raw, .bin, .bil and .flt files: i16le, i16be, u16le, u16be, f32le or f32be.
    #[arg(long, value_name = "COLUMNSxROWS,TYPE", value_parser = parse_raw, help_heading = PLAIN)]
    raw: Option<(usize, usize, RawType)>,
    /// Keep finished parts in this folder: the same command goes on from them after an interruption. Needs the space of a
    /// second pack; the folder goes when the pack is whole.
    #[arg(long, value_name = "DIR")]
    parts: Option<PathBuf>,
    /// Threads; as many as the machine has cores if not given. The pack is the same whatever their number.
    #[arg(long, value_name = "N")]
    jobs: Option<NonZeroUsize>,
}

/// Arguments of `terrain join`.
#[derive(Debug, clap::Args)]
pub struct JoinArgs {
    /// Packs of regions.
    #[arg(required = true, value_name = "PACK")]
    packs: Vec<PathBuf>,
    /// The pack to write.
    #[arg(long, value_name = "PACK")]
    out: PathBuf,
    /// Threads; as many as the machine has cores if not given. The pack is the same whatever their number.
    #[arg(long, value_name = "N")]
    jobs: Option<NonZeroUsize>,
}

/// The heading of the options for plain grids.
const PLAIN: &str = "Plain grids";

/// What bounds are of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum BoundsAt {
    /// The outer edges of the outermost cells.
    Edges,
    /// The outermost samples.
    Posts,
}

/// The row of a grid that comes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum FirstRow {
    /// The northernmost.
    North,
    /// The southernmost.
    South,
}

/// A vertical datum on the command line.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub enum HeightsArg {
    /// Above the EGM96 geoid (mean sea level).
    Egm96,
    /// Above the WGS 84 ellipsoid.
    Ellipsoidal,
}

fn parse_region(text: &str) -> Result<Bounds, String> {
    let bounds = parse_bounds(text)?;
    if bounds.west_deg < -180.0 || bounds.east_deg > 180.0 {
        return Err("the western edge must lie below the eastern, within 180 degrees".to_owned());
    }
    Ok(bounds)
}

fn parse_unit(text: &str) -> Result<f64, String> {
    let unit: f64 = text.parse().map_err(|e| format!("{e}"))?;
    if unit.is_finite() && unit.abs() > 0.0 {
        Ok(unit)
    } else {
        Err("metres per unit, not nothing".to_owned())
    }
}

fn parse_raw(text: &str) -> Result<(usize, usize, RawType), String> {
    let wrong = || "is wanted as COLUMNSxROWS,TYPE, say 1025x1025,i16le".to_owned();
    let (size, kind) = text.split_once(',').ok_or_else(wrong)?;
    let (columns, rows) = size.split_once('x').ok_or_else(wrong)?;
    let kind = RAW_TYPES
        .iter()
        .find(|(name, _)| *name == kind)
        .ok_or_else(wrong)?;
    match (columns.parse(), rows.parse()) {
        (Ok(columns), Ok(rows)) => Ok((columns, rows, kind.1)),
        _ => Err(wrong()),
    }
}

fn parse_bounds(text: &str) -> Result<Bounds, String> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|n| n.trim().parse().map_err(|e| format!("`{n}`: {e}")))
        .collect::<Result<_, _>>()?;
    let &[south_deg, west_deg, north_deg, east_deg] = numbers.as_slice() else {
        return Err("four numbers are wanted: S,W,N,E in degrees".to_owned());
    };
    if !(-90.0 <= south_deg && south_deg < north_deg && north_deg <= 90.0) {
        return Err("the southern edge must lie below the northern, within 90 degrees".to_owned());
    }
    if !(-360.0 <= west_deg
        && west_deg < east_deg
        && east_deg <= 540.0
        && east_deg - west_deg < 361.0)
    {
        return Err("the western edge must lie below the eastern, one turn at most".to_owned());
    }
    Ok(Bounds {
        south_deg,
        west_deg,
        north_deg,
        east_deg,
    })
}

/// A flag that is set when somebody interrupts.
fn stop_on_signals() -> Arc<AtomicBool> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        // Without the handler the signal ends the program at once, and the temporary file stays: no worse than kill -9.
        let _ = signal_hook::flag::register(signal, Arc::clone(&stop));
    }
    stop
}

/// Runs `terrain join`.
///
/// # Errors
/// With what the user can do about it.
pub fn join(args: &JoinArgs) -> Result<(), Failure> {
    let stop = stop_on_signals();
    let bar = progress_bar();
    let job = join::Job {
        packs: &args.packs,
        out: &args.out,
        jobs: jobs(args.jobs),
        stop: &stop,
    };
    let report = join::join(&job, &mut |done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    let report = report.map_err(join_failure)?;
    for seam in &report.seams {
        warn_seam(seam);
    }
    say!("{}: {}", args.out.display(), summary(&report.info));
    Ok(())
}

/// Runs `terrain bake`.
///
/// # Errors
/// With what the user can do about it.
pub fn bake(args: &BakeArgs) -> Result<(), Failure> {
    let stop = stop_on_signals();
    let bar = progress_bar();
    let plain = PlainGrids {
        bounds: args.bounds.clone(),
        bounds_on_posts: args.bounds_at == BoundsAt::Posts,
        south_first: args.first_row == FirstRow::South,
        unit_m: args.unit,
        nodata: args.nodata,
        raw: args.raw,
    };
    let job = bake::Job {
        inputs: &args.inputs,
        plain: &plain,
        out: &args.out,
        heights: match args.heights {
            HeightsArg::Egm96 => Heights::Egm96,
            HeightsArg::Ellipsoidal => Heights::Ellipsoidal,
        },
        region: args.region,
        parts: args.parts.as_deref(),
        jobs: jobs(args.jobs),
        stop: &stop,
    };
    let report = bake::bake(&job, &mut |done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    let report = report.map_err(bake_failure)?;
    for seam in &report.seams {
        warn_seam(seam);
    }
    say!("{}: {}", args.out.display(), summary(&report.info));
    Ok(())
}

fn warn_seam(seam: &Seam) {
    eprintln!(
        "glasswing: {} and {}: where they overlap they differ by up to {} m, at {:.5} N {:.5} E ({} posts; the heights of {} were \
         taken)",
        seam.taken.display(),
        seam.other.display(),
        seam.difference_m,
        seam.latitude_deg,
        seam.longitude_deg,
        seam.posts,
        seam.taken.display(),
    );
}

fn bake_failure(error: BakeError) -> Failure {
    match error {
        BakeError::Input(path, why) => {
            let failure = Failure::new(Kind::Input, path.display(), &why, why.remedy());
            if why.source().is_some() {
                failure.caused_by(Chain(why))
            } else {
                failure
            }
        }
        BakeError::Twice(ref path) => {
            Failure::new(Kind::Usage, path.display(), &error, "name each file once")
        }
        BakeError::Places { .. } => Failure::new(
            Kind::Usage,
            "--bounds",
            &error,
            "give one for each file without a place of its own, in their order",
        ),
        BakeError::ThinAir { ref coarse, .. } => Failure::new(
            Kind::Usage,
            coarse.display(),
            &error,
            "cut with --region around the fine files, or bake it to a pack of its own",
        ),
        BakeError::NothingInRegion => Failure::new(
            Kind::Usage,
            "--region",
            &error,
            "give the region as S,W,N,E in degrees, south and west negative",
        ),
        BakeError::Parts(why) => join_failure(why),
        BakeError::OtherParts(ref folder) => Failure::new(
            Kind::Usage,
            folder.display(),
            &error,
            "give --parts an empty folder, or the inputs and options as they were",
        ),
        BakeError::Output(path, why) => cannot_write(&path, why),
        BakeError::Stopped => Failure::new(
            Kind::Other,
            "terrain bake",
            "interrupted; no pack was written",
            "run it again",
        ),
    }
}

fn join_failure(error: JoinError) -> Failure {
    match error {
        JoinError::Pack(path, why) => pack_failure(&path, why),
        JoinError::Twice(ref path) => {
            Failure::new(Kind::Usage, path.display(), &error, "name each pack once")
        }
        JoinError::Grid { ref other, .. } => Failure::new(
            Kind::Input,
            other.display(),
            &error,
            "bake it again beside a file as fine as the others' finest, or join packs of one spacing",
        ),
        JoinError::Tile(ref path, ..) => Failure::new(
            Kind::Input,
            path.display(),
            &error,
            "copy it again from the original, or bake it again",
        ),
        JoinError::Output(path, why) => cannot_write(&path, why),
        JoinError::Stopped => Failure::new(
            Kind::Other,
            "terrain join",
            "interrupted; no pack was written",
            "run it again",
        ),
    }
}

/// An input error's cause without the sentence that the failure itself already says.
#[derive(Debug)]
struct Chain(crate::terrain::input::InputError);

impl std::fmt::Display for Chain {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0.source() {
            Some(cause) => write!(f, "{cause}"),
            None => write!(f, "{}", self.0),
        }
    }
}

impl std::error::Error for Chain {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.0.source().and_then(std::error::Error::source)
    }
}
