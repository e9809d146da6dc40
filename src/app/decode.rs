//! `glasswing decode`: what a capture holds, and what is wrong with it.
#![expect(clippy::print_stderr, reason = "the command's note on a damaged file")]

use super::error::{Failure, Kind};
use crate::proto::capture::{CandumpLine, CaptureError, UdpCapture};
use crate::proto::fg_generic::{FgGeneric, Layout};
use crate::proto::{Carriage, Counters, Decoder, Fault, Protocol};
use crate::sampled::Invalid;
use crate::signal::{Alert, Frame, Limit, Place, Signal, Sink, SourceId, Traffic, Wire};
use crate::time::Monotonic;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use serde_json::{Map, Value, json};
use std::fmt::Display;
use std::io::{self, BufWriter, StdoutLock, Write as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Decode a capture of bus traffic and say what is good, bad and ignored in it.
///
/// FILE is a candump log (as `candump -l` writes it) for protocols on CAN, a UDP capture container (records of seconds as
/// f64 and length as u32, both little-endian, then the payload) for packets, and either such a container or the raw bytes of
/// a serial line for the others. Raw bytes have no times.
///
/// Every frame is counted once: as good, as bad under one kind, or as ignored (somebody else's traffic). Where a protocol has
/// checksums, good is every whole frame with a right one, whether or not there is a use for what it says. A container that
/// ends inside a record is decoded up to there and counted as `truncated`; a line that is no candump line as `malformed`.
#[derive(Clone, Debug, clap::Args)]
#[command(
    after_help = "Example:\n  glasswing decode --as fgfdm flight.bin --json\n  glasswing decode --as canaerospace candump.log --samples"
)]
pub struct DecodeArgs {
    /// The protocol of the capture.
    #[arg(long = "as", value_name = "PROTOCOL", value_parser = protocol_parser())]
    pub protocol: Protocol,
    /// For fg-generic: FlightGear's protocol file by which the capture was made, unless it is the one that comes with Glasswing.
    #[arg(long, value_name = "XML")]
    pub layout: Option<PathBuf>,
    /// The capture.
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Print each sample as a JSON line: time (seconds, as in the capture), parameter, value (null when there is none), unit,
    /// quality (`good`, or why there is no value). With --json the samples are an array `samples` of the one document.
    #[arg(long)]
    pub samples: bool,
    /// Print one JSON document: good, bad {kind: count}, ignored, flow {lost, repeated, frozen, failed, refused, unchecked, alarms, late}.
    #[arg(long)]
    pub json: bool,
}

/// A protocol on the command line.
pub fn protocol_parser() -> impl TypedValueParser<Value = Protocol> {
    PossibleValuesParser::new(Protocol::ALL.map(Protocol::name)).try_map(|name| {
        Protocol::by_name(&name).ok_or_else(|| format!("{name} is not decoded by this version"))
    })
}

/// Runs the command.
///
/// # Errors
/// A [`Kind::Input`] failure when the file cannot be read or is not a capture of the protocol's kind.
pub fn run(args: DecodeArgs) -> Result<(), Failure> {
    let bytes = std::fs::read(&args.file).map_err(|e| {
        Failure::new(
            Kind::Input,
            args.file.display(),
            &e,
            "name a capture that can be read",
        )
    })?;
    let mut out = Output::new();
    let mut samples = Vec::new();
    let mut on_sample = |sample: Value| {
        if args.json {
            samples.push(sample);
        } else {
            out.line(&sample);
        }
    };
    let decoder = match &args.layout {
        None => args.protocol.decoder(),
        Some(file) => with_layout(args.protocol, file)?,
    };
    let outcome = decode(
        &args.file,
        &bytes,
        args.protocol.carriage(),
        decoder,
        args.samples.then_some(&mut on_sample),
    )?;
    if let Some(damage) = outcome.damage {
        eprintln!(
            "glasswing: {}: {damage} (what comes before it was decoded; record it again)",
            args.file.display()
        );
    }
    if args.protocol == Protocol::FgGeneric && outcome.has_other_layout() {
        let of = if args.layout.is_some() {
            "the lines of the file given with --layout"
        } else {
            "those of flightgear-glasswing.xml"
        };
        eprintln!(
            "glasswing: {}: most lines have another number of fields than {of} (give the protocol file that made them with --layout)",
            args.file.display()
        );
    }
    if args.json {
        let mut document = outcome.to_json();
        if args.samples {
            document.insert("samples".to_owned(), Value::Array(samples));
        }
        out.line(&Value::Object(document));
    } else if !args.samples {
        out.line(&outcome.to_text());
    }
    out.finish()
}

/// The text of `--layout`, a protocol file of FlightGear.
///
/// # Errors
/// For another protocol than fg-generic, or a file that cannot be read.
pub(super) fn layout_text(protocol: Protocol, file: &Path) -> Result<String, Failure> {
    if protocol != Protocol::FgGeneric {
        let why = "is for fg-generic only";
        return Err(Failure::new(Kind::Usage, "--layout", why, "leave it out"));
    }
    std::fs::read_to_string(file).map_err(|e| {
        let todo = "name a protocol file of FlightGear";
        Failure::new(Kind::Input, file.display(), &e, todo)
    })
}

/// A decoder of lines laid out by a file.
fn with_layout(protocol: Protocol, file: &Path) -> Result<Box<dyn Decoder>, Failure> {
    let text = layout_text(protocol, file)?;
    let layout = Layout::parse(&text)
        .map_err(|e| Failure::new(Kind::Input, file.display(), &e, e.todo()))?;
    Ok(Box::new(FgGeneric::new(layout)))
}

/// Standard output, whose reader may go away: what was asked for is then done, and nobody hears a complaint.
struct Output {
    stdout: BufWriter<StdoutLock<'static>>,
    written: io::Result<()>,
}

impl Output {
    fn new() -> Self {
        Self {
            stdout: BufWriter::new(io::stdout().lock()),
            written: Ok(()),
        }
    }

    fn line(&mut self, line: &dyn Display) {
        if self.written.is_ok() {
            self.written = writeln!(self.stdout, "{line}");
        }
    }

    fn finish(mut self) -> Result<(), Failure> {
        match self.written.and_then(|()| self.stdout.flush()) {
            Err(e) if e.kind() != io::ErrorKind::BrokenPipe => Err(Failure::new(
                Kind::Other,
                "standard output",
                &e,
                "see where it goes",
            )),
            _ => Ok(()),
        }
    }
}

type OnSample<'a> = &'a mut dyn FnMut(Value);

/// What a capture came to.
struct Outcome {
    counters: Counters,
    truncated: u64,
    malformed: u64,
    /// Frames of the bus that no decoder is given: remote requests, error frames, CAN FD.
    without_data: u64,
    damage: Option<CaptureError>,
}

impl Outcome {
    /// Whether most lines have another number of fields than they should.
    fn has_other_layout(&self) -> bool {
        let miscounted = self.counters.bad(Fault::Short) + self.counters.bad(Fault::Long);
        miscounted > self.counters.good
    }

    fn bad(&self) -> Vec<(&'static str, u64)> {
        Fault::ALL
            .into_iter()
            .map(|fault| (fault.name(), self.counters.bad(fault)))
            .chain([("truncated", self.truncated), ("malformed", self.malformed)])
            .filter(|(_, count)| *count > 0)
            .collect()
    }

    fn to_json(&self) -> Map<String, Value> {
        let Counters {
            good,
            ignored,
            flow,
            ..
        } = &self.counters;
        let bad: Map<String, Value> = self
            .bad()
            .into_iter()
            .map(|(kind, count)| (kind.to_owned(), json!(count)))
            .collect();
        let mut document = Map::new();
        document.insert("good".to_owned(), json!(good));
        document.insert("bad".to_owned(), Value::Object(bad));
        document.insert("ignored".to_owned(), json!(ignored));
        document.insert(
            "flow".to_owned(),
            json!({
                "lost": flow.lost, "repeated": flow.repeated, "frozen": flow.frozen, "failed": flow.failed,
                "refused": flow.refused, "unchecked": flow.unchecked, "alarms": flow.alarms, "late": flow.late,
            }),
        );
        document
    }

    fn to_text(&self) -> String {
        let Counters {
            good,
            ignored,
            flow,
            ..
        } = &self.counters;
        let mut text = format!("good     {good}\n");
        for (kind, count) in self.bad() {
            text += &format!("bad      {count} {kind}\n");
        }
        text += &format!("ignored  {ignored}\n");
        text + &format!(
            "flow     {} lost, {} repeated, {} frozen, {} failed, {} fields refused, {} unchecked, {} alarms, {} late",
            flow.lost,
            flow.repeated,
            flow.frozen,
            flow.failed,
            flow.refused,
            flow.unchecked,
            flow.alarms,
            flow.late
        )
    }
}

fn decode(
    path: &Path,
    bytes: &[u8],
    carriage: Carriage,
    decoder: Box<dyn Decoder>,
    on_sample: Option<OnSample<'_>>,
) -> Result<Outcome, Failure> {
    let mut run = Run { decoder, on_sample };
    let mut outcome = Outcome {
        counters: Counters::default(),
        truncated: 0,
        malformed: 0,
        without_data: 0,
        damage: None,
    };
    match carriage {
        Carriage::Packets => read_container(path, bytes, &mut run, &mut outcome)?,
        Carriage::Stream if UdpCapture::is_one(bytes) => {
            read_container(path, bytes, &mut run, &mut outcome)?;
        }
        Carriage::Stream if bytes.is_empty() => return Err(empty(path)),
        Carriage::Stream => run.push(None, Wire::Stream(bytes)),
        Carriage::Can => read_candump(path, bytes, &mut run, &mut outcome)?,
    }
    run.decoder.finish();
    outcome.counters = *run.decoder.counters();
    outcome.counters.ignored += outcome.without_data;
    Ok(outcome)
}

fn read_container(
    path: &Path,
    bytes: &[u8],
    run: &mut Run<'_>,
    outcome: &mut Outcome,
) -> Result<(), Failure> {
    for record in UdpCapture::new(bytes) {
        match record {
            Ok((seconds, payload)) => run.push(Some(seconds), Wire::Datagram(payload)),
            Err(damage @ CaptureError::Truncated { .. }) => {
                outcome.truncated += 1;
                outcome.damage = Some(damage);
            }
            Err(damage @ CaptureError::NotARecord { .. }) => {
                return Err(Failure::new(
                    Kind::Input,
                    path.display(),
                    damage,
                    "give a UDP capture container, or record it again",
                ));
            }
        }
    }
    if bytes.is_empty() {
        return Err(empty(path));
    }
    Ok(())
}

fn read_candump(
    path: &Path,
    bytes: &[u8],
    run: &mut Run<'_>,
    outcome: &mut Outcome,
) -> Result<(), Failure> {
    let mut frames = 0_u64;
    // Lines are taken as bytes, so that damage in one costs that one.
    for line in bytes.split(|&b| b == b'\n') {
        let line = std::str::from_utf8(line).map_or(CandumpLine::Malformed, CandumpLine::parse);
        match line {
            CandumpLine::Blank => {}
            CandumpLine::Data(seconds, can) => {
                frames += 1;
                run.push(Some(seconds), Wire::Can(can));
            }
            CandumpLine::NoData => outcome.without_data += 1,
            CandumpLine::Malformed => outcome.malformed += 1,
        }
    }
    if frames + outcome.without_data == 0 {
        return Err(if outcome.malformed == 0 {
            empty(path)
        } else {
            Failure::new(
                Kind::Input,
                path.display(),
                "no line of it is one of a candump log",
                "give a log as `candump -l` writes it",
            )
        });
    }
    Ok(())
}

fn empty(path: &Path) -> Failure {
    Failure::new(
        Kind::Input,
        path.display(),
        "it holds no frames",
        "record it again",
    )
}

struct Run<'a> {
    decoder: Box<dyn Decoder>,
    on_sample: Option<OnSample<'a>>,
}

impl Run<'_> {
    /// One frame; a raw capture has no times.
    fn push(&mut self, seconds: Option<f64>, wire: Wire<'_>) {
        let at = Duration::try_from_secs_f64(seconds.unwrap_or(0.0)).unwrap_or(Duration::MAX);
        let frame = Frame {
            at: Monotonic::from_nanos(0).plus(at),
            source: SourceId(0),
            wire,
        };
        let mut printer = Printer {
            seconds,
            on_sample: self.on_sample.take(),
        };
        self.decoder.push(frame, &mut printer);
        self.on_sample = printer.on_sample;
    }
}

/// Makes a JSON line of each thing that the decoder says.
struct Printer<'a> {
    seconds: Option<f64>,
    on_sample: Option<OnSample<'a>>,
}

impl Printer<'_> {
    fn print(&mut self, parameter: &str, value: Value, unit: &str, quality: &str) {
        if let Some(on_sample) = &mut self.on_sample {
            on_sample(json!({
                "time": self.seconds,
                "parameter": parameter,
                "value": value,
                "unit": unit,
                "quality": quality,
            }));
        }
    }
}

impl Sink for Printer<'_> {
    fn signal(&mut self, signal: Signal) {
        if self.on_sample.is_none() {
            return;
        }
        let name = signal.parameter.spec().name;
        let unit = name.rsplit('_').next().unwrap_or_default();
        let quality = signal.value.map_or_else(Invalid::name, |_| "good");
        self.print(name, json!(signal.value.ok()), unit, quality);
    }

    fn traffic(&mut self, traffic: &Traffic) {
        if self.on_sample.is_some() {
            self.print("traffic", traffic_json(traffic), "", "good");
        }
    }

    fn limit(&mut self, limit: &Limit) {
        let name = limit.parameter.spec().name;
        let unit = name.rsplit('_').next().unwrap_or_default();
        // Never under the parameter's own name: a limit is not its value.
        let value = json!({ "of": name, "kind": limit.kind, "value": limit.value });
        self.print("limit", value, unit, "good");
    }
}

fn traffic_json(traffic: &Traffic) -> Value {
    let mut value = match traffic.place {
        Place::Geodetic {
            latitude_rad,
            longitude_rad,
            pressure_altitude_m,
        } => json!({
            "latitude_rad": latitude_rad, "longitude_rad": longitude_rad,
            "pressure_altitude_m": pressure_altitude_m,
        }),
        Place::Relative {
            north_m,
            east_m,
            up_m,
        } => json!({ "north_m": north_m, "east_m": east_m, "up_m": up_m }),
        Place::Around { distance_m, up_m } => json!({ "distance_m": distance_m, "up_m": up_m }),
        Place::Bearing {
            bearing_relative_rad,
            distance_m,
            up_m,
        } => json!({
            "bearing_relative_rad": bearing_relative_rad, "distance_m": distance_m, "up_m": up_m,
        }),
    };
    let callsign = String::from_utf8_lossy(&traffic.callsign);
    value["address"] = json!(traffic.address.map(|a| format!("{a:06X}")));
    value["callsign"] = json!(callsign.trim());
    value["track_rad"] = json!(traffic.track_rad);
    value["ground_speed_mps"] = json!(traffic.ground_speed_mps);
    value["vertical_speed_mps"] = json!(traffic.vertical_speed_mps);
    value["airborne"] = json!(traffic.airborne);
    value["alert"] = json!(match traffic.alert {
        Alert::None => "none",
        Alert::Low => "low",
        Alert::Important => "important",
        Alert::Urgent => "urgent",
    });
    value
}
