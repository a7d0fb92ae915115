//! Warnings of a camera whose masks are all the same.

use std::fmt;

use hull::Silhouette;
use segment::mask::{MaskPattern, UniformFilm};

/// The masks of one run's film.
#[derive(Debug, Default)]
pub(super) struct MaskWatch {
    film: UniformFilm,
    has_warned: bool,
}

/// What is wrong with a film of masks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum MaskWarning {
    /// So many masks at its begin are entirely foreground.
    BeginsFull(u64),
    /// All its masks, so many, have one pattern.
    Uniform(u64, MaskPattern),
}

impl fmt::Display for MaskWarning {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            MaskWarning::BeginsFull(masks) => {
                write!(formatter, "its first {masks} masks are entirely foreground")
            }
            MaskWarning::Uniform(masks, pattern) => {
                write!(formatter, "all {masks} masks of its film are {pattern}")?;
                match pattern {
                    MaskPattern::AllForeground | MaskPattern::ForegroundBorder => Ok(()),
                    MaskPattern::AllBackground => {
                        formatter.write_str(": the hull is empty wherever this camera sees")
                    }
                }
            }
        }
    }
}

impl MaskWatch {
    /// Counts a mask. Returns a warning once the first `enough` are entirely foreground: no person fills an image
    /// for so long.
    pub fn note(&mut self, mask: &Silhouette, enough: f64) -> Option<MaskWarning> {
        self.film.note(mask);
        let masks = self.film.masks();
        if self.film.pattern() == Some(MaskPattern::AllForeground)
            && !self.has_warned
            && masks as f64 >= enough
        {
            self.has_warned = true;
            return Some(MaskWarning::BeginsFull(masks));
        }
        None
    }

    /// The film is over: what is to be said of all of its masks.
    pub fn finish(&self) -> Option<MaskWarning> {
        let pattern = self.film.pattern().filter(|_| !self.has_warned)?;
        Some(MaskWarning::Uniform(self.film.masks(), pattern))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is said of masks of four pixels with so many of foreground, at 3 frames a second: in film, and after it.
    fn said(areas: &[usize]) -> (Option<String>, Option<String>) {
        let mut watch = MaskWatch::default();
        let mut in_film: Option<MaskWarning> = None;
        for &area in areas {
            let mask: Vec<u8> = (0..4).map(|pixel| u8::from(pixel < area)).collect();
            in_film = in_film.or(watch.note(&Silhouette::from_mask(2, 2, &mask).expect("a mask"), 3.0));
        }
        (in_film.map(|said| said.to_string()), watch.finish().map(|said| said.to_string()))
    }

    #[test]
    fn film_of_one_side_alone_has_warned_once() {
        let (in_film, after) = said(&[4; 5]);
        assert_eq!((in_film.as_deref(), after), (Some("its first 3 masks are entirely foreground"), None));
        assert_eq!(said(&[4; 2]).1.as_deref(), Some("all 2 masks of its film are entirely foreground"));
        let (in_film, after) = said(&[0; 5]);
        assert!(
            in_film.is_none()
                && after.expect("a warning").starts_with("all 5 masks of its film are entirely background")
        );
    }

    #[test]
    fn film_with_a_silhouette_has_warned_nothing() {
        for areas in [&[0, 0, 0, 0, 1][..], &[1, 0, 0], &[4, 0], &[0, 4, 4, 4], &[]] {
            assert_eq!(said(areas), (None, None), "{areas:?}");
        }
    }
}
