//! UDP: one datagram is one frame.

use super::{BusError, Source, SourceFigures, WAIT, wait_for};
use crate::limits::DATAGRAM_BYTES_MAX;
use crate::signal::Wire;
use crate::time::Monotonic;
use std::io;
use std::net::{IpAddr, SocketAddr, UdpSocket};
use std::sync::Arc;
use std::time::Duration;

/// Waits without a datagram after which it is looked whether the address is still there: two seconds.
const WAITS_BEFORE_LOOK: u32 = 40;

/// A bound socket.
pub(super) struct Socket {
    bind: SocketAddr,
    allow: Vec<IpAddr>,
    /// None until it can be opened, and from a failure to the next opening that succeeds.
    socket: Option<UdpSocket>,
    figures: Arc<SourceFigures>,
    /// Waits since the last datagram or the last look.
    waits: u32,
    /// One byte longer than a datagram may be, so that a longer one is seen to be too long rather than cut to size.
    buffer: [u8; DATAGRAM_BYTES_MAX + 1],
}

impl Socket {
    /// Not open yet.
    pub(super) fn new(bind: SocketAddr, allow: Vec<IpAddr>, figures: Arc<SourceFigures>) -> Self {
        Self {
            bind,
            allow,
            socket: None,
            figures,
            waits: 0,
            buffer: [0; DATAGRAM_BYTES_MAX + 1],
        }
    }

    /// Nothing came. The system says nothing to a socket whose address goes away with its interface, so it is asked.
    fn pause(&mut self) -> io::Result<()> {
        self.waits += 1;
        if self.waits < WAITS_BEFORE_LOOK {
            return Ok(());
        }
        self.waits = 0;
        match UdpSocket::bind(SocketAddr::new(self.bind.ip(), 0)) {
            Err(e) if e.kind() == io::ErrorKind::AddrNotAvailable => Err(e),
            _ => Ok(()),
        }
    }
}

fn refusal(bind: SocketAddr, source: io::Error) -> BusError {
    let device = format!("udp {bind}");
    match source.kind() {
        io::ErrorKind::AddrInUse => BusError::PortInUse { bind, source },
        io::ErrorKind::AddrNotAvailable => BusError::AddressNotLocal { bind, source },
        io::ErrorKind::PermissionDenied => BusError::NotPermitted {
            device,
            todo: "choose a port above 1023".to_owned(),
            source,
        },
        _ => BusError::Refused { device, source },
    }
}

/// A socket of its own at an address, which waits at most 50 ms for a datagram.
///
/// # Errors
/// When the address is not of this machine, or is taken.
pub fn bound(bind: SocketAddr) -> Result<UdpSocket, BusError> {
    let patient = |socket: UdpSocket| {
        socket.set_nonblocking(false)?;
        socket.set_read_timeout(Some(WAIT)).map(|()| socket)
    };
    let socket = bind_socket(bind).and_then(patient);
    socket.map_err(|source| refusal(bind, source))
}

fn bind_socket(bind: SocketAddr) -> io::Result<UdpSocket> {
    let socket = UdpSocket::bind(bind)?;
    socket.set_nonblocking(true)?;
    Ok(socket)
}

impl Source for Socket {
    fn receive(&mut self, wait: Duration) -> io::Result<Option<(Monotonic, Wire<'_>)>> {
        let Some(socket) = &self.socket else {
            return Err(io::ErrorKind::NotConnected.into());
        };
        if !wait_for(socket, wait) {
            return self.pause().map(|()| None);
        }
        let (len, sender) = match socket.recv_from(&mut self.buffer) {
            Ok(received) => received,
            Err(e) if is_pause(&e) => return Ok(None),
            Err(e) => return Err(e),
        };
        let at = Monotonic::read();
        self.waits = 0;
        if !is_allowed(&self.allow, sender.ip()) {
            self.figures.foreign();
            Ok(None)
        } else if len > DATAGRAM_BYTES_MAX {
            // The rest of it is lost, and what is left may look whole.
            self.figures.oversized();
            Ok(None)
        } else {
            Ok(Some((at, Wire::Datagram(&self.buffer[..len]))))
        }
    }

    fn open(&mut self) -> Result<(), BusError> {
        // The old one is let go first: it would hold the port against ourselves.
        self.socket = None;
        let socket = bind_socket(self.bind).map_err(|source| refusal(self.bind, source))?;
        self.socket = Some(socket);
        Ok(())
    }
}

/// Whether a failed read only means that nothing came.
pub(super) fn is_pause(e: &io::Error) -> bool {
    matches!(
        e.kind(),
        io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut | io::ErrorKind::Interrupted
    )
}

/// Whether `sender` is listened to. An IPv4 sender that reaches an IPv6 socket is known by its IPv4 address.
fn is_allowed(allow: &[IpAddr], sender: IpAddr) -> bool {
    let sender = sender.to_canonical();
    allow.is_empty() || allow.iter().any(|named| named.to_canonical() == sender)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_named_senders_are_listened_to() {
        let v4: IpAddr = "10.0.0.7".parse().unwrap();
        let mapped: IpAddr = "::ffff:10.0.0.7".parse().unwrap();
        let other: IpAddr = "10.0.0.8".parse().unwrap();
        assert!(is_allowed(&[], other), "no list, no rule");
        assert!(is_allowed(&[v4], v4), "named");
        assert!(is_allowed(&[v4], mapped), "the same in IPv6 clothes");
        assert!(is_allowed(&[mapped], v4), "and the other way round");
        assert!(!is_allowed(&[v4], other), "not named");
        assert!(is_allowed(&[v4, other], other), "the second of two");
    }
}
