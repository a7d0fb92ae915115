//! Walking a circle, feet planted on their footprints.

use std::f64::consts::{PI, TAU};

use nalgebra::Vector3;

use super::at;
use crate::maths::{smooth, turn_x, turn_y};
use crate::skeleton::{LegTarget, Targets, side_sign};

/// Metres from the circle's centre, which is at (+radius, 0, 0).
const RADIUS_M: f64 = 0.5;
const SPEED_M_PER_S: f64 = 0.76;
/// Two steps; a lap is four strides.
const STRIDE_M: f64 = TAU * RADIUS_M / 4.0;
/// Seconds from standing to walking at full speed.
pub(crate) const RAMP_S: f64 = 1.2;
/// Seconds of one lap.
pub(crate) const LAP_S: f64 = TAU * RADIUS_M / SPEED_M_PER_S;
/// Share of a stride that a foot stands.
const STANCE: f64 = 0.6;

pub(crate) fn walk(since_s: f64) -> Targets {
    let ramp = (since_s / RAMP_S).min(1.0);
    let warm_up_m = SPEED_M_PER_S * RAMP_S * ramp * ramp * ramp * (1.0 - 0.5 * ramp);
    // Whole laps are dropped, so that the loop repeats to the bit.
    let cruise_m = SPEED_M_PER_S * ((since_s - RAMP_S).max(0.0) % LAP_S);
    let path_m = warm_up_m + cruise_m;
    let weight = smooth(ramp);
    let mut targets = Targets::neutral();
    targets.heading_rad = path_m / RADIUS_M;
    targets.root_world = place(path_m);
    let (s, c) = libm::sincos(TAU * path_m / STRIDE_M);
    let bob = libm::cos(2.0 * TAU * path_m / STRIDE_M);
    targets.pelvis += at(0.022 * s, -0.024 - 0.014 * bob, 0.01) * weight;
    targets.pelvis_yaw_rad = -0.11 * c * weight;
    targets.twist_rad = 0.11 * c * weight;
    targets.lean_rad += 0.05 * weight;
    targets.bend_rad = -0.06 * weight;
    targets.look_rad = 0.3 * weight;
    for side in [0, 1] {
        let swing = -side_sign(side) * c * weight;
        let arm = &mut targets.arms[side];
        let shoulder = at(arm.wrist.x, 1.385, 0.02);
        arm.wrist = shoulder + turn_x(-0.44 * swing - 0.06 * weight) * (arm.wrist - shoulder);
        arm.wrist.y += (0.02 + 0.045 * swing.max(0.0)) * weight;
        let gait = foot(side, path_m, &targets);
        let leg = &mut targets.legs[side];
        leg.ankle = leg.ankle.lerp(&gait.ankle, weight);
        leg.yaw_rad += (gait.yaw_rad - leg.yaw_rad) * weight;
        leg.pitch_rad = gait.pitch_rad * weight;
    }
    targets
}

/// The place on the circle after `path_m`, and so of the root.
fn place(path_m: f64) -> Vector3<f64> {
    let (s, c) = libm::sincos(path_m / RADIUS_M);
    at(RADIUS_M * (1.0 - c), 0.0, RADIUS_M * s)
}

/// A foot of the full gait, in the root frame at `path_m`.
fn foot(side: usize, path_m: f64, targets: &Targets) -> LegTarget {
    let lead = if side == 0 { 0.0 } else { 0.5 };
    let phase = path_m / STRIDE_M + lead;
    let (stride, share) = (phase.floor(), phase - phase.floor());
    let print = |stride: f64| {
        let mid_m = (stride + 0.5 * STANCE - lead) * STRIDE_M;
        let yaw_rad = mid_m / RADIUS_M;
        let across = turn_y(yaw_rad) * at(0.085 * side_sign(side), 0.0, -0.02);
        (place(mid_m) + across, yaw_rad + 0.1 * side_sign(side))
    };
    let (here, yaw_here) = print(stride);
    let (next, yaw_next) = print(stride + 1.0);
    let swing = ((share - STANCE) / (1.0 - STANCE)).max(0.0);
    let forward = smooth(swing);
    let pitch_rad = if share < 0.1 {
        -0.28 * (1.0 - share / 0.1)
    } else if share < STANCE {
        0.62 * smooth((share - 0.36) / (STANCE - 0.36))
    } else {
        0.62 + (-0.28 - 0.62) * smooth(swing)
    };
    // While the heel lifts the ball of the foot stays: the ankle rises and comes forward.
    let (s, c) = libm::sincos(pitch_rad.max(0.0));
    let roll = at(0.0, 0.125 * s - 0.055 * (1.0 - c), 0.125 * (1.0 - c) + 0.055 * s);
    let heel = at(0.0, 0.05 * libm::sin((-pitch_rad).max(0.0)), 0.0);
    let yaw_world = yaw_here + (yaw_next - yaw_here) * forward;
    let clearance = at(0.0, 0.055 * libm::sin(PI * swing), 0.0);
    let ankle_world =
        here.lerp(&next, forward) + at(0.0, 0.088, 0.0) + turn_y(yaw_world) * roll + heel + clearance;
    LegTarget {
        ankle: turn_y(-targets.heading_rad) * (ankle_world - targets.root_world),
        yaw_rad: yaw_world - targets.heading_rad,
        pitch_rad,
    }
}
