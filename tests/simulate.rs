//! `glasswing simulate` as a user meets it: captures that `glasswing decode` reads, faults, and one line for what cannot be.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

mod support;

use glasswing::proto::Protocol;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Output;

fn glasswing(args: &[&str]) -> Output {
    support::glasswing_command()
        .args(args)
        .output()
        .expect("starts")
}

/// Sends ten seconds of the demo's profile to a file.
fn capture(folder: &Path, protocol: &str, faults: &[&str]) -> PathBuf {
    let file = folder.join(format!("{protocol}-{}", faults.len()));
    let to = format!("file:{}", file.display());
    let mut args = vec![
        "simulate",
        "--profile",
        "demo",
        "--as",
        protocol,
        "--to",
        &to,
    ];
    args.extend(["--seconds", "10"]);
    args.extend(faults.iter().flat_map(|fault| ["--fault", fault]));
    let output = glasswing(&args);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    assert!(
        said.contains("9.9 s of the profile") || said.contains("10.0 s of"),
        "{said}"
    );
    file
}

fn decoded(protocol: &str, file: &Path) -> Value {
    let file = file.display().to_string();
    let output = glasswing(&["decode", "--as", protocol, &file, "--samples", "--json"]);
    serde_json::from_slice(&output.stdout).expect("one JSON document")
}

/// The values of a parameter with their times, seconds.
fn samples<'a>(document: &'a Value, parameter: &str) -> Vec<(f64, &'a Value)> {
    let all = document["samples"].as_array().expect("samples");
    let of_it = all.iter().filter(|s| s["parameter"] == parameter);
    of_it
        .map(|s| (s["time"].as_f64().unwrap_or(f64::NAN), &s["value"]))
        .collect()
}

#[test]
fn captures_of_every_protocol_decode_without_a_fault() {
    let folder = support::scratch_dir("simulate");
    for protocol in Protocol::ALL.map(Protocol::name) {
        let document = decoded(protocol, &capture(&folder, protocol, &[]));
        assert_eq!(document["bad"], serde_json::json!({}), "{protocol}");
        assert!(
            document["good"].as_u64() > Some(50),
            "{protocol}: {}",
            document["good"]
        );
    }
}

#[test]
fn a_fault_begins_and_ends_when_it_is_told_to() {
    let folder = support::scratch_dir("simulate-faults");
    let file = capture(&folder, "fgfdm", &["nan@3-5:pitch", "freeze@6:roll"]);
    let document = decoded("fgfdm", &file);
    for (time, value) in samples(&document, "pitch_rad") {
        assert_eq!(
            value.is_null(),
            (3.0..5.0).contains(&time),
            "{time}: {value}"
        );
    }
    let roll = samples(&document, "roll_rad");
    let after: Vec<_> = roll.iter().filter(|(t, _)| *t >= 6.0).collect();
    assert!(after.windows(2).all(|w| w[0].1 == w[1].1), "frozen");
    assert!(after.len() > 200, "its frames keep coming");
    let before: Vec<_> = roll.iter().filter(|(t, _)| *t < 6.0).collect();
    let moves = before.windows(2).filter(|w| w[0].1 != w[1].1).count();
    assert!(moves > 300, "a flight keeps moving: {moves}");
}

#[test]
fn damaged_frames_are_found_by_their_checksums() {
    let folder = support::scratch_dir("simulate-damage");
    let file = capture(
        &folder,
        "gdl90",
        &["bit-flips@0", "duplicates@0", "babble@2-3"],
    );
    let document = decoded("gdl90", &file);
    assert!(
        document["bad"]["checksum"].as_u64() > Some(50),
        "{}",
        document["bad"]
    );
    assert!(
        document["good"].as_u64() > Some(200),
        "{}",
        document["good"]
    );
    let file = capture(&folder, "can-fix", &["bus-off@5", "sentinel@2-3:roll"]);
    let text = std::fs::read_to_string(&file).expect("a candump log");
    assert!(
        text.ends_with("20000040#0000000000000000\n"),
        "off the bus and silent"
    );
    let document = decoded("can-fix", &file);
    for (time, value) in samples(&document, "roll_rad") {
        assert!(time < 5.0, "{time}");
        assert_eq!(
            value.is_null(),
            (2.0..3.0).contains(&time),
            "{time}: {value}"
        );
    }
}

#[test]
fn a_flight_is_the_same_every_time() {
    let folder = support::scratch_dir("simulate-again");
    let faults = ["noise@0", "bit-flips@1"];
    let read = |protocol| std::fs::read(capture(&folder, protocol, &faults)).expect("read");
    for protocol in ["mgl", "canaerospace"] {
        assert_eq!(read(protocol), read(protocol), "{protocol}");
    }
}

/// Arguments of `simulate`, its exit code, and what its one line has to say.
type Case = (&'static [&'static str], i32, &'static [&'static str]);

const REFUSED: [Case; 9] = [
    (
        &[
            "--profile",
            "demo",
            "--as",
            "can-fix",
            "--to",
            "can:nosuchcan7",
        ],
        4,
        &["can nosuchcan7: there is no such interface", "ip link"],
    ),
    (
        &[
            "--profile",
            "demo",
            "--as",
            "nmea",
            "--to",
            "serial:/dev/ttyNONE",
        ],
        4,
        &["serial /dev/ttyNONE: there is no such port"],
    ),
    (
        &["--profile", "demo", "--as", "nmea", "--to", "can:vcan0"],
        2,
        &["--to: nmea does not travel so", "serial:PORT"],
    ),
    (
        &[
            "--profile",
            "demo",
            "--as",
            "can-fix",
            "--to",
            "udp:127.0.0.1:9",
        ],
        2,
        &["--to: can-fix does not travel so"],
    ),
    (
        &["--profile", "demo", "--as", "nmea", "--to", "udp:here"],
        2,
        &["udp:127.0.0.1:5500"],
    ),
    (
        &[
            "--profile",
            "none.toml",
            "--as",
            "nmea",
            "--to",
            "file:/dev/null",
        ],
        3,
        &["none.toml:", "name a flight profile, or demo"],
    ),
    (
        &[
            "--profile",
            "demo",
            "--as",
            "nmea",
            "--to",
            "file:/dev/null",
            "--fault",
            "melt@3",
        ],
        2,
        &["--fault melt@3: there is no kind \"melt\"", "one of stop,"],
    ),
    (
        &[
            "--profile",
            "demo",
            "--as",
            "mgl",
            "--to",
            "file:/dev/null",
            "--fault",
            "nan@3:pitch",
        ],
        2,
        &["cannot say nan of pitch_rad"],
    ),
    (
        &[
            "--profile",
            "demo",
            "--as",
            "mgl",
            "--to",
            "file:/dev/null",
            "--fault",
            "bus-off@3",
        ],
        2,
        &["is a fault of CAN buses"],
    ),
];

#[test]
fn what_cannot_be_is_one_line() {
    let folder = support::scratch_dir("simulate-refused");
    let bad = folder.join("bad.toml");
    std::fs::write(&bad, "[start]\nlatitude_deg = 95\n").expect("written");
    let bad = bad.display().to_string();
    let mine: [&str; 6] = ["--profile", &bad, "--as", "nmea", "--to", "file:/dev/null"];
    let missing: (&[&str], i32, &[&str]) = (&mine, 2, &["bad.toml: line 1, start: missing field"]);
    for (args, code, parts) in REFUSED.into_iter().chain([missing]) {
        let output = glasswing(&[&["simulate"], args].concat());
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{args:?}: {said}");
        let line = said.lines().next().unwrap_or_default();
        assert!(line.starts_with("glasswing: "), "{args:?}: {said}");
        for part in parts {
            assert!(line.contains(part), "{args:?}: {line} lacks {part:?}");
        }
    }
}

#[test]
fn the_profile_that_comes_along_can_be_printed_and_flown_as_a_file() {
    let folder = support::scratch_dir("simulate-print");
    let output = glasswing(&["simulate", "--profile", "demo", "--print"]);
    assert!(output.status.success(), "printed");
    let mine = folder.join("mine.toml");
    std::fs::write(&mine, &output.stdout).expect("written");
    let fly = |profile: &str, name: &str| {
        let file = folder.join(name);
        let to = format!("file:{}", file.display());
        let output = glasswing(&[
            "simulate",
            "--profile",
            profile,
            "--as",
            "ubx",
            "--to",
            &to,
            "--seconds",
            "2",
        ]);
        assert!(output.status.success(), "{profile}");
        std::fs::read(file).expect("read")
    };
    let mine = mine.display().to_string();
    assert_eq!(fly(&mine, "a"), fly("demo", "b"));
}
