//! `glasswing measure`: figures of the terrain, each with how it was obtained.

pub mod bench;
pub mod drawn;
pub mod pop;
pub mod position;
pub mod surface;
pub mod watertight;
