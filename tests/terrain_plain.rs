//! Plain grids on the command line of `terrain bake`: the text of the whole Earth, a height picture, and what is refused.

#![expect(
    clippy::expect_used,
    reason = "a test says what it needs and fails where that is not so"
)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use glasswing::terrain::archive;
use glasswing::terrain::pack::Pack;

mod support;
#[path = "terrain_bake_support/mod.rs"]
mod with;

use with::Posts;

fn bake(args: &[&str]) -> Output {
    let mut command = support::glasswing_command();
    command.args(["terrain", "bake"]).args(args);
    command.output().expect("the program starts")
}

fn text(path: &Path) -> &str {
    path.to_str().expect("scratch folders are UTF-8")
}

fn assert_refused(args: &[&str], code: i32, words: &[&str]) {
    let output = bake(args);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{args:?}: {said}");
    for word in words {
        assert!(said.contains(word), "`{word}` is not in: {said}");
    }
}

fn assert_baked(args: &[&str]) {
    let output = bake(args);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{args:?}: {said}");
}

fn data(name: &str) -> Option<PathBuf> {
    Some(support::data_dir()?.join("elev").join(name))
}

#[test]
fn a_text_of_the_whole_earth_lies_where_its_bounds_say() {
    let Some(file) = data("etopo20data.gz") else {
        return;
    };
    let out = support::scratch_dir("plain_etopo").join("alps.pack");
    assert_baked(&[
        text(&file),
        "--bounds=-89.833333333,20.166666667,89.833333333,380.166666667",
        "--bounds-at",
        "posts",
        "--first-row",
        "south",
        "--region",
        "45,6,47,8",
        "--out",
        text(&out),
    ]);
    let pack = Pack::open(&out).expect("baked");
    let bytes = archive::in_gzip(&fs::read(&file).expect("readable"), 1 << 25).expect("gzip");
    let heights: Vec<f64> = String::from_utf8_lossy(&bytes)
        .split_whitespace()
        .map(|n| n.parse().expect("a number"))
        .collect();
    let mut posts = Posts::of(&pack);
    assert_eq!(pack.info().grid.posts_per_degree, 120);
    // Every sample of 20' stands on a post of 30".
    let (mut count, mut different) = (0, 0.0_f64);
    for j in (45 * 120 + 20..47 * 120).step_by(40) {
        for i in (6 * 120 + 20..8 * 120).step_by(40) {
            let row = (j + 90 * 120 - 20) / 40;
            let column = (i + 360 * 120 - 20 * 120 - 20) / 40 % 1080;
            let at = usize::try_from(row * 1081 + column).expect("inside");
            let (height, _) = posts.at(0, i, j);
            different = different.max((height - heights[at]).abs());
            count += 1;
        }
    }
    assert_eq!(count, 36, "six by six samples of 20'");
    assert!(
        different < 0.126,
        "by {different} m: half of the unit that 15 km of range leave"
    );
}

#[test]
fn a_grey_picture_is_heights_in_its_unit() {
    let Some(file) = data("ps_height_1k.png") else {
        return;
    };
    let out = support::scratch_dir("plain_png").join("puget.pack");
    // It covers about 164 km; where it is laid does not matter here.
    let place = ["--bounds", "46.6,-122.9,48.1,-120.7", "--unit", "0.1"];
    let files = [text(&file), "--out", text(&out)];
    assert_baked(&[&files[..], &place[..]].concat());
    let pack = Pack::open(&out).expect("baked");
    let (low, high) = pack
        .keys()
        .filter(|k| k.level == 0)
        .filter_map(|k| pack.tile_header(k))
        .fold((f64::MAX, f64::MIN), |(low, high), h| {
            (low.min(h.min_m), high.max(h.max_m))
        });
    // The manifest: 0 to 4379.8 m. A post between four samples is no higher than they are.
    assert!(
        low.abs() < 0.1 && (4350.0..4380.0).contains(&high),
        "{low} to {high}"
    );
}

#[test]
fn grids_that_cannot_be_placed_are_refused() {
    let folder = support::scratch_dir("plain_refused");
    let out = folder.join("out.pack");
    let file = |name: &str, content: &str| {
        let path = folder.join(name);
        fs::write(&path, content).expect("written");
        path
    };
    let grid = file("grid.txt", "1 2 3\n4 5 6\n");
    let place = "--bounds=46,7,47,8";
    let to = ["--out", text(&out)];
    let refused = |args: &[&str], path: &Path, code, words: &[&str]| {
        let mut all = vec![text(path)];
        all.extend(args.iter().copied().chain(to));
        assert_refused(&all, code, words);
    };
    refused(&[], &grid, 3, &[text(&grid), "--bounds"]);
    refused(
        &[place, place],
        &grid,
        2,
        &["--bounds", "2 times", "1 of the files"],
    );
    refused(&["--bounds=47,7,46,8"], &grid, 2, &["--bounds"]);
    refused(&[place, "--unit", "0"], &grid, 2, &["--unit"]);
    let ragged = file("ragged.csv", "1,2,3\n4,5\n");
    refused(
        &[place],
        &ragged,
        3,
        &[text(&ragged), "line 2 has 2 numbers"],
    );
    let word = file("word.txt", "1 2 3\n4 sea 6\n");
    refused(&[place], &word, 3, &["line 2", "`sea`"]);
    let raw = file("a.raw", "12345678");
    refused(&[place], &raw, 3, &["--raw"]);
    refused(
        &[place, "--raw", "3x3,i16le"],
        &raw,
        3,
        &["8 bytes", "3 x 3"],
    );
    refused(&[place, "--raw", "3x3,i17"], &raw, 2, &["--raw"]);
    let picture = file("a.png", "no picture");
    refused(&[place], &picture, 3, &["PNG"]);
    assert!(!out.exists(), "nothing was written");
    // NaN is a void, and the rest is baked.
    let holes = file("holes.txt", "1 2 3\n4 nan 6\n7 8 9\n");
    assert_baked(&[
        text(&holes),
        "--bounds=46,7,46.02,7.02",
        "--bounds-at",
        "posts",
        "--out",
        text(&out),
    ]);
}
