//! Sources that refuse, as the user meets them: `check` names every one of them at once, with file, key and remedy.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

mod bus_support;
mod support;

use bus_support::{Line, has_no_serial_ports};
use rustix::fs::{FlockOperation, flock};
use std::fs::{File, Permissions};
use std::net::{Ipv4Addr, UdpSocket};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A board file of its own folder, headless, with these sources.
fn board(folder: &str, sources: &str) -> PathBuf {
    let file = support::scratch_dir(folder).join("cockpit.toml");
    let text = format!("inherit = \"base\"\n[screen]\nkind = \"surfaceless\"\n{sources}");
    std::fs::write(&file, text).expect("written");
    file
}

/// What was said on standard error in lines that begin as messages do, without the causes below them.
fn messages(output: &Output) -> Vec<String> {
    let text = String::from_utf8_lossy(&output.stderr);
    let lines = text.lines().filter_map(|l| l.strip_prefix("glasswing: "));
    lines.map(str::to_owned).collect()
}

fn check(file: &Path) -> Output {
    let mut command = support::glasswing_command();
    command.arg("check").arg("--board").arg(file);
    command.output().expect("the program starts")
}

#[test]
fn check_names_every_source_that_refuses_with_its_key() {
    if has_no_serial_ports() {
        return;
    }
    let udp = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket");
    let address = udp.local_addr().expect("an address");
    let line = Line::new();
    let port = File::open(&line.path).expect("opens");
    flock(&port, FlockOperation::NonBlockingLockExclusive).expect("locked");
    let sources = format!(
        "[[source]]\nname = \"sim\"\nprotocol = \"fgfdm\"\nudp = \"{address}\"\n\
         [[source]]\nname = \"efis\"\nprotocol = \"dynon-skyview\"\nserial = \"{}\"\nbaud = 115200\n\
         [[source]]\nname = \"gps\"\nprotocol = \"nmea\"\nserial = \"/dev/ttyNONE\"\nbaud = 4800\n\
         [[source]]\nname = \"adahrs\"\nprotocol = \"canaerospace\"\ncan = \"nosuchcan7\"\n",
        line.path
    );
    let file = board("refusals", &sources);
    let output = check(&file);
    let said = messages(&output);
    assert_eq!(output.status.code(), Some(4), "{said:?}");
    let file = file.display();
    let path = &line.path;
    let expected = [
        format!("{file}: source[0].udp: udp {address}: another program listens on port "),
        format!("{file}: source[1].serial: serial {path}: another program has it"),
        format!("{file}: source[2].serial: serial /dev/ttyNONE: there is no such port ("),
        format!("{file}: source[3].can: can nosuchcan7: "),
    ];
    assert_eq!(said.len(), expected.len(), "one line each: {said:?}");
    for (line, beginning) in said.iter().zip(expected) {
        assert!(line.starts_with(&beginning), "{line}\n{beginning}");
        assert!(line.ends_with(')'), "says what to do: {line}");
    }
}

#[test]
fn check_hears_a_serial_port_that_is_there() {
    if has_no_serial_ports() {
        return;
    }
    let line = Line::new();
    let sources = format!(
        "[[source]]\nname = \"efis\"\nprotocol = \"dynon-skyview\"\nserial = \"{}\"\nbaud = 115200\n",
        line.path
    );
    let output = check(&board("heard", &sources));
    let said = String::from_utf8_lossy(&output.stdout);
    let expected = format!(
        "source efis: dynon-skyview on serial {} at 115200 baud can be heard\n",
        line.path
    );
    assert!(said.contains(&expected), "{said}");
    assert_eq!(output.status.code(), Some(0), "{:?}", messages(&output));
}

/// Root may do everything, so the program is started as somebody who may not.
#[test]
fn a_user_without_permission_is_told_which_group_has_it() {
    let program = Path::new(env!("CARGO_BIN_EXE_glasswing"));
    let as_nobody = |words: &[&str]| {
        let nobody = ["--reuid=65534", "--regid=65534", "--clear-groups"];
        let mut command = Command::new("setpriv");
        command.args(nobody).args(words).output()
    };
    let line = Line::new();
    let sources = format!(
        "[[source]]\nname = \"efis\"\nprotocol = \"dynon-skyview\"\nserial = \"{}\"\nbaud = 115200\n",
        line.path
    );
    let file = board("permission", &sources);
    let program = program.to_str().expect("UTF-8");
    let runs = as_nobody(&[program, "--version"]).is_ok_and(|o| o.status.success());
    if support::is_emulated() || !runs {
        support::skip("the program cannot be started as another user here (it takes root)");
        return;
    }
    // As a serial port of Debian is: its group may, others may not.
    let as_udev = |mode: u32, group: Option<u32>| {
        std::os::unix::fs::chown(&line.path, None, group).expect("given");
        let permissions = Permissions::from_mode(mode);
        std::fs::set_permissions(&line.path, permissions).expect("set");
    };
    let dialout = std::fs::read_to_string("/etc/group")
        .expect("groups")
        .lines()
        .find_map(|l| {
            l.strip_prefix("dialout:x:")?
                .split(':')
                .next()?
                .parse()
                .ok()
        });
    let file = file.to_str().expect("UTF-8");
    let refused = |mode, group| {
        as_udev(mode, group);
        let output = as_nobody(&[program, "check", "--board", file]).expect("starts");
        let said = messages(&output);
        assert_eq!(output.status.code(), Some(4), "{said:?}");
        said.into_iter()
            .find(|l| l.contains("source[0].serial: "))
            .expect("a line of its own")
    };
    if let Some(dialout) = dialout {
        let said = refused(0o660, Some(dialout));
        assert!(said.contains("this program may not use it"), "{said}");
        assert!(said.contains("add the user to the group dialout"), "{said}");
    }
    let said = refused(0o600, Some(0));
    assert!(said.contains("udev rule"), "nobody's group has it: {said}");
}
