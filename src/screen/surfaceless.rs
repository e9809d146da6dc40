//! The primary headless screen: an OpenGL ES 3.0 context of EGL without any surface. The window target does not exist
//! here; frames are drawn into off-screen targets.

use std::ffi::{CStr, c_void};

use super::egl::Context;
use super::{Flip, Screen, ScreenError};
use crate::time::Monotonic;

/// A headless screen on EGL.
#[derive(Debug)]
pub struct Surfaceless {
    context: Context,
    size_px: (u32, u32),
    presented: u64,
}

/// Opens one of `width` x `height` pixels (the size its user is asked to draw at).
///
/// # Errors
/// [`ScreenError`] without `libEGL.so.1` or a driver that offers OpenGL ES 3.
pub fn open(width: u32, height: u32) -> Result<Surfaceless, ScreenError> {
    Ok(Surfaceless {
        context: Context::surfaceless()?,
        size_px: (width, height),
        presented: 0,
    })
}

impl Screen for Surfaceless {
    fn size_px(&self) -> (u32, u32) {
        self.size_px
    }

    fn gl_proc(&self, name: &CStr) -> *const c_void {
        self.context.gl_proc(name)
    }

    fn is_headless(&self) -> bool {
        true
    }

    fn describe(&self) -> String {
        let (width, height) = self.size_px;
        format!("headless, EGL surfaceless, {width}x{height}")
    }

    /// Nothing to show: counts the frame and returns.
    fn present(&mut self) -> Result<Flip, ScreenError> {
        self.presented += 1;
        Ok(Flip {
            at: Monotonic::read(),
            sequence: self.presented,
            missed: 0,
        })
    }
}
