//! Nearest edges of a group (spec §3.1, §3.2).
//!
//! Many points go through every stage together, camera by camera: a search need not wait for the one before
//! it, and what is reckoned of what it found is reckoned in vectors.

use nalgebra::Vector3;

use super::picks::Picks;
use super::sights::{CHUNK, Sight, Sought};
use super::{Asked, Scratch, ViewSet};
use crate::camera::Pixel;
use crate::coordinates::Coordinates;
use crate::probe::edge_normal::sum_of_background;
use crate::probe::edge_ray::{LANES, Lanes, distances, hull_normals, normalised};
use crate::probe::nearest_edge::nearest_edge;
use crate::question::{Answer, Edge};
use crate::reach::Reach;
use crate::vector::VectorPath;
use crate::view::View;

/// No view.
const NOBODY: u32 = u32::MAX;

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
    exit_within: [Reach; CHUNK],
    picks: Picks,
    found: Found,
}

/// What the search of one view found.
#[derive(Clone, Debug, Default)]
struct Found {
    picks: Picks,
    column: [[i32; LANES]; CHUNK / LANES],
    row: [[i32; LANES]; CHUNK / LANES],
}

impl Default for Nearest {
    fn default() -> Nearest {
        Nearest {
            distance_m: [0.0; CHUNK],
            view: [NOBODY; CHUNK],
            column: [0; CHUNK],
            row: [0; CHUNK],
            normalised: [[0.0; CHUNK]; 2],
            normal_world: [[0.0; 3]; CHUNK],
            exit_within: [Reach::UNBOUNDED; CHUNK],
            picks: Picks::default(),
            found: Found::default(),
        }
    }
}

impl ViewSet {
    /// Appends the edges of a batch.
    #[inline(always)]
    pub(super) fn edges(
        &self,
        asked: &Asked,
        points: &Coordinates,
        scratch: &mut Scratch,
        answer: &mut Answer,
    ) {
        // Who bounds this search asks others for exits next.
        let tells_exits = self.always_judge && !asked.question.within.is_empty();
        for from in (0..points.len()).step_by(CHUNK) {
            let count = (points.len() - from).min(CHUNK);
            let Scratch { sights, nearest, .. } = scratch;
            sights.look(&self.views, points, from, Sought::Centre, self.path);
            nearest.view = [NOBODY; CHUNK];
            asked.reaches(from, &mut nearest.distance_m[..count]);
            // First in the view that is likely to win: what it finds bounds the others' searches.
            let turns: &[bool] = if self.views.len() == 1 { &[true] } else { &[true, false] };
            for &is_first in turns {
                for (index, view) in self.views.iter().enumerate() {
                    let sight = sights.of(index);
                    nearest.picks.take(count, |at| {
                        let may_win = sight.clear_m[at] <= nearest.distance_m[at];
                        may_win & ((sights.least_clear(at) == index) == is_first)
                    });
                    nearest.search(view, sight, self.path);
                    nearest.compare(view, index as u32, points, from);
                }
            }
            for (index, view) in self.views.iter().enumerate() {
                nearest.picks.take(count, |at| nearest.view[at] == index as u32);
                nearest.find_normals(view, sights.of(index), self.path);
                if tells_exits {
                    nearest.find_exits(view, points, from);
                }
            }
            answer.edges.extend((0..count).map(|at| nearest.edge(at, &self.views)));
            if tells_exits {
                let told = nearest.view[..count].iter().zip(nearest.exit_within);
                let or_unbounded = |(&view, within)| if view == NOBODY { Reach::UNBOUNDED } else { within };
                answer.exits_within.extend(told.map(or_unbounded));
            }
        }
    }
}

impl Nearest {
    /// Finds the picked points' pixels in a view.
    #[inline(always)]
    fn search(&mut self, view: &View, sight: &Sight, path: VectorPath) {
        let candidates = view.edge_candidates();
        self.found.picks.clear();
        for at in self.picks.iter() {
            let start = Pixel { column: sight.column[at], row: sight.row[at] };
            let limit_pixels = sight.pixels_within(at, self.distance_m[at]);
            let limit = (limit_pixels * limit_pixels).min(1e12) as i64 + 1;
            if let Some(found) = nearest_edge(candidates, start, limit, path) {
                self.found.push(at, found.pixel);
            }
        }
    }

    /// Keeps those of the found pixels that are nearer than what was found before. Ties go to the lower view.
    #[inline(always)]
    fn compare(&mut self, view: &View, index: u32, points: &Coordinates, from: usize) {
        let Found { picks, column, row } = &self.found;
        for (block, places) in picks.blocks() {
            let seen = normalised(view.camera(), view.coefficients(), &column[block], &row[block]);
            let of = |axis: &[f64]| -> Lanes { places.map(|at| axis[from + usize::from(at)]) };
            let points = [of(&points.x), of(&points.y), of(&points.z)];
            let distances_m = distances(view.coefficients(), &points, &seen);
            for lane in 0..LANES.min(picks.len() - block * LANES) {
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
    fn find_normals(&mut self, view: &View, sight: &Sight, path: VectorPath) {
        let (candidates, window) = (view.edge_candidates().map(), view.observer().window_pixels());
        for (block, places) in self.picks.blocks() {
            let (mut x, mut y) = ([0.0; LANES], [0.0; LANES]);
            let count = LANES.min(self.picks.len() - block * LANES);
            for lane in 0..count {
                let at = usize::from(places[lane]);
                let pixel = Pixel { column: self.column[at], row: self.row[at] };
                let sum = sum_of_background(candidates, pixel, window, path);
                (x[lane], y[lane]) = (sum.x, sum.y);
                if sum.x == 0.0 && sum.y == 0.0 {
                    x[lane] = f64::from(pixel.column - sight.column[at]);
                    y[lane] = f64::from(pixel.row - sight.row[at]);
                }
            }
            let seen = [0, 1].map(|axis| places.map(|at| self.normalised[axis][usize::from(at)]));
            let normals = hull_normals(view.coefficients(), &seen, &[x, y]);
            for lane in 0..count {
                self.normal_world[usize::from(places[lane])] = normals[lane];
            }
        }
    }

    /// Finds how far the picked points' normals lead in this view.
    #[inline(always)]
    fn find_exits(&mut self, view: &View, points: &Coordinates, from: usize) {
        let most_m = view.observer().settings().max_depth_m();
        for at in self.picks.iter() {
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
        let edge = Edge { distance_m: self.distance_m[at], camera, pixel, normal_world };
        (!normal_world[0].is_nan()).then_some(edge)
    }
}

/// A little longer, for the normal may be rounded on its way.
#[inline(always)]
fn reach_of_exit(exit_m: f64) -> Reach {
    Reach::covering(1.001 * exit_m + 1e-4)
}

impl Found {
    #[inline(always)]
    fn push(&mut self, at: usize, pixel: Pixel) {
        let (block, lane) = (self.picks.len() / LANES, self.picks.len() % LANES);
        self.column[block][lane] = pixel.column;
        self.row[block][lane] = pixel.row;
        self.picks.push(at);
    }
}
