//! House rules for the shaders, by their text: what tile-based GPUs punish and what single precision cannot do stays out.
//!
//! That every shader compiles is the business of the tests that draw.
#![expect(
    clippy::expect_used,
    reason = "a helper that fails is a test that fails"
)]

#[path = "tidy/rust.rs"]
#[allow(dead_code, reason = "only the reading of words is needed here")]
mod rust;
mod support;

/// Name and text of each shader in a folder, comments blanked out.
fn shaders(folder: &str, endings: &[&str]) -> Vec<(String, String)> {
    let folder = support::source_dir().join(folder);
    let mut found = Vec::new();
    for entry in std::fs::read_dir(&folder).expect("the folder of shaders") {
        let path = entry.expect("a readable entry").path();
        let name = path
            .file_name()
            .expect("a name")
            .to_string_lossy()
            .into_owned();
        if endings.iter().any(|ending| name.ends_with(ending)) {
            let text = std::fs::read_to_string(&path).expect("a readable shader");
            found.push((name, rust::code_only(&text)));
        }
    }
    found
}

#[test]
fn no_shader_defeats_early_depth_tests() {
    for (name, text) in shaders("shaders", &[".vert", ".frag", ".glsl"]) {
        for word in ["discard", "gl_FragDepth"] {
            assert!(rust::words(&text, word).is_empty(), "{name} uses {word}");
        }
    }
}

#[test]
fn only_the_prelude_declares_version_and_default_precision() {
    for (name, text) in shaders("shaders", &[".vert", ".frag", ".glsl"]) {
        assert!(!text.contains("#version"), "{name} declares a version");
        assert!(
            rust::words(&text, "precision").is_empty(),
            "{name} sets a default precision"
        );
    }
    let prelude = shaders("shaders/include", &["prelude.glsl"]);
    assert!(
        prelude[0].1.trim_start().starts_with("#version 300 es\n"),
        "the prelude is OpenGL ES 3.00"
    );
}

#[test]
fn terrain_vertices_need_no_trigonometry() {
    // Single-precision sines of a latitude are a metre off; the tables carry what is needed in 64-bit arithmetic.
    for (name, text) in shaders("shaders", &["terrain.vert"]) {
        for word in ["sin", "cos", "tan", "asin", "acos", "atan"] {
            assert!(rust::words(&text, word).is_empty(), "{name} calls {word}");
        }
    }
}

#[test]
fn every_vertex_shader_has_its_fragment_shader() {
    let names: Vec<String> = shaders("shaders", &[".vert", ".frag"])
        .into_iter()
        .map(|(name, _)| name)
        .collect();
    for name in &names {
        let (stem, ending) = name.rsplit_once('.').expect("a name with an ending");
        let other = if ending == "vert" { "frag" } else { "vert" };
        assert!(
            names.contains(&format!("{stem}.{other}")),
            "{name} stands alone"
        );
    }
}
