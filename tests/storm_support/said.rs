//! What bytes say by an independent reading of the published layouts: nothing here is shared with the decoders.

use glasswing::signal::Parameter;

pub(crate) const FOOT: f64 = 0.3048;
pub(crate) const KNOT: f64 = 1852.0 / 3600.0;
pub(crate) const FPM: f64 = FOOT / 60.0;
/// Of mercury at 0 degrees Celsius, hPa.
pub(crate) const INCH_HG: f64 = 33.863_886_666_7;
pub(crate) const GALLON: f64 = 3.785_411_784;
pub(crate) const PSI: f64 = 68.947_572_931_683_6;

/// What frames say of parameters: a number in the parameter's unit, or that there is none.
#[derive(Debug, Default)]
pub(crate) struct Said {
    entries: Vec<(Parameter, Option<f64>)>,
}

impl Said {
    pub(crate) fn clear(&mut self) {
        self.entries.clear();
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    pub(crate) fn put(&mut self, parameter: Parameter, value: Option<f64>) {
        self.entries
            .push((parameter, value.filter(|x| x.is_finite())));
    }

    /// In degrees on the wire.
    pub(crate) fn degrees(&mut self, parameter: Parameter, value: Option<f64>) {
        self.put(parameter, value.map(f64::to_radians));
    }

    /// A direction in degrees, 0 to 360; anything else is none.
    pub(crate) fn compass(&mut self, parameter: Parameter, value: Option<f64>) {
        let direction = value.filter(|x| (0.0..=360.0).contains(x));
        self.degrees(parameter, direction);
    }

    /// Whether anything was said of a parameter.
    pub(crate) fn mentions(&self, parameter: Parameter) -> bool {
        self.entries.iter().any(|(p, _)| *p == parameter)
    }

    /// Whether some frame gives a parameter this value.
    pub(crate) fn has(&self, parameter: Parameter, value: f64) -> bool {
        let tolerance = 1e-9 * value.abs().max(1.0);
        let same = |x: f64| {
            let apart = (x - value).abs();
            // North is at both ends of the scale.
            apart <= tolerance || (apart - std::f64::consts::TAU).abs() <= tolerance
        };
        self.entries
            .iter()
            .any(|(p, x)| *p == parameter && x.is_some_and(same))
    }
}
