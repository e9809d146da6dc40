//! CAN-FIX: four nodes (attitude 20 times a second, air data 10, navigation 5, engine 2), each with its status once a second.
//!
//! Source: MakerPlane, "CAN-FIX Specification", version 0.7 (`canfix.json`; tables of node control codes and node status). A
//! frame is node, index, function, value, little-endian; the function's bit 2 says that the value has failed, bit 1 that it
//! is doubtful.

use super::field::{
    DEGREE, FOOT, FPM, Field, Form, GALLON, ICE, INHG, KNOT, PSI, calendar, clock, field, whole,
};
use super::{Beat, Carried, Encoder, Send};
use crate::bench::truth::Truth;
use crate::sampled::Invalid;
use crate::signal::Parameter as P;
use crate::signal::{BUS_CURRENT, BUS_VOLTAGE, CanData, FUEL_QUANTITY, Parameter, Wire, engines};
use crate::units::METRES_PER_NAUTICAL_MILE;

/// The four nodes of an aircraft.
#[derive(Clone, Copy, Debug)]
pub struct CanFix {
    first_node: u8,
}

impl CanFix {
    /// Nodes 1 to 4: attitude, air data, navigation, engine.
    #[must_use]
    pub const fn new() -> Self {
        Self::with_nodes(1)
    }

    /// Four nodes from this number on.
    #[must_use]
    pub const fn with_nodes(first_node: u8) -> Self {
        Self { first_node }
    }
}

impl Default for CanFix {
    fn default() -> Self {
        Self::new()
    }
}

const BEATS: [Beat; 5] = [
    Beat::ms(50, 0),
    Beat::ms(100, 12),
    Beat::ms(200, 24),
    Beat::ms(500, 36),
    Beat::ms(1000, 48),
];

/// A parameter by its identifier, which stands where other protocols have a column, and its index.
const fn row(id: usize, parameter: Parameter, form: Form, step: f64) -> (Field, u8) {
    (field(parameter, id, form, step), 0)
}

const fn celsius(id: usize, parameter: Parameter, form: Form, step: f64) -> (Field, u8) {
    (field(parameter, id, form, step).from(ICE), 0)
}

use Form::{F32, I16, I32, U16};

const ATTITUDE: [(Field, u8); 11] = [
    row(0x180, P::Pitch, I16, 0.01 * DEGREE),
    row(0x181, P::Roll, I16, 0.01 * DEGREE),
    row(0x182, P::AngleOfAttack, I16, 0.01 * DEGREE),
    row(0x185, P::HeadingMagnetic, U16, 0.1 * DEGREE),
    row(0x18A, P::NormalAcceleration, I16, 0.001),
    row(0x18B, P::LateralAcceleration, I16, 0.001),
    row(0x18C, P::LongitudinalAcceleration, I16, 0.001),
    row(0x400, P::PitchRate, I16, 0.1 * DEGREE),
    row(0x401, P::RollRate, I16, 0.1 * DEGREE),
    row(0x402, P::YawRate, I16, 0.1 * DEGREE),
    row(0x403, P::TurnRate, I16, 0.1 * DEGREE),
];

const AIR: [(Field, u8); 17] = [
    row(0x145, P::FlapAngle, I16, 0.01 * DEGREE),
    row(0x183, P::IndicatedAirspeed, U16, 0.1 * KNOT),
    row(0x184, P::BaroAltitude, I32, FOOT),
    row(0x186, P::VerticalSpeed, I16, FPM),
    row(0x187, P::TotalEnergyVerticalSpeed, I16, 0.01 * KNOT),
    row(0x188, P::HeightAgl, U16, FOOT),
    row(0x18D, P::TrueAirspeed, U16, 0.1 * KNOT),
    row(0x18E, P::CalibratedAirspeed, U16, 0.1 * KNOT),
    row(0x18F, P::MachNumber, U16, 0.01),
    row(0x190, P::BaroSetting, U16, 0.001 * INHG),
    row(0x191, P::PressureAltitude, I32, FOOT),
    row(0x404, P::StaticPressure, U16, 0.001 * INHG),
    row(0x405, P::TotalPressure, U16, 0.001 * INHG),
    celsius(0x406, P::TotalAirTemperature, I16, 0.01),
    celsius(0x407, P::StaticAirTemperature, I16, 0.01),
    row(0x408, P::DensityAltitude, I32, FOOT),
    row(0x40B, P::WindSpeed, U16, 0.1 * KNOT),
];

const NAVIGATION: [(Field, u8); 15] = [
    row(0x40C, P::WindDirectionMagnetic, U16, 0.01 * DEGREE),
    row(0x1C1, P::GlidePathDeviation, I16, 0.01 * DEGREE),
    row(0x1C3, P::Latitude, F32, DEGREE),
    row(0x1C4, P::Longitude, F32, DEGREE),
    row(0x1C5, P::GroundSpeed, U16, 0.1 * KNOT),
    row(0x1C6, P::Track, U16, 0.1 * DEGREE),
    row(0x1C7, P::TrackMagnetic, U16, 0.1 * DEGREE),
    row(0x1C8, P::CrossTrack, I16, 0.01 * METRES_PER_NAUTICAL_MILE),
    row(0x1C9, P::SelectedCourse, U16, 0.1 * DEGREE),
    row(0x1CB, P::SelectedVerticalSpeed, I16, FPM),
    row(0x1CC, P::SelectedAirspeed, U16, 0.1 * KNOT),
    row(0x1CD, P::SelectedAltitude, I32, FOOT),
    row(0x1CF, P::HorizontalAccuracy, U16, FOOT),
    row(0x1D0, P::VerticalAccuracy, U16, FOOT),
    row(0x40A, P::AltitudeMsl, I32, FOOT),
];

/// The identifiers that have two instances, by engine; those of cylinders, tanks and buses are counted up below.
const BY_ENGINE: [(usize, [Parameter; 2], f64, f64); 12] = [
    (0x200, engines::SPEED, 1.0, 0.0),
    (0x202, engines::PROPELLER_SPEED, 1.0, 0.0),
    (0x206, engines::TURBINE_INLET_TEMPERATURE, 0.1, ICE),
    (0x21A, engines::FUEL_FLOW, 0.01 * GALLON, 0.0),
    (0x21C, engines::FUEL_PRESSURE, 0.01 * PSI, 0.0),
    (0x21E, engines::MANIFOLD_PRESSURE, 0.01 * INHG, 0.0),
    (0x220, engines::OIL_PRESSURE, 0.01 * PSI, 0.0),
    (0x222, engines::OIL_TEMPERATURE, 0.1, ICE),
    (0x224, engines::COOLANT_TEMPERATURE, 0.1, ICE),
    (0x50C, engines::CARBURETTOR_TEMPERATURE, 0.1, ICE),
    (0x51E, engines::POWER, 0.1, 0.0),
    (0x520, engines::TIME, 0.1, 0.0),
];

const ENGINE_ROWS: usize = 2 * BY_ENGINE.len() + 24 + 8;

const ENGINE: [(Field, u8); ENGINE_ROWS] = {
    let mut rows = [row(0x226, FUEL_QUANTITY[0], U16, 0.01 * GALLON); ENGINE_ROWS];
    let mut n = 0;
    while n < 4 {
        rows[n] = row(0x226 + n, FUEL_QUANTITY[n], U16, 0.01 * GALLON);
        n += 1;
    }
    n = 0;
    while n < 2 {
        rows[4 + n] = row(0x50E + n, BUS_VOLTAGE[n], U16, 0.1);
        rows[6 + n] = row(0x512 + n, BUS_CURRENT[n], U16, 0.1);
        n += 1;
    }
    n = 0;
    while n < 24 {
        let (engine, cylinder) = (n / 12, n % 6);
        let heads = engines::CYLINDER_HEAD_TEMPERATURE[engine];
        let exhausts = engines::EXHAUST_GAS_TEMPERATURE[engine];
        let (id, parameter) = if n % 12 < 6 {
            (0x500 + engine, heads[cylinder])
        } else {
            (0x502 + engine, exhausts[cylinder])
        };
        #[expect(clippy::cast_possible_truncation, reason = "below six")]
        let index = cylinder as u8;
        rows[8 + n] = (field(parameter, id, U16, 0.1).from(ICE), index);
        n += 1;
    }
    n = 0;
    while n < 2 * BY_ENGINE.len() {
        let (id, parameters, step, zero) = BY_ENGINE[n / 2];
        rows[32 + n] = (
            field(parameters[n % 2], id + n % 2, U16, step).from(zero),
            0,
        );
        n += 1;
    }
    rows
};

const GROUPS: [&[(Field, u8)]; 4] = [&ATTITUDE, &AIR, &NAVIGATION, &ENGINE];

/// Node-specific frames: this and the node's number.
const NODE_BASE: u32 = 0x6E0;
/// Control code of node status; its parameter 0 with value 0 says that all is well.
const NODE_STATUS: u8 = 6;

impl Encoder for CanFix {
    fn beats(&self) -> &'static [Beat] {
        &BEATS
    }

    fn write(&mut self, message: usize, truth: &Truth, send: Send<'_>) {
        let node = |n: usize| self.first_node + u8::try_from(n).unwrap_or(0);
        let Some(rows) = GROUPS.get(message) else {
            for n in 0..GROUPS.len() {
                let id = NODE_BASE + u32::from(node(n));
                send(Wire::Can(can(id, &[NODE_STATUS, 0, 0, 0, 0])));
            }
            return;
        };
        for (field, index) in *rows {
            if let Some(can) = frame(field, node(message), *index, truth) {
                send(Wire::Can(can));
            }
        }
        if message == 2 {
            clock_frames(node(message), truth, send);
        }
    }

    fn is_on_can(&self) -> bool {
        true
    }

    fn carries(&self, parameter: Parameter) -> Option<Carried> {
        let whole = |resolution, max| Carried {
            resolution,
            min: 0.0,
            max,
            absent: true,
            nan: false,
            doubtful: true,
        };
        match parameter {
            P::UtcTimeOfDay => return Some(whole(1e-3, 86_399.999)),
            P::UtcDate => return Some(whole(1.0, 73_000.0)),
            _ => {}
        }
        let mut rows = GROUPS.iter().flat_map(|rows| rows.iter());
        let (field, _) = rows.find(|(field, _)| field.parameter == parameter)?;
        Some(Carried {
            doubtful: true,
            ..field.carried(true)
        })
    }
}

/// The function byte for a value, or that it is not fitted.
fn function<T>(value: &Result<T, Invalid>) -> Option<u8> {
    match value {
        Ok(_) => Some(0),
        Err(Invalid::NeverReceived) => None,
        Err(Invalid::Doubtful) => Some(2),
        Err(_) => Some(4),
    }
}

fn frame(field: &Field, node: u8, index: u8, truth: &Truth) -> Option<CanData> {
    let value = field.told(truth);
    let function = function(&value)?;
    let steps = value.unwrap_or(0.0);
    #[expect(clippy::cast_possible_truncation, reason = "FLOAT has 32 bits")]
    let bytes = match field.form {
        F32 => (steps as f32).to_le_bytes(),
        _ => {
            let [a, b, c, d, ..] = whole(steps).to_le_bytes();
            [a, b, c, d]
        }
    };
    let width = if matches!(field.form, F32 | I32) {
        4
    } else {
        2
    };
    let mut data = [node, index, function, 0, 0, 0, 0];
    data[3..].copy_from_slice(&bytes);
    let id = u32::try_from(field.at).unwrap_or(0);
    Some(can(id, &data[..3 + width]))
}

/// Time and date of day, UTC.
fn clock_frames(node: u8, truth: &Truth, send: Send<'_>) {
    let byte = |x: f64| whole(x).to_le_bytes()[0];
    let said = |parameter, there: bool| {
        let value = truth.get(parameter);
        function(&value.and(there.then_some(()).ok_or(Invalid::OutOfRange)))
    };
    let time = clock(truth);
    if let Some(function) = said(P::UtcTimeOfDay, time.is_some()) {
        let [h, m, s, rest] = time.unwrap_or([0.0; 4]);
        let [low, high, ..] = whole((rest * 1000.0).floor()).to_le_bytes();
        let data = [node, 0, function, byte(h), byte(m), byte(s), low, high];
        send(Wire::Can(can(0x580, &data)));
    }
    let date = calendar(truth);
    if let Some(function) = said(P::UtcDate, date.is_some()) {
        let [y, m, d] = date.unwrap_or([1970, 1, 1]);
        let [low, high, ..] = y.to_le_bytes();
        let [m, d] = [m, d].map(|n| n.to_le_bytes()[0]);
        send(Wire::Can(can(0x581, &[node, 0, function, low, high, m, d])));
    }
}

/// An 11-bit frame.
pub(super) fn can(id: u32, bytes: &[u8]) -> CanData {
    let mut data = [0; 8];
    data[..bytes.len()].copy_from_slice(bytes);
    CanData {
        id,
        extended: false,
        len: u8::try_from(bytes.len()).unwrap_or(8),
        data,
    }
}
