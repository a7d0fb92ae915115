//! Foreground or not, one row of pixels at a time, in integers (Cheung et al. 2000).

use crate::settings::SegmentSettings;

/// Squared cosines are in units of 2⁻²⁰: the squared dot product has 36 bits, both fit in 64.
const COSINE_BITS: u32 = 20;

/// Shares of brightness are in units of 1/1024.
const SHARE_ONE: f64 = 1024.0;

/// Of the pixels between the thresholds: which are shadows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ShadowTest {
    cosine_squared: u64,
    darkest: u32,
    brightest: u32,
    dark_squared: u32,
}

impl ShadowTest {
    pub(crate) fn new(settings: &SegmentSettings) -> ShadowTest {
        ShadowTest {
            cosine_squared: (settings.shadow_cosine.powi(2) * f64::from(1 << COSINE_BITS)).round() as u64,
            darkest: (settings.shadow_darkest * SHARE_ONE).round() as u32,
            brightest: (settings.glow_brightest * SHARE_ONE).round() as u32,
            dark_squared: settings.dark.powi(2).round() as u32,
        }
    }

    /// True if the colour is the background's own, darker but not black, or a little brighter.
    fn is_shadow(self, colour: &[u8], background: &[u8]) -> bool {
        let dot =
            |a: &[u8], b: &[u8]| -> u32 { a.iter().zip(b).map(|(&a, &b)| u32::from(a) * u32::from(b)).sum() };
        let (own, back) = (dot(colour, colour), dot(background, background));
        let both = dot(colour, background);
        if own < self.dark_squared || back < self.dark_squared {
            return false;
        }
        let share = u64::from(both) << 10;
        let lit = share >= u64::from(self.darkest) * u64::from(back)
            && share <= u64::from(self.brightest) * u64::from(back);
        let aligned = (u64::from(both).pow(2) << COSINE_BITS)
            >= self.cosine_squared * (u64::from(own) * u64::from(back));
        lit && aligned
    }
}

/// A row of the background with its thresholds; `mean` holds RGB triples.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BackgroundRow<'a> {
    pub(crate) mean: &'a [u8],
    pub(crate) low: &'a [u8],
    pub(crate) high: &'a [u8],
}

/// Writes 1 for foreground pixels and 0 for others; `squares` is room for one value per level.
pub(crate) fn test_against_background(
    rgb: &[u8],
    background: BackgroundRow,
    shadow: ShadowTest,
    squares: &mut [u16],
    foreground: &mut [u8],
) {
    for ((square, &level), &mean) in squares.iter_mut().zip(rgb).zip(background.mean) {
        let difference = u16::from(level.abs_diff(mean));
        *square = difference * difference;
    }
    let thresholds = background.low.iter().zip(background.high);
    for ((class, squares), (&low, &high)) in
        foreground.iter_mut().zip(squares.chunks_exact(3)).zip(thresholds)
    {
        let distance_squared = u32::from(squares[0]) + u32::from(squares[1]) + u32::from(squares[2]);
        let (low, high) = (u32::from(low), u32::from(high));
        *class = u8::from(distance_squared > low * low) + u8::from(distance_squared > high * high);
    }
    // Few pixels are between the thresholds: what follows skips eight others at a time.
    for (eight_at, eight) in foreground.chunks_mut(8).enumerate() {
        if eight.iter().fold(0, |any, class| any | class) == 0 {
            continue;
        }
        for (lane, class) in eight.iter_mut().enumerate() {
            if *class == 1 {
                let at = 3 * (8 * eight_at + lane);
                let is_shadow = shadow.is_shadow(&rgb[at..at + 3], &background.mean[at..at + 3]);
                *class = u8::from(!is_shadow);
            } else {
                *class >>= 1;
            }
        }
    }
}

/// The share of green as the chroma key compares it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ChromaTest {
    green_share: u32,
}

impl ChromaTest {
    pub(crate) fn new(settings: &SegmentSettings) -> ChromaTest {
        ChromaTest { green_share: (settings.green_share * SHARE_ONE).round() as u32 }
    }

    /// Writes 1 for pixels that are not green and 0 for others.
    pub(crate) fn test(self, rgb: &[u8], foreground: &mut [u8]) {
        for (class, colour) in foreground.iter_mut().zip(rgb.chunks_exact(3)) {
            let [red, green, blue] = [colour[0], colour[1], colour[2]].map(u32::from);
            *class = u8::from((green << 10) < self.green_share * (red + green + blue));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn is_foreground(colour: [u8; 3], background: [u8; 3]) -> bool {
        let shadow = ShadowTest::new(&SegmentSettings::default());
        let row = BackgroundRow { mean: &background, low: &[20], high: &[110] };
        let mut out = [9];
        test_against_background(&colour, row, shadow, &mut [0; 3], &mut out);
        assert!(out[0] < 2);
        out[0] == 1
    }

    #[test]
    fn near_is_background_far_is_foreground_and_between_the_angle_decides() {
        let wall = [120, 140, 100];
        assert!(!is_foreground([125, 131, 104], wall), "within the low threshold");
        assert!(is_foreground([20, 200, 20], wall), "beyond the high one");
        assert!(!is_foreground([84, 98, 70], wall), "the same colour at 70 % is a shadow");
        assert!(is_foreground([98, 90, 70], wall), "another colour as dark is not");
        assert!(is_foreground([156, 182, 130], wall), "no reflection is as bright");
        assert!(is_foreground([48, 56, 40], wall), "nor as dark as 40 %");
        assert!(is_foreground([8, 8, 8], [30, 30, 30]), "too dark for an angle: one threshold");
    }

    #[test]
    fn a_weak_reflection_is_background() {
        assert!(!is_foreground([87, 89, 84], [75, 77, 73]));
        assert!(is_foreground([95, 97, 74], [75, 77, 73]), "of another colour it is none");
    }

    #[test]
    fn green_is_background_to_the_chroma_key() {
        let test = ChromaTest::new(&SegmentSettings::default());
        let mut out = [9; 4];
        test.test(&[30, 180, 60, 20, 90, 35, 200, 160, 140, 80, 80, 80], &mut out);
        assert_eq!(out, [0, 0, 1, 1], "green, green in shadow, skin, grey");
    }

    proptest! {
        #[test]
        fn integers_agree_with_the_formula(colour in any::<[u8; 3]>(), background in any::<[u8; 3]>()) {
            let length = |a: [f64; 3]| (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]).sqrt();
            let (i, b) = (colour.map(f64::from), background.map(f64::from));
            let distance = length([i[0] - b[0], i[1] - b[1], i[2] - b[2]]);
            let dot = i[0] * b[0] + i[1] * b[1] + i[2] * b[2];
            let (cosine, share) = (dot / (length(i) * length(b)), dot / length(b).powi(2));
            prop_assume!((cosine - 0.998).abs() > 1e-5 && (share - 0.5).abs().min((share - 1.2).abs()) > 1e-3);
            let shadow = length(i) >= 20.0 && length(b) >= 20.0
                && cosine > 0.998 && (0.5..=1.2).contains(&share);
            let expected = distance > 110.0 || (distance > 20.0 && !shadow);
            prop_assert_eq!(is_foreground(colour, background), expected);
        }
    }
}
