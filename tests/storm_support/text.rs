//! Lines of text: Dynon, Garmin, FlightGear's generic protocol, NMEA. Layouts as their manufacturers print them.

use super::said::{FOOT, FPM, GALLON, INCH_HG, KNOT, PSI, Said};
use glasswing::signal::Parameter::{self, *};

/// The sum of a line's bytes, as its last two characters.
pub(crate) fn seal_sum(frame: &mut Vec<u8>) {
    let end = frame.iter().rposition(|b| !b"\r\n".contains(b));
    if let Some(end) = end.filter(|end| *end >= 2) {
        let sum = frame[..end - 1].iter().map(|b| u32::from(*b)).sum::<u32>() % 256;
        frame[end - 1] = hex_digit(sum / 16);
        frame[end] = hex_digit(sum % 16);
    }
}

/// The exclusive or of a sentence, as its last two characters.
pub(crate) fn seal_sentence(frame: &mut Vec<u8>) {
    if let Some(star) = frame.iter().rposition(|b| *b == b'*')
        && star >= 1
        && star + 2 < frame.len()
    {
        let xor = u32::from(frame[1..star].iter().fold(0, |a, b| a ^ b));
        frame[star + 1] = hex_digit(xor / 16);
        frame[star + 2] = hex_digit(xor % 16);
    }
}

fn hex_digit(n: u32) -> u8 {
    b"0123456789ABCDEF"[usize::try_from(n % 16).unwrap_or(0)]
}

fn ends_with(line: &[u8], sum: u32) -> bool {
    let digits = [hex_digit(sum / 16), hex_digit(sum % 16)];
    line[line.len() - 2..].eq_ignore_ascii_case(&digits)
}

fn has_right_sum(line: &[u8]) -> bool {
    if line.len() < 4 {
        return false;
    }
    let sum: u32 = line[..line.len() - 2].iter().map(|b| u32::from(*b)).sum();
    ends_with(line, sum % 256)
}

/// Every line that begins with `start` and has a right sum at its end, or at the length of its kind.
fn summed(bytes: &[u8], start: u8, lengths: &[usize], on: &mut dyn FnMut(&[u8])) {
    for (i, _) in bytes.iter().enumerate().filter(|(_, b)| **b == start) {
        let ends = |b: &u8| b"\r\n".contains(b) || *b == start;
        let rest = &bytes[i + 1..];
        let end = rest.iter().position(ends).unwrap_or(rest.len()) + 1;
        let line = &bytes[i..i + end];
        let short = lengths.iter().filter_map(|n| line.get(..*n));
        for line in short.chain([line]) {
            if has_right_sum(line) {
                on(line);
            }
        }
    }
}

pub(crate) fn skyview_frames(bytes: &[u8], on: &mut dyn FnMut(&[u8])) {
    summed(bytes, b'!', &[72, 91, 223], on);
}

pub(crate) fn garmin_frames(bytes: &[u8], on: &mut dyn FnMut(&[u8])) {
    summed(bytes, b'=', &[57, 219, 40, 20], on);
}

/// Any 51 characters with a right sum: nothing marks the beginning of a line.
pub(crate) fn d100_frames(bytes: &[u8], on: &mut dyn FnMut(&[u8])) {
    let mut sum: u32 = bytes.iter().take(48).map(|b| u32::from(*b)).sum();
    for line in bytes.windows(51) {
        sum += u32::from(line[48]);
        if ends_with(line, sum % 256) {
            on(line);
        }
        sum -= u32::from(line[0]);
    }
}

/// One column: parameter, offset, width, what its last digit is worth, in the parameter's unit but for degrees.
type Column = (Parameter, usize, usize, f64);

/// An optional sign and digits.
fn integer(text: &[u8]) -> Option<f64> {
    let text = std::str::from_utf8(text).ok()?;
    let digits = text.strip_prefix(['+', '-']).unwrap_or(text);
    let plain = !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit());
    // An i64 has a sign of its own, so "-0" is 0; so is it to the decoders' comparison.
    plain.then(|| text.parse::<i64>().ok()).flatten().map(|n| {
        #[expect(clippy::cast_precision_loss, reason = "six digits at most")]
        let n = n as f64;
        n
    })
}

fn columns(line: &[u8], said: &mut Said, columns: &[Column]) {
    for (parameter, at, width, unit) in columns {
        let value = line.get(*at..at + width).and_then(integer);
        let value = value.map(|n| n * unit);
        match parameter {
            HeadingMagnetic | WindDirectionMagnetic | SelectedHeading | SelectedCourse => {
                said.compass(*parameter, value);
            }
            Pitch | Roll | TurnRate => said.degrees(*parameter, value),
            StaticAirTemperature | OilTemperature => {
                said.put(*parameter, value.map(|c| c + 273.15));
            }
            BaroSetting => said.put(*parameter, value.map(|x| x + 27.5 * INCH_HG)),
            _ => said.put(*parameter, value),
        }
    }
}

/// Common to Dynon's `!1` and Garmin's `=11`.
const ATTITUDE: [Column; 11] = [
    (Pitch, 11, 4, 0.1),
    (Roll, 15, 5, 0.1),
    (HeadingMagnetic, 20, 3, 1.0),
    (IndicatedAirspeed, 23, 4, 0.1 * KNOT),
    (PressureAltitude, 27, 6, FOOT),
    (TurnRate, 33, 4, 0.1),
    (LateralAcceleration, 37, 3, -0.01),
    (NormalAcceleration, 40, 3, 0.1),
    (AngleOfAttackUsed, 43, 2, 1.0),
    (VerticalSpeed, 45, 4, 10.0 * FPM),
    (StaticAirTemperature, 49, 3, 1.0),
];

const ENGINE: [Column; 4] = [
    (OilPressure, 11, 3, PSI),
    (OilTemperature, 14, 4, 1.0),
    (EngineSpeed, 18, 4, 1.0),
    (ManifoldPressure, 26, 3, 0.1 * INCH_HG),
];

pub(crate) fn skyview(line: &[u8], said: &mut Said) {
    match (line.get(..3), line.len()) {
        (Some(b"!11"), 72) => {
            columns(line, said, &ATTITUDE);
            columns(
                line,
                said,
                &[
                    (TrueAirspeed, 52, 4, 0.1 * KNOT),
                    (BaroSetting, 56, 3, 0.01 * INCH_HG),
                    (DensityAltitude, 59, 6, FOOT),
                    (WindDirectionMagnetic, 65, 3, 1.0),
                    (WindSpeed, 68, 2, KNOT),
                ],
            );
        }
        (Some(b"!22"), 91) => columns(
            line,
            said,
            &[
                (SelectedHeading, 11, 3, 1.0),
                (SelectedAltitude, 14, 5, 10.0 * FOOT),
                (SelectedAirspeed, 19, 4, 0.1 * KNOT),
                (SelectedVerticalSpeed, 23, 4, 10.0 * FPM),
                (SelectedCourse, 27, 3, 1.0),
            ],
        ),
        (Some(b"!32"), 223) => {
            columns(line, said, &ENGINE);
            columns(line, said, &[(FuelFlow, 29, 3, 0.1 * GALLON)]);
        }
        _ => {}
    }
}

pub(crate) fn garmin(line: &[u8], said: &mut Said) {
    match (line.get(..3), line.len()) {
        (Some(b"=11"), 57) => {
            columns(line, said, &ATTITUDE);
            columns(line, said, &[(BaroSetting, 52, 3, 0.01 * INCH_HG)]);
        }
        (Some(b"=21"), 40) => columns(
            line,
            said,
            &[
                (TrueAirspeed, 11, 4, 0.1 * KNOT),
                (DensityAltitude, 15, 6, FOOT),
                (SelectedHeading, 21, 3, 1.0),
                (SelectedAltitude, 24, 6, FOOT),
                (SelectedAirspeed, 30, 4, 0.1 * KNOT),
                (SelectedVerticalSpeed, 34, 4, 10.0 * FPM),
            ],
        ),
        (Some(b"=71"), 20) => columns(
            line,
            said,
            &[
                (HeightAgl, 11, 3, 100.0 * FOOT),
                (GroundSpeed, 14, 4, 0.1 * KNOT),
            ],
        ),
        (Some(b"=31"), 219) => {
            columns(line, said, &ENGINE);
            columns(line, said, &[(FuelFlow, 29, 3, 0.1 * GALLON)]);
        }
        _ => {}
    }
}

pub(crate) fn d100(line: &[u8], said: &mut Said) {
    columns(
        line,
        said,
        &[
            (Pitch, 8, 4, 0.1),
            (Roll, 12, 5, 0.1),
            (HeadingMagnetic, 17, 3, 1.0),
            (IndicatedAirspeed, 20, 4, 0.1),
            (LateralAcceleration, 33, 3, -0.01),
            (NormalAcceleration, 36, 3, 0.1),
            (AngleOfAttackUsed, 39, 2, 1.0),
        ],
    );
    let odd = matches!(line.get(46), Some(b'1' | b'3' | b'5' | b'7' | b'9'))
        || matches!(line.get(46), Some(b'B' | b'D' | b'F' | b'b' | b'd' | b'f'));
    if odd {
        let rate = [
            (PressureAltitude, 24, 5, 1.0),
            (VerticalSpeed, 29, 4, 0.1 * FOOT),
        ];
        columns(line, said, &rate);
    } else {
        let turn = [(BaroAltitude, 24, 5, 1.0), (TurnRate, 29, 4, 0.1)];
        columns(line, said, &turn);
    }
}

/// Digits with at most one point; no exponent, no name.
fn decimal(text: &str) -> Option<f64> {
    let plain = text.bytes().all(|b| b"+-.0123456789".contains(&b));
    plain.then(|| text.parse().ok()).flatten()
}

/// Whole lines, the last one included.
pub(crate) fn lines(bytes: &[u8], on: &mut dyn FnMut(&[u8])) {
    bytes.split(|b| b"\r\n".contains(b)).for_each(on);
}

/// The fields of `boards/flightgear-glasswing.xml` that are checked, by their places.
pub(crate) fn fg_generic(line: &[u8], said: &mut Said) {
    let line = String::from_utf8_lossy(line);
    let fields: Vec<&str> = line.split(',').collect();
    if fields.len() != 33 {
        return;
    }
    let n = |i: usize| decimal(fields[i].trim());
    let scaled = |i: usize, unit: f64| n(i).map(|x| x * unit);
    let celsius = |x: f64| x + 273.15;
    said.degrees(Latitude, n(0));
    said.degrees(Longitude, n(1));
    said.put(AltitudeMsl, scaled(2, FOOT));
    said.put(HeightAgl, scaled(3, FOOT));
    said.degrees(Roll, n(4));
    said.degrees(Pitch, n(5));
    said.compass(HeadingTrue, n(6));
    said.compass(HeadingMagnetic, n(7));
    said.compass(Track, n(8));
    said.degrees(AngleOfAttack, n(9));
    said.degrees(Sideslip, n(10));
    said.put(GroundSpeed, scaled(11, KNOT));
    said.put(IndicatedAirspeed, scaled(12, KNOT));
    said.put(TrueAirspeed, scaled(13, KNOT));
    said.put(BaroAltitude, scaled(14, FOOT));
    said.put(PressureAltitude, scaled(15, FOOT));
    said.put(BaroSetting, n(16));
    said.put(VerticalSpeed, scaled(17, FPM));
    said.put(NormalAcceleration, n(18));
    said.put(LateralAcceleration, scaled(19, FOOT / 9.806_65));
    said.put(StaticAirTemperature, n(20).map(celsius));
    said.put(WindSpeed, scaled(21, KNOT));
    said.compass(WindDirectionTrue, n(22));
    said.degrees(MagneticVariation, n(23));
    said.put(EngineSpeed, n(24));
    said.put(ManifoldPressure, scaled(25, INCH_HG));
    said.put(FuelFlow, scaled(26, GALLON));
    said.put(OilPressure, scaled(27, PSI));
}

/// Every sentence with a right sum.
pub(crate) fn sentences(bytes: &[u8], on: &mut dyn FnMut(&[u8])) {
    for (i, _) in bytes.iter().enumerate().filter(|(_, b)| b"$!".contains(b)) {
        let rest = &bytes[i + 1..];
        let Some(star) = rest
            .iter()
            .position(|b| !(b' '..=b'~').contains(b) || b"*$".contains(b))
        else {
            continue;
        };
        if rest[star] != b'*' {
            continue;
        }
        let xor = rest[..star].iter().fold(0, |a, b| a ^ b);
        if let Some(digits) = rest.get(star + 1..star + 3)
            && std::str::from_utf8(digits)
                .is_ok_and(|d| d.eq_ignore_ascii_case(&format!("{xor:02X}")))
        {
            on(&rest[..star]);
        }
    }
}

/// Degrees of `DDMM.MMM` and a hemisphere.
fn angle(number: &str, hemisphere: &str, [positive, negative]: [&str; 2]) -> Option<f64> {
    let sign = match hemisphere {
        h if h == positive => 1.0,
        h if h == negative => -1.0,
        _ => return None,
    };
    let point = number.find('.').unwrap_or(number.len());
    let degrees: f64 = integer(number.get(..point.checked_sub(2)?)?.as_bytes())?;
    let minutes = decimal(number.get(point - 2..)?)?;
    Some(sign * (degrees + minutes / 60.0))
}

pub(crate) fn nmea(body: &[u8], said: &mut Said) {
    let Ok(body) = std::str::from_utf8(body) else {
        return;
    };
    let fields: Vec<&str> = body.split(',').collect();
    let text = |i: usize| fields.get(i).copied().unwrap_or_default();
    let n = |i: usize| decimal(text(i));
    let is = |kind: &str| fields[0].len() == 5 && fields[0].ends_with(kind);
    match fields[0] {
        "PGRMZ" => {
            let unit = if text(2).eq_ignore_ascii_case("m") {
                1.0
            } else {
                FOOT
            };
            said.put(PressureAltitude, n(1).map(|x| x * unit));
        }
        "PLXVF" => {
            said.put(IndicatedAirspeed, n(6));
            said.put(PressureAltitude, n(7));
        }
        "LXWP0" => {
            said.put(IndicatedAirspeed, n(2).map(|x| x / 3.6));
            said.put(TotalEnergyVerticalSpeed, n(4));
        }
        "PXCV" => {
            said.put(TotalEnergyVerticalSpeed, n(1));
            said.degrees(Roll, n(10));
            said.degrees(Pitch, n(11));
        }
        "RPYL" => {
            let works = text(7).bytes().all(|b| b == b'0');
            let tenths = |i: usize| n(i).filter(|x| works && *x < 32_767.0).map(|x| x / 10.0);
            said.degrees(Roll, tenths(1));
            said.degrees(Pitch, tenths(2));
            said.compass(HeadingMagnetic, tenths(3));
            said.degrees(TurnRate, tenths(5));
            said.put(NormalAcceleration, tenths(6).map(|x| x / 100.0));
        }
        name if name.starts_with('P') => {}
        _ if is("GGA") && matches!(text(6), "1" | "2" | "3" | "4" | "5") => {
            said.degrees(Latitude, angle(text(2), text(3), ["N", "S"]));
            said.degrees(Longitude, angle(text(4), text(5), ["E", "W"]));
            said.put(AltitudeMsl, n(9).filter(|_| text(10) == "M"));
        }
        _ if is("RMC") && text(2) == "A" && !matches!(text(12), "N" | "E" | "M" | "S") => {
            said.degrees(Latitude, angle(text(3), text(4), ["N", "S"]));
            said.degrees(Longitude, angle(text(5), text(6), ["E", "W"]));
            said.put(GroundSpeed, n(7).map(|x| x * KNOT));
            said.compass(Track, n(8));
        }
        _ if is("VTG") && !matches!(text(9), "N" | "E" | "M" | "S") => {
            said.compass(Track, n(1));
            said.put(GroundSpeed, n(5).map(|x| x * KNOT));
        }
        _ => {}
    }
}
