//! From the rings of the bus threads to the flight state, on whichever thread asks: the frame loop itself, just before it
//! draws (the shortest way), or a fusion thread that publishes the state to others.

use crate::limits::{SIGNALS_QUEUED_MAX, SOURCES_MAX};
use crate::signal::Signal;
use crate::state::{FlightState, Fusion};
use crate::time::Monotonic;
use arrayvec::ArrayVec;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// The rings and the fusion that they feed.
#[derive(Debug)]
pub struct Intake {
    rings: ArrayVec<rtrb::Consumer<Signal>, SOURCES_MAX>,
    fusion: Fusion,
}

impl Intake {
    /// Reads up to [`SOURCES_MAX`] rings; a board file cannot name more sources.
    #[must_use]
    pub fn new(rings: impl IntoIterator<Item = rtrb::Consumer<Signal>>, fusion: Fusion) -> Self {
        Self {
            rings: rings.into_iter().take(SOURCES_MAX).collect(),
            fusion,
        }
    }

    /// Takes in what has come and gives the state at `now`. Neither waits nor allocates; at most a ring's capacity is
    /// taken from each, so that it ends however fast the buses are.
    pub fn step(&mut self, now: Monotonic) -> FlightState {
        for ring in &mut self.rings {
            for _ in 0..SIGNALS_QUEUED_MAX {
                let Ok(signal) = ring.pop() else {
                    break;
                };
                self.fusion.apply(&signal);
            }
        }
        self.fusion.step(now)
    }
}

/// A thread, named `fusion`, that steps an [`Intake`] every period and publishes the state. It stops when this is dropped.
#[derive(Debug)]
pub struct FusionThread {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl FusionThread {
    /// Starts it; `period` is [`FUSION_PERIOD`](crate::limits::FUSION_PERIOD) but in tests. A signal is in the published
    /// state one period after its frame was received at the latest, plus what the scheduler takes.
    ///
    /// # Errors
    /// When the system has no room for a thread.
    pub fn start(
        mut intake: Intake,
        period: Duration,
    ) -> std::io::Result<(triple_buffer::Output<FlightState>, Self)> {
        let (mut publish, states) = triple_buffer::triple_buffer(&FlightState::empty());
        let stop = Arc::new(AtomicBool::new(false));
        let thread = std::thread::Builder::new().name("fusion".into()).spawn({
            let stop = Arc::clone(&stop);
            move || {
                let mut next = Monotonic::read();
                while !stop.load(Ordering::Acquire) {
                    let now = Monotonic::read();
                    publish.write(intake.step(now));
                    // Steps keep their beat; after a pause of the system they start a new one instead of catching up.
                    next = next.plus(period);
                    let wait = next.since(now).unwrap_or_default();
                    if wait.is_zero() {
                        next = now.plus(period);
                    }
                    std::thread::park_timeout(wait.max(Duration::from_micros(100)));
                }
            }
        })?;
        let thread = Self {
            stop,
            thread: Some(thread),
        };
        Ok((states, thread))
    }
}

impl Drop for FusionThread {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // A fusion thread that panicked publishes nothing more, and what it published goes stale.
            let _ = thread.join();
        }
    }
}
