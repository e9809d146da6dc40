//! The palette, by meaning. Nothing else in the program names a colour of the instruments.
//!
//! Meanings follow FAA AC 25-11B, table 5-1: red warns, amber cautions, scales are white, sky is blue, earth is brown, what
//! the pilot has set is cyan, units and labels are light grey. Colour is never the only cue (AC 25-11B, 5.8).

/// Red, green, blue and opacity, 0 to 255, display-referred (sRGB), opacity not multiplied in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Colour(pub [u8; 4]);

impl Colour {
    const fn rgb(red: u8, green: u8, blue: u8) -> Self {
        Self([red, green, blue, 255])
    }

    /// The same colour with its opacity scaled by `factor`, 0 to 1.
    #[must_use]
    pub fn faded(self, factor: f32) -> Self {
        let [r, g, b, a] = self.0;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "the product lies between 0 and 255"
        )]
        let a = (f32::from(a) * factor.clamp(0.0, 1.0)).round() as u8;
        Self([r, g, b, a])
    }
}

/// Warnings and limits that must not be passed.
pub const WARNING: Colour = Colour::rgb(255, 40, 30);
/// Cautions: degraded, old or doubtful.
pub const CAUTION: Colour = Colour::rgb(255, 186, 0);
/// Scales, pointers and current values.
pub const SCALE: Colour = Colour::rgb(255, 255, 255);
/// Names and units beside values.
pub const LABEL: Colour = Colour::rgb(205, 211, 218);
/// Things that are absent without being wrong.
pub const ABSENT: Colour = Colour::rgb(150, 156, 163);
/// What the pilot has set.
pub const SELECTED: Colour = Colour::rgb(60, 220, 255);
/// Normal operating range.
pub const NORMAL: Colour = Colour::rgb(20, 205, 60);
/// The track over the ground.
pub const TRACK: Colour = Colour::rgb(255, 70, 255);
/// Opaque ground of readout windows and of failed instruments.
pub const WINDOW: Colour = Colour::rgb(8, 10, 12);
/// The dark rim around symbols: with it, white over white snow keeps a contrast of more than 3:1.
pub const HALO: Colour = Colour([0, 0, 0, 190]);
/// The ground of tapes and boxes, through which the outside is seen.
pub const PANEL: Colour = Colour([14, 18, 24, 155]);
/// The ground of small fields with coloured figures: darker, so that all of them stand out.
pub const FIELD: Colour = Colour([10, 13, 18, 215]);
/// The thin border of panels.
pub const BORDER: Colour = Colour([255, 255, 255, 90]);
/// The whole picture where there is no attitude.
pub const VOID: Colour = Colour::rgb(16, 18, 21);
/// The sky at the zenith side of the plain horizon.
pub const SKY_HIGH: Colour = Colour::rgb(8, 62, 150);
/// The sky at the horizon.
pub const SKY_LOW: Colour = Colour::rgb(88, 168, 232);
/// The earth at the horizon.
pub const EARTH_HIGH: Colour = Colour::rgb(150, 108, 60);
/// The earth below.
pub const EARTH_LOW: Colour = Colour::rgb(76, 50, 24);

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative luminance of WCAG 2.1 (and IEC 61966-2-1), 0 to 1.
    fn luminance(rgb: [f64; 3]) -> f64 {
        let linear = rgb.map(|c| {
            let c = c / 255.0;
            if c <= 0.040_45 {
                c / 12.92
            } else {
                ((c + 0.055) / 1.055).powf(2.4)
            }
        });
        0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
    }

    fn over(top: Colour, below: [f64; 3]) -> [f64; 3] {
        let a = f64::from(top.0[3]) / 255.0;
        [0, 1, 2].map(|i| f64::from(top.0[i]) * a + below[i] * (1.0 - a))
    }

    #[test]
    fn symbols_with_their_halo_keep_three_to_one_over_any_imagery() {
        // AC 20-167A, H.7.3: local contrast of symbols over imagery at least 3:1.
        for below in [
            [0.0; 3],
            [255.0; 3],
            [120.0, 140.0, 90.0],
            [90.0, 170.0, 230.0],
        ] {
            let rim = luminance(over(HALO, below));
            for symbol in [SCALE, CAUTION, SELECTED] {
                let symbol = luminance(over(symbol, below));
                assert!((symbol + 0.05) / (rim + 0.05) >= 3.0, "{below:?}");
            }
        }
    }

    #[test]
    fn labels_keep_three_to_one_over_white_imagery() {
        let panel = luminance(over(PANEL, [255.0; 3]));
        let field = luminance(over(FIELD, [255.0; 3]));
        for ink in [SCALE, LABEL, SELECTED, TRACK, CAUTION] {
            let ink = luminance(over(ink, [0.0; 3]));
            assert!((ink + 0.05) / (field + 0.05) >= 3.0, "{ink} on {field}");
        }
        assert!(
            (luminance([255.0; 3]) + 0.05) / (panel + 0.05) >= 3.0,
            "{panel}"
        );
    }

    #[test]
    fn fading_scales_only_the_opacity() {
        assert_eq!(SCALE.faded(0.5).0, [255, 255, 255, 128]);
        assert_eq!(SCALE.faded(7.0), SCALE);
    }
}
