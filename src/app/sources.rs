//! Where buses meet protocols: starts the listening thread of each source.

use super::board::{self, Board, SourceWish};
use super::error::{Failure, Kind};
use crate::bus::{
    self, BAD_KINDS, BusError, Decode, Endpoint, Event, Link, SourceConfig, SourceFigures,
    SourceHandle, SourceThread, Tally,
};
use crate::proto::{Counters, Decoder, Fault, Protocol};
use crate::recording::Tap;
use crate::signal::{Signal, SourceId, Wire};
use crate::state::Fusion;
use serde_json::{Value, json};
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;

/// Listens to a source of a board file, the one at `index` of its list. See [`bus::spawn`].
///
/// # Errors
/// When it cannot be opened; names the file and the key.
pub fn listen_to(board: &Board, index: usize, wish: &SourceWish) -> Result<SourceHandle, Failure> {
    let opened = bus::spawn(config(index, wish), decode(wish.decoder(), None));
    opened.map_err(|e| refusal(board, index, wish, e))
}

/// Listens to a source of a board file, or waits until it can be listened to, which is then told in the log; see
/// [`bus::spawn_patiently`]. What it says is recorded where there is a recording.
///
/// # Errors
/// When it can never be opened; names the file and the key.
pub fn listen_or_wait(
    board: &Board,
    index: usize,
    wish: &SourceWish,
    tap: Option<Tap>,
) -> Result<SourceHandle, Failure> {
    wait_with(
        board,
        index,
        wish,
        config(index, wish),
        decode(wish.decoder(), tap),
    )
}

/// Records everything that comes from a source of a board file, decoding it only to count what is good; waits for the
/// source until it can be opened.
///
/// # Errors
/// When it can never be opened; names the file and the key.
pub fn record(
    board: &Board,
    index: usize,
    wish: &SourceWish,
    tap: Option<Tap>,
) -> Result<SourceHandle, Failure> {
    let mut config = config(index, wish);
    if let Endpoint::Can { interface, .. } = config.endpoint {
        config.endpoint = Endpoint::WholeCan { interface };
    }
    let mut decode = decode(wish.decoder(), tap);
    let unheard: Decode = Box::new(move |frame, _| decode(frame, &mut |_: Signal| ()));
    wait_with(board, index, wish, config, unheard)
}

fn wait_with(
    board: &Board,
    index: usize,
    wish: &SourceWish,
    config: SourceConfig,
    decode: Decode,
) -> Result<SourceHandle, Failure> {
    let refused = |e| refusal(board, index, wish, e);
    let (handle, waiting) = bus::spawn_patiently(config, decode).map_err(refused)?;
    if let Some(e) = waiting {
        let name = &wish.name;
        tracing::warn!(
            "source {name} is closed, and opened as soon as it can be: {}",
            refusal(board, index, wish, e)
        );
    }
    Ok(handle)
}

fn config(index: usize, wish: &SourceWish) -> SourceConfig {
    SourceConfig {
        name: wish.name.clone(),
        // A board file has at most SOURCES_MAX sources, which fit a byte.
        id: SourceId(u8::try_from(index).unwrap_or(u8::MAX)),
        endpoint: match &wish.endpoint {
            board::Endpoint::Udp { bind, allow } => Endpoint::Udp {
                bind: *bind,
                allow: allow.clone(),
            },
            board::Endpoint::Can { interface } => Endpoint::Can {
                interface: interface.clone(),
                ids: wish.protocol.can_ids(),
            },
            board::Endpoint::Serial { path, baud } => Endpoint::Serial {
                path: path.clone(),
                baud: *baud,
            },
        },
    }
}

/// A source that refuses, as the failure that names file and key.
#[must_use]
pub fn refusal(board: &Board, index: usize, wish: &SourceWish, e: BusError) -> Failure {
    let key = match &e {
        BusError::SpeedRefused { .. } => "baud",
        _ => wish.endpoint.key(),
    };
    let file = board.file.display();
    let what = format!("{file}: source[{index}].{key}: {}", e.what());
    failure(what, e)
}

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

/// Listens to a serial port. See [`bus::spawn`].
///
/// # Errors
/// When it is missing, held by another program, refused, or does not have the speed.
pub fn listen_serial(
    name: &str,
    id: SourceId,
    decoder: impl Into<Box<dyn Decoder>>,
    path: &str,
    baud: u32,
) -> Result<SourceHandle, BusError> {
    let path = path.to_owned();
    listen(name, id, decoder, Endpoint::Serial { path, baud })
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
    bus::spawn(config, decode(decoder.into(), None))
}

/// A bus's view of a decoder, and of a recording, which has every frame before the decoder does.
pub fn decode(mut decoder: Box<dyn Decoder>, mut tap: Option<Tap>) -> Decode {
    Box::new(move |frame, sink| {
        if let Some(tap) = &mut tap {
            tap.take(&frame);
        }
        match frame.wire {
            // Half a frame of before and half a one of now make none.
            Wire::Stream([]) => decoder.finish(),
            _ => decoder.push(frame, sink),
        }
        let counters = decoder.counters();
        Tally {
            good: counters.good,
            bad: bad_by_kind(counters),
            ignored: counters.ignored,
        }
    })
}

/// The fusion of sources that speak these protocols, the most trusted first.
#[must_use]
pub fn fusion(protocols: impl IntoIterator<Item = Protocol>) -> Fusion {
    // A board file has at most SOURCES_MAX sources, which fit a byte.
    let rows = (0..=u8::MAX).map(SourceId).zip(protocols);
    let (ids, protocols): (Vec<SourceId>, Vec<Protocol>) = rows.unzip();
    // A receiver of traffic says where nobody is, too, by going on about itself.
    let rows = ids.iter().zip(protocols);
    let traffic = rows.filter_map(|(id, protocol)| (protocol == Protocol::Gdl90).then_some(*id));
    let traffic: Vec<SourceId> = traffic.collect();
    Fusion::new(&ids).with_traffic_from(&traffic)
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
    let counted = |names: &mut dyn Iterator<Item = (&'static str, u64)>| -> Value {
        names
            .filter(|(_, n)| *n > 0)
            .map(|(name, n)| (name.to_owned(), n.into()))
            .collect::<serde_json::Map<_, _>>()
            .into()
    };
    let kinds = Fault::ALL.iter().map(|fault| fault.name());
    let kinds = kinds.zip(f.bad_by_kind);
    let mut kinds = kinds.chain([("oversized", f.oversized)]);
    let mut events = Event::ALL.iter().map(|e| e.name()).zip(f.events);
    json!({
        "name": source.name(), "state": f.link.name(),
        "good": f.good, "bad": f.bad, "bad_by_kind": counted(&mut kinds),
        "ignored": f.ignored, "kept_away": source.kept_away(), "foreign": f.foreign,
        "dropped": f.dropped, "reopened": f.reopened,
        "device_faults": f.faults, "device_events": counted(&mut events),
    })
}

/// Says in the log how devices fare, whenever that changes.
#[derive(Debug)]
pub struct Watch {
    rows: Vec<(String, Arc<SourceFigures>, Link)>,
}

impl Watch {
    /// Over these sources; how they fare now is known.
    #[must_use]
    pub fn new(sources: &[SourceThread]) -> Self {
        let row = |s: &SourceThread| {
            let link = s.figures().link();
            (s.name().to_owned(), Arc::clone(s.figures()), link)
        };
        Self {
            rows: sources.iter().map(row).collect(),
        }
    }

    /// Looks at all of them once.
    pub fn look(&mut self) {
        for (name, figures, known) in &mut self.rows {
            let link = figures.link();
            if link == *known {
                continue;
            }
            *known = link;
            match link {
                Link::Open => tracing::info!("source {name}: open again"),
                _ => tracing::warn!("source {name}: {}", link.name()),
            }
        }
    }
}

impl From<BusError> for Failure {
    fn from(e: BusError) -> Self {
        failure(e.what(), e)
    }
}

fn failure(what: String, e: BusError) -> Failure {
    let failure = Failure::new(Kind::Device, what, e.why(), e.todo());
    match e.into_source() {
        Some(source) => failure.caused_by(source),
        None => failure,
    }
}
