//! The hull's answers for a step: carries the query's pass to the nodes and back.

use film_time::monotonic_s;
use hull::Pose;
use hull::collision::BodyCollision;
use hull::pass::{BodyResult, Round};
use hull::surface::FrameAge;
use sim::{Body, ResponseMode};
use tokio::time::Instant;

use super::Coordinator;
use super::frames::FilmPhase;
use crate::core::clock::steps_that_share;
use crate::figures::Stage;
use crate::query::MAX_STEPS_AHEAD;
use crate::roster::{HullUnavailable, LOCK_STEP_TIMEOUT, LeaveOut, StepFilm};
use crate::transport::TransportError;

/// After a camera has gone or come back, bodies are moved gently for so long, seconds.
const GENTLE_S: f64 = 1.0;
/// A step asks at most so many times more, without the nodes that did not answer: they may be heard of and fail again meanwhile.
const MAX_REPEATS: usize = 3;

impl Coordinator {
    /// Leaves out who is not there for a step that wants a frame, and takes back who is again; whether that changed.
    pub(super) fn go_on_without(&mut self, wanted: u64) -> bool {
        let whom = if self.settings.lock_step { LeaveOut::Missing } else { LeaveOut::Late };
        let changed = self.transport.leave_out(wanted, whom, self.settings.going_on.min_cameras);
        for &(node, is_back) in &changed {
            let roster = self.transport.roster();
            match is_back {
                true => tracing::info!("{} is back", roster.node_name(node)),
                false => tracing::error!("going on without {}", roster.why_left_out(node, monotonic_s())),
            }
        }
        if !changed.is_empty() {
            self.query.leave_out(|group| self.transport.is_left_out(group));
        }
        !changed.is_empty()
    }

    /// A step asks the cameras of a frame that are there, if these are enough.
    fn go_on_with_cameras(&mut self, frame: u64) -> Result<(), HullUnavailable> {
        let reports = self.transport.roster().reports(frame).unwrap_or_default();
        let cameras = reports.iter().flat_map(|report| &report.cameras);
        let mut places: Vec<u16> = cameras.map(|camera| camera.rig_index).collect();
        places.sort_unstable();
        let expected = self.least_cameras();
        // A frame without reports tells nothing.
        if places.is_empty() || places == self.film.cameras {
            return Ok(());
        }
        if places.len() < expected {
            return Err(HullUnavailable::TooFew { found: places.len(), expected });
        }
        let before = std::mem::replace(&mut self.film.cameras, places);
        if !before.is_empty() {
            self.film.gentle_until_s = self.film_s() + GENTLE_S;
        }
        Ok(())
    }

    /// Logs which cameras have gone and come back since the last such lines. Those that come and go with every frame must not
    /// fill the log.
    fn log_cameras(&mut self) {
        let film = &mut self.film;
        if film.logged_cameras == film.cameras || !film.log_budget.spend(self.world.next_time_s()) {
            return;
        }
        let before = std::mem::replace(&mut film.logged_cameras, film.cameras.clone());
        let (now, count) = (&film.cameras, film.cameras.len());
        for observer in self.query.observers() {
            let (name, place) = (observer.camera().name(), observer.rig_index());
            match (before.contains(&place) || before.is_empty(), now.contains(&place)) {
                (true, false) => {
                    tracing::error!("going on with {count} cameras: camera {name:?} films nothing");
                }
                (false, true) => tracing::warn!("camera {name:?} is back, {count} cameras"),
                _ => {}
            }
        }
    }

    /// What the hull answers about every moving body; `None` if there is no hull.
    pub(super) async fn collide(&mut self, film_s: f64, phase: FilmPhase) -> Option<Vec<BodyCollision>> {
        let frame = match self.hull_frame(film_s, phase) {
            Ok(frame) => frame,
            Err(why) => {
                self.lose_hull(why);
                return None;
            }
        };
        if let Err(why) = self.go_on_with_cameras(frame) {
            self.lose_hull(why);
            return None;
        }
        self.log_cameras();
        let reports = match self.transport.roster().reports(frame) {
            Some(reports) => reports,
            None if self.query.knows_bounds_of(frame) => vec![],
            None => {
                self.lose_hull(HullUnavailable::Forgotten { frame });
                return None;
            }
        };
        let at = self.surfaces.frame_age(frame, film_s);
        let by_contacts = self.world.settings().response == ResponseMode::Contacts;
        let surfaces = &mut self.surfaces;
        let poses =
            self.world.moving_bodies().enumerate().map(|(index, body)| {
                if by_contacts { surfaces.pose_to_ask(index, at, body) } else { body.pose }
            });
        self.query.begin_step(frame, &reports, poses);
        let (passes_before, mut repeats) = (self.figures.counts.passes, 0);
        while self.query.must_ask() {
            let Err(error) = self.ask(frame, film_s).await else { break };
            // Nodes that failed to answer are left out, and the pass is repeated without them.
            self.transport.drain();
            repeats += 1;
            let may_repeat = phase != FilmPhase::Given && repeats <= MAX_REPEATS;
            if !may_repeat || !self.go_on_without(frame) {
                self.lose_hull(HullUnavailable::Unanswered(error.to_string()));
                return None;
            }
        }
        let answers = self.query.take()?;
        if let Some(before) = self.film.unavailable.take().filter(HullUnavailable::is_fault) {
            tracing::warn!("hull available again (it was not: {before})");
        }
        self.figures.steps_without_question += u64::from(self.figures.counts.passes == passes_before);
        self.figures.answers_used += answers.asked as u64;
        self.figures.answers_reused += answers.reused as u64;
        let collisions = self.collisions(at, answers.results);
        self.figures.add_collisions(&collisions);
        Some(collisions)
    }

    /// What was found for the bodies, for contacts from the planes.
    fn collisions(&mut self, at: FrameAge, found: Vec<BodyResult>) -> Vec<BodyCollision> {
        let began = Instant::now();
        let bodies = self.world.moving_bodies().zip(found).enumerate();
        let surfaces = &mut self.surfaces;
        let collision = |(index, (body, found)): (usize, (&Body, BodyResult))| match found {
            BodyResult::Paper(paper) => BodyCollision::Paper(paper),
            BodyResult::Planes(planes) => {
                BodyCollision::Contacts(surfaces.contacts(index, at, &planes, body))
            }
        };
        let collisions = bodies.map(collision).collect();
        if self.world.settings().response == ResponseMode::Contacts {
            self.figures.add_stage(Stage::Contacts, began.elapsed().as_secs_f64() * 1e3);
        }
        collisions
    }

    pub(super) fn hull_frame(&self, film_s: f64, phase: FilmPhase) -> Result<u64, HullUnavailable> {
        let frame = self.film.frame;
        if phase == FilmPhase::Given {
            return frame.ok_or(HullUnavailable::NotYet);
        }
        let is_paced = !self.settings.lock_step && phase == FilmPhase::Runs;
        let step = StepFilm { film_s, fps: self.settings.fps, frame, is_paced };
        self.transport.roster().hull_frame(step)
    }

    /// One pass over all that this step lacks, and what is worth foreseeing.
    async fn ask(&mut self, frame: u64, film_s: f64) -> Result<(), TransportError> {
        let ahead = self.foresee(film_s);
        let began = Instant::now();
        let asks_nodes = self.query.ask(&ahead).question().is_some();
        self.figures.add_stage(Stage::Cull, began.elapsed().as_secs_f64() * 1e3);
        self.figures.counts.passes += u64::from(asks_nodes);
        self.figures.poses_asked += self.query.poses_asked() as u64;
        let timeout = self.settings.lock_step.then_some(LOCK_STEP_TIMEOUT);
        self.figures.counts.gathered_passes += u64::from(asks_nodes && self.transport.gathers());
        let figures = &mut self.figures;
        let mut took = |round: Round, ms: f64| {
            figures.counts.round_trips += 1;
            figures.add_stage(round.into(), ms);
        };
        let asked = self.transport.run_pass(self.query.pass(), frame, timeout, &mut took).await;
        self.figures.counts.points = *self.query.pass().points_asked();
        asked?;
        if asks_nodes {
            self.figures.pass.add(began.elapsed().as_secs_f64());
        }
        self.query.answered();
        Ok(())
    }

    /// The poses of the steps that will share the frame in use, if they are worth a question.
    fn foresee(&mut self, film_s: f64) -> Vec<Vec<Pose>> {
        let dt_s = self.world.settings().dt_s;
        let steps = steps_that_share(film_s, dt_s, self.settings.fps, MAX_STEPS_AHEAD);
        if steps == 0 || !self.query.may_foresee() {
            return vec![];
        }
        let began = Instant::now();
        let ahead = self.world.poses_ahead(steps);
        self.figures.add_stage(Stage::Foresee, began.elapsed().as_secs_f64() * 1e3);
        ahead
    }

    /// Counts a step without a hull; the world goes on.
    pub(super) fn lose_hull(&mut self, why: HullUnavailable) {
        self.figures.counts.blind_by_cause[why.cause()] += 1;
        self.note_no_hull(why);
    }

    /// Reports once that there is no hull.
    pub(super) fn note_no_hull(&mut self, why: HullUnavailable) {
        let was_fault = self.film.unavailable.as_ref().is_some_and(HullUnavailable::is_fault);
        if why.is_fault() && !was_fault {
            tracing::error!("hull unavailable, collisions off: {why}");
        }
        self.film.unavailable = Some(why);
    }
}
