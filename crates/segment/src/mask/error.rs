//! Why an image is no mask.

use std::fmt;

use thiserror::Error;

/// So many values or colours are listed in a message.
pub(super) const LISTED: usize = 6;

/// Why an image is no mask: what was found, and what would do.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum MaskError {
    /// The samples are not the size's.
    #[error("found {found} samples, expected {expected}")]
    Length {
        /// How many there are.
        found: usize,
        /// How many there should be.
        expected: usize,
    },
    /// One grey value that may be background or foreground.
    #[error(
        "found the grey value {value} in every pixel, which may be either side; expected 0 (background), {max} \
         (foreground), or both"
    )]
    ConstantGrey {
        /// The value.
        value: u32,
        /// The largest value of so many bits.
        max: u32,
    },
    /// One colour that may be background or foreground.
    #[error(
        "found the colour {0} in every pixel, which may be either side; expected black (background), white \
         (foreground), or black and one other colour"
    )]
    ConstantColour(Found),
    /// Values that do not say which of them are foreground.
    #[error(
        "found the grey values {found}, all of them {} half ({half}); expected 0 and one other value, or values on \
         both sides of half", if *.are_dark { "up to" } else { "over" }
    )]
    OneSide {
        /// The values.
        found: Found,
        /// The largest value that is background by half.
        half: u32,
        /// Whether they are all up to half.
        are_dark: bool,
    },
    /// Flat regions of three or more values.
    #[error(
        "found flat regions of more than two grey values ({0}), as class labels and trimaps have; expected a mask of \
         0 and one other value"
    )]
    Labels(Found),
    /// Most pixels are neither background nor foreground.
    #[error(
        "found a picture: {between_percent} % of the pixels are neither near {low} nor near {high}; expected a mask, \
         most of it background or foreground"
    )]
    Picture {
        /// Pixels between the two, in percent.
        between_percent: u32,
        /// The most common value up to half.
        low: u32,
        /// The most common value over half.
        high: u32,
    },
    /// Too many pixels may be on either side.
    #[error(
        "found a picture: pixels that are neither near {low} nor near {high}, and no soft edge, make {percent} % of the \
         foreground; expected a mask"
    )]
    Doubtful {
        /// Such pixels, in percent of those over half.
        percent: u32,
        /// The most common value up to half.
        low: u32,
        /// The most common value over half.
        high: u32,
    },
    /// Most pixels are near one of two greys, and these are no extremes.
    #[error(
        "found a picture: most of its pixels are near {low} or {high}; expected a mask, with background near 0 and \
         foreground near {max}"
    )]
    Peaks {
        /// The most common value up to half.
        low: u32,
        /// The most common value over half.
        high: u32,
        /// The largest value of so many bits.
        max: u32,
    },
    /// More than one colour beside black.
    #[error("found the colours {0}; expected black and one other colour, or greys")]
    Colours(Found),
    /// Alpha says nothing, and colours lie under it.
    #[error(
        "found different colours, and alpha 0 in every pixel; expected opaque colours, or the mask in alpha"
    )]
    Transparent,
    /// Alpha is a mask, and the colours are another one.
    #[error(
        "found a mask in alpha, and black beside another colour where that is opaque; expected one mask: either \
         without alpha, or with one colour"
    )]
    TwoMasks,
    /// Foreground of a film changes.
    #[error(
        "found {found} as foreground, and {before} in the masks before; expected one kind of masks in a film: 0 and \
         one value, the same in all of them, or foreground over half"
    )]
    OtherForeground {
        /// Of this mask.
        found: Foreground,
        /// Of those before it.
        before: Foreground,
    },
    /// Alpha is not constant, and no mask.
    #[error("alpha: {0}")]
    Alpha(Box<MaskError>),
}

/// What foreground is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Foreground {
    /// One value up to half, beside 0.
    Value(u32),
    /// All values over half.
    OverHalf,
}

impl fmt::Display for Foreground {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Foreground::Value(value) => write!(f, "the grey value {value}"),
            Foreground::OverHalf => f.write_str("values over half"),
        }
    }
}

/// Values or colours that were found: the first ones, and whether there are more.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Found {
    listed: Vec<String>,
    has_more: bool,
}

impl Found {
    /// Lists the first ones.
    pub(super) fn new(all: impl IntoIterator<Item = impl fmt::Display>) -> Found {
        let mut all = all.into_iter();
        let listed = all.by_ref().take(LISTED).map(|one| one.to_string()).collect();
        Found { listed, has_more: all.next().is_some() }
    }
}

impl fmt::Display for Found {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.listed.join(", "))?;
        if self.has_more { f.write_str(" and others") } else { Ok(()) }
    }
}
