//! The flight as its sensors tell it: CANaerospace frames at the rates of real boxes.
//!
//! Three nodes: an attitude and heading computer at 50 Hz, an air data computer at 10 Hz, a receiver for satellite
//! navigation at 10 Hz, its position as 64-bit numbers. They do not speak at the same moment, as real ones do not.

use super::{Flight, STEP, Sample};
use crate::proto::canaerospace::{encode, encode_double};
use crate::signal::{CanData, Parameter};
use std::time::Duration;

/// Node numbers.
const AHRS: u8 = 1;
const AIR_DATA: u8 = 2;
const RECEIVER: u8 = 3;

/// Steps of 20 ms between the messages of the 10 Hz nodes, and when in these they speak.
const SLOW: u32 = 5;
const AIR_DATA_AT: u32 = 1;
const RECEIVER_AT: u32 = 3;

/// The sensors of one flight, sending in order of time.
#[derive(Clone, Debug)]
pub struct Sensors {
    next_step: u32,
}

impl Sensors {
    /// Before the first message, at the start of the flight.
    #[must_use]
    pub const fn new() -> Self {
        Self { next_step: 0 }
    }

    /// Sends everything up to and including `t` after the start that has not been sent yet, each frame with its time.
    /// Nothing is sent after the end of the flight.
    pub fn send_until(
        &mut self,
        flight: &Flight,
        t: Duration,
        send: &mut dyn FnMut(Duration, CanData),
    ) {
        let end = t.min(flight.duration());
        while STEP * self.next_step <= end {
            let at = STEP * self.next_step;
            frames_at(self.next_step, flight, &mut |can| send(at, can));
            self.next_step += 1;
        }
    }
}

impl Default for Sensors {
    fn default() -> Self {
        Self::new()
    }
}

/// The frames of one step. A message code is the number of the message, modulo 256, so it follows from the step.
fn frames_at(step: u32, flight: &Flight, send: &mut dyn FnMut(CanData)) {
    let sample = flight.sample(STEP * step);
    let code = |messages: u32| messages.to_le_bytes()[0];
    for (parameter, value) in attitude(&sample) {
        // A value out of range would be a mistake in the flight; its frame is then missing, and the display says so.
        if let Some(can) = encode(parameter, value, AHRS, code(step)) {
            send(can);
        }
    }
    let slow = step / SLOW;
    if step % SLOW == AIR_DATA_AT {
        for (parameter, value) in air_data(&sample, flight) {
            if let Some(can) = encode(parameter, value, AIR_DATA, code(slow)) {
                send(can);
            }
        }
    }
    if step % SLOW == RECEIVER_AT {
        let position = sample.position;
        for (parameter, value) in [
            (Parameter::Latitude, position.latitude.0),
            (Parameter::Longitude, position.longitude.0),
        ] {
            encode_double(parameter, value, RECEIVER, code(2 * slow))
                .into_iter()
                .flatten()
                .for_each(&mut *send);
        }
        for (parameter, value) in [
            (Parameter::HeightEllipsoid, position.height_ellipsoid.0),
            (Parameter::GroundSpeed, sample.ground_speed.0),
            (Parameter::Track, sample.track.0),
        ] {
            if let Some(can) = encode(parameter, value, RECEIVER, code(slow)) {
                send(can);
            }
        }
    }
}

fn attitude(sample: &Sample) -> [(Parameter, f64); 9] {
    let [roll_rate, pitch_rate, yaw_rate] = sample.rates_radps.to_array();
    let [forward, right, up] = sample.felt_g.to_array();
    [
        (Parameter::Pitch, sample.attitude.pitch.0),
        (Parameter::Roll, sample.attitude.roll.0),
        (Parameter::HeadingTrue, sample.attitude.heading_true.0),
        (Parameter::RollRate, roll_rate),
        (Parameter::PitchRate, pitch_rate),
        (Parameter::YawRate, yaw_rate),
        (Parameter::LongitudinalAcceleration, forward),
        (Parameter::LateralAcceleration, right),
        (Parameter::NormalAcceleration, up),
    ]
}

fn air_data(sample: &Sample, flight: &Flight) -> [(Parameter, f64); 8] {
    [
        (Parameter::IndicatedAirspeed, sample.indicated_airspeed.0),
        (Parameter::TrueAirspeed, sample.true_airspeed.0),
        (Parameter::PressureAltitude, sample.pressure_altitude.0),
        (Parameter::BaroSetting, flight.day.qnh.0),
        (Parameter::BaroAltitude, sample.altitude_msl.0),
        (Parameter::VerticalSpeed, sample.vertical_speed.0),
        (Parameter::AngleOfAttack, sample.angle_of_attack.0),
        (Parameter::StaticAirTemperature, sample.temperature.0),
    ]
}
