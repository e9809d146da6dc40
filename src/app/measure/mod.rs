//! `glasswing measure`: figures of the terrain, each with how it was obtained.

pub mod bench;
pub mod position;
pub mod watertight;
