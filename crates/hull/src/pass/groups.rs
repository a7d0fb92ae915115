//! Who is asked and who has answered: a round goes to groups of cameras, in one phase or two, and their answers merge.

use thiserror::Error;

use super::{Pass, PendingQuestion, Response, Round};
use crate::question::{Answer, QuestionKind};
use crate::reach::Reach;

/// Why a group's answer was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum AnswerError {
    /// There is no such group.
    #[error("answer of group {found}, expected one of {expected} groups")]
    Group {
        /// Index of the group.
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
        /// Index of the group.
        group: usize,
        /// Points answered.
        found: usize,
        /// Points asked.
        expected: usize,
    },
}

/// A group of cameras that answer together.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Group {
    /// Asked for classes before the others.
    pub is_first: bool,
    /// Asked for edges and exits before the others.
    pub is_in_first_phase: bool,
    pub is_asked: bool,
    pub has_answered: bool,
    /// It is not there: as if its cameras were not in the rig.
    pub is_left_out: bool,
}

impl Pass {
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

    /// From the next pass on, asks so many groups: the same cameras, divided otherwise. None is left out.
    pub fn ask_groups(&mut self, group_count: usize) {
        self.groups = vec![Group::default(); group_count];
    }

    /// From the next pass on, asks nothing of these groups, as if their cameras were not in the rig. One must be left.
    pub fn leave_out(&mut self, is_left_out: impl Fn(usize) -> bool) {
        for (index, group) in self.groups.iter_mut().enumerate() {
            group.is_left_out = is_left_out(index);
        }
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
        if self.round != Round::Done
            && let Response::Contacts(contacts) = &mut self.response
            && contacts.speculation.is_answered_by(answer, &self.pending.question)
        {
            contacts.speculation.answer(group, answer)?;
            self.advance_if_answered();
            return Ok(());
        }
        if self.round == Round::Done || !asked.is_asked || asked.has_answered {
            return Err(AnswerError::Twice(group));
        }
        if !answer.kind.answers(self.pending.question.kind) {
            return Err(AnswerError::Kind(group));
        }
        let expected = self.pending.merged.len();
        if answer.len() != expected {
            return Err(AnswerError::Count { group, found: answer.len(), expected });
        }
        self.pending.merge(answer);
        self.groups[group].has_answered = true;
        self.advance_if_answered();
        Ok(())
    }

    fn advance_if_answered(&mut self) {
        let is_answered = self.groups.iter().all(|group| group.has_answered || !group.is_asked);
        if is_answered && self.speculative_question().is_none() {
            self.advance();
            if self.round == Round::Done {
                self.conclude();
            }
        }
    }

    /// Asks the question that stands there, or ends if it is empty.
    pub(super) fn ask(&mut self, round: Round, asks: impl Fn(&Group) -> bool) {
        let Pass { pending, groups, .. } = self;
        let count = pending.question.len();
        self.points_asked[pending.question.kind as usize] += count as u64;
        self.round = if count == 0 { Round::Done } else { round };
        for group in groups.iter_mut() {
            group.is_asked = !group.is_left_out && asks(group);
            group.has_answered = false;
        }
        pending.forget_answers();
        if matches!(pending.question.kind, QuestionKind::Edges | QuestionKind::Planes) {
            // One group alone finds exits at once.
            let told = if groups.len() == 1 { 0 } else { count };
            pending.exits_within.clear();
            pending.exits_within.resize(told, None);
        }
    }

    /// Asks the current question in two phases, if there are any and its search is
    /// bounded anyway; what is asked again is worth no more trips, unless bytes are dearer. Planes never are: most are
    /// of points around bodies, which no other group can spare any work.
    pub(super) fn ask_distances(&mut self, round: Round) {
        let is_bounded = !self.pending.question.within.is_empty();
        let is_worth_it = !self.asks_planes() && (self.trips.saves_bytes || is_bounded);
        let two_phases =
            is_worth_it && self.groups.iter().any(|group| group.is_in_first_phase && !group.is_left_out);
        self.ask(round, |group| !two_phases || group.is_in_first_phase);
        self.is_first_phase = two_phases && self.round == round;
    }

    /// Asks the groups of the second phase, within what the first found.
    fn ask_within_found(&mut self) {
        let Pass { pending: PendingQuestion { question, targets, merged, .. }, groups, bodies, .. } = self;
        // From outside the farthest plane wins: what was found of points around bodies bounds nothing.
        let bounds =
            |at: usize| targets.0.get(at).is_none_or(|&(body, _)| !bodies.all()[body as usize].is_around);
        let edges_m = merged.edges.iter().map(|edge| edge.map_or(f32::INFINITY, |edge| edge.distance_m));
        let found_m = edges_m.chain(merged.exits_m.iter().copied());
        question.within.resize(question.len(), Reach::UNBOUNDED);
        for (at, (reach, found_m)) in question.within.iter_mut().zip(found_m).enumerate() {
            if found_m < reach.m() && bounds(at) {
                *reach = (*reach).min(Reach::covering(f64::from(found_m)));
            }
        }
        for group in groups {
            let is_asked = !group.is_in_first_phase && !group.is_left_out;
            (group.is_asked, group.has_answered) = (is_asked, false);
        }
        self.is_first_phase = false;
        if !self.groups.iter().any(|group| group.is_asked) {
            self.advance();
        }
    }

    fn advance(&mut self) {
        if self.is_first_phase {
            return self.ask_within_found();
        }
        self.pending.sort_changes();
        match (self.round, &self.response) {
            (Round::Classes, _) => self.after_classes(),
            (Round::Edges, _) => self.after_edges(),
            (Round::Exits, Response::Contacts(_)) => self.after_ways_out(),
            (Round::Check, Response::Contacts(_)) => self.after_planes_beyond(),
            (Round::Exits, Response::Paper(_)) => self.after_exits(),
            (Round::BodyExits, _) => self.after_body_exits(),
            (Round::Check, Response::Paper(_)) => self.after_check(),
            (Round::Exits | Round::Check, Response::Classes) | (Round::Done, _) => {}
        }
    }
}
