//! Angles on the circle: wrapping and the shortest turn.

use crate::units::Radians;
use std::f64::consts::{PI, TAU};

/// Wraps to `-pi <= a < pi`. NaN and infinities come back as NaN.
#[must_use]
pub fn wrap_signed(a: Radians) -> Radians {
    let w = (a.0 + PI).rem_euclid(TAU) - PI;
    // rem_euclid may round up to TAU for tiny negative input.
    Radians(if w >= PI { -PI } else { w })
}

/// Wraps to `0 <= a < 2 pi`, the range of a heading or a track. NaN and infinities come back as NaN.
#[must_use]
pub fn wrap_turn(a: Radians) -> Radians {
    let w = a.0.rem_euclid(TAU);
    Radians(if w >= TAU { 0.0 } else { w })
}

/// The shortest turn from `from` to `to`, right (clockwise) positive, `-pi <= turn < pi`.
#[must_use]
pub fn shortest_turn(from: Radians, to: Radians) -> Radians {
    wrap_signed(to - from)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn degrees(x: f64) -> Radians {
        Radians::from_degrees(x)
    }

    #[test]
    fn wrapping_keeps_the_direction() {
        for (given, signed, turn) in [
            (0.0, 0.0, 0.0),
            (190.0, -170.0, 190.0),
            (-190.0, 170.0, 170.0),
            (720.5, 0.5, 0.5),
        ] {
            assert!(
                (wrap_signed(degrees(given)).to_degrees() - signed).abs() < 1e-9,
                "signed {given}"
            );
            assert!(
                (wrap_turn(degrees(given)).to_degrees() - turn).abs() < 1e-9,
                "turn {given}"
            );
        }
    }

    #[test]
    fn ends_of_the_ranges_are_half_open() {
        assert!(wrap_signed(Radians(PI)).0 < PI, "pi wraps to -pi");
        assert!(
            wrap_turn(Radians(-1e-30)).0 < TAU,
            "a tiny negative angle does not become a full turn"
        );
    }

    #[test]
    fn the_shortest_turn_crosses_north() {
        assert!(
            (shortest_turn(degrees(350.0), degrees(10.0)).to_degrees() - 20.0).abs() < 1e-9,
            "right through north"
        );
        assert!(
            (shortest_turn(degrees(10.0), degrees(350.0)).to_degrees() + 20.0).abs() < 1e-9,
            "left through north"
        );
    }
}
