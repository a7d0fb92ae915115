//! Where the hull of one frame can be: what lies elsewhere needs no question (paper §4.1 and §5).

use std::sync::Arc;

use hull::cull::{Frustum, WorldBox, hull_box};
use hull::{HullRule, Observer, Pose, Shape};

use film_time::FrameReport;

/// Bounds of the hull of one frame, from what every camera reported of it.
#[derive(Clone, Debug, Default)]
pub(crate) struct HullBounds {
    hull_box: Option<WorldBox>,
    /// Of the cameras that see or reject every point: what misses one of these is outside.
    frusta: Vec<Frustum>,
}

impl HullBounds {
    /// The bounds of a frame of which nodes reported; `observers` are the whole rig's. A camera without a report is as if it
    /// were not in the rig.
    pub fn of(reports: &[&FrameReport], observers: &[Arc<Observer>], rule: HullRule) -> HullBounds {
        let reported = |observer: &Arc<Observer>| {
            let mut cameras = reports.iter().flat_map(|report| &report.cameras);
            cameras.find(|camera| camera.rig_index == observer.rig_index()).map(|camera| camera.admitted)
        };
        let (there, frusta): (Vec<&Arc<Observer>>, Vec<Option<Frustum>>) = observers
            .iter()
            .filter_map(|observer| Some((observer, reported(observer)?)))
            .map(|(observer, admitted)| (observer, admitted.map(|rect| Frustum::of(observer.camera(), rect))))
            .unzip();
        let hull_box = hull_box(&frusta, rule);
        let judging = frusta.into_iter().zip(there).filter(|(_, observer)| observer.always_judges());
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::core::room::{self, SEEN, observers};
    use hull::ProbeSettings;
    use hull::silhouette::PixelRect;

    fn report(admitted: Option<PixelRect>) -> FrameReport {
        room::report(0, [0, 1], admitted)
    }

    fn may_meet(bounds: &HullBounds, position_m: [f64; 3]) -> bool {
        let shape = Shape::new(vec![[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]]).expect("a shape");
        bounds.may_meet(&shape, &Pose::new(position_m, [0.0, 0.0, 0.0, 1.0]).expect("a pose"))
    }

    #[test]
    fn what_misses_the_person_in_one_camera_needs_no_question() {
        let bounds = HullBounds::of(&[&report(Some(SEEN))], &observers(2), ProbeSettings::default().rule());
        for (position_m, expected) in [
            ([0.0, 0.0, 0.0], true),
            ([0.3, 0.0, 0.0], true),
            ([0.6, 0.0, 0.0], false),
            ([0.0, 0.0, 0.6], false),
            ([0.0, 5.0, 0.0], false),
        ] {
            assert_eq!(may_meet(&bounds, position_m), expected, "{position_m:?}");
        }
    }

    #[test]
    fn a_camera_without_a_report_is_as_if_it_were_not_there() {
        let mut first = report(Some(SEEN));
        first.cameras.truncate(1);
        let rule = HullRule { min_views: 1, ..ProbeSettings::default().rule() };
        let bounds = HullBounds::of(&[&first], &observers(2), rule);
        assert!(may_meet(&bounds, [0.0, 0.0, 0.6]), "the other would reject it");
        assert!(!may_meet(&bounds, [0.6, 0.0, 0.0]));
    }

    #[test]
    fn a_camera_that_rejects_all_it_sees_leaves_no_hull() {
        let bounds = HullBounds::of(&[&report(None)], &observers(2), ProbeSettings::default().rule());
        assert!(bounds.hull_box().is_none() && !may_meet(&bounds, [0.0; 3]));
        let unknown = HullBounds::of(&[], &observers(2), ProbeSettings::default().rule());
        assert!(!may_meet(&unknown, [0.0; 3]));
    }
}
