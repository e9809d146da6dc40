//! Where buses meet protocols: starts the listening thread of each source.

use super::error::{Failure, Kind};
use crate::bus::{
    self, BAD_KINDS, BusError, Decode, Endpoint, SourceConfig, SourceHandle, SourceThread, Tally,
};
use crate::proto::{Counters, Decoder, Fault, Protocol};
use crate::signal::SourceId;
use serde_json::{Value, json};
use std::net::{IpAddr, SocketAddr};

/// Listens to a UDP socket. See [`bus::spawn`].
///
/// # Errors
/// When the socket cannot be opened.
pub fn listen_udp(
    name: &str,
    id: SourceId,
    decoder: impl Into<Box<dyn Decoder>>,
    bind: SocketAddr,
    allow: Vec<IpAddr>,
) -> Result<SourceHandle, BusError> {
    listen(name, id, decoder, Endpoint::Udp { bind, allow })
}

/// Listens to a serial port. See [`bus::spawn`].
///
/// # Errors
/// When the port is missing, held, not permitted, none or too slow.
pub fn listen_serial(
    name: &str,
    id: SourceId,
    decoder: impl Into<Box<dyn Decoder>>,
    device: &str,
    baud: u32,
) -> Result<SourceHandle, BusError> {
    let endpoint = Endpoint::Serial {
        device: device.to_owned(),
        baud,
    };
    listen(name, id, decoder, endpoint)
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
    decoder: impl Into<Box<dyn Decoder>>,
    endpoint: Endpoint,
) -> Result<SourceHandle, BusError> {
    let config = SourceConfig {
        name: name.to_owned(),
        id,
        endpoint,
    };
    bus::spawn(config, decode(decoder.into()))
}

/// A bus's view of a decoder.
fn decode(mut decoder: Box<dyn Decoder>) -> Decode {
    Box::new(move |frame, sink| {
        decoder.push(frame, &mut |signal| sink(signal));
        let counters = decoder.counters();
        Tally {
            good: counters.good,
            bad: bad_by_kind(counters),
            ignored: counters.ignored,
        }
    })
}

/// In the order of [`Fault::ALL`].
fn bad_by_kind(counters: &Counters) -> [u64; BAD_KINDS] {
    std::array::from_fn(|kind| Fault::ALL.get(kind).map_or(0, |fault| counters.bad(*fault)))
}

const _: () = assert!(
    Fault::ALL.len() <= BAD_KINDS,
    "each kind has a place of its own"
);

/// The figures of a source as `run --stats` tells them.
#[must_use]
pub fn to_json(source: &SourceThread) -> Value {
    let f = source.figures().snapshot();
    let kinds: serde_json::Map<String, Value> = Fault::ALL
        .iter()
        .zip(f.bad_by_kind)
        .filter(|(_, n)| *n > 0)
        .map(|(fault, n)| (fault.name().to_owned(), n.into()))
        .collect();
    json!({
        "name": source.name(), "good": f.good, "bad": f.bad, "bad_by_kind": kinds,
        "ignored": f.ignored, "dropped": f.dropped, "reopened": f.reopened,
        "device_faults": f.faults, "foreign": f.foreign,
    })
}

impl From<BusError> for Failure {
    fn from(e: BusError) -> Self {
        Self::new(Kind::Device, e.what(), e.why(), e.todo()).caused_by(e.into_source())
    }
}
