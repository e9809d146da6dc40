//! Readers of recorded bus traffic: UDP capture containers and candump logs. Pure: bytes and lines in, frames out.
//!
//! - A UDP capture container is a sequence of `[f64 LE seconds][u32 LE length][payload]`, as written by
//!   `jsbsim_capture.py` and similar scripts.
//! - A candump log is what `candump -l` of can-utils writes (its `log2asc.c` documents the form):
//!   `(SECONDS.MICROSECONDS) INTERFACE ID#DATA`, identifiers of three hex digits being 11-bit and of eight 29-bit. Lines
//!   that begin with `#` and blank lines are comments.

use crate::signal::CanData;

/// Bytes before each payload of a container.
const RECORD_HEADER_BYTES: usize = 12;

/// The longest payload that a UDP datagram can have over IPv4 (RFC 768, RFC 791): 65535 less both headers.
const PAYLOAD_BYTES_MAX: usize = 65_507;

/// Why a container cannot be read on. What came before stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CaptureError {
    /// The file ends inside a record.
    #[error(
        "record {record} at byte {offset} is cut short: {present} of {expected} bytes are there"
    )]
    Truncated {
        /// Number of the record, from 0.
        record: usize,
        /// Where it begins.
        offset: usize,
        /// Bytes that it should have, as far as its header is there to tell.
        expected: usize,
        /// Bytes that the file still has.
        present: usize,
    },
    /// The record's header cannot be one: an impossible length or time.
    #[error("record {record} at byte {offset} is no record of a UDP capture: {what}")]
    NotARecord {
        /// Number of the record, from 0.
        record: usize,
        /// Where it begins.
        offset: usize,
        /// What is impossible about it.
        what: &'static str,
    },
}

/// Reads a UDP capture container: an iterator over (seconds, payload) that ends after the first error.
#[derive(Debug)]
pub struct UdpCapture<'a> {
    bytes: &'a [u8],
    offset: usize,
    record: usize,
}

impl<'a> UdpCapture<'a> {
    /// Over a whole file's bytes.
    #[must_use]
    pub const fn new(bytes: &'a [u8]) -> Self {
        Self {
            bytes,
            offset: 0,
            record: 0,
        }
    }

    /// Whether a file is such a container rather than a raw capture: its first record is whole, with a plausible time, and
    /// what follows is another or the end. Text and binary streams read as a record have an absurd time or length.
    #[must_use]
    pub fn is_one(bytes: &'a [u8]) -> bool {
        let mut records = Self::new(bytes);
        let plausible = |seconds: f64| seconds == 0.0 || seconds > 1e-9;
        let first = matches!(records.next(), Some(Ok((seconds, _))) if plausible(seconds));
        first && !matches!(records.next(), Some(Err(CaptureError::NotARecord { .. })))
    }

    fn record(&self) -> Result<(f64, &'a [u8]), CaptureError> {
        let rest = &self.bytes[self.offset..];
        let truncated = |expected| CaptureError::Truncated {
            record: self.record,
            offset: self.offset,
            expected,
            present: rest.len(),
        };
        let not_a_record = |what| CaptureError::NotARecord {
            record: self.record,
            offset: self.offset,
            what,
        };
        let Some((header, payload)) = rest.split_first_chunk::<RECORD_HEADER_BYTES>() else {
            return Err(truncated(RECORD_HEADER_BYTES));
        };
        let [a, b, c, d, e, f, g, h, length @ ..] = *header;
        let seconds = f64::from_le_bytes([a, b, c, d, e, f, g, h]);
        if !(0.0..1e10).contains(&seconds) {
            return Err(not_a_record("its time is not a number of seconds"));
        }
        let length = usize::try_from(u32::from_le_bytes(length)).unwrap_or(usize::MAX);
        if length > PAYLOAD_BYTES_MAX {
            return Err(not_a_record("it is longer than a datagram can be"));
        }
        payload
            .get(..length)
            .map(|payload| (seconds, payload))
            .ok_or_else(|| truncated(RECORD_HEADER_BYTES + length))
    }
}

impl<'a> Iterator for UdpCapture<'a> {
    type Item = Result<(f64, &'a [u8]), CaptureError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.offset >= self.bytes.len() {
            return None;
        }
        let record = self.record();
        match &record {
            Ok((_, payload)) => {
                self.offset += RECORD_HEADER_BYTES + payload.len();
                self.record += 1;
            }
            Err(_) => self.offset = self.bytes.len(),
        }
        Some(record)
    }
}

/// One line of a candump log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CandumpLine {
    /// A comment or nothing.
    Blank,
    /// A data frame and its time in seconds.
    Data(f64, CanData),
    /// A frame without data for us: a remote request, an error frame or a CAN FD frame.
    NoData,
    /// No line of a candump log.
    Malformed,
}

impl CandumpLine {
    /// Reads one line, with or without its line end.
    #[must_use]
    pub fn parse(line: &str) -> Self {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            return Self::Blank;
        }
        Self::parse_frame(line).unwrap_or(Self::Malformed)
    }

    fn parse_frame(line: &str) -> Option<Self> {
        let mut words = line.split_ascii_whitespace();
        let time = words.next()?.strip_prefix('(')?.strip_suffix(')')?;
        let seconds: f64 = time
            .parse()
            .ok()
            .filter(|s: &f64| (0.0..1e10).contains(s))?;
        let _interface = words.next()?;
        let (id, data) = words.next()?.split_once('#')?;
        let extended = match id.len() {
            3 => false,
            8 => true,
            _ => return None,
        };
        let id = hex(id)?;
        if data.starts_with('#') || data.starts_with('R') {
            return Some(Self::NoData);
        }
        // The identifier's upper three bits are flags; with the error flag it is a message of the controller.
        if extended && id > 0x1FFF_FFFF {
            return Some(Self::NoData);
        }
        if !extended && id > 0x7FF {
            return None;
        }
        let mut can = CanData {
            id,
            extended,
            len: 0,
            data: [0; 8],
        };
        if !data.is_ascii() || data.len() % 2 != 0 || data.len() > 2 * can.data.len() {
            return None;
        }
        for (byte, digits) in can.data.iter_mut().zip(data.as_bytes().chunks_exact(2)) {
            *byte = u8::try_from(hex(std::str::from_utf8(digits).ok()?)?).ok()?;
            can.len += 1;
        }
        Some(Self::Data(seconds, can))
    }
}

/// Hexadecimal digits only: no sign, no prefix.
fn hex(digits: &str) -> Option<u32> {
    if !digits.bytes().all(|b| b.is_ascii_hexdigit()) {
        return None;
    }
    u32::from_str_radix(digits, 16).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn container(records: &[(f64, &[u8])]) -> Vec<u8> {
        let mut bytes = Vec::new();
        for (seconds, payload) in records {
            bytes.extend(seconds.to_le_bytes());
            bytes.extend(u32::try_from(payload.len()).unwrap().to_le_bytes());
            bytes.extend(*payload);
        }
        bytes
    }

    #[test]
    fn a_container_cut_anywhere_gives_its_whole_records_and_one_named_error() {
        let whole = container(&[(0.0, b"abc"), (0.25, b""), (1.5, b"defgh")]);
        let ends = [15, 27, 44];
        for cut in 0..=whole.len() {
            let records: Vec<_> = UdpCapture::new(&whole[..cut]).collect();
            let good = records.iter().filter(|r| r.is_ok()).count();
            assert_eq!(
                good,
                ends.iter().filter(|&&end| end <= cut).count(),
                "cut at {cut}"
            );
            let at_a_boundary = cut == 0 || ends.contains(&cut);
            let errors = records.len() - good;
            assert_eq!(errors, usize::from(!at_a_boundary), "cut at {cut}");
        }
    }

    #[test]
    fn what_is_no_container_is_named() {
        let mut bytes = container(&[(0.0, b"abc"), (f64::NAN, b"abc")]);
        let last = UdpCapture::new(&bytes).last();
        assert!(
            matches!(
                last,
                Some(Err(CaptureError::NotARecord {
                    record: 1,
                    offset: 15,
                    ..
                }))
            ),
            "{last:?}"
        );
        bytes[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
        let first = UdpCapture::new(&bytes).next();
        assert!(
            matches!(first, Some(Err(CaptureError::NotARecord { record: 0, .. }))),
            "{first:?}"
        );
    }

    #[test]
    fn candump_lines_are_read_or_refused() {
        let CandumpLine::Data(seconds, can) =
            CandumpLine::parse("(12.500000) can0 137#0102000740A66666\n")
        else {
            panic!("a data frame");
        };
        assert_eq!(
            (seconds, can.id, can.extended, can.len),
            (12.5, 0x137, false, 8)
        );
        assert_eq!(can.data, [1, 2, 0, 7, 0x40, 0xA6, 0x66, 0x66]);
        let CandumpLine::Data(_, can) = CandumpLine::parse("(0.0) vcan0 09F80102#36 R") else {
            panic!("a 29-bit frame, received");
        };
        assert_eq!(
            (can.id, can.extended, can.bytes()),
            (0x09F8_0102, true, &[0x36][..])
        );
        for (line, expected) in [
            ("", CandumpLine::Blank),
            ("# Name: a bus", CandumpLine::Blank),
            ("(0.0) can0 123#R", CandumpLine::NoData),
            ("(0.0) can0 123##1AABB", CandumpLine::NoData),
            ("(0.0) can0 20000040#0000000000000000", CandumpLine::NoData),
            ("(0.0) can0 123#1", CandumpLine::Malformed),
            ("(0.0) can0 123#+1", CandumpLine::Malformed),
            ("(0.0) can0 123#001122334455667788", CandumpLine::Malformed),
            ("(0.0) can0 FFF#00", CandumpLine::Malformed),
            ("(nan) can0 123#00", CandumpLine::Malformed),
            ("(0.0) can0", CandumpLine::Malformed),
            ("0.0 can0 123#00", CandumpLine::Malformed),
        ] {
            assert_eq!(CandumpLine::parse(line), expected, "{line:?}");
        }
    }
}
