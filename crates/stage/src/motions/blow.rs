//! Motions of a chosen speed, for blows that are measured: a straight arm that swings level from behind the person to
//! its front, and a person that glides aside without a step.

use super::{at, mix_arms};
use crate::maths::ease;
use crate::skeleton::{ArmTarget, PALM_M, Targets};

/// The arm is raised until then, and swings from then on, seconds into the loop.
const RAISED_S: f64 = 2.0;
const SWING_S: f64 = 2.2;
/// It points so far to the front of the person's left at first, radians, swings so far, and takes so much of that to
/// reach its speed, and to stop.
const SWING_FROM_RAD: f64 = -1.1;
const SWING_WAY_RAD: f64 = 2.5;
const SWING_RAMP_RAD: f64 = 0.75;
/// Where the left shoulder is, and how far from it the wrist is while the arm is straight, metres.
const SHOULDER_M: [f64; 3] = [0.175, 1.40, 0.005];
const WRIST_OUT_M: f64 = 0.549;

/// The person has gone to its right until then, and glides to its left from then on, seconds into the loop.
const ASIDE_S: f64 = 1.2;
const GLIDE_S: f64 = 1.4;
/// From where it glides, to its left, metres, how far, and how much of that it takes to reach its speed, and to stop.
const GLIDE_FROM_M: f64 = -0.6;
const GLIDE_WAY_M: f64 = 1.5;
const GLIDE_RAMP_M: f64 = 0.45;

/// It waits so long once it has stopped, and takes so long to come back, seconds.
const WAIT_S: f64 = 0.2;
const BACK_S: f64 = 2.4;

/// A way, in one unit of length or angle, at a speed a second, and what it takes of the way to reach the speed, and to
/// stop.
#[derive(Clone, Copy)]
struct Run {
    way: f64,
    ramp: f64,
    speed: f64,
}

impl Run {
    fn swing(speed_m_s: f64) -> Run {
        Run { way: SWING_WAY_RAD, ramp: SWING_RAMP_RAD, speed: speed_m_s / (WRIST_OUT_M + PALM_M) }
    }

    fn glide(speed_m_s: f64) -> Run {
        Run { way: GLIDE_WAY_M, ramp: GLIDE_RAMP_M, speed: speed_m_s }
    }

    /// How long it takes to reach the speed, seconds.
    fn ramp_s(&self) -> f64 {
        2.0 * self.ramp / self.speed
    }

    /// From when to when it goes at its speed, seconds since it began.
    fn steady_s(&self) -> (f64, f64) {
        (self.ramp_s(), self.ramp_s() + (self.way - 2.0 * self.ramp) / self.speed)
    }

    /// When it has stopped, seconds since it began.
    fn end_s(&self) -> f64 {
        self.steady_s().1 + self.ramp_s()
    }

    /// How far it has gone.
    fn gone(&self, since_s: f64) -> f64 {
        let Run { way, ramp, speed } = *self;
        // From rest and to rest with one acceleration.
        let ramped = |time_s: f64| 0.25 * speed * speed / ramp * time_s * time_s;
        let (from_s, to_s) = self.steady_s();
        match since_s {
            ..=0.0 => 0.0,
            since_s if since_s < from_s => ramped(since_s),
            since_s if since_s < to_s => ramp + speed * (since_s - from_s),
            since_s if since_s < self.end_s() => way - ramped(self.end_s() - since_s),
            _ => way,
        }
    }
}

/// Seconds of the whole swing, from neutral to neutral, whose knuckles reach a speed.
pub(crate) fn swing_period_s(speed_m_s: f64) -> f64 {
    SWING_S + Run::swing(speed_m_s).end_s() + WAIT_S + BACK_S
}

/// Seconds of the whole glide, from neutral to neutral.
pub(crate) fn glide_period_s(speed_m_s: f64) -> f64 {
    GLIDE_S + Run::glide(speed_m_s).end_s() + WAIT_S + BACK_S
}

/// From when to when the knuckles are at their speed, seconds into the loop.
pub(crate) fn swing_steady_s(speed_m_s: f64) -> (f64, f64) {
    let (from_s, to_s) = Run::swing(speed_m_s).steady_s();
    (SWING_S + from_s, SWING_S + to_s)
}

/// From when to when the person is at its speed, seconds into the loop.
pub(crate) fn glide_steady_s(speed_m_s: f64) -> (f64, f64) {
    let (from_s, to_s) = Run::glide(speed_m_s).steady_s();
    (GLIDE_S + from_s, GLIDE_S + to_s)
}

/// Mixes in a `share` of a straight left arm with a fist, level, so far to the front of the side.
fn arm_out(targets: &mut Targets, angle_rad: f64, share: f64) {
    let (s, c) = libm::sincos(angle_rad);
    let [x, y, z] = SHOULDER_M;
    let out = ArmTarget {
        wrist: at(x + WRIST_OUT_M * c, y, z + WRIST_OUT_M * s),
        // Never along the arm while it is raised or lowered: the elbow would jump.
        elbow_hint: at(0.0, -s, -0.5),
        hand: at(c, 0.0, s),
        palm: at(0.0, -1.0, 0.0),
        curl: 1.0,
    };
    targets.arms[0] = mix_arms(&targets.arms[0], &out, share);
}

/// `loop_s` is below [`swing_period_s`].
pub(crate) fn swing(loop_s: f64, speed_m_s: f64) -> Targets {
    let run = Run::swing(speed_m_s);
    let mut targets = Targets::neutral();
    let back_s = SWING_S + run.end_s() + WAIT_S;
    let raised = ease(loop_s, 0.0, RAISED_S) - ease(loop_s, back_s, back_s + BACK_S);
    arm_out(&mut targets, SWING_FROM_RAD + run.gone(loop_s - SWING_S), raised);
    targets
}

/// `loop_s` is below [`glide_period_s`].
pub(crate) fn glide(loop_s: f64, speed_m_s: f64) -> Targets {
    let run = Run::glide(speed_m_s);
    let mut targets = Targets::neutral();
    let back_s = GLIDE_S + run.end_s() + WAIT_S;
    let to_m = GLIDE_FROM_M + GLIDE_WAY_M;
    targets.root_world.x = GLIDE_FROM_M * ease(loop_s, 0.0, ASIDE_S) + run.gone(loop_s - GLIDE_S)
        - to_m * ease(loop_s, back_s, back_s + BACK_S);
    targets
}

/// Seconds to raise the arm before it is held.
pub(crate) const REACH_S: f64 = 1.2;

/// The left arm straight out to the side.
pub(crate) fn reach(since_s: f64) -> Targets {
    let mut targets = Targets::neutral();
    arm_out(&mut targets, 0.0, ease(since_s, 0.0, REACH_S));
    targets
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_goes_its_whole_way_and_at_its_speed_in_between() {
        for speed in [0.1, 2.0, 20.0] {
            let run = Run { way: 2.5, ramp: 0.75, speed };
            let (from_s, to_s) = run.steady_s();
            for (since_s, gone) in
                [(-1.0, 0.0), (0.0, 0.0), (from_s, 0.75), (to_s, 1.75), (run.end_s(), 2.5), (1e3, 2.5)]
            {
                assert!(
                    (run.gone(since_s) - gone).abs() < 1e-9,
                    "{speed}: {} at {since_s}",
                    run.gone(since_s)
                );
            }
            let step_s = 1e-6;
            let at_s = 0.5 * (from_s + to_s);
            let found = (run.gone(at_s + step_s) - run.gone(at_s)) / step_s;
            assert!((found - speed).abs() < 1e-4 * speed.max(1.0), "{found}, expected {speed}");
        }
    }
}
