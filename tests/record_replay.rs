//! Recordings as a user makes and replays them: what was seen live comes out again, the same every time; a process that is
//! killed, a disk that is full and files that are damaged cost what they must and are told.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

mod bus_support;
mod support;

use bus_support::{Line, has_no_serial_ports};
use glasswing::app::board::Board;
use glasswing::app::playback::{Player, Reel, START};
use glasswing::proto::canaerospace::encode;
use glasswing::signal::Parameter;
use glasswing::time::Monotonic;
use std::collections::HashMap;
use std::fmt::Write as _;
use std::fs;
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::time::Duration;

/// A board that draws small pictures of these sources.
fn board(folder: &Path, sources: &str) -> PathBuf {
    let file = folder.join("board.toml");
    let screen = std::env::var("GLASSWING_TEST_SCREEN").unwrap_or_else(|_| "surfaceless".into());
    let text = format!(
        "inherit = \"base\"\n[screen]\nkind = \"{screen}\"\nsize_px = \"320x200\"\nrate_hz = 10\n\
         antialiasing = \"none\"\n[terrain]\nvertices = 127\n[input]\ndevices = false\n{sources}"
    );
    fs::write(&file, text).expect("written");
    file
}

fn udp(port: u16) -> String {
    format!("[[source]]\nname = \"sim\"\nprotocol = \"fgfdm\"\nudp = \"127.0.0.1:{port}\"\n")
}

fn free_port() -> u16 {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    socket.local_addr().expect("bound").port()
}

/// A packet of FlightGear's: attitude, position, speeds, altitude, all of them other ones each time.
fn packet(k: u32) -> Vec<u8> {
    let mut bytes = vec![0; 408];
    bytes[..4].copy_from_slice(&24_u32.to_be_bytes());
    let t = f64::from(k) * 0.02;
    for (offset, value) in [
        (8, 0.2495 + t * 1e-6),
        (16, 0.8744 + t * 1e-6),
        (24, 1500.0 + t),
    ] {
        bytes[offset..offset + 8].copy_from_slice(&f64::to_be_bytes(value));
    }
    #[expect(
        clippy::cast_possible_truncation,
        reason = "the packet has 32-bit fields"
    )]
    for (offset, value) in [
        (36, (0.3 * t).sin() * 0.3),
        (40, 0.05 + 0.01 * t.cos()),
        (44, 1.0 + 0.01 * t),
        (68, 95.0 + t.sin()),
        (76, 100.0),
        (80, 120.0),
    ] {
        bytes[offset..offset + 4].copy_from_slice(&(value as f32).to_be_bytes());
    }
    bytes
}

/// An ADAHRS message of Dynon SkyView's.
const SKYVIEW: &str =
    "!1112345600+052-01232710955+03500-031+02+1025-020+151001+00+03900240125B\r\n";

/// A UDP capture container of a flight.
fn container(file: &Path, packets: u32) {
    let mut bytes = Vec::new();
    for k in 0..packets {
        let packet = packet(k);
        bytes.extend((100.0 + f64::from(k) * 0.02).to_le_bytes());
        bytes.extend(u32::try_from(packet.len()).expect("short").to_le_bytes());
        bytes.extend(packet);
    }
    fs::write(file, bytes).expect("written");
}

fn glasswing(args: &[&str]) -> Output {
    support::glasswing_command()
        .args(args)
        .output()
        .expect("starts")
}

fn ok(args: &[&str]) -> (String, String) {
    let output = glasswing(args);
    let texts =
        [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
    assert!(output.status.success(), "{args:?}: {texts:?}");
    let [stdout, stderr] = texts;
    (stdout, stderr)
}

fn text(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

/// The rows of a state table, by frame and parameter.
fn states(csv: &Path) -> HashMap<(u64, String), Vec<String>> {
    let csv = fs::read_to_string(csv).expect("there");
    let mut lines = csv.lines();
    assert_eq!(
        lines.next(),
        Some("frame,time_s,clock_s,parameter,value,unit,source,age_s,why"),
        "the head of the table"
    );
    let row = |line: &str| {
        let cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        (
            (cells[0].parse().expect("a number"), cells[3].clone()),
            cells,
        )
    };
    lines.map(row).collect()
}

#[test]
fn a_recording_replays_to_the_same_states_and_pictures_every_time() {
    let folder = support::scratch_dir("replay-twice");
    let recording = folder.join("flight.bin");
    let frames = if support::is_emulated() { 5 } else { 20 };
    container(&recording, frames * 5 + 1);
    let pack = folder.join("demo.pack");
    let real = support::data_dir().filter(|_| !support::is_emulated());
    let mut args = vec!["replay", text(&recording), "--hash", "--state"];
    if let Some(data) = &real {
        let tile = data.join("elev/N50E014.hgt");
        ok(&["terrain", "bake", text(&tile), "--out", text(&pack)]);
        args.extend(["--pack", text(&pack)]);
    }
    let file = board(&folder, &udp(5500));
    let run = |name: &str| {
        let csv = folder.join(name);
        let mut args = args.clone();
        args.splice(4..4, [text(&csv)]);
        let (hashes, _) = ok(&[&args[..], &["--board", text(&file)]].concat());
        (hashes, fs::read(&csv).expect("there"))
    };
    let expected = usize::try_from(frames).expect("few");
    let (hashes, states) = run("one.csv");
    assert_eq!(
        hashes.lines().count(),
        expected + 1,
        "a frame every 0.1 s:\n{hashes}"
    );
    let mut distinct: Vec<&str> = hashes.lines().map(|l| &l[..64]).collect();
    distinct.sort_unstable();
    distinct.dedup();
    assert_eq!(
        distinct.len(),
        expected + 1,
        "the flight moves in every picture"
    );
    for again in ["two.csv", "three.csv"] {
        assert_eq!(
            (&hashes, &states),
            (&run(again).0, &run(again).1),
            "the same every time"
        );
    }
    let out = folder.join("frames");
    ok(&[
        "replay",
        text(&recording),
        "--board",
        text(&file),
        "--out",
        text(&out),
    ]);
    assert_eq!(
        fs::read_dir(&out).expect("there").count(),
        expected + 2,
        "pictures and their table"
    );
}

#[test]
fn each_state_says_value_unit_source_age_and_why_not() {
    let folder = support::scratch_dir("replay-state");
    let recording = folder.join("flight.bin");
    container(&recording, 51);
    let csv = folder.join("state.csv");
    let file = board(&folder, &udp(5500));
    ok(&[
        "replay",
        text(&recording),
        "--board",
        text(&file),
        "--state",
        text(&csv),
    ]);
    let rows = states(&csv);
    assert_eq!(
        rows.len(),
        11 * Parameter::COUNT,
        "every parameter in every frame"
    );
    let cells = |frame, parameter: &str| rows[&(frame, parameter.to_owned())].clone();
    let pitch = cells(3, "pitch_rad");
    assert_eq!(
        (pitch[1].as_str(), pitch[2].as_str()),
        ("0.300000", "100.300000000"),
        "both clocks"
    );
    let value: f64 = pitch[4].parse().expect("a number");
    assert!(
        (value - (0.05 + 0.01 * 0.3_f64.cos())).abs() < 1e-6,
        "{pitch:?}"
    );
    assert_eq!(
        pitch[5..],
        ["rad", "sim", "0.000000", ""],
        "unit, source, age, nothing wrong"
    );
    let oil = cells(3, "oil_temperature_k");
    assert_eq!(
        oil[4..],
        ["", "k", "", "", "never-received"],
        "and what is not there"
    );
    let wind = cells(3, "wind_speed_mps");
    assert!(wind[8].contains('('), "what is missing for it: {wind:?}");
}

#[test]
fn every_kind_of_capture_is_replayed_on_its_own_clock() {
    let folder = support::scratch_dir("replay-kinds");
    let file = board(
        &folder,
        "[[source]]\nname = \"adahrs\"\nprotocol = \"canaerospace\"\ncan = \"can0\"\n\
        [[source]]\nname = \"efis\"\nprotocol = \"dynon-skyview\"\nserial = \"/dev/ttyUSB0\"\nbaud = 9600\n",
    );
    let csv = folder.join("state.csv");
    let replay = |recording: &Path, more: &[&str]| {
        let args = [
            "replay",
            text(recording),
            "--board",
            text(&file),
            "--state",
            text(&csv),
        ];
        let (_, said) = ok(&[&args[..], more].concat());
        (states(&csv), said)
    };
    // A candump log: the interface is the board's.
    let log = folder.join("can.log");
    let mut lines = String::from("# a comment\nno line of a log\n");
    for k in 0..60_u8 {
        let can = encode(Parameter::Roll, f64::from(k) * 0.01, 1, k).expect("encodes");
        let data: String = can.bytes().iter().map(|b| format!("{b:02X}")).collect();
        writeln!(
            lines,
            "({:.6}) can0 {:03X}#{data}",
            1e9 + f64::from(k) * 0.02,
            can.id
        )
        .expect("a text");
    }
    fs::write(&log, &lines).expect("written");
    let (rows, said) = replay(&log, &[]);
    assert!(
        said.contains("adahrs: 60 good") && said.contains("1 lines"),
        "{said}"
    );
    let roll = &rows[&(10, "roll_rad".to_owned())];
    let value: f64 = roll[4].parse().expect("a number");
    assert!(
        (value - 0.5).abs() < 1e-6 && roll[6] == "adahrs",
        "{roll:?}"
    );
    // Bytes of a serial line: 77 ms a frame at 9600 baud.
    let raw = folder.join("skyview.txt");
    fs::write(&raw, SKYVIEW.repeat(20)).expect("written");
    let (rows, said) = replay(&raw, &[]);
    assert!(
        said.contains("raw bytes have no times") && said.contains("9600 baud (the board's)"),
        "{said}"
    );
    let last = rows.keys().map(|(frame, _)| *frame).max().expect("frames");
    assert_eq!(
        last,
        16,
        "{} bytes take 1.58 s but for the first piece",
        20 * SKYVIEW.len()
    );
    let (rows, _) = replay(&raw, &["--baud", "115200"]);
    assert_eq!(
        rows.keys().map(|(frame, _)| *frame).max(),
        Some(2),
        "and a twelfth at 115200"
    );
    // Nobody can have sent it.
    let bin = folder.join("flight.bin");
    container(&bin, 3);
    let refused = glasswing(&["replay", text(&bin), "--board", text(&file)]);
    let said = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(2), "{said}");
    assert!(
        said.contains("it is a UDP capture") && said.contains("--as"),
        "{said}"
    );
    let (_, said) = replay(&bin, &["--as", "fgfdm"]);
    assert!(said.contains("fgfdm: 3 good"), "{said}");
}

/// Sends packets to a port until told otherwise, every 20 ms; returns when each was sent.
fn send_while(port: u16, mut go_on: impl FnMut(u32) -> bool) -> Vec<Monotonic> {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let mut sent = Vec::new();
    for k in 0.. {
        if !go_on(k) {
            break;
        }
        socket
            .send_to(&packet(k), ("127.0.0.1", port))
            .expect("sent");
        sent.push(Monotonic::read());
        std::thread::sleep(Duration::from_millis(20));
    }
    sent
}

/// Waits until the port is somebody else's.
fn wait_for_listener(port: u16) {
    bus_support::wait_until("the port is bound", || {
        UdpSocket::bind(("127.0.0.1", port)).is_err()
    });
}

#[test]
fn what_was_seen_live_is_what_the_recording_replays_to() {
    if support::is_emulated() || has_no_serial_ports() {
        return;
    }
    let folder = support::scratch_dir("replay-live");
    let (port, line) = (free_port(), Line::new());
    let serial = format!(
        "[[source]]\nname = \"efis\"\nprotocol = \"dynon-skyview\"\nserial = \"{}\"\nbaud = 115200\n",
        line.path
    );
    let file = board(&folder, &(serial + &udp(port)));
    let (recording, frames) = (folder.join("flight.gwr"), folder.join("frames"));
    let mut run = support::glasswing_command()
        .args(["run", "--board", text(&file), "--seconds", "4"])
        .args(["--record", text(&recording), "--frames-dir", text(&frames)])
        .spawn()
        .expect("starts");
    wait_for_listener(port);
    // The line falls silent in the middle, so that what it said comes from the other source then.
    send_while(port, |k| {
        if k % 5 == 0 && k < 80 {
            line.send(SKYVIEW.as_bytes());
        }
        run.try_wait().expect("asked").is_none()
    });
    assert!(run.wait().expect("ended").success(), "flown");
    compare(&file, &recording, &frames);
}

/// Every row of `frames.csv` against the recording at that moment. Nobody can say on which side of a picture a frame stands
/// that was received within a few milliseconds before it.
fn compare(board: &Path, recording: &Path, frames: &Path) {
    let board = Board::load(board).expect("a board");
    let csv = fs::read_to_string(frames.join("frames.csv")).expect("there");
    let names: Vec<&str> = csv.lines().next().expect("a header").split(',').collect();
    let column = |name: &str| names.iter().position(|n| *n == name).expect("a column");
    let player =
        || Player::new(Reel::open(recording, &board, None, None).expect("opens")).expect("reads");
    let mut probe = player();
    probe.state_at(START).expect("reads");
    let first = probe.clock_at(START).expect("a frame");
    let (mut exact, mut near) = (player(), player());
    let (mut compared, mut of_line) = (0, 0);
    for line in csv.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let now = Duration::from_nanos(cells[column("monotonic_ns")].parse().expect("a number"));
        let Some(after) = now.checked_sub(first + Duration::from_millis(20)) else {
            continue;
        };
        let now = START.plus(after + Duration::from_millis(20));
        let before = START.plus(after + Duration::from_millis(15));
        let of = |player: &mut Player, at| {
            let state = player.state_at(at).expect("reads");
            let shown = |p: &Parameter| match state.read(*p, now) {
                Ok(value) => value.to_string(),
                Err(reason) => format!("!{}", reason.name()),
            };
            let texts: Vec<String> = Parameter::ALL.iter().map(shown).collect();
            (texts, state.source(Parameter::Pitch))
        };
        let live: Vec<&str> = Parameter::ALL
            .iter()
            .map(|p| cells[column(p.spec().name)])
            .collect();
        let candidates = [of(&mut exact, now), of(&mut near, before)];
        assert!(
            candidates.iter().any(|(texts, _)| *texts == live),
            "{live:?}\n{candidates:?}"
        );
        compared += 1;
        of_line += usize::from(candidates[0].1.is_some_and(|id| id.0 == 0));
    }
    assert!(
        compared > 20 && of_line > 5 && of_line < compared,
        "{of_line} of {compared}"
    );
}

#[test]
fn a_killed_recorder_leaves_everything_but_its_last_second() {
    if support::is_emulated() {
        support::skip("frames at their times: not under emulation");
        return;
    }
    let folder = support::scratch_dir("record-killed");
    let port = free_port();
    let file = board(&folder, &udp(port));
    let recording = folder.join("flight.gwr");
    let mut record = support::glasswing_command()
        .args([
            "record",
            "--board",
            text(&file),
            "--out",
            text(&recording),
            "--size-limit",
            "1M",
        ])
        .spawn()
        .expect("starts");
    wait_for_listener(port);
    let sent = send_while(port, |k| k < 150);
    let killed = Monotonic::read();
    record.kill().expect("killed");
    record.wait().expect("gone");
    let (_, said) = ok(&["replay", text(&recording), "--board", text(&file)]);
    let good: usize = said
        .lines()
        .find_map(|line| line.strip_prefix("sim: ")?.split(' ').next()?.parse().ok())
        .expect("a count");
    let old = sent.iter().filter(|at| {
        killed
            .since(**at)
            .is_some_and(|age| age > Duration::from_secs(1))
    });
    assert!(
        good >= old.count() && good <= sent.len(),
        "{good} of {}",
        sent.len()
    );
    // The end of the file as a cut leaves it, and damage in its middle.
    let mut bytes = fs::read(&recording).expect("there");
    bytes.truncate(bytes.len() - 7);
    let middle = bytes.len() / 2;
    bytes[middle..middle + 3].fill(0xFF);
    fs::write(&recording, &bytes).expect("written");
    let (_, said) = ok(&["replay", text(&recording), "--board", text(&file)]);
    assert!(
        said.contains("1 damaged places") && said.contains("were skipped"),
        "{said}"
    );
    assert!(said.contains("unfinished record at the end"), "{said}");
}

/// A small disk, gone when dropped.
struct Disk(PathBuf);

impl Drop for Disk {
    fn drop(&mut self) {
        let _ = std::process::Command::new("umount").arg(&self.0).status();
    }
}

#[test]
fn a_full_disk_is_told_and_what_fits_it_can_be_replayed() {
    let folder = support::scratch_dir("record-full");
    let disk = Disk(folder.join("disk"));
    fs::create_dir(&disk.0).expect("made");
    let mounted = std::process::Command::new("mount")
        .args(["-t", "tmpfs", "-o", "size=64k", "tmpfs"])
        .arg(&disk.0)
        .output()
        .is_ok_and(|output| output.status.success());
    if !mounted || support::is_emulated() {
        support::skip("no small disk here (it takes root)");
        return;
    }
    let port = free_port();
    let file = board(&folder, &udp(port));
    let recording = disk.0.join("flight.gwr");
    let mut record = support::glasswing_command();
    record.args(["record", "--board", text(&file), "--out", text(&recording)]);
    let mut record = record
        .stderr(std::process::Stdio::piped())
        .spawn()
        .expect("starts");
    wait_for_listener(port);
    send_while(port, |k| {
        k < 1000 && record.try_wait().expect("asked").is_none()
    });
    let output = record.wait_with_output().expect("ended");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(
        said.contains("cannot be written any more") && said.contains("make room"),
        "{said}"
    );
    let (_, said) = ok(&["replay", text(&recording), "--board", text(&file)]);
    assert!(
        said.contains("good, 0 bad") && !said.contains("damaged"),
        "{said}"
    );
}

#[test]
fn a_recording_that_cannot_be_made_or_read_is_one_line() {
    let folder = support::scratch_dir("record-refused");
    let file = board(&folder, &udp(free_port()));
    let letter = folder.join("letter.txt");
    fs::write(&letter, "Dear Sir").expect("written");
    let nowhere = folder.join("nowhere/x.gwr");
    let empty = folder.join("empty.log");
    fs::write(&empty, "").expect("written");
    let quiet = folder.join("quiet.toml");
    fs::write(&quiet, "inherit = \"base\"\n").expect("written");
    let board = ["--board", text(&file)];
    let (letter, nowhere, empty) = (text(&letter), text(&nowhere), text(&empty));
    let with = |words: &[&'static str], path, more: &[&'static str]| {
        refusal(&[words, &[path], more, &board].concat())
    };
    let other = "it is no recording";
    for (said, code, why) in [
        (with(&["record", "--out"], letter, &[]), 3, other),
        (
            with(&["record", "--out"], nowhere, &[]),
            1,
            "cannot be written",
        ),
        (with(&["run", "--record"], letter, &[]), 3, other),
        (with(&["replay"], nowhere, &[]), 3, "no such recording"),
        (with(&["replay"], empty, &["--as", "nmea"]), 3, "no frame"),
        (
            with(&["replay"], letter, &["--as", "can-fix"]),
            3,
            "no frame of a candump log",
        ),
    ] {
        assert!(
            said.0 == Some(code) && said.1.contains(why),
            "{why}: {said:?}"
        );
    }
    let (code, said) = refusal(&["record", "--board", text(&quiet), "--out", empty]);
    assert!(
        code == Some(2) && said.contains("names no source"),
        "{said}"
    );
    assert_eq!(fs::read(letter).expect("there"), b"Dear Sir", "untouched");
}

/// The code of a command that is refused, and its one line.
fn refusal(args: &[&str]) -> (Option<i32>, String) {
    let output = glasswing(args);
    let said = String::from_utf8_lossy(&output.stderr);
    let lines: Vec<&str> = said
        .lines()
        .filter(|l| l.starts_with("glasswing: "))
        .collect();
    assert!(
        lines.len() == 1 && lines[0].ends_with(')'),
        "{args:?}: {said}"
    );
    (output.status.code(), lines[0].to_owned())
}
