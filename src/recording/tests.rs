//! Recordings cut, damaged, turned over and refused by the disk.

use super::error::RecordingError;
use super::format::{Beginning, Kind, PartHeader, RECORD_MAX, Record};
use super::part::{Damage, Part};
use super::tape::{Event, Tape, Timed};
use super::{Header, Plan, Recorder, SIZE_LIMIT_MIN, Source, set};
use crate::signal::{CanData, Frame, SourceId, Wire};
use crate::time::Monotonic;
use std::fs;
use std::path::{Path, PathBuf};

fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("glasswing-rec-{}-{name}", std::process::id()));
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).expect("made");
    folder
}

fn header(sources: usize) -> Header {
    let source = |i: usize| Source {
        name: format!("source, \"{i}\""),
        protocol: "fgfdm".into(),
        bus: "udp".into(),
        at: format!("127.0.0.1:{i}"),
        ..Source::default()
    };
    Header {
        program: "test".into(),
        sources: (0..sources).map(source).collect(),
    }
}

fn can(k: u64) -> CanData {
    let len = u8::try_from(k % 9).unwrap_or(0);
    let mut data = k.wrapping_mul(0x9E37_79B9_7F4A_7C15).to_be_bytes();
    data[usize::from(len)..].fill(0);
    CanData {
        id: u32::try_from(k % 2048).unwrap_or(0),
        extended: k.is_multiple_of(3),
        len,
        data,
    }
}

fn at(k: u64) -> Monotonic {
    Monotonic::from_nanos(k * 1_000_000)
}

fn read(path: &Path) -> (Vec<Timed>, Damage) {
    let mut tape = Tape::open(path).expect("opens");
    let mut all = Vec::new();
    while let Some(timed) = tape.next_entry().expect("reads") {
        all.push(timed);
    }
    (all, tape.damage())
}

/// Frames of CAN in a tape, in order.
fn frames(all: &[Timed]) -> Vec<(usize, Monotonic, CanData)> {
    let frame = |timed: &Timed| match &timed.entry.event {
        Event::Can(can) => Some((timed.entry.source?, timed.at, *can)),
        _ => None,
    };
    all.iter().filter_map(frame).collect()
}

fn record(path: &Path, size_limit: Option<u64>, frames: std::ops::Range<u64>) -> super::Report {
    let plan = Plan {
        path: path.to_owned(),
        size_limit,
        header: header(2),
    };
    let (recorder, mut taps) = Recorder::start(plan).expect("starts");
    for k in frames {
        let frame = Frame {
            at: at(k),
            source: SourceId(0),
            wire: Wire::Can(can(k)),
        };
        taps[usize::from(size_limit.is_none() && k % 2 == 1)].take(&frame);
    }
    recorder.finish()
}

/// A file in memory: a header, then records of all kinds; and where each record ends.
fn sample() -> (Vec<u8>, Vec<usize>) {
    let part = PartHeader {
        number: 7,
        session: 3,
        header: header(1),
    };
    let mut bytes = part.bytes();
    let mut ends = vec![bytes.len()];
    let long = [0x47; 300];
    let payloads: [(Kind, &[u8]); 6] = [
        (Kind::Datagram, b"GRGRGR"),
        (Kind::Can, &[0x37, 1, 0, 0, 1, 2]),
        (Kind::Stream, b""),
        (Kind::Stream, &long),
        (Kind::Lost, &[5, 0, 0, 0, 0, 0, 0, 0]),
        (Kind::Mark, b""),
    ];
    for (k, (kind, payload)) in payloads.into_iter().enumerate() {
        let at = at(k as u64);
        let source = 0;
        Record {
            kind,
            source,
            at,
            payload,
        }
        .append(&mut bytes);
        ends.push(bytes.len());
    }
    (bytes, ends)
}

/// How many records are read, and the damage.
fn count(bytes: &[u8]) -> (usize, Damage) {
    let (beginning, mut part) = Part::open(bytes).expect("memory is read");
    let is_whole = matches!(beginning, Beginning::Header(..));
    let mut records = 0;
    while part.next().expect("memory is read").is_some() {
        records += 1;
    }
    assert!(is_whole || records == 0, "nothing is read without a header");
    (records, part.damage())
}

#[test]
fn a_file_is_laid_out_as_documented() {
    let (bytes, ends) = sample();
    assert_eq!(&bytes[..8], b"GLASSREC");
    assert_eq!(bytes[8..12], [1, 0, 0, 0], "version 1");
    assert_eq!(bytes[12..16], [7, 0, 0, 0], "number");
    let text = u32::from_le_bytes(bytes[24..28].try_into().expect("4"));
    assert_eq!(ends[0], 28 + text as usize + 4, "header");
    let can = &bytes[ends[1]..ends[2]];
    assert_eq!(can[..4], [b'G', b'R', 1, 0], "marker, kind, source");
    assert_eq!(can[4..8], [6, 0, 0, 0], "length");
    assert_eq!(can[8..16], 1_000_000_u64.to_le_bytes(), "time");
    assert_eq!(can[16..22], [0x37, 1, 0, 0, 1, 2], "identifier and data");
    assert_eq!(can.len(), 26, "and a checksum");
}

#[test]
fn a_file_cut_at_any_byte_gives_its_whole_records_and_no_other() {
    let (bytes, ends) = sample();
    for cut in 0..=bytes.len() {
        let (records, damage) = count(&bytes[..cut]);
        let whole = ends.iter().filter(|end| **end <= cut).count();
        assert_eq!(records, whole.saturating_sub(1), "cut at {cut}");
        assert_eq!((damage.places, damage.bytes), (0, 0), "cut at {cut}");
        let last = ends.iter().rev().find(|end| **end <= cut);
        let torn = last.map_or(0, |last| cut - last);
        assert_eq!(damage.torn_bytes, torn as u64, "cut at {cut}");
    }
}

#[test]
fn a_changed_byte_costs_the_record_that_it_is_in() {
    let (bytes, ends) = sample();
    for place in ends[0]..bytes.len() {
        let mut bytes = bytes.clone();
        bytes[place] ^= 0x41;
        let (records, damage) = count(&bytes);
        assert_eq!(records, ends.len() - 2, "byte {place}");
        let last = place >= ends[ends.len() - 2];
        assert_eq!(damage.places, u64::from(!last), "byte {place}");
        assert_eq!(damage.torn_bytes > 0, last, "byte {place}");
    }
    for place in 0..ends[0] {
        let mut bytes = bytes.clone();
        bytes[place] ^= 0x41;
        assert_eq!(count(&bytes).0, 0, "a damaged header, byte {place}");
    }
}

#[test]
fn bytes_lost_added_or_zero_in_the_middle_are_skipped() {
    let (bytes, ends) = sample();
    let (from, to) = (ends[2], ends[4]);
    let mut lost = bytes.clone();
    lost.drain(from + 3..to - 5);
    let mut added = bytes.clone();
    added.splice(from..from, vec![b'G'; 3 * RECORD_MAX]);
    let mut zero = bytes.clone();
    zero[from..to].fill(0);
    // A tail that the file system had allocated and not written.
    let mut tail = bytes.clone();
    tail.resize(bytes.len() + 100_000, 0);
    let all = ends.len() - 1;
    for (bytes, expected, places, torn) in [
        (lost, all - 2, 1, 0),
        (added, all, 1, 0),
        (zero, all - 2, 1, 0),
        (tail, all, 0, 100_000),
    ] {
        let (records, damage) = count(&bytes);
        assert_eq!(
            (records, damage.places, damage.torn_bytes),
            (expected, places, torn),
            "{damage:?}"
        );
    }
}

#[test]
fn what_was_recorded_is_read_back_in_the_order_of_time() {
    let folder = folder("back");
    let path = folder.join("a.gwr");
    let report = record(&path, None, 0..1000);
    assert_eq!(
        (report.frames, report.lost, &report.failing),
        (1000, 0, &None)
    );
    let (all, damage) = read(&path);
    assert_eq!(damage, Damage::default());
    let expected: Vec<_> = (0..1000)
        .map(|k| (usize::from(k % 2 == 1), at(k), can(k)))
        .collect();
    assert_eq!(frames(&all), expected);
    let tape = Tape::open(&path).expect("opens");
    assert_eq!(tape.sessions(), [header(2)], "with its sources");
    fs::remove_dir_all(folder).expect("removed");
}

#[test]
fn a_recording_goes_on_as_a_new_session() {
    let folder = folder("on");
    let path = folder.join("a.gwr");
    for start in [0, 500, 100] {
        record(&path, None, start..start + 100);
    }
    assert_eq!(set::all(&path).expect("listed").len(), 3, "a file for each");
    let (all, _) = read(&path);
    let sessions: Vec<usize> = all.iter().map(|timed| timed.entry.session).collect();
    assert!(sessions.is_sorted(), "one after the other");
    let times: Vec<Monotonic> = frames(&all).iter().map(|(_, at, _)| *at).collect();
    assert_eq!(times.len(), 300);
    assert_eq!(
        [times[0], times[100], times[200]],
        [at(0), at(500), at(100)]
    );
    fs::remove_dir_all(folder).expect("removed");
}

#[test]
fn a_size_limit_is_kept_and_the_newest_stays() {
    let folder = folder("limit");
    let path = folder.join("a.gwr");
    let frames_each = 40_000;
    for round in 0..3 {
        record(
            &path,
            Some(SIZE_LIMIT_MIN),
            round * frames_each..(round + 1) * frames_each,
        );
        let files = set::all(&path).expect("listed");
        let bytes: u64 = files
            .iter()
            .map(|file| file.metadata().expect("there").len())
            .sum();
        assert!(bytes <= SIZE_LIMIT_MIN, "{bytes} bytes");
        let (all, damage) = read(&path);
        let frames = frames(&all);
        assert_eq!(damage, Damage::default());
        let last = frames.last().expect("frames");
        let end = (round + 1) * frames_each - 1;
        assert_eq!((last.1, last.2), (at(end), can(end)), "the newest is there");
        // What is there has no gap.
        let first = frames[0].1.as_nanos() / 1_000_000;
        assert_eq!(frames.len() as u64, end + 1 - first, "without a gap");
        assert!(
            round == 0 || frames.len() > 15_000,
            "{} frames kept",
            frames.len()
        );
    }
    fs::remove_dir_all(folder).expect("removed");
}

#[test]
fn a_power_cut_while_files_change_places_costs_nothing() {
    let folder = folder("places");
    let path = folder.join("a.gwr");
    record(&path, None, 0..10);
    // Cut after the full file was renamed, before the next one was there.
    fs::rename(&path, set::full(&path, 1)).expect("renamed");
    assert!(Tape::is_one(&path), "its full files are there");
    assert_eq!(frames(&read(&path).0).len(), 10);
    // Cut while the next one's header was written.
    for torn in [&b""[..], b"GLASS", b"GLASSREC\x01\x00"] {
        fs::write(&path, torn).expect("written");
        let (all, damage) = read(&path);
        assert_eq!((frames(&all).len(), damage.headers), (10, 1));
    }
    record(&path, None, 10..20);
    assert_eq!(frames(&read(&path).0).len(), 20, "and it goes on");
    fs::remove_dir_all(folder).expect("removed");
}

#[test]
fn nothing_but_a_recording_is_put_aside_or_replayed() {
    let folder = folder("other");
    let path = folder.join("letter.txt");
    fs::write(&path, "Dear Sir").expect("written");
    let start = |path: &Path| {
        let plan = Plan {
            path: path.to_owned(),
            size_limit: None,
            header: header(1),
        };
        Recorder::start(plan).map(|_| ()).expect_err("refused")
    };
    assert!(matches!(start(&path), RecordingError::NotARecording { .. }));
    assert_eq!(fs::read(&path).expect("read"), b"Dear Sir", "untouched");
    assert!(
        matches!(start(&folder), RecordingError::Unwritable { .. }),
        "a folder"
    );
    let nowhere = folder.join("nowhere/a.gwr");
    assert!(matches!(start(&nowhere), RecordingError::Unwritable { .. }));
    assert!(matches!(
        Tape::open(&path),
        Err(RecordingError::NotARecording { .. })
    ));
    assert!(matches!(
        Tape::open(&nowhere),
        Err(RecordingError::Missing { .. })
    ));
    let mut later = sample().0;
    later[8] = 2;
    fs::write(&path, later).expect("written");
    assert!(matches!(
        Tape::open(&path),
        Err(RecordingError::Version { version: 2, .. })
    ));
    fs::remove_dir_all(folder).expect("removed");
}

#[test]
fn a_recording_is_not_written_by_two() {
    let folder = folder("two");
    let path = folder.join("a.gwr");
    let plan = Plan {
        path: path.clone(),
        size_limit: None,
        header: header(1),
    };
    let (first, _taps) = Recorder::start(plan.clone()).expect("starts");
    let second = Recorder::start(plan).map(|_| ()).expect_err("held");
    assert!(matches!(second, RecordingError::Held { .. }), "{second}");
    drop(first);
    fs::remove_dir_all(folder).expect("removed");
}

#[test]
fn what_does_not_fit_the_ring_is_counted_in_the_recording() {
    let folder = folder("ring");
    let path = folder.join("a.gwr");
    let plan = Plan {
        path: path.clone(),
        size_limit: None,
        header: header(1),
    };
    let (recorder, mut taps) = Recorder::start(plan).expect("starts");
    let datagram = [0; 1472];
    // 22 MB at once, into rings of 2 MB that are emptied ten times a second.
    let sent = 15_000;
    for k in 0..sent {
        let frame = Frame {
            at: at(k),
            source: SourceId(0),
            wire: Wire::Datagram(&datagram),
        };
        taps[0].take(&frame);
    }
    let report = recorder.finish();
    assert_eq!(report.frames + report.lost, sent, "{report:?}");
    let (all, _) = read(&path);
    let lost: u64 = all
        .iter()
        .map(|timed| match timed.entry.event {
            Event::Lost(frames) => frames,
            _ => 0,
        })
        .sum();
    assert_eq!(lost, report.lost, "told");
    fs::remove_dir_all(folder).expect("removed");
}
