//! A contact sheet of a flight: some of its frames, and under each by how much it differs from the frame before, enlarged. A
//! pop is a bright edge there that no ridge explains.

use crate::app::error::Failure;
use crate::app::measure::bench::Bench;
use crate::app::picture::{ContactSheet, Size};
use crate::geo::Camera;
use std::path::Path;

/// Frames a row, and rows of frames.
const COLUMNS: u32 = 4;
const ROWS: u32 = 3;
/// How much a difference is enlarged.
const ENLARGED: u8 = 6;
/// Pictures are shrunk by this.
const FACTOR: u32 = 2;

/// See the module.
#[derive(Debug, Default)]
pub struct Sheet {
    before: Vec<u8>,
    sheet: Option<ContactSheet>,
    /// A row's pictures and differences.
    row: [Vec<Vec<u8>>; 2],
}

impl Sheet {
    /// Takes the planned frame in, if it is one of those that are shown.
    ///
    /// # Errors
    /// With what the GPU refuses.
    pub fn offer(
        &mut self,
        bench: &mut Bench,
        camera: &Camera,
        frame: u32,
        of: u32,
    ) -> Result<(), Failure> {
        let apart = (of / (COLUMNS * ROWS)).max(2);
        match frame % apart {
            0 => {
                let now = bench.picture(camera)?;
                let differs = difference(&self.before, &now);
                self.row[0].push(now);
                self.row[1].push(differs);
            }
            rest if rest == apart - 1 => self.before = bench.picture(camera)?,
            _ => {}
        }
        if self.row[0].len() == COLUMNS as usize {
            let size = Size {
                width_px: camera.width_px,
                height_px: camera.height_px,
            };
            let sheet = self
                .sheet
                .get_or_insert_with(|| ContactSheet::new(size, FACTOR, COLUMNS, 2 * ROWS));
            for picture in self.row.iter_mut().flat_map(|row| row.drain(..)) {
                sheet.place(&picture, size.width_px);
            }
        }
        Ok(())
    }

    /// Writes it, if there is a row of it.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&self, file: &Path) -> Result<(), Failure> {
        self.sheet
            .as_ref()
            .map_or(Ok(()), |sheet| sheet.write(file))
    }
}

/// By how much two pictures differ, enlarged.
fn difference(a: &[u8], b: &[u8]) -> Vec<u8> {
    let bytes = a.iter().zip(b);
    bytes
        .map(|(a, b)| a.abs_diff(*b).saturating_mul(ENLARGED))
        .collect()
}
