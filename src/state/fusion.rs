//! Fusion: from what every source last said to the one value of each parameter that may be shown.
//!
//! Sources are asked in order of their priority. For each parameter the first whose last word is a good, fresh value is
//! taken; a better source that comes back is taken back at once. When none has a good value the most telling reason stands
//! (failed before out of range before silent), so that the pilot learns that a sensor has failed rather than that another
//! was never fitted.
//!
//! A good value is no longer one when its sensor has stopped (`frozen`), when it has jumped (`jump`) or other sensors refute it (`crosscheck`). A value
//! that is not from the most trusted source that has been heard of says so ([`FlightState::fallback`]). What is shown is
//! compared with the other sources (`compare`), and what follows from it is worked out (`derive`).
//!
//! Latitude and longitude always come from the same source: half a position of one receiver and half of another is a
//! place where nobody is.
//!
//! Pure: no clock, no I/O, no allocation after [`Fusion::new`].

use super::FlightState;
use super::bounds::Bounds;
use super::compare::Comparator;
use super::crosscheck::CrossCheck;
use super::derive::Deriver;
use super::frozen::{FLYING_MPS, Stillness};
use super::jump::Jumps;
use super::traffic::{FEED_AGE_MAX, Feed, Skies};
use super::witness::Witnesses;
use crate::limits::SOURCES_MAX;
use crate::sampled::{Invalid, Sampled};
use crate::signal::{Limit, Parameter, Report, Signal, Sink, SourceId, Traffic};
use crate::time::Monotonic;
use arrayvec::ArrayVec;
use std::time::Duration;

/// What every source last said, the order in which they are believed, and what is to be thought of it.
#[derive(Clone, Debug)]
pub struct Fusion {
    heard: Heard,
    unknown_sources: u64,
    flying_since: Option<Monotonic>,
    crosscheck: CrossCheck,
    comparator: Comparator,
    deriver: Deriver,
    skies: Skies,
    bounds: Bounds,
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
            heard: Heard {
                order,
                said: vec![[Sampled::never(); Parameter::COUNT]; SOURCES_MAX],
                stillness: vec![Stillness::new(); SOURCES_MAX],
                jumps: vec![Jumps::new(); SOURCES_MAX],
                contradicted: [false; SOURCES_MAX],
                witnesses: Witnesses::new(),
                last: [None; SOURCES_MAX],
                tells_traffic: [false; SOURCES_MAX],
            },
            unknown_sources: 0,
            flying_since: None,
            crosscheck: CrossCheck::new(),
            comparator: Comparator::default(),
            deriver: Deriver::new(),
            skies: Skies::new(),
            bounds: Bounds::NONE,
        }
    }

    /// These sources tell of other aircraft, even where there are none: when they are silent that is said.
    #[must_use]
    pub fn with_traffic_from(mut self, sources: &[SourceId]) -> Self {
        for id in sources.iter().filter(|id| self.heard.order.contains(id)) {
            self.heard.tells_traffic[usize::from(id.0)] = true;
        }
        self
    }

    /// Remembers what a source said that is no value.
    pub fn report(&mut self, report: &Report) {
        let order = &self.heard.order;
        let trust = |id| order.iter().position(|o| *o == id).unwrap_or(usize::MAX);
        match report {
            Report::OwnAddress(address) => self.skies.is_own(*address),
            Report::Traffic(t) if order.contains(&t.source) => {
                self.skies.see(t, trust);
                let source = usize::from(t.source.0);
                self.heard.tells_traffic[source] = true;
                self.heard.last[source] = Some(t.at);
            }
            Report::Limit(l) if order.contains(&l.source) => self.bounds.take(l, trust),
            Report::Traffic(_) | Report::Limit(_) => self.unknown_sources += 1,
        }
    }

    /// Remembers what a source said. A signal older than what the source has already said of the parameter is not news
    /// and is left.
    pub fn apply(&mut self, signal: &Signal) {
        if !self.heard.order.contains(&signal.source) {
            self.unknown_sources += 1;
            return;
        }
        let source = usize::from(signal.source.0);
        self.heard.last[source] = Some(signal.at);
        let slot = &mut self.heard.said[source][signal.parameter.index()];
        if slot.at().is_none_or(|at| signal.at >= at) {
            *slot = Sampled::from_result(signal.value, signal.at);
            if let Ok(value) = signal.value {
                // After standing still it may be anywhere.
                if self.heard.stillness[source].is_frozen(signal.parameter) {
                    self.heard.jumps[source].forget(signal.parameter);
                }
                self.heard.jumps[source].see(signal.parameter, value, signal.at);
            }
            // A message that its source doubts, beside another that it does not, says nothing of either.
            if signal.value != Err(Invalid::Doubtful) {
                self.heard.stillness[source].see(signal.parameter, signal.value.ok(), signal.at);
            }
        }
    }

    /// Signals from sources that this was not told of: a mistake in the program, counted rather than believed.
    #[must_use]
    pub const fn unknown_sources(&self) -> u64 {
        self.unknown_sources
    }

    /// The state at `now`; times of successive calls never go back.
    #[must_use]
    pub fn step(&mut self, now: Monotonic) -> FlightState {
        self.flying_since = match (self.heard.is_flying(now), self.flying_since) {
            (false, _) => None,
            (true, since) => since.or(Some(now)),
        };
        for source in &self.heard.order {
            self.heard.stillness[usize::from(source.0)].judge(self.flying_since, now);
        }
        let heard = &mut self.heard;
        let mut state = heard.selected(now);
        self.deriver.step(&mut state, now);
        let miscompares =
            self.comparator
                .step(&heard.order, &state, |s, p| heard.read(s, p, now), now);
        state.set_miscompares(miscompares);
        state.around.targets = self.skies.around(&state, now);
        state.around.feed = heard.feed(now);
        state.bounds = self.bounds;
        // What is refuted now is taken away with the next picture.
        heard.watch(&state, self.flying_since.is_some(), now);
        let said = |s, p| heard.believed(s, p).read(now, p.spec().age_max);
        let standing = |s: SourceId| heard.stands(s, Parameter::Roll, now);
        self.crosscheck
            .step(&heard.order, &state, said, standing, now);
        heard.contradicted = self.crosscheck.contradicted();
        state
    }
}

/// What every source last said, and which of it is not to be believed.
#[derive(Clone, Debug)]
struct Heard {
    order: ArrayVec<SourceId, SOURCES_MAX>,
    said: Vec<[Sampled<f64>; Parameter::COUNT]>,
    stillness: Vec<Stillness>,
    jumps: Vec<Jumps>,
    /// Sources whose attitude is refuted.
    contradicted: [bool; SOURCES_MAX],
    /// Calm values that stand still while others move.
    witnesses: Witnesses,
    /// When each source last said anything.
    last: [Option<Monotonic>; SOURCES_MAX],
    tells_traffic: [bool; SOURCES_MAX],
}

impl Sink for Fusion {
    fn signal(&mut self, signal: Signal) {
        self.apply(&signal);
    }

    fn traffic(&mut self, traffic: &Traffic) {
        self.report(&Report::Traffic(*traffic));
    }

    fn limit(&mut self, limit: &Limit) {
        self.report(&Report::Limit(*limit));
    }

    fn own_address(&mut self, address: u32) {
        self.report(&Report::OwnAddress(address));
    }
}

impl Heard {
    /// Whether the aircraft flies: by its ground speed, or without one by its airspeed.
    fn is_flying(&self, now: Monotonic) -> bool {
        let fastest = |parameters: &[Parameter]| {
            let said = self.order.iter().flat_map(|source| {
                parameters.iter().filter_map(|p| {
                    let last = self.said[usize::from(source.0)][p.index()];
                    last.read(now, p.spec().age_max).ok()
                })
            });
            said.reduce(f64::max)
        };
        fastest(&[Parameter::GroundSpeed])
            .or_else(|| {
                fastest(&[
                    Parameter::IndicatedAirspeed,
                    Parameter::CalibratedAirspeed,
                    Parameter::TrueAirspeed,
                ])
            })
            .is_some_and(|speed| speed >= FLYING_MPS)
    }

    /// Lets everything that moves bear witness of what does not.
    fn watch(&mut self, state: &FlightState, flies: bool, now: Monotonic) {
        if !flies {
            return self.witnesses.forget();
        }
        let stillness = &self.stillness;
        let standing = |s: SourceId, p| stillness[usize::from(s.0)].standing(p, now);
        self.witnesses.step(&self.order, state, standing, now);
    }

    /// How long a value has repeated.
    fn stands(&self, source: SourceId, parameter: Parameter, now: Monotonic) -> Duration {
        let standing = self.stillness[usize::from(source.0)].standing(parameter, now);
        standing
            .and_then(|s| now.since(s.since))
            .unwrap_or_default()
    }

    /// Whether anybody would tell of other aircraft.
    fn feed(&self, now: Monotonic) -> Feed {
        let mut feed = Feed::None;
        for (last, _) in self
            .last
            .iter()
            .zip(self.tells_traffic)
            .filter(|(_, tells)| *tells)
        {
            let age = last.and_then(|at| now.since(at));
            if age.is_some_and(|age| age <= FEED_AGE_MAX) {
                return Feed::Live;
            }
            feed = Feed::Silent;
        }
        feed
    }

    /// Of every parameter the value that is to be shown.
    fn selected(&self, now: Monotonic) -> FlightState {
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
                    state.set_fallback(parameter, self.is_fallback(source, parameter));
                }
            }
        }
        state
    }

    /// Whether a source trusted more than `source` has ever said anything of `parameter`.
    fn is_fallback(&self, source: SourceId, parameter: Parameter) -> bool {
        let mut better = self.order.iter().take_while(|other| **other != source);
        better.any(|better| self.last(*better, parameter).at().is_some())
    }

    /// What a source last said, or what is wrong with it.
    fn last(&self, source: SourceId, parameter: Parameter) -> Sampled<f64> {
        let contradicted = self.contradicted[usize::from(source.0)]
            && matches!(parameter, Parameter::Pitch | Parameter::Roll);
        let last = self.believed(source, parameter);
        if contradicted {
            refuted(last, Invalid::Implausible)
        } else {
            last
        }
    }

    /// What a source last said, if its sensor has neither stopped nor jumped.
    fn believed(&self, source: SourceId, parameter: Parameter) -> Sampled<f64> {
        let index = usize::from(source.0);
        let since = self.stillness[index].since(parameter);
        let stopped = since.is_some_and(|t| self.witnesses.is_frozen(source, parameter, t));
        let source = index;
        let last = self.said[source][parameter.index()];
        if stopped || self.stillness[source].is_frozen(parameter) {
            refuted(last, Invalid::Frozen)
        } else if self.jumps[source].has_jumped(parameter) {
            refuted(last, Invalid::Implausible)
        } else {
            last
        }
    }

    fn read(&self, source: SourceId, parameter: Parameter, now: Monotonic) -> Result<f64, Invalid> {
        self.last(source, parameter)
            .read(now, parameter.spec().age_max)
    }

    /// The first source for which the whole group is good, else the one with the most telling reason; `None` when nobody
    /// has ever said anything.
    fn select(&self, group: &[Parameter], now: Monotonic) -> Option<SourceId> {
        let mut best: Option<(u8, SourceId)> = None;
        for &source in &self.order {
            let rank = group
                .iter()
                .map(|&p| tells(self.read(source, p, now).err()))
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

/// The same moment with a fault instead of a value.
fn refuted(last: Sampled<f64>, reason: Invalid) -> Sampled<f64> {
    match last.at() {
        Some(at) if last.is_value() => Sampled::fault(reason, at),
        _ => last,
    }
}

const NOTHING: u8 = 0;
const GOOD: u8 = 8;

/// How much a reason tells the pilot: a source that knows it is wrong tells more than one that is silent.
const fn tells(reason: Option<Invalid>) -> u8 {
    match reason {
        None => GOOD,
        Some(Invalid::Miscompare) => 7,
        Some(Invalid::Implausible) => 6,
        Some(Invalid::Frozen) => 5,
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
        fusion: &mut Fusion,
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
            shown(&mut f, Parameter::Pitch, 0),
            (Err(Invalid::NeverReceived), None)
        );
        for t in [1000, 1020, 1040] {
            say(&mut f, A, Parameter::Pitch, Ok(0.1), t);
        }
        assert_eq!(shown(&mut f, Parameter::Pitch, 1340), (Ok(0.1), Some(A)));
        assert_eq!(
            shown(&mut f, Parameter::Pitch, 1341),
            (Err(Invalid::Stale), Some(A))
        );
        say(&mut f, A, Parameter::Pitch, Ok(0.2), 5000);
        assert_eq!(shown(&mut f, Parameter::Pitch, 5000), (Ok(0.2), Some(A)));
    }

    #[test]
    fn a_failure_shows_as_one_until_a_good_value_or_silence() {
        let mut f = Fusion::new(&[A]);
        say(&mut f, A, Parameter::Roll, Ok(0.1), 1000);
        say(&mut f, A, Parameter::Roll, Err(Invalid::SourceFailed), 1020);
        assert_eq!(
            shown(&mut f, Parameter::Roll, 1021),
            (Err(Invalid::SourceFailed), Some(A)),
            "the last good value is gone"
        );
        assert_eq!(
            shown(&mut f, Parameter::Roll, 1400).0,
            Err(Invalid::Stale),
            "then silence"
        );
        say(&mut f, A, Parameter::Roll, Ok(0.3), 1500);
        assert_eq!(shown(&mut f, Parameter::Roll, 1500).0, Ok(0.3));
    }

    #[test]
    fn the_most_trusted_good_source_is_taken_and_taken_back() {
        let mut f = Fusion::new(&[B, A]);
        say(&mut f, A, Parameter::Pitch, Ok(0.1), 1000);
        assert_eq!(
            shown(&mut f, Parameter::Pitch, 1000),
            (Ok(0.1), Some(A)),
            "the only one"
        );
        say(&mut f, B, Parameter::Pitch, Ok(0.2), 1010);
        assert_eq!(
            shown(&mut f, Parameter::Pitch, 1010),
            (Ok(0.2), Some(B)),
            "trusted more"
        );
        say(&mut f, B, Parameter::Pitch, Err(Invalid::OutOfRange), 1020);
        assert_eq!(
            shown(&mut f, Parameter::Pitch, 1020),
            (Ok(0.1), Some(A)),
            "fail-over"
        );
        say(&mut f, B, Parameter::Pitch, Ok(0.21), 1030);
        assert_eq!(
            shown(&mut f, Parameter::Pitch, 1030),
            (Ok(0.21), Some(B)),
            "back again"
        );
        assert_eq!(
            shown(&mut f, Parameter::Pitch, 1331).0,
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
            shown(&mut f, Parameter::Pitch, 1000),
            (Err(Invalid::SourceFailed), Some(B))
        );
        assert_eq!(
            shown(&mut f, Parameter::Pitch, 2000),
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
            assert_eq!(shown(&mut f, p, 1000), (Ok(x), Some(B)), "A has only half");
        }
        say(&mut f, A, Parameter::Longitude, Ok(0.8), 1010);
        for (p, x) in [(Parameter::Latitude, 0.5), (Parameter::Longitude, 0.8)] {
            assert_eq!(shown(&mut f, p, 1010), (Ok(x), Some(A)), "A has both");
        }
        say(
            &mut f,
            A,
            Parameter::Latitude,
            Err(Invalid::SourceFailed),
            1020,
        );
        for (p, x) in [(Parameter::Latitude, 0.6), (Parameter::Longitude, 0.7)] {
            assert_eq!(shown(&mut f, p, 1020), (Ok(x), Some(B)), "A has lost half");
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
        assert_eq!(shown(&mut f, Parameter::Pitch, 1001), (Ok(0.1), Some(A)));
        assert_eq!(f.unknown_sources(), 2);
    }

    #[test]
    fn a_value_from_the_future_is_not_shown() {
        let mut f = Fusion::new(&[A, B]);
        say(&mut f, A, Parameter::Pitch, Ok(0.1), 2000);
        say(&mut f, B, Parameter::Pitch, Ok(0.2), 1000);
        assert_eq!(shown(&mut f, Parameter::Pitch, 1000), (Ok(0.2), Some(B)));
    }
}
