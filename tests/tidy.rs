//! House rules, held by a test: what may name what, where `unsafe` may stand, how long files and functions may be.
//!
//! Each rule is a function from a file's path and text to complaints, so that it can be tried on a few lines first:
//! a rule that never complains is worse than none.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

#[path = "tidy/rust.rs"]
mod rust;
mod support;

use std::path::{Path, PathBuf};

const LINES_PER_FILE: usize = 600;
const LINES_PER_FUNCTION: usize = 70;

/// What may stand at the top of the repository; `shared` is a folder of data beside or in it, never part of it.
const TOP_LEVEL: [&str; 20] = [
    ".cargo",
    ".ci",
    ".git",
    ".gitignore",
    "boards",
    "Cargo.lock",
    "Cargo.toml",
    "CHANGELOG.md",
    "dev",
    "glasswing-demo",
    "LICENSE-APACHE",
    "LICENSE-MIT",
    "README.md",
    "shaders",
    "src",
    "systemd",
    "target",
    "tests",
    ".github",
    "shared",
];

/// The vocabulary, which every layer may name; `heap` counts allocations and is named where they are checked.
const VOCABULARY: [&str; 9] = [
    "limits",
    "time",
    "units",
    "angle",
    "atmosphere",
    "geo",
    "sampled",
    "signal",
    "heap",
];

/// What each layer may name beside itself and the vocabulary: a module, or one name in it.
const MAY_NAME: [(&str, &[&str]); 19] = [
    ("limits", &[]),
    ("time", &[]),
    ("units", &[]),
    ("angle", &[]),
    ("atmosphere", &[]),
    ("geo", &[]),
    ("sampled", &[]),
    ("signal", &[]),
    ("heap", &[]),
    ("proto", &[]),
    ("recording", &[]),
    ("bus", &[]),
    ("bench", &["proto", "state::magnetic"]),
    ("state", &[]),
    (
        "display",
        &["state::snapshot", "state::traffic", "state::FlightState"],
    ),
    ("draw", &["display"]),
    ("terrain", &[]),
    ("gl", &["draw::list", "draw::atlas", "terrain"]),
    ("screen", &[]),
];

/// Where `unsafe` may stand.
const HAZARDS: [&str; 3] = ["src/gl/", "src/screen/", "src/heap.rs"];

/// The layer of a source file: the module below the root that it belongs to.
fn layer(path: &str) -> Option<&str> {
    path.strip_prefix("src/")?.split(['/', '.']).next()
}

fn imports(path: &str, text: &str) -> Vec<String> {
    let Some(own) = layer(path) else {
        return Vec::new();
    };
    let code = rust::code_only(text);
    let root = if own == "main" { "glasswing" } else { "crate" };
    let may = |named: &[String]| {
        let whole = named.join("::");
        match own {
            "lib" | "app" => true,
            "main" => named[0] == "app",
            // Tests beside a module make their inputs from whichever layer they come from.
            _ if path.ends_with("/tests.rs") => named[0] != "app",
            _ => {
                let listed =
                    MAY_NAME
                        .iter()
                        .find(|(name, _)| *name == own)
                        .is_some_and(|(_, may)| {
                            may.contains(&whole.as_str()) || may.contains(&named[0].as_str())
                        });
                listed || named[0] == own || VOCABULARY.contains(&named[0].as_str())
            }
        }
    };
    let wrong = rust::paths(&code, root)
        .into_iter()
        .filter(|(_, named)| !may(named));
    let mut complaints: Vec<String> = wrong
        .map(|(line, named)| format!("{path}:{line}: {own} may not name {}", named.join("::")))
        .collect();
    for at in rust::words(&code, "super") {
        if code[at..].starts_with("super::super") {
            let line = rust::line_of(&code, at);
            complaints.push(format!("{path}:{line}: super::super hides what is named"));
        }
    }
    complaints
}

fn unsafe_code(path: &str, text: &str) -> Vec<String> {
    let code = rust::code_only(text);
    let lines: Vec<&str> = text.lines().collect();
    let mut complaints = Vec::new();
    for at in rust::words(&code, "unsafe") {
        let line = rust::line_of(&code, at);
        if !HAZARDS.iter().any(|hazard| path.starts_with(hazard)) {
            complaints.push(format!("{path}:{line}: unsafe stands only in {HAZARDS:?}"));
        }
        let what = code[at + "unsafe".len()..].trim_start();
        let argued = lines[..line]
            .iter()
            .rev()
            .take(12)
            .any(|l| l.contains("SAFETY:"));
        if (what.starts_with('{') || what.starts_with("impl")) && !argued {
            complaints.push(format!("{path}:{line}: unsafe without a SAFETY comment"));
        }
    }
    complaints
}

fn lengths(path: &str, text: &str) -> Vec<String> {
    let mut complaints = Vec::new();
    let lines = text.lines().count();
    if lines > LINES_PER_FILE {
        complaints.push(format!("{path}: {lines} lines, at most {LINES_PER_FILE}"));
    }
    if path.ends_with(".rs") {
        for (name, line, lines) in rust::functions(&rust::code_only(text)) {
            if lines > LINES_PER_FUNCTION {
                let most = format!("at most {LINES_PER_FUNCTION}");
                complaints.push(format!("{path}:{line}: {name} has {lines} lines, {most}"));
            }
        }
    }
    complaints
}

/// Words that mean "not finished". They are put together here, or this file would hold them.
fn unfinished(path: &str, text: &str) -> Vec<String> {
    let words = [
        concat!("to", "do!"),
        concat!("unimpl", "emented!"),
        concat!("FIX", "ME"),
        concat!("TO", "DO"),
        concat!("XX", "X"),
    ];
    let found = words.iter().flat_map(|word| {
        rust::words(text, word)
            .into_iter()
            .map(move |at| (word, at))
    });
    found
        .map(|(word, at)| format!("{path}:{}: {word}", rust::line_of(text, at)))
        .collect()
}

/// Paths that exist on one person's machine only.
fn machine_paths(path: &str, text: &str) -> Vec<String> {
    let homes = [
        concat!("/ho", "me/"),
        concat!("/ro", "ot/"),
        concat!("/Us", "ers/"),
    ];
    let found = homes.iter().flat_map(|home| text.match_indices(home));
    found
        .map(|(at, home)| {
            format!(
                "{path}:{}: a path of one machine: {home}",
                rust::line_of(text, at)
            )
        })
        .collect()
}

/// What a module is for stands at its head; the tests beside a module need not say it again.
fn module_doc(path: &str, text: &str) -> Vec<String> {
    let documented = text.starts_with("//!") || text.starts_with("#![doc");
    if path.ends_with(".rs") && !path.ends_with("/tests.rs") && !documented {
        return vec![format!("{path}:1: no //! line says what this is for")];
    }
    Vec::new()
}

/// The test harness swallows what a passing test prints by macro, so a skip must not be told that way.
fn silent_skips(path: &str, text: &str) -> Vec<String> {
    let told = concat!("(\"SKIP", "PED");
    let found = text
        .match_indices(told)
        .filter(|_| path.starts_with("tests/"));
    found
        .map(|(at, _)| {
            format!(
                "{path}:{}: use support::skip: a macro is not heard here",
                rust::line_of(text, at)
            )
        })
        .collect()
}

/// A file of the repository: its path from the root, with slashes, and its text.
struct File {
    path: String,
    text: String,
}

/// Every text file of the repository; what Git ignores, and pictures, are left out.
fn files() -> Vec<File> {
    let mut found = Vec::new();
    let mut folders = vec![support::source_dir().to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("a folder that was just listed") {
            let path = entry.expect("a readable entry").path();
            let below = below_root(&path);
            if path.is_symlink()
                || ["target", ".git", "shared", "glasswing-demo"].contains(&below.as_str())
            {
                continue;
            } else if path.is_dir() {
                folders.push(path);
            } else if let Ok(text) = std::fs::read_to_string(&path) {
                found.push(File { path: below, text });
            }
        }
    }
    assert!(
        found.len() > 20,
        "the source tree is not where the test looks"
    );
    found
}

fn below_root(path: &Path) -> String {
    let below: PathBuf = path
        .strip_prefix(support::source_dir())
        .expect("a path below the root")
        .to_path_buf();
    below.to_string_lossy().replace('\\', "/")
}

/// Applies a rule to the files that `chosen` picks.
fn hold(rule: fn(&str, &str) -> Vec<String>, chosen: fn(&str) -> bool) {
    let files = files();
    let complaints: Vec<String> = files
        .iter()
        .filter(|file| chosen(&file.path))
        .flat_map(|file| rule(&file.path, &file.text))
        .collect();
    assert!(complaints.is_empty(), "\n{}\n", complaints.join("\n"));
}

fn is_rust(path: &str) -> bool {
    path.ends_with(".rs")
}

fn is_ours(path: &str) -> bool {
    !path.ends_with("Cargo.lock") && !path.starts_with("LICENSE-")
}

fn is_code(path: &str) -> bool {
    [".rs", ".py", ".sh", ".vert", ".frag", ".glsl"]
        .iter()
        .any(|ending| path.ends_with(ending))
        || ["dev", ".ci/run"].contains(&path)
}

#[test]
fn imports_go_downward_only() {
    hold(imports, is_rust);
}

#[test]
fn unsafe_stands_in_the_hazard_modules_and_is_argued() {
    hold(unsafe_code, is_rust);
}

#[test]
fn files_and_functions_are_short() {
    hold(lengths, is_code);
}

#[test]
fn nothing_is_left_unfinished() {
    hold(unfinished, is_ours);
}

#[test]
fn no_file_names_a_path_of_one_machine() {
    hold(machine_paths, is_ours);
}

#[test]
fn every_module_says_what_it_is_for() {
    hold(module_doc, is_rust);
}

#[test]
fn no_test_is_skipped_silently() {
    hold(silent_skips, is_rust);
}

#[test]
fn the_top_level_holds_what_was_agreed() {
    for entry in std::fs::read_dir(support::source_dir()).expect("the source tree") {
        let name = entry.expect("a readable entry").file_name();
        let name = name.to_string_lossy();
        assert!(
            TOP_LEVEL.contains(&name.as_ref()),
            "{name} does not belong at the top of the repository"
        );
    }
}

#[test]
fn every_layer_is_in_the_table() {
    for file in files() {
        if let Some(own) = layer(&file.path) {
            let known = ["lib", "main", "app", "ARCHITECTURE"].contains(&own);
            assert!(
                known || MAY_NAME.iter().any(|(name, _)| *name == own),
                "{} has no layer",
                file.path
            );
        }
    }
}

#[test]
fn every_shader_is_built_into_the_program() {
    let files = files();
    let named = |shader: &str| {
        files
            .iter()
            .any(|f| f.path.starts_with("src/") && f.text.contains(&format!("{shader}\"")))
    };
    for file in files
        .iter()
        .filter(|file| file.path.starts_with("shaders/"))
    {
        assert!(named(&file.path), "{} is used by nothing in src", file.path);
    }
}

/// Complaints of a rule about a few lines.
fn complaints(rule: fn(&str, &str) -> Vec<String>, path: &str, text: &str) -> usize {
    rule(path, text).len()
}

#[test]
fn the_import_rule_sees_every_form_of_a_path() {
    let wrong = [
        "use crate::app::Failure;",
        "use crate::{time::Monotonic, gl::Gpu};",
        "use crate::{units, state};",
        "fn f() -> crate::display::Model { loop {} }",
        "use crate::{\n    limits::{A, B},\n    app as other,\n};",
        "use super::super::time;",
    ];
    for text in wrong {
        assert_eq!(complaints(imports, "src/proto/x.rs", text), 1, "{text}");
    }
    let right = [
        "use crate::time::Monotonic;",
        "use crate::{units::{Metres, Feet}, signal::Frame, proto::framing};",
        "// crate::app is named in a comment",
        "/* crate::gl */ const S: &str = \"crate::gl\";",
        "const R: &str = r#\"crate::gl \"quoted\" \"#; const C: char = '\"';",
        "pub(in crate::proto) fn f<'a>(x: &'a str) {}",
    ];
    for text in right {
        assert_eq!(complaints(imports, "src/proto/x.rs", text), 0, "{text}");
    }
    assert_eq!(
        complaints(imports, "src/main.rs", "fn main() { glasswing::gl::x() }"),
        1,
        "main names app only"
    );
    assert_eq!(
        complaints(
            imports,
            "src/main.rs",
            "fn main() { glasswing::app::main() }"
        ),
        0,
        "main names app"
    );
    let display = "use crate::state::{snapshot::FlightState, Fusion};";
    assert_eq!(
        complaints(imports, "src/display/pfd.rs", display),
        1,
        "display sees the snapshot only"
    );
    let gl = "use crate::draw::{list::DrawList, atlas, layout};";
    assert_eq!(
        complaints(imports, "src/gl/vector.rs", gl),
        1,
        "gl sees the list and the atlas only"
    );
}

#[test]
fn the_unsafe_rule_sees_place_and_argument() {
    let argued = "// SAFETY: the pointer is ours.\nunsafe { f() }";
    assert_eq!(
        complaints(unsafe_code, "src/gl/buffer.rs", argued),
        0,
        "argued"
    );
    assert_eq!(
        complaints(unsafe_code, "src/state/mod.rs", argued),
        1,
        "in the wrong place"
    );
    assert_eq!(
        complaints(
            unsafe_code,
            "src/gl/buffer.rs",
            "let a = 1;\nunsafe { f() }"
        ),
        1,
        "not argued"
    );
    assert_eq!(
        complaints(
            unsafe_code,
            "src/state/mod.rs",
            "#![deny(unsafe_code)] // unsafe"
        ),
        0,
        "only its name"
    );
}

#[test]
fn the_length_rule_counts_code_lines_of_a_body() {
    let body = |lines: usize| {
        format!(
            "//! x\nfn f(a: [u8; 3]) -> u8 {{\n{}}}\n",
            "    g();\n\n    // why\n".repeat(lines)
        )
    };
    assert_eq!(
        complaints(lengths, "src/a.rs", &body(LINES_PER_FUNCTION)),
        0,
        "as long as may be"
    );
    assert_eq!(
        complaints(lengths, "src/a.rs", &body(LINES_PER_FUNCTION + 1)),
        1,
        "one line too long"
    );
    assert_eq!(
        complaints(lengths, "src/a.rs", &"x\n".repeat(LINES_PER_FILE + 1)),
        1,
        "a long file"
    );
}

#[test]
fn the_small_rules_complain_too() {
    assert_eq!(
        complaints(unfinished, "a.rs", concat!("fn f() { to", "do!() }")),
        1,
        "unfinished"
    );
    assert_eq!(
        complaints(machine_paths, "a.md", concat!("see /ho", "me/me/x")),
        1,
        "a home folder"
    );
    assert_eq!(
        complaints(module_doc, "src/a.rs", "fn f() {}"),
        1,
        "no head"
    );
    assert_eq!(
        complaints(
            silent_skips,
            "tests/a.rs",
            concat!("println!(\"SKIP", "PED: x\")")
        ),
        1,
        "unheard"
    );
}
