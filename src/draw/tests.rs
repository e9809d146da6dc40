//! The whole display, as lists: flags differ from everything healthy, and nothing that a state can hold breaks it.

use super::atlas::Atlas;
use super::list::{Rect, Vertex};
use super::{DrawList, Layout, draw};
use crate::display::{BaroSetting, BaroUnit, Config, Model, Terrain, TerrainCaution, Ui, VSpeeds};
use crate::sampled::{Invalid, Sampled};
use crate::signal::{Parameter as P, SourceId};
use crate::state::FlightState;
use crate::time::Monotonic;
use crate::units::{Knots, Radians};
use proptest::prelude::*;
use std::sync::LazyLock;

const NOW: Monotonic = Monotonic::from_nanos(1_000_000_000_000);
static ATLAS: LazyLock<Atlas> =
    LazyLock::new(|| Atlas::build().unwrap_or_else(|e| unreachable!("{e}")));

/// Panel sizes that the layout is made for.
const PANELS: [(u32, u32); 5] = [
    (1024, 600),
    (800, 480),
    (1280, 800),
    (1920, 1080),
    (640, 480),
];

const HEALTHY: &[(P, f64)] = &[
    (P::Pitch, 0.06),
    (P::Roll, 0.2),
    (P::HeadingTrue, 4.8),
    (P::LateralAcceleration, 0.03),
    (P::IndicatedAirspeed, 60.0),
    (P::PressureAltitude, 1675.0),
    (P::VerticalSpeed, 3.0),
    (P::GroundSpeed, 65.0),
    (P::Track, 5.0),
];

fn healthy() -> FlightState {
    let mut state = FlightState::empty();
    for &(parameter, value) in HEALTHY {
        state.set(parameter, Sampled::good(value, NOW), SourceId(0));
    }
    state
}

fn drawn(state: &FlightState, list: &mut DrawList) -> Layout {
    let layout = Layout::new(1024, 600);
    let model = Model::build(state, &Ui::default(), &Config::default(), NOW);
    draw(&model, &layout, &ATLAS, list);
    layout
}

/// The quads whose middle lies in `rect`, without their colours.
fn inside(list: &DrawList, rect: Rect) -> Vec<[Vertex; 4]> {
    let quads = list.vertices().chunks_exact(4).filter_map(|q| {
        let middle = |axis: usize| q.iter().map(|v| v.position[axis]).sum::<f32>() / 4.0;
        let (x, y) = (middle(0), middle(1));
        let colourless = |v: Vertex| Vertex {
            colour: [0; 4],
            ..v
        };
        (x >= rect.min.x && x <= rect.max.x && y >= rect.min.y && y <= rect.max.y)
            .then(|| [q[0], q[1], q[2], q[3]].map(colourless))
    });
    quads.collect()
}

fn text(quads: &[[Vertex; 4]]) -> String {
    let characters = quads.iter().filter(|q| q[0].glyph != 0);
    characters
        .filter_map(|q| char::from_u32(q[0].glyph))
        .collect()
}

/// A field: the parameters that it needs, and where it is.
type Field = (&'static str, &'static [P], fn(&Layout) -> Rect);

const FIELDS: [Field; 9] = [
    ("attitude by pitch", &[P::Pitch], |l| l.attitude_flag),
    ("attitude by roll", &[P::Roll], |l| l.attitude_flag),
    ("slip", &[P::LateralAcceleration], |l| l.slip_flag),
    ("heading", &[P::HeadingTrue, P::HeadingMagnetic], |l| {
        l.heading
    }),
    (
        "airspeed",
        &[P::IndicatedAirspeed, P::CalibratedAirspeed],
        |l| l.airspeed,
    ),
    (
        "altitude",
        &[P::PressureAltitude, P::BaroAltitude, P::AltitudeMsl],
        |l| l.altitude,
    ),
    ("vertical speed", &[P::VerticalSpeed], |l| l.vertical_speed),
    ("ground speed", &[P::GroundSpeed], |l| l.ground_speed),
    ("track", &[P::Track], |l| l.track),
];

const REASONS: [(Invalid, &str); 7] = [
    (Invalid::NeverReceived, "---"),
    (Invalid::Stale, "OLD"),
    (Invalid::OutOfRange, "FAIL"),
    (Invalid::SourceFailed, "FAIL"),
    (Invalid::Frozen, "FAIL"),
    (Invalid::Implausible, "FAIL"),
    (Invalid::Miscompare, "CMP"),
];

#[test]
fn each_flag_shows_its_word_no_figure_and_a_shape_of_its_own() {
    let mut list = DrawList::new();
    for (name, parameters, place) in FIELDS {
        let layout = drawn(&healthy(), &mut list);
        let mut shapes = vec![inside(&list, place(&layout))];
        let shown = text(&shapes[0]);
        for (reason, word) in REASONS {
            let mut state = healthy();
            for parameter in parameters {
                state.set(*parameter, Sampled::fault(reason, NOW), SourceId(0));
            }
            drawn(&state, &mut list);
            let shape = inside(&list, place(&layout));
            let flag = text(&shape).replace(' ', "");
            assert!(!shown.contains(word), "{name} healthy: {shown}");
            assert!(flag.contains(word), "{name} {reason:?}: {flag}");
            assert!(
                !flag.contains(|c: char| c.is_ascii_digit()),
                "{name} {reason:?}: {flag}"
            );
            shapes.push(shape);
        }
        // Without colours and without words: all that has failed is one class, all others differ.
        let wordless = |shape: &Vec<[Vertex; 4]>| {
            let solid = shape.iter().filter(|q| q[0].glyph == 0);
            solid.copied().collect::<Vec<_>>()
        };
        for (i, a) in shapes.iter().enumerate() {
            for (j, b) in shapes.iter().enumerate().skip(i + 1) {
                let one_class = (3..=6).contains(&i) && (3..=6).contains(&j);
                assert_eq!(wordless(a) == wordless(b), one_class, "{name}: {i} and {j}");
            }
        }
    }
}

#[test]
fn a_flagged_tape_leaves_none_of_its_figures_anywhere() {
    let mut list = DrawList::new();
    // Nothing but the pilot's own setting has digits when nothing is received.
    let layout = drawn(&FlightState::empty(), &mut list);
    let setting = text(&inside(&list, layout.baro));
    let digits = |s: String| s.chars().filter(char::is_ascii_digit).collect::<String>();
    assert_eq!(digits(setting), "1013");
    assert_eq!(digits(list.characters().collect()), "1013");
}

#[test]
fn without_attitude_there_is_no_ladder_no_horizon_and_no_roll_scale() {
    let mut list = DrawList::new();
    let mut state = healthy();
    state.set(P::Roll, Sampled::fault(Invalid::Stale, NOW), SourceId(0));
    drawn(&state, &mut list);
    // Nothing is tilted but the diagonals of flags and the tips of windows, which lie outside of the middle.
    let sky = Rect::new(290.0, 60.0, 440.0, 95.0);
    let above = inside(&list, sky);
    // The pointer and the foot of the slip ball, each with its rim.
    assert_eq!(above.len(), 4, "{above:?}");
}

#[test]
fn the_healthy_display_reads_what_it_was_given() {
    let mut list = DrawList::new();
    let layout = drawn(&healthy(), &mut list);
    let read = |rect| text(&inside(&list, rect));
    // 65 m/s is 126.35 kt; 5 rad is 286.5 degrees; 4.8 rad is 275.02 degrees; 3 m/s is 590.6 ft/min.
    assert_eq!(read(layout.ground_speed), "GS126KT");
    assert_eq!(read(layout.track), "TRK286\u{b0}T");
    assert_eq!(read(layout.heading_window), "275\u{b0}T");
    let vertical_speed = read(layout.vertical_speed.grown(20.0));
    assert!(vertical_speed.contains("FPM600"), "{vertical_speed}");
    assert_eq!(read(layout.baro), "1013HPA");
    assert_eq!(read(layout.airspeed_title), "IASKT");
    assert_eq!(read(layout.altitude_title), "ALTFT");
}

#[test]
fn a_geometric_altitude_says_so() {
    let mut list = DrawList::new();
    let mut state = FlightState::empty();
    state.set(P::AltitudeMsl, Sampled::good(500.0, NOW), SourceId(0));
    let layout = drawn(&state, &mut list);
    let read = |rect| text(&inside(&list, rect));
    assert_eq!(read(layout.altitude_title), "GEOALTFT");
    assert_eq!(read(layout.baro), "NOBARO");
}

#[test]
fn terrain_is_left_visible_only_when_the_camera_has_everything() {
    let layout = Layout::new(1024, 600);
    let mut list = DrawList::new();
    let mut state = healthy();
    for (parameter, value) in [
        (P::Latitude, 0.8),
        (P::Longitude, 0.2),
        (P::AltitudeMsl, 900.0),
    ] {
        state.set(parameter, Sampled::good(value, NOW), SourceId(0));
    }
    let ui = Ui {
        terrain: Terrain::Ready,
        ..Ui::default()
    };
    let covers = |v: &[Vertex]| {
        v[0].glyph == 0
            && v[0].position[0] <= 0.0
            && v[2].position[0] >= 1024.0
            && v[2].position[1] >= 600.0
    };
    let mut covered = |state: &FlightState, ui: &Ui| {
        let model = Model::build(state, ui, &Config::default(), NOW);
        draw(&model, &layout, &ATLAS, &mut list);
        (
            list.vertices().chunks_exact(4).any(covers),
            list.characters().collect::<String>(),
        )
    };
    let (hidden, words) = covered(&state, &ui);
    assert!(!hidden && !words.contains("SVS"), "{words}");
    let cautioned = Ui {
        terrain_caution: Some(TerrainCaution::NoDataBelow),
        ..ui
    };
    let (hidden, words) = covered(&state, &cautioned);
    assert!(!hidden && words.contains("TERRAINNODATAHERE"), "{words}");
    state.set(
        P::Longitude,
        Sampled::fault(Invalid::Stale, NOW),
        SourceId(0),
    );
    let (hidden, words) = covered(&state, &ui);
    assert!(hidden && words.contains("SVSOFFNOPOSITION"), "{words}");
}

/// A state in which each parameter is absent, faulty, old, or anywhere in its range, ends included.
fn any_state() -> impl Strategy<Value = FlightState> {
    let one = prop_oneof![
        6 => (0.0..=1.0_f64).prop_map(Some),
        1 => Just(Some(0.0)),
        1 => Just(Some(1.0)),
        2 => Just(None),
    ];
    let faults = [
        Invalid::Stale,
        Invalid::OutOfRange,
        Invalid::SourceFailed,
        Invalid::Frozen,
        Invalid::Implausible,
        Invalid::Miscompare,
    ];
    proptest::collection::vec((one, 0..8_usize), P::COUNT).prop_map(move |choices| {
        let mut state = FlightState::empty();
        for (parameter, (fraction, fault)) in P::ALL.iter().zip(choices) {
            let spec = parameter.spec();
            let sample = match (fraction, faults.get(fault)) {
                (Some(f), _) => Sampled::good(spec.min + (spec.max - spec.min) * f, NOW),
                (None, Some(reason)) => Sampled::fault(*reason, NOW),
                (None, None) => continue,
            };
            state.set(*parameter, sample, SourceId(0));
        }
        state
    })
}

proptest! {
    #[test]
    fn no_state_breaks_the_display_or_overflows_the_list(
        state in any_state(),
        panel in 0..PANELS.len(),
        hfov in 20.0..120.0_f64,
        baro in 931.0..=1067.0_f64,
        limits in any::<[bool; 3]>(),
    ) {
        let [standard, inches, terrain] = limits;
        let (width, height) = PANELS[panel];
        let ui = Ui {
            baro: BaroSetting::new(crate::units::Hectopascals(baro)).unwrap_or(BaroSetting::STANDARD),
            baro_standard: standard,
            terrain: if terrain { Terrain::Ready } else { Terrain::Outside },
            terrain_caution: standard.then_some(TerrainCaution::NoDataBelow),
            ..Ui::default()
        };
        let speeds = [40.0, 48.0, 85.0, 129.0, 163.0].map(|kt| Some(Knots(kt)));
        let [vs0, vs1, vfe, vno, vne] = speeds;
        let config = Config {
            baro_unit: if inches { BaroUnit::InchesOfMercury } else { BaroUnit::Hectopascals },
            v_speeds: VSpeeds { vs0, vs1, vfe, vno, vne },
            hfov: Radians::from_degrees(hfov),
            ..Config::default()
        };
        let mut list = DrawList::new();
        let model = Model::build(&state, &ui, &config, NOW);
        draw(&model, &Layout::new(width, height), &ATLAS, &mut list);
        prop_assert_eq!(list.left_out(), 0);
        prop_assert!(list.quads() > 100, "an empty display");
        for v in list.vertices() {
            prop_assert!(v.position.iter().chain(&v.edges).all(|x| x.is_finite()), "{:?}", v);
        }
    }
}

/// What a state reads as, by place.
fn reads(state: &FlightState, ui: &Ui, place: fn(&Layout) -> Rect) -> String {
    let layout = Layout::new(1024, 600);
    let mut list = DrawList::new();
    let model = Model::build(state, ui, &Config::default(), NOW);
    draw(&model, &layout, &ATLAS, &mut list);
    text(&inside(&list, place(&layout)))
}

#[test]
fn what_the_air_does_reads_as_given_or_names_what_is_missing() {
    let ui = Ui::default();
    let mut state = healthy();
    for (p, value) in [
        (P::TrueAirspeed, 61.733),
        (P::StaticAirTemperature, 261.0),
        (P::DensityAltitude, 3000.0),
        (P::WindSpeed, 5.144),
        (P::WindDirectionTrue, 4.0),
        (P::HeightAgl, -30.0),
    ] {
        state.set(p, Sampled::good(value, NOW), SourceId(0));
    }
    // 61.733 m/s is 120 kt, 5.144 m/s 10 kt, 4 rad 229 degrees, 3000 m 9843 ft, 30 m 98 ft.
    assert_eq!(reads(&state, &ui, |l| l.true_airspeed), "TAS120KT");
    assert_eq!(reads(&state, &ui, |l| l.temperature), "OAT-12\u{b0}C");
    assert_eq!(reads(&state, &ui, |l| l.density_altitude), "DA9840FT");
    assert_eq!(reads(&state, &ui, |l| l.wind), "10KT229\u{b0}T");
    assert_eq!(reads(&state, &ui, |l| l.height_above_ground), "AGL-100FT");
    let mut fusion = crate::state::Fusion::new(&[SourceId(0)]);
    fusion.apply(&crate::signal::Signal {
        at: NOW,
        source: SourceId(0),
        parameter: P::IndicatedAirspeed,
        value: Ok(50.0),
    });
    let lacking = fusion.step(NOW);
    assert_eq!(reads(&lacking, &ui, |l| l.true_airspeed), "TASALTNO");
    assert_eq!(reads(&lacking, &ui, |l| l.height_above_ground), "AGLPOSNO");
}

#[test]
fn other_aircraft_read_as_given_and_silence_says_so() {
    use crate::signal::Alert;
    use crate::state::traffic::{Direction, Feed, Target};
    let ui = Ui::default();
    let mut state = healthy();
    assert_eq!(reads(&state, &ui, |l| l.traffic), "", "nobody would tell");
    state.around.feed = Feed::Silent;
    assert_eq!(reads(&state, &ui, |l| l.traffic), "NOTRAFFICDATA");
    state.around.feed = Feed::Live;
    assert_eq!(reads(&state, &ui, |l| l.traffic), "TRAFFICNONE");
    let target = Target {
        address: None,
        direction: Direction::True(Radians(4.8)),
        distance_m: 4630.0,
        up_m: Some(-152.4),
        vertical_speed_mps: Some(-5.0),
        alert: Alert::Low,
    };
    state.around.targets[0] = Some(target);
    state.around.targets[1] = Some(Target {
        direction: Direction::Unknown,
        up_m: None,
        ..target
    });
    // 4630 m is 2.5 NM, 152.4 m is 500 ft.
    let list = reads(&state, &ui, |l| l.traffic);
    assert_eq!(list, "TFCNM100FT2.5-052.5--");
    // Straight ahead and below: a symbol below the middle, with its height under it.
    let ahead = |l: &Layout| Rect::around(l.centre, 320.0, 320.0);
    assert!(reads(&state, &ui, ahead).contains("-05"), "in the view");
}

#[test]
fn sources_out_of_order_are_named_on_the_screen() {
    let mut ui = Ui::default();
    ui.links[1] = Some(crate::display::LinkFault::Down);
    assert_eq!(reads(&healthy(), &ui, |l| l.notes), "SRC2DOWN");
}

#[test]
fn an_engine_strip_comes_with_an_engine_and_is_flagged_like_all_else() {
    let ui = Ui::default();
    let mut state = healthy();
    assert_eq!(reads(&state, &ui, |l| l.engine), "", "no engine");
    state.set(P::EngineSpeed, Sampled::good(2410.0, NOW), SourceId(0));
    let stale = Sampled::fault(Invalid::Stale, NOW);
    state.set(P::OilPressure, stale, SourceId(0));
    let strip = reads(&state, &ui, |l| l.engine);
    assert!(strip.starts_with("RPM2410MAP---OILPOLD"), "{strip}");
}
