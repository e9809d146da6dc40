//! What bus threads give their frames to: a ring of bytes that is never waited for.

use super::format::{Kind, PAYLOAD_MAX, can_payload};
use crate::signal::{Frame, Wire};
use crate::time::Monotonic;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes on their way of each source: six seconds of a saturated 1 Mbit/s CAN bus, for the slowest card to come back from
/// whatever it does between writes.
const RING_BYTES: usize = 2 << 20;

/// Bytes before each payload in the ring: kind, length, time.
const FIXED: usize = 11;

/// Takes the frames of one source. Neither waits nor allocates.
#[derive(Debug)]
pub struct Tap {
    ring: rtrb::Producer<u8>,
    lost: Arc<AtomicU64>,
}

/// The other end of a [`Tap`].
#[derive(Debug)]
pub(super) struct Drain {
    ring: rtrb::Consumer<u8>,
    lost: Arc<AtomicU64>,
}

/// Both ends.
pub(super) fn tap() -> (Tap, Drain) {
    let (producer, consumer) = rtrb::RingBuffer::new(RING_BYTES);
    let lost = Arc::new(AtomicU64::new(0));
    let tap = Tap {
        ring: producer,
        lost: Arc::clone(&lost),
    };
    let drain = Drain {
        ring: consumer,
        lost,
    };
    (tap, drain)
}

impl Tap {
    /// Takes a frame; one that there is no room for is dropped and counted.
    pub fn take(&mut self, frame: &Frame<'_>) {
        let taken = match frame.wire {
            Wire::Can(can) => {
                let (payload, used) = can_payload(&can);
                self.put(Kind::Can, frame.at, &payload[..used])
            }
            Wire::Datagram(bytes) => self.put(Kind::Datagram, frame.at, bytes),
            Wire::Stream(bytes) => self.put(Kind::Stream, frame.at, bytes),
        };
        if taken.is_none() {
            self.lost.fetch_add(1, Ordering::Release);
        }
    }

    fn put(&mut self, kind: Kind, at: Monotonic, payload: &[u8]) -> Option<()> {
        let length = u16::try_from(payload.len()).ok()?;
        if payload.len() > PAYLOAD_MAX {
            return None;
        }
        let mut fixed = [0; FIXED];
        fixed[0] = kind as u8;
        fixed[1..3].copy_from_slice(&length.to_le_bytes());
        fixed[3..].copy_from_slice(&at.as_nanos().to_le_bytes());
        if self.ring.slots() < FIXED + payload.len() {
            return None;
        }
        // Both fit now; nobody else writes here.
        self.ring.push_entire_slice(&fixed).ok()?;
        self.ring.push_entire_slice(payload).ok()
    }
}

impl Drain {
    /// The next frame, its payload put into `payload`.
    pub(super) fn next(
        &mut self,
        payload: &mut [u8; PAYLOAD_MAX],
    ) -> Option<(Kind, Monotonic, usize)> {
        let mut fixed = [0; FIXED];
        // The head is seen before its payload is there, by the width of two instructions: it stays until both are.
        {
            let seen = self.ring.read_chunk(FIXED).ok()?;
            let (first, second) = seen.as_slices();
            fixed[..first.len()].copy_from_slice(first);
            fixed[first.len()..].copy_from_slice(second);
        }
        let [kind, low, high, at @ ..] = fixed;
        let length = usize::from(u16::from_le_bytes([low, high]));
        if self.ring.slots() < FIXED + length {
            return None;
        }
        self.ring.pop_entire_slice(&mut fixed).ok()?;
        let room = payload.get_mut(..length)?;
        self.ring.pop_entire_slice(room).ok()?;
        Some((
            Kind::of(kind)?,
            Monotonic::from_nanos(u64::from_le_bytes(at)),
            length,
        ))
    }

    /// Frames dropped so far.
    pub(super) fn lost(&self) -> u64 {
        self.lost.load(Ordering::Acquire)
    }
}
