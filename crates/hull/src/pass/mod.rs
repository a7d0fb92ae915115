//! One collision pass over all bodies (paper §4 and §5) as a plain state machine: it yields the next
//! round's question, takes the groups' answers in any order, and knows nothing of how they travel.
//!
//! The paper's round of classes and nearest edges is asked in two: classes of every sample first, then
//! edges of those inside the hull alone. The answers are the same and far fewer edges are searched.
//!
//! Cameras in different groups cannot spare each other work. So several groups are asked for edges and
//! exits within a reach only, and for all of them where nothing was found within it: what is found within
//! a reach is nearer than all that was left out. Classes may be asked of some groups first and of the
//! others for the points that are left; edges and exits of some groups first and of the others within what
//! these have found. None of it changes an answer.
//!
//! Two responses need different things after the classes: the paper's (`paper/`) the way out of each body, contacts
//! (`contacts/`) the planes of the surface near it. A pass for classes alone ends there.

mod bodies;
mod contacts;
mod found;
mod groups;
mod paper;
mod pending;
mod reaches;
mod rounds;

use std::ops::Range;
use std::sync::Arc;

use crate::cull::WorldBox;
use crate::faces::FaceNormals;
use crate::question::{Batch, Change, Points, Question, QuestionKind};
use crate::reach::Reach;
use crate::rule::ProbeSettings;
use bodies::{Bodies, PassBody};
use groups::Group;
use pending::PendingQuestion;

pub use contacts::{BodyPlanes, SamplePlane};
pub use found::BodyResult;
pub use groups::AnswerError;
pub use paper::{InsideSample, NoResponse, PaperResult};
pub use reaches::{FIRST_REACH, Reaches};

/// How far from points around a body planes matter, about 0.14 m.
pub const AROUND_REACH: Reach = Reach::from_code(125);

/// The rounds of a pass, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Round {
    /// Which samples are inside.
    Classes,
    /// The nearest edge and its normal, or plane, of those inside.
    Edges,
    /// The exit of those inside along their normals; or against their faces, of those that no plane faces.
    Exits,
    /// The exit along their body's mean response: of those farthest back, then of those that a check finds.
    BodyExits,
    /// Which of those inside are still inside once the body has moved; or the planes where the ways out end.
    Check,
    /// Nothing is left to ask.
    Done,
}

/// A body to ask about.
#[derive(Clone, Debug)]
pub struct AskedBody<'a> {
    /// Its samples.
    pub points: Points,
    /// Points around it, whose planes are asked for where it touches: of a pass [for contacts](Pass::for_contacts).
    pub around: Option<Points>,
    /// Which way its faces look at its first samples; those that follow are offset samples of these, of which only
    /// those are asked for planes whose sample is outside. Where no surface found faces any face, their ways out are asked
    /// for.
    pub faces: Option<Arc<FaceNormals>>,
    /// The way back to where the body came into the hull, and no farther, world, metres. Its samples inside get the planes of the
    /// surface that they came through, not the nearest.
    pub back_m: Option<[f32; 3]>,
    /// How far its edges are worth searching at first, best as the pass before found them.
    pub reaches: &'a Reaches,
}

impl<'a> AskedBody<'a> {
    /// A body of which nothing but its samples is asked about.
    pub fn plain(points: Points, reaches: &'a Reaches) -> AskedBody<'a> {
        AskedBody { points, around: None, faces: None, back_m: None, reaches }
    }
}

/// One pass. Ask every group that it [asks](Pass::asks) its [`Pass::question`], hand each answer to
/// [`Pass::answer`], repeat until there is no question. Buffers are kept from pass to pass.
#[derive(Clone, Debug)]
pub struct Pass {
    settings: ProbeSettings,
    bodies: Bodies,
    /// Of each body; there may be buffers of more.
    results: Vec<BodyResult>,
    round: Round,
    /// The question of this round.
    pending: PendingQuestion,
    groups: Vec<Group>,
    /// The groups of the first phase are asked; the others follow.
    is_first_phase: bool,
    response: Response,
    trips: TripPolicy,
    /// Points that were asked about since it was made, by kind.
    points_asked: [u64; QuestionKind::ALL.len()],
}

/// How round trips weigh against bytes.
#[derive(Clone, Copy, Debug, Default)]
struct TripPolicy {
    /// For contacts: planes that are likely to matter are asked for together with the classes, and ways out together
    /// with planes.
    speculates: bool,
    /// Few exits are asked for, each not far, at the price of rounds.
    saves_bytes: bool,
}

/// For which response it asks, and what that needs to know of the bodies.
#[derive(Clone, Debug)]
enum Response {
    Paper(paper::Paper),
    Contacts(Box<contacts::Contacts>),
    /// None: for classes alone.
    Classes,
}

impl Pass {
    /// Starts a pass over bodies, to be asked of `group_count` groups. Bodies whose box does not meet
    /// `hull_box` are not asked about (`None`: nothing can be inside).
    pub fn new(
        bodies: Vec<Points>,
        hull_box: Option<&WorldBox>,
        settings: ProbeSettings,
        group_count: usize,
    ) -> Pass {
        let mut pass = Pass {
            settings,
            bodies: Bodies::default(),
            results: Vec::new(),
            round: Round::Done,
            pending: PendingQuestion::default(),
            groups: vec![Group::default(); group_count],
            is_first_phase: false,
            response: Response::Paper(paper::Paper::default()),
            trips: TripPolicy::default(),
            points_asked: [0; QuestionKind::ALL.len()],
        };
        let unknown = Reaches::default();
        let asked = |points| AskedBody::plain(points, &unknown);
        pass.restart(bodies.into_iter().map(asked), hull_box);
        pass
    }

    /// Starts another pass with the same groups, settings and buffers.
    pub fn restart<'a>(&mut self, bodies: impl Iterator<Item = AskedBody<'a>>, hull_box: Option<&WorldBox>) {
        self.bodies.restart();
        if let Response::Contacts(contacts) = &mut self.response {
            contacts.restart();
        }
        for mut body in bodies {
            if let Response::Contacts(contacts) = &mut self.response {
                contacts.add(body.faces.take(), body.back_m);
            }
            self.bodies.add(body, hull_box);
        }
        match &mut self.response {
            Response::Contacts(contacts) => self.bodies.add_around(|owner| contacts.add_around(owner)),
            Response::Paper(paper) => {
                self.bodies.add_around(|_| {});
                paper.restart(self.bodies.all().len());
            }
            Response::Classes => self.bodies.add_around(|_| {}),
        }
        self.restart_results();
        self.pending.restart(QuestionKind::Classes);
        for body in self.bodies.asked().iter().filter(|body| body.is_near) {
            self.pending.question.batches.push(Batch::all(body.points.clone()));
        }
        self.is_first_phase = false;
        let has_first = self.groups.iter().any(|group| group.is_first && !group.is_left_out);
        self.ask(Round::Classes, |group| !has_first || group.is_first);
        self.speculate_on_planes();
    }

    /// Results of bodies that are clear of the hull, in the buffers of those before.
    fn restart_results(&mut self) {
        let count = self.bodies.asked().len();
        for result in self.results.iter_mut().take(count) {
            match (&self.response, result) {
                (Response::Paper(_), BodyResult::Paper(paper)) => {
                    paper.inside.clear();
                    (paper.response_m, paper.left_inside) = (Err(NoResponse::Clear), 0);
                }
                (Response::Contacts(_), BodyResult::Planes(planes)) => {
                    planes.samples.clear();
                    planes.around.clear();
                }
                (Response::Classes, BodyResult::Inside(inside)) => inside.clear(),
                (_, other) => *other = self.response.clear(),
            }
        }
        while self.results.len() < count {
            self.results.push(self.response.clear());
        }
    }

    /// There is nothing left to ask: writes what was found.
    fn conclude(&mut self) {
        let Pass { bodies, results, response, .. } = self;
        for (index, (body, result)) in bodies.asked().iter().zip(results).enumerate() {
            match (&*response, result) {
                (Response::Paper(paper), BodyResult::Paper(result)) => {
                    paper.conclude(index, &body.found, result);
                }
                (Response::Contacts(_), BodyResult::Planes(planes)) => {
                    contacts::Contacts::conclude(&body.found, planes);
                }
                (Response::Classes, BodyResult::Inside(inside)) => {
                    inside.clear();
                    inside.extend(body.found.iter().map(|found| found.sample));
                }
                _ => {}
            }
        }
    }

    /// Asks for contacts from now on: for planes instead of edges. Bodies have the hull's surface near them, and no
    /// response. What was found before is dropped; a pass that has just begun goes on with its bodies.
    pub fn for_contacts(&mut self) {
        if self.asks_planes() {
            return;
        }
        let mut contacts = contacts::Contacts::default();
        self.bodies.all().iter().for_each(|_| contacts.add(None, None));
        self.response = Response::Contacts(Box::new(contacts));
        self.restart_results();
    }

    /// Asks for the paper's response from now on, as a new pass does. The same holds of what was found before.
    pub fn for_response(&mut self) {
        if matches!(self.response, Response::Paper(_)) {
            return;
        }
        let mut paper = paper::Paper::default();
        paper.restart(self.bodies.all().len());
        self.response = Response::Paper(paper);
        self.restart_results();
    }

    /// Asks for classes alone from now on: which samples are inside, and no more. The same holds of what was found before.
    pub fn for_classes(&mut self) {
        self.response = Response::Classes;
        self.restart_results();
    }

    /// Whether it asks for planes.
    pub fn asks_planes(&self) -> bool {
        matches!(self.response, Response::Contacts(_))
    }

    /// Whether bytes are dearer than rounds: then several groups are asked for fewer exits, each within less, and more
    /// often once more.
    pub fn save_bytes(&mut self, saves_bytes: bool) {
        self.trips.saves_bytes = saves_bytes;
    }

    /// The round that is being asked.
    pub fn round(&self) -> Round {
        self.round
    }

    /// The question of this round; `None` when the pass is done.
    pub fn question(&self) -> Option<&Question> {
        (self.round != Round::Done).then_some(&self.pending.question)
    }

    /// How many points were asked about since it was made, by kind, in the order of [`QuestionKind::ALL`].
    pub fn points_asked(&self) -> &[u64; QuestionKind::ALL.len()] {
        &self.points_asked
    }

    /// What was found for each body, in the order given. Of bodies that are clear of the hull, until there is no question.
    pub fn results(&self) -> &[BodyResult] {
        &self.results[..self.bodies.asked().len()]
    }

    /// The same, to keep.
    pub fn into_results(mut self) -> Vec<BodyResult> {
        self.results.truncate(self.bodies.asked().len());
        self.results
    }

    /// What would be found for a body that is clear of the hull.
    pub fn clear_result(&self) -> BodyResult {
        self.response.clear()
    }
}

impl Response {
    /// What is found for a body that is clear of the hull.
    fn clear(&self) -> BodyResult {
        match self {
            Response::Paper(_) => BodyResult::Paper(PaperResult::default()),
            Response::Contacts(_) => BodyResult::Planes(BodyPlanes::default()),
            Response::Classes => BodyResult::Inside(Vec::new()),
        }
    }
}

impl Question {
    /// True if a point's edge or exit may have been left out as too far away.
    fn bounds(&self, point: usize) -> bool {
        self.within.get(point).is_some_and(|&reach| reach != Reach::UNBOUNDED)
    }
}

/// With more exits than this to be asked some are longer than any reach worth its bytes, and another round will be
/// needed anyway.
const MANY_EXITS: usize = 500;

/// How far an exit is searched at first where only the distance of its edge is known.
fn exit_reach(distance_m: f32, is_of_many: bool) -> Reach {
    let distance_m = f64::from(distance_m);
    Reach::covering(if is_of_many { 1.25 * distance_m + 0.005 } else { 4.0 * distance_m + 0.05 }).coarse()
}

/// The changes of a point, in a list sorted by point, from where those of the point before it end.
fn changes_of(changes: &[Change], point: usize, from: usize) -> Range<usize> {
    let count = changes[from..].iter().take_while(|change| change.point as usize == point).count();
    from..from + count
}
