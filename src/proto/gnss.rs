//! The stream of a satellite receiver: NMEA sentences, UBX and RTCM 3 frames, mixed and cut as they come.
//!
//! Sources: NMEA 0183 (`$` or `!`, printable characters, `*` and the exclusive or of all between as two hexadecimal digits);
//! u-blox, "Interface Description", UBX frame structure (`B5 62`, class, id, length, payload, 8-bit Fletcher sum, RFC 1145);
//! RTCM 10403 (`D3`, six zero bits, ten bits of length, payload, CRC-24Q). All three are recognised by their checksums, so
//! that a dollar sign within a binary frame begins no sentence.

use super::Fault;
use super::framing::{Look, at_most, hex_byte, is_line_end};
use crc::{CRC_24_LTE_A, Crc};

/// CRC-24Q: the parameters of 3GPP's CRC-24A are the same.
const CRC_24Q: Crc<u32> = Crc::<u32>::new(&CRC_24_LTE_A);

/// The longest frame that is taken: UBX frames of receivers in use are below 3 kB.
pub(super) const FRAME_BYTES_MAX: usize = 4096;

/// The longest sentence: NMEA allows 82 characters, proprietary ones have up to about 160.
const SENTENCE_BYTES_MAX: usize = 256;

/// Bytes of a UBX frame beside its payload.
const UBX_OVERHEAD_BYTES: usize = 8;

/// Whose frames are one's own: damage to the others' is not one's business.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Own {
    Nmea,
    Ubx,
}

/// What kind of frame these bytes are, by their first.
pub(super) fn is_sentence(frame: &[u8]) -> bool {
    matches!(frame.first(), Some(b'$' | b'!'))
}

/// See above.
pub(super) fn is_ubx(frame: &[u8]) -> bool {
    frame.starts_with(&[0xB5, 0x62])
}

pub(super) fn look(own: Own, bytes: &[u8], seen: usize) -> Look {
    let (look, of) = match bytes {
        [b'$' | b'!'] | [0xB5] | [0xD3] => return Look::More,
        [b'$' | b'!', b'A'..=b'Z', ..] => (sentence(bytes, seen), Own::Nmea),
        [0xB5, 0x62, ..] => (ubx(bytes), Own::Ubx),
        [0xD3, 0..=3, ..] => return rtcm(bytes),
        [b'\r' | b'\n', ..] => return Look::Blank(1),
        _ => {
            let may_begin = |b: &u8| matches!(b, b'$' | b'!' | 0xB5 | 0xD3) || is_line_end(*b);
            let next = bytes[1..].iter().position(may_begin);
            return Look::Foreign(next.map_or(bytes.len(), |n| n + 1));
        }
    };
    match look {
        Look::Damaged(n, _) if of != own => Look::Foreign(n),
        look => look,
    }
}

fn sentence(bytes: &[u8], seen: usize) -> Look {
    let bytes = at_most(bytes, SENTENCE_BYTES_MAX);
    let undecided = if bytes.len() < SENTENCE_BYTES_MAX {
        Look::More
    } else {
        Look::Damaged(bytes.len(), Fault::Long)
    };
    let from = seen.max(2);
    let from = if bytes[1..from.min(bytes.len())].contains(&b'*') {
        1
    } else {
        from
    };
    let ends = |b: &u8| matches!(b, b'*' | b'$') || !matches!(b, b' '..=b'~');
    let Some(end) = bytes.iter().skip(from).position(ends).map(|n| from + n) else {
        return undecided;
    };
    if bytes[end] != b'*' {
        // Levil's and Stratux's attitude comes without a checksum; its decoder marks it.
        return if is_line_end(bytes[end]) && bytes.starts_with(b"$RPYL,") {
            Look::Frame(end)
        } else if is_line_end(bytes[end]) {
            Look::Damaged(end, Fault::Unchecked)
        } else {
            Look::Damaged(end, Fault::Short)
        };
    }
    let Some(digits) = bytes.get(end + 1..end + 3) else {
        return undecided;
    };
    let sum = bytes[1..end].iter().fold(0, |sum, b| sum ^ b);
    match hex_byte(digits) {
        Some(sent) if sent == sum => Look::Frame(end + 3),
        Some(_) => Look::Damaged(end + 3, Fault::Checksum),
        None => Look::Damaged(end + 1, Fault::Short),
    }
}

fn ubx(bytes: &[u8]) -> Look {
    let Some(&[class, id, low, high]) = bytes.get(2..6) else {
        return Look::More;
    };
    let payload = usize::from(u16::from_le_bytes([low, high]));
    // A damaged length must not hold up what follows: where it is known, only the right ones are waited for.
    let possible = match (class, id) {
        (0x01, 0x07) => matches!(payload, 84 | 92),
        _ => payload <= FRAME_BYTES_MAX - UBX_OVERHEAD_BYTES,
    };
    let total = payload + UBX_OVERHEAD_BYTES;
    match bytes.get(2..total) {
        _ if !possible => Look::Damaged(2, Fault::Long),
        None => Look::More,
        Some(body) => {
            let (content, sums) = body.split_at(payload + 4);
            let (mut a, mut b) = (0_u8, 0_u8);
            for byte in content {
                a = a.wrapping_add(*byte);
                b = b.wrapping_add(a);
            }
            if sums == [a, b] {
                Look::Frame(total)
            } else {
                Look::Damaged(2, Fault::Checksum)
            }
        }
    }
}

fn rtcm(bytes: &[u8]) -> Look {
    let Some(&low) = bytes.get(2) else {
        return Look::More;
    };
    let total = usize::from(bytes[1] & 3) * 256 + usize::from(low) + 6;
    match bytes.get(..total) {
        None => Look::More,
        Some(frame) => {
            let (body, sent) = frame.split_at(total - 3);
            let sent = u32::from_be_bytes([0, sent[0], sent[1], sent[2]]);
            if CRC_24Q.checksum(body) == sent {
                Look::Frame(total)
            } else {
                Look::Foreign(1)
            }
        }
    }
}
