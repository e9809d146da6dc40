//! Pictures of the terrain, checked pixel by pixel: no holes, whatever the pose, the damage or the hunger; and the
//! distance behind each pixel against a ray cast in f64.
#![expect(
    clippy::expect_used,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "a test: numbers are small and what fails must say so"
)]

mod clipmap_support;

use clipmap_support::booth::{Booth, HEIGHT, WIDTH, camera, meets_earth, ray, settings};
use clipmap_support::support::is_emulated;
use clipmap_support::{Dice, Formula, Land, cliffs, gpu, mountains, sea};
use glam::DVec3;
use glasswing::geo::{Camera, Geodetic};
use glasswing::gl::target::Target;
use glasswing::terrain::scene::Settings;
use glasswing::units::{Metres, Radians};
use std::sync::Arc;

/// A pose near a point: low or high, any attitude, above the ground by enough to keep 0.2 m (where the picture begins) from
/// its slopes.
fn pose(dice: &mut Dice, booth: &mut Booth, near: (f64, f64), above_min_m: f64) -> Camera {
    let lat = near.0 + dice.between(-0.03, 0.03);
    let lon = near.1 + dice.between(-0.03, 0.03);
    let over = Geodetic::from_degrees(lat, lon, 7100.0);
    booth.settle(&camera(over, (0.0, 0.0, 0.0), 60.0));
    // Over damaged tiles there is no height: well above, then.
    let ground = booth.terrain.ground(&over).map_or(7100.0, |g| g.0);
    let above = 10_f64.powf(dice.between(above_min_m.log10(), 3.9));
    let fov = [2.0, 30.0, 60.0, 120.0][dice.between(0.0, 4.0) as usize];
    let attitude = (
        dice.between(0.0, 360.0),
        dice.between(-90.0, 15.0),
        dice.between(-180.0, 180.0),
    );
    camera(
        Geodetic::from_degrees(lat, lon, ground + above),
        attitude,
        fov,
    )
}

/// How many poses of a kind: fewer under an emulator, where each takes seconds.
fn poses(count: usize) -> usize {
    if is_emulated() { 2 } else { count }
}

/// Below every post of the formulas: -500 m less 40 m of geoid.
const LOWEST_M: f64 = -545.0;

#[test]
fn no_pose_shows_a_hole() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let mut dice = Dice(7);
    for (vertices, formula, above_min_m) in [
        (127, cliffs as Formula, 60.0),
        (127, mountains, 1.0),
        (191, mountains, 1.0),
        (255, cliffs, 60.0),
    ] {
        let mut booth = Booth::new(&gpu, vertices, Arc::new(Land::new(1200, formula)));
        for near in [(46.0, 8.0), (0.0, 0.0), (-19.5, 180.0), (62.0, -30.0)] {
            booth.settle(&camera(
                Geodetic::from_degrees(near.0, near.1, 7100.0),
                (0.0, 0.0, 0.0),
                60.0,
            ));
            for _ in 0..poses(25) {
                let camera = pose(&mut dice, &mut booth, near, above_min_m);
                booth.settle(&camera);
                let holes = booth.holes(&camera, LOWEST_M);
                assert_eq!(holes, 0, "{vertices} vertices, {camera:?}");
            }
        }
    }
}

/// Rastering turns a narrow triangle of a ridge over here, and no other one covers the pixel that it then does.
#[test]
fn a_triangle_that_rastering_turns_over_leaves_no_hole() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let mut booth = Booth::new(&gpu, 191, Arc::new(Land::new(1200, mountains)));
    let eye = Geodetic {
        latitude: Radians(-0.340_242_587),
        longitude: Radians(3.141_487_421),
        height_ellipsoid: Metres(4092.69),
    };
    let mut view = camera(eye, (0.0, 0.0, 0.0), 30.0);
    view.attitude.heading_true = Radians(0.512_834);
    view.attitude.pitch = Radians(-0.085_784);
    view.attitude.roll = Radians(1.867_932);
    // Some of its pixels belong to blocks that are clipped, some to such as are not.
    for turn in 0..poses(30) {
        view.attitude.roll.0 = 1.867_932 + 0.2 * turn as f64;
        booth.settle(&view);
        assert_eq!(booth.holes(&view, LOWEST_M), 0, "{view:?}");
    }
}

/// A narrow, high picture of plain ground, in which planes of two slices cut the same side: seen once in 10 000 views.
#[test]
fn a_side_that_two_levels_share_is_cut_at_one_place() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let mut booth = Booth::new(&gpu, 191, Arc::new(Land::new(1200, sea)));
    for turn in 0..poses(40) {
        let turn = turn as f64;
        let eye = Geodetic::from_degrees(-33.072 + 1e-4 * turn, -70.155, 370.0);
        let mut view = camera(eye, (7.485, -35.689, -93.19 + 0.2 * turn), 120.0);
        (view.width_px, view.height_px) = (33, 241);
        booth.target = Target::offscreen(&gpu, 33, 241, 0).expect("a target");
        booth.pixels = vec![0; 33 * 241 * 4];
        booth.settle(&view);
        assert_eq!(booth.holes(&view, -545.0), 0, "{view:?}");
    }
}

/// From above the ground upper sides alone are drawn, from within it both, so that it can be seen from there.
#[test]
fn lower_sides_are_left_out_from_above_the_ground_only() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let mut booth = Booth::new(&gpu, 127, Arc::new(Land::new(1200, mountains)));
    let at = |height_m: f64| {
        let eye = Geodetic::from_degrees(46.0, 8.0, height_m);
        camera(eye, (20.0, 5.0, 0.0), 60.0)
    };
    let mut ground_m = 5000.0;
    for _ in 0..3 {
        let over = at(ground_m + 500.0);
        booth.settle(&over);
        ground_m = surface_m(&booth, &over.eye);
    }
    for (above_m, is_above) in [(500.0, true), (3.0, true), (0.01, false), (-300.0, false)] {
        booth.settle(&at(ground_m + above_m));
        let plan = booth.terrain.scene().expect("there is terrain").plan();
        assert_eq!(plan.is_above_ground, is_above, "{above_m} m above");
        let slices = plan.levels.iter().flat_map(|level| &level.slices);
        let turned: usize = slices.map(|slice| slice.turned).sum();
        assert_eq!(turned > 0, is_above, "{above_m} m above");
    }
    let from_within = booth.ranges();
    let seen = from_within.iter().filter(|range| range.is_finite()).count();
    assert!(2 * seen > from_within.len(), "{seen} pixels of rock");
}

#[test]
fn hard_poses_show_no_hole_either() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let mut booth = Booth::new(&gpu, 255, Arc::new(Land::new(1200, mountains)));
    let places = [
        (-20.0, 179.999_999),
        (45.0, 0.0),
        (-20.0, -180.0),
        (0.0, 90.0),
        (70.0, 12.0),
    ];
    for (lat, lon) in places.into_iter().take(poses(5)) {
        for (height, pitch, roll) in [
            (15_000.0, -90.0, 0.0),
            (8000.0, 0.0, 0.0),
            (8000.0, -10.0, 90.0),
            (8000.0, 0.0, 180.0),
            (8000.0, 5.0, -45.0),
        ] {
            let camera = camera(
                Geodetic::from_degrees(lat, lon, height),
                (77.0, pitch, roll),
                60.0,
            );
            booth.settle(&camera);
            assert_eq!(booth.holes(&camera, LOWEST_M), 0, "{camera:?}");
        }
    }
}

#[test]
fn damaged_tiles_leave_no_hole() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let land = Land::new(1200, mountains)
        .broken(|key| (key.column * 7 + key.row * 3 + i32::from(key.level)) % 4 == 0);
    let mut booth = Booth::new(&gpu, 127, Arc::new(land));
    let mut dice = Dice(11);
    for _ in 0..poses(40) {
        let camera = pose(&mut dice, &mut booth, (30.0, 30.0), 1.0);
        let figures = booth.settle(&camera);
        assert!(figures.damage.checksum > 0, "counted");
        assert_eq!(booth.holes(&camera, LOWEST_M), 0, "{camera:?}");
    }
}

#[test]
fn a_starved_streamer_still_draws_a_closed_surface() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let mut booth = Booth::new(&gpu, 255, Arc::new(Land::new(1200, mountains)));
    let at = |k: f64| Geodetic::from_degrees(20.0 + 0.02 * k, 20.0 - 0.03 * k, 6000.0);
    booth.settle(&camera(at(0.0), (0.0, 0.0, 0.0), 60.0));
    let mut finest = 0;
    for k in 1..=40 {
        let k = f64::from(k);
        let camera = camera(at(k), (9.0 * k, -15.0, 4.0 * k), 60.0);
        let figures = booth.prepare(&camera, 0);
        assert_eq!(figures.uploads_texels, 0, "nothing may be uploaded");
        assert_eq!(booth.holes(&camera, LOWEST_M), 0, "{camera:?}");
        finest = figures.levels.expect("something is drawn").0;
    }
    assert!(finest >= 2, "fine levels were left behind: {finest}");
}

/// Ellipsoidal height of the ground where the finest level's triangles lie, unblended.
fn surface_m(booth: &Booth, at: &Geodetic) -> f64 {
    booth.terrain.ground(at).expect("resident").0
}

/// Distance along a ray to the ground: steps of a fifth of a post, then halving. The ground is the finest resident level.
fn cast(booth: &Booth, eye: DVec3, direction: DVec3, reach_m: f64) -> Option<f64> {
    let above = |t: f64| {
        let g = Geodetic::from_ecef(eye + direction * t);
        g.height_ellipsoid.0 - surface_m(booth, &g)
    };
    let mut t = 0.0;
    while t < reach_m {
        let next = t + 15.0;
        if above(next) < 0.0 {
            let (mut low, mut high) = (t, next);
            for _ in 0..poses(40) {
                let middle = f64::midpoint(low, high);
                if above(middle) < 0.0 {
                    high = middle;
                } else {
                    low = middle;
                }
            }
            return Some(f64::midpoint(low, high));
        }
        t = next;
    }
    None
}

#[test]
fn distances_agree_with_a_ray_cast_in_f64() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let mut booth = Booth::new(&gpu, 255, Arc::new(Land::new(1200, mountains)));
    // The software renderer for aarch64 now and then places a pixel otherwise than the one for x86-64: seen was 0.13 m at
    // 1.2 km, a fiftieth of a pixel.
    let height_m = if is_emulated() { 0.3 } else { 0.02 };
    let mut compared = 0;
    for (lat, lon, heading) in [
        (46.2, 8.1, 200.0),
        (-32.6, -70.3, 215.0),
        (60.0, 179.98, 90.0),
    ] {
        let ground = {
            let probe = camera(
                Geodetic::from_degrees(lat, lon, 5000.0),
                (0.0, 0.0, 0.0),
                60.0,
            );
            booth.settle(&probe);
            surface_m(&booth, &probe.eye)
        };
        let camera = camera(
            Geodetic::from_degrees(lat, lon, ground + 400.0),
            (heading, -25.0, 10.0),
            50.0,
        );
        booth.settle(&camera);
        let ranges = booth.ranges();
        let eye = camera.eye.to_ecef();
        for at in (0..ranges.len()).step_by(41) {
            let range = f64::from(ranges[at]);
            // The finest level is unblended within 97 posts of the eye, 4.4 km eastwards at 60 degrees.
            if range > 4000.0 {
                continue;
            }
            let Some(truth) = cast(&booth, eye, ray(&camera, at), 6000.0) else {
                panic!("{range} m where the ray meets nothing: {camera:?} {at}");
            };
            // A grazing ray turns a millimetre of height into metres of distance, and a steep slope the other way round:
            // one of the two must agree. 0.02 m at 400 m and more is a hundredth of a pixel (focal length 171 px).
            let p = Geodetic::from_ecef(eye + ray(&camera, at) * range);
            let height = (p.height_ellipsoid.0 - surface_m(&booth, &p)).abs();
            let near_silhouette = (range - truth).abs() > 20.0;
            assert!(
                height < height_m || (range - truth).abs() < 1e-5 * range || near_silhouette,
                "{height} m at {range} m, truth {truth}"
            );
            compared += usize::from(!near_silhouette);
        }
    }
    assert!(compared > 300, "{compared}");
}

/// The sea's limb, pixel by pixel, against the ellipsoid: the geoid of the stand-in stays within 40 m.
#[test]
fn the_sea_ends_where_the_ellipsoid_does() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let mut booth = Booth::new(&gpu, 255, Arc::new(Land::new(1200, sea)));
    for (lat, lon, height, attitude) in [
        (0.0, 0.0, 300.0, (10.0, 0.0, 0.0)),
        (46.0, 8.0, 3000.0, (120.0, -3.0, 25.0)),
        (-60.0, 179.9, 12_000.0, (90.0, -5.0, -70.0)),
        (10.0, -30.0, 18_000.0, (270.0, -4.0, 180.0)),
    ] {
        let camera = camera(Geodetic::from_degrees(lat, lon, height), attitude, 40.0);
        booth.settle(&camera);
        let ranges = booth.ranges();
        let hits = ranges.iter().filter(|r| r.is_finite()).count();
        assert!(hits > 0 && hits < ranges.len(), "sea and sky: {camera:?}");
        for (at, range) in ranges.iter().enumerate() {
            if meets_earth(&camera, at, -41.0) {
                assert!(range.is_finite(), "sky below the limb: {at} {camera:?}");
            }
            if !meets_earth(&camera, at, 41.0) {
                assert!(range.is_infinite(), "sea above the limb: {at} {camera:?}");
            }
        }
    }
}

/// How many pixels show something else.
fn different(some: &[f32], others: &[f32]) -> usize {
    let differ = |(a, b): &(&f32, &f32)| {
        let near = a.min(**b);
        a.is_finite() != b.is_finite() || (*a - *b).abs() > 2e-4 * near
    };
    some.iter().zip(others).filter(differ).count()
}

/// What is left out behind nearer ground changes no picture: at most the odd pixel on a side that two triangles share, which
/// another order of drawing gives to the other one; and two surfaces that depth cannot tell apart may change places: those
/// nearer to each other than 1.4e-4 of their range ([`glasswing::terrain::slices`]). Whoever draws hidden blocks too has other
/// planes and hence other depths.
#[test]
fn what_is_left_out_behind_ridges_would_not_have_shown() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let mut dice = Dice(23);
    let (mut left_out, mut all) = (0, 0);
    for (formula, vertices) in [(mountains as Formula, 255), (cliffs, 127), (mountains, 63)] {
        let mut lazy = Booth::new(&gpu, vertices, Arc::new(Land::new(1200, formula)));
        let mut busy = Booth::with(
            &gpu,
            Settings {
                leaves_out_hidden: false,
                ..settings(vertices)
            },
            Arc::new(Land::new(1200, formula)),
        );
        for k in 0..poses(9) {
            let near = [(-32.6, -70.3), (46.0, 8.0), (82.0, 30.0)][k % 3];
            let mut camera = pose(&mut dice, &mut lazy, near, 2.0);
            camera.attitude.pitch = Radians::from_degrees(dice.between(-25.0, 10.0));
            left_out += lazy.settle(&camera).triangles;
            all += busy.settle(&camera).triangles;
            // Then on the way, while the eye turns: what was learned of the last frame's ridges serves the next.
            for _ in 0..poses(4) {
                let wrong = different(&lazy.ranges(), &busy.ranges());
                assert!(
                    wrong <= 1,
                    "{wrong} pixels, {vertices} vertices, {camera:?}"
                );
                camera.eye.latitude.0 += 2e-5;
                camera.attitude.heading_true.0 += 0.07;
                lazy.settle(&camera);
                busy.settle(&camera);
            }
        }
    }
    // In one pose and another nothing may be hidden.
    assert!(left_out < all, "{left_out} of {all} triangles");
}

#[test]
fn a_picture_does_not_depend_on_which_textures_were_written_when() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let land = || Arc::new(Land::new(1200, mountains));
    let at = |k: u32| {
        let k = f64::from(k);
        let eye = Geodetic::from_degrees(46.0 + 0.002 * k, 8.0 - 0.003 * k, 6500.0);
        camera(eye, (40.0 * k, -30.0, 3.0 * k), 60.0)
    };
    let picture = |booth: &mut Booth, k: u32| {
        booth.settle(&at(k));
        booth.holes(&at(k), LOWEST_M);
        booth.pixels.clone()
    };
    // One has flown elsewhere before, drawing every frame.
    let mut flown = Booth::new(&gpu, 127, land());
    for k in 0..10 {
        let mut camera = at(k);
        camera.eye.longitude.0 += 0.5;
        flown.settle(&camera);
        flown.holes(&camera, LOWEST_M);
    }
    let mut fresh = Booth::new(&gpu, 127, land());
    for k in 0..if is_emulated() { 3 } else { 12 } {
        assert_eq!(picture(&mut flown, k), picture(&mut fresh, k), "step {k}");
    }
}
