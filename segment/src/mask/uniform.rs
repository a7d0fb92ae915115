//! Whether all masks of a film are the same: a folder of another camera, or a program that cut out nothing.

use std::fmt;

use hull::Silhouette;

/// What a mask is entirely.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Every pixel is foreground.
    Foreground,
    /// Every pixel is background.
    Background,
    /// Every pixel of the image's border is foreground, and pixels within are not: a person is where background is.
    Border,
}

impl fmt::Display for Side {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Side::Foreground => "entirely foreground",
            Side::Background => "entirely background",
            Side::Border => "foreground along the whole border of the image: are they inverted?",
        })
    }
}

/// The masks of a film, as they come.
#[derive(Clone, Copy, Debug, Default)]
pub struct UniformFilm {
    masks: u64,
    side: Option<Side>,
}

impl UniformFilm {
    /// Counts a mask.
    pub fn note(&mut self, mask: &Silhouette) {
        let pixels = u64::from(mask.width()) * u64::from(mask.height());
        let side = match mask.area() {
            0 => Some(Side::Background),
            area if area == pixels => Some(Side::Foreground),
            _ => fills_border(mask).then_some(Side::Border),
        };
        self.side = side.filter(|_| self.masks == 0 || side == self.side);
        self.masks += 1;
    }

    /// How many masks were counted.
    pub fn masks(&self) -> u64 {
        self.masks
    }

    /// What every mask so far is entirely.
    pub fn side(&self) -> Option<Side> {
        self.side
    }
}

fn fills_border(mask: &Silhouette) -> bool {
    let (right, bottom) = (mask.width().saturating_sub(1), mask.height().saturating_sub(1));
    let is_whole =
        |row| matches!(mask.row(row), [run] if run.start == 0 && u32::from(run.end) == mask.width());
    let ends = |row: u32| [0, right].into_iter().all(|column| mask.contains(column as i32, row as i32));
    is_whole(0) && is_whole(bottom) && (0..=bottom).all(ends)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The side of film of masks of four pixels with so many of foreground.
    fn side(areas: &[usize]) -> Option<Side> {
        let mut film = UniformFilm::default();
        for &area in areas {
            let mask: Vec<u8> = (0..4).map(|pixel| u8::from(pixel < area)).collect();
            film.note(&Silhouette::from_mask(2, 2, &mask).expect("a mask"));
        }
        assert_eq!(film.masks(), areas.len() as u64);
        film.side()
    }

    #[test]
    fn film_is_of_one_side_if_all_its_masks_are() {
        assert_eq!(side(&[4; 3]), Some(Side::Foreground));
        assert_eq!(side(&[0; 3]), Some(Side::Background));
        let mut inverted = UniformFilm::default();
        inverted.note(&Silhouette::from_mask(3, 3, &[1, 1, 1, 1, 0, 1, 1, 1, 1]).expect("a mask"));
        assert_eq!(inverted.side(), Some(Side::Border));
        for areas in [&[0, 0, 1][..], &[1, 0, 0], &[4, 0], &[0, 4, 4], &[4, 0, 4], &[]] {
            assert_eq!(side(areas), None, "{areas:?}");
        }
    }
}
