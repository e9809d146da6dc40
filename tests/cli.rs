//! The command line as a user meets it: help that is complete, and for every wrong input one clear line and its exit code.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

mod support;

use std::net::UdpSocket;
use std::process::Output;

fn glasswing(args: &[&str]) -> Output {
    support::glasswing_command()
        .args(args)
        .output()
        .expect("starts")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// The command ends with `code` and each of its complaints has the form `glasswing: WHAT: WHY (WHAT TO DO)`; one of
/// them holds all of `parts`.
fn refused(args: &[&str], code: i32, parts: &[&str]) {
    let output = glasswing(args);
    let complaint = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{args:?}: {complaint}");
    let lines: Vec<&str> = complaint
        .lines()
        .filter(|l| l.starts_with("glasswing: "))
        .collect();
    for line in &lines {
        assert!(
            line.ends_with(')') && line.contains(" ("),
            "{args:?}: says not what to do: {line}"
        );
    }
    assert!(
        lines
            .iter()
            .any(|line| parts.iter().all(|part| line.contains(part))),
        "{args:?}: no line holds {parts:?}: {complaint}"
    );
    assert!(!complaint.contains("panicked"), "{args:?}: {complaint}");
}

#[test]
fn every_command_has_help_with_an_example() {
    let commands: &[&[&str]] = &[
        &["run"],
        &["demo"],
        &["terrain", "bake"],
        &["terrain", "synth"],
        &["terrain", "info"],
        &["terrain", "verify"],
        &["terrain", "height"],
        &["shot"],
        &["measure", "accuracy"],
        &["measure", "speed"],
        &["measure", "latency"],
        &["decode"],
        &["record"],
        &["replay"],
        &["simulate"],
        &["check"],
        &["list"],
    ];
    for command in commands {
        let mut args = command.to_vec();
        args.push("--help");
        let output = glasswing(&args);
        let help = text(&output.stdout);
        assert_eq!(output.status.code(), Some(0), "{command:?}");
        assert!(
            help.contains("Example"),
            "{command:?} has no example:\n{help}"
        );
        assert!(
            help.contains(&format!("glasswing {}", command.join(" "))),
            "{command:?}: {help}"
        );
    }
}

#[test]
fn wrong_usage_is_one_line() {
    refused(&["run", "--boards", "x"], 2, &["--boards", "--help"]);
    refused(&["shot", "--eye", "1,2"], 2, &["--eye"]);
    refused(&["run", "--seconds", "minus"], 2, &["--seconds"]);
    refused(
        &["simulate", "--profile", "demo"],
        2,
        &["--as", "simulate --help"],
    );
}

#[test]
fn a_board_file_with_faults_is_refused_with_every_key_named() {
    let folder = support::scratch_dir("cli-board");
    let file = folder.join("cockpit.toml");
    std::fs::write(
        &file,
        "inherit = \"base\"\n[view]\nhfov_rad = 1\n[units]\npressure = \"psi\"\n",
    )
    .expect("written");
    let path = file.to_str().expect("UTF-8");
    refused(
        &["run", "--board", path],
        2,
        &["cockpit.toml", "hfov_rad", "hfov_deg"],
    );
    let complaint = text(&glasswing(&["check", "--board", path]).stderr);
    assert!(
        complaint.contains("units.pressure"),
        "check names all of them: {complaint}"
    );
    refused(
        &["run", "--board", "/nowhere/board.toml"],
        2,
        &["/nowhere/board.toml", "cannot be read"],
    );
}

/// A headless board with one source, `a`.
fn board_with(folder: &str, source: &str) -> String {
    let file = support::scratch_dir(folder).join("cockpit.toml");
    let screen = std::env::var("GLASSWING_TEST_SCREEN").unwrap_or_else(|_| "surfaceless".into());
    let text = format!(
        "inherit = \"base\"\n[screen]\nkind = \"{screen}\"\nsize_px = \"160x120\"\n[input]\ndevices = false\n\
         [[source]]\nname = \"a\"\n{source}\n"
    );
    std::fs::write(&file, text).expect("written");
    file.to_str().expect("UTF-8").to_owned()
}

#[test]
fn a_source_that_is_not_there_is_told_and_waited_for() {
    let taken = UdpSocket::bind("127.0.0.1:0").expect("a port");
    let port = taken.local_addr().expect("bound").port();
    let absent = [
        (
            "protocol = \"canaerospace\"\ncan = \"nocan7\"".to_owned(),
            "source[0].can: can nocan7: ",
        ),
        (
            format!("protocol = \"fgfdm\"\nudp = \"127.0.0.1:{port}\""),
            "another program listens on port",
        ),
        (
            format!("protocol = \"fgfdm\"\nudp = \"203.0.113.77:{port}\""),
            "203.0.113.77 is no address of this machine",
        ),
        (
            "protocol = \"nmea\"\nserial = \"/dev/ttyNONE\"\nbaud = 4800".to_owned(),
            "there is no such port",
        ),
    ];
    for (source, why) in absent {
        let board = board_with("cli-absent", &source);
        let stats = std::path::Path::new(&board).with_file_name("stats.json");
        let stats_path = stats.to_str().expect("UTF-8");
        let args = [
            "run",
            "--board",
            &board,
            "--seconds",
            "0.5",
            "--stats",
            stats_path,
        ];
        let output = glasswing(&args);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "it flies: {said}");
        let told: Vec<&str> = said.lines().filter(|l| l.contains(why)).collect();
        assert_eq!(told.len(), 1, "told once: {said}");
        assert!(
            told[0].contains("source a is closed") && told[0].ends_with(')'),
            "{said}"
        );
        let stats: serde_json::Value =
            serde_json::from_slice(&std::fs::read(&stats).expect("there")).expect("JSON");
        assert_eq!(stats["sources"][0]["state"], "closed", "{stats}");
        refused(&["check", "--board", &board], 4, &[why]);
    }
}

#[test]
fn a_device_of_another_kind_is_refused_for_good() {
    if support::is_emulated() {
        support::skip("no serial ports under emulation");
        return;
    }
    let source = "protocol = \"nmea\"\nserial = \"/dev/null\"\nbaud = 4800";
    let board = board_with("cli-lasting", source);
    for command in ["run", "record"] {
        let out = std::path::Path::new(&board).with_file_name("x.gwr");
        let out = out.to_str().expect("UTF-8");
        let mut args = vec![command, "--board", &board, "--seconds", "1"];
        if command == "record" {
            args.extend(["--out", out]);
        }
        refused(&args, 4, &["/dev/null", "is no serial port"]);
    }
}

#[test]
fn terrain_that_is_not_there_or_damaged_is_named() {
    let folder = support::scratch_dir("cli-terrain");
    let missing = folder.join("missing.pack");
    let missing = missing.to_str().expect("UTF-8");
    for args in [
        &["terrain", "info", missing][..],
        &["terrain", "verify", missing],
        &["terrain", "height", missing, "50", "14"],
        &[
            "run",
            "--board",
            "boards/headless.toml",
            "--pack",
            missing,
            "--seconds",
            "1",
        ],
        &[
            "shot",
            "--pack",
            missing,
            "--eye",
            "50,14,1000",
            "--attitude",
            "0,0,0",
            "--hfov",
            "60",
            "--size",
            "64x64",
            "--out",
            "x.png",
        ],
    ] {
        refused(args, 3, &["missing.pack"]);
    }
    let junk = folder.join("junk.pack");
    std::fs::write(&junk, b"this is no pack at all, only a line of text").expect("written");
    refused(
        &["terrain", "info", junk.to_str().expect("UTF-8")],
        3,
        &["junk.pack"],
    );
}
