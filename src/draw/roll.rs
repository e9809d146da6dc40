//! The roll scale, which turns with the horizon, its fixed pointer, and the slip ball under the pointer.

use super::flags;
use super::horizon::Projection;
use super::list::Rect;
use super::pen::{Pass, Pen, px};
use crate::display::colour;
use crate::display::{Model, Slip};
use glam::Vec2;

/// The ball stops this many widths from the middle, at the end of its way.
const BALL_WIDTHS_MAX: f64 = 2.5;

/// Draws the scale if there is an attitude, and the slip ball or its flag.
pub(super) fn draw(pen: &mut Pen<'_>, model: &Model) {
    if let Ok(attitude) = model.attitude {
        let projection = Projection::new(pen, model.hfov, attitude);
        for pass in Pass::BOTH {
            draw_scale(pen, &projection, px(attitude.roll.0), pass);
            draw_pointer(pen, pass);
        }
    }
    match model.slip {
        Ok(slip) => {
            for pass in Pass::BOTH {
                draw_slip(pen, slip, pass);
            }
        }
        Err(reason) => {
            let place = pen.layout.slip_flag;
            flags::cover_line(pen, place, "SLIP", reason);
        }
    }
}

/// An arc from 60 degrees left to 60 degrees right with marks at 10, 20, 30, 45 and 60, and a triangle at zero.
fn draw_scale(pen: &mut Pen<'_>, p: &Projection, roll: f32, pass: Pass) {
    let (centre, radius) = (pen.layout.centre, pen.layout.roll_radius);
    let ink = colour::SCALE;
    let width = pen.layout.line(2.0);
    let sixty = 60f32.to_radians();
    let rim = if pass == Pass::Rim {
        2.0 * pen.layout.line(1.4)
    } else {
        0.0
    };
    pen.list.arc(
        centre,
        radius,
        width + rim,
        -sixty - roll,
        2.0 * sixty,
        pass.colour(ink),
    );
    let toward = |angle: f32| {
        let (s, c) = angle.to_radians().sin_cos();
        p.right * s + p.up * c
    };
    for angle in [10.0_f32, 20.0, 30.0, 45.0, 60.0] {
        let long = if angle >= 30.0 && angle < 45.0 || angle > 45.0 {
            16.0
        } else {
            9.0
        };
        for direction in [toward(-angle), toward(angle)] {
            let from = centre + direction * (radius - width * 0.5);
            let to = centre + direction * (radius + pen.px(long));
            pen.stroke(pass, from, to, width, ink);
        }
    }
    let tip = centre + p.up * (radius + pen.px(1.0));
    let back = p.up * pen.px(15.0);
    let side = p.right * pen.px(9.0);
    pen.triangle(pass, [tip, tip + back + side, tip + back - side], ink);
}

/// The tip of the fixed pointer, just inside the arc.
fn pointer_tip(pen: &Pen<'_>) -> Vec2 {
    pen.layout.centre - Vec2::Y * (pen.layout.roll_radius - pen.px(4.0))
}

fn draw_pointer(pen: &mut Pen<'_>, pass: Pass) {
    let tip = pointer_tip(pen);
    let (down, side) = (Vec2::Y * pen.px(15.0), Vec2::X * pen.px(9.0));
    pen.triangle(
        pass,
        [tip, tip + down + side, tip + down - side],
        colour::SCALE,
    );
}

/// The ball is the foot of the pointer, as on the panels of light aircraft: centred under it when nothing slips.
fn draw_slip(pen: &mut Pen<'_>, slip: Slip, pass: Pass) {
    let ball = pen.px(24.0);
    let widths = slip.ball_widths.clamp(-BALL_WIDTHS_MAX, BALL_WIDTHS_MAX);
    let tip = pointer_tip(pen);
    let centre = tip + Vec2::new(px(widths) * ball, pen.px(23.0));
    let foot = Rect::around(centre, ball, pen.px(7.0));
    match pass {
        Pass::Rim => pen
            .list
            .rect(foot.grown(pen.px(1.6)), pass.colour(colour::SCALE)),
        Pass::Body => pen.list.rect(foot, colour::SCALE),
    }
}
