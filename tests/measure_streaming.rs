//! `glasswing measure streaming`, in small: its keys, flights that are what they are called, and a quota that is held.

mod support;

use glasswing::app::measure::stream_flights::{self, RATE_HZ};
use glasswing::geo::Camera;
use glasswing::terrain::planet::{Kind, Planet};
use serde_json::Value;

#[test]
fn the_flights_are_as_fast_and_as_high_as_they_are_called() {
    let planet = Planet::new(Kind::Earth, 1200);
    let at = (46.5, planet.mountains_deg(46.5));
    let routes = stream_flights::all(&planet, at, 12.0);
    let speed_kmh = |a: &Camera, b: &Camera| {
        let way_m = (a.eye.to_ecef() - b.eye.to_ecef()).length();
        way_m * RATE_HZ * 3.6
    };
    let [low, fast, leaping] = &routes[..] else {
        unreachable!("three flights")
    };
    for (route, wanted) in [(low, 300.0), (fast, 900.0)] {
        for pair in route.cameras.windows(2) {
            let mut level = [pair[0], pair[1]];
            // Speed over the ground.
            level
                .iter_mut()
                .for_each(|c| c.eye.height_ellipsoid.0 = 0.0);
            let kmh = speed_kmh(&level[0], &level[1]);
            assert!(
                (kmh / wanted - 1.0).abs() < 0.01,
                "{}: {kmh} km/h",
                route.name
            );
        }
        assert!(
            route.leaps.is_empty() && route.aways.is_empty(),
            "{}",
            route.name
        );
    }
    let turned = fast.cameras.iter().any(|c| c.attitude.roll.0.abs() > 1.0);
    assert!(turned, "it turns");
    assert_eq!(leaping.leaps, [1, 151, 301]);
    for &leap in &leaping.leaps {
        let (away, there) = (&leaping.cameras[leap - 1], &leaping.cameras[leap]);
        let far_m = (away.eye.to_ecef() - there.eye.to_ecef()).length();
        assert!(far_m > 10e6, "{far_m} m from nothing to there");
    }
}

#[test]
fn the_command_gives_its_figures_and_holds_the_quota() {
    if support::is_emulated() {
        support::skip("minutes under emulation; nothing in it depends on the machine");
        return;
    }
    let file = support::scratch_dir("measure_streaming").join("streaming.json");
    let output = support::glasswing_command()
        .args([
            "measure",
            "streaming",
            "--seconds",
            "0.3",
            "--hours",
            "0.01",
        ])
        .args(["--vertices", "63", "--json"])
        .arg(&file)
        .output()
        .expect("the program starts");
    let complaint = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{complaint}");
    let text = std::fs::read_to_string(&file).expect("figures");
    let value: Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(value["over_quota_frames"], 0);
    let number = |key: &str| value[key].as_u64().expect("a number");
    assert!(number("upload_bytes_max") > 0);
    assert!(number("upload_bytes_max") <= number("quota_bytes"));
    assert!(number("resident_bytes_max") > 1 << 20);
    assert!(value["late_frames"].is_u64() && value["teleport_frames"].is_u64());
    for part in ["still", "moving"] {
        let ms = &value["frame_ms"][part];
        assert!(ms["max"].as_f64() >= ms["p50"].as_f64(), "{ms}");
    }
    let flights = value["flights"].as_array().expect("flights");
    assert_eq!(flights.len(), 3 * 4, "three flights from four readers");
    assert_eq!(value["long_flight"]["frames"], 360);
}
