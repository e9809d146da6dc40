//! Following a ray through a [`Field`].

use super::{Cast, Field, Place, double, floor};
use crate::geo::{Geodetic, WGS84_B_M};
use glam::DVec3;

/// Length of a cubic piece, metres.
const PIECE_M: f64 = 12_000.0;

impl Field {
    /// What a ray from `eye` (Earth-centred, metres) in a unit direction meets.
    #[must_use]
    pub fn cast(&self, eye: DVec3, direction: DVec3) -> Cast {
        let top = f64::from(*self.maxima.last().and_then(|m| m.first()).unwrap_or(&0.0));
        let limit = double(self.side - 1);
        let place = |t: f64| self.place(&Geodetic::from_ecef(eye + direction * t));
        let mut start = 0.0;
        let mut first = place(0.0);
        loop {
            let knots = [1.0, 2.0, 3.0].map(|k| place(start + k * PIECE_M / 3.0));
            let piece = Piece {
                start,
                knots: [first, knots[0], knots[1], knots[2]],
            };
            if let Some(t) = self.halve(&piece, (0.0, first), (1.0, knots[2])) {
                return Cast::Hit(start + t * PIECE_M);
            }
            let last = knots[2];
            // Height along a straight line is convex: once it rises it goes on rising.
            let climbs = last.z > knots[1].z;
            if climbs && last.z > top.max(self.beyond_m) {
                return Cast::Sky;
            }
            let inside = (0.0..limit).contains(&last.x) && (0.0..limit).contains(&last.y);
            if !inside && last.z < self.beyond_m {
                return Cast::Left;
            }
            if !inside && climbs {
                return Cast::Sky;
            }
            start += PIECE_M;
            first = last;
        }
    }

    /// The first crossing between two points of a piece, as a share of the piece.
    fn halve(&self, piece: &Piece, a: (f64, Place), b: (f64, Place)) -> Option<f64> {
        let length = (b.0 - a.0) * PIECE_M;
        let sag = length * length / (8.0 * WGS84_B_M);
        let (low, high) = (a.1.min(b.1), a.1.max(b.1));
        // How far the curve may bulge beside its chord, in posts; 16 covers the narrowing of the grid up to 75 degrees.
        let pad = 16.0 * sag / self.spacing_m() + 1e-6;
        let limit = double(self.side - 1);
        if high.x < -pad || high.y < -pad || low.x > limit + pad || low.y > limit + pad {
            return None;
        }
        if low.z - sag > self.highest((low.x - pad, low.y - pad), (high.x + pad, high.y + pad)) {
            return None;
        }
        if (high.x - low.x).max(high.y - low.y) <= 0.5 {
            return self.leaf(a, b);
        }
        let middle = f64::midpoint(a.0, b.0);
        let m = (middle, piece.at(middle));
        self.halve(piece, a, m).or_else(|| self.halve(piece, m, b))
    }

    /// The first crossing within a stretch of at most half a post, taken as straight: at most one grid line each way.
    fn leaf(&self, a: (f64, Place), b: (f64, Place)) -> Option<f64> {
        let (from, to) = (a.1, b.1);
        let crossing = |p: f64, q: f64| {
            let line = p.max(q).floor();
            if line > p.min(q) {
                ((line - p) / (q - p)).clamp(0.0, 1.0)
            } else {
                1.0
            }
        };
        let mut cuts = [0.0, crossing(from.x, to.x), crossing(from.y, to.y), 1.0];
        cuts.sort_by(f64::total_cmp);
        for pair in cuts.windows(2) {
            let (s, e) = (pair[0], pair[1]);
            if e - s <= 0.0 {
                continue;
            }
            let middle = from.lerp(to, f64::midpoint(s, e));
            let limit = double(self.side - 1);
            if !(0.0..limit).contains(&middle.x) || !(0.0..limit).contains(&middle.y) {
                continue;
            }
            let (i, j) = (floor(middle.x), floor(middle.y));
            let above = |s: f64| {
                let p = from.lerp(to, s);
                p.z - self.patch(i, j, p.x - double(i), p.y - double(j))
            };
            let (d0, dm, d1) = (above(s), above(f64::midpoint(s, e)), above(e));
            if let Some(u) = first_root(d0, dm, d1) {
                return Some(a.0 + (s + u * (e - s)) * (b.0 - a.0));
            }
        }
        None
    }

    /// A maximum over the cells between two corners, from the level of the pyramid where they are at most 2 x 2.
    fn highest(&self, low: (f64, f64), high: (f64, f64)) -> f64 {
        let last = self.side - 2;
        let cell = |v: f64| floor(v.max(0.0)).min(last);
        let (mut i0, mut j0, mut i1, mut j1) =
            (cell(low.0), cell(low.1), cell(high.0), cell(high.1));
        let mut level = 0;
        while i1 - i0 > 1 || j1 - j0 > 1 {
            (i0, j0, i1, j1) = (i0 / 2, j0 / 2, i1 / 2, j1 / 2);
            level += 1;
        }
        let side = (self.side - 1).div_ceil(1 << level);
        let map = &self.maxima[level];
        let mut most = f32::MIN;
        for j in j0..=j1 {
            for i in i0..=i1 {
                most = most.max(map[j * side + i]);
            }
        }
        f64::from(most)
    }
}

/// A stretch of a ray: four points at equal distances.
struct Piece {
    start: f64,
    knots: [Place; 4],
}

impl Piece {
    /// The cubic through the knots at a share of the piece (Lagrange).
    fn at(&self, share: f64) -> Place {
        debug_assert!(self.start >= 0.0, "rays go forward");
        let u = 3.0 * share;
        let (a, b, c) = (u - 1.0, u - 2.0, u - 3.0);
        self.knots[0] * (-a * b * c / 6.0)
            + self.knots[1] * (u * b * c / 2.0)
            + self.knots[2] * (-u * a * c / 2.0)
            + self.knots[3] * (u * a * b / 6.0)
    }
}

/// Where the parabola through (0, `d0`), (1/2, `dm`), (1, `d1`) first is not above 0, in 0 to 1.
fn first_root(d0: f64, dm: f64, d1: f64) -> Option<f64> {
    if d0 <= 0.0 {
        return Some(0.0);
    }
    let c = 2.0 * (d0 + d1 - 2.0 * dm);
    let b = d1 - d0 - c;
    let inside = b * b - 4.0 * c * d0;
    if inside < 0.0 {
        return None;
    }
    // With d0 > 0 the first positive root is 2 d0 / (-b + sqrt(...)), whatever the sign of c.
    let below = -b + inside.sqrt();
    let u = 2.0 * d0 / below;
    (below > 0.0 && u <= 1.0).then_some(u)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::{Attitude, Camera};
    use crate::terrain::partition::Partition;
    use crate::terrain::planet::{Kind, Planet};
    use crate::units::Radians;

    fn field(kind: Kind, at: (f64, f64)) -> Field {
        let planet = Planet::new(kind, 1200).without_geoid();
        Field::load(
            &planet,
            Partition::Geographic,
            &Geodetic::from_degrees(at.0, at.1, 0.0),
            30_000.0,
        )
    }

    fn rays(at: (f64, f64), height_m: f64) -> impl Iterator<Item = (DVec3, DVec3)> {
        let camera = Camera {
            eye: Geodetic::from_degrees(at.0, at.1, height_m),
            attitude: Attitude::from_degrees(130.0, -8.0, 0.0),
            hfov: Radians::from_degrees(70.0),
            width_px: 40,
            height_px: 24,
        };
        let eye = camera.eye.to_ecef();
        (0..960_u32).map(move |k| {
            (
                eye,
                camera.ray_ecef(f64::from(k % 40) + 0.5, f64::from(k / 40) + 0.5),
            )
        })
    }

    #[test]
    fn a_plain_is_met_where_an_ellipsoid_is() {
        let plain = field(Kind::Plain(200), (46.0, 8.0));
        let axes = DVec3::new(crate::geo::WGS84_A_M, crate::geo::WGS84_A_M, WGS84_B_M)
            + DVec3::splat(200.0);
        let mut hits = 0;
        for (eye, d) in rays((46.0, 8.0), 900.0) {
            let (o, s) = (eye / axes, d / axes);
            let (a, b, c) = (s.dot(s), o.dot(s), o.dot(o) - 1.0);
            let inside = b * b - a * c;
            match plain.cast(eye, d) {
                Cast::Hit(t) => {
                    // The ellipsoid with longer axes is not quite the surface of constant height; at 200 m they are
                    // microns apart. Grazing rays turn that into more.
                    let truth = (-b - inside.sqrt()) / a;
                    assert!((t - truth).abs() < 1e-6 * t + 1e-3, "{t} {truth}");
                    hits += 1;
                }
                Cast::Sky => assert!(inside < 0.0 || b > 0.0, "a miss"),
                Cast::Left => {}
            }
        }
        assert!(hits > 300, "{hits}");
    }

    #[test]
    fn mountains_are_met_where_small_steps_meet_them_first() {
        let at = (-32.6, -70.3);
        let land = field(Kind::Earth, at);
        let (mut hits, mut sky) = (0, 0);
        for (eye, d) in rays(at, 3500.0).step_by(7) {
            let above = |t: f64| {
                let g = Geodetic::from_ecef(eye + d * t);
                land.ground(&g)
                    .map(|ground| g.height_ellipsoid.0 - ground.height_m)
            };
            let stepped = (1..6000)
                .map(|k| 5.0 * f64::from(k))
                .find_map(|t| match above(t) {
                    Some(over) if over < 0.0 => Some(Some(t)),
                    Some(_) => None,
                    None => Some(None),
                });
            match (land.cast(eye, d), stepped.flatten()) {
                (Cast::Hit(t), Some(step)) => {
                    assert!(
                        t <= step && above(t).is_some_and(|a| a.abs() < 1e-3),
                        "{t} {step}"
                    );
                    hits += 1;
                }
                // A crest thinner than the steps may be met first by the cast only; the other way round never.
                (Cast::Hit(t), None) => assert!(above(t).is_some_and(|a| a.abs() < 1e-3), "{t}"),
                (Cast::Sky | Cast::Left, None) => sky += 1,
                (other, Some(step)) => panic!("{other:?} where steps meet ground at {step}"),
            }
        }
        assert!(hits > 40 && sky > 10, "{hits} {sky}");
    }
}
