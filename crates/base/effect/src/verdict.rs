//! What a diagnosis says of the effects of the library.

/// What was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Verdict {
    /// Nothing beyond what every vehicle has.
    None,
    /// One effect.
    Single,
    /// Two or three effects.
    Multiple,
    /// Something that the library does not contain.
    Unknown,
}

impl Verdict {
    /// All verdicts.
    pub const ALL: [Self; 4] = [Self::None, Self::Single, Self::Multiple, Self::Unknown];

    /// Returns its name in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Single => "single",
            Self::Multiple => "multiple",
            Self::Unknown => "unknown",
        }
    }

    /// Says it in words.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::None => "nothing beyond what every vehicle has",
            Self::Single => "one effect",
            Self::Multiple => "several effects",
            Self::Unknown => "something that the library does not contain",
        }
    }
}
