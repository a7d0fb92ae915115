//! Balls that fly at an arm held still: whether they pass, and whether what stops them is the hull. The hull of a level
//! arm is far deeper than the arm; it is known exactly where it is.

use std::f64::consts::TAU;

use hull::Camera;
use nalgebra::{Point3, Vector3};
use setup::cli::{Failure, Outcome};
use sim::Solid;
use stage::{Joint, Motion, NEUTRAL_S, StageSettings, Truth, studio_rig};

use super::{BALL_M, FREE, Keep, Seen, body, course, each_seen};
use crate::physics::PhysicsBenchArguments;
use crate::physics::metric::{Limit, Metric, metric};
use crate::physics::track::BodyAt;
use crate::random::Random;

/// How many, and how fast, m/s.
const BALLS: usize = 200;
const SPEEDS_M_S: [f64; 2] = [5.0, 20.0];
/// When they are where the arm is, film time, seconds: it is held still before.
const HITS_S: [f64; 2] = [NEUTRAL_S + 1.5, NEUTRAL_S + 1.7];
/// A run ends so long after, seconds.
const AFTER_S: f64 = 0.4;
/// They fly at the arm between these shares of the way from elbow to knuckles, and so far beside it at most, metres.
const ALONG: [f64; 2] = [0.3, 0.9];
const ASIDE_M: f64 = 0.01;
/// A ball has gone on if it is so far beyond the arm, metres, with so much of its speed left.
const BEYOND_M: f64 = 0.12;
const LEFT: f64 = 0.25;
/// It has passed through the hull, and not along a side of it, if it came out at such a share of the way through at least.
const THROUGH: f64 = 0.5;
/// Its way is looked at in pieces of this length, metres.
const PIECE_M: f64 = 0.01;
/// No way through the hull of an arm is longer, metres.
const LONGEST_M: f64 = 1.0;
/// What changes the velocity by less than this share is no contact; a contact is wrong if no point of the hull is so near
/// to the ball, metres.
const CHANGED: f64 = 0.01;
const WRONG_M: f64 = 0.03;
/// Points of a ball that are looked at, in so many shells.
const POINTS: usize = 60;
const SHELLS: usize = 3;

/// The hull of an image without pixels.
struct ExactHull {
    truth: Truth,
    eyes_world: Vec<Point3<f64>>,
}

impl ExactHull {
    fn new(stage: &StageSettings, cameras: usize, time_s: f64) -> Outcome<ExactHull> {
        let rig = studio_rig(cameras, (640, 480)).map_err(Failure::input)?;
        let eyes_world = rig.cameras().iter().map(Camera::centre_world).collect();
        Ok(ExactHull { truth: Truth::new(stage, time_s), eyes_world })
    }

    fn holds(&self, point_world: &Point3<f64>) -> bool {
        self.eyes_world.iter().all(|eye| self.truth.meets_ray(eye, point_world))
    }

    /// Whether a point of it is no farther from another.
    fn is_near(&self, centre_world: &Point3<f64>, within_m: f64) -> bool {
        let shell = |shell: usize| {
            let radius_m = within_m * shell as f64 / SHELLS as f64;
            let count = if shell == 0 { 1 } else { POINTS };
            directions(count).any(|direction| self.holds(&(centre_world + direction * radius_m)))
        };
        (0..=SHELLS).any(shell)
    }

    /// How far through the hull a way went, as a share of the straight way on from where it came in; `None` if it never did.
    fn share_of_way_through(
        &self,
        places: impl Iterator<Item = Point3<f64>>,
        way: &Vector3<f64>,
    ) -> Option<f64> {
        let mut inside = places.filter(|place| self.holds(place));
        let first = inside.next()?;
        let last = inside.last().unwrap_or(first);
        let pieces = (1..(LONGEST_M / PIECE_M) as usize).map(|piece| piece as f64 * PIECE_M);
        let through_m =
            pieces.take_while(|ahead_m| self.holds(&(first + way * *ahead_m))).last().unwrap_or(PIECE_M);
        Some((last - first).dot(way) / through_m)
    }
}

/// Places along a ball's way, close together.
fn places_along<'a>(track: &'a [&BodyAt]) -> impl Iterator<Item = Point3<f64>> + 'a {
    track.windows(2).flat_map(|pair| {
        let (from, to) = (pair[0].place(), pair[1].place());
        let pieces = ((to - from).norm() / PIECE_M).ceil().max(1.0);
        (0..pieces as usize).map(move |piece| from + (to - from) * (piece as f64 / pieces))
    })
}

/// Directions evenly over the sphere.
fn directions(count: usize) -> impl Iterator<Item = Vector3<f64>> {
    let golden_rad = TAU * (0.5 * (5.0_f64.sqrt() - 1.0));
    (0..count).map(move |index| {
        let up = 1.0 - (2 * index + 1) as f64 / count as f64;
        let (s, c) = libm::sincos(golden_rad * index as f64);
        let level = (1.0 - up * up).sqrt();
        Vector3::new(level * c, up, level * s)
    })
}

/// What became of a ball.
struct Thrown {
    /// It is beyond the arm and flies on.
    went_on: bool,
    /// And has passed through the hull. The arm's hull has inclined sides, along which a ball may fly on.
    has_passed: bool,
    /// Whether its first contact was with the hull; `None` if it met nothing.
    met_hull: Option<bool>,
}

/// Measures it.
pub fn measure(arguments: &PhysicsBenchArguments, keep: &mut Keep<'_>) -> Outcome {
    let stage = StageSettings { motion: Motion::Reach, ..StageSettings::default() };
    let hull = ExactHull::new(&stage, arguments.cameras, HITS_S[0])?;
    each_seen(&stage, FREE, arguments, |seen| {
        keep(seen.rows("throw", arguments.seeds, |seed| {
            let thrown =
                (0..BALLS).map(|ball| throw(seen, &hull, &stage, Random::new(seed << 20 | ball as u64)));
            Ok(judge(&thrown.collect::<Outcome<Vec<Thrown>>>()?, seen.is_of_solids()))
        })?)
    })
}

fn throw(seen: &Seen, hull: &ExactHull, stage: &StageSettings, mut random: Random) -> Outcome<Thrown> {
    let mut between = |[from, to]: [f64; 2]| from + (to - from) * random.share();
    let (speed_m_s, hit_s, turn_rad) = (between(SPEEDS_M_S), between(HITS_S), between([0.0, TAU]));
    let (share, aside_m) = (between(ALONG), between([-ASIDE_M, ASIDE_M]));
    let [elbow, knuckles] =
        [Joint::LeftElbow, Joint::LeftHand].map(|joint| stage.motion.joint_world(joint, hit_s));
    let (s, c) = libm::sincos(turn_rad);
    let way = Vector3::new(0.0, s, c);
    let hit = elbow + (knuckles - elbow) * share + Vector3::new(0.0, c, -s) * aside_m;
    let ball = body(Solid::Ball { radius_m: BALL_M }, hit - way * (speed_m_s * hit_s), way * speed_m_s)?;
    let track = seen.run(ball, hit_s + AFTER_S, 1)?;
    let Some(last) = course(&track).next_back() else { return Err(Failure::run("a run without a step")) };
    let is_beyond = (last.place() - hit).dot(&way) > BEYOND_M;
    let went_on = is_beyond && last.velocity_m_s.dot(&way) > LEFT * speed_m_s;
    let whole: Vec<&BodyAt> = course(&track).collect();
    let through = went_on.then(|| hull.share_of_way_through(places_along(&whole), &way)).flatten();
    let steps = course(&track).zip(course(&track).skip(1));
    let mut contacts = steps
        .filter(|(before, after)| (after.velocity_m_s - before.velocity_m_s).norm() > CHANGED * speed_m_s);
    let within_m = BALL_M + WRONG_M;
    let met_hull = contacts
        .next()
        .map(|(before, after)| [before, after].iter().any(|ball| hull.is_near(&ball.place(), within_m)));
    Ok(Thrown { went_on, has_passed: through.is_some_and(|share| share > THROUGH), met_hull })
}

fn judge(thrown: &[Thrown], is_of_solids: bool) -> Vec<Metric> {
    let count = |is: &dyn Fn(&Thrown) -> bool| thrown.iter().filter(|ball| is(ball)).count() as f64;
    let met = count(&|ball| ball.met_hull.is_some());
    let wrong = count(&|ball| ball.met_hull == Some(false));
    // An arm is no hull: what passes above it may well meet the hull.
    let limit = |limit: Limit| (!is_of_solids).then_some(limit);
    vec![
        metric("passed of 200", count(&|ball| ball.has_passed), limit(Limit::Most(0.0))),
        metric("flew on", count(&|ball| ball.went_on), None),
        metric("met something", met, None),
        metric("3 cm off the hull, %", 100.0 * wrong / met.max(1.0), limit(Limit::Most(1.0))),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exact_hull_is_about_the_arm_and_not_beside_it() {
        let stage = StageSettings { motion: Motion::Reach, ..StageSettings::default() };
        let hull = ExactHull::new(&stage, 8, HITS_S[0]).expect("a rig");
        let wrist = stage.motion.joint_world(Joint::LeftWrist, HITS_S[0]);
        assert!(hull.holds(&wrist));
        let beside = wrist + Vector3::new(0.0, 0.0, 0.4);
        assert!(!hull.holds(&beside) && !hull.is_near(&beside, 0.1) && hull.is_near(&beside, 0.4));
    }

    #[test]
    fn a_way_through_the_hull_is_told_from_one_along_its_side() {
        let stage = StageSettings { motion: Motion::Reach, ..StageSettings::default() };
        let hull = ExactHull::new(&stage, 8, HITS_S[0]).expect("a rig");
        let wrist = stage.motion.joint_world(Joint::LeftWrist, HITS_S[0]);
        let way = Vector3::z();
        let share = |from_m: f64, to_m: f64, beside_m: f64| {
            let pieces = (from_m / PIECE_M) as i32..(to_m / PIECE_M) as i32;
            let place = |piece| wrist + way * (f64::from(piece) * PIECE_M) + Vector3::y() * beside_m;
            hull.share_of_way_through(pieces.map(place), &way)
        };
        assert!(share(-0.5, 0.5, 0.0).is_some_and(|share| (0.9..=1.1).contains(&share)));
        assert!(share(-0.5, 0.0, 0.0).is_some_and(|share| share < 0.8), "it stopped inside");
        assert_eq!(share(-0.5, 0.5, 0.5), None, "it never came in");
    }

    #[test]
    fn directions_are_even() {
        let sum: Vector3<f64> = directions(POINTS).sum();
        assert!(sum.norm() < 1.0, "{sum}");
        assert!(directions(POINTS).all(|direction| (direction.norm() - 1.0).abs() < 1e-9));
    }
}
