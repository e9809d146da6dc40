//! Plain grids: heights in rows and columns that do not say where they lie. Pure.
//!
//! Text is a line of numbers for each row, parted by blanks, tabs, commas or semicolons; lines that begin with `#` are left
//! out. An Esri ASCII grid (its keys `ncols`, `nrows`, `xllcorner` or `xllcenter`, `yllcorner` or `yllcenter`, `cellsize`,
//! `nodata_value`, then the rows from the north; Esri, "ASCII raster format") is such a text that does say where it lies.
//! A PNG is one of 8 or 16 bits of grey. Raw files are samples and nothing else.

use crate::terrain::input::InputError;
use crate::terrain::pack::Bounds;
use crate::terrain::raster::{Crs, Geometry, Raster, Samples};
use std::io::Cursor;

/// The most samples read from one file.
const SAMPLES_MAX: usize = 200_000_000;

/// The type of a raw file's samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RawType {
    /// 16-bit signed, little-endian.
    I16Le,
    /// 16-bit signed, big-endian.
    I16Be,
    /// 16-bit unsigned, little-endian.
    U16Le,
    /// 16-bit unsigned, big-endian.
    U16Be,
    /// 32-bit IEEE 754, little-endian.
    F32Le,
    /// 32-bit IEEE 754, big-endian.
    F32Be,
}

/// Every raw type by its name on the command line.
pub const RAW_TYPES: [(&str, RawType); 6] = [
    ("i16le", RawType::I16Le),
    ("i16be", RawType::I16Be),
    ("u16le", RawType::U16Le),
    ("u16be", RawType::U16Be),
    ("f32le", RawType::F32Le),
    ("f32be", RawType::F32Be),
];

impl RawType {
    const fn bytes(self) -> usize {
        match self {
            Self::I16Le | Self::I16Be | Self::U16Le | Self::U16Be => 2,
            Self::F32Le | Self::F32Be => 4,
        }
    }

    fn read(self, bytes: &[u8]) -> f32 {
        match (self, bytes) {
            (Self::I16Le, &[a, b]) => f32::from(i16::from_le_bytes([a, b])),
            (Self::I16Be, &[a, b]) => f32::from(i16::from_be_bytes([a, b])),
            (Self::U16Le, &[a, b]) => f32::from(u16::from_le_bytes([a, b])),
            (Self::U16Be, &[a, b]) => f32::from(u16::from_be_bytes([a, b])),
            (Self::F32Le, &[a, b, c, d]) => f32::from_le_bytes([a, b, c, d]),
            (Self::F32Be, &[a, b, c, d]) => f32::from_be_bytes([a, b, c, d]),
            _ => f32::NAN,
        }
    }
}

/// How plain grids are to be read: what they do not say themselves.
#[derive(Clone, Debug, PartialEq)]
pub struct PlainGrids {
    /// Where they lie, one for each in their order, degrees; the east may pass 180.
    pub bounds: Vec<Bounds>,
    /// Whether the bounds are those of the outermost posts, not of the edges of cells around them.
    pub bounds_on_posts: bool,
    /// Whether the first row is the southernmost.
    pub south_first: bool,
    /// Metres per unit of a sample.
    pub unit_m: f64,
    /// The sample that stands for none.
    pub nodata: Option<f64>,
    /// Columns, rows and sample type of raw files.
    pub raw: Option<(usize, usize, RawType)>,
}

impl Default for PlainGrids {
    fn default() -> Self {
        Self {
            bounds: Vec::new(),
            bounds_on_posts: false,
            south_first: false,
            unit_m: 1.0,
            nodata: None,
            raw: None,
        }
    }
}

/// The kinds of plain grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlainKind {
    /// Numbers as text, perhaps with the header of an Esri ASCII grid.
    Text,
    /// Grey PNG.
    Png,
    /// Nothing but samples.
    Raw,
}

/// The kind of plain grid that a file name stands for, in lower case and without `.gz`.
#[must_use]
pub fn kind(name: &str) -> Option<PlainKind> {
    let (stem, gzipped) = name
        .strip_suffix(".gz")
        .map_or((name, false), |n| (n, true));
    let ends = |all: &[&str]| all.iter().any(|end| stem.ends_with(end));
    if ends(&[".png"]) {
        Some(PlainKind::Png)
    } else if ends(&[".raw", ".bin", ".bil", ".flt"]) {
        Some(PlainKind::Raw)
    } else if ends(&[".txt", ".asc", ".csv", ".grd"]) || gzipped && !ends(&[".hgt", ".tif"]) {
        Some(PlainKind::Text)
    } else {
        None
    }
}

/// Samples in rows, before it is known where they lie.
struct Table {
    columns: usize,
    samples: Vec<f32>,
    /// Where an Esri header says that the south-western cell lies, whether that is its centre, the spacing, and what stands
    /// for no height.
    esri: Option<Esri>,
}

/// The header of an Esri ASCII grid.
#[derive(Default)]
struct Esri {
    columns: Option<f64>,
    rows: Option<f64>,
    west: Option<(f64, bool)>,
    south: Option<(f64, bool)>,
    step: Option<f64>,
    nodata: Option<f64>,
}

/// Reads a plain grid; `place` is where it lies, if that was said.
///
/// # Errors
/// If it is damaged, is not a table, or neither says nor was said where it lies.
pub fn read(
    kind: PlainKind,
    bytes: &[u8],
    grids: &PlainGrids,
    place: Option<&Bounds>,
) -> Result<Raster, InputError> {
    let table = match kind {
        PlainKind::Text => text(bytes)?,
        PlainKind::Png => picture(bytes)?,
        PlainKind::Raw => raw(bytes, grids)?,
    };
    let rows = table.samples.len() / table.columns.max(1);
    if table.columns < 2 || rows < 2 {
        return Err(InputError::Plain(format!(
            "has {} x {rows} samples; a grid has two rows and columns at least",
            table.columns
        )));
    }
    let (geometry, own_nodata) = match (&table.esri, place) {
        (Some(esri), None) => (esri.geometry(table.columns, rows)?, esri.nodata),
        (Some(_), Some(_)) => {
            return Err(InputError::Plain(
                "says itself where it lies, and was told so by --bounds too".to_owned(),
            ));
        }
        (None, Some(place)) => (lie(table.columns, rows, place, grids), None),
        (None, None) => return Err(InputError::NoBounds),
    };
    let mut samples = table.samples;
    if grids.south_first && table.esri.is_none() {
        samples = samples
            .chunks_exact(table.columns)
            .rev()
            .flatten()
            .copied()
            .collect();
    }
    let nodata = grids.nodata.or(own_nodata);
    for s in &mut samples {
        let value = f64::from(*s);
        // A marker is written with as many digits as its writer liked: it is compared as the type that holds it.
        #[expect(clippy::cast_possible_truncation, reason = "as said")]
        let is_none = nodata.is_some_and(|n| (n as f32).to_bits() == s.to_bits());
        #[expect(clippy::cast_possible_truncation, reason = "heights on Earth")]
        {
            *s = if is_none {
                f32::NAN
            } else {
                (value * grids.unit_m) as f32
            };
        }
    }
    let mut raster = Raster {
        geometry,
        samples: Samples::Fractional(samples),
    };
    raster.mark_voids(None);
    raster.close();
    Ok(raster)
}

/// The geometry of a table within bounds.
fn lie(columns: usize, rows: usize, place: &Bounds, grids: &PlainGrids) -> Geometry {
    #[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
    let (wide, high) = (columns as f64, rows as f64);
    let (width, height) = (
        place.east_deg - place.west_deg,
        place.north_deg - place.south_deg,
    );
    let (step_east, step_south, half) = if grids.bounds_on_posts {
        (width / (wide - 1.0), height / (high - 1.0), 0.0_f64)
    } else {
        (width / wide, height / high, 0.5)
    };
    Geometry {
        crs: Crs::Geographic,
        columns,
        rows,
        west: normal(f64::mul_add(half, step_east, place.west_deg)),
        north: place.north_deg - half * step_south,
        step_east,
        step_south,
    }
}

fn normal(longitude: f64) -> f64 {
    (longitude + 180.0).rem_euclid(360.0) - 180.0
}

impl Esri {
    /// Takes a line of a header; false if it is none.
    fn take(&mut self, words: &[&str]) -> bool {
        let &[key, value] = words else { return false };
        let Ok(value) = value.parse::<f64>() else {
            return false;
        };
        match key.to_ascii_lowercase().as_str() {
            "ncols" => self.columns = Some(value),
            "nrows" => self.rows = Some(value),
            "xllcorner" => self.west = Some((value, false)),
            "xllcenter" => self.west = Some((value, true)),
            "yllcorner" => self.south = Some((value, false)),
            "yllcenter" => self.south = Some((value, true)),
            "cellsize" => self.step = Some(value),
            "nodata_value" => self.nodata = Some(value),
            _ => return false,
        }
        true
    }

    fn geometry(&self, columns: usize, rows: usize) -> Result<Geometry, InputError> {
        #[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
        let (wide, high) = (columns as f64, rows as f64);
        let said = |n: Option<f64>, is: f64| n.is_none_or(|n| (n - is).abs() < 0.5);
        if !said(self.columns, wide) || !said(self.rows, high) {
            return Err(InputError::Plain(format!(
                "has {columns} x {rows} samples, and its header says others (ncols, nrows)"
            )));
        }
        let (Some((x, x_centre)), Some((y, y_centre)), Some(step)) =
            (self.west, self.south, self.step)
        else {
            return Err(InputError::Plain(
                "its header lacks xllcorner, yllcorner or cellsize".to_owned(),
            ));
        };
        let half = |centre: bool| if centre { 0.0 } else { 0.5 * step };
        let (west, south) = (x + half(x_centre), y + half(y_centre));
        let north = step.mul_add(high - 1.0, south);
        let east = step.mul_add(wide - 1.0, west);
        let on_earth =
            step > 0.0 && south >= -90.0 && north <= 90.0 && west >= -360.0 && east <= 540.0;
        if !on_earth {
            return Err(InputError::Plain(format!(
                "its header places it from {south} to {north} N and {west} to {east} E, which are no degrees"
            )));
        }
        Ok(Geometry {
            crs: Crs::Geographic,
            columns,
            rows,
            west: normal(west),
            north,
            step_east: step,
            step_south: step,
        })
    }
}

fn text(bytes: &[u8]) -> Result<Table, InputError> {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return Err(InputError::Plain("is no text".to_owned()));
    };
    let mut esri = Esri::default();
    let mut has_header = false;
    let mut table = Table {
        columns: 0,
        samples: Vec::new(),
        esri: None,
    };
    for (line, words) in (1..).zip(text.lines()) {
        if words.trim_start().starts_with('#') {
            continue;
        }
        let parted = |c: char| c.is_ascii_whitespace() || c == ',' || c == ';';
        let before = table.samples.len();
        let mut bad = None;
        for word in words.split(parted).filter(|w| !w.is_empty()) {
            match word.parse::<f32>() {
                Ok(height) => table.samples.push(height),
                Err(_) => bad = bad.or(Some(word)),
            }
        }
        if let Some(bad) = bad {
            table.samples.truncate(before);
            let all: Vec<&str> = words.split(parted).filter(|w| !w.is_empty()).collect();
            if table.samples.is_empty() && esri.take(&all) {
                has_header = true;
                continue;
            }
            let bad: String = bad.chars().take(40).collect();
            return Err(InputError::Plain(format!(
                "line {line}: `{bad}` is no number"
            )));
        }
        let count = table.samples.len() - before;
        if count == 0 {
            continue;
        }
        if table.columns == 0 {
            table.columns = count;
        } else if count != table.columns {
            return Err(InputError::Plain(format!(
                "line {line} has {count} numbers, the first row {}",
                table.columns
            )));
        }
        if table.samples.len() > SAMPLES_MAX {
            return Err(InputError::Plain(format!("has over {SAMPLES_MAX} samples")));
        }
    }
    table.esri = has_header.then_some(esri);
    Ok(table)
}

fn picture(bytes: &[u8]) -> Result<Table, InputError> {
    let damaged = |e: png::DecodingError| InputError::Plain(format!("is a damaged PNG: {e}"));
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::IDENTITY);
    let mut reader = decoder.read_info().map_err(damaged)?;
    let info = reader.info();
    let (columns, rows) = (info.width as usize, info.height as usize);
    let wide = match (info.color_type, info.bit_depth) {
        (png::ColorType::Grayscale, png::BitDepth::Sixteen) => true,
        (png::ColorType::Grayscale, png::BitDepth::Eight) => false,
        (colour, depth) => {
            return Err(InputError::Plain(format!(
                "is a PNG of {colour:?} in {} bits; heights are Grayscale in 8 or 16",
                depth as u8
            )));
        }
    };
    let size = reader
        .output_buffer_size()
        .filter(|s| *s <= SAMPLES_MAX * 2);
    let Some(size) = size else {
        return Err(InputError::Plain(format!("has over {SAMPLES_MAX} samples")));
    };
    let mut pixels = vec![0; size];
    reader.next_frame(&mut pixels).map_err(damaged)?;
    let samples = if wide {
        let pairs = pixels.chunks_exact(2);
        pairs
            .map(|b| f32::from(u16::from_be_bytes([b[0], b[1]])))
            .take(columns * rows)
            .collect()
    } else {
        pixels
            .iter()
            .map(|b| f32::from(*b))
            .take(columns * rows)
            .collect()
    };
    Ok(Table {
        columns,
        samples,
        esri: None,
    })
}

fn raw(bytes: &[u8], grids: &PlainGrids) -> Result<Table, InputError> {
    let Some((columns, rows, kind)) = grids.raw else {
        return Err(InputError::Plain(
            "is raw: its columns, rows and type are not known (give --raw COLUMNSxROWS,TYPE)"
                .to_owned(),
        ));
    };
    let want = columns
        .checked_mul(rows)
        .and_then(|n| n.checked_mul(kind.bytes()));
    if want != Some(bytes.len()) || columns * rows > SAMPLES_MAX {
        return Err(InputError::Plain(format!(
            "has {} bytes, and {columns} x {rows} samples of {} bytes were announced by --raw",
            bytes.len(),
            kind.bytes()
        )));
    }
    let samples = bytes
        .chunks_exact(kind.bytes())
        .map(|b| kind.read(b))
        .collect();
    Ok(Table {
        columns,
        samples,
        esri: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLACE: Bounds = Bounds {
        south_deg: 46.0,
        north_deg: 48.0,
        west_deg: 10.0,
        east_deg: 13.0,
    };

    fn heights(raster: &Raster) -> Vec<f32> {
        match &raster.samples {
            Samples::Fractional(all) => all.clone(),
            Samples::Whole(all) => all.iter().map(|s| f32::from(*s)).collect(),
        }
    }

    fn near(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-12
    }

    #[test]
    fn a_text_of_numbers_lies_where_it_is_said() {
        let rows = b"# heights\n1 2, 3\n\n4;5\t6\n";
        let grids = PlainGrids::default();
        let edges = read(PlainKind::Text, rows, &grids, Some(&PLACE)).expect("sound");
        let g = edges.geometry;
        assert_eq!((g.columns, g.rows), (3, 2));
        assert!(
            near(g.west, 10.5)
                && near(g.north, 47.5)
                && near(g.step_east, 1.0)
                && near(g.step_south, 1.0)
        );
        assert_eq!(heights(&edges), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let on_posts = PlainGrids {
            bounds_on_posts: true,
            south_first: true,
            unit_m: 0.5,
            nodata: Some(6.0),
            ..grids
        };
        let posts = read(PlainKind::Text, rows, &on_posts, Some(&PLACE)).expect("sound");
        let g = posts.geometry;
        assert!(
            near(g.west, 10.0)
                && near(g.north, 48.0)
                && near(g.step_east, 1.5)
                && near(g.step_south, 2.0)
        );
        let h = heights(&posts);
        assert_eq!((h[0], h[1], h[3], h[5]), (2.0, 2.5, 0.5, 1.5));
        assert!(h[2].is_nan(), "the marker is a void");
    }

    #[test]
    fn an_esri_grid_says_itself_where_it_lies() {
        let file = b"ncols 2\nnrows 3\nxllcorner 7\nyllcorner 45.5\ncellsize 0.5\nNODATA_value -9999\n1 2\n3 -9999\n5 6\n";
        let raster = read(PlainKind::Text, file, &PlainGrids::default(), None).expect("sound");
        let g = raster.geometry;
        assert!(near(g.west, 7.25) && near(g.north, 46.75) && near(g.step_south, 0.5));
        assert!(heights(&raster)[3].is_nan());
        let wrong = String::from_utf8_lossy(file).replace("nrows 3", "nrows 4");
        let e = read(
            PlainKind::Text,
            wrong.as_bytes(),
            &PlainGrids::default(),
            None,
        )
        .expect_err("3 rows");
        assert!(e.to_string().contains("2 x 3"), "{e}");
    }

    #[test]
    fn tables_that_are_none_say_where() {
        let grids = PlainGrids::default();
        for (file, word) in [
            (&b"1 2\n3 4 5\n"[..], "line 2 has 3 numbers"),
            (b"1 2\n3 x4\n", "line 2: `x4`"),
            (b"1 2\n", "2 x 1"),
            (b"", "0 x 0"),
            (b"\xff\xfe", "no text"),
        ] {
            let e = read(PlainKind::Text, file, &grids, Some(&PLACE)).expect_err("no table");
            assert!(e.to_string().contains(word), "{e}");
        }
        let e = read(PlainKind::Text, b"1 2\n3 4\n", &grids, None).expect_err("no bounds");
        assert!(matches!(e, InputError::NoBounds));
        assert!(read(PlainKind::Png, b"no picture", &grids, Some(&PLACE)).is_err());
        assert!(read(PlainKind::Raw, &[0; 8], &grids, Some(&PLACE)).is_err());
    }

    #[test]
    fn raw_samples_are_read_in_both_orders() {
        for (name, kind) in RAW_TYPES {
            let of = |v: i16| match kind {
                RawType::I16Le | RawType::U16Le => v.to_le_bytes().to_vec(),
                RawType::I16Be | RawType::U16Be => v.to_be_bytes().to_vec(),
                RawType::F32Le => f32::from(v).to_le_bytes().to_vec(),
                RawType::F32Be => f32::from(v).to_be_bytes().to_vec(),
            };
            let file: Vec<u8> = [300, 2, 3, 4].into_iter().flat_map(of).collect();
            let grids = PlainGrids {
                raw: Some((2, 2, kind)),
                ..PlainGrids::default()
            };
            let raster = read(PlainKind::Raw, &file, &grids, Some(&PLACE)).expect("sound");
            assert_eq!(heights(&raster), [300.0, 2.0, 3.0, 4.0], "{name}");
            let e = read(PlainKind::Raw, &file[1..], &grids, Some(&PLACE)).expect_err("cut");
            assert!(e.to_string().contains("--raw"), "{e}");
        }
    }

    #[test]
    fn kinds_are_known_by_name() {
        assert_eq!(kind("etopo20data.gz"), Some(PlainKind::Text));
        assert_eq!(kind("a.asc.gz"), Some(PlainKind::Text));
        assert_eq!(kind("a.hgt.gz"), None);
        assert_eq!(kind("a.png"), Some(PlainKind::Png));
        assert_eq!(kind("a.flt"), Some(PlainKind::Raw));
        assert_eq!(kind("a.jpg"), None);
    }
}
