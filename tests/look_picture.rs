//! What lies on the ground, pixel by pixel: the colours of terrain awareness against the heights behind the pixels, and
//! the lines of the grid against their longitudes and latitudes.
#![expect(
    clippy::expect_used,
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a test: numbers are small and what fails must say so"
)]

mod clipmap_support;

use clipmap_support::booth::{Booth, HEIGHT, WIDTH, camera, ray};
use clipmap_support::{Land, gpu, mountains};
use glasswing::geo::{Camera, Geodetic};
use glasswing::gl::look::{Lines, Look, Palette};
use glasswing::terrain::codec::SurfaceKind;
use glasswing::units::Metres;
use std::sync::Arc;

/// Ground behind a pixel, from its distance.
fn ground(camera: &Camera, at: usize, range_m: f32) -> Option<Geodetic> {
    let range_m = f64::from(range_m);
    range_m
        .is_finite()
        .then(|| Geodetic::from_ecef(camera.eye.to_ecef() + ray(camera, at) * range_m))
}

fn draw(booth: &mut Booth, look: &Look) -> Vec<[u8; 3]> {
    booth.target.bind();
    booth.gpu.clear([0.0, 0.0, 0.0, 1.0]);
    booth.terrain.draw(look);
    booth.target.read_rgba(&mut booth.pixels);
    booth.gpu.check("while drawing").expect("no GL error");
    let pixels = booth.pixels.chunks_exact(4);
    pixels.map(|p| [p[0], p[1], p[2]]).collect()
}

/// A height so far up that this share of the ground in the picture lies below the warning, metres.
fn above_share_m(camera: &Camera, ranges: &[f32], share: f64) -> f64 {
    let mut heights: Vec<f64> = (0..ranges.len())
        .filter_map(|at| ground(camera, at, ranges[at]))
        .map(|g| g.height_ellipsoid.0)
        .collect();
    heights.sort_by(f64::total_cmp);
    heights[(heights.len() as f64 * share) as usize] + 30.48
}

fn is_red([r, g, b]: [u8; 3]) -> bool {
    u32::from(r) > 2 * u32::from(g) && r > b
}

fn is_yellow([r, g, b]: [u8; 3]) -> bool {
    2 * u32::from(r.min(g)) > 3 * u32::from(b) && 2 * u32::from(g) > u32::from(r)
}

#[test]
fn ground_is_red_from_100_ft_below_and_yellow_from_1000_ft_below() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let mut booth = Booth::new(&gpu, 127, Arc::new(Land::new(1200, mountains)));
    for (share, palette) in [
        (0.6, Palette::Day),
        (0.9, Palette::Day),
        (0.6, Palette::Night),
    ] {
        let eye = Geodetic::from_degrees(20.3, 30.4, 3600.0);
        let camera = camera(eye, (40.0, -20.0, 0.0), 60.0);
        booth.settle(&camera);
        let ranges = booth.ranges();
        let height_m = above_share_m(&camera, &ranges, share);
        let look = Look {
            awareness: Some(Metres(height_m)),
            palette,
            ..Look::BARE
        };
        let coloured = draw(&mut booth, &look);
        let bare = draw(
            &mut booth,
            &Look {
                awareness: None,
                ..look
            },
        );
        let width = WIDTH as usize;
        let (mut red, mut yellow, mut none, mut dark) = (0, 0, 0, 0);
        for (at, (&pixel, &before)) in coloured.iter().zip(&bare).enumerate() {
            let Some(point) = ground(&camera, at, ranges[at]) else {
                continue;
            };
            let below_ft = (height_m - point.height_ellipsoid.0) / 0.3048;
            // The limits themselves are dark lines, two pixels wide.
            let around = [
                at.wrapping_sub(1),
                at + 1,
                at.wrapping_sub(width),
                at + width,
            ];
            let spread_ft = around
                .into_iter()
                .filter_map(|n| ground(&camera, n, *ranges.get(n)?))
                .map(|g| (g.height_ellipsoid.0 - point.height_ellipsoid.0).abs() / 0.3048)
                .fold(20.0, f64::max);
            let near = [100.0, 1000.0]
                .iter()
                .any(|limit| (below_ft - limit).abs() < 3.0 * spread_ft);
            if near {
                continue;
            }
            let what = format!("{below_ft} ft below, {before:?} drawn {pixel:?}, {palette:?}");
            if below_ft < 100.0 {
                assert!(is_red(pixel), "{what}");
                red += 1;
            } else if below_ft < 1000.0 {
                assert!(is_yellow(pixel) && !is_red(pixel), "{what}");
                yellow += 1;
            } else {
                // Within a steep triangle a limit's dark line may reach beyond its neighbours' heights.
                let darker = (0..3).all(|k| pixel[k] <= before[k]) && !is_red(pixel);
                assert!(darker, "{what}");
                none += u32::from(pixel == before);
                dark += u32::from(pixel != before);
            }
        }
        assert!(
            red > 100 && yellow > 40 && none > 100 + 10 * dark,
            "{red} {yellow} {none} {dark}"
        );
    }
}

#[test]
fn a_warning_is_told_from_a_caution_without_its_colour() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let level = |_: i32, _: i32| (1000.0, SurfaceKind::Land);
    let mut booth = Booth::new(&gpu, 127, Arc::new(Land::new(1200, level)));
    let eye = Geodetic::from_degrees(20.3, 30.4, 2000.0);
    let camera = camera(eye, (40.0, -60.0, 0.0), 40.0);
    booth.settle(&camera);
    // The geoid of this land lies within 40 m of the ellipsoid.
    let mut shades = |height_m: f64| {
        let look = Look {
            awareness: Some(Metres(height_m)),
            ..Look::BARE
        };
        let red = draw(&mut booth, &look).into_iter().map(|p| p[0]);
        let (low, high) = red.fold((255, 0), |(low, high), r| (low.min(r), high.max(r)));
        u32::from(high) - u32::from(low)
    };
    let (warned, cautioned) = (shades(900.0), shades(1200.0));
    assert!(warned > 50, "barred: {warned}");
    assert!(cautioned < 20, "plain: {cautioned}");
}

#[test]
fn a_night_is_a_third_as_bright() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let mut booth = Booth::new(&gpu, 127, Arc::new(Land::new(1200, mountains)));
    let camera = camera(
        Geodetic::from_degrees(20.3, 30.4, 3600.0),
        (40.0, -20.0, 0.0),
        60.0,
    );
    booth.settle(&camera);
    let mut sum = |palette| {
        let look = Look {
            palette,
            ..Look::FLIGHT
        };
        let pixels = draw(&mut booth, &look);
        pixels.iter().flatten().map(|&v| u32::from(v)).sum::<u32>()
    };
    let (day, night) = (sum(Palette::Day), sum(Palette::Night));
    assert!(
        (0.30..0.45).contains(&(f64::from(night) / f64::from(day))),
        "{night} of {day}"
    );
}

#[test]
fn lines_run_along_whole_minutes_and_nowhere_else() {
    let (gpu, _screen) = gpu(WIDTH, HEIGHT);
    let mut booth = Booth::new(&gpu, 127, Arc::new(Land::new(1200, mountains)));
    // One of them over the date line.
    for (latitude, longitude) in [(20.3, 30.4), (-50.02, 179.99)] {
        let eye = Geodetic::from_degrees(latitude, longitude, 5000.0);
        let camera = camera(eye, (40.0, -50.0, 0.0), 50.0);
        booth.settle(&camera);
        let ranges = booth.ranges();
        let lines = Lines::at(Metres(5000.0), None);
        let bare = draw(&mut booth, &Look::BARE);
        let lined = draw(
            &mut booth,
            &Look {
                lines: Some(lines),
                ..Look::BARE
            },
        );
        let minutes = f64::from(lines.minutes());
        let place = |at: usize| {
            ground(&camera, at, ranges[at])
                .map(|g| [g.longitude, g.latitude].map(|a| a.to_degrees() * 60.0 / minutes))
        };
        let width = WIDTH as usize;
        let (mut on, mut off) = (0, 0);
        for at in (0..bare.len()).filter(|at| (2..width - 2).contains(&(at % width))) {
            if at < 2 * width || at + 2 * width >= bare.len() {
                continue;
            }
            let change: u32 = (0..3)
                .map(|k| u32::from(bare[at][k].abs_diff(lined[at][k])))
                .sum();
            // Whether a line passes within two pixels to each side.
            let around = [at - 2 * width, at - 2, at, at + 2, at + 2 * width].map(place);
            let Some(around) = around.into_iter().collect::<Option<Vec<_>>>() else {
                continue;
            };
            let passes = (0..2).any(|axis| {
                let floors = around.iter().map(|p| p[axis].floor());
                floors
                    .clone()
                    .any(|f| (f - around[2][axis].floor()).abs() > 0.5)
            });
            if change > 12 {
                assert!(passes, "a line at {:?} of {minutes}'", around[2]);
                on += 1;
            }
            off += usize::from(!passes);
        }
        assert!(on > 200 && off > 1000, "{on} pixels on lines, {off} off");
    }
}
