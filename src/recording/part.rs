//! Reads one file of a recording, past whatever is damaged in it.

use super::format::{Beginning, PartHeader, RECORD_MAX, Record, may_begin};
use std::io::{self, Read};

/// What of a recording could not be read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Damage {
    /// Places after which a good record follows.
    pub places: u64,
    /// Bytes at those places.
    pub bytes: u64,
    /// Bytes after the last good record of a file: what a power cut leaves half written.
    pub torn_bytes: u64,
    /// Files whose header is damaged: nothing of them is read.
    pub headers: u64,
}

impl Damage {
    pub(super) fn add(&mut self, other: Self) {
        self.places += other.places;
        self.bytes += other.bytes;
        self.torn_bytes += other.torn_bytes;
        self.headers += other.headers;
    }

    /// One line about it; None where there is none.
    #[must_use]
    pub fn told(&self) -> Option<String> {
        let mut parts = Vec::new();
        if self.places > 0 {
            let (places, bytes) = (self.places, self.bytes);
            parts.push(format!(
                "{places} damaged places with {bytes} bytes were skipped"
            ));
        }
        if self.torn_bytes > 0 {
            let bytes = self.torn_bytes;
            parts.push(format!(
                "{bytes} bytes of an unfinished record at the end were dropped"
            ));
        }
        if self.headers > 0 {
            parts.push(format!(
                "{} files with a damaged header were left out",
                self.headers
            ));
        }
        (!parts.is_empty()).then(|| parts.join("; "))
    }
}

/// Bytes read at once.
const CHUNK: usize = 1 << 16;

/// Records of one file, in the order in which they stand.
#[derive(Debug)]
pub(super) struct Part<R> {
    file: R,
    buffer: Vec<u8>,
    /// Where in the buffer the next record begins.
    next: usize,
    at_end: bool,
    /// Bytes skipped since the last good record.
    skipped: u64,
    damage: Damage,
}

impl<R: Read> Part<R> {
    /// Reads the header. The outer error is the system's.
    pub(super) fn open(mut file: R) -> io::Result<(Beginning, Self)> {
        let mut buffer = Vec::new();
        file.by_ref()
            .take(PartHeader::BYTES_MAX as u64)
            .read_to_end(&mut buffer)?;
        let beginning = PartHeader::read(&buffer);
        let next = match &beginning {
            Beginning::Header(_, bytes) => *bytes,
            _ => buffer.len(),
        };
        let part = Self {
            at_end: buffer.len() < PartHeader::BYTES_MAX,
            file,
            buffer,
            next,
            skipped: 0,
            damage: Damage::default(),
        };
        Ok((beginning, part))
    }

    /// What has been found damaged so far; complete once there is no next record.
    pub(super) const fn damage(&self) -> Damage {
        self.damage
    }

    /// The next good record.
    pub(super) fn next(&mut self) -> io::Result<Option<Record<'_>>> {
        let length = loop {
            self.fill()?;
            let rest = &self.buffer[self.next..];
            if rest.is_empty() {
                self.damage.torn_bytes += std::mem::take(&mut self.skipped);
                return Ok(None);
            }
            if let Some((_, length)) = Record::read(rest) {
                break length;
            }
            // What is no record may hold the beginning of one anywhere.
            let step = (1..rest.len()).find(|&i| may_begin(&rest[i..]));
            let step = step.unwrap_or_else(|| {
                if self.at_end {
                    rest.len()
                } else {
                    rest.len() - 1
                }
            });
            self.next += step;
            self.skipped += step as u64;
        };
        if self.skipped > 0 {
            self.damage.places += 1;
            self.damage.bytes += std::mem::take(&mut self.skipped);
        }
        let start = self.next;
        self.next += length;
        Ok(Record::read(&self.buffer[start..]).map(|(record, _)| record))
    }

    /// Sees to it that a whole record is at hand, unless the file ends.
    fn fill(&mut self) -> io::Result<()> {
        while !self.at_end && self.buffer.len() - self.next < RECORD_MAX {
            self.buffer.drain(..self.next);
            self.next = 0;
            let read = self
                .file
                .by_ref()
                .take(CHUNK as u64)
                .read_to_end(&mut self.buffer)?;
            self.at_end = read < CHUNK;
        }
        Ok(())
    }
}
