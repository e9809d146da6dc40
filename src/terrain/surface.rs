//! From tiles to texels: the ellipsoidal height of any post of any level, its height in the next coarser level's surface,
//! its normal, and what it is. Runs on the streaming worker; allocates only when made.
//!
//! What is missing stays drawn and is marked. A post without a tile lies on the geoid; a tile that cannot be read is
//! filled from the next coarser level, as that level's triangles lie; both are void, and damage is counted. Every level
//! asks the same function, so a post that two levels share has one height on both, whatever was damaged.

use super::clipmap::TorusPart;
use super::codec::{SurfaceKind, Tile};
use super::credit::Credit;
use super::grid::{Grid, TILE_SIDE, TileKey};
use super::pack::{LevelError, Pack, PackInfo, TileError, TileReader};
use super::partition::Partition;
use super::tables::HeightCode;
use super::texel::{encode_crest, encode_kind, encode_normal};
use super::tile_cache::{self, Found, TileCache};
use crate::geo::{meridian_radius_m, prime_vertical_radius_m};
use crate::units::Radians;
use arrayvec::ArrayVec;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

pub use super::tile_cache::{TILES_KEPT, TILES_KEPT_MIN};

/// Texels of the largest job: 64 x 64, or a strip of 16 x 255 or 8 x 447.
pub const BATCH_TEXELS: usize = 4096;

/// Where tiles come from: a [`Pack`], or a stand-in for it in tests.
pub trait TileSource: Send + Sync + std::fmt::Debug + 'static {
    /// What there is.
    fn info(&self) -> &PackInfo;
    /// Whether there are tiles of a partition.
    fn has(&self, partition: Partition) -> bool {
        self.info().has(partition)
    }
    /// How far the surface of a level is from the data; see [`PackInfo::level_error`].
    fn level_error(&self, partition: Partition, level: u8) -> Option<LevelError> {
        self.info().level_error(partition, level)
    }
    /// Whether there is such a tile.
    fn contains(&self, key: TileKey) -> bool;
    /// Height of the geoid above the ellipsoid at a point, metres, continuous over all of the Earth; `None` where it is not
    /// known.
    fn undulation_m(&self, latitude: Radians, longitude: Radians) -> Option<f64>;
    /// Reads a tile without allocating.
    ///
    /// # Errors
    /// [`TileError`]; `tile` is then unchanged.
    fn read_tile(
        &self,
        key: TileKey,
        reader: &mut TileReader,
        tile: &mut Tile,
    ) -> Result<(), TileError>;
}

impl TileSource for Pack {
    fn info(&self) -> &PackInfo {
        Self::info(self)
    }

    fn contains(&self, key: TileKey) -> bool {
        Self::contains(self, key)
    }

    fn undulation_m(&self, latitude: Radians, longitude: Radians) -> Option<f64> {
        Some(self.geoid().undulation_anywhere_m(latitude, longitude))
    }

    fn read_tile(
        &self,
        key: TileKey,
        reader: &mut TileReader,
        tile: &mut Tile,
    ) -> Result<(), TileError> {
        Self::read_tile(self, key, reader, tile)
    }
}

/// Tiles that could not be read since the start, by reason. A tile counts again when it was forgotten and read again.
#[derive(Debug, Default)]
pub struct Damage {
    checksum: AtomicU32,
    content: AtomicU32,
    reading: AtomicU32,
}

/// A copy of [`Damage`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DamageCounts {
    /// Tiles that fail their checksum.
    pub checksum: u32,
    /// Tiles whose bytes are no tile.
    pub content: u32,
    /// Tiles that the disk or the file system did not give.
    pub reading: u32,
}

impl Damage {
    /// The counts so far.
    #[must_use]
    pub fn counts(&self) -> DamageCounts {
        DamageCounts {
            checksum: self.checksum.load(Ordering::Relaxed),
            content: self.content.load(Ordering::Relaxed),
            reading: self.reading.load(Ordering::Relaxed),
        }
    }

    pub(super) fn count(&self, error: &TileError) {
        let counter = match error {
            TileError::Absent => return,
            TileError::Checksum => &self.checksum,
            TileError::Codec(_) => &self.content,
            TileError::CutShort | TileError::Io(_) => &self.reading,
        };
        counter.fetch_add(1, Ordering::Relaxed);
    }
}

/// Texels of up to four torus parts, one after the other, each row by row from its south-west texel.
#[derive(Debug)]
pub struct Batch {
    /// (own height code, height code of the next coarser level's surface).
    pub heights: Box<[[u16; 2]]>,
    /// (normal east, normal north, crest, kind): [`encode_normal`], [`encode_crest`], [`encode_kind`].
    pub surface: Box<[[u8; 4]]>,
    /// The parts that are filled.
    pub parts: ArrayVec<TorusPart, 4>,
}

impl Batch {
    /// An empty one with room for [`BATCH_TEXELS`].
    #[must_use]
    pub fn new() -> Self {
        Self {
            heights: vec![[0; 2]; BATCH_TEXELS].into_boxed_slice(),
            surface: vec![[0; 4]; BATCH_TEXELS].into_boxed_slice(),
            parts: ArrayVec::new(),
        }
    }
}

impl Default for Batch {
    fn default() -> Self {
        Self::new()
    }
}

#[derive(Clone, Copy, Debug)]
struct Post {
    code: u16,
    kind: SurfaceKind,
}

const NO_POST: Post = Post {
    code: 0,
    kind: SurfaceKind::Void,
};

/// Makes texels from tiles.
#[derive(Debug)]
pub struct Sampler<'a, S> {
    source: &'a S,
    partition: Partition,
    heights: HeightCode,
    grid: Grid,
    levels: u8,
    tiles: TileCache<'a, S>,
    own: Vec<Post>,
    coarse: Vec<Post>,
}

/// The own posts of a part with a border of one, and the coarser ones under it: at most 66 x 66, 18 x 257 or 10 x 449.
const SCRATCH_POSTS: usize = 5000;

/// Bytes that a sampler takes which keeps so many tiles.
#[must_use]
pub const fn cache_bytes(tiles: usize) -> usize {
    tile_cache::bytes(tiles) + 2 * SCRATCH_POSTS * size_of::<Post>()
}

impl<'a, S: TileSource> Sampler<'a, S> {
    /// For the tiles of one partition. Allocates everything it will ever need.
    #[must_use]
    pub fn new(
        source: &'a S,
        partition: Partition,
        heights: HeightCode,
        damage: &'a Damage,
    ) -> Self {
        Self {
            source,
            partition,
            heights,
            grid: source.info().grid,
            levels: source.info().levels,
            tiles: TileCache::new(source, damage),
            own: vec![NO_POST; SCRATCH_POSTS],
            coarse: vec![NO_POST; SCRATCH_POSTS],
        }
    }

    /// Keeps so many tiles, at least [`TILES_KEPT_MIN`], all of them forgotten now.
    #[must_use]
    pub fn keeping(mut self, tiles: usize) -> Self {
        self.tiles.keep(tiles);
        self
    }

    /// Decodes only what is granted, and waits for more; not once it is told to stop.
    #[must_use]
    pub const fn on_credit(mut self, credit: &'a Credit, stop: &'a AtomicBool) -> Self {
        self.tiles.credit = Some((credit, stop));
        self
    }

    /// Whether a tile could not be read since this was last asked: by the disk's fault, not its own.
    pub const fn take_unread(&mut self) -> bool {
        std::mem::replace(&mut self.tiles.unread, false)
    }

    /// Goes over to the tiles of a partition.
    pub const fn enter(&mut self, partition: Partition) {
        self.partition = partition;
    }

    /// Fills `heights` and `surface` with the texels of the posts at (`i`, `j`), `width` x `height`, row by row from the
    /// south-west one. Nothing larger than [`BATCH_TEXELS`] is asked.
    pub fn fill(
        &mut self,
        level: u8,
        (i, j): (i32, i32),
        (width, height): (usize, usize),
        heights: &mut [[u16; 2]],
        surface: &mut [[u8; 4]],
    ) {
        let (border_w, border_h) = (width + 2, height + 2);
        let mut own = std::mem::take(&mut self.own);
        self.patch(level, (i - 1, j - 1), (border_w, border_h), &mut own);
        for y in 0..height {
            let scale = self.slope_scale(level, j + signed(y));
            for x in 0..width {
                let at = (y + 1) * border_w + x + 1;
                let post = own[at];
                heights[y * width + x] = [post.code, post.code];
                let rise = |a: usize, b: usize| f64::from(own[b].code) - f64::from(own[a].code);
                let east = -rise(at - 1, at + 1) * scale.0;
                let north = -rise(at - border_w, at + border_w) * scale.1;
                let length = (east * east + north * north + 1.0).sqrt();
                surface[y * width + x] = [
                    encode_normal(east / length),
                    encode_normal(north / length),
                    encode_crest(crest(&own, at, border_w) * scale.1),
                    encode_kind(post.kind),
                ];
            }
        }
        self.own = own;
        if level + 1 < self.levels {
            self.fill_coarse(level, (i, j), (width, height), heights);
        }
    }

    /// Reads the tiles under a rectangle of posts, as long as it is not told to leave off. Returns whether it was.
    pub fn fetch(
        &mut self,
        level: u8,
        (i, j): (i32, i32),
        (width, height): (usize, usize),
        mut leaves_off: impl FnMut() -> bool,
    ) -> bool {
        let mut x = 0;
        while x < width {
            // What this level has no post for comes from finer levels, which are fetched for themselves.
            let Some(canonical) = self.canonical_at(level, i + signed(x)) else {
                x += 1;
                continue;
            };
            let run = unsigned(TILE_SIDE - canonical.rem_euclid(TILE_SIDE)).min(width - x);
            let mut y = 0;
            while y < height {
                if leaves_off() {
                    return true;
                }
                let row = j + signed(y);
                self.tiles
                    .tile(TileKey::of_post(self.partition, level, canonical, row));
                y += unsigned(TILE_SIDE - row.rem_euclid(TILE_SIDE)).min(height - y);
            }
            x += self.run_before_date_line(level, canonical, run);
        }
        false
    }

    /// The second component of `heights`: the next coarser level's triangles at these posts.
    fn fill_coarse(
        &mut self,
        level: u8,
        (i, j): (i32, i32),
        (width, height): (usize, usize),
        heights: &mut [[u16; 2]],
    ) {
        let (ci, cj) = (i.div_euclid(2), j.div_euclid(2));
        let (cw, ch) = (width / 2 + 2, height / 2 + 2);
        let mut coarse = std::mem::take(&mut self.coarse);
        self.patch(level + 1, (ci, cj), (cw, ch), &mut coarse);
        for y in 0..height {
            for x in 0..width {
                let [a, b] = coarse_pair(i + signed(x), j + signed(y));
                let code = |(pi, pj): (i32, i32)| {
                    let at = (pj - cj).cast_unsigned() as usize * cw
                        + (pi - ci).cast_unsigned() as usize;
                    coarse[at].code
                };
                heights[y * width + x][1] = mean(code(a), code(b));
            }
        }
        self.coarse = coarse;
    }

    /// Slope per code of height difference across two posts, eastwards and northwards, at a row.
    fn slope_scale(&self, level: u8, j: i32) -> (f64, f64) {
        let latitude = self.grid.latitude_deg(level, j).to_radians();
        let spacing = self.grid.spacing_deg(level).to_radians();
        let (sin, cos) = latitude.sin_cos();
        let (wide_m, long_m) = match self.partition {
            Partition::Geographic => (prime_vertical_radius_m(sin), meridian_radius_m(sin)),
            // The radius at a pole; at the seam it is 0.04 to 0.12 % off.
            Partition::North | Partition::South => {
                (prime_vertical_radius_m(1.0), prime_vertical_radius_m(1.0))
            }
        };
        let east_m = 2.0 * spacing * wide_m * cos.max(1e-3);
        let north_m = 2.0 * spacing * long_m;
        (self.heights.unit_m / east_m, self.heights.unit_m / north_m)
    }

    /// Posts of a level, row by row from (`i`, `j`).
    fn patch(
        &mut self,
        level: u8,
        (i, j): (i32, i32),
        (width, height): (usize, usize),
        out: &mut [Post],
    ) {
        let mut x = 0;
        while x < width {
            let column = i + signed(x);
            let Some(canonical) = self.canonical_at(level, column) else {
                // This level has no post there: the first finer one that closes around the Earth has.
                for y in 0..height {
                    out[y * width + x] = self.post(level, column, j + signed(y));
                }
                x += 1;
                continue;
            };
            // Up to the tile's eastern side, which is also where the date line would be passed, or is well before it.
            let run = unsigned(TILE_SIDE - canonical.rem_euclid(TILE_SIDE)).min(width - x);
            let run = self.run_before_date_line(level, canonical, run);
            let mut y = 0;
            while y < height {
                let row = j + signed(y);
                let rise = unsigned(TILE_SIDE - row.rem_euclid(TILE_SIDE)).min(height - y);
                let part = Part {
                    level,
                    i: canonical,
                    j: row,
                    width: run,
                    height: rise,
                };
                self.tile_part(part, width, &mut out[y * width + x..]);
                y += rise;
            }
            x += run;
        }
    }

    /// The column that stands for column `i` of a level; see [`Grid::canonical_at`]. A cap has no date line.
    fn canonical_at(&self, level: u8, i: i32) -> Option<i32> {
        match self.partition {
            Partition::Geographic => self.grid.canonical_at(level, i),
            Partition::North | Partition::South => Some(i),
        }
    }

    fn run_before_date_line(&self, level: u8, canonical: i32, run: usize) -> usize {
        let end = (self.grid.posts_around() / 2 - 1) >> level;
        run.min(unsigned(end - canonical + 1)).max(1)
    }

    /// Posts that lie in one tile.
    fn tile_part(&mut self, part: Part, stride: usize, out: &mut [Post]) {
        let key = TileKey::of_post(self.partition, part.level, part.i, part.j);
        let found = self.tiles.tile(key);
        for y in 0..part.height {
            for x in 0..part.width {
                let (i, j) = (part.i + signed(x), part.j + signed(y));
                out[y * stride + x] = match found {
                    Found::Ready(slot) => self.stored(slot, part.level, i, j),
                    Found::Absent => self.missing(part.level, i, j),
                    Found::Damaged => self.inherited(part.level, i, j),
                };
            }
        }
    }

    /// One post of any level, wherever its column lies.
    fn post(&mut self, level: u8, i: i32, j: i32) -> Post {
        let base = match self.partition {
            Partition::Geographic => self.grid.canonical(i << level),
            Partition::North | Partition::South => i << level,
        };
        #[expect(clippy::cast_possible_truncation, reason = "at most 32")]
        let own = level.min(base.trailing_zeros() as u8);
        let (i, j) = (base >> own, j << (level - own));
        match self.tiles.tile(TileKey::of_post(self.partition, own, i, j)) {
            Found::Ready(slot) => self.stored(slot, own, i, j),
            Found::Absent => self.missing(own, i, j),
            Found::Damaged => self.inherited(own, i, j),
        }
    }

    fn stored(&self, slot: usize, level: u8, i: i32, j: i32) -> Post {
        let tile = self.tiles.at(slot);
        let at = TileKey::index_of(i, j);
        let info = self.source.info();
        let orthometric_m = info.base_m + f64::from(tile.quanta[at]) * info.unit_m;
        Post {
            code: self.code(orthometric_m, level, i, j),
            kind: tile.kind[at],
        }
    }

    /// A post of no tile: the geoid's surface.
    fn missing(&self, level: u8, i: i32, j: i32) -> Post {
        Post {
            code: self.code(0.0, level, i, j),
            kind: SurfaceKind::Void,
        }
    }

    /// A post of a damaged tile: as the next coarser level lies there.
    fn inherited(&mut self, level: u8, i: i32, j: i32) -> Post {
        if level + 1 >= self.levels {
            return self.missing(level, i, j);
        }
        let [a, b] = coarse_pair(i, j);
        let first = self.post(level + 1, a.0, a.1).code;
        let second = if a == b {
            first
        } else {
            self.post(level + 1, b.0, b.1).code
        };
        Post {
            code: mean(first, second),
            kind: SurfaceKind::Void,
        }
    }

    fn code(&self, orthometric_m: f64, level: u8, i: i32, j: i32) -> u16 {
        let (longitude_deg, latitude_deg) = self.partition.to_geodetic(
            self.grid.longitude_deg(level, i),
            self.grid.latitude_deg(level, j),
        );
        let (latitude, longitude) = (
            Radians::from_degrees(latitude_deg),
            Radians::from_degrees(longitude_deg),
        );
        let undulation_m = self.source.undulation_m(latitude, longitude).unwrap_or(0.0);
        self.heights.encode(orthometric_m + undulation_m)
    }
}

/// Part of a tile: posts from (`i`, `j`).
#[derive(Clone, Copy, Debug)]
struct Part {
    level: u8,
    i: i32,
    j: i32,
    width: usize,
    height: usize,
}

/// The two posts of the next coarser level between which post (`i`, `j`) lies on that level's triangles: the same one
/// twice where they share it, the ends of an edge, or of the diagonal of a cell.
fn coarse_pair(i: i32, j: i32) -> [(i32, i32); 2] {
    let (ci, cj) = (i.div_euclid(2), j.div_euclid(2));
    match (i.rem_euclid(2), j.rem_euclid(2)) {
        (0, 0) => [(ci, cj); 2],
        (_, 0) => [(ci, cj), (ci + 1, cj)],
        (0, _) => [(ci, cj), (ci, cj + 1)],
        _ if (ci + cj).rem_euclid(2) == 0 => [(ci, cj), (ci + 1, cj + 1)],
        _ => [(ci + 1, cj), (ci, cj + 1)],
    }
}

const fn mean(a: u16, b: u16) -> u16 {
    u16::midpoint(a, b)
}

/// By how many codes a post stands above the mean of the eight around it.
fn crest(own: &[Post], at: usize, stride: usize) -> f64 {
    let row = |middle: usize| {
        own[middle - 1..=middle + 1]
            .iter()
            .map(|p| u32::from(p.code))
    };
    let all: u32 = row(at - stride)
        .chain(row(at))
        .chain(row(at + stride))
        .sum();
    let own = u32::from(own[at].code);
    f64::from(own) - f64::from(all - own) / 8.0
}

/// A count of posts, at most a few hundred, as a step.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    reason = "sides of batches are at most a few hundred posts"
)]
const fn signed(count: usize) -> i32 {
    count as i32
}

const fn unsigned(count: i32) -> usize {
    count.cast_unsigned() as usize
}
