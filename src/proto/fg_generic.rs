//! FlightGear's generic protocol: a line of text per packet, laid out by an XML file that both sides read.
//!
//! Source: FlightGear, `docs-mini/README.protocol` and `src/Network/generic.cxx`. The sender is `fgfs
//! --generic=socket,out,RATE,HOST,PORT,udp,NAME` with `NAME.xml` in its `Protocol` folder. This program ships one
//! ([`SHIPPED`], `boards/flightgear-glasswing.xml`); any other can be read: the chunks of its `<output>`, in their order, by
//! the property that each sends. Properties that are not in the table below keep their place and are not read.
//!
//! Text only: `binary_mode` is refused, and so is a `factor` or `offset` of a property that is read. There is no checksum:
//! the protocol is for UDP, which has its own. Of a byte stream (a serial port, a file of lines) what comes before the first line
//! end is ignored: it may be the rest of a line, whose first number would be another. A line with a wrong number of fields is dropped whole; a field that is no
//! number, or one that its parameter cannot have, is reported as [`Invalid::OutOfRange`](crate::sampled::Invalid), the others
//! are used, and the line is counted as bad. Sentinels: none; a property that does not exist is sent as zero.

use super::emit::{
    Emit, Field, celsius, compass, decimal, feet, fpm, inches_of_mercury, knots, same,
};
use super::framing::{Framer, Look, Piece, at_most, is_line_end};
use super::{Counters, Decoder, Fault};
use crate::signal::Parameter as P;
use crate::signal::{FUEL_QUANTITY, Frame, Parameter, Sink, SourceId, Wire, engines};
use crate::units::{HECTOPASCALS_PER_PSI, LITRES_PER_US_GALLON};
use arrayvec::ArrayVec;

/// The layout that comes with this program.
pub const SHIPPED: &str = include_str!("../../boards/flightgear-glasswing.xml");

/// Fields of a line.
pub const FIELDS_MAX: usize = 64;

/// The longest line: 64 fields of 22 characters and their separators fit into a datagram.
const LINE_BYTES_MAX: usize = 1472;

/// Why a layout cannot be used; [`LayoutError::todo`] says what to do about it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LayoutError {
    /// There is no `<output>` with chunks.
    #[error("it has no <output> with <chunk>s")]
    NoChunks,
    /// A chunk without a property.
    #[error("chunk {0} has no <node>")]
    NoNode(usize),
    /// The sender sends numbers, not text.
    #[error("it has binary_mode")]
    Binary,
    /// The separator is not one character.
    #[error("its var_separator {0:?} is not one character")]
    Separator(String),
    /// More fields than are read.
    #[error("it has {0} chunks")]
    TooMany(usize),
    /// Numbers that the sender changes.
    #[error("chunk {0} has a factor or an offset")]
    Scaled(usize),
}

impl LayoutError {
    /// What the user can do.
    #[must_use]
    pub const fn todo(&self) -> &'static str {
        match self {
            Self::NoChunks => "give the file that FlightGear's --generic names",
            Self::NoNode(_) => "name the property that it sends",
            Self::Binary => "set it to false: text is read",
            Self::Separator(_) => "use a comma",
            Self::TooMany(_) => "send at most 64",
            Self::Scaled(_) => "send the property as it is",
        }
    }
}

/// How a property's number becomes a parameter's.
type ToSi = fn(f64) -> f64;

/// What each field of a line is.
#[derive(Clone, Debug)]
pub struct Layout {
    separator: u8,
    fields: ArrayVec<Option<(Parameter, ToSi)>, FIELDS_MAX>,
}

impl Layout {
    /// Reads a protocol file of FlightGear.
    ///
    /// # Errors
    /// Why it cannot be used.
    pub fn parse(xml: &str) -> Result<Self, LayoutError> {
        let xml = without_comments(xml);
        let output = element(&xml, "output").ok_or(LayoutError::NoChunks)?;
        if element(output, "binary_mode").is_some_and(|text| text.trim() == "true") {
            return Err(LayoutError::Binary);
        }
        let separator = match element(output, "var_separator").unwrap_or(",") {
            "tab" => b'\t',
            "space" => b' ',
            text => match text.as_bytes() {
                [one] if !is_line_end(*one) => *one,
                _ => return Err(LayoutError::Separator(text.to_owned())),
            },
        };
        let mut fields = ArrayVec::new();
        let mut rest = output;
        let mut count = 0;
        while let Some((chunk, after)) = element_and_rest(rest, "chunk") {
            rest = after;
            count += 1;
            let node = element(chunk, "node").ok_or(LayoutError::NoNode(count))?;
            let field = property(node.trim());
            let is_scaled = |name, neutral: f64| {
                element(chunk, name).is_some_and(|text| text.trim().parse() != Ok(neutral))
            };
            if field.is_some() && (is_scaled("factor", 1.0) || is_scaled("offset", 0.0)) {
                return Err(LayoutError::Scaled(count));
            }
            if !fields.is_full() {
                fields.push(field);
            }
        }
        match count {
            0 => Err(LayoutError::NoChunks),
            FIELDS_MAX.. if count > FIELDS_MAX => Err(LayoutError::TooMany(count)),
            _ => Ok(Self { separator, fields }),
        }
    }

    /// Fields that are read.
    #[must_use]
    pub fn known(&self) -> usize {
        self.fields.iter().flatten().count()
    }
}

fn without_comments(xml: &str) -> String {
    let mut text = String::new();
    let mut rest = xml;
    while let Some((before, after)) = rest.split_once("<!--") {
        text.push_str(before);
        rest = after.split_once("-->").map_or("", |(_, after)| after);
    }
    text + rest
}

/// What stands between `<name>` and `</name>`.
fn element<'a>(xml: &'a str, name: &str) -> Option<&'a str> {
    element_and_rest(xml, name).map(|(content, _)| content)
}

fn element_and_rest<'a>(xml: &'a str, name: &str) -> Option<(&'a str, &'a str)> {
    let (_, after) = xml.split_once(&format!("<{name}>"))?;
    after.split_once(&format!("</{name}>"))
}

fn psi(x: f64) -> f64 {
    x * HECTOPASCALS_PER_PSI
}

fn gallons(x: f64) -> f64 {
    x * LITRES_PER_US_GALLON
}

fn fahrenheit(x: f64) -> f64 {
    celsius((x - 32.0) / 1.8)
}

/// Feet a second squared, g.
fn g_of_fps2(x: f64) -> f64 {
    feet(x) / crate::units::STANDARD_GRAVITY_MPS2
}

/// The property tree's names, as FlightGear's own `Protocol` files and its manual have them.
fn property(node: &str) -> Option<(Parameter, ToSi)> {
    // The first of several is written with and without its index.
    let node = node.replace("[0]", "");
    Some(match node.as_str() {
        "/position/latitude-deg" => (P::Latitude, f64::to_radians),
        "/position/longitude-deg" => (P::Longitude, f64::to_radians),
        "/position/altitude-ft" => (P::AltitudeMsl, feet),
        "/position/altitude-agl-ft" => (P::HeightAgl, feet),
        "/orientation/roll-deg" => (P::Roll, f64::to_radians),
        "/orientation/pitch-deg" => (P::Pitch, f64::to_radians),
        "/orientation/heading-deg" => (P::HeadingTrue, compass),
        "/orientation/heading-magnetic-deg" => (P::HeadingMagnetic, compass),
        "/orientation/track-deg" => (P::Track, compass),
        "/orientation/track-magnetic-deg" => (P::TrackMagnetic, compass),
        "/orientation/alpha-deg" => (P::AngleOfAttack, f64::to_radians),
        "/orientation/side-slip-deg" => (P::Sideslip, f64::to_radians),
        "/velocities/airspeed-kt" => (P::CalibratedAirspeed, knots),
        "/velocities/groundspeed-kt" => (P::GroundSpeed, knots),
        "/velocities/vertical-speed-fps" => (P::VerticalSpeed, feet),
        "/velocities/mach" => (P::MachNumber, same),
        "/instrumentation/airspeed-indicator/indicated-speed-kt" => (P::IndicatedAirspeed, knots),
        "/instrumentation/airspeed-indicator/true-speed-kt" => (P::TrueAirspeed, knots),
        "/instrumentation/altimeter/indicated-altitude-ft" => (P::BaroAltitude, feet),
        "/instrumentation/altimeter/pressure-alt-ft" => (P::PressureAltitude, feet),
        "/instrumentation/altimeter/setting-inhg" => (P::BaroSetting, inches_of_mercury),
        "/instrumentation/altimeter/setting-hpa" => (P::BaroSetting, same),
        "/instrumentation/vertical-speed-indicator/indicated-speed-fpm" => (P::VerticalSpeed, fpm),
        "/accelerations/pilot-g" => (P::NormalAcceleration, same),
        "/accelerations/pilot/x-accel-fps_sec" => (P::LongitudinalAcceleration, g_of_fps2),
        "/accelerations/pilot/y-accel-fps_sec" => (P::LateralAcceleration, g_of_fps2),
        "/environment/temperature-degc" => (P::StaticAirTemperature, celsius),
        "/environment/pressure-inhg" => (P::StaticPressure, inches_of_mercury),
        "/environment/density-altitude-ft" => (P::DensityAltitude, feet),
        "/environment/wind-speed-kt" => (P::WindSpeed, knots),
        "/environment/wind-from-heading-deg" => (P::WindDirectionTrue, compass),
        "/environment/magnetic-variation-deg" => (P::MagneticVariation, f64::to_radians),
        "/autopilot/settings/heading-bug-deg" => (P::SelectedHeading, compass),
        "/autopilot/settings/target-altitude-ft" => (P::SelectedAltitude, feet),
        "/autopilot/settings/target-speed-kt" => (P::SelectedAirspeed, knots),
        _ => return engine_property(&node),
    })
}

fn engine_property(node: &str) -> Option<(Parameter, ToSi)> {
    if let Some(tank) = node.strip_prefix("/consumables/fuel/tank") {
        let (tank, name) = tank.split_once('/')?;
        let n = match tank {
            "" => 0,
            index => index
                .strip_prefix('[')?
                .strip_suffix(']')?
                .parse::<usize>()
                .ok()?,
        };
        let quantity = *FUEL_QUANTITY.get(n)?;
        return (name == "level-gal_us").then_some((quantity, gallons as ToSi));
    }
    let (n, name) = match node.strip_prefix("/engines/engine[1]/") {
        Some(name) => (1, name),
        None => (0, node.strip_prefix("/engines/engine/")?),
    };
    Some(match name {
        "rpm" => (engines::SPEED[n], same),
        "mp-inhg" => (engines::MANIFOLD_PRESSURE[n], inches_of_mercury),
        "fuel-flow-gph" => (engines::FUEL_FLOW[n], gallons),
        "oil-pressure-psi" => (engines::OIL_PRESSURE[n], psi),
        "oil-temperature-degf" => (engines::OIL_TEMPERATURE[n], fahrenheit),
        "cht-degf" => (engines::CYLINDER_HEAD_TEMPERATURE[n][0], fahrenheit),
        "egt-degf" => (engines::EXHAUST_GAS_TEMPERATURE[n][0], fahrenheit),
        _ => return None,
    })
}

/// The decoder.
#[derive(Debug)]
pub struct FgGeneric {
    layout: Layout,
    framer: Framer<{ LINE_BYTES_MAX + 2 }>,
    counters: Counters,
    /// Whether what comes up to the next line end is the rest of a line that was given up: its first field is cut.
    is_torn: bool,
    /// Whether what comes up to the next line end is a stream's first, of which nobody has seen the beginning.
    is_first: bool,
    /// Whether anything has come since the stream was opened.
    has_begun: bool,
}

impl FgGeneric {
    /// A decoder of lines laid out so.
    #[must_use]
    pub fn new(layout: Layout) -> Self {
        Self {
            layout,
            framer: Framer::new(),
            counters: Counters::default(),
            is_torn: false,
            is_first: false,
            has_begun: false,
        }
    }
}

impl Default for FgGeneric {
    /// A decoder of the layout that comes with this program.
    fn default() -> Self {
        #[expect(
            clippy::expect_used,
            reason = "a file of this program; a test reads it"
        )]
        let layout = Layout::parse(SHIPPED).expect("the shipped layout is one");
        Self::new(layout)
    }
}

impl Decoder for FgGeneric {
    fn push(&mut self, frame: Frame<'_>, sink: &mut dyn Sink) {
        let (bytes, end) = match frame.wire {
            // A datagram is whole, with or without a line end.
            Wire::Datagram(bytes) => (bytes, &b"\n"[..]),
            Wire::Stream(bytes) => (bytes, &b""[..]),
            Wire::Can(_) => {
                self.counters.ignored += 1;
                return;
            }
        };
        let Self {
            layout,
            framer,
            counters,
            is_torn,
            is_first,
            has_begun,
        } = self;
        match frame.wire {
            Wire::Stream([]) => {
                framer.finish(look, &mut |piece| counters.count_piece(&piece));
                *has_begun = false;
            }
            Wire::Stream([first, ..]) if !*has_begun => {
                (*has_begun, *is_first) = (true, !is_line_end(*first));
            }
            Wire::Stream(_) => {}
            _ => (*has_begun, *is_first) = (true, false),
        }
        for bytes in [bytes, end] {
            framer.push(frame.at, bytes, look, &mut |piece| {
                if matches!(piece, Piece::Frame(..)) && std::mem::take(is_first) {
                    *is_torn = false;
                    counters.ignored += 1;
                    return;
                }
                if matches!(piece, Piece::Frame(..)) && std::mem::take(is_torn) {
                    counters.count(Some(Fault::Fragment));
                    return;
                }
                *is_torn |= matches!(piece, Piece::Damaged(_));
                take(layout, piece, frame.source, counters, sink);
            });
        }
    }

    fn finish(&mut self) {
        let Self {
            framer, counters, ..
        } = self;
        framer.finish(look, &mut |piece| counters.count_piece(&piece));
    }

    fn counters(&self) -> &Counters {
        &self.counters
    }
}

fn look(bytes: &[u8], seen: usize) -> Look {
    if is_line_end(bytes[0]) {
        return Look::Blank(1);
    }
    let bytes = at_most(bytes, LINE_BYTES_MAX);
    match bytes[seen..].iter().position(|b| is_line_end(*b)) {
        Some(n) => Look::Frame(seen + n),
        None if bytes.len() < LINE_BYTES_MAX => Look::More,
        None => Look::Damaged(bytes.len(), Fault::Long),
    }
}

fn take(
    layout: &Layout,
    piece: Piece<'_>,
    source: SourceId,
    counters: &mut Counters,
    sink: &mut dyn Sink,
) {
    let Piece::Frame(at, line) = piece else {
        counters.count_piece(&piece);
        return;
    };
    let fields = line.split(|b| *b == layout.separator);
    let fault = match fields.clone().count().cmp(&layout.fields.len()) {
        std::cmp::Ordering::Less => Some(Fault::Short),
        std::cmp::Ordering::Greater => Some(Fault::Long),
        std::cmp::Ordering::Equal => None,
    };
    if fault.is_some() {
        counters.count(fault);
        return;
    }
    let mut worst = None;
    let mut out = Emit::new(at, source, &mut counters.flow, sink);
    for (text, field) in fields.zip(&layout.fields) {
        let Some((parameter, to_si)) = field else {
            continue;
        };
        let number = match decimal(text.trim_ascii()) {
            Field::Number(x) => to_si(x),
            Field::Absent | Field::Malformed => f64::NAN,
        };
        let value = parameter.check(number);
        if value.is_err() && number.is_finite() {
            worst = worst.or(Some(Fault::OutOfRange));
        } else if value.is_err() {
            worst = Some(Fault::NotFinite);
        }
        out.verdict(*parameter, value);
    }
    counters.count(worst);
}
