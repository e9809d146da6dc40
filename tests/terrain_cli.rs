//! `glasswing terrain` as a user runs it: exit codes, and one clear line for everything that can be wrong.

#![expect(
    clippy::expect_used,
    reason = "a test says what it needs and fails where that is not so"
)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};
use std::time::Duration;

mod support;
#[path = "terrain_bake_support/mod.rs"]
mod with;

use with::{Field, tiff, write_hgt};

fn terrain(args: &[&str]) -> Output {
    support::glasswing_command()
        .arg("terrain")
        .args(args)
        .output()
        .expect("the program starts")
}

/// Runs a command that must fail with the exit code and with a first line that holds all the words.
fn assert_fails(args: &[&str], code: i32, words: &[&str]) {
    let output = terrain(args);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{args:?}: {stderr}");
    let line = stderr.lines().next().unwrap_or("");
    assert!(
        line.starts_with("glasswing: ") || code == 2,
        "{args:?}: {stderr}"
    );
    for word in words {
        assert!(stderr.contains(word), "`{word}` is not in: {stderr}");
    }
    assert!(!stderr.contains("panicked"), "{stderr}");
}

fn text(path: &Path) -> &str {
    path.to_str().expect("scratch folders are UTF-8")
}

/// No file in the folder but those named: no pack, no temporary file.
fn assert_only(folder: &Path, names: &[&str]) {
    for entry in fs::read_dir(folder).expect("lists") {
        let name = entry.expect("an entry").file_name();
        assert!(
            names.contains(&name.to_string_lossy().as_ref()),
            "{name:?} is left over"
        );
    }
}

/// Bakes bytes under a name; it must fail with exit code 3, name the file, and leave nothing.
fn assert_refused(test: &str, name: &str, bytes: &[u8], words: &[&str]) {
    let folder = support::scratch_dir(&format!("cli_{test}"));
    let file = folder.join(name);
    fs::write(&file, bytes).expect("written");
    let out = folder.join("out.pack");
    let mut all = vec![text(&file)];
    all.extend(words);
    assert_fails(&["bake", text(&file), "--out", text(&out)], 3, &all);
    assert_only(&folder, &[name]);
}

#[test]
fn hgt_files_that_are_none_are_refused() {
    let whole = vec![0; 2 * 1201 * 1201];
    assert_refused(
        "short",
        "N50E014.hgt",
        &whole[2..],
        &["2884800 bytes", "2884802", "25934402"],
    );
    assert_refused("empty", "N50E014.hgt", &[], &["0 bytes"]);
    assert_refused("name", "bohemia.hgt", &whole, &["corner", "N50E014.hgt"]);
    assert_refused("latitude", "N99E014.hgt", &whole, &["corner"]);
    assert_refused("kind", "N50E014.dem", &whole, &[".hgt", ".tif"]);
    assert_refused("gzip", "N50E014.hgt.gz", b"no gzip", &["gzip"]);
}

#[test]
fn missing_and_unreadable_files_are_refused() {
    let folder = support::scratch_dir("cli_missing");
    let out = folder.join("out.pack");
    for name in ["N50E014.hgt", "a.tif", "b.zip", "c.dem"] {
        let file = folder.join(name);
        let words = [text(&file), "does not exist"];
        assert_fails(&["bake", text(&file), "--out", text(&out)], 3, &words);
    }
    let directory = folder.join("N51E014.hgt");
    fs::create_dir(&directory).expect("made");
    assert_fails(
        &["bake", text(&directory), "--out", text(&out)],
        3,
        &["is a folder"],
    );
}

/// A zip archive of stored files, by the letter of APPNOTE 6.3.9: local headers, central directory, end record.
fn zip(files: &[(&str, &[u8])]) -> Vec<u8> {
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
    let mut archive = Vec::new();
    let mut central = Vec::new();
    for (name, bytes) in files {
        let offset = u32::try_from(archive.len()).expect("small");
        let size = u32::try_from(bytes.len()).expect("small").to_le_bytes();
        // Version 1.0, no flags, stored, a time and a date.
        let mut common = vec![10, 0, 0, 0, 0, 0, 0, 0, 0x21, 0];
        common.extend(crc.checksum(bytes).to_le_bytes());
        common.extend(size);
        common.extend(size);
        common.extend(u16::try_from(name.len()).expect("short").to_le_bytes());
        common.extend([0, 0]);
        archive.extend(b"PK\x03\x04");
        archive.extend(&common);
        archive.extend(name.as_bytes());
        archive.extend(*bytes);
        central.extend(b"PK\x01\x02\x0a\0");
        central.extend(&common);
        central.extend([0; 10]);
        central.extend(offset.to_le_bytes());
        central.extend(name.as_bytes());
    }
    let count = u16::try_from(files.len()).expect("few").to_le_bytes();
    let (size, offset) = (central.len(), archive.len());
    archive.extend(central);
    archive.extend(b"PK\x05\x06\0\0\0\0");
    archive.extend(count);
    archive.extend(count);
    archive.extend(u32::try_from(size).expect("small").to_le_bytes());
    archive.extend(u32::try_from(offset).expect("small").to_le_bytes());
    archive.extend([0, 0]);
    archive
}

#[test]
fn zip_archives_without_exactly_one_tile_are_refused() {
    let tile = vec![0; 2 * 1201 * 1201];
    assert_refused("zip_damaged", "a.zip", b"PK\x03\x04 cut", &["damaged zip"]);
    assert_refused("zip_empty", "a.zip", &zip(&[]), &["holds no .hgt"]);
    assert_refused(
        "zip_none",
        "a.zip",
        &zip(&[("readme.txt", b"hello")]),
        &["holds no .hgt"],
    );
    let two = zip(&[("N50E014.hgt", &tile), ("N50E015.hgt", &tile)]);
    assert_refused("zip_two", "a.zip", &two, &["holds 2 .hgt files"]);
    let short = zip(&[("folder/N50E014.hgt", b"short")]);
    assert_refused("zip_short", "a.zip", &short, &["has 5 bytes"]);
    let mut wrong = zip(&[("N50E014.hgt", &tile)]);
    wrong[1000] ^= 1;
    assert_refused("zip_crc", "a.zip", &wrong, &["damaged zip"]);
    let folder = support::scratch_dir("cli_zip_sound");
    let (file, out) = (folder.join("a.zip"), folder.join("out.pack"));
    fs::write(
        &file,
        zip(&[("folder/N50E014.hgt", &tile), ("readme.txt", b"hi")]),
    )
    .expect("written");
    let output = terrain(&["bake", text(&file), "--out", text(&out)]);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
}

/// An 8 x 8 GeoTIFF of 1" with given geokeys and sample format.
fn geotiff(keys: &[u16], bits: u16, extra: Vec<Field>) -> Vec<u8> {
    let strip = vec![0; 64 * usize::from(bits) / 8];
    let step = 1.0 / 3600.0;
    let mut fields = vec![
        Field::longs(256, &[8]),
        Field::longs(257, &[8]),
        Field::shorts(258, &[bits]),
        Field::shorts(259, &[1]),
        Field::shorts(262, &[1]),
        Field::shorts(277, &[1]),
        Field::longs(278, &[8]),
        Field::shorts(339, &[2]),
        Field::doubles(33_550, &[step, step, 0.0]),
        Field::doubles(33_922, &[0.0, 0.0, 0.0, 10.0, 47.0, 0.0]),
    ];
    if !keys.is_empty() {
        fields.push(Field::shorts(34_735, keys));
    }
    fields.retain(|f| extra.iter().all(|e| e.0 != f.0));
    fields.extend(extra);
    tiff(&[strip], 273, 279, fields)
}

const WGS84: [u16; 12] = [1, 1, 0, 2, 1024, 0, 1, 2, 2048, 0, 1, 4326];

#[test]
fn geotiffs_that_cannot_be_read_are_refused() {
    let sound = geotiff(&WGS84, 16, Vec::new());
    assert_refused("tif_text", "a.tif", b"no tiff at all", &["TIFF"]);
    assert_refused("tif_cut_8", "a.tif", &sound[..8], &["truncated TIFF"]);
    // The directory stands behind the samples; cut within the samples, and within the directory.
    assert_refused("tif_cut_half", "a.tif", &sound[..100], &["truncated TIFF"]);
    assert_refused(
        "tif_cut_end",
        "a.tif",
        &sound[..sound.len() - 30],
        &["TIFF"],
    );
    let bytes = geotiff(&WGS84, 8, Vec::new());
    assert_refused("tif_8", "a.tif", &bytes, &["8-bit samples", "Int16"]);
    let etrs = [1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 25_833];
    let bytes = geotiff(&etrs, 16, Vec::new());
    assert_refused(
        "tif_etrs",
        "a.tif",
        &bytes,
        &["EPSG:25833", "EPSG:4326", "UTM", "gdalwarp"],
    );
    let utm = [1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 32_633];
    let bytes = geotiff(&utm, 16, Vec::new());
    assert_refused("tif_utm", "a.tif", &bytes, &["are these degrees?"]);
    let nad27 = [1, 1, 0, 2, 1024, 0, 1, 2, 2048, 0, 1, 4267];
    let bytes = geotiff(&nad27, 16, Vec::new());
    assert_refused("tif_nad27", "a.tif", &bytes, &["EPSG:4267"]);
    let bytes = geotiff(&[], 16, Vec::new());
    assert_refused("tif_plain", "a.tif", &bytes, &["georeference"]);
    let far = Field::doubles(33_922, &[0.0, 0.0, 0.0, 10.0, 470.0, 0.0]);
    let bytes = geotiff(&WGS84, 16, vec![far]);
    assert_refused("tif_far", "a.tif", &bytes, &["beyond the Earth"]);
    let nan = Field::doubles(33_550, &[f64::NAN, 1.0, 0.0]);
    assert_refused(
        "tif_nan",
        "a.tif",
        &geotiff(&WGS84, 16, vec![nan]),
        &["georeference"],
    );
}

#[test]
fn a_truncated_real_geotiff_is_refused() {
    let Some(data) = support::data_dir() else {
        return;
    };
    let whole = fs::read(data.join("elev/S33W071.tif")).expect("readable");
    assert_refused(
        "tif_real",
        "S33W071.tif",
        &whole[..1_000_000],
        &["truncated TIFF"],
    );
}

#[test]
fn a_file_given_twice_is_refused_and_files_of_one_place_are_put_together() {
    let folder = support::scratch_dir("cli_twice");
    let a = folder.join("N50E014.hgt");
    write_hgt(&a, |_, _| 55);
    let out = folder.join("out.pack");
    let other_way = folder.join("../cli_twice/N50E014.hgt");
    for again in [&a, &other_way] {
        let twice = ["bake", text(&a), text(again), "--out", text(&out)];
        assert_fails(&twice, 2, &[text(again), "twice", "once"]);
    }
    assert_only(&folder, &["N50E014.hgt"]);
    // A part of the same cell, from a source that says 0 m.
    let part = folder.join("part.tif");
    let tie = Field::doubles(33_922, &[0.0, 0.0, 0.0, 14.5, 50.5, 0.0]);
    let step = Field::doubles(33_550, &[1.0 / 1200.0, 1.0 / 1200.0, 0.0]);
    fs::write(&part, geotiff(&WGS84, 16, vec![tie, step])).expect("written");
    let done = terrain(&["bake", text(&part), text(&a), "--out", text(&out)]);
    assert!(
        done.status.success(),
        "{}",
        String::from_utf8_lossy(&done.stderr)
    );
    let said = String::from_utf8_lossy(&done.stderr).into_owned();
    for word in [text(&a), text(&part), "differ by up to", "posts"] {
        assert!(said.contains(word), "`{word}` in: {said}");
    }
}

#[test]
fn wrong_usage_is_told_apart_from_wrong_input() {
    assert_fails(&["bake", "--out", "x.pack"], 2, &["INPUT"]);
    assert_fails(&["bake", "a.hgt"], 2, &["--out"]);
    for region in ["1,2,3", "1,2,3,x", "5,2,3,4", "1,4,3,2", "-91,0,0,1"] {
        let args = ["bake", "a.hgt", "--out", "x.pack", "--region", region];
        assert_fails(&args, 2, &["region"]);
    }
    assert_fails(&["height", "x.pack", "north", "14"], 2, &["north"]);
}

#[test]
fn a_pack_that_cannot_be_written_is_named() {
    let folder = support::scratch_dir("cli_output");
    let file = folder.join("N50E014.hgt");
    write_hgt(&file, |_, _| 5);
    let out = folder.join("no/such/folder/out.pack");
    let words = [text(&out), "cannot be written"];
    assert_fails(&["bake", text(&file), "--out", text(&out)], 1, &words);
}

/// A sound pack of one made-up tile, south of the equator and west of Greenwich.
fn pack(test: &str) -> PathBuf {
    let folder = support::scratch_dir(&format!("cli_{test}"));
    let file = folder.join("S33W071.hgt");
    write_hgt(&file, |row, column| {
        i16::try_from((row * row / 900 + column * 3) % 4000).expect("small")
    });
    let out = folder.join("out.pack");
    let output = terrain(&["bake", text(&file), "--out", text(&out)]);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    out
}

fn json(args: &[&str]) -> serde_json::Value {
    let output = terrain(args);
    assert!(
        output.status.success(),
        "{args:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    serde_json::from_slice(&output.stdout).expect("one JSON document")
}

#[test]
fn heights_are_printed_for_negative_coordinates() {
    let out = pack("height");
    let answer = json(&["height", text(&out), "-32.5", "-70.25", "--json"]);
    // Row 600 from the north, column 900: 600 * 600 / 900 + 2700 = 3100.
    assert_eq!(answer["orthometric_m"], 3100.0);
    assert_eq!(
        (&answer["level"], &answer["void"]),
        (&0.into(), &false.into())
    );
    let n = answer["ellipsoidal_m"].as_f64().expect("a number") - 3100.0;
    // EGM96 in the Andes east of Santiago (NGA's 15' grid): 30 to 36 m.
    assert!((25.0..40.0).contains(&n), "{n}");
    assert_fails(
        &["height", text(&out), "32.5", "-70.25"],
        3,
        &["does not cover 32.5 -70.25"],
    );
}

#[test]
fn info_says_what_is_in_a_pack() {
    let out = pack("info");
    let info = json(&["info", text(&out), "--json"]);
    assert_eq!(info["posts"], 1201 * 1201);
    assert_eq!(info["posts_per_degree"], 1200);
    assert_eq!(info["levels"].as_array().map(Vec::len), Some(10));
    assert_eq!(info["bounds"]["south"], -33.0);
    assert_eq!(info["bounds"]["east"], -70.0);
    assert_eq!(info["max_error_m"], 0.0);
    assert!(
        info["bits_per_sample"]
            .as_f64()
            .is_some_and(|b| b > 0.0 && b < 16.0)
    );
}

#[test]
fn a_reader_that_goes_away_is_no_failure_and_a_full_disk_is_one() {
    let pack = pack("stdout");
    let info = |stdout: Stdio| {
        support::glasswing_command()
            .args(["terrain", "info", text(&pack)])
            .stdout(stdout)
            .output()
            .expect("the program starts")
    };
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let unread = info(writer.into());
    let complaint = String::from_utf8_lossy(&unread.stderr);
    assert_eq!(unread.status.code(), Some(0), "{complaint}");
    assert_eq!(complaint, "", "nobody is to be bothered");
    let full = fs::OpenOptions::new()
        .write(true)
        .open("/dev/full")
        .expect("Linux has it");
    let full = info(full.into());
    let complaint = String::from_utf8_lossy(&full.stderr);
    assert_eq!(full.status.code(), Some(1), "{complaint}");
    assert!(
        complaint.starts_with("glasswing: standard output: "),
        "{complaint}"
    );
}

#[test]
fn verify_names_every_damaged_tile() {
    let out = pack("verify");
    let sound = json(&["verify", text(&out), "--json"]);
    assert_eq!(sound["damaged"].as_array().map(Vec::len), Some(0));
    let mut bytes = fs::read(&out).expect("baked");
    // Two places far apart among the tiles, which begin at byte 736.
    bytes[900] ^= 4;
    bytes[20_000] ^= 4;
    let damaged = out.with_file_name("damaged.pack");
    fs::write(&damaged, &bytes).expect("written");
    let output = terrain(&["verify", text(&damaged), "--json"]);
    assert_eq!(output.status.code(), Some(3));
    let report: serde_json::Value =
        serde_json::from_slice(&output.stdout).expect("one JSON document");
    assert_eq!(report["damaged"].as_array().map(Vec::len), Some(2));
    assert_fails(
        &["verify", text(&damaged)],
        3,
        &["2 of", "checksum", "bake it again"],
    );
}

#[test]
fn packs_that_are_none_are_named_with_what_to_do() {
    let out = pack("open");
    let bytes = fs::read(&out).expect("baked");
    let bad = out.with_file_name("bad.pack");
    let mut newer = bytes.clone();
    newer[8] = 9;
    let mut older = bytes.clone();
    older[8] = 2;
    let mut header = bytes.clone();
    header[70] ^= 1;
    let mut index = bytes.clone();
    let at = index.len() - 5000;
    index[at] ^= 1;
    for (content, words) in [
        (
            newer,
            &[
                "written by a newer glasswing (format 9; this one reads up to 4)",
                "update",
            ][..],
        ),
        (older, &["has format 2", "bake it again from its sources"]),
        (
            bytes[..bytes.len() - 1].to_vec(),
            &["cut short", "copy it again"],
        ),
        (header, &["header is damaged"]),
        (index, &["is damaged"]),
        (b"nothing of the kind".to_vec(), &["is not a terrain pack"]),
    ] {
        fs::write(&bad, content).expect("written");
        assert_fails(&["info", text(&bad)], 3, &[&[text(&bad)], words].concat());
    }
    let missing = out.with_file_name("missing.pack");
    assert_fails(
        &["verify", text(&missing)],
        3,
        &[text(&missing), "cannot be read"],
    );
}

/// Starts a long bake and waits for its temporary file; the files of the folder are `inputs`.
fn interrupted(test: &str, signal: rustix::process::Signal) -> (PathBuf, Option<i32>) {
    let folder = support::scratch_dir(&format!("cli_{test}"));
    let mut command = support::glasswing_command();
    command.args(["terrain", "bake"]);
    for longitude in 10..22 {
        let file = folder.join(format!("N50E0{longitude}.hgt"));
        write_hgt(&file, |row, column| {
            i16::try_from((row * 7919 + column * 104_729) % 2000).expect("small")
        });
        command.arg(file);
    }
    command
        .arg("--out")
        .arg(folder.join("out.pack"))
        .args(["--jobs", "1"]);
    let mut child = command
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the program starts");
    let is_part = |e: std::io::Result<fs::DirEntry>| {
        e.is_ok_and(|e| e.file_name().to_string_lossy().ends_with(".part"))
    };
    while !fs::read_dir(&folder).expect("lists").any(is_part) {
        assert!(
            child.try_wait().expect("a child").is_none(),
            "it ended too early"
        );
        std::thread::sleep(Duration::from_millis(2));
    }
    rustix::process::kill_process(rustix::process::Pid::from_child(&child), signal)
        .expect("it still runs");
    let status = child.wait().expect("it ends");
    (folder, status.code())
}

#[test]
fn an_interrupted_bake_leaves_nothing() {
    let (folder, code) = interrupted("sigint", rustix::process::Signal::INT);
    assert_eq!(code, Some(1), "it ends by itself");
    let left: Vec<_> = fs::read_dir(&folder)
        .expect("lists")
        .map(|e| {
            e.expect("an entry")
                .file_name()
                .to_string_lossy()
                .into_owned()
        })
        .filter(|n| !n.ends_with(".hgt"))
        .collect();
    assert_eq!(left, Vec::<String>::new());
}

#[test]
fn a_killed_bake_leaves_no_pack_under_its_name() {
    let (folder, code) = interrupted("sigkill", rustix::process::Signal::KILL);
    if !support::is_emulated() {
        assert_eq!(code, None, "killed");
    }
    assert!(!folder.join("out.pack").exists());
}

#[test]
fn the_demo_terrain_is_the_same_every_time() {
    let folder = support::scratch_dir("cli_synth");
    let (a, b, c) = (folder.join("a"), folder.join("b"), folder.join("c"));
    for (out, seed) in [(&a, "1"), (&b, "1"), (&c, "2")] {
        let output = terrain(&["synth", "--out", text(out), "--seed", seed]);
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
    }
    let [a, b, c] = [a, b, c].map(|p| fs::read(p).expect("made"));
    assert!(a == b, "one seed, one terrain");
    assert!(a != c, "another seed, another terrain");
}
