//! The sources of a board file: who speaks what, and where it is heard.

use super::reader::{Problem, Reader, a};
use crate::limits::SOURCES_MAX;
use crate::proto::fg_generic::{FgGeneric, Layout};
use crate::proto::{Carriage, Decoder, Protocol};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::path::Path;
use toml::Value;

/// Speeds of serial ports that a board file may give, bits per second: from the slowest that there are (`B50`) to the
/// fastest of USB adapters (12 Mbit/s, FTDI's high-speed ones). Which of them a port has is found when it is opened.
const BAUD: std::ops::RangeInclusive<u32> = 50..=12_000_000;

/// One source of flight data.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceWish {
    /// Its name in messages and figures.
    pub name: String,
    /// What it speaks.
    pub protocol: Protocol,
    /// How the lines of fg-generic are laid out, if not as in the file that comes with this program: a text that has been
    /// tried.
    pub layout: Option<String>,
    /// Where it is heard.
    pub endpoint: Endpoint,
}

/// Where a source is heard.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Endpoint {
    /// A UDP socket.
    Udp {
        /// Address and port to listen on.
        bind: SocketAddr,
        /// Senders that are listened to; empty means any that can reach the address.
        allow: Vec<IpAddr>,
    },
    /// A CAN interface.
    Can {
        /// Its name, as in `can0`.
        interface: String,
    },
    /// A serial port.
    Serial {
        /// Its path, as in `/dev/serial/by-id/…`.
        path: String,
        /// Bits per second.
        baud: u32,
    },
}

impl Endpoint {
    /// The key of the board file that names it.
    #[must_use]
    pub const fn key(&self) -> &'static str {
        match self {
            Self::Udp { .. } => "udp",
            Self::Can { .. } => "can",
            Self::Serial { .. } => "serial",
        }
    }
}

impl std::fmt::Display for Endpoint {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Udp { bind, .. } => write!(f, "udp {bind}"),
            Self::Can { interface } => write!(f, "can {interface}"),
            Self::Serial { path, baud } => write!(f, "serial {path} at {baud} baud"),
        }
    }
}

impl SourceWish {
    /// A fresh decoder of what it speaks.
    #[must_use]
    pub fn decoder(&self) -> Box<dyn Decoder> {
        decoder(self.protocol, self.layout.as_deref())
    }

    /// Whether both would hear the same: two of the same sender prove nothing about each other, and neither two sockets nor
    /// two ports can share one address or device.
    fn hears_the_same(&self, other: &Self) -> bool {
        match (&self.endpoint, &other.endpoint) {
            (Endpoint::Udp { bind: one, .. }, Endpoint::Udp { bind: two, .. }) => one == two,
            (Endpoint::Serial { path: one, .. }, Endpoint::Serial { path: two, .. }) => one == two,
            (Endpoint::Can { interface: one }, Endpoint::Can { interface: two }) => {
                one == two && self.protocol == other.protocol
            }
            _ => false,
        }
    }
}

/// A fresh decoder of a protocol; `layout`: the text of FlightGear's protocol file, for fg-generic, which has been tried.
#[must_use]
pub fn decoder(protocol: Protocol, layout: Option<&str>) -> Box<dyn Decoder> {
    match layout.map(Layout::parse) {
        Some(Ok(layout)) => Box::new(FgGeneric::new(layout)),
        _ => protocol.decoder(),
    }
}

/// The sources of the tables `[[source]]`, in order; what is wrong with any of them is added to `problems`.
pub(super) fn read(
    tables: Vec<Reader>,
    file: &Path,
    problems: &mut Vec<Problem>,
) -> Vec<SourceWish> {
    let mut sources: Vec<SourceWish> = Vec::new();
    for mut r in tables {
        let name = r.text("name", problems);
        let protocol = r.choice("protocol", &Protocol::ALL.map(|p| (p.name(), p)), problems);
        let endpoint = read_endpoint(&mut r, protocol, problems);
        let layout = read_layout(&mut r, protocol, file, problems);
        if let Some(name) = &name
            && sources.iter().any(|s| s.name == *name)
        {
            let why = format!("`{name}` is the name of two sources");
            let todo = "give each source a name of its own";
            problems.push(Problem::new(&r.path("name"), why, todo));
        }
        if let (Some(name), Some(protocol), Some(endpoint)) = (name, protocol, endpoint) {
            let source = SourceWish {
                name,
                protocol,
                layout,
                endpoint,
            };
            if let Some(other) = sources.iter().find(|s| s.hears_the_same(&source)) {
                let why = format!("{} is heard by `{}` already", source.endpoint, other.name);
                let todo = "remove one of the two sources";
                problems.push(Problem::new(&r.path(source.endpoint.key()), why, todo));
            }
            sources.push(source);
        }
        r.finish(problems);
    }
    if sources.len() > SOURCES_MAX {
        let why = format!("{} sources", sources.len());
        let todo = format!("give at most {SOURCES_MAX}");
        problems.push(Problem::new("source", why, todo));
    }
    sources
}

/// The layout of a source's lines: a protocol file of FlightGear, a relative path being meant beside the board file.
fn read_layout(
    r: &mut Reader,
    protocol: Option<Protocol>,
    file: &Path,
    problems: &mut Vec<Problem>,
) -> Option<String> {
    let name = r.optional_text("layout", problems)?;
    let path = file.parent().unwrap_or(Path::new("")).join(&name);
    let shown = path.display();
    let (why, todo) = if protocol.is_some_and(|p| p != Protocol::FgGeneric) {
        ("is for fg-generic only".to_owned(), "leave it out")
    } else {
        match std::fs::read_to_string(&path) {
            Err(e) => (
                format!("{shown} cannot be read: {e}"),
                "name a protocol file of FlightGear",
            ),
            Ok(text) => match Layout::parse(&text) {
                Ok(_) => return Some(text),
                Err(e) => (format!("{shown}: {e}"), e.todo()),
            },
        }
    };
    problems.push(Problem::new(&r.path("layout"), why, todo));
    None
}

/// The one endpoint of a source, whichever kind it is.
fn read_endpoint(
    r: &mut Reader,
    protocol: Option<Protocol>,
    problems: &mut Vec<Problem>,
) -> Option<Endpoint> {
    let known = problems.len();
    let given = ["udp", "can", "serial"].map(|key| r.has(key).then_some(key));
    let mut given = given.into_iter().flatten();
    match (given.next(), given.next()) {
        (Some(first), Some(second)) => {
            let why = format!("is given beside {first}");
            let todo = "a source is heard in one place: remove one of them";
            problems.push(Problem::new(&r.path(second), why, todo));
        }
        (None, _) => {
            let todo = "give udp = \"ADDRESS:PORT\", can = \"INTERFACE\" or serial = \"/dev/…\"";
            problems.push(Problem::new(&r.path(""), "has no endpoint", todo));
        }
        (Some(_), None) => {}
    }
    // Every key is looked at, whatever is wrong with another.
    let udp = read_udp(r, problems);
    let serial = read_serial(r, problems);
    let can = r
        .optional_text("can", problems)
        .map(|interface| Endpoint::Can { interface });
    let endpoint = udp.or(serial).or(can);
    if problems.len() > known {
        return None;
    }
    let endpoint = endpoint?;
    if let Some(todo) = protocol.and_then(|p| misplaced(p, &endpoint)) {
        let why = format!("does not come over {}", endpoint.key());
        problems.push(Problem::new(&r.path("protocol"), why, todo));
        return None;
    }
    Some(endpoint)
}

/// What to do about a protocol that does not come over such an endpoint.
const fn misplaced(protocol: Protocol, endpoint: &Endpoint) -> Option<&'static str> {
    match (protocol.carriage(), endpoint) {
        (Carriage::Can, Endpoint::Can { .. })
        | (Carriage::Packets, Endpoint::Udp { .. })
        | (Carriage::Stream, Endpoint::Udp { .. } | Endpoint::Serial { .. }) => None,
        (Carriage::Can, _) => Some("give can = \"INTERFACE\""),
        (Carriage::Packets, _) => Some("give udp = \"ADDRESS:PORT\""),
        (Carriage::Stream, _) => {
            Some("give serial = \"/dev/…\" and baud, or udp = \"ADDRESS:PORT\"")
        }
    }
}

fn read_udp(r: &mut Reader, problems: &mut Vec<Problem>) -> Option<Endpoint> {
    let (has_udp, has_allow) = (r.has("udp"), r.has("allow"));
    let bind = read_address(r, problems);
    let allow = r.optional_list::<IpAddr>("allow", "an IP address", problems);
    if has_allow && !has_udp {
        problems.push(not_without(r, "allow", "udp"));
    }
    let bind = bind?;
    for sender in &allow {
        if let Some(todo) = unheard(bind.ip(), *sender) {
            let why = format!("{sender} is never heard on {bind}");
            problems.push(Problem::new(&r.path("allow"), why, todo));
        }
    }
    Some(Endpoint::Udp { bind, allow })
}

/// What to do about a sender that cannot reach the address.
fn unheard(bind: IpAddr, sender: IpAddr) -> Option<&'static str> {
    let sender = sender.to_canonical();
    let takes_both = bind == IpAddr::V6(Ipv6Addr::UNSPECIFIED);
    if bind.to_canonical().is_ipv4() != sender.is_ipv4() && !takes_both {
        Some("give both as IPv4 or both as IPv6")
    } else if bind.is_loopback() && !sender.is_loopback() {
        Some("listen on an address that `ip address` lists, or on 0.0.0.0, to hear other computers")
    } else {
        None
    }
}

/// The key `udp`: address and port, or a port alone, which is then one of the loopback address.
fn read_address(r: &mut Reader, problems: &mut Vec<Problem>) -> Option<SocketAddr> {
    let on_loopback = |port: u16| SocketAddr::from((Ipv4Addr::LOCALHOST, port));
    let (given, address) = match r.take("udp")? {
        Value::Integer(port) => {
            let address = u16::try_from(port).ok().map(on_loopback);
            (format!("{port} is no port"), address)
        }
        Value::String(text) => {
            let address = text.parse().ok();
            let address = address.or_else(|| text.parse().ok().map(on_loopback));
            (format!("`{text}` is not understood"), address)
        }
        other => (format!("is {}, not a text", a(&other)), None),
    };
    let address = address.filter(|address| address.port() != 0);
    if address.is_none() {
        let todo = "write ADDRESS:PORT, as in \"127.0.0.1:5500\", or a port from 1 to 65535";
        problems.push(Problem::new(&r.path("udp"), given, todo));
    }
    address
}

fn read_serial(r: &mut Reader, problems: &mut Vec<Problem>) -> Option<Endpoint> {
    let (has_serial, has_baud) = (r.has("serial"), r.has("baud"));
    let path = r.optional_text("serial", problems);
    let baud = r.optional_whole("baud", BAUD, problems);
    if has_baud && !has_serial {
        problems.push(not_without(r, "baud", "serial"));
    }
    if has_serial && !has_baud {
        let todo = "give the speed of the sender, as in 9600 or 115200";
        problems.push(Problem::new(&r.path("baud"), "is missing", todo));
    }
    let path = path?;
    if !path.starts_with('/') {
        let why = format!("`{path}` is no whole path");
        let todo = "write it from the root, as in /dev/serial/by-id/…; `glasswing list` names them";
        problems.push(Problem::new(&r.path("serial"), why, todo));
    }
    Some(Endpoint::Serial { path, baud: baud? })
}

fn not_without(r: &Reader, key: &str, other: &str) -> Problem {
    let why = format!("is given without {other}");
    Problem::new(&r.path(key), why, format!("give {other}, or remove it"))
}
