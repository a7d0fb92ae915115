//! Whether alpha is the mask, or the colours are.

use super::{MaskError, Sample, colour};

/// Where the mask is, as one sample a pixel.
pub(super) enum MaskPlane<S> {
    /// In the colours; alpha is constant.
    Colours(Vec<S>),
    /// In alpha.
    Alpha(Vec<S>),
}

/// Finds the mask in pixels whose last sample is alpha.
pub(super) fn mask_plane<S: Sample>(
    samples: &[S],
    channels: usize,
    is_lossy: bool,
) -> Result<MaskPlane<S>, MaskError> {
    let pixels = || samples.chunks_exact(channels);
    let alpha: Vec<S> = pixels().map(|pixel| pixel[channels - 1]).collect();
    let is_constant = alpha.iter().all(|&value| value == alpha[0]);
    if !is_constant {
        return if has_mask_in_opaque(samples, channels) {
            Err(MaskError::TwoMasks)
        } else {
            Ok(MaskPlane::Alpha(alpha))
        };
    }
    if alpha[0].into() == 0 {
        // A cut-out of nothing.
        let is_one_colour = pixels().all(|pixel| *pixel == samples[..channels]);
        return if is_one_colour { Ok(MaskPlane::Alpha(alpha)) } else { Err(MaskError::Transparent) };
    }
    let grey = |pixel: &[S]| pixel[0];
    Ok(MaskPlane::Colours(match channels {
        2 => pixels().map(grey).collect(),
        _ => colour::greys(samples, channels, is_lossy)?,
    }))
}

/// Whether opaque pixels are a mask in their colours, black and one other, or black and white with few greys between:
/// then alpha contradicts it. Of a picture that is cut out opaque pixels have more colours, and of a silhouette one.
fn has_mask_in_opaque<S: Sample>(samples: &[S], channels: usize) -> bool {
    let colours = channels - 1;
    let is_all = |colour: &[S], value: u32| colour.iter().all(|&channel| channel.into() == value);
    let (mut opaque, mut black, mut white, mut other) = (0, 0, 0, None);
    let mut has_two_colours = true;
    for pixel in samples.chunks_exact(channels).filter(|pixel| pixel[colours] == S::MAX) {
        let colour = &pixel[..colours];
        opaque += 1;
        if is_all(colour, 0) {
            black += 1;
            continue;
        }
        white += usize::from(is_all(colour, S::MAX.into()));
        has_two_colours &= *other.get_or_insert(colour) == colour;
    }
    if has_two_colours {
        return black > 0 && other.is_some();
    }
    // One percent of each, and a tenth between them.
    10 * (black + white) >= 9 * opaque && 100 * black.min(white) >= opaque
}
