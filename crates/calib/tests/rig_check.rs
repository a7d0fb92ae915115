//! `rig check` on real silhouettes: the reference rigs fit, and a camera that was moved is named.

#![allow(clippy::disallowed_macros, reason = "a test says what it measured")]
#![allow(clippy::print_stdout, reason = "the table is the result")]

mod common;

use calib::check::{CheckReport, PreparedFrames};
use hull::rotation::matrix_from_rodrigues;
use hull::{Camera, Rig};
use nalgebra::Vector3;

const TURN_RAD: f64 = 1.5 * std::f64::consts::PI / 180.0;
const MOVE_M: f64 = 0.08;

/// The camera turned and moved in its own frame.
fn moved(camera: &Camera, turn_rad: Vector3<f64>, move_m: Vector3<f64>) -> Camera {
    let rotation = matrix_from_rodrigues(&turn_rad) * camera.rotation();
    let centre = camera.centre_world() + camera.rotation().tr_mul(&move_m);
    let (size, lens) = ((camera.width(), camera.height()), camera.lens().coefficients());
    let translation_m = -(rotation * centre.coords);
    Camera::from_matrices(camera.name(), size, *camera.intrinsics(), lens, &rotation, translation_m)
        .expect("still a camera")
}

fn print(what: &str, report: &CheckReport) {
    let name = report.moved.map_or("-", |index| report.cameras[index].camera.as_str());
    print!("{what:14} cost {:6.3}  names {name:6}", report.cost);
    for camera in &report.cameras {
        let refinement = &camera.refinement;
        let [right, down] = refinement.shift_px;
        print!(" | {:.3} refined to {:6.3} by {right:5.1} {down:5.1} px", camera.explained, refinement.cost);
    }
    println!();
}

/// Checks the reference rig of a dataset, then all its cameras moved one at a time.
fn check_dataset(name: &str) {
    let Some(folder) = common::dataset(name) else { return };
    let rig = common::rig(&folder.join("rig.toml"));
    let frames = common::silhouettes(&folder, &rig);
    assert_eq!(frames.len(), 10);
    let prepared = PreparedFrames::new(&frames).expect("frames");
    let reference = prepared.check(&rig).expect("fits");
    print("as it is", &reference);
    assert_eq!(reference.moved, None);
    for camera in &reference.cameras {
        assert!(camera.explained >= 0.93, "{camera:?}");
    }
    let across = [
        ("pan", Vector3::y() * TURN_RAD, Vector3::zeros()),
        ("tilt", Vector3::x() * TURN_RAD, Vector3::zeros()),
        ("right", Vector3::zeros(), Vector3::x() * MOVE_M),
        ("down", Vector3::zeros(), Vector3::y() * MOVE_M),
    ];
    let along = [
        ("roll", Vector3::z() * TURN_RAD, Vector3::zeros()),
        ("ahead", Vector3::zeros(), Vector3::z() * MOVE_M),
    ];
    let (mut named, mut noticed, mut named_along) = (0, 0, 0);
    for (index, camera) in rig.cameras().iter().enumerate() {
        for (case, (what, turn_rad, move_m)) in across.into_iter().chain(along).enumerate() {
            for sign in [1.0, -1.0] {
                let mut cameras = rig.cameras().to_vec();
                cameras[index] = moved(camera, turn_rad * sign, move_m * sign);
                let report = prepared.check(&Rig::new(cameras).expect("a rig")).expect("fits");
                print(&format!("{} {what} {sign:+}", camera.name()), &report);
                let right = usize::from(report.moved == Some(index));
                if case < across.len() {
                    named += right;
                } else {
                    named_along += right;
                    noticed += usize::from(report.cost > 1.1 * reference.cost);
                }
            }
        }
    }
    println!("{name}: {named} of 32 turned or moved across are named");
    println!("{name}: {noticed} of 16 rolled or moved along cost over a tenth more, {named_along} are named");
    assert!(named >= 29, "{named} of 32");
    assert!(noticed >= 12, "{noticed} of 16");
}

#[test]
fn uu_horseman_names_the_camera_that_was_moved() {
    check_dataset("uu_horseman");
}

#[test]
fn pose2sim_balance_names_the_camera_that_was_moved() {
    check_dataset("pose2sim_balance");
}
