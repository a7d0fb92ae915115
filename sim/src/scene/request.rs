//! One body as a program asks for it, while the world runs.

use super::check::{Checker, DEFAULT_FRICTION, DEFAULT_RESTITUTION, FRICTION, MAX_POSITION_M, RESTITUTION};
use super::expand::PALETTE;
pub use super::file::ShapeFile as ShapeRequest;
use super::{BodySpec, SceneError};
use crate::solid::HullError;
use core::ops::RangeInclusive;
use hull::Pose;
use hull::text::{MAX_MESSAGE_CHARS, shortened};
use serde::Deserialize;
use thiserror::Error;

/// No body is given a higher speed than this, m/s: farther than its own size per step, it would pass through
/// people.
pub const MAX_SPEED_M_S: f64 = 50.0;

/// A body to spawn, with the keys of a scene's bodies and a pose of its own. Metres, kilograms, world frame;
/// nothing is checked yet.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BodyRequest {
    /// Unique in the world; without one the world gives one.
    #[serde(default)]
    pub name: Option<String>,
    /// Its geometry.
    pub shape: ShapeRequest,
    /// Where its origin is.
    pub position: [f64; 3],
    /// World from body; any length but zero, which is normalised.
    #[serde(default)]
    pub rotation_xyzw: Option<[f64; 4]>,
    /// What it begins with, m/s.
    #[serde(default)]
    pub velocity: Option<[f64; 3]>,
    /// Kilograms; instead of a density.
    #[serde(default)]
    pub mass: Option<f64>,
    /// kg/m³.
    #[serde(default)]
    pub density: Option<f64>,
    /// Coulomb friction coefficient.
    #[serde(default)]
    pub friction: Option<f64>,
    /// Share of the speed that a bounce returns.
    #[serde(default)]
    pub restitution: Option<f64>,
    /// Whether it never moves.
    #[serde(default)]
    pub fixed: bool,
    /// sRGB, 0 to 1.
    #[serde(default)]
    pub color: Option<[f64; 3]>,
}

/// Why a request makes no body, in one line.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum RequestError {
    /// No TOML, or keys or types that a request has not: what its reader says.
    #[error("{0}")]
    Text(String),
    /// A value that cannot be.
    #[error("{key}: {found}, expected {expected}")]
    Value {
        /// Which key.
        key: String,
        /// Its value.
        found: String,
        /// What would be right.
        expected: String,
    },
    /// Points that have no convex hull.
    #[error("shape.hull.points: {0}")]
    Hull(HullError),
}

impl BodyRequest {
    /// The request of a TOML text with these keys.
    pub fn from_toml(text: &str) -> Result<BodyRequest, RequestError> {
        toml::from_str(text).map_err(|error| {
            let message = error.message().lines().collect::<Vec<_>>().join(", ");
            RequestError::Text(shortened(&message, MAX_MESSAGE_CHARS))
        })
    }

    /// The body, if all its numbers can be: the same checks as a scene's bodies get.
    pub fn check(self) -> Result<BodySpec, RequestError> {
        let checker = Checker { scene: "" };
        self.checked(&checker).map_err(|error| match error {
            SceneError::Value { key, found, expected, .. } => RequestError::Value { key, found, expected },
            SceneError::Hull { problem, .. } => RequestError::Hull(problem),
            other => RequestError::Text(other.to_string()),
        })
    }

    fn checked(self, checker: &Checker<'_>) -> Result<BodySpec, SceneError> {
        let name = self.name.unwrap_or_default();
        if name.chars().any(char::is_control) || name.len() > 100 {
            return Err(checker.wrong("name", format!("{name:?}"), "at most 100 printable characters"));
        }
        let all = |key: &str, numbers: &[f64], allowed: RangeInclusive<f64>| {
            numbers.iter().try_for_each(|&number| checker.within(key, number, allowed.clone()).map(drop))
        };
        all("position", &self.position, -MAX_POSITION_M..=MAX_POSITION_M)?;
        let velocity_m_s = self.velocity.unwrap_or_default();
        speed(velocity_m_s).ok_or_else(|| {
            checker.wrong("velocity", format!("{velocity_m_s:?}"), format!("at most {MAX_SPEED_M_S} m/s"))
        })?;
        all("color", &self.color.unwrap_or_default(), 0.0..=1.0)?;
        let rotation_xyzw = self.rotation_xyzw.unwrap_or([0.0, 0.0, 0.0, 1.0]);
        let pose = Pose::new(self.position, rotation_xyzw).map_err(|_| {
            checker.wrong("rotation_xyzw", format!("{rotation_xyzw:?}"), "a quaternion other than zero")
        })?;
        let solid = checker.solid("", self.shape)?;
        let color = self.color.map_or(PALETTE[solid.kind().len() % PALETTE.len()], |c| c.map(|c| c as f32));
        Ok(BodySpec {
            pose,
            velocity_m_s,
            mass: checker.mass("", self.mass, self.density)?,
            friction: checker.within("friction", self.friction.unwrap_or(DEFAULT_FRICTION), FRICTION)?,
            restitution: checker.within(
                "restitution",
                self.restitution.unwrap_or(DEFAULT_RESTITUTION),
                RESTITUTION,
            )?,
            fixed: self.fixed,
            color,
            solid,
            name,
        })
    }
}

/// The speed of a velocity; `None` beyond [`MAX_SPEED_M_S`], or without numbers.
pub(crate) fn speed(velocity_m_s: [f64; 3]) -> Option<f64> {
    let speed_m_s = nalgebra::Vector3::from(velocity_m_s).norm();
    (speed_m_s <= MAX_SPEED_M_S).then_some(speed_m_s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{MassSpec, Solid};

    fn error_of(text: &str) -> String {
        let error = BodyRequest::from_toml(text).and_then(BodyRequest::check).expect_err(text).to_string();
        assert_eq!(error.lines().count(), 1, "{error}");
        error
    }

    const BALL: &str = "shape.ball.radius = 0.1\nposition = [0, 1, 0]\n";

    #[test]
    fn a_request_needs_a_shape_and_a_place() {
        let body = BodyRequest::from_toml(BALL).and_then(BodyRequest::check).expect("a body");
        assert_eq!((body.solid, body.mass), (Solid::Ball { radius_m: 0.1 }, MassSpec::DensityKgM3(120.0)));
        assert_eq!((body.name.as_str(), body.velocity_m_s, body.fixed), ("", [0.0; 3], false));
        assert!(error_of("position = [0, 1, 0]").contains("missing field `shape`"));
        assert!(error_of("shape.ball.radius = 0.1").contains("missing field `position`"));
        assert!(error_of(&format!("{BALL}size = 3")).contains("unknown field `size`"));
    }

    #[test]
    fn numbers_that_cannot_be_are_named() {
        let long = "x".repeat(60_000);
        for keys in [format!("name = '{long}'"), format!("{long} = 1"), format!("color = '{long}'")] {
            assert!(error_of(&format!("{BALL}{keys}")).len() < 400, "{keys}");
        }
        for (keys, expected) in [
            ("velocity = [0, 60, 0]", "velocity: [0.0, 60.0, 0.0], expected at most 50 m/s"),
            ("velocity = [0, nan, 0]", "velocity: [0.0, NaN, 0.0], expected at most 50 m/s"),
            ("mass = 0", "mass: 0, expected a number from 0.001 to 10000"),
            ("mass = 1\ndensity = 1", "mass: mass and density, expected one of the two"),
            ("color = [0, 2, 0]", "color: 2, expected a number from 0 to 1"),
            (
                "rotation_xyzw = [0, 0, 0, 0]",
                "rotation_xyzw: [0.0, 0.0, 0.0, 0.0], expected a quaternion other than zero",
            ),
        ] {
            assert_eq!(error_of(&format!("{BALL}{keys}")), expected);
        }
        assert_eq!(
            error_of("shape.box.size = [0.1, 9, 0.1]\nposition = [0, 0, 0]"),
            "shape.box.size: 9, expected a number from 0.01 to 5"
        );
        assert_eq!(
            error_of("shape.ball.radius = 0.1\nposition = [0, inf, 0]"),
            "position: inf, expected a number from -1000 to 1000"
        );
        assert_eq!(
            error_of("shape.hull.points = [[0, 0, 0]]\nposition = [0, 0, 0]"),
            "shape.hull.points: 1 points, expected 4 to 256"
        );
    }
}
