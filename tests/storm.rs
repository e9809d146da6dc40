//! Storms: random and damaged frames by the hundred thousand before every decoder, and before an independent judge
//! (`storm_support`). Ten million for each protocol with `GLASSWING_STORM=10000000`, as `./dev storm` does.
#![expect(
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "a helper that fails is a test that fails, and a storm says how it went"
)]
#![expect(
    clippy::ptr_arg,
    reason = "what seals a frame is one type, and one kind of frame grows by it"
)]

mod storm_support;
mod support;

use glasswing::proto::{Carriage, Protocol};
use glasswing::signal::CanData;
use glasswing::time::Monotonic;
use storm_support::random::Random;
use storm_support::seeds::seeds;
use storm_support::{Trial, can, rules};

/// What a storm has when nothing else is asked for: about a second in a development build.
const FRAMES: usize = 100_000;

/// How many frames the storm of each protocol has.
fn frames() -> usize {
    match std::env::var("GLASSWING_STORM") {
        Ok(count) => count
            .parse()
            .expect("GLASSWING_STORM is a number of frames"),
        Err(_) if support::is_emulated() => FRAMES / 20,
        Err(_) => FRAMES,
    }
}

/// What a piece of a stream is made of.
struct Weather {
    random: Random,
    seeds: Vec<Vec<u8>>,
    others: Vec<Vec<u8>>,
    seal: fn(&mut Vec<u8>),
    longest: usize,
}

impl Weather {
    fn new(protocol: Protocol, random: Random) -> Self {
        let others = Protocol::ALL.into_iter().filter(|other| *other != protocol);
        let seeds = seeds(protocol);
        Self {
            random,
            longest: seeds.iter().map(Vec::len).max().unwrap_or(64),
            seeds,
            others: others.flat_map(storm_support::seeds::seeds).collect(),
            seal: rules(protocol).seal,
        }
    }

    /// One frame, whole, damaged, tampered with under a right checksum, foreign, or noise.
    fn frame(&mut self, kind: usize) -> Vec<u8> {
        let random = &mut self.random;
        let mut frame = random.of(&self.seeds).clone();
        match kind {
            0 => {}
            1 | 2 => random.damage(&mut frame),
            3 => {
                random.damage(&mut frame);
                (self.seal)(&mut frame);
            }
            4 | 5 => {
                random.tamper(&mut frame);
                (self.seal)(&mut frame);
            }
            6 => frame = random.of(&self.others).clone(),
            _ => {
                frame = (0..random.below(self.longest))
                    .map(|_| random.byte())
                    .collect();
            }
        }
        frame
    }

    /// What comes at once: mostly a frame, sometimes several, one cut off by the next or doubled.
    fn gust(&mut self, bytes: &mut Vec<u8>) {
        bytes.clear();
        let kind = self.random.below(8);
        let frame = self.frame(kind);
        let pattern = self.random.below(16);
        match pattern {
            0 => {
                let cut = self.random.below(frame.len() + 1);
                bytes.extend(&frame[..cut]);
                let kind = self.random.below(8);
                bytes.extend(self.frame(kind));
            }
            1 => bytes.extend(frame.iter().chain(&frame)),
            2 => {
                bytes.extend(&frame);
                let kind = self.random.below(8);
                bytes.extend(self.frame(kind));
            }
            3 => {
                let cut = self.random.below(frame.len() + 1);
                bytes.extend(&frame[cut..]);
            }
            _ => bytes.extend(&frame),
        }
    }
}

/// Numbers for a seed that differs from run to run of `./dev storm`, if it says so.
fn random(protocol: Protocol) -> Random {
    let seed = std::env::var("GLASSWING_STORM_SEED").ok();
    let seed: u64 = seed.map_or(0, |s| s.parse().expect("GLASSWING_STORM_SEED is a number"));
    let mut random = Random(0x9E37_79B9_7F4A_7C15 ^ ((seed + 1) << 8) ^ protocol as u64);
    random.next();
    random
}

fn stream_storm(protocol: Protocol) {
    let began = Monotonic::read();
    let mut trial = Trial::new(protocol);
    let mut weather = Weather::new(protocol, random(protocol));
    let mut cuts = Random(77);
    let mut bytes = Vec::new();
    let count = frames();
    for n in 0..count {
        weather.gust(&mut bytes);
        let style = cuts.below(4);
        let cut = |left: usize| match style {
            0 => 1,
            1 => 1 + cuts.below(8),
            2 => 1 + cuts.below(left),
            _ => 64,
        };
        if protocol.carriage() == Carriage::Stream && bytes.is_empty() {
            continue;
        }
        trial.bytes(n as u64 * 1_000_000, &bytes, cut);
    }
    trial.finish();
    end(protocol, count, &trial, began);
}

fn can_storm(protocol: Protocol) {
    let began = Monotonic::read();
    let mut trial = Trial::new(protocol);
    let mut random = random(protocol);
    let ids = can::ids(protocol == Protocol::CanFix);
    let types = [2, 2, 2, 2, 2, 2, 3, 4, 6, 7, 9, 10, 30, 31, 0, 1, 12, 40];
    let count = frames();
    for n in 0..count {
        let mut data = random.next().to_be_bytes();
        let kind = random.below(16);
        if kind > 2 && protocol == Protocol::CanFix {
            (data[1], data[2]) = ((data[1] % 4) & data[0], data[2] & 0x16 & data[3]);
            data[0] = if data[0].is_multiple_of(4) { 7 } else { 5 };
        } else if kind > 2 {
            (data[0], data[1], data[2]) = (1 + data[0] % 2, *random.of(&types), 0);
            data[3] = u8::try_from(n % 256).expect("a byte");
        }
        if kind > 6 {
            // Numbers of ordinary size.
            let float = f32::from(i16::from_be_bytes([data[4], data[5]])) / 100.0;
            if protocol == Protocol::CanAerospace {
                data[4..].copy_from_slice(&float.to_be_bytes());
            } else {
                let [_, _, _, _, _, low, high, _] = data;
                data[3..7].copy_from_slice(&[low, high % 16, 0, 0]);
            }
        }
        let is_foreign = kind == 0;
        let mut id = *random.of(&ids);
        if is_foreign {
            id = u32::try_from(random.next() >> 35).expect("29 bits");
        }
        let extended = is_foreign && id > 0x7FF || random.below(16) == 0;
        let usual = if protocol == Protocol::CanAerospace {
            8
        } else {
            *random.of(&[5, 5, 5, 7, 7, 8])
        };
        let len = if kind == 1 {
            u8::try_from(random.below(9)).expect("8")
        } else {
            usual
        };
        data[usize::from(len)..].fill(0);
        // Times, as they pass on a bus, and now and then a silence.
        let ns = n as u64 * 200_000 + (n as u64 / 5000) * 3_000_000_000;
        trial.can(
            ns,
            CanData {
                id,
                extended,
                len,
                data,
            },
        );
    }
    assert_eq!(trial.counters().total(), count as u64, "each counted once");
    end(protocol, count, &trial, began);
}

fn end(protocol: Protocol, count: usize, trial: &Trial, began: Monotonic) {
    let seconds = Monotonic::read()
        .since(began)
        .unwrap_or_default()
        .as_secs_f64();
    let c = trial.counters();
    println!(
        "{:14} {count} frames in {seconds:.1} s: good {}, bad {}, ignored {}; good values {}, of them {} not read here",
        protocol.name(),
        c.good,
        c.bad_total(),
        c.ignored,
        trial.tally.confirmed + trial.tally.unread,
        trial.tally.unread
    );
    let enough = count as u64 / 20;
    assert!(c.good > enough && c.bad_total() > enough, "no storm: {c:?}");
    assert!(
        trial.tally.confirmed > enough / 3,
        "nothing judged: {:?}",
        trial.tally
    );
}

#[test]
fn no_storm_makes_fgfdm_panic_allocate_or_believe() {
    stream_storm(Protocol::FgFdm);
}

#[test]
fn no_storm_makes_canaerospace_panic_allocate_or_believe() {
    can_storm(Protocol::CanAerospace);
}

#[test]
fn no_storm_makes_can_fix_panic_allocate_or_believe() {
    can_storm(Protocol::CanFix);
}

#[test]
fn no_storm_makes_fg_generic_panic_allocate_or_believe() {
    stream_storm(Protocol::FgGeneric);
}

#[test]
fn no_storm_makes_gdl90_panic_allocate_or_believe() {
    stream_storm(Protocol::Gdl90);
}

#[test]
fn no_storm_makes_dynon_skyview_panic_allocate_or_believe() {
    stream_storm(Protocol::DynonSkyView);
}

#[test]
fn no_storm_makes_dynon_d100_panic_allocate_or_believe() {
    stream_storm(Protocol::DynonD100);
}

#[test]
fn no_storm_makes_garmin_panic_allocate_or_believe() {
    stream_storm(Protocol::GarminG3x);
}

#[test]
fn no_storm_makes_nmea_panic_allocate_or_believe() {
    stream_storm(Protocol::Nmea);
}

#[test]
fn no_storm_makes_ubx_panic_allocate_or_believe() {
    stream_storm(Protocol::Ubx);
}

#[test]
fn no_storm_makes_mgl_panic_allocate_or_believe() {
    stream_storm(Protocol::Mgl);
}
