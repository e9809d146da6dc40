//! The horizon as a pair of eyes finds it: where the sky ends, from pixels alone.

#![allow(
    clippy::expect_used,
    dead_code,
    reason = "every test includes this module and uses only some of it"
)]

use std::path::Path;

/// A picture, RGB, top row first.
pub(crate) struct Picture {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) rgb: Vec<u8>,
}

impl Picture {
    /// Reads a PNG of 8 bits a channel.
    ///
    /// # Panics
    /// If there is none.
    pub(crate) fn read(file: &Path) -> Self {
        let reader =
            std::io::BufReader::new(std::fs::File::open(file).expect("the picture is there"));
        let mut png = png::Decoder::new(reader).read_info().expect("is a PNG");
        let mut bytes = vec![0; png.output_buffer_size().expect("a size")];
        let info = png.next_frame(&mut bytes).expect("is whole");
        let channels = info.color_type.samples();
        let rgb = bytes[..info.buffer_size()]
            .chunks_exact(channels)
            .flat_map(|p| [p[0], p[1], p[2]])
            .collect();
        Self {
            width: info.width as usize,
            height: info.height as usize,
            rgb,
        }
    }

    pub(crate) fn at(&self, x: usize, y: usize) -> [i32; 3] {
        let i = (y * self.width + x) * 3;
        [self.rgb[i], self.rgb[i + 1], self.rgb[i + 2]].map(i32::from)
    }

    /// Blue well above red: sky in any shade, and nothing else that lies across the picture.
    pub(crate) fn is_sky(&self, x: usize, y: usize) -> bool {
        let [r, _, b] = self.at(x, y);
        b > r + 40
    }
}

/// Where the horizon is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Horizon {
    /// Right wing down positive.
    pub(crate) roll_deg: f64,
    /// Nose up positive.
    pub(crate) pitch_deg: f64,
}

/// Fits a line through the lowest sky pixel of each column; columns that symbols disturb are outvoted. `hfov` in radians.
pub(crate) fn find(picture: &Picture, hfov: f64) -> Option<Horizon> {
    // Sky above, something else below, over at least 6 pixels each: that steps over text and thin lines.
    let run = 6;
    let mut points = Vec::new();
    for x in (0..picture.width).step_by(4) {
        // The lowest of a column: panels above the horizon have sky above them too.
        let lowest = (run..picture.height - run).rev().find(|&y| {
            let above = (y - run..y).all(|y| picture.is_sky(x, y));
            above && (y..y + run).all(|y| !picture.is_sky(x, y))
        });
        #[expect(clippy::cast_precision_loss, reason = "pixels")]
        points.extend(lowest.map(|y| (x as f64 + 0.5, y as f64)));
    }
    // The pair of points whose line most others lie on, then the mean line of those.
    let mut best: (usize, f64, f64) = (0, 0.0, 0.0);
    for (i, a) in points.iter().enumerate().step_by(3) {
        for b in points.iter().skip(i + 1).step_by(3) {
            if (b.0 - a.0).abs() < 150.0 {
                continue;
            }
            let slope = (b.1 - a.1) / (b.0 - a.0);
            let offset = a.1 - slope * a.0;
            let votes = points
                .iter()
                .filter(|p| (p.1 - slope * p.0 - offset).abs() < 1.5)
                .count();
            if votes > best.0 {
                best = (votes, slope, offset);
            }
        }
    }
    let (votes, slope, offset) = best;
    if votes < 30 {
        return None;
    }
    let near: Vec<_> = points
        .iter()
        .filter(|p| (p.1 - slope * p.0 - offset).abs() < 1.5)
        .collect();
    #[expect(clippy::cast_precision_loss, reason = "a count of columns")]
    let n = near.len() as f64;
    let (mx, my) = (
        near.iter().map(|p| p.0).sum::<f64>() / n,
        near.iter().map(|p| p.1).sum::<f64>() / n,
    );
    let sxy: f64 = near.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum();
    let sxx: f64 = near.iter().map(|p| (p.0 - mx) * (p.0 - mx)).sum();
    let slope = sxy / sxx;
    #[expect(clippy::cast_precision_loss, reason = "pixels")]
    let (cx, cy) = (picture.width as f64 / 2.0, picture.height as f64 / 2.0);
    let focal = cx / (hfov / 2.0).tan();
    // Right wing down: the horizon rises to the right... of the picture's y axis, which points down.
    let roll = -slope.atan();
    let below_centre = (my + slope * (cx - mx) - cy) * roll.cos();
    Some(Horizon {
        roll_deg: roll.to_degrees(),
        pitch_deg: (below_centre / focal).atan().to_degrees(),
    })
}
