//! Where buses meet protocols: starts the listening thread of each source.

use super::error::{Failure, Kind};
use crate::bus::{self, BusError, Decode, Endpoint, SourceConfig, SourceHandle, Tally};
use crate::proto::Protocol;
use crate::signal::SourceId;
use std::net::{IpAddr, SocketAddr};

/// Listens to a UDP socket. See [`bus::spawn`].
///
/// # Errors
/// When the socket cannot be opened.
pub fn listen_udp(
    name: &str,
    id: SourceId,
    protocol: Protocol,
    bind: SocketAddr,
    allow: Vec<IpAddr>,
) -> Result<SourceHandle, BusError> {
    listen(name, id, protocol, Endpoint::Udp { bind, allow })
}

/// Listens to a CAN interface, to the identifiers that the protocol has a use for. See [`bus::spawn`].
///
/// # Errors
/// When the interface is missing or refused.
pub fn listen_can(
    name: &str,
    id: SourceId,
    protocol: Protocol,
    interface: &str,
) -> Result<SourceHandle, BusError> {
    let endpoint = Endpoint::Can {
        interface: interface.to_owned(),
        ids: protocol.can_ids(),
    };
    listen(name, id, protocol, endpoint)
}

/// Listens to any endpoint. See [`bus::spawn`].
///
/// # Errors
/// When the endpoint cannot be opened.
pub fn listen(
    name: &str,
    id: SourceId,
    protocol: Protocol,
    endpoint: Endpoint,
) -> Result<SourceHandle, BusError> {
    let config = SourceConfig {
        name: name.to_owned(),
        id,
        endpoint,
    };
    bus::spawn(config, decode(protocol))
}

/// A bus's view of a protocol's decoder.
fn decode(protocol: Protocol) -> Decode {
    let mut decoder = protocol.decoder();
    Box::new(move |frame, sink| {
        decoder.push(frame, sink);
        let counters = decoder.counters();
        Tally {
            good: counters.good,
            bad: counters.bad_total(),
            ignored: counters.ignored,
        }
    })
}

impl From<BusError> for Failure {
    fn from(e: BusError) -> Self {
        Self::new(Kind::Device, e.what(), e.why(), e.todo()).caused_by(e)
    }
}
