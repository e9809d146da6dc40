//! Other aircraft: a short list beside the attitude, and symbols where they would be seen.

use super::fields::arrow;
use super::list::Rect;
use super::pen::{Align, Pass, Pen, bold, px, regular};
use crate::display::colour::{self, Colour};
use crate::display::traffic::{CONTACTS_MAX, Contact, Sight, Traffic, Trend, Urgency};
use crate::display::{Model, PitchRoll, format};
use crate::geo::Attitude;
use crate::units::Radians;
use glam::{DVec3, Vec2};

/// Farther off the axis than this nothing is drawn: it is far outside of any picture.
const FORWARD_MIN: f64 = 0.1;

const fn ink(urgency: Urgency) -> Colour {
    match urgency {
        Urgency::Other | Urgency::Proximate => colour::SCALE,
        Urgency::Caution => colour::CAUTION,
        Urgency::Warning => colour::WARNING,
    }
}

/// The list, or that there is no data for it; nothing where nobody would tell.
pub(super) fn draw_list(pen: &mut Pen<'_>, model: &Model) {
    let place = pen.layout.traffic;
    #[expect(clippy::cast_precision_loss, reason = "a handful")]
    let row_height = place.height() / (CONTACTS_MAX + 1) as f32;
    let row = |k: u8| {
        let y = place.min.y + row_height * f32::from(k);
        Rect::new(place.min.x, y, place.width(), row_height).snapped()
    };
    let title = row(0);
    let list = match &model.traffic {
        Traffic::Nobody => return,
        Traffic::NoData => {
            pen.field(title);
            let style = bold(9.5, colour::CAUTION);
            pen.text("NO TRAFFIC DATA", title.centre(), Align::Centre, style);
            return;
        }
        Traffic::Contacts { list, .. } => list,
    };
    pen.field(title);
    let label = regular(9.5, colour::LABEL);
    let at = |rect: Rect, x: f32, pen: &Pen<'_>| Vec2::new(rect.min.x + pen.px(x), rect.centre().y);
    if list.is_empty() {
        pen.text("TRAFFIC", at(title, 7.0, pen), Align::Left, label);
        pen.text("NONE", at(title, 121.0, pen), Align::Right, label);
        return;
    }
    pen.text("TFC", at(title, 6.0, pen), Align::Left, label);
    pen.text("NM", at(title, 72.0, pen), Align::Right, label);
    pen.text("100FT", at(title, 121.0, pen), Align::Right, label);
    for (contact, k) in list.iter().zip(1..) {
        let rect = row(k);
        pen.field(rect);
        let ink = ink(contact.urgency);
        for pass in Pass::BOTH {
            symbol(pen, at(rect, 13.0, pen), contact.urgency, 5.0, pass);
        }
        if let Some(bearing) = contact.bearing {
            let (sin, cos) = bearing.0.sin_cos();
            let along = Vec2::new(px(sin), px(-cos));
            arrow(pen, at(rect, 33.0, pen), along, 8.5, ink);
        }
        let style = bold(11.0, ink);
        let distance = format::nautical_miles(contact.distance_nm);
        pen.text(&distance, at(rect, 72.0, pen), Align::Right, style);
        match contact.above {
            Some(above) => {
                let above = format::hundreds_above(above);
                pen.text(&above, at(rect, 109.0, pen), Align::Right, style);
                for pass in Pass::BOTH {
                    trend(pen, at(rect, 118.0, pen), contact, pass);
                }
            }
            None => pen.text("- -", at(rect, 109.0, pen), Align::Right, style),
        }
    }
}

/// Symbols in the view, the least urgent first, so that the others lie over them.
pub(super) fn draw_sights(pen: &mut Pen<'_>, model: &Model) {
    let (Ok(attitude), Traffic::Contacts { sights, .. }) = (model.attitude, &model.traffic) else {
        return;
    };
    for pass in Pass::BOTH {
        for sight in sights.iter().rev() {
            if let Some(at) = seen_at(pen, model.hfov, attitude, sight) {
                symbol(pen, at, sight.contact.urgency, 7.0, pass);
                draw_height(pen, at, &sight.contact, pass);
            }
        }
    }
}

/// Where the camera of the picture sees it, in pixels; `None` where it does not.
fn seen_at(pen: &Pen<'_>, hfov: Radians, attitude: PitchRoll, sight: &Sight) -> Option<Vec2> {
    let (up, level) = sight.elevation.0.sin_cos();
    let (right, ahead) = sight.azimuth.0.sin_cos();
    let nose = Attitude {
        heading_true: Radians(0.0),
        pitch: attitude.pitch,
        roll: attitude.roll,
    };
    let body = nose.body_to_ned().transpose() * DVec3::new(level * ahead, level * right, -up);
    if body.x < FORWARD_MIN {
        return None;
    }
    let focal = f64::from(pen.layout.size.x) * 0.5 / (hfov.0 * 0.5).tan();
    let off = Vec2::new(px(body.y / body.x * focal), px(body.z / body.x * focal));
    let at = pen.layout.centre + off;
    let inside = at.cmpge(Vec2::ZERO).all() && at.cmple(pen.layout.size).all();
    inside.then_some(at)
}

/// Relative altitude over or under the symbol, on the side on which the aircraft is, with its trend.
fn draw_height(pen: &mut Pen<'_>, at: Vec2, contact: &Contact, pass: Pass) {
    let Some(above) = contact.above else {
        return;
    };
    let text = format::hundreds_above(above);
    let style = bold(11.0, ink(contact.urgency));
    let side = if above.0 < 0.0 { 1.0 } else { -1.0 };
    let place = at + Vec2::Y * (side * pen.px(18.0));
    pen.turned_text(&text, place, Align::Centre, Vec2::X, style, Some(pass));
    let beside = place + Vec2::X * (pen.width(&text, style) * 0.5 + pen.px(8.0));
    trend(pen, beside, contact, pass);
}

/// A diamond, open or filled; a disc; a square.
fn symbol(pen: &mut Pen<'_>, at: Vec2, urgency: Urgency, half: f32, pass: Pass) {
    let body = ink(urgency);
    let colour = pass.colour(body);
    let rim = if pass == Pass::Rim {
        pen.layout.line(1.4)
    } else {
        0.0
    };
    let half = pen.px(half);
    let diamond = |half: f32| [Vec2::NEG_Y, Vec2::X, Vec2::Y, Vec2::NEG_X].map(|d| at + d * half);
    match urgency {
        Urgency::Warning => pen.list.rect(
            Rect::around(at, 2.0 * (half + rim), 2.0 * (half + rim)),
            colour,
        ),
        Urgency::Caution => {
            // A ring, whose hole a square fills.
            let (full, hole) = (half + rim, half * 0.3);
            let (middle, width) = (f32::midpoint(full, hole), full - hole);
            let turn = std::f32::consts::TAU;
            pen.list.arc(at, middle, width, 0.0, turn, colour);
            if pass == Pass::Body {
                pen.list
                    .rect(Rect::around(at, 2.2 * hole, 2.2 * hole), colour);
            }
        }
        Urgency::Proximate => {
            let corners = diamond((half + rim) * 1.3);
            pen.list.polygon(corners, [true; 4], [colour; 4]);
        }
        Urgency::Other => {
            let corners = diamond(half * 1.2);
            let width = pen.layout.line(1.6);
            for (i, &from) in corners.iter().enumerate() {
                pen.stroke(pass, from, corners[(i + 1) % 4], width, body);
            }
        }
    }
}

/// An arrow up or down beside a relative altitude.
fn trend(pen: &mut Pen<'_>, at: Vec2, contact: &Contact, pass: Pass) {
    let along = match contact.trend {
        Trend::Climbing => Vec2::NEG_Y,
        Trend::Descending => Vec2::Y,
        Trend::Level => return,
    };
    let body = ink(contact.urgency);
    let (reach, side) = (along * pen.px(5.5), Vec2::X * pen.px(3.6));
    pen.stroke(pass, at - reach, at, pen.layout.line(1.6), body);
    pen.triangle(pass, [at + reach, at + side, at - side], body);
}
