//! What one body did in a run, in a few figures.

use crate::rotation;
use hull::Pose;
use nalgebra::Vector3;

/// What one body did so far.
#[derive(Clone, Debug, PartialEq)]
pub struct BodySummary {
    /// The body's name.
    pub name: String,
    /// Where it was when it came.
    pub start: Pose,
    /// Where it is now.
    pub end: Pose,
    /// Straight from start to end, metres.
    pub moved_m: f64,
    /// The lengths of all responses that were applied, metres.
    pub hull_moved_m: f64,
    /// The end of the first step that had a response, a sample inside the hull or within a millimetre of it, seconds.
    pub first_touch_s: Option<f64>,
    /// The farthest it was from its start before that, metres.
    pub moved_before_touch_m: f64,
    /// The highest speed at the end of any step, m/s.
    pub max_speed_m_s: f64,
    /// The largest angle between up and the body's direction that pointed up at the start, degrees.
    pub max_tilt_deg: f64,
}

impl BodySummary {
    /// The summary of a body that has just been put down.
    pub(crate) fn new(name: &str, start: Pose) -> BodySummary {
        BodySummary {
            name: name.to_owned(),
            start,
            end: start,
            moved_m: 0.0,
            hull_moved_m: 0.0,
            first_touch_s: None,
            moved_before_touch_m: 0.0,
            max_speed_m_s: 0.0,
            max_tilt_deg: 0.0,
        }
    }

    /// Takes in the end of a step.
    pub(crate) fn add(&mut self, pose: Pose, speed_m_s: f64, up: Vector3<f64>) {
        self.end = pose;
        self.moved_m = (Vector3::from(pose.position_m()) - Vector3::from(self.start.position_m())).norm();
        if self.first_touch_s.is_none() {
            self.moved_before_touch_m = self.moved_before_touch_m.max(self.moved_m);
        }
        self.max_speed_m_s = self.max_speed_m_s.max(speed_m_s);
        let up_body = self.start.rotation().transpose() * up;
        self.max_tilt_deg = self.max_tilt_deg.max(rotation::angle_deg(pose.rotation() * up_body, up));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(position_m: [f64; 3], turn: nalgebra::UnitQuaternion<f64>) -> Pose {
        let q = turn.quaternion();
        Pose::new(position_m, [q.i, q.j, q.k, q.w]).expect("a pose")
    }

    #[test]
    fn tilt_is_measured_against_up_and_yaw_is_none() {
        let lying = rotation::about(Vector3::x(), 90f64.to_radians());
        let yawed = rotation::about(Vector3::y(), 1.0) * lying;
        let tilted = rotation::about(Vector3::x(), 30f64.to_radians()) * lying;
        let mut summary = BodySummary::new("b", pose([0.0; 3], lying));
        summary.add(pose([0.0; 3], yawed), 0.0, Vector3::y());
        assert!(summary.max_tilt_deg < 1e-9, "{}", summary.max_tilt_deg);
        summary.add(pose([0.0; 3], tilted), 0.0, Vector3::y());
        summary.add(pose([0.0; 3], lying), 0.0, Vector3::y());
        assert!((summary.max_tilt_deg - 30.0).abs() < 1e-9);
    }

    #[test]
    fn what_moves_before_a_touch_is_told_from_what_moves_after() {
        let still = nalgebra::UnitQuaternion::identity();
        let mut summary = BodySummary::new("b", pose([0.0; 3], still));
        summary.add(pose([0.0, 0.01, 0.0], still), 2.0, Vector3::y());
        summary.first_touch_s = Some(0.5);
        summary.add(pose([0.0, 0.5, 0.0], still), 1.0, Vector3::y());
        assert_eq!((summary.moved_before_touch_m, summary.moved_m, summary.max_speed_m_s), (0.01, 0.5, 2.0));
    }
}
