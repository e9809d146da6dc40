//! What the integration tests share: where the program, the test data and a place to write are.
//!
//! Nothing here decides whether a test passes. A test that cannot run here and now says so on a line that starts with
//! `SKIPPED:`; the entry script `dev` collects those lines so that none goes unnoticed.

#![allow(
    dead_code,
    reason = "every test includes this module and uses only some of it"
)]

use std::ffi::{CStr, c_void};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, MutexGuard, PoisonError};

use glasswing::screen::{self, Flip, Screen, ScreenError};

/// The variable Cargo itself reads to find the program that runs aarch64 binaries on another machine.
const AARCH64_RUNNER: &str = "CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER";

/// The program under test, ready for arguments.
///
/// When the tests themselves run under emulation the kernel cannot start the program (no binfmt_misc), so the emulator
/// named by [`AARCH64_RUNNER`] is put in front of it, with whatever arguments that variable gives it.
pub(crate) fn glasswing_command() -> Command {
    let program = env!("CARGO_BIN_EXE_glasswing");
    let runner = std::env::var(AARCH64_RUNNER).unwrap_or_default();
    let mut words = runner.split_whitespace();
    match words.next() {
        Some(emulator) if cfg!(target_arch = "aarch64") => {
            let mut command = Command::new(emulator);
            command.args(words).arg(program);
            command
        }
        _ => Command::new(program),
    }
}

/// True when the tests run under an emulator: they may then be an order of magnitude slower, never different.
pub(crate) fn is_emulated() -> bool {
    cfg!(target_arch = "aarch64") && std::env::var_os(AARCH64_RUNNER).is_some()
}

/// The headless screen the tests draw on: EGL, or what `GLASSWING_TEST_SCREEN` names (`surfaceless` or `osmesa`).
///
/// # Panics
/// If that screen does not open: `dev` installs both, so a machine without them is a failure, not a reason to skip.
#[expect(
    clippy::panic,
    reason = "without the screen that was asked for there is no test"
)]
pub(crate) fn headless_screen(width_px: u32, height_px: u32) -> Box<dyn Screen> {
    let kind = std::env::var("GLASSWING_TEST_SCREEN").unwrap_or_else(|_| "surfaceless".to_owned());
    // A test that failed while it had its turn has nothing to spoil for the next.
    let turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let opened: Result<Box<dyn Screen>, ScreenError> = match kind.as_str() {
        "surfaceless" => screen::surfaceless::open(width_px, height_px).map(|s| Box::new(s) as _),
        "osmesa" => screen::osmesa::open(width_px, height_px).map(|s| Box::new(s) as _),
        _ => panic!("GLASSWING_TEST_SCREEN is {kind}: it may be surfaceless or osmesa"),
    };
    let screen = opened.unwrap_or_else(|e| panic!("{kind}: {e}"));
    Box::new(Turn {
        screen,
        _turn: turn,
    })
}

/// One screen at a time, whatever the number of test threads: the program never has two, and how a driver fares with
/// several contexts in several threads (software renderers under emulation fare badly) is not what is tested.
#[derive(Debug)]
struct Turn {
    screen: Box<dyn Screen>,
    // Released last: fields are dropped in order.
    _turn: MutexGuard<'static, ()>,
}

static TURN: Mutex<()> = Mutex::new(());

impl Screen for Turn {
    fn size_px(&self) -> (u32, u32) {
        self.screen.size_px()
    }

    fn gl_proc(&self, name: &CStr) -> *const c_void {
        self.screen.gl_proc(name)
    }

    fn is_headless(&self) -> bool {
        self.screen.is_headless()
    }

    fn describe(&self) -> String {
        self.screen.describe()
    }

    fn present(&mut self) -> Result<Flip, ScreenError> {
        self.screen.present()
    }
}

/// The root of the source tree.
pub(crate) fn source_dir() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The folder with real elevation tiles, captures and recordings, if this machine has it.
///
/// `GLASSWING_DATA` names it; without that variable it is `../shared/data` beside the source tree. Where there is none
/// this says so and gives `None`: the caller returns, since only tests on real data can do without it.
pub(crate) fn data_dir() -> Option<PathBuf> {
    let dir = std::env::var_os("GLASSWING_DATA")
        .map_or_else(|| source_dir().join("../shared/data"), PathBuf::from);
    if dir.is_dir() {
        return Some(dir);
    }
    skip(&format!("no test data at {}", dir.display()));
    None
}

/// Says that a test, or a part of one, does not run on this machine, and why.
///
/// Written to the stream itself: the test harness keeps to itself what a passing test prints by macro.
pub(crate) fn skip(why: &str) {
    // A lost line is no reason to fail a test.
    let _ = writeln!(std::io::stderr(), "SKIPPED: {why}");
}

/// An empty folder to write in, below Cargo's target folder. `name` is the test's own: two tests must not share one.
///
/// # Panics
/// If the folder cannot be emptied or made.
#[expect(
    clippy::expect_used,
    reason = "without a place to write there is no test"
)]
pub(crate) fn scratch_dir(name: &str) -> PathBuf {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join(std::env::consts::ARCH)
        .join(name);
    if dir.exists() {
        std::fs::remove_dir_all(&dir).expect("scratch folder is emptied");
    }
    std::fs::create_dir_all(&dir).expect("scratch folder is made");
    dir
}
