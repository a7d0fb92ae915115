//! Where a pass spends its time: nanoseconds of each round, by all cameras together and by cameras alone.

use hull::ViewSet;
use hull::cull::WorldBox;
use hull::pass::{Pass, Reaches, Round};
use hull::question::{Answer, Points};
use hull::view_set::Scratch;
use serde::Serialize;

use super::lanes::REPETITION_S;
use crate::loads::Studio;
use crate::usage::thread_cpu_s;
use cli::{Failure, Outcome};

/// Nanoseconds of one core a point of the load, over all groups of cameras.
#[derive(Clone, Debug, Default, Serialize)]
pub struct RoundCosts {
    /// Of the cameras' images.
    pub size: String,
    /// Which points.
    pub load: String,
    /// Which cameras stand together.
    pub engine: &'static str,
    /// Which are inside?
    pub classes_ns: f64,
    /// The nearest edge and its normal.
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
pub fn round_costs(
    studio: &Studio,
    (size, load): (&str, &str),
    (engine, groups): (&'static str, &[ViewSet]),
    bodies: &[Points],
) -> Outcome<RoundCosts> {
    let mut clock = Clock::new(studio, groups);
    clock.pass(groups, bodies)?;
    clock.seconds = [0.0; 6];
    let (began_s, mut passes) = (thread_cpu_s(), 0usize);
    while thread_cpu_s() - began_s < 2.0 * REPETITION_S {
        clock.pass(groups, bodies)?;
        passes += 1;
    }
    let points = passes * bodies.iter().map(Points::len).sum::<usize>();
    let [classes_ns, edges_ns, exits_ns, body_exits_ns, check_ns, pass_ns] =
        clock.seconds.map(|seconds| 1e9 * seconds / points.max(1) as f64);
    let (size, load) = (size.to_owned(), load.to_owned());
    Ok(RoundCosts { size, load, engine, classes_ns, edges_ns, exits_ns, body_exits_ns, check_ns, pass_ns })
}

/// A pass that is timed between its questions.
struct Clock {
    pass: Pass,
    scratch: Scratch,
    answer: Answer,
    reaches: Vec<Reaches>,
    /// Of each round, and last of what is between them.
    seconds: [f64; 6],
    before_s: f64,
}

impl Clock {
    fn new(studio: &Studio, groups: &[ViewSet]) -> Clock {
        let mut pass = Pass::new(Vec::new(), Some(&WorldBox::EVERYWHERE), studio.settings, groups.len());
        pass.ask_in_two_phases(true);
        Clock {
            pass,
            scratch: Scratch::default(),
            answer: Answer::default(),
            reaches: Vec::new(),
            seconds: [0.0; 6],
            before_s: 0.0,
        }
    }

    fn pass(&mut self, groups: &[ViewSet], bodies: &[Points]) -> Outcome {
        self.reaches.resize_with(bodies.len(), Reaches::default);
        self.reaches.iter_mut().zip(self.pass.results()).for_each(|(reaches, result)| reaches.note(result));
        self.before_s = thread_cpu_s();
        let asked = bodies.iter().cloned().zip(&self.reaches);
        self.pass.restart(asked, Some(&WorldBox::EVERYWHERE));
        self.lap(Round::Done);
        while let Some(question) = self.pass.question() {
            let next = (0..groups.len()).find(|&group| self.pass.asks(group));
            let group = next.ok_or_else(|| Failure::run("a pass asks nobody"))?;
            let round = self.pass.round();
            groups[group].answer(question, &mut self.scratch, &mut self.answer);
            self.lap(round);
            self.pass.answer(group, &self.answer).map_err(Failure::run)?;
            self.lap(Round::Done);
        }
        Ok(())
    }

    /// Counts the time since the last lap for a round.
    fn lap(&mut self, round: Round) {
        let now_s = thread_cpu_s();
        let place = match round {
            Round::Classes => 0,
            Round::Edges => 1,
            Round::Exits => 2,
            Round::BodyExits => 3,
            Round::Check => 4,
            Round::Done => 5,
        };
        self.seconds[place] += now_s - self.before_s;
        self.before_s = now_s;
    }
}
