//! Faults: what can go wrong with a sensor, its wire or its bus, when, and with which parameter.
//!
//! On a command line a fault is `KIND@SECONDS[-SECONDS][:PARAMETER]`: from the first time until the second, or for good; of
//! one parameter, or of all that the protocol carries and that can have it.

use super::encode::Encoder;
use crate::signal::Parameter;
use std::time::Duration;

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// Nothing more is sent; of one parameter: its message, or its field, has no value any more.
    Stop,
    /// Values stay what they were; frames keep coming and keep counting.
    Freeze,
    /// Values are off by a tenth of their parameter's range, within it.
    Jump,
    /// NaN.
    Nan,
    /// The protocol's own way to say that there is no value.
    Sentinel,
    /// A number that the parameter cannot have.
    OutOfRange,
    /// Evenly distributed noise of up to a hundredth of the parameter's range either way.
    Noise,
    /// One bit of one frame in four is turned over.
    BitFlips,
    /// Every frame comes twice.
    Duplicates,
    /// Of each message, every two successive frames change places.
    Reordering,
    /// Another sender fills the bus, all of it.
    Babble,
    /// The frames bear another node's number.
    WrongNode,
    /// The controller has left the bus.
    BusOff,
}

impl Kind {
    /// All of them.
    pub const ALL: [Self; 13] = [
        Self::Stop,
        Self::Freeze,
        Self::Jump,
        Self::Nan,
        Self::Sentinel,
        Self::OutOfRange,
        Self::Noise,
        Self::BitFlips,
        Self::Duplicates,
        Self::Reordering,
        Self::Babble,
        Self::WrongNode,
        Self::BusOff,
    ];

    /// The name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Stop => "stop",
            Self::Freeze => "freeze",
            Self::Jump => "jump",
            Self::Nan => "nan",
            Self::Sentinel => "sentinel",
            Self::OutOfRange => "out-of-range",
            Self::Noise => "noise",
            Self::BitFlips => "bit-flips",
            Self::Duplicates => "duplicates",
            Self::Reordering => "reordering",
            Self::Babble => "babble",
            Self::WrongNode => "wrong-node",
            Self::BusOff => "bus-off",
        }
    }

    /// Whether it happens to values, so that it may be one parameter's.
    #[must_use]
    pub const fn is_of_values(self) -> bool {
        matches!(
            self,
            Self::Stop
                | Self::Freeze
                | Self::Jump
                | Self::Nan
                | Self::Sentinel
                | Self::OutOfRange
                | Self::Noise
        )
    }

    /// Whether `encoder`'s protocol can say this of `parameter`.
    #[must_use]
    pub fn is_possible(self, encoder: &dyn Encoder, parameter: Parameter) -> bool {
        encoder
            .carries(parameter)
            .is_some_and(|carried| match self {
                Self::Nan => carried.nan,
                Self::Sentinel => carried.absent,
                Self::OutOfRange => carried.impossible(parameter).is_some(),
                Self::Jump => carried.resolution < jump_of(parameter),
                Self::Noise => carried.resolution < noise_of(parameter),
                _ => true,
            })
    }
}

/// How far a jump goes.
pub(super) fn jump_of(parameter: Parameter) -> f64 {
    let spec = parameter.spec();
    (spec.max - spec.min) * 0.1
}

/// How far noise goes.
pub(super) fn noise_of(parameter: Parameter) -> f64 {
    let spec = parameter.spec();
    (spec.max - spec.min) * 0.01
}

/// One thing that goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fault {
    /// What.
    pub kind: Kind,
    /// From when, after the start.
    pub begin: Duration,
    /// Until when; None for good.
    pub end: Option<Duration>,
    /// Of one parameter; None of all.
    pub parameter: Option<Parameter>,
}

/// Why there can be no such fault; [`FaultError::todo`] says what to do about it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FaultError {
    /// Not of the form.
    #[error("is not KIND@SECONDS[-SECONDS][:PARAMETER]")]
    Form,
    /// No kind of this name.
    #[error("there is no kind {0:?}")]
    Kind(String),
    /// Not a number of seconds.
    #[error("{0:?} is not a number of seconds from 0 to 1000000")]
    Seconds(String),
    /// It ends before it begins.
    #[error("it ends before it begins")]
    Backwards,
    /// No parameter of this name.
    #[error("there is no parameter {0:?}")]
    Parameter(String),
    /// It is not one parameter's.
    #[error("{0} happens to whole frames, not to a parameter")]
    Whole(&'static str),
    /// The protocol does not carry the parameter.
    #[error("the protocol does not carry {0}")]
    NotCarried(&'static str),
    /// The protocol cannot say it of this parameter.
    #[error("the protocol cannot say {0} of {1}")]
    CannotSay(&'static str, &'static str),
    /// The protocol cannot say it of any parameter.
    #[error("the protocol cannot say {0} of anything")]
    CannotSayAtAll(&'static str),
    /// Only on a CAN bus.
    #[error("{0} is a fault of CAN buses, which this protocol is not on")]
    NotCan(&'static str),
}

impl FaultError {
    /// What the user can do.
    #[must_use]
    pub fn todo(&self) -> String {
        match self {
            Self::Form | Self::Seconds(_) | Self::Backwards => {
                "as in stop@10, nan@5-8:pitch_rad".to_owned()
            }
            Self::Kind(_) => format!("one of {}", Kind::ALL.map(Kind::name).join(", ")),
            Self::Parameter(_) => {
                "as `decode --samples` names them: pitch_rad, indicated_airspeed_mps".to_owned()
            }
            Self::Whole(_) => "leave the parameter out".to_owned(),
            Self::NotCarried(_) => "choose another parameter or protocol".to_owned(),
            Self::CannotSay(..) | Self::CannotSayAtAll(_) => {
                "choose another fault or protocol".to_owned()
            }
            Self::NotCan(_) => "use it with canaerospace or can-fix".to_owned(),
        }
    }
}

impl Fault {
    /// Reads `KIND@SECONDS[-SECONDS][:PARAMETER]`. A parameter is named as in tables and figures, with or without its unit.
    ///
    /// # Errors
    /// Why it is none.
    pub fn parse(text: &str) -> Result<Self, FaultError> {
        let (kind, rest) = text.split_once('@').ok_or(FaultError::Form)?;
        let kind = Kind::ALL
            .into_iter()
            .find(|k| k.name() == kind)
            .ok_or_else(|| FaultError::Kind(kind.to_owned()))?;
        let (times, parameter) = match rest.split_once(':') {
            Some((times, parameter)) => (times, Some(by_name(parameter)?)),
            None => (rest, None),
        };
        let (begin, end) = match times.split_once('-') {
            Some((begin, end)) => (seconds(begin)?, Some(seconds(end)?)),
            None => (seconds(times)?, None),
        };
        if end.is_some_and(|end| end <= begin) {
            return Err(FaultError::Backwards);
        }
        if parameter.is_some() && !kind.is_of_values() {
            return Err(FaultError::Whole(kind.name()));
        }
        Ok(Self {
            kind,
            begin,
            end,
            parameter,
        })
    }

    /// Whether it is there at `t` after the start.
    #[must_use]
    pub fn is_active(&self, t: Duration) -> bool {
        t >= self.begin && self.end.is_none_or(|end| t < end)
    }

    /// Whether `encoder` can have it.
    ///
    /// # Errors
    /// Why it cannot.
    pub fn check(&self, encoder: &dyn Encoder) -> Result<(), FaultError> {
        let kind = self.kind;
        if matches!(kind, Kind::WrongNode | Kind::BusOff) && !encoder.is_on_can() {
            return Err(FaultError::NotCan(kind.name()));
        }
        match self.parameter {
            _ if !kind.is_of_values() => Ok(()),
            Some(parameter) if encoder.carries(parameter).is_none() => {
                Err(FaultError::NotCarried(parameter.spec().name))
            }
            Some(parameter) if !kind.is_possible(encoder, parameter) => {
                Err(FaultError::CannotSay(kind.name(), parameter.spec().name))
            }
            None if self.parameters(encoder).next().is_none() => {
                Err(FaultError::CannotSayAtAll(kind.name()))
            }
            _ => Ok(()),
        }
    }

    /// The parameters to which it happens.
    pub fn parameters<'a>(&self, encoder: &'a dyn Encoder) -> impl Iterator<Item = Parameter> + 'a {
        let Self {
            kind, parameter, ..
        } = *self;
        let all = Parameter::ALL.iter().copied();
        all.filter(move |p| parameter.is_none_or(|one| one == *p))
            .filter(move |p| kind.is_of_values() && kind.is_possible(encoder, *p))
    }
}

fn seconds(text: &str) -> Result<Duration, FaultError> {
    text.parse::<f64>()
        .ok()
        .filter(|s| (0.0..=1e6).contains(s))
        .map(Duration::from_secs_f64)
        .ok_or_else(|| FaultError::Seconds(text.to_owned()))
}

/// A parameter by its name, with or without the unit that it ends with.
fn by_name(text: &str) -> Result<Parameter, FaultError> {
    let name = text.replace('-', "_");
    let is_named = |p: &&Parameter| {
        let whole = p.spec().name;
        whole == name
            || whole
                .rsplit_once('_')
                .is_some_and(|(short, _)| short == name)
    };
    let found = Parameter::ALL.iter().find(is_named).copied();
    found.ok_or_else(|| FaultError::Parameter(text.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::encode::encoder;
    use crate::proto::Protocol;

    #[test]
    fn faults_are_read_or_refused_by_name() {
        assert_eq!(
            Fault::parse("nan@5.5-8:pitch"),
            Ok(Fault {
                kind: Kind::Nan,
                begin: Duration::from_millis(5500),
                end: Some(Duration::from_secs(8)),
                parameter: Some(Parameter::Pitch),
            })
        );
        for (text, why) in [
            ("nan", FaultError::Form),
            ("nun@5", FaultError::Kind("nun".into())),
            ("nan@", FaultError::Seconds(String::new())),
            ("nan@inf", FaultError::Seconds("inf".into())),
            ("nan@-3", FaultError::Seconds(String::new())),
            ("nan@5-5", FaultError::Backwards),
            ("nan@5:pich", FaultError::Parameter("pich".into())),
            ("babble@5:pitch", FaultError::Whole("babble")),
        ] {
            assert_eq!(Fault::parse(text), Err(why), "{text}");
        }
    }

    #[test]
    fn what_a_protocol_cannot_do_is_named() {
        for (protocol, text, why) in [
            (
                Protocol::Ubx,
                "stop@1:pitch",
                FaultError::NotCarried("pitch_rad"),
            ),
            (
                Protocol::DynonSkyView,
                "nan@1:pitch",
                FaultError::CannotSay("nan", "pitch_rad"),
            ),
            (
                Protocol::DynonD100,
                "sentinel@1",
                FaultError::CannotSayAtAll("sentinel"),
            ),
            (Protocol::Nmea, "bus-off@1", FaultError::NotCan("bus-off")),
            (
                Protocol::Gdl90,
                "wrong-node@1",
                FaultError::NotCan("wrong-node"),
            ),
            (
                Protocol::Gdl90,
                "out-of-range@1:track",
                FaultError::CannotSay("out-of-range", "track_rad"),
            ),
        ] {
            let fault = Fault::parse(text).expect("a fault");
            let encoder = encoder(protocol);
            assert_eq!(fault.check(encoder.as_ref()), Err(why), "{text}");
        }
    }
}
