//! Where a pass spends its time: nanoseconds a point of each round.

use hull::ViewSet;
use hull::cull::WorldBox;
use hull::pass::{FIRST_REACH, Pass, Round};
use hull::question::{Answer, Points};
use hull::view_set::Scratch;
use serde::Serialize;

use super::lanes::{REPETITION_S, thread_time_s};
use crate::bench::loads::Studio;
use crate::failure::{Failure, Outcome};

/// Nanoseconds of one core a point that is asked about.
#[derive(Clone, Debug, Default, Serialize)]
pub struct RoundCosts {
    /// Of the cameras' images.
    pub size: String,
    /// Which points.
    pub load: String,
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
    /// Merging, culling, and making the questions, a point of the pass.
    pub pass_ns: f64,
}

/// Repeats a pass of all cameras in one group and shares its time out to the rounds.
pub fn round_costs(studio: &Studio, size: &str, load: &str, bodies: &[Points]) -> Outcome<RoundCosts> {
    let mut clock = Clock { seconds: [0.0; 6], points: [0; 6] };
    let mut pass = Pass::new(Vec::new(), Some(&WorldBox::EVERYWHERE), studio.settings, 1);
    let (mut scratch, mut answer) = (Scratch::default(), Answer::default());
    let began_s = thread_time_s();
    while thread_time_s() - began_s < 2.0 * REPETITION_S {
        clock.pass(&mut pass, &studio.views, bodies, &mut scratch, &mut answer)?;
    }
    let ns = |index: usize| 1e9 * clock.seconds[index] / clock.points[index].max(1) as f64;
    Ok(RoundCosts {
        size: size.to_owned(),
        load: load.to_owned(),
        classes_ns: ns(0),
        edges_ns: ns(1),
        exits_ns: ns(2),
        body_exits_ns: ns(3),
        check_ns: ns(4),
        pass_ns: ns(5),
    })
}

/// Seconds and points of each round, and last of what is between them.
struct Clock {
    seconds: [f64; 6],
    points: [usize; 6],
}

impl Clock {
    fn pass(
        &mut self,
        pass: &mut Pass,
        views: &ViewSet,
        bodies: &[Points],
        scratch: &mut Scratch,
        answer: &mut Answer,
    ) -> Outcome {
        let mut before_s = thread_time_s();
        let mut lap = |clock: &mut Clock, index: usize, points: usize| {
            let now_s = thread_time_s();
            clock.seconds[index] += now_s - before_s;
            clock.points[index] += points;
            before_s = now_s;
        };
        pass.restart(bodies.iter().map(|points| (points.clone(), FIRST_REACH)), Some(&WorldBox::EVERYWHERE));
        lap(self, 5, bodies.iter().map(Points::len).sum());
        while let Some(question) = pass.question() {
            let points = question.len();
            let round = pass.round();
            views.answer(question, scratch, answer);
            lap(self, place(round), points);
            pass.answer(0, answer).map_err(Failure::run)?;
            lap(self, 5, 0);
        }
        Ok(())
    }
}

fn place(round: Round) -> usize {
    match round {
        Round::Classes => 0,
        Round::Edges => 1,
        Round::Exits => 2,
        Round::BodyExits => 3,
        Round::Check => 4,
        Round::Done => 5,
    }
}
