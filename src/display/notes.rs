//! What is to be said of values that are shown, and of what they depend on: that another source contradicts them, that
//! their first source is lost, that a source as a whole is out of order.
//!
//! The lines come in this order, and where there are too many the last ones are left out, which are the least: disagreements,
//! sources out of order, values from another than their first source, settings and limits that differ, values worked out.

use super::format::{self, Text};
use super::model::{BUS_SPEEDS, bus_speed};
use super::ui::{Config, LinkFault, SourceName, Ui};
use crate::signal::{Parameter as P, SourceId};
use crate::state::FlightState;
use crate::state::snapshot::Compared;
use crate::time::Monotonic;
use crate::units::{Hectopascals, Knots};
use arrayvec::ArrayVec;

/// What is said of a value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NoteKind {
    /// Another source of the same quantity says something else; either may be wrong.
    Miscompare,
    /// A source is out of order.
    Link(LinkFault),
    /// So many more sources are out of order.
    MoreLinks(usize),
    /// It comes from this source because a better one is lost.
    Fallback(SourceName),
    /// A bus gives this limit instead of the installer's, which stands.
    BusLimit(Knots),
    /// A source uses this altimeter setting instead of the pilot's.
    OtherSetting(Hectopascals),
    /// No source gives it: it is worked out from others.
    Derived,
}

/// One line for the pilot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Note {
    /// What it is about, as on the instrument: `ATT`, `IAS`, or the name of a source.
    pub about: SourceName,
    /// What there is to say.
    pub kind: NoteKind,
}

/// The quantities that have lines of their own, with the parameters whose loss of source is told.
const FALLBACKS: [(&str, &[P]); 7] = [
    ("ATT", &[P::Pitch, P::Roll]),
    ("HDG", &[P::HeadingTrue, P::HeadingMagnetic]),
    (
        "ALT",
        &[P::PressureAltitude, P::BaroAltitude, P::AltitudeMsl],
    ),
    ("IAS", &[P::IndicatedAirspeed, P::CalibratedAirspeed]),
    ("VS", &[P::VerticalSpeed]),
    ("GPS", &[P::Latitude, P::Longitude, P::HeightEllipsoid]),
    ("TRK", &[P::GroundSpeed, P::Track]),
];

/// The shown quantities that may be worked out.
const DERIVED: [(&str, P); 2] = [("VS", P::VerticalSpeed), ("TRK", P::Track)];

/// Sources out of order that are told one by one; how many more there are is told in a line of its own.
const LINKS_MAX: usize = 3;

/// The most lines: as many as fit above the middle of the picture and a little below. Four disagreements (pitch and roll share
/// one), every loss and the sources out of order always do.
pub const NOTES_MAX: usize = 4 + FALLBACKS.len() + LINKS_MAX + 1;

/// A bus's limit that is this near to the installer's is the same, kt.
const LIMIT_KT: f64 = 1.0;
/// Settings that are this near to each other are the same, hPa: half of the step of a knob in either unit is less.
const SETTING_HPA: f64 = 0.75;

/// All lines, the gravest first.
pub type Notes = ArrayVec<Note, NOTES_MAX>;

/// What is known of sources beside what they say.
pub(super) struct Sources<'a> {
    pub(super) ui: &'a Ui,
    pub(super) config: &'a Config,
}

/// What is to be said at `now`. `shown` says whether the instrument of a parameter shows it.
pub(super) fn notes(
    state: &FlightState,
    now: Monotonic,
    sources: &Sources<'_>,
    shown: impl Fn(P) -> bool,
) -> Notes {
    let mut notes = Notes::new();
    // What does not fit is the least of all.
    let mut say = |about: &str, kind| {
        let about = SourceName::from(about).unwrap_or_default();
        let _ = notes.try_push(Note { about, kind });
    };
    for about in miscompares(state).into_iter().flatten() {
        say(about, NoteKind::Miscompare);
    }
    links(sources, &mut say);
    for (about, parameters) in FALLBACKS {
        let source = parameters
            .iter()
            .filter(|p| shown(**p))
            .find_map(|p| state.fallback(*p, now));
        if let Some(source) = source {
            say(about, NoteKind::Fallback(sources.config.name(source)));
        }
    }
    if let Some(other) = other_setting(state, sources.ui, now, &shown) {
        say("BARO", NoteKind::OtherSetting(other));
    }
    let given = sources.config.v_speeds.all();
    for (given, (about, kind)) in given.into_iter().zip(BUS_SPEEDS) {
        if let (Some(given), Some(bus)) = (given, bus_speed(state, kind))
            && (given.0 - bus.0).abs() > LIMIT_KT
        {
            say(about, NoteKind::BusLimit(bus));
        }
    }
    let derived = |p: P| state.is_derived(p) && state.read(p, now).is_ok();
    for (about, _) in DERIVED.iter().filter(|(_, p)| derived(*p)) {
        say(about, NoteKind::Derived);
    }
    notes
}

fn miscompares(state: &FlightState) -> [Option<&'static str>; 4] {
    let pitch = state.miscompares(Compared::Pitch);
    let roll = state.miscompares(Compared::Roll);
    let attitude = match (pitch, roll) {
        (true, true) => Some("ATT"),
        (true, false) => Some("PIT"),
        (false, true) => Some("ROL"),
        (false, false) => None,
    };
    let one = |compared, about| state.miscompares(compared).then_some(about);
    [
        attitude,
        one(Compared::Heading, "HDG"),
        one(Compared::Altitude, "ALT"),
        one(Compared::Airspeed, "IAS"),
    ]
}

/// Sources out of order, the most trusted first.
fn links(sources: &Sources<'_>, say: &mut impl FnMut(&str, NoteKind)) {
    let faults = sources.ui.links.iter().zip(0_u8..);
    let faults = faults.filter_map(|(fault, id)| fault.map(|fault| (SourceId(id), fault)));
    let all = faults.clone().count();
    // A line of its own for the rest pays only where it stands for two or more.
    let told = if all == LINKS_MAX + 1 { all } else { LINKS_MAX };
    for (source, fault) in faults.take(told) {
        say(&sources.config.name(source), NoteKind::Link(fault));
    }
    if all > told {
        say("", NoteKind::MoreLinks(all - told));
    }
}

/// The setting of a source that is not the pilot's, where the pilot's is in use and set to anything but standard.
fn other_setting(
    state: &FlightState,
    ui: &Ui,
    now: Monotonic,
    shown: impl Fn(P) -> bool,
) -> Option<Hectopascals> {
    let other = state.read(P::BaroSetting, now).ok()?;
    let own = ui.baro.pressure().0;
    let differs =
        shown(P::PressureAltitude) && !ui.baro_standard && (other - own).abs() > SETTING_HPA;
    differs.then_some(Hectopascals(other))
}

impl NoteKind {
    /// What the line says after what it is about.
    #[must_use]
    pub fn text(self, unit: super::BaroUnit) -> Text {
        let of = |text: &str| Text::from(text).unwrap_or_default();
        match self {
            Self::Miscompare => of("MISCOMP"),
            Self::Link(fault) => of(fault.label()),
            Self::MoreLinks(n) => format::more(n),
            Self::Fallback(name) => of(&name),
            Self::BusLimit(speed) => format::bus_limit(speed),
            Self::OtherSetting(setting) => format::source_setting(setting, unit),
            Self::Derived => of("DERIVED"),
        }
    }

    /// Whether it is a caution; else nothing was lost.
    #[must_use]
    pub const fn is_caution(self) -> bool {
        !matches!(self, Self::Derived)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limits::SOURCES_MAX;
    use crate::sampled::Sampled;
    use crate::signal::Limit;

    const NOW: Monotonic = Monotonic::from_nanos(10_000_000_000);

    fn told(state: &FlightState, ui: &Ui, config: &Config, shown: bool) -> Vec<(String, NoteKind)> {
        let notes = notes(state, NOW, &Sources { ui, config }, |_| shown);
        let row = |n: &Note| (n.about.to_string(), n.kind);
        notes.iter().map(row).collect()
    }

    fn plain(state: &FlightState, shown: bool) -> Vec<(String, NoteKind)> {
        told(state, &Ui::default(), &Config::default(), shown)
    }

    #[test]
    fn the_gravest_fit_when_everything_is_wrong_at_once() {
        let mut state = FlightState::empty();
        for &p in P::ALL {
            state.set(p, Sampled::good(0.0, NOW), SourceId(1));
            state.set_fallback(p, true);
        }
        state.set_miscompares([true; Compared::COUNT]);
        let ui = Ui {
            links: [Some(LinkFault::Silent); SOURCES_MAX],
            ..Ui::default()
        };
        let all = told(&state, &ui, &Config::default(), true);
        assert_eq!(all.len(), NOTES_MAX, "{all:?}");
        assert!(
            all[..4].iter().all(|(_, k)| *k == NoteKind::Miscompare),
            "{all:?}"
        );
        assert_eq!(all[7].1, NoteKind::MoreLinks(SOURCES_MAX - 3), "{all:?}");
        assert!(
            all[8..]
                .iter()
                .all(|(_, k)| matches!(k, NoteKind::Fallback(_))),
            "{all:?}"
        );
        assert_eq!(plain(&state, false).len(), 4, "none of what is not shown");
    }

    #[test]
    fn what_is_worked_out_says_so() {
        let mut state = FlightState::empty();
        state.set_derived(P::VerticalSpeed, Sampled::good(1.0, NOW));
        assert_eq!(plain(&state, true), [("VS".to_owned(), NoteKind::Derived)]);
    }

    #[test]
    fn pitch_and_roll_share_a_line() {
        let mut state = FlightState::empty();
        for (flags, about) in [
            ([true, false, false, false, false], "PIT"),
            ([false, true, false, false, false], "ROL"),
            ([true, true, false, false, false], "ATT"),
        ] {
            state.set_miscompares(flags);
            let expected = [(about.to_owned(), NoteKind::Miscompare)];
            assert_eq!(plain(&state, true), expected, "{about}");
        }
    }

    #[test]
    fn sources_are_told_by_their_names() {
        let mut config = Config::default();
        config.source_names[0] = crate::display::source_name("adahrs-left");
        let mut ui = Ui::default();
        ui.links[0] = Some(LinkFault::Down);
        ui.links[1] = Some(LinkFault::Closed);
        let mut state = FlightState::empty();
        state.set(P::Pitch, Sampled::good(0.0, NOW), SourceId(0));
        state.set_fallback(P::Pitch, true);
        let fallback = NoteKind::Fallback(config.source_names[0]);
        let expected = [
            ("ADAHRS-L".to_owned(), NoteKind::Link(LinkFault::Down)),
            ("SRC 2".to_owned(), NoteKind::Link(LinkFault::Closed)),
            ("ATT".to_owned(), fallback),
        ];
        assert_eq!(told(&state, &ui, &config, true), expected);
        assert_eq!(
            fallback
                .text(crate::display::BaroUnit::Hectopascals)
                .as_str(),
            "ADAHRS-L"
        );
    }

    #[test]
    fn settings_and_limits_that_differ_are_told() {
        let mut config = Config::default();
        config.v_speeds.vne = Some(Knots(130.0));
        let mut state = FlightState::empty();
        for (kind, knots) in [("vne", 140.0), ("vno", 100.0)] {
            let limit = Limit {
                at: NOW,
                source: SourceId(0),
                parameter: P::IndicatedAirspeed,
                kind,
                value: crate::units::MetresPerSecond::from(Knots(knots)).0,
            };
            state.bounds.take(&limit, |_| 0);
        }
        state.set(P::BaroSetting, Sampled::good(1020.0, NOW), SourceId(0));
        let unit = crate::display::BaroUnit::Hectopascals;
        let said = |ui: &Ui| {
            let all = told(&state, ui, &config, true);
            all.into_iter()
                .map(|(about, kind)| format!("{about} {}", kind.text(unit)))
                .collect::<Vec<_>>()
        };
        assert_eq!(said(&Ui::default()), ["BARO SRC 1020", "VNE BUS 140"]);
        let standard = Ui {
            baro_standard: true,
            ..Ui::default()
        };
        assert_eq!(said(&standard), ["VNE BUS 140"], "flight levels");
    }
}
