//! What `glasswing measure accuracy` measures, in small: positions read back from the vertex shader, and views without
//! holes.
#![expect(clippy::expect_used, reason = "a test: what fails must say so")]

mod support;

use glasswing::app::measure::bench::Bench;
use glasswing::app::measure::{position, watertight};
use glasswing::gl::Gpu;
use glasswing::terrain::clipmap::Shape;
use glasswing::terrain::planet::{Kind, Planet};
use std::sync::Arc;

#[test]
fn the_vertex_shader_is_exact_to_a_thousandth_of_a_pixel_at_every_hard_case() {
    let screen = support::headless_screen(16, 16);
    let gpu = Gpu::new(&|name| screen.gl_proc(name)).expect("a GL context");
    let planet = Arc::new(Planet::new(Kind::Earth, 1200));
    let shape = Shape::new(127).expect("a legal shape");
    let mut bench = Bench::new(&gpu, &planet, shape).expect("a renderer");
    let (cases, levels) = position::all_cases(&mut bench, &mut |_, _| ()).expect("measures");
    for (name, e) in &cases {
        println!(
            "{name:40} {:9.6} px {:9.6} m {:9.6} px projected, {} vertices",
            e.px, e.m, e.projected_px, e.vertices
        );
    }
    for (level, e) in levels.iter().enumerate() {
        println!(
            "level {level} {:9.6} px {:9.6} m, {} vertices",
            e.px, e.m, e.vertices
        );
    }
    for (name, e) in &cases {
        assert!(e.px <= 0.001, "{name}: {e:?}");
    }
}

#[test]
fn no_random_view_shows_the_sky_through_the_ground() {
    let screen = support::headless_screen(16, 16);
    let gpu = Gpu::new(&|name| screen.gl_proc(name)).expect("a GL context");
    let shape = Shape::new(127).expect("a legal shape");
    let poses = if support::is_emulated() { 16 } else { 320 };
    let found = watertight::on_planets(&gpu, shape, poses, &mut |_| ()).expect("measures");
    println!("{found:?}");
    assert!(found.poses >= poses, "{}", found.poses);
    assert_eq!(found.holes, 0, "{:#?}", found.where_);
}
