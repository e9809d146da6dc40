//! A DRM card: opened, asked what it has, and taken control of.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::path::{Path, PathBuf};

use drm::buffer::DrmFourcc;
use drm::control::{self, Device as _, connector, crtc, encoder, plane, property};
use drm::{ClientCapability, Device as _, DriverCapability};
use rustix::io::Errno;

use super::choose::{Connector, Display, Link, Mode, Plane};
use crate::screen::ScreenError;

/// An open card.
#[derive(Debug)]
pub(super) struct Card {
    file: File,
    path: String,
    /// Does it take atomic commits?
    pub(super) atomic: bool,
}

impl AsFd for Card {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.file.as_fd()
    }
}

impl drm::Device for Card {}
impl control::Device for Card {}

impl Card {
    /// The cards of this machine, in the order of their numbers.
    pub(super) fn paths() -> Vec<PathBuf> {
        let Ok(entries) = std::fs::read_dir("/dev/dri") else {
            return Vec::new();
        };
        let mut found: Vec<(u32, PathBuf)> = entries
            .filter_map(Result::ok)
            .filter_map(|entry| {
                let name = entry.file_name();
                let number = name.to_str()?.strip_prefix("card")?.parse().ok()?;
                Some((number, entry.path()))
            })
            .collect();
        found.sort();
        found.into_iter().map(|(_, path)| path).collect()
    }

    /// Opens one. The first to open a card that nobody holds gets control of it.
    pub(super) fn open(path: &Path) -> Result<Self, ScreenError> {
        let device = path.display().to_string();
        let opened = OpenOptions::new().read(true).write(true).open(path);
        let file = match opened {
            Ok(file) => file,
            Err(source) if source.kind() == io::ErrorKind::PermissionDenied => {
                return Err(ScreenError::Denied { device, source });
            }
            Err(source) if source.kind() == io::ErrorKind::NotFound => {
                let there: Vec<String> = Self::paths()
                    .iter()
                    .map(|path| path.display().to_string())
                    .collect();
                let there = if there.is_empty() {
                    "none".to_owned()
                } else {
                    there.join(", ")
                };
                return Err(ScreenError::Wish {
                    device,
                    why: "there is no such card".into(),
                    offered: format!("cards here: {there}"),
                });
            }
            Err(source) => {
                return Err(ScreenError::Device {
                    device,
                    doing: "opening the card",
                    source,
                });
            }
        };
        let mut card = Self {
            file,
            path: device,
            atomic: false,
        };
        // Neither is an error: old drivers have primary planes only implied and legacy modesetting only.
        let _ = card.set_client_capability(ClientCapability::UniversalPlanes, true);
        card.atomic = card
            .set_client_capability(ClientCapability::Atomic, true)
            .is_ok();
        Ok(card)
    }

    /// Its device file.
    pub(super) fn path(&self) -> &str {
        &self.path
    }

    /// Its driver's name, as in `vc4`.
    pub(super) fn driver(&self) -> String {
        self.get_driver().map_or_else(
            |_error| "unknown driver".to_owned(),
            |driver| driver.name().to_string_lossy().into_owned(),
        )
    }

    /// Are flip events stamped by `CLOCK_MONOTONIC`?
    pub(super) fn stamps_are_monotonic(&self) -> bool {
        self.get_driver_capability(DriverCapability::MonotonicTimestamp)
            .is_ok_and(|value| value == 1)
    }

    /// Takes control of the display, or learns that another program has it.
    pub(super) fn take_control(&self) -> Result<(), ScreenError> {
        self.acquire_master_lock()
            .map_err(|source| self.refused("taking control", source))
    }

    /// Asks for connectors, modes, CRTCs and planes. Asks the sockets themselves, which can take a moment.
    pub(super) fn display(&self) -> Result<Display, ScreenError> {
        let ask = |source| self.refused("asking for its connectors", source);
        let resources = match self.resource_handles() {
            Ok(resources) => resources,
            // A card without a display controller knows no such question.
            Err(e) if is_one_of(&e, &[Errno::OPNOTSUPP, Errno::INVAL]) => {
                return Ok(Display {
                    crtcs: Vec::new(),
                    connectors: Vec::new(),
                    planes: Vec::new(),
                });
            }
            Err(e) => return Err(ask(e)),
        };
        let mut connectors = Vec::new();
        for handle in resources.connectors() {
            // A connector of a dock may vanish between the two questions: then it is not there.
            if let Ok(info) = self.get_connector(*handle, true) {
                connectors.push(self.connector(&resources, &info));
            }
        }
        let planes = self
            .plane_handles()
            .map_err(ask)?
            .into_iter()
            .filter_map(|handle| self.primary(&resources, handle))
            .collect();
        Ok(Display {
            crtcs: resources
                .crtcs()
                .iter()
                .map(|crtc| (*crtc).into())
                .collect(),
            connectors,
            planes,
        })
    }

    fn connector(&self, resources: &control::ResourceHandles, info: &connector::Info) -> Connector {
        let encoders: Vec<encoder::Info> = info
            .encoders()
            .iter()
            .filter_map(|handle| self.get_encoder(*handle).ok())
            .collect();
        let driven_by = info
            .current_encoder()
            .and_then(|handle| self.get_encoder(handle).ok())
            .and_then(|encoder| encoder.crtc())
            .map(Into::into);
        Connector {
            id: info.handle().into(),
            name: info.to_string(),
            link: match info.state() {
                connector::State::Connected => Link::Connected,
                connector::State::Disconnected => Link::Disconnected,
                connector::State::Unknown => Link::Unknown,
            },
            modes: info.modes().iter().map(plain_mode).collect(),
            crtcs: encoders
                .iter()
                .map(|encoder| mask(resources, encoder.possible_crtcs()))
                .fold(0, |all, one| all | one),
            driven_by,
        }
    }

    /// The plane, if it is a primary one that reads XRGB8888.
    fn primary(
        &self,
        resources: &control::ResourceHandles,
        handle: plane::Handle,
    ) -> Option<Plane> {
        let info = self.get_plane(handle).ok()?;
        let (_, kind) = self.property(handle, "type").ok()??;
        let primary = kind == property::RawValue::from(control::PlaneType::Primary as u32);
        let format = info.formats().contains(&(DrmFourcc::Xrgb8888 as u32));
        (primary && format).then(|| Plane {
            id: handle.into(),
            crtcs: mask(resources, info.possible_crtcs()),
        })
    }

    /// The mode as the kernel wants it back.
    pub(super) fn kernel_mode(
        &self,
        connector: &Connector,
        mode: usize,
    ) -> Result<control::Mode, ScreenError> {
        let gone = || self.refused("reading the mode", io::ErrorKind::NotFound.into());
        let handle: connector::Handle = control::from_u32(connector.id).ok_or_else(gone)?;
        let info = self
            .get_connector(handle, false)
            .map_err(|source| self.refused("reading the mode", source))?;
        // The list may have changed since: the mode must still be the one that was chosen.
        let wanted = connector.modes.get(mode).ok_or_else(gone)?;
        info.modes()
            .iter()
            .find(|m| plain_mode(m) == *wanted)
            .copied()
            .ok_or_else(gone)
    }

    /// A property of an object and its value, by its name; `None` where the object has none of that name.
    pub(super) fn property<T: control::ResourceHandle>(
        &self,
        object: T,
        name: &str,
    ) -> io::Result<Option<(property::Handle, property::RawValue)>> {
        for (handle, value) in &self.get_properties(object)? {
            let info = self.get_property(*handle)?;
            if info.name().to_bytes() == name.as_bytes() {
                return Ok(Some((*handle, *value)));
            }
        }
        Ok(None)
    }

    /// Words the kernel's refusal. When the refusal means that somebody else is in control, says that.
    pub(super) fn refused(&self, doing: &'static str, source: io::Error) -> ScreenError {
        let device = self.path.clone();
        if is_one_of(&source, &[Errno::BUSY, Errno::ACCESS, Errno::PERM]) {
            ScreenError::Held {
                device,
                doing,
                source,
            }
        } else {
            ScreenError::Device {
                device,
                doing,
                source,
            }
        }
    }
}

impl Drop for Card {
    fn drop(&mut self) {
        // Whoever comes next gets control; without it there is nothing to give up.
        let _ = self.release_master_lock();
    }
}

/// Is the error one of these?
pub(super) fn is_one_of(error: &io::Error, numbers: &[Errno]) -> bool {
    numbers
        .iter()
        .any(|number| error.raw_os_error() == Some(number.raw_os_error()))
}

fn mask(resources: &control::ResourceHandles, filter: control::CrtcListFilter) -> u32 {
    let possible: Vec<crtc::Handle> = resources.filter_crtcs(filter);
    resources
        .crtcs()
        .iter()
        .take(32)
        .enumerate()
        .filter(|(_, crtc)| possible.contains(crtc))
        .fold(0, |mask, (at, _)| mask | 1 << at)
}

/// Refresh rate as the kernel's `drm_mode_vrefresh` computes it, unrounded: pixel clock over pixels per frame.
fn plain_mode(mode: &control::Mode) -> Mode {
    let (width, height) = mode.size();
    let flags = mode.flags();
    let interlaced = flags.contains(control::ModeFlags::INTERLACE);
    let pixels = f64::from(mode.hsync().2) * f64::from(mode.vsync().2);
    let mut refresh_hz = f64::from(mode.clock()) * 1000.0 / pixels;
    if interlaced {
        refresh_hz *= 2.0;
    }
    if flags.contains(control::ModeFlags::DBLSCAN) {
        refresh_hz /= 2.0;
    }
    if mode.vscan() > 1 {
        refresh_hz /= f64::from(mode.vscan());
    }
    if !refresh_hz.is_finite() || refresh_hz <= 0.0 {
        // Some virtual displays give no pixel clock; then the rounded rate is all there is.
        refresh_hz = f64::from(mode.vrefresh());
    }
    Mode {
        width,
        height,
        refresh_hz,
        preferred: mode.mode_type().contains(control::ModeTypeFlags::PREFERRED),
        interlaced,
    }
}
