//! Streaming within its means: quotas that are held whatever the eye does, levels that are left out where they could not keep
//! up, requests of places that were left, and how soon everything is there after a leap.
#![expect(clippy::expect_used, reason = "a test: what fails must say so")]

mod clipmap_support;

use clipmap_support::{Land, mountains, sea, support};
use glasswing::app::measure::speed::Nowhere;
use glasswing::geo::{Attitude, Camera, Geodetic};
use glasswing::terrain::clipmap::Shape;
use glasswing::terrain::grid::TileKey;
use glasswing::terrain::partition::Partition;
use glasswing::terrain::scene::{FrameFigures, Scene, Settings};
use glasswing::time::Monotonic;
use glasswing::units::Radians;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Texels a frame.
const QUOTA: usize = 65_536;

fn camera(lat: f64, lon: f64, height: f64) -> Camera {
    Camera {
        eye: Geodetic::from_degrees(lat, lon, height),
        attitude: Attitude::from_degrees(30.0, -5.0, 0.0),
        hfov: Radians::from_degrees(60.0),
        width_px: 640,
        height_px: 400,
    }
}

fn scene(vertices: u32, decode_samples_per_frame: u32, land: Land) -> Scene {
    let settings = Settings {
        decode_samples_per_frame,
        ..Settings::from(Shape::new(vertices).expect("a legal shape"))
    };
    Scene::new(Arc::new(land), Partition::Geographic, settings).expect("a thread")
}

/// A frame, and time for the streaming thread.
fn frame(scene: &mut Scene, camera: &Camera, pause_ms: u64) -> FrameFigures {
    scene.frame(camera, QUOTA, &mut Nowhere).expect("a camera");
    std::thread::park_timeout(Duration::from_millis(pause_ms));
    scene.figures()
}

/// Frames until all is there.
fn settle(scene: &mut Scene, camera: &Camera, each: &mut dyn FnMut(&FrameFigures)) -> u32 {
    let begun = Monotonic::read();
    for frames in 1.. {
        let figures = frame(scene, camera, 1);
        each(&figures);
        if figures.settled {
            return frames;
        }
        let waited = Monotonic::read().since(begun).unwrap_or_default();
        assert!(waited < Duration::from_secs(120), "settles: {figures:?}");
    }
    0
}

#[test]
fn no_frame_decodes_more_than_it_may_and_everything_still_comes() {
    let mut scene = scene(127, 2 * 16_384, Land::new(1200, mountains));
    let (mut most, mut all) = (0, 0);
    let mut count = |figures: &FrameFigures| {
        most = most.max(figures.decoded_samples);
        all += u64::from(figures.decoded_samples);
        assert!(figures.uploads_texels <= QUOTA, "{figures:?}");
    };
    settle(&mut scene, &camera(46.0, 8.0, 3000.0), &mut count);
    settle(&mut scene, &camera(-20.0, 100.0, 3000.0), &mut count);
    assert!((16_384..=2 * 16_384).contains(&most), "{most}");
    // Seven levels or more, each on 2 x 2 tiles at least, twice.
    assert!(all >= 2 * 7 * 4 * 16_384, "{all}");
}

#[test]
fn a_leap_is_refilled_within_fifteen_frames() {
    // Land that costs nothing to make, as a pack's tiles cost little to decode.
    let mut scene = scene(255, 131_072, Land::new(1200, sea));
    settle(&mut scene, &camera(46.0, 8.0, 3000.0), &mut |_| ());
    // By way of somewhere else: two leaps in two frames are no speed either.
    frame(&mut scene, &camera(20.0, -60.0, 3000.0), 150);
    let there = camera(-20.0, 100.0, 3000.0);
    let mut frames = 1;
    // Slow enough for an unoptimised streaming thread on a busy machine: what is counted is what quotas and queues take.
    while !frame(&mut scene, &there, 150).settled && frames < 200 {
        frames += 1;
    }
    let figures = scene.figures();
    assert!(
        figures.settled && figures.levels_wanted.1 >= 6,
        "{figures:?}"
    );
    if support::is_emulated() {
        support::skip("the number of frames depends on the machine");
    } else {
        assert!(frames <= 15, "{frames} frames");
    }
}

#[test]
fn an_eye_that_is_too_fast_loses_the_finest_levels_and_keeps_the_rest() {
    let mut scene = scene(127, 131_072, Land::new(1200, sea));
    settle(&mut scene, &camera(10.0, 10.0, 2000.0), &mut |_| ());
    // 24 posts of level 0 a frame: 48 would be a leap, 5 is what strips can follow.
    let mut lon = 10.0;
    let mut fly = |posts: f64, frames: usize| -> FrameFigures {
        let mut figures = FrameFigures::default();
        for _ in 0..frames {
            lon += posts / 1200.0;
            figures = frame(&mut scene, &camera(10.0, lon, 2000.0), 5);
            assert!(
                figures.levels.is_some(),
                "something is always drawn: {figures:?}"
            );
        }
        figures
    };
    let fast = fly(24.0, 60);
    let finest = fast.errands.finest;
    assert!((2..=4).contains(&finest), "{fast:?}");
    let drawn = fast.levels.expect("levels");
    assert!(
        drawn.0 <= finest + 1 && drawn.1 == fast.levels_wanted.1,
        "{fast:?}"
    );
    // Slow again: all of them are back.
    let slow = fly(0.02, 40);
    assert_eq!(slow.errands.finest, slow.levels_wanted.0);
    settle(&mut scene, &camera(10.0, lon, 2000.0), &mut |_| ());
}

#[test]
fn what_was_asked_for_a_place_that_was_left_is_dropped() {
    let mut scene = scene(127, 16_384, Land::new(1200, mountains));
    for leap in 0..12 {
        let lon = f64::from(leap) * 25.0 - 170.0;
        frame(&mut scene, &camera(46.0, lon, 3000.0), 0);
    }
    settle(&mut scene, &camera(46.0, 8.0, 3000.0), &mut |_| ());
    assert!(
        scene.figures().errands.dropped > 20,
        "{:?}",
        scene.figures()
    );
}

/// Whether the tile east of the flight has been read: columns 12160 to 12287 of level 0.
static SEEN_AHEAD: AtomicBool = AtomicBool::new(false);

fn note(key: TileKey) -> bool {
    if (key.level, key.column) == (0, 95) {
        SEEN_AHEAD.store(true, Ordering::Release);
    }
    false
}

#[test]
fn tiles_ahead_of_a_flight_are_at_hand_before_they_are_wanted() {
    let mut scene = scene(127, 131_072, Land::new(1200, sea).broken(note));
    settle(&mut scene, &camera(10.0, 10.0, 2000.0), &mut |_| ());
    assert!(
        !SEEN_AHEAD.load(Ordering::Acquire),
        "the window ends at column 12063"
    );
    // Half a post a frame to the east: the window ends 40 posts before that tile.
    for step in 0..110 {
        let lon = 10.0 + f64::from(step) * 0.5 / 1200.0;
        frame(&mut scene, &camera(10.0, lon, 2000.0), 4);
    }
    settle(
        &mut scene,
        &camera(10.0, 10.0 + 55.0 / 1200.0, 2000.0),
        &mut |_| (),
    );
    assert!(
        SEEN_AHEAD.load(Ordering::Acquire),
        "fetched before it is wanted"
    );
}
