//! A person that glides into a box at rest, in several phases of a film frame: how fast the box is after the first step
//! in which it moves, and at most.

use nalgebra::{Point3, Vector3};
use setup::cli::Outcome;
use sim::Solid;
use stage::{Motion, Speed, StageSettings};

use super::{FREE, Keep, Seen, body, course, each_seen, greatest};
use crate::physics::PhysicsBenchArguments;
use crate::physics::metric::{Limit, metric};

/// How fast the person is, m/s.
const SPEEDS_M_S: [f64; 4] = [1.0, 2.0, 3.0, 4.0];
/// Phases of a frame.
const PHASES: usize = 8;
/// The box's edge, and where its middle is in the first phase, metres.
const BOX_M: f64 = 0.3;
const AT_M: [f64; 3] = [0.55, 1.1, 0.0];
/// It moves if it is faster than this, m/s.
const MOVES_M_S: f64 = 0.05;
/// A run ends so long after the person begins to stop, seconds.
const AFTER_S: f64 = 0.3;
/// What true solids do, but for a tenth.
const AS_SOLIDS: Limit = Limit::Within(0.9, 1.1);

/// The box along the person's way, m/s.
#[derive(Clone, Copy)]
struct Shoved {
    first: f64,
    most: f64,
}

/// Measures all speeds.
pub fn measure(arguments: &PhysicsBenchArguments, keep: &mut Keep<'_>) -> Outcome {
    for speed_m_s in SPEEDS_M_S {
        let Some(motion) = Speed::from_m_s(speed_m_s).map(Motion::Glide) else { continue };
        let stage = StageSettings { motion, ..StageSettings::default() };
        let name = format!("shove {speed_m_s}");
        let mut of_solids: Option<Vec<Shoved>> = None;
        each_seen(&stage, FREE, arguments, |seen| {
            let shoved_by = |seed: u64| -> Outcome<Vec<Shoved>> {
                (0..PHASES).map(|phase| shove(seen, &stage, speed_m_s, phase, seed)).collect()
            };
            if seen.is_of_solids() {
                of_solids = Some(shoved_by(1)?);
            }
            keep(seen.rows(&name, arguments.seeds, |seed| {
                let shoved = shoved_by(seed)?;
                let expected = |phase: usize| {
                    of_solids
                        .as_ref()
                        .map_or(Shoved { first: speed_m_s, most: speed_m_s }, |known| known[phase])
                };
                let ratios = |of: fn(&Shoved) -> f64| {
                    let ratios =
                        shoved.iter().enumerate().map(move |(phase, found)| of(found) / of(&expected(phase)));
                    let ratios: Vec<f64> = ratios.collect();
                    [ratios.iter().copied().fold(f64::INFINITY, f64::min), greatest(ratios.iter().copied())]
                };
                let limit = of_solids.as_ref().map(|_| AS_SOLIDS);
                let ([first_least, first_most], [least, most]) =
                    (ratios(|box_| box_.first), ratios(|box_| box_.most));
                Ok(vec![
                    metric("first step / solids', least", first_least, limit),
                    metric("first step / solids', most", first_most, limit),
                    metric("fastest / solids', least", least, limit),
                    metric("fastest / solids', most", most, limit),
                ])
            })?)
        })?;
    }
    Ok(())
}

fn shove(seen: &Seen, stage: &StageSettings, speed_m_s: f64, phase: usize, seed: u64) -> Outcome<Shoved> {
    let [x, y, z] = AT_M;
    let shift_m = speed_m_s / stage.fps * phase as f64 / PHASES as f64;
    let at = Point3::new(x + shift_m, y, z);
    let body = body(Solid::Box { size_m: [BOX_M; 3] }, at, Vector3::zeros())?;
    let (_, end_s) = stage.motion.steady_s().unwrap_or_default();
    let track = seen.run(body, end_s + AFTER_S, seed)?;
    let speeds = course(&track).map(|body| body.velocity_m_s.x);
    let first = speeds.clone().find(|speed| *speed > MOVES_M_S).unwrap_or(0.0);
    Ok(Shoved { first, most: greatest(speeds) })
}
