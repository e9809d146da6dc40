//! `glasswing check --sniff`: listens, names what is spoken where, and prints the lines for the board file.
//!
//! All places are listened to at the same time, each by a thread of its own. A serial port is tried at the usual speeds, the
//! likeliest first, until something is understood; a line on which nothing at all comes is not tried at others, for bytes
//! come at any speed, if only as nonsense. The bit rate of a CAN interface cannot be changed without privileges: it is told, and
//! whether the interface complains. What is recognised is judged by [`crate::proto::sniff`].

mod report;

use crate::app::board::{self, Board};
use crate::app::error::{Failure, Kind};
use crate::app::{list, ports};
use crate::bus::{self, BusError, Endpoint, Event, SourceConfig, SourceHandle, Tally};
use crate::limits::DATAGRAM_BYTES_MAX;
use crate::proto::sniff::{Sniffer, Verdict};
use crate::signal::{SourceId, Wire};
use crate::time::Monotonic;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::Path;
use std::process::Command;
use std::str::FromStr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Speeds of serial lines, the likeliest first: Dynon, Garmin, MGL and newer receivers; FLARM and older receivers; what can be
/// set besides; NMEA 0183's own; the fastest of receivers.
const SPEEDS: [u32; 7] = [115_200, 9600, 38_400, 19_200, 57_600, 4800, 230_400];

/// Ports that are usual: NMEA as XCSoar listens for it, GDL90, FlightGear as `boards/headless.toml` has it, NMEA over UDP,
/// X-Plane.
const UDP_PORTS: [u16; 5] = [2000, 4000, 5500, 10_110, 49_000];

/// So sure, with so many frames, nothing is gained by listening on.
const SURE: f64 = 0.9;
const SURE_FRAMES: u64 = 20;
/// So sure a speed is the right one.
const SPEED_SURE: f64 = 0.5;
/// How often a thread looks whether it is sure.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// Where to listen, for how long, and how to tell.
#[derive(Debug, clap::Args)]
pub struct ListenArgs {
    /// With --sniff: listen here; may be given several times. serial:/dev/ttyUSB0, can:can0, udp:4000 (all addresses of this
    /// machine) or udp:ADDRESS:PORT
    #[arg(long, value_name = "PLACE", requires = "sniff")]
    on: Vec<Place>,
    /// With --sniff: how long to listen, at each speed of a serial port, if nothing is recognised before
    #[arg(long, value_name = "S", default_value_t = 3.0, requires = "sniff")]
    seconds: f64,
    /// With --sniff: print one JSON document
    #[arg(long, requires = "sniff")]
    json: bool,
}

/// Where something may be heard.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// A serial port, by its path.
    Serial(String),
    /// A CAN interface, by its name.
    Can(String),
    /// An address and port.
    Udp(SocketAddr),
}

impl FromStr for Place {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (kind, rest) = text.split_once(':').unwrap_or(("", text));
        let whole_machine = |port: u16| SocketAddr::from((Ipv4Addr::UNSPECIFIED, port));
        match kind {
            "serial" if rest.starts_with('/') => Ok(Self::Serial(rest.to_owned())),
            "can" if !rest.is_empty() => Ok(Self::Can(rest.to_owned())),
            "udp" => {
                let port = rest.parse().ok().map(whole_machine);
                let address = port.or_else(|| rest.parse().ok());
                let address = address.filter(|a| a.port() != 0);
                address.map(Self::Udp).ok_or_else(|| {
                    format!("`{rest}` is neither a port from 1 to 65535 nor ADDRESS:PORT")
                })
            }
            _ => Err("write serial:/dev/…, can:INTERFACE or udp:PORT".to_owned()),
        }
    }
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Serial(path) => write!(f, "serial {path}"),
            Self::Can(interface) => write!(f, "can {interface}"),
            Self::Udp(address) => write!(f, "udp {address}"),
        }
    }
}

impl From<&board::Endpoint> for Place {
    fn from(endpoint: &board::Endpoint) -> Self {
        match endpoint {
            board::Endpoint::Serial { path, .. } => Self::Serial(path.clone()),
            board::Endpoint::Can { interface } => Self::Can(interface.clone()),
            board::Endpoint::Udp { bind, .. } => Self::Udp(*bind),
        }
    }
}

/// What came of listening somewhere.
#[derive(Debug)]
struct Told {
    place: Place,
    heard: Result<Heard, BusError>,
}

/// What was heard.
#[derive(Debug, Default)]
struct Heard {
    verdict: Verdict,
    /// Of a serial port: the speed at which it was heard.
    baud: Option<u32>,
    /// How many speeds were tried.
    speeds: usize,
    /// Of a CAN interface: its bit rate.
    bit_rate: Option<u64>,
    /// Of a CAN interface: whether it complains of what is on the bus.
    bus_errors: u64,
    /// Of a socket: who sent.
    senders: Vec<IpAddr>,
}

/// Runs the command.
///
/// # Errors
/// When there is nothing to listen to, or a place that was named cannot be listened to.
pub fn run(args: &ListenArgs, board: Option<&Board>) -> Result<(), Vec<Failure>> {
    let longest = Duration::try_from_secs_f64(args.seconds)
        .ok()
        .filter(|d| (0.1..=3600.0).contains(&d.as_secs_f64()))
        .ok_or_else(|| {
            let why = format!("{} is no time to listen", args.seconds);
            vec![Failure::new(
                Kind::Usage,
                "--seconds",
                why,
                "give 0.1 to 3600",
            )]
        })?;
    let is_asked = !args.on.is_empty() || board.is_some();
    let places = places(&args.on, board);
    if places.is_empty() {
        let why = "there is nothing to listen to";
        let todo = "add a source to the board file, or name a place with --on";
        return Err(vec![Failure::new(Kind::Usage, "check --sniff", why, todo)]);
    }
    let told = listen_everywhere(&places, longest).map_err(|f| vec![f])?;
    report::print(&told, args.json);
    let refused = told.into_iter().filter_map(|t| t.heard.err());
    let failures: Vec<Failure> = refused.filter(|_| is_asked).map(Failure::from).collect();
    if failures.is_empty() {
        Ok(())
    } else {
        Err(failures)
    }
}

/// Those named, else those of the board file, else all that there are.
fn places(named: &[Place], board: Option<&Board>) -> Vec<Place> {
    let mut places: Vec<Place> = match (named, board) {
        ([], Some(board)) => board.sources.iter().map(|s| (&s.endpoint).into()).collect(),
        ([], None) => {
            let serial = ports::all().into_iter();
            let serial = serial.map(|path| Place::Serial(path.display().to_string()));
            let can = list::can_names().into_iter().map(Place::Can);
            let udp = UDP_PORTS.map(|port| Place::Udp((Ipv4Addr::UNSPECIFIED, port).into()));
            serial.chain(can).chain(udp).collect()
        }
        (named, _) => named.to_vec(),
    };
    // Two sources of one bus are one place.
    let all = places.clone();
    let mut n = 0;
    places.retain(|place| {
        n += 1;
        !all[..n - 1].contains(place)
    });
    places
}

fn listen_everywhere(places: &[Place], longest: Duration) -> Result<Vec<Told>, Failure> {
    std::thread::scope(|scope| {
        let threads: Result<Vec<_>, _> = places
            .iter()
            .map(|place| {
                std::thread::Builder::new()
                    .name("sniff".to_owned())
                    .spawn_scoped(scope, move || listen(place, longest))
            })
            .collect();
        let threads = threads.map_err(Failure::no_thread)?;
        let told = threads
            .into_iter()
            .zip(places)
            .filter_map(|(thread, place)| {
                let heard = thread.join().ok()?;
                let place = place.clone();
                Some(Told { place, heard })
            });
        Ok(told.collect())
    })
}

fn listen(place: &Place, longest: Duration) -> Result<Heard, BusError> {
    match place {
        Place::Serial(path) => listen_serial(path, longest),
        Place::Can(interface) => listen_can(interface, longest),
        Place::Udp(address) => listen_udp(*address, longest),
    }
}

fn listen_serial(path: &str, longest: Duration) -> Result<Heard, BusError> {
    let mut best: Option<Heard> = None;
    let mut refused = None;
    for (n, baud) in SPEEDS.into_iter().enumerate() {
        let endpoint = Endpoint::Serial {
            path: path.to_owned(),
            baud,
        };
        let verdict = match listen_bus(endpoint, longest) {
            Ok((verdict, _)) => verdict,
            Err(e @ BusError::SpeedRefused { .. }) => {
                refused = Some(e);
                continue;
            }
            Err(e) => return Err(e),
        };
        let is_silent = verdict.heard == 0;
        let is_right = verdict.confidence() >= SPEED_SURE;
        let sure = |heard: &Heard| heard.verdict.confidence();
        let heard = Heard {
            baud: Some(baud),
            verdict,
            ..Heard::default()
        };
        if best.as_ref().is_none_or(|best| sure(&heard) > sure(best)) {
            best = Some(heard);
        }
        if let Some(best) = &mut best {
            best.speeds = n + 1;
        }
        if is_right || is_silent {
            break;
        }
    }
    best.ok_or_else(|| {
        refused.unwrap_or_else(|| BusError::Refused {
            device: format!("serial {path}"),
            source: std::io::ErrorKind::Unsupported.into(),
        })
    })
}

fn listen_can(interface: &str, longest: Duration) -> Result<Heard, BusError> {
    if bus::can::is_up(interface) == Some(false) {
        let interface = interface.to_owned();
        return Err(BusError::InterfaceDown { interface });
    }
    let endpoint = Endpoint::WholeCan {
        interface: interface.to_owned(),
    };
    let (verdict, bus_errors) = listen_bus(endpoint, longest)?;
    Ok(Heard {
        verdict,
        bus_errors,
        bit_rate: bit_rate(interface),
        ..Heard::default()
    })
}

/// Listens to a bus as `run` does; gives what was heard, and how often the interface complained of the bus.
fn listen_bus(endpoint: Endpoint, longest: Duration) -> Result<(Verdict, u64), BusError> {
    let sniffer = Arc::new(Mutex::new(Sniffer::new()));
    let ear = Arc::clone(&sniffer);
    let config = SourceConfig {
        name: "sniff".to_owned(),
        id: SourceId(0),
        endpoint,
    };
    let SourceHandle { mut thread, .. } = bus::spawn(
        config,
        Box::new(move |frame, _| {
            ear.lock()
                .unwrap_or_else(PoisonError::into_inner)
                .push(frame.wire);
            Tally::default()
        }),
    )?;
    let verdict = || {
        let sniffer = sniffer.lock().unwrap_or_else(PoisonError::into_inner);
        sniffer.verdict()
    };
    let start = Monotonic::read();
    while !is_over(start, longest) && !is_sure(&verdict()) {
        std::thread::park_timeout(LOOK_EVERY);
    }
    thread.stop();
    let figures = thread.figures().snapshot();
    let complaints = [Event::BusError, Event::ErrorWarning, Event::ErrorPassive];
    let errors = complaints.into_iter().map(|event| figures.events(event));
    Ok((verdict(), errors.sum()))
}

fn listen_udp(address: SocketAddr, longest: Duration) -> Result<Heard, BusError> {
    let socket = bus::udp_socket(address)?;
    let mut sniffer = Sniffer::new();
    let mut heard = Heard::default();
    let mut buffer = [0; DATAGRAM_BYTES_MAX + 1];
    let start = Monotonic::read();
    while !is_over(start, longest) && !is_sure(&heard.verdict) {
        // A socket that waits in vain says so after 50 ms; any other trouble is silence, too.
        let Ok((length, sender)) = socket.recv_from(&mut buffer) else {
            continue;
        };
        if length > DATAGRAM_BYTES_MAX {
            continue;
        }
        sniffer.push(Wire::Datagram(&buffer[..length]));
        heard.verdict = sniffer.verdict();
        let sender = sender.ip().to_canonical();
        if !heard.senders.contains(&sender) {
            heard.senders.push(sender);
        }
    }
    Ok(heard)
}

fn is_over(start: Monotonic, longest: Duration) -> bool {
    Monotonic::read().since(start).is_none_or(|d| d >= longest)
}

fn is_sure(verdict: &Verdict) -> bool {
    let sure = |f: &crate::proto::sniff::Finding| f.confidence >= SURE && f.frames >= SURE_FRAMES;
    verdict.findings.first().is_some_and(sure)
}

/// The bit rate that an interface is set to, as `ip` of iproute2 tells it; none for a virtual one, or without `ip`.
fn bit_rate(interface: &str) -> Option<u64> {
    let told = Command::new("ip")
        .args(["-details", "-json", "link", "show", "dev", interface])
        .output()
        .ok()?;
    let told: serde_json::Value = serde_json::from_slice(&told.stdout).ok()?;
    told[0]["linkinfo"]["info_data"]["bittiming"]["bitrate"].as_u64()
}

/// The path to write into a board file: one that lasts, where there is one.
fn lasting(path: &str) -> String {
    let lasting = ports::lasting_name(Path::new(path));
    lasting.map_or_else(|| path.to_owned(), |name| name.display().to_string())
}
