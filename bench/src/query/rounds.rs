//! Where a pass spends its time: nanoseconds of each round, by all cameras together and by cameras alone.

use std::collections::BTreeMap;

use hull::ViewSet;
use hull::cull::WorldBox;
use hull::pass::Round;
use serde::Serialize;
use setup::cli::Outcome;

use super::lanes::REPETITION_S;
use crate::loads::Studio;
use crate::passes::{Asked, Passes};
use crate::usage::thread_cpu_s;

/// Nanoseconds of one core a point of the load, over all groups of cameras.
#[derive(Clone, Debug, Default, Serialize)]
pub struct RoundCosts {
    /// Of the cameras' images.
    pub size: String,
    /// Name of the load: the points that were asked about.
    pub load: String,
    /// Which cameras stand together.
    pub engine: &'static str,
    /// Which are inside?
    pub classes_ns: f64,
    /// The nearest edge and its normal, or plane.
    pub edges_ns: f64,
    /// The exit along the normal.
    pub exits_ns: f64,
    /// The exit along the body's mean.
    pub body_exits_ns: f64,
    /// Which are still inside?
    pub check_ns: f64,
    /// Between the rounds: making questions and merging answers, which a coordinator does.
    pub pass_ns: f64,
}

impl RoundCosts {
    /// The cost of the answers alone: what the processes with the cameras do.
    pub fn answers_ns(&self) -> f64 {
        self.classes_ns + self.edges_ns + self.exits_ns + self.body_exits_ns + self.check_ns
    }
}

/// Repeats a pass and shares its time out to the rounds. Bodies are searched at first as far as the pass
/// before found their edges.
pub fn round_costs<B: Asked>(
    studio: &Studio,
    (size, load): (&str, &str),
    (engine, groups): (&'static str, &[ViewSet]),
    bodies: &[B],
) -> Outcome<RoundCosts> {
    let mut asked = Passes::new(studio.settings, groups.len());
    let mut pass = |seconds: &mut BTreeMap<Round, f64>| {
        let mut before_s = thread_cpu_s();
        let mut lap = |round| {
            let now_s = thread_cpu_s();
            *seconds.entry(round).or_default() += now_s - before_s;
            before_s = now_s;
        };
        asked.begin(bodies, &WorldBox::EVERYWHERE);
        lap(Round::Done);
        asked.answer(groups, lap)
    };
    pass(&mut BTreeMap::new())?;
    let (began_s, mut passes, mut seconds) = (thread_cpu_s(), 0usize, BTreeMap::new());
    while thread_cpu_s() - began_s < 2.0 * REPETITION_S {
        pass(&mut seconds)?;
        passes += 1;
    }
    let points = passes * bodies.iter().map(Asked::point_count).sum::<usize>();
    let ns = |round| 1e9 * seconds.get(&round).copied().unwrap_or_default() / points.max(1) as f64;
    Ok(RoundCosts {
        size: size.to_owned(),
        load: load.to_owned(),
        engine,
        classes_ns: ns(Round::Classes),
        edges_ns: ns(Round::Edges),
        exits_ns: ns(Round::Exits),
        body_exits_ns: ns(Round::BodyExits),
        check_ns: ns(Round::Check),
        pass_ns: ns(Round::Done),
    })
}
