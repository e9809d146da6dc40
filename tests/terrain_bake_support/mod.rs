//! Readers and writers of elevation files that share nothing with the program's own, for the tests of baking.

#![allow(
    dead_code,
    clippy::cast_possible_truncation,
    clippy::expect_used,
    clippy::panic,
    reason = "every test includes this module and uses only some of it; what it needs for a test is there or the test fails"
)]

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use glasswing::terrain::bake::{BakeError, Heights, Job, Report, bake};
use glasswing::terrain::codec::{SurfaceKind, Tile};
use glasswing::terrain::grid::TileKey;
use glasswing::terrain::pack::{Bounds, Pack, TileReader};
use glasswing::terrain::partition::Partition;
use glasswing::terrain::plain::PlainGrids;

/// A square of 1201 x 1201 samples over one degree, rows from the north.
pub(crate) struct Cell {
    /// Degrees of the south-west corner.
    pub(crate) latitude: i32,
    pub(crate) longitude: i32,
    pub(crate) samples: Vec<i16>,
}

impl Cell {
    /// The sample at a post of the 3" grid, by degrees times 1200.
    pub(crate) fn at(&self, i: i32, j: i32) -> i16 {
        let row = (self.latitude + 1) * 1200 - j;
        let column = i - self.longitude * 1200;
        self.samples[usize::try_from(row * 1201 + column).expect("inside the cell")]
    }
}

pub(crate) fn big_endian(bytes: &[u8]) -> Vec<i16> {
    bytes
        .chunks_exact(2)
        .map(|b| i16::from_be_bytes([b[0], b[1]]))
        .collect()
}

/// A raw .hgt.
pub(crate) fn hgt_cell(path: &Path, latitude: i32, longitude: i32) -> Cell {
    Cell {
        latitude,
        longitude,
        samples: big_endian(&fs::read(path).expect("test data is readable")),
    }
}

/// The only file of a zip archive, by its first local header (APPNOTE 6.3.9, section 4.3.7).
pub(crate) fn zipped_cell(path: &Path, latitude: i32, longitude: i32) -> Cell {
    let zip = fs::read(path).expect("test data is readable");
    let short = |at: usize| usize::from(u16::from_le_bytes([zip[at], zip[at + 1]]));
    let data = &zip[30 + short(26) + short(28)..];
    let bytes = miniz_oxide::inflate::decompress_to_vec(data).expect("deflated");
    Cell {
        latitude,
        longitude,
        samples: big_endian(&bytes),
    }
}

/// A little-endian TIFF of 1201 x 1201 uncompressed i16 whose strips follow each other: the largest block of the file.
pub(crate) fn tiff_cell(path: &Path, latitude: i32, longitude: i32) -> Cell {
    let file = fs::read(path).expect("test data is readable");
    let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().expect("4 bytes"));
    let short = |at: usize| usize::from(u16::from_le_bytes([file[at], file[at + 1]]));
    let directory = word(4) as usize;
    let offsets = (0..short(directory))
        .map(|n| directory + 2 + 12 * n)
        .find(|at| short(*at) == 273)
        .expect("strip offsets");
    let first = word(word(offsets + 8) as usize) as usize;
    let samples = file[first..first + 2 * 1201 * 1201]
        .chunks_exact(2)
        .map(|b| i16::from_le_bytes([b[0], b[1]]))
        .collect();
    Cell {
        latitude,
        longitude,
        samples,
    }
}

/// Writes a .hgt of 1201 posts a side; `height` is asked for each post, by row from the north and column from the west.
pub(crate) fn write_hgt(path: &Path, height: impl Fn(i32, i32) -> i16) {
    let mut bytes = Vec::with_capacity(2 * 1201 * 1201);
    for row in 0..1201 {
        for column in 0..1201 {
            bytes.extend(height(row, column).to_be_bytes());
        }
    }
    fs::write(path, bytes).expect("written");
}

/// One field of a TIFF directory: tag, type, and its values as bytes.
pub(crate) struct Field(pub(crate) u16, pub(crate) u16, pub(crate) Vec<u8>);

impl Field {
    pub(crate) fn shorts(tag: u16, values: &[u16]) -> Self {
        Self(
            tag,
            3,
            values.iter().flat_map(|v| v.to_le_bytes()).collect(),
        )
    }
    pub(crate) fn longs(tag: u16, values: &[u32]) -> Self {
        Self(
            tag,
            4,
            values.iter().flat_map(|v| v.to_le_bytes()).collect(),
        )
    }
    pub(crate) fn doubles(tag: u16, values: &[f64]) -> Self {
        Self(
            tag,
            12,
            values.iter().flat_map(|v| v.to_le_bytes()).collect(),
        )
    }
    pub(crate) fn text(tag: u16, value: &str) -> Self {
        Self(tag, 2, [value.as_bytes(), b"\0"].concat())
    }
}

/// Keys of a geographic WGS 84 GeoTIFF: model type, raster type, and others.
pub(crate) fn geokeys(raster_type: u16, extra: &[[u16; 4]]) -> Field {
    model_keys(2, raster_type, extra)
}

/// Keys of a GeoTIFF: model type (1 projected, 2 geographic), raster type (1 areas, 2 points), and others.
pub(crate) fn model_keys(model_type: u16, raster_type: u16, extra: &[[u16; 4]]) -> Field {
    let mut keys = vec![[1024, 0, 1, model_type], [1025, 0, 1, raster_type]];
    keys.extend(extra);
    let count = u16::try_from(keys.len()).expect("few");
    Field::shorts(
        34_735,
        &[&[1, 1, 0, count], keys.concat().as_slice()].concat(),
    )
}

/// Fields of a picture of one band: size, bits and format (1 unsigned, 2 signed, 3 float) of a sample.
pub(crate) fn picture(columns: u32, rows: u32, bits: u16, format: u16) -> Vec<Field> {
    vec![
        Field::longs(256, &[columns]),
        Field::longs(257, &[rows]),
        Field::shorts(258, &[bits]),
        Field::shorts(259, &[1]),
        Field::shorts(262, &[1]),
        Field::shorts(277, &[1]),
        Field::shorts(339, &[format]),
    ]
}

/// A little-endian TIFF (TIFF 6.0, section 2): header, the chunks of the picture, the directory, its longer values. The
/// chunks' offsets and lengths are put under the tags `offsets` and `lengths`.
pub(crate) fn tiff(chunks: &[Vec<u8>], offsets: u16, lengths: u16, fields: Vec<Field>) -> Vec<u8> {
    let mut file = b"II*\0\0\0\0\0".to_vec();
    let (mut places, mut sizes) = (Vec::new(), Vec::new());
    let small = |n: usize| u32::try_from(n).expect("a small file");
    for chunk in chunks {
        places.push(small(file.len()));
        sizes.push(small(chunk.len()));
        file.extend(chunk);
    }
    let mut fields = fields;
    fields.push(Field::longs(offsets, &places));
    fields.push(Field::longs(lengths, &sizes));
    fields.sort_by_key(|f| f.0);
    let directory = small(file.len());
    file[4..8].copy_from_slice(&directory.to_le_bytes());
    let mut values_at = file.len() + 2 + 12 * fields.len() + 4;
    file.extend(u16::try_from(fields.len()).expect("few").to_le_bytes());
    let mut values: Vec<u8> = Vec::new();
    for Field(tag, kind, bytes) in &fields {
        let size = match kind {
            2 => 1,
            3 => 2,
            4 => 4,
            _ => 8,
        };
        file.extend(tag.to_le_bytes());
        file.extend(kind.to_le_bytes());
        file.extend(small(bytes.len() / size).to_le_bytes());
        if bytes.len() <= 4 {
            let mut inline = bytes.clone();
            inline.resize(4, 0);
            file.extend(inline);
        } else {
            file.extend(small(values_at).to_le_bytes());
            values.extend(bytes);
            values_at += bytes.len();
        }
    }
    file.extend([0; 4]);
    file.extend(values);
    file
}

/// Bakes files as they are, in two threads.
pub(crate) fn baked(inputs: &[PathBuf], out: &Path) -> Result<(Report, Pack), BakeError> {
    baked_as(inputs, out, Heights::Egm96, None, 2)
}

pub(crate) fn baked_as(
    inputs: &[PathBuf],
    out: &Path,
    heights: Heights,
    region: Option<Bounds>,
    jobs: usize,
) -> Result<(Report, Pack), BakeError> {
    let stop = AtomicBool::new(false);
    let job = Job {
        inputs,
        plain: &PlainGrids::default(),
        out,
        heights,
        region,
        parts: None,
        jobs,
        stop: &stop,
    };
    let report = bake(&job, &mut |_, _| {})?;
    let pack = Pack::open(out).expect("a baked pack opens");
    Ok((report, pack))
}

/// Posts of a pack by level, read tile by tile.
pub(crate) struct Posts<'a> {
    pack: &'a Pack,
    partition: Partition,
    reader: TileReader,
    tile: Tile,
    held: Option<TileKey>,
}

impl<'a> Posts<'a> {
    pub(crate) fn of(pack: &'a Pack) -> Self {
        Self::in_partition(pack, Partition::Geographic)
    }

    pub(crate) fn in_partition(pack: &'a Pack, partition: Partition) -> Self {
        Self {
            pack,
            partition,
            reader: TileReader::new(),
            tile: Tile::filled(0, SurfaceKind::Void),
            held: None,
        }
    }

    /// What the index states of the tile that a post is in: the largest error, metres. `None` without a tile.
    pub(crate) fn stated_error_m(&self, level: u8, i: i32, j: i32) -> Option<f64> {
        let header = self
            .pack
            .tile_header(TileKey::of_post(self.partition, level, i, j))?;
        Some(f64::from(header.max_error_m))
    }

    /// Orthometric height and kind of a post.
    pub(crate) fn at(&mut self, level: u8, i: i32, j: i32) -> (f64, SurfaceKind) {
        let key = TileKey::of_post(self.partition, level, i, j);
        if self.held != Some(key) {
            self.pack
                .read_tile(key, &mut self.reader, &mut self.tile)
                .unwrap_or_else(|e| panic!("{key}: {e}"));
            self.held = Some(key);
        }
        let at = TileKey::index_of(i, j);
        (
            self.pack.orthometric_m(self.tile.quanta[at]),
            self.tile.kind[at],
        )
    }
}

/// A GeoTIFF of whole metres whose samples stand on points, uncompressed.
pub(crate) fn write_tiff(
    path: &Path,
    (columns, rows): (u32, u32),
    corner: (f64, f64),
    step: f64,
    samples: &[i16],
) {
    let chunk: Vec<u8> = samples.iter().flat_map(|h| h.to_le_bytes()).collect();
    let keys = [
        1_u16, 1, 0, 3, 1024, 0, 1, 2, 1025, 0, 1, 2, 2048, 0, 1, 4326,
    ];
    let fields = vec![
        Field::longs(256, &[columns]),
        Field::longs(257, &[rows]),
        Field::shorts(258, &[16]),
        Field::shorts(259, &[1]),
        Field::shorts(262, &[1]),
        Field::shorts(277, &[1]),
        Field::longs(278, &[rows]),
        Field::shorts(339, &[2]),
        Field::doubles(33_550, &[step, step, 0.0]),
        Field::doubles(33_922, &[0.0, 0.0, 0.0, corner.0, corner.1, 0.0]),
        Field::shorts(34_735, &keys),
    ];
    fs::write(path, tiff(&[chunk], 273, 279, fields)).expect("written");
}

/// The angles (v, u), degrees, of a place in a cap: n = (cos u sin v, sin u, cos u cos v) in the north, (cos u sin v, -sin u,
/// -cos u cos v) in the south.
pub(crate) fn angles(cap: Partition, longitude: f64, latitude: f64) -> (f64, f64) {
    let sign = if cap == Partition::South { -1.0 } else { 1.0 };
    let (sin, cos) = (90.0 - sign * latitude).to_radians().sin_cos();
    let (sin_l, cos_l) = longitude.to_radians().sin_cos();
    let (x, y, z) = (sin * cos_l, sign * sin * sin_l, cos);
    (x.atan2(z).to_degrees(), y.asin().to_degrees())
}

/// The triangle over a place in posts, as it is drawn: the corners with a weight. The diagonal of a cell runs from the
/// south-west where its column and row add up to an even number, from the south-east elsewhere.
pub(crate) fn triangle((x, y): (f64, f64)) -> [((i32, i32), f64); 3] {
    let (i, j) = (x.floor() as i32, y.floor() as i32);
    let (fx, fy) = (x - x.floor(), y - y.floor());
    let post = |di: i32, dj: i32| (i + di, j + dj);
    let corners = if (i + j).rem_euclid(2) == 0 {
        let third = if fx >= fy { post(1, 0) } else { post(0, 1) };
        [
            (post(0, 0), 1.0 - fx.max(fy)),
            (third, (fx - fy).abs()),
            (post(1, 1), fx.min(fy)),
        ]
    } else {
        let (third, share) = if fx + fy <= 1.0 {
            (post(0, 0), 1.0 - fx - fy)
        } else {
            (post(1, 1), fx + fy - 1.0)
        };
        let (se, nw) = if fx + fy <= 1.0 {
            (fx, fy)
        } else {
            (1.0 - fy, 1.0 - fx)
        };
        [(third, share), (post(1, 0), se), (post(0, 1), nw)]
    };
    // A corner without weight may not exist: the heaviest stands for it.
    let heaviest = corners
        .iter()
        .fold(corners[0], |a, b| if b.1 > a.1 { *b } else { a });
    corners.map(|c| if c.1 > 0.0 { c } else { (heaviest.0, 0.0) })
}
