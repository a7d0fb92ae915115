//! What it takes to be inside, and the settings of the probes.

use thiserror::Error;

/// What a camera says of a point that it does not see.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum OutOfView {
    /// Behind the camera and off its image count as outside: the paper's bounding frusta.
    #[default]
    Outside,
    /// The camera is silent there.
    Abstain,
}

/// The hull rule: a point is inside if no camera says outside and at least `min_views` say inside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HullRule {
    /// What unseen points count as.
    pub out_of_view: OutOfView,
    /// How many cameras must say inside, at least one.
    pub min_views: u32,
}

impl Default for HullRule {
    fn default() -> HullRule {
        HullRule { out_of_view: OutOfView::Outside, min_views: 2 }
    }
}

/// The half side `k` of the (2k + 1)² window in which an edge's 2D normal is averaged (paper §4.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum NormalWindow {
    /// Keeps the physical size of the paper's 5 × 5 at 640 pixels.
    #[default]
    Auto,
    /// `k` itself, pixels.
    Pixels(u32),
}

impl NormalWindow {
    /// The largest `k` that can be asked for.
    pub const MAX_PIXELS: u32 = 512;

    /// `k` for an image of that size.
    pub fn half_side_pixels(self, width: u32, height: u32) -> u32 {
        match self {
            NormalWindow::Auto => ((2 * width.max(height) + 320) / 640).max(2),
            NormalWindow::Pixels(k) => k,
        }
    }
}

/// Everything that changes an answer besides cameras and silhouettes. Made by [`ProbeSettings::new`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProbeSettings {
    rule: HullRule,
    normal_window: NormalWindow,
    max_depth_m: f64,
}

/// Which setting is out of its range.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum SettingsError {
    /// No view at all would be inside everywhere.
    #[error("min_views is 0, expected at least 1")]
    MinViews,
    /// A window without pixels, or far too large.
    #[error("normal_window is {0}, expected 1 to {max} pixels", max = NormalWindow::MAX_PIXELS)]
    NormalWindow(u32),
    /// A search depth that is none.
    #[error("max_depth is {0} m, expected more than 0 and at most 1000")]
    MaxDepth(f64),
}

impl ProbeSettings {
    /// Settings within their ranges; `max_depth_m` bounds the search for an exit.
    pub fn new(
        rule: HullRule,
        normal_window: NormalWindow,
        max_depth_m: f64,
    ) -> Result<ProbeSettings, SettingsError> {
        if rule.min_views == 0 {
            return Err(SettingsError::MinViews);
        }
        if let NormalWindow::Pixels(k) = normal_window
            && !(1..=NormalWindow::MAX_PIXELS).contains(&k)
        {
            return Err(SettingsError::NormalWindow(k));
        }
        if !(max_depth_m > 0.0 && max_depth_m <= 1000.0) {
            return Err(SettingsError::MaxDepth(max_depth_m));
        }
        Ok(ProbeSettings { rule, normal_window, max_depth_m })
    }

    /// The hull rule.
    pub fn rule(&self) -> HullRule {
        self.rule
    }

    /// The window for normals.
    pub fn normal_window(&self) -> NormalWindow {
        self.normal_window
    }

    /// How far an exit is searched, metres.
    pub fn max_depth_m(&self) -> f64 {
        self.max_depth_m
    }
}

impl Default for ProbeSettings {
    fn default() -> ProbeSettings {
        ProbeSettings { rule: HullRule::default(), normal_window: NormalWindow::Auto, max_depth_m: 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_automatic_window_keeps_its_physical_size() {
        let k = |width, height| NormalWindow::Auto.half_side_pixels(width, height);
        assert_eq!([k(320, 240), k(640, 480), k(1920, 1080), k(1080, 1920), k(7680, 4320)], [2, 2, 6, 6, 24]);
    }

    #[test]
    fn settings_out_of_range_are_refused() {
        let rule = HullRule::default();
        let none = HullRule { min_views: 0, ..rule };
        assert_eq!(ProbeSettings::new(none, NormalWindow::Auto, 1.0), Err(SettingsError::MinViews));
        assert!(ProbeSettings::new(rule, NormalWindow::Pixels(0), 1.0).is_err());
        assert!(ProbeSettings::new(rule, NormalWindow::Auto, f64::NAN).is_err());
    }
}
