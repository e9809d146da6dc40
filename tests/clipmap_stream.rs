//! The streaming of the terrain without a GPU: what is drawn is whole after every frame, whatever the quota and the way.
#![expect(
    clippy::expect_used,
    reason = "a test: numbers are small and what fails must say so"
)]

mod clipmap_support;

use clipmap_support::{Dice, Land, mountains, sea};
use glasswing::geo::{Attitude, Camera, Geodetic};
use glasswing::terrain::clipmap::{Shape, TorusPart, torus_texel};
use glasswing::terrain::partition::Partition;
use glasswing::terrain::scene::{Scene, Settings};
use glasswing::terrain::slices::Slice;
use glasswing::terrain::stream::{NoTerrain, Sink};
use glasswing::terrain::surface::{Damage, Sampler, TileSource};
use glasswing::time::Monotonic;
use glasswing::units::Radians;
use std::sync::Arc;
use std::time::Duration;

const TEXELS: usize = 128;

fn settings() -> Settings {
    Settings {
        shape: Shape::new(127).expect("a legal shape"),
        ..Settings::default()
    }
}

fn camera(lat: f64, lon: f64, height: f64) -> Camera {
    Camera {
        eye: Geodetic::from_degrees(lat, lon, height),
        attitude: Attitude::from_degrees(30.0, -5.0, 0.0),
        hfov: Radians::from_degrees(60.0),
        width_px: 640,
        height_px: 400,
    }
}

/// What the textures would hold.
struct Record {
    levels: Vec<Vec<([u16; 2], [u8; 4])>>,
    texels: usize,
}

impl Record {
    fn new(levels: u8) -> Self {
        let level = vec![([0; 2], [0; 4]); TEXELS * TEXELS];
        Self {
            levels: vec![level; usize::from(levels)],
            texels: 0,
        }
    }
}

impl Sink for Record {
    fn write(&mut self, level: u8, part: TorusPart, heights: &[[u16; 2]], surface: &[[u8; 4]]) {
        let level = &mut self.levels[usize::from(level)];
        for row in 0..part.height {
            for column in 0..part.width {
                let from = row * part.width + column;
                level[(part.y + row) * TEXELS + part.x + column] = (heights[from], surface[from]);
                self.texels += 1;
            }
        }
    }
}

/// Posts of drawn windows that do not hold what the sampler gives for them.
fn wrong_posts<S: TileSource>(
    scene: &Scene,
    record: &Record,
    sampler: &mut Sampler<'_, S>,
) -> usize {
    let n = 127_usize;
    let mut wrong = 0;
    for plan in &scene.plan().levels {
        let (mut heights, mut surface) = (vec![[0; 2]; n], vec![[0; 4]; n]);
        // Every ninth row: the pattern of strips has no such period.
        for row in (0..127).step_by(9) {
            let at = (plan.window.i, plan.window.j + row);
            sampler.fill(plan.level, at, (n, 1), &mut heights, &mut surface);
            for column in 0..127 {
                let x = torus_texel(TEXELS, at.0 + column);
                let y = torus_texel(TEXELS, at.1);
                let c = usize::try_from(column).expect("small");
                let held = record.levels[usize::from(plan.level)][y * TEXELS + x];
                wrong += usize::from(held != (heights[c], surface[c]));
            }
        }
    }
    wrong
}

fn settle(scene: &mut Scene, record: &mut Record, camera: &Camera) {
    let begun = Monotonic::read();
    loop {
        scene.frame(camera, 65_536, record).expect("a camera");
        if scene.figures().settled {
            return;
        }
        let waited = Monotonic::read().since(begun).unwrap_or_default();
        assert!(waited < Duration::from_secs(120), "settles");
        std::thread::park_timeout(Duration::from_millis(1));
    }
}

#[test]
fn windows_are_whole_after_every_frame_and_the_quota_is_never_passed() {
    let land = Arc::new(Land::new(1200, mountains));
    let damage = Damage::default();
    let mut scene =
        Scene::new(Arc::clone(&land), Partition::Geographic, settings()).expect("a thread");
    let heights = scene.heights();
    let mut sampler = Sampler::new(&*land, Partition::Geographic, heights, &damage);
    let mut record = Record::new(scene.levels());
    let mut dice = Dice(1);
    for (lat, lon) in [(10.0, 179.99), (-47.0, 12.0), (55.0, -100.0)] {
        let (mut lat, mut lon) = (lat, lon);
        let mut frames_drawn = 0;
        let begun = Monotonic::read();
        for frame in 0.. {
            let wrapped = if lon > 180.0 { lon - 360.0 } else { lon };
            let quota = [0, 100, 700, 5000, 65_536][frame % 5];
            record.texels = 0;
            scene
                .frame(&camera(lat, wrapped, 9000.0), quota, &mut record)
                .expect("a camera");
            assert!(record.texels <= quota, "{} of {quota}", record.texels);
            assert_eq!(record.texels, scene.figures().uploads_texels, "counted");
            let wrong = wrong_posts(&scene, &record, &mut sampler);
            assert_eq!(wrong, 0, "frame {frame} at {lat} {lon}");
            // Onwards only while something is drawn, or the eye would outrun a slow machine.
            if !scene.plan().levels.is_empty() {
                frames_drawn += 1;
                lat += dice.between(-0.004, 0.004);
                lon += 0.003;
            }
            if frames_drawn == 40 {
                break;
            }
            let waited = Monotonic::read().since(begun).unwrap_or_default();
            assert!(waited < Duration::from_secs(120), "something is drawn");
            std::thread::park_timeout(Duration::from_millis(2));
        }
    }
}

#[test]
fn crossing_the_date_line_refills_nothing() {
    let mut scene = Scene::new(
        Arc::new(Land::new(1200, mountains)),
        Partition::Geographic,
        settings(),
    )
    .expect("a thread");
    let mut record = Record::new(scene.levels());
    settle(&mut scene, &mut record, &camera(-19.5, 179.9999, 3000.0));
    record.texels = 0;
    settle(&mut scene, &mut record, &camera(-19.5, -179.9999, 3000.0));
    // 0.72 arc seconds: less than a post.
    assert!(record.texels <= 2 * 2 * 127, "{}", record.texels);
}

#[test]
fn a_starved_streamer_keeps_what_still_fits_and_drops_what_the_eye_left() {
    let mut scene = Scene::new(
        Arc::new(Land::new(1200, sea)),
        Partition::Geographic,
        settings(),
    )
    .expect("a thread");
    let mut record = Record::new(scene.levels());
    settle(&mut scene, &mut record, &camera(10.0, 10.0, 3000.0));
    let all = scene.plan().levels.len();
    // 0.05 degrees are 60 posts of level 0, 30 of level 1, 4 of level 4.
    scene
        .frame(&camera(10.05, 10.05, 3000.0), 0, &mut record)
        .expect("a camera");
    let left = &scene.plan().levels;
    assert!(left.len() < all && left.len() >= 3, "{left:?}");
    assert_eq!(
        left.last().map(|l| l.level),
        scene.figures().levels.map(|l| l.1)
    );
    assert!(!scene.figures().settled);
}

#[test]
fn a_camera_of_no_numbers_is_refused_and_changes_nothing() {
    let mut scene = Scene::new(
        Arc::new(Land::new(1200, sea)),
        Partition::Geographic,
        settings(),
    )
    .expect("a thread");
    let mut record = Record::new(scene.levels());
    settle(&mut scene, &mut record, &camera(10.0, 10.0, 3000.0));
    let before = scene.plan().blocks.len();
    let mut bad = [camera(10.0, 10.0, 3000.0); 5];
    bad[0].eye.latitude = Radians(f64::NAN);
    bad[1].eye.height_ellipsoid.0 = f64::INFINITY;
    bad[2].attitude.roll = Radians(f64::NAN);
    bad[3].hfov = Radians(f64::NAN);
    bad[4].width_px = 0;
    for camera in &bad {
        assert!(
            scene.frame(camera, 65_536, &mut record).is_err(),
            "{camera:?}"
        );
    }
    assert_eq!(scene.plan().blocks.len(), before);
}

#[test]
fn poles_and_extremes_give_finite_numbers() {
    let mut scene = Scene::new(
        Arc::new(Land::new(1200, mountains)),
        Partition::Geographic,
        settings(),
    )
    .expect("a thread");
    let mut record = Record::new(scene.levels());
    for (lat, lon, height) in [
        (90.0, 0.0, 5000.0),
        (-90.0, 12.0, 5000.0),
        (89.2, -180.0, 100.0),
        (88.0, 180.0, 1e6),
        (0.0, 0.0, -500.0),
        (0.0, 0.0, 1e-310),
    ] {
        settle(&mut scene, &mut record, &camera(lat, lon, height));
        let plan = scene.plan();
        assert!(
            plan.tables.iter().flatten().all(|v| v.is_finite()),
            "{lat} {lon}"
        );
        assert!(plan.origin_m.iter().all(|v| v.is_finite()), "{lat} {lon}");
        for slice in plan.levels.iter().flat_map(|level| &level.slices) {
            let depth = slice.depth;
            assert!(depth.0.is_finite() && depth.1.is_finite(), "{lat} {lon}");
        }
    }
}

#[test]
fn the_ground_is_as_high_as_the_triangles_and_missing_ground_has_no_height() {
    let land = Arc::new(Land::new(1200, mountains));
    let mut scene =
        Scene::new(Arc::clone(&land), Partition::Geographic, settings()).expect("a thread");
    let mut record = Record::new(scene.levels());
    let camera = camera(46.0, 8.0, 5000.0);
    assert_eq!(scene.ground(&camera.eye), Err(NoTerrain::NotResident));
    settle(&mut scene, &mut record, &camera);
    // 46N 8E is a post; half way to the next one north the height is the mean.
    let (i, j) = (8 * 1200, 46 * 1200);
    let ellipsoidal = |j: i32| {
        let latitude = Radians::from_degrees(f64::from(j) / 1200.0);
        land.height_m(i, j)
            + land
                .undulation_m(latitude, Radians::from_degrees(8.0))
                .expect("known")
    };
    let at_post = scene.ground(&camera.eye).expect("ground").0;
    assert!(
        (at_post - ellipsoidal(j)).abs() <= 0.125 + 1e-9,
        "{at_post}"
    );
    let between = Geodetic::from_degrees(46.0 + 0.5 / 1200.0, 8.0, 0.0);
    let mean = f64::midpoint(ellipsoidal(j), ellipsoidal(j + 1));
    let found = scene.ground(&between).expect("ground").0;
    assert!((found - mean).abs() <= 0.125 + 1e-9, "{found} {mean}");

    let broken = Land::new(1200, mountains).broken(|key| key.level == 0);
    let mut scene =
        Scene::new(Arc::new(broken), Partition::Geographic, settings()).expect("a thread");
    let mut record = Record::new(scene.levels());
    settle(&mut scene, &mut record, &camera);
    assert_eq!(
        scene.ground(&camera.eye),
        Err(NoTerrain::Void),
        "damaged tiles give no height"
    );
    assert!(scene.figures().damage.checksum > 0, "and are counted");
}

#[test]
fn levels_agree_on_shared_posts_whatever_is_damaged() {
    let land = Land::new(1200, mountains)
        .broken(|key| (key.column + key.row + i32::from(key.level)) % 3 == 0);
    let damage = Damage::default();
    let heights = glasswing::terrain::tables::HeightCode::covering(-500.0, 7000.0);
    let mut sampler = Sampler::new(&land, Partition::Geographic, heights, &damage);
    let (w, h) = (60, 60);
    let (mut fine, mut coarse) = (vec![[0; 2]; w * h], vec![[0; 2]; w * h]);
    let mut surface = vec![[0; 4]; w * h];
    for level in 0..7 {
        for (i, j) in [(-30, -30), (1000, 60), (356, -160)] {
            sampler.fill(level, (2 * i, 2 * j), (w, h), &mut fine, &mut surface);
            sampler.fill(level + 1, (i, j), (w / 2, h / 2), &mut coarse, &mut surface);
            for y in 0..h / 2 {
                for x in 0..w / 2 {
                    assert_eq!(
                        fine[2 * y * w + 2 * x][1],
                        coarse[y * (w / 2) + x][0],
                        "level {level}"
                    );
                }
            }
        }
    }
    assert!(damage.counts().checksum > 0);
}

#[test]
fn depth_tells_points_apart_that_are_a_pixel_apart_from_0_2_m_to_the_horizon() {
    let land = Land::new(1200, mountains);
    let mut scene =
        Scene::new(Arc::new(land), Partition::Geographic, settings()).expect("a thread");
    let mut record = Record::new(scene.levels());
    let mut farthest_m = 0_f64;
    for (above_m, pitch, fov) in [
        (0.3, 0.0, 60.0),
        (0.3, -20.0, 120.0),
        (2.0, -5.0, 60.0),
        (100.0, -10.0, 60.0),
        (3000.0, -20.0, 60.0),
        (18_000.0, -10.0, 60.0),
        (18_000.0, -90.0, 60.0),
    ] {
        let mut view = camera(46.0, 8.0, 7000.0);
        settle(&mut scene, &mut record, &view);
        let ground = scene.ground(&view.eye).expect("ground");
        view.eye.height_ellipsoid.0 = ground.0 + above_m;
        view.attitude = Attitude::from_degrees(30.0, pitch, 0.0);
        view.hfov = Radians::from_degrees(fov);
        (view.width_px, view.height_px) = (1024, 600);
        settle(&mut scene, &mut record, &view);
        let plan = scene.plan();
        let mut end = 0.0;
        for slice in plan.levels.iter().flat_map(|level| &level.slices) {
            assert!(slice.range.0 >= end && slice.range.1 <= 1.0, "{slice:?}");
            end = slice.range.1;
            farthest_m = farthest_m.max(slice.far_m);
            for k in 0..=20 {
                let along = f64::from(k) / 20.0;
                let distance_m = slice.near_m * (slice.far_m / slice.near_m).powf(0.999 * along);
                let step_m = slice.step_m(distance_m).expect("inside");
                let pixel_m = distance_m / view.focal_px();
                assert!(
                    step_m < 0.5 * pixel_m,
                    "{above_m} m above: {step_m} m of {pixel_m} m at {distance_m} m, {slice:?}"
                );
            }
        }
        let slices = plan.levels.iter().flat_map(|level| &level.slices);
        let draws: usize = slices.map(Slice::draw_calls).sum();
        assert!(draws <= 24, "{draws} draw calls");
        let blocks: usize = plan.levels.iter().map(|level| level.blocks.1).sum();
        assert_eq!(blocks, plan.blocks.len(), "every block in one slice");
    }
    assert!(farthest_m > 400_000.0, "{farthest_m} m");
}
