//! u-blox receivers: NAV-PVT, 10 times a second.
//!
//! Source: u-blox, "M8 Receiver Description including protocol specification", UBX-13003221. What is missing is said by flags: the
//! kind of fix for position and velocity as a whole and for heights, validity bits for date, time and variation.

use super::field::{DEGREE, Field, Form, calendar, carried_by, clock, field, whole};
use super::{Beat, Carried, Encoder, Send};
use crate::bench::truth::Truth;
use crate::signal::Parameter as P;
use crate::signal::{Parameter, Wire};

/// One receiver.
#[derive(Clone, Copy, Debug)]
pub struct Ubx;

const BEATS: [Beat; 1] = [Beat::ms(100, 0)];

/// Position and velocity in the plane: there together, or not.
const FLAT: [Field; 4] = [
    field(P::Longitude, 24, Form::I32, 1e-7 * DEGREE),
    field(P::Latitude, 28, Form::I32, 1e-7 * DEGREE),
    field(P::GroundSpeed, 60, Form::I32, 1e-3),
    field(P::Track, 64, Form::I32, 1e-5 * DEGREE),
];

/// What a fix with height adds.
const HIGH: [Field; 3] = [
    field(P::HeightEllipsoid, 32, Form::I32, 1e-3),
    field(P::AltitudeMsl, 36, Form::I32, 1e-3),
    // Down positive.
    field(P::VerticalSpeed, 56, Form::I32, -1e-3),
];

/// Errors as stated: unsigned, but far from the end of the field.
const ERRORS: [Field; 2] = [
    field(P::HorizontalAccuracy, 40, Form::I32, 1e-3),
    field(P::VerticalAccuracy, 44, Form::I32, 1e-3),
];

const VARIATION: Field = field(P::MagneticVariation, 88, Form::I16, 0.01 * DEGREE);

impl Encoder for Ubx {
    fn beats(&self) -> &'static [Beat] {
        &BEATS
    }

    fn write(&mut self, _message: usize, truth: &Truth, send: Send<'_>) {
        let mut p = [0; 92];
        let put_all = |p: &mut [u8], fields: &[Field]| {
            let mut all = true;
            for field in fields {
                match field.told(truth) {
                    Ok(steps) => put(p, field.at, steps),
                    Err(_) => all = false,
                }
            }
            all
        };
        let is_flat = put_all(&mut p, &FLAT);
        let is_high = put_all(&mut p, &HIGH);
        for field in &ERRORS {
            // Nobody knows: the largest number of the unsigned field.
            put(&mut p, field.at, field.told(truth).unwrap_or(-1.0));
        }
        // Three dimensions, two, none; gnssFixOK.
        p[20] = if is_flat && is_high {
            3
        } else {
            2 * u8::from(is_flat)
        };
        p[21] = u8::from(is_flat);
        p[23] = truth
            .finite(P::SatellitesUsed)
            .map_or(0, |n| whole(n.clamp(0.0, 255.0)).to_le_bytes()[0]);
        if let Ok(steps) = VARIATION.told(truth) {
            p[88..90].copy_from_slice(&whole(steps).to_le_bytes()[..2]);
            p[11] |= 8;
        }
        put_time(&mut p, truth);
        send(Wire::Stream(&frame(0x01, 0x07, &p)));
    }

    fn carries(&self, parameter: Parameter) -> Option<Carried> {
        let whole_number = |resolution, max, absent| {
            Some(Carried {
                resolution,
                min: 0.0,
                max,
                absent,
                nan: false,
                doubtful: false,
            })
        };
        match parameter {
            P::FixDimensions => whole_number(1.0, 3.0, false),
            P::SatellitesUsed => whole_number(1.0, 255.0, false),
            P::UtcTimeOfDay => whole_number(1e-6, 86_400.0, true),
            P::UtcDate => whole_number(1.0, 73_000.0, true),
            // There with a fix: no sentinel of their own.
            P::HorizontalAccuracy | P::VerticalAccuracy => carried_by(&[&ERRORS], parameter, false),
            P::MagneticVariation => Some(VARIATION.carried(false)),
            _ => carried_by(&[&FLAT, &HIGH], parameter, true),
        }
    }
}

fn put(p: &mut [u8], at: usize, steps: f64) {
    p[at..at + 4].copy_from_slice(&whole(steps).to_le_bytes()[..4]);
}

fn put_time(p: &mut [u8], truth: &Truth) {
    if let Some([y, month, day]) = calendar(truth) {
        let [low, high, ..] = y.to_le_bytes();
        p[4..8].copy_from_slice(&[low, high, month.to_le_bytes()[0], day.to_le_bytes()[0]]);
        p[11] |= 1;
    }
    if let Some([h, m, s, rest]) = clock(truth) {
        p[8..11].copy_from_slice(&[h, m, s].map(|x| whole(x).to_le_bytes()[0]));
        put(p, 16, (rest * 1e9).floor());
        p[11] |= 2;
        let since_sunday = truth
            .finite(P::UtcDate)
            .map_or(0.0, |days| (days + 4.0) % 7.0);
        let seconds = since_sunday * 86_400.0 + h * 3600.0 + m * 60.0 + s + rest;
        // The week of the receivers is 18 leap seconds ahead.
        put(p, 0, ((seconds + 18.0) % 604_800.0 * 1000.0).round());
    }
    if p[11] & 3 == 3 {
        // Fully resolved.
        p[11] |= 4;
    }
}

/// A whole UBX frame.
#[must_use]
pub fn frame(class: u8, id: u8, payload: &[u8]) -> Vec<u8> {
    let [low, high, ..] = payload.len().to_le_bytes();
    let mut frame = vec![0xB5, 0x62, class, id, low, high];
    frame.extend(payload);
    let (mut a, mut b) = (0_u8, 0_u8);
    for byte in &frame[2..] {
        a = a.wrapping_add(*byte);
        b = b.wrapping_add(a);
    }
    frame.extend([a, b]);
    frame
}
