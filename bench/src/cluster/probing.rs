//! What the benches ask of the hull: passes one after the other, as a running coordinator makes them.

use hull::cull::WorldBox;
use hull::pass::{Pass, Reaches};
use hull::question::{Answer, Batch, Points, Question, QuestionKind};
use hull::view_set::Scratch;
use hull::{ProbeSettings, ViewSet};

use crate::usage::thread_cpu_s;
use cli::{Failure, Outcome};

/// How many of the points all cameras of a group see as foreground.
pub fn inside_count(views: &ViewSet, points: Points, scratch: &mut Scratch) -> usize {
    let question =
        Question { kind: QuestionKind::Classes, batches: vec![Batch::all(points)], ..Question::default() };
    let mut answer = Answer::default();
    views.answer(&question, scratch, &mut answer);
    answer.standings.iter().filter(|standing| standing.inside_count().is_some()).count()
}

/// The same points, as points of the world that nobody has registered.
pub fn to_world(points: Points) -> Points {
    let Points::Body { shape, pose } = points else { return points };
    let world_from_body = pose.world_from_body();
    Points::World(shape.samples_body().iter().map(|&sample| world_from_body(sample).into()).collect())
}

/// Passes that follow one another: buffers are kept, and the depth of bodies bounds the next search.
pub struct Passes {
    /// The pass that was begun last.
    pub pass: Pass,
    reaches: Vec<Reaches>,
}

impl Passes {
    /// Passes to be asked of so many groups.
    pub fn new(settings: ProbeSettings, groups: usize) -> Passes {
        Passes { pass: Pass::new(Vec::new(), None, settings, groups), reaches: Vec::new() }
    }

    /// Begins the next.
    pub fn begin(&mut self, bodies: &[Points]) {
        self.reaches.resize_with(bodies.len(), Reaches::default);
        // Every body touches the person: none would be culled by a box around the hull.
        self.pass.restart(bodies.iter().cloned().zip(&self.reaches), Some(&WorldBox::EVERYWHERE));
    }

    /// Ends it; returns how many samples were inside.
    pub fn end(&mut self) -> usize {
        let results = self.pass.results();
        self.reaches.iter_mut().zip(results).for_each(|(reaches, result)| reaches.note(result));
        results.iter().map(|body| body.touches.len()).sum()
    }

    /// A whole pass in this process; returns its processor time, milliseconds.
    pub fn locally(&mut self, views: &ViewSet, bodies: &[Points], local: &mut Local) -> Outcome<f64> {
        let began_s = thread_cpu_s();
        self.begin(bodies);
        while let Some(question) = self.pass.question() {
            views.answer(question, &mut local.scratch, &mut local.answer);
            self.pass.answer(0, &local.answer).map_err(Failure::run)?;
        }
        let took_ms = (thread_cpu_s() - began_s) * 1e3;
        self.end();
        Ok(took_ms)
    }
}

/// Buffers for probing in this process.
#[derive(Default)]
pub struct Local {
    scratch: Scratch,
    answer: Answer,
}
