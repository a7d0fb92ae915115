//! Contacts of a body with the hull's surface, from the planes of a pass: where each sample is against the plane
//! of the surface nearest to it.

use nalgebra::{Point3, Vector3};

use crate::body::{Pose, Shape};
use crate::pass::{BodyResult, Touch};

/// Samples are asked about where they are and so far out along their faces' normals, metres: contacts exist before
/// bodies touch.
pub const FEELER_M: f64 = 0.01;
/// A plane farther away than this is none of the sample's, metres: a corner's feeler stands out by the root of three.
const FARTHEST_M: f64 = 1.8 * FEELER_M + 1e-3;
/// A surface faces a sample if its normal has at least this part against one of the sample's.
const FACING: f64 = 0.3;

/// Makes of the planes found for a body's samples, and after them for the feeler of each, the contacts of the samples:
/// touches with the plane's edge and the sample's depth below it as their exit, negative above it. A sample takes the
/// plane found where it is, or else its feeler's, and only surface that faces it. `faces` says which way the faces of a
/// sample look, body frame; `centres` are those of the rig's cameras, world.
pub fn contacts<'a>(
    planes: &BodyResult,
    shape: &Shape,
    pose: &Pose,
    faces: impl Fn(usize) -> &'a [Vector3<f64>],
    centres: &[Point3<f64>],
) -> BodyResult {
    let samples = shape.samples_body();
    let (world_from_body, rotation) = (pose.world_from_body(), pose.rotation());
    let split = planes.touches.partition_point(|touch| (touch.sample as usize) < samples.len());
    let (own, feelers) = planes.touches.split_at(split);
    let (mut own, mut feelers) = (own.iter().peekable(), feelers.iter().peekable());
    let contact = |(index, &sample): (usize, &[f32; 3])| {
        let at_sample = own.next_if(|touch| touch.sample as usize == index);
        let at_feeler = feelers.next_if(|touch| touch.sample as usize == index + samples.len());
        let touch = [at_sample, at_feeler].into_iter().flatten().find(|touch| touch.edge.is_some())?;
        let edge = touch.edge?;
        let normal = Vector3::from(edge.normal_world.map(f64::from));
        let depth_m = normal.dot(&(centres.get(usize::from(edge.camera))? - world_from_body(sample)));
        let is_facing = || faces(index).iter().any(|face| (rotation * face).dot(&normal) < -FACING);
        let is_contact = depth_m >= -FARTHEST_M && is_facing();
        is_contact.then_some(Touch { sample: index as u32, exit_m: Some(depth_m as f32), ..*touch })
    };
    BodyResult { touches: samples.iter().enumerate().filter_map(contact).collect(), ..BodyResult::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Pixel;
    use crate::question::Edge;

    /// A plane through a camera at (0, 0.5, 2) whose surface faces up.
    fn touch(sample: u32) -> Touch {
        let (pixel, normal_world) = (Pixel { column: 3, row: 4 }, [0.0, 1.0, 0.0]);
        let edge = Edge { distance_m: 0.01, camera: 1, pixel, normal_world };
        Touch { sample, inside_count: 3, edge: Some(edge), exit_m: None, speed_m_s: None }
    }

    #[test]
    fn samples_take_the_plane_that_faces_them_and_their_depth_below_it() {
        // Three samples of the lower side, the upper, and the lower again.
        let shape = Shape::new(vec![[0.0, -0.1, 0.0], [0.0, 0.1, 0.0], [0.1, -0.1, 0.0]]).expect("samples");
        let (down, up) = ([-Vector3::y()], [Vector3::y()]);
        let faces = |sample: usize| if sample == 1 { &up[..] } else { &down[..] };
        let centres = [Point3::origin(), Point3::new(0.0, 0.5, 2.0)];
        let found = |height_m: f64, touches: Vec<Touch>| {
            let pose = Pose::new([0.0, height_m, 0.0], [0.0, 0.0, 0.0, 1.0]).expect("a pose");
            let planes = BodyResult { touches, ..BodyResult::default() };
            let result = contacts(&planes, &shape, &pose, faces, &centres);
            result
                .touches
                .iter()
                .map(|touch| (touch.sample, touch.exit_m.expect("a depth")))
                .collect::<Vec<_>>()
        };
        // 2 mm deep, found at the samples themselves.
        let deep = found(0.598, vec![touch(0), touch(1), touch(2)]);
        assert!(matches!(deep[..], [(0, a), (2, b)] if (a - 0.002).abs() < 1e-6 && a == b), "{deep:?}");
        // 5 mm above, found by the feelers alone.
        let above = found(0.605, vec![touch(3), touch(4), touch(5)]);
        assert!(matches!(above[..], [(0, a), (2, _)] if (a + 0.005).abs() < 1e-6), "{above:?}");
        // Too far above, of a camera that is not there, without an edge.
        assert_eq!(found(0.7, vec![touch(3)]), []);
        let mut strange = touch(0);
        strange.edge = strange.edge.map(|edge| Edge { camera: 9, ..edge });
        assert_eq!(found(0.6, vec![strange, Touch { edge: None, ..touch(2) }]), []);
    }
}
