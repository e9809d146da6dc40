//! Quantities as types: the number inside is public, conversions are explicit, and arithmetic exists only where it means
//! something.
//!
//! Inside the program everything is SI and radians; feet, knots and degrees appear at the wire (decoders), in board files
//! and in `display::format`, and nowhere else.

/// Metres per international foot (exact, international yard and pound agreement 1959).
pub const METRES_PER_FOOT: f64 = 0.3048;
/// Metres per nautical mile (exact, First International Extraordinary Hydrographic Conference 1929).
pub const METRES_PER_NAUTICAL_MILE: f64 = 1852.0;
/// Hectopascals per inch of mercury at 0 degrees Celsius (conventional; ISO 31-3:1992 annex).
pub const HECTOPASCALS_PER_INCH_OF_MERCURY: f64 = 33.863_886_67;
/// Hectopascals per pound-force per square inch (exact pound and inch of 1959, standard gravity).
pub const HECTOPASCALS_PER_PSI: f64 = 68.947_572_931_683_6;
/// Litres per US liquid gallon (231 cubic inches, exact).
pub const LITRES_PER_US_GALLON: f64 = 3.785_411_784;
/// Standard acceleration of gravity, m/s2 (exact, 3rd CGPM 1901).
pub const STANDARD_GRAVITY_MPS2: f64 = 9.806_65;

macro_rules! quantity {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
        pub struct $name(pub f64);

        impl std::ops::Add for $name {
            type Output = Self;
            fn add(self, other: Self) -> Self {
                Self(self.0 + other.0)
            }
        }

        impl std::ops::Sub for $name {
            type Output = Self;
            fn sub(self, other: Self) -> Self {
                Self(self.0 - other.0)
            }
        }

        impl std::ops::Neg for $name {
            type Output = Self;
            fn neg(self) -> Self {
                Self(-self.0)
            }
        }
    };
}

quantity! {
    /// A length or height in metres. Which height it is (ellipsoid, mean sea level, pressure) is said by the name that holds it.
    Metres
}
quantity! {
    /// A height in international feet.
    Feet
}
quantity! {
    /// A speed in metres per second.
    MetresPerSecond
}
quantity! {
    /// A speed in knots.
    Knots
}
quantity! {
    /// A vertical speed in feet per minute, up positive.
    FeetPerMinute
}
quantity! {
    /// An angle in radians.
    Radians
}
quantity! {
    /// An angle in degrees of arc.
    Degrees
}
quantity! {
    /// A pressure in hectopascals.
    Hectopascals
}
quantity! {
    /// A pressure in inches of mercury at 0 degrees Celsius.
    InchesOfMercury
}
quantity! {
    /// An acceleration in units of the standard gravity.
    StandardGravities
}
quantity! {
    /// A temperature in kelvin.
    Kelvin
}

macro_rules! scale {
    ($from:ident -> $to:ident, $factor:expr) => {
        impl From<$from> for $to {
            fn from(q: $from) -> Self {
                Self(q.0 * $factor)
            }
        }
        impl From<$to> for $from {
            fn from(q: $to) -> Self {
                Self(q.0 / $factor)
            }
        }
    };
}

scale!(Feet -> Metres, METRES_PER_FOOT);
scale!(Knots -> MetresPerSecond, METRES_PER_NAUTICAL_MILE / 3600.0);
scale!(FeetPerMinute -> MetresPerSecond, METRES_PER_FOOT / 60.0);
scale!(InchesOfMercury -> Hectopascals, HECTOPASCALS_PER_INCH_OF_MERCURY);

impl From<Degrees> for Radians {
    fn from(q: Degrees) -> Self {
        Self(q.0.to_radians())
    }
}

impl From<Radians> for Degrees {
    fn from(q: Radians) -> Self {
        Self(q.0.to_degrees())
    }
}

impl Radians {
    /// From degrees of arc.
    #[must_use]
    pub fn from_degrees(degrees: f64) -> Self {
        Self(degrees.to_radians())
    }

    /// In degrees of arc.
    #[must_use]
    pub fn to_degrees(self) -> f64 {
        self.0.to_degrees()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(a: f64, b: f64, tolerance: f64) -> bool {
        (a - b).abs() <= tolerance
    }

    #[test]
    fn conversions_agree_with_the_definitions() {
        assert!(
            near(Metres::from(Feet(1000.0)).0, 304.8, 1e-12),
            "1000 ft is 304.8 m"
        );
        assert!(
            near(
                MetresPerSecond::from(Knots(1.0)).0,
                0.514_444_444_444,
                1e-12
            ),
            "a knot is 1852 m an hour"
        );
        assert!(
            near(FeetPerMinute::from(MetresPerSecond(5.08)).0, 1000.0, 1e-9),
            "5.08 m/s is 1000 ft/min"
        );
        assert!(
            near(Hectopascals::from(InchesOfMercury(29.92)).0, 1013.207, 1e-3),
            "29.92 inHg"
        );
        assert!(
            near(Radians::from(Degrees(180.0)).0, std::f64::consts::PI, 1e-15),
            "half a turn"
        );
    }

    #[test]
    fn conversions_go_back() {
        for x in [-12.5, 0.0, 0.3, 1e6] {
            assert!(
                near(Feet::from(Metres::from(Feet(x))).0, x, 1e-9),
                "feet and back"
            );
            assert!(
                near(Knots::from(MetresPerSecond::from(Knots(x))).0, x, 1e-9),
                "knots and back"
            );
        }
    }
}
