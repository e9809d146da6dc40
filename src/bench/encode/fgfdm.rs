//! FlightGear's native FDM packets, 60 a second.
//!
//! Source: FlightGear `src/Network/net_fdm.hxx`, structure `FGNetFDM`, versions 24 (408 bytes) and 25 (552 bytes); everything
//! written here stands at the same offsets in both. A value that is missing is NaN. Body rates become the Euler rates of the
//! packet (Stevens and Lewis 2003, "Aircraft Control and Simulation", equation 1.4-4), so without attitude there are none.

use super::field::{
    FAHRENHEIT, FAHRENHEIT_ZERO, FOOT, Field, Form, GALLON, KNOT, PSI, carried_by, field,
};
use super::{Beat, Carried, Encoder, Send};
use crate::bench::truth::Truth;
use crate::sampled::Invalid;
use crate::signal::Parameter as P;
use crate::signal::{Parameter, Wire};
use crate::units::STANDARD_GRAVITY_MPS2;
use std::time::Duration;

/// Which structure is sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Version {
    /// FlightGear up to 2020.
    V24,
    /// With tank data.
    V25,
}

/// One simulator.
#[derive(Clone, Copy, Debug)]
pub struct FgFdm {
    version: Version,
}

impl FgFdm {
    /// That sends this version.
    #[must_use]
    pub const fn new(version: Version) -> Self {
        Self { version }
    }
}

const BEATS: [Beat; 1] = [Beat {
    every: Duration::from_nanos(16_666_667),
    first: Duration::ZERO,
}];

/// Feet a second squared in g.
const FPS2: f64 = FOOT / STANDARD_GRAVITY_MPS2;

use Form::{F32, F64};

const FIELDS: [Field; 13] = [
    field(P::Longitude, 8, F64, 1.0),
    field(P::Latitude, 16, F64, 1.0),
    field(P::AltitudeMsl, 24, F64, 1.0),
    field(P::Roll, 36, F32, 1.0),
    field(P::Pitch, 40, F32, 1.0),
    field(P::HeadingTrue, 44, F32, 1.0),
    field(P::AngleOfAttack, 48, F32, 1.0),
    field(P::Sideslip, 52, F32, 1.0),
    field(P::CalibratedAirspeed, 68, F32, KNOT),
    field(P::VerticalSpeed, 72, F32, FOOT),
    field(P::LongitudinalAcceleration, 100, F32, FPS2),
    field(P::LateralAcceleration, 104, F32, FPS2),
    // Down positive.
    field(P::NormalAcceleration, 108, F32, -FPS2),
];

/// Of which exactly zero says that the simulator does not model it.
const MODELLED: [Field; 5] = [
    field(P::HeightAgl, 32, F32, 1.0),
    field(P::FuelFlow, 156, F32, GALLON),
    field(P::CylinderHeadTemperature1, 204, F32, FAHRENHEIT).from(FAHRENHEIT_ZERO),
    field(P::OilTemperature, 252, F32, FAHRENHEIT).from(FAHRENHEIT_ZERO),
    field(P::OilPressure, 268, F32, PSI),
];

const RPM: Field = field(P::EngineSpeed, 140, F32, 1.0);

impl Encoder for FgFdm {
    fn beats(&self) -> &'static [Beat] {
        &BEATS
    }

    fn write(&mut self, _message: usize, truth: &Truth, send: Send<'_>) {
        let (version, length) = match self.version {
            Version::V24 => (24_u32, 408),
            Version::V25 => (25, 552),
        };
        let mut packet = vec![0; length];
        packet[..4].copy_from_slice(&version.to_be_bytes());
        let told = |field: &Field| field.told(truth).unwrap_or(f64::NAN);
        for field in &FIELDS {
            if field.form == F64 {
                packet[field.at..field.at + 8].copy_from_slice(&told(field).to_be_bytes());
            } else {
                put(&mut packet, field.at, told(field));
            }
        }
        for field in &MODELLED {
            if truth.get(field.parameter) != Err(Invalid::NeverReceived) {
                put(&mut packet, field.at, told(field));
            }
        }
        let [phidot, thetadot, psidot] = euler_rates(truth);
        put(&mut packet, 56, phidot);
        put(&mut packet, 60, thetadot);
        put(&mut packet, 64, psidot);
        let value = |parameter| truth.get(parameter).unwrap_or(f64::NAN);
        let (speed, track) = (value(P::GroundSpeed) / FOOT, value(P::Track));
        put(&mut packet, 76, speed * track.cos());
        put(&mut packet, 80, speed * track.sin());
        put(&mut packet, 84, -value(P::VerticalSpeed) / FOOT);
        if truth.get(P::EngineSpeed) != Err(Invalid::NeverReceived) {
            packet[120..124].copy_from_slice(&1_u32.to_be_bytes());
            // Running.
            packet[124..128].copy_from_slice(&2_u32.to_be_bytes());
            put(&mut packet, RPM.at, told(&RPM));
        }
        send(Wire::Datagram(&packet));
    }

    fn sends_datagrams(&self) -> bool {
        true
    }

    fn carries(&self, parameter: Parameter) -> Option<Carried> {
        let of_spec = |resolution| {
            let spec = parameter.spec();
            Some(Carried {
                resolution,
                min: spec.min,
                max: spec.max,
                absent: true,
                nan: true,
                doubtful: false,
            })
        };
        match parameter {
            P::RollRate | P::PitchRate | P::YawRate => of_spec(1e-5),
            P::GroundSpeed => of_spec(1e-3),
            // At the speeds of flight.
            P::Track => of_spec(1e-5),
            _ => carried_by(&[&FIELDS, &MODELLED, &[RPM]], parameter, true),
        }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "the packet has 32 bits")]
fn put(packet: &mut [u8], at: usize, value: f64) {
    packet[at..at + 4].copy_from_slice(&(value as f32).to_be_bytes());
}

/// Of roll, pitch and heading, rad/s, from body rates.
fn euler_rates(truth: &Truth) -> [f64; 3] {
    let value = |parameter| truth.get(parameter).unwrap_or(f64::NAN);
    let [p, q, r] = [P::RollRate, P::PitchRate, P::YawRate].map(value);
    let (sin_roll, cos_roll) = value(P::Roll).sin_cos();
    let pitch = value(P::Pitch);
    let psidot = (q * sin_roll + r * cos_roll) / pitch.cos();
    [
        p + psidot * pitch.sin(),
        q * cos_roll - r * sin_roll,
        psidot,
    ]
}
