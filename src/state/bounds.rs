//! Bounds of parameters that a bus gives: of each kind one, the most trusted source's.
//!
//! A bound is a constant of the aircraft: it has no age, and stays when its sender falls silent.

use crate::limits::LIMITS_HEARD_MAX;
use crate::signal::{Limit, Parameter, SourceId};

/// Bounds at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    rows: [Option<Limit>; LIMITS_HEARD_MAX],
}

impl Bounds {
    /// None heard of.
    pub const NONE: Self = Self {
        rows: [None; LIMITS_HEARD_MAX],
    };

    /// Takes a bound in; one of the same kind stays if its source is trusted more. What does not fit is left.
    pub fn take(&mut self, limit: &Limit, trust: impl Fn(SourceId) -> usize) {
        let is_same = |row: &Option<Limit>| {
            row.is_some_and(|l| l.parameter == limit.parameter && l.kind == limit.kind)
        };
        let same = self.rows.iter().position(is_same);
        let free = || self.rows.iter().position(Option::is_none);
        let Some(row) = same.or_else(free).and_then(|i| self.rows.get_mut(i)) else {
            return;
        };
        if row.is_none_or(|known| trust(limit.source) <= trust(known.source)) {
            *row = Some(*limit);
        }
    }

    /// The bound of `parameter` of this kind (see [`Limit::kind`]), in the unit of the parameter.
    #[must_use]
    pub fn get(&self, parameter: Parameter, kind: &str) -> Option<f64> {
        let of = |l: &&Limit| l.parameter == parameter && l.kind == kind;
        self.rows.iter().flatten().find(of).map(|l| l.value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::Monotonic;

    fn vne(source: u8, value: f64) -> Limit {
        Limit {
            at: Monotonic::from_nanos(1),
            source: SourceId(source),
            parameter: Parameter::IndicatedAirspeed,
            kind: "vne",
            value,
        }
    }

    #[test]
    fn the_more_trusted_source_has_its_way_in_either_order() {
        let trust = |source: SourceId| usize::from(source.0);
        for order in [[0, 1], [1, 0]] {
            let mut bounds = Bounds::NONE;
            for source in order {
                bounds.take(&vne(source, f64::from(source) + 60.0), trust);
            }
            let got = bounds.get(Parameter::IndicatedAirspeed, "vne");
            assert_eq!(got, Some(60.0), "{order:?}");
        }
        let mut bounds = Bounds::NONE;
        bounds.take(&vne(0, 60.0), trust);
        bounds.take(&vne(0, 65.0), trust);
        let got = bounds.get(Parameter::IndicatedAirspeed, "vne");
        assert_eq!(got, Some(65.0), "its own newer word");
        assert_eq!(bounds.get(Parameter::IndicatedAirspeed, "vno"), None);
        assert_eq!(bounds.get(Parameter::Pitch, "vne"), None);
    }
}
