//! How a tile's posts become bytes and come back. Lossless. Pure.
//!
//! Encoding, in order (the terrain survey's measured choice, about 5 to 6 bits a sample on mountains):
//! 1. *Prediction*: the median edge detector of LOCO-I (Weinberger, Seroussi and Sapiro 2000, IEEE Trans. Image
//!    Processing 9(8), equation 1) from the west, south and south-west neighbours; the first post is predicted as 0, the
//!    rest of the first row from the west, the first column from the south. The residual is taken modulo 65536. In a tile
//!    with voids a post of which the western or the southern neighbour is void, and itself not, or the other way
//!    round, is predicted as the one of the two that is like it; as the western if both are, or neither: beyond the edge of
//!    the data lies the sea, and neither says anything of the other.
//! 2. *Zigzag*: the residual read as a signed number r becomes 2r for r >= 0 and -2r - 1 for r < 0, so that small
//!    magnitudes of either sign have a zero high byte.
//! 3. *Byte split*: 16384 low bytes, then 16384 high bytes; then, only if a post is not land, 16384 bytes of surface
//!    kind.
//! 4. *Deflate* (RFC 1951, no wrapper) by miniz_oxide, which is told to look for runs only.

use crate::limits::TILE_POSTS;
use crate::terrain::grid::TILE_AREA;
use miniz_oxide::deflate::core::{
    CompressionStrategy, CompressorOxide, TDEFLFlush, TDEFLStatus, compress,
    create_comp_flags_from_zip_params,
};
use miniz_oxide::inflate::TINFLStatus;
use miniz_oxide::inflate::core::{DecompressorOxide, decompress, inflate_flags};

/// What a post is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum SurfaceKind {
    /// Measured ground.
    Land = 0,
    /// Sea or lake: part of a flat connected area.
    Water = 1,
    /// No measurement: a hole that was filled, or a post outside every input. Its height is for geometry only.
    Void = 2,
}

impl SurfaceKind {
    /// From its number; `None` for any other.
    #[must_use]
    pub const fn from_byte(byte: u8) -> Option<Self> {
        match byte {
            0 => Some(Self::Land),
            1 => Some(Self::Water),
            2 => Some(Self::Void),
            _ => None,
        }
    }
}

/// A decoded tile of 128 x 128 posts. Row 0 is the southernmost, column 0 the westernmost; post (row, column) stands at
/// `row * 128 + column`. The orthometric height of a post is `base_m + quanta * unit_m` of its pack, metres.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tile {
    /// Heights in the pack's units.
    pub quanta: Box<[u16; TILE_AREA]>,
    /// What each post is.
    pub kind: Box<[SurfaceKind; TILE_AREA]>,
}

impl Tile {
    /// A tile of one height and one kind.
    #[must_use]
    pub fn filled(quanta: u16, kind: SurfaceKind) -> Self {
        Self {
            quanta: boxed(quanta),
            kind: boxed(kind),
        }
    }
}

/// A boxed array made without passing through the stack.
pub(crate) fn boxed<T: Clone, const N: usize>(value: T) -> Box<[T; N]> {
    match vec![value; N].into_boxed_slice().try_into() {
        Ok(array) => array,
        Err(_) => unreachable!("a vector of N makes an array of N"),
    }
}

/// Bytes of a tile before deflate, with the plane of kinds.
const RAW_BYTES_MAX: usize = 3 * TILE_AREA;
/// Bytes of a tile before deflate, without it.
const RAW_BYTES_MIN: usize = 2 * TILE_AREA;

/// The most bytes a stored tile may have. Deflate expands the worst input by 5 bytes in 65 535 (stored blocks, RFC 1951
/// 3.2.4); miniz's blocks are shorter, so a sixteenth is allowed.
pub const STORED_BYTES_MAX: usize = RAW_BYTES_MAX + RAW_BYTES_MAX / 16;

/// Deflate effort, 1 to 10.
const DEFLATE_LEVEL: u8 = 9;

/// Makes stored bytes of tiles; owns what that needs.
pub struct Encoder {
    raw: Vec<u8>,
    deflate: Box<CompressorOxide>,
}

impl std::fmt::Debug for Encoder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Encoder").finish_non_exhaustive()
    }
}

impl Default for Encoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Encoder {
    /// A new one.
    #[must_use]
    pub fn new() -> Self {
        Self::with_effort(DEFLATE_LEVEL)
    }

    /// For bytes that are soon read back and thrown away.
    #[must_use]
    pub(crate) fn quick() -> Self {
        Self::with_effort(1)
    }

    /// Runs only: what is predicted well has few repetitions but those, and what else looks like one costs more than it saves
    /// (6.01 bits a sample on S33W071 where any repetition is taken up 6.16, on N50E014 3.57 where 4.02) and slows reading.
    fn with_effort(level: u8) -> Self {
        // Negative: without zlib's wrapper.
        let window = -15;
        let runs = CompressionStrategy::RLE as i32;
        let flags = create_comp_flags_from_zip_params(level.into(), window, runs);
        Self {
            raw: vec![0; RAW_BYTES_MAX],
            deflate: Box::new(CompressorOxide::new(flags)),
        }
    }

    /// The stored bytes of a tile. At most [`STORED_BYTES_MAX`]; the same tile always gives the same bytes.
    #[must_use]
    pub fn encode(&mut self, tile: &Tile) -> Vec<u8> {
        let plain = tile.kind.iter().all(|k| *k == SurfaceKind::Land);
        let has_voids = tile.kind.contains(&SurfaceKind::Void);
        let length = if plain { RAW_BYTES_MIN } else { RAW_BYTES_MAX };
        let (low, rest) = self.raw.split_at_mut(TILE_AREA);
        let (high, kinds) = rest.split_at_mut(TILE_AREA);
        for (row, (low, high)) in low
            .chunks_exact_mut(TILE_POSTS)
            .zip(high.chunks_exact_mut(TILE_POSTS))
            .enumerate()
        {
            for column in 0..TILE_POSTS {
                let at = row * TILE_POSTS + column;
                let predicted = if !has_voids {
                    predict(&tile.quanta, row, column)
                } else {
                    predict_apart(&tile.quanta, &tile.kind, row, column)
                };
                let residual = tile.quanta[at].wrapping_sub(predicted);
                [low[column], high[column]] = zigzag(residual).to_le_bytes();
            }
        }
        for (byte, kind) in kinds.iter_mut().zip(tile.kind.iter()) {
            *byte = *kind as u8;
        }
        self.deflate.reset();
        let mut stored = vec![0; STORED_BYTES_MAX];
        let (status, _, written) = compress(
            &mut self.deflate,
            &self.raw[..length],
            &mut stored,
            TDEFLFlush::Finish,
        );
        assert!(
            status == TDEFLStatus::Done,
            "a tile always fits STORED_BYTES_MAX"
        );
        stored.truncate(written);
        stored
    }
}

/// The median edge detector at a post of a whole tile.
fn predict(quanta: &[u16; TILE_AREA], row: usize, column: usize) -> u16 {
    let at = row * TILE_POSTS + column;
    match (row, column) {
        (0, 0) => 0,
        (0, _) => quanta[at - 1],
        (_, 0) => quanta[at - TILE_POSTS],
        _ => median_edge(
            quanta[at - 1],
            quanta[at - TILE_POSTS],
            quanta[at - TILE_POSTS - 1],
        ),
    }
}

/// The same in a tile with voids: nothing is predicted from across their edges.
#[inline]
fn predict_apart(
    quanta: &[u16; TILE_AREA],
    kind: &[SurfaceKind; TILE_AREA],
    row: usize,
    column: usize,
) -> u16 {
    let at = row * TILE_POSTS + column;
    if row == 0 || column == 0 {
        return predict(quanta, row, column);
    }
    let is_void = |at: usize| kind[at] == SurfaceKind::Void;
    let (west, south, corner) = (at - 1, at - TILE_POSTS, at - TILE_POSTS - 1);
    let is_like = |other: usize| is_void(other) == is_void(at);
    match (is_like(west), is_like(south)) {
        (true, true) if is_like(corner) => median_edge(quanta[west], quanta[south], quanta[corner]),
        (false, true) => quanta[south],
        (true, _) | (false, false) => quanta[west],
    }
}

/// LOCO-I: `west + south - corner` where the neighbourhood is smooth, else the neighbour on the near side of the edge.
/// It is the median of the three, so it always lies between `west` and `south`.
#[inline]
fn median_edge(west: u16, south: u16, corner: u16) -> u16 {
    let (low, high) = (west.min(south), west.max(south));
    if corner >= high {
        low
    } else if corner <= low {
        high
    } else {
        // Here low < corner < high, so the sum lies between low and high: neither step can wrap.
        low + (high - corner)
    }
}

const fn zigzag(residual: u16) -> u16 {
    let r = residual.cast_signed();
    ((r << 1) ^ (r >> 15)).cast_unsigned()
}

const fn unzigzag(coded: u16) -> u16 {
    (coded >> 1) ^ (coded & 1).wrapping_neg()
}

/// What can be wrong with stored bytes whose checksum is right: they were never a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CodecError {
    /// Not a whole deflate stream of the right length.
    #[error("its deflate stream is damaged")]
    Deflate,
    /// The length is neither that of heights alone nor that of heights and kinds.
    #[error("it unpacks to {0} bytes, which no tile has")]
    Length(usize),
    /// A surface kind that does not exist.
    #[error("it holds the unknown surface kind {0}")]
    Kind(u8),
    /// Residuals that end too soon or too late.
    #[error("its residuals are damaged")]
    Residuals,
    /// A tile that needs the next coarser one where there is none, or the other way round.
    #[error("the coarser tile that it needs is not in the pack, or is one that it does not need")]
    Parent,
}

/// Reads stored bytes; owns what that needs and allocates only when made.
pub struct Decoder {
    raw: Box<[u8; RAW_BYTES_MAX]>,
    inflate: Box<DecompressorOxide>,
}

impl std::fmt::Debug for Decoder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Decoder").finish_non_exhaustive()
    }
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Decoder {
    /// A new one.
    #[must_use]
    pub fn new() -> Self {
        Self {
            raw: boxed(0),
            inflate: Box::new(DecompressorOxide::new()),
        }
    }

    /// Reads a tile. On an error `tile` is unchanged.
    ///
    /// # Errors
    /// See [`CodecError`].
    pub fn decode(&mut self, stored: &[u8], tile: &mut Tile) -> Result<(), CodecError> {
        self.inflate.init();
        let (status, read, length) = decompress(
            &mut self.inflate,
            stored,
            self.raw.as_mut_slice(),
            0,
            inflate_flags::TINFL_FLAG_USING_NON_WRAPPING_OUTPUT_BUF,
        );
        if status != TINFLStatus::Done || read != stored.len() {
            return Err(CodecError::Deflate);
        }
        let raw = &self.raw[..length];
        match length {
            RAW_BYTES_MIN => tile.kind.fill(SurfaceKind::Land),
            RAW_BYTES_MAX => {
                let kinds = &raw[RAW_BYTES_MIN..];
                if let Some(bad) = kinds.iter().find(|b| SurfaceKind::from_byte(**b).is_none()) {
                    return Err(CodecError::Kind(*bad));
                }
                for (kind, byte) in tile.kind.iter_mut().zip(kinds) {
                    *kind = SurfaceKind::from_byte(*byte).unwrap_or(SurfaceKind::Void);
                }
            }
            other => return Err(CodecError::Length(other)),
        }
        let (low, high) = (&raw[..TILE_AREA], &raw[TILE_AREA..RAW_BYTES_MIN]);
        if tile.kind.contains(&SurfaceKind::Void) {
            undo_prediction_apart(low, high, &tile.kind, &mut tile.quanta);
        } else {
            undo_prediction(low, high, &mut tile.quanta);
        }
        Ok(())
    }
}

fn undo_prediction(low: &[u8], high: &[u8], quanta: &mut [u16; TILE_AREA]) {
    let residual = |at: usize| unzigzag(u16::from_le_bytes([low[at], high[at]]));
    let mut west = 0_u16;
    for (column, post) in quanta[..TILE_POSTS].iter_mut().enumerate() {
        west = west.wrapping_add(residual(column));
        *post = west;
    }
    for row in 1..TILE_POSTS {
        let start = row * TILE_POSTS;
        let (done, rest) = quanta.split_at_mut(start);
        let south = &done[start - TILE_POSTS..];
        let here = &mut rest[..TILE_POSTS];
        let low = &low[start..start + TILE_POSTS];
        let high = &high[start..start + TILE_POSTS];
        let mut corner = south[0];
        let mut west = corner.wrapping_add(unzigzag(u16::from_le_bytes([low[0], high[0]])));
        here[0] = west;
        for (((post, south), low), high) in here[1..]
            .iter_mut()
            .zip(&south[1..])
            .zip(&low[1..])
            .zip(&high[1..])
        {
            let r = unzigzag(u16::from_le_bytes([*low, *high]));
            west = median_edge(west, *south, corner).wrapping_add(r);
            corner = *south;
            *post = west;
        }
    }
}

fn undo_prediction_apart(
    low: &[u8],
    high: &[u8],
    kind: &[SurfaceKind; TILE_AREA],
    quanta: &mut [u16; TILE_AREA],
) {
    for (at, (low, high)) in low.iter().zip(high).enumerate() {
        let predicted = predict_apart(quanta, kind, at / TILE_POSTS, at % TILE_POSTS);
        quanta[at] = predicted.wrapping_add(unzigzag(u16::from_le_bytes([*low, *high])));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn round_trip(tile: &Tile) -> usize {
        let stored = Encoder::new().encode(tile);
        let mut back = Tile::filled(7, SurfaceKind::Void);
        Decoder::new()
            .decode(&stored, &mut back)
            .expect("own bytes decode");
        assert!(back == *tile, "a tile comes back as it went in");
        stored.len()
    }

    #[test]
    fn every_residual_goes_through_zigzag_and_back() {
        for r in 0..=u16::MAX {
            assert_eq!(unzigzag(zigzag(r)), r, "{r}");
        }
        assert_eq!(
            (zigzag(1), zigzag(u16::MAX)),
            (2, 1),
            "small magnitudes stay small"
        );
    }

    #[test]
    fn flat_tiles_cost_almost_nothing() {
        for (quanta, kind) in [
            (0, SurfaceKind::Void),
            (1000, SurfaceKind::Water),
            (65_535, SurfaceKind::Land),
        ] {
            let bytes = round_trip(&Tile::filled(quanta, kind));
            assert!(bytes < 128, "{bytes} bytes for a flat tile");
        }
    }

    #[test]
    fn a_checkerboard_of_extremes_comes_back() {
        let mut tile = Tile::filled(0, SurfaceKind::Land);
        for (at, post) in tile.quanta.iter_mut().enumerate() {
            *post = if (at / TILE_POSTS + at).is_multiple_of(2) {
                0
            } else {
                u16::MAX
            };
        }
        round_trip(&tile);
    }

    #[test]
    fn an_encoder_used_before_gives_the_same_bytes() {
        let mut noisy = Tile::filled(5, SurfaceKind::Land);
        for (at, post) in noisy.quanta.iter_mut().enumerate() {
            *post = u16::try_from(at * 7919 % 65_536).expect("below 65536");
        }
        let flat = Tile::filled(5, SurfaceKind::Water);
        let mut used = Encoder::new();
        let _ = used.encode(&noisy);
        assert_eq!(used.encode(&flat), Encoder::new().encode(&flat));
    }

    #[test]
    fn bytes_that_are_no_tile_are_named() {
        let mut tile = Tile::filled(3, SurfaceKind::Land);
        let mut decoder = Decoder::new();
        assert_eq!(decoder.decode(&[], &mut tile), Err(CodecError::Deflate));
        let short = miniz_oxide::deflate::compress_to_vec(&[0; 100], 6);
        assert_eq!(
            decoder.decode(&short, &mut tile),
            Err(CodecError::Length(100))
        );
        let mut kinds = vec![0; RAW_BYTES_MAX];
        kinds[RAW_BYTES_MAX - 1] = 9;
        let stored = miniz_oxide::deflate::compress_to_vec(&kinds, 6);
        assert_eq!(decoder.decode(&stored, &mut tile), Err(CodecError::Kind(9)));
        let long = miniz_oxide::deflate::compress_to_vec(&vec![0; RAW_BYTES_MAX + 1], 6);
        assert_eq!(decoder.decode(&long, &mut tile), Err(CodecError::Deflate));
        assert!(
            tile == Tile::filled(3, SurfaceKind::Land),
            "a failed read leaves the tile alone"
        );
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        /// Random posts drawn from a mixture that favours the extremes, and random kinds.
        #[test]
        fn any_tile_comes_back(
            posts in prop::collection::vec(
                prop_oneof![Just(0_u16), Just(65_535), Just(32_768), any::<u16>(), 1000_u16..1010],
                TILE_AREA,
            ),
            kinds in prop::collection::vec(0_u8..3, TILE_AREA),
            plain in any::<bool>(),
        ) {
            let mut tile = Tile::filled(0, SurfaceKind::Land);
            tile.quanta.copy_from_slice(&posts);
            if !plain {
                for (kind, byte) in tile.kind.iter_mut().zip(&kinds) {
                    *kind = SurfaceKind::from_byte(*byte).expect("0, 1 or 2");
                }
            }
            prop_assert!(round_trip(&tile) <= STORED_BYTES_MAX);
        }

        /// Damaged bytes never panic, whatever they decode to.
        #[test]
        fn any_bytes_are_survived(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
            let mut tile = Tile::filled(0, SurfaceKind::Land);
            let _ = Decoder::new().decode(&bytes, &mut tile);
        }
    }
}
