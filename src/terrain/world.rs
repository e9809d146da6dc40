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
//! Both caps share a scene, for an eye that sees one never sees the other: half of the memory.
//!
//! A pack without posts for the eye's partition draws nothing there, and says so: [`FrameFigures::partition`] is `None`.

use super::partition::{Partition, SEAM_LATITUDE_DEG};
use super::scene::{BadCamera, FrameFigures, Scene, Settings};
use super::stream::{NoTerrain, Sink};
use super::surface::{DamageCounts, TileSource};
use crate::geo::{Camera, Geodetic};
use crate::units::Metres;
use arrayvec::ArrayVec;
use std::io;
use std::sync::Arc;

/// An eye within this of the seam has the other partition streamed, degrees of latitude: 6 minutes at 150 m/s.
const PRELOAD_DEG: f64 = 0.5;

/// An eye this far past the seam changes over whatever is resident, degrees of latitude.
const REACH_DEG: f64 = 1.0;

/// An eye that moves more than this in one frame has leapt, degrees of latitude. With the hysteresis less than
/// [`PRELOAD_DEG`]: who crosses without a leap has been near the seam in the frame before.
const LEAP_DEG: f64 = 0.2;

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
    figures: FrameFigures,
}

impl World {
    /// For a pack; starts a streaming thread for each scene.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn new<S: TileSource>(source: &Arc<S>, settings: Settings) -> io::Result<Self> {
        let [north, south] = [Partition::North, Partition::South].map(|cap| source.has(cap));
        let new = |partition| Scene::new(Arc::clone(source), partition, settings);
        let mut scenes = ArrayVec::new();
        scenes.push(new(Partition::Geographic)?);
        if north || south {
            scenes.push(new(Partition::North)?);
        }
        Ok(Self {
            scenes,
            has: [true, north, south],
            last: None,
            drawn: None,
            figures: FrameFigures::default(),
        })
    }

    /// Prepares a frame: streams at most `quota` texels and plans what to draw. `sinks`: one for each of [`Self::scenes`].
    ///
    /// # Errors
    /// [`BadCamera`]; everything stays as it was.
    pub fn frame<S: Sink>(
        &mut self,
        camera: &Camera,
        quota: usize,
        sinks: &mut [S],
    ) -> Result<(), BadCamera> {
        if !camera.is_valid() {
            return Err(BadCamera);
        }
        let latitude_deg = camera.eye.latitude.to_degrees();
        let (partition, wanted) = self.choose(latitude_deg);
        self.last = Some((partition, latitude_deg));
        self.drawn = self.index(partition);
        self.figures = FrameFigures {
            settled: true,
            ..FrameFigures::default()
        };
        if let Some(at) = self.drawn {
            self.scenes[at].enter(partition);
            self.scenes[at].frame(camera, quota, &mut sinks[at])?;
            self.figures = self.scenes[at].figures();
        }
        let near = (latitude_deg.abs() - SEAM_LATITUDE_DEG).abs() < PRELOAD_DEG;
        let other = match partition {
            Partition::Geographic => Partition::cap(latitude_deg),
            Partition::North | Partition::South => Partition::Geographic,
        };
        if (near || wanted != partition)
            && let Some(at) = self.index(other)
        {
            let left = quota.saturating_sub(self.figures.uploads_texels);
            self.scenes[at].enter(other);
            self.scenes[at].preload(camera, left, &mut sinks[at]);
            let figures = self.scenes[at].figures();
            self.figures.uploads_texels += figures.uploads_texels;
            self.figures.uploads_bytes += figures.uploads_bytes;
        }
        self.figures.damage = self.damage();
        Ok(())
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

    /// All scenes: the geographic one, and the cap's if the pack has a cap.
    #[must_use]
    pub fn scenes(&self) -> &[Scene] {
        &self.scenes
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

    /// The partition to draw for an eye at a latitude, and the one that it wants.
    fn choose(&self, latitude_deg: f64) -> (Partition, Partition) {
        let last = self.last.filter(|last| self.index(last.0).is_some());
        let wanted = Partition::at(latitude_deg, last.map(|last| last.0));
        let Some((current, before_deg)) = last else {
            return (wanted, wanted);
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
        if leapt || beyond || is_ready(wanted) {
            (wanted, wanted)
        } else {
            (current, wanted)
        }
    }

    fn index(&self, partition: Partition) -> Option<usize> {
        let at = usize::from(partition != Partition::Geographic);
        self.has[partition as usize].then_some(at)
    }

    fn damage(&self) -> DamageCounts {
        let mut sum = DamageCounts::default();
        for scene in &self.scenes {
            let damage = scene.figures().damage;
            sum.checksum += damage.checksum;
            sum.content += damage.content;
            sum.reading += damage.reading;
        }
        sum
    }
}
