//! Other aircraft, as the pilot is told of them.
//!
//! Symbols follow what pilots know from TCAS II (FAA "Introduction to TCAS II", version 7.1, 2011, "Traffic display
//! symbology"): other traffic an open diamond; proximate, within 6 NM and 1200 ft, a filled one; a traffic alert a filled
//! amber circle; relative altitude in hundreds of feet with its sign; an arrow beside it from 500 ft/min on. FLARM's
//! greatest alarm, at most 8 s ahead, is a filled red square.

use crate::angle::{shortest_turn, wrap_signed};
use crate::geo::{meridian_radius_m, prime_vertical_radius_m};
use crate::sampled::Invalid;
use crate::signal::{Alert, Parameter as P};
use crate::state::FlightState;
use crate::state::traffic::{Direction, Feed, Target};
use crate::time::Monotonic;
use crate::units::{Feet, FeetPerMinute, Metres, MetresPerSecond, Radians};
use arrayvec::ArrayVec;

/// Lines in the list.
pub const CONTACTS_MAX: usize = 4;
/// Symbols in the view.
pub const SIGHTS_MAX: usize = crate::limits::TRAFFIC_SHOWN_MAX;
/// m.
const NAUTICAL_MILE_M: f64 = 1852.0;
const PROXIMATE_NM: f64 = 6.0;
const PROXIMATE_FT: f64 = 1200.0;
/// From here on a climb or descent is told, ft/min.
const TREND_FPM: f64 = 500.0;

/// How much an aircraft matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Urgency {
    /// Not near.
    Other,
    /// Near, and no more.
    Proximate,
    /// The receiver warns of it.
    Caution,
    /// The receiver warns of it most urgently.
    Warning,
}

/// Whether it climbs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trend {
    /// At 500 ft/min or more.
    Climbing,
    /// Less than that either way, or not known.
    Level,
    /// At 500 ft/min or more.
    Descending,
}

/// One other aircraft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Clockwise from the nose, -pi to pi; `None` where not known.
    pub bearing: Option<Radians>,
    /// Nautical miles.
    pub distance_nm: f64,
    /// How much higher it is; `None` where not known.
    pub above: Option<Feet>,
    /// Whether it climbs.
    pub trend: Trend,
    /// How much it matters.
    pub urgency: Urgency,
}

/// Where another aircraft is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    /// Clockwise from the nose over the ground, -pi to pi.
    pub azimuth: Radians,
    /// Above the horizontal.
    pub elevation: Radians,
    /// Which it is.
    pub contact: Contact,
}

/// What is told of other aircraft.
#[expect(
    clippy::large_enum_variant,
    reason = "one in a picture, which is made without allocating"
)]
#[derive(Clone, Debug, PartialEq)]
pub enum Traffic {
    /// Nothing: nobody would tell.
    Nobody,
    /// Whoever would tell is silent.
    NoData,
    /// These, the most urgent first, then the nearest.
    Contacts {
        /// For the list.
        list: ArrayVec<Contact, CONTACTS_MAX>,
        /// Those that have a place in the view.
        sights: ArrayVec<Sight, SIGHTS_MAX>,
    },
}

pub(super) fn traffic(state: &FlightState, now: Monotonic) -> Traffic {
    let targets = || state.around.targets.iter().flatten();
    match state.around.feed {
        Feed::None => return Traffic::Nobody,
        // What was heard last is shown for its own time.
        Feed::Silent if targets().next().is_none() => return Traffic::NoData,
        Feed::Silent | Feed::Live => {}
    }
    let nose = Nose {
        heading: state.angle(P::HeadingTrue, now),
        track: state.angle(P::Track, now),
        latitude: state.angle(P::Latitude, now),
    };
    Traffic::Contacts {
        list: targets()
            .take(CONTACTS_MAX)
            .map(|t| nose.contact(t))
            .collect(),
        sights: targets().filter_map(|t| nose.sight(t)).collect(),
    }
}

struct Nose {
    heading: Result<Radians, Invalid>,
    track: Result<Radians, Invalid>,
    latitude: Result<Radians, Invalid>,
}

impl Nose {
    /// Clockwise from the nose: from the true heading, or in straight flight without one from the track.
    fn bearing(&self, direction: Direction) -> Option<Radians> {
        let nose = self.heading.or(self.track);
        match direction {
            Direction::True(direction) => Some(shortest_turn(nose.ok()?, direction)),
            Direction::FromTrack(bearing) => {
                let (Ok(heading), Ok(track)) = (self.heading, self.track) else {
                    return Some(bearing);
                };
                Some(wrap_signed(Radians(
                    bearing.0 + shortest_turn(heading, track).0,
                )))
            }
            Direction::Unknown => None,
        }
    }

    fn contact(&self, target: &Target) -> Contact {
        let distance_nm = target.distance_m / NAUTICAL_MILE_M;
        let above = target.up_m.map(|up| Feet::from(Metres(up)));
        let climb = target
            .vertical_speed_mps
            .map(|v| FeetPerMinute::from(MetresPerSecond(v)).0);
        let near = distance_nm <= PROXIMATE_NM && above.is_some_and(|a| a.0.abs() <= PROXIMATE_FT);
        Contact {
            bearing: self.bearing(target.direction),
            distance_nm,
            above,
            trend: match climb {
                Some(fpm) if fpm >= TREND_FPM => Trend::Climbing,
                Some(fpm) if fpm <= -TREND_FPM => Trend::Descending,
                _ => Trend::Level,
            },
            urgency: match target.alert {
                Alert::Urgent => Urgency::Warning,
                Alert::Low | Alert::Important => Urgency::Caution,
                Alert::None if near => Urgency::Proximate,
                Alert::None => Urgency::Other,
            },
        }
    }

    /// Its true place in the view: only from a true heading, and where its height is known too.
    fn sight(&self, target: &Target) -> Option<Sight> {
        self.heading.ok()?;
        let azimuth = self.bearing(target.direction)?;
        let up_m = target.up_m.filter(|_| target.distance_m > 1.0)?;
        let sin = self.latitude.map_or(0.7, |latitude| latitude.0.sin());
        let radius_m = f64::midpoint(meridian_radius_m(sin), prime_vertical_radius_m(sin));
        // Level flight far away is below the horizontal here, since the Earth is round.
        let up_m = up_m - target.distance_m * target.distance_m / (2.0 * radius_m);
        Some(Sight {
            azimuth,
            elevation: Radians(up_m.atan2(target.distance_m)),
            contact: self.contact(target),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampled::Sampled;
    use crate::signal::SourceId;

    const NOW: Monotonic = Monotonic::from_nanos(10_000_000_000);

    fn state(heading_deg: Option<f64>, track_deg: f64) -> FlightState {
        let mut state = FlightState::empty();
        let mut set = |p, degrees: f64| {
            state.set(p, Sampled::good(degrees.to_radians(), NOW), SourceId(0));
        };
        if let Some(heading) = heading_deg {
            set(P::HeadingTrue, heading);
        }
        set(P::Track, track_deg);
        state.around.feed = Feed::Live;
        state
    }

    fn target(direction: Direction) -> Target {
        Target {
            address: None,
            direction,
            distance_m: 3704.0,
            up_m: Some(304.8),
            vertical_speed_mps: Some(3.0),
            alert: Alert::None,
        }
    }

    fn only(state: &FlightState) -> (Contact, Option<Sight>) {
        match traffic(state, NOW) {
            Traffic::Contacts { list, sights } => (list[0], sights.first().copied()),
            other => unreachable!("{other:?}"),
        }
    }

    #[test]
    fn bearings_are_from_the_nose() {
        let east = Direction::True(Radians::from_degrees(90.0));
        let ahead = Direction::FromTrack(Radians(0.0));
        for (heading, track, direction, expected) in [
            (Some(60.0), 80.0, east, 30.0),
            (None, 80.0, east, 10.0),
            (Some(350.0), 10.0, ahead, 20.0),
            (None, 10.0, ahead, 0.0),
        ] {
            let mut state = state(heading, track);
            state.around.targets[0] = Some(target(direction));
            let (contact, sight) = only(&state);
            let bearing = contact.bearing.unwrap_or(Radians(9.0)).to_degrees();
            assert!(
                (bearing - expected).abs() < 1e-9,
                "{heading:?} {track}: {bearing}"
            );
            assert_eq!(
                sight.is_some(),
                heading.is_some(),
                "no place without a heading"
            );
        }
    }

    #[test]
    fn a_contact_tells_distance_height_trend_and_urgency() {
        let mut state = state(Some(0.0), 0.0);
        let ahead = target(Direction::True(Radians(0.0)));
        state.around.targets[0] = Some(ahead);
        let (contact, sight) = only(&state);
        assert!((contact.distance_nm - 2.0).abs() < 1e-9, "{contact:?}");
        assert!(
            contact.above.is_some_and(|a| (a.0 - 1000.0).abs() < 1e-6),
            "{contact:?}"
        );
        assert_eq!(
            (contact.trend, contact.urgency),
            (Trend::Climbing, Urgency::Proximate)
        );
        // 304.8 m up at 3704 m, less 1.1 m of curvature: 4.688 degrees.
        let elevation = sight.map_or(f64::NAN, |s| s.elevation.to_degrees());
        assert!((elevation - 4.688).abs() < 0.002, "{elevation}");
        for (alert, urgency) in [
            (Alert::Low, Urgency::Caution),
            (Alert::Important, Urgency::Caution),
            (Alert::Urgent, Urgency::Warning),
        ] {
            state.around.targets[0] = Some(Target { alert, ..ahead });
            assert_eq!(only(&state).0.urgency, urgency);
        }
        let unknown = Target {
            up_m: None,
            vertical_speed_mps: None,
            ..ahead
        };
        state.around.targets[0] = Some(unknown);
        let (contact, sight) = only(&state);
        assert_eq!((contact.above, contact.urgency), (None, Urgency::Other));
        assert_eq!(sight, None, "no place without a height");
    }

    #[test]
    fn silence_is_told_once_what_was_heard_has_aged_out() {
        let mut state = state(Some(0.0), 0.0);
        state.around.feed = Feed::None;
        assert_eq!(traffic(&state, NOW), Traffic::Nobody);
        state.around.feed = Feed::Silent;
        assert_eq!(traffic(&state, NOW), Traffic::NoData);
        state.around.targets[0] = Some(target(Direction::Unknown));
        assert_eq!(only(&state).0.bearing, None);
    }
}
