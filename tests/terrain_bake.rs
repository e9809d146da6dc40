//! Baking real and made-up elevation files: every post of a pack against an independent reading of its source.

#![expect(
    clippy::expect_used,
    reason = "a test says what it needs and fails where that is not so"
)]

use std::fs;
use std::path::{Path, PathBuf};

use glasswing::terrain::bake::{BakeError, Heights};
use glasswing::terrain::codec::SurfaceKind;
use glasswing::terrain::geotiff;
use glasswing::terrain::height::{GroundReader, HeightError};
use glasswing::terrain::pack::{Bounds, Pack};
use glasswing::units::Radians;

mod support;
#[path = "terrain_bake_support/mod.rs"]
mod with;

use with::{
    Cell, Field, Posts, baked, baked_as, geokeys, hgt_cell, picture, tiff, tiff_cell, write_hgt,
    zipped_cell,
};

const VOID: [i16; 2] = [-32_768, -32_767];

/// Every post of a cell, on every level: voids void; heights equal on the finest, and none lower on the others, which may be
/// raised for a summit. Returns how many posts are void and how many water.
fn assert_posts_are(pack: &Pack, cell: &Cell) -> (u32, u32) {
    let mut posts = Posts::of(pack);
    let (mut void, mut water) = (0, 0);
    for level in 0..pack.info().levels {
        let step = 1 << level;
        let inside = |corner: i32| (corner * 1200..=(corner + 1) * 1200).filter(|p| p % step == 0);
        for j in inside(cell.latitude) {
            for i in inside(cell.longitude) {
                let source = cell.at(i, j);
                let (height_m, kind) =
                    posts.at(level, pack.info().grid.canonical(i) / step, j / step);
                let is_void = VOID.contains(&source);
                assert_eq!(
                    kind == SurfaceKind::Void,
                    is_void,
                    "level {level} post {i} {j}"
                );
                if !is_void {
                    let difference = height_m - f64::from(source);
                    let as_measured = if level == 0 {
                        difference.abs() < 1e-9
                    } else {
                        difference > -1e-9
                    };
                    assert!(
                        as_measured,
                        "level {level} post {i} {j}: {height_m} for {source}"
                    );
                }
                if level == 0 {
                    void += u32::from(is_void);
                    water += u32::from(kind == SurfaceKind::Water);
                }
            }
        }
    }
    (void, water)
}

/// Tiles that are baked under emulation too: one of each kind. The others take minutes there and tell nothing new.
const EMULATED: [&str; 2] = ["N43E007.hgt.zip", "ww_craterlake-elev-16bit-30m.tif"];

fn data(name: &str) -> Option<PathBuf> {
    if support::is_emulated() && !EMULATED.contains(&name) {
        support::skip(&format!("{name} is not baked under emulation"));
        return None;
    }
    Some(support::data_dir()?.join("elev").join(name))
}

/// Bakes one file of the test data alone and compares it with its independent reading.
fn assert_bakes(
    name: &str,
    read: fn(&Path, i32, i32) -> Cell,
    corner: (i32, i32),
) -> Option<(u32, u32)> {
    let file = data(name)?;
    let out = support::scratch_dir(&format!("bake_{name}")).join("out.pack");
    let (report, pack) = baked(std::slice::from_ref(&file), &out).expect("a sound file");
    assert_eq!(report.info.posts, 1201 * 1201, "{name}");
    assert!(report.seams.is_empty(), "one file has no neighbours");
    Some(assert_posts_are(&pack, &read(&file, corner.0, corner.1)))
}

#[test]
fn a_tile_on_the_edge_of_the_partition_is_kept() {
    assert_bakes("N44W072.hgt", hgt_cell, (44, -72));
}

#[test]
fn a_tile_on_the_equator_is_kept() {
    assert_bakes("N00E010.hgt", hgt_cell, (0, 10));
}

#[test]
fn a_tile_on_the_date_line_is_kept_and_its_sea_is_water() {
    if let Some((_, water)) = assert_bakes("S20W180.hgt", hgt_cell, (-20, -180)) {
        // The manifest: almost all sea.
        assert!(water > 1_400_000, "{water}");
    }
}

#[test]
fn a_zipped_tile_is_kept_with_its_voids() {
    if let Some((void, water)) = assert_bakes("N43E007.hgt.zip", zipped_cell, (43, 7)) {
        assert_eq!(void, 1595, "the manifest's count");
        assert!(water > 1_000_000, "the Mediterranean: {water}");
    }
}

#[test]
fn a_geotiff_with_its_summits_void_is_kept() {
    if let Some((void, _)) = assert_bakes("n46_e008_3arc.tif", tiff_cell, (46, 8)) {
        // The manifest: 7.2 %.
        assert!((103_000..105_000).contains(&void), "{void}");
    }
}

#[test]
fn a_geotiff_of_the_andes_is_kept() {
    if let Some((void, _)) = assert_bakes("S33W071.tif", tiff_cell, (-33, -71)) {
        assert_eq!(void, 0);
    }
}

#[test]
fn a_tile_below_the_sea_is_kept_and_the_dead_sea_is_water() {
    if let Some((_, water)) = assert_bakes("n31_e035_3arc.tif", tiff_cell, (31, 35)) {
        // The Dead Sea's 600 km2 within the cell at 89 x 79 m a post.
        assert!(water > 80_000, "{water}");
    }
}

#[test]
fn neighbours_share_their_seam_and_the_order_of_inputs_and_threads_changes_nothing() {
    let Some(folder) = support::data_dir().map(|d| d.join("elev")) else {
        return;
    };
    let scratch = support::scratch_dir("bake_neighbours");
    let files = ["N50E014.hgt", "N49E015.hgt", "N49E016.hgt"].map(|n| folder.join(n));
    let out = scratch.join("a.pack");
    // Emulated, only what lies around the corner where all three meet.
    let region = support::is_emulated().then_some(Bounds {
        south_deg: 49.95,
        west_deg: 14.95,
        north_deg: 50.05,
        east_deg: 15.05,
    });
    let (report, pack) = baked_as(&files, &out, Heights::Egm96, region, 3).expect("sound files");
    assert!(
        report.seams.is_empty(),
        "the seam is identical: {:?}",
        report.seams
    );
    let whole = files.iter().zip([(50, 14), (49, 15), (49, 16)]);
    for (file, corner) in whole.filter(|_| region.is_none()) {
        assert_posts_are(&pack, &hgt_cell(file, corner.0, corner.1));
    }
    let [a, b, c] = files;
    let other = scratch.join("b.pack");
    baked_as(&[c, a, b], &other, Heights::Egm96, region, 1).expect("sound files");
    assert!(
        fs::read(&out).expect("baked") == fs::read(&other).expect("baked"),
        "byte for byte"
    );
}

#[test]
fn holes_are_filled_between_the_heights_around_them() {
    let Some(file) = data("N49E015.hgt") else {
        return;
    };
    let out = support::scratch_dir("bake_holes").join("out.pack");
    let (_, pack) = baked(std::slice::from_ref(&file), &out).expect("a sound file");
    let cell = hgt_cell(&file, 49, 15);
    let mut posts = Posts::of(&pack);
    let mut filled = 0;
    for j in 49 * 1200 + 8..50 * 1200 - 8 {
        for i in 15 * 1200 + 8..16 * 1200 - 8 {
            if !VOID.contains(&cell.at(i, j)) {
                continue;
            }
            let around = (-8..=8).flat_map(|dj| (-8..=8).map(move |di| (di, dj)));
            let heights = around
                .map(|(di, dj)| cell.at(i + di, j + dj))
                .filter(|h| !VOID.contains(h));
            let (low, high) = heights.fold((i16::MAX, i16::MIN), |(l, h), x| (l.min(x), h.max(x)));
            let (height_m, _) = posts.at(0, i, j);
            // A filled void may pass its rim by a quarter of the rim's range.
            let beyond = 0.25 * f64::from(high - low);
            assert!(
                (f64::from(low) - beyond..=f64::from(high) + beyond).contains(&height_m),
                "{i} {j}: {height_m} outside {low} to {high}"
            );
            filled += 1;
        }
    }
    assert_eq!(filled, 16, "the manifest's count");
}

#[test]
fn a_geotiff_off_the_posts_is_interpolated() {
    let Some(file) = data("ww_craterlake-elev-16bit-30m.tif") else {
        return;
    };
    let out = support::scratch_dir("bake_crater_lake").join("out.pack");
    let (report, pack) = baked(std::slice::from_ref(&file), &out).expect("a sound file");
    assert_eq!(
        report.info.grid.posts_per_degree, 3600,
        "about 1 arc second"
    );
    // Strips of one row each, their offsets under tag 273, which stands in the first directory.
    let bytes = fs::read(&file).expect("readable");
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("4")) as usize;
    let directory = word(4);
    let field = (0..30)
        .map(|n| directory + 2 + 12 * n)
        .find(|at| bytes[*at..*at + 2] == 273_u16.to_le_bytes())
        .expect("strip offsets");
    let strips = word(field + 8);
    let sample = |row: usize, column: usize| {
        let at = word(strips + 4 * row) + 2 * column;
        i16::from_le_bytes([bytes[at], bytes[at + 1]])
    };
    // ModelTiepoint and ModelPixelScale as another reader prints them; GTRasterType is PixelIsPoint.
    let step = 0.000_269_965_978_544_445_6;
    let (west, north) = (-122.165_447_703_198_64, 42.979_316_644_842_47);
    let mut posts = Posts::of(&pack);
    let (mut compared, mut void) = (0, 0);
    for j in (154_460..154_720).step_by(3) {
        for i in (-439_790..-439_390).step_by(3) {
            let x = (f64::from(i) / 3600.0 - west) / step;
            let y = (north - f64::from(j) / 3600.0) / step;
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "inside the raster"
            )]
            let (column, row) = (x as usize, y as usize);
            let (fx, fy) = (x.fract(), y.fract());
            // Within a hundredth of a sample a post is on it, and takes it alone.
            if [fx, fy].iter().any(|f| !(0.011..0.989).contains(f)) {
                continue;
            }
            let corners =
                [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(r, c)| sample(row + r, column + c));
            let (height_m, kind) = posts.at(0, i, j);
            if corners.iter().any(|c| VOID.contains(c)) {
                assert_eq!(kind, SurfaceKind::Void, "{i} {j}");
                void += 1;
                continue;
            }
            let [a, b, c, d] = corners.map(f64::from);
            let want = (a * (1.0 - fx) + b * fx) * (1.0 - fy) + (c * (1.0 - fx) + d * fx) * fy;
            assert_ne!(kind, SurfaceKind::Void, "{i} {j}");
            assert!(
                (height_m - want).abs() < 0.02,
                "{i} {j}: {height_m} for {want}"
            );
            compared += 1;
        }
    }
    assert!(
        compared > 5000 && void > 1000,
        "{compared} compared, {void} void"
    );
    let header_error = pack
        .keys()
        .filter(|k| k.level == 0)
        .filter_map(|k| pack.tile_header(k))
        .map(|h| h.max_error_m);
    assert!(
        header_error.fold(0.0, f32::max) <= 1.0 / 64.0 + 1e-3,
        "half a unit of 1/32 m"
    );
}

#[test]
fn heights_agree_with_the_source_and_the_published_geoid() {
    let Some(file) = data("N50E014.hgt") else {
        return;
    };
    let out = support::scratch_dir("bake_height").join("out.pack");
    let (_, pack) = baked(std::slice::from_ref(&file), &out).expect("a sound file");
    let cell = hgt_cell(&file, 50, 14);
    let mut ground = GroundReader::new(&pack);
    // A corner, where the manifest gives the undulation 45.78 m.
    let corner = ground.at(50.0, 14.0).expect("covered");
    let h = f64::from(cell.at(14 * 1200, 50 * 1200));
    assert!((corner.height_orthometric.0 - h).abs() < 1e-9);
    assert!((corner.height_ellipsoid.0 - h - 45.78).abs() < 0.01);
    // Between four posts.
    let (i, j) = (14 * 1200 + 312, 50 * 1200 + 120);
    let mean = [(0, 0), (1, 0), (0, 1), (1, 1)]
        .map(|(di, dj)| f64::from(cell.at(i + di, j + dj)))
        .iter()
        .sum::<f64>()
        / 4.0;
    let degrees = |p: i32| (f64::from(p) + 0.5) / 1200.0;
    let middle = ground.at(degrees(j), degrees(i)).expect("covered");
    assert!((middle.height_orthometric.0 - mean).abs() < 1e-6);
    // The far corner is covered, what lies beyond is not.
    assert!(ground.at(51.0, 15.0).is_ok());
    for (latitude, longitude) in [
        (51.001, 14.5),
        (50.5, 15.001),
        (50.5, 13.999),
        (-50.5, 14.5),
    ] {
        let e = ground.at(latitude, longitude).expect_err("not covered");
        assert!(matches!(e, HeightError::NotCovered), "{e:?}");
    }
    let e = ground.at(90.5, 14.5).expect_err("no latitude");
    assert!(matches!(e, HeightError::NoPlace), "{e:?}");
}

#[test]
fn the_date_line_has_one_height_from_both_sides() {
    let Some(file) = data("S20W180.hgt") else {
        return;
    };
    let out = support::scratch_dir("bake_date_line").join("out.pack");
    let (_, pack) = baked(std::slice::from_ref(&file), &out).expect("a sound file");
    let mut ground = GroundReader::new(&pack);
    for latitude in [-20.0, -19.77, -19.25, -19.0] {
        let west = ground.at(latitude, -180.0).expect("covered");
        let east = ground.at(latitude, 180.0).expect("the same meridian");
        assert_eq!(west, east);
    }
    assert!(
        ground.at(-19.5, 179.99).is_err(),
        "the other side is not covered"
    );
}

#[test]
fn ellipsoidal_inputs_lose_the_undulation() {
    let scratch = support::scratch_dir("bake_ellipsoidal");
    let file = scratch.join("N50E014.hgt");
    write_hgt(&file, |row, column| {
        i16::try_from((row * 3 + column * 5) % 700).expect("small")
    });
    let out = scratch.join("out.pack");
    let (_, pack) = baked_as(
        std::slice::from_ref(&file),
        &out,
        Heights::Ellipsoidal,
        None,
        2,
    )
    .expect("sound");
    let unit_m = pack.info().unit_m;
    assert!(unit_m < 0.1, "fractions are kept: {unit_m}");
    let cell = hgt_cell(&file, 50, 14);
    let mut ground = GroundReader::new(&pack);
    for (i, j) in [(16_800, 60_000), (17_003, 60_707), (18_000, 61_200)] {
        let (latitude, longitude) = (f64::from(j) / 1200.0, f64::from(i) / 1200.0);
        let got = ground.at(latitude, longitude).expect("covered");
        let source = f64::from(cell.at(i, j));
        assert!((got.height_ellipsoid.0 - source).abs() <= unit_m / 2.0 + 1e-3);
        let n = pack
            .geoid()
            .undulation_m(
                Radians::from_degrees(latitude),
                Radians::from_degrees(longitude),
            )
            .expect("covered");
        assert!((got.height_orthometric.0 - source + n).abs() <= unit_m / 2.0 + 1e-3);
    }
}

#[test]
fn a_region_takes_its_posts_and_no_others() {
    let Some(file) = data("N50E014.hgt") else {
        return;
    };
    let out = support::scratch_dir("bake_region").join("out.pack");
    let region = Bounds {
        south_deg: 50.25,
        west_deg: 14.1,
        north_deg: 50.5,
        east_deg: 14.2,
    };
    let inputs = [file.clone()];
    let (report, pack) =
        baked_as(&inputs, &out, Heights::Egm96, Some(region), 1).expect("a sound file");
    assert_eq!(report.info.posts, 301 * 121);
    assert_eq!(report.info.bounds, region);
    let cell = hgt_cell(&file, 50, 14);
    let mut posts = Posts::of(&pack);
    for j in 60_300..=60_600 {
        for i in 16_920..=17_040 {
            assert!((posts.at(0, i, j).0 - f64::from(cell.at(i, j))).abs() < 1e-9);
        }
    }
    assert_eq!(posts.at(0, 16_919, 60_400).1, SurfaceKind::Void, "outside");
    let nowhere = Bounds {
        south_deg: 10.0,
        north_deg: 11.0,
        ..region
    };
    let e = baked_as(&inputs, &out, Heights::Egm96, Some(nowhere), 1).expect_err("nothing there");
    assert!(matches!(e, BakeError::NothingInRegion));
}

#[test]
fn nothing_but_sea_and_nothing_at_all_are_packs_too() {
    let scratch = support::scratch_dir("bake_flat");
    let file = scratch.join("N10W030.hgt");
    let out = scratch.join("out.pack");
    write_hgt(&file, |_, _| 0);
    let (report, pack) = baked(std::slice::from_ref(&file), &out).expect("sea");
    assert_eq!(report.info.water_posts, 1201 * 1201);
    assert!(
        GroundReader::new(&pack)
            .at(10.5, -29.5)
            .expect("covered")
            .water
    );
    write_hgt(&file, |_, _| -32_768);
    let (report, pack) = baked(std::slice::from_ref(&file), &out).expect("voids");
    assert_eq!(report.info.void_posts, 1201 * 1201);
    let ground = GroundReader::new(&pack).at(10.5, -29.5).expect("covered");
    assert!(
        ground.void && ground.height_orthometric.0.abs() < 1e-9,
        "{ground:?}"
    );
}

#[test]
fn neighbours_that_disagree_are_reported_and_the_southern_or_western_one_is_taken() {
    let scratch = support::scratch_dir("bake_disagree");
    let (west, east) = (scratch.join("N10E020.hgt"), scratch.join("N10E021.hgt"));
    write_hgt(&west, |row, _| if row == 300 { 107 } else { 100 });
    write_hgt(&east, |_, column| if column == 0 { 100 } else { 120 });
    let out = scratch.join("out.pack");
    let (report, pack) = baked(&[east.clone(), west.clone()], &out).expect("a warning is no error");
    let [seam] = report.seams.as_slice() else {
        panic!("one seam: {:?}", report.seams);
    };
    assert_eq!((&seam.taken, &seam.other, seam.posts), (&west, &east, 1));
    assert!((seam.difference_m - 7.0).abs() < 1e-6);
    assert!((seam.latitude_deg - 10.75).abs() < 1e-9 && (seam.longitude_deg - 21.0).abs() < 1e-9);
    let (height_m, _) = Posts::of(&pack).at(0, 21 * 1200, 10 * 1200 + 900);
    assert!((height_m - 107.0).abs() < 1e-9);
}

#[test]
fn a_tiled_float_geotiff_of_areas_keeps_its_fractions() {
    // 40 x 24 samples of 3", their centres on posts, so that the tie point is half a sample outside; tiles of 32 x 16.
    let step = 1.0 / 1200.0;
    let height = |row: u32, column: u32| {
        if (row, column) == (3, 33) {
            -9999.0_f32
        } else {
            f32::from(u16::try_from(row * 100 + column).expect("small")) + 0.125
        }
    };
    let mut chunks = Vec::new();
    for (top, left) in [(0, 0), (0, 32), (16, 0), (16, 32)] {
        let mut chunk = Vec::new();
        for row in top..top + 16 {
            for column in left..left + 32 {
                let inside = row < 24 && column < 40;
                let h = if inside { height(row, column) } else { 77.0 };
                chunk.extend(h.to_le_bytes());
            }
        }
        chunks.push(chunk);
    }
    let mut fields = picture(40, 24, 32, 3);
    fields.extend([
        Field::longs(322, &[32]),
        Field::longs(323, &[16]),
        Field::doubles(33_550, &[step, step, 0.0]),
        Field::doubles(
            33_922,
            &[0.0, 0.0, 0.0, 7.0 - step / 2.0, 46.0 + step / 2.0, 0.0],
        ),
        Field::text(42_113, "-9999"),
        geokeys(1, &[[2048, 0, 1, 4326]]),
    ]);
    let scratch = support::scratch_dir("bake_float");
    let file = scratch.join("float.tif");
    fs::write(&file, tiff(&chunks, 324, 325, fields)).expect("written");
    let out = scratch.join("out.pack");
    let (report, pack) = baked(&[file], &out).expect("a sound file");
    assert_eq!(report.info.posts, 40 * 24);
    let mut posts = Posts::of(&pack);
    for row in 0..24_u32 {
        for column in 0..40_u32 {
            let (i, j) = (
                7 * 1200 + column.cast_signed(),
                46 * 1200 - row.cast_signed(),
            );
            let (height_m, kind) = posts.at(0, i, j);
            if (row, column) == (3, 33) {
                assert_eq!(kind, SurfaceKind::Void);
            } else {
                assert!(
                    (height_m - f64::from(height(row, column))).abs() < 1e-9,
                    "{row} {column}"
                );
            }
        }
    }
}

#[test]
fn unsigned_heights_and_a_transformation_matrix_are_read() {
    let step = 1.0 / 3600.0;
    let samples: Vec<u16> = (0..64).map(|n| n * 100).collect();
    let strip: Vec<u8> = samples.iter().flat_map(|s| s.to_le_bytes()).collect();
    let mut fields = picture(8, 8, 16, 1);
    let matrix = [
        step, 0.0, 0.0, 10.0, 0.0, -step, 0.0, 47.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0,
    ];
    fields.extend([
        Field::longs(278, &[8]),
        Field::doubles(34_264, &matrix),
        geokeys(2, &[[2048, 0, 1, 4326]]),
    ]);
    let scratch = support::scratch_dir("bake_unsigned");
    let file = scratch.join("unsigned.tiff");
    fs::write(&file, tiff(&[strip], 273, 279, fields)).expect("written");
    let (report, pack) = baked(&[file], &scratch.join("out.pack")).expect("a sound file");
    assert_eq!(report.info.grid.posts_per_degree, 3600);
    let mut posts = Posts::of(&pack);
    let (height_m, _) = posts.at(0, 36_000 + 7, 47 * 3600 - 7);
    assert!(
        (height_m - 6300.0).abs() < 1e-9,
        "the last sample: {height_m}"
    );
}

#[test]
fn a_damaged_geotiff_is_read_or_refused_but_never_a_panic() {
    let step = 1.0 / 3600.0;
    let strips: Vec<Vec<u8>> = (0..4).map(|n| vec![n; 32]).collect();
    let mut fields = picture(8, 8, 16, 2);
    fields.extend([
        Field::longs(278, &[2]),
        Field::doubles(33_550, &[step, step, 0.0]),
        Field::doubles(33_922, &[0.0, 0.0, 0.0, 10.0, 47.0, 0.0]),
        geokeys(2, &[[2048, 0, 1, 4326]]),
    ]);
    let sound = tiff(&strips, 273, 279, fields);
    assert!(geotiff::read(sound.clone()).is_ok(), "it is sound as it is");
    for at in 0..sound.len() {
        for bit in 0..8 {
            let mut bad = sound.clone();
            bad[at] ^= 1 << bit;
            let _ = geotiff::read(bad);
        }
        let _ = geotiff::read(sound[..at].to_vec());
    }
}
