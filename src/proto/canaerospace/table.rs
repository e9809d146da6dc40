//! The identifiers of CANaerospace's default distribution that are read.
//!
//! Source: Stock Flight Systems, CANaerospace interface specification 1.7, section 4. ECS channel B of an engine (64 above
//! channel A) stands in for channel A.

use crate::angle::{wrap_signed, wrap_turn};
use crate::signal::{BUS_CURRENT, BUS_VOLTAGE, FUEL_MASS, Parameter, engines};
use crate::units::{Degrees, Radians};

/// How the number on the wire becomes the parameter's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scale {
    /// It is the parameter's unit.
    One,
    /// An angle or a rate in degrees.
    Degrees,
    /// A direction in degrees, -180 to 180 or 0 to 360; the parameter goes from 0 to a turn.
    Direction,
    /// A latitude or longitude in degrees.
    Position,
    /// A time in minutes; the parameter is in seconds.
    Minutes,
    /// Hour, minute and second, a byte each.
    Clock,
}

/// One identifier.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub(super) id: u16,
    pub(super) parameter: Parameter,
    pub(super) scale: Scale,
    /// Whether it only stands in for another identifier of the same parameter.
    pub(super) stands_in: bool,
    /// Whether its service code is the number of a waypoint rather than a service.
    pub(super) is_of_waypoint: bool,
}

impl Row {
    const fn of_waypoint(mut self) -> Self {
        self.is_of_waypoint = true;
        self
    }
}

const fn primary(id: u16, parameter: Parameter, scale: Scale) -> Row {
    Row {
        id,
        parameter,
        scale,
        stands_in: false,
        is_of_waypoint: false,
    }
}

const fn stand_in(id: u16, parameter: Parameter, scale: Scale) -> Row {
    let mut row = primary(id, parameter, scale);
    row.stands_in = true;
    row
}

/// The identifiers, ascending: the standard's name, the wire unit, the sign.
pub(super) const ROWS: [Row; 113] = [
    // 300: body longitudinal acceleration, g, forward positive.
    primary(300, Parameter::LongitudinalAcceleration, Scale::One),
    // 301: body lateral acceleration, g, right positive.
    primary(301, Parameter::LateralAcceleration, Scale::One),
    // 302: body normal acceleration, g, up positive.
    primary(302, Parameter::NormalAcceleration, Scale::One),
    // 303: body pitch rate, deg/s, nose up positive.
    primary(303, Parameter::PitchRate, Scale::Degrees),
    // 304: body roll rate, deg/s, right positive.
    primary(304, Parameter::RollRate, Scale::Degrees),
    // 305: body yaw rate, deg/s, right positive.
    primary(305, Parameter::YawRate, Scale::Degrees),
    // 311: body pitch angle, deg, nose up positive.
    primary(311, Parameter::Pitch, Scale::Degrees),
    // 312: body roll angle, deg, right positive.
    primary(312, Parameter::Roll, Scale::Degrees),
    // 313: body sideslip, deg.
    primary(313, Parameter::Sideslip, Scale::Degrees),
    // 314: altitude rate, m/s.
    primary(314, Parameter::VerticalSpeed, Scale::One),
    // 315: indicated airspeed, m/s.
    primary(315, Parameter::IndicatedAirspeed, Scale::One),
    // 316: true airspeed, m/s.
    primary(316, Parameter::TrueAirspeed, Scale::One),
    // 317: calibrated airspeed, m/s.
    primary(317, Parameter::CalibratedAirspeed, Scale::One),
    // 318: Mach number.
    primary(318, Parameter::MachNumber, Scale::One),
    // 319: baro correction, hPa.
    primary(319, Parameter::BaroSetting, Scale::One),
    // 320: baro corrected altitude, m.
    primary(320, Parameter::BaroAltitude, Scale::One),
    // 321: heading angle, deg, -180 to 180.
    stand_in(321, Parameter::HeadingTrue, Scale::Direction),
    // 322: standard altitude, m.
    primary(322, Parameter::PressureAltitude, Scale::One),
    // 323: total air temperature, K.
    primary(323, Parameter::TotalAirTemperature, Scale::One),
    // 324: static air temperature, K.
    primary(324, Parameter::StaticAirTemperature, Scale::One),
    // 325: differential pressure, hPa.
    primary(325, Parameter::DifferentialPressure, Scale::One),
    // 326: static pressure, hPa.
    primary(326, Parameter::StaticPressure, Scale::One),
    // 327: heading rate, deg/s.
    primary(327, Parameter::TurnRate, Scale::Degrees),
    // 328: port side angle of attack, deg, nose up positive.
    primary(328, Parameter::AngleOfAttack, Scale::Degrees),
    // 329: starboard side angle of attack, deg, nose up positive.
    stand_in(329, Parameter::AngleOfAttack, Scale::Degrees),
    // 332: true altitude, m.
    primary(332, Parameter::AltitudeMsl, Scale::One),
    // 333: wind speed, m/s.
    primary(333, Parameter::WindSpeed, Scale::One),
    // 334: wind direction, deg, -180 to 180.
    primary(334, Parameter::WindDirectionTrue, Scale::Direction),
    // 335: outside air temperature, K.
    stand_in(335, Parameter::StaticAirTemperature, Scale::One),
    // 339: total pressure, hPa.
    primary(339, Parameter::TotalPressure, Scale::One),
    // 500: engine 1 N1 or crankshaft, 1/min, ECS channel A.
    primary(500, engines::SPEED[0], Scale::One),
    // 501: engine 2 N1 or crankshaft, 1/min, ECS channel A.
    primary(501, engines::SPEED[1], Scale::One),
    // 504: engine 1 N2 or propeller, 1/min, ECS channel A.
    primary(504, engines::PROPELLER_SPEED[0], Scale::One),
    // 505: engine 2 N2 or propeller, 1/min, ECS channel A.
    primary(505, engines::PROPELLER_SPEED[1], Scale::One),
    // 512: engine 1 turbine inlet temperature, K, ECS channel A.
    primary(512, engines::TURBINE_INLET_TEMPERATURE[0], Scale::One),
    // 513: engine 2 turbine inlet temperature, K, ECS channel A.
    primary(513, engines::TURBINE_INLET_TEMPERATURE[1], Scale::One),
    // 516: engine 1 temperature between turbines, K, ECS channel A.
    primary(516, engines::INTER_TURBINE_TEMPERATURE[0], Scale::One),
    // 517: engine 2 temperature between turbines, K, ECS channel A.
    primary(517, engines::INTER_TURBINE_TEMPERATURE[1], Scale::One),
    // 520: engine 1 turbine outlet or exhaust gas temperature, K, ECS channel A.
    primary(520, engines::EXHAUST_GAS_TEMPERATURE[0][0], Scale::One),
    // 521: engine 2 turbine outlet or exhaust gas temperature, K, ECS channel A.
    primary(521, engines::EXHAUST_GAS_TEMPERATURE[1][0], Scale::One),
    // 524: engine 1 fuel flow, l/h, ECS channel A.
    primary(524, engines::FUEL_FLOW[0], Scale::One),
    // 525: engine 2 fuel flow, l/h, ECS channel A.
    primary(525, engines::FUEL_FLOW[1], Scale::One),
    // 528: engine 1 manifold pressure, hPa, ECS channel A.
    primary(528, engines::MANIFOLD_PRESSURE[0], Scale::One),
    // 529: engine 2 manifold pressure, hPa, ECS channel A.
    primary(529, engines::MANIFOLD_PRESSURE[1], Scale::One),
    // 532: engine 1 oil pressure, hPa, ECS channel A.
    primary(532, engines::OIL_PRESSURE[0], Scale::One),
    // 533: engine 2 oil pressure, hPa, ECS channel A.
    primary(533, engines::OIL_PRESSURE[1], Scale::One),
    // 536: engine 1 oil temperature, K, ECS channel A.
    primary(536, engines::OIL_TEMPERATURE[0], Scale::One),
    // 537: engine 2 oil temperature, K, ECS channel A.
    primary(537, engines::OIL_TEMPERATURE[1], Scale::One),
    // 540: engine 1 cylinder head temperature, K, ECS channel A.
    primary(540, engines::CYLINDER_HEAD_TEMPERATURE[0][0], Scale::One),
    // 541: engine 2 cylinder head temperature, K, ECS channel A.
    primary(541, engines::CYLINDER_HEAD_TEMPERATURE[1][0], Scale::One),
    // 544: engine 1 oil quantity, l, ECS channel A.
    primary(544, engines::OIL_QUANTITY[0], Scale::One),
    // 545: engine 2 oil quantity, l, ECS channel A.
    primary(545, engines::OIL_QUANTITY[1], Scale::One),
    // 548: engine 1 coolant temperature, K, ECS channel A.
    primary(548, engines::COOLANT_TEMPERATURE[0], Scale::One),
    // 549: engine 2 coolant temperature, K, ECS channel A.
    primary(549, engines::COOLANT_TEMPERATURE[1], Scale::One),
    // 564: engine 1 N1 or crankshaft, 1/min, ECS channel B.
    stand_in(564, engines::SPEED[0], Scale::One),
    // 565: engine 2 N1 or crankshaft, 1/min, ECS channel B.
    stand_in(565, engines::SPEED[1], Scale::One),
    // 568: engine 1 N2 or propeller, 1/min, ECS channel B.
    stand_in(568, engines::PROPELLER_SPEED[0], Scale::One),
    // 569: engine 2 N2 or propeller, 1/min, ECS channel B.
    stand_in(569, engines::PROPELLER_SPEED[1], Scale::One),
    // 576: engine 1 turbine inlet temperature, K, ECS channel B.
    stand_in(576, engines::TURBINE_INLET_TEMPERATURE[0], Scale::One),
    // 577: engine 2 turbine inlet temperature, K, ECS channel B.
    stand_in(577, engines::TURBINE_INLET_TEMPERATURE[1], Scale::One),
    // 580: engine 1 temperature between turbines, K, ECS channel B.
    stand_in(580, engines::INTER_TURBINE_TEMPERATURE[0], Scale::One),
    // 581: engine 2 temperature between turbines, K, ECS channel B.
    stand_in(581, engines::INTER_TURBINE_TEMPERATURE[1], Scale::One),
    // 584: engine 1 turbine outlet or exhaust gas temperature, K, ECS channel B.
    stand_in(584, engines::EXHAUST_GAS_TEMPERATURE[0][0], Scale::One),
    // 585: engine 2 turbine outlet or exhaust gas temperature, K, ECS channel B.
    stand_in(585, engines::EXHAUST_GAS_TEMPERATURE[1][0], Scale::One),
    // 588: engine 1 fuel flow, l/h, ECS channel B.
    stand_in(588, engines::FUEL_FLOW[0], Scale::One),
    // 589: engine 2 fuel flow, l/h, ECS channel B.
    stand_in(589, engines::FUEL_FLOW[1], Scale::One),
    // 592: engine 1 manifold pressure, hPa, ECS channel B.
    stand_in(592, engines::MANIFOLD_PRESSURE[0], Scale::One),
    // 593: engine 2 manifold pressure, hPa, ECS channel B.
    stand_in(593, engines::MANIFOLD_PRESSURE[1], Scale::One),
    // 596: engine 1 oil pressure, hPa, ECS channel B.
    stand_in(596, engines::OIL_PRESSURE[0], Scale::One),
    // 597: engine 2 oil pressure, hPa, ECS channel B.
    stand_in(597, engines::OIL_PRESSURE[1], Scale::One),
    // 600: engine 1 oil temperature, K, ECS channel B.
    stand_in(600, engines::OIL_TEMPERATURE[0], Scale::One),
    // 601: engine 2 oil temperature, K, ECS channel B.
    stand_in(601, engines::OIL_TEMPERATURE[1], Scale::One),
    // 604: engine 1 cylinder head temperature, K, ECS channel B.
    stand_in(604, engines::CYLINDER_HEAD_TEMPERATURE[0][0], Scale::One),
    // 605: engine 2 cylinder head temperature, K, ECS channel B.
    stand_in(605, engines::CYLINDER_HEAD_TEMPERATURE[1][0], Scale::One),
    // 608: engine 1 oil quantity, l, ECS channel B.
    stand_in(608, engines::OIL_QUANTITY[0], Scale::One),
    // 609: engine 2 oil quantity, l, ECS channel B.
    stand_in(609, engines::OIL_QUANTITY[1], Scale::One),
    // 612: engine 1 coolant temperature, K, ECS channel B.
    stand_in(612, engines::COOLANT_TEMPERATURE[0], Scale::One),
    // 613: engine 2 coolant temperature, K, ECS channel B.
    stand_in(613, engines::COOLANT_TEMPERATURE[1], Scale::One),
    // 668: fuel tank 1 quantity, kg.
    primary(668, FUEL_MASS[0], Scale::One),
    // 669: fuel tank 2 quantity, kg.
    primary(669, FUEL_MASS[1], Scale::One),
    // 670: fuel tank 3 quantity, kg.
    primary(670, FUEL_MASS[2], Scale::One),
    // 671: fuel tank 4 quantity, kg.
    primary(671, FUEL_MASS[3], Scale::One),
    // 684: fuel system 1 pressure, hPa.
    primary(684, engines::FUEL_PRESSURE[0], Scale::One),
    // 685: fuel system 2 pressure, hPa.
    primary(685, engines::FUEL_PRESSURE[1], Scale::One),
    // 920: DC system 1 voltage, V.
    primary(920, BUS_VOLTAGE[0], Scale::One),
    // 921: DC system 2 voltage, V.
    primary(921, BUS_VOLTAGE[1], Scale::One),
    // 922: DC system 3 voltage, V.
    primary(922, BUS_VOLTAGE[2], Scale::One),
    // 923: DC system 4 voltage, V.
    primary(923, BUS_VOLTAGE[3], Scale::One),
    // 930: DC system 1 current, A.
    primary(930, BUS_CURRENT[0], Scale::One),
    // 931: DC system 2 current, A.
    primary(931, BUS_CURRENT[1], Scale::One),
    // 932: DC system 3 current, A.
    primary(932, BUS_CURRENT[2], Scale::One),
    // 933: DC system 4 current, A.
    primary(933, BUS_CURRENT[3], Scale::One),
    // 1000: active waypoint latitude, deg; the service code is its number, here and up to 1009.
    primary(1000, Parameter::WaypointLatitude, Scale::Degrees).of_waypoint(),
    // 1001: active waypoint longitude, deg.
    primary(1001, Parameter::WaypointLongitude, Scale::Degrees).of_waypoint(),
    // 1003: active waypoint altitude, m.
    primary(1003, Parameter::WaypointAltitude, Scale::One).of_waypoint(),
    // 1007: active navigation system cross-track error, m.
    primary(1007, Parameter::CrossTrack, Scale::One).of_waypoint(),
    // 1009: active navigation system time to go, min.
    primary(1009, Parameter::WaypointTimeToGo, Scale::Minutes).of_waypoint(),
    // 1036: GPS aircraft latitude, deg, north positive.
    primary(1036, Parameter::Latitude, Scale::Position),
    // 1037: GPS aircraft longitude, deg, east positive.
    primary(1037, Parameter::Longitude, Scale::Position),
    // 1038: GPS aircraft height above ellipsoid, m.
    primary(1038, Parameter::HeightEllipsoid, Scale::One),
    // 1039: GPS ground speed, m/s.
    primary(1039, Parameter::GroundSpeed, Scale::One),
    // 1040: GPS true track, deg.
    primary(1040, Parameter::Track, Scale::Direction),
    // 1041: GPS magnetic track, deg.
    primary(1041, Parameter::TrackMagnetic, Scale::Direction),
    // 1042: GPS cross-track error, m.
    stand_in(1042, Parameter::CrossTrack, Scale::One),
    // 1046: GPS vertical figure of merit, m.
    primary(1046, Parameter::VerticalAccuracy, Scale::One),
    // 1047: GPS horizontal figure of merit, m.
    primary(1047, Parameter::HorizontalAccuracy, Scale::One),
    // 1069: magnetic heading, deg.
    primary(1069, Parameter::HeadingMagnetic, Scale::Direction),
    // 1070: radio height, m.
    primary(1070, Parameter::HeightAgl, Scale::One),
    // 1087: ILS 1 localizer deviation, deg.
    primary(1087, Parameter::LocalizerDeviation, Scale::Degrees),
    // 1091: ILS 1 glide slope deviation, deg.
    primary(1091, Parameter::GlidePathDeviation, Scale::Degrees),
    // 1122: selected glide path angle, deg.
    primary(1122, Parameter::SelectedGlidePath, Scale::Degrees),
    // 1133: true heading, deg.
    primary(1133, Parameter::HeadingTrue, Scale::Direction),
    // 1200: UTC: hour, minute, second and a zero, as CHAR4.
    primary(1200, Parameter::UtcTimeOfDay, Scale::Clock),
];

/// The identifiers that the decoder listens to, ascending.
pub static IDS: [u16; ROWS.len()] = {
    let mut ids = [0; ROWS.len()];
    let mut i = 0;
    while i < ids.len() {
        ids[i] = ROWS[i].id;
        i += 1;
    }
    ids
};

impl Scale {
    pub(super) fn to_si(self, wire: f64) -> f64 {
        let radians = Radians::from(Degrees(wire));
        match self {
            Self::One | Self::Clock => wire,
            Self::Minutes => wire * 60.0,
            Self::Degrees | Self::Position => radians.0,
            Self::Direction if wire.abs() <= 360.0 => wrap_turn(radians).0,
            // A direction beyond a turn is an error of the sender; as radians it is out of range all the more.
            Self::Direction => wire,
        }
    }

    pub(super) fn to_wire(self, si: f64) -> f64 {
        match self {
            Self::One | Self::Clock => si,
            Self::Minutes => si / 60.0,
            Self::Degrees | Self::Position => Radians(si).to_degrees(),
            Self::Direction => wrap_signed(Radians(si)).to_degrees(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_ascend_and_parameters_have_one_primary() {
        assert!(
            IDS.windows(2).all(|w| w[0] < w[1]),
            "binary search needs order"
        );
        for row in &ROWS {
            let primaries = ROWS
                .iter()
                .filter(|r| r.parameter == row.parameter && !r.stands_in);
            assert_eq!(primaries.count(), 1, "{:?}", row.parameter);
        }
    }

    #[test]
    fn directions_beyond_a_turn_are_refused() {
        for (wire, ok) in [
            (180.0, true),
            (-180.0, true),
            (360.0, true),
            (-90.0, true),
            (361.0, false),
            (-1e9, false),
        ] {
            let verdict = Parameter::HeadingTrue.check(Scale::Direction.to_si(wire));
            assert_eq!(verdict.is_ok(), ok, "{wire}");
        }
        assert!(
            Parameter::Track
                .check(Scale::Direction.to_si(f64::NAN))
                .is_err(),
            "NaN"
        );
    }
}
