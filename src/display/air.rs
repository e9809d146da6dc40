//! Values that may have to be worked out: what the air does, and the height above the ground. Where one is not to be had,
//! the input that is missing is named.

use super::format;
use super::ui::{Terrain, Ui};
use crate::angle::shortest_turn;
use crate::sampled::Invalid;
use crate::signal::Parameter as P;
use crate::state::FlightState;
use crate::time::Monotonic;
use crate::units::{Degrees, Feet, Knots, Metres, MetresPerSecond, Radians};

/// Why there is no value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Absent {
    /// What is missing, as on the instruments: `OAT`, `POS`.
    pub input: &'static str,
    /// Why it is missing.
    pub reason: Invalid,
}

/// The wind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wind {
    /// Its speed.
    pub speed: Knots,
    /// Where it comes from, clockwise from true north, 0 <= direction < 360.
    pub from: Degrees,
    /// Where it blows to, clockwise from the nose, -180 to 180; `None` without a true heading.
    pub blows_to: Option<Degrees>,
}

/// What the air does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Air {
    /// True airspeed.
    pub true_airspeed: Result<Knots, Absent>,
    /// Static air temperature, degrees Celsius.
    pub temperature_c: Result<f64, Absent>,
    /// Density altitude.
    pub density_altitude: Result<Feet, Absent>,
    /// Wind.
    pub wind: Result<Wind, Absent>,
}

/// Below this a wind has no direction worth an arrow, kt.
const WIND_KT_MIN: f64 = 1.0;

/// The numbers of the air around, at `now`.
#[must_use]
pub fn air(state: &FlightState, now: Monotonic) -> Air {
    let number = |p| read(state, p, now);
    let wind = || {
        let (speed, from) = (number(P::WindSpeed)?, number(P::WindDirectionTrue)?);
        let speed = format::knots(MetresPerSecond(speed));
        let heading = state.angle(P::HeadingTrue, now).ok();
        let to = Radians(from + std::f64::consts::PI);
        let blows_to = heading.map(|heading| shortest_turn(heading, to).into());
        Ok(Wind {
            speed,
            from: format::direction(Radians(from)),
            blows_to: blows_to.filter(|_| speed.0 >= WIND_KT_MIN),
        })
    };
    Air {
        true_airspeed: number(P::TrueAirspeed).map(|v| format::knots(MetresPerSecond(v))),
        temperature_c: number(P::StaticAirTemperature).map(|t| t - 273.15),
        density_altitude: number(P::DensityAltitude).map(|h| format::feet(Metres(h))),
        wind: wind(),
    }
}

/// Height above the ground: as received, else above the terrain that is drawn.
///
/// # Errors
/// The input that is missing.
pub fn height_above_ground(state: &FlightState, ui: &Ui, now: Monotonic) -> Result<Feet, Absent> {
    let received = read(state, P::HeightAgl, now).map(Metres);
    let height = received.or_else(|why| match ui.height_above_ground {
        Some(height) => Ok(height),
        None if why.input == "GROUND" => Err(Absent {
            reason: match ui.terrain {
                Terrain::NoPack | Terrain::Loading => Invalid::NeverReceived,
                _ => Invalid::Doubtful,
            },
            ..why
        }),
        None => Err(why),
    });
    height.map(format::feet)
}

/// A value, or what is missing for it.
fn read(state: &FlightState, parameter: P, now: Monotonic) -> Result<f64, Absent> {
    state
        .read(parameter, now)
        .map_err(|reason| match state.missing(parameter) {
            Some(missing) => Absent {
                input: label(missing.input),
                reason: missing.reason,
            },
            None => Absent {
                input: label(parameter),
                reason,
            },
        })
}

/// What an input is called on the display.
const fn label(input: P) -> &'static str {
    match input {
        P::IndicatedAirspeed | P::CalibratedAirspeed => "IAS",
        P::TrueAirspeed => "TAS",
        P::PressureAltitude | P::BaroAltitude => "ALT",
        P::StaticAirTemperature => "OAT",
        P::DensityAltitude => "DA",
        P::HeadingTrue | P::HeadingMagnetic => "HDG",
        P::GroundSpeed => "GS",
        P::Track | P::TrackMagnetic => "TRK",
        P::Latitude | P::Longitude => "POS",
        P::HeightEllipsoid | P::AltitudeMsl => "GPS ALT",
        P::MagneticVariation => "VAR",
        P::UtcDate => "DATE",
        P::HeightAgl => "GROUND",
        P::WindSpeed | P::WindDirectionTrue => "WIND",
        P::Pitch | P::Roll => "ATT",
        P::YawRate | P::PitchRate | P::RollRate => "RATES",
        _ => "DATA",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampled::Sampled;
    use crate::signal::SourceId;

    const NOW: Monotonic = Monotonic::from_nanos(10_000_000_000);

    #[test]
    fn a_headwind_blows_down_and_from_the_right_to_the_left() {
        let mut state = FlightState::empty();
        let mut wind = |heading: f64, from: f64| {
            for (p, value) in [
                (P::WindSpeed, 10.0),
                (P::WindDirectionTrue, from.to_radians()),
                (P::HeadingTrue, heading.to_radians()),
            ] {
                state.set(p, Sampled::good(value, NOW), SourceId(0));
            }
            let wind = air(&state, NOW)
                .wind
                .unwrap_or_else(|e| unreachable!("{e:?}"));
            wind.blows_to.unwrap_or(Degrees(f64::NAN)).0
        };
        assert!(
            (wind(350.0, 350.0).abs() - 180.0).abs() < 1e-9,
            "from ahead"
        );
        assert!((wind(350.0, 80.0) + 90.0).abs() < 1e-9, "from the right");
        assert!((wind(10.0, 280.0) - 90.0).abs() < 1e-9, "from the left");
    }
}
