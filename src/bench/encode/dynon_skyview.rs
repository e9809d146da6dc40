//! Dynon SkyView: lines `!1` (ADAHRS), `!2` (system) and `!3` (engine), at the rates of a recorded flight: 8, 2 and 2 a second.
//!
//! Source: Dynon Avionics, "SkyView System Installation Guide", appendix "Serial Data Output". Fields without a value are filled
//! with `X`, the time with `-`; the last two characters are the sum of all before them.

use super::field::{
    DEGREE, FOOT, FPM, Field, Form, GALLON, ICE, INHG, KNOT, PSI, carried_by, clock, field, put,
    put_columns, whole,
};
use super::{Beat, Carried, Encoder, Send};
use crate::bench::truth::Truth;
use crate::signal::Parameter as P;
use crate::signal::{BUS_VOLTAGE, FUEL_QUANTITY, Parameter, Wire, engines};

/// One display.
#[derive(Clone, Copy, Debug)]
pub struct DynonSkyView;

const BEATS: [Beat; 3] = [Beat::ms(125, 0), Beat::ms(500, 40), Beat::ms(500, 290)];

const ADAHRS: [Field; 16] = [
    field(P::Pitch, 11, Form::Signed(4), 0.1 * DEGREE),
    field(P::Roll, 15, Form::Signed(5), 0.1 * DEGREE),
    field(P::HeadingMagnetic, 20, Form::Digits(3), DEGREE),
    field(P::IndicatedAirspeed, 23, Form::Digits(4), 0.1 * KNOT),
    field(P::PressureAltitude, 27, Form::Signed(6), FOOT),
    field(P::TurnRate, 33, Form::Signed(4), 0.1 * DEGREE),
    // Positive to the left.
    field(P::LateralAcceleration, 37, Form::Signed(3), -0.01),
    field(P::NormalAcceleration, 40, Form::Signed(3), 0.1),
    field(P::AngleOfAttackUsed, 43, Form::Digits(2), 1.0),
    field(P::VerticalSpeed, 45, Form::Signed(4), 10.0 * FPM),
    field(P::StaticAirTemperature, 49, Form::Signed(3), 1.0).from(ICE),
    field(P::TrueAirspeed, 52, Form::Digits(4), 0.1 * KNOT),
    field(P::BaroSetting, 56, Form::Digits(3), 0.01 * INHG).from(27.5 * INHG),
    field(P::DensityAltitude, 59, Form::Signed(6), FOOT),
    field(P::WindDirectionMagnetic, 65, Form::Digits(3), DEGREE),
    field(P::WindSpeed, 68, Form::Digits(2), KNOT),
];

const SYSTEM: [Field; 7] = [
    field(P::SelectedHeading, 11, Form::Digits(3), DEGREE),
    field(P::SelectedAltitude, 14, Form::Signed(5), 10.0 * FOOT),
    field(P::SelectedAirspeed, 19, Form::Digits(4), 0.1 * KNOT),
    field(P::SelectedVerticalSpeed, 23, Form::Signed(4), 10.0 * FPM),
    field(P::SelectedCourse, 27, Form::Digits(3), DEGREE),
    field(P::CourseDeflection, 34, Form::Signed(3), 0.01),
    field(P::GlidePathDeflection, 37, Form::Signed(3), 0.01),
];

const ENGINE: [Field; 14] = [
    field(P::OilPressure, 11, Form::Digits(3), PSI),
    field(P::OilTemperature, 14, Form::Signed(4), 1.0).from(ICE),
    field(P::EngineSpeed, 18, Form::Digits(4), 1.0),
    field(P::ManifoldPressure, 26, Form::Digits(3), 0.1 * INHG),
    field(engines::FUEL_FLOW[0], 29, Form::Digits(3), 0.1 * GALLON),
    field(P::FuelPressure, 35, Form::Digits(3), 0.1 * PSI),
    field(FUEL_QUANTITY[0], 38, Form::Digits(3), 0.1 * GALLON),
    field(FUEL_QUANTITY[1], 41, Form::Digits(3), 0.1 * GALLON),
    field(BUS_VOLTAGE[0], 47, Form::Digits(3), 0.1),
    field(BUS_VOLTAGE[1], 50, Form::Digits(3), 0.1),
    field(P::EngineTime, 57, Form::Digits(5), 0.1),
    field(P::FuelRemaining, 44, Form::Digits(3), 0.1 * GALLON),
    field(P::TachometerTime, 62, Form::Digits(5), 0.1),
    field(P::EnginePower, 217, Form::Digits(3), 1.0),
];

impl Encoder for DynonSkyView {
    fn beats(&self) -> &'static [Beat] {
        &BEATS
    }

    fn write(&mut self, message: usize, truth: &Truth, send: Send<'_>) {
        let (kind, length, fields): (&str, usize, &[Field]) = match message {
            0 => ("!11", 72, &ADAHRS),
            1 => ("!22", 91, &SYSTEM),
            _ => ("!32", 223, &ENGINE),
        };
        let mut line = vec![b'X'; length];
        put(&mut line, 0, kind);
        put(&mut line, 3, &time(truth, 16.0, "--------"));
        put_columns(&mut line, fields, truth, Some(b'X'));
        send(Wire::Stream(&summed(line)));
    }

    fn carries(&self, parameter: Parameter) -> Option<Carried> {
        carries_time(parameter)
            .or_else(|| carried_by(&[&ADAHRS, &SYSTEM, &ENGINE], parameter, true))
    }
}

/// `HHMMSS` and a part of the second, counted in `parts`.
pub(super) fn time(truth: &Truth, parts: f64, absent: &str) -> String {
    clock(truth).map_or_else(
        || absent.to_owned(),
        |[h, m, s, rest]| format!("{h:02.0}{m:02.0}{s:02.0}{:02}", whole(rest * parts)),
    )
}

/// Whole seconds of the day, in a line that has them.
pub(super) fn carries_time(parameter: Parameter) -> Option<Carried> {
    (parameter == P::UtcTimeOfDay).then_some(Carried {
        resolution: 1.0,
        min: 0.0,
        max: 86_399.0,
        absent: true,
        nan: false,
        doubtful: false,
    })
}

/// The line with the sum of its characters in place of its last two, and its end.
pub(super) fn summed(mut line: Vec<u8>) -> Vec<u8> {
    let end = line.len() - 2;
    let sum = line[..end].iter().fold(0_u8, |sum, b| sum.wrapping_add(*b));
    put(&mut line, end, &format!("{sum:02X}"));
    line.extend(b"\r\n");
    line
}
