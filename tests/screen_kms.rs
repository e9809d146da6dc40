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
use glasswing::gl::buffer::{Primitive, VertexArray};
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

/// A picture that shows every mistake of orientation, order of colours and size: a red, a green, a blue and a white
/// quarter (from the top left, by rows), a white frame one pixel wide, and a dark bar at column `bar`.
struct Picture {
    gpu: Rc<Gpu>,
    program: Program,
    array: VertexArray,
}

impl Picture {
    fn new(gpu: &Rc<Gpu>) -> Self {
        let vert = "
            void main() {
                vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0;
                gl_Position = vec4(corner, 0.0, 1.0);
            }";
        let frag = "
            uniform vec3 u_size_and_bar;
            out mediump vec4 o_colour;
            void main() {
                vec2 size = u_size_and_bar.xy;
                vec2 at = vec2(gl_FragCoord.x, size.y - gl_FragCoord.y);
                bool right = at.x > size.x * 0.5;
                bool low = at.y > size.y * 0.5;
                vec3 colour = low ? (right ? vec3(1.0) : vec3(0.0, 0.0, 1.0))
                                  : (right ? vec3(0.0, 1.0, 0.0) : vec3(1.0, 0.0, 0.0));
                vec2 edge = min(at, size - at);
                if (min(edge.x, edge.y) < 1.0) colour = vec3(1.0);
                if (abs(at.x - u_size_and_bar.z) < 4.0) colour = vec3(0.2, 0.2, 0.2);
                o_colour = vec4(colour, 1.0);
            }";
        Self {
            gpu: Rc::clone(gpu),
            program: Program::new(gpu, "test picture", vert, frag).unwrap(),
            array: VertexArray::empty(gpu).unwrap(),
        }
    }

    fn draw(&self, target: &Target, bar: f32) {
        let (width, height) = target.size_px();
        let (width, height) = (
            u16::try_from(width).unwrap(),
            u16::try_from(height).unwrap(),
        );
        let at = self.program.uniform("u_size_and_bar").unwrap();
        target.bind();
        self.gpu.clear([0.0, 0.0, 0.0, 1.0]);
        self.program.bind();
        self.program
            .set_f32(&at, &[width.into(), height.into(), bar]);
        self.array.draw(Primitive::Triangles, 0, 3);
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
        let picture = Picture::new(&gpu);
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
