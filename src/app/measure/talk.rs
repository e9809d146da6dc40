//! Senders of flight data for measurements: real frames of three protocols, at their times, from a thread of their own.

use crate::app::error::Failure;
use crate::proto::canaerospace::encode;
use crate::signal::{CanData, Parameter};
use crate::time::Monotonic;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Calls a function again and again until dropped.
#[derive(Debug)]
pub struct Talker {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Talker {
    /// Calls `say` with 0, 1 and so on, each a period after the one before; what is late is made up for at once.
    ///
    /// # Errors
    /// When the system has no room for a thread.
    pub fn start(
        period: Duration,
        mut say: impl FnMut(u32) + Send + 'static,
    ) -> Result<Self, Failure> {
        let stop = Arc::new(AtomicBool::new(false));
        let seen = Arc::clone(&stop);
        let thread = std::thread::Builder::new()
            .name("talker".into())
            .spawn(move || {
                let mut next = Monotonic::read();
                let mut said = 0;
                while !seen.load(Ordering::Acquire) {
                    if let Some(wait) = next.since(Monotonic::read()) {
                        std::thread::sleep(wait);
                    }
                    say(said);
                    said = said.wrapping_add(1);
                    next = next.plus(period);
                }
            })
            .map_err(Failure::no_thread)?;
        Ok(Self {
            stop,
            thread: Some(thread),
        })
    }
}

impl Drop for Talker {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// A slow wave, so that no sensor seems to have stopped: -1 to 1.
fn wave(k: u32) -> f64 {
    (f64::from(k % 100_000) * 0.0137).sin()
}

/// FlightGear's native FDM, version 24: attitude, position, altitude, speeds.
#[must_use]
pub fn fdm(k: u32) -> [u8; 408] {
    let mut bytes = [0; 408];
    bytes[..4].copy_from_slice(&24_u32.to_be_bytes());
    let w = wave(k);
    for (at, value) in [(8, 0.2495 + w * 1e-5), (16, 0.8744), (24, 1500.0 + w)] {
        bytes[at..at + 8].copy_from_slice(&f64::to_be_bytes(value));
    }
    let short = [
        (36, 0.2 * w),
        (40, 0.05 * w),
        (44, 1.0 + 0.1 * w),
        (68, 95.0 + w),
        (76, 100.0),
        (80, 120.0),
    ];
    for (at, value) in short {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "the packet has 32-bit fields"
        )]
        bytes[at..at + 4].copy_from_slice(&(value as f32).to_be_bytes());
    }
    bytes
}

/// Dynon SkyView's ADAHRS message.
#[must_use]
pub fn skyview(k: u32) -> String {
    let tenths = |value: f64| {
        #[expect(clippy::cast_possible_truncation, reason = "a few hundred at most")]
        let whole = (value * 10.0).round() as i32;
        whole
    };
    let w = wave(k);
    let body = format!(
        "!11{:08}{:+04}{:+05}271{:04}{:+06}-031+02+1025-020+151001+00+0390024012",
        12_345_600 + k % 16,
        tenths(5.0 * w),
        tenths(20.0 * w),
        tenths(95.0 + w),
        3500 + tenths(w),
    );
    let sum = body.bytes().fold(0_u8, u8::wrapping_add);
    format!("{body}{sum:02X}\r\n")
}

/// What an attitude, heading and air data computer sends over CANaerospace, one message after the other.
#[must_use]
pub fn canaerospace(k: u32) -> Option<CanData> {
    const SAID: [(Parameter, f64, f64); 8] = [
        (Parameter::Pitch, 0.05, 0.05),
        (Parameter::Roll, 0.0, 0.3),
        (Parameter::HeadingTrue, 1.0, 0.1),
        (Parameter::PitchRate, 0.0, 0.05),
        (Parameter::RollRate, 0.0, 0.2),
        (Parameter::IndicatedAirspeed, 50.0, 1.0),
        (Parameter::PressureAltitude, 1500.0, 5.0),
        (Parameter::VerticalSpeed, 0.0, 1.0),
    ];
    let (parameter, middle, width) = SAID[k as usize % SAID.len()];
    let code = (k / 8).to_le_bytes()[0];
    encode(parameter, middle + width * wave(k), 1, code)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::proto::Protocol;
    use crate::signal::{Frame, Signal, SourceId, Wire};

    #[test]
    fn what_is_sent_is_good() {
        let (fdm, skyview) = (fdm(3), skyview(7));
        let can = canaerospace(5).expect("encodes");
        for (protocol, wire) in [
            (Protocol::FgFdm, Wire::Datagram(&fdm)),
            (Protocol::DynonSkyView, Wire::Stream(skyview.as_bytes())),
            (Protocol::CanAerospace, Wire::Can(can)),
        ] {
            let mut decoder = protocol.decoder();
            let mut said = 0;
            let frame = Frame {
                at: Monotonic::from_nanos(1),
                source: SourceId(0),
                wire,
            };
            decoder.push(frame, &mut |signal: Signal| {
                said += usize::from(signal.value.is_ok());
            });
            let counters = decoder.counters();
            assert_eq!(
                (counters.good, counters.total()),
                (1, 1),
                "{}",
                protocol.name()
            );
            assert!(said > 0, "{}", protocol.name());
        }
    }
}
