//! NMEA 0183: satellite receivers, gliding instruments and FLARM.
//!
//! Sources: NMEA 0183 version 4 (GGA, RMC, VTG, GSA, from any talker); Garmin, "Proprietary NMEA 0183 sentences" (PGRMZ, as
//! FLARM and others use it: pressure altitude); FLARM, "Data Port Interface Control Document", FTD-012 (PFLAU, PFLAA); XCSoar's
//! device drivers for LXNAV (PLXVF, LXWP0), XCVario (PXCV), Larus (PLARA) and Levil (RPYL, APENV1).
//!
//! Every sentence with a right checksum is good, whether or not it is read; UBX and RTCM frames between them are ignored.
//! See [`gnss`](super::gnss) for the framing. A sentence without a checksum is bad, but for RPYL, which Stratux sends without:
//! it is counted as `unchecked`, taken from a datagram, which UDP protects, and doubtful from a bare stream.
//!
//! Sentinels: an empty field; status `V`, fix quality 0, mode `N`; 32767 in RPYL and its error code. A position that is
//! estimated, entered by hand or simulated (quality 6, 7, 8; mode E, M, S) is doubtful, and so is the altitude of a fix in
//! two dimensions.
//!
//! What is not read, and why: LXWP0's wind (its direction differs between devices) and heading; PLXVF's variometer (compensated
//! or netto, as its user has set it) and accelerations (signs not published); RPYL's slip. LXWP0's altitude is doubtful: some devices add
//! the pilot's setting to it. PLXVF has the true one.

use super::emit::{Emit, Field, celsius, compass, date_days, decimal, feet, fpm, knots, same};
use super::framing::{Framer, Piece};
use super::gnss::{self, FRAME_BYTES_MAX, Own};
use super::{Counters, Decoder};
use crate::sampled::Invalid;
use crate::signal::{Alert, Frame, Parameter, Place, Sink, SourceId, Traffic, Wire};
use crate::time::Monotonic;
use arrayvec::ArrayVec;

/// Fields of a sentence beyond its name; of those read here GSA has the most, 18.
const FIELDS_MAX: usize = 40;

/// What RPYL has for "no value".
const RPYL_ABSENT: f64 = 32_767.0;

/// Ranges of FLARM's relative positions: far beyond any radio's.
const AROUND_MAX_M: f64 = 200_000.0;
const UP_MAX_M: f64 = 30_000.0;

/// The decoder.
#[derive(Debug, Default)]
pub struct Nmea {
    framer: Framer<FRAME_BYTES_MAX>,
    reader: Reader,
}

/// What is remembered between sentences.
#[derive(Debug, Default)]
struct Reader {
    counters: Counters,
    /// Whether the last GSA said that the height is not measured.
    is_flat: bool,
}

impl Nmea {
    /// A decoder that has seen nothing.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }
}

impl Decoder for Nmea {
    fn push(&mut self, frame: Frame<'_>, sink: &mut dyn Sink) {
        let (bytes, is_protected) = match frame.wire {
            Wire::Datagram(bytes) => (bytes, true),
            Wire::Stream(bytes) => (bytes, false),
            Wire::Can(_) => {
                self.reader.counters.ignored += 1;
                return;
            }
        };
        let Self { framer, reader } = self;
        let look = |bytes: &[u8], seen| gnss::look(Own::Nmea, bytes, seen);
        framer.push(frame.at, bytes, look, &mut |piece| {
            reader.take(piece, frame.source, is_protected, sink);
        });
    }

    fn finish(&mut self) {
        let Self { framer, reader } = self;
        let look = |bytes: &[u8], seen| gnss::look(Own::Nmea, bytes, seen);
        framer.finish(look, &mut |piece| match piece {
            Piece::Frame(..) => reader.counters.ignored += 1,
            piece => reader.counters.count_piece(&piece),
        });
    }

    fn counters(&self) -> &Counters {
        &self.reader.counters
    }
}

impl Reader {
    fn take(
        &mut self,
        piece: Piece<'_>,
        source: SourceId,
        is_protected: bool,
        sink: &mut dyn Sink,
    ) {
        let (at, sentence) = match piece {
            Piece::Frame(at, frame) if gnss::is_sentence(frame) => (at, frame),
            Piece::Frame(..) => {
                self.counters.ignored += 1;
                return;
            }
            piece => {
                self.counters.count_piece(&piece);
                return;
            }
        };
        self.counters.count(None);
        let mut out = Emit::new(at, source, &mut self.counters.flow, sink);
        let body = match sentence {
            [_, body @ .., b'*', _, _] => body,
            [_, body @ ..] => {
                out.unchecked();
                out.doubt = (!is_protected).then_some(Invalid::Doubtful);
                body
            }
            [] => return,
        };
        let fields: ArrayVec<&[u8], FIELDS_MAX> =
            body.split(|b| *b == b',').take(FIELDS_MAX).collect();
        let f = Sentence(&fields);
        match fields[0] {
            [b'P', ..] | b"LXWP0" => proprietary(&f, &mut out),
            [_, _, b'G', b'G', b'A'] => gga(&f, self.is_flat, &mut out),
            [_, _, b'R', b'M', b'C'] => rmc(&f, &mut out),
            [_, _, b'V', b'T', b'G'] => vtg(&f, &mut out),
            [_, _, b'G', b'S', b'A'] => self.is_flat = gsa(&f, &mut out),
            b"RPYL" => rpyl(&f, &mut out),
            b"APENV1" => apenv1(&f, &mut out),
            _ => {}
        }
    }
}

/// The fields of a sentence; 0 is its name. A field that is not there is empty.
struct Sentence<'a>(&'a [&'a [u8]]);

impl Sentence<'_> {
    fn text(&self, n: usize) -> &[u8] {
        self.0.get(n).copied().unwrap_or_default()
    }

    fn field(&self, n: usize) -> Field {
        decimal(self.text(n))
    }

    /// A number where one must be, else not a number.
    fn number(&self, n: usize) -> f64 {
        match self.field(n) {
            Field::Number(x) => x,
            Field::Absent | Field::Malformed => f64::NAN,
        }
    }

    /// `DDMM.MMMM` or `DDDMM.MMMM` and the hemisphere in the next field, rad.
    fn angle(&self, n: usize, [positive, negative]: [u8; 2]) -> Field {
        let digits = self.text(n);
        let sign = match self.text(n + 1) {
            [h] if *h == positive => 1.0,
            [h] if *h == negative => -1.0,
            [] if digits.is_empty() => return Field::Absent,
            _ => return Field::Malformed,
        };
        let point = digits
            .iter()
            .position(|b| *b == b'.')
            .unwrap_or(digits.len());
        let Some((degrees, minutes)) = point.checked_sub(2).map(|n| digits.split_at(n)) else {
            return Field::Malformed;
        };
        match (super::emit::whole(degrees), decimal(minutes)) {
            (Some(degrees), Field::Number(m)) if (0.0..60.0).contains(&m) => {
                Field::Number(sign * (degrees + m / 60.0).to_radians())
            }
            _ => Field::Malformed,
        }
    }

    fn time_of_day(&self, n: usize, out: &mut Emit<'_>) {
        let text = self.text(n);
        match text {
            [] => out.absent(Parameter::UtcTimeOfDay),
            [clock @ .., b'.', fraction] if clock.len() == 6 && fraction.is_ascii_digit() => {
                out.time_of_day(clock, 0);
            }
            _ if text.len() >= 6 && matches!(decimal(text), Field::Number(_)) => {
                out.time_of_day(&text[..6], 0);
            }
            _ => out.number(Parameter::UtcTimeOfDay, f64::NAN),
        }
    }

    fn position(&self, n: usize, there: bool, out: &mut Emit<'_>) {
        for (parameter, at, hemispheres) in [
            (Parameter::Latitude, n, *b"NS"),
            (Parameter::Longitude, n + 2, *b"EW"),
        ] {
            if there {
                out.field(parameter, self.angle(at, hemispheres), same);
            } else {
                out.absent(parameter);
            }
        }
    }

    /// The number in field `n` if `there`, else that there is none.
    fn put(
        &self,
        n: usize,
        there: bool,
        parameter: Parameter,
        to_si: impl Fn(f64) -> f64,
        out: &mut Emit<'_>,
    ) {
        let field = if there { self.field(n) } else { Field::Absent };
        out.field(parameter, field, to_si);
    }
}

fn gga(f: &Sentence<'_>, is_flat: bool, out: &mut Emit<'_>) {
    f.time_of_day(1, out);
    let quality = f.text(6);
    let there = matches!(quality, [b'1'..=b'8']);
    if matches!(quality, [b'6'..=b'8']) {
        out.doubt = Some(Invalid::Doubtful);
    }
    f.position(2, there, out);
    if is_flat {
        out.doubt = Some(Invalid::Doubtful);
    }
    let in_metres = f.text(10) == b"M";
    f.put(9, there && in_metres, Parameter::AltitudeMsl, same, out);
    out.doubt = None;
    f.put(7, true, Parameter::SatellitesUsed, same, out);
    f.put(8, there, Parameter::HorizontalDilution, same, out);
}

fn rmc(f: &Sentence<'_>, out: &mut Emit<'_>) {
    f.time_of_day(1, out);
    let mode = f.text(12);
    let there = f.text(2) == b"A" && mode != b"N";
    if matches!(mode, [b'E' | b'M' | b'S']) {
        out.doubt = Some(Invalid::Doubtful);
    }
    f.position(3, there, out);
    f.put(7, there, Parameter::GroundSpeed, knots, out);
    f.put(8, there, Parameter::Track, compass, out);
    out.doubt = None;
    let date = match f.text(9) {
        [] => None,
        &[d, dd, m, mm, y, yy] => {
            let part = |a: u8, b: u8| match super::emit::whole(&[a, b]) {
                #[expect(clippy::cast_possible_truncation, reason = "two digits")]
                Some(n) => n as i32,
                None => -1,
            };
            let year = part(y, yy);
            // Receivers whose week number has rolled over say 19xx, which no aircraft with this display has seen.
            let year = if (0..80).contains(&year) {
                2000 + year
            } else {
                -1
            };
            Some(date_days(year, part(m, mm), part(d, dd)))
        }
        _ => Some(f64::NAN),
    };
    out.maybe(Parameter::UtcDate, date.filter(|_| there));
    let sign = match f.text(11) {
        b"E" => 1.0,
        b"W" => -1.0,
        _ => return,
    };
    let variation = |degrees: f64| (sign * degrees).to_radians();
    f.put(10, true, Parameter::MagneticVariation, variation, out);
}

fn vtg(f: &Sentence<'_>, out: &mut Emit<'_>) {
    let mode = f.text(9);
    // Before version 2 the letters between the fields were not there, and the fields were others.
    if f.text(2) != b"T" || f.text(6) != b"N" {
        return;
    }
    let there = mode != b"N";
    if matches!(mode, [b'E' | b'M' | b'S']) {
        out.doubt = Some(Invalid::Doubtful);
    }
    f.put(1, there, Parameter::Track, compass, out);
    if !f.text(3).is_empty() {
        f.put(3, there, Parameter::TrackMagnetic, compass, out);
    }
    f.put(5, there, Parameter::GroundSpeed, knots, out);
}

/// Says whether the fix has two dimensions only.
fn gsa(f: &Sentence<'_>, out: &mut Emit<'_>) -> bool {
    let dimensions = match f.text(2) {
        b"1" => Some(0.0),
        b"2" => Some(2.0),
        b"3" => Some(3.0),
        _ => None,
    };
    out.number(Parameter::FixDimensions, dimensions.unwrap_or(f64::NAN));
    let has_fix = dimensions.is_some_and(|d| d > 0.0);
    f.put(16, has_fix, Parameter::HorizontalDilution, same, out);
    dimensions.is_some_and(|d| d < 3.0)
}

fn proprietary(f: &Sentence<'_>, out: &mut Emit<'_>) {
    match f.text(0) {
        b"PGRMZ" => {
            let unit = f.text(2);
            match unit {
                b"f" | b"F" => f.put(1, true, Parameter::PressureAltitude, feet, out),
                b"m" | b"M" => f.put(1, true, Parameter::PressureAltitude, same, out),
                _ => out.number(Parameter::PressureAltitude, f64::NAN),
            }
        }
        b"PLXVF" => {
            f.put(6, true, Parameter::IndicatedAirspeed, same, out);
            f.put(7, true, Parameter::PressureAltitude, same, out);
        }
        b"LXWP0" => {
            f.put(2, true, Parameter::IndicatedAirspeed, |kmh| kmh / 3.6, out);
            f.put(4, true, Parameter::TotalEnergyVerticalSpeed, same, out);
            out.doubt = Some(Invalid::Doubtful);
            f.put(3, true, Parameter::PressureAltitude, same, out);
        }
        b"PXCV" => pxcv(f, out),
        b"PLARA" => {
            f.put(1, true, Parameter::Roll, f64::to_radians, out);
            f.put(2, true, Parameter::Pitch, f64::to_radians, out);
            f.put(3, true, Parameter::HeadingTrue, compass, out);
        }
        b"PFLAU" => pflau(f, out),
        b"PFLAA" => pflaa(f, out),
        _ => {}
    }
}

fn pxcv(f: &Sentence<'_>, out: &mut Emit<'_>) {
    f.put(1, true, Parameter::TotalEnergyVerticalSpeed, same, out);
    f.put(6, true, Parameter::StaticAirTemperature, celsius, out);
    f.put(7, true, Parameter::BaroSetting, same, out);
    f.put(8, true, Parameter::StaticPressure, same, out);
    // The dynamic pressure is in pascals.
    let pressure = f.number(8);
    let total = move |dynamic_pa: f64| pressure + dynamic_pa * 0.01;
    f.put(9, true, Parameter::TotalPressure, total, out);
    f.put(10, true, Parameter::Roll, f64::to_radians, out);
    f.put(11, true, Parameter::Pitch, f64::to_radians, out);
}

fn rpyl(f: &Sentence<'_>, out: &mut Emit<'_>) {
    // Any error of the hardware: nothing of it can be trusted.
    let works = f.text(7).iter().all(|b| *b == b'0');
    let tenths = |x: f64| (x * 0.1).to_radians();
    let put = |n: usize, parameter, to_si: &dyn Fn(f64) -> f64, out: &mut Emit<'_>| {
        let there = works && !matches!(f.field(n), Field::Number(x) if x >= RPYL_ABSENT);
        f.put(n, there, parameter, to_si, out);
    };
    put(1, Parameter::Roll, &tenths, out);
    put(2, Parameter::Pitch, &tenths, out);
    put(3, Parameter::HeadingMagnetic, &|x| compass(x * 0.1), out);
    put(5, Parameter::TurnRate, &tenths, out);
    put(6, Parameter::NormalAcceleration, &|x| x * 0.001, out);
}

fn apenv1(f: &Sentence<'_>, out: &mut Emit<'_>) {
    f.put(1, true, Parameter::IndicatedAirspeed, knots, out);
    f.put(2, true, Parameter::PressureAltitude, feet, out);
    f.put(6, true, Parameter::VerticalSpeed, fpm, out);
}

/// The aircraft that FLARM warns of most.
fn pflau(f: &Sentence<'_>, out: &mut Emit<'_>) {
    let alert = alert(f.text(5));
    if f.text(9).is_empty() || f.text(6).is_empty() {
        return;
    }
    let (bearing, up, distance) = (f.number(6), f.number(8), f.number(9));
    if (-180.0..=180.0).contains(&bearing) && is_up(up) && is_around(distance) {
        let place = Place::Bearing {
            bearing_relative_rad: bearing.to_radians(),
            distance_m: distance,
            up_m: up,
        };
        out.traffic(Traffic {
            address: hex_address(f.text(10)),
            ..unknown(place, alert)
        });
    } else {
        out.refused();
    }
}

/// One of the aircraft that FLARM hears.
fn pflaa(f: &Sentence<'_>, out: &mut Emit<'_>) {
    let (north, up) = (f.number(2), f.number(4));
    let place = match f.field(3) {
        Field::Number(east) if is_around(east) && is_around(north) && is_up(up) => {
            Place::Relative {
                north_m: north,
                east_m: east,
                up_m: up,
            }
        }
        // Without an easting the northing is the distance of an aircraft whose direction is not known.
        Field::Absent if is_around(north) && north >= 0.0 && is_up(up) => Place::Around {
            distance_m: north,
            up_m: up,
        },
        _ => return out.refused(),
    };
    let id = f.text(6);
    let (address, callsign) = match id.iter().position(|b| *b == b'!') {
        Some(n) => (&id[..n], &id[n + 1..]),
        None => (id, &id[..0]),
    };
    let mut traffic = unknown(place, alert(f.text(1)));
    traffic.address = hex_address(address);
    for (to, from) in traffic.callsign.iter_mut().zip(callsign) {
        *to = if from.is_ascii_alphanumeric() {
            *from
        } else {
            b' '
        };
    }
    let mut optional = |n: usize, parameter, to_si: fn(f64) -> f64| match f.field(n) {
        Field::Absent => None,
        Field::Number(x) => out.accept(parameter, to_si(x)),
        Field::Malformed => out.accept(parameter, f64::NAN),
    };
    traffic.track_rad = optional(7, Parameter::Track, compass);
    traffic.ground_speed_mps = optional(9, Parameter::GroundSpeed, same);
    traffic.vertical_speed_mps = optional(10, Parameter::VerticalSpeed, same);
    out.traffic(traffic);
}

/// An aircraft of which nothing but this is known.
fn unknown(place: Place, alert: Alert) -> Traffic {
    Traffic {
        at: Monotonic::from_nanos(0),
        source: SourceId(0),
        address: None,
        callsign: [b' '; 8],
        place,
        track_rad: None,
        ground_speed_mps: None,
        vertical_speed_mps: None,
        airborne: None,
        alert,
    }
}

fn alert(level: &[u8]) -> Alert {
    match level {
        b"1" => Alert::Low,
        b"2" => Alert::Important,
        b"3" => Alert::Urgent,
        _ => Alert::None,
    }
}

fn hex_address(text: &[u8]) -> Option<u32> {
    let digits = std::str::from_utf8(text).ok()?;
    let is_hex = digits.len() == 6 && digits.bytes().all(|b| b.is_ascii_hexdigit());
    is_hex
        .then(|| u32::from_str_radix(digits, 16).ok())
        .flatten()
}

fn is_around(x: f64) -> bool {
    x.abs() <= AROUND_MAX_M
}

fn is_up(x: f64) -> bool {
    x.abs() <= UP_MAX_M
}
