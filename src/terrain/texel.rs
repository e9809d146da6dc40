//! The bytes of a texel of the surface: what `shaders/include/relief.glsl` makes colours of. All of them may be filtered.

use super::codec::SurfaceKind;

/// A component n of a unit normal as a byte: 128 + 127 c, where n = c (1 + |c|) / 2, so that the steps near level ground,
/// where the eye sees the smallest changes, are half as large as those of a linear code.
///
/// The angle between a normal and what is drawn of it is at most 0.19 degrees on slopes up to 5 degrees (RMS 0.11), 0.48 up
/// to 45 (0.18) and 0.75 up to 60 (0.22).
#[must_use]
pub fn encode_normal(component: f64) -> u8 {
    let c = (0.25 + 2.0 * component.abs()).sqrt() - 0.5;
    signed_byte(c.copysign(component))
}

/// How far ground stands out, as a byte: 128 + 127 c for c in -1 (hollow) to 1 (crest), greater ones cut off. `rise` is the
/// height above the mean of the eight posts around, over twice the post spacing; an eighth of it is cut off: a roof of 18
/// degrees.
#[must_use]
pub fn encode_crest(rise: f64) -> u8 {
    signed_byte((CREST_GAIN * rise).clamp(-1.0, 1.0))
}

const CREST_GAIN: f64 = 8.0;

/// 128 + 127 c: exactly 128 for 0.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "between 1 and 255 for -1 to 1"
)]
fn signed_byte(c: f64) -> u8 {
    (c * 127.0 + 128.0).round() as u8
}

/// What a post is, as a byte that may be filtered: land stands between water and what was not measured.
#[must_use]
pub const fn encode_kind(kind: SurfaceKind) -> u8 {
    match kind {
        SurfaceKind::Water => 0,
        SurfaceKind::Land => 128,
        SurfaceKind::Void => KIND_VOID,
    }
}

/// The code of a post that was not measured.
pub const KIND_VOID: u8 = 255;

#[cfg(test)]
mod tests {
    use super::*;

    /// What shaders/include/relief.glsl makes of a normal's byte.
    fn decode(byte: u8) -> f64 {
        let c = (f64::from(byte) - 128.0) / 127.0;
        c * (0.5 + 0.5 * c.abs())
    }

    /// Angle in degrees between the normal of a slope and what is drawn of it.
    fn angle_error_deg(slope_deg: f64, aspect_deg: f64) -> f64 {
        let (sin, cos) = slope_deg.to_radians().sin_cos();
        let (east, north) = aspect_deg.to_radians().sin_cos();
        let truth = glam::DVec3::new(sin * east, sin * north, cos);
        let (x, y) = (
            decode(encode_normal(truth.x)),
            decode(encode_normal(truth.y)),
        );
        let drawn = glam::DVec3::new(x, y, (1.0 - x * x - y * y).max(0.0).sqrt());
        truth
            .cross(drawn)
            .length()
            .atan2(truth.dot(drawn))
            .to_degrees()
    }

    #[test]
    fn normals_keep_their_direction() {
        for (steepest_deg, most_deg, rms_deg) in MOST_AND_RMS_DEG {
            let (mut most, mut squares, mut count) = (0.0_f64, 0.0, 0.0);
            for slope in 0..=steepest_deg * 8 {
                for aspect in 0..720 {
                    let e = angle_error_deg(f64::from(slope) / 8.0, f64::from(aspect) / 2.0 + 0.1);
                    (most, squares, count) = (most.max(e), squares + e * e, count + 1.0);
                }
            }
            let rms = (squares / count).sqrt();
            assert!(
                most <= most_deg && rms <= rms_deg,
                "to {steepest_deg}: {most} {rms}"
            );
        }
    }

    /// Slopes up to this; the largest error allowed and its RMS: what the documentation of [`encode_normal`] says.
    const MOST_AND_RMS_DEG: [(u32, f64, f64); 3] =
        [(5, 0.19, 0.11), (45, 0.48, 0.18), (60, 0.75, 0.22)];

    #[test]
    fn level_ground_is_exactly_level() {
        assert_eq!((encode_normal(0.0), encode_normal(-0.0)), (128, 128));
        assert_eq!((encode_normal(1.0), encode_normal(-1.0)), (255, 1));
        assert_eq!(
            (encode_crest(0.0), encode_crest(9.0), encode_crest(-9.0)),
            (128, 255, 1)
        );
    }
}
