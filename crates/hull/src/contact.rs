//! Contacts of a body with the hull's surface, from the planes of a pass: where each sample is against the plane
//! of the surface nearest to it.

use nalgebra::{Point3, Vector3};

use crate::body::{Pose, Shape};
use crate::camera::Camera;
use crate::faces::FaceNormals;
use crate::pass::BodyPlanes;
use crate::question::Edge;

/// How far the offset sample of a sample lies out along its faces' normals, metres: contacts exist before bodies touch.
pub const OFFSET_M: f64 = 0.01;
/// A plane farther away than this is none of the sample's, metres: a corner's offset sample is out by the root of three.
const FARTHEST_M: f64 = 1.8 * OFFSET_M + 1e-3;

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

/// A sample near the hull's surface, and the surface there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceContact {
    /// The sample's index in its body.
    pub sample: u32,
    /// The camera whose silhouette the surface is of, in the rig.
    pub camera: u16,
    /// The surface's outward normal, world, unit.
    pub normal_world: [f32; 3],
    /// How far that camera saw it move out since the frame before, metres, where that is known.
    pub moved_m: Option<f32>,
    /// How deep the sample is below the surface, along the normal, metres; negative above it.
    pub depth_m: f32,
    /// How fast the surface moves out along its normal, m/s, where the frame before tells.
    pub speed_m_s: Option<f32>,
    /// How fast it moves along itself, world, m/s; nothing where that is unknown.
    pub slide_m_s: [f32; 3],
}

impl SurfaceContact {
    /// A sample at a depth below a plane that is not known to move.
    fn of(sample: u32, plane: &Edge, depth_m: f64) -> SurfaceContact {
        SurfaceContact {
            sample,
            camera: plane.camera,
            normal_world: plane.normal_world,
            moved_m: plane.moved_m,
            depth_m: depth_m as f32,
            speed_m_s: None,
            slide_m_s: [0.0; 3],
        }
    }

    /// Whether the sample is inside the hull: it may be above the surface.
    pub fn is_inside(&self) -> bool {
        self.depth_m >= 0.0
    }

    /// The way to the surface, world, metres.
    pub fn way_out_m(&self) -> [f64; 3] {
        self.normal_world.map(|n| f64::from(n) * f64::from(self.depth_m))
    }

    pub(crate) fn normal(&self) -> Vector3<f64> {
        normal(&self.normal_world)
    }

    /// The same of a surface that stands still.
    pub(crate) fn at_rest(self) -> SurfaceContact {
        SurfaceContact { speed_m_s: Some(0.0), slide_m_s: [0.0; 3], ..self }
    }

    /// How deep the sample is where it is now; `None` if the camera is not there.
    pub(crate) fn depth_at_m(&self, at_world: &Point3<f64>, eyes: &[Eye]) -> Option<f64> {
        depth_m(self.camera, &self.normal(), at_world, eyes)
    }

    /// Whether at that depth the surface is near the sample, and faces one of its faces.
    pub(crate) fn is_near(&self, depth_m: f64, pose: &Pose, faces: &FaceNormals) -> bool {
        depth_m >= -FARTHEST_M && faces.is_faced(self.sample as usize, pose, &self.normal())
    }
}

/// The hull's surface near one body.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BodyContacts {
    /// Of its samples near the surface, ascending.
    pub contacts: Vec<SurfaceContact>,
    /// How fast the surface turns, world, rad/s; nothing where it is unknown.
    pub spin_rad_s: [f32; 3],
}

pub(crate) fn normal(normal_world: &[f32; 3]) -> Vector3<f64> {
    Vector3::from(normal_world.map(f64::from))
}

/// How deep a point lies below a plane that goes through a camera's centre, metres; `None` if the camera is not there.
pub(crate) fn depth_m(
    camera: u16,
    normal: &Vector3<f64>,
    at_world: &Point3<f64>,
    eyes: &[Eye],
) -> Option<f64> {
    let eye = eyes.get(usize::from(camera))?;
    Some(normal.dot(&(eye.centre_world - at_world)))
}

/// Makes of the planes found for a body's samples, and after them for the offset sample of each, the contacts of the
/// samples. A sample takes the plane found where it is, or that of its offset sample where this alone is inside, and only
/// surface that faces it. `eyes` are those of the rig's cameras.
pub fn contacts(
    planes: &BodyPlanes,
    shape: &Shape,
    pose: &Pose,
    faces: &FaceNormals,
    eyes: &[Eye],
) -> Vec<SurfaceContact> {
    let samples = shape.samples_body();
    let world_from_body = pose.world_from_body();
    let split = planes.samples.partition_point(|found| (found.sample as usize) < samples.len());
    let (own, offset) = planes.samples.split_at(split);
    let (mut own, mut offset) = (own.iter().peekable(), offset.iter().peekable());
    let contact = |(index, &sample): (usize, &[f32; 3])| {
        let at_sample = own.next_if(|found| found.sample as usize == index);
        let at_offset = offset.next_if(|found| found.sample as usize == index + samples.len());
        let plane = [at_sample, at_offset].into_iter().flatten().find_map(|found| found.plane)?;
        let depth_m = depth_m(plane.camera, &normal(&plane.normal_world), &world_from_body(sample), eyes)?;
        let contact = SurfaceContact::of(index as u32, &plane, depth_m);
        contact.is_near(depth_m, pose, faces).then_some(contact)
    };
    samples.iter().enumerate().filter_map(contact).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Pixel;
    use crate::pass::SamplePlane;

    /// A plane through a camera at (0, 0.5, 2) whose surface faces up.
    fn plane(sample: u32) -> SamplePlane {
        let (pixel, normal_world) = (Pixel { column: 3, row: 4 }, [0.0, 1.0, 0.0]);
        let edge = Edge { distance_m: 0.01, camera: 1, pixel, normal_world, moved_m: None };
        SamplePlane { sample, plane: Some(edge) }
    }

    #[test]
    fn samples_take_the_plane_that_faces_them_and_their_depth_below_it() {
        // Three samples of the lower side, the upper, and the lower again.
        let shape = Shape::new(vec![[0.0, -0.1, 0.0], [0.0, 0.1, 0.0], [0.1, -0.1, 0.0]]).expect("samples");
        let mut faces = FaceNormals::default();
        [-Vector3::y(), Vector3::y(), -Vector3::y()].into_iter().for_each(|face| faces.push([face]));
        let centres = [Point3::origin(), Point3::new(0.0, 0.5, 2.0)];
        let eyes = centres.map(|centre_world| Eye { centre_world, focal_pixels: 500.0 });
        let found = |height_m: f64, samples: Vec<SamplePlane>| {
            let pose = Pose::new([0.0, height_m, 0.0], [0.0, 0.0, 0.0, 1.0]).expect("a pose");
            let planes = BodyPlanes { samples, around: vec![] };
            let contacts = contacts(&planes, &shape, &pose, &faces, &eyes);
            contacts.iter().map(|contact| (contact.sample, contact.depth_m)).collect::<Vec<_>>()
        };
        // 2 mm deep, found at the samples themselves.
        let deep = found(0.598, vec![plane(0), plane(1), plane(2)]);
        assert!(matches!(deep[..], [(0, a), (2, b)] if (a - 0.002).abs() < 1e-6 && a == b), "{deep:?}");
        // 5 mm above, found by the offset samples alone.
        let above = found(0.605, vec![plane(3), plane(4), plane(5)]);
        assert!(matches!(above[..], [(0, a), (2, _)] if (a + 0.005).abs() < 1e-6), "{above:?}");
        // Too far above, of a camera that is not there, without an edge.
        assert_eq!(found(0.7, vec![plane(3)]), []);
        let mut unknown = plane(0);
        unknown.plane = unknown.plane.map(|plane| Edge { camera: 9, ..plane });
        assert_eq!(found(0.6, vec![unknown, SamplePlane { plane: None, ..plane(2) }]), []);
    }
}
