//! The last step of a bake with a bound: the finished tiles of every level, which until now were kept without loss, are told
//! anew by the pyramid ([`crate::terrain::pyramid`]), the coarsest first, each by the coarser one as a reader will have it.
//!
//! Every tile is read back before it is written, and the bake fails where it is not what it should be: the bound that a
//! pack states is one that was seen to hold.

use crate::terrain::bake_levels::go_on;
use crate::terrain::bake_threads::{TURN, share};
use crate::terrain::codec::{SurfaceKind, Tile};
use crate::terrain::grid::TileKey;
use crate::terrain::pack::{TileError, TileReader, Tiles};
use crate::terrain::pyramid::{Parent, PyramidDecoder, PyramidEncoder, parent_of};
use crate::terrain::store::{EncodedTile, PackWriter};
use std::io;

/// What one thread works with.
struct Hand {
    given: TileReader,
    above: TileReader,
    encoder: PyramidEncoder,
    decoder: PyramidDecoder,
    tile: Tile,
    parent: Tile,
    promised: Tile,
    decoded: Tile,
}

/// What the bound is kept in.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Step {
    /// The pyramid's.
    pub(crate) quanta: u16,
    /// What a quantum is, metres.
    pub(crate) unit_m: f64,
}

/// Lowest and highest quanta of posts that are not void.
pub(crate) type Range = Option<(u16, u16)>;

/// Tells all tiles anew. Gives the range of what a reader will have. `proceed` as in [`crate::terrain::bake_levels`].
pub(crate) fn tell(
    given: &Tiles,
    out: &mut PackWriter,
    step: Step,
    jobs: usize,
    proceed: &mut dyn FnMut(usize, usize) -> bool,
) -> io::Result<Range> {
    let mut hands: Vec<Hand> = Vec::new();
    hands.resize_with(jobs.max(1), Hand::new);
    let levels = given.entries().iter().map(|e| e.key.level + 1).max();
    let (mut done, mut range) = (0, None);
    for level in (0..levels.unwrap_or(0)).rev() {
        let above = out.written(|key| key.level > level)?;
        let own = given.entries().iter().filter(|e| e.key.level == level);
        let own: Vec<(TileKey, f32)> = own.map(|e| (e.key, e.max_error_m)).collect();
        for keys in own.chunks(TURN) {
            go_on(proceed(done, given.entries().len()))?;
            let told = share(&mut hands, keys, |hand, key| hand.tell(given, &above, step, *key));
            for told in told {
                let (tile, of_tile) = told?;
                out.add(&tile)?;
                range = join(range, of_tile);
            }
            done += keys.len();
        }
    }
    Ok(range)
}

fn join(a: Range, b: Range) -> Range {
    match (a, b) {
        (Some((low, high)), Some((l, h))) => Some((low.min(l), high.max(h))),
        (one, None) | (None, one) => one,
    }
}

impl Hand {
    fn new() -> Self {
        let tile = || Tile::filled(0, SurfaceKind::Void);
        Self {
            given: TileReader::new(),
            above: TileReader::new(),
            encoder: PyramidEncoder::new(),
            decoder: PyramidDecoder::new(),
            tile: tile(),
            parent: tile(),
            promised: tile(),
            decoded: tile(),
        }
    }

    fn tell(
        &mut self,
        given: &Tiles,
        above: &Tiles,
        step: Step,
        (key, error_m): (TileKey, f32),
    ) -> io::Result<(EncodedTile, Range)> {
        given
            .read(key, &mut self.given, &mut self.tile)
            .map_err(io::Error::other)?;
        let read = above.read(parent_of(key), &mut self.above, &mut self.parent);
        let parent = match read {
            Ok(()) => Some(Parent::new(&self.parent, key)),
            Err(TileError::Absent) => None,
            Err(e) => return Err(io::Error::other(e)),
        };
        let stored = self
            .encoder
            .encode(&self.tile, parent, step.quanta, &mut self.promised);
        self.decoder
            .decode(&stored, parent, &mut self.decoded)
            .map_err(io::Error::other)?;
        let worst = worst(&self.tile, &self.decoded, step.quanta / 2);
        let Some(worst) = worst.filter(|_| self.decoded == self.promised) else {
            let why = format!("tile {key} does not come back from the pyramid within its bound");
            return Err(io::Error::other(why));
        };
        #[expect(clippy::cast_possible_truncation, reason = "metres")]
        let error_m = error_m + (f64::from(worst) * step.unit_m) as f32;
        let posts = self.decoded.quanta.iter().zip(self.decoded.kind.iter());
        let known = posts.filter(|p| *p.1 != SurfaceKind::Void);
        let range = known.fold(None, |range, (q, _)| join(range, Some((*q, *q))));
        Ok((EncodedTile::of(key, stored, &self.decoded, error_m), range))
    }
}

/// The largest difference between two tiles, quanta; `None` where one is not allowed.
fn worst(given: &Tile, decoded: &Tile, bound: u16) -> Option<u16> {
    if given.kind != decoded.kind {
        return None;
    }
    let mut worst = 0;
    let posts = given.quanta.iter().zip(decoded.quanta.iter());
    for ((given, decoded), kind) in posts.zip(given.kind.iter()) {
        let difference = given.abs_diff(*decoded);
        let allowed = match kind {
            SurfaceKind::Land => bound,
            SurfaceKind::Water | SurfaceKind::Void => 0,
        };
        if difference > allowed {
            return None;
        }
        worst = worst.max(difference);
    }
    Some(worst)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_post_beyond_what_is_allowed_is_found() {
        let given = Tile::filled(100, SurfaceKind::Land);
        let mut decoded = given.clone();
        decoded.quanta[77] = 102;
        assert_eq!(worst(&given, &decoded, 2), Some(2));
        assert_eq!(worst(&given, &decoded, 1), None, "too far");
        decoded.kind[5] = SurfaceKind::Water;
        assert_eq!(worst(&given, &decoded, 2), None, "another kind");
        let mut lake = given;
        lake.kind[77] = SurfaceKind::Water;
        let mut decoded = lake.clone();
        decoded.quanta[77] = 101;
        assert_eq!(worst(&lake, &decoded, 2), None, "water is exact");
    }
}
