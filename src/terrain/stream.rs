//! What is resident, and how it follows the eye: windows that move by strips, levels that fill from nothing, and a quota
//! of texels a frame that is never passed. The render thread's half of the streaming; the other is [`super::worker`].
//!
//! A window moves only in the frame in which the last texel of its strip has been uploaded, so what is drawn is whole
//! after every frame. A level that the eye has left by more than 48 posts (see [`Shape::strip_steps_max`]) is not drawn until it has been filled anew; until then the
//! coarser one draws without a hole.

use super::clipmap::{Shape, TorusPart, Window, torus_texel};
use super::partition::Partition;
use super::surface::{BATCH_TEXELS, Batch};
use super::texel::KIND_VOID;
use super::worker::{BATCHES, Job, Parcel, Worker};
use crate::limits::LEVELS_MAX;

/// Side of the squares in which a level is filled.
const FILL_SIDE: i32 = 64;
/// Posts across the widest strip: 16 x 255 fit a batch, of wider windows less.
const STRIP_POSTS_MAX: i32 = 16;
/// Side of the squares of the torus whose extremes are kept.
const EXTREMES_SIDE: usize = 16;
/// A texel that was never written: no level has this pair of heights.
const UNWRITTEN: [u16; 2] = [u16::MAX, 0];

/// All that a level's torus holds, row by row: heights and surface as in [`Batch`].
#[derive(Clone, Copy, Debug)]
pub struct Torus<'a> {
    /// Own and coarser height codes.
    pub heights: &'a [[u16; 2]],
    /// Normals and kinds.
    pub surface: &'a [[u8; 4]],
}

/// Where uploads go: textures, or a test's record of them.
pub trait Sink {
    /// Makes a level ready to be written, from what its torus holds now, with at most `quota` texels. Returns how many it
    /// took; the level is ready if that is less than `quota`.
    fn catch_up(&mut self, _level: u8, _torus: &Torus<'_>, _quota: usize) -> usize {
        0
    }

    /// Overwrites a rectangle of a level's torus: `part.width` x `part.height` texels row by row; see
    /// [`Batch`] for what they hold.
    fn write(&mut self, level: u8, part: TorusPart, heights: &[[u16; 2]], surface: &[[u8; 4]]);
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Residency {
    /// Nothing useful in its torus.
    Out,
    /// Being filled at a window: the next square to ask for, and texels still to come.
    Filling {
        window: Window,
        next: i32,
        left: usize,
    },
    /// Whole at a window; perhaps with a strip on its way that will move it.
    In {
        window: Window,
        step: Option<Window>,
    },
}

/// A level's copy of what its textures hold.
#[derive(Debug)]
struct Level {
    residency: Residency,
    generation: u32,
    version: u32,
    heights: Vec<[u16; 2]>,
    surface: Vec<[u8; 4]>,
    extremes: Vec<(u16, u16)>,
}

/// A batch that did not fit a frame's quota, and how much of it was uploaded.
#[derive(Debug)]
struct Held {
    parcel: Parcel,
    part: usize,
    row: usize,
}

/// What a frame uploaded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Uploads {
    /// Texels, of the heights and of the surface together: one for each post.
    pub texels: usize,
    /// Bytes: eight for each texel.
    pub bytes: usize,
}

/// The height under a point, or why there is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoTerrain {
    /// No resident level covers the point.
    NotResident,
    /// The finest resident level has no measurement there.
    Void,
}

/// Residency of all levels.
#[derive(Debug)]
pub struct Streamer {
    partition: Partition,
    shape: Shape,
    levels: Vec<Level>,
    worker: Worker,
    #[expect(
        clippy::vec_box,
        reason = "batches travel through rings: a box moves as a pointer"
    )]
    free: Vec<Box<Batch>>,
    held: Option<Held>,
}

impl Streamer {
    /// Nothing resident yet. `levels`: how many the pack has.
    #[must_use]
    pub fn new(partition: Partition, shape: Shape, levels: u8, worker: Worker) -> Self {
        let texels = shape.texels();
        let level = || Level {
            residency: Residency::Out,
            generation: 0,
            version: 0,
            heights: vec![UNWRITTEN; texels * texels],
            surface: vec![[0, 0, 0, u8::MAX]; texels * texels],
            extremes: vec![(u16::MAX, 0); (texels / EXTREMES_SIDE).pow(2)],
        };
        Self {
            partition,
            shape,
            levels: std::iter::repeat_with(level)
                .take(usize::from(levels).min(LEVELS_MAX))
                .collect(),
            worker,
            free: std::iter::repeat_with(Box::default).take(BATCHES).collect(),
            held: None,
        }
    }

    /// One frame: uploads what has arrived, at most `quota` texels, and asks for what the `wanted` levels (finest and
    /// coarsest) still need around the eye, coarse before fine. `eye`: the eye's post position on level 0.
    pub fn step(
        &mut self,
        eye: (f64, f64),
        wanted: (u8, u8),
        quota: usize,
        sink: &mut dyn Sink,
    ) -> Uploads {
        let mut left = quota;
        while let Some(held) = self.held.take().or_else(|| {
            let parcel = self.worker.receive()?;
            Some(Held {
                parcel,
                part: 0,
                row: 0,
            })
        }) {
            self.held = self.upload(held, &mut left, sink);
            if self.held.is_some() {
                break;
            }
        }
        for level in (wanted.0..=wanted.1).rev() {
            let scale = f64::from(1_u32 << level);
            self.follow(level, (eye.0 / scale, eye.1 / scale), quota);
            let of = &self.levels[usize::from(level)];
            if matches!(of.residency, Residency::In { .. }) {
                left -= sink.catch_up(level, &of.torus(), left);
            }
        }
        let texels = quota - left;
        Uploads {
            texels,
            bytes: texels * (size_of::<[u16; 2]>() + size_of::<[u8; 4]>()),
        }
    }

    /// Gives up all levels and goes over to a partition.
    pub fn enter(&mut self, partition: Partition) {
        self.partition = partition;
        for level in &mut self.levels {
            level.residency = Residency::Out;
            level.generation = level.generation.wrapping_add(1);
            level.version = level.version.wrapping_add(1);
        }
    }

    /// The window of a level that is whole.
    #[must_use]
    pub fn window(&self, level: u8) -> Option<Window> {
        match self.levels.get(usize::from(level))?.residency {
            Residency::In { window, .. } => Some(window),
            Residency::Out | Residency::Filling { .. } => None,
        }
    }

    /// Whether every level of `wanted` is whole and stands where the eye wants it.
    #[must_use]
    pub fn is_settled(&self, eye: (f64, f64), wanted: (u8, u8)) -> bool {
        (wanted.0..=wanted.1).all(|level| {
            let scale = f64::from(1_u32 << level);
            self.window(level).is_some_and(|w| {
                Window::around(self.shape, eye.0 / scale, eye.1 / scale, Some(w)) == w
            })
        })
    }

    /// Changes whenever what a level holds does.
    #[must_use]
    pub fn version(&self, level: u8) -> u32 {
        self.levels
            .get(usize::from(level))
            .map_or(0, |level| level.version)
    }

    /// Bytes of the copies of all levels.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let of = |level: &Level| {
            size_of_val(level.heights.as_slice())
                + size_of_val(level.surface.as_slice())
                + size_of_val(level.extremes.as_slice())
        };
        self.levels.iter().map(of).sum()
    }

    /// The worker's counts of unreadable tiles.
    #[must_use]
    pub fn damage(&self) -> super::surface::DamageCounts {
        self.worker.damage().counts()
    }

    /// Height code of a post of a resident window.
    #[must_use]
    pub fn code(&self, level: u8, i: i32, j: i32) -> Option<u16> {
        self.window(level)?;
        let level = self.levels.get(usize::from(level))?;
        level.heights.get(self.texel(i, j)).map(|h| h[0])
    }

    /// The lowest height code at which a post of a resident window is drawn, whatever the blend: own or coarser.
    #[must_use]
    pub fn floor_code(&self, level: u8, i: i32, j: i32) -> u16 {
        let [own, coarser] = self.levels[usize::from(level)].heights[self.texel(i, j)];
        own.min(coarser)
    }

    /// The greatest height code at which a post of a rectangle of a resident window is drawn, whatever the blend. `from` and
    /// `to`: its south-western and north-eastern posts.
    #[must_use]
    pub fn top_code(&self, level: u8, from: (i32, i32), to: (i32, i32)) -> u16 {
        let heights = &self.levels[usize::from(level)].heights;
        let mut top = 0;
        for j in from.1..=to.1 {
            for i in from.0..=to.0 {
                let [own, coarser] = heights[self.texel(i, j)];
                top = top.max(own).max(coarser);
            }
        }
        top
    }

    /// Height code of the ground at a post position of a resident level, as its triangles lie, without the blend.
    ///
    /// # Errors
    /// [`NoTerrain`].
    pub fn ground_code(&self, level: u8, x: f64, y: f64) -> Result<f64, NoTerrain> {
        let window = self.window(level).ok_or(NoTerrain::NotResident)?;
        let inside = |v: f64, origin: i32| {
            v >= f64::from(origin) && v < f64::from(origin + self.shape.cells())
        };
        if !inside(x, window.i) || !inside(y, window.j) {
            return Err(NoTerrain::NotResident);
        }
        let (i, j) = (whole(x), whole(y));
        let (fx, fy) = (x - x.floor(), y - y.floor());
        let level = &self.levels[usize::from(level)];
        let post = |di: i32, dj: i32| {
            let at = self.texel(i + di, j + dj);
            if level.surface[at][3] == KIND_VOID {
                return Err(NoTerrain::Void);
            }
            Ok(f64::from(level.heights[at][0]))
        };
        // Weights of the triangle's corners; see super::blocks for which way the diagonal runs.
        if (i + j).rem_euclid(2) == 0 {
            let (sw, ne) = (post(0, 0)?, post(1, 1)?);
            Ok(if fx >= fy {
                sw + fx * (post(1, 0)? - sw) + fy * (ne - post(1, 0)?)
            } else {
                sw + fy * (post(0, 1)? - sw) + fx * (ne - post(0, 1)?)
            })
        } else {
            let (se, nw) = (post(1, 0)?, post(0, 1)?);
            Ok(if fx + fy <= 1.0 {
                let sw = post(0, 0)?;
                sw + fx * (se - sw) + fy * (nw - sw)
            } else {
                let ne = post(1, 1)?;
                ne + (1.0 - fx) * (nw - ne) + (1.0 - fy) * (se - ne)
            })
        }
    }

    /// Lowest and greatest height code, own and coarser, in a rectangle of posts of a level; may be wider than the truth.
    #[must_use]
    pub fn extremes(
        &self,
        level: u8,
        (i, j): (i32, i32),
        (width, height): (i32, i32),
    ) -> (u16, u16) {
        let texels = self.shape.texels();
        let per_side = texels / EXTREMES_SIDE;
        let Some(level) = self.levels.get(usize::from(level)) else {
            return (0, u16::MAX);
        };
        let squares = |start: i32, length: i32| {
            let first = torus_texel(texels, start) / EXTREMES_SIDE;
            let last =
                (torus_texel(texels, start) + length.cast_unsigned() as usize) / EXTREMES_SIDE;
            first..=last
        };
        let mut out = (u16::MAX, 0);
        for y in squares(j, height) {
            for x in squares(i, width) {
                let e = level.extremes[(y % per_side) * per_side + x % per_side];
                out = (out.0.min(e.0), out.1.max(e.1));
            }
        }
        if out.0 > out.1 { (0, u16::MAX) } else { out }
    }

    fn texel(&self, i: i32, j: i32) -> usize {
        let texels = self.shape.texels();
        torus_texel(texels, j) * texels + torus_texel(texels, i)
    }

    /// Uploads a batch, or as much of it as the quota leaves; gives back what must wait.
    fn upload(&mut self, mut held: Held, left: &mut usize, sink: &mut dyn Sink) -> Option<Held> {
        let job = held.parcel.job;
        let level = &mut self.levels[usize::from(job.level)];
        if level.generation != job.generation {
            self.free.push(held.parcel.batch);
            return None;
        }
        // A strip overwrites texels that are still drawn: all of it or nothing.
        let is_strip = matches!(level.residency, Residency::In { .. });
        *left -= sink.catch_up(job.level, &level.torus(), *left);
        if is_strip && job.texels() > *left {
            return Some(held);
        }
        let batch = &held.parcel.batch;
        let mut start: usize = batch.parts[..held.part]
            .iter()
            .map(|p| p.width * p.height)
            .sum();
        while let Some(&part) = batch.parts.get(held.part) {
            let rows = (part.height - held.row).min(*left / part.width);
            if rows == 0 {
                return Some(held);
            }
            let from = start + held.row * part.width;
            let to = from + rows * part.width;
            let piece = TorusPart {
                y: part.y + held.row,
                height: rows,
                ..part
            };
            let (heights, surface) = (&batch.heights[from..to], &batch.surface[from..to]);
            sink.write(job.level, piece, heights, surface);
            level.mirror(self.shape.texels(), piece, heights, surface);
            *left -= rows * part.width;
            held.row += rows;
            if held.row < part.height {
                return Some(held);
            }
            start += part.width * part.height;
            held.part += 1;
            held.row = 0;
        }
        level.residency = match level.residency {
            Residency::Out => Residency::Out,
            Residency::In { window, step } => Residency::In {
                window: step.unwrap_or(window),
                step: None,
            },
            Residency::Filling { window, next, left } => {
                let left = left.saturating_sub(job.texels());
                if left == 0 {
                    Residency::In { window, step: None }
                } else {
                    Residency::Filling { window, next, left }
                }
            }
        };
        level.version = level.version.wrapping_add(1);
        self.free.push(held.parcel.batch);
        None
    }

    /// Brings a level's window nearer to the eye.
    fn follow(&mut self, level: u8, eye: (f64, f64), quota: usize) {
        let at = usize::from(level);
        let around = |current| Window::around(self.shape, eye.0, eye.1, current);
        let far = |a: Window, b: Window| {
            (a.i - b.i).abs().max((a.j - b.j).abs()) > self.shape.strip_steps_max()
        };
        match self.levels[at].residency {
            Residency::Out => self.begin(level, around(None)),
            Residency::In { window, .. } if far(window, around(Some(window))) => {
                self.begin(level, around(None));
            }
            Residency::Filling { window, .. } if far(window, around(Some(window))) => {
                self.begin(level, around(None));
            }
            Residency::Filling { .. } => {}
            Residency::In {
                window, step: None, ..
            } => {
                let target = around(Some(window));
                if target != window {
                    self.ask_strip(level, window, target, quota);
                }
            }
            Residency::In { .. } => {}
        }
        self.ask_squares(level);
    }

    /// Gives up what a level holds and fills it anew at a window.
    fn begin(&mut self, level: u8, window: Window) {
        let n = self.shape.vertices().cast_unsigned() as usize;
        let level = &mut self.levels[usize::from(level)];
        level.generation = level.generation.wrapping_add(1);
        level.residency = Residency::Filling {
            window,
            next: 0,
            left: n * n,
        };
        level.version = level.version.wrapping_add(1);
    }

    /// Asks for the squares of a level that is being filled, as long as there are batches.
    fn ask_squares(&mut self, level: u8) {
        let at = usize::from(level);
        let n = self.shape.vertices();
        let per_side = (n + FILL_SIDE - 1) / FILL_SIDE;
        while let Residency::Filling { window, next, left } = self.levels[at].residency {
            if next >= per_side * per_side {
                return;
            }
            let (x, y) = (next % per_side * FILL_SIDE, next / per_side * FILL_SIDE);
            let job = Job {
                partition: self.partition,
                level,
                generation: self.levels[at].generation,
                i: window.i + x,
                j: window.j + y,
                width: count(FILL_SIDE.min(n - x)),
                height: count(FILL_SIDE.min(n - y)),
            };
            if !self.ask(job) {
                return;
            }
            self.levels[at].residency = Residency::Filling {
                window,
                next: next + 1,
                left,
            };
        }
    }

    /// Asks for the strip that moves a window towards `target` along one axis, no larger than a frame's quota.
    fn ask_strip(&mut self, level: u8, window: Window, target: Window, quota: usize) {
        let n = self.shape.vertices();
        let texels = i32::try_from(quota.min(BATCH_TEXELS)).unwrap_or(i32::MAX);
        let widest = (texels / n).min(STRIP_POSTS_MAX) & !1;
        if widest == 0 {
            return;
        }
        let (dx, dy) = (target.i - window.i, target.j - window.j);
        let limit = |d: i32| d.clamp(-widest, widest);
        // The first new post of a side that moves by `d`.
        let fresh = |origin: i32, d: i32| if d > 0 { origin + n } else { origin + d };
        let generation = self.levels[usize::from(level)].generation;
        let (step, i, j, width, height) = if dx != 0 {
            let d = limit(dx);
            let to = Window {
                i: window.i + d,
                ..window
            };
            (to, fresh(window.i, d), window.j, d.abs(), n)
        } else {
            let d = limit(dy);
            let to = Window {
                j: window.j + d,
                ..window
            };
            (to, window.i, fresh(window.j, d), n, d.abs())
        };
        let job = Job {
            partition: self.partition,
            level,
            generation,
            i,
            j,
            width: count(width),
            height: count(height),
        };
        if self.ask(job) {
            self.levels[usize::from(level)].residency = Residency::In {
                window,
                step: Some(step),
            };
        }
    }

    /// Sends a job if there is a batch for it.
    fn ask(&mut self, job: Job) -> bool {
        let Some(batch) = self.free.pop() else {
            return false;
        };
        match self.worker.send(Parcel { job, batch }) {
            Ok(()) => true,
            Err(parcel) => {
                self.free.push(parcel.batch);
                false
            }
        }
    }
}

impl Level {
    fn torus(&self) -> Torus<'_> {
        Torus {
            heights: &self.heights,
            surface: &self.surface,
        }
    }

    /// Keeps a copy of what was uploaded, and the extremes of the squares it touches.
    fn mirror(
        &mut self,
        texels: usize,
        part: TorusPart,
        heights: &[[u16; 2]],
        surface: &[[u8; 4]],
    ) {
        for row in 0..part.height {
            let from = row * part.width..(row + 1) * part.width;
            let to = (part.y + row) * texels + part.x;
            self.heights[to..to + part.width].copy_from_slice(&heights[from.clone()]);
            self.surface[to..to + part.width].copy_from_slice(&surface[from]);
        }
        let per_side = texels / EXTREMES_SIDE;
        for y in part.y / EXTREMES_SIDE..=(part.y + part.height - 1) / EXTREMES_SIDE {
            for x in part.x / EXTREMES_SIDE..=(part.x + part.width - 1) / EXTREMES_SIDE {
                let mut e = (u16::MAX, 0);
                for row in y * EXTREMES_SIDE..(y + 1) * EXTREMES_SIDE {
                    let from = row * texels + x * EXTREMES_SIDE;
                    for &h in &self.heights[from..from + EXTREMES_SIDE] {
                        if h != UNWRITTEN {
                            e = (e.0.min(h[0]).min(h[1]), e.1.max(h[0]).max(h[1]));
                        }
                    }
                }
                self.extremes[y * per_side + x] = e;
            }
        }
    }
}

/// A count of posts as a job holds it: at most a few hundred.
fn count(posts: i32) -> u16 {
    u16::try_from(posts).unwrap_or(0)
}

/// The whole part of a post position inside a window.
#[expect(
    clippy::cast_possible_truncation,
    reason = "inside a window, whose posts are 32-bit numbers"
)]
fn whole(v: f64) -> i32 {
    v.floor() as i32
}
