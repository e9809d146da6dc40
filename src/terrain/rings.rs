//! The rings of a scene's levels: cut into blocks with their bounds, kept while windows stand still, and what of them is in
//! a picture: inside its sides, before the horizon, and not behind nearer ground ([`super::silhouette`]).

use super::blocks::{BLOCKS_MAX, Block, Blocks, ring};
use super::clipmap::{self, CellRect, Extent, Shape};
use super::cull::{Bound, Patch, Seen, Viewer, WIDE};
use super::grid::Grid;
use super::partition::Partition;
use super::plan::{LevelPlan, Plan};
use super::silhouette::{LINES_MAX, Lattice, Silhouette, Tops};
use super::slices::{self, Core, Cut};
use super::stream::Streamer;
use super::tables::HeightCode;
use crate::geo::Camera;
use crate::geo::{WGS84_A_M, WGS84_B_M};
use crate::limits::LEVELS_MAX;
use glam::DVec3;
use std::ops::Range;

/// Where the terrain of a scene stands, and its heights.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ground<'a> {
    pub partition: Partition,
    pub grid: Grid,
    pub levels: u8,
    pub heights: HeightCode,
    pub shape: Shape,
    /// The eye's post position on level 0.
    pub eye_posts: (f64, f64),
    pub streamer: &'a Streamer,
}

/// A level's blocks with their bounds.
#[derive(Debug)]
struct Ring {
    key: Option<(Extent, Option<CellRect>)>,
    version: u32,
    blocks: Blocks,
    /// What bounds are counted from: the middle of the window.
    origin: DVec3,
    /// Of each block; right from when its group has been in the picture's sides.
    laid: Vec<Option<Laid>>,
    groups: Vec<Group>,
    /// Which lines of each block are worth following, as [`lines_of`] numbers them: rows and columns.
    useful: Vec<[u16; 2]>,
}

/// What is known of a block.
#[derive(Clone, Copy, Debug)]
struct Laid {
    bound: Bound,
    tops_m: Tops,
}

/// Blocks that stand together: one past the last, and their bound.
#[derive(Clone, Copy, Debug)]
struct Group {
    end: u16,
    bound: Bound,
    is_laid: bool,
}

impl Ring {
    fn new() -> Self {
        Self {
            key: None,
            version: 0,
            blocks: Blocks::new(),
            origin: DVec3::ZERO,
            laid: vec![None; BLOCKS_MAX],
            groups: Vec::with_capacity(BLOCKS_MAX),
            useful: vec![[ALL_LINES; 2]; BLOCKS_MAX],
        }
    }
}

impl Ring {
    /// How far a block reaches above or below a height, metres.
    fn rise_m(&self, block: u16, height_m: f64) -> f64 {
        self.laid[usize::from(block)].map_or(f64::INFINITY, |laid| {
            let (low_m, high_m) = laid.bound.heights_m();
            let (low_m, high_m) = (f64::from(low_m), f64::from(high_m));
            (height_m - low_m).abs().max((height_m - high_m).abs())
        })
    }
}

/// A block inside the picture's sides and before the horizon.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    /// Which level of the plan, and which block of its ring.
    at: u8,
    block: u16,
    seen: Seen,
    is_hidden: bool,
}

/// Something far away or near, to be sorted: bits of a distance that is not negative, and which candidate.
type Far = (u32, u16);

/// A line that has been followed: of which candidate, along columns or not, and its number there.
#[derive(Clone, Copy, Debug)]
struct Followed {
    candidate: u16,
    northward: bool,
    bit: u16,
}

/// See the module.
#[derive(Debug)]
pub(super) struct Rings {
    rings: Vec<Ring>,
    candidates: Vec<Candidate>,
    lattices: Vec<Lattice>,
    by_near: Vec<Far>,
    by_far: Vec<Far>,
    followed: Vec<Followed>,
    /// The candidates that are drawn: level of the plan, whether they are wholly in the picture, bits of their distance,
    /// number.
    drawn: Vec<(u8, bool, u32, u16)>,
    silhouette: Silhouette,
    /// Counts frames, for taking turns.
    turn: u16,
}

impl Rings {
    pub(super) fn new(levels: u8) -> Self {
        Self {
            rings: std::iter::repeat_with(Ring::new)
                .take(usize::from(levels))
                .collect(),
            candidates: Vec::with_capacity(LEVELS_MAX * BLOCKS_MAX),
            lattices: Vec::with_capacity(LEVELS_MAX * BLOCKS_MAX),
            by_near: Vec::with_capacity(LEVELS_MAX * BLOCKS_MAX),
            by_far: Vec::with_capacity(LEVELS_MAX * BLOCKS_MAX),
            followed: Vec::with_capacity(LINES_MAX),
            drawn: Vec::with_capacity(LEVELS_MAX * BLOCKS_MAX),
            silhouette: Silhouette::default(),
            turn: 0,
        }
    }

    /// Cuts each level's ring into blocks and bounds them, where anything has changed.
    pub(super) fn lay(&mut self, ground: &Ground<'_>, levels: &[LevelPlan]) {
        let shape = ground.shape;
        let mut finer: Option<Extent> = None;
        for plan in levels {
            let hole = finer.and_then(|f| clipmap::hole(plan.extent(), &plan.morph, f));
            finer = Some(plan.extent());
            let ring_of = &mut self.rings[usize::from(plan.level)];
            let key = Some((plan.extent(), hole));
            let version = ground.streamer.version(plan.level);
            if ring_of.key == key && ring_of.version == version {
                continue;
            }
            let rows = ground.rows(plan);
            if ring_of.key != key && !ring(shape, plan.cells, hole, rows, &mut ring_of.blocks) {
                debug_assert!(false, "a ring of more than {BLOCKS_MAX} blocks");
            }
            ring_of.key = key;
            ring_of.version = version;
            ring_of.origin = ground.middle(plan);
            ring_of.groups.clear();
            let mut first = 0;
            while let Some((end, rect)) = group(&ring_of.blocks, first) {
                ring_of.groups.push(Group {
                    end: u16::try_from(end).unwrap_or(u16::MAX),
                    bound: ground.bound(plan, rect, ring_of.origin),
                    is_laid: false,
                });
                first = end;
            }
        }
    }

    /// Puts the blocks that the camera can see into the plan, and shares out the depths. No terrain is lower
    /// than `height_min_m`. `hides`: whether blocks behind nearer ground are left out.
    pub(super) fn cut(
        &mut self,
        ground: &Ground<'_>,
        camera: &Camera,
        height_min_m: f64,
        hides: bool,
        plan: &mut Plan,
    ) {
        self.silhouette.begin(camera, hides && plan.is_above_ground);
        self.find(ground, &Viewer::new(camera, height_min_m), &plan.levels);
        if self.silhouette.is_used() {
            self.hide(ground, &plan.levels);
        }
        let f = camera.focal_px();
        let (w, h) = (f64::from(camera.width_px), f64::from(camera.height_px));
        // A distance along a ray of the wide picture is at least this much of it along the optical axis. In the picture alone it
        // would be more; but then planes of two slices would cut a side that both share at two places beyond the picture,
        // and a cut side runs a hair's breadth beside the whole one.
        let (w, h) = (f64::from(WIDE) * w + 1.0, f64::from(WIDE) * h + 1.0);
        let along = f / (f * f + (w * w + h * h) / 4.0).sqrt();
        plan.blocks.clear();
        plan.triangles = 0;
        let core = plan.levels.first().map(|finest| ground.core(finest));
        let near_m = self.order(core.as_ref(), along);
        let mut drawn = self.drawn.iter().peekable();
        let eye_m = camera.eye.height_ellipsoid.0;
        for (at, level) in plan.levels.iter_mut().enumerate() {
            let ring = &self.rings[usize::from(level.level)];
            let mut cut = Cut::of(core.filter(|_| at == 0));
            let first = plan.blocks.len();
            while let Some((_, is_whole, _, c)) = drawn.next_if(|c| usize::from(c.0) == at) {
                let c = &self.candidates[usize::from(*c)];
                let block = ring.blocks[usize::from(c.block)];
                plan.triangles += block.triangles();
                let rise_m = ring.rise_m(c.block, eye_m);
                cut.push(block, (c.seen.span, *is_whole), rise_m, &mut plan.blocks);
            }
            level.slices = cut.finish(along, near_m[at], first, &mut plan.blocks);
            level.blocks = (first, plan.blocks.len() - first);
        }
        slices::share_out(&mut plan.levels);
        slices::turn(&mut plan.levels, plan.is_above_ground);
    }

    /// Lists what is drawn, level by level, in each what nothing clips last, and the nearest first: what it covers is rejected
    /// before it is coloured. Returns where each level is cut off before the eye, if it is cut off as planned.
    fn order(&mut self, core: Option<&Core>, along: f64) -> [f64; LEVELS_MAX] {
        let mut near_m = [f64::INFINITY; LEVELS_MAX];
        for c in self.candidates.iter().filter(|c| !c.is_hidden) {
            let nearest = &mut near_m[usize::from(c.at)];
            *nearest = nearest.min(c.seen.span.near_m);
        }
        for (at, near_m) in near_m.iter_mut().enumerate() {
            *near_m = Cut::near_m(core.filter(|_| at == 0), *near_m, along);
        }
        self.drawn.clear();
        let shown = (0..).zip(&self.candidates).filter(|(_, c)| !c.is_hidden);
        #[expect(
            clippy::cast_possible_truncation,
            reason = "it only says which is nearer"
        )]
        let near = |c: &Candidate| (c.seen.span.near_m.max(0.0) as f32).to_bits();
        // A hundredth more than the plane is at: for rounding.
        let is_whole =
            |c: &Candidate| c.seen.is_whole && c.seen.deep_m > 1.01 * near_m[usize::from(c.at)];
        self.drawn
            .extend(shown.map(|(number, c)| (c.at, is_whole(c), near(c), number)));
        self.drawn.sort_unstable();
        near_m
    }

    /// Lists the blocks inside the picture's sides and before the horizon, level by level.
    fn find(&mut self, ground: &Ground<'_>, viewer: &Viewer, levels: &[LevelPlan]) {
        self.candidates.clear();
        self.lattices.clear();
        self.by_near.clear();
        self.by_far.clear();
        for (at, plan) in (0..).zip(levels) {
            let ring = &mut self.rings[usize::from(plan.level)];
            let viewer = viewer.from(ring.origin);
            let offset = self.silhouette.offset(ring.origin);
            let mut first = 0;
            for of in 0..ring.groups.len() {
                let group = ring.groups[of];
                let blocks = first..group.end;
                first = group.end;
                if viewer.sees(&group.bound).is_none() {
                    continue;
                }
                if !group.is_laid {
                    ground.lay(ring, plan, blocks.clone());
                    ring.groups[of].is_laid = true;
                }
                for block in blocks {
                    let Some(Laid { bound, .. }) = &ring.laid[usize::from(block)] else {
                        continue;
                    };
                    let Some(seen) = viewer.sees(bound) else {
                        continue;
                    };
                    #[expect(clippy::cast_possible_truncation, reason = "below 12 x 2704")]
                    let number = self.candidates.len() as u16;
                    self.candidates.push(Candidate {
                        at,
                        block,
                        seen,
                        is_hidden: false,
                    });
                    if self.silhouette.is_used() {
                        let lattice = self.silhouette.lattice(bound, offset);
                        let (near_m, far_m) = lattice.distances_m();
                        self.lattices.push(lattice);
                        self.by_near.push((near_m.to_bits(), number));
                        self.by_far.push((far_m.to_bits(), number));
                    }
                }
            }
        }
    }

    /// Marks the blocks that lie behind others: each is held against lines of those that are wholly nearer.
    ///
    /// Which lines is for experience to say: those that have hidden something when all lines of their block were last
    /// followed, which each block has its turn for.
    fn hide(&mut self, ground: &Ground<'_>, levels: &[LevelPlan]) {
        self.by_near.sort_unstable();
        self.by_far.sort_unstable();
        self.followed.clear();
        self.turn = self.turn.wrapping_add(1);
        let mut nearer = 0;
        for at in 0..self.by_near.len() {
            let (near, this) = self.by_near[at];
            while let Some(&(_, n)) = self.by_far.get(nearer).filter(|(far, _)| *far <= near) {
                nearer += 1;
                if !self.candidates[usize::from(n)].is_hidden {
                    self.follow(ground, levels, n);
                }
            }
            let this = usize::from(this);
            let candidate = &mut self.candidates[this];
            let ring = &self.rings[usize::from(levels[usize::from(candidate.at)].level)];
            candidate.is_hidden = ring.laid[usize::from(candidate.block)]
                .as_ref()
                .is_some_and(|laid| self.silhouette.hides(&self.lattices[this], &laid.tops_m));
        }
        for (line, _) in self
            .followed
            .iter()
            .zip(self.silhouette.earned())
            .filter(|(_, earned)| **earned)
        {
            let candidate = &self.candidates[usize::from(line.candidate)];
            let ring = &mut self.rings[usize::from(levels[usize::from(candidate.at)].level)];
            ring.useful[usize::from(candidate.block)][usize::from(line.northward)] |= line.bit;
        }
    }

    /// Adds lines of a candidate's posts to the silhouette.
    fn follow(&mut self, ground: &Ground<'_>, levels: &[LevelPlan], number: u16) {
        let candidate = &self.candidates[usize::from(number)];
        let level = &levels[usize::from(candidate.at)];
        let ring = &mut self.rings[usize::from(level.level)];
        let lattice = &self.lattices[usize::from(number)];
        let northward = lattice.prefers_columns();
        let useful = &mut ring.useful[usize::from(candidate.block)][usize::from(northward)];
        let has_turn = candidate.block % TURNS == self.turn % TURNS;
        let wanted = if has_turn { ALL_LINES } else { *useful };
        if wanted == ALL_LINES {
            *useful = 0;
        }
        let block = ring.blocks[usize::from(candidate.block)];
        for (at, bit) in lines_of(level, block, northward) {
            if wanted & bit != 0
                && ground.draw_line(&mut self.silhouette, level, block, lattice, (at, northward))
            {
                self.followed.push(Followed {
                    candidate: number,
                    northward,
                    bit,
                });
            }
        }
    }
}

impl Ground<'_> {
    /// The cells around the eye.
    fn core(&self, plan: &LevelPlan) -> Core {
        let scale = f64::from(1_u32 << plan.level);
        let (x, y) = (self.eye_posts.0 / scale, self.eye_posts.1 / scale);
        let cell_deg = self.grid.spacing_deg(plan.level);
        // Cells are narrowest on the side towards the pole, two of them away.
        let latitude = (y.abs() + 2.0) * cell_deg;
        Core::around(
            (x - f64::from(plan.window.i), y - f64::from(plan.window.j)),
            cell_deg.to_radians() * WGS84_B_M,
            latitude.to_radians().cos().max(0.0),
        )
    }

    /// The first and one past the last row of cells that are drawn of a level, from its origin.
    fn rows(&self, plan: &LevelPlan) -> (i32, i32) {
        let cells = plan.cells;
        match self.partition {
            Partition::Geographic => {
                let limit = clipmap::row_limit(self.grid, self.levels, plan.level);
                (
                    (-limit - plan.window.j).max(0),
                    (limit - plan.window.j).min(cells),
                )
            }
            Partition::North | Partition::South => (0, cells),
        }
    }

    /// The middle of a window, where bounds are counted from.
    fn middle(&self, plan: &LevelPlan) -> DVec3 {
        let half = plan.cells / 2;
        self.partition.ecef(
            self.grid.longitude_deg(plan.level, plan.window.i + half),
            self.grid.latitude_deg(plan.level, plan.window.j + half),
            0.0,
        )
    }

    /// Finds out about blocks of a ring.
    fn lay(&self, ring: &mut Ring, plan: &LevelPlan, blocks: Range<u16>) {
        for at in blocks.map(usize::from) {
            let block = ring.blocks[at];
            ring.laid[at] = Some(Laid {
                bound: self.bound(plan, block, ring.origin),
                tops_m: self.tops_m(plan, block),
            });
        }
    }

    /// By how many posts a corner of a block may be drawn to the west and to the south of it: on the window's outer edge one
    /// on an odd post is drawn at the even one before.
    fn overhang(&self, plan: &LevelPlan, block: Block) -> (i32, i32) {
        let cells = plan.cells;
        let at_side = block.west == 0 || i32::from(block.east) == cells;
        let at_end = block.south == 0 || i32::from(block.north) == cells;
        let odd = |first: i32, from_origin: i16| (first + i32::from(from_origin)).rem_euclid(2);
        (
            i32::from(at_end) * odd(plan.window.i, block.west),
            i32::from(at_side) * odd(plan.window.j, block.south),
        )
    }

    /// Around a block, from the extremes of its heights.
    fn bound(&self, plan: &LevelPlan, block: Block, origin: DVec3) -> Bound {
        let (west, south) = (
            plan.window.i + i32::from(block.west),
            plan.window.j + i32::from(block.south),
        );
        let (width, height) = (block.width(), block.height());
        let (more_west, more_south) = self.overhang(plan, block);
        let (low, high) = self.streamer.extremes(
            plan.level,
            (west - more_west, south - more_south),
            (width + more_west, height + more_south),
        );
        let patch = Patch {
            partition: self.partition,
            south_deg: self.grid.latitude_deg(plan.level, south),
            west_deg: self.grid.longitude_deg(plan.level, west),
            north_deg: self.grid.latitude_deg(plan.level, south + height),
            east_deg: self.grid.longitude_deg(plan.level, west + width),
            height_min_m: self.heights.decode(low),
            height_max_m: self.heights.decode(high),
        };
        let cell_m = self.grid.spacing_deg(plan.level).to_radians() * WGS84_A_M;
        #[expect(clippy::cast_possible_truncation, reason = "a length")]
        let over_m = (cell_m * f64::from(more_west.max(more_south))) as f32;
        Bound::of(&patch, origin).widened(over_m)
    }

    /// The tops of a block's quarters.
    fn tops_m(&self, plan: &LevelPlan, block: Block) -> Tops {
        let west = plan.window.i + i32::from(block.west);
        let south = plan.window.j + i32::from(block.south);
        let (more_west, more_south) = self.overhang(plan, block);
        // The posts of half a side, with those on its ends.
        let half = |first: i32, cells: i32, k: i32, more: i32| {
            (
                first + cells * k / 2 - more,
                first + (cells * (k + 1) + 1) / 2,
            )
        };
        [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(row, column)| {
            let (from_j, to_j) = half(south, block.height(), row, more_south);
            let (from_i, to_i) = half(west, block.width(), column, more_west);
            let (from, to) = ((from_i, from_j), (to_i, to_j));
            self.metres(self.streamer.top_code(plan.level, from, to)) + 0.01
        })
    }

    /// Of a height code, to within half a millimetre.
    #[expect(clippy::cast_possible_truncation, reason = "to be rounded")]
    fn metres(&self, code: u16) -> f32 {
        self.heights.decode(code) as f32
    }

    /// Adds a line of a block's posts to a silhouette, `at` posts from its first: an even row or column, whose edges are
    /// drawn at any blend. Whether there was room.
    fn draw_line(
        &self,
        silhouette: &mut Silhouette,
        plan: &LevelPlan,
        block: Block,
        lattice: &Lattice,
        (at, northward): (i16, bool),
    ) -> bool {
        let west = plan.window.i + i32::from(block.west);
        let south = plan.window.j + i32::from(block.south);
        let (lines, posts) = if northward {
            (block.width(), block.height())
        } else {
            (block.height(), block.width())
        };
        #[expect(clippy::cast_precision_loss, reason = "a few cells")]
        let share = f32::from(at) / lines as f32;
        let at = i32::from(at);
        let last = u8::try_from(posts).unwrap_or(u8::MAX);
        silhouette.add(&lattice.line(share, northward), last, |k| {
            let k = i32::from(k);
            let (i, j) = if northward {
                (west + at, south + k)
            } else {
                (west + k, south + at)
            };
            self.metres(self.streamer.floor_code(plan.level, i, j))
        })
    }
}

/// All lines of a block.
const ALL_LINES: u16 = u16::MAX;

/// Every so many frames all lines of a block are followed.
const TURNS: u16 = 16;

/// The lines of a block that are edges at any blend, on even rows or columns: posts from its first, and a bit that stays
/// the line's when the window moves.
fn lines_of(plan: &LevelPlan, block: Block, northward: bool) -> impl Iterator<Item = (i16, u16)> {
    let (origin, first, last) = if northward {
        (plan.window.i, block.west, block.east)
    } else {
        (plan.window.j, block.south, block.north)
    };
    (first..=last).filter_map(move |from_origin| {
        let post = origin + i32::from(from_origin);
        (post % 2 == 0).then(|| (from_origin - first, 1 << (post / 2).rem_euclid(16)))
    })
}

/// How many blocks stand together.
const GROUP: usize = 8;

/// The blocks of a ring from the `first` on that stand together in a row: one past the last, and the rectangle of them.
fn group(blocks: &[Block], first: usize) -> Option<(usize, Block)> {
    let start = blocks.get(first)?;
    let in_row =
        |b: &&Block| (b.south, b.north) == (start.south, start.north) && b.west >= start.west;
    let count = blocks[first..]
        .iter()
        .take(GROUP)
        .take_while(in_row)
        .count();
    let end = first + count;
    let rect = Block {
        east: blocks[end - 1].east,
        ..*start
    };
    Some((end, rect))
}
