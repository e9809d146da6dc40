//! What is asked of the streaming thread: which levels follow the eye, by which strips and squares, what is looked up ahead
//! of the flight when nothing is urgent, and what is tried again after a disk has failed.

use super::{FILL_SIDE, Hurt, Residency, SQUARES_MAX, STRIP_POSTS_MAX, Streamer};
use crate::terrain::clipmap::Window;
use crate::terrain::motion::Allowed;
use crate::terrain::surface::BATCH_TEXELS;
use crate::terrain::worker::{Job, Parcel, Purpose};

/// Frames of flight that squares are chosen ahead of the eye.
const LEAD_FRAMES: f64 = 30.0;

/// Posts beyond a window whose tiles are fetched ahead of the flight: half a tile.
const AHEAD_POSTS: f64 = 64.0;

/// An eye slower than this stands: level-0 posts a frame.
const STANDING: f64 = 1e-4;

/// Frames from a tile that could not be read to the next try: longer than the reader remembers it.
const RETRY_FRAMES: u16 = 120;

/// Ranks of looks ahead: at the ground before the eye, and at what could not be read.
const LOOK: u16 = 0;
const PROBE: u16 = 1;

impl Streamer {
    /// Chooses the levels that keep up and lets them follow the eye, coarse before fine. `eye`: its post position on level 0.
    pub(super) fn choose(&mut self, wanted: (u8, u8), quota: usize) -> (u8, u8) {
        // What is left over for a partition that is not drawn changes from frame to frame.
        self.usual_quota = quota.max(self.usual_quota - self.usual_quota / 64);
        let allowed = Allowed {
            texels: self.usual_quota,
            samples: self.samples_per_frame,
            strip_posts: self.widest(self.usual_quota).max(2),
        };
        let finest = self
            .pursuit
            .finest(self.shape, wanted, &self.motion, allowed);
        for (level, of) in (0_u8..).zip(&mut self.levels) {
            of.was_followed = of.is_followed;
            of.is_followed = (finest..=wanted.1).contains(&level);
        }
        (finest, wanted.1)
    }

    /// Brings a level's window nearer to the eye.
    pub(super) fn follow(&mut self, level: u8, quota: usize) {
        let at = usize::from(level);
        let eye = self.eye_on(level);
        let around = |current| Window::around(self.shape, eye.0, eye.1, current);
        let far = |a: Window, b: Window| {
            (a.i - b.i).abs().max((a.j - b.j).abs()) > self.shape.strip_steps_max()
        };
        match self.levels[at].residency {
            Residency::Out => self.begin(level, around(None)),
            Residency::In { window, .. } | Residency::Filling { window, .. }
                if far(window, around(Some(window))) =>
            {
                if self.levels[at].was_followed && !self.has_leapt(level) {
                    self.pursuit.outrun(level, &self.motion);
                }
                self.begin(level, around(None));
            }
            Residency::In {
                window, step: None, ..
            } => {
                let target = around(Some(window));
                if target != window {
                    self.ask_strip(level, window, target, quota);
                }
            }
            Residency::In { .. } | Residency::Filling { .. } => {}
        }
        self.ask_squares(level);
    }

    /// Whether the last step of the eye alone took a level's window out of its place.
    fn has_leapt(&self, level: u8) -> bool {
        let step = self.motion.step();
        let posts = step.0.abs().max(step.1.abs()) / f64::from(1_u32 << level);
        posts > f64::from(self.shape.strip_steps_max()) / 2.0
    }

    fn eye_on(&self, level: u8) -> (f64, f64) {
        let scale = f64::from(1_u32 << level);
        (self.eye.0 / scale, self.eye.1 / scale)
    }

    /// Gives up what a level holds and fills it anew at a window, from the squares that the eye will be over to the farthest.
    fn begin(&mut self, level: u8, window: Window) {
        let n = self.shape.vertices().cast_unsigned() as usize;
        let per_side = self.squares_per_side();
        let (eye, velocity) = (self.eye_on(level), self.motion.velocity());
        let scale = f64::from(1_u32 << level);
        let lead = |eye: f64, v: f64| eye + v / scale * LEAD_FRAMES;
        let (x, y) = (lead(eye.0, velocity.0), lead(eye.1, velocity.1));
        let far = |square: u8| {
            let square = i32::from(square);
            let middle = |origin: i32, k: i32| f64::from(origin + k * FILL_SIDE + FILL_SIDE / 2);
            let dx = middle(window.i, square % per_side) - x;
            let dy = middle(window.j, square / per_side) - y;
            dx * dx + dy * dy
        };
        let level_at = &mut self.levels[usize::from(level)];
        level_at.order.clear();
        level_at
            .order
            .extend((0_u8..).take((per_side * per_side).cast_unsigned() as usize));
        level_at
            .order
            .sort_unstable_by(|a, b| far(*a).total_cmp(&far(*b)));
        level_at.generation = level_at.generation.wrapping_add(1);
        level_at.residency = Residency::Filling {
            window,
            next: 0,
            left: n * n,
        };
        level_at.version = level_at.version.wrapping_add(1);
        level_at.is_fresh = true;
        level_at.hurt = None;
        self.worker.want(level, level_at.generation);
    }

    fn squares_per_side(&self) -> i32 {
        (self.shape.vertices() + FILL_SIDE - 1) / FILL_SIDE
    }

    /// Asks for the squares of a level that is being filled, as long as there are batches.
    fn ask_squares(&mut self, level: u8) {
        let at = usize::from(level);
        let n = self.shape.vertices();
        let per_side = self.squares_per_side();
        while let Residency::Filling { window, next, left } = self.levels[at].residency {
            let Some(&square) = self.levels[at].order.get(usize::from(next)) else {
                return;
            };
            let square = i32::from(square);
            let (x, y) = (square % per_side * FILL_SIDE, square / per_side * FILL_SIDE);
            let job = Job {
                i: window.i + x,
                j: window.j + y,
                width: count(FILL_SIDE.min(n - x)),
                height: count(FILL_SIDE.min(n - y)),
                rank: u16::from(next) + 1,
                ..self.job(level)
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

    /// A job of a level that asks for nothing yet.
    fn job(&self, level: u8) -> Job {
        Job {
            partition: self.partition,
            level,
            generation: self.levels[usize::from(level)].generation,
            i: 0,
            j: 0,
            width: 0,
            height: 0,
            purpose: Purpose::Show,
            rank: 0,
        }
    }

    /// Posts across the widest strip that is no larger than a quota.
    fn widest(&self, quota: usize) -> i32 {
        let texels = i32::try_from(quota.min(BATCH_TEXELS)).unwrap_or(i32::MAX);
        (texels / self.shape.vertices()).min(STRIP_POSTS_MAX) & !1
    }

    /// Asks for the strip that moves a window towards `target` along one axis, that on which it is farther behind, no larger than a frame's quota.
    fn ask_strip(&mut self, level: u8, window: Window, target: Window, quota: usize) {
        let n = self.shape.vertices();
        let widest = self.widest(quota);
        if widest == 0 {
            return;
        }
        let (dx, dy) = (target.i - window.i, target.j - window.j);
        let limit = |d: i32| d.clamp(-widest, widest);
        // The first new post of a side that moves by `d`.
        let fresh = |origin: i32, d: i32| if d > 0 { origin + n } else { origin + d };
        let (step, i, j, width, height) = if dx.abs() >= dy.abs() {
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
            i,
            j,
            width: count(width),
            height: count(height),
            ..self.job(level)
        };
        if self.ask(job) {
            self.levels[usize::from(level)].residency = Residency::In {
                window,
                step: Some(step),
            };
        }
    }

    /// When nothing is urgent: looks again at what could not be read, else fetches the tiles before the eye, finest level first.
    pub(super) fn look_ahead(&mut self, (finest, coarsest): (u8, u8)) {
        let mut probe = None;
        for level in finest..=coarsest {
            if let Some(hurt) = &mut self.levels[usize::from(level)].hurt {
                hurt.rest = hurt.rest.saturating_sub(1);
                if hurt.rest == 0 {
                    hurt.rest = RETRY_FRAMES;
                    probe = Some((level, hurt.job));
                }
            }
        }
        if self.outstanding > 0 || self.is_looking || self.held.is_some() {
            return;
        }
        if let Some((level, job)) = probe {
            self.look(Job {
                purpose: Purpose::Ahead,
                rank: PROBE,
                generation: self.levels[usize::from(level)].generation,
                ..job
            });
            return;
        }
        let (x, y) = self.motion.velocity();
        let most = x.abs().max(y.abs());
        if most < STANDING {
            return;
        }
        for level in finest..=coarsest {
            let of = &mut self.levels[usize::from(level)];
            let Residency::In { window, step: None } = of.residency else {
                continue;
            };
            if of.ahead.replace(window) == Some(window) {
                continue;
            }
            let n = count(self.shape.vertices());
            let job = Job {
                i: window.i + rounded(AHEAD_POSTS * x / most),
                j: window.j + rounded(AHEAD_POSTS * y / most),
                width: n,
                height: n,
                purpose: Purpose::Ahead,
                rank: LOOK,
                ..self.job(level)
            };
            self.look(job);
            return;
        }
    }

    fn look(&mut self, job: Job) {
        self.is_looking = self.ask(job);
    }

    /// Takes a look ahead back: what could not be read before and can be now is filled anew, and so is the finer level, which
    /// blends into it.
    pub(super) fn looked(&mut self, parcel: Parcel) {
        self.is_looking = false;
        let job = parcel.job;
        let is_current = self.levels[usize::from(job.level)].generation == job.generation;
        if job.rank == PROBE && !parcel.unread && is_current {
            for level in [Some(job.level), job.level.checked_sub(1)]
                .into_iter()
                .flatten()
            {
                if let Some(window) = self.window(level) {
                    self.begin(level, window);
                }
            }
        }
        self.free.push(parcel.batch);
    }

    /// Remembers a job some tile of which could not be read.
    pub(super) fn remember_unread(&mut self, job: Job) {
        let rest = RETRY_FRAMES;
        self.levels[usize::from(job.level)]
            .hurt
            .get_or_insert(Hurt { job, rest });
    }

    /// Sends a job if there is a batch for it.
    fn ask(&mut self, job: Job) -> bool {
        let Some(batch) = self.free.pop() else {
            return false;
        };
        let parcel = Parcel {
            job,
            batch,
            unread: false,
        };
        match self.worker.send(parcel) {
            Ok(()) => {
                self.outstanding += usize::from(job.purpose == Purpose::Show);
                true
            }
            Err(parcel) => {
                self.free.push(parcel.batch);
                false
            }
        }
    }
}

const _: () = assert!(
    crate::limits::LEVEL_VERTICES_MAX
        .div_ceil(FILL_SIDE.unsigned_abs() as usize)
        .pow(2)
        <= SQUARES_MAX,
    "the squares of the widest level"
);

/// A count of posts as a job holds it: at most a few hundred.
fn count(posts: i32) -> u16 {
    u16::try_from(posts).unwrap_or(0)
}

/// A few posts.
#[expect(clippy::cast_possible_truncation, reason = "at most half a tile")]
fn rounded(posts: f64) -> i32 {
    posts.round() as i32
}
