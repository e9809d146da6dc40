//! Terrain, from elevation files to the numbers a frame is drawn from.
//!
//! On the bench: [`input`] reads elevation files, [`bake`] makes them one grid of posts ([`grid`]) in levels and tiles, and
//! [`store`] writes the pack. In flight: [`pack`] reads tiles on the streaming thread ([`worker`]), [`surface`] makes texels
//! of them, [`stream`] keeps what is resident following the eye ([`clipmap`]), and [`scene`] plans a frame: which levels, how
//! far ([`reach`]), cut into which blocks ([`blocks`], [`cull`]), placed by which tables ([`tables`]); [`world`] has a scene for each
//! [`partition`] of the Earth and chooses the one to draw. [`crate::gl::terrain`] draws it.

pub mod archive;
pub mod bake;
pub mod bake_cap;
pub mod bake_cell;
pub mod bake_fill;
pub mod bake_levels;
mod bake_measure;
mod bake_mosaic;
mod bake_parts;
mod bake_plan;
pub mod bake_plate;
mod bake_posts;
mod bake_raise;
mod bake_summits;
mod bake_threads;
pub mod blocks;
pub mod budget;
pub mod clipmap;
pub mod codec;
pub mod credit;
pub mod cull;
pub mod dted;
pub mod geoid;
pub mod geotiff;
pub mod globe;
pub mod grid;
pub mod height;
pub mod hgt;
pub mod input;
pub mod join;
pub mod motion;
pub mod pack;
mod pack_format;
pub mod partition;
pub mod placement;
pub mod plain;
mod plan;
pub mod planet;
pub mod pyramid;
mod rans;
pub mod raster;
pub mod reach;
mod rings;
pub mod scene;
pub mod silhouette;
pub mod slices;
pub mod store;
pub mod stream;
pub mod surface;
pub mod synth;
pub mod synth_noise;
mod synth_valley;
pub mod tables;
pub mod texel;
mod tile_cache;
pub mod truth;
pub mod under;
pub mod utm;
pub mod worker;
pub mod world;
