use super::*;
use crate::angle::shortest_turn;
use crate::signal::Parameter;

fn why(text: &str) -> String {
    let e = Profile::parse(text).expect_err("refused");
    assert!(!e.todo.is_empty(), "{e}");
    e.to_string()
}

#[test]
fn the_demo_is_flown_as_it_is_written() {
    let profile = Profile::parse(DEMO).expect("a profile");
    assert!(
        (profile.flight.duration().as_secs_f64() - 540.0).abs() < 0.1,
        "nine minutes"
    );
    for s in 0..540 {
        let truth = profile.truth_at(Duration::from_secs(s));
        for p in Parameter::ALL {
            if let Ok(x) = truth.get(*p) {
                assert!(p.check(x).is_ok(), "{p:?} at {s} s: {x}");
            }
        }
    }
    let at = |s, p| {
        profile
            .truth_at(Duration::from_secs(s))
            .get(p)
            .expect("there")
    };
    // Three degrees a second at 250 s, within the bumps.
    assert!(
        (at(250, Parameter::TurnRate).to_degrees() - 3.0).abs() < 1.0,
        "turn"
    );
    assert!(
        (at(170, Parameter::VerticalSpeed) / 0.00508 - 500.0).abs() < 100.0,
        "climb"
    );
    assert!(
        (at(50, Parameter::IndicatedAirspeed) / 0.514_444 - 95.0).abs() < 1.5,
        "speed"
    );
    // 2026-07-01 is 20 635 days after 1970-01-01 (Python's datetime.date).
    assert!((at(0, Parameter::UtcDate) - 20_635.0).abs() < 1e-9, "date");
}

#[test]
fn wind_drift_altimetry_and_variation_hold_together() {
    let profile = Profile::parse(DEMO).expect("a profile");
    let truth = profile.truth_at(Duration::from_secs(30));
    let get = |p| truth.get(p).expect("there");
    let velocity =
        |direction: f64, speed: f64| DVec2::new(direction.cos(), direction.sin()) * speed;
    let ground = velocity(get(Parameter::Track), get(Parameter::GroundSpeed));
    let air = velocity(get(Parameter::HeadingTrue), get(Parameter::TrueAirspeed));
    let from = velocity(get(Parameter::WindDirectionTrue), get(Parameter::WindSpeed));
    assert!(
        (ground - air + from).length() < 0.5,
        "{ground} {air} {from}"
    );
    let turn = shortest_turn(
        Radians(get(Parameter::HeadingMagnetic)),
        Radians(get(Parameter::HeadingTrue)),
    );
    assert!(
        (turn.0 - get(Parameter::MagneticVariation)).abs() < 1e-9,
        "variation"
    );
    // The Alps, 2026: about 4 to 5 degrees east.
    assert!((4.0..5.5).contains(&turn.to_degrees()), "{turn:?}");
    // With its setting the altimeter shows the altitude, but for its subscale: that shifts by metres of the standard
    // atmosphere, which are by (1018 / 1013.25)^0.19, 0.09 %, longer than those of the day's column.
    let shown = get(Parameter::BaroAltitude);
    assert!((shown - get(Parameter::AltitudeMsl)).abs() < 2.0, "{shown}");
    // True airspeed from the calibrated one by the atmosphere's own formula.
    let expected = crate::atmosphere::true_airspeed(
        MetresPerSecond(get(Parameter::CalibratedAirspeed)),
        Hectopascals(get(Parameter::StaticPressure)),
        crate::units::Kelvin(get(Parameter::StaticAirTemperature)),
    );
    assert!(
        (expected.0 - get(Parameter::TrueAirspeed)).abs() < 0.01,
        "{expected:?}"
    );
}

#[test]
fn what_is_wrong_is_named_by_its_key() {
    for (from, to, expected) in [
        (
            "altitude_ft = 5000",
            "altitude_ft = 50000",
            "start.altitude_ft: 50000 cannot be",
        ),
        (
            "heading_deg = 80\nairspeed",
            "heading_deg = nan\nairspeed",
            "start.heading_deg: NaN cannot be",
        ),
        (
            "2026-07-01",
            "2026-02-29",
            "start.date: \"2026-02-29\" is no date",
        ),
        (
            "10:00:00",
            "10:61:00",
            "start.time: \"10:61:00\" is no time",
        ),
        ("seconds = 60", "seconds = 0", "leg 1, seconds: 0 cannot be"),
        (
            "bank_deg = -30",
            "bank_deg = -30\nheading_deg = 5",
            "leg 5: bank_deg,",
        ),
        (
            "climb_fpm = -600",
            "climb_fpm = -6000",
            "leg 6, climb_fpm: -6000 cannot be",
        ),
        (
            "\"DEMO1\"",
            "\"demo 1\"",
            "traffic 1, callsign: is no call sign",
        ),
        (
            "wind_kt = 14",
            "wind_kn = 14",
            "line 18, air.wind_kn: unknown field `wind_kn`",
        ),
        (
            "wind_kt = 14",
            "wind_kt = \"strong\"",
            "line 18, air.wind_kt: invalid type",
        ),
        ("[air]", "[air", "line "),
    ] {
        assert!(DEMO.contains(from), "{from}");
        let got = why(&DEMO.replacen(from, to, 1));
        assert!(got.starts_with(expected), "{got}, not {expected}");
    }
    assert!(why("").contains("missing field `start`"), "{}", why(""));
    let (start, _) = DEMO.split_once("[[leg]]").expect("legs");
    assert!(
        why(&format!("leg = []\n{start}")).starts_with("leg: 0 legs"),
        "no leg"
    );
}
