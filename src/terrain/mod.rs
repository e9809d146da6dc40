//! Terrain: the pack and how it is made.

pub mod blocks;
pub mod clipmap;
pub mod codec;
pub mod cull;
pub mod geoid;
pub mod grid;
pub mod pack;
pub mod scene;
pub mod store;
pub mod stream;
pub mod surface;
pub mod tables;
pub mod worker;
