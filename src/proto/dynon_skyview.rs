//! Dynon SkyView's serial data: lines of text with fields of fixed width, a checksum at the end of each.
//!
//! Source: Dynon Avionics, "SkyView System Installation Guide", appendix "Serial Data Output" (revisions J to AA, and HDX
//! revision E): ADAHRS data `!1` version 1, SYSTEM data `!2` version 2, EMS data `!3` version 2.
//!
//! The last two characters before the line end are the sum of all before them, modulo 256, in hexadecimal. A field that the
//! sender has no value for is filled with `X`, its time with `-`: absent. The manual counts positions from 1, this file from 0.
//!
//! Signs: pitch up, roll right, turn right, climb are positive; lateral acceleration is positive to the left, and is turned
//! round here. Headings and wind are magnetic. The 1/16 s counter of the time does not run with its seconds and is not
//! used. Thermocouples and general-purpose inputs mean what the aircraft's builder has wired to them and are not read; nor is
//! the current, whose scale the pages at hand do not give, nor the second fuel flow, which may be a return line.

use super::emit::{Columns, Emit, celsius, compass, feet, fpm, inches_of_mercury, knots, same};
use super::framing::{LINE_BYTES_MAX, Look, Piece, text_line};
use super::stream::StreamDecoder;
use super::{Counters, Fault};
use crate::signal::{BUS_VOLTAGE, FUEL_QUANTITY, Parameter, Sink, SourceId, engines};
use crate::units::{HECTOPASCALS_PER_PSI, LITRES_PER_US_GALLON};

/// Lengths of the lines without their ends.
const ADAHRS_BYTES: usize = 72;
const SYSTEM_BYTES: usize = 91;
const EMS_BYTES: usize = 223;

/// The sender's sign of "no value".
const ABSENT: u8 = b'X';

/// A decoder that has seen nothing.
#[must_use]
pub fn decoder() -> StreamDecoder<{ LINE_BYTES_MAX + 1 }> {
    StreamDecoder::new(look, take)
}

pub(super) fn look(bytes: &[u8], seen: usize) -> Look {
    let length = match bytes {
        [b'!', b'1', ..] => Some(ADAHRS_BYTES),
        [b'!', b'2', ..] => Some(SYSTEM_BYTES),
        [b'!', b'3', ..] => Some(EMS_BYTES),
        _ => None,
    };
    text_line(bytes, seen, b'!', length)
}

/// Whether a line with a right sum is of a kind and length that this decoder knows.
pub(super) fn is_known(line: &[u8]) -> bool {
    matches!(
        (line.get(1), line.len()),
        (Some(b'1'), ADAHRS_BYTES) | (Some(b'2'), SYSTEM_BYTES) | (Some(b'3'), EMS_BYTES)
    )
}

fn take(piece: Piece<'_>, source: SourceId, counters: &mut Counters, sink: &mut dyn Sink) {
    let Piece::Frame(at, line) = piece else {
        counters.count_piece(&piece);
        return;
    };
    let (length, version) = match line.get(1) {
        Some(b'1') => (ADAHRS_BYTES, b'1'),
        Some(b'2') => (SYSTEM_BYTES, b'2'),
        Some(b'3') => (EMS_BYTES, b'2'),
        // A kind of line that this decoder has no use for.
        _ => (line.len(), 0),
    };
    let fault = match line.len().cmp(&length) {
        std::cmp::Ordering::Less => Some(Fault::Short),
        std::cmp::Ordering::Greater => Some(Fault::Long),
        std::cmp::Ordering::Equal if version != 0 && line[2] != version => {
            Some(Fault::UnknownVersion)
        }
        std::cmp::Ordering::Equal => None,
    };
    counters.count(fault);
    if fault.is_none() {
        let mut out = Emit::new(at, source, &mut counters.flow, sink);
        match line[1] {
            b'1' => adahrs(line, &mut out),
            b'2' => system(line, &mut out),
            b'3' => ems(line, &mut out),
            _ => {}
        }
    }
}

fn adahrs(line: &[u8], out: &mut Emit<'_>) {
    out.time_of_day(&line[3..9], b'-');
    let mut f = Columns {
        line,
        filler: ABSENT,
        out,
    };
    f.put(Parameter::Pitch, (11, 4), 0.1, f64::to_radians);
    f.put(Parameter::Roll, (15, 5), 0.1, f64::to_radians);
    f.put(Parameter::HeadingMagnetic, (20, 3), 1.0, compass);
    f.put(Parameter::IndicatedAirspeed, (23, 4), 0.1, knots);
    f.put(Parameter::PressureAltitude, (27, 6), 1.0, feet);
    f.put(Parameter::TurnRate, (33, 4), 0.1, f64::to_radians);
    f.put(Parameter::LateralAcceleration, (37, 3), -0.01, same);
    f.put(Parameter::NormalAcceleration, (40, 3), 0.1, same);
    f.put(Parameter::AngleOfAttackUsed, (43, 2), 1.0, same);
    f.put(Parameter::VerticalSpeed, (45, 4), 10.0, fpm);
    f.put(Parameter::StaticAirTemperature, (49, 3), 1.0, celsius);
    f.put(Parameter::TrueAirspeed, (52, 4), 0.1, knots);
    let baro = |x| inches_of_mercury(27.5 + x);
    f.put(Parameter::BaroSetting, (56, 3), 0.01, baro);
    f.put(Parameter::DensityAltitude, (59, 6), 1.0, feet);
    f.put(Parameter::WindDirectionMagnetic, (65, 3), 1.0, compass);
    f.put(Parameter::WindSpeed, (68, 2), 1.0, knots);
}

fn system(line: &[u8], out: &mut Emit<'_>) {
    out.time_of_day(&line[3..9], b'-');
    let mut f = Columns {
        line,
        filler: ABSENT,
        out,
    };
    f.put(Parameter::SelectedHeading, (11, 3), 1.0, compass);
    f.put(Parameter::SelectedAltitude, (14, 5), 10.0, feet);
    f.put(Parameter::SelectedAirspeed, (19, 4), 0.1, knots);
    f.put(Parameter::SelectedVerticalSpeed, (23, 4), 10.0, fpm);
    f.put(Parameter::SelectedCourse, (27, 3), 1.0, compass);
    f.put(Parameter::CourseDeflection, (34, 3), 0.01, same);
    f.put(Parameter::GlidePathDeflection, (37, 3), 0.01, same);
}

fn ems(line: &[u8], out: &mut Emit<'_>) {
    out.time_of_day(&line[3..9], b'-');
    let mut f = Columns {
        line,
        filler: ABSENT,
        out,
    };
    let psi = |x| x * HECTOPASCALS_PER_PSI;
    let gallons = |x| x * LITRES_PER_US_GALLON;
    f.put(Parameter::OilPressure, (11, 3), 1.0, psi);
    f.put(Parameter::OilTemperature, (14, 4), 1.0, celsius);
    // Left and right are two pick-ups of one engine; the left one is always fitted.
    f.put(Parameter::EngineSpeed, (18, 4), 1.0, same);
    f.put(Parameter::ManifoldPressure, (26, 3), 0.1, inches_of_mercury);
    f.put(engines::FUEL_FLOW[0], (29, 3), 0.1, gallons);
    f.put(Parameter::FuelPressure, (35, 3), 0.1, psi);
    f.put(FUEL_QUANTITY[0], (38, 3), 0.1, gallons);
    f.put(FUEL_QUANTITY[1], (41, 3), 0.1, gallons);
    f.put(Parameter::FuelRemaining, (44, 3), 0.1, gallons);
    f.put(BUS_VOLTAGE[0], (47, 3), 0.1, same);
    f.put(BUS_VOLTAGE[1], (50, 3), 0.1, same);
    f.put(Parameter::EngineTime, (57, 5), 0.1, same);
    f.put(Parameter::TachometerTime, (62, 5), 0.1, same);
    f.put(Parameter::EnginePower, (217, 3), 1.0, same);
}
