//! The streaming worker: one thread that turns jobs into filled batches. Jobs and batches travel through rings of fixed
//! size and batches circulate, so after start nothing is allocated and neither side ever waits for the other's lock.

use super::clipmap::{Shape, torus_parts};
use super::partition::Partition;
use super::surface::{Batch, Damage, Sampler, TileSource};
use super::tables::HeightCode;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};

/// Batches in circulation: a second of strips of every level, or half the jobs of a whole level at once; 32 KiB each.
pub const BATCHES: usize = 48;

/// A rectangle of posts of a level that is wanted. At most [`super::surface::BATCH_TEXELS`] posts.
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
}

impl Job {
    /// Texels it fills.
    #[must_use]
    pub fn texels(&self) -> usize {
        usize::from(self.width) * usize::from(self.height)
    }
}

/// A job with its batch, on its way.
#[derive(Debug)]
pub struct Parcel {
    /// What is, or was, asked.
    pub job: Job,
    /// Where the texels go.
    pub batch: Box<Batch>,
}

/// The render thread's end of the worker. Dropping it ends the thread.
#[derive(Debug)]
pub struct Worker {
    to: rtrb::Producer<Parcel>,
    from: rtrb::Consumer<Parcel>,
    stop: Arc<AtomicBool>,
    damage: Arc<Damage>,
    thread: Option<JoinHandle<()>>,
}

impl Worker {
    /// Starts the thread.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn start<S: TileSource>(
        source: Arc<S>,
        shape: Shape,
        heights: HeightCode,
    ) -> io::Result<Self> {
        let (to, mut jobs) = rtrb::RingBuffer::<Parcel>::new(BATCHES);
        let (mut filled, from) = rtrb::RingBuffer::<Parcel>::new(BATCHES);
        let stop = Arc::new(AtomicBool::new(false));
        let damage = Arc::new(Damage::default());
        let (stopped, counts) = (Arc::clone(&stop), Arc::clone(&damage));
        let thread = thread::Builder::new()
            .name("terrain".into())
            .spawn(move || {
                let mut sampler = Sampler::new(&*source, Partition::default(), heights, &counts);
                while !stopped.load(Ordering::Acquire) {
                    let Ok(mut parcel) = jobs.pop() else {
                        // Woken by the next job or by the end; a wake-up before the wait makes it return at once.
                        thread::park();
                        continue;
                    };
                    fill(&mut sampler, shape, &mut parcel);
                    // There are as many places as batches, so there is always one.
                    if filled.push(parcel).is_err() {
                        return;
                    }
                }
            })?;
        Ok(Self {
            to,
            from,
            stop,
            damage,
            thread: Some(thread),
        })
    }

    /// Sends a job. Gives the parcel back if the ring is full, which it cannot be with [`BATCHES`] in circulation.
    ///
    /// # Errors
    /// The parcel, unsent.
    pub fn send(&mut self, parcel: Parcel) -> Result<(), Parcel> {
        self.to
            .push(parcel)
            .map_err(|rtrb::PushError::Full(parcel)| parcel)?;
        if let Some(thread) = &self.thread {
            thread.thread().unpark();
        }
        Ok(())
    }

    /// A filled batch, if one is ready.
    pub fn receive(&mut self) -> Option<Parcel> {
        self.from.pop().ok()
    }

    /// Tiles that could not be read.
    #[must_use]
    pub fn damage(&self) -> &Damage {
        &self.damage
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // A worker that panicked has printed its reason; there is nothing left to do for it here.
            let _ = thread.join();
        }
    }
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
}

/// Posts inside a job, at most a few hundred, as a step.
fn step(posts: usize) -> i32 {
    i32::try_from(posts).unwrap_or(0)
}
