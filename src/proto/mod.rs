//! From the wire to signals: pure decoders, one file per protocol, and the readers of captures.
//!
//! A decoder takes one whole [`Frame`] at a time and says what it holds as [`Signal`]s. It never panics, never blocks and
//! never allocates; what it cannot use it counts by kind and forgets. A number leaves a decoder only when it is finite and
//! within the range of its parameter; otherwise the signal carries the reason instead.
//!
//! In flight a fault costs the smallest thing: one impossible field costs that field, a frame whose shape is wrong costs
//! the frame.

pub mod can_fix;
pub mod canaerospace;
pub mod capture;
pub mod dynon_d100;
pub mod dynon_skyview;
mod emit;
pub mod fg_generic;
pub mod fgfdm;
pub mod framing;
pub mod garmin_g3x;
pub mod gdl90;
mod gnss;
pub mod mgl;
pub mod nmea;
pub mod sniff;
pub mod stream;
pub mod ubx;

use crate::signal::{Frame, Sink};

/// What can be wrong with a frame. A frame is counted under the first that applies, in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Fault {
    /// The checksum is not that of the content.
    Checksum,
    /// There is no checksum where the protocol has one.
    Unchecked,
    /// A piece without a beginning.
    Fragment,
    /// Fewer bytes than its version or data type has.
    Short,
    /// More bytes than its version or data type has.
    Long,
    /// A version that this program does not know.
    UnknownVersion,
    /// A data type that this identifier cannot have, or whose scale the standard leaves open.
    Type,
    /// Half of a number in two frames whose other half did not come right with it.
    Unpaired,
    /// A field that is NaN or infinite. The other fields are used.
    NotFinite,
    /// A field that its quantity cannot have. The other fields are used.
    OutOfRange,
}

impl Fault {
    /// All kinds, in the order of their discriminants.
    pub const ALL: [Self; 10] = [
        Self::Checksum,
        Self::Unchecked,
        Self::Fragment,
        Self::Short,
        Self::Long,
        Self::UnknownVersion,
        Self::Type,
        Self::Unpaired,
        Self::NotFinite,
        Self::OutOfRange,
    ];

    /// The lower-case name used in JSON output.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Checksum => "checksum",
            Self::Unchecked => "unchecked",
            Self::Fragment => "fragment",
            Self::Short => "short",
            Self::Long => "long",
            Self::UnknownVersion => "unknown-version",
            Self::Type => "type",
            Self::Unpaired => "unpaired",
            Self::NotFinite => "not-finite",
            Self::OutOfRange => "out-of-range",
        }
    }
}

/// What a decoder made of the frames it was given: every frame is good, bad or ignored, exactly once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Whole, well-formed frames with every field possible. Includes frames by which a source says that it has failed.
    pub good: u64,
    /// Frames with something wrong, by [`Fault`].
    bad: [u64; Fault::ALL.len()],
    /// Frames that are somebody else's business: other identifiers, services, redundant senders.
    pub ignored: u64,
    /// Notes on the flow of good frames.
    pub flow: Flow,
}

/// What the sequence of frames tells, where the protocol numbers them. Notes, not verdicts: every one of these frames is
/// also counted as good, bad or ignored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flow {
    /// Frames missing from the sequence, as far as it can tell.
    pub lost: u64,
    /// Frames with the same number as the one before: a sender that does not count, or a frame sent twice.
    pub repeated: u64,
    /// Of the repeated ones, those with the same content too: a sender that may be stuck.
    pub frozen: u64,
    /// Frames by which the source said that it has no data or has failed.
    pub failed: u64,
    /// Fields of good frames that were no number of their kind or not in their parameter's range: no value was taken from
    /// them. In protocols without a checksum such a frame is counted as bad instead.
    pub refused: u64,
    /// Good frames of a kind that has no checksum.
    pub unchecked: u64,
    /// Alarms of nodes, whose meaning is the node's own.
    pub alarms: u64,
    /// Frames numbered just before the last one: out of order, not taken.
    pub late: u64,
}

impl Counters {
    /// Frames counted under `fault`.
    #[must_use]
    pub const fn bad(&self, fault: Fault) -> u64 {
        self.bad[fault as usize]
    }

    /// All bad frames.
    #[must_use]
    pub fn bad_total(&self) -> u64 {
        self.bad.iter().sum()
    }

    /// All frames.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.good + self.bad_total() + self.ignored
    }

    /// Counts a piece of a stream that is no frame.
    fn count_piece(&mut self, piece: &framing::Piece<'_>) {
        match piece {
            framing::Piece::Frame(..) => {}
            framing::Piece::Damaged(fault) => self.count(Some(*fault)),
            framing::Piece::Foreign => self.ignored += 1,
        }
    }

    /// Counts one frame, good when `fault` is `None`.
    fn count(&mut self, fault: Option<Fault>) {
        match fault {
            None => self.good += 1,
            Some(fault) => self.bad[fault as usize] += 1,
        }
    }
}

/// One protocol on one bus.
pub trait Decoder: Send {
    /// Takes one frame and gives what it says to `sink`, in order.
    fn push(&mut self, frame: Frame<'_>, sink: &mut dyn Sink);

    /// The stream has ended: what waits for its rest is judged as it is. Decoders of whole frames have nothing to do.
    fn finish(&mut self) {}

    /// What was made of the frames so far.
    fn counters(&self) -> &Counters;
}

/// How a protocol travels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Carriage {
    /// CAN frames.
    Can,
    /// UDP datagrams that are whole packets.
    Packets,
    /// A byte stream with frames in it: over a serial line, or in UDP datagrams.
    Stream,
}

/// The protocols that this program decodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Protocol {
    /// FlightGear's native FDM packets over UDP.
    FgFdm,
    /// CANaerospace 1.7.
    CanAerospace,
    /// CAN-FIX.
    CanFix,
    /// FlightGear's generic protocol.
    FgGeneric,
    /// GDL90 with the attitude messages of Stratux and ForeFlight.
    Gdl90,
    /// Dynon SkyView serial data.
    DynonSkyView,
    /// Dynon D10, D10A and D100 serial data.
    DynonD100,
    /// Garmin G3X and G5 text output.
    GarminG3x,
    /// NMEA 0183, with the sentences of gliding instruments and FLARM.
    Nmea,
    /// UBX of u-blox receivers.
    Ubx,
    /// MGL Avionics serial data.
    Mgl,
}

impl Protocol {
    /// All of them.
    pub const ALL: [Self; 11] = [
        Self::FgFdm,
        Self::CanAerospace,
        Self::CanFix,
        Self::FgGeneric,
        Self::Gdl90,
        Self::DynonSkyView,
        Self::DynonD100,
        Self::GarminG3x,
        Self::Nmea,
        Self::Ubx,
        Self::Mgl,
    ];

    /// The name used on the command line and in board files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::FgFdm => "fgfdm",
            Self::CanAerospace => "canaerospace",
            Self::CanFix => "can-fix",
            Self::FgGeneric => "fg-generic",
            Self::Gdl90 => "gdl90",
            Self::Mgl => "mgl",
            Self::Ubx => "ubx",
            Self::Nmea => "nmea",
            Self::GarminG3x => "garmin-g3x",
            Self::DynonD100 => "dynon-d100",
            Self::DynonSkyView => "dynon-skyview",
        }
    }

    /// The protocol called `name`.
    #[must_use]
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|p| p.name() == name)
    }

    /// A fresh decoder for it.
    #[must_use]
    pub fn decoder(self) -> Box<dyn Decoder> {
        match self {
            Self::FgFdm => Box::new(fgfdm::FgFdm::new()),
            Self::CanAerospace => Box::new(canaerospace::CanAerospace::new()),
            Self::CanFix => Box::new(can_fix::CanFix::new()),
            Self::FgGeneric => Box::new(fg_generic::FgGeneric::default()),
            Self::Gdl90 => Box::new(gdl90::Gdl90::new()),
            Self::Mgl => Box::new(mgl::decoder()),
            Self::Ubx => Box::new(ubx::Ubx::new()),
            Self::Nmea => Box::new(nmea::Nmea::new()),
            Self::GarminG3x => Box::new(garmin_g3x::decoder()),
            Self::DynonD100 => Box::new(dynon_d100::decoder()),
            Self::DynonSkyView => Box::new(dynon_skyview::decoder()),
        }
    }

    /// How it travels.
    #[must_use]
    pub const fn carriage(self) -> Carriage {
        match self {
            Self::FgFdm => Carriage::Packets,
            Self::CanAerospace | Self::CanFix => Carriage::Can,
            _ => Carriage::Stream,
        }
    }

    /// The CAN identifiers that its decoder listens to, 11-bit and 29-bit; empty for one that listens to all 11-bit ones, and
    /// for those that are not on CAN.
    #[must_use]
    pub fn can_ids(self) -> &'static [u16] {
        match self {
            Self::CanAerospace => &canaerospace::IDS,
            _ => &[],
        }
    }
}

impl From<Protocol> for Box<dyn Decoder> {
    fn from(protocol: Protocol) -> Self {
        protocol.decoder()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_index_their_own_counter() {
        for (i, fault) in Fault::ALL.into_iter().enumerate() {
            assert_eq!(fault as usize, i, "{}", fault.name());
            let mut counters = Counters::default();
            counters.count(Some(fault));
            assert_eq!(counters.bad(fault), 1, "{}", fault.name());
            assert_eq!((counters.total(), counters.good), (1, 0));
        }
    }

    #[test]
    fn protocols_are_found_by_their_names() {
        for p in Protocol::ALL {
            assert_eq!(Protocol::by_name(p.name()), Some(p));
        }
        assert_eq!(Protocol::by_name("telepathy"), None);
    }
}
