//! Garmin G3X's and G5's text output: lines with fields of fixed width, a checksum at the end of each.
//!
//! Source: Garmin, "G3X/G3X Touch Installation Manual", 190-01115-01, appendix "RS-232 Text Output Format" (revision AC and
//! AV): attitude and air data `=11`, engine data `=31`; air data and bugs `=21` and height above ground `=71` are laid out as
//! in the TronView project's reader, and agree with recordings. The last two characters before the line end are the sum of all
//! before them, modulo 256, in hexadecimal. A field without a value is filled with `_`: absent.
//!
//! Signs: pitch up, roll right, turn right, climb are positive; lateral acceleration is positive to the left, and is turned
//! round here. The heading is magnetic.
//!
//! The engine data's first part is laid out as Dynon's, field by field, up to the cylinders; what lies between them and the
//! fields whose letters say their unit is not read, nor is the first current, whose scale the pages at hand do not give. Other
//! lines with a right checksum are good, but nothing is read from them.
//!
//! Lines that begin with `@`, Garmin's simple text output (as of the GPS 35 and its kind), have no checksum. They are counted as
//! ignored and as `unchecked`; what they say of position, height and motion over the ground is doubtful, for nothing protects it.
//! Where a line with a checksum says the same (ground speed in `=71`, vertical speed in `=11`) what they say of it is left for 10 s,
//! so that it does not come and go between the two.

use super::emit::{
    Columns, Emit, celsius, compass, feet, fpm, inches_of_mercury, knots, same, whole,
};
use super::framing::{LINE_BYTES_MAX, Look, Piece, at_most, is_line_end, text_line};
use super::stream::StreamDecoder;
use super::{Counters, Decoder, Fault};
use crate::sampled::Invalid;
use crate::signal::{
    BUS_CURRENT, BUS_VOLTAGE, FUEL_QUANTITY, Frame, Parameter, Signal, Sink, SourceId, engines,
};
use crate::time::Monotonic;
use crate::units::{HECTOPASCALS_PER_PSI, LITRES_PER_US_GALLON};
use std::time::Duration;

/// Lengths of the lines without their ends.
const ATTITUDE_BYTES: usize = 57;
const ENGINE_BYTES: usize = 219;
const AIR_BYTES: usize = 40;
const GROUND_BYTES: usize = 20;
/// A line of the simple text output.
const SIMPLE_BYTES: usize = 55;

/// The sender's sign of "no value".
const ABSENT: u8 = b'_';

/// For so long a line with a checksum speaks for lines without.
const CHECKED_LASTS: Duration = Duration::from_secs(10);

/// A decoder that has seen nothing.
#[must_use]
pub fn decoder() -> GarminG3x {
    GarminG3x {
        lines: StreamDecoder::new(look, take),
        checked_at: [None; Parameter::COUNT],
    }
}

/// The decoder. Memory: one line, and when each parameter was last said under a checksum.
#[derive(Debug)]
pub struct GarminG3x {
    lines: StreamDecoder<{ LINE_BYTES_MAX + 1 }>,
    checked_at: [Option<Monotonic>; Parameter::COUNT],
}

impl Decoder for GarminG3x {
    fn push(&mut self, frame: Frame<'_>, sink: &mut dyn Sink) {
        let checked_at = &mut self.checked_at;
        self.lines.push(frame, &mut |signal: Signal| {
            let checked_at = &mut checked_at[signal.parameter.index()];
            let age = checked_at.and_then(|at| signal.at.since(at));
            match signal.value {
                Ok(_) => *checked_at = Some(signal.at),
                Err(Invalid::Doubtful) if age.is_some_and(|age| age <= CHECKED_LASTS) => return,
                Err(_) => {}
            }
            sink.signal(signal);
        });
    }

    fn finish(&mut self) {
        self.lines.finish();
    }

    fn counters(&self) -> &Counters {
        self.lines.counters()
    }
}

pub(super) fn look(bytes: &[u8], seen: usize) -> Look {
    if bytes[0] != b'@' {
        let length = match bytes.get(..3) {
            Some(b"=11") => Some(ATTITUDE_BYTES),
            Some(b"=31") => Some(ENGINE_BYTES),
            Some(b"=21") => Some(AIR_BYTES),
            Some(b"=71") => Some(GROUND_BYTES),
            _ => None,
        };
        return text_line(bytes, seen, b'=', length);
    }
    let bytes = at_most(bytes, LINE_BYTES_MAX);
    match bytes.iter().position(|b| is_line_end(*b) || *b == b'=') {
        Some(SIMPLE_BYTES) if bytes[SIMPLE_BYTES] != b'=' => Look::Frame(SIMPLE_BYTES),
        Some(end) => Look::Foreign(end),
        None if bytes.len() < LINE_BYTES_MAX => Look::More,
        None => Look::Foreign(bytes.len()),
    }
}

/// Whether a line with a right sum is of a kind and length that this decoder knows.
pub(super) fn is_known(line: &[u8]) -> bool {
    matches!(
        (line.get(..3), line.len()),
        (Some(b"=11"), ATTITUDE_BYTES)
            | (Some(b"=31"), ENGINE_BYTES)
            | (Some(b"=21"), AIR_BYTES)
            | (Some(b"=71"), GROUND_BYTES)
    )
}

fn take(piece: Piece<'_>, source: SourceId, counters: &mut Counters, sink: &mut dyn Sink) {
    let Piece::Frame(at, line) = piece else {
        counters.count_piece(&piece);
        return;
    };
    if line[0] == b'@' {
        counters.ignored += 1;
        let mut out = Emit::new(at, source, &mut counters.flow, sink);
        out.unchecked();
        out.doubt = Some(Invalid::Doubtful);
        simple(line, &mut out);
        return;
    }
    let length = match line.get(1..3) {
        Some(b"11") => ATTITUDE_BYTES,
        Some(b"31") => ENGINE_BYTES,
        Some(b"21") => AIR_BYTES,
        Some(b"71") => GROUND_BYTES,
        _ => line.len(),
    };
    let fault = match line.len().cmp(&length) {
        std::cmp::Ordering::Less => Some(Fault::Short),
        std::cmp::Ordering::Greater => Some(Fault::Long),
        std::cmp::Ordering::Equal => None,
    };
    counters.count(fault);
    if fault.is_none() {
        let mut out = Emit::new(at, source, &mut counters.flow, sink);
        match line.get(1..3) {
            Some(b"11") => attitude(line, &mut out),
            Some(b"31") => engine(line, &mut out),
            Some(b"21") => air(line, &mut out),
            Some(b"71") => ground(line, &mut out),
            _ => {}
        }
    }
}

/// Date, time, position, its status, its error, height, velocity: Garmin, "Text Output Format" of its GPS interface.
fn simple(line: &[u8], out: &mut Emit<'_>) {
    let number = |at: usize, width: usize| whole(&line[at..at + width]);
    let signed = |at: usize, width: usize, [plus, minus]: [u8; 2]| {
        let sign = match line[at] {
            b if b == plus => 1.0,
            b if b == minus => -1.0,
            _ => return None,
        };
        number(at + 1, width).map(|x| sign * x)
    };
    let angle = |at: usize, degrees: usize, hemispheres| {
        let whole_degrees = signed(at, degrees, hemispheres)?;
        let minutes = number(at + 1 + degrees, 5).filter(|m| *m < 60_000.0)?;
        let degrees = whole_degrees.abs() + minutes / 60_000.0;
        let sign = if line[at] == hemispheres[0] {
            1.0
        } else {
            -1.0
        };
        Some((sign * degrees).to_radians())
    };
    // g, G: two and three dimensions; d, D: the same with differential corrections; S simulated; _ none.
    let dimensions = match line[30] {
        b'g' | b'd' => 2,
        b'G' | b'D' | b'S' => 3,
        _ => 0,
    };
    let flat = |x: Option<f64>| x.filter(|_| dimensions >= 2);
    let high = |x: Option<f64>| x.filter(|_| dimensions >= 3);
    out.maybe(Parameter::Latitude, flat(angle(13, 2, *b"NS")));
    out.maybe(Parameter::Longitude, flat(angle(21, 3, *b"EW")));
    out.maybe(Parameter::HorizontalAccuracy, flat(number(31, 3)));
    out.maybe(Parameter::AltitudeMsl, high(signed(34, 5, *b"+-")));
    let tenths = |at, directions| signed(at, 4, directions).map(|x| x * 0.1);
    let velocity = tenths(45, *b"NS").zip(tenths(40, *b"EW"));
    let speed = velocity.map(|(north, east)| north.hypot(east));
    let up = signed(50, 4, *b"UD").map(|x| x * 0.01);
    // Other lines say these too: where there is no fix nothing is said of them.
    for (parameter, value) in [
        (Parameter::GroundSpeed, flat(speed)),
        (Parameter::VerticalSpeed, high(up)),
    ] {
        if let Some(value) = value {
            out.number(parameter, value);
        }
    }
}

fn attitude(line: &[u8], out: &mut Emit<'_>) {
    out.time_of_day(&line[3..9], ABSENT);
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
    let baro = |x| inches_of_mercury(27.5 + x);
    f.put(Parameter::BaroSetting, (52, 3), 0.01, baro);
}

fn air(line: &[u8], out: &mut Emit<'_>) {
    let mut f = Columns {
        line,
        filler: ABSENT,
        out,
    };
    f.put(Parameter::TrueAirspeed, (11, 4), 0.1, knots);
    f.put(Parameter::DensityAltitude, (15, 6), 1.0, feet);
    f.put(Parameter::SelectedHeading, (21, 3), 1.0, compass);
    f.put(Parameter::SelectedAltitude, (24, 6), 1.0, feet);
    f.put(Parameter::SelectedAirspeed, (30, 4), 0.1, knots);
    f.put(Parameter::SelectedVerticalSpeed, (34, 4), 10.0, fpm);
}

fn ground(line: &[u8], out: &mut Emit<'_>) {
    let mut f = Columns {
        line,
        filler: ABSENT,
        out,
    };
    f.put(Parameter::HeightAgl, (11, 3), 100.0, feet);
    f.put(Parameter::GroundSpeed, (14, 4), 0.1, knots);
}

fn engine(line: &[u8], out: &mut Emit<'_>) {
    let mut f = Columns {
        line,
        filler: ABSENT,
        out,
    };
    let psi = |x| x * HECTOPASCALS_PER_PSI;
    let gallons = |x| x * LITRES_PER_US_GALLON;
    f.put(Parameter::OilPressure, (11, 3), 1.0, psi);
    f.put(Parameter::OilTemperature, (14, 4), 1.0, celsius);
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
    // Cylinder head and exhaust temperatures alternate, from the last cylinder to the first.
    for cylinder in 0..6 {
        let at = 67 + 8 * (5 - cylinder);
        f.put(
            engines::CYLINDER_HEAD_TEMPERATURE[0][cylinder],
            (at, 4),
            1.0,
            celsius,
        );
        f.put(
            engines::EXHAUST_GAS_TEMPERATURE[0][cylinder],
            (at + 4, 4),
            1.0,
            celsius,
        );
    }
    f.put(Parameter::TurbineInletTemperature, (115, 4), 1.0, celsius);
    // From here on a letter after each number says its unit: without it, the field is something else.
    for (parameter, at, unit, letter) in [
        (Parameter::CarburettorTemperature, 123, 0.1, b'C'),
        (Parameter::CoolantTemperature, 147, 0.1, b'C'),
    ] {
        if line[at + 5] == letter {
            f.put(parameter, (at, 5), unit, celsius);
        }
    }
    for (parameter, at) in [(FUEL_QUANTITY[2], 135), (FUEL_QUANTITY[3], 141)] {
        if line[at + 5] == b'G' {
            f.put(parameter, (at, 5), 0.1, gallons);
        }
    }
    if line[134] == b'A' {
        f.put(BUS_CURRENT[1], (129, 5), 0.1, same);
    }
}
