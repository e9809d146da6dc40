//! Where a frame is drawn: a framebuffer of our own, smoothed by multisampling if wanted, or the screen's.

use std::rc::Rc;

use glow::HasContext as _;

use super::{GlError, Gpu};

/// Something to draw into: RGBA with 8 bits each, and 24 bits of depth.
#[derive(Debug)]
pub struct Target {
    gpu: Rc<Gpu>,
    width: u32,
    height: u32,
    /// What is drawn into; `None`: the screen's own.
    drawn: Option<Frame>,
    /// One sample per pixel, to read from; `None` where `drawn` can be read as it is.
    resolved: Option<Frame>,
    samples: u32,
}

impl Target {
    /// A target of our own. `samples` per pixel: 0 or 1 for none; more are reduced to what the GPU has
    /// ([`Self::samples`] tells).
    ///
    /// # Errors
    /// [`GlError`] where a side is 0 or beyond the GPU's limit, or the driver has no memory.
    pub fn offscreen(
        gpu: &Rc<Gpu>,
        width: u32,
        height: u32,
        samples: u32,
    ) -> Result<Self, GlError> {
        let longest = gpu.caps().texture_size_max;
        if width == 0 || height == 0 || width > longest || height > longest {
            return Err(GlError::Object {
                what: format!("target of {width} x {height}"),
                why: format!("sides of 1 to {longest} pixels are possible"),
            });
        }
        let samples = match samples.min(gpu.caps().samples_max) {
            0 | 1 => 0,
            more => more,
        };
        let drawn = Frame::new(gpu, width, height, samples, true)?;
        let resolved = if samples == 0 {
            None
        } else {
            Some(Frame::new(gpu, width, height, 0, false)?)
        };
        let target = Self {
            gpu: Rc::clone(gpu),
            width,
            height,
            drawn: Some(drawn),
            resolved,
            samples,
        };
        target.bind();
        gpu.check("while making a target")?;
        Ok(target)
    }

    /// The screen's own framebuffer, whose size the screen tells.
    #[must_use]
    pub fn window(gpu: &Rc<Gpu>, width: u32, height: u32) -> Self {
        Self {
            gpu: Rc::clone(gpu),
            width,
            height,
            drawn: None,
            resolved: None,
            samples: 0,
        }
    }

    /// Lets draws and clears go here, over its whole area.
    pub fn bind(&self) {
        let gl = self.gpu.gl();
        // SAFETY: the context is current on this thread (Gpu is !Send) and the framebuffer is alive.
        unsafe {
            gl.bind_framebuffer(glow::FRAMEBUFFER, self.drawn_id());
            gl.viewport(0, 0, gl_i32(self.width), gl_i32(self.height));
        }
    }

    /// Averages the samples of what was drawn, after the last draw of a frame. Without multisampling there is nothing
    /// to do. Depth is dropped: tiled GPUs then need not write it to memory.
    pub fn resolve(&self) {
        let gl = self.gpu.gl();
        // SAFETY: the context is current on this thread (Gpu is !Send) and both framebuffers are alive.
        unsafe {
            if let Some(resolved) = &self.resolved {
                gl.bind_framebuffer(glow::READ_FRAMEBUFFER, self.drawn_id());
                gl.bind_framebuffer(glow::DRAW_FRAMEBUFFER, Some(resolved.id));
                self.blit();
                gl.invalidate_framebuffer(
                    glow::READ_FRAMEBUFFER,
                    &[glow::COLOR_ATTACHMENT0, glow::DEPTH_ATTACHMENT],
                );
            } else if self.drawn.is_some() {
                gl.bind_framebuffer(glow::FRAMEBUFFER, self.drawn_id());
                gl.invalidate_framebuffer(glow::FRAMEBUFFER, &[glow::DEPTH_ATTACHMENT]);
            }
            gl.bind_framebuffer(glow::FRAMEBUFFER, self.drawn_id());
        }
    }

    /// Copies the resolved picture to `to`, which must have the same size.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn copy_to(&self, to: &Self) {
        assert_eq!(self.size_px(), to.size_px(), "targets of different size");
        self.resolve();
        let gl = self.gpu.gl();
        // SAFETY: the context is current on this thread (Gpu is !Send) and both framebuffers are alive.
        unsafe {
            gl.bind_framebuffer(glow::READ_FRAMEBUFFER, self.readable_id());
            gl.bind_framebuffer(glow::DRAW_FRAMEBUFFER, to.drawn_id());
            self.blit();
            gl.bind_framebuffer(glow::FRAMEBUFFER, to.drawn_id());
        }
    }

    /// Resolves and reads the picture: red, green, blue, opacity; rows from the top, each from the left, unpadded. Waits
    /// for the GPU.
    ///
    /// # Panics
    /// If `pixels` is not exactly width x height x 4 bytes long.
    pub fn read_rgba(&self, pixels: &mut [u8]) {
        let row_bytes = self.width as usize * 4;
        assert_eq!(
            pixels.len(),
            row_bytes * self.height as usize,
            "bytes for a picture of {} x {}",
            self.width,
            self.height
        );
        self.resolve();
        let gl = self.gpu.gl();
        // SAFETY: the context is current on this thread (Gpu is !Send); the slice has the picture's size (checked
        // above), rows are unpadded because PACK_ALIGNMENT is 1.
        unsafe {
            gl.bind_framebuffer(glow::READ_FRAMEBUFFER, self.readable_id());
            gl.read_pixels(
                0,
                0,
                gl_i32(self.width),
                gl_i32(self.height),
                glow::RGBA,
                glow::UNSIGNED_BYTE,
                glow::PixelPackData::Slice(Some(pixels)),
            );
            gl.bind_framebuffer(glow::FRAMEBUFFER, self.drawn_id());
        }
        // GL's first row is the lowest.
        let (upper, lower) = pixels.split_at_mut(row_bytes * (self.height as usize / 2));
        for (a, b) in upper
            .chunks_exact_mut(row_bytes)
            .zip(lower.chunks_exact_mut(row_bytes).rev())
        {
            a.swap_with_slice(b);
        }
    }

    /// Width and height in pixels.
    #[must_use]
    pub const fn size_px(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Samples per pixel it has in fact; 0 without multisampling.
    #[must_use]
    pub const fn samples(&self) -> u32 {
        self.samples
    }

    fn drawn_id(&self) -> Option<glow::Framebuffer> {
        self.drawn.as_ref().map(|frame| frame.id)
    }

    fn readable_id(&self) -> Option<glow::Framebuffer> {
        self.resolved
            .as_ref()
            .map_or_else(|| self.drawn_id(), |frame| Some(frame.id))
    }

    /// From the framebuffer bound for reading to the one bound for drawing, pixel by pixel.
    fn blit(&self) {
        let (w, h) = (gl_i32(self.width), gl_i32(self.height));
        // SAFETY: the context is current on this thread (Gpu is !Send); both bound framebuffers have this size.
        unsafe {
            self.gpu.gl().blit_framebuffer(
                0,
                0,
                w,
                h,
                0,
                0,
                w,
                h,
                glow::COLOR_BUFFER_BIT,
                glow::NEAREST,
            );
        }
    }
}

/// A framebuffer with its renderbuffers.
#[derive(Debug)]
struct Frame {
    gpu: Rc<Gpu>,
    id: glow::Framebuffer,
    colour: glow::Renderbuffer,
    depth: Option<glow::Renderbuffer>,
}

impl Frame {
    fn new(
        gpu: &Rc<Gpu>,
        width: u32,
        height: u32,
        samples: u32,
        with_depth: bool,
    ) -> Result<Self, GlError> {
        let refuse = |why: String| GlError::Object {
            what: format!("framebuffer of {width} x {height}, {samples} samples"),
            why,
        };
        let gl = gpu.gl();
        // SAFETY: the context is current on this thread (Gpu is !Send).
        let id = unsafe { gl.create_framebuffer() }.map_err(refuse)?;
        // SAFETY: as above.
        let colour = unsafe { gl.create_renderbuffer() }.map_err(refuse)?;
        let mut frame = Self {
            gpu: Rc::clone(gpu),
            id,
            colour,
            depth: None,
        };
        if with_depth {
            // SAFETY: as above.
            frame.depth = Some(unsafe { gl.create_renderbuffer() }.map_err(refuse)?);
        }
        let (w, h, n) = (gl_i32(width), gl_i32(height), gl_i32(samples));
        let parts = [
            (Some(colour), glow::COLOR_ATTACHMENT0, glow::RGBA8),
            (frame.depth, glow::DEPTH_ATTACHMENT, glow::DEPTH_COMPONENT24),
        ];
        // SAFETY: as above; the framebuffer and its renderbuffers are alive, and no pointers are passed.
        let status = unsafe {
            gl.bind_framebuffer(glow::FRAMEBUFFER, Some(id));
            for (part, attachment, format) in parts {
                if part.is_none() {
                    continue;
                }
                gl.bind_renderbuffer(glow::RENDERBUFFER, part);
                gl.renderbuffer_storage_multisample(glow::RENDERBUFFER, n, format, w, h);
                gl.framebuffer_renderbuffer(
                    glow::FRAMEBUFFER,
                    attachment,
                    glow::RENDERBUFFER,
                    part,
                );
            }
            gl.check_framebuffer_status(glow::FRAMEBUFFER)
        };
        if status == glow::FRAMEBUFFER_COMPLETE {
            return Ok(frame);
        }
        Err(refuse(format!("incomplete, status {status:#06x}")))
    }
}

impl Drop for Frame {
    fn drop(&mut self) {
        let gl = self.gpu.gl();
        // SAFETY: the context is current on this thread (Gpu is !Send); nothing uses these objects after this.
        unsafe {
            gl.delete_framebuffer(self.id);
            gl.delete_renderbuffer(self.colour);
            if let Some(depth) = self.depth {
                gl.delete_renderbuffer(depth);
            }
        }
    }
}

/// A size as GL takes it; sizes were checked against the GPU's limit.
fn gl_i32(value: u32) -> i32 {
    i32::try_from(value).unwrap_or(0)
}
