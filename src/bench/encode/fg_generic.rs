//! FlightGear's generic protocol: a line of text 30 times a second, laid out by the XML file that the receiver reads.
//!
//! Source: FlightGear, `docs-mini/README.protocol` and `src/Network/generic.cxx`: each chunk of `<output>` in its order, written
//! by its `printf` format. Properties that the bench has no number for are sent as 0, as FlightGear sends those that do not
//! exist; a value that is missing is `nan`, as `printf` writes it.

use super::field::{DEGREE, FAHRENHEIT, FAHRENHEIT_ZERO, FOOT, FPM, GALLON, ICE, INHG, KNOT, PSI};
use super::{Beat, Carried, Encoder, Send};
use crate::bench::truth::Truth;
use crate::proto::fg_generic::{Layout, LayoutError, SHIPPED};
use crate::signal::Parameter as P;
use crate::signal::{FUEL_QUANTITY, Parameter, Wire, engines};
use crate::units::STANDARD_GRAVITY_MPS2;
use std::time::Duration;

/// One simulator.
#[derive(Clone, Debug)]
pub struct FgGeneric {
    separator: String,
    columns: Vec<Column>,
}

#[derive(Clone, Copy, Debug)]
struct Column {
    /// The parameter, a step of the property in its unit, and what the property's 0 is.
    told: Option<(Parameter, f64, f64)>,
    decimals: usize,
}

const BEATS: [Beat; 1] = [Beat {
    every: Duration::from_nanos(33_333_333),
    first: Duration::ZERO,
}];

const FPS2: f64 = FOOT / STANDARD_GRAVITY_MPS2;

/// Properties, without their indices of 0: the parameter, the unit, the unit's zero.
const PROPERTIES: [(&str, Parameter, f64, f64); 53] = [
    ("/position/latitude-deg", P::Latitude, DEGREE, 0.0),
    ("/position/longitude-deg", P::Longitude, DEGREE, 0.0),
    ("/position/altitude-ft", P::AltitudeMsl, FOOT, 0.0),
    ("/position/altitude-agl-ft", P::HeightAgl, FOOT, 0.0),
    ("/orientation/roll-deg", P::Roll, DEGREE, 0.0),
    ("/orientation/pitch-deg", P::Pitch, DEGREE, 0.0),
    ("/orientation/heading-deg", P::HeadingTrue, DEGREE, 0.0),
    (
        "/orientation/heading-magnetic-deg",
        P::HeadingMagnetic,
        DEGREE,
        0.0,
    ),
    ("/orientation/track-deg", P::Track, DEGREE, 0.0),
    (
        "/orientation/track-magnetic-deg",
        P::TrackMagnetic,
        DEGREE,
        0.0,
    ),
    ("/orientation/alpha-deg", P::AngleOfAttack, DEGREE, 0.0),
    ("/orientation/side-slip-deg", P::Sideslip, DEGREE, 0.0),
    ("/velocities/airspeed-kt", P::CalibratedAirspeed, KNOT, 0.0),
    ("/velocities/groundspeed-kt", P::GroundSpeed, KNOT, 0.0),
    (
        "/velocities/vertical-speed-fps",
        P::VerticalSpeed,
        FOOT,
        0.0,
    ),
    ("/velocities/mach", P::MachNumber, 1.0, 0.0),
    (
        "/instrumentation/airspeed-indicator/indicated-speed-kt",
        P::IndicatedAirspeed,
        KNOT,
        0.0,
    ),
    (
        "/instrumentation/airspeed-indicator/true-speed-kt",
        P::TrueAirspeed,
        KNOT,
        0.0,
    ),
    (
        "/instrumentation/altimeter/indicated-altitude-ft",
        P::BaroAltitude,
        FOOT,
        0.0,
    ),
    (
        "/instrumentation/altimeter/pressure-alt-ft",
        P::PressureAltitude,
        FOOT,
        0.0,
    ),
    (
        "/instrumentation/altimeter/setting-inhg",
        P::BaroSetting,
        INHG,
        0.0,
    ),
    (
        "/instrumentation/altimeter/setting-hpa",
        P::BaroSetting,
        1.0,
        0.0,
    ),
    (
        "/instrumentation/vertical-speed-indicator/indicated-speed-fpm",
        P::VerticalSpeed,
        FPM,
        0.0,
    ),
    ("/accelerations/pilot-g", P::NormalAcceleration, 1.0, 0.0),
    (
        "/accelerations/pilot/x-accel-fps_sec",
        P::LongitudinalAcceleration,
        FPS2,
        0.0,
    ),
    (
        "/accelerations/pilot/y-accel-fps_sec",
        P::LateralAcceleration,
        FPS2,
        0.0,
    ),
    (
        "/environment/temperature-degc",
        P::StaticAirTemperature,
        1.0,
        ICE,
    ),
    ("/environment/pressure-inhg", P::StaticPressure, INHG, 0.0),
    (
        "/environment/density-altitude-ft",
        P::DensityAltitude,
        FOOT,
        0.0,
    ),
    ("/environment/wind-speed-kt", P::WindSpeed, KNOT, 0.0),
    (
        "/environment/wind-from-heading-deg",
        P::WindDirectionTrue,
        DEGREE,
        0.0,
    ),
    (
        "/environment/magnetic-variation-deg",
        P::MagneticVariation,
        DEGREE,
        0.0,
    ),
    (
        "/autopilot/settings/heading-bug-deg",
        P::SelectedHeading,
        DEGREE,
        0.0,
    ),
    (
        "/autopilot/settings/target-altitude-ft",
        P::SelectedAltitude,
        FOOT,
        0.0,
    ),
    (
        "/autopilot/settings/target-speed-kt",
        P::SelectedAirspeed,
        KNOT,
        0.0,
    ),
    (
        "/consumables/fuel/tank/level-gal_us",
        FUEL_QUANTITY[0],
        GALLON,
        0.0,
    ),
    (
        "/consumables/fuel/tank[1]/level-gal_us",
        FUEL_QUANTITY[1],
        GALLON,
        0.0,
    ),
    (
        "/consumables/fuel/tank[2]/level-gal_us",
        FUEL_QUANTITY[2],
        GALLON,
        0.0,
    ),
    (
        "/consumables/fuel/tank[3]/level-gal_us",
        FUEL_QUANTITY[3],
        GALLON,
        0.0,
    ),
    ("/engines/engine/rpm", engines::SPEED[0], 1.0, 0.0),
    (
        "/engines/engine/mp-inhg",
        engines::MANIFOLD_PRESSURE[0],
        INHG,
        0.0,
    ),
    (
        "/engines/engine/fuel-flow-gph",
        engines::FUEL_FLOW[0],
        GALLON,
        0.0,
    ),
    (
        "/engines/engine/oil-pressure-psi",
        engines::OIL_PRESSURE[0],
        PSI,
        0.0,
    ),
    (
        "/engines/engine/oil-temperature-degf",
        engines::OIL_TEMPERATURE[0],
        FAHRENHEIT,
        FAHRENHEIT_ZERO,
    ),
    (
        "/engines/engine/cht-degf",
        engines::CYLINDER_HEAD_TEMPERATURE[0][0],
        FAHRENHEIT,
        FAHRENHEIT_ZERO,
    ),
    (
        "/engines/engine/egt-degf",
        engines::EXHAUST_GAS_TEMPERATURE[0][0],
        FAHRENHEIT,
        FAHRENHEIT_ZERO,
    ),
    ("/engines/engine[1]/rpm", engines::SPEED[1], 1.0, 0.0),
    (
        "/engines/engine[1]/mp-inhg",
        engines::MANIFOLD_PRESSURE[1],
        INHG,
        0.0,
    ),
    (
        "/engines/engine[1]/fuel-flow-gph",
        engines::FUEL_FLOW[1],
        GALLON,
        0.0,
    ),
    (
        "/engines/engine[1]/oil-pressure-psi",
        engines::OIL_PRESSURE[1],
        PSI,
        0.0,
    ),
    (
        "/engines/engine[1]/oil-temperature-degf",
        engines::OIL_TEMPERATURE[1],
        FAHRENHEIT,
        FAHRENHEIT_ZERO,
    ),
    (
        "/engines/engine[1]/cht-degf",
        engines::CYLINDER_HEAD_TEMPERATURE[1][0],
        FAHRENHEIT,
        FAHRENHEIT_ZERO,
    ),
    (
        "/engines/engine[1]/egt-degf",
        engines::EXHAUST_GAS_TEMPERATURE[1][0],
        FAHRENHEIT,
        FAHRENHEIT_ZERO,
    ),
];

impl FgGeneric {
    /// A simulator that was given this protocol file.
    ///
    /// # Errors
    /// Why the file cannot be used.
    pub fn new(xml: &str) -> Result<Self, LayoutError> {
        Layout::parse(xml)?;
        let xml = without_comments(xml);
        let output = element(&xml, "output").map_or("", |(output, _)| output);
        let separator = match element(output, "var_separator").map_or(",", |(text, _)| text) {
            "tab" => "\t",
            "space" => " ",
            text => text,
        };
        let mut columns = Vec::new();
        let mut rest = output;
        while let Some((chunk, after)) = element(rest, "chunk") {
            rest = after;
            let text = |name| element(chunk, name).map_or("", |(text, _)| text.trim());
            let node = text("node").replace("[0]", "");
            let property = PROPERTIES.iter().find(|(name, ..)| *name == node);
            // The digits between the point and the f of a printf format; C's own six where it says nothing.
            let (_, places) = text("format").split_once('.').unwrap_or_default();
            let places: String = places.chars().take_while(char::is_ascii_digit).collect();
            columns.push(Column {
                told: property.map(|(_, parameter, step, zero)| (*parameter, *step, *zero)),
                decimals: places.parse().unwrap_or(6).min(15),
            });
        }
        Ok(Self {
            separator: separator.to_owned(),
            columns,
        })
    }
}

impl Default for FgGeneric {
    /// With the protocol file that comes with this program.
    fn default() -> Self {
        #[expect(
            clippy::expect_used,
            reason = "a file of this program; a test reads it"
        )]
        Self::new(SHIPPED).expect("the shipped layout is one")
    }
}

impl Encoder for FgGeneric {
    fn beats(&self) -> &'static [Beat] {
        &BEATS
    }

    fn write(&mut self, _message: usize, truth: &Truth, send: Send<'_>) {
        let column = |column: &Column| match column.told {
            None => "0".to_owned(),
            Some((parameter, step, zero)) => match truth.get(parameter) {
                Ok(x) if x.is_finite() => {
                    format!("{:.*}", column.decimals, (x - zero) / step)
                }
                _ => "nan".to_owned(),
            },
        };
        let columns: Vec<String> = self.columns.iter().map(column).collect();
        let line = columns.join(&self.separator) + "\n";
        send(Wire::Datagram(line.as_bytes()));
    }

    fn sends_datagrams(&self) -> bool {
        true
    }

    fn carries(&self, parameter: Parameter) -> Option<Carried> {
        let mut columns = self.columns.iter().filter_map(|column| {
            let (told, step, _) = column.told?;
            (told == parameter).then_some((step, column.decimals))
        });
        let (step, decimals) = columns.next()?;
        Some(Carried {
            resolution: step * 10_f64.powi(-i32::try_from(decimals).unwrap_or(6)),
            min: -1e12,
            max: 1e12,
            absent: true,
            nan: true,
            doubtful: false,
        })
    }
}

fn without_comments(xml: &str) -> String {
    let mut pieces = xml.split("<!--");
    let first = pieces.next().unwrap_or_default().to_owned();
    let after = pieces.map(|piece| piece.split_once("-->").map_or("", |(_, after)| after));
    first + &after.collect::<String>()
}

/// What stands in the first element of this name, and what comes after it.
fn element<'a>(xml: &'a str, name: &str) -> Option<(&'a str, &'a str)> {
    let (_, after) = xml.split_once(&format!("<{name}>"))?;
    after.split_once(&format!("</{name}>"))
}
