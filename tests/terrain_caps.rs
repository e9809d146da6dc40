//! The caps of a baked pack: every post against the bilinear surface of the sources, computed here from the angles of the
//! ellipsoid's normal; and against the geographic partition at the seam.

#![expect(
    clippy::expect_used,
    clippy::cast_possible_truncation,
    reason = "a test says what it needs and fails where that is not so; its numbers are small"
)]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use glasswing::terrain::archive;
use glasswing::terrain::bake::Heights;
use glasswing::terrain::codec::SurfaceKind;
use glasswing::terrain::height::GroundReader;
use glasswing::terrain::pack::{Bounds, Pack};
use glasswing::terrain::partition::Partition;
use glasswing::terrain::surface::{Damage, Sampler};
use glasswing::terrain::tables::HeightCode;

mod support;
#[path = "terrain_bake_support/mod.rs"]
mod with;

use with::{Posts, angles, baked, baked_as, triangle, write_hgt, write_tiff};

/// Longitude and latitude, degrees, of the post of a cap whose angles are u and v, degrees: n = (cos u sin v, sin u,
/// cos u cos v) in the north, (cos u sin v, -sin u, -cos u cos v) in the south.
fn place(cap: Partition, v: f64, u: f64) -> (f64, f64) {
    let (sin_u, cos_u) = u.to_radians().sin_cos();
    let (sin_v, cos_v) = v.to_radians().sin_cos();
    let sign = if cap == Partition::South { -1.0 } else { 1.0 };
    let (x, y) = (cos_u * sin_v, sign * sin_u);
    let from_pole = x.hypot(y).atan2(cos_u * cos_v).to_degrees();
    (y.atan2(x).to_degrees(), sign * (90.0 - from_pole))
}

/// A floor and what is above it; a thousandth of a millimetre from a whole number is that number.
fn split(x: f64) -> (i32, f64) {
    let x = if (x - x.round()).abs() < 1e-6 {
        x.round()
    } else {
        x
    };
    (x.floor() as i32, x - x.floor())
}

/// Bilinear between four posts: the height, whether one of them is void, and the kind of the heaviest.
fn bilinear(
    (x, y): (f64, f64),
    mut post: impl FnMut(i32, i32) -> (f64, SurfaceKind),
) -> (f64, bool, SurfaceKind) {
    let ((i, fx), (j, fy)) = (split(x), split(y));
    let (mut sum, mut void, mut heaviest) = (0.0, false, (0.0, SurfaceKind::Void));
    for (dj, wy) in [(0, 1.0 - fy), (1, fy)] {
        for (di, wx) in [(0, 1.0 - fx), (1, fx)] {
            let weight: f64 = wx * wy;
            if weight > 0.0 {
                let (height, kind) = post(i + di, j + dj);
                sum += weight * height;
                void |= kind == SurfaceKind::Void;
                if weight > heaviest.0 {
                    heaviest = (weight, kind);
                }
            }
        }
    }
    (sum, void, heaviest.1)
}

/// Posts a degree of the made-up land below: 30".
const POSTS: i32 = 120;

/// Hills and a hole in them.
fn hill_m(i: i32, j: i32) -> Option<i16> {
    let wave = |x: i32, period: f64| (f64::from(x) * std::f64::consts::TAU / period).sin();
    let hole = (i - 2500).abs() < 6 && (j - 8420).abs() < 5;
    let height =
        900.0 + 500.0 * wave(i, 31.0) + 300.0 * wave(j, 19.0) + 90.0 * wave(i + 2 * j, 7.0);
    let lake = (i - 2470).abs() < 8 && (j - 8380).abs() < 8;
    (!hole).then(|| if lake { 30 } else { height.round() as i16 })
}

/// 63.5 to 71 degrees north, 20 to 22 degrees east, all rows at 30".
fn hills(folder: &Path) -> PathBuf {
    let (south, north) = (POSTS * 127 / 2, POSTS * 71);
    let (west, east) = (POSTS * 20, POSTS * 22);
    let rows = (south..=north).rev();
    let samples: Vec<i16> = rows
        .flat_map(|j| (west..=east).map(move |i| hill_m(i, j).unwrap_or(i16::MIN)))
        .collect();
    let file = folder.join("hills.tif");
    let size = (
        (east - west + 1).cast_unsigned(),
        (north - south + 1).cast_unsigned(),
    );
    write_tiff(&file, size, (20.0, 71.0), 1.0 / f64::from(POSTS), &samples);
    file
}

/// The hills' pack, baked once in three threads for all tests.
fn hills_pack() -> &'static Path {
    static PACK: OnceLock<PathBuf> = OnceLock::new();
    PACK.get_or_init(|| {
        let folder = support::scratch_dir("caps_hills");
        let out = folder.join("hills.pack");
        baked_as(&[hills(&folder)], &out, Heights::Egm96, None, 3).expect("sound");
        out
    })
}

#[test]
fn cap_posts_have_the_bilinear_heights_of_their_source_or_more_for_a_summit_from_64_degrees_on() {
    let pack = Pack::open(hills_pack()).expect("sound");
    assert!(pack.info().has(Partition::North) && !pack.info().has(Partition::South));
    let mut geographic = Posts::of(&pack);
    let mut cap = Posts::in_partition(&pack, Partition::North);
    let per_degree = f64::from(POSTS);
    let (mut seen, mut raised, mut voids, mut waters, mut worst) = (0, 0, 0, 0, 0.0_f64);
    let mut southernmost = 90.0_f64;
    // 26 degrees from the pole, between 19 and 23 degrees east.
    for j in 6 * POSTS..10 * POSTS {
        for i in 17 * POSTS..26 * POSTS {
            let (v, u) = (f64::from(i) / per_degree, f64::from(j) / per_degree);
            let (longitude, latitude) = place(Partition::North, v, u);
            let inside = (20.01..21.99).contains(&longitude) && latitude < 70.99;
            if !inside || latitude < 64.0 {
                continue;
            }
            seen += 1;
            southernmost = southernmost.min(latitude);
            let at = (longitude * per_degree, latitude * per_degree);
            let (height_m, kind) = cap.at(0, i, j);
            // From the source alone; where it has a hole, from what the geographic posts make of it.
            let (want_m, void, _) = bilinear(at, |i, j| match hill_m(i, j) {
                Some(h) => (f64::from(h), SurfaceKind::Land),
                None => (geographic.at(0, i, j).0, SurfaceKind::Void),
            });
            let difference = (height_m - want_m).abs();
            assert_eq!(kind == SurfaceKind::Void, void, "{latitude} {longitude}");
            // Half a metre is half the unit of whole metres; a millimetre is what snapping to a post makes of a cliff.
            assert!(
                height_m >= want_m - 0.501,
                "{latitude} {longitude}: {height_m} for {want_m}"
            );
            voids += u32::from(void);
            waters += u32::from(kind == SurfaceKind::Water);
            if difference > 0.501 {
                raised += 1;
                continue;
            }
            let (_, _, heaviest) = bilinear(at, |i, j| geographic.at(0, i, j));
            assert!(void || kind == heaviest, "{latitude} {longitude}");
            worst = worst.max(difference);
        }
    }
    // 7 degrees by 2 of 120 posts squared at 67.5 degrees: 0.38 of the geographic posts.
    assert!((70_000..90_000).contains(&seen), "{seen}");
    assert!(southernmost < 64.01, "{southernmost}");
    // The hole of 11 x 9 posts at 70 degrees, spread by one post; the lake of 15 x 15.
    assert!((34..110).contains(&voids), "{voids}");
    assert!((50..120).contains(&waters), "{waters}");
    assert!(worst > 0.49, "the hills are rough: {worst}");
    // A post of 926 m may miss 116 m of a summit; the hills are 890 m high and as steep as mountains are.
    assert!(raised * 20 < seen, "{raised} of {seen} are raised");
}

#[test]
fn a_cap_states_how_far_its_surface_is_from_any_post_of_its_source() {
    let pack = Pack::open(hills_pack()).expect("sound");
    let mut cap = Posts::in_partition(&pack, Partition::North);
    let per_degree = f64::from(POSTS);
    let mut worst: BTreeMap<(i32, i32), f64> = BTreeMap::new();
    for j in POSTS * 64..=POSTS * 71 {
        for i in POSTS * 20..=POSTS * 22 {
            let Some(height) = hill_m(i, j) else { continue };
            let (longitude, latitude) = (f64::from(i) / per_degree, f64::from(j) / per_degree);
            let (v, u) = angles(Partition::North, longitude, latitude);
            let (x, y) = (v * per_degree, u * per_degree);
            let (west, south) = (x.floor() as i32, y.floor() as i32);
            let corners = triangle((x, y));
            let whole = corners.iter().all(|&((i, j), _)| {
                cap.stated_error_m(0, i, j).is_some() && cap.at(0, i, j).1 != SurfaceKind::Void
            });
            if whole {
                let shares = corners.map(|((i, j), weight)| weight * cap.at(0, i, j).0);
                let surface_m: f64 = shares.iter().sum();
                let difference = (surface_m - f64::from(height)).abs();
                let tile = (west.div_euclid(128), south.div_euclid(128));
                let most = worst.entry(tile).or_insert(0.0);
                *most = most.max(difference);
            }
        }
    }
    assert!(worst.len() > 8, "{}", worst.len());
    for ((column, row), difference) in worst {
        let stated = cap
            .stated_error_m(0, column * 128, row * 128)
            .expect("a tile");
        // Tiles on the edge may have nothing but roundings to state.
        let tells = stated >= difference - 1e-3 && stated <= difference.max(0.5) + 1e-3;
        assert!(
            tells,
            "{column} {row}: {stated} m stated, {difference} m found"
        );
    }
}

#[test]
fn coarse_cap_levels_are_nowhere_lower_than_their_samples_and_threads_change_nothing() {
    let folder = support::scratch_dir("caps_levels");
    let out = folder.join("hills.pack");
    let (_, pack) = baked_as(&[hills(&folder)], &out, Heights::Egm96, None, 1).expect("sound");
    assert!(
        fs::read(&out).expect("baked") == fs::read(hills_pack()).expect("baked"),
        "the same bytes from one thread and from three"
    );
    let mut geographic = Posts::of(&pack);
    let finest = Posts::in_partition(&pack, Partition::North);
    let mut coarse = Posts::in_partition(&pack, Partition::North);
    for level in 1..pack.info().levels {
        let step = 1 << level;
        let mut seen = 0;
        for j in (7 * POSTS..9 * POSTS).filter(|j| j % step == 0) {
            for i in (18 * POSTS..24 * POSTS).filter(|i| i % step == 0) {
                let (v, u) = (f64::from(i), f64::from(j));
                let (v, u) = (v / f64::from(POSTS), u / f64::from(POSTS));
                let (longitude, latitude) = place(Partition::North, v, u);
                let inside =
                    (20.01..21.99).contains(&longitude) && (64.0..70.99).contains(&latitude);
                if inside && finest.stated_error_m(0, i, j).is_some() {
                    let at = (longitude * f64::from(POSTS), latitude * f64::from(POSTS));
                    let (want, _, _) = bilinear(at, |i, j| geographic.at(0, i, j));
                    let (height, _) = coarse.at(level, i / step, j / step);
                    assert!(height > want - 0.51, "level {level}: {height} for {want}");
                    seen += 1;
                }
            }
        }
        assert!(seen > 0 || level > 5, "level {level}");
    }
}

#[test]
fn the_two_partitions_are_one_surface_at_the_seam() {
    let folder = support::scratch_dir("caps_seam");
    // Waves of 60 posts, 30' long, and 400 m high.
    let height = |i: i32, j: i32| {
        let wave = |x: i32| (f64::from(x) * std::f64::consts::TAU / 60.0).sin();
        (500.0 + 200.0 * wave(i) * wave(j)).round() as i16
    };
    let (south, north) = (POSTS * 69, POSTS * 71);
    let samples: Vec<i16> = (south..=north)
        .rev()
        .flat_map(|j| (POSTS * 20..=POSTS * 22).map(move |i| height(i, j)))
        .collect();
    let file = folder.join("waves.tif");
    write_tiff(&file, (241, 241), (20.0, 71.0), 1.0 / 120.0, &samples);
    let (_, pack) = baked(&[file], &folder.join("waves.pack")).expect("sound");
    let mut ground = GroundReader::new(&pack);
    let mut cap = Posts::in_partition(&pack, Partition::North);
    // The cap's surface lies between the heights of its posts, which are those of the geographic one to its stated error.
    // Between posts both are chords. Along a parallel a geographic post is 0.36 of a cap post wide at most, so over one
    // cap post the land's curvature is that of a wave of 60 x 0.33 posts: 200 (2 pi / 20)^2 / 8 = 2.5 m at most for each
    // of two directions; and the geographic surface has its own chords, 0.3 m.
    let bound_m = 0.5 + 2.0 * 2.5 + 0.3;
    let mut worst = 0.0_f64;
    for row in 0..=40 {
        for column in 0..=40 {
            let (latitude, longitude) = (
                69.75 + f64::from(row) * 0.0125,
                20.3 + f64::from(column) * 0.035,
            );
            let there = ground
                .at(latitude, longitude)
                .expect("covered")
                .height_orthometric
                .0;
            let (v, u) = angles(Partition::North, longitude, latitude);
            let at = (v * f64::from(POSTS), u * f64::from(POSTS));
            let (here, void, _) = bilinear(at, |i, j| cap.at(0, i, j));
            assert!(!void, "{latitude} {longitude}");
            worst = worst.max((here - there).abs());
        }
    }
    assert!(worst < bound_m, "{worst} m");
}

#[test]
fn packs_that_end_at_69_degrees_have_no_caps() {
    let folder = support::scratch_dir("caps_none");
    for (name, north) in [("N68E020.hgt", false), ("N69E020.hgt", true)] {
        let file = folder.join(name);
        write_hgt(&file, |row, column| (row / 7 + column / 5) as i16);
        let (report, pack) = baked(&[file], &folder.join("out.pack")).expect("sound");
        assert_eq!(report.info.has(Partition::North), north, "{name}");
        assert_eq!(
            pack.keys().any(|k| k.partition != Partition::Geographic),
            north
        );
        assert!(!report.info.has(Partition::South));
    }
}

/// Little-endian numbers of an index entry, as the format is described.
fn number(bytes: &[u8], at: usize, count: usize) -> usize {
    bytes[at..at + count]
        .iter()
        .rev()
        .fold(0, |all, byte| all << 8 | usize::from(*byte))
}

#[test]
fn a_damaged_cap_tile_is_marked_void_and_named() {
    let folder = support::scratch_dir("caps_damaged");
    let out = folder.join("hills.pack");
    let mut bytes = fs::read(hills_pack()).expect("baked");
    let index = number(&bytes, 112, 8)..number(&bytes, 120, 8);
    // The first entry of the north cap: byte 1 of its entry is 1; its level, 0.
    let entry = index
        .step_by(40)
        .find(|at| bytes[at + 1] == 1)
        .expect("a cap tile");
    assert_eq!(bytes[entry], 0, "level");
    let signed = |at: usize| i32::from_le_bytes(bytes[at..at + 4].try_into().expect("4"));
    let (column, row) = (signed(entry + 4), signed(entry + 8));
    let tile = number(&bytes, entry + 24, 8) + 10;
    bytes[tile] ^= 1;
    fs::write(&out, &bytes).expect("written");

    let pack = Pack::open(&out).expect("its index is sound");
    let damage = Damage::default();
    let codes = HeightCode::covering(-100.0, 2000.0);
    let mut sampler = Sampler::new(&pack, Partition::North, codes, &damage);
    let (mut fine, mut surface) = (vec![[0; 2]; 64], vec![[0; 4]; 64]);
    let at = (column * 128 + 60, row * 128 + 60);
    sampler.fill(0, at, (8, 8), &mut fine, &mut surface);
    assert_eq!(damage.counts().checksum, 1);
    assert!(surface.iter().all(|s| s[3] == 255), "void");
    assert!(
        fine.iter().all(|h| h[0] == h[1]),
        "as the coarser level lies"
    );

    let output = support::glasswing_command()
        .args(["terrain", "verify"])
        .arg(&out)
        .output()
        .expect("runs");
    let told = String::from_utf8_lossy(&output.stdout).into_owned();
    let name = format!("north cap level 0 column {column} row {row}: it fails its checksum");
    assert!(told.contains(&name), "{told}");
}

/// The 20' grid of the whole Earth: heights by row from 89 5/6 N and column from 20 1/6 E, 1081 of which the last is the
/// first again.
struct Globe(Vec<i16>);

impl Globe {
    const COLUMNS: i32 = 1081;
    const ROWS: i32 = 540;

    fn read(folder: &Path) -> Option<Self> {
        let file = folder.join("elev/etopo20data.gz");
        if !file.exists() {
            support::skip("no etopo20data.gz");
            return None;
        }
        let text = archive::in_gzip(&fs::read(file).expect("readable"), 1 << 25).expect("gzip");
        let numbers = std::str::from_utf8(&text).expect("text").split_whitespace();
        let heights: Vec<i16> = numbers
            .map(|n| n.parse::<f64>().expect("a number").round() as i16)
            .collect();
        // The file's rows run from the south.
        let rows = heights.chunks_exact(1081).rev();
        Some(Self(rows.flatten().copied().collect()))
    }

    fn sample(&self, row: i32, column: i32) -> f64 {
        let at = row * Self::COLUMNS + column.rem_euclid(1080);
        f64::from(self.0[usize::try_from(at).expect("inside")])
    }

    /// The mean of the row next to a pole.
    fn pole_m(&self, row: i32) -> f64 {
        (0..1080)
            .map(|column| self.sample(row, column))
            .sum::<f64>()
            / 1080.0
    }

    /// Bilinear; between the outermost row and the pole linear towards the mean of that row.
    fn height_m(&self, latitude: f64, longitude: f64) -> f64 {
        let x = (longitude - (20.0 + 1.0 / 6.0)).rem_euclid(360.0) * 3.0;
        let y = (90.0 - 1.0 / 6.0 - latitude) * 3.0;
        let (column, east) = split(x);
        let along = |row: i32| {
            self.sample(row, column) * (1.0 - east) + self.sample(row, column + 1) * east
        };
        if y < 0.0 {
            let towards = -y / 0.5;
            return along(0) * (1.0 - towards) + self.pole_m(0) * towards;
        }
        let last = Self::ROWS - 1;
        if y > f64::from(last) {
            let towards = (y - f64::from(last)) / 0.5;
            return along(last) * (1.0 - towards) + self.pole_m(last) * towards;
        }
        let (row, south) = split(y);
        along(row) * (1.0 - south) + along((row + 1).min(last)) * south
    }
}

#[test]
fn a_global_grid_reaches_both_poles_and_closes_at_the_date_line() {
    let Some(globe) = support::data_dir().and_then(|data| Globe::read(&data)) else {
        return;
    };
    let folder = support::scratch_dir("caps_globe");
    let file = folder.join("etopo20.tif");
    let corner = (20.0 + 1.0 / 6.0, 90.0 - 1.0 / 6.0);
    write_tiff(&file, (1081, 540), corner, 1.0 / 3.0, &globe.0);
    let caps = [
        (Partition::South, -90.0, -89.25),
        (Partition::North, 89.25, 90.0),
    ];
    // Each cell costs the same: under emulation one pole has to do.
    let count = if support::is_emulated() { 1 } else { 2 };
    for (cap, south_deg, north_deg) in caps.into_iter().take(count) {
        let region = Bounds {
            south_deg,
            west_deg: -180.0,
            north_deg,
            east_deg: 180.0,
        };
        let out = folder.join("out.pack");
        let files = std::slice::from_ref(&file);
        let (report, pack) = baked_as(files, &out, Heights::Egm96, Some(region), 2).expect("sound");
        assert_eq!(
            report.info.grid.posts_per_degree, 120,
            "the coarsest there is"
        );
        assert!(report.info.has(cap) && report.info.void_posts == 0);
        assert_pole(&globe, &pack, cap);
    }
}

fn assert_pole(globe: &Globe, pack: &Pack, cap: Partition) {
    let mut posts = Posts::in_partition(pack, cap);
    // Two roundings to a quarter of a metre, the geographic and the cap's; and the pole is known to half a metre.
    let bound_m = 0.25 + 0.25 + 0.01;
    let (mut worst, mut seen) = (0.0_f64, 0);
    for j in -80..=80_i32 {
        for i in -80..=80_i32 {
            let (longitude, latitude) = place(cap, f64::from(i) / 120.0, f64::from(j) / 120.0);
            if latitude.abs() > 89.27 {
                let want = globe.height_m(latitude, longitude);
                let (got, kind) = posts.at(0, i, j);
                assert!(kind != SurfaceKind::Void, "{latitude} {longitude}");
                worst = worst.max((got - want).abs());
                seen += 1;
            }
        }
    }
    assert!(
        worst <= bound_m && seen > 20_000,
        "{cap:?}: {worst} m of {seen}"
    );

    let pole = if cap == Partition::South { -90.0 } else { 90.0 };
    let mut ground = GroundReader::new(pack);
    let at_pole = ground.at(pole, 0.0).expect("covered").height_orthometric.0;
    let from_cap = (posts.at(0, 0, 0).0 - at_pole).abs();
    assert!(from_cap <= 0.126, "half a unit: {from_cap}");
    let row = if cap == Partition::South { 539 } else { 0 };
    assert!((at_pole - globe.pole_m(row)).abs() <= 0.4, "{at_pole}");
    for longitude in [-180.0, -179.9999, -77.7, 0.0, 20.1, 90.0, 179.9999] {
        // The pole is one place, 1e-4 degrees (11 m) from it the ground has hardly changed.
        let same = ground
            .at(pole, longitude)
            .expect("covered")
            .height_orthometric
            .0;
        assert_eq!(same.to_bits(), at_pole.to_bits(), "{longitude}");
        let latitude = pole * (1.0 - 1e-4 / 90.0);
        let near = ground
            .at(latitude, longitude)
            .expect("covered")
            .height_orthometric
            .0;
        let (v, u) = angles(cap, longitude, latitude);
        let (from_cap, _, _) = bilinear((v * 120.0, u * 120.0), |i, j| posts.at(0, i, j));
        let want = globe.height_m(latitude, longitude);
        assert!((near - want).abs() <= bound_m, "{near} for {want}");
        assert!((from_cap - want).abs() <= bound_m, "{from_cap} for {want}");
    }
}
