//! One collision pass over all bodies (paper §4 and §5) as a plain state machine: it yields the next
//! round's question, takes the groups' answers in any order, and knows nothing of how they travel.
//!
//! The paper's round of classes and nearest edges is asked in two: classes of every sample first, then
//! edges of those inside the hull alone. The answers are the same and far fewer edges are searched.

use thiserror::Error;

use crate::cull::WorldBox;
use crate::merge::{merge_edges, merge_exits, merge_standings};
use crate::probe::exit::Exit;
use crate::question::{Answer, Batch, Directions, Edge, Points, Question, Standing};
use crate::response::body_direction;
use crate::rule::ProbeSettings;

/// The rounds of a pass, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Round {
    /// Which samples are inside.
    Classes,
    /// The nearest edge and its normal of those inside.
    Edges,
    /// The exit of those inside along their normals.
    Exits,
    /// The exit of those inside along their body's mean response.
    BodyExits,
    /// Which of those inside are still inside once the body has moved.
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
    /// The distance to the exit along the edge's normal, metres.
    pub exit_m: Option<f32>,
}

impl Touch {
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

/// One pass. Ask every group [`Pass::question`], hand each answer to [`Pass::answer`], repeat until
/// there is no question.
#[derive(Clone, Debug)]
pub struct Pass {
    settings: ProbeSettings,
    bodies: Vec<PassBody>,
    round: Round,
    question: Option<Question>,
    /// The bodies of the question's batches.
    asked: Vec<usize>,
    answers: Vec<Option<Answer>>,
}

#[derive(Clone, Debug)]
struct PassBody {
    points: Points,
    direction: Option<[f32; 3]>,
    result: BodyResult,
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
        let meets_hull = |points: &Points| match (hull_box, points) {
            (None, _) => false,
            (Some(hull_box), Points::Body { shape, pose }) => hull_box.meets(&WorldBox::of_body(shape, pose)),
            (Some(_), Points::World(_)) => true,
        };
        let survivors = bodies.iter().enumerate().filter(|(_, points)| meets_hull(points));
        let asked: Vec<usize> = survivors.map(|(index, _)| index).collect();
        let batches: Vec<Batch> =
            asked.iter().map(|&index| Batch { points: bodies[index].clone(), picked: None }).collect();
        let clear = BodyResult { touches: vec![], response_m: Err(NoResponse::Clear), left_inside: 0 };
        let start = |points| PassBody { points, direction: None, result: clear.clone() };
        let mut pass = Pass {
            settings,
            bodies: bodies.into_iter().map(start).collect(),
            round: Round::Classes,
            question: None,
            asked,
            answers: vec![None; group_count],
        };
        pass.pose(Round::Classes, Question::Classes(batches));
        pass
    }

    /// The round that is being asked.
    pub fn round(&self) -> Round {
        self.round
    }

    /// The question of this round to every group; `None` when the pass is done.
    pub fn question(&self) -> Option<&Question> {
        self.question.as_ref()
    }

    /// Takes a group's answer; when all have answered, the next question is there.
    pub fn answer(&mut self, group: usize, answer: Answer) -> Result<(), AnswerError> {
        let expected = self.answers.len();
        let question = self.question.as_ref().ok_or(AnswerError::Twice(group))?;
        let slot = self.answers.get_mut(group).ok_or(AnswerError::Group { found: group, expected })?;
        if slot.is_some() {
            return Err(AnswerError::Twice(group));
        }
        let kinds_match = matches!(
            (question, &answer),
            (Question::Classes(_), Answer::Classes(_))
                | (Question::Edges(_), Answer::Edges(_))
                | (Question::Exits(_), Answer::Exits(_))
        );
        if !kinds_match {
            return Err(AnswerError::Kind(group));
        }
        if answer.len() != question.len() {
            return Err(AnswerError::Count { group, found: answer.len(), expected: question.len() });
        }
        *slot = Some(answer);
        if self.answers.iter().all(Option::is_some) {
            self.advance();
        }
        Ok(())
    }

    /// What was found for each body, in the order given. Complete once there is no question.
    pub fn into_results(self) -> Vec<BodyResult> {
        self.bodies.into_iter().map(|body| body.result).collect()
    }

    /// Asks a question, or goes on at once if it is empty.
    fn pose(&mut self, round: Round, question: Question) {
        self.round = round;
        if question.is_empty() {
            self.question = None;
            self.round = Round::Done;
            return;
        }
        self.question = Some(question);
        self.answers.fill(None);
    }

    fn advance(&mut self) {
        let answers: Vec<Answer> = self.answers.iter_mut().filter_map(Option::take).collect();
        match self.round {
            Round::Classes => self.after_classes(&standings(&answers)),
            Round::Edges => self.after_edges(&answers),
            Round::Exits => self.after_exits(&exits(&answers)),
            Round::BodyExits => self.after_body_exits(&exits(&answers)),
            Round::Check => self.after_check(&standings(&answers)),
            Round::Done => {}
        }
    }

    fn after_classes(&mut self, standings: &[&[Standing]]) {
        let rule = self.settings.rule();
        let mut at = 0;
        for &index in &self.asked {
            let body = &mut self.bodies[index];
            for sample in 0..body.points.len() as u32 {
                let merged = merge_standings(standings.iter().map(|group| group[at]), rule);
                at += 1;
                if let Some(count) = merged {
                    let inside_count = count as u32;
                    body.result.touches.push(Touch { sample, inside_count, edge: None, exit_m: None });
                }
            }
        }
        self.asked.retain(|&index| !self.bodies[index].result.touches.is_empty());
        let batches = self.asked.iter().map(|&index| self.bodies[index].touching(|_| true)).collect();
        self.pose(Round::Edges, Question::Edges(batches));
    }

    fn after_edges(&mut self, answers: &[Answer]) {
        let groups: Vec<&[Option<Edge>]> = answers.iter().filter_map(Answer::edges).collect();
        let mut at = 0;
        for &index in &self.asked {
            for touch in &mut self.bodies[index].result.touches {
                touch.edge = merge_edges(groups.iter().map(|group| group[at]));
                at += 1;
            }
        }
        let batches = self.asked.iter().map(|&index| {
            let body = &self.bodies[index];
            let normals = body.result.touches.iter().filter_map(|touch| touch.edge);
            let directions = Directions::Each(normals.map(|edge| edge.normal_world).collect());
            (body.touching(|touch| touch.edge.is_some()), directions)
        });
        let question = Question::Exits(batches.collect());
        let nothing = question.is_empty();
        self.pose(Round::Exits, question);
        if nothing {
            self.after_exits(&[]);
        }
    }

    fn after_exits(&mut self, groups: &[&[Exit]]) {
        let rule = self.settings.rule();
        let mut at = 0;
        for &index in &self.asked {
            let body = &mut self.bodies[index];
            for touch in body.result.touches.iter_mut().filter(|touch| touch.edge.is_some()) {
                let exits = groups.iter().map(|group| &group[at]);
                touch.exit_m = merge_exits(exits, touch.inside_count as usize, rule);
                at += 1;
            }
            let responses: Vec<[f64; 3]> = body.result.touches.iter().filter_map(Touch::response_m).collect();
            body.direction = body_direction(&responses);
            if body.direction.is_none() {
                body.result.response_m = Err(NoResponse::NoDirection);
                body.result.left_inside = body.result.touches.len();
            }
        }
        self.asked.retain(|&index| self.bodies[index].direction.is_some());
        let batches = self.asked.iter().filter_map(|&index| {
            let body = &self.bodies[index];
            Some((body.touching(|_| true), Directions::Shared(body.direction?)))
        });
        let question = Question::Exits(batches.collect());
        self.pose(Round::BodyExits, question);
    }

    fn after_body_exits(&mut self, groups: &[&[Exit]]) {
        let rule = self.settings.rule();
        let mut at = 0;
        for &index in &self.asked {
            let body = &mut self.bodies[index];
            let mut longest_m = Some(0.0f32);
            for touch in &body.result.touches {
                let exits = groups.iter().map(|group| &group[at]);
                let exit_m = merge_exits(exits, touch.inside_count as usize, rule);
                longest_m = longest_m.zip(exit_m).map(|(a, b)| a.max(b));
                at += 1;
            }
            body.result.response_m = match (body.direction, longest_m) {
                (Some(direction), Some(longest_m)) => {
                    Ok(direction.map(|component| f64::from(component) * f64::from(longest_m)))
                }
                _ => Err(NoResponse::NoExit),
            };
            body.result.left_inside = body.result.touches.len();
        }
        self.asked.retain(|&index| self.bodies[index].result.response_m.is_ok());
        let batches = self.asked.iter().filter_map(|&index| {
            let body = &self.bodies[index];
            let mut batch = body.touching(|_| true);
            batch.points = batch.points.moved(body.result.response_m.ok()?);
            Some(batch)
        });
        let question = Question::Classes(batches.collect());
        self.pose(Round::Check, question);
    }

    fn after_check(&mut self, standings: &[&[Standing]]) {
        let rule = self.settings.rule();
        let mut at = 0;
        for &index in &self.asked {
            let result = &mut self.bodies[index].result;
            let range = at..at + result.touches.len();
            at = range.end;
            result.left_inside = range
                .filter(|&at| merge_standings(standings.iter().map(|group| group[at]), rule).is_some())
                .count();
        }
        self.question = None;
        self.round = Round::Done;
    }
}

impl PassBody {
    /// A batch of the touching samples that fit.
    fn touching(&self, fits: impl Fn(&Touch) -> bool) -> Batch {
        let touches = self.result.touches.iter().filter(|touch| fits(touch));
        Batch { points: self.points.clone(), picked: Some(touches.map(|touch| touch.sample).collect()) }
    }
}

fn standings(answers: &[Answer]) -> Vec<&[Standing]> {
    answers.iter().filter_map(Answer::classes).collect()
}

fn exits(answers: &[Answer]) -> Vec<&[Exit]> {
    answers.iter().filter_map(Answer::exits).collect()
}
