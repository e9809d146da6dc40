//! FlightGear's generic protocol: layouts in any order, the real recording with its own layout, lines that are damaged.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

mod proto_support;
mod support;

use glasswing::proto::capture::UdpCapture;
use glasswing::proto::fg_generic::{FgGeneric, Layout, LayoutError, SHIPPED};
use glasswing::proto::{Decoder, Fault};
use glasswing::sampled::Invalid;
use glasswing::signal::{Parameter, Wire};
use proto_support::{Heard, at};

const KNOT: f64 = 1852.0 / 3600.0;
const FOOT: f64 = 0.3048;

fn xml(inner: &str) -> String {
    format!(
        "<?xml version=\"1.0\"?><PropertyList><generic><output>{inner}</output></generic></PropertyList>"
    )
}

fn chunks(nodes: &[&str]) -> String {
    nodes
        .iter()
        .map(|node| format!("<chunk><name>x</name><type>double</type><node>{node}</node></chunk>"))
        .collect()
}

fn decoder(nodes: &[&str]) -> FgGeneric {
    FgGeneric::new(Layout::parse(&xml(&chunks(nodes))).expect("a layout"))
}

fn push(decoder: &mut FgGeneric, line: &str) -> Heard {
    let mut heard = Heard::default();
    decoder.push(at(0, Wire::Datagram(line.as_bytes())), &mut heard);
    heard
}

#[test]
fn fields_are_read_in_the_order_of_the_layout() {
    let nodes = [
        "/orientation/roll-deg",
        "/sim/time/elapsed-sec",
        "/position/latitude-deg",
        "/instrumentation/airspeed-indicator/indicated-speed-kt",
        "/engines/engine[1]/rpm",
        "/consumables/fuel/tank[1]/level-gal_us",
        "/engines/engine[0]/oil-temperature-degf",
    ];
    let values = ["-12.5", "77", "47.25", "95.5", "2400", "10.0", "212"];
    let forwards = push(&mut decoder(&nodes), &(values.join(",") + "\n"));
    let turned: Vec<&str> = nodes.iter().rev().copied().collect();
    let values: Vec<&str> = values.iter().rev().copied().collect();
    let backwards = push(&mut decoder(&turned), &values.join(","));
    for heard in [forwards, backwards] {
        heard.assert_near(Parameter::Roll, -12.5_f64.to_radians());
        heard.assert_near(Parameter::Latitude, 47.25_f64.to_radians());
        heard.assert_near(Parameter::IndicatedAirspeed, 95.5 * KNOT);
        heard.assert_near(Parameter::SecondEngineSpeed, 2400.0);
        heard.assert_near(Parameter::FuelQuantity2, 37.854_117_84);
        heard.assert_near(Parameter::OilTemperature, 373.15);
        assert_eq!(heard.signals.len(), 6);
    }
}

#[test]
fn the_shipped_layout_is_read_whole() {
    let layout = Layout::parse(SHIPPED).expect("a layout");
    assert_eq!(
        layout.known(),
        SHIPPED.matches("<chunk>").count(),
        "every property is known"
    );
}

#[test]
fn layouts_that_cannot_be_used_say_why() {
    let one = chunks(&["/orientation/roll-deg"]);
    for (inner, error) in [
        (String::new(), LayoutError::NoChunks),
        ("<chunk></chunk>".into(), LayoutError::NoNode(1)),
        (
            format!("<binary_mode>true</binary_mode>{one}"),
            LayoutError::Binary,
        ),
        (
            format!("<var_separator>; </var_separator>{one}"),
            LayoutError::Separator("; ".into()),
        ),
        (one.repeat(65), LayoutError::TooMany(65)),
        (
            "<chunk><node>/orientation/roll-deg</node><factor>10</factor></chunk>".into(),
            LayoutError::Scaled(1),
        ),
        ("<!--".to_owned() + &one + "-->", LayoutError::NoChunks),
    ] {
        let got = Layout::parse(&xml(&inner)).expect_err("refused");
        assert_eq!(got, error);
        assert!(!got.todo().is_empty(), "{got}");
    }
    assert!(Layout::parse("no XML at all").is_err());
}

#[test]
fn the_recorded_flight_decodes_by_its_own_layout() {
    let Some(data) = support::data_dir() else {
        return;
    };
    let text = std::fs::read_to_string(data.join("bus/svgc_attitude.xml")).expect("read");
    let mut decoder = FgGeneric::new(Layout::parse(&text).expect("a layout"));
    let bytes = std::fs::read(data.join("bus/fg2020.3.16_c172p_generic_svgc.bin")).expect("read");
    let mut last = Heard::default();
    for record in UdpCapture::new(&bytes) {
        let (_, payload) = record.expect("whole");
        last = Heard::default();
        decoder.push(at(0, Wire::Datagram(payload)), &mut last);
        // The same line, read here by its columns.
        let line = std::str::from_utf8(payload).expect("text").trim_end();
        let f: Vec<f64> = line
            .split(',')
            .map(|x| x.parse().expect("number"))
            .collect();
        last.assert_near(Parameter::Latitude, f[1].to_radians());
        last.assert_near(Parameter::Longitude, f[2].to_radians());
        last.assert_near(Parameter::AltitudeMsl, f[3] * FOOT);
        last.assert_near(Parameter::Roll, f[5].to_radians());
        last.assert_near(Parameter::Pitch, f[6].to_radians());
        last.assert_near(Parameter::HeadingTrue, f[7].to_radians());
        last.assert_near(Parameter::HeadingMagnetic, f[8].to_radians());
        last.assert_near(Parameter::IndicatedAirspeed, f[9] * KNOT);
    }
    // 229 datagrams, a line each.
    let c = decoder.counters();
    assert_eq!((c.good, c.bad_total(), c.ignored), (229, 0, 0));
    assert_eq!(last.signals.len(), 14, "time and slip are not read");
}

#[test]
fn wrong_lines_are_counted_and_wrong_fields_refused() {
    let mut d = decoder(&["/orientation/roll-deg", "/orientation/pitch-deg"]);
    assert!(push(&mut d, "1.0").signals.is_empty(), "too few");
    assert!(push(&mut d, "1.0,2.0,3.0").signals.is_empty(), "too many");
    assert_eq!(
        (
            d.counters().bad(Fault::Short),
            d.counters().bad(Fault::Long)
        ),
        (1, 1)
    );
    let heard = push(&mut d, "nan,2.0");
    assert_eq!(heard.last(Parameter::Roll), Some(Err(Invalid::OutOfRange)));
    heard.assert_near(Parameter::Pitch, 2_f64.to_radians());
    push(&mut d, "1.0,91");
    assert_eq!(
        (
            d.counters().bad(Fault::NotFinite),
            d.counters().bad(Fault::OutOfRange)
        ),
        (1, 1)
    );
    // Two lines in a datagram; the last without its end.
    push(&mut d, "1.0,2.0\n3.0,4.0").assert_near(Parameter::Roll, 3_f64.to_radians());
}

#[test]
fn the_first_line_of_a_stream_may_be_cut_and_is_not_believed() {
    // "-12.5" of which the port saw "2.5" only: a whole number, and a wrong one.
    let nodes = ["/orientation/roll-deg", "/position/latitude-deg"];
    let stream = |d: &mut FgGeneric, bytes: &str| {
        let mut heard = Heard::default();
        d.push(at(0, Wire::Stream(bytes.as_bytes())), &mut heard);
        heard.last(Parameter::Roll)
    };
    let mut d = decoder(&nodes);
    assert_eq!(stream(&mut d, "2.5,47"), None);
    assert_eq!(stream(&mut d, ".5\n"), None, "begun before we listened");
    let roll = Some(Ok((-12.5_f64).to_radians()));
    assert_eq!(stream(&mut d, "-12.5,47.5\n"), roll);
    let c = d.counters();
    assert_eq!((c.good, c.ignored, c.bad_total()), (1, 1, 0));
    // The port was away: the same again.
    assert_eq!(stream(&mut d, ""), None);
    assert_eq!(stream(&mut d, "2.5,47.5\n"), None);
    assert_eq!(stream(&mut d, "-12.5,47.5\n"), roll);
    // A line end says that a line begins.
    let mut d = decoder(&nodes);
    assert_eq!(stream(&mut d, "\n-12.5,47.5\n"), roll);
}
