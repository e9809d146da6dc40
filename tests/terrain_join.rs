//! Packs of regions joined, and bakes that go on after an interruption: the same bytes as a bake at once.

#![expect(
    clippy::expect_used,
    reason = "a test says what it needs and fails where that is not so"
)]

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use glasswing::terrain::bake::{self, BakeError, Heights};
use glasswing::terrain::join::{self, JoinError};
use glasswing::terrain::pack::Bounds;
use glasswing::terrain::plain::PlainGrids;

mod support;
#[path = "terrain_bake_support/mod.rs"]
mod with;

use with::{baked, baked_as, write_tiff};

/// Half a degree of hills around the corner of four cells at 47 N 11 E, with a lake and a void over that corner.
fn hills(path: &Path) {
    let samples: Vec<i16> = (0..601)
        .flat_map(|row| (0..601).map(move |column| (column - 300, 300 - row)))
        .map(|(i, j)| {
            let (x, y) = (f64::from(i), f64::from(j));
            let from = |a: f64, b: f64| (x - a).hypot(y - b);
            if from(10.0, -6.0) < 25.0 {
                -32_768
            } else if from(-60.0, 20.0) < 40.0 {
                640
            } else {
                #[expect(clippy::cast_possible_truncation, reason = "some hundred metres")]
                {
                    (900.0 + 150.0 * (x / 23.0).sin() * (y / 31.0).cos() + from(-60.0, 20.0)) as i16
                }
            }
        })
        .collect();
    write_tiff(path, (601, 601), (10.75, 47.25), 1.0 / 1200.0, &samples);
}

fn join(packs: &[PathBuf], out: &Path) -> Result<bake::Report, JoinError> {
    let stop = AtomicBool::new(false);
    let job = join::Job {
        packs,
        out,
        jobs: 2,
        stop: &stop,
    };
    join::join(&job, &mut |_, _| {})
}

/// The hills, and their packs: whole, and cut at a parallel and a meridian that no cell ends at.
fn shards(name: &str) -> (PathBuf, PathBuf, Vec<PathBuf>) {
    let folder = support::scratch_dir(name);
    let file = folder.join("hills.tif");
    hills(&file);
    let whole = folder.join("whole.pack");
    baked(std::slice::from_ref(&file), &whole).expect("a sound file");
    let regions = [
        (46.0, 10.0, 46.99, 12.0),
        (46.99, 10.0, 48.0, 10.97),
        (46.99, 10.97, 48.0, 12.0),
    ];
    let packs = regions.iter().zip(1..).map(|(r, number)| {
        let out = folder.join(format!("{number}.pack"));
        let region = Bounds {
            south_deg: r.0,
            west_deg: r.1,
            north_deg: r.2,
            east_deg: r.3,
        };
        let files = std::slice::from_ref(&file);
        baked_as(files, &out, Heights::Egm96, Some(region), 1).expect("a sound file");
        out
    });
    let packs = packs.collect();
    (folder, whole, packs)
}

#[test]
fn joined_regions_are_the_pack_of_the_whole() {
    if support::is_emulated() {
        support::skip("whole degree cells are not joined under emulation");
        return;
    }
    let (folder, whole, packs) = shards("join_regions");
    let out = folder.join("joined.pack");
    for packs in [packs.clone(), packs.iter().rev().cloned().collect()] {
        let report = join(&packs, &out).expect("sound packs");
        assert!(report.seams.is_empty(), "{:?}", report.seams);
        // Everything but the list of sources, in which the file that was cut in three may stand in two parts.
        let [joined, baked] = [&out, &whole].map(|p| fs::read(p).expect("written"));
        let end = |file: &[u8]| u64::from_le_bytes(file[128..136].try_into().expect("8 bytes"));
        assert_eq!(
            end(&joined),
            end(&baked),
            "tiles, index and geoid take the same place"
        );
        let sections = usize::try_from(end(&baked)).expect("small");
        assert!(
            joined[736..sections] == baked[736..sections],
            "and are the same"
        );
    }
}

#[test]
fn packs_that_do_not_fit_or_are_damaged_are_refused_by_name() {
    let (folder, _, packs) = shards("join_refused");
    let out = folder.join("out.pack");
    let twice = [packs[0].clone(), packs[0].clone()];
    assert!(matches!(join(&twice, &out), Err(JoinError::Twice(ref p)) if *p == packs[0]));
    let missing = [packs[0].clone(), folder.join("none.pack")];
    assert!(matches!(join(&missing, &out), Err(JoinError::Pack(ref p, _)) if *p == missing[1]));
    let fine = folder.join("fine.tif");
    write_tiff(&fine, (9, 9), (10.0, 46.0), 1.0 / 3600.0, &[7; 81]);
    let fine_pack = folder.join("fine.pack");
    baked(&[fine], &fine_pack).expect("a sound file");
    let e = join(&[packs[0].clone(), fine_pack.clone()], &out).expect_err("1\" and 3\"");
    assert!(matches!(e, JoinError::Grid { .. }), "{e}");
    let mut bytes = fs::read(&packs[0]).expect("baked");
    bytes[900] ^= 1;
    let bad = folder.join("bad.pack");
    fs::write(&bad, bytes).expect("written");
    let e = join(&[bad.clone(), packs[1].clone()], &out).expect_err("a flipped bit");
    assert!(matches!(e, JoinError::Tile(ref p, ..) if *p == bad), "{e}");
    assert!(!out.exists());
    // A pack that says otherwise is heard and told.
    let other = folder.join("other.tif");
    write_tiff(&other, (20, 20), (10.8, 47.2), 1.0 / 1200.0, &[99; 400]);
    let other_pack = folder.join("other.pack");
    baked(&[other], &other_pack).expect("a sound file");
    let report = join(&[packs[1].clone(), other_pack.clone()], &out).expect("they overlap");
    let [seam] = report.seams.as_slice() else {
        panic!("one disagreement: {:?}", report.seams);
    };
    assert_eq!(
        (&seam.taken, &seam.other, seam.posts),
        (&packs[1], &other_pack, 400)
    );
}

#[test]
fn an_interrupted_bake_goes_on_from_its_parts() {
    let folder = support::scratch_dir("join_parts");
    let (file, parts) = (folder.join("hills.tif"), folder.join("parts"));
    hills(&file);
    let whole = folder.join("whole.pack");
    baked(std::slice::from_ref(&file), &whole).expect("a sound file");
    let out = folder.join("out.pack");
    let inputs = [file];
    // Interrupted as soon as the first row of cells is finished.
    let first = parts.join("N46.pack");
    let bake = |heights, interrupted: bool| {
        let stop = AtomicBool::new(false);
        let job = bake::Job {
            inputs: &inputs,
            plain: &PlainGrids::default(),
            out: &out,
            heights,
            region: None,
            parts: Some(&parts),
            jobs: 2,
            stop: &stop,
        };
        bake::bake(&job, &mut |_, _| {
            stop.store(interrupted && first.exists(), Ordering::Relaxed);
        })
    };
    let stopped = bake(Heights::Egm96, true).expect_err("interrupted");
    assert!(matches!(stopped, BakeError::Stopped), "{stopped}");
    assert!(first.exists() && !out.exists(), "a finished part is kept");
    let written = |path: &Path| {
        fs::metadata(path)
            .and_then(|m| m.modified())
            .expect("there")
    };
    let before = written(&first);
    let other = bake(Heights::Ellipsoidal, false).expect_err("other options");
    assert!(
        matches!(other, BakeError::OtherParts(ref p) if *p == parts),
        "{other}"
    );
    assert_eq!(written(&first), before, "nothing was touched");
    bake(Heights::Egm96, false).expect("the rest");
    assert!(!parts.exists(), "the folder is gone");
    assert!(
        fs::read(&out).expect("baked") == fs::read(&whole).expect("baked"),
        "byte for byte"
    );
}

/// The worked example for batch systems, on tiles on both sides of a shard's edge.
#[test]
fn the_shards_of_a_batch_system_join_to_what_a_bake_makes() {
    if support::is_emulated() {
        support::skip("whole degree cells are not joined under emulation");
        return;
    }
    let folder = support::scratch_dir("join_batch");
    let [tiles, out] = ["tiles", "shards"].map(|n| folder.join(n));
    for folder in [&tiles, &out] {
        fs::create_dir_all(folder).expect("made");
    }
    let height = |row: i32, column: i32| {
        #[expect(clippy::cast_possible_truncation, reason = "some hundred metres")]
        {
            (300.0 + 90.0 * (f64::from(row) / 40.0).sin() * (f64::from(column) / 55.0).cos()) as i16
        }
    };
    // 50 N is the edge between shards 487 and 523. A row or column that two tiles share is the same in both.
    let files = ["N49E010.hgt", "N50E010.hgt"].map(|name| tiles.join(name));
    for (file, first) in files.iter().zip([0, -1200]) {
        with::write_hgt(file, |row, column| height(row + first, column));
    }
    let program = support::glasswing_command();
    let wrapper = folder.join("glasswing");
    let words = std::iter::once(program.get_program()).chain(program.get_args());
    let line: Vec<String> = words
        .map(|w| format!("'{}'", w.to_string_lossy()))
        .collect();
    fs::write(
        &wrapper,
        format!("#!/bin/sh\nexec {} \"$@\"\n", line.join(" ")),
    )
    .expect("written");
    fs::set_permissions(
        &wrapper,
        std::os::unix::fs::PermissionsExt::from_mode(0o755),
    )
    .expect("set");
    let numbers = ["487", "523", "0"];
    for (number, variable) in numbers.iter().zip([
        "SLURM_ARRAY_TASK_ID",
        "JOB_COMPLETION_INDEX",
        "SLURM_ARRAY_TASK_ID",
    ]) {
        let status = std::process::Command::new("bash")
            .arg(support::source_dir().join("tests/shards/bake-shard"))
            .envs([("TILES", &tiles), ("SHARDS", &out), ("GLASSWING", &wrapper)])
            .env(variable, number)
            .status()
            .expect("bash starts");
        assert!(status.success(), "shard {number}");
    }
    let packs = ["shard-487.pack", "shard-523.pack"].map(|n| out.join(n));
    assert!(
        !out.join("shard-000.pack").exists(),
        "a region without tiles makes no shard"
    );
    let (joined, whole) = (folder.join("joined.pack"), folder.join("whole.pack"));
    let report = join(&packs, &joined).expect("sound packs");
    assert!(report.seams.is_empty(), "{:?}", report.seams);
    baked(&files, &whole).expect("sound files");
    assert!(
        fs::read(&joined).expect("joined") == fs::read(&whole).expect("baked"),
        "byte for byte"
    );
}
