//! The decoder of any protocol of a byte stream that remembers nothing from one frame to the next.

use super::framing::{Framer, Look, Piece};
use super::{Counters, Decoder};
use crate::signal::{Frame, Sink, SourceId, Wire};

/// What the bytes at hand begin with, see [`Framer`].
type Grammar = fn(&[u8], usize) -> Look;

/// Counts a piece and gives what it says to the sink.
type Reader = fn(Piece<'_>, SourceId, &mut Counters, &mut dyn Sink);

/// Reads frames of at most `N` bytes, each by itself.
#[derive(Debug)]
pub struct StreamDecoder<const N: usize> {
    framer: Framer<N>,
    counters: Counters,
    look: Grammar,
    take: Reader,
}

impl<const N: usize> StreamDecoder<N> {
    /// A decoder that has seen nothing.
    #[must_use]
    pub(super) fn new(look: Grammar, take: Reader) -> Self {
        Self {
            framer: Framer::new(),
            counters: Counters::default(),
            look,
            take,
        }
    }
}

impl<const N: usize> Decoder for StreamDecoder<N> {
    fn push(&mut self, frame: Frame<'_>, sink: &mut dyn Sink) {
        let (Wire::Datagram(bytes) | Wire::Stream(bytes)) = frame.wire else {
            self.counters.ignored += 1;
            return;
        };
        let (counters, take) = (&mut self.counters, self.take);
        self.framer.push(frame.at, bytes, self.look, &mut |piece| {
            take(piece, frame.source, counters, sink);
        });
    }

    fn finish(&mut self) {
        let counters = &mut self.counters;
        self.framer
            .finish(self.look, &mut |piece| counters.count_piece(&piece));
    }

    fn counters(&self) -> &Counters {
        &self.counters
    }
}
