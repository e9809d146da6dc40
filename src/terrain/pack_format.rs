//! The bytes of a pack's header, index and list of sources, written and read. The format is described in
//! [`crate::terrain::pack`].

use crate::limits::{LEVELS_MAX, TILE_POSTS};
use crate::terrain::codec::STORED_BYTES_MAX;
use crate::terrain::grid::{Grid, POSTS_PER_DEGREE, PostRect, TileKey};
use crate::terrain::pack::{
    ENTRY_BYTES, FORMAT, HEADER_BYTES, LevelError, LevelErrors, MAGIC, PackError, PackInfo,
    SourceInfo,
};
use crate::terrain::partition::Partition;
use crc::{CRC_32_ISO_HDLC, Crc, Table};
use std::fs::File;
use std::os::unix::fs::FileExt;

/// The checksum of everything in a pack.
pub(crate) static CRC: Crc<u32, Table<16>> = Crc::<u32, Table<16>>::new(&CRC_32_ISO_HDLC);

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

/// The header, once checked.
pub(crate) struct Header {
    pub(crate) info: PackInfo,
    /// Of index, geoid and sources.
    pub(crate) offsets: [u64; 3],
    /// Of the same.
    pub(crate) crcs: [u32; 3],
}

impl Header {
    pub(crate) fn read(file: &File, have: u64) -> Result<Self, PackError> {
        let mut bytes = [0; HEADER_BYTES];
        let wanted = have.min(HEADER_BYTES as u64);
        let wanted = usize::try_from(wanted).unwrap_or(HEADER_BYTES);
        file.read_exact_at(&mut bytes[..wanted], 0)
            .map_err(PackError::Io)?;
        if wanted < MAGIC.len() || !bytes.starts_with(&MAGIC) {
            return Err(PackError::NotAPack);
        }
        // What is cut shorter than the format's number has no format of its own.
        if wanted >= 12 {
            match u32_at(&bytes, 8) {
                FORMAT => {}
                newer if newer > FORMAT => return Err(PackError::Newer(newer)),
                older => return Err(PackError::Older(older)),
            }
        }
        if wanted < HEADER_BYTES {
            return Err(PackError::CutShort {
                have,
                want: HEADER_BYTES as u64,
            });
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
            && POSTS_PER_DEGREE.contains(&grid.posts_per_degree)
            && usize::from(levels) <= LEVELS_MAX;
        if !sane {
            return None;
        }
        let info = PackInfo {
            version: u32_at(bytes, 8),
            grid,
            levels,
            // Known from the index.
            partitions: [false; 3],
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
            level_errors: level_errors_at(bytes)?,
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
        #[expect(clippy::cast_possible_truncation, reason = "736")]
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
        for (at, error) in (LEVEL_ERRORS_AT..)
            .step_by(16)
            .zip(i.level_errors.0.as_flattened())
        {
            put(at, &level_error_bytes(*error));
        }
        let crc = CRC.checksum(&bytes[..HEADER_BYTES - 4]);
        bytes[HEADER_BYTES - 4..].copy_from_slice(&crc.to_le_bytes());
        bytes
    }
}

/// Where the errors of the levels begin in the header.
const LEVEL_ERRORS_AT: usize = 156;

/// The number that stands in the place of an error that does not exist.
const NO_ERROR: f32 = -1.0;

fn level_error_bytes(error: Option<LevelError>) -> [u8; 16] {
    let numbers = error.map_or([NO_ERROR; 4], |e| {
        [e.rms_m, e.max_m, e.low_m, e.summit_low_m]
    });
    let mut bytes = [0; 16];
    for (chunk, number) in bytes.chunks_exact_mut(4).zip(numbers) {
        chunk.copy_from_slice(&number.to_le_bytes());
    }
    bytes
}

/// `None` where one is neither a height nor the number that stands for none.
fn level_errors_at(bytes: &[u8]) -> Option<LevelErrors> {
    let mut errors = LevelErrors::default();
    for (at, error) in (LEVEL_ERRORS_AT..)
        .step_by(16)
        .zip(errors.0.as_flattened_mut())
    {
        let numbers = [0, 4, 8, 12].map(|field| f32::from_le_bytes(array_at(bytes, at + field)));
        if numbers.iter().all(|n| n.is_finite() && *n >= 0.0) {
            let [rms_m, max_m, low_m, summit_low_m] = numbers;
            *error = Some(LevelError {
                rms_m,
                max_m,
                low_m,
                summit_low_m,
            });
        } else if numbers.map(f32::to_bits) != [NO_ERROR.to_bits(); 4] {
            return None;
        }
    }
    Some(errors)
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
        put(0, &[self.key.level, self.key.partition as u8]);
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

    /// `None` for a partition that does not exist.
    fn parse(bytes: &[u8]) -> Option<Self> {
        Some(Self {
            key: TileKey {
                partition: Partition::from_number(bytes[1])?,
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
        })
    }
}

/// `None` where the entries contradict the header or each other.
pub(crate) fn parse_entries(bytes: &[u8], info: &PackInfo, tiles_end: u64) -> Option<Vec<Entry>> {
    let entries = bytes.chunks_exact(ENTRY_BYTES).map(Entry::parse);
    let entries: Vec<Entry> = entries.collect::<Option<_>>()?;
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

/// Which partitions have tiles, by number.
pub(crate) fn partitions(entries: &[Entry]) -> [bool; 3] {
    Partition::ALL.map(|p| entries.iter().any(|e| e.key.partition == p))
}

pub(crate) fn parse_sources(bytes: &[u8]) -> Option<Vec<SourceInfo>> {
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
