//! What a tile is predicted as, row by row: the same for who writes and who reads. See the pyramid's own description.

use super::Parent;
use crate::limits::TILE_POSTS;
use crate::terrain::codec::{SurfaceKind, boxed};
use crate::terrain::grid::TILE_AREA;
use crate::terrain::rans::ROW;

/// Posts of a parent along a side of one of its children.
pub(super) const HALF: usize = TILE_POSTS / 2;
const _: () = assert!(HALF == ROW, "a row of residuals is half a row of posts");
/// A plane: [`HALF`] posts, one before them and two behind; padded to a multiple of 4.
const WIDE: usize = HALF + 4;
/// The place of post 0 in a plane.
pub(super) const FIRST: usize = 1;

/// Where the contexts part, in eighths of the divisor.
const PARTS: [i32; 7] = [3, 7, 12, 22, 37, 60, 98];
/// Where no post is.
const NO_KIND: u8 = 255;
/// The kind of no post: beyond the tile, where kinds differ.
const ALIEN: u8 = 7;

fn alike(a: u8, b: u8) -> u8 {
    if a == b { a } else { ALIEN }
}

type Plane = [[i32; WIDE]; WIDE];
type Kinds = [[u8; WIDE]; WIDE];
pub(super) type Row = [i32; ROW];
pub(super) type Contexts = [u8; ROW];

/// Of what kinds the posts of a row and around it are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mixture {
    /// All are land.
    Land,
    /// All are of one other kind.
    Other,
    /// Several.
    Several,
}

/// The bit of land among kinds.
const LAND: u8 = 1 << SurfaceKind::Land as u8;

/// Posts of one sort.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sort {
    Even,
    East,
    North,
    Both,
}

impl Sort {
    /// Column and row of its first post.
    const fn first(self) -> (usize, usize) {
        match self {
            Self::Even => (0, 0),
            Self::East => (1, 0),
            Self::North => (0, 1),
            Self::Both => (1, 1),
        }
    }

    /// Where its post (x, y) stands in a tile.
    pub(super) const fn index(self, x: usize, y: usize) -> usize {
        let (column, row) = self.first();
        (2 * y + row) * TILE_POSTS + 2 * x + column
    }
}

/// Gives the residuals of a row: from a stream, or from the heights.
pub(super) trait Residuals {
    /// `steps` holds what q is multiplied by.
    fn row(
        &mut self,
        at: (Sort, usize),
        predicted: &Row,
        steps: &Row,
        contexts: &Contexts,
        residuals: &mut Row,
    );
}

/// What coding works with.
pub(super) struct Work {
    pub(super) planes: [Box<Plane>; 4],
    /// |q s| of *east* and *north*.
    spread: [Box<Plane>; 2],
    /// Kinds of the four sorts; read only where a tile is not all land.
    kinds: [Box<Kinds>; 4],
    /// Whether the tile is its parent's eastern and northern one.
    side: Option<(bool, bool)>,
    /// Which kinds a row of them has: bit k for kind k.
    among: [[u8; WIDE]; 4],
    pub(super) step: i32,
    parts: [[i32; 7]; 2],
    pub(super) has_kinds: bool,
}

impl Work {
    pub(super) fn new() -> Box<Self> {
        let plane = |_| boxed([0; WIDE]);
        Box::new(Self {
            planes: std::array::from_fn(plane),
            spread: std::array::from_fn(plane),
            kinds: std::array::from_fn(|_| boxed([NO_KIND; WIDE])),
            side: None,
            among: [[0; WIDE]; 4],
            step: 1,
            parts: [[0; 7]; 2],
            has_kinds: false,
        })
    }

    /// Lays the parent's quadrant and what is around it.
    pub(super) fn lay(&mut self, parent: Option<Parent<'_>>, flat: u16) {
        let even = &mut self.planes[Sort::Even as usize];
        let Some(parent) = parent else {
            even.fill([i32::from(flat); WIDE]);
            self.kinds[Sort::Even as usize].fill([ALIEN; WIDE]);
            self.side = None;
            return;
        };
        self.side = Some((parent.east, parent.north));
        let (west, south) = (
            if parent.east { HALF } else { 0 },
            if parent.north { HALF } else { 0 },
        );
        let of_parent = |at: usize, first: usize| {
            let place = (first + at).checked_sub(FIRST);
            place.filter(|place| *place < TILE_POSTS)
        };
        for (y, own) in even.iter_mut().enumerate().take(HALF + 3) {
            let Some(row) = of_parent(y, south) else {
                continue;
            };
            for (x, height) in own.iter_mut().enumerate().take(HALF + 3) {
                if let Some(column) = of_parent(x, west) {
                    *height = i32::from(parent.tile.quanta[row * TILE_POSTS + column]);
                }
            }
            go_on(own, parent.east);
        }
        if parent.north {
            let (a, b) = (even[HALF - 1], even[HALF]);
            even[HALF + 1] = line(&a, &b, 1);
            even[HALF + 2] = line(&a, &b, 2);
        } else {
            let (a, b) = (even[2], even[1]);
            even[0] = line(&a, &b, 1);
        }
        if self.has_kinds {
            self.lay_kinds(parent, (west, south));
        }
    }

    fn lay_kinds(&mut self, parent: Parent<'_>, (west, south): (usize, usize)) {
        let of_parent = |at: usize, first: usize| {
            let place = (first + at).checked_sub(FIRST);
            place.filter(|place| *place < TILE_POSTS)
        };
        let kinds = &mut self.kinds[Sort::Even as usize];
        for (y, own) in kinds.iter_mut().enumerate().take(HALF + 3) {
            for (x, kind) in own.iter_mut().enumerate().take(HALF + 3) {
                *kind = match (of_parent(x, west), of_parent(y, south)) {
                    (Some(column), Some(row)) => parent.tile.kind[row * TILE_POSTS + column] as u8,
                    _ => ALIEN,
                };
            }
        }
    }

    /// Continues the kinds beyond the tile as its heights are continued: as the last two, if they are alike.
    fn continue_kinds(&mut self) {
        let [even, east, north, _] = &mut self.kinds;
        if let Some((is_east, is_north)) = self.side {
            for row in even.iter_mut().take(HALF + 3) {
                if is_east {
                    let kind = alike(row[HALF - 1], row[HALF]);
                    (row[HALF + 1], row[HALF + 2]) = (kind, kind);
                } else {
                    row[0] = alike(row[1], row[2]);
                }
            }
            for x in 0..HALF + 3 {
                if is_north {
                    let kind = alike(even[HALF - 1][x], even[HALF][x]);
                    (even[HALF + 1][x], even[HALF + 2][x]) = (kind, kind);
                } else {
                    even[0][x] = alike(even[1][x], even[2][x]);
                }
            }
        }
        for beyond in [0, HALF + 1, HALF + 2] {
            for at in FIRST..=HALF {
                east[beyond][at] = alike(even[beyond][at], even[beyond][at + 1]);
                north[at][beyond] = alike(even[at][beyond], even[at + 1][beyond]);
            }
        }
    }

    /// The kinds of the tile itself, which are known before its heights.
    pub(super) fn take_kinds(&mut self, kind: &[SurfaceKind; TILE_AREA]) {
        for sort in [Sort::Even, Sort::East, Sort::North, Sort::Both] {
            let kinds = &mut self.kinds[sort as usize];
            if sort != Sort::Even {
                kinds.fill([NO_KIND; WIDE]);
            }
            for y in 0..HALF {
                for x in 0..HALF {
                    kinds[y + FIRST][x + FIRST] = kind[sort.index(x, y)] as u8;
                }
            }
        }
    }

    /// Notes which kinds the rows have, once all are taken.
    pub(super) fn note_kinds(&mut self) {
        self.continue_kinds();
        for (among, kinds) in self.among.iter_mut().zip(&self.kinds) {
            for (among, row) in among.iter_mut().zip(kinds.iter()) {
                *among = row.iter().fold(0, |all, kind| match kind {
                    0..=7 => all | (1 << kind),
                    _ => all,
                });
            }
        }
    }

    /// What the kinds of a row of a sort and of those it is predicted from come to; `rows` of both.
    fn mixture(&self, own: (Sort, usize), from: &[(Sort, usize)]) -> Mixture {
        if !self.has_kinds {
            return Mixture::Land;
        }
        let of = |(sort, row): &(Sort, usize)| self.among[*sort as usize][*row];
        let all = from.iter().map(of).fold(of(&own), |a, b| a | b);
        if all & !LAND == 0 {
            Mixture::Land
        } else if all.is_power_of_two() {
            Mixture::Other
        } else {
            Mixture::Several
        }
    }

    pub(super) fn set_divisor(&mut self, divisor: u16) {
        for (parts, times) in self.parts.iter_mut().zip([3, 4]) {
            *parts = PARTS.map(|part| (part * times * i32::from(divisor) + 7) / 8);
        }
    }

    pub(super) fn run(&mut self, told: &mut impl Residuals, has_even: bool) {
        if has_even {
            for y in 0..HALF {
                self.even_row(told, y);
            }
        }
        for y in 0..HALF {
            self.east_row(told, y);
        }
        self.east_beyond();
        for y in 0..HALF {
            self.north_row(told, y);
        }
        for y in 0..HALF {
            self.both_row(told, y);
        }
    }

    /// The steps of a row; where all is land they are one.
    pub(super) fn steps(&self, sort: Sort, y: usize) -> Row {
        let mut steps = [self.step; ROW];
        if self.has_kinds {
            let kinds = &self.kinds[sort as usize][y + FIRST][FIRST..];
            for (step, kind) in steps.iter_mut().zip(kinds) {
                if *kind != SurfaceKind::Land as u8 {
                    *step = 1;
                }
            }
        }
        steps
    }

    fn even_row(&mut self, told: &mut impl Residuals, y: usize) {
        let steps = self.steps(Sort::Even, y);
        let mut contexts = [18; ROW];
        if self.has_kinds {
            let kinds = &self.kinds[Sort::Even as usize][y + FIRST][FIRST..];
            for (context, kind) in contexts.iter_mut().zip(kinds) {
                *context += u8::from(*kind != SurfaceKind::Land as u8);
            }
        }
        let row = &mut self.planes[Sort::Even as usize][y + FIRST];
        let mut predicted = [0; ROW];
        predicted.copy_from_slice(&row[FIRST..=HALF]);
        let mut q = [0; ROW];
        told.row((Sort::Even, y), &predicted, &steps, &contexts, &mut q);
        for x in 0..ROW {
            row[x + FIRST] = height(predicted[x] + q[x] * steps[x]);
        }
    }

    fn east_row(&mut self, told: &mut impl Residuals, y: usize) {
        let steps = self.steps(Sort::East, y);
        let mixture = self.mixture((Sort::East, y + FIRST), &[(Sort::Even, y + FIRST)]);
        let [even, east, ..] = &mut self.planes;
        let line = &even[y + FIRST];
        let (mut predicted, mut v) = ([0; ROW], [0; ROW]);
        for x in 0..ROW {
            (predicted[x], v[x]) = cubic(line[x], line[x + 1], line[x + 2], line[x + 3]);
        }
        let below = (y > 0).then_some(&self.spread[0][y]);
        let mut contexts = contexts_of(&v, below, &self.parts[0]);
        if mixture == Mixture::Other {
            for (x, context) in contexts.iter_mut().enumerate() {
                *context = flatness(line[x + 1] == line[x + 2]);
            }
        } else if mixture == Mixture::Several {
            let kinds = &self.kinds[Sort::Even as usize][y + FIRST];
            let own = &self.kinds[Sort::East as usize][y + FIRST];
            for x in 0..ROW {
                let at = [0, 1, 2, 3].map(|k| (line[x + k], kinds[x + k]));
                let guess = Guess::new(at, own[x + FIRST]);
                (predicted[x], contexts[x]) =
                    (guess.height, guess.context(own[x + FIRST], contexts[x]));
            }
        }
        let mut q = [0; ROW];
        told.row((Sort::East, y), &predicted, &steps, &contexts, &mut q);
        let east = &mut east[y + FIRST];
        let spread = &mut self.spread[0][y + FIRST];
        for x in 0..ROW {
            let residual = q[x] * steps[x];
            spread[x + FIRST] = residual.abs();
            east[x + FIRST] = height(predicted[x] + residual);
        }
    }

    /// *east* south and north of the tile, where nothing is told.
    fn east_beyond(&mut self) {
        let [even, east, ..] = &mut self.planes;
        for y in [0, HALF + 1, HALF + 2] {
            let line = &even[y];
            for x in 0..ROW {
                east[y][x + FIRST] = cubic(line[x], line[x + 1], line[x + 2], line[x + 3]).0;
            }
        }
    }

    fn north_row(&mut self, told: &mut impl Residuals, y: usize) {
        let steps = self.steps(Sort::North, y);
        let around = [0, 1, 2, 3].map(|k| (Sort::Even, y + k));
        let mixture = self.mixture((Sort::North, y + FIRST), &around);
        let [even, _, north, _] = &mut self.planes;
        let lines = [&even[y], &even[y + 1], &even[y + 2], &even[y + 3]];
        let at = |x: usize| cubic(lines[0][x], lines[1][x], lines[2][x], lines[3][x]);
        let (mut predicted, mut v) = ([0; ROW], [0; ROW]);
        for x in 0..ROW {
            (predicted[x], v[x]) = at(x + FIRST);
        }
        let below = (y > 0).then_some(&self.spread[1][y]);
        let mut contexts = contexts_of(&v, below, &self.parts[0]);
        if mixture == Mixture::Other {
            for (x, context) in contexts.iter_mut().enumerate() {
                *context = flatness(lines[1][x + FIRST] == lines[2][x + FIRST]);
            }
        } else if mixture == Mixture::Several {
            let kinds = &self.kinds[Sort::Even as usize];
            let own = &self.kinds[Sort::North as usize][y + FIRST];
            for x in 0..ROW {
                let at = [0, 1, 2, 3].map(|k| (lines[k][x + FIRST], kinds[y + k][x + FIRST]));
                let guess = Guess::new(at, own[x + FIRST]);
                (predicted[x], contexts[x]) =
                    (guess.height, guess.context(own[x + FIRST], contexts[x]));
            }
        }
        let mut q = [0; ROW];
        told.row((Sort::North, y), &predicted, &steps, &contexts, &mut q);
        let row = &mut north[y + FIRST];
        let spread = &mut self.spread[1][y + FIRST];
        for x in [0, HALF + 1, HALF + 2] {
            row[x] = at(x).0;
        }
        for x in 0..ROW {
            let residual = q[x] * steps[x];
            spread[x + FIRST] = residual.abs();
            row[x + FIRST] = height(predicted[x] + residual);
        }
    }

    fn both_row(&mut self, told: &mut impl Residuals, y: usize) {
        let steps = self.steps(Sort::Both, y);
        let mut around = [(Sort::North, y + FIRST); 5];
        for (k, around) in around.iter_mut().skip(1).enumerate() {
            *around = (Sort::East, y + k);
        }
        let mixture = self.mixture((Sort::Both, y + FIRST), &around);
        let [_, east, north, both] = &mut self.planes;
        let line = &north[y + FIRST];
        let lines = [&east[y], &east[y + 1], &east[y + 2], &east[y + 3]];
        let [of_east, of_north] = &self.spread;
        let (of_east, of_north) = ([&of_east[y + 1], &of_east[y + 2]], &of_north[y + 1]);
        let (mut predicted, mut v) = ([0; ROW], [0; ROW]);
        for x in 0..ROW {
            let (along, _) = cubic(line[x], line[x + 1], line[x + 2], line[x + 3]);
            let k = x + FIRST;
            let (across, _) = cubic(lines[0][k], lines[1][k], lines[2][k], lines[3][k]);
            predicted[x] = (along + across + 1) >> 1;
            let beside = of_east[0][k] + of_east[1][k] + of_north[k] + of_north[k + 1];
            v[x] = 2 * (along - across).abs() + beside;
        }
        let mut contexts = contexts_at(&v, &self.parts[1]).map(|c| c + 8);
        if mixture == Mixture::Other {
            for (x, context) in contexts.iter_mut().enumerate() {
                let across = lines[1][x + FIRST] == lines[2][x + FIRST];
                *context = flatness(line[x + 1] == line[x + 2] || across);
            }
        } else if mixture == Mixture::Several {
            let own = &self.kinds[Sort::Both as usize][y + FIRST];
            let of_north = &self.kinds[Sort::North as usize][y + FIRST];
            let of_east = &self.kinds[Sort::East as usize];
            for x in 0..ROW {
                let (k, own) = (x + FIRST, own[x + FIRST]);
                let along = [0, 1, 2, 3].map(|n| (line[x + n], of_north[x + n]));
                let across = [0, 1, 2, 3].map(|n| (lines[n][k], of_east[y + n][k]));
                let guess = Guess::of_two(&Guess::new(along, own), &Guess::new(across, own));
                (predicted[x], contexts[x]) = (guess.height, guess.context(own, contexts[x]));
            }
        }
        let mut q = [0; ROW];
        told.row((Sort::Both, y), &predicted, &steps, &contexts, &mut q);
        for x in 0..ROW {
            both[y + FIRST][x + FIRST] = height(predicted[x] + q[x] * steps[x]);
        }
    }

    /// The decoded heights.
    pub(super) fn give(&self, quanta: &mut [u16; TILE_AREA]) {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "`height` keeps them within 16 bits"
        )]
        let post = |v: i32| v as u16;
        for (y, rows) in quanta.chunks_exact_mut(2 * TILE_POSTS).enumerate() {
            let (south, north) = rows.split_at_mut(TILE_POSTS);
            for (row, [first, second]) in [(south, [0, 1]), (north, [2, 3])] {
                let first = &self.planes[first][y + FIRST][FIRST..=HALF];
                let second = &self.planes[second][y + FIRST][FIRST..=HALF];
                for (pair, (a, b)) in row.chunks_exact_mut(2).zip(first.iter().zip(second)) {
                    (pair[0], pair[1]) = (post(*a), post(*b));
                }
            }
        }
    }
}

/// Continues a row of the parent on the sides where it ends: `east` says that it is the eastern one.
fn go_on(row: &mut [i32; WIDE], east: bool) {
    if east {
        let rise = row[HALF] - row[HALF - 1];
        row[HALF + 1] = row[HALF] + rise;
        row[HALF + 2] = row[HALF] + 2 * rise;
    } else {
        row[0] = 2 * row[1] - row[2];
    }
}

/// The row that lies `times` beyond `b` on the line from `a`.
fn line(a: &[i32; WIDE], b: &[i32; WIDE], times: i32) -> [i32; WIDE] {
    let mut out = *b;
    for (out, a) in out.iter_mut().zip(a) {
        *out += times * (*out - a);
    }
    out
}

/// A height of 16 bits: no post has another, so what lies outside can only come nearer to it.
#[inline]
fn height(v: i32) -> i32 {
    v.clamp(0, 0xffff)
}

/// The cubic's middle, as a height, and how far the four are from a line.
#[inline]
pub(super) fn cubic(a: i32, b: i32, c: i32, d: i32) -> (i32, i32) {
    (
        height((9 * (b + c) - a - d + 8) >> 4),
        (a - b - c + d).abs(),
    )
}

/// Contexts 0 to 7 of a row of *east* or *north*; `below` is |q s| one row south.
#[inline]
fn contexts_of(curve: &Row, below: Option<&[i32; WIDE]>, parts: &[i32; 7]) -> Contexts {
    let mut v = *curve;
    match below {
        Some(below) => {
            for (v, below) in v.iter_mut().zip(&below[FIRST..]) {
                *v += 2 * below;
            }
        }
        None => {
            for v in &mut v {
                *v *= 2;
            }
        }
    }
    contexts_at(&v, parts)
}

#[inline]
fn contexts_at(v: &Row, parts: &[i32; 7]) -> Contexts {
    let mut contexts = [0_u8; ROW];
    for (context, v) in contexts.iter_mut().zip(v) {
        let passed = parts.iter().map(|part| i32::from(v >= part));
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "7 at most"
        )]
        {
            *context = passed.sum::<i32>() as u8;
        }
    }
    contexts
}

/// The context of a post that is not land.
const fn flatness(is_flat: bool) -> u8 {
    if is_flat { 16 } else { 17 }
}

/// A prediction among posts of several kinds.
struct Guess {
    height: i32,
    /// Whether a neighbour is of the post's kind.
    has_kin: bool,
    /// Whether both nearest neighbours are of its kind and equal.
    is_flat: bool,
}

impl Guess {
    /// From four neighbours on a line, with their kinds, for a post of kind `own`.
    fn new([a, b, c, d]: [(i32, u8); 4], own: u8) -> Self {
        let is_kin = |n: (i32, u8)| n.1 == own;
        let mean = (b.0 + c.0 + 1) >> 1;
        let height = match (is_kin(b), is_kin(c)) {
            (true, true) if is_kin(a) && is_kin(d) => cubic(a.0, b.0, c.0, d.0).0,
            (true, false) => b.0,
            (false, true) => c.0,
            (true, true) | (false, false) => mean,
        };
        Self {
            height: self::height(height),
            has_kin: is_kin(b) || is_kin(c),
            is_flat: is_kin(b) && is_kin(c) && b.0 == c.0,
        }
    }

    fn of_two(along: &Self, across: &Self) -> Self {
        let height = match (along.has_kin, across.has_kin) {
            (true, false) => along.height,
            (false, true) => across.height,
            (true, true) | (false, false) => (along.height + across.height + 1) >> 1,
        };
        Self {
            height,
            has_kin: along.has_kin || across.has_kin,
            is_flat: along.is_flat || across.is_flat,
        }
    }

    const fn context(&self, own: u8, of_land: u8) -> u8 {
        if own == SurfaceKind::Land as u8 {
            of_land
        } else {
            flatness(self.is_flat)
        }
    }
}
