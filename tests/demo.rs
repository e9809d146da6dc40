//! The demo, whole: synthetic terrain, a flight as CANaerospace frames through the real decoder and state, pictures out.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

#[path = "support/horizon.rs"]
mod horizon;
mod support;

use serde_json::Value;
use std::path::Path;

fn demo(out: &Path, more: &[&str]) -> Value {
    let output = support::glasswing_command()
        .arg("demo")
        .arg("--out")
        .arg(out)
        .args(more)
        .output()
        .expect("starts");
    let complaint = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{}: {complaint}", output.status);
    let text = std::fs::read_to_string(out.join("summary.json")).expect("summary.json is there");
    serde_json::from_str(&text).expect("summary.json is JSON")
}

#[test]
fn the_demo_flies_and_says_how_it_went() {
    let out = support::scratch_dir("demo");
    let seconds = if support::is_emulated() { "60" } else { "8" };
    let summary = demo(&out, &["--seconds", seconds, "--size", "480x300"]);
    let source = &summary["sources"][0];
    assert!(
        source["good"].as_u64().expect("counted") > 400,
        "frames decoded: {summary}"
    );
    for none in ["bad", "dropped"] {
        assert_eq!(source[none], 0, "{none}: {summary}");
    }
    assert_eq!(summary["allocations_after_ready"], 0, "{summary}");
    assert_eq!(summary["display_list_overflows"], 0, "{summary}");
    assert!(
        summary["draw_calls_max"].as_u64().expect("counted") <= 32,
        "{summary}"
    );
    assert!(
        summary["triangles"]["max"].as_u64().expect("counted") > 1000,
        "terrain was drawn: {summary}"
    );
    for group in ["attitude", "airspeed_indicated", "position"] {
        assert!(
            summary["age_at_present_ms"][group]["p50"].is_number(),
            "{group} was shown: {summary}"
        );
    }
    assert!(out.join("contact-sheet.png").exists(), "contact sheet");
    let pictures = std::fs::read_dir(&out)
        .expect("is there")
        .filter(|e| {
            e.as_ref()
                .is_ok_and(|e| e.file_name().to_string_lossy().starts_with("frame-"))
        })
        .count();
    assert!(pictures >= 4, "{pictures} frames");
}

#[test]
fn a_still_is_the_same_picture_every_time() {
    let out = support::scratch_dir("demo-still");
    let still = |name: &str| {
        let folder = out.join(name);
        demo(&folder, &["--still", "12", "--size", "320x200"]);
        horizon::Picture::read(&folder.join("still.png"))
    };
    let (a, b) = (still("a"), still("b"));
    assert!(a.rgb == b.rgb, "two stills of the same moment differ");
    let sky = (0..a.width).filter(|x| a.is_sky(*x, 60)).count();
    assert!(
        sky > a.width / 8,
        "there is sky near the top: {sky} pixels of {}",
        a.width
    );
}
