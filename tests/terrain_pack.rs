//! Packs as files: what is written comes back, and whatever is wrong with a file is named.

#![expect(
    clippy::expect_used,
    reason = "a test says what it needs and fails where that is not so"
)]

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use glasswing::terrain::codec::{Encoder, SurfaceKind, Tile};
use glasswing::terrain::geoid::GeoidGrid;
use glasswing::terrain::grid::{Grid, TILE_AREA, TileKey};
use glasswing::terrain::pack::{
    FORMAT, Pack, PackError, PostRect, SourceInfo, TileError, TileReader,
};
use glasswing::terrain::partition::Partition;
use glasswing::terrain::store::{EncodedTile, PackWriter, Scale, Statistics};
use proptest::prelude::*;

mod support;

const GRID: Grid = Grid {
    posts_per_degree: 1200,
};
const SCALE: Scale = Scale {
    unit_m: 0.5,
    base_m: -1000.0,
};
const RECT: PostRect = PostRect {
    south: -10,
    west: -20,
    north: 200,
    east: 100,
};

/// Tiles around 0N 0E and the south pole: one rough, one with every kind, one on a coarse level.
fn tiles() -> Vec<(TileKey, Tile)> {
    let mut rough = Tile::filled(0, SurfaceKind::Land);
    let mut mixed = Tile::filled(2000, SurfaceKind::Land);
    for at in 0..TILE_AREA {
        rough.quanta[at] = u16::try_from(at * 40_503 % 65_536).expect("below 65536");
        mixed.kind[at] = SurfaceKind::from_byte(u8::try_from(at % 3).expect("0 to 2"))
            .expect("0 to 2 are kinds");
    }
    let key = |partition, level, column, row| TileKey {
        partition,
        level,
        column,
        row,
    };
    vec![
        (key(Partition::South, 0, 0, 0), rough),
        (key(Partition::Geographic, 0, -1, -1), mixed),
        (
            key(Partition::Geographic, 7, -1, 0),
            Tile::filled(65_535, SurfaceKind::Water),
        ),
    ]
}

fn write(path: &Path) {
    let mut writer = PackWriter::create(path, GRID, SCALE).expect("a place to write");
    let mut encoder = Encoder::new();
    for (key, tile) in tiles() {
        let encoded = EncodedTile::new(&mut encoder, key, &tile, 0.25);
        writer.add(&encoded).expect("space to write");
    }
    let source = SourceInfo {
        name: "made up".to_owned(),
        rect: RECT,
    };
    let statistics = Statistics {
        heights_m: Some((-12.5, 4810.0)),
        posts: 121 * 211,
        void_posts: 7,
        water_posts: 8,
    };
    writer
        .finish(&GeoidGrid::over(GRID, &[RECT], 1), &[source], &statistics)
        .expect("space to write");
}

/// A sound pack in the test's own folder, and its bytes.
fn sound(test: &str) -> (PathBuf, Vec<u8>) {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    let bytes = BYTES.get_or_init(|| {
        let path = support::scratch_dir("pack_sound").join("test.pack");
        write(&path);
        fs::read(&path).expect("just written")
    });
    let path = support::scratch_dir(test).join("test.pack");
    fs::write(&path, bytes).expect("written");
    (path, bytes.clone())
}

fn read(pack: &Pack, key: TileKey) -> Result<Tile, TileError> {
    let mut tile = Tile::filled(1, SurfaceKind::Void);
    pack.read_tile(key, &mut TileReader::new(), &mut tile)?;
    Ok(tile)
}

#[test]
fn a_pack_comes_back_as_it_was_written() {
    let (path, bytes) = sound("pack_comes_back");
    let pack = Pack::open(&path).expect("sound");
    let info = pack.info();
    assert_eq!((info.version, info.grid, info.levels), (FORMAT, GRID, 10));
    assert_eq!((info.tiles, info.bytes), (3, bytes.len() as u64));
    assert!(info.has(Partition::Geographic) && info.has(Partition::South));
    assert!(!info.has(Partition::North), "known from the index");
    assert_eq!(
        (info.posts, info.void_posts, info.water_posts),
        (121 * 211, 7, 8)
    );
    assert!((info.height_min_m + 12.5).abs() < 1e-9 && (info.height_max_m - 4810.0).abs() < 1e-9);
    assert!((info.bounds.north_deg - 200.0 / 1200.0).abs() < 1e-12);
    assert_eq!(pack.sources()[0].name, "made up");
    for (key, tile) in tiles() {
        assert!(read(&pack, key).expect("sound") == tile, "{key}");
        assert!(pack.contains(key));
    }
    let keys: Vec<TileKey> = pack.keys().collect();
    assert!(keys.is_sorted(), "the index is sorted: {keys:?}");
    let header = pack.tile_header(tiles()[1].0).expect("there");
    assert!(
        (header.min_m - 0.0).abs() < 1e-9 && (header.max_m - 0.0).abs() < 1e-9,
        "quanta 2000 of half a metre from -1000 m"
    );
    // 16384 posts of kinds 0, 1, 2, 0, …: 5461 of each, and one more of kind 0.
    assert_eq!((header.void_posts, header.water_posts), (5461, 5461));
    assert!((header.max_error_m - 0.25).abs() < 1e-9);
}

#[test]
fn a_tile_that_is_not_there_is_absent() {
    let (path, _) = sound("pack_absent");
    let pack = Pack::open(&path).expect("sound");
    let absent = TileKey {
        partition: Partition::Geographic,
        level: 3,
        column: 5,
        row: 5,
    };
    assert!(!pack.contains(absent) && pack.tile_header(absent).is_none());
    assert!(matches!(read(&pack, absent), Err(TileError::Absent)));
}

#[test]
fn coverage_is_that_of_the_sources_and_wraps() {
    let (path, _) = sound("pack_covers");
    let pack = Pack::open(&path).expect("sound");
    assert!(pack.covers(0, 0) && pack.covers(-20, -10) && pack.covers(100, 200));
    assert!(!pack.covers(101, 0) && !pack.covers(0, 201));
}

#[test]
fn a_newer_format_says_so_and_what_to_do() {
    let (path, mut bytes) = sound("pack_newer");
    bytes[8..12].copy_from_slice(&(FORMAT + 2).to_le_bytes());
    fs::write(&path, &bytes).expect("written");
    let error = Pack::open(&path).expect_err("newer");
    assert_eq!(
        error.to_string(),
        format!(
            "written by a newer glasswing (format {}; this one reads up to {FORMAT})",
            FORMAT + 2
        )
    );
    assert!(error.remedy().starts_with("update glasswing"));
}

#[test]
fn other_files_are_no_packs() {
    let folder = support::scratch_dir("pack_other");
    let path = folder.join("other");
    for bytes in [&b""[..], b"GLAS", b"PK\x03\x04 a zip archive", &[0; 5000]] {
        fs::write(&path, bytes).expect("written");
        let error = Pack::open(&path).expect_err("no pack");
        assert!(matches!(error, PackError::NotAPack), "{error:?}");
    }
    let (_, mut bytes) = sound("pack_format_zero");
    bytes[8..12].copy_from_slice(&0_u32.to_le_bytes());
    fs::write(&path, &bytes).expect("written");
    let error = Pack::open(&path).expect_err("format 0");
    assert!(matches!(error, PackError::Older(0)), "{error:?}");
    let error = Pack::open(&folder.join("nothing")).expect_err("missing");
    assert!(matches!(error, PackError::Io(_)), "{error:?}");
    let error = Pack::open(&folder).expect_err("a folder");
    assert!(matches!(error, PackError::Io(_)), "{error:?}");
}

#[test]
fn a_pack_cut_short_or_grown_is_named_with_both_lengths() {
    let (path, bytes) = sound("pack_cut");
    for keep in [8, 100, 735, 736, 737, bytes.len() / 2, bytes.len() - 1] {
        fs::write(&path, &bytes[..keep]).expect("written");
        let error = Pack::open(&path).expect_err("cut short");
        let PackError::CutShort { have, .. } = error else {
            panic!("{keep}: {error:?}");
        };
        assert_eq!(have, keep as u64);
    }
    let mut longer = bytes.clone();
    longer.push(0);
    fs::write(&path, &longer).expect("written");
    let error = Pack::open(&path).expect_err("grown");
    assert!(matches!(error, PackError::TooLong { .. }), "{error:?}");
}

#[test]
fn a_pack_cut_short_after_it_was_opened_fails_the_tile() {
    let (path, _) = sound("pack_cut_later");
    let pack = Pack::open(&path).expect("sound");
    let file = fs::OpenOptions::new()
        .write(true)
        .open(&path)
        .expect("opens");
    file.set_len(760).expect("cut");
    let failures = tiles()
        .iter()
        .filter(|(key, _)| matches!(read(&pack, *key), Err(TileError::CutShort)))
        .count();
    assert_eq!(failures, 3);
}

#[test]
fn an_unfinished_pack_leaves_nothing_and_harms_nothing() {
    let folder = support::scratch_dir("pack_unfinished");
    let path = folder.join("test.pack");
    fs::write(&path, b"the old one").expect("written");
    let writer = PackWriter::create(&path, GRID, SCALE).expect("a place to write");
    drop(writer);
    let names: Vec<_> = fs::read_dir(&folder).expect("lists").collect();
    assert_eq!(names.len(), 1, "{names:?}");
    assert_eq!(fs::read(&path).expect("still there"), b"the old one");
    let error = PackWriter::create(&folder, GRID, SCALE).expect_err("a folder is no file");
    assert_eq!(error.kind(), std::io::ErrorKind::IsADirectory);
    assert!(PackWriter::create(&folder.join("no/such/folder.pack"), GRID, SCALE).is_err());
}

/// Opens a pack with one byte changed and counts the tiles that fail; `None` if it does not open.
fn failing_tiles(path: &Path, bytes: &[u8]) -> Option<usize> {
    fs::write(path, bytes).expect("written");
    let pack = Pack::open(path).ok()?;
    let mut failing = 0;
    for (key, original) in tiles() {
        match read(&pack, key) {
            Ok(tile) => assert!(tile == original, "a tile that reads is the one written"),
            Err(_) => failing += 1,
        }
    }
    Some(failing)
}

#[test]
fn every_bit_of_header_and_sources_is_guarded() {
    let (path, bytes) = sound("pack_bits");
    let tail = bytes.len() - 40;
    for at in (0..736).chain(tail..bytes.len()) {
        let mut bad = bytes.clone();
        bad[at] ^= 1 << (at % 8);
        assert_eq!(failing_tiles(&path, &bad), None, "byte {at}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// A flipped bit is found when the pack is opened, or in exactly one tile.
    #[test]
    fn a_flipped_bit_is_always_found(place in 0.0..1.0_f64, bit in 0..8_u8) {
        let (path, mut bytes) = sound("pack_flipped");
        #[expect(
            clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss,
            reason = "a place in a file of some 40 kB"
        )]
        let at = (place * bytes.len() as f64) as usize;
        bytes[at] ^= 1 << bit;
        let failing = failing_tiles(&path, &bytes);
        prop_assert!(matches!(failing, None | Some(1)), "byte {}: {:?}", at, failing);
    }
}
