//! NMEA 0183: a satellite receiver with FLARM (GGA and RMC 5 times a second, GSA, PFLAU and PFLAA once, PGRMZ 5 times), an XCVario
//! (PXCV 10 times), a Levil box (RPYL 10 times) and an LXNAV variometer (PLXVF 10 times), as on one line of a glider.
//!
//! Sources: NMEA 0183 version 4; Garmin, "Proprietary NMEA 0183 sentences" (PGRMZ); FLARM, FTD-012 (PFLAU, PFLAA); XCSoar's device
//! drivers for LXNAV (PLXVF, LXWP0), XCVario (PXCV) and Levil (RPYL). A value that is missing is an empty field; in RPYL 32767;
//! a position that is missing is quality 0 and status V. RPYL has its checksum, which some senders leave out.

use super::field::{DEGREE, FOOT, ICE, KMH, KNOT, calendar, clock, whole};
use super::{Beat, Carried, Encoder, Send};
use crate::angle::wrap_signed;
use crate::bench::truth::{Aircraft, Truth};
use crate::geo::{meridian_radius_m, prime_vertical_radius_m};
use crate::signal::Parameter as P;
use crate::signal::{Alert, Parameter, Wire};
use crate::units::Radians;

/// One line of sentences.
#[derive(Clone, Copy, Debug)]
pub struct Nmea;

const BEATS: [Beat; 7] = [
    Beat::ms(200, 0),
    Beat::ms(1000, 30),
    Beat::ms(200, 60),
    Beat::ms(100, 10),
    Beat::ms(100, 40),
    Beat::ms(100, 80),
    Beat::ms(1000, 530),
];

impl Encoder for Nmea {
    fn beats(&self) -> &'static [Beat] {
        &BEATS
    }

    fn write(&mut self, message: usize, truth: &Truth, send: Send<'_>) {
        let mut say = |body: String| send(Wire::Stream(sentence(&body).as_bytes()));
        match message {
            0 => {
                say(gga(truth));
                say(rmc(truth));
            }
            1 => say(gsa(truth)),
            2 => say(format!(
                "PGRMZ,{},f,3",
                number(truth, P::PressureAltitude, FOOT, 0.0, 0)
            )),
            3 => say(pxcv(truth)),
            4 => say(rpyl(truth)),
            5 => say(plxvf(truth)),
            _ => {
                say(pflau(truth));
                for aircraft in &truth.traffic {
                    if let Some(body) = pflaa(truth, aircraft) {
                        say(body);
                    }
                }
            }
        }
    }

    fn carries(&self, parameter: Parameter) -> Option<Carried> {
        // The coarsest step, where several sentences have it; fields of text without width.
        let step = match parameter {
            P::Latitude | P::Longitude => 1e-5 / 60.0 * DEGREE,
            P::AltitudeMsl => 0.1,
            P::GroundSpeed => 0.01 * KNOT,
            P::Track => 0.01 * DEGREE,
            P::MagneticVariation => 0.1 * DEGREE,
            P::SatellitesUsed | P::FixDimensions | P::UtcTimeOfDay | P::UtcDate => 1.0,
            P::HorizontalDilution => 0.1,
            P::PressureAltitude => FOOT,
            P::TotalEnergyVerticalSpeed => 0.1,
            P::StaticAirTemperature | P::BaroSetting | P::StaticPressure | P::TotalPressure => 0.1,
            P::Roll | P::Pitch | P::HeadingMagnetic | P::TurnRate => 0.1 * DEGREE,
            P::NormalAcceleration => 0.001,
            P::IndicatedAirspeed => 0.01,
            _ => return None,
        };
        let ends = match parameter {
            // The fields of RPYL, whose 32767 means none.
            P::Roll | P::Pitch | P::HeadingMagnetic | P::TurnRate => 3276.6 * DEGREE,
            P::NormalAcceleration => 32.766,
            P::FixDimensions => 3.0,
            P::UtcTimeOfDay => 86_399.0,
            // Its year has two digits.
            P::UtcDate => 40_000.0,
            _ => 1e6,
        };
        let least = match parameter {
            P::UtcDate => 10_957.0,
            P::FixDimensions | P::UtcTimeOfDay => 0.0,
            _ => -ends,
        };
        Some(Carried {
            resolution: step,
            min: least,
            max: ends,
            // The variation's field is left empty by many receivers: it says nothing.
            absent: !matches!(parameter, P::FixDimensions | P::MagneticVariation),
            nan: false,
            doubtful: false,
        })
    }
}

/// A sentence with its checksum and end.
#[must_use]
pub fn sentence(body: &str) -> String {
    let sum = body.bytes().fold(0, |sum, b| sum ^ b);
    format!("${body}*{sum:02X}\r\n")
}

/// A number, or nothing.
fn number(truth: &Truth, parameter: Parameter, step: f64, zero: f64, decimals: usize) -> String {
    truth
        .finite(parameter)
        .map_or_else(String::new, |x| format!("{:.decimals$}", (x - zero) / step))
}

fn has_position(truth: &Truth) -> bool {
    [P::Latitude, P::Longitude]
        .iter()
        .all(|p| truth.finite(*p).is_some())
        && truth.get(P::FixDimensions) != Ok(0.0)
}

/// `DDMM.MMMMM,N,DDDMM.MMMMM,E`, or only the commas.
fn position(truth: &Truth) -> String {
    let (Some(latitude), Some(longitude)) = (truth.finite(P::Latitude), truth.finite(P::Longitude))
    else {
        return ",,,".to_owned();
    };
    let one = |x: f64, width: usize, [positive, negative]: [char; 2]| {
        // Hundred thousandths of a minute.
        let steps = (x.abs() / DEGREE * 6e6).round();
        let (degrees, rest) = ((steps / 6e6).floor(), steps % 6e6 / 1e5);
        let letter = if x < 0.0 { negative } else { positive };
        format!("{degrees:0width$.0}{rest:08.5},{letter}")
    };
    format!(
        "{},{}",
        one(latitude, 2, ['N', 'S']),
        one(longitude, 3, ['E', 'W'])
    )
}

fn time(truth: &Truth) -> String {
    clock(truth).map_or_else(String::new, |[h, m, s, rest]| {
        format!("{h:02.0}{m:02.0}{s:02.0}.{:02}", whole(rest * 100.0))
    })
}

fn gga(truth: &Truth) -> String {
    let quality = u8::from(has_position(truth));
    let satellites = truth.finite(P::SatellitesUsed);
    let satellites = satellites.map_or_else(String::new, |n| format!("{n:02.0}"));
    let undulation = match (
        truth.finite(P::HeightEllipsoid),
        truth.finite(P::AltitudeMsl),
    ) {
        (Some(height), Some(altitude)) => format!("{:.1}", height - altitude),
        _ => String::new(),
    };
    format!(
        "GPGGA,{},{},{quality},{satellites},{},{},M,{undulation},M,,",
        time(truth),
        position(truth),
        number(truth, P::HorizontalDilution, 1.0, 0.0, 1),
        number(truth, P::AltitudeMsl, 1.0, 0.0, 1),
    )
}

fn rmc(truth: &Truth) -> String {
    let (status, mode) = if has_position(truth) {
        ("A", "A")
    } else {
        ("V", "N")
    };
    let date = calendar(truth).map_or_else(String::new, |[y, m, d]| {
        format!("{d:02}{m:02}{:02}", y % 100)
    });
    let variation = truth.finite(P::MagneticVariation).map_or_else(
        || ",".to_owned(),
        |x| {
            format!(
                "{:.1},{}",
                x.abs() / DEGREE,
                if x < 0.0 { "W" } else { "E" }
            )
        },
    );
    format!(
        "GPRMC,{},{status},{},{},{},{date},{variation},{mode}",
        time(truth),
        position(truth),
        number(truth, P::GroundSpeed, KNOT, 0.0, 2),
        number(truth, P::Track, DEGREE, 0.0, 2),
    )
}

fn gsa(truth: &Truth) -> String {
    let dimensions = match truth.finite(P::FixDimensions) {
        Some(x) if x >= 3.0 => 3,
        Some(x) if x >= 2.0 => 2,
        _ => 1,
    };
    let dilution = number(truth, P::HorizontalDilution, 1.0, 0.0, 1);
    format!("GPGSA,A,{dimensions},,,,,,,,,,,,,,{dilution},")
}

fn pxcv(truth: &Truth) -> String {
    // The dynamic pressure in Pa.
    let dynamic = match (
        truth.finite(P::TotalPressure),
        truth.finite(P::StaticPressure),
    ) {
        (Some(total), Some(still)) => {
            format!("{:.1}", (total - (still * 10.0).round() * 0.1) * 100.0)
        }
        _ => String::new(),
    };
    format!(
        "PXCV,{},0.0,0,1.00,0,{},{},{},{dynamic},{},{},,,",
        number(truth, P::TotalEnergyVerticalSpeed, 1.0, 0.0, 1),
        number(truth, P::StaticAirTemperature, 1.0, ICE, 1),
        number(truth, P::BaroSetting, 1.0, 0.0, 1),
        number(truth, P::StaticPressure, 1.0, 0.0, 1),
        number(truth, P::Roll, DEGREE, 0.0, 1),
        number(truth, P::Pitch, DEGREE, 0.0, 1),
    )
}

fn rpyl(truth: &Truth) -> String {
    let tenths = |parameter, step: f64| {
        let steps = truth.finite(parameter).map(|x| (x / step).round());
        steps.map_or(32_767, |steps| whole(steps.clamp(-32_766.0, 32_766.0)))
    };
    format!(
        "RPYL,{},{},{},0,{},{},0",
        tenths(P::Roll, 0.1 * DEGREE),
        tenths(P::Pitch, 0.1 * DEGREE),
        tenths(P::HeadingMagnetic, 0.1 * DEGREE),
        tenths(P::TurnRate, 0.1 * DEGREE),
        tenths(P::NormalAcceleration, 0.001),
    )
}

fn plxvf(truth: &Truth) -> String {
    format!(
        "PLXVF,{},,,,{},{},{}",
        time(truth),
        number(truth, P::TotalEnergyVerticalSpeed, 1.0, 0.0, 2),
        number(truth, P::IndicatedAirspeed, 1.0, 0.0, 2),
        number(truth, P::PressureAltitude, 1.0, 0.0, 1),
    )
}

/// What older LXNAV instruments send in place of PLXVF: airspeed in km/h, and an altitude to which some of them add the setting.
#[must_use]
pub fn lxwp0(truth: &Truth) -> String {
    sentence(&format!(
        "LXWP0,Y,{},{},{},,,,,,,,",
        number(truth, P::IndicatedAirspeed, KMH, 0.0, 1),
        number(truth, P::PressureAltitude, 1.0, 0.0, 1),
        number(truth, P::TotalEnergyVerticalSpeed, 1.0, 0.0, 2),
    ))
}

const fn level(alert: Alert) -> u8 {
    match alert {
        Alert::None => 0,
        Alert::Low => 1,
        Alert::Important => 2,
        Alert::Urgent => 3,
    }
}

/// North, east and up of another aircraft, m.
fn offset(truth: &Truth, aircraft: &Aircraft) -> Option<[f64; 3]> {
    let latitude = truth.finite(P::Latitude)?;
    let longitude = truth.finite(P::Longitude)?;
    let sine = latitude.sin();
    let north = (aircraft.latitude_rad - latitude) * meridian_radius_m(sine);
    let east = wrap_signed(Radians(aircraft.longitude_rad - longitude)).0
        * prime_vertical_radius_m(sine)
        * latitude.cos();
    let up = aircraft.pressure_altitude_m - truth.finite(P::PressureAltitude)?;
    Some([north, east, up])
}

fn pflau(truth: &Truth) -> String {
    let gps = u8::from(has_position(truth)) * 2;
    let head = format!("PFLAU,{},1,{gps},1", truth.traffic.len());
    let worst = truth.traffic.iter().max_by_key(|aircraft| aircraft.alert);
    let seen = worst.and_then(|aircraft| {
        let [north, east, up] = offset(truth, aircraft)?;
        let track = truth.finite(P::Track)?;
        let bearing = wrap_signed(Radians(east.atan2(north) - track)).to_degrees();
        Some(format!(
            "{},{bearing:.0},2,{up:.0},{:.0},{:06X}",
            level(aircraft.alert),
            north.hypot(east),
            aircraft.address
        ))
    });
    seen.map_or_else(
        || format!("{head},0,,0,,,"),
        |seen| format!("{head},{seen}"),
    )
}

fn pflaa(truth: &Truth, aircraft: &Aircraft) -> Option<String> {
    let [north, east, up] = offset(truth, aircraft)?;
    let name = String::from_utf8_lossy(&aircraft.callsign);
    Some(format!(
        "PFLAA,{},{north:.0},{east:.0},{up:.0},1,{:06X}!{},{:.0},,{:.0},{:.1},8",
        level(aircraft.alert),
        aircraft.address,
        name.trim_end(),
        aircraft.track_rad.to_degrees(),
        aircraft.ground_speed_mps,
        aircraft.vertical_speed_mps,
    ))
}
