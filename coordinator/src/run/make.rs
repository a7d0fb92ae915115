//! Has the hull asked and a step made, and hands out what came of it.

use std::time::Duration;

use sim::{Fault, FaultKind, WorldError};
use tokio::time::Instant;

use super::now;
use super::{Coordinator, RunError, Watcher};
use crate::core::run::{AnsweredStep, MadeStep, Unanswered};
use crate::hooks::{FrameRecord, StepRecord};
use crate::roster::LOCK_STEP_TIMEOUT;

/// Bodies of which a fault is logged; further ones are counted alone.
const MAX_FAULTY: usize = 64;

impl Coordinator {
    /// From the next pass on asks those who answer now.
    pub(super) fn regroup(&mut self) {
        let answering = self.transport.answering();
        self.run.hull.ask_from(answering, self.transport.roster());
    }

    /// A frame has come into use: nodes and the recorder keep it.
    pub(super) async fn use_frame(&mut self, frame: u64) -> Result<(), RunError> {
        self.transport.use_frame(frame);
        if self.transport.choose_placement() {
            self.regroup();
        }
        let Some(recorder) = &mut self.log.recorder else { return Ok(()) };
        recorder.frame(FrameRecord {
            frame,
            reports: &self.transport.roster().reports(frame).unwrap_or_default(),
            silhouettes: self.transport.silhouettes(frame),
        });
        let deadline = Instant::now() + LOCK_STEP_TIMEOUT;
        while self.run.settings.lock_step && !recorder.is_ready() {
            if Instant::now() > deadline {
                return Err(RunError::Unrecorded { frame });
            }
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
        Ok(())
    }

    /// Has the run's pass answered.
    pub(super) async fn ask_hull(&mut self, frame: u64, timeout: Option<Duration>) {
        let (pass, mut took) = self.run.pass();
        let answered = self.transport.run_pass(pass, frame, timeout, &mut took).await;
        drop(took);
        if answered.is_err() {
            self.transport.drain();
        }
        let answered = answered.map_err(|error| Unanswered(error.to_string()));
        self.run.answered(answered, self.transport.roster_mut(), &now);
    }

    /// Makes a step, and hands out what came of it.
    pub(super) async fn make_step(
        &mut self,
        mut step: AnsweredStep,
        watcher: &mut dyn Watcher,
    ) -> Result<(), RunError> {
        if let Some(alter) = self.script.alter {
            step.responses.iter_mut().for_each(alter);
        }
        self.note_touches(&step.responses, step.collisions.as_deref());
        let made = match self.run.make(&step, self.transport.roster(), &now) {
            // A replay makes what was recorded.
            Err(WorldError::Limit(why)) if self.script.schedule.is_none() => {
                return self.start_afresh(&why.to_string()).await;
            }
            made => made?,
        };
        self.log_faults(&made.faults);
        let view = &mut self.publisher.view;
        (view.film_s, view.frame, view.touching) = (step.film_s, self.run.film.hull_frame(), made.touched);
        self.publisher.recent.note(&made);
        self.record(&step, &made);
        self.publish_world();
        self.report(watcher);
        self.picture(watcher, step.film_s, step.collisions.as_deref()).await;
        Ok(())
    }

    /// Once a body: a fault may come back in every step.
    fn log_faults(&mut self, faults: &[Fault]) {
        let faulty = &mut self.log.faulty;
        for fault in faults {
            let what = match fault.kind {
                FaultKind::Response => "its response was not finite and was ignored",
                FaultKind::Solver => "the solver made it not finite; it was put back",
            };
            if faulty.len() < MAX_FAULTY && faulty.insert(fault.body.clone()) {
                tracing::error!("body {}: {what}; its further faults are counted alone", fault.body);
            }
        }
    }

    /// Hands the step to the recorder.
    fn record(&mut self, step: &AnsweredStep, made: &MadeStep) {
        let world = &self.run.world;
        if let Some(recorder) = &mut self.log.recorder {
            recorder.step(&StepRecord {
                generation: self.publisher.generation,
                step: world.steps(),
                commands: &self.log.commands,
                film_s: step.film_s,
                slipped_s: step.film_s - world.time_s(),
                frame: self.publisher.view.frame,
                responses: &step.responses,
                collisions: step.collisions.as_deref(),
                step_ms: made.step_ms,
                world,
            });
        }
        self.log.commands.clear();
    }
}
