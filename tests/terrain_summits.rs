//! No level of a pack is drawn lower than a summit of the data by more than is stated, and what is stated of a level is
//! true: computed here from the finest posts, on real tiles and on made-up worlds.

#![expect(
    clippy::expect_used,
    clippy::panic,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a test says what it needs and fails where that is not so; its numbers are small"
)]

use glasswing::terrain::codec::{SurfaceKind, Tile};
use glasswing::terrain::grid::TileKey;
use glasswing::terrain::pack::{Pack, PostRect, TileReader};
use glasswing::terrain::partition::{CAP_LATITUDE_MIN_DEG, Partition};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

mod support;
#[path = "terrain_bake_support/mod.rs"]
mod with;

use with::{angles, baked, triangle, write_tiff};

/// What is allowed of a level, metres: an eighth of its cells of `cell_m`, at most 200 m.
fn allowed_m(cell_m: f64) -> f64 {
    (cell_m / 8.0).min(200.0)
}

/// Metres in a degree of the smallest circle of the ellipsoid, its semi-minor axis 6 356 752 m.
const DEGREE_M: f64 = 110_946.0;

/// All tiles of a level.
struct Level<'a> {
    pack: &'a Pack,
    tiles: HashMap<(i32, i32), Tile>,
}

impl<'a> Level<'a> {
    fn read(pack: &'a Pack, partition: Partition, level: u8) -> Self {
        let of_level = |k: &TileKey| k.partition == partition && k.level == level;
        let mut reader = TileReader::new();
        let tiles = pack.keys().filter(of_level).map(|key| {
            let mut tile = Tile::filled(0, SurfaceKind::Void);
            pack.read_tile(key, &mut reader, &mut tile).expect("sound");
            ((key.column, key.row), tile)
        });
        Self {
            pack,
            tiles: tiles.collect(),
        }
    }

    /// Height and kind of a post; sea level where there is no tile.
    fn at(&self, i: i32, j: i32) -> (f64, SurfaceKind) {
        let key = (i.div_euclid(128), j.div_euclid(128));
        self.tiles.get(&key).map_or((0.0, SurfaceKind::Void), |t| {
            let at = TileKey::index_of(i, j);
            (self.pack.orthometric_m(t.quanta[at]), t.kind[at])
        })
    }
}

/// A post of the finest level: place in posts, height in metres, whether it is a summit.
struct Data {
    at: (i32, i32),
    height_m: f64,
    is_summit: bool,
}

/// The measured posts of a rectangle.
fn data(pack: &Pack, rect: PostRect) -> Vec<Data> {
    let grid = pack.info().grid;
    let posts = Level::read(pack, Partition::Geographic, 0);
    let post = |i: i32, j: i32| posts.at(grid.canonical(i), j);
    let (width, rows) = (rect.east - rect.west + 3, rect.north - rect.south + 3);
    let all: Vec<(f64, SurfaceKind)> = (0..rows)
        .flat_map(|y| (0..width).map(move |x| (x + rect.west - 1, y + rect.south - 1)))
        .map(|(i, j)| post(i, j))
        .collect();
    let mut data = Vec::new();
    for j in rect.south..=rect.north {
        for i in rect.west..=rect.east {
            let around = |di: i32, dj: i32| {
                all[((j - rect.south + 1 + dj) * width + i - rect.west + 1 + di) as usize]
            };
            let (height_m, kind) = around(0, 0);
            if kind == SurfaceKind::Void {
                continue;
            }
            let nine = (-1..=1).flat_map(|dj| (-1..=1).map(move |di| (di, dj)));
            let measured = nine.map(|(di, dj)| around(di, dj));
            let measured: Vec<f64> = measured
                .filter(|n| n.1 != SurfaceKind::Void)
                .map(|n| n.0)
                .collect();
            let is_summit = kind == SurfaceKind::Land
                && measured.iter().all(|h| *h <= height_m)
                && measured.iter().any(|h| *h < height_m);
            data.push(Data {
                at: (grid.canonical(i), j),
                height_m,
                is_summit,
            });
        }
    }
    data
}

/// What was found of a level.
#[derive(Clone, Copy, Debug, Default)]
struct Found {
    squares: f64,
    posts: u32,
    max_m: f64,
    low_m: f64,
    summits: u32,
    summit_low_m: f64,
}

/// Compares a level with the data.
fn compare(pack: &Pack, partition: Partition, level: u8, data: &[Data]) -> Found {
    let grid = pack.info().grid;
    let per_degree = f64::from(grid.posts_per_degree);
    let posts = Level::read(pack, partition, level);
    let mut found = Found::default();
    for post in data {
        let (x, y) = (f64::from(post.at.0), f64::from(post.at.1));
        let (x, y) = match partition {
            Partition::Geographic => (x, y),
            cap => {
                if y.abs() < CAP_LATITUDE_MIN_DEG * per_degree {
                    continue;
                }
                let (v, u) = angles(cap, x / per_degree, y / per_degree);
                (v * per_degree, u * per_degree)
            }
        };
        let step = f64::from(1_u32 << level);
        let (mut surface_m, mut measured, mut there) = (0.0, true, true);
        for ((i, j), weight) in triangle((x / step, y / step)) {
            let i = match partition {
                Partition::Geographic => grid.canonical_at(level, i),
                Partition::North | Partition::South => Some(i),
            };
            let Some(i) = i else {
                there = false;
                continue;
            };
            let (height_m, kind) = posts.at(i, j);
            surface_m += weight * height_m;
            measured &= kind != SurfaceKind::Void || weight <= 0.0;
        }
        if !there {
            continue;
        }
        let difference = surface_m - post.height_m;
        if measured {
            found.squares += difference * difference;
            found.posts += 1;
            found.max_m = found.max_m.max(difference.abs());
            found.low_m = found.low_m.max(-difference);
        }
        if post.is_summit {
            found.summits += 1;
            found.summit_low_m = found.summit_low_m.max(-difference);
        }
    }
    found
}

/// Every level of a partition keeps the summits, and is what the pack states.
fn assert_keeps_summits(name: &str, pack: &Pack, partition: Partition, data: &[Data]) {
    let grid = pack.info().grid;
    for level in 0..pack.info().levels {
        let found = compare(pack, partition, level, data);
        let stated = pack.info().level_error(partition, level);
        let stated = stated.unwrap_or_else(|| panic!("{name} {partition:?} level {level}"));
        let cell_m = grid.spacing_deg(level) * DEGREE_M;
        let low_m = f64::from(stated.summit_low_m);
        let what = format!("{name} {partition:?} level {level}: {found:?}, stated {stated:?}");
        assert!(found.summits > 0, "{what}");
        assert!(found.summit_low_m <= low_m + 1e-3, "{what}");
        // A triangle's middle hangs lower than its corners on a round Earth; that may be more than is allowed on the
        // coarsest level, where nothing is seen of it.
        let sag_m = cell_m * cell_m / (4.0 * 6.356e6);
        assert!(low_m <= allowed_m(cell_m).max(sag_m) + 0.5, "{what}");
        let rms_m = (found.squares / f64::from(found.posts.max(1))).sqrt();
        for (is, says) in [
            (rms_m, stated.rms_m),
            (found.max_m, stated.max_m),
            (found.low_m, stated.low_m),
        ] {
            assert!(
                (is - f64::from(says)).abs() <= 0.01 + 1e-4 * is,
                "{what}: {is}"
            );
        }
    }
}

/// A tile of the test data.
fn real(name: &str, west_south: (i32, i32)) {
    let Some(folder) = support::data_dir() else {
        return;
    };
    if support::is_emulated() {
        support::skip(&format!("{name} is not baked under emulation"));
        return;
    }
    let out = support::scratch_dir(&format!("summits_{name}")).join("out.pack");
    let (_, pack) = baked(&[folder.join("elev").join(name)], &out).expect("a sound file");
    let rect = PostRect {
        south: west_south.1 * 1200,
        west: west_south.0 * 1200,
        north: (west_south.1 + 1) * 1200,
        east: (west_south.0 + 1) * 1200,
    };
    assert_keeps_summits(name, &pack, Partition::Geographic, &data(&pack, rect));
}

#[test]
fn the_andes_keep_their_summits_on_every_level() {
    real("S33W071.tif", (-71, -33));
}

#[test]
fn mountains_with_voids_keep_the_summits_that_were_measured() {
    real("n46_e008_3arc.tif", (8, 46));
}

#[test]
fn a_coast_with_voids_keeps_its_summits() {
    real("N43E007.hgt.zip", (7, 43));
}

/// Rough ground with needles, lakes and holes: a number for every post.
fn rough(seed: u64, i: i32, j: i32) -> i16 {
    let noise = |k: u64| {
        let mut x = seed ^ (i as i64 as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ k;
        x ^= (j as i64 as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
        x = (x ^ (x >> 31)).wrapping_mul(0x94d0_49bb_1331_11eb);
        x = (x ^ (x >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x ^ (x >> 32)
    };
    let wave = |x: i32, period: f64| (f64::from(x) * std::f64::consts::TAU / period).sin();
    let hills = 1500.0 + 700.0 * wave(i, 37.0) * wave(j, 23.0) + 400.0 * wave(i - j, 90.0);
    if (i.rem_euclid(50) < 9 && j.rem_euclid(60) < 9) || hills < 900.0 {
        return 200;
    }
    if noise(1).is_multiple_of(211) {
        return i16::MIN;
    }
    let needle = if noise(2).is_multiple_of(97) {
        1400.0
    } else {
        0.0
    };
    (hills + needle + (noise(3) % 60) as f64) as i16
}

/// Bakes a made-up land at 30".
fn made(
    folder: &Path,
    (west, south): (i32, i32),
    (columns, rows): (i32, i32),
    seed: u64,
) -> PathBuf {
    let (west, south) = (west * 120, south * 120);
    let samples: Vec<i16> = (0..=rows * 120)
        .rev()
        .flat_map(|y| (0..=columns * 120).map(move |x| rough(seed, west + x, south + y)))
        .collect();
    let file = folder.join(format!("rough_{west}_{south}.tif"));
    let corner = (
        f64::from(west) / 120.0,
        f64::from(south) / 120.0 + f64::from(rows),
    );
    let size = (
        (columns * 120 + 1).cast_unsigned(),
        (rows * 120 + 1).cast_unsigned(),
    );
    write_tiff(&file, size, corner, 1.0 / 120.0, &samples);
    file
}

#[test]
fn made_up_lands_keep_their_summits_wherever_they_lie() {
    let folder = support::scratch_dir("summits_made");
    let all = [
        ("mainland", (10, 46)),
        ("equator", (-70, -1)),
        ("zero meridian", (-1, 50)),
    ];
    let count = if support::is_emulated() { 1 } else { all.len() };
    for (seed, (name, corner)) in (7..).zip(&all[..count]) {
        let file = made(&folder, *corner, (2, 2), seed);
        let (_, pack) = baked(&[file], &folder.join(format!("{seed}.pack"))).expect("sound");
        let rect = pack.info().rect;
        assert_keeps_summits(name, &pack, Partition::Geographic, &data(&pack, rect));
    }
}

#[test]
fn a_land_across_the_date_line_keeps_its_summits() {
    let folder = support::scratch_dir("summits_date_line");
    let files = [(178, -17), (-180, -17)].map(|corner| made(&folder, corner, (2, 2), 3));
    let (_, pack) = baked(&files, &folder.join("out.pack")).expect("sound");
    let rect = PostRect {
        south: -17 * 120,
        west: 178 * 120,
        north: -15 * 120,
        east: 182 * 120,
    };
    assert_keeps_summits(
        "date line",
        &pack,
        Partition::Geographic,
        &data(&pack, rect),
    );
}

#[test]
fn a_cap_keeps_the_summits_that_fall_between_its_posts() {
    let folder = support::scratch_dir("summits_cap");
    for (seed, (corner, cap)) in
        (20..).zip([((20, 71), Partition::North), ((-60, -74), Partition::South)])
    {
        let file = made(&folder, corner, (3, 2), seed);
        let (_, pack) = baked(&[file], &folder.join(format!("{seed}.pack"))).expect("sound");
        let rect = pack.info().rect;
        assert_keeps_summits(cap.name(), &pack, cap, &data(&pack, rect));
        if support::is_emulated() {
            break;
        }
    }
}
