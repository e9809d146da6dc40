//! Serial ports, on real pseudo-terminals: heard, unplugged and back, held, missing, and what is no port at all.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

mod support;

use glasswing::app::sources::listen_serial;
use glasswing::bus::SourceFigures;
use glasswing::proto::Protocol;
use glasswing::signal::{Parameter, SourceId};
use glasswing::time::Monotonic;
use serialport::{SerialPort as _, TTYPort};
use std::io::Write as _;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::time::Duration;

const ID: SourceId = SourceId(4);
const BAUD: u32 = 115_200;
const LINE: &str = "=1112345678+052-01232710955+03500-031+02+1025-020+15242B1\r\n";

/// A cable: what is written to its far end is heard at the port that `link` names.
fn plug_in(link: &Path) -> TTYPort {
    let (far, near) = TTYPort::pair().expect("a pseudo-terminal");
    let name = near.name().expect("a name");
    drop(near);
    let _ = std::fs::remove_file(link);
    symlink(name, link).expect("linked");
    far
}

fn link(name: &str) -> PathBuf {
    support::scratch_dir(name).join("port")
}

/// Waits until the figures say so; ten seconds are for a machine that does much else.
#[track_caller]
fn wait(figures: &SourceFigures, what: &str, done: impl Fn(&glasswing::bus::Figures) -> bool) {
    let start = Monotonic::read();
    while !done(&figures.snapshot()) {
        assert!(
            Monotonic::read().since(start) < Some(Duration::from_secs(10)),
            "{what}: {:?}",
            figures.snapshot()
        );
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn a_port_is_heard_unplugged_and_heard_again() {
    let link = link("serial-replug");
    let mut far = plug_in(&link);
    let device = link.to_string_lossy();
    let mut source = listen_serial("efis", ID, Protocol::GarminG3x, &device, BAUD).expect("opens");
    let figures = source.thread.figures().clone();
    // In two pieces, with half a line of another sentence before.
    let (a, b) = LINE.split_at(20);
    for piece in [&LINE[30..], a, b] {
        far.write_all(piece.as_bytes()).expect("sent");
        far.flush().expect("sent");
    }
    wait(&figures, "a line", |f| f.good == 1 && f.bad == 1);
    let mut pitch = None;
    while let Ok(signal) = source.signals.pop() {
        assert_eq!(signal.source, ID);
        if signal.parameter == Parameter::Pitch {
            pitch = signal.value.ok();
        }
    }
    assert!(
        pitch.is_some_and(|p| (p - 5.2_f64.to_radians()).abs() < 1e-12),
        "{pitch:?}"
    );

    drop(far);
    wait(&figures, "unplugged", |f| f.faults >= 1);
    let mut far = plug_in(&link);
    wait(&figures, "plugged in again", |f| f.reopened >= 1);
    far.write_all(LINE.as_bytes()).expect("sent");
    wait(&figures, "a line again", |f| f.good == 2);
    source.thread.stop();
}

#[test]
fn what_cannot_be_opened_says_why_in_one_line() {
    let link = link("serial-refused");
    let _far = plug_in(&link);
    let device = link.to_string_lossy();
    let listen = |device: &str| listen_serial("efis", ID, Protocol::Nmea, device, BAUD);
    let held = listen(&device).expect("opens");
    let file = link.with_file_name("file");
    std::fs::write(&file, "text").expect("written");
    for (device, why) in [
        (&*device, "another program holds it (stop it, `fuser "),
        (
            "/dev/no-such-port",
            "there is no such port (connect the adapter",
        ),
        (
            &file.to_string_lossy(),
            "it is no serial port (connect the adapter",
        ),
    ] {
        let text = listen(device).expect_err("refused").to_string();
        assert_eq!(text.lines().count(), 1, "{text}");
        assert!(text.starts_with(&format!("serial {device}: ")), "{text}");
        assert!(text.contains(why), "{text}");
    }
    drop(held);
    drop(listen(&device).expect("free again"));
}
