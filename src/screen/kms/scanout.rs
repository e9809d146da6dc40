//! Buffers from GL to the glass: a GBM surface that EGL draws into, the mode set with its first buffer, and a page flip
//! per frame.
//!
//! Frames are flipped by the legacy ioctl also where the mode was set atomically: every atomic driver takes it, it takes
//! the same path in the kernel, and it needs no request to be built per frame. Buffers are locked and released through
//! the C functions, because the gbm crate allocates two objects per lock.

use std::io;
use std::ptr::NonNull;
use std::rc::Rc;
use std::time::Duration;

use arrayvec::ArrayVec;
use drm::buffer::{Buffer, DrmFourcc, Handle};
use drm::control::property::Value;
use drm::control::{self, AtomicCommitFlags, Device as _, Event, PageFlipFlags, atomic};
use drm::control::{connector, crtc, framebuffer, plane};
use gbm::{AsRaw as _, BufferObjectFlags};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;
use rustix::time::Timespec;

use super::card::{Card, is_one_of};
use super::choose::{Choice, Display};
use super::flip::Flips;
use crate::screen::ScreenError;
use crate::screen::egl::Context;
use crate::time::Monotonic;

/// How long the display may take to show a frame. Refreshes are 17 ms apart; a GPU that needs seconds for a frame is
/// broken, but an emulated one on a loaded machine has been seen to need one.
const FLIP_LIMIT: Duration = Duration::from_secs(3);

/// Buffers a GBM surface rotates through: Mesa's `platform_drm` has four.
const BUFFERS_MAX: usize = 8;

/// A buffer of the surface, locked by us, with the framebuffer number the kernel knows it by.
#[derive(Clone, Copy, Debug)]
struct Locked {
    object: NonNull<gbm_sys::gbm_bo>,
    framebuffer: framebuffer::Handle,
}

/// What the kernel reported about a flip.
#[derive(Clone, Copy, Debug)]
pub(super) struct Report {
    /// When the frame became visible.
    pub(super) at: Monotonic,
    /// The display's count of refreshes.
    pub(super) count: u32,
}

/// A lit display. Fields are dropped in this order: EGL, then what it draws into, then the card.
#[derive(Debug)]
pub(super) struct Scanout {
    context: Context,
    surface: gbm::Surface<()>,
    _device: gbm::Device<Rc<Card>>,
    framebuffers: ArrayVec<framebuffer::Handle, BUFFERS_MAX>,
    flips: Option<Flips<Locked>>,
    size_px: (u32, u32),
    crtc: crtc::Handle,
    stamps_are_monotonic: bool,
    card: Rc<Card>,
}

/// The kernel's handles of what was chosen.
struct Route {
    connector: connector::Handle,
    crtc: crtc::Handle,
    plane: Option<plane::Handle>,
    mode: control::Mode,
}

impl Scanout {
    /// Takes control of the display and shows black.
    pub(super) fn open(
        card: Card,
        display: &Display,
        choice: &Choice,
    ) -> Result<Self, ScreenError> {
        card.take_control()?;
        let card = Rc::new(card);
        let route = Route::new(&card, display, choice)?;
        let (width, height) = route.mode.size();
        let (width, height) = (u32::from(width), u32::from(height));
        let device = gbm::Device::new(Rc::clone(&card))
            .map_err(|source| card.refused("opening GBM on the card", source))?;
        let surface = device
            .create_surface::<()>(
                width,
                height,
                gbm::Format::Xrgb8888,
                BufferObjectFlags::SCANOUT | BufferObjectFlags::RENDERING,
            )
            .map_err(|source| card.refused("making buffers the display can show", source))?;
        // SAFETY: both are live GBM objects, and the struct drops the context before them.
        let context = unsafe {
            Context::on_gbm(
                card.path(),
                device.as_raw_mut().cast(),
                surface.as_raw_mut().cast(),
                gbm::Format::Xrgb8888 as u32,
            )?
        };
        let mut scanout = Self {
            context,
            surface,
            _device: device,
            framebuffers: ArrayVec::new(),
            flips: None,
            size_px: (width, height),
            crtc: route.crtc,
            stamps_are_monotonic: card.stamps_are_monotonic(),
            card,
        };
        scanout.context.clear_to_black();
        let black = scanout.swap()?;
        scanout.flips = Some(Flips::new(black));
        route.set_mode(&scanout.card, black.framebuffer)?;
        Ok(scanout)
    }

    pub(super) const fn size_px(&self) -> (u32, u32) {
        self.size_px
    }

    pub(super) const fn context(&self) -> &Context {
        &self.context
    }

    /// Hands over what was drawn and waits until it is on the glass.
    pub(super) fn flip(&mut self) -> Result<Report, ScreenError> {
        // A flip that was overdue may have been reported since.
        self.wait()?;
        let next = self.swap()?;
        let queued = self
            .card
            .page_flip(self.crtc, next.framebuffer, PageFlipFlags::EVENT, None);
        let now = Monotonic::read();
        if let Err(source) = queued {
            self.release(next);
            return Err(self.card.refused("handing over a frame", source));
        }
        if let Some(flips) = &mut self.flips {
            flips.queued(next, now);
        }
        let report = self.wait()?;
        // `wait` gives no report only when no flip was waited for, which is not so here.
        Ok(report.unwrap_or(Report { at: now, count: 0 }))
    }

    /// Waits for the report of the flip at hand, if any.
    fn wait(&mut self) -> Result<Option<Report>, ScreenError> {
        loop {
            let now = Monotonic::read();
            let Some(flips) = &mut self.flips else {
                return Ok(None);
            };
            let Some(since) = flips.waiting_since() else {
                return Ok(None);
            };
            let patience = flips.patience(now, FLIP_LIMIT);
            if !self.readable_within(patience)? {
                if patience.is_zero() {
                    let waited = now.since(since).unwrap_or(FLIP_LIMIT);
                    return Err(ScreenError::FlipOverdue {
                        device: self.card.path().to_owned(),
                        waited_ms: u64::try_from(waited.as_millis()).unwrap_or(u64::MAX),
                    });
                }
                continue;
            }
            if let Some(report) = self.read_reports()? {
                return Ok(Some(report));
            }
        }
    }

    /// Reads what the kernel has to say; frees the buffer that left the glass.
    fn read_reports(&mut self) -> Result<Option<Report>, ScreenError> {
        let events = self
            .card
            .receive_events()
            .map_err(|source| self.card.refused("reading a flip event", source))?;
        let mut report = None;
        for event in events {
            let Event::PageFlip(flip) = event else {
                continue;
            };
            if flip.crtc != self.crtc {
                continue;
            }
            if let Some(left) = self.flips.as_mut().and_then(Flips::flipped) {
                self.release(left);
            }
            let now = Monotonic::read();
            let stamp = u64::try_from(flip.duration.as_nanos()).unwrap_or(0);
            // A stamp of another clock, or from the future, is none.
            let usable = self.stamps_are_monotonic && stamp != 0 && stamp <= now.as_nanos();
            report = Some(Report {
                at: if usable {
                    Monotonic::from_nanos(stamp)
                } else {
                    now
                },
                count: flip.frame,
            });
        }
        Ok(report)
    }

    /// Does the card have something to say within that time? A signal ends the wait early, with no.
    fn readable_within(&self, time: Duration) -> Result<bool, ScreenError> {
        let timeout = Timespec {
            tv_sec: i64::try_from(time.as_secs()).unwrap_or(i64::MAX),
            tv_nsec: time.subsec_nanos().into(),
        };
        let mut fds = [PollFd::new(&*self.card, PollFlags::IN)];
        match poll(&mut fds, Some(&timeout)) {
            Ok(ready) => Ok(ready > 0),
            Err(Errno::INTR) => Ok(false),
            Err(e) => Err(self.card.refused("waiting for a flip", e.into())),
        }
    }

    /// Finishes the frame and locks its buffer. Buffers get their framebuffer when first seen and keep it.
    fn swap(&mut self) -> Result<Locked, ScreenError> {
        self.context.swap()?;
        let surface = self.surface.as_raw_mut();
        // SAFETY: the surface is alive, and eglSwapBuffers was called once since the last lock.
        let object = unsafe { gbm_sys::gbm_surface_lock_front_buffer(surface) };
        let object = NonNull::new(object).ok_or_else(|| {
            self.card
                .refused("locking a drawn buffer", io::Error::last_os_error())
        })?;
        let framebuffer = self.framebuffer(object).inspect_err(|_error| {
            // SAFETY: locked above, and not handed over.
            unsafe { gbm_sys::gbm_surface_release_buffer(surface, object.as_ptr()) };
        })?;
        Ok(Locked {
            object,
            framebuffer,
        })
    }

    /// The framebuffer that hangs on the buffer as its user data: the kernel's number for it, cast to a pointer that is
    /// never followed.
    fn framebuffer(
        &mut self,
        object: NonNull<gbm_sys::gbm_bo>,
    ) -> Result<framebuffer::Handle, ScreenError> {
        // SAFETY: the buffer is alive while we hold it locked.
        let known = unsafe { gbm_sys::gbm_bo_get_user_data(object.as_ptr()) };
        let known = u32::try_from(known.addr()).ok().and_then(control::from_u32);
        if let Some(framebuffer) = known {
            return Ok(framebuffer);
        }
        let doing = "telling the display about a buffer";
        // SAFETY: as above.
        let pitch = unsafe { gbm_sys::gbm_bo_get_stride(object.as_ptr()) };
        // SAFETY: as above.
        let handle = unsafe { gbm_sys::gbm_bo_get_handle(object.as_ptr()) };
        // SAFETY: the union holds a 32-bit GEM handle on every DRM driver.
        let handle = unsafe { handle.u32_ };
        let plain = Plain {
            size: self.size_px,
            pitch,
            handle: control::from_u32(handle)
                .ok_or_else(|| self.card.refused(doing, io::ErrorKind::InvalidData.into()))?,
        };
        let made = self
            .card
            .add_framebuffer(&plain, 24, 32)
            .map_err(|source| self.card.refused(doing, source))?;
        if self.framebuffers.try_push(made).is_err() {
            tracing::warn!(max = BUFFERS_MAX, "more display buffers than expected");
        }
        let number = std::ptr::without_provenance_mut(u32::from(made) as usize);
        // SAFETY: as above; the data is a number, so there is nothing to destroy with the buffer.
        unsafe { gbm_sys::gbm_bo_set_user_data(object.as_ptr(), number, None) };
        Ok(made)
    }

    /// Gives a buffer back to the surface, to be drawn into again.
    fn release(&self, buffer: Locked) {
        // SAFETY: the buffer was locked from this surface, once, and is not on the glass (or never will be).
        unsafe {
            gbm_sys::gbm_surface_release_buffer(self.surface.as_raw_mut(), buffer.object.as_ptr());
        };
    }
}

impl Drop for Scanout {
    fn drop(&mut self) {
        // Let a flip at hand end, so that the kernel no longer reads what is freed now. An overdue one is given up:
        // removing its framebuffer takes it off the glass.
        let _ = self.wait();
        for framebuffer in self.framebuffers.drain(..) {
            let _ = self.card.destroy_framebuffer(framebuffer);
        }
        if let Some(flips) = self.flips.take() {
            for buffer in flips.held() {
                self.release(buffer);
            }
        }
    }
}

impl Route {
    fn new(card: &Card, display: &Display, choice: &Choice) -> Result<Self, ScreenError> {
        let gone = || {
            card.refused(
                "finding the connector again",
                io::ErrorKind::NotFound.into(),
            )
        };
        let connector = display.connectors.get(choice.connector).ok_or_else(gone)?;
        Ok(Self {
            connector: control::from_u32(connector.id).ok_or_else(gone)?,
            crtc: control::from_u32(choice.crtc).ok_or_else(gone)?,
            plane: choice.plane.and_then(control::from_u32),
            mode: card.kernel_mode(connector, choice.mode)?,
        })
    }

    /// Lights the display with `first` on it: atomically where the driver can, tested before; else the old way.
    fn set_mode(&self, card: &Card, first: framebuffer::Handle) -> Result<(), ScreenError> {
        const HELD: [Errno; 3] = [Errno::BUSY, Errno::ACCESS, Errno::PERM];
        if let (true, Some(plane)) = (card.atomic, self.plane) {
            match self.set_mode_atomically(card, plane, first) {
                Ok(()) => return Ok(()),
                Err(e) if is_one_of(&e, &HELD) => return Err(card.refused("setting the mode", e)),
                Err(e) => tracing::info!(
                    card = card.path(),
                    "no atomic modeset ({e}); setting the mode the old way"
                ),
            }
        }
        card.set_crtc(
            self.crtc,
            Some(first),
            (0, 0),
            &[self.connector],
            Some(self.mode),
        )
        .map_err(|source| card.refused("setting the mode", source))
    }

    fn set_mode_atomically(
        &self,
        card: &Card,
        plane: plane::Handle,
        first: framebuffer::Handle,
    ) -> io::Result<()> {
        fn set<T: control::ResourceHandle>(
            request: &mut atomic::AtomicModeReq,
            card: &Card,
            object: T,
            name: &str,
            value: Value<'_>,
        ) -> io::Result<()> {
            let missing = || io::Error::new(io::ErrorKind::NotFound, format!("no property {name}"));
            let (property, _) = card.property(object, name)?.ok_or_else(missing)?;
            request.add_property(object, property, value);
            Ok(())
        }
        let (width, height) = self.mode.size();
        let (width, height) = (u64::from(width), u64::from(height));
        let mode = card.create_property_blob(&self.mode)?;
        let crtc = Value::CRTC(Some(self.crtc));
        let mut request = atomic::AtomicModeReq::new();
        let r = &mut request;
        set(r, card, self.connector, "CRTC_ID", crtc)?;
        set(r, card, self.crtc, "MODE_ID", mode)?;
        set(r, card, self.crtc, "ACTIVE", Value::Boolean(true))?;
        set(r, card, plane, "FB_ID", Value::Framebuffer(Some(first)))?;
        set(r, card, plane, "CRTC_ID", Value::CRTC(Some(self.crtc)))?;
        // The source rectangle is in 16.16 fixed point, the one on the screen in pixels.
        set(r, card, plane, "SRC_X", Value::UnsignedRange(0))?;
        set(r, card, plane, "SRC_Y", Value::UnsignedRange(0))?;
        set(r, card, plane, "SRC_W", Value::UnsignedRange(width << 16))?;
        set(r, card, plane, "SRC_H", Value::UnsignedRange(height << 16))?;
        set(r, card, plane, "CRTC_X", Value::SignedRange(0))?;
        set(r, card, plane, "CRTC_Y", Value::SignedRange(0))?;
        set(r, card, plane, "CRTC_W", Value::UnsignedRange(width))?;
        set(r, card, plane, "CRTC_H", Value::UnsignedRange(height))?;
        let modeset = AtomicCommitFlags::ALLOW_MODESET;
        card.atomic_commit(modeset | AtomicCommitFlags::TEST_ONLY, request.clone())?;
        card.atomic_commit(modeset, request)
    }
}

/// A buffer as AddFB wants it described.
struct Plain {
    size: (u32, u32),
    pitch: u32,
    handle: Handle,
}

impl Buffer for Plain {
    fn size(&self) -> (u32, u32) {
        self.size
    }

    fn format(&self) -> DrmFourcc {
        DrmFourcc::Xrgb8888
    }

    fn pitch(&self) -> u32 {
        self.pitch
    }

    fn handle(&self) -> Handle {
        self.handle
    }
}
