//! From SI to what is read on the glass: display units, rounding, the text of numbers, and the wheels of rolling readouts.
//!
//! The only module with feet, knots and degrees of arc behind the decoders. Text is made in fixed buffers.

use super::ui::{BaroUnit, SourceName};
use crate::angle::wrap_turn;
use crate::signal::SourceId;
use crate::units::{
    Degrees, Feet, FeetPerMinute, Hectopascals, InchesOfMercury, Knots, Metres, MetresPerSecond,
    Radians,
};
use arrayvec::ArrayString;
use std::fmt::Write;

/// The longest text of a field, in bytes.
pub const TEXT_MAX: usize = 16;

/// The text of a field.
pub type Text = ArrayString<TEXT_MAX>;

/// Formats into a [`Text`]; what does not fit is left out whole (no caller here comes near).
fn text(arguments: std::fmt::Arguments<'_>) -> Text {
    let mut out = Text::new();
    if out.write_fmt(arguments).is_err() {
        out.clear();
        debug_assert!(false, "a field's text is longer than TEXT_MAX");
    }
    out
}

/// The nearest whole number, half away from zero; saturates far outside of anything shown.
#[must_use]
pub fn whole(x: f64) -> i64 {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "`as` saturates, and every parameter's range is far smaller"
    )]
    {
        x.round() as i64
    }
}

/// The greatest whole number not above `x`; saturates like [`whole`].
#[must_use]
pub fn whole_below(x: f64) -> i64 {
    whole(x.floor())
}

/// A small whole number as a floating one, exactly (all of this module's are below 2^53).
#[must_use]
pub fn real(k: i64) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "far below 2^53")]
    {
        k as f64
    }
}

/// In knots.
#[must_use]
pub fn knots(speed: MetresPerSecond) -> Knots {
    speed.into()
}

/// In feet.
#[must_use]
pub fn feet(height: Metres) -> Feet {
    height.into()
}

/// In feet per minute, up positive.
#[must_use]
pub fn feet_per_minute(speed: MetresPerSecond) -> FeetPerMinute {
    speed.into()
}

/// A direction in degrees, 0 <= d < 360.
#[must_use]
pub fn direction(angle: Radians) -> Degrees {
    wrap_turn(angle).into()
}

/// A direction as three digits, 001 to 360: north is 360, never 000.
#[must_use]
pub fn direction_digits(direction: Degrees) -> Text {
    let whole = whole(direction.0).rem_euclid(360);
    text(format_args!("{:03}", if whole == 0 { 360 } else { whole }))
}

/// The label of a compass mark at a whole multiple of 10 degrees: N, E, S, W, else tens of degrees.
#[must_use]
pub fn compass_label(degrees: i64) -> Text {
    match degrees.rem_euclid(360) {
        0 => text(format_args!("N")),
        90 => text(format_args!("E")),
        180 => text(format_args!("S")),
        270 => text(format_args!("W")),
        d => text(format_args!("{}", d / 10)),
    }
}

/// A height to the nearest ten feet.
#[must_use]
pub fn tens_of_feet(height: Feet) -> Text {
    mark(whole(height.0 / 10.0) * 10)
}

/// A source by its place in the board file, from 1.
#[must_use]
pub fn source_label(source: SourceId) -> SourceName {
    let mut out = SourceName::new();
    if write!(out, "SRC {}", u16::from(source.0) + 1).is_err() {
        out.clear();
    }
    out
}

/// A temperature in whole degrees Celsius.
#[must_use]
pub fn celsius(temperature: f64) -> Text {
    mark(whole(temperature))
}

/// A distance in nautical miles: to a tenth below ten, whole from there on.
#[must_use]
pub fn nautical_miles(distance: f64) -> Text {
    if distance < 9.95 {
        text(format_args!("{distance:.1}"))
    } else {
        text(format_args!("{}", whole(distance)))
    }
}

/// How much higher another aircraft is, in hundreds of feet with its sign; level is `00`.
#[must_use]
pub fn hundreds_above(above: Feet) -> Text {
    match whole(above.0 / 100.0) {
        0 => text(format_args!("00")),
        n => text(format_args!("{n:+03}")),
    }
}

/// The label of a mark on a tape or ladder.
#[must_use]
pub fn mark(value: i64) -> Text {
    text(format_args!("{value}"))
}

/// A ground speed in whole knots.
#[must_use]
pub fn whole_knots(speed: Knots) -> Text {
    text(format_args!("{}", whole(speed.0)))
}

/// A vertical speed to the nearest 50 ft/min without its sign; `None` where that is less than 100.
#[must_use]
pub fn vertical_speed(speed: FeetPerMinute) -> Option<Text> {
    let rounded = whole(speed.0.abs() / 50.0) * 50;
    (rounded >= 100).then(|| text(format_args!("{rounded}")))
}

/// A barometric setting in its unit, without the unit.
#[must_use]
pub fn baro(setting: Hectopascals, unit: BaroUnit) -> Text {
    match unit {
        BaroUnit::Hectopascals => text(format_args!("{}", whole(setting.0))),
        BaroUnit::InchesOfMercury => text(format_args!("{:.2}", InchesOfMercury::from(setting).0)),
    }
}

/// A number with so many decimals; never minus nothing.
#[must_use]
pub fn fixed(x: f64, decimals: usize) -> Text {
    let shown = text(format_args!("{x:.decimals$}"));
    let is_nothing = shown.bytes().all(|b| matches!(b, b'-' | b'0' | b'.'));
    match shown.strip_prefix('-') {
        Some(digits) if is_nothing => Text::from(digits).unwrap_or(shown),
        _ => shown,
    }
}

/// How many more there are.
#[must_use]
pub fn more(n: usize) -> Text {
    text(format_args!("+{n} SOURCES"))
}

/// A limit as a bus gives it.
#[must_use]
pub fn bus_limit(speed: Knots) -> Text {
    text(format_args!("BUS {}", whole(speed.0)))
}

/// A setting as a source uses it.
#[must_use]
pub fn source_setting(setting: Hectopascals, unit: BaroUnit) -> Text {
    text(format_args!("SRC {}", baro(setting, unit)))
}

/// The label of a barometric unit.
#[must_use]
pub const fn baro_unit(unit: BaroUnit) -> &'static str {
    match unit {
        BaroUnit::Hectopascals => "HPA",
        BaroUnit::InchesOfMercury => "IN",
    }
}

/// One digit of a rolling readout: what stands in the window, what comes next, and how far it has turned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wheel {
    /// The digit of the number; `None` is a blank before the first digit.
    pub digit: Option<u8>,
    /// The digit that follows as the magnitude grows.
    pub next: u8,
    /// 0: `digit` stands in the middle, towards 1: `next` has almost replaced it.
    pub turned: f64,
}

/// A rolling readout: a drum that turns continuously for the last digits and wheels before it that turn with the drum's
/// last step before a carry, as in a mechanical altimeter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rolling<const WHEELS: usize> {
    /// Whether a minus sign stands before the digits: when the drum's nearest row is below zero.
    pub negative: bool,
    /// Whether the magnitude grows downwards (below zero), so that `next` comes from below.
    pub mirrored: bool,
    /// From the highest place to the lowest.
    pub wheels: [Wheel; WHEELS],
    /// Where the drum stands, in rows: the row `k` of [`altitude_drum_row`] or [`airspeed_drum_row`] is in the middle when this is `k`.
    pub drum: f64,
}

/// The readout of `value` with a drum of rows `step` apart showing the part of the number below `unit`.
fn rolling<const WHEELS: usize>(value: f64, unit: f64, step: f64) -> Rolling<WHEELS> {
    let magnitude = value.abs();
    let mut wheels = [Wheel {
        digit: None,
        next: 0,
        turned: 0.0,
    }; WHEELS];
    let mut place = unit;
    for wheel in wheels.iter_mut().rev() {
        let count = whole_below(magnitude / place);
        let digit = u8::try_from(count.rem_euclid(10)).unwrap_or(0);
        let rest = magnitude - real(count) * place;
        *wheel = Wheel {
            digit: (count > 0).then_some(digit),
            next: (digit + 1) % 10,
            turned: ((rest - (place - step)) / step).clamp(0.0, 1.0),
        };
        place *= 10.0;
    }
    Rolling {
        negative: whole(value / step) < 0,
        mirrored: value < 0.0,
        wheels,
        drum: value / step,
    }
}

/// The step of the altitude drum, ft.
pub const ALTITUDE_STEP_FT: i64 = 20;

/// The altitude readout: ten thousands, thousands and hundreds on wheels, the last two digits on a drum of 20 ft.
#[must_use]
pub fn rolling_altitude(altitude: Feet) -> Rolling<3> {
    rolling(altitude.0, 100.0, real(ALTITUDE_STEP_FT))
}

/// The airspeed readout: hundreds and tens on wheels, ones on a drum of 1 kt.
#[must_use]
pub fn rolling_airspeed(airspeed: Knots) -> Rolling<2> {
    rolling(airspeed.0, 10.0, 1.0)
}

/// The text on row `row` of the altitude drum: two digits.
#[must_use]
pub fn altitude_drum_row(row: i64) -> Text {
    text(format_args!("{:02}", (row * ALTITUDE_STEP_FT).abs() % 100))
}

/// The text on row `row` of the airspeed drum: one digit; nothing below zero.
#[must_use]
pub fn airspeed_drum_row(row: i64) -> Text {
    if row < 0 {
        return Text::new();
    }
    text(format_args!("{}", row % 10))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn altitude(ft: f64) -> Rolling<3> {
        rolling_altitude(Feet(ft))
    }

    fn digits<const N: usize>(r: &Rolling<N>) -> [Option<u8>; N] {
        r.wheels.map(|w| w.digit)
    }

    #[test]
    fn headings_round_and_north_is_360() {
        for (degrees, shown) in [
            (0.0, "360"),
            (0.4, "360"),
            (0.6, "001"),
            (9.5, "010"),
            (89.4, "089"),
            (179.9, "180"),
            (359.4, "359"),
            (359.6, "360"),
        ] {
            assert_eq!(
                direction_digits(Degrees(degrees)).as_str(),
                shown,
                "{degrees}"
            );
        }
        assert_eq!(direction_digits(direction(Radians(-0.1))).as_str(), "354");
    }

    #[test]
    fn compass_marks_are_letters_and_tens() {
        let labels: Vec<_> = (0..12).map(|k| compass_label(k * 30).to_string()).collect();
        assert_eq!(
            labels,
            [
                "N", "3", "6", "E", "12", "15", "S", "21", "24", "W", "30", "33"
            ]
        );
        assert_eq!(compass_label(-30).as_str(), "33");
    }

    #[test]
    fn the_wheels_of_9990_ft_carry_to_10000() {
        let r = altitude(9_980.0);
        assert_eq!(digits(&r), [None, Some(9), Some(9)]);
        assert!(
            r.wheels.iter().all(|w| w.turned.abs() < 1e-9),
            "the drum's last row is reached"
        );
        let r = altitude(9_990.0);
        assert_eq!(digits(&r), [None, Some(9), Some(9)]);
        assert_eq!(r.wheels.map(|w| w.next), [1, 0, 0]);
        assert!(
            r.wheels.iter().all(|w| (w.turned - 0.5).abs() < 1e-9),
            "{r:?}"
        );
        let r = altitude(10_000.0);
        assert_eq!(digits(&r), [Some(1), Some(0), Some(0)]);
        assert!(r.wheels.iter().all(|w| w.turned.abs() < 1e-9), "{r:?}");
    }

    #[test]
    fn a_wheel_turns_only_with_the_last_step_of_the_one_before() {
        let r = altitude(4_379.0);
        assert_eq!(digits(&r), [None, Some(4), Some(3)]);
        assert!(r.wheels.iter().all(|w| w.turned.abs() < 1e-9), "{r:?}");
        let r = altitude(4_395.0);
        assert!((r.wheels[2].turned - 0.75).abs() < 1e-9, "{r:?}");
        assert!(r.wheels[1].turned.abs() < 1e-9, "thousands stand: {r:?}");
        let r = rolling_airspeed(Knots(99.25));
        assert_eq!(digits(&r), [None, Some(9)]);
        assert!(
            r.wheels.iter().all(|w| (w.turned - 0.25).abs() < 1e-9),
            "{r:?}"
        );
        let r = rolling_airspeed(Knots(118.5));
        assert!(r.wheels.iter().all(|w| w.turned.abs() < 1e-9), "{r:?}");
    }

    #[test]
    fn below_zero_the_digits_are_those_of_the_magnitude() {
        let r = altitude(-1_250.0);
        assert!(r.negative && r.mirrored, "{r:?}");
        assert_eq!(digits(&r), [None, Some(1), Some(2)]);
        // -1250 lies half way between the rows of -1240 and -1260.
        assert!((r.drum + 62.5).abs() < 1e-9, "{r:?}");
        assert_eq!(altitude_drum_row(-62).as_str(), "40");
        assert_eq!(altitude_drum_row(-63).as_str(), "60");
        assert!(!altitude(-9.0).negative, "the nearest row is 00");
        assert!(altitude(-11.0).negative, "the nearest row is 20 below");
    }

    /// What a reader of the glass reads: wheels and the drum's row, all nearest to the middle.
    fn read(r: &Rolling<3>) -> i64 {
        let mut n = 0;
        for w in r.wheels {
            let shown = if w.turned > 0.5 {
                w.next
            } else {
                w.digit.unwrap_or(0)
            };
            n = n * 10 + i64::from(shown);
        }
        let tail: i64 = altitude_drum_row(whole(r.drum)).parse().unwrap_or(-1);
        (n * 100 + tail) * if r.negative { -1 } else { 1 }
    }

    #[test]
    fn the_readout_is_within_half_a_step_everywhere() {
        let mut ft = -3_281.0;
        while ft < 99_980.0 {
            let shown = real(read(&altitude(ft)));
            assert!((shown - ft).abs() <= 10.0 + 1e-6, "{ft} ft reads {shown}");
            ft += 7.3;
        }
    }

    #[test]
    fn vertical_speed_is_shown_in_fifties_from_a_hundred() {
        for (fpm, shown) in [
            (0.0, None),
            (74.0, None),
            (76.0, Some("100")),
            (-510.0, Some("500")),
            (1_980.0, Some("2000")),
            (29_527.0, Some("29550")),
        ] {
            assert_eq!(
                vertical_speed(FeetPerMinute(fpm)).as_deref(),
                shown,
                "{fpm}"
            );
        }
    }

    #[test]
    fn settings_are_shown_in_their_unit() {
        assert_eq!(
            baro(Hectopascals(1013.25), BaroUnit::Hectopascals).as_str(),
            "1013"
        );
        assert_eq!(
            baro(Hectopascals(1013.25), BaroUnit::InchesOfMercury).as_str(),
            "29.92"
        );
        assert_eq!(
            baro(Hectopascals(998.0), BaroUnit::InchesOfMercury).as_str(),
            "29.47"
        );
    }

    #[test]
    fn units_are_converted_once() {
        assert!(
            (knots(MetresPerSecond(51.444_444)).0 - 100.0).abs() < 1e-5,
            "100 kt"
        );
        assert!(
            (feet(Metres(3048.0)).0 - 10_000.0).abs() < 1e-9,
            "10 000 ft"
        );
        assert!(
            (feet_per_minute(MetresPerSecond(-5.08)).0 + 1000.0).abs() < 1e-9,
            "1000 ft/min"
        );
    }
}
