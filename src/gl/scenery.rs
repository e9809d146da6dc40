//! All that is outside the window: the terrain near the ground, the sky over it, and from 20 km up the Earth in one piece.

use std::rc::Rc;
use std::sync::Arc;

use super::globe::{ALONE_FROM, FROM, GlobeError, GlobeRenderer};
use super::look::Look;
use super::sky::SkyRenderer;
use super::terrain::{TerrainError, TerrainRenderer};
use super::{GlError, Gpu};
use crate::geo::Camera;
use crate::terrain::scene::{BadCamera, FrameFigures, Settings};
use crate::terrain::surface::TileSource;
use crate::time::Monotonic;

/// Why it cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum SceneryError {
    /// The GPU refused something.
    #[error(transparent)]
    Gl(#[from] GlError),
    /// The terrain cannot be drawn.
    #[error(transparent)]
    Terrain(#[from] TerrainError),
    /// The Earth in one piece cannot be drawn.
    #[error(transparent)]
    Globe(#[from] GlobeError),
}

/// Draws a pack and the sky.
#[derive(Debug)]
pub struct Scenery {
    gpu: Rc<Gpu>,
    terrain: TerrainRenderer,
    sky: SkyRenderer,
    globe: GlobeRenderer,
    /// Whether the last prepared picture has near terrain in it.
    is_near: bool,
}

impl Scenery {
    /// For a pack: allocates every texture and buffer, compiles the shaders and starts the threads.
    ///
    /// # Errors
    /// [`SceneryError`].
    pub fn new<S: TileSource>(
        gpu: &Rc<Gpu>,
        settings: Settings,
        source: Arc<S>,
    ) -> Result<Self, SceneryError> {
        Ok(Self {
            gpu: Rc::clone(gpu),
            terrain: TerrainRenderer::new(gpu, settings, Arc::clone(&source))?,
            sky: SkyRenderer::new(gpu)?,
            globe: GlobeRenderer::new(gpu, source)?,
            is_near: true,
        })
    }

    /// Streams at most about `quota` texels and plans what to draw at a time, without drawing. While the Earth in one piece is not
    /// ready, the near terrain serves at any height.
    ///
    /// # Errors
    /// [`BadCamera`]: everything stays as it was.
    pub fn prepare(
        &mut self,
        camera: &Camera,
        now: Monotonic,
        quota: usize,
    ) -> Result<FrameFigures, BadCamera> {
        if !camera.is_valid() {
            return Err(BadCamera);
        }
        let height = camera.eye.height_ellipsoid;
        self.is_near = height < ALONE_FROM || !self.globe.is_ready();
        let mut figures = if self.is_near {
            self.terrain.prepare(camera, now, quota)?
        } else {
            FrameFigures {
                settled: true,
                ..FrameFigures::default()
            }
        };
        let left = quota.saturating_sub(figures.uploads_texels);
        let texels = self.globe.prepare(height, left);
        figures.uploads_texels += texels;
        figures.uploads_bytes += 5 * texels;
        figures.resident_bytes += self.globe.resident_bytes();
        // Below, it is prepared for later.
        figures.settled &= height <= FROM || self.globe.is_ready();
        if self.globe.is_ready() && height >= ALONE_FROM {
            figures.settled = true;
        }
        Ok(figures)
    }

    /// Whether the last prepared picture has ground in it.
    #[must_use]
    pub fn has_ground(&self, figures: &FrameFigures) -> bool {
        !self.is_near || figures.levels.is_some()
    }

    /// Draws what was prepared into the bound target, whose depth must be clear. `sky`: whether there is one. Returns the
    /// draw calls.
    pub fn draw(&self, camera: &Camera, look: &Look, sky: bool) -> usize {
        let mut calls = 0;
        if self.is_near {
            self.terrain.draw(look);
            calls += self.terrain.draw_calls();
            if sky {
                self.sky.draw(camera, look.palette);
                calls += 1;
            }
            if let Some(opacity) = self.terrain.going() {
                self.gpu.clear_depth();
                self.terrain.draw_going(look);
                if sky {
                    self.sky.draw_over(camera, look.palette, opacity);
                    calls += 1;
                }
            }
        }
        calls + self.globe.draw(camera, look, sky)
    }

    /// The near terrain.
    #[must_use]
    pub const fn terrain(&self) -> &TerrainRenderer {
        &self.terrain
    }
}
