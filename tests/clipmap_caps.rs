//! The poles, the seams between partitions, the date line and the equator: distances against the formula the ground is made
//! of, pictures from both partitions against each other, and what flying over a seam does.
#![expect(
    clippy::expect_used,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "a test: numbers are small and what fails must say so"
)]

mod clipmap_support;

use clipmap_support::booth::{Booth, HEIGHT, WIDTH, camera, meets_earth, ray};
use clipmap_support::earth::{Earth, above_ground_m};
use clipmap_support::support::is_emulated;
use clipmap_support::{Dice, gpu};
use glasswing::geo::{Camera, Geodetic};
use glasswing::gl::Gpu;
use glasswing::gl::look::Look;
use glasswing::heap;
use glasswing::terrain::partition::{Partition, SEAM_LATITUDE_DEG};
use glasswing::terrain::scene::Scene;
use glasswing::time::Monotonic;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

/// No ground is lower: the formula stays above 0, its geoid above -35 m.
const LOWEST_M: f64 = -36.0;

fn earth() -> Arc<Earth> {
    Arc::new(Earth::new(1200, [true; 3]))
}

/// A place at a height above the formula's ground.
fn over(lat: f64, lon: f64, above_m: f64) -> Geodetic {
    let mut place = Geodetic::from_degrees(lat, lon, 0.0);
    place.height_ellipsoid.0 = above_m - above_ground_m(place.to_ecef());
    place
}

/// The worst deviation of a picture's surface from the formula's, and of the formula's first crossing before it, across
/// the line of sight in pixels; and how many pixels show ground.
fn deviation_px(camera: &Camera, ranges: &[f32], stride: usize) -> (f64, usize) {
    let eye = camera.eye.to_ecef();
    let mut worst: f64 = 0.0;
    let mut hits = 0;
    for at in (0..ranges.len()).step_by(stride) {
        let (direction, range) = (ray(camera, at), f64::from(ranges[at]));
        let shown = range.is_finite();
        let px = |above_m: f64, t: f64| above_m * camera.focal_px() / t;
        if shown {
            hits += 1;
            worst = worst.max(px(above_ground_m(eye + direction * range), range).abs());
        }
        // Nothing of the formula's ground is nearer, or there at all.
        let end = if shown { range } else { 600_000.0 };
        let mut t = 5.0;
        while t < end {
            worst = worst.max(px(-above_ground_m(eye + direction * t), t));
            t *= 1.03;
        }
    }
    (worst, hits)
}

#[test]
fn distances_agree_with_the_formula_at_the_poles_the_seams_the_date_line_and_the_equator() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let mut booth = Booth::new(&gpu, 191, earth());
    let places = [
        (90.0, 0.0),
        (-90.0, 0.0),
        (90.0 - 1e-6_f64.to_degrees(), 123.0),
        (89.999, -60.0),
        (-89.999, 45.0),
        (80.0, 180.0),
        (SEAM_LATITUDE_DEG + 0.3, 25.0),
        (SEAM_LATITUDE_DEG - 0.3, 25.0),
        (-(SEAM_LATITUDE_DEG + 0.3), -115.0),
        (-(SEAM_LATITUDE_DEG - 0.3), -115.0),
        (0.0, 0.0),
        (0.001, 179.9999),
        (-45.0, -179.9999),
    ];
    let mut worst: f64 = 0.0;
    for (at, (lat, lon)) in places.into_iter().enumerate() {
        for (above, pitch) in [(40.0, -6.0), (3000.0, -12.0)] {
            let heading = 50.0 + 77.0 * at as f64;
            let camera = camera(over(lat, lon, above), (heading, pitch, 10.0), 60.0);
            let figures = booth.settle(&camera);
            assert_eq!(figures.partition, Some(Partition::at(lat, None)));
            let ranges = booth.ranges();
            let stride = if is_emulated() { 211 } else { 29 };
            let (px, hits) = deviation_px(&camera, &ranges, stride);
            assert!(hits > ranges.len() / stride / 4, "ground is seen: {hits}");
            println!("{lat} {lon} {above} m: {px:.3} px");
            worst = worst.max(px);
        }
    }
    assert!(worst < 0.6, "{worst} px");
}

/// The same pose drawn by the cap and by the geographic partition.
fn both(booth: &mut Booth, camera: &Camera) -> [(Vec<f32>, Vec<u8>); 2] {
    let sign = camera.eye.latitude.0.signum();
    [SEAM_LATITUDE_DEG + 0.4, SEAM_LATITUDE_DEG - 0.4].map(|from| {
        let mut before = *camera;
        before.eye = over(sign * from, camera.eye.longitude.to_degrees(), 3000.0);
        booth.settle(&before);
        let figures = booth.settle(camera);
        let expected = if from > SEAM_LATITUDE_DEG {
            Partition::cap(sign)
        } else {
            Partition::Geographic
        };
        assert_eq!(figures.partition, Some(expected), "kept by hysteresis");
        let ranges = booth.ranges();
        assert_eq!(booth.holes(camera, LOWEST_M), 0, "holes");
        (ranges, booth.pixels.clone())
    })
}

#[test]
fn either_partition_draws_the_same_picture_on_the_seam() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let mut booth = Booth::new(&gpu, 239, earth());
    let views = [
        (SEAM_LATITUDE_DEG + 0.1, 25.0, 100.0, 0.0, -4.0),
        (SEAM_LATITUDE_DEG - 0.1, 25.0, 100.0, 250.0, -4.0),
        (SEAM_LATITUDE_DEG + 0.2, -140.0, 3000.0, 180.0, -8.0),
        (-(SEAM_LATITUDE_DEG + 0.1), 160.0, 3000.0, 90.0, -8.0),
        (-(SEAM_LATITUDE_DEG - 0.1), -60.0, 100.0, 300.0, -4.0),
        (SEAM_LATITUDE_DEG + 0.1, 11.0, 3000.0, 90.0, -6.0),
        (SEAM_LATITUDE_DEG - 0.1, -45.0, 3000.0, 270.0, -6.0),
        (-SEAM_LATITUDE_DEG, 100.0, 300.0, 90.0, -4.0),
        (SEAM_LATITUDE_DEG, 140.0, 10_000.0, 270.0, -8.0),
    ];
    let count = if is_emulated() { 4 } else { views.len() };
    for (lat, lon, above, heading, pitch) in views.into_iter().take(count) {
        let camera = camera(over(lat, lon, above), (heading, pitch, 0.0), 60.0);
        let [(cap, cap_rgb), (geo, geo_rgb)] = both(&mut booth, &camera);
        let eye = camera.eye.to_ecef();
        let (mut worst, mut sum, mut count, mut limb): (f64, f64, f64, usize) = (0.0, 0.0, 0.0, 0);
        for at in 0..cap.len() {
            let (a, b) = (f64::from(cap[at]), f64::from(geo[at]));
            if a.is_infinite() || b.is_infinite() || (a - b).abs() > 0.1 * a {
                // A silhouette passes through this pixel.
                limb += usize::from(a.is_finite() != b.is_finite() || a.is_finite());
                continue;
            }
            let height = |t: f64| above_ground_m(eye + ray(&camera, at) * t);
            let px = (height(a) - height(b)).abs() * camera.focal_px() / a;
            worst = worst.max(px);
            sum += px;
            count += 1.0;
        }
        let steps = cap_rgb.iter().zip(&geo_rgb).map(|(a, b)| a.abs_diff(*b));
        let mean_step = steps.clone().map(f64::from).sum::<f64>() / cap_rgb.len() as f64;
        let large = steps.filter(|s| *s > 16).count();
        println!(
            "{lat} {above} m {heading}: worst {worst:.3} px, mean {:.4} px, {limb} silhouette pixels, colours differ by {mean_step:.2} of 255 in the mean, {large} by more than 16",
            sum / count
        );
        assert!(worst < 0.5 && sum / count < 0.05, "{worst} px");
        assert!(mean_step < 1.0, "{mean_step}");
    }
}

#[test]
fn no_pose_around_the_poles_and_the_seams_shows_a_hole() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let mut dice = Dice(70);
    let sizes = [127, 239];
    for vertices in sizes.into_iter().take(if is_emulated() { 1 } else { 2 }) {
        let mut booth = Booth::new(&gpu, vertices, earth());
        for near in [90.0, -90.0, SEAM_LATITUDE_DEG, -SEAM_LATITUDE_DEG] {
            for _ in 0..if is_emulated() { 2 } else { 20 } {
                let lat: f64 = near + dice.between(-0.04, 0.04);
                let lat = if lat.abs() > 90.0 {
                    near.signum() * 180.0 - lat
                } else {
                    lat
                };
                // All longitudes are near each other at a pole.
                let around = if near.abs() < 90.0 { 0.1 } else { 180.0 };
                let lon = dice.between(-around, around);
                let above = 10_f64.powf(dice.between(0.0, 4.2));
                let attitude = (
                    dice.between(0.0, 360.0),
                    dice.between(-90.0, 15.0),
                    dice.between(-180.0, 180.0),
                );
                let fov = [2.0, 30.0, 60.0, 120.0][dice.between(0.0, 4.0) as usize];
                let camera = camera(over(lat, lon, above), attitude, fov);
                booth.settle(&camera);
                assert_eq!(booth.holes(&camera, LOWEST_M), 0, "{camera:?}");
            }
        }
    }
}

/// 250 m/s at 60 frames a second to the north, the change in the middle, at a height above the ground there.
fn crossing(above_m: f64) -> impl Fn(u32) -> Camera {
    let height_m = over(SEAM_LATITUDE_DEG + 0.25, 20.0, above_m)
        .height_ellipsoid
        .0;
    move |frame| {
        let lat = SEAM_LATITUDE_DEG + 0.25 + 3.735e-5 * (f64::from(frame) - 60.0);
        let eye = Geodetic::from_degrees(lat, 20.0, height_m);
        camera(eye, (0.0, -3.0, 0.0), 60.0)
    }
}

#[test]
fn flying_over_the_seam_changes_the_partition_once_and_not_the_picture() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let mut booth = Booth::new(&gpu, 127, earth());
    let quota = 20_000;
    for above_m in [100.0, 3000.0] {
        let at = crossing(above_m);
        booth.settle(&camera(
            over(SEAM_LATITUDE_DEG - 0.3, 20.0, 3000.0),
            (0.0, -3.0, 0.0),
            60.0,
        ));
        // An emulated machine flies the frames around the change only.
        let first = if is_emulated() { 55 } else { 0 };
        booth.settle(&at(first));
        let mut last = (Some(Partition::Geographic), None);
        let (mut steps, mut changed) = (Vec::with_capacity(10_000), Vec::with_capacity(10));
        let begun = Monotonic::read();
        for frame in first.. {
            // A slow machine hovers at the end until the other partition is there.
            let view = at(frame.min(119));
            let before = heap::allocations_of_this_thread();
            let figures = booth.prepare(&view, quota);
            let previous = booth.pixels.clone();
            assert_eq!(booth.holes(&view, LOWEST_M), 0, "frame {frame}");
            // One of the picture above, and one of the check for errors.
            let allocated = heap::allocations_of_this_thread() - before;
            assert!(
                frame < first + 10 || allocated <= 2,
                "{allocated} in frame {frame}"
            );
            assert!(figures.uploads_texels <= quota, "one quota for both");
            let now = (figures.partition, figures.levels.map(|l| l.0));
            if frame > first {
                let differences = booth.pixels.iter().zip(&previous);
                let sum: f64 = differences.map(|(a, b)| f64::from(a.abs_diff(*b))).sum();
                steps.push(sum / previous.len() as f64);
                if now.0 != last.0 {
                    changed.push(steps[steps.len() - 1]);
                    assert_eq!(now.1, last.1, "as fine as before");
                }
            }
            last = now;
            if frame >= 119 - first && !changed.is_empty() {
                break;
            }
            let waited = Monotonic::read().since(begun).unwrap_or_default();
            assert!(waited < Duration::from_secs(120), "changes");
            std::thread::park_timeout(Duration::from_millis(1));
        }
        assert_eq!((changed.len(), last.0), (1, Some(Partition::North)));
        steps.sort_by(f64::total_cmp);
        let (median, worst) = (steps[steps.len() / 2], steps[steps.len() - 2]);
        println!(
            "{above_m} m: colours move by {:.3} of 255 in the frame of the change, by {median:.3} in the median and {worst:.3} at most in another",
            changed[0]
        );
        assert!(changed[0] < 0.5, "{} of 255", changed[0]);
    }
}

/// A booth whose eye stands before the seam, with the other partition resident; and views from latitudes beside the seam.
fn before_the_seam(gpu: &Rc<Gpu>) -> (Booth, impl Fn(f64) -> Camera) {
    let mut booth = Booth::new(gpu, 127, earth());
    let height_m = over(SEAM_LATITUDE_DEG, 20.0, 150.0).height_ellipsoid.0 + 400.0;
    let at = move |past_deg: f64| {
        let eye = Geodetic::from_degrees(SEAM_LATITUDE_DEG + past_deg, 20.0, height_m);
        camera(eye, (0.0, -8.0, 0.0), 60.0)
    };
    for past_deg in [-0.2, 0.0, 0.15, 0.249] {
        booth.settle(&at(past_deg));
    }
    (booth, at)
}

/// Holds the clock and the eye until the partition has changed. Returns the frames' partition and what is left of the other.
fn change(booth: &mut Booth, view: &Camera, now: Monotonic) -> (Option<Partition>, Option<f64>) {
    let begun = Monotonic::read();
    let before = booth.terrain.scene().map(Scene::partition);
    loop {
        let figures = booth.terrain.prepare(view, now, 65_536).expect("a camera");
        if figures.partition != before {
            booth.show();
            return (figures.partition, booth.terrain.going());
        }
        let waited = Monotonic::read().since(begun).unwrap_or_default();
        assert!(waited < Duration::from_secs(120), "changes: {view:?}");
        std::thread::park_timeout(Duration::from_millis(1));
    }
}

const fn after(begin: Monotonic, milliseconds: u64) -> Monotonic {
    begin.plus(Duration::from_millis(milliseconds))
}

#[test]
fn one_partition_fades_into_the_other_by_equal_steps() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let (mut booth, at) = before_the_seam(&gpu);
    let begin = Monotonic::read();
    let view = at(0.251);
    let prepare = |booth: &mut Booth, milliseconds| {
        let now = after(begin, milliseconds);
        let before = heap::allocations_of_this_thread();
        let figures = booth.terrain.prepare(&view, now, 65_536);
        assert_eq!(
            heap::allocations_of_this_thread() - before,
            0,
            "{milliseconds} ms"
        );
        figures.expect("a camera")
    };
    let calls = booth.terrain.draw_calls();
    // No time has passed since.
    booth
        .terrain
        .prepare(&at(0.249), begin, 65_536)
        .expect("a camera");
    let began = change(&mut booth, &view, begin);
    assert_eq!(began, (Some(Partition::North), Some(1.0)), "as it was");
    let first = booth.pixels.clone();
    let (mut last, mut steps) = (first.clone(), Vec::new());
    let mut opacity = 1.0;
    for frame in 1..=12 {
        let figures = prepare(&mut booth, frame * 100);
        booth.show();
        assert_eq!(figures.partition, Some(Partition::North), "frame {frame}");
        let left = 1.0 - 0.1 * frame as f64;
        let going = booth.terrain.going().unwrap_or_default();
        assert!(
            (going - left.max(0.0)).abs() < 1e-6,
            "{going} in frame {frame}"
        );
        assert!(going < opacity || going <= 0.0, "fainter and fainter");
        opacity = going;
        assert!(going <= 0.0 || !figures.settled, "settled when it is over");
        assert!(
            booth.terrain.draw_calls() <= 3 * calls.max(8),
            "three passes"
        );
        steps.push(
            last.iter()
                .zip(&booth.pixels)
                .map(|(a, b)| a.abs_diff(*b))
                .collect::<Vec<u8>>(),
        );
        last.clone_from(&booth.pixels);
    }
    let whole: Vec<u8> = first
        .iter()
        .zip(&last)
        .map(|(a, b)| a.abs_diff(*b))
        .collect();
    let most = whole.iter().copied().max().unwrap_or_default();
    let changed = whole.iter().filter(|d| **d > 0).count();
    println!("{changed} bytes change, by {most} of 255 at most");
    assert!(most > 4, "there is something to fade: {most}");
    for (frame, step) in steps.iter().enumerate() {
        for (step, whole) in step.iter().zip(&whole) {
            // A tenth of it, and 1 for each of two roundings.
            let limit = f64::from(*whole) / 10.0 + 2.0;
            assert!(
                f64::from(*step) <= limit,
                "{step} of {whole} in frame {frame}"
            );
        }
    }
    assert!(steps[10..].iter().flatten().all(|d| *d == 0), "and it ends");
}

#[test]
fn a_fade_waits_for_its_clock_turns_back_with_the_eye_and_ends_with_a_leap() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let (mut booth, at) = before_the_seam(&gpu);
    let begin = Monotonic::read();
    let step = |booth: &mut Booth, past_deg: f64, milliseconds: u64| {
        let now = after(begin, milliseconds);
        let figures = booth.terrain.prepare(&at(past_deg), now, 65_536);
        let figures = figures.expect("a camera");
        booth.show();
        (figures.partition, booth.terrain.going())
    };
    let about = |(partition, going): (Option<Partition>, Option<f64>), wanted: (Partition, f64)| {
        assert_eq!(partition, Some(wanted.0), "{going:?}");
        let going = going.unwrap_or_default();
        assert!((going - wanted.1).abs() < 1e-6, "{going} for {}", wanted.1);
    };
    let (geographic, north) = (Partition::Geographic, Partition::North);
    about(step(&mut booth, 0.249, 0), (geographic, 0.0));
    about(
        change(&mut booth, &at(0.251), after(begin, 0)),
        (north, 1.0),
    );
    about(step(&mut booth, 0.251, 200), (north, 0.8));
    about(step(&mut booth, 0.251, 200), (north, 0.8));
    about(step(&mut booth, 0.251, 150), (north, 0.8));
    about(step(&mut booth, 0.251, 250), (north, 0.7));
    // As fast as is no leap, to the other side of the hysteresis: the cap goes from what there was of it.
    for past_deg in [0.1, -0.05, -0.2] {
        about(step(&mut booth, past_deg, 250), (north, 0.7));
    }
    about(
        change(&mut booth, &at(-0.26), after(begin, 250)),
        (geographic, 0.3),
    );
    about(step(&mut booth, -0.26, 350), (geographic, 0.2));
    about(step(&mut booth, -0.26, 450), (geographic, 0.1));
    about(step(&mut booth, -0.26, 600), (geographic, 0.0));
    for past_deg in [-0.1, 0.1, 0.24] {
        about(step(&mut booth, past_deg, 600), (geographic, 0.0));
    }
    about(
        change(&mut booth, &at(0.26), after(begin, 600)),
        (north, 1.0),
    );
    about(step(&mut booth, 0.26, 700), (north, 0.9));
    about(step(&mut booth, 1.26, 710), (north, 0.0));
    about(step(&mut booth, -0.5, 720), (geographic, 0.0));
}

#[test]
fn a_starved_eye_keeps_its_partition_and_a_leap_does_not() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let mut booth = Booth::new(&gpu, 127, earth());
    let at = |lat: f64| camera(over(lat, 20.0, 6000.0), (0.0, -20.0, 0.0), 60.0);
    booth.settle(&at(SEAM_LATITUDE_DEG - 1.0));
    for step in 0..15 {
        let camera = at(SEAM_LATITUDE_DEG - 1.0 + 0.1 * f64::from(step));
        let figures = booth.prepare(&camera, 0);
        assert_eq!(figures.partition, Some(Partition::Geographic), "{camera:?}");
        assert_eq!(booth.holes(&camera, LOWEST_M), 0, "{camera:?}");
    }
    let figures = booth.prepare(&at(80.0), 0);
    assert_eq!(
        (figures.partition, figures.levels),
        (Some(Partition::North), None)
    );
    let figures = booth.settle(&at(-80.0));
    assert_eq!(figures.partition, Some(Partition::South));
}

#[test]
fn without_posts_in_a_cap_there_is_no_terrain_and_that_is_said() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let mut booth = Booth::new(&gpu, 127, Arc::new(Earth::new(1200, [true, false, false])));
    let at = |lat: f64| camera(over(lat, 20.0, 1000.0), (0.0, -10.0, 0.0), 60.0);
    let figures = booth.settle(&at(SEAM_LATITUDE_DEG - 0.1));
    assert!(figures.triangles > 0);
    let figures = booth.settle(&at(SEAM_LATITUDE_DEG + 1.0));
    assert_eq!((figures.partition, figures.levels), (None, None));
    assert_eq!((figures.triangles, booth.terrain.draw_calls()), (0, 0));
    assert!(
        booth
            .terrain
            .ground(&at(SEAM_LATITUDE_DEG + 1.0).eye)
            .is_err()
    );
    booth.terrain.draw(&Look::FLIGHT);
    let figures = booth.settle(&at(SEAM_LATITUDE_DEG - 0.1));
    assert_eq!(
        figures.partition,
        Some(Partition::Geographic),
        "and comes back"
    );
}

#[test]
fn a_camera_of_no_numbers_changes_nothing_near_the_seam() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let mut booth = Booth::new(&gpu, 127, earth());
    let mut good = camera(
        over(SEAM_LATITUDE_DEG + 0.3, 20.0, 1000.0),
        (0.0, -10.0, 0.0),
        60.0,
    );
    booth.settle(&good);
    let draws = booth.terrain.draw_calls();
    good.attitude.roll.0 = f64::NAN;
    assert!(
        booth
            .terrain
            .prepare(&good, Monotonic::read(), 65_536)
            .is_err()
    );
    assert_eq!(booth.terrain.draw_calls(), draws);
    assert!(meets_earth(
        &camera(
            over(SEAM_LATITUDE_DEG + 0.3, 20.0, 1000.0),
            (0.0, -90.0, 0.0),
            60.0
        ),
        0,
        LOWEST_M
    ));
}
