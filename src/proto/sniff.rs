//! Which protocol is spoken: a verdict with a confidence, from whatever was heard of a line, a socket or a bus.
//!
//! Every protocol is tried on everything. Where frames have checksums, the evidence is how many bytes of all that were heard
//! stand in frames with a right one; other protocols' right frames are not held against it, so that two on one line are both
//! found. Checksums of eight bits come right by chance, once in 256 tries: those protocols need several frames, and a larger
//! part of the bytes. Where there are no checksums (CAN, `FlightGear`) the evidence is how many frames have an identifier, a
//! length, a type and a value that go together.
//!
//! A confidence is between 0 and 1: the part that is explained, times `n / (n + 1)` for `n` frames, since one frame could be a
//! left-over of something else.

use super::fg_generic::SHIPPED;
use super::framing::{Framer, Look, Piece, is_line_end};
use super::gnss::{self, Own};
use super::{Decoder, Fault, Protocol, dynon_d100, dynon_skyview, garmin_g3x, gdl90, mgl};
use crate::signal::{Frame, SourceId, Wire};
use crate::time::Monotonic;

/// What a protocol needs to be named.
#[derive(Clone, Copy, Debug)]
struct Bar {
    frames: u64,
    confidence: f64,
    /// The least part of all that was heard.
    part: f64,
}

/// With sixteen bits of checksum or more, chance is out of the question.
const STRONG: Bar = Bar {
    frames: 2,
    confidence: 0.03,
    part: 0.0,
};
/// With eight, other text has the right sum now and then.
const WEAK: Bar = Bar {
    frames: 3,
    confidence: 0.1,
    part: 0.0,
};
/// Lines of 51 characters without any mark are found among other lines and in their remains, too.
const MARKLESS: Bar = Bar {
    frames: 4,
    confidence: 0.5,
    part: 0.15,
};
/// Without any, most of what is heard has to fit.
const NONE: Bar = Bar {
    frames: 4,
    confidence: 0.5,
    part: 0.0,
};
/// On CAN several protocols may share a bus.
const CAN: Bar = Bar {
    frames: 4,
    confidence: 0.15,
    part: 0.0,
};

/// One protocol that is spoken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Finding {
    /// Which.
    pub protocol: Protocol,
    /// From 0 to 1.
    pub confidence: f64,
    /// Whole frames of it, with right checksums where it has any.
    pub frames: u64,
    /// The bytes in them; on CAN the same as `frames`.
    pub bytes: u64,
    /// Fields of a line, where they are not those of the layout that comes with this program (fg-generic only).
    pub fields: Option<usize>,
}

/// What was heard.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Verdict {
    /// Bytes heard; on CAN frames.
    pub heard: u64,
    /// What is spoken, the surest first.
    pub findings: Vec<Finding>,
    /// What it may be, when nothing that this program reads was found.
    pub hint: Option<&'static str>,
}

impl Verdict {
    /// How sure the surest finding is; zero without one.
    #[must_use]
    pub fn confidence(&self) -> f64 {
        self.findings.first().map_or(0.0, |f| f.confidence)
    }
}

/// Whether a frame with a right form is one of the protocol's own.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Share {
    /// It counts.
    Own,
    /// It belongs to the sender, but proves nothing.
    Aside,
    /// It is another protocol's.
    Other,
}

/// One protocol tried on a byte stream.
#[derive(Debug)]
struct Trial {
    protocol: Protocol,
    framer: Box<Framer<TRIAL_BYTES>>,
    look: fn(&[u8], usize) -> Look,
    share: fn(&[u8]) -> Share,
    bar: Bar,
    /// Whether line ends stand between its frames.
    is_text: bool,
    frames: u64,
    bytes: u64,
    aside: u64,
}

/// As much as the longest frame of any protocol, u-blox's.
const TRIAL_BYTES: usize = gnss::FRAME_BYTES_MAX;

impl Trial {
    fn new(
        protocol: Protocol,
        look: fn(&[u8], usize) -> Look,
        share: fn(&[u8]) -> Share,
        bar: Bar,
    ) -> Self {
        Self {
            protocol,
            framer: Box::default(),
            look,
            share,
            bar,
            is_text: !matches!(protocol, Protocol::Gdl90 | Protocol::Mgl | Protocol::Ubx),
            frames: 0,
            bytes: 0,
            aside: 0,
        }
    }

    fn all() -> Vec<Self> {
        let always = |_: &[u8]| Share::Own;
        vec![
            Self::new(Protocol::Gdl90, gdl90::look, always, STRONG),
            Self::new(Protocol::Mgl, mgl::look, always, STRONG),
            Self::new(
                Protocol::Ubx,
                |bytes, seen| gnss::look(Own::Ubx, bytes, seen),
                |frame| own_if(gnss::is_ubx(frame)),
                STRONG,
            ),
            Self::new(
                Protocol::Nmea,
                |bytes, seen| gnss::look(Own::Nmea, bytes, seen),
                |frame| own_if(gnss::is_sentence(frame)),
                WEAK,
            ),
            Self::new(
                Protocol::DynonSkyView,
                dynon_skyview::look,
                |line| own_if(dynon_skyview::is_known(line)),
                WEAK,
            ),
            Self::new(
                Protocol::GarminG3x,
                garmin_g3x::look,
                |line| match line.first() {
                    Some(b'@') => Share::Aside,
                    _ => own_if(garmin_g3x::is_known(line)),
                },
                WEAK,
            ),
            Self::new(Protocol::DynonD100, dynon_d100::look, always, MARKLESS),
        ]
    }

    fn push(&mut self, bytes: &[u8]) {
        let Self {
            framer,
            look,
            share,
            frames,
            bytes: counted,
            aside,
            ..
        } = self;
        framer.push(Monotonic::from_nanos(0), bytes, *look, &mut |piece| {
            if let Piece::Frame(_, frame) = piece {
                let length = frame.len() as u64;
                match share(frame) {
                    Share::Own => {
                        *frames += 1;
                        *counted += length;
                    }
                    Share::Aside => *aside += length,
                    Share::Other => {}
                }
            }
        });
    }
}

const fn own_if(own: bool) -> Share {
    if own { Share::Own } else { Share::Other }
}

/// Lines of numbers, as `FlightGear`'s generic protocol has them.
#[derive(Debug, Default)]
struct Lines {
    /// Whole lines of numbers, and their bytes.
    lines: u64,
    bytes: u64,
    /// Fields of the last one, and how many in a row had as many.
    fields: usize,
    alike: u64,
}

impl Lines {
    fn push(&mut self, datagram: &[u8]) {
        for line in datagram.split(|b| is_line_end(*b)) {
            let number = |field: &[u8]| {
                let field = field.trim_ascii();
                let text = std::str::from_utf8(field).unwrap_or_default();
                field.iter().any(u8::is_ascii_digit) && text.parse::<f64>().is_ok()
            };
            let separator = [b',', b'\t', b' ']
                .into_iter()
                .find(|s| line.contains(s))
                .unwrap_or(b',');
            let fields = line.split(|b| *b == separator);
            let count = fields.clone().count();
            // Of two numbers anything may be meant.
            if count < 3 || !fields.clone().all(number) {
                continue;
            }
            self.lines += 1;
            self.bytes += line.len() as u64 + 1;
            self.alike = if count == self.fields {
                self.alike + 1
            } else {
                1
            };
            self.fields = count;
        }
    }
}

/// Listens to one line, socket or bus.
#[derive(Debug)]
pub struct Sniffer {
    bytes: u64,
    line_ends: u64,
    datagrams: u64,
    trials: Vec<Trial>,
    lines: Lines,
    packets: Counted,
    can: Vec<Counted>,
    can_frames: u64,
    can_extended: u64,
    beginning: [u8; 4],
}

/// A decoder of whole frames, tried on them.
struct Counted {
    protocol: Protocol,
    decoder: Box<dyn Decoder>,
}

impl std::fmt::Debug for Counted {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Counted").field(&self.protocol).finish()
    }
}

impl Counted {
    fn new(protocol: Protocol) -> Self {
        let decoder = protocol.decoder();
        Self { protocol, decoder }
    }

    fn push(&mut self, wire: Wire<'_>) {
        let frame = Frame {
            at: Monotonic::from_nanos(0),
            source: SourceId(0),
            wire,
        };
        self.decoder.push(frame, &mut |_| {});
    }
}

impl Default for Sniffer {
    fn default() -> Self {
        Self::new()
    }
}

impl Sniffer {
    /// Nothing heard yet.
    #[must_use]
    pub fn new() -> Self {
        Self {
            bytes: 0,
            line_ends: 0,
            datagrams: 0,
            trials: Trial::all(),
            lines: Lines::default(),
            packets: Counted::new(Protocol::FgFdm),
            can: [Protocol::CanAerospace, Protocol::CanFix]
                .map(Counted::new)
                .into(),
            can_frames: 0,
            can_extended: 0,
            beginning: [0; 4],
        }
    }

    /// Takes what was heard: bytes cut anywhere, a datagram, a CAN frame.
    pub fn push(&mut self, wire: Wire<'_>) {
        match wire {
            Wire::Can(can) => {
                self.can_frames += 1;
                self.can_extended += u64::from(can.extended);
                for trial in &mut self.can {
                    trial.push(wire);
                }
            }
            Wire::Stream(bytes) => self.take(bytes),
            Wire::Datagram(bytes) => {
                self.datagrams += 1;
                self.packets.push(wire);
                self.take(bytes);
                self.lines.push(bytes);
            }
        }
    }

    fn take(&mut self, bytes: &[u8]) {
        if let (0, Some(first)) = (self.bytes, bytes.first_chunk()) {
            self.beginning = *first;
        }
        self.bytes += bytes.len() as u64;
        self.line_ends += bytes.iter().filter(|b| is_line_end(**b)).count() as u64;
        for trial in &mut self.trials {
            trial.push(bytes);
        }
    }

    /// What can be said by now.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        let mut findings = if self.can_frames > 0 {
            self.on_can()
        } else {
            self.in_bytes()
        };
        findings.sort_by(|a, b| b.confidence.total_cmp(&a.confidence));
        let hint = findings.is_empty().then(|| self.hint()).flatten();
        Verdict {
            heard: self.bytes + self.can_frames,
            findings,
            hint,
        }
    }

    fn in_bytes(&self) -> Vec<Finding> {
        let explained = |t: &Trial| t.bytes + t.aside;
        let all: u64 = self.trials.iter().map(explained).sum();
        let mut findings = Vec::new();
        for trial in &self.trials {
            let own = explained(trial);
            let line_ends = if trial.is_text { self.line_ends } else { 0 };
            let of_others = all - own + line_ends;
            let part = ratio(own, self.bytes.saturating_sub(of_others).max(own));
            let confidence = sure(part, trial.frames);
            let bar = trial.bar;
            if trial.frames >= bar.frames
                && confidence >= bar.confidence
                && ratio(trial.bytes, self.bytes) >= bar.part
            {
                findings.push(Finding {
                    protocol: trial.protocol,
                    confidence,
                    frames: trial.frames,
                    bytes: trial.bytes,
                    fields: None,
                });
            }
        }
        let packets = self.packets.decoder.counters();
        // The bytes of a packet are not given: all datagrams are taken to be as long as they are on the average.
        let bytes = (ratio(packets.good, self.datagrams) * real(self.bytes)).round();
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "at most the bytes heard"
        )]
        let bytes = bytes as u64;
        let confidence = sure(ratio(packets.good, self.datagrams), packets.good);
        let packets = Finding {
            protocol: Protocol::FgFdm,
            confidence,
            frames: packets.good,
            bytes,
            fields: None,
        };
        let lines = &self.lines;
        let part = ratio(lines.bytes, self.bytes.max(lines.bytes));
        let confidence = 0.9 * sure(part * ratio(lines.alike, lines.lines), lines.alike);
        let shipped = SHIPPED.matches("<chunk>").count();
        let lines = Finding {
            protocol: Protocol::FgGeneric,
            confidence,
            frames: lines.lines,
            bytes: lines.bytes,
            fields: Some(lines.fields).filter(|n| *n != shipped),
        };
        for finding in [packets, lines] {
            if finding.frames >= NONE.frames && finding.confidence >= NONE.confidence {
                findings.push(finding);
            }
        }
        findings
    }

    fn on_can(&self) -> Vec<Finding> {
        let mut findings = Vec::new();
        for trial in &self.can {
            let counters = trial.decoder.counters();
            // Whole frames of the sender's that say nothing: half as telling.
            let silent = match trial.protocol {
                Protocol::CanAerospace => counters.bad(Fault::Long) / 2,
                _ => 0,
            };
            let fits = counters.good + silent;
            // Frames that are another's business are not held against it, but those that it should understand are.
            let own = fits + counters.bad_total() - silent;
            let part = ratio(fits, own) * ratio(own, self.can_frames).sqrt();
            let confidence = sure(part, fits);
            if fits >= CAN.frames && confidence >= CAN.confidence && 3 * fits >= own {
                findings.push(Finding {
                    protocol: trial.protocol,
                    confidence,
                    frames: counters.good,
                    bytes: counters.good,
                    fields: None,
                });
            }
        }
        findings
    }

    fn hint(&self) -> Option<&'static str> {
        let text = self.beginning;
        if self.can_frames > 0 && 2 * self.can_extended > self.can_frames {
            Some(
                "most identifiers have 29 bits, as NMEA 2000's and J1939's: not read by this version",
            )
        } else if self.datagrams > 0 && &text == b"DATA" {
            Some("it begins as X-Plane's DATA output does: not read by this version")
        } else if matches!(text, [0xFE | 0xFD, ..]) && self.datagrams > 0 {
            Some("it begins as MAVLink does: not read by this version")
        } else {
            None
        }
    }
}

fn sure(part: f64, frames: u64) -> f64 {
    part.min(1.0) * ratio(frames, frames + 1)
}

fn ratio(part: u64, whole: u64) -> f64 {
    if whole == 0 {
        0.0
    } else {
        real(part) / real(whole)
    }
}

#[expect(
    clippy::cast_precision_loss,
    reason = "counts of bytes heard in seconds"
)]
const fn real(count: u64) -> f64 {
    count as f64
}
