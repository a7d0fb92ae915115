//! What a world is made with, and why there is none.

use super::limits::LimitError;
use crate::response::ResponseMode;
use crate::samples::DEFAULT_COVERING_RADIUS_M;
use crate::scene::{FRICTION, HullSurface, RESTITUTION};
use hull::body::BodyError;
use hull::surface::HullTime;
use thiserror::Error;

/// What a run may choose about a world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldSettings {
    /// Length of a step, seconds.
    pub dt_s: f64,
    /// Decides the start poses within what the scene leaves open.
    pub seed: u64,
    /// How bodies answer the hull.
    pub response: ResponseMode,
    /// Under contacts: of which moment the hull is that a step collides with.
    pub hull_time: HullTime,
    /// The share of the speed into the hull that is mirrored: 1 is the paper's flip, 0 stops the body.
    pub mirror_restitution: f64,
    /// Coulomb friction of the hull, which is taken to be at rest: 0 is the paper's.
    pub hull_friction: f64,
    /// No surface point is farther from a sample, metres.
    pub covering_radius_m: f64,
}

impl Default for WorldSettings {
    fn default() -> Self {
        WorldSettings {
            dt_s: 1.0 / 120.0,
            seed: 1,
            response: ResponseMode::Paper,
            hull_time: HullTime::Newest,
            mirror_restitution: 0.3,
            hull_friction: 0.5,
            covering_radius_m: DEFAULT_COVERING_RADIUS_M,
        }
    }
}

impl WorldSettings {
    /// The same on a scene's own surface of the hull.
    pub fn on(self, surface: HullSurface) -> WorldSettings {
        WorldSettings { mirror_restitution: surface.restitution, hull_friction: surface.friction, ..self }
    }

    /// Whether the numbers are possible.
    pub fn check(&self) -> Result<(), WorldError> {
        for (key, found, allowed) in [
            ("dt_s", self.dt_s, 1e-4..=0.1),
            ("mirror_restitution", self.mirror_restitution, RESTITUTION),
            ("hull_friction", self.hull_friction, FRICTION),
            ("covering_radius_m", self.covering_radius_m, 0.005..=0.5),
        ] {
            if !allowed.contains(&found) {
                let (low, high) = allowed.into_inner();
                return Err(WorldError::Setting { key, found, low, high });
            }
        }
        Ok(())
    }
}

/// Why there is no world, or no step.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum WorldError {
    /// A setting out of its range.
    #[error("{key} is {found}, expected {low} to {high}")]
    Setting {
        /// Its key in the scene file.
        key: &'static str,
        /// Its value.
        found: f64,
        /// The least it may be.
        low: f64,
        /// The most it may be.
        high: f64,
    },
    /// Geometry that the solver refuses.
    #[error("body `{body}` has a hull that is no closed convex surface, expected points well apart")]
    Solid {
        /// The body's name.
        body: String,
    },
    /// Geometry that cannot be sampled.
    #[error("body `{body}`: {source}")]
    Samples {
        /// The body's name.
        body: String,
        /// What is wrong with its geometry.
        source: BodyError,
    },
    /// More than a world may hold.
    #[error(transparent)]
    Limit(#[from] LimitError),
    /// Responses for another set of bodies.
    #[error("{found} responses, expected {expected}: one per moving body")]
    ResponseCount {
        /// Number of responses.
        found: usize,
        /// How many bodies move.
        expected: usize,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_that_cannot_be_are_named() {
        let right = WorldSettings::default();
        assert_eq!(right.check(), Ok(()));
        for (wrong, message) in [
            (WorldSettings { dt_s: 0.0, ..right }, "dt_s is 0, expected 0.0001 to 0.1"),
            (WorldSettings { dt_s: f64::NAN, ..right }, "dt_s is NaN, expected 0.0001 to 0.1"),
            (
                WorldSettings { mirror_restitution: 1.5, ..right },
                "mirror_restitution is 1.5, expected 0 to 1",
            ),
            (
                WorldSettings { covering_radius_m: 0.0, ..right },
                "covering_radius_m is 0, expected 0.005 to 0.5",
            ),
        ] {
            assert_eq!(wrong.check().expect_err("wrong").to_string(), message);
        }
    }
}
