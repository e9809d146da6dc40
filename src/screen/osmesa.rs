//! The second headless screen: OSMesa, which draws with a desktop core 3.3 context into a buffer of ours. It is there
//! for machines without EGL and as an independent check; the same shaders and calls run on it.
//!
//! Source: `GL/osmesa.h` of Mesa 22.3. The library is loaded at run time (Debian 12: libosmesa6).

use std::ffi::{CStr, c_char, c_int, c_uint, c_void};
use std::sync::OnceLock;

use libloading::Library;

use super::{Flip, Screen, ScreenError};
use crate::time::Monotonic;

const NAME: &str = "libOSMesa.so.8";
const NAMES: [&str; 3] = [NAME, "libOSMesa.so.6", "libOSMesa.so"];
const PACKAGE: &str = "libosmesa6";
const PLATFORM: &str = "OSMesa";

const OSMESA_FORMAT: c_int = 0x22;
const OSMESA_RGBA: c_int = 0x1908;
const OSMESA_DEPTH_BITS: c_int = 0x30;
const OSMESA_PROFILE: c_int = 0x33;
const OSMESA_CORE_PROFILE: c_int = 0x34;
const OSMESA_CONTEXT_MAJOR_VERSION: c_int = 0x36;
const OSMESA_CONTEXT_MINOR_VERSION: c_int = 0x37;
const GL_UNSIGNED_BYTE: c_uint = 0x1401;
const GL_TRUE: u8 = 1;

type OsMesaContext = *mut c_void;

/// The functions used, in a library that is never unloaded: GL function pointers taken from it stay valid to the end.
struct Api {
    create: unsafe extern "C" fn(*const c_int, OsMesaContext) -> OsMesaContext,
    make_current: unsafe extern "C" fn(OsMesaContext, *mut c_void, c_uint, c_int, c_int) -> u8,
    destroy: unsafe extern "C" fn(OsMesaContext),
    proc_address: unsafe extern "C" fn(*const c_char) -> *const c_void,
    _library: Library,
}

impl Api {
    fn load() -> Result<Self, String> {
        let mut failures = NAMES.iter().map(|name| {
            // SAFETY: the file is the system's OSMesa, which only sets itself up when loaded.
            unsafe { Library::new(name) }
        });
        let first = failures.next().ok_or("no name to look for")?;
        let library = match first {
            Ok(library) => library,
            // The first name is the usual one: its failure is the one to tell.
            Err(why) => failures
                .find_map(Result::ok)
                .ok_or_else(|| why.to_string())?,
        };
        // SAFETY: GL/osmesa.h declares OSMesaCreateContextAttribs with the type of the field.
        let create = *unsafe { library.get(b"OSMesaCreateContextAttribs\0") }.map_err(text)?;
        // SAFETY: likewise OSMesaMakeCurrent.
        let make_current = *unsafe { library.get(b"OSMesaMakeCurrent\0") }.map_err(text)?;
        // SAFETY: likewise OSMesaDestroyContext.
        let destroy = *unsafe { library.get(b"OSMesaDestroyContext\0") }.map_err(text)?;
        // SAFETY: likewise OSMesaGetProcAddress, whose result is a function pointer or null.
        let proc_address = *unsafe { library.get(b"OSMesaGetProcAddress\0") }.map_err(text)?;
        Ok(Self {
            create,
            make_current,
            destroy,
            proc_address,
            _library: library,
        })
    }

    fn get() -> Result<&'static Self, ScreenError> {
        static API: OnceLock<Result<Api, String>> = OnceLock::new();
        API.get_or_init(Self::load)
            .as_ref()
            .map_err(|why| ScreenError::Library {
                library: NAME,
                why: why.clone(),
                package: PACKAGE,
            })
    }
}

fn text(error: libloading::Error) -> String {
    error.to_string()
}

/// Can the library be loaded?
///
/// # Errors
/// [`ScreenError::Library`] where it cannot.
pub fn available() -> Result<(), ScreenError> {
    Api::get().map(|_api| ())
}

/// A headless screen on OSMesa.
pub struct OsMesa {
    api: &'static Api,
    context: OsMesaContext,
    /// OSMesa's own framebuffer, which must outlive the context; frames are drawn into off-screen targets instead.
    pixels: Vec<u8>,
    size_px: (u32, u32),
    presented: u64,
}

impl std::fmt::Debug for OsMesa {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("OsMesa")
            .field("size_px", &self.size_px)
            .field("presented", &self.presented)
            .finish_non_exhaustive()
    }
}

/// Opens one of `width` x `height` pixels.
///
/// # Errors
/// [`ScreenError`] without the library, or where it offers no core 3.3 context of that size.
pub fn open(width: u32, height: u32) -> Result<OsMesa, ScreenError> {
    let api = Api::get()?;
    let refused = |doing, why: &str| ScreenError::Driver {
        platform: PLATFORM.to_owned(),
        doing,
        why: why.to_owned(),
    };
    let size = "making a buffer for the context";
    let signed =
        |side: u32| c_int::try_from(side).map_err(|_overflow| refused(size, "size out of range"));
    let (w, h) = (signed(width)?, signed(height)?);
    let attributes = [
        OSMESA_FORMAT,
        OSMESA_RGBA,
        OSMESA_DEPTH_BITS,
        24,
        OSMESA_PROFILE,
        OSMESA_CORE_PROFILE,
        // Softpipe has no more than 3.3, and nothing beyond is used.
        OSMESA_CONTEXT_MAJOR_VERSION,
        3,
        OSMESA_CONTEXT_MINOR_VERSION,
        3,
        0,
        0,
    ];
    // SAFETY: the attribute list ends in a zero name, and no context is shared with.
    let context = unsafe { (api.create)(attributes.as_ptr(), std::ptr::null_mut()) };
    if context.is_null() {
        return Err(refused(
            "creating a core 3.3 context",
            "the library gave none",
        ));
    }
    let mut made = OsMesa {
        api,
        context,
        pixels: vec![0; width as usize * height as usize * 4],
        size_px: (width, height),
        presented: 0,
    };
    let pixels = made.pixels.as_mut_ptr().cast();
    // SAFETY: the buffer holds w x h pixels of 4 bytes, never moves or changes size, and lives longer than the context
    // (Drop destroys that first).
    let current = unsafe { (api.make_current)(context, pixels, GL_UNSIGNED_BYTE, w, h) };
    if current == GL_TRUE {
        Ok(made)
    } else {
        Err(refused(
            "making the context current",
            "the library refused this size",
        ))
    }
}

impl Drop for OsMesa {
    fn drop(&mut self) {
        // SAFETY: the context was made by this library and is used by this thread alone; nothing uses it after this.
        unsafe { (self.api.destroy)(self.context) };
    }
}

impl Screen for OsMesa {
    fn size_px(&self) -> (u32, u32) {
        self.size_px
    }

    fn gl_proc(&self, name: &CStr) -> *const c_void {
        // SAFETY: the name ends in NUL.
        unsafe { (self.api.proc_address)(name.as_ptr()) }
    }

    fn is_headless(&self) -> bool {
        true
    }

    fn describe(&self) -> String {
        let (width, height) = self.size_px;
        format!("headless, OSMesa, {width}x{height}")
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
