//! The views that one process holds at one frame, answering together. Cameras of a group spare each
//! other work: a camera is not searched farther than the best so far. The answers are those of the
//! single cameras merged, bit for bit.

mod beside;
mod edges;
mod exits;
mod planes;
mod projections;
mod selection;

use std::ops::Range;

use nalgebra::Point3;

use crate::coordinates::Coordinates;
use crate::cull::{WorldBox, hull_box};
use crate::probe::classify::{BLOCK, Block};
use crate::question::{Answer, Batch, Points, Question, QuestionKind, Standing};
use crate::rule::HullRule;
use crate::vector::{VectorPath, on_path};
use crate::view::{Class, View};
use edges::Nearest;
use exits::Rays;
use planes::Planes;
use projections::Projections;

/// Fewer points than this are classified one by one.
const FEW: usize = 16;

/// Cameras of one process at one instant.
#[derive(Clone, Debug)]
pub struct ViewSet {
    views: Vec<View>,
    path: VectorPath,
    always_judge: bool,
    hull_box: Option<WorldBox>,
    /// The views as they reject most: each looks as far across those before it as any left does.
    rejecting: Vec<usize>,
    /// No camera is searched for exits farther than this, metres.
    most_depth_m: f32,
}

/// Buffers kept between questions.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    points: Coordinates,
    block: Box<Block>,
    projections: Projections,
    nearest: Nearest,
    planes: Planes,
    rays: Rays,
}

impl ViewSet {
    /// A group of views of one frame, at least one; they are kept in rig order.
    pub fn new(mut views: Vec<View>) -> ViewSet {
        views.sort_by_key(|view| view.observer().rig_index());
        let always_judge = views.iter().all(|view| view.observer().always_judges());
        let frusta: Vec<_> = views.iter().map(|view| view.frustum().cloned()).collect();
        // Other groups may hold the cameras that agree: alone this group needs none to.
        let hull_box = if always_judge {
            hull_box(&frusta, HullRule { min_views: 1, ..HullRule::default() })
        } else {
            Some(WorldBox::EVERYWHERE)
        };
        let rejecting = rejecting_order(&views);
        let depths_m = views.iter().map(|view| view.observer().settings().max_depth_m());
        let most_depth_m = (depths_m.fold(0.0, f64::max) as f32).next_up();
        ViewSet { views, path: VectorPath::best(), always_judge, hull_box, rejecting, most_depth_m }
    }

    /// The same, answering with these instructions if the processor has them.
    pub fn with_path(mut self, path: VectorPath) -> ViewSet {
        if path.is_available() {
            self.path = path;
        }
        self
    }

    /// The same, `frames` after another of the same cameras: planes tell how far they moved since.
    pub fn after(mut self, before: &ViewSet, frames: u64) -> ViewSet {
        let pairs = self.views.into_iter().map(|view| {
            let place = view.observer().rig_index();
            match before.views.iter().find(|before| before.observer().rig_index() == place) {
                Some(before) => view.after(before, frames),
                None => view,
            }
        });
        self.views = pairs.collect();
        self
    }

    /// The same of some cameras, by their places in the rig.
    pub fn only(&self, is_named: impl Fn(u16) -> bool) -> ViewSet {
        let named = self.views.iter().filter(|view| is_named(view.observer().rig_index()));
        ViewSet::new(named.cloned().collect()).with_path(self.path)
    }

    /// The instructions that it answers with.
    pub fn path(&self) -> VectorPath {
        self.path
    }

    /// The views in rig order.
    pub fn views(&self) -> &[View] {
        &self.views
    }

    /// Answers one round.
    pub fn answer(&self, question: &Question, scratch: &mut Scratch, answer: &mut Answer) {
        answer.restart(question.kind);
        self.answer_part(question, 0..question.batches.len(), scratch, answer);
    }

    on_path! {
        /// Appends the answers about some of the question's batches: several threads may share the work.
        pub fn answer_part(
            &self,
            question: &Question,
            batches: Range<usize>,
            scratch: &mut Scratch,
            answer: &mut Answer,
        ) => answer_part_inlined, answer_part_avx2, answer_part_avx512
    }

    #[inline(always)]
    fn answer_part_inlined(
        &self,
        question: &Question,
        batches: Range<usize>,
        scratch: &mut Scratch,
        answer: &mut Answer,
    ) {
        let mut first_point: usize = question.batches[..batches.start].iter().map(Batch::len).sum();
        for index in batches {
            let batch = &question.batches[index];
            let batch_question = BatchQuestion { question, index, first_point };
            first_point += batch.len();
            if question.kind == QuestionKind::Classes && self.rejects(batch) {
                let count = answer.standings.len() + batch.len();
                answer.standings.resize(count, Standing::OUTSIDE);
                continue;
            }
            let mut points = std::mem::take(&mut scratch.points);
            points.clear();
            question.append_world(batch, &mut points);
            match question.kind {
                QuestionKind::Classes => {
                    self.append_standings(&points, &mut scratch.block, &mut answer.standings);
                }
                QuestionKind::Edges | QuestionKind::Planes => {
                    scratch.planes.prepare(&self.views);
                    self.edges(&batch_question, &points, scratch, answer);
                }
                QuestionKind::Exits | QuestionKind::SharedExits => {
                    self.exits(&batch_question, &points, scratch, answer);
                }
            }
            scratch.points = points;
        }
    }

    /// True if every point of the batch is outside for a camera of this group.
    fn rejects(&self, batch: &Batch) -> bool {
        let Points::Body { shape, pose } = &batch.points else { return false };
        let pose = pose.moved(batch.offset_m);
        self.always_judge
            && self.rejects_body(
                &WorldBox::of_body(shape, &pose),
                &pose.position_m().into(),
                shape.radius_m(),
            )
    }

    /// True if every point of the body is outside for a camera of this group (paper §5).
    fn rejects_body(&self, bounds: &WorldBox, centre: &Point3<f64>, radius_m: f64) -> bool {
        let Some(hull_box) = &self.hull_box else { return true };
        !hull_box.meets(bounds)
            || self
                .views
                .iter()
                .filter_map(View::frustum)
                .any(|frustum| frustum.misses_ball(centre, radius_m))
    }

    on_path! {
        /// Appends what the group says of each point.
        pub fn standings(&self, points: &Coordinates, block: &mut Block, standings: &mut Vec<Standing>)
            => append_standings, standings_avx2, standings_avx512
    }

    #[inline(always)]
    fn append_standings(&self, points: &Coordinates, block: &mut Block, standings: &mut Vec<Standing>) {
        if !self.always_judge || points.len() < FEW {
            standings.extend((0..points.len()).map(|at| self.standing(&points.point(at))));
            return;
        }
        let first = standings.len();
        standings.resize(first + points.len(), Standing::OUTSIDE);
        let all = Standing::inside(self.views.len());
        for from in (0..points.len()).step_by(BLOCK) {
            block.keep_inside(points, from, &self.views, &self.rejecting, self.path);
            for &place in block.places() {
                standings[first + from + place as usize] = all;
            }
        }
    }

    #[inline(always)]
    fn standing(&self, point: &Point3<f64>) -> Standing {
        let mut count = 0;
        for &view in &self.rejecting {
            match self.views[view].classify(point) {
                Class::Outside => return Standing::OUTSIDE,
                Class::Inside => count += 1,
                Class::Unknown => {}
            }
        }
        Standing::inside(count)
    }
}

/// One batch of a question.
struct BatchQuestion<'a> {
    question: &'a Question,
    index: usize,
    first_point: usize,
}

impl BatchQuestion<'_> {
    #[inline(always)]
    fn reach(&self, at: usize) -> f32 {
        self.question.within.get(self.first_point + at).map_or(f32::INFINITY, |reach| reach.m())
    }

    /// The reaches of some points that follow one another.
    #[inline(always)]
    fn reaches(&self, from: usize, reaches_m: &mut [f32]) {
        let first = self.first_point + from;
        match self.question.within.get(first..first + reaches_m.len()) {
            Some(within) => within.iter().zip(reaches_m).for_each(|(within, m)| *m = within.m()),
            None => reaches_m.fill(f32::INFINITY),
        }
    }

    #[inline(always)]
    fn direction(&self, at: usize) -> [f32; 3] {
        let shared = self.question.kind == QuestionKind::SharedExits;
        self.question.directions[if shared { self.index } else { self.first_point + at }]
    }

    /// The camera that is worth trying first.
    #[inline(always)]
    fn hint(&self, at: usize) -> Option<u16> {
        self.question.hints.get(self.first_point + at).copied()
    }
}

/// An order in which neighbouring cameras, which reject the same points, come late. It decides what is tested,
/// never what is found.
fn rejecting_order(views: &[View]) -> Vec<usize> {
    let forward = |view: &View| view.camera().rotation().row(2).transpose();
    let mut left: Vec<usize> = (0..views.len()).collect();
    let mut order: Vec<usize> = Vec::with_capacity(views.len());
    while !left.is_empty() {
        let across = |&view: &usize| {
            let sines =
                order.iter().map(|&before| forward(&views[view]).cross(&forward(&views[before])).norm());
            sines.fold(f64::INFINITY, f64::min)
        };
        let best = (0..left.len()).rev().max_by(|&a, &b| across(&left[a]).total_cmp(&across(&left[b])));
        order.push(left.remove(best.unwrap_or(0)));
    }
    order
}
