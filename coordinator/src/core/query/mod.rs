//! What to ask the hull for a step, and what the answers make of it: the bounds of the frame's hull, the answers
//! of this frame that still hold, and the pass about the rest.
//!
//! Plain decisions: the caller waits, and carries the pass to the nodes between [`HullQuery::ask`] and
//! [`HullQuery::answered`].

mod answers;
mod bounds;
mod surfaces;

use std::sync::Arc;

use film_time::FrameReport;
use hull::faces::FaceNormals;
use hull::pass::{AskedBody, BodyResult, Pass, Reaches};
use hull::question::Points;
use hull::surface::{Occupancy, PoseToAsk};
use hull::{Observer, Pose, ProbeSettings, Shape};

use answers::{Answers, PoseQuery};
use bounds::HullBounds;

pub(crate) use answers::MAX_STEPS_AHEAD;
pub use answers::{AskEvery, StepAnswers};
pub use surfaces::Surfaces;

/// What the hull is asked about one body.
#[derive(Clone, Debug)]
pub struct QueryBody {
    /// Its samples, and what else is asked of the body itself.
    pub shape: Arc<Shape>,
    /// Points around it.
    pub around: Option<Arc<Shape>>,
    /// Which way its faces look.
    pub faces: Option<Arc<FaceNormals>>,
}

/// The hull's answers about the moving bodies of a world, step by step.
pub struct HullQuery {
    observers: Vec<Arc<Observer>>,
    settings: ProbeSettings,
    ask_every: AskEvery,
    answers: Answers,
    bodies: Vec<QueryBody>,
    bounds: HullBounds,
    /// The frame whose bounds they are.
    bounds_frame: Option<u64>,
    pass: Pass,
    asked: Vec<PoseQuery>,
}

impl HullQuery {
    /// No bodies yet. `observers` are the whole rig's, in rig order; passes ask `group_count` groups of cameras.
    pub fn new(
        observers: Vec<Arc<Observer>>,
        settings: ProbeSettings,
        group_count: usize,
        ask_every: AskEvery,
    ) -> HullQuery {
        HullQuery {
            observers,
            settings,
            ask_every,
            answers: Answers::new(std::iter::empty(), ask_every, 0.0),
            bodies: Vec::new(),
            bounds: HullBounds::default(),
            bounds_frame: None,
            pass: Pass::new(vec![], None, settings, group_count),
            asked: Vec::new(),
        }
    }

    /// The whole rig's observers, in rig order.
    pub fn observers(&self) -> &[Arc<Observer>] {
        &self.observers
    }

    /// Asks for planes of the hull's surface from the next pass on, and for no exits.
    pub fn ask_planes(&mut self) {
        self.pass.for_contacts();
    }

    /// Other bodies: no answer holds any more. Within one frame a body counts as clear where each of its samples
    /// is known to be outside no farther away than `reuse_within_m`: no sample deeper than this is ever missed.
    /// At 0 answers are used again for the very same pose alone.
    pub fn set_bodies(&mut self, bodies: Vec<QueryBody>, reuse_within_m: f64) {
        let shapes = bodies.iter().map(|body| Arc::clone(&body.shape));
        self.answers = Answers::new(shapes, self.ask_every, reuse_within_m);
        self.bodies = bodies;
    }

    /// Begins a step that sees `frame`, of which the nodes reported, with the moving bodies at these poses.
    pub fn begin_step(
        &mut self,
        frame: u64,
        reports: &[&FrameReport],
        poses: impl Iterator<Item = PoseToAsk>,
    ) {
        if self.bounds_frame != Some(frame) {
            self.bounds = HullBounds::of(reports, &self.observers, self.settings.rule());
            self.bounds_frame = Some(frame);
        }
        let bounds = &self.bounds;
        self.answers.begin_step(frame, poses, |shape, pose| bounds.may_meet(shape, pose));
    }

    /// Whether a step may see this frame without reports: an earlier one did.
    pub fn knows_bounds_of(&self, frame: u64) -> bool {
        self.bounds_frame == Some(frame)
    }

    /// From the next pass on asks so many groups of cameras.
    pub fn ask_groups(&mut self, group_count: usize) {
        self.pass.ask_groups(group_count);
    }

    /// From the next pass on asks for what is likely to matter beside the pass's own questions, to spare trips.
    pub fn speculate(&mut self, speculates: bool) {
        self.pass.speculate(speculates);
    }

    /// From the next pass on asks nothing of these groups of cameras; what is known of the frame's bounds no longer holds.
    pub fn leave_out(&mut self, is_left_out: impl Fn(usize) -> bool) {
        self.pass.leave_out(is_left_out);
        self.bounds_frame = None;
    }

    /// Whether the hull must be asked about a pose of this step.
    pub fn must_ask(&self) -> bool {
        self.answers.lacks_any()
    }

    /// Whether poses of later steps that share the frame are worth foreseeing: they go into the same question.
    pub fn may_foresee(&self) -> bool {
        self.answers.may_foresee()
    }

    /// The pass to answer: about all poses of this step whose answers are not known, and about those `ahead`, a
    /// list a later step.
    pub fn ask(&mut self, ahead: &[Vec<Pose>]) -> &mut Pass {
        let HullQuery { bounds, answers, bodies, pass, asked, .. } = self;
        *asked = answers.questions(ahead, |shape, pose| bounds.may_meet(shape, pose));
        let body = |query: &PoseQuery| {
            let points =
                |shape: &Arc<Shape>| Points::Body { shape: Arc::clone(shape), pose: query.asked.pose };
            let QueryBody { shape, around, faces } = &bodies[query.body];
            let around = around.as_ref().filter(|_| answers.knows_nothing_around(query));
            AskedBody {
                points: points(shape),
                around: around.map(points),
                faces: faces.clone(),
                back_m: query.asked.back_m,
                reaches: answers.reaches(query.body),
            }
        };
        pass.restart(asked.iter().map(body), bounds.hull_box());
        pass
    }

    /// The pass that asks which places of grids about these poses are inside the hull of a frame, the one in use or the one before:
    /// see [`HullQuery::take_occupancies`].
    pub fn ask_occupancies(&mut self, grid: &Arc<Shape>, poses: &[Pose]) {
        let unknown = Reaches::default();
        let about = |&pose: &Pose| AskedBody::plain(Points::Body { shape: Arc::clone(grid), pose }, &unknown);
        self.pass.for_classes();
        // A grid is about a place that touches the hull of the frame in use.
        self.pass.restart(poses.iter().map(about), self.bounds.hull_box());
    }

    /// The results of that pass, one a pose, if it is done. The next pass asks for planes again.
    pub fn take_occupancies(&mut self) -> Vec<Occupancy> {
        let found = self.pass.results().iter().filter_map(BodyResult::inside).map(Occupancy::of).collect();
        self.pass.for_contacts();
        found
    }

    /// The pass begun by [`HullQuery::ask`].
    pub fn pass(&mut self) -> &mut Pass {
        &mut self.pass
    }

    /// How many poses it is about.
    pub fn poses_asked(&self) -> usize {
        self.asked.len()
    }

    /// Takes the results of that pass, which is done.
    pub fn answered(&mut self) {
        self.answers.add(&self.asked, self.pass.results());
    }

    /// The answers of this step; `None` while one is missing.
    pub fn take(&mut self) -> Option<StepAnswers> {
        self.answers.take(&self.pass.clear_result())
    }
}

#[cfg(test)]
mod tests;
