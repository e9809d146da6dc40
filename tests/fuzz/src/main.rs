//! Brings what libFuzzer finds before the judge of the storms (`tests/storm_support`): one binary, the protocol named by the
//! environment variable `GLASSWING_FUZZ`, which may also be `capture` (UDP containers) or `candump` (its text).
#![no_main]

#[path = "../../storm_support/mod.rs"]
mod storm_support;

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
