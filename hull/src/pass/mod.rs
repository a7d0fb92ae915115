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

mod body_exits;
mod reaches;
mod sample_rounds;
mod ways_out;

use std::ops::Range;
use std::sync::Arc;

use nalgebra::Vector3;
use thiserror::Error;

use crate::cull::WorldBox;
use crate::faces::FaceNormals;
use crate::question::{Answer, Batch, Change, Edge, NO_EXIT_M, Points, Question, QuestionKind, Standing};
use crate::reach::Reach;
use crate::rule::ProbeSettings;
use body_exits::Along;

pub use reaches::{FIRST_REACH, Reaches};

/// How far from points around a body planes matter, about 0.14 m.
const AROUND_REACH: Reach = Reach::from_code(125);

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

/// What the pass found for one sample inside the hull.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// The sample's index in its body.
    pub sample: u32,
    /// How many cameras say inside.
    pub inside_count: u32,
    /// The nearest edge; `None` if no camera has one (all its candidates are ignored).
    pub edge: Option<Edge>,
    /// The distance to the exit along the edge's normal, metres; negative of a [contact](crate::contact) that is still
    /// outside.
    pub exit_m: Option<f32>,
    /// Of a contact: how fast the surface moves out along its normal, m/s, where the frame before tells.
    pub speed_m_s: Option<f32>,
    /// Of a contact: how fast the surface moves along itself, world, m/s; nothing where nobody tells.
    pub slide_m_s: [f32; 3],
}

impl Touch {
    /// Whether the sample is inside the hull: a contact may be above its surface.
    pub fn is_inside(&self) -> bool {
        self.exit_m.is_none_or(|exit_m| exit_m >= 0.0)
    }

    /// The normal of its edge, world; zero without one.
    pub(crate) fn normal_world(&self) -> Vector3<f64> {
        self.edge.map_or_else(Vector3::zeros, |edge| Vector3::from(edge.normal_world.map(f64::from)))
    }

    /// The same of a surface that stands still.
    pub(crate) fn at_rest(self) -> Touch {
        Touch { speed_m_s: Some(0.0), slide_m_s: [0.0; 3], ..self }
    }

    /// The sample's response `w`, metres, world; `None` without an exit.
    pub fn response_m(&self) -> Option<[f64; 3]> {
        let (edge, exit_m) = (self.edge?, self.exit_m?);
        Some(edge.normal_world.map(|n| f64::from(n) * f64::from(exit_m)))
    }
}

/// Why a body has no response.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoResponse {
    /// The body is clear of the hull.
    Clear,
    /// No sample found its way out along its normal.
    NoDirection,
    /// A sample has no exit along the body's direction within the search depth.
    NoExit,
}

/// What the pass found for one body.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyResult {
    /// Its samples inside the hull, ascending.
    pub touches: Vec<Touch>,
    /// The vector that moves it out, metres, world, or why there is none.
    pub response_m: Result<[f64; 3], NoResponse>,
    /// How many of the samples inside are still inside after the response.
    pub left_inside: usize,
    /// Of contacts: how fast the surface turns, world, rad/s; nothing where nobody tells.
    pub spin_rad_s: [f32; 3],
    /// Of points around it that have a plane near, if it touches and they were asked about.
    pub around: Vec<Touch>,
}

impl Default for BodyResult {
    fn default() -> BodyResult {
        BodyResult {
            touches: Vec::new(),
            response_m: Err(NoResponse::Clear),
            left_inside: 0,
            spin_rad_s: [0.0; 3],
            around: Vec::new(),
        }
    }
}

/// A body to ask about.
#[derive(Clone, Debug)]
pub struct AskedBody<'a> {
    /// Its samples.
    pub points: Points,
    /// Points around it, whose planes are asked for where it touches: with [`Pass::only_planes`].
    pub around: Option<Points>,
    /// Which way its faces look: where no surface found faces any of them, their ways out are asked for too.
    pub faces: Option<Arc<FaceNormals>>,
    /// How far its edges are worth searching at first, best as the pass before found them.
    pub reaches: &'a Reaches,
}

impl<'a> AskedBody<'a> {
    /// A body of which nothing but its samples is asked about.
    pub fn plain(points: Points, reaches: &'a Reaches) -> AskedBody<'a> {
        AskedBody { points, around: None, faces: None, reaches }
    }
}

/// Why a group's answer was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum AnswerError {
    /// There is no such group.
    #[error("answer of group {found}, expected one of {expected} groups")]
    Group {
        /// Which group.
        found: usize,
        /// How many there are.
        expected: usize,
    },
    /// The group answered this round already, or the pass is done.
    #[error("group {0} answered twice")]
    Twice(usize),
    /// The answer is to another question.
    #[error("group {0} answered another question")]
    Kind(usize),
    /// More or fewer points than asked.
    #[error("group {group} answered {found} points, expected {expected}")]
    Count {
        /// Which group.
        group: usize,
        /// Points answered.
        found: usize,
        /// Points asked.
        expected: usize,
    },
}

/// One pass. Ask every group that it [asks](Pass::asks) its [`Pass::question`], hand each answer to
/// [`Pass::answer`], repeat until there is no question. Buffers are kept from pass to pass.
#[derive(Clone, Debug)]
pub struct Pass {
    settings: ProbeSettings,
    bodies: Vec<PassBody>,
    results: Vec<BodyResult>,
    /// Bodies of this pass, and after them what is around them: there may be buffers of more.
    count: usize,
    /// How many of them are bodies.
    asked_count: usize,
    /// A buffer.
    around: Vec<(usize, Points)>,
    round: Round,
    question: Question,
    /// What the question's points are, in its order.
    targets: Targets,
    /// The answers so far. Merging does not depend on their order.
    merged: Answer,
    /// For each merged edge the reach of its exit, if it was answered.
    exits_within: Vec<Option<Reach>>,
    groups: Vec<Group>,
    /// The groups of the first phase are asked; the others follow.
    is_first_phase: bool,
    /// Planes are asked for instead of edges, and no exits.
    only_planes: bool,
    /// Few exits are asked for, each not far, at the price of rounds.
    saves_bytes: bool,
    changes_sorted: bool,
}

#[derive(Clone, Debug)]
struct PassBody {
    points: Points,
    reaches: Reaches,
    direction: Option<[f32; 3]>,
    longest_m: f32,
    has_exits: bool,
    /// What the response leaves inside has been counted.
    is_checked: bool,
    /// Of each touch.
    along: Vec<Along>,
    /// Of each touch the reach of its exit along its edge's normal, if it was answered.
    exits_within: Vec<Option<Reach>>,
    /// Its box meets the hull's.
    is_near: bool,
    /// The body that these points are around, if they are no body.
    owner: Option<usize>,
    faces: Option<Arc<FaceNormals>>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Group {
    /// Asked for classes before the others.
    is_first: bool,
    /// Asked for edges and exits before the others.
    is_in_first_phase: bool,
    is_asked: bool,
    has_answered: bool,
}

/// The body of each of the question's points, and which of its samples or touches it is.
#[derive(Clone, Debug, Default)]
struct Targets(Vec<(u32, u32)>);

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
            bodies: Vec::new(),
            results: Vec::new(),
            count: 0,
            asked_count: 0,
            around: Vec::new(),
            round: Round::Done,
            question: Question::default(),
            targets: Targets::default(),
            merged: Answer::default(),
            exits_within: Vec::new(),
            groups: vec![Group::default(); group_count],
            is_first_phase: false,
            only_planes: false,
            saves_bytes: false,
            changes_sorted: true,
        };
        let unknown = Reaches::default();
        let asked = |points| AskedBody::plain(points, &unknown);
        pass.restart(bodies.into_iter().map(asked), hull_box);
        pass
    }

    fn add_body(&mut self, points: Points, known: &Reaches, is_near: bool, owner: Option<usize>) {
        let old = self.bodies.get_mut(self.count);
        let take = |old: &mut PassBody| {
            let PassBody { along, exits_within, reaches, .. } = old;
            (std::mem::take(along), std::mem::take(exits_within), std::mem::take(reaches))
        };
        let (along, exits_within, mut reaches) = old.map(take).unwrap_or_default();
        reaches.copy_from(known);
        let body = PassBody {
            points,
            reaches,
            direction: None,
            longest_m: 0.0,
            has_exits: true,
            is_checked: false,
            along,
            exits_within,
            is_near,
            owner,
            faces: None,
        };
        if self.count < self.bodies.len() {
            self.bodies[self.count] = body;
        } else {
            self.bodies.push(body);
            self.results.push(BodyResult::default());
        }
        let result = &mut self.results[self.count];
        result.touches.clear();
        result.around.clear();
        result.response_m = Err(NoResponse::Clear);
        result.left_inside = 0;
        self.count += 1;
    }

    /// Starts another pass with the same groups, settings and buffers.
    pub fn restart<'a>(&mut self, bodies: impl Iterator<Item = AskedBody<'a>>, hull_box: Option<&WorldBox>) {
        self.count = 0;
        let mut around = std::mem::take(&mut self.around);
        around.clear();
        for body in bodies {
            around.extend(body.around.map(|points| (self.count, points)));
            let is_near = match (hull_box, &body.points) {
                (None, _) => false,
                (Some(hull_box), Points::Body { shape, pose }) => {
                    hull_box.meets(&WorldBox::of_body(shape, pose))
                }
                (Some(_), Points::World(_)) => true,
            };
            self.add_body(body.points, body.reaches, is_near, None);
            self.bodies[self.count - 1].faces = body.faces;
        }
        self.asked_count = self.count;
        let unknown = Reaches::default();
        for (owner, points) in around.drain(..) {
            let is_near = self.bodies[owner].is_near;
            self.add_body(points, &unknown, is_near, Some(owner));
        }
        self.around = around;
        self.question.restart(QuestionKind::Classes);
        self.targets.0.clear();
        for body in self.bodies[..self.asked_count].iter().filter(|body| body.is_near) {
            self.question.batches.push(Batch::all(body.points.clone()));
        }
        self.is_first_phase = false;
        let has_first = self.groups.iter().any(|group| group.is_first);
        self.ask(Round::Classes, |group| !has_first || group.is_first);
    }

    /// From the next pass on, asks these groups for classes first, and the others about what they leave;
    /// with none, all at once.
    pub fn ask_first(&mut self, groups: &[usize]) {
        let count = self.groups.len();
        for (index, group) in self.groups.iter_mut().enumerate() {
            group.is_first = groups.len() < count && groups.contains(&index);
        }
    }

    /// From the next question on, asks a third of the groups for edges and exits first, and the others within
    /// the nearest that these found: what is farther cannot win. Or asks all at once.
    pub fn ask_in_two_phases(&mut self, two_phases: bool) {
        // Cameras stand around the room: groups spread over the rig see every point from near its edge.
        let (count, first) = (self.groups.len(), self.groups.len().div_ceil(3));
        for (index, group) in self.groups.iter_mut().enumerate() {
            let is_first = (0..first).any(|place| place * count / first == index);
            group.is_in_first_phase = two_phases && first < count && is_first;
        }
    }

    /// From the next pass on, asks for planes instead of edges: touches have the hull's surface near them, bodies no
    /// response.
    pub fn only_planes(&mut self, only_planes: bool) {
        self.only_planes = only_planes;
    }

    /// Whether bytes are dearer than rounds: then several groups are asked for fewer exits, each within less, and more
    /// often once more.
    pub fn save_bytes(&mut self, saves_bytes: bool) {
        self.saves_bytes = saves_bytes;
    }

    /// The round that is being asked.
    pub fn round(&self) -> Round {
        self.round
    }

    /// The question of this round; `None` when the pass is done.
    pub fn question(&self) -> Option<&Question> {
        (self.round != Round::Done).then_some(&self.question)
    }

    /// True if the question is to be asked of this group, and it has not answered.
    pub fn asks(&self, group: usize) -> bool {
        let open = |group: &Group| group.is_asked && !group.has_answered;
        self.round != Round::Done && self.groups.get(group).is_some_and(open)
    }

    /// Takes a group's answer; when all that are asked have answered, the next question is there.
    pub fn answer(&mut self, group: usize, answer: &Answer) -> Result<(), AnswerError> {
        let expected = self.groups.len();
        let asked = *self.groups.get(group).ok_or(AnswerError::Group { found: group, expected })?;
        if self.round == Round::Done || !asked.is_asked || asked.has_answered {
            return Err(AnswerError::Twice(group));
        }
        if !answer.kind.answers(self.question.kind) {
            return Err(AnswerError::Kind(group));
        }
        if answer.len() != self.merged.len() {
            return Err(AnswerError::Count { group, found: answer.len(), expected: self.merged.len() });
        }
        self.merge(answer);
        self.groups[group].has_answered = true;
        if self.groups.iter().all(|group| group.has_answered || !group.is_asked) {
            self.advance();
        }
        Ok(())
    }

    /// What was found for each body, in the order given. Complete once there is no question.
    pub fn results(&self) -> &[BodyResult] {
        &self.results[..self.asked_count]
    }

    /// The same, to keep.
    pub fn into_results(mut self) -> Vec<BodyResult> {
        self.results.truncate(self.asked_count);
        self.results
    }

    /// Asks the question that stands there, or ends if it is empty.
    fn ask(&mut self, round: Round, asks: impl Fn(&Group) -> bool) {
        let count = self.question.len();
        self.round = if count == 0 { Round::Done } else { round };
        for group in &mut self.groups {
            group.is_asked = asks(group);
            group.has_answered = false;
        }
        let merged = &mut self.merged;
        merged.restart(self.question.kind);
        self.changes_sorted = true;
        match self.question.kind {
            QuestionKind::Classes => merged.standings.resize(count, Standing::inside(0)),
            QuestionKind::Edges | QuestionKind::Planes => {
                merged.edges.resize(count, None);
                // One group alone finds exits at once.
                let told = if self.groups.len() == 1 { 0 } else { count };
                self.exits_within.clear();
                self.exits_within.resize(told, None);
            }
            QuestionKind::Exits | QuestionKind::SharedExits => merged.exits_m.resize(count, NO_EXIT_M),
        }
    }

    /// Asks the current question in two phases, if there are any and its search is
    /// bounded anyway; what is asked again is worth no more trips, unless bytes are dearer.
    fn ask_distances(&mut self, round: Round) {
        let is_worth_it = self.saves_bytes || !self.question.within.is_empty();
        let two_phases = is_worth_it && self.groups.iter().any(|group| group.is_in_first_phase);
        self.ask(round, |group| !two_phases || group.is_in_first_phase);
        self.is_first_phase = two_phases && self.round == round;
    }

    /// Asks the groups of the second phase, within what the first found.
    fn ask_within_found(&mut self) {
        let Pass { question, merged, groups, targets, bodies, .. } = self;
        // From outside the farthest plane wins: what was found of points around bodies bounds nothing.
        let bounds =
            |at: usize| targets.0.get(at).is_none_or(|&(body, _)| bodies[body as usize].owner.is_none());
        let edges_m = merged.edges.iter().map(|edge| edge.map_or(f32::INFINITY, |edge| edge.distance_m));
        let found_m = edges_m.chain(merged.exits_m.iter().copied());
        question.within.resize(question.len(), Reach::UNBOUNDED);
        for (at, (reach, found_m)) in question.within.iter_mut().zip(found_m).enumerate() {
            if found_m < reach.m() && bounds(at) {
                *reach = (*reach).min(Reach::covering(f64::from(found_m)));
            }
        }
        for group in groups {
            (group.is_asked, group.has_answered) = (!group.is_in_first_phase, false);
        }
        self.is_first_phase = false;
    }

    fn merge(&mut self, answer: &Answer) {
        let merged = &mut self.merged;
        for (merged, &standing) in merged.standings.iter_mut().zip(&answer.standings) {
            *merged = merged.and(standing);
        }
        for (at, (merged, edge)) in merged.edges.iter_mut().zip(&answer.edges).enumerate() {
            let Some(edge) = edge else { continue };
            if merged.is_none_or(|before| edge.is_nearer(&before)) {
                *merged = Some(*edge);
                if let Some(within) = self.exits_within.get_mut(at) {
                    *within = answer.exits_within.get(at).copied();
                }
            }
        }
        for (merged, &exit_m) in merged.exits_m.iter_mut().zip(&answer.exits_m) {
            *merged = merged.min(exit_m);
        }
        self.changes_sorted &= merged.changes.is_empty() || answer.changes.is_empty();
        merged.changes.extend_from_slice(&answer.changes);
    }

    fn advance(&mut self) {
        if self.is_first_phase {
            return self.ask_within_found();
        }
        if !self.changes_sorted {
            let order = |a: &Change, b: &Change| a.point.cmp(&b.point).then(a.t_m.total_cmp(&b.t_m));
            self.merged.changes.sort_unstable_by(order);
        }
        match self.round {
            Round::Classes => self.after_classes(),
            Round::Edges => self.after_edges(),
            Round::Exits if self.only_planes => self.after_ways_out(),
            Round::Check if self.only_planes => self.after_planes_beyond(),
            Round::Exits => self.after_exits(),
            Round::BodyExits => self.after_body_exits(),
            Round::Check => self.after_check(),
            Round::Done => {}
        }
    }

    /// Adds the touches that fit to the question and to its targets.
    fn pick_touches(&mut self, offset_m: [f64; 3], fits: impl Fn(&PassBody, usize, &Touch) -> bool) {
        let Pass { bodies, results, count, question, targets, .. } = self;
        targets.0.clear();
        for (index, (body, result)) in bodies[..*count].iter().zip(results).enumerate() {
            let before = targets.0.len();
            let touches = result.touches.iter().enumerate().filter(|&(at, touch)| fits(body, at, touch));
            targets.0.extend(touches.map(|(at, _)| (index as u32, at as u32)));
            let picks = &targets.0[before..];
            if !picks.is_empty() {
                let samples = picks.iter().map(|&(_, touch)| result.touches[touch as usize].sample);
                question.pick(&body.points, offset_m, samples);
            }
        }
    }
}

impl Question {
    /// True if a point's edge or exit may have been left out as too far away.
    fn bounds(&self, point: usize) -> bool {
        self.within.get(point).is_some_and(|&reach| reach != Reach::UNBOUNDED)
    }
}

impl Touch {
    pub(crate) fn new(sample: u32, inside_count: usize) -> Touch {
        Touch {
            sample,
            inside_count: inside_count as u32,
            edge: None,
            exit_m: None,
            speed_m_s: None,
            slide_m_s: [0.0; 3],
        }
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
