//! The way out of a decoder: checks each field against its parameter's range and counts what it refuses.

use super::Flow;
use crate::angle::wrap_turn;
use crate::sampled::Invalid;
use crate::signal::{Parameter, Signal, Sink, SourceId, Traffic};
use crate::time::Monotonic;
use crate::units::{
    Feet, FeetPerMinute, Hectopascals, InchesOfMercury, Knots, Metres, MetresPerSecond, Radians,
};

/// Gives the fields of one good frame to a sink.
pub(super) struct Emit<'a> {
    pub(super) at: Monotonic,
    pub(super) source: SourceId,
    pub(super) sink: &'a mut dyn Sink,
    /// Why nothing of this frame may be trusted, if so.
    pub(super) doubt: Option<Invalid>,
    flow: &'a mut Flow,
}

impl<'a> Emit<'a> {
    pub(super) fn new(
        at: Monotonic,
        source: SourceId,
        flow: &'a mut Flow,
        sink: &'a mut dyn Sink,
    ) -> Self {
        Self {
            at,
            source,
            sink,
            doubt: None,
            flow,
        }
    }

    /// A number in the parameter's unit.
    pub(super) fn number(&mut self, parameter: Parameter, value: f64) {
        let value = parameter.check(value);
        self.flow.refused += u64::from(value.is_err());
        self.verdict(parameter, value);
    }

    /// A number, or the source's own statement that it has none.
    pub(super) fn maybe(&mut self, parameter: Parameter, value: Option<f64>) {
        match value {
            Some(value) => self.number(parameter, value),
            None => self.absent(parameter),
        }
    }

    /// A field of text: a number, a sentinel, or something that it cannot be.
    pub(super) fn field(
        &mut self,
        parameter: Parameter,
        field: Field,
        to_unit: impl Fn(f64) -> f64,
    ) {
        match field {
            Field::Number(x) => self.number(parameter, to_unit(x)),
            Field::Absent => self.absent(parameter),
            Field::Malformed => self.number(parameter, f64::NAN),
        }
    }

    /// Coordinated universal time as `HHMMSS`, filled with `filler` when absent.
    pub(super) fn time_of_day(&mut self, field: &[u8], filler: u8) {
        let seconds = match field {
            _ if field.iter().all(|b| *b == filler) => return self.absent(Parameter::UtcTimeOfDay),
            [h, hh, m, mm, s, ss] => {
                let part = |a: &u8, b: &u8, below: f64| {
                    whole(&[*a, *b]).filter(|n| *n < below).unwrap_or(f64::NAN)
                };
                // A leap second has the number 60.
                part(h, hh, 24.0) * 3600.0 + part(m, mm, 60.0) * 60.0 + part(s, ss, 61.0)
            }
            _ => f64::NAN,
        };
        self.number(Parameter::UtcTimeOfDay, seconds);
    }

    /// The source says that it has none.
    pub(super) fn absent(&mut self, parameter: Parameter) {
        self.verdict(parameter, Err(Invalid::SourceFailed));
    }

    pub(super) fn verdict(&mut self, parameter: Parameter, value: Result<f64, Invalid>) {
        let value = match (value, self.doubt) {
            (Ok(_), Some(doubt)) => Err(doubt),
            (value, _) => value,
        };
        self.sink.signal(Signal {
            at: self.at,
            source: self.source,
            parameter,
            value,
        });
    }

    /// This frame has no checksum.
    pub(super) fn unchecked(&mut self) {
        self.flow.unchecked += 1;
    }

    /// A field that is no signal was nothing that it may be.
    pub(super) fn refused(&mut self) {
        self.flow.refused += 1;
    }

    /// Another aircraft; its time and source are filled in here.
    pub(super) fn traffic(&mut self, traffic: Traffic) {
        self.sink.traffic(&Traffic {
            at: self.at,
            source: self.source,
            ..traffic
        });
    }

    /// Whether a number may go into something that is not a signal; counts it as refused when not.
    pub(super) fn accept(&mut self, parameter: Parameter, value: f64) -> Option<f64> {
        let value = parameter.check(value).ok();
        self.flow.refused += u64::from(value.is_none());
        value
    }
}

/// A length, m.
pub(super) fn feet(x: f64) -> f64 {
    Metres::from(Feet(x)).0
}

/// A speed, m/s.
pub(super) fn knots(x: f64) -> f64 {
    MetresPerSecond::from(Knots(x)).0
}

/// A vertical speed, m/s.
pub(super) fn fpm(x: f64) -> f64 {
    MetresPerSecond::from(FeetPerMinute(x)).0
}

/// A pressure, hPa.
pub(super) fn inches_of_mercury(x: f64) -> f64 {
    Hectopascals::from(InchesOfMercury(x)).0
}

/// A temperature, K.
pub(super) fn celsius(x: f64) -> f64 {
    x + 273.15
}

/// A direction of 0 to 360 degrees, rad from 0 to 2 pi; what is no direction stays none.
pub(super) fn compass(degrees: f64) -> f64 {
    if (0.0..=360.0).contains(&degrees) {
        wrap_turn(Radians::from_degrees(degrees)).0
    } else {
        f64::NAN
    }
}

/// Days from 1 January 1970 to a day of the Gregorian calendar; not a number for a day that is none (Hinnant 2013,
/// "chrono-compatible low-level date algorithms").
pub(super) fn date_days(year: i32, month: i32, day: i32) -> f64 {
    let leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let length = match month {
        2 => 28 + i32::from(leap),
        4 | 6 | 9 | 11 => 30,
        1..=12 => 31,
        _ => 0,
    };
    if !(1..=length).contains(&day) || !(1970..=9999).contains(&year) {
        return f64::NAN;
    }
    // Years begin in March here, so that the leap day is the last of them.
    let (y, m) = (year - i32::from(month <= 2), (month + 9) % 12);
    let day_of_year = (153 * m + 2) / 5 + day - 1;
    let days = y * 365 + y / 4 - y / 100 + y / 400 + day_of_year;
    f64::from(days - 719_468)
}

/// As it is.
pub(super) const fn same(x: f64) -> f64 {
    x
}

/// A line of text with fields of fixed width.
pub(super) struct Columns<'a, 'b, 'c> {
    pub(super) line: &'a [u8],
    /// What a field without a value is filled with.
    pub(super) filler: u8,
    pub(super) out: &'b mut Emit<'c>,
}

impl Columns<'_, '_, '_> {
    /// The field that begins at `at` and is `width` wide, its last digit worth `unit`.
    pub(super) fn put(
        &mut self,
        parameter: Parameter,
        (at, width): (usize, usize),
        unit: f64,
        to_si: impl Fn(f64) -> f64,
    ) {
        let field = self.line.get(at..at + width).unwrap_or_default();
        self.out
            .field(parameter, fixed(field, self.filler, unit), to_si);
    }
}

/// What a field of text holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Field {
    Number(f64),
    /// The protocol's sentinel.
    Absent,
    Malformed,
}

/// A field of fixed width: an optional sign and digits, in units of `unit`; filled with `filler` throughout when absent.
pub(super) fn fixed(field: &[u8], filler: u8, unit: f64) -> Field {
    if !field.is_empty() && field.iter().all(|b| *b == filler) {
        return Field::Absent;
    }
    let (digits, sign) = match field {
        [b'+', digits @ ..] => (digits, 1.0),
        [b'-', digits @ ..] => (digits, -1.0),
        digits => (digits, 1.0),
    };
    whole(digits).map_or(Field::Malformed, |n| Field::Number(sign * n * unit))
}

/// Up to 15 digits and nothing else, as a number that 64 bits hold exactly.
pub(super) fn whole(digits: &[u8]) -> Option<f64> {
    if !(1..=15).contains(&digits.len()) || !digits.iter().all(u8::is_ascii_digit) {
        return None;
    }
    Some(
        digits
            .iter()
            .fold(0.0, |n, b| n * 10.0 + f64::from(b - b'0')),
    )
}

/// A decimal number without exponent: sign, digits, point, digits; up to 24 characters.
pub(super) fn decimal(field: &[u8]) -> Field {
    if field.is_empty() {
        return Field::Absent;
    }
    let (digits, sign) = match field {
        [b'-', digits @ ..] => (digits, -1.0),
        [b'+', digits @ ..] => (digits, 1.0),
        digits => (digits, 1.0),
    };
    let well_formed = digits.iter().all(|b| b.is_ascii_digit() || *b == b'.')
        && digits.iter().filter(|b| **b == b'.').count() <= 1
        && (1..=24).contains(&digits.len())
        && digits.iter().any(u8::is_ascii_digit);
    let number = well_formed
        .then(|| std::str::from_utf8(digits).ok()?.parse::<f64>().ok())
        .flatten();
    number.map_or(Field::Malformed, |n| Field::Number(sign * n))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_numbers_sentinels_or_refused() {
        for (field, expected) in [
            (&b"+052"[..], Field::Number(5.2)),
            (b"-0123", Field::Number(-12.3)),
            (b"271", Field::Number(27.1)),
            (b"XXXX", Field::Absent),
            (b"+0X2", Field::Malformed),
            (b"+", Field::Malformed),
            (b"", Field::Malformed),
            (b"+-12", Field::Malformed),
            (b" 12", Field::Malformed),
        ] {
            let got = fixed(field, b'X', 0.1);
            let near = match (got, expected) {
                (Field::Number(a), Field::Number(b)) => (a - b).abs() < 1e-12,
                (a, b) => a == b,
            };
            assert!(near, "{got:?} {expected:?}");
        }
    }

    #[test]
    fn dates_are_counted_and_days_that_are_none_refused() {
        // Checked with Python's datetime.date.toordinal.
        for (y, m, d, days) in [
            (1970, 1, 1, 0.0),
            (2000, 2, 29, 11_016.0),
            (2024, 12, 31, 20_088.0),
            (2100, 3, 1, 47_541.0),
        ] {
            assert!((date_days(y, m, d) - days).abs() < 0.5, "{y}-{m}-{d}");
        }
        for (y, m, d) in [
            (2023, 2, 29),
            (2024, 13, 1),
            (2024, 0, 1),
            (2024, 4, 31),
            (2024, 4, 0),
        ] {
            assert!(date_days(y, m, d).is_nan(), "{y}-{m}-{d}");
        }
    }

    #[test]
    fn decimals_have_no_exponents_names_or_second_points() {
        assert_eq!(decimal(b"-12.50"), Field::Number(-12.5));
        assert_eq!(decimal(b".5"), Field::Number(0.5));
        assert_eq!(decimal(b""), Field::Absent);
        for field in [
            &b"1e5"[..],
            b"nan",
            b"inf",
            b"1.2.3",
            b".",
            b"--1",
            b"1 ",
            b"1234567890123456789012345",
        ] {
            assert_eq!(decimal(field), Field::Malformed, "{field:?}");
        }
    }
}
