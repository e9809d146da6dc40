//! The depth buffer, shared out: slices of it, each with a near and a far plane of its own.
//!
//! GLES 3.0 gives 24 bits and no say over what clip z means, so from 0.2 m to 400 km one pair of planes would leave steps of kilometres at
//! the horizon. Every level therefore draws into a slice of its own, and the finest one into two: the nine cells around
//! the eye, its *core*, and the rest. A line of sight leaves each of these squares once (they are nested around the
//! eye), so what is nearer in slices is nearer in space. Sides of constant latitude bulge towards the pole against a line of
//! sight, by 6 cells for a level-5 window at 60 degrees: far below what shows. In a cap they are straighter.
//!
//! A slice from `n` to `f` that has the share `s` of the depths tells distances `d^2 / (n s 2^24)` apart. The shares are as the ratios
//! `f / n`, which makes `d / (sum of all ratios 2^-24)` of it at the far end of every slice, and less before. With 3-second
//! posts the sum is 1300 (core, from 0.2 m) and 890 (rest) and 7 for each coarser level: a step is at most 1.4e-4 of the distance,
//! an eighth of a pixel at 1024 pixels for 60 degrees.

use super::blocks::Block;
use super::clipmap::CellRect;
use super::cull::Span;
use super::plan::LevelPlan;
use crate::limits::LEVELS_MAX;
use arrayvec::ArrayVec;

/// Nothing is drawn nearer to the eye, metres.
pub const NEAR_MIN_M: f64 = 0.2;

/// Depths that 24 bits tell apart.
const DEPTHS: f64 = 16_777_216.0;

/// A slice of the depth buffer and what is drawn into it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slice {
    /// Its blocks: the first in [`super::plan::Plan::blocks`], and how many.
    pub blocks: (usize, usize),
    /// Its planes, metres along the optical axis.
    pub near_m: f64,
    /// See `near_m`.
    pub far_m: f64,
    /// Clip z is the first times clip w plus the second.
    pub depth: (f32, f32),
    /// Its depths, from 0 to 1.
    pub range: (f32, f32),
    /// How many of its blocks, the last ones, can be drawn without the lower sides of triangles, see [`turn`].
    pub turned: usize,
}

impl Slice {
    /// For some blocks, all of them between these distances along the optical axis; [`share_out`] gives it its depths.
    #[must_use]
    pub fn new(blocks: (usize, usize), span: Span) -> Self {
        let near_m = span.near_m.max(NEAR_MIN_M);
        let far_m = (span.far_m * 1.001 + 1.0).max(near_m * 1.01);
        let deep = far_m - near_m;
        #[expect(
            clippy::cast_possible_truncation,
            reason = "f64 until here: these are the numbers the shader is given"
        )]
        let depth = (
            ((far_m + near_m) / deep) as f32,
            (-2.0 * far_m * near_m / deep) as f32,
        );
        Self {
            blocks,
            near_m,
            far_m,
            depth,
            range: (0.0, 1.0),
            turned: 0,
        }
    }

    /// In how many calls it is drawn.
    #[must_use]
    pub const fn draw_calls(&self) -> usize {
        1 + (self.turned > 0 && self.turned < self.blocks.1) as usize
    }

    /// How far apart two points must be along the optical axis, one of them at `distance_m`, to be told apart by 24 bits of
    /// depth, metres. `None` for a distance beyond its planes.
    #[must_use]
    pub fn step_m(&self, distance_m: f64) -> Option<f64> {
        let share = f64::from(self.range.1) - f64::from(self.range.0);
        let slope = distance_m * distance_m * (1.0 / self.near_m - 1.0 / self.far_m);
        (self.near_m..=self.far_m)
            .contains(&distance_m)
            .then(|| slope / (share * DEPTHS))
    }

    fn ratio(&self) -> f64 {
        self.far_m / self.near_m
    }
}

/// Slices of one level: the finest one's core and rest, or all of a coarser one.
pub type Slices = ArrayVec<Slice, 2>;

/// Gives the slices of all levels, nearest first, their depths: shares as the ratios of their planes.
pub fn share_out(levels: &mut [LevelPlan]) {
    let slices = levels.iter_mut().flat_map(|level| &mut level.slices);
    share(&mut slices.collect::<ArrayVec<&mut Slice, { LEVELS_MAX + 1 }>>());
}

#[expect(clippy::cast_possible_truncation, reason = "from 0 to 1")]
fn share(slices: &mut [&mut Slice]) {
    let ratios: f64 = slices.iter().map(|slice| slice.ratio()).sum();
    let mut far = 0.0;
    for slice in slices {
        let near = far;
        far += slice.ratio() / ratios;
        slice.range = (near as f32, far.min(1.0) as f32);
    }
}

/// So many slices at most are drawn in two calls.
const SPLITS_MAX: usize = 6;

/// Decides of which blocks only upper sides are drawn: from above ground the lower ones lie behind them. A third of all
/// triangles are seen from below.
///
/// Only blocks that nothing clips are taken ([`Cut::push`]). Rasterisers move corners to a raster finer than pixels, by
/// which a narrow triangle may turn over. Whoever judges sides after that leaves no gap, since whole surfaces have one more
/// upper side than lower ones over each pixel, before it and after. Mesa's software renderers clip a block with all its
/// triangles in a path of their own, which judges before, and leaves out such a triangle although its neighbours do not
/// cover it. So that few blocks are clipped, the viewport is larger than the picture ([`super::cull::WIDE`]).
pub fn turn(levels: &mut [LevelPlan], is_above_ground: bool) {
    let mut splits = 0;
    for slice in levels.iter_mut().flat_map(|level| &mut level.slices) {
        let is_split = slice.turned < slice.blocks.1;
        let pays = 2 * slice.turned > slice.blocks.1;
        if !is_above_ground || (is_split && (!pays || splits == SPLITS_MAX)) {
            slice.turned = 0;
        }
        splits += slice.draw_calls() - 1;
    }
}

/// The cells around the eye that have a slice of their own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Core {
    cells: CellRect,
    /// All cells beside these are at least so far from the eye.
    clear_m: f64,
    /// None of these is farther from the eye's vertical.
    wide_m: f64,
}

/// Cells of a core, and so the most blocks that it can be drawn as.
const CORE_CELLS: usize = 9;

impl Core {
    /// Around an eye, in cells from the origin of what is drawn. `cell_m`: how
    /// high a cell is, `narrow`: how much narrower it is at least than that.
    #[must_use]
    pub fn around((x, y): (f64, f64), cell_m: f64, narrow: f64) -> Self {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "a cell of a window or near it"
        )]
        let (x, y) = (x.floor() as i32, y.floor() as i32);
        Self {
            cells: CellRect {
                x0: x - 1,
                y0: y - 1,
                x1: x + 2,
                y1: y + 2,
            },
            // Heights of -500 m to 20 km and the ellipsoid's shape change a cell by less than a hundredth.
            clear_m: 0.98 * cell_m * narrow,
            wide_m: 1.02 * 8_f64.sqrt() * cell_m,
        }
    }

    /// What a block shares with the core, and what is left of it: below, above, to the left and to the right.
    #[must_use]
    pub fn split(&self, block: Block) -> (Option<Block>, [Option<Block>; 4]) {
        let of = |x0: i32, y0: i32, x1: i32, y1: i32| {
            (x0 < x1 && y0 < y1).then(|| Block::of(CellRect { x0, y0, x1, y1 }))
        };
        let [west, east, south, north] =
            [block.west, block.east, block.south, block.north].map(i32::from);
        let (x0, x1) = (self.cells.x0.max(west), self.cells.x1.min(east));
        let (y0, y1) = (self.cells.y0.max(south), self.cells.y1.min(north));
        match of(x0, y0, x1, y1) {
            None => (None, [Some(block), None, None, None]),
            inside => {
                let rest = [
                    of(west, south, east, y0),
                    of(west, y1, east, north),
                    of(west, y0, x0, y1),
                    of(x1, y0, east, y1),
                ];
                (inside, rest)
            }
        }
    }
}

/// A level on its way into slices.
#[derive(Debug)]
pub struct Cut {
    core: Option<Core>,
    inside: ArrayVec<Block, CORE_CELLS>,
    inside_span: Option<Span>,
    rest_span: Option<Span>,
    whole: usize,
}

impl Cut {
    /// With the cells of a core apart, if it is the finest level.
    #[must_use]
    pub fn of(core: Option<Core>) -> Self {
        Self {
            core,
            inside: ArrayVec::new(),
            inside_span: None,
            rest_span: None,
            whole: 0,
        }
    }

    /// The near plane of what is not the core's, where the nearest of the level's blocks is `nearest_m` away; never nearer than
    /// that. `along`: see [`Self::finish`].
    #[must_use]
    pub fn near_m(core: Option<&Core>, nearest_m: f64, along: f64) -> f64 {
        let clear_m = core.map_or(0.0, |core| core.clear_m);
        (nearest_m.max(clear_m) * along).max(NEAR_MIN_M)
    }

    /// Adds a block that lies within a span, and no more than `rise_m` above or below the eye; what is not the core's goes
    /// to `out`. Those that are `whole`, which nothing clips if [`Self::near_m`] is their slice's, must come last.
    pub fn push(
        &mut self,
        block: Block,
        (span, is_whole): (Span, bool),
        rise_m: f64,
        out: &mut Vec<Block>,
    ) {
        let grow = |to: &mut Option<Span>, span: Span| {
            let so_far = to.unwrap_or(span);
            *to = Some(Span {
                near_m: so_far.near_m.min(span.near_m),
                far_m: so_far.far_m.max(span.far_m),
            });
        };
        let whole = (None, [Some(block), None, None, None]);
        let (inside, rest) = self.core.map_or(whole, |core| core.split(block));
        if let (Some(inside), Some(core)) = (inside, &self.core) {
            let far_m = span.far_m.min(core.wide_m.hypot(rise_m));
            grow(&mut self.inside_span, Span { far_m, ..span });
            self.inside.push(inside);
        }
        if rest != [None; 4] {
            grow(&mut self.rest_span, span);
            let before = out.len();
            out.extend(rest.into_iter().flatten());
            if is_whole {
                self.whole += out.len() - before;
            }
        }
    }

    /// The slices of the level, whose blocks begin at the `first` of `out`; the core's are added to them. A distance along a
    /// ray is at least the share `along` of it along the optical axis. `near_m`: where whole blocks are not clipped.
    #[must_use]
    pub fn finish(self, along: f64, near_m: f64, first: usize, out: &mut Vec<Block>) -> Slices {
        let mut slices = Slices::new();
        let rest = (first, out.len() - first);
        let slice = |blocks, span: Span| {
            let near_m = span.near_m * along;
            Slice::new(blocks, Span { near_m, ..span })
        };
        if let Some(span) = self.inside_span {
            slices.push(slice((out.len(), self.inside.len()), span));
            out.extend(self.inside);
        }
        if let Some(mut span) = self.rest_span {
            if let Some(core) = self.core {
                span.near_m = span.near_m.max(core.clear_m);
            }
            let slice = slice(rest, span);
            let turned = if slice.near_m <= near_m {
                self.whole
            } else {
                0
            };
            slices.push(Slice { turned, ..slice });
        }
        slices
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_core_takes_its_cells_out_of_blocks_and_leaves_the_others() {
        let core = Core::around((4.5, 8.2), 90.0, 0.7);
        let mut taken = 0;
        for (x0, y0) in [(0, 0), (9, 0), (0, 9), (4, 8), (30, 30)] {
            let block = Block::of(CellRect {
                x0,
                y0,
                x1: x0 + 9,
                y1: y0 + 9,
            });
            let (inside, rest) = core.split(block);
            let parts = inside.into_iter().chain(rest.into_iter().flatten());
            let mut cells: Vec<(i16, i16)> = parts
                .flat_map(|b| {
                    (b.west..b.east).flat_map(move |x| (b.south..b.north).map(move |y| (x, y)))
                })
                .collect();
            cells.sort_unstable();
            cells.dedup();
            assert_eq!(cells.len(), 81, "every cell of {block:?} once");
            let own = inside.map_or(0, |b| b.width() * b.height());
            if (x0, y0) == (0, 0) || (x0, y0) == (0, 9) {
                taken += own;
            }
        }
        assert_eq!(taken, 9, "the two blocks that it lies in");
    }

    #[test]
    fn a_slice_is_drawn_in_two_calls_only_where_that_pays_and_there_are_calls_left() {
        let level = |blocks: usize, turned: usize| {
            let span = Span {
                near_m: 1.0,
                far_m: 2.0,
            };
            let mut slices = Slices::new();
            slices.push(Slice {
                turned,
                ..Slice::new((0, blocks), span)
            });
            slices
        };
        let turned = |is_above_ground: bool, of: &[(usize, usize)]| -> Vec<usize> {
            let mut levels: Vec<LevelPlan> = of
                .iter()
                .map(|&(blocks, turned)| LevelPlan {
                    slices: level(blocks, turned),
                    ..LevelPlan::EMPTY
                })
                .collect();
            turn(&mut levels, is_above_ground);
            let calls: usize = levels.iter().map(|l| l.slices[0].draw_calls()).sum();
            assert!(calls <= of.len() + SPLITS_MAX, "{calls} calls");
            levels.iter().map(|l| l.slices[0].turned).collect()
        };
        let slices = [(10, 10), (10, 4), (10, 6), (10, 0)];
        assert_eq!(turned(true, &slices), [10, 0, 6, 0]);
        assert_eq!(turned(false, &slices), [0; 4], "from below ground");
        let many = turned(true, &[(10, 9); 8]);
        assert_eq!(many, [9, 9, 9, 9, 9, 9, 0, 0], "six in two calls");
    }

    #[test]
    fn depths_of_slices_follow_each_other_and_steps_are_even() {
        let span = |near_m, far_m| Span { near_m, far_m };
        let mut slices = [
            Slice::new((0, 1), span(0.1, 260.0)),
            Slice::new((1, 1), span(90.0, 30_000.0)),
            Slice::new((2, 1), span(15_000.0, 60_000.0)),
        ];
        let ratios: f64 = slices.iter().map(Slice::ratio).sum();
        share(&mut slices.each_mut());
        assert!(
            slices[0].range.0 <= 0.0 && slices[2].range.1 >= 0.999_999,
            "all is used"
        );
        for pair in slices.windows(2) {
            assert!(pair[0].range.1 <= pair[1].range.0, "{pair:?}");
        }
        for slice in &slices {
            let step = slice.step_m(slice.far_m).expect("its own plane");
            assert!(step / slice.far_m < 1.01 * ratios / DEPTHS, "{slice:?}");
            assert!(slice.step_m(slice.near_m * 0.9).is_none(), "before it");
        }
    }
}
