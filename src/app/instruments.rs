//! The instruments over whatever is behind them: from a model to GL, through the draw list.

use crate::app::picture::Size;
use crate::display::Model;
use crate::draw::atlas::{Atlas, AtlasError};
use crate::draw::{self, DrawList, Layout};
use crate::gl::vector::VectorRenderer;
use crate::gl::{GlError, Gpu};
use std::rc::Rc;

/// What they are drawn with. After construction nothing here allocates.
#[derive(Debug)]
pub struct Instruments {
    vector: VectorRenderer,
    atlas: Atlas,
    layout: Layout,
    list: DrawList,
    size: Size,
}

/// Why they cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum InstrumentsError {
    /// The GPU refused something.
    #[error(transparent)]
    Gl(#[from] GlError),
    /// The built-in font is damaged.
    #[error(transparent)]
    Atlas(#[from] AtlasError),
}

impl Instruments {
    /// For a picture of `size`.
    ///
    /// # Errors
    /// [`InstrumentsError`].
    pub fn new(gpu: &Rc<Gpu>, size: Size) -> Result<Self, InstrumentsError> {
        let atlas = Atlas::build()?;
        Ok(Self {
            vector: VectorRenderer::new(gpu, &atlas)?,
            atlas,
            layout: Layout::new(size.width_px, size.height_px),
            list: DrawList::new(),
            size,
        })
    }

    /// Lists what `model` shows.
    pub fn list(&mut self, model: &Model) {
        draw::draw(model, &self.layout, &self.atlas, &mut self.list);
    }

    /// Draws what was listed into the bound target: one draw call.
    pub fn draw(&mut self) {
        self.vector
            .draw(&self.list, self.size.width_px, self.size.height_px);
    }

    /// Whether something did not fit the list: a defect.
    #[must_use]
    pub fn overflowed(&self) -> bool {
        self.list.left_out() > 0
    }
}
