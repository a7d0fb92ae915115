//! Nearest edges of a group (spec §3.1, §3.2).
//!
//! Many points go through every stage together, camera by camera: searches do not wait for each other, and what
//! follows them is computed in vectors.

use nalgebra::{Point3, Vector3};

use super::beside::Beside;
use super::planes::Planes;
use super::projections::{CHUNK, Projection, Projections, SearchTarget};
use super::selection::Selection;
use super::{BatchQuestion, Scratch, ViewSet};
use crate::camera::Pixel;
use crate::coordinates::Coordinates;
use crate::probe::edge_line::EdgeLine;
use crate::probe::edge_normal::sum_of_background;
use crate::probe::edge_ray::{LANES, Lanes, distances, hull_normals, normalised};
use crate::probe::nearest_edge::nearest_edge;
use crate::question::{Answer, Edge, QuestionKind};
use crate::reach::Reach;
use crate::vector::VectorPath;
use crate::view::{SurfacePlane, View};

/// No view.
const NO_VIEW: u32 = u32::MAX;

/// The nearest edges of a chunk of points so far.
#[derive(Clone, Debug)]
pub(super) struct Nearest {
    /// Without an edge how far it may be, metres.
    distance_m: [f32; CHUNK],
    view: [u32; CHUNK],
    column: [i32; CHUNK],
    row: [i32; CHUNK],
    normalised: [[f64; CHUNK]; 2],
    normal_world: [[f32; 3]; CHUNK],
    /// Of a plane, in a frame; not a number where nothing tells.
    moved_m: [f32; CHUNK],
    is_from_outside: [bool; CHUNK],
    /// Of a plane from outside: the edge through which it goes.
    line: [EdgeLine; CHUNK],
    exit_within: [Reach; CHUNK],
    selection: Selection,
    found: EdgePixels,
    /// Of each view.
    beside: Vec<Beside>,
}

/// The edge pixels that the search of one view found.
#[derive(Clone, Debug, Default)]
struct EdgePixels {
    selection: Selection,
    column: [[i32; LANES]; CHUNK / LANES],
    row: [[i32; LANES]; CHUNK / LANES],
}

impl Default for Nearest {
    fn default() -> Nearest {
        Nearest {
            distance_m: [0.0; CHUNK],
            view: [NO_VIEW; CHUNK],
            column: [0; CHUNK],
            row: [0; CHUNK],
            normalised: [[0.0; CHUNK]; 2],
            normal_world: [[0.0; 3]; CHUNK],
            moved_m: [f32::NAN; CHUNK],
            is_from_outside: [false; CHUNK],
            line: [EdgeLine::NONE; CHUNK],
            exit_within: [Reach::UNBOUNDED; CHUNK],
            selection: Selection::default(),
            found: EdgePixels::default(),
            beside: Vec::new(),
        }
    }
}

impl ViewSet {
    /// Appends the edges of a batch.
    #[inline(always)]
    pub(super) fn edges(
        &self,
        batch: &BatchQuestion,
        points: &Coordinates,
        scratch: &mut Scratch,
        answer: &mut Answer,
    ) {
        // A bounded search is followed by one for exits.
        let is_of_planes = batch.question.kind == QuestionKind::Planes;
        let with_exits = self.always_judge && !is_of_planes && !batch.question.within.is_empty();
        for from in (0..points.len()).step_by(CHUNK) {
            let count = (points.len() - from).min(CHUNK);
            let Scratch { projections, nearest, planes, .. } = scratch;
            projections.project(&self.views, points, from, SearchTarget::PixelCentre, self.path);
            nearest.view = [NO_VIEW; CHUNK];
            batch.reaches(from, &mut nearest.distance_m[..count]);
            nearest.moved_m = [f32::NAN; CHUNK];
            nearest.is_from_outside = [false; CHUNK];
            if is_of_planes {
                nearest.look_from_outside(&self.views, projections, planes, points, from, self.path);
            }
            // First in the view that is likely to win: what it finds bounds the others' searches.
            let turns: &[bool] = if self.views.len() == 1 { &[true] } else { &[true, false] };
            for &is_first in turns {
                for (index, view) in self.views.iter().enumerate() {
                    let projection = projections.of(index);
                    nearest.selection.select(count, |at| {
                        let may_win = projection.clear_m[at] <= nearest.distance_m[at];
                        may_win
                            & !nearest.is_from_outside[at]
                            & ((projections.least_clear(at) == index) == is_first)
                    });
                    nearest.search(view, projection, self.path);
                    nearest.compare(view, index as u32, points, from);
                }
            }
            if is_of_planes && self.views.iter().any(View::tells_motion) {
                nearest.find_motions(&self.views, planes, points, from, self.path);
            }
            for (index, view) in self.views.iter().enumerate() {
                nearest
                    .selection
                    .select(count, |at| nearest.view[at] == index as u32 && !nearest.is_from_outside[at]);
                if is_of_planes {
                    nearest.find_planes(
                        view,
                        (index, planes),
                        projections.of(index),
                        points,
                        from,
                        self.path,
                    );
                } else {
                    nearest.find_normals(view, projections.of(index), self.path);
                }
                if with_exits {
                    nearest.find_exits(view, points, from);
                }
            }
            answer.edges.extend((0..count).map(|at| nearest.edge(at, &self.views)));
            if with_exits {
                let within = nearest.view[..count].iter().zip(nearest.exit_within);
                let or_unbounded = |(&view, within)| if view == NO_VIEW { Reach::UNBOUNDED } else { within };
                answer.exits_within.extend(within.map(or_unbounded));
            }
        }
    }
}

impl Nearest {
    /// Finds the picked points' pixels in a view.
    #[inline(always)]
    fn search(&mut self, view: &View, projection: &Projection, path: VectorPath) {
        let candidates = view.edge_candidates();
        self.found.selection.clear();
        for at in self.selection.iter() {
            let start = Pixel { column: projection.column[at], row: projection.row[at] };
            let limit_pixels = projection.pixels_within(at, self.distance_m[at]);
            let limit = (limit_pixels * limit_pixels).min(1e12) as i64 + 1;
            if let Some(found) = nearest_edge(candidates, start, limit, path) {
                self.found.push(at, found.pixel);
            }
        }
    }

    /// Keeps those of the found pixels that are nearer than what was found before. Ties go to the lower view.
    #[inline(always)]
    fn compare(&mut self, view: &View, index: u32, points: &Coordinates, from: usize) {
        let EdgePixels { selection, column, row } = &self.found;
        for (block, places) in selection.blocks() {
            let seen = normalised(view.camera(), view.coefficients(), &column[block], &row[block]);
            let of = |axis: &[f64]| -> Lanes { places.map(|at| axis[from + usize::from(at)]) };
            let points = [of(&points.x), of(&points.y), of(&points.z)];
            let distances_m = distances(view.coefficients(), &points, &seen);
            for lane in 0..LANES.min(selection.len() - block * LANES) {
                let (at, distance_m) = (usize::from(places[lane]), distances_m[lane]);
                let best_m = self.distance_m[at];
                if distance_m < best_m || distance_m == best_m && index < self.view[at] {
                    self.distance_m[at] = distance_m;
                    self.view[at] = index;
                    (self.column[at], self.row[at]) = (column[block][lane], row[block][lane]);
                    (self.normalised[0][at], self.normalised[1][at]) = (seen[0][lane], seen[1][lane]);
                }
            }
        }
    }

    /// Finds the normals of the picked points' edges, which are this view's.
    #[inline(always)]
    fn find_normals(&mut self, view: &View, projection: &Projection, path: VectorPath) {
        let (candidates, window) = (view.edge_candidates().map(), view.observer().window_pixels());
        for (block, places) in self.selection.blocks() {
            let (mut x, mut y) = ([0.0; LANES], [0.0; LANES]);
            let count = LANES.min(self.selection.len() - block * LANES);
            for lane in 0..count {
                let at = usize::from(places[lane]);
                let pixel = Pixel { column: self.column[at], row: self.row[at] };
                let sum = sum_of_background(candidates, pixel, window, path);
                (x[lane], y[lane]) = (sum.x, sum.y);
                if sum.x == 0.0 && sum.y == 0.0 {
                    x[lane] = f64::from(pixel.column - projection.column[at]);
                    y[lane] = f64::from(pixel.row - projection.row[at]);
                }
            }
            let seen = [0, 1].map(|axis| places.map(|at| self.normalised[axis][usize::from(at)]));
            let normals = hull_normals(view.coefficients(), &seen, &[x, y]);
            for lane in 0..count {
                self.normal_world[usize::from(places[lane])] = normals[lane];
            }
        }
    }

    /// Finds the planes of the picked points' edges, which are this view's.
    #[inline(always)]
    fn find_planes(
        &mut self,
        view: &View,
        (index, planes): (usize, &mut Planes),
        projection: &Projection,
        points: &Coordinates,
        from: usize,
        path: VectorPath,
    ) {
        for at in self.selection.iter() {
            let edge = Pixel { column: self.column[at], row: self.row[at] };
            let start = Pixel { column: projection.column[at], row: projection.row[at] };
            let plane = planes.of(index, view, edge, start, path);
            self.normal_world[at] = plane.normal_world;
            if plane.has_normal() && view.tells_motion() {
                let point = points.point(from + at);
                self.moved_m[at] = planes.moved_m(index, view, edge, &plane, &point, path);
            }
        }
    }

    /// Finds how the planes from outside move.
    #[inline(always)]
    fn find_motions(
        &mut self,
        views: &[View],
        planes: &mut Planes,
        points: &Coordinates,
        from: usize,
        path: VectorPath,
    ) {
        self.selection.select((points.len() - from).min(CHUNK), |at| self.is_from_outside[at]);
        for at in self.selection.iter() {
            let index = self.view[at] as usize;
            let edge = Pixel { column: self.column[at], row: self.row[at] };
            let plane = SurfacePlane { normal_world: self.normal_world[at], line: self.line[at] };
            let point = points.point(from + at);
            self.moved_m[at] = planes.moved_m(index, &views[index], edge, &plane, &point, path);
        }
    }

    /// Keeps of the planes that views see beside points that they say are outside the ones that are farthest from these.
    /// Ties go to the lower view. First in the view that may have the farthest: then few others can.
    #[inline(always)]
    fn look_from_outside(
        &mut self,
        views: &[View],
        projections: &Projections,
        planes: &mut Planes,
        points: &Coordinates,
        from: usize,
        path: VectorPath,
    ) {
        let count = (points.len() - from).min(CHUNK);
        let first = self.bound_from_outside(views, projections, count, path);
        for is_first in [true, false] {
            for (index, view) in views.iter().enumerate() {
                let beside = &self.beside[index];
                self.selection.select(count, |at| {
                    let may_win = !self.is_from_outside[at] | (beside.most_m[at] >= -self.distance_m[at]);
                    (beside.most_m[at] >= 0.0) & may_win & ((first[at] == index as u32) == is_first)
                });
                let projection = projections.of(index);
                for place in 0..self.selection.len() {
                    let at = self.selection.place(place);
                    let point = points.point(from + at);
                    self.search_from_outside((index, view), projection, planes, (at, &point), path);
                }
            }
        }
    }

    /// Bounds how far the planes of all views may be from points, and says for each which view's may be farthest.
    #[inline(always)]
    fn bound_from_outside(
        &mut self,
        views: &[View],
        projections: &Projections,
        count: usize,
        path: VectorPath,
    ) -> [u32; CHUNK] {
        self.beside.resize(views.len(), Beside::default());
        let (mut farthest_m, mut first) = ([-1.0; CHUNK], [NO_VIEW; CHUNK]);
        for (index, (beside, view)) in self.beside.iter_mut().zip(views).enumerate() {
            beside.bound(view, projections.of(index), &self.distance_m, count, path);
            for at in 0..CHUNK {
                let is_farther = beside.most_m[at] > farthest_m[at];
                farthest_m[at] = if is_farther { beside.most_m[at] } else { farthest_m[at] };
                first[at] = if is_farther { index as u32 } else { first[at] };
            }
        }
        first
    }

    /// Keeps the plane that a view sees beside a point, if it is farther than what was found before.
    #[inline(always)]
    fn search_from_outside(
        &mut self,
        (index, view): (usize, &View),
        projection: &Projection,
        planes: &mut Planes,
        (at, point): (usize, &Point3<f64>),
        path: VectorPath,
    ) {
        let start = Pixel { column: projection.column[at], row: projection.row[at] };
        let beside = &self.beside[index];
        let limit = (beside.clear_squared[at], beside.limit_squared[at]);
        let Some((squared, found, edge)) = view.edge_beside(start, limit, path) else { return };
        let pixels = (squared as f32).sqrt() + beside.slack_pixels;
        if self.is_from_outside[at] && projection.metres_within(at, pixels) < -self.distance_m[at] {
            return;
        }
        let plane = planes.of(index, view, edge, found, path);
        if !plane.has_normal() {
            return;
        }
        let centre_world = view.camera().centre_world();
        let distance_m = Edge::distance_from_outside_m(plane.normal_world, &centre_world, point);
        let is_farther = distance_m < self.distance_m[at]
            || distance_m == self.distance_m[at] && (index as u32) < self.view[at];
        if !self.is_from_outside[at] || is_farther {
            self.distance_m[at] = distance_m;
            self.view[at] = index as u32;
            (self.column[at], self.row[at]) = (edge.column, edge.row);
            self.is_from_outside[at] = true;
            self.normal_world[at] = plane.normal_world;
            self.line[at] = plane.line;
        }
    }

    /// Finds how far the picked points' normals lead in this view.
    #[inline(always)]
    fn find_exits(&mut self, view: &View, points: &Coordinates, from: usize) {
        let most_m = view.observer().settings().max_depth_m();
        for at in self.selection.iter() {
            let n = Vector3::from(self.normal_world[at].map(f64::from));
            // Without a normal it is no edge.
            let has_normal = !n.x.is_nan();
            let exit_m = has_normal.then(|| view.crossing(&points.point(from + at), &n, most_m)).flatten();
            self.exit_within[at] = exit_m.map_or(Reach::UNBOUNDED, reach_of_exit);
        }
    }

    /// A point's edge, if there is one and it has a normal.
    #[inline(always)]
    fn edge(&self, at: usize, views: &[View]) -> Option<Edge> {
        let camera = views.get(self.view[at] as usize)?.observer().rig_index();
        let normal_world = self.normal_world[at];
        let pixel = Pixel { column: self.column[at], row: self.row[at] };
        let moved_m = Some(self.moved_m[at]).filter(|moved_m| !moved_m.is_nan());
        let edge = Edge { distance_m: self.distance_m[at], camera, pixel, normal_world, moved_m };
        (!normal_world[0].is_nan()).then_some(edge)
    }
}

/// A little longer, for the normal may be rounded on its way.
#[inline(always)]
fn reach_of_exit(exit_m: f64) -> Reach {
    Reach::covering(1.001 * exit_m + 1e-4)
}

impl EdgePixels {
    #[inline(always)]
    fn push(&mut self, at: usize, pixel: Pixel) {
        let (block, lane) = (self.selection.len() / LANES, self.selection.len() % LANES);
        self.column[block][lane] = pixel.column;
        self.row[block][lane] = pixel.row;
        self.selection.push(at);
    }
}
