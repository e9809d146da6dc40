//! CAN through the kernel's SocketCAN.
//!
//! Interface names, bit rates and vcan: `ip link`. The kernel filters by identifier, so that a busy bus costs nothing. Error
//! frames, by which the driver tells of its controller (Linux `include/uapi/linux/can/error.h`), are counted by what they
//! say and set the source's [`Link`]. An interface that goes down is reported once by the socket, which then works on when
//! the interface comes up again; an interface that is removed kills the socket, which is then opened again (both seen on
//! Linux 6.1).

use super::udp::is_pause;
use super::{BusError, Event, Link, Source, SourceFigures, wait_for};
use crate::signal::{CanData, Wire};
use crate::time::Monotonic;
use arrayvec::ArrayVec;
use rustix::io::Errno;
use socketcan::{
    CanAddr, CanErrorFrame, CanFilter, CanFrame, CanSocket, EmbeddedFrame, Frame as _,
};
use socketcan::{ExtendedId, Id, Socket as _, SocketOptions as _, StandardId};
use std::fs;
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Flags and masks of an identifier word (Linux `include/uapi/linux/can.h`).
const FLAG_EXTENDED: u32 = 0x8000_0000;
const FLAG_REMOTE: u32 = 0x4000_0000;
const MASK_STANDARD: u32 = 0x7FF;
const MASK_EXTENDED: u32 = 0x1FFF_FFFF;
/// Bits that are zero in a 29-bit identifier made of an 11-bit one and a redundancy channel in bits 16 to 23, as CANaerospace
/// makes them.
const MASK_NOT_CHANNEL: u32 = 0x1F00_F800;

/// The kernel takes at most this many filters per socket (`CAN_RAW_FILTER_MAX`).
const FILTERS_MAX: usize = 512;

/// A socket bound to an interface.
pub(super) struct Socket {
    interface: String,
    /// The identifiers that the kernel passes on, see [`Endpoint::Can`](super::Endpoint::Can); None: every data frame.
    ids: Option<&'static [u16]>,
    /// None until it can be opened.
    socket: Option<CanSocket>,
    figures: Arc<SourceFigures>,
}

impl Socket {
    /// Not open yet.
    pub(super) const fn new(
        interface: String,
        ids: Option<&'static [u16]>,
        figures: Arc<SourceFigures>,
    ) -> Self {
        Self {
            interface,
            ids,
            socket: None,
            figures,
        }
    }
}

fn refusal(interface: &str, source: io::Error) -> BusError {
    let interface = interface.to_owned();
    match errno(&source) {
        // What the kernel says of a network interface of another kind, too.
        Some(Errno::NODEV) if exists(&interface) => BusError::NotCan { interface, source },
        Some(Errno::NODEV) => BusError::InterfaceMissing { interface, source },
        Some(Errno::AFNOSUPPORT | Errno::PROTONOSUPPORT) => BusError::NoCan { interface, source },
        Some(Errno::ACCESS | Errno::PERM) => BusError::NotPermitted {
            device: format!("can {interface}"),
            todo: "let it use sockets of the family AF_CAN".to_owned(),
            source,
        },
        _ => BusError::Refused {
            device: format!("can {interface}"),
            source,
        },
    }
}

fn errno(e: &io::Error) -> Option<Errno> {
    Errno::from_io_error(e)
}

fn open_filtered(interface: &str, ids: Option<&[u16]>) -> io::Result<CanSocket> {
    let socket = open(interface)?;
    let filters = ids.map(filters).unwrap_or_default();
    if (1..=FILTERS_MAX).contains(&filters.len()) {
        socket.set_filters(&filters)?;
    }
    socket.set_error_filter_accept_all()?;
    socket.set_nonblocking(true)?;
    Ok(socket)
}

/// What the kernel is to pass on: data frames with one of `ids` as 11-bit identifier, and all 29-bit ones that can be one of
/// them on a redundancy channel; for none, all 11-bit ones.
fn filters(ids: &[u16]) -> Vec<CanFilter> {
    const KIND: u32 = FLAG_EXTENDED | FLAG_REMOTE;
    if ids.is_empty() {
        return vec![CanFilter::new(0, KIND)];
    }
    // Whole identifiers are looked up; a filter with a mask is tried on every frame, so there is one of them.
    let redundant = CanFilter::new(FLAG_EXTENDED, MASK_NOT_CHANNEL | KIND);
    let whole = |id: &u16| CanFilter::new(u32::from(*id), MASK_STANDARD | KIND);
    ids.iter().map(whole).chain([redundant]).collect()
}

fn open(interface: &str) -> io::Result<CanSocket> {
    // An absent interface is ENODEV, and so is a name that no interface can have.
    let address = CanAddr::from_iface(interface).map_err(|e| match errno(&e) {
        Some(_) => e,
        None => Errno::NODEV.into(),
    })?;
    CanSocket::open_addr(&address)
}

impl Socket {
    /// Nothing came. An interface that was switched off says nothing when it is switched on again, so it is looked at.
    fn pause(&self) {
        if self.figures.link() == Link::Down && is_up(&self.interface) == Some(true) {
            self.figures.set_link(Link::Open);
        }
    }

    /// The driver tells of its controller.
    fn note(&self, frame: &CanErrorFrame) {
        let controller = frame.data().get(1).copied().unwrap_or(0);
        let events = events(frame.error_bits(), controller);
        if let Some(link) = link_after(&events) {
            self.figures.set_link(link);
        }
        self.figures.fault(events);
    }
}

impl Source for Socket {
    fn receive(&mut self, wait: Duration) -> io::Result<Option<(Monotonic, Wire<'_>)>> {
        let Some(socket) = &self.socket else {
            return Err(io::ErrorKind::NotConnected.into());
        };
        if !wait_for(socket, wait) {
            self.pause();
            return Ok(None);
        }
        let frame = match socket.read_frame() {
            Ok(frame) => frame,
            Err(e) if is_pause(&e) => return Ok(None),
            Err(e) if errno(&e) == Some(Errno::NETDOWN) => {
                self.figures.fault([Event::Down]);
                self.figures.set_link(Link::Down);
                return Ok(None);
            }
            Err(e) => return Err(e),
        };
        let at = Monotonic::read();
        self.figures.taken();
        match frame {
            CanFrame::Data(frame) => {
                if !self.figures.link().can_hear() {
                    // It has been heard: the controller is on the bus.
                    self.figures.set_link(Link::Open);
                }
                let mut data = [0; 8];
                let bytes = frame.data();
                let len = bytes.len().min(data.len());
                data[..len].copy_from_slice(&bytes[..len]);
                let can = CanData {
                    id: frame.raw_id() & MASK_EXTENDED,
                    extended: frame.is_extended(),
                    len: u8::try_from(len).unwrap_or(8),
                    data,
                };
                Ok(Some((at, Wire::Can(can))))
            }
            CanFrame::Remote(_) => Ok(None),
            CanFrame::Error(frame) => {
                self.note(&frame);
                Ok(None)
            }
        }
    }

    fn open(&mut self) -> Result<(), BusError> {
        let socket = open_filtered(&self.interface, self.ids)
            .map_err(|source| refusal(&self.interface, source))?;
        self.socket = Some(socket);
        let passed = frames_passed(&self.interface);
        self.figures.opened_after(passed.unwrap_or(0));
        Ok(())
    }
}

/// What an error frame says: its class bits, and its second byte, which details the class "controller".
fn events(classes: u32, controller: u8) -> ArrayVec<Event, { Event::ALL.len() }> {
    /// Bits of the identifier.
    const CONTROLLER: u32 = 0x004;
    const CLASSES: [(u32, Event); 5] = [
        (0x088, Event::BusError), // protocol violation, bus error
        (0x020, Event::NoAcknowledge),
        (0x040, Event::BusOff),
        (0x100, Event::Restarted),
        (0x013, Event::Other), // transmission timed out, arbitration lost, transceiver
    ];
    /// Error counters are beside any of the others, or alone: no event.
    const COUNTERS: u32 = 0x200;
    /// Bits of the second byte, each for receiving and for sending.
    const DETAILS: [(u32, Event); 4] = [
        (0x03, Event::Overrun),
        (0x0C, Event::ErrorWarning),
        (0x30, Event::ErrorPassive),
        (0x40, Event::ErrorActive),
    ];
    let details = if classes & CONTROLLER == 0 {
        0
    } else {
        u32::from(controller)
    };
    let of = |bits: u32| move |(mask, event): (u32, Event)| (bits & mask != 0).then_some(event);
    let mut found: ArrayVec<_, _> = CLASSES.into_iter().filter_map(of(classes)).collect();
    found.extend(DETAILS.into_iter().filter_map(of(details)));
    if found.is_empty() && classes != COUNTERS {
        found.push(Event::Other);
    }
    found
}

/// How the device fares after events that came together: the worst of them counts. None when they do not tell.
fn link_after(events: &[Event]) -> Option<Link> {
    let states = events.iter().filter_map(|event| match event {
        Event::Restarted | Event::ErrorActive => Some(Link::Open),
        Event::ErrorWarning => Some(Link::ErrorWarning),
        Event::ErrorPassive => Some(Link::ErrorPassive),
        Event::BusOff => Some(Link::BusOff),
        _ => None,
    });
    states.max_by_key(|link| *link as u8)
}

/// How many frames have passed an interface since it was made, by its own count; None when it is gone.
pub(super) fn frames_passed(interface: &str) -> Option<u64> {
    read(interface, "statistics/rx_packets")?.parse().ok()
}

/// Whether an interface is switched on; None when it is gone.
#[must_use]
pub fn is_up(interface: &str) -> Option<bool> {
    /// `IFF_UP` of `linux/if.h`.
    const UP: u32 = 1;
    let flags = read(interface, "flags")?;
    let flags = u32::from_str_radix(flags.trim_start_matches("0x"), 16).ok()?;
    Some(flags & UP != 0)
}

fn read(interface: &str, file: &str) -> Option<String> {
    let path = Path::new("/sys/class/net").join(interface).join(file);
    let text = fs::read_to_string(path).ok()?;
    Some(text.trim().to_owned())
}

/// Whether the system has an interface of this name.
#[must_use]
pub fn exists(interface: &str) -> bool {
    CanAddr::from_iface(interface).is_ok()
}

/// Sends frames on an interface: for the demo and the bench.
#[derive(Debug)]
pub struct Sender {
    socket: CanSocket,
    is_virtual: bool,
}

impl Sender {
    /// On the interface called `interface`.
    ///
    /// # Errors
    /// When it is missing or refused.
    pub fn open(interface: &str) -> Result<Self, BusError> {
        let socket = open(interface).map_err(|source| refusal(interface, source))?;
        let is_virtual = Path::new("/sys/devices/virtual/net")
            .join(interface)
            .exists();
        Ok(Self { socket, is_virtual })
    }

    /// Sends one frame. Sockets of this process receive it too, as all sockets on the interface do.
    ///
    /// # Errors
    /// What the system says, `ENOBUFS` when the interface's queue is full; `EINVAL` for an identifier that is none.
    pub fn send(&self, can: &CanData) -> io::Result<()> {
        let id: Option<Id> = if can.extended {
            ExtendedId::new(can.id).map(Id::Extended)
        } else {
            u16::try_from(can.id)
                .ok()
                .and_then(StandardId::new)
                .map(Id::Standard)
        };
        let frame = id
            .and_then(|id| CanFrame::new(id, can.bytes()))
            .ok_or(Errno::INVAL)?;
        self.socket.write_frame(&frame)
    }

    /// Says what a controller would that has left the bus, or has come back: to those who listen on a virtual interface. A
    /// real controller would send it as a frame of data, so none is given it.
    ///
    /// # Errors
    /// What the system says.
    pub fn say_bus_off(&self, is_off: bool) -> io::Result<()> {
        /// Classes of an error frame (Linux `include/uapi/linux/can/error.h`).
        const BUS_OFF: u32 = 0x040;
        const RESTARTED: u32 = 0x100;
        if !self.is_virtual {
            return Ok(());
        }
        let class = if is_off { BUS_OFF } else { RESTARTED };
        let frame = CanErrorFrame::new_error(class, &[0; 8])
            .map_err(|e| io::Error::new(io::ErrorKind::InvalidInput, e))?;
        self.socket.write_frame(&frame)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Identifier and data of frames as the drivers of Linux 6.1 make them, and what they say.
    const ERROR_FRAMES: [(u32, u8, &[Event], Option<Link>); 8] = [
        (0x040, 0x00, &[Event::BusOff], Some(Link::BusOff)),
        (0x100, 0x00, &[Event::Restarted], Some(Link::Open)),
        // 0x200 says that the frame holds the error counters, too.
        (
            0x204,
            0x08,
            &[Event::ErrorWarning],
            Some(Link::ErrorWarning),
        ),
        (
            0x204,
            0x20,
            &[Event::ErrorPassive],
            Some(Link::ErrorPassive),
        ),
        (0x204, 0x40, &[Event::ErrorActive], Some(Link::Open)),
        (0x004, 0x01, &[Event::Overrun], None),
        (0x088, 0x40, &[Event::BusError], None),
        (0x400, 0x00, &[Event::Other], None),
    ];

    #[test]
    fn error_frames_say_what_the_controller_does() {
        for (classes, controller, expected, link) in ERROR_FRAMES {
            let found = events(classes, controller);
            assert_eq!(&found[..], expected, "{classes:#x} {controller:#x}");
            assert_eq!(link_after(&found), link, "{classes:#x} {controller:#x}");
        }
        assert!(events(0x200, 0).is_empty(), "error counters alone");
    }

    #[test]
    fn of_several_states_at_once_the_worst_counts() {
        let found = events(0x044, 0x28);
        assert_eq!(link_after(&found), Some(Link::BusOff));
        assert_eq!(link_after(&events(0x004, 0x28)), Some(Link::ErrorPassive));
        assert!(events(u32::MAX, 0xFF).len() <= Event::ALL.len(), "all fit");
    }
}
