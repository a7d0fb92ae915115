//! The frame in use, frames that steps wait for, and which cameras a step goes on with.

use std::task::Poll;

use film_time::FilmState;

use super::step::{FilmPhase, Step};
use super::{Action, CannotGoOn, Clocks, FRAMES_AHEAD, Run, State};
use crate::core::clock::frame_at;
use crate::core::roster::{FrameWait, HullUnavailable, LastFrame, LeaveOut, Roster, Shortage, StepFilm};
use crate::figures::Stage;

/// How often a waiting step looks at the clock, seconds.
const LOOK_EVERY_S: f64 = 0.1;
/// The first step does not wait for longer to know how late frames are, seconds of film.
const MEASURE_S: f64 = 1.0;
/// A live run begins without what films nothing for so long after another camera has begun, seconds of film.
const BEGIN_WITHOUT_S: f64 = 1.5;
/// After a camera has gone or come back, bodies are moved gently for so long, seconds.
const GENTLE_S: f64 = 1.0;

/// Which cameras have gone and come back. Times are those of the world, seconds.
#[derive(Debug, Default)]
struct CameraLog {
    /// The cameras that its lines add up to.
    cameras: Vec<u16>,
    /// How many changes were logged, less one a second since.
    spent: f64,
    at_s: f64,
}

impl CameraLog {
    /// So many at once, and then one a second.
    const MOST: f64 = 10.0;

    /// Whether one more may be.
    fn spend(&mut self, now_s: f64) -> bool {
        self.spent = (self.spent - (now_s - self.at_s).max(0.0)).max(0.0);
        self.at_s = now_s;
        let may = self.spent + 1.0 <= CameraLog::MOST;
        self.spent += f64::from(u8::from(may));
        may
    }
}

/// The frame that steps see.
#[derive(Default)]
pub(crate) struct FilmInUse {
    /// The newest that was taken into use.
    pub frame: Option<u64>,
    /// The one in use before it.
    pub before: Option<u64>,
    /// Why the last step had no hull, if it had none.
    pub unavailable: Option<HullUnavailable>,
    /// The cameras that the last step asked, by their places in the rig, ascending.
    pub cameras: Vec<u16>,
    /// A camera has gone or come back: until then the hull pushes gently, film time in seconds.
    pub gentle_until_s: f64,
    /// Frames that were not wanted: film went by while no steps were wanted.
    frames_passed: u64,
    /// The same when the frame was taken into use.
    passed_before: u64,
    log: CameraLog,
    wait: FrameWait,
    /// How far cameras were let film.
    credited: Option<u64>,
    /// The film time at which the first frame of any camera was found, seconds.
    began_s: Option<f64>,
}

impl FilmInUse {
    /// The frame that the last step saw, if it had a hull.
    pub fn hull_frame(&self) -> Option<u64> {
        self.frame.filter(|_| self.unavailable.is_none())
    }

    /// Of a run that begins again: what was logged of cameras is not logged with every pass.
    pub fn again(self) -> FilmInUse {
        FilmInUse { log: self.log, ..FilmInUse::default() }
    }

    /// What must be credited before a step waits for film up to this frame, if anything must.
    fn credit(&mut self, up_to_frame: u64) -> Option<Action> {
        let is_new = self.credited.replace(up_to_frame) != Some(up_to_frame);
        is_new.then_some(Action::Credit(up_to_frame))
    }
}

impl Run {
    /// Film that came since the last step was due is passed over: the step was not wanted.
    pub fn let_film_pass(&mut self, clocks: Clocks) {
        if self.settings.lock_step {
            return;
        }
        match self.scheduled_film_s() {
            Some(film_s) => self.clock.shift(film_s, clocks()),
            None => {
                let before = frame_at(self.film_s(), self.settings.fps);
                self.clock.pass(self.film_s(), clocks());
                self.film.frames_passed += frame_at(self.film_s(), self.settings.fps) - before;
            }
        }
    }

    /// Live: whether the world stands still because there has been no hull yet that bodies could lie on.
    pub(super) fn lacks_first_frame(&mut self, roster: &mut Roster, clocks: Clocks) -> bool {
        if self.settings.lock_step || self.film.frame.is_some() {
            return false;
        }
        let now = clocks();
        let film_s = self.clock.slipped_film_s(self.film_s(), now);
        let wanted = frame_at(film_s, self.settings.fps);
        self.begin_without_silent(wanted, film_s, roster, clocks);
        let (patience, least) = (self.settings.connect_timeout, self.least_cameras());
        let may_begin = roster.may_begin(wanted, film_s, patience, least)
            && (self.clock.latency.is_known() || film_s > MEASURE_S);
        if may_begin {
            // What nodes still keep of film is made good; else the first step itself sees the frame of now.
            let has_film = roster.newest_common(wanted).is_some();
            self.clock.begin(self.film_s(), has_film, now);
        }
        !may_begin
    }

    /// Leaves out nodes that film nothing a while after others have begun: a camera that never films must not hold up
    /// the run. They are back with their first frame.
    fn begin_without_silent(&mut self, wanted: u64, film_s: f64, roster: &mut Roster, clocks: Clocks) {
        if roster.newest().is_none() {
            return;
        }
        let began_s = *self.film.began_s.get_or_insert(film_s);
        if film_s > began_s + BEGIN_WITHOUT_S && roster.newest_common(wanted).is_none() {
            self.go_on_without(wanted, roster, clocks);
        }
    }

    /// The world stands still for a moment.
    pub(super) fn wait_for_first_frame(&mut self) -> Action {
        self.state = State::Beginning;
        Action::Wait { at_most_s: LOOK_EVERY_S }
    }

    /// It stood still: what is known of film now is noted.
    pub(super) fn stand_still(&mut self, roster: &Roster, clocks: Clocks) -> Action {
        let film_s = self.clock.now_s(self.film_s(), clocks());
        let frames = frame_at(film_s, self.settings.fps) + 1;
        self.figures.frames_expected = frames.saturating_sub(self.film.frames_passed);
        if let Some(why) = self.why_not_begun(film_s, roster) {
            self.note_no_hull(why);
        }
        if self.is_over(film_s) {
            self.state = State::Over;
        }
        Action::StandStill
    }

    /// Why the first step is not made yet.
    fn why_not_begun(&self, film_s: f64, roster: &Roster) -> Option<HullUnavailable> {
        let why = self.hull_frame(film_s, FilmPhase::Runs, roster).err()?;
        let filming = roster.filming();
        if why != HullUnavailable::NoFrame || filming.is_empty() {
            return Some(why);
        }
        let observers = self.observers();
        let others = observers.iter().filter(|observer| !filming.contains(&observer.rig_index()));
        let missing: Vec<String> = others.map(|observer| format!("{:?}", observer.camera().name())).collect();
        let shortage = self.shortage(filming.len()).filter(|_| !missing.is_empty());
        Some(shortage.map_or(why, |shortage| HullUnavailable::NotBegun { shortage, missing }))
    }

    /// By how much so many cameras are too few for a hull, if they are.
    fn shortage(&self, found: usize) -> Option<Shortage> {
        let (all, needed) = (self.observers().len(), self.least_cameras());
        (found < needed).then_some(Shortage { found, all, needed })
    }

    /// A step that sees what film has for it.
    pub(super) fn film_step(&mut self, roster: &mut Roster, clocks: Clocks) -> Result<Action, CannotGoOn> {
        let film_s = self.film_s();
        if self.steering.is_frozen() && self.film.frame.is_some() {
            // Out of a pause: it sees the frame at which the run was paused, while film goes by.
            let (before_s, fps) = (film_s - self.world.settings().dt_s, self.settings.fps);
            self.film.frames_passed += frame_at(film_s, fps) - frame_at(before_s, fps);
            return self.meet_hull(Step::of(film_s, FilmPhase::Frozen), roster, clocks);
        }
        let wanted = frame_at(film_s, self.settings.fps);
        self.figures.frames_expected = (wanted + 1).saturating_sub(self.film.frames_passed);
        if self.settings.lock_step {
            return self.wait_for_frame(film_s, wanted, clocks().monotonic_s, roster, clocks);
        }
        self.clock.slip(film_s, clocks());
        self.choose_frame(film_s, wanted, roster, clocks)
    }

    /// Lock-step: waits until every node has a frame that new, or film has ended.
    pub(super) fn wait_for_frame(
        &mut self,
        film_s: f64,
        wanted: u64,
        since_s: f64,
        roster: &mut Roster,
        clocks: Clocks,
    ) -> Result<Action, CannotGoOn> {
        let credit = self.film.credit(roster.credit(wanted, FRAMES_AHEAD));
        let must_wait = match credit {
            Some(_) => credit,
            None => match self.film.wait.poll(roster, wanted, since_s, clocks().monotonic_s) {
                Poll::Ready(waited) => {
                    waited?;
                    None
                }
                Poll::Pending => Some(Action::Wait { at_most_s: LOOK_EVERY_S }),
            },
        };
        match must_wait {
            Some(action) => {
                self.state = State::AwaitsFrame { film_s, wanted, since_s };
                Ok(action)
            }
            None => self.choose_frame(film_s, wanted, roster, clocks),
        }
    }

    /// Takes the newest frame into use that all have; ends if film has ended and was held for long enough.
    fn choose_frame(
        &mut self,
        film_s: f64,
        wanted: u64,
        roster: &mut Roster,
        clocks: Clocks,
    ) -> Result<Action, CannotGoOn> {
        self.go_on_without(wanted, roster, clocks);
        let cameras = self.observers().len();
        let lacks_any = !self.film.cameras.is_empty() && self.film.cameras.len() < cameras;
        self.figures.counts.misses.reduced_steps += u64::from(lacks_any || roster.leaves_out_any());
        let newest = roster.newest_common(wanted);
        let last = roster.last_frame().filter(|_| roster.film(wanted) == FilmState::Ended);
        if let Some(last) = last {
            let frames = if let LastFrame::Frame(last) = last { last + 1 } else { 0 };
            self.figures.frames_expected = frames.saturating_sub(self.film.frames_passed);
            if film_s > frames as f64 / self.settings.fps + self.settings.hold_s {
                return Ok(Action::End);
            }
        } else {
            self.figures.counts.misses.late_steps += u64::from(newest != Some(wanted));
        }
        let phase = if last.is_some() { FilmPhase::Held } else { FilmPhase::Runs };
        self.with_frame(newest.or(self.film.frame), Step::of(film_s, phase), roster, clocks)
    }

    /// Waits for the very frame that a schedule names, if the hull is to be asked about it.
    pub(super) fn wait_for_recorded(
        &mut self,
        step: Step,
        frame: u64,
        since_s: f64,
        roster: &mut Roster,
        clocks: Clocks,
    ) -> Result<Action, CannotGoOn> {
        let mut must_wait = self.film.credit(frame);
        if must_wait.is_none() && step.given.is_none() {
            match roster.poll_recorded(frame, since_s, clocks().monotonic_s) {
                Poll::Ready(waited) => waited?,
                Poll::Pending => must_wait = Some(Action::Wait { at_most_s: LOOK_EVERY_S }),
            }
        }
        match must_wait {
            Some(action) => {
                self.state = State::AwaitsRecorded { step, frame, since_s };
                Ok(action)
            }
            None => self.with_frame(Some(frame), step, roster, clocks),
        }
    }

    /// Takes a step's frame into use, if it is not.
    fn with_frame(
        &mut self,
        frame: Option<u64>,
        step: Step,
        roster: &mut Roster,
        clocks: Clocks,
    ) -> Result<Action, CannotGoOn> {
        match frame {
            Some(frame) if self.film.frame != Some(frame) => {
                self.note_frame(frame, roster);
                self.state = State::Framed(step);
                Ok(Action::UseFrame(frame))
            }
            _ => self.meet_hull(step, roster, clocks),
        }
    }

    fn note_frame(&mut self, frame: u64, roster: &Roster) {
        let passed = self.film.frames_passed;
        self.film.before = self.film.frame.replace(frame);
        if let Some(before) = self.film.before {
            let unwanted = passed.saturating_sub(self.film.passed_before);
            self.figures.counts.frames_passed_over +=
                frame.saturating_sub(before + 1).saturating_sub(unwanted);
        }
        self.film.passed_before = passed;
        self.figures.counts.frames += 1;
        let reports = roster.reports(frame).unwrap_or_default();
        let cameras = reports.iter().flat_map(|report| &report.cameras);
        if let Some(slowest_ms) = cameras.map(|camera| camera.segment_ms).reduce(f64::max) {
            self.figures.add_stage(Stage::Segment, slowest_ms);
        }
    }

    /// Leaves out who is not there for a step that wants a frame, and takes back who is again; whether that changed.
    pub(super) fn go_on_without(&mut self, wanted: u64, roster: &mut Roster, clocks: Clocks) -> bool {
        let whom = if self.settings.lock_step { LeaveOut::Missing } else { LeaveOut::Late };
        let now_s = clocks().monotonic_s;
        let changed = roster.leave_out(wanted, whom, self.settings.going_on.min_cameras, now_s);
        for &(node, is_back) in &changed {
            match is_back {
                true => tracing::info!("{} is back", roster.node_name(node)),
                false => tracing::error!("going on without {}", roster.why_left_out(node, now_s)),
            }
        }
        if !changed.is_empty() {
            self.hull.leave_out(roster);
        }
        !changed.is_empty()
    }

    /// A step asks the cameras of a frame that are there, if these are enough.
    pub(super) fn go_on_with_cameras(&mut self, frame: u64, roster: &Roster) -> Result<(), HullUnavailable> {
        let reports = roster.reports(frame).unwrap_or_default();
        let cameras = reports.iter().flat_map(|report| &report.cameras);
        let mut places: Vec<u16> = cameras.map(|camera| camera.rig_index).collect();
        places.sort_unstable();
        // A frame without reports tells nothing.
        if !places.is_empty() && places != self.film.cameras {
            if let Some(shortage) = self.shortage(places.len()) {
                return Err(shortage.into());
            }
            let before = std::mem::replace(&mut self.film.cameras, places);
            if !before.is_empty() {
                self.film.gentle_until_s = self.film_s() + GENTLE_S;
            }
        }
        self.log_cameras();
        Ok(())
    }

    /// Logs which cameras have gone and come back since the last such lines. Those that come and go with every frame must not
    /// fill the log.
    fn log_cameras(&mut self) {
        let film = &mut self.film;
        if film.log.cameras == film.cameras || !film.log.spend(self.world.next_time_s()) {
            return;
        }
        let before = std::mem::replace(&mut film.log.cameras, film.cameras.clone());
        let (now, count) = (&film.cameras, film.cameras.len());
        for observer in self.hull.query.observers() {
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

    /// The frame whose hull a step sees, or why there is none.
    pub(super) fn hull_frame(
        &self,
        film_s: f64,
        phase: FilmPhase,
        roster: &Roster,
    ) -> Result<u64, HullUnavailable> {
        let frame = self.film.frame;
        if phase.has_fixed_frame() {
            return frame.ok_or(HullUnavailable::NotYet);
        }
        let is_paced = !self.settings.lock_step && phase == FilmPhase::Runs;
        roster.hull_frame(StepFilm { film_s, fps: self.settings.fps, frame, is_paced })
    }

    /// Counts a step without a hull; the world goes on.
    pub(super) fn lose_hull(&mut self, why: HullUnavailable) {
        self.figures.counts.misses.blind_by_cause[why.cause()] += 1;
        self.note_no_hull(why);
    }

    /// Reports once that there is no hull.
    fn note_no_hull(&mut self, why: HullUnavailable) {
        let was_fault = self.film.unavailable.as_ref().is_some_and(HullUnavailable::is_fault);
        if why.is_fault() && !was_fault {
            tracing::error!("hull unavailable, collisions off: {why}");
        }
        self.film.unavailable = Some(why);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_now_and_then_are_logged_and_a_flood_of_them_once_a_second() {
        let mut log = CameraLog::default();
        assert!((0..100).all(|change| log.spend(f64::from(change))));
        let logged = (0..6000).filter(|&change| log.spend(100.0 + f64::from(change) / 60.0)).count();
        assert!((100..=112).contains(&logged), "{logged} lines in 100 s");
    }
}
