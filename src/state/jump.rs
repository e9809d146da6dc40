//! Jumps: values that an aircraft cannot have reached since the one before.
//!
//! Of every parameter that the flight itself moves, the step from the last believed value of the same source must be within
//! its *reach*: what noise and rounding make of it (slack), and how far it can have gone in the time between,
//!
//! `reach = slack + min(rate, recent + acceleration dt) dt`
//!
//! with the greatest rate and acceleration of attitude of any aircraft that this program flies in, aerobatic ones included,
//! and of the others what flight up to three times gravity makes of them over a second (table below), `recent` the fastest of the last steps, and `dt` no less than the usual time between two values: what waited in
//! a buffer comes all at once. A value beyond its reach is [`Implausible`](crate::sampled::Invalid::Implausible) at
//! once, and so is what follows it, until
//! - a value jumps back at least half of the way, to where the last believed one can have moved on to: a disturbance has
//!   passed; or
//! - all values have followed from one another for [`RECOVERY`]: the source has found a new beginning, as a receiver does
//!   that sees its satellites again. Nobody can tell then whether it was wrong before or is wrong now; where another
//!   source says the same quantity, `compare` goes on telling.
//!
//! The first value of a source, and the first after a silence of as long, is believed: there is nothing to hold it against.
//! A step within its reach is never found: this bounds by how much a single damaged frame without a checksum can mislead.
//!
//! Not judged: what a pilot or an engine may change in an instant (bugs, engine, fuel), counts and dates, headings
//! and turn rate above 60 degrees of pitch, headings and track below 15 m/s, longitude within 6 km of a
//! pole, track in aerobatics. In aerobatics (the attitude that is shown has been beyond 60 degrees of bank or 40 of pitch in
//! the last 5 s: a receiver that speaks once a second sees little else of a looping) vertical and ground speed may change by six
//! g at once. The direction of the wind is judged by how far the wind moves as a vector: its estimators turn a breeze about as they
//! learn (by 152 degrees at 8 kt, recorded). Roll is judged by how far it
//! turns the horizon, so that a looping, in which it changes by half a turn at the top, is none.

use crate::signal::Parameter as P;
use crate::time::Monotonic;
use std::f64::consts::TAU;
use std::time::Duration;

/// How long values must have followed from one another after a jump to be believed again.
pub const RECOVERY: Duration = Duration::from_secs(10);

/// Steeper than this, heading and turn rate say little, rad.
const STEEP: f64 = 1.05;
/// What a looping of six g makes of vertical and ground speed within a second, m/s2.
const WILD_MPS2: f64 = 60.0;
/// Slower than this, the track is noise, m/s.
const TRACK_MPS_MIN: f64 = 15.0;
/// The greatest acceleration across the path over a second, m/s2: two and a half times that of gravity, a bank of 69 degrees.
const TURN_ACCELERATION_MAX: f64 = 25.0;
/// The mean radius of the earth, m.
const EARTH_M: f64 = 6_371_000.0;

/// How fast a parameter can change, in its unit, its unit a second, and that a second.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Agility {
    slack: f64,
    rate: f64,
    acceleration: f64,
}

const fn agility(slack: f64, rate: f64, acceleration: f64) -> Option<Agility> {
    Some(Agility {
        slack,
        rate,
        acceleration,
    })
}

/// The table. Rates: an aerobatic single rolls at 400 degrees a second at most (Extra 330: 420); vertical speeds as in the
/// table of ranges; along the path six g.
const fn limits(parameter: P) -> Option<Agility> {
    match parameter {
        P::Pitch => agility(0.06, 4.0, 8.0),
        P::Roll => agility(0.1, 7.4, 25.0),
        P::HeadingTrue | P::HeadingMagnetic => agility(0.1, 4.0, 8.0),
        P::Track | P::TrackMagnetic => agility(0.15, 4.0, 4.0),
        P::RollRate | P::PitchRate | P::YawRate => agility(0.8, 30.0, 1000.0),
        P::TurnRate => agility(0.6, 10.0, 20.0),
        P::LateralAcceleration => agility(0.5, 3.0, 30.0),
        P::NormalAcceleration | P::LongitudinalAcceleration => agility(2.5, 20.0, 100.0),
        P::SlipBall => agility(0.2, 2.0, 5.0),
        P::Sideslip | P::AngleOfAttack => agility(0.25, 5.0, 20.0),
        P::AngleOfAttackUsed => agility(50.0, 100.0, 1000.0),
        P::IndicatedAirspeed | P::CalibratedAirspeed | P::TrueAirspeed => agility(15.0, 20.0, 40.0),
        P::MachNumber => agility(0.06, 0.15, 0.15),
        P::PressureAltitude => agility(60.0, 150.0, 80.0),
        P::AltitudeMsl | P::HeightEllipsoid => agility(100.0, 150.0, 80.0),
        // A new setting may move it by two inches of mercury at once.
        P::BaroAltitude => agility(600.0, 150.0, 80.0),
        P::DensityAltitude => agility(300.0, 150.0, 80.0),
        // Cliffs.
        P::HeightAgl => agility(600.0, 300.0, 100.0),
        P::VerticalSpeed | P::TotalEnergyVerticalSpeed => agility(9.0, 20.0, 60.0),
        P::GroundSpeed => agility(10.0, 25.0, 40.0),
        P::Latitude | P::Longitude => agility(200.0 / EARTH_M, 700.0 / EARTH_M, 1.0),
        P::StaticAirTemperature | P::TotalAirTemperature => agility(8.0, 1.5, 10.0),
        // Of a direction too, in m/s.
        P::WindSpeed | P::WindDirectionTrue | P::WindDirectionMagnetic => agility(10.0, 3.0, 10.0),
        // A new setting, far from the last, is doubted for a while.
        P::BaroSetting => agility(15.0, 15.0, 100.0),
        P::StaticPressure => agility(20.0, 20.0, 20.0),
        P::TotalPressure => agility(40.0, 60.0, 60.0),
        _ => None,
    }
}

/// Whether a parameter is an angle whose two ends are the same.
const fn turns(parameter: P) -> bool {
    matches!(
        parameter,
        P::Roll | P::HeadingTrue | P::HeadingMagnetic | P::Track | P::TrackMagnetic | P::Longitude
    )
}

/// Whether it is the direction of a wind.
const fn is_of_wind(parameter: P) -> bool {
    matches!(parameter, P::WindDirectionTrue | P::WindDirectionMagnetic)
}

/// By how much two successive values of a parameter that come so far apart may differ at most before the second is doubted,
/// in the parameter's unit; `None` for what is not judged, or not in that unit (the direction of the wind).
#[must_use]
pub fn reach_max(parameter: P, apart: Duration) -> Option<f64> {
    let agility = limits(parameter).filter(|_| !is_of_wind(parameter))?;
    let step = agility.slack + agility.rate * apart.as_secs_f64();
    Some(if parameter == P::Longitude {
        step * 10.0
    } else {
        step
    })
}

/// What is remembered of one parameter of one source.
#[derive(Clone, Copy, Debug, Default)]
struct Trace {
    /// The last believed value.
    trusted: Option<(f64, Monotonic)>,
    /// How fast it has changed of late, in units a second.
    recent: f64,
    /// The usual time between two values, s.
    usual_s: f64,
    doubt: Option<Doubt>,
}

/// A jump, and what has come since.
#[derive(Clone, Copy, Debug)]
struct Doubt {
    /// Since when all values follow from one another.
    since: Monotonic,
    last: (f64, Monotonic),
    /// How far from the last believed value a value must not be to be believed at once.
    reach: f64,
    /// How far the jump went.
    size: f64,
}

impl Trace {
    fn see(
        &mut self,
        value: f64,
        at: Monotonic,
        agility: Agility,
        apart: impl Fn(f64, f64) -> f64,
    ) {
        let Some((from, from_at)) = self.trusted else {
            self.trusted = Some((value, at));
            return;
        };
        let (last, last_at) = self.doubt.map_or((from, from_at), |doubt| doubt.last);
        let dt_s = at.since(last_at).unwrap_or_default();
        if dt_s > RECOVERY {
            *self = Self {
                trusted: Some((value, at)),
                ..Self::default()
            };
            return;
        }
        let dt_s = dt_s.as_secs_f64();
        self.usual_s = if self.usual_s > 0.0 {
            self.usual_s + (dt_s - self.usual_s) * 0.1
        } else {
            dt_s
        };
        let dt_s = dt_s.max(self.usual_s);
        let rate = agility.rate.min(self.recent + agility.acceleration * dt_s);
        let reach = agility.slack + rate * dt_s;
        let step = apart(last, value);
        let follows = step <= reach;
        if let Some(doubt) = &mut self.doubt {
            if !follows {
                doubt.since = at;
            }
            doubt.last = (value, at);
            let has_settled = at.since(doubt.since).is_some_and(|d| d >= RECOVERY);
            // Only by a step is it back: what slides there slides on from where it jumped to.
            let elapsed_s = at.since(from_at).unwrap_or_default().as_secs_f64();
            let moved_on = doubt.reach + agility.slack * elapsed_s;
            let is_back =
                !follows && apart(from, value) <= moved_on.min(doubt.size * 0.5).max(doubt.reach);
            if is_back || has_settled {
                self.doubt = None;
                self.trusted = Some((value, at));
                self.recent = 0.0;
            }
        } else if follows {
            self.trusted = Some((value, at));
            let speed = if dt_s > 0.0 { step / dt_s } else { 0.0 };
            self.recent = speed.max(self.recent * 0.8);
        } else {
            self.doubt = Some(Doubt {
                since: at,
                last: (value, at),
                reach,
                size: step,
            });
        }
    }
}

/// What is remembered of all parameters of one source.
#[derive(Clone, Debug)]
pub(super) struct Jumps {
    traces: [Trace; P::COUNT],
}

impl Jumps {
    pub(super) fn new() -> Self {
        Self {
            traces: [Trace::default(); P::COUNT],
        }
    }

    /// A value has come; `wild` while the aircraft flies aerobatics.
    pub(super) fn see(&mut self, parameter: P, value: f64, at: Monotonic, wild: bool) {
        let Some(mut agility) = limits(parameter) else {
            return;
        };
        let last = |p: P| self.traces[p.index()].trusted.map(|(value, _)| value);
        let pitch = last(P::Pitch).unwrap_or(0.0);
        let mut scale = 1.0;
        let mut is_judged = true;
        match parameter {
            P::TurnRate => is_judged = pitch.abs() < STEEP,
            P::HeadingTrue | P::HeadingMagnetic => {
                let is_slow = last(P::GroundSpeed).is_some_and(|speed| speed < TRACK_MPS_MIN);
                is_judged = pitch.abs() < STEEP && !is_slow;
            }
            P::Track | P::TrackMagnetic => {
                let speed = last(P::GroundSpeed).unwrap_or(TRACK_MPS_MIN);
                is_judged = speed >= TRACK_MPS_MIN && !wild;
                agility.rate = TURN_ACCELERATION_MAX / speed;
            }
            P::Longitude => {
                scale = last(P::Latitude).unwrap_or(0.0).cos();
                is_judged = scale > 0.001;
            }
            P::VerticalSpeed | P::TotalEnergyVerticalSpeed | P::GroundSpeed if wild => {
                // Six g, in any direction, from one value to the next.
                (agility.rate, agility.acceleration) = (WILD_MPS2, WILD_MPS2 * 10.0);
            }
            P::Roll => scale = pitch.cos(),
            _ if is_of_wind(parameter) => scale = last(P::WindSpeed).unwrap_or(0.0),
            _ => {}
        }
        let trace = &mut self.traces[parameter.index()];
        if !is_judged {
            *trace = Trace {
                trusted: Some((value, at)),
                ..Trace::default()
            };
            return;
        }
        trace.see(value, at, agility, |a, b| {
            let step = if turns(parameter) {
                let turn = (b - a).rem_euclid(TAU);
                turn.min(TAU - turn)
            } else {
                (b - a).abs()
            };
            if is_of_wind(parameter) {
                2.0 * ((b - a) * 0.5).sin().abs() * scale
            } else if parameter == P::Roll {
                // The angle between the two directions of down, as the aircraft sees them.
                2.0 * ((step * 0.5).sin() * scale).abs().min(1.0).asin()
            } else {
                step * scale
            }
        });
    }

    /// What was said of a parameter tells nothing of what comes.
    pub(super) fn forget(&mut self, parameter: P) {
        self.traces[parameter.index()] = Trace::default();
    }

    /// Whether the last value of a parameter is one that cannot be.
    pub(super) const fn has_jumped(&self, parameter: P) -> bool {
        self.traces[parameter.index()].doubt.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(t: u64) -> Monotonic {
        Monotonic::from_nanos(t * 1_000_000)
    }

    /// Gives values every so many milliseconds; returns which of them were doubted.
    fn doubted(parameter: P, every_ms: u64, values: &[f64]) -> Vec<bool> {
        let mut jumps = Jumps::new();
        let mut t = 1000;
        let mut doubted = Vec::new();
        for value in values {
            t += every_ms;
            jumps.see(parameter, *value, ms(t), false);
            doubted.push(jumps.has_jumped(parameter));
        }
        doubted
    }

    #[test]
    fn a_jump_is_doubted_at_once_and_its_end_believed_at_once() {
        for (parameter, every_ms, jump) in [
            (P::Pitch, 100, 0.3),
            (P::Roll, 100, 0.6),
            (P::HeadingMagnetic, 100, 0.6),
            (P::IndicatedAirspeed, 100, 40.0),
            (P::PressureAltitude, 100, 2000.0),
            (P::Latitude, 1000, 0.01),
            (P::GroundSpeed, 1000, 70.0),
            (P::VerticalSpeed, 200, 30.0),
        ] {
            let a = 1.0;
            let values = [a, a, a, a + jump, a + jump, a, a];
            let expected = [false, false, false, true, true, false, false];
            assert_eq!(
                doubted(parameter, every_ms, &values),
                expected,
                "{parameter:?}"
            );
        }
    }

    #[test]
    fn a_new_beginning_is_believed_after_its_time() {
        let mut values = vec![0.1; 10];
        values.extend(vec![1.2; 120]);
        let doubted = doubted(P::Roll, 100, &values);
        assert!(doubted[10..110].iter().all(|d| *d), "ten seconds");
        assert!(!doubted[110], "then believed");
    }

    #[test]
    fn aerobatics_are_no_jumps() {
        // A roll that builds up to 400 degrees a second in a third of a second, seen twenty times a second.
        let roll = |t: f64| {
            if t < 0.35 {
                10.0 * t * t
            } else {
                7.0 * t - 1.225
            }
        };
        let wrapped = |x: f64| (x + TAU / 2.0).rem_euclid(TAU) - TAU / 2.0;
        let rolling: Vec<f64> = (0..100)
            .map(|n| wrapped(roll(f64::from(n) * 0.05)))
            .collect();
        assert!(!doubted(P::Roll, 50, &rolling).contains(&true), "roll");
        // A looping in 8 s: pitch up to the vertical, half a turn of roll and heading, and down again.
        let mut jumps = Jumps::new();
        for n in 0..160_u32 {
            let turned = f64::from(n) * TAU / 160.0 + 0.01;
            let over = turned.cos() < 0.0;
            let pitch = turned.sin().asin();
            let at = ms(1000 + u64::from(n) * 50);
            jumps.see(P::Pitch, pitch, at, false);
            jumps.see(P::Roll, if over { 3.1 } else { 0.0 }, at, false);
            jumps.see(
                P::HeadingTrue,
                if over { 4.0 } else { 4.0 - TAU / 2.0 },
                at,
                false,
            );
            for p in [P::Pitch, P::Roll, P::HeadingTrue] {
                assert!(!jumps.has_jumped(p), "{p:?} at {n}");
            }
        }
    }

    #[test]
    fn the_date_line_and_a_burst_are_no_jumps() {
        let pi = std::f64::consts::PI;
        let line = [pi - 4e-5, pi - 3e-6, 2e-5 - pi, 9e-5 - pi];
        assert!(
            !doubted(P::Longitude, 1000, &line).contains(&true),
            "date line"
        );
        let mut jumps = Jumps::new();
        // Ten values a second, a degree apart, of which some wait for the next.
        for n in 0..50_u32 {
            let late = u64::from(n).div_ceil(3) * 300;
            jumps.see(P::Roll, f64::from(n) * 0.05 - 1.0, ms(1000 + late), false);
            assert!(!jumps.has_jumped(P::Roll), "{n}");
        }
    }

    #[test]
    fn a_looping_seen_once_a_second_is_no_jump_of_a_receiver() {
        // 70 m/s round a circle in 8 s: what climbs, what is left over the ground, and the track that turns about at the top.
        let mut jumps = Jumps::new();
        for n in 0..40_u32 {
            let (up, along) = (f64::from(n) * TAU / 8.0 + 0.3).sin_cos();
            let at = ms(1000 + u64::from(n) * 1000);
            for (p, value) in [
                (P::VerticalSpeed, 70.0 * up),
                (P::GroundSpeed, 70.0 * along.abs()),
                (P::Track, if along < 0.0 { 4.0 } else { 4.0 - TAU / 2.0 }),
            ] {
                jumps.see(p, value, at, true);
                assert!(!jumps.has_jumped(p), "{p:?} at {n}");
            }
        }
    }
}
