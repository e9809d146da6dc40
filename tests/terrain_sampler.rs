//! Texels where columns are not simply counted on: coarse levels over the date line, and the caps.

mod clipmap_support;

use clipmap_support::{Land, mountains};
use glasswing::geo::Geodetic;
use glasswing::terrain::codec::SurfaceKind;
use glasswing::terrain::grid::Grid;
use glasswing::terrain::partition::Partition;
use glasswing::terrain::surface::{Damage, Sampler, TileSource};
use glasswing::terrain::tables::HeightCode;
use glasswing::units::Radians;

/// Texels of a patch of posts: own and coarser height codes.
fn texels(
    sampler: &mut Sampler<'_, Land>,
    level: u8,
    at: (i32, i32),
    (width, height): (usize, usize),
) -> Vec<[u16; 2]> {
    let (mut heights, mut surface) = (vec![[0; 2]; width * height], vec![[0; 4]; width * height]);
    sampler.fill(level, at, (width, height), &mut heights, &mut surface);
    heights
}

#[test]
fn coarse_levels_have_the_ground_of_their_places_on_both_sides_of_the_date_line() {
    for posts_per_degree in [1200, 3600] {
        let grid = Grid { posts_per_degree };
        let land = Land::new(posts_per_degree, mountains);
        let damage = Damage::default();
        let codes = HeightCode::covering(-500.0, 7000.0);
        let mut sampler = Sampler::new(&land, Partition::Geographic, codes, &damage);
        let (width, height) = (40_usize, 5_usize);
        for level in 6..grid.level_count() {
            // Windows are counted on over the line from where the eye came: half before it, half behind.
            let line = (grid.posts_around() / 2) >> level;
            for west in [line - 20, -line - 20] {
                let south = 17;
                let got = texels(&mut sampler, level, (west, south), (width, height));
                for (y, j) in (0..height).zip(south..) {
                    for (x, i) in (0..width).zip(west..) {
                        let longitude = Radians::from_degrees(grid.longitude_deg(level, i));
                        let latitude = Radians::from_degrees(grid.latitude_deg(level, j));
                        let ellipsoidal = land.height_m(i << level, j << level)
                            + land.undulation_m(latitude, longitude).expect("known");
                        let [own, coarser] = got[y * width + x];
                        assert!(
                            own.abs_diff(codes.encode(ellipsoidal)) <= 1,
                            "level {level}, {i} {j}: {} m for {ellipsoidal}",
                            codes.decode(own)
                        );
                        let shared = i % 2 == 0 && j % 2 == 0;
                        if shared && level + 1 < grid.level_count() {
                            assert!(own.abs_diff(coarser) <= 1, "level {level}, {i} {j}");
                        }
                    }
                }
            }
        }
    }
}

/// Metres between two places of a grid of 3" whose columns and rows are those of a partition.
fn chord_m(partition: Partition, a: (i32, i32), b: (i32, i32)) -> f64 {
    let ecef = |(i, j): (i32, i32)| {
        let (longitude, latitude) =
            partition.to_geodetic(f64::from(i) / 1200.0, f64::from(j) / 1200.0);
        Geodetic::from_degrees(latitude, longitude, 0.0).to_ecef()
    };
    (ecef(b) - ecef(a)).length()
}

/// A plane in post coordinates: 4 m a post eastwards, 3 m northwards, of a few hundred posts around a middle.
fn slope(i: i32, j: i32) -> (f64, SurfaceKind) {
    (
        4.0 * f64::from(i % 400) + 3.0 * f64::from(j % 400) + 2800.0,
        SurfaceKind::Land,
    )
}

#[test]
fn a_cap_post_stands_on_the_geoid_of_its_geodetic_place_and_does_not_wrap() {
    let land = Land::new(1200, mountains);
    let damage = Damage::default();
    let codes = HeightCode::covering(-500.0, 7000.0);
    for cap in [Partition::North, Partition::South] {
        let mut sampler = Sampler::new(&land, cap, codes, &damage);
        for (level, i, j) in [(0, 0, 0), (0, 24_000, -3), (0, -17, 20_000), (5, -700, 400)] {
            let got = texels(&mut sampler, level, (i, j), (1, 1))[0][0];
            let degrees = |post: i32| f64::from(post << level) / 1200.0;
            let (longitude, latitude) = cap.to_geodetic(degrees(i), degrees(j));
            let undulation = land.undulation_m(
                Radians::from_degrees(latitude),
                Radians::from_degrees(longitude),
            );
            let ellipsoidal =
                land.height_m(i << level, j << level) + undulation.expect("everywhere");
            assert!(
                got.abs_diff(codes.encode(ellipsoidal)) <= 1,
                "{cap:?} level {level}, {i} {j}: {} m for {ellipsoidal}",
                codes.decode(got)
            );
        }
    }
}

#[test]
fn slopes_of_a_cap_are_those_of_its_ground() {
    let land = Land::new(1200, slope);
    let damage = Damage::default();
    let codes = HeightCode::covering(-500.0, 7000.0);
    for partition in Partition::ALL {
        let mut sampler = Sampler::new(&land, partition, codes, &damage);
        for (i, j) in [(100, 100), (-29_300, 120), (28_100, -27_300)] {
            let (mut heights, mut surface) = ([[0; 2]; 1], [[0; 4]; 1]);
            sampler.fill(0, (i, j), (1, 1), &mut heights, &mut surface);
            // The geoid of the test's land adds less than 3 cm a post here: a thousandth of a slope.
            let east = 8.0 / chord_m(partition, (i - 1, j), (i + 1, j));
            let north = 6.0 / chord_m(partition, (i, j - 1), (i, j + 1));
            let length = (east * east + north * north + 1.0).sqrt();
            for (byte, component) in [(surface[0][0], -east), (surface[0][1], -north)] {
                let c = (f64::from(byte) - 128.0) / 127.0;
                let got = c * (0.5 + 0.5 * c.abs());
                assert!(
                    (got - component / length).abs() < 0.008,
                    "{partition:?} {i} {j}: {got} for {}",
                    component / length
                );
            }
        }
    }
}

#[test]
fn a_damaged_cap_tile_is_inherited_from_the_coarser_level_of_its_cap() {
    let land = Land::new(1200, mountains)
        .broken(|key| key.partition == Partition::North && key.level == 0);
    let damage = Damage::default();
    let codes = HeightCode::covering(-500.0, 7000.0);
    let mut sampler = Sampler::new(&land, Partition::North, codes, &damage);
    let (width, height) = (20_usize, 20_usize);
    let (mut fine, mut surface) = (vec![[0; 2]; width * height], vec![[0; 4]; width * height]);
    sampler.fill(0, (-10, -10), (width, height), &mut fine, &mut surface);
    let coarse = texels(&mut sampler, 1, (-5, -5), (width / 2, height / 2));
    for y in 0..height {
        for x in 0..width {
            let [own, coarser] = fine[y * width + x];
            assert_eq!(own, coarser, "as the coarser triangles lie");
            assert_eq!(surface[y * width + x][3], 255, "marked as void");
            if x % 2 == 0 && y % 2 == 0 {
                assert_eq!(own, coarse[y / 2 * (width / 2) + x / 2][0]);
            }
        }
    }
    assert_eq!(damage.counts().checksum, 4, "the four tiles at the pole");
    let mut whole = Sampler::new(&land, Partition::South, codes, &damage);
    whole.fill(0, (-10, -10), (width, height), &mut fine, &mut surface);
    assert!(
        surface.iter().all(|s| s[3] != 255),
        "the other cap is whole"
    );
}
