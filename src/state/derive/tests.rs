//! What follows from what, against tables and geometry of others, and what is named where it does not follow.

use super::*;
use crate::units::{Feet, FeetPerMinute, Knots};

const A: SourceId = SourceId(0);

fn ms(t: u64) -> Monotonic {
    Monotonic::from_nanos(t * 1_000_000)
}

fn state(values: &[(P, f64)], at: Monotonic) -> FlightState {
    let mut state = FlightState::empty();
    for &(p, value) in values {
        state.set(p, Sampled::good(value, at), A);
    }
    state
}

fn derived(values: &[(P, f64)]) -> FlightState {
    let mut state = state(values, ms(1000));
    Deriver::new().step(&mut state, ms(1000));
    state
}

fn degrees(x: f64) -> f64 {
    x.to_radians()
}

/// 1 July 2026, in days since 1970.
const DATE: f64 = 20_635.0;

#[test]
fn air_data_follow_from_airspeed_altitude_and_temperature() {
    // 5000 ft in the standard atmosphere: 278.24 K, density ratio 0.8617 (U.S. Standard Atmosphere 1976, table II).
    let all = [
        (P::CalibratedAirspeed, MetresPerSecond::from(Knots(60.0)).0),
        (P::PressureAltitude, Metres::from(Feet(5000.0)).0),
        (P::StaticAirTemperature, 278.244),
    ];
    let state = derived(&all);
    let speed = state
        .read(P::TrueAirspeed, ms(1000))
        .map(|v| Knots::from(MetresPerSecond(v)).0);
    assert!(
        speed.is_ok_and(|kt| (kt - 60.0 / 0.8617_f64.sqrt()).abs() < 0.05),
        "{speed:?}"
    );
    let density = state
        .read(P::DensityAltitude, ms(1000))
        .map(|m| Feet::from(Metres(m)).0);
    assert!(
        density.is_ok_and(|ft| (ft - 5000.0).abs() < 2.0),
        "{density:?}"
    );
    assert!(state.is_derived(P::TrueAirspeed), "nobody said it");
    for (absent, names) in [
        (P::CalibratedAirspeed, P::IndicatedAirspeed),
        (P::PressureAltitude, P::PressureAltitude),
        (P::StaticAirTemperature, P::StaticAirTemperature),
    ] {
        let some: Vec<_> = all.iter().copied().filter(|(p, _)| *p != absent).collect();
        let state = derived(&some);
        assert!(
            state.read(P::TrueAirspeed, ms(1000)).is_err(),
            "without {absent:?}"
        );
        let why = missing(names, Invalid::NeverReceived);
        assert_eq!(
            state.missing(P::TrueAirspeed),
            Some(why),
            "without {absent:?}"
        );
    }
}

#[test]
fn what_a_source_says_is_not_worked_out() {
    let state = derived(&[
        (P::TrueAirspeed, 77.0),
        (P::CalibratedAirspeed, 50.0),
        (P::PressureAltitude, 1000.0),
        (P::StaticAirTemperature, 280.0),
    ]);
    assert_eq!(state.read(P::TrueAirspeed, ms(1000)), Ok(77.0));
    assert!(!state.is_derived(P::TrueAirspeed));
    assert_eq!(state.missing(P::TrueAirspeed), None);
}

#[test]
fn the_wind_closes_the_triangle_of_speeds() {
    // Heading north at 100 kt; over the ground 104.4 kt on a track of 16.7 degrees: 30 kt from the west.
    let knots = |kt: f64| MetresPerSecond::from(Knots(kt)).0;
    let all = [
        (P::TrueAirspeed, knots(100.0)),
        (P::HeadingTrue, 0.0),
        (P::GroundSpeed, knots(100.0_f64.hypot(30.0))),
        (P::Track, 0.3_f64.atan()),
    ];
    let state = derived(&all);
    let speed = state.read(P::WindSpeed, ms(1000));
    assert!(
        speed.is_ok_and(|v| (v - knots(30.0)).abs() < 1e-9),
        "{speed:?}"
    );
    let from = state.read(P::WindDirectionTrue, ms(1000));
    assert!(
        from.is_ok_and(|a| (a - degrees(270.0)).abs() < 1e-9),
        "{from:?}"
    );
    for (absent, named) in [
        (P::TrueAirspeed, P::IndicatedAirspeed),
        (P::HeadingTrue, P::HeadingMagnetic),
        (P::GroundSpeed, P::GroundSpeed),
        (P::Track, P::Latitude),
    ] {
        let some: Vec<_> = all.iter().copied().filter(|(p, _)| *p != absent).collect();
        let missing = derived(&some).missing(P::WindSpeed).map(|m| m.input);
        assert_eq!(missing, Some(named), "without {absent:?}");
    }
}

#[test]
fn turn_rate_is_that_of_a_coordinated_turn() {
    // Three degrees a second level in 20 degrees of bank: q = w sin(roll), r = w cos(roll).
    let w = degrees(3.0);
    let roll = degrees(20.0);
    let state = derived(&[
        (P::Pitch, 0.0),
        (P::Roll, roll),
        (P::PitchRate, w * roll.sin()),
        (P::YawRate, w * roll.cos()),
    ]);
    let rate = state.read(P::TurnRate, ms(1000));
    assert!(rate.is_ok_and(|rate| (rate - w).abs() < 1e-12), "{rate:?}");
    assert_eq!(
        derived(&[(P::YawRate, 0.1)]).missing(P::TurnRate),
        Some(missing(P::PitchRate, Invalid::NeverReceived))
    );
}

#[test]
fn track_follows_from_positions_and_vertical_speed_from_altitudes() {
    // 50 m/s to the north-east from 60 N: a degree of longitude there is 55.80 km, of latitude 111.41 km (any table of
    // the ellipsoid). Climbing 500 ft/min.
    let mut deriver = Deriver::new();
    let climb = MetresPerSecond::from(FeetPerMinute(500.0)).0;
    for k in 0..=30_u64 {
        #[expect(clippy::cast_precision_loss, reason = "a few")]
        let t = k as f64 * 0.1;
        let at = ms(1000 + 100 * k);
        let way = 50.0 * t / 2_f64.sqrt();
        let mut state = state(
            &[
                (P::Latitude, degrees(60.0 + way / 111_410.0)),
                (P::Longitude, degrees(179.999 + way / 55_800.0)).wrapped(),
                (P::PressureAltitude, 1000.0 + climb * t),
            ],
            at,
        );
        deriver.step(&mut state, at);
        let (track, climbing) = (state.read(P::Track, at), state.read(P::VerticalSpeed, at));
        if t < 0.9 {
            let unknown = Invalid::NeverReceived;
            assert_eq!(
                state.missing(P::Track),
                Some(missing(P::Latitude, unknown)),
                "{t} s"
            );
            assert!(climbing.is_err(), "{t} s");
        }
        if t > 1.3 {
            assert!(
                track.is_ok_and(|a| (a.to_degrees() - 45.0).abs() < 0.1),
                "{track:?}"
            );
            assert!(
                climbing.is_ok_and(|v| (v - climb).abs() < 1e-6),
                "{climbing:?}"
            );
        }
    }
}

trait Wrapped {
    fn wrapped(self) -> Self;
}

impl Wrapped for (P, f64) {
    /// Over the date line.
    fn wrapped(self) -> Self {
        (self.0, crate::angle::wrap_signed(Radians(self.1)).0)
    }
}

#[test]
fn standing_still_has_no_track() {
    let mut deriver = Deriver::new();
    for k in 0..40_u64 {
        let at = ms(1000 + 100 * k);
        let mut state = state(&[(P::Latitude, 0.8), (P::Longitude, 0.2)], at);
        deriver.step(&mut state, at);
        assert!(state.read(P::Track, at).is_err(), "{k}");
    }
}

#[test]
fn one_north_follows_from_the_other() {
    // The model's report, test values: 28 km above 89 S, 0 E... is far; Boulder, mid-2026, has about 7.6 degrees east by
    // NOAA's calculator; the exact value is tested with the model itself.
    let place = [
        (P::Latitude, degrees(40.0)),
        (P::Longitude, degrees(-105.25)),
        (P::UtcDate, DATE),
    ];
    let with = |more: (P, f64)| derived(&[&place[..], &[more]].concat());
    let state = with((P::HeadingMagnetic, degrees(356.0)));
    let variation = state
        .read(P::MagneticVariation, ms(1000))
        .unwrap_or(f64::NAN);
    assert!((variation.to_degrees() - 7.6).abs() < 0.5, "{variation}");
    let heading = state.read(P::HeadingTrue, ms(1000));
    assert!(
        heading.is_ok_and(|h| (h - (degrees(-4.0) + variation)).abs() < 1e-9),
        "east is least: true is magnetic plus variation: {heading:?}"
    );
    let back = with((P::HeadingTrue, heading.unwrap_or(0.0)));
    let magnetic = back.read(P::HeadingMagnetic, ms(1000));
    assert!(
        magnetic.is_ok_and(|h| (h - degrees(356.0)).abs() < 1e-9),
        "{magnetic:?}"
    );
    let said = with((P::MagneticVariation, 0.1));
    assert_eq!(
        said.read(P::MagneticVariation, ms(1000)),
        Ok(0.1),
        "a source knows better"
    );
}

#[test]
fn without_a_date_or_after_the_model_there_is_no_other_north() {
    let all = [
        (P::Latitude, 0.8),
        (P::Longitude, 0.2),
        (P::UtcDate, DATE),
        (P::HeadingMagnetic, 1.0),
    ];
    for absent in [P::Latitude, P::Longitude, P::UtcDate] {
        let some: Vec<_> = all.iter().copied().filter(|(p, _)| *p != absent).collect();
        let state = derived(&some);
        let why = Some(missing(absent, Invalid::NeverReceived));
        assert_eq!(state.missing(P::HeadingTrue), why, "without {absent:?}");
    }
    // 1 January 2030.
    let late = derived(&[all[0], all[1], (P::UtcDate, 21_915.0), all[3]]);
    let why = Some(missing(P::UtcDate, Invalid::OutOfRange));
    assert_eq!(late.missing(P::HeadingTrue), why);
    assert!(late.read(P::HeadingTrue, ms(1000)).is_err());
}

#[test]
fn a_refuted_value_is_not_replaced_by_a_derived_one() {
    let mut state = state(
        &[(P::Latitude, 0.8), (P::Longitude, 0.2), (P::UtcDate, DATE)],
        ms(1000),
    );
    state.set(P::HeadingMagnetic, Sampled::good(1.0, ms(1000)), A);
    state.set(
        P::HeadingTrue,
        Sampled::fault(Invalid::Miscompare, ms(1000)),
        A,
    );
    Deriver::new().step(&mut state, ms(1000));
    assert_eq!(
        state.read(P::HeadingTrue, ms(1000)),
        Err(Invalid::Miscompare)
    );
}
