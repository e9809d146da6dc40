//! Fields of messages: where a parameter stands, in which form, and how its unit becomes steps.

use super::Carried;
use crate::bench::truth::Truth;
use crate::sampled::Invalid;
use crate::signal::Parameter;
use crate::units::{
    HECTOPASCALS_PER_INCH_OF_MERCURY, HECTOPASCALS_PER_PSI, LITRES_PER_US_GALLON, METRES_PER_FOOT,
    METRES_PER_NAUTICAL_MILE,
};

pub(super) const DEGREE: f64 = std::f64::consts::PI / 180.0;
pub(super) const FOOT: f64 = METRES_PER_FOOT;
pub(super) const FPM: f64 = METRES_PER_FOOT / 60.0;
pub(super) const KNOT: f64 = METRES_PER_NAUTICAL_MILE / 3600.0;
pub(super) const KMH: f64 = 1.0 / 3.6;
pub(super) const INHG: f64 = HECTOPASCALS_PER_INCH_OF_MERCURY;
pub(super) const PSI: f64 = HECTOPASCALS_PER_PSI;
pub(super) const GALLON: f64 = LITRES_PER_US_GALLON;
/// 0 degrees Celsius, K.
pub(super) const ICE: f64 = 273.15;
/// A degree Fahrenheit, K, and 0 degrees Fahrenheit, K.
pub(super) const FAHRENHEIT: f64 = 1.0 / 1.8;
pub(super) const FAHRENHEIT_ZERO: f64 = 273.15 - 32.0 / 1.8;

/// How a number is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Form {
    /// A sign and digits, so many characters.
    Signed(usize),
    /// Digits.
    Digits(usize),
    I16,
    U16,
    I32,
    F32,
    F64,
}

impl Form {
    const fn range(self) -> (f64, f64) {
        const TEN: [f64; 7] = [1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6];
        match self {
            Self::Signed(n) => (1.0 - TEN[n - 1], TEN[n - 1] - 1.0),
            Self::Digits(n) => (0.0, TEN[n] - 1.0),
            Self::I16 => (-32_768.0, 32_767.0),
            Self::U16 => (0.0, 65_535.0),
            Self::I32 => (-2_147_483_648.0, 2_147_483_647.0),
            Self::F32 | Self::F64 => (-1e30, 1e30),
        }
    }

    const fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }
}

/// One field.
#[derive(Clone, Copy, Debug)]
pub(super) struct Field {
    pub(super) parameter: Parameter,
    /// Its first byte or column.
    pub(super) at: usize,
    pub(super) form: Form,
    /// A step of the field in the parameter's unit.
    pub(super) step: f64,
    /// What the field's 0 is in the parameter's unit.
    pub(super) zero: f64,
}

pub(super) const fn field(parameter: Parameter, at: usize, form: Form, step: f64) -> Field {
    Field {
        parameter,
        at,
        form,
        step,
        zero: 0.0,
    }
}

impl Field {
    pub(super) const fn from(mut self, zero: f64) -> Self {
        self.zero = zero;
        self
    }

    /// The field's number: steps, whole ones unless it is a floating-point field. None for NaN that it cannot hold.
    pub(super) fn steps(&self, value: f64) -> Option<f64> {
        let steps = (value - self.zero) / self.step;
        if self.form.is_float() {
            return Some(steps);
        }
        let (min, max) = self.form.range();
        (!value.is_nan()).then(|| steps.round().clamp(min, max))
    }

    /// What the truth has for this field, in steps.
    pub(super) fn told(&self, truth: &Truth) -> Result<f64, Invalid> {
        self.steps(truth.get(self.parameter)?)
            .ok_or(Invalid::OutOfRange)
    }

    pub(super) fn carried(&self, absent: bool) -> Carried {
        let (min, max) = self.form.range();
        let ends = [min, max].map(|x| x * self.step + self.zero);
        let spec = self.parameter.spec();
        let largest = spec.max.abs().max(spec.min.abs());
        let resolution = match self.form {
            // The distance of neighbouring numbers is below this part of them.
            Form::F32 => largest * f64::from(f32::EPSILON) + self.zero.abs() * f64::EPSILON,
            Form::F64 => largest * 1e-14,
            _ => self.step.abs(),
        };
        Carried {
            resolution,
            min: ends[0].min(ends[1]),
            max: ends[0].max(ends[1]),
            absent,
            nan: self.form.is_float(),
            doubtful: false,
        }
    }
}

/// How the first field of a parameter carries it.
pub(super) fn carried_by(
    fields: &[&[Field]],
    parameter: Parameter,
    absent: bool,
) -> Option<Carried> {
    let mut all = fields.iter().flat_map(|fields| fields.iter());
    all.find(|field| field.parameter == parameter)
        .map(|field| field.carried(absent))
}

/// A number of steps as a whole number. What is no number has been turned away before.
#[expect(
    clippy::cast_possible_truncation,
    reason = "held within the field's ends, which are within 32 bits"
)]
pub(super) const fn whole(steps: f64) -> i64 {
    steps as i64
}

/// Writes text into a line from `at` on.
pub(super) fn put(line: &mut [u8], at: usize, text: &str) {
    line[at..at + text.len()].copy_from_slice(text.as_bytes());
}

/// Writes the fields of a line of fixed columns; those without a value are filled with `filler`. False when one has no value
/// and there is no filler.
pub(super) fn put_columns(
    line: &mut [u8],
    fields: &[Field],
    truth: &Truth,
    filler: Option<u8>,
) -> bool {
    for field in fields {
        let (width, signed) = match field.form {
            Form::Signed(width) => (width, true),
            Form::Digits(width) => (width, false),
            _ => continue,
        };
        match (field.told(truth), filler) {
            (Ok(steps), _) if signed => {
                put(line, field.at, &format!("{:+0width$}", whole(steps)));
            }
            (Ok(steps), _) => put(line, field.at, &format!("{:0width$}", whole(steps))),
            (Err(_), Some(filler)) => line[field.at..field.at + width].fill(filler),
            (Err(_), None) => return false,
        }
    }
    true
}

/// Hours, minutes, seconds and the rest of a second from the truth's time of day.
pub(super) fn clock(truth: &Truth) -> Option<[f64; 4]> {
    let seconds = truth.finite(Parameter::UtcTimeOfDay)?;
    if !(0.0..86_400.0).contains(&seconds) {
        return None;
    }
    let whole = seconds.floor();
    Some([
        (whole / 3600.0).floor(),
        (whole / 60.0).floor() % 60.0,
        whole % 60.0,
        seconds - whole,
    ])
}

/// Year, month and day from the truth's date (Hinnant 2013, "chrono-compatible low-level date algorithms").
pub(super) fn calendar(truth: &Truth) -> Option<[u32; 3]> {
    let days = truth.finite(Parameter::UtcDate)?;
    if !(0.0..1e6).contains(&days) {
        return None;
    }
    // Eras of 400 years that begin in March.
    let days = whole(days.floor()) + 719_468;
    let (era, day) = (days / 146_097, days % 146_097);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day_of_year = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    let year = year + era * 400 + i64::from(month <= 2);
    Some([year, month, day].map(|n| u32::try_from(n).unwrap_or(0)))
}
