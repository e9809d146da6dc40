//! The Earth in one piece: a full-screen triangle whose fragments cast rays at the ellipsoid, coloured from one picture of
//! all that the pack covers. From 20 km up it comes in over the clipmap and the sky, from 30 km on it is all there is.
//!
//! Everything in which large numbers cancel is computed here in 64 bits: the eye in axes in which the ellipsoid is the
//! unit sphere, and its distance from it. The limb is then exact to a small fraction of a pixel at any height and field of
//! view, and its edge is smoothed by its own distance. The limb is the ellipsoid's; relief is found by looking up the height
//! where the ray came down, three times over, and from 200 km on it is colour alone.

use std::io;
use std::rc::Rc;
use std::sync::Arc;

use glam::{DMat3, DVec3};
use glow::HasContext as _;

use super::buffer::{Primitive, VertexArray};
use super::look::{Look, LookUniforms, Variant, with_relief};
use super::program::{Program, UniformLocation};
use super::texture::{Filter, Format, Region, Texture, Wrap};
use super::{GlError, Gpu};
use crate::geo::{Camera, WGS84_A_M, WGS84_B_M};
use crate::terrain::globe::{Extent, Painter};
use crate::terrain::surface::TileSource;
use crate::units::Metres;

/// Up to this height of the eye there is no one-piece Earth in the picture.
pub const FROM: Metres = Metres(20_000.0);
/// From this height on there is nothing else.
pub const ALONE_FROM: Metres = Metres(30_000.0);
/// From this height on its picture is prepared.
const ASKED_FROM: Metres = Metres(15_000.0);

/// How much of the one-piece Earth is in a picture from a height: 0 to 1.
#[must_use]
pub fn share(height: Metres) -> f64 {
    let t = ((height.0 - FROM.0) / (ALONE_FROM.0 - FROM.0)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Why it cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum GlobeError {
    /// The GPU refused something.
    #[error(transparent)]
    Gl(#[from] GlError),
    /// The system refused the thread.
    #[error("the globe's thread cannot be started")]
    Thread(#[source] io::Error),
}

/// Draws it.
#[derive(Debug)]
pub struct GlobeRenderer {
    gpu: Rc<Gpu>,
    extent: Extent,
    painter: Painter,
    missing: usize,
    surface: Texture,
    heights: Texture,
    /// Without and with lines.
    shaders: [Shader; 2],
    corners: VertexArray,
}

#[derive(Debug)]
struct Shader {
    program: Program,
    eye: UniformLocation,
    view: [UniformLocation; 3],
    extent: UniformLocation,
    picture: UniformLocation,
    texels: UniformLocation,
    opacity: UniformLocation,
    relief: UniformLocation,
    lines: Option<UniformLocation>,
    look: LookUniforms,
}

/// Texture units.
const SURFACE: u32 = 0;
const HEIGHTS: u32 = 1;

impl Shader {
    fn new(gpu: &Rc<Gpu>, variant: Variant) -> Result<Self, GlError> {
        let program = Program::new(
            gpu,
            "globe",
            include_str!("../../shaders/globe.vert"),
            &with_relief(&variant.defines(), include_str!("../../shaders/globe.frag")),
        )?;
        program.sampler("surface", SURFACE)?;
        program.sampler("heights", HEIGHTS)?;
        Ok(Self {
            eye: program.uniform("eye")?,
            view: [
                program.uniform("view_x")?,
                program.uniform("view_y")?,
                program.uniform("view_z")?,
            ],
            extent: program.uniform("extent")?,
            picture: program.uniform("picture")?,
            texels: program.uniform("texels")?,
            opacity: program.uniform("opacity")?,
            relief: program.uniform("relief")?,
            lines: variant
                .has_lines()
                .then(|| program.uniform("lines_at"))
                .transpose()?,
            look: LookUniforms::new(gpu, &program, variant)?,
            program,
        })
    }
}

impl GlobeRenderer {
    /// For a pack: allocates its textures and starts the thread that will paint them.
    ///
    /// # Errors
    /// [`GlobeError`].
    pub fn new<S: TileSource>(gpu: &Rc<Gpu>, source: Arc<S>) -> Result<Self, GlobeError> {
        let extent = Extent::of(source.info());
        let texture = |format| {
            let (width, height) = (side(extent.width), side(extent.height));
            Texture::new(gpu, format, width, height, Filter::Trilinear, Wrap::Clamp)
        };
        let [plain, _, lined, _] = Variant::ALL;
        Ok(Self {
            gpu: Rc::clone(gpu),
            extent,
            painter: Painter::start(source, extent).map_err(GlobeError::Thread)?,
            missing: (0..extent.details()).map(|d| extent.texels(d)).sum(),
            surface: texture(Format::Rgba8)?,
            heights: texture(Format::R8)?,
            shaders: [Shader::new(gpu, plain)?, Shader::new(gpu, lined)?],
            corners: VertexArray::empty(gpu)?,
        })
    }

    /// Whether its picture is there.
    #[must_use]
    pub const fn is_ready(&self) -> bool {
        self.missing == 0
    }

    /// How much of it is in a picture from a height: [`share`], nothing before it is ready.
    #[must_use]
    pub fn share(&self, height: Metres) -> f64 {
        if self.is_ready() { share(height) } else { 0.0 }
    }

    /// Uploads what has been painted for an eye at a height, pieces up to `quota` texels. Returns the texels.
    pub fn prepare(&mut self, height: Metres, quota: usize) -> usize {
        if height < ASKED_FROM || self.is_ready() {
            return 0;
        }
        self.painter.ask();
        let mut uploaded = 0;
        while uploaded < quota
            && let Some(piece) = self.painter.receive()
        {
            let region = Region {
                x: side(piece.x),
                y: side(piece.y),
                width: side(piece.width),
                height: side(piece.height),
            };
            let surface: &[u8] = bytemuck::cast_slice(&piece.surface);
            self.surface.write_detail(piece.detail, region, surface);
            self.heights.write_detail(piece.detail, region, &piece.tint);
            uploaded += piece.tint.len();
            self.painter.give_back(piece);
        }
        self.missing = self.missing.saturating_sub(uploaded);
        uploaded
    }

    /// Bytes of its textures, smaller levels of detail included.
    #[must_use]
    pub const fn resident_bytes(&self) -> usize {
        (self.surface.bytes() + self.heights.bytes()) / 3 * 4
    }

    /// Draws it and, unless told otherwise, its sky over what is in the bound target, as opaque as the eye is high. Returns its draw calls: 1, or 0 where there
    /// is nothing of it in the picture. Ground awareness is off: nothing is near this high up.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "numbers for the shader, which is f32"
    )]
    pub fn draw(&self, camera: &Camera, look: &Look, sky: bool) -> usize {
        let share = self.share(camera.eye.height_ellipsoid);
        if share <= 0.0 || !camera.is_valid() {
            return 0;
        }
        let shader = &self.shaders[usize::from(look.lines.is_some())];
        let rays = Rays::of(camera);
        let picture = self.picture(camera);
        let row = |v: DVec3| [v.x as f32, v.y as f32, v.z as f32];
        let [x, y, z] = row(rays.eye);
        let (w, h) = (f64::from(camera.width_px), f64::from(camera.height_px));
        let f = camera.focal_px();
        let gl = self.gpu.gl();
        shader.program.bind();
        self.heights.bind(HEIGHTS);
        self.surface.bind(SURFACE);
        shader.look.set(look, camera.attitude.heading_true);
        // SAFETY: the context is current on this thread (Gpu is !Send); the program is bound, the locations its own.
        unsafe {
            gl.uniform_4_f32(Some(&shader.eye), x, y, z, rays.eye_less_1 as f32);
            for (at, direction) in shader.view.iter().zip(rays.view) {
                gl.uniform_3_f32_slice(Some(at), &row(direction));
            }
            gl.uniform_4_f32(
                Some(&shader.extent),
                (0.5 * w / f) as f32,
                (0.5 * h / f) as f32,
                (2.0 / w) as f32,
                (2.0 / h) as f32,
            );
            gl.uniform_4_f32_slice(Some(&shader.picture), &picture);
            gl.uniform_3_f32(
                Some(&shader.texels),
                1.0 / self.extent.width as f32,
                1.0 / self.extent.height as f32,
                f as f32,
            );
            let of_sky = if sky { share } else { 0.0 };
            gl.uniform_2_f32(Some(&shader.opacity), share as f32, of_sky as f32);
            gl.uniform_1_f32(Some(&shader.relief), relief(camera) as f32);
            if let (Some(at), Some(lines)) = (&shader.lines, look.lines) {
                let per_radian = 60.0 * 1_f64.to_degrees() / f64::from(lines.minutes());
                let meridian = camera.eye.longitude.0 * per_radian;
                let among = (meridian - meridian.floor()) as f32;
                gl.uniform_4_f32(Some(at), among, per_radian as f32, 0.0, 0.0);
            }
            gl.disable(glow::DEPTH_TEST);
            gl.enable(glow::BLEND);
            gl.blend_func(glow::SRC_ALPHA, glow::ONE_MINUS_SRC_ALPHA);
        }
        self.corners.draw(Primitive::Triangles, 0, 3);
        // SAFETY: as above.
        unsafe { gl.disable(glow::BLEND) };
        1
    }

    /// The eye's meridian and the equator in texels, texels per radian and around the Earth.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "numbers for the shader, which is f32"
    )]
    fn picture(&self, camera: &Camera) -> [f32; 4] {
        let (west_deg, south_deg) = self.extent.corner_deg();
        let spacing_deg = self.extent.spacing_deg();
        let around = 360.0 / spacing_deg;
        let east = (camera.eye.longitude.to_degrees() - west_deg) / spacing_deg;
        let east = east.rem_euclid(around);
        [
            east as f32,
            (-south_deg / spacing_deg) as f32,
            (1_f64.to_degrees() / spacing_deg) as f32,
            around as f32,
        ]
    }
}

/// How far the ground stands out from the ellipsoid: wholly below 100 km, not at all from 200 km on, where its height is a
/// few pixels at most.
fn relief(camera: &Camera) -> f64 {
    (2.0 - camera.eye.height_ellipsoid.0 / 100_000.0).clamp(0.0, 1.0)
}

/// A camera in axes in which the ellipsoid is the unit sphere, turned so that the eye is over the meridian of x.
#[derive(Clone, Copy, Debug)]
struct Rays {
    eye: DVec3,
    /// Its distance from the centre, squared, less 1.
    eye_less_1: f64,
    /// Directions: to the right edge, to the upper edge, forward.
    view: [DVec3; 3],
}

impl Rays {
    fn of(camera: &Camera) -> Self {
        let turn = DMat3::from_rotation_z(-camera.eye.longitude.0);
        let stretch = DVec3::new(1.0, 1.0, WGS84_A_M / WGS84_B_M);
        let f = 2.0 * camera.focal_px();
        let axes = turn * camera.eye_to_ecef();
        let eye = stretch * (turn * camera.eye.to_ecef()) / WGS84_A_M;
        Self {
            eye,
            eye_less_1: eye.length_squared() - 1.0,
            view: [
                stretch * axes.x_axis * (f64::from(camera.width_px) / f),
                stretch * axes.y_axis * (f64::from(camera.height_px) / f),
                -(stretch * axes.z_axis),
            ],
        }
    }
}

/// A side or place of the picture, which is at most a few thousand texels.
const fn side(texels: i32) -> u32 {
    texels.cast_unsigned()
}
