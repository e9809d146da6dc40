//! The first engine, as the pilot is told of it: shown once anything of it has been heard.
//!
//! Of cylinders the hottest counts, of tanks the sum; where one that was heard of has nothing good to say, neither has the
//! whole: the hottest of the rest would hide it. Limits are those that a bus gives for the first of them: an alarm is red, a
//! warning amber (14 CFR 23.1549 has red for limits and yellow for cautionary ranges).

use super::format::{self, Text};
use super::ui::BaroUnit;
use crate::sampled::Invalid;
use crate::signal::{BUS_VOLTAGE, FUEL_QUANTITY, Parameter as P, engines};
use crate::state::FlightState;
use crate::time::Monotonic;
use crate::units::HECTOPASCALS_PER_INCH_OF_MERCURY;
use arrayvec::ArrayVec;

/// Gauges in the strip.
pub const GAUGES: usize = 9;

/// hPa in a pound per square inch (NIST SP 811, appendix B.8: 6.894 757 kPa).
const HPA_PER_PSI: f64 = 68.947_57;

/// How a value stands to its limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// Within them, or there are none.
    Normal,
    /// Beyond a limit that warns.
    Caution,
    /// Beyond a limit that must not be passed.
    Warning,
}

/// Where limits and value stand on a scale from 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bar {
    /// The value, within 0 to 1: beyond, the pointer stays at the end.
    pub value: f64,
    /// Below this it is red, below that amber.
    pub low: [Option<f64>; 2],
    /// Above this it is red, above that amber.
    pub high: [Option<f64>; 2],
}

/// What a gauge shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// In the gauge's unit.
    pub text: Text,
    /// How it stands to its limits.
    pub level: Level,
    /// The scale, where both of its ends are known.
    pub bar: Option<Bar>,
}

/// One gauge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gauge {
    /// As on the instrument.
    pub name: &'static str,
    /// Of the reading.
    pub unit: &'static str,
    /// The reading, or why there is none.
    pub reading: Result<Reading, Invalid>,
}

/// The strip.
pub type Engine = ArrayVec<Gauge, GAUGES>;

#[derive(Clone, Copy)]
enum Of {
    First,
    Greatest,
    Sum,
}

struct Spec {
    name: &'static str,
    unit: &'static str,
    parameters: &'static [P],
    of: Of,
    scale: f64,
    offset: f64,
    decimals: usize,
}

const fn spec(
    name: &'static str,
    unit: &'static str,
    parameters: &'static [P],
    of: Of,
    scale: f64,
    decimals: usize,
) -> Spec {
    Spec {
        name,
        unit,
        parameters,
        of,
        scale,
        offset: 0.0,
        decimals,
    }
}

const fn celsius(name: &'static str, parameters: &'static [P]) -> Spec {
    Spec {
        offset: -273.15,
        ..spec(name, "\u{b0}C", parameters, Of::Greatest, 1.0, 0)
    }
}

/// The gauges from left to right.
fn specs(unit: BaroUnit) -> [Spec; GAUGES] {
    let inches = 1.0 / HECTOPASCALS_PER_INCH_OF_MERCURY;
    let (manifold, oil) = match unit {
        BaroUnit::Hectopascals => (("HPA", 1.0, 0), ("BAR", 0.001, 1)),
        BaroUnit::InchesOfMercury => (("IN", inches, 1), ("PSI", 1.0 / HPA_PER_PSI, 0)),
    };
    let one = |name, p, (unit, scale, decimals)| spec(name, unit, p, Of::First, scale, decimals);
    [
        spec("RPM", "", &[engines::SPEED[0]], Of::First, 1.0, 0),
        one("MAP", &[engines::MANIFOLD_PRESSURE[0]], manifold),
        one("OIL P", &[engines::OIL_PRESSURE[0]], oil),
        celsius("OIL T", &[engines::OIL_TEMPERATURE[0]]),
        celsius("CHT", &engines::CYLINDER_HEAD_TEMPERATURE[0]),
        celsius("EGT", &engines::EXHAUST_GAS_TEMPERATURE[0]),
        spec("FLOW", "L/H", &[engines::FUEL_FLOW[0]], Of::First, 1.0, 1),
        spec("FUEL", "L", &FUEL_QUANTITY, Of::Sum, 1.0, 0),
        spec("BUS", "V", &[BUS_VOLTAGE[0]], Of::First, 1.0, 1),
    ]
}

/// The strip, empty where nothing has ever been heard of an engine.
pub(super) fn engine(state: &FlightState, unit: BaroUnit, now: Monotonic) -> Engine {
    let specs = specs(unit);
    // A battery has a voltage without an engine, tanks have fuel.
    let is_engine = |s: &Spec| s.parameters.iter().any(|p| state.at(*p).is_some());
    if !specs[..GAUGES - 2].iter().any(is_engine) {
        return Engine::new();
    }
    let gauge = |s: &Spec| Gauge {
        name: s.name,
        unit: s.unit,
        reading: value(state, s, now).map(|value| reading(state, s, value)),
    };
    specs.iter().map(gauge).collect()
}

/// In the parameter's unit.
fn value(state: &FlightState, spec: &Spec, now: Monotonic) -> Result<f64, Invalid> {
    let heard = spec.parameters.iter().filter(|p| state.at(**p).is_some());
    let mut all: Option<f64> = None;
    for parameter in heard {
        let value = state.read(*parameter, now)?;
        all = Some(match (all, spec.of) {
            (None, _) | (_, Of::First) => value,
            (Some(before), Of::Greatest) => before.max(value),
            (Some(before), Of::Sum) => before + value,
        });
    }
    all.ok_or(Invalid::NeverReceived)
}

fn reading(state: &FlightState, spec: &Spec, value: f64) -> Reading {
    // A limit of one tank is none of their sum.
    let has_limits = !matches!(spec.of, Of::Sum);
    let first = spec.parameters.first().filter(|_| has_limits);
    let limit = |kind| first.and_then(|p| state.bounds.get(*p, kind));
    let low = [limit("low-alarm"), limit("low-warning")];
    let high = [limit("high-alarm"), limit("high-warning")];
    let beyond = |i: usize| {
        low[i].is_some_and(|low| value <= low) || high[i].is_some_and(|high| value >= high)
    };
    let level = if beyond(0) {
        Level::Warning
    } else if beyond(1) {
        Level::Caution
    } else {
        Level::Normal
    };
    let bar = limit("minimum")
        .zip(limit("maximum"))
        .filter(|(a, b)| a < b);
    let bar = bar.map(|(from, to)| {
        let on = |x: f64| ((x - from) / (to - from)).clamp(0.0, 1.0);
        Bar {
            value: on(value),
            low: low.map(|x| x.map(on)),
            high: high.map(|x| x.map(on)),
        }
    });
    Reading {
        text: format::fixed(value * spec.scale + spec.offset, spec.decimals),
        level,
        bar,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampled::Sampled;
    use crate::signal::{Limit, SourceId};

    const NOW: Monotonic = Monotonic::from_nanos(10_000_000_000);

    fn running() -> FlightState {
        let mut state = FlightState::empty();
        for (p, value) in [
            (P::EngineSpeed, 2405.0),
            (P::ManifoldPressure, 846.6),
            (P::OilPressure, 4100.0),
            (P::CylinderHeadTemperature1, 273.15 + 140.0),
            (P::CylinderHeadTemperature4, 273.15 + 171.0),
            (P::FuelQuantity1, 40.2),
            (P::FuelQuantity2, 38.2),
        ] {
            state.set(p, Sampled::good(value, NOW), SourceId(0));
        }
        state
    }

    fn reads(engine: &Engine, name: &str) -> Result<Reading, Invalid> {
        let gauge = engine.iter().find(|g| g.name == name);
        gauge.map_or(Err(Invalid::Doubtful), |g| g.reading)
    }

    #[test]
    fn a_strip_is_there_once_an_engine_was_heard_and_shows_the_hottest_and_the_sum() {
        let mut battery = FlightState::empty();
        battery.set(P::BusVoltage1, Sampled::good(12.0, NOW), SourceId(0));
        assert!(
            engine(&battery, BaroUnit::Hectopascals, NOW).is_empty(),
            "no engine"
        );
        for (unit, manifold, oil) in [
            (BaroUnit::Hectopascals, "847", "4.1"),
            // 846.6 hPa is 25.0 inHg, 4100 hPa is 59.5 psi.
            (BaroUnit::InchesOfMercury, "25.0", "59"),
        ] {
            let engine = engine(&running(), unit, NOW);
            let text = |name| reads(&engine, name).map(|r| r.text.to_string());
            assert_eq!(text("MAP").as_deref(), Ok(manifold));
            assert_eq!(text("OIL P").as_deref(), Ok(oil));
            assert_eq!(text("CHT").as_deref(), Ok("171"), "the hottest");
            assert_eq!(text("FUEL").as_deref(), Ok("78"), "the sum");
            assert_eq!(text("EGT"), Err(Invalid::NeverReceived));
        }
    }

    #[test]
    fn one_cylinder_that_fails_is_not_hidden_by_the_others() {
        let mut state = running();
        let failed = Sampled::fault(Invalid::SourceFailed, NOW);
        state.set(P::CylinderHeadTemperature4, failed, SourceId(0));
        let engine = engine(&state, BaroUnit::Hectopascals, NOW);
        assert_eq!(reads(&engine, "CHT"), Err(Invalid::SourceFailed));
    }

    #[test]
    fn limits_of_the_bus_colour_the_reading_and_make_a_scale() {
        let mut state = running();
        for (kind, value) in [
            ("minimum", 0.0),
            ("low-alarm", 1000.0),
            ("low-warning", 2000.0),
            ("high-warning", 5000.0),
            ("high-alarm", 6000.0),
            ("maximum", 8000.0),
        ] {
            let limit = Limit {
                at: NOW,
                source: SourceId(0),
                parameter: P::OilPressure,
                kind,
                value,
            };
            state.bounds.take(&limit, |_| 0);
        }
        for (hpa, level) in [
            (900.0, Level::Warning),
            (1900.0, Level::Caution),
            (4100.0, Level::Normal),
            (5000.0, Level::Caution),
            (6100.0, Level::Warning),
        ] {
            state.set(P::OilPressure, Sampled::good(hpa, NOW), SourceId(0));
            let engine = engine(&state, BaroUnit::Hectopascals, NOW);
            let reading = reads(&engine, "OIL P");
            assert_eq!(reading.map(|r| r.level), Ok(level), "{hpa}");
            let bar = reading.ok().and_then(|r| r.bar);
            let bar = bar.unwrap_or_else(|| unreachable!("both ends are known"));
            assert!((bar.value - hpa / 8000.0).abs() < 1e-12, "{bar:?}");
            assert_eq!(bar.high, [Some(0.75), Some(0.625)]);
        }
    }
}
