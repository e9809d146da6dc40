//! What a board file may ask of a display: plain data, parsed from text.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// What to show on. Everything left out is chosen: the first card with a connected connector, its preferred mode.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Wishes {
    /// The card's device file, as in `/dev/dri/card1`.
    pub card: Option<PathBuf>,
    /// The connector's name as the kernel spells it, as in `HDMI-A-1` or `DSI-1`.
    pub connector: Option<String>,
    /// The mode.
    pub mode: Option<ModeWish>,
}

/// A mode asked for: `1024x600` or `1024x600@59.94`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModeWish {
    /// Width in pixels.
    pub width: u16,
    /// Height in pixels.
    pub height: u16,
    /// Refresh rate in Hz; matched within half a hertz.
    pub refresh_hz: Option<f64>,
}

/// A text that is no mode.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{0}` is no mode: write WIDTHxHEIGHT or WIDTHxHEIGHT@HZ, as in 1024x600 or 1280x800@59.94"
)]
pub struct NoMode(pub String);

impl FromStr for ModeWish {
    type Err = NoMode;

    fn from_str(text: &str) -> Result<Self, NoMode> {
        let wish = || {
            let (size, refresh) = match text.split_once('@') {
                Some((size, refresh)) => (size, Some(refresh.parse::<f64>().ok()?)),
                None => (text, None),
            };
            let (width, height) = size.split_once('x')?;
            let (width, height) = (width.parse::<u16>().ok()?, height.parse::<u16>().ok()?);
            let possible = width > 0 && height > 0;
            let plausible = refresh.is_none_or(|hz| hz.is_finite() && (1.0..=1000.0).contains(&hz));
            (possible && plausible).then_some(Self {
                width,
                height,
                refresh_hz: refresh,
            })
        };
        wish().ok_or_else(|| NoMode(text.to_owned()))
    }
}

impl fmt::Display for ModeWish {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.width, self.height)?;
        match self.refresh_hz {
            Some(hz) => write!(f, "@{hz}"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_are_read_with_and_without_a_rate() {
        let plain: ModeWish = "1024x600".parse().unwrap();
        assert_eq!(
            (plain.width, plain.height, plain.refresh_hz),
            (1024, 600, None)
        );
        let rated: ModeWish = "1280x800@59.94".parse().unwrap();
        assert_eq!(rated.refresh_hz, Some(59.94));
        assert_eq!(rated.to_string(), "1280x800@59.94");
    }

    #[test]
    fn what_is_no_mode_is_refused_and_quoted() {
        for text in [
            "",
            "1024",
            "1024x",
            "x600",
            "0x600",
            "1024x600@",
            "1024x600@NaN",
            "1024x600@-60",
            "-1x5",
            "70000x600",
        ] {
            let error = text.parse::<ModeWish>().unwrap_err();
            assert!(error.to_string().contains(&format!("`{text}`")), "{error}");
        }
    }
}
