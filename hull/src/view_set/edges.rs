//! Nearest edges of a group (spec §3.1, §3.2).

use nalgebra::{Point3, Vector2, Vector3};

use super::sights::{CHUNK, Sought};
use super::{Asked, Scratch, ViewSet};
use crate::camera::Pixel;
use crate::coordinates::Coordinates;
use crate::probe::edge_normal::sum_of_background;
use crate::probe::nearest_edge::nearest_edge;
use crate::question::{Answer, Edge};

/// Up to here, looking at the whole square first costs less than a search.
const BOX_PIXELS: f32 = 16.0;

/// A camera's edge before its normal is wanted.
struct Found {
    view: usize,
    edge: Edge,
    normalised: Vector2<f64>,
    from_start: Vector2<f64>,
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
        let mut last = 0;
        for from in (0..points.len()).step_by(CHUNK) {
            scratch.sights.look(&self.views, points, from, Sought::Centre, self.path);
            for at in from..points.len().min(from + CHUNK) {
                let edge = self.edge(&points.point(at), at - from, asked.reach(at), &mut last, scratch);
                answer.edges.push(edge);
            }
        }
    }

    /// The nearest edge of the cameras that say inside, if it is within reach. `last` is the last winner,
    /// worth beginning with: it decides what is searched, never what is found.
    #[inline(always)]
    fn edge(
        &self,
        a: &Point3<f64>,
        at: usize,
        reach_m: f32,
        last: &mut usize,
        scratch: &Scratch,
    ) -> Option<Edge> {
        let mut best: Option<Found> = None;
        let least = scratch.sights.least_clear(at);
        let clear_m = |view: usize| scratch.sights.of(view).clear_m[at];
        // The first edge found bounds all searches after it: bounded by one another they would have to wait
        // for one another.
        let mut within_m = reach_m;
        let begin = if clear_m(*last) <= clear_m(least) { *last } else { least };
        for order in 0..=self.views.len() {
            let view = if order == 0 { begin } else { order - 1 };
            if order > 0 && view == begin {
                continue;
            }
            let sight = scratch.sights.of(view);
            // Nor if the camera does not say inside.
            let may_win = sight.clear_m[at] <= within_m;
            if !may_win {
                continue;
            }
            let start = Pixel { column: sight.column[at], row: sight.row[at] };
            let limit_pixels = sight.pixels_within(at, within_m);
            let so_far = best.as_ref().map(|best| best.edge);
            if let Some(found) = self.camera_edge(view, a, start, limit_pixels, reach_m, so_far) {
                if best.is_none() {
                    within_m = found.edge.distance_m;
                }
                best = Some(found);
            }
        }
        let Found { view, mut edge, normalised, from_start } = best?;
        *last = view;
        let view = &self.views[view];
        let candidates = view.edge_candidates().map();
        let sum = sum_of_background(candidates, edge.pixel, view.observer().window_pixels());
        let m = if sum == Vector2::zeros() { from_start } else { sum };
        let normal = view.camera().hull_normal_world(&normalised, &m)?;
        edge.normal_world = [normal.x as f32, normal.y as f32, normal.z as f32];
        Some(edge)
    }

    /// One camera's edge, if it is within reach and beats `best`.
    #[inline(always)]
    fn camera_edge(
        &self,
        index: usize,
        a: &Point3<f64>,
        start: Pixel,
        limit_pixels: f32,
        reach_m: f32,
        best: Option<Edge>,
    ) -> Option<Found> {
        let view = &self.views[index];
        let candidates = view.edge_candidates();
        if limit_pixels < BOX_PIXELS {
            // Most cameras see nothing but foreground so near.
            let reach = limit_pixels as i32;
            let corner = |sign| Pixel { column: start.column + sign * reach, row: start.row + sign * reach };
            if candidates.map().all_ones(corner(-1), corner(1)) {
                return None;
            }
        }
        let limit = (limit_pixels * limit_pixels).min(1e12) as i64 + 1;
        let pixel = nearest_edge(candidates, start, limit, self.path)?.pixel;
        let camera = view.camera();
        let a_camera = camera.camera_from_world(a);
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
}
