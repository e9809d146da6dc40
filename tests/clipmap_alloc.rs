//! Once running, neither the frame nor the streaming thread allocates.

mod clipmap_support;

use clipmap_support::{Land, gpu, mountains};
use glasswing::geo::{Attitude, Camera, Geodetic};
use glasswing::gl::look::{Look, Palette};
use glasswing::gl::sky::SkyRenderer;
use glasswing::gl::target::Target;
use glasswing::gl::terrain::TerrainRenderer;
use glasswing::heap;
use glasswing::terrain::budget::Need;
use glasswing::terrain::clipmap::Shape;
use glasswing::terrain::partition::Partition;
use glasswing::terrain::scene::Settings;
use glasswing::terrain::surface::{Batch, Damage, Sampler, TileSource, cache_bytes};
use glasswing::terrain::tables::HeightCode;
use glasswing::terrain::worker::{Job, Parcel, Purpose, fill};
use glasswing::time::Monotonic;
use glasswing::units::Radians;
use std::sync::Arc;
use std::time::Duration;

#[test]
fn a_flight_with_a_teleport_allocates_nothing() {
    let (gpu, _screen) = gpu(64, 40);
    let land = Arc::new(Land::new(1200, mountains));
    let mut terrain = TerrainRenderer::new(&gpu, Settings::default(), land).expect("a renderer");
    let sky = SkyRenderer::new(&gpu).expect("a sky");
    let target = Target::offscreen(&gpu, 64, 40, 0).expect("a target");
    let mut fly = |frames: std::ops::Range<u32>| {
        for frame in frames {
            let along = f64::from(frame) * 0.002 + if frame > 90 { 7.0 } else { 0.0 };
            let camera = Camera {
                eye: Geodetic::from_degrees(10.0 + along, 20.0 - along, 8000.0),
                attitude: Attitude::from_degrees(f64::from(frame), -5.0, 10.0),
                hfov: Radians::from_degrees(60.0),
                width_px: 64,
                height_px: 40,
            };
            target.bind();
            gpu.clear([0.0; 4]);
            terrain
                .frame(&camera, Monotonic::read(), 65_536, &Look::FLIGHT)
                .expect("a camera");
            sky.draw(&camera, Palette::Day);
            std::thread::park_timeout(Duration::from_millis(2));
        }
    };
    fly(0..30);
    let before = heap::allocations_of_this_thread();
    fly(30..150);
    let after = heap::allocations_of_this_thread();
    assert_eq!(after - before, 0, "allocations in 120 frames");
}

#[test]
fn memory_is_what_was_worked_out_before_and_stays_that() {
    let (gpu, _screen) = gpu(64, 40);
    let land = Arc::new(Land::new(1200, mountains));
    for vertices in [63, 127] {
        let shape = Shape::new(vertices).expect("a legal shape");
        let need = Need {
            globe_bytes: 0,
            ..Need::of(land.info(), shape)
        };
        let allowed = need.fixed_bytes() + cache_bytes(40);
        let settings = need.settings(shape.into(), allowed).expect("enough");
        assert_eq!(settings.tiles_kept, 40);
        let mut terrain =
            TerrainRenderer::new(&gpu, settings, Arc::clone(&land)).expect("a renderer");
        for step in 0..20 {
            let camera = Camera {
                eye: Geodetic::from_degrees(10.0 + f64::from(step), 20.0, 8000.0),
                attitude: Attitude::from_degrees(0.0, -5.0, 0.0),
                hfov: Radians::from_degrees(60.0),
                width_px: 64,
                height_px: 40,
            };
            let figures = terrain.prepare(&camera, Monotonic::read(), 65_536);
            let bytes = figures.expect("a camera").resident_bytes;
            assert_eq!(bytes, allowed, "{vertices} vertices");
        }
    }
}

#[test]
fn filling_batches_allocates_nothing() {
    let land = Land::new(1200, mountains).broken(|key| key.column % 5 == 0);
    let damage = Damage::default();
    let shape = Shape::new(255).expect("a legal shape");
    let mut sampler = Sampler::new(
        &land,
        Partition::Geographic,
        HeightCode::covering(-500.0, 7000.0),
        &damage,
    );
    let mut parcel = Parcel {
        job: Job {
            partition: Partition::Geographic,
            level: 0,
            generation: 0,
            i: 215_900,
            j: -70,
            width: 16,
            height: 255,
            purpose: Purpose::Show,
            rank: 0,
        },
        batch: Box::new(Batch::new()),
        unread: false,
    };
    let before = heap::allocations_of_this_thread();
    for level in 0..8 {
        parcel.job.level = level;
        parcel.job.i += 999;
        fill(&mut sampler, shape, &mut parcel);
    }
    assert_eq!(
        heap::allocations_of_this_thread() - before,
        0,
        "allocations in 8 batches"
    );
}
