//! Terrain: the pack and how it is made.

pub mod archive;
pub mod bake;
pub mod bake_cell;
pub mod bake_fill;
pub mod bake_levels;
pub mod blocks;
pub mod clipmap;
pub mod codec;
pub mod cull;
pub mod geoid;
pub mod geotiff;
pub mod grid;
pub mod height;
pub mod hgt;
pub mod input;
pub mod pack;
pub mod raster;
pub mod scene;
pub mod store;
pub mod stream;
pub mod surface;
pub mod tables;
pub mod worker;
