//! UDP: one datagram is one frame.

use super::{BusError, Source, SourceFigures, WAIT};
use crate::limits::DATAGRAM_BYTES_MAX;
use crate::signal::Wire;
use crate::time::Monotonic;
use std::io;
use std::net::{IpAddr, SocketAddr, UdpSocket};
use std::sync::Arc;

/// A bound socket.
pub(super) struct Socket {
    bind: SocketAddr,
    allow: Vec<IpAddr>,
    socket: UdpSocket,
    figures: Arc<SourceFigures>,
    /// One byte longer than a datagram may be, so that a longer one is seen to be too long rather than cut to size.
    buffer: [u8; DATAGRAM_BYTES_MAX + 1],
}

impl Socket {
    pub(super) fn open(
        bind: SocketAddr,
        allow: Vec<IpAddr>,
        figures: Arc<SourceFigures>,
    ) -> Result<Self, BusError> {
        let socket = bind_socket(bind).map_err(|source| match source.kind() {
            io::ErrorKind::AddrInUse => BusError::PortInUse { bind, source },
            io::ErrorKind::AddrNotAvailable => BusError::AddressNotLocal { bind, source },
            io::ErrorKind::PermissionDenied => BusError::NotPermitted {
                device: format!("udp {bind}"),
                source,
            },
            _ => BusError::Refused {
                device: format!("udp {bind}"),
                source,
            },
        })?;
        Ok(Self {
            bind,
            allow,
            socket,
            figures,
            buffer: [0; DATAGRAM_BYTES_MAX + 1],
        })
    }
}

fn bind_socket(bind: SocketAddr) -> io::Result<UdpSocket> {
    let socket = UdpSocket::bind(bind)?;
    socket.set_read_timeout(Some(WAIT))?;
    Ok(socket)
}

impl Source for Socket {
    fn receive(&mut self) -> io::Result<Option<(Monotonic, Wire<'_>)>> {
        match self.socket.recv_from(&mut self.buffer) {
            Ok((len, sender)) => {
                let at = Monotonic::read();
                if !is_allowed(&self.allow, sender.ip()) {
                    SourceFigures::add(&self.figures.foreign, 1);
                    return Ok(None);
                }
                Ok(Some((at, Wire::Datagram(&self.buffer[..len]))))
            }
            Err(e) if is_pause(&e) => Ok(None),
            Err(e) => Err(e),
        }
    }

    fn reopen(&mut self) -> io::Result<()> {
        // The old socket still holds the port; a socket that has failed is replaced by an unbound one first.
        let any_port = SocketAddr::new(self.bind.ip(), 0);
        self.socket = bind_socket(any_port)?;
        self.socket = bind_socket(self.bind)?;
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
    allow.is_empty() || allow.contains(&sender.to_canonical())
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
        assert!(!is_allowed(&[v4], other), "not named");
    }
}
