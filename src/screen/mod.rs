//! Where pictures go: a surface of the display controller (KMS), or nowhere (headless, read back by who draws).
//!
//! A [`Screen`] owns the GL context and keeps it current on the thread that opened it. Once per frame a loop
//! 1. draws, into the window target, or into an off-screen target where [`Screen::is_headless`] (and, for a smoothed
//!    picture, where it is not: `Target::copy_to` then takes it to the window target);
//! 2. calls [`Screen::present`] and takes the time the frame became visible from the [`Flip`].
//!
//! On KMS `present` returns when the frame is on the glass: it paces the loop, and state read right after it is as fresh
//! as can be. A headless screen returns at once and the loop paces itself. Nothing here allocates per frame.
//!
//! Drop GL objects and the `Gpu` before the screen.
#![expect(
    unsafe_code,
    reason = "a hazard module: EGL, OSMesa and KMS are foreign code"
)]

mod egl;
mod error;
#[cfg(feature = "kms")]
pub mod kms;
pub mod osmesa;
pub mod surfaceless;
pub mod wishes;

use std::ffi::{CStr, c_void};
use std::fmt;

use crate::time::Monotonic;

pub use error::ScreenError;
pub use wishes::{ModeWish, Wishes};

/// What happened to a frame that was presented.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Flip {
    /// When the frame became visible (headless: when `present` was called).
    pub at: Monotonic,
    /// Frames presented since the screen was opened, from 1.
    pub sequence: u64,
    /// Refreshes that showed the frame before once more, because this one was not ready for them (headless: 0).
    pub missed: u32,
}

/// Something to show frames on. Not `Send`: the GL context is current on the thread that opened it.
pub trait Screen: fmt::Debug {
    /// Width and height in pixels; they never change.
    fn size_px(&self) -> (u32, u32);

    /// The address of a GL function, null where there is none. For `Gpu::new`.
    fn gl_proc(&self, name: &CStr) -> *const c_void;

    /// Is there nothing to look at? Then draw into an off-screen target and read it back; else into the window target.
    fn is_headless(&self) -> bool;

    /// One line for logs: what it is and where it shows.
    fn describe(&self) -> String;

    /// Shows what was drawn into the window target.
    ///
    /// # Errors
    /// [`ScreenError`] where the display controller fails; the screen is then of no further use.
    fn present(&mut self) -> Result<Flip, ScreenError>;
}

/// Which kind of screen.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// The display of this machine if there is one that nobody holds, else headless on EGL.
    Auto(Wishes),
    /// The display of this machine.
    Kms(Wishes),
    /// Headless, on EGL.
    Surfaceless,
    /// Headless, on OSMesa.
    OsMesa,
}

/// Opens a screen. `headless_size_px`: width and height of a headless one; a display has its mode's.
///
/// # Errors
/// [`ScreenError`] of the kind asked for; [`Kind::Auto`] fails only if it cannot be headless either.
pub fn open(kind: &Kind, headless_size_px: (u32, u32)) -> Result<Box<dyn Screen>, ScreenError> {
    let (width, height) = headless_size_px;
    match kind {
        Kind::Kms(wishes) => open_kms(wishes),
        Kind::Auto(wishes) => open_kms(wishes).or_else(|why| {
            // A machine without a display is what headless is for; one whose display refuses wants a word.
            match why {
                ScreenError::NoDisplay { .. } => tracing::info!("drawing headless: {why}"),
                _ => tracing::warn!("drawing headless: {why}"),
            }
            Ok(Box::new(surfaceless::open(width, height)?) as Box<dyn Screen>)
        }),
        Kind::Surfaceless => Ok(Box::new(surfaceless::open(width, height)?)),
        Kind::OsMesa => Ok(Box::new(osmesa::open(width, height)?)),
    }
}

#[cfg(feature = "kms")]
fn open_kms(wishes: &Wishes) -> Result<Box<dyn Screen>, ScreenError> {
    Ok(Box::new(kms::open(wishes)?))
}

#[cfg(not(feature = "kms"))]
fn open_kms(_wishes: &Wishes) -> Result<Box<dyn Screen>, ScreenError> {
    Err(ScreenError::NoDisplay {
        tried: "this program was built without the feature kms".to_owned(),
    })
}
