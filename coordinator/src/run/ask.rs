//! The hull's answers for a step: those that are known of the frame in use, and a pass about the rest.

use std::sync::Arc;
use std::time::{Duration, Instant};

use hull::cull::{Frustum, WorldBox, hull_box};
use hull::pass::BodyResult;
use hull::question::Points;
use hull::{Observer, Pose, ProbeSettings};

use super::clock::steps_that_share;
use super::{Coordinator, LOCK_STEP_PATIENCE};
use crate::answers::{Asked, MAX_STEPS_AHEAD};
use crate::facts::{FilmState, FrameFacts};
use crate::figures::stage_of;

/// Live: a pass that takes longer has lost its node.
const LIVE_PATIENCE: Duration = Duration::from_millis(500);
/// Live film that is older than this has stopped.
const STALE_S: f64 = 1.0;

impl Coordinator {
    /// What the hull says about every moving body; `None` if there is no hull.
    pub(super) async fn collide(&mut self, film_s: f64, ended: bool) -> Option<Vec<BodyResult>> {
        if let Some(why) = self.why_blind(film_s, ended) {
            self.go_blind(why);
            return None;
        }
        let frame = self.frame?;
        let poses: Vec<Pose> = self.world.moving_bodies().map(|body| body.pose).collect();
        self.answers.begin_step(frame);
        let passes_before = self.figures.passes;
        let missing: Vec<usize> = self.answers.missing(&poses).collect();
        if !missing.is_empty() {
            let hull_box = self.hull_box(frame);
            let ahead = self.foresee(film_s, &missing, hull_box.as_ref());
            let asked = self.answers.questions(&poses, &ahead);
            if let Err(why) = self.ask(frame, hull_box.as_ref(), &asked).await {
                self.go_blind(why);
                return None;
            }
        }
        let found = self.answers.take(&poses)?;
        if let Some(before) = self.blind.take() {
            tracing::warn!("the hull is back (it was gone: {before})");
        }
        self.figures.steps_without_question += u64::from(self.figures.passes == passes_before);
        self.figures.answers_reused += found.reused as u64;
        self.figures.add_results(&found.results);
        Some(found.results)
    }

    /// The poses of the steps that will share the frame in use, if they are worth a question: nobody is
    /// touched, and some body that must be asked about is near the hull.
    fn foresee(&mut self, film_s: f64, missing: &[usize], hull_box: Option<&WorldBox>) -> Vec<Vec<Pose>> {
        let Some(hull_box) = hull_box.filter(|_| self.answers.may_foresee()) else { return vec![] };
        let bodies: Vec<&sim::Body> = self.world.moving_bodies().collect();
        let is_near =
            |&index: &usize| hull_box.meets(&WorldBox::of_body(&bodies[index].shape, &bodies[index].pose));
        let dt_s = self.world.settings().dt_s;
        let steps = steps_that_share(film_s, dt_s, self.settings.fps, MAX_STEPS_AHEAD);
        if steps == 0 || !missing.iter().any(is_near) {
            return vec![];
        }
        let began = Instant::now();
        let ahead = self.world.poses_ahead(steps);
        self.figures.add_stage("foresee", began.elapsed().as_secs_f64() * 1e3);
        ahead
    }

    /// One pass over all that is asked; `Err` says why there is no answer.
    async fn ask(&mut self, frame: u64, hull_box: Option<&WorldBox>, asked: &[Asked]) -> Result<(), String> {
        let began = Instant::now();
        let shapes: Vec<&Arc<hull::Shape>> = self.world.moving_bodies().map(|body| &body.shape).collect();
        let points = |asked: &Asked| {
            let points = Points::Body { shape: Arc::clone(shapes[asked.body]), pose: asked.pose };
            (points, asked.reach)
        };
        self.pass.restart(asked.iter().map(points), hull_box);
        self.figures.add_stage("cull", began.elapsed().as_secs_f64() * 1e3);
        self.figures.passes += u64::from(self.pass.question().is_some());
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
    fn go_blind(&mut self, why: String) {
        self.figures.blind_steps += 1;
        if self.blind.is_none() {
            tracing::error!("no hull, bodies meet nobody: {why}");
        }
        self.blind = Some(why);
    }

    /// The box around the hull of a frame, from every camera's frustum.
    fn hull_box(&mut self, frame: u64) -> Option<WorldBox> {
        if let Some((known, hull_box)) = self.hull_box
            && known == frame
        {
            return hull_box;
        }
        let facts = self.transport.facts(frame).unwrap_or_default();
        let found = box_around(&facts, &self.observers, &self.settings.probes);
        self.hull_box = Some((frame, found));
        found
    }
}

fn box_around(facts: &[FrameFacts], observers: &[Arc<Observer>], probes: &ProbeSettings) -> Option<WorldBox> {
    let frustum = |observer: &Arc<Observer>| {
        let mut cameras = facts.iter().flat_map(|facts| &facts.cameras);
        let facts = cameras.find(|camera| camera.rig_index == observer.rig_index())?;
        facts.admitted.map(|rect| Frustum::of(observer.camera(), rect))
    };
    hull_box(&observers.iter().map(frustum).collect::<Vec<_>>(), probes.rule())
}
