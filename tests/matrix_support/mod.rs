//! A flight of which everything is known, flown through an encoder, faults, a decoder and the state; pure, on a clock of its
//! own.

pub(crate) mod flight;
pub(crate) mod table;

use flight::Flight;
use glasswing::bench::fault::{Fault, Kind};
use glasswing::bench::{Bench, Truth, encode};
use glasswing::proto::Protocol;
use glasswing::sampled::Invalid;
use glasswing::signal::{Frame, Parameter, Signal, SourceId};
use glasswing::state::{FlightState, Fusion, frozen, jump, relation};
use glasswing::time::Monotonic;
use std::time::Duration;

/// A picture is made so often: 20 a second, the slowest that still counts as flying.
pub(crate) const FRAME: Duration = Duration::from_millis(50);

/// The slowest message comes once a second, and not all of them at once.
const SLOWEST: Duration = Duration::from_millis(1500);

/// What a pilot is shown, and what that is made from.
pub(crate) const SHOWN: [Parameter; 26] = [
    Parameter::Pitch,
    Parameter::Roll,
    Parameter::HeadingTrue,
    Parameter::HeadingMagnetic,
    Parameter::IndicatedAirspeed,
    Parameter::CalibratedAirspeed,
    Parameter::TrueAirspeed,
    Parameter::PressureAltitude,
    Parameter::BaroAltitude,
    Parameter::AltitudeMsl,
    Parameter::HeightEllipsoid,
    Parameter::HeightAgl,
    Parameter::DensityAltitude,
    Parameter::VerticalSpeed,
    Parameter::LateralAcceleration,
    Parameter::SlipBall,
    Parameter::TurnRate,
    Parameter::Latitude,
    Parameter::Longitude,
    Parameter::GroundSpeed,
    Parameter::Track,
    Parameter::TrackMagnetic,
    Parameter::BaroSetting,
    Parameter::StaticAirTemperature,
    Parameter::WindSpeed,
    Parameter::WindDirectionTrue,
];

/// What goes wrong, whether with one sensor or with the whole box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Trouble {
    pub(crate) name: &'static str,
    pub(crate) kind: Kind,
    pub(crate) is_whole: bool,
    /// When it begins and how long it lasts: as long as finding it takes.
    pub(crate) begin_s: u64,
    pub(crate) lasts_s: u64,
}

const fn trouble(
    name: &'static str,
    kind: Kind,
    is_whole: bool,
    begin_s: u64,
    lasts_s: u64,
) -> Trouble {
    Trouble {
        name,
        kind,
        is_whole,
        begin_s,
        lasts_s,
    }
}

/// Every fault of the matrix.
pub(crate) const TROUBLES: [Trouble; 9] = [
    trouble("lost and back", Kind::Stop, true, 4, 8),
    trouble("stop", Kind::Stop, false, 4, 8),
    trouble("source frozen", Kind::Freeze, true, 13, 12),
    trouble("sensor frozen", Kind::Freeze, false, 13, 95),
    trouble("sentinel", Kind::Sentinel, false, 4, 3),
    trouble("NaN", Kind::Nan, false, 4, 3),
    trouble("out of range", Kind::OutOfRange, false, 4, 3),
    trouble("jump", Kind::Jump, false, 4, 5),
    trouble("bit flips", Kind::BitFlips, true, 4, 15),
];

/// Frames that change places; apart, since none of their values is wrong.
pub(crate) const REORDERING: Trouble = trouble("reordering", Kind::Reordering, true, 4, 10);

impl Trouble {
    /// Whether one sensor stops alone.
    const fn is_lone_freeze(self) -> bool {
        matches!(self.kind, Kind::Freeze) && !self.is_whole
    }

    /// By when a value under this fault must be flagged.
    pub(crate) fn deadline(&self, parameter: Parameter) -> Duration {
        let age_max = parameter.spec().age_max;
        match self.kind {
            Kind::Freeze if self.is_whole => frozen::LOOP_STILL + SLOWEST,
            Kind::Freeze => frozen::FINE_STILL + SLOWEST,
            // A message that says it is needed, and no more.
            _ => age_max.min(SLOWEST),
        }
    }
}

/// What the state said of one parameter under one fault.
#[derive(Clone, Debug)]
pub(crate) struct Cell {
    pub(crate) parameter: Parameter,
    pub(crate) trouble: Trouble,
    pub(crate) protocol: Protocol,
    /// What was said instead of the value, first.
    pub(crate) said: Option<Invalid>,
    /// Whether the value was then worked out from others.
    pub(crate) is_derived: bool,
    /// From the fault to the first picture without the value.
    pub(crate) after: Option<Duration>,
    /// From the end of the fault to the first picture with the value again.
    pub(crate) back_after: Option<Duration>,
    /// Pictures past the deadline with a value that is none.
    pub(crate) wrong: u32,
    /// Pictures with a true value while the fault lasted.
    pub(crate) true_shown: u32,
    /// Why it cannot be found, where that is so.
    pub(crate) limit: Option<&'static str>,
    /// The furthest that a shown value was from the truth, in units of what a protocol can resolve or, without a checksum, of
    /// the greatest step that is not found.
    pub(crate) worst: f64,
}

fn at(t: Duration) -> Monotonic {
    Monotonic::from_nanos(1_000_000_000).plus(t)
}

/// By how much a sensor that stops alone may mislead before it is wrong, in the parameter's unit; None where not at all beyond
/// what the protocol resolves. The calm ones: `state::witness` and `state::relation` say what is found. Of altitudes and
/// headings that is half and less of what the comparators of certified displays allow (`state::compare`).
fn misleads(parameter: Parameter, resolution: f64) -> Option<f64> {
    use Parameter::{AltitudeMsl, BaroAltitude, BaroSetting, DensityAltitude, GroundSpeed};
    use Parameter::{HeadingMagnetic, HeadingTrue, HeightAgl, HeightEllipsoid, PressureAltitude};
    use Parameter::{StaticAirTemperature, Track, TrackMagnetic, TrueAirspeed, VerticalSpeed};
    use Parameter::{WindDirectionTrue, WindSpeed};
    Some(match parameter {
        HeadingTrue | HeadingMagnetic | Track | TrackMagnetic => 0.175,
        PressureAltitude | BaroAltitude | AltitudeMsl | HeightEllipsoid => 30.0,
        DensityAltitude => 60.0,
        HeightAgl => 60.0_f64.max(5.0 * resolution),
        VerticalSpeed => 2.0,
        GroundSpeed => 7.0,
        TrueAirspeed => 4.0,
        StaticAirTemperature => 2.0_f64.max(5.0 * resolution),
        WindSpeed => relation::WIND_APART_MPS,
        // As much of the weakest wind of the flight, 26 m/s, and what half a second adds.
        WindDirectionTrue => relation::WIND_APART_MPS / 20.0,
        BaroSetting => 7.5,
        _ => return None,
    })
}

/// What no single source can tell by itself, and why.
fn limit(
    parameter: Parameter,
    trouble: Trouble,
    encoder: &dyn encode::Encoder,
) -> Option<&'static str> {
    let carries = |p| encoder.carries(p).is_some();
    if !trouble.is_lone_freeze() {
        return None;
    }
    match parameter {
        Parameter::BaroSetting if !carries(Parameter::BaroAltitude) => Some(
            "a setting stands until its knob is turned, and only its own source knows the knob",
        ),
        Parameter::WindSpeed if !carries(Parameter::GroundSpeed) => {
            Some("a wind may stand, and without a ground speed nothing says another")
        }
        _ => None,
    }
}

/// Whether a protocol's frames have checksums of their own.
pub(crate) const fn has_checksum(protocol: Protocol) -> bool {
    !matches!(
        protocol,
        Protocol::CanAerospace | Protocol::CanFix | Protocol::FgFdm | Protocol::FgGeneric
    )
}

/// Flies once, with one fault, and judges `parameters`.
pub(crate) fn fly(
    flight: &Flight,
    protocol: Protocol,
    trouble: Trouble,
    parameters: &[Parameter],
) -> Vec<Cell> {
    let begin = Duration::from_secs(trouble.begin_s);
    // A sensor that stops is followed until the slowest, temperature, is found; under emulation that takes too long.
    let lasts_s = if crate::support::is_emulated() {
        trouble.lasts_s.min(40)
    } else {
        trouble.lasts_s
    };
    let end = begin + Duration::from_secs(lasts_s);
    let fault = Fault {
        kind: trouble.kind,
        begin,
        end: Some(end),
        parameter: if trouble.is_whole {
            None
        } else {
            parameters.first().copied()
        },
    };
    let Ok(mut bench) = Bench::new(encode::encoder(protocol), vec![fault], 7) else {
        return Vec::new();
    };
    let mut judges: Vec<Judge<'_>> = parameters
        .iter()
        .map(|p| Judge::new(flight, protocol, trouble, *p, bench.encoder()))
        .collect();
    let mut decoder = protocol.decoder();
    let mut fusion = Fusion::new(&[SourceId(0)]);
    // After many jumps a value may have to begin anew.
    let calm = if matches!(
        trouble.kind,
        Kind::BitFlips | Kind::Freeze | Kind::Reordering
    ) {
        jump::RECOVERY
    } else {
        Duration::from_secs(2)
    };
    let stop = end + calm + Duration::from_secs(2);
    let mut picture = FRAME;
    let mut truth = Truth::nothing();
    while picture < stop {
        while bench.next() <= picture {
            let now = bench.next();
            flight.at(now, &mut truth);
            bench.step(&truth, &mut |wire| {
                let frame = Frame {
                    at: at(now),
                    source: SourceId(0),
                    wire,
                };
                decoder.push(frame, &mut |signal: Signal| fusion.apply(&signal));
            });
        }
        let state = fusion.step(at(picture));
        for judge in &mut judges {
            judge.see(&state, picture, begin, end);
        }
        picture += FRAME;
    }
    judges
        .into_iter()
        .filter(|judge| judge.was_shown)
        .map(|judge| judge.cell)
        .collect()
}

/// Looks at one parameter, picture by picture.
struct Judge<'a> {
    flight: &'a Flight,
    tolerance: f64,
    /// When the truth first left what the sensor went on saying.
    left_at: Option<Duration>,
    was_shown: bool,
    cell: Cell,
}

impl<'a> Judge<'a> {
    fn new(
        flight: &'a Flight,
        protocol: Protocol,
        trouble: Trouble,
        parameter: Parameter,
        encoder: &dyn encode::Encoder,
    ) -> Self {
        let resolution = encoder.carries(parameter).map_or(0.0, |c| c.resolution);
        let mut tolerance = resolution.max(flight::derived_tolerance(parameter) * 1e-3);
        if trouble.kind == Kind::BitFlips && !has_checksum(protocol) {
            // A step that a flight can make is not found: this is by how much a damaged frame may mislead.
            let apart = Duration::from_millis(500);
            tolerance += jump::reach_max(parameter, apart).unwrap_or(0.0);
        }
        if trouble.is_lone_freeze() || parameter == Parameter::WindDirectionTrue {
            tolerance = tolerance.max(misleads(parameter, resolution).unwrap_or(0.0));
        }
        Self {
            flight,
            tolerance,
            left_at: None,
            was_shown: false,
            cell: Cell {
                parameter,
                trouble,
                protocol,
                said: None,
                is_derived: false,
                after: None,
                back_after: None,
                wrong: 0,
                true_shown: 0,
                limit: limit(parameter, trouble, encoder),
                worst: 0.0,
            },
        }
    }

    fn see(&mut self, state: &FlightState, now: Duration, begin: Duration, end: Duration) {
        let parameter = self.cell.parameter;
        let value = state.read(parameter, at(now));
        let is_derived = state.is_derived(parameter);
        if now < begin {
            self.was_shown |= value.is_ok() && !is_derived;
            return;
        }
        let is_gone = value.is_err() || is_derived;
        if is_gone && self.cell.after.is_none() && now < end + FRAME {
            self.cell.after = Some(now - begin);
            self.cell.said = value.err();
            self.cell.is_derived = is_derived;
        }
        if now >= end {
            if is_gone {
                self.cell.back_after = None;
            } else if self.cell.back_after.is_none() {
                self.cell.back_after = Some(now - end);
            }
        }
        let Ok(value) = value else {
            return;
        };
        let tolerance = if is_derived {
            flight::derived_tolerance(parameter)
        } else {
            self.tolerance
        };
        // A frame that was overtaken is as old as the time between two of its kind.
        let late = match self.cell.trouble.kind {
            Kind::Reordering => SLOWEST,
            _ => Duration::ZERO,
        };
        let off = self.flight.off(parameter, value, now, late) / tolerance;
        if off <= 1.0 {
            self.cell.true_shown += u32::from(now < end);
        } else {
            // A calm sensor that has stopped is wrong from when the truth leaves it, the first time.
            let left_at = *self.left_at.get_or_insert(now);
            let is_calm = self.cell.trouble.is_lone_freeze() && misleads(parameter, 0.0).is_some();
            let from = if is_calm { left_at } else { begin };
            let is_late = now > from + self.cell.trouble.deadline(parameter) + FRAME;
            self.cell.wrong += u32::from(is_late);
        }
        self.cell.worst = self.cell.worst.max(off);
    }
}
