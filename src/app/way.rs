//! The way of a value from its receipt to the screen, timed for each source and group of parameters.
//!
//! Each value is timed once, at the end of the first frame that shows it: from the stamp of the bus thread to the return of
//! the flip (on a headless screen: to the finished picture).

use crate::app::figures::Histogram;
use crate::limits::SOURCES_MAX;
use crate::signal::Parameter;
use crate::state::FlightState;
use crate::time::Monotonic;
use serde_json::{Map, Value};

/// Groups of parameters, each with those that stand for it: the first that a source gives.
pub const GROUPS: [(&str, &[Parameter]); 6] = [
    ("attitude", &[Parameter::Pitch]),
    (
        "heading",
        &[Parameter::HeadingTrue, Parameter::HeadingMagnetic],
    ),
    (
        "airspeed",
        &[
            Parameter::IndicatedAirspeed,
            Parameter::CalibratedAirspeed,
            Parameter::TrueAirspeed,
        ],
    ),
    (
        "altitude",
        &[
            Parameter::PressureAltitude,
            Parameter::AltitudeMsl,
            Parameter::HeightEllipsoid,
        ],
    ),
    ("position", &[Parameter::Latitude]),
    ("engine", &[Parameter::EngineSpeed]),
];

/// What has been timed. After construction nothing here allocates.
#[derive(Debug)]
pub struct Ways {
    rows: Vec<[Way; GROUPS.len()]>,
}

#[derive(Debug, Default)]
struct Way {
    /// Receipt of the value that was timed last.
    last: Option<Monotonic>,
    times: Histogram,
}

impl Default for Ways {
    fn default() -> Self {
        Self::new()
    }
}

impl Ways {
    /// Nothing timed yet, for as many sources as there can be.
    #[must_use]
    pub fn new() -> Self {
        Self {
            rows: (0..SOURCES_MAX).map(|_| Default::default()).collect(),
        }
    }

    /// Times what `state`, read at `now`, shows for the first time; it was there at `presented`.
    pub fn note(&mut self, state: &FlightState, now: Monotonic, presented: Monotonic) {
        for (group, (_, parameters)) in GROUPS.iter().enumerate() {
            for parameter in *parameters {
                let (Ok(_), Some(source), Some(at)) = (
                    state.read(*parameter, now),
                    state.source(*parameter),
                    state.at(*parameter),
                ) else {
                    continue;
                };
                let row = self.rows.get_mut(usize::from(source.0));
                if let Some(way) = row.map(|row| &mut row[group])
                    && way.last != Some(at)
                {
                    way.last = Some(at);
                    way.times.add(presented.since(at).unwrap_or_default());
                }
                break;
            }
        }
    }

    /// For each source, by its index, an object of its groups; null where it has shown nothing.
    #[must_use]
    pub fn to_json(&self) -> Value {
        let groups = |row: &[Way; GROUPS.len()]| {
            let heard = GROUPS
                .iter()
                .zip(row)
                .filter(|(_, way)| !way.times.is_empty());
            let groups: Map<String, Value> = heard
                .map(|((name, _), way)| ((*name).to_owned(), way.times.to_json()))
                .collect();
            if groups.is_empty() {
                Value::Null
            } else {
                groups.into()
            }
        };
        self.rows.iter().map(groups).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampled::Sampled;
    use crate::signal::SourceId;
    use std::time::Duration;

    #[test]
    fn a_value_is_timed_when_it_is_first_shown_and_not_again() {
        let mut ways = Ways::new();
        let mut state = FlightState::empty();
        let received = Monotonic::from_nanos(1_000_000_000);
        state.set(Parameter::Pitch, Sampled::good(0.1, received), SourceId(2));
        for ms in [20, 40, 60] {
            let now = received.plus(Duration::from_millis(ms));
            ways.note(&state, now, now.plus(Duration::from_millis(5)));
        }
        let timed = ways.to_json();
        assert_eq!(timed[2]["attitude"]["count"], 1, "{timed}");
        assert_eq!(timed[2]["attitude"]["max"], 25.0, "{timed}");
        assert_eq!(timed[2]["airspeed"], Value::Null, "never heard");
        assert_eq!(timed[0], Value::Null, "another source");
    }
}
