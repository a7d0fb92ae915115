//! What is in the studio, and when.

use nalgebra::{Isometry3, Point3, Quaternion, UnitQuaternion, Vector3};

use crate::figure;
use crate::motion::Motion;
use crate::props::Prop;
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

    /// Where a prop is at a time, seconds, world from prop: the middle of the box, of the tray's board, or of the table
    /// on the floor.
    pub fn prop_world(&self, prop: Prop, time_s: f64) -> Isometry3<f64> {
        let (middle, tilt_rad) = prop.place(self.motion, self.person, time_s);
        let (s, c) = libm::sincos(0.5 * tilt_rad);
        let rotation = UnitQuaternion::new_unchecked(Quaternion::new(c, 0.0, 0.0, s));
        Isometry3::from_parts(middle.into(), rotation)
    }

    pub(crate) fn solids(&self, time_s: f64) -> Vec<Solid> {
        let mut solids = Vec::with_capacity(80);
        if self.person {
            figure::solids(&self.motion.skeleton(time_s), &mut solids);
        }
        for prop in &self.props {
            prop.solids(self.motion, self.person, time_s, &mut solids);
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
    pub fn new(stage: &StageSettings, time_s: f64) -> Truth {
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

    /// Whether the ray from an eye through a point, and on beyond it, meets person or props, but for a tenth of a
    /// millimetre: then a camera there sees foreground at the point, however fine its image.
    pub fn meets_ray(&self, eye_world: &Point3<f64>, through_world: &Point3<f64>) -> bool {
        const GRAZES_M: f64 = 1e-4;
        /// Nothing in the studio is farther from any of its cameras.
        const FARTHEST_M: f64 = 12.0;
        let Some(ray) = (through_world - eye_world).try_normalize(0.0) else { return false };
        let mut along_m = 0.0;
        while along_m < FARTHEST_M {
            let distance_m = self.signed_distance_m(&(eye_world + ray * along_m));
            if distance_m < GRAZES_M {
                return true;
            }
            along_m += distance_m;
        }
        false
    }
}
