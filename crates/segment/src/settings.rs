//! What can be set, its defaults and its ranges.

use serde::Deserialize;
use thiserror::Error;

/// How foreground is distinguished from background.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// By the difference to a model of the empty room.
    #[default]
    Difference,
    /// By not being green; needs no model.
    Chroma,
}

/// Which change of exposure between model and frame is taken out before they are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum GainMode {
    /// None: exposure and white balance are fixed.
    Off,
    /// One factor per frame for all channels: exposure drifts.
    Brightness,
    /// One factor per frame and channel: white balance drifts too.
    #[default]
    Colour,
}

/// Settings of a segmenter, as they stand in a cluster file; every key may be left out.
///
/// Levels are 0 to 255 per channel, distances between colours Euclidean over the three channels
/// (so up to 441). Lengths and areas in pixels that are left out scale with the image.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SegmentSettings {
    /// Difference to a background, or chroma key.
    pub method: Method,
    /// Colour distance under which a pixel is background; left out, it is estimated from the noise
    /// of the empty clip. Per pixel it rises with `sigma_factor` and `edge_px`.
    pub low: Option<f64>,
    /// Colour distance over which a pixel is foreground, whatever its colour angle.
    pub high: f64,
    /// The low threshold is at least so many deviations of the pixel.
    pub sigma_factor: f64,
    /// Shake of the camera or error of the picture that contours of the background must bear, pixels: the
    /// low threshold is at least the change of the background over that distance.
    pub edge_px: f64,
    /// Cosine of the colour angle from which a darker pixel is the same surface in shadow.
    pub shadow_cosine: f64,
    /// The darkest shadow: the share of the background's brightness that it leaves.
    pub shadow_darkest: f64,
    /// The brightest reflection of a person or lamp on a surface that is still background, as a
    /// share of the background's brightness; 1 lets surfaces only darken.
    pub glow_brightest: f64,
    /// Colours shorter than this have no angle worth measuring: one threshold, the low one, decides.
    pub dark: f64,
    /// Which changes of exposure are taken out.
    pub gain: GainMode,
    /// Chroma key: a pixel is foreground if green is less than this share of red + green + blue.
    pub green_share: f64,
    /// Side of the square that foreground must hold not to be noise, pixels; 1 leaves all. Left out, it also
    /// depends on the frame: where there is hardly any noise, shapes are not rounded off.
    pub open_px: Option<u32>,
    /// Side of the square that gaps must hold to stay open, pixels; 1 leaves all. Left out, it also depends on
    /// the frame, as `open_px` does.
    pub close_px: Option<u32>,
    /// Connected foreground of fewer pixels is removed.
    pub speck_px: Option<u32>,
    /// Enclosed background of at most so many pixels is filled. Left out, it also depends on the frame's noise.
    pub hole_px: Option<u32>,
    /// Only so many pieces are kept, the largest; left out, all are.
    pub keep_largest: Option<u32>,
    /// For `keep_largest`, pieces with a gap of fewer pixels between them count as one: a person
    /// whose belt is as black as the wall behind is still one person.
    pub join_px: Option<u32>,
}

impl Default for SegmentSettings {
    fn default() -> SegmentSettings {
        SegmentSettings {
            method: Method::Difference,
            low: None,
            high: 110.0,
            sigma_factor: 3.0,
            edge_px: 0.25,
            shadow_cosine: 0.998,
            shadow_darkest: 0.5,
            glow_brightest: 1.2,
            dark: 20.0,
            gain: GainMode::Colour,
            green_share: 0.42,
            open_px: None,
            close_px: None,
            speck_px: None,
            hole_px: None,
            keep_largest: None,
            join_px: None,
        }
    }
}

/// A setting out of its range.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("{key} is {found}, expected {expected}")]
pub struct SettingsError {
    /// The key.
    pub key: &'static str,
    /// Its value.
    pub found: f64,
    /// What it may be.
    pub expected: &'static str,
}

/// The longest side of a cleaning square: beyond it, it is no noise that is cleaned.
const MAX_SQUARE_PX: u32 = 64;

/// The widest gap that can be bridged.
const MAX_JOIN_PX: u32 = 1024;

impl SegmentSettings {
    /// Settings within their ranges, or the first key that is not.
    pub fn validate(&self) -> Result<(), SettingsError> {
        let within = |key, found: f64, least: f64, most: f64, expected| {
            let good = (least..=most).contains(&found);
            if good { Ok(()) } else { Err(SettingsError { key, found, expected }) }
        };
        if let Some(low) = self.low {
            within("low", low, 1.0, 255.0, "1 to 255")?;
        }
        within("high", self.high, 1.0, 255.0, "1 to 255")?;
        if self.low.is_some_and(|low| low > self.high) {
            return Err(SettingsError { key: "high", found: self.high, expected: "at least `low`" });
        }
        within("sigma_factor", self.sigma_factor, 0.0, 100.0, "0 to 100")?;
        within("edge_px", self.edge_px, 0.0, 16.0, "0 to 16")?;
        within("shadow_cosine", self.shadow_cosine, 0.0, 1.0, "0 to 1")?;
        within("shadow_darkest", self.shadow_darkest, 0.0, 1.0, "0 to 1")?;
        within("glow_brightest", self.glow_brightest, 1.0, 4.0, "1 to 4")?;
        within("dark", self.dark, 0.0, 441.0, "0 to 441")?;
        within("green_share", self.green_share, 0.0, 1.0, "0 to 1")?;
        for (key, side) in [("open_px", self.open_px), ("close_px", self.close_px)] {
            let side = f64::from(side.unwrap_or(1));
            within(key, side, 1.0, f64::from(MAX_SQUARE_PX), "1 to 64")?;
        }
        let join = f64::from(self.join_px.unwrap_or(1));
        within("join_px", join, 1.0, f64::from(MAX_JOIN_PX), "1 to 1024")?;
        if self.keep_largest == Some(0) {
            return Err(SettingsError { key: "keep_largest", found: 0.0, expected: "at least 1" });
        }
        Ok(())
    }

    /// What clean-up does on an image of that size.
    pub(crate) fn cleanup(&self, width: u32, height: u32) -> Cleanup {
        let pixels = u64::from(width) * u64::from(height);
        let long = u64::from(width.max(height));
        // Noise grows slower than the image, gaps between limbs as fast as it.
        let side =
            |set: Option<u32>, auto: u64| set.map_or(auto.clamp(1, MAX_SQUARE_PX.into()), u64::from) as usize;
        // At 640 x 480 a speck is under 150 pixels, half a hand, and a hole up to 300: a hole in one
        // camera bores through the hull, a speck is cut off by the other cameras.
        let area = |set: Option<u32>, auto: u64| set.unwrap_or(auto as u32);
        Cleanup {
            adapts: [self.open_px, self.close_px, self.hole_px].map(|set| set.is_none()),
            open_px: side(self.open_px, 1 + (long + 320) / 640),
            close_px: side(self.close_px, (4 * long + 320) / 640),
            speck_px: area(self.speck_px, pixels / 2048),
            hole_px: area(self.hole_px, pixels / 1024),
            join_px: self.join_px.map_or(long / 40, u64::from).max(1) as usize,
            keep: self.keep_largest.map(|keep| keep as usize),
        }
    }
}

/// Clean-up with its lengths and areas in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Cleanup {
    /// Whether opening, closing and holes also follow from the frame's noise.
    pub(crate) adapts: [bool; 3],
    pub(crate) open_px: usize,
    pub(crate) close_px: usize,
    pub(crate) speck_px: u32,
    pub(crate) hole_px: u32,
    pub(crate) join_px: usize,
    pub(crate) keep: Option<usize>,
}

/// Shares of the foreground that opening takes: under the first, a frame is clean (the studio's lose some
/// thousandths), over the second it is as noisy as film of real rooms, which loses 3 to 16 %.
const NOISE_SHARES: std::ops::Range<f64> = 0.005..0.02;

/// Of a clean frame, only holes so many times smaller are taken for noise.
const CLEAN_HOLES: f64 = 8.0;

impl Cleanup {
    /// For a frame whose opening by `open_px` left so many of its foreground pixels.
    pub(crate) fn adapted(self, raw_px: u64, opened_px: u64) -> Cleanup {
        let taken = raw_px.saturating_sub(opened_px) as f64 / raw_px.max(1) as f64;
        let noise = ((taken - NOISE_SHARES.start) / (NOISE_SHARES.end - NOISE_SHARES.start)).clamp(0.0, 1.0);
        let [opens, closes, holes] = self.adapts;
        let side = |adapts: bool, side: usize| {
            if adapts { 1 + ((side - 1) as f64 * noise).round() as usize } else { side }
        };
        let hole_px = (f64::from(self.hole_px) * noise.max(1.0 / CLEAN_HOLES)).round() as u32;
        Cleanup {
            open_px: side(opens, self.open_px),
            close_px: side(closes, self.close_px),
            hole_px: if holes { hole_px } else { self.hole_px },
            ..self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clean_frames_keep_their_shapes_and_lengths_that_are_set_are_kept() {
        let at = |settings: &SegmentSettings, opened_px| {
            let adapted = settings.cleanup(1920, 1080).adapted(100_000, opened_px);
            (adapted.open_px, adapted.close_px, adapted.speck_px, adapted.hole_px)
        };
        let default = SegmentSettings::default();
        assert_eq!(at(&default, 99_900), (1, 1, 1012, 253));
        assert_eq!(at(&default, 98_750), (3, 7, 1012, 1013));
        assert_eq!(at(&default, 95_000), (4, 12, 1012, 2025));
        let set = SegmentSettings { open_px: Some(5), hole_px: Some(7), ..default };
        assert_eq!(at(&set, 100_000), (5, 1, 1012, 7));
    }

    #[test]
    fn an_empty_table_is_the_default() {
        assert_eq!(toml::from_str::<SegmentSettings>("").expect("empty"), SegmentSettings::default());
        SegmentSettings::default().validate().expect("defaults are within range");
    }

    #[test]
    fn keys_are_read_and_unknown_ones_refused() {
        let settings: SegmentSettings =
            toml::from_str("method = \"chroma\"\ngain = \"off\"\nlow = 18\nkeep_largest = 2").expect("keys");
        assert_eq!((settings.method, settings.gain), (Method::Chroma, GainMode::Off));
        assert_eq!((settings.low, settings.keep_largest), (Some(18.0), Some(2)));
        let error = toml::from_str::<SegmentSettings>("hihg = 100").expect_err("a slip").to_string();
        assert!(error.contains("hihg") && error.contains("high"), "{error}");
    }

    #[test]
    fn values_out_of_range_are_named() {
        let error = |text: &str| {
            let settings: SegmentSettings = toml::from_str(text).expect("well formed");
            settings.validate().expect_err(text).to_string()
        };
        assert_eq!(error("high = 300.0"), "high is 300, expected 1 to 255");
        assert_eq!(error("low = 60.0\nhigh = 50.0"), "high is 50, expected at least `low`");
        assert_eq!(error("shadow_cosine = nan"), "shadow_cosine is NaN, expected 0 to 1");
        assert_eq!(error("open_px = 65"), "open_px is 65, expected 1 to 64");
        assert_eq!(error("keep_largest = 0"), "keep_largest is 0, expected at least 1");
    }

    #[test]
    fn cleaning_scales_with_the_image() {
        let at = |width, height| SegmentSettings::default().cleanup(width, height);
        assert_eq!((at(640, 480).open_px, at(640, 480).close_px, at(640, 480).hole_px), (2, 4, 300));
        assert_eq!((at(1080, 1920).open_px, at(1080, 1920).close_px, at(1080, 1920).hole_px), (4, 12, 2025));
    }
}
