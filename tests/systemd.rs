//! The unit file and the udev rules agree with the program they are for.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

mod support;

use std::time::Duration;

fn read(name: &str) -> String {
    std::fs::read_to_string(support::source_dir().join("systemd").join(name))
        .expect("a readable file")
}

/// The values of a key in a section of the unit, in order.
fn values(section: &str, key: &str) -> Vec<String> {
    let mut current = String::new();
    let mut found = Vec::new();
    for line in read("glasswing.service").lines().map(str::trim) {
        if let Some(name) = line.strip_prefix('[').and_then(|l| l.strip_suffix(']')) {
            current = name.to_owned();
        } else if let Some((name, value)) = line.split_once('=')
            && current == section
            && name == key
        {
            found.push(value.to_owned());
        }
    }
    found
}

fn value(section: &str, key: &str) -> String {
    let found = values(section, key);
    assert_eq!(found.len(), 1, "{key} stands once in [{section}]");
    found[0].clone()
}

#[test]
fn every_line_of_the_unit_is_a_comment_a_section_or_a_setting() {
    for line in read("glasswing.service").lines().map(str::trim) {
        let setting = line
            .split_once('=')
            .is_some_and(|(key, _)| key.chars().all(char::is_alphanumeric));
        let section = ["[Unit]", "[Service]", "[Install]"].contains(&line);
        assert!(
            line.is_empty() || line.starts_with('#') || section || setting,
            "not understood: {line}"
        );
    }
}

#[test]
fn the_watchdog_outlasts_twice_the_longest_healthy_silence() {
    let watchdog = Duration::from_secs(
        value("Service", "WatchdogSec")
            .parse()
            .expect("whole seconds"),
    );
    assert!(
        watchdog > 2 * glasswing::app::health::FLIP_AGE_MAX,
        "a slow mode change would be taken for a freeze"
    );
    assert_eq!(
        value("Service", "Type"),
        "notify",
        "the watchdog needs a service that notifies"
    );
}

#[test]
fn it_comes_back_whatever_happens_but_not_from_a_wrong_board_file() {
    assert_eq!(value("Service", "Restart"), "always");
    assert_eq!(value("Unit", "StartLimitIntervalSec"), "0");
    assert_eq!(value("Service", "RestartPreventExitStatus"), "2");
}

#[test]
fn what_it_starts_is_a_command_of_the_program() {
    let start = value("Service", "ExecStart");
    let words: Vec<&str> = start.split_whitespace().collect();
    assert_eq!(
        words,
        [
            "/usr/bin/glasswing",
            "run",
            "--board",
            "/etc/glasswing/board.toml"
        ]
    );
    let help = support::glasswing_command()
        .args(["run", "--help"])
        .output()
        .expect("the program starts");
    let text = String::from_utf8_lossy(&help.stdout);
    assert!(
        help.status.success() && text.contains("--board"),
        "run --help says: {text}"
    );
}

#[test]
fn it_may_use_the_devices_that_the_rules_give_to_its_groups() {
    let groups = value("Service", "SupplementaryGroups");
    let groups: Vec<&str> = groups.split_whitespace().collect();
    let rules = read("glasswing.rules");
    let given: Vec<&str> = rules
        .split("GROUP=\"")
        .skip(1)
        .filter_map(|rest| rest.split('"').next())
        .collect();
    assert!(
        given.len() >= 4,
        "cards, render nodes, input and serial ports are given to groups"
    );
    for group in given {
        assert!(
            groups.contains(&group),
            "the service is not in group {group}"
        );
    }
    assert_eq!(
        value("Service", "User"),
        "glasswing",
        "it does not run as root"
    );
    let families = value("Service", "RestrictAddressFamilies");
    assert!(
        families.contains("AF_CAN") && families.contains("AF_INET"),
        "its buses are CAN and UDP"
    );
}
