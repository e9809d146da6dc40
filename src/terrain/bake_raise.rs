//! Coarse levels that keep summits.
//!
//! A coarse level is made of every 2^l-th post, so a summit between them would be gone: by 240 m at a level of 370 m
//! between posts in the Andes, which is no error of a few pixels but a mountain that is not in the picture. Therefore
//! coarse posts are raised. Let h be the height of a summit ([`crate::terrain::bake_summits`]), D that of the level's
//! triangle at its place, before anything is raised, and E what the level may be lower ([`allowed_m`]). Where D < h - E, the
//! triangle's corners below h are raised in proportion to their weights there, none above h, until D = h - E: the smallest
//! raise in the sense of least squares, spread over up to three posts, so that a ridge keeps its shape and gets no teeth. A post that several summits would raise takes the most. Hence
//!
//! - at each summit's place the level is at most E lower than the summit, since raising posts lowers nothing;
//! - no post stands above the summit it serves, and the summit moves by less than a cell;
//! - what a post becomes depends on the data around it only, not on the order of work, on tiles or on threads;
//! - the finest level stays as it was measured. A cap's finest posts are made from the geographic ones, so they are raised
//!   like a coarse level's, for the geographic summits.
//!
//! A vertex that blends between level l and the next lies between the two surfaces. Where the blend is the same at the three
//! corners of a triangle, the surface drawn is a mean of both, hence at most the greater E lower than a summit. It differs by
//! at most d = 1 / (0.15 w) from corner to corner, w half the cells of a window (0.03 for 447 vertices), which adds at most
//! d / 2 times the difference between both surfaces there.
//!
//! A triangle is flat and the Earth is not: its middle lies up to c^2 / 4R lower than its corners, c the cell (1.4 m at
//! level 6 of a 3" grid, 88 m at level 9). That is taken off E.
//!
//! Across the date line, levels that do not close around the Earth ([`Grid::canonical_at`]) have no lattice; the posts drawn
//! there come from a finer level, and a summit can be as much lower as between any posts of that spacing. These are levels
//! from 0.07 degrees (1") or 0.2 degrees (3") on, levels 8 to 11: seen from afar, by an eye on the other side. Level 7 can reach
//! as far as nearly half of its vertices: 850 km (1") or 2550 km (3") with 447, farther than anything is seen from 20 km (the
//! horizon is 505 km away, and 8.8 km of mountain rise over it from 335 km behind it). A 1" pack with 127 vertices has the
//! bound out to 220 km there; and any pack less far where a target in pixels ends level 7 before ([`crate::terrain::reach`]).

use crate::geo::WGS84_B_M;
use crate::terrain::bake_posts::{Corners, Patch, Posts};
use crate::terrain::bake_summits::{Summit, Summits};
use crate::terrain::codec::{SurfaceKind, Tile};
use crate::terrain::grid::{Grid, TILE_SIDE, TileKey};
use crate::terrain::partition::Partition;
use crate::terrain::store::Scale;
use std::collections::BTreeSet;
use std::io;

/// A level may lie below a summit by this share of its cells...
const LOW_CELLS: f64 = 0.125;
/// ...but by no more than this, metres.
const LOW_MAX_M: f64 = 200.0;

/// By how much a level may lie below a summit, metres: an eighth of its cells, at most 200 m.
pub(crate) fn allowed_m(grid: Grid, level: u8) -> f64 {
    (LOW_CELLS * cell_m(grid, level)).min(LOW_MAX_M)
}

/// By how much the middle of a level's triangles lies below the ellipsoid through their corners, metres.
pub(crate) fn sag_m(grid: Grid, level: u8) -> f64 {
    cell_m(grid, level).powi(2) / (4.0 * WGS84_B_M)
}

fn cell_m(grid: Grid, level: u8) -> f64 {
    grid.spacing_deg(level).to_radians() * WGS84_B_M
}

/// Raises the tiles of a partition, one at a time.
#[derive(Debug)]
pub(crate) struct Raiser<'a> {
    posts: Posts<'a>,
    summits: &'a Summits,
    grid: Grid,
    scale: Scale,
    patch: Patch,
    raised: Vec<u16>,
    near: Vec<Summit>,
}

impl<'a> Raiser<'a> {
    /// `posts` reads the level as it was sampled.
    pub(crate) fn new(
        posts: Posts<'a>,
        summits: &'a Summits,
        (grid, scale): (Grid, Scale),
    ) -> Self {
        Self {
            posts,
            summits,
            grid,
            scale,
            patch: Patch::default(),
            raised: Vec::new(),
            near: Vec::new(),
        }
    }

    /// The tile as it is stored; `None` if nothing was sampled in it and no summit beside it needs it.
    pub(crate) fn tile(&mut self, key: TileKey, sampled: bool) -> io::Result<Option<Tile>> {
        let side = TILE_SIDE.cast_unsigned() as usize;
        let width = side + 2;
        let corner = (key.west() - 1, key.south() - 1);
        self.posts.patch(
            (key.partition, key.level),
            corner,
            (width, width),
            &mut self.patch,
        )?;
        self.raised.clear();
        let quanta = self.patch.posts.iter().map(|p| p.map_or(0, |p| p.quanta));
        self.raised.extend(quanta);
        let first = |post: i32| post << key.level;
        let (west, south) = (first(corner.0), first(corner.1));
        let (east, north) = (
            first(corner.0 + TILE_SIDE + 1),
            first(corner.1 + TILE_SIDE + 1),
        );
        for (tile, shift) in self.tiles_in(key.partition, (west, east), (south, north)) {
            self.near.clear();
            self.summits.read(tile, &mut self.near)?;
            for at in 0..self.near.len() {
                let summit = self.near[at];
                let (x, y) = summit.place(tile);
                let place = (x + f64::from(shift), y);
                self.serve(key.level, place, summit.quanta, false);
                if key.partition == Partition::Geographic && turns_diagonals(self.grid, key.level) {
                    self.serve(key.level, place, summit.quanta, true);
                }
            }
        }
        let mut tile = Tile::filled(self.posts.sea(), SurfaceKind::Void);
        let mut is_needed = sampled;
        for at in 0..side * side {
            let from = (at / side + 1) * width + at % side + 1;
            let (i, _) = self.patch.place(from);
            if key.partition == Partition::Geographic
                && self.grid.canonical_at(key.level, i) != Some(i)
            {
                continue;
            }
            let Some(post) = self.patch.posts[from] else {
                continue;
            };
            let is_raised = self.raised[from] > post.quanta;
            is_needed |= is_raised;
            tile.quanta[at] = self.raised[from];
            // Raised water would be a slope of water: it is the mountain beside it.
            tile.kind[at] = if is_raised && post.kind == SurfaceKind::Water {
                SurfaceKind::Land
            } else {
                post.kind
            };
        }
        Ok(is_needed.then_some(tile))
    }

    /// The level-0 tiles that have summits in a rectangle of level-0 posts, and by how much their columns are shifted there.
    fn tiles_in(
        &self,
        partition: Partition,
        (west, east): (i32, i32),
        (south, north): (i32, i32),
    ) -> Vec<(TileKey, i32)> {
        let around = self.grid.posts_around();
        let shifts: &[i32] = if partition == Partition::Geographic {
            &[-around, 0, around]
        } else {
            &[0]
        };
        let of = |i, j| TileKey::of_post(partition, 0, i, j);
        let mut found = Vec::new();
        for &shift in shifts {
            let (west, east) = if partition == Partition::Geographic {
                (
                    (west - shift).max(-around / 2),
                    (east - shift).min(around / 2 - 1),
                )
            } else {
                (west, east)
            };
            if west > east {
                continue;
            }
            let (first, last) = (of(west, south), of(east, north));
            for row in first.row..=last.row {
                let from = TileKey { row, ..first };
                let to = TileKey { row, ..last };
                found.extend(self.summits.keys_between(from, to).map(|k| (k, shift)));
            }
        }
        found
    }

    /// Raises the corners under a summit at a place in level-0 posts; see [`Patch::corners`] for `other`.
    fn serve(&mut self, level: u8, place: (f64, f64), quanta: u16, other: bool) {
        let Some(corners) = self.patch.corners(place, other) else {
            return;
        };
        let mut heights = [0.0; 3];
        for (height, (at, _)) in heights.iter_mut().zip(corners) {
            let Some(post) = self.patch.posts[at] else {
                return;
            };
            *height = f64::from(post.quanta);
        }
        let low_m = (allowed_m(self.grid, level) - sag_m(self.grid, level)).max(0.0);
        let target = f64::from(quanta) - low_m / self.scale.unit_m;
        raise(&corners, &mut heights, (target, f64::from(quanta)));
        for ((at, _), height) in corners.into_iter().zip(heights) {
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a height between two quanta; float casts saturate"
            )]
            let height = height.ceil() as u16;
            self.raised[at] = self.raised[at].max(height);
        }
    }
}

/// Whether a level has an odd number of columns around the Earth: seen across the date line, its diagonals run the other way,
/// and a summit must be served whichever way they run.
fn turns_diagonals(grid: Grid, level: u8) -> bool {
    let around = grid.posts_around();
    around % (1 << level) == 0 && (around >> level) % 2 != 0
}

/// Raises heights that are below `top`, none above it, in proportion to their weights, until their mean is `target`.
fn raise(corners: &Corners, heights: &mut [f64; 3], (target, top): (f64, f64)) {
    // Each round but the last brings a corner to the top.
    for _ in 0..corners.len() {
        let pairs = || corners.iter().map(|c| c.1);
        let mean: f64 = pairs().zip(&*heights).map(|(w, h)| w * h).sum();
        let free = pairs().zip(&*heights).filter(|(_, h)| **h < top);
        let squares: f64 = free.map(|(w, _)| w * w).sum();
        if mean >= target || squares <= 0.0 {
            return;
        }
        let share = (target - mean) / squares;
        for (w, height) in pairs().zip(heights.iter_mut()) {
            if *height < top {
                *height = (*height + share * w).min(top);
            }
        }
    }
}

/// The tiles of a level that were sampled, and those beside them that a summit may need, in the order of the index.
pub(crate) fn candidates(
    (grid, level): (Grid, u8),
    sampled: impl Iterator<Item = TileKey>,
    summits: &Summits,
) -> Vec<TileKey> {
    let mut keys: BTreeSet<TileKey> = sampled.filter(|k| k.level == level).collect();
    let step = 1 << level;
    for tile in summits.keys() {
        let cells = |first: i32| {
            let last = (first + TILE_SIDE - 1).div_euclid(step) + 1;
            [first.div_euclid(step), last]
        };
        for j in cells(tile.south()) {
            for i in cells(tile.west()) {
                let i = match tile.partition {
                    Partition::Geographic => grid.canonical_at(level, i),
                    Partition::North | Partition::South => Some(i),
                };
                keys.extend(i.map(|i| TileKey::of_post(tile.partition, level, i, j)));
            }
        }
    }
    keys.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_raised_triangle_reaches_the_target_and_no_corner_passes_it(
            a in 0.0..1.0_f64, b in 0.0..1.0_f64, heights in prop::array::uniform3(0.0..4000.0_f64), target in 0.0..4000.0_f64, low in 0.0..100.0_f64,
        ) {
            let (a, b) = if a + b > 1.0 { (1.0 - a, 1.0 - b) } else { (a, b) };
            let corners = [(0, a), (1, b), (2, 1.0 - a - b)];
            let mut raised = heights;
            raise(&corners, &mut raised, (target, target + low));
            let mean: f64 = corners.iter().zip(raised).map(|(c, h)| c.1 * h).sum();
            prop_assert!(mean >= target - 1e-6, "{mean} of {target}");
            for (before, after) in heights.into_iter().zip(raised) {
                prop_assert!(after >= before, "nothing sinks");
                prop_assert!(after <= before.max(target + low), "{after} above {target} and {low}");
            }
        }
    }

    #[test]
    fn what_a_level_may_be_lower_grows_with_its_cells_up_to_two_hundred_metres() {
        let grid = Grid {
            posts_per_degree: 1200,
        };
        let allowed: Vec<f64> = (0..10)
            .map(|level| allowed_m(grid, level).round())
            .collect();
        // A cell of 3" is 92.4 m.
        assert_eq!(allowed[..5], [12.0, 23.0, 46.0, 92.0, 185.0]);
        assert!(
            allowed[5..].iter().all(|m| (m - 200.0).abs() < 0.1),
            "{allowed:?}"
        );
    }
}
