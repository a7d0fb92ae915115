//! What each motion does with the body, as a function of time.

pub(crate) mod calm;
pub(crate) mod lift;
pub(crate) mod strike;
pub(crate) mod walk;

use nalgebra::Vector3;

use crate::motion::Motion;
use crate::skeleton::{ArmTarget, Targets};

/// The targets of a motion at a time of the film, seconds; neutral before [`crate::NEUTRAL_S`].
pub(crate) fn targets(motion: Motion, time_s: f64) -> Targets {
    let since_s = motion.since_s(time_s);
    match motion {
        Motion::Idle => calm::idle(since_s),
        Motion::Wave => calm::wave(since_s),
        Motion::Walk => walk::walk(since_s),
        Motion::Punch => strike::punch(since_s),
        Motion::Sweep => strike::sweep(since_s % strike::SWEEP_PERIOD_S),
        Motion::Lift => lift::lift(since_s % lift::LIFT_PERIOD_S),
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
