//! What is to be said of values that are shown: that another source contradicts them, and that their first source is lost.

use crate::signal::{Parameter as P, SourceId};
use crate::state::FlightState;
use crate::state::snapshot::Compared;
use crate::time::Monotonic;
use arrayvec::ArrayVec;

/// What is said of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoteKind {
    /// Another source of the same quantity says something else; either may be wrong.
    Miscompare,
    /// It comes from this source because a better one is lost.
    Fallback(SourceId),
    /// No source gives it: it is worked out from others.
    Derived,
}

/// One line for the pilot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Note {
    /// What it is about, as on the instrument: `ATT`, `IAS`.
    pub about: &'static str,
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

/// The most lines that there can be: four disagreements (pitch and roll share one), every loss, and what is worked out.
pub const NOTES_MAX: usize = 4 + FALLBACKS.len() + DERIVED.len();

/// All lines, disagreements first, then losses.
pub type Notes = ArrayVec<Note, NOTES_MAX>;

/// What is to be said at `now`. `shown` says whether the instrument of a parameter shows it.
pub(super) fn notes(state: &FlightState, now: Monotonic, shown: impl Fn(P) -> bool) -> Notes {
    let mut notes = Notes::new();
    let pitch = state.miscompares(Compared::Pitch);
    let roll = state.miscompares(Compared::Roll);
    let attitude = match (pitch, roll) {
        (true, true) => Some("ATT"),
        (true, false) => Some("PIT"),
        (false, true) => Some("ROL"),
        (false, false) => None,
    };
    let one = |compared, about| state.miscompares(compared).then_some(about);
    let miscompares = [
        attitude,
        one(Compared::Heading, "HDG"),
        one(Compared::Altitude, "ALT"),
        one(Compared::Airspeed, "IAS"),
    ];
    notes.extend(miscompares.into_iter().flatten().map(|about| Note {
        about,
        kind: NoteKind::Miscompare,
    }));
    for (about, parameters) in FALLBACKS {
        let source = parameters
            .iter()
            .filter(|p| shown(**p))
            .find_map(|p| state.fallback(*p, now));
        notes.extend(source.map(|source| Note {
            about,
            kind: NoteKind::Fallback(source),
        }));
    }
    let derived = |p: P| state.is_derived(p) && state.read(p, now).is_ok();
    let worked_out = DERIVED.iter().filter(|(_, p)| derived(*p));
    notes.extend(worked_out.map(|(about, _)| Note {
        about,
        kind: NoteKind::Derived,
    }));
    notes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampled::Sampled;

    const NOW: Monotonic = Monotonic::from_nanos(10_000_000_000);

    #[test]
    fn there_is_room_for_everything_at_once() {
        let mut state = FlightState::empty();
        for &p in P::ALL {
            state.set(p, Sampled::good(0.0, NOW), SourceId(1));
            state.set_fallback(p, true);
        }
        state.set_miscompares([true; Compared::COUNT]);
        // What has a source that is lost is not worked out: these exclude each other.
        let most = NOTES_MAX - DERIVED.len();
        assert_eq!(notes(&state, NOW, |_| true).len(), most, "all lines");
        assert_eq!(
            notes(&state, NOW, |_| false).len(),
            4,
            "none of what is not shown"
        );
    }

    #[test]
    fn what_is_worked_out_says_so() {
        let mut state = FlightState::empty();
        state.set_derived(P::VerticalSpeed, Sampled::good(1.0, NOW));
        let kind = NoteKind::Derived;
        let expected = [Note { about: "VS", kind }];
        assert_eq!(notes(&state, NOW, |_| true).as_slice(), expected);
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
            let notes = notes(&state, NOW, |_| true);
            let kind = NoteKind::Miscompare;
            assert_eq!(notes.as_slice(), [Note { about, kind }], "{about}");
        }
    }
}
