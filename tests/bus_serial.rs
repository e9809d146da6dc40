//! Serial ports through pseudoterminals: what goes in comes out, ports that vanish are found again, and each refusal says
//! what to do.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

mod bus_support;
mod support;

use bus_support::{ID, Line, has_no_serial_ports, wait_for_frames, wait_until};
use glasswing::app::intake::Intake;
use glasswing::app::sources::listen_serial;
use glasswing::bus::{self, BusError, Endpoint, Link, SourceConfig, SourceHandle, Tally};
use glasswing::proto::Protocol;
use glasswing::signal::{Parameter, Wire};
use glasswing::state::Fusion;
use glasswing::time::Monotonic;
use rustix::termios::{ControlModes, InputModes, LocalModes};
use std::io::{BufRead as _, BufReader};
use std::os::unix::fs::symlink;
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex};

/// What a listener was given, in order, each piece with its time.
type Heard = Arc<Mutex<Vec<(Monotonic, Vec<u8>)>>>;

/// Listens to a port and keeps what comes, each piece counted as a good frame.
fn listen(path: &str, baud: u32) -> Result<(SourceHandle, Heard), BusError> {
    let heard = Heard::default();
    let keep = Arc::clone(&heard);
    let mut tally = Tally::default();
    let config = SourceConfig {
        name: "line".into(),
        id: ID,
        endpoint: Endpoint::Serial {
            path: path.to_owned(),
            baud,
        },
    };
    let decode = move |frame: glasswing::signal::Frame<'_>, _: &mut dyn glasswing::signal::Sink| {
        if let Wire::Stream(bytes) = frame.wire {
            keep.lock()
                .expect("nobody panicked")
                .push((frame.at, bytes.to_vec()));
        }
        tally.good += 1;
        tally
    };
    Ok((bus::spawn(config, Box::new(decode))?, heard))
}

fn bytes(heard: &Heard) -> Vec<u8> {
    let pieces = heard.lock().expect("nobody panicked");
    pieces.iter().flat_map(|(_, b)| b.clone()).collect()
}

#[test]
fn every_byte_comes_through_as_it_is_and_is_stamped_when_it_comes() {
    if has_no_serial_ports() {
        return;
    }
    let line = Line::new();
    let (_source, heard) = listen(&line.path, 115_200).expect("opens");
    // Every value, those included that a terminal would act on, more than one piece of them.
    let sent: Vec<u8> = (0..=255).cycle().take(20_000).collect();
    let before = Monotonic::read();
    for (n, piece) in sent.chunks(1000).enumerate() {
        line.send(piece);
        let so_far = 1000 * (n + 1);
        wait_until("the bytes arrive", || bytes(&heard).len() >= so_far);
    }
    let after = Monotonic::read();
    assert_eq!(bytes(&heard), sent);
    let times: Vec<_> = heard
        .lock()
        .expect("nobody panicked")
        .iter()
        .map(|(at, _)| *at)
        .collect();
    assert!(times.is_sorted(), "in order");
    for at in times {
        let inside = at.since(before).is_some() && after.since(at).is_some();
        assert!(inside, "between sending and looking");
    }
}

#[test]
fn a_port_is_set_to_eight_bits_without_parity_at_any_speed() {
    if has_no_serial_ports() {
        return;
    }
    let line = Line::new();
    for baud in [50, 4800, 9600, 12_345, 38_400, 115_200, 921_600, 3_000_000] {
        let (source, _) = listen(&line.path, baud).expect("a pseudoterminal takes any speed");
        let settings = line.settings();
        assert_eq!(settings.input_speed(), baud);
        assert_eq!(settings.output_speed(), baud);
        let modes = settings.control_modes;
        assert!(modes.contains(ControlModes::CS8 | ControlModes::CREAD | ControlModes::CLOCAL));
        assert!(
            !modes.intersects(ControlModes::PARENB | ControlModes::CSTOPB | ControlModes::CRTSCTS)
        );
        assert!(
            !settings
                .local_modes
                .intersects(LocalModes::ECHO | LocalModes::ICANON)
        );
        assert!(
            !settings
                .input_modes
                .intersects(InputModes::ICRNL | InputModes::IXON)
        );
        drop(source);
    }
}

#[test]
fn what_came_before_a_port_was_opened_is_thrown_away() {
    if has_no_serial_ports() {
        return;
    }
    let line = Line::new();
    // The near end keeps bytes only while somebody has it open.
    let (source, _) = listen(&line.path, 9600).expect("opens");
    drop(source);
    line.send(b"old");
    let (_source, heard) = listen(&line.path, 9600).expect("opens");
    line.send(b"new");
    wait_until("the bytes arrive", || bytes(&heard).len() >= 3);
    assert_eq!(bytes(&heard), b"new");
}

#[test]
fn a_port_that_is_unplugged_is_found_again_under_its_lasting_name() {
    if has_no_serial_ports() {
        return;
    }
    let name = support::scratch_dir("lasting-name").join("usb-Maker_Adapter_7-if00-port0");
    let plug = |line: &Line| {
        let _ = std::fs::remove_file(&name);
        symlink(&line.path, &name).expect("linked");
    };
    let first = Line::new();
    plug(&first);
    let path = name.to_str().expect("a name in UTF-8");
    let (source, heard) = listen(path, 115_200).expect("opens");
    let figures = || source.thread.figures().snapshot();
    first.send(b"one");
    wait_until("the bytes arrive", || bytes(&heard) == b"one");
    assert_eq!(figures().link, Link::Open);

    // Another line takes the number, or another number: nothing but the name stays.
    drop(first);
    wait_until("the loss is noticed", || figures().link == Link::Closed);
    let second = Line::new();
    plug(&second);
    wait_until("it is opened again", || figures().link == Link::Open);
    second.send(b"two");
    wait_until("the bytes arrive", || bytes(&heard) == b"onetwo");
    assert_eq!(figures().reopened, 1);
    assert!(figures().faults >= 1, "the loss was counted");

    // The name itself goes away for a while, as udev removes it.
    drop(second);
    std::fs::remove_file(&name).expect("removed");
    wait_until("the loss is noticed", || figures().link == Link::Closed);
    let third = Line::new();
    plug(&third);
    wait_until("it is opened again", || figures().reopened == 2);
    third.send(b"three");
    wait_until("the bytes arrive", || bytes(&heard) == b"onetwothree");
}

#[test]
fn a_frame_does_not_go_on_after_an_interruption() {
    if has_no_serial_ports() {
        return;
    }
    // Roll 10, pitch 5, without a checksum, as Stratux sends it; the second half belongs to another one.
    let halves = ["$RPYL,100,5", "0,1234,0,30,1000,0\r\n"];
    let name = support::scratch_dir("interruption").join("port");
    let first = Line::new();
    symlink(&first.path, &name).expect("linked");
    let path = name.to_str().expect("a name in UTF-8");
    let mut source = listen_serial("stratux", ID, Protocol::Nmea, path, 38_400).expect("opens");
    let figures = Arc::clone(source.thread.figures());
    first.send(halves[0].as_bytes());
    // The half is no frame, so that nothing tells when it has been read: that it was takes a moment, no more.
    std::thread::park_timeout(std::time::Duration::from_millis(200));
    drop(first);
    wait_until("the loss is noticed", || figures.link() == Link::Closed);
    let second = Line::new();
    std::fs::remove_file(&name).expect("removed");
    symlink(&second.path, &name).expect("linked");
    wait_until("it is opened again", || figures.link() == Link::Open);
    second.send(halves[1].as_bytes());
    second.send(b"$PGRMZ,2500,f,3*2C\r\n");
    wait_until("a whole sentence is heard", || figures.snapshot().good > 0);
    assert_eq!(figures.snapshot().good, 1, "{:?}", figures.snapshot());
    let said = source.signals.pop().expect("said");
    assert_eq!(said.parameter, Parameter::PressureAltitude);
    assert!(source.signals.pop().is_err(), "nothing else was said");
}

#[test]
fn a_stopped_listener_lets_its_port_go() {
    if has_no_serial_ports() {
        return;
    }
    let line = Line::new();
    let (mut source, _) = listen(&line.path, 9600).expect("opens");
    source.thread.stop();
    listen(&line.path, 9600).expect("opens again");
}

#[test]
fn a_port_that_is_ours_already_is_held() {
    if has_no_serial_ports() {
        return;
    }
    let line = Line::new();
    let (_source, _) = listen(&line.path, 9600).expect("opens");
    let error = listen(&line.path, 9600).expect_err("held");
    assert!(matches!(error, BusError::SerialHeld { .. }), "{error:?}");
}

#[test]
fn a_program_that_has_the_port_is_named() {
    if has_no_serial_ports() {
        return;
    }
    let line = Line::new();
    let mut other = Command::new("sh")
        .args([
            "-c",
            "exec 3<\"$1\"; echo open; read wait",
            "sh",
            &line.path,
        ])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("starts");
    let stdout = other.stdout.take().expect("piped");
    let mut said = String::new();
    BufReader::new(stdout).read_line(&mut said).expect("said");
    assert_eq!(said, "open\n");
    let text = listen(&line.path, 9600).expect_err("held").to_string();
    drop(other.stdin.take());
    other.wait().expect("ended");
    assert!(
        text.contains(&format!("serial {}: another program has it: ", line.path)),
        "{text}"
    );
    assert!(
        text.contains(&format!("(process {})", other.id())),
        "{text}"
    );
    assert!(!text.contains('\n'), "one line: {text}");
    listen(&line.path, 9600).expect("opens once the other has ended");
}

#[test]
fn what_is_no_serial_port_is_named() {
    if has_no_serial_ports() {
        return;
    }
    let file = support::scratch_dir("no-serial-port").join("file");
    std::fs::write(&file, "text").expect("written");
    for path in ["/dev/null", "/tmp", file.to_str().expect("UTF-8")] {
        let error = listen(path, 9600).expect_err("no port");
        assert!(
            matches!(error, BusError::NotSerial { .. }),
            "{path}: {error:?}"
        );
    }
    for path in ["/dev/ttyNONE", "/dev/serial/by-id/usb-none", "/dev/null/x"] {
        let error = listen(path, 9600).expect_err("no port");
        assert!(
            matches!(error, BusError::SerialMissing { .. }),
            "{path}: {error:?}"
        );
        let text = error.to_string();
        assert!(
            text.starts_with(&format!("serial {path}: there is no such port (")),
            "{text}"
        );
        assert!(text.contains("glasswing list"), "{text}");
    }
}

#[test]
fn a_stream_becomes_a_state_however_it_is_cut() {
    if has_no_serial_ports() {
        return;
    }
    let line = Line::new();
    let source = listen_serial("stratux", ID, Protocol::Gdl90, &line.path, 115_200).expect("opens");
    let mut intake = Intake::new([source.signals], Fusion::new(&[ID]));
    // ForeFlight attitude: roll 10, pitch 5 (its layout and checksum by the ICD's own table).
    let message = [
        0x7E, 0x65, 0x01, 0x00, 0x64, 0x00, 0x32, 0x84, 0xD2, 0x00, 0x5F, 0x00, 0x65, 0xB7, 0xEF,
        0x7E,
    ];
    for cut in 0..message.len() {
        let (one, two) = message.split_at(cut);
        let heard = source.thread.figures().snapshot().good;
        for piece in [one, two] {
            if !piece.is_empty() {
                line.send(piece);
                // Time for the first piece to be taken alone; if it is not, the cut is elsewhere, no more.
                std::thread::park_timeout(std::time::Duration::from_millis(2));
            }
        }
        wait_for_frames(&source.thread, heard + 1);
    }
    let now = Monotonic::read();
    let state = intake.step(now);
    let roll = state.read(Parameter::Roll, now).expect("fresh");
    let pitch = state.read(Parameter::Pitch, now).expect("fresh");
    assert!((roll - 10_f64.to_radians()).abs() < 1e-9, "{roll}");
    assert!((pitch - 5_f64.to_radians()).abs() < 1e-9, "{pitch}");
    let figures = source.thread.figures().snapshot();
    assert_eq!((figures.good, figures.bad), (message.len() as u64, 0));
}
