//! The glyphs of the display in one texture of signed distances, made at start-up from the B612 outlines.
//!
//! B612 is the typeface that Airbus and ENAC drew for cockpit screens (its licence is beside the fonts). Glyphs of a line
//! are placed by their advance widths alone.

use super::sdf::Outline;
use glam::Vec2;
use skrifa::instance::{LocationRef, Size};
use skrifa::outline::DrawSettings;
use skrifa::{FontRef, MetadataProvider as _};

/// A weight of the typeface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Face {
    /// For names and units.
    Regular,
    /// For numbers.
    Bold,
}

/// Why there is no atlas. The fonts are part of the program, so this cannot be mended by its user.
#[derive(Debug, thiserror::Error)]
pub enum AtlasError {
    /// The font file does not parse.
    #[error("built-in font {face:?}: {why}")]
    Font {
        /// Which one.
        face: Face,
        /// The parser's words.
        why: String,
    },
    /// The glyphs do not fit the texture.
    #[error("built-in font {face:?}: the glyphs do not fit an atlas of {WIDTH} x {HEIGHT} texels")]
    Full {
        /// The face at which it was full.
        face: Face,
    },
}

/// Columns of the texture.
pub const WIDTH: usize = 1024;
/// Rows of the texture.
pub const HEIGHT: usize = 512;

/// Texels per em of the outlines in the texture: a digit of the largest readout at 1920 x 1080 has 45 pixels per em.
const EM_TEXELS: f32 = 42.0;
/// Distances are kept up to this many texels from the outline; it bounds the width of a halo.
const SPREAD_TEXELS: f32 = 7.0;

/// Printable ASCII, then the characters of [`EXTRA`].
const ASCII: std::ops::RangeInclusive<char> = ' '..='~';
const EXTRA: [char; 1] = ['\u{b0}'];
const GLYPHS: usize = 96;

/// Where a glyph is in the texture, and where it stands on its line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Glyph {
    /// Left, top, right and bottom in the texture, 0 to 1; all zero for a blank.
    pub texture: [f32; 4],
    /// From the pen to the upper left corner of the cell in em, y down from the baseline.
    pub offset: Vec2,
    /// Size of the cell in em.
    pub size: Vec2,
    /// To the next glyph, in em.
    pub advance: f32,
}

/// The atlas.
#[derive(Debug)]
pub struct Atlas {
    texels: Vec<u8>,
    glyphs: [[Glyph; GLYPHS]; 2],
    cap_height: [f32; 2],
}

impl Atlas {
    /// Makes it; some milliseconds.
    ///
    /// # Errors
    /// [`AtlasError`] if the built-in fonts are not what this version expects.
    pub fn build() -> Result<Self, AtlasError> {
        let mut atlas = Self {
            texels: vec![0; WIDTH * HEIGHT],
            glyphs: [[Glyph::default(); GLYPHS]; 2],
            cap_height: [0.0; 2],
        };
        let mut shelf = Shelf::default();
        let regular: &[u8] = include_bytes!("font/B612-Regular.otf");
        let bold: &[u8] = include_bytes!("font/B612-Bold.otf");
        for (face, data) in [(Face::Regular, regular), (Face::Bold, bold)] {
            atlas.add(face, data, &mut shelf)?;
        }
        Ok(atlas)
    }

    fn add(&mut self, face: Face, data: &[u8], shelf: &mut Shelf) -> Result<(), AtlasError> {
        let error = |why: String| AtlasError::Font { face, why };
        let font = FontRef::new(data).map_err(|e| error(e.to_string()))?;
        let size = Size::new(EM_TEXELS);
        let (characters, outlines) = (font.charmap(), font.outline_glyphs());
        let metrics = font.glyph_metrics(size, LocationRef::default());
        for (index, character) in ASCII.chain(EXTRA).enumerate() {
            let missing = || error(format!("no glyph for {character:?}"));
            let id = characters.map(character).ok_or_else(missing)?;
            let mut outline = Outline::default();
            outlines
                .get(id)
                .ok_or_else(missing)?
                .draw(
                    DrawSettings::unhinted(size, LocationRef::default()),
                    &mut outline,
                )
                .map_err(|e| error(format!("{character:?}: {e}")))?;
            let advance = metrics.advance_width(id).ok_or_else(missing)? / EM_TEXELS;
            if character == 'H' {
                self.cap_height[face as usize] =
                    outline.bounds().map_or(0.7, |(_, max)| max.y / EM_TEXELS);
            }
            let glyph = self
                .place(&outline, shelf)
                .ok_or(AtlasError::Full { face })?;
            self.glyphs[face as usize][index] = Glyph { advance, ..glyph };
        }
        Ok(())
    }

    /// Puts an outline into the texture; `None` where it is full.
    fn place(&mut self, outline: &Outline, shelf: &mut Shelf) -> Option<Glyph> {
        let Some((min, max)) = outline.bounds() else {
            return Some(Glyph::default());
        };
        let origin = Vec2::new(
            (min.x - SPREAD_TEXELS).floor(),
            (max.y + SPREAD_TEXELS).ceil(),
        );
        let far = Vec2::new(
            (max.x + SPREAD_TEXELS).ceil(),
            (min.y - SPREAD_TEXELS).floor(),
        );
        let size = Vec2::new(far.x - origin.x, origin.y - far.y);
        let (width, height) = (count(size.x), count(size.y));
        let (left, top) = shelf.take(width, height)?;
        outline.field(origin, width, height, SPREAD_TEXELS, |i, j, value| {
            self.texels[(top + j) * WIDTH + left + i] = value;
        });
        let u = |texels: usize| real(texels) / real(WIDTH);
        let v = |texels: usize| real(texels) / real(HEIGHT);
        Some(Glyph {
            texture: [u(left), v(top), u(left + width), v(top + height)],
            offset: Vec2::new(origin.x, -origin.y) / EM_TEXELS,
            size: size / EM_TEXELS,
            advance: 0.0,
        })
    }

    /// The texture: [`HEIGHT`] rows of [`WIDTH`] bytes, top first.
    #[must_use]
    pub fn texels(&self) -> &[u8] {
        &self.texels
    }

    /// A glyph; `?` for what the atlas does not have.
    #[must_use]
    pub fn glyph(&self, face: Face, character: char) -> &Glyph {
        let code = |c: char| (u32::from(c) - u32::from(*ASCII.start())) as usize;
        let index = if ASCII.contains(&character) {
            code(character)
        } else {
            let extra = EXTRA.iter().position(|e| *e == character);
            extra.map_or(code('?'), |k| code(*ASCII.end()) + 1 + k)
        };
        &self.glyphs[face as usize][index]
    }

    /// Height of capitals and figures in em.
    #[must_use]
    pub const fn cap_height(&self, face: Face) -> f32 {
        self.cap_height[face as usize]
    }

    /// Width of a line of text, in em.
    #[must_use]
    pub fn width(&self, face: Face, text: &str) -> f32 {
        text.chars().map(|c| self.glyph(face, c).advance).sum()
    }

    /// Pixels per unit of the distance field when drawn at `em` pixels per em: 0 to 1 spans twice the spread.
    #[must_use]
    pub fn field_scale(em: f32) -> f32 {
        2.0 * SPREAD_TEXELS * em / EM_TEXELS
    }
}

/// Fills the texture row by row of cells, one texel apart.
#[derive(Default)]
struct Shelf {
    x: usize,
    y: usize,
    tallest: usize,
}

impl Shelf {
    fn take(&mut self, width: usize, height: usize) -> Option<(usize, usize)> {
        if self.x + width > WIDTH {
            self.x = 0;
            self.y += self.tallest + 1;
            self.tallest = 0;
        }
        if self.y + height > HEIGHT || width > WIDTH {
            return None;
        }
        let at = (self.x, self.y);
        self.x += width + 1;
        self.tallest = self.tallest.max(height);
        Some(at)
    }
}

/// A count of texels as a number of them.
fn real(texels: usize) -> f32 {
    #[expect(clippy::cast_precision_loss, reason = "at most some thousands")]
    {
        texels as f32
    }
}

/// A whole number of texels as a count.
fn count(texels: f32) -> usize {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "`as` saturates; a glyph has some tens of texels"
    )]
    {
        texels as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn atlas() -> Atlas {
        Atlas::build().unwrap_or_else(|e| unreachable!("{e}"))
    }

    /// The field's value at a place given in em from the pen on the baseline, y up; 0.5 is the outline.
    fn sample(atlas: &Atlas, glyph: &Glyph, x: f32, y: f32) -> f32 {
        let along = (x - glyph.offset.x) / glyph.size.x;
        let down = (-y - glyph.offset.y) / glyph.size.y;
        let [left, top, right, bottom] = glyph.texture;
        let i = count((left + (right - left) * along) * real(WIDTH));
        let j = count((top + (bottom - top) * down) * real(HEIGHT));
        f32::from(atlas.texels()[j * WIDTH + i]) / 255.0
    }

    #[test]
    fn glyphs_have_their_insides_where_the_letters_have_them() {
        let atlas = atlas();
        for face in [Face::Regular, Face::Bold] {
            let cap = atlas.cap_height(face);
            assert!((0.6..0.8).contains(&cap), "{cap}");
            let zero = atlas.glyph(face, '0');
            let middle = zero.advance / 2.0;
            assert!(
                sample(&atlas, zero, middle, cap / 2.0) < 0.4,
                "the hole of 0"
            );
            assert!(sample(&atlas, zero, middle, cap - 0.05) > 0.5, "its top");
            let dash = atlas.glyph(face, '-');
            assert!(
                sample(&atlas, dash, dash.advance / 2.0, cap - 0.05) < 0.4,
                "above a dash"
            );
        }
    }

    #[test]
    fn figures_are_equally_wide_so_that_readouts_do_not_jump() {
        let atlas = atlas();
        let width = atlas.glyph(Face::Bold, '0').advance;
        for digit in '1'..='9' {
            assert!(
                (atlas.glyph(Face::Bold, digit).advance - width).abs() < 1e-6,
                "{digit}"
            );
        }
    }

    #[test]
    fn what_the_atlas_does_not_have_is_a_question_mark() {
        let atlas = atlas();
        assert_eq!(
            atlas.glyph(Face::Bold, '\u{3b1}'),
            atlas.glyph(Face::Bold, '?')
        );
        assert_ne!(
            atlas.glyph(Face::Bold, '\u{b0}'),
            atlas.glyph(Face::Bold, '?')
        );
    }
}
