//! What the pilot is told: flight state, pilot settings and configuration in, one [`Model`] out.
//!
//! Pure and without memory: the same inputs give the same model. It decides for every field whether there is a value,
//! which one (with its label), and else why not; it never draws. Feet, knots and degrees of arc appear here for the first
//! time, through [`mod@format`], and the text of numbers is made only there.

pub mod air;
pub mod colour;
pub mod engine;
pub mod format;
mod model;
mod notes;
pub mod traffic;
mod ui;

pub use model::{
    Airspeed, AirspeedKind, Altitude, AltitudeKind, BaroBox, CameraHeight, CameraInputs, Heading,
    Model, North, PitchRoll, Slip, SvsOff,
};
pub use notes::{NOTES_MAX, Note, NoteKind, Notes};
pub use ui::{
    BaroSetting, BaroUnit, Config, LinkFault, SourceName, Terrain, TerrainCaution, Ui, VSpeeds,
    source_name,
};
