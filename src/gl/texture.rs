//! Two-dimensional textures of immutable size, written from byte slices.

use std::rc::Rc;

use glow::HasContext as _;

use super::{GlError, Gpu};

/// What a texel holds. All of these are in GLES 3.0 core with the access named.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Two 16-bit unsigned integers, read by `texelFetch` from a `usampler2D`; never filtered. 4 bytes.
    Rg16Ui,
    /// Four bytes as floats 0 to 1. 4 bytes.
    Rgba8,
    /// Two bytes as floats 0 to 1. 2 bytes.
    Rg8,
    /// One byte as a float 0 to 1. 1 byte.
    R8,
    /// Four 32-bit floats, read by `texelFetch`; never filtered (float filtering is no part of GLES 3.0). 16 bytes.
    Rgba32F,
}

impl Format {
    /// Bytes of one texel.
    #[must_use]
    pub const fn texel_bytes(self) -> usize {
        match self {
            Self::Rg16Ui | Self::Rgba8 => 4,
            Self::Rg8 => 2,
            Self::R8 => 1,
            Self::Rgba32F => 16,
        }
    }

    const fn can_filter(self) -> bool {
        matches!(self, Self::Rgba8 | Self::Rg8 | Self::R8)
    }

    /// Internal format, format and type of GLES 3.0.6, table 3.2.
    const fn gl(self) -> (u32, u32, u32) {
        match self {
            Self::Rg16Ui => (glow::RG16UI, glow::RG_INTEGER, glow::UNSIGNED_SHORT),
            Self::Rgba8 => (glow::RGBA8, glow::RGBA, glow::UNSIGNED_BYTE),
            Self::Rg8 => (glow::RG8, glow::RG, glow::UNSIGNED_BYTE),
            Self::R8 => (glow::R8, glow::RED, glow::UNSIGNED_BYTE),
            Self::Rgba32F => (glow::RGBA32F, glow::RGBA, glow::FLOAT),
        }
    }
}

/// How texels are blended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    /// The nearest texel.
    Nearest,
    /// Bilinear.
    Linear,
    /// Bilinear within the two nearest levels of detail and between them. The texture gets its smaller levels from
    /// [`Texture::write_detail`].
    Trilinear,
}

/// What lies beyond the edges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrap {
    /// The texture again.
    Repeat,
    /// The edge texels.
    Clamp,
}

/// A rectangle of texels: the first row written is `y`, the first texel of a row `x`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// First column.
    pub x: u32,
    /// First row.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// A texture.
#[derive(Debug)]
pub struct Texture {
    gpu: Rc<Gpu>,
    id: glow::Texture,
    format: Format,
    width: u32,
    height: u32,
}

impl Texture {
    /// A texture of `width` x `height` texels, its content undefined until written. Leaves it bound to unit 0.
    ///
    /// # Errors
    /// [`GlError::Object`] where a side is 0 or beyond the GPU's limit, or filtering is asked of a format that cannot be
    /// filtered; [`GlError::Call`] where the driver refuses.
    pub fn new(
        gpu: &Rc<Gpu>,
        format: Format,
        width: u32,
        height: u32,
        filter: Filter,
        wrap: Wrap,
    ) -> Result<Self, GlError> {
        let refuse = |why: String| GlError::Object {
            what: format!("texture of {width} x {height} ({format:?})"),
            why,
        };
        let longest = gpu.caps().texture_size_max;
        if width == 0 || height == 0 || width > longest || height > longest {
            return Err(refuse(format!(
                "sides of 1 to {longest} texels are possible"
            )));
        }
        if filter != Filter::Nearest && !format.can_filter() {
            return Err(refuse("this format cannot be filtered".into()));
        }
        let gl = gpu.gl();
        // SAFETY: the context is current on this thread (Gpu is !Send).
        let id = unsafe { gl.create_texture() }.map_err(refuse)?;
        let texture = Self {
            gpu: Rc::clone(gpu),
            id,
            format,
            width,
            height,
        };
        let (minify, magnify) = match filter {
            Filter::Nearest => (glow::NEAREST, glow::NEAREST),
            Filter::Linear => (glow::LINEAR, glow::LINEAR),
            Filter::Trilinear => (glow::LINEAR_MIPMAP_LINEAR, glow::LINEAR),
        };
        let levels = match filter {
            Filter::Trilinear => width.max(height).ilog2() + 1,
            Filter::Nearest | Filter::Linear => 1,
        };
        let wrap = match wrap {
            Wrap::Repeat => glow::REPEAT,
            Wrap::Clamp => glow::CLAMP_TO_EDGE,
        };
        texture.bind(0);
        let (internal, _, _) = format.gl();
        let (w, h) = (gl_i32(width), gl_i32(height));
        // SAFETY: the context is current on this thread (Gpu is !Send) and the texture is bound; no pointers.
        unsafe {
            gl.tex_storage_2d(glow::TEXTURE_2D, gl_i32(levels), internal, w, h);
            for (name, value) in [
                (glow::TEXTURE_MIN_FILTER, minify),
                (glow::TEXTURE_MAG_FILTER, magnify),
                (glow::TEXTURE_WRAP_S, wrap),
                (glow::TEXTURE_WRAP_T, wrap),
            ] {
                gl.tex_parameter_i32(glow::TEXTURE_2D, name, value.cast_signed());
            }
        }
        gpu.check("while making a texture")?;
        Ok(texture)
    }

    /// Overwrites `region` with `texels`: rows of `width` texels without padding, row `y` first, components in the
    /// byte order of the machine. Leaves the texture bound to unit 0.
    ///
    /// # Panics
    /// If the region leaves the texture or `texels` is not exactly its size: the owner knows both.
    pub fn write(&self, region: Region, texels: &[u8]) {
        self.write_detail(0, region, texels);
    }

    /// The same for a smaller level of detail of a [`Filter::Trilinear`] texture: level `k` has sides of `2^k`-th the
    /// length, rounded down, at least 1.
    ///
    /// # Panics
    /// As [`Self::write`].
    pub fn write_detail(&self, detail: u8, region: Region, texels: &[u8]) {
        let across = (self.width >> detail).max(1);
        let up = (self.height >> detail).max(1);
        let Region {
            x,
            y,
            width,
            height,
        } = region;
        let inside = x.checked_add(width).is_some_and(|right| right <= across)
            && y.checked_add(height).is_some_and(|bottom| bottom <= up);
        assert!(
            inside,
            "{region:?} outside level {detail} of a texture of {} x {}",
            self.width, self.height
        );
        assert_eq!(
            texels.len(),
            width as usize * height as usize * self.format.texel_bytes(),
            "bytes for {region:?} of {:?}",
            self.format
        );
        let (_, layout, kind) = self.format.gl();
        self.bind(0);
        // SAFETY: the context is current on this thread (Gpu is !Send); the texture is bound, the region lies inside it
        // and the slice has the region's size (checked above); rows are unpadded because UNPACK_ALIGNMENT is 1.
        unsafe {
            self.gpu.gl().tex_sub_image_2d(
                glow::TEXTURE_2D,
                i32::from(detail),
                gl_i32(x),
                gl_i32(y),
                gl_i32(width),
                gl_i32(height),
                layout,
                kind,
                glow::PixelUnpackData::Slice(Some(texels)),
            );
        }
    }

    /// Overwrites `region` with what stands at the same place in `image`, rows of `row_texels` texels from the texture's
    /// first; see [`Self::write`].
    ///
    /// # Panics
    /// If the region leaves the texture or the image: the owner knows both.
    pub fn write_from(&self, region: Region, image: &[u8], row_texels: u32) {
        let texel = self.format.texel_bytes();
        let at = |x: u32, y: u32| (y as usize * row_texels as usize + x as usize) * texel;
        let (right, top) = (region.x + region.width, region.y + region.height);
        assert!(
            region.height > 0 && right <= self.width && top <= self.height && right <= row_texels,
            "{region:?} outside a texture of {} x {} or rows of {row_texels}",
            self.width,
            self.height
        );
        let part = &image[at(region.x, region.y)..at(right, top - 1)];
        let (_, layout, kind) = self.format.gl();
        self.bind(0);
        let gl = self.gpu.gl();
        // SAFETY: the context is current on this thread (Gpu is !Send); the texture is bound, the region lies inside it,
        // and the slice reaches from its first texel to its last in rows of `row_texels` (checked above).
        unsafe {
            gl.pixel_store_i32(glow::UNPACK_ROW_LENGTH, gl_i32(row_texels));
            gl.tex_sub_image_2d(
                glow::TEXTURE_2D,
                0,
                gl_i32(region.x),
                gl_i32(region.y),
                gl_i32(region.width),
                gl_i32(region.height),
                layout,
                kind,
                glow::PixelUnpackData::Slice(Some(part)),
            );
            gl.pixel_store_i32(glow::UNPACK_ROW_LENGTH, 0);
        }
    }

    /// Overwrites the whole texture; see [`Self::write`].
    ///
    /// # Panics
    /// If `texels` is not exactly the texture's size.
    pub fn write_all(&self, texels: &[u8]) {
        let (width, height) = (self.width, self.height);
        self.write(
            Region {
                x: 0,
                y: 0,
                width,
                height,
            },
            texels,
        );
    }

    /// Lets samplers of unit `unit` read it.
    pub fn bind(&self, unit: u32) {
        let gl = self.gpu.gl();
        // SAFETY: the context is current on this thread (Gpu is !Send) and the texture is alive.
        unsafe {
            gl.active_texture(glow::TEXTURE0 + unit);
            gl.bind_texture(glow::TEXTURE_2D, Some(self.id));
        }
    }

    /// Columns and rows.
    #[must_use]
    pub const fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Bytes of memory of its largest level.
    #[must_use]
    pub const fn bytes(&self) -> usize {
        self.width as usize * self.height as usize * self.format.texel_bytes()
    }
}

impl Drop for Texture {
    fn drop(&mut self) {
        // SAFETY: the context is current on this thread (Gpu is !Send); nothing uses the texture after this.
        unsafe { self.gpu.gl().delete_texture(self.id) };
    }
}

/// A size as GL takes it; sizes were checked against the GPU's limit.
fn gl_i32(value: u32) -> i32 {
    i32::try_from(value).unwrap_or(0)
}
