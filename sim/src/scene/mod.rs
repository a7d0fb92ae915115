//! What a world starts from: gravity, a floor and bodies, read from a TOML file.
//!
//! ```toml
//! gravity = [0.0, -9.81, 0.0]        # m/s², the default; up is against it
//! [floor]                            # the default; `enabled = false` for none
//! height = 0.0                       # along up, metres
//! friction = 0.8
//! restitution = 0.1
//! [hull]                             # the person's surface; restitution 1 and friction 0 are the
//! restitution = 0.3                  # paper's words taken literally
//! friction = 0.5
//! reuse_within_m = 0.0               # steps that share a film frame do not ask again about a body that
//!                                    # moved at most so far from where it was clear, or was made so by
//!                                    # its response: no deeper sample is missed; 0: only where nothing moved
//! [stage]                            # for the program that builds the synthetic studio
//! motion = "punch"
//! props = ["table"]                  # table, box, tray
//! person = true
//! [[bodies]]
//! name = "box"                       # of several: box_0, box_1 …
//! shape.box.size = [0.28, 0.28, 0.28] # or ball.radius; capsule.radius, .length; cylinder or
//!                                    # cone.radius, .height; hull.points = [[x, y, z], …]
//! count = 4
//! place.stack.foot = [-0.5, 0.0, 0.5] # or at = centre; pile or rain = { foot, radius, spacing }
//! rotation_deg = [0.0, 30.0, 0.0]    # axis × angle
//! density = 120.0                    # kg/m³, or mass = kg
//! friction = 0.6
//! restitution = 0.1
//! fixed = false                      # true: never moves, and the hull is not asked about it
//! color = [0.8, 0.3, 0.2]            # sRGB, 0 to 1
//! ```

mod check;
mod expand;
mod file;
mod request;

pub use check::{FRICTION, RESTITUTION};
pub(crate) use check::{MAX_GRAVITY_M_S2, MAX_NUMBERED_BYTES, MAX_POSITION_M, all_within, within, wrong};
pub(crate) use request::check_speed;
pub use request::{BodyRequest, MAX_SPEED_M_S, ShapeRequest};

use crate::solid::{HullError, Solid};
use hull::Pose;
use hull::text::{MAX_QUOTED_CHARS, shortened};
use nalgebra::Vector3;
use serde::Deserialize;
use std::sync::Arc;
use thiserror::Error;

/// The most bodies one scene may have.
pub const MAX_BODIES: usize = 1000;

/// The scenes that come with the program: name and text.
const SHIPPED: [(&str, &str); 9] = [
    ("topple", include_str!("../../scenes/topple.toml")),
    ("lift", include_str!("../../scenes/lift.toml")),
    ("crowd", include_str!("../../scenes/crowd.toml")),
    ("rest", include_str!("../../scenes/rest.toml")),
    ("tray", include_str!("../../scenes/tray.toml")),
    ("push", include_str!("../../scenes/push.toml")),
    ("punch", include_str!("../../scenes/punch.toml")),
    ("drops", include_str!("../../scenes/drops.toml")),
    ("squeeze", include_str!("../../scenes/squeeze.toml")),
];

/// Why there is no scene. Every message is one line.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum SceneError {
    /// No shipped scene has this name.
    #[error("no scene is called `{found}`, expected one of {expected}")]
    Name {
        /// The name that was asked for.
        found: String,
        /// The names there are.
        expected: String,
    },
    /// The text is no TOML, or has keys or types that a scene has not.
    #[error("scene {scene}, line {line} (`{text}`): {problem}")]
    Text {
        /// The scene's name.
        scene: String,
        /// Where, counted from 1.
        line: usize,
        /// That line.
        text: String,
        /// What was found and expected.
        problem: String,
    },
    /// A value that cannot be.
    #[error("scene {scene}, {problem}")]
    Value {
        /// The scene's name.
        scene: String,
        /// The value, and why it cannot be.
        problem: ValueError,
    },
}

/// A value of a scene, a body or a command that cannot be.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ValueError {
    /// A number or a name.
    #[error("{key}: {found}, expected {expected}")]
    Value {
        /// Which key of which table.
        key: String,
        /// Its value.
        found: String,
        /// What would be right.
        expected: String,
    },
    /// Points that have no convex hull.
    #[error("{key}: {problem}")]
    Hull {
        /// Where they stand.
        key: String,
        /// What was found and expected.
        problem: HullError,
    },
}

/// A floor: the half of space below a height along up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Floor {
    /// Height along up, metres.
    pub height_m: f64,
    /// Coulomb friction coefficient.
    pub friction: f64,
    /// Share of the speed that a bounce returns.
    pub restitution: f64,
}

/// How the hull's surface takes a body that runs into it.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HullSurface {
    /// The share of the speed into the hull that is mirrored: 1 is the paper's flip, 0 stops the body.
    pub restitution: f64,
    /// Coulomb friction coefficient: 0 is the paper's.
    pub friction: f64,
    /// Steps that share a film frame do not ask again about a body while none of its samples can be farther
    /// than this, metres, from where it was outside the hull: no sample deeper than this is ever missed. 0:
    /// only a body in the very same pose is not asked about again.
    pub reuse_within_m: f64,
}

/// What the scene asks of a synthetic studio; this crate only carries it.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StageHint {
    /// What the actor does; empty: what the studio likes.
    pub motion: String,
    /// Real things in the room.
    pub props: Vec<String>,
    /// Whether the actor is there.
    pub person: bool,
}

impl Default for StageHint {
    fn default() -> StageHint {
        StageHint { motion: String::new(), props: Vec::new(), person: true }
    }
}

/// How heavy a body is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MassSpec {
    /// The mass, kilograms.
    MassKg(f64),
    /// Kilograms per cubic metre.
    DensityKgM3(f64),
}

/// One body as it starts.
#[derive(Clone, Debug, PartialEq)]
pub struct BodySpec {
    /// Unique in the scene.
    pub name: String,
    /// Its geometry.
    pub solid: Solid,
    /// Where it starts, world from body.
    pub pose: Pose,
    /// What it starts with, m/s.
    pub velocity_m_s: [f64; 3],
    /// How heavy it is.
    pub mass: MassSpec,
    /// Coulomb friction coefficient.
    pub friction: f64,
    /// Share of the speed that a bounce returns.
    pub restitution: f64,
    /// Whether it never moves; the hull is not asked about such bodies.
    pub fixed: bool,
    /// sRGB, 0 to 1.
    pub color: [f32; 3],
}

/// A checked scene. Bodies get their start poses from a seed: [`Scene::bodies`].
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    name: String,
    text: Arc<str>,
    gravity_m_s2: [f64; 3],
    floor: Option<Floor>,
    hull: HullSurface,
    stage: Option<StageHint>,
    groups: Vec<Group>,
}

/// Bodies of one kind, as one table of the file gives them.
#[derive(Clone, Debug, PartialEq)]
struct Group {
    name: String,
    count: usize,
    solid: Solid,
    place: Place,
    rotation_deg: Option<[f64; 3]>,
    mass: MassSpec,
    friction: f64,
    restitution: f64,
    fixed: bool,
    color: Option<[f32; 3]>,
}

/// Where a group's bodies start.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Place {
    /// The origin of the one body.
    At { origin_m: [f64; 3] },
    /// Upon one another; the lowest stands on the foot.
    Stack { foot_m: [f64; 3], gap_m: f64 },
    /// In the air over a disc, each as low as others leave room, and at least `spacing_m` higher per
    /// body: a pile without spacing, rain with.
    Column { foot_m: [f64; 3], radius_m: f64, spacing_m: f64 },
}

impl Scene {
    /// The names of the scenes that come with the program.
    pub fn names() -> impl Iterator<Item = &'static str> {
        SHIPPED.iter().map(|(name, _)| *name)
    }

    /// A scene that comes with the program; the error lists them.
    pub fn named(name: &str) -> Result<Scene, SceneError> {
        match SHIPPED.iter().find(|(shipped, _)| *shipped == name) {
            Some((name, text)) => Scene::from_toml(name, text),
            None => {
                let expected = Scene::names().collect::<Vec<_>>().join(", ");
                Err(SceneError::Name { found: shortened(name, MAX_QUOTED_CHARS), expected })
            }
        }
    }

    /// The scene of a TOML text; `name` stands in error messages.
    pub fn from_toml(name: &str, text: &str) -> Result<Scene, SceneError> {
        let text = hull::text::without_mark(text);
        let file = file::parse(name, text)?;
        check::scene(name, text, file).map_err(|problem| SceneError::Value { scene: name.into(), problem })
    }

    /// The same scene under another gravity, m/s², for rigs whose world has another up. Positions stay.
    pub fn with_gravity(self, gravity_m_s2: [f64; 3]) -> Result<Scene, SceneError> {
        match check::gravity(gravity_m_s2) {
            Ok(gravity_m_s2) => Ok(Scene { gravity_m_s2, ..self }),
            Err(problem) => Err(SceneError::Value { scene: self.name, problem }),
        }
    }

    /// The name it was read under.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The TOML text it was read from: with its gravity, all that it is.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// A digest of all that it is: its name, its text and its gravity.
    pub fn digest(&self) -> [u8; 32] {
        let mut hasher = blake3::Hasher::new();
        for text in [&self.name[..], &self.text] {
            hasher.update(&(text.len() as u64).to_le_bytes()).update(text.as_bytes());
        }
        for part in self.gravity_m_s2 {
            hasher.update(&part.to_bits().to_le_bytes());
        }
        hasher.finalize().into()
    }

    /// Gravity, m/s².
    pub fn gravity_m_s2(&self) -> [f64; 3] {
        self.gravity_m_s2
    }

    /// The unit vector against gravity; +Y where there is none.
    pub fn up(&self) -> [f64; 3] {
        Vector3::from(self.gravity_m_s2).try_normalize(0.0).map_or([0.0, 1.0, 0.0], |down| (-down).into())
    }

    /// The floor, if any.
    pub fn floor(&self) -> Option<Floor> {
        self.floor
    }

    /// How the hull's surface takes bodies.
    pub fn hull(&self) -> HullSurface {
        self.hull
    }

    /// What it asks of a synthetic studio, if anything.
    pub fn stage(&self) -> Option<&StageHint> {
        self.stage.as_ref()
    }

    /// Every body where it starts, in the file's order. The seed moves bodies that were placed by half
    /// a millimetre and turns them by under a degree about up; it decides where those of piles and rain
    /// start. Fixed bodies stand where the file says.
    pub fn bodies(&self, seed: u64) -> Vec<BodySpec> {
        expand::bodies(self, seed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hulls_surface_can_be_the_papers() {
        let text = "[hull]\nrestitution = 1.0\nfriction = 0\n[[bodies]]\nname = \"b\"\nshape.ball.radius = 0.1\nplace.at = [0, 1, 0]\n";
        let scene = Scene::from_toml("s", text).expect("a scene");
        assert_eq!(scene.hull(), HullSurface { restitution: 1.0, friction: 0.0, reuse_within_m: 0.0 });
        let error = Scene::from_toml("s", &text.replace("1.0", "1.5")).expect_err("too much").to_string();
        assert!(error.contains("hull.restitution") && error.contains("1.5"), "{error}");
        let reusing = |reuse_m: f64| {
            Scene::from_toml("s", &text.replace("friction = 0", &format!("reuse_within_m = {reuse_m:?}")))
        };
        assert_eq!(reusing(0.01).expect("a scene").hull().reuse_within_m, 0.01);
        let error = reusing(0.2).expect_err("too far").to_string();
        assert!(error.contains("hull.reuse_within_m: 0.2, expected a number from 0 to 0.1"), "{error}");
    }

    #[test]
    fn shipped_scenes_are_scenes() {
        for name in Scene::names() {
            let scene = Scene::named(name).expect("a shipped scene is right");
            assert_eq!(scene.name(), name);
            let has_motion = |stage: &StageHint| !stage.motion.is_empty() || !stage.person;
            assert!(scene.stage().is_some_and(has_motion), "{name} has no motion");
            assert!(scene.bodies(1).iter().any(|body| !body.fixed), "{name}");
        }
        assert_eq!(Scene::named("crowd").expect("crowd").bodies(1).len(), 40);
        assert_eq!(Scene::named("topple").expect("topple").bodies(1).len(), 12);
    }

    #[test]
    fn the_large_crowd_has_two_hundred_bodies_and_sixty_thousand_samples() {
        let scene =
            Scene::from_toml("crowd_200", include_str!("../../scenes/crowd_200.toml")).expect("a scene");
        let bodies = scene.bodies(1);
        let samples = |body: &BodySpec| {
            let shape = crate::samples::shape(&body.solid, crate::samples::DEFAULT_COVERING_RADIUS_M);
            shape.expect("few samples").samples_body().len()
        };
        let samples: usize = bodies.iter().map(samples).sum();
        assert_eq!((bodies.len(), samples), (200, 59_980));
    }

    #[test]
    fn an_unknown_name_is_told_the_names_there_are() {
        let error = Scene::named("tople").expect_err("no such scene").to_string();
        assert_eq!(
            error,
            "no scene is called `tople`, expected one of topple, lift, crowd, rest, tray, push, punch, drops, squeeze"
        );
        let error = Scene::named(&"x".repeat(60_000)).expect_err("no such scene").to_string();
        assert!(error.len() < 200, "{error}");
    }

    #[test]
    fn up_is_against_gravity() {
        let scene = Scene::from_toml("empty", "").expect("nothing is needed");
        assert_eq!((scene.gravity_m_s2(), scene.up()), ([0.0, -9.81, 0.0], [0.0, 1.0, 0.0]));
        assert_eq!(scene.floor().map(|floor| floor.height_m), Some(0.0));
        let turned = scene.with_gravity([0.0, 0.0, -9.81]).expect("finite");
        assert_eq!(turned.up(), [0.0, 0.0, 1.0]);
        let weightless = turned.with_gravity([0.0; 3]).expect("finite");
        assert_eq!(weightless.up(), [0.0, 1.0, 0.0]);
        assert!(weightless.with_gravity([0.0, f64::NAN, 0.0]).is_err());
    }
}
