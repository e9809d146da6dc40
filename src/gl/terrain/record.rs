//! The vertices of a planned frame as the vertex shader makes them, read back: for measuring how exact they are.

use std::rc::Rc;

use super::{LevelPlan, Shader, TABLE, TerrainRenderer, pattern_vertices, texel};
use crate::gl::buffer::{Attribute, Scalar};
use crate::gl::feedback::Recorder;
use crate::gl::target::Target;
use crate::gl::terrain::Look;
use crate::gl::{GlError, Gpu};
use crate::terrain::blocks::{BLOCKS_MAX, Block};

/// A vertex as the shader puts it out.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Vertex {
    /// Position from the eye, Earth-centred axes, metres.
    pub position_m: [f32; 3],
    /// Which corner of the level's cells it is: east and north, from the window's origin.
    pub cell: [f32; 2],
    /// Its height above the anchor's, metres.
    pub rise_m: f32,
    /// How far it has blended into the coarser level, 0 to 1.
    pub blend: f32,
    /// Clip coordinates x, y, z, w.
    pub clip: [f32; 4],
}

/// What of [`Vertex`] the shader calls what, in its order.
const OUTPUTS: [&str; 3] = ["v_position", "v_vertex", "gl_Position"];

/// Reads vertices back; see [`TerrainRenderer::record`].
#[derive(Debug)]
pub struct VertexRecorder {
    shader: Shader,
    recorder: Recorder,
    /// Nothing is drawn into it, but GL wants a framebuffer.
    target: Target,
}

impl VertexRecorder {
    /// Compiles the terrain's vertex shader once more, with its outputs recorded.
    ///
    /// # Errors
    /// [`GlError`].
    pub fn new(gpu: &Rc<Gpu>, renderer: &TerrainRenderer) -> Result<Self, GlError> {
        let vertices = pattern_vertices(renderer.scene.settings().shape).len() * BLOCKS_MAX;
        Ok(Self {
            shader: Shader::recording(
                gpu,
                "terrain record",
                "#define RANGE\n#define RECORD",
                &OUTPUTS,
            )?,
            recorder: Recorder::new(gpu, vertices * size_of::<Vertex>())?,
            target: Target::offscreen(gpu, 1, 1, 0)?,
        })
    }
}

impl TerrainRenderer {
    /// Gives the vertices of the planned frame's visible blocks, level by level: for each block all vertices of the
    /// pattern ([`crate::terrain::blocks::pattern_vertices`]).
    ///
    /// # Errors
    /// [`GlError`].
    pub fn record(
        &self,
        with: &VertexRecorder,
        each: &mut dyn FnMut(&LevelPlan, &[Vertex]),
    ) -> Result<(), GlError> {
        let plan = self.scene.plan();
        let shader = &with.shader;
        with.target.bind();
        shader.program.bind();
        self.tables[self.table].bind(TABLE);
        self.set_frame(shader, plan, &Look::BARE);
        let corners = pattern_vertices(self.scene.settings().shape).len();
        let array = &self.arrays[self.region];
        for level in plan.levels.iter().filter(|level| level.blocks.1 > 0) {
            self.set_level(shader, level);
            let block = Attribute {
                location: 1,
                components: 4,
                scalar: Scalar::U8Int,
                offset_bytes: u16::try_from(level.blocks.0 * size_of::<Block>()).unwrap_or(0),
            };
            array.add(&self.blocks.regions()[self.region], 4, &[block], 1);
            let draw = || array.draw_points(texel(corners), texel(level.blocks.1));
            let vertices = with.recorder.record(corners * level.blocks.1, draw)?;
            each(level, &vertices);
        }
        Ok(())
    }
}
