//! The files of a recording: `NAME`, which is written to, and `NAME.000001` and so on, which are full.

use std::ffi::{OsStr, OsString};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Digits of a file's number; more where they do not suffice.
const DIGITS: usize = 6;

/// What the file that is written to is called once it is full.
pub(super) fn full(path: &Path, number: u32) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(format!(".{number:0DIGITS$}"));
    name.into()
}

/// The full files of a recording with their numbers, the oldest first.
pub(super) fn fulls(path: &Path) -> io::Result<Vec<(u32, PathBuf)>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder(path))? {
        let entry = entry?;
        if let Some(number) = number(path, &entry.file_name()) {
            found.push((number, entry.path()));
        }
    }
    found.sort();
    Ok(found)
}

/// All files of a recording, the oldest first.
pub(super) fn all(path: &Path) -> io::Result<Vec<PathBuf>> {
    let mut files: Vec<PathBuf> = match fulls(path) {
        Ok(fulls) => fulls.into_iter().map(|(_, path)| path).collect(),
        Err(e) if e.kind() == io::ErrorKind::NotFound => Vec::new(),
        Err(e) => return Err(e),
    };
    if path.exists() {
        files.push(path.to_owned());
    }
    Ok(files)
}

/// The folder that a file is in.
pub(super) fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    }
}

/// The number in the name of a full file of the recording `path`.
fn number(path: &Path, name: &OsStr) -> Option<u32> {
    let own = path.file_name()?.as_encoded_bytes();
    let digits = name
        .as_encoded_bytes()
        .strip_prefix(own)?
        .strip_prefix(b".")?;
    let are_digits = digits.len() >= DIGITS && digits.iter().all(u8::is_ascii_digit);
    let text = std::str::from_utf8(digits).ok().filter(|_| are_digits)?;
    text.parse().ok()
}
