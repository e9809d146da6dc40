//! The bench's clock: an encoder's messages at their times, and the faults on their way.

use super::encode::Encoder;
use super::fault::{Fault, FaultError, Kind, jump_of, noise_of};
use super::truth::Truth;
use crate::angle::wrap_turn;
use crate::sampled::Invalid;
use crate::signal::{CanData, Parameter, Wire};
use crate::units::Radians;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::time::Duration;

/// How often a babbling sender sends.
const BABBLE_EVERY: Duration = Duration::from_millis(1);
/// Bits of an 11-bit frame with eight bytes and the space behind it, none stuffed (ISO 11898-1).
const FRAME_BITS: u32 = 111;
/// Bits of a byte on a serial line: start, eight, stop.
const BYTE_BITS: u32 = 10;
/// Bytes of a babbled datagram; a thousand a second.
const DATAGRAM_BYTES: usize = 1000;

/// One encoder with its faults, on a clock that begins at 0 and is moved by [`Bench::step`].
#[derive(Debug)]
pub struct Bench {
    encoder: Box<dyn Encoder>,
    /// When each of its messages is due.
    due: Vec<Duration>,
    faults: Vec<Fault>,
    /// What froze, by fault.
    frozen: Vec<Option<Truth>>,
    random: Random,
    /// Frames that wait to be overtaken.
    held: BTreeMap<u32, Piece>,
    babble_due: Option<Duration>,
    /// Bits a second of the bus, and those that babble has not used yet.
    bit_rate: u32,
    spare_bits: u32,
    is_bus_off: bool,
}

/// A frame on its way.
#[derive(Clone, Debug)]
enum Piece {
    Can(CanData),
    Datagram(Vec<u8>),
    Stream(Vec<u8>),
}

impl Piece {
    fn of(wire: Wire<'_>) -> Self {
        match wire {
            Wire::Can(can) => Self::Can(can),
            Wire::Datagram(bytes) => Self::Datagram(bytes.to_vec()),
            Wire::Stream(bytes) => Self::Stream(bytes.to_vec()),
        }
    }

    fn wire(&self) -> Wire<'_> {
        match self {
            Self::Can(can) => Wire::Can(*can),
            Self::Datagram(bytes) => Wire::Datagram(bytes),
            Self::Stream(bytes) => Wire::Stream(bytes),
        }
    }

    fn bytes(&mut self) -> &mut [u8] {
        match self {
            Self::Can(can) => &mut can.data[..usize::from(can.len.min(8))],
            Self::Datagram(bytes) | Self::Stream(bytes) => bytes,
        }
    }
}

impl Bench {
    /// An encoder, what goes wrong with it, and the seed of chance: the same seed gives the same frames.
    ///
    /// # Errors
    /// When the encoder's protocol cannot have one of the faults.
    pub fn new(
        encoder: Box<dyn Encoder>,
        faults: Vec<Fault>,
        seed: u64,
    ) -> Result<Self, FaultError> {
        for fault in &faults {
            fault.check(encoder.as_ref())?;
        }
        let due = encoder.beats().iter().map(|beat| beat.first).collect();
        let babble = faults.iter().filter(|f| f.kind == Kind::Babble);
        Ok(Self {
            due,
            babble_due: babble.map(|f| f.begin).min(),
            frozen: vec![None; faults.len()],
            bit_rate: if encoder.is_on_can() {
                1_000_000
            } else {
                115_200
            },
            spare_bits: 0,
            encoder,
            faults,
            random: Random::new(seed),
            held: BTreeMap::new(),
            is_bus_off: false,
        })
    }

    /// The speed of the bus, bits a second, which decides how much a babbling sender sends. At first 1 Mbit/s for CAN, 115 200
    /// for others.
    pub const fn set_bit_rate(&mut self, bit_rate: u32) {
        self.bit_rate = bit_rate;
    }

    /// The encoder.
    #[must_use]
    pub fn encoder(&self) -> &dyn Encoder {
        self.encoder.as_ref()
    }

    /// When the next frames are due, after the start.
    #[must_use]
    pub fn next(&self) -> Duration {
        let due = self.due.iter().chain(&self.babble_due);
        due.min().copied().unwrap_or(Duration::MAX)
    }

    /// Whether the controller had left its bus at the last step.
    #[must_use]
    pub const fn is_bus_off(&self) -> bool {
        self.is_bus_off
    }

    /// Sends what is due at [`Bench::next`] and moves on. `truth` is how things are at that moment; the faults change it on
    /// its way.
    pub fn step(&mut self, truth: &Truth, send: &mut dyn FnMut(Wire<'_>)) {
        let now = self.next();
        let mut truth = truth.clone();
        self.spoil(now, &mut truth);
        let is_active = |kind, of_all: bool| {
            let of_kind = self
                .faults
                .iter()
                .filter(|f| f.kind == kind && f.is_active(now));
            of_kind.filter(|f| !of_all || f.parameter.is_none()).count() > 0
        };
        self.is_bus_off = is_active(Kind::BusOff, true);
        let is_silent = self.is_bus_off || is_active(Kind::Stop, true);
        let is_babbling = is_active(Kind::Babble, true) && !self.is_bus_off;
        for message in 0..self.due.len() {
            if self.due[message] > now {
                continue;
            }
            self.due[message] += self.encoder.beats()[message].every;
            let mut pieces = Vec::new();
            self.encoder
                .write(message, &truth, &mut |wire| pieces.push(Piece::of(wire)));
            if !is_silent {
                let key = u32::try_from(message).unwrap_or(u32::MAX);
                self.deliver(now, key, pieces, send);
            }
        }
        if self.babble_due.is_some_and(|due| due <= now) {
            let ended = |f: &Fault| f.end.is_some_and(|end| end <= now);
            let mut babbles = self.faults.iter().filter(|f| f.kind == Kind::Babble);
            let over = babbles.all(ended);
            self.babble_due = (!over).then_some(now + BABBLE_EVERY);
            if is_babbling {
                self.babble(send);
            }
        }
    }

    /// Faults of values.
    fn spoil(&mut self, now: Duration, truth: &mut Truth) {
        let whole = truth.clone();
        for (fault, frozen) in self.faults.iter().zip(&mut self.frozen) {
            if !fault.is_active(now) {
                *frozen = None;
                continue;
            }
            if fault.kind == Kind::Freeze && frozen.is_none() {
                *frozen = Some(whole.clone());
            }
            for parameter in fault.parameters(self.encoder.as_ref()) {
                let value = truth.get(parameter);
                let value = match fault.kind {
                    Kind::Stop if fault.parameter.is_some() => Err(Invalid::NeverReceived),
                    Kind::Freeze => frozen.as_ref().map_or(value, |then| then.get(parameter)),
                    Kind::Jump => value.map(|x| moved(parameter, x, jump_of(parameter))),
                    Kind::Noise => {
                        let part = self.random.part() * 2.0 - 1.0;
                        value.map(|x| moved(parameter, x, noise_of(parameter) * part))
                    }
                    Kind::Nan => Ok(f64::NAN),
                    Kind::Sentinel => Err(Invalid::SourceFailed),
                    Kind::OutOfRange => {
                        let carried = self.encoder.carries(parameter);
                        carried
                            .and_then(|c| c.impossible(parameter))
                            .map_or(value, Ok)
                    }
                    _ => value,
                };
                truth.set(parameter, value);
            }
        }
    }

    /// Faults of frames.
    fn deliver(
        &mut self,
        now: Duration,
        message: u32,
        pieces: Vec<Piece>,
        send: &mut dyn FnMut(Wire<'_>),
    ) {
        let is_active = |kind| {
            self.faults
                .iter()
                .any(|f| f.kind == kind && f.is_active(now))
        };
        let [flips, twice, swapped, stranger] = [
            Kind::BitFlips,
            Kind::Duplicates,
            Kind::Reordering,
            Kind::WrongNode,
        ]
        .map(is_active);
        for mut piece in pieces {
            if let (true, Piece::Can(can)) = (stranger, &mut piece) {
                bear_another_number(can);
            }
            if flips && self.random.below(4) == 0 {
                let bytes = piece.bytes();
                let bit = self.random.below(bytes.len() * 8);
                if let Some(byte) = bytes.get_mut(bit / 8) {
                    *byte ^= 1 << (bit % 8);
                }
            }
            let key = match &piece {
                Piece::Can(can) => can.id,
                _ => message,
            };
            let mut out: [Option<Piece>; 2] = [Some(piece), None];
            if let Some(earlier) = self.held.remove(&key) {
                out[1] = Some(earlier);
            } else if swapped {
                let [piece, _] = out;
                self.held.extend(piece.map(|piece| (key, piece)));
                continue;
            }
            for piece in out.iter().flatten() {
                send(piece.wire());
                if twice {
                    send(piece.wire());
                }
            }
        }
    }

    /// What fills the bus for a thousandth of a second: on CAN frames of the highest priority that nobody has asked for, else
    /// noise.
    fn babble(&mut self, send: &mut dyn FnMut(Wire<'_>)) {
        self.spare_bits += self.bit_rate / 1000;
        if self.encoder.is_on_can() {
            while self.spare_bits >= FRAME_BITS {
                self.spare_bits -= FRAME_BITS;
                send(Wire::Can(CanData {
                    id: 0,
                    extended: false,
                    len: 8,
                    data: self.random.next().to_be_bytes(),
                }));
            }
            return;
        }
        let is_datagram = self.encoder.sends_datagrams();
        let count = if is_datagram {
            DATAGRAM_BYTES
        } else {
            usize::try_from(self.spare_bits / BYTE_BITS).unwrap_or(0)
        };
        self.spare_bits %= BYTE_BITS;
        let noise: Vec<u8> = (0..count)
            .map(|_| self.random.next().to_be_bytes()[0])
            .collect();
        if is_datagram {
            send(Wire::Datagram(&noise));
        } else {
            send(Wire::Stream(&noise));
        }
    }
}

/// A value that is off by `distance`, within the parameter's range.
fn moved(parameter: Parameter, value: f64, distance: f64) -> f64 {
    let spec = parameter.spec();
    let there = value + distance;
    if (spec.max - TAU).abs() < 1e-9 && spec.min.abs() < 1e-9 {
        wrap_turn(Radians(there)).0
    } else if parameter.check(value).is_ok() && parameter.check(there).is_err() {
        value - distance
    } else {
        there
    }
}

/// Both protocols on CAN have the node in the first byte; CAN-FIX's node-specific identifiers have it, too.
fn bear_another_number(can: &mut CanData) {
    /// Identifiers of CAN-FIX's node-specific frames.
    const NODE_SPECIFIC: std::ops::Range<u32> = 0x6E0..0x7E0;
    const ANOTHER: u8 = 0x40;
    if NODE_SPECIFIC.contains(&can.id) && !can.extended {
        can.id = 0x6E0 + ((can.id - 0x6E0) ^ u32::from(ANOTHER));
    } else {
        can.data[0] ^= ANOTHER;
    }
}

/// Numbers without a pattern (Marsaglia 2003, "Xorshift RNGs").
#[derive(Clone, Copy, Debug)]
struct Random(u64);

impl Random {
    /// Neighbouring seeds give unlike numbers.
    const fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    const fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// From 0 to below 1.
    #[expect(clippy::cast_precision_loss, reason = "53 bits are exact")]
    const fn part(&mut self) -> f64 {
        (self.next() >> 11) as f64 / 9_007_199_254_740_992.0
    }

    fn below(&mut self, n: usize) -> usize {
        usize::try_from(self.next() >> 11).unwrap_or(0) % n.max(1)
    }
}

#[cfg(test)]
mod tests;
