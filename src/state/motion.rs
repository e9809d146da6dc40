//! What a receiver says of its motion, held against where it goes.
//!
//! Speed and track over the ground are the derivative of position. A receiver that sends both, and whose speed or track has
//! stopped or slides away, contradicts itself: over the last 3 s its displacement is not what its velocities add up to.
//!
//! | contradicted | when | for |
//! |---|---|---|
//! | ground speed | the mean speed is another by more than 3 m/s, 3 % of it, and what the speed itself changes in a second | 2 s |
//! | track | the direction is another by more than 10 degrees and what the track itself turns in a second; above 25 m/s | 2 s |
//!
//! The second that is allowed for is the lag of a receiver's filters. Both are taken from one source only, never across
//! sources. It proves nothing while latitude or longitude repeats for 1.5 s (which `frozen` judges) or has jumped (`jump`), nor
//! after that until there are 2 s of new ones. Numbers our own: a recorded glider in circles (`xcsoar_rl-traffic.nmea`) stays below
//! 0.16 m/s in all of its 443 windows.

use super::latch::{Evidence, Latch};
use super::trail::Trail;
use crate::angle::shortest_turn;
use crate::geo::{meridian_radius_m, prime_vertical_radius_m};
use crate::limits::SOURCES_MAX;
use crate::signal::{Parameter as P, SourceId};
use crate::time::Monotonic;
use crate::units::Radians;
use std::time::Duration;

/// How long a contradiction lasts until it counts, and is gone until it does no more.
const LASTING: Duration = Duration::from_secs(2);
const WINDOW: Duration = Duration::from_secs(3);
/// There are positions over so much of it at least.
const WINDOW_MIN: Duration = Duration::from_secs(2);
/// A coordinate that repeats for so long says nothing.
pub(super) const REPEATS_MAX: Duration = Duration::from_millis(1500);
/// Differences that are none: m/s, part of the speed, rad.
const SPEED_APART_MPS: f64 = 3.0;
const SPEED_APART_PART: f64 = 0.03;
const TRACK_APART: f64 = 0.175;
/// Slower than this, direction is not judged, m/s.
const TRACK_MPS_MIN: f64 = 25.0;
/// Below this part of the limit a difference is none.
const RELEASE: f64 = 0.75;

/// Where a source was, and how it said that it moved.
#[derive(Clone, Copy, Debug)]
struct Moment {
    latitude: f64,
    longitude: f64,
    speed: f64,
    track: f64,
}

/// One receiver.
#[derive(Clone, Debug)]
struct Receiver {
    trail: Trail<Moment>,
    speed: Latch,
    track: Latch,
}

/// All of them.
#[derive(Clone, Debug)]
pub(super) struct Motions {
    receivers: Vec<Receiver>,
}

impl Motions {
    pub(super) fn new() -> Self {
        let receiver = Receiver {
            trail: Trail::new(),
            speed: Latch::default(),
            track: Latch::default(),
        };
        Self {
            receivers: vec![receiver; SOURCES_MAX],
        }
    }

    /// Judges all `sources` at `now`. `said` is a fresh good value and when it came, `repeats` how long it has repeated;
    /// `refute` is told what contradicts.
    pub(super) fn step(
        &mut self,
        sources: &[SourceId],
        said: impl Fn(SourceId, P) -> Option<(f64, Monotonic)>,
        repeats: impl Fn(SourceId, P) -> Duration,
        refute: &mut impl FnMut(SourceId, P),
        now: Monotonic,
    ) {
        for &source in sources {
            let Some(receiver) = self.receivers.get_mut(usize::from(source.0)) else {
                continue;
            };
            let place = [P::Latitude, P::Longitude];
            let stands = place.iter().any(|p| repeats(source, *p) >= REPEATS_MAX);
            let moment = moment(|p| said(source, p));
            let (speed, track) = receiver.judge(moment, stands, now);
            if speed {
                refute(source, P::GroundSpeed);
            }
            if track {
                refute(source, P::Track);
                refute(source, P::TrackMagnetic);
            }
        }
    }
}

fn moment(said: impl Fn(P) -> Option<(f64, Monotonic)>) -> Option<(Moment, Monotonic)> {
    let (latitude, at) = said(P::Latitude)?;
    let moment = Moment {
        latitude,
        longitude: said(P::Longitude)?.0,
        speed: said(P::GroundSpeed)?.0,
        track: said(P::Track)?.0,
    };
    Some((moment, at))
}

impl Receiver {
    /// Whether speed and track are contradicted.
    fn judge(
        &mut self,
        moment: Option<(Moment, Monotonic)>,
        stands: bool,
        now: Monotonic,
    ) -> (bool, bool) {
        let evidence = match moment {
            None => {
                self.trail.forget();
                [Evidence::Nothing; 2]
            }
            Some(_) if stands => {
                self.trail.forget();
                [Evidence::Between; 2]
            }
            Some((moment, at)) => {
                self.trail.keep(moment, at);
                apart(self.trail.within(WINDOW)).map(|apart| match apart {
                    Some(apart) if apart > 1.0 => Evidence::For,
                    Some(apart) if apart < RELEASE => Evidence::Against,
                    _ => Evidence::Between,
                })
            }
        };
        (
            self.speed.step(evidence[0], LASTING, now),
            self.track.step(evidence[1], LASTING, now),
        )
    }
}

/// By how much speed and direction are apart from those of the positions, in units of their limits; `None` where they are not
/// judged.
fn apart(recent: &[(Monotonic, Moment)]) -> [Option<f64>; 2] {
    let (Some((from_at, from)), Some((to_at, to))) = (recent.first(), recent.last()) else {
        return [None; 2];
    };
    let dt = to_at.since(*from_at).unwrap_or_default();
    if dt < WINDOW_MIN {
        return [None; 2];
    }
    let dt_s = dt.as_secs_f64();
    let (sin, cos) = f64::midpoint(from.latitude, to.latitude).sin_cos();
    let east = shortest_turn(Radians(from.longitude), Radians(to.longitude)).0;
    let went = (
        (to.latitude - from.latitude) * meridian_radius_m(sin) / dt_s,
        east * prime_vertical_radius_m(sin) * cos / dt_s,
    );
    let said = mean_velocity(recent, dt_s);
    let (went_mps, said_mps) = (went.0.hypot(went.1), said.0.hypot(said.1));
    let change = (to.speed - from.speed).abs() / dt_s;
    let speed_limit = SPEED_APART_MPS.max(SPEED_APART_PART * said_mps) + change;
    let speed = (went_mps - said_mps).abs() / speed_limit;
    let turned = shortest_turn(Radians(from.track), Radians(to.track))
        .0
        .abs()
        / dt_s;
    let direction = |(north, east): (f64, f64)| Radians(east.atan2(north));
    let track = shortest_turn(direction(said), direction(went)).0.abs() / (TRACK_APART + turned);
    let is_fast = went_mps >= TRACK_MPS_MIN && said_mps >= TRACK_MPS_MIN;
    [Some(speed), is_fast.then_some(track)]
}

/// North and east, m/s, by the trapezoidal rule.
fn mean_velocity(recent: &[(Monotonic, Moment)], dt_s: f64) -> (f64, f64) {
    let mut sum = (0.0, 0.0);
    for ((from_at, from), (to_at, to)) in recent.iter().zip(recent.iter().skip(1)) {
        let half_s = to_at.since(*from_at).unwrap_or_default().as_secs_f64() * 0.5;
        for m in [from, to] {
            sum.0 += m.speed * m.track.cos() * half_s;
            sum.1 += m.speed * m.track.sin() * half_s;
        }
    }
    (sum.0 / dt_s, sum.1 / dt_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: SourceId = SourceId(0);

    /// Flies a circle on a sphere of nautical miles for so many seconds, once a second, and says so, but for what is given;
    /// seconds after which speed and track were refuted.
    fn refuted(turn_dps: f64, say: impl Fn(f64, (f64, f64)) -> (f64, f64)) -> [Option<f64>; 2] {
        let mut motions = Motions::new();
        let mut found = [None; 2];
        let (mut north, mut east, mut track) = (0.0_f64, 0.0_f64, 0.3_f64);
        for k in 0..600_u32 {
            let t = f64::from(k) * 0.1;
            track += turn_dps.to_radians() * 0.1;
            north += 5.0 * track.cos();
            east += 5.0 * track.sin();
            if k % 10 != 0 {
                continue;
            }
            let now = Monotonic::from_nanos(1_000_000_000).plus(Duration::from_secs_f64(t));
            let (speed, course) = say(t, (50.0, track));
            let at = |p: P| match p {
                P::Latitude => Some((0.8 + north / 6_380_000.0, now)),
                P::Longitude => Some((0.2 + east / (6_389_000.0 * 0.8_f64.cos()), now)),
                P::GroundSpeed => Some((speed, now)),
                P::Track => Some((course.rem_euclid(std::f64::consts::TAU), now)),
                _ => None,
            };
            let mut refute = |_: SourceId, p: P| match p {
                P::GroundSpeed => found[0] = found[0].or(Some(t)),
                _ => found[1] = found[1].or(Some(t)),
            };
            motions.step(&[A], |_, p| at(p), |_, _| Duration::ZERO, &mut refute, now);
        }
        found
    }

    #[test]
    fn a_receiver_that_is_well_is_believed_in_tight_turns_and_with_lag() {
        for turn in [0.0, 3.0, -12.0, 25.0] {
            assert_eq!(refuted(turn, |_, said| said), [None; 2], "{turn}");
            let lag = |_: f64, (v, track): (f64, f64)| (v, track - turn.to_radians());
            assert_eq!(refuted(turn, lag), [None; 2], "{turn}, a second late");
        }
    }

    #[test]
    fn a_speed_that_is_another_is_found_alone() {
        let slow = |t: f64, (v, track): (f64, f64)| (if t < 20.0 { v } else { v - 8.0 }, track);
        let [speed, track] = refuted(3.0, slow);
        assert!(
            speed.is_some_and(|t| (22.0..=27.0).contains(&t)),
            "{speed:?}"
        );
        assert_eq!(track, None);
    }

    #[test]
    fn a_track_that_stands_is_found_alone_in_a_turn() {
        let stuck = |t: f64, (v, track): (f64, f64)| {
            let stood = (track - 0.3) / t.max(0.1) * 20.0 + 0.3;
            (v, if t < 20.0 { track } else { stood })
        };
        let [speed, track] = refuted(3.0, stuck);
        // Ten degrees are reached after 3.3 s, over half the window, and last two.
        assert!(
            track.is_some_and(|t| (25.0..=30.0).contains(&t)),
            "{track:?}"
        );
        assert_eq!(speed, None);
    }
}
