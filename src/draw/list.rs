//! What is to be drawn, in order, as plain data: convex polygons and glyphs, all of them quads of one vertex format, so
//! that one draw call shows the whole display.
//!
//! Edges are smooth without multisampling: each vertex carries its signed distances to the four edges of its polygon.
//! Distance to a straight edge is linear over the plane, so interpolation is exact, and the fragment shader turns it
//! into coverage. The capacity is fixed; what does not fit is left out and counted.

use crate::display::colour::Colour;
use glam::Vec2;

/// Quads in a list. The fullest display, all of whose fields are framed by dashes, takes about 800, with an engine and other aircraft 1100; 16 384 is the most that
/// 16-bit indices can address.
pub const QUADS_MAX: usize = 2048;

/// A distance that means "no edge here": larger than any panel.
const NO_EDGE: f32 = 1.0e4;

/// How far a polygon is widened so that the pixels cut by its edges are drawn, in pixels.
const FRINGE: f32 = 1.0;

/// One corner of a quad, as the vector shader reads it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Vertex {
    /// Pixels from the upper left corner of the picture, y down.
    pub position: [f32; 2],
    /// Solid: signed distances to the four edges in pixels, inside positive. Glyph: texture coordinates (0 to 1), pixels
    /// per unit of the distance field, and pixels by which the glyph is fattened.
    pub edges: [f32; 4],
    /// The rectangle outside of which nothing is drawn: left, top, right, bottom in pixels.
    pub clip: [i16; 4],
    /// Red, green, blue, opacity, 0 to 255; opacity not multiplied in.
    pub colour: [u8; 4],
    /// 0: solid; else the character of a glyph.
    pub glyph: u32,
}

const _: () = assert!(
    size_of::<Vertex>() == 40,
    "the layout that gl::vector declares"
);

/// A rectangle in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rect {
    /// Upper left corner.
    pub min: Vec2,
    /// Lower right corner.
    pub max: Vec2,
}

impl Rect {
    /// From its upper left corner and size.
    #[must_use]
    pub fn new(x: f32, y: f32, width: f32, height: f32) -> Self {
        Self {
            min: Vec2::new(x, y),
            max: Vec2::new(x + width, y + height),
        }
    }

    /// Around `centre`.
    #[must_use]
    pub fn around(centre: Vec2, width: f32, height: f32) -> Self {
        let half = Vec2::new(width, height) * 0.5;
        Self {
            min: centre - half,
            max: centre + half,
        }
    }

    /// With every edge moved outwards by `by` (inwards where negative).
    #[must_use]
    pub fn grown(self, by: f32) -> Self {
        Self {
            min: self.min - by,
            max: self.max + by,
        }
    }

    /// Its middle.
    #[must_use]
    pub fn centre(self) -> Vec2 {
        (self.min + self.max) * 0.5
    }

    /// Width.
    #[must_use]
    pub fn width(self) -> f32 {
        self.max.x - self.min.x
    }

    /// Height.
    #[must_use]
    pub fn height(self) -> f32 {
        self.max.y - self.min.y
    }

    /// With its edges on whole pixels.
    #[must_use]
    pub fn snapped(self) -> Self {
        Self {
            min: self.min.round(),
            max: self.max.round(),
        }
    }
}

/// The list.
pub struct DrawList {
    vertices: Box<[Vertex]>,
    quads: usize,
    left_out: u32,
    clip: [i16; 4],
}

impl std::fmt::Debug for DrawList {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("DrawList")
            .field("quads", &self.quads)
            .field("left_out", &self.left_out)
            .finish_non_exhaustive()
    }
}

impl Default for DrawList {
    fn default() -> Self {
        Self::new()
    }
}

const NO_CLIP: [i16; 4] = [i16::MIN, i16::MIN, i16::MAX, i16::MAX];

impl DrawList {
    /// An empty list with all of its memory.
    #[must_use]
    pub fn new() -> Self {
        Self {
            vertices: vec![Vertex::default(); QUADS_MAX * 4].into_boxed_slice(),
            quads: 0,
            left_out: 0,
            clip: NO_CLIP,
        }
    }

    /// Empties it.
    pub fn clear(&mut self) {
        self.quads = 0;
        self.left_out = 0;
        self.clip = NO_CLIP;
    }

    /// Quads that did not fit since [`Self::clear`]; anything but 0 is a defect.
    #[must_use]
    pub const fn left_out(&self) -> u32 {
        self.left_out
    }

    /// Quads in it.
    #[must_use]
    pub const fn quads(&self) -> usize {
        self.quads
    }

    /// The corners, four per quad, in drawing order.
    #[must_use]
    pub fn vertices(&self) -> &[Vertex] {
        &self.vertices[..self.quads * 4]
    }

    /// The characters drawn, in drawing order (halos count as well).
    pub fn characters(&self) -> impl Iterator<Item = char> + '_ {
        self.vertices()
            .iter()
            .step_by(4)
            .filter_map(|v| char::from_u32(v.glyph).filter(|_| v.glyph != 0))
    }

    /// From here on draws only inside `rect`, whose edges fall on whole pixels; `None`: everywhere.
    pub fn clip(&mut self, rect: Option<Rect>) {
        self.clip = rect.map_or(NO_CLIP, |r| {
            [r.min.x, r.min.y, r.max.x, r.max.y].map(whole_pixels)
        });
    }

    /// Takes a quad whose corners stand around it, unless it lies wholly outside of the clip rectangle.
    fn push(&mut self, corners: [Vertex; 4]) {
        let [left, top, right, bottom] = self.clip.map(f32::from);
        let outside = |axis: usize, low: f32, high: f32| {
            corners.iter().all(|c| c.position[axis] <= low)
                || corners.iter().all(|c| c.position[axis] >= high)
        };
        if outside(0, left, right) || outside(1, top, bottom) {
            return;
        }
        let start = self.quads * 4;
        let Some(room) = self.vertices.get_mut(start..start + 4) else {
            self.left_out = self.left_out.saturating_add(1);
            return;
        };
        room.copy_from_slice(&corners);
        self.quads += 1;
    }

    /// A convex quadrilateral with corners in order (either way round) and a colour each. `smooth[i]` says whether the
    /// edge from corner i to the next is anti-aliased; one that is not is shared with a neighbour that fits exactly.
    pub fn polygon(&mut self, corners: [Vec2; 4], smooth: [bool; 4], colours: [Colour; 4]) {
        let area = (corners[2] - corners[0]).perp_dot(corners[3] - corners[1]);
        if !area.is_finite() || area.abs() < 1.0e-6 {
            return;
        }
        let edges = std::array::from_fn(|i| Edge::new(corners[i], corners[(i + 1) % 4], area));
        self.convex(edges, smooth, colours);
    }

    /// A triangle.
    pub fn triangle(&mut self, corners: [Vec2; 3], colour: Colour) {
        let [a, b, c] = corners;
        let area = (b - a).perp_dot(c - a);
        if !area.is_finite() || area.abs() < 1.0e-6 {
            return;
        }
        // As a quad whose fourth edge bites nothing: parallel to the first, beyond the corner opposite to it.
        let base = Edge::new(a, b, area);
        let beyond = Edge {
            normal: -base.normal,
            offset: -(base.normal.dot(c) + FRINGE),
        };
        let edges = [base, Edge::new(b, c, area), beyond, Edge::new(c, a, area)];
        self.convex(edges, [true, true, false, true], [colour; 4]);
    }

    fn convex(&mut self, edges: [Edge; 4], smooth: [bool; 4], colours: [Colour; 4]) {
        let moved: [Edge; 4] = std::array::from_fn(|i| edges[i].widened(smooth[i]));
        let clip = self.clip;
        let corners: [Option<Vertex>; 4] = std::array::from_fn(|i| {
            // Corner i lies between the edges i - 1 and i.
            let position = moved[(i + 3) % 4].meets(moved[i])?;
            let distance = |k: usize| {
                if smooth[k] {
                    edges[k].distance(position)
                } else {
                    NO_EDGE
                }
            };
            Some(Vertex {
                position: position.to_array(),
                edges: [distance(0), distance(1), distance(2), distance(3)],
                clip,
                colour: colours[i].0,
                glyph: 0,
            })
        });
        if let [Some(a), Some(b), Some(c), Some(d)] = corners {
            self.push([a, b, c, d]);
        }
    }

    /// A filled rectangle.
    pub fn rect(&mut self, rect: Rect, colour: Colour) {
        self.gradient(rect, colour, colour);
    }

    /// A filled rectangle, from one colour at its top to another at its bottom.
    pub fn gradient(&mut self, rect: Rect, top: Colour, bottom: Colour) {
        let Rect { min, max } = rect;
        self.polygon(
            [min, Vec2::new(max.x, min.y), max, Vec2::new(min.x, max.y)],
            [true; 4],
            [top, top, bottom, bottom],
        );
    }

    /// The border of a rectangle, `width` wide, inside of it.
    pub fn frame(&mut self, rect: Rect, width: f32, colour: Colour) {
        let Rect { min, max } = rect;
        let (w, h) = (rect.width(), rect.height());
        self.rect(Rect::new(min.x, min.y, w, width), colour);
        self.rect(Rect::new(min.x, max.y - width, w, width), colour);
        let inner = h - 2.0 * width;
        self.rect(Rect::new(min.x, min.y + width, width, inner), colour);
        self.rect(
            Rect::new(max.x - width, min.y + width, width, inner),
            colour,
        );
    }

    /// A straight line with square ends at its end points.
    pub fn line(&mut self, from: Vec2, to: Vec2, width: f32, colour: Colour) {
        let Some(along) = (to - from).try_normalize() else {
            return;
        };
        let side = along.perp() * (width * 0.5);
        self.polygon(
            [from + side, to + side, to - side, from - side],
            [true; 4],
            [colour; 4],
        );
    }

    /// An arc around `centre`, `width` wide, from the direction `start` over the angle `sweep`, both in radians
    /// clockwise from straight up.
    pub fn arc(
        &mut self,
        centre: Vec2,
        radius: f32,
        width: f32,
        start: f32,
        sweep: f32,
        colour: Colour,
    ) {
        const STEPS: u8 = 32;
        let at = |k: u8| {
            let (s, c) = (start + sweep * f32::from(k) / f32::from(STEPS)).sin_cos();
            Vec2::new(s, -c)
        };
        for k in 0..STEPS {
            let (a, b) = (at(k), at(k + 1));
            let (inner, outer) = (radius - width * 0.5, radius + width * 0.5);
            self.polygon(
                [
                    centre + a * inner,
                    centre + a * outer,
                    centre + b * outer,
                    centre + b * inner,
                ],
                [k == 0, true, k + 1 == STEPS, true],
                [colour; 4],
            );
        }
    }

    /// A glyph: `corners` in pixels from its upper left, clockwise; `texture` its left, top, right and bottom in the
    /// atlas, 0 to 1; `scale` pixels per unit of the distance field; `fatten` pixels by which it grows on all sides.
    pub fn glyph(
        &mut self,
        corners: [Vec2; 4],
        texture: [f32; 4],
        scale: f32,
        fatten: f32,
        colour: Colour,
        character: char,
    ) {
        let [left, top, right, bottom] = texture;
        let clip = self.clip;
        let corner = |position: Vec2, u: f32, v: f32| Vertex {
            position: position.to_array(),
            edges: [u, v, scale, fatten],
            clip,
            colour: colour.0,
            glyph: u32::from(character),
        };
        self.push([
            corner(corners[0], left, top),
            corner(corners[1], right, top),
            corner(corners[2], right, bottom),
            corner(corners[3], left, bottom),
        ]);
    }
}

/// A straight edge: the inside is where `normal . x - offset` is positive.
#[derive(Clone, Copy)]
struct Edge {
    normal: Vec2,
    offset: f32,
}

impl Edge {
    /// Through two corners of a polygon whose doubled signed area is `area`.
    fn new(from: Vec2, to: Vec2, area: f32) -> Self {
        let normal = (to - from).perp().normalize_or_zero() * area.signum();
        Self {
            normal,
            offset: normal.dot(from),
        }
    }

    fn distance(self, point: Vec2) -> f32 {
        self.normal.dot(point) - self.offset
    }

    fn widened(self, smooth: bool) -> Self {
        Self {
            offset: if smooth {
                self.offset - FRINGE
            } else {
                self.offset
            },
            ..self
        }
    }

    fn meets(self, other: Self) -> Option<Vec2> {
        let determinant = self.normal.perp_dot(other.normal);
        if determinant.abs() < 1.0e-4 {
            return None;
        }
        let (a, b) = (self.offset, other.offset);
        Some(Vec2::new(
            (a * other.normal.y - b * self.normal.y) / determinant,
            (b * self.normal.x - a * other.normal.x) / determinant,
        ))
    }
}

/// A coordinate as whole pixels; saturates.
fn whole_pixels(x: f32) -> i16 {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "`as` saturates; panels are far smaller"
    )]
    {
        x.round() as i16
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::display::colour::SCALE;

    #[test]
    fn distances_are_those_to_the_edges_and_interpolate() {
        let mut list = DrawList::new();
        list.rect(Rect::new(10.0, 20.0, 30.0, 4.0), SCALE);
        let v = list.vertices();
        assert_eq!(v.len(), 4);
        // Widened by one pixel, so each corner is 1 outside of two edges and that much inside of the others.
        let near = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5);
        assert!(near(&v[0].position, &[9.0, 19.0]), "{:?}", v[0]);
        assert!(near(&v[0].edges, &[-1.0, 31.0, 5.0, -1.0]), "{:?}", v[0]);
        assert!(near(&v[2].position, &[41.0, 25.0]), "{:?}", v[2]);
        assert!(near(&v[2].edges, &[5.0, -1.0, -1.0, 31.0]), "{:?}", v[2]);
    }

    #[test]
    fn either_way_round_is_the_same_polygon() {
        let corners = [
            Vec2::new(0.0, 0.0),
            Vec2::new(9.0, 1.0),
            Vec2::new(8.0, 7.0),
            Vec2::new(1.0, 6.0),
        ];
        let inside = |order: [usize; 4]| {
            let mut list = DrawList::new();
            list.polygon(order.map(|i| corners[i]), [true; 4], [SCALE; 4]);
            let widest = list
                .vertices()
                .iter()
                .map(|v| v.edges.iter().copied().fold(0.0, f32::max));
            widest.fold(0.0, f32::max)
        };
        assert!(
            (inside([0, 1, 2, 3]) - inside([3, 2, 1, 0])).abs() < 1e-4,
            "same distances"
        );
    }

    #[test]
    fn what_does_not_fit_is_counted() {
        let mut list = DrawList::new();
        for _ in 0..QUADS_MAX + 7 {
            list.rect(Rect::new(0.0, 0.0, 5.0, 5.0), SCALE);
        }
        assert_eq!((list.quads(), list.left_out()), (QUADS_MAX, 7));
        list.clear();
        assert_eq!((list.quads(), list.left_out()), (0, 0));
    }

    #[test]
    fn what_lies_outside_the_clip_rectangle_is_not_kept() {
        let mut list = DrawList::new();
        list.clip(Some(Rect::new(0.0, 0.0, 100.0, 100.0)));
        list.rect(Rect::new(150.0, 10.0, 20.0, 20.0), SCALE);
        assert_eq!(list.quads(), 0);
        list.rect(Rect::new(90.0, 10.0, 20.0, 20.0), SCALE);
        assert_eq!(list.quads(), 1);
    }

    #[test]
    fn shapes_without_area_are_nothing() {
        let mut list = DrawList::new();
        let p = Vec2::new(3.0, 4.0);
        list.line(p, p, 2.0, SCALE);
        list.triangle([p, p, p], SCALE);
        list.polygon([p; 4], [true; 4], [SCALE; 4]);
        list.polygon([Vec2::NAN; 4], [true; 4], [SCALE; 4]);
        assert_eq!(list.quads(), 0);
    }
}
