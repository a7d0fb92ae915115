//! Punching to the front, and sweeping an arm round.

use super::{at, mix_arms};
use crate::maths::ease;
use crate::skeleton::{ArmTarget, Targets, side_sign};

/// Seconds to take guard before the punches loop.
pub(crate) const GUARD_S: f64 = 0.8;
/// Seconds of one right and one left punch.
pub(crate) const PUNCHES_S: f64 = 2.4;
/// Seconds of the whole sweep, from neutral to neutral.
pub(crate) const SWEEP_PERIOD_S: f64 = 4.5;
/// Seconds after the start of the loop at which the arm begins to sweep, and at which it is through.
pub(crate) const SWEEP_FROM_S: f64 = 1.1;
pub(crate) const SWEEP_TO_S: f64 = 2.0;

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

/// `loop_s` is below [`SWEEP_PERIOD_S`].
pub(crate) fn sweep(loop_s: f64) -> Targets {
    let mut targets = Targets::neutral();
    let bent = ease(loop_s, 0.05, 1.0) - ease(loop_s, 2.2, 3.5);
    let through = ease(loop_s, SWEEP_FROM_S, SWEEP_TO_S);
    let back = ease(loop_s, 2.2, 3.4);
    let angle_rad = 0.62 - 2.35 * through;
    let (s, c) = libm::sincos(angle_rad);
    let outward = at(s, 0.0, c);
    let arc = ArmTarget {
        wrist: at(-0.16, 0.80, 0.20) + outward * 0.385,
        elbow_hint: at(-1.0, 0.3, -0.4),
        hand: outward * 0.5 + at(0.0, -0.2, 0.0),
        palm: at(c, -0.4, -s),
        curl: 0.1,
    };
    let wind_up = ease(loop_s, 0.1, 1.05);
    let neutral = targets.arms[1];
    let mut arm = mix_arms(&neutral, &arc, wind_up - back);
    // Up close to the belly on the way to the left, out to the side on the way back.
    arm.wrist += at(0.02, 0.16, 0.02) * (4.0 * wind_up * (1.0 - wind_up));
    arm.wrist += at(-0.12, 0.06, 0.0) * (4.0 * back * (1.0 - back));
    targets.arms[1] = arm;
    targets.arms[0].wrist += at(0.05, 0.06, -0.06) * bent;
    targets.lean_rad += 0.70 * bent;
    targets.twist_rad = (0.42 - 0.95 * through) * bent;
    targets.bend_rad = 0.08 * bent;
    targets.nod_rad = 0.1 * bent;
    targets.look_rad = (0.25 - 0.7 * through) * bent;
    targets.pelvis += at(0.03, -0.115, -0.10) * bent;
    targets.legs[0].ankle.x += 0.03 * bent;
    targets
}
