//! Contacts of a body with the hull's surface, from the planes of a pass: where each sample is against the plane
//! of the surface nearest to it.

use nalgebra::Point3;

use crate::body::{Pose, Shape};
use crate::camera::Camera;
use crate::faces::FaceNormals;
use crate::pass::{BodyResult, Touch};

/// Samples are asked about where they are and so far out along their faces' normals, metres: contacts exist before
/// bodies touch.
pub const FEELER_M: f64 = 0.01;
/// A plane farther away than this is none of the sample's, metres: a corner's feeler stands out by the root of three.
const FARTHEST_M: f64 = 1.8 * FEELER_M + 1e-3;

/// Where a camera stands, and how fine its image is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Eye {
    /// The camera's centre, world.
    pub centre_world: Point3<f64>,
    /// The focal length across, pixels.
    pub focal_pixels: f64,
}

impl Eye {
    /// The eye of a camera.
    pub fn of(camera: &Camera) -> Eye {
        Eye { centre_world: camera.centre_world(), focal_pixels: camera.intrinsics()[(0, 0)] }
    }

    /// What a pixel is across at a point, metres.
    pub(crate) fn pixel_m(&self, at_world: &Point3<f64>) -> f64 {
        (at_world - self.centre_world).norm() / self.focal_pixels
    }
}

/// How deep a point lies below the plane of a touch, metres; `None` without an edge, or of a camera that is not there.
pub(crate) fn depth_m(touch: &Touch, at_world: &Point3<f64>, eyes: &[Eye]) -> Option<f64> {
    let eye = eyes.get(usize::from(touch.edge?.camera))?;
    Some(touch.normal_world().dot(&(eye.centre_world - at_world)))
}

/// Whether a plane at that depth is near its sample, and faces one of its faces.
pub(crate) fn is_near(touch: &Touch, depth_m: f64, pose: &Pose, faces: &FaceNormals) -> bool {
    depth_m >= -FARTHEST_M && faces.is_faced(touch.sample as usize, pose, &touch.normal_world())
}

/// Makes of the planes found for a body's samples, and after them for the feeler of each, the contacts of the samples:
/// touches with the plane's edge and the sample's depth below it as their exit, negative above it. A sample takes the
/// plane found where it is, or its feeler's where that alone is inside, and only surface that faces it. `eyes` are those of the rig's cameras.
pub fn contacts(
    planes: &BodyResult,
    shape: &Shape,
    pose: &Pose,
    faces: &FaceNormals,
    eyes: &[Eye],
) -> BodyResult {
    let samples = shape.samples_body();
    let world_from_body = pose.world_from_body();
    let split = planes.touches.partition_point(|touch| (touch.sample as usize) < samples.len());
    let (own, feelers) = planes.touches.split_at(split);
    let (mut own, mut feelers) = (own.iter().peekable(), feelers.iter().peekable());
    let contact = |(index, &sample): (usize, &[f32; 3])| {
        let at_sample = own.next_if(|touch| touch.sample as usize == index);
        let at_feeler = feelers.next_if(|touch| touch.sample as usize == index + samples.len());
        let touch = [at_sample, at_feeler].into_iter().flatten().find(|touch| touch.edge.is_some())?;
        let depth_m = depth_m(touch, &world_from_body(sample), eyes)?;
        let contact = Touch { sample: index as u32, exit_m: Some(depth_m as f32), ..*touch };
        is_near(&contact, depth_m, pose, faces).then_some(contact)
    };
    BodyResult { touches: samples.iter().enumerate().filter_map(contact).collect(), ..BodyResult::default() }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::camera::Pixel;
    use crate::question::Edge;

    /// A plane through a camera at (0, 0.5, 2) whose surface faces up.
    fn touch(sample: u32) -> Touch {
        let (pixel, normal_world) = (Pixel { column: 3, row: 4 }, [0.0, 1.0, 0.0]);
        let edge = Edge { distance_m: 0.01, camera: 1, pixel, normal_world, moved_m: None };
        Touch { edge: Some(edge), ..Touch::new(sample, 3) }
    }

    #[test]
    fn samples_take_the_plane_that_faces_them_and_their_depth_below_it() {
        // Three samples of the lower side, the upper, and the lower again.
        let shape = Shape::new(vec![[0.0, -0.1, 0.0], [0.0, 0.1, 0.0], [0.1, -0.1, 0.0]]).expect("samples");
        let mut faces = FaceNormals::default();
        [-Vector3::y(), Vector3::y(), -Vector3::y()].into_iter().for_each(|face| faces.push([face]));
        let centres = [Point3::origin(), Point3::new(0.0, 0.5, 2.0)];
        let eyes = centres.map(|centre_world| Eye { centre_world, focal_pixels: 500.0 });
        let found = |height_m: f64, touches: Vec<Touch>| {
            let pose = Pose::new([0.0, height_m, 0.0], [0.0, 0.0, 0.0, 1.0]).expect("a pose");
            let planes = BodyResult { touches, ..BodyResult::default() };
            let result = contacts(&planes, &shape, &pose, &faces, &eyes);
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
