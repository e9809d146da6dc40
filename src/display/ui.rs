//! What the pilot and the installer have set.

use crate::atmosphere::STANDARD_PRESSURE;
use crate::limits::SOURCES_MAX;
use crate::signal::SourceId;
use crate::units::{Hectopascals, Knots, Metres, Radians};
use arrayvec::ArrayString;

/// A barometric setting that an altimeter accepts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BaroSetting(Hectopascals);

impl BaroSetting {
    /// The smallest setting: 27.50 inHg (SAE AS6296, altimeter), rounded to whole hectopascals.
    pub const MIN: Hectopascals = Hectopascals(931.0);
    /// The greatest setting: 31.50 inHg (SAE AS6296, altimeter), rounded to whole hectopascals.
    pub const MAX: Hectopascals = Hectopascals(1067.0);
    /// 1013.25 hPa.
    pub const STANDARD: Self = Self(STANDARD_PRESSURE);

    /// The setting `pressure`, or `None` when it lies outside [`Self::MIN`] to [`Self::MAX`] or is not a number.
    #[must_use]
    pub fn new(pressure: Hectopascals) -> Option<Self> {
        (pressure >= Self::MIN && pressure <= Self::MAX).then_some(Self(pressure))
    }

    /// Its pressure.
    #[must_use]
    pub const fn pressure(self) -> Hectopascals {
        self.0
    }
}

/// The unit in which barometric settings are shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BaroUnit {
    /// Whole hectopascals.
    #[default]
    Hectopascals,
    /// Hundredths of an inch of mercury.
    InchesOfMercury,
}

/// Whether there is terrain to draw.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Terrain {
    /// No pack is configured.
    #[default]
    NoPack,
    /// A pack is open but its first levels are not there yet.
    Loading,
    /// Ready to be drawn.
    Ready,
    /// The aircraft is outside what the pack covers.
    Outside,
    /// The pack holds no measured post.
    Empty,
    /// No picture can be drawn from where the eye is said to be.
    NoCamera,
}

/// What the pilot must know of terrain that is shown: the gravest of what is true.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TerrainCaution {
    /// The eye is below the ground that is drawn: position, height or terrain is wrong.
    BelowGround,
    /// Nothing was measured under the aircraft.
    NoDataBelow,
    /// The fine levels around the aircraft are not there yet: nearby ground is drawn coarsely.
    Coarse,
    /// The disk has not answered for a second: ground ahead comes late.
    Slow,
    /// Parts of the pack cannot be read and are drawn from coarser data.
    Damaged,
}

impl TerrainCaution {
    /// What the annunciation says.
    #[must_use]
    pub const fn label(self) -> &'static str {
        match self {
            Self::BelowGround => "BELOW GROUND",
            Self::NoDataBelow => "NO DATA HERE",
            Self::Coarse => "COARSE",
            Self::Slow => "DISK SLOW",
            Self::Damaged => "DAMAGED",
        }
    }
}

/// What is wrong with a source as a whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkFault {
    /// Its device is gone, or cannot be opened.
    Closed,
    /// Its interface is switched off.
    Down,
    /// Its controller has left the bus.
    BusOff,
    /// Its controller sees so many errors that it no longer marks them: this station, its wiring or its bit rate.
    Errors,
    /// Its device is well, but nothing comes that can be used.
    Silent,
}

impl LinkFault {
    /// What the line says after the source's name.
    #[must_use]
    pub const fn label(self) -> &'static str {
        match self {
            Self::Closed => "LOST",
            Self::Down => "DOWN",
            Self::BusOff => "BUS OFF",
            Self::Errors => "ERRORS",
            Self::Silent => "SILENT",
        }
    }
}

/// What a source is called on the display: short, in capitals.
pub type SourceName = ArrayString<8>;

/// The state of the pilot's controls, and of what the display depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ui {
    /// The setting of the pilot's altimeter.
    pub baro: BaroSetting,
    /// Whether the altimeter stands on the standard setting instead (flight levels).
    pub baro_standard: bool,
    /// What the terrain engine has to offer.
    pub terrain: Terrain,
    /// What is to be said of terrain that is shown.
    pub terrain_caution: Option<TerrainCaution>,
    /// How high the eye stands above the ground that is drawn, where nothing is wrong with that.
    pub height_above_ground: Option<Metres>,
    /// Whether ground is coloured by its height relative to the aircraft.
    pub awareness: bool,
    /// Whether lines of latitude and longitude lie on the ground.
    pub grid: bool,
    /// Whether terrain and sky are dimmed for eyes used to the dark.
    pub night: bool,
    /// What is wrong with each source.
    pub links: [Option<LinkFault>; SOURCES_MAX],
}

impl Default for Ui {
    /// An altimeter starts at 1013.25 hPa, and without terrain until the engine says that it has some.
    fn default() -> Self {
        Self {
            baro: BaroSetting::STANDARD,
            baro_standard: false,
            terrain: Terrain::NoPack,
            terrain_caution: None,
            height_above_ground: None,
            awareness: false,
            grid: false,
            night: false,
            links: [None; SOURCES_MAX],
        }
    }
}

/// The aircraft's limiting speeds. An arc is drawn only where both of its ends are configured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VSpeeds {
    /// Stall, landing configuration.
    pub vs0: Option<Knots>,
    /// Stall, clean.
    pub vs1: Option<Knots>,
    /// Greatest with flaps extended.
    pub vfe: Option<Knots>,
    /// Greatest in rough air.
    pub vno: Option<Knots>,
    /// Never exceed.
    pub vne: Option<Knots>,
}

impl VSpeeds {
    /// All five, the slowest first.
    #[must_use]
    pub const fn all(self) -> [Option<Knots>; 5] {
        [self.vs0, self.vs1, self.vfe, self.vno, self.vne]
    }

    /// From all five in the order of [`Self::all`].
    #[must_use]
    pub const fn from_all([vs0, vs1, vfe, vno, vne]: [Option<Knots>; 5]) -> Self {
        Self {
            vs0,
            vs1,
            vfe,
            vno,
            vne,
        }
    }
}

/// What the installer has configured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// The unit of barometric settings.
    pub baro_unit: BaroUnit,
    /// The limiting speeds.
    pub v_speeds: VSpeeds,
    /// Horizontal field of view of the whole picture, 1 to 170 degrees; terrain, horizon and pitch ladder share it.
    pub hfov: Radians,
    /// What each source is called, by its id; an empty name is told by its number.
    pub source_names: [SourceName; SOURCES_MAX],
}

impl Config {
    /// What a source is called on the display.
    #[must_use]
    pub fn name(&self, source: SourceId) -> SourceName {
        let name = self.source_names.get(usize::from(source.0));
        name.filter(|name| !name.is_empty())
            .copied()
            .unwrap_or_else(|| super::format::source_label(source))
    }
}

/// The beginning of a name in a board file as the display shows it: letters, digits and signs that its font has, in capitals.
#[must_use]
pub fn source_name(name: &str) -> SourceName {
    let mut out = SourceName::new();
    let shown = name.chars().map(|c| c.to_ascii_uppercase());
    for c in shown.filter(|c| c.is_ascii_alphanumeric() || "-_./".contains(*c)) {
        if out.try_push(c).is_err() {
            break;
        }
    }
    out
}

impl Default for Config {
    /// Hectopascals, no limiting speeds, a field of view of 60 degrees.
    fn default() -> Self {
        Self {
            baro_unit: BaroUnit::Hectopascals,
            v_speeds: VSpeeds::default(),
            hfov: Radians(std::f64::consts::FRAC_PI_3),
            source_names: [SourceName::new_const(); SOURCES_MAX],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_settings_of_an_altimeter_are_taken() {
        for good in [931.0, 1013.25, 1067.0] {
            assert!(BaroSetting::new(Hectopascals(good)).is_some(), "{good}");
        }
        for bad in [0.0, 930.9, 1067.1, 29.92, f64::NAN, f64::INFINITY] {
            assert!(BaroSetting::new(Hectopascals(bad)).is_none(), "{bad}");
        }
    }
}
