//! Whether all masks of a film show the same fault: a folder of another camera, a program that found no person, or masks
//! that are inverted.

use std::fmt;

use hull::Silhouette;

/// An inverted mask has foreground on so many of so many parts of the border.
const BORDER_SHARE: u64 = 17;
const BORDER_OF: u64 = 20;

/// What a mask of a person hardly ever is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MaskPattern {
    /// Every pixel is foreground.
    AllForeground,
    /// Every pixel is background.
    AllBackground,
    /// Nearly every pixel of the image's border is foreground, and some within are not, as in an inverted mask.
    ForegroundBorder,
}

impl fmt::Display for MaskPattern {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            MaskPattern::AllForeground => "entirely foreground",
            MaskPattern::AllBackground => "entirely background",
            MaskPattern::ForegroundBorder => {
                "foreground along the whole border of the image: are they inverted?"
            }
        })
    }
}

/// The masks of a film, as they come.
#[derive(Clone, Copy, Debug, Default)]
pub struct UniformFilm {
    masks: u64,
    pattern: Option<MaskPattern>,
}

impl UniformFilm {
    /// Counts a mask.
    pub fn note(&mut self, mask: &Silhouette) {
        let pixels = u64::from(mask.width()) * u64::from(mask.height());
        let pattern = match mask.area() {
            0 => Some(MaskPattern::AllBackground),
            area if area == pixels => Some(MaskPattern::AllForeground),
            _ => fills_border(mask).then_some(MaskPattern::ForegroundBorder),
        };
        self.pattern = pattern.filter(|_| self.masks == 0 || pattern == self.pattern);
        self.masks += 1;
    }

    /// How many masks were counted.
    pub fn masks(&self) -> u64 {
        self.masks
    }

    /// The pattern of every mask so far.
    pub fn pattern(&self) -> Option<MaskPattern> {
        self.pattern
    }
}

/// Whether nearly all of the image's border is foreground: a person may reach it at the feet of an inverted mask.
fn fills_border(mask: &Silhouette) -> bool {
    let (width, height) = (mask.width(), mask.height());
    let (right, bottom) = (width.saturating_sub(1), height.saturating_sub(1));
    let rows =
        [0, bottom].map(|row| mask.row(row).iter().map(|run| u32::from(run.end - run.start)).sum::<u32>());
    let inner = (1..bottom).flat_map(|row| [(0, row), (right, row)]);
    let sides = inner.filter(|&(column, row)| mask.contains(column as i32, row as i32)).count() as u64;
    let found = u64::from(rows[0]) + u64::from(rows[1]) + sides;
    let border = 2 * u64::from(width) + 2 * u64::from(height.saturating_sub(2));
    found * BORDER_OF >= border * BORDER_SHARE
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The side of film of masks of four pixels with so many of foreground.
    fn side(areas: &[usize]) -> Option<MaskPattern> {
        let mut film = UniformFilm::default();
        for &area in areas {
            let mask: Vec<u8> = (0..4).map(|pixel| u8::from(pixel < area)).collect();
            film.note(&Silhouette::from_mask(2, 2, &mask).expect("a mask"));
        }
        assert_eq!(film.masks(), areas.len() as u64);
        film.pattern()
    }

    #[test]
    fn film_is_of_one_side_if_all_its_masks_are() {
        assert_eq!(side(&[4; 3]), Some(MaskPattern::AllForeground));
        assert_eq!(side(&[0; 3]), Some(MaskPattern::AllBackground));
        let mut inverted = UniformFilm::default();
        inverted.note(&Silhouette::from_mask(3, 3, &[1, 1, 1, 1, 0, 1, 1, 1, 1]).expect("a mask"));
        assert_eq!(inverted.pattern(), Some(MaskPattern::ForegroundBorder));
        let mut open = UniformFilm::default();
        open.note(&Silhouette::from_mask(3, 3, &[1, 1, 1, 1, 0, 0, 1, 0, 1]).expect("a mask"));
        assert_eq!(open.pattern(), None);
        for areas in [&[0, 0, 1][..], &[1, 0, 0], &[4, 0], &[0, 4, 4], &[4, 0, 4], &[]] {
            assert_eq!(side(areas), None, "{areas:?}");
        }
    }
}
