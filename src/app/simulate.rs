//! `glasswing simulate`: bench traffic. A flight profile as the frames of a real box, with faults.

use crate::app::decode::{self, protocol_parser};
use crate::app::error::{Failure, Kind};
use crate::app::out::say;
use crate::app::run::{seconds, stop_on_signals};
use crate::bench::encode::{self, Encoder, fg_generic::FgGeneric};
use crate::bench::fault::Fault;
use crate::bench::profile::{DEMO, Profile};
use crate::bench::{Bench, Truth};
use crate::bus::{BusError, can, serial};
use crate::proto::Protocol;
use crate::signal::Wire;
use crate::time::Monotonic;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;
use std::fs::File;
use std::io::{self, BufWriter, Write as _};
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// How often it is looked whether to stop.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// Sends a flight profile as real frames, with faults
///
/// The frames of every message come at the rates of real boxes, by the monotonic clock, until the profile ends, --seconds are
/// over or the command is interrupted. What was sent is told on stderr, or as JSON.
///
/// FILE is TOML; `--profile demo` is one that comes with the program, with every key explained: boards/profile-demo.toml in
/// the source, and `--profile demo --print` prints it.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Faults, KIND@SECONDS[-SECONDS][:PARAMETER], from the first time until the second or for good:\n  \
    stop, freeze, jump, nan, sentinel, out-of-range, noise: of values; with :PARAMETER (pitch, indicated_airspeed, ... as\n    \
    `decode --samples` names them, the unit may be left out) of that one only; stop without is silence\n  \
    bit-flips (a bit of one frame in four), duplicates, reordering (successive frames change places): of frames\n  \
    babble: another sender fills the bus; wrong-node, bus-off (virtual interfaces also tell their listeners): on CAN\n\n\
    Examples:\n  \
    glasswing simulate --profile demo --as can-fix --to can:vcan0\n  \
    glasswing simulate --profile demo --as fgfdm --to udp:127.0.0.1:5500 --fault nan@20-25:pitch --fault stop@40\n  \
    glasswing simulate --profile flight.toml --as dynon-skyview --to serial:/dev/ttyUSB0 --baud 115200\n  \
    glasswing simulate --profile demo --as gdl90 --to file:gdl90.bin --seconds 60"
)]
pub struct SimulateArgs {
    /// The flight profile, or `demo`
    #[arg(long, value_name = "FILE")]
    profile: PathBuf,
    /// The protocol
    #[arg(long = "as", value_name = "PROTOCOL", value_parser = protocol_parser(), required_unless_present = "print")]
    protocol: Option<Protocol>,
    /// Where to: can:INTERFACE, serial:PORT, udp:ADDRESS:PORT, or file:PATH for a capture as `glasswing decode` reads it
    #[arg(long, value_name = "WHERE", required_unless_present = "print")]
    to: Option<To>,
    /// So many times as fast as in flight
    #[arg(long, value_name = "X", default_value = "1", value_parser = rate)]
    rate: f64,
    /// What goes wrong and when; any number of them
    #[arg(long = "fault", value_name = "KIND@SECONDS[-SECONDS][:PARAMETER]")]
    faults: Vec<String>,
    /// End after so many seconds of the profile
    #[arg(long, value_name = "S", value_parser = seconds)]
    seconds: Option<Duration>,
    /// The speed of a serial port; also how much `babble` sends, with --bit-rate for CAN
    #[arg(long, value_name = "BITS", default_value_t = 115_200, value_parser = clap::value_parser!(u32).range(50..=4_000_000))]
    baud: u32,
    /// The speed of the CAN bus, which is the interface's own: how much `babble` sends
    #[arg(long, value_name = "BITS", default_value_t = 1_000_000, value_parser = clap::value_parser!(u32).range(10_000..=1_000_000))]
    bit_rate: u32,
    /// For fg-generic: FlightGear's protocol file by which the receiver reads, unless it is the one that comes with Glasswing
    #[arg(long, value_name = "XML")]
    layout: Option<PathBuf>,
    /// For noise and bit-flips: the same seed gives the same frames
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Print the figures as one JSON document
    #[arg(long)]
    json: bool,
    /// Print the profile instead of sending it
    #[arg(long)]
    print: bool,
}

/// Where frames go.
#[derive(Clone, Debug, PartialEq, Eq)]
enum To {
    Can(String),
    Serial(String),
    Udp(SocketAddr),
    File(PathBuf),
}

impl FromStr for To {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let known = "give can:vcan0, serial:/dev/ttyUSB0, udp:127.0.0.1:5500 or file:PATH";
        match text.split_once(':') {
            Some(("can", name)) if !name.is_empty() => Ok(Self::Can(name.to_owned())),
            Some(("serial", path)) if !path.is_empty() => Ok(Self::Serial(path.to_owned())),
            Some(("file", path)) if !path.is_empty() => Ok(Self::File(path.into())),
            Some(("udp", address)) => address
                .parse()
                .map(Self::Udp)
                .map_err(|e| format!("{e}: give an address and a port, as in udp:127.0.0.1:5500")),
            _ => Err(known.to_owned()),
        }
    }
}

fn rate(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|x| (0.01..=1000.0).contains(x))
        .ok_or_else(|| "give 0.01 to 1000, as in 2 for twice as fast".to_owned())
}

/// Runs the command.
///
/// # Errors
/// A profile, a fault or a combination that cannot be; a device that refuses.
pub fn run(args: SimulateArgs) -> Result<(), Failure> {
    let text = profile_text(&args)?;
    let profile = parse(&args, &text)?;
    let (Some(protocol), Some(to), false) = (args.protocol, &args.to, args.print) else {
        say!("{}", text.trim_end());
        return Ok(());
    };
    let encoder = encoder(protocol, &args)?;
    let is_can = encoder.is_on_can();
    check_way(protocol, is_can, to)?;
    let mut bench = Bench::new(encoder, faults(&args)?, args.seed).map_err(|e| {
        let faults = args.faults.join(" ");
        Failure::new(Kind::Usage, format!("--fault {faults}"), &e, e.todo())
    })?;
    bench.set_bit_rate(if is_can { args.bit_rate } else { args.baud });
    let stop = stop_on_signals()?;
    let mut way = Way::open(to, args.baud, is_can)?;
    let end = profile.flight.duration();
    let end = args.seconds.map_or(end, |s| s.min(end));
    let figures = send(&profile, &mut bench, &mut way, end, args.rate, &stop);
    let figures = way.close().and(figures)?;
    tell(&args, protocol, to, &figures);
    Ok(())
}

fn profile_text(args: &SimulateArgs) -> Result<String, Failure> {
    if args.profile.as_os_str() == "demo" {
        return Ok(DEMO.to_owned());
    }
    std::fs::read_to_string(&args.profile).map_err(|e| {
        let todo = "name a flight profile, or demo";
        Failure::new(Kind::Input, args.profile.display(), &e, todo)
    })
}

fn parse(args: &SimulateArgs, text: &str) -> Result<Profile, Failure> {
    Profile::parse(text).map_err(|e| {
        let what = format!("{}: {}", args.profile.display(), e.key);
        Failure::new(Kind::Usage, what, &e.why, &e.todo)
    })
}

fn encoder(protocol: Protocol, args: &SimulateArgs) -> Result<Box<dyn Encoder>, Failure> {
    let Some(file) = &args.layout else {
        return Ok(encode::encoder(protocol));
    };
    let text = decode::layout_text(protocol, file)?;
    let encoder = FgGeneric::new(&text)
        .map_err(|e| Failure::new(Kind::Input, file.display(), &e, e.todo()))?;
    Ok(Box::new(encoder))
}

fn faults(args: &SimulateArgs) -> Result<Vec<Fault>, Failure> {
    let one = |text: &String| {
        Fault::parse(text)
            .map_err(|e| Failure::new(Kind::Usage, format!("--fault {text}"), &e, e.todo()))
    };
    args.faults.iter().map(one).collect()
}

/// A bus that the protocol does not travel on.
fn check_way(protocol: Protocol, is_can: bool, to: &To) -> Result<(), Failure> {
    let (fits, instead) = match to {
        To::File(_) => (true, ""),
        To::Can(_) => (is_can, "send it to serial:PORT or udp:ADDRESS:PORT"),
        To::Udp(_) => (!is_can, "send it to can:INTERFACE"),
        To::Serial(_) if protocol == Protocol::FgFdm => (false, "send it to udp:ADDRESS:PORT"),
        To::Serial(_) => (!is_can, "send it to can:INTERFACE"),
    };
    if fits {
        return Ok(());
    }
    let why = format!("{} does not travel so", protocol.name());
    Err(Failure::new(Kind::Usage, "--to", why, instead))
}

/// What was sent.
#[derive(Clone, Copy, Debug, Default)]
struct Figures {
    /// Of the profile.
    flown: Duration,
    frames: u64,
    bytes: u64,
    /// Frames that nobody took: no room, no listener, no bus.
    dropped: u64,
    /// The most that frames were sent after their time.
    late_max: Duration,
}

/// Sends until `end` of the profile.
fn send(
    profile: &Profile,
    bench: &mut Bench,
    way: &mut Way,
    end: Duration,
    rate: f64,
    stop: &AtomicBool,
) -> Result<Figures, Failure> {
    let bar = progress_bar(end);
    let start = Monotonic::read();
    let mut figures = Figures::default();
    // Many messages and babble share a moment.
    let mut truth: (Duration, Truth) = (Duration::MAX, Truth::nothing());
    let mut was_off = false;
    while bench.next() <= end && !stop.load(Ordering::Acquire) {
        let now = bench.next();
        if way.is_paced() {
            let due = start.plus(now.div_f64(rate));
            if !wait_until(due, stop) {
                break;
            }
            let late = Monotonic::read().since(due).unwrap_or_default();
            figures.late_max = figures.late_max.max(late);
        }
        if truth.0 != now {
            truth = (now, profile.truth_at(now));
        }
        let mut failed = None;
        bench.step(&truth.1, &mut |wire| {
            figures.frames += 1;
            figures.bytes += u64::try_from(length(wire)).unwrap_or(0);
            match way.send(now, wire) {
                Ok(true) => {}
                Ok(false) => figures.dropped += 1,
                Err(e) => failed = Some(e),
            }
        });
        if bench.is_bus_off() != was_off {
            was_off = bench.is_bus_off();
            way.say_bus_off(now, was_off).map_err(|e| way.gone(e))?;
        }
        if let Some(e) = failed {
            return Err(way.gone(e));
        }
        figures.flown = now;
        bar.set_position(now.as_secs());
    }
    bar.finish_and_clear();
    Ok(figures)
}

fn length(wire: Wire<'_>) -> usize {
    match wire {
        Wire::Can(can) => can.bytes().len(),
        Wire::Datagram(bytes) | Wire::Stream(bytes) => bytes.len(),
    }
}

/// False when told to stop meanwhile.
fn wait_until(due: Monotonic, stop: &AtomicBool) -> bool {
    loop {
        let left = due.since(Monotonic::read()).unwrap_or_default();
        if stop.load(Ordering::Acquire) {
            return false;
        } else if left.is_zero() {
            return true;
        }
        std::thread::sleep(left.min(LOOK_EVERY));
    }
}

fn progress_bar(end: Duration) -> ProgressBar {
    // indicatif draws on stderr, and nothing where that is no terminal.
    let style = ProgressStyle::with_template("{wide_bar} {pos} of {len} s");
    let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(end.as_secs()).with_style(style)
}

#[expect(clippy::print_stderr, reason = "the command's figures for a person")]
fn tell(args: &SimulateArgs, protocol: Protocol, to: &To, figures: &Figures) {
    let Figures {
        flown,
        frames,
        bytes,
        dropped,
        late_max,
    } = figures;
    let (seconds, late_ms) = (flown.as_secs_f64(), late_max.as_secs_f64() * 1e3);
    if args.json {
        say!(
            "{}",
            json!({
                "protocol": protocol.name(), "seconds": seconds, "frames": frames, "bytes": bytes,
                "dropped": dropped, "late_ms_max": late_ms,
            })
        );
    } else {
        let to = match to {
            To::Can(name) => format!("can {name}"),
            To::Serial(path) => format!("serial {path}"),
            To::Udp(address) => format!("udp {address}"),
            To::File(path) => path.display().to_string(),
        };
        eprintln!(
            "{} to {to}: {seconds:.1} s of the profile, {frames} frames, {bytes} bytes, {dropped} not taken, at most \
             {late_ms:.1} ms late",
            protocol.name()
        );
    }
}

/// An open way out.
enum Way {
    Can(can::Sender, String),
    Serial(serial::Sender, String),
    Udp(UdpSocket, SocketAddr),
    File(BufWriter<File>, PathBuf),
}

impl Way {
    fn open(to: &To, baud: u32, is_can: bool) -> Result<Self, Failure> {
        match to {
            To::Can(name) => {
                let sender = can::Sender::open(name).map_err(refused)?;
                if can::is_up(name) == Some(false) {
                    let interface = name.clone();
                    return Err(refused(BusError::InterfaceDown { interface }));
                }
                Ok(Self::Can(sender, name.clone()))
            }
            To::Serial(path) => {
                let sender = serial::Sender::open(path, baud).map_err(refused)?;
                Ok(Self::Serial(sender, path.clone()))
            }
            To::Udp(address) => {
                let any = if address.is_ipv4() {
                    SocketAddr::from((Ipv4Addr::UNSPECIFIED, 0))
                } else {
                    SocketAddr::from((Ipv6Addr::UNSPECIFIED, 0))
                };
                let opened = UdpSocket::bind(any).and_then(|socket| {
                    socket.set_broadcast(true)?;
                    socket.connect(address)?;
                    Ok(socket)
                });
                let socket = opened.map_err(|e| {
                    let todo = "give an address that this machine can reach, `ip route` lists them";
                    Failure::new(Kind::Device, format!("udp {address}"), &e, todo)
                })?;
                Ok(Self::Udp(socket, *address))
            }
            To::File(path) => {
                let file = File::create(path).map_err(|e| not_written(path, &e))?;
                let mut file = BufWriter::new(file);
                if is_can {
                    let head = "# glasswing simulate\n";
                    file.write_all(head.as_bytes())
                        .map_err(|e| not_written(path, &e))?;
                }
                Ok(Self::File(file, path.clone()))
            }
        }
    }

    /// Whether frames wait for their time.
    const fn is_paced(&self) -> bool {
        !matches!(self, Self::File(..))
    }

    /// Sends a frame; false when nobody took it.
    fn send(&mut self, now: Duration, wire: Wire<'_>) -> io::Result<bool> {
        let sent = match (self, wire) {
            (Self::Can(sender, _), Wire::Can(can)) => sender.send(&can),
            (Self::Serial(sender, _), Wire::Datagram(bytes) | Wire::Stream(bytes)) => {
                sender.send(bytes)
            }
            (Self::Udp(socket, _), Wire::Datagram(bytes) | Wire::Stream(bytes)) => {
                socket.send(bytes).map(|_| ())
            }
            (Self::File(file, _), wire) => write(file, now, wire),
            _ => Ok(()),
        };
        match sent {
            Ok(()) => Ok(true),
            // A full queue, a listener that is not there, an interface that is switched off.
            Err(e)
                if matches!(
                    e.kind(),
                    io::ErrorKind::WouldBlock
                        | io::ErrorKind::ConnectionRefused
                        | io::ErrorKind::NetworkDown
                ) || e.raw_os_error() == Some(rustix::io::Errno::NOBUFS.raw_os_error()) =>
            {
                Ok(false)
            }
            Err(e) => Err(e),
        }
    }

    fn say_bus_off(&mut self, now: Duration, is_off: bool) -> io::Result<()> {
        match self {
            Self::Can(sender, _) => sender.say_bus_off(is_off),
            Self::File(file, _) => {
                let class = if is_off { "20000040" } else { "20000100" };
                writeln!(
                    file,
                    "({:.6}) can0 {class}#0000000000000000",
                    now.as_secs_f64()
                )
            }
            Self::Serial(..) | Self::Udp(..) => Ok(()),
        }
    }

    /// What has become of the device.
    fn gone(&self, e: io::Error) -> Failure {
        let (what, todo) = match self {
            Self::Can(_, name) => (format!("can {name}"), "make it again, and start anew"),
            Self::Serial(_, path) => (format!("serial {path}"), "plug it in, and start anew"),
            Self::Udp(_, address) => (format!("udp {address}"), "see `ip route`"),
            Self::File(_, path) => return not_written(path, &e),
        };
        Failure::new(Kind::Device, what, &e, todo)
    }

    fn close(self) -> Result<(), Failure> {
        match self {
            Self::File(mut file, path) => file.flush().map_err(|e| not_written(&path, &e)),
            _ => Ok(()),
        }
    }
}

fn refused(e: BusError) -> Failure {
    let failure = Failure::new(Kind::Device, e.what(), e.why(), e.todo());
    match e.into_source() {
        Some(source) => failure.caused_by(source),
        None => failure,
    }
}

fn not_written(path: &std::path::Path, e: &io::Error) -> Failure {
    let todo = "check the folder, its permissions and the space left";
    Failure::new(Kind::Other, path.display(), e, todo)
}

/// A frame as a capture has it: a line of a candump log, a record of a UDP container, or the bytes.
fn write(file: &mut impl io::Write, now: Duration, wire: Wire<'_>) -> io::Result<()> {
    match wire {
        Wire::Can(can) => {
            let id = if can.extended {
                format!("{:08X}", can.id)
            } else {
                format!("{:03X}", can.id)
            };
            let data: String = can.bytes().iter().map(|b| format!("{b:02X}")).collect();
            writeln!(file, "({:.6}) can0 {id}#{data}", now.as_secs_f64())
        }
        Wire::Datagram(bytes) => {
            file.write_all(&now.as_secs_f64().to_le_bytes())?;
            let length = u32::try_from(bytes.len()).unwrap_or(u32::MAX);
            file.write_all(&length.to_le_bytes())?;
            file.write_all(bytes)
        }
        Wire::Stream(bytes) => file.write_all(bytes),
    }
}
