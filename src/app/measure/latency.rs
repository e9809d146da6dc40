//! `measure latency`: how long a value takes from its receipt to the state and to the screen, and what a full bus costs.
//!
//! Everything on the way is what flies: sockets, a pseudoterminal as serial line, the bus threads, rings, fusion, display and
//! renderer on a headless screen. Only the senders are this command's own.

use super::talk::{self, Talker};
use super::{Progress, not_written, prepare};
use crate::app::board::Board;
use crate::app::cockpit::{self, Cockpit};
use crate::app::error::{Failure, Kind};
use crate::app::figures::Histogram;
use crate::app::fly::{self, Plan};
use crate::app::health::Pulse;
use crate::app::intake::Intake;
use crate::app::out;
use crate::app::picture::Size;
use crate::app::shot::{self, Backend};
use crate::app::sources;
use crate::bus::{Endpoint, SourceThread, can, loopback};
use crate::heap;
use crate::proto::Protocol;
use crate::signal::{Parameter, SourceId};
use crate::time::Monotonic;
use rustix::fd::OwnedFd;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// The CAN interface that is used if it is there and up.
const VCAN: &str = "vcan0";
/// Frames on their way on the bus within the process.
const LOOPBACK_FRAMES: usize = 4096;
/// Frames a second on a full 1 Mbit/s bus: each with an 11-bit identifier and 8 bytes of data has 111 bits (Bosch CAN 2.0,
/// part A, section 3.1, with 3 bits between frames and no stuffing).
const FULL_BUS_HZ: u32 = 9009;
/// How often the state is asked for where its age is measured.
const ASK_EVERY: Duration = Duration::from_micros(100);
/// Frames a second of the display.
const FRAME_HZ: u32 = 60;

/// Arguments of `measure latency`.
#[derive(Debug, clap::Args)]
pub struct LatencyArgs {
    /// Terrain behind the instruments
    #[arg(long, value_name = "PACK")]
    pack: Option<PathBuf>,
    /// Write all figures to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Seconds of each measurement
    #[arg(long, value_name = "S", default_value_t = 10.0, value_parser = super::parse_positive)]
    seconds: f64,
    /// Size of the picture
    #[arg(long, value_name = "WxH", default_value = "1024x600")]
    size: Size,
    /// What draws
    #[arg(long, value_enum, default_value_t = Backend::Surfaceless)]
    backend: Backend,
}

/// A source with its sender.
struct Line {
    protocol: Protocol,
    bus: &'static str,
    rate_hz: u32,
    intake: Intake,
    thread: SourceThread,
    _talker: Talker,
}

/// Runs the command.
///
/// # Errors
/// No screen or bus (4), a file that cannot be written (1).
pub fn run(args: &LatencyArgs) -> Result<(), Failure> {
    if let Some(path) = &args.json {
        prepare(path, false)?;
    }
    let mut board = Board::base().map_err(|mut all| all.swap_remove(0))?;
    board.screen.size = args.size;
    board.screen.samples = 0;
    let mut screen = shot::open(args.backend, args.size)?;
    let pack = args.pack.as_deref().map(cockpit::open_pack).transpose()?;
    let mut cockpit = Cockpit::new(screen.as_ref(), &board, pack)?;
    let wall = Duration::from_secs_f64(args.seconds.clamp(0.1, 600.0));
    let progress = Progress::new();
    let mut rows = Vec::new();
    for open in [over_udp, over_serial, over_can] {
        let mut line = open()?;
        progress.say(&format!("{} over {}", line.protocol.name(), line.bus));
        let to_state = age_in_state(&mut line.intake, wall / 2);
        let plan = Plan {
            stop: Arc::new(AtomicBool::new(false)),
            duration: Some(wall),
            headless_period: Duration::from_secs(1) / FRAME_HZ,
            frames: None,
            pulse: Arc::new(Pulse::default()),
            started: Monotonic::read(),
        };
        let Line { intake, .. } = &mut line;
        let flown = fly::fly(
            screen.as_mut(),
            &mut cockpit,
            plan,
            |_| (),
            |now| intake.step(now),
        )?;
        let flown = flown.to_json();
        rows.push(json!({
            "name": line.protocol.name(), "bus": line.bus, "rate_hz": line.rate_hz,
            "receive_to_present_ms": flown["receive_to_present_ms"][0],
            "receive_to_state_ms": to_state.to_json(),
            "frame_ms": flown["frame_ms"],
            "dropped": line.thread.figures().snapshot().dropped,
        }));
    }
    progress.say("a full bus");
    let value = json!({
        "how": "senders in this process, a period each; from the bus thread's stamp at receipt to the finished picture that \
                shows the value first, and to the state where that is asked for every 0.1 ms; a pseudoterminal has no speed: \
                a real line adds ten bits a byte before the receipt",
        "sources": rows,
        "load": load(wall)?,
        "screen": screen.describe(), "renderer": cockpit.describe(), "size_px": args.size.to_string(),
        "frame_hz": FRAME_HZ, "optimised": !cfg!(debug_assertions),
    });
    progress.bar.finish_and_clear();
    out::write(format_args!("{}", table(&value)));
    match &args.json {
        Some(path) => {
            std::fs::write(path, format!("{value:#}\n")).map_err(|e| not_written(path, e))
        }
        None => Ok(()),
    }
}

/// How old values are when the state has them, for so long.
fn age_in_state(intake: &mut Intake, wall: Duration) -> Histogram {
    const LOOKED_AT: [Parameter; 3] = [
        Parameter::Pitch,
        Parameter::IndicatedAirspeed,
        Parameter::CalibratedAirspeed,
    ];
    let mut ages = Histogram::new();
    let mut seen = [None; LOOKED_AT.len()];
    let start = Monotonic::read();
    loop {
        let now = Monotonic::read();
        if now.since(start).is_some_and(|t| t >= wall) {
            return ages;
        }
        let state = intake.step(now);
        let there = Monotonic::read();
        for (parameter, seen) in LOOKED_AT.into_iter().zip(&mut seen) {
            let at = state.at(parameter);
            if let (Ok(_), Some(received)) = (state.read(parameter, now), at)
                && *seen != at
            {
                *seen = at;
                ages.add(there.since(received).unwrap_or_default());
            }
        }
        std::thread::sleep(ASK_EVERY);
    }
}

fn over_udp() -> Result<Line, Failure> {
    const RATE_HZ: u32 = 60;
    let (source, sender, address) = udp("udp", SourceId(0))?;
    let talker = Talker::start(Duration::from_secs(1) / RATE_HZ, move |k| {
        // What the system does not take is not received either.
        let _ = sender.send_to(&talk::fdm(k), address);
    })?;
    Ok(Line {
        protocol: Protocol::FgFdm,
        bus: "UDP",
        rate_hz: RATE_HZ,
        intake: Intake::new([source.signals], sources::fusion([Protocol::FgFdm])),
        thread: source.thread,
        _talker: talker,
    })
}

fn udp(
    name: &str,
    id: SourceId,
) -> Result<(crate::bus::SourceHandle, UdpSocket, SocketAddr), Failure> {
    let free = || UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).and_then(|s| Ok((s.local_addr()?, s)));
    let refused = |e| {
        Failure::new(
            Kind::Device,
            "udp 127.0.0.1",
            "no port is free",
            "stop other programs",
        )
        .caused_by(e)
    };
    let (address, holder) = free().map_err(refused)?;
    drop(holder);
    let source = sources::listen_udp(name, id, Protocol::FgFdm, address, vec![])?;
    let (_, sender) = free().map_err(refused)?;
    Ok((source, sender, address))
}

fn over_serial() -> Result<Line, Failure> {
    const RATE_HZ: u32 = 16;
    let protocol = Protocol::DynonSkyView;
    let (far, path) = pty().map_err(|e| {
        let todo = "mount /dev/pts";
        Failure::new(
            Kind::Device,
            "a pseudoterminal",
            "the system refuses it",
            todo,
        )
        .caused_by(e)
    })?;
    let source = sources::listen_serial("serial", SourceId(0), protocol, &path, 115_200)?;
    let talker = Talker::start(Duration::from_secs(1) / RATE_HZ, move |k| {
        // What the line does not take is not received either.
        let _ = rustix::io::write(&far, talk::skyview(k).as_bytes());
    })?;
    Ok(Line {
        protocol,
        bus: "a serial line",
        rate_hz: RATE_HZ,
        intake: Intake::new([source.signals], sources::fusion([protocol])),
        thread: source.thread,
        _talker: talker,
    })
}

/// The far end of a line, and the path of its near end.
fn pty() -> std::io::Result<(OwnedFd, String)> {
    let far = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
    grantpt(&far)?;
    unlockpt(&far)?;
    let path = ptsname(&far, Vec::new())?;
    Ok((far, path.to_string_lossy().into_owned()))
}

fn over_can() -> Result<Line, Failure> {
    const RATE_HZ: u32 = 400;
    can_line(RATE_HZ, SourceId(0))
}

/// CANaerospace at so many frames a second, on the interface if there is one.
fn can_line(rate_hz: u32, id: SourceId) -> Result<Line, Failure> {
    let protocol = Protocol::CanAerospace;
    let period = Duration::from_secs(1) / rate_hz;
    let (source, talker, bus);
    if can::is_up(VCAN) == Some(true) {
        source = sources::listen_can("can", id, protocol, VCAN)?;
        let sender = can::Sender::open(VCAN)?;
        bus = "vcan0";
        talker = Talker::start(period, move |k| {
            // What the interface does not take is not received either.
            let _ = talk::canaerospace(k).map(|can| sender.send(&can));
        })?;
    } else {
        let (mut sender, receiver) = loopback::bus(LOOPBACK_FRAMES);
        source = sources::listen("can", id, protocol, Endpoint::Loopback(receiver))?;
        bus = "a CAN bus within the process";
        talker = Talker::start(period, move |k| {
            let _ = talk::canaerospace(k).map(|can| sender.send(Monotonic::read(), can));
        })?;
    }
    Ok(Line {
        protocol,
        bus,
        rate_hz,
        intake: Intake::new([source.signals], sources::fusion([protocol])),
        thread: source.thread,
        _talker: talker,
    })
}

/// What a full CAN bus and 60 Hz of UDP cost together.
fn load(wall: Duration) -> Result<Value, Failure> {
    let mut line = can_line(FULL_BUS_HZ, SourceId(0))?;
    let (udp, sender, address) = udp("udp", SourceId(0))?;
    let mut udp_intake = Intake::new([udp.signals], sources::fusion([Protocol::FgFdm]));
    let talker = Talker::start(Duration::from_secs(1) / FRAME_HZ, move |k| {
        let _ = sender.send_to(&talk::fdm(k), address);
    })?;
    // Until everything runs.
    for _ in 0..FRAME_HZ / 2 {
        let _ = (
            line.intake.step(Monotonic::read()),
            udp_intake.step(Monotonic::read()),
        );
        std::thread::sleep(Duration::from_secs(1) / FRAME_HZ);
    }
    let frames = |thread: &SourceThread| thread.figures().snapshot().frames();
    let counted = || (frames(&line.thread), frames(&udp.thread));
    let (start, before) = (Monotonic::read(), counted());
    let used = || (thread_cpu("bus-can"), thread_cpu("bus-udp"), own_cpu());
    let (cpu, allocated) = (used(), heap::allocations_of_this_thread());
    let mut next = start;
    while next.since(start).is_some_and(|t| t < wall) {
        let now = Monotonic::read();
        let _ = (line.intake.step(now), udp_intake.step(now));
        next = next.plus(Duration::from_secs(1) / FRAME_HZ);
        std::thread::sleep(next.since(Monotonic::read()).unwrap_or_default());
    }
    let (ended, after) = (Monotonic::read(), used());
    let allocations = heap::allocations_of_this_thread() - allocated;
    let counts = counted();
    let seconds = ended.since(start).unwrap_or_default().as_secs_f64();
    let percent = |before: Option<Duration>, after: Option<Duration>| {
        let used = after?.checked_sub(before?)?;
        Some(used.as_secs_f64() / seconds * 100.0)
    };
    let parts = [
        percent(cpu.0, after.0),
        percent(cpu.1, after.1),
        percent(cpu.2, after.2),
    ];
    let all: Option<f64> = parts.into_iter().sum();
    #[expect(clippy::cast_precision_loss, reason = "counts of some seconds")]
    let per_second = |n: u64| (n as f64 / seconds).round();
    let to_state = age_in_state(&mut line.intake, wall / 2);
    drop(talker);
    Ok(json!({
        "how": "CPU time that the system counts for the threads of both buses, and for this one, which takes in what they say \
                and makes the state 60 times a second for each; senders left out",
        "bus": line.bus,
        "can_frames_per_s": per_second(counts.0 - before.0), "udp_packets_per_s": per_second(counts.1 - before.1),
        "percent_of_core": all, "can_thread_percent": parts[0], "udp_thread_percent": parts[1], "state_percent": parts[2],
        "receive_to_state_ms": to_state.to_json(),
        "dropped": line.thread.figures().snapshot().dropped, "allocations_taking_in": allocations,
    }))
}

/// CPU time of the calling thread.
fn own_cpu() -> Option<Duration> {
    let t = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    Some(Duration::new(
        u64::try_from(t.tv_sec).ok()?,
        u32::try_from(t.tv_nsec).ok()?,
    ))
}

/// CPU time of a thread of this process by its name, as the scheduler counts it; None where the kernel does not tell.
fn thread_cpu(name: &str) -> Option<Duration> {
    let tasks = std::fs::read_dir("/proc/self/task").ok()?.flatten();
    let read = |path: &Path, file: &str| std::fs::read_to_string(path.join(file)).ok();
    let path = tasks
        .map(|task| task.path())
        .find(|path| read(path, "comm").is_some_and(|comm| comm.trim() == name))?;
    let nanos = read(&path, "schedstat")?.split(' ').next()?.parse().ok()?;
    Some(Duration::from_nanos(nanos))
}

/// The figures as text for people. Writing to a text cannot fail.
fn table(value: &Value) -> String {
    let mut out = String::new();
    let times = |value: &Value| {
        let ms = |key: &str| value[key].as_f64().unwrap_or(f64::NAN);
        format!(
            "p50 {:7.2}  p99 {:7.2}  max {:7.2} ms",
            ms("p50"),
            ms("p99"),
            ms("max")
        )
    };
    for row in value["sources"].as_array().into_iter().flatten() {
        let text = |key: &str| row[key].as_str().unwrap_or_default();
        let _ = writeln!(
            out,
            "{} over {}, {} Hz",
            text("name"),
            text("bus"),
            row["rate_hz"]
        );
        for (group, ways) in row["receive_to_present_ms"]
            .as_object()
            .into_iter()
            .flatten()
        {
            let _ = writeln!(out, "  {group:10} to the screen  {}", times(ways));
        }
        let _ = writeln!(
            out,
            "  {:10} to the state   {}",
            "",
            times(&row["receive_to_state_ms"])
        );
        let _ = writeln!(
            out,
            "  {:10} a frame        {}",
            "",
            times(&row["frame_ms"])
        );
    }
    let load = &value["load"];
    let percent = |key: &str| load[key].as_f64().unwrap_or(f64::NAN);
    let _ = writeln!(
        out,
        "{} CAN frames and {} UDP packets a second over {}: {:.2} % of a core (CAN {:.2}, UDP {:.2}, state {:.2})",
        load["can_frames_per_s"],
        load["udp_packets_per_s"],
        load["bus"].as_str().unwrap_or_default(),
        percent("percent_of_core"),
        percent("can_thread_percent"),
        percent("udp_thread_percent"),
        percent("state_percent"),
    );
    let _ = writeln!(
        out,
        "  {:10} to the state   {}",
        "",
        times(&load["receive_to_state_ms"])
    );
    let _ = writeln!(out, "  {}", load["how"].as_str().unwrap_or_default());
    let _ = writeln!(
        out,
        "{}, {}: {}",
        value["renderer"].as_str().unwrap_or_default(),
        value["size_px"].as_str().unwrap_or_default(),
        value["how"].as_str().unwrap_or_default()
    );
    out
}
