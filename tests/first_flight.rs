//! The main job on real input: real SRTM elevation, real JSBSim packets through a real UDP socket, and pictures out.
//!
//! The flight is replayed at its own pace. Every picture's row in `frames.csv` is held against the simulator's own truth
//! at the packet that was newest then, and in every fifth picture the horizon is found in the pixels and held against the
//! truth too.
#![expect(
    clippy::expect_used,
    clippy::panic,
    reason = "a helper that fails is a test that fails"
)]

#[path = "support/horizon.rs"]
mod horizon;
mod support;

use glasswing::time::Monotonic;
use std::collections::HashMap;
use std::f64::consts::{PI, TAU};
use std::net::UdpSocket;
use std::path::Path;
use std::time::Duration;

/// Frames of the capture that are sent: enough for level flight and both banks (the whole is 30 s).
const SECONDS: f64 = 30.0;

/// The board: headless, as `boards/headless.toml`, on a port of the test's own so that tests may run side by side.
fn board(folder: &Path, port: u16) -> std::path::PathBuf {
    let file = folder.join("board.toml");
    let text = format!(
        "inherit = \"base\"\n[screen]\nkind = \"{}\"\nrate_hz = 20\n[input]\ndevices = false\n\
         [[source]]\nname = \"jsbsim\"\nprotocol = \"fgfdm\"\nudp = \"127.0.0.1:{port}\"\n",
        std::env::var("GLASSWING_TEST_SCREEN").unwrap_or_else(|_| "surfaceless".into()),
    );
    std::fs::write(&file, text).expect("board file is written");
    file
}

/// Packets of a capture: seconds since the first, bytes.
fn packets(file: &Path) -> Vec<(f64, Vec<u8>)> {
    let bytes = std::fs::read(file).expect("the capture is read");
    let mut rest = bytes.as_slice();
    let mut packets = Vec::new();
    while let Some((head, tail)) = rest.split_at_checked(12) {
        let seconds = f64::from_le_bytes(head[..8].try_into().expect("8 bytes"));
        let len = u32::from_le_bytes(head[8..].try_into().expect("4 bytes")) as usize;
        packets.push((seconds, tail[..len].to_vec()));
        rest = &tail[len..];
    }
    packets
}

/// A CSV file as rows of named columns.
fn csv(text: &str) -> Vec<HashMap<String, String>> {
    let mut lines = text.lines();
    let names: Vec<String> = lines
        .next()
        .expect("a header")
        .split(',')
        .map(Into::into)
        .collect();
    lines
        .map(|line| {
            names
                .iter()
                .cloned()
                .zip(line.split(',').map(Into::into))
                .collect()
        })
        .collect()
}

fn number(row: &HashMap<String, String>, column: &str) -> Option<f64> {
    row.get(column)
        .unwrap_or_else(|| panic!("no column {column}"))
        .parse()
        .ok()
}

fn sleep_until(t: Monotonic) {
    if let Some(wait) = t.since(Monotonic::read()) {
        std::thread::sleep(wait);
    }
}

/// Sends every packet at its time; returns when each was sent.
fn replay(packets: &[(f64, Vec<u8>)], port: u16) -> Vec<Monotonic> {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let start = Monotonic::read();
    packets
        .iter()
        .map(|(seconds, bytes)| {
            sleep_until(start.plus(Duration::from_secs_f64(*seconds)));
            let sent = Monotonic::read();
            socket.send_to(bytes, ("127.0.0.1", port)).expect("sent");
            sent
        })
        .collect()
}

#[test]
fn a_real_flight_is_shown_as_it_was_flown() {
    let Some(data) = support::data_dir() else {
        return;
    };
    if support::is_emulated() {
        support::skip("thirty seconds of flight in real time: not under emulation");
        return;
    }
    let folder = support::scratch_dir("first-flight");
    let pack = folder.join("bohemia.pack");
    let tiles = ["N50E014.hgt", "N49E015.hgt", "N49E016.hgt"].map(|t| data.join("elev").join(t));
    let baked = support::glasswing_command()
        .args(["terrain", "bake"])
        .args(&tiles)
        .arg("--out")
        .arg(&pack)
        .status()
        .expect("starts");
    assert!(baked.success(), "bake: {baked}");

    let port = 25_500 + u16::try_from(std::process::id() % 1000).expect("small");
    let frames = folder.join("frames");
    let mut run = support::glasswing_command()
        .arg("run")
        .arg("--board")
        .arg(board(&folder, port))
        .arg("--pack")
        .arg(&pack)
        .arg("--frames-dir")
        .arg(&frames)
        .args(["--seconds", "36"])
        .arg("--stats")
        .arg(folder.join("stats.json"))
        .spawn()
        .expect("starts");
    while !frames.join("frame-000000.png").exists() {
        assert!(
            run.try_wait().expect("asked").is_none(),
            "run ended before its first frame"
        );
        std::thread::sleep(Duration::from_millis(20));
    }
    let mut capture = packets(&data.join("bus/jsbsim_c172x_netfdm.bin"));
    capture.retain(|(seconds, _)| *seconds < SECONDS);
    let sent = replay(&capture, port);
    let ended = run.wait().expect("ends");
    assert!(ended.success(), "run: {ended}");

    let rows = csv(&std::fs::read_to_string(frames.join("frames.csv")).expect("is there"));
    let truth_file = data.join("bus/jsbsim_c172x_netfdm.bin.truth.csv");
    let truth = csv(&std::fs::read_to_string(truth_file).expect("is there"));
    compare(&rows, &sent, &truth, &frames);
    figures(&folder.join("stats.json"), capture.len());
}

/// Every row against the truth at its packet: packet `i` of this capture is row `i - 1` of the truth (the first packet is
/// the simulator's initial condition; the last 32 have no row).
fn compare(
    rows: &[HashMap<String, String>],
    sent: &[Monotonic],
    truth: &[HashMap<String, String>],
    frames: &Path,
) {
    let (mut compared, mut horizons) = (0, 0);
    for row in rows {
        let now_ns = number(row, "monotonic_ns").expect("always there");
        // No attitude: before the first packet, or more than 0.3 s after the last one.
        let (Some(age_s), Some(pitch)) = (number(row, "attitude_age_s"), number(row, "pitch_rad"))
        else {
            continue;
        };
        let received_ns = now_ns - age_s * 1e9;
        #[expect(
            clippy::cast_precision_loss,
            reason = "nanoseconds since boot are below 2^53"
        )]
        let packet = sent.partition_point(|t| t.as_nanos() as f64 <= received_ns + 1e5);
        let Some(expected) = packet.checked_sub(2).and_then(|i| truth.get(i)) else {
            continue;
        };
        let want = |column| number(expected, column).expect("truth is complete");
        let shown =
            |column| number(row, column).unwrap_or_else(|| panic!("{column} not shown: {row:?}"));
        let turn = |a: f64, b: f64| {
            ((a - b + 540_f64.to_radians()).rem_euclid(TAU) - PI)
                .to_degrees()
                .abs()
        };
        let file = &row["file"];
        for (column, expected) in [
            ("roll_rad", want("phi")),
            ("pitch_rad", want("theta")),
            ("heading_true_rad", want("psi")),
        ] {
            assert!(
                turn(shown(column), expected) < 0.1,
                "{file}: {column} {} not {expected}",
                shown(column)
            );
        }
        let north_m = (shown("latitude_rad").to_degrees() - want("lat_geod_deg")) * 111_200.0;
        let east_m = (shown("longitude_rad").to_degrees() - want("lon_deg")) * 71_500.0;
        assert!(
            north_m.hypot(east_m) < 1.0,
            "{file}: {north_m} m north, {east_m} m east of the truth"
        );
        assert!(
            (shown("altitude_msl_m") - want("h_sl_m")).abs() < 1.0,
            "{file}: altitude"
        );
        let kt = shown("calibrated_airspeed_mps") * 3600.0 / 1852.0;
        assert!((kt - want("vc_kts")).abs() < 0.5, "{file}: {kt} kt");
        compared += 1;
        if compared % 5 == 0 {
            let picture = horizon::Picture::read(&frames.join(file));
            let found = horizon::find(&picture, 60_f64.to_radians())
                .unwrap_or_else(|| panic!("{file}: no horizon"));
            assert!(
                (found.roll_deg - want("phi").to_degrees()).abs() < 0.5,
                "{file}: {found:?}, roll {}",
                want("phi").to_degrees()
            );
            assert!(
                (found.pitch_deg - pitch.to_degrees()).abs() < 0.5,
                "{file}: {found:?}, pitch {}",
                pitch.to_degrees()
            );
            horizons += 1;
        }
    }
    assert!(
        compared > 60 && horizons > 10,
        "{compared} frames, {horizons} horizons compared"
    );
}

/// What the run says of itself.
fn figures(stats: &Path, packets: usize) {
    let text = std::fs::read_to_string(stats).expect("is there");
    let stats: serde_json::Value = serde_json::from_str(&text).expect("is JSON");
    assert_eq!(stats["sources"][0]["good"], packets, "{stats}");
    assert_eq!(stats["sources"][0]["dropped"], 0, "{stats}");
    assert_eq!(stats["allocations_after_ready"], 0, "{stats}");
}
