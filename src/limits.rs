//! Every capacity and rate of the program, with where the number comes from. Ages and ranges of parameters stand in one
//! table of their own, in [`crate::signal`].

/// Sources in a board file. A light aircraft has four to six; the state keeps a slot per source and parameter.
pub const SOURCES_MAX: usize = 8;

/// Signals waiting between a bus thread and the frame loop. A saturated 1 Mbit/s CAN bus carries at most 1e6 / 47 bits = 21 300
/// frames a second (an empty 11-bit frame), one signal each: three quarters of a second, in
/// which the slowest frame that still counts as flying is drawn.
pub const SIGNALS_QUEUED_MAX: usize = 16_384;

/// Reports of other aircraft and of limits waiting between a bus thread and the frame loop: two seconds of the densest traffic
/// that a GDL90 receiver sends (about 120 aircraft a second over a busy airport).
pub const REPORTS_QUEUED_MAX: usize = 256;

/// Other aircraft remembered at once. Over a busy airport a receiver hears more; the least urgent and farthest are left out.
pub const TRAFFIC_HEARD_MAX: usize = 64;

/// Other aircraft handed to the display at once: more symbols than anybody can look for.
pub const TRAFFIC_SHOWN_MAX: usize = 12;

/// Bounds of parameters remembered: nine of airspeed and up to ten of each of a dozen engine parameters; CAN-FIX has no more.
pub const LIMITS_HEARD_MAX: usize = 128;

/// The longest datagram taken from a UDP socket: an Ethernet MTU of 1500 less 28 bytes of IP and UDP header. FlightGear's
/// longest is 552.
pub const DATAGRAM_BYTES_MAX: usize = 1472;

/// The most bytes taken from a serial port at once: what the kernel holds of a line (4096, `N_TTY_BUF_SIZE`).
pub const SERIAL_CHUNK_BYTES_MAX: usize = 4096;

/// Clipmap levels: 0 to 9 from 3" posts, 0 to 11 from 1". The coarsest have posts half a degree apart: 127 of them, the
/// fewest a board may ask for, reach 1000 km east and west at 70 degrees of latitude; the horizon from 20 km is at 505 km.
pub const LEVELS_MAX: usize = 12;

/// Vertices along the side of a level at the finest board setting.
pub const LEVEL_VERTICES_MAX: usize = 447;

/// Side of a terrain tile in a pack, in posts.
pub const TILE_POSTS: usize = 128;
