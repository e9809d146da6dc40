//! `glasswing shot` on real elevation: the distances it writes against a ray cast in f64 through the baked posts, and the
//! pictures it writes.
#![expect(
    clippy::expect_used,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "a test: numbers are small and what fails must say so"
)]

mod support;

use glasswing::geo::{Attitude, Camera, Geodetic};
use glasswing::terrain::pack::Pack;
use glasswing::terrain::partition::Partition;
use glasswing::terrain::surface::{Damage, Sampler};
use glasswing::terrain::tables::HeightCode;
use glasswing::units::Radians;
use std::path::{Path, PathBuf};

const SIDE: usize = 1201;

/// The posts of a 3" degree cell, as ellipsoidal heights, from the pack itself.
struct Truth {
    west: i32,
    south: i32,
    posts: Vec<f64>,
}

impl Truth {
    fn new(pack: &Pack, south_deg: i32, west_deg: i32) -> Self {
        let info = pack.info();
        let heights = HeightCode::covering(info.height_min_m, info.height_max_m);
        let damage = Damage::default();
        let mut sampler = Sampler::new(pack, Partition::Geographic, heights, &damage);
        let (west, south) = (west_deg * 1200, south_deg * 1200);
        let mut posts = Vec::new();
        let (mut codes, mut surface) = ([[0; 2]; SIDE], [[0; 4]; SIDE]);
        for row in 0..SIDE {
            let at = (west, south + i32::try_from(row).expect("small"));
            sampler.fill(0, at, (SIDE, 1), &mut codes, &mut surface);
            posts.extend(codes.iter().map(|c| heights.decode(c[0])));
        }
        Self { west, south, posts }
    }

    /// Height of the triangulated posts; diagonals as terrain::blocks says.
    fn height_m(&self, g: &Geodetic) -> Option<f64> {
        let x = g.longitude.to_degrees() * 1200.0 - f64::from(self.west);
        let y = g.latitude.to_degrees() * 1200.0 - f64::from(self.south);
        let inside = |v: f64| (0.0..1200.0).contains(&v);
        if !inside(x) || !inside(y) {
            return None;
        }
        let (i, j) = (x as usize, y as usize);
        let (fx, fy) = (x.fract(), y.fract());
        let post = |di: usize, dj: usize| self.posts[(j + dj) * SIDE + i + di];
        let (sw, se, nw, ne) = (post(0, 0), post(1, 0), post(0, 1), post(1, 1));
        Some(if (i + j).is_multiple_of(2) {
            if fx >= fy {
                sw + fx * (se - sw) + fy * (ne - se)
            } else {
                sw + fy * (nw - sw) + fx * (ne - nw)
            }
        } else if fx + fy <= 1.0 {
            sw + fx * (se - sw) + fy * (nw - sw)
        } else {
            ne + (1.0 - fx) * (nw - ne) + (1.0 - fy) * (se - ne)
        })
    }
}

fn bake(data: &Path, name: &str, into: &Path) -> PathBuf {
    let pack = into.join("view.pack");
    let out = support::glasswing_command()
        .args(["terrain", "bake"])
        .arg(data.join("elev").join(name))
        .arg("--out")
        .arg(&pack)
        .output()
        .expect("the program starts");
    assert!(
        out.status.success(),
        "{}",
        String::from_utf8_lossy(&out.stderr)
    );
    pack
}

/// A PFM's values, rows from the top.
fn read_pfm(path: &Path, width: usize) -> Vec<f32> {
    let bytes = std::fs::read(path).expect("a PFM");
    let start = bytes
        .iter()
        .enumerate()
        .filter(|(_, b)| **b == b'\n')
        .nth(2)
        .map(|(at, _)| at + 1)
        .expect("three lines");
    let rows: Vec<f32> = bytes[start..]
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
        .collect();
    rows.chunks_exact(width).rev().flatten().copied().collect()
}

#[test]
fn the_andes_are_where_a_ray_cast_finds_them() {
    let Some(data) = support::data_dir() else {
        return;
    };
    let dir = support::scratch_dir("shot_view");
    let pack = bake(&data, "S33W071.tif", &dir);
    let (width, height) = (512_u32, 300_u32);
    let (png, pfm) = (dir.join("view.png"), dir.join("view.pfm"));
    let out = support::glasswing_command()
        .args(["shot", "--eye", "-32.6,-70.3,4200"])
        .args(["--attitude", "215,-4,0", "--hfov", "60"])
        .args(["--size", "512x300", "--terrain-only", "--json"])
        .args([Path::new("--pack"), &pack, Path::new("--out"), &png])
        .args([Path::new("--range"), &pfm])
        .output()
        .expect("the program starts");
    assert!(
        out.status.success(),
        "{}",
        String::from_utf8_lossy(&out.stderr)
    );
    let figures: serde_json::Value = serde_json::from_slice(&out.stdout).expect("one document");
    let triangles = figures["triangles"].as_u64().expect("a number");
    assert!(
        (1000..120_000).contains(&triangles),
        "{triangles} triangles"
    );
    assert!(figures["draw_calls"].as_u64().expect("a number") <= 24);

    let truth = Truth::new(&Pack::open(&pack).expect("a pack"), -33, -71);
    let camera = Camera {
        eye: Geodetic::from_degrees(-32.6, -70.3, 4200.0),
        attitude: Attitude::from_degrees(215.0, -4.0, 0.0),
        hfov: Radians::from_degrees(60.0),
        width_px: width,
        height_px: height,
    };
    let eye = camera.eye.to_ecef();
    let ranges = read_pfm(&pfm, width as usize);
    assert_eq!(ranges.len(), (width * height) as usize);
    let (mut squares, mut worst_px, mut count, mut exact) = (0.0, 0.0_f64, 0, 0);
    for (at, &range) in ranges.iter().enumerate().step_by(7) {
        let (x, y) = (at % width as usize, at / width as usize);
        let ray = camera.ray_ecef(x as f64 + 0.5, y as f64 + 0.5);
        let range = f64::from(range);
        let hit = Geodetic::from_ecef(eye + ray * range);
        let Some(ground_m) = truth.height_m(&hit).filter(|_| range.is_finite()) else {
            continue;
        };
        let error_m = (hit.height_ellipsoid.0 - ground_m).abs();
        // The finest level is drawn unblended within 105 of its posts: 8 km eastwards here.
        if range < 8000.0 {
            assert!(error_m < 0.3, "{error_m} m at {range} m, pixel {x} {y}");
            exact += 1;
        }
        let error_px = error_m * camera.focal_px() / range;
        squares += error_px.powi(2);
        worst_px = worst_px.max(error_px);
        count += 1;
    }
    assert!(exact > 500 && count > 5000, "{exact} of {count}");
    // Half of the published 1024-pixel goals, less the 0.25 that triangles differ from the bilinear surface.
    let rms = (squares / f64::from(count)).sqrt();
    assert!(rms < 0.12, "{rms} px");
    assert!(worst_px < 1.5, "{worst_px} px");
}

#[test]
fn a_sky_is_blue_above_the_horizon_and_never_below() {
    let Some(data) = support::data_dir() else {
        return;
    };
    let dir = support::scratch_dir("shot_horizon");
    let pack = bake(&data, "S20W180.hgt", &dir);
    let png = dir.join("view.png");
    // Zero pitch lies in the middle of the picture; from 3000 m the sea ends 1.76 degrees below it.
    let out = support::glasswing_command()
        .args([
            "shot",
            "--eye",
            "-19.5,-179.99,3000",
            "--attitude",
            "300,0,0",
        ])
        .args(["--hfov", "30", "--size", "640x400"])
        .args([Path::new("--pack"), &pack, Path::new("--out"), &png])
        .output()
        .expect("the program starts");
    assert!(
        out.status.success(),
        "{}",
        String::from_utf8_lossy(&out.stderr)
    );
    let mut decoder = png::Decoder::new(std::io::BufReader::new(
        std::fs::File::open(&png).expect("a picture"),
    ))
    .read_info()
    .expect("a PNG");
    let mut rgb = vec![0; 640 * 400 * 3];
    decoder.next_frame(&mut rgb).expect("whole");
    let pixel = |x: usize, y: usize| &rgb[(y * 640 + x) * 3..][..3];
    // Between the tapes and the aircraft symbol, clear of the horizon line itself.
    for x in (100..200).chain(440..500).step_by(10) {
        let (above, below) = (pixel(x, 192), pixel(x, 208));
        assert!(above[2] > above[0] + 40, "sky at column {x}: {above:?}");
        assert!(
            below[2] <= below[0],
            "no sky below zero pitch at column {x}: {below:?}"
        );
    }
}

#[test]
fn a_missing_pack_and_a_wrong_eye_are_named_in_one_line() {
    let run = |eye: &str| {
        support::glasswing_command()
            .args([
                "shot",
                "--pack",
                "nowhere.pack",
                "--out",
                "x.png",
                "--eye",
                eye,
            ])
            .output()
            .expect("the program starts")
    };
    let out = run("0,0,1000");
    assert_eq!(out.status.code(), Some(3));
    let text = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(text.starts_with("glasswing: nowhere.pack: "), "{text}");
    assert_eq!(run("95,0,1000").status.code(), Some(2));
}
