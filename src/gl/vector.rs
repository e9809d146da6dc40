//! Draws a [`DrawList`] in one call: quads of one vertex format, streamed each frame, with coverage from distances.

use std::rc::Rc;

use glow::HasContext as _;

use super::buffer::{
    Attribute, Buffer, Primitive, Role, STREAM_REGIONS, Scalar, Stream, VertexArray,
};
use super::program::{Program, UniformLocation};
use super::texture::{Filter, Format, Texture, Wrap};
use super::{GlError, Gpu};
use crate::draw::atlas::{self, Atlas};
use crate::draw::list::{DrawList, QUADS_MAX, Vertex};

/// The inputs of `shaders/vector.vert`, as [`Vertex`] lays them out.
const ATTRIBUTES: [Attribute; 5] = [
    attribute(0, 2, Scalar::F32, 0),
    attribute(1, 4, Scalar::F32, 8),
    attribute(2, 4, Scalar::I16Float, 24),
    attribute(3, 4, Scalar::U8Unit, 32),
    attribute(4, 1, Scalar::U32Int, 36),
];

const fn attribute(location: u32, components: u8, scalar: Scalar, offset_bytes: u32) -> Attribute {
    Attribute {
        location,
        components,
        scalar,
        offset_bytes,
    }
}

/// Two triangles per quad.
const INDICES_PER_QUAD: usize = 6;

const _: () = assert!(QUADS_MAX * 4 <= 1 << 16, "indices are 16 bits wide");

/// What draws draw lists.
#[derive(Debug)]
pub struct VectorRenderer {
    gpu: Rc<Gpu>,
    program: Program,
    to_clip: UniformLocation,
    atlas: Texture,
    stream: Stream,
    arrays: [VertexArray; STREAM_REGIONS],
}

impl VectorRenderer {
    /// Compiles the shader, loads the atlas and takes all of its memory.
    ///
    /// # Errors
    /// [`GlError`] where the driver refuses one of them.
    pub fn new(gpu: &Rc<Gpu>, atlas: &Atlas) -> Result<Self, GlError> {
        let program = Program::new(
            gpu,
            "vector",
            include_str!("../../shaders/vector.vert"),
            include_str!("../../shaders/vector.frag"),
        )?;
        program.sampler("u_atlas", 0)?;
        let to_clip = program.uniform("u_to_clip")?;
        let size = |texels: usize| u32::try_from(texels).unwrap_or(0);
        let texture = Texture::new(
            gpu,
            Format::R8,
            size(atlas::WIDTH),
            size(atlas::HEIGHT),
            Filter::Linear,
            Wrap::Clamp,
        )?;
        texture.write_all(atlas.texels());
        let mut corners = Vec::with_capacity(QUADS_MAX * INDICES_PER_QUAD);
        for quad in 0..QUADS_MAX {
            let first = u16::try_from(quad * 4).unwrap_or(0);
            corners.extend([0, 1, 2, 0, 2, 3].map(|k| first + k));
        }
        let indices = Buffer::fixed(gpu, Role::Index, &corners)?;
        let stream = Stream::new(gpu, Role::Vertex, QUADS_MAX * 4 * size_of::<Vertex>())?;
        let array = |k: usize| {
            let stride = u16::try_from(size_of::<Vertex>()).unwrap_or(0);
            VertexArray::new(
                gpu,
                &stream.regions()[k],
                stride,
                &ATTRIBUTES,
                Some(&indices),
            )
        };
        Ok(Self {
            gpu: Rc::clone(gpu),
            arrays: [array(0)?, array(1)?, array(2)?],
            program,
            to_clip,
            atlas: texture,
            stream,
        })
    }

    /// Draws `list` over what is in the bound target of `width_px` x `height_px`, in one draw call. Leaves blending,
    /// depth test and culling off.
    pub fn draw(&mut self, list: &DrawList, width_px: u32, height_px: u32) {
        let quads = u32::try_from(list.quads()).unwrap_or(0);
        if quads == 0 {
            return;
        }
        let region = self.stream.write(list.vertices());
        self.program.bind();
        self.atlas.bind(0);
        let gl = self.gpu.gl();
        let per_pixel = |pixels: u32| 2.0 / pixels_f32(pixels);
        // SAFETY: the context is current on this thread (Gpu is !Send); no pointers.
        unsafe {
            gl.uniform_2_f32(
                Some(&self.to_clip),
                per_pixel(width_px),
                per_pixel(height_px),
            );
            gl.disable(glow::DEPTH_TEST);
            gl.disable(glow::CULL_FACE);
            gl.enable(glow::BLEND);
            gl.blend_func(glow::ONE, glow::ONE_MINUS_SRC_ALPHA);
        }
        self.arrays[region].draw_indexed(Primitive::Triangles, 0, quads * 6, 1);
        // SAFETY: as above.
        unsafe { gl.disable(glow::BLEND) };
    }
}

/// A size in pixels as a number.
fn pixels_f32(pixels: u32) -> f32 {
    #[expect(
        clippy::cast_precision_loss,
        reason = "panels are far smaller than 2^24"
    )]
    {
        pixels.max(1) as f32
    }
}
