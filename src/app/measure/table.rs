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

fn text<'a>(value: &'a Value, key: &str) -> &'a str {
    value[key].as_str().unwrap_or("")
}

fn rows<'a>(value: &'a Value, key: &str) -> &'a [Value] {
    value[key].as_array().map_or(&[], Vec::as_slice)
}

/// The document of `measure accuracy` as a table. Writing to a string cannot fail.
#[must_use]
pub fn accuracy(value: &Value) -> String {
    let mut out = String::new();
    let position = &value["position"];
    let _ = writeln!(
        out,
        "position       {:.6} px at most, {:.4} m ({} vertices)\n               {}",
        number(position, &["px_max"]),
        number(position, &["m_max"]),
        number(position, &["vertices"]),
        text(position, "how")
    );
    for case in rows(value, "cases") {
        let (px, m) = (number(case, &["px_max"]), number(case, &["m_max"]));
        let _ = writeln!(out, "  {:38} {px:.6} px {m:9.6} m", text(case, "name"));
    }
    let water = &value["watertight"];
    let _ = writeln!(
        out,
        "watertight     {} of {} views with a hole, {} without terrain yet\n               {}",
        number(water, &["holes"]),
        number(water, &["poses"]),
        number(water, &["without_terrain"]),
        text(water, "how")
    );
    let _ = writeln!(
        out,
        "pop            {:.3} px a frame at most\n               {}",
        number(value, &["pop_px_max"]),
        text(&value["pop"], "how")
    );
    for path in rows(&value["pop"], "paths") {
        let (px, p999) = (number(path, &["px_max"]), number(path, &["px_p999"]));
        let _ = writeln!(
            out,
            "  {:38} {px:.3} px at most, p99.9 {p999:.3}, {} frames",
            text(path, "path"),
            number(path, &["frames"])
        );
    }
    let _ = writeln!(
        out,
        "normal         {:.3} deg rms, {:.3} deg at most\n               {}",
        number(value, &["normal_deg", "rms"]),
        number(value, &["normal_deg", "max"]),
        text(&value["normal_deg"], "how")
    );
    let _ = writeln!(out, "scenes         {}", text(value, "scenes_how"));
    surfaces(&mut out, rows(value, "scenes"));
    out
}

fn surfaces(out: &mut String, scenes: &[Value]) {
    let _ = writeln!(
        out,
        "  {:38} triangles surf px rms    p99    max  skyline mean    max  mismatch  summit low m     px",
        ""
    );
    for s in scenes {
        let _ = writeln!(
            out,
            "  {:38} {:9} {:11.3} {:6.2} {:6.2} {:13.3} {:6.1} {:9} {:13.1} {:6.2}",
            text(s, "name"),
            number(s, &["triangles"]),
            number(s, &["surf_px", "rms"]),
            number(s, &["surf_px", "p99"]),
            number(s, &["surf_px", "max"]),
            number(s, &["skyline_px", "mean"]),
            number(s, &["skyline_px", "max"]),
            number(s, &["mismatch_pixels"]),
            number(s, &["summits", "low_m_max"]),
            number(s, &["summits", "low_px_max"]),
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
