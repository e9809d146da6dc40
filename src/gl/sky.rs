//! The background of synthetic vision: sky above zero pitch, haze and ground below. Drawn after the terrain, where nothing
//! nearer was.

use std::rc::Rc;

use glow::HasContext as _;

use super::buffer::{Primitive, VertexArray};
use super::look::Palette;
use super::program::{Program, UniformLocation};
use super::{GlError, Gpu};
use crate::geo::Camera;

/// The haze that distance fades to, and the colour just below the horizon: red, green, blue, 0 to 1.
pub const HAZE: [f32; 3] = [0.80, 0.76, 0.68];

/// Height in which the air gets thinner by a factor e, metres (U.S. Standard Atmosphere 1976, about 8.4 km at the ground),
/// with what scatters most of the light in its lower half: doubled.
pub(super) const AIR_M: f64 = 16_800.0;

/// Draws it.
#[derive(Debug)]
pub struct SkyRenderer {
    gpu: Rc<Gpu>,
    program: Program,
    extent: UniformLocation,
    up: UniformLocation,
    brightness: UniformLocation,
    corners: VertexArray,
}

impl SkyRenderer {
    /// Compiles what it needs.
    ///
    /// # Errors
    /// [`GlError`] where the driver refuses the shader.
    pub fn new(gpu: &Rc<Gpu>) -> Result<Self, GlError> {
        let program = Program::new(
            gpu,
            "sky",
            include_str!("../../shaders/sky.vert"),
            include_str!("../../shaders/sky.frag"),
        )?;
        let haze = program.uniform("haze")?;
        program.bind();
        // SAFETY: the context is current on this thread (Gpu is !Send); the program is bound and the location its own.
        unsafe { gpu.gl().uniform_3_f32_slice(Some(&haze), &HAZE) };
        Ok(Self {
            gpu: Rc::clone(gpu),
            extent: program.uniform("extent")?,
            up: program.uniform("up")?,
            brightness: program.uniform("brightness")?,
            program,
            corners: VertexArray::empty(gpu)?,
        })
    }

    /// Draws it wherever the bound target's depth is still clear. One draw call. An invalid camera draws nothing.
    pub fn draw(&self, camera: &Camera, palette: Palette) {
        self.draw_over(camera, palette, 1.0);
    }

    /// The same, blended with what is there: `opacity` from 0 to 1.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "numbers for the shader, which is f32"
    )]
    pub fn draw_over(&self, camera: &Camera, palette: Palette, opacity: f64) {
        if !camera.is_valid() {
            return;
        }
        let f = 2.0 * camera.focal_px();
        let extent = [
            (f64::from(camera.width_px) / f) as f32,
            (f64::from(camera.height_px) / f) as f32,
        ];
        let down = camera.eye.ned_to_ecef().z_axis;
        let up = -(camera.eye_to_ecef().transpose() * down);
        let [r, g, b] = palette.brightness();
        let air = (-camera.eye.height_ellipsoid.0.max(0.0) / AIR_M).exp() as f32;
        let gl = self.gpu.gl();
        self.program.bind();
        // SAFETY: the context is current on this thread (Gpu is !Send); the program is bound, the locations its own.
        unsafe {
            gl.uniform_2_f32_slice(Some(&self.extent), &extent);
            gl.uniform_3_f32(Some(&self.up), up.x as f32, up.y as f32, up.z as f32);
            gl.uniform_4_f32(Some(&self.brightness), r, g, b, air);
            gl.enable(glow::DEPTH_TEST);
            gl.depth_func(glow::LEQUAL);
            gl.depth_mask(false);
            if opacity < 1.0 {
                gl.enable(glow::BLEND);
                gl.blend_color(0.0, 0.0, 0.0, opacity as f32);
                gl.blend_func(glow::CONSTANT_ALPHA, glow::ONE_MINUS_CONSTANT_ALPHA);
            } else {
                gl.disable(glow::BLEND);
            }
        }
        self.corners.draw(Primitive::Triangles, 0, 3);
        // SAFETY: as above.
        unsafe {
            gl.disable(glow::BLEND);
            gl.depth_mask(true);
            gl.disable(glow::DEPTH_TEST);
        }
    }
}
