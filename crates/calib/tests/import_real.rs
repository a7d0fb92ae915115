//! Imports of the recordings' own calibration files.

#![allow(clippy::disallowed_macros, reason = "a test says what it measured")]
#![allow(clippy::print_stdout, reason = "differences are the result")]

mod common;

use calib::import::{Axis, Format, ImportError, ImportOptions, detect, import};
use hull::{Camera, Rig};

/// The largest differences of K (pixels), lens, rotation matrix and translation (metres).
fn difference(a: &Camera, b: &Camera) -> [f64; 4] {
    let (one, other) = (a.lens().coefficients(), b.lens().coefficients());
    [
        (a.intrinsics() - b.intrinsics()).amax(),
        one.iter().zip(&other).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max),
        (a.rotation() - b.rotation()).amax(),
        (a.translation_m() - b.translation_m()).amax(),
    ]
}

#[track_caller]
fn check_same(found: &Rig, expected: &Rig, limits: [f64; 4]) {
    assert_eq!(found.cameras().len(), expected.cameras().len());
    for (a, b) in found.cameras().iter().zip(expected.cameras()) {
        assert_eq!((a.name(), a.width(), a.height()), (b.name(), b.width(), b.height()));
        let difference = difference(a, b);
        println!("{}: K, lens, R, t differ by {difference:?}", a.name());
        assert!(difference.iter().zip(&limits).all(|(found, limit)| found <= limit), "over {limits:?}");
    }
}

/// The world has z up, and the import was not told so.
fn check_only_up_is_named(warnings: &[String]) {
    let up = "the cameras stand upright with another axis up than y: is --up right?";
    assert!(warnings.len() == 1 && warnings[0].ends_with(up), "{warnings:?}");
}

#[test]
fn uu_horseman_s_opencv_folder_is_its_rig() {
    let Some(folder) = common::dataset("uu_horseman") else { return };
    let calibration = folder.join("calibration");
    assert_eq!(detect(&calibration).expect("known"), Format::OpenCv);
    let options = ImportOptions { scale: Some(0.001), size: Some((644, 486)), ..Default::default() };
    let imported = import(&calibration, None, &options).expect("a rig");
    check_only_up_is_named(&imported.warnings);
    let expected = common::rig(&folder.join("rig.toml"));
    // The files print nine digits.
    check_same(&imported.rig, &expected, [1e-6, 1e-9, 1e-8, 1e-8]);
    // One file alone is a rig of one.
    let one = import(&calibration.join("cam3/config.xml"), None, &options).expect("a rig");
    assert_eq!(one.rig.cameras()[0].clone().renamed("cam3"), imported.rig.cameras()[2]);
}

#[test]
fn uu_horseman_says_what_it_does_not_say() {
    let Some(folder) = common::dataset("uu_horseman") else { return };
    let calibration = folder.join("calibration");
    let options = ImportOptions { size: Some((644, 486)), ..Default::default() };
    let imported = import(&calibration, None, &options).expect("a rig");
    assert!(imported.warnings[0].contains("millimetres"), "{:?}", imported.warnings);
    let error = import(&calibration, None, &ImportOptions::default()).expect_err("no size").to_string();
    assert_eq!(
        error,
        "cam1/config.xml: image size: found nothing, expected a width and a height in pixels: give the size"
    );
    let lone = import(&calibration.join("cam1/intrinsics.xml"), None, &options).expect_err("no pose");
    assert!(matches!(lone, ImportError::Key { .. }), "{lone}");
}

#[test]
fn uu_horseman_turned_to_y_up_keeps_its_cameras_above_the_floor() {
    let Some(folder) = common::dataset("uu_horseman") else { return };
    let options = ImportOptions { up: Some(Axis::PlusZ), ..Default::default() };
    let turned = import(&folder.join("rig.toml"), None, &options).expect("a rig").rig;
    let as_is = import(&folder.join("rig.toml"), None, &ImportOptions::default()).expect("a rig").rig;
    assert_eq!(as_is, common::rig(&folder.join("rig.toml")), "reading never turns");
    for (turned, as_is) in turned.cameras().iter().zip(as_is.cameras()) {
        let (a, b) = (turned.centre_world(), as_is.centre_world());
        assert!((a - nalgebra::Point3::new(b.x, b.z, -b.y)).norm() < 1e-9 && a.y > 1.3);
    }
}

#[test]
fn pose2sim_s_qualisys_file_is_its_stock_rig_but_for_the_lens() {
    let Some(folder) = common::dataset("pose2sim_balance") else { return };
    let file = folder.join("calibration/Calib.qca.txt");
    assert_eq!(detect(&file).expect("known"), Format::Qualisys);
    let imported = import(&file, None, &ImportOptions::default()).expect("a rig");
    check_only_up_is_named(&imported.warnings);
    // The source's tool divided the lens coefficients by 64 as if they were pixels; we do not.
    let stock = common::rig(&folder.join("stock/rig.toml"));
    let undivided: Vec<Camera> = stock
        .cameras()
        .iter()
        .map(|c| {
            let lens = c.lens().coefficients().map(|k| k * 64.0);
            let size = (c.width(), c.height());
            Camera::new(c.name(), size, *c.intrinsics(), lens, *c.rotation_rad(), *c.translation_m())
                .expect("valid")
        })
        .collect();
    check_same(&imported.rig, &Rig::new(undivided).expect("a rig"), [1e-9, 1e-9, 1e-7, 1e-7]);
    // The refined rig has the same lenses and, within a degree or so, the same poses.
    let refined = common::rig(&folder.join("rig.toml"));
    for (found, refined) in imported.rig.cameras().iter().zip(refined.cameras()) {
        assert_eq!(found.lens(), refined.lens());
        assert!((found.centre_world() - refined.centre_world()).norm() < 0.05);
    }
}

#[test]
fn pose2sim_s_toml_files_are_read_as_they_are() {
    let Some(folder) = common::dataset("pose2sim_balance") else { return };
    for name in ["Calib_qualisys.toml", "Calib_scene.toml"] {
        let imported = import(&folder.join("calibration").join(name), None, &ImportOptions::default());
        assert_eq!(imported.expect("a rig").rig.cameras().len(), 4, "{name}");
    }
}
