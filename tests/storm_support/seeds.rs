//! Whole frames to begin with, one of every kind that is read. Checksums are made right by `rules`.

use super::rules;
use glasswing::proto::Protocol;

/// Frames of a protocol that is not on CAN.
pub(crate) fn seeds(protocol: Protocol) -> Vec<Vec<u8>> {
    let mut seeds = match protocol {
        Protocol::FgFdm => vec![fgfdm(24, 408), fgfdm(25, 552)],
        Protocol::Gdl90 => gdl90(),
        Protocol::Ubx => vec![ubx(92), ubx(84), ubx_of(1, 2, 28), ubx_of(10, 4, 0)],
        Protocol::Mgl => mgl(),
        Protocol::Nmea => nmea(),
        Protocol::DynonSkyView => texts(&[
            "!1112345600+052-01232710955+03500-031+02+1025-020+151001+00+039002401200",
            &format!("!11{:-<8}{:X<59}00", "", ""),
            &system_line(),
            &engine_line("!32", 223),
        ]),
        Protocol::GarminG3x => texts(&[
            "=1112345678+052-01232710955+03500-031+02+1025-020+1524200",
            &format!("=11{}00", "_".repeat(52)),
            &engine_line("=31", 219),
            "=21123456781001+03900271+035000955-02000",
            "=7112345678012095500",
        ]),
        Protocol::DynonD100 => texts(&[
            "00082119+058-00541301200+9141+011-01+15003EA0C70100",
            "00082120+058-00541301200+9141+011-01+15003EA0C60100",
        ]),
        Protocol::FgGeneric => generic(),
        Protocol::CanFix | Protocol::CanAerospace => Vec::new(),
    };
    let seal = rules(protocol).seal;
    for seed in &mut seeds {
        seal(seed);
    }
    seeds
}

fn texts(lines: &[&str]) -> Vec<Vec<u8>> {
    lines
        .iter()
        .map(|line| format!("{line}\r\n").into_bytes())
        .collect()
}

fn system_line() -> String {
    let head = "!2212345600271+012009550-010271101050+10-05";
    format!("{head:X<89}00")
}

fn engine_line(kind: &str, length: usize) -> String {
    let head = format!("{kind}12345600060+0952400XXXX245095000043120115234135143");
    let width = length - 2;
    format!("{head:0<width$}00")
}

fn generic() -> Vec<Vec<u8>> {
    let line = "47.500000000,-122.300000000,3500.00000,1200.0,12.3,-5.2,271.0,255.0,268.5,3.1,-0.4,101.5,95.5,\
                100.1,3480.0,3500.0,1018.0,-200.0,1.02,0.5,12.5,12.0,240.0,15.5,2400,24.5,9.5,60.0,190.0,380.0,1350.0,\
                12.1,13.4\n";
    vec![line.into(), line.replace("-5.2", "nan").into()]
}

fn sentence(body: &str) -> Vec<u8> {
    format!("${body}*00\r\n").into()
}

fn nmea() -> Vec<Vec<u8>> {
    [
        "GPRMC,131523,A,6359.1024,N,02239.2939,W,98.3,70.0,221126,9.8,W,A",
        "GPGGA,131523,6359.1024,N,02239.2939,W,1,08,0.9,914.5,M,0.0,M,,",
        "GNVTG,70.0,T,79.8,M,98.3,N,182.0,K,A",
        "GNGSA,A,3,01,02,03,04,,,,,,,,,1.8,0.9,1.5",
        "PGRMZ,3500,f,3",
        "PLXVF,1.0,0.1,0.2,1.0,1.5,49.1,1067.5",
        "LXWP0,Y,119.4,1717.6,0.02,0.02,0.02,0.02,0.02,0.02,239,174,10.1",
        "PFLAA,0,-1540,-1020,-1126,1,39103C!FJLKN,93,0,33,4.9,8",
        "PFLAU,3,1,2,1,2,-30,2,-32,755,1A2B3C",
        "RPYL,123,-52,2710,0,31,1020,0",
        "PXCV,1.5,0.5,0,1.00,1,12.5,1018.0,950.0,600.0,12.5,-3.0,0.0,0.0,1.0",
    ]
    .into_iter()
    .map(sentence)
    .collect()
}

fn gdl90() -> Vec<Vec<u8>> {
    let mut identity = vec![0; 39];
    (identity[0], identity[38]) = (0x65, 1);
    let mut messages: Vec<Vec<u8>> = vec![
        vec![0x00, 0x81, 0x41, 0xDB, 0xD0, 0x08, 0x02],
        vec![0x65, 1, 0, 0x64, 0, 0x32, 0x84, 0xD2, 0, 0x5F, 0, 0x65],
        vec![0x65, 1, 0, 0x7E, 0, 0x7D, 0x04, 0xD2, 0, 0x5F, 0, 0x65],
        vec![
            0x4C, 0x45, 1, 1, 0, 0x64, 0, 0x32, 4, 0xD2, 0, 0, 0, 0x1E, 0, 0x0A, 0, 0x60, 0x1D,
            0x4C, 1, 0, 0x7F, 0xFF,
        ],
        vec![0x0B, 0x01, 0xF4, 0x00, 0x0A],
        vec![
            0x0A, 0x00, 0xAB, 0xCD, 0xEF, 0x21, 0xC7, 0x1C, 0xA9, 0x07, 0xF7, 0x08, 0xC9, 0x88,
            0x05, 0xF0, 0x04, 0x58, 0x01, 0x4E, 0x31, 0x32, 0x33, 0x34, 0x35, 0x20, 0x20, 0x00,
        ],
        identity,
    ];
    for kind in [2, 3] {
        let mut ownship = messages[5].clone();
        ownship[12] = ownship[12] & 0xFC | kind;
        messages.push(ownship);
    }
    let mut traffic = messages[5].clone();
    traffic[0] = 0x14;
    messages.push(traffic);
    let frame = |mut message: Vec<u8>| {
        message.insert(0, 0x7E);
        message.extend([0, 0, 0x7E]);
        // Escapes, before the checksum is made.
        let inner = message[1..message.len() - 1].to_vec();
        let mut frame = vec![0x7E];
        for b in inner {
            match b {
                0x7D | 0x7E => frame.extend([0x7D, b ^ 0x20]),
                b => frame.push(b),
            }
        }
        frame.push(0x7E);
        frame
    };
    messages.into_iter().map(frame).collect()
}

/// A UBX frame of class and id with so long a payload.
fn ubx_of(class: u8, id: u8, payload: u8) -> Vec<u8> {
    let mut frame = vec![0xB5, 0x62, class, id, payload, 0];
    frame.extend((0..payload).map(|n| n.wrapping_mul(29)));
    frame.extend([0, 0]);
    frame
}

fn ubx(payload: u8) -> Vec<u8> {
    let mut frame = ubx_of(1, 7, payload);
    let p = &mut frame[6..];
    p[..12].copy_from_slice(&[0, 0, 0, 0, 0xEA, 0x07, 11, 22, 19, 8, 7, 0x0F]);
    p[16..24].copy_from_slice(&[0, 0, 0, 0, 3, 1, 0, 14]);
    for (at, value) in [
        (24, -1_223_000_000_i32),
        (28, 475_000_000),
        (32, 762_000),
        (36, 780_500),
        (40, 1500),
        (44, 2500),
        (56, -1300),
        (60, 50_000),
        (64, 5_313_000),
    ] {
        p[at..at + 4].copy_from_slice(&value.to_le_bytes());
    }
    p[78] = 0;
    frame
}

fn mgl_of(kind: u8, payload: usize) -> Vec<u8> {
    let length = u8::try_from(payload - 8).unwrap_or(0);
    let mut frame = vec![5, 2, length, !length, kind, 1, 1, 1];
    frame.resize(8 + payload + 4, 0);
    frame
}

fn mgl() -> Vec<Vec<u8>> {
    let mut primary = mgl_of(1, 32);
    primary[8..18].copy_from_slice(&[0xAC, 0x0D, 0, 0, 0x98, 0x0D, 0, 0, 0xD3, 0x06]);
    primary[24..30].copy_from_slice(&[0x10, 0x27, 0xC4, 0x27, 15, 0]);
    let mut gps = mgl_of(2, 44);
    gps[8..12].copy_from_slice(&8_550_000_i32.to_le_bytes());
    gps[12..16].copy_from_slice(&(-22_014_000_i32).to_le_bytes());
    gps[42] = 3;
    let mut attitude = mgl_of(3, 28);
    attitude[8..18].copy_from_slice(&[0x96, 0x0A, 0x34, 0, 0x85, 0xFF, 0x96, 0x0A, 0xE1, 0xFF]);
    vec![primary, gps, attitude, mgl_of(10, 60), mgl_of(30, 264)]
}

/// A packet of an ordinary moment of flight, by the offsets of `net_fdm.hxx`.
fn fgfdm(version: u8, length: usize) -> Vec<u8> {
    let mut packet = vec![0; length];
    packet[3] = version;
    for (at, value) in [(8, 0.25_f64), (16, 0.875), (24, 1500.0)] {
        packet[at..at + 8].copy_from_slice(&value.to_be_bytes());
    }
    for (at, value) in [
        (36, -0.25_f32),
        (40, 0.125),
        (44, 4.5),
        (48, 0.0625),
        (52, -0.031_25),
        (56, 0.5),
        (68, 100.0),
        (72, 10.0),
        (76, -30.0),
        (80, -40.0),
        (108, -32.174),
        (140, 2300.0),
    ] {
        packet[at..at + 4].copy_from_slice(&value.to_be_bytes());
    }
    packet[123] = 1;
    packet
}
