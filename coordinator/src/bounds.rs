//! Where the hull of one frame can be: what lies elsewhere needs no question (paper §4.1 and §5).

use std::sync::Arc;

use hull::cull::{Frustum, WorldBox, hull_box};
use hull::{HullRule, Observer, Pose, Shape};

use crate::facts::FrameFacts;

/// Bounds of the hull of one frame, from what every camera told of it.
#[derive(Clone, Debug, Default)]
pub(crate) struct HullBounds {
    hull_box: Option<WorldBox>,
    /// Of the cameras that see or reject every point: what misses one of these is outside.
    frusta: Vec<Frustum>,
}

impl HullBounds {
    /// The bounds of a frame of which `facts` are known; `observers` are the whole rig's. A camera without
    /// facts bounds like one that rejects all it sees.
    pub fn of(facts: &[FrameFacts], observers: &[Arc<Observer>], rule: HullRule) -> HullBounds {
        let frustum = |observer: &Arc<Observer>| {
            let mut cameras = facts.iter().flat_map(|facts| &facts.cameras);
            let facts = cameras.find(|camera| camera.rig_index == observer.rig_index())?;
            facts.admitted.map(|rect| Frustum::of(observer.camera(), rect))
        };
        let frusta: Vec<Option<Frustum>> = observers.iter().map(frustum).collect();
        let hull_box = hull_box(&frusta, rule);
        let judging = frusta.into_iter().zip(observers).filter(|(_, observer)| observer.always_judges());
        HullBounds { hull_box, frusta: judging.filter_map(|(frustum, _)| frustum).collect() }
    }

    /// The box around the hull; `None` if nothing can be inside.
    pub fn hull_box(&self) -> Option<&WorldBox> {
        self.hull_box.as_ref()
    }

    /// False if no sample of the body can be inside the hull, for a certainty.
    pub fn may_meet(&self, shape: &Shape, pose: &Pose) -> bool {
        let Some(hull_box) = &self.hull_box else { return false };
        let centre_world = pose.position_m().into();
        hull_box.meets(&WorldBox::of_body(shape, pose))
            && !self.frusta.iter().any(|frustum| frustum.misses_ball(&centre_world, shape.radius_m()))
    }
}
