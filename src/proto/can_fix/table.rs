//! The parameters of CAN-FIX that are read: identifier, type, unit, and which bounds its meta codes are.
//!
//! Source: MakerPlane, "CAN-FIX Specification", version 0.7, `canfix.json`.

use crate::proto::emit::{celsius, compass, feet, fpm, inches_of_mercury, knots, same};
use crate::signal::Parameter as P;
use crate::signal::{
    BUS_CURRENT, BUS_VOLTAGE, FUEL_QUANTITY, GENERATOR_CURRENT, GENERATOR_VOLTAGE, Parameter,
    engines,
};
use crate::units::{HECTOPASCALS_PER_PSI, LITRES_PER_US_GALLON, METRES_PER_NAUTICAL_MILE};

/// The value's type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Ushort,
    Int,
    Uint,
    Dint,
    Float,
}

impl Kind {
    pub(super) const fn bytes(self) -> usize {
        match self {
            Self::Ushort => 1,
            Self::Int | Self::Uint => 2,
            Self::Dint | Self::Float => 4,
        }
    }

    pub(super) fn number(self, value: [u8; 4]) -> f64 {
        let [a, b, ..] = value;
        match self {
            Self::Ushort => f64::from(a),
            Self::Int => f64::from(i16::from_le_bytes([a, b])),
            Self::Uint => f64::from(u16::from_le_bytes([a, b])),
            Self::Dint => f64::from(i32::from_le_bytes(value)),
            Self::Float => f64::from(f32::from_le_bytes(value)),
        }
    }
}

/// What a meta code means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Meta {
    /// Nothing that is shown.
    None,
    Airspeed,
    Engine,
    /// As [`Meta::Engine`], and two ranges in which the engine may not be run for long.
    Speed,
}

impl Meta {
    pub(super) const fn kind(self, code: u8) -> Option<&'static str> {
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
            (Self::Engine | Self::Speed, 4) => Some("low-warning"),
            (Self::Engine | Self::Speed, 5) => Some("low-alarm"),
            (Self::Engine | Self::Speed, 6) => Some("high-warning"),
            (Self::Engine | Self::Speed, 7) => Some("high-alarm"),
            (Self::Speed, 8) => Some("restriction-1-low"),
            (Self::Speed, 9) => Some("restriction-1-high"),
            (Self::Speed, 10) => Some("restriction-2-low"),
            (Self::Speed, 11) => Some("restriction-2-high"),
            (Self::Engine | Self::Speed, _) => None,
        }
    }
}

/// One identifier: its parameters by index, its type, what a unit of it is, how that becomes the parameter's unit.
pub(super) struct Row {
    pub(super) id: u16,
    pub(super) parameters: &'static [Parameter],
    pub(super) kind: Kind,
    pub(super) unit: f64,
    pub(super) to_si: fn(f64) -> f64,
    pub(super) meta: Meta,
}

impl Row {
    const fn with(mut self, meta: Meta) -> Self {
        self.meta = meta;
        self
    }
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

const fn engine(
    id: u16,
    parameters: &'static [Parameter],
    unit: f64,
    to_si: fn(f64) -> f64,
) -> Row {
    row(id, parameters, Kind::Uint, unit, to_si).with(Meta::Engine)
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
pub(super) const ROWS: [Row; 121] = [
    row(0x145, &[P::FlapAngle], Kind::Int, 0.01, f64::to_radians),
    row(0x180, &[P::Pitch], Kind::Int, 0.01, f64::to_radians),
    row(0x181, &[P::Roll], Kind::Int, 0.01, f64::to_radians),
    row(0x182, &[P::AngleOfAttack], Kind::Int, 0.01, f64::to_radians),
    row(0x183, &[P::IndicatedAirspeed], Kind::Uint, 0.1, knots).with(Meta::Airspeed),
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
    row(
        0x1CA,
        &[P::SelectedGlidePath],
        Kind::Uint,
        0.1,
        f64::to_radians,
    ),
    row(0x1CB, &[P::SelectedVerticalSpeed], Kind::Int, 1.0, fpm),
    row(0x1CC, &[P::SelectedAirspeed], Kind::Uint, 0.1, knots),
    row(0x1CD, &[P::SelectedAltitude], Kind::Dint, 1.0, feet),
    row(0x1CF, &[P::HorizontalAccuracy], Kind::Uint, 1.0, feet),
    row(0x1D0, &[P::VerticalAccuracy], Kind::Uint, 1.0, feet),
    engine(0x200, &[engines::SPEED[0]], 1.0, same).with(Meta::Speed),
    engine(0x201, &[engines::SPEED[1]], 1.0, same).with(Meta::Speed),
    engine(0x202, &[engines::PROPELLER_SPEED[0]], 1.0, same).with(Meta::Speed),
    engine(0x203, &[engines::PROPELLER_SPEED[1]], 1.0, same).with(Meta::Speed),
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
    engine(
        0x208,
        &[engines::INTER_TURBINE_TEMPERATURE[0]],
        0.1,
        celsius,
    ),
    engine(
        0x209,
        &[engines::INTER_TURBINE_TEMPERATURE[1]],
        0.1,
        celsius,
    ),
    engine(
        0x20A,
        &[engines::TURBINE_OUTLET_TEMPERATURE[0]],
        0.1,
        celsius,
    ),
    engine(
        0x20B,
        &[engines::TURBINE_OUTLET_TEMPERATURE[1]],
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
    engine(0x22A, &[engines::FUEL_PUMP_PRESSURE[0]], 0.01, psi),
    engine(0x22B, &[engines::FUEL_PUMP_PRESSURE[1]], 0.01, psi),
    engine(0x22C, &[engines::OIL_QUANTITY[0]], 0.01, gallons),
    engine(0x22D, &[engines::OIL_QUANTITY[1]], 0.01, gallons),
    engine(0x22E, &[engines::COOLANT_QUANTITY[0]], 0.01, gallons),
    engine(0x22F, &[engines::COOLANT_QUANTITY[1]], 0.01, gallons),
    engine(0x230, &[engines::MOTOR_CURRENT[0]], 1.0, same),
    engine(0x231, &[engines::MOTOR_CURRENT[1]], 1.0, same),
    engine(0x232, &[engines::PROPULSION_VOLTAGE[0]], 0.1, same),
    engine(0x233, &[engines::PROPULSION_VOLTAGE[1]], 0.1, same),
    row(0x234, &[P::BatteryCurrent1], Kind::Int, 1.0, same).with(Meta::Engine),
    row(0x235, &[P::BatteryCurrent2], Kind::Int, 1.0, same).with(Meta::Engine),
    engine(0x236, &[P::BatteryTemperature1], 0.1, celsius),
    engine(0x237, &[P::BatteryTemperature2], 0.1, celsius),
    engine(0x238, &[P::BatteryCharge1], 0.1, same),
    engine(0x239, &[P::BatteryCharge2], 0.1, same),
    engine(
        0x23C,
        &[engines::UPPER_DECK_PRESSURE[0]],
        0.01,
        inches_of_mercury,
    ),
    engine(
        0x23D,
        &[engines::UPPER_DECK_PRESSURE[1]],
        0.01,
        inches_of_mercury,
    ),
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
    row(
        0x481,
        &[P::WaypointLatitude],
        Kind::Float,
        1.0,
        f64::to_radians,
    ),
    row(
        0x482,
        &[P::WaypointLongitude],
        Kind::Float,
        1.0,
        f64::to_radians,
    ),
    row(0x483, &[P::WaypointAltitude], Kind::Dint, 1.0, feet),
    engine(0x500, &engines::CYLINDER_HEAD_TEMPERATURE[0], 0.1, celsius),
    engine(0x501, &engines::CYLINDER_HEAD_TEMPERATURE[1], 0.1, celsius),
    engine(0x502, &engines::EXHAUST_GAS_TEMPERATURE[0], 0.1, celsius),
    engine(0x503, &engines::EXHAUST_GAS_TEMPERATURE[1], 0.1, celsius),
    engine(0x50C, &[engines::CARBURETTOR_TEMPERATURE[0]], 0.1, celsius),
    engine(0x50D, &[engines::CARBURETTOR_TEMPERATURE[1]], 0.1, celsius),
    engine(0x50E, &[BUS_VOLTAGE[0]], 0.1, same),
    engine(0x50F, &[BUS_VOLTAGE[1]], 0.1, same),
    engine(0x510, &[BUS_VOLTAGE[2]], 0.1, same),
    engine(0x511, &[BUS_VOLTAGE[3]], 0.1, same),
    engine(0x512, &[BUS_CURRENT[0]], 0.1, same),
    engine(0x513, &[BUS_CURRENT[1]], 0.1, same),
    engine(0x514, &[BUS_CURRENT[2]], 0.1, same),
    engine(0x515, &[BUS_CURRENT[3]], 0.1, same),
    engine(0x516, &[GENERATOR_VOLTAGE[0]], 0.1, same),
    engine(0x517, &[GENERATOR_VOLTAGE[1]], 0.1, same),
    engine(0x518, &[GENERATOR_VOLTAGE[2]], 0.1, same),
    engine(0x519, &[GENERATOR_VOLTAGE[3]], 0.1, same),
    engine(0x51A, &[GENERATOR_CURRENT[0]], 0.1, same),
    engine(0x51B, &[GENERATOR_CURRENT[1]], 0.1, same),
    engine(0x51C, &[GENERATOR_CURRENT[2]], 0.1, same),
    engine(0x51D, &[GENERATOR_CURRENT[3]], 0.1, same),
    engine(0x51E, &[engines::POWER[0]], 0.1, same),
    engine(0x51F, &[engines::POWER[1]], 0.1, same),
    engine(0x520, &[engines::TIME[0]], 0.1, same),
    engine(0x521, &[engines::TIME[1]], 0.1, same),
    engine(0x522, &[engines::TACHOMETER_TIME[0]], 0.1, same),
    engine(0x523, &[engines::TACHOMETER_TIME[1]], 0.1, same),
    row(0x584, &[P::PanelDimmer], Kind::Ushort, 1.0, same),
];

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
