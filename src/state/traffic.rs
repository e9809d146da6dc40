//! Other aircraft: one place for each, where it is from here, and for how long that is known.
//!
//! Reports are kept by address, whoever heard it; of two receivers that hear the same aircraft the more trusted one counts for
//! as long as it goes on. What has no address has one place for each source and kind of place, and the aircraft's own address is left out.
//!
//! | place | shown for | and meanwhile |
//! |---|---|---|
//! | on WGS 84 (GDL90) | 10 s, ten reports | moved on along its own track at its own speed, where it tells both |
//! | from the own aircraft (FLARM) | 3 s, three reports | left: only the receiver knew its own place just then |
//!
//! The times are our own. Vertical distance is between two pressure altitudes, or as FLARM tells it; never between a pressure
//! altitude and a geometric one. Without both it is not known, and said to be.

use super::snapshot::FlightState;
use crate::angle::{shortest_turn, wrap_turn};
use crate::geo::{meridian_radius_m, prime_vertical_radius_m};
use crate::limits::{TRAFFIC_HEARD_MAX, TRAFFIC_SHOWN_MAX};
use crate::signal::{Alert, Parameter as P, Place, SourceId, Traffic};
use crate::time::Monotonic;
use crate::units::Radians;
use arrayvec::ArrayVec;
use std::time::Duration;

/// How long a place on WGS 84 is shown after it was received.
pub const GEODETIC_AGE_MAX: Duration = Duration::from_secs(10);
/// How long a place relative to the own aircraft is shown after it was received.
pub const RELATIVE_AGE_MAX: Duration = Duration::from_secs(3);
/// A more trusted receiver that has been silent about an aircraft for this long is not waited for.
const HANDOVER: Duration = Duration::from_secs(3);
/// A source of traffic that says nothing at all for this long is silent: three of GDL90's heartbeats.
pub const FEED_AGE_MAX: Duration = Duration::from_secs(3);
/// What is farther than this is not shown: ten nautical miles, m.
pub const RANGE_MAX_M: f64 = 18_520.0;
/// What is higher or lower than this is not shown: 3500 ft, m.
pub const UP_MAX_M: f64 = 1066.8;

/// In which direction another aircraft is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Direction {
    /// Clockwise from true north, 0 to 2 pi.
    True(Radians),
    /// From the own track, right positive, -pi to pi.
    FromTrack(Radians),
    /// Not known: only how far it is.
    Unknown,
}

/// Another aircraft, as seen from the own one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Its 24-bit address, where known.
    pub address: Option<u32>,
    /// Where.
    pub direction: Direction,
    /// Over the ground, m.
    pub distance_m: f64,
    /// How much higher it is, m; `None` where that is not known.
    pub up_m: Option<f64>,
    /// Up positive, m/s.
    pub vertical_speed_mps: Option<f64>,
    /// How near its receiver thinks that it will come.
    pub alert: Alert,
}

/// Whether there is anybody who would tell of other aircraft.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Feed {
    /// No source tells of other aircraft.
    #[default]
    None,
    /// There is one, and it is heard: what is not shown was not reported.
    Live,
    /// There is one, or was, and it is silent.
    Silent,
}

/// Other aircraft at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Around {
    /// The most urgent first, then the nearest.
    pub targets: [Option<Target>; TRAFFIC_SHOWN_MAX],
    /// Who tells of them.
    pub feed: Feed,
}

impl Around {
    /// Nobody, and nobody who would tell.
    pub const NOBODY: Self = Self {
        targets: [None; TRAFFIC_SHOWN_MAX],
        feed: Feed::None,
    };
}

/// What was heard of other aircraft.
#[derive(Clone, Debug)]
pub(super) struct Skies {
    heard: ArrayVec<Traffic, TRAFFIC_HEARD_MAX>,
    own: ArrayVec<u32, 8>,
    own_place: Option<(f64, f64)>,
}

impl Skies {
    pub(super) fn new() -> Self {
        Self {
            heard: ArrayVec::new(),
            own: ArrayVec::new(),
            own_place: None,
        }
    }

    /// This address is the own aircraft's.
    pub(super) fn is_own(&mut self, address: u32) {
        if !self.own.contains(&address) {
            if self.own.is_full() {
                self.own.remove(0);
            }
            self.own.push(address);
            self.heard.retain(|t| t.address != Some(address));
        }
    }

    /// Remembers a report. `trust` ranks sources, the most trusted lowest.
    pub(super) fn see(&mut self, new: &Traffic, trust: impl Fn(SourceId) -> usize) {
        if new.address.is_some_and(|a| self.own.contains(&a)) {
            return;
        }
        let same = |old: &&mut Traffic| match (old.address, new.address) {
            (Some(a), Some(b)) => a == b,
            (None, None) => old.source == new.source && kind(&old.place) == kind(&new.place),
            _ => false,
        };
        if let Some(old) = self.heard.iter_mut().find(same) {
            let Some(later) = new.at.since(old.at) else {
                return;
            };
            if old.source == new.source && kind(&new.place) < kind(&old.place) && later < HANDOVER {
                // The same receiver has just told its place better: only its word on the danger is news.
                old.alert = old.alert.max(new.alert);
            } else if trust(new.source) <= trust(old.source) || later >= HANDOVER {
                *old = *new;
            }
            return;
        }
        if self.heard.is_full() {
            let own = self.own_place;
            let least = |t: &Traffic| {
                (
                    t.alert,
                    -offset_of(t, own).map_or(f64::MAX, |o| o.distance_m),
                )
            };
            let order = |a: &Traffic, b: &Traffic| {
                let ((alert_a, near_a), (alert_b, near_b)) = (least(a), least(b));
                alert_a.cmp(&alert_b).then(near_a.total_cmp(&near_b))
            };
            let worst =
                (0..self.heard.len()).min_by(|a, b| order(&self.heard[*a], &self.heard[*b]));
            match worst {
                Some(i) if order(&self.heard[i], new).is_lt() => drop(self.heard.swap_remove(i)),
                _ => return,
            }
        }
        self.heard.push(*new);
    }

    /// Forgets what is too old, and gives what is around at `now`, seen from where `state` says.
    pub(super) fn around(
        &mut self,
        state: &FlightState,
        now: Monotonic,
    ) -> [Option<Target>; TRAFFIC_SHOWN_MAX] {
        self.heard.retain(|t| {
            let age_max = match t.place {
                Place::Geodetic { .. } => GEODETIC_AGE_MAX,
                _ => RELATIVE_AGE_MAX,
            };
            now.since(t.at).is_some_and(|age| age <= age_max)
        });
        let read = |p| state.read(p, now).ok();
        self.own_place = read(P::Latitude).zip(read(P::Longitude));
        let pressure_altitude = read(P::PressureAltitude);
        let mut shown: ArrayVec<Target, TRAFFIC_HEARD_MAX> = ArrayVec::new();
        for traffic in &self.heard {
            let moved = moved_on(traffic, now);
            let Some(offset) = offset_of(&moved, self.own_place) else {
                continue;
            };
            let up_m = match traffic.place {
                Place::Geodetic {
                    pressure_altitude_m,
                    ..
                } => pressure_altitude_m
                    .zip(pressure_altitude)
                    .map(|(its, own)| its - own),
                Place::Relative { up_m, .. }
                | Place::Around { up_m, .. }
                | Place::Bearing { up_m, .. } => Some(up_m),
            };
            let near = offset.distance_m <= RANGE_MAX_M
                && up_m.is_none_or(|up| up.abs() <= UP_MAX_M)
                && traffic.airborne != Some(false);
            if near || traffic.alert > Alert::None {
                shown.push(Target {
                    address: traffic.address,
                    direction: offset.direction,
                    distance_m: offset.distance_m,
                    up_m,
                    vertical_speed_mps: traffic.vertical_speed_mps,
                    alert: traffic.alert,
                });
            }
        }
        shown.sort_unstable_by(|a, b| {
            let urgent = b.alert.cmp(&a.alert);
            urgent.then(a.distance_m.total_cmp(&b.distance_m))
        });
        std::array::from_fn(|i| shown.get(i).copied())
    }
}

/// How much a kind of place tells.
const fn kind(place: &Place) -> u8 {
    match place {
        Place::Around { .. } => 0,
        Place::Bearing { .. } => 1,
        Place::Relative { .. } => 2,
        Place::Geodetic { .. } => 3,
    }
}

struct Offset {
    direction: Direction,
    distance_m: f64,
}

/// Where it is from `own`, latitude and longitude in radians; `None` where that needs the own place and there is none.
fn offset_of(traffic: &Traffic, own: Option<(f64, f64)>) -> Option<Offset> {
    let of = |north_m: f64, east_m: f64| Offset {
        direction: Direction::True(wrap_turn(Radians(east_m.atan2(north_m)))),
        distance_m: north_m.hypot(east_m),
    };
    Some(match traffic.place {
        Place::Geodetic {
            latitude_rad,
            longitude_rad,
            ..
        } => {
            let (latitude, longitude) = own?;
            let (sin, cos) = f64::midpoint(latitude, latitude_rad).sin_cos();
            let east = shortest_turn(Radians(longitude), Radians(longitude_rad)).0;
            let north_m = (latitude_rad - latitude) * meridian_radius_m(sin);
            of(north_m, east * prime_vertical_radius_m(sin) * cos)
        }
        Place::Relative {
            north_m, east_m, ..
        } => of(north_m, east_m),
        Place::Around { distance_m, .. } => Offset {
            direction: Direction::Unknown,
            distance_m,
        },
        Place::Bearing {
            bearing_relative_rad,
            distance_m,
            ..
        } => Offset {
            direction: Direction::FromTrack(Radians(bearing_relative_rad)),
            distance_m,
        },
    })
}

/// As it is at `now`, if it has gone on as it went.
fn moved_on(traffic: &Traffic, now: Monotonic) -> Traffic {
    let mut moved = *traffic;
    if let (
        Place::Geodetic {
            latitude_rad,
            longitude_rad,
            ..
        },
        Some(track),
        Some(speed),
        Some(age),
    ) = (
        &mut moved.place,
        traffic.track_rad,
        traffic.ground_speed_mps,
        now.since(traffic.at),
    ) {
        let way = speed * age.as_secs_f64();
        let (sin, cos) = latitude_rad.sin_cos();
        *latitude_rad += way * track.cos() / meridian_radius_m(sin);
        if cos > 1e-6 {
            *longitude_rad += way * track.sin() / (prime_vertical_radius_m(sin) * cos);
        }
    }
    moved
}

#[cfg(test)]
mod tests;
