use super::*;
use crate::sampled::Sampled;
use crate::signal::Report;
use crate::state::Fusion;

const A: SourceId = SourceId(0);
const B: SourceId = SourceId(1);

fn ms(t: u64) -> Monotonic {
    Monotonic::from_nanos(t * 1_000_000)
}

/// At 50 N 14 E, pressure altitude 1000 m.
fn own(at: Monotonic) -> FlightState {
    let mut state = FlightState::empty();
    for (p, value) in [
        (P::Latitude, 50_f64.to_radians()),
        (P::Longitude, 14_f64.to_radians()),
        (P::PressureAltitude, 1000.0),
    ] {
        state.set(p, Sampled::good(value, at), A);
    }
    state
}

fn said(address: Option<u32>, place: Place, t: u64, source: SourceId) -> Traffic {
    Traffic {
        at: ms(t),
        source,
        address,
        callsign: [b' '; 8],
        place,
        track_rad: None,
        ground_speed_mps: None,
        vertical_speed_mps: None,
        airborne: Some(true),
        alert: Alert::None,
    }
}

fn geodetic(latitude_deg: f64, longitude_deg: f64, pressure_altitude_m: Option<f64>) -> Place {
    Place::Geodetic {
        latitude_rad: latitude_deg.to_radians(),
        longitude_rad: longitude_deg.to_radians(),
        pressure_altitude_m,
    }
}

fn relative(north_m: f64, east_m: f64) -> Place {
    Place::Relative {
        north_m,
        east_m,
        up_m: 50.0,
    }
}

fn trust(source: SourceId) -> usize {
    usize::from(source.0)
}

fn seen(skies: &mut Skies, t: u64) -> Vec<Target> {
    let all = skies.around(&own(ms(t)), ms(t));
    all.into_iter().flatten().collect()
}

#[test]
fn an_aircraft_is_where_geodesy_puts_it() {
    let mut skies = Skies::new();
    // One minute of latitude north of 50 N is 1853.8 m (WGS 84: 111 229 m a degree there); one of longitude at 50 N
    // 1194.9 m (71 696 m a degree).
    skies.see(
        &said(
            Some(1),
            geodetic(50.0 + 1.0 / 60.0, 14.0, Some(1300.0)),
            1000,
            A,
        ),
        trust,
    );
    skies.see(
        &said(Some(2), geodetic(50.0, 14.0 - 1.0 / 60.0, None), 1000, A),
        trust,
    );
    let all = seen(&mut skies, 1000);
    assert_eq!(all.len(), 2, "{all:?}");
    let (west, north) = (all[0], all[1]);
    assert!((north.distance_m - 1853.8).abs() < 1.0, "{north:?}");
    assert_eq!(north.up_m, Some(300.0), "between pressure altitudes");
    assert!((west.distance_m - 1194.9).abs() < 1.0, "{west:?}");
    assert_eq!(west.up_m, None, "it does not tell");
    for (target, degrees) in [(north, 0.0), (west, 270.0)] {
        let Direction::True(direction) = target.direction else {
            unreachable!("its place is known: {target:?}")
        };
        let off = shortest_turn(direction, Radians::from_degrees(degrees));
        assert!(off.to_degrees().abs() < 0.02, "{target:?}");
    }
}

#[test]
fn between_reports_it_goes_on_and_then_it_is_gone() {
    let mut skies = Skies::new();
    let mut moving = said(Some(1), geodetic(50.0, 14.1, Some(1000.0)), 1000, A);
    // Due west, towards us, at 50 m/s.
    (moving.track_rad, moving.ground_speed_mps) = (Some(1.5 * std::f64::consts::PI), Some(50.0));
    skies.see(&moving, trust);
    let at_first = seen(&mut skies, 1000)[0].distance_m;
    let after = seen(&mut skies, 11_000)[0].distance_m;
    assert!((at_first - after - 500.0).abs() < 1.0, "{at_first} {after}");
    assert!(
        seen(&mut skies, 11_001).is_empty(),
        "older than ten seconds"
    );

    skies.see(&said(Some(2), relative(500.0, 0.0), 20_000, A), trust);
    assert_eq!(seen(&mut skies, 23_000).len(), 1, "three seconds");
    assert!(seen(&mut skies, 23_001).is_empty(), "no longer");
}

#[test]
fn each_address_has_one_place_and_the_own_has_none() {
    let mut skies = Skies::new();
    skies.see(&said(Some(7), relative(900.0, 0.0), 1000, B), trust);
    skies.see(&said(Some(7), relative(800.0, 0.0), 1500, A), trust);
    skies.see(&said(Some(7), relative(700.0, 0.0), 1600, B), trust);
    let all = seen(&mut skies, 1600);
    assert_eq!(all.len(), 1, "{all:?}");
    assert!(
        (all[0].distance_m - 800.0).abs() < 1e-9,
        "the more trusted one's: {all:?}"
    );
    skies.see(&said(Some(7), relative(600.0, 0.0), 4500, B), trust);
    let all = seen(&mut skies, 4500);
    assert!(
        (all[0].distance_m - 600.0).abs() < 1e-9,
        "it has fallen silent: {all:?}"
    );
    skies.is_own(7);
    assert!(seen(&mut skies, 4500).is_empty(), "that is us");
    skies.see(&said(Some(7), relative(1.0, 0.0), 4600, A), trust);
    assert!(seen(&mut skies, 4600).is_empty(), "and stays us");
}

#[test]
fn a_warning_without_place_raises_what_has_one() {
    let mut skies = Skies::new();
    skies.see(&said(Some(7), relative(900.0, 0.0), 1000, A), trust);
    let bearing = Place::Bearing {
        bearing_relative_rad: 0.0,
        distance_m: 900.0,
        up_m: 50.0,
    };
    let mut warning = said(Some(7), bearing, 1010, A);
    warning.alert = Alert::Urgent;
    skies.see(&warning, trust);
    let all = seen(&mut skies, 1010);
    assert_eq!((all.len(), all[0].alert), (1, Alert::Urgent), "{all:?}");
    assert!(matches!(all[0].direction, Direction::True(_)), "{all:?}");
}

#[test]
fn far_high_and_parked_aircraft_are_left_out_unless_they_are_warned_of() {
    let mut skies = Skies::new();
    let mut parked = said(Some(1), relative(500.0, 0.0), 1000, A);
    parked.airborne = Some(false);
    let far = said(Some(2), relative(18_600.0, 0.0), 1000, A);
    let high = said(Some(3), geodetic(50.01, 14.0, Some(2100.0)), 1000, A);
    let mut warned = said(Some(4), relative(18_600.0, 0.0), 1000, A);
    warned.alert = Alert::Low;
    for t in [parked, far, high, warned] {
        skies.see(&t, trust);
    }
    let all = seen(&mut skies, 1000);
    let addresses: Vec<_> = all.iter().map(|t| t.address).collect();
    assert_eq!(addresses, [Some(4)]);
}

#[test]
fn a_crowded_sky_keeps_the_urgent_and_the_near() {
    let mut skies = Skies::new();
    for k in 0..200_u32 {
        let mut t = said(Some(k), relative(f64::from(18_000 - k * 50), 0.0), 1000, A);
        if k == 0 {
            t.alert = Alert::Low;
        }
        skies.see(&t, trust);
    }
    let all = seen(&mut skies, 1000);
    assert_eq!(all.len(), TRAFFIC_SHOWN_MAX);
    assert_eq!(all[0].address, Some(0), "the urgent one");
    assert_eq!(all[1].address, Some(199), "then the nearest");
    skies.see(&said(Some(999), relative(17_000.0, 0.0), 1000, A), trust);
    assert!(
        !skies.heard.iter().any(|t| t.address == Some(999)),
        "far away in a full sky"
    );
}

#[test]
fn silence_of_a_source_of_traffic_is_told() {
    let feed = |f: &mut Fusion, t: u64| f.step(ms(t)).around.feed;
    let mut f = Fusion::new(&[A, B]);
    assert_eq!(feed(&mut f, 1000), Feed::None, "nobody tells");
    f.report(&Report::Traffic(said(Some(1), relative(1.0, 1.0), 2000, B)));
    assert_eq!(feed(&mut f, 5000), Feed::Live);
    assert_eq!(feed(&mut f, 5001), Feed::Silent);
    let mut f = Fusion::new(&[A, B]).with_traffic_from(&[A]);
    assert_eq!(feed(&mut f, 1000), Feed::Silent, "it has never been heard");
    f.apply(&crate::signal::Signal {
        at: ms(2000),
        source: A,
        parameter: P::UtcTimeOfDay,
        value: Ok(1.0),
    });
    assert_eq!(feed(&mut f, 3000), Feed::Live, "an empty sky");
}
