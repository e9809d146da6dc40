//! Everything that calls OpenGL ES 3.0. Objects delete themselves; nothing outside this module names a GL function.
//!
//! A [`Gpu`] stands for the context that is current on this thread. It lives in an `Rc`, so neither it nor any object
//! made from it can leave the thread: that is the argument of every `unsafe` block below this module. Drop the objects
//! and the `Gpu` before the screen that made the context.
//!
//! Only what GLES 3.0 core has is used, so that the same calls run on the boards, on llvmpipe and on a desktop core 3.3
//! context (OSMesa). Sources: OpenGL ES 3.0.6 specification; OpenGL ES Shading Language 3.00.6.
#![expect(
    unsafe_code,
    reason = "a hazard module: every GL function is unsafe to call"
)]
#![expect(
    clippy::multiple_unsafe_ops_per_block,
    reason = "a run of GL calls rests on one argument: the context is current on this thread"
)]

pub mod buffer;
pub mod caps;
pub mod feedback;
pub mod globe;
pub mod level_textures;
pub mod look;
pub mod program;
pub mod scenery;
pub mod sky;
pub mod target;
pub mod terrain;
pub mod texture;
pub mod vector;

use std::ffi::{CStr, c_char, c_void};
use std::rc::Rc;

use glow::HasContext as _;

pub use caps::{Caps, Flavour};

/// What went wrong with the GPU. All of these end the program at start-up, except [`GlError::Call`], which is looked
/// for after start-up in debug builds only.
#[derive(Debug, thiserror::Error)]
pub enum GlError {
    /// The context is missing or older than ES 3.0 / core 3.3.
    #[error(
        "GL context: {found}; OpenGL ES 3.0 or desktop OpenGL 3.3 is needed (check the GPU driver)"
    )]
    TooOld {
        /// The version string the driver gave, or what was missing.
        found: String,
    },
    /// A shader does not compile or a program does not link.
    #[error("shader {name}: {stage} failed: {log}")]
    Shader {
        /// The program's name.
        name: &'static str,
        /// `vertex shader`, `fragment shader` or `linking`.
        stage: &'static str,
        /// The driver's log, trimmed.
        log: String,
    },
    /// A program has no uniform, sampler or block of that name (misspelt, or unused and therefore removed).
    #[error("shader {name}: no uniform `{uniform}`")]
    Uniform {
        /// The program's name.
        name: &'static str,
        /// The name looked up.
        uniform: String,
    },
    /// The driver gave no object, usually for want of memory, or a size is beyond the GPU's limits.
    #[error("{what}: {why}")]
    Object {
        /// The object and its size.
        what: String,
        /// The driver's words, or the limit passed.
        why: String,
    },
    /// `glGetError` reported an error.
    #[error("GL error {code} ({code:#06x}) {doing}")]
    Call {
        /// What was being done, as in `while drawing the sky`.
        doing: &'static str,
        /// The error code, as in `GL_INVALID_OPERATION` = 0x0502.
        code: u32,
    },
}

/// The context that is current on this thread, with what it can do.
#[derive(Debug)]
pub struct Gpu {
    gl: glow::Context,
    caps: Caps,
    /// Desktop core profiles draw nothing without a vertex array; this one is bound when no other is. ES has one of its
    /// own, called none.
    spare_vertex_array: Option<glow::VertexArray>,
}

impl Gpu {
    /// Takes the context that is current on this thread. `loader` gives the address of a GL function by its name
    /// (`screen.gl_proc`). Sets the states in which desktop GL differs from ES, and byte-wise pixel rows.
    ///
    /// # Errors
    /// [`GlError::TooOld`] without a current context of ES 3.0 or core 3.3; [`GlError::Call`] if the driver reports an
    /// error during start-up.
    pub fn new(loader: &dyn Fn(&CStr) -> *const c_void) -> Result<Rc<Self>, GlError> {
        probe_version(loader)?;
        // SAFETY: probe_version has shown that a context is current and that `loader` resolves its functions.
        let gl = unsafe { glow::Context::from_loader_function_cstr(|name| loader(name)) };
        let caps = Caps::read(&gl)?;
        let mut spare_vertex_array = None;
        // SAFETY: the context is current on this thread (shown above), and these calls take no pointers.
        unsafe {
            gl.pixel_store_i32(glow::UNPACK_ALIGNMENT, 1);
            gl.pixel_store_i32(glow::PACK_ALIGNMENT, 1);
            gl.disable(glow::DITHER);
            if caps.flavour == Flavour::DesktopCore33 {
                // ES has gl_PointSize always; here it must be switched on. FRAMEBUFFER_SRGB stays off (its default):
                // no target of ours is sRGB.
                gl.enable(glow::PROGRAM_POINT_SIZE);
                let made = gl.create_vertex_array().map_err(|why| GlError::Object {
                    what: "vertex array".into(),
                    why,
                })?;
                spare_vertex_array = Some(made);
            }
        }
        let gpu = Rc::new(Self {
            gl,
            caps,
            spare_vertex_array,
        });
        gpu.bind_no_vertex_array();
        gpu.check("while starting")?;
        Ok(gpu)
    }

    /// What this GPU can do; read once.
    #[must_use]
    pub const fn caps(&self) -> &Caps {
        &self.caps
    }

    /// The functions, for the modules of [`crate::gl`].
    pub(in crate::gl) const fn gl(&self) -> &glow::Context {
        &self.gl
    }

    /// Takes away the bound vertex array, so that binding an index buffer cannot change it.
    pub(in crate::gl) fn bind_no_vertex_array(&self) {
        // SAFETY: the context is current on this thread (Gpu is !Send); the spare array lives as long as the Gpu.
        unsafe { self.gl.bind_vertex_array(self.spare_vertex_array) };
    }

    /// Clears colour and depth of the bound target. `rgba`: red, green, blue, opacity, 0 to 1.
    pub fn clear(&self, rgba: [f32; 4]) {
        let [red, green, blue, alpha] = rgba;
        // SAFETY: the context is current on this thread (Gpu is !Send); no pointers.
        unsafe {
            self.gl.clear_color(red, green, blue, alpha);
            self.gl.depth_mask(true);
            self.gl
                .clear(glow::COLOR_BUFFER_BIT | glow::DEPTH_BUFFER_BIT);
        }
    }

    /// Clears the bound target's depth alone.
    pub fn clear_depth(&self) {
        // SAFETY: the context is current on this thread (Gpu is !Send); no pointers.
        unsafe {
            self.gl.depth_mask(true);
            self.gl.clear(glow::DEPTH_BUFFER_BIT);
        }
    }

    /// Tests depth (nearer wins, equal depths keep what is there) and writes it, or does neither. The depth function is
    /// never changed: mixing directions costs V3D its early rejection for the whole frame.
    pub fn depth_test(&self, on: bool) {
        // SAFETY: the context is current on this thread (Gpu is !Send).
        unsafe {
            if on {
                self.gl.enable(glow::DEPTH_TEST);
            } else {
                self.gl.disable(glow::DEPTH_TEST);
            }
        }
    }

    /// Waits until everything drawn so far is finished. For measurements and read-back, not for the frame loop.
    pub fn finish(&self) {
        // SAFETY: the context is current on this thread (Gpu is !Send).
        unsafe { self.gl.finish() };
    }

    /// Asks the driver for an error. `doing` completes the sentence, as in `while loading the atlas`.
    ///
    /// # Errors
    /// [`GlError::Call`] with the first error reported since the last check.
    pub fn check(&self, doing: &'static str) -> Result<(), GlError> {
        // SAFETY: the context is current on this thread (Gpu is !Send).
        let code = unsafe { self.gl.get_error() };
        if code == glow::NO_ERROR {
            return Ok(());
        }
        // A driver may keep one error per kind; leave none behind for the next check. Bounded, because a lost context
        // reports errors for ever.
        for _ in 0..8 {
            // SAFETY: as above.
            if unsafe { self.gl.get_error() } == glow::NO_ERROR {
                break;
            }
        }
        Err(GlError::Call { doing, code })
    }

    /// To be called once after the last draw of a frame: debug builds look for an error, release builds do nothing
    /// (asking makes some drivers wait).
    ///
    /// # Errors
    /// [`GlError::Call`], in debug builds.
    pub fn end_frame(&self) -> Result<(), GlError> {
        if cfg!(debug_assertions) {
            self.check("while drawing a frame")
        } else {
            Ok(())
        }
    }
}

impl Drop for Gpu {
    fn drop(&mut self) {
        if let Some(spare) = self.spare_vertex_array {
            // SAFETY: the context is current on this thread (Gpu is !Send); every other object held an Rc and is gone.
            unsafe { self.gl.delete_vertex_array(spare) };
        }
    }
}

/// glow panics where there is no context, so look for its version first.
fn probe_version(loader: &dyn Fn(&CStr) -> *const c_void) -> Result<(), GlError> {
    const GL_VERSION: u32 = glow::VERSION;
    type GetString = unsafe extern "system" fn(u32) -> *const c_char;
    let address = loader(c"glGetString");
    let missing = |what: &str| GlError::TooOld { found: what.into() };
    if address.is_null() {
        return Err(missing("no function glGetString"));
    }
    // SAFETY: the address is not null and the loader gives GL functions; glGetString has had this type since GL 1.0.
    let get_string = unsafe { std::mem::transmute::<*const c_void, GetString>(address) };
    // SAFETY: glGetString takes any value and gives null without a current context.
    let version = unsafe { get_string(GL_VERSION) };
    if version.is_null() {
        return Err(missing("no context is current"));
    }
    // SAFETY: not null, and GL promises a static string that ends in NUL.
    let version = unsafe { CStr::from_ptr(version) }.to_string_lossy();
    if !version.contains(|c: char| c.is_ascii_digit()) {
        return Err(missing(&version));
    }
    Ok(())
}
