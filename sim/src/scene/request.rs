//! One body as a program asks for it, while the world runs.

use super::check::{self, MAX_NAME_BYTES, MAX_POSITION_M};
use super::expand::PALETTE;
pub use super::file::ShapeFile as ShapeRequest;
use super::{BodySpec, ValueError};
use crate::solid::Solid;
use hull::Pose;
use serde::Deserialize;

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
    /// World from body; a quaternion of length 1, within a thousandth.
    #[serde(default)]
    pub rotation_xyzw: Option<[f64; 4]>,
    /// What it begins with, m/s.
    #[serde(default)]
    pub velocity: Option<[f64; 3]>,
    /// Kilograms; instead of a density.
    #[serde(default)]
    pub mass: Option<f64>,
    /// Density, kg/m³; instead of a mass.
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

impl BodyRequest {
    /// The body, if all its numbers can be: the same checks as a scene's bodies get.
    pub fn check(self) -> Result<BodySpec, ValueError> {
        let name = self.name.unwrap_or_default();
        if name.chars().any(char::is_control) || name.len() > MAX_NAME_BYTES {
            let expected = format_args!("at most {MAX_NAME_BYTES} bytes of printable characters");
            return Err(check::wrong("name", format_args!("{name:?}"), expected));
        }
        check::all_within("position", &self.position, -MAX_POSITION_M..=MAX_POSITION_M)?;
        let velocity_m_s = self.velocity.unwrap_or_default();
        check_speed(velocity_m_s)?;
        check::all_within("color", &self.color.unwrap_or_default(), 0.0..=1.0)?;
        let rotation_xyzw = self.rotation_xyzw.unwrap_or([0.0, 0.0, 0.0, 1.0]);
        let pose = Pose::new(self.position, rotation_xyzw).map_err(|_| {
            check::wrong("rotation_xyzw", format!("{rotation_xyzw:?}"), "a quaternion of length 1")
        })?;
        let solid = check::solid("", self.shape)?;
        let color = self.color.map_or(PALETTE[solid.kind().len() % PALETTE.len()], |c| c.map(|c| c as f32));
        Ok(BodySpec {
            pose,
            velocity_m_s,
            mass: check::mass("", self.mass, self.density)?,
            friction: check::friction("", self.friction)?,
            restitution: check::restitution("", self.restitution)?,
            fixed: self.fixed,
            color,
            solid,
            name,
        })
    }
}

impl ShapeRequest {
    /// The solid, if all its numbers can be.
    pub fn check(self) -> Result<Solid, ValueError> {
        check::solid("", self)
    }
}

/// Refuses a velocity beyond [`MAX_SPEED_M_S`], or without numbers.
pub(crate) fn check_speed(velocity_m_s: [f64; 3]) -> Result<(), ValueError> {
    if nalgebra::Vector3::from(velocity_m_s).norm() <= MAX_SPEED_M_S {
        return Ok(());
    }
    Err(check::wrong("velocity", format!("{velocity_m_s:?}"), format!("at most {MAX_SPEED_M_S} m/s")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MassSpec;

    fn request(text: &str) -> BodyRequest {
        toml::from_str(text).expect("the keys of a request")
    }

    fn error_of(text: &str) -> String {
        let error = request(text).check().expect_err(text).to_string();
        assert_eq!(error.lines().count(), 1, "{error}");
        error
    }

    const BALL: &str = "shape.ball.radius = 0.1\nposition = [0, 1, 0]\n";

    #[test]
    fn a_request_needs_a_shape_and_a_place() {
        let body = request(BALL).check().expect("a body");
        assert_eq!((body.solid, body.mass), (Solid::Ball { radius_m: 0.1 }, MassSpec::DensityKgM3(120.0)));
        assert_eq!((body.name.as_str(), body.velocity_m_s, body.fixed), ("", [0.0; 3], false));
        let refused = |text: &str| toml::from_str::<BodyRequest>(text).expect_err(text).message().to_owned();
        assert!(refused("position = [0, 1, 0]").contains("missing field `shape`"));
        assert!(refused("shape.ball.radius = 0.1").contains("missing field `position`"));
        assert!(refused(&format!("{BALL}size = 3")).contains("unknown field `size`"));
    }

    #[test]
    fn numbers_that_cannot_be_are_named() {
        let long = "x".repeat(60_000);
        assert!(error_of(&format!("{BALL}name = '{long}'")).len() < 400);
        for (keys, expected) in [
            ("velocity = [0, 60, 0]", "velocity: [0.0, 60.0, 0.0], expected at most 50 m/s"),
            ("velocity = [0, nan, 0]", "velocity: [0.0, NaN, 0.0], expected at most 50 m/s"),
            ("mass = 0", "mass: 0, expected a number from 0.001 to 10000"),
            ("mass = 1\ndensity = 1", "mass: mass and density, expected one of the two"),
            ("color = [0, 2, 0]", "color: 2, expected a number from 0 to 1"),
            (
                "rotation_xyzw = [0, 0, 0, 0]",
                "rotation_xyzw: [0.0, 0.0, 0.0, 0.0], expected a quaternion of length 1",
            ),
            (
                "rotation_xyzw = [0, 0, 0, 2]",
                "rotation_xyzw: [0.0, 0.0, 0.0, 2.0], expected a quaternion of length 1",
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
