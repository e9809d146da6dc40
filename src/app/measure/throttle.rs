//! Slow disks: a source of tiles behind a reader that gives so many bytes a second, or stalls now and then.

use crate::app::measure::bench::Dice;
use crate::terrain::codec::Tile;
use crate::terrain::grid::{TILE_AREA, TileKey};
use crate::terrain::pack::{Pack, PackInfo, TileError, TileReader};
use crate::terrain::planet::Planet;
use crate::terrain::surface::TileSource;
use crate::units::Radians;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// How long a stall lasts.
pub const STALL: Duration = Duration::from_millis(200);
/// One read in so many stalls.
const STALL_EVERY: f64 = 5.0;
/// Bytes of a tile that is in no file: 5.5 bits a sample, as SRTM takes in mountains.
const ASSUMED_BYTES: u32 = 128 * 128 * 11 / 16;

const _: () = assert!(ASSUMED_BYTES as usize == TILE_AREA * 11 / 16, "of a tile");

/// What tiles take in a file.
pub trait Stored: TileSource {
    /// Bytes of a tile.
    fn stored_bytes(&self, key: TileKey) -> u32;
}

impl Stored for Pack {
    fn stored_bytes(&self, key: TileKey) -> u32 {
        self.tile_header(key).map_or(0, |tile| tile.stored_bytes)
    }
}

impl Stored for Planet {
    fn stored_bytes(&self, _: TileKey) -> u32 {
        ASSUMED_BYTES
    }
}

/// How a reader is held up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pace {
    /// Not at all.
    Free,
    /// To so many bytes a second.
    BytesPerSecond(f64),
    /// One read in five takes [`STALL`] longer, at random, the same reads every time.
    Stalls,
}

impl Pace {
    /// Those that are measured, with their names.
    pub const ALL: [(&'static str, Self); 4] = [
        ("unthrottled", Self::Free),
        ("10 MB/s", Self::BytesPerSecond(10e6)),
        ("1 MB/s", Self::BytesPerSecond(1e6)),
        ("200 ms stalls", Self::Stalls),
    ];

    /// How long the read of a number takes beside what it takes anyway.
    fn delay(self, bytes: u32, number: u64) -> Duration {
        match self {
            Self::Free => Duration::ZERO,
            Self::BytesPerSecond(rate) => Duration::from_secs_f64(f64::from(bytes) / rate),
            Self::Stalls => {
                let number = usize::try_from(number).unwrap_or(0);
                if Dice::of(STALL_KIND, number).between(0.0, STALL_EVERY) < 1.0 {
                    STALL
                } else {
                    Duration::ZERO
                }
            }
        }
    }
}

/// Tells the dice of stalls from others.
const STALL_KIND: i64 = 0x57a1;

/// A source behind a slow reader. Whoever reads waits, as for a disk; threads that read at once each have a disk to themselves.
#[derive(Debug)]
pub struct Throttled<S> {
    source: Arc<S>,
    pace: Pace,
    reads: AtomicU64,
    bytes: AtomicU64,
}

impl<S: Stored> Throttled<S> {
    /// Behind a reader of a pace.
    #[must_use]
    pub const fn new(source: Arc<S>, pace: Pace) -> Self {
        Self {
            source,
            pace,
            reads: AtomicU64::new(0),
            bytes: AtomicU64::new(0),
        }
    }

    /// Tiles read so far, and their bytes.
    #[must_use]
    pub fn read(&self) -> (u64, u64) {
        (
            self.reads.load(Ordering::Relaxed),
            self.bytes.load(Ordering::Relaxed),
        )
    }
}

impl<S: Stored> TileSource for Throttled<S> {
    fn info(&self) -> &PackInfo {
        self.source.info()
    }

    fn contains(&self, key: TileKey) -> bool {
        self.source.contains(key)
    }

    fn undulation_m(&self, latitude: Radians, longitude: Radians) -> Option<f64> {
        self.source.undulation_m(latitude, longitude)
    }

    fn read_tile(
        &self,
        key: TileKey,
        reader: &mut TileReader,
        tile: &mut Tile,
    ) -> Result<(), TileError> {
        let bytes = self.source.stored_bytes(key);
        let number = self.reads.fetch_add(1, Ordering::Relaxed);
        self.bytes.fetch_add(u64::from(bytes), Ordering::Relaxed);
        // Not a park, which the next request would end.
        std::thread::sleep(self.pace.delay(bytes, number));
        self.source.read_tile(key, reader, tile)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_takes_its_time_and_one_read_in_five_stalls() {
        let rate = Pace::BytesPerSecond(1e6);
        assert_eq!(rate.delay(11_000, 3), Duration::from_millis(11));
        assert_eq!(Pace::Free.delay(11_000, 3), Duration::ZERO);
        let stalled = |n: &u64| Pace::Stalls.delay(11_000, *n) == STALL;
        let stalls = (0..1000).filter(stalled).count();
        // 200 expected, 13 the standard deviation of that many draws.
        assert!((150..250).contains(&stalls), "{stalls}");
    }
}
