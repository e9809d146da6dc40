#![doc = include_str!("ARCHITECTURE.md")]

// The allocator, counted. A hazard module.
pub mod heap;

// L0: vocabulary. Pure, no I/O.
pub mod angle;
pub mod atmosphere;
pub mod geo;
pub mod limits;
pub mod sampled;
pub mod signal;
pub mod time;
pub mod units;

// L1: wire to samples, and back.
pub mod bench;
pub mod bus;
pub mod proto;
pub mod recording;

// L2 to L4: state, what the pilot is told, how it is drawn. Pure.
pub mod display;
pub mod draw;
pub mod state;

// Terrain: pure but for its files and its thread.
pub mod terrain;

// L5: the hazards. GL, and the screens (EGL, OSMesa, KMS).
pub mod gl;
pub mod screen;

// L6: composition.
pub mod app;
