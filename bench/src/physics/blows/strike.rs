//! An arm that swings level against balls at rest, which float where a place of the arm comes by.

use nalgebra::{Point3, Vector3};
use setup::cli::Outcome;
use sim::Solid;
use stage::{Joint, Motion, Speed, StageSettings};

use super::{BALL_M, BodyAt, FREE, Keep, body, course, each_seen, greatest};
use crate::physics::PhysicsBenchArguments;
use crate::physics::metric::{Limit, Metric, metric};
use crate::random::Random;

/// How fast the place is that strikes, m/s.
const SPEEDS_M_S: [f64; 5] = [0.5, 1.0, 2.0, 4.0, 6.0];
/// Balls of each speed.
const BALLS: usize = 50;
/// A ball lies so far from the way of the place at most, along the arm and up, metres.
const ASIDE_M: [f64; 2] = [0.03, 0.015];
/// A run ends so long after the middle of the arm is where the ball was, seconds.
const AFTER_S: f64 = 0.3;
/// A ball is missed if it leaves with less than this share of the speed, and leaves well between these.
const MISSED: f64 = 0.25;
const WELL: std::ops::RangeInclusive<f64> = 0.8..=1.5;
/// None is faster than so many times the fastest that true solids make.
const MOST_OF_SOLIDS: f64 = 1.2;

/// What strikes.
#[derive(Clone, Copy)]
enum Part {
    Fist,
    Forearm,
}

impl Part {
    fn name(self) -> &'static str {
        match self {
            Part::Fist => "fist",
            Part::Forearm => "forearm",
        }
    }

    /// How far from the shoulder it is, metres.
    fn out_m(self) -> f64 {
        match self {
            Part::Fist => 0.61,
            Part::Forearm => 0.42,
        }
    }
}

/// What became of a ball, as shares of the speed of what struck it.
struct Struck {
    /// Along the way of the blow, at the end.
    left: f64,
    /// In any direction, at any time.
    fastest: f64,
}

/// Measures all parts and speeds.
pub fn measure(arguments: &PhysicsBenchArguments, keep: &mut Keep<'_>) -> Outcome {
    for part in [Part::Fist, Part::Forearm] {
        for speed_m_s in SPEEDS_M_S {
            let motion = swing(part, speed_m_s);
            let stage = StageSettings { motion, ..StageSettings::default() };
            let name = format!("strike {} {speed_m_s}", part.name());
            let mut of_solids = None;
            each_seen(&stage, FREE, arguments, |seen| {
                let mut fastest = 0.0;
                let rows = seen.rows(&name, arguments.seeds, |seed| {
                    let struck = (0..BALLS).map(|ball| {
                        let mut random = Random::new(seed << 20 | ball as u64);
                        let (at, way, time_s) = target(motion, part, &mut random);
                        let body = body(Solid::Ball { radius_m: BALL_M }, at, Vector3::zeros())?;
                        let track = seen.run(body, time_s + AFTER_S, seed)?;
                        let left_m_s =
                            course(&track).next_back().map_or(0.0, |ball| ball.velocity_m_s.dot(&way));
                        let fastest_m_s = greatest(course(&track).map(BodyAt::speed_m_s));
                        Ok(Struck { left: left_m_s / speed_m_s, fastest: fastest_m_s / speed_m_s })
                    });
                    Ok(judge(&struck.collect::<Outcome<Vec<Struck>>>()?, speed_m_s, of_solids))
                })?;
                for row in &rows {
                    if row.metric == FASTEST {
                        fastest = row.value.unwrap_or(f64::NAN);
                    }
                }
                if seen.is_of_solids() {
                    of_solids = Some(fastest);
                }
                keep(rows)
            })?;
        }
    }
    Ok(())
}

const FASTEST: &str = "fastest / speed of the blow";

fn judge(struck: &[Struck], speed_m_s: f64, of_solids: Option<f64>) -> Vec<Metric> {
    let count = |is: &dyn Fn(&Struck) -> bool| struck.iter().filter(|ball| is(ball)).count() as f64;
    let most_missed = if speed_m_s > 4.0 { 5.0 } else { 1.0 };
    let fastest = greatest(struck.iter().map(|ball| ball.fastest));
    vec![
        metric("missed of 50", count(&|ball| ball.left < MISSED), Some(Limit::Most(most_missed))),
        metric("left well of 50", count(&|ball| WELL.contains(&ball.left)), Some(Limit::Least(45.0))),
        metric(FASTEST, fastest, of_solids.map(|fastest| Limit::Most(MOST_OF_SOLIDS * fastest))),
    ]
}

/// The swing in which a part is so fast.
fn swing(part: Part, speed_m_s: f64) -> Motion {
    let motion = |speed_m_s: f64| Speed::from_m_s(speed_m_s).map_or(Motion::Reach, Motion::Swing);
    // The speed of a swing is that of the knuckles.
    let knuckles_m = {
        let Some((from_s, _)) = motion(1.0).steady_s() else { return Motion::Reach };
        (motion(1.0).joint_world(Joint::LeftHand, from_s)
            - motion(1.0).joint_world(Joint::LeftShoulder, from_s))
        .norm()
    };
    motion(speed_m_s * knuckles_m / part.out_m())
}

/// Where a ball lies, which way the part comes by there, and when.
fn target(motion: Motion, part: Part, random: &mut Random) -> (Point3<f64>, Vector3<f64>, f64) {
    let (from_s, to_s) = motion.steady_s().unwrap_or_default();
    let time_s = from_s + (to_s - from_s) * (0.2 + 0.7 * random.share());
    let shoulder = motion.joint_world(Joint::LeftShoulder, time_s);
    let arm = (motion.joint_world(Joint::LeftHand, time_s) - shoulder).normalize();
    let [along_m, up_m] = ASIDE_M.map(|aside_m| aside_m * random.signed());
    let at = shoulder + arm * (part.out_m() + along_m) + Vector3::y() * up_m;
    // From the person's left to its front.
    (at, arm.cross(&Vector3::y()).normalize(), time_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_part_comes_by_at_its_speed() {
        for part in [Part::Fist, Part::Forearm] {
            for speed_m_s in SPEEDS_M_S {
                let motion = swing(part, speed_m_s);
                let (_, way, time_s) = target(motion, part, &mut Random::new(3));
                let place = |time_s: f64| {
                    let shoulder = motion.joint_world(Joint::LeftShoulder, time_s);
                    let arm = (motion.joint_world(Joint::LeftHand, time_s) - shoulder).normalize();
                    shoulder + arm * part.out_m()
                };
                let velocity = (place(time_s + 1e-4) - place(time_s - 1e-4)) / 2e-4;
                assert!((velocity.dot(&way) / speed_m_s - 1.0).abs() < 0.01, "{velocity} along {way}");
            }
        }
    }

    #[test]
    fn balls_that_stay_are_missed_and_those_that_leave_as_fast_left_well() {
        let ball = |left: f64, fastest: f64| Struck { left, fastest };
        let metrics = judge(&[ball(0.1, 0.1), ball(1.0, 1.1), ball(2.0, 2.1)], 2.0, Some(1.5));
        assert_eq!(metrics.iter().map(|metric| metric.value).collect::<Vec<_>>(), [1.0, 1.0, 2.1]);
        assert!(!metrics[2].limit.is_some_and(|limit| limit.holds(2.1)));
    }
}
