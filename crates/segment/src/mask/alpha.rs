//! Whether alpha is the mask, or the colours are.

use super::{MaskError, Sample, colour, grey};

/// So many colours beside black are class labels and not a picture.
const MOST_LABELS: usize = 32;
/// Opaque black fills at least one of so many parts where it is the background of labels.
const LABELS_BACKGROUND: usize = 10;

/// Where the mask is, as one sample a pixel.
pub(super) enum MaskPlane<S> {
    /// In the colours; alpha is constant, or opaque everywhere with noise.
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
    let is_opaque = || alpha.iter().all(|&value| value.into() >= S::MAX.into() - grey::noise(S::MAX.into()));
    if !is_constant && !is_opaque() {
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
    let first = |pixel: &[S]| pixel[0];
    Ok(MaskPlane::Colours(match channels {
        2 => pixels().map(first).collect(),
        _ => colour::greys(samples, channels, is_lossy)?,
    }))
}

/// Whether the colours of opaque pixels are masks or class labels, too: then alpha contradicts them. Opaque is the largest
/// alpha, with noise. Of a picture that is cut out opaque pixels have more colours, and of a silhouette one.
fn has_mask_in_opaque<S: Sample>(samples: &[S], channels: usize) -> bool {
    let colours = channels - 1;
    let (max, noise) = (S::MAX.into(), grey::noise(S::MAX.into()));
    let is_all = |colour: &[S], is: &dyn Fn(u32) -> bool| colour.iter().all(|&channel| is(channel.into()));
    let (mut opaque, mut black, mut near_black, mut near_white) = (0, 0, 0, 0);
    let mut others: Vec<&[S]> = Vec::new();
    let alpha = |pixel: &[S]| -> u32 { pixel[colours].into() };
    let opaque_from = samples.chunks_exact(channels).map(alpha).max().unwrap_or(max).saturating_sub(noise);
    for pixel in samples.chunks_exact(channels).filter(|pixel| alpha(pixel) >= opaque_from) {
        let colour = &pixel[..colours];
        opaque += 1;
        near_black += usize::from(is_all(colour, &|channel| channel <= noise));
        near_white += usize::from(is_all(colour, &|channel| channel >= max - noise));
        if is_all(colour, &|channel| channel == 0) {
            black += 1;
        } else if others.len() <= MOST_LABELS && !others.contains(&colour) {
            others.push(colour);
        }
    }
    match others.len() {
        0 => false,
        1 => black > 0,
        // A drawing has black lines; labels have a black background.
        2..=MOST_LABELS if LABELS_BACKGROUND * black >= opaque => true,
        // One percent of each, and a quarter between them: a mask with soft edges.
        _ => 4 * (near_black + near_white) >= 3 * opaque && 100 * near_black.min(near_white) >= opaque,
    }
}
