//! Standing, and waving.

use std::f64::consts::TAU;

use super::{at, mix_arms};
use crate::maths::{ease, turn_z};
use crate::skeleton::{ArmTarget, Targets};

/// Seconds to raise the arm before the waving loops.
pub(crate) const RAISE_S: f64 = 1.0;
/// Seconds of one wave to and fro.
pub(crate) const WAVE_S: f64 = 1.2;
/// Seconds of one breath.
pub(crate) const BREATH_S: f64 = 4.0;

pub(crate) fn idle(since_s: f64) -> Targets {
    let mut targets = Targets::neutral();
    let (s, c) = libm::sincos(TAU * since_s / BREATH_S);
    targets.bend_rad = 0.02 * s;
    targets.pelvis.x += 0.012 * s;
    targets.lean_rad += 0.012 * (1.0 - c);
    targets.look_rad = 0.12 * s;
    for arm in &mut targets.arms {
        arm.wrist += at(0.008 * s, 0.004 * (1.0 - c), 0.012 * (1.0 - c));
    }
    targets
}

pub(crate) fn wave(since_s: f64) -> Targets {
    let mut targets = Targets::neutral();
    let raised = ease(since_s, 0.0, RAISE_S);
    // Starts at an end of the swing, so that it fades in at rest.
    let swing = libm::cos(TAU * (since_s - RAISE_S).max(0.0) / WAVE_S);
    let elbow = at(-0.40, 1.49, 0.10);
    let forearm = turn_z(0.42 * swing + 0.06) * at(0.0, 0.255, 0.06);
    let up = ArmTarget {
        wrist: elbow + forearm,
        elbow_hint: at(-1.0, -0.55, -0.1),
        hand: forearm.normalize() * 0.5 + at(-0.25 * swing, 0.3, 0.05),
        palm: at(0.0, 0.1, 1.0),
        curl: 0.02,
    };
    targets.arms[1] = mix_arms(&targets.arms[1], &up, raised);
    // Between side and raised the hand goes round the outside and the front.
    let round = 4.0 * raised * (1.0 - raised);
    targets.arms[1].wrist += at(-0.22, 0.0, 0.16) * round;
    targets.bend_rad = 0.035 * raised;
    targets.look_rad = -0.12 * raised;
    targets
}
