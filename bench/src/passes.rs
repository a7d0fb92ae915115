//! Passes one after the other, as a running coordinator makes them.

use hull::cull::WorldBox;
use hull::pass::{AskedBody, Pass, Reaches, Round};
use hull::question::{Answer, Points};
use hull::view_set::Scratch;
use hull::{ProbeSettings, ViewSet};

use cli::{Failure, Outcome};

/// A pass that is asked again and again, with its buffers and what it learned of the bodies.
pub struct Passes {
    /// The pass that was begun last.
    pub pass: Pass,
    reaches: Vec<Reaches>,
    scratch: Scratch,
    answer: Answer,
}

impl Passes {
    /// To be asked of so many groups, in two phases where several answer.
    pub fn new(settings: ProbeSettings, group_count: usize) -> Passes {
        let mut pass = Pass::new(Vec::new(), None, settings, group_count);
        pass.ask_in_two_phases(true);
        Passes { pass, reaches: Vec::new(), scratch: Scratch::default(), answer: Answer::default() }
    }

    /// Begins the next. Bodies that were asked before are searched at first as far as their edges were then.
    pub fn begin(&mut self, bodies: &[Points], hull_box: &WorldBox) {
        self.reaches.resize_with(bodies.len(), Reaches::default);
        self.reaches.iter_mut().zip(self.pass.results()).for_each(|(reaches, result)| reaches.note(result));
        let bodies = bodies.iter().cloned().zip(&self.reaches);
        let asked = bodies.map(|(points, reaches)| AskedBody::plain(points, reaches));
        self.pass.restart(asked, Some(hull_box));
    }

    /// Has it answered on this thread, by the groups one after the other. `lap` hears of every round that was
    /// answered, and of [`Round::Done`] after what lies between: making questions and merging answers.
    pub fn answer(&mut self, groups: &[ViewSet], mut lap: impl FnMut(Round)) -> Outcome {
        while let Some(question) = self.pass.question() {
            let next = (0..groups.len()).find(|&group| self.pass.asks(group));
            let group = next.ok_or_else(|| Failure::run("a pass asks nobody"))?;
            let round = self.pass.round();
            groups[group].answer(question, &mut self.scratch, &mut self.answer);
            lap(round);
            self.pass.answer(group, &self.answer).map_err(Failure::run)?;
            lap(Round::Done);
        }
        Ok(())
    }

    /// A whole pass on this thread.
    pub fn ask(&mut self, bodies: &[Points], groups: &[ViewSet], hull_box: &WorldBox) -> Outcome {
        self.begin(bodies, hull_box);
        self.answer(groups, |_| {})
    }

    /// How many samples of all bodies the last pass found inside.
    pub fn inside_count(&self) -> usize {
        self.pass.results().iter().map(|body| body.touches.len()).sum()
    }
}
