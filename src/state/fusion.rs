//! Fusion: from what every source last said to the one value of each parameter that may be shown.
//!
//! Sources are asked in order of their priority. For each parameter the first whose last word is a good, fresh value is
//! taken; a better source that comes back is taken back at once. When none has a good value the most telling reason stands
//! (failed before out of range before silent), so that the pilot learns that a sensor has failed rather than that another
//! was never fitted.
//!
//! Latitude and longitude always come from the same source: half a position of one receiver and half of another is a
//! place where nobody is.
//!
//! Pure: no clock, no I/O, no allocation after [`Fusion::new`].

use super::FlightState;
use crate::limits::SOURCES_MAX;
use crate::sampled::{Invalid, Sampled};
use crate::signal::{Parameter, Signal, SourceId};
use crate::time::Monotonic;
use arrayvec::ArrayVec;

/// What every source last said, and the order in which they are believed.
#[derive(Clone, Debug)]
pub struct Fusion {
    order: ArrayVec<SourceId, SOURCES_MAX>,
    said: Vec<[Sampled<f64>; Parameter::COUNT]>,
    unknown_sources: u64,
}

impl Fusion {
    /// Listens to the given sources, the most trusted first; each id must be below [`SOURCES_MAX`]. Sources named twice or
    /// beyond that limit are left out.
    #[must_use]
    pub fn new(most_trusted_first: &[SourceId]) -> Self {
        let mut order = ArrayVec::new();
        for &id in most_trusted_first {
            if usize::from(id.0) < SOURCES_MAX && !order.contains(&id) {
                order.push(id);
            }
        }
        Self {
            order,
            said: vec![[Sampled::never(); Parameter::COUNT]; SOURCES_MAX],
            unknown_sources: 0,
        }
    }

    /// Remembers what a source said. A signal older than what the source has already said of the parameter is not news
    /// and is left.
    pub fn apply(&mut self, signal: &Signal) {
        if !self.order.contains(&signal.source) {
            self.unknown_sources += 1;
            return;
        }
        let slot = &mut self.said[usize::from(signal.source.0)][signal.parameter.index()];
        if slot.at().is_none_or(|at| signal.at >= at) {
            *slot = Sampled::from_result(signal.value, signal.at);
        }
    }

    /// Signals from sources that this was not told of: a mistake in the program, counted rather than believed.
    #[must_use]
    pub const fn unknown_sources(&self) -> u64 {
        self.unknown_sources
    }

    /// The state at `now`.
    #[must_use]
    pub fn step(&self, now: Monotonic) -> FlightState {
        let mut state = FlightState::empty();
        for &parameter in Parameter::ALL {
            let group: &[Parameter] = match parameter {
                Parameter::Latitude => &[Parameter::Latitude, Parameter::Longitude],
                Parameter::Longitude => continue,
                _ => &[parameter],
            };
            if let Some(source) = self.select(group, now) {
                for &parameter in group {
                    state.set(parameter, self.last(source, parameter), source);
                }
            }
        }
        state
    }

    fn last(&self, source: SourceId, parameter: Parameter) -> Sampled<f64> {
        self.said[usize::from(source.0)][parameter.index()]
    }

    /// The first source for which the whole group is good, else the one with the most telling reason; `None` when nobody
    /// has ever said anything.
    fn select(&self, group: &[Parameter], now: Monotonic) -> Option<SourceId> {
        let mut best: Option<(u8, SourceId)> = None;
        for &source in &self.order {
            let rank = group
                .iter()
                .map(|&p| tells(self.last(source, p).read(now, p.spec().age_max).err()))
                .min()
                .unwrap_or(NOTHING);
            if rank == GOOD {
                return Some(source);
            }
            // Of equals the more trusted one, met first, stands.
            let heard = group.iter().any(|&p| self.last(source, p).at().is_some());
            if heard && best.is_none_or(|(best, _)| rank > best) {
                best = Some((rank, source));
            }
        }
        best.map(|(_, source)| source)
    }
}

const NOTHING: u8 = 0;
const GOOD: u8 = 6;

/// How much a reason tells the pilot: a source that knows it is wrong tells more than one that is silent.
const fn tells(reason: Option<Invalid>) -> u8 {
    match reason {
        None => GOOD,
        Some(Invalid::Miscompare) => 5,
        Some(Invalid::SourceFailed) => 4,
        Some(Invalid::OutOfRange) => 3,
        Some(Invalid::Doubtful) => 2,
        Some(Invalid::Stale) => 1,
        Some(Invalid::NeverReceived) => NOTHING,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: SourceId = SourceId(0);
    const B: SourceId = SourceId(5);

    fn ms(t: u64) -> Monotonic {
        Monotonic::from_nanos(t * 1_000_000)
    }

    fn say(
        fusion: &mut Fusion,
        source: SourceId,
        parameter: Parameter,
        value: Result<f64, Invalid>,
        t: u64,
    ) {
        fusion.apply(&Signal {
            at: ms(t),
            source,
            parameter,
            value,
        });
    }

    /// What is shown of a parameter, and whose it is.
    fn shown(
        fusion: &Fusion,
        parameter: Parameter,
        t: u64,
    ) -> (Result<f64, Invalid>, Option<SourceId>) {
        let state = fusion.step(ms(t));
        (state.read(parameter, ms(t)), state.source(parameter))
    }

    #[test]
    fn attitude_goes_invalid_when_frames_stop_and_comes_back_with_them() {
        let mut f = Fusion::new(&[A]);
        assert_eq!(
            shown(&f, Parameter::Pitch, 0),
            (Err(Invalid::NeverReceived), None)
        );
        for t in [1000, 1020, 1040] {
            say(&mut f, A, Parameter::Pitch, Ok(0.1), t);
        }
        assert_eq!(shown(&f, Parameter::Pitch, 1340), (Ok(0.1), Some(A)));
        assert_eq!(
            shown(&f, Parameter::Pitch, 1341),
            (Err(Invalid::Stale), Some(A))
        );
        say(&mut f, A, Parameter::Pitch, Ok(0.2), 5000);
        assert_eq!(shown(&f, Parameter::Pitch, 5000), (Ok(0.2), Some(A)));
    }

    #[test]
    fn a_failure_shows_as_one_until_a_good_value_or_silence() {
        let mut f = Fusion::new(&[A]);
        say(&mut f, A, Parameter::Roll, Ok(0.1), 1000);
        say(&mut f, A, Parameter::Roll, Err(Invalid::SourceFailed), 1020);
        assert_eq!(
            shown(&f, Parameter::Roll, 1021),
            (Err(Invalid::SourceFailed), Some(A)),
            "the last good value is gone"
        );
        assert_eq!(
            shown(&f, Parameter::Roll, 1400).0,
            Err(Invalid::Stale),
            "then silence"
        );
        say(&mut f, A, Parameter::Roll, Ok(0.3), 1500);
        assert_eq!(shown(&f, Parameter::Roll, 1500).0, Ok(0.3));
    }

    #[test]
    fn the_most_trusted_good_source_is_taken_and_taken_back() {
        let mut f = Fusion::new(&[B, A]);
        say(&mut f, A, Parameter::Pitch, Ok(0.1), 1000);
        assert_eq!(
            shown(&f, Parameter::Pitch, 1000),
            (Ok(0.1), Some(A)),
            "the only one"
        );
        say(&mut f, B, Parameter::Pitch, Ok(0.2), 1010);
        assert_eq!(
            shown(&f, Parameter::Pitch, 1010),
            (Ok(0.2), Some(B)),
            "trusted more"
        );
        say(&mut f, B, Parameter::Pitch, Err(Invalid::OutOfRange), 1020);
        assert_eq!(
            shown(&f, Parameter::Pitch, 1020),
            (Ok(0.1), Some(A)),
            "fail-over"
        );
        say(&mut f, B, Parameter::Pitch, Ok(0.3), 1030);
        assert_eq!(
            shown(&f, Parameter::Pitch, 1030),
            (Ok(0.3), Some(B)),
            "back again"
        );
        assert_eq!(
            shown(&f, Parameter::Pitch, 1331).0,
            Err(Invalid::Stale),
            "both silent"
        );
    }

    #[test]
    fn with_no_good_source_the_most_telling_reason_stands() {
        let mut f = Fusion::new(&[A, B]);
        say(&mut f, A, Parameter::Pitch, Ok(0.1), 500);
        say(
            &mut f,
            B,
            Parameter::Pitch,
            Err(Invalid::SourceFailed),
            1000,
        );
        assert_eq!(
            shown(&f, Parameter::Pitch, 1000),
            (Err(Invalid::SourceFailed), Some(B))
        );
        assert_eq!(
            shown(&f, Parameter::Pitch, 2000),
            (Err(Invalid::Stale), Some(A)),
            "equals: the trusted"
        );
    }

    #[test]
    fn a_position_is_never_put_together_from_two_sources() {
        let mut f = Fusion::new(&[A, B]);
        say(&mut f, A, Parameter::Latitude, Ok(0.5), 1000);
        say(&mut f, B, Parameter::Latitude, Ok(0.6), 1000);
        say(&mut f, B, Parameter::Longitude, Ok(0.7), 1000);
        for (p, x) in [(Parameter::Latitude, 0.6), (Parameter::Longitude, 0.7)] {
            assert_eq!(shown(&f, p, 1000), (Ok(x), Some(B)), "A has only half");
        }
        say(&mut f, A, Parameter::Longitude, Ok(0.8), 1010);
        for (p, x) in [(Parameter::Latitude, 0.5), (Parameter::Longitude, 0.8)] {
            assert_eq!(shown(&f, p, 1010), (Ok(x), Some(A)), "A has both");
        }
        say(
            &mut f,
            A,
            Parameter::Latitude,
            Err(Invalid::SourceFailed),
            1020,
        );
        for (p, x) in [(Parameter::Latitude, 0.6), (Parameter::Longitude, 0.7)] {
            assert_eq!(shown(&f, p, 1020), (Ok(x), Some(B)), "A has lost half");
        }
        // With neither whole, both halves still name the same source.
        let state = f.step(ms(2005));
        assert_eq!(
            state.source(Parameter::Latitude),
            state.source(Parameter::Longitude)
        );
    }

    #[test]
    fn old_news_and_strangers_change_nothing() {
        let mut f = Fusion::new(&[A, A]);
        say(&mut f, A, Parameter::Pitch, Ok(0.1), 1000);
        say(&mut f, A, Parameter::Pitch, Ok(0.9), 999);
        say(&mut f, B, Parameter::Pitch, Ok(0.9), 1001);
        say(&mut f, SourceId(200), Parameter::Pitch, Ok(0.9), 1001);
        assert_eq!(shown(&f, Parameter::Pitch, 1001), (Ok(0.1), Some(A)));
        assert_eq!(f.unknown_sources(), 2);
    }

    #[test]
    fn a_value_from_the_future_is_not_shown() {
        let mut f = Fusion::new(&[A, B]);
        say(&mut f, A, Parameter::Pitch, Ok(0.1), 2000);
        say(&mut f, B, Parameter::Pitch, Ok(0.2), 1000);
        assert_eq!(shown(&f, Parameter::Pitch, 1000), (Ok(0.2), Some(B)));
    }
}
