//! How the eye moves over the posts, and which levels can keep up with it. Pure; counts in frames, as quotas do.

use super::clipmap::Shape;
use crate::limits::LEVELS_MAX;

/// Frames that a speed is taken from: half a second at 30 frames a second.
const FRAMES: usize = 16;

/// Share of a quota that strips may take before a level counts as outrun; the rest is for levels that are filled anew.
const STRIP_SHARE: f64 = 0.5;

/// An outrun level is asked for again when the eye is this much slower than what it could keep up with.
const BACK_SHARE: f64 = 0.7;

/// A strip takes about three frames from when it is asked for to when it is drawn, and only one of a level is on its way.
const STRIP_FRAMES: f64 = 3.0;

/// Frames that a level rests that a slow disk has left behind.
const REST_FRAMES: u16 = 300;

/// How the eye has moved in the last frames.
#[derive(Clone, Copy, Debug, Default)]
pub struct Motion {
    steps: [(f64, f64); FRAMES],
    next: usize,
    last: Option<(f64, f64)>,
}

impl Motion {
    /// Takes the eye's post position on level 0 in a frame in.
    pub fn note(&mut self, eye: (f64, f64)) {
        if let Some(last) = self.last.replace(eye) {
            self.steps[self.next] = (eye.0 - last.0, eye.1 - last.1);
            self.next = (self.next + 1) % FRAMES;
        }
    }

    /// Forgets everything, as after a change of the grid.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// The last step, level-0 posts.
    #[must_use]
    pub fn step(&self) -> (f64, f64) {
        self.steps[(self.next + FRAMES - 1) % FRAMES]
    }

    /// Level-0 posts a frame, east and north. The longest step of the last frames is left out: a leap is no speed.
    #[must_use]
    pub fn velocity(&self) -> (f64, f64) {
        let length = |s: &(f64, f64)| s.0.abs().max(s.1.abs());
        let longest = self
            .steps
            .iter()
            .max_by(|a, b| length(a).total_cmp(&length(b)));
        let sum = self
            .steps
            .iter()
            .fold((0.0, 0.0), |a, s| (a.0 + s.0, a.1 + s.1));
        let left_out = longest.copied().unwrap_or_default();
        let frames = (FRAMES - 1) as f64;
        ((sum.0 - left_out.0) / frames, (sum.1 - left_out.1) / frames)
    }

    /// Posts of level 0 a frame, both ways added.
    fn speed(&self) -> f64 {
        let (x, y) = self.velocity();
        x.abs() + y.abs()
    }
}

/// What a frame may cost.
#[derive(Clone, Copy, Debug)]
pub struct Allowed {
    /// Texels uploaded.
    pub texels: usize,
    /// Samples decoded.
    pub samples: u32,
    /// Posts across the widest strip.
    pub strip_posts: i32,
}

/// Which levels are streamed at a speed.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pursuit {
    /// The finest level that quotas allow; `None` before the first frame.
    finest: Option<u8>,
    /// Levels that a slow disk has left behind: the speed of that moment, and frames that they still rest.
    resting: [Option<(f64, u16)>; LEVELS_MAX],
}

impl Pursuit {
    /// Forgets everything.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// A level's window has been left behind by an eye that did not leap.
    pub fn outrun(&mut self, level: u8, motion: &Motion) {
        self.resting[usize::from(level)] = Some((motion.speed(), REST_FRAMES));
    }

    /// The finest of the `wanted` levels (finest and coarsest) that is worth being streamed in this frame. The coarsest always is.
    pub fn finest(
        &mut self,
        shape: Shape,
        wanted: (u8, u8),
        motion: &Motion,
        allowed: Allowed,
    ) -> u8 {
        let speed = motion.speed();
        let (least, most) = (
            keeping_up(shape, wanted, speed, allowed, 1.0),
            keeping_up(shape, wanted, speed, allowed, BACK_SHARE),
        );
        let mut finest = self.finest.unwrap_or(least).clamp(least, most);
        self.finest = Some(finest);
        for level in (wanted.0..wanted.1).rev() {
            let Some((then, left)) = &mut self.resting[usize::from(level)] else {
                continue;
            };
            *left = left.saturating_sub(1);
            if *left == 0 || speed < BACK_SHARE * *then {
                self.resting[usize::from(level)] = None;
            } else {
                finest = finest.max(level + 1);
            }
        }
        finest
    }
}

/// The finest level that keeps up at a speed of so many level-0 posts a frame if a `share` of what is allowed were there. What the
/// coarser ones take is no longer there for the finer ones.
fn keeping_up(shape: Shape, wanted: (u8, u8), speed: f64, allowed: Allowed, share: f64) -> u8 {
    let posts = f64::from(shape.vertices());
    let (mut texels, mut samples) = (0.0, 0.0);
    for level in (wanted.0..=wanted.1).rev() {
        let strips = speed / f64::from(1_u32 << level);
        // A texel goes into both sets of textures; tiles overhang the window by a tile.
        texels += 2.0 * posts * strips;
        samples += (posts + 128.0) * strips;
        let fits = texels <= share * STRIP_SHARE * allowed.texels as f64
            && samples <= share * STRIP_SHARE * f64::from(allowed.samples)
            && strips <= share * f64::from(allowed.strip_posts) / STRIP_FRAMES;
        if !fits {
            return (level + 1).min(wanted.1);
        }
    }
    wanted.0
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALLOWED: Allowed = Allowed {
        texels: 65_536,
        samples: 131_072,
        strip_posts: 16,
    };

    fn shape() -> Shape {
        Shape::new(255).expect("a legal shape")
    }

    /// The eye at a speed for a while.
    fn flown(motion: &mut Motion, from: f64, speed: f64) -> f64 {
        (0..40).fold(from, |x, _| {
            motion.note((x, -x));
            x + speed
        })
    }

    #[test]
    fn a_leap_is_no_speed_and_a_flight_is() {
        let mut motion = Motion::default();
        let x = flown(&mut motion, 0.0, 0.25);
        let (east, north) = motion.velocity();
        assert!((east - 0.25).abs() < 1e-9 && (north + 0.25).abs() < 1e-9);
        motion.note((x + 90_000.0, -x));
        let (east, north) = motion.velocity();
        assert!(
            (east - 0.25).abs() < 1e-9 && (north + 0.25).abs() < 1e-9,
            "{east} {north}"
        );
    }

    #[test]
    fn an_airliner_keeps_every_level_and_what_is_faster_than_quotas_loses_the_finest() {
        let finest = |speed: f64| {
            let mut motion = Motion::default();
            flown(&mut motion, 0.0, speed / 2.0);
            Pursuit::default().finest(shape(), (0, 7), &motion, ALLOWED)
        };
        // 1000 km/h at 30 frames a second over posts 65 m apart: 0.14 posts a frame.
        assert_eq!(finest(0.2), 0);
        // 16 posts in three frames: 5.3 posts a frame are too fast for level 0 from 5.4 on, for level 1 from 10.7 on.
        assert_eq!((finest(5.2), finest(5.5), finest(11.0)), (0, 1, 2));
        // Nothing keeps up: the coarsest is streamed all the same.
        assert_eq!(finest(1e6), 7);
    }

    #[test]
    fn a_level_comes_back_only_when_it_is_clearly_slower() {
        let (mut motion, mut pursuit) = (Motion::default(), Pursuit::default());
        let mut x = 0.0;
        let mut seen = Vec::new();
        for speed in [5.0, 5.5, 5.2, 4.0, 3.5, 5.2] {
            x = flown(&mut motion, x, speed / 2.0);
            seen.push(pursuit.finest(shape(), (0, 7), &motion, ALLOWED));
        }
        assert_eq!(seen, [0, 1, 1, 1, 0, 0]);
    }

    #[test]
    fn a_level_that_a_slow_disk_left_behind_rests_until_the_eye_is_slower_or_a_while_has_passed() {
        let (mut motion, mut pursuit) = (Motion::default(), Pursuit::default());
        let x = flown(&mut motion, 0.0, 1.0);
        pursuit.outrun(2, &motion);
        let finest = |pursuit: &mut Pursuit, motion: &Motion| {
            pursuit.finest(shape(), (0, 7), motion, ALLOWED)
        };
        assert_eq!(finest(&mut pursuit, &motion), 3);
        let mut rested = pursuit;
        for _ in 0..REST_FRAMES {
            let _ = finest(&mut rested, &motion);
        }
        assert_eq!(finest(&mut rested, &motion), 0, "tried again");
        flown(&mut motion, x, 0.5);
        assert_eq!(finest(&mut pursuit, &motion), 0, "slower");
    }
}
