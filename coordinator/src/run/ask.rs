//! The hull's answers for a step: those that are known of the frame in use, and a pass about the rest.

use std::sync::Arc;
use std::time::{Duration, Instant};

use hull::Pose;
use hull::pass::BodyResult;
use hull::question::Points;

use super::clock::steps_that_share;
use super::{Coordinator, Film, LOCK_STEP_PATIENCE};
use crate::answers::{Asked, MAX_STEPS_AHEAD};
use crate::bounds::HullBounds;
use crate::facts::FilmState;
use crate::figures::stage_of;

/// Live: a pass that takes longer has lost its node.
const LIVE_PATIENCE: Duration = Duration::from_millis(500);
/// Live film that is older than this has stopped.
const STALE_S: f64 = 1.0;

impl Coordinator {
    /// What the hull says about every moving body; `None` if there is no hull.
    pub(super) async fn collide(&mut self, film_s: f64, film: Film) -> Option<Vec<BodyResult>> {
        if film != Film::Given
            && let Some(why) = self.why_blind(film_s, film == Film::Ended)
        {
            self.go_blind(why);
            return None;
        }
        let frame = self.frame?;
        self.bound(frame);
        let (bounds, world) = (&self.bounds, &self.world);
        let present = world.moving_bodies().map(|body| body.pose);
        self.answers.begin_step(frame, present, |shape, pose| bounds.may_meet(shape, pose));
        let passes_before = self.figures.passes;
        if self.answers.lacks_any() {
            let ahead = self.foresee(film_s);
            let bounds = &self.bounds;
            let asked = self.answers.questions(&ahead, |shape, pose| bounds.may_meet(shape, pose));
            if let Err(why) = self.ask(frame, &asked).await {
                self.go_blind(why);
                return None;
            }
        }
        let found = self.answers.take()?;
        if let Some(before) = self.blind.take() {
            tracing::warn!("the hull is back (it was gone: {before})");
        }
        self.figures.steps_without_question += u64::from(self.figures.passes == passes_before);
        self.figures.answers_used += found.asked as u64;
        self.figures.answers_reused += found.reused as u64;
        self.figures.add_results(&found.results);
        Some(found.results)
    }

    /// The poses of the steps that will share the frame in use, if they are worth a question.
    fn foresee(&mut self, film_s: f64) -> Vec<Vec<Pose>> {
        let dt_s = self.world.settings().dt_s;
        let steps = steps_that_share(film_s, dt_s, self.settings.fps, MAX_STEPS_AHEAD);
        if steps == 0 || !self.answers.may_foresee() {
            return vec![];
        }
        let began = Instant::now();
        let ahead = self.world.poses_ahead(steps);
        self.figures.add_stage("foresee", began.elapsed().as_secs_f64() * 1e3);
        ahead
    }

    /// One pass over all that is asked; `Err` says why there is no answer.
    async fn ask(&mut self, frame: u64, asked: &[Asked]) -> Result<(), String> {
        let began = Instant::now();
        let shapes: Vec<&Arc<hull::Shape>> = self.world.moving_bodies().map(|body| &body.shape).collect();
        let points = |asked: &Asked| {
            let points = Points::Body { shape: Arc::clone(shapes[asked.body]), pose: asked.pose };
            (points, self.answers.reaches(asked.body))
        };
        self.pass.restart(asked.iter().map(points), self.bounds.hull_box());
        self.figures.add_stage("cull", began.elapsed().as_secs_f64() * 1e3);
        self.figures.passes += u64::from(self.pass.question().is_some());
        self.figures.poses_asked += asked.len() as u64;
        let patience = if self.settings.lock_step { LOCK_STEP_PATIENCE } else { LIVE_PATIENCE };
        let figures = &mut self.figures;
        let mut took = |round, ms| figures.add_stage(stage_of(round), ms);
        self.transport.run_pass(&mut self.pass, frame, patience, &mut took).await?;
        self.answers.add(asked, self.pass.results());
        Ok(())
    }

    fn why_blind(&self, film_s: f64, ended: bool) -> Option<String> {
        if let Some(missing) = self.transport.missing().into_iter().next() {
            return Some(missing);
        }
        if let FilmState::Failed(why) = self.transport.film(0) {
            return Some(format!("film failed: {why}"));
        }
        let Some(frame) = self.frame else {
            // At the beginning nothing is lost yet.
            return (film_s > STALE_S).then(|| "no frame has come yet".into());
        };
        let age_s = film_s - frame as f64 / self.settings.fps;
        let stale = !self.settings.lock_step && !ended && age_s > STALE_S;
        stale.then(|| format!("film has stopped at frame {frame}, {age_s:.1} s ago"))
    }

    /// Says once that there is no hull; the world goes on.
    pub(super) fn go_blind(&mut self, why: String) {
        self.figures.blind_steps += 1;
        if self.blind.is_none() {
            tracing::error!("no hull, bodies meet nobody: {why}");
        }
        self.blind = Some(why);
    }

    /// Takes over the hull's bounds at a frame.
    fn bound(&mut self, frame: u64) {
        if self.bounded != Some(frame) {
            let facts = self.transport.facts(frame).unwrap_or_default();
            self.bounds = HullBounds::of(&facts, &self.observers, self.settings.probes.rule());
            self.bounded = Some(frame);
        }
    }
}
