//! Fusion: from what every source last said to the one value of each parameter that may be shown.
//!
//! Sources are asked in order of their priority. For each parameter the first whose last word is a good, fresh value is
//! taken; a better source that comes back is taken back at once. When none has a good value the most telling reason stands
//! (failed before out of range before silent), so that the pilot learns that a sensor has failed rather than that another
//! was never fitted.
//!
//! A good value is no longer one when its sensor has stopped (`frozen`, `witness`), when it has jumped (`jump`) or others refute
//! it (`crosscheck`, `motion`, `relation`). A value
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
use super::frozen::{FLYING_MPS, LATELY, Stillness};
use super::jump::Jumps;
use super::motion::Motions;
use super::relation::Relations;
use super::traffic::{FEED_AGE_MAX, Feed, Skies};
use super::witness::Witnesses;
use crate::limits::SOURCES_MAX;
use crate::sampled::{Invalid, Sampled};
use crate::signal::{Limit, Parameter, Report, Signal, Sink, SourceId, Traffic};
use crate::time::Monotonic;
use arrayvec::ArrayVec;
use std::time::Duration;

/// Beyond this bank and pitch aerobatics are flown, rad, and for so long after.
const WILD_BANK: f64 = 1.05;
const WILD_PITCH: f64 = 0.7;
const WILD_LASTS: Duration = Duration::from_secs(5);

/// What every source last said, the order in which they are believed, and what is to be thought of it.
#[derive(Clone, Debug)]
pub struct Fusion {
    heard: Heard,
    unknown_sources: u64,
    flying_since: Option<Monotonic>,
    crosscheck: CrossCheck,
    motions: Motions,
    relations: Relations,
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
                refuted: vec![[false; Parameter::COUNT]; SOURCES_MAX],
                witnesses: Witnesses::new(),
                last: [None; SOURCES_MAX],
                tells_traffic: [false; SOURCES_MAX],
                wild_at: None,
            },
            unknown_sources: 0,
            flying_since: None,
            crosscheck: CrossCheck::new(),
            motions: Motions::new(),
            relations: Relations::default(),
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
                if self.heard.stands_still(source, signal.parameter) {
                    self.heard.jumps[source].forget(signal.parameter);
                }
                let wild = self.heard.is_wild(signal.at);
                self.heard.jumps[source].see(signal.parameter, value, signal.at, wild);
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
        let beyond = |p, max: f64| state.read(p, now).is_ok_and(|angle| angle.abs() > max);
        if beyond(Parameter::Roll, WILD_BANK) || beyond(Parameter::Pitch, WILD_PITCH) {
            heard.wild_at = Some(now);
        }
        self.refute(&state, now);
        state
    }

    /// Holds what every source says against everything else; what does not belong to it is not shown in the next picture.
    fn refute(&mut self, state: &FlightState, now: Monotonic) {
        let heard = &mut self.heard;
        let mut refuted = std::mem::take(&mut heard.refuted);
        refuted.fill([false; Parameter::COUNT]);
        let mut refute = |s: SourceId, p: Parameter| {
            if let Some(of_source) = refuted.get_mut(usize::from(s.0)) {
                of_source[p.index()] = true;
            }
        };
        let order = &heard.order;
        let said = |s, p: Parameter| heard.believed(s, p).read(now, p.spec().age_max);
        let stands = |s, p| heard.stands(s, p, now);
        self.crosscheck.step(
            order,
            state,
            said,
            |s| stands(s, Parameter::Roll),
            &mut refute,
            now,
        );
        self.relations.step(order, state, said, &mut refute, now);
        let moment = |s, p: Parameter| {
            let last = heard.believed(s, p);
            let value = last.read(now, p.spec().age_max.max(LATELY)).ok()?;
            Some((value, last.at()?))
        };
        self.motions.step(order, moment, stands, &mut refute, now);
        heard.refuted = refuted;
    }
}

/// What every source last said, and which of it is not to be believed.
#[derive(Clone, Debug)]
struct Heard {
    order: ArrayVec<SourceId, SOURCES_MAX>,
    said: Vec<[Sampled<f64>; Parameter::COUNT]>,
    stillness: Vec<Stillness>,
    jumps: Vec<Jumps>,
    /// What others refute.
    refuted: Vec<[bool; Parameter::COUNT]>,
    /// Calm values that stand still while others move.
    witnesses: Witnesses,
    /// When each source last said anything.
    last: [Option<Monotonic>; SOURCES_MAX],
    tells_traffic: [bool; SOURCES_MAX],
    /// When the attitude shown was last beyond what is flown but in aerobatics.
    wild_at: Option<Monotonic>,
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
    /// Whether aerobatics have been flown of late.
    fn is_wild(&self, now: Monotonic) -> bool {
        let ago = self.wild_at.and_then(|at| now.since(at));
        ago.is_some_and(|ago| ago <= WILD_LASTS)
    }

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
        let last = self.believed(source, parameter);
        if self.refuted[usize::from(source.0)][parameter.index()] {
            refuted(last, Invalid::Implausible)
        } else {
            last
        }
    }

    /// Whether a value of the source of this number was found to stand still, by itself or by witnesses.
    fn stands_still(&self, index: usize, parameter: Parameter) -> bool {
        let stillness = &self.stillness[index];
        let id = SourceId(u8::try_from(index).unwrap_or(u8::MAX));
        stillness.is_frozen(parameter)
            || stillness
                .since(parameter)
                .is_some_and(|t| self.witnesses.is_frozen(id, parameter, t))
    }

    /// What a source last said, if its sensor has neither stopped nor jumped.
    fn believed(&self, source: SourceId, parameter: Parameter) -> Sampled<f64> {
        let index = usize::from(source.0);
        let last = self.said[index][parameter.index()];
        if self.stands_still(index, parameter) {
            refuted(last, Invalid::Frozen)
        } else if self.jumps[index].has_jumped(parameter) {
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
mod tests;
