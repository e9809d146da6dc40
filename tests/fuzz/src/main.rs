//! Brings what libFuzzer finds before the judge of the storms (`tests/storm_support`): one binary, the protocol named by the
//! environment variable `GLASSWING_FUZZ`, which may also be `capture` (UDP containers) or `candump` (its text).
#![no_main]

#![allow(dead_code, reason = "of the program's modules only the decoders are used")]

// The judge names the program's modules by its name: here they are this crate's own.
extern crate self as glasswing;

#[path = "../../../src/angle.rs"]
pub mod angle;
#[path = "../../../src/heap.rs"]
pub mod heap;
#[path = "../../../src/limits.rs"]
pub mod limits;
#[path = "../../../src/proto/mod.rs"]
pub mod proto;
#[path = "../../../src/sampled.rs"]
pub mod sampled;
#[path = "../../../src/signal/mod.rs"]
pub mod signal;
#[path = "../../storm_support/mod.rs"]
mod storm_support;
#[path = "../../../src/time.rs"]
pub mod time;
#[path = "../../../src/units.rs"]
pub mod units;

use glasswing::proto::{Carriage, Protocol};
use std::sync::OnceLock;
use storm_support::{Trial, inputs};

/// What is fuzzed.
enum Target {
    Decoder(Protocol),
    Capture,
    Candump,
}

fn target() -> &'static Target {
    static TARGET: OnceLock<Target> = OnceLock::new();
    TARGET.get_or_init(|| {
        let name = std::env::var("GLASSWING_FUZZ").expect("GLASSWING_FUZZ names a protocol");
        match name.as_str() {
            "capture" => Target::Capture,
            "candump" => Target::Candump,
            name => Target::Decoder(Protocol::by_name(name).expect("a protocol")),
        }
    })
}

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    match target() {
        Target::Decoder(protocol) => {
            let mut trial = Trial::new(*protocol);
            if protocol.carriage() == Carriage::Can {
                inputs::can(&mut trial, data);
            } else {
                inputs::bytes(&mut trial, data);
            }
        }
        Target::Capture => inputs::capture(data),
        Target::Candump => inputs::candump(data),
    }
});
