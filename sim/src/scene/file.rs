//! The scene file's keys as serde reads them; `check` gives them meaning.

use super::{HullSurface, SceneError, StageHint};
use hull::text::{MAX_MESSAGE_CHARS, MAX_QUOTED_CHARS, shortened};
use serde::Deserialize;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SceneFile {
    pub gravity: Option<[f64; 3]>,
    #[serde(default)]
    pub floor: FloorFile,
    #[serde(default)]
    pub hull: HullSurface,
    pub stage: Option<StageHint>,
    #[serde(default)]
    pub bodies: Vec<BodyFile>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct FloorFile {
    pub enabled: bool,
    pub height: f64,
    pub friction: f64,
    pub restitution: f64,
}

impl Default for FloorFile {
    fn default() -> Self {
        FloorFile { enabled: true, height: 0.0, friction: 0.8, restitution: 0.1 }
    }
}

impl Default for HullSurface {
    fn default() -> HullSurface {
        HullSurface { restitution: 0.3, friction: 0.5, reuse_within_m: 0.0 }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BodyFile {
    pub name: String,
    pub shape: ShapeFile,
    pub place: PlaceFile,
    pub count: Option<usize>,
    pub rotation_deg: Option<[f64; 3]>,
    pub mass: Option<f64>,
    pub density: Option<f64>,
    pub friction: Option<f64>,
    pub restitution: Option<f64>,
    #[serde(default)]
    pub fixed: bool,
    pub color: Option<[f64; 3]>,
}

/// A body's geometry by the keys of a scene file, metres; nothing is checked yet. The axis of what is round is
/// body Y.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum ShapeFile {
    /// Edge lengths.
    Box {
        /// Along body x, y, z.
        size: [f64; 3],
    },
    /// A ball.
    Ball {
        /// Its radius.
        radius: f64,
    },
    /// A cylinder with half balls on its ends.
    Capsule {
        /// Of cylinder and balls.
        radius: f64,
        /// From ball centre to ball centre.
        length: f64,
    },
    /// A cylinder.
    Cylinder {
        /// Its radius.
        radius: f64,
        /// From disc to disc.
        height: f64,
    },
    /// A cone, tip up.
    Cone {
        /// Of its base.
        radius: f64,
        /// From base to tip.
        height: f64,
    },
    /// The convex hull of points.
    Hull {
        /// The points, body frame.
        points: Vec<[f64; 3]>,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub(super) enum PlaceFile {
    At([f64; 3]),
    Stack {
        foot: [f64; 3],
        #[serde(default)]
        gap: f64,
    },
    Pile {
        foot: [f64; 3],
        radius: f64,
    },
    Rain {
        foot: [f64; 3],
        radius: f64,
        spacing: f64,
    },
}

/// Reads the keys; the error is one line that holds the offending one.
pub(super) fn parse(scene: &str, text: &str) -> Result<SceneFile, SceneError> {
    toml::from_str(text).map_err(|error| {
        let start = error.span().map_or(0, |span| span.start.min(text.len()));
        let before = &text.as_bytes()[..start];
        let line = before.iter().filter(|byte| **byte == b'\n').count();
        SceneError::Text {
            scene: scene.to_owned(),
            line: line + 1,
            text: shortened(text.lines().nth(line).unwrap_or_default().trim(), MAX_QUOTED_CHARS),
            problem: shortened(&error.message().lines().collect::<Vec<_>>().join(", "), MAX_MESSAGE_CHARS),
        }
    })
}
