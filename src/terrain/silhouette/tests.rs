//! Ridges with known answers, and random ground against rays.

use super::*;
use crate::geo::{Attitude, Geodetic};
use crate::terrain::cull::Patch;
use crate::terrain::partition::Partition;
use crate::units::Radians;
use proptest::prelude::*;

const LAT_DEG: f64 = 46.0;
const LON_DEG: f64 = 8.0;

/// Degrees of latitude and longitude in a metre, to a thousandth.
const NORTH_DEG: f64 = 1.0 / 111_150.0;
const EAST_DEG: f64 = 1.0 / 77_470.0;

fn camera(height_m: f64, (heading, pitch, roll): (f64, f64, f64), hfov_deg: f64) -> Camera {
    Camera {
        eye: Geodetic::from_degrees(LAT_DEG, LON_DEG, height_m),
        attitude: Attitude::from_degrees(heading, pitch, roll),
        hfov: Radians::from_degrees(hfov_deg),
        width_px: 1024,
        height_px: 600,
    }
}

/// A rectangle of ground, metres north and east of the eye, as a lattice with its heights.
fn lattice(
    silhouette: &Silhouette,
    north_m: (f64, f64),
    east_m: (f64, f64),
    (low, high): (f64, f64),
) -> Lattice {
    let patch = Patch {
        partition: Partition::Geographic,
        south_deg: LAT_DEG + north_m.0 * NORTH_DEG,
        north_deg: LAT_DEG + north_m.1 * NORTH_DEG,
        west_deg: LON_DEG + east_m.0 * EAST_DEG,
        east_deg: LON_DEG + east_m.1 * EAST_DEG,
        height_min_m: low,
        height_max_m: high,
    };
    let origin = Geodetic::from_degrees(LAT_DEG + 0.01, LON_DEG, 0.0).to_ecef();
    silhouette.lattice(&Bound::of(&patch, origin), silhouette.offset(origin))
}

/// A silhouette seen northwards with 60 degrees across: 1.1547 of a distance, 256 columns.
fn northwards(eye_m: f64) -> Silhouette {
    let mut silhouette = Silhouette::default();
    silhouette.begin(&camera(eye_m, (0.0, 0.0, 0.0), 60.0), true);
    assert!(silhouette.is_used(), "a level view");
    silhouette
}

/// Adds a line of ten posts from west to east.
fn ridge(silhouette: &mut Silhouette, at_m: f64, east_m: (f64, f64), heights_m: [f32; 10]) {
    let ground = lattice(silhouette, (at_m, at_m + 1000.0), east_m, (0.0, 3000.0));
    assert!(!ground.prefers_columns(), "rows lie across this view");
    let line = ground.line(0.0, false);
    let height = |k: u8| heights_m[usize::from(k)];
    assert!(silhouette.add(&line, 9, height), "room for a line");
}

/// Whether a kilometre of ground is hidden.
fn is_hidden(silhouette: &mut Silhouette, at_m: f64, east_m: (f64, f64), top_m: f32) -> bool {
    let heights = (0.0, f64::from(top_m));
    let ground = lattice(silhouette, (at_m, at_m + 1000.0), east_m, heights);
    silhouette.hides(&ground, &[top_m; 4])
}

/// Lines this wide bulge by half a metre.
const WIDE_M: (f64, f64) = (-1500.0, 1500.0);
const MIDDLE_M: (f64, f64) = (-1000.0, 1000.0);

#[test]
fn a_wall_hides_what_is_lower_behind_it_and_not_what_stands_above_it() {
    // Ground falls away by d^2 / 2R: 2 m at 5 km, 8 m at 10 km. The wall is (100 - 2) / 5000 above the horizon, which
    // at 10 km is 196 m above the eye, 1204 m above the ellipsoid.
    let mut silhouette = northwards(1000.0);
    assert!(
        !is_hidden(&mut silhouette, 10e3, MIDDLE_M, 100.0),
        "nothing seen yet"
    );
    ridge(&mut silhouette, 5000.0, WIDE_M, [1100.0; 10]);
    assert!(is_hidden(&mut silhouette, 10e3, MIDDLE_M, 1190.0), "lower");
    assert!(
        !is_hidden(&mut silhouette, 10e3, MIDDLE_M, 1210.0),
        "higher by 6 m"
    );
    // The wall ends 0.3 to the right.
    assert!(
        !is_hidden(&mut silhouette, 10e3, (2500.0, 3500.0), 500.0),
        "only partly behind"
    );
}

#[test]
fn each_quarter_is_held_against_the_ridge_under_its_own_top() {
    let mut silhouette = northwards(1000.0);
    // High in the west, low in the east.
    let heights = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9].map(|k: u8| if k < 5 { 1500.0 } else { 1100.0 });
    ridge(&mut silhouette, 5000.0, WIDE_M, heights);
    let ground = lattice(&silhouette, (10e3, 11e3), (-1500.0, 1500.0), (0.0, 1400.0));
    let (low, high) = (1150.0, 1400.0);
    assert!(
        silhouette.hides(&ground, &[high, low, high, low]),
        "as the ridge"
    );
    assert!(
        !silhouette.hides(&ground, &[low, high, low, high]),
        "the other way round"
    );
}

#[test]
fn a_gap_of_one_column_shows_what_is_behind_it() {
    // At 5 km a column is 22.6 m wide: 50 m leave one that neither line crosses.
    let mut silhouette = northwards(1000.0);
    ridge(&mut silhouette, 5000.0, (-1500.0, 0.0), [1100.0; 10]);
    ridge(&mut silhouette, 5000.0, (50.0, 1500.0), [1100.0; 10]);
    assert!(
        !is_hidden(&mut silhouette, 10e3, MIDDLE_M, 500.0),
        "through the gap"
    );
    assert!(
        is_hidden(&mut silhouette, 10e3, (200.0, 1200.0), 500.0),
        "right of it"
    );
    assert!(
        is_hidden(&mut silhouette, 10e3, (-1200.0, -200.0), 500.0),
        "left of it"
    );
}

#[test]
fn a_notch_shows_what_is_behind_it_down_to_its_ground() {
    let mut silhouette = northwards(1000.0);
    let mut heights = [1100.0; 10];
    // Posts are 333 m apart: the fifth is at -167 m, at 10 km -334.
    heights[4] = 900.0;
    ridge(&mut silhouette, 5000.0, WIDE_M, heights);
    let aside = (-700.0, 300.0);
    assert!(
        !is_hidden(&mut silhouette, 10e3, aside, 1100.0),
        "in the notch"
    );
    // (900 - 1000 - 2) / 5000: at 11 km, the farther side, 785 m above the ellipsoid.
    assert!(
        is_hidden(&mut silhouette, 10e3, aside, 770.0),
        "below the notch"
    );
    assert!(
        is_hidden(&mut silhouette, 10e3, (1000.0, 2000.0), 1150.0),
        "elsewhere"
    );
}

#[test]
fn the_sea_hides_what_lies_beyond_its_horizon() {
    // From 20 m the sea at 12 km is (20 + 11.3) / 12 000 = 0.0026 below level; at 40 km the surface has fallen by 125.6 m.
    let mut silhouette = northwards(20.0);
    ridge(&mut silhouette, 12e3, WIDE_M, [0.0; 10]);
    assert!(
        is_hidden(&mut silhouette, 40e3, MIDDLE_M, 20.0),
        "a low coast"
    );
    assert!(
        !is_hidden(&mut silhouette, 40e3, MIDDLE_M, 60.0),
        "a higher one"
    );
}

#[test]
fn an_eye_under_the_ridge_sees_what_towers_above_it() {
    // (2000 - 600 - 0.6) / 2800: at 10 km 4998 m above the eye.
    let mut silhouette = northwards(600.0);
    ridge(&mut silhouette, 2800.0, WIDE_M, [2000.0; 10]);
    assert!(is_hidden(&mut silhouette, 10e3, MIDDLE_M, 5400.0), "below");
    assert!(!is_hidden(&mut silhouette, 10e3, MIDDLE_M, 5700.0), "above");
}

#[test]
fn what_begins_beside_or_behind_the_eye_is_never_hidden() {
    let mut silhouette = northwards(1000.0);
    ridge(&mut silhouette, 1000.0, WIDE_M, [2000.0; 10]);
    assert!(is_hidden(&mut silhouette, 3000.0, MIDDLE_M, 500.0), "ahead");
    assert!(
        !is_hidden(&mut silhouette, -500.0, MIDDLE_M, 500.0),
        "under the eye"
    );
    assert!(
        !is_hidden(&mut silhouette, -3000.0, MIDDLE_M, 500.0),
        "behind"
    );
}

#[test]
fn nothing_hides_from_under_the_ground_nor_in_a_view_straight_down() {
    let mut silhouette = Silhouette::default();
    for (attitude, hfov, is_above_ground, is_used) in [
        ((0.0, 0.0, 0.0), 60.0, true, true),
        ((0.0, 0.0, 90.0), 60.0, true, true),
        ((0.0, 0.0, 180.0), 60.0, true, true),
        ((0.0, 0.0, 0.0), 60.0, false, false),
        ((0.0, -90.0, 0.0), 60.0, true, false),
        ((123.0, -75.0, 30.0), 60.0, true, false),
        ((0.0, 90.0, 0.0), 20.0, true, false),
    ] {
        silhouette.begin(&camera(1000.0, attitude, hfov), is_above_ground);
        assert_eq!(
            silhouette.is_used(),
            is_used,
            "{attitude:?} {is_above_ground}"
        );
        if !is_used {
            ridge_anywhere(&mut silhouette);
            assert!(
                !is_hidden(&mut silhouette, 10e3, MIDDLE_M, 500.0),
                "{attitude:?}"
            );
        }
    }
}

fn ridge_anywhere(silhouette: &mut Silhouette) {
    let ground = lattice(silhouette, (5000.0, 6000.0), WIDE_M, (0.0, 3000.0));
    silhouette.add(&ground.line(0.0, false), 9, |_| 2900.0);
}

#[test]
fn only_the_line_that_hides_has_earned_it() {
    let mut silhouette = northwards(1000.0);
    ridge(&mut silhouette, 4000.0, WIDE_M, [1050.0; 10]);
    ridge(&mut silhouette, 5000.0, WIDE_M, [1100.0; 10]);
    ridge(&mut silhouette, 6000.0, WIDE_M, [1050.0; 10]);
    assert!(is_hidden(&mut silhouette, 10e3, MIDDLE_M, 500.0), "behind");
    assert_eq!(silhouette.earned(), [false, true, false], "the highest");
}

#[test]
fn a_new_frame_has_seen_nothing() {
    let mut silhouette = northwards(1000.0);
    ridge(&mut silhouette, 5000.0, WIDE_M, [2000.0; 10]);
    assert!(is_hidden(&mut silhouette, 10e3, MIDDLE_M, 500.0), "behind");
    silhouette.begin(&camera(1000.0, (0.0, 0.0, 0.0), 60.0), true);
    assert!(
        !is_hidden(&mut silhouette, 10e3, MIDDLE_M, 500.0),
        "not yet"
    );
    assert!(silhouette.earned().is_empty(), "no lines");
}

/// Cells along a side of random ground and of its blocks.
const SIDE: usize = 24;
const BLOCK: usize = 4;
const BLOCK_POSTS: u8 = 4;

/// Random ground around the eye: posts in rows from the south-west.
#[derive(Clone, Debug)]
struct Field {
    spacing_m: f64,
    /// Posts from the first to the eye, east and north.
    eye: (f64, f64),
    heights_m: Vec<f32>,
}

impl Field {
    fn height(&self, i: usize, j: usize) -> f32 {
        self.heights_m[j * (SIDE + 1) + i]
    }

    fn position(&self, i: f64, j: f64, height_m: f64) -> DVec3 {
        let lat = LAT_DEG + (j - self.eye.1) * self.spacing_m * NORTH_DEG;
        let lon = LON_DEG + (i - self.eye.0) * self.spacing_m * EAST_DEG;
        Geodetic::from_degrees(lat, lon, height_m).to_ecef()
    }

    /// Post position and height of a point.
    fn post(&self, p: DVec3) -> (f64, f64, f64) {
        let g = Geodetic::from_ecef(p);
        (
            self.eye.0 + (g.longitude.to_degrees() - LON_DEG) / (self.spacing_m * EAST_DEG),
            self.eye.1 + (g.latitude.to_degrees() - LAT_DEG) / (self.spacing_m * NORTH_DEG),
            g.height_ellipsoid.0,
        )
    }

    /// Whether a ray to a point passes under an even row or column on its way.
    fn blocks_ray(&self, eye: DVec3, to: DVec3) -> bool {
        (0..=SIDE).step_by(2).any(|line| {
            [false, true].into_iter().any(|is_column| {
                #[expect(clippy::cast_precision_loss, reason = "a few posts")]
                let at = line as f64;
                let off = |t: f64| {
                    let (i, j, _) = self.post(eye.lerp(to, t));
                    if is_column { i - at } else { j - at }
                };
                let (mut a, mut b) = ((0.0, off(0.0)), (1.0, off(1.0)));
                if a.1 * b.1 >= 0.0 {
                    return false;
                }
                // The secant, on what is all but a straight line.
                for _ in 0..3 {
                    let t = a.0 - a.1 * (b.0 - a.0) / (b.1 - a.1);
                    let middle = (t, off(t));
                    if middle.1 * a.1 > 0.0 {
                        a = middle;
                    } else {
                        b = middle;
                    }
                }
                let t = if a.1.abs() < b.1.abs() { a.0 } else { b.0 };
                let (i, j, height_m) = self.post(eye.lerp(to, t));
                let along = if is_column { j } else { i };
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    clippy::cast_precision_loss,
                    reason = "clamped to posts"
                )]
                let (k, share) = {
                    let k = along.clamp(0.0, (SIDE - 1) as f64).floor();
                    (k as usize, along - k)
                };
                if !(0.0..=1.0).contains(&share) {
                    return false;
                }
                let post = |k: usize| {
                    f64::from(if is_column {
                        self.height(line, k)
                    } else {
                        self.height(k, line)
                    })
                };
                height_m < post(k) + (post(k + 1) - post(k)) * share
            })
        })
    }

    /// Of the block whose first post is (`i`, `j`): its lattice, and the tops of its quarters.
    fn block(&self, silhouette: &Silhouette, i: usize, j: usize) -> (Lattice, Tops) {
        let posts = |from: usize, to: usize| from..=to;
        let top = |i: usize, j: usize| {
            posts(j, j + BLOCK / 2)
                .flat_map(|j| posts(i, i + BLOCK / 2).map(move |i| (i, j)))
                .map(|(i, j)| self.height(i, j))
                .fold(f32::NEG_INFINITY, f32::max)
        };
        let half = BLOCK / 2;
        let tops = [(0, 0), (half, 0), (0, half), (half, half)].map(|(x, y)| top(i + x, j + y));
        let all = || {
            posts(j, j + BLOCK)
                .flat_map(|j| posts(i, i + BLOCK).map(move |i| (i, j)))
                .map(|(i, j)| f64::from(self.height(i, j)))
        };
        #[expect(clippy::cast_precision_loss, reason = "a few posts")]
        let metres = |from: usize, eye: f64| {
            (
                (from as f64 - eye) * self.spacing_m,
                ((from + BLOCK) as f64 - eye) * self.spacing_m,
            )
        };
        let heights = (
            all().fold(f64::INFINITY, f64::min),
            all().fold(f64::NEG_INFINITY, f64::max),
        );
        let (east, north) = (metres(i, self.eye.0), metres(j, self.eye.1));
        (lattice(silhouette, north, east, heights), tops)
    }
}

fn fields() -> impl Strategy<Value = Field> {
    let rough = proptest::collection::vec(0.0..1.0_f32, (SIDE + 1) * (SIDE + 1));
    let waves = (0.0..1.5_f32, 0.0..1.5_f32, 0.0..1500.0_f32, 0.0..60.0_f32);
    (
        50.0..4000.0_f64,
        (1.0..23.0_f64, 1.0..23.0_f64),
        rough,
        waves,
    )
        .prop_map(|(spacing_m, eye, rough, (east, north, high, noise))| {
            #[expect(clippy::cast_precision_loss, reason = "a few posts")]
            let at = |k: usize| ((k % (SIDE + 1)) as f32, (k / (SIDE + 1)) as f32);
            let heights_m = (0..rough.len())
                .map(|k| {
                    let (i, j) = at(k);
                    high * (1.0 + (east * i).sin() * (north * j).cos()) + noise * rough[k]
                })
                .collect();
            Field {
                spacing_m,
                eye,
                heights_m,
            }
        })
}

/// The blocks that are hidden, each by lines of nearer ones, as first posts.
fn hidden(field: &Field, silhouette: &mut Silhouette, every: usize) -> Vec<(usize, usize)> {
    let mut blocks: Vec<_> = (0..SIDE)
        .step_by(BLOCK)
        .flat_map(|j| (0..SIDE).step_by(BLOCK).map(move |i| (i, j)))
        .map(|at| (at, field.block(silhouette, at.0, at.1)))
        .collect();
    blocks.sort_by(|a, b| a.1.0.distances_m().0.total_cmp(&b.1.0.distances_m().0));
    let mut out = Vec::new();
    for (at, (this, tops)) in &blocks {
        silhouette.profile = Profile::NOTHING;
        silhouette.earned.clear();
        let near = this.distances_m().0;
        let nearer = |b: &&((usize, usize), (Lattice, Tops))| b.1.0.distances_m().1 <= near;
        for ((i, j), (ground, _)) in blocks.iter().filter(nearer) {
            let northward = ground.prefers_columns();
            for k in (0..=BLOCK).step_by(every) {
                #[expect(clippy::cast_precision_loss, reason = "a few posts")]
                let line = ground.line(k as f32 / BLOCK as f32, northward);
                silhouette.add(&line, BLOCK_POSTS, |m| {
                    let m = usize::from(m);
                    if northward {
                        field.height(i + k, j + m)
                    } else {
                        field.height(i + m, j + k)
                    }
                });
            }
        }
        if silhouette.hides(this, tops) {
            out.push(*at);
        }
    }
    out
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(192))]
    #[test]
    fn no_ray_reaches_a_hidden_block(
        field in fields(), above_m in 0.3..300.0_f64, every in prop_oneof![Just(2_usize), Just(4)],
        attitude in (0.0..360.0_f64, -30.0..15.0_f64, -180.0..180.0_f64), hfov in 10.0..100.0_f64,
    ) {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the field")]
        let (i, j) = (field.eye.0 as usize, field.eye.1 as usize);
        let around = [(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)];
        let ground = around.into_iter().map(|(i, j)| field.height(i, j)).fold(0.0, f32::max);
        let camera = camera(f64::from(ground) + above_m, attitude, hfov);
        let eye = camera.eye.to_ecef();
        let mut silhouette = Silhouette::default();
        silhouette.begin(&camera, true);
        prop_assume!(silhouette.is_used());
        let to_eye = camera.eye_to_ecef().transpose();
        for (i, j) in hidden(&field, &mut silhouette, every) {
            for (i, j) in (j..=j + BLOCK).flat_map(|j| (i..=i + BLOCK).map(move |i| (i, j))) {
                #[expect(clippy::cast_precision_loss, reason = "a few posts")]
                let p = field.position(i as f64, j as f64, field.height(i, j).into());
                let q = to_eye * (p - eye);
                let (x, y) = (q.x / -q.z * camera.focal_px(), q.y / -q.z * camera.focal_px());
                let in_picture = q.z < 0.0 && x.abs() < 512.0 && y.abs() < 300.0;
                prop_assert!(!in_picture || field.blocks_ray(eye, p), "post {i} {j} of a hidden block shows");
            }
        }
    }
}

#[test]
fn rough_ground_hides_some_of_itself() {
    // So that the test above is not one of nothing: a ridge across the view.
    let mut heights_m = vec![100.0; (SIDE + 1) * (SIDE + 1)];
    heights_m[6 * (SIDE + 1)..7 * (SIDE + 1)].fill(900.0);
    let field = Field {
        spacing_m: 500.0,
        eye: (12.0, 1.0),
        heights_m,
    };
    let mut silhouette = Silhouette::default();
    silhouette.begin(&camera(400.0, (0.0, 0.0, 0.0), 50.0), true);
    let hidden = hidden(&field, &mut silhouette, 2);
    assert!(hidden.contains(&(4, 16)), "behind the ridge: {hidden:?}");
    assert!(!hidden.contains(&(8, 0)), "the ridge itself: {hidden:?}");
}
