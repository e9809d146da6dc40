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
