//! Recordings are named for what they are: whole, in cuts of two seconds, with other kinds between; noise is named nothing.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

#[allow(dead_code, reason = "storms damage frames besides")]
#[path = "storm_support/random.rs"]
mod random;
mod support;

use glasswing::proto::Protocol;
use glasswing::proto::capture::{CandumpLine, UdpCapture};
use glasswing::proto::sniff::{Sniffer, Verdict};
use glasswing::signal::{CanData, Wire};
use random::Random;
use std::path::Path;

/// A recording, and the least confidence with which it has to be named: whole, and in a cut.
struct Recording {
    file: &'static str,
    protocol: Protocol,
    least: f64,
    least_cut: f64,
}

const fn recording(
    file: &'static str,
    protocol: Protocol,
    least: f64,
    least_cut: f64,
) -> Recording {
    Recording {
        file,
        protocol,
        least,
        least_cut,
    }
}

/// What serial lines gave, as bytes.
const STREAMS: [Recording; 10] = [
    recording("dynon_skyview_data1.txt", Protocol::DynonSkyView, 0.8, 0.4),
    recording("dynon_d100_data1.txt", Protocol::DynonD100, 0.95, 0.8),
    recording("g3x_1.dat", Protocol::GarminG3x, 0.95, 0.8),
    recording("garmin_g5_capture.txt", Protocol::GarminG3x, 0.95, 0.7),
    recording("mgl_data1.bin", Protocol::Mgl, 0.9, 0.6),
    recording("stratux_1.dat", Protocol::Gdl90, 0.9, 0.4),
    recording("stratux_57.dat", Protocol::Gdl90, 0.9, 0.4),
    recording("xcsoar_rl-traffic.nmea", Protocol::Nmea, 0.95, 0.8),
    recording("pyubx2_pygpsdata-MIXED.log", Protocol::Nmea, 0.3, 0.1),
    recording("fg2020.3.16_c172p_nmea.bin", Protocol::Nmea, 0.95, 0.8),
];

fn read(data: &Path, file: &str) -> Vec<u8> {
    std::fs::read(data.join("bus").join(file)).expect("the recording can be read")
}

/// The bytes of a recording, out of their container if they are in one.
fn bytes(data: &Path, file: &str) -> Vec<u8> {
    let bytes = read(data, file);
    if !UdpCapture::is_one(&bytes) {
        return bytes;
    }
    UdpCapture::new(&bytes)
        .flat_map(|record| record.expect("whole").1.to_vec())
        .collect()
}

fn heard(chunks: &[&[u8]]) -> Verdict {
    let mut sniffer = Sniffer::new();
    for chunk in chunks {
        sniffer.push(Wire::Stream(chunk));
    }
    sniffer.verdict()
}

fn confidence(verdict: &Verdict, protocol: Protocol) -> f64 {
    let of = verdict.findings.iter().find(|f| f.protocol == protocol);
    of.map_or(0.0, |f| f.confidence)
}

/// Only this one, and as surely as that.
#[track_caller]
fn assert_named(verdict: &Verdict, protocol: Protocol, least: f64, what: &str) {
    assert!(
        confidence(verdict, protocol) >= least,
        "{what}: {verdict:?}"
    );
    for finding in &verdict.findings {
        assert!(
            (0.0..=1.0).contains(&finding.confidence),
            "{what}: {verdict:?}"
        );
    }
}

#[test]
fn every_recording_of_a_line_is_named_and_nothing_else() {
    let Some(data) = support::data_dir() else {
        return;
    };
    for r in &STREAMS {
        let verdict = heard(&[&bytes(&data, r.file)]);
        assert_named(&verdict, r.protocol, r.least, r.file);
        let is_mixed = r.file.contains("MIXED");
        let expected = if is_mixed { 2 } else { 1 };
        assert_eq!(verdict.findings.len(), expected, "{}: {verdict:?}", r.file);
        if is_mixed {
            assert!(confidence(&verdict, Protocol::Ubx) > 0.3, "{verdict:?}");
        }
    }
}

#[test]
fn two_seconds_of_a_line_are_enough() {
    let Some(data) = support::data_dir() else {
        return;
    };
    let mut random = Random(7);
    for r in &STREAMS {
        let bytes = bytes(&data, r.file);
        // At 9600 baud; in pieces, as a port gives them.
        for _ in 0..20 {
            let at = random.below(bytes.len() - 1920);
            let cut: Vec<&[u8]> = bytes[at..at + 1920].chunks(1 + random.below(64)).collect();
            let verdict = heard(&cut);
            if r.file.contains("MIXED") {
                let is_one = |f: &glasswing::proto::sniff::Finding| {
                    matches!(f.protocol, Protocol::Nmea | Protocol::Ubx)
                };
                assert!(verdict.findings.iter().all(is_one), "{at}: {verdict:?}");
                continue;
            }
            assert_named(&verdict, r.protocol, r.least_cut, r.file);
            assert_eq!(verdict.findings.len(), 1, "{} {at}: {verdict:?}", r.file);
        }
    }
}

#[test]
fn two_kinds_on_one_line_are_both_named() {
    let Some(data) = support::data_dir() else {
        return;
    };
    let mut random = Random(11);
    for a in &STREAMS {
        for b in &STREAMS {
            let alike = a.protocol == b.protocol;
            // A line of 51 characters has neither beginning nor mark: between other lines its kind is not looked for.
            if alike || a.file.contains("MIXED") || b.file.contains("MIXED") {
                continue;
            }
            let (one, two) = (bytes(&data, a.file), bytes(&data, b.file));
            let mut mixed: Vec<&[u8]> = Vec::new();
            let (mut i, mut j) = (0, 0);
            while i + 512 < one.len().min(8192) && j + 512 < two.len().min(8192) {
                let (n, m) = (256 + random.below(256), 256 + random.below(256));
                mixed.extend([&one[i..i + n], &two[j..j + m]]);
                (i, j) = (i + n, j + m);
            }
            let verdict = heard(&mixed);
            for r in [a, b] {
                assert!(
                    confidence(&verdict, r.protocol) > 0.1,
                    "{} in {} and {}: {verdict:?}",
                    r.file,
                    a.file,
                    b.file
                );
            }
        }
    }
}

#[test]
fn noise_silence_and_other_text_are_nothing() {
    let mut random = Random(3);
    assert_eq!(heard(&[]), Verdict::default());
    for n in 0..200 {
        let length = random.below(20_000);
        let noise: Vec<u8> = match n % 3 {
            0 => (0..length).map(|_| random.byte()).collect(),
            // As a line at a wrong speed gives it: few values, many zeros.
            1 => (0..length)
                .map(|_| random.byte() & random.byte() & 0xF0)
                .collect(),
            // Lines of letters and digits, as any device may send them.
            _ => (0..length)
                .map(|i| {
                    if i % 53 < 51 {
                        b'0' + random.byte() % 43
                    } else {
                        b'\n'
                    }
                })
                .collect(),
        };
        let verdict = heard(&[&noise]);
        assert!(verdict.findings.is_empty(), "{n}: {verdict:?}");
        let mut sniffer = Sniffer::new();
        for datagram in noise.chunks(408) {
            sniffer.push(Wire::Datagram(datagram));
        }
        assert!(sniffer.verdict().findings.is_empty(), "{n}");
    }
    if let Some(data) = support::data_dir() {
        let verdict = heard(&[&read(&data, "0asljd01.igc")]);
        assert!(verdict.findings.is_empty(), "a file, no line: {verdict:?}");
    }
}

#[test]
fn datagrams_of_flightgear_are_named() {
    let Some(data) = support::data_dir() else {
        return;
    };
    for (file, protocol) in [
        ("jsbsim_c172x_netfdm.bin", Protocol::FgFdm),
        ("fg2020.3.16_c172p_generic_svgc.bin", Protocol::FgGeneric),
        ("fg2020.3.16_c172p_nmea.bin", Protocol::Nmea),
    ] {
        let capture = read(&data, file);
        let records: Vec<&[u8]> = UdpCapture::new(&capture)
            .map(|r| r.expect("whole").1)
            .collect();
        for cut in [&records[..], &records[records.len() / 2..][..20]] {
            let mut sniffer = Sniffer::new();
            for datagram in cut {
                sniffer.push(Wire::Datagram(datagram));
            }
            let verdict = sniffer.verdict();
            assert_named(&verdict, protocol, 0.8, file);
            assert_eq!(verdict.findings.len(), 1, "{file}: {verdict:?}");
            let fields = verdict.findings[0].fields;
            // Sixteen fields, and the layout that comes with the program has another number.
            let expected = (protocol == Protocol::FgGeneric).then_some(16);
            assert_eq!(fields, expected, "{file}");
        }
    }
}

#[test]
fn simulators_that_are_not_read_are_told_apart_from_noise() {
    let mut sniffer = Sniffer::new();
    for _ in 0..10 {
        sniffer.push(Wire::Datagram(&[b"DATA*".as_slice(), &[0; 36]].concat()));
    }
    let verdict = sniffer.verdict();
    assert!(verdict.findings.is_empty(), "{verdict:?}");
    assert!(
        verdict.hint.is_some_and(|h| h.contains("X-Plane")),
        "{verdict:?}"
    );
}

fn candump(data: &Path, file: &str) -> Vec<CanData> {
    let log = String::from_utf8(read(data, file)).expect("text");
    let frame = |line: &str| match CandumpLine::parse(line) {
        CandumpLine::Data(_, can) => Some(can),
        _ => None,
    };
    log.lines().filter_map(frame).collect()
}

fn on_can(frames: &[CanData]) -> Verdict {
    let mut sniffer = Sniffer::new();
    for frame in frames {
        sniffer.push(Wire::Can(*frame));
    }
    sniffer.verdict()
}

#[test]
fn logs_of_can_are_named_or_not() {
    let Some(data) = support::data_dir() else {
        return;
    };
    let log = candump(&data, "ubx_canlog.log");
    for frames in [&log[..], &log[30..90]] {
        let verdict = on_can(frames);
        assert_named(&verdict, Protocol::CanAerospace, 0.4, "ubx_canlog.log");
        assert_eq!(verdict.findings.len(), 1, "{verdict:?}");
        assert_eq!(verdict.findings[0].frames, 0, "none says anything");
    }
    let verdict = on_can(&candump(&data, "gpsd_nmea2000_20140914.can.log"));
    assert!(verdict.findings.is_empty(), "{verdict:?}");
    assert!(
        verdict.hint.is_some_and(|h| h.contains("NMEA 2000")),
        "{verdict:?}"
    );
}

#[test]
fn both_protocols_of_a_can_bus_are_named_and_random_frames_are_not() {
    let frame = |id: u32, bytes: &[u8]| {
        let mut data = [0; 8];
        data[..bytes.len()].copy_from_slice(bytes);
        CanData {
            id,
            extended: false,
            len: u8::try_from(bytes.len()).expect("eight"),
            data,
        }
    };
    let aerospace = |n: u8| {
        let id = [311, 312, 315, 320, 322, 300][usize::from(n % 6)];
        frame(id, &[1, 2, 0, n / 6, 0x40, 0xA6, 0x66, 0x66])
    };
    let fix = |n: u8| {
        let id = [0x180, 0x181, 0x183, 0x185, 0x18A][usize::from(n % 5)];
        frame(id, &[5, 0, 0, n, 2])
    };
    let one: Vec<_> = (0..60).map(aerospace).collect();
    let other: Vec<_> = (0..60).map(fix).collect();
    for (frames, protocols) in [
        (one.clone(), &[Protocol::CanAerospace][..]),
        (other.clone(), &[Protocol::CanFix]),
        (
            [one, other].concat(),
            &[Protocol::CanAerospace, Protocol::CanFix],
        ),
    ] {
        let verdict = on_can(&frames);
        assert_eq!(verdict.findings.len(), protocols.len(), "{verdict:?}");
        for protocol in protocols {
            assert!(confidence(&verdict, *protocol) > 0.4, "{verdict:?}");
        }
    }
    let mut random = Random(5);
    for _ in 0..50 {
        let frames: Vec<_> = (0..random.below(3000))
            .map(|n| CanData {
                id: u32::try_from(random.below(0x800)).expect("11 bits"),
                extended: n % 5 == 0,
                len: u8::try_from(random.below(9)).expect("8"),
                data: random.next().to_be_bytes(),
            })
            .collect();
        let verdict = on_can(&frames);
        assert!(verdict.findings.is_empty(), "{verdict:?}");
    }
}
