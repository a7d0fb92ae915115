//! One step: which frame it sees, the world's step with the hull's answers, and what is reported of it.

use film_time::FilmState;
use hull::collision::BodyCollision;
use sim::{Body, BodyResponse, FaultKind, WorldError};
use tokio::time::Instant;

use super::frames::FilmPhase;
use super::now;
use super::{Coordinator, MAX_FAULTY, RunError, Watcher};
use crate::core::clock::frame_at;
use crate::figures::Stage;
use crate::hooks::{Sees, StepRecord};
use crate::roster::{HullUnavailable, LastFrame};

impl Coordinator {
    /// A step that sees what film has for it; false if film has ended and was held long enough.
    pub(super) async fn film_step(&mut self, watcher: &mut dyn Watcher) -> Result<bool, RunError> {
        if self.commands.steering.is_frozen() && self.film.frame.is_some() {
            return self.frozen_step(watcher).await;
        }
        let film_s = self.film_s();
        let wanted = frame_at(film_s, self.settings.fps);
        self.figures.frames_expected = (wanted + 1).saturating_sub(self.film.frames_passed);
        if self.settings.lock_step {
            self.await_frame(wanted).await?;
        } else {
            self.clock.slip(film_s, now());
        }
        self.transport.drain();
        self.go_on_without(wanted);
        let lacks_any =
            !self.film.cameras.is_empty() && self.film.cameras.len() < self.query.observers().len();
        self.figures.counts.reduced_steps += u64::from(lacks_any || self.transport.roster().leaves_out_any());
        let roster = self.transport.roster();
        let newest = roster.newest_common(wanted);
        let last = roster.last_frame().filter(|_| roster.film(wanted) == FilmState::Ended);
        if let Some(last) = last {
            let frames = if let LastFrame::Frame(last) = last { last + 1 } else { 0 };
            self.figures.frames_expected = frames.saturating_sub(self.film.frames_passed);
            if film_s > frames as f64 / self.settings.fps + self.settings.hold_s {
                return Ok(false);
            }
        } else {
            self.figures.counts.late_steps += u64::from(newest != Some(wanted));
        }
        if newest != self.film.frame
            && let Some(newest) = newest
        {
            self.use_frame(newest).await?;
        }
        let began = Instant::now();
        let phase = if last.is_some() { FilmPhase::Held } else { FilmPhase::Runs };
        let collisions = self.collide(film_s, phase).await;
        self.make(film_s, began, collisions, None, watcher).await
    }

    /// A step out of a pause: it sees the frame at which the run was paused, while film goes by.
    async fn frozen_step(&mut self, watcher: &mut dyn Watcher) -> Result<bool, RunError> {
        let (film_s, fps) = (self.film_s(), self.settings.fps);
        let before_s = film_s - self.world.settings().dt_s;
        self.film.frames_passed += frame_at(film_s, fps) - frame_at(before_s, fps);
        self.transport.drain();
        let began = Instant::now();
        let collisions = self.collide(film_s, FilmPhase::Given).await;
        self.make(film_s, began, collisions, None, watcher).await
    }

    /// A step that sees what another run's step saw.
    pub(super) async fn scheduled_step(
        &mut self,
        sees: Sees,
        watcher: &mut dyn Watcher,
    ) -> Result<bool, RunError> {
        let (film_s, frame, given) = match sees {
            Sees::Film => return self.film_step(watcher).await,
            Sees::Recorded { film_s, frame } => (film_s, frame, None),
            Sees::Given { film_s, frame, responses } => (film_s, frame, Some(responses)),
        };
        self.figures.frames_expected = frame_at(film_s, self.settings.fps) + 1;
        if let Some(frame) = frame {
            self.seek(frame, given.is_none()).await?;
        }
        let began = Instant::now();
        let mut collisions = None;
        match (frame, &given) {
            (_, Some(_)) => self.film.unavailable = None,
            (None, None) => self.lose_hull(match self.film.frame {
                Some(_) => HullUnavailable::Recorded,
                // At the beginning nothing is lost yet.
                None => HullUnavailable::NotYet,
            }),
            (Some(frame), None) => {
                collisions = self.collide(film_s, FilmPhase::Given).await;
                if let (None, Some(why)) = (&collisions, self.film.unavailable.take()) {
                    return Err(RunError::Recorded { frame, why });
                }
            }
        }
        self.make(film_s, began, collisions, given, watcher).await
    }

    /// The step itself, with the hull's answers, and what is reported of it.
    async fn make(
        &mut self,
        film_s: f64,
        began: Instant,
        collisions: Option<Vec<BodyCollision>>,
        given: Option<Vec<BodyResponse>>,
        watcher: &mut dyn Watcher,
    ) -> Result<bool, RunError> {
        let mut responses = given.unwrap_or_else(|| self.responses(film_s, collisions.as_deref()));
        if let Some(alter) = self.script.alter {
            responses.iter_mut().for_each(alter);
        }
        self.note_touches(&responses, collisions.as_deref());
        let touching = match self.apply(&responses) {
            // A replay makes what was recorded.
            Err(WorldError::Limit(why)) if self.script.schedule.is_none() => {
                self.start_afresh(&why.to_string()).await?;
                return Ok(true);
            }
            touching => touching?,
        };
        let view = &mut self.publisher.view;
        (view.film_s, view.frame, view.touching) = (film_s, self.film.hull_frame(), touching);
        self.commands.steering.count();
        let step_ms = began.elapsed().as_secs_f64() * 1e3;
        self.figures.step_ms.add(step_ms);
        self.figures.counts.steps += 1;
        self.note_age(collisions.as_deref());
        self.record(&responses, collisions.as_deref(), step_ms);
        self.publish_world();
        self.report(watcher, Some(step_ms));
        self.picture(watcher, film_s, collisions.as_deref()).await;
        Ok(true)
    }

    /// What the hull's answers do to the moving bodies.
    fn responses(&self, film_s: f64, collisions: Option<&[BodyCollision]>) -> Vec<BodyResponse> {
        let Some(collisions) = collisions else {
            return vec![BodyResponse::UNTOUCHED; self.world.moving_bodies().len()];
        };
        let mut responses: Vec<BodyResponse> =
            self.world.moving_bodies().zip(collisions).map(response).collect();
        if film_s < self.film.gentle_until_s {
            let (push_m_s, dt_s) = (self.settings.going_on.push_m_s, self.world.settings().dt_s);
            responses.iter_mut().for_each(|response| response.limit(push_m_s, dt_s));
        }
        responses
    }

    /// Steps the world with the hull's answers; returns how many bodies touch it.
    fn apply(&mut self, responses: &[BodyResponse]) -> Result<usize, WorldError> {
        let began = Instant::now();
        let report = self.world.step(responses)?;
        let took_s = began.elapsed().as_secs_f64();
        self.budget.note(took_s);
        self.figures.add_stage(Stage::Physics, took_s * 1e3);
        self.figures.counts.faults += report.faults.len() as u64;
        for fault in &report.faults {
            let what = match fault.kind {
                FaultKind::Response => "its response was not finite and was ignored",
                FaultKind::Solver => "the solver made it not finite; it was put back",
            };
            // Once a body: a fault may come back in every step.
            let faulty = &mut self.log.faulty;
            if faulty.len() < MAX_FAULTY && faulty.insert(fault.body.clone()) {
                tracing::error!("body {}: {what}; its further faults are counted alone", fault.body);
            }
        }
        Ok(report.touched)
    }

    /// Hands the step to the recorder.
    fn record(&mut self, responses: &[BodyResponse], collisions: Option<&[BodyCollision]>, step_ms: f64) {
        let view = &self.publisher.view;
        if let Some(recorder) = &mut self.log.recorder {
            recorder.step(&StepRecord {
                generation: self.publisher.generation,
                step: self.world.steps(),
                commands: &self.log.commands,
                film_s: view.film_s,
                slipped_s: view.film_s - self.world.time_s(),
                frame: view.frame,
                responses,
                collisions,
                step_ms,
                world: &self.world,
            });
        }
        self.log.commands.clear();
    }
}

fn response((body, collision): (&Body, &BodyCollision)) -> BodyResponse {
    let mut response = BodyResponse::default();
    response.set(collision, &body.shape);
    response
}
