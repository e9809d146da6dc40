//! Every tile comes back within its bound, whatever it is predicted from.

use super::*;
use proptest::prelude::*;

/// A tile of rough ground, the same for the same seed.
fn rough(seed: u32, spread: u32) -> Tile {
    let mut tile = Tile::filled(0, SurfaceKind::Land);
    let mut state = seed;
    let mut walk = 20_000_i32;
    for at in 0..TILE_AREA {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let random = i32::try_from((state >> 16) % (2 * spread + 1)).expect("small");
        walk = (walk + random - i32::try_from(spread).expect("small")).clamp(0, 65_535);
        let south = at
            .checked_sub(TILE_POSTS)
            .map_or(walk, |s| i32::from(tile.quanta[s]));
        tile.quanta[at] = u16::try_from((walk + south) / 2).expect("16 bits");
    }
    tile
}

/// The parent that sampling gives: every second post of four children, here of one four times.
fn parent_of_tile(tile: &Tile) -> Tile {
    let mut parent = Tile::filled(0, SurfaceKind::Land);
    for at in 0..TILE_AREA {
        let (x, y) = (at % TILE_POSTS % HALF, at / TILE_POSTS % HALF);
        let from = Sort::Even.index(x, y);
        (parent.quanta[at], parent.kind[at]) = (tile.quanta[from], tile.kind[from]);
    }
    parent
}

/// Encodes, decodes and compares; gives the number of bytes.
fn round_trip(tile: &Tile, parent: Option<Parent<'_>>, bound: u16) -> usize {
    let mut promised = Tile::filled(1, SurfaceKind::Void);
    let step = step_of(f64::from(bound));
    let stored = PyramidEncoder::new().encode(tile, parent, step, &mut promised);
    assert!(stored.len() <= PYRAMID_BYTES_MAX, "{} bytes", stored.len());
    let mut decoded = Tile::filled(7, SurfaceKind::Void);
    PyramidDecoder::new()
        .decode(&stored, parent, &mut decoded)
        .expect("own bytes");
    assert!(
        decoded == promised,
        "the reader has what the writer promised"
    );
    assert!(decoded.kind == tile.kind, "kinds are exact");
    for at in 0..TILE_AREA {
        let error = decoded.quanta[at].abs_diff(tile.quanta[at]);
        let allowed = match tile.kind[at] {
            SurfaceKind::Land => bound,
            SurfaceKind::Water | SurfaceKind::Void => 0,
        };
        assert!(
            error <= allowed,
            "post {at} is {error} off, {allowed} allowed"
        );
    }
    stored.len()
}

#[test]
fn ground_comes_back_within_every_bound_in_every_quadrant() {
    let tile = rough(5, 40);
    let parent = parent_of_tile(&tile);
    for (east, north) in [(false, false), (true, false), (false, true), (true, true)] {
        let tile_of = Some(Parent {
            tile: &parent,
            east,
            north,
        });
        let mut last = usize::MAX;
        for bound in [0, 1, 2, 8, 100, 16_000] {
            let bytes = round_trip(&tile, tile_of, bound);
            assert!(
                bytes <= last,
                "a wider bound takes no more: {bytes} after {last}"
            );
            last = bytes;
        }
    }
    round_trip(&tile, None, 0);
    round_trip(&tile, None, 3);
}

#[test]
fn a_raised_parent_and_extremes_of_the_range_do_no_harm() {
    let mut tile = rough(9, 300);
    let mut parent = parent_of_tile(&tile);
    for at in (0..TILE_AREA).step_by(37) {
        parent.quanta[at] = parent.quanta[at].saturating_add(250);
    }
    let of = |parent| {
        Some(Parent {
            tile: parent,
            east: true,
            north: false,
        })
    };
    round_trip(&tile, of(&parent), 2);
    for (at, post) in tile.quanta.iter_mut().enumerate() {
        *post = if at % 3 == 0 { 0 } else { u16::MAX };
    }
    round_trip(&tile, of(&parent), 2);
    round_trip(&tile, of(&tile), 0);
    round_trip(&tile, None, 2);
}

/// A lake, a coast and a hole: told exactly, and cheaply where flat.
#[test]
fn water_and_voids_are_exact() {
    let mut tile = rough(3, 12);
    for at in 0..TILE_AREA {
        let (x, y) = (at % TILE_POSTS, at / TILE_POSTS);
        if (x / 3 + y / 5) % 4 == 0 {
            (tile.quanta[at], tile.kind[at]) = (1000, SurfaceKind::Water);
        } else if x > 100 {
            tile.kind[at] = SurfaceKind::Void;
        }
    }
    let parent = parent_of_tile(&tile);
    for bound in [0, 2, 50] {
        round_trip(
            &tile,
            Some(Parent {
                tile: &parent,
                east: false,
                north: true,
            }),
            bound,
        );
        round_trip(&tile, None, bound);
    }
    let mut coast = Tile::filled(1000, SurfaceKind::Water);
    for at in 0..TILE_AREA {
        if at % TILE_POSTS < 40 {
            (coast.quanta[at], coast.kind[at]) = (1300, SurfaceKind::Land);
        }
    }
    let parent = parent_of_tile(&coast);
    let of = Some(Parent {
        tile: &parent,
        east: false,
        north: false,
    });
    let bytes = round_trip(&coast, of, 0);
    assert!(bytes < 400, "{bytes} bytes for a straight coast");
}

#[test]
fn flat_tiles_take_five_bytes() {
    for kind in [SurfaceKind::Land, SurfaceKind::Water, SurfaceKind::Void] {
        assert_eq!(round_trip(&Tile::filled(40_000, kind), None, 2), 5);
    }
}

#[test]
fn the_parent_and_its_quadrant_follow_from_the_key() {
    use crate::terrain::partition::Partition;
    let key = |level, column, row| TileKey {
        partition: Partition::Geographic,
        level,
        column,
        row,
    };
    assert_eq!(parent_of(key(0, -1, 5)), key(1, -1, 2));
    let tile = Tile::filled(0, SurfaceKind::Land);
    let parent = Parent::new(&tile, key(0, -1, 4));
    assert!(
        parent.east && !parent.north,
        "odd columns are eastern, also below 0"
    );
}

#[test]
fn steps_keep_their_bounds() {
    assert_eq!([0.0, 0.9, 1.0, 2.5, 2.99].map(step_of), [1, 1, 3, 5, 5]);
    assert_eq!(step_of(f64::NAN), 1, "what is no bound is lossless");
    for step in [1, 3, 5, 17, 33] {
        for r in -40..=40 {
            let error = (r - nearest(r, step) * step).abs();
            assert!(error <= step / 2, "{r} by {step}");
        }
    }
}

#[test]
fn what_was_never_a_tile_is_named() {
    let tile = rough(1, 9);
    let parent = parent_of_tile(&tile);
    let of = Some(Parent {
        tile: &parent,
        east: false,
        north: false,
    });
    let mut decoded = Tile::filled(7, SurfaceKind::Void);
    let stored = PyramidEncoder::new().encode(&tile, of, 5, &mut decoded);
    let mut kept = Tile::filled(7, SurfaceKind::Void);
    let mut decoder = PyramidDecoder::new();
    assert_eq!(
        decoder.decode(&stored, None, &mut kept),
        Err(CodecError::Parent)
    );
    for length in [0, 1, 6, 20, stored.len() / 2, stored.len() - 1] {
        let cut = decoder.decode(&stored[..length], of, &mut kept);
        assert!(
            cut.is_err(),
            "{length} bytes of {} are no tile",
            stored.len()
        );
    }
    let mut longer = stored;
    longer.push(0);
    assert!(
        decoder.decode(&longer, of, &mut kept).is_err(),
        "nor is one byte more"
    );
    assert!(
        kept == Tile::filled(7, SurfaceKind::Void),
        "a failed read leaves the tile alone"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn any_tile_comes_back_within_its_bound(
        posts in prop::collection::vec(
            prop_oneof![Just(0_u16), Just(65_535), any::<u16>(), 1000_u16..1010],
            TILE_AREA,
        ),
        kinds in prop::collection::vec(0_u8..3, 64),
        bound in 0_u16..3000,
        plain in any::<bool>(),
    ) {
        let mut tile = Tile::filled(0, SurfaceKind::Land);
        tile.quanta.copy_from_slice(&posts);
        if !plain {
            for (at, kind) in tile.kind.iter_mut().enumerate() {
                *kind = SurfaceKind::from_byte(kinds[at / 7 % 64]).expect("0, 1 or 2");
            }
        }
        let parent = parent_of_tile(&tile);
        round_trip(&tile, Some(Parent { tile: &parent, east: true, north: true }), bound);
    }

    #[test]
    fn any_bytes_are_survived(bytes in prop::collection::vec(any::<u8>(), 0..600), flags in 0_u8..16) {
        let mut bytes = bytes;
        if let Some(first) = bytes.first_mut() {
            *first = flags;
        }
        let parent = rough(2, 5);
        let of = (flags & ALONE == 0).then_some(Parent { tile: &parent, east: false, north: false });
        let _ = PyramidDecoder::new().decode(&bytes, of, &mut Tile::filled(0, SurfaceKind::Land));
    }
}
