//! Whether a camera's masks are all the same: a folder of another camera, or a program that cut out nothing.

use hull::Silhouette;

/// The masks of one run's film.
#[derive(Debug, Default)]
pub(super) struct MaskWatch {
    frames: u64,
    are_full: bool,
    are_empty: bool,
    has_warned: bool,
}

impl MaskWatch {
    /// Counts a mask. Returns a warning once the first `enough` are entirely foreground: no person fills an image
    /// for so long.
    pub fn note(&mut self, mask: &Silhouette, enough: f64) -> Option<String> {
        let pixels = u64::from(mask.width()) * u64::from(mask.height());
        let (is_full, is_empty) = (mask.area() == pixels, mask.area() == 0);
        self.are_full = is_full && (self.are_full || self.frames == 0);
        self.are_empty = is_empty && (self.are_empty || self.frames == 0);
        self.frames += 1;
        if self.are_full && !self.has_warned && self.frames as f64 >= enough {
            self.has_warned = true;
            return Some(format!("its first {} masks are entirely foreground", self.frames));
        }
        None
    }

    /// The film is over: what is to be said of all of its masks.
    pub fn finish(&self) -> Option<String> {
        let side = match self {
            MaskWatch { frames: 0, .. } | MaskWatch { has_warned: true, .. } => return None,
            MaskWatch { are_full: true, .. } => "foreground",
            MaskWatch { are_empty: true, .. } => "background: the hull is empty wherever this camera sees",
            _ => return None,
        };
        Some(format!("all {} masks of its film are entirely {side}", self.frames))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is said of masks of four pixels with so many of foreground, at 3 frames a second: in film, and after it.
    fn said(areas: &[usize]) -> (Option<String>, Option<String>) {
        let mut watch = MaskWatch::default();
        let mut in_film = None;
        for &area in areas {
            let mask: Vec<u8> = (0..4).map(|pixel| u8::from(pixel < area)).collect();
            in_film = in_film.or(watch.note(&Silhouette::from_mask(2, 2, &mask).expect("a mask"), 3.0));
        }
        (in_film, watch.finish())
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
