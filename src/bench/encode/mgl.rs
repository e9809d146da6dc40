//! MGL Avionics: iLink packets 1 (primary flight) and 2 (GPS) 4 times a second, 3 (attitude) 10 times, as in recordings, and 10
//! (a piston engine with six cylinders) once.
//!
//! Source: MGL Avionics, "iEFIS/Odyssey/Voyager serial port communications" and "Flight data interface specification". There is
//! no sentinel but the GPS's status and the zero of an engine's sensor: a packet that lacks another value is not sent. Velocities of packet 2 by axis are left at 0: their unit is not published.

use super::field::{
    DEGREE, FOOT, FPM, Field, Form, ICE, KMH, calendar, carried_by, clock, field, whole,
};
use super::{Beat, Carried, Encoder, Send};
use crate::bench::truth::Truth;
use crate::signal::Parameter as P;
use crate::signal::{Parameter, Wire, engines};
use crc::{CRC_32_ISO_HDLC, Crc};

const CRC_32: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// One display. It counts its packets by kind.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mgl {
    counts: [u8; 4],
}

impl Mgl {
    /// Before its first packet.
    #[must_use]
    pub const fn new() -> Self {
        Self { counts: [0; 4] }
    }
}

const BEATS: [Beat; 4] = [
    Beat::ms(250, 20),
    Beat::ms(250, 145),
    Beat::ms(100, 0),
    Beat::ms(1000, 70),
];
/// The packets' own bytes for their rate.
const RATES: [u8; 4] = [4, 4, 10, 1];

const FLIGHT: [Field; 8] = [
    field(P::PressureAltitude, 0, Form::I32, FOOT),
    field(P::BaroAltitude, 4, Form::I32, FOOT),
    field(P::IndicatedAirspeed, 8, Form::U16, 0.1 * KMH),
    field(P::TrueAirspeed, 10, Form::U16, 0.1 * KMH),
    field(P::VerticalSpeed, 14, Form::I16, FPM),
    field(P::StaticPressure, 16, Form::U16, 0.1),
    field(P::BaroSetting, 18, Form::U16, 0.1),
    field(P::StaticAirTemperature, 20, Form::I16, 1.0).from(ICE),
];

const GPS: [Field; 5] = [
    field(P::Latitude, 0, Form::I32, DEGREE / 180_000.0),
    field(P::Longitude, 4, Form::I32, DEGREE / 180_000.0),
    field(P::AltitudeMsl, 8, Form::I32, FOOT),
    field(P::GroundSpeed, 28, Form::U16, 0.1 * KMH),
    field(P::Track, 30, Form::U16, 0.1 * DEGREE),
];

const ATTITUDE: [Field; 5] = [
    field(P::HeadingMagnetic, 0, Form::U16, 0.1 * DEGREE),
    field(P::Pitch, 2, Form::I16, 0.1 * DEGREE),
    field(P::Roll, 4, Form::I16, 0.1 * DEGREE),
    field(P::TurnRate, 8, Form::I16, 0.1 * DEGREE),
    field(P::NormalAcceleration, 12, Form::I16, 0.01),
];

/// Of which the engine always tells; the rest may be zero.
const ENGINE: [Field; 2] = [
    field(P::EngineSpeed, 4, Form::U16, 1.0),
    field(P::FuelFlow, 28, Form::U16, 0.1),
];

const ENGINE_BYTES: usize = 64;

const SENSORS: [Field; 17] = {
    let mut fields = [field(P::OilPressure, 8, Form::U16, 0.1); 17];
    fields[1] = field(P::FuelPressure, 12, Form::U16, 0.1);
    fields[2] = field(P::ManifoldPressure, 32, Form::U16, 0.1);
    fields[3] = field(P::CoolantTemperature, 14, Form::I16, 1.0).from(ICE);
    fields[4] = field(P::OilTemperature, 16, Form::I16, 1.0).from(ICE);
    let mut n = 0;
    while n < 6 {
        let exhaust = engines::EXHAUST_GAS_TEMPERATURE[0][n];
        let head = engines::CYLINDER_HEAD_TEMPERATURE[0][n];
        fields[5 + n] = field(exhaust, 40 + 2 * n, Form::I16, 1.0).from(ICE);
        fields[11 + n] = field(head, 52 + 2 * n, Form::I16, 1.0).from(ICE);
        n += 1;
    }
    fields
};

impl Encoder for Mgl {
    fn beats(&self) -> &'static [Beat] {
        &BEATS
    }

    fn write(&mut self, message: usize, truth: &Truth, send: Send<'_>) {
        let payload = match message {
            0 => flight(truth),
            1 => Some(gps(truth)),
            2 => attitude(truth),
            _ => engine(truth),
        };
        let Some(payload) = payload else {
            return;
        };
        // Counted within the second.
        let count = &mut self.counts[message];
        *count = *count % RATES[message] + 1;
        let kind = [1, 2, 3, 10][message];
        send(Wire::Stream(&packet(
            kind,
            RATES[message],
            *count,
            &payload,
        )));
    }

    fn carries(&self, parameter: Parameter) -> Option<Carried> {
        let of_gps = GPS.iter().any(|field| field.parameter == parameter);
        // Without a value their field is zero, and nothing is said.
        let of_engine = SENSORS.iter().any(|field| field.parameter == parameter);
        let fields: [&[Field]; 5] = [&FLIGHT, &GPS, &ATTITUDE, &ENGINE, &SENSORS];
        carried_by(&fields, parameter, of_gps && !of_engine)
    }
}

/// A whole packet.
#[must_use]
pub fn packet(kind: u8, rate: u8, count: u8, payload: &[u8]) -> Vec<u8> {
    let length = u8::try_from(payload.len().saturating_sub(8)).unwrap_or(0);
    let mut packet = vec![5, 2, length, !length, kind, rate, count, 1];
    packet.extend(payload);
    let crc = CRC_32.checksum(&packet[4..]);
    packet.extend(crc.to_le_bytes());
    packet
}

fn put_le(payload: &mut [u8], at: usize, form: Form, steps: f64) {
    let bytes = whole(steps).to_le_bytes();
    let width = if form == Form::I32 { 4 } else { 2 };
    payload[at..at + width].copy_from_slice(&bytes[..width]);
}

/// Writes fields that must all be there.
fn put_all(payload: &mut [u8], fields: &[Field], truth: &Truth) -> Option<()> {
    for field in fields {
        put_le(payload, field.at, field.form, field.told(truth).ok()?);
    }
    Some(())
}

fn flight(truth: &Truth) -> Option<Vec<u8>> {
    let mut payload = vec![0; 32];
    put_all(&mut payload, &FLIGHT, truth)?;
    // Humidity is not fitted.
    payload[22] = 0xFF;
    let byte = |x: f64| whole(x).to_le_bytes()[0];
    if let Some([h, m, s, _]) = clock(truth) {
        payload[24..27].copy_from_slice(&[h, m, s].map(byte));
    }
    if let Some([y, m, d]) = calendar(truth) {
        payload[27..30].copy_from_slice(&[d, m, y % 100].map(|n| n.to_le_bytes()[0]));
    }
    Some(payload)
}

fn gps(truth: &Truth) -> Vec<u8> {
    let mut payload = vec![0; 44];
    let [latitude, longitude, altitude, speed, track] =
        [0, 1, 2, 3, 4].map(|n| GPS[n].told(truth).ok().map(|steps| (GPS[n], steps)));
    let is_placed = [latitude, longitude, speed, track]
        .iter()
        .all(Option::is_some);
    // 0 acquiring, 2 two dimensions, 3 three.
    payload[34] = match (is_placed, altitude) {
        (false, _) => 0,
        (true, None) => 2,
        (true, Some(_)) => 3,
    };
    for (field, steps) in [latitude, longitude, altitude, speed, track]
        .into_iter()
        .flatten()
    {
        put_le(&mut payload, field.at, field.form, steps);
    }
    if let Some(variation) = truth.finite(P::MagneticVariation) {
        put_le(
            &mut payload,
            32,
            Form::I16,
            (variation / (0.1 * DEGREE)).round(),
        );
    }
    payload
}

fn attitude(truth: &Truth) -> Option<Vec<u8>> {
    let mut payload = vec![0; 28];
    put_all(&mut payload, &ATTITUDE, truth)?;
    // Yaw repeats the heading; side forces as they are felt, if so.
    payload.copy_within(0..2, 6);
    for (parameter, at) in [
        (P::LateralAcceleration, 14),
        (P::LongitudinalAcceleration, 16),
    ] {
        let steps = truth.finite(parameter).map_or(0.0, |g| (g * 100.0).round());
        put_le(
            &mut payload,
            at,
            Form::I16,
            steps.clamp(-32_768.0, 32_767.0),
        );
    }
    // What recordings have here.
    payload[24] = 6;
    Some(payload)
}

fn engine(truth: &Truth) -> Option<Vec<u8>> {
    let mut payload = vec![0; ENGINE_BYTES];
    put_all(&mut payload, &ENGINE, truth)?;
    // The first engine, a piston one, with six exhausts and heads.
    payload[..4].copy_from_slice(&[1, 0, 6, 6]);
    for field in &SENSORS {
        if let Ok(steps) = field.told(truth) {
            put_le(&mut payload, field.at, field.form, steps);
        }
    }
    Some(payload)
}
