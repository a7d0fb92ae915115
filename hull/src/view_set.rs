//! The views that one process holds at one frame, answering together. Cameras of a group spare each
//! other work: a camera is not searched farther than the best so far. The answers are those of the
//! single cameras merged, bit for bit.

use nalgebra::{Point3, Vector2, Vector3};

use crate::camera::Pixel;
use crate::cull::{WorldBox, hull_box};
use crate::probe::classify::{BLOCK, Block};
use crate::probe::edge_normal::sum_of_background;
use crate::probe::exit::Exit;
use crate::probe::nearest_edge::nearest_edge;
use crate::question::{Answer, Batch, Edge, Points, Question, Standing};
use crate::rule::HullRule;
use crate::view::{Class, View};

/// Up to here, squared pixels, looking at the whole square first costs less than the search.
const NEAR_SQUARED: i64 = 64 * 64;

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
    pub fn answer(&self, question: &Question, scratch: &mut Scratch) -> Answer {
        match question {
            Question::Classes(batches) => {
                let mut standings = Vec::with_capacity(question.len());
                for batch in batches {
                    self.classes(batch, scratch, &mut standings);
                }
                Answer::Classes(standings)
            }
            Question::Edges(batches) => {
                let mut edges = Vec::with_capacity(question.len());
                for batch in batches {
                    scratch.points.clear();
                    batch.append_world(&mut scratch.points);
                    let mut first = 0;
                    edges.extend(scratch.points.iter().map(|point| self.edge(point, &mut first)));
                }
                Answer::Edges(edges)
            }
            Question::Exits(batches) => {
                let mut exits = Vec::with_capacity(question.len());
                for (batch, directions) in batches {
                    scratch.points.clear();
                    batch.append_world(&mut scratch.points);
                    let mut first = 0;
                    for (index, point) in scratch.points.iter().enumerate() {
                        let direction = Vector3::from(directions.of(index).map(f64::from));
                        exits.push(self.exit(point, &direction, &mut first));
                    }
                }
                Answer::Exits(exits)
            }
        }
    }

    fn classes(&self, batch: &Batch, scratch: &mut Scratch, standings: &mut Vec<Standing>) {
        let first = standings.len();
        if let Points::Body { shape, pose } = &batch.points
            && self.always_judge
            && self.rejects_body(&WorldBox::of_body(shape, pose), &pose.position_m().into(), shape.radius_m())
        {
            standings.resize(first + batch.len(), Standing::OUTSIDE);
            return;
        }
        scratch.points.clear();
        batch.append_world(&mut scratch.points);
        self.standings(&scratch.points, &mut scratch.block, standings);
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

    /// The nearest edge of the cameras that say inside (spec §3.1, §3.2). `first` is the camera to begin
    /// with, best the last winner: it decides what is searched, never what is found.
    pub fn edge(&self, a: &Point3<f64>, first: &mut usize) -> Option<Edge> {
        let mut best: Option<Found> = None;
        let start = (*first).min(self.views.len() - 1);
        let others = (0..self.views.len()).filter(|&view| view != start);
        for view in std::iter::once(start).chain(others) {
            if let Some(found) = self.camera_edge(view, a, best.as_ref().map(|best| best.edge)) {
                best = Some(found);
            }
        }
        let Found { view, mut edge, normalised, from_start } = best?;
        *first = view;
        let view = &self.views[view];
        let sum = sum_of_background(view.edge_candidates(), edge.pixel, view.observer().window_pixels());
        let m = if sum == Vector2::zeros() { from_start } else { sum };
        let normal = view.camera().hull_normal_world(&normalised, &m)?;
        edge.normal_world = [normal.x as f32, normal.y as f32, normal.z as f32];
        Some(edge)
    }

    /// One camera's edge, if it beats `best`.
    fn camera_edge(&self, index: usize, a: &Point3<f64>, best: Option<Edge>) -> Option<Found> {
        let view = &self.views[index];
        let camera = view.camera();
        let a_camera = camera.camera_from_world(a);
        let image = camera.image_from_camera(&a_camera)?;
        let start = Pixel::holding(image.x, image.y);
        if view.class_at(Some(start)) != Class::Inside {
            return None;
        }
        let limit = best.map_or(i64::MAX, |best| {
            pixel_limit(&a_camera, f64::from(best.distance_m), view.observer().stretch_pixels())
        });
        // Deep inside, nothing is as near as the best so far: rows of words say so at once.
        if limit < NEAR_SQUARED {
            let reach = (limit as f64).sqrt() as i32;
            let corner = |sign| Pixel { column: start.column + sign * reach, row: start.row + sign * reach };
            if view.edge_candidates().all_ones(corner(-1), corner(1)) {
                return None;
            }
        }
        let pixel = nearest_edge(view.edge_candidates(), start, limit)?.pixel;
        let normalised = camera.normalised(&pixel.centre())?;
        let ray = Vector3::new(normalised.x, normalised.y, 1.0).normalize();
        let distance_m = a_camera.cross(&ray).norm() as f32;
        let rig_index = view.observer().rig_index();
        let wins = best.is_none_or(|best| {
            distance_m < best.distance_m || distance_m == best.distance_m && rig_index < best.camera
        });
        let from_start = (pixel.centre() - start.centre()).cast();
        let edge = Edge { distance_m, camera: rig_index, pixel, normal_world: [0.0; 3] };
        wins.then_some(Found { view: index, edge, normalised, from_start })
    }

    /// Where the ray from a point inside leaves, as far as this group knows (spec §3.3).
    pub fn exit(&self, a: &Point3<f64>, n: &Vector3<f64>, first: &mut usize) -> Exit {
        let mut exit = Exit::default();
        let start = (*first).min(self.views.len() - 1);
        let others = (0..self.views.len()).filter(|&view| view != start);
        for index in std::iter::once(start).chain(others) {
            let view = &self.views[index];
            let depth_m = view.observer().settings().max_depth_m();
            let limit_m = exit.outside_m.map_or(depth_m, f64::from);
            if !self.always_judge {
                view.exit_with_silence(a, n, limit_m, &mut exit);
            } else if let Some(t) = view.first_outside(a, n, limit_m)
                && exit.outside_m.is_none_or(|before| t < before)
            {
                exit.outside_m = Some(t);
                *first = index;
            }
        }
        if let Some(end) = exit.outside_m {
            exit.changes.retain(|&(t, _)| t < end);
        }
        exit.changes.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        exit
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
    let depth_m = a_camera.z - distance_m;
    if depth_m <= 0.0 {
        return i64::MAX;
    }
    let slant = a_camera.norm() / a_camera.z;
    let pixels = stretch_pixels * distance_m * slant / depth_m + 0.7072;
    (pixels * pixels).min(1e12) as i64 + 1
}
