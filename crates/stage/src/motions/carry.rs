//! Holding things with both hands: a tray that is carried sideways, and a thing that only bodies know of, pressed
//! between the palms.

use nalgebra::Vector3;

use super::{at, mix_arms};
use crate::maths::{ease, smooth};
use crate::skeleton::{ArmTarget, Targets, side_sign};
use crate::tray::{TRAY_REST_M, TRAY_SIZE_M};

/// Seconds of carrying the tray, from neutral to neutral.
pub(crate) const TRAY_PERIOD_S: f64 = 11.0;
/// The tray is raised between the first two, and lowered between the others, seconds into the loop.
const TRAY_RISE_S: (f64, f64) = (1.1, 1.9);
const TRAY_SINK_S: (f64, f64) = (8.0, 8.9);
/// How far the tray is raised, metres.
const TRAY_RISE_M: f64 = 0.10;
/// From when to when the person steps aside, seconds into the loop, from where to where, metres to its left. The
/// second is at 1 m/s where it is fastest.
const WALKS: [(f64, f64, f64, f64); 3] =
    [(2.2, 3.6, 0.0, 0.5), (3.9, 5.775, 0.5, -0.5), (6.2, 7.6, -0.5, 0.0)];
/// The length of a step aside, metres.
const STEP_M: f64 = 0.25;
/// The share of a step that a foot is in the air: the feet overlap a little.
const AIRBORNE: f64 = 0.6;

/// Seconds of the whole squeeze, from neutral to neutral.
pub(crate) const SQUEEZE_PERIOD_S: f64 = 9.0;
/// The palms close between these, are raised, close further for a while, sink and open.
const PRESS_S: (f64, f64) = (0.95, 1.3);
const SQUEEZE_RISE_S: (f64, f64) = (1.5, 2.7);
const CRUSH_S: [f64; 4] = [3.3, 3.7, 4.3, 4.7];
const SQUEEZE_SINK_S: (f64, f64) = (5.0, 6.4);
const SQUEEZE_OPEN_S: (f64, f64) = (6.6, 7.0);
/// What is between the palms is as wide as this, metres, and its middle is there first: over the head, where no camera
/// sees the person behind it.
const SQUEEZED_M: f64 = 0.24;
const SQUEEZED_AT_M: [f64; 3] = [0.0, 1.74, 0.30];
/// How far the palms rise, metres.
const SQUEEZE_RISE_M: f64 = 0.12;
/// Between each palm and what it holds, metres: while it comes, holds and crushes.
const OPEN_M: f64 = 0.03;
const HELD_M: f64 = -0.002;
const CRUSHED_M: f64 = -0.012;
/// Half the thickness of a palm, metres.
const PALM_THICK_M: f64 = 0.0184;

/// How far the tray is from its rest, world, `loop_s` into the loop.
pub(crate) fn tray_offset(loop_s: f64) -> Vector3<f64> {
    at(walked_m(loop_s), tray_rise_m(loop_s), 0.0)
}

fn tray_rise_m(loop_s: f64) -> f64 {
    TRAY_RISE_M * (ease(loop_s, TRAY_RISE_S.0, TRAY_RISE_S.1) - ease(loop_s, TRAY_SINK_S.0, TRAY_SINK_S.1))
}

fn walked_m(loop_s: f64) -> f64 {
    WALKS.iter().map(|&(from_s, to_s, from_m, to_m)| (to_m - from_m) * ease(loop_s, from_s, to_s)).sum()
}

/// `loop_s` is below [`TRAY_PERIOD_S`].
pub(crate) fn tray(loop_s: f64) -> Targets {
    let mut targets = Targets::neutral();
    // The tray hangs in the air until the hands are under it.
    let reached = ease(loop_s, 0.05, 1.05) - ease(loop_s, TRAY_SINK_S.1 + 0.2, TRAY_SINK_S.1 + 1.6);
    let rise_m = tray_rise_m(loop_s);
    targets.root_world.x = walked_m(loop_s);
    targets.lean_rad -= 0.05 * reached;
    targets.pelvis += at(0.0, -0.045, -0.03) * reached;
    for side in [0, 1] {
        let sign = side_sign(side);
        // Under the board, fingers to the front.
        let under = at(sign * (0.5 * TRAY_SIZE_M[0] - 0.045), -0.5 * TRAY_SIZE_M[1] - PALM_THICK_M, -0.12);
        let hold = ArmTarget {
            wrist: Vector3::from(TRAY_REST_M) + at(0.0, rise_m, 0.0) + under,
            elbow_hint: at(0.6 * sign, -1.0, 0.1),
            hand: at(0.0, 0.0, 1.0),
            palm: at(0.0, 1.0, 0.0),
            curl: 0.0,
        };
        let mut arm = mix_arms(&targets.arms[side], &hold, reached);
        // Round the outside of the tray.
        arm.wrist += at(0.20 * sign, 0.02, 0.0) * (4.0 * reached * (1.0 - reached));
        targets.arms[side] = arm;
        step_aside(&mut targets, side, loop_s);
    }
    targets
}

/// Puts a foot where the walk aside has it: the one that leads steps first.
fn step_aside(targets: &mut Targets, side: usize, loop_s: f64) {
    let mut foot_m = 0.0;
    let ankle = &mut targets.legs[side].ankle;
    for (from_s, to_s, from_m, to_m) in WALKS {
        let steps = ((to_m - from_m).abs() / STEP_M).ceil();
        let walked = steps * ease(loop_s, from_s, to_s);
        let step = walked.floor().min(steps - 1.0);
        let leads = (to_m > from_m) == (side == 0);
        let begins = if leads { 0.0 } else { 1.0 - AIRBORNE };
        let share = smooth((walked - step - begins) / AIRBORNE);
        foot_m += (to_m - from_m) * (step + share) / steps;
        ankle.y += 0.035 * 4.0 * share * (1.0 - share);
    }
    ankle.x += foot_m - targets.root_world.x;
}

/// `loop_s` is below [`SQUEEZE_PERIOD_S`].
pub(crate) fn squeeze(loop_s: f64) -> Targets {
    let mut targets = Targets::neutral();
    let raised =
        ease(loop_s, SQUEEZE_RISE_S.0, SQUEEZE_RISE_S.1) - ease(loop_s, SQUEEZE_SINK_S.0, SQUEEZE_SINK_S.1);
    let pressed = ease(loop_s, PRESS_S.0, PRESS_S.1) - ease(loop_s, SQUEEZE_OPEN_S.0, SQUEEZE_OPEN_S.1);
    let crushed = ease(loop_s, CRUSH_S[0], CRUSH_S[1]) - ease(loop_s, CRUSH_S[2], CRUSH_S[3]);
    let reached = ease(loop_s, 0.0, 0.9) - ease(loop_s, SQUEEZE_OPEN_S.1 + 0.1, SQUEEZE_OPEN_S.1 + 1.5);
    targets.lean_rad -= 0.04 * reached;
    targets.nod_rad = -0.2 * reached;
    let gap_m = OPEN_M + (HELD_M - OPEN_M) * pressed + (CRUSHED_M - HELD_M) * crushed;
    let [_, middle_m, ahead_m] = SQUEEZED_AT_M;
    for side in [0, 1] {
        let sign = side_sign(side);
        let aside_m = 0.5 * SQUEEZED_M + PALM_THICK_M + gap_m;
        let palm = ArmTarget {
            wrist: at(sign * aside_m, middle_m + SQUEEZE_RISE_M * raised - 0.05, ahead_m - 0.10),
            elbow_hint: at(0.8 * sign, -1.0, 0.0),
            hand: at(0.0, 0.45, 0.90),
            palm: at(-sign, 0.0, 0.0),
            curl: 0.0,
        };
        let mut arm = mix_arms(&targets.arms[side], &palm, reached);
        // Out to the side on the way up and down.
        arm.wrist += at(0.22 * sign, 0.0, 0.14) * (4.0 * reached * (1.0 - reached));
        targets.arms[side] = arm;
    }
    targets
}
