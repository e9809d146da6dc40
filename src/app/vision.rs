//! Synthetic vision: a pack, what draws it, and what the pilot is to be told of it.
//!
//! Terrain is shown only where there is some, from a camera that is one; everything else has a name on the display, and
//! the plain horizon is drawn instead.

use crate::app::cockpit::Drawn;
use crate::display::{SvsOff, Terrain, TerrainCaution, Ui};
use crate::geo::{Camera, Geodetic};
use crate::gl::Gpu;
use crate::gl::look::{Lines, Look, Palette};
use crate::gl::scenery::{Scenery, SceneryError};
use crate::terrain::pack::{Bounds, Pack};
use crate::terrain::scene::{FrameFigures, Settings};
use crate::terrain::stream::{Errands, NoTerrain};
use crate::time::Monotonic;
use crate::units::{Metres, Radians};
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

/// A level this many coarser than the finest wanted one around the eye is said to be coarse: its posts lie four times as
/// far apart.
const COARSE_LEVELS: u8 = 2;

/// Draws terrain and sky. After construction nothing here allocates.
#[derive(Debug)]
pub struct Vision {
    scenery: Scenery,
    pack: Arc<Pack>,
    lines: Option<Lines>,
    patience: Patience,
    /// What lies on the ground.
    pub dress: Dress,
}

/// How long the disk may take to answer before the pilot is told.
const ANSWER_WITHIN: Duration = Duration::from_secs(1);

/// Waits for the streaming thread's answers.
#[derive(Clone, Copy, Debug, Default)]
struct Patience {
    answered: u32,
    since: Option<Monotonic>,
}

impl Patience {
    /// Whether something is wanted for drawing and nothing has come for too long.
    fn is_over(&mut self, errands: &Errands, now: Monotonic) -> bool {
        if errands.outstanding == 0 || errands.answered != self.answered {
            self.answered = errands.answered;
            self.since = Some(now);
        }
        let since = *self.since.get_or_insert(now);
        now.since(since)
            .is_some_and(|waited| waited > ANSWER_WITHIN)
    }
}

/// What lies on the ground beside its relief, and for which eyes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dress {
    /// Colours by height relative to the aircraft.
    pub awareness: bool,
    /// Lines of latitude and longitude.
    pub grid: bool,
    /// Day or night.
    pub palette: Palette,
}

impl Dress {
    /// As the pilot has set.
    #[must_use]
    pub const fn of(ui: &Ui) -> Self {
        Self {
            awareness: ui.awareness,
            grid: ui.grid,
            palette: if ui.night {
                Palette::Night
            } else {
                Palette::Day
            },
        }
    }

    /// The look of a picture from a camera, whose height must be valid now: the eye is the aircraft. `lines`: of the
    /// picture before.
    #[must_use]
    pub fn look(self, camera: &Camera, lines: Option<Lines>) -> Look {
        let height = camera.eye.height_ellipsoid;
        Look {
            palette: self.palette,
            awareness: self.awareness.then_some(height),
            lines: self.grid.then(|| Lines::at(height, lines)),
            ..Look::FLIGHT
        }
    }
}

/// What the display is to say of a frame's terrain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shown {
    /// Whether it is in the picture.
    pub terrain: Terrain,
    /// What is wrong with it, where it is.
    pub caution: Option<TerrainCaution>,
}

impl Shown {
    /// In the picture, and nothing to be said.
    pub const WELL: Self = Self {
        terrain: Terrain::Ready,
        caution: None,
    };

    /// Not in the picture.
    #[must_use]
    pub const fn off(terrain: Terrain) -> Self {
        Self {
            terrain,
            caution: None,
        }
    }

    /// The words for it; `None` where there is nothing to be said.
    #[must_use]
    pub fn label(self) -> Option<&'static str> {
        match self.terrain {
            Terrain::Ready => self.caution.map(TerrainCaution::label),
            off => Some(SvsOff::Terrain(off).label()),
        }
    }

    /// What is to be said of the picture that was prepared last, with its `figures`.
    #[must_use]
    pub fn assess(scenery: &Scenery, pack: &Pack, camera: &Camera, figures: &FrameFigures) -> Self {
        let info = pack.info();
        if info.posts == info.void_posts {
            return Self::off(Terrain::Empty);
        }
        if figures.partition.is_none() || !covers(&info.bounds, &camera.eye) {
            return Self::off(Terrain::Outside);
        }
        if !scenery.has_ground(figures) {
            return Self::off(Terrain::Loading);
        }
        Self {
            terrain: Terrain::Ready,
            caution: caution(scenery, camera, figures),
        }
    }
}

/// The gravest thing that is wrong with what is drawn.
fn caution(scenery: &Scenery, camera: &Camera, figures: &FrameFigures) -> Option<TerrainCaution> {
    let (finest, _) = figures.levels?;
    let damage = figures.damage;
    match scenery.terrain().ground(&camera.eye) {
        Ok(ground) if camera.eye.height_ellipsoid < ground => Some(TerrainCaution::BelowGround),
        Err(NoTerrain::Void) => Some(TerrainCaution::NoDataBelow),
        _ if finest >= figures.levels_wanted.0 + COARSE_LEVELS => Some(TerrainCaution::Coarse),
        // What the disk has not given is told until it has.
        _ if damage.checksum + damage.content > 0 || figures.errands.unread => {
            Some(TerrainCaution::Damaged)
        }
        _ => None,
    }
}

impl Vision {
    /// For a pack; starts the streaming thread.
    ///
    /// # Errors
    /// [`SceneryError`].
    pub fn new(gpu: &Rc<Gpu>, settings: Settings, pack: Pack) -> Result<Self, SceneryError> {
        let pack = Arc::new(pack);
        Ok(Self {
            scenery: Scenery::new(gpu, settings, Arc::clone(&pack))?,
            pack,
            lines: None,
            patience: Patience::default(),
            dress: Dress::default(),
        })
    }

    /// Height of the geoid above the ellipsoid; `None` outside what the pack covers, where there is no terrain either.
    #[must_use]
    pub fn undulation(&self, latitude: Radians, longitude: Radians) -> Option<Metres> {
        let undulation_m = self.pack.geoid().undulation_m(latitude, longitude)?;
        Some(Metres(undulation_m))
    }

    /// How high the eye of the picture drawn last stands above its ground; `None` where there is none.
    #[must_use]
    pub fn height_above_ground(&self, eye: &Geodetic) -> Option<Metres> {
        let ground = self.scenery.terrain().ground(eye).ok()?;
        Some(eye.height_ellipsoid - ground)
    }

    /// Streams at most `quota_texels` for a time without drawing. Returns whether every wanted level is there; true too where there
    /// is nothing to wait for.
    pub fn stream(&mut self, camera: &Camera, now: Monotonic, quota_texels: usize) -> bool {
        let figures = self.scenery.prepare(camera, now, quota_texels);
        figures.is_ok_and(|figures| figures.settled)
    }

    /// Streams at most `quota_texels`, and draws terrain and sky of a time into the bound target where there is anything to
    /// show. While one partition of the Earth gives way to another, what is said is of the one that comes.
    pub fn show(
        &mut self,
        camera: &Camera,
        now: Monotonic,
        quota_texels: usize,
        drawn: &mut Drawn,
    ) -> Shown {
        let Ok(figures) = self.scenery.prepare(camera, now, quota_texels) else {
            return Shown::off(Terrain::NoCamera);
        };
        drawn.upload_bytes = figures.uploads_bytes as u64;
        drawn.upload_texels = figures.uploads_texels as u64;
        drawn.decoded_samples = u64::from(figures.decoded_samples);
        drawn.resident_bytes = figures.resident_bytes as u64;
        drawn.terrain_settled = figures.settled;
        let mut shown = Shown::assess(&self.scenery, &self.pack, camera, &figures);
        if self.patience.is_over(&figures.errands, now) {
            shown.caution = match shown.caution {
                None | Some(TerrainCaution::Damaged) => Some(TerrainCaution::Slow),
                graver => graver,
            };
        }
        if shown.terrain != Terrain::Ready {
            return shown;
        }
        let look = self.dress.look(camera, self.lines);
        self.lines = look.lines;
        let draw_calls = self.scenery.draw(camera, &look, true);
        drawn.triangles = figures.triangles as u64;
        drawn.draw_calls += u32::try_from(draw_calls).unwrap_or(u32::MAX);
        drawn.terrain_shown = true;
        shown
    }
}

/// Whether a point lies within bounds whose east may pass 180 degrees.
fn covers(bounds: &Bounds, point: &Geodetic) -> bool {
    let latitude = point.latitude.to_degrees();
    let from_west = (point.longitude.to_degrees() - bounds.west_deg).rem_euclid(360.0);
    (bounds.south_deg..=bounds.north_deg).contains(&latitude)
        && from_west <= bounds.east_deg - bounds.west_deg
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disk_that_does_not_answer_is_told_after_a_second_and_no_longer_than_it_lasts() {
        let mut patience = Patience::default();
        let mut said = Vec::new();
        for (ms, outstanding, answered) in [
            (0, 0, 0),
            (5000, 0, 0),
            (5100, 3, 0),
            (6000, 3, 0),
            (6200, 3, 0),
            (6300, 2, 1),
            (7200, 2, 1),
            (7400, 0, 3),
            (9000, 0, 3),
        ] {
            let errands = Errands {
                outstanding,
                answered,
                ..Errands::default()
            };
            said.push(patience.is_over(&errands, Monotonic::from_nanos(ms * 1_000_000)));
        }
        // The last answer before the wait was at 5 s.
        let late = [false, false, false, false, true, false, false, false, false];
        assert_eq!(said, late);
    }

    #[test]
    fn a_pack_over_the_date_line_covers_both_its_sides() {
        let bounds = Bounds {
            south_deg: -20.0,
            west_deg: 179.0,
            north_deg: -19.0,
            east_deg: 181.0,
        };
        let at = |lat, lon| covers(&bounds, &Geodetic::from_degrees(lat, lon, 0.0));
        assert!(at(-19.5, 179.5) && at(-19.5, -179.5) && at(-19.5, 180.0));
        assert!(!at(-19.5, -178.9) && !at(-19.5, 178.9) && !at(-18.9, 180.0));
        let world = Bounds {
            south_deg: -90.0,
            west_deg: -180.0,
            north_deg: 90.0,
            east_deg: 180.0,
        };
        assert!(covers(&world, &Geodetic::from_degrees(90.0, 180.0, 0.0)));
    }
}
