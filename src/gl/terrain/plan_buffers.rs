//! Buffers and textures of a scene's plan. Each scene has its own, for two may be in a picture.

use std::rc::Rc;

use super::texel;
use crate::gl::buffer::{Attribute, Buffer, Role, STREAM_REGIONS, Scalar, Stream, VertexArray};
use crate::gl::texture::{Filter, Format, Texture, Wrap};
use crate::gl::{GlError, Gpu};
use crate::limits::LEVELS_MAX;
use crate::terrain::blocks::{BLOCKS_MAX, Block};
use crate::terrain::scene::Plan;

/// Table textures in rotation: one being written, two that the GPU may still read.
const TABLES: usize = 3;

const _: () = assert!(
    size_of::<Block>() == 8,
    "the vertex array reads eight bytes"
);

/// What the GPU is given of a scene's plan.
#[derive(Debug)]
pub(super) struct PlanBuffers {
    /// Of columns and rows.
    pub(super) tables: [Texture; TABLES],
    table: usize,
    /// Version of the tables last written.
    tabled: Option<u32>,
    blocks: Stream,
    region: usize,
    arrays: [VertexArray; STREAM_REGIONS],
}

impl PlanBuffers {
    pub(super) fn new(
        gpu: &Rc<Gpu>,
        (levels, texels): (u8, usize),
        indices: &Buffer,
    ) -> Result<Self, GlError> {
        let (rows, columns) = (2 * u32::from(levels), texel(texels));
        let (filter, wrap) = (Filter::Nearest, Wrap::Clamp);
        let table = || Texture::new(gpu, Format::Rgba32F, columns, rows, filter, wrap);
        let array = || VertexArray::numbered(gpu, indices);
        let blocks = LEVELS_MAX * BLOCKS_MAX * size_of::<Block>();
        Ok(Self {
            tables: [table()?, table()?, table()?],
            table: 0,
            tabled: None,
            blocks: Stream::new(gpu, Role::Vertex, blocks)?,
            region: 0,
            arrays: [array()?, array()?, array()?],
        })
    }

    /// The tables last written.
    pub(super) const fn table(&self) -> &Texture {
        &self.tables[self.table]
    }

    /// Writes what has changed. Returns the bytes.
    pub(super) fn write(&mut self, plan: &Plan) -> usize {
        let mut bytes = 0;
        if self.tabled != Some(plan.tables_version) {
            self.tabled = Some(plan.tables_version);
            self.table = (self.table + 1) % TABLES;
            let texels: &[u8] = bytemuck::cast_slice(&plan.tables);
            self.tables[self.table].write_all(texels);
            bytes += texels.len();
        }
        if !plan.blocks.is_empty() {
            self.region = self.blocks.write(&plan.blocks);
            bytes += size_of_val(plan.blocks.as_slice());
        }
        bytes
    }

    /// The vertex array that draws blocks from the `first` on.
    pub(super) fn blocks_from(&self, first: usize) -> &VertexArray {
        let array = &self.arrays[self.region];
        let first = first * size_of::<Block>();
        let block = Attribute {
            location: 0,
            components: 4,
            scalar: Scalar::I16Int,
            offset_bytes: texel(first),
        };
        array.add(&self.blocks.regions()[self.region], 8, &[block], 1);
        array
    }
}
