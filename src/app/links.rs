//! Which sources are out of order as a whole: by what their devices report, and by silence. Looked at before every picture.

use crate::bus::{Link, SourceFigures, SourceThread};
use crate::display::LinkFault;
use crate::limits::SOURCES_MAX;
use crate::signal::SourceId;
use crate::time::Monotonic;
use arrayvec::ArrayVec;
use std::sync::Arc;
use std::time::Duration;

/// A source without a good frame for this long is silent: three of the slowest that there are, one a second.
pub const SILENCE: Duration = Duration::from_secs(3);

/// What is known of each source.
#[derive(Debug)]
pub struct Links {
    rows: ArrayVec<Row, SOURCES_MAX>,
}

#[derive(Debug)]
struct Row {
    id: SourceId,
    figures: Arc<SourceFigures>,
    good: u64,
    heard: Monotonic,
}

impl Links {
    /// Over these sources, which have had since `now` to say something.
    #[must_use]
    pub fn new(sources: &[SourceThread], now: Monotonic) -> Self {
        let row = |s: &SourceThread| Row {
            id: s.id(),
            figures: Arc::clone(s.figures()),
            good: 0,
            heard: now,
        };
        Self {
            rows: sources.iter().take(SOURCES_MAX).map(row).collect(),
        }
    }

    /// What is wrong with each source at `now`, by its id.
    pub fn look(&mut self, now: Monotonic) -> [Option<LinkFault>; SOURCES_MAX] {
        let mut faults = [None; SOURCES_MAX];
        for row in &mut self.rows {
            let good = row.figures.good();
            if good != row.good {
                (row.good, row.heard) = (good, now);
            }
            let is_silent = now.since(row.heard).is_some_and(|age| age >= SILENCE);
            if let Some(fault) = faults.get_mut(usize::from(row.id.0)) {
                *fault = match row.figures.link() {
                    Link::Closed => Some(LinkFault::Closed),
                    Link::Down => Some(LinkFault::Down),
                    Link::BusOff => Some(LinkFault::BusOff),
                    Link::ErrorPassive => Some(LinkFault::Errors),
                    Link::Open | Link::ErrorWarning => is_silent.then_some(LinkFault::Silent),
                };
            }
        }
        faults
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::sources;
    use crate::bus::{Endpoint, loopback};
    use crate::proto::Protocol;
    use crate::proto::canaerospace::encode;
    use crate::signal::Parameter;

    #[test]
    fn a_source_is_silent_until_a_good_frame_comes_and_after_three_seconds_without() {
        let (mut bus, receiver) = loopback::bus(64);
        let source = sources::listen(
            "adahrs",
            SourceId(2),
            Protocol::CanAerospace,
            Endpoint::Loopback(receiver),
        );
        let source = source.unwrap_or_else(|e| unreachable!("{e:?}"));
        let start = Monotonic::read();
        let after = |ms| start.plus(Duration::from_millis(ms));
        let mut links = Links::new(std::slice::from_ref(&source.thread), start);
        let only = |links: &mut Links, ms| {
            let all = links.look(after(ms));
            let others = all.iter().zip(0..).filter(|(_, i)| *i != 2);
            assert!(others.map(|(f, _)| f).all(Option::is_none), "{all:?}");
            all[2]
        };
        assert_eq!(only(&mut links, 2999), None, "it may still speak");
        assert_eq!(only(&mut links, 3000), Some(LinkFault::Silent));
        let frame = encode(Parameter::Pitch, 0.1, 1, 0);
        let frame = frame.unwrap_or_else(|| unreachable!("it has an identifier"));
        assert!(bus.send(Monotonic::read(), frame).is_ok(), "room");
        while source.thread.figures().good() == 0 {
            std::thread::yield_now();
        }
        assert_eq!(only(&mut links, 4000), None, "it has spoken");
        assert_eq!(
            only(&mut links, 7000),
            Some(LinkFault::Silent),
            "and no more"
        );
    }
}
