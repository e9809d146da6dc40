//! Two things that a bake makes of bare heights: holes are filled, and water is recognised. Pure.

/// A connected flat area of fewer posts than this is no water: at 3" it is about a third of a square kilometre.
pub const WATER_POSTS_MIN: usize = 64;

/// At most this share (in percent) of the posts around a water surface lie lower than it: outlets, and noise on the shore.
/// Around a level patch of a slope or a plain, stored in whole metres, it is about half.
const LOWER_SHORE_PERCENT: usize = 25;

/// Relaxations of what is filled, on each level of the pyramid.
const RELAXATIONS: usize = 12;

/// A window of posts, row by row from the south.
#[derive(Debug)]
pub struct Window {
    /// Posts in a row.
    pub columns: usize,
    /// Rows.
    pub rows: usize,
}

/// Fills holes: every post of `heights` that is NaN and is marked in `hole` gets a smooth continuation of what surrounds
/// it; `fallback` if there is nothing. Posts that are NaN and not marked are outside and take no part.
///
/// Push-pull over an image pyramid (Gortler et al. 1996, "The Lumigraph", section 3.4.1, with weights 0 and 1), relaxed on
/// every level towards a membrane (the discrete Laplace equation). Only means are taken, so that a filled height never
/// leaves the range of the heights in the window.
pub fn fill_holes(window: &Window, heights: &mut [f32], hole: &[bool], fallback: f32) {
    if !hole.contains(&true) {
        return;
    }
    let full = push_pull(window, heights);
    for ((height, full), _) in heights.iter_mut().zip(&full).zip(hole).filter(|(_, h)| **h) {
        *height = if full.is_nan() { fallback } else { *full };
    }
}

/// The posts beside a post: west, east, south, north.
fn neighbours(window: &Window, at: usize) -> impl Iterator<Item = usize> {
    let column = at % window.columns;
    let row = at / window.columns;
    [
        (column > 0).then(|| at - 1),
        (column + 1 < window.columns).then_some(at + 1),
        (row > 0).then(|| at - window.columns),
        (row + 1 < window.rows).then_some(at + window.columns),
    ]
    .into_iter()
    .flatten()
}

/// Every NaN replaced by a smooth continuation; all NaN if there is nothing to continue.
fn push_pull(window: &Window, heights: &[f32]) -> Vec<f32> {
    let (columns, rows) = (window.columns, window.rows);
    let mut full = heights.to_vec();
    if columns <= 1 && rows <= 1 || !full.iter().any(|h| h.is_nan()) {
        return full;
    }
    let half_window = Window {
        columns: columns.div_ceil(2),
        rows: rows.div_ceil(2),
    };
    let half = push_pull(&half_window, &means_of_four(window, &half_window, heights));
    let mut filled: Vec<usize> = Vec::new();
    for (at, h) in full.iter_mut().enumerate().filter(|(_, h)| h.is_nan()) {
        *h = half[at / columns / 2 * half_window.columns + at % columns / 2];
        if !h.is_nan() {
            filled.push(at);
        }
    }
    for _ in 0..RELAXATIONS {
        for at in &filled {
            let (sum, count) = neighbours(window, *at).fold((0.0_f32, 0_u8), |(sum, count), n| {
                (sum + full[n], count + 1)
            });
            full[*at] = sum / f32::from(count.max(1));
        }
    }
    full
}

/// Every 2 x 2 posts as the mean of those that have a height.
fn means_of_four(window: &Window, half: &Window, heights: &[f32]) -> Vec<f32> {
    let mut means = vec![f32::NAN; half.columns * half.rows];
    for (at, mean) in means.iter_mut().enumerate() {
        let (left, top) = (at % half.columns * 2, at / half.columns * 2);
        let (mut sum, mut count) = (0.0_f32, 0_u8);
        for row in top..window.rows.min(top + 2) {
            for column in left..window.columns.min(left + 2) {
                let h = heights[row * window.columns + column];
                if !h.is_nan() {
                    sum += h;
                    count += 1;
                }
            }
        }
        if count > 0 {
            *mean = sum / f32::from(count);
        }
    }
    means
}

/// Marks water: 4-connected areas of one height, of at least [`WATER_POSTS_MIN`] posts, that their surroundings hardly
/// ever lie below. `None` stands for a post that is void or outside.
#[must_use]
pub fn water(window: &Window, quanta: &[Option<u16>]) -> Vec<bool> {
    let mut water = vec![false; quanta.len()];
    let mut seen = vec![false; quanta.len()];
    let mut area: Vec<usize> = Vec::new();
    for seed in 0..quanta.len() {
        let Some(height) = quanta[seed] else { continue };
        if seen[seed] {
            continue;
        }
        seen[seed] = true;
        area.clear();
        area.push(seed);
        let (mut next, mut lower, mut shore) = (0, 0, 0);
        while let Some(&at) = area.get(next) {
            next += 1;
            for n in neighbours(window, at) {
                match quanta[n] {
                    Some(q) if q == height && !seen[n] => {
                        seen[n] = true;
                        area.push(n);
                    }
                    Some(q) if q == height => {}
                    Some(q) => {
                        shore += 1;
                        lower += usize::from(q < height);
                    }
                    None => {}
                }
            }
        }
        if area.len() >= WATER_POSTS_MIN && lower * 100 <= shore * LOWER_SHORE_PERCENT {
            for at in &area {
                water[*at] = true;
            }
        }
    }
    water
}

#[cfg(test)]
mod tests {
    use super::*;

    const WINDOW: Window = Window {
        columns: 32,
        rows: 24,
    };

    fn each(f: impl Fn(f32, f32) -> f32) -> Vec<f32> {
        (0..WINDOW.rows)
            .flat_map(|row| (0..WINDOW.columns).map(move |column| (column, row)))
            .map(|(column, row)| {
                let small = |x: usize| f32::from(u8::try_from(x).expect("small"));
                f(small(column), small(row))
            })
            .collect()
    }

    #[test]
    fn a_hole_in_a_slope_is_filled_with_the_slope() {
        let slope = each(|x, y| 100.0 + 3.0 * x - 2.0 * y);
        let mut heights = slope.clone();
        let mut hole = vec![false; heights.len()];
        for row in 8..16 {
            for column in 10..20 {
                heights[row * WINDOW.columns + column] = f32::NAN;
                hole[row * WINDOW.columns + column] = true;
            }
        }
        fill_holes(&WINDOW, &mut heights, &hole, 0.0);
        // A plane solves the Laplace equation, so the membrane over its rim is the plane itself.
        for (got, want) in heights.iter().zip(&slope) {
            assert!((got - want).abs() < 2.0, "{got} for {want}");
        }
    }

    #[test]
    fn holes_take_nothing_from_outside_and_outside_stays_empty() {
        let mut heights = each(|x, _| if x < 8.0 { 500.0 } else { f32::NAN });
        let hole: Vec<bool> = each(|x, _| x)
            .iter()
            .map(|x| (8.0..12.0).contains(x))
            .collect();
        fill_holes(&WINDOW, &mut heights, &hole, 0.0);
        assert!(
            (heights[10] - 500.0).abs() < 1e-3,
            "a hole continues its rim"
        );
        assert!(heights[12].is_nan(), "outside");
    }

    #[test]
    fn a_window_of_nothing_is_the_fallback() {
        let mut heights = each(|_, _| f32::NAN);
        let hole = vec![true; heights.len()];
        fill_holes(&WINDOW, &mut heights, &hole, 0.0);
        assert!(heights.iter().all(|h| h.abs() < 1e-9));
    }

    fn marked(f: impl Fn(f32, f32) -> f32) -> usize {
        let quanta: Vec<Option<u16>> = each(f)
            .iter()
            .map(|h| (!h.is_nan()).then_some(h.round().max(0.0)).map(cast))
            .collect();
        water(&WINDOW, &quanta).iter().filter(|w| **w).count()
    }

    fn cast(h: f32) -> u16 {
        (0..=u16::MAX)
            .find(|q| f32::from(*q) >= h)
            .expect("in range")
    }

    #[test]
    fn a_basin_is_water_and_a_terrace_is_not() {
        let basin = |x: f32, y: f32| ((x - 16.0).abs().max((y - 12.0).abs()) - 5.0).max(0.0);
        assert_eq!(marked(basin), 11 * 11, "a pond with its shores all higher");
        let terrace = |x: f32, y: f32| ((x + y * 0.01) / 8.0).floor();
        assert_eq!(
            marked(terrace),
            8 * 24,
            "of the steps of a slope only the lowest, whose lower shore is unknown"
        );
        assert_eq!(marked(|_, _| 7.0), 32 * 24, "nothing but sea");
        let puddle = |x: f32, y: f32| ((x - 16.0).abs().max((y - 12.0).abs()) - 3.0).max(0.0);
        assert_eq!(marked(puddle), 0, "49 posts are too few");
    }
}
