//! Vertices and indices: buffers that never change, streams that change every frame, and the vertex arrays that say how
//! a shader reads them.

use std::rc::Rc;

use bytemuck::Pod;
use glow::HasContext as _;

use super::{GlError, Gpu};

/// What a buffer holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Vertices.
    Vertex,
    /// Indices, 16 bits each.
    Index,
    /// A uniform block, laid out by std140.
    Uniform,
}

impl Role {
    const fn target(self) -> u32 {
        match self {
            Self::Vertex => glow::ARRAY_BUFFER,
            Self::Index => glow::ELEMENT_ARRAY_BUFFER,
            Self::Uniform => glow::UNIFORM_BUFFER,
        }
    }
}

/// A buffer of the GPU.
#[derive(Debug)]
pub struct Buffer {
    gpu: Rc<Gpu>,
    id: glow::Buffer,
    role: Role,
    capacity_bytes: usize,
}

impl Buffer {
    /// A buffer that keeps `data` as it is.
    ///
    /// # Errors
    /// [`GlError`] where the driver has no memory for it.
    pub fn fixed<T: Pod>(gpu: &Rc<Gpu>, role: Role, data: &[T]) -> Result<Self, GlError> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let buffer = Self::create(gpu, role, bytes.len())?;
        buffer.bind_for_upload();
        // SAFETY: the context is current on this thread (Gpu is !Send), the buffer is bound, and GL copies the slice.
        unsafe {
            gpu.gl()
                .buffer_data_u8_slice(buffer.role.target(), bytes, glow::STATIC_DRAW);
        };
        buffer.checked()
    }

    /// An empty buffer of `capacity_bytes`, to be rewritten by [`Self::write`].
    ///
    /// # Errors
    /// [`GlError`] where the driver has no memory for it.
    pub fn dynamic(gpu: &Rc<Gpu>, role: Role, capacity_bytes: usize) -> Result<Self, GlError> {
        let buffer = Self::create(gpu, role, capacity_bytes)?;
        let size = i32::try_from(capacity_bytes).map_err(|_overflow| GlError::Object {
            what: format!("buffer of {capacity_bytes} bytes"),
            why: "more than 2 GiB".into(),
        })?;
        buffer.bind_for_upload();
        // SAFETY: the context is current on this thread (Gpu is !Send) and the buffer is bound; no pointers.
        unsafe {
            gpu.gl()
                .buffer_data_size(buffer.role.target(), size, glow::STREAM_DRAW);
        };
        buffer.checked()
    }

    /// Overwrites the buffer from its start; what lies beyond `data` keeps its old content. If the GPU still reads the
    /// buffer the driver waits or copies: write what changes every frame through a [`Stream`].
    ///
    /// # Panics
    /// If `data` is larger than the buffer: its owner knows the capacity.
    pub fn write<T: Pod>(&self, data: &[T]) {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        assert!(
            bytes.len() <= self.capacity_bytes,
            "{} bytes into a buffer of {}",
            bytes.len(),
            self.capacity_bytes
        );
        self.bind_for_upload();
        // SAFETY: the context is current on this thread (Gpu is !Send), the buffer is bound, the range was checked
        // above, and GL copies the slice.
        unsafe {
            self.gpu
                .gl()
                .buffer_sub_data_u8_slice(self.role.target(), 0, bytes);
        };
    }

    /// Its size in bytes.
    #[must_use]
    pub const fn capacity_bytes(&self) -> usize {
        self.capacity_bytes
    }

    /// Binds a uniform buffer at `binding`, where blocks of programs read it.
    ///
    /// # Panics
    /// If it is no uniform buffer.
    pub fn bind_uniform(&self, binding: u32) {
        assert_eq!(self.role, Role::Uniform, "not a uniform buffer");
        // SAFETY: the context is current on this thread (Gpu is !Send) and the buffer is alive.
        unsafe {
            self.gpu
                .gl()
                .bind_buffer_base(glow::UNIFORM_BUFFER, binding, Some(self.id));
        };
    }

    fn create(gpu: &Rc<Gpu>, role: Role, capacity_bytes: usize) -> Result<Self, GlError> {
        // SAFETY: the context is current on this thread (Gpu is !Send).
        let id = unsafe { gpu.gl().create_buffer() }.map_err(|why| GlError::Object {
            what: format!("buffer of {capacity_bytes} bytes"),
            why,
        })?;
        Ok(Self {
            gpu: Rc::clone(gpu),
            id,
            role,
            capacity_bytes,
        })
    }

    /// Binding an index buffer changes the bound vertex array, so take that away first.
    fn bind_for_upload(&self) {
        let gl = self.gpu.gl();
        // SAFETY: the context is current on this thread (Gpu is !Send) and the buffer is alive.
        unsafe {
            if self.role == Role::Index {
                self.gpu.bind_no_vertex_array();
            }
            gl.bind_buffer(self.role.target(), Some(self.id));
        };
    }

    fn checked(self) -> Result<Self, GlError> {
        self.gpu.check("while making a buffer")?;
        Ok(self)
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        // SAFETY: the context is current on this thread (Gpu is !Send); a vertex array that still refers to the buffer
        // keeps its storage alive (OpenGL ES 3.0.6, section D.1.2).
        unsafe { self.gpu.gl().delete_buffer(self.id) };
    }
}

/// How many buffers a [`Stream`] rotates through: one being filled, and two that the GPU may still read (the frame in
/// flight and the one before it).
pub const STREAM_REGIONS: usize = 3;

/// Data that changes every frame. Rotates through [`STREAM_REGIONS`] buffers of the same size, so that a write never
/// meets a buffer the GPU still reads; nothing is allocated after construction.
#[derive(Debug)]
pub struct Stream {
    regions: [Buffer; STREAM_REGIONS],
    current: usize,
}

impl Stream {
    /// A stream that takes up to `capacity_bytes` a frame.
    ///
    /// # Errors
    /// [`GlError`] where the driver has no memory for it.
    pub fn new(gpu: &Rc<Gpu>, role: Role, capacity_bytes: usize) -> Result<Self, GlError> {
        Ok(Self {
            regions: [
                Buffer::dynamic(gpu, role, capacity_bytes)?,
                Buffer::dynamic(gpu, role, capacity_bytes)?,
                Buffer::dynamic(gpu, role, capacity_bytes)?,
            ],
            current: 0,
        })
    }

    /// Moves on to the next buffer, writes `data` to its start and gives its index: draw with the vertex array that was
    /// made for that one of [`Self::regions`]. Once per frame.
    ///
    /// # Panics
    /// If `data` is larger than the capacity.
    pub fn write<T: Pod>(&mut self, data: &[T]) -> usize {
        self.current = (self.current + 1) % STREAM_REGIONS;
        self.regions[self.current].write(data);
        self.current
    }

    /// The buffers, for making one vertex array for each.
    #[must_use]
    pub const fn regions(&self) -> &[Buffer; STREAM_REGIONS] {
        &self.regions
    }
}

/// How the components of an attribute are stored and what the shader gets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scalar {
    /// 32-bit floats, as they are.
    F32,
    /// Bytes 0..=255 as floats 0 to 1.
    U8Unit,
    /// 16-bit integers 0..=65535 as floats 0 to 1.
    U16Unit,
    /// 16-bit integers as floats of the same value.
    I16Float,
    /// Bytes as unsigned integers (`uint`, `uvec`).
    U8Int,
    /// 16-bit integers as unsigned integers (`uint`, `uvec`).
    U16Int,
    /// 32-bit integers as unsigned integers (`uint`, `uvec`).
    U32Int,
    /// 16-bit integers as signed integers (`int`, `ivec`).
    I16Int,
}

/// One input of a vertex shader.
#[derive(Clone, Copy, Debug)]
pub struct Attribute {
    /// The `layout(location = n)` of the shader.
    pub location: u32,
    /// Components, 1 to 4.
    pub components: u8,
    /// How they are stored.
    pub scalar: Scalar,
    /// Where the first one begins, in bytes from the start of the vertex.
    pub offset_bytes: u32,
}

/// What consecutive vertices make.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Primitive {
    /// A triangle from each three.
    Triangles,
    /// A triangle from each vertex and the two before it.
    TriangleStrip,
    /// A line from each two, one pixel wide.
    Lines,
}

impl Primitive {
    const fn mode(self) -> u32 {
        match self {
            Self::Triangles => glow::TRIANGLES,
            Self::TriangleStrip => glow::TRIANGLE_STRIP,
            Self::Lines => glow::LINES,
        }
    }
}

/// How a shader reads its vertices, and from where.
#[derive(Debug)]
pub struct VertexArray {
    gpu: Rc<Gpu>,
    id: glow::VertexArray,
}

impl VertexArray {
    /// One without inputs, for shaders that know everything from `gl_VertexID`.
    ///
    /// # Errors
    /// [`GlError`] where the driver gives none.
    pub fn empty(gpu: &Rc<Gpu>) -> Result<Self, GlError> {
        // SAFETY: the context is current on this thread (Gpu is !Send).
        let id = unsafe { gpu.gl().create_vertex_array() }.map_err(|why| GlError::Object {
            what: "vertex array".into(),
            why,
        })?;
        Ok(Self {
            gpu: Rc::clone(gpu),
            id,
        })
    }

    /// Vertices known by their number alone (`gl_VertexID`), in the order of `indices`; [`Self::add`] gives each instance
    /// what it needs. The buffer may be dropped before the array.
    ///
    /// # Errors
    /// [`GlError`] where the driver gives none.
    pub fn numbered(gpu: &Rc<Gpu>, indices: &Buffer) -> Result<Self, GlError> {
        let array = Self::empty(gpu)?;
        array.bind();
        // SAFETY: the context is current on this thread (Gpu is !Send); both objects are alive.
        unsafe {
            gpu.gl()
                .bind_buffer(glow::ELEMENT_ARRAY_BUFFER, Some(indices.id));
        };
        gpu.bind_no_vertex_array();
        gpu.check("while making a vertex array")?;
        Ok(array)
    }

    /// Reads `attributes` from `vertices`, `stride_bytes` from one vertex to the next, with `indices` where vertices are
    /// shared. The buffers may be dropped before the array.
    ///
    /// # Errors
    /// [`GlError`] where the driver gives none or refuses an attribute.
    pub fn new(
        gpu: &Rc<Gpu>,
        vertices: &Buffer,
        stride_bytes: u16,
        attributes: &[Attribute],
        indices: Option<&Buffer>,
    ) -> Result<Self, GlError> {
        let array = Self::empty(gpu)?;
        array.add(vertices, stride_bytes, attributes, 0);
        if let Some(indices) = indices {
            array.bind();
            // SAFETY: the context is current on this thread (Gpu is !Send); both objects are alive.
            unsafe {
                gpu.gl()
                    .bind_buffer(glow::ELEMENT_ARRAY_BUFFER, Some(indices.id));
            };
        }
        gpu.bind_no_vertex_array();
        gpu.check("while making a vertex array")?;
        Ok(array)
    }

    /// Reads more attributes from another buffer. `divisor` 0: one set per vertex; 1: one set per instance.
    pub fn add(
        &self,
        vertices: &Buffer,
        stride_bytes: u16,
        attributes: &[Attribute],
        divisor: u32,
    ) {
        self.bind();
        let gl = self.gpu.gl();
        let stride = i32::from(stride_bytes);
        // SAFETY: the context is current on this thread (Gpu is !Send), the array is bound, and the offsets are
        // relative to the buffer bound beside it.
        unsafe {
            gl.bind_buffer(glow::ARRAY_BUFFER, Some(vertices.id));
            for a in attributes {
                let (size, offset) = (i32::from(a.components), gl_i32(a.offset_bytes));
                let (kind, unit, integer) = match a.scalar {
                    Scalar::F32 => (glow::FLOAT, false, false),
                    Scalar::U8Unit => (glow::UNSIGNED_BYTE, true, false),
                    Scalar::U16Unit => (glow::UNSIGNED_SHORT, true, false),
                    Scalar::I16Float => (glow::SHORT, false, false),
                    Scalar::U8Int => (glow::UNSIGNED_BYTE, false, true),
                    Scalar::U16Int => (glow::UNSIGNED_SHORT, false, true),
                    Scalar::U32Int => (glow::UNSIGNED_INT, false, true),
                    Scalar::I16Int => (glow::SHORT, false, true),
                };
                if integer {
                    gl.vertex_attrib_pointer_i32(a.location, size, kind, stride, offset);
                } else {
                    gl.vertex_attrib_pointer_f32(a.location, size, kind, unit, stride, offset);
                }
                gl.vertex_attrib_divisor(a.location, divisor);
                gl.enable_vertex_attrib_array(a.location);
            }
        }
    }

    /// Makes it the array that draws read.
    pub fn bind(&self) {
        // SAFETY: the context is current on this thread (Gpu is !Send) and the array is alive.
        unsafe { self.gpu.gl().bind_vertex_array(Some(self.id)) };
    }

    /// Binds it and draws `count` vertices from `first`, with the bound program, into the bound target.
    pub fn draw(&self, primitive: Primitive, first: u32, count: u32) {
        self.bind();
        // SAFETY: as in `bind`; the owner of the buffers draws only what it has written.
        unsafe {
            self.gpu
                .gl()
                .draw_arrays(primitive.mode(), gl_i32(first), gl_i32(count));
        };
    }

    /// Binds it and draws `count` indices from the `first`-th, `instances` times.
    pub fn draw_indexed(&self, primitive: Primitive, first: u32, count: u32, instances: u32) {
        self.bind();
        let gl = self.gpu.gl();
        let offset = gl_i32(first.saturating_mul(2));
        let (mode, count) = (primitive.mode(), gl_i32(count));
        // SAFETY: as in `draw`.
        unsafe {
            if instances == 1 {
                gl.draw_elements(mode, count, glow::UNSIGNED_SHORT, offset);
            } else {
                let instances = gl_i32(instances);
                gl.draw_elements_instanced(mode, count, glow::UNSIGNED_SHORT, offset, instances);
            }
        };
    }
}

impl VertexArray {
    /// Binds it and draws `count` points, `instances` times: what may be recorded in OpenGL ES 3.0.
    pub fn draw_points(&self, count: u32, instances: u32) {
        self.bind();
        let gl = self.gpu.gl();
        // SAFETY: as in `draw`.
        unsafe {
            gl.draw_arrays_instanced(glow::POINTS, 0, gl_i32(count), gl_i32(instances));
        };
    }
}

impl Drop for VertexArray {
    fn drop(&mut self) {
        // SAFETY: the context is current on this thread (Gpu is !Send); nothing uses the array after this.
        unsafe { self.gpu.gl().delete_vertex_array(self.id) };
        self.gpu.bind_no_vertex_array();
    }
}

/// A count as GL takes it. Ours are far below 2^31; one that is not draws nothing rather than something wrong.
fn gl_i32(count: u32) -> i32 {
    i32::try_from(count).unwrap_or(0)
}
