//! Pictures as files: PNG from RGBA rows, and the contact sheet.

use crate::app::error::{Failure, Kind};
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

/// Width and height in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Width in pixels.
    pub width_px: u32,
    /// Height in pixels.
    pub height_px: u32,
}

/// The largest side of a picture that may be asked for. OpenGL ES 3.0 promises 2048; beyond that the GPU has the last word.
pub const SIDE_PX_MAX: u32 = 8192;

impl std::str::FromStr for Size {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        let parsed = s
            .split_once('x')
            .and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
        match parsed {
            Some((width_px, height_px))
                if (1..=SIDE_PX_MAX).contains(&width_px)
                    && (1..=SIDE_PX_MAX).contains(&height_px) =>
            {
                Ok(Self {
                    width_px,
                    height_px,
                })
            }
            _ => Err(format!(
                "`{s}` is no size: write WIDTHxHEIGHT in pixels, 1 to {SIDE_PX_MAX}, as in 1024x600"
            )),
        }
    }
}

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}x{}", self.width_px, self.height_px)
    }
}

impl Size {
    /// Bytes of an RGBA picture of this size.
    #[must_use]
    pub const fn rgba_bytes(self) -> usize {
        self.width_px as usize * self.height_px as usize * 4
    }
}

/// How hard the PNG encoder tries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// For frames written while flying.
    Fast,
    /// For pictures that are kept.
    Small,
}

/// Writes an opaque PNG from RGBA rows (top row first, 4 bytes a pixel, alpha ignored). `rgb` is scratch that keeps its
/// capacity from call to call.
///
/// # Errors
/// When the file cannot be written; names it.
pub fn write_png(
    path: &Path,
    size: Size,
    rgba: &[u8],
    effort: Effort,
    rgb: &mut Vec<u8>,
) -> Result<(), Failure> {
    rgb.clear();
    for pixel in rgba.chunks_exact(4) {
        rgb.extend_from_slice(&pixel[..3]);
    }
    let refused = |e: &dyn std::fmt::Display| {
        Failure::new(
            Kind::Other,
            path.display(),
            format!("cannot be written: {e}"),
            "check that the folder exists, is writable and has room",
        )
    };
    let file = File::create(path).map_err(|e| refused(&e))?;
    let mut encoder = png::Encoder::new(BufWriter::new(file), size.width_px, size.height_px);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(match effort {
        Effort::Fast => png::Compression::Fast,
        Effort::Small => png::Compression::Balanced,
    });
    let mut writer = encoder.write_header().map_err(|e| refused(&e))?;
    writer.write_image_data(rgb).map_err(|e| refused(&e))?;
    writer.finish().map_err(|e| refused(&e))
}

/// Pictures of one size side by side, each shrunk by a whole factor with a box filter, on a dark ground.
#[derive(Debug)]
pub struct ContactSheet {
    rgba: Vec<u8>,
    size: Size,
    cell: Size,
    factor: u32,
    columns: u32,
    placed: u32,
    room: u32,
}

/// Pixels between the pictures of a contact sheet.
const GAP_PX: u32 = 8;

impl ContactSheet {
    /// A sheet of `columns` by `rows` pictures of `size`, each shrunk by `factor` (at least 1).
    #[must_use]
    pub fn new(size: Size, factor: u32, columns: u32, rows: u32) -> Self {
        let factor = factor.max(1);
        let cell = Size {
            width_px: (size.width_px / factor).max(1),
            height_px: (size.height_px / factor).max(1),
        };
        let whole = Size {
            width_px: columns * (cell.width_px + GAP_PX) + GAP_PX,
            height_px: rows * (cell.height_px + GAP_PX) + GAP_PX,
        };
        let rgba = [18, 20, 24, 255].repeat(whole.rgba_bytes() / 4);
        Self {
            rgba,
            size: whole,
            cell,
            factor,
            columns,
            placed: 0,
            room: columns * rows,
        }
    }

    /// Places the next picture (RGBA rows, top row first, of the size given at construction). Beyond the last place it does
    /// nothing.
    pub fn place(&mut self, rgba: &[u8], width_px: u32) {
        if self.placed == self.room {
            return;
        }
        let left = GAP_PX + (self.placed % self.columns) * (self.cell.width_px + GAP_PX);
        let top = GAP_PX + (self.placed / self.columns) * (self.cell.height_px + GAP_PX);
        self.placed += 1;
        for y in 0..self.cell.height_px {
            for x in 0..self.cell.width_px {
                let colour = self.mean(rgba, width_px, x * self.factor, y * self.factor);
                let at =
                    ((top + y) as usize * self.size.width_px as usize + (left + x) as usize) * 4;
                self.rgba[at..at + 3].copy_from_slice(&colour);
            }
        }
    }

    fn mean(&self, rgba: &[u8], width_px: u32, x0: u32, y0: u32) -> [u8; 3] {
        let mut sums = [0_u32; 3];
        for y in y0..y0 + self.factor {
            for x in x0..x0 + self.factor {
                let at = (y as usize * width_px as usize + x as usize) * 4;
                for (sum, byte) in sums.iter_mut().zip(&rgba[at..at + 3]) {
                    *sum += u32::from(*byte);
                }
            }
        }
        let n = self.factor * self.factor;
        #[expect(clippy::cast_possible_truncation, reason = "a mean of bytes is a byte")]
        sums.map(|sum| ((sum + n / 2) / n) as u8)
    }

    /// Writes it.
    ///
    /// # Errors
    /// When the file cannot be written; names it.
    pub fn write(&self, path: &Path) -> Result<(), Failure> {
        write_png(path, self.size, &self.rgba, Effort::Small, &mut Vec::new())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_and_refused() {
        assert_eq!(
            "1024x600".parse(),
            Ok(Size {
                width_px: 1024,
                height_px: 600
            })
        );
        for wrong in [
            "",
            "1024",
            "0x600",
            "1024x",
            "x600",
            "1024x600x3",
            "-1x5",
            "99999x10",
        ] {
            assert!(wrong.parse::<Size>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_contact_sheet_holds_the_mean_of_each_box() {
        let size = Size {
            width_px: 4,
            height_px: 2,
        };
        let mut sheet = ContactSheet::new(size, 2, 1, 1);
        let mut rgba = vec![0_u8; size.rgba_bytes()];
        // The left box: 0, 100, 200, 100 in red: mean 100.
        for (at, red) in [(0, 0), (1, 100), (4, 200), (5, 100)] {
            rgba[at * 4] = red;
        }
        sheet.place(&rgba, size.width_px);
        let at = (GAP_PX as usize * sheet.size.width_px as usize + GAP_PX as usize) * 4;
        assert_eq!(&sheet.rgba[at..at + 3], &[100, 0, 0]);
        sheet.place(&rgba, size.width_px); // no room: nothing happens
    }
}
