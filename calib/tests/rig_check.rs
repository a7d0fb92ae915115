//! `rig check` on real silhouettes: the reference rigs fit, and a camera that was moved is named.

mod common;

use calib::check::Prepared;
use hull::rotation::matrix_from_rodrigues;
use hull::{Camera, Rig};
use nalgebra::Vector3;

/// The camera turned and moved in its own frame.
fn moved(camera: &Camera, turn_rad: Vector3<f64>, move_m: Vector3<f64>) -> Camera {
    let rotation = matrix_from_rodrigues(&turn_rad) * camera.rotation();
    let centre = camera.centre_world() + camera.rotation().tr_mul(&move_m);
    let size = (camera.width(), camera.height());
    let lens = camera.lens().coefficients();
    Camera::from_matrices(
        camera.name(),
        size,
        *camera.intrinsics(),
        lens,
        &rotation,
        -(rotation * centre.coords),
    )
    .expect("still a camera")
}

#[test]
fn table() {
    let mut hits = 0;
    for set in ["uu_horseman", "pose2sim_balance"] {
        let Some(folder) = common::dataset(set) else { return };
        let rig = common::rig(&folder.join("rig.toml"));
        let start = std::time::Instant::now();
        let frames = common::silhouettes(&folder, &rig);
        println!("load {:.2?}", start.elapsed());
        let start = std::time::Instant::now();
        let prepared = Prepared::new(&frames).expect("frames");
        println!("prepare {:.2?}", start.elapsed());
        let print = |what: &str, report: &calib::check::CheckReport| {
            print!("{set} {what:22} cost {:7.3} ", report.cost);
            for camera in &report.cameras {
                let m = &camera.mend;
                print!(
                    "| {:.3} {:6.3} [{:6.1} {:6.1}] ",
                    camera.explained, m.cost, m.shift_px[0], m.shift_px[1]
                );
            }
            println!("-> {:?}", report.moved);
        };
        let start = std::time::Instant::now();
        let report = prepared.check(&rig).expect("fits");
        print("reference", &report);
        println!("check {:.2?}", start.elapsed());
        for index in 0..rig.cameras().len() {
            for (what, turn, shift) in [
                ("pan", Vector3::y() * 1.5f64.to_radians(), Vector3::zeros()),
                ("tilt", Vector3::x() * 1.5f64.to_radians(), Vector3::zeros()),
                ("x", Vector3::zeros(), Vector3::x() * 0.08),
                ("y", Vector3::zeros(), Vector3::y() * 0.08),
                ("roll", Vector3::z() * 1.5f64.to_radians(), Vector3::zeros()),
                ("z", Vector3::zeros(), Vector3::z() * 0.08),
            ] {
                for sign in [1.0, -1.0] {
                    let mut cameras = rig.cameras().to_vec();
                    cameras[index] = moved(&cameras[index], turn * sign, shift * sign);
                    let report = prepared.check(&Rig::new(cameras).expect("rig")).expect("fits");
                    print(&format!("cam {index} {what} {sign:+}"), &report);
                    if !["roll", "z"].contains(&what) {
                        hits += usize::from(report.moved == Some(index));
                    }
                }
            }
        }
    }
    println!("{hits} of 64");
}
