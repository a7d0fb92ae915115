//! Masks: images that are silhouettes already. One reader for every command, so that a file means the same
//! everywhere. An image that can be read in two ways is refused with what was found in it.
//!
//! Alpha that is not constant is the mask; without it the colours are. Of colours, greys and black with one other
//! colour have one reading. Two grey values of which one is 0 are background and foreground; otherwise foreground is
//! over half, unless the greys lie in flat regions, as class labels and trimaps do.

mod alpha;
mod colour;
mod error;
mod grey;
mod uniform;

pub use error::{Foreground, Found, MaskError};
pub use uniform::{MaskPattern, UniformFilm};

/// A decoded image, row-major, without padding.
#[derive(Clone, Copy, Debug)]
pub struct MaskImage<'a> {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// What a pixel consists of.
    pub channels: Channels,
    /// The samples of all pixels.
    pub samples: Samples<'a>,
    /// Whether its format (JPEG) changes values: it then has no labels, and values near its extremes are noise.
    pub is_lossy: bool,
}

/// What a pixel consists of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channels {
    /// One sample.
    Grey,
    /// Grey and alpha.
    GreyAlpha,
    /// Red, green and blue.
    Rgb,
    /// Red, green, blue and alpha.
    Rgba,
}

/// Samples of 8 or 16 bits.
#[derive(Clone, Copy, Debug)]
pub enum Samples<'a> {
    /// 8 bits.
    Bytes(&'a [u8]),
    /// 16 bits.
    Words(&'a [u16]),
}

impl Channels {
    fn count(self) -> usize {
        match self {
            Channels::Grey => 1,
            Channels::GreyAlpha => 2,
            Channels::Rgb => 3,
            Channels::Rgba => 4,
        }
    }
}

/// Reads the masks of one film: foreground is the same in all of them.
#[derive(Clone, Copy, Debug, Default)]
pub struct MaskFilm {
    /// As the first mask that tells has it: neither noise nor a shadow alone does.
    foreground: Option<Foreground>,
}

impl MaskFilm {
    /// Writes one byte a pixel into `mask`, 1 for foreground and 0 for background. Refuses an image that is no mask, and
    /// one whose foreground is another than in the masks before it. In a film of foreground over half a mask of noise or
    /// of a shadow alone is background.
    pub fn read(&mut self, image: &MaskImage<'_>, mask: &mut Vec<u8>) -> Result<(), MaskError> {
        match image.samples {
            Samples::Bytes(samples) => self.read_samples(image, samples, mask),
            Samples::Words(samples) => self.read_samples(image, samples, mask),
        }
    }

    /// Film of another camera of the same program, which has told nothing yet: what the films that have told agree on.
    pub fn beside(films: &[MaskFilm]) -> MaskFilm {
        let mut told = films.iter().filter_map(|film| film.foreground);
        let first = told.next();
        MaskFilm { foreground: first.filter(|_| told.all(|other| Some(other) == first)) }
    }

    /// Whether a mask has told what foreground is.
    pub fn is_decided(&self) -> bool {
        self.foreground.is_some()
    }

    fn read_samples<S: Sample>(
        &mut self,
        image: &MaskImage<'_>,
        samples: &[S],
        mask: &mut Vec<u8>,
    ) -> Result<(), MaskError> {
        let (width, channels) = (image.width as usize, image.channels.count());
        let expected = width * image.height as usize * channels;
        if samples.len() != expected || expected == 0 {
            return Err(MaskError::Length { found: samples.len(), expected });
        }
        let mut plane = |values: &[S]| {
            let (from, foreground) = grey::threshold(values, width, image.is_lossy, self.foreground)?;
            self.foreground = self.foreground.or(foreground);
            mask.clear();
            mask.extend(values.iter().map(|&value| u8::from(value >= from)));
            Ok(())
        };
        match image.channels {
            Channels::Grey => plane(samples),
            Channels::Rgb => plane(&colour::greys(samples, channels, image.is_lossy)?),
            Channels::GreyAlpha | Channels::Rgba => {
                match alpha::mask_plane(samples, channels, image.is_lossy)? {
                    alpha::MaskPlane::Colours(values) => plane(&values),
                    alpha::MaskPlane::Alpha(values) => grey::check_half_transparent(&values)
                        .and_then(|()| plane(&values))
                        .map_err(|error| MaskError::Alpha(Box::new(error))),
                }
            }
        }
    }
}

/// A sample of 8 or 16 bits.
trait Sample: Copy + Ord + Into<u32> {
    /// The largest value.
    const MAX: Self;

    /// The sample of a value that is no larger than [`Sample::MAX`].
    fn of(value: u32) -> Self;
}

impl Sample for u8 {
    const MAX: u8 = u8::MAX;

    fn of(value: u32) -> u8 {
        u8::try_from(value).unwrap_or(u8::MAX)
    }
}

impl Sample for u16 {
    const MAX: u16 = u16::MAX;

    fn of(value: u32) -> u16 {
        u16::try_from(value).unwrap_or(u16::MAX)
    }
}

#[cfg(test)]
mod tests;
