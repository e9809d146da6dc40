//! The display controller itself: needs a card with a connected display that nobody holds, as in the guest; elsewhere
//! every test says SKIPPED.
//!
//! Where a display is known to be there, set `GLASSWING_TEST_KMS=1`: then a missing one is a failure.
//!
//! For a look at the glass from outside: with `GLASSWING_TEST_PICTURE=FILE.png` set, the picture that must be on the
//! display is written there; with `GLASSWING_TEST_HOLD_S=N` it then stays for N seconds, after the word HOLDING.
#![cfg(feature = "kms")]
#![expect(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking"
)]
#![expect(clippy::print_stdout, reason = "said to whoever looks at the glass")]

mod support;

use std::rc::Rc;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use glasswing::gl::Gpu;
use glasswing::gl::buffer::{Attribute, Primitive, Role, Scalar, Stream, VertexArray};
use glasswing::gl::program::Program;
use glasswing::gl::target::Target;
use glasswing::screen::kms::{self, Kms};
use glasswing::screen::{self, Flip, Screen, ScreenError, Wishes};
use glasswing::time::Monotonic;

/// One display, many tests.
static DISPLAY: Mutex<()> = Mutex::new(());

fn display() -> MutexGuard<'static, ()> {
    DISPLAY.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The display, or a plain word on why the test cannot run here.
fn open(wishes: &Wishes) -> Option<Kms> {
    let required = std::env::var_os("GLASSWING_TEST_KMS").is_some();
    match kms::open(wishes) {
        Ok(kms) => {
            println!("on {}", kms.describe());
            Some(kms)
        }
        Err(
            error @ (ScreenError::NoDisplay { .. }
            | ScreenError::Denied { .. }
            | ScreenError::Held { .. }),
        ) if !required => {
            support::skip(&format!("no display here: {error}"));
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// A rectangle of one colour: left, top, right, bottom in pixels from the top left corner.
type Rectangle = ([f32; 4], [u8; 4]);

/// A corner of a rectangle: where, in pixels from the top left corner, and its colour.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Corner {
    at_px: [f32; 2],
    colour: [u8; 4],
}

/// A picture that shows every mistake of orientation, order of colours and size: a red, a green, a blue and a white
/// quarter (from the top left, by rows), a white frame one pixel wide, and a dark bar around column `bar`.
struct Picture {
    gpu: Rc<Gpu>,
    program: Program,
    corners: Stream,
    arrays: Vec<VertexArray>,
}

impl Picture {
    fn new(gpu: &Rc<Gpu>) -> Self {
        let vert = "
            layout(location = 0) in vec2 at_px;
            layout(location = 1) in vec4 colour;
            uniform vec2 u_size_px;
            flat out mediump vec4 v_colour;
            void main() {
                v_colour = colour;
                vec2 unit = at_px / u_size_px;
                gl_Position = vec4(unit.x * 2.0 - 1.0, 1.0 - unit.y * 2.0, 0.0, 1.0);
            }";
        let frag = "
            flat in mediump vec4 v_colour;
            out mediump vec4 o_colour;
            void main() { o_colour = v_colour; }";
        let corners = Stream::new(gpu, Role::Vertex, 64 * size_of::<Corner>()).unwrap();
        let attribute = |location, components, scalar, offset_bytes| Attribute {
            location,
            components,
            scalar,
            offset_bytes,
        };
        let attributes = [
            attribute(0, 2, Scalar::F32, 0),
            attribute(1, 4, Scalar::U8Unit, 8),
        ];
        let arrays = corners
            .regions()
            .iter()
            .map(|region| VertexArray::new(gpu, region, 12, &attributes, None).unwrap())
            .collect();
        Self {
            gpu: Rc::clone(gpu),
            program: Program::new(gpu, "test picture", vert, frag).unwrap(),
            corners,
            arrays,
        }
    }

    fn draw(&mut self, target: &Target, bar: f32) {
        let (width, height) = target.size_px();
        let side = |px: u32| f32::from(u16::try_from(px).unwrap());
        let (w, h, x, y) = (side(width), side(height), side(width / 2), side(height / 2));
        let rectangles: [Rectangle; 5] = [
            ([1.0, 1.0, x, y], [255, 0, 0, 255]),
            ([x, 1.0, w - 1.0, y], [0, 255, 0, 255]),
            ([1.0, y, x, h - 1.0], [0, 0, 255, 255]),
            ([x, y, w - 1.0, h - 1.0], [255, 255, 255, 255]),
            ([bar - 4.0, 0.0, bar + 4.0, h], [51, 51, 51, 255]),
        ];
        let corners: Vec<Corner> = rectangles
            .iter()
            .flat_map(|([left, top, right, bottom], colour)| {
                [
                    [*left, *top],
                    [*right, *top],
                    [*left, *bottom],
                    [*left, *bottom],
                    [*right, *top],
                    [*right, *bottom],
                ]
                .map(|at_px| Corner {
                    at_px,
                    colour: *colour,
                })
            })
            .collect();
        let size = self.program.uniform("u_size_px").unwrap();
        target.bind();
        self.gpu.clear([1.0; 4]);
        self.program.bind();
        self.program.set_f32(&size, &[w, h]);
        let region = self.corners.write(&corners);
        self.arrays[region].draw(Primitive::Triangles, 0, 30);
        self.gpu.end_frame().unwrap();
    }
}

/// The same picture drawn headless.
fn expected(width: u32, height: u32, bar: f32) -> Vec<u8> {
    let screen = screen::surfaceless::open(width, height).unwrap();
    let gpu = Gpu::new(&|name| screen.gl_proc(name)).unwrap();
    let target = Target::offscreen(&gpu, width, height, 0).unwrap();
    Picture::new(&gpu).draw(&target, bar);
    let mut pixels = vec![0; (width * height * 4) as usize];
    target.read_rgba(&mut pixels);
    pixels
}

fn write_png(path: &str, width: u32, height: u32, rgba: &[u8]) {
    let rgb: Vec<u8> = rgba
        .chunks_exact(4)
        .flat_map(|p| [p[0], p[1], p[2]])
        .collect();
    let file = std::fs::File::create(path).expect("the picture's file");
    let mut encoder = png::Encoder::new(file, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder
        .write_header()
        .unwrap()
        .write_image_data(&rgb)
        .unwrap();
}

/// Pixels whose colours differ (opacity is not compared: the display's buffers have none).
fn differing(a: &[u8], b: &[u8]) -> usize {
    a.chunks_exact(4)
        .zip(b.chunks_exact(4))
        .filter(|(a, b)| a[..3] != b[..3])
        .count()
}

#[test]
fn thirty_frames_are_flipped_in_order_and_the_last_one_stays() {
    const BAR: f32 = 300.0;
    let _one = display();
    let Some(mut kms) = open(&Wishes::default()) else {
        return;
    };
    let (width, height) = kms.size_px();
    assert!(!kms.is_headless());
    let mut flips: Vec<Flip> = Vec::with_capacity(30);
    let mut shown = vec![0; (width * height * 4) as usize];
    let mut presenting = Duration::ZERO;
    {
        let gpu = Gpu::new(&|name| kms.gl_proc(name)).unwrap();
        println!("GL {} on {}", gpu.caps().version, gpu.caps().renderer);
        let window = Target::window(&gpu, width, height);
        let mut picture = Picture::new(&gpu);
        for frame in 0_u8..30 {
            picture.draw(&window, BAR - 10.0 * f32::from(29 - frame));
            if frame == 29 {
                window.read_rgba(&mut shown);
            }
            gpu.finish();
            let drawn = Monotonic::read();
            flips.push(kms.present().unwrap());
            presenting += Monotonic::read().since(drawn).unwrap();
        }
        if let Ok(seconds) = std::env::var("GLASSWING_TEST_HOLD_S") {
            if let Ok(path) = std::env::var("GLASSWING_TEST_PICTURE") {
                write_png(&path, width, height, &shown);
            }
            println!("HOLDING");
            std::thread::sleep(Duration::from_secs(seconds.parse().unwrap()));
        }
    }
    let sequence: Vec<u64> = flips.iter().map(|flip| flip.sequence).collect();
    assert_eq!(sequence, (1..=30).collect::<Vec<u64>>());
    for pair in flips.windows(2) {
        assert!(pair[1].at > pair[0].at, "{pair:?}");
    }
    let missed: u32 = flips.iter().map(|flip| flip.missed).sum();
    let took = flips[29].at.since(flips[0].at).unwrap();
    println!(
        "29 flips took {took:?}, {missed} refreshes missed; 30 calls of present took {presenting:?}"
    );
    drop(kms);
    let expected = expected(width, height, BAR);
    assert_eq!(
        differing(&shown, &expected),
        0,
        "pixels differ from headless"
    );
}

#[test]
fn frames_never_come_faster_than_the_display_can_show_them() {
    let _one = display();
    let Some(mut kms) = open(&Wishes::default()) else {
        return;
    };
    let first = kms.present().unwrap();
    for _ in 0..20 {
        kms.present().unwrap();
    }
    let last = kms.present().unwrap();
    let took = last.at.since(first.at).unwrap();
    println!("21 empty frames took {took:?}");
    // 75 Hz is the quickest of the virtual displays, 144 Hz of usual ones: 21 frames of 144 Hz take 146 ms. Without a
    // pace they would be there in a few.
    assert!(took > Duration::from_millis(140), "{took:?}");
}

#[test]
fn a_smoothed_picture_reaches_the_display() {
    let _one = display();
    let Some(mut kms) = open(&Wishes::default()) else {
        return;
    };
    let (width, height) = kms.size_px();
    let mut shown = vec![0; (width * height * 4) as usize];
    {
        let gpu = Gpu::new(&|name| kms.gl_proc(name)).unwrap();
        let window = Target::window(&gpu, width, height);
        let smooth = Target::offscreen(&gpu, width, height, 4).unwrap();
        Picture::new(&gpu).draw(&smooth, 50.0);
        smooth.copy_to(&window);
        window.read_rgba(&mut shown);
        gpu.check("while copying to the window").unwrap();
        kms.present().unwrap();
    }
    drop(kms);
    assert_eq!(differing(&shown, &expected(width, height, 50.0)), 0);
}

#[test]
fn a_display_that_is_held_is_refused_with_what_to_do() {
    let _one = display();
    let Some(kms) = open(&Wishes::default()) else {
        return;
    };
    let error = kms::open(&Wishes::default()).unwrap_err();
    assert!(matches!(error, ScreenError::Held { .. }), "{error:?}");
    let line = error.to_string();
    assert!(line.contains("another program holds the display"), "{line}");
    assert!(line.contains("systemctl stop display-manager"), "{line}");
    println!("{line}");
    drop(kms);
    assert!(open(&Wishes::default()).is_some(), "given up, it is free");
}

#[test]
fn a_headless_screen_leaves_the_display_to_others() {
    let _one = display();
    let headless = screen::surfaceless::open(64, 64).unwrap();
    let Some(kms) = open(&Wishes::default()) else {
        return;
    };
    drop(kms);
    drop(headless);
}

#[test]
fn wishes_are_met_or_refused_by_name() {
    let _one = display();
    if open(&Wishes::default()).is_none() {
        return;
    }
    let wish = |mode: &str| Wishes {
        mode: Some(mode.parse().unwrap()),
        ..Wishes::default()
    };
    let smaller = open(&wish("800x600")).expect("every virtual display offers 800x600");
    assert_eq!(smaller.size_px(), (800, 600));
    drop(smaller);
    let error = kms::open(&wish("123x45")).unwrap_err();
    assert!(error.is_configuration(), "{error:?}");
    assert!(
        error.to_string().contains("does not offer 123x45"),
        "{error}"
    );
    let nowhere = Wishes {
        connector: Some("DSI-9".into()),
        ..Wishes::default()
    };
    let error = kms::open(&nowhere).unwrap_err();
    assert!(error.is_configuration(), "{error:?}");
    println!("{error}");
}
