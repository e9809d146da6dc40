//! Garmin G3X: lines `=11` (attitude and air data) 10 times a second, `=31` (engine) 5, `=21` (air data, bugs) 2 and `=71` (height
//! above ground) once, as in recordings; and `@` ([`position`]), which a display is set up to send or not.
//!
//! Source: Garmin, "G3X/G3X Touch Installation Manual", 190-01115-01, appendix "RS-232 Text Output Format". Fields without a
//! value are filled with `_`; the last two characters are the sum of all before them, but for `@`, which has none: nothing
//! protects it, and beside the other lines it would only make the ground speed doubtful.

use super::dynon_skyview::{carries_time, summed, time};
use super::field::{
    DEGREE, FOOT, FPM, Field, Form, GALLON, ICE, INHG, KNOT, PSI, calendar, carried_by, clock,
    field, put, put_columns,
};
use super::{Beat, Carried, Encoder, Send};
use crate::bench::truth::Truth;
use crate::signal::Parameter as P;
use crate::signal::{BUS_VOLTAGE, FUEL_QUANTITY, Parameter, Wire, engines};

/// One display.
#[derive(Clone, Copy, Debug)]
pub struct GarminG3x;

const BEATS: [Beat; 4] = [
    Beat::ms(100, 0),
    Beat::ms(200, 30),
    Beat::ms(500, 60),
    Beat::ms(1000, 80),
];

const ATTITUDE: [Field; 12] = [
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
    field(P::BaroSetting, 52, Form::Digits(3), 0.01 * INHG).from(27.5 * INHG),
];

const AIR: [Field; 6] = [
    field(P::TrueAirspeed, 11, Form::Digits(4), 0.1 * KNOT),
    field(P::DensityAltitude, 15, Form::Signed(6), FOOT),
    field(P::SelectedHeading, 21, Form::Digits(3), DEGREE),
    field(P::SelectedAltitude, 24, Form::Signed(6), FOOT),
    field(P::SelectedAirspeed, 30, Form::Digits(4), 0.1 * KNOT),
    field(P::SelectedVerticalSpeed, 34, Form::Signed(4), 10.0 * FPM),
];

const GROUND: [Field; 2] = [
    field(P::HeightAgl, 11, Form::Digits(3), 100.0 * FOOT),
    field(P::GroundSpeed, 14, Form::Digits(4), 0.1 * KNOT),
];

const ENGINE_FIELDS: usize = 26;

/// Cylinder head and exhaust temperatures alternate, from the last cylinder to the first.
const ENGINE: [Field; ENGINE_FIELDS] = {
    let mut fields = [field(P::OilPressure, 11, Form::Digits(3), PSI); ENGINE_FIELDS];
    fields[1] = field(P::OilTemperature, 14, Form::Signed(4), 1.0).from(ICE);
    fields[2] = field(P::EngineSpeed, 18, Form::Digits(4), 1.0);
    fields[3] = field(P::ManifoldPressure, 26, Form::Digits(3), 0.1 * INHG);
    fields[4] = field(P::FuelFlow, 29, Form::Digits(3), 0.1 * GALLON);
    let mut n = 0;
    while n < 6 {
        let at = 67 + 8 * (5 - n);
        let (head, exhaust) = (
            engines::CYLINDER_HEAD_TEMPERATURE[0][n],
            engines::EXHAUST_GAS_TEMPERATURE[0][n],
        );
        fields[5 + 2 * n] = field(head, at, Form::Signed(4), 1.0).from(ICE);
        fields[6 + 2 * n] = field(exhaust, at + 4, Form::Signed(4), 1.0).from(ICE);
        n += 1;
    }
    fields[17] = field(P::TurbineInletTemperature, 115, Form::Signed(4), 1.0).from(ICE);
    fields[18] = field(P::FuelPressure, 35, Form::Digits(3), 0.1 * PSI);
    fields[19] = field(FUEL_QUANTITY[0], 38, Form::Digits(3), 0.1 * GALLON);
    fields[20] = field(FUEL_QUANTITY[1], 41, Form::Digits(3), 0.1 * GALLON);
    fields[21] = field(P::FuelRemaining, 44, Form::Digits(3), 0.1 * GALLON);
    fields[22] = field(BUS_VOLTAGE[0], 47, Form::Digits(3), 0.1);
    fields[23] = field(BUS_VOLTAGE[1], 50, Form::Digits(3), 0.1);
    fields[24] = field(P::EngineTime, 57, Form::Digits(5), 0.1);
    fields[25] = field(P::TachometerTime, 62, Form::Digits(5), 0.1);
    fields
};

impl Encoder for GarminG3x {
    fn beats(&self) -> &'static [Beat] {
        &BEATS
    }

    fn write(&mut self, message: usize, truth: &Truth, send: Send<'_>) {
        let (kind, length, fields): (&str, usize, &[Field]) = match message {
            0 => ("=11", 57, &ATTITUDE),
            1 => ("=31", 219, &ENGINE),
            2 => ("=21", 40, &AIR),
            _ => ("=71", 20, &GROUND),
        };
        let mut line = vec![b'_'; length];
        put(&mut line, 0, kind);
        put(&mut line, 3, &time(truth, 100.0, "________"));
        put_columns(&mut line, fields, truth, Some(b'_'));
        send(Wire::Stream(&summed(line)));
    }

    fn carries(&self, parameter: Parameter) -> Option<Carried> {
        carries_time(parameter)
            .or_else(|| carried_by(&[&ATTITUDE, &ENGINE, &AIR, &GROUND], parameter, true))
    }
}

/// A line of Garmin's simple text: time, place, quality, altitude and velocity.
#[must_use]
pub fn position(truth: &Truth) -> String {
    let filled = |n: usize| "_".repeat(n);
    let mut line = String::from("@");
    match (calendar(truth), clock(truth)) {
        (Some([y, m, d]), Some([hh, mm, ss, _])) => {
            line += &format!("{:02}{m:02}{d:02}{hh:02.0}{mm:02.0}{ss:02.0}", y % 100);
        }
        _ => line += &filled(12),
    }
    let thousandths = |x: f64| (x.abs().to_degrees() * 60_000.0).round();
    let letter =
        |x: f64, [positive, negative]: [char; 2]| if x < 0.0 { negative } else { positive };
    match (truth.finite(P::Latitude), truth.finite(P::Longitude)) {
        (Some(latitude), Some(longitude)) => {
            for (x, letters, width) in [(latitude, ['N', 'S'], 2), (longitude, ['E', 'W'], 3)] {
                let minutes = thousandths(x);
                let (degrees, rest) = ((minutes / 60_000.0).floor(), minutes % 60_000.0);
                line += &format!("{}{degrees:0width$.0}{rest:05.0}", letter(x, letters));
            }
            line += "G003";
        }
        _ => line += &filled(21),
    }
    match truth.finite(P::AltitudeMsl) {
        Some(altitude) => line += &format!("{:+06.0}", altitude.clamp(-99_999.0, 99_999.0)),
        None => line += &filled(6),
    }
    let tenths = |x: f64| (x.abs() * 10.0).min(9999.0);
    match (truth.finite(P::GroundSpeed), truth.finite(P::Track)) {
        (Some(speed), Some(track)) => {
            let (north, east) = (speed * track.cos(), speed * track.sin());
            line += &format!("{}{:04.0}", letter(east, ['E', 'W']), tenths(east));
            line += &format!("{}{:04.0}", letter(north, ['N', 'S']), tenths(north));
        }
        _ => line += &filled(10),
    }
    match truth.finite(P::VerticalSpeed) {
        Some(up) => line += &format!("{}{:04.0}", letter(up, ['U', 'D']), tenths(up)),
        None => line += &filled(5),
    }
    line + "\r\n"
}
