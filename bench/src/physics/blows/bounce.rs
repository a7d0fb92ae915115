//! Balls that jump on a table, a thousand times in all: what energy they gain.

use nalgebra::{Point3, Vector3};
use setup::cli::Outcome;
use sim::{BodySpec, Solid};
use stage::props::TABLE_HEIGHT_M;
use stage::{Motion, Prop, StageSettings};

use super::{Keep, Seen, body, course, each_seen};
use crate::physics::PhysicsBenchArguments;
use crate::physics::metric::{Limit, metric};
use crate::random::Random;

/// How much of their speed a bounce returns.
const RESTITUTIONS: [f64; 2] = [0.8, 1.0];
/// Bounces of each restitution, and runs at most.
const BOUNCES: usize = 1000;
const RUNS: u64 = 400;
/// How long a ball is watched, seconds.
const WATCHED_S: f64 = 12.0;
/// Of the balls, metres.
const BALL_M: f64 = 0.06;
/// Where they begin: to the left and right of the table's middle, over it and to its front, metres.
const FROM_M: [[f64; 2]; 3] = [[-0.3, 0.3], [0.3, 1.0], [0.36, 0.64]];
const GRAVITY_M_S2: f64 = 9.81;

/// Of one ball while it is over the table.
struct Bounced {
    bounces: usize,
    /// The most energy that it had over its least so far, J/kg.
    gained_j_kg: f64,
}

/// Measures both restitutions.
pub fn measure(arguments: &PhysicsBenchArguments, keep: &mut Keep<'_>) -> Outcome {
    let stage = StageSettings {
        motion: Motion::Idle,
        person: false,
        props: vec![Prop::Table],
        ..StageSettings::default()
    };
    for restitution in RESTITUTIONS {
        let scene = format!(
            "[floor]\nrestitution = {restitution:?}\n[hull]\nrestitution = {restitution:?}\nfriction = 0.3\n"
        );
        let name = format!("bounce {restitution}");
        each_seen(&stage, &scene, arguments, |seen| {
            keep(seen.rows(&name, arguments.seeds, |seed| {
                let (mut bounces, mut gained_j_kg) = (0, 0.0_f64);
                for run in 0..RUNS {
                    if bounces >= BOUNCES {
                        break;
                    }
                    let found = bounce(seen, restitution, seed, &mut Random::new(seed << 20 | run))?;
                    bounces += found.bounces;
                    gained_j_kg = gained_j_kg.max(found.gained_j_kg);
                }
                Ok(vec![
                    metric("bounces", bounces as f64, Some(Limit::Least(BOUNCES as f64))),
                    metric("energy gained, J/kg", gained_j_kg, Some(Limit::Most(0.05))),
                ])
            })?)
        })?;
    }
    Ok(())
}

fn bounce(seen: &Seen, restitution: f64, seed: u64, random: &mut Random) -> Outcome<Bounced> {
    let [x, over_m, z] = FROM_M.map(|[from, to]| from + (to - from) * random.share());
    let at = Point3::new(x, TABLE_HEIGHT_M + over_m, z);
    let ball = body(Solid::Ball { radius_m: BALL_M }, at, Vector3::zeros())?;
    let track = seen.run(BodySpec { restitution, friction: 0.3, ..ball }, WATCHED_S, seed)?;
    let (mut least, mut bounced) = (f64::INFINITY, Bounced { bounces: 0, gained_j_kg: 0.0 });
    let mut falls = false;
    for ball in course(&track).take_while(|ball| ball.place().y > TABLE_HEIGHT_M) {
        let turning = 0.4 * BALL_M * BALL_M * ball.spin_rad_s * ball.spin_rad_s;
        let energy = GRAVITY_M_S2 * ball.place().y + 0.5 * (ball.velocity_m_s.norm_squared() + turning);
        least = least.min(energy);
        bounced.gained_j_kg = bounced.gained_j_kg.max(energy - least);
        bounced.bounces += usize::from(falls && ball.velocity_m_s.y > 0.0);
        falls = ball.velocity_m_s.y < 0.0;
    }
    Ok(bounced)
}
