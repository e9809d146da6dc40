//! Terrain: the pack and how it is made.

pub mod archive;
pub mod bake;
pub mod bake_cell;
pub mod bake_fill;
pub mod bake_levels;
pub mod codec;
pub mod geoid;
pub mod geotiff;
pub mod grid;
pub mod height;
pub mod hgt;
pub mod input;
pub mod pack;
pub mod raster;
pub mod store;
pub mod synth;
pub mod synth_noise;
mod synth_valley;
