//! The flight against its own path: what sensors tell must follow from where the aircraft goes.

use super::*;
use crate::angle::shortest_turn;
use crate::proto::Protocol;
use crate::signal::{Frame, Parameter, SourceId, Wire};
use crate::time::Monotonic;
use std::collections::HashMap;

/// A line of 20 km with bends to both sides, a climb and a descent.
fn valley() -> Vec<Geodetic> {
    (0..=100)
        .map(|i| {
            let s = f64::from(i) / 100.0;
            Geodetic::from_degrees(
                47.0 + 0.03 * (s * 9.0).sin() * s,
                11.0 + 0.26 * s,
                900.0 + 500.0 * (s * 5.0).sin(),
            )
        })
        .collect()
}

const DAY: Day = Day {
    qnh: Hectopascals(1018.0),
    undulation: Metres(49.0),
    wind_mps: DVec2::ZERO,
    warmer_k: 0.0,
};

fn flight() -> Flight {
    Flight::along(&valley(), DAY).expect("a line")
}

/// Times over the flight, not on the steps.
fn times(flight: &Flight) -> impl Iterator<Item = Duration> {
    let n = u32::try_from(flight.duration().as_millis()).expect("short") / 137;
    (1..n).map(|k| Duration::from_millis(137) * k)
}

/// Velocity in north, east, down from the positions 50 ms before and after, through Earth-centred coordinates.
fn velocity_ned(flight: &Flight, t: Duration) -> DVec3 {
    let h = Duration::from_millis(50);
    let place = |t| flight.sample(t).position.to_ecef();
    let v = (place(t + h) - place(t - h)) / 0.1;
    flight.sample(t).position.ned_to_ecef().transpose() * v
}

#[test]
fn the_nose_points_along_the_path_but_for_the_angle_of_attack() {
    let flight = flight();
    assert!(flight.duration() > Duration::from_secs(300), "20 km");
    for t in times(&flight).filter(|t| *t + STEP * 5 < flight.duration()) {
        let s = flight.sample(t);
        let v = velocity_ned(&flight, t);
        let body = s.attitude.body_to_ned().transpose() * v;
        let alpha = body.z.atan2(body.x);
        let beta = (body.y / v.length()).asin();
        assert!((alpha - s.angle_of_attack.0).abs() < 2e-3, "{t:?}: {alpha}");
        assert!(beta.abs() < 1e-3, "no sideslip at {t:?}: {beta}");
        assert!((v.length() - s.true_airspeed.0).abs() < 0.05, "{t:?}: {v}");
        assert!((-v.z - s.vertical_speed.0).abs() < 0.05, "{t:?}: {v}");
        assert!(
            (v.truncate().length() - s.ground_speed.0).abs() < 0.05,
            "{t:?}: {v}"
        );
        let track = shortest_turn(s.track, Radians(v.y.atan2(v.x)));
        assert!(track.0.abs() < 1e-3, "{t:?}: {track:?}");
    }
}

#[test]
fn the_sensors_feel_what_the_path_and_gravity_make() {
    let flight = flight();
    let h = Duration::from_millis(100);
    for t in times(&flight).filter(|t| *t > h * 2 && *t + h * 2 < flight.duration()) {
        let s = flight.sample(t);
        let a = (velocity_ned(&flight, t + h) - velocity_ned(&flight, t - h)) / 0.2;
        let felt =
            s.attitude.body_to_ned().transpose() * (a - DVec3::new(0.0, 0.0, 9.80665)) / 9.80665;
        let error = DVec3::new(felt.x, felt.y, -felt.z) - s.felt_g;
        assert!(error.length() < 0.01, "{t:?}: {error}");
        assert!(s.felt_g.y.abs() < 1e-3, "coordinated at {t:?}");
        // Rates carry the attitude on by what it changes.
        let later = flight.sample(t + STEP).attitude.body_to_ned();
        let turn = DMat3::from_quat(glam::DQuat::from_scaled_axis(s.rates_radps * STEP_S));
        let predicted = s.attitude.body_to_ned() * turn;
        assert!(predicted.abs_diff_eq(later, 2e-4), "{t:?}");
    }
}

#[test]
fn the_flight_follows_its_line_as_an_ultralight_can() {
    let line = valley();
    let flight = flight();
    let (mut bank_max, mut left, mut right) = (0.0_f64, false, false);
    for t in times(&flight) {
        let s = flight.sample(t);
        let here = s.position.to_ecef();
        let nearest = line
            .windows(2)
            .map(|w| {
                let (a, b) = (w[0].to_ecef(), w[1].to_ecef());
                let f = ((here - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
                (a + (b - a) * f - here).length()
            })
            .fold(f64::INFINITY, f64::min);
        assert!(nearest < 120.0, "{nearest} m off the line at {t:?}");
        let roll = s.attitude.roll.0;
        bank_max = bank_max.max(roll.abs());
        left |= roll < -0.1;
        right |= roll > 0.1;
        assert!(s.rates_radps.x.abs() < 0.21, "roll rate at {t:?}");
        assert!(
            (45.0..65.0).contains(&s.true_airspeed.0),
            "{:?}",
            s.true_airspeed
        );
    }
    assert!(bank_max < 0.53, "{bank_max}");
    assert!(left && right, "turns both ways");
    let end = flight.sample(flight.duration()).position;
    let last = line[line.len() - 1];
    assert!(
        (end.to_ecef() - last.to_ecef()).length() < 120.0,
        "it arrives"
    );
}

#[test]
fn the_altimeter_at_the_days_setting_shows_the_height_above_the_sea() {
    let flight = flight();
    let s = flight.sample(Duration::from_secs(60));
    // ICAO Doc 7488/3, 27.3 ft a hectopascal near sea level: 4.75 hPa are about 39.5 m.
    let difference = s.altitude_msl.0 - s.pressure_altitude.0;
    assert!((38.0..42.0).contains(&difference), "{difference}");
    assert!(
        (s.altitude_msl.0 + 49.0 - s.position.height_ellipsoid.0).abs() < 1e-9,
        "undulation"
    );
    // Doc 7488/3 table: 1000 m has 281.65 K and a density of 1.1117 of 1.225 kg/m3.
    let standard = Day {
        qnh: Hectopascals(1013.25),
        ..DAY
    };
    let air = Air::at(Metres(1000.0), standard);
    assert!(
        (air.temperature.0 - 281.65).abs() < 1e-9,
        "{:?}",
        air.temperature
    );
    assert!(
        (air.density_ratio - 1.11166 / 1.225).abs() < 2e-5,
        "{}",
        air.density_ratio
    );
    assert!(
        (air.pressure_altitude.0 - 1000.0).abs() < 1e-6,
        "standard day"
    );
}

#[test]
fn what_the_sensors_send_decodes_to_the_flight() {
    let flight = flight();
    let mut decoder = Protocol::CanAerospace.decoder();
    let mut sensors = Sensors::new();
    let mut frames = Vec::new();
    // In uneven portions: what was sent is not sent again.
    let mut t = Duration::ZERO;
    while t < flight.duration() + STEP * 20 {
        sensors.send_until(&flight, t, &mut |at, can| frames.push((at, can)));
        t += Duration::from_millis(33);
    }
    assert!(
        frames.windows(2).all(|w| w[0].0 <= w[1].0),
        "in order of time"
    );
    let mut counts: HashMap<Parameter, u32> = HashMap::new();
    for (at, can) in frames {
        let s = flight.sample(at);
        let expected = |p| match p {
            Parameter::Pitch => s.attitude.pitch.0,
            Parameter::Roll => s.attitude.roll.0,
            Parameter::HeadingTrue => s.attitude.heading_true.0,
            Parameter::RollRate => s.rates_radps.x,
            Parameter::PitchRate => s.rates_radps.y,
            Parameter::YawRate => s.rates_radps.z,
            Parameter::LongitudinalAcceleration => s.felt_g.x,
            Parameter::LateralAcceleration => s.felt_g.y,
            Parameter::NormalAcceleration => s.felt_g.z,
            Parameter::IndicatedAirspeed => s.indicated_airspeed.0,
            Parameter::TrueAirspeed => s.true_airspeed.0,
            Parameter::PressureAltitude => s.pressure_altitude.0,
            Parameter::BaroSetting => 1018.0,
            Parameter::BaroAltitude => s.altitude_msl.0,
            Parameter::VerticalSpeed => s.vertical_speed.0,
            Parameter::AngleOfAttack => s.angle_of_attack.0,
            Parameter::StaticAirTemperature => s.temperature.0,
            Parameter::Latitude => s.position.latitude.0,
            Parameter::Longitude => s.position.longitude.0,
            Parameter::HeightEllipsoid => s.position.height_ellipsoid.0,
            Parameter::GroundSpeed => s.ground_speed.0,
            Parameter::Track => s.track.0,
            other => panic!("{other:?} is not sent"),
        };
        let frame = Frame {
            at: Monotonic::from_nanos(0).plus(at),
            source: SourceId(0),
            wire: Wire::Can(can),
        };
        decoder.push(frame, &mut |signal: crate::signal::Signal| {
            let got = signal.value.expect("good");
            let x = expected(signal.parameter);
            let exact = matches!(signal.parameter, Parameter::Latitude | Parameter::Longitude);
            // A FLOAT has 24 bits.
            let tolerance = if exact {
                1e-14
            } else {
                1e-6 * x.abs().max(1.0)
            };
            assert!((got - x).abs() <= tolerance, "{signal:?}, not {x}");
            *counts.entry(signal.parameter).or_default() += 1;
        });
    }
    let counters = decoder.counters();
    assert_eq!(counters.good, counters.total(), "all frames are good");
    let flow = counters.flow;
    assert_eq!((flow.lost, flow.repeated, flow.failed), (0, 0, 0));
    let seconds = u32::try_from(flight.duration().as_secs()).expect("short");
    let near = |count: u32, hz: u32| count.abs_diff(seconds * hz) <= hz;
    assert!(near(counts[&Parameter::Roll], 50), "{counts:?}");
    assert!(
        near(counts[&Parameter::IndicatedAirspeed], 10),
        "{counts:?}"
    );
    assert!(near(counts[&Parameter::Latitude], 10), "{counts:?}");
}

#[test]
fn a_flight_is_the_same_every_time_and_ends_where_it_ends() {
    let (a, b) = (flight(), flight());
    assert_eq!(a.duration(), b.duration());
    for t in times(&a) {
        assert_eq!(a.sample(t), b.sample(t), "{t:?}");
    }
    let end = a.duration();
    assert_eq!(a.sample(end), a.sample(end * 2), "it stays at its end");
}

#[test]
fn lines_that_are_none_are_refused() {
    let p = Geodetic::from_degrees(47.0, 11.0, 900.0);
    let nowhere = Geodetic::from_degrees(97.0, 11.0, 900.0);
    for (line, error) in [
        (vec![], FlightError::TooShort),
        (vec![p], FlightError::TooShort),
        (vec![p, p], FlightError::TooShort),
        (vec![p, nowhere], FlightError::NoPlace(1)),
    ] {
        assert_eq!(Flight::along(&line, DAY).err(), Some(error));
    }
}

#[test]
fn corners_are_flown_as_turns() {
    // Two right angles, 4 km apart.
    let line: Vec<_> = [(47.0, 11.0), (47.05, 11.0), (47.05, 11.06), (47.1, 11.06)]
        .map(|(lat, lon)| Geodetic::from_degrees(lat, lon, 1000.0))
        .into();
    let flight = Flight::along(&line, DAY).expect("a line");
    let end = flight.sample(flight.duration());
    assert!(
        shortest_turn(Radians(0.0), end.track).0.abs() < 0.1,
        "north again"
    );
    assert!(
        flight.duration() < Duration::from_secs(400),
        "{:?}",
        flight.duration()
    );
}

#[test]
fn the_state_finds_nothing_wrong_with_a_flight_without_noise() {
    use crate::state::{Compared, Fusion};
    let flight = flight();
    let mut decoder = Protocol::CanAerospace.decoder();
    let mut fusion = Fusion::new(&[SourceId(0)]);
    let mut sensors = Sensors::new();
    let start = Monotonic::from_nanos(1_000_000_000);
    let mut t = Duration::ZERO;
    while t < flight.duration() {
        sensors.send_until(&flight, t, &mut |after, can| {
            let frame = Frame {
                at: start.plus(after),
                source: SourceId(0),
                wire: Wire::Can(can),
            };
            decoder.push(frame, &mut |signal: crate::signal::Signal| {
                fusion.apply(&signal);
            });
        });
        let now = start.plus(t);
        let state = fusion.step(now);
        for p in [
            Parameter::Pitch,
            Parameter::Roll,
            Parameter::HeadingTrue,
            Parameter::IndicatedAirspeed,
            Parameter::PressureAltitude,
            Parameter::Latitude,
        ] {
            let value = state.read(p, now);
            let early = t < Duration::from_millis(500);
            assert!(early || value.is_ok(), "{p:?} at {t:?}: {value:?}");
            assert_eq!(state.fallback(p, now), None, "{p:?} at {t:?}");
        }
        let disagrees = Compared::ALL.iter().any(|c| state.miscompares(*c));
        assert!(!disagrees, "one source cannot disagree");
        t += Duration::from_millis(20);
    }
}
