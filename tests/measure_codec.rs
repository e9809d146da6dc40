//! `measure codec`: its keys, its bounds, and the rates that the project has set itself, on real terrain.

#![expect(
    clippy::expect_used,
    reason = "a test says what it needs and fails where that is not so"
)]

use serde_json::Value;
use std::fs;
use std::path::Path;

mod support;

/// The document of a run on inputs of the data folder; `None` where it is absent.
fn measured(test: &str, inputs: &[&str], more: &[&str]) -> Option<Value> {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/elev");
    if !data.is_dir() {
        support::skip("no elevation data in ../shared/data");
        return None;
    }
    let folder = support::scratch_dir(&format!("measure_codec_{test}"));
    let json = folder.join("codec.json");
    let run = support::glasswing_command()
        .args(["measure", "codec", "--seconds", "0.001"])
        .args(inputs.iter().map(|i| data.join(i)))
        .args(more)
        .args([Path::new("--json"), &json, Path::new("--plot"), &folder])
        .output()
        .expect("the program runs");
    assert!(
        run.status.success(),
        "{}",
        String::from_utf8_lossy(&run.stderr)
    );
    for plot in ["codec.svg", "codec-published.svg"] {
        let svg = fs::read_to_string(folder.join(plot)).expect("a plot is written");
        assert!(
            svg.starts_with("<svg") && svg.contains("polyline"),
            "{plot}"
        );
    }
    let text = fs::read_to_string(json).expect("the document is written");
    Some(serde_json::from_str(&text).expect("it is JSON"))
}

fn number(row: &Value, key: &str) -> f64 {
    row[key].as_f64().expect(key)
}

/// The row of an input by codec and bound.
fn row<'a>(value: &'a Value, input: &str, codec: &str, bound_m: f64) -> &'a Value {
    let rows = value["inputs"].as_array().expect("rows");
    rows.iter()
        .find(|r| {
            r["input"] == input
                && r["codec"] == codec
                && (number(r, "bound_m") - bound_m).abs() < 1e-9
        })
        .expect("the row is there")
}

#[test]
fn rates_and_bounds_hold_on_mountains() {
    let inputs = ["S33W071.tif", "N50E014.hgt"];
    let more = ["--bound", "0", "--bound", "2.5"];
    let Some(value) = measured("mountains", &inputs, &more) else {
        return;
    };
    for (input, codec, bound_m, bits) in [
        ("S33W071.tif", "lossless", 0.0, 6.2),
        ("S33W071.tif", "pyramid", 0.0, 6.2),
        ("S33W071.tif", "pyramid", 2.5, 3.6),
        ("N50E014.hgt", "lossless", 0.0, 5.2),
        ("N50E014.hgt", "pyramid", 0.0, 5.2),
        ("N50E014.hgt", "pyramid", 2.5, 3.6),
    ] {
        let row = row(&value, input, codec, bound_m);
        let found = number(row, "bits_per_sample");
        assert!(
            found > 0.5 && found <= bits,
            "{input} {codec} {bound_m}: {found} of {bits}"
        );
        assert!(number(row, "max_error_m") <= bound_m, "{row}");
        assert!(number(row, "rms_error_m") <= bound_m, "{row}");
        for level in row["level_max_error_m"].as_array().expect("levels") {
            assert!(level.as_f64().expect("metres") <= bound_m, "{row}");
        }
        for speed in ["encode_msamples_per_s", "decode_msamples_per_s"] {
            assert!(number(row, speed) > 0.0, "{row}");
        }
    }
}

#[test]
fn a_picture_with_a_unit_keeps_its_bound_in_metres() {
    let more = ["--png-unit", "0.1", "--bound", "2.5"];
    let Some(value) = measured("picture", &["ps_height_1k.png"], &more) else {
        return;
    };
    let row = row(&value, "ps_height_1k.png", "pyramid", 2.5);
    let error = number(row, "max_error_m");
    assert!(
        error > 2.4 && error <= 2.5 + 1e-9,
        "25 tenths of a metre: {error}"
    );
}

#[test]
fn what_cannot_be_measured_is_refused() {
    let folder = support::scratch_dir("measure_codec_refused");
    let none = folder.join("none.hgt");
    let picture = folder.join("none.png");
    fs::write(&picture, b"no picture").expect("written");
    for (path, why) in [(&none, "does not exist"), (&picture, "is no PNG")] {
        let run = support::glasswing_command()
            .args(["measure", "codec"])
            .arg(path)
            .output()
            .expect("the program runs");
        let text = String::from_utf8_lossy(&run.stderr);
        assert_eq!(run.status.code(), Some(3), "{text}");
        let name = path.to_string_lossy();
        assert!(text.contains(why) && text.contains(&*name), "{text}");
    }
}
