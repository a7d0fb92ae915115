//! What each motion does with the body, as a function of time.

pub(crate) mod blow;
pub(crate) mod calm;
pub(crate) mod carry;
pub(crate) mod lift;
pub(crate) mod strike;
pub(crate) mod walk;

use nalgebra::{Point3, Vector3};

use crate::motion::Motion;
use crate::skeleton::{ArmTarget, Joint, Skeleton};

impl Motion {
    /// Where a joint of the person is at a time of the film, seconds: world, metres.
    pub fn joint_world(self, joint: Joint, time_s: f64) -> Point3<f64> {
        self.skeleton(time_s).joint(joint)
    }

    /// The person at a time of the film, seconds; neutral before [`crate::NEUTRAL_S`].
    pub(crate) fn skeleton(self, time_s: f64) -> Skeleton {
        let since_s = self.since_s(time_s);
        Skeleton::from_targets(&match self {
            Motion::Idle => calm::idle(since_s),
            Motion::Wave => calm::wave(since_s),
            Motion::Walk => walk::walk(since_s),
            Motion::Punch => strike::punch(since_s),
            Motion::Sweep => strike::sweep(since_s % strike::SWEEP_PERIOD_S),
            Motion::Lift => lift::lift(since_s % lift::LIFT_PERIOD_S),
            Motion::Tray => carry::tray(since_s % carry::TRAY_PERIOD_S),
            Motion::Push => strike::push(since_s % strike::PUSH_PERIOD_S),
            Motion::Squeeze => carry::squeeze(since_s % carry::SQUEEZE_PERIOD_S),
            Motion::Reach => blow::reach(since_s),
            Motion::Swing(speed) => blow::swing(since_s % self.period_s(), speed.m_s()),
            Motion::Glide(speed) => blow::glide(since_s % self.period_s(), speed.m_s()),
        })
    }
}

/// Between two arm targets.
pub(crate) fn mix_arms(a: &ArmTarget, b: &ArmTarget, share: f64) -> ArmTarget {
    ArmTarget {
        wrist: a.wrist.lerp(&b.wrist, share),
        elbow_hint: a.elbow_hint.lerp(&b.elbow_hint, share),
        hand: a.hand.lerp(&b.hand, share),
        palm: a.palm.lerp(&b.palm, share),
        curl: a.curl + (b.curl - a.curl) * share,
    }
}

/// Shorthand for a vector of the root frame.
pub(crate) fn at(x: f64, y: f64, z: f64) -> Vector3<f64> {
    Vector3::new(x, y, z)
}
