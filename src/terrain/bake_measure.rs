//! How far each level is from the data: every finished geographic post is compared with the triangles of every level of a
//! partition, once they are all written. See [`LevelError`] for what is stated of a level.

use crate::terrain::bake_posts::{Patch, PatchPost, Posts, whole};
use crate::terrain::bake_raise::sag_m;
use crate::terrain::bake_summits::{Summit, Summits, cap_place};
use crate::terrain::codec::SurfaceKind;
use crate::terrain::grid::{Grid, TILE_AREA, TILE_SIDE, TileKey};
use crate::terrain::pack::LevelError;
use crate::terrain::partition::Partition;
use crate::terrain::store::Scale;
use std::collections::BTreeMap;
use std::io;

/// Sums over posts.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sums {
    squares: f64,
    posts: u64,
    max: f64,
    low: f64,
    summit_low: f64,
}

impl Sums {
    fn add(&mut self, difference_m: f64) {
        self.squares += difference_m * difference_m;
        self.posts += 1;
        self.max = self.max.max(difference_m.abs());
        self.low = self.low.max(-difference_m);
    }

    /// Both together.
    pub(crate) fn join(&mut self, other: &Self) {
        self.squares += other.squares;
        self.posts += other.posts;
        self.max = self.max.max(other.max);
        self.low = self.low.max(other.low);
        self.summit_low = self.summit_low.max(other.summit_low);
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_precision_loss,
        reason = "figures of metres"
    )]
    pub(crate) fn error(&self) -> LevelError {
        LevelError {
            rms_m: (self.squares / self.posts.max(1) as f64).sqrt() as f32,
            max_m: self.max as f32,
            low_m: self.low as f32,
            summit_low_m: self.summit_low as f32,
        }
    }
}

/// What a geographic tile says of the levels.
#[derive(Debug, Default)]
pub(crate) struct Found {
    /// By level.
    pub(crate) levels: Vec<Sums>,
    /// The largest difference in a tile of a level, with the geographic tile's own error added, metres.
    pub(crate) tiles: BTreeMap<TileKey, f32>,
}

/// Compares geographic tiles with the levels of a partition.
#[derive(Debug)]
pub(crate) struct Meter<'a> {
    /// Reads the geographic partition's finest level.
    pub(crate) base: Posts<'a>,
    /// Reads the partition's levels as they are stored.
    pub(crate) levels: Posts<'a>,
    /// The geographic summits.
    pub(crate) summits: &'a Summits,
    /// Where posts stand.
    pub(crate) grid: Grid,
    /// What quanta are.
    pub(crate) scale: Scale,
    /// The partition measured, and its first level that is not the data itself.
    pub(crate) of: (Partition, u8),
}

/// Where the posts of a tile lie in the partition measured; `None` where it does not reach, or there is none.
type Places = Vec<Option<(f64, f64)>>;

impl Meter<'_> {
    /// Compares a geographic tile whose heights are `error_m` from their source.
    pub(crate) fn tile(&mut self, key: TileKey, error_m: f32) -> io::Result<Found> {
        let side = TILE_SIDE.cast_unsigned() as usize;
        let mut data = Patch::default();
        let corner = (key.west(), key.south());
        self.base
            .patch((key.partition, 0), corner, (side, side), &mut data)?;
        let mut places: Places = Vec::with_capacity(TILE_AREA);
        for at in 0..TILE_AREA {
            let (i, j) = data.place(at);
            places.push(if self.base.names(i) {
                self.place((f64::from(i), f64::from(j)))
            } else {
                None
            });
        }
        let mut summits: Vec<Summit> = Vec::new();
        self.summits.read(key, &mut summits)?;
        let summits = summits
            .iter()
            .filter_map(|s| Some((self.place(s.place(key))?, s.quanta)));
        let summits: Vec<((f64, f64), u16)> = summits.collect();
        let mut found = Found::default();
        let Some((least, most)) = frame(&places) else {
            return Ok(found);
        };
        let mut patch = Patch::default();
        for level in self.of.1..self.grid.level_count() {
            let step = f64::from(1_u32 << level);
            let (west, south) = (
                whole((least.0 / step).floor()),
                whole((least.1 / step).floor()),
            );
            let size = |least: i32, most: f64| {
                let last = whole((most / step).floor()) + 1;
                (last - least + 1).cast_unsigned() as usize
            };
            let size = (size(west, most.0), size(south, most.1));
            self.levels
                .patch((self.of.0, level), (west, south), size, &mut patch)?;
            let mut sums = Sums::default();
            self.compare(
                level,
                (&data, &places, error_m),
                &patch,
                &mut sums,
                &mut found.tiles,
            );
            for (place, quanta) in &summits {
                if let Some((surface, _)) = surface(&patch, *place) {
                    let low_m = (f64::from(*quanta) - surface) * self.scale.unit_m;
                    let low_m = low_m + sag_m(self.grid, level);
                    sums.summit_low = sums.summit_low.max(low_m);
                }
            }
            found.levels.push(sums);
        }
        Ok(found)
    }

    fn compare(
        &self,
        level: u8,
        (data, places, error_m): (&Patch, &Places, f32),
        patch: &Patch,
        sums: &mut Sums,
        tiles: &mut BTreeMap<TileKey, f32>,
    ) {
        let mut held: Option<(TileKey, f64)> = None;
        for (post, place) in data.posts.iter().zip(places) {
            let (Some(post), Some(place)) = (post, place) else {
                continue;
            };
            if post.kind == SurfaceKind::Void {
                continue;
            }
            let Some((surface, is_void, key)) = surface_in(self.of.0, level, patch, *place) else {
                continue;
            };
            if is_void {
                continue;
            }
            let difference_m = (surface - f64::from(post.quanta)) * self.scale.unit_m;
            sums.add(difference_m);
            held = match held {
                Some((k, most)) if k == key => Some((k, most.max(difference_m.abs()))),
                other => {
                    note(tiles, other, error_m);
                    Some((key, difference_m.abs()))
                }
            };
        }
        note(tiles, held, error_m);
    }

    fn place(&self, place: (f64, f64)) -> Option<(f64, f64)> {
        match self.of.0 {
            Partition::Geographic => Some(place),
            cap => cap_place(self.grid, cap, place),
        }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "metres")]
fn note(tiles: &mut BTreeMap<TileKey, f32>, held: Option<(TileKey, f64)>, error_m: f32) {
    if let Some((key, most)) = held {
        let stated = tiles.entry(key).or_insert(0.0);
        *stated = stated.max(most as f32 + error_m);
    }
}

/// Quanta of the surface at a place, and whether a corner is void.
fn surface(patch: &Patch, place: (f64, f64)) -> Option<(f64, bool)> {
    let corners = patch.corners(place, false)?;
    let (mut height, mut is_void) = (0.0, false);
    for (at, weight) in corners {
        if weight > 0.0 {
            let PatchPost { quanta, kind } = patch.posts[at]?;
            height += weight * f64::from(quanta);
            is_void |= kind == SurfaceKind::Void;
        }
    }
    Some((height, is_void))
}

/// The same with the tile that the cell belongs to.
fn surface_in(
    partition: Partition,
    level: u8,
    patch: &Patch,
    place: (f64, f64),
) -> Option<(f64, bool, TileKey)> {
    let (height, is_void) = surface(patch, place)?;
    let step = f64::from(1_u32 << level);
    let (i, j) = (
        whole((place.0 / step).floor()),
        whole((place.1 / step).floor()),
    );
    Some((height, is_void, TileKey::of_post(partition, level, i, j)))
}

/// South-west and north-east corner of all places.
fn frame(places: &Places) -> Option<((f64, f64), (f64, f64))> {
    places.iter().flatten().fold(None, |frame, &(x, y)| {
        let ((w, s), (e, n)) = frame.unwrap_or(((x, y), (x, y)));
        Some(((w.min(x), s.min(y)), (e.max(x), n.max(y))))
    })
}
