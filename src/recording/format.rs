//! Bytes of headers and records, both ways. Pure.

use crate::limits::{DATAGRAM_BYTES_MAX, SERIAL_CHUNK_BYTES_MAX};
use crate::signal::{CanData, Wire};
use crate::time::Monotonic;
use crc::{CRC_32_ISO_HDLC, Crc, Table};
use serde::{Deserialize, Serialize};

/// What every file begins with.
pub const MAGIC: [u8; 8] = *b"GLASSREC";

/// The version that is written.
pub(super) const VERSION: u16 = 1;

const CRC: Crc<u32, Table<16>> = Crc::<u32, Table<16>>::new(&CRC_32_ISO_HDLC);

/// Bytes of a header before its text.
const HEADER_FIXED: usize = 28;
/// The longest text that a header may have.
const TEXT_MAX: usize = 1 << 20;
/// Bytes of a checksum.
const CHECKSUM: usize = 4;

/// What every record begins with.
const MARKER: [u8; 2] = *b"GR";
/// Bytes of a record before its payload.
const RECORD_FIXED: usize = 16;
/// The longest payload.
pub(super) const PAYLOAD_MAX: usize = 4096;
/// The longest record.
pub(super) const RECORD_MAX: usize = RECORD_FIXED + PAYLOAD_MAX + CHECKSUM;
/// The source of a record that has none.
pub(super) const NO_SOURCE: u8 = u8::MAX;

const _: () = assert!(
    SERIAL_CHUNK_BYTES_MAX <= PAYLOAD_MAX && DATAGRAM_BYTES_MAX <= PAYLOAD_MAX,
    "whatever is received at once fits a record"
);

/// Marks a 29-bit identifier.
const EXTENDED: u32 = 0x8000_0000;

/// What a recording says of itself.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// What wrote it: name and version.
    pub program: String,
    /// What was listened to, the most trusted first.
    pub sources: Vec<Source>,
}

/// A source as a recording names it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Source {
    /// Its name.
    pub name: String,
    /// What it speaks, as in board files.
    pub protocol: String,
    /// `udp`, `can` or `serial`.
    pub bus: String,
    /// Address, interface or path.
    pub at: String,
    /// Bits per second of a serial port.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baud: Option<u32>,
    /// For fg-generic: how its lines are laid out, where it is not as in the file that comes with this program.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub layout: Option<String>,
    /// The source under which its frames stand, where it is not its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frames_of: Option<u8>,
}

/// A header with its place in the set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct PartHeader {
    pub(super) number: u32,
    pub(super) session: u64,
    pub(super) header: Header,
}

/// What stands at the beginning of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Beginning {
    /// A header of so many bytes.
    Header(PartHeader, usize),
    /// Of a version that is not known.
    Version(u16),
    /// No header, or no whole one.
    Damaged,
}

impl PartHeader {
    pub(super) fn bytes(&self) -> Vec<u8> {
        // A header is texts and small numbers: it always becomes JSON.
        let text = serde_json::to_vec(&self.header).unwrap_or_default();
        let mut bytes = Vec::with_capacity(HEADER_FIXED + text.len() + CHECKSUM);
        bytes.extend(MAGIC);
        bytes.extend(VERSION.to_le_bytes());
        bytes.extend([0; 2]);
        bytes.extend(self.number.to_le_bytes());
        bytes.extend(self.session.to_le_bytes());
        bytes.extend(u32::try_from(text.len()).unwrap_or(u32::MAX).to_le_bytes());
        bytes.extend(text);
        let sum = CRC.checksum(&bytes);
        bytes.extend(sum.to_le_bytes());
        bytes
    }

    /// The most bytes that are needed to read a header.
    pub(super) const BYTES_MAX: usize = HEADER_FIXED + TEXT_MAX + CHECKSUM;

    /// Reads what a file begins with.
    pub(super) fn read(bytes: &[u8]) -> Beginning {
        Self::parse(bytes).unwrap_or(Beginning::Damaged)
    }

    fn parse(bytes: &[u8]) -> Option<Beginning> {
        let mut rest = bytes.strip_prefix(&MAGIC)?;
        let version = u16::from_le_bytes(take(&mut rest)?);
        if version != VERSION {
            return Some(Beginning::Version(version));
        }
        let _reserved: [u8; 2] = take(&mut rest)?;
        let number = u32::from_le_bytes(take(&mut rest)?);
        let session = u64::from_le_bytes(take(&mut rest)?);
        let length = usize::try_from(u32::from_le_bytes(take(&mut rest)?)).ok()?;
        let end = HEADER_FIXED + length;
        let (text, sum) = (rest.get(..length)?, bytes.get(end..end + CHECKSUM)?);
        if length > TEXT_MAX || sum != CRC.checksum(&bytes[..end]).to_le_bytes() {
            return None;
        }
        let header = serde_json::from_slice(text).ok()?;
        let header = Self {
            number,
            session,
            header,
        };
        Some(Beginning::Header(header, end + CHECKSUM))
    }
}

fn take<const N: usize>(bytes: &mut &[u8]) -> Option<[u8; N]> {
    let (first, rest) = bytes.split_first_chunk()?;
    *bytes = rest;
    Some(*first)
}

/// What a record is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Kind {
    Can = 1,
    Datagram = 2,
    Stream = 3,
    Lost = 4,
    Mark = 5,
}

impl Kind {
    pub(super) const fn of(byte: u8) -> Option<Self> {
        match byte {
            1 => Some(Self::Can),
            2 => Some(Self::Datagram),
            3 => Some(Self::Stream),
            4 => Some(Self::Lost),
            5 => Some(Self::Mark),
            _ => None,
        }
    }
}

/// A record's own parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Record<'a> {
    pub(super) kind: Kind,
    pub(super) source: u8,
    pub(super) at: Monotonic,
    pub(super) payload: &'a [u8],
}

impl Record<'_> {
    /// Appends it to `bytes`.
    pub(super) fn append(&self, bytes: &mut Vec<u8>) {
        let start = bytes.len();
        bytes.extend(MARKER);
        bytes.extend([self.kind as u8, self.source]);
        // A payload is at most PAYLOAD_MAX.
        bytes.extend(u32::try_from(self.payload.len()).unwrap_or(0).to_le_bytes());
        bytes.extend(self.at.as_nanos().to_le_bytes());
        bytes.extend(self.payload);
        let sum = CRC.checksum(&bytes[start..]);
        bytes.extend(sum.to_le_bytes());
    }
}

impl<'a> Record<'a> {
    /// The record that `bytes` begin with, and its length; None where they begin with none, or no whole one.
    pub(super) fn read(bytes: &'a [u8]) -> Option<(Self, usize)> {
        let mut rest = bytes.strip_prefix(&MARKER)?;
        let [kind, source] = take(&mut rest)?;
        let length = usize::try_from(u32::from_le_bytes(take(&mut rest)?)).ok()?;
        let at = Monotonic::from_nanos(u64::from_le_bytes(take(&mut rest)?));
        if length > PAYLOAD_MAX {
            return None;
        }
        let (payload, end) = (rest.get(..length)?, RECORD_FIXED + length);
        let record = Self {
            kind: Kind::of(kind)?,
            source,
            at,
            payload,
        };
        let sum = bytes.get(end..end + CHECKSUM)?;
        (sum == CRC.checksum(&bytes[..end]).to_le_bytes()).then_some((record, end + CHECKSUM))
    }

    /// What was on the wire; None for records that are no frames, and for a CAN frame that is none.
    pub(super) fn wire(&self) -> Option<Wire<'a>> {
        match self.kind {
            Kind::Can => can(self.payload).map(Wire::Can),
            Kind::Datagram => Some(Wire::Datagram(self.payload)),
            Kind::Stream => Some(Wire::Stream(self.payload)),
            Kind::Lost | Kind::Mark => None,
        }
    }
}

/// Whether `bytes` begin as a record does.
pub(super) fn may_begin(bytes: &[u8]) -> bool {
    bytes.starts_with(&MARKER)
}

fn can(mut payload: &[u8]) -> Option<CanData> {
    let word = u32::from_le_bytes(take(&mut payload)?);
    let mut data = [0; 8];
    data.get_mut(..payload.len())?.copy_from_slice(payload);
    Some(CanData {
        id: word & !EXTENDED,
        extended: word & EXTENDED != 0,
        len: u8::try_from(payload.len()).ok()?,
        data,
    })
}

/// A CAN frame's payload, and how much of it is used.
pub(super) fn can_payload(can: &CanData) -> ([u8; 12], usize) {
    let word = can.id | if can.extended { EXTENDED } else { 0 };
    let mut payload = [0; 12];
    payload[..4].copy_from_slice(&word.to_le_bytes());
    payload[4..].copy_from_slice(&can.data);
    (payload, 4 + can.bytes().len())
}
