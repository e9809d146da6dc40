//! What can go wrong with a screen, worded for the person who has to put it right.

/// A screen could not be opened or shown on. Displayed as `DEVICE: WHY (WHAT TO DO)`.
#[derive(Debug, thiserror::Error)]
pub enum ScreenError {
    /// A library of the system is missing.
    #[error("{library}: cannot be loaded: {why} (install it: apt install {package})")]
    Library {
        /// The file looked for, as in `libEGL.so.1`.
        library: &'static str,
        /// The dynamic linker's words.
        why: String,
        /// The Debian package that has it.
        package: &'static str,
    },
    /// EGL refused.
    #[error("{platform}: {doing}: {why} ({remedy})")]
    Egl {
        /// `EGL surfaceless` or `EGL on /dev/dri/card0`.
        platform: String,
        /// What we were doing.
        doing: &'static str,
        /// EGL's error.
        why: String,
        /// What to do.
        remedy: &'static str,
    },
}

impl ScreenError {
    /// The library or device concerned.
    #[must_use]
    pub fn device(&self) -> &str {
        match self {
            Self::Library { library, .. } => library,
            Self::Egl { platform, .. } => platform,
        }
    }

    /// What is wrong with it.
    #[must_use]
    pub fn why(&self) -> String {
        match self {
            Self::Library { why, .. } => format!("cannot be loaded: {why}"),
            Self::Egl { doing, why, .. } => format!("{doing}: {why}"),
        }
    }

    /// What the user can do.
    #[must_use]
    pub fn remedy(&self) -> String {
        match self {
            Self::Library { package, .. } => format!("install it: apt install {package}"),
            Self::Egl { remedy, .. } => (*remedy).to_owned(),
        }
    }
}
