//! EGL: displays and OpenGL ES 3.0 contexts, loaded from `libEGL.so.1` at run time.
//!
//! Sources: EGL 1.5 specification; EGL_EXT_platform_base; EGL_MESA_platform_surfaceless; EGL_KHR_platform_gbm.
//! Drivers that report EGL 1.4 (softpipe) are served too: displays come from the extension's entry point.

use std::ffi::{CStr, c_void};
use std::sync::OnceLock;

use khronos_egl as egl;

use super::ScreenError;

type Api = egl::DynamicInstance<egl::EGL1_4>;

/// `EGL_PLATFORM_SURFACELESS_MESA`.
pub(super) const PLATFORM_SURFACELESS: egl::Enum = 0x31DD;

const CHECK_DRIVER: &str = "check the GPU driver: apt install libegl-mesa0 libgl1-mesa-dri";

/// The library. Loaded once and never unloaded: GL function pointers taken from it stay valid to the end.
fn api() -> Result<&'static Api, ScreenError> {
    static API: OnceLock<Result<Api, String>> = OnceLock::new();
    let loaded = API.get_or_init(|| {
        // SAFETY: the file is the system's EGL library, which has no effect on loading but to register itself.
        unsafe { Api::load_required() }.map_err(|e| e.to_string())
    });
    loaded.as_ref().map_err(|why| ScreenError::Library {
        library: "libEGL.so.1",
        why: why.clone(),
        package: "libegl1 libegl-mesa0",
    })
}

/// A display with a context of OpenGL ES 3.0, current on the thread that made it.
#[derive(Debug)]
pub(super) struct Context {
    api: &'static Api,
    display: egl::Display,
    context: egl::Context,
}

impl Context {
    /// A context without surfaces: frames are drawn into framebuffers of our own.
    pub(super) fn surfaceless() -> Result<Self, ScreenError> {
        let platform = "EGL surfaceless";
        let api = api()?;
        // SAFETY: this platform's native display is EGL_DEFAULT_DISPLAY, null.
        let display =
            unsafe { platform_display(api, platform, PLATFORM_SURFACELESS, std::ptr::null_mut())? };
        let config = initialize(api, platform, display).and_then(|()| {
            let wanted = [
                egl::SURFACE_TYPE,
                egl::PBUFFER_BIT,
                egl::RENDERABLE_TYPE,
                egl::OPENGL_ES3_BIT,
                egl::NONE,
            ];
            api.choose_first_config(display, &wanted)
                .map_err(|e| refused(platform, "asking for an OpenGL ES 3 configuration", e))?
                .ok_or_else(|| no_es3(platform, "no configuration with OpenGL ES 3 is offered"))
        })?;
        let context = create_context(api, platform, display, config)?;
        let made = Self {
            api,
            display,
            context,
        };
        api.make_current(display, None, None, Some(context))
            .map_err(|e| refused(platform, "making the context current", e))?;
        Ok(made)
    }

    /// The address of a GL function.
    pub(super) fn gl_proc(&self, name: &CStr) -> *const c_void {
        let Ok(name) = name.to_str() else {
            return std::ptr::null();
        };
        self.api
            .get_proc_address(name)
            .map_or(std::ptr::null(), |f| f as *const c_void)
    }
}

impl Drop for Context {
    fn drop(&mut self) {
        // Errors here have no remedy and no reader. The display is not terminated: EGL gives every caller of this
        // platform the same one, and other threads may have contexts on it.
        let _ = self.api.make_current(self.display, None, None, None);
        let _ = self.api.destroy_context(self.display, self.context);
    }
}

/// The display of a platform.
///
/// # Safety
/// `native` is what the platform's specification asks for, and outlives the display.
unsafe fn platform_display(
    api: &Api,
    platform: &str,
    kind: egl::Enum,
    native: *mut c_void,
) -> Result<egl::Display, ScreenError> {
    type GetPlatformDisplay =
        unsafe extern "system" fn(egl::Enum, *mut c_void, *const egl::Int) -> egl::EGLDisplay;
    let Some(address) = api.get_proc_address("eglGetPlatformDisplayEXT") else {
        return Err(no_es3(
            platform,
            "the library lacks eglGetPlatformDisplayEXT",
        ));
    };
    // SAFETY: EGL_EXT_platform_base defines the function of that name with this type.
    let get = unsafe { std::mem::transmute::<extern "system" fn(), GetPlatformDisplay>(address) };
    // SAFETY: the caller vouches for `native`; a null attribute list is allowed.
    let display = unsafe { get(kind, native, std::ptr::null()) };
    if display == egl::NO_DISPLAY {
        return Err(no_es3(platform, "the platform is not supported"));
    }
    // SAFETY: EGL has just given this display.
    Ok(unsafe { egl::Display::from_ptr(display) })
}

fn initialize(api: &Api, platform: &str, display: egl::Display) -> Result<(), ScreenError> {
    let version = api
        .initialize(display)
        .map_err(|e| refused(platform, "initialising the display", e))?;
    tracing::debug!(platform, ?version, "EGL display");
    Ok(())
}

fn create_context(
    api: &Api,
    platform: &str,
    display: egl::Display,
    config: egl::Config,
) -> Result<egl::Context, ScreenError> {
    api.bind_api(egl::OPENGL_ES_API)
        .map_err(|e| refused(platform, "choosing OpenGL ES", e))?;
    let wanted = [egl::CONTEXT_CLIENT_VERSION, 3, egl::NONE];
    api.create_context(display, config, None, &wanted)
        .map_err(|e| refused(platform, "creating an OpenGL ES 3 context", e))
}

fn refused(platform: &str, doing: &'static str, error: egl::Error) -> ScreenError {
    ScreenError::Egl {
        platform: platform.to_owned(),
        doing,
        why: error.to_string(),
        remedy: CHECK_DRIVER,
    }
}

fn no_es3(platform: &str, why: &str) -> ScreenError {
    ScreenError::Egl {
        platform: platform.to_owned(),
        doing: "looking for OpenGL ES 3",
        why: why.to_owned(),
        remedy: CHECK_DRIVER,
    }
}
