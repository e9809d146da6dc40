//! Which connector, mode, CRTC and plane to use: a pure function of what the card says and what the board wishes.
//!
//! A *connector* is a socket or a panel; a *CRTC* reads pictures and makes the timing; a *plane* is one picture a CRTC
//! reads. Masks say which go together: bit n stands for the card's n-th CRTC. Source: the kernel's documentation,
//! `gpu/drm-kms.rst`.

use crate::screen::wishes::{ModeWish, Wishes};

/// Is something plugged in?
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Link {
    /// Yes.
    Connected,
    /// No.
    Disconnected,
    /// The driver cannot tell. Some panels never can; with modes, they count as connected when nothing else is.
    Unknown,
}

/// One way to drive a display.
#[derive(Clone, Debug, PartialEq)]
pub struct Mode {
    /// Width in pixels.
    pub width: u16,
    /// Height in pixels.
    pub height: u16,
    /// Refresh rate in Hz.
    pub refresh_hz: f64,
    /// Does the display call it its own?
    pub preferred: bool,
    /// Is it interlaced? Such modes are used only where there is no other.
    pub interlaced: bool,
}

/// A socket or panel of a card.
#[derive(Clone, Debug, PartialEq)]
pub struct Connector {
    /// The kernel's number for it.
    pub id: u32,
    /// The kernel's name for it, as in `HDMI-A-1`.
    pub name: String,
    /// Is something plugged in?
    pub link: Link,
    /// What it offers, in the kernel's order.
    pub modes: Vec<Mode>,
    /// The CRTCs it can be driven by, as a mask.
    pub crtcs: u32,
    /// The CRTC that drives it now.
    pub driven_by: Option<u32>,
}

/// A picture a CRTC can read, of the primary kind and in the format XRGB8888.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane {
    /// The kernel's number for it.
    pub id: u32,
    /// The CRTCs it can belong to, as a mask.
    pub crtcs: u32,
}

/// What a card says.
#[derive(Clone, Debug, PartialEq)]
pub struct Display {
    /// The kernel's numbers for the CRTCs, in the order of the masks' bits.
    pub crtcs: Vec<u32>,
    /// Sockets and panels, in the kernel's order.
    pub connectors: Vec<Connector>,
    /// Primary planes. Empty where the driver knows none (drivers without atomic modesetting).
    pub planes: Vec<Plane>,
}

/// What to use.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// Index into [`Display::connectors`].
    pub connector: usize,
    /// Index into that connector's modes.
    pub mode: usize,
    /// The kernel's number of the CRTC.
    pub crtc: u32,
    /// The kernel's number of the primary plane, where there is one.
    pub plane: Option<u32>,
}

/// Why nothing suits.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unsuitable {
    /// The card has no connectors: it only renders.
    #[error("it drives no displays")]
    NoConnectors,
    /// Nothing is plugged in.
    #[error("nothing is connected to {have}")]
    NoneConnected {
        /// The connectors there are.
        have: String,
    },
    /// No connector of that name.
    #[error("it has no connector {name}, only {have}")]
    UnknownConnector {
        /// The name wished for.
        name: String,
        /// The connectors there are.
        have: String,
    },
    /// Nothing is plugged into the connector wished for.
    #[error("nothing is connected to {name}")]
    Disconnected {
        /// The name wished for.
        name: String,
    },
    /// The display does not offer the mode.
    #[error("{connector} does not offer {wish}")]
    NoMode {
        /// The connector.
        connector: String,
        /// The mode wished for, or a word for any.
        wish: String,
        /// What it offers.
        offered: String,
    },
    /// Nothing can drive the connector.
    #[error("no CRTC can drive {connector}")]
    NoCrtc {
        /// The connector.
        connector: String,
    },
}

/// Chooses. Among equals the kernel's order decides.
///
/// # Errors
/// [`Unsuitable`] names what is missing.
pub fn choose(display: &Display, wishes: &Wishes) -> Result<Choice, Unsuitable> {
    let connector = choose_connector(display, wishes.connector.as_deref())?;
    let chosen = &display.connectors[connector];
    let mode = choose_mode(chosen, wishes.mode)?;
    let crtc = choose_crtc(display, connector)?;
    let plane = display
        .planes
        .iter()
        .find(|plane| plane.crtcs & bit(crtc) != 0)
        .map(|plane| plane.id);
    Ok(Choice {
        connector,
        mode,
        crtc: display.crtcs[crtc],
        plane,
    })
}

fn choose_connector(display: &Display, wished: Option<&str>) -> Result<usize, Unsuitable> {
    let all = &display.connectors;
    let have = || {
        let names: Vec<&str> = all.iter().map(|c| c.name.as_str()).collect();
        names.join(", ")
    };
    if all.is_empty() {
        return Err(Unsuitable::NoConnectors);
    }
    let usable = |c: &Connector, link| c.link == link && !c.modes.is_empty();
    if let Some(name) = wished {
        let at = all
            .iter()
            .position(|c| c.name.eq_ignore_ascii_case(name))
            .ok_or_else(|| Unsuitable::UnknownConnector {
                name: name.to_owned(),
                have: have(),
            })?;
        if all[at].link == Link::Disconnected {
            return Err(Unsuitable::Disconnected {
                name: all[at].name.clone(),
            });
        }
        return Ok(at);
    }
    all.iter()
        .position(|c| usable(c, Link::Connected))
        .or_else(|| all.iter().position(|c| usable(c, Link::Unknown)))
        .ok_or_else(|| Unsuitable::NoneConnected { have: have() })
}

/// Half a hertz apart counts as the same rate: 59.94 Hz displays are sold as 60.
const SAME_RATE_HZ: f64 = 0.5;

fn choose_mode(connector: &Connector, wish: Option<ModeWish>) -> Result<usize, Unsuitable> {
    let fits = |mode: &Mode| {
        wish.is_none_or(|w| {
            let rate = w
                .refresh_hz
                .is_none_or(|hz| (mode.refresh_hz - hz).abs() <= SAME_RATE_HZ);
            (mode.width, mode.height) == (w.width, w.height) && rate
        })
    };
    // Smaller is better: progressive, near the wished rate, the display's own, large, quick.
    let rank = |mode: &Mode| {
        let off_rate = wish
            .and_then(|w| w.refresh_hz)
            .map_or(0.0, |hz| (mode.refresh_hz - hz).abs());
        let area = f64::from(mode.width) * f64::from(mode.height);
        [
            f64::from(u8::from(mode.interlaced)),
            off_rate,
            f64::from(u8::from(!mode.preferred)),
            -area,
            -mode.refresh_hz,
        ]
    };
    let better = |a: &[f64; 5], b: &[f64; 5]| {
        a.iter()
            .zip(b)
            .map(|(a, b)| a.total_cmp(b))
            .find(|order| order.is_ne())
            .unwrap_or(std::cmp::Ordering::Equal)
    };
    connector
        .modes
        .iter()
        .enumerate()
        .filter(|(_, mode)| fits(mode))
        .min_by(|(_, a), (_, b)| better(&rank(a), &rank(b)))
        .map(|(at, _)| at)
        .ok_or_else(|| Unsuitable::NoMode {
            connector: connector.name.clone(),
            wish: wish.map_or_else(|| "any mode".to_owned(), |w| w.to_string()),
            offered: offered(&connector.modes),
        })
}

/// The modes in words, for messages and lists.
#[must_use]
pub fn offered(modes: &[Mode]) -> String {
    let words: Vec<String> = modes
        .iter()
        .map(|m| {
            let interlaced = if m.interlaced { "i" } else { "" };
            format!("{}x{}{interlaced}@{:.2}", m.width, m.height, m.refresh_hz)
        })
        .collect();
    words.join(", ")
}

/// The CRTC that drives the connector already, else one that drives nothing, else any.
fn choose_crtc(display: &Display, connector: usize) -> Result<usize, Unsuitable> {
    let chosen = &display.connectors[connector];
    let can = |at: &usize| chosen.crtcs & bit(*at) != 0;
    let current = chosen
        .driven_by
        .and_then(|id| display.crtcs.iter().position(|crtc| *crtc == id));
    let is_free = |at: &usize| {
        let id = display.crtcs[*at];
        display
            .connectors
            .iter()
            .all(|other| other.driven_by != Some(id))
    };
    let all = 0..display.crtcs.len();
    current
        .filter(can)
        .or_else(|| all.clone().filter(can).find(is_free))
        .or_else(|| all.clone().find(can))
        .ok_or_else(|| Unsuitable::NoCrtc {
            connector: chosen.name.clone(),
        })
}

/// The mask of the `at`-th CRTC; none beyond the 32nd, which the kernel cannot express either.
fn bit(at: usize) -> u32 {
    u32::try_from(at)
        .ok()
        .and_then(|at| 1_u32.checked_shl(at))
        .unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mode(width: u16, height: u16, refresh_hz: f64, preferred: bool) -> Mode {
        Mode {
            width,
            height,
            refresh_hz,
            preferred,
            interlaced: false,
        }
    }

    fn connector(id: u32, name: &str, link: Link, modes: Vec<Mode>) -> Connector {
        Connector {
            id,
            name: name.into(),
            link,
            modes,
            crtcs: 0b1,
            driven_by: None,
        }
    }

    /// The shape a Raspberry Pi 4 reports with a 1024x600 panel on its second HDMI socket: vc4 has one CRTC per
    /// output path, and both HDMI connectors can use only their own.
    fn raspberry_pi_4() -> Display {
        let panel = vec![
            mode(1920, 1080, 60.0, false),
            mode(1024, 600, 59.99, true),
            Mode {
                interlaced: true,
                ..mode(1920, 1080, 50.0, false)
            },
            mode(1280, 720, 59.94, false),
            mode(1280, 720, 50.0, false),
            mode(1280, 720, 60.0, false),
        ];
        let mut first = connector(33, "HDMI-A-1", Link::Disconnected, Vec::new());
        let mut second = connector(42, "HDMI-A-2", Link::Connected, panel);
        first.crtcs = 0b01000;
        second.crtcs = 0b10000;
        second.driven_by = Some(110);
        Display {
            crtcs: vec![70, 80, 90, 100, 110],
            connectors: vec![first, second],
            planes: vec![
                Plane {
                    id: 60,
                    crtcs: 0b01000,
                },
                Plane {
                    id: 61,
                    crtcs: 0b10000,
                },
            ],
        }
    }

    fn wish(connector: Option<&str>, mode: Option<&str>) -> Wishes {
        Wishes {
            card: None,
            connector: connector.map(Into::into),
            mode: mode.map(|m| m.parse().unwrap()),
        }
    }

    #[test]
    fn without_wishes_the_connected_display_gets_its_own_mode() {
        let choice = choose(&raspberry_pi_4(), &Wishes::default()).unwrap();
        let expected = Choice {
            connector: 1,
            mode: 1,
            crtc: 110,
            plane: Some(61),
        };
        assert_eq!(choice, expected);
    }

    #[test]
    fn a_wished_size_takes_the_highest_rate_and_never_interlaced() {
        let display = raspberry_pi_4();
        let choice = choose(&display, &wish(None, Some("1280x720"))).unwrap();
        assert_eq!(choice.mode, 5);
        let choice = choose(&display, &wish(None, Some("1920x1080"))).unwrap();
        assert_eq!(choice.mode, 0);
    }

    #[test]
    fn a_wished_rate_takes_the_nearest_within_half_a_hertz() {
        let display = raspberry_pi_4();
        let at = |text| choose(&display, &wish(None, Some(text))).map(|c| c.mode);
        assert_eq!(at("1280x720@59.94"), Ok(3));
        assert_eq!(at("1280x720@50"), Ok(4));
        assert_eq!(at("1024x600@60"), Ok(1));
        let error = at("1280x720@75").unwrap_err();
        assert!(
            matches!(&error, Unsuitable::NoMode { offered, .. } if offered.contains("1280x720@59.94")),
            "{error:?}"
        );
    }

    #[test]
    fn a_wished_connector_must_exist_and_be_connected() {
        let display = raspberry_pi_4();
        assert_eq!(
            choose(&display, &wish(Some("HDMI-A-1"), None)),
            Err(Unsuitable::Disconnected {
                name: "HDMI-A-1".into()
            })
        );
        let error = choose(&display, &wish(Some("DSI-1"), None)).unwrap_err();
        assert_eq!(
            error.to_string(),
            "it has no connector DSI-1, only HDMI-A-1, HDMI-A-2"
        );
        assert!(choose(&display, &wish(Some("hdmi-a-2"), None)).is_ok());
    }

    #[test]
    fn a_panel_that_cannot_tell_counts_only_when_nothing_is_connected() {
        let modes = vec![mode(800, 480, 60.0, false)];
        let mut display = Display {
            crtcs: vec![7],
            connectors: vec![
                connector(1, "DPI-1", Link::Unknown, modes.clone()),
                connector(2, "HDMI-A-1", Link::Connected, modes),
            ],
            planes: Vec::new(),
        };
        assert_eq!(choose(&display, &Wishes::default()).unwrap().connector, 1);
        display.connectors[1].link = Link::Disconnected;
        let choice = choose(&display, &Wishes::default()).unwrap();
        assert_eq!((choice.connector, choice.plane), (0, None));
        display.connectors[0].modes.clear();
        assert_eq!(
            choose(&display, &Wishes::default()),
            Err(Unsuitable::NoneConnected {
                have: "DPI-1, HDMI-A-1".into()
            })
        );
    }

    #[test]
    fn a_crtc_that_drives_another_display_is_the_last_resort() {
        let modes = vec![mode(1024, 768, 60.0, true)];
        let mut busy = connector(1, "eDP-1", Link::Connected, modes.clone());
        busy.driven_by = Some(50);
        let mut free = connector(2, "DP-1", Link::Connected, modes);
        free.crtcs = 0b11;
        let mut display = Display {
            crtcs: vec![50, 51],
            connectors: vec![busy, free],
            planes: Vec::new(),
        };
        let wishes = wish(Some("DP-1"), None);
        assert_eq!(choose(&display, &wishes).unwrap().crtc, 51);
        display.connectors[1].crtcs = 0b01;
        assert_eq!(choose(&display, &wishes).unwrap().crtc, 50);
        display.connectors[1].crtcs = 0;
        assert_eq!(
            choose(&display, &wishes),
            Err(Unsuitable::NoCrtc {
                connector: "DP-1".into()
            })
        );
    }

    #[test]
    fn a_card_that_only_renders_says_so() {
        // v3d of a Raspberry Pi: a card without connectors.
        let display = Display {
            crtcs: Vec::new(),
            connectors: Vec::new(),
            planes: Vec::new(),
        };
        assert_eq!(
            choose(&display, &Wishes::default()),
            Err(Unsuitable::NoConnectors)
        );
    }
}
