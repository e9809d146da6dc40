//! The contact sheet of a run: some of its frames side by side.

use crate::app::error::{Failure, Kind};
use crate::app::frames::pictures;
use crate::app::picture::{ContactSheet, Size};
use std::path::Path;

/// Width of a picture on the sheet, about: pictures are shrunk by a whole factor.
const CELL_WIDTH_PX: u32 = 512;

/// Writes a sheet of `columns` by `rows` frames of a folder, evenly spread over those written after the first sixth (in
/// which terrain may still be loading).
///
/// # Errors
/// When a frame cannot be read, or the sheet cannot be written.
pub fn write(folder: &Path, (columns, rows): (u32, u32), file: &Path) -> Result<(), Failure> {
    let frames = pictures(folder)?;
    let places = (columns * rows) as usize;
    let first = frames.len() / 6;
    let rest = frames.len() - first;
    let mut sheet: Option<ContactSheet> = None;
    for place in 0..places.min(rest) {
        let frame = &frames[first + place * rest / places.min(rest)];
        let (size, rgba) = read(frame)?;
        let factor = size.width_px.div_ceil(CELL_WIDTH_PX);
        sheet
            .get_or_insert_with(|| ContactSheet::new(size, factor, columns, rows))
            .place(&rgba, size.width_px);
    }
    sheet.map_or(Ok(()), |sheet| sheet.write(file))
}

/// A picture written by [`crate::app::picture::write_png`], as RGBA.
fn read(file: &Path) -> Result<(Size, Vec<u8>), Failure> {
    let opened = std::fs::File::open(file).map_err(|e| unreadable(file, e))?;
    let mut reader = png::Decoder::new(std::io::BufReader::new(opened))
        .read_info()
        .map_err(|e| unreadable(file, e))?;
    let mut rgb = vec![0; reader.output_buffer_size().unwrap_or(0)];
    let info = reader
        .next_frame(&mut rgb)
        .map_err(|e| unreadable(file, e))?;
    let rgba = rgb
        .chunks_exact(3)
        .flat_map(|p| [p[0], p[1], p[2], 255])
        .collect();
    Ok((
        Size {
            width_px: info.width,
            height_px: info.height,
        },
        rgba,
    ))
}

fn unreadable(path: &Path, e: impl std::error::Error + Send + Sync + 'static) -> Failure {
    Failure::new(
        Kind::Other,
        path.display(),
        "cannot be read back",
        "check the disk",
    )
    .caused_by(e)
}
