//! From a fuzzer's bytes to trials.

use super::Trial;
use glasswing::proto::capture::{CandumpLine, UdpCapture};
use glasswing::signal::CanData;

/// The first byte says how the rest is cut into reads.
pub(crate) fn bytes(trial: &mut Trial, data: &[u8]) {
    let Some((style, bytes)) = data.split_first() else {
        return;
    };
    let mut n = usize::from(*style);
    let cut = |left: usize| match style {
        0 => 1,
        1..=32 => usize::from(*style),
        _ => {
            n = n.wrapping_mul(31) + 7;
            1 + n % left
        }
    };
    trial.bytes(1_000_000_000, bytes, cut);
    trial.finish();
}

/// Records of 16 bytes: milliseconds since the last (2), identifier (4), length, and eight of data.
pub(crate) fn can(trial: &mut Trial, data: &[u8]) {
    let mut ns = 1_000_000_000;
    for record in data.chunks_exact(16) {
        let [ms_low, ms_high, a, b, c, d, len, flags] = record[..8] else {
            return;
        };
        ns += u64::from(u16::from_le_bytes([ms_low, ms_high])) * 1_000_000;
        let id = u32::from_le_bytes([a, b, c, d]);
        let extended = flags & 1 != 0;
        let mut can = CanData {
            id: id & if extended { 0x1FFF_FFFF } else { 0x7FF },
            extended,
            len: len % 9,
            data: [0; 8],
        };
        let n = usize::from(can.len);
        can.data[..n].copy_from_slice(&record[8..8 + n]);
        trial.can(ns, can);
    }
}

/// Every record lies within the file, at most one error ends it, and none begins where another lies.
pub(crate) fn capture(data: &[u8]) {
    let _ = UdpCapture::is_one(data);
    let (mut used, mut errors) = (0, 0);
    for record in UdpCapture::new(data) {
        assert_eq!(errors, 0, "nothing follows an error");
        match record {
            Ok((seconds, payload)) => {
                assert!((0.0..1e10).contains(&seconds), "{seconds}");
                used += 12 + payload.len();
            }
            Err(error) => {
                assert!(!error.to_string().is_empty(), "an error says something");
                errors += 1;
            }
        }
    }
    assert!(used <= data.len(), "no byte twice");
    assert!(errors == 1 || used == data.len(), "all of it or an error");
}

/// A line that is read says again what it said.
pub(crate) fn candump(data: &[u8]) {
    for line in String::from_utf8_lossy(data).lines() {
        let CandumpLine::Data(seconds, can) = CandumpLine::parse(line) else {
            continue;
        };
        assert!((0.0..1e10).contains(&seconds) && can.len <= 8, "{line:?}");
        assert!(
            can.id < if can.extended { 1 << 29 } else { 1 << 11 },
            "{line:?}"
        );
        let digits: String = can.bytes().iter().map(|b| format!("{b:02X}")).collect();
        let width = if can.extended { 8 } else { 3 };
        let again = format!("({seconds:.9}) can0 {:0width$X}#{digits}", can.id);
        let CandumpLine::Data(_, same) = CandumpLine::parse(&again) else {
            panic!("{again:?} of {line:?}");
        };
        assert_eq!(same, can, "{line:?}");
    }
}
