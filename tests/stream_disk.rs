//! What a disk can do to a flight: tiles that are damaged, packs that are removed, overwritten or cut short, reads that do not
//! come back. Frames go on, nothing wrong is shown, what can be read again is.
#![expect(clippy::expect_used, reason = "a test: what fails must say so")]

mod support;
#[path = "terrain_bake_support/mod.rs"]
mod with;

use glasswing::app::measure::speed::Nowhere;
use glasswing::geo::{Attitude, Camera, Geodetic};
use glasswing::terrain::clipmap::Shape;
use glasswing::terrain::codec::Tile;
use glasswing::terrain::grid::TileKey;
use glasswing::terrain::pack::{Pack, PackInfo, TileError, TileReader};
use glasswing::terrain::scene::{FrameFigures, Settings};
use glasswing::terrain::stream::NoTerrain;
use glasswing::terrain::surface::TileSource;
use glasswing::terrain::world::World;
use glasswing::time::Monotonic;
use glasswing::units::Radians;
use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// A pack of a one-degree tile of hills, 400 to 800 m high, 10 N 20 E; baked once.
fn pack(name: &str) -> PathBuf {
    static BAKED: OnceLock<Vec<u8>> = OnceLock::new();
    let bytes = BAKED.get_or_init(|| {
        let dir = support::scratch_dir("stream_disk");
        let file = dir.join("N10E020.hgt");
        let height = |x: usize, y: usize| {
            let wave = i16::try_from((x / 5 + y / 3) % 150).expect("small");
            (500 + wave).to_be_bytes()
        };
        let bytes: Vec<u8> = (0..1201)
            .rev()
            .flat_map(|y| (0..1201).flat_map(move |x| height(x, y)))
            .collect();
        fs::write(&file, bytes).expect("a tile is written");
        let out = dir.join("out.pack");
        with::baked(&[file], &out).expect("it bakes");
        fs::read(out).expect("the pack")
    });
    let path = support::scratch_dir(name).join("terrain.pack");
    fs::write(&path, bytes).expect("written");
    path
}

fn eye(lat: f64, lon: f64) -> Camera {
    Camera {
        eye: Geodetic::from_degrees(lat, lon, 3000.0),
        attitude: Attitude::from_degrees(30.0, -5.0, 0.0),
        hfov: Radians::from_degrees(60.0),
        width_px: 640,
        height_px: 400,
    }
}

fn world<S: TileSource>(source: S) -> World {
    let settings = Settings::from(Shape::new(63).expect("a legal shape"));
    World::new(&Arc::new(source), settings).expect("a thread")
}

fn frame(world: &mut World, camera: &Camera) -> FrameFigures {
    let mut nowhere = [Nowhere; 2];
    let now = Monotonic::read();
    world
        .frame(camera, now, 65_536, &mut nowhere)
        .expect("a camera");
    std::thread::park_timeout(Duration::from_millis(1));
    world.figures()
}

/// Frames until something is so.
fn until(
    world: &mut World,
    camera: &Camera,
    what: &str,
    is_so: impl Fn(&FrameFigures) -> bool,
) -> FrameFigures {
    let begun = Monotonic::read();
    loop {
        let figures = frame(world, camera);
        if is_so(&figures) {
            return figures;
        }
        let waited = Monotonic::read().since(begun).unwrap_or_default();
        assert!(waited < Duration::from_secs(120), "{what}: {figures:?}");
    }
}

fn settle(world: &mut World, camera: &Camera) -> FrameFigures {
    until(world, camera, "settles", |figures| figures.settled)
}

/// Overwrites a file where it lies, as `cp` does: whoever has it open reads the new bytes.
fn overwrite(path: &Path, bytes: &[u8]) {
    let mut file = fs::OpenOptions::new()
        .write(true)
        .truncate(true)
        .open(path)
        .expect("the pack");
    file.write_all(bytes).expect("written");
}

#[test]
fn a_pack_that_is_removed_or_replaced_by_name_flies_on_as_it_was() {
    let path = pack("disk_removed");
    let mut world = world(Pack::open(&path).expect("a pack"));
    settle(&mut world, &eye(10.2, 20.2));
    fs::remove_file(&path).expect("removed");
    let figures = settle(&mut world, &eye(10.7, 20.7));
    assert_eq!(figures.damage, Default::default());
    // Another under the same name is another file, and this one no pack at all.
    let other = path.with_extension("other");
    fs::write(&other, vec![7; 100_000]).expect("written");
    fs::rename(&other, &path).expect("renamed");
    let there = eye(10.3, 20.4);
    let figures = settle(&mut world, &there);
    assert_eq!(figures.damage, Default::default());
    let ground = world.ground(&there.eye).expect("ground").0;
    assert!(
        (400.0..800.0).contains(&ground),
        "{ground} m: of the first pack"
    );
}

#[test]
fn a_pack_that_is_overwritten_in_flight_is_found_damaged_and_gives_no_height() {
    let path = pack("disk_overwritten");
    let mut world = world(Pack::open(&path).expect("a pack"));
    let here = eye(10.2, 20.2);
    settle(&mut world, &here);
    let before = world.ground(&here.eye).expect("ground");
    // As long as the first, and something else.
    let mut other = fs::read(&path).expect("the pack");
    other
        .iter_mut()
        .for_each(|byte| *byte = byte.wrapping_mul(31).wrapping_add(7));
    overwrite(&path, &other);
    assert_eq!(
        world.ground(&here.eye),
        Ok(before),
        "what is resident stays"
    );
    let there = eye(10.7, 20.7);
    let figures = settle(&mut world, &there);
    assert!(figures.damage.checksum > 0, "{figures:?}");
    assert!(figures.levels.is_some(), "a closed surface is drawn");
    assert_eq!(world.ground(&there.eye), Err(NoTerrain::Void));
}

#[test]
fn a_file_that_cannot_be_read_for_a_while_is_read_again() {
    let path = pack("disk_cut");
    let bytes = fs::read(&path).expect("the pack");
    let mut world = world(Pack::open(&path).expect("a pack"));
    settle(&mut world, &eye(10.2, 20.2));
    // As when a card has lost contact: nothing is there where the tiles were.
    overwrite(&path, &bytes[..2000]);
    let there = eye(10.7, 20.7);
    let hurt = settle(&mut world, &there);
    assert!(hurt.damage.reading > 0 && hurt.errands.unread, "{hurt:?}");
    assert_eq!(world.ground(&there.eye), Err(NoTerrain::Void));
    overwrite(&path, &bytes);
    let healed = until(&mut world, &there, "heals", |figures| {
        figures.settled && !figures.errands.unread
    });
    assert!(healed.damage.checksum == 0, "{healed:?}");
    let ground = world.ground(&there.eye).expect("ground").0;
    assert!((400.0..800.0).contains(&ground), "{ground} m");
}

/// A pack whose reads can be held up or made to fail.
#[derive(Debug)]
struct Moody {
    pack: Pack,
    mood: Arc<AtomicU8>,
}

const WELL: u8 = 0;
const STUCK: u8 = 1;
const FAILING: u8 = 2;

impl TileSource for Moody {
    fn info(&self) -> &PackInfo {
        self.pack.info()
    }

    fn contains(&self, key: TileKey) -> bool {
        self.pack.contains(key)
    }

    fn undulation_m(&self, latitude: Radians, longitude: Radians) -> Option<f64> {
        TileSource::undulation_m(&self.pack, latitude, longitude)
    }

    fn read_tile(
        &self,
        key: TileKey,
        reader: &mut TileReader,
        tile: &mut Tile,
    ) -> Result<(), TileError> {
        while self.mood.load(Ordering::Acquire) == STUCK {
            std::thread::sleep(Duration::from_millis(1));
        }
        if self.mood.load(Ordering::Acquire) == FAILING {
            return Err(TileError::Io(io::Error::from_raw_os_error(5)));
        }
        self.pack.read_tile(key, reader, tile)
    }
}

#[test]
fn a_read_that_does_not_come_back_holds_up_no_frame() {
    let path = pack("disk_stuck");
    let mood = Arc::new(AtomicU8::new(WELL));
    let mut world = world(Moody {
        pack: Pack::open(&path).expect("a pack"),
        mood: Arc::clone(&mood),
    });
    settle(&mut world, &eye(10.2, 20.2));
    mood.store(STUCK, Ordering::Release);
    let there = eye(10.7, 20.7);
    let first = frame(&mut world, &there);
    assert!(first.errands.outstanding > 0, "{first:?}");
    // The reader is stuck for all of these: a frame that waited for it would be the last.
    let mut stuck = first;
    for _ in 0..300 {
        stuck = frame(&mut world, &there);
    }
    assert!(stuck.errands.outstanding > 0 && !stuck.settled, "{stuck:?}");
    mood.store(WELL, Ordering::Release);
    let figures = settle(&mut world, &there);
    assert_eq!(figures.damage, Default::default());
    assert!(world.ground(&there.eye).is_ok());
}

#[test]
fn an_input_output_error_is_counted_drawn_coarser_and_tried_again() {
    let path = pack("disk_failing");
    let mood = Arc::new(AtomicU8::new(WELL));
    let mut world = world(Moody {
        pack: Pack::open(&path).expect("a pack"),
        mood: Arc::clone(&mood),
    });
    let here = eye(10.2, 20.2);
    settle(&mut world, &here);
    mood.store(FAILING, Ordering::Release);
    let there = eye(10.7, 20.7);
    let figures = settle(&mut world, &there);
    assert!(
        figures.damage.reading > 0 && figures.errands.unread,
        "{figures:?}"
    );
    assert_eq!(world.ground(&there.eye), Err(NoTerrain::Void));
    mood.store(WELL, Ordering::Release);
    until(&mut world, &there, "heals", |figures| {
        figures.settled && !figures.errands.unread
    });
    assert!(world.ground(&there.eye).is_ok());
}

#[test]
fn a_damaged_tile_is_drawn_from_the_coarser_level_and_the_rest_of_the_world_stays() {
    let path = pack("disk_tile");
    let mut bytes = fs::read(&path).expect("the pack");
    // The index is described in terrain::pack: the level-0 tile of 10.6 N, 20.6 E.
    let number = |at: usize| i32::from_le_bytes(bytes[at..at + 4].try_into().expect("4 bytes"));
    let index = usize::try_from(number(112)).expect("a small file");
    let (column, row) = (24_720 / 128, 12_720 / 128);
    let entry = (index..)
        .step_by(40)
        .find(|&at| bytes[at] == 0 && number(at + 4) == column && number(at + 8) == row)
        .expect("the tile is there");
    let stored = usize::try_from(number(entry + 24)).expect("a small file");
    bytes[stored + 20] ^= 0x10;
    fs::write(&path, &bytes).expect("written");
    let mut world = world(Pack::open(&path).expect("a pack"));
    // From afar, past it, and on: 128 posts are 0.107 degrees.
    for step in 0..=20_u32 {
        let lon = 20.4 + 0.02 * f64::from(step);
        let camera = eye(10.6, lon);
        let figures = settle(&mut world, &camera);
        assert!(figures.is_whole(), "{lon}: {figures:?}");
        let ground = world.ground(&camera.eye);
        let inside =
            (f64::from(column * 128)..f64::from(column * 128 + 127)).contains(&(lon * 1200.0));
        if inside {
            assert_eq!(ground, Err(NoTerrain::Void), "{lon}");
        }
        let beside = (lon * 1200.0 - f64::from(column * 128 + 64)).abs() > 66.0;
        if beside {
            assert!(ground.is_ok(), "{lon}: {ground:?}");
        }
    }
    let damage = world.figures().damage;
    assert!(damage.checksum > 0 && damage.reading == 0, "{damage:?}");
}

#[test]
fn a_board_that_allows_too_little_is_refused_by_key_with_what_is_needed() {
    let path = pack("disk_board");
    let board = path.with_file_name("board.toml");
    for (key, value) in [("resident_mib", 9), ("upload_bytes_per_frame", 131_072)] {
        let text = format!(
            "inherit = \"base\"\n[screen]\nkind = \"surfaceless\"\n[terrain]\npack = \"terrain.pack\"\n\
             vertices = 447\n{key} = {value}\n"
        );
        fs::write(&board, text).expect("a board file");
        let output = support::glasswing_command()
            .arg("run")
            .arg("--board")
            .arg(&board)
            .args(["--seconds", "1"])
            .output()
            .expect("the program starts");
        let said = String::from_utf8_lossy(&output.stderr);
        let of_key = format!("terrain.{key}: {value} is too little");
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(
            said.contains(&of_key) && said.contains("are needed"),
            "{said}"
        );
    }
}
