//! `glasswing list`: what this machine has to show on, to listen to and to be handled with.
//!
//! Nothing is opened for longer than the question takes, and what cannot be asked says why.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::{Failure, Kind, out, ports};
use crate::gl::Gpu;
use crate::screen::{self, Screen, ScreenError};

/// Lists what this machine has: display controllers with their connectors and modes, CAN interfaces, serial ports, input
/// devices, and the OpenGL renderers for pictures without a display.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  glasswing list\n  glasswing list --json | jq -r '.cards[].connectors[].name'"
)]
pub struct ListArgs {
    /// Print one JSON document instead of text
    #[arg(long)]
    pub json: bool,
}

/// Everything there is.
#[derive(Debug, Serialize)]
struct Inventory {
    cards: Vec<Card>,
    can: Vec<Can>,
    serial: Vec<String>,
    serial_names: BTreeMap<String, String>,
    input: Vec<Input>,
    gl: Vec<Renderer>,
}

/// A display controller.
#[derive(Debug, Serialize)]
struct Card {
    path: String,
    driver: String,
    connectors: Vec<Connector>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

/// A socket or panel.
#[derive(Debug, Serialize)]
struct Connector {
    name: String,
    /// `connected`, `disconnected` or `unknown`.
    status: &'static str,
    modes: Vec<Mode>,
}

/// A mode.
#[derive(Debug, Serialize)]
struct Mode {
    width_px: u16,
    height_px: u16,
    refresh_hz: f64,
    preferred: bool,
    interlaced: bool,
}

/// A CAN interface.
#[derive(Debug, PartialEq, Eq, Serialize)]
struct Can {
    name: String,
    /// Is it up?
    up: bool,
    /// Does it carry CAN FD frames?
    fd: bool,
    /// Its driver; `virtual` where no hardware is behind it.
    driver: String,
}

/// An input device.
#[derive(Debug, Serialize)]
struct Input {
    path: String,
    name: String,
    /// How many keys and buttons it has.
    keys: usize,
    /// What turns or moves, as in `REL_DIAL`.
    relative: Vec<String>,
    /// What has a position, as in `ABS_MT_POSITION_X`.
    absolute: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

/// A way to draw without a display.
#[derive(Debug, Serialize)]
struct Renderer {
    /// `surfaceless` or `osmesa`.
    backend: &'static str,
    renderer: String,
    version: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] if standard output cannot be written to.
pub fn run(args: ListArgs) -> Result<(), Failure> {
    let serial = serial_ports();
    let inventory = Inventory {
        cards: cards(),
        can: can_interfaces(Path::new("/sys/class/net")),
        serial_names: serial_names(&serial),
        serial,
        input: input_devices(),
        gl: renderers(),
    };
    let text = if args.json {
        let json = serde_json::to_string_pretty(&inventory);
        json.map_err(|e| Failure::new(Kind::Other, "the list", e, "leave out --json"))? + "\n"
    } else {
        in_words(&inventory)
    };
    out::write(format_args!("{text}"));
    Ok(())
}

#[cfg(feature = "kms")]
fn cards() -> Vec<Card> {
    use screen::kms::choose::Link;
    let connector = |c: &screen::kms::choose::Connector| Connector {
        name: c.name.clone(),
        status: match c.link {
            Link::Connected => "connected",
            Link::Disconnected => "disconnected",
            Link::Unknown => "unknown",
        },
        modes: c
            .modes
            .iter()
            .map(|m| Mode {
                width_px: m.width,
                height_px: m.height,
                // A hundredth of a hertz tells 59.94 from 60.
                refresh_hz: (m.refresh_hz * 100.0).round() / 100.0,
                preferred: m.preferred,
                interlaced: m.interlaced,
            })
            .collect(),
    };
    screen::kms::inventory()
        .into_iter()
        .map(|card| {
            let (connectors, error) = match card.display {
                Ok(display) => (display.connectors.iter().map(connector).collect(), None),
                Err(e) => (Vec::new(), Some(e.to_string())),
            };
            Card {
                path: card.path,
                driver: card.driver,
                connectors,
                error,
            }
        })
        .collect()
}

#[cfg(not(feature = "kms"))]
fn cards() -> Vec<Card> {
    Vec::new()
}

/// The CAN interfaces of this machine that are switched on.
pub(super) fn can_names() -> Vec<String> {
    let all = can_interfaces(Path::new("/sys/class/net")).into_iter();
    all.filter(|can| can.up).map(|can| can.name).collect()
}

/// The CAN interfaces among the network interfaces that `net` (`/sys/class/net`) lists, by name.
fn can_interfaces(net: &Path) -> Vec<Can> {
    /// `ARPHRD_CAN` of `linux/if_arp.h`.
    const CAN: &str = "280";
    /// `IFF_UP` of `linux/if.h`.
    const UP: u32 = 1;
    /// `CANFD_MTU` of `linux/can.h`; a classic interface has 16.
    const FD_MTU: u32 = 72;
    let word = |interface: &Path, file: &str| {
        fs::read_to_string(interface.join(file))
            .map(|text| text.trim().to_owned())
            .unwrap_or_default()
    };
    sorted_entries(net)
        .into_iter()
        .filter(|interface| word(interface, "type") == CAN)
        .map(|interface| {
            let flags = word(&interface, "flags");
            let flags = u32::from_str_radix(flags.trim_start_matches("0x"), 16).unwrap_or(0);
            let driver = fs::read_link(interface.join("device/driver")).ok();
            Can {
                name: file_name(&interface),
                up: flags & UP != 0,
                fd: word(&interface, "mtu")
                    .parse::<u32>()
                    .is_ok_and(|mtu| mtu >= FD_MTU),
                driver: driver.map_or_else(|| "virtual".to_owned(), |path| file_name(&path)),
            }
        })
        .collect()
}

fn serial_ports() -> Vec<String> {
    let paths = ports::all().into_iter();
    paths.map(|path| path.display().to_string()).collect()
}

/// The names that ports keep when they are plugged in again, by path; few have one.
fn serial_names(ports: &[String]) -> BTreeMap<String, String> {
    let names = ports.iter().filter_map(|port| {
        let name = ports::lasting_name(Path::new(port))?;
        Some((port.clone(), name.display().to_string()))
    });
    names.collect()
}

fn input_devices() -> Vec<Input> {
    fn names<T: std::fmt::Debug>(codes: Option<impl Iterator<Item = T>>) -> Vec<String> {
        codes
            .into_iter()
            .flatten()
            .map(|code| format!("{code:?}"))
            .collect()
    }
    sorted_entries(Path::new("/dev/input"))
        .into_iter()
        .filter(|path| file_name(path).starts_with("event"))
        .map(|path| {
            let text = path.display().to_string();
            match evdev::Device::open(&path) {
                Ok(device) => Input {
                    path: text,
                    name: device.name().unwrap_or("without a name").to_owned(),
                    keys: device.supported_keys().map_or(0, |k| k.iter().count()),
                    relative: names(device.supported_relative_axes().map(|axes| axes.iter())),
                    absolute: names(device.supported_absolute_axes().map(|axes| axes.iter())),
                    error: None,
                },
                Err(e) => Input {
                    path: text,
                    name: String::new(),
                    keys: 0,
                    relative: Vec::new(),
                    absolute: Vec::new(),
                    error: Some(format!("{e} (add the user to the group input)")),
                },
            }
        })
        .collect()
}

fn renderers() -> Vec<Renderer> {
    // One after the other: both make their context current on this thread.
    let surfaceless = renderer("surfaceless", screen::surfaceless::open(64, 64));
    let osmesa = renderer("osmesa", screen::osmesa::open(64, 64));
    vec![surfaceless, osmesa]
}

fn renderer<S: Screen>(backend: &'static str, opened: Result<S, ScreenError>) -> Renderer {
    let asked = opened.map_err(|e| e.to_string()).and_then(|screen| {
        let gpu = Gpu::new(&|name| screen.gl_proc(name)).map_err(|e| e.to_string())?;
        let caps = gpu.caps();
        Ok((caps.renderer.clone(), caps.version.clone()))
    });
    let (renderer, version, error) = match asked {
        Ok((renderer, version)) => (renderer, version, None),
        Err(error) => (String::new(), String::new(), Some(error)),
    };
    Renderer {
        backend,
        renderer,
        version,
        error,
    }
}

/// The entries of a folder, those with numbers in the order of the numbers; none where it cannot be read.
fn sorted_entries(folder: &Path) -> Vec<PathBuf> {
    let mut entries: Vec<PathBuf> = fs::read_dir(folder)
        .map(|entries| {
            entries
                .filter_map(Result::ok)
                .map(|entry| entry.path())
                .collect()
        })
        .unwrap_or_default();
    entries.sort_by_key(|path| {
        let name = file_name(path);
        let digits = name.trim_start_matches(|c: char| !c.is_ascii_digit());
        let stem = name[..name.len() - digits.len()].to_owned();
        (stem, digits.parse::<u64>().unwrap_or(0), name)
    });
    entries
}

fn file_name(path: &Path) -> String {
    path.file_name()
        .map(|name| name.to_string_lossy().into_owned())
        .unwrap_or_default()
}

/// The inventory as text. Writing to a `String` cannot fail.
fn in_words(all: &Inventory) -> String {
    let mut out = String::new();
    section(&mut out, "Display controllers", &all.cards, card_in_words);
    section(&mut out, "CAN interfaces", &all.can, |can| {
        let up = if can.up { "up" } else { "down" };
        let fd = if can.fd { ", FD" } else { "" };
        format!("{}  {up}{fd}, {}\n", can.name, can.driver)
    });
    section(&mut out, "Serial ports", &all.serial, |port| {
        let name = all.serial_names.get(port);
        format!("{port}  {}\n", name.map_or("", String::as_str))
            .trim_end()
            .to_owned()
    });
    section(&mut out, "Input devices", &all.input, input_in_words);
    section(
        &mut out,
        "OpenGL without a display",
        &all.gl,
        |gl| match &gl.error {
            None => format!("{}  {}, {}\n", gl.backend, gl.renderer, gl.version),
            Some(error) => format!("{}  none: {error}\n", gl.backend),
        },
    );
    out
}

/// A heading and its lines, or a plain `none`.
fn section<T>(out: &mut String, heading: &str, items: &[T], line: impl Fn(&T) -> String) {
    let _ = writeln!(out, "{heading}");
    if items.is_empty() {
        let _ = writeln!(out, "  none");
    }
    for item in items {
        for line in line(item).lines() {
            let _ = writeln!(out, "  {line}");
        }
    }
}

fn card_in_words(card: &Card) -> String {
    let mut out = format!("{}  {}\n", card.path, card.driver);
    if let Some(error) = &card.error {
        let _ = writeln!(out, "  {error}");
    } else if card.connectors.is_empty() {
        let _ = writeln!(out, "  no connectors: it drives no displays");
    }
    for connector in &card.connectors {
        let _ = writeln!(out, "  {}  {}", connector.name, connector.status);
        for mode in &connector.modes {
            let preferred = if mode.preferred { "  preferred" } else { "" };
            let interlaced = if mode.interlaced { "  interlaced" } else { "" };
            let (width, height, hz) = (mode.width_px, mode.height_px, mode.refresh_hz);
            let _ = writeln!(out, "    {width}x{height}@{hz:.2}{preferred}{interlaced}");
        }
    }
    out
}

fn input_in_words(input: &Input) -> String {
    if let Some(error) = &input.error {
        return format!("{}  {error}\n", input.path);
    }
    let mut parts = Vec::new();
    if input.keys > 0 {
        parts.push(format!("{} keys", input.keys));
    }
    parts.extend(input.relative.iter().cloned());
    parts.extend(input.absolute.iter().cloned());
    format!("{}  {}  {}\n", input.path, input.name, parts.join(" "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_machine_says_none_for_everything() {
        let text = in_words(&Inventory {
            cards: Vec::new(),
            can: Vec::new(),
            serial: Vec::new(),
            serial_names: BTreeMap::new(),
            input: Vec::new(),
            gl: Vec::new(),
        });
        assert_eq!(text.matches("  none\n").count(), 5, "{text}");
    }

    #[test]
    fn can_interfaces_are_told_from_other_networks_by_their_type() {
        let net = std::env::temp_dir().join(format!("glasswing-list-{}", std::process::id()));
        let interface = |name: &str, kind: &str, flags: &str, mtu: &str| {
            let folder = net.join(name);
            fs::create_dir_all(&folder).unwrap();
            fs::write(folder.join("type"), format!("{kind}\n")).unwrap();
            fs::write(folder.join("flags"), format!("{flags}\n")).unwrap();
            fs::write(folder.join("mtu"), format!("{mtu}\n")).unwrap();
        };
        interface("eth0", "1", "0x1003", "1500");
        interface("can10", "280", "0x40081", "16");
        interface("can2", "280", "0x40080", "16");
        interface("vcan0", "280", "0xc1", "72");
        let found = can_interfaces(&net);
        fs::remove_dir_all(&net).unwrap();
        let can = |name: &str, up, fd| Can {
            name: name.into(),
            up,
            fd,
            driver: "virtual".into(),
        };
        assert_eq!(
            found,
            [
                can("can2", false, false),
                can("can10", true, false),
                can("vcan0", true, true)
            ]
        );
    }

    #[test]
    fn a_card_is_shown_with_its_connectors_and_modes() {
        let card = Card {
            path: "/dev/dri/card1".into(),
            driver: "vc4".into(),
            connectors: vec![Connector {
                name: "HDMI-A-1".into(),
                status: "connected",
                modes: vec![Mode {
                    width_px: 1024,
                    height_px: 600,
                    refresh_hz: 59.99,
                    preferred: true,
                    interlaced: false,
                }],
            }],
            error: None,
        };
        let expected =
            "/dev/dri/card1  vc4\n  HDMI-A-1  connected\n    1024x600@59.99  preferred\n";
        assert_eq!(card_in_words(&card), expected);
    }
}
