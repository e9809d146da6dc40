//! Damaged packets through a real socket into the running program: each is counted by its kind, none is shown, and the
//! display goes on with what is good.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

mod support;

use glasswing::time::Monotonic;
use std::net::{SocketAddr, UdpSocket};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A whole version-24 packet: level, north, over 50 N 14 E at 1500 m, 100 kt. Offsets as FlightGear's `net_fdm.hxx` lays
/// them out, all big-endian.
fn packet(pitch_rad: f32) -> Vec<u8> {
    let mut bytes = vec![0; 408];
    bytes[..4].copy_from_slice(&24_u32.to_be_bytes());
    bytes[8..16].copy_from_slice(&14_f64.to_radians().to_be_bytes());
    bytes[16..24].copy_from_slice(&50_f64.to_radians().to_be_bytes());
    bytes[24..32].copy_from_slice(&1500_f64.to_be_bytes());
    bytes[40..44].copy_from_slice(&pitch_rad.to_be_bytes());
    bytes[68..72].copy_from_slice(&100_f32.to_be_bytes());
    bytes
}

/// Each round sends every bad one followed by a good one, so that a value that slipped through would be shown, not stale.
const ROUNDS: u64 = 30;

/// A board that listens to `address` and draws small pictures.
fn board(folder: &Path, address: SocketAddr) -> PathBuf {
    let file = folder.join("board.toml");
    let screen = std::env::var("GLASSWING_TEST_SCREEN").unwrap_or_else(|_| "surfaceless".into());
    let text = format!(
        "inherit = \"base\"\n[screen]\nkind = \"{screen}\"\nsize_px = \"320x200\"\n[input]\ndevices = false\n\
         [[source]]\nname = \"sim\"\nprotocol = \"fgfdm\"\nudp = \"{address}\"\n"
    );
    std::fs::write(&file, text).expect("written");
    file
}

/// Sends them all; returns when the last has gone.
fn send(address: SocketAddr) -> Monotonic {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let good = packet(0.125);
    let mut long = good.clone();
    long.push(0);
    let mut newer = good.clone();
    newer[3] = 99;
    let bad = [
        good[..407].to_vec(),
        vec![],
        long,
        newer,
        packet(f32::NAN),
        packet(f32::INFINITY),
        packet(40.0),
    ];
    for _ in 0..ROUNDS {
        for damaged in &bad {
            for bytes in [damaged, &good] {
                socket.send_to(bytes, address).expect("sent");
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }
    Monotonic::read()
}

#[test]
fn damaged_packets_are_counted_by_kind_and_never_shown() {
    let folder = support::scratch_dir("damaged-flight");
    let free = UdpSocket::bind("127.0.0.1:0").expect("a port");
    let address = free.local_addr().expect("bound");
    drop(free);
    let (frames, stats) = (folder.join("frames"), folder.join("stats.json"));
    let seconds = if support::is_emulated() { "25" } else { "6" };
    let mut run = support::glasswing_command()
        .arg("run")
        .arg("--board")
        .arg(board(&folder, address))
        .arg("--frames-dir")
        .arg(&frames)
        .args(["--seconds", seconds])
        .arg("--stats")
        .arg(&stats)
        .spawn()
        .expect("starts");
    while !frames.join("frame-000000.png").exists() {
        let ended = run.try_wait().expect("asked");
        assert!(ended.is_none(), "ended before its first frame");
        std::thread::sleep(Duration::from_millis(20));
    }
    let sent_all = send(address);
    assert!(run.wait().expect("ends").success(), "run");
    all_are_counted(&stats);
    only_the_good_is_shown(&frames.join("frames.csv"), sent_all);
}

fn all_are_counted(stats: &Path) {
    let text = std::fs::read_to_string(stats).expect("is there");
    let stats: serde_json::Value = serde_json::from_str(&text).expect("is JSON");
    let source = &stats["sources"][0];
    let kinds = &source["bad_by_kind"];
    assert_eq!(source["good"], 7 * ROUNDS, "{stats}");
    assert_eq!(source["bad"], 7 * ROUNDS, "{stats}");
    assert_eq!(
        kinds["short"],
        2 * ROUNDS,
        "a cut one and an empty one: {stats}"
    );
    assert_eq!(kinds["long"], ROUNDS, "{stats}");
    assert_eq!(kinds["unknown-version"], ROUNDS, "{stats}");
    assert_eq!(kinds["not-finite"], 2 * ROUNDS, "{stats}");
    assert_eq!(kinds["out-of-range"], ROUNDS, "{stats}");
}

/// Every pitch that was shown is the good one; after the last packet it went stale and stayed so.
fn only_the_good_is_shown(csv: &Path, sent_all: Monotonic) {
    let csv = std::fs::read_to_string(csv).expect("is there");
    let rows: Vec<Vec<&str>> = csv.lines().map(|l| l.split(',').collect()).collect();
    let column = |name: &str| rows[0].iter().position(|n| *n == name).expect("a column");
    let (pitch, at) = (column("pitch_rad"), column("monotonic_ns"));
    let mut shown = 0;
    for row in &rows[1..] {
        if let Ok(value) = row[pitch].parse::<f64>() {
            shown += 1;
            assert!((value - 0.125).abs() < 1e-6, "shown: {row:?}");
        } else {
            let reasons = ["!never-received", "!stale", "!out-of-range"];
            assert!(reasons.contains(&row[pitch]), "{row:?}");
        }
        let judged = Monotonic::from_nanos(row[at].parse().expect("a number"));
        if judged > sent_all.plus(Duration::from_millis(300)) {
            assert_eq!(row[pitch], "!stale", "silence for more than 0.3 s");
        }
    }
    assert!(shown > 0, "good packets between the bad ones were shown");
    assert_eq!(
        rows.last().expect("rows")[pitch],
        "!stale",
        "the end was silent"
    );
}
