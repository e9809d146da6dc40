use super::*;
use crate::sampled::Sampled;
use crate::signal::SourceId;
use crate::units::MetresPerSecond;

const T0: Monotonic = Monotonic::from_nanos(10_000_000_000);

fn with(values: &[(P, f64)]) -> FlightState {
    let mut state = FlightState::empty();
    for &(parameter, value) in values {
        state.set(parameter, Sampled::good(value, T0), SourceId(0));
    }
    state
}

fn build(state: &FlightState, ui: &Ui) -> Model {
    Model::build(state, ui, &Config::default(), T0)
}

fn fault(state: &mut FlightState, parameter: P, reason: Invalid) {
    state.set(parameter, Sampled::fault(reason, T0), SourceId(0));
}

const FLYING: &[(P, f64)] = &[
    (P::Pitch, 0.05),
    (P::Roll, -0.1),
    (P::HeadingTrue, 1.0),
    (P::Latitude, 0.87),
    (P::Longitude, 0.25),
    (P::AltitudeMsl, 900.0),
];

fn ready() -> Ui {
    Ui {
        terrain: Terrain::Ready,
        ..Ui::default()
    }
}

#[test]
fn nothing_heard_shows_nothing() {
    let m = build(&FlightState::empty(), &ready());
    assert_eq!(m.attitude, Err(Invalid::NeverReceived));
    assert_eq!(m.airspeed, Err(Invalid::NeverReceived));
    assert_eq!(m.altitude, Err(Invalid::NeverReceived));
    assert_eq!(m.heading, Err(Invalid::NeverReceived));
    assert_eq!(m.svs, Err(SvsOff::Attitude(Invalid::NeverReceived)));
}

#[test]
fn altitude_follows_the_pilots_setting() {
    let state = with(&[
        (P::PressureAltitude, 1000.0),
        (P::BaroAltitude, 5.0),
        (P::AltitudeMsl, 7.0),
    ]);
    // 954.61 hPa stands at 500 m (U.S. Standard Atmosphere 1976, table I).
    let mut ui = Ui {
        baro: BaroSetting::new(Hectopascals(954.61)).unwrap_or(BaroSetting::STANDARD),
        ..Ui::default()
    };
    let a = build(&state, &ui).altitude;
    assert!(
        a.is_ok_and(|a| (Metres::from(a.altitude).0 - 500.0).abs() < 0.3
            && a.kind == AltitudeKind::PilotBaro
            && !a.reverted),
        "{a:?}"
    );
    assert_eq!(
        build(&state, &ui).baro,
        BaroBox::Pilot(Hectopascals(954.61))
    );
    ui.baro_standard = true;
    let m = build(&state, &ui);
    assert!(
        m.altitude
            .is_ok_and(|a| (Metres::from(a.altitude).0 - 1000.0).abs() < 1e-6),
        "{m:?}"
    );
    assert_eq!(m.baro, BaroBox::Standard);
}

#[test]
fn a_source_that_corrects_itself_is_shown_with_its_own_setting() {
    let mut state = with(&[(P::BaroAltitude, 1000.0), (P::AltitudeMsl, 7.0)]);
    let m = build(&state, &Ui::default());
    assert!(
        m.altitude.is_ok_and(|a| a.kind == AltitudeKind::SourceBaro),
        "{m:?}"
    );
    assert_eq!(m.baro, BaroBox::Source(Err(Invalid::NeverReceived)));
    state.set(P::BaroSetting, Sampled::good(1002.0, T0), SourceId(0));
    assert_eq!(
        build(&state, &Ui::default()).baro,
        BaroBox::Source(Ok(Hectopascals(1002.0)))
    );
}

#[test]
fn geometric_altitude_is_never_called_barometric() {
    let mut state = with(&[(P::AltitudeMsl, 304.8)]);
    let m = build(&state, &Ui::default());
    assert_eq!(m.baro, BaroBox::Geometric);
    let geometric = Altitude {
        altitude: Feet(304.8 / 0.3048),
        kind: AltitudeKind::Geometric,
        reverted: false,
    };
    assert_eq!(m.altitude, Ok(geometric));
    fault(&mut state, P::PressureAltitude, Invalid::SourceFailed);
    let reverted = Altitude {
        reverted: true,
        ..geometric
    };
    assert_eq!(build(&state, &Ui::default()).altitude, Ok(reverted));
}

#[test]
fn a_disagreement_is_not_hidden_by_a_fallback() {
    for (better, fallback) in [
        (P::IndicatedAirspeed, P::CalibratedAirspeed),
        (P::PressureAltitude, P::AltitudeMsl),
        (P::HeadingTrue, P::HeadingMagnetic),
    ] {
        let mut state = with(&[(fallback, 1.0)]);
        fault(&mut state, better, Invalid::Miscompare);
        let m = build(&state, &Ui::default());
        let shown = [m.airspeed.err(), m.altitude.err(), m.heading.err()];
        assert!(
            shown.contains(&Some(Invalid::Miscompare)),
            "{better:?}: {shown:?}"
        );
    }
}

#[test]
fn indicated_airspeed_comes_before_calibrated_and_each_says_which_it_is() {
    let mut state = with(&[(P::IndicatedAirspeed, 50.0), (P::CalibratedAirspeed, 60.0)]);
    let speed = |m: Model| {
        m.airspeed
            .map(|a| (MetresPerSecond::from(a.speed).0.round(), a.kind, a.reverted))
    };
    assert_eq!(
        speed(build(&state, &Ui::default())),
        Ok((50.0, AirspeedKind::Indicated, false))
    );
    fault(&mut state, P::IndicatedAirspeed, Invalid::OutOfRange);
    assert_eq!(
        speed(build(&state, &Ui::default())),
        Ok((60.0, AirspeedKind::Calibrated, true))
    );
    fault(&mut state, P::CalibratedAirspeed, Invalid::SourceFailed);
    assert_eq!(
        speed(build(&state, &Ui::default())),
        Err(Invalid::SourceFailed)
    );
}

#[test]
fn magnetic_heading_serves_the_tape_but_not_synthetic_vision() {
    let mut values = FLYING.to_vec();
    values[2].0 = P::HeadingMagnetic;
    let m = build(&with(&values), &ready());
    assert!(
        m.heading
            .is_ok_and(|h| h.north == North::Magnetic && !h.reverted),
        "{m:?}"
    );
    assert_eq!(m.svs, Err(SvsOff::HeadingTrue(Invalid::NeverReceived)));
}

#[test]
fn synthetic_vision_names_the_first_thing_missing() {
    assert!(build(&with(FLYING), &ready()).svs.is_ok(), "all there");
    for (missing, label) in [
        (P::Pitch, "NO ATTITUDE"),
        (P::Roll, "NO ATTITUDE"),
        (P::HeadingTrue, "NO TRUE HDG"),
        (P::Latitude, "NO POSITION"),
        (P::Longitude, "NO POSITION"),
        (P::AltitudeMsl, "NO HEIGHT"),
    ] {
        for reason in [Invalid::Stale, Invalid::SourceFailed, Invalid::Miscompare] {
            let mut state = with(FLYING);
            fault(&mut state, missing, reason);
            let off = build(&state, &ready()).svs.err().map(SvsOff::label);
            assert_eq!(off, Some(label), "{missing:?} {reason:?}");
        }
    }
    for (terrain, label) in [
        (Terrain::NoPack, "NO TERRAIN"),
        (Terrain::Loading, "LOADING"),
        (Terrain::Outside, "OUTSIDE DATA"),
        (Terrain::Empty, "EMPTY PACK"),
        (Terrain::NoCamera, "BAD POSITION"),
    ] {
        let ui = Ui {
            terrain,
            ..Ui::default()
        };
        assert_eq!(
            build(&with(FLYING), &ui).svs.err().map(SvsOff::label),
            Some(label)
        );
    }
}

#[test]
fn a_caution_of_the_terrain_goes_with_terrain_that_is_shown() {
    let ui = Ui {
        terrain_caution: Some(TerrainCaution::BelowGround),
        ..ready()
    };
    assert_eq!(
        build(&with(FLYING), &ui).svs_caution,
        Some(TerrainCaution::BelowGround)
    );
    let blind = build(&with(&[(P::Pitch, 0.05), (P::Roll, -0.1)]), &ui);
    assert_eq!(blind.svs_caution, None, "terrain is off: {:?}", blind.svs);
}

#[test]
fn the_ellipsoidal_height_is_preferred_for_the_eye() {
    let mut state = with(FLYING);
    state.set(P::HeightEllipsoid, Sampled::good(945.0, T0), SourceId(0));
    let height = build(&state, &ready()).svs.map(|c| c.height);
    assert_eq!(height, Ok(CameraHeight::Ellipsoid(Metres(945.0))));
}

#[test]
fn the_ball_moves_against_the_acceleration_that_is_felt() {
    let m = build(&with(&[(P::LateralAcceleration, 0.1)]), &Ui::default());
    assert!(
        m.slip.is_ok_and(|s| (s.ball_widths + 1.0).abs() < 1e-12),
        "one width to the left"
    );
}
