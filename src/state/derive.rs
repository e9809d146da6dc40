//! What nobody has said but follows from what was said: worked out only where no source gives it, and only from values that
//! may be shown themselves. Where it cannot be worked out, the state names the input that is missing
//! ([`FlightState::missing`]).
//!
//! | value | from | by |
//! |---|---|---|
//! | true airspeed | calibrated (else indicated) airspeed, pressure altitude, air temperature | compressible flow: [`atmosphere::true_airspeed`] |
//! | density altitude | pressure altitude, air temperature | [`atmosphere::density_altitude`] |
//! | track | magnetic track and variation; else positions of the last 2 s | great circle over their short distance, above 5 m/s |
//! | turn rate | body rates, pitch, roll | `(q sin(roll) + r cos(roll)) / cos(pitch)` (Titterton and Weston 2004, equation 3.52) |
//! | vertical speed | pressure altitudes of the last 2 s | straight line through them by least squares; in standard air, as any variometer |
//! | magnetic variation | position, date | World Magnetic Model: [`magnetic`] |
//! | true, magnetic heading | the other one and the variation | true = magnetic + variation, east positive |
//! | height above the ground | position, geometric height, terrain | the eye's height less that of the terrain under it, both above the ellipsoid; done where the terrain is (`app::cockpit`) |
//! | wind | true airspeed, true heading, ground speed, track | velocity over the ground less that through the air, which is taken to be along the heading (no sideslip) |
//!
//! A derived value has the time of receipt of the input named first above that is not a constant of the day.

use super::magnetic::{self, NoVariation};
use super::snapshot::{FlightState, Missing};
use super::trail::Trail;
use crate::angle::wrap_turn;
use crate::atmosphere;
use crate::geo::{Geodetic, meridian_radius_m, prime_vertical_radius_m};
use crate::sampled::{Invalid, Sampled};
use crate::signal::{Parameter as P, SourceId};
use crate::time::Monotonic;
use crate::units::{Kelvin, Metres, MetresPerSecond, Radians};
use std::time::Duration;

/// Motion is judged over this time, and over no less than half of it.
const WINDOW: Duration = Duration::from_secs(2);
/// Below this a direction of motion is noise.
const TRACK_MPS_MIN: f64 = 5.0;
/// Nearer to the pole than this there is no direction.
const COS_LATITUDE_MIN: f64 = 1e-6;

/// Works values out. Remembers a few seconds of position and altitude.
#[derive(Clone, Debug)]
pub(super) struct Deriver {
    positions: Trail<(f64, f64)>,
    positions_of: Option<SourceId>,
    altitudes: Trail<f64>,
    altitudes_of: Option<SourceId>,
}

impl Deriver {
    pub(super) fn new() -> Self {
        Self {
            positions: Trail::new(),
            positions_of: None,
            altitudes: Trail::new(),
            altitudes_of: None,
        }
    }

    /// Adds to `state` whatever follows from it at `now`.
    pub(super) fn step(&mut self, state: &mut FlightState, now: Monotonic) {
        self.remember(state, now);
        // In this order: later ones use earlier ones.
        fill(state, now, P::MagneticVariation, variation);
        fill(state, now, P::HeadingTrue, |s| {
            turned(s, P::HeadingMagnetic, 1.0)
        });
        fill(state, now, P::HeadingMagnetic, |s| {
            turned(s, P::HeadingTrue, -1.0)
        });
        fill(state, now, P::Track, |s| {
            turned(s, P::TrackMagnetic, 1.0).or_else(|_| self.track())
        });
        fill(state, now, P::TrackMagnetic, |s| turned(s, P::Track, -1.0));
        fill(state, now, P::TurnRate, turn_rate);
        fill(state, now, P::VerticalSpeed, |s| {
            s.get(P::PressureAltitude)?;
            self.vertical_speed()
        });
        fill(state, now, P::TrueAirspeed, true_airspeed);
        fill(state, now, P::DensityAltitude, density_altitude);
        fill(state, now, P::HeightAgl, height_above_ground);
        fill(state, now, P::WindSpeed, |s| {
            wind(s).map(|(speed, _, at)| (speed, at))
        });
        fill(state, now, P::WindDirectionTrue, |s| {
            wind(s).map(|(_, from, at)| (from, at))
        });
    }

    fn remember(&mut self, state: &FlightState, now: Monotonic) {
        let inputs = Inputs { state, now };
        let source = state.source(P::Latitude);
        let place = inputs.get(P::Latitude).and_then(|(latitude, at)| {
            let (longitude, _) = inputs.get(P::Longitude)?;
            Ok(((latitude, longitude), at))
        });
        follow(&mut self.positions, &mut self.positions_of, place, source);
        let source = state.source(P::PressureAltitude);
        let altitude = inputs.get(P::PressureAltitude);
        follow(
            &mut self.altitudes,
            &mut self.altitudes_of,
            altitude,
            source,
        );
    }

    /// Direction of motion from the first to the last of the positions.
    fn track(&self) -> Answer {
        let recent = self.positions.within(WINDOW);
        let ((Some((from_at, from)), Some((at, to))), true) =
            ((recent.first(), recent.last()), recent.len() >= 2)
        else {
            return Err(missing(P::Latitude, Invalid::NeverReceived));
        };
        let dt = at.since(*from_at).unwrap_or_default();
        if dt < WINDOW / 2 {
            return Err(missing(P::Latitude, Invalid::NeverReceived));
        }
        let middle = f64::midpoint(from.0, to.0);
        let (sin, cos) = middle.sin_cos();
        if cos < COS_LATITUDE_MIN {
            return Err(missing(P::Latitude, Invalid::OutOfRange));
        }
        let north_m = (to.0 - from.0) * meridian_radius_m(sin);
        let east = crate::angle::shortest_turn(Radians(from.1), Radians(to.1)).0;
        let east_m = east * prime_vertical_radius_m(sin) * cos;
        if north_m.hypot(east_m) < TRACK_MPS_MIN * dt.as_secs_f64() {
            return Err(missing(P::Latitude, Invalid::OutOfRange));
        }
        Ok((wrap_turn(Radians(east_m.atan2(north_m))).0, *at))
    }

    /// Slope of the altitudes by least squares.
    fn vertical_speed(&self) -> Answer {
        let recent = self.altitudes.within(WINDOW);
        let unknown = missing(P::PressureAltitude, Invalid::NeverReceived);
        let (Some((first, _)), Some((last, _))) = (recent.first(), recent.last()) else {
            return Err(unknown);
        };
        if recent.len() < 3 || last.since(*first).unwrap_or_default() < WINDOW / 2 {
            return Err(unknown);
        }
        let t = |at: &Monotonic| at.since(*first).unwrap_or_default().as_secs_f64();
        #[expect(clippy::cast_precision_loss, reason = "a dozen")]
        let n = recent.len() as f64;
        let t_mean = recent.iter().map(|(at, _)| t(at)).sum::<f64>() / n;
        let h_mean = recent.iter().map(|(_, h)| h).sum::<f64>() / n;
        let (mut above, mut below) = (0.0, 0.0);
        for (at, h) in recent {
            above += (t(at) - t_mean) * (h - h_mean);
            below += (t(at) - t_mean) * (t(at) - t_mean);
        }
        Ok((above / below, *last))
    }
}

/// Keeps what one source says, from the beginning when it is another one.
fn follow<T: Copy>(
    trail: &mut Trail<T>,
    of: &mut Option<SourceId>,
    value: Result<(T, Monotonic), Missing>,
    source: Option<SourceId>,
) {
    if value.is_err() || *of != source {
        trail.forget();
        *of = source;
    }
    if let Ok((value, at)) = value {
        trail.keep(value, at);
    }
}

/// A value with its time, or what is missing for it.
type Answer = Result<(f64, Monotonic), Missing>;

const fn missing(input: P, reason: Invalid) -> Missing {
    Missing { input, reason }
}

/// The state as formulas see it.
struct Inputs<'a> {
    state: &'a FlightState,
    now: Monotonic,
}

impl Inputs<'_> {
    fn get(&self, input: P) -> Answer {
        let value = self.state.read(input, self.now);
        let value = value.map_err(|reason| missing(input, reason))?;
        let at = self.state.at(input).unwrap_or(self.now);
        Ok((value, at))
    }
}

/// Gives `parameter` what `formula` says, if it is not there already and the formula has an answer within its range.
fn fill(
    state: &mut FlightState,
    now: Monotonic,
    parameter: P,
    formula: impl FnOnce(&Inputs<'_>) -> Answer,
) {
    if state.read(parameter, now).is_ok() {
        return;
    }
    // A source that has spoken and failed is not talked over where it would hide a contradiction.
    if let Err(reason @ (Invalid::Miscompare | Invalid::Implausible)) = state.read(parameter, now) {
        state.set_missing(parameter, missing(parameter, reason));
        return;
    }
    let answer = formula(&Inputs { state, now });
    match answer.map(|(value, at)| (parameter.check(value), at)) {
        Ok((Ok(value), at)) => state.set_derived(parameter, Sampled::good(value, at)),
        Ok((Err(reason), _)) => state.set_missing(parameter, missing(parameter, reason)),
        Err(missing) => state.set_missing(parameter, missing),
    }
}

fn variation(inputs: &Inputs<'_>) -> Answer {
    let (latitude, at) = inputs.get(P::Latitude)?;
    let (longitude, _) = inputs.get(P::Longitude)?;
    let (days, _) = inputs.get(P::UtcDate)?;
    // Ten kilometres of height change the variation by less than a tenth of a degree: any height will do.
    let height = inputs
        .get(P::HeightEllipsoid)
        .or_else(|_| inputs.get(P::AltitudeMsl))
        .map_or(0.0, |(height, _)| height);
    let place = Geodetic {
        latitude: Radians(latitude),
        longitude: Radians(longitude),
        height_ellipsoid: Metres(height),
    };
    match magnetic::variation(&place, magnetic::decimal_year(days)) {
        Ok(variation) => Ok((variation.0, at)),
        Err(NoVariation::Date) => Err(missing(P::UtcDate, Invalid::OutOfRange)),
        Err(NoVariation::Place | NoVariation::Blackout) => {
            Err(missing(P::Latitude, Invalid::OutOfRange))
        }
    }
}

/// A direction from the other north; `sign` 1 from magnetic to true.
fn turned(inputs: &Inputs<'_>, other: P, sign: f64) -> Answer {
    let (direction, at) = inputs.get(other)?;
    // From what was worked out itself nothing new follows.
    if inputs.state.is_derived(other) && other != P::Track {
        return Err(missing(other, Invalid::NeverReceived));
    }
    let (variation, _) = inputs.get(P::MagneticVariation).map_err(|itself| {
        let why = inputs.state.missing(P::MagneticVariation);
        why.unwrap_or(itself)
    })?;
    Ok((wrap_turn(Radians(direction + sign * variation)).0, at))
}

fn turn_rate(inputs: &Inputs<'_>) -> Answer {
    let (yaw_rate, at) = inputs.get(P::YawRate)?;
    let (pitch_rate, _) = inputs.get(P::PitchRate)?;
    let (roll, _) = inputs.get(P::Roll)?;
    let (pitch, _) = inputs.get(P::Pitch)?;
    let (sin, cos) = roll.sin_cos();
    // At the vertical it is beyond any range and refused there.
    Ok(((pitch_rate * sin + yaw_rate * cos) / pitch.cos(), at))
}

fn true_airspeed(inputs: &Inputs<'_>) -> Answer {
    let (speed, at) = inputs
        .get(P::CalibratedAirspeed)
        .or_else(|_| inputs.get(P::IndicatedAirspeed))?;
    let (altitude, _) = inputs.get(P::PressureAltitude)?;
    let (temperature, _) = inputs.get(P::StaticAirTemperature)?;
    let pressure = atmosphere::pressure_at(Metres(altitude));
    let speed = atmosphere::true_airspeed(MetresPerSecond(speed), pressure, Kelvin(temperature));
    Ok((speed.0, at))
}

fn density_altitude(inputs: &Inputs<'_>) -> Answer {
    let (altitude, at) = inputs.get(P::PressureAltitude)?;
    let (temperature, _) = inputs.get(P::StaticAirTemperature)?;
    let pressure = atmosphere::pressure_at(Metres(altitude));
    let density = atmosphere::density_altitude(pressure, Kelvin(temperature));
    Ok((density.0, at))
}

/// The ground is known only where terrain is drawn, which is no state: here it is only said what else would be missing.
fn height_above_ground(inputs: &Inputs<'_>) -> Answer {
    inputs.get(P::Latitude)?;
    inputs.get(P::Longitude)?;
    inputs
        .get(P::HeightEllipsoid)
        .or_else(|_| inputs.get(P::AltitudeMsl))?;
    Err(missing(P::HeightAgl, Invalid::NeverReceived))
}

/// The wind that follows from how the aircraft moves through the air and over the ground: speed, m/s, and the direction from
/// true north that it comes from, rad; whatever any source says of it.
pub(super) fn wind_now(state: &FlightState, now: Monotonic) -> Option<(f64, f64)> {
    let (speed, from, _) = wind(&Inputs { state, now }).ok()?;
    Some((speed, from))
}

/// Speed, direction it comes from, and time.
fn wind(inputs: &Inputs<'_>) -> Result<(f64, f64, Monotonic), Missing> {
    let through = |p: P| {
        inputs
            .get(p)
            .map_err(|itself| inputs.state.missing(p).unwrap_or(itself))
    };
    let (airspeed, at) = through(P::TrueAirspeed)?;
    let (heading, _) = through(P::HeadingTrue)?;
    let (ground_speed, _) = inputs.get(P::GroundSpeed)?;
    let (track, _) = through(P::Track)?;
    let north = ground_speed * track.cos() - airspeed * heading.cos();
    let east = ground_speed * track.sin() - airspeed * heading.sin();
    let from = wrap_turn(Radians((-east).atan2(-north))).0;
    Ok((north.hypot(east), from, at))
}

#[cfg(test)]
mod tests;
