//! The height of the ground at a point, read from the finest level of a pack's geographic posts.
//!
//! Interpolation: bilinear in latitude and longitude between the four level-0 posts around the point, of orthometric
//! heights; the EGM96 undulation at the point, itself bilinear in its 15' grid, is added for the ellipsoidal height. A
//! post without weight is not needed: on an edge of the coverage the heights are those of the edge.

use crate::terrain::codec::{SurfaceKind, Tile};
use crate::terrain::grid::{Grid, TileKey};
use crate::terrain::pack::{Pack, TileError, TileReader};
use crate::terrain::partition::Partition;
use crate::units::{Metres, Radians};

/// A point this close to a post, in spacings (3e-6 of 92 m), is the post: decimal degrees cannot name it exactly.
const ON_POST: f64 = 1e-6;

/// The ground at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ground {
    /// Height above the EGM96 geoid.
    pub height_orthometric: Metres,
    /// Height above the WGS 84 ellipsoid.
    pub height_ellipsoid: Metres,
    /// Whether a post that the height rests on was never measured.
    pub void: bool,
    /// Whether all posts that the height rests on are water.
    pub water: bool,
}

/// Why a point has no height.
#[derive(Debug, thiserror::Error)]
pub enum HeightError {
    /// No such place.
    #[error("is no place on Earth")]
    NoPlace,
    /// No source covers the point.
    #[error("the pack does not cover it")]
    NotCovered,
    /// A tile cannot be read.
    #[error("its tile {0} cannot be read")]
    Tile(TileKey, #[source] TileError),
}

/// Reads heights one after the other; keeps the last tile.
#[derive(Debug)]
pub struct GroundReader<'a> {
    pack: &'a Pack,
    reader: TileReader,
    tile: Tile,
    held: Option<TileKey>,
}

impl<'a> GroundReader<'a> {
    /// For a pack.
    #[must_use]
    pub fn new(pack: &'a Pack) -> Self {
        Self {
            pack,
            reader: TileReader::new(),
            tile: Tile::filled(0, SurfaceKind::Void),
            held: None,
        }
    }

    /// The ground at a point in degrees north and east.
    ///
    /// # Errors
    /// See [`HeightError`].
    pub fn at(&mut self, latitude_deg: f64, longitude_deg: f64) -> Result<Ground, HeightError> {
        let grid = self.pack.info().grid;
        if latitude_deg.is_nan() || latitude_deg.abs() > 90.0 || !longitude_deg.is_finite() {
            return Err(HeightError::NoPlace);
        }
        let longitude_deg = (longitude_deg + 180.0).rem_euclid(360.0) - 180.0;
        let (j, north) = split(grid, latitude_deg);
        let (i, east) = split(grid, longitude_deg);
        let mut height_m = 0.0;
        let (mut void, mut water) = (false, true);
        for (dj, weight_j) in [(0, 1.0 - north), (1, north)] {
            for (di, weight_i) in [(0, 1.0 - east), (1, east)] {
                let weight: f64 = weight_i * weight_j;
                if weight > 0.0 {
                    let (quanta, kind) = self.post(grid.canonical(i + di), j + dj)?;
                    height_m += weight * self.pack.orthometric_m(quanta);
                    void |= kind == SurfaceKind::Void;
                    water &= kind == SurfaceKind::Water;
                }
            }
        }
        let undulation_m = self
            .pack
            .geoid()
            .undulation_m(
                Radians::from_degrees(latitude_deg),
                Radians::from_degrees(longitude_deg),
            )
            .ok_or(HeightError::NotCovered)?;
        Ok(Ground {
            height_orthometric: Metres(height_m),
            height_ellipsoid: Metres(height_m + undulation_m),
            void,
            water,
        })
    }

    fn post(&mut self, i: i32, j: i32) -> Result<(u16, SurfaceKind), HeightError> {
        if !self.pack.covers(i, j) {
            return Err(HeightError::NotCovered);
        }
        let key = TileKey::of_post(Partition::Geographic, 0, i, j);
        if self.held != Some(key) {
            self.pack
                .read_tile(key, &mut self.reader, &mut self.tile)
                .map_err(|e| HeightError::Tile(key, e))?;
            self.held = Some(key);
        }
        let at = TileKey::index_of(i, j);
        Ok((self.tile.quanta[at], self.tile.kind[at]))
    }
}

/// The post at or before a coordinate, and how far the point is towards the next.
pub(crate) fn split(grid: Grid, degrees: f64) -> (i32, f64) {
    let posts = degrees * f64::from(grid.posts_per_degree);
    let near = posts.round();
    let posts = if (posts - near).abs() < ON_POST {
        near
    } else {
        posts
    };
    #[expect(
        clippy::cast_possible_truncation,
        reason = "a coordinate on Earth: below 2e6"
    )]
    (posts.floor() as i32, posts - posts.floor())
}
