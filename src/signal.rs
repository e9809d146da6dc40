//! The words that cross between buses, state and display: raw frames, and signals with one table of parameters.
//!
//! A decoder (`proto`) turns a [`Frame`] into [`Signal`]s; fusion (`state`) turns signals into a `FlightState`. Neither
//! knows the other: they meet here.

use crate::sampled::Invalid;
use crate::time::Monotonic;
use std::time::Duration;

/// Which configured source said it: its index in the board file's list of sources.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SourceId(pub u8);

/// One whole unit as it came off a bus.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// When it was received, stamped by the bus thread.
    pub at: Monotonic,
    /// The source that received it.
    pub source: SourceId,
    /// What it holds.
    pub wire: Wire<'a>,
}

/// The bytes of a frame.
#[derive(Clone, Copy, Debug)]
pub enum Wire<'a> {
    /// A CAN 2.0 data frame.
    Can(CanData),
    /// One UDP datagram.
    Datagram(&'a [u8]),
}

/// A CAN 2.0 data frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CanData {
    /// Identifier, 11 or 29 bits.
    pub id: u32,
    /// Whether the identifier has 29 bits.
    pub extended: bool,
    /// Number of data bytes, 0 to 8.
    pub len: u8,
    /// Data; bytes beyond `len` are zero.
    pub data: [u8; 8],
}

impl CanData {
    /// The data bytes that were sent.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.data[..usize::from(self.len.min(8))]
    }
}

/// What a source said about one parameter: a number in the parameter's SI unit, or why there is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Signal {
    /// When its frame was received.
    pub at: Monotonic,
    /// Who said it.
    pub source: SourceId,
    /// About what.
    pub parameter: Parameter,
    /// In the unit of [`Parameter::spec`]; already checked finite and in range.
    pub value: Result<f64, Invalid>,
}

/// Unit, range and ages of one parameter. Ranges are what the quantity can be in any aircraft this program flies in; a
/// number outside is an error of the sender and is never clamped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParameterSpec {
    /// Snake-case name with the unit as its last word, as in CSV and JSON output.
    pub name: &'static str,
    /// Smallest possible value.
    pub min: f64,
    /// Largest possible value.
    pub max: f64,
    /// The age beyond which it may no longer be shown.
    pub age_max: Duration,
}

macro_rules! parameters {
    ($($(#[$doc:meta])* $variant:ident = $name:literal, $min:expr => $max:expr, $age_ms:expr;)*) => {
        /// Everything that a source can tell this program. The doc of each gives unit, sign and frame.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        #[repr(u8)]
        pub enum Parameter { $($(#[$doc])* $variant,)* }

        impl Parameter {
            /// All of them, in the order of their discriminants.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)*];

            /// How many there are.
            pub const COUNT: usize = Self::ALL.len();

            /// Its row of the table.
            #[must_use]
            pub const fn spec(self) -> ParameterSpec {
                match self {
                    $(Self::$variant => ParameterSpec {
                        name: $name, min: $min, max: $max, age_max: Duration::from_millis($age_ms),
                    },)*
                }
            }
        }
    };
}

const PI: f64 = std::f64::consts::PI;
const HALF_PI: f64 = std::f64::consts::FRAC_PI_2;
const TAU: f64 = std::f64::consts::TAU;

// Ages: attitude, rates and lateral acceleration 0.3 s, air data and heading 2 s, position 1 s for synthetic vision,
// engine 5 s (start values from FIX-Gateway's table and the update rates that the buses recommend; see limits.rs).
parameters! {
    /// Nose up positive, rad.
    Pitch = "pitch_rad", -HALF_PI => HALF_PI, 300;
    /// Right wing down positive, rad.
    Roll = "roll_rad", -PI => PI, 300;
    /// Clockwise from true north, rad, 0 to 2 pi.
    HeadingTrue = "heading_true_rad", 0.0 => TAU, 2000;
    /// Clockwise from magnetic north, rad, 0 to 2 pi.
    HeadingMagnetic = "heading_magnetic_rad", 0.0 => TAU, 2000;
    /// About the body's forward axis, right wing going down positive, rad/s.
    RollRate = "roll_rate_radps", -10.0 => 10.0, 300;
    /// About the body's right axis, nose going up positive, rad/s.
    PitchRate = "pitch_rate_radps", -10.0 => 10.0, 300;
    /// About the body's down axis, nose going right positive, rad/s.
    YawRate = "yaw_rate_radps", -10.0 => 10.0, 300;
    /// Along the body's forward axis, g.
    LongitudinalAcceleration = "longitudinal_acceleration_g", -20.0 => 20.0, 300;
    /// Along the body's right axis, g: what the accelerometer feels, so the slip ball moves the other way.
    LateralAcceleration = "lateral_acceleration_g", -20.0 => 20.0, 300;
    /// Along the body's up axis, g: 1 in level flight.
    NormalAcceleration = "normal_acceleration_g", -20.0 => 20.0, 300;
    /// Sideslip, wind from the right positive, rad.
    Sideslip = "sideslip_rad", -HALF_PI => HALF_PI, 300;
    /// Angle of attack, rad.
    AngleOfAttack = "angle_of_attack_rad", -PI => PI, 300;
    /// m/s.
    IndicatedAirspeed = "indicated_airspeed_mps", 0.0 => 400.0, 2000;
    /// m/s.
    CalibratedAirspeed = "calibrated_airspeed_mps", 0.0 => 400.0, 2000;
    /// m/s.
    TrueAirspeed = "true_airspeed_mps", 0.0 => 600.0, 2000;
    /// Above the 1013.25 hPa surface of the ICAO standard atmosphere, m.
    PressureAltitude = "pressure_altitude_m", -1000.0 => 25_000.0, 2000;
    /// Corrected by the source with its own setting ([`Parameter::BaroSetting`]), m.
    BaroAltitude = "baro_altitude_m", -1000.0 => 25_000.0, 2000;
    /// The setting that the source used for [`Parameter::BaroAltitude`], hPa.
    BaroSetting = "baro_setting_hpa", 800.0 => 1100.0, 20_000;
    /// Up positive, m/s.
    VerticalSpeed = "vertical_speed_mps", -150.0 => 150.0, 2000;
    /// Static (outside) air temperature, K.
    StaticAirTemperature = "static_air_temperature_k", 173.0 => 343.0, 5000;
    /// Geodetic on WGS 84, north positive, rad.
    Latitude = "latitude_rad", -HALF_PI => HALF_PI, 1000;
    /// On WGS 84, east positive, rad, -pi to pi.
    Longitude = "longitude_rad", -PI => PI, 1000;
    /// Above mean sea level (the EGM96 geoid), m, geometric.
    AltitudeMsl = "altitude_msl_m", -1000.0 => 30_000.0, 1000;
    /// Above the WGS 84 ellipsoid, m, geometric.
    HeightEllipsoid = "height_ellipsoid_m", -1200.0 => 30_000.0, 1000;
    /// Over the ground, m/s.
    GroundSpeed = "ground_speed_mps", 0.0 => 700.0, 2000;
    /// Direction of motion over the ground, clockwise from true north, rad, 0 to 2 pi.
    Track = "track_rad", 0.0 => TAU, 2000;
    /// How fast the heading changes, right (clockwise) positive, rad/s.
    TurnRate = "turn_rate_radps", -10.0 => 10.0, 300;
    /// The altitude of the ICAO standard atmosphere that has the air's density, m.
    DensityAltitude = "density_altitude_m", -5000.0 => 30_000.0, 5000;
    /// m/s.
    WindSpeed = "wind_speed_mps", 0.0 => 200.0, 5000;
    /// Where the wind comes from, clockwise from true north, rad, 0 to 2 pi.
    WindDirectionTrue = "wind_direction_true_rad", 0.0 => TAU, 5000;
    /// Direction of motion over the ground, clockwise from magnetic north, rad, 0 to 2 pi.
    TrackMagnetic = "track_magnetic_rad", 0.0 => TAU, 2000;
    /// Magnetic north as seen from true north, east positive, rad.
    MagneticVariation = "magnetic_variation_rad", -PI => PI, 20_000;
    /// Above the ground below, m.
    HeightAgl = "height_agl_m", -100.0 => 30_000.0, 2000;
    /// Days since 1 January 1970, coordinated universal time.
    UtcDate = "utc_date_days", 10_957.0 => 73_050.0, 20_000;
    /// First engine, 1/min.
    EngineSpeed = "engine_speed_rpm", 0.0 => 60_000.0, 5000;
}

impl Parameter {
    /// Its row in arrays indexed by parameter.
    #[must_use]
    pub const fn index(self) -> usize {
        self as usize
    }

    /// A number fresh off the wire, in this parameter's unit, as a verdict: finite and within range, or out of range.
    ///
    /// # Errors
    /// [`Invalid::OutOfRange`] for NaN, infinities and anything outside the table's range.
    pub fn check(self, value: f64) -> Result<f64, Invalid> {
        let spec = self.spec();
        if value >= spec.min && value <= spec.max {
            Ok(value)
        } else {
            Err(Invalid::OutOfRange)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_follow_the_list() {
        for (i, p) in Parameter::ALL.iter().enumerate() {
            assert_eq!(p.index(), i, "{p:?}");
        }
    }

    #[test]
    fn no_range_accepts_what_is_not_a_number() {
        for p in Parameter::ALL {
            for x in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300] {
                assert_eq!(p.check(x), Err(Invalid::OutOfRange), "{p:?} {x}");
            }
        }
    }

    #[test]
    fn names_are_unique_and_end_in_a_unit() {
        let mut names: Vec<_> = Parameter::ALL.iter().map(|p| p.spec().name).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), Parameter::COUNT);
    }
}
