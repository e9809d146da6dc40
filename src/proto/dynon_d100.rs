//! Dynon EFIS-D10, D10A and D100's serial data: 51 characters a line with fields of fixed width, about 64 lines a second.
//!
//! Source: Dynon Avionics, "EFIS-D100 Pilot's User Guide", appendix A "EFIS serial data output". The last two characters
//! before the line end are the sum of the 49 before them, modulo 256, in hexadecimal. Nothing marks a line's beginning.
//! Sentinels: none; the instrument sends numbers or nothing.
//!
//! Bit 0 of the status says what two of the fields are: 0 displayed (baro-corrected) altitude and turn rate, 1 pressure
//! altitude and vertical speed in tenths of feet a second. Airspeed is in tenths of metres a second, altitude in metres.
//! Lateral acceleration is positive to the left, and is turned round here. The heading is magnetic. The time is the
//! instrument's own clock, which nothing sets: it is not read.

use super::emit::{Columns, Emit, compass, feet, same};
use super::framing::{LINE_BYTES_MAX, Look, Piece, at_most, hex_byte, is_line_end, sum_is_right};
use super::stream::StreamDecoder;
use super::{Counters, Fault};
use crate::signal::{Parameter, Sink, SourceId};

/// Length of a line without its end.
const LINE_BYTES: usize = 51;

/// No sentinel: a character that no field has.
const ABSENT: u8 = 0;

/// A decoder that has seen nothing.
#[must_use]
pub fn decoder() -> StreamDecoder<{ LINE_BYTES_MAX + 1 }> {
    StreamDecoder::new(look, take)
}

pub(super) fn look(bytes: &[u8], seen: usize) -> Look {
    if is_line_end(bytes[0]) {
        return Look::Blank(1);
    }
    let bytes = at_most(bytes, LINE_BYTES_MAX);
    let is_right = |line: &[u8]| line.len() == LINE_BYTES && sum_is_right(line);
    let whole = bytes.get(..LINE_BYTES).filter(|_| seen < LINE_BYTES);
    if whole.is_some_and(|line| is_right(line) && !line.iter().any(|b| is_line_end(*b))) {
        return Look::Frame(LINE_BYTES);
    }
    let Some(end) = bytes[seen..].iter().position(|b| is_line_end(*b)) else {
        return if bytes.len() < LINE_BYTES_MAX {
            Look::More
        } else {
            Look::Damaged(bytes.len(), Fault::Long)
        };
    };
    let end = seen + end;
    match end.checked_sub(LINE_BYTES) {
        None => Look::Damaged(end, Fault::Short),
        Some(0) => Look::Damaged(end, Fault::Checksum),
        // A fragment without its end may stand before a whole line.
        Some(before) if is_right(&bytes[before..end]) => Look::Damaged(before, Fault::Fragment),
        Some(_) => Look::Damaged(end, Fault::Long),
    }
}

fn take(piece: Piece<'_>, source: SourceId, counters: &mut Counters, sink: &mut dyn Sink) {
    let Piece::Frame(at, line) = piece else {
        counters.count_piece(&piece);
        return;
    };
    let Some(status) = hex_byte(&line[45..47]) else {
        counters.count(Some(Fault::Type));
        return;
    };
    counters.count(None);
    let mut out = Emit::new(at, source, &mut counters.flow, sink);
    let mut f = Columns {
        line,
        filler: ABSENT,
        out: &mut out,
    };
    f.put(Parameter::Pitch, (8, 4), 0.1, f64::to_radians);
    f.put(Parameter::Roll, (12, 5), 0.1, f64::to_radians);
    f.put(Parameter::HeadingMagnetic, (17, 3), 1.0, compass);
    f.put(Parameter::IndicatedAirspeed, (20, 4), 0.1, same);
    if status & 1 == 0 {
        f.put(Parameter::BaroAltitude, (24, 5), 1.0, same);
        f.put(Parameter::TurnRate, (29, 4), 0.1, f64::to_radians);
    } else {
        f.put(Parameter::PressureAltitude, (24, 5), 1.0, same);
        f.put(Parameter::VerticalSpeed, (29, 4), 0.1, feet);
    }
    f.put(Parameter::LateralAcceleration, (33, 3), -0.01, same);
    f.put(Parameter::NormalAcceleration, (36, 3), 0.1, same);
    f.put(Parameter::AngleOfAttackUsed, (39, 2), 1.0, same);
}
