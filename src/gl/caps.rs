//! What the GPU can do: one documented field per question, read once at start.

use glow::HasContext as _;

use super::GlError;

/// Which family of OpenGL the context belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flavour {
    /// OpenGL ES 3.0 or later: the boards, and EGL anywhere.
    Es3,
    /// Desktop OpenGL, core profile 3.3 or later: OSMesa.
    DesktopCore33,
}

/// What the GPU can do.
#[derive(Clone, Debug)]
pub struct Caps {
    /// The family of OpenGL.
    pub flavour: Flavour,
    /// Who made the driver, as in `Mesa`.
    pub vendor: String,
    /// The GPU, as in `V3D 4.2` or `llvmpipe (LLVM 15.0.6, 256 bits)`.
    pub renderer: String,
    /// The driver's version string, as in `OpenGL ES 3.2 Mesa 22.3.6`.
    pub version: String,
    /// Does the CPU draw (llvmpipe, softpipe, swrast)?
    pub is_software: bool,
    /// The longest side of a 2D texture, texels. GLES 3.0 promises 2048; the V3D of a Raspberry Pi 4 has 4096.
    pub texture_size_max: u32,
    /// The widest and highest viewport, pixels. GLES promises what a display has.
    pub viewport_max: [u32; 2],
    /// The most samples per pixel of a renderbuffer. GLES 3.0 promises 4; softpipe has 1. Given as 0 for llvmpipe on
    /// aarch64, which ends with a segmentation fault in its own compiled code when it draws terrain with four samples and
    /// depth (Mesa 22.3.6, LLVM 15.0.6, under emulation; the same draws pass on x86-64, and on aarch64 without samples).
    pub samples_max: u32,
    /// Textures a vertex shader may read. GLES 3.0 promises 16.
    pub vertex_textures_max: u32,
    /// The highest anisotropy of a texture filter (a ratio), or `None` without `EXT_texture_filter_anisotropic`.
    pub anisotropy_max: Option<f32>,
}

/// `GL_MAX_TEXTURE_MAX_ANISOTROPY_EXT`.
const MAX_TEXTURE_MAX_ANISOTROPY: u32 = 0x84FF;

impl Caps {
    pub(super) fn read(gl: &glow::Context) -> Result<Self, GlError> {
        let text = |name| {
            // SAFETY: Gpu::new calls this with its context current.
            unsafe { gl.get_parameter_string(name) }
        };
        let number = |name| {
            // SAFETY: as above; every name asked for has one value.
            let value = unsafe { gl.get_parameter_i32(name) };
            u32::try_from(value).unwrap_or(0)
        };
        let mut viewport_max = [0_i32; 2];
        // SAFETY: as above; this name has two values.
        unsafe { gl.get_parameter_i32_slice(glow::MAX_VIEWPORT_DIMS, &mut viewport_max) };
        let (version, renderer) = (text(glow::VERSION), text(glow::RENDERER));
        let found = gl.version();
        let (flavour, needed) = if found.is_embedded {
            (Flavour::Es3, (3, 0))
        } else {
            (Flavour::DesktopCore33, (3, 3))
        };
        if (found.major, found.minor) < needed {
            return Err(GlError::TooOld {
                found: format!("{renderer} offers {version}"),
            });
        }
        let extensions = gl.supported_extensions();
        let anisotropic = [
            "GL_EXT_texture_filter_anisotropic",
            "GL_ARB_texture_filter_anisotropic",
        ]
        .iter()
        .any(|name| extensions.contains(*name));
        let anisotropy_max = anisotropic.then(|| {
            // SAFETY: as above; the extension that defines the name is there.
            unsafe { gl.get_parameter_f32(MAX_TEXTURE_MAX_ANISOTROPY) }
        });
        let is_software = ["llvmpipe", "softpipe", "swrast", "SWR", "Software"]
            .iter()
            .any(|name| renderer.contains(name));
        Ok(Self {
            flavour,
            vendor: text(glow::VENDOR),
            version,
            is_software,
            viewport_max: viewport_max.map(|side| u32::try_from(side).unwrap_or(0)),
            texture_size_max: number(glow::MAX_TEXTURE_SIZE),
            samples_max: if cfg!(target_arch = "aarch64") && renderer.contains("llvmpipe") {
                0
            } else {
                number(glow::MAX_SAMPLES)
            },
            vertex_textures_max: number(glow::MAX_VERTEX_TEXTURE_IMAGE_UNITS),
            anisotropy_max,
            renderer,
        })
    }
}
