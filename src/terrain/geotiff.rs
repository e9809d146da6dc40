//! GeoTIFF elevation: one band of 16-bit integers or 32-bit floats, in strips or tiles, in geographic coordinates or a zone
//! of UTM, both on WGS 84.
//!
//! Source: OGC 19-008r4, GeoTIFF Standard 1.1 (annex B.6 for the raster-to-model tags, 7.1 and annex C for the keys), and
//! GDAL's GDAL_NODATA tag (42113).

use crate::terrain::input::InputError;
use crate::terrain::raster::{Crs, Geometry, Raster, Samples};
use crate::terrain::utm::Zone;
use std::io::Cursor;
use tiff::decoder::{ChunkType, Decoder, DecodingResult, Limits};
use tiff::tags::Tag;
use tiff::{ColorType, TiffError, TiffUnsupportedError};

/// The most samples read from one file: 800 MB as floats. A 1/3" tile of one degree has 117 million.
const SAMPLES_MAX: usize = 200_000_000;

/// No survey of the ground has its samples nearer, metres; degrees taken for metres have.
const UTM_STEP_MIN_M: f64 = 0.05;

/// What stands for a code that no register has (OGC 19-008r4, 7.1.2).
const USER_DEFINED: u16 = 32_767;

type Tiff = Decoder<Cursor<Vec<u8>>>;

/// Reads a GeoTIFF from its bytes.
///
/// # Errors
/// If it is damaged, of a kind that is not read, without a georeference, or in other coordinates.
pub fn read(bytes: Vec<u8>) -> Result<Raster, InputError> {
    let mut tiff = Decoder::new(Cursor::new(bytes))
        .map_err(tiff_error)?
        .with_limits(limits());
    let (columns, rows) = tiff.dimensions().map_err(tiff_error)?;
    let (columns, rows) = (columns as usize, rows as usize);
    let small_enough = columns
        .checked_mul(rows)
        .is_some_and(|n| (1..=SAMPLES_MAX).contains(&n));
    if !small_enough {
        return Err(InputError::TiffKind(format!("{columns} x {rows} samples")));
    }
    if !matches!(tiff.colortype().map_err(tiff_error)?, ColorType::Gray(_)) {
        return Err(InputError::TiffKind("more than one band".to_owned()));
    }
    let keys = Keys::read(&mut tiff)?;
    let crs = keys.crs()?;
    let model = model(&mut tiff, keys.pixel_is_point())?;
    let nodata = text(&mut tiff, Tag::GdalNodata)?
        .and_then(|t| t.trim_matches(['\0', ' ', '\n']).parse::<f64>().ok());
    let geometry = Geometry {
        crs,
        columns,
        rows,
        west: match crs {
            Crs::Geographic => (model.west + 180.0).rem_euclid(360.0) - 180.0,
            Crs::Utm(_) => model.west,
        },
        ..model
    };
    check_place(&geometry)?;
    let mut raster = Raster {
        geometry,
        samples: samples(&mut tiff, columns, rows)?,
    };
    raster.mark_voids(nodata);
    raster.close();
    Ok(raster)
}

fn limits() -> Limits {
    let mut limits = Limits::default();
    limits.decoding_buffer_size = SAMPLES_MAX * 4;
    limits.intermediate_buffer_size = SAMPLES_MAX * 4;
    // Strip offsets of 8 bytes for the tallest image.
    limits.ifd_value_size = 64 << 20;
    limits
}

fn tiff_error(e: TiffError) -> InputError {
    match e {
        TiffError::UnsupportedError(TiffUnsupportedError::UnsupportedCompressionMethod(m)) => {
            InputError::TiffKind(format!("compression {m:?}"))
        }
        TiffError::UnsupportedError(what) => InputError::TiffKind(what.to_string()),
        other => InputError::Tiff(other),
    }
}

/// Where the samples stand, from ModelPixelScale and ModelTiepoint, or ModelTransformation; without their number.
fn model(tiff: &mut Tiff, pixel_is_point: bool) -> Result<Geometry, InputError> {
    let scale = doubles(tiff, Tag::ModelPixelScaleTag)?;
    let tie = doubles(tiff, Tag::ModelTiepointTag)?;
    let matrix = doubles(tiff, Tag::ModelTransformationTag)?;
    // The coordinates of raster position (0, 0), and the steps.
    let (x0, y0, dx, dy) = match (scale.as_slice(), tie.as_slice(), matrix.as_slice()) {
        (&[dx, dy, ..], &[column, row, _, x, y, _], _) => (x - column * dx, y + row * dy, dx, dy),
        (&[_, _, ..], &[_, _, _, _, _, _, ..], _) => {
            return Err(InputError::Georeference("it has several tie points"));
        }
        (_, _, &[dx, rx, _, x, ry, dy, _, y, ..]) => {
            if rx.abs() > 0.0 || ry.abs() > 0.0 {
                return Err(InputError::Georeference("its raster is rotated"));
            }
            (x, y, dx, -dy)
        }
        _ => {
            return Err(InputError::Georeference(
                "neither ModelPixelScale and ModelTiepoint nor ModelTransformation is there",
            ));
        }
    };
    // Raster position (0, 0) is the first sample itself, or the outer corner of its pixel.
    let half = if pixel_is_point { 0.0 } else { 0.5 };
    Ok(Geometry {
        crs: Crs::Geographic,
        columns: 0,
        rows: 0,
        west: x0 + half * dx,
        north: y0 - half * dy,
        step_east: dx,
        step_south: dy,
    })
}

fn check_place(raster: &Geometry) -> Result<(), InputError> {
    let steps = [raster.step_east, raster.step_south];
    if !steps.iter().all(|s| s.is_finite() && *s > 0.0) {
        return Err(InputError::Georeference(
            "its rows do not run from north to south and from west to east",
        ));
    }
    #[expect(clippy::cast_precision_loss, reason = "below 2^52")]
    let (columns, rows) = (raster.columns as f64, raster.rows as f64);
    let south = raster.north - steps[1] * (rows - 1.0);
    let east = raster.west + steps[0] * (columns - 1.0);
    match raster.crs {
        // Half a pixel of a global grid may stand beyond the pole.
        Crs::Geographic
            if raster.west.is_finite()
                && raster.north <= 90.0 + 1e-6
                && south >= -90.0 - 1e-6
                && steps[0] * (columns - 1.0) <= 360.0 + 1e-6 =>
        {
            Ok(())
        }
        Crs::Utm(_) if steps[0].min(steps[1]) < UTM_STEP_MIN_M => Err(InputError::Georeference(
            "its samples are said to stand millimetres apart in UTM: are these degrees?",
        )),
        Crs::Utm(zone) if zone.covers((raster.west, south), (east, raster.north)) => Ok(()),
        Crs::Geographic => Err(InputError::Georeference("it reaches beyond the Earth")),
        Crs::Utm(_) => Err(InputError::Georeference(
            "it reaches far beyond its UTM zone",
        )),
    }
}

/// The geokeys (OGC 19-008r4 7.1.2): each a short value, or a place in one of the parameter tags.
struct Keys {
    entries: Vec<[u16; 4]>,
    doubles: Vec<f64>,
}

impl Keys {
    fn read(tiff: &mut Tiff) -> Result<Self, InputError> {
        let shorts = match tiff.find_tag(Tag::GeoKeyDirectoryTag).map_err(tiff_error)? {
            Some(value) => value.into_u16_vec().map_err(tiff_error)?,
            None => Vec::new(),
        };
        let entries = shorts
            .get(4..)
            .unwrap_or(&[])
            .chunks_exact(4)
            .map(|c| [c[0], c[1], c[2], c[3]])
            .collect();
        Ok(Self {
            entries,
            doubles: doubles(tiff, Tag::GeoDoubleParamsTag)?,
        })
    }

    fn short(&self, key: u16) -> Option<u16> {
        let entry = self.entries.iter().find(|e| e[0] == key && e[1] == 0)?;
        Some(entry[3])
    }

    fn double(&self, key: u16) -> Option<f64> {
        const DOUBLE_PARAMS: u16 = 34736;
        let entry = self
            .entries
            .iter()
            .find(|e| e[0] == key && e[1] == DOUBLE_PARAMS)?;
        self.doubles.get(usize::from(entry[3])).copied()
    }

    /// GTRasterTypeGeoKey; area is the default.
    fn pixel_is_point(&self) -> bool {
        self.short(1025) == Some(2)
    }

    /// WGS 84 in degrees or in a zone of UTM, heights in metres.
    fn crs(&self) -> Result<Crs, InputError> {
        if let Some(code) = self.short(4099).filter(|code| *code != 9001) {
            return Err(InputError::TiffKind(format!(
                "heights of unit EPSG:{code} instead of metres"
            )));
        }
        match self.short(1024) {
            Some(1) => self.projected(),
            Some(2) => self.geographic().map(|()| Crs::Geographic),
            None => Err(InputError::Georeference(
                "it does not say its coordinate system (GTModelType)",
            )),
            Some(_) => Err(InputError::Crs("geocentric coordinates".to_owned())),
        }
    }

    /// A zone of UTM: by its EPSG code, or by that of its projection (16001 to 16060 and 16101 to 16160) over WGS 84.
    fn projected(&self) -> Result<Crs, InputError> {
        let code = self.short(3072).filter(|code| *code != USER_DEFINED);
        let zone = match (code, self.short(3074)) {
            (Some(code), _) => Zone::from_epsg(code),
            (None, Some(projection @ 16_001..=16_160)) => {
                self.geographic()?;
                let hemisphere = if projection < 16_100 { 32_600 } else { 32_700 };
                Zone::from_epsg(hemisphere + projection % 100)
            }
            (None, _) => None,
        };
        let zone = zone.ok_or_else(|| {
            InputError::Crs(match code {
                Some(code) => format!("EPSG:{code}"),
                None => "a projected coordinate system of its own".to_owned(),
            })
        })?;
        if let Some(code) = self.short(3076).filter(|code| *code != 9001) {
            return Err(InputError::Crs(format!("coordinates of unit EPSG:{code}")));
        }
        Ok(Crs::Utm(zone))
    }

    /// Geographic WGS 84 in degrees; a user-defined system passes if its ellipsoid is WGS 84's.
    fn geographic(&self) -> Result<(), InputError> {
        match self.short(2048) {
            Some(4326) => {}
            None | Some(USER_DEFINED) => {
                let axis_m = self.double(2057).unwrap_or(crate::geo::WGS84_A_M);
                if (axis_m - crate::geo::WGS84_A_M).abs() > 0.5 {
                    return Err(InputError::Crs(format!(
                        "coordinates on an ellipsoid of {axis_m} m"
                    )));
                }
            }
            Some(code) => return Err(InputError::Crs(format!("EPSG:{code}"))),
        }
        if let Some(code) = self.short(2054).filter(|code| *code != 9102) {
            return Err(InputError::Crs(format!("angles of unit EPSG:{code}")));
        }
        Ok(())
    }
}

fn doubles(tiff: &mut Tiff, tag: Tag) -> Result<Vec<f64>, InputError> {
    match tiff.find_tag(tag).map_err(tiff_error)? {
        Some(value) => value.into_f64_vec().map_err(tiff_error),
        None => Ok(Vec::new()),
    }
}

fn text(tiff: &mut Tiff, tag: Tag) -> Result<Option<String>, InputError> {
    let Some(value) = tiff.find_tag(tag).map_err(tiff_error)? else {
        return Ok(None);
    };
    // A marker that is no text marks nothing.
    Ok(value.into_string().ok())
}

fn samples(tiff: &mut Tiff, columns: usize, rows: usize) -> Result<Samples, InputError> {
    let (width, height) = tiff.chunk_dimensions();
    let (width, height) = (width.max(1) as usize, height.max(1) as usize);
    let chunks = match tiff.get_chunk_type() {
        ChunkType::Strip => tiff.strip_count(),
        ChunkType::Tile => tiff.tile_count(),
    }
    .map_err(tiff_error)?;
    let across = columns.div_ceil(width);
    let wanted = across * rows.div_ceil(height);
    if chunks as usize != wanted {
        let what = format!("{chunks} strips or tiles where its size needs {wanted}");
        return Err(InputError::TiffKind(what));
    }
    let mut all: Option<Samples> = None;
    for chunk in 0..chunks {
        let (data_width, data_height) = tiff.chunk_data_dimensions(chunk);
        let (data_width, data_height) = (data_width as usize, data_height as usize);
        let left = chunk as usize % across * width;
        let top = chunk as usize / across * height;
        let data = tiff.read_chunk(chunk).map_err(tiff_error)?;
        let place = Place {
            left,
            top,
            width: data_width,
            height: data_height,
            columns,
            rows,
        };
        match data {
            DecodingResult::I16(data) => {
                match all.get_or_insert_with(|| Samples::Whole(vec![i16::MIN; columns * rows])) {
                    Samples::Whole(to) => place.copy(&data, to, |s| s)?,
                    Samples::Fractional(_) => {
                        return Err(InputError::TiffKind("samples of two types".to_owned()));
                    }
                }
            }
            DecodingResult::U16(data) => {
                place.copy(&data, floats(&mut all, columns * rows)?, f32::from)?;
            }
            DecodingResult::F32(data) => {
                place.copy(&data, floats(&mut all, columns * rows)?, |s| s)?;
            }
            other => return Err(InputError::TiffKind(sample_type(&other).to_owned())),
        }
    }
    all.ok_or_else(|| InputError::TiffKind("no data".to_owned()))
}

fn floats(all: &mut Option<Samples>, count: usize) -> Result<&mut Vec<f32>, InputError> {
    match all.get_or_insert_with(|| Samples::Fractional(vec![f32::NAN; count])) {
        Samples::Fractional(to) => Ok(to),
        Samples::Whole(_) => Err(InputError::TiffKind("samples of two types".to_owned())),
    }
}

fn sample_type(data: &DecodingResult) -> &'static str {
    match data {
        DecodingResult::U8(_) | DecodingResult::I8(_) => "8-bit samples",
        DecodingResult::U32(_) | DecodingResult::I32(_) => "32-bit integer samples",
        DecodingResult::U64(_) | DecodingResult::I64(_) => "64-bit integer samples",
        DecodingResult::F64(_) => "64-bit float samples",
        DecodingResult::F16(_) => "16-bit float samples",
        DecodingResult::U16(_) | DecodingResult::I16(_) | DecodingResult::F32(_) => "such samples",
    }
}

/// Where a strip or tile goes.
struct Place {
    left: usize,
    top: usize,
    width: usize,
    height: usize,
    columns: usize,
    rows: usize,
}

impl Place {
    fn copy<S: Copy, D>(
        &self,
        from: &[S],
        to: &mut [D],
        as_sample: impl Fn(S) -> D,
    ) -> Result<(), InputError> {
        if from.len() != self.width * self.height {
            return Err(InputError::TiffKind("more than one band".to_owned()));
        }
        let fits = self.left + self.width <= self.columns && self.top + self.height <= self.rows;
        if !fits {
            return Err(InputError::TiffKind(
                "strips or tiles beyond its size".to_owned(),
            ));
        }
        for (row, line) in from.chunks_exact(self.width.max(1)).enumerate() {
            let at = (self.top + row) * self.columns + self.left;
            for (d, s) in to[at..at + self.width].iter_mut().zip(line) {
                *d = as_sample(*s);
            }
        }
        Ok(())
    }
}
