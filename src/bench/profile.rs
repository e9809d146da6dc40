//! A flight profile: a TOML file that says where a flight begins, in which air, and leg by leg how it goes on.
//!
//! [`DEMO`] is one, with every key explained. Keys are checked one by one; what is wrong is named by its key. What a leg does
//! not say: it flies straight, level and as fast as the leg before it.

use super::flight::{BANK_MAX_RAD, Climb, Day, Flight, FlightError, Leg, Start, Turn};
use crate::geo::Geodetic;
use crate::units::{Feet, FeetPerMinute, Hectopascals, Knots, Metres, MetresPerSecond, Radians};
use glam::DVec2;
use serde::Deserialize;
use std::ops::RangeInclusive;
use std::time::Duration;

/// The profile that comes with the program: nine minutes over the Inn valley.
pub const DEMO: &str = include_str!("../../boards/profile-demo.toml");

/// The longest flight, s: four hours.
const SECONDS_MAX: f64 = 4.0 * 3600.0;

/// Why a profile cannot be flown: which key, and why.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{key}: {why}")]
pub struct ProfileError {
    /// The key, with its table: `leg 3, climb_fpm`; empty when the file is no TOML.
    pub key: String,
    /// What is wrong with it.
    pub why: String,
    /// What the user can do.
    pub todo: String,
}

/// The file as it is written.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    start: StartKeys,
    #[serde(default)]
    air: AirKeys,
    #[serde(default)]
    bugs: Bugs,
    leg: Vec<LegKeys>,
    #[serde(default)]
    traffic: Vec<TrafficKeys>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct StartKeys {
    latitude_deg: f64,
    longitude_deg: f64,
    altitude_ft: f64,
    heading_deg: f64,
    airspeed_kt: f64,
    #[serde(default)]
    ground_ft: f64,
    #[serde(default = "a_date")]
    date: String,
    #[serde(default = "a_time")]
    time: String,
}

fn a_date() -> String {
    "2026-07-01".to_owned()
}

fn a_time() -> String {
    "10:00:00".to_owned()
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct AirKeys {
    qnh_hpa: f64,
    warmer_k: f64,
    wind_from_deg: f64,
    wind_kt: f64,
    bumps_deg: f64,
}

impl Default for AirKeys {
    fn default() -> Self {
        Self {
            qnh_hpa: 1013.25,
            warmer_k: 0.0,
            wind_from_deg: 0.0,
            wind_kt: 0.0,
            bumps_deg: 0.5,
        }
    }
}

/// What the pilot has selected; nothing where the file says nothing. Degrees are magnetic.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq)]
#[serde(deny_unknown_fields, default)]
pub struct Bugs {
    /// Degrees.
    pub heading_deg: Option<f64>,
    /// Degrees.
    pub course_deg: Option<f64>,
    /// Feet.
    pub altitude_ft: Option<f64>,
    /// Knots, indicated.
    pub airspeed_kt: Option<f64>,
    /// Feet a minute.
    pub climb_fpm: Option<f64>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct LegKeys {
    seconds: f64,
    bank_deg: Option<f64>,
    turn_deg_per_s: Option<f64>,
    heading_deg: Option<f64>,
    climb_fpm: Option<f64>,
    altitude_ft: Option<f64>,
    airspeed_kt: Option<f64>,
    rpm: Option<f64>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct TrafficKeys {
    callsign: String,
    address: u32,
    bearing_deg: f64,
    distance_nm: f64,
    altitude_ft: f64,
    track_deg: f64,
    speed_kt: f64,
    #[serde(default)]
    climb_fpm: f64,
    #[serde(default)]
    alert: u8,
}

/// Another aircraft of the profile, at the start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Other {
    /// 24 bits.
    pub address: u32,
    /// Padded with spaces.
    pub callsign: [u8; 8],
    /// From the own aircraft's start, clockwise from true north, rad, and m.
    pub bearing_rad: f64,
    /// m.
    pub distance_m: f64,
    /// m.
    pub pressure_altitude_m: f64,
    /// Clockwise from true north, rad.
    pub track_rad: f64,
    /// m/s.
    pub ground_speed_mps: f64,
    /// Up positive, m/s.
    pub vertical_speed_mps: f64,
    /// 0 to 3, FLARM's levels.
    pub alert: u8,
}

/// A profile, flown.
#[derive(Clone, Debug)]
pub struct Profile {
    /// The flight.
    pub flight: Flight,
    /// Days from 1 January 1970 to its first day, UTC.
    pub first_day: f64,
    /// Its first moment in that day, s.
    pub first_second: f64,
    /// Altitude of the ground, which is level, above mean sea level, m.
    pub ground_m: f64,
    /// What the pilot has selected.
    pub bugs: Bugs,
    /// Each leg's end after the start and its engine speed, 1/min.
    pub engine: Vec<(Duration, f64)>,
    /// Others in the air.
    pub others: Vec<Other>,
}

impl Profile {
    /// Reads and flies a profile.
    ///
    /// # Errors
    /// The first key that is wrong.
    pub fn parse(text: &str) -> Result<Self, ProfileError> {
        let file = read(text)?;
        let start = start(&file)?;
        let day = day(&file, &start.place)?;
        let place = Geodetic {
            height_ellipsoid: start.place.height_ellipsoid + day.undulation,
            ..start.place
        };
        let start = Start { place, ..start };
        let (legs, engine) = legs(&file, start.airspeed)?;
        let flight = Flight::of_legs(&start, &legs, day)
            .map_err(|e: FlightError| refused("start", e.to_string(), "begin on Earth"))?;
        Ok(Self {
            flight,
            first_day: date(&file.start.date)?,
            first_second: time(&file.start.time)?,
            ground_m: ground(&file.start)?,
            bugs: bugs(file.bugs)?,
            engine,
            others: others(&file)?,
        })
    }
}

fn refused(
    key: impl Into<String>,
    why: impl Into<String>,
    todo: impl Into<String>,
) -> ProfileError {
    ProfileError {
        key: key.into(),
        why: why.into(),
        todo: todo.into(),
    }
}

fn read(text: &str) -> Result<File, ProfileError> {
    let todo = "see the example in `glasswing simulate --help`";
    let document = toml::Deserializer::parse(text)
        .map_err(|e| refused(line_of(text, &e), e.message(), todo))?;
    serde_path_to_error::deserialize(document).map_err(|e| {
        let path = e.path().to_string();
        let line = line_of(text, e.inner());
        let key = if path == "." {
            line
        } else {
            format!("{line}, {path}")
        };
        refused(key, e.inner().message(), todo)
    })
}

fn line_of(text: &str, e: &toml::de::Error) -> String {
    let at = e.span().map_or(0, |span| span.start);
    let lines = text.get(..at).unwrap_or_default().matches('\n').count();
    format!("line {}", lines + 1)
}

/// A number within bounds.
fn within(key: &str, value: f64, range: RangeInclusive<f64>) -> Result<f64, ProfileError> {
    if range.contains(&value) {
        return Ok(value);
    }
    let todo = format!("give {} to {}", range.start(), range.end());
    Err(refused(key, format!("{value} cannot be"), todo))
}

const ALTITUDES_FT: RangeInclusive<f64> = -1000.0..=30_000.0;
const SPEEDS_KT: RangeInclusive<f64> = 30.0..=300.0;
const CLIMBS_FPM: RangeInclusive<f64> = -3000.0..=3000.0;
const TURN_DEG: RangeInclusive<f64> = 0.0..=360.0;

fn start(file: &File) -> Result<Start, ProfileError> {
    let keys = &file.start;
    let latitude = within("start.latitude_deg", keys.latitude_deg, -89.9..=89.9)?;
    let longitude = within("start.longitude_deg", keys.longitude_deg, -180.0..=180.0)?;
    let altitude = within("start.altitude_ft", keys.altitude_ft, ALTITUDES_FT)?;
    let heading = within("start.heading_deg", keys.heading_deg, TURN_DEG)?;
    let airspeed = within("start.airspeed_kt", keys.airspeed_kt, SPEEDS_KT)?;
    let bumps = within("air.bumps_deg", file.air.bumps_deg, 0.0..=5.0)?;
    Ok(Start {
        place: Geodetic::from_degrees(latitude, longitude, Metres::from(Feet(altitude)).0),
        heading: Radians::from_degrees(heading),
        airspeed: Knots(airspeed).into(),
        bumps: Radians::from_degrees(bumps),
    })
}

fn ground(keys: &StartKeys) -> Result<f64, ProfileError> {
    let ground = within(
        "start.ground_ft",
        keys.ground_ft,
        -1500.0..=keys.altitude_ft,
    )?;
    Ok(Metres::from(Feet(ground)).0)
}

fn day(file: &File, place: &Geodetic) -> Result<Day, ProfileError> {
    let air = &file.air;
    let wind = MetresPerSecond::from(Knots(within("air.wind_kt", air.wind_kt, 0.0..=150.0)?)).0;
    let from = within("air.wind_from_deg", air.wind_from_deg, TURN_DEG)?.to_radians();
    let undulation = egm96::egm96_compute_altitude_offset(
        place.latitude.to_degrees(),
        place.longitude.to_degrees(),
    );
    Ok(Day {
        qnh: Hectopascals(within("air.qnh_hpa", air.qnh_hpa, 900.0..=1060.0)?),
        undulation: Metres(undulation),
        // Towards where it blows.
        wind_mps: DVec2::new(-from.cos(), -from.sin()) * wind,
        warmer_k: within("air.warmer_k", air.warmer_k, -50.0..=50.0)?,
    })
}

/// The legs, and each one's end with its engine speed.
type Legs = (Vec<Leg>, Vec<(Duration, f64)>);

fn legs(file: &File, mut airspeed: MetresPerSecond) -> Result<Legs, ProfileError> {
    let mut legs = Vec::new();
    let mut engine = Vec::new();
    let (mut end_s, mut rpm) = (0.0, 2300.0);
    for (n, keys) in file.leg.iter().enumerate() {
        let key = |name: &str| format!("leg {}, {name}", n + 1);
        let check = |name: &str, value: Option<f64>, range| {
            value.map(|x| within(&key(name), x, range)).transpose()
        };
        let seconds = within(&key("seconds"), keys.seconds, 0.1..=SECONDS_MAX)?;
        end_s += seconds;
        let bank_max = BANK_MAX_RAD.to_degrees().round();
        let bank = check("bank_deg", keys.bank_deg, -bank_max..=bank_max)?;
        let rate = check("turn_deg_per_s", keys.turn_deg_per_s, -20.0..=20.0)?;
        let heading = check("heading_deg", keys.heading_deg, TURN_DEG)?;
        let turn = match (bank, rate, heading) {
            (None, None, None) => Turn::Bank(Radians(0.0)),
            (Some(bank), None, None) => Turn::Bank(Radians::from_degrees(bank)),
            (None, Some(rate), None) => Turn::Rate(rate.to_radians()),
            (None, None, Some(heading)) => Turn::To(Radians::from_degrees(heading)),
            _ => {
                let why = "bank_deg, turn_deg_per_s and heading_deg say the same thing";
                return Err(refused(format!("leg {}", n + 1), why, "keep one of them"));
            }
        };
        let climb = check("climb_fpm", keys.climb_fpm, CLIMBS_FPM)?;
        let altitude = check("altitude_ft", keys.altitude_ft, ALTITUDES_FT)?;
        let climb = match (climb, altitude) {
            (climb, None) => Climb::Rate(FeetPerMinute(climb.unwrap_or(0.0)).into()),
            (None, Some(altitude)) => Climb::To(Feet(altitude).into()),
            _ => {
                let why = "climb_fpm and altitude_ft say the same thing";
                return Err(refused(format!("leg {}", n + 1), why, "keep one of them"));
            }
        };
        if let Some(kt) = check("airspeed_kt", keys.airspeed_kt, SPEEDS_KT)? {
            airspeed = Knots(kt).into();
        }
        rpm = check("rpm", keys.rpm, 0.0..=10_000.0)?.unwrap_or(rpm);
        let duration = Duration::from_secs_f64(seconds);
        engine.push((Duration::from_secs_f64(end_s), rpm));
        legs.push(Leg {
            duration,
            turn,
            climb,
            airspeed,
        });
    }
    if legs.is_empty() || end_s > SECONDS_MAX {
        let why = format!("{} legs of {end_s} s together", legs.len());
        return Err(refused(
            "leg",
            why,
            "give at least one, and four hours at most",
        ));
    }
    Ok((legs, engine))
}

fn bugs(bugs: Bugs) -> Result<Bugs, ProfileError> {
    for (key, value, range) in [
        ("bugs.heading_deg", bugs.heading_deg, TURN_DEG),
        ("bugs.course_deg", bugs.course_deg, TURN_DEG),
        ("bugs.altitude_ft", bugs.altitude_ft, ALTITUDES_FT),
        ("bugs.airspeed_kt", bugs.airspeed_kt, SPEEDS_KT),
        ("bugs.climb_fpm", bugs.climb_fpm, CLIMBS_FPM),
    ] {
        if let Some(value) = value {
            within(key, value, range)?;
        }
    }
    Ok(bugs)
}

fn others(file: &File) -> Result<Vec<Other>, ProfileError> {
    let other = |(n, keys): (usize, &TrafficKeys)| {
        let key = |name: &str| format!("traffic {}, {name}", n + 1);
        let is_name = |b: u8| b.is_ascii_uppercase() || b.is_ascii_digit();
        if keys.callsign.len() > 8 || !keys.callsign.bytes().all(is_name) {
            let todo = "at most eight capital letters and digits";
            return Err(refused(key("callsign"), "is no call sign", todo));
        }
        let mut callsign = [b' '; 8];
        callsign[..keys.callsign.len()].copy_from_slice(keys.callsign.as_bytes());
        within(&key("address"), f64::from(keys.address), 1.0..=16_777_215.0)?;
        within(&key("alert"), f64::from(keys.alert), 0.0..=3.0)?;
        let distance = within(&key("distance_nm"), keys.distance_nm, 0.0..=50.0)?;
        let altitude = within(&key("altitude_ft"), keys.altitude_ft, ALTITUDES_FT)?;
        let speed = within(&key("speed_kt"), keys.speed_kt, 0.0..=600.0)?;
        let climb = within(&key("climb_fpm"), keys.climb_fpm, -6000.0..=6000.0)?;
        Ok(Other {
            address: keys.address,
            callsign,
            bearing_rad: within(&key("bearing_deg"), keys.bearing_deg, TURN_DEG)?.to_radians(),
            distance_m: distance * crate::units::METRES_PER_NAUTICAL_MILE,
            pressure_altitude_m: Metres::from(Feet(altitude)).0,
            track_rad: within(&key("track_deg"), keys.track_deg, TURN_DEG)?.to_radians(),
            ground_speed_mps: MetresPerSecond::from(Knots(speed)).0,
            vertical_speed_mps: MetresPerSecond::from(FeetPerMinute(climb)).0,
            alert: keys.alert,
        })
    };
    file.traffic.iter().enumerate().map(other).collect()
}

/// The numbers of a text of the form `1-2-3`, each within its range.
fn three(text: &str, separator: char, ranges: [RangeInclusive<i32>; 3]) -> Option<[i32; 3]> {
    let mut numbers = [0; 3];
    let mut words = text.split(separator);
    for (number, range) in numbers.iter_mut().zip(ranges) {
        *number = words.next()?.parse().ok().filter(|n| range.contains(n))?;
    }
    words.next().is_none().then_some(numbers)
}

/// Days since 1 January 1970 (Hinnant 2013, "chrono-compatible low-level date algorithms").
fn date(text: &str) -> Result<f64, ProfileError> {
    let no_date = || {
        refused(
            "start.date",
            format!("{text:?} is no date"),
            "as in 2026-07-01",
        )
    };
    let [y, m, d] = three(text, '-', [2001..=2099, 1..=12, 1..=31]).ok_or_else(no_date)?;
    let length = match m {
        2 => 28 + i32::from(y % 4 == 0),
        4 | 6 | 9 | 11 => 30,
        _ => 31,
    };
    if d > length {
        return Err(no_date());
    }
    let (y, m) = (y - i32::from(m <= 2), (m + 9) % 12);
    let days = y * 365 + y / 4 - y / 100 + y / 400 + (153 * m + 2) / 5 + d - 1;
    Ok(f64::from(days - 719_468))
}

fn time(text: &str) -> Result<f64, ProfileError> {
    let [h, m, s] = three(text, ':', [0..=23, 0..=59, 0..=59]).ok_or_else(|| {
        refused(
            "start.time",
            format!("{text:?} is no time"),
            "as in 10:30:00, UTC",
        )
    })?;
    Ok(f64::from(h * 3600 + m * 60 + s))
}

#[cfg(test)]
mod tests;
