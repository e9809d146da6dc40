//! Where pictures go: a surface of the display controller (KMS), or nowhere (headless, read back by who draws).
//!
//! A [`Screen`] owns the GL context and keeps it current on the thread that opened it. A frame loop does, once per
//! frame: draw, `present`, take the time of the next frame from the [`Flip`]. On KMS `present` waits for the previous
//! flip, so it paces the loop; a headless screen returns at once and the loop paces itself.
//!
//! Drop GL objects and the `Gpu` before the screen. After construction nothing here allocates.
#![expect(
    unsafe_code,
    reason = "a hazard module: EGL, OSMesa and KMS are foreign code"
)]

mod egl;
mod error;
pub mod surfaceless;

use std::ffi::{CStr, c_void};
use std::fmt;

use crate::time::Monotonic;

pub use error::ScreenError;

/// What happened to a frame that was presented.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Flip {
    /// When the newest completed frame became visible (headless: when `present` was called).
    pub at: Monotonic,
    /// Frames presented since the screen was opened, from 1.
    pub sequence: u64,
    /// Refreshes of the display since the flip before this one that showed the old frame again, when it had been
    /// presented in time for none of them. 0 where the display does not count them.
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
