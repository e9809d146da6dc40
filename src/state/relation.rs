//! Values that belong to others of the same flight, held against them: wind, and the barometric setting.
//!
//! | contradicted | by | when apart by more than | for |
//! |---|---|---|---|
//! | wind | true airspeed and heading against ground speed and track (`derive`) | 10 m/s, as vectors | 5 s |
//! | barometric setting | pressure and corrected altitude of the same source | 60 m (200 ft, the limit of comparators: `compare`), 7 hPa | 5 s |
//!
//! Ten metres a second are 6 degrees of heading at 100 m/s. Above 60 degrees of bank and 30 of pitch the wind that follows is none, and nothing is judged. Where the
//! others are missing, nothing can be said: a setting alone, of a source that sends no corrected altitude, stands until its
//! knob is turned, and nobody else knows the knob.

use super::derive;
use super::latch::{Evidence, Latch};
use super::snapshot::FlightState;
use crate::atmosphere::pressure_altitude;
use crate::limits::SOURCES_MAX;
use crate::sampled::Invalid;
use crate::signal::{Parameter as P, SourceId};
use crate::time::Monotonic;
use crate::units::Hectopascals;
use std::time::Duration;

const LASTING: Duration = Duration::from_secs(5);
/// Differences that are none: m/s, m.
pub const WIND_APART_MPS: f64 = 10.0;
const SETTING_APART_M: f64 = 60.96;
const BANK_MAX: f64 = 1.05;
const PITCH_MAX: f64 = 0.52;
/// Below this part of the limit a difference is none.
const RELEASE: f64 = 0.75;

/// What is remembered of one source.
#[derive(Clone, Copy, Debug, Default)]
struct Of {
    wind: Latch,
    setting: Latch,
}

/// All sources.
#[derive(Clone, Debug, Default)]
pub(super) struct Relations {
    of: [Of; SOURCES_MAX],
}

impl Relations {
    /// Judges all `sources` at `now`. `state` is what is shown, `said` what each source says that is fresh and good; `refute`
    /// is told what contradicts.
    pub(super) fn step(
        &mut self,
        sources: &[SourceId],
        state: &FlightState,
        said: impl Fn(SourceId, P) -> Result<f64, Invalid>,
        refute: &mut impl FnMut(SourceId, P),
        now: Monotonic,
    ) {
        let follows = is_upright(state, now)
            .then(|| derive::wind_now(state, now))
            .flatten();
        for &source in sources {
            let Some(of) = self.of.get_mut(usize::from(source.0)) else {
                continue;
            };
            let wind = wind_said(|p| said(source, p), state, now);
            if of.wind_is_refuted(wind, follows, now) {
                refute(source, P::WindSpeed);
                refute(source, P::WindDirectionTrue);
                refute(source, P::WindDirectionMagnetic);
            }
            let apart = setting_apart(|p| said(source, p).ok());
            if of.setting.step(evidence(apart), LASTING, now) {
                refute(source, P::BaroSetting);
            }
        }
    }
}

impl Of {
    fn wind_is_refuted(
        &mut self,
        wind: Option<(f64, f64)>,
        follows: Option<(f64, f64)>,
        now: Monotonic,
    ) -> bool {
        let between = |(a, b): (f64, f64), (c, d): (f64, f64)| (a - c).hypot(b - d);
        let apart = wind.zip(follows);
        let apart = apart.map(|(said, other)| between(said, vector(other)) / WIND_APART_MPS);
        let evidence = match (wind, apart) {
            // What was begun goes on while nothing is there to judge by.
            (Some(_), None) => Evidence::Between,
            _ => evidence(apart),
        };
        self.wind.step(evidence, LASTING, now)
    }
}

fn evidence(apart: Option<f64>) -> Evidence {
    match apart {
        None => Evidence::Nothing,
        Some(apart) if apart > 1.0 => Evidence::For,
        Some(apart) if apart < RELEASE => Evidence::Against,
        Some(_) => Evidence::Between,
    }
}

fn is_upright(state: &FlightState, now: Monotonic) -> bool {
    let beyond = |p, max: f64| state.read(p, now).is_ok_and(|angle| angle.abs() > max);
    !beyond(P::Roll, BANK_MAX) && !beyond(P::Pitch, PITCH_MAX)
}

fn vector((speed, from): (f64, f64)) -> (f64, f64) {
    (speed * from.cos(), speed * from.sin())
}

/// The wind as a source says it, north and east, from true north.
fn wind_said(
    said: impl Fn(P) -> Result<f64, Invalid>,
    state: &FlightState,
    now: Monotonic,
) -> Option<(f64, f64)> {
    let from = said(P::WindDirectionTrue).or_else(|_| {
        let variation = state.read(P::MagneticVariation, now)?;
        Ok::<_, Invalid>(said(P::WindDirectionMagnetic)? + variation)
    });
    Some(vector((said(P::WindSpeed).ok()?, from.ok()?)))
}

/// How far the setting is from what lies between a source's two altitudes, in units of the limit.
fn setting_apart(said: impl Fn(P) -> Option<f64>) -> Option<f64> {
    let between = said(P::PressureAltitude)? - said(P::BaroAltitude)?;
    let setting = pressure_altitude(Hectopascals(said(P::BaroSetting)?)).0;
    Some((between - setting).abs() / SETTING_APART_M)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::Signal;
    use crate::state::Fusion;

    const A: SourceId = SourceId(0);

    /// Level flight to the north at 60 m/s through air that moves as given, for so many seconds; what is shown of `parameter`.
    fn shown(seconds: u32, said: &[(P, f64)], parameter: P) -> Vec<Result<f64, Invalid>> {
        let mut fusion = Fusion::new(&[A]);
        (0..seconds * 10)
            .map(|k| {
                let at = Monotonic::from_nanos(1_000_000_000 + u64::from(k) * 100_000_000);
                for (parameter, value) in said {
                    fusion.apply(&Signal {
                        at,
                        source: A,
                        parameter: *parameter,
                        value: parameter.check(*value),
                    });
                }
                fusion.step(at).read(parameter, at)
            })
            .collect()
    }

    #[test]
    fn a_wind_that_does_not_belong_to_the_flight_is_refuted() {
        // Airspeed 60, ground speed 80, both to the north: 20 m/s from the south.
        let flight = [
            (P::TrueAirspeed, 60.0),
            (P::HeadingTrue, 0.0),
            (P::GroundSpeed, 80.0),
            (P::Track, 0.0),
        ];
        for (speed, from_degrees, is_right) in [
            (20.0, 180.0, true),
            (12.0, 190.0, true),
            (20.0, 220.0, false),
            (9.0, 180.0, false),
            (20.0, 0.0, false),
        ] {
            let mut said = flight.to_vec();
            said.push((P::WindSpeed, speed));
            said.push((P::WindDirectionTrue, f64::to_radians(from_degrees)));
            let last = shown(7, &said, P::WindSpeed).pop();
            let expected = if is_right {
                Ok(speed)
            } else {
                Err(Invalid::Implausible)
            };
            assert_eq!(last, Some(expected), "{speed} from {from_degrees}");
        }
    }

    #[test]
    fn a_setting_that_does_not_belong_to_its_altitudes_is_refuted() {
        // 1 hPa is 8.3 m near sea level: 10 hPa are 83 m, 6 are 50.
        for (setting, is_right) in [(1013.25, true), (1019.25, true), (1023.25, false)] {
            let said = [
                (P::PressureAltitude, 300.0),
                (P::BaroAltitude, 300.0),
                (P::BaroSetting, setting),
            ];
            let all = shown(7, &said, P::BaroSetting);
            let last = all.last().copied();
            if is_right {
                assert_eq!(last, Some(Ok(setting)));
            } else {
                assert_eq!(last, Some(Err(Invalid::Implausible)));
                assert_eq!(all[40], Ok(setting), "not before its time");
            }
        }
    }
}
