//! Draws the terrain: the textures of the levels of each [`Scene`] of a [`World`], and one or two instanced draws for each level
//! of the scene that is drawn, one more for the finest ([`crate::terrain::slices`]). The caps have a program of their own, with
//! another expression for positions. While one partition gives way to another there are two scenes in the picture: [`TerrainRenderer::draw_going`].
//!
//! Uploads never touch what the GPU may still read: levels have two sets of textures, see [`super::level_textures`], and
//! tables and blocks rotate through three textures and buffers.

mod plan_buffers;
pub mod record;
mod wide;

use std::io;
use std::rc::Rc;
use std::sync::Arc;

use arrayvec::ArrayVec;
use glow::HasContext as _;

use self::plan_buffers::PlanBuffers;
use self::wide::Wide;
use super::buffer::{Buffer, Primitive, Role};
use super::level_textures::LevelTextures;
use super::look::{Look, LookUniforms, Variant, with_relief};
use super::program::{Program, UniformLocation};
use super::texture::Texture;
use super::{GlError, Gpu};
use crate::geo::{Camera, Geodetic};
use crate::terrain::blocks::pattern_indices;
use crate::terrain::budget;
use crate::terrain::clipmap::torus_texel;
use crate::terrain::partition::Partition;
use crate::terrain::scene::{BadCamera, FrameFigures, LevelPlan, Plan, Scene, Settings};
use crate::terrain::slices::Slice;
use crate::terrain::stream::NoTerrain;
use crate::terrain::surface::TileSource;
use crate::terrain::world::World;
use crate::time::Monotonic;
use crate::units::Metres;

/// Why the renderer cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum TerrainError {
    /// The GPU refused something.
    #[error(transparent)]
    Gl(#[from] GlError),
    /// The system refused the streaming thread.
    #[error("the terrain thread cannot be started")]
    Thread(#[source] io::Error),
}

/// Draws a pack.
#[derive(Debug)]
pub struct TerrainRenderer {
    gpu: Rc<Gpu>,
    world: World,
    /// One for each scene.
    textures: ArrayVec<LevelTextures, 2>,
    plans: ArrayVec<PlanBuffers, 2>,
    geographic: Shaders,
    cap: Option<Shaders>,
    indices: u32,
}

/// How a scene goes into the picture.
#[derive(Clone, Copy, Debug)]
enum Pass {
    /// Depth and colour.
    Whole,
    /// Depth, and distance for colour.
    Range,
    /// Depth alone.
    Depth,
    /// Colour where the depth is its own, as opaque as this.
    Over(f32),
}

/// The programs of a kind of partition.
#[derive(Debug)]
struct Shaders {
    colour: [Shader; Variant::ALL.len()],
    range: Shader,
}

/// A program with its uniforms.
#[derive(Debug)]
struct Shader {
    program: Program,
    window: UniformLocation,
    torus: UniformLocation,
    morph: UniformLocation,
    texels: Option<UniformLocation>,
    coarser_at: Option<UniformLocation>,
    origin: UniformLocation,
    scale: Option<UniformLocation>,
    clip: [UniformLocation; 3],
    depth: UniformLocation,
    bulge: Option<UniformLocation>,
    lines: Option<UniformLocation>,
    look: Option<LookUniforms>,
}

/// Texture units.
const HEIGHTS: u32 = 0;
const TABLE: u32 = 1;
const SURFACE: u32 = 2;
const COARSER: u32 = 3;

impl Shader {
    fn new(
        gpu: &Rc<Gpu>,
        name: &'static str,
        variant: Option<Variant>,
        is_cap: bool,
    ) -> Result<Self, GlError> {
        Self::recording(gpu, name, variant, is_cap, &[])
    }

    /// With some of the vertex shader's outputs recorded.
    fn recording(
        gpu: &Rc<Gpu>,
        name: &'static str,
        variant: Option<Variant>,
        is_cap: bool,
        outputs: &[&str],
    ) -> Result<Self, GlError> {
        let kind = variant.map_or("#define RANGE\n".to_owned(), Variant::defines);
        let cap = if is_cap { "#define CAP\n" } else { "" };
        let record = if outputs.is_empty() {
            ""
        } else {
            "#define RECORD\n"
        };
        let defines = format!("{kind}{cap}{record}");
        let vertex = include_str!("../../shaders/terrain.vert");
        let fragment = include_str!("../../shaders/terrain.frag");
        let program = Program::recording(
            gpu,
            name,
            &format!("{defines}#line 1\n{vertex}"),
            &with_relief(&defines, fragment),
            outputs,
        )?;
        let is_colour = variant.is_some();
        program.sampler("heights", HEIGHTS)?;
        program.sampler("tables", TABLE)?;
        if is_colour {
            program.sampler("surface", SURFACE)?;
            program.sampler("coarser", COARSER)?;
        }
        let colour_only = |name: &str| is_colour.then(|| program.uniform(name)).transpose();
        Ok(Self {
            window: program.uniform("window")?,
            torus: program.uniform("torus")?,
            morph: program.uniform("morph")?,
            texels: colour_only("texels")?,
            coarser_at: colour_only("coarser_at")?,
            origin: program.uniform("origin")?,
            // Only distances do without heights.
            scale: (is_colour || !outputs.is_empty())
                .then(|| program.uniform("scale"))
                .transpose()?,
            clip: [
                program.uniform("clip_x")?,
                program.uniform("clip_y")?,
                program.uniform("clip_w")?,
            ],
            depth: program.uniform("depth")?,
            bulge: is_cap.then(|| program.uniform("bulge")).transpose()?,
            lines: variant
                .filter(|variant| variant.has_lines())
                .map(|_| program.uniform("lines_at"))
                .transpose()?,
            look: variant
                .map(|variant| LookUniforms::new(gpu, &program, variant))
                .transpose()?,
            program,
        })
    }
}

impl Shaders {
    fn new(gpu: &Rc<Gpu>, is_cap: bool) -> Result<Self, GlError> {
        let [plain, aware, lined, both] = Variant::ALL;
        let colour = |variant| Shader::new(gpu, "terrain", Some(variant), is_cap);
        Ok(Self {
            colour: [
                colour(plain)?,
                colour(aware)?,
                colour(lined)?,
                colour(both)?,
            ],
            range: Shader::new(gpu, "terrain range", None, is_cap)?,
        })
    }
}

impl TerrainRenderer {
    /// For a pack: allocates every texture and buffer, compiles the shaders and starts the streaming thread.
    ///
    /// # Errors
    /// [`TerrainError`].
    pub fn new<S: TileSource>(
        gpu: &Rc<Gpu>,
        settings: Settings,
        source: Arc<S>,
    ) -> Result<Self, TerrainError> {
        let levels = source.info().levels;
        let world = World::new(&source, settings).map_err(TerrainError::Thread)?;
        let mut textures = ArrayVec::new();
        for scene in world.scenes() {
            let texels = settings.shape.texels();
            textures.push(LevelTextures::new(gpu, scene.levels(), texels)?);
        }
        let has_cap = world.scenes().len() > 1;
        let indices = pattern_indices(settings.shape);
        let index_buffer = Buffer::fixed(gpu, Role::Index, &indices)?;
        let mut plans = ArrayVec::new();
        for _ in world.scenes() {
            let size = (levels, settings.shape.texels());
            plans.push(PlanBuffers::new(gpu, size, &index_buffer)?);
        }
        Ok(Self {
            geographic: Shaders::new(gpu, false)?,
            cap: has_cap.then(|| Shaders::new(gpu, true)).transpose()?,
            indices: texel(indices.len()),
            gpu: Rc::clone(gpu),
            textures,
            plans,
            world,
        })
    }

    /// Streams, plans and draws the frame of a time into the bound target, whose depth must be clear: [`Self::prepare`] and
    /// [`Self::draw`].
    ///
    /// # Errors
    /// [`BadCamera`]: nothing is drawn and everything stays as it was.
    pub fn frame(
        &mut self,
        camera: &Camera,
        now: Monotonic,
        quota: usize,
        look: &Look,
    ) -> Result<FrameFigures, BadCamera> {
        let mut figures = self.prepare(camera, now, quota)?;
        self.draw(look);
        figures.draw_calls = self.draw_calls();
        Ok(figures)
    }

    /// Streams at most `quota` texels and plans what to draw at a time, without drawing.
    ///
    /// # Errors
    /// [`BadCamera`]: everything stays as it was.
    pub fn prepare(
        &mut self,
        camera: &Camera,
        now: Monotonic,
        quota: usize,
    ) -> Result<FrameFigures, BadCamera> {
        for textures in &mut self.textures {
            textures.begin_frame();
        }
        self.world.frame(camera, now, quota, &mut self.textures)?;
        let mut figures = self.world.figures();
        figures.resident_bytes = self.resident_bytes();
        let going = self.world.going().map(|(at, _)| at);
        for at in self.world.drawn_index().into_iter().chain(going) {
            figures.uploads_bytes += self.plans[at].write(self.world.scenes()[at].plan());
        }
        Ok(figures)
    }

    /// Draws the planned frame into the bound target, whose depth must be clear.
    pub fn draw(&self, look: &Look) {
        self.draw_scene(self.world.drawn_index(), Pass::Whole, look);
    }

    /// How opaque the partition that was drawn before the present one still is, above 0 and at most 1; `None` where nothing
    /// of it is left.
    #[must_use]
    pub fn going(&self) -> Option<f64> {
        self.world.going().map(|(_, opacity)| opacity)
    }

    /// Draws it over what is in the bound target, nothing where [`Self::going`] is `None`. The target's depth must be clear
    /// again; afterwards it is that partition's. Its depth is laid down first, so that each pixel is blended with the one surface
    /// that is seen there: a program puts out the same depth twice, bit by bit.
    #[expect(clippy::cast_possible_truncation, reason = "an opacity for GL")]
    pub fn draw_going(&self, look: &Look) {
        let Some((at, opacity)) = self.world.going() else {
            return;
        };
        for pass in [Pass::Depth, Pass::Over(opacity as f32)] {
            self.draw_scene(Some(at), pass, look);
        }
    }

    /// Draws the planned frame's distances from the eye instead of colours: each pixel's four bytes are those of an f32,
    /// red the lowest, metres. The target must have 8 bits a channel and no multisampling; clear it to
    /// [`RANGE_CLEAR`].
    pub fn draw_range(&self) {
        self.draw_scene(self.world.drawn_index(), Pass::Range, &Look::BARE);
    }

    /// Ellipsoidal height of the ground at a point, from the finest resident level of the drawn partition that covers it.
    ///
    /// # Errors
    /// [`NoTerrain`] where nothing covers it, or the pack has no measurement there.
    pub fn ground(&self, point: &Geodetic) -> Result<Metres, NoTerrain> {
        self.world.ground(point)
    }

    /// The scene that is drawn; `None` before the first frame, and where the pack has no posts for the eye.
    #[must_use]
    pub fn scene(&self) -> Option<&Scene> {
        self.world.drawn()
    }

    /// Draw calls of the planned frame: one or two for each slice of depth, see [`crate::terrain::slices`]; two for each of the
    /// partition that is going.
    #[must_use]
    pub fn draw_calls(&self) -> usize {
        let slices = |at: usize| {
            let levels = &self.world.scenes()[at].plan().levels;
            levels.iter().flat_map(|level| &level.slices)
        };
        let drawn = self.world.drawn_index().map_or(0, |at| {
            if self.viewport(self.world.scenes()[at].plan()).is_some() {
                slices(at).map(Slice::draw_calls).sum()
            } else {
                slices(at).count()
            }
        });
        let going = self.world.going().map_or(0, |(at, _)| slices(at).count());
        drawn + 2 * going
    }

    /// Whether something is still wanted, of the partition beyond a near seam too.
    #[must_use]
    pub fn is_waiting(&self) -> bool {
        self.world.is_waiting()
    }

    fn resident_bytes(&self) -> usize {
        let textures = self.textures.iter().map(LevelTextures::bytes);
        let tables = self.plans.iter().flat_map(|plan| &plan.tables);
        textures.chain(tables.map(Texture::bytes)).sum::<usize>()
            + self.plans.len() * budget::BLOCK_BUFFER_BYTES
            + self.world.bytes()
    }

    fn draw_scene(&self, scene: Option<usize>, pass: Pass, look: &Look) {
        let Some(at) = scene else {
            return;
        };
        let (scene, textures, buffers) = (
            &self.world.scenes()[at],
            &self.textures[at],
            &self.plans[at],
        );
        let shaders = match &self.cap {
            Some(cap) if scene.partition() != Partition::Geographic => cap,
            _ => &self.geographic,
        };
        let shader = match pass {
            Pass::Range => &shaders.range,
            Pass::Whole | Pass::Depth | Pass::Over(_) => &shaders.colour[look.variant().index()],
        };
        let plan = scene.plan();
        shader.program.bind();
        buffers.table().bind(TABLE);
        let wide = self.viewport(plan);
        self.set_frame(
            shader,
            scene,
            wide.map_or([1.0, 1.0], |wide| wide.shares),
            look,
        );
        self.begin(pass, wide.as_ref());
        // While a partition goes, all sides of it are drawn: calls are few, and its time is short.
        let turns = wide.is_some() && matches!(pass, Pass::Whole | Pass::Range);
        for level in plan.levels.iter().filter(|level| level.blocks.1 > 0) {
            self.set_level(shader, scene, textures, level);
            if let (Some(at), Some(lines)) = (&shader.lines, look.lines) {
                let texels = scene.settings().shape.texels();
                let place = lines.place(scene.grid(), level.level, level.window, texels);
                shader.program.set_f32(at, &place);
            }
            for slice in &level.slices {
                self.set_slice(shader, slice);
                self.draw_slice(buffers, slice, turns);
            }
        }
        let gl = self.gpu.gl();
        // SAFETY: the context is current on this thread (Gpu is !Send); no pointers.
        unsafe {
            gl.depth_range_f32(0.0, 1.0);
            gl.depth_func(glow::LESS);
            gl.depth_mask(true);
            gl.color_mask(true, true, true, true);
            gl.disable(glow::BLEND);
            gl.disable(glow::DEPTH_TEST);
            gl.disable(glow::CULL_FACE);
            let (width, height) = plan.size_px;
            gl.viewport(0, 0, width.cast_signed(), height.cast_signed());
        }
    }

    /// How the viewport of a plan is widened; `None` where the GPU has none that large.
    fn viewport(&self, plan: &Plan) -> Option<Wide> {
        Wide::of(plan.size_px, self.gpu.caps().viewport_max)
    }

    fn begin(&self, pass: Pass, wide: Option<&Wide>) {
        let gl = self.gpu.gl();
        // SAFETY: the context is current on this thread (Gpu is !Send); no pointers.
        unsafe {
            if let Some(wide) = wide {
                let (x, y) = wide.corner;
                gl.viewport(x, y, wide.size.0, wide.size.1);
            }
            gl.enable(glow::DEPTH_TEST);
            gl.disable(glow::BLEND);
            gl.disable(glow::CULL_FACE);
            // Triangles are counter-clockwise seen from above.
            gl.cull_face(glow::BACK);
            gl.front_face(glow::CCW);
            gl.depth_func(glow::LESS);
            gl.depth_mask(true);
            match pass {
                Pass::Whole | Pass::Range => {}
                Pass::Depth => gl.color_mask(false, false, false, false),
                Pass::Over(opacity) => {
                    // Has no direction, so V3D's early rejection goes on.
                    gl.depth_func(glow::EQUAL);
                    gl.depth_mask(false);
                    gl.enable(glow::BLEND);
                    gl.blend_color(0.0, 0.0, 0.0, opacity);
                    gl.blend_func(glow::CONSTANT_ALPHA, glow::ONE_MINUS_CONSTANT_ALPHA);
                }
            }
        }
    }

    /// `turns`: whether what of a slice can be drawn without lower sides, which comes last, is.
    fn draw_slice(&self, buffers: &PlanBuffers, slice: &Slice, turns: bool) {
        let turned = if turns { slice.turned } else { 0 };
        let (first, count) = slice.blocks;
        let plain = count - turned;
        for (first, count, is_turned) in [(first, plain, false), (first + plain, turned, true)] {
            if count == 0 {
                continue;
            }
            let gl = self.gpu.gl();
            // SAFETY: the context is current on this thread (Gpu is !Send); no pointers.
            unsafe {
                if is_turned {
                    gl.enable(glow::CULL_FACE);
                } else {
                    gl.disable(glow::CULL_FACE);
                }
            }
            let array = buffers.blocks_from(first);
            array.draw_indexed(Primitive::Triangles, 0, self.indices, texel(count));
        }
    }

    fn set_slice(&self, shader: &Shader, slice: &Slice) {
        let gl = self.gpu.gl();
        // SAFETY: the context is current on this thread (Gpu is !Send); the program is bound, the locations its own.
        unsafe {
            gl.uniform_2_f32(Some(&shader.depth), slice.depth.0, slice.depth.1);
            gl.depth_range_f32(slice.range.0, slice.range.1);
        }
    }

    #[expect(
        clippy::cast_possible_truncation,
        reason = "numbers for the shader, which is f32"
    )]
    fn set_frame(&self, shader: &Shader, scene: &Scene, shares: [f32; 2], look: &Look) {
        let gl = self.gpu.gl();
        let plan = scene.plan();
        let heights = scene.heights();
        let texels = scene.settings().shape.texels();
        let anchor_m = heights.decode(plan.anchor_code);
        let scale = [heights.unit_m as f32, anchor_m as f32];
        // SAFETY: the context is current on this thread (Gpu is !Send); the program is bound, the locations its own.
        unsafe {
            gl.uniform_2_i32(
                Some(&shader.torus),
                signed(texels - 1),
                plan.anchor_code.into(),
            );
            gl.uniform_3_f32_slice(Some(&shader.origin), &plan.origin_m);
            if let Some(at) = &shader.scale {
                gl.uniform_2_f32_slice(Some(at), &scale);
            }
            let shares = [shares[0], shares[1], 1.0];
            for ((at, row), share) in shader.clip.iter().zip(&plan.projection).zip(shares) {
                gl.uniform_3_f32_slice(Some(at), &row.map(|v| v * share));
            }
            if let Some(at) = &shader.bulge {
                gl.uniform_4_f32_slice(Some(at), &plan.bulge);
            }
        }
        if let Some(uniforms) = &shader.look {
            uniforms.set(look, plan.heading);
        }
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_precision_loss,
        reason = "numbers for the shader, which is f32"
    )]
    fn set_level(
        &self,
        shader: &Shader,
        scene: &Scene,
        textures: &LevelTextures,
        level: &LevelPlan,
    ) {
        let gl = self.gpu.gl();
        let texels = scene.settings().shape.texels();
        let at = usize::from(level.level);
        let coarser = if level.has_coarser { at + 1 } else { at };
        textures.bind_surface(coarser, COARSER);
        textures.bind_surface(at, SURFACE);
        textures.bind_heights(at, HEIGHTS);
        let own = [level.window.i, level.window.j].map(|v| torus_texel(texels, v));
        // The coarser level's texel of this origin is half of it, in a torus of the same size. Without a coarser level
        // nothing is blended.
        let coarser_own = [level.window.i, level.window.j].map(|v| torus_texel(2 * texels, v));
        let texel = 1.0 / texels as f32;
        let centre = |own: usize| (own as f32 + 0.5) * texel;
        let beyond =
            |axis: usize| 0.5 * (coarser_own[axis] as f32 + 1.0) * texel - 0.5 * centre(own[axis]);
        let m = &level.morph;
        let inverse = if level.has_coarser {
            1.0 / (m.end - m.start)
        } else {
            0.0
        };
        // SAFETY: the context is current on this thread (Gpu is !Send); the program is bound, the locations its own.
        unsafe {
            gl.uniform_4_i32(
                Some(&shader.window),
                signed(own[0]),
                signed(own[1]),
                2 * i32::from(level.level),
                level.cells,
            );
            gl.uniform_4_f32(
                Some(&shader.morph),
                m.x as f32,
                m.y as f32,
                (-m.start * inverse - BLEND_SLACK) as f32,
                inverse as f32,
            );
            if let Some(location) = &shader.texels {
                gl.uniform_3_f32(Some(location), centre(own[0]), centre(own[1]), texel);
            }
            if let Some(location) = &shader.coarser_at {
                gl.uniform_2_f32(Some(location), beyond(0), beyond(1));
            }
        }
    }
}

/// Clear colour whose bytes are the f32 +infinity: no terrain.
pub const RANGE_CLEAR: [f32; 4] = [0.0, 0.0, 128.0 / 255.0, 127.0 / 255.0];

/// How much later than planned a blend begins and ends: so little that nobody sees it, and more than what rounding in f32
/// can add to zero. It ends a whole post before what is drawn does, where it is therefore still complete.
const BLEND_SLACK: f64 = 1e-5;

/// A size of ours as GL takes it: at most a few thousand.
fn texel(v: usize) -> u32 {
    u32::try_from(v).unwrap_or(0)
}

/// The same, signed.
fn signed(v: usize) -> i32 {
    i32::try_from(v).unwrap_or(0)
}
