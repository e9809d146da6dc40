//! Plots of figures, as SVG.

use crate::app::measure::Plot;
use crate::app::measure::table::number;
use serde_json::Value;
use std::fmt::Write as _;

/// A line of a plot: its name and its points.
pub(super) type Line = (String, Vec<(f64, f64)>);

/// Colours of lines, told apart in print too by their dashes.
const COLOURS: [&str; 6] = [
    "#1b6ca8", "#c8553d", "#3a7d44", "#7d4fa0", "#b8860b", "#444444",
];
const DASHES: [&str; 6] = ["", "6 3", "2 3", "8 3 2 3", "1 4", "12 4"];
/// Size of a panel with its margins, pixels.
const PANEL: (f64, f64) = (420.0, 300.0);
/// Left, top, right and lower margin of a panel.
const MARGIN: (f64, f64, f64, f64) = (58.0, 30.0, 14.0, 40.0);

/// A round number not less than `v`: 1, 2 or 5 times a power of ten.
fn round_up(v: f64) -> f64 {
    let power = 10_f64.powf(v.max(1e-12).log10().floor());
    [1.0, 2.0, 5.0, 10.0]
        .map(|k| k * power)
        .into_iter()
        .find(|&r| r >= v)
        .unwrap_or(v)
}

/// One panel: a title, the lines, and where it stands.
fn panel(out: &mut String, title: &str, x_name: &str, lines: &[Line], at: f64) {
    let points = || lines.iter().flat_map(|l| &l.1).filter(|p| p.1.is_finite());
    let x_max = points().map(|p| p.0).fold(1e-9, f64::max) * 1.04;
    let top = round_up(points().map(|p| p.1).fold(1e-9, f64::max));
    let (left, upper, right, lower) = MARGIN;
    let (width, height) = (PANEL.0 - left - right, PANEL.1 - upper - lower);
    let x = |v: f64| at + left + v / x_max * width;
    let y = |v: f64| upper + height - v / top * height;
    let _ = writeln!(
        out,
        "<text x='{}' y='18' class='title'>{title}</text>",
        at + left
    );
    for k in 0..=4 {
        let v = top * f64::from(k) / 4.0;
        let _ = writeln!(
            out,
            "<path d='M{:.1} {:.1}H{:.1}' class='grid'/><text x='{:.1}' y='{:.1}' text-anchor='end'>{}</text>",
            x(0.0),
            y(v),
            x(x_max),
            x(0.0) - 5.0,
            y(v) + 4.0,
            short(v)
        );
    }
    let mut ticks: Vec<f64> = points().map(|p| p.0).collect();
    ticks.sort_by(f64::total_cmp);
    ticks.dedup();
    let apart = (ticks.len() / 8).max(1);
    for v in ticks.iter().step_by(apart) {
        let _ = writeln!(
            out,
            "<text x='{:.1}' y='{:.1}' text-anchor='middle'>{}</text>",
            x(*v),
            upper + height + 15.0,
            short(*v)
        );
    }
    let _ = writeln!(
        out,
        "<text x='{:.1}' y='{:.1}' text-anchor='end'>{x_name}</text>",
        x(x_max),
        upper + height + 30.0
    );
    for (k, (_, points)) in lines.iter().enumerate() {
        let (colour, dash) = (COLOURS[k % COLOURS.len()], DASHES[k % DASHES.len()]);
        let shown: Vec<String> = points
            .iter()
            .filter(|p| p.1.is_finite())
            .map(|p| format!("{:.1},{:.1}", x(p.0), y(p.1)))
            .collect();
        let _ = writeln!(
            out,
            "<polyline points='{}' fill='none' stroke='{colour}' stroke-width='1.8' stroke-dasharray='{dash}'/>",
            shown.join(" ")
        );
        for p in &shown {
            let (cx, cy) = p.split_once(',').unwrap_or(("0", "0"));
            let _ = writeln!(out, "<circle cx='{cx}' cy='{cy}' r='2.6' fill='{colour}'/>");
        }
    }
}

/// A number with no more digits than it needs.
fn short(v: f64) -> String {
    match v.abs() {
        a if a >= 10_000.0 => format!("{:.0}k", v / 1000.0),
        a if a >= 10.0 => format!("{v:.0}"),
        a if a >= 1.0 || a == 0.0 => format!("{v:.1}"),
        a if a >= 0.01 => format!("{v:.2}"),
        _ => format!("{v:.5}"),
    }
}

/// Panels beside each other with one legend below.
pub(super) fn sheet(panels: &[(&str, &str, Vec<Line>)]) -> String {
    let names: Vec<&String> = panels
        .first()
        .map_or(Vec::new(), |p| p.2.iter().map(|l| &l.0).collect());
    let count = u32::try_from(panels.len()).unwrap_or(1);
    let (width, legend) = (
        PANEL.0 * f64::from(count),
        18.0 * f64::from(u32::try_from(names.len()).unwrap_or(0)) + 12.0,
    );
    let mut out = format!(
        "<svg xmlns='http://www.w3.org/2000/svg' width='{width}' height='{}' font-family='sans-serif' font-size='11'>\n\
         <style>.grid{{stroke:#ddd;fill:none}}.title{{font-size:13px;font-weight:bold}}</style>\n\
         <rect width='100%' height='100%' fill='white'/>\n",
        PANEL.1 + legend
    );
    let mut at = 0.0;
    for (title, x_name, lines) in panels {
        panel(&mut out, title, x_name, lines, at);
        at += PANEL.0;
    }
    let mut y = PANEL.1 + 8.0;
    for (k, name) in names.iter().enumerate() {
        let (colour, dash) = (COLOURS[k % COLOURS.len()], DASHES[k % DASHES.len()]);
        let name = name.replace('&', "&amp;").replace('<', "&lt;");
        let _ = writeln!(
            out,
            "<path d='M{} {y}h34' stroke='{colour}' stroke-width='1.8' stroke-dasharray='{dash}'/><text x='{}' y='{}'>{name}</text>",
            MARGIN.0,
            MARGIN.0 + 42.0,
            y + 4.0
        );
        y += 18.0;
    }
    out.push_str("</svg>\n");
    out
}

/// Lines over the number of vertices, one for each scene.
fn over_vertices(value: &Value, keys: &[&str]) -> Vec<Line> {
    let mut lines: Vec<Line> = Vec::new();
    for row in value["scenes"].as_array().into_iter().flatten() {
        let name = row["name"].as_str().unwrap_or("").to_owned();
        let point = (number(row, &["vertices"]), number(row, keys));
        match lines.iter_mut().find(|l| l.0 == name) {
            Some(line) => line.1.push(point),
            None => lines.push((name, vec![point])),
        }
    }
    lines
}

/// Frame time, triangles and surface error over the number of vertices.
#[must_use]
pub fn speed(value: &Value) -> Vec<Plot> {
    let n = "vertices along a side of a level";
    let panels = [
        (
            "CPU time a frame, still, ms",
            n,
            over_vertices(value, &["still", "process_ms"]),
        ),
        (
            "CPU time a frame, moving, ms",
            n,
            over_vertices(value, &["moving", "process_ms"]),
        ),
        ("triangles", n, over_vertices(value, &["triangles"])),
        (
            "surface error, px RMS",
            n,
            over_vertices(value, &["surf_px", "rms"]),
        ),
    ];
    vec![("speed.svg", sheet(&panels))]
}

/// Error of positions, case by case and level by level.
#[must_use]
pub fn accuracy(value: &Value) -> Vec<Plot> {
    let row = |rows: &Value| {
        let rows = rows.as_array().into_iter().flatten();
        let points = (0_u32..)
            .zip(rows)
            .map(|(k, r)| (f64::from(k), number(r, &["px_max"])));
        vec![(
            "largest error of a position; the goal is 0.001 px".to_owned(),
            points.collect(),
        )]
    };
    let panels = [
        (
            "position, px at most",
            "hard case, as listed",
            row(&value["cases"]),
        ),
        (
            "position, px at most",
            "level",
            row(&value["position"]["levels"]),
        ),
    ];
    vec![("accuracy.svg", sheet(&panels))]
}

/// Frame times of the flights of `measure streaming`, by reader.
#[must_use]
pub fn streaming(value: &Value) -> Vec<Plot> {
    let over = |keys: &[&str]| {
        let mut lines: Vec<Line> = Vec::new();
        for row in value["flights"].as_array().into_iter().flatten() {
            let name = row["flight"].as_str().unwrap_or("").to_owned();
            let y = number(row, keys);
            match lines.iter_mut().find(|line| line.0 == name) {
                Some(line) => {
                    let x = line.1.last().map_or(1.0, |last| last.0 + 1.0);
                    line.1.push((x, y));
                }
                None => lines.push((name, vec![(1.0, y)])),
            }
        }
        lines
    };
    let x = "reader: 1 free, 2 10 MB/s, 3 1 MB/s, 4 stalls";
    let panels = [
        ("median frame, ms", x, over(&["frame_ms", "moving", "p50"])),
        ("worst frame, ms", x, over(&["frame_ms", "moving", "max"])),
        ("late frames", x, over(&["late_frames"])),
        ("frames to refill", x, over(&["teleport_frames"])),
    ];
    vec![("streaming.svg", sheet(&panels))]
}
