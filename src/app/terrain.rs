//! `glasswing terrain`: bake, synth, info, verify, height.

use crate::app::out::say;
use crate::app::terrain_bake::{self, BakeArgs, JoinArgs};
use crate::app::{Failure, Kind, terrain_info};
use crate::terrain::codec::{SurfaceKind, Tile};
use crate::terrain::height::{GroundReader, HeightError};
use crate::terrain::pack::{Pack, PackError, PackInfo, TileReader};
use crate::terrain::synth;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

/// Terrain packs: make them, look into them.
#[derive(Debug, clap::Subcommand)]
pub enum TerrainCommand {
    /// Turn elevation files into a pack.
    ///
    /// Reads SRTM .hgt (1201 or 3601 posts a side; also .hgt.gz, and .zip with one .hgt in it), DTED (.dt0, .dt1, .dt2) and
    /// GeoTIFF (.tif, .tiff: one band of Int16, UInt16 or Float32, in EPSG:4326 or in UTM on WGS 84). Plain grids are read where
    /// `--bounds` says that they lie: rows of numbers (.txt, .csv, also .gz), grey PNG, raw samples (.raw, .bin, .bil, .flt);
    /// an Esri ASCII grid (.asc) says it itself.
    ///
    /// Posts are kept as they are. Files may overlap and have different spacings: the finest valid height is taken, a coarser
    /// file is bent to meet it over 32 posts, and where two disagree it is said where and by how much. A void is filled from
    /// a coarser file where there is one, else as a thin plate would bend across it, and stays marked as a void. Flat
    /// connected areas become water. Where files reach beyond 69 degrees north or south, the grid of that pole is made too.
    /// The pack appears under its name only when it is whole.
    #[command(
        after_help = "Example:\n  glasswing terrain bake N50E014.hgt N49E015.hgt.zip --out bohemia.pack\n  \
                      glasswing terrain bake etopo20data.gz --bounds=-89.833333,20.166667,89.833333,380.166667 \\\n    \
                      --bounds-at posts --first-row south --region 45,5,48,12 --out alps.pack"
    )]
    Bake(BakeArgs),
    /// Join packs of regions to one.
    ///
    /// For what is too much for one machine: bake it region by region, in any order and anywhere (`terrain bake --region`; give
    /// each the files around its region too), then join. Posts are taken as they are; the coarse levels and the grids of the
    /// poles are made anew. Every tile's checksum is tested, packs with other posts are refused, and where packs overlap and
    /// differ it is said where and by how much.
    #[command(
        after_help = "Example:\n  glasswing terrain join north.pack south.pack --out all.pack"
    )]
    Join(JoinArgs),
    /// Make the demo terrain: an alpine valley that exists nowhere.
    ///
    /// 89 x 91 km with a flat valley floor near 600 m, side valleys, peaks to 3200 m, a lake and an airfield. The same seed
    /// gives the same bytes on every machine.
    #[command(after_help = "Example:\n  glasswing terrain synth --out valley.pack")]
    Synth(SynthArgs),
    /// Show what is in a pack.
    #[command(after_help = "Example:\n  glasswing terrain info bohemia.pack")]
    Info(PackArgs),
    /// Read every tile of a pack and test its checksum.
    ///
    /// Names every damaged tile; the exit code is 3 if there is one.
    #[command(after_help = "Example:\n  glasswing terrain verify bohemia.pack")]
    Verify(PackArgs),
    /// Print the height of the ground at a point.
    ///
    /// Bilinear between the four posts of the finest level around the point. `void`: a post it rests on was never measured.
    #[command(after_help = "Example:\n  glasswing terrain height andes.pack -32.6533 -70.0108")]
    Height(HeightArgs),
}

/// Arguments of `terrain synth`.
#[derive(Debug, clap::Args)]
pub struct SynthArgs {
    /// The pack to write.
    #[arg(long, value_name = "PACK")]
    out: PathBuf,
    /// Another valley for every number.
    #[arg(long, value_name = "N", default_value_t = synth::SEED)]
    seed: u64,
}

/// Arguments of `terrain info` and `terrain verify`.
#[derive(Debug, clap::Args)]
pub struct PackArgs {
    /// The pack.
    pub pack: PathBuf,
    /// One JSON document on stdout instead of text.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `terrain height`.
#[derive(Debug, clap::Args)]
pub struct HeightArgs {
    /// The pack.
    pack: PathBuf,
    /// Latitude, degrees north.
    #[arg(allow_negative_numbers = true, value_name = "LAT")]
    latitude: f64,
    /// Longitude, degrees east.
    #[arg(allow_negative_numbers = true, value_name = "LON")]
    longitude: f64,
    /// One JSON document on stdout instead of text.
    #[arg(long)]
    json: bool,
}

/// Runs a terrain command.
///
/// # Errors
/// With what the user can do about it.
pub fn run(command: TerrainCommand) -> Result<(), Failure> {
    match command {
        TerrainCommand::Bake(args) => terrain_bake::bake(&args),
        TerrainCommand::Join(args) => terrain_bake::join(&args),
        TerrainCommand::Synth(args) => synth(&args),
        TerrainCommand::Info(args) => {
            terrain_info::print(&open_pack(&args.pack)?, &args);
            Ok(())
        }
        TerrainCommand::Verify(args) => verify(&args),
        TerrainCommand::Height(args) => height(&args),
    }
}

/// Opens a pack.
///
/// # Errors
/// Naming the pack, what is wrong with it and what to do.
pub fn open_pack(path: &Path) -> Result<Pack, Failure> {
    Pack::open(path).map_err(|e| pack_failure(path, e))
}

pub(super) fn pack_failure(path: &Path, e: PackError) -> Failure {
    let failure = Failure::new(Kind::Input, path.display(), &e, e.remedy());
    match e {
        PackError::Io(cause) => failure.caused_by(cause),
        _ => failure,
    }
}

fn synth(args: &SynthArgs) -> Result<(), Failure> {
    let info = synthesise(&args.out, args.seed)?;
    say!("{}: {}", args.out.display(), summary(&info));
    Ok(())
}

/// Writes the demo terrain of a seed, with a progress bar where stderr is a terminal.
///
/// # Errors
/// If the pack cannot be written.
pub fn synthesise(out: &Path, seed: u64) -> Result<PackInfo, Failure> {
    let bar = progress_bar();
    let made = synth::bake(seed, out, jobs(None), &mut |done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    made.map_err(|why| cannot_write(out, why))
}

pub(super) fn cannot_write(path: &Path, why: std::io::Error) -> Failure {
    Failure::new(
        Kind::Other,
        path.display(),
        "the pack cannot be written",
        "check the folder, its permissions and the space left",
    )
    .caused_by(why)
}

pub(super) fn jobs(asked: Option<NonZeroUsize>) -> usize {
    let cores = || std::thread::available_parallelism().map_or(1, NonZeroUsize::get);
    asked.map_or_else(cores, NonZeroUsize::get)
}

pub(super) fn progress_bar() -> ProgressBar {
    // indicatif draws on stderr, and nothing where that is no terminal.
    let style = ProgressStyle::with_template("{wide_bar} {pos} of {len}, {per_sec}, {eta} left");
    ProgressBar::new(0).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

pub(super) fn summary(info: &PackInfo) -> String {
    let b = &info.bounds;
    format!(
        "{} tiles in {} levels, {} bytes, {} to {} N, {} to {} E",
        info.tiles, info.levels, info.bytes, b.south_deg, b.north_deg, b.west_deg, b.east_deg
    )
}

fn verify(args: &PackArgs) -> Result<(), Failure> {
    let pack = open_pack(&args.pack)?;
    let mut reader = TileReader::new();
    let mut tile = Tile::filled(0, SurfaceKind::Void);
    let bar = progress_bar();
    bar.set_length(pack.info().tiles);
    let mut damaged = Vec::new();
    for key in pack.keys() {
        if let Err(why) = pack.read_tile(key, &mut reader, &mut tile) {
            damaged.push((key, why));
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    if args.json {
        let list: Vec<Value> = damaged
            .iter()
            .map(|(k, why)| {
                json!({
                    "partition": k.partition.name(),
                    "level": k.level,
                    "column": k.column,
                    "row": k.row,
                    "why": why.to_string(),
                })
            })
            .collect();
        say!(
            "{}",
            json!({"pack": args.pack.display().to_string(), "tiles": pack.info().tiles, "damaged": list})
        );
    } else {
        for (key, why) in &damaged {
            say!("{key}: {why}");
        }
        if damaged.is_empty() {
            say!(
                "{}: all {} tiles are sound",
                args.pack.display(),
                pack.info().tiles
            );
        }
    }
    match damaged.as_slice() {
        [] => Ok(()),
        [(key, why), ..] => Err(Failure::new(
            Kind::Input,
            args.pack.display(),
            format!(
                "{} of {} tiles damaged, the first {key}: {why}",
                damaged.len(),
                pack.info().tiles
            ),
            "copy it again from the original, or bake it again",
        )),
    }
}

fn height(args: &HeightArgs) -> Result<(), Failure> {
    let pack = open_pack(&args.pack)?;
    let (latitude, longitude) = (args.latitude, args.longitude);
    let ground = GroundReader::new(&pack)
        .at(latitude, longitude)
        .map_err(|e| height_failure(args, &pack, e))?;
    if args.json {
        say!(
            "{}",
            json!({
                "latitude": latitude,
                "longitude": longitude,
                "ellipsoidal_m": ground.height_ellipsoid.0,
                "orthometric_m": ground.height_orthometric.0,
                "level": 0,
                "void": ground.void,
                "water": ground.water,
            })
        );
    } else {
        let mark = match (ground.void, ground.water) {
            (true, _) => " (void: not measured)",
            (false, true) => " (water)",
            (false, false) => "",
        };
        say!(
            "{:.2} m above the ellipsoid, {:.2} m above EGM96, level 0{mark}",
            ground.height_ellipsoid.0,
            ground.height_orthometric.0
        );
    }
    Ok(())
}

fn height_failure(args: &HeightArgs, pack: &Pack, error: HeightError) -> Failure {
    let point = format!("{} {}", args.latitude, args.longitude);
    match error {
        HeightError::NoPlace => Failure::new(
            Kind::Usage,
            point,
            "is no place on Earth",
            "give a latitude within 90 degrees and a longitude",
        ),
        HeightError::NotCovered => {
            let b = &pack.info().bounds;
            Failure::new(
                Kind::Input,
                args.pack.display(),
                format!("does not cover {point}"),
                format!(
                    "its sources lie within {} to {} N, {} to {} E; `terrain info` lists them",
                    b.south_deg, b.north_deg, b.west_deg, b.east_deg
                ),
            )
        }
        HeightError::Tile(key, why) => Failure::new(
            Kind::Input,
            args.pack.display(),
            format!("its tile {key} cannot be read: {why}"),
            "copy it again from the original, or bake it again",
        ),
    }
}
