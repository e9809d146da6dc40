//! CAN-FIX, MakerPlane's open bus for experimental aircraft: 11-bit identifiers, little-endian.
//!
//! Source: MakerPlane, "CAN-FIX Specification", version 0.7 (`canfix.json`, `framedef.rst`). A parameter's frame is: node,
//! index, function, then the value. Identifiers, units and scales are those of its tables; an identifier that has an
//! instance for each of two engines (tanks, electrical buses) counts up by one.
//!
//! The function's bits 4 to 7 are the *meta* code: when they are not zero, the frame has a limit of the parameter, never its
//! value. Bit 2 says that the value has failed ([`Invalid::SourceFailed`]), bit 1 that its sender doubts it
//! ([`Invalid::Doubtful`]). There are no other sentinels. Bit 0, annunciate, changes nothing about the value's right to be shown.
//!
//! Several nodes may send the same parameter: the first heard is listened to, until it fails, doubts or falls silent for the
//! parameter's greatest age. A node must say something every two seconds ([`NODE_AGE_MAX`]); when it has not, all that was
//! taken from it has failed at once, whatever its age.
//!
//! Not read: control inputs and positions but the flaps, waypoints, radios, the ADS-B pages (their fields come in separate
//! frames that nothing holds together), VOR deviation (whose range and sign the tables leave open), switches.

use super::emit::{Emit, celsius, compass, date_days, feet, fpm, inches_of_mercury, knots, same};
use super::{Counters, Decoder, Fault};
use crate::sampled::Invalid;
use crate::signal::Parameter as P;
use crate::signal::{
    BUS_CURRENT, BUS_VOLTAGE, CanData, FUEL_QUANTITY, Frame, Limit, Parameter, Sink, Wire, engines,
};
use crate::time::Monotonic;
use crate::units::{HECTOPASCALS_PER_PSI, LITRES_PER_US_GALLON, METRES_PER_NAUTICAL_MILE};
use std::time::Duration;

/// The longest that a node may be silent.
pub const NODE_AGE_MAX: Duration = Duration::from_secs(2);

/// How often nodes are looked after.
const CHECK_EVERY: Duration = Duration::from_millis(50);

/// Node-specific messages: this plus the node's number.
const NODE_BASE: u32 = 0x6E0;
const NODE_LAST: u32 = 0x7DF;
/// Parameters.
const PARAMETER_FIRST: u32 = 0x100;

const HEADER_BYTES: usize = 3;

/// The value's type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Int,
    Uint,
    Dint,
    Float,
}

impl Kind {
    const fn bytes(self) -> usize {
        match self {
            Self::Int | Self::Uint => 2,
            Self::Dint | Self::Float => 4,
        }
    }

    fn number(self, value: [u8; 4]) -> f64 {
        let [a, b, ..] = value;
        match self {
            Self::Int => f64::from(i16::from_le_bytes([a, b])),
            Self::Uint => f64::from(u16::from_le_bytes([a, b])),
            Self::Dint => f64::from(i32::from_le_bytes(value)),
            Self::Float => f64::from(f32::from_le_bytes(value)),
        }
    }
}

/// What a meta code means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Meta {
    /// Nothing that is shown.
    None,
    Airspeed,
    Engine,
}

impl Meta {
    const fn kind(self, code: u8) -> Option<&'static str> {
        match (self, code) {
            (Self::None, _) => None,
            (_, 1) => Some("minimum"),
            (_, 2) => Some("maximum"),
            (Self::Airspeed, _) => match code {
                3 => Some("v1"),
                4 => Some("v2"),
                5 => Some("vne"),
                6 => Some("vfe"),
                7 => Some("vmc"),
                8 => Some("va"),
                9 => Some("vno"),
                10 => Some("vs"),
                11 => Some("vs0"),
                14 => Some("vx"),
                15 => Some("vy"),
                _ => None,
            },
            (Self::Engine, 4) => Some("low-warning"),
            (Self::Engine, 5) => Some("low-alarm"),
            (Self::Engine, 6) => Some("high-warning"),
            (Self::Engine, 7) => Some("high-alarm"),
            (Self::Engine, _) => None,
        }
    }
}

/// One identifier: its parameters by index, its type, what a unit of it is, how that becomes the parameter's unit.
struct Row {
    id: u16,
    parameters: &'static [Parameter],
    kind: Kind,
    unit: f64,
    to_si: fn(f64) -> f64,
    meta: Meta,
}

const fn row(
    id: u16,
    parameters: &'static [Parameter],
    kind: Kind,
    unit: f64,
    to_si: fn(f64) -> f64,
) -> Row {
    Row {
        id,
        parameters,
        kind,
        unit,
        to_si,
        meta: Meta::None,
    }
}

const fn limited(mut row: Row, meta: Meta) -> Row {
    row.meta = meta;
    row
}

const fn engine(
    id: u16,
    parameters: &'static [Parameter],
    unit: f64,
    to_si: fn(f64) -> f64,
) -> Row {
    limited(row(id, parameters, Kind::Uint, unit, to_si), Meta::Engine)
}

fn psi(x: f64) -> f64 {
    x * HECTOPASCALS_PER_PSI
}

fn gallons(x: f64) -> f64 {
    x * LITRES_PER_US_GALLON
}

fn nautical_miles(x: f64) -> f64 {
    x * METRES_PER_NAUTICAL_MILE
}

/// The identifiers, ascending.
const ROWS: [Row; 80] = [
    row(0x145, &[P::FlapAngle], Kind::Int, 0.01, f64::to_radians),
    row(0x180, &[P::Pitch], Kind::Int, 0.01, f64::to_radians),
    row(0x181, &[P::Roll], Kind::Int, 0.01, f64::to_radians),
    row(0x182, &[P::AngleOfAttack], Kind::Int, 0.01, f64::to_radians),
    limited(
        row(0x183, &[P::IndicatedAirspeed], Kind::Uint, 0.1, knots),
        Meta::Airspeed,
    ),
    row(0x184, &[P::BaroAltitude], Kind::Dint, 1.0, feet),
    row(0x185, &[P::HeadingMagnetic], Kind::Uint, 0.1, compass),
    row(0x186, &[P::VerticalSpeed], Kind::Int, 1.0, fpm),
    row(
        0x187,
        &[P::TotalEnergyVerticalSpeed],
        Kind::Int,
        0.01,
        knots,
    ),
    row(0x188, &[P::HeightAgl], Kind::Uint, 1.0, feet),
    row(0x18A, &[P::NormalAcceleration], Kind::Int, 0.001, same),
    row(0x18B, &[P::LateralAcceleration], Kind::Int, 0.001, same),
    row(
        0x18C,
        &[P::LongitudinalAcceleration],
        Kind::Int,
        0.001,
        same,
    ),
    row(0x18D, &[P::TrueAirspeed], Kind::Uint, 0.1, knots),
    row(0x18E, &[P::CalibratedAirspeed], Kind::Uint, 0.1, knots),
    row(0x18F, &[P::MachNumber], Kind::Uint, 0.01, same),
    row(
        0x190,
        &[P::BaroSetting],
        Kind::Uint,
        0.001,
        inches_of_mercury,
    ),
    row(0x191, &[P::PressureAltitude], Kind::Dint, 1.0, feet),
    row(
        0x1C1,
        &[P::GlidePathDeviation],
        Kind::Int,
        0.01,
        f64::to_radians,
    ),
    row(0x1C3, &[P::Latitude], Kind::Float, 1.0, f64::to_radians),
    row(0x1C4, &[P::Longitude], Kind::Float, 1.0, f64::to_radians),
    row(0x1C5, &[P::GroundSpeed], Kind::Uint, 0.1, knots),
    row(0x1C6, &[P::Track], Kind::Uint, 0.1, compass),
    row(0x1C7, &[P::TrackMagnetic], Kind::Uint, 0.1, compass),
    row(0x1C8, &[P::CrossTrack], Kind::Int, 0.01, nautical_miles),
    row(0x1C9, &[P::SelectedCourse], Kind::Uint, 0.1, compass),
    row(0x1CB, &[P::SelectedVerticalSpeed], Kind::Int, 1.0, fpm),
    row(0x1CC, &[P::SelectedAirspeed], Kind::Uint, 0.1, knots),
    row(0x1CD, &[P::SelectedAltitude], Kind::Dint, 1.0, feet),
    row(0x1CF, &[P::HorizontalAccuracy], Kind::Uint, 1.0, feet),
    row(0x1D0, &[P::VerticalAccuracy], Kind::Uint, 1.0, feet),
    engine(0x200, &[engines::SPEED[0]], 1.0, same),
    engine(0x201, &[engines::SPEED[1]], 1.0, same),
    engine(0x202, &[engines::PROPELLER_SPEED[0]], 1.0, same),
    engine(0x203, &[engines::PROPELLER_SPEED[1]], 1.0, same),
    engine(
        0x206,
        &[engines::TURBINE_INLET_TEMPERATURE[0]],
        0.1,
        celsius,
    ),
    engine(
        0x207,
        &[engines::TURBINE_INLET_TEMPERATURE[1]],
        0.1,
        celsius,
    ),
    engine(0x21A, &[engines::FUEL_FLOW[0]], 0.01, gallons),
    engine(0x21B, &[engines::FUEL_FLOW[1]], 0.01, gallons),
    engine(0x21C, &[engines::FUEL_PRESSURE[0]], 0.01, psi),
    engine(0x21D, &[engines::FUEL_PRESSURE[1]], 0.01, psi),
    engine(
        0x21E,
        &[engines::MANIFOLD_PRESSURE[0]],
        0.01,
        inches_of_mercury,
    ),
    engine(
        0x21F,
        &[engines::MANIFOLD_PRESSURE[1]],
        0.01,
        inches_of_mercury,
    ),
    engine(0x220, &[engines::OIL_PRESSURE[0]], 0.01, psi),
    engine(0x221, &[engines::OIL_PRESSURE[1]], 0.01, psi),
    engine(0x222, &[engines::OIL_TEMPERATURE[0]], 0.1, celsius),
    engine(0x223, &[engines::OIL_TEMPERATURE[1]], 0.1, celsius),
    engine(0x224, &[engines::COOLANT_TEMPERATURE[0]], 0.1, celsius),
    engine(0x225, &[engines::COOLANT_TEMPERATURE[1]], 0.1, celsius),
    engine(0x226, &[FUEL_QUANTITY[0]], 0.01, gallons),
    engine(0x227, &[FUEL_QUANTITY[1]], 0.01, gallons),
    engine(0x228, &[FUEL_QUANTITY[2]], 0.01, gallons),
    engine(0x229, &[FUEL_QUANTITY[3]], 0.01, gallons),
    row(0x400, &[P::PitchRate], Kind::Int, 0.1, f64::to_radians),
    row(0x401, &[P::RollRate], Kind::Int, 0.1, f64::to_radians),
    row(0x402, &[P::YawRate], Kind::Int, 0.1, f64::to_radians),
    row(0x403, &[P::TurnRate], Kind::Int, 0.1, f64::to_radians),
    row(
        0x404,
        &[P::StaticPressure],
        Kind::Uint,
        0.001,
        inches_of_mercury,
    ),
    row(
        0x405,
        &[P::TotalPressure],
        Kind::Uint,
        0.001,
        inches_of_mercury,
    ),
    row(0x406, &[P::TotalAirTemperature], Kind::Int, 0.01, celsius),
    row(0x407, &[P::StaticAirTemperature], Kind::Int, 0.01, celsius),
    row(0x408, &[P::DensityAltitude], Kind::Dint, 1.0, feet),
    row(0x409, &[P::AltitudeMsl], Kind::Dint, 1.0, feet),
    row(0x40A, &[P::AltitudeMsl], Kind::Dint, 1.0, feet),
    row(0x40B, &[P::WindSpeed], Kind::Uint, 0.1, knots),
    row(
        0x40C,
        &[P::WindDirectionMagnetic],
        Kind::Uint,
        0.01,
        compass,
    ),
    engine(0x500, &engines::CYLINDER_HEAD_TEMPERATURE[0], 0.1, celsius),
    engine(0x501, &engines::CYLINDER_HEAD_TEMPERATURE[1], 0.1, celsius),
    engine(0x502, &engines::EXHAUST_GAS_TEMPERATURE[0], 0.1, celsius),
    engine(0x503, &engines::EXHAUST_GAS_TEMPERATURE[1], 0.1, celsius),
    engine(0x50C, &[engines::CARBURETTOR_TEMPERATURE[0]], 0.1, celsius),
    engine(0x50D, &[engines::CARBURETTOR_TEMPERATURE[1]], 0.1, celsius),
    engine(0x50E, &[BUS_VOLTAGE[0]], 0.1, same),
    engine(0x50F, &[BUS_VOLTAGE[1]], 0.1, same),
    engine(0x512, &[BUS_CURRENT[0]], 0.1, same),
    engine(0x513, &[BUS_CURRENT[1]], 0.1, same),
    engine(0x51E, &[engines::POWER[0]], 0.1, same),
    engine(0x51F, &[engines::POWER[1]], 0.1, same),
    engine(0x520, &[engines::TIME[0]], 0.1, same),
    engine(0x521, &[engines::TIME[1]], 0.1, same),
];

/// Hour, minute, second, milliseconds.
const TIME: u32 = 0x580;
/// Year, month, day.
const DATE: u32 = 0x581;

/// Who is listened to for one parameter.
#[derive(Clone, Copy, Debug)]
struct Owner {
    node: u8,
    id: u32,
    at: Monotonic,
}

/// The decoder. Memory: when each node was last heard, and who is listened to for each parameter; fixed.
#[derive(Debug)]
pub struct CanFix {
    counters: Counters,
    nodes: [Option<Monotonic>; 256],
    owners: [Option<Owner>; Parameter::COUNT],
    checked_at: Monotonic,
}

impl Default for CanFix {
    fn default() -> Self {
        Self::new()
    }
}

impl CanFix {
    /// A decoder that has heard nothing.
    #[must_use]
    pub fn new() -> Self {
        Self {
            counters: Counters::default(),
            nodes: [None; 256],
            owners: [None; Parameter::COUNT],
            checked_at: Monotonic::from_nanos(0),
        }
    }

    /// What was taken from nodes that have fallen silent has failed.
    fn look_after_nodes(&mut self, frame: &Frame<'_>, sink: &mut dyn Sink) {
        if frame
            .at
            .since(self.checked_at)
            .is_some_and(|age| age < CHECK_EVERY)
        {
            return;
        }
        self.checked_at = frame.at;
        for &parameter in Parameter::ALL {
            let owner = &mut self.owners[parameter.index()];
            let Some(Owner { node, .. }) = *owner else {
                continue;
            };
            let heard = self.nodes[usize::from(node)];
            let alive =
                heard.is_some_and(|at| frame.at.since(at).is_none_or(|age| age <= NODE_AGE_MAX));
            if !alive {
                *owner = None;
                let mut out = Emit::new(frame.at, frame.source, &mut self.counters.flow, sink);
                out.absent(parameter);
            }
        }
    }

    /// Whether this node is the one to listen to for a parameter, and if it has a good value, from now on.
    fn is_owner(
        &mut self,
        parameter: Parameter,
        node: u8,
        id: u32,
        at: Monotonic,
        good: bool,
    ) -> bool {
        let owner = &mut self.owners[parameter.index()];
        let other_is_alive = owner.is_some_and(|o| {
            (o.node, o.id) != (node, id)
                && at
                    .since(o.at)
                    .is_none_or(|age| age <= parameter.spec().age_max)
        });
        if !other_is_alive {
            // A node that has failed or doubts makes room for another, but is still looked after.
            *owner = good.then_some(Owner { node, id, at });
        }
        !other_is_alive
    }

    fn take(&mut self, frame: &Frame<'_>, can: &CanData, sink: &mut dyn Sink) -> Taken {
        let [node, index, function, value @ ..] = can.data;
        if !(PARAMETER_FIRST..NODE_BASE).contains(&can.id) {
            if (NODE_BASE + 1..=NODE_LAST).contains(&can.id) {
                let node = usize::try_from(can.id - NODE_BASE).unwrap_or(0);
                self.nodes[node] = Some(frame.at);
            }
            return Taken::Ignored;
        }
        if can.bytes().len() < HEADER_BYTES {
            return Taken::Bad(Fault::Short);
        }
        if node == 0 {
            return Taken::Ignored;
        }
        self.nodes[usize::from(node)] = Some(frame.at);
        let (meta, state) = (function >> 4, status(function));
        let bytes = can.bytes().len() - HEADER_BYTES;
        if can.id == TIME || can.id == DATE {
            return if meta != 0 || index != 0 {
                Taken::Ignored
            } else if can.id == TIME {
                self.clock(frame, can, P::UtcTimeOfDay, 5, time_of_day(value), sink)
            } else {
                self.clock(frame, can, P::UtcDate, 4, date(value), sink)
            };
        }
        let row = ROWS.binary_search_by(|row| u32::from(row.id).cmp(&can.id));
        let Some(row) = row.ok().map(|n| &ROWS[n]) else {
            return Taken::Ignored;
        };
        let Some(&parameter) = row.parameters.get(usize::from(index)) else {
            return Taken::Ignored;
        };
        if let Err(fault) = is_long(bytes, row.kind.bytes()) {
            return Taken::Bad(fault);
        }
        let [a, b, c, d, _] = value;
        let number = (row.to_si)(row.kind.number([a, b, c, d]) * row.unit);
        if meta != 0 {
            return limit(
                frame,
                parameter,
                row.meta.kind(meta),
                number,
                state.is_ok(),
                sink,
            );
        }
        self.say(frame, can, parameter, state.map(|()| number), sink)
    }

    fn clock(
        &mut self,
        frame: &Frame<'_>,
        can: &CanData,
        parameter: Parameter,
        bytes: usize,
        number: f64,
        sink: &mut dyn Sink,
    ) -> Taken {
        if let Err(fault) = is_long(can.bytes().len() - HEADER_BYTES, bytes) {
            return Taken::Bad(fault);
        }
        let value = status(can.data[2]).map(|()| number);
        self.say(frame, can, parameter, value, sink)
    }

    fn say(
        &mut self,
        frame: &Frame<'_>,
        can: &CanData,
        parameter: Parameter,
        wire: Result<f64, Invalid>,
        sink: &mut dyn Sink,
    ) -> Taken {
        let value = wire.and_then(|x| parameter.check(x));
        if !self.is_owner(parameter, can.data[0], can.id, frame.at, value.is_ok()) {
            return Taken::Ignored;
        }
        self.counters.flow.failed += u64::from(wire.is_err());
        let mut out = Emit::new(frame.at, frame.source, &mut self.counters.flow, sink);
        out.verdict(parameter, value);
        match (value, wire) {
            (Err(_), Ok(x)) if x.is_finite() => Taken::Bad(Fault::OutOfRange),
            (Err(_), Ok(_)) => Taken::Bad(Fault::NotFinite),
            _ => Taken::Good,
        }
    }
}

enum Taken {
    Good,
    Bad(Fault),
    Ignored,
}

impl Decoder for CanFix {
    fn push(&mut self, frame: Frame<'_>, sink: &mut dyn Sink) {
        let taken = match frame.wire {
            Wire::Can(can) if !can.extended => self.take(&frame, &can, sink),
            _ => Taken::Ignored,
        };
        match taken {
            Taken::Good => self.counters.count(None),
            Taken::Bad(fault) => self.counters.count(Some(fault)),
            Taken::Ignored => self.counters.ignored += 1,
        }
        self.look_after_nodes(&frame, sink);
    }

    fn counters(&self) -> &Counters {
        &self.counters
    }
}

/// What the sender says of the value's quality.
const fn status(function: u8) -> Result<(), Invalid> {
    if function & 4 != 0 {
        Err(Invalid::SourceFailed)
    } else if function & 2 != 0 {
        Err(Invalid::Doubtful)
    } else {
        Ok(())
    }
}

const fn is_long(bytes: usize, expected: usize) -> Result<(), Fault> {
    if bytes < expected {
        Err(Fault::Short)
    } else if bytes > expected {
        Err(Fault::Long)
    } else {
        Ok(())
    }
}

fn limit(
    frame: &Frame<'_>,
    parameter: Parameter,
    kind: Option<&'static str>,
    value: f64,
    is_good: bool,
    sink: &mut dyn Sink,
) -> Taken {
    let Ok(value) = parameter.check(value) else {
        return Taken::Bad(Fault::OutOfRange);
    };
    if let Some(kind) = kind.filter(|_| is_good) {
        sink.limit(&Limit {
            at: frame.at,
            source: frame.source,
            parameter,
            kind,
            value,
        });
    }
    Taken::Good
}

fn time_of_day([hour, minute, second, low, high]: [u8; 5]) -> f64 {
    let milliseconds = u16::from_le_bytes([low, high]);
    if hour > 23 || minute > 59 || second > 60 || milliseconds > 999 {
        return f64::NAN;
    }
    let minutes = f64::from(hour) * 60.0 + f64::from(minute);
    minutes * 60.0 + f64::from(second) + f64::from(milliseconds) * 1e-3
}

fn date([low, high, month, day, _]: [u8; 5]) -> f64 {
    let year = u16::from_le_bytes([low, high]);
    date_days(i32::from(year), i32::from(month), i32::from(day))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_ascend() {
        assert!(
            ROWS.windows(2).all(|w| w[0].id < w[1].id),
            "binary search needs order"
        );
    }
}
