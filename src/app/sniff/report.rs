//! What was heard, in words, as JSON, and as lines for the board file.

use super::{Heard, Place, Told, lasting};
use crate::app::out::{self, say};
use crate::limits::SOURCES_MAX;
use crate::proto::Protocol;
use crate::proto::sniff::Finding;
use serde_json::{Value, json};
use std::fmt::Write as _;

/// Prints what was heard everywhere.
pub(super) fn print(told: &[Told], as_json: bool) {
    let lines = board_lines(told);
    if as_json {
        let places: Vec<Value> = told.iter().map(to_json).collect();
        let document = json!({ "places": places, "board": lines });
        say!("{document}");
        return;
    }
    for one in told {
        say!("{}", in_words(one));
    }
    if lines.is_empty() {
        say!("\nNothing to add to a board file.");
    } else {
        out::write(format_args!("\nFor the board file:\n\n{lines}"));
    }
}

fn in_words(told: &Told) -> String {
    let place = &told.place;
    let heard = match &told.heard {
        Err(e) => return e.to_string(),
        Ok(heard) => heard,
    };
    let verdict = &heard.verdict;
    let at = match (heard.baud, heard.bit_rate) {
        (Some(baud), _) if verdict.heard > 0 => format!(" at {baud} baud"),
        (_, Some(rate)) => format!(" at {rate} bit/s"),
        _ => String::new(),
    };
    if verdict.heard == 0 {
        return format!("{place}{at}: nothing heard{}", silence(told, heard));
    }
    if verdict.findings.is_empty() {
        let hint = verdict.hint.map_or_else(
            || "its frames fit no protocol that is read here".to_owned(),
            ToOwned::to_owned,
        );
        let tried = match heard.speeds {
            0 | 1 => String::new(),
            speeds => format!(" at any of {speeds} speeds"),
        };
        let (n, unit) = (verdict.heard, unit(place));
        return format!("{place}: heard, but unknown{tried}: {n} {unit}; {hint}");
    }
    let findings: Vec<String> = verdict
        .findings
        .iter()
        .map(|f| {
            let percent = (f.confidence * 100.0).floor();
            let name = f.protocol.name();
            let silent = if f.frames == 0 {
                " that say anything"
            } else {
                ""
            };
            format!("{name}, {percent} % sure ({} frames{silent})", f.frames)
        })
        .collect();
    let from = match heard.senders.as_slice() {
        [] => String::new(),
        senders => format!(", from {}", join(senders)),
    };
    let (n, unit) = (verdict.heard, unit(place));
    format!(
        "{place}{at}: {} in {n} {unit}{from}",
        findings.join(", and ")
    )
}

fn silence(told: &Told, heard: &Heard) -> String {
    match told.place {
        Place::Serial(_) => {
            " (is it switched on, and are its wires the right way round?)".to_owned()
        }
        Place::Can(_) if heard.bus_errors > 0 => format!(
            " but {} errors of the bus (its bit rate is another one: ip link set … type can bitrate …)",
            heard.bus_errors
        ),
        Place::Can(_) => " (is another node switched on?)".to_owned(),
        Place::Udp(_) => " (does the sender know this machine's address?)".to_owned(),
    }
}

const fn unit(place: &Place) -> &'static str {
    match place {
        Place::Can(_) => "frames",
        Place::Serial(_) | Place::Udp(_) => "bytes",
    }
}

fn join(items: &[impl ToString]) -> String {
    let items: Vec<String> = items.iter().map(ToString::to_string).collect();
    items.join(", ")
}

fn to_json(told: &Told) -> Value {
    let place = told.place.to_string();
    let heard = match &told.heard {
        Err(e) => {
            return json!({ "place": place, "verdict": "refused", "why": e.to_string() });
        }
        Ok(heard) => heard,
    };
    let verdict = &heard.verdict;
    let findings = verdict.findings.iter().map(|f| {
        json!({
            "protocol": f.protocol.name(), "confidence": f.confidence,
            "frames": f.frames, "bytes": f.bytes, "fields": f.fields,
        })
    });
    let word = match (verdict.heard, verdict.findings.as_slice()) {
        (0, _) => "silent",
        (_, []) => "unknown",
        _ => "named",
    };
    json!({
        "place": place, "verdict": word, "heard": verdict.heard, "baud": heard.baud,
        "bit_rate": heard.bit_rate, "bus_errors": heard.bus_errors, "hint": verdict.hint,
        "findings": findings.collect::<Vec<_>>(),
        "senders": heard.senders.iter().map(ToString::to_string).collect::<Vec<_>>(),
    })
}

/// The tables of a board file that make a source of everything that was named. A second protocol of a place that one
/// source only can listen to, and sources beyond the most that there may be, are commented out.
fn board_lines(told: &[Told]) -> String {
    let mut text = String::new();
    let mut names: Vec<String> = Vec::new();
    for one in told {
        let Ok(heard) = &one.heard else { continue };
        for (n, finding) in heard.verdict.findings.iter().enumerate() {
            let name = name_of(finding.protocol, &names);
            let is_shared = n > 0 && !matches!(one.place, Place::Can(_));
            let is_too_many = names.len() >= SOURCES_MAX;
            let table = table(&name, one, heard, finding);
            if is_shared {
                text +=
                    "# The same line has this, too; a line is read by one source: choose one.\n";
            } else if is_too_many {
                let _ = writeln!(
                    text,
                    "# A board file has at most {SOURCES_MAX} sources: choose."
                );
            } else {
                text += &table;
                text += "\n";
                names.push(name);
                continue;
            }
            for line in table.lines() {
                let _ = writeln!(text, "#{line}");
            }
            text += "\n";
        }
    }
    text
}

/// The protocol's name, with a number from the second on.
fn name_of(protocol: Protocol, taken: &[String]) -> String {
    let plain = protocol.name().to_owned();
    let numbered = (2..).map(|n| format!("{}-{n}", protocol.name()));
    let mut names = std::iter::once(plain.clone()).chain(numbered);
    names.find(|name| !taken.contains(name)).unwrap_or(plain)
}

/// One table. Writing to a `String` cannot fail.
fn table(name: &str, told: &Told, heard: &Heard, finding: &Finding) -> String {
    let mut text = String::new();
    // A string of JSON is one of TOML.
    let quoted = |text: &str| json!(text).to_string();
    let _ = writeln!(text, "[[source]]");
    let _ = writeln!(text, "name = {}", quoted(name));
    let _ = writeln!(text, "protocol = {}", quoted(finding.protocol.name()));
    match &told.place {
        Place::Serial(path) => {
            let _ = writeln!(text, "serial = {}", quoted(&lasting(path)));
            let _ = writeln!(text, "baud = {}", heard.baud.unwrap_or_default());
        }
        Place::Can(interface) => {
            let _ = writeln!(text, "can = {}", quoted(interface));
        }
        Place::Udp(address) => {
            let is_local = heard.senders.iter().all(|s| s.is_loopback() && s.is_ipv4());
            if address.ip().is_unspecified() && address.is_ipv4() && is_local {
                let _ = writeln!(text, "udp = \"127.0.0.1:{}\"", address.port());
            } else {
                let _ = writeln!(text, "udp = {}", quoted(&address.to_string()));
                let senders = heard.senders.iter().map(|s| quoted(&s.to_string()));
                let senders = senders.collect::<Vec<_>>().join(", ");
                let _ = writeln!(text, "allow = [{senders}]");
            }
        }
    }
    if let Some(fields) = finding.fields {
        let _ = writeln!(
            text,
            "#layout = \"FILE.xml\" # its lines have {fields} fields: give FlightGear's protocol file that made them"
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::board::{Board, Endpoint};
    use crate::proto::sniff::Verdict;

    fn finding(protocol: Protocol, fields: Option<usize>) -> Finding {
        Finding {
            protocol,
            confidence: 0.97,
            frames: 30,
            bytes: 2000,
            fields,
        }
    }

    fn told(place: &str, findings: &[Finding], senders: &[&str]) -> Told {
        let place: Place = place.parse().unwrap();
        Told {
            heard: Ok(Heard {
                verdict: Verdict {
                    heard: 2100,
                    findings: findings.to_vec(),
                    hint: None,
                },
                baud: matches!(place, Place::Serial(_)).then_some(38_400),
                senders: senders.iter().map(|s| s.parse().unwrap()).collect(),
                ..Heard::default()
            }),
            place,
        }
    }

    #[test]
    fn the_lines_are_a_board_file() {
        let all = [
            told(
                "serial:/dev/ttyS3",
                &[finding(Protocol::Nmea, None), finding(Protocol::Ubx, None)],
                &[],
            ),
            told("serial:/dev/tty\"S4", &[finding(Protocol::Nmea, None)], &[]),
            told(
                "can:can0",
                &[
                    finding(Protocol::CanAerospace, None),
                    finding(Protocol::CanFix, None),
                ],
                &[],
            ),
            told(
                "udp:4000",
                &[finding(Protocol::Gdl90, None)],
                &["192.168.10.1"],
            ),
            told(
                "udp:5500",
                &[finding(Protocol::FgGeneric, Some(16))],
                &["127.0.0.1"],
            ),
            told("udp:127.0.0.1:5501", &[], &[]),
        ];
        let lines = board_lines(&all);
        let file = std::env::temp_dir().join(format!("glasswing-sniff-{}", std::process::id()));
        std::fs::write(&file, format!("inherit = \"base\"\n{lines}")).unwrap();
        let board = Board::load(&file);
        std::fs::remove_file(&file).unwrap();
        let sources = board.unwrap_or_else(|e| panic!("{lines}\n{e:?}")).sources;
        let names: Vec<&str> = sources.iter().map(|s| s.name.as_str()).collect();
        let expected = [
            "nmea",
            "nmea-2",
            "canaerospace",
            "can-fix",
            "gdl90",
            "fg-generic",
        ];
        assert_eq!(names, expected, "{lines}");
        assert_eq!(
            sources[4].endpoint,
            Endpoint::Udp {
                bind: ([0, 0, 0, 0], 4000).into(),
                allow: vec!["192.168.10.1".parse().unwrap()]
            }
        );
        let loopback = ([127, 0, 0, 1], 5500).into();
        assert!(
            matches!(&sources[5].endpoint, Endpoint::Udp { bind, .. } if *bind == loopback),
            "{lines}"
        );
        assert!(lines.contains("#protocol = \"ubx\""), "{lines}");
        assert!(lines.contains("16 fields"), "{lines}");
    }

    #[test]
    fn more_than_a_board_file_takes_are_commented_out() {
        let all: Vec<Told> = (0..SOURCES_MAX + 2)
            .map(|n| {
                told(
                    &format!("udp:{}", 4000 + n),
                    &[finding(Protocol::Gdl90, None)],
                    &[],
                )
            })
            .collect();
        let lines = board_lines(&all);
        assert_eq!(lines.matches("\n[[source]]").count() + 1, SOURCES_MAX);
        assert_eq!(lines.matches("#[[source]]").count(), 2, "{lines}");
    }

    #[test]
    fn places_are_read_or_refused() {
        for (text, shown) in [
            ("serial:/dev/pts/3", "serial /dev/pts/3"),
            ("can:vcan0", "can vcan0"),
            ("udp:4000", "udp 0.0.0.0:4000"),
            ("udp:127.0.0.1:5500", "udp 127.0.0.1:5500"),
            ("udp:[::1]:5500", "udp [::1]:5500"),
        ] {
            let place: Place = text.parse().unwrap();
            assert_eq!(place.to_string(), shown);
        }
        for text in [
            "",
            "udp:",
            "udp:0",
            "udp:70000",
            "serial:ttyS0",
            "can:",
            "tty:/dev/x",
        ] {
            assert!(text.parse::<Place>().is_err(), "{text}");
        }
    }
}
