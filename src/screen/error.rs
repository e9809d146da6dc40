//! What can go wrong with a screen, worded for the person who has to put it right.

use std::borrow::Cow;
use std::fmt;
use std::io;

/// A screen could not be opened, or no longer shows what it is given. Displayed as `DEVICE: WHY (WHAT TO DO)`.
#[derive(Debug)]
pub enum ScreenError {
    /// A library of the system is missing.
    Library {
        /// The file looked for, as in `libEGL.so.1`.
        library: &'static str,
        /// The dynamic linker's words.
        why: String,
        /// The Debian packages that have it.
        package: &'static str,
    },
    /// The GL driver refused.
    Driver {
        /// `EGL surfaceless`, `EGL on /dev/dri/card0`, `OSMesa`.
        platform: String,
        /// What we were doing.
        doing: &'static str,
        /// The driver's words.
        why: String,
    },
    /// No display controller with a connected screen was found.
    NoDisplay {
        /// Each device tried and why not, or a word that there is none.
        tried: String,
    },
    /// The configuration asks for something this display does not have.
    Wish {
        /// The device, as in `/dev/dri/card0`.
        device: String,
        /// What is asked for and not there.
        why: String,
        /// What there is instead.
        offered: String,
    },
    /// Another program shows on the display.
    Held {
        /// The device, as in `/dev/dri/card0`.
        device: String,
        /// What we were doing when we learnt it.
        doing: &'static str,
        /// The kernel's words.
        source: io::Error,
    },
    /// The device exists and may not be opened by this user.
    Denied {
        /// The device, as in `/dev/dri/card0`.
        device: String,
        /// The kernel's words.
        source: io::Error,
    },
    /// The display controller refused.
    Device {
        /// The device, as in `/dev/dri/card0`.
        device: String,
        /// What we were doing.
        doing: &'static str,
        /// The kernel's words.
        source: io::Error,
    },
    /// A frame was handed over and the controller never said that it shows. Whether the picture on the glass still
    /// changes is unknown.
    FlipOverdue {
        /// The device, as in `/dev/dri/card0`.
        device: String,
        /// How long we waited, ms.
        waited_ms: u64,
    },
}

impl ScreenError {
    /// The library or device concerned.
    #[must_use]
    pub fn device(&self) -> &str {
        match self {
            Self::Library { library, .. } => library,
            Self::Driver { platform, .. } => platform,
            Self::NoDisplay { .. } => "/dev/dri",
            Self::Wish { device, .. }
            | Self::Held { device, .. }
            | Self::Denied { device, .. }
            | Self::Device { device, .. }
            | Self::FlipOverdue { device, .. } => device,
        }
    }

    /// What is wrong with it.
    #[must_use]
    pub fn why(&self) -> Cow<'_, str> {
        match self {
            Self::Library { why, .. } => format!("cannot be loaded: {why}").into(),
            Self::Driver { doing, why, .. } => format!("{doing}: {why}").into(),
            Self::NoDisplay { tried } => format!("no connected display: {tried}").into(),
            Self::Wish { why, .. } => why.into(),
            Self::Held { doing, source, .. } => {
                format!("another program holds the display ({doing}: {source})").into()
            }
            Self::Denied { source, .. } => format!("may not be opened: {source}").into(),
            Self::Device { doing, source, .. } => format!("{doing}: {source}").into(),
            Self::FlipOverdue { waited_ms, .. } => {
                format!("a frame handed over {waited_ms} ms ago is still not shown").into()
            }
        }
    }

    /// What the user can do.
    #[must_use]
    pub fn remedy(&self) -> Cow<'_, str> {
        match self {
            Self::Library { package, .. } => format!("install it: apt install {package}").into(),
            Self::Driver { .. } => {
                "check the GPU driver: apt install libegl-mesa0 libgl1-mesa-dri".into()
            }
            Self::NoDisplay { .. } => {
                "connect a screen, or choose a headless screen; `glasswing list` shows what there is"
                    .into()
            }
            Self::Wish { offered, .. } => offered.into(),
            Self::Held { .. } => {
                "stop it (systemctl stop display-manager) or switch to a free VT".into()
            }
            Self::Denied { .. } => "add the user to the group video: adduser USER video".into(),
            Self::Device { .. } => "see the kernel's log: journalctl -k".into(),
            Self::FlipOverdue { .. } => {
                "the display controller hangs: restart the program; see journalctl -k".into()
            }
        }
    }

    /// Is it the configuration that has to change (rather than a device or the system)?
    #[must_use]
    pub const fn is_configuration(&self) -> bool {
        matches!(self, Self::Wish { .. })
    }
}

impl fmt::Display for ScreenError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {} ({})", self.device(), self.why(), self.remedy())
    }
}

impl std::error::Error for ScreenError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Held { source, .. }
            | Self::Denied { source, .. }
            | Self::Device { source, .. } => Some(source),
            Self::Library { .. }
            | Self::Driver { .. }
            | Self::NoDisplay { .. }
            | Self::Wish { .. }
            | Self::FlipOverdue { .. } => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_held_display_says_who_to_stop() {
        let error = ScreenError::Held {
            device: "/dev/dri/card0".into(),
            doing: "taking control",
            source: io::Error::from_raw_os_error(16),
        };
        let line = error.to_string();
        assert!(
            line.starts_with("/dev/dri/card0: another program holds"),
            "{line}"
        );
        assert!(line.contains("systemctl stop display-manager"), "{line}");
        assert!(!line.contains('\n'), "{line}");
    }
}
