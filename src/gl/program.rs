//! Shader programs. Sources are GLSL ES 3.00 without their first lines: `shaders/include/prelude.glsl` is put before
//! each, the only place where version and default precisions stand. Attributes get their places by
//! `layout(location = n)` in the source. Uniforms are looked up once, by the owner's constructor, never per frame.

use std::rc::Rc;

use glow::HasContext as _;

use super::{GlError, Gpu};

/// Where a uniform lives in its program. `Copy`; meaningful for that program only.
pub use glow::UniformLocation;

const PRELUDE: &str = include_str!("../../shaders/include/prelude.glsl");

/// A linked program.
#[derive(Debug)]
pub struct Program {
    gpu: Rc<Gpu>,
    name: &'static str,
    id: glow::Program,
}

impl Program {
    /// Compiles and links. `name` is for messages; `vert_src` and `frag_src` come without `#version`.
    ///
    /// # Errors
    /// [`GlError::Shader`] with the driver's log (its line numbers count from the first line of the source itself).
    pub fn new(
        gpu: &Rc<Gpu>,
        name: &'static str,
        vert_src: &str,
        frag_src: &str,
    ) -> Result<Self, GlError> {
        Self::recording(gpu, name, vert_src, frag_src, &[])
    }

    /// The same, and its vertices can be read back ([`super::feedback::Recorder`]): the outputs named, one after the
    /// other.
    ///
    /// # Errors
    /// As [`Self::new`]; an output that the shader does not have fails to link.
    pub fn recording(
        gpu: &Rc<Gpu>,
        name: &'static str,
        vert_src: &str,
        frag_src: &str,
        outputs: &[&str],
    ) -> Result<Self, GlError> {
        let gl = gpu.gl();
        let vertex = Shader::compile(gpu, name, glow::VERTEX_SHADER, vert_src)?;
        let fragment = Shader::compile(gpu, name, glow::FRAGMENT_SHADER, frag_src)?;
        // SAFETY: the context is current on this thread (Gpu is !Send).
        let id = unsafe { gl.create_program() }.map_err(|why| GlError::Object {
            what: format!("shader {name}"),
            why,
        })?;
        let program = Self {
            gpu: Rc::clone(gpu),
            name,
            id,
        };
        // SAFETY: as above; the program and both shaders were made by this context just now.
        let (linked, log) = unsafe {
            gl.attach_shader(id, vertex.id);
            gl.attach_shader(id, fragment.id);
            if !outputs.is_empty() {
                gl.transform_feedback_varyings(id, outputs, glow::INTERLEAVED_ATTRIBS);
            }
            gl.link_program(id);
            gl.detach_shader(id, vertex.id);
            gl.detach_shader(id, fragment.id);
            (gl.get_program_link_status(id), gl.get_program_info_log(id))
        };
        if linked {
            return Ok(program);
        }
        Err(GlError::Shader {
            name,
            stage: "linking",
            log: log.trim().to_owned(),
        })
    }

    /// Makes it the program that draws.
    pub fn bind(&self) {
        // SAFETY: the context is current on this thread (Gpu is !Send) and the program is alive.
        unsafe { self.gpu.gl().use_program(Some(self.id)) };
    }

    /// Looks a uniform up.
    ///
    /// # Errors
    /// [`GlError::Uniform`] where the linked program has none of that name.
    pub fn uniform(&self, name: &str) -> Result<UniformLocation, GlError> {
        // SAFETY: as in `bind`.
        unsafe { self.gpu.gl().get_uniform_location(self.id, name) }
            .ok_or_else(|| self.no_uniform(name))
    }

    /// Binds the program and lets the sampler `name` read texture unit `unit`, for good.
    ///
    /// # Errors
    /// [`GlError::Uniform`] where the linked program has no sampler of that name.
    pub fn sampler(&self, name: &str, unit: u32) -> Result<(), GlError> {
        let location = self.uniform(name)?;
        self.bind();
        // SAFETY: as in `bind`; the location is this program's.
        unsafe {
            self.gpu
                .gl()
                .uniform_1_i32(Some(&location), i32::try_from(unit).unwrap_or(0));
        };
        Ok(())
    }

    /// Lets the uniform block `name` read the uniform buffer bound at `binding`, for good.
    ///
    /// # Errors
    /// [`GlError::Uniform`] where the linked program has no block of that name.
    pub fn block(&self, name: &str, binding: u32) -> Result<(), GlError> {
        // SAFETY: as in `bind`.
        let index = unsafe { self.gpu.gl().get_uniform_block_index(self.id, name) }
            .ok_or_else(|| self.no_uniform(name))?;
        // SAFETY: as in `bind`; the index is this program's.
        unsafe {
            self.gpu.gl().uniform_block_binding(self.id, index, binding);
        };
        Ok(())
    }

    /// Sets a `float`, `vec2`, `vec3`, `vec4` or `mat4` (by columns) from 1, 2, 3, 4 or 16 numbers. The program must be
    /// bound.
    ///
    /// # Panics
    /// For another count of numbers.
    pub fn set_f32(&self, at: &UniformLocation, numbers: &[f32]) {
        let gl = self.gpu.gl();
        // SAFETY: as in `bind`; GL checks that the location's type fits and refuses otherwise.
        unsafe {
            match numbers.len() {
                1 => gl.uniform_1_f32_slice(Some(at), numbers),
                2 => gl.uniform_2_f32_slice(Some(at), numbers),
                3 => gl.uniform_3_f32_slice(Some(at), numbers),
                4 => gl.uniform_4_f32_slice(Some(at), numbers),
                16 => gl.uniform_matrix_4_f32_slice(Some(at), false, numbers),
                count => assert!(
                    matches!(count, 1..=4 | 16),
                    "shader {}: a uniform of {count} numbers",
                    self.name
                ),
            }
        }
    }

    fn no_uniform(&self, name: &str) -> GlError {
        GlError::Uniform {
            name: self.name,
            uniform: name.to_owned(),
        }
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        // SAFETY: as in `bind`; nothing uses the program after this.
        unsafe { self.gpu.gl().delete_program(self.id) };
    }
}

/// A compiled shader, deleted when dropped (the linked program keeps what it needs).
struct Shader {
    gpu: Rc<Gpu>,
    id: glow::Shader,
}

impl Shader {
    fn compile(
        gpu: &Rc<Gpu>,
        name: &'static str,
        kind: u32,
        source: &str,
    ) -> Result<Self, GlError> {
        let gl = gpu.gl();
        // SAFETY: the context is current on this thread (Gpu is !Send).
        let id = unsafe { gl.create_shader(kind) }.map_err(|why| GlError::Object {
            what: format!("shader {name}"),
            why,
        })?;
        let shader = Self {
            gpu: Rc::clone(gpu),
            id,
        };
        // `#line 1` makes the log count from the source's own first line.
        let full = format!("{PRELUDE}#line 1\n{source}");
        // SAFETY: as above; the shader was made by this context just now.
        let (compiled, log) = unsafe {
            gl.shader_source(id, &full);
            gl.compile_shader(id);
            (gl.get_shader_compile_status(id), gl.get_shader_info_log(id))
        };
        if compiled {
            return Ok(shader);
        }
        Err(GlError::Shader {
            name,
            stage: if kind == glow::VERTEX_SHADER {
                "vertex shader"
            } else {
                "fragment shader"
            },
            log: log.trim().to_owned(),
        })
    }
}

impl Drop for Shader {
    fn drop(&mut self) {
        // SAFETY: the context is current on this thread (Gpu is !Send); nothing uses the shader after this.
        unsafe { self.gpu.gl().delete_shader(self.id) };
    }
}
