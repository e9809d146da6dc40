//! A viewport larger than the picture, around the same middle: what reaches beyond the picture by less need not be clipped.
//! Nothing is drawn beyond the target anyway.

use crate::terrain::cull::WIDE;

/// See the module.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Wide {
    pub(super) corner: (i32, i32),
    pub(super) size: (i32, i32),
    /// What the picture is of it: clip x and y are multiplied by this.
    pub(super) shares: [f32; 2],
}

impl Wide {
    /// For a picture's size; `None` if it would be larger than `most`.
    pub(super) fn of((width, height): (u32, u32), most: [u32; 2]) -> Option<Self> {
        // As odd or even as the picture, whose middle it must have.
        let size = |side: u32| WIDE * side + side % 2;
        let (wide, high) = (size(width), size(height));
        if wide > most[0] || high > most[1] {
            return None;
        }
        #[expect(clippy::cast_precision_loss, reason = "a few thousand pixels")]
        let share = |side: u32, wide: u32| side as f32 / wide as f32;
        Some(Self {
            corner: (
                -((wide - width) / 2).cast_signed(),
                -((high - height) / 2).cast_signed(),
            ),
            size: (wide.cast_signed(), high.cast_signed()),
            shares: [share(width, wide), share(height, high)],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_stays_and_sizes_beyond_the_gpu_are_refused() {
        for (width, height) in [(1024, 600), (1, 1), (333, 97), (160, 7)] {
            let wide = Wide::of((width, height), [4096; 2]).expect("small enough");
            let twice_middle = |corner: i32, size: i32| 2 * corner + size;
            assert_eq!(
                twice_middle(wide.corner.0, wide.size.0),
                width.cast_signed()
            );
            assert_eq!(
                twice_middle(wide.corner.1, wide.size.1),
                height.cast_signed()
            );
            assert!(wide.shares.iter().all(|share| *share <= 0.5));
        }
        assert!(Wide::of((2048, 600), [4096; 2]).is_some());
        assert!(Wide::of((2049, 600), [4096; 2]).is_none());
    }
}
