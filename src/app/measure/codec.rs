//! `measure codec`: what the codecs make of elevation: bits a sample, errors, and the time both ways.
//!
//! An input becomes tiles as a bake makes them: holes filled and marked, flat areas water, posts outside it void at sea
//! level; its levels are every second post of the finer one, down to a single tile. A pack gives its own tiles, with the
//! coarse posts that its bake raised. Everything is on one thread and counted in its CPU time.

use super::codec_report::{plots, table};
use super::{Progress, accuracy, not_written, parse_positive, prepare, speed, write};
use crate::app::cockpit;
use crate::app::error::{Failure, Kind};
use crate::app::out;
use crate::terrain::bake_fill::{Window, fill_holes, water};
use crate::terrain::codec::{CodecError, Decoder, Encoder, SurfaceKind, Tile};
use crate::terrain::grid::{TILE_AREA, TILE_SIDE, TileKey};
use crate::terrain::input;
use crate::terrain::pack::TileReader;
use crate::terrain::partition::Partition;
use crate::terrain::plain::PlainGrids;
use crate::terrain::planet::{self, Planet};
use crate::terrain::pyramid::{Parent, PyramidDecoder, PyramidEncoder, parent_of, step_of};
use crate::terrain::raster::{Raster, Samples};
use crate::terrain::store::Scale;
use crate::terrain::surface::TileSource;
use rustix::time::ClockId;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The bounds of the published figures, metres: lossless, and half a metre less than nothing rounds to.
const BOUNDS_M: [f64; 5] = [0.0, 1.5, 2.5, 4.5, 8.5];
/// Finest tiles of a pack that are measured at most: 750 MB with what is made of them.
const TILES_MAX: usize = 4000;
/// Finest tiles along a side of the part of the planet that is measured.
const PLANET_TILES: i32 = 8;

/// Arguments of `measure codec`.
#[derive(Debug, clap::Args)]
pub struct CodecArgs {
    /// Elevation files, as `terrain bake` takes them; also grey PNG of 16 bits
    #[arg(value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// Measure the tiles of this terrain pack too
    #[arg(long, value_name = "PACK")]
    pack: Option<PathBuf>,
    /// Write all figures to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write plots (SVG) of rate against error into this folder
    #[arg(long, value_name = "DIR")]
    plot: Option<PathBuf>,
    /// A bound of the pyramid's error, metres; may be given several times. 0, 1.5, 2.5, 4.5 and 8.5 if not given
    #[arg(long, value_name = "METRES", value_parser = parse_bound)]
    bound: Vec<f64>,
    /// Height of one unit of a PNG, metres
    #[arg(long, value_name = "METRES", default_value_t = 1.0, value_parser = parse_positive)]
    png_unit: f64,
    /// Unpack again until this much CPU time has been used, seconds
    #[arg(long, value_name = "S", default_value_t = 0.3, value_parser = parse_positive)]
    seconds: f64,
}

fn parse_bound(text: &str) -> Result<f64, String> {
    let number = text
        .parse()
        .ok()
        .filter(|v: &f64| (0.0..=1000.0).contains(v));
    number.ok_or_else(|| "a number of metres from 0 to 1000 is needed".to_owned())
}

/// Runs the command.
///
/// # Errors
/// [`Failure`]: an input or a pack that is missing or damaged (3), a file that cannot be written (1).
pub fn run(args: &CodecArgs) -> Result<(), Failure> {
    for path in [&args.json, &args.plot].into_iter().flatten() {
        prepare(path, Some(path) == args.plot.as_ref())?;
    }
    let bounds = if args.bound.is_empty() {
        &BOUNDS_M[..]
    } else {
        &args.bound
    };
    let seconds = Duration::from_secs_f64(args.seconds.clamp(0.001, 60.0));
    let progress = Progress::new();
    let mut rows = Vec::new();
    let mut one = |name: &str, field: &Field| -> Result<(), Failure> {
        progress.say(name);
        rows.extend(measure(name, field, bounds, seconds).map_err(|e| {
            let why = format!("does not come back from a codec: {e}");
            Failure::new(Kind::Other, name, why, "report this")
        })?);
        Ok(())
    };
    for path in &args.inputs {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        one(&name, &Field::read(path, args.png_unit)?)?;
    }
    if let Some(path) = &args.pack {
        let pack = cockpit::open_pack(path)?;
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        one(&name, &Field::of_source(&pack, pack.keys(), path)?)?;
    }
    if args.inputs.is_empty() && args.pack.is_none() {
        let planet = Planet::new(planet::Kind::Earth, 1200);
        one("planet", &Field::of_planet(&planet)?)?;
    }
    progress.bar.finish_and_clear();
    let value = json!({
        "inputs": rows,
        "how": "bits_per_sample: stored bytes of the tiles over the samples of the input; lossless: of the finest level, \
                pyramid: of all levels (all_levels_bits: of all levels for both); max_error_m and rms_error_m: decoded \
                against what was given, posts that are not void, at the finest level (level_max_error_m: level by level, \
                the finest first); speeds: posts of the finest level's tiles over the CPU time of one thread in the quickest of \
                several passes, for the pyramid \
                with all coarser levels in it, from memory to memory",
        "optimised": !cfg!(debug_assertions),
        "architecture": std::env::consts::ARCH,
    });
    out::write(format_args!("{}", table(&value)));
    if let Some(path) = &args.json {
        write(path, &format!("{value:#}\n"))?;
    }
    if let Some(folder) = &args.plot {
        for (name, svg) in plots(&value) {
            let path = folder.join(name);
            std::fs::write(&path, svg).map_err(|e| not_written(&path, e))?;
        }
    }
    Ok(())
}

/// One level of what is measured, in the order of keys.
#[derive(Default)]
struct Level {
    keys: Vec<TileKey>,
    /// The place of a tile's parent in the next level.
    parents: Vec<Option<usize>>,
    tiles: Vec<Tile>,
}

/// What is measured: levels of tiles, the finest first.
struct Field {
    unit_m: f64,
    /// Samples of the input.
    samples: usize,
    levels: Vec<Level>,
}

impl Field {
    fn read(path: &Path, png_unit_m: f64) -> Result<Self, Failure> {
        let is_png = path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("png"));
        if is_png {
            let (columns, samples) = grey(path)?;
            let posts = samples
                .into_iter()
                .map(|q| (q, SurfaceKind::Land))
                .collect();
            return Ok(Self::of_posts(columns, posts, png_unit_m, 0));
        }
        let refused =
            |e: input::InputError| Failure::new(Kind::Input, path.display(), &e, e.remedy());
        let raster = input::read(path, &PlainGrids::default(), None).map_err(refused)?;
        let scale = scale(&raster);
        let posts = posts(&raster, scale);
        let sea = scale.quanta(0.0);
        Ok(Self::of_posts(
            raster.geometry.columns,
            posts,
            scale.unit_m,
            sea,
        ))
    }

    /// Posts row by row; beyond them is void at the quanta `outside`.
    fn of_posts(
        columns: usize,
        mut posts: Vec<(u16, SurfaceKind)>,
        unit_m: f64,
        outside: u16,
    ) -> Self {
        let samples = posts.len();
        let mut columns = columns.max(1);
        let side = TILE_SIDE.cast_unsigned() as usize;
        let mut levels = Vec::new();
        for level in 0.. {
            let rows = posts.len() / columns;
            let mut own = BTreeMap::new();
            for (at, (quanta, kind)) in posts.iter().enumerate() {
                let (i, j) = (signed(at % columns), signed(at / columns));
                let key = TileKey::of_post(Partition::Geographic, level, i, j);
                let tile = own
                    .entry(key)
                    .or_insert_with(|| Tile::filled(outside, SurfaceKind::Void));
                let at = TileKey::index_of(i, j);
                (tile.quanta[at], tile.kind[at]) = (*quanta, *kind);
            }
            levels.push(own);
            if rows <= side && columns <= side {
                break;
            }
            let halved = posts.chunks_exact(columns).step_by(2);
            posts = halved
                .flat_map(|row| row.iter().step_by(2).copied())
                .collect();
            columns = columns.div_ceil(2);
        }
        Self::new(unit_m, samples, levels)
    }

    fn new(unit_m: f64, samples: usize, levels: Vec<BTreeMap<TileKey, Tile>>) -> Self {
        let keys: Vec<Vec<TileKey>> = levels.iter().map(|l| l.keys().copied().collect()).collect();
        let parents = |level: usize| -> Vec<Option<usize>> {
            let above = keys.get(level + 1).map_or(&[][..], Vec::as_slice);
            let find = |k: &TileKey| above.binary_search(&parent_of(*k)).ok();
            keys[level].iter().map(find).collect()
        };
        let levels = levels.into_iter().enumerate().map(|(at, tiles)| Level {
            keys: keys[at].clone(),
            parents: parents(at),
            tiles: tiles.into_values().collect(),
        });
        Self {
            unit_m,
            samples,
            levels: levels.collect(),
        }
    }

    /// Tiles of a source by their keys, with those above them.
    fn of_source<S: TileSource>(
        source: &S,
        keys: impl Iterator<Item = TileKey>,
        path: &Path,
    ) -> Result<Self, Failure> {
        let finest = keys.filter(|k| k.partition == Partition::Geographic && k.level == 0);
        let mut wanted: Vec<TileKey> = finest.take(TILES_MAX).collect();
        let (mut reader, mut levels, mut samples) = (TileReader::new(), Vec::new(), 0);
        while !wanted.is_empty() {
            let mut own = BTreeMap::new();
            for key in &wanted {
                let mut tile = Tile::filled(0, SurfaceKind::Void);
                source
                    .read_tile(*key, &mut reader, &mut tile)
                    .map_err(|e| {
                        let why = format!("its tile {key} cannot be read: {e}");
                        let todo = "copy it again from the original, or bake it again";
                        Failure::new(Kind::Input, path.display(), why, todo)
                    })?;
                if key.level == 0 {
                    samples += TILE_AREA;
                }
                own.insert(*key, tile);
            }
            wanted = wanted.into_iter().map(parent_of).collect();
            wanted.sort_unstable();
            wanted.dedup();
            wanted.retain(|k| k.level < source.info().levels && source.contains(*k));
            levels.push(own);
        }
        Ok(Self::new(source.info().unit_m, samples, levels))
    }

    fn of_planet(planet: &Planet) -> Result<Self, Failure> {
        let (latitude, longitude) = accuracy::mountains(planet);
        let grid = planet.info().grid;
        #[expect(clippy::cast_possible_truncation, reason = "a place on Earth")]
        let post = |degrees: f64| (degrees * f64::from(grid.posts_per_degree)) as i32;
        let middle = TileKey::of_post(Partition::Geographic, 0, post(longitude), post(latitude));
        let keys = (0..PLANET_TILES * PLANET_TILES).map(|n| TileKey {
            column: middle.column + n % PLANET_TILES,
            row: middle.row + n / PLANET_TILES,
            ..middle
        });
        Self::of_source(planet, keys, Path::new("planet"))
    }
}

/// A count of posts as a coordinate.
fn signed(count: usize) -> i32 {
    i32::try_from(count).unwrap_or(i32::MAX)
}

/// The scale that a bake gives such samples: whole metres, or the finest of 1/32 to 1/2 m that reaches from end to end.
fn scale(raster: &Raster) -> Scale {
    let (low, high) = raster
        .contents()
        .range_m
        .map_or((0.0, 0.0), |(low, high)| (f64::from(low), f64::from(high)));
    if matches!(raster.samples, Samples::Whole(_)) {
        let base_m = if low >= -1000.0 { -1000.0 } else { -12_000.0 };
        return Scale {
            unit_m: 1.0,
            base_m,
        };
    }
    let base_m = low.floor().min(0.0);
    let span = high.max(0.0) - base_m;
    let units = [0.031_25, 0.0625, 0.125, 0.25];
    let unit_m = units.into_iter().find(|u| span / u <= f64::from(u16::MAX));
    Scale {
        unit_m: unit_m.unwrap_or(0.5),
        base_m,
    }
}

/// The posts of a raster as a bake stores them.
fn posts(raster: &Raster, scale: Scale) -> Vec<(u16, SurfaceKind)> {
    let window = Window {
        columns: raster.geometry.columns,
        rows: raster.geometry.rows,
    };
    let mut heights: Vec<f32> = match &raster.samples {
        Samples::Whole(all) => all
            .iter()
            .map(|s| {
                if *s == i16::MIN {
                    f32::NAN
                } else {
                    f32::from(*s)
                }
            })
            .collect(),
        Samples::Fractional(all) => all.clone(),
    };
    let hole: Vec<bool> = heights.iter().map(|h| h.is_nan()).collect();
    let quanta = |h: &f32| scale.quanta(f64::from(*h));
    let measured: Vec<Option<u16>> = heights
        .iter()
        .map(|h| (!h.is_nan()).then(|| quanta(h)))
        .collect();
    fill_holes(&window, &mut heights, &hole, 0.0);
    let water = water(&window, &measured);
    let kinds = hole
        .iter()
        .zip(water)
        .map(|(hole, water)| match (hole, water) {
            (true, _) => SurfaceKind::Void,
            (false, true) => SurfaceKind::Water,
            (false, false) => SurfaceKind::Land,
        });
    heights.iter().map(quanta).zip(kinds).collect()
}

/// Columns and samples of a grey PNG of 16 bits.
fn grey(path: &Path) -> Result<(usize, Vec<u16>), Failure> {
    let refused = |why: String| {
        let todo = "give a grey PNG of 16 bits";
        Failure::new(Kind::Input, path.display(), why, todo)
    };
    let file =
        std::fs::File::open(path).map_err(|e| refused("cannot be read".into()).caused_by(e))?;
    let decoder = png::Decoder::new(std::io::BufReader::new(file));
    let mut reader = decoder
        .read_info()
        .map_err(|e| refused(format!("is no PNG: {e}")))?;
    let mut bytes = vec![0; reader.output_buffer_size().unwrap_or(0)];
    let info = reader
        .next_frame(&mut bytes)
        .map_err(|e| refused(format!("is damaged: {e}")))?;
    if (info.color_type, info.bit_depth) != (png::ColorType::Grayscale, png::BitDepth::Sixteen) {
        return Err(refused(format!(
            "has {:?} of {:?} bits",
            info.color_type, info.bit_depth
        )));
    }
    let samples = bytes[..info.buffer_size()].chunks_exact(2);
    Ok((
        info.width as usize,
        samples.map(|b| u16::from_be_bytes([b[0], b[1]])).collect(),
    ))
}

/// Errors of decoded tiles.
#[derive(Clone, Copy, Default)]
struct Errors {
    squares: f64,
    posts: u64,
    max: u16,
}

impl Errors {
    fn add(&mut self, given: &Tile, decoded: &Tile) {
        let posts = given
            .quanta
            .iter()
            .zip(decoded.quanta.iter())
            .zip(given.kind.iter());
        for ((given, decoded), kind) in posts {
            let error = given.abs_diff(*decoded);
            // A void is drawn where it was filled: its error counts, but there are no samples behind it to average.
            self.max = self.max.max(error);
            if *kind != SurfaceKind::Void {
                self.squares += f64::from(error).powi(2);
                self.posts += 1;
            }
        }
    }

    #[expect(clippy::cast_precision_loss, reason = "far fewer than 2^53 posts")]
    fn rms(&self) -> f64 {
        (self.squares / self.posts.max(1) as f64).sqrt()
    }
}

/// Does something again until so much CPU time of this thread has gone by; gives the time of the quickest, since what else
/// the machine does can only make it slower.
fn timed(
    least: Duration,
    mut work: impl FnMut() -> Result<(), CodecError>,
) -> Result<f64, CodecError> {
    let (mut used, mut quickest) = (Duration::ZERO, Duration::MAX);
    loop {
        let begun = speed::cpu(ClockId::ThreadCPUTime);
        work()?;
        let spent = speed::cpu(ClockId::ThreadCPUTime).saturating_sub(begun);
        (used, quickest) = (used + spent, quickest.min(spent));
        if used >= least {
            return Ok(quickest.as_secs_f64());
        }
    }
}

fn measure(
    name: &str,
    field: &Field,
    bounds: &[f64],
    least: Duration,
) -> Result<Vec<Value>, CodecError> {
    let mut rows = vec![lossless(field, least)?];
    for bound_m in bounds {
        rows.push(pyramid(field, *bound_m, least)?);
    }
    for row in &mut rows {
        row["input"] = name.into();
        row["unit_m"] = field.unit_m.into();
        row["samples"] = field.samples.into();
        row["levels"] = field.levels.len().into();
    }
    Ok(rows)
}

/// What both codecs are told by.
struct Found {
    codec: &'static str,
    bound_m: f64,
    finest_bytes: usize,
    all_bytes: usize,
    encode_s: f64,
    decode_s: f64,
    errors: Vec<Errors>,
}

impl Found {
    #[expect(clippy::cast_precision_loss, reason = "far fewer than 2^53 bits")]
    fn row(&self, field: &Field) -> Value {
        let bits = |bytes: usize| bytes as f64 * 8.0 / field.samples as f64;
        let posts = field
            .levels
            .first()
            .map_or(0, |l| l.tiles.len() * TILE_AREA) as f64;
        let finest = self.errors.first().copied().unwrap_or_default();
        let stored = if self.codec == "pyramid" {
            self.all_bytes
        } else {
            self.finest_bytes
        };
        let by_level = self.errors.iter().map(|e| f64::from(e.max) * field.unit_m);
        json!({
            "codec": self.codec,
            "bound_m": self.bound_m,
            "bits_per_sample": bits(stored),
            "all_levels_bits": bits(self.all_bytes),
            "max_error_m": f64::from(finest.max) * field.unit_m,
            "rms_error_m": finest.rms() * field.unit_m,
            "encode_msamples_per_s": posts / self.encode_s / 1e6,
            "decode_msamples_per_s": posts / self.decode_s / 1e6,
            "level_max_error_m": by_level.collect::<Vec<f64>>(),
        })
    }
}

/// The codec of packs without a bound.
fn lossless(field: &Field, least: Duration) -> Result<Value, CodecError> {
    let (mut encoder, mut decoder) = (Encoder::new(), Decoder::new());
    let mut tile = Tile::filled(0, SurfaceKind::Void);
    let mut stored: Vec<Vec<Vec<u8>>> = Vec::new();
    let mut encode_s = 0.0;
    for (number, level) in field.levels.iter().enumerate() {
        let mut own = Vec::new();
        let spent = timed(Duration::ZERO, || {
            own = level.tiles.iter().map(|t| encoder.encode(t)).collect();
            Ok(())
        })?;
        if number == 0 {
            encode_s = spent;
        }
        stored.push(own);
    }
    let mut errors = Vec::new();
    for (level, stored) in field.levels.iter().zip(&stored) {
        let mut own = Errors::default();
        for (given, stored) in level.tiles.iter().zip(stored) {
            decoder.decode(stored, &mut tile)?;
            own.add(given, &tile);
        }
        errors.push(own);
    }
    let finest = stored.first().map_or(&[][..], Vec::as_slice);
    let decode_s = timed(least, || {
        let mut all = finest.iter();
        all.try_for_each(|stored| decoder.decode(stored, &mut tile))
    })?;
    let bytes = |level: &[Vec<u8>]| level.iter().map(Vec::len).sum::<usize>();
    let found = Found {
        codec: "lossless",
        bound_m: 0.0,
        finest_bytes: bytes(finest),
        all_bytes: stored.iter().map(|l| bytes(l)).sum(),
        encode_s,
        decode_s,
        errors,
    };
    Ok(found.row(field))
}

/// The codec of packs with a bound.
fn pyramid(field: &Field, bound_m: f64, least: Duration) -> Result<Value, CodecError> {
    let step = step_of(bound_m / field.unit_m + 1e-9);
    let mut encoder = PyramidEncoder::new();
    let blank = |level: &Level| vec![Tile::filled(0, SurfaceKind::Void); level.tiles.len()];
    let mut decoded: Vec<Vec<Tile>> = field.levels.iter().map(blank).collect();
    let mut stored: Vec<Vec<Vec<u8>>> = vec![Vec::new(); decoded.len()];
    let encode_s = timed(Duration::ZERO, || {
        for (number, level) in field.levels.iter().enumerate().rev() {
            let (own, above) = decoded.split_at_mut(number + 1);
            stored[number].clear();
            for (at, tile) in level.tiles.iter().enumerate() {
                let parent = parent(level, at, above.first());
                let promised = &mut own[number][at];
                stored[number].push(encoder.encode(tile, parent, step, promised));
            }
        }
        Ok(())
    })?;
    // What a reader has, from the bytes alone.
    for tile in decoded.iter_mut().flatten() {
        tile.quanta.fill(0);
    }
    let mut decoder = PyramidDecoder::new();
    let decode_s = timed(least, || {
        for (number, level) in field.levels.iter().enumerate().rev() {
            let (own, above) = decoded.split_at_mut(number + 1);
            for (at, stored) in stored[number].iter().enumerate() {
                let parent = parent(level, at, above.first());
                decoder.decode(stored, parent, &mut own[number][at])?;
            }
        }
        Ok(())
    })?;
    let errors = field.levels.iter().zip(&decoded).map(|(level, decoded)| {
        let mut own = Errors::default();
        for (given, decoded) in level.tiles.iter().zip(decoded) {
            own.add(given, decoded);
        }
        own
    });
    let bytes = |level: &Vec<Vec<u8>>| level.iter().map(Vec::len).sum::<usize>();
    let found = Found {
        codec: "pyramid",
        bound_m,
        finest_bytes: stored.first().map_or(0, bytes),
        all_bytes: stored.iter().map(bytes).sum(),
        encode_s,
        decode_s,
        errors: errors.collect(),
    };
    Ok(found.row(field))
}

fn parent<'a>(level: &Level, at: usize, above: Option<&'a Vec<Tile>>) -> Option<Parent<'a>> {
    let tile = above?.get(level.parents[at]?)?;
    Some(Parent::new(tile, level.keys[at]))
}
