//! Inputs that overlap, end within each other, or fill each other's voids; and how good a filled void is.

use std::fs;
use std::path::{Path, PathBuf};

use glasswing::terrain::bake::BakeError;
use glasswing::terrain::bake_fill::{Window, fill_holes};
use glasswing::terrain::bake_plate;
use glasswing::terrain::codec::SurfaceKind;

mod support;
#[path = "terrain_bake_support/mod.rs"]
mod with;

use with::{Posts, baked, hgt_cell, tiff_cell, write_tiff};

const VOID: i16 = -32_768;
const SIDE: usize = 401;

/// Hills of some hundred metres, 60 posts of 3" from ridge to ridge, by post number.
fn hills(i: f64, j: f64) -> f64 {
    800.0 + 200.0 * (i / 30.0).sin() * (j / 37.0).cos() + 0.3 * i
}

#[expect(clippy::cast_possible_truncation, reason = "hundreds of metres")]
fn whole(h: f64) -> i16 {
    h.round() as i16
}

/// A GeoTIFF whose samples stand `step` posts of 3" apart from 10 E 46 N on, `side` to a side; `height` by post number.
fn sheet(path: &Path, step: i32, side: i32, corner: (i32, i32), height: impl Fn(i32, i32) -> i16) {
    let posts = |n: i32| f64::from(n) / 1200.0;
    let samples: Vec<i16> = (0..side)
        .flat_map(|row| (0..side).map(move |column| (column * step, -row * step)))
        .map(|(i, j)| height(corner.0 + i, corner.1 + j))
        .collect();
    let count = side.unsigned_abs();
    let at = (10.0 + posts(corner.0), 46.0 + posts(corner.1));
    write_tiff(path, (count, count), at, posts(step), &samples);
}

/// A sheet of 3" within one of 15" that lies 40 m higher.
fn nested(name: &str) -> (PathBuf, PathBuf, PathBuf) {
    let folder = support::scratch_dir(name);
    let (fine, coarse) = (folder.join("fine.tif"), folder.join("coarse.tif"));
    sheet(&fine, 1, 201, (100, -100), |i, j| {
        let in_void = (160..200).contains(&i) && (-220..-190).contains(&j);
        if in_void {
            VOID
        } else {
            whole(hills(f64::from(i), f64::from(j)))
        }
    });
    sheet(&coarse, 5, 81, (0, 0), |i, j| {
        whole(hills(f64::from(i), f64::from(j)) + 40.0)
    });
    (fine, coarse, folder.join("out.pack"))
}

const CORNER: (i32, i32) = (12_000, 55_200);

#[test]
fn the_finer_input_wins_and_the_coarser_one_meets_it_without_a_step() {
    let (fine, coarse, out) = nested("overlap_nested");
    let (report, pack) = baked(&[coarse.clone(), fine.clone()], &out).expect("sound files");
    assert!(
        report.seams.is_empty(),
        "40 m is within what 15\" may differ: {:?}",
        report.seams
    );
    let mut posts = Posts::of(&pack);
    let mut at = |i: i32, j: i32| posts.at(0, CORNER.0 + i, CORNER.1 + j);
    for j in (-300..=-100).step_by(7) {
        for i in 100..=300 {
            if (160..200).contains(&i) && (-220..-190).contains(&j) {
                continue;
            }
            let (height, kind) = at(i, j);
            assert!(
                (height - f64::from(whole(hills(f64::from(i), f64::from(j))))).abs() < 0.02,
                "{i} {j}"
            );
            assert_eq!(kind, SurfaceKind::Land);
        }
    }
    // Across the eastern rim the heights differ by what the hills do; far out the coarse sheet is as it was.
    let slope =
        |i: i32, j: i32| hills(f64::from(i + 1), f64::from(j)) - hills(f64::from(i), f64::from(j));
    for j in -290..-110 {
        for i in 299..360 {
            let step = at(i + 1, j).0 - at(i, j).0;
            assert!(
                (step - slope(i, j)).abs() < 6.0,
                "{i} {j}: {step} for {}",
                slope(i, j)
            );
        }
        let far = at(370, j).0 - hills(370.0, f64::from(j));
        assert!((far - 40.0).abs() < 6.0, "{far}");
    }
    let other = out.with_extension("other");
    baked(&[fine, coarse], &other).expect("sound files");
    assert!(
        fs::read(&out).expect("baked") == fs::read(&other).expect("baked"),
        "in any order"
    );
}

#[test]
fn a_void_is_filled_from_the_coarser_input_at_the_height_of_its_rim_and_stays_marked() {
    let (fine, coarse, out) = nested("overlap_void");
    let (_, pack) = baked(&[fine, coarse], &out).expect("sound files");
    let mut posts = Posts::of(&pack);
    for j in -219..-190 {
        for i in 160..200 {
            let (height, kind) = posts.at(0, CORNER.0 + i, CORNER.1 + j);
            assert_eq!(kind, SurfaceKind::Void, "{i} {j}");
            // Bilinear between samples of 15" on these hills is wrong by 1.3 m at most; both sheets are whole metres.
            let error = height - hills(f64::from(i), f64::from(j));
            assert!(error.abs() < 3.0, "{i} {j}: {error} m");
        }
    }
}

#[test]
fn like_inputs_that_disagree_are_named_with_place_and_size() {
    let folder = support::scratch_dir("overlap_disagree");
    let (a, b) = (folder.join("a.tif"), folder.join("b.tif"));
    sheet(&a, 1, 101, (0, 0), |_, _| 500);
    sheet(&b, 1, 101, (90, 0), |i, j| {
        if (i, j) == (95, -20) { 530 } else { 500 }
    });
    let (report, _) =
        baked(&[a.clone(), b.clone()], &folder.join("out.pack")).expect("sound files");
    let [seam] = report.seams.as_slice() else {
        panic!("one disagreement: {:?}", report.seams);
    };
    assert_eq!((&seam.taken, &seam.other, seam.posts), (&a, &b, 1));
    assert!((seam.difference_m - 30.0).abs() < 1e-6);
    assert!((seam.longitude_deg - 10.0 - 95.0 / 1200.0).abs() < 1e-9);
    assert!((seam.latitude_deg - 46.0 + 20.0 / 1200.0).abs() < 1e-9);
    let twice = baked(&[a.clone(), b, a.clone()], &folder.join("twice.pack")).expect_err("a twice");
    assert!(
        matches!(twice, BakeError::Twice(ref path) if *path == a),
        "{twice}"
    );
}

#[test]
fn the_margin_of_a_finer_input_is_no_void() {
    let folder = support::scratch_dir("overlap_margin");
    let (fine, coarse) = (folder.join("fine.tif"), folder.join("coarse.tif"));
    // A round picture: its corners were never measured.
    let inside = |i: i32, j: i32| (i - 200).pow(2) + (j + 200).pow(2) < 80 * 80;
    sheet(&fine, 1, 201, (100, -100), |i, j| {
        if inside(i, j) { 900 } else { VOID }
    });
    sheet(&coarse, 5, 81, (0, 0), |_, _| 900);
    let (_, pack) = baked(&[fine, coarse], &folder.join("out.pack")).expect("sound files");
    let mut posts = Posts::of(&pack);
    for (i, j) in [(105, -105), (295, -295), (200, -200), (130, -130)] {
        let (height, kind) = posts.at(0, CORNER.0 + i, CORNER.1 + j);
        assert!((height - 900.0).abs() < 1e-9);
        assert_ne!(kind, SurfaceKind::Void, "{i} {j}");
    }
}

#[test]
fn a_coarse_world_is_not_blown_up_to_the_spacing_of_one_fine_tile() {
    let folder = support::scratch_dir("overlap_world");
    let (world, fine) = (folder.join("world.tif"), folder.join("fine.tif"));
    write_tiff(&world, (360, 180), (-179.5, 89.5), 1.0, &vec![0; 360 * 180]);
    sheet(&fine, 1, 21, (0, 0), |_, _| 500);
    let e = baked(&[world.clone(), fine], &folder.join("out.pack"))
        .expect_err("93 thousand million posts");
    assert!(
        matches!(e, BakeError::ThinAir { ref coarse, .. } if *coarse == world),
        "{e}"
    );
    assert!(e.to_string().contains("3 arc seconds"), "{e}");
}

struct Errors {
    rms_m: f64,
    max_m: f64,
}

fn errors(heights: &[f32], truth: &[f32], hole: &[bool]) -> Errors {
    let all: Vec<f64> = std::iter::zip(heights, truth)
        .zip(hole)
        .filter(|(_, hole)| **hole)
        .map(|((h, t), _)| f64::from(h - t))
        .collect();
    let count = all.iter().fold(0.0, |n, _| n + 1.0);
    Errors {
        rms_m: (all.iter().map(|e| e * e).sum::<f64>() / count).sqrt(),
        max_m: all.iter().fold(0.0, |max, e| max.max(e.abs())),
    }
}

/// The voids of one real tile cut out of others that have none, and filled again.
#[test]
fn real_voids_in_real_mountains_are_filled_better_than_by_a_flat_patch() {
    let Some(folder) = support::data_dir().map(|d| d.join("elev")) else {
        return;
    };
    let voids = tiff_cell(&folder.join("n46_e008_3arc.tif"), 46, 8).samples;
    let andes = tiff_cell(&folder.join("S33W071.tif"), -33, -71).samples;
    let hills = hgt_cell(&folder.join("N50E014.hgt"), 50, 14).samples;
    let window = Window {
        columns: SIDE,
        rows: SIDE,
    };
    let parts = if support::is_emulated() { 1 } else { 3 };
    for (name, tile, latitude) in [("S33W071", andes, 32.5_f64), ("N50E014", hills, 50.5)] {
        let (mut membrane, mut plate) = ((0.0_f64, 0.0_f64), (0.0_f64, 0.0_f64));
        let mut count = 0.0;
        for part in 0..parts * parts {
            let (top, left) = (part / parts * 400, part % parts * 400);
            let places =
                (0..SIDE).flat_map(|r| (0..SIDE).map(move |c| (top + r) * 1201 + left + c));
            let places: Vec<usize> = places.collect();
            let truth: Vec<f32> = places.iter().map(|at| f32::from(tile[*at])).collect();
            let hole: Vec<bool> = places.iter().map(|at| voids[*at] <= VOID + 1).collect();
            let cut: Vec<f32> = std::iter::zip(&truth, &hole)
                .map(|(h, hole)| if *hole { f32::NAN } else { *h })
                .collect();
            let (mut flat, mut bent) = (cut.clone(), cut);
            fill_holes(&window, &mut flat, &hole, 0.0);
            bake_plate::fill(&window, latitude.to_radians().cos(), &mut bent, &hole, 0.0);
            let posts = hole.iter().filter(|h| **h).fold(0.0, |n, _| n + 1.0);
            if posts < 1.0 {
                continue;
            }
            for (sum, heights) in [(&mut membrane, &flat), (&mut plate, &bent)] {
                let e = errors(heights, &truth, &hole);
                *sum = (sum.0 + e.rms_m * e.rms_m * posts, sum.1.max(e.max_m));
            }
            count += posts;
        }
        let [membrane, plate] = [membrane, plate].map(|(sum, max)| ((sum / count).sqrt(), max));
        println!(
            "{name}, {count} posts in the voids of n46_e008: membrane {:.1} m RMS, {:.0} m max; plate {:.1} m RMS, {:.0} m max",
            membrane.0, membrane.1, plate.0, plate.1
        );
        assert!(
            plate.0 < membrane.0,
            "{name}: a plate is nearer to the ground than a flat patch"
        );
    }
}
