//! Writes a pack. The file appears under its name only when it is whole: everything goes to a temporary file beside it,
//! which is synced and renamed at the end and removed if the writer is dropped before that.

use crate::terrain::codec::{Encoder, SurfaceKind, Tile};
use crate::terrain::geoid::GeoidGrid;
use crate::terrain::grid::{Grid, TileKey};
use crate::terrain::pack::{
    FORMAT, HEADER_BYTES, LevelError, LevelErrors, PackInfo, PostRect, SourceInfo, Tiles,
};
use crate::terrain::pack_format::{CRC, Entry, Header, partitions, rect_bytes};
use crate::terrain::partition::Partition;
use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// How a pack's quanta become heights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// Height of one unit of quanta, metres.
    pub unit_m: f64,
    /// Orthometric height of quanta 0, metres.
    pub base_m: f64,
}

impl Scale {
    /// The nearest quanta to an orthometric height in metres; the ends of the range for what lies beyond.
    #[must_use]
    pub fn quanta(&self, height_m: f64) -> u16 {
        let q = ((height_m - self.base_m) / self.unit_m).round();
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "clamped to the range of u16"
        )]
        {
            q.clamp(0.0, f64::from(u16::MAX)) as u16
        }
    }

    /// The orthometric height of quanta, metres.
    #[must_use]
    pub fn height_m(&self, quanta: u16) -> f64 {
        self.base_m + f64::from(quanta) * self.unit_m
    }
}

/// A tile ready to be written.
#[derive(Debug)]
pub struct EncodedTile {
    entry: Entry,
    stored: Vec<u8>,
}

impl EncodedTile {
    /// Encodes a tile; `max_error_m` is the largest difference between its heights and their source.
    #[must_use]
    pub fn new(encoder: &mut Encoder, key: TileKey, tile: &Tile, max_error_m: f32) -> Self {
        let stored = encoder.encode(tile);
        let count = |kind: SurfaceKind| {
            let n = tile.kind.iter().filter(|k| **k == kind).count();
            u16::try_from(n).unwrap_or(u16::MAX)
        };
        let entry = Entry {
            key,
            min: tile.quanta.iter().copied().min().unwrap_or(0),
            max: tile.quanta.iter().copied().max().unwrap_or(0),
            max_error_m,
            void_posts: count(SurfaceKind::Void),
            water_posts: count(SurfaceKind::Water),
            offset: 0,
            length: u32::try_from(stored.len()).unwrap_or(u32::MAX),
            crc: CRC.checksum(&stored),
        };
        Self { entry, stored }
    }
}

/// What the header says beyond what the writer knows from its tiles.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Lowest and highest orthometric height of level-0 posts that are not void, metres; `None` if all are.
    pub heights_m: Option<(f64, f64)>,
    /// Level-0 posts covered by a source.
    pub posts: u64,
    /// Of these, void.
    pub void_posts: u64,
    /// Of these, water.
    pub water_posts: u64,
}

/// A pack being written.
#[derive(Debug)]
pub struct PackWriter {
    out: BufWriter<File>,
    part: PathBuf,
    target: PathBuf,
    grid: Grid,
    scale: Scale,
    end: u64,
    entries: Vec<Entry>,
    level_errors: LevelErrors,
    finished: bool,
}

impl PackWriter {
    /// Begins a pack that will be `target`.
    ///
    /// # Errors
    /// If the temporary file beside it cannot be made.
    pub fn create(target: &Path, grid: Grid, scale: Scale) -> io::Result<Self> {
        Self::beside(target, "part", grid, scale)
    }

    /// The same, whose temporary file ends in `ending`: one that is never finished is a place for tiles until it is dropped.
    pub(crate) fn beside(
        target: &Path,
        ending: &str,
        grid: Grid,
        scale: Scale,
    ) -> io::Result<Self> {
        let name = target
            .file_name()
            .ok_or_else(|| io::Error::from(io::ErrorKind::InvalidFilename))?;
        if target.is_dir() {
            return Err(io::Error::from(io::ErrorKind::IsADirectory));
        }
        let mut part_name = std::ffi::OsString::from(".");
        part_name.push(name);
        part_name.push(format!(".{}.{ending}", std::process::id()));
        let part = target.with_file_name(part_name);
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .create_new(true)
            .open(&part)?;
        let mut writer = Self {
            out: BufWriter::with_capacity(1 << 20, file),
            part,
            target: target.to_owned(),
            grid,
            scale,
            end: HEADER_BYTES as u64,
            entries: Vec::new(),
            level_errors: LevelErrors::default(),
            finished: false,
        };
        // The header's place; its bytes are known at the end.
        writer.out.write_all(&[0; HEADER_BYTES])?;
        Ok(writer)
    }

    /// Adds a tile. Tiles may come in any order, each key once.
    ///
    /// # Errors
    /// If writing fails.
    pub fn add(&mut self, tile: &EncodedTile) -> io::Result<()> {
        self.out.write_all(&tile.stored)?;
        self.entries.push(Entry {
            offset: self.end,
            ..tile.entry
        });
        self.end += tile.stored.len() as u64;
        Ok(())
    }

    /// States how far a level is from the data.
    pub(crate) const fn state_error(&mut self, partition: Partition, level: u8, error: LevelError) {
        self.level_errors.0[partition as usize][level as usize] = Some(error);
    }

    /// States the errors of tiles, metres, in place of those they were added with.
    pub(crate) fn state_tile_errors(&mut self, errors: &BTreeMap<TileKey, f32>) {
        for entry in &mut self.entries {
            if let Some(error_m) = errors.get(&entry.key) {
                entry.max_error_m = *error_m;
            }
        }
    }

    /// The tiles written so far that are `wanted`, to be read while more are added.
    ///
    /// # Errors
    /// If what is buffered cannot be written, or the file not be read.
    pub(crate) fn written(&mut self, wanted: impl Fn(&TileKey) -> bool) -> io::Result<Tiles> {
        self.out.flush()?;
        let file = self.out.get_ref().try_clone()?;
        let entries = self.entries.iter().filter(|e| wanted(&e.key));
        let mut entries: Vec<Entry> = entries.copied().collect();
        entries.sort_unstable_by_key(|e| e.key);
        Ok(Tiles::new(file, entries))
    }

    /// Writes index, geoid, sources and header, syncs, and gives the file its name.
    ///
    /// # Errors
    /// If writing fails; the temporary file is then removed.
    pub fn finish(
        mut self,
        geoid: &GeoidGrid,
        sources: &[SourceInfo],
        statistics: &Statistics,
    ) -> io::Result<PackInfo> {
        self.entries.sort_unstable_by_key(|e| e.key);
        debug_assert!(
            self.entries.is_sorted_by(|a, b| a.key < b.key),
            "each tile comes once"
        );
        let mut index = Vec::with_capacity(self.entries.len() * crate::terrain::pack::ENTRY_BYTES);
        for entry in &self.entries {
            index.extend(entry.to_bytes());
        }
        let geoid = geoid.to_bytes();
        let sources_bytes = sources_section(sources);
        let mut offsets = [self.end; 3];
        offsets[1] = offsets[0] + index.len() as u64;
        offsets[2] = offsets[1] + geoid.len() as u64;
        let header = Header {
            info: self.info(sources, statistics, offsets[2] + sources_bytes.len() as u64),
            offsets,
            crcs: [&index, &geoid, &sources_bytes].map(|s| CRC.checksum(s)),
        };
        for section in [&index, &geoid, &sources_bytes] {
            self.out.write_all(section)?;
        }
        self.out.seek(SeekFrom::Start(0))?;
        self.out.write_all(&header.to_bytes())?;
        self.out.flush()?;
        self.out.get_ref().sync_all()?;
        fs::rename(&self.part, &self.target)?;
        self.finished = true;
        // The new name reaches the disk too. A folder that cannot be synced does not undo the pack.
        let folder = match self.target.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        let _ = File::open(folder).and_then(|f| f.sync_all());
        Ok(header.info)
    }

    fn info(&self, sources: &[SourceInfo], statistics: &Statistics, bytes: u64) -> PackInfo {
        let rect = PostRect::around(sources.iter().map(|s| s.rect)).unwrap_or(PostRect {
            south: 0,
            west: 0,
            north: 0,
            east: 0,
        });
        let (height_min_m, height_max_m) = statistics.heights_m.unwrap_or((0.0, 0.0));
        PackInfo {
            version: FORMAT,
            grid: self.grid,
            levels: self.grid.level_count(),
            partitions: partitions(&self.entries),
            rect,
            bounds: rect.bounds(self.grid),
            unit_m: self.scale.unit_m,
            base_m: self.scale.base_m,
            height_min_m,
            height_max_m,
            tiles: self.entries.len() as u64,
            posts: statistics.posts,
            void_posts: statistics.void_posts,
            water_posts: statistics.water_posts,
            bytes,
            level_errors: self.level_errors,
        }
    }
}

impl Drop for PackWriter {
    fn drop(&mut self) {
        if !self.finished {
            // Nothing more can be done about a file that cannot be removed.
            let _ = fs::remove_file(&self.part);
        }
    }
}

fn sources_section(sources: &[SourceInfo]) -> Vec<u8> {
    let count = u32::try_from(sources.len()).unwrap_or(u32::MAX);
    let mut bytes = count.to_le_bytes().to_vec();
    for source in sources {
        bytes.extend(rect_bytes(&source.rect));
        // A file name is at most 255 bytes on Linux.
        let name = source.name.as_bytes();
        let name = &name[..name.len().min(255)];
        bytes.extend(u16::try_from(name.len()).unwrap_or(0).to_le_bytes());
        bytes.extend(name);
    }
    bytes
}
