//! The pack: one file that holds a terrain's tiles, and its reader. The writer is [`crate::terrain::store`].
//!
//! # Format 1
//!
//! Little endian throughout, no gaps. CRC is CRC-32/ISO-HDLC (zlib's). *Post coordinates* are those of level 0 of
//! [`Grid`]; a rectangle is south, west, north, east, all inclusive, and its east may pass 180 degrees.
//!
//! | section | where |
//! |---|---|
//! | header | byte 0, 160 bytes |
//! | stored tiles | from byte 160, one after the other ([`crate::terrain::codec`] says what is in them) |
//! | index | header's index offset up to the geoid offset: 40 bytes for each tile, sorted by level, row, column |
//! | geoid | up to the sources offset |
//! | sources | up to the end of the file |
//!
//! Header:
//!
//! | byte | type | what |
//! |---|---|---|
//! | 0 | 8 bytes | `GLASWPCK` |
//! | 8 | u32 | format, 1 |
//! | 12 | u32 | bytes of the header, 160 |
//! | 16 | u64 | bytes of the file |
//! | 24 | u32 | posts per degree of level 0 |
//! | 28 | u32 | number of levels |
//! | 32 | f64 | unit of a height, metres |
//! | 40 | f64 | orthometric height of quanta 0, metres |
//! | 48, 56 | f64, f64 | lowest and highest orthometric height that is not void, metres; 0, 0 where all is |
//! | 64 | 4 x i32 | rectangle around everything covered |
//! | 80 | u64 | tiles |
//! | 88, 96, 104 | 3 x u64 | level-0 posts covered by a source; of these void; of these water |
//! | 112, 120, 128 | 3 x u64 | offsets of index, geoid and sources |
//! | 136, 140, 144 | 3 x u32 | their CRCs |
//! | 148 | 8 bytes | zero |
//! | 156 | u32 | CRC of bytes 0 to 155 |
//!
//! Index entry:
//!
//! | byte | type | what |
//! |---|---|---|
//! | 0 | u8 | level; 3 bytes of zero follow |
//! | 4, 8 | i32, i32 | tile column, tile row |
//! | 12, 14 | u16, u16 | lowest and highest quanta among all posts, filled ones too |
//! | 16 | f32 | largest difference between a stored height and its source, metres; 0 for whole metres |
//! | 20, 22 | u16, u16 | void posts (posts outside every source too), water posts |
//! | 24 | u64 | offset of the stored bytes |
//! | 32, 36 | u32, u32 | their number and CRC |
//!
//! Geoid: south and west node (i32, in 15' from 0N 0E), rows, columns (u32), then rows x columns EGM96 undulations (i32,
//! millimetres, southern row first, west first; the lowest i32 where there is none). Sources: their number (u32), and for
//! each its rectangle (4 x i32) and its name (u16 length, UTF-8).
//!
//! Every byte of the file is under one of the checksums: a flipped bit is always found, when the pack is opened (header,
//! index, geoid, sources) or when the tile it is in is read.

use crate::limits::{LEVELS_MAX, TILE_POSTS};
use crate::terrain::codec::{CodecError, Decoder, STORED_BYTES_MAX, Tile};
use crate::terrain::geoid::GeoidGrid;
use crate::terrain::grid::{Grid, TileKey};
use crc::{CRC_32_ISO_HDLC, Crc, Table};
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;

pub use crate::terrain::codec::SurfaceKind;

/// First bytes of every pack.
pub const MAGIC: [u8; 8] = *b"GLASWPCK";
/// The format that this program writes, and the newest it reads.
pub const FORMAT: u32 = 1;
/// Bytes of the header.
pub const HEADER_BYTES: usize = 160;
/// Bytes of an index entry.
pub const ENTRY_BYTES: usize = 40;

/// The checksum of everything in a pack.
pub(crate) static CRC: Crc<u32, Table<16>> = Crc::<u32, Table<16>>::new(&CRC_32_ISO_HDLC);

/// A rectangle of level-0 posts, all four sides inclusive. `east` may pass 180 degrees; `west` never does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PostRect {
    /// Southernmost row.
    pub south: i32,
    /// Westernmost column.
    pub west: i32,
    /// Northernmost row.
    pub north: i32,
    /// Easternmost column.
    pub east: i32,
}

impl PostRect {
    /// Whether it holds the post at canonical column `i` and row `j`.
    #[must_use]
    pub fn contains(&self, grid: Grid, i: i32, j: i32) -> bool {
        let columns = self.west..=self.east;
        (self.south..=self.north).contains(&j)
            && (columns.contains(&i) || columns.contains(&(i + grid.posts_around())))
    }

    /// The smallest rectangle around all of them; `None` if there are none.
    #[must_use]
    pub fn around(rects: impl Iterator<Item = Self>) -> Option<Self> {
        rects.reduce(|a, b| Self {
            south: a.south.min(b.south),
            west: a.west.min(b.west),
            north: a.north.max(b.north),
            east: a.east.max(b.east),
        })
    }

    /// What two rectangles share; `None` if nothing.
    #[must_use]
    pub fn intersection(&self, other: &Self) -> Option<Self> {
        let shared = Self {
            south: self.south.max(other.south),
            west: self.west.max(other.west),
            north: self.north.min(other.north),
            east: self.east.min(other.east),
        };
        (shared.south <= shared.north && shared.west <= shared.east).then_some(shared)
    }

    /// Moved east by a number of posts.
    #[must_use]
    pub const fn shifted(&self, posts: i32) -> Self {
        Self {
            west: self.west + posts,
            east: self.east + posts,
            ..*self
        }
    }

    /// The same rectangle in degrees.
    #[must_use]
    pub fn bounds(&self, grid: Grid) -> Bounds {
        Bounds {
            south_deg: grid.latitude_deg(0, self.south),
            west_deg: grid.longitude_deg(0, self.west),
            north_deg: grid.latitude_deg(0, self.north),
            east_deg: grid.longitude_deg(0, self.east),
        }
    }
}

/// A rectangle in degrees north and east.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Southern latitude.
    pub south_deg: f64,
    /// Western longitude.
    pub west_deg: f64,
    /// Northern latitude.
    pub north_deg: f64,
    /// Eastern longitude; past 180 only in the rectangle of a single source that ends on the date line.
    pub east_deg: f64,
}

/// One input of the bake.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceInfo {
    /// The file's name, without folders.
    pub name: String,
    /// The posts it covers, cut by the bake's region.
    pub rect: PostRect,
}

/// What a pack is, from its header.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PackInfo {
    /// Its format.
    pub version: u32,
    /// Its grid.
    pub grid: Grid,
    /// Number of levels: 0 to this less one.
    pub levels: u8,
    /// The posts of level 0 that frame everything covered.
    pub rect: PostRect,
    /// The same in degrees.
    pub bounds: Bounds,
    /// Height of one unit of quanta, metres.
    pub unit_m: f64,
    /// Orthometric height of quanta 0, metres.
    pub base_m: f64,
    /// Lowest orthometric height among level-0 posts that are not void, metres.
    pub height_min_m: f64,
    /// Highest orthometric height among level-0 posts that are not void, metres.
    pub height_max_m: f64,
    /// Tiles of all levels.
    pub tiles: u64,
    /// Level-0 posts that a source covers.
    pub posts: u64,
    /// Of these, void.
    pub void_posts: u64,
    /// Of these, water.
    pub water_posts: u64,
    /// Bytes of the file.
    pub bytes: u64,
}

/// What the index says of a tile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileHeader {
    /// Lowest orthometric height of a post (filled ones too), metres.
    pub min_m: f64,
    /// Highest orthometric height of a post (filled ones too), metres.
    pub max_m: f64,
    /// Largest difference between a stored height and its source, metres; 0 for whole metres.
    pub max_error_m: f32,
    /// Void posts, those outside every source too.
    pub void_posts: u16,
    /// Water posts.
    pub water_posts: u16,
    /// Bytes it takes in the file.
    pub stored_bytes: u32,
}

/// An index entry, as it stands in the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Entry {
    pub(crate) key: TileKey,
    pub(crate) min: u16,
    pub(crate) max: u16,
    pub(crate) max_error_m: f32,
    pub(crate) void_posts: u16,
    pub(crate) water_posts: u16,
    pub(crate) offset: u64,
    pub(crate) length: u32,
    pub(crate) crc: u32,
}

/// Why a pack cannot be opened. The message says what is wrong; [`PackError::remedy`] what to do.
#[derive(Debug, thiserror::Error)]
pub enum PackError {
    /// It cannot be opened or read.
    #[error("cannot be read")]
    Io(#[source] io::Error),
    /// It does not begin as a pack does.
    #[error("is not a terrain pack")]
    NotAPack,
    /// A format this program does not know yet.
    #[error("written by a newer glasswing (format {0}; this one reads up to {FORMAT})")]
    Newer(u32),
    /// A format that never existed or is no longer read.
    #[error("has format {0}, which this glasswing does not read (it reads format {FORMAT})")]
    Older(u32),
    /// Shorter than its header says.
    #[error("is cut short: {have} bytes of {want}")]
    CutShort {
        /// Bytes there are.
        have: u64,
        /// Bytes there should be.
        want: u64,
    },
    /// Longer than its header says.
    #[error("has {have} bytes where its header says {want}")]
    TooLong {
        /// Bytes there are.
        have: u64,
        /// Bytes there should be.
        want: u64,
    },
    /// A part of it fails its checksum or makes no sense.
    #[error("its {0} is damaged")]
    Damaged(&'static str),
}

impl PackError {
    /// What the user can do about it.
    #[must_use]
    pub const fn remedy(&self) -> &'static str {
        match self {
            Self::Io(_) => "check the path and its permissions",
            Self::NotAPack => {
                "give a pack made by `glasswing terrain bake` or `glasswing terrain synth`"
            }
            Self::Newer(_) => "update glasswing, or bake the pack again with this one",
            Self::Older(_) => "bake it again from its sources",
            Self::CutShort { .. } | Self::TooLong { .. } | Self::Damaged(_) => {
                "copy it again from the original, or bake it again"
            }
        }
    }
}

/// Why a tile cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum TileError {
    /// The pack has no such tile.
    #[error("the pack has no such tile")]
    Absent,
    /// The file ends before the tile does.
    #[error("the file was cut short after it was opened")]
    CutShort,
    /// Its bytes fail their checksum.
    #[error("it fails its checksum")]
    Checksum,
    /// Its bytes pass their checksum but are no tile.
    #[error(transparent)]
    Codec(#[from] CodecError),
    /// Reading failed.
    #[error("reading failed")]
    Io(#[source] io::Error),
}

/// What [`Pack::read_tile`] works with: room for a stored tile and for unpacking it. One for each reading thread.
#[derive(Debug)]
pub struct TileReader {
    stored: Box<[u8]>,
    decoder: Decoder,
}

impl Default for TileReader {
    fn default() -> Self {
        Self::new()
    }
}

impl TileReader {
    /// Allocates everything that reading needs.
    #[must_use]
    pub fn new() -> Self {
        Self {
            stored: vec![0; STORED_BYTES_MAX].into_boxed_slice(),
            decoder: Decoder::new(),
        }
    }
}

/// An open pack: the file, and its index, geoid and sources in memory. Threads may share it.
#[derive(Debug)]
pub struct Pack {
    file: File,
    info: PackInfo,
    entries: Vec<Entry>,
    geoid: GeoidGrid,
    sources: Vec<SourceInfo>,
}

impl Pack {
    /// Opens a pack and checks everything but its tiles.
    ///
    /// # Errors
    /// See [`PackError`].
    pub fn open(path: &Path) -> Result<Self, PackError> {
        let file = File::open(path).map_err(PackError::Io)?;
        let have = file.metadata().map_err(PackError::Io)?.len();
        let header = Header::read(&file, have)?;
        let section = |from: u64, to: u64, crc: u32, name: &'static str| {
            let length = usize::try_from(to - from)
                .ok()
                .ok_or(PackError::Damaged(name))?;
            let mut bytes = vec![0; length];
            file.read_exact_at(&mut bytes, from)
                .map_err(PackError::Io)?;
            if CRC.checksum(&bytes) == crc {
                Ok(bytes)
            } else {
                Err(PackError::Damaged(name))
            }
        };
        let [index, geoid, sources] = header.offsets;
        let entries = section(index, geoid, header.crcs[0], "index")?;
        let entries =
            parse_entries(&entries, &header.info, index).ok_or(PackError::Damaged("index"))?;
        let geoid = section(geoid, sources, header.crcs[1], "geoid")?;
        let geoid = GeoidGrid::from_bytes(&geoid).ok_or(PackError::Damaged("geoid"))?;
        let sources = section(
            sources,
            header.info.bytes,
            header.crcs[2],
            "list of sources",
        )?;
        let sources = parse_sources(&sources).ok_or(PackError::Damaged("list of sources"))?;
        Ok(Self {
            file,
            info: header.info,
            entries,
            geoid,
            sources,
        })
    }

    /// What it is.
    #[must_use]
    pub const fn info(&self) -> &PackInfo {
        &self.info
    }

    /// The undulations of its area.
    #[must_use]
    pub const fn geoid(&self) -> &GeoidGrid {
        &self.geoid
    }

    /// What it was baked from.
    #[must_use]
    pub fn sources(&self) -> &[SourceInfo] {
        &self.sources
    }

    /// Every tile it has, in the order of the index: level, row, column.
    pub fn keys(&self) -> impl Iterator<Item = TileKey> + '_ {
        self.entries.iter().map(|e| e.key)
    }

    /// Whether it has a tile.
    #[must_use]
    pub fn contains(&self, key: TileKey) -> bool {
        self.entry(key).is_some()
    }

    /// Whether a source covers the level-0 post at canonical column `i` and row `j`.
    #[must_use]
    pub fn covers(&self, i: i32, j: i32) -> bool {
        self.sources
            .iter()
            .any(|s| s.rect.contains(self.info.grid, i, j))
    }

    /// What the index says of a tile; `None` if the pack does not have it.
    #[must_use]
    pub fn tile_header(&self, key: TileKey) -> Option<TileHeader> {
        let entry = self.entry(key)?;
        Some(TileHeader {
            min_m: self.orthometric_m(entry.min),
            max_m: self.orthometric_m(entry.max),
            max_error_m: entry.max_error_m,
            void_posts: entry.void_posts,
            water_posts: entry.water_posts,
            stored_bytes: entry.length,
        })
    }

    /// The orthometric height that quanta stand for, metres.
    #[must_use]
    pub fn orthometric_m(&self, quanta: u16) -> f64 {
        self.info.base_m + f64::from(quanta) * self.info.unit_m
    }

    /// Reads a tile. Allocates nothing; blocks on the disk. On an error `tile` is unchanged.
    ///
    /// # Errors
    /// See [`TileError`].
    pub fn read_tile(
        &self,
        key: TileKey,
        reader: &mut TileReader,
        tile: &mut Tile,
    ) -> Result<(), TileError> {
        let entry = self.entry(key).ok_or(TileError::Absent)?;
        // `open` has checked that no entry is longer than the buffer.
        let stored = &mut reader.stored[..entry.length as usize];
        self.file
            .read_exact_at(stored, entry.offset)
            .map_err(|e| match e.kind() {
                io::ErrorKind::UnexpectedEof => TileError::CutShort,
                _ => TileError::Io(e),
            })?;
        if CRC.checksum(stored) != entry.crc {
            return Err(TileError::Checksum);
        }
        Ok(reader.decoder.decode(stored, tile)?)
    }

    fn entry(&self, key: TileKey) -> Option<&Entry> {
        let at = self.entries.binary_search_by_key(&key, |e| e.key).ok()?;
        self.entries.get(at)
    }
}

/// The header, once checked.
pub(crate) struct Header {
    pub(crate) info: PackInfo,
    /// Of index, geoid and sources.
    pub(crate) offsets: [u64; 3],
    /// Of the same.
    pub(crate) crcs: [u32; 3],
}

impl Header {
    fn read(file: &File, have: u64) -> Result<Self, PackError> {
        let mut bytes = [0; HEADER_BYTES];
        let wanted = have.min(HEADER_BYTES as u64);
        let wanted = usize::try_from(wanted).unwrap_or(HEADER_BYTES);
        file.read_exact_at(&mut bytes[..wanted], 0)
            .map_err(PackError::Io)?;
        if wanted < MAGIC.len() || !bytes.starts_with(&MAGIC) {
            return Err(PackError::NotAPack);
        }
        if wanted < HEADER_BYTES {
            return Err(PackError::CutShort {
                have,
                want: HEADER_BYTES as u64,
            });
        }
        match u32_at(&bytes, 8) {
            FORMAT => {}
            newer if newer > FORMAT => return Err(PackError::Newer(newer)),
            older => return Err(PackError::Older(older)),
        }
        if CRC.checksum(&bytes[..HEADER_BYTES - 4]) != u32_at(&bytes, HEADER_BYTES - 4) {
            return Err(PackError::Damaged("header"));
        }
        let header = Self::parse(&bytes).ok_or(PackError::Damaged("header"))?;
        let want = header.info.bytes;
        match have.cmp(&want) {
            std::cmp::Ordering::Less => Err(PackError::CutShort { have, want }),
            std::cmp::Ordering::Greater => Err(PackError::TooLong { have, want }),
            std::cmp::Ordering::Equal => Ok(header),
        }
    }

    fn parse(bytes: &[u8; HEADER_BYTES]) -> Option<Self> {
        let grid = Grid {
            posts_per_degree: u32_at(bytes, 24),
        };
        let levels = u8::try_from(u32_at(bytes, 28)).ok()?;
        let rect = rect_at(bytes, 64);
        let sane = u32_at(bytes, 12) as usize == HEADER_BYTES
            && crate::terrain::grid::POSTS_PER_DEGREE.contains(&grid.posts_per_degree)
            && usize::from(levels) <= LEVELS_MAX;
        if !sane {
            return None;
        }
        let info = PackInfo {
            version: u32_at(bytes, 8),
            grid,
            levels,
            rect,
            bounds: rect.bounds(grid),
            unit_m: f64_at(bytes, 32),
            base_m: f64_at(bytes, 40),
            height_min_m: f64_at(bytes, 48),
            height_max_m: f64_at(bytes, 56),
            tiles: u64_at(bytes, 80),
            posts: u64_at(bytes, 88),
            void_posts: u64_at(bytes, 96),
            water_posts: u64_at(bytes, 104),
            bytes: u64_at(bytes, 16),
        };
        let offsets = [112, 120, 128].map(|at| u64_at(bytes, at));
        let in_order = offsets.is_sorted()
            && offsets[0] >= HEADER_BYTES as u64
            && offsets[2] <= info.bytes
            && info.unit_m.is_finite()
            && info.unit_m > 0.0
            && info.base_m.is_finite();
        in_order.then_some(Self {
            info,
            offsets,
            crcs: [136, 140, 144].map(|at| u32_at(bytes, at)),
        })
    }

    pub(crate) fn to_bytes(&self) -> [u8; HEADER_BYTES] {
        let i = &self.info;
        let mut bytes = [0; HEADER_BYTES];
        let mut put = |at: usize, field: &[u8]| bytes[at..at + field.len()].copy_from_slice(field);
        put(0, &MAGIC);
        put(8, &FORMAT.to_le_bytes());
        #[expect(clippy::cast_possible_truncation, reason = "160")]
        put(12, &(HEADER_BYTES as u32).to_le_bytes());
        put(16, &i.bytes.to_le_bytes());
        put(24, &i.grid.posts_per_degree.to_le_bytes());
        put(28, &u32::from(i.levels).to_le_bytes());
        for (at, value) in [
            (32, i.unit_m),
            (40, i.base_m),
            (48, i.height_min_m),
            (56, i.height_max_m),
        ] {
            put(at, &value.to_le_bytes());
        }
        put(64, &rect_bytes(&i.rect));
        for (at, value) in [
            (80, i.tiles),
            (88, i.posts),
            (96, i.void_posts),
            (104, i.water_posts),
            (112, self.offsets[0]),
            (120, self.offsets[1]),
            (128, self.offsets[2]),
        ] {
            put(at, &value.to_le_bytes());
        }
        for (at, crc) in [136, 140, 144].into_iter().zip(self.crcs) {
            put(at, &crc.to_le_bytes());
        }
        let crc = CRC.checksum(&bytes[..HEADER_BYTES - 4]);
        bytes[HEADER_BYTES - 4..].copy_from_slice(&crc.to_le_bytes());
        bytes
    }
}

fn array_at<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    let mut array = [0; N];
    array.copy_from_slice(&bytes[at..at + N]);
    array
}

pub(crate) fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(array_at(bytes, at))
}

pub(crate) fn i32_at(bytes: &[u8], at: usize) -> i32 {
    i32::from_le_bytes(array_at(bytes, at))
}

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes(array_at(bytes, at))
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(array_at(bytes, at))
}

fn f64_at(bytes: &[u8], at: usize) -> f64 {
    f64::from_le_bytes(array_at(bytes, at))
}

fn rect_at(bytes: &[u8], at: usize) -> PostRect {
    PostRect {
        south: i32_at(bytes, at),
        west: i32_at(bytes, at + 4),
        north: i32_at(bytes, at + 8),
        east: i32_at(bytes, at + 12),
    }
}

pub(crate) fn rect_bytes(rect: &PostRect) -> [u8; 16] {
    let mut bytes = [0; 16];
    for (chunk, value) in bytes
        .chunks_exact_mut(4)
        .zip([rect.south, rect.west, rect.north, rect.east])
    {
        chunk.copy_from_slice(&value.to_le_bytes());
    }
    bytes
}

impl Entry {
    pub(crate) fn to_bytes(self) -> [u8; ENTRY_BYTES] {
        let mut bytes = [0; ENTRY_BYTES];
        let mut put = |at: usize, field: &[u8]| bytes[at..at + field.len()].copy_from_slice(field);
        put(0, &[self.key.level]);
        put(4, &self.key.column.to_le_bytes());
        put(8, &self.key.row.to_le_bytes());
        put(12, &self.min.to_le_bytes());
        put(14, &self.max.to_le_bytes());
        put(16, &self.max_error_m.to_le_bytes());
        put(20, &self.void_posts.to_le_bytes());
        put(22, &self.water_posts.to_le_bytes());
        put(24, &self.offset.to_le_bytes());
        put(32, &self.length.to_le_bytes());
        put(36, &self.crc.to_le_bytes());
        bytes
    }

    fn parse(bytes: &[u8]) -> Self {
        Self {
            key: TileKey {
                level: bytes[0],
                column: i32_at(bytes, 4),
                row: i32_at(bytes, 8),
            },
            min: u16_at(bytes, 12),
            max: u16_at(bytes, 14),
            max_error_m: f32::from_le_bytes(array_at(bytes, 16)),
            void_posts: u16_at(bytes, 20),
            water_posts: u16_at(bytes, 22),
            offset: u64_at(bytes, 24),
            length: u32_at(bytes, 32),
            crc: u32_at(bytes, 36),
        }
    }
}

/// `None` where the entries contradict the header or each other.
fn parse_entries(bytes: &[u8], info: &PackInfo, tiles_end: u64) -> Option<Vec<Entry>> {
    let entries: Vec<Entry> = bytes.chunks_exact(ENTRY_BYTES).map(Entry::parse).collect();
    let whole = bytes.len().is_multiple_of(ENTRY_BYTES) && entries.len() as u64 == info.tiles;
    let sorted = entries.is_sorted_by(|a, b| a.key < b.key);
    // Within these no coordinate of a post of the tile can overflow.
    let half_around = info.grid.posts_around();
    let side = i32::try_from(TILE_POSTS).ok()?;
    let placed = entries.iter().all(|e| {
        e.key.level < info.levels
            && e.key.column.abs() <= half_around / side
            && e.key.row.abs() <= half_around / side
            && e.length as usize <= STORED_BYTES_MAX
            && e.offset >= HEADER_BYTES as u64
            && e.offset
                .checked_add(u64::from(e.length))
                .is_some_and(|end| end <= tiles_end)
    });
    (whole && sorted && placed).then_some(entries)
}

fn parse_sources(bytes: &[u8]) -> Option<Vec<SourceInfo>> {
    let (count, mut rest) = bytes.split_first_chunk::<4>()?;
    let mut sources = Vec::new();
    for _ in 0..u32::from_le_bytes(*count) {
        let (fixed, tail) = rest.split_first_chunk::<18>()?;
        let (name, tail) = tail.split_at_checked(usize::from(u16_at(fixed, 16)))?;
        sources.push(SourceInfo {
            name: std::str::from_utf8(name).ok()?.to_owned(),
            rect: rect_at(fixed, 0),
        });
        rest = tail;
    }
    rest.is_empty().then_some(sources)
}
