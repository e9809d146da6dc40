//! What board files may say, and how each slip is named.

use super::*;

fn load(text: &str) -> Result<Board, Vec<String>> {
    let file = Path::new("test.toml");
    let mut base = parse(file, BASE).map_err(|f| vec![f.to_string()])?;
    merge(
        &mut base,
        parse(file, text).map_err(|f| vec![f.to_string()])?,
    );
    Board::from_table(file, base).map_err(|fs| fs.iter().map(ToString::to_string).collect())
}

#[test]
fn the_base_board_is_valid() {
    let board = Board::base().expect("boards/base.toml is valid");
    assert_eq!(board.screen.kind, screen::Kind::Auto(Wishes::default()));
    assert!(
        board.sources.is_empty(),
        "the base board listens to nothing"
    );
}

#[test]
fn sources_are_read_with_their_endpoints() {
    let board = load(
        r#"
        [[source]]
        name = "sim"
        protocol = "fgfdm"
        udp = "127.0.0.1:5500"
        allow = ["127.0.0.1"]
        [[source]]
        name = "adahrs"
        protocol = "canaerospace"
        can = "can0"
        [[source]]
        name = "efis"
        protocol = "dynon-skyview"
        serial = "/dev/serial/by-id/usb-Maker_Adapter_7-if00-port0"
        baud = 115200
        [[source]]
        name = "tablet"
        protocol = "gdl90"
        udp = 4000
        "#,
    )
    .expect("valid");
    assert_eq!(board.sources.len(), 4);
    assert_eq!(
        board.sources[1].endpoint,
        Endpoint::Can {
            interface: "can0".into()
        }
    );
    assert_eq!(
        board.sources[2].endpoint,
        Endpoint::Serial {
            path: "/dev/serial/by-id/usb-Maker_Adapter_7-if00-port0".into(),
            baud: 115_200
        }
    );
    assert_eq!(
        board.sources[3].endpoint,
        Endpoint::Udp {
            bind: ([127, 0, 0, 1], 4000).into(),
            allow: vec![]
        },
        "a port alone is one of the loopback address"
    );
}

#[test]
fn one_can_bus_may_carry_two_protocols_but_nothing_is_heard_twice() {
    let two = |first: &str, second: &str| {
        let source = |name, rest| format!("[[source]]\nname = \"{name}\"\n{rest}\n");
        load(&(source("a", first) + &source("b", second)))
    };
    let twice = |one: &str| two(one, one).expect_err("heard twice")[0].clone();
    for (one, key) in [
        ("protocol = \"gdl90\"\nudp = \"127.0.0.1:4000\"", "udp"),
        ("protocol = \"canaerospace\"\ncan = \"can0\"", "can"),
        (
            "protocol = \"nmea\"\nserial = \"/dev/ttyS0\"\nbaud = 9600",
            "serial",
        ),
    ] {
        let problem = twice(one);
        let what = format!("test.toml: source[1].{key}: ");
        assert!(problem.starts_with(&what), "{problem}");
        assert!(problem.contains("is heard by `a` already"), "{problem}");
    }
    let other = two(
        "protocol = \"nmea\"\nserial = \"/dev/ttyS0\"\nbaud = 9600",
        "protocol = \"nmea\"\nserial = \"/dev/ttyS1\"\nbaud = 9600",
    );
    other.expect("two ports");
}

/// Each slip with what its one line must hold.
const SLIPS: &[(&str, &[&str])] = &[
    (
        "[view]\nhfov_rad = 1.0",
        &["test.toml: view.hfov_rad: is an unknown key", "`hfov_deg`"],
    ),
    (
        "[view]\nhfov_deg = \"60 deg\"",
        &["view.hfov_deg: is a text, not a number", "from 2 to 120"],
    ),
    (
        "[view]\nhfov_deg = 400",
        &["view.hfov_deg: 400 is out of range"],
    ),
    (
        "[view]\nhfov_deg = nan",
        &["view.hfov_deg: NaN is out of range"],
    ),
    (
        "[units]\npressure = \"psi\"",
        &["units.pressure: `psi` is unknown", "hPa, inHg"],
    ),
    (
        "[airspeeds]\nvne_kmh = 200",
        &["airspeeds.vne_kmh: is an unknown key", "`vne_kt`"],
    ),
    (
        "[airspeeds]\nvs1_kt = 50\nvno_kt = 40",
        &["airspeeds.vno_kt: 40 kt is less than vs1_kt"],
    ),
    ("colour = 1", &["colour: is an unknown key"]),
    (
        "[screen]\nsize_px = \"big\"",
        &["screen.size_px: `big` is no size"],
    ),
    (
        "[terrain]\nupload_bytes_per_frame = 1000",
        &["terrain.upload_bytes_per_frame: 1000 is out of range"],
    ),
    (
        "[terrain]\ndecode_samples_per_frame = 16383",
        &["terrain.decode_samples_per_frame: 16383 is out of range"],
    ),
    (
        "[terrain]\nresident_mib = 0",
        &["terrain.resident_mib: 0 is out of range"],
    ),
    (
        "[terrain]\nvertices = 128",
        &[
            "terrain.vertices: 128 is not offered",
            "[127, 175, 191, 255, 319, 447]",
        ],
    ),
    (
        "[terrain]\ntarget_px = 0",
        &["terrain.target_px: 0 is out of range", "0.05 to 4"],
    ),
    (
        "[terrain]\ntarget_px = \"fine\"",
        &["terrain.target_px: is a text, not a number"],
    ),
    (
        "[[source]]\nname = \"a\"\nprotocol = \"fgfdm\"",
        &["source[0]: has no endpoint"],
    ),
    (
        "[[source]]\nname = \"a\"\nprotocol = \"smoke\"\nudp = \"127.0.0.1:1\"",
        &[
            "source[0].protocol: `smoke` is unknown",
            "fgfdm, canaerospace",
        ],
    ),
    (
        "[[source]]\nname = \"a\"\nprotocol = \"fgfdm\"\nudp = \"nowhere\"",
        &["source[0].udp: `nowhere` is not understood", "ADDRESS:PORT"],
    ),
    (
        "[[source]]\nname = \"a\"\nprotocol = \"fgfdm\"\ncan = \"can0\"",
        &[
            "source[0].protocol: does not come over can",
            "udp = \"ADDRESS:PORT\"",
        ],
    ),
    (
        "[[source]]\nname = \"a\"\nprotocol = \"canaerospace\"\nserial = \"/dev/ttyS0\"\nbaud = 9600",
        &[
            "source[0].protocol: does not come over serial",
            "can = \"INTERFACE\"",
        ],
    ),
    (
        "[[source]]\nname = \"a\"\nprotocol = \"nmea\"\nserial = \"/dev/ttyS0\"",
        &["source[0].baud: is missing", "9600 or 115200"],
    ),
    (
        "[[source]]\nname = \"a\"\nprotocol = \"nmea\"\nserial = \"/dev/ttyS0\"\nbaud = 0",
        &["source[0].baud: 0 is out of range", "from 50 to 12000000"],
    ),
    (
        "[[source]]\nname = \"a\"\nprotocol = \"nmea\"\nserial = \"/dev/ttyS0\"\nbaud = -9600",
        &["source[0].baud: -9600 is out of range"],
    ),
    (
        "[[source]]\nname = \"a\"\nprotocol = \"nmea\"\nserial = \"/dev/ttyS0\"\nbaud = 9600.5",
        &["source[0].baud: 9600.5 has a fraction"],
    ),
    (
        "[[source]]\nname = \"a\"\nprotocol = \"nmea\"\nserial = \"/dev/ttyS0\"\nbaud = \"fast\"",
        &["source[0].baud: is a text, not a number"],
    ),
    (
        "[[source]]\nname = \"a\"\nprotocol = \"nmea\"\nserial = \"ttyS0\"\nbaud = 9600",
        &["source[0].serial: `ttyS0` is no whole path", "by-id"],
    ),
    (
        "[[source]]\nname = \"a\"\nprotocol = \"fgfdm\"\nudp = 5500\nbaud = 9600",
        &["source[0].baud: is given without serial"],
    ),
    (
        "[[source]]\nname = \"a\"\nprotocol = \"canaerospace\"\ncan = \"can0\"\nallow = [\"10.0.0.7\"]",
        &["source[0].allow: is given without udp"],
    ),
    (
        "[[source]]\nname = \"a\"\nprotocol = \"gdl90\"\nudp = 4000\nserial = \"/dev/ttyS0\"\nbaud = 9600",
        &["source[0].serial: is given beside udp"],
    ),
    (
        "[[source]]\nname = \"a\"\nprotocol = \"fgfdm\"\nudp = 0",
        &["source[0].udp: 0 is no port", "1 to 65535"],
    ),
    (
        "[[source]]\nname = \"a\"\nprotocol = \"fgfdm\"\nudp = \"127.0.0.1:5500\"\nallow = [\"10.0.0.7\"]",
        &[
            "source[0].allow: 10.0.0.7 is never heard on 127.0.0.1:5500",
            "0.0.0.0",
        ],
    ),
    (
        "[[source]]\nname = \"a\"\nprotocol = \"fgfdm\"\nudp = \"0.0.0.0:5500\"\nallow = [\"fe80::1\"]",
        &["source[0].allow: fe80::1 is never heard on 0.0.0.0:5500"],
    ),
    (
        "[[source]]\nname = \"a\"\nprotocol = \"nmea\"\nudp = \"127.0.0.1:1\"\nlayout = \"x.xml\"",
        &["source[0].layout: is for fg-generic only"],
    ),
    (
        "[[source]]\nname = \"a\"\nprotocol = \"fg-generic\"\nudp = \"127.0.0.1:1\"\nlayout = \"no-such.xml\"",
        &["source[0].layout:", "no-such.xml cannot be read"],
    ),
    ("screen = 3", &["screen: is a whole number", "[screen]"]),
    ("[view", &["test.toml:1:"]),
];

#[test]
fn every_slip_is_one_line_that_names_the_key() {
    for (text, expected) in SLIPS {
        let problems = load(text).expect_err(text);
        for part in *expected {
            assert!(
                problems.iter().any(|p| p.contains(part)),
                "{text}: {part} not in {problems:?}"
            );
        }
        for p in problems {
            assert!(!p.contains('\n'), "{p:?} is more than one line");
        }
    }
}

#[test]
fn all_slips_are_found_in_one_go() {
    let problems = load("[view]\nhfov_deg = 0\n[units]\npressure = \"x\"\n[input]\nknobs = 1")
        .expect_err("three");
    assert_eq!(problems.len(), 3, "{problems:?}");
}

#[test]
fn two_sources_of_one_name_are_refused() {
    let one = "[[source]]\nname = \"a\"\nprotocol = \"fgfdm\"\nudp = \"127.0.0.1:1\"\n";
    let problems = load(&one.repeat(2)).expect_err("the same name twice");
    assert!(
        problems[0].contains("`a` is the name of two sources"),
        "{problems:?}"
    );
}
