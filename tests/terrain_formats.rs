//! Elevation files of other kinds than SRTM's: DTED and GeoTIFF in UTM, against independent readings and an independent
//! projection; and what is said of those that cannot be used.

#![expect(
    clippy::expect_used,
    reason = "a test says what it needs and fails where that is not so"
)]

use std::fs;

use glasswing::terrain::bake::BakeError;
use glasswing::terrain::codec::SurfaceKind;
use glasswing::terrain::{dted, geotiff};

mod support;
#[path = "terrain_bake_support/mod.rs"]
mod with;

use with::{Field, Posts, baked, geokeys, model_keys, picture, tiff};

/// A DTED file (MIL-PRF-89020B, figures 1 to 4): `height` is asked by profile from the west and point from the south and
/// gives the 16 bits as they stand.
fn dted_file(
    origin: (&str, &str),
    intervals: (u32, u32),
    counts: (usize, usize),
    height: impl Fn(usize, usize) -> u16,
) -> Vec<u8> {
    let mut file = format!(
        "UHL1{}{}{:04}{:04}0020U  {:12}{:04}{:04}0{:24}",
        origin.0, origin.1, intervals.0, intervals.1, "", counts.0, counts.1, ""
    )
    .into_bytes();
    assert_eq!(file.len(), 80, "the header of a DTED file");
    let mut dsi = vec![b' '; 648];
    dsi[..4].copy_from_slice(b"DSIU");
    dsi[141..149].copy_from_slice(b"E96WGS84");
    file.extend(dsi);
    file.extend([b' '; 2700]);
    for column in 0..counts.0 {
        let mut profile = vec![0xaa, 0, 0, 0];
        let number = u16::try_from(column).expect("few");
        profile.extend(number.to_be_bytes());
        profile.extend([0, 0]);
        for row in 0..counts.1 {
            profile.extend(height(column, row).to_be_bytes());
        }
        let sum: u32 = profile.iter().map(|b| u32::from(*b)).sum();
        profile.extend(sum.to_be_bytes());
        file.extend(profile);
    }
    file
}

fn bake_one(
    name: &str,
    file: &str,
    bytes: &[u8],
) -> Result<glasswing::terrain::pack::Pack, BakeError> {
    let scratch = support::scratch_dir(name);
    let path = scratch.join(file);
    fs::write(&path, bytes).expect("written");
    baked(&[path], &scratch.join("out.pack")).map(|(_, pack)| pack)
}

#[test]
fn a_real_dted_cell_is_kept() {
    let Some(data) = support::data_dir() else {
        support::skip("elevation data");
        return;
    };
    if support::is_emulated() {
        support::skip("a whole cell takes a minute under emulation");
        return;
    }
    let path = data.join("elev/n33_w116.dt1");
    let file = fs::read(&path).expect("test data is readable");
    let scratch = support::scratch_dir("dted_real");
    let (report, pack) = baked(&[path], &scratch.join("out.pack")).expect("a sound file");
    assert_eq!(report.info.grid.posts_per_degree, 1200);
    let mut posts = Posts::of(&pack);
    let mut lowest = 0;
    for column in 0..1201 {
        for row in 0..1201 {
            let at = 3428 + column * (12 + 2 * 1201) + 8 + 2 * row;
            let raw = i32::from(file[at]) << 8 | i32::from(file[at + 1]);
            let height = if raw < 0x8000 { raw } else { 0x8000 - raw };
            assert_ne!(height, -32_767, "this cell has no voids");
            lowest = lowest.min(height);
            let place = (
                -116 * 1200 + i32::try_from(column).expect("small"),
                33 * 1200 + i32::try_from(row).expect("small"),
            );
            let (height_m, kind) = posts.at(0, place.0, place.1);
            assert_ne!(kind, SurfaceKind::Void);
            assert!(
                (height_m - f64::from(height)).abs() < 1e-9,
                "{place:?}: {height_m} where the file has {height}"
            );
        }
    }
    assert_eq!(lowest, -87, "the Salton Sea lies below the sea");
}

#[test]
fn a_dted_cell_of_the_north_has_fewer_profiles_than_points() {
    // Level 0 in the zone from 50 to 70 degrees: 30" northwards, 60" eastwards.
    let height = |column: usize, row: usize| match (column, row) {
        (10, 20) => 0xffff,
        (11, 20) => 0x8000 | 7,
        _ => u16::try_from(column * 10 + row).expect("small"),
    };
    let file = dted_file(("0100000E", "0600000N"), (600, 300), (61, 121), height);
    let pack = bake_one("dted_north", "n60.dt0", &file).expect("a sound file");
    assert_eq!(pack.info().grid.posts_per_degree, 120);
    let mut posts = Posts::of(&pack);
    let (i, j) = (10 * 120, 60 * 120);
    assert!((posts.at(0, i + 2 * 33, j + 100).0 - 430.0).abs() < 1e-9);
    assert!(
        (posts.at(0, i + 2 * 33 + 1, j + 100).0 - 435.0).abs() < 0.02,
        "halfway between two profiles"
    );
    assert_eq!(posts.at(0, i + 20, j + 20).1, SurfaceKind::Void, "null");
    assert!(
        (posts.at(0, i + 22, j + 20).0 + 7.0).abs() < 0.02,
        "signed magnitude"
    );
}

#[test]
fn dted_heights_in_twos_complement_are_told_from_signed_magnitude() {
    let below = |column: usize, _| if column < 3 { 0xfff0 } else { 5 };
    let file = dted_file(("1160000W", "0330000N"), (300, 300), (121, 121), below);
    let raster = dted::parse(&file).expect("a sound file");
    assert_eq!(raster.contents().range_m, Some((-16.0, 5.0)));
}

#[test]
fn damaged_dted_files_are_refused_with_what_is_wrong() {
    let sound = dted_file(("0100000E", "0460000N"), (300, 300), (121, 121), |_, _| 300);
    assert!(dted::parse(&sound).is_ok(), "it is sound as it is");
    let why = |bytes: &[u8]| dted::parse(bytes).expect_err("damaged").to_string();
    let with = |at: usize, bytes: &[u8]| {
        let mut bad = sound.clone();
        bad[at..at + bytes.len()].copy_from_slice(bytes);
        why(&bad)
    };
    assert!(
        why(&sound[..sound.len() - 1]).contains("bytes"),
        "cut short"
    );
    assert!(why(b"UHL1").contains("ends after 4 bytes"));
    assert!(with(0, b"HDR").contains("UHL1"));
    assert!(with(47, b"12x1").contains("number of longitude lines"));
    assert!(with(80 + 144, b"NAD27").contains("NAD27"), "another datum");
    assert!(
        with(80 + 141, b"NVD").contains("NVD"),
        "another vertical datum"
    );
    let profile = 12 + 2 * 121;
    assert!(
        with(3428 + 5 * profile + 100, &[9]).contains("profile 6"),
        "a wrong checksum"
    );
    for at in 0..80 {
        for bit in 0..8 {
            let mut bad = sound.clone();
            bad[at] ^= 1 << bit;
            let _ = dted::parse(&bad);
        }
    }
}

/// A plane over eastings and northings, 30 m between samples, as a float GeoTIFF.
fn utm_plane(keys: Field, (west, north): (f64, f64), side: u32) -> Vec<u8> {
    let mut strip = Vec::new();
    for row in 0..side {
        for column in 0..side {
            let (x, y) = (30.0 * f64::from(column), 30.0 * f64::from(row));
            #[expect(clippy::cast_possible_truncation, reason = "metres to f32's precision")]
            strip.extend((plane(x, -y) as f32).to_le_bytes());
        }
    }
    let mut fields = picture(side, side, 32, 3);
    fields.extend([
        Field::longs(278, &[side]),
        Field::doubles(33_550, &[30.0, 30.0, 0.0]),
        Field::doubles(33_922, &[0.0, 0.0, 0.0, west, north, 0.0]),
        keys,
    ]);
    tiff(&[strip], 273, 279, fields)
}

/// Metres, by metres east and north of the first sample.
fn plane(x: f64, y: f64) -> f64 {
    500.0 + 0.01 * x - 0.02 * y
}

#[test]
fn a_geotiff_in_utm_lies_where_another_projection_says() {
    // Posts of 1" around 51.5 N 14 E, and their eastings and northings in zone 33 by PROJ 9.5.1.
    let north = [
        (0, 0, 430_588.048_9, 5_705_903.240_2),
        (60, 0, 431_744.889_1, 5_705_887.569_0),
        (-60, 50, 429_452.663_5, 5_707_463.751_8),
        (33, -47, 431_204.660_8, 5_704_442.686_8),
        (-50, -60, 429_598.348_1, 5_704_063.012_9),
    ];
    // 17 S 180 W in zone 1 south: the western edge of the zone is the date line.
    let south = [
        (0, 0, 180_548.446_8, 8_117_998.190_9),
        (-40, 30, 179_350.193_8, 8_118_902.952_2),
    ];
    let cases = [
        (
            "utm_north",
            model_keys(1, 2, &[[3072, 0, 1, 32_633]]),
            (428_000.0, 5_708_500.0),
            (14 * 3600, 51 * 3600 + 1800),
            &north[..],
        ),
        // The same projection without the system's code: user-defined, by the projection's own over WGS 84.
        (
            "utm_south",
            model_keys(
                1,
                2,
                &[
                    [2048, 0, 1, 4326],
                    [3072, 0, 1, 32_767],
                    [3074, 0, 1, 16_101],
                    [3076, 0, 1, 9001],
                ],
            ),
            (177_000.0, 8_121_000.0),
            (-180 * 3600, -17 * 3600),
            &south[..],
        ),
    ];
    for (name, keys, (west, top), (i0, j0), places) in cases {
        let file = utm_plane(keys, (west, top), 200);
        let pack = bake_one(name, "plane.tif", &file).expect("a sound file");
        assert_eq!(pack.info().grid.posts_per_degree, 3600, "{name}");
        let mut posts = Posts::of(&pack);
        for &(i, j, x, y) in places {
            let around: i32 = 360 * 3600;
            let column = (i0 + i + around / 2).rem_euclid(around) - around / 2;
            let (height_m, kind) = posts.at(0, column, j0 + j);
            assert_eq!(kind, SurfaceKind::Land, "{name} {i} {j}");
            let wanted = plane(x - west, y - top);
            assert!(
                (height_m - wanted).abs() <= 0.5 * pack.info().unit_m + 1e-3,
                "{name} {i} {j}: {height_m}, by the plane {wanted}"
            );
        }
    }
}

#[test]
fn other_coordinates_are_named() {
    let refused = |keys| {
        geotiff::read(utm_plane(keys, (428_000.0, 5_708_500.0), 8))
            .expect_err("not to be read")
            .to_string()
    };
    assert!(refused(model_keys(1, 2, &[[3072, 0, 1, 25_833]])).contains("EPSG:25833"));
    assert!(refused(model_keys(1, 2, &[[3072, 0, 1, 32_767]])).contains("of its own"));
    assert!(
        refused(model_keys(
            1,
            2,
            &[[3072, 0, 1, 32_633], [3076, 0, 1, 9003]]
        ))
        .contains("9003")
    );
    assert!(
        refused(geokeys(2, &[[2048, 0, 1, 4326]])).contains("beyond the Earth"),
        "metres called degrees"
    );
    let far = utm_plane(model_keys(1, 2, &[[3072, 0, 1, 32_633]]), (14.0, 51.0), 8);
    assert!(
        geotiff::read(far).is_ok(),
        "the equator west of the zone is still on its grid"
    );
    let farther = utm_plane(model_keys(1, 2, &[[3072, 0, 1, 32_633]]), (9e6, 51.0), 8);
    assert!(
        geotiff::read(farther)
            .expect_err("far")
            .to_string()
            .contains("UTM zone")
    );
}

#[test]
fn a_damaged_utm_geotiff_is_never_a_panic() {
    let sound = utm_plane(
        model_keys(1, 2, &[[3072, 0, 1, 32_633]]),
        (428_000.0, 5_708_500.0),
        4,
    );
    for at in 0..sound.len() {
        for bit in 0..8 {
            let mut bad = sound.clone();
            bad[at] ^= 1 << bit;
            let _ = geotiff::read(bad);
        }
    }
}
