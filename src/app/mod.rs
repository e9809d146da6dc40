//! Composition: the command line, the board file, the threads and the frame loop.

pub mod board;
pub mod capture_feed;
pub mod check;
pub mod cli;
pub mod cockpit;
pub mod contact;
pub mod decode;
pub mod demo;
pub mod error;
pub mod figures;
pub mod fly;
pub mod frames;
pub mod health;
pub mod instruments;
pub mod intake;
pub mod links;
pub mod list;
pub mod measure;
pub mod out;
pub mod picture;
pub mod playback;
pub mod ports;
pub mod record;
pub mod replay;
pub mod run;
pub mod shot;
pub mod simulate;
pub mod sniff;
pub mod sources;
pub mod terrain;
pub mod terrain_bake;
pub mod terrain_info;
pub mod vision;
pub mod way;

pub use cli::main;
pub use error::{Failure, Kind};
