//! The views that one process holds at one frame, answering together. Cameras of a group spare each
//! other work: a camera is not searched farther than the best so far. The answers are those of the
//! single cameras merged, bit for bit.

use std::ops::Range;

use nalgebra::{Point3, Vector2, Vector3};

use crate::camera::Pixel;
use crate::cull::{WorldBox, hull_box};
use crate::probe::classify::{BLOCK, Block};
use crate::probe::edge_normal::sum_of_background;
use crate::probe::nearest_edge::nearest_edge;
use crate::question::{Answer, Batch, Change, Edge, Kind, NO_EXIT_M, Points, Question, Standing};
use crate::rule::HullRule;
use crate::view::{Class, View};

/// Cameras of one process at one instant.
#[derive(Clone, Debug)]
pub struct ViewSet {
    views: Vec<View>,
    always_judge: bool,
    hull_box: Option<WorldBox>,
    /// The views as they reject most: each looks as far across those before it as any left does.
    rejecting: Vec<usize>,
}

/// Buffers kept between questions.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    points: Vec<Point3<f64>>,
    block: Box<Block>,
}

/// A camera's edge before its normal is wanted.
struct Found {
    view: usize,
    edge: Edge,
    normalised: Vector2<f64>,
    from_start: Vector2<f64>,
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
        ViewSet { views, always_judge, hull_box, rejecting }
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

    /// Appends the answers about some of the question's batches: several threads may share the work.
    pub fn answer_part(
        &self,
        question: &Question,
        batches: Range<usize>,
        scratch: &mut Scratch,
        answer: &mut Answer,
    ) {
        let mut first_point: usize = question.batches[..batches.start].iter().map(Batch::len).sum();
        for index in batches {
            let batch = &question.batches[index];
            let asked = Asked { question, index, first_point };
            first_point += batch.len();
            if question.kind == Kind::Classes && self.rejects(batch) {
                let count = answer.standings.len() + batch.len();
                answer.standings.resize(count, Standing::OUTSIDE);
                continue;
            }
            scratch.points.clear();
            question.append_world(batch, &mut scratch.points);
            match question.kind {
                Kind::Classes => {
                    self.standings(&scratch.points, &mut scratch.block, &mut answer.standings);
                }
                Kind::Edges => self.edges(&asked, &scratch.points, answer),
                Kind::Exits | Kind::SharedExits => self.exits(&asked, &scratch.points, answer),
            }
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

    fn edges(&self, asked: &Asked, points: &[Point3<f64>], answer: &mut Answer) {
        let mut first = 0;
        for (at, point) in points.iter().enumerate() {
            let edge = self.edge(point, asked.reach(at), &mut first);
            answer.edges.push(edge);
        }
    }

    fn exits(&self, asked: &Asked, points: &[Point3<f64>], answer: &mut Answer) {
        let mut first = 0;
        for (at, point) in points.iter().enumerate() {
            let direction = Vector3::from(asked.direction(at).map(f64::from));
            let place = (asked.first_point + at) as u32;
            let exit_m =
                self.exit(point, &direction, asked.reach(at), &mut first, place, &mut answer.changes);
            answer.exits_m.push(exit_m);
        }
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

    /// Appends what the group says of each point.
    pub fn standings(&self, points: &[Point3<f64>], block: &mut Block, standings: &mut Vec<Standing>) {
        if !self.always_judge {
            standings.extend(points.iter().map(|point| self.standing(point)));
            return;
        }
        let first = standings.len();
        standings.resize(first + points.len(), Standing::OUTSIDE);
        let all = Standing::inside(self.views.len());
        for (index, chunk) in points.chunks(BLOCK).enumerate() {
            block.load(chunk, (first + index * BLOCK) as u32);
            for &view in &self.rejecting {
                block.keep_foreground(&self.views[view]);
            }
            for &place in block.places() {
                standings[place as usize] = all;
            }
        }
    }

    fn standing(&self, point: &Point3<f64>) -> Standing {
        let mut count = 0;
        for view in &self.views {
            match view.classify(point) {
                Class::Outside => return Standing::OUTSIDE,
                Class::Inside => count += 1,
                Class::Unknown => {}
            }
        }
        Standing::inside(count)
    }

    /// The nearest edge of the cameras that say inside (spec §3.1, §3.2), if it is within reach. `first` is
    /// the camera to begin with, best the last winner: it decides what is searched, never what is found.
    pub fn edge(&self, a: &Point3<f64>, reach_m: f32, first: &mut usize) -> Option<Edge> {
        let mut best: Option<Found> = None;
        let start = (*first).min(self.views.len() - 1);
        let others = (0..self.views.len()).filter(|&view| view != start);
        for view in std::iter::once(start).chain(others) {
            if let Some(found) = self.camera_edge(view, a, reach_m, best.as_ref().map(|best| best.edge)) {
                best = Some(found);
            }
        }
        let Found { view, mut edge, normalised, from_start } = best?;
        *first = view;
        let view = &self.views[view];
        let sum =
            sum_of_background(view.edge_candidates().map(), edge.pixel, view.observer().window_pixels());
        let m = if sum == Vector2::zeros() { from_start } else { sum };
        let normal = view.camera().hull_normal_world(&normalised, &m)?;
        edge.normal_world = [normal.x as f32, normal.y as f32, normal.z as f32];
        Some(edge)
    }

    /// One camera's edge, if it is within reach and beats `best`.
    fn camera_edge(&self, index: usize, a: &Point3<f64>, reach_m: f32, best: Option<Edge>) -> Option<Found> {
        let view = &self.views[index];
        let camera = view.camera();
        let a_camera = camera.camera_from_world(a);
        let image = camera.image_from_camera(&a_camera)?;
        let start = Pixel::holding(image.x, image.y);
        if view.class_at(Some(start)) != Class::Inside {
            return None;
        }
        let within_m = f64::from(best.map_or(reach_m, |best| best.distance_m));
        let limit = pixel_limit(&a_camera, within_m, view.observer().stretch_pixels());
        let pixel = nearest_edge(view.edge_candidates(), start, limit)?.pixel;
        let normalised = camera.normalised(&pixel.centre())?;
        let ray = Vector3::new(normalised.x, normalised.y, 1.0).normalize();
        let distance_m = a_camera.cross(&ray).norm() as f32;
        let rig_index = view.observer().rig_index();
        let wins = match best {
            None => distance_m <= reach_m,
            Some(best) => {
                distance_m < best.distance_m || distance_m == best.distance_m && rig_index < best.camera
            }
        };
        let from_start = (pixel.centre() - start.centre()).cast();
        let edge = Edge { distance_m, camera: rig_index, pixel, normal_world: [0.0; 3] };
        wins.then_some(Found { view: index, edge, normalised, from_start })
    }

    /// Where the ray from a point inside leaves, as far as this group knows and within reach (spec §3.3);
    /// what happens before goes to `changes`.
    fn exit(
        &self,
        a: &Point3<f64>,
        n: &Vector3<f64>,
        reach_m: f32,
        first: &mut usize,
        point: u32,
        changes: &mut Vec<Change>,
    ) -> f32 {
        let begin = changes.len();
        let mut exit_m = NO_EXIT_M;
        let start = (*first).min(self.views.len() - 1);
        let others = (0..self.views.len()).filter(|&view| view != start);
        for index in std::iter::once(start).chain(others) {
            let view = &self.views[index];
            let depth_m = view.observer().settings().max_depth_m();
            // A little more than the reach, so that rounding leaves nothing out.
            let limit_m = f64::from(exit_m.min(reach_m * 1.00001)).min(depth_m);
            let found_m = if self.always_judge {
                view.first_outside(a, n, limit_m).unwrap_or(NO_EXIT_M)
            } else {
                view.exit_with_silence(a, n, limit_m, point, changes)
            };
            if found_m < exit_m && found_m <= reach_m {
                exit_m = found_m;
                *first = index;
            }
        }
        if changes.len() > begin {
            changes[begin..].sort_by(|a, b| a.t_m.total_cmp(&b.t_m).then(a.by.cmp(&b.by)));
            let end = exit_m.min(reach_m.next_up());
            changes.truncate(begin + changes[begin..].partition_point(|change| change.t_m < end));
        }
        exit_m
    }
}

/// One batch of a question.
struct Asked<'a> {
    question: &'a Question,
    index: usize,
    first_point: usize,
}

impl Asked<'_> {
    fn reach(&self, at: usize) -> f32 {
        self.question.within.get(self.first_point + at).map_or(f32::INFINITY, |reach| reach.m())
    }

    fn direction(&self, at: usize) -> [f32; 3] {
        let shared = self.question.kind == Kind::SharedExits;
        self.question.directions[if shared { self.index } else { self.first_point + at }]
    }
}

/// An order in which neighbours, who reject the same points, come late. It decides what is tested, never
/// what is found.
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

/// The squared pixel distance beyond which no pixel's ray comes as near as `distance_m` to a point.
///
/// A ray that near meets a point `b` with `|a − b| ≤ distance`, at a depth of at least `z − distance`; its
/// projection is at most `distance · √(1 + x² + y²) / (z − distance)` away in normalised coordinates,
/// times the image's stretch, plus half a pixel's diagonal because the search starts from a centre.
fn pixel_limit(a_camera: &Vector3<f64>, distance_m: f64, stretch_pixels: f64) -> i64 {
    let distance_m = distance_m * (1.0 + 1e-6) + 1e-9;
    if distance_m == f64::INFINITY {
        return i64::MAX;
    }
    let depth_m = a_camera.z - distance_m;
    if depth_m <= 0.0 {
        return i64::MAX;
    }
    let slant = a_camera.norm() / a_camera.z;
    let pixels = stretch_pixels * distance_m * slant / depth_m + 0.7072;
    (pixels * pixels).min(1e12) as i64 + 1
}
