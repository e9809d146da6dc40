//! Packs that nobody would wish for, and eyes where none should be: the ground stays closed, or there is clearly no
//! terrain, and the display is told which.

#![expect(
    clippy::expect_used,
    reason = "a test says what it needs and fails where that is not so"
)]

use std::fs;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::Duration;

use glasswing::app::cockpit::Drawn;
use glasswing::app::vision::{Shown, Vision};
use glasswing::display::{Terrain, TerrainCaution};
use glasswing::geo::{Attitude, Camera, Geodetic};
use glasswing::gl::Gpu;
use glasswing::gl::target::Target;
use glasswing::screen::Screen;
use glasswing::terrain::clipmap::Shape;
use glasswing::terrain::pack::Pack;
use glasswing::terrain::scene::Settings;
use glasswing::time::Monotonic;
use glasswing::units::Radians;

mod support;
#[path = "terrain_bake_support/mod.rs"]
mod with;

const WIDTH: u32 = 192;
const HEIGHT: u32 = 108;
/// More than any level may take to arrive, even under emulation.
const PATIENCE: u32 = 60_000;

/// Metres at a column and a row, from the south-west.
type Relief = fn(usize, usize) -> i16;

/// A pack of one-degree tiles of 1201 x 1201 posts, each named by its south-west corner and made by a function.
fn pack(name: &str, tiles: &[(&str, Relief)]) -> PathBuf {
    let dir = support::scratch_dir(name);
    let files: Vec<PathBuf> = tiles
        .iter()
        .map(|(tile, height)| {
            let path = dir.join(format!("{tile}.hgt"));
            // Rows from the north, big endian.
            let bytes: Vec<u8> = (0..1201)
                .rev()
                .flat_map(|y| (0..1201).flat_map(move |x| height(x, y).to_be_bytes()))
                .collect();
            fs::write(&path, bytes).expect("a tile is written");
            path
        })
        .collect();
    let out = dir.join("out.pack");
    with::baked(&files, &out).expect("it bakes");
    out
}

fn hills(x: usize, y: usize) -> i16 {
    let wave = |v: usize| (f64::from(u32::try_from(v).expect("small")) / 90.0).sin();
    #[expect(clippy::cast_possible_truncation, reason = "within 100 and 900")]
    let height = (500.0 + 200.0 * wave(x) + 200.0 * wave(y)) as i16;
    height
}

struct Stage {
    // Dropped after everything that was made on it.
    vision: Vision,
    target: Target,
    gpu: Rc<Gpu>,
    _screen: Box<dyn Screen>,
}

impl Stage {
    fn new(pack: &Path) -> Self {
        let screen = support::headless_screen(WIDTH, HEIGHT);
        let gpu = Gpu::new(&|name| screen.gl_proc(name)).expect("a GPU");
        let settings = Settings {
            shape: Shape::new(127).expect("a shape"),
            ..Settings::default()
        };
        Self {
            vision: Vision::new(&gpu, settings, Pack::open(pack).expect("a pack")).expect("vision"),
            target: Target::offscreen(&gpu, WIDTH, HEIGHT, 0).expect("a target"),
            gpu,
            _screen: screen,
        }
    }

    fn frame(&mut self, camera: &Camera) -> (Shown, Drawn) {
        self.target.bind();
        self.gpu.clear([1.0, 0.0, 1.0, 1.0]);
        let mut drawn = Drawn::default();
        let shown = self
            .vision
            .show(camera, Monotonic::read(), 65_536, &mut drawn);
        (shown, drawn)
    }

    /// Frames until all wanted terrain is there.
    fn settled(&mut self, camera: &Camera) -> (Shown, Drawn) {
        for _ in 0..PATIENCE {
            let (shown, drawn) = self.frame(camera);
            if drawn.terrain_settled {
                return (shown, drawn);
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        unreachable!("the terrain never settled")
    }

    /// Pixels that nothing has drawn on: terrain and sky together must leave none.
    fn bare_pixels(&self) -> usize {
        let mut pixels = vec![0; (WIDTH * HEIGHT * 4) as usize];
        self.target.read_rgba(&mut pixels);
        pixels
            .chunks_exact(4)
            .filter(|p| p[..3] == [255, 0, 255])
            .count()
    }
}

fn camera(latitude: f64, longitude: f64, height_m: f64, pitch_deg: f64) -> Camera {
    Camera {
        eye: Geodetic::from_degrees(latitude, longitude, height_m),
        attitude: Attitude::from_degrees(40.0, pitch_deg, 10.0),
        hfov: Radians::from_degrees(60.0),
        width_px: WIDTH,
        height_px: HEIGHT,
    }
}

#[test]
fn a_single_tile_is_shown_and_beyond_it_the_display_says_so() {
    let mut stage = Stage::new(&pack("vision_single", &[("N10E020", hills)]));
    let (shown, drawn) = stage.settled(&camera(10.5, 20.5, 2000.0, -10.0));
    assert_eq!(shown, Shown::WELL);
    assert!(
        drawn.triangles > 1000 && drawn.draw_calls <= 25,
        "{drawn:?}"
    );
    assert_eq!(stage.bare_pixels(), 0);
    let (shown, drawn) = stage.settled(&camera(11.5, 20.5, 2000.0, -10.0));
    assert_eq!(shown, Shown::off(Terrain::Outside));
    assert!(!drawn.terrain_shown);
}

#[test]
fn over_a_hole_in_the_pack_the_display_says_that_there_are_no_data() {
    let tiles: [(&str, Relief); 2] = [("N10E020", hills), ("N12E020", hills)];
    let mut stage = Stage::new(&pack("vision_gap", &tiles));
    let (shown, _) = stage.settled(&camera(11.5, 20.5, 2000.0, -20.0));
    assert_eq!(shown.terrain, Terrain::Ready, "what is around is shown");
    assert_eq!(shown.caution, Some(TerrainCaution::NoDataBelow));
    assert_eq!(stage.bare_pixels(), 0);
    let (shown, _) = stage.settled(&camera(12.5, 20.5, 2000.0, -20.0));
    assert_eq!(shown, Shown::WELL, "and over data again it is well");
}

#[test]
fn all_sea_is_a_picture_and_all_voids_are_none() {
    let mut sea = Stage::new(&pack("vision_sea", &[("N10E020", |_, _| 0)]));
    assert_eq!(
        sea.settled(&camera(10.5, 20.5, 300.0, -10.0)).0,
        Shown::WELL
    );
    assert_eq!(sea.bare_pixels(), 0);
    drop(sea);
    let mut voids = Stage::new(&pack("vision_voids", &[("N10E020", |_, _| -32_768)]));
    let (shown, drawn) = voids.settled(&camera(10.5, 20.5, 300.0, -10.0));
    assert_eq!(shown, Shown::off(Terrain::Empty));
    assert!(!drawn.terrain_shown);
}

#[test]
fn a_cliff_from_the_lowest_to_the_highest_storable_height_stays_closed() {
    // The bake takes heights from 12 km below to 9 km above the sea.
    let cliff = |x: usize, y: usize| {
        if (x / 7 + y / 5).is_multiple_of(2) {
            -12_000
        } else {
            9000
        }
    };
    let mut stage = Stage::new(&pack("vision_cliff", &[("N10E020", cliff)]));
    for (height_m, pitch_deg) in [(9100.0, -60.0), (12_000.0, -89.0), (9010.0, -20.0)] {
        let (shown, drawn) = stage.settled(&camera(10.5, 20.5, height_m, pitch_deg));
        assert_eq!(shown, Shown::WELL, "{height_m}");
        assert_eq!(stage.bare_pixels(), 0, "{height_m}");
        assert!(
            drawn.triangles < 60_000,
            "no more than usual: {}",
            drawn.triangles
        );
    }
}

#[test]
fn an_eye_inside_the_ground_is_told() {
    let mut stage = Stage::new(&pack("vision_inside", &[("N10E020", |_, _| 800)]));
    // The geoid is within 110 m of the ellipsoid everywhere.
    for height_m in [600.0, -400.0, -11_000.0] {
        let (shown, _) = stage.settled(&camera(10.5, 20.5, height_m, 5.0));
        assert_eq!(shown.terrain, Terrain::Ready, "{height_m}");
        assert_eq!(
            shown.caution,
            Some(TerrainCaution::BelowGround),
            "{height_m}"
        );
        assert_eq!(stage.bare_pixels(), 0, "{height_m}");
    }
    assert_eq!(
        stage.settled(&camera(10.5, 20.5, 1000.0, 5.0)).0,
        Shown::WELL
    );
}

/// What `glasswing shot` from an eye says is annunciated.
fn annunciated(pack: &Path, eye: &str) -> serde_json::Value {
    let output = support::glasswing_command()
        .arg("shot")
        .arg("--pack")
        .arg(pack)
        .args(["--eye", eye, "--size", "192x108", "--json", "--out"])
        .arg(pack.with_extension("png"))
        .output()
        .expect("the program starts");
    let complaint = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{complaint}");
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    report["annunciation"].clone()
}

#[test]
fn a_shot_says_what_a_display_would() {
    let pack = pack("shot_states", &[("N50E014", hills)]);
    assert_eq!(
        annunciated(&pack, "50.5,14.5,2000"),
        serde_json::json!(null)
    );
    assert_eq!(annunciated(&pack, "50.5,14.5,20"), "BELOW GROUND");
    assert_eq!(annunciated(&pack, "52.5,14.5,2000"), "OUTSIDE DATA");
}

#[test]
fn a_camera_that_is_none_shows_no_terrain_and_the_next_good_one_does() {
    let mut stage = Stage::new(&pack("vision_nan", &[("N10E020", hills)]));
    let good = camera(10.5, 20.5, 2000.0, -10.0);
    let (_, before) = stage.settled(&good);
    for absurd in [f64::NAN, f64::INFINITY, 1e300, -1e9] {
        for input in 0..6 {
            let mut bad = good;
            let of = [
                &mut bad.eye.latitude.0,
                &mut bad.eye.longitude.0,
                &mut bad.eye.height_ellipsoid.0,
                &mut bad.attitude.heading_true.0,
                &mut bad.attitude.pitch.0,
                &mut bad.attitude.roll.0,
            ];
            *of.into_iter().nth(input).expect("six inputs") = absurd;
            let (shown, drawn) = stage.frame(&bad);
            assert_eq!(shown, Shown::off(Terrain::NoCamera), "{input} {absurd}");
            assert!(!drawn.terrain_shown);
        }
    }
    // Nothing of it stays: the next good frame is whole and the same as before.
    let (shown, after) = stage.frame(&good);
    assert_eq!(shown, Shown::WELL);
    assert_eq!(after.triangles, before.triangles);
}

#[test]
fn a_pack_with_a_damaged_tile_is_shown_and_told() {
    let path = pack("vision_damaged", &[("N10E020", hills)]);
    let mut bytes = fs::read(&path).expect("the pack");
    // The level-0 tile west of the eye's, by the index as terrain::pack describes it.
    let number = |at: usize| i32::from_le_bytes(bytes[at..at + 4].try_into().expect("4 bytes"));
    let index = usize::try_from(number(112)).expect("a small file");
    let (column, row) = (20 * 1200 / 128, 10 * 1200 / 128 + 1);
    let entry = (index..)
        .step_by(40)
        .find(|&at| bytes[at] == 0 && number(at + 4) == column && number(at + 8) == row)
        .expect("the tile is there");
    let stored = usize::try_from(number(entry + 24)).expect("a small file");
    bytes[stored + 20] ^= 0x10;
    fs::write(&path, &bytes).expect("written");
    let mut stage = Stage::new(&path);
    let (shown, _) = stage.settled(&camera(10.1, 20.1, 2000.0, -30.0));
    assert_eq!(shown.terrain, Terrain::Ready);
    assert_eq!(shown.caution, Some(TerrainCaution::Damaged));
    assert_eq!(stage.bare_pixels(), 0);
}
