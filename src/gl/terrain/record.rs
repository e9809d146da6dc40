//! The vertices of a planned frame as the vertex shader makes them, read back: for measuring how exact they are.

use std::rc::Rc;

use super::{LevelPlan, Look, Partition, Scene, Shader, TABLE, TerrainRenderer, texel};
use crate::gl::feedback::Recorder;
use crate::gl::target::Target;
use crate::gl::{GlError, Gpu};
use crate::terrain::blocks::{BLOCKS_MAX, pattern_numbers};
use crate::terrain::clipmap::Shape;

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
    geographic: Shader,
    cap: Shader,
    recorder: Recorder,
    /// Nothing is drawn into it, but GL wants a framebuffer.
    target: Target,
}

impl VertexRecorder {
    /// Compiles the terrain's vertex shaders once more, with their outputs recorded.
    ///
    /// # Errors
    /// [`GlError`].
    pub fn new(gpu: &Rc<Gpu>, shape: Shape) -> Result<Self, GlError> {
        let vertices = pattern_numbers(shape) * BLOCKS_MAX;
        let shader = |is_cap| Shader::recording(gpu, "terrain record", None, is_cap, &OUTPUTS);
        Ok(Self {
            geographic: shader(false)?,
            cap: shader(true)?,
            recorder: Recorder::new(gpu, vertices * size_of::<Vertex>())?,
            target: Target::offscreen(gpu, 1, 1, 0)?,
        })
    }
}

impl TerrainRenderer {
    /// Gives the vertices of the planned frame's visible blocks, level by level: for each block all vertices of the
    /// pattern by number ([`pattern_numbers`]). Nothing where the pack has no posts for the eye.
    ///
    /// # Errors
    /// [`GlError`].
    pub fn record(
        &self,
        with: &VertexRecorder,
        each: &mut dyn FnMut(&LevelPlan, &[Vertex]),
    ) -> Result<(), GlError> {
        self.record_scene(self.world.drawn_index(), with, each)
    }

    /// The scene of the partition that is going, see [`Self::going`].
    #[must_use]
    pub fn going_scene(&self) -> Option<&Scene> {
        self.world.going().map(|(at, _)| &self.world.scenes()[at])
    }

    /// The same of the partition that is going, see [`Self::going`]; nothing where none is.
    ///
    /// # Errors
    /// [`GlError`].
    pub fn record_going(
        &self,
        with: &VertexRecorder,
        each: &mut dyn FnMut(&LevelPlan, &[Vertex]),
    ) -> Result<(), GlError> {
        self.record_scene(self.world.going().map(|(at, _)| at), with, each)
    }

    fn record_scene(
        &self,
        scene: Option<usize>,
        with: &VertexRecorder,
        each: &mut dyn FnMut(&LevelPlan, &[Vertex]),
    ) -> Result<(), GlError> {
        let Some(at) = scene else {
            return Ok(());
        };
        let (scene, buffers) = (&self.world.scenes()[at], &self.plans[at]);
        let shader = match scene.partition() {
            Partition::Geographic => &with.geographic,
            Partition::North | Partition::South => &with.cap,
        };
        with.target.bind();
        shader.program.bind();
        buffers.table().bind(TABLE);
        self.set_frame(shader, scene, [1.0, 1.0], &Look::BARE);
        let corners = pattern_numbers(scene.settings().shape);
        let levels = &scene.plan().levels;
        for level in levels.iter().filter(|level| level.blocks.1 > 0) {
            self.set_level(shader, scene, &self.textures[at], level);
            // Positions have nothing to do with slices of depth: one serves for all of the level.
            if let Some(slice) = level.slices.first() {
                self.set_slice(shader, slice);
            }
            let array = buffers.blocks_from(level.blocks.0);
            let draw = || array.draw_points(texel(corners), texel(level.blocks.1));
            let vertices = with.recorder.record(corners * level.blocks.1, draw)?;
            each(level, &vertices);
        }
        Ok(())
    }
}
