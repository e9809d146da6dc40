//! CAN through the kernel's SocketCAN.
//!
//! Interface names, bit rates and vcan: `ip link`. The kernel filters by identifier, so that a busy bus costs nothing; error
//! frames of the controller are counted as faults. An interface that goes down is reported once by the socket, which then
//! works on when the interface comes up again; an interface that is removed kills the socket, which is then opened again
//! (both seen on Linux 6.1).

use super::udp::is_pause;
use super::{BusError, Source, SourceFigures, WAIT};
use crate::signal::{CanData, Wire};
use crate::time::Monotonic;
use rustix::io::Errno;
use socketcan::{CanAddr, CanFilter, CanFrame, CanSocket, EmbeddedFrame, Frame as _};
use socketcan::{ExtendedId, Id, Socket as _, SocketOptions as _, StandardId};
use std::io;
use std::sync::Arc;

/// Flags and masks of an identifier word (Linux `include/uapi/linux/can.h`).
const FLAG_EXTENDED: u32 = 0x8000_0000;
const FLAG_REMOTE: u32 = 0x4000_0000;
const MASK_STANDARD: u32 = 0x7FF;
const MASK_EXTENDED: u32 = 0x1FFF_FFFF;

/// The kernel takes at most this many filters per socket (`CAN_RAW_FILTER_MAX`).
const FILTERS_MAX: usize = 512;

/// A socket bound to an interface.
pub(super) struct Socket {
    interface: String,
    ids: &'static [u16],
    socket: CanSocket,
    figures: Arc<SourceFigures>,
}

impl Socket {
    pub(super) fn open(
        interface: String,
        ids: &'static [u16],
        figures: Arc<SourceFigures>,
    ) -> Result<Self, BusError> {
        let socket =
            open_filtered(&interface, ids).map_err(|source| refusal(&interface, source))?;
        Ok(Self {
            interface,
            ids,
            socket,
            figures,
        })
    }
}

fn refusal(interface: &str, source: io::Error) -> BusError {
    if errno(&source) == Some(Errno::NODEV) {
        return BusError::InterfaceMissing {
            interface: interface.to_owned(),
            source,
        };
    }
    let device = format!("can {interface}");
    if source.kind() == io::ErrorKind::PermissionDenied {
        BusError::NotPermitted { device, source }
    } else {
        BusError::Refused { device, source }
    }
}

fn errno(e: &io::Error) -> Option<Errno> {
    Errno::from_io_error(e)
}

fn open_filtered(interface: &str, ids: &[u16]) -> io::Result<CanSocket> {
    let socket = open(interface)?;
    if !ids.is_empty() && 2 * ids.len() <= FILTERS_MAX {
        let filters: Vec<CanFilter> = ids
            .iter()
            .map(|&id| u32::from(id))
            .flat_map(|id| {
                [
                    CanFilter::new(id, MASK_STANDARD | FLAG_EXTENDED | FLAG_REMOTE),
                    CanFilter::new(
                        id | FLAG_EXTENDED,
                        MASK_EXTENDED | FLAG_EXTENDED | FLAG_REMOTE,
                    ),
                ]
            })
            .collect();
        socket.set_filters(&filters)?;
    }
    socket.set_error_filter_accept_all()?;
    socket.set_read_timeout(WAIT)?;
    Ok(socket)
}

fn open(interface: &str) -> io::Result<CanSocket> {
    // An absent interface is ENODEV, and so is a name that no interface can have.
    let address = CanAddr::from_iface(interface).map_err(|e| match errno(&e) {
        Some(_) => e,
        None => Errno::NODEV.into(),
    })?;
    CanSocket::open_addr(&address)
}

impl Source for Socket {
    fn receive(&mut self) -> io::Result<Option<(Monotonic, Wire<'_>)>> {
        let frame = match self.socket.read_frame() {
            Ok(frame) => frame,
            Err(e) if is_pause(&e) => return Ok(None),
            Err(e) if errno(&e) == Some(Errno::NETDOWN) => {
                SourceFigures::add(&self.figures.faults, 1);
                return Ok(None);
            }
            Err(e) => return Err(e),
        };
        let at = Monotonic::read();
        match frame {
            CanFrame::Data(frame) => {
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
            CanFrame::Error(_) => {
                SourceFigures::add(&self.figures.faults, 1);
                Ok(None)
            }
        }
    }

    fn reopen(&mut self) -> io::Result<()> {
        self.socket = open_filtered(&self.interface, self.ids)?;
        Ok(())
    }
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
}

impl Sender {
    /// On the interface called `interface`.
    ///
    /// # Errors
    /// When it is missing or refused.
    pub fn open(interface: &str) -> Result<Self, BusError> {
        let socket = open(interface).map_err(|source| refusal(interface, source))?;
        Ok(Self { socket })
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
}
