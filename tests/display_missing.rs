//! What the display calls missing, from what the state was told: each field names the input that it lacks.

use glasswing::display::Ui;
use glasswing::display::air::{Absent, air, height_above_ground};
use glasswing::signal::{Parameter as P, Signal, SourceId};
use glasswing::state::{FlightState, Fusion};
use glasswing::time::Monotonic;
use glasswing::units::Metres;

const NOW: Monotonic = Monotonic::from_nanos(10_000_000_000);

fn fused(values: &[(P, f64)]) -> FlightState {
    let mut fusion = Fusion::new(&[SourceId(0)]);
    for &(parameter, value) in values {
        fusion.apply(&Signal {
            at: NOW,
            source: SourceId(0),
            parameter,
            value: Ok(value),
        });
    }
    fusion.step(NOW)
}

#[test]
fn each_field_names_what_it_lacks() {
    let mut values = vec![];
    let missing = |values: &[(P, f64)]| {
        let air = air(&fused(values), NOW);
        let of = |absent: Absent| absent.input;
        [
            air.true_airspeed.err().map(of),
            air.temperature_c.err().map(of),
            air.density_altitude.err().map(of),
            air.wind.err().map(of),
        ]
    };
    let (ias, alt, oat) = (Some("IAS"), Some("ALT"), Some("OAT"));
    assert_eq!(missing(&values), [ias, oat, alt, ias]);
    values.push((P::IndicatedAirspeed, 50.0));
    assert_eq!(missing(&values), [alt, oat, alt, alt]);
    values.push((P::PressureAltitude, 1000.0));
    assert_eq!(missing(&values), [oat; 4]);
    values.push((P::StaticAirTemperature, 280.0));
    assert_eq!(missing(&values), [None, None, None, Some("HDG")]);
    values.push((P::HeadingTrue, 1.0));
    assert_eq!(missing(&values)[3], Some("GS"));
    values.push((P::GroundSpeed, 50.0));
    assert_eq!(
        missing(&values)[3],
        Some("POS"),
        "a track could be worked out"
    );
    values.push((P::Track, 1.0));
    assert_eq!(missing(&values), [None; 4]);
}

#[test]
fn height_above_ground_lacks_position_height_or_ground() {
    let mut values = vec![];
    let lacks = |values: &[(P, f64)], ui: &Ui| {
        height_above_ground(&fused(values), ui, NOW).map_err(|absent| absent.input)
    };
    let ui = Ui::default();
    assert_eq!(lacks(&values, &ui), Err("POS"));
    values.extend([(P::Latitude, 0.5), (P::Longitude, 0.5)]);
    assert_eq!(lacks(&values, &ui), Err("GPS ALT"));
    values.push((P::AltitudeMsl, 500.0));
    assert_eq!(lacks(&values, &ui), Err("GROUND"));
    let seen = Ui {
        height_above_ground: Some(Metres(304.8)),
        ..ui
    };
    let height = lacks(&values, &seen).map(|feet| feet.0.round());
    assert_eq!(height, Ok(1000.0));
}
