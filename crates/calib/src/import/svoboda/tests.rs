use super::*;
use hull::lens::Lens;
use hull::rotation::matrix_from_rodrigues;
use nalgebra::{Point2, Point3, Vector4};

const ZERO: ImportOptions =
    ImportOptions { up: None, scale: Some(1.0), size: Some((640, 480)), pixel_origin: Some(0.0) };

fn file(path: &str, text: impl Into<String>) -> TextFile {
    TextFile { path: path.to_owned(), text: text.into() }
}

fn k() -> Matrix3<f64> {
    Matrix3::new(900.0, 0.0, 330.0, 0.0, 905.0, 236.0, 0.0, 0.0, 1.0)
}

/// Three cameras on a ring, 4 units from the origin, that look at it.
fn matrices() -> Vec<Matrix3x4<f64>> {
    [0.0, 1.1, 2.4]
        .into_iter()
        .map(|angle| {
            let r = matrix_from_rodrigues(&Vector3::new(0.2, 0.0, 0.0))
                * matrix_from_rodrigues(&Vector3::new(0.0, angle, 0.0));
            let mut rt = Matrix3x4::zeros();
            rt.fixed_columns_mut::<3>(0).copy_from(&r);
            rt.set_column(3, &Vector3::new(0.02, -0.01, 4.0));
            k() * rt
        })
        .collect()
}

fn text(p: &Matrix3x4<f64>) -> String {
    p.row_iter().map(|r| format!("   {:e}   {:e}   {:e}   {:e}\n", r[0], r[1], r[2], r[3])).collect()
}

fn folder(matrices: &[Matrix3x4<f64>]) -> Vec<TextFile> {
    (1..).zip(matrices).map(|(number, p)| file(&format!("camera{number}.Pmat.cal"), text(p))).collect()
}

fn radial(k: &Matrix3<f64>, kc: [f64; 4]) -> String {
    let mut text = String::new();
    for row in 0..3 {
        for column in 0..3 {
            text += &format!("K{}{} = {:?}\n", row + 1, column + 1, k[(row, column)]);
        }
    }
    for (number, kc) in (1..).zip(kc) {
        text += &format!("{}kc{number} = {kc:?};\n", if number == 1 { "\n" } else { "" });
    }
    text
}

/// Pixels of the chain as the tool's documentation has it.
fn chain(p: &Matrix3x4<f64>, k: &Matrix3<f64>, kc: [f64; 4], point: &Point3<f64>) -> Point2<f64> {
    let image = p * Vector4::new(point.x, point.y, point.z, 1.0);
    let straight = k.try_inverse().expect("invertible") * (image / image.z);
    let (x, y) = Lens::new([kc[0], kc[1], kc[2], kc[3], 0.0]).distort(straight.x, straight.y);
    let bent = k * Vector3::new(x, y, 1.0);
    Point2::new(bent.x, bent.y)
}

const POINTS: [Point3<f64>; 3] =
    [Point3::new(0.3, 0.4, -0.2), Point3::new(-0.5, 0.1, 0.3), Point3::new(0.0, -0.6, 0.1)];

#[test]
fn the_chain_of_p_and_lens_is_kept_to_a_millionth_of_a_pixel() {
    let kc = [-0.25, 0.1, 1e-3, -5e-4];
    let mut files = folder(&matrices());
    for number in 1..=3 {
        files.push(file(&format!("basename{number}.rad"), radial(&k(), kc)));
    }
    let imported = from_svoboda(&files, &ZERO).expect("a rig");
    for (camera, p) in imported.rig.cameras().iter().zip(&matrices()) {
        for point in &POINTS {
            let found = camera.project(point).expect("in front");
            assert!((found - chain(p, &k(), kc, point)).norm() < 1e-6, "{found}");
        }
    }
}

#[test]
fn octave_headers_and_three_digit_exponents_are_read() {
    let plain = from_svoboda(&folder(&matrices()), &ZERO).expect("a rig").rig;
    let mut files = folder(&matrices());
    for file in &mut files {
        let numbers = file.text.replace("e-", "e-00").replace("e0", "e+000").replace("e2", "e+002");
        file.text =
            format!("# Created by Octave\n# name: Pmat\n# type: matrix\n# rows: 3\n# columns: 4\n{numbers}");
    }
    assert!(files[0].text.contains("e+002"), "{}", files[0].text);
    assert_eq!(from_svoboda(&files, &ZERO).expect("a rig").rig, plain);
}

#[test]
fn a_flipped_sign_of_p_changes_nothing() {
    let flipped: Vec<_> = (0..).zip(matrices()).map(|(i, p)| if i == 1 { -p * 3.0 } else { p }).collect();
    let (plain, flipped) =
        (from_svoboda(&folder(&matrices()), &ZERO), from_svoboda(&folder(&flipped), &ZERO));
    let (plain, flipped) = (plain.expect("a rig").rig, flipped.expect("a rig").rig);
    for (a, b) in plain.cameras().iter().zip(flipped.cameras()) {
        assert!((a.rotation() - b.rotation()).amax() < 1e-12);
        assert!((a.translation_m() - b.translation_m()).amax() < 1e-12);
    }
}

#[test]
fn a_mirrored_world_is_refused_with_the_reason() {
    let mirror = nalgebra::Matrix4::from_diagonal(&Vector4::new(1.0, 1.0, -1.0, 1.0));
    let mirrored: Vec<_> = matrices().iter().map(|p| p * mirror).collect();
    let error = from_svoboda(&folder(&mirrored), &ZERO).expect_err("refused").to_string();
    assert!(
        error.starts_with("camera1.Pmat.cal: found a mirrored world (the left 3 x 3 of P has det"),
        "{error}"
    );
    // The sign of P does not hide it.
    let hidden: Vec<_> = mirrored.iter().map(|p| -p).collect();
    assert!(matches!(from_svoboda(&folder(&hidden), &ZERO), Err(ImportError::Mirrored { .. })));
}

#[test]
fn names_and_sizes_come_from_the_files_beside() {
    let mut files = folder(&matrices());
    files.push(file("camera_order.txt", "east\nnorth\nwest\n"));
    files.push(file("Res.dat", "  640 480\n 1024   768\n640 480\n"));
    let options = ImportOptions { size: None, ..ZERO };
    let rig = from_svoboda(&files, &options).expect("a rig").rig;
    let found: Vec<_> = rig.cameras().iter().map(|c| (c.name(), c.width())).collect();
    assert_eq!(found, [("east", 640), ("north", 1024), ("west", 640)]);
    files.retain(|file| file.path != "Res.dat");
    let error = from_svoboda(&files, &options).expect_err("no size").to_string();
    assert!(error.starts_with("camera1.Pmat.cal: image size: found nothing, expected"), "{error}");
}

#[test]
fn names_and_lenses_of_some_cameras_alone_are_named() {
    let with = |name: &str, text: &str| {
        folder(&matrices()).into_iter().chain([file(name, text)]).collect::<Vec<_>>()
    };
    let error = from_svoboda(&with("camera_order.txt", "east\nnorth\n"), &ZERO).expect_err("few").to_string();
    assert!(
        error.starts_with("camera_order.txt: names: found 2 names, and camera 3, expected one"),
        "{error}"
    );
    let rig =
        from_svoboda(&with("camera_order.txt", "# ids\neast\nnorth\nwest\n"), &ZERO).expect("a rig").rig;
    assert_eq!(rig.cameras()[0].name(), "east");
    let imported =
        from_svoboda(&with("camera2.rad", &radial(&k(), [-0.2, 0.1, 0.0, 0.0])), &ZERO).expect("a rig");
    let said = "MultiCamSelfCal: found no .rad of camera 1, camera 3: lens coefficients taken as zero";
    assert!(imported.warnings.iter().any(|warning| warning == said), "{:?}", imported.warnings);
}

#[test]
fn a_failed_radial_fit_is_told() {
    let mut files = folder(&matrices());
    files.push(file("camera2.rad", radial(&FAILED, [0.0; 4])));
    let imported = from_svoboda(&files, &ZERO).expect("a rig");
    assert!(
        imported
            .warnings
            .iter()
            .any(|w| w.starts_with("camera2.rad: the radial fit of camera camera2 failed"))
    );
    assert!((imported.rig.cameras()[1].intrinsics() - k()).amax() < 1e-9, "P's own K stands");
}

#[test]
fn the_pixel_origin_is_one_by_default_and_moves_every_pixel() {
    let kc = [-0.25, 0.1, 0.0, 0.0];
    let mut files = folder(&matrices());
    files.push(file("camera1.rad", radial(&k(), kc)));
    let matlab = from_svoboda(&files, &ImportOptions { pixel_origin: None, ..ZERO }).expect("a rig");
    let found = matlab.rig.cameras()[0].project(&POINTS[0]).expect("in front");
    let expected = chain(&matrices()[0], &k(), kc, &POINTS[0]) - nalgebra::Vector2::new(1.0, 1.0);
    assert!((found - expected).norm() < 1e-6, "{found}");
    assert!(matlab.warnings.iter().any(|w| w.contains("pixel origin")), "{:?}", matlab.warnings);
    let told = from_svoboda(&files, &ZERO).expect("a rig");
    assert!(!told.warnings.iter().any(|w| w.contains("pixel origin")));
}

#[test]
fn broken_files_are_named() {
    let mut files = folder(&matrices());
    files.push(file("camera1.rad", "K11 = 900\nK12 = x\n"));
    let error = from_svoboda(&files, &ZERO).expect_err("refused").to_string();
    assert_eq!(error, "camera1.rad: K12: found \"x\", expected a number");
    let error = from_svoboda(&[file("camera1.Pmat.cal", "1 2 3")], &ZERO).expect_err("refused").to_string();
    assert_eq!(error, "camera1.Pmat.cal: P: found 3 numbers, expected twelve finite numbers, a 3 x 4 matrix");
    let error = from_svoboda(&[], &ZERO).expect_err("refused");
    assert!(matches!(error, ImportError::Unknown { .. }));
}

#[test]
fn files_of_two_calibrations_are_refused() {
    let both = |path: &str, text: &str| {
        let mut files = folder(&matrices());
        files.push(file(path, text));
        from_svoboda(&files, &ZERO).expect_err(path).to_string()
    };
    let more = text(&matrices()[0]);
    assert!(both("old/camera4.Pmat.cal", &more).contains("projection matrices in two folders"));
    let found = both("camera_order.txt", "1 2 3\n");
    assert!(found.contains("camera_order.txt: names: found \"1 2 3\", expected one name a line"), "{found}");
    let lens = radial(&k(), [0.1, 0.0, 0.0, 0.0]);
    let mut files = folder(&matrices());
    files.extend([file("a1.rad", &lens[..]), file("b1.rad", radial(&k(), [0.2, 0.0, 0.0, 0.0]))]);
    let found = from_svoboda(&files, &ZERO).expect_err("two lenses").to_string();
    assert!(found.contains("a1.rad and b1.rad: found two lenses of camera 1 that differ"), "{found}");
    assert!(both("a1.rad", &format!("{lens}kc1 = 0.5\n")).contains("kc1: found"));
    assert!(both("a1.rad", &format!("{lens}kc5 = 0.3\n")).contains("kc5: found 0.3, expected zero"));
    let mut files = folder(&matrices());
    files.extend(["b0.rad", "b1.rad", "b2.rad"].map(|path| file(path, &lens[..])));
    let found = from_svoboda(&files, &ZERO).expect_err("counted from 0").to_string();
    assert!(
        found.starts_with("b0.rad: number: found the lens of no camera, and none of camera 3"),
        "{found}"
    );
}
