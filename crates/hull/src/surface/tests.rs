//! Surfaces that rise below a box.

use nalgebra::{Point3, Vector3};

use super::*;
use crate::camera::Pixel;
use crate::question::Edge;

const FPS: f64 = 30.0;
/// Four samples on the lower side of a body.
const LOWER: [[f32; 3]; 4] = [[-0.1, -0.1, -0.1], [0.1, -0.1, -0.1], [-0.1, -0.1, 0.1], [0.1, -0.1, 0.1]];

/// A camera that sees a surface beside it, 3 m away; its planes lean as the surface rises.
fn eyes() -> [Eye; 1] {
    [Eye { centre_world: Point3::new(3.0, 0.998, 0.0), focal_pixels: 800.0 }]
}

fn shape() -> Shape {
    Shape::new(LOWER.to_vec()).expect("samples")
}

/// All look down.
fn faces() -> FaceNormals {
    let mut faces = FaceNormals::default();
    LOWER.iter().for_each(|_| faces.push([-Vector3::y()]));
    faces
}

fn pose(height_m: f64) -> Pose {
    Pose::new([0.0, height_m, 0.0], [0.0, 0.0, 0.0, 1.0]).expect("a pose")
}

/// Planes for every sample and its offset sample, of a surface at that height below the middle of the body that rises
/// so far in a frame.
fn planes(height_m: f64, moved_m: f64) -> BodyPlanes {
    let eye = eyes()[0].centre_world;
    let normal = Vector3::new(height_m - eye.y, eye.x, 0.0).normalize();
    let normal_world = [normal.x as f32, normal.y as f32, 0.0];
    let (pixel, moved_m) = (Pixel { column: 0, row: 0 }, Some(moved_m as f32));
    let edge = Edge { distance_m: 0.01, camera: 0, pixel, normal_world, moved_m };
    let plane = |sample| SamplePlane { sample, plane: Some(edge) };
    BodyPlanes { samples: (0..8).map(plane).collect(), around: vec![] }
}

fn age(frame: u64, frames: f64) -> FrameAge {
    FrameAge::new(frame, FPS, frames / FPS, HullTime::Newest)
}

#[test]
fn a_surface_that_rises_has_its_speed_and_goes_on_between_frames() {
    let shape = shape();
    let pose = pose(1.1);
    let mut surface = BodySurface::default();
    let mut see = |frame: u64, frames: f64, height_m: f64| {
        let at = age(frame, frames);
        let asked = surface.pose_to_ask(at, &pose, &shape);
        let body = &Sampled {
            shape: &shape,
            around: None,
            pose: &pose,
            velocity_m_s: Vector3::zeros(),
            faces: &faces(),
        };
        (asked, surface.contacts(at, &planes(height_m, 0.01), body, &eyes()).contacts)
    };
    let depth = |contacts: &[SurfaceContact]| f64::from(contacts[0].depth_m);
    // It rises by 1 cm a frame, to 2 mm below the box and on.
    let (_, first) = see(7, 7.0, 0.998);
    assert!((depth(&first) + 0.002).abs() < 1e-6);
    let (_, second) = see(8, 8.0, 1.008);
    assert!((depth(&second) - 0.008).abs() < 5e-4);
    assert!(second.iter().all(|contact| (contact.speed_m_s.expect("known") - 0.3).abs() < 0.02));
    // Half a frame later it has gone on by half of that, and the body is asked about as much lower.
    let (asked, third) = see(8, 8.5, 1.008);
    assert!((asked.pose.position_m()[1] - (1.1 - 0.005)).abs() < 2e-4, "{asked:?}");
    assert!((depth(&third) - 0.013).abs() < 5e-4);
    // A frame that stays is film that stands still.
    let (_, fourth) = see(8, 12.0, 1.008);
    assert!((depth(&fourth) - 0.008).abs() < 5e-4);
    assert!(fourth.iter().all(|contact| contact.speed_m_s == Some(0.0)));
}

#[test]
fn between_frames_a_surface_goes_from_where_it_was_to_where_it_is() {
    let (shape, pose) = (shape(), pose(1.1));
    let mut surface = BodySurface::default();
    // It rose by 1 cm, to 3 mm deep in the box: at the frame's own time bodies are where it was before.
    let mut depth_m = |frames: f64| {
        let at = FrameAge::new(8, FPS, frames / FPS, HullTime::Between);
        surface.pose_to_ask(at, &pose, &shape);
        let body = &Sampled {
            shape: &shape,
            around: None,
            pose: &pose,
            velocity_m_s: Vector3::zeros(),
            faces: &faces(),
        };
        f64::from(surface.contacts(at, &planes(1.003, 0.01), body, &eyes()).contacts[0].depth_m)
    };
    for (frames, expected_m) in
        [(8.0, -0.007), (8.25, -0.0045), (8.5, -0.002), (8.75, 0.0005), (9.0, 0.003), (9.25, 0.003)]
    {
        let found_m = depth_m(frames);
        assert!((found_m - expected_m).abs() < 3e-4, "{found_m} m at frame {frames}, expected {expected_m}");
    }
    // Film that stands still stands at its frame.
    assert!((depth_m(12.0) - 0.003).abs() < 3e-4);
}

#[test]
fn within_a_flat_face_surfaces_meet_with_opposite_normals() {
    let pose = pose(1.1);
    let mut flat = FaceNormals::default();
    LOWER.iter().for_each(|_| flat.push_flat(-Vector3::y()));
    let contact = |faces: &FaceNormals, lean_deg: f64| {
        // The side of something round, 2 mm deep, that moves out at 0.3 m/s.
        let (sine, cosine) = libm::sincos(lean_deg.to_radians());
        let normal = Vector3::new(sine, cosine, 0.0);
        let contact = SurfaceContact {
            sample: 0,
            camera: 0,
            normal_world: normal.map(|part| part as f32).into(),
            moved_m: None,
            depth_m: 0.0,
            speed_m_s: Some(0.3),
            slide_m_s: [0.0; 3],
        };
        against_face(&contact, 0.002, &pose, faces)
    };
    let normal = |contact: &SurfaceContact| Vector3::from(contact.normal_world);
    let met = contact(&flat, 30.0);
    assert!((normal(&met) - Vector3::y()).norm() < 1e-6);
    let cosine = libm::cosf(30.0_f32.to_radians());
    assert!((met.depth_m - 0.002 / cosine).abs() < 1e-6);
    assert!((met.speed_m_s.expect("a speed") - 0.3 / cosine).abs() < 1e-5);
    // Nearly opposite, nearly along, and where the face is no flat one, it is the hull's.
    for contact in [contact(&flat, 5.0), contact(&flat, 65.0), contact(&faces(), 30.0)] {
        assert_eq!(contact.depth_m, 0.002);
        assert!(normal(&contact).x > 0.08);
    }
}

#[test]
fn what_is_around_a_body_tells_how_its_surface_slides() {
    let (shape, pose) = (shape(), pose(1.1));
    // Five places on either side of what it stands on, which goes along x by 2 cm a frame.
    let places = [-0.04, -0.02, 0.0, 0.02, 0.04].map(|z| [[0.2, -0.12, z], [-0.2, -0.12, z]]);
    let around_shape = Shape::new(places.concat()).expect("points");
    let side = |sample: u32, moved_m: f64| {
        let sign = if sample.is_multiple_of(2) { 1.0 } else { -1.0 };
        let normal = Vector3::new(sign, 0.0, 0.0);
        let (pixel, moved_m) = (Pixel { column: 0, row: 0 }, Some((sign * moved_m) as f32));
        let normal_world = normal.map(|part| part as f32).into();
        let edge = Edge { distance_m: -0.01, camera: 1, pixel, normal_world, moved_m };
        SamplePlane { sample, plane: Some(edge) }
    };
    // A camera over the middle sees both sides as they are.
    let above = Eye { centre_world: Point3::new(0.0, 1.0, 3.0), focal_pixels: 800.0 };
    let eyes = [eyes()[0], above];
    let mut surface = BodySurface::default();
    let mut slides = |frame: u64, frames: f64, moved_m: f64| {
        let at = age(frame, frames);
        surface.pose_to_ask(at, &pose, &shape);
        let around = (0..10).map(|sample| side(sample, moved_m)).collect();
        let planes = BodyPlanes { around, ..planes(1.0, 0.0) };
        let body = &Sampled {
            shape: &shape,
            around: Some(&around_shape),
            pose: &pose,
            velocity_m_s: Vector3::zeros(),
            faces: &faces(),
        };
        let result = surface.contacts(at, &planes, body, &eyes);
        assert_eq!(result.contacts.len(), 4);
        result.contacts[0].slide_m_s
    };
    assert_eq!(slides(1, 1.0, 0.0), [0.0; 3]);
    for frame in 2..8 {
        slides(frame, frame as f64, 0.02);
    }
    let [x, y, z] = slides(8, 8.0, 0.02);
    assert!((x - 0.6).abs() < 0.02 && y.abs() < 0.01 && z.abs() < 0.02, "{x} {y} {z}");
    assert_eq!(slides(8, 12.0, 0.02), [0.0; 3], "film that stands still");
}

#[test]
fn a_body_that_comes_fast_is_asked_about_once_more_before_it_has_contacts() {
    let (shape, pose) = (shape(), pose(1.1));
    let mut surface = BodySurface::default();
    // In one frame the surface rose by 10 cm, to 5 cm deep in the box.
    let mut see = |frames: f64| {
        let at = age(7, frames);
        let asked = surface.pose_to_ask(at, &pose, &shape);
        let velocity_m_s = Vector3::zeros();
        let body = &Sampled { shape: &shape, around: None, pose: &pose, velocity_m_s, faces: &faces() };
        (asked, surface.contacts(at, &planes(1.05, 0.1), body, &eyes()).contacts)
    };
    let (asked, contacts) = see(7.0);
    assert_eq!((asked.back_m, contacts.len()), (None, 0));
    let (again, contacts) = see(7.25);
    assert_eq!(again.pose, asked.pose, "where it was found in the hull");
    let back_m = again.back_m.expect("a way back");
    assert!(back_m[1] > 0.15 && back_m[0].abs() < 0.05, "{back_m:?}");
    assert_eq!(contacts.len(), 4);
    for contact in &contacts {
        assert!(
            contact.depth_m > 0.05 && contact.speed_m_s.is_some_and(|speed_m_s| speed_m_s > 2.0),
            "{contact:?}"
        );
    }
    let (_, contacts) = see(7.5);
    assert_eq!(contacts.len(), 4, "it goes on");
}

#[test]
fn a_fast_body_waits_for_one_step_at_most_where_each_step_sees_a_frame_of_its_own() {
    let (shape, pose) = (shape(), pose(1.1));
    let mut surface = BodySurface::default();
    let mut see = |frame: u64| {
        let at = age(frame, frame as f64);
        let asked = surface.pose_to_ask(at, &pose, &shape);
        let velocity_m_s = Vector3::new(0.0, -4.0, 0.0);
        let body = &Sampled { shape: &shape, around: None, pose: &pose, velocity_m_s, faces: &faces() };
        (asked.back_m, surface.contacts(at, &planes(1.02, 0.1), body, &eyes()).contacts.len())
    };
    assert_eq!(see(7), (None, 0));
    assert_eq!(see(8), (None, 4));
    assert_eq!(see(9), (None, 4));
}

#[test]
fn a_body_is_asked_again_once_it_has_moved_against_the_surface_or_at_another_frame() {
    let shape = shape();
    let mut surface = BodySurface::default();
    let mut ask = |frame: u64, down_m: f64| {
        let pose = pose(1.1).moved([0.0, -down_m, 0.0]);
        1.1 - surface.pose_to_ask(age(frame, frame as f64), &pose, &shape).pose.position_m()[1]
    };
    let is = |found: f64, expected: f64| (found - expected).abs() < 1e-6;
    assert!(is(ask(3, 0.0), 0.0) && is(ask(3, 0.003), 0.0), "near enough");
    assert!(is(ask(3, 0.005), 0.005) && is(ask(3, 0.007), 0.005), "moved");
    assert!(is(ask(4, 0.007), 0.007), "another frame");
}

#[test]
fn a_surface_that_flickers_by_a_fraction_of_a_pixel_stands_still_to_the_bit() {
    let shape = shape();
    let pose = pose(1.1);
    let mut surface = BodySurface::default();
    let (mut first, mut before_m) = (Vec::new(), 1.0);
    for frame in 0..40 {
        let at = age(frame, frame as f64);
        surface.pose_to_ask(at, &pose, &shape);
        let body = &Sampled {
            shape: &shape,
            around: None,
            pose: &pose,
            velocity_m_s: Vector3::zeros(),
            faces: &faces(),
        };
        // A pixel is 3.75 mm there.
        let height_m = 1.0 + 0.0008 * f64::from((frame * 7 % 5) as i32 - 2) / 2.0;
        let contacts = surface.contacts(at, &planes(height_m, height_m - before_m), body, &eyes()).contacts;
        before_m = height_m;
        if frame == 0 {
            first.clone_from(&contacts);
        }
        assert_eq!(
            contacts.iter().map(|contact| contact.depth_m).collect::<Vec<_>>(),
            first.iter().map(|contact| contact.depth_m).collect::<Vec<_>>()
        );
    }
}
