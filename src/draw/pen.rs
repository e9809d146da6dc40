//! The list, the atlas and the layout together, with the two things drawn everywhere: text, and symbols with a dark rim.

use super::atlas::{Atlas, Face};
use super::layout::Layout;
use super::list::{DrawList, Rect};
use crate::display::colour::{self, Colour};
use glam::Vec2;

/// Which part of a rimmed symbol is drawn: all rims come before all bodies, so that no rim darkens a neighbour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pass {
    Rim,
    Body,
}

impl Pass {
    pub(super) const BOTH: [Self; 2] = [Self::Rim, Self::Body];

    /// The colour of this pass for a body of `colour`.
    pub(super) fn colour(self, body: Colour) -> Colour {
        match self {
            Self::Rim => colour::HALO.faded(f32::from(body.0[3]) / 255.0),
            Self::Body => body,
        }
    }
}

/// Which point of a line of text is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Align {
    Left,
    Centre,
    Right,
}

/// How text looks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Style {
    pub(super) face: Face,
    /// Height of capitals in design units.
    pub(super) cap: f32,
    pub(super) colour: Colour,
}

/// Numbers.
pub(super) const fn bold(cap: f32, colour: Colour) -> Style {
    Style {
        face: Face::Bold,
        cap,
        colour,
    }
}

/// Names and units.
pub(super) const fn regular(cap: f32, colour: Colour) -> Style {
    Style {
        face: Face::Regular,
        cap,
        colour,
    }
}

/// Capitals are never smaller than this many pixels.
const CAP_PX_MIN: f32 = 7.0;

pub(super) struct Pen<'a> {
    pub(super) list: &'a mut DrawList,
    pub(super) layout: &'a Layout,
    atlas: &'a Atlas,
}

impl<'a> Pen<'a> {
    pub(super) const fn new(list: &'a mut DrawList, atlas: &'a Atlas, layout: &'a Layout) -> Self {
        Self {
            list,
            layout,
            atlas,
        }
    }

    pub(super) fn px(&self, x: f32) -> f32 {
        self.layout.px(x)
    }

    /// Half the difference of a symbol's width with its rim and without, in pixels.
    fn rim(&self) -> f32 {
        self.layout.line(1.4)
    }

    /// Height of capitals in whole pixels, so that their upper and lower edges can both be sharp.
    pub(super) fn cap_px(&self, style: Style) -> f32 {
        self.px(style.cap).round().max(CAP_PX_MIN)
    }

    fn em_px(&self, style: Style) -> f32 {
        self.cap_px(style) / self.atlas.cap_height(style.face)
    }

    /// Width of a line of text in pixels.
    pub(super) fn width(&self, text: &str, style: Style) -> f32 {
        self.atlas.width(style.face, text) * self.em_px(style)
    }

    /// Text whose capitals are centred on `at.y`, standing still: its edges are put on whole pixels.
    pub(super) fn text(&mut self, text: &str, at: Vec2, align: Align, style: Style) {
        let cap = self.cap_px(style);
        let x = at.x - aligned(self.width(text, style), align);
        let baseline = (at.y + cap * 0.5).round();
        self.glyphs(text, Vec2::new(x.round(), baseline), Vec2::X, style, 0.0);
    }

    /// Text whose capitals are centred on `at.y`, which moves smoothly.
    pub(super) fn moving_text(&mut self, text: &str, at: Vec2, align: Align, style: Style) {
        self.turned_text(text, at, align, Vec2::X, style, None);
    }

    /// The style of a label that slides in over an edge: it appears once it is `room` pixels clear of it, so that no
    /// figure is ever seen cut in half.
    pub(super) fn entering(&self, style: Style, room: f32) -> Style {
        let colour = style.colour.faded(room / self.px(5.0));
        Style { colour, ..style }
    }

    /// Text centred on `at` across and along, its line in the direction `along`, with a rim when `pass` says so.
    pub(super) fn turned_text(
        &mut self,
        text: &str,
        at: Vec2,
        align: Align,
        along: Vec2,
        style: Style,
        pass: Option<Pass>,
    ) {
        let back = aligned(self.width(text, style), align);
        let origin = at - along * back + along.perp() * (self.cap_px(style) * 0.5);
        let (colour, fatten) = match pass {
            Some(pass @ Pass::Rim) => (pass.colour(style.colour), self.rim()),
            Some(Pass::Body) | None => (style.colour, 0.0),
        };
        self.glyphs(text, origin, along, Style { colour, ..style }, fatten);
    }

    fn glyphs(&mut self, text: &str, origin: Vec2, along: Vec2, style: Style, fatten: f32) {
        if style.colour.0[3] == 0 {
            return;
        }
        let em = self.em_px(style);
        let scale = Atlas::field_scale(em);
        // Beyond the spread of the field there is nothing to fatten.
        let fatten = fatten.min(scale * 0.5 - 0.75);
        let down = along.perp();
        let mut pen = origin;
        for character in text.chars() {
            let glyph = self.atlas.glyph(style.face, character);
            if glyph.size.x > 0.0 {
                let place = |x: f32, y: f32| pen + along * (x * em) + down * (y * em);
                let (near, far) = (glyph.offset, glyph.offset + glyph.size);
                let corners = [
                    place(near.x, near.y),
                    place(far.x, near.y),
                    place(far.x, far.y),
                    place(near.x, far.y),
                ];
                self.list.glyph(
                    corners,
                    glyph.texture,
                    scale,
                    fatten,
                    style.colour,
                    character,
                );
            }
            pen += along * (glyph.advance * em);
        }
    }

    /// A line of a rimmed symbol; `width` in pixels.
    pub(super) fn stroke(&mut self, pass: Pass, from: Vec2, to: Vec2, width: f32, body: Colour) {
        let rim = self.rim();
        match pass {
            Pass::Rim => {
                let along = (to - from).normalize_or_zero() * rim;
                let width = width + 2.0 * rim;
                self.list
                    .line(from - along, to + along, width, pass.colour(body));
            }
            Pass::Body => self.list.line(from, to, width, body),
        }
    }

    /// A triangle of a rimmed symbol.
    pub(super) fn triangle(&mut self, pass: Pass, corners: [Vec2; 3], body: Colour) {
        if pass == Pass::Body {
            self.list.triangle(corners, body);
            return;
        }
        let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
        let rim = self.rim() * 2.0;
        let grown = corners.map(|c| c + (c - middle).normalize_or_zero() * rim);
        self.list.triangle(grown, pass.colour(body));
    }

    /// The see-through ground of an instrument.
    pub(super) fn panel(&mut self, rect: Rect) {
        self.ground(rect, colour::PANEL);
    }

    /// The darker ground of a field with coloured figures.
    pub(super) fn field(&mut self, rect: Rect) {
        self.ground(rect, colour::FIELD);
    }

    fn ground(&mut self, rect: Rect, ink: Colour) {
        self.list.rect(rect, ink);
        let width = self.layout.line(1.0).round();
        self.list.frame(rect, width, colour::BORDER);
    }

    /// The opaque ground of a readout, with a bright border.
    pub(super) fn window(&mut self, rect: Rect) {
        let width = self.layout.line(1.5).round();
        self.list.rect(rect, colour::SCALE);
        self.list.rect(rect.grown(-width), colour::WINDOW);
    }
}

fn aligned(width: f32, align: Align) -> f32 {
    match align {
        Align::Left => 0.0,
        Align::Centre => width * 0.5,
        Align::Right => width,
    }
}

/// A number of the model as a pixel measure. Precision beyond 24 bits is of no use on a panel.
pub(super) fn px(x: f64) -> f32 {
    #[expect(clippy::cast_possible_truncation, reason = "pixels need no 53 bits")]
    {
        x as f32
    }
}
