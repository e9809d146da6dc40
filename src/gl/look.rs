//! How the ground looks: lights, haze, day and night, terrain awareness and the grid of lines, as uniforms of
//! `shaders/include/relief.glsl`, which the clipmap and the one-piece Earth share.
//!
//! What is off costs nothing: awareness and lines are variants of a program.

use std::rc::Rc;

use glow::HasContext as _;

use super::program::{Program, UniformLocation};
use super::{GlError, Gpu};
use crate::terrain::clipmap::{Window, torus_texel};
use crate::terrain::grid::Grid;
use crate::units::{Feet, Metres, Radians};

const RELIEF: &str = include_str!("../../shaders/include/relief.glsl");

/// Ground from this far below the aircraft upwards is warned of (display practice of synthetic vision: Garmin G3X Touch
/// pilot's guide 190-01754).
pub const WARNING_BELOW: Feet = Feet(100.0);
/// Ground from this far below the aircraft up to the warning is cautioned of (same source).
pub const CAUTION_BELOW: Feet = Feet(1000.0);

/// For which eyes the colours are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Palette {
    /// Used to daylight.
    #[default]
    Day,
    /// Used to the dark: everything is a third as bright and the reds lead.
    Night,
}

impl Palette {
    /// Of everything: factors of red, green and blue.
    #[must_use]
    pub const fn brightness(self) -> [f32; 3] {
        match self {
            Self::Day => [1.0; 3],
            Self::Night => [0.42, 0.38, 0.34],
        }
    }

    /// Colours of the warning and of the caution, before brightness.
    const fn awareness(self) -> [[f32; 3]; 2] {
        match self {
            Self::Day => [[0.90, 0.10, 0.07], [0.95, 0.80, 0.10]],
            Self::Night => [[1.70, 0.12, 0.08], [1.25, 1.05, 0.15]],
        }
    }

    /// Colour and opacity of the grid's lines, before brightness.
    const fn ink(self) -> [f32; 4] {
        match self {
            Self::Day => [0.04, 0.05, 0.08, 0.65],
            Self::Night => [1.0, 1.0, 1.0, 0.45],
        }
    }
}

/// Lines of latitude and longitude this many minutes of arc apart; in the polar caps lines of the cap's own grid, which
/// there has nearly the same spacing in all directions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lines(u16);

/// Spacings in minutes of arc, with the height of the eye up to which each is used, metres.
const LINES: [(u16, f64); 10] = [
    (1, 4.0e3),
    (2, 8.0e3),
    (5, 16.0e3),
    (10, 40.0e3),
    (30, 90.0e3),
    (60, 200.0e3),
    (120, 500.0e3),
    (300, 1500.0e3),
    (600, 6000.0e3),
    (1800, f64::INFINITY),
];

/// A spacing is kept until the height is past its bound by this share of it.
const LINES_HYSTERESIS: f64 = 0.1;

impl Lines {
    /// For an eye at a height above the ellipsoid; near the bounds of a spacing the `current` one is kept.
    #[must_use]
    pub fn at(height: Metres, current: Option<Self>) -> Self {
        let mut below_m = 0.0;
        for (minutes, up_to_m) in LINES {
            let kept = current == Some(Self(minutes))
                && height.0 > below_m * (1.0 - LINES_HYSTERESIS)
                && height.0 <= up_to_m * (1.0 + LINES_HYSTERESIS);
            if kept {
                return Self(minutes);
            }
            below_m = up_to_m;
        }
        let fits = LINES.iter().find(|(_, up_to_m)| height.0 <= *up_to_m);
        Self(fits.map_or(1800, |(minutes, _)| *minutes))
    }

    /// Where a level's texels lie among the lines: coordinates 0 in its surface of `texels` a side east and north of a line, and
    /// the whole surface, each in steps from one line to the next. `window`: the origin of what is drawn. Computed in whole posts,
    /// so that a line stands on the same posts in every window.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_precision_loss,
        reason = "a few steps, rounded to what the shader takes"
    )]
    pub(super) fn place(self, grid: Grid, level: u8, window: Window, texels: usize) -> [f32; 3] {
        // Posts stand on whole fractions of a degree, all of them multiples of a minute's.
        let step = i64::from(grid.posts_per_degree) * i64::from(self.0) / 60;
        let cell = fraction(1 << level, step);
        let from_line = |post: i32| {
            let posts = (i64::from(post) << level).rem_euclid(step);
            // The post's texel has its coordinates in its middle.
            let at = torus_texel(texels, post) as f64 + 0.5;
            (fraction(posts, step) - at * cell) as f32
        };
        let across = texels as f64 * cell;
        [from_line(window.i), from_line(window.j), across as f32]
    }

    /// Minutes of arc from one line to the next.
    #[must_use]
    pub const fn minutes(self) -> u16 {
        self.0
    }
}

#[expect(
    clippy::cast_precision_loss,
    reason = "posts on Earth are far below 2^53"
)]
fn fraction(posts: i64, step: i64) -> f64 {
    posts as f64 / step as f64
}

/// What the picture shows beside the ground itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// Distance at which half of the haze is reached, metres; infinite for none.
    pub haze_m: f64,
    /// Day or night.
    pub palette: Palette,
    /// The aircraft's height above the ellipsoid, where the ground is coloured by it. What is given must be valid now;
    /// without it nothing is coloured.
    pub awareness: Option<Metres>,
    /// Lines of latitude and longitude.
    pub lines: Option<Lines>,
}

impl Look {
    /// For flying: haze that leaves ridges 100 km away readable.
    pub const FLIGHT: Self = Self {
        haze_m: 55_000.0,
        palette: Palette::Day,
        awareness: None,
        lines: None,
    };
    /// The ground alone.
    pub const BARE: Self = Self {
        haze_m: f64::INFINITY,
        ..Self::FLIGHT
    };

    pub(super) const fn variant(&self) -> Variant {
        Variant {
            awareness: self.awareness.is_some(),
            lines: self.lines.is_some(),
        }
    }
}

/// Which of a program's variants draws a look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Variant {
    awareness: bool,
    lines: bool,
}

impl Variant {
    /// All, in the order of [`Self::index`].
    pub(super) const ALL: [Self; 4] = [
        Self::of(false, false),
        Self::of(true, false),
        Self::of(false, true),
        Self::of(true, true),
    ];

    const fn of(awareness: bool, lines: bool) -> Self {
        Self { awareness, lines }
    }

    /// Its place in [`Self::ALL`].
    pub(super) const fn index(self) -> usize {
        self.awareness as usize + 2 * self.lines as usize
    }

    pub(super) const fn has_lines(self) -> bool {
        self.lines
    }

    /// What it defines for the shaders.
    pub(super) fn defines(self) -> String {
        let line = |on: bool, name: &str| {
            if on {
                format!("#define {name}\n")
            } else {
                String::new()
            }
        };
        line(self.awareness, "AWARENESS") + &line(self.lines, "GRID")
    }
}

/// A fragment shader that colours ground, with what it is coloured by before it.
pub(super) fn with_relief(defines: &str, fragment: &str) -> String {
    format!("{defines}#line 1\n{RELIEF}\n#line 1\n{fragment}")
}

/// The uniforms of relief.glsl in a program.
#[derive(Debug)]
pub(super) struct LookUniforms {
    gpu: Rc<Gpu>,
    key: UniformLocation,
    fill: UniformLocation,
    haze: UniformLocation,
    brightness: UniformLocation,
    awareness: Option<[UniformLocation; 3]>,
    ink: Option<UniformLocation>,
}

impl LookUniforms {
    pub(super) fn new(gpu: &Rc<Gpu>, program: &Program, variant: Variant) -> Result<Self, GlError> {
        let awareness = || -> Result<_, GlError> {
            Ok([
                program.uniform("warning")?,
                program.uniform("caution")?,
                program.uniform("margin")?,
            ])
        };
        Ok(Self {
            gpu: Rc::clone(gpu),
            key: program.uniform("key")?,
            fill: program.uniform("fill")?,
            haze: program.uniform("haze")?,
            brightness: program.uniform("brightness")?,
            awareness: variant.awareness.then(awareness).transpose()?,
            ink: variant.lines.then(|| program.uniform("ink")).transpose()?,
        })
    }

    /// Sets them in the bound program; `heading`: where the view goes, clockwise from the north of the ground's axes.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "numbers for the shader, which is f32"
    )]
    pub(super) fn set(&self, look: &Look, heading: Radians) {
        let gl = self.gpu.gl();
        let [r, g, b] = super::sky::HAZE;
        let palette = look.palette;
        // SAFETY: the context is current on this thread (Gpu is !Send); the program is bound, the locations its own.
        unsafe {
            gl.uniform_3_f32_slice(Some(&self.key), &light(heading, KEY_LIGHT_DEG, KEY_LIGHT));
            gl.uniform_3_f32_slice(
                Some(&self.fill),
                &light(heading, FILL_LIGHT_DEG, FILL_LIGHT),
            );
            gl.uniform_4_f32(Some(&self.haze), r, g, b, (1.0 / look.haze_m) as f32);
            gl.uniform_3_f32_slice(Some(&self.brightness), &palette.brightness());
            if let (Some([warning, caution, margin]), Some(height)) =
                (&self.awareness, look.awareness)
            {
                let [red, yellow] = palette.awareness();
                let begin = height - Metres::from(WARNING_BELOW);
                let band = Metres::from(CAUTION_BELOW) - Metres::from(WARNING_BELOW);
                gl.uniform_3_f32_slice(Some(warning), &red);
                gl.uniform_3_f32_slice(Some(caution), &yellow);
                gl.uniform_2_f32(Some(margin), begin.0 as f32, band.0 as f32);
            }
            if let Some(ink) = &self.ink {
                gl.uniform_4_f32_slice(Some(ink), &palette.ink());
            }
        }
    }
}

/// Where the lights stand: degrees clockwise from the view's heading, and degrees above the horizon. Maps are lit from the
/// upper left because relief then reads as relief; in a forward view that is from the left. A light that
/// stood in the north-west would come from behind on a south-easterly heading and flatten everything. The weaker one tells
/// slopes along the first apart.
const KEY_LIGHT_DEG: (f64, f64) = (-88.0, 40.0);
const FILL_LIGHT_DEG: (f64, f64) = (70.0, 25.0);

/// How strong they are: 1 shows a surface that faces the light in its own colour.
const KEY_LIGHT: f64 = 1.02;
const FILL_LIGHT: f64 = 0.30;

/// The vector east, north, up towards a light, as long as the light is strong.
#[expect(
    clippy::cast_possible_truncation,
    reason = "numbers for the shader, which is f32"
)]
fn light(heading: Radians, (azimuth_deg, elevation_deg): (f64, f64), strength: f64) -> [f32; 3] {
    let (sin, cos) = (heading.0 + azimuth_deg.to_radians()).sin_cos();
    let (up, along) = elevation_deg.to_radians().sin_cos();
    [along * sin, along * cos, up].map(|v| (strength * v) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_farther_apart_higher_up_and_do_not_flutter() {
        let mut last = Lines::at(Metres(0.0), None);
        for height_m in (0..400).map(|k| 100.0 * 1.04_f64.powi(k)) {
            let lines = Lines::at(Metres(height_m), None);
            assert!(lines.minutes() >= last.minutes(), "{height_m} m");
            last = lines;
        }
        let low = Lines::at(Metres(3990.0), None);
        assert_eq!(Lines::at(Metres(4010.0), Some(low)), low);
        let high = Lines::at(Metres(4500.0), Some(low));
        assert!(high != low && Lines::at(Metres(3990.0), Some(high)) == high);
        assert_eq!(Lines::at(Metres(-400.0), None).minutes(), 1);
    }

    #[test]
    fn a_line_stands_on_the_same_post_in_every_window_and_level() {
        let grid = Grid {
            posts_per_degree: 1200,
        };
        let lines = Lines(5);
        // 70 W: level-0 column -84 000, on level 3 column -10 500.
        for (level, window) in [
            (
                0,
                Window {
                    i: -84_050,
                    j: 54_900,
                },
            ),
            (
                0,
                Window {
                    i: -84_100,
                    j: 54_900,
                },
            ),
            (
                3,
                Window {
                    i: -10_550,
                    j: 6_900,
                },
            ),
        ] {
            let [east, _, across] = lines.place(grid, level, window, 512);
            // Coordinates go on beyond 1 where the surface wraps.
            let cells = f64::from((-84_000 >> level) - window.i);
            let texel = f64::from(window.i.rem_euclid(512)) + cells + 0.5;
            let at = f64::from(east) + texel / 512.0 * f64::from(across);
            assert!((at - at.round()).abs() < 1e-5, "{level} {window:?}: {at}");
        }
        for posts_per_degree in crate::terrain::grid::POSTS_PER_DEGREE {
            assert_eq!(posts_per_degree % 60, 0, "a minute is whole posts");
        }
    }

    #[test]
    fn variants_stand_at_their_index() {
        for (at, variant) in Variant::ALL.into_iter().enumerate() {
            assert_eq!(variant.index(), at);
        }
    }
}
