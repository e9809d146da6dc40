//! Pictures drawn on the headless screens, read back and checked pixel by pixel.
#![expect(
    clippy::unwrap_used,
    clippy::expect_used,
    reason = "a test fails by panicking"
)]

mod support;

use std::rc::Rc;

use glasswing::gl::buffer::{Attribute, Buffer, Primitive, Role, Scalar, VertexArray};
use glasswing::gl::program::Program;
use glasswing::gl::target::Target;
use glasswing::gl::texture::{Filter, Format, Texture, Wrap};
use glasswing::gl::{Flavour, GlError, Gpu};
use glasswing::screen::{self, Kind, Screen, ScreenError};
use support::skip;

const WIDTH: u32 = 64;
const HEIGHT: u32 = 48;

const VERT: &str = "
layout(location = 0) in vec2 position;
layout(location = 1) in vec4 colour;
out mediump vec4 v_colour;
void main() { v_colour = colour; gl_Position = vec4(position, 0.0, 1.0); }
";
const FRAG: &str = "
in mediump vec4 v_colour;
out mediump vec4 o_colour;
void main() { o_colour = v_colour; }
";

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Vertex {
    position: [f32; 2],
    colour: [u8; 4],
}

/// A screen and its GPU, to be dropped in the opposite order.
fn headless() -> (Box<dyn Screen>, Rc<Gpu>) {
    let screen = support::headless_screen(WIDTH, HEIGHT);
    let gpu = Gpu::new(&|name| screen.gl_proc(name)).expect("a GL context");
    (screen, gpu)
}

/// A scene with slopes, blended colours and depth: two triangles that cut through each other.
fn scene(gpu: &Rc<Gpu>) -> Vec<u8> {
    let vert = "
        layout(location = 0) in vec4 position;
        out vec3 v_colour;
        uniform float u_scale;
        void main() {
            v_colour = 0.5 + 0.5 * vec3(position.xy, sin(float(gl_VertexID)));
            gl_Position = vec4(position.xyz * u_scale, position.w);
        }";
    let frag = "
        in vec3 v_colour;
        out mediump vec4 o_colour;
        void main() { o_colour = vec4(v_colour * v_colour, 1.0); }";
    let target = Target::offscreen(gpu, WIDTH, HEIGHT, 0).unwrap();
    let program = Program::new(gpu, "scene", vert, frag).unwrap();
    let corners: [[f32; 4]; 6] = [
        [-0.9, -0.8, -0.5, 1.0],
        [0.8, -0.6, 0.5, 1.3],
        [0.1, 0.9, 0.2, 1.0],
        [-0.7, 0.7, -0.6, 1.0],
        [0.9, 0.8, 0.1, 1.1],
        [0.3, -0.9, 0.4, 1.0],
    ];
    let buffer = Buffer::fixed(gpu, Role::Vertex, &corners).unwrap();
    let position = Attribute {
        location: 0,
        components: 4,
        scalar: Scalar::F32,
        offset_bytes: 0,
    };
    let array = VertexArray::new(gpu, &buffer, 16, &[position], None).unwrap();
    let scale = program.uniform("u_scale").unwrap();
    target.bind();
    gpu.clear([0.1, 0.2, 0.3, 1.0]);
    gpu.depth_test(true);
    program.bind();
    program.set_f32(&scale, &[0.95]);
    array.draw(Primitive::Triangles, 0, 6);
    let mut pixels = vec![0; (WIDTH * HEIGHT * 4) as usize];
    target.read_rgba(&mut pixels);
    gpu.end_frame().unwrap();
    pixels
}

#[test]
fn osmesa_and_egl_draw_the_same_picture() {
    // One context after the other: both libraries share the notion of the current context.
    let draw = |screen: Result<Box<dyn Screen>, ScreenError>, flavour| {
        let screen = screen
            .inspect_err(|why| skip(&format!("EGL and OSMesa are not compared: {why}")))
            .ok()?;
        let gpu = Gpu::new(&|name| screen.gl_proc(name)).expect("a GL context");
        assert_eq!(gpu.caps().flavour, flavour);
        Some((scene(&gpu), gpu.caps().renderer.clone()))
    };
    let size = (WIDTH, HEIGHT);
    let egl = screen::open(&Kind::Surfaceless, size);
    let Some((by_egl, egl_renderer)) = draw(egl, Flavour::Es3) else {
        return;
    };
    let osmesa = screen::open(&Kind::OsMesa, size);
    let Some((by_osmesa, osmesa_renderer)) = draw(osmesa, Flavour::DesktopCore33) else {
        return;
    };
    if egl_renderer.split(' ').next() != osmesa_renderer.split(' ').next() {
        skip(&format!(
            "EGL draws with {egl_renderer}, OSMesa with {osmesa_renderer}"
        ));
        return;
    }
    let background = [26, 51, 77, 255];
    let drawn = by_egl.chunks_exact(4).filter(|p| *p != background).count();
    assert!(drawn > 500, "only {drawn} pixels were drawn");
    for (at, (a, b)) in by_egl.iter().zip(&by_osmesa).enumerate() {
        assert!(a.abs_diff(*b) <= 1, "byte {at}: {a} by EGL, {b} by OSMesa");
    }
}

#[test]
fn a_headless_screen_counts_what_it_is_shown() {
    let mut screen = support::headless_screen(WIDTH, HEIGHT);
    let first = screen.present().unwrap();
    let second = screen.present().unwrap();
    assert_eq!((first.sequence, second.sequence), (1, 2));
    assert!(second.at >= first.at);
    assert!(screen.is_headless());
}

/// A green triangle over the lower left half of blue, drawn and read back.
fn triangle(gpu: &Rc<Gpu>, samples: u32) -> Vec<u8> {
    let target = Target::offscreen(gpu, WIDTH, HEIGHT, samples).unwrap();
    let program = Program::new(gpu, "test", VERT, FRAG).unwrap();
    let green = [0, 255, 0, 255];
    let corner = |position| Vertex {
        position,
        colour: green,
    };
    let vertices = [
        corner([-1.0, 1.0]),
        corner([-1.0, -1.0]),
        corner([1.0, -1.0]),
    ];
    let buffer = Buffer::fixed(gpu, Role::Vertex, &vertices).unwrap();
    let indices = Buffer::fixed(gpu, Role::Index, &[0_u16, 1, 2]).unwrap();
    let attributes = [
        Attribute {
            location: 0,
            components: 2,
            scalar: Scalar::F32,
            offset_bytes: 0,
        },
        Attribute {
            location: 1,
            components: 4,
            scalar: Scalar::U8Unit,
            offset_bytes: 8,
        },
    ];
    let array = VertexArray::new(gpu, &buffer, 12, &attributes, Some(&indices)).unwrap();
    target.bind();
    gpu.clear([0.0, 0.0, 1.0, 1.0]);
    program.bind();
    array.draw_indexed(Primitive::Triangles, 0, 3, 1);
    let mut pixels = vec![0; (WIDTH * HEIGHT * 4) as usize];
    target.read_rgba(&mut pixels);
    gpu.end_frame().unwrap();
    pixels
}

fn pixel(pixels: &[u8], x: u32, y: u32) -> [u8; 4] {
    let at = ((y * WIDTH + x) * 4) as usize;
    pixels[at..at + 4].try_into().unwrap()
}

#[test]
fn a_triangle_is_where_it_was_drawn_with_the_top_row_first() {
    let (_screen, gpu) = headless();
    let pixels = triangle(&gpu, 0);
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            // The diagonal runs from the top left to the bottom right corner; pixels whose centre lies within a
            // hundredth of a pixel of it may be either.
            let side =
                (f64::from(x) + 0.5) / f64::from(WIDTH) - (f64::from(y) + 0.5) / f64::from(HEIGHT);
            let expected = if side < -1e-4 {
                [0, 255, 0, 255]
            } else if side > 1e-4 {
                [0, 0, 255, 255]
            } else {
                continue;
            };
            assert_eq!(pixel(&pixels, x, y), expected, "pixel {x}, {y}");
        }
    }
}

#[test]
fn multisampling_smooths_the_edge_and_nothing_else() {
    let (_screen, gpu) = headless();
    if gpu.caps().samples_max < 4 {
        skip(&format!("{} has no multisampling", gpu.caps().renderer));
        return;
    }
    let pixels = triangle(&gpu, 4);
    assert_eq!(pixel(&pixels, 0, HEIGHT - 1), [0, 255, 0, 255]);
    assert_eq!(pixel(&pixels, WIDTH - 1, 0), [0, 0, 255, 255]);
    let mixed = pixels
        .chunks_exact(4)
        .filter(|p| p[1] > 0 && p[1] < 255)
        .count();
    assert!(
        mixed > 30,
        "only {mixed} pixels of the diagonal are between green and blue"
    );
}

#[test]
fn integer_texels_arrive_exactly() {
    let (_screen, gpu) = headless();
    // Each texel of a WIDTH x HEIGHT texture holds its own column and 65535 less its row; the shader compares.
    let texels: Vec<u16> = (0..HEIGHT)
        .flat_map(|y| (0..WIDTH).map(move |x| (x, y)))
        .flat_map(|(x, y)| [u16::try_from(x).unwrap(), 65535 - u16::try_from(y).unwrap()])
        .collect();
    let texture = Texture::new(
        &gpu,
        Format::Rg16Ui,
        WIDTH,
        HEIGHT,
        Filter::Nearest,
        Wrap::Repeat,
    )
    .unwrap();
    texture.write_all(bytemuck::cast_slice(&texels));
    let program = Program::new(
        &gpu,
        "texels",
        "void main() {
            vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0;
            gl_Position = vec4(corner, 0.0, 1.0);
        }",
        "uniform usampler2D u_texels;
        out mediump vec4 o_colour;
        void main() {
            ivec2 at = ivec2(gl_FragCoord.xy);
            uvec2 found = texelFetch(u_texels, at, 0).rg;
            bool right = found == uvec2(uint(at.x), 65535u - uint(at.y));
            o_colour = right ? vec4(0.0, 1.0, 0.0, 1.0) : vec4(1.0, 0.0, 0.0, 1.0);
        }",
    )
    .unwrap();
    program.sampler("u_texels", 3).unwrap();
    let target = Target::offscreen(&gpu, WIDTH, HEIGHT, 0).unwrap();
    let array = VertexArray::empty(&gpu).unwrap();
    target.bind();
    gpu.clear([0.0; 4]);
    texture.bind(3);
    program.bind();
    array.draw(Primitive::Triangles, 0, 3);
    let mut pixels = vec![0; (WIDTH * HEIGHT * 4) as usize];
    target.read_rgba(&mut pixels);
    assert!(
        pixels.chunks_exact(4).all(|p| p == [0, 255, 0, 255]),
        "a texel differs"
    );
    gpu.end_frame().unwrap();
}

#[test]
fn a_shader_that_does_not_compile_is_named_with_the_drivers_log() {
    let (_screen, gpu) = headless();
    let error = Program::new(&gpu, "broken", VERT, "void main() { missing = 1.0; }").unwrap_err();
    let GlError::Shader { name, stage, log } = &error else {
        panic!("{error}");
    };
    assert_eq!((*name, *stage), ("broken", "fragment shader"));
    assert!(log.contains("missing"), "{log}");
}

#[test]
fn impossible_sizes_are_refused_with_the_limit() {
    let (_screen, gpu) = headless();
    let limit = gpu.caps().texture_size_max;
    let error = Target::offscreen(&gpu, limit + 1, 8, 0).unwrap_err();
    assert!(error.to_string().contains(&limit.to_string()), "{error}");
    let error = Texture::new(&gpu, Format::Rg16Ui, 8, 8, Filter::Linear, Wrap::Clamp).unwrap_err();
    assert!(error.to_string().contains("filtered"), "{error}");
}
