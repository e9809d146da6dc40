//! Frames of the two CAN protocols.

use super::said::{FOOT, FPM, INCH_HG, KNOT, Said};
use glasswing::signal::{CanData, Parameter, Parameter::*};

/// CAN-FIX: identifier, parameter, type (i and u: 16 bits, d: 32, f: floating), unit.
const CAN_FIX: [(u32, Parameter, u8, f64); 24] = [
    (0x180, Pitch, b'i', 0.01),
    (0x181, Roll, b'i', 0.01),
    (0x182, AngleOfAttack, b'i', 0.01),
    (0x183, IndicatedAirspeed, b'u', 0.1 * KNOT),
    (0x184, BaroAltitude, b'd', FOOT),
    (0x185, HeadingMagnetic, b'u', 0.1),
    (0x186, VerticalSpeed, b'i', FPM),
    (0x18A, NormalAcceleration, b'i', 0.001),
    (0x18B, LateralAcceleration, b'i', 0.001),
    (0x18C, LongitudinalAcceleration, b'i', 0.001),
    (0x18D, TrueAirspeed, b'u', 0.1 * KNOT),
    (0x18E, CalibratedAirspeed, b'u', 0.1 * KNOT),
    (0x190, BaroSetting, b'u', 0.001 * INCH_HG),
    (0x191, PressureAltitude, b'd', FOOT),
    (0x1C3, Latitude, b'f', 1.0),
    (0x1C4, Longitude, b'f', 1.0),
    (0x1C5, GroundSpeed, b'u', 0.1 * KNOT),
    (0x1C6, Track, b'u', 0.1),
    (0x200, EngineSpeed, b'u', 1.0),
    (0x400, PitchRate, b'i', 0.1),
    (0x401, RollRate, b'i', 0.1),
    (0x402, YawRate, b'i', 0.1),
    (0x403, TurnRate, b'i', 0.1),
    (0x40B, WindSpeed, b'u', 0.1 * KNOT),
];

/// CANaerospace: identifier, parameter; all as FLOAT.
const CANAEROSPACE: [(u32, Parameter); 31] = [
    (300, LongitudinalAcceleration),
    (301, LateralAcceleration),
    (302, NormalAcceleration),
    (303, PitchRate),
    (304, RollRate),
    (305, YawRate),
    (311, Pitch),
    (312, Roll),
    (313, Sideslip),
    (314, VerticalSpeed),
    (315, IndicatedAirspeed),
    (316, TrueAirspeed),
    (317, CalibratedAirspeed),
    (319, BaroSetting),
    (320, BaroAltitude),
    (321, HeadingTrue),
    (322, PressureAltitude),
    (324, StaticAirTemperature),
    (328, AngleOfAttack),
    (329, AngleOfAttack),
    (332, AltitudeMsl),
    (335, StaticAirTemperature),
    (500, EngineSpeed),
    (564, EngineSpeed),
    (1036, Latitude),
    (1037, Longitude),
    (1038, HeightEllipsoid),
    (1039, GroundSpeed),
    (1040, Track),
    (1069, HeadingMagnetic),
    (1133, HeadingTrue),
];

/// Identifiers that a storm should mostly use.
pub(crate) fn ids(is_can_fix: bool) -> Vec<u32> {
    if is_can_fix {
        CAN_FIX
            .iter()
            .map(|row| row.0)
            .chain([0x580, 0x581, 0x500, 0x6E5])
            .collect()
    } else {
        CANAEROSPACE.iter().map(|row| row.0).collect()
    }
}

fn direction(said: &mut Said, parameter: Parameter, degrees: f64) {
    let turns = degrees.abs() <= 360.0;
    said.degrees(parameter, turns.then(|| degrees.rem_euclid(360.0)));
}

/// What a CAN-FIX frame says, if it is a value that its sender believes.
pub(crate) fn can_fix(can: &CanData, said: &mut Said) {
    let Some((_, parameter, kind, unit)) = CAN_FIX.iter().find(|row| row.0 == can.id) else {
        return;
    };
    let [node, index, function, a, b, c, d, _] = can.data;
    let length = if matches!(kind, b'i' | b'u') { 5 } else { 7 };
    // Bits 4 to 7: a limit; bit 2: failed; bit 1: doubtful.
    let is_value = function & 0xF6 == 0 && index == 0 && node != 0;
    if can.extended || can.len != length || !is_value {
        said.put(*parameter, None);
        return;
    }
    let small = u16::from(a) | u16::from(b) << 8;
    let large = u32::from(small) | u32::from(c) << 16 | u32::from(d) << 24;
    let number = match kind {
        b'i' => f64::from(small.cast_signed()),
        b'u' => f64::from(small),
        b'd' => f64::from(large.cast_signed()),
        _ => f64::from(f32::from_bits(large)),
    };
    match parameter {
        HeadingMagnetic | Track => said.compass(*parameter, Some(number * unit)),
        Pitch | Roll | AngleOfAttack | Latitude | Longitude | PitchRate | RollRate | YawRate
        | TurnRate => said.degrees(*parameter, Some(number * unit)),
        _ => said.put(*parameter, Some(number * unit)),
    }
}

/// What CANaerospace frames say: the upper half of a number waits for the lower one.
#[derive(Debug, Default)]
pub(crate) struct CanAerospace {
    /// Identifier and bits of upper halves just heard.
    highs: Vec<(u32, u32)>,
}

impl CanAerospace {
    pub(crate) fn read(&mut self, can: &CanData, said: &mut Said) {
        // Bits 16 to 23 of a long identifier are a redundancy channel.
        let id = if can.extended && can.id & 0x1F00_F800 == 0 {
            can.id & 0x7FF
        } else {
            can.id
        };
        let Some((_, parameter)) = CANAEROSPACE.iter().find(|row| row.0 == id) else {
            return;
        };
        let [_, data_type, service, _, a, b, c, d] = can.data;
        let word = u32::from_be_bytes([a, b, c, d]);
        let high = self.highs.iter().position(|(id, _)| *id == can.id);
        let high = high.map(|n| self.highs.swap_remove(n).1);
        let bytes = match data_type {
            6 | 7 => 2,
            9 | 10 => 1,
            _ => 4,
        };
        if service != 0 || can.len < 4 + bytes {
            said.put(*parameter, None);
            return;
        }
        let is_position = matches!(parameter, Latitude | Longitude);
        let number = match (data_type, high) {
            (2, _) => f64::from(f32::from_bits(word)),
            (3, _) if is_position => f64::from(word.cast_signed()) * 1e-7,
            (3, _) => f64::from(word.cast_signed()),
            (4, _) => f64::from(word),
            (6, _) => f64::from(i16::from_be_bytes([a, b])),
            (7, _) => f64::from(u16::from_be_bytes([a, b])),
            (9, _) => f64::from(i8::from_be_bytes([a])),
            (10, _) => f64::from(a),
            (30, _) => {
                self.highs.push((can.id, word));
                f64::NAN
            }
            (31, Some(high)) if is_position => {
                f64::from_bits(u64::from(high) << 32 | u64::from(word))
            }
            _ => f64::NAN,
        };
        if !number.is_finite() {
            said.put(*parameter, None);
            return;
        }
        match parameter {
            HeadingTrue | HeadingMagnetic | Track => direction(said, *parameter, number),
            Pitch | Roll | AngleOfAttack | Sideslip | Latitude | Longitude | PitchRate
            | RollRate | YawRate => said.degrees(*parameter, Some(number)),
            _ => said.put(*parameter, Some(number)),
        }
    }
}
