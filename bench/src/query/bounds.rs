//! What each bounding volume saves (paper §4.1, §5): which stage rejects a sample first.

use hull::HullRule;
use hull::cull::{Frustum, WorldBox, hull_box};
use hull::question::Points;
use hull::view::Class;
use nalgebra::Point3;
use serde::Serialize;

use crate::loads::Studio;
use crate::passes::world_points;

/// Shares of all samples, 0 to 1, that each stage rejects of what those before it left; with `inside` they
/// sum to 1.
#[derive(Clone, Debug, Default, Serialize, PartialEq)]
pub struct BoundSavings {
    /// Name of the load: the points that were asked about.
    pub load: String,
    /// Number of samples.
    pub samples: usize,
    /// The body's box misses the box around the hull.
    pub body_box: f64,
    /// Some camera's frustum has a box that does not hold the sample.
    pub frustum_box: f64,
    /// Some camera sees the sample beside its silhouette's bounding rectangle: the frustum's planes.
    pub frustum_planes: f64,
    /// Some camera sees it on background.
    pub silhouette: f64,
    /// No stage rejects it.
    pub inside: f64,
}

impl BoundSavings {
    /// The shares of the stages in order, and last of what no stage rejects.
    pub fn shares(&self) -> [f64; 5] {
        [self.body_box, self.frustum_box, self.frustum_planes, self.silhouette, self.inside]
    }
}

/// The bounding volumes of a studio.
pub struct Bounds<'a> {
    studio: &'a Studio,
    hull: Option<WorldBox>,
    /// Of each camera, the box around its silhouette's frustum; `None` where it sees nothing.
    frusta: Vec<Option<WorldBox>>,
}

impl<'a> Bounds<'a> {
    /// Of a studio.
    pub fn new(studio: &'a Studio) -> Bounds<'a> {
        let alone = HullRule { min_views: 1, ..HullRule::default() };
        let box_of = |frustum: Option<&Frustum>| hull_box(&[frustum.cloned()], alone);
        let frusta = studio.views.views().iter().map(|view| box_of(view.frustum())).collect();
        Bounds { studio, hull: studio.hull_box(), frusta }
    }

    /// What the stages save on bodies.
    pub fn saved(&self, load: &str, bodies: &[Points]) -> BoundSavings {
        let mut counts = [0usize; 5];
        for body in bodies {
            let bounds = match body {
                Points::Body { shape, pose } => WorldBox::of_body(shape, pose),
                Points::World(_) => WorldBox::EVERYWHERE,
            };
            if !self.hull.is_some_and(|hull| hull.meets(&bounds)) {
                counts[0] += body.len();
                continue;
            }
            for point in world_points(body) {
                counts[self.stage(&point)] += 1;
            }
        }
        let samples: usize = counts.iter().sum();
        let [body_box, frustum_box, frustum_planes, silhouette, inside] =
            counts.map(|count| count as f64 / samples.max(1) as f64);
        BoundSavings {
            load: load.to_owned(),
            samples,
            body_box,
            frustum_box,
            frustum_planes,
            silhouette,
            inside,
        }
    }

    /// The stage after the body's that rejects a point.
    fn stage(&self, point: &Point3<f64>) -> usize {
        let place: [f64; 3] = (*point).into();
        let place = WorldBox { min: place, max: place };
        if self.frusta.iter().any(|frustum| !frustum.is_some_and(|frustum| frustum.meets(&place))) {
            return 1;
        }
        let beside = |camera: usize| {
            let pixel = self.studio.dense[camera].camera.pixel(point);
            !pixel.zip(self.studio.rects[camera]).is_some_and(|(pixel, rect)| {
                let (column, row) = (pixel.column as u32, pixel.row as u32);
                (rect.left..rect.right).contains(&column) && (rect.top..rect.bottom).contains(&row)
            })
        };
        if (0..self.studio.dense.len()).any(beside) {
            return 2;
        }
        let views = self.studio.views.views();
        if views.iter().any(|view| view.classify(point) == Class::Outside) { 3 } else { 4 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::loads::StudioPlan;
    use crate::passes::Passes;
    use crate::random::Random;

    #[test]
    fn stages_share_all_samples_and_leave_what_the_pass_finds_inside() {
        let studio = Studio::new(StudioPlan { cameras: 4, size: (160, 120), bent: true }).expect("a studio");
        let heap = studio.heap(&mut Random::new(5)).expect("boxes");
        let saved = Bounds::new(&studio).saved("heap", &heap);
        let parts = [saved.body_box, saved.frustum_box, saved.frustum_planes, saved.silhouette, saved.inside];
        assert!((parts.iter().sum::<f64>() - 1.0).abs() < 1e-9 && parts.iter().all(|&part| part >= 0.0));
        let mut asked = Passes::new(studio.settings, 1);
        let hull_box = studio.hull_box().expect("a person");
        asked.ask(&heap, std::slice::from_ref(&studio.views), &hull_box).expect("answers");
        let inside = asked.inside_count();
        assert_eq!((saved.inside * saved.samples as f64).round() as usize, inside);
        assert!(saved.body_box > 0.0 && inside > 0, "{saved:?}");
    }
}
