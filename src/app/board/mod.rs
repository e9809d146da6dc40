//! The board file: everything that differs from one cockpit to the next, as TOML.
//!
//! `boards/base.toml` documents every key and holds the defaults; a board file says `inherit = "base"` (or another file
//! beside it) and what differs. It is read once at start: [`Board::load`] finds *everything* that is wrong with it in one
//! go, each problem with file and key path, and there is no other way to a [`Board`].

mod reader;
mod sources;

pub use sources::{Endpoint, SourceWish, decoder};

use crate::app::error::{Failure, Kind};
use crate::app::picture::Size;
use crate::gl::look::Palette;
use crate::screen::{self, ModeWish, Wishes};
use crate::terrain::reach::TARGET_PX;
use crate::units::{Knots, Radians};
use reader::{Problem, Reader};
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// The defaults, as shipped.
const BASE: &str = include_str!("../../../boards/base.toml");

/// Files may inherit from files, this deep at most: enough for base, vendor, board, cockpit.
const INHERIT_DEPTH_MAX: usize = 4;

/// A board file, read and validated.
#[derive(Clone, Debug, PartialEq)]
pub struct Board {
    /// The file it came from.
    pub file: PathBuf,
    /// Where to draw.
    pub screen: ScreenWish,
    /// Horizontal field of view of the picture.
    pub hfov: Radians,
    /// For which eyes terrain and sky are drawn at start.
    pub palette: Palette,
    /// What the pilot reads the altimeter setting in.
    pub pressure: PressureUnit,
    /// Airspeed marks; absent ones are not drawn.
    pub airspeeds: Airspeeds,
    /// Terrain.
    pub terrain: TerrainWish,
    /// Sources of flight data, in order of priority.
    pub sources: Vec<SourceWish>,
    /// Whether knobs and keys are read from `/dev/input`.
    pub input: bool,
}

/// Where to draw, and how.
#[derive(Clone, Debug, PartialEq)]
pub struct ScreenWish {
    /// Which kind, and for KMS what to show on.
    pub kind: screen::Kind,
    /// Size of a headless picture.
    pub size: Size,
    /// Frames per second of a headless screen.
    pub rate_hz: u32,
    /// Samples per pixel: 0 or 4.
    pub samples: u32,
}

/// Unit of the displayed pressure setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PressureUnit {
    /// Hectopascals.
    Hectopascals,
    /// Inches of mercury.
    InchesOfMercury,
}

/// Airspeed marks of the aircraft (14 CFR 23.1545 arcs).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Airspeeds {
    /// Stall, landing configuration.
    pub vs0: Option<Knots>,
    /// Stall, clean.
    pub vs1: Option<Knots>,
    /// Flaps extended.
    pub vfe: Option<Knots>,
    /// Maximum structural cruising.
    pub vno: Option<Knots>,
    /// Never exceed.
    pub vne: Option<Knots>,
}

/// Terrain data and its budget.
#[derive(Clone, Debug, PartialEq)]
pub struct TerrainWish {
    /// The pack; none means no terrain.
    pub pack: Option<PathBuf>,
    /// Vertices along the side of a clipmap level: 127, 175, 191, 255, 319 or 447.
    pub vertices: u32,
    /// Error that pictures may have where levels follow the distance, RMS, pixels.
    pub target_px: f64,
    /// Bytes uploaded per frame at most: texels, tables and blocks.
    pub upload_bytes_per_frame: u32,
    /// Samples decoded per frame at most.
    pub decode_samples_per_frame: u32,
    /// Memory that terrain may take, MiB.
    pub resident_mib: u32,
    /// Whether ground is coloured by its height relative to the aircraft at start.
    pub awareness: bool,
    /// Whether lines of latitude and longitude lie on the ground at start.
    pub grid: bool,
}

impl Board {
    /// Reads and validates a board file.
    ///
    /// # Errors
    /// Everything that is wrong with it, each problem on a line of its own.
    pub fn load(file: &Path) -> Result<Self, Vec<Failure>> {
        let table = read_with_inheritance(file, 0).map_err(|f| vec![f])?;
        Self::from_table(file, table)
    }

    /// The shipped defaults.
    ///
    /// # Errors
    /// Never, unless the program was built with a broken `boards/base.toml` (a test holds it).
    pub fn base() -> Result<Self, Vec<Failure>> {
        let file = Path::new("boards/base.toml");
        let table = parse(file, BASE).map_err(|f| vec![f])?;
        Self::from_table(file, table)
    }

    fn from_table(file: &Path, mut table: Table) -> Result<Self, Vec<Failure>> {
        let mut problems = Vec::new();
        table.remove("inherit");
        let board = read_board(file, table, &mut problems);
        if problems.is_empty() {
            if let Some(board) = board {
                return Ok(board);
            }
            problems.push(Problem::new(
                "",
                "is incomplete",
                "start from boards/base.toml",
            ));
        }
        Err(problems.into_iter().map(|p| p.into_failure(file)).collect())
    }
}

fn parse(file: &Path, text: &str) -> Result<Table, Failure> {
    text.parse::<Table>().map_err(|e| {
        let line = e.span().map_or(0, |s| {
            text[..s.start.min(text.len())].matches('\n').count() + 1
        });
        Failure::new(
            Kind::Usage,
            format!("{}:{line}", file.display()),
            e.message()
                .lines()
                .next()
                .unwrap_or("is not TOML")
                .to_owned(),
            "correct that line; boards/base.toml shows every key",
        )
    })
}

fn read_with_inheritance(file: &Path, depth: usize) -> Result<Table, Failure> {
    let text = std::fs::read_to_string(file).map_err(|e| {
        Failure::new(
            Kind::Usage,
            file.display(),
            format!("the board file cannot be read: {e}"),
            "give one with --board FILE, or copy one of boards/*.toml to /etc/glasswing/board.toml",
        )
    })?;
    let mut table = parse(file, &text)?;
    let parent = match table.get("inherit") {
        None => return Ok(table),
        Some(Value::String(name)) => name.clone(),
        Some(_) => {
            return Err(
                Problem::new("inherit", "is no text", "write inherit = \"base\"")
                    .into_failure(file),
            );
        }
    };
    if depth == INHERIT_DEPTH_MAX {
        let why = format!("inherits more than {INHERIT_DEPTH_MAX} files deep (in a circle?)");
        return Err(Problem::new("inherit", why, "shorten the chain").into_failure(file));
    }
    let mut base = if parent == "base" {
        parse(Path::new("boards/base.toml"), BASE)?
    } else {
        let beside = file.with_file_name(format!("{parent}.toml"));
        read_with_inheritance(&beside, depth + 1)?
    };
    table.remove("inherit");
    merge(&mut base, table);
    Ok(base)
}

/// Tables merge key by key; anything else, lists included, replaces what was inherited.
fn merge(base: &mut Table, over: Table) {
    for (key, value) in over {
        match (base.get_mut(&key), value) {
            (Some(Value::Table(below)), Value::Table(above)) => merge(below, above),
            (_, value) => {
                base.insert(key, value);
            }
        }
    }
}

fn read_board(file: &Path, table: Table, problems: &mut Vec<Problem>) -> Option<Board> {
    let mut root = Reader::new("", table);
    let mut screen = root.table("screen", problems);
    let mut view = root.table("view", problems);
    let mut units = root.table("units", problems);
    let mut airspeeds = root.table("airspeeds", problems);
    let mut terrain = root.table("terrain", problems);
    let mut input = root.table("input", problems);
    let sources = root.tables("source", problems);
    let screen_wish = read_screen(&mut screen, problems);
    let hfov = view.number("hfov_deg", 2.0..=120.0, problems);
    let palettes = [("day", Palette::Day), ("night", Palette::Night)];
    let palette = view.choice("palette", &palettes, problems);
    let pressure = read_units(&mut units, problems);
    let marks = read_airspeeds(&mut airspeeds, problems);
    let terrain_wish = read_terrain(&mut terrain, file, problems);
    let devices = input.flag("devices", problems);
    let sources = sources::read(sources, file, problems);
    for part in [root, screen, view, units, airspeeds, terrain, input] {
        part.finish(problems);
    }
    Some(Board {
        file: file.to_owned(),
        screen: screen_wish?,
        hfov: Radians::from_degrees(hfov?),
        palette: palette?,
        pressure: pressure?,
        airspeeds: marks,
        terrain: terrain_wish?,
        sources,
        input: devices?,
    })
}

fn read_screen(r: &mut Reader, problems: &mut Vec<Problem>) -> Option<ScreenWish> {
    let wishes = Wishes {
        card: r.optional_text("card", problems).map(PathBuf::from),
        connector: r.optional_text("connector", problems),
        mode: r.optional_parsed::<ModeWish>("mode", "WIDTHxHEIGHT or WIDTHxHEIGHT@HZ", problems),
    };
    let kinds = ["auto", "kms", "surfaceless", "osmesa"].map(|name| (name, name));
    let kind = match r.choice("kind", &kinds, problems)? {
        "auto" => screen::Kind::Auto(wishes),
        "kms" => screen::Kind::Kms(wishes),
        "osmesa" => screen::Kind::OsMesa,
        _ => screen::Kind::Surfaceless,
    };
    let size = r.parsed::<Size>("size_px", problems);
    let rate_hz = r.whole("rate_hz", 1..=240, problems);
    let samples = r.choice("antialiasing", &[("none", 0), ("4x", 4)], problems);
    Some(ScreenWish {
        kind,
        size: size?,
        rate_hz: rate_hz?,
        samples: samples?,
    })
}

fn read_units(r: &mut Reader, problems: &mut Vec<Problem>) -> Option<PressureUnit> {
    let units = [
        ("hPa", PressureUnit::Hectopascals),
        ("inHg", PressureUnit::InchesOfMercury),
    ];
    r.choice("pressure", &units, problems)
}

fn read_airspeeds(r: &mut Reader, problems: &mut Vec<Problem>) -> Airspeeds {
    let mut mark = |key| r.optional_number(key, 10.0..=400.0, problems).map(Knots);
    let marks = Airspeeds {
        vs0: mark("vs0_kt"),
        vs1: mark("vs1_kt"),
        vfe: mark("vfe_kt"),
        vno: mark("vno_kt"),
        vne: mark("vne_kt"),
    };
    let given = [
        ("vs0_kt", marks.vs0),
        ("vs1_kt", marks.vs1),
        ("vno_kt", marks.vno),
        ("vne_kt", marks.vne),
    ];
    let mut last: Option<(&str, Knots)> = None;
    for (key, speed) in given {
        let Some(speed) = speed else { continue };
        if let Some((below, lower)) = last
            && speed.0 < lower.0
        {
            let why = format!("{} kt is less than {below} ({} kt)", speed.0, lower.0);
            problems.push(Problem::new(
                &r.path(key),
                why,
                "give vs0 <= vs1 <= vno <= vne",
            ));
        }
        last = Some((key, speed));
    }
    marks
}

fn read_terrain(r: &mut Reader, file: &Path, problems: &mut Vec<Problem>) -> Option<TerrainWish> {
    // A relative pack path is meant beside the board file, wherever the program was started.
    let pack = r
        .optional_text("pack", problems)
        .map(|p| file.parent().unwrap_or(Path::new("")).join(p));
    let vertices = r.choice_of_number("vertices", &[127, 175, 191, 255, 319, 447], problems);
    let target_px = r.number("target_px", TARGET_PX, problems);
    let upload = r.whole("upload_bytes_per_frame", 131_072..=16_777_216, problems);
    let decode = r.whole("decode_samples_per_frame", 16_384..=4_194_304, problems);
    let resident = r.whole("resident_mib", 8..=4096, problems);
    let awareness = r.flag("awareness", problems);
    let grid = r.flag("grid", problems);
    Some(TerrainWish {
        pack,
        vertices: vertices?,
        target_px: target_px?,
        upload_bytes_per_frame: upload?,
        decode_samples_per_frame: decode?,
        resident_mib: resident?,
        awareness: awareness?,
        grid: grid?,
    })
}

#[cfg(test)]
mod tests;
