//! `check --sniff` on real serial lines, sockets and CAN interfaces: what is spoken is named, and the lines that it prints are a board file.
#![expect(
    clippy::expect_used,
    clippy::panic,
    reason = "a helper that fails is a test that fails"
)]

mod bus_support;
mod support;

use bus_support::{Line, Vcan, has_no_serial_ports};
use glasswing::bus::can;
use glasswing::proto::canaerospace::encode;
use glasswing::signal::{CanData, Parameter};
use rustix::fs::{FlockOperation, flock};
use serde_json::Value;
use std::fs::File;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::process::Output;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// The published vectors.
const SKYVIEW: &[u8] =
    b"!1112345600+052-01232710955+03500-031+02+1025-020+151001+00+03900240125B\r\n";
const ATTITUDE: [u8; 16] = [
    0x7E, 0x65, 0x01, 0x00, 0x64, 0x00, 0x32, 0x84, 0xD2, 0x00, 0x5F, 0x00, 0x65, 0xB7, 0xEF, 0x7E,
];

/// Runs `check --sniff WORDS` while `send` is called over and over.
fn sniff(words: &[&str], send: impl Fn() + Sync) -> Output {
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let sender = std::thread::Builder::new().spawn_scoped(scope, || {
            while !is_over.load(Ordering::Acquire) {
                send();
                std::thread::park_timeout(Duration::from_millis(2));
            }
        });
        let mut command = support::glasswing_command();
        command.args(["check", "--sniff"]).args(words);
        let output = command.output();
        is_over.store(true, Ordering::Release);
        sender.expect("a thread");
        output.expect("the program starts")
    })
}

fn json(output: &Output) -> Value {
    let text = String::from_utf8_lossy(&output.stdout);
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("{e}: {text} {output:?}"))
}

/// A port that nobody has just now.
fn free_address() -> SocketAddr {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket");
    socket.local_addr().expect("an address")
}

/// What `check` says of a board file with these lines.
fn check(folder: &str, lines: &str) -> String {
    let file = support::scratch_dir(folder).join("cockpit.toml");
    let text = format!("inherit = \"base\"\n[screen]\nkind = \"surfaceless\"\n{lines}");
    std::fs::write(&file, text).expect("written");
    let mut command = support::glasswing_command();
    let output = command.args(["check", "--board"]).arg(&file).output();
    String::from_utf8_lossy(&output.expect("starts").stdout).into_owned()
}

#[test]
fn a_line_and_a_socket_are_named_and_their_lines_load() {
    if has_no_serial_ports() {
        return;
    }
    let line = Line::new();
    let (serial, address) = (format!("serial:{}", line.path), free_address());
    let udp = format!("udp:{address}");
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket");
    let words = ["--on", &serial, "--on", &udp, "--seconds", "10", "--json"];
    let output = sniff(&words, || {
        line.offer(SKYVIEW);
        // Nobody may listen yet.
        let _ = socket.send_to(&ATTITUDE, address);
    });
    let told = json(&output);
    assert_eq!(output.status.code(), Some(0), "{told}");
    let places = &told["places"];
    for (n, protocol) in ["dynon-skyview", "gdl90"].into_iter().enumerate() {
        let place = &places[n];
        assert_eq!(place["verdict"], "named", "{place}");
        assert_eq!(place["findings"][0]["protocol"], protocol, "{place}");
        let confidence = place["findings"][0]["confidence"].as_f64();
        assert!(confidence.is_some_and(|c| c > 0.8), "{place}");
    }
    assert_eq!(places[0]["baud"], 115_200, "the likeliest speed first");
    assert_eq!(places[1]["senders"][0], "127.0.0.1");
    let lines = told["board"].as_str().expect("text");
    let said = check("sniffed", lines);
    let path = &line.path;
    for source in [
        format!("source dynon-skyview: dynon-skyview on serial {path} at 115200 baud can be heard"),
        format!("source gdl90: gdl90 on udp {address} can be heard"),
    ] {
        assert!(said.contains(&source), "{said}\n{lines}");
    }
}

#[test]
fn two_protocols_of_one_line_are_told_and_one_is_chosen() {
    if has_no_serial_ports() {
        return;
    }
    let line = Line::new();
    let serial = format!("serial:{}", line.path);
    let mixed = [
        SKYVIEW,
        b"$GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W*6A\r\n",
    ]
    .concat();
    let output = sniff(&["--on", &serial], || {
        line.offer(&mixed);
    });
    let said = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(said.contains("dynon-skyview, "), "{said}");
    assert!(
        said.contains("and nmea, ") || said.contains(": nmea, "),
        "{said}"
    );
    let (_, lines) = said.split_once("For the board file:\n").expect("lines");
    assert_eq!(lines.matches("\n[[source]]").count(), 1, "{lines}");
    assert_eq!(lines.matches("#[[source]]").count(), 1, "{lines}");
    let heard = check("sniffed-two", lines);
    assert_eq!(heard.matches("can be heard").count(), 1, "{heard}");
}

#[test]
fn silence_noise_and_refusals_are_one_line_each() {
    if has_no_serial_ports() {
        return;
    }
    let (silent, noisy, held) = (Line::new(), Line::new(), Line::new());
    let port = File::open(&held.path).expect("opens");
    flock(&port, FlockOperation::NonBlockingLockExclusive).expect("locked");
    let taken = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket");
    let taken = taken.local_addr().map(|a| (taken, a)).expect("an address");
    let places = [&silent, &noisy, &held].map(|line| format!("serial:{}", line.path));
    let udp = format!("udp:{}", taken.1);
    let words: Vec<&str> = places
        .iter()
        .flat_map(|place| ["--on", place])
        .chain(["--on", &udp, "--on", "can:nosuchcan7", "--seconds", "0.3"])
        .collect();
    let noise: Vec<u8> = (0..200_u8).map(|n| n.wrapping_mul(n) ^ 0x5A).collect();
    let output = sniff(&words, || {
        noisy.offer(&noise);
    });
    let said = String::from_utf8_lossy(&output.stdout);
    let lines: Vec<&str> = said.lines().collect();
    assert!(lines[0].contains(": nothing heard ("), "{said}");
    assert!(
        lines[1].contains(": heard, but unknown at any of 7 speeds: "),
        "{said}"
    );
    assert!(lines[2].contains(": another program has it"), "{said}");
    assert!(
        lines[3].contains(": another program listens on port "),
        "{said}"
    );
    assert!(lines[4].starts_with("can nosuchcan7: "), "{said}");
    assert!(said.contains("Nothing to add to a board file."), "{said}");
    // Places that were asked for and refuse are failures, too.
    assert_eq!(output.status.code(), Some(4), "{output:?}");
    let errors = String::from_utf8_lossy(&output.stderr);
    let errors: Vec<&str> = errors
        .lines()
        .filter(|l| l.starts_with("glasswing: "))
        .collect();
    assert_eq!(errors.len(), 3, "{errors:?}");
}

#[test]
fn the_places_of_a_board_file_are_listened_to() {
    let address = free_address();
    let file = support::scratch_dir("sniff-board").join("cockpit.toml");
    let text = format!(
        "inherit = \"base\"\n[[source]]\nname = \"x\"\nprotocol = \"fgfdm\"\nudp = \"{address}\"\n"
    );
    std::fs::write(&file, text).expect("written");
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket");
    let file = file.to_str().expect("a plain path");
    let output = sniff(&["--board", file, "--json", "--seconds", "10"], || {
        let _ = socket.send_to(&ATTITUDE, address);
    });
    let told = json(&output);
    let finding = &told["places"][0]["findings"][0];
    assert_eq!(
        finding["protocol"], "gdl90",
        "not what the file says: {told}"
    );
}

#[test]
fn a_can_bus_is_named_with_both_its_protocols() {
    let Some(vcan) = Vcan::make("vcansniff") else {
        return;
    };
    let sender = can::Sender::open(vcan.0).expect("opens");
    let aerospace = encode(Parameter::Pitch, 0.1, 1, 0).expect("has one");
    let fix = CanData {
        id: 0x180,
        extended: false,
        len: 5,
        data: [5, 0, 0, 8, 2, 0, 0, 0],
    };
    let place = format!("can:{}", vcan.0);
    let output = sniff(&["--on", &place, "--json", "--seconds", "10"], || {
        // A full queue loses a frame or two.
        let _ = sender.send(&aerospace);
        let _ = sender.send(&fix);
    });
    let told = json(&output);
    let findings = told["places"][0]["findings"].as_array().expect("a list");
    let mut named: Vec<&str> = findings
        .iter()
        .filter_map(|f| f["protocol"].as_str())
        .collect();
    named.sort_unstable();
    assert_eq!(named, ["can-fix", "canaerospace"], "{told}");
    let lines = told["board"].as_str().expect("text");
    assert_eq!(lines.matches("[[source]]").count(), 2, "{lines}");
    let said = check("sniffed-can", lines);
    assert_eq!(said.matches("can be heard").count(), 2, "{said}");
}

#[test]
fn wrong_words_are_named() {
    for (words, part) in [
        (&["--on", "tty:/dev/ttyS0"][..], "write serial:/dev/"),
        (&["--on", "udp:99999"], "99999"),
        (
            &["--on", "udp:4000", "--seconds", "0"],
            "--seconds: 0 is no time to listen",
        ),
    ] {
        let output = sniff(words, || {});
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(part), "{said}");
    }
    let mut command = support::glasswing_command();
    let output = command.args(["check", "--on", "udp:4000"]).output();
    let code = output.expect("starts").status.code();
    assert_eq!(code, Some(2), "--on is of --sniff only");
}
