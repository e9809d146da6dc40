//! A CAN bus within this process, for machines without one: frames with their times of receipt, through a fixed ring.

use super::{BusError, Source};
use crate::signal::{CanData, Wire};
use crate::time::Monotonic;
use std::io;
use std::sync::{Arc, OnceLock};
use std::thread::Thread;
use std::time::Duration;

/// A new bus that holds up to `frames_max` frames on their way.
#[must_use]
pub fn bus(frames_max: usize) -> (Sender, Receiver) {
    let (producer, consumer) = rtrb::RingBuffer::new(frames_max);
    let listener = Arc::new(OnceLock::new());
    (
        Sender {
            frames: producer,
            listener: Arc::clone(&listener),
        },
        Receiver {
            frames: consumer,
            listener,
        },
    )
}

/// The sending end.
#[derive(Debug)]
pub struct Sender {
    frames: rtrb::Producer<(Monotonic, CanData)>,
    listener: Arc<OnceLock<Thread>>,
}

/// The bus is full: the receiver is behind by all the frames that it holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the bus is full")]
pub struct Full;

impl Sender {
    /// Sends a frame that is to count as received at `at`, and wakes the receiver.
    ///
    /// # Errors
    /// [`Full`] when there is no room; the frame is not sent.
    pub fn send(&mut self, at: Monotonic, can: CanData) -> Result<(), Full> {
        let sent = self.frames.push((at, can));
        if let Some(listener) = self.listener.get() {
            listener.unpark();
        }
        sent.map_err(|rtrb::PushError::Full(_)| Full)
    }
}

/// The receiving end, to be given to [`Endpoint::Loopback`](super::Endpoint::Loopback).
#[derive(Debug)]
pub struct Receiver {
    frames: rtrb::Consumer<(Monotonic, CanData)>,
    listener: Arc<OnceLock<Thread>>,
}

impl Source for Receiver {
    fn receive(&mut self, wait: Duration) -> io::Result<Option<(Monotonic, Wire<'_>)>> {
        self.listener.get_or_init(std::thread::current);
        if self.frames.is_empty() && !wait.is_zero() {
            // A frame sent between the look and the sleep leaves its wake-up behind: the sleep then ends at once.
            std::thread::park_timeout(wait);
        }
        Ok(self.frames.pop().ok().map(|(at, can)| (at, Wire::Can(can))))
    }

    fn open(&mut self) -> Result<(), BusError> {
        Ok(())
    }
}
