//! FlightGear's native flight dynamics packet, as sent by `fgfs --native-fdm=socket,out,HZ,HOST,PORT,udp` and by JSBSim's
//! `<output type="FLIGHTGEAR">`.
//!
//! Source: FlightGear `src/Network/net_fdm.hxx`, structure `FGNetFDM`, versions 24 (408 bytes) and 25 (552 bytes). All
//! numbers are big-endian IEEE 754 or unsigned integers. Version 25 adds tank data at offset 304 and later; all else that is
//! read here lies before it, at the same offsets in both. The padding word at offset 4 and the tank selectors are left in
//! the sender's byte order by FlightGear and are not read.
//!
//! Senders fill what they do not model with zeros: a height above ground, temperature, oil pressure or fuel flow of exactly
//! zero is not said. Of the fields in which senders differ none is read: fuel quantity (FlightGear sends gallons, JSBSim pounds;
//! version 25 has cubic metres besides, which are read), exhaust temperature (degrees Fahrenheit or Celsius), manifold
//! pressure (ounces per square inch by its name, inches of mercury by JSBSim), fuel pressure (always zero in JSBSim).
//!
//! A packet of a wrong length or version is counted and dropped whole. In a packet of the right shape each impossible
//! field is reported as [`Invalid::OutOfRange`], the others are used, and the packet is counted as bad.
//!
//! Two things that the packet says are not taken from it: its `cur_time` is the sender's wall clock, not our time of
//! receipt, and a track is not reported below [`TRACK_SPEED_MIN_MPS`], where the direction of motion is noise.

use super::{Counters, Decoder, Fault};
use crate::angle::{wrap_signed, wrap_turn};
use crate::sampled::Invalid;
use crate::signal::{FUEL_QUANTITY, Frame, Parameter, Signal, Sink, Wire, engines};
use crate::units::{Feet, Knots, Metres, MetresPerSecond, Radians, STANDARD_GRAVITY_MPS2};
use crate::units::{HECTOPASCALS_PER_PSI, LITRES_PER_US_GALLON};
use std::f64::consts::{FRAC_PI_2, PI};

/// Length of a version 24 packet in bytes.
pub const V24_BYTES: usize = 408;
/// Length of a version 25 packet in bytes.
pub const V25_BYTES: usize = 552;

/// The ground speed below which no track is reported, m/s: a fast walk.
pub const TRACK_SPEED_MIN_MPS: f64 = 2.0;

/// The largest heading taken, rad: two turns either way. FlightGear sends 0 to 2 pi; other senders are off by a turn.
const HEADING_ABS_MAX_RAD: f64 = 4.0 * PI;

/// Engines that the packet has room for.
const ENGINES_MAX: u32 = 4;

// Offsets in bytes; each field's wire unit, and its sentinel: the packet has none, a source without data sends NaN or zero.
const VERSION: usize = 0; // u32
const LONGITUDE: usize = 8; // f64, rad, east positive
const LATITUDE: usize = 16; // f64, rad, geodetic, north positive
const ALTITUDE: usize = 24; // f64, m, above sea level
const AGL: usize = 32; // f32, m, above the ground
const PHI: usize = 36; // f32, rad, right wing down positive
const THETA: usize = 40; // f32, rad, nose up positive
const PSI: usize = 44; // f32, rad, clockwise from true north
const ALPHA: usize = 48; // f32, rad, nose above the relative wind positive
const BETA: usize = 52; // f32, rad, wind from the right positive
const PHIDOT: usize = 56; // f32, rad/s, Euler rate
const THETADOT: usize = 60; // f32, rad/s, Euler rate
const PSIDOT: usize = 64; // f32, rad/s, Euler rate
const VCAS: usize = 68; // f32, kt
const CLIMB_RATE: usize = 72; // f32, ft/s, up positive
const V_NORTH: usize = 76; // f32, ft/s
const V_EAST: usize = 80; // f32, ft/s
const A_X_PILOT: usize = 100; // f32, ft/s2, forward positive, felt at the pilot's seat
const A_Y_PILOT: usize = 104; // f32, ft/s2, right positive
const A_Z_PILOT: usize = 108; // f32, ft/s2, down positive: -32.2 in level flight
const NUM_ENGINES: usize = 120; // u32
const RPM: usize = 140; // f32[4], 1/min
const FUEL_FLOW: usize = 156; // f32[4], US gal/h
const CHT: usize = 204; // f32[4], degrees Fahrenheit
const OIL_TEMPERATURE: usize = 252; // f32[4], degrees Fahrenheit
const OIL_PRESSURE: usize = 268; // f32[4], psi
const TANK_CAPACITY: usize = 320; // f64[4], m3, version 25 only
const TANK_LEVEL: usize = 416; // f64[4], m3, version 25 only

/// The decoder. It keeps nothing between packets but its counters.
#[derive(Debug, Default)]
pub struct FgFdm {
    counters: Counters,
}

impl FgFdm {
    /// A decoder that has seen nothing.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }
}

impl Decoder for FgFdm {
    fn push(&mut self, frame: Frame<'_>, sink: &mut dyn Sink) {
        let Wire::Datagram(bytes) = frame.wire else {
            self.counters.ignored += 1;
            return;
        };
        if let Err(fault) = check_shape(bytes) {
            self.counters.count(Some(fault));
            return;
        }
        let mut out = Emitter {
            frame,
            sink,
            worst: None,
        };
        attitude(bytes, &mut out);
        position(bytes, &mut out);
        air_data(bytes, &mut out);
        motion(bytes, &mut out);
        engine(bytes, &mut out);
        tanks(bytes, &mut out);
        let worst = out.worst;
        self.counters.count(worst);
    }

    fn counters(&self) -> &Counters {
        &self.counters
    }
}

/// Whether version and length agree.
fn check_shape(bytes: &[u8]) -> Result<(), Fault> {
    if bytes.len() < VERSION + 4 {
        return Err(Fault::Short);
    }
    let expected = match u32_at(bytes, VERSION) {
        24 => V24_BYTES,
        25 => V25_BYTES,
        _ => return Err(Fault::UnknownVersion),
    };
    match bytes.len().cmp(&expected) {
        std::cmp::Ordering::Less => Err(Fault::Short),
        std::cmp::Ordering::Equal => Ok(()),
        std::cmp::Ordering::Greater => Err(Fault::Long),
    }
}

fn attitude(bytes: &[u8], out: &mut Emitter<'_, '_>) {
    let (phi, theta, psi) = (f32_at(bytes, PHI), f32_at(bytes, THETA), f32_at(bytes, PSI));
    out.emit(Parameter::Pitch, within_f32(theta, FRAC_PI_2));
    out.emit(Parameter::Roll, within_f32(phi, PI));
    out.emit(
        Parameter::HeadingTrue,
        if psi.abs() <= HEADING_ABS_MAX_RAD {
            wrap_turn(Radians(psi)).0
        } else {
            psi
        },
    );
    // Euler rates to body rates (Stevens and Lewis 2003, "Aircraft Control and Simulation", equation 1.4-3).
    let (phidot, thetadot, psidot) = (
        f32_at(bytes, PHIDOT),
        f32_at(bytes, THETADOT),
        f32_at(bytes, PSIDOT),
    );
    let (sin_phi, cos_phi) = phi.sin_cos();
    let (sin_theta, cos_theta) = theta.sin_cos();
    out.emit(Parameter::RollRate, phidot - psidot * sin_theta);
    out.emit(
        Parameter::PitchRate,
        thetadot * cos_phi + psidot * sin_phi * cos_theta,
    );
    out.emit(
        Parameter::YawRate,
        psidot * cos_phi * cos_theta - thetadot * sin_phi,
    );
}

fn position(bytes: &[u8], out: &mut Emitter<'_, '_>) {
    out.emit(Parameter::Latitude, f64_at(bytes, LATITUDE));
    out.emit(Parameter::Longitude, f64_at(bytes, LONGITUDE));
    out.emit(Parameter::AltitudeMsl, f64_at(bytes, ALTITUDE));
    out.emit_modelled(Parameter::HeightAgl, f32_at(bytes, AGL), |metres| metres);
}

fn air_data(bytes: &[u8], out: &mut Emitter<'_, '_>) {
    out.emit(
        Parameter::CalibratedAirspeed,
        MetresPerSecond::from(Knots(f32_at(bytes, VCAS))).0,
    );
    out.emit(Parameter::AngleOfAttack, f32_at(bytes, ALPHA));
    out.emit(Parameter::Sideslip, f32_at(bytes, BETA));
    out.emit(Parameter::VerticalSpeed, feet_at(bytes, CLIMB_RATE));
}

fn motion(bytes: &[u8], out: &mut Emitter<'_, '_>) {
    let (north, east) = (feet_at(bytes, V_NORTH), feet_at(bytes, V_EAST));
    let speed = north.hypot(east);
    out.emit(Parameter::GroundSpeed, speed);
    if !speed.is_finite() {
        out.emit(Parameter::Track, f64::NAN);
    } else if speed >= TRACK_SPEED_MIN_MPS {
        out.emit(Parameter::Track, wrap_turn(Radians(east.atan2(north))).0);
    }
    let g = STANDARD_GRAVITY_MPS2;
    out.emit(
        Parameter::LongitudinalAcceleration,
        feet_at(bytes, A_X_PILOT) / g,
    );
    out.emit(
        Parameter::LateralAcceleration,
        feet_at(bytes, A_Y_PILOT) / g,
    );
    // The wire's z points down, the parameter's up.
    out.emit(
        Parameter::NormalAcceleration,
        -feet_at(bytes, A_Z_PILOT) / g,
    );
}

fn engine(bytes: &[u8], out: &mut Emitter<'_, '_>) {
    let engines_fitted = match u32_at(bytes, NUM_ENGINES) {
        n @ 0..=ENGINES_MAX => n,
        _ => return out.emit(Parameter::EngineSpeed, f64::NAN),
    };
    for n in (0..engines::SPEED.len()).take_while(|n| (*n as u64) < u64::from(engines_fitted)) {
        let field = |at: usize| f32_at(bytes, at + 4 * n);
        out.emit(engines::SPEED[n], field(RPM));
        let fahrenheit = |x: f64| (x - 32.0) / 1.8 + 273.15;
        let cht = engines::CYLINDER_HEAD_TEMPERATURE[n][0];
        out.emit_modelled(cht, field(CHT), fahrenheit);
        let oil = engines::OIL_TEMPERATURE[n];
        out.emit_modelled(oil, field(OIL_TEMPERATURE), fahrenheit);
        let hectopascals = |psi: f64| psi * HECTOPASCALS_PER_PSI;
        out.emit_modelled(engines::OIL_PRESSURE[n], field(OIL_PRESSURE), hectopascals);
        let litres = |gallons: f64| gallons * LITRES_PER_US_GALLON;
        out.emit_modelled(engines::FUEL_FLOW[n], field(FUEL_FLOW), litres);
    }
}

fn tanks(bytes: &[u8], out: &mut Emitter<'_, '_>) {
    if bytes.len() != V25_BYTES {
        return;
    }
    for (n, parameter) in FUEL_QUANTITY.into_iter().enumerate() {
        if f64_at(bytes, TANK_CAPACITY + 8 * n) > 0.0 {
            out.emit(parameter, f64_at(bytes, TANK_LEVEL + 8 * n) * 1000.0);
        }
    }
}

/// Checks fields on their way out and remembers the worst that was wrong with the packet.
struct Emitter<'a, 'b> {
    frame: Frame<'a>,
    sink: &'b mut dyn Sink,
    worst: Option<Fault>,
}

impl Emitter<'_, '_> {
    /// A number that is exactly zero where the sender does not model it.
    fn emit_modelled(&mut self, parameter: Parameter, wire: f64, to_si: impl Fn(f64) -> f64) {
        if wire.abs() > 0.0 || wire.is_nan() {
            self.emit(parameter, to_si(wire));
        }
    }

    fn emit(&mut self, parameter: Parameter, value: f64) {
        let verdict = parameter.check(value);
        if verdict == Err(Invalid::OutOfRange) {
            if !value.is_finite() {
                self.worst = Some(Fault::NotFinite);
            } else if self.worst.is_none() {
                self.worst = Some(Fault::OutOfRange);
            }
        }
        self.sink.signal(Signal {
            at: self.frame.at,
            source: self.frame.source,
            parameter,
            value: verdict,
        });
    }
}

/// `angle`, unless it is `limit` (pi or half of it) rounded up to the wire's 32 bits: then the same direction within the
/// limit. Not a clamp: the next larger number on the wire is left alone and refused.
fn within_f32(angle: f64, limit: f64) -> f64 {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "rounding to 32 bits is the purpose"
    )]
    let limit_f32 = f64::from(limit as f32);
    let is_the_limit_rounded_up = angle.abs() > limit && angle.abs() <= limit_f32;
    if !is_the_limit_rounded_up {
        angle
    } else if limit < PI {
        limit.copysign(angle)
    } else {
        wrap_signed(Radians(angle)).0
    }
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_be_bytes(word(bytes, at))
}

fn f32_at(bytes: &[u8], at: usize) -> f64 {
    f64::from(f32::from_be_bytes(word(bytes, at)))
}

fn f64_at(bytes: &[u8], at: usize) -> f64 {
    f64::from_be_bytes(word(bytes, at))
}

/// A length, speed or acceleration with feet on the wire, in metres.
fn feet_at(bytes: &[u8], at: usize) -> f64 {
    Metres::from(Feet(f32_at(bytes, at))).0
}

/// `N` bytes from `at`; the caller has checked the packet's length.
fn word<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    let mut word = [0; N];
    word.copy_from_slice(&bytes[at..at + N]);
    word
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_right_angle_in_32_bits_is_still_a_right_angle() {
        // f32 rounds both pi/2 and pi up.
        let up = f64::from(std::f32::consts::FRAC_PI_2);
        assert!(up > FRAC_PI_2, "the premise");
        assert_eq!(
            Parameter::Pitch.check(within_f32(up, FRAC_PI_2)),
            Ok(FRAC_PI_2)
        );
        let inverted = f64::from(std::f32::consts::PI);
        assert!(
            Parameter::Roll.check(within_f32(inverted, PI)).is_ok(),
            "inverted flight"
        );
        assert!(
            Parameter::Roll.check(within_f32(-inverted, PI)).is_ok(),
            "inverted flight, the other way"
        );
        let more = f64::from(f32::from_bits(std::f32::consts::PI.to_bits() + 1));
        assert!(
            Parameter::Roll.check(within_f32(more, PI)).is_err(),
            "more than half a turn"
        );
        for limit in [FRAC_PI_2, PI] {
            assert!(within_f32(f64::NAN, limit).is_nan(), "NaN stays NaN");
        }
    }
}
