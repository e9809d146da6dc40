//! How many samples may be decoded in a frame. The frame loop grants an amount with every frame; the streaming thread takes
//! the samples of a tile before it decodes it, and waits for the next frame where not enough are left. What is left over
//! lapses, so no frame ever sees more than one grant.

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

/// The account of both threads.
#[derive(Debug)]
pub struct Credit {
    per_frame: u32,
    left: AtomicU32,
    /// Whether the streaming thread waits for a grant.
    is_wanted: AtomicBool,
    /// Grants so far: the streaming thread's count of frames.
    frames: AtomicU32,
}

impl Credit {
    /// With so many samples a frame, of which the first frame's are granted.
    #[must_use]
    pub const fn new(per_frame: u32) -> Self {
        Self {
            per_frame,
            left: AtomicU32::new(per_frame),
            is_wanted: AtomicBool::new(false),
            frames: AtomicU32::new(0),
        }
    }

    /// Begins a frame. Returns what was taken since the last one began, and whether somebody waits for this.
    pub fn grant(&self) -> (u32, bool) {
        let left = self.left.swap(self.per_frame, Ordering::SeqCst);
        self.frames.fetch_add(1, Ordering::Relaxed);
        let is_wanted = self.is_wanted.load(Ordering::SeqCst);
        (self.per_frame - left, is_wanted)
    }

    /// Takes samples, if as many are left; who wants more than a whole frame's takes all of an untouched frame's.
    #[must_use]
    pub fn take(&self, samples: u32) -> bool {
        let samples = samples.min(self.per_frame);
        // Told before it is tried: a grant in between is either taken or seen to be wanted.
        self.is_wanted.store(true, Ordering::SeqCst);
        let taken = self
            .left
            .fetch_update(Ordering::SeqCst, Ordering::SeqCst, |left| {
                left.checked_sub(samples)
            })
            .is_ok();
        if taken {
            self.is_wanted.store(false, Ordering::SeqCst);
        }
        taken
    }

    /// How many frames have begun, modulo 2^32.
    #[must_use]
    pub fn frames(&self) -> u32 {
        self.frames.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_frame_sees_more_than_its_grant_and_nothing_is_saved_up() {
        let credit = Credit::new(40_000);
        assert!(credit.take(16_384) && credit.take(16_384));
        assert!(!credit.take(16_384), "7232 are left");
        assert_eq!(
            credit.grant(),
            (32_768, true),
            "counted, and somebody waits"
        );
        assert!(credit.take(16_384));
        assert_eq!(credit.grant(), (16_384, false));
        assert_eq!(credit.grant(), (0, false), "nothing was taken");
        assert!(credit.take(16_384) && credit.take(16_384) && !credit.take(16_384));
    }

    #[test]
    fn a_frame_that_is_granted_less_than_a_tile_still_gets_one() {
        let credit = Credit::new(1000);
        assert!(credit.take(16_384) && !credit.take(16_384));
        assert_eq!(credit.grant(), (1000, true));
    }
}
