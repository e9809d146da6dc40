//! What is resident under a point or a rectangle of posts.

use super::{EXTREMES_SIDE, NoTerrain, Streamer};
use crate::terrain::clipmap::torus_texel;
use crate::terrain::texel::KIND_VOID;

impl Streamer {
    /// Height code of a post of a resident window.
    #[must_use]
    pub fn code(&self, level: u8, i: i32, j: i32) -> Option<u16> {
        self.window(level)?;
        let level = self.levels.get(usize::from(level))?;
        level.heights.get(self.texel(i, j)).map(|h| h[0])
    }

    /// The lowest height code at which a post of a resident window is drawn, whatever the blend: own or coarser.
    #[must_use]
    pub fn floor_code(&self, level: u8, i: i32, j: i32) -> u16 {
        let [own, coarser] = self.levels[usize::from(level)].heights[self.texel(i, j)];
        own.min(coarser)
    }

    /// The greatest height code at which a post of a rectangle of a resident window is drawn, whatever the blend. `from` and
    /// `to`: its south-western and north-eastern posts.
    #[must_use]
    pub fn top_code(&self, level: u8, from: (i32, i32), to: (i32, i32)) -> u16 {
        let heights = &self.levels[usize::from(level)].heights;
        let mut top = 0;
        for j in from.1..=to.1 {
            for i in from.0..=to.0 {
                let [own, coarser] = heights[self.texel(i, j)];
                top = top.max(own).max(coarser);
            }
        }
        top
    }

    /// Height code of the ground at a post position of a resident level, as its triangles lie, without the blend.
    ///
    /// # Errors
    /// [`NoTerrain`].
    pub fn ground_code(&self, level: u8, x: f64, y: f64) -> Result<f64, NoTerrain> {
        let window = self.window(level).ok_or(NoTerrain::NotResident)?;
        let inside = |v: f64, origin: i32| {
            v >= f64::from(origin) && v < f64::from(origin + self.shape.cells())
        };
        if !inside(x, window.i) || !inside(y, window.j) {
            return Err(NoTerrain::NotResident);
        }
        let (i, j) = (whole(x), whole(y));
        let (fx, fy) = (x - x.floor(), y - y.floor());
        let level = &self.levels[usize::from(level)];
        let post = |di: i32, dj: i32| {
            let at = self.texel(i + di, j + dj);
            if level.surface[at][3] == KIND_VOID {
                return Err(NoTerrain::Void);
            }
            Ok(f64::from(level.heights[at][0]))
        };
        // Weights of the triangle's corners; see super::blocks for which way the diagonal runs.
        if (i + j).rem_euclid(2) == 0 {
            let (sw, ne) = (post(0, 0)?, post(1, 1)?);
            Ok(if fx >= fy {
                sw + fx * (post(1, 0)? - sw) + fy * (ne - post(1, 0)?)
            } else {
                sw + fy * (post(0, 1)? - sw) + fx * (ne - post(0, 1)?)
            })
        } else {
            let (se, nw) = (post(1, 0)?, post(0, 1)?);
            Ok(if fx + fy <= 1.0 {
                let sw = post(0, 0)?;
                sw + fx * (se - sw) + fy * (nw - sw)
            } else {
                let ne = post(1, 1)?;
                ne + (1.0 - fx) * (nw - ne) + (1.0 - fy) * (se - ne)
            })
        }
    }

    /// Lowest and greatest height code, own and coarser, in a rectangle of posts of a level; may be wider than the truth.
    #[must_use]
    pub fn extremes(
        &self,
        level: u8,
        (i, j): (i32, i32),
        (width, height): (i32, i32),
    ) -> (u16, u16) {
        let texels = self.shape.texels();
        let per_side = texels / EXTREMES_SIDE;
        let Some(level) = self.levels.get(usize::from(level)) else {
            return (0, u16::MAX);
        };
        let squares = |start: i32, length: i32| {
            let first = torus_texel(texels, start) / EXTREMES_SIDE;
            let last =
                (torus_texel(texels, start) + length.cast_unsigned() as usize) / EXTREMES_SIDE;
            first..=last
        };
        let mut out = (u16::MAX, 0);
        for y in squares(j, height) {
            for x in squares(i, width) {
                let e = level.extremes[(y % per_side) * per_side + x % per_side];
                out = (out.0.min(e.0), out.1.max(e.1));
            }
        }
        if out.0 > out.1 { (0, u16::MAX) } else { out }
    }

    fn texel(&self, i: i32, j: i32) -> usize {
        let texels = self.shape.texels();
        torus_texel(texels, j) * texels + torus_texel(texels, i)
    }
}

/// The whole part of a post position inside a window.
#[expect(
    clippy::cast_possible_truncation,
    reason = "inside a window, whose posts are 32-bit numbers"
)]
fn whole(v: f64) -> i32 {
    v.floor() as i32
}
