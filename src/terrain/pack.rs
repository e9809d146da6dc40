//! The pack: one file that holds a terrain's tiles, and its reader. The writer is [`crate::terrain::store`].
//!
//! # Format 4
//!
//! Little endian throughout, no gaps. CRC is CRC-32/ISO-HDLC (zlib's). *Post coordinates* are those of level 0 of
//! [`Grid`]; a rectangle is south, west, north, east, all inclusive, and its east may pass 180 degrees.
//!
//! | section | where |
//! |---|---|
//! | header | byte 0, 736 bytes |
//! | stored tiles | from byte 736, one after the other ([`crate::terrain::codec`] says what is in them) |
//! | index | header's index offset up to the geoid offset: 40 bytes for each tile, sorted by partition, level, row, column |
//! | geoid | up to the sources offset |
//! | sources | up to the end of the file |
//!
//! Header:
//!
//! | byte | type | what |
//! |---|---|---|
//! | 0 | 8 bytes | `GLASWPCK` |
//! | 8 | u32 | format, 4 |
//! | 12 | u32 | bytes of the header, 736 |
//! | 16 | u64 | bytes of the file |
//! | 24 | u32 | posts per degree of level 0 |
//! | 28 | u32 | number of levels |
//! | 32 | f64 | unit of a height, metres |
//! | 40 | f64 | orthometric height of quanta 0, metres |
//! | 48, 56 | f64, f64 | lowest and highest orthometric height that is not void, metres; 0, 0 where all is |
//! | 64 | 4 x i32 | rectangle around everything covered, in the geographic partition |
//! | 80 | u64 | tiles |
//! | 88, 96, 104 | 3 x u64 | level-0 posts of the geographic partition covered by a source; of these void; of these water |
//! | 112, 120, 128 | 3 x u64 | offsets of index, geoid and sources |
//! | 136, 140, 144 | 3 x u32 | their CRCs |
//! | 148 | 8 bytes | zero |
//! | 156 | 3 x 12 x 4 f32 | for each partition, for each level: `rms_m`, `max_m`, `low_m`, `summit_low_m` of [`LevelError`]; -1, -1, -1, -1 where the partition has no such level |
//! | 732 | u32 | CRC of bytes 0 to 731 |
//!
//! Index entry:
//!
//! | byte | type | what |
//! |---|---|---|
//! | 0 | u8 | level |
//! | 1 | u8 | partition: 0 geographic, 1 north cap, 2 south cap ([`Partition`]); 2 bytes of zero follow |
//! | 4, 8 | i32, i32 | tile column, tile row |
//! | 12, 14 | u16, u16 | lowest and highest quanta among all posts, filled ones too |
//! | 16 | f32 | largest difference between a stored height and its source, metres; 0 for copied whole metres. In a cap and on coarse levels: between the triangles of its cells and the finest geographic posts, with their own difference added |
//! | 20, 22 | u16, u16 | void posts (posts outside every source too), water posts |
//! | 24 | u64 | offset of the stored bytes |
//! | 32, 36 | u32, u32 | their number and CRC |
//!
//! Geoid: south and west node (i32, in 15' from 0N 0E), rows, columns (u32), then rows x columns EGM96 undulations (i32,
//! millimetres, southern row first, west first; the lowest i32 where there is none). Sources: their number (u32), and for
//! each its rectangle (4 x i32) and its name (u16 length, UTF-8).
//!
//! Format 1 had no partitions and fewer levels; the coarse levels of format 2 were copies of some posts of the finest, among
//! which summits went missing; tiles of format 3 with voids were predicted otherwise. None is read any more: packs are baked
//! again from their sources.
//!
//! Every byte of the file is under one of the checksums: a flipped bit is always found, when the pack is opened (header,
//! index, geoid, sources) or when the tile it is in is read.

use crate::limits::LEVELS_MAX;
use crate::terrain::codec::{CodecError, Decoder, STORED_BYTES_MAX, Tile};
use crate::terrain::geoid::GeoidGrid;
use crate::terrain::grid::{Grid, TileKey};
use crate::terrain::pack_format::{CRC, Entry, Header, parse_entries, parse_sources, partitions};
use crate::terrain::partition::Partition;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;

pub use crate::terrain::codec::SurfaceKind;
pub use crate::terrain::grid::{Bounds, PostRect};

/// First bytes of every pack.
pub const MAGIC: [u8; 8] = *b"GLASWPCK";
/// The format that this program writes, and the newest it reads.
pub const FORMAT: u32 = 4;
/// Bytes of the header.
pub const HEADER_BYTES: usize = 160 + 3 * LEVELS_MAX * 16;
/// Bytes of an index entry.
pub const ENTRY_BYTES: usize = 40;

/// One input of the bake.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceInfo {
    /// The file's name, without folders.
    pub name: String,
    /// The posts it covers, cut by the bake's region.
    pub rect: PostRect,
}

/// What a pack is, from its header and its index.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PackInfo {
    /// Its format.
    pub version: u32,
    /// Its grid.
    pub grid: Grid,
    /// Number of levels: 0 to this less one.
    pub levels: u8,
    /// Whether there are tiles of a partition, by its number.
    pub partitions: [bool; 3],
    /// The posts of level 0 that frame everything covered, in the geographic partition.
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
    /// Tiles of all levels and partitions.
    pub tiles: u64,
    /// Level-0 posts of the geographic partition that a source covers.
    pub posts: u64,
    /// Of these, void.
    pub void_posts: u64,
    /// Of these, water.
    pub water_posts: u64,
    /// Bytes of the file.
    pub bytes: u64,
    /// How far its levels are from the data.
    pub level_errors: LevelErrors,
}

/// How far the surface of a level, its triangles, is from the posts of the finest level; for a cap, from those of the
/// geographic partition, which it was made from. Voids, and triangles with a void corner, are left out.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LevelError {
    /// Root mean square of the difference, metres.
    pub rms_m: f32,
    /// The largest difference either way, metres.
    pub max_m: f32,
    /// By how much the surface lies below a post at most, metres.
    pub low_m: f32,
    /// By how much it lies below a summit at most, metres: a measured post that no measured neighbour is higher than.
    pub summit_low_m: f32,
}

/// What is known of the levels' errors, by partition and level; by default nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LevelErrors(pub [[Option<LevelError>; LEVELS_MAX]; 3]);

impl PackInfo {
    /// How far the surface of a level is from the data; `None` where there is no such level, or it is not known.
    #[must_use]
    pub fn level_error(&self, partition: Partition, level: u8) -> Option<LevelError> {
        let levels = &self.level_errors.0[partition as usize];
        *levels.get(usize::from(level))?
    }

    /// Whether there are tiles of a partition.
    #[must_use]
    pub const fn has(&self, partition: Partition) -> bool {
        self.partitions[partition as usize]
    }
}

/// What the index says of a tile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileHeader {
    /// Lowest orthometric height of a post (filled ones too), metres.
    pub min_m: f64,
    /// Highest orthometric height of a post (filled ones too), metres.
    pub max_m: f64,
    /// Largest difference between a stored height and its source, metres; 0 for copied whole metres. In a cap and on coarse
    /// levels: between the triangles of its cells and the finest geographic posts, with their own difference added.
    pub max_error_m: f32,
    /// Void posts, those outside every source too.
    pub void_posts: u16,
    /// Water posts.
    pub water_posts: u16,
    /// Bytes it takes in the file.
    pub stored_bytes: u32,
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

/// Tiles in a file, by their index: those of a pack, or those that a bake has written so far.
#[derive(Debug)]
pub(crate) struct Tiles {
    file: File,
    /// Sorted by key.
    entries: Vec<Entry>,
}

impl Tiles {
    pub(crate) const fn new(file: File, entries: Vec<Entry>) -> Self {
        Self { file, entries }
    }

    pub(crate) fn entries(&self) -> &[Entry] {
        &self.entries
    }

    pub(crate) fn entry(&self, key: TileKey) -> Option<&Entry> {
        let at = self.entries.binary_search_by_key(&key, |e| e.key).ok()?;
        self.entries.get(at)
    }

    /// Reads a tile. Allocates nothing; blocks on the disk. On an error `tile` is unchanged.
    pub(crate) fn read(
        &self,
        key: TileKey,
        reader: &mut TileReader,
        tile: &mut Tile,
    ) -> Result<(), TileError> {
        let entry = self.entry(key).ok_or(TileError::Absent)?;
        // No entry is longer than the buffer: the encoder makes none, and opening a pack refuses others.
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
}

/// An open pack: the file, and its index, geoid and sources in memory. Threads may share it.
#[derive(Debug)]
pub struct Pack {
    tiles: Tiles,
    info: PackInfo,
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
        let info = PackInfo {
            partitions: partitions(&entries),
            ..header.info
        };
        let geoid = section(geoid, sources, header.crcs[1], "geoid")?;
        let geoid = GeoidGrid::from_bytes(&geoid).ok_or(PackError::Damaged("geoid"))?;
        let sources = section(sources, info.bytes, header.crcs[2], "list of sources")?;
        let sources = parse_sources(&sources).ok_or(PackError::Damaged("list of sources"))?;
        Ok(Self {
            tiles: Tiles::new(file, entries),
            info,
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

    /// Every tile it has, in the order of the index: partition, level, row, column.
    pub fn keys(&self) -> impl Iterator<Item = TileKey> + '_ {
        self.tiles.entries().iter().map(|e| e.key)
    }

    /// Whether it has a tile.
    #[must_use]
    pub fn contains(&self, key: TileKey) -> bool {
        self.tiles.entry(key).is_some()
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
        let entry = self.tiles.entry(key)?;
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
        self.tiles.read(key, reader, tile)
    }
}
