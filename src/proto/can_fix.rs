//! CAN-FIX, MakerPlane's open bus for experimental aircraft: 11-bit identifiers, little-endian.
//!
//! Source: MakerPlane, "CAN-FIX Specification", version 0.7 (`canfix.json`, `framedef.rst`). A parameter's frame is: node,
//! index, function, then the value. Identifiers, units and scales are those of its tables; an identifier that has an
//! instance for each of two engines (tanks, electrical buses) counts up by one.
//!
//! The function's bits 4 to 7 are the *meta* code: when they are not zero, the frame has a limit of the parameter, never its
//! value. Bit 2 says that the value has failed ([`Invalid::SourceFailed`]), bit 1 that its sender doubts it
//! ([`Invalid::Doubtful`]). There are no other sentinels. Bit 0, annunciate, changes nothing about the value's right to be shown.
//!
//! Several nodes may send the same parameter: the first heard is listened to, until it fails, doubts or falls silent for the
//! parameter's greatest age. A node must say something every two seconds ([`NODE_AGE_MAX`]); when it has not, all that was
//! taken from it has failed at once, whatever its age.
//!
//! A node alarm (identifiers 1 to 255, the node's number) says that its node is alive; what its code means is the node's
//! own business, so it is noted ([`Flow::alarms`](super::Flow)) and changes no value.
//!
//! Not read: control inputs and positions but the flaps, lists of waypoints but the next one, radios, the ADS-B pages (their
//! fields come in separate frames that nothing holds together), VOR deviation (whose range and sign the tables leave open),
//! yaw angle (from which north is not said), torque (which has no unit), rates and deviations of temperatures, gearbox,
//! hydraulics, tires, cabin, switches.

mod table;

use super::emit::{Emit, date_days};
use super::{Counters, Decoder, Fault};
use crate::sampled::Invalid;
use crate::signal::Parameter as P;
use crate::signal::{CanData, Frame, Limit, Parameter, Sink, Wire};
use crate::time::Monotonic;
use std::time::Duration;
use table::ROWS;

/// The longest that a node may be silent.
pub const NODE_AGE_MAX: Duration = Duration::from_secs(2);

/// How often nodes are looked after.
const CHECK_EVERY: Duration = Duration::from_millis(50);

/// Node-specific messages: this plus the node's number.
const NODE_BASE: u32 = 0x6E0;
const NODE_FIRST: u32 = NODE_BASE + 1;
const NODE_LAST: u32 = 0x7DF;
/// Node alarms: the node's number.
const ALARM_FIRST: u32 = 1;
/// Parameters.
const PARAMETER_FIRST: u32 = 0x100;

const HEADER_BYTES: usize = 3;

/// Hours, minutes and seconds to the next waypoint.
const NEXT_ETE: u32 = 0x485;
/// Hour, minute, second, milliseconds.
const TIME: u32 = 0x580;
/// Year, month, day.
const DATE: u32 = 0x581;

/// Who is listened to for one parameter.
#[derive(Clone, Copy, Debug)]
struct Owner {
    node: u8,
    id: u32,
    at: Monotonic,
}

/// The decoder. Memory: when each node was last heard, and who is listened to for each parameter; fixed.
#[derive(Debug)]
pub struct CanFix {
    counters: Counters,
    nodes: [Option<Monotonic>; 256],
    owners: [Option<Owner>; Parameter::COUNT],
    checked_at: Monotonic,
}

impl Default for CanFix {
    fn default() -> Self {
        Self::new()
    }
}

impl CanFix {
    /// A decoder that has heard nothing.
    #[must_use]
    pub fn new() -> Self {
        Self {
            counters: Counters::default(),
            nodes: [None; 256],
            owners: [None; Parameter::COUNT],
            checked_at: Monotonic::from_nanos(0),
        }
    }

    /// What was taken from nodes that have fallen silent has failed.
    fn look_after_nodes(&mut self, frame: &Frame<'_>, sink: &mut dyn Sink) {
        if frame
            .at
            .since(self.checked_at)
            .is_some_and(|age| age < CHECK_EVERY)
        {
            return;
        }
        self.checked_at = frame.at;
        for &parameter in Parameter::ALL {
            let owner = &mut self.owners[parameter.index()];
            let Some(Owner { node, .. }) = *owner else {
                continue;
            };
            let heard = self.nodes[usize::from(node)];
            let alive =
                heard.is_some_and(|at| frame.at.since(at).is_none_or(|age| age <= NODE_AGE_MAX));
            if !alive {
                *owner = None;
                let mut out = Emit::new(frame.at, frame.source, &mut self.counters.flow, sink);
                out.absent(parameter);
            }
        }
    }

    /// Whether this node is the one to listen to for a parameter, and if it has a good value, from now on.
    fn is_owner(
        &mut self,
        parameter: Parameter,
        node: u8,
        id: u32,
        at: Monotonic,
        good: bool,
    ) -> bool {
        let owner = &mut self.owners[parameter.index()];
        let other_is_alive = owner.is_some_and(|o| {
            (o.node, o.id) != (node, id)
                && at
                    .since(o.at)
                    .is_none_or(|age| age <= parameter.spec().age_max)
        });
        if !other_is_alive {
            // A node that has failed or doubts makes room for another, but is still looked after.
            *owner = good.then_some(Owner { node, id, at });
        }
        !other_is_alive
    }

    fn take(&mut self, frame: &Frame<'_>, can: &CanData, sink: &mut dyn Sink) -> Taken {
        let [node, index, function, value @ ..] = can.data;
        if !(PARAMETER_FIRST..NODE_BASE).contains(&can.id) {
            let node = match can.id {
                ALARM_FIRST..PARAMETER_FIRST => {
                    self.counters.flow.alarms += 1;
                    can.id
                }
                NODE_FIRST..=NODE_LAST => can.id - NODE_BASE,
                _ => return Taken::Ignored,
            };
            self.nodes[usize::try_from(node).unwrap_or(0)] = Some(frame.at);
            return Taken::Ignored;
        }
        if can.bytes().len() < HEADER_BYTES {
            return Taken::Bad(Fault::Short);
        }
        if node == 0 {
            return Taken::Ignored;
        }
        self.nodes[usize::from(node)] = Some(frame.at);
        let (meta, state) = (function >> 4, status(function));
        let bytes = can.bytes().len() - HEADER_BYTES;
        let clock = match can.id {
            TIME => Some((P::UtcTimeOfDay, 5, time_of_day(value))),
            DATE => Some((P::UtcDate, 4, date(value))),
            NEXT_ETE => Some((P::WaypointTimeToGo, 3, duration(value))),
            _ => None,
        };
        if let Some((parameter, bytes, number)) = clock {
            return if meta != 0 || index != 0 {
                Taken::Ignored
            } else {
                self.clock(frame, can, parameter, bytes, number, sink)
            };
        }
        let row = ROWS.binary_search_by(|row| u32::from(row.id).cmp(&can.id));
        let Some(row) = row.ok().map(|n| &ROWS[n]) else {
            return Taken::Ignored;
        };
        let Some(&parameter) = row.parameters.get(usize::from(index)) else {
            return Taken::Ignored;
        };
        if let Err(fault) = is_long(bytes, row.kind.bytes()) {
            return Taken::Bad(fault);
        }
        let [a, b, c, d, _] = value;
        let number = (row.to_si)(row.kind.number([a, b, c, d]) * row.unit);
        if meta != 0 {
            return limit(
                frame,
                parameter,
                row.meta.kind(meta),
                number,
                state.is_ok(),
                sink,
            );
        }
        self.say(frame, can, parameter, state.map(|()| number), sink)
    }

    fn clock(
        &mut self,
        frame: &Frame<'_>,
        can: &CanData,
        parameter: Parameter,
        bytes: usize,
        number: f64,
        sink: &mut dyn Sink,
    ) -> Taken {
        if let Err(fault) = is_long(can.bytes().len() - HEADER_BYTES, bytes) {
            return Taken::Bad(fault);
        }
        let value = status(can.data[2]).map(|()| number);
        self.say(frame, can, parameter, value, sink)
    }

    fn say(
        &mut self,
        frame: &Frame<'_>,
        can: &CanData,
        parameter: Parameter,
        wire: Result<f64, Invalid>,
        sink: &mut dyn Sink,
    ) -> Taken {
        let value = wire.and_then(|x| parameter.check(x));
        if !self.is_owner(parameter, can.data[0], can.id, frame.at, value.is_ok()) {
            return Taken::Ignored;
        }
        self.counters.flow.failed += u64::from(wire.is_err());
        let mut out = Emit::new(frame.at, frame.source, &mut self.counters.flow, sink);
        out.verdict(parameter, value);
        match (value, wire) {
            (Err(_), Ok(x)) if x.is_finite() => Taken::Bad(Fault::OutOfRange),
            (Err(_), Ok(_)) => Taken::Bad(Fault::NotFinite),
            _ => Taken::Good,
        }
    }
}

enum Taken {
    Good,
    Bad(Fault),
    Ignored,
}

impl Decoder for CanFix {
    fn push(&mut self, frame: Frame<'_>, sink: &mut dyn Sink) {
        let taken = match frame.wire {
            Wire::Can(can) if !can.extended => self.take(&frame, &can, sink),
            _ => Taken::Ignored,
        };
        match taken {
            Taken::Good => self.counters.count(None),
            Taken::Bad(fault) => self.counters.count(Some(fault)),
            Taken::Ignored => self.counters.ignored += 1,
        }
        self.look_after_nodes(&frame, sink);
    }

    fn counters(&self) -> &Counters {
        &self.counters
    }
}

/// What the sender says of the value's quality.
const fn status(function: u8) -> Result<(), Invalid> {
    if function & 4 != 0 {
        Err(Invalid::SourceFailed)
    } else if function & 2 != 0 {
        Err(Invalid::Doubtful)
    } else {
        Ok(())
    }
}

const fn is_long(bytes: usize, expected: usize) -> Result<(), Fault> {
    if bytes < expected {
        Err(Fault::Short)
    } else if bytes > expected {
        Err(Fault::Long)
    } else {
        Ok(())
    }
}

fn limit(
    frame: &Frame<'_>,
    parameter: Parameter,
    kind: Option<&'static str>,
    value: f64,
    is_good: bool,
    sink: &mut dyn Sink,
) -> Taken {
    let Ok(value) = parameter.check(value) else {
        return Taken::Bad(Fault::OutOfRange);
    };
    if let Some(kind) = kind.filter(|_| is_good) {
        sink.limit(&Limit {
            at: frame.at,
            source: frame.source,
            parameter,
            kind,
            value,
        });
    }
    Taken::Good
}

fn time_of_day([hour, minute, second, low, high]: [u8; 5]) -> f64 {
    let milliseconds = u16::from_le_bytes([low, high]);
    if hour > 23 || minute > 59 || second > 60 || milliseconds > 999 {
        return f64::NAN;
    }
    let minutes = f64::from(hour) * 60.0 + f64::from(minute);
    minutes * 60.0 + f64::from(second) + f64::from(milliseconds) * 1e-3
}

fn duration([hours, minutes, seconds, ..]: [u8; 5]) -> f64 {
    if minutes > 59 || seconds > 59 {
        return f64::NAN;
    }
    f64::from(hours) * 3600.0 + f64::from(minutes) * 60.0 + f64::from(seconds)
}

fn date([low, high, month, day, _]: [u8; 5]) -> f64 {
    let year = u16::from_le_bytes([low, high]);
    date_days(i32::from(year), i32::from(month), i32::from(day))
}
