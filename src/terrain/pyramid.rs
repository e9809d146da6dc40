//! The bounded-error codec: a tile predicted from the decoded tile of the next coarser level. Pure.
//!
//! The posts of a tile with even coordinates stand where a quarter of the coarser tile's posts do (its *parent*'s), so a
//! level is told by three quarters of its posts, and a pyramid of levels takes no more residuals than its finest level has
//! posts. What is predicted from is always what a reader will have: the decoded parent and the posts decoded before. Hence
//! no error adds up from level to level, and every level keeps the bound by itself.
//!
//! # Bound
//!
//! The residual r of a post of land is told as q = r / s rounded to the nearest, s = 2 e + 1 the tile's *step* in quanta; so
//! no post is further than e quanta from its height, at any level. Posts of water and voids are told exactly (s = 1), and so
//! is what each post is. s = 1 throughout is lossless.
//!
//! # Prediction
//!
//! By the four neighbours on a line, a to d, of which b and c are one post away: (9 (b + c) - a - d + 8) >> 4, the cubic
//! through them (Deslauriers and Dubuc 1989, Constructive Approximation 5, example for four points). In this order, each row
//! by row from the south and from the west:
//! 1. *even*, even columns and rows: the parent's post. Told only if one of the residuals is not 0, which is where the
//!    coarser level was raised for a summit.
//! 2. *east*, odd columns of even rows: from the even ones beside them.
//! 3. *north*, even columns of odd rows: from the even ones below and above.
//! 4. *both*, odd columns of odd rows: the mean, rounded up, of the cubic along the row (of 3) and along the column (of 2).
//!
//! Beyond the tile the parent goes on, on two sides; on the others the line through its last two posts does. Beyond the
//! eastern and northern side, 2 and 3 are what they are predicted as. A tile without a parent is predicted from one that is
//! flat. In a tile that is not all land, posts are predicted from neighbours of their own kind: by the cubic if all four are,
//! else by the mean, rounded up, of b and c if both are or neither is, else by that which is (what lies beyond the tile and
//! its parent is of the kind of the two posts that it is continued from, if they are alike, else of none); and *both* from the line on
//! which a neighbour is of its kind, if that is one only.
//!
//! # Contexts
//!
//! A residual's spread is foreseen from v: for *east* and *north* |a - b - c + d| and twice |q s| of the post of the same
//! sort one row south (on the first row |a - b - c + d| twice); for *both* twice the difference of its two cubics and |q s|
//! of the four posts beside it that 2 and 3 told. v / 3 D, for *both* v / 4 D, is compared with 3, 7, 12, 22, 37, 60 and 98
//! eighths, D the tile's *divisor*: contexts 0 to 7, for *both* 8 to 15. Posts that are not land: 16 if their b and c are of their
//! kind and equal, for *both* those of either line, else 17. *even*: 18 on land, 19 elsewhere.
//!
//! # Bytes
//!
//! | byte | what |
//! |---|---|
//! | 0 | 1: flat, 2: not all land, 4: *even* is told, 8: stands alone |
//! | 1 | u16 step; of a flat tile its quanta |
//! | 3 | u16 divisor; of a flat tile its kind, and nothing follows |
//! | 5 | u16 quanta of the flat parent of a tile that stands alone, else 0 |
//! | 7 | if not all land: u16 length, and so many bytes of deflate: 16384 kinds, each exclusive-or the kind of the parent's post at half its coordinates, rounded down (0 for a tile that stands alone) |
//! | then | the residuals in the order above ([`crate::terrain::rans`]) |

use crate::terrain::codec::{CodecError, SurfaceKind, Tile};
use crate::terrain::grid::{TILE_AREA, TileKey};
use crate::terrain::rans::{self, ROW, Reader, WORDS_MAX, Words, Writer};
use miniz_oxide::inflate::TINFLStatus;
use miniz_oxide::inflate::core::{DecompressorOxide, decompress, inflate_flags};
use work::{Contexts, FIRST, HALF, Residuals, Row, Sort, Work, cubic};

mod work;

use crate::limits::TILE_POSTS;

/// The most bytes a stored tile has: words and bits that follow them at most 29 bits a post, kinds that do not deflate, and
/// the header.
pub const PYRAMID_BYTES_MAX: usize = TILE_AREA * 29 / 8 + TILE_AREA + TILE_AREA / 16 + 64;

const FLAT: u8 = 1;
const KINDS: u8 = 2;
const EVEN: u8 = 4;
const ALONE: u8 = 8;
const HEADER: usize = 7;

/// A parent, and which of its quadrants is told.
#[derive(Clone, Copy, Debug)]
pub struct Parent<'a> {
    /// The decoded tile of the next coarser level.
    pub tile: &'a Tile,
    /// Whether the child lies in its eastern half.
    pub east: bool,
    /// Whether the child lies in its northern half.
    pub north: bool,
}

impl<'a> Parent<'a> {
    /// The parent of the tile `child`, whose key is [`parent_of`] it.
    #[must_use]
    pub const fn new(tile: &'a Tile, child: TileKey) -> Self {
        Self {
            tile,
            east: child.column & 1 != 0,
            north: child.row & 1 != 0,
        }
    }
}

/// The key of a tile's parent.
#[must_use]
pub const fn parent_of(child: TileKey) -> TileKey {
    TileKey {
        partition: child.partition,
        level: child.level + 1,
        column: child.column >> 1,
        row: child.row >> 1,
    }
}

/// The step that keeps a bound of so many quanta: the largest odd number whose half it is, at most.
#[must_use]
pub fn step_of(bound_quanta: f64) -> u16 {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "casts of floats saturate"
    )]
    let bound = bound_quanta.clamp(0.0, 16_000.0) as u16;
    2 * bound + 1
}

/// Tells heights.
struct Telling<'a> {
    quanta: &'a [u16; TILE_AREA],
    writer: &'a mut Writer,
}

impl Residuals for Telling<'_> {
    fn row(
        &mut self,
        (sort, y): (Sort, usize),
        predicted: &Row,
        steps: &Row,
        contexts: &Contexts,
        residuals: &mut Row,
    ) {
        for x in 0..ROW {
            let residual = i32::from(self.quanta[sort.index(x, y)]) - predicted[x];
            residuals[x] = nearest(residual, steps[x]);
        }
        self.writer.row(contexts, residuals);
    }
}

/// `residual` in steps, the nearest; a step is odd, so there is one.
const fn nearest(residual: i32, step: i32) -> i32 {
    let half = step / 2;
    if residual < 0 {
        (residual - half) / step
    } else {
        (residual + half) / step
    }
}

impl Residuals for Reader<'_> {
    #[inline]
    fn row(
        &mut self,
        _: (Sort, usize),
        _: &Row,
        _: &Row,
        contexts: &Contexts,
        residuals: &mut Row,
    ) {
        Reader::row(self, contexts, residuals);
    }
}

/// Makes stored bytes of tiles; owns what that needs.
pub struct PyramidEncoder {
    work: Box<Work>,
    writer: Writer,
    kinds: Vec<u8>,
}

impl std::fmt::Debug for PyramidEncoder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PyramidEncoder").finish_non_exhaustive()
    }
}

impl Default for PyramidEncoder {
    fn default() -> Self {
        Self::new()
    }
}

impl PyramidEncoder {
    /// A new one.
    #[must_use]
    pub fn new() -> Self {
        Self {
            work: Work::new(),
            writer: Writer::default(),
            kinds: Vec::new(),
        }
    }

    /// The stored bytes of a tile, [`PYRAMID_BYTES_MAX`] at most, with a step from [`step_of`]; `decoded` becomes what a
    /// reader will have. The same tile and parent always give the same bytes.
    pub fn encode(
        &mut self,
        tile: &Tile,
        parent: Option<Parent<'_>>,
        step: u16,
        decoded: &mut Tile,
    ) -> Vec<u8> {
        let (quanta, kind) = (tile.quanta[0], tile.kind[0]);
        decoded.kind.copy_from_slice(tile.kind.as_slice());
        let mut out = Vec::new();
        if tile.quanta.iter().all(|q| *q == quanta) && tile.kind.iter().all(|k| *k == kind) {
            decoded.quanta.fill(quanta);
            out.push(FLAT | if parent.is_none() { ALONE } else { 0 });
            out.extend(quanta.to_le_bytes());
            out.extend([kind as u8, 0]);
            return out;
        }
        let has_kinds = tile.kind.iter().any(|k| *k != SurfaceKind::Land);
        self.work.has_kinds = has_kinds;
        self.work.step = i32::from(step);
        self.work.lay(parent, quanta);
        if has_kinds {
            self.work.take_kinds(&tile.kind);
            self.work.note_kinds();
        }
        let has_even = self.even_differs(tile);
        let divisor = self.divisor(step);
        self.work.set_divisor(divisor);
        let flag = |is: bool, flag: u8| if is { flag } else { 0 };
        out.push(flag(has_kinds, KINDS) | flag(has_even, EVEN) | flag(parent.is_none(), ALONE));
        out.extend(step.to_le_bytes());
        out.extend(divisor.to_le_bytes());
        out.extend(if parent.is_none() { quanta } else { 0 }.to_le_bytes());
        if has_kinds {
            self.tell_kinds(&tile.kind, parent, &mut out);
        }
        self.writer.clear();
        let mut telling = Telling {
            quanta: &tile.quanta,
            writer: &mut self.writer,
        };
        self.work.run(&mut telling, has_even);
        self.work.give(&mut decoded.quanta);
        self.writer.write(&mut out);
        out
    }

    /// Whether an *even* post is more than half a step from the parent's.
    fn even_differs(&self, tile: &Tile) -> bool {
        let even = &self.work.planes[Sort::Even as usize];
        (0..HALF).any(|y| {
            let steps = self.work.steps(Sort::Even, y);
            (0..HALF).any(|x| {
                let own = i32::from(tile.quanta[Sort::Even.index(x, y)]);
                nearest(own - even[y + FIRST][x + FIRST], steps[x]) != 0
            })
        })
    }

    /// The step, or more where ground is so rough that all would be of one context: a quarter of the mean of v / 2.
    fn divisor(&self, step: u16) -> u16 {
        let even = &self.work.planes[Sort::Even as usize];
        let curves = even[FIRST..=HALF]
            .iter()
            .flat_map(|row| (0..HALF).map(|x| cubic(row[x], row[x + 1], row[x + 2], row[x + 3]).1));
        let sum: i64 = curves.map(i64::from).sum();
        let mean = sum / i64::try_from(HALF * HALF).unwrap_or(1);
        u16::try_from(mean / 4).unwrap_or(u16::MAX).max(step)
    }

    fn tell_kinds(
        &mut self,
        kind: &[SurfaceKind; TILE_AREA],
        parent: Option<Parent<'_>>,
        out: &mut Vec<u8>,
    ) {
        self.kinds.clear();
        for (y, row) in kind.chunks_exact(TILE_POSTS).enumerate() {
            let above = kinds_above(parent, y);
            let own = row.iter().enumerate();
            self.kinds
                .extend(own.map(|(x, kind)| *kind as u8 ^ above[x / 2] as u8));
        }
        let told = miniz_oxide::deflate::compress_to_vec(&self.kinds, 9);
        out.extend(u16::try_from(told.len()).unwrap_or(u16::MAX).to_le_bytes());
        out.extend(told);
    }
}

/// The kinds of the parent's posts over a row of the tile.
fn kinds_above(parent: Option<Parent<'_>>, row: usize) -> [SurfaceKind; HALF] {
    let mut above = [SurfaceKind::Land; HALF];
    if let Some(p) = parent {
        let row = row / 2 + if p.north { HALF } else { 0 };
        let first = row * TILE_POSTS + if p.east { HALF } else { 0 };
        above.copy_from_slice(&p.tile.kind[first..first + HALF]);
    }
    above
}

/// Reads stored bytes; owns what that needs and allocates only when made.
pub struct PyramidDecoder {
    work: Box<Work>,
    words: Box<Words>,
    kinds: Box<[u8; TILE_AREA]>,
    told: Box<[SurfaceKind; TILE_AREA]>,
    inflate: Box<DecompressorOxide>,
}

impl std::fmt::Debug for PyramidDecoder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PyramidDecoder").finish_non_exhaustive()
    }
}

impl Default for PyramidDecoder {
    fn default() -> Self {
        Self::new()
    }
}

impl PyramidDecoder {
    /// A new one.
    #[must_use]
    pub fn new() -> Self {
        rans::prepare();
        Self {
            work: Work::new(),
            words: super::codec::boxed::<u16, WORDS_MAX>(0),
            kinds: super::codec::boxed(0),
            told: super::codec::boxed(SurfaceKind::Void),
            inflate: Box::new(DecompressorOxide::new()),
        }
    }

    /// Reads a tile; `parent` must be that which it was encoded with, decoded. On an error `tile` is unchanged.
    ///
    /// # Errors
    /// See [`CodecError`].
    pub fn decode(
        &mut self,
        stored: &[u8],
        parent: Option<Parent<'_>>,
        tile: &mut Tile,
    ) -> Result<(), CodecError> {
        let Some((&flags, rest)) = stored.split_first() else {
            return Err(CodecError::Residuals);
        };
        if (flags & ALONE != 0) != parent.is_none() {
            return Err(CodecError::Parent);
        }
        if flags & FLAT != 0 {
            let &[low, high, kind, 0] = rest else {
                return Err(CodecError::Residuals);
            };
            let kind = SurfaceKind::from_byte(kind).ok_or(CodecError::Kind(kind))?;
            tile.quanta.fill(u16::from_le_bytes([low, high]));
            tile.kind.fill(kind);
            return Ok(());
        }
        let (header, mut rest) = stored
            .split_first_chunk::<HEADER>()
            .ok_or(CodecError::Residuals)?;
        let [_, s0, s1, d0, d1, f0, f1] = *header;
        self.work.has_kinds = flags & KINDS != 0;
        self.work.step = i32::from(u16::from_le_bytes([s0, s1]));
        self.work.set_divisor(u16::from_le_bytes([d0, d1]));
        self.work.lay(parent, u16::from_le_bytes([f0, f1]));
        if self.work.has_kinds {
            rest = self.read_kinds(rest, parent)?;
            self.work.take_kinds(&self.told);
            self.work.note_kinds();
        }
        let mut reader = Reader::new(rest, &mut self.words).ok_or(CodecError::Residuals)?;
        self.work.run(&mut reader, flags & EVEN != 0);
        if !reader.is_whole() {
            return Err(CodecError::Residuals);
        }
        self.work.give(&mut tile.quanta);
        if self.work.has_kinds {
            tile.kind.copy_from_slice(self.told.as_slice());
        } else {
            tile.kind.fill(SurfaceKind::Land);
        }
        Ok(())
    }

    /// Reads the kinds; gives what follows them.
    fn read_kinds<'b>(
        &mut self,
        bytes: &'b [u8],
        parent: Option<Parent<'_>>,
    ) -> Result<&'b [u8], CodecError> {
        let (length, rest) = bytes.split_first_chunk::<2>().ok_or(CodecError::Deflate)?;
        let length = usize::from(u16::from_le_bytes(*length));
        let (deflated, rest) = rest.split_at_checked(length).ok_or(CodecError::Deflate)?;
        self.inflate.init();
        let (status, read, length) = decompress(
            &mut self.inflate,
            deflated,
            self.kinds.as_mut_slice(),
            0,
            inflate_flags::TINFL_FLAG_USING_NON_WRAPPING_OUTPUT_BUF,
        );
        if status != TINFLStatus::Done || read != deflated.len() || length != TILE_AREA {
            return Err(CodecError::Deflate);
        }
        let rows = self.told.chunks_exact_mut(TILE_POSTS);
        for (y, (told, bytes)) in rows.zip(self.kinds.chunks_exact(TILE_POSTS)).enumerate() {
            let above = kinds_above(parent, y);
            for (x, (told, byte)) in told.iter_mut().zip(bytes).enumerate() {
                let byte = byte ^ above[x / 2] as u8;
                *told = SurfaceKind::from_byte(byte).ok_or(CodecError::Kind(byte))?;
            }
        }
        Ok(rest)
    }
}

#[cfg(test)]
mod tests;
