//! The terrain of the whole Earth: one [`Scene`] for the geographic partition and, if the pack has posts around a pole, one
//! for the cap on the eye's side of the equator. One of the two is drawn.
//!
//! *Why one.* Two partitions in one picture would have to be joined along a parallel that is a row of neither cap, with two
//! formulas that differ in the last bits, and twice the draws. They overlap by more than can be seen instead
//! ([`super::partition`]): north of the seam the eye sees only what the cap has, south of it only what the geographic grid
//! has, and on the seam both have everything.
//!
//! *How it changes.* Near the seam the other partition is streamed too, with what the drawn one leaves of a frame's quota.
//! The eye changes over when it is past the hysteresis and the other draws every level it wants, so the picture has the
//! same levels of detail before and after. While the other is not ready the old one goes on, for a degree: 111 km, half an hour of
//! a light aircraft. An eye that leaps is drawn at once from where it lands, coarse levels first.
//!
//! *What is seen of it.* Both have the same ground, but not the same posts of it: their triangles differ by half a metre where
//! it is rough, which is two pixels on ground 200 m away. The one that goes is therefore drawn over the one that comes,
//! fainter from frame to frame, for [`FADE`]. Every question about the ground is answered by the one that comes, from the first
//! of these frames on. After a leap, or where the one that comes is not whole, there is nothing to fade.
//!
//! Both caps share a scene, for an eye that sees one never sees the other: half of the memory.
//!
//! A pack without posts for the eye's partition draws nothing there, and says so: [`FrameFigures::partition`] is `None`.

use super::partition::{Partition, SEAM_LATITUDE_DEG};
use super::scene::{self, BadCamera, FrameFigures, Scene, Settings};
use super::stream::{NoTerrain, Sink};
use super::surface::TileSource;
use crate::geo::{Camera, Geodetic};
use crate::time::Monotonic;
use crate::units::Metres;
use arrayvec::ArrayVec;
use std::io;
use std::sync::Arc;
use std::time::Duration;

/// An eye within this of the seam has the other partition streamed, degrees of latitude: 6 minutes at 150 m/s.
const PRELOAD_DEG: f64 = 0.5;

/// An eye this far past the seam changes over whatever is resident, degrees of latitude.
const REACH_DEG: f64 = 1.0;

/// An eye that moves more than this in one frame has leapt, degrees of latitude. With the hysteresis less than
/// [`PRELOAD_DEG`]: who crosses without a leap has been near the seam in the frame before.
const LEAP_DEG: f64 = 0.2;

/// How long one partition fades into the other: at 5 frames a second a fifth of the difference is seen in one step.
pub const FADE: Duration = Duration::from_secs(1);

/// A partition's picture on its way out.
#[derive(Clone, Copy, Debug)]
struct Going {
    /// Which scene.
    scene: usize,
    /// What is left of it, above 0 and at most 1.
    opacity: f64,
}

/// See the module.
#[derive(Debug)]
pub struct World {
    /// The geographic one, and the cap's.
    scenes: ArrayVec<Scene, 2>,
    /// Partitions that the pack has, by number; the geographic one is always drawn, if only as void.
    has: [bool; 3],
    /// Where the eye was: the partition drawn, or to be drawn if the pack had it, and the latitude in degrees.
    last: Option<(Partition, f64)>,
    /// Which scene is drawn.
    drawn: Option<usize>,
    going: Option<Going>,
    /// When the last frame was.
    before: Option<Monotonic>,
    figures: FrameFigures,
}

/// What an eye at a place is to be shown.
#[derive(Clone, Copy, Debug)]
struct Choice {
    /// The partition to draw.
    drawn: Partition,
    /// The one to be drawn as soon as that is possible.
    wanted: Partition,
    /// Whether the one before may fade.
    fades: bool,
}

impl World {
    /// For a pack; starts the streaming thread, one for all scenes.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn new<S: TileSource>(source: &Arc<S>, settings: Settings) -> io::Result<Self> {
        let [north, south] = [Partition::North, Partition::South].map(|cap| source.has(cap));
        let lines = 1 + usize::from(north || south);
        let workers = scene::start(source, settings, lines)?;
        let scenes = [Partition::Geographic, Partition::North]
            .into_iter()
            .zip(workers)
            .map(|(partition, worker)| Scene::on(source.info(), partition, settings, worker))
            .collect();
        Ok(Self {
            scenes,
            has: [true, north, south],
            last: None,
            drawn: None,
            going: None,
            before: None,
            figures: FrameFigures::default(),
        })
    }

    /// Prepares the frame of a time: streams at most `quota` texels and plans what to draw. `sinks`: one for each of
    /// [`Self::scenes`].
    ///
    /// # Errors
    /// [`BadCamera`]; everything stays as it was.
    pub fn frame<S: Sink>(
        &mut self,
        camera: &Camera,
        now: Monotonic,
        quota: usize,
        sinks: &mut [S],
    ) -> Result<(), BadCamera> {
        if !camera.is_valid() {
            return Err(BadCamera);
        }
        let latitude_deg = camera.eye.latitude.to_degrees();
        let choice = self.choose(latitude_deg);
        let partition = choice.drawn;
        self.last = Some((partition, latitude_deg));
        let shown = self.drawn;
        self.drawn = self.index(partition);
        self.fade(shown, choice.fades, now);
        // All scenes are served by one thread.
        let decoded_samples = self.scenes[0].streamer().begin_frame();
        self.figures = FrameFigures {
            settled: true,
            ..FrameFigures::default()
        };
        if let Some(at) = self.drawn {
            self.scenes[at].streamer().lead();
            self.scenes[at].enter(partition);
            self.scenes[at].frame(camera, quota, &mut sinks[at])?;
            self.figures = self.scenes[at].figures();
        }
        let near = (latitude_deg.abs() - SEAM_LATITUDE_DEG).abs() < PRELOAD_DEG;
        let other = match partition {
            Partition::Geographic => Partition::cap(latitude_deg),
            Partition::North | Partition::South => Partition::Geographic,
        };
        if (near || choice.wanted != partition || self.going.is_some())
            && let Some(at) = self.index(other)
        {
            let left = quota.saturating_sub(self.figures.uploads_texels);
            let (scene, sink) = (&mut self.scenes[at], &mut sinks[at]);
            scene.enter(other);
            if self.going.is_some() {
                scene.frame(camera, left, sink)?;
            } else {
                scene.preload(camera, left, sink);
            }
            let figures = scene.figures();
            self.figures.uploads_texels += figures.uploads_texels;
            self.figures.uploads_bytes += figures.uploads_bytes;
            // Its depth is drawn before its colour.
            self.figures.triangles += 2 * scene.plan().triangles;
            // Without ground there would be sky over the other's.
            self.going = self.going.filter(|_| !scene.plan().levels.is_empty());
        }
        self.figures.settled &= self.going.is_none();
        self.figures.decoded_samples = decoded_samples;
        // Every scene knows the counts of the one thread.
        self.figures.damage = self.scenes[0].streamer().damage();
        Ok(())
    }

    /// Takes what fades a step further. `shown`: the scene of the frame before.
    fn fade(&mut self, shown: Option<usize>, fades: bool, now: Monotonic) {
        // A clock that stands still or runs back takes nothing further.
        let before = self.before.replace(now);
        let passed = before.and_then(|before| now.since(before));
        let step = passed.unwrap_or_default().as_secs_f64() / FADE.as_secs_f64();
        let opacity = match self.going {
            // Back again: what came goes, from what there was of it.
            Some(going) if self.drawn == Some(going.scene) => 1.0 - going.opacity,
            Some(going) => going.opacity,
            None => 1.0,
        };
        let scene = match self.going {
            _ if !fades => None,
            _ if shown != self.drawn => shown,
            Some(going) => Some(going.scene),
            None => None,
        };
        let opacity = opacity - step;
        self.going = scene
            .filter(|_| opacity > 0.0 && self.drawn.is_some())
            .map(|scene| Going { scene, opacity });
    }

    /// The scene that is drawn; `None` before the first frame, and where the pack has none for the eye.
    #[must_use]
    pub fn drawn(&self) -> Option<&Scene> {
        self.drawn.map(|at| &self.scenes[at])
    }

    /// Which of [`Self::scenes`] is drawn.
    #[must_use]
    pub const fn drawn_index(&self) -> Option<usize> {
        self.drawn
    }

    /// Which of [`Self::scenes`] is to be drawn over it, and how opaque, above 0 and at most 1: the one that was drawn before.
    #[must_use]
    pub fn going(&self) -> Option<(usize, f64)> {
        self.going.map(|going| (going.scene, going.opacity))
    }

    /// All scenes: the geographic one, and the cap's if the pack has a cap.
    #[must_use]
    pub fn scenes(&self) -> &[Scene] {
        &self.scenes
    }

    /// Whether levels of any scene are wanted and not whole, of one that is not drawn yet too.
    #[must_use]
    pub fn is_waiting(&self) -> bool {
        let is_waiting = |scene: &Scene| {
            let figures = scene.figures();
            figures.levels_wanted != (0, 0) && !figures.is_whole()
        };
        self.scenes.iter().any(is_waiting)
    }

    /// Figures of the last frame; draw calls and bytes of tables and blocks are added by whoever draws.
    #[must_use]
    pub const fn figures(&self) -> FrameFigures {
        self.figures
    }

    /// Ellipsoidal height of the ground at a point, from the finest resident level of the drawn partition that covers it.
    ///
    /// # Errors
    /// [`NoTerrain`] where nothing covers it, or the pack has no measurement there.
    pub fn ground(&self, point: &Geodetic) -> Result<Metres, NoTerrain> {
        self.drawn()
            .ok_or(NoTerrain::NotResident)
            .and_then(|scene| scene.ground(point))
    }

    /// What to draw for an eye at a latitude.
    fn choose(&self, latitude_deg: f64) -> Choice {
        let last = self.last.filter(|last| self.index(last.0).is_some());
        let wanted = Partition::at(latitude_deg, last.map(|last| last.0));
        let at_once = Choice {
            drawn: wanted,
            wanted,
            fades: false,
        };
        let Some((current, before_deg)) = last else {
            return at_once;
        };
        let leapt = (latitude_deg - before_deg).abs() > LEAP_DEG;
        let beyond = (latitude_deg.abs() - SEAM_LATITUDE_DEG).abs() > REACH_DEG;
        let is_ready = |partition| match self.index(partition) {
            Some(at) => {
                let scene = &self.scenes[at];
                scene.partition() == partition && scene.figures().is_whole()
            }
            None => true,
        };
        if leapt {
            at_once
        } else if wanted == current || is_ready(wanted) {
            Choice {
                fades: true,
                ..at_once
            }
        } else if beyond {
            at_once
        } else {
            Choice {
                drawn: current,
                wanted,
                fades: true,
            }
        }
    }

    fn index(&self, partition: Partition) -> Option<usize> {
        let at = usize::from(partition != Partition::Geographic);
        self.has[partition as usize].then_some(at)
    }

    /// Bytes of the copies of levels, of batches in circulation, and of the tiles that the streaming thread keeps.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let copies = self.scenes.iter().map(|scene| scene.streamer().bytes());
        copies.sum::<usize>() + self.scenes[0].streamer().cache_bytes()
    }
}
