//! The streaming thread: one for all partitions, which turns jobs into filled batches. Jobs and batches travel through rings
//! of fixed size and batches circulate, so after start nothing is allocated and neither side ever waits for the other's lock.
//!
//! A *line* is one partition's pair of rings. Of all jobs that wait, on either line, the thread takes the most urgent:
//! coarse before fine, near before far, what may be wanted soon after what is wanted now. A job whose level has been given up
//! since comes back unfilled, and at once.

use super::clipmap::{Shape, torus_parts};
use super::credit::Credit;
use super::partition::Partition;
use super::surface::{Batch, Damage, Sampler, TileSource};
use super::tables::HeightCode;
use crate::limits::LEVELS_MAX;
use arrayvec::ArrayVec;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering};
use std::thread::{self, JoinHandle};

/// Batches in circulation on a line: a second of strips of every level, or half the jobs of a whole level at once; 32 KiB each.
pub const BATCHES: usize = 48;

/// Lines at most: the geographic grid's, and a cap's.
pub const LINES_MAX: usize = 2;

/// What a job is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// To be drawn.
    Show,
    /// To have its tiles at hand when they are wanted; nothing is filled.
    Ahead,
}

/// A rectangle of posts of a level that is wanted. At most [`super::surface::BATCH_TEXELS`] posts, unless it is fetched ahead.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Job {
    /// Whose posts.
    pub partition: Partition,
    /// The level.
    pub level: u8,
    /// Which of the level's fillings it belongs to; a batch that comes back after the level was given up is recognised
    /// by this.
    pub generation: u32,
    /// Westernmost column.
    pub i: i32,
    /// Southernmost row.
    pub j: i32,
    /// Columns.
    pub width: u16,
    /// Rows.
    pub height: u16,
    /// What for.
    pub purpose: Purpose,
    /// Among the jobs of its level, the lowest is the most urgent.
    pub rank: u16,
}

impl Job {
    /// Texels it fills.
    #[must_use]
    pub fn texels(&self) -> usize {
        usize::from(self.width) * usize::from(self.height)
    }

    /// The lowest is the most urgent. `waits`: whether its line is not the one that is drawn.
    fn urgency(&self, waits: bool) -> (bool, bool, u8, u16) {
        (
            self.purpose == Purpose::Ahead,
            waits,
            u8::MAX - self.level,
            self.rank,
        )
    }
}

/// A job with its batch, on its way.
#[derive(Debug)]
pub struct Parcel {
    /// What is, or was, asked.
    pub job: Job,
    /// Where the texels go.
    pub batch: Box<Batch>,
    /// Whether a tile of it could not be read, this time.
    pub unread: bool,
}

/// What both threads know.
#[derive(Debug)]
struct Shared {
    stop: AtomicBool,
    damage: Damage,
    credit: Credit,
    /// The fillings that are wanted, by line and level.
    generations: [[AtomicU32; LEVELS_MAX]; LINES_MAX],
    /// The line that is drawn.
    first: AtomicU8,
    dropped: AtomicU32,
    cache_bytes: usize,
}

/// The thread; ends when the last line is dropped.
#[derive(Debug)]
struct Running {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Running {
    fn wake(&self) {
        if let Some(thread) = &self.thread {
            thread.thread().unpark();
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Release);
        self.wake();
        if let Some(thread) = self.thread.take() {
            // A worker that panicked has printed its reason; there is nothing left to do for it here.
            let _ = thread.join();
        }
    }
}

/// What the thread may use.
#[derive(Clone, Copy, Debug)]
pub struct Means {
    /// Samples decoded for each [`Worker::begin_frame`].
    pub samples_per_frame: u32,
    /// Decoded tiles that are kept.
    pub tiles_kept: usize,
}

/// The render thread's end of a line.
#[derive(Debug)]
pub struct Worker {
    to: rtrb::Producer<Parcel>,
    from: rtrb::Consumer<Parcel>,
    running: Arc<Running>,
    line: u8,
}

/// The streaming thread's end of a line.
#[derive(Debug)]
struct Line {
    jobs: rtrb::Consumer<Parcel>,
    filled: rtrb::Producer<Parcel>,
}

impl Worker {
    /// Starts the thread with so many lines, at most [`LINES_MAX`].
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn start<S: TileSource>(
        source: Arc<S>,
        shape: Shape,
        heights: HeightCode,
        means: Means,
        lines: usize,
    ) -> io::Result<ArrayVec<Self, LINES_MAX>> {
        let (mut ours, mut theirs) = (ArrayVec::<_, LINES_MAX>::new(), ArrayVec::new());
        for _ in 0..lines.min(LINES_MAX) {
            let (to, jobs) = rtrb::RingBuffer::<Parcel>::new(BATCHES);
            let (filled, from) = rtrb::RingBuffer::<Parcel>::new(BATCHES);
            ours.push((to, from));
            theirs.push(Line { jobs, filled });
        }
        let shared = Arc::new(Shared {
            stop: AtomicBool::new(false),
            damage: Damage::default(),
            credit: Credit::new(means.samples_per_frame),
            generations: Default::default(),
            first: AtomicU8::new(0),
            dropped: AtomicU32::new(0),
            cache_bytes: super::surface::cache_bytes(means.tiles_kept),
        });
        let seen = Arc::clone(&shared);
        let thread = thread::Builder::new()
            .name("terrain".into())
            .spawn(move || {
                let sampler = Sampler::new(&*source, Partition::default(), heights, &seen.damage)
                    .keeping(means.tiles_kept)
                    .on_credit(&seen.credit, &seen.stop);
                work(sampler, shape, &seen, theirs);
            })?;
        let running = Arc::new(Running {
            shared,
            thread: Some(thread),
        });
        let with_line = |(line, (to, from))| Self {
            to,
            from,
            running: Arc::clone(&running),
            line,
        };
        Ok((0_u8..).zip(ours).map(with_line).collect())
    }

    /// Begins a frame: grants the samples that may be decoded in it. Returns how many were in the frame before. Once a frame,
    /// however many lines there are.
    pub fn begin_frame(&self) -> u32 {
        let (taken, is_wanted) = self.running.shared.credit.grant();
        if is_wanted {
            self.running.wake();
        }
        taken
    }

    /// Lets this line's jobs go before the other's.
    pub fn lead(&self) {
        self.running
            .shared
            .first
            .store(self.line, Ordering::Relaxed);
    }

    /// Says which filling of a level is wanted from now on; jobs of others are dropped.
    pub fn want(&self, level: u8, generation: u32) {
        let levels = &self.running.shared.generations[usize::from(self.line)];
        levels[usize::from(level)].store(generation, Ordering::Relaxed);
    }

    /// Sends a job. Gives the parcel back if the ring is full, which it cannot be with [`BATCHES`] in circulation.
    ///
    /// # Errors
    /// The parcel, unsent.
    pub fn send(&mut self, parcel: Parcel) -> Result<(), Parcel> {
        self.to
            .push(parcel)
            .map_err(|rtrb::PushError::Full(parcel)| parcel)?;
        self.running.wake();
        Ok(())
    }

    /// A batch that has come back, if one has: filled, or of no use any more.
    pub fn receive(&mut self) -> Option<Parcel> {
        self.from.pop().ok()
    }

    /// Tiles that could not be read.
    #[must_use]
    pub fn damage(&self) -> &Damage {
        &self.running.shared.damage
    }

    /// Jobs that came back unfilled because their level had been given up.
    #[must_use]
    pub fn dropped(&self) -> u32 {
        self.running.shared.dropped.load(Ordering::Relaxed)
    }

    /// Bytes of decoded tiles that the thread keeps, whatever the number of lines.
    #[must_use]
    pub fn cache_bytes(&self) -> usize {
        self.running.shared.cache_bytes
    }
}

/// Parcels that the thread has taken out of the rings: as many as there are.
type Waiting = ArrayVec<(u8, Parcel), { BATCHES * LINES_MAX }>;

/// The thread's life.
fn work<S: TileSource>(
    mut sampler: Sampler<'_, S>,
    shape: Shape,
    shared: &Shared,
    mut lines: ArrayVec<Line, LINES_MAX>,
) {
    let mut waiting = Waiting::new();
    while !shared.stop.load(Ordering::Acquire) {
        for (line, of) in (0_u8..).zip(&mut lines) {
            while let Ok(parcel) = of.jobs.pop() {
                waiting.push((line, parcel));
            }
        }
        let Some((line, mut parcel)) = most_urgent(&mut waiting, shared) else {
            // Woken by the next job or by the end; a wake-up before the wait makes it return at once.
            thread::park();
            continue;
        };
        let job = parcel.job;
        let wanted = &shared.generations[usize::from(line)][usize::from(job.level)];
        parcel.unread = false;
        parcel.batch.parts.clear();
        if wanted.load(Ordering::Relaxed) != job.generation {
            shared.dropped.fetch_add(1, Ordering::Relaxed);
        } else if job.purpose == Purpose::Ahead {
            // Whatever else is asked meanwhile goes before.
            let leaves_off = || lines.iter().any(|of| !of.jobs.is_empty());
            parcel.unread = look(&mut sampler, &job, leaves_off);
        } else {
            fill(&mut sampler, shape, &mut parcel);
        }
        // There are as many places as batches, so there is always one.
        if lines[usize::from(line)].filled.push(parcel).is_err() {
            return;
        }
    }
}

fn most_urgent(waiting: &mut Waiting, shared: &Shared) -> Option<(u8, Parcel)> {
    let first = shared.first.load(Ordering::Relaxed);
    let key = |(line, parcel): &(u8, Parcel)| parcel.job.urgency(*line != first);
    let at = (0..waiting.len()).min_by_key(|&at| key(&waiting[at]))?;
    Some(waiting.swap_remove(at))
}

/// Reads the tiles of a job that is not drawn. Returns whether any of them is not known to be readable.
fn look<S: TileSource>(
    sampler: &mut Sampler<'_, S>,
    job: &Job,
    leaves_off: impl FnMut() -> bool,
) -> bool {
    sampler.enter(job.partition);
    let size = (usize::from(job.width), usize::from(job.height));
    let left_off = sampler.fetch(job.level, (job.i, job.j), size, leaves_off);
    sampler.take_unread() || left_off
}

/// Fills a parcel's batch, part by part as the torus takes it.
pub fn fill<S: TileSource>(sampler: &mut Sampler<'_, S>, shape: Shape, parcel: &mut Parcel) {
    let (job, batch) = (parcel.job, &mut *parcel.batch);
    sampler.enter(job.partition);
    batch.parts.clear();
    let (width, height) = (usize::from(job.width), usize::from(job.height));
    let mut start = 0;
    for part in torus_parts(shape.texels(), (job.i, job.j), width, height) {
        let end = start + part.width * part.height;
        let at = (job.i + step(part.from_x), job.j + step(part.from_y));
        sampler.fill(
            job.level,
            at,
            (part.width, part.height),
            &mut batch.heights[start..end],
            &mut batch.surface[start..end],
        );
        batch.parts.push(part);
        start = end;
    }
    parcel.unread = sampler.take_unread();
}

/// Posts inside a job, at most a few hundred, as a step.
fn step(posts: usize) -> i32 {
    i32::try_from(posts).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const JOB: Job = Job {
        partition: Partition::Geographic,
        level: 3,
        generation: 0,
        i: 0,
        j: 0,
        width: 1,
        height: 1,
        purpose: Purpose::Show,
        rank: 5,
    };

    #[test]
    fn coarse_goes_before_fine_near_before_far_and_what_is_drawn_before_the_rest() {
        let drawn = [
            Job {
                level: 4,
                rank: 9,
                ..JOB
            },
            JOB,
            Job { rank: 6, ..JOB },
            Job {
                level: 2,
                rank: 0,
                ..JOB
            },
        ];
        let mut keys: Vec<_> = drawn.map(|job| job.urgency(false)).to_vec();
        keys.push(
            Job {
                level: 9,
                rank: 0,
                ..JOB
            }
            .urgency(true),
        );
        keys.push(
            Job {
                level: 11,
                rank: 0,
                purpose: Purpose::Ahead,
                ..JOB
            }
            .urgency(false),
        );
        assert!(keys.is_sorted(), "{keys:?}");
    }
}
