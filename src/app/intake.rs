//! From the rings of the bus threads to the flight state, on the frame loop's own thread just before it draws: the
//! shortest way, and ages are judged at the moment of the picture.

use crate::limits::{REPORTS_QUEUED_MAX, SIGNALS_QUEUED_MAX, SOURCES_MAX};
use crate::signal::{Report, Signal};
use crate::state::{FlightState, Fusion};
use crate::time::Monotonic;
use arrayvec::ArrayVec;

/// The rings and the fusion that they feed.
#[derive(Debug)]
pub struct Intake {
    rings: ArrayVec<rtrb::Consumer<Signal>, SOURCES_MAX>,
    reports: ArrayVec<rtrb::Consumer<Report>, SOURCES_MAX>,
    fusion: Fusion,
}

impl Intake {
    /// Reads up to [`SOURCES_MAX`] rings; a board file cannot name more sources.
    #[must_use]
    pub fn new(rings: impl IntoIterator<Item = rtrb::Consumer<Signal>>, fusion: Fusion) -> Self {
        Self {
            rings: rings.into_iter().take(SOURCES_MAX).collect(),
            reports: ArrayVec::new(),
            fusion,
        }
    }

    /// Reads also these rings, of the same sources.
    #[must_use]
    pub fn with_reports(self, reports: impl IntoIterator<Item = rtrb::Consumer<Report>>) -> Self {
        Self {
            reports: reports.into_iter().take(SOURCES_MAX).collect(),
            ..self
        }
    }

    /// Takes in what has come and gives the state at `now`. Neither waits nor allocates; at most a ring's capacity is
    /// taken from each, so that it ends however fast the buses are.
    pub fn step(&mut self, now: Monotonic) -> FlightState {
        for ring in &mut self.rings {
            for _ in 0..SIGNALS_QUEUED_MAX {
                let Ok(signal) = ring.pop() else {
                    break;
                };
                self.fusion.apply(&signal);
            }
        }
        for ring in &mut self.reports {
            for _ in 0..REPORTS_QUEUED_MAX {
                let Ok(report) = ring.pop() else {
                    break;
                };
                self.fusion.report(&report);
            }
        }
        self.fusion.step(now)
    }
}
