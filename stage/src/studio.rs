//! What is in the studio, and when.

use hull::body::{BodyError, Pose};
use nalgebra::{Point3, Vector3};

use crate::figure;
use crate::motion::Motion;
use crate::motions;
use crate::props::Prop;
use crate::skeleton::{Joint, Skeleton};
use crate::solid::Solid;

/// All that a film of the stage depends on, beside the camera and its index.
#[derive(Clone, Debug, PartialEq)]
pub struct StageSettings {
    /// Chooses the sensor noise.
    pub seed: u64,
    /// What the person does.
    pub motion: Motion,
    /// False for the same scene without the person; props then stay where they are at time 0.
    pub person: bool,
    /// What stands there beside the person; foreground, as the person is.
    pub props: Vec<Prop>,
    /// Frames a second: frame `n` shows time `n / fps`; one that is not above zero shows the neutral pose.
    pub fps: f64,
}

impl Default for StageSettings {
    /// A person who waves, at 30 frames a second.
    fn default() -> StageSettings {
        StageSettings { seed: 1, motion: Motion::Wave, person: true, props: Vec::new(), fps: 30.0 }
    }
}

impl StageSettings {
    /// The time that a frame shows, seconds.
    pub fn time_s(&self, frame: u64) -> f64 {
        frame as f64 / self.fps
    }
}

/// The person: where each joint is at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Actor {
    motion: Motion,
}

impl Actor {
    /// The person doing `motion`.
    pub fn new(motion: Motion) -> Actor {
        Actor { motion }
    }

    /// A joint's place in the world, metres, at a time of the film, seconds.
    pub fn joint_world(&self, joint: Joint, time_s: f64) -> Point3<f64> {
        self.skeleton(time_s).joint(joint)
    }

    pub(crate) fn skeleton(self, time_s: f64) -> Skeleton {
        Skeleton::from_targets(&motions::targets(self.motion, time_s))
    }
}

/// The moving contents of the studio.
#[derive(Clone, Debug)]
pub struct Stage {
    settings: StageSettings,
}

impl Stage {
    /// The studio of these settings.
    pub fn new(settings: &StageSettings) -> Stage {
        Stage { settings: settings.clone() }
    }

    /// The settings.
    pub fn settings(&self) -> &StageSettings {
        &self.settings
    }

    /// The person, if there is one.
    pub fn actor(&self) -> Option<Actor> {
        self.settings.person.then(|| Actor::new(self.settings.motion))
    }

    /// Where a prop is at a time, seconds; see [`Prop::pose`].
    pub fn prop_pose(&self, prop: Prop, time_s: f64) -> Result<Pose, BodyError> {
        prop.pose(self.settings.motion, self.settings.person, time_s)
    }

    pub(crate) fn solids(&self, time_s: f64) -> Vec<Solid> {
        let mut solids = Vec::with_capacity(80);
        if let Some(actor) = self.actor() {
            figure::solids(&actor.skeleton(time_s), &mut solids);
        }
        for prop in &self.settings.props {
            prop.solids(self.settings.motion, self.settings.person, time_s, &mut solids);
        }
        solids
    }

    /// The least and the greatest corner of the box around all foreground at a time, world, metres; `None`
    /// if there is none.
    pub fn bounds_world(&self, time_s: f64) -> Option<(Point3<f64>, Point3<f64>)> {
        let bounds =
            self.solids(time_s).iter().map(Solid::bounds_world).reduce(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1)));
        bounds.map(|(low, high)| (Point3::from(low), Point3::from(high)))
    }
}

/// Ground truth about person and props at one time.
#[derive(Clone, Debug)]
pub struct Truth {
    solids: Vec<(Vector3<f64>, f64, Solid)>,
}

impl Truth {
    /// What is where at a time, seconds.
    pub fn new(stage: &Stage, time_s: f64) -> Truth {
        let ball = |solid: Solid| {
            let (low, high) = solid.bounds_world();
            ((low + high) * 0.5, (high - low).norm() * 0.5, solid)
        };
        Truth { solids: stage.solids(time_s).into_iter().map(ball).collect() }
    }

    /// Signed distance, metres, from a world point to the union of person and props: negative inside, of the
    /// right sign always. Outside it is never more than the true distance (equal to it but for flat parts
    /// like torso, hands and feet, where it may be down to a third); inside it is never deeper than the
    /// truth. Infinite in an empty studio.
    pub fn signed_distance_m(&self, point_world: &Point3<f64>) -> f64 {
        let mut least = f64::INFINITY;
        for (centre, radius_m, solid) in &self.solids {
            if (point_world.coords - centre).norm() - radius_m < least {
                least = least.min(solid.signed_distance_m(&point_world.coords));
            }
        }
        least
    }
}
