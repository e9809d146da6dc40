//! Elevation files by kind: which reader a name asks for, and everything that can be wrong with one.

use crate::terrain::pack::Bounds;
use crate::terrain::plain::{self, PlainGrids, PlainKind};
use crate::terrain::raster::Raster;
use crate::terrain::{archive, dted, geotiff, hgt};
use std::fs;
use std::io;
use std::path::Path;

/// Why a file cannot be baked. The message says what is wrong; [`InputError::remedy`] what to do.
#[derive(Debug, thiserror::Error)]
pub enum InputError {
    /// It cannot be opened or read.
    #[error("{}", io_why(.0))]
    Io(#[source] io::Error),
    /// Its name ends as no kind of elevation file does.
    #[error("its name ends as none of the elevation files that can be read")]
    UnknownKind,
    /// A .hgt whose name is no corner.
    #[error("its name does not begin with the corner of a tile")]
    HgtName,
    /// A .hgt of a size that none has.
    #[error("has {0} bytes; a .hgt has 2884802 (1201 x 1201 posts) or 25934402 (3601 x 3601)")]
    HgtSize(usize),
    /// A DTED file that is damaged or of an unknown kind.
    #[error("is no DTED file that can be read: {0}")]
    Dted(String),
    /// A damaged zip archive.
    #[error("is a damaged zip archive")]
    Zip(#[source] zip::result::ZipError),
    /// A zip archive without a .hgt.
    #[error("holds no .hgt file")]
    ZipWithoutHgt,
    /// A zip archive with several.
    #[error("holds {0} .hgt files")]
    ZipWithMany(usize),
    /// A damaged gzip file.
    #[error("is a damaged gzip file")]
    Gzip,
    /// A TIFF that breaks off or is otherwise damaged.
    #[error("is a damaged or truncated TIFF")]
    Tiff(#[source] tiff::TiffError),
    /// A TIFF of a kind that is not read.
    #[error("is a TIFF with {0}, which is not read")]
    TiffKind(String),
    /// A TIFF whose place is not given.
    #[error("has no usable georeference: {0}")]
    Georeference(&'static str),
    /// A plain grid that is damaged or no table.
    #[error("{0}")]
    Plain(String),
    /// A plain grid of which nobody said where it lies.
    #[error("does not say where it lies")]
    NoBounds,
    /// Its place or size is not what it was a moment ago.
    #[error("changed while it was baked")]
    Changed,
    /// A TIFF that is in other coordinates.
    #[error("is in {0}, neither in geographic WGS 84 coordinates (EPSG:4326) nor in UTM on WGS 84")]
    Crs(String),
}

impl From<io::Error> for InputError {
    fn from(e: io::Error) -> Self {
        Self::Io(e)
    }
}

/// The reason of an I/O error in the words of a user.
fn io_why(e: &io::Error) -> &'static str {
    match e.kind() {
        io::ErrorKind::NotFound => "does not exist",
        io::ErrorKind::PermissionDenied => "may not be read",
        io::ErrorKind::IsADirectory => "is a folder",
        _ => "cannot be read",
    }
}

impl InputError {
    /// What the user can do about it.
    #[must_use]
    pub const fn remedy(&self) -> &'static str {
        match self {
            Self::Io(_) => "check the path and its permissions",
            Self::UnknownKind => {
                "give .hgt, .hgt.gz, .zip with a .hgt in it, .tif, .tiff, .dt0, .dt1, .dt2, or a plain grid: .txt, .asc, .csv, \
                 .png, .raw"
            }
            Self::HgtName => {
                "name it as N50E014.hgt: the latitude and longitude of its south-west corner"
            }
            Self::HgtSize(_) | Self::Dted(_) | Self::Zip(_) | Self::Gzip | Self::Tiff(_) => {
                "download it again"
            }
            Self::ZipWithoutHgt => "give the archive of an SRTM tile",
            Self::ZipWithMany(_) => "unpack it and give the .hgt files",
            Self::TiffKind(_) => {
                "convert it to one band of Int16, UInt16 or Float32, say with gdal_translate -ot Int16"
            }
            Self::Plain(_) => "see what `terrain bake --help` says of plain grids",
            Self::NoBounds => "give --bounds S,W,N,E",
            Self::Georeference(_) => "write it again as GeoTIFF, say with gdal_translate",
            Self::Changed => "let nothing write to it and bake again",
            Self::Crs(_) => "convert it, say with gdalwarp -t_srs EPSG:4326",
        }
    }
}

/// The most bytes of a gzipped plain grid.
const PLAIN_BYTES_MAX: usize = 4 << 30;

/// The kind of plain grid that a file is by its name.
#[must_use]
pub fn plain_kind(path: &Path) -> Option<PlainKind> {
    plain::kind(&path.file_name()?.to_str()?.to_ascii_lowercase())
}

/// Reads an elevation file of any kind. A plain grid lies at `place`, if that was said.
///
/// # Errors
/// See [`InputError`].
pub fn read(path: &Path, grids: &PlainGrids, place: Option<&Bounds>) -> Result<Raster, InputError> {
    let name = path.file_name().and_then(|n| n.to_str()).unwrap_or("");
    let lower = name.to_ascii_lowercase();
    if let Some(kind) = plain_kind(path) {
        let mut bytes = fs::read(path).map_err(InputError::Io)?;
        if lower.ends_with(".gz") {
            bytes = archive::in_gzip(&bytes, PLAIN_BYTES_MAX)?;
        }
        return plain::read(kind, &bytes, grids, place);
    }
    let bytes = || fs::read(path).map_err(InputError::Io);
    if lower.ends_with(".hgt") {
        read_hgt(name, &bytes()?)
    } else if lower.ends_with(".hgt.gz") {
        read_hgt(name, &archive::in_gzip(&bytes()?, archive::HGT_BYTES_MAX)?)
    } else if lower.ends_with(".zip") {
        let (name, bytes) = archive::hgt_in_zip(bytes()?)?;
        read_hgt(&name, &bytes)
    } else if lower.ends_with(".tif") || lower.ends_with(".tiff") {
        geotiff::read(bytes()?)
    } else if [".dt0", ".dt1", ".dt2"]
        .iter()
        .any(|end| lower.ends_with(end))
    {
        dted::parse(&bytes()?)
    } else if path.exists() {
        Err(InputError::UnknownKind)
    } else {
        Err(InputError::Io(io::ErrorKind::NotFound.into()))
    }
}

fn read_hgt(name: &str, bytes: &[u8]) -> Result<Raster, InputError> {
    let corner = hgt::corner(name).ok_or(InputError::HgtName)?;
    hgt::parse(bytes, corner).ok_or(InputError::HgtSize(bytes.len()))
}
