//! What pictures promise, on the synthetic studio.

use std::sync::Arc;

use hull::{Class, HullRule, NormalWindow, Observer, OutOfView, ProbeSettings, Rig};
use nalgebra::Matrix3;
use sim::{Scene, World, WorldSettings};
use stage::{CameraStage, Joint, Motion, StageSettings, studio_rig, true_silhouette};

use super::mask::{mask, overlap};
use super::*;

/// The hull drawn into a camera.
fn hull_mask(views: &[View], camera: &Camera) -> Vec<u8> {
    mask(&HullTracer::new(views, Outline::Exact), views, camera)
}

const TIME_S: f64 = 2.0;

fn rig() -> Rig {
    studio_rig(8, (480, 360)).expect("a rig")
}

/// The person who waves, as the rig's cameras see him under a rule.
fn views(out_of_view: OutOfView) -> Vec<View> {
    let rule = HullRule { out_of_view, ..HullRule::default() };
    let probe = ProbeSettings::new(rule, NormalWindow::Auto, 1.0).expect("settings");
    let settings = StageSettings { motion: Motion::Wave, ..StageSettings::default() };
    let view = |(index, camera): (usize, &Camera)| {
        let silhouette = true_silhouette(&settings, camera, TIME_S).expect("a size");
        View::new(Arc::new(Observer::new(camera.clone(), index as u16, probe, None)), &silhouette)
    };
    rig().cameras().iter().enumerate().map(view).collect()
}

fn world(gravity_m_s2: [f64; 3]) -> World {
    let scene = Scene::from_toml(
        "picture",
        "[floor]\nheight = 0.0\n[[bodies]]\nname = \"box\"\nshape.box.size = [0.3, 0.3, 0.3]\n\
         place.at = [0.9, 0.15, 0.9]\nfixed = true\ncolor = [0.1, 0.2, 0.9]\n",
    );
    let scene = scene.and_then(|scene| scene.with_gravity(gravity_m_s2)).expect("a scene");
    World::new(&scene, WorldSettings::default()).expect("a world")
}

fn scene<'a>(views: &'a [View], world: &'a World, inside_world: &'a [Point3<f64>]) -> PictureScene<'a> {
    PictureScene { views, bodies: world.bodies(), inside_world, up: world.up().into(), floor_m: Some(0.0) }
}

fn camera(scene: &PictureScene, rig: &Rig) -> Camera {
    let shown = interest(scene.views, scene.bodies);
    overview_camera(rig, &shown, &scene.up, (240, 180)).expect("a size")
}

/// The picture's colour where a point of the world falls.
fn colour_at(picture: &RgbImage, camera: &Camera, point: &Point3<f64>) -> [u8; 3] {
    let pixel = camera.pixel(point).expect("in the picture");
    picture.get_pixel(pixel.column as u32, pixel.row as u32).0
}

fn is_clay([r, g, b]: [u8; 3]) -> bool {
    r > g && g > b
}

fn is_blue([r, g, b]: [u8; 3]) -> bool {
    b > 60 && b > 2 * r.max(1) && b > g
}

#[test]
fn the_hull_drawn_into_its_cameras_is_their_silhouettes() {
    for rule in [OutOfView::Outside, OutOfView::Abstain] {
        let views = views(rule);
        let found = overlaps(&views);
        assert_eq!(found.len(), 8);
        assert!(found.iter().all(|&overlap| overlap >= 0.97), "{rule:?}: {found:?}");
    }
}

#[test]
fn a_turned_camera_shows_in_the_overlap() {
    let mut views = views(OutOfView::Outside);
    let turned = {
        let camera = views[2].camera();
        let (sine, cosine) = (0.03, (1.0f64 - 0.03 * 0.03).sqrt());
        let pan = Matrix3::new(cosine, 0.0, sine, 0.0, 1.0, 0.0, -sine, 0.0, cosine);
        let (rotation, translation) = (pan * camera.rotation(), pan * camera.translation_m());
        let size = (camera.width(), camera.height());
        let k = *camera.intrinsics();
        Camera::from_matrices("turned", size, k, [0.0; 5], &rotation, translation).expect("a camera")
    };
    let settings = StageSettings { motion: Motion::Wave, ..StageSettings::default() };
    let silhouette = true_silhouette(&settings, &rig().cameras()[2], TIME_S).expect("a size");
    views[2] = View::new(Arc::new(Observer::new(turned, 2, ProbeSettings::default(), None)), &silhouette);
    let found = overlaps(&views);
    assert!(found[2] < 0.9, "{found:?}");
}

#[test]
fn a_mask_of_a_camera_outside_the_rig_holds_the_person() {
    let views = views(OutOfView::Outside);
    let world = world([0.0, -9.81, 0.0]);
    let camera = camera(&scene(&views, &world, &[]), &rig());
    let mask = hull_mask(&views, &camera);
    let settings = StageSettings { motion: Motion::Wave, ..StageSettings::default() };
    let own = CameraStage::new(&settings, &camera, 0).mask(TIME_S);
    let missed = own.iter().zip(&mask).filter(|(own, hull)| **own != 0 && **hull == 0).count();
    let area = own.iter().filter(|own| **own != 0).count();
    assert!(area > 1000 && missed * 30 < area, "{missed} of {area} pixels of the person are not in the hull");
}

#[test]
fn nothing_to_see_is_full_agreement() {
    let camera = rig().cameras()[0].clone();
    let nothing = hull::Silhouette::empty(camera.width(), camera.height()).expect("a size");
    let view = View::new(Arc::new(Observer::new(camera, 0, ProbeSettings::default(), None)), &nothing);
    let (mut mask, views) = (hull_mask(std::slice::from_ref(&view), view.camera()), [view]);
    assert_eq!(overlap(&mask, &views[0]), 1.0);
    mask[7] = 255;
    assert_eq!(overlap(&mask, &views[0]), 0.0);
}

#[test]
fn head_limbs_and_bodies_are_in_the_picture_in_their_colours() {
    let (rig, views) = (rig(), views(OutOfView::Outside));
    let world = world([0.0, -9.81, 0.0]);
    let scene = scene(&views, &world, &[]);
    let camera = camera(&scene, &rig);
    for other in rig.cameras() {
        assert!((other.centre_world() - camera.centre_world()).norm() > 0.3, "{}", other.name());
    }
    let picture = render(&scene, &camera);
    let joint = |joint| Motion::Wave.joint_world(joint, TIME_S);
    for name in [
        Joint::Head,
        Joint::RightHand,
        Joint::RightElbow,
        Joint::LeftElbow,
        Joint::LeftKnee,
        Joint::RightKnee,
        Joint::LeftAnkle,
        Joint::RightAnkle,
    ] {
        assert!(is_clay(colour_at(&picture, &camera, &joint(name))), "{name:?}");
    }
    let between = nalgebra::center(&joint(Joint::Head), &joint(Joint::RightHand));
    assert!(!is_clay(colour_at(&picture, &camera, &between)), "air between head and raised hand");
    let body = Point3::from(world.bodies()[0].pose.position_m());
    assert!(is_blue(colour_at(&picture, &camera, &body)));
    let clay = picture.pixels().filter(|pixel| is_clay(pixel.0)).count();
    assert!(clay > 1000, "{clay} pixels of person");
}

#[test]
fn samples_inside_the_hull_are_marked_through_it() {
    let (rig, views) = (rig(), views(OutOfView::Outside));
    let world = world([0.0, -9.81, 0.0]);
    let inside = [Motion::Wave.joint_world(Joint::Waist, TIME_S)];
    assert!(views.iter().all(|view| view.classify(&inside[0]) == Class::Inside));
    let scene = scene(&views, &world, &inside);
    let camera = camera(&scene, &rig);
    let [r, g, b] = colour_at(&render(&scene, &camera), &camera, &inside[0]);
    assert!(r > 200 && g > 180 && b < r / 2, "{r} {g} {b}");
}

#[test]
fn a_room_without_a_person_shows_its_bodies() {
    let world = world([0.0, -9.81, 0.0]);
    let scene = scene(&[], &world, &[]);
    let camera = camera(&scene, &rig());
    let body = Point3::from(world.bodies()[0].pose.position_m());
    assert!(is_blue(colour_at(&render(&scene, &camera), &camera, &body)));
}

#[test]
fn a_world_with_z_up_looks_the_same() {
    let views = views(OutOfView::Outside);
    let upright = world([0.0, -9.81, 0.0]);
    let scene_y = PictureScene { bodies: &[], ..scene(&views, &upright, &[]) };
    let picture_y = render(&scene_y, &camera(&scene_y, &rig()));
    // x, y, z of the one world are x, −z, y of the other.
    let turn = Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0);
    let settings = StageSettings { motion: Motion::Wave, ..StageSettings::default() };
    let mut cameras = Vec::new();
    let mut views_z = Vec::new();
    for (index, camera) in rig().cameras().iter().enumerate() {
        let silhouette = true_silhouette(&settings, camera, TIME_S).expect("a size");
        let rotation = camera.rotation() * turn.transpose();
        let (size, k) = ((camera.width(), camera.height()), *camera.intrinsics());
        let turned =
            Camera::from_matrices(camera.name(), size, k, [0.0; 5], &rotation, *camera.translation_m())
                .expect("a camera");
        let observer = Observer::new(turned.clone(), index as u16, ProbeSettings::default(), None);
        views_z.push(View::new(Arc::new(observer), &silhouette));
        cameras.push(turned);
    }
    let lying = world([0.0, 0.0, -9.81]);
    let scene_z = PictureScene { bodies: &[], ..scene(&views_z, &lying, &[]) };
    let rig_z = Rig::new(cameras).expect("a rig");
    let picture_z = render(&scene_z, &camera(&scene_z, &rig_z));
    let differs = |(a, b): &(&Rgb<u8>, &Rgb<u8>)| a.0.iter().zip(b.0).any(|(&a, b)| a.abs_diff(b) > 24);
    let different = picture_y.pixels().zip(picture_z.pixels()).filter(differs).count();
    assert!(different * 50 < 240 * 180, "{different} pixels differ");
}
