//! Positions against a table of 50 digits (tests/numerics/geodesy50.py makes it): the geodesy in f64 that everything else is
//! measured with, the tables that the vertex shader is given, and what the shader makes of them.
#![expect(
    clippy::expect_used,
    clippy::cast_possible_truncation,
    reason = "a test: what fails must say so; f32 arithmetic is emulated"
)]

mod support;

use glam::DVec3;
use glasswing::app::measure::bench::{Bench, camera};
use glasswing::app::measure::position::{cells, each_vertex, on_normal};
use glasswing::geo::Geodetic;
use glasswing::gl::Gpu;
use glasswing::terrain::clipmap::Shape;
use glasswing::terrain::grid::Grid;
use glasswing::terrain::partition::Partition;
use glasswing::terrain::planet::{Kind, Planet};
use serde::Deserialize;
use std::collections::HashMap;
use std::sync::Arc;

#[derive(Deserialize)]
struct Table {
    sites: Vec<Site>,
}

#[derive(Deserialize)]
struct Site {
    name: String,
    partition: String,
    posts_per_degree: u32,
    eye_deg_deg_m: [f64; 3],
    ground_m: f64,
    posts: Vec<Post>,
}

#[derive(Deserialize)]
struct Post {
    i: i32,
    j: i32,
    eye_to_vertex_m: [String; 3],
}

impl Site {
    fn partition(&self) -> Partition {
        match self.partition.as_str() {
            "north" => Partition::North,
            "south" => Partition::South,
            _ => Partition::Geographic,
        }
    }

    fn eye(&self) -> Geodetic {
        let [lat, lon, height] = self.eye_deg_deg_m;
        Geodetic::from_degrees(lat, lon, height)
    }
}

impl Post {
    fn eye_to_vertex_m(&self) -> DVec3 {
        let digits = |k: usize| self.eye_to_vertex_m[k].parse().expect("a number");
        DVec3::new(digits(0), digits(1), digits(2))
    }
}

fn table() -> Table {
    serde_json::from_str(include_str!("numerics/geodesy50.json")).expect("the table")
}

#[test]
fn geodesy_in_64_bits_agrees_with_50_digits_to_nanometres() {
    let (mut worst, mut count) = (0.0_f64, 0);
    for site in table().sites {
        let grid = Grid {
            posts_per_degree: site.posts_per_degree,
        };
        let eye = site.eye().to_ecef();
        for post in &site.posts {
            let (lon, lat) = (grid.longitude_deg(0, post.i), grid.latitude_deg(0, post.j));
            let n = site.partition().normal(lon, lat);
            let error = (on_normal(n, site.ground_m) - eye - post.eye_to_vertex_m()).length();
            worst = worst.max(error);
            count += 1;
            // Coordinates of 6.4e6 m have steps of 0.93 nm: two roundings of three coordinates each, and those of angles.
            assert!(error < 5e-9, "{}: {error} m", site.name);
        }
    }
    println!("{count} positions, {worst:e} m at most");
    assert!(count >= 200, "{count}");
}

#[test]
fn what_the_vertex_shader_puts_out_agrees_with_50_digits() {
    let screen = support::headless_screen(16, 16);
    let gpu = Gpu::new(&|name| screen.gl_proc(name)).expect("a GL context");
    let shape = Shape::new(127).expect("a legal shape");
    let (mut worst_px, mut read_back) = (0.0_f64, 0);
    for site in table().sites {
        let height = site.ground_m as i16;
        let planet = Planet::new(Kind::Plain(height), site.posts_per_degree).without_geoid();
        let mut bench = Bench::new(&gpu, &Arc::new(planet), shape).expect("a renderer");
        let [lat, lon, height_m] = site.eye_deg_deg_m;
        let mut found: HashMap<usize, f64> = HashMap::new();
        for heading in [0.0, 90.0, 180.0, 270.0] {
            let view = camera(
                (lat, lon, height_m),
                (heading, -20.0, 0.0),
                120.0,
                (400, 400),
            );
            bench.settle(&view).expect("settles");
            assert_eq!(bench.partition(), Some(site.partition()), "{}", site.name);
            let scene = bench.terrain.scene().expect("drawn");
            let windows: Vec<_> = scene
                .plan()
                .levels
                .iter()
                .map(|l| (l.level, l.window))
                .collect();
            let turn = scene.grid().posts_around();
            each_vertex(&mut bench, &mut |level, _, vertex| {
                let (_, window) = windows
                    .iter()
                    .find(|w| w.0 == level)
                    .expect("a drawn level");
                let [x, y] = vertex.cell.map(cells);
                let at = ((window.i + x) << level, (window.j + y) << level);
                for (k, post) in site.posts.iter().enumerate() {
                    if at.1 == post.j && (at.0 - post.i) % turn == 0 {
                        let truth = post.eye_to_vertex_m();
                        let drawn = DVec3::from_array(vertex.position_m.map(f64::from));
                        let px = (drawn - truth).length() / truth.length() * 935.0;
                        let so_far = found.entry(k).or_insert(0.0);
                        *so_far = so_far.max(px);
                    }
                }
            })
            .expect("vertices");
        }
        for px in found.values() {
            worst_px = worst_px.max(*px);
            assert!(*px <= 0.001, "{}: {px} px", site.name);
        }
        read_back += found.len();
    }
    println!("{read_back} positions read back, {worst_px} px at most");
    // What is beyond the horizon is not drawn.
    assert!(read_back >= 140, "{read_back} of 216");
}
