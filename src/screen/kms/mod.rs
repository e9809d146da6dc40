//! The display controller itself: KMS, through DRM and GBM, without any window system.
//!
//! [`open`] finds a card with a connected display, takes control of it, sets the mode and shows black. From then on
//! `present` hands over what was drawn into the window target and returns when it is on the glass, so the display paces
//! the frame loop, and the time of the [`Flip`] is when the frame became visible. Displays that report no refreshes
//! (virtual ones) are paced by a timer at the mode's rate.
//!
//! A flip that is not reported in time ends `present` with an error, never with a hang; calling `present` again is
//! allowed and succeeds if the display has come back.

mod card;
pub mod choose;
mod flip;
mod pace;
mod scanout;

use std::ffi::{CStr, c_void};
use std::path::Path;

use rustix::thread::{ClockId, clock_nanosleep_absolute};
use rustix::time::Timespec;

use card::Card;
use choose::{Display, Unsuitable, choose};
use pace::Pacer;
use scanout::Scanout;

use super::{Flip, Screen, ScreenError, Wishes};
use crate::time::Monotonic;

/// A lit display.
#[derive(Debug)]
pub struct Kms {
    scanout: Scanout,
    pacer: Pacer,
    presented: u64,
    description: String,
}

/// Opens the display wished for, or the first card that has a connected one which nobody holds.
///
/// # Errors
/// [`ScreenError`]: no connected display, one that another program holds, a wish that cannot be met, a driver or device
/// that refuses.
pub fn open(wishes: &Wishes) -> Result<Kms, ScreenError> {
    let candidates = match &wishes.card {
        Some(path) => vec![path.clone()],
        None => Card::paths(),
    };
    let mut failures = Vec::new();
    for path in &candidates {
        match open_card(path, wishes) {
            Ok(kms) => return Ok(kms),
            Err(error) => failures.push(error),
        }
    }
    Err(most_telling(failures))
}

fn open_card(path: &Path, wishes: &Wishes) -> Result<Kms, ScreenError> {
    let card = Card::open(path)?;
    let display = card.display()?;
    let choice = choose(&display, wishes).map_err(|why| unsuitable(&card, &why))?;
    let connector = &display.connectors[choice.connector];
    let mode = &connector.modes[choice.mode];
    let description = format!(
        "KMS, {} ({}), {}, {}x{} at {:.2} Hz",
        card.path(),
        card.driver(),
        connector.name,
        mode.width,
        mode.height,
        mode.refresh_hz
    );
    let scanout = Scanout::open(card, &display, &choice)?;
    tracing::info!("{description}");
    Ok(Kms {
        scanout,
        pacer: Pacer::new(mode.refresh_hz),
        presented: 0,
        description,
    })
}

fn unsuitable(card: &Card, why: &Unsuitable) -> ScreenError {
    let device = card.path().to_owned();
    let text = why.to_string();
    match why {
        Unsuitable::NoMode { offered, .. } => ScreenError::Wish {
            device,
            why: text,
            offered: format!("it offers {offered}"),
        },
        Unsuitable::UnknownConnector { have, .. } => ScreenError::Wish {
            device,
            why: text,
            offered: format!("name one of {have}, or none"),
        },
        Unsuitable::NoConnectors
        | Unsuitable::NoneConnected { .. }
        | Unsuitable::Disconnected { .. }
        | Unsuitable::NoCrtc { .. } => ScreenError::NoDisplay {
            tried: format!("{device}: {text}"),
        },
    }
}

/// Of several cards' failures the one the user can do most about. Cards that merely show nothing are told together.
fn most_telling(failures: Vec<ScreenError>) -> ScreenError {
    let weight = |error: &ScreenError| match error {
        ScreenError::Held { .. } => 0,
        ScreenError::Wish { .. } => 1,
        ScreenError::Library { .. } | ScreenError::Driver { .. } => 2,
        ScreenError::Device { .. } | ScreenError::FlipOverdue { .. } => 3,
        ScreenError::Denied { .. } => 4,
        ScreenError::NoDisplay { .. } => 5,
    };
    let (empty, mut others): (Vec<_>, Vec<_>) = failures
        .into_iter()
        .partition(|error| matches!(error, ScreenError::NoDisplay { .. }));
    others.sort_by_key(weight);
    if let Some(first) = others.into_iter().next() {
        return first;
    }
    let tried: Vec<String> = empty
        .into_iter()
        .map(|error| match error {
            ScreenError::NoDisplay { tried } => tried,
            other => other.to_string(),
        })
        .collect();
    ScreenError::NoDisplay {
        tried: if tried.is_empty() {
            "this machine has no card".to_owned()
        } else {
            tried.join("; ")
        },
    }
}

impl Screen for Kms {
    fn size_px(&self) -> (u32, u32) {
        self.scanout.size_px()
    }

    fn gl_proc(&self, name: &CStr) -> *const c_void {
        self.scanout.context().gl_proc(name)
    }

    fn is_headless(&self) -> bool {
        false
    }

    fn describe(&self) -> String {
        self.description.clone()
    }

    fn present(&mut self) -> Result<Flip, ScreenError> {
        let report = self.scanout.flip()?;
        self.presented += 1;
        let advice = self.pacer.flipped(report.at, report.count);
        if advice.timer_begins {
            tracing::info!("the display reports no refreshes: a timer paces the frames");
        }
        if let Some(beat) = advice.wait_until {
            sleep_until(beat);
        }
        Ok(Flip {
            at: report.at,
            sequence: self.presented,
            missed: advice.missed,
        })
    }
}

/// Sleeps until then, or until a signal arrives: the loop then looks whether it is to end.
fn sleep_until(then: Monotonic) {
    let ns = then.as_nanos();
    let time = Timespec {
        tv_sec: i64::try_from(ns / 1_000_000_000).unwrap_or(i64::MAX),
        tv_nsec: i64::try_from(ns % 1_000_000_000).unwrap_or(0),
    };
    // The only error left is the signal's.
    let _ = clock_nanosleep_absolute(ClockId::Monotonic, &time);
}

/// A card as `glasswing list` shows it.
#[derive(Debug)]
pub struct CardReport {
    /// Its device file.
    pub path: String,
    /// Its driver's name, as in `vc4`; empty where the card could not be opened.
    pub driver: String,
    /// What it has, or why it could not be asked.
    pub display: Result<Display, ScreenError>,
}

/// The cards of this machine and what they have.
#[must_use]
pub fn inventory() -> Vec<CardReport> {
    Card::paths()
        .into_iter()
        .map(|path| match Card::open(&path) {
            Ok(card) => CardReport {
                path: card.path().to_owned(),
                driver: card.driver(),
                display: card.display(),
            },
            Err(error) => CardReport {
                path: path.display().to_string(),
                driver: String::new(),
                display: Err(error),
            },
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_display_held_by_another_program_is_told_before_cards_that_show_nothing() {
        let empty = || ScreenError::NoDisplay {
            tried: "/dev/dri/card0: it drives no displays".into(),
        };
        let held = ScreenError::Held {
            device: "/dev/dri/card1".into(),
            doing: "taking control",
            source: std::io::Error::from_raw_os_error(16),
        };
        let told = most_telling(vec![empty(), held]);
        assert_eq!(told.device(), "/dev/dri/card1");
        let told = most_telling(vec![empty(), empty()]).to_string();
        assert!(
            told.contains("drives no displays; /dev/dri/card0"),
            "{told}"
        );
        let told = most_telling(Vec::new()).to_string();
        assert!(told.contains("this machine has no card"), "{told}");
    }

    #[test]
    fn a_card_that_does_not_exist_is_named_with_those_that_do() {
        let wishes = Wishes {
            card: Some("/dev/dri/card77".into()),
            ..Wishes::default()
        };
        let error = open(&wishes).unwrap_err();
        assert!(error.is_configuration(), "{error:?}");
        let line = error.to_string();
        assert!(
            line.starts_with("/dev/dri/card77: there is no such card (cards here: "),
            "{line}"
        );
    }
}
