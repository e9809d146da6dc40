//! Terrain: the pack and how it is made.

pub mod codec;
pub mod geoid;
pub mod grid;
pub mod pack;
pub mod store;
