//! Punching to the front, pushing with both fists, and sweeping both arms apart.

use super::{at, mix_arms};
use crate::maths::ease;
use crate::skeleton::{ArmTarget, Targets, side_sign};

/// Seconds to take guard before the punches loop.
pub(crate) const GUARD_S: f64 = 0.8;
/// Seconds of one right and one left punch.
pub(crate) const PUNCHES_S: f64 = 2.4;
/// Seconds of the whole sweep, from neutral to neutral.
pub(crate) const SWEEP_PERIOD_S: f64 = 4.5;
/// Seconds after the start of the loop at which the arms begin to sweep, and at which they are through.
pub(crate) const SWEEP_FROM_S: f64 = 1.1;
pub(crate) const SWEEP_TO_S: f64 = 3.1;

/// Seconds of the whole push, from neutral to neutral.
pub(crate) const PUSH_PERIOD_S: f64 = 5.5;
/// The fists are raised between the first two, go forward between the next, and come back between the last, seconds
/// into the loop.
const PUSH_S: [f64; 6] = [0.1, 1.1, 1.3, 2.6, 3.0, 4.6];

/// The middle of the fists is as high as this, metres.
const PUSH_HEIGHT_M: f64 = 1.05;

pub(crate) fn punch(since_s: f64) -> Targets {
    let guard = ease(since_s, 0.0, GUARD_S);
    let loop_s = (since_s - GUARD_S).max(0.0) % PUNCHES_S;
    let mut targets = Targets::neutral();
    let jab =
        |start_s: f64| ease(loop_s, start_s, start_s + 0.30) - ease(loop_s, start_s + 0.36, start_s + 0.84);
    let reach = [jab(1.4), jab(0.2)];
    for side in [0, 1] {
        let sign = side_sign(side);
        let ready = ArmTarget {
            wrist: at(0.15 * sign, 1.30, 0.235 + 0.05 * (sign + 1.0) / 2.0),
            elbow_hint: at(0.45 * sign, -1.0, -0.2),
            hand: at(-0.1 * sign, 0.25, 0.25),
            palm: at(-sign, -0.3, -0.4),
            curl: 1.0,
        };
        let struck = ArmTarget {
            wrist: at(0.05 * sign, 1.415, 0.605),
            elbow_hint: at(0.7 * sign, -0.8, 0.0),
            hand: at(0.0, 0.0, 0.7),
            palm: at(-0.2 * sign, -1.0, 0.0),
            curl: 1.0,
        };
        let arm = mix_arms(&ready, &struck, reach[side]);
        targets.arms[side] = mix_arms(&targets.arms[side], &arm, guard);
        targets.arms[side].wrist.z += 0.12 * 4.0 * guard * (1.0 - guard);
    }
    let turn = reach[1] - reach[0];
    targets.twist_rad = -0.22 * guard + 0.48 * turn;
    targets.pelvis_yaw_rad = -0.2 * guard + 0.2 * turn;
    targets.lean_rad += 0.07 * guard + 0.05 * (reach[0] + reach[1]);
    targets.pelvis += at(0.0, -0.045, 0.02) * guard + at(0.0, -0.008, 0.035) * (reach[0] + reach[1]);
    // Left foot to the front, right foot behind and turned out.
    targets.legs[0].ankle += at(0.02, 0.0, 0.17) * guard;
    targets.legs[1].ankle += at(-0.05, 0.0, -0.17) * guard;
    targets.legs[1].yaw_rad -= 0.55 * guard;
    for leg in &mut targets.legs {
        leg.ankle.y += 0.03 * 4.0 * guard * (1.0 - guard);
    }
    targets
}

/// `loop_s` is below [`PUSH_PERIOD_S`].
pub(crate) fn push(loop_s: f64) -> Targets {
    let mut targets = Targets::neutral();
    let back = ease(loop_s, PUSH_S[4], PUSH_S[5]);
    let raised = ease(loop_s, PUSH_S[0], PUSH_S[1]) - back;
    let out = ease(loop_s, PUSH_S[2], PUSH_S[3]) - back;
    targets.lean_rad += 0.30 * out;
    for side in [0, 1] {
        let sign = side_sign(side);
        let fist = ArmTarget {
            wrist: at(0.24 * sign, PUSH_HEIGHT_M, 0.24 + 0.27 * out),
            elbow_hint: at(0.5 * sign, -1.0, -0.3),
            hand: at(0.0, 0.0, 1.0),
            palm: at(-sign, 0.0, 0.0),
            curl: 1.0,
        };
        let mut arm = mix_arms(&targets.arms[side], &fist, raised);
        arm.wrist.z += 0.06 * 4.0 * raised * (1.0 - raised);
        targets.arms[side] = arm;
    }
    targets
}

/// `loop_s` is below [`SWEEP_PERIOD_S`].
pub(crate) fn sweep(loop_s: f64) -> Targets {
    let mut targets = Targets::neutral();
    let bent = ease(loop_s, 0.05, 1.0) - ease(loop_s, 3.0, 4.3);
    let through = ease(loop_s, SWEEP_FROM_S, SWEEP_TO_S);
    let wind_up = ease(loop_s, 0.1, 1.05);
    let back = ease(loop_s, 3.0, 4.2);
    for side in [0, 1] {
        let sign = side_sign(side);
        // The arms hang from the shoulders, so that each comes at once against all that stands beside it.
        let arc = ArmTarget {
            wrist: at(sign * (0.52 * through + 0.05), 0.83, 0.40 + 0.16 * through * (1.0 - through)),
            elbow_hint: at(0.5 * sign, 0.0, 1.0),
            hand: at(0.1 * sign, -0.8, 0.15),
            palm: at(sign, 0.0, 0.0),
            curl: 0.1,
        };
        let mut arm = mix_arms(&targets.arms[side], &arc, wind_up - back);
        // Up close to the belly on the way to the middle, out to the side on the way back.
        arm.wrist += at(-0.02 * sign, 0.16, 0.02) * (4.0 * wind_up * (1.0 - wind_up));
        arm.wrist += at(0.12 * sign, 0.06, 0.0) * (4.0 * back * (1.0 - back));
        targets.arms[side] = arm;
        targets.legs[side].ankle.x += 0.03 * sign * bent;
    }
    targets.lean_rad += 0.70 * bent;
    targets.nod_rad = 0.1 * bent;
    targets.pelvis += at(0.0, -0.115, -0.10) * bent;
    targets
}
