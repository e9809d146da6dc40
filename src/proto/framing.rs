//! Frames out of a byte stream that may begin anywhere, lose bytes and carry other protocols between.
//!
//! A [`Framer`] holds what has come and asks a *grammar*, a pure function of the bytes at hand, what they begin with. It
//! copies each byte once into a fixed buffer and once more at most when room is made; it allocates nothing. A grammar skips
//! a whole damaged line, or one byte of a damaged binary frame; so the work per byte is bounded by the longest frame,
//! however hostile the stream.
//!
//! After damage, whole frames may have waited in the buffer behind a frame that never ended. Each frame is stamped with the
//! time at which its own last byte came, never with the time at which it was at last understood: late is not young.

use super::Fault;
use crate::time::Monotonic;
use arrayvec::ArrayVec;

/// What the bytes at hand begin with. The numbers are of bytes, at least 1 and at most what is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// Not decided before more bytes come.
    More,
    /// A whole frame with a right checksum.
    Frame(usize),
    /// A damaged frame.
    Damaged(usize, Fault),
    /// Another protocol, or bytes between frames. Successive ones are one foreign piece.
    Foreign(usize),
    /// Line ends, idle flags: nothing.
    Blank(usize),
}

/// What a stream is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Piece<'a> {
    /// A whole frame with a right checksum, and when its last byte was received.
    Frame(Monotonic, &'a [u8]),
    /// A damaged frame.
    Damaged(Fault),
    /// Another protocol's bytes.
    Foreign,
}

/// Times that are remembered of the bytes at hand. Of more than so many deliveries the latest are taken to be as old as
/// the last one remembered: too old rather than too young.
const MARKS: usize = 32;

/// Finds frames of at most `N` bytes in a stream.
#[derive(Debug)]
pub struct Framer<const N: usize> {
    buffer: [u8; N],
    /// The bytes at hand are `buffer[start..end]`.
    start: usize,
    end: usize,
    /// How many of them the grammar has already found undecided.
    seen: usize,
    /// Where each delivery ends in the buffer, and when it came.
    marks: ArrayVec<(usize, Monotonic), MARKS>,
    /// Whether the last piece was foreign or damaged, so that what follows it belongs to it.
    in_foreign: bool,
}

impl<const N: usize> Default for Framer<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Framer<N> {
    /// Nothing received yet.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            buffer: [0; N],
            start: 0,
            end: 0,
            seen: 0,
            marks: ArrayVec::new_const(),
            in_foreign: false,
        }
    }

    /// Takes `bytes` received at `at` and gives the pieces that they complete to `on`, in order. The grammar is given the
    /// bytes at hand and how many of them it has found undecided before.
    pub fn push(
        &mut self,
        at: Monotonic,
        mut bytes: &[u8],
        grammar: impl Fn(&[u8], usize) -> Look,
        on: &mut dyn FnMut(Piece<'_>),
    ) {
        while !bytes.is_empty() {
            self.make_room();
            let n = bytes.len().min(N - self.end);
            let (now, later) = bytes.split_at(n);
            self.buffer[self.end..self.end + n].copy_from_slice(now);
            self.end += n;
            bytes = later;
            self.mark(at);
            self.read(&grammar, on);
        }
    }

    /// No more will come: what waits for its rest is damaged, if it is not nothing.
    pub fn finish(
        &mut self,
        grammar: impl Fn(&[u8], usize) -> Look,
        on: &mut dyn FnMut(Piece<'_>),
    ) {
        self.read(&grammar, on);
        let mut unfinished = Look::Damaged(1, Fault::Short);
        while self.start < self.end {
            // What is undecided now is no frame; later bytes of it may still begin one that is whole.
            match grammar(&self.buffer[self.start..self.end], 0) {
                Look::More => {
                    self.took(unfinished, on);
                    unfinished = Look::Foreign(1);
                }
                look => self.took(look, on),
            }
        }
    }

    fn read(&mut self, grammar: &impl Fn(&[u8], usize) -> Look, on: &mut dyn FnMut(Piece<'_>)) {
        while self.start < self.end {
            let look = match grammar(&self.buffer[self.start..self.end], self.seen) {
                Look::More if self.end - self.start == N => Look::Damaged(1, Fault::Long),
                Look::More => {
                    self.seen = self.end - self.start;
                    return;
                }
                look => look,
            };
            self.took(look, on);
        }
    }

    fn took(&mut self, look: Look, on: &mut dyn FnMut(Piece<'_>)) {
        let at_hand = self.end - self.start;
        let (n, foreign) = match look {
            Look::More => return,
            Look::Frame(n) => {
                let n = n.min(at_hand);
                let stop = self.start + n;
                if let Some(&(_, at)) = self.marks.iter().find(|(end, _)| *end >= stop) {
                    on(Piece::Frame(at, &self.buffer[self.start..stop]));
                }
                (n, false)
            }
            Look::Damaged(n, fault) => {
                on(Piece::Damaged(fault));
                (n, true)
            }
            Look::Foreign(n) => {
                if !self.in_foreign {
                    on(Piece::Foreign);
                }
                (n, true)
            }
            Look::Blank(n) => (n, false),
        };
        debug_assert!((1..=at_hand).contains(&n), "{look:?} of {at_hand} bytes");
        self.in_foreign = foreign;
        self.start += n.clamp(1, at_hand);
        self.seen = 0;
    }

    /// Remembers that the bytes at hand have come by `at`.
    fn mark(&mut self, at: Monotonic) {
        if self.marks.is_full() {
            let start = self.start;
            self.marks.retain(|(end, _)| *end > start);
        }
        let is_full = self.marks.is_full();
        match self.marks.last_mut() {
            Some(last) if is_full || last.1 == at => last.0 = self.end,
            _ => self.marks.push((self.end, at)),
        }
    }

    /// Moves the bytes at hand to the front when there is no room behind them.
    fn make_room(&mut self) {
        if self.start == self.end {
            self.marks.clear();
            (self.start, self.end) = (0, 0);
        } else if self.end == N {
            let start = self.start;
            self.buffer.copy_within(start..self.end, 0);
            self.marks.retain(|(end, _)| *end > start);
            for (end, _) in &mut self.marks {
                *end -= start;
            }
            (self.start, self.end) = (0, self.end - start);
        }
    }
}

/// What a stream of text lines that begin with `start` and end with their sum begins with. A line ends at a carriage return,
/// a line feed, the next `start`, which may not stand within a line, or with a right sum at the `length` of its kind.
pub(super) fn text_line(bytes: &[u8], seen: usize, start: u8, length: Option<usize>) -> Look {
    if is_line_end(bytes[0]) {
        return Look::Blank(1);
    }
    let bytes = at_most(bytes, LINE_BYTES_MAX);
    if let Some(line) = length.and_then(|n| bytes.get(..n))
        && seen < line.len()
        && sum_is_right(line)
        && !line[1..].iter().any(|b| is_line_end(*b) || *b == start)
    {
        return Look::Frame(line.len());
    }
    let from = seen.max(1);
    let ends = |b: &u8| is_line_end(*b) || *b == start;
    let Some(end) = bytes[from..].iter().position(ends).map(|n| from + n) else {
        return if bytes.len() < LINE_BYTES_MAX {
            Look::More
        } else {
            Look::Damaged(bytes.len(), Fault::Long)
        };
    };
    if bytes[0] != start {
        Look::Damaged(end, Fault::Fragment)
    } else if sum_is_right(&bytes[..end]) {
        Look::Frame(end)
    } else {
        Look::Damaged(end, Fault::Checksum)
    }
}

/// The first of the bytes. A grammar that gives up after so many must not see more: what it says may not depend on how the
/// stream was cut into reads.
pub(super) fn at_most(bytes: &[u8], n: usize) -> &[u8] {
    bytes.get(..n).unwrap_or(bytes)
}

/// The longest line of text, with room for damage: Dynon's and Garmin's engine lines have 223 and 219 characters.
pub(super) const LINE_BYTES_MAX: usize = 256;

pub(super) const fn is_line_end(byte: u8) -> bool {
    matches!(byte, b'\r' | b'\n')
}

/// The number that two hexadecimal digits make.
pub(super) fn hex_byte(digits: &[u8]) -> Option<u8> {
    let digit = |b: u8| char::from(b).to_digit(16);
    match *digits {
        [high, low] => u8::try_from(digit(high)? << 4 | digit(low)?).ok(),
        _ => None,
    }
}

/// The sum of bytes modulo 256.
pub(super) fn sum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, b| sum.wrapping_add(*b))
}

/// Whether a line ends with the sum of all that stands before, as two hexadecimal digits: Dynon's and Garmin's checksum.
pub(super) fn sum_is_right(line: &[u8]) -> bool {
    line.split_last_chunk::<2>()
        .is_some_and(|(body, digits)| hex_byte(digits) == Some(sum(body)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames of this test: `<`, a digit count n, n bytes, `>`. Skips like a binary protocol does.
    fn grammar(bytes: &[u8], _seen: usize) -> Look {
        match bytes {
            [b'<', n @ b'0'..=b'9', rest @ ..] => {
                let n = usize::from(n - b'0');
                match rest.get(n) {
                    None => Look::More,
                    Some(b'>') => Look::Frame(n + 3),
                    Some(_) => Look::Damaged(1, Fault::Checksum),
                }
            }
            [b'<'] => Look::More,
            [b'<', ..] => Look::Damaged(1, Fault::Checksum),
            [b'\n', ..] => Look::Blank(1),
            _ => Look::Foreign(1),
        }
    }

    fn pieces(chunks: &[&[u8]]) -> Vec<String> {
        let mut framer = Framer::<16>::new();
        let mut all = Vec::new();
        let mut on = |piece: Piece<'_>| {
            all.push(match piece {
                Piece::Frame(at, bytes) => {
                    format!("{}@{}", String::from_utf8_lossy(bytes), at.as_nanos())
                }
                Piece::Damaged(fault) => fault.name().to_owned(),
                Piece::Foreign => "foreign".to_owned(),
            });
        };
        for (t, chunk) in chunks.iter().enumerate() {
            let at = Monotonic::from_nanos(t as u64);
            framer.push(at, chunk, grammar, &mut on);
        }
        framer.finish(grammar, &mut on);
        all
    }

    #[test]
    fn a_stream_cut_anywhere_gives_the_same_frames() {
        let stream = b"xx<3abc>\n<0>yy<2<<><9123456789>";
        let whole: Vec<String> = pieces(&[stream])
            .iter()
            .map(|s| s.split('@').next().unwrap_or_default().to_owned())
            .collect();
        assert_eq!(
            whole,
            [
                "foreign",
                "<3abc>",
                "<0>",
                "foreign",
                "<2<<>",
                "<9123456789>"
            ]
        );
        for cut in 0..stream.len() {
            let (a, b) = stream.split_at(cut);
            let cut: Vec<String> = pieces(&[a, b])
                .iter()
                .map(|s| s.split('@').next().unwrap_or_default().to_owned())
                .collect();
            assert_eq!(cut, whole);
        }
        let bytes: Vec<&[u8]> = stream.chunks(1).collect();
        assert_eq!(pieces(&bytes).len(), whole.len());
    }

    #[test]
    fn a_frame_that_waited_behind_damage_is_as_old_as_its_own_last_byte() {
        // The first frame claims nine bytes, of which most are lost; a whole frame follows it at time 1.
        assert_eq!(
            pieces(&[b"<9x", b"<1a>", b"<1b>", b"<1c>"]),
            ["checksum", "<1a>@1", "<1b>@2", "<1c>@3"]
        );
    }

    #[test]
    fn what_never_ends_is_given_up_when_the_buffer_is_full() {
        let endless = |_: &[u8], _: usize| Look::More;
        let mut framer = Framer::<8>::new();
        let mut damaged = 0;
        for _ in 0..100 {
            framer.push(Monotonic::from_nanos(0), b"abc", endless, &mut |_| {
                damaged += 1;
            });
        }
        assert!((290..300).contains(&damaged), "{damaged}");
    }

    #[test]
    fn times_beyond_those_remembered_are_too_old_never_too_young() {
        let mut framer = Framer::<64>::new();
        let long = |bytes: &[u8], _: usize| {
            if bytes.len() < 60 {
                Look::More
            } else {
                Look::Frame(60)
            }
        };
        let mut seen = None;
        for t in 0..60 {
            framer.push(Monotonic::from_nanos(t), b"x", long, &mut |piece| {
                if let Piece::Frame(at, _) = piece {
                    seen = Some(at.as_nanos());
                }
            });
        }
        assert!(seen.is_some_and(|t| t < 60), "{seen:?}");
    }
}
