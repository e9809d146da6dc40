//! Dynon EFIS-D10, D10A and D100: lines of 51 characters, 64 a second; every other line has displayed altitude and turn rate,
//! the others pressure altitude and vertical speed.
//!
//! Source: Dynon Avionics, "EFIS-D100 Pilot's User Guide", appendix A. There is no sentinel: a line that lacks a value is not
//! sent.

use super::dynon_skyview::{summed, time};
use super::field::{DEGREE, FOOT, Field, Form, carried_by, field, put, put_columns};
use super::{Beat, Carried, Encoder, Send};
use crate::bench::truth::Truth;
use crate::signal::Parameter as P;
use crate::signal::{Parameter, Wire};
use std::time::Duration;

/// One instrument. It remembers which of the two kinds of line comes next.
#[derive(Clone, Copy, Debug, Default)]
pub struct DynonD100 {
    lines: usize,
}

impl DynonD100 {
    /// Before its first line.
    #[must_use]
    pub const fn new() -> Self {
        Self { lines: 0 }
    }
}

const BEATS: [Beat; 1] = [Beat {
    every: Duration::from_micros(15_625),
    first: Duration::ZERO,
}];

const ALWAYS: [Field; 7] = [
    field(P::Pitch, 8, Form::Signed(4), 0.1 * DEGREE),
    field(P::Roll, 12, Form::Signed(5), 0.1 * DEGREE),
    field(P::HeadingMagnetic, 17, Form::Digits(3), DEGREE),
    // m/s
    field(P::IndicatedAirspeed, 20, Form::Digits(4), 0.1),
    // Positive to the left.
    field(P::LateralAcceleration, 33, Form::Signed(3), -0.01),
    field(P::NormalAcceleration, 36, Form::Signed(3), 0.1),
    field(P::AngleOfAttackUsed, 39, Form::Digits(2), 1.0),
];

/// By bit 0 of the status. Altitude in metres, vertical speed in feet a second.
const BY_TURNS: [[Field; 2]; 2] = [
    [
        field(P::BaroAltitude, 24, Form::Signed(5), 1.0),
        field(P::TurnRate, 29, Form::Signed(4), 0.1 * DEGREE),
    ],
    [
        field(P::PressureAltitude, 24, Form::Signed(5), 1.0),
        field(P::VerticalSpeed, 29, Form::Signed(4), 0.1 * FOOT),
    ],
];

impl Encoder for DynonD100 {
    fn beats(&self) -> &'static [Beat] {
        &BEATS
    }

    fn write(&mut self, _message: usize, truth: &Truth, send: Send<'_>) {
        let kind = self.lines % 2;
        self.lines = self.lines.wrapping_add(1);
        let mut line = vec![b'0'; 51];
        put(&mut line, 0, &time(truth, 64.0, "00000000"));
        put(&mut line, 46, &kind.to_string());
        if put_columns(&mut line, &ALWAYS, truth, None)
            && put_columns(&mut line, &BY_TURNS[kind], truth, None)
        {
            send(Wire::Stream(&summed(line)));
        }
    }

    fn carries(&self, parameter: Parameter) -> Option<Carried> {
        carried_by(&[&ALWAYS, &BY_TURNS[0], &BY_TURNS[1]], parameter, false)
    }
}
