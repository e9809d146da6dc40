//! `glasswing decode` as its users meet it: on recordings, on damaged files, and on what is no recording at all.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

mod support;

use glasswing::proto::Protocol;
use serde_json::{Value, json};
use std::path::Path;
use std::process::Output;

fn decode(protocol: &str, file: &Path, flags: &[&str]) -> Output {
    support::glasswing_command()
        .args(["decode", "--as", protocol])
        .arg(file)
        .args(flags)
        .output()
        .expect("starts")
}

fn json_of(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).expect("one JSON document")
}

/// What was said on stderr; it must be one line.
#[track_caller]
fn complaint(output: &Output) -> String {
    let text = String::from_utf8(output.stderr.clone()).expect("UTF-8");
    assert!(text.starts_with("glasswing: "), "{text:?}");
    text
}

/// A container with two packets of an unknown version.
fn small_container() -> Vec<u8> {
    let mut bytes = Vec::new();
    for seconds in [0.5_f64, 1.0] {
        bytes.extend(seconds.to_le_bytes());
        bytes.extend(8_u32.to_le_bytes());
        bytes.extend([9; 8]);
    }
    bytes
}

#[test]
fn the_recorded_flight_is_all_good() {
    let Some(data) = support::data_dir() else {
        return;
    };
    let capture = data.join("bus/jsbsim_c172x_netfdm.bin");
    let output = decode("fgfdm", &capture, &["--json"]);
    assert!(output.status.success(), "{output:?}");
    let document = json_of(&output);
    assert_eq!(document["good"], 901);
    assert_eq!(document["bad"], json!({}));
    assert_eq!(document["ignored"], 0);

    let output = decode("fgfdm", &capture, &["--samples"]);
    let text = String::from_utf8(output.stdout).expect("UTF-8");
    let first = text
        .lines()
        .map(|line| serde_json::from_str::<Value>(line).expect("a JSON line"))
        .find(|sample| sample["parameter"] == "heading_true_rad")
        .expect("a heading");
    assert_eq!(first["unit"], "rad");
    assert_eq!(first["quality"], "good");
    assert_eq!(first["time"], 0.0);
    let heading = first["value"].as_f64().expect("a number");
    assert!((heading - 60_f64.to_radians()).abs() < 1e-5, "{heading}");
}

#[test]
fn containers_raw_bytes_and_layouts_are_all_read() {
    let Some(data) = support::data_dir() else {
        return;
    };
    let bus = data.join("bus");
    let layout = bus.join("svgc_attitude.xml");
    let layout = layout.to_str().expect("a name");
    for (protocol, file, flags, good, bad) in [
        ("nmea", "fg2020.3.16_c172p_nmea.bin", vec!["--json"], 270, 0),
        ("gdl90", "stratux_1.dat", vec!["--json"], 2070, 19),
        ("mgl", "mgl_data1.bin", vec!["--json"], 1154, 0),
        ("ubx", "pyubx2_pygpsdata-MIXED.log", vec!["--json"], 300, 0),
        (
            "fg-generic",
            "fg2020.3.16_c172p_generic_svgc.bin",
            vec!["--json", "--layout", layout],
            229,
            0,
        ),
    ] {
        let document = json_of(&decode(protocol, &bus.join(file), &flags));
        assert_eq!(document["good"], good, "{file}");
        let counts = document["bad"].as_object().expect("an object").values();
        let sum: u64 = counts.filter_map(Value::as_u64).sum();
        assert_eq!(sum, bad, "{file}");
    }
    let traffic = decode("nmea", &bus.join("xcsoar_rl-traffic.nmea"), &["--samples"]);
    let text = String::from_utf8(traffic.stdout).expect("UTF-8");
    let first: Value = serde_json::from_str(text.lines().next().expect("a line")).expect("JSON");
    assert_eq!(first["parameter"], "traffic");
    assert_eq!(first["time"], Value::Null, "raw bytes have no times");
    assert_eq!(first["value"]["north_m"], -1540.0);
    assert_eq!(first["value"]["callsign"], "FJLKN");
}

#[test]
fn lines_of_another_layout_are_told() {
    let folder = support::scratch_dir("decode-layout");
    let file = folder.join("other.txt");
    std::fs::write(&file, "1.5,2.5,3.5\n".repeat(20)).expect("written");
    let output = decode("fg-generic", &file, &["--json"]);
    // The first may have been cut.
    let document = json_of(&output);
    assert_eq!(
        (&document["ignored"], &document["bad"]["short"]),
        (&json!(1), &json!(19))
    );
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(
        text.contains("other.txt") && text.contains("--layout"),
        "{text}"
    );
    assert_eq!(text.lines().count(), 1, "{text}");
}

#[test]
fn traffic_of_others_is_ignored() {
    let Some(data) = support::data_dir() else {
        return;
    };
    let log = data.join("bus/gpsd_nmea2000_20140914.can.log");
    let document = json_of(&decode("canaerospace", &log, &["--json"]));
    assert_eq!(document["ignored"], 10_495);
    assert_eq!(document["good"], 0);
    assert_eq!(document["bad"], json!({}));
}

#[test]
fn a_container_cut_short_is_decoded_counted_and_named() {
    let folder = support::scratch_dir("decode-cut");
    let file = folder.join("cut.bin");
    let whole = small_container();
    std::fs::write(&file, &whole[..whole.len() - 1]).expect("written");
    let output = decode("fgfdm", &file, &["--json"]);
    assert!(output.status.success(), "{output:?}");
    assert_eq!(
        json_of(&output)["bad"],
        json!({ "unknown-version": 1, "truncated": 1 })
    );
    let text = complaint(&output);
    assert!(
        text.contains("cut.bin") && text.contains("record 1"),
        "{text}"
    );
}

#[test]
fn files_that_are_no_capture_end_with_3_and_say_why() {
    let folder = support::scratch_dir("decode-bad");
    let write = |name: &str, bytes: &[u8]| {
        let file = folder.join(name);
        std::fs::write(&file, bytes).expect("written");
        file
    };
    let cases = [
        ("fgfdm", folder.join("absent.bin")),
        ("canaerospace", folder.join("absent.log")),
        ("fgfdm", folder.clone()),
        ("fgfdm", write("empty.bin", b"")),
        ("canaerospace", write("empty.log", b"# only a comment\n")),
        (
            "fgfdm",
            write("text.bin", b"This is no capture, it is prose."),
        ),
        ("canaerospace", write("container.log", &small_container())),
    ];
    for (protocol, file) in cases {
        let output = decode(protocol, &file, &["--json"]);
        assert_eq!(output.status.code(), Some(3), "{}", file.display());
        assert!(output.stdout.is_empty(), "{}", file.display());
        let text = complaint(&output);
        let name = file.file_name().expect("a name").to_string_lossy();
        assert!(text.contains(&*name), "{text}");
    }
}

#[test]
fn samples_and_json_together_are_one_document() {
    let folder = support::scratch_dir("decode-samples");
    let file = folder.join("bus.log");
    std::fs::write(
        &file,
        "(1.5) can0 137#0102000740A66666\n(1.6) can0 137#01000008\n(1.7) can0 137#0102\nnonsense\n",
    )
    .expect("written");
    let output = decode("canaerospace", &file, &["--json", "--samples"]);
    let document = json_of(&output);
    assert_eq!(document["good"], 2);
    assert_eq!(document["bad"], json!({ "short": 1, "malformed": 1 }));
    assert_eq!(document["flow"]["failed"], 1);
    let samples = document["samples"].as_array().expect("an array");
    assert_eq!(samples.len(), 2);
    assert_eq!(samples[0]["time"], 1.5);
    assert_eq!(samples[1]["value"], Value::Null);
    assert_eq!(samples[1]["quality"], "source-failed");
}

#[test]
fn only_protocols_that_are_decoded_are_offered() {
    let output = decode("telepathy", Path::new("x"), &[]);
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    let text = complaint(&output);
    assert!(text.contains("telepathy"), "{text}");
    let help = decode("fgfdm", Path::new("x"), &["--help"]);
    let text = String::from_utf8(help.stdout).expect("UTF-8");
    for protocol in Protocol::ALL {
        assert!(text.contains(protocol.name()), "{text}");
    }
}
