//! Every capacity and rate of the program, with where the number comes from. Ages and ranges of parameters stand in one
//! table of their own, in [`crate::signal`].

/// Sources in a board file. A light aircraft has four to six; the state keeps a slot per source and parameter.
pub const SOURCES_MAX: usize = 8;

/// Signals waiting between a bus thread and the frame loop. A saturated 1 Mbit/s CAN bus carries at most 1e6 / 47 bits = 21 300
/// frames a second (an empty 11-bit frame), one signal each: three quarters of a second, in
/// which the slowest frame that still counts as flying is drawn.
pub const SIGNALS_QUEUED_MAX: usize = 16_384;

/// The longest datagram taken from a UDP socket: an Ethernet MTU of 1500 less 28 bytes of IP and UDP header. FlightGear's
/// longest is 552.
pub const DATAGRAM_BYTES_MAX: usize = 1472;

/// Clipmap levels. With 3" posts at the finest level, level 7 has 6.4' posts; 255 of them span 27 degrees of latitude,
/// 1500 km to each side; the horizon from 20 km is at 505 km.
pub const LEVELS_MAX: usize = 10;

/// Vertices along the side of a level at the finest board setting.
pub const LEVEL_VERTICES_MAX: usize = 447;

/// Side of a terrain tile in a pack, in posts.
pub const TILE_POSTS: usize = 128;
