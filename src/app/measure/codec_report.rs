//! What `measure codec` found, for people: a table, and plots of rate against error.

use super::Plot;
use super::plot::{Line, sheet};
use super::table::{number, rows, text};
use serde_json::Value;
use std::fmt::Write as _;

/// Figures of the survey of terrain codecs on S33W071, by largest error in metres: bits a sample.
const PUBLISHED: [(&str, &[(f64, f64)]); 5] = [
    (
        "JPEG-LS",
        &[(0.0, 5.61), (1.0, 4.0), (2.0, 3.3), (4.0, 2.6), (8.0, 1.9)],
    ),
    ("LERC", &[(0.5, 8.9), (1.0, 8.0), (2.0, 7.0)]),
    (
        "dyadic pyramid with zlib, all levels",
        &[
            (0.0, 5.75),
            (1.5, 4.25),
            (2.5, 3.51),
            (4.5, 2.69),
            (8.5, 1.92),
        ],
    ),
    ("JPEG 2000", &[(0.0, 5.56)]),
    ("JPEG XL", &[(0.0, 5.23)]),
];
/// The tile that they are of.
const PUBLISHED_OF: &str = "S33W071";

/// The figures as a table. Writing to a string cannot fail.
pub(super) fn table(value: &Value) -> String {
    let mut out = format!("{}\n", text(value, "how"));
    let _ = writeln!(
        out,
        "{:32} {:9} {:>7} {:>9} {:>10} {:>7} {:>7} {:>12} {:>12}",
        "input",
        "codec",
        "bound m",
        "bits",
        "all levels",
        "max m",
        "rms m",
        "encode M/s",
        "decode M/s"
    );
    for row in rows(value, "inputs") {
        let of = |key: &str| number(row, &[key]);
        let _ = writeln!(
            out,
            "{:32} {:9} {:7.2} {:9.3} {:10.3} {:7.2} {:7.3} {:12.1} {:12.1}",
            text(row, "input"),
            text(row, "codec"),
            of("bound_m"),
            of("bits_per_sample"),
            of("all_levels_bits"),
            of("max_error_m"),
            of("rms_error_m"),
            of("encode_msamples_per_s"),
            of("decode_msamples_per_s"),
        );
    }
    out
}

/// The pyramid's line of each input: bits a sample over the largest error.
fn lines(value: &Value, y: &str, wanted: impl Fn(&str) -> bool) -> Vec<Line> {
    let mut lines: Vec<Line> = Vec::new();
    let pyramid = rows(value, "inputs")
        .iter()
        .filter(|r| text(r, "codec") == "pyramid");
    for row in pyramid.filter(|r| wanted(text(r, "input"))) {
        let point = (number(row, &["max_error_m"]), number(row, &[y]));
        let name = text(row, "input").to_owned();
        match lines.iter_mut().find(|l| l.0 == name) {
            Some(line) => line.1.push(point),
            None => lines.push((name, vec![point])),
        }
    }
    lines
}

/// Rate against error: all inputs; and S33W071 beside what others published of it.
pub(super) fn plots(value: &Value) -> Vec<Plot> {
    let x = "largest error, m";
    let all = [
        (
            "pyramid, all levels, bits a sample",
            x,
            lines(value, "bits_per_sample", |_| true),
        ),
        ("RMS error, m", x, lines(value, "rms_error_m", |_| true)),
        (
            "decoded, M samples/s",
            x,
            lines(value, "decode_msamples_per_s", |_| true),
        ),
    ];
    let mut beside = lines(value, "bits_per_sample", |name| {
        name.starts_with(PUBLISHED_OF)
    });
    for line in &mut beside {
        line.0 = "this pyramid, all levels".to_owned();
    }
    let published = PUBLISHED
        .iter()
        .map(|(name, points)| ((*name).to_owned(), points.to_vec()));
    beside.extend(published);
    let title = "bits a sample on S33W071, with published figures";
    vec![
        ("codec.svg", sheet(&all)),
        ("codec-published.svg", sheet(&[(title, x, beside)])),
    ]
}
