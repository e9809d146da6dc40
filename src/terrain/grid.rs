//! The grid of posts that every pack uses, its levels and its tiles. Pure integer geometry.
//!
//! What is said here of longitude and latitude holds for the geographic partition; a cap counts its posts in the same way
//! in its own two angles ([`Partition`]), both of which stay within 26 degrees of 0, so that nothing wraps there.
//!
//! Level 0 posts stand at longitude `i / posts_per_degree` and latitude `j / posts_per_degree` degrees; (0, 0) is 0N 0E,
//! i grows eastwards and j northwards. Post (i, j) of level l stands where level-0 post (i 2^l, j 2^l) does and has its height
//! or, where the level would lose a summit, a greater one ([`crate::terrain::bake_raise`]). Longitude wraps; i is stored in the half-open range
//! -180 to 180 degrees.

use crate::limits::{LEVELS_MAX, TILE_POSTS};
use crate::terrain::partition::Partition;

/// Side of a tile in posts, as the integer that post coordinates are made of.
pub const TILE_SIDE: i32 = {
    assert!(
        TILE_POSTS <= 1024,
        "a tile's side must fit every integer it is cast to"
    );
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        reason = "asserted above"
    )]
    {
        TILE_POSTS as i32
    }
};

/// Posts in a tile.
pub const TILE_AREA: usize = TILE_POSTS * TILE_POSTS;

/// Post spacings a pack may have, in posts per degree: 30", 15", 6", 3", 1", 0.5" and 1/3". All divide the degree, so that
/// posts stand on whole degrees. Levels 0 to 6 of each close around the Earth (7 too of all but 30" and 6"); the coarser
/// ones step over the date line.
pub const POSTS_PER_DEGREE: [u32; 7] = [120, 240, 600, 1200, 3600, 7200, 10_800];

/// The coarsest level's spacing stays below this many degrees (0.43 for 3", 0.57 for 1"): the smallest window of such posts
/// reaches past the horizon from 20 km, at 70 degrees of latitude too.
const COARSEST_SPACING_DEG: f64 = 0.6;

/// Where posts stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    /// Level-0 posts per degree, in latitude and in longitude.
    pub posts_per_degree: u32,
}

impl Grid {
    /// How many levels a pack on this grid has (levels 0 to this less one): as many as keep the coarsest spacing below
    /// 0.6 degrees, at most [`LEVELS_MAX`]. 10 for 3", 12 for 1".
    #[must_use]
    pub fn level_count(&self) -> u8 {
        let mut count: u8 = 1;
        while usize::from(count) < LEVELS_MAX
            && f64::from(1_u32 << count) / f64::from(self.posts_per_degree) < COARSEST_SPACING_DEG
        {
            count += 1;
        }
        count
    }

    /// Spacing of a level's posts, degrees.
    #[must_use]
    pub fn spacing_deg(&self, level: u8) -> f64 {
        f64::from(1_u32 << level) / f64::from(self.posts_per_degree)
    }

    /// Longitude of post column `i` of a level, degrees east.
    #[must_use]
    pub fn longitude_deg(&self, level: u8, i: i32) -> f64 {
        // One rounding: the product is exact.
        f64::from(i) * f64::from(1_u32 << level) / f64::from(self.posts_per_degree)
    }

    /// Latitude of post row `j` of a level, degrees north.
    #[must_use]
    pub fn latitude_deg(&self, level: u8, j: i32) -> f64 {
        self.longitude_deg(level, j)
    }

    /// The posts that the degree cell with this south-west corner (latitude, longitude; degrees) owns: those of its northern
    /// and eastern edges belong to neighbours.
    #[must_use]
    pub const fn degree(&self, (latitude, longitude): (i32, i32)) -> PostRect {
        let posts = self.posts_per_degree.cast_signed();
        PostRect {
            south: latitude * posts,
            west: longitude * posts,
            north: latitude * posts + posts - 1,
            east: longitude * posts + posts - 1,
        }
    }

    /// Level-0 posts around a circle of latitude, 360 degrees.
    #[must_use]
    pub const fn posts_around(&self) -> i32 {
        (360 * self.posts_per_degree).cast_signed()
    }

    /// The level-0 column that stands for column `i` wherever `i` lies: in the half-open range -180 to 180 degrees.
    #[must_use]
    pub const fn canonical(&self, i: i32) -> i32 {
        let half = self.posts_around() / 2;
        (i + half).rem_euclid(self.posts_around()) - half
    }

    /// The same for a column of any level. `None` where a level does not close around the Earth and its lattice west of
    /// the date line has no post there (levels 8 to 11 of a 1" grid beyond 180 degrees).
    #[must_use]
    pub fn canonical_at(&self, level: u8, i: i32) -> Option<i32> {
        let base = self.canonical(i.checked_mul(1 << level)?);
        (base % (1 << level) == 0).then_some(base >> level)
    }

    /// The highest level-0 row, 90 degrees north; the lowest is its negative.
    #[must_use]
    pub const fn row_max(&self) -> i32 {
        (90 * self.posts_per_degree).cast_signed()
    }
}

/// A rectangle of level-0 posts, all four sides inclusive. `east` may pass 180 degrees; `west` never does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PostRect {
    /// Southernmost row.
    pub south: i32,
    /// Westernmost column.
    pub west: i32,
    /// Northernmost row.
    pub north: i32,
    /// Easternmost column.
    pub east: i32,
}

impl PostRect {
    /// Whether it holds the post at canonical column `i` and row `j`.
    #[must_use]
    pub fn contains(&self, grid: Grid, i: i32, j: i32) -> bool {
        let columns = self.west..=self.east;
        (self.south..=self.north).contains(&j)
            && (columns.contains(&i) || columns.contains(&(i + grid.posts_around())))
    }

    /// The smallest rectangle around all of them; `None` if there are none.
    #[must_use]
    pub fn around(rects: impl Iterator<Item = Self>) -> Option<Self> {
        rects.reduce(|a, b| Self {
            south: a.south.min(b.south),
            west: a.west.min(b.west),
            north: a.north.max(b.north),
            east: a.east.max(b.east),
        })
    }

    /// What two rectangles share; `None` if nothing.
    #[must_use]
    pub fn intersection(&self, other: &Self) -> Option<Self> {
        let shared = Self {
            south: self.south.max(other.south),
            west: self.west.max(other.west),
            north: self.north.min(other.north),
            east: self.east.min(other.east),
        };
        (shared.south <= shared.north && shared.west <= shared.east).then_some(shared)
    }

    /// Moved east by a number of posts.
    #[must_use]
    pub const fn shifted(&self, posts: i32) -> Self {
        Self {
            west: self.west + posts,
            east: self.east + posts,
            ..*self
        }
    }

    /// The same rectangle in degrees.
    #[must_use]
    pub fn bounds(&self, grid: Grid) -> Bounds {
        Bounds {
            south_deg: grid.latitude_deg(0, self.south),
            west_deg: grid.longitude_deg(0, self.west),
            north_deg: grid.latitude_deg(0, self.north),
            east_deg: grid.longitude_deg(0, self.east),
        }
    }
}

/// A rectangle in degrees north and east.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Southern latitude.
    pub south_deg: f64,
    /// Western longitude.
    pub west_deg: f64,
    /// Northern latitude.
    pub north_deg: f64,
    /// Eastern longitude; past 180 only in the rectangle of a single source that ends on the date line.
    pub east_deg: f64,
}

/// Names one tile: posts `column * 128 .. column * 128 + 128` by `row * 128 .. row * 128 + 128` of its level. Sorted by
/// partition, then level, then row, then column, which is the order of a pack's index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct TileKey {
    /// Whose posts.
    pub partition: Partition,
    /// Level, 0 the finest.
    pub level: u8,
    /// Tile column, eastwards.
    pub column: i32,
    /// Tile row, northwards.
    pub row: i32,
}

impl TileKey {
    /// The tile that holds post (i, j) of a level; `i` must be canonical in the geographic partition.
    #[must_use]
    pub const fn of_post(partition: Partition, level: u8, i: i32, j: i32) -> Self {
        Self {
            partition,
            level,
            column: i.div_euclid(TILE_SIDE),
            row: j.div_euclid(TILE_SIDE),
        }
    }

    /// Post column of the tile's westernmost posts.
    #[must_use]
    pub const fn west(&self) -> i32 {
        self.column * TILE_SIDE
    }

    /// Post row of the tile's southernmost posts.
    #[must_use]
    pub const fn south(&self) -> i32 {
        self.row * TILE_SIDE
    }

    /// Where post (i, j) of its level stands in a tile's arrays: row 0 southernmost, column 0 westernmost.
    #[must_use]
    pub const fn index_of(i: i32, j: i32) -> usize {
        (j.rem_euclid(TILE_SIDE) * TILE_SIDE + i.rem_euclid(TILE_SIDE)).cast_unsigned() as usize
    }
}

impl Ord for TileKey {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        let order = |k: &Self| (k.partition, k.level, k.row, k.column);
        order(self).cmp(&order(other))
    }
}

impl PartialOrd for TileKey {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl std::fmt::Display for TileKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.partition != Partition::Geographic {
            write!(f, "{} ", self.partition.name())?;
        }
        write!(
            f,
            "level {} column {} row {}",
            self.level, self.column, self.row
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: Grid = Grid {
        posts_per_degree: 1200,
    };

    #[test]
    fn levels_reach_half_a_degree() {
        assert_eq!(GRID.level_count(), 10, "3 arc seconds: levels 0 to 9");
        let fine = Grid {
            posts_per_degree: 3600,
        };
        assert_eq!(fine.level_count(), 12, "1 arc second: levels 0 to 11");
    }

    #[test]
    fn listed_grids_close_around_the_earth_up_to_level_six() {
        for posts_per_degree in POSTS_PER_DEGREE {
            let grid = Grid { posts_per_degree };
            let level = 6;
            assert!(grid.level_count() > level, "{posts_per_degree}");
            assert_eq!(grid.posts_around() % (1 << level), 0, "{posts_per_degree}");
        }
    }

    #[test]
    fn longitude_wraps_at_the_date_line() {
        assert_eq!(GRID.canonical(216_000), -216_000, "180 E is 180 W");
        assert_eq!(
            GRID.canonical(-216_001),
            215_999,
            "west of 180 W is east longitude"
        );
        assert_eq!(GRID.canonical(5), 5, "near zero nothing changes");
        assert_eq!(
            GRID.canonical_at(7, 1688),
            Some(-1687),
            "level 7 steps over the date line"
        );
        let fine = Grid {
            posts_per_degree: 3600,
        };
        assert_eq!(
            fine.canonical_at(8, 2532),
            None,
            "level 8 of a 1 arc second grid has no post there"
        );
    }

    #[test]
    fn negative_posts_belong_to_negative_tiles() {
        let key = TileKey::of_post(Partition::Geographic, 0, -1, -129);
        assert_eq!((key.column, key.row), (-1, -2), "floor, not truncation");
        assert_eq!(
            TileKey::index_of(-1, -129),
            127 * 128 + 127,
            "the last post of both"
        );
        assert_eq!((key.west(), key.south()), (-128, -256), "its corner");
    }

    #[test]
    fn posts_on_whole_degrees_are_exact() {
        for degree in [-180, -71, 0, 14, 50, 179] {
            let i = degree * 1200;
            assert_eq!(
                GRID.longitude_deg(0, i).to_bits(),
                f64::from(degree).to_bits()
            );
        }
    }
}
