//! The rings of a scene's levels: cut into blocks with their bounds, kept while windows stand still, and what of them is in
//! a picture: inside its sides, before the horizon, and not behind nearer ground ([`super::silhouette`]).

use super::blocks::{BLOCKS_MAX, Block, Blocks, ring};
use super::clipmap::{self, CellRect, Extent, Shape};
use super::cull::{Bound, Patch, Span, Viewer};
use super::grid::Grid;
use super::partition::Partition;
use super::plan::{LevelPlan, Plan};
use super::silhouette::{Lattice, Silhouette, Tops};
use super::stream::Streamer;
use super::tables::HeightCode;
use crate::geo::Camera;
use crate::geo::WGS84_A_M;
use crate::limits::LEVELS_MAX;

/// Nothing is drawn nearer to the eye, metres.
const NEAR_MIN_M: f64 = 0.2;

/// Where the terrain of a scene stands, and its heights.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ground<'a> {
    pub partition: Partition,
    pub grid: Grid,
    pub levels: u8,
    pub heights: HeightCode,
    pub shape: Shape,
    pub streamer: &'a Streamer,
}

/// A level's blocks with their bounds.
#[derive(Debug)]
struct Ring {
    key: Option<(Extent, Option<CellRect>)>,
    version: u32,
    blocks: Blocks,
    bounds: Vec<Bound>,
    tops_m: Vec<Tops>,
    /// Around the blocks that stand together: one past the last, and their bound.
    groups: Vec<(u16, Bound)>,
}

impl Ring {
    fn new() -> Self {
        Self {
            key: None,
            version: 0,
            blocks: Blocks::new(),
            bounds: Vec::with_capacity(BLOCKS_MAX),
            tops_m: Vec::with_capacity(BLOCKS_MAX),
            groups: Vec::with_capacity(BLOCKS_MAX),
        }
    }
}

/// A block inside the picture's sides and before the horizon.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    /// Which level of the plan, and which block of its ring.
    at: u8,
    block: u16,
    span: Span,
    near_m: f64,
    far_m: f64,
    lattice: Lattice,
    is_hidden: bool,
}

/// See the module.
#[derive(Debug)]
pub(super) struct Rings {
    rings: Vec<Ring>,
    candidates: Vec<Candidate>,
    by_near: Vec<u16>,
    by_far: Vec<u16>,
    silhouette: Silhouette,
}

impl Rings {
    pub(super) fn new(levels: u8) -> Self {
        Self {
            rings: std::iter::repeat_with(Ring::new)
                .take(usize::from(levels))
                .collect(),
            candidates: Vec::with_capacity(LEVELS_MAX * BLOCKS_MAX),
            by_near: Vec::with_capacity(LEVELS_MAX * BLOCKS_MAX),
            by_far: Vec::with_capacity(LEVELS_MAX * BLOCKS_MAX),
            silhouette: Silhouette::default(),
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
            ring_of.bounds.clear();
            ring_of.tops_m.clear();
            for &block in &ring_of.blocks {
                ring_of.tops_m.push(ground.tops_m(plan, block));
                ring_of.bounds.push(ground.bound(plan, block));
            }
            ring_of.groups.clear();
            let mut first = 0;
            while let Some((end, rect)) = group(&ring_of.blocks, first) {
                let end = u16::try_from(end).unwrap_or(u16::MAX);
                ring_of.groups.push((end, ground.bound(plan, rect)));
                first = end.into();
            }
        }
    }

    /// Puts the blocks that the camera can see into the plan, and gives each level its slice of depth. No terrain is lower
    /// than `height_min_m`. `is_above_ground`: see [`Silhouette::begin`].
    pub(super) fn cut(
        &mut self,
        ground: &Ground<'_>,
        camera: &Camera,
        height_min_m: f64,
        is_above_ground: bool,
        plan: &mut Plan,
    ) {
        self.silhouette.begin(camera, is_above_ground);
        self.find(&Viewer::new(camera, height_min_m), &plan.levels);
        if self.silhouette.is_used() {
            self.hide(ground, &plan.levels);
        }
        let f = camera.focal_px();
        let (w, h) = (f64::from(camera.width_px), f64::from(camera.height_px));
        // A distance along a ray is at least this much of it along the optical axis.
        let along = f / (f * f + (w * w + h * h) / 4.0).sqrt();
        plan.blocks.clear();
        plan.triangles = 0;
        let mut candidates = self.candidates.iter().peekable();
        let coarser = plan.levels.len().saturating_sub(1).max(1);
        for (at, level) in plan.levels.iter_mut().enumerate() {
            let ring = &self.rings[usize::from(level.level)];
            let first = plan.blocks.len();
            let mut all: Option<Span> = None;
            while let Some(c) = candidates.next_if(|c| usize::from(c.at) == at) {
                if c.is_hidden {
                    continue;
                }
                let block = ring.blocks[usize::from(c.block)];
                plan.blocks.push(block);
                plan.triangles += block.triangles();
                let so_far = all.unwrap_or(c.span);
                all = Some(Span {
                    near_m: so_far.near_m.min(c.span.near_m),
                    far_m: so_far.far_m.max(c.span.far_m),
                });
            }
            level.blocks = (first, plan.blocks.len() - first);
            let span = all.unwrap_or(Span {
                near_m: 1.0,
                far_m: 2.0,
            });
            level.depth = depth(along * span.near_m, span.far_m);
            level.slice = slice(at, coarser);
        }
    }

    /// Lists the blocks inside the picture's sides and before the horizon, level by level.
    fn find(&mut self, viewer: &Viewer, levels: &[LevelPlan]) {
        self.candidates.clear();
        for (at, plan) in (0..).zip(levels) {
            let ring = &self.rings[usize::from(plan.level)];
            let mut first = 0;
            for (end, around) in &ring.groups {
                let blocks = first..*end;
                first = *end;
                if viewer.sees(around).is_none() {
                    continue;
                }
                for block in blocks {
                    let bound = &ring.bounds[usize::from(block)];
                    let Some(span) = viewer.sees(bound) else {
                        continue;
                    };
                    let lattice = self.silhouette.lattice(bound);
                    let (near_m, far_m) = lattice.distances_m(bound.bulge_m());
                    self.candidates.push(Candidate {
                        at,
                        block,
                        span,
                        near_m,
                        far_m,
                        lattice,
                        is_hidden: false,
                    });
                }
            }
        }
    }

    /// Marks the blocks that lie behind others: each is held against the lines of all that are wholly nearer.
    fn hide(&mut self, ground: &Ground<'_>, levels: &[LevelPlan]) {
        let all = || (0..).take(self.candidates.len());
        let candidates = &self.candidates;
        let near = |&c: &u16| candidates[usize::from(c)].near_m;
        let far = |&c: &u16| candidates[usize::from(c)].far_m;
        self.by_near.clear();
        self.by_near.extend(all());
        self.by_near
            .sort_unstable_by(|a, b| near(a).total_cmp(&near(b)));
        self.by_far.clear();
        self.by_far.extend(all());
        self.by_far
            .sort_unstable_by(|a, b| far(a).total_cmp(&far(b)));
        let mut nearer = self.by_far.iter().peekable();
        for &c in &self.by_near {
            let near_m = self.candidates[usize::from(c)].near_m;
            while let Some(&n) =
                nearer.next_if(|&&n| self.candidates[usize::from(n)].far_m <= near_m)
            {
                let n = &self.candidates[usize::from(n)];
                if n.is_hidden {
                    continue;
                }
                let level = &levels[usize::from(n.at)];
                let ring = &self.rings[usize::from(level.level)];
                let (block, bound) = (
                    ring.blocks[usize::from(n.block)],
                    &ring.bounds[usize::from(n.block)],
                );
                ground.draw_lines(&mut self.silhouette, level, block, bound, &n.lattice);
            }
            let this = &self.candidates[usize::from(c)];
            let ring = &self.rings[usize::from(levels[usize::from(this.at)].level)];
            let bound = &ring.bounds[usize::from(this.block)];
            let tops_m = &ring.tops_m[usize::from(this.block)];
            let lattice = self.silhouette.lattice(bound);
            let is_hidden = self.silhouette.hides(&lattice, bound.bulge_m())
                || self
                    .silhouette
                    .hides_parts(&lattice, tops_m, bound.bulge_m());
            self.candidates[usize::from(c)].is_hidden = is_hidden;
        }
    }
}

impl Ground<'_> {
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

    /// Around a block, from the extremes of its heights.
    fn bound(&self, plan: &LevelPlan, block: Block) -> Bound {
        let (west, south) = (
            plan.window.i + i32::from(block.west),
            plan.window.j + i32::from(block.south),
        );
        let (width, height) = (block.width(), block.height());
        // On the outer edge a corner on an odd post is drawn at the even one before it, one cell beyond the block.
        let cells = plan.cells;
        let at_side = block.west == 0 || i32::from(block.east) == cells;
        let at_end = block.south == 0 || i32::from(block.north) == cells;
        let more_west = i32::from(at_end) * west.rem_euclid(2);
        let more_south = i32::from(at_side) * south.rem_euclid(2);
        let (low, high) = self.streamer.extremes(
            plan.level,
            (west - more_west, south - more_south),
            (width + more_west, height + more_south),
        );
        let cell_m = self.grid.spacing_deg(plan.level).to_radians() * WGS84_A_M;
        let bound = Bound::of(&Patch {
            partition: self.partition,
            south_deg: self.grid.latitude_deg(plan.level, south),
            west_deg: self.grid.longitude_deg(plan.level, west),
            north_deg: self.grid.latitude_deg(plan.level, south + height),
            east_deg: self.grid.longitude_deg(plan.level, west + width),
            height_min_m: self.heights.decode(low),
            height_max_m: self.heights.decode(high),
        });
        bound.widened(cell_m * f64::from(more_west.max(more_south)))
    }

    /// The tops of a block's quarters.
    fn tops_m(&self, plan: &LevelPlan, block: Block) -> Tops {
        let west = plan.window.i + i32::from(block.west);
        let south = plan.window.j + i32::from(block.south);
        // The posts of half a side, with those on its ends.
        let half = |first: i32, cells: i32, k: i32| {
            (first + cells * k / 2, first + (cells * (k + 1) + 1) / 2)
        };
        [0, 1].map(|row| {
            let (from_j, to_j) = half(south, block.height(), row);
            [0, 1].map(|column| {
                let (from_i, to_i) = half(west, block.width(), column);
                let code = self
                    .streamer
                    .top_code(plan.level, (from_i, from_j), (to_i, to_j));
                #[expect(
                    clippy::cast_possible_truncation,
                    reason = "metres; a centimetre is added"
                )]
                let top_m = self.heights.decode(code) as f32;
                top_m + 0.01
            })
        })
    }

    /// Adds lines of a block's posts to a silhouette: some of its even rows or columns, whose edges are drawn at any blend.
    fn draw_lines(
        &self,
        silhouette: &mut Silhouette,
        plan: &LevelPlan,
        block: Block,
        bound: &Bound,
        lattice: &Lattice,
    ) {
        let (w, h) = (block.width(), block.height());
        let (west, south) = (
            plan.window.i + i32::from(block.west),
            plan.window.j + i32::from(block.south),
        );
        let northward = silhouette.prefers_columns(bound);
        let (lines, posts, first) = if northward {
            (w, h, west)
        } else {
            (h, w, south)
        };
        let mut at = (-first).rem_euclid(LINE_STEP);
        while at <= lines {
            let line = lattice.line(f64::from(at) / f64::from(lines), northward);
            let each = 1.0 / f64::from(posts);
            let points = (0..=posts).map(|k| {
                let (i, j) = if northward {
                    (west + at, south + k)
                } else {
                    (west + k, south + at)
                };
                let code = self.streamer.floor_code(plan.level, i, j);
                line.point(f64::from(k) * each, self.heights.decode(code))
            });
            silhouette.add(points, bound.bulge_m());
            at += LINE_STEP;
        }
    }
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

/// Every how many posts a line is followed: an even number, since even rows and columns are edges at any blend.
const LINE_STEP: i32 = 2;

/// Clip z = k w + c between a near and a far distance along the optical axis, metres.
#[expect(
    clippy::cast_possible_truncation,
    reason = "f64 until here: these are the numbers the shader is given"
)]
fn depth(near_m: f64, far_m: f64) -> (f32, f32) {
    let near = near_m.max(NEAR_MIN_M);
    let far = (far_m * 1.001 + 1.0).max(near * 1.01);
    (
        ((far + near) / (far - near)) as f32,
        (-2.0 * far * near / (far - near)) as f32,
    )
}

/// The slice of the depth buffer of the `at`-th level drawn: the nearer half for the first, the rest shared equally.
#[expect(clippy::cast_precision_loss, reason = "at most ten levels")]
fn slice(at: usize, coarser: usize) -> (f32, f32) {
    if at == 0 {
        return (0.0, 0.5);
    }
    let each = 0.5 / coarser as f32;
    let near = 0.5 + (at - 1) as f32 * each;
    (near, near + each)
}
