//! EGL: displays and OpenGL ES 3.0 contexts, loaded from `libEGL.so.1` at run time.
//!
//! Sources: EGL 1.5 specification; EGL_EXT_platform_base; EGL_MESA_platform_surfaceless; EGL_KHR_platform_gbm.
//! Drivers that report EGL 1.4 (softpipe) are served too: displays come from the extension's entry point.

use std::ffi::{CStr, c_void};
use std::os::fd::{BorrowedFd, RawFd};
use std::sync::OnceLock;

use khronos_egl as egl;
use rustix::ioctl::{NoArg, Opcode, ioctl};

use super::ScreenError;

type Api = egl::DynamicInstance<egl::EGL1_4>;

/// `EGL_PLATFORM_SURFACELESS_MESA`.
const PLATFORM_SURFACELESS: egl::Enum = 0x31DD;
/// `EGL_PLATFORM_GBM_KHR`.
#[cfg(feature = "kms")]
const PLATFORM_GBM: egl::Enum = 0x31D7;

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
    /// What frames are swapped on, where there is something to show on. Its display is then ours alone.
    #[cfg(feature = "kms")]
    window: Option<(egl::Surface, String)>,
}

impl Context {
    /// A context without surfaces: frames are drawn into framebuffers of our own.
    pub(super) fn surfaceless() -> Result<Self, ScreenError> {
        let platform = "EGL surfaceless";
        let api = api()?;
        // SAFETY: this platform's native display is EGL_DEFAULT_DISPLAY, null.
        let display =
            unsafe { platform_display(api, platform, PLATFORM_SURFACELESS, std::ptr::null_mut())? };
        let open_before = cards_open();
        let initialized = initialize(api, platform, display);
        give_up_control(&open_before);
        let config = initialized.and_then(|()| {
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
            #[cfg(feature = "kms")]
            window: None,
        };
        api.make_current(display, None, None, Some(context))
            .map_err(|e| refused(platform, "making the context current", e))?;
        Ok(made)
    }

    /// A context that draws into a GBM surface of the format `visual` (a DRM fourcc). `card` is for messages.
    ///
    /// # Safety
    /// `device` and `surface` are a live `gbm_device` and a live `gbm_surface` of it that outlive the context.
    #[cfg(feature = "kms")]
    pub(super) unsafe fn on_gbm(
        card: &str,
        device: *mut c_void,
        surface: *mut c_void,
        visual: u32,
    ) -> Result<Self, ScreenError> {
        let platform = format!("EGL on {card}");
        let api = api()?;
        // SAFETY: this platform's native display is a gbm_device; the caller vouches for it.
        let display = unsafe { platform_display(api, &platform, PLATFORM_GBM, device)? };
        let open = || {
            initialize(api, &platform, display)?;
            let config = window_config(api, &platform, display, visual)?;
            let context = create_context(api, &platform, display, config)?;
            // SAFETY: this platform's native window is a gbm_surface; the caller vouches for it.
            let window = unsafe { api.create_window_surface(display, config, surface, None) }
                .map_err(|e| refused(&platform, "making the display's surface", e))?;
            api.make_current(display, Some(window), Some(window), Some(context))
                .map_err(|e| refused(&platform, "making the context current", e))?;
            Ok((context, window))
        };
        let (context, window) = open().inspect_err(|_error| {
            // Takes everything made on it along, before the device it stands on goes.
            let _ = api.terminate(display);
        })?;
        Ok(Self {
            api,
            display,
            context,
            window: Some((window, platform)),
        })
    }

    /// Ends the frame: its buffer can be locked from then on.
    #[cfg(feature = "kms")]
    pub(super) fn swap(&self) -> Result<(), ScreenError> {
        let Some((window, platform)) = &self.window else {
            return Ok(());
        };
        self.api
            .swap_buffers(self.display, *window)
            .map_err(|e| refused(platform, "ending a frame", e))
    }

    /// Paints the window black, with the clear colour every context begins with.
    #[cfg(feature = "kms")]
    pub(super) fn clear_to_black(&self) {
        type Clear = unsafe extern "system" fn(u32);
        const GL_COLOR_BUFFER_BIT: u32 = 0x4000;
        let address = self.gl_proc(c"glClear");
        if !address.is_null() {
            // SAFETY: the loader gives GL functions, and glClear has had this type since GL 1.0.
            let clear = unsafe { std::mem::transmute::<*const c_void, Clear>(address) };
            // SAFETY: this context is current on this thread since it was made.
            unsafe { clear(GL_COLOR_BUFFER_BIT) };
        }
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
        // Errors here have no remedy and no reader. The display of the surfaceless platform is not terminated: EGL
        // gives every caller the same one, and other threads may have contexts on it.
        let _ = self.api.make_current(self.display, None, None, None);
        let _ = self.api.destroy_context(self.display, self.context);
        #[cfg(feature = "kms")]
        if let Some((window, _)) = &self.window {
            let _ = self.api.destroy_surface(self.display, *window);
            let _ = self.api.terminate(self.display);
        }
    }
}

/// The configuration for a window whose pixels have the format `visual`, with at least 24 bits of depth.
#[cfg(feature = "kms")]
fn window_config(
    api: &Api,
    platform: &str,
    display: egl::Display,
    visual: u32,
) -> Result<egl::Config, ScreenError> {
    let wanted = [
        egl::SURFACE_TYPE,
        egl::WINDOW_BIT,
        egl::RENDERABLE_TYPE,
        egl::OPENGL_ES3_BIT,
        egl::RED_SIZE,
        8,
        egl::GREEN_SIZE,
        8,
        egl::BLUE_SIZE,
        8,
        egl::DEPTH_SIZE,
        24,
        egl::NONE,
    ];
    let asking = "asking for a configuration the display can show";
    let mut configs = Vec::with_capacity(128);
    api.choose_config(display, &wanted, &mut configs)
        .map_err(|e| refused(platform, asking, e))?;
    // EGL lists those with more colour bits than asked for first; only the visual tells them apart.
    configs
        .into_iter()
        .find(|config| {
            api.get_config_attrib(display, *config, egl::NATIVE_VISUAL_ID)
                .is_ok_and(|id| id.cast_unsigned() == visual)
        })
        .ok_or_else(|| no_es3(platform, "no configuration with XRGB8888 and depth 24"))
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

/// The file descriptors of this process that are open on a card (not on its render node).
fn cards_open() -> Vec<RawFd> {
    let Ok(entries) = std::fs::read_dir("/proc/self/fd") else {
        return Vec::new();
    };
    entries
        .filter_map(Result::ok)
        .filter(|entry| {
            std::fs::read_link(entry.path())
                .is_ok_and(|to| to.to_string_lossy().starts_with("/dev/dri/card"))
        })
        .filter_map(|entry| entry.file_name().to_str()?.parse().ok())
        .collect()
}

/// Gives up control of cards opened since `before`. Where there is no GPU to render with, Mesa opens the card itself to
/// draw by software, and keeps it open; whoever opens a free card first controls the display, and a program that draws
/// for nobody to see must not.
fn give_up_control(before: &[RawFd]) {
    /// `DRM_IOCTL_DROP_MASTER`, `_IO('d', 0x1f)`.
    const DROP_MASTER: Opcode = 0x641F;
    for fd in cards_open() {
        if before.contains(&fd) {
            continue;
        }
        // SAFETY: EGL has just opened it and keeps it open as long as its display.
        let card = unsafe { BorrowedFd::borrow_raw(fd) };
        // SAFETY: the request takes no argument.
        let request = unsafe { NoArg::<DROP_MASTER>::new() };
        // SAFETY: DROP_MASTER has no effect but the one named; it fails where we have no control.
        let dropped = unsafe { ioctl(card, request) };
        tracing::debug!(fd, ?dropped, "EGL opened a card; control given up");
    }
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
    ScreenError::Driver {
        platform: platform.to_owned(),
        doing,
        why: error.to_string(),
    }
}

fn no_es3(platform: &str, why: &str) -> ScreenError {
    ScreenError::Driver {
        platform: platform.to_owned(),
        doing: "looking for OpenGL ES 3",
        why: why.to_owned(),
    }
}
