//! Recordings of buses: raw frames with their times of receipt, in files that only grow.
//!
//! A recording is one file, or, with a limit of size, a set of them: `flight.gwr` is written to; once it is full it becomes
//! `flight.gwr.000001`, the next one `flight.gwr.000002`, and the oldest are removed, so that the newest stay. Numbers go on
//! from one start of the program to the next. [`Tape`] reads the set as one.
//!
//! Bus threads give what they hear to a [`Tap`], a ring that is never waited for; what does not fit it is dropped and
//! counted, in the recording too. One thread ([`Recorder`]) empties the rings ten times a second and asks the system at
//! least twice a second to put everything on the disk: a power cut costs at most a second. Whatever the cut leaves half
//! written is recognised by its checksum and dropped; so is damage anywhere else, and reading goes on at the next good
//! record.
//!
//! # Layout of a file, version 1
//!
//! All numbers are little-endian. Checksums are CRC-32 as in zlib (polynomial 0x04C11DB7 reflected, initial value and final
//! exclusive-or 0xFFFFFFFF; of "123456789" it is 0xCBF43926).
//!
//! A file begins with a header:
//!
//! | at | bytes | what |
//! |---|---|---|
//! | 0 | 8 | `GLASSREC` |
//! | 8 | 2 | version, 1 |
//! | 10 | 2 | zero |
//! | 12 | 4 | number of the file in its set, from 1 |
//! | 16 | 8 | session: a random number. Files with the same one have the same clock in their records |
//! | 24 | 4 | length n of the text, at most 1 MiB |
//! | 28 | n | the sources as UTF-8 JSON, see below |
//! | 28+n | 4 | checksum of everything before |
//!
//! Records follow it without gaps:
//!
//! | at | bytes | what |
//! |---|---|---|
//! | 0 | 2 | `GR` |
//! | 2 | 1 | kind: 1 to 5 |
//! | 3 | 1 | source: its index in the header; 255 where there is none |
//! | 4 | 4 | length n of the payload, at most 4096 |
//! | 8 | 8 | time: `CLOCK_MONOTONIC` in nanoseconds, of receipt for frames |
//! | 16 | n | payload |
//! | 16+n | 4 | checksum of everything before, from `GR` |
//!
//! | kind | payload |
//! |---|---|
//! | 1, CAN frame | identifier (4 bytes; bit 31: it has 29 bits), then 0 to 8 bytes of data |
//! | 2, datagram | the datagram |
//! | 3, stream | bytes of a serial line as they came together; none at all: the line was interrupted here |
//! | 4, lost | how many frames of the source were dropped up to this time since the last such record (8 bytes) |
//! | 5, mark | nothing. Every frame received before this time stands above, but for a straggler |
//!
//! Records of one source stand in the order of their times; those of different sources need not, but are in order between
//! marks: a reader sorts what stands above a mark. There is a mark ten times a second while frames come, else every second.
//!
//! The header's text is an object: `program` (what wrote it) and `sources`, each with `name`, `protocol` (as in board files),
//! `bus` (`udp`, `can` or `serial`), `at` (address, interface or path), `baud` (serial only), `layout` (fg-generic with a
//! protocol file of its own: its text), and `frames_of`: where another source listens to the same CAN bus, the index of the
//! source under which the frames of both stand.
//!
//! Files are this module's hazard: it makes, appends to, renames and removes those of the recording that it was given, and
//! no other.

mod error;
mod format;
mod part;
mod recorder;
mod set;
mod tap;
mod tape;

pub use error::RecordingError;
pub use format::{Header, MAGIC, Source};
pub use part::Damage;
pub use recorder::{Plan, Recorder, Report, SIZE_LIMIT_MIN};
pub use tap::Tap;
pub use tape::{Entry, Event, Tape, Timed};

#[cfg(test)]
mod tests;
