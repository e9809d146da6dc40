//! CANaerospace 1.7: three nodes, an attitude and heading computer 50 times a second, an air data computer 10 times, a receiver
//! for satellite navigation 10 times; an engine monitor twice.
//!
//! Source: Stock Flight Systems, CANaerospace interface specification, revision 1.7: frame (section 2), data types (table 2.2),
//! default identifier distribution (section 4). FLOAT but for latitude and longitude, which are DOUBLEH and DOUBLEL; a value
//! that is missing is NODATA. The message code counts each identifier's messages.

use super::field::{DEGREE, Field, Form, field};
use super::{Beat, Carried, Encoder, Send};
use crate::angle::wrap_signed;
use crate::bench::truth::Truth;
use crate::sampled::Invalid;
use crate::signal::Parameter as P;
use crate::signal::{BUS_VOLTAGE, CanData, Parameter, Wire, engines};
use crate::units::Radians;

use Form::{F32, F64};

/// The nodes of an aircraft. They remember how many messages they have sent of each identifier.
#[derive(Clone, Debug)]
pub struct CanAerospace {
    first_node: u8,
    extended: bool,
    codes: [u8; ROWS],
}

const BEATS: [Beat; 4] = [
    Beat::ms(20, 0),
    Beat::ms(100, 20),
    Beat::ms(100, 60),
    Beat::ms(500, 80),
];

const NODATA: u8 = 0;
const FLOAT: u8 = 2;
const DOUBLEH: u8 = 30;
const DOUBLEL: u8 = 31;

/// By identifier, which stands where other protocols have a column.
const fn row(id: usize, parameter: Parameter, step: f64) -> Field {
    field(parameter, id, F32, step)
}

const ATTITUDE: [Field; 11] = [
    row(300, P::LongitudinalAcceleration, 1.0),
    row(301, P::LateralAcceleration, 1.0),
    row(302, P::NormalAcceleration, 1.0),
    row(303, P::PitchRate, DEGREE),
    row(304, P::RollRate, DEGREE),
    row(305, P::YawRate, DEGREE),
    row(311, P::Pitch, DEGREE),
    row(312, P::Roll, DEGREE),
    row(327, P::TurnRate, DEGREE),
    row(1069, P::HeadingMagnetic, DEGREE),
    row(1133, P::HeadingTrue, DEGREE),
];

const AIR: [Field; 18] = [
    row(313, P::Sideslip, DEGREE),
    row(314, P::VerticalSpeed, 1.0),
    row(315, P::IndicatedAirspeed, 1.0),
    row(316, P::TrueAirspeed, 1.0),
    row(317, P::CalibratedAirspeed, 1.0),
    row(319, P::BaroSetting, 1.0),
    row(320, P::BaroAltitude, 1.0),
    row(322, P::PressureAltitude, 1.0),
    row(324, P::StaticAirTemperature, 1.0),
    row(328, P::AngleOfAttack, DEGREE),
    row(332, P::AltitudeMsl, 1.0),
    row(318, P::MachNumber, 1.0),
    row(323, P::TotalAirTemperature, 1.0),
    row(325, P::DifferentialPressure, 1.0),
    row(326, P::StaticPressure, 1.0),
    row(333, P::WindSpeed, 1.0),
    row(334, P::WindDirectionTrue, DEGREE),
    row(339, P::TotalPressure, 1.0),
];

const RECEIVER: [Field; 5] = [
    field(P::Latitude, 1036, F64, DEGREE),
    field(P::Longitude, 1037, F64, DEGREE),
    row(1038, P::HeightEllipsoid, 1.0),
    row(1039, P::GroundSpeed, 1.0),
    row(1040, P::Track, DEGREE),
];

/// Identifiers of the first engine's channel; the second engine's are the next ones.
const BY_ENGINE: [(usize, [Parameter; 2]); 9] = [
    (500, engines::SPEED),
    (504, engines::PROPELLER_SPEED),
    (512, engines::TURBINE_INLET_TEMPERATURE),
    (524, engines::FUEL_FLOW),
    (528, engines::MANIFOLD_PRESSURE),
    (532, engines::OIL_PRESSURE),
    (536, engines::OIL_TEMPERATURE),
    (548, engines::COOLANT_TEMPERATURE),
    (684, engines::FUEL_PRESSURE),
];

/// The first cylinders stand for all.
const SINGLE: [Field; 6] = [
    row(520, engines::EXHAUST_GAS_TEMPERATURE[0][0], 1.0),
    row(521, engines::EXHAUST_GAS_TEMPERATURE[1][0], 1.0),
    row(540, engines::CYLINDER_HEAD_TEMPERATURE[0][0], 1.0),
    row(541, engines::CYLINDER_HEAD_TEMPERATURE[1][0], 1.0),
    row(920, BUS_VOLTAGE[0], 1.0),
    row(921, BUS_VOLTAGE[1], 1.0),
];

const ENGINE: [Field; 2 * BY_ENGINE.len() + SINGLE.len()] = {
    let mut rows = [SINGLE[0]; 2 * BY_ENGINE.len() + SINGLE.len()];
    let mut n = 0;
    while n < rows.len() {
        rows[n] = if n < SINGLE.len() {
            SINGLE[n]
        } else {
            let n = n - SINGLE.len();
            let (id, parameters) = BY_ENGINE[n / 2];
            row(id + n % 2, parameters[n % 2], 1.0)
        };
        n += 1;
    }
    rows
};

const GROUPS: [&[Field]; 4] = [&ATTITUDE, &AIR, &RECEIVER, &ENGINE];
const ROWS: usize = ATTITUDE.len() + AIR.len() + RECEIVER.len() + ENGINE.len();

impl CanAerospace {
    /// Nodes 1 to 4 with 11-bit identifiers.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            first_node: 1,
            extended: false,
            codes: [0; ROWS],
        }
    }

    /// Four nodes from this number on, whose next message codes are `code`.
    #[must_use]
    pub const fn with_nodes(first_node: u8, code: u8) -> Self {
        Self {
            first_node,
            extended: false,
            codes: [code; ROWS],
        }
    }

    /// The same with 29-bit identifiers.
    #[must_use]
    pub const fn extended(mut self) -> Self {
        self.extended = true;
        self
    }

    fn frame(
        &mut self,
        field: &Field,
        [node, data_type]: [u8; 2],
        row: usize,
        bits: u32,
    ) -> CanData {
        let [a, b, c, d] = bits.to_be_bytes();
        let code = self.codes[row];
        self.codes[row] = code.wrapping_add(1);
        CanData {
            id: u32::try_from(field.at).unwrap_or(0),
            extended: self.extended,
            len: if data_type == NODATA { 4 } else { 8 },
            data: [node, data_type, 0, code, a, b, c, d],
        }
    }
}

impl Default for CanAerospace {
    fn default() -> Self {
        Self::new()
    }
}

impl Encoder for CanAerospace {
    fn beats(&self) -> &'static [Beat] {
        &BEATS
    }

    fn write(&mut self, message: usize, truth: &Truth, send: Send<'_>) {
        let first_row: usize = GROUPS[..message].iter().map(|fields| fields.len()).sum();
        let node = self.first_node + u8::try_from(message).unwrap_or(0);
        for (n, field) in GROUPS[message].iter().enumerate() {
            let row = first_row + n;
            let value = match (truth.get(field.parameter), field.parameter) {
                (Err(Invalid::NeverReceived), _) => continue,
                (Err(_), _) => {
                    send(Wire::Can(self.frame(field, [node, NODATA], row, 0)));
                    continue;
                }
                // Directions are signed here.
                (Ok(x), P::HeadingMagnetic | P::HeadingTrue | P::Track | P::WindDirectionTrue)
                    if parameter_has(field, x) =>
                {
                    wrap_signed(Radians(x)).0
                }
                (Ok(x), _) => x,
            };
            let Some(wire) = field.steps(value) else {
                continue;
            };
            if field.form == F64 {
                let bits = wire.to_bits().to_be_bytes();
                let [a, b, c, d, e, f, g, h] = bits;
                for (data_type, half) in [(DOUBLEH, [a, b, c, d]), (DOUBLEL, [e, f, g, h])] {
                    let bits = u32::from_be_bytes(half);
                    send(Wire::Can(self.frame(field, [node, data_type], row, bits)));
                }
            } else {
                #[expect(clippy::cast_possible_truncation, reason = "FLOAT has 32 bits")]
                let bits = (wire as f32).to_bits();
                send(Wire::Can(self.frame(field, [node, FLOAT], row, bits)));
            }
        }
    }

    fn is_on_can(&self) -> bool {
        true
    }

    fn carries(&self, parameter: Parameter) -> Option<Carried> {
        super::field::carried_by(&GROUPS, parameter, true)
    }
}

/// Whether it is a direction: what is none goes out as it is.
fn parameter_has(field: &Field, x: f64) -> bool {
    field.parameter.check(x).is_ok()
}
