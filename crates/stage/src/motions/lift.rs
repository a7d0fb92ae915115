//! Lifting a box off the table, holding, tilting and lowering it.

use nalgebra::Vector3;

use super::{at, mix_arms};
use crate::lifted_box::{BOX_RISE_M, BOX_SIZE_M, BoxState};
use crate::maths::{ease, turn_z};
use crate::skeleton::{ArmTarget, Targets, side_sign};

/// Seconds of the whole lift, from neutral to neutral.
pub(crate) const LIFT_PERIOD_S: f64 = 12.0;
/// The hands are on the box from here on, seconds into the loop.
pub(crate) const GRIP_S: f64 = 0.9;
/// The box rises between these.
pub(crate) const RISE_S: (f64, f64) = (1.0, 2.2);
/// It tilts to its right side between the first two and back between the last two.
pub(crate) const TILT_S: [f64; 4] = [4.2, 5.7, 6.4, 7.9];
/// It sinks back between these, and the hands let go at the second.
pub(crate) const SINK_S: (f64, f64) = (8.4, 10.2);
/// How far it tilts, radians.
pub(crate) const TILT_RAD: f64 = 0.42;

/// Where the box is, `loop_s` into the loop.
pub(crate) fn box_state(loop_s: f64) -> BoxState {
    let raised = ease(loop_s, RISE_S.0, RISE_S.1) - ease(loop_s, SINK_S.0, SINK_S.1);
    let tilted = ease(loop_s, TILT_S[0], TILT_S[1]) - ease(loop_s, TILT_S[2], TILT_S[3]);
    BoxState { rise_m: BOX_RISE_M * raised, tilt_rad: TILT_RAD * tilted }
}

/// `loop_s` is below [`LIFT_PERIOD_S`].
pub(crate) fn lift(loop_s: f64) -> Targets {
    let mut targets = Targets::neutral();
    let state = box_state(loop_s);
    let reached = ease(loop_s, 0.1, GRIP_S) - ease(loop_s, SINK_S.1 + 0.2, SINK_S.1 + 1.4);
    let raised = state.rise_m / BOX_RISE_M;
    let low = reached * (1.0 - raised);
    targets.lean_rad += 0.50 * low - 0.07 * raised;
    targets.pelvis += at(0.0, -0.075, -0.13) * low + at(0.0, 0.0, -0.03) * raised;
    targets.nod_rad = 0.16 * low;
    targets.bend_rad = 0.12 * state.tilt_rad / TILT_RAD;
    for side in [0, 1] {
        let grip = grip(side, state);
        let mut arm = mix_arms(&targets.arms[side], &grip, reached);
        // Round the outside of the table and of the box.
        let round = 4.0 * reached * (1.0 - reached);
        arm.wrist += at(0.09 * side_sign(side), 0.10, 0.0) * round;
        targets.arms[side] = arm;
    }
    targets
}

/// The arm that holds one side of the box: flat palm on it, fingers to the front and a little down.
fn grip(side: usize, state: BoxState) -> ArmTarget {
    let sign = side_sign(side);
    let tilt = turn_z(state.tilt_rad);
    let hand: Vector3<f64> = tilt * at(0.0, -0.34, 0.94);
    let wrist_box = at(sign * (0.5 * BOX_SIZE_M[0] + 0.021), 0.0, -0.13);
    ArmTarget {
        wrist: Vector3::from(state.centre_world_m()) + tilt * wrist_box,
        elbow_hint: at(0.55 * sign, -1.0, -0.3),
        hand,
        palm: tilt * at(-sign, 0.0, 0.0),
        curl: 0.0,
    }
}
