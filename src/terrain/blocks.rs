//! What is drawn of a level: its window, or the ring that a finer window leaves of it, cut into blocks that one index
//! pattern serves.
//!
//! The hole is cut by choosing blocks, never by discarding pixels. A cell's diagonal runs from south-west to north-east
//! where the sum of its post numbers is even and the other way where it is odd, whatever block it is drawn in; since a
//! block may begin on either parity, the pattern has one column of cells more than a block and a block of odd parity uses
//! it one column late. Vertices past a block's own width and height collapse onto its edge, so surplus triangles have no
//! area.

use super::clipmap::{CellRect, Shape};
use arrayvec::ArrayVec;
use bytemuck::{Pod, Zeroable};

/// Most blocks a level can need: 50 by 50 of 9 cells for 447 vertices without a hole. With a hole no more than that, plus a
/// row and a column in each of the four bands that the hole's sides cut.
pub const BLOCKS_MAX: usize = 2704;

/// One block: an instance of the pattern, as the vertex shader reads it. Posts counted from the window's origin.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct Block {
    /// First column.
    pub west: i16,
    /// Last column.
    pub east: i16,
    /// First row.
    pub south: i16,
    /// Last row.
    pub north: i16,
}

impl Block {
    /// Of some cells, from the window's origin.
    #[must_use]
    pub fn of(cells: CellRect) -> Self {
        // Windows have at most a few hundred cells.
        let short = |cell: i32| i16::try_from(cell).unwrap_or(i16::MAX);
        Self {
            west: short(cells.x0),
            east: short(cells.x1),
            south: short(cells.y0),
            north: short(cells.y1),
        }
    }

    /// Cells across.
    #[must_use]
    pub fn width(&self) -> i32 {
        i32::from(self.east) - i32::from(self.west)
    }

    /// Cells up.
    #[must_use]
    pub fn height(&self) -> i32 {
        i32::from(self.north) - i32::from(self.south)
    }

    /// Triangles that have an area.
    #[must_use]
    pub fn triangles(&self) -> usize {
        usize::try_from(2 * self.width() * self.height()).unwrap_or(0)
    }
}

/// Blocks of one level.
pub type Blocks = ArrayVec<Block, BLOCKS_MAX>;

/// Cuts a square of `w` cells without those of `hole`, and without rows outside `rows` (cells from the origin, first and one
/// past the last), into blocks. Returns whether they fitted; they do for every hole that [`super::clipmap::hole`] gives.
pub fn ring(
    shape: Shape,
    w: i32,
    hole: Option<CellRect>,
    rows: (i32, i32),
    out: &mut Blocks,
) -> bool {
    out.clear();
    let full = CellRect {
        x0: 0,
        y0: 0,
        x1: w,
        y1: w,
    };
    let bands = match hole {
        None => [
            full,
            CellRect { y1: 0, ..full },
            CellRect { y1: 0, ..full },
            CellRect { y1: 0, ..full },
        ],
        Some(h) => [
            CellRect { y1: h.y0, ..full },
            CellRect {
                y0: h.y0,
                y1: h.y1,
                x1: h.x0,
                ..full
            },
            CellRect {
                y0: h.y0,
                y1: h.y1,
                x0: h.x1,
                ..full
            },
            CellRect { y0: h.y1, ..full },
        ],
    };
    bands.into_iter().all(|band| {
        let band = CellRect {
            y0: band.y0.max(rows.0),
            y1: band.y1.min(rows.1),
            ..band
        };
        cut(shape.block_cells(), band, out)
    })
}

/// Cuts a rectangle into the fewest blocks, as equal as can be. Whether there was room for them.
fn cut(longest: i32, rect: CellRect, out: &mut Blocks) -> bool {
    let (width, height) = (rect.x1 - rect.x0, rect.y1 - rect.y0);
    if width <= 0 || height <= 0 {
        return true;
    }
    let across = (width + longest - 1) / longest;
    let up = (height + longest - 1) / longest;
    for b in 0..up {
        let (y0, y1) = (rect.y0 + height * b / up, rect.y0 + height * (b + 1) / up);
        for a in 0..across {
            let (x0, x1) = (
                rect.x0 + width * a / across,
                rect.x0 + width * (a + 1) / across,
            );
            if out
                .try_push(Block::of(CellRect { x0, y0, x1, y1 }))
                .is_err()
            {
                return false;
            }
        }
    }
    true
}

/// From one row of the pattern to the next: a vertex is known by its number alone, column + 32 row, and needs no buffer.
const PATTERN_COLUMNS: i32 = 32;

/// How many columns of cells are drawn together, so that a vertex is still in a small post-transform cache when the row
/// above asks for it again (16 entries on old Malis: two rows of seven vertices fit).
const STRIPE_CELLS: i32 = 6;

/// One past the highest number of a vertex of the pattern. The numbers that no triangle asks for collapse onto the block's
/// eastern edge like all others past it.
#[must_use]
pub fn pattern_numbers(shape: Shape) -> usize {
    usize::try_from(PATTERN_COLUMNS * (shape.block_cells() + 1)).unwrap_or(0)
}

/// Numbers of the pattern's vertices, column + 32 row, of `block_cells + 2` columns and `block_cells + 1` rows: two triangles
/// a cell, counter-clockwise seen from above, in stripes.
#[must_use]
pub fn pattern_indices(shape: Shape) -> Vec<u16> {
    let b = shape.block_cells();
    let vertex = |i: i32, j: i32| u16::try_from(j * PATTERN_COLUMNS + i).unwrap_or(0);
    let mut out = Vec::new();
    let mut west = 0;
    while west <= b {
        let east = (west + STRIPE_CELLS).min(b + 1);
        for j in 0..b {
            for i in west..east {
                let (sw, se) = (vertex(i, j), vertex(i + 1, j));
                let (nw, ne) = (vertex(i, j + 1), vertex(i + 1, j + 1));
                if (i + j) % 2 == 0 {
                    out.extend([sw, se, ne, sw, ne, nw]);
                } else {
                    out.extend([sw, se, nw, se, ne, nw]);
                }
            }
        }
        west = east;
    }
    out
}

/// The corner of a block that a vertex of the pattern stands for, in cells from the window's origin, as the shader
/// computes it: shifted by the block's parity, collapsed onto its edge, and, on the outer edge of the `w` cells drawn, moved
/// to the even post that the next level has too.
#[must_use]
pub fn vertex_cell(w: i32, block: Block, number: u16) -> (i32, i32) {
    let [west, east, south, north] =
        [block.west, block.east, block.south, block.north].map(i32::from);
    let [i, j] = [number % 32, number / 32].map(i32::from);
    let odd = (west + south) & 1;
    let x = (i + west - odd).clamp(west, east);
    let y = (j + south).min(north);
    let edge = |v: i32| v == 0 || v == w;
    (
        if edge(y) { x & !1 } else { x },
        if edge(x) { y & !1 } else { y },
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::terrain::clipmap::{Extent, Morph, Window, hole, reach_max, reach_under};
    use proptest::prelude::*;
    use std::collections::HashMap;

    fn shapes() -> impl Strategy<Value = Shape> {
        prop_oneof![
            Just(63),
            Just(127),
            Just(191),
            Just(255),
            Just(319),
            Just(447)
        ]
        .prop_map(|n| Shape::new(n).expect("a legal shape"))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn a_ring_covers_every_cell_outside_its_hole_once(
            shape in shapes(), x in -3e5..3e5_f64, y in -1e5..1e5_f64, south in 0..60_i32, north in 0..60_i32,
            share in 0.0..1.0_f64,
        ) {
            let on = |scale: f64, reach: f64| {
                let window = Window::around(shape, x / scale, y / scale, None);
                Extent::around(shape, window, reach, (x / scale, y / scale))
            };
            let reach = share * reach_max(shape);
            let (fine, _) = on(1.0, reach);
            let under = reach_under(shape, reach);
            let (coarse, around) = on(2.0, under);
            let hole = hole(coarse, &Morph::new(shape, coarse, around, under), fine).expect("they nest");
            let w = coarse.cells;
            let rows = (south, w - north);
            let mut blocks = Blocks::new();
            for hole in [None, Some(hole)] {
                prop_assert!(ring(shape, w, hole, rows, &mut blocks));
                let mut count = HashMap::new();
                for b in &blocks {
                    prop_assert!(b.width() <= shape.block_cells());
                    prop_assert!(b.height() <= shape.block_cells());
                    for cy in b.south..b.north {
                        for cx in b.west..b.east {
                            *count.entry((i32::from(cx), i32::from(cy))).or_insert(0) += 1;
                        }
                    }
                }
                for cy in 0..w {
                    for cx in 0..w {
                        let in_hole = hole.is_some_and(|h| {
                            (h.x0..h.x1).contains(&cx) && (h.y0..h.y1).contains(&cy)
                        });
                        let wanted = i32::from(!in_hole && (rows.0..rows.1).contains(&cy));
                        prop_assert_eq!(count.get(&(cx, cy)).copied().unwrap_or(0), wanted, "{} {}", cx, cy);
                    }
                }
            }
        }
    }

    /// Twice the signed area, positive when counter-clockwise.
    fn area2(t: [(i32, i32); 3]) -> i32 {
        (t[1].0 - t[0].0) * (t[2].1 - t[0].1) - (t[2].0 - t[0].0) * (t[1].1 - t[0].1)
    }

    #[test]
    fn the_triangles_of_a_window_tile_it_without_overlap_or_gap() {
        for n in [63, 127, 255, 447] {
            let shape = Shape::new(n).expect("a legal shape");
            let indices = pattern_indices(shape);
            let mut blocks = Blocks::new();
            let w = shape.cells();
            assert!(ring(shape, w, None, (0, w), &mut blocks), "room");
            let mut area = 0;
            // Every edge inside must be used once in each direction; on the outline only even posts are left.
            let mut edges: HashMap<[(i32, i32); 2], i32> = HashMap::new();
            for &block in &blocks {
                for t in indices.chunks_exact(3) {
                    let t = [t[0], t[1], t[2]].map(|v| vertex_cell(w, block, v));
                    let a = area2(t);
                    assert!(a >= 0, "counter-clockwise: {t:?}");
                    area += a;
                    if t[0] == t[1] || t[1] == t[2] || t[2] == t[0] {
                        continue;
                    }
                    for k in 0..3 {
                        *edges.entry([t[k], t[(k + 1) % 3]]).or_insert(0) += 1;
                    }
                }
            }
            assert_eq!(area, 2 * shape.cells() * shape.cells(), "the whole window");
            let outline = |p: (i32, i32)| {
                p.0 == 0 || p.1 == 0 || p.0 == shape.cells() || p.1 == shape.cells()
            };
            for (&[a, b], &times) in &edges {
                assert_eq!(times, 1, "edge {a:?} {b:?}");
                if !edges.contains_key(&[b, a]) {
                    assert!(outline(a) && outline(b), "open edge {a:?} {b:?}");
                    assert_eq!(
                        (a.0 % 2, a.1 % 2, b.0 % 2, b.1 % 2),
                        (0, 0, 0, 0),
                        "even posts"
                    );
                }
            }
        }
    }

    #[test]
    fn the_pattern_of_the_largest_shape_has_room_in_its_rows() {
        let shape = Shape::new(447).expect("a legal shape");
        assert!(shape.block_cells() + 2 <= PATTERN_COLUMNS, "32 columns");
    }

    #[test]
    fn a_diagonal_depends_on_the_cell_and_not_on_its_block() {
        let shape = Shape::new(127).expect("a legal shape");
        let (indices, w) = (pattern_indices(shape), shape.cells());
        for (x, y) in [(20, 20), (21, 20), (20, 21), (21, 21)] {
            let block = Block::of(CellRect {
                x0: x,
                y0: y,
                x1: x + 9,
                y1: y + 17,
            });
            for t in indices.chunks_exact(3) {
                let t = [t[0], t[1], t[2]].map(|v| vertex_cell(w, block, v));
                if area2(t) == 0 {
                    continue;
                }
                let cell = (
                    t.iter().map(|p| p.0).min().expect("three"),
                    t.iter().map(|p| p.1).min().expect("three"),
                );
                let north_east = t.contains(&cell) && t.contains(&(cell.0 + 1, cell.1 + 1));
                assert_eq!(north_east, (cell.0 + cell.1) % 2 == 0, "{t:?} in {block:?}");
            }
        }
    }
}
