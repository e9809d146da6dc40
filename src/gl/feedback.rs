//! What a vertex shader really computes: transform feedback, read back. For measurements, not for flying.

use std::rc::Rc;

use bytemuck::Pod;
use glow::HasContext as _;

use super::{GlError, Gpu};

/// A buffer that takes what vertices put out, one record of `T` for each vertex.
#[derive(Debug)]
pub struct Recorder {
    gpu: Rc<Gpu>,
    id: glow::Buffer,
    capacity_bytes: usize,
}

impl Recorder {
    /// For at most `capacity_bytes` a recording.
    ///
    /// # Errors
    /// [`GlError`] where the driver has no memory for it.
    pub fn new(gpu: &Rc<Gpu>, capacity_bytes: usize) -> Result<Self, GlError> {
        // SAFETY: the context is current on this thread (Gpu is !Send).
        let id = unsafe { gpu.gl().create_buffer() }.map_err(|why| GlError::Object {
            what: format!("feedback buffer of {capacity_bytes} bytes"),
            why,
        })?;
        let recorder = Self {
            gpu: Rc::clone(gpu),
            id,
            capacity_bytes,
        };
        let gl = gpu.gl();
        let target = glow::TRANSFORM_FEEDBACK_BUFFER;
        // SAFETY: as above; the buffer was made just now, no pointers.
        unsafe {
            gl.bind_buffer(target, Some(id));
            gl.buffer_data_size(target, gl_i32(capacity_bytes), glow::STREAM_READ);
            gl.bind_buffer(target, None);
        }
        gpu.check("while making a feedback buffer")?;
        Ok(recorder)
    }

    /// Records `draw`, which draws points only, with a program made by [`super::program::Program::recording`] bound.
    /// Nothing reaches the target. Gives the first `count` vertices.
    ///
    /// # Errors
    /// [`GlError`] where they do not fit, or the driver refuses.
    pub fn record<T: Pod>(&self, count: usize, draw: impl FnOnce()) -> Result<Vec<T>, GlError> {
        let bytes = count * size_of::<T>();
        if bytes > self.capacity_bytes {
            return Err(GlError::Object {
                what: format!("recording of {count} vertices"),
                why: format!("there is room for {} bytes", self.capacity_bytes),
            });
        }
        let gl = self.gpu.gl();
        let target = glow::TRANSFORM_FEEDBACK_BUFFER;
        // SAFETY: the context is current on this thread (Gpu is !Send) and the buffer is alive; GL itself stops
        // recording at the buffer's end.
        unsafe {
            gl.bind_buffer_base(target, 0, Some(self.id));
            gl.enable(glow::RASTERIZER_DISCARD);
            gl.begin_transform_feedback(glow::POINTS);
        }
        draw();
        let mut out = vec![T::zeroed(); count];
        // SAFETY: as above; the mapped range lies inside the buffer (checked above), is read only, copied before it is
        // unmapped, and the copy has exactly its length.
        unsafe {
            gl.end_transform_feedback();
            gl.disable(glow::RASTERIZER_DISCARD);
            let mapped = if bytes == 0 {
                std::ptr::null_mut()
            } else {
                gl.map_buffer_range(target, 0, gl_i32(bytes), glow::MAP_READ_BIT)
            };
            if !mapped.is_null() {
                let mapped = std::slice::from_raw_parts(mapped.cast_const(), bytes);
                bytemuck::cast_slice_mut(&mut out).copy_from_slice(mapped);
                gl.unmap_buffer(target);
            }
            gl.bind_buffer_base(target, 0, None);
        }
        self.gpu.check("while reading vertices back")?;
        Ok(out)
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        // SAFETY: the context is current on this thread (Gpu is !Send); nothing uses the buffer after this.
        unsafe { self.gpu.gl().delete_buffer(self.id) };
    }
}

/// A size as GL takes it; one beyond 2 GiB makes an empty buffer, which [`Recorder::record`] then finds too small.
fn gl_i32(value: usize) -> i32 {
    i32::try_from(value).unwrap_or(0)
}
