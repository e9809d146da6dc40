//! The terrain of one view in one partition, without a GPU: follows the eye, decides what is resident and what is drawn, and prepares all
//! numbers that drawing needs. [`crate::gl::terrain`] uploads and draws what a [`Scene`] says.
//!
//! How depths are shared out is told in [`super::slices`].

use super::blocks::BLOCKS_MAX;
use super::clipmap::{self, Extent, Morph, Shape, Window, torus_texel};
use super::grid::Grid;
use super::pack::PackInfo;
use super::partition::Partition;
use super::reach::{self, Reaches, View};
use super::rings::{Ground, Rings};
use super::stream::{NoTerrain, Sink, Streamer, Uploads};
use super::surface::{TILES_KEPT, TileSource};
use super::tables::{Anchor, AnchorPost, HeightCode};
use super::under::Under;
use super::worker::{Means, Worker};
use crate::geo::{Camera, Geodetic};
use crate::limits::LEVELS_MAX;
use crate::units::{Metres, Radians};
use arrayvec::ArrayVec;
use glam::DVec3;
use std::io;
use std::sync::Arc;

pub use super::plan::{FrameFigures, LevelPlan, Plan};

/// Heights reach at most this far above the highest and below the lowest of a pack (geoid undulations, rounding), metres.
const HEIGHT_MARGIN_M: f64 = 120.0;

/// The target where none is given, pixels.
pub const TARGET_PX: f64 = 0.2;

/// How the terrain is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Vertices along a side of a level.
    pub shape: Shape,
    /// Root of the mean square error that pictures may have where levels follow the distance, pixels; in
    /// [`reach::TARGET_PX`]. See [`reach`] for what it promises.
    pub target_px: f64,
    /// Whether blocks behind nearer ground are left out. Makes no difference to a picture; off to show that.
    pub leaves_out_hidden: bool,
    /// Samples that may be decoded in a frame, at least those of a tile: 16 384.
    pub decode_samples_per_frame: u32,
    /// Decoded tiles that are kept: [`TILES_KEPT`], or fewer where memory is short.
    pub tiles_kept: usize,
}

impl Default for Settings {
    /// 447 vertices, the least that stays within 3 pixels of every post on the benchmark view of the Andes (2.96, of which
    /// 2.96 is what any triangles differ by from the bilinear surface), and a target that leaves them all to that view.
    fn default() -> Self {
        Self {
            shape: Shape::DEFAULT,
            target_px: TARGET_PX,
            leaves_out_hidden: true,
            decode_samples_per_frame: u32::MAX,
            tiles_kept: TILES_KEPT,
        }
    }
}

impl From<Shape> for Settings {
    /// The default but for the shape.
    fn from(shape: Shape) -> Self {
        Self {
            shape,
            ..Self::default()
        }
    }
}

/// A camera that no picture can be drawn from: not finite, no latitude, no size, or a field of view out of range.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the camera is no camera: a position, attitude or size is not a usable number")]
pub struct BadCamera;

/// Starts the streaming thread of a source with so many lines.
pub(super) fn start<S: TileSource>(
    source: &Arc<S>,
    settings: Settings,
    lines: usize,
) -> io::Result<ArrayVec<Worker, { super::worker::LINES_MAX }>> {
    let info = source.info();
    let heights = HeightCode::covering(info.height_min_m, info.height_max_m);
    let means = Means {
        samples_per_frame: settings.decode_samples_per_frame,
        tiles_kept: settings.tiles_kept,
    };
    Worker::start(Arc::clone(source), settings.shape, heights, means, lines)
}

/// See the module.
#[derive(Debug)]
pub struct Scene {
    partition: Partition,
    settings: Settings,
    grid: Grid,
    levels: u8,
    heights: HeightCode,
    height_min_m: f64,
    height_max_m: f64,
    streamer: Streamer,
    /// Whether its frames are the streaming thread's: not where a [`super::world::World`] has several scenes.
    is_alone: bool,
    longitude_deg: Option<f64>,
    latitude_deg: f64,
    eye_posts: (f64, f64),
    anchor: Option<Anchor>,
    /// RMS error of each level as pictures show it, metres.
    errors_m: [f64; LEVELS_MAX],
    /// Of the last frame; `None` before there was one in this partition.
    reaches: Option<Reaches>,
    rings: Rings,
    tabled: ArrayVec<(u8, Window), LEVELS_MAX>,
    plan: Plan,
    figures: FrameFigures,
}

impl Scene {
    /// For one partition of a pack; starts a streaming thread for it alone.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn new<S: TileSource>(
        source: Arc<S>,
        partition: Partition,
        settings: Settings,
    ) -> io::Result<Self> {
        let mut workers = start(&source, settings, 1)?;
        let none = || io::Error::from(io::ErrorKind::NotFound);
        let worker = workers.pop().ok_or_else(none)?;
        Ok(Self {
            is_alone: true,
            ..Self::on(source.info(), partition, settings, worker)
        })
    }

    /// For one partition of a pack, on a line of a streaming thread whose frames somebody else begins.
    pub(super) fn on(
        info: &PackInfo,
        partition: Partition,
        settings: Settings,
        worker: Worker,
    ) -> Self {
        let (grid, levels) = (info.grid, info.levels);
        let (low, high) = (info.height_min_m, info.height_max_m);
        let heights = HeightCode::covering(low, high);
        let errors_m = reach::errors_m(info);
        let samples = settings.decode_samples_per_frame;
        Self {
            is_alone: false,
            partition,
            settings,
            grid,
            levels,
            heights,
            height_min_m: low.min(0.0) - HEIGHT_MARGIN_M,
            height_max_m: high.max(0.0) + HEIGHT_MARGIN_M,
            streamer: Streamer::new(partition, settings.shape, levels, worker, samples),
            longitude_deg: None,
            latitude_deg: 0.0,
            eye_posts: (0.0, 0.0),
            anchor: None,
            errors_m,
            reaches: None,
            rings: Rings::new(levels),
            tabled: ArrayVec::new(),
            plan: Plan {
                levels: ArrayVec::new(),
                blocks: Vec::with_capacity(LEVELS_MAX * BLOCKS_MAX),
                tables: vec![[0.0; 4]; 2 * usize::from(levels) * settings.shape.texels()],
                tables_version: 0,
                origin_m: [0.0; 3],
                bulge: [0.0; 4],
                anchor_code: 0,
                projection: [[0.0; 3]; 3],
                size_px: (0, 0),
                heading: Radians(0.0),
                triangles: 0,
                is_above_ground: false,
            },
            figures: FrameFigures::default(),
        }
    }

    /// Prepares a frame: streams at most `quota` texels to `sink` and plans what to draw.
    ///
    /// # Errors
    /// [`BadCamera`]; the last plan stays.
    pub fn frame(
        &mut self,
        camera: &Camera,
        quota: usize,
        sink: &mut dyn Sink,
    ) -> Result<(), BadCamera> {
        if !camera.is_valid() {
            return Err(BadCamera);
        }
        self.stream(camera, quota, sink);
        self.anchor();
        self.fill_tables();
        self.cut(camera);
        self.project(camera);
        self.figures.triangles = self.plan.triangles;
        Ok(())
    }

    /// Goes over to another partition, if it is another, with nothing resident.
    pub(super) fn enter(&mut self, partition: Partition) {
        if self.partition == partition {
            return;
        }
        self.partition = partition;
        self.streamer.enter(partition);
        self.longitude_deg = None;
        self.reaches = None;
        self.anchor = None;
        self.figures = FrameFigures::default();
        self.clear();
    }

    /// Streams at most `quota` texels to `sink` for a frame that is not drawn from here: [`Self::figures`] are of what could
    /// be drawn, and the plan has no blocks. The camera must be valid.
    pub(super) fn preload(&mut self, camera: &Camera, quota: usize, sink: &mut dyn Sink) {
        self.stream(camera, quota, sink);
        self.clear();
    }

    /// Empties the plan.
    pub(super) fn clear(&mut self) {
        self.plan.levels.clear();
        self.plan.blocks.clear();
        self.plan.triangles = 0;
    }

    /// Follows the eye, streams, and chooses the levels that can be drawn.
    fn stream(&mut self, camera: &Camera, quota: usize, sink: &mut dyn Sink) {
        if self.is_alone {
            self.figures.decoded_samples = self.streamer.begin_frame();
        }
        let eye = self.follow(camera);
        let last = self.reaches.unwrap_or_else(|| self.reaches(camera));
        let streamed = (last.finest_streamed, last.drawn.1);
        let uploads = self.streamer.step(eye, streamed, quota, sink);
        // From what is resident now.
        let reaches = self.reaches(camera);
        self.reaches = Some(reaches);
        self.choose_levels(&reaches);
        self.report(reaches.drawn, uploads);
    }

    /// The plan of the last frame.
    #[must_use]
    pub const fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Figures of the last frame; draw calls and bytes of tables and blocks are added by whoever draws.
    #[must_use]
    pub const fn figures(&self) -> FrameFigures {
        self.figures
    }

    /// Its partition.
    #[must_use]
    pub const fn partition(&self) -> Partition {
        self.partition
    }

    /// Where posts stand.
    #[must_use]
    pub const fn grid(&self) -> Grid {
        self.grid
    }

    /// How heights are coded.
    #[must_use]
    pub const fn heights(&self) -> HeightCode {
        self.heights
    }

    /// Levels of the pack.
    #[must_use]
    pub const fn levels(&self) -> u8 {
        self.levels
    }

    /// How it is drawn.
    #[must_use]
    pub const fn settings(&self) -> Settings {
        self.settings
    }

    /// The resident heights.
    #[must_use]
    pub const fn streamer(&self) -> &Streamer {
        &self.streamer
    }

    /// Ellipsoidal height of the ground at a point, from the finest resident level that covers it.
    ///
    /// # Errors
    /// [`NoTerrain`] where nothing covers it, or the pack has no measurement there.
    pub fn ground(&self, point: &Geodetic) -> Result<Metres, NoTerrain> {
        if !point.is_valid() {
            return Err(NoTerrain::NotResident);
        }
        let (longitude, latitude) = self.grid_position(point);
        for level in 0..self.levels {
            let (x, y) = clipmap::post_position(self.grid, level, longitude, latitude);
            match self.streamer.ground_code(level, x, y) {
                Err(NoTerrain::NotResident) => {}
                Err(NoTerrain::Void) => return Err(NoTerrain::Void),
                Ok(code) => return Ok(Metres(self.heights.base_m + code * self.heights.unit_m)),
            }
        }
        Err(NoTerrain::NotResident)
    }

    /// Grid longitude, turned so that it is within half a turn of the eye's, and grid latitude, degrees.
    fn grid_position(&self, point: &Geodetic) -> (f64, f64) {
        let (longitude, latitude) = self
            .partition
            .from_geodetic(point.longitude.to_degrees(), point.latitude.to_degrees());
        let near = self.longitude_deg.unwrap_or(longitude);
        let turns = ((near - longitude) / 360.0).round();
        (longitude + 360.0 * turns, latitude)
    }

    /// Takes the eye's position over, continuous across the date line.
    fn follow(&mut self, camera: &Camera) -> (f64, f64) {
        let (longitude, latitude) = self.grid_position(&camera.eye);
        self.longitude_deg = Some(longitude);
        self.latitude_deg = latitude;
        self.eye_posts = clipmap::post_position(self.grid, 0, longitude, latitude);
        self.eye_posts
    }

    /// How far levels should reach.
    fn reaches(&self, camera: &Camera) -> Reaches {
        let view = View {
            latitude_deg: self.latitude_deg,
            eye_m: camera.eye.height_ellipsoid.0,
            ground_m: (self.height_min_m, self.height_max_m),
            focal_px: camera.focal_px(),
            target_px: self.settings.target_px,
        };
        let shape = self.settings.shape;
        // The next coarser level knows the ground well beyond a level's own reach.
        let top_m = |level: u8, radius_m: f64| {
            let level = level + 1;
            let Some(window) = self.streamer.window(level) else {
                return self.height_max_m;
            };
            let eye = self.eye_on(level);
            let on = (&self.streamer, self.heights, shape, self.grid);
            reach::envelope_m(on, (level, window), eye, radius_m)
        };
        Reaches::of(shape, self.grid, self.levels, &self.errors_m, &view, top_m)
    }

    /// Latitude of the last frame's eye in the partition's grid, degrees.
    pub(super) const fn eye_latitude_deg(&self) -> f64 {
        self.latitude_deg
    }

    /// The eye's post position on a level.
    pub(super) fn eye_on(&self, level: u8) -> (f64, f64) {
        let scale = f64::from(1_u32 << level);
        (self.eye_posts.0 / scale, self.eye_posts.1 / scale)
    }

    /// The unbroken run of whole levels that nest, from the coarsest wanted one that is whole; finest first.
    fn choose_levels(&mut self, reaches: &Reaches) {
        let shape = self.settings.shape;
        let wanted = reaches.drawn;
        let mut chain: ArrayVec<LevelPlan, LEVELS_MAX> = ArrayVec::new();
        for level in (wanted.0..=wanted.1).rev() {
            let Some(window) = self.streamer.window(level) else {
                if chain.is_empty() {
                    continue;
                }
                break;
            };
            // Without a coarser one there is nothing to blend into and nothing beyond.
            let reach = if chain.is_empty() {
                clipmap::reach_max(shape)
            } else {
                reaches.posts[usize::from(level)]
            };
            let eye = self.eye_on(level);
            let (extent, around) = Extent::around(shape, window, reach, eye);
            if let Some(coarser) = chain.last()
                && clipmap::hole(coarser.extent(), &coarser.morph, extent).is_none()
            {
                break;
            }
            chain.push(LevelPlan {
                level,
                window: extent.window,
                cells: extent.cells,
                morph: Morph::new(shape, extent, around, reach),
                has_coarser: !chain.is_empty(),
                blocks: (0, 0),
                slices: ArrayVec::new(),
            });
        }
        self.plan.levels.clear();
        self.plan.levels.extend(chain.into_iter().rev());
    }

    /// Moves the anchor to the finest drawn level's post nearest to the eye.
    fn anchor(&mut self) {
        let Some(finest) = self.plan.levels.first() else {
            return;
        };
        let half = f64::from(finest.cells) / 2.0;
        let scale = f64::from(1_u32 << finest.level);
        let near = |eye: f64, origin: i32, anchor: Option<i32>| {
            // The post that the anchor stands on is kept until another is clearly nearer.
            let eye = eye / scale;
            let kept = anchor.map(|a| f64::from(a) / scale);
            let v = match kept {
                Some(a) if (a - eye).abs() < 0.75 && a.fract().abs() < f64::EPSILON => a,
                _ => eye.round(),
            };
            let centre = f64::from(origin) + half;
            #[expect(
                clippy::cast_possible_truncation,
                reason = "a post of the window, by the clamp"
            )]
            let post = v.clamp(centre - half, centre + half) as i32;
            post
        };
        let old = self.anchor.map(|a| a.post());
        let i = near(self.eye_posts.0, finest.window.i, old.map(|p| p.i));
        let j = near(self.eye_posts.1, finest.window.j, old.map(|p| p.j));
        let code = self.streamer.code(finest.level, i, j).unwrap_or(0);
        let post = AnchorPost {
            i: i << finest.level,
            j: j << finest.level,
            code,
        };
        if old != Some(post) {
            self.anchor = Some(Anchor::new(self.partition, self.grid, self.heights, post));
            self.tabled.clear();
        }
    }

    /// Tabulates columns and rows of the levels whose window or anchor has moved.
    fn fill_tables(&mut self) {
        let Some(anchor) = &self.anchor else { return };
        let mut changed = false;
        for level in self.plan.levels.iter().map(|plan| plan.level) {
            let Some(window) = self.streamer.window(level) else {
                continue;
            };
            if self.tabled.contains(&(level, window)) {
                continue;
            }
            self.tabled.retain(|t| t.0 != level);
            self.tabled.push((level, window));
            let entries = self.settings.shape.texels();
            let posts = self.settings.shape.vertices();
            let start = 2 * usize::from(level) * entries;
            let (columns, rows) =
                self.plan.tables[start..start + 2 * entries].split_at_mut(entries);
            for post in window.i..window.i + posts {
                columns[torus_texel(entries, post)] = anchor.column(post << level);
            }
            for post in window.j..window.j + posts {
                rows[torus_texel(entries, post)] = anchor.row(post << level);
            }
            changed = true;
        }
        if changed {
            self.plan.tables_version = self.plan.tables_version.wrapping_add(1);
        }
    }

    /// Chooses what is drawn of the levels.
    fn cut(&mut self, camera: &Camera) {
        self.plan.is_above_ground =
            Under::of(self).is_some_and(|under| under.is_cleared_by(camera));
        let ground = Ground {
            partition: self.partition,
            grid: self.grid,
            levels: self.levels,
            heights: self.heights,
            shape: self.settings.shape,
            eye_posts: self.eye_posts,
            streamer: &self.streamer,
        };
        self.rings.lay(&ground, &self.plan.levels);
        self.rings.cut(
            &ground,
            camera,
            self.height_min_m,
            self.settings.leaves_out_hidden,
            &mut self.plan,
        );
    }

    /// The projection, and the anchor as the shader needs it.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "f64 until here: these are the numbers the shader is given"
    )]
    fn project(&mut self, camera: &Camera) {
        let (longitude, latitude) = (camera.eye.longitude, camera.eye.latitude);
        let convergence = Radians::from_degrees(
            self.partition
                .convergence_deg(longitude.to_degrees(), latitude.to_degrees()),
        );
        self.plan.heading = Radians(camera.attitude.heading_true.0 - convergence.0);
        let f = camera.focal_px();
        let axes = camera.eye_to_ecef();
        let row = |v: DVec3| [v.x as f32, v.y as f32, v.z as f32];
        self.plan.size_px = (camera.width_px, camera.height_px);
        self.plan.projection = [
            row(axes.x_axis * (2.0 * f / f64::from(camera.width_px))),
            row(axes.y_axis * (2.0 * f / f64::from(camera.height_px))),
            row(-axes.z_axis),
        ];
        if let Some(anchor) = &self.anchor {
            self.plan.origin_m = row(anchor.ecef() - camera.eye.to_ecef());
            self.plan.bulge = anchor.bulge().map(|v| v as f32);
            self.plan.anchor_code = anchor.post().code;
        }
    }

    fn report(&mut self, wanted: (u8, u8), uploads: Uploads) {
        let levels = &self.plan.levels;
        self.figures = FrameFigures {
            triangles: 0,
            draw_calls: 0,
            partition: Some(self.partition),
            levels: levels
                .first()
                .zip(levels.last())
                .map(|(a, b)| (a.level, b.level)),
            levels_wanted: wanted,
            uploads_texels: uploads.texels,
            uploads_bytes: uploads.bytes,
            decoded_samples: self.figures.decoded_samples,
            resident_bytes: self.figures.resident_bytes,
            settled: self.streamer.is_settled(self.eye_posts, wanted)
                && levels.len() == usize::from(wanted.1 - wanted.0) + 1,
            damage: self.streamer.damage(),
            errands: self.streamer.errands(),
        };
    }
}
