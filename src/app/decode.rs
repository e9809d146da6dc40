//! `glasswing decode`: what a capture holds, and what is wrong with it.
#![expect(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "the command's output, and its notes on a damaged file"
)]

use super::error::{Failure, Kind};
use crate::proto::capture::{CandumpLine, CaptureError, UdpCapture};
use crate::proto::{Counters, Decoder, Fault, Protocol};
use crate::signal::{Frame, Signal, SourceId, Wire};
use crate::time::Monotonic;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Decode a capture of bus traffic and say what is good, bad and ignored in it.
///
/// FILE is a UDP capture container ([f64 little-endian seconds][u32 little-endian length][payload]...) for fgfdm, and a
/// candump log (as `candump -l` writes it) for canaerospace.
///
/// Every frame is counted once: as good, as bad under one kind, or as ignored (somebody else's traffic). A container that
/// ends inside a record is decoded up to there and counted as `truncated`; a line that is no candump line as `malformed`.
#[derive(Clone, Debug, clap::Args)]
#[command(
    after_help = "Example:\n  glasswing decode --as fgfdm flight.bin --json\n  glasswing decode --as canaerospace candump.log --samples"
)]
pub struct DecodeArgs {
    /// The protocol of the capture.
    #[arg(long = "as", value_name = "PROTOCOL", value_parser = protocol_parser())]
    pub protocol: Protocol,
    /// The capture.
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Print each sample as a JSON line: time (seconds, as in the capture), parameter, value (null when there is none), unit,
    /// quality (`good`, or why there is no value). With --json the samples are an array `samples` of the one document.
    #[arg(long)]
    pub samples: bool,
    /// Print one JSON document: good, bad {kind: count}, ignored, flow {lost, repeated, frozen, failed}.
    #[arg(long)]
    pub json: bool,
}

fn protocol_parser() -> impl TypedValueParser<Value = Protocol> {
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
    let mut samples = Vec::new();
    let mut on_sample = |sample: Value| {
        if args.json {
            samples.push(sample);
        } else {
            println!("{sample}");
        }
    };
    let outcome = decode(
        &args.file,
        &bytes,
        args.protocol,
        args.samples.then_some(&mut on_sample),
    )?;
    if let Some(damage) = outcome.damage {
        eprintln!(
            "glasswing: {}: {damage} (what comes before it was decoded; record it again)",
            args.file.display()
        );
    }
    if args.json {
        let mut document = outcome.to_json();
        if args.samples {
            document.insert("samples".to_owned(), Value::Array(samples));
        }
        println!("{}", Value::Object(document));
    } else if !args.samples {
        print!("{}", outcome.to_text());
    }
    Ok(())
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
            json!({ "lost": flow.lost, "repeated": flow.repeated, "frozen": flow.frozen, "failed": flow.failed }),
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
            "flow     {} lost, {} repeated, {} frozen, {} failed\n",
            flow.lost, flow.repeated, flow.frozen, flow.failed
        )
    }
}

fn decode(
    path: &Path,
    bytes: &[u8],
    protocol: Protocol,
    on_sample: Option<OnSample<'_>>,
) -> Result<Outcome, Failure> {
    let mut run = Run {
        decoder: protocol.decoder(),
        on_sample,
    };
    let mut outcome = Outcome {
        counters: Counters::default(),
        truncated: 0,
        malformed: 0,
        without_data: 0,
        damage: None,
    };
    match protocol {
        Protocol::FgFdm => read_container(path, bytes, &mut run, &mut outcome)?,
        Protocol::CanAerospace => read_candump(path, bytes, &mut run, &mut outcome)?,
    }
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
            Ok((seconds, payload)) => run.push(seconds, Wire::Datagram(payload)),
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
                run.push(seconds, Wire::Can(can));
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
    fn push(&mut self, seconds: f64, wire: Wire<'_>) {
        let at = Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX);
        let frame = Frame {
            at: Monotonic::from_nanos(0).plus(at),
            source: SourceId(0),
            wire,
        };
        let on_sample = &mut self.on_sample;
        self.decoder.push(frame, &mut |signal| {
            if let Some(on_sample) = on_sample {
                on_sample(sample(seconds, &signal));
            }
        });
    }
}

fn sample(seconds: f64, signal: &Signal) -> Value {
    let name = signal.parameter.spec().name;
    let unit = name.rsplit('_').next().unwrap_or_default();
    let quality = signal.value.map_or_else(|reason| reason.name(), |_| "good");
    json!({
        "time": seconds,
        "parameter": name,
        "value": signal.value.ok(),
        "unit": unit,
        "quality": quality,
    })
}
