//! The model: for every field of the display a value with its label, or why there is none.

use super::air::{Absent, Air, air, height_above_ground};
use super::engine::{Engine, engine};
use super::format;
use super::notes::{Notes, Sources, notes};
use super::traffic::{Traffic, traffic};
use super::ui::{BaroSetting, BaroUnit, Config, Terrain, TerrainCaution, Ui, VSpeeds};
use crate::atmosphere::indicated_altitude;
use crate::geo::Attitude;
use crate::sampled::Invalid;
use crate::signal::Parameter as P;
use crate::state::FlightState;
use crate::time::Monotonic;
use crate::units::{
    Degrees, Feet, FeetPerMinute, Hectopascals, Knots, Metres, MetresPerSecond, Radians,
};

/// Pitch and roll.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PitchRoll {
    /// Nose up positive, -pi/2 to pi/2.
    pub pitch: Radians,
    /// Right wing down positive, -pi to pi.
    pub roll: Radians,
}

/// Slip or skid, as the ball of a turn coordinator shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slip {
    /// How far the ball stands from the middle in widths of the ball, right positive: 0.1 g moves it by one width (SAE
    /// AS6296), against the acceleration that is felt.
    pub ball_widths: f64,
}

/// Which north a heading is from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum North {
    /// Geographic.
    True,
    /// Magnetic.
    Magnetic,
}

/// A heading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Heading {
    /// 0 <= heading < 360, clockwise from its north.
    pub direction: Degrees,
    /// From which north.
    pub north: North,
    /// Whether another source of heading was heard of and is not to be had.
    pub reverted: bool,
}

/// Which airspeed it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AirspeedKind {
    /// Indicated.
    Indicated,
    /// Calibrated.
    Calibrated,
}

/// An airspeed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Airspeed {
    /// Its value, never negative.
    pub speed: Knots,
    /// Which one it is.
    pub kind: AirspeedKind,
    /// Whether a better one was heard of and is not to be had.
    pub reverted: bool,
}

/// Which altitude it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AltitudeKind {
    /// Pressure altitude corrected with the pilot's setting.
    PilotBaro,
    /// Corrected by its source with the source's setting.
    SourceBaro,
    /// Geometric, above mean sea level: no barometric altitude.
    Geometric,
}

/// An altitude.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Altitude {
    /// Its value.
    pub altitude: Feet,
    /// Which one it is.
    pub kind: AltitudeKind,
    /// Whether a better one was heard of and is not to be had.
    pub reverted: bool,
}

/// What the box of the barometric setting says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BaroBox {
    /// The pilot's setting, which is in use (or would be, when there is no altitude).
    Pilot(Hectopascals),
    /// The standard setting, chosen by the pilot.
    Standard,
    /// The setting that the source of the altitude uses, or why it is not known.
    Source(Result<Hectopascals, Invalid>),
    /// The altitude is geometric: no setting applies.
    Geometric,
}

/// The height of the eye, as it was received.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CameraHeight {
    /// Above the WGS 84 ellipsoid.
    Ellipsoid(Metres),
    /// Above mean sea level; the geoid's undulation is to be added.
    MeanSeaLevel(Metres),
}

/// What a camera for synthetic vision needs, all valid now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraInputs {
    /// Geodetic, north positive.
    pub latitude: Radians,
    /// East positive.
    pub longitude: Radians,
    /// The eye's height.
    pub height: CameraHeight,
    /// How the aircraft lies.
    pub attitude: Attitude,
}

/// Why no terrain is shown: the first thing that is missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SvsOff {
    /// Pitch or roll.
    Attitude(Invalid),
    /// True heading.
    HeadingTrue(Invalid),
    /// Latitude or longitude.
    Position(Invalid),
    /// Both heights.
    Height(Invalid),
    /// The terrain itself; never `Terrain::Ready`.
    Terrain(Terrain),
}

impl SvsOff {
    /// What the annunciation says.
    #[must_use]
    pub const fn label(self) -> &'static str {
        match self {
            Self::Attitude(_) => "NO ATTITUDE",
            Self::HeadingTrue(_) => "NO TRUE HDG",
            Self::Position(_) => "NO POSITION",
            Self::Height(_) => "NO HEIGHT",
            Self::Terrain(Terrain::Loading) => "LOADING",
            Self::Terrain(Terrain::Outside) => "OUTSIDE DATA",
            Self::Terrain(Terrain::Empty) => "EMPTY PACK",
            Self::Terrain(Terrain::NoCamera) => "BAD POSITION",
            Self::Terrain(Terrain::NoPack | Terrain::Ready) => "NO TERRAIN",
        }
    }
}

/// Everything that the display shows, for one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Pitch and roll; without them there is no horizon at all.
    pub attitude: Result<PitchRoll, Invalid>,
    /// The slip ball.
    pub slip: Result<Slip, Invalid>,
    /// True heading, else magnetic.
    pub heading: Result<Heading, Invalid>,
    /// Indicated airspeed, else calibrated.
    pub airspeed: Result<Airspeed, Invalid>,
    /// Altitude by the pilot's setting, else by the source's, else geometric.
    pub altitude: Result<Altitude, Invalid>,
    /// The setting that belongs to it.
    pub baro: BaroBox,
    /// Up positive.
    pub vertical_speed: Result<FeetPerMinute, Invalid>,
    /// Over the ground.
    pub ground_speed: Result<Knots, Invalid>,
    /// Over the ground, clockwise from true north, 0 <= track < 360.
    pub track: Result<Degrees, Invalid>,
    /// The camera of synthetic vision, or why the plain horizon is shown instead.
    pub svs: Result<CameraInputs, SvsOff>,
    /// What is to be said of the terrain, where it is shown.
    pub svs_caution: Option<TerrainCaution>,
    /// Above the ground: as received, else above the terrain that is drawn.
    pub height_above_ground: Result<Feet, Absent>,
    /// What the air does.
    pub air: Air,
    /// Other aircraft.
    pub traffic: Traffic,
    /// The engine, where one was heard.
    pub engine: Engine,
    /// What is to be said of values that are shown.
    pub notes: Notes,
    /// Limiting speeds: the installer's, and where he gives none those of a bus.
    pub v_speeds: VSpeeds,
    /// The unit of barometric settings.
    pub baro_unit: BaroUnit,
    /// Horizontal field of view of the whole picture.
    pub hfov: Radians,
}

impl Model {
    /// What the pilot is told at `now`.
    #[must_use]
    pub fn build(state: &FlightState, ui: &Ui, config: &Config, now: Monotonic) -> Self {
        let attitude = attitude(state, now);
        let altitude = altitude(state, ui, now);
        let svs = svs(attitude, state, ui, now);
        let heading = heading(state, now);
        let airspeed = airspeed(state, now);
        let shown = |parameter| match parameter {
            P::Pitch | P::Roll => attitude.is_ok(),
            P::HeadingTrue => heading.is_ok_and(|h| h.north == North::True),
            P::HeadingMagnetic => heading.is_ok_and(|h| h.north == North::Magnetic),
            P::PressureAltitude => altitude.is_ok_and(|a| a.kind == AltitudeKind::PilotBaro),
            P::BaroAltitude => altitude.is_ok_and(|a| a.kind == AltitudeKind::SourceBaro),
            P::AltitudeMsl => altitude.is_ok_and(|a| a.kind == AltitudeKind::Geometric),
            P::IndicatedAirspeed => airspeed.is_ok_and(|a| a.kind == AirspeedKind::Indicated),
            P::CalibratedAirspeed => airspeed.is_ok_and(|a| a.kind == AirspeedKind::Calibrated),
            _ => true,
        };
        Self {
            notes: notes(state, now, &Sources { ui, config }, shown),
            height_above_ground: height_above_ground(state, ui, now),
            air: air(state, now),
            traffic: traffic(state, now),
            engine: engine(state, config.baro_unit, now),
            attitude,
            slip: state.read(P::LateralAcceleration, now).map(|g| Slip {
                ball_widths: -g / 0.1,
            }),
            heading,
            airspeed,
            altitude,
            baro: baro_box(altitude, state, ui, now),
            vertical_speed: state
                .speed(P::VerticalSpeed, now)
                .map(format::feet_per_minute),
            ground_speed: state.speed(P::GroundSpeed, now).map(format::knots),
            track: state.angle(P::Track, now).map(format::direction),
            svs,
            svs_caution: ui.terrain_caution.filter(|_| svs.is_ok()),
            v_speeds: v_speeds(state, config.v_speeds),
            baro_unit: config.baro_unit,
            hfov: config.hfov,
        }
    }
}

/// The limiting speeds that a bus gives, in the order of [`VSpeeds::all`], each with its name.
pub(super) const BUS_SPEEDS: [(&str, &str); 5] = [
    ("VS0", "vs0"),
    ("VS1", "vs"),
    ("VFE", "vfe"),
    ("VNO", "vno"),
    ("VNE", "vne"),
];

/// What the installer has given stands; what he has not may come from a bus.
fn v_speeds(state: &FlightState, given: VSpeeds) -> VSpeeds {
    let mut all = given.all();
    for (speed, (_, kind)) in all.iter_mut().zip(BUS_SPEEDS) {
        *speed = speed.or_else(|| bus_speed(state, kind));
    }
    VSpeeds::from_all(all)
}

/// A limiting speed as a bus gives it.
pub(super) fn bus_speed(state: &FlightState, kind: &str) -> Option<Knots> {
    let speed = state.bounds.get(P::IndicatedAirspeed, kind)?;
    Some(format::knots(MetresPerSecond(speed)))
}

/// Of several reasons the one that the pilot should know first: disagreement, then failure, then age, then absence.
fn gravest(a: Invalid, b: Invalid) -> Invalid {
    let weight = |i| match i {
        Invalid::Miscompare => 7,
        Invalid::Implausible => 6,
        Invalid::Frozen => 5,
        Invalid::SourceFailed => 4,
        Invalid::OutOfRange => 3,
        Invalid::Doubtful => 2,
        Invalid::Stale => 1,
        Invalid::NeverReceived => 0,
    };
    if weight(b) > weight(a) { b } else { a }
}

/// Both, or the gravest reason.
fn both<A, B>(a: Result<A, Invalid>, b: Result<B, Invalid>) -> Result<(A, B), Invalid> {
    match (a, b) {
        (Ok(a), Ok(b)) => Ok((a, b)),
        (Err(a), Err(b)) => Err(gravest(a, b)),
        (Err(reason), Ok(_)) | (Ok(_), Err(reason)) => Err(reason),
    }
}

/// The first choice that is valid, with its place in the list. Two sources that disagree end the search: a fallback would
/// hide the disagreement.
fn first_valid<T>(
    choices: impl IntoIterator<Item = Result<T, Invalid>>,
) -> Result<(T, bool), Invalid> {
    let mut reason = Invalid::NeverReceived;
    for choice in choices {
        match choice {
            Ok(value) => return Ok((value, reason != Invalid::NeverReceived)),
            Err(Invalid::Miscompare) => return Err(Invalid::Miscompare),
            Err(other) => reason = gravest(reason, other),
        }
    }
    Err(reason)
}

fn attitude(state: &FlightState, now: Monotonic) -> Result<PitchRoll, Invalid> {
    both(state.angle(P::Pitch, now), state.angle(P::Roll, now))
        .map(|(pitch, roll)| PitchRoll { pitch, roll })
}

fn heading(state: &FlightState, now: Monotonic) -> Result<Heading, Invalid> {
    // What was turned from one north to the other is for the camera: the pilot sees the heading that a source gives.
    let from = |parameter, north| {
        if state.is_derived(parameter) {
            return Err(Invalid::NeverReceived);
        }
        state.angle(parameter, now).map(|angle| (angle, north))
    };
    let ((angle, north), reverted) = first_valid([
        from(P::HeadingTrue, North::True),
        from(P::HeadingMagnetic, North::Magnetic),
    ])?;
    Ok(Heading {
        direction: format::direction(angle),
        north,
        reverted,
    })
}

fn airspeed(state: &FlightState, now: Monotonic) -> Result<Airspeed, Invalid> {
    let from = |parameter, kind| state.speed(parameter, now).map(|speed| (speed, kind));
    let ((speed, kind), reverted) = first_valid([
        from(P::IndicatedAirspeed, AirspeedKind::Indicated),
        from(P::CalibratedAirspeed, AirspeedKind::Calibrated),
    ])?;
    Ok(Airspeed {
        speed: format::knots(speed),
        kind,
        reverted,
    })
}

/// The setting in use.
fn setting(ui: &Ui) -> Hectopascals {
    if ui.baro_standard {
        BaroSetting::STANDARD.pressure()
    } else {
        ui.baro.pressure()
    }
}

fn altitude(state: &FlightState, ui: &Ui, now: Monotonic) -> Result<Altitude, Invalid> {
    let from = |parameter, kind| state.height(parameter, now).map(|height| (height, kind));
    let ((height, kind), reverted) = first_valid([
        from(P::PressureAltitude, AltitudeKind::PilotBaro)
            .map(|(height, kind)| (indicated_altitude(height, setting(ui)), kind)),
        from(P::BaroAltitude, AltitudeKind::SourceBaro),
        from(P::AltitudeMsl, AltitudeKind::Geometric),
    ])?;
    Ok(Altitude {
        altitude: format::feet(height),
        kind,
        reverted,
    })
}

fn baro_box(
    altitude: Result<Altitude, Invalid>,
    state: &FlightState,
    ui: &Ui,
    now: Monotonic,
) -> BaroBox {
    match altitude.map(|a| a.kind) {
        Ok(AltitudeKind::SourceBaro) => {
            BaroBox::Source(state.read(P::BaroSetting, now).map(Hectopascals))
        }
        Ok(AltitudeKind::Geometric) => BaroBox::Geometric,
        Ok(AltitudeKind::PilotBaro) | Err(_) if ui.baro_standard => BaroBox::Standard,
        Ok(AltitudeKind::PilotBaro) | Err(_) => BaroBox::Pilot(ui.baro.pressure()),
    }
}

fn svs(
    attitude: Result<PitchRoll, Invalid>,
    state: &FlightState,
    ui: &Ui,
    now: Monotonic,
) -> Result<CameraInputs, SvsOff> {
    let PitchRoll { pitch, roll } = attitude.map_err(SvsOff::Attitude)?;
    let heading_true = state
        .angle(P::HeadingTrue, now)
        .map_err(SvsOff::HeadingTrue)?;
    let (latitude, longitude) = both(
        state.angle(P::Latitude, now),
        state.angle(P::Longitude, now),
    )
    .map_err(SvsOff::Position)?;
    let (height, _) = first_valid([
        state
            .height(P::HeightEllipsoid, now)
            .map(CameraHeight::Ellipsoid),
        state
            .height(P::AltitudeMsl, now)
            .map(CameraHeight::MeanSeaLevel),
    ])
    .map_err(SvsOff::Height)?;
    if ui.terrain != Terrain::Ready {
        return Err(SvsOff::Terrain(ui.terrain));
    }
    Ok(CameraInputs {
        latitude,
        longitude,
        height,
        attitude: Attitude {
            heading_true,
            pitch,
            roll,
        },
    })
}

#[cfg(test)]
mod tests;
