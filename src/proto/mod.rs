//! From the wire to signals: pure decoders, one file per protocol, and the readers of captures.
//!
//! A decoder takes one whole [`Frame`] at a time and says what it holds as [`Signal`]s. It never panics, never blocks and
//! never allocates; what it cannot use it counts by kind and forgets. A number leaves a decoder only when it is finite and
//! within the range of its parameter; otherwise the signal carries the reason instead.
//!
//! In flight a fault costs the smallest thing: one impossible field costs that field, a frame whose shape is wrong costs
//! the frame.

pub mod canaerospace;
pub mod capture;
pub mod fgfdm;

use crate::signal::{Frame, Signal};

/// What can be wrong with a frame. A frame is counted under the first that applies, in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Fault {
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
    pub const ALL: [Self; 7] = [
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
    fn push(&mut self, frame: Frame<'_>, sink: &mut dyn FnMut(Signal));

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
}

impl Protocol {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::FgFdm, Self::CanAerospace];

    /// The name used on the command line and in board files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::FgFdm => "fgfdm",
            Self::CanAerospace => "canaerospace",
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
        }
    }

    /// How it travels.
    #[must_use]
    pub const fn carriage(self) -> Carriage {
        match self {
            Self::FgFdm => Carriage::Packets,
            Self::CanAerospace => Carriage::Can,
        }
    }

    /// The CAN identifiers that its decoder listens to; empty for protocols that are not on CAN.
    #[must_use]
    pub fn can_ids(self) -> &'static [u16] {
        match self {
            Self::FgFdm => &[],
            Self::CanAerospace => &canaerospace::IDS,
        }
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
