//! What is resident, and how it follows the eye: windows that move by strips, levels that fill from nothing, and a quota
//! of texels a frame that is never passed. The render thread's half of the streaming; the other is [`super::worker`].
//!
//! A window moves only in the frame in which the last texel of its strip has been uploaded, so what is drawn is whole
//! after every frame: a level has an active window and, with a strip on its way, the next one. A level that the eye has left by
//! more than 48 posts (see [`Shape::strip_steps_max`]) is not drawn until it has been filled anew; until then the
//! coarser one draws without a hole. Levels that could not keep up with the eye are not asked for ([`super::motion`]).

mod ground;
mod requests;

use super::clipmap::{Shape, TorusPart, Window};
use super::motion::{Motion, Pursuit};
use super::partition::Partition;
use super::surface::{BATCH_TEXELS, Batch};
use super::worker::{BATCHES, Job, Parcel, Purpose, Worker};
use crate::limits::LEVELS_MAX;
use arrayvec::ArrayVec;

/// Side of the squares in which a level is filled.
const FILL_SIDE: i32 = 64;
/// Squares of the widest level.
const SQUARES_MAX: usize = 64;
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

    /// All that will be drawn of a level is about to be written anew: it need not catch up with what was there.
    fn forget(&mut self, _level: u8) {}

    /// Overwrites a rectangle of a level's torus: `part.width` x `part.height` texels row by row; see
    /// [`Batch`] for what they hold.
    fn write(&mut self, level: u8, part: TorusPart, heights: &[[u16; 2]], surface: &[[u8; 4]]);
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Residency {
    /// Nothing useful in its torus.
    Out,
    /// Being filled at a window: how many squares have been asked for, and texels still to come.
    Filling {
        window: Window,
        next: u8,
        left: usize,
    },
    /// Whole at a window; perhaps with a strip on its way that will move it.
    In {
        window: Window,
        step: Option<Window>,
    },
}

/// Something of a level that could not be read.
#[derive(Clone, Copy, Debug)]
struct Hurt {
    job: Job,
    /// Frames until it is tried again.
    rest: u16,
}

/// A level's copy of what its textures hold.
#[derive(Debug)]
struct Level {
    residency: Residency,
    generation: u32,
    version: u32,
    /// The squares of its window in the order in which they are asked for.
    order: ArrayVec<u8, SQUARES_MAX>,
    /// Whether nothing has been written since it was last given up.
    is_fresh: bool,
    /// Whether it follows the eye in this frame, and did in the one before.
    is_followed: bool,
    was_followed: bool,
    /// The window for which tiles were last fetched ahead.
    ahead: Option<Window>,
    hurt: Option<Hurt>,
    heights: Vec<[u16; 2]>,
    surface: Vec<[u8; 4]>,
    extremes: Vec<(u16, u16)>,
}

impl Level {
    fn new(texels: usize) -> Self {
        Self {
            residency: Residency::Out,
            generation: 0,
            version: 0,
            order: ArrayVec::new(),
            is_fresh: false,
            is_followed: false,
            was_followed: false,
            ahead: None,
            hurt: None,
            heights: vec![UNWRITTEN; texels * texels],
            surface: vec![[0, 0, 0, u8::MAX]; texels * texels],
            extremes: vec![(u16::MAX, 0); (texels / EXTREMES_SIDE).pow(2)],
        }
    }
}

/// A batch that did not fit a frame's quota, and how much of it was uploaded.
#[derive(Debug)]
struct Held {
    parcel: Parcel,
    part: usize,
    row: usize,
}

/// Bytes of a texel: heights and surface.
const TEXEL_BYTES: usize = size_of::<[u16; 2]>() + size_of::<[u8; 4]>();

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

/// What the streaming thread is doing, as the frame loop sees it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Errands {
    /// Batches that are wanted for drawing and have not come back.
    pub outstanding: usize,
    /// Batches that have come back since the start, modulo 2^32. One that stands still while there are some outstanding: the
    /// disk does not answer.
    pub answered: u32,
    /// Of these, those that came back unfilled, since their level had been given up.
    pub dropped: u32,
    /// The finest level that is asked for: finer ones could not keep up with the eye.
    pub finest: u8,
    /// Whether something that is resident was drawn from coarser data because the disk failed; it is tried again.
    pub unread: bool,
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
    /// The eye's post position on level 0, and how it moves.
    eye: (f64, f64),
    motion: Motion,
    pursuit: Pursuit,
    samples_per_frame: u32,
    /// The largest quota of the last frames, about.
    usual_quota: usize,
    /// Whether a look ahead is on its way.
    is_looking: bool,
    outstanding: usize,
    answered: u32,
    finest: u8,
}

impl Streamer {
    /// Nothing resident yet. `levels`: how many the pack has. `samples_per_frame`: how many the worker may decode.
    #[must_use]
    pub fn new(
        partition: Partition,
        shape: Shape,
        levels: u8,
        worker: Worker,
        samples_per_frame: u32,
    ) -> Self {
        let texels = shape.texels();
        Self {
            partition,
            shape,
            levels: std::iter::repeat_with(|| Level::new(texels))
                .take(usize::from(levels).min(LEVELS_MAX))
                .collect(),
            worker,
            free: std::iter::repeat_with(Box::default).take(BATCHES).collect(),
            held: None,
            eye: (0.0, 0.0),
            motion: Motion::default(),
            pursuit: Pursuit::default(),
            samples_per_frame,
            usual_quota: 0,
            is_looking: false,
            outstanding: 0,
            answered: 0,
            finest: 0,
        }
    }

    /// Grants the samples that may be decoded in a frame, for every line of the thread; see [`Worker::begin_frame`].
    #[must_use]
    pub fn begin_frame(&self) -> u32 {
        self.worker.begin_frame()
    }

    /// Lets this streamer's jobs go before the other's.
    pub fn lead(&self) {
        self.worker.lead();
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
        self.eye = eye;
        self.motion.note(eye);
        let mut left = quota;
        while let Some(held) = self.held.take().or_else(|| self.next_arrival()) {
            self.held = self.upload(held, &mut left, sink);
            if self.held.is_some() {
                break;
            }
        }
        let followed = self.choose(wanted, quota);
        self.finest = followed.0;
        for level in (followed.0..=followed.1).rev() {
            self.follow(level, quota);
            let of = &self.levels[usize::from(level)];
            if matches!(of.residency, Residency::In { .. }) {
                left -= sink.catch_up(level, &of.torus(), left);
            }
        }
        self.look_ahead(followed);
        let texels = quota - left;
        Uploads {
            texels,
            bytes: texels * TEXEL_BYTES,
        }
    }

    /// The next batch to upload; looks ahead that have come back are done with here.
    fn next_arrival(&mut self) -> Option<Held> {
        loop {
            let parcel = self.worker.receive()?;
            if parcel.job.purpose == Purpose::Ahead {
                self.looked(parcel);
                continue;
            }
            self.outstanding = self.outstanding.saturating_sub(1);
            self.answered = self.answered.wrapping_add(1);
            return Some(Held {
                parcel,
                part: 0,
                row: 0,
            });
        }
    }

    /// Gives up all levels and goes over to a partition.
    pub fn enter(&mut self, partition: Partition) {
        self.partition = partition;
        self.motion.reset();
        self.pursuit.reset();
        for (number, level) in (0_u8..).zip(&mut self.levels) {
            level.residency = Residency::Out;
            level.generation = level.generation.wrapping_add(1);
            level.version = level.version.wrapping_add(1);
            level.ahead = None;
            level.hurt = None;
            self.worker.want(number, level.generation);
        }
    }

    /// What the streaming thread is doing.
    #[must_use]
    pub fn errands(&self) -> Errands {
        Errands {
            outstanding: self.outstanding,
            answered: self.answered,
            dropped: self.worker.dropped(),
            finest: self.finest,
            unread: self.levels.iter().any(|level| level.hurt.is_some()),
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

    /// Bytes of the copies of all levels and of the batches in circulation.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let of = |level: &Level| {
            size_of_val(level.heights.as_slice())
                + size_of_val(level.surface.as_slice())
                + size_of_val(level.extremes.as_slice())
        };
        self.levels.iter().map(of).sum::<usize>() + BATCHES * BATCH_TEXELS * TEXEL_BYTES
    }

    /// Bytes of the tiles that the streaming thread keeps, for every line together.
    #[must_use]
    pub fn cache_bytes(&self) -> usize {
        self.worker.cache_bytes()
    }

    /// The worker's counts of unreadable tiles.
    #[must_use]
    pub fn damage(&self) -> super::surface::DamageCounts {
        self.worker.damage().counts()
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
        if matches!(level.residency, Residency::In { .. }) {
            *left -= sink.catch_up(job.level, &level.torus(), *left);
            if job.texels() > *left {
                return Some(held);
            }
        } else if std::mem::take(&mut level.is_fresh) {
            sink.forget(job.level);
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
        if held.parcel.unread {
            self.remember_unread(job);
        }
        self.free.push(held.parcel.batch);
        None
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
