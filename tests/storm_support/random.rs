//! Numbers without a pattern, and damage as lines do it.

/// Marsaglia 2003, "Xorshift RNGs".
#[derive(Clone, Debug)]
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    pub(crate) fn below(&mut self, n: usize) -> usize {
        usize::try_from(self.next() >> 11).unwrap_or(0) % n.max(1)
    }

    pub(crate) fn byte(&mut self) -> u8 {
        self.next().to_be_bytes()[0]
    }

    /// One of several.
    pub(crate) fn of<'a, T>(&mut self, all: &'a [T]) -> &'a T {
        &all[self.below(all.len())]
    }

    /// Damages a frame as lines do: bits turned over, bytes replaced, lost, doubled; the end cut off.
    pub(crate) fn damage(&mut self, frame: &mut Vec<u8>) {
        for _ in 0..=self.below(3) {
            if frame.is_empty() {
                return;
            }
            let i = self.below(frame.len());
            match self.below(6) {
                0 | 1 => frame[i] ^= 1 << self.below(8),
                2 => frame[i] = self.byte(),
                3 => {
                    frame.remove(i);
                }
                4 => frame.insert(i, frame[i]),
                _ => frame.truncate(frame.len() - self.below(3).min(frame.len())),
            }
        }
    }

    /// Changes fields of a frame to what is likely to be special in them; its length stays.
    pub(crate) fn tamper(&mut self, frame: &mut [u8]) {
        const SPECIAL: [u8; 21] = *b"\x00\x01\x7D\x7E\x7F\x80\xFF0919-+.,X_*$!A";
        for _ in 0..=self.below(4) {
            if !frame.is_empty() {
                let i = self.below(frame.len());
                frame[i] = if self.below(3) == 0 {
                    self.byte()
                } else {
                    *self.of(&SPECIAL)
                };
            }
        }
    }
}
