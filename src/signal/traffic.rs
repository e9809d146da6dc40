//! Other aircraft, as a receiver reports them.

use super::SourceId;
use crate::time::Monotonic;

/// One report about one other aircraft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Traffic {
    /// When its frame was received.
    pub at: Monotonic,
    /// Who said it.
    pub source: SourceId,
    /// Its 24-bit address, where the receiver tells it.
    pub address: Option<u32>,
    /// Its call sign, padded with spaces; all spaces when unknown.
    pub callsign: [u8; 8],
    /// Where it is.
    pub place: Place,
    /// Direction of motion over the ground, clockwise from true north, rad, 0 to 2 pi.
    pub track_rad: Option<f64>,
    /// Over the ground, m/s.
    pub ground_speed_mps: Option<f64>,
    /// Up positive, m/s.
    pub vertical_speed_mps: Option<f64>,
    /// Whether it flies, where the receiver tells.
    pub airborne: Option<bool>,
    /// How near the receiver thinks it will come.
    pub alert: Alert,
}

/// Where another aircraft is: in the form that its receiver gives, since only the receiver knows its own place just then.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// On WGS 84.
    Geodetic {
        /// North positive, rad.
        latitude_rad: f64,
        /// East positive, rad, -pi to pi.
        longitude_rad: f64,
        /// Pressure altitude, m.
        pressure_altitude_m: Option<f64>,
    },
    /// From the own aircraft, true north up.
    Relative {
        /// m.
        north_m: f64,
        /// m.
        east_m: f64,
        /// m.
        up_m: f64,
    },
    /// At a distance from the own aircraft; the direction is not known.
    Around {
        /// m.
        distance_m: f64,
        /// m.
        up_m: f64,
    },
    /// As seen from the own aircraft.
    Bearing {
        /// From the own track, right positive, rad, -pi to pi.
        bearing_relative_rad: f64,
        /// m.
        distance_m: f64,
        /// m.
        up_m: f64,
    },
}

/// How near a receiver thinks that another aircraft will come.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Alert {
    /// No conflict.
    None,
    /// A conflict: GDL90's traffic alert, FLARM's level 1 (13 to 18 s).
    Low,
    /// FLARM's level 2 (9 to 12 s).
    Important,
    /// FLARM's level 3 (0 to 8 s).
    Urgent,
}
