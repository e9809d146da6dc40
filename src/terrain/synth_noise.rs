//! Noise from integer hashes, the same on every machine: additions, multiplications, divisions and square roots of f64 are
//! exact by IEEE 754, and nothing else is used (no sine, exponential or power, whose last bit depends on the library).

/// A number that looks random, from three: the finaliser of SplitMix64 (Steele, Lea and Flood 2014, "Fast splittable
/// pseudorandom number generators", figure 17).
#[must_use]
pub fn hash(x: i64, y: i64, seed: u64) -> u64 {
    let mut z = seed
        .wrapping_add(x.cast_unsigned().wrapping_mul(0x9e37_79b9_7f4a_7c15))
        .wrapping_add(y.cast_unsigned().wrapping_mul(0xd1b5_4a32_d192_ed03));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// The same as a number from -1 to 1.
#[must_use]
pub fn signed(x: i64, y: i64, seed: u64) -> f64 {
    // 32 bits are exact in f64.
    let bits = u32::try_from(hash(x, y, seed) >> 32).unwrap_or(0);
    f64::from(bits) / f64::from(u32::MAX) * 2.0 - 1.0
}

/// `3 t^2 - 2 t^3` of `x` between `from` and `to`: 0 before, 1 after.
#[must_use]
pub fn smooth_step(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Gradient directions: every 22.5 degrees, by their coordinates.
const DIRECTIONS: [(f64, f64); 16] = {
    const A: f64 = 0.923_879_532_511_286_7;
    const B: f64 = 0.382_683_432_365_089_8;
    const C: f64 = std::f64::consts::FRAC_1_SQRT_2;
    [
        (1.0, 0.0),
        (A, B),
        (C, C),
        (B, A),
        (0.0, 1.0),
        (-B, A),
        (-C, C),
        (-A, B),
        (-1.0, 0.0),
        (-A, -B),
        (-C, -C),
        (-B, -A),
        (0.0, -1.0),
        (B, -A),
        (C, -C),
        (A, -B),
    ]
};

/// Gradient noise (Perlin 2002, "Improving noise": quintic fade) with wavelength 1; within -1 to 1, 0 on the lattice.
#[must_use]
pub fn gradient(x: f64, y: f64, seed: u64) -> f64 {
    let (column, row) = (x.floor(), y.floor());
    let (fx, fy) = (x - column, y - row);
    #[expect(
        clippy::cast_possible_truncation,
        reason = "floors of coordinates of some thousand"
    )]
    let (column, row) = (column as i64, row as i64);
    let corner = |dx: i64, dy: i64, x: f64, y: f64| {
        let direction = hash(column + dx, row + dy, seed) >> 60;
        let (gx, gy) = DIRECTIONS[usize::try_from(direction).unwrap_or(0)];
        gx * x + gy * y
    };
    let fade = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let u = fade(fx);
    let south = corner(0, 0, fx, fy) * (1.0 - u) + corner(1, 0, fx - 1.0, fy) * u;
    let north = corner(0, 1, fx, fy - 1.0) * (1.0 - u) + corner(1, 1, fx - 1.0, fy - 1.0) * u;
    let v = fade(fy);
    // The greatest value of unit gradients is sqrt(1/2); this brings it to 1.
    (south * (1.0 - v) + north * v) * std::f64::consts::SQRT_2
}

/// A sum of `octaves` of [`gradient`], each of half the wavelength and half the weight; about -1 to 1.
#[must_use]
pub fn fractal(mut x: f64, mut y: f64, octaves: u32, seed: u64) -> f64 {
    let (mut sum, mut weight) = (0.0, 0.5);
    for octave in 0..octaves {
        sum += weight * gradient(x, y, seed.wrapping_add(u64::from(octave)));
        weight *= 0.5;
        x = x * 2.0 + 17.3;
        y = y * 2.0 - 9.1;
    }
    sum
}

/// Ridged multifractal noise (Musgrave, in Ebert et al. 2003, "Texturing and Modeling", chapter 16): sharp crests, rough
/// where it is high and smooth where it is low. About 0 to 1.
#[must_use]
pub fn ridged(mut x: f64, mut y: f64, octaves: u32, seed: u64) -> f64 {
    const GAIN: f64 = 1.9;
    let (mut sum, mut scale, mut weight, mut total) = (0.0, 1.0, 1.0, 0.0);
    for octave in 0..octaves {
        let crest = 1.0 - gradient(x, y, seed.wrapping_add(u64::from(octave))).abs();
        let signal = crest * crest * weight;
        sum += signal * scale;
        total += scale;
        weight = (signal * GAIN).clamp(0.0, 1.0);
        scale *= 0.48;
        // An irrational turn between octaves hides the lattice: (0.8, 0.6) is a rotation.
        (x, y) = (
            2.03 * (0.8 * x - 0.6 * y) + 5.7,
            2.03 * (0.6 * x + 0.8 * y) - 3.1,
        );
    }
    sum / total
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_stays_within_its_range_and_uses_it() {
        let (mut low, mut high) = (0.0_f64, 0.0_f64);
        for step in 0..40_000 {
            let (x, y) = (f64::from(step % 200) * 0.173, f64::from(step / 200) * 0.191);
            let n = gradient(x, y, 5);
            (low, high) = (low.min(n), high.max(n));
            assert!((0.0..=1.0).contains(&ridged(x, y, 6, 5)), "{x} {y}");
        }
        assert!(
            (-1.0..-0.7).contains(&low) && (0.7..1.0).contains(&high),
            "{low} {high}"
        );
    }

    #[test]
    fn noise_is_continuous_across_the_lattice() {
        for (x, y) in [(3.0, 4.5), (-2.0, 0.3), (0.0, -7.7)] {
            let step = gradient(x - 1e-9, y, 1) - gradient(x + 1e-9, y, 1);
            assert!(step.abs() < 1e-6, "{x} {y}: {step}");
        }
    }

    #[test]
    fn hashes_are_the_ones_of_the_published_generator() {
        // The first output of SplitMix64 seeded with 0 (its state is then the golden gamma), as in Vigna's splitmix64.c.
        assert_eq!(hash(1, 0, 0), 0xe220_a839_7b1d_cdaf);
    }
}
