//! Figures as text for people.

use serde_json::Value;
use std::fmt::Write as _;

/// A number of a document, where there is one.
#[must_use]
pub fn number(value: &Value, path: &[&str]) -> f64 {
    path.iter()
        .fold(value, |v, key| &v[*key])
        .as_f64()
        .unwrap_or(f64::NAN)
}

pub(super) fn text<'a>(value: &'a Value, key: &str) -> &'a str {
    value[key].as_str().unwrap_or("")
}

pub(super) fn rows<'a>(value: &'a Value, key: &str) -> &'a [Value] {
    value[key].as_array().map_or(&[], Vec::as_slice)
}

/// The document of `measure accuracy` as a table. Writing to a string cannot fail.
#[must_use]
pub fn accuracy(value: &Value) -> String {
    let mut out = String::new();
    let how = |out: &mut String, value: &Value| {
        let _ = writeln!(out, "               {}", text(value, "how"));
    };
    let position = &value["position"];
    if position.is_object() {
        let _ = writeln!(
            out,
            "position       {:.6} px at most, {:.4} m ({} vertices)",
            number(position, &["px_max"]),
            number(position, &["m_max"]),
            number(position, &["vertices"]),
        );
        how(&mut out, position);
    }
    for case in rows(value, "cases") {
        let (px, m) = (number(case, &["px_max"]), number(case, &["m_max"]));
        let _ = writeln!(out, "  {:38} {px:.6} px {m:9.6} m", text(case, "name"));
    }
    let water = &value["watertight"];
    if water.is_object() {
        let count = |key: &str| number(water, &[key]);
        let _ = writeln!(
            out,
            "watertight     {} views with a hole: {} poses, {} hard cases, {} hungry frames ({} of them without terrain yet)",
            count("holes"),
            count("poses"),
            count("hard_cases"),
            count("hungry_frames"),
            count("without_terrain"),
        );
        how(&mut out, water);
    }
    flights(&mut out, value);
    let normal = &value["normal_deg"];
    if normal.is_object() {
        let _ = writeln!(
            out,
            "normal         {:.3} deg rms, {:.3} deg at most",
            number(normal, &["rms"]),
            number(normal, &["max"]),
        );
        how(&mut out, normal);
        let _ = writeln!(out, "scenes         {}", text(value, "scenes_how"));
        surfaces(&mut out, rows(value, "scenes"));
    }
    out
}

fn flights(out: &mut String, value: &Value) {
    if !value["pop"].is_object() {
        return;
    }
    let _ = writeln!(
        out,
        "flights        {:.3} px a frame of pop at most, {:.4} px of swim\n               {}",
        number(value, &["pop_px_max"]),
        number(value, &["swim_px_max"]),
        text(&value["pop"], "how")
    );
    let _ = writeln!(
        out,
        "  {:38} pop px max  p99.9  swim px  frames  holes  late  seams",
        ""
    );
    for path in rows(&value["pop"], "paths") {
        let of = |key: &str| number(path, &[key]);
        let _ = writeln!(
            out,
            "  {:38} {:10.3} {:6.3} {:8.4} {:7} {:6} {:5} {:6}",
            text(path, "path"),
            of("px_max"),
            of("px_p999"),
            of("swim_px_max"),
            of("frames"),
            of("holes"),
            of("late_frames"),
            of("seams"),
        );
    }
}

fn surfaces(out: &mut String, scenes: &[Value]) {
    let _ = writeln!(
        out,
        "  {:46} triangles surf px rms    p99    max  near max  ag. triangles  skyline mean    max  mismatch  summits  low m     px  beyond stated",
        ""
    );
    for s in scenes {
        let _ = writeln!(
            out,
            "  {:46} {:9} {:11.3} {:6.2} {:6.2} {:9.2} {:14.2} {:13.3} {:6.1} {:9} {:8} {:6.1} {:6.2} {:14}",
            text(s, "name"),
            number(s, &["triangles"]),
            number(s, &["surf_px", "rms"]),
            number(s, &["surf_px", "p99"]),
            number(s, &["surf_px", "max"]),
            number(s, &["near_px", "max"]),
            number(s, &["near_finest_px", "max"]),
            number(s, &["skyline_px", "mean"]),
            number(s, &["skyline_px", "max"]),
            number(s, &["mismatch_pixels"]),
            number(s, &["summits", "count"]),
            number(s, &["summits", "low_m_max"]),
            number(s, &["summits", "low_px_max"]),
            number(s, &["summits", "beyond_stated"]),
        );
    }
}

/// The document of `measure speed` as a table.
#[must_use]
pub fn speed(value: &Value) -> String {
    let mut out = String::new();
    let _ = writeln!(
        out,
        "{}\n{}, {} threads",
        text(value, "how"),
        text(value, "gpu"),
        number(value, &["threads"])
    );
    let _ = writeln!(
        out,
        "{:36} n    {:>6} {:>6} {:>6} {:>6} {:>7} {:>8} {:>9} {:>5} {:>5}  {:>6} {:>6} {:>6}",
        "",
        "p50 ms",
        "p95",
        "p99",
        "max",
        "own ms",
        "process",
        "triangles",
        "calls",
        "alloc",
        "px rms",
        "p99",
        "max"
    );
    for row in rows(value, "scenes") {
        for key in ["still", "moving"] {
            let part = &row[key];
            let ms = |p: &str| number(part, &["frame_ms", p]);
            let _ = writeln!(
                out,
                "{:36} {:4} {:6.1} {:6.1} {:6.1} {:6.1} {:7.3} {:8.1} {:9} {:5} {:5}  {:6.3} {:6.2} {:6.2}",
                format!("{}, {key}", text(row, "name")),
                number(row, &["vertices"]),
                ms("p50"),
                ms("p95"),
                ms("p99"),
                ms("max"),
                number(part, &["cpu_ms", "p50"]),
                number(part, &["process_ms"]),
                number(part, &["triangles"]),
                number(part, &["draw_calls"]),
                number(part, &["allocations_per_frame"]),
                number(row, &["surf_px", "rms"]),
                number(row, &["surf_px", "p99"]),
                number(row, &["surf_px", "max"]),
            );
        }
    }
    out
}

/// The document of `measure streaming` as a table.
#[must_use]
pub fn streaming(value: &Value) -> String {
    let of = |key: &str| number(value, &[key]);
    let mut out = String::new();
    let _ = writeln!(
        out,
        "{}\n{}, {} threads, {} vertices\n\n\
         quota          {} bytes a frame, {} at most uploaded, {} frames over it\n\
         teleport       {} frames to refill everything\n\
         late           {} frames without the finest wanted level\n\
         resident       {:.1} MiB at most",
        text(value, "how"),
        text(value, "gpu"),
        of("threads"),
        of("vertices"),
        of("quota_bytes"),
        of("upload_bytes_max"),
        of("over_quota_frames"),
        of("teleport_frames"),
        of("late_frames"),
        of("resident_bytes_max") / f64::from(1 << 20),
    );
    let long = &value["long_flight"];
    if long.is_object() {
        let _ = writeln!(
            out,
            "long flight    {} h, {} frames: {:.1} MiB of the process, {:+.2} MiB since its first five minutes",
            number(long, &["hours"]),
            number(long, &["frames"]),
            rows(long, "process_bytes")
                .last()
                .and_then(Value::as_f64)
                .unwrap_or(f64::NAN)
                / f64::from(1 << 20),
            number(long, &["process_bytes_grown"]) / f64::from(1 << 20),
        );
    }
    let _ = writeln!(
        out,
        "\n{:45} frames  late refill  over  KiB/frame  still p50    max  moving p50    max  worst/p50  CPU p50    max  alloc  tiles",
        ""
    );
    for row in rows(value, "flights") {
        let n = |path: &[&str]| number(row, path);
        let (p50, max) = (
            n(&["frame_ms", "moving", "p50"]),
            n(&["frame_ms", "moving", "max"]),
        );
        let _ = writeln!(
            out,
            "{:45} {:6} {:5} {:>6} {:5} {:10.0} {:10.1} {:6.1} {p50:11.1} {max:6.1} {:10.2} {:8.1} {:6.1} {:6} {:6}",
            format!("{}, {}", text(row, "flight"), text(row, "reader")),
            n(&["frames"]),
            n(&["late_frames"]),
            row["teleport_frames"]
                .as_u64()
                .map_or("-".to_owned(), |f| f.to_string()),
            n(&["over_quota_frames"]),
            n(&["upload_bytes_max"]) / 1024.0,
            n(&["frame_ms", "still", "p50"]),
            n(&["frame_ms", "still", "max"]),
            max / p50,
            n(&["process_ms", "moving", "p50"]),
            n(&["process_ms", "moving", "max"]),
            n(&["allocations"]),
            n(&["tiles_read"]),
        );
    }
    out
}
