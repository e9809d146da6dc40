//! GDL90 as a Stratux with an attitude sensor sends it: heartbeat, identity and traffic once a second, ownship and geometric
//! altitude 5 times, ForeFlight's attitude 5 times, Stratux's own 20 times.
//!
//! Sources: Garmin, "GDL 90 Data Interface Specification", 560-1058-00 revision A; ForeFlight, "GDL90 Extended Specification";
//! the Stratux project's `gen_gdl90.go`. The identity says that geometric altitude is above the ellipsoid.

use super::field::{DEGREE, FOOT, FPM, KNOT, clock, whole};
use super::{Beat, Carried, Encoder, Send};
use crate::bench::truth::{Aircraft, Truth};
use crate::proto::gdl90::crc;
use crate::sampled::Invalid;
use crate::signal::Parameter as P;
use crate::signal::{Alert, Parameter, Wire};

/// One receiver.
#[derive(Clone, Copy, Debug)]
pub struct Gdl90;

const BEATS: [Beat; 5] = [
    Beat::ms(1000, 0),
    Beat::ms(200, 10),
    Beat::ms(200, 110),
    Beat::ms(50, 20),
    Beat::ms(1000, 510),
];

/// Degrees of a position's unit.
const POSITION: f64 = 180.0 / 8_388_608.0 * DEGREE;

impl Encoder for Gdl90 {
    fn beats(&self) -> &'static [Beat] {
        &BEATS
    }

    fn write(&mut self, message: usize, truth: &Truth, send: Send<'_>) {
        let mut say = |message: &[u8]| send(Wire::Datagram(&frame(message)));
        match message {
            0 => {
                say(&heartbeat(truth));
                say(&identity());
            }
            1 => {
                say(&ownship(truth));
                if let Some(message) = geometric_altitude(truth) {
                    say(&message);
                }
            }
            2 => say(&foreflight_ahrs(truth)),
            3 => say(&stratux_ahrs(truth)),
            _ => truth
                .traffic
                .iter()
                .for_each(|aircraft| say(&traffic(aircraft))),
        }
    }

    fn sends_datagrams(&self) -> bool {
        true
    }

    fn carries(&self, parameter: Parameter) -> Option<Carried> {
        // The coarsest step, and the ends that all messages have.
        let (resolution, min, max) = match parameter {
            P::Latitude | P::Longitude => (POSITION, -180.0 * DEGREE, 180.0 * DEGREE),
            P::PressureAltitude => (25.0 * FOOT, -1000.0 * FOOT, 60_534.0 * FOOT),
            P::GroundSpeed => (KNOT, 0.0, 4094.0 * KNOT),
            P::VerticalSpeed => (64.0 * FPM, -32_576.0 * FPM, 32_576.0 * FPM),
            P::Track => (360.0 / 256.0 * DEGREE, 0.0, 255.0 / 256.0 * 360.0 * DEGREE),
            P::VerticalAccuracy => (1.0, 0.0, 32_766.0),
            P::HeightEllipsoid => (5.0 * FOOT, -163_840.0 * FOOT, 163_835.0 * FOOT),
            P::UtcTimeOfDay => (1.0, 0.0, 86_399.0),
            P::Roll | P::Pitch | P::TurnRate | P::SlipBall => {
                (0.1 * DEGREE, -3276.7 * DEGREE, 3276.6 * DEGREE)
            }
            P::HeadingMagnetic => (0.1 * DEGREE, 0.0, 3276.6 * DEGREE),
            P::HeadingTrue => (0.1 * DEGREE, -3276.7 * DEGREE, 3276.6 * DEGREE),
            P::NormalAcceleration => (0.1, -3276.7, 3276.6),
            P::IndicatedAirspeed => (KNOT, 0.0, 32_766.0 * KNOT),
            P::TrueAirspeed => (KNOT, 0.0, 65_534.0 * KNOT),
            _ => return None,
        };
        Some(Carried {
            resolution,
            min,
            max,
            // Without a geometric altitude its message is not sent.
            absent: parameter != P::HeightEllipsoid,
            nan: false,
            doubtful: matches!(parameter, P::Latitude | P::Longitude | P::HeightEllipsoid),
        })
    }
}

/// A message between flags, with its CRC, escaped.
#[must_use]
pub fn frame(message: &[u8]) -> Vec<u8> {
    let mut frame = vec![0x7E];
    for byte in message.iter().copied().chain(crc(message).to_le_bytes()) {
        match byte {
            0x7D | 0x7E => frame.extend([0x7D, byte ^ 0x20]),
            byte => frame.push(byte),
        }
    }
    frame.push(0x7E);
    frame
}

/// Steps of a finite number, held between two ends; None where there is no number.
fn steps(truth: &Truth, parameter: Parameter, step: f64, min: f64, max: f64) -> Option<i64> {
    truth
        .finite(parameter)
        .map(|x| whole((x / step).round().clamp(min, max)))
}

fn low_two(n: i64) -> [u8; 2] {
    let [low, high, ..] = n.to_le_bytes();
    [high, low]
}

fn heartbeat(truth: &Truth) -> [u8; 7] {
    let seconds = clock(truth).map(|[h, m, s, _]| whole(h * 3600.0 + m * 60.0 + s));
    let [a, b, c, ..] = seconds.unwrap_or(0).to_le_bytes();
    let placed = u8::from(truth.finite(P::Latitude).is_some() || is_doubtful(truth)) << 7;
    // Position valid and working; bit 16 of the seconds, and that the time is right.
    [
        0,
        placed | 1,
        c << 7 | u8::from(seconds.is_some()),
        a,
        b,
        0,
        0,
    ]
}

fn is_doubtful(truth: &Truth) -> bool {
    truth.get(P::Latitude) == Err(Invalid::Doubtful)
}

fn identity() -> [u8; 39] {
    let mut m = [0; 39];
    m[0] = 0x65;
    m[2] = 1;
    m[3..11].copy_from_slice(&[0, 0, 0, 0, 0, 0, 0, 1]);
    m[11..19].copy_from_slice(b"Bench   ");
    m[19..35].copy_from_slice(b"Glasswing bench ");
    m
}

/// What ownship and traffic reports have in common.
struct Report {
    alert: u8,
    address: u32,
    place: Option<[f64; 2]>,
    /// Of the position's integrity; 0 is unknown.
    integrity: u8,
    /// Of the position's accuracy.
    accuracy: u8,
    pressure_altitude_m: Option<f64>,
    ground_speed_mps: Option<f64>,
    vertical_speed_mps: Option<f64>,
    track_rad: Option<f64>,
    callsign: [u8; 8],
}

impl Report {
    fn message(&self, id: u8) -> [u8; 28] {
        let mut m = [0; 28];
        m[0] = id;
        m[1] = self.alert << 4;
        m[2..5].copy_from_slice(&self.address.to_be_bytes()[1..]);
        for (n, x) in self.place.unwrap_or([0.0; 2]).into_iter().enumerate() {
            let x = whole((x / POSITION).round().clamp(-8_388_608.0, 8_388_607.0));
            let [a, b, c, ..] = x.to_le_bytes();
            m[5 + 3 * n..8 + 3 * n].copy_from_slice(&[c, b, a]);
        }
        let field = |x: Option<f64>, step: f64, zero: f64, [min, max]: [f64; 2], none: i64| {
            x.map_or(none, |x| whole(((x - zero) / step).round().clamp(min, max)))
        };
        let byte = |n: i64| n.to_le_bytes()[0];
        let altitude = field(
            self.pressure_altitude_m,
            25.0 * FOOT,
            -1000.0 * FOOT,
            [0.0, 4094.0],
            0xFFF,
        );
        let speed = field(self.ground_speed_mps, KNOT, 0.0, [0.0, 4094.0], 0xFFF);
        let climb = field(
            self.vertical_speed_mps,
            64.0 * FPM,
            0.0,
            [-509.0, 509.0],
            0x800,
        );
        // Airborne, updated; what the direction is: true track or nothing.
        let flags = 8 | u8::from(self.track_rad.is_some());
        m[11] = byte(altitude >> 4);
        m[12] = byte(altitude << 4) | flags;
        m[13] = if self.place.is_some() {
            self.integrity << 4 | self.accuracy
        } else {
            0
        };
        m[14] = byte(speed >> 4);
        m[15] = byte(speed << 4) | byte(climb >> 8) & 0x0F;
        m[16] = byte(climb);
        let turn = self
            .track_rad
            .map_or(0.0, |x| (x / DEGREE * 256.0 / 360.0).round());
        // A whole turn is none.
        m[17] = byte(whole(turn.clamp(0.0, 256.0)));
        // A light aircraft.
        m[18] = 1;
        m[19..27].copy_from_slice(&self.callsign);
        m
    }
}

fn ownship(truth: &Truth) -> [u8; 28] {
    let place = truth.finite(P::Latitude).zip(truth.finite(P::Longitude));
    let place = place.map(|(latitude, longitude)| [latitude, longitude]);
    let doubtful = is_doubtful(truth);
    let report = Report {
        alert: 0,
        address: 0x00AB_CDEF,
        // One whose integrity is not known is somewhere all the same.
        place: if doubtful { Some([POSITION; 2]) } else { place },
        integrity: if doubtful { 0 } else { 8 },
        accuracy: category(truth.finite(P::HorizontalAccuracy)),
        pressure_altitude_m: truth.finite(P::PressureAltitude),
        ground_speed_mps: truth.finite(P::GroundSpeed),
        vertical_speed_mps: truth.finite(P::VerticalSpeed),
        track_rad: truth.finite(P::Track),
        callsign: *b"N12345  ",
    };
    report.message(0x0A)
}

/// NACp, the category of an error (ICD table 12), 0 when not known.
fn category(error_m: Option<f64>) -> u8 {
    const CATEGORIES: [(f64, u8); 7] = [
        (3.0, 11),
        (10.0, 10),
        (30.0, 9),
        (92.6, 8),
        (185.2, 7),
        (555.6, 6),
        (926.0, 5),
    ];
    let of = |error: f64| {
        CATEGORIES
            .iter()
            .find(|(most, _)| error <= *most)
            .map_or(1, |c| c.1)
    };
    error_m.map_or(0, of)
}

fn traffic(aircraft: &Aircraft) -> [u8; 28] {
    let report = Report {
        alert: u8::from(aircraft.alert != Alert::None),
        address: aircraft.address,
        place: Some([aircraft.latitude_rad, aircraft.longitude_rad]),
        integrity: 8,
        accuracy: 9,
        pressure_altitude_m: Some(aircraft.pressure_altitude_m),
        ground_speed_mps: Some(aircraft.ground_speed_mps),
        vertical_speed_mps: Some(aircraft.vertical_speed_mps),
        track_rad: Some(aircraft.track_rad),
        callsign: aircraft.callsign,
    };
    report.message(0x14)
}

fn geometric_altitude(truth: &Truth) -> Option<[u8; 5]> {
    let height = truth.get(P::HeightEllipsoid);
    let warning = height == Err(Invalid::Doubtful);
    let [a, b] = match height {
        Ok(x) if !x.is_nan() => {
            low_two(whole((x / (5.0 * FOOT)).round().clamp(-32_768.0, 32_767.0)))
        }
        Err(Invalid::Doubtful) => [0, 0],
        _ => return None,
    };
    let error = steps(truth, P::VerticalAccuracy, 1.0, 0.0, 32_766.0).unwrap_or(0x7FFF);
    let [c, d] = low_two(error);
    Some([0x0B, a, b, c | u8::from(warning) << 7, d])
}

fn foreflight_ahrs(truth: &Truth) -> [u8; 12] {
    let mut m = [0; 12];
    m[..2].copy_from_slice(&[0x65, 0x01]);
    let angle = |parameter| steps(truth, parameter, 0.1 * DEGREE, -32_767.0, 32_766.0);
    let speed = |parameter| steps(truth, parameter, KNOT, 0.0, 65_534.0);
    let heading = steps(truth, P::HeadingMagnetic, 0.1 * DEGREE, 0.0, 32_766.0).unwrap_or(0x7FFF);
    let values = [
        angle(P::Roll).unwrap_or(0x7FFF),
        angle(P::Pitch).unwrap_or(0x7FFF),
        // Magnetic.
        heading | 0x8000,
        speed(P::IndicatedAirspeed).unwrap_or(0xFFFF),
        speed(P::TrueAirspeed).unwrap_or(0xFFFF),
    ];
    for (n, value) in values.into_iter().enumerate() {
        m[2 + 2 * n..4 + 2 * n].copy_from_slice(&low_two(value));
    }
    m
}

fn stratux_ahrs(truth: &Truth) -> [u8; 24] {
    let mut m = [0; 24];
    m[..4].copy_from_slice(&[0x4C, 0x45, 1, 1]);
    let signed =
        |parameter, step| steps(truth, parameter, step, -32_767.0, 32_766.0).unwrap_or(0x7FFF);
    let altitude = truth.finite(P::PressureAltitude).map_or(0xFFFF, |x| {
        whole((x / FOOT + 5000.0).round().clamp(0.0, 65_534.0))
    });
    // Against the ball's direction.
    let slip = truth.finite(P::SlipBall).map_or(0x7FFF, |x| {
        whole((-x / (0.1 * DEGREE)).round().clamp(-32_767.0, 32_766.0))
    });
    let values = [
        signed(P::Roll, 0.1 * DEGREE),
        signed(P::Pitch, 0.1 * DEGREE),
        signed(P::HeadingTrue, 0.1 * DEGREE),
        slip,
        signed(P::TurnRate, 0.1 * DEGREE),
        signed(P::NormalAcceleration, 0.1),
        signed(P::IndicatedAirspeed, KNOT),
        altitude,
        signed(P::VerticalSpeed, FPM),
        0x7FFF,
    ];
    for (n, value) in values.into_iter().enumerate() {
        m[4 + 2 * n..6 + 2 * n].copy_from_slice(&low_two(value));
    }
    m
}
