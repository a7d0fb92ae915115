use super::*;
use nalgebra::Point3;

fn file(path: &str, text: &str) -> TextFile {
    TextFile { path: path.to_owned(), text: text.to_owned() }
}

/// A camera at (0, 0, −2) m that looks along +z, turned a quarter about its axis, in millimetres.
const XML: &str = "<?xml version=\"1.0\"?>\n<opencv_storage>\n<CameraMatrix type_id=\"opencv-matrix\">\n\
    <rows>3</rows><cols>3</cols><dt>f</dt>\n<data>\n5.00e+02 0. 320. 0. 4.0e+002 240. 0. 0. 1.</data>\
    </CameraMatrix>\n<DistortionCoeffs type_id=\"opencv-matrix\"><rows>5</rows><cols>1</cols><dt>f</dt>\
    <data>-1.0e-01 0. 0. 0. 0.</data></DistortionCoeffs>\n<RotationValues type_id=\"opencv-matrix\">\
    <rows>3</rows><cols>1</cols><dt>f</dt><data>0. 0. 1.5707963267948966</data></RotationValues>\n\
    <TranslationValues type_id=\"opencv-matrix\"><rows>3</rows><cols>1</cols><dt>f</dt>\
    <data>0. 0. 2000.</data></TranslationValues>\n</opencv_storage>\n";

const YAML: &str = "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncameraMatrix: !!opencv-matrix\n   \
    rows: 3\n   cols: 3\n   dt: d\n   data: [ 500., 0., 320., 0., 400., 240., 0.,\n       0., 1. ]\n\
    distCoeffs: !!opencv-matrix\n   rows: 1\n   cols: 4\n   dt: d\n   data: [ -0.1, 0., 0., 0. ]\n\
    R: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 0., -1., 0., 1., 0., 0., 0., 0., 1. ]\n\
    T: !!opencv-matrix\n   rows: 3\n   cols: 1\n   dt: d\n   data: [ 0., 0., 2000. ]\n";

const MILLIMETRES: ImportOptions =
    ImportOptions { up: None, scale: Some(0.001), size: Some((640, 480)), pixel_origin: None };

#[test]
fn xml_and_yaml_project_a_point_to_the_pixel_worked_by_hand() {
    // (0.4, 0.2, 0) m: camera frame (−0.2, 0.4, 2), so x/z = −0.1, y/z = 0.2, r² = 0.05, bend 0.995.
    let point = Point3::new(0.4, 0.2, 0.0);
    let expected = nalgebra::Point2::new(320.0 - 500.0 * 0.0995, 240.0 + 400.0 * 0.199);
    for (path, text) in [("cam1/config.xml", XML), ("cam1.yml", YAML)] {
        let imported = from_opencv(&[file(path, text)], &MILLIMETRES).expect("a rig");
        let camera = &imported.rig.cameras()[0];
        assert_eq!((camera.name(), camera.width(), camera.height()), ("cam1", 640, 480));
        let found = camera.project(&point).expect("in front");
        assert!((found - expected).norm() < 1e-9, "{path}: {found}");
        assert_eq!(imported.warnings, [""; 0]);
    }
}

#[test]
fn folders_are_cameras_in_the_order_people_count() {
    let bare = "<opencv_storage><Corner_0>388 340</Corner_0></opencv_storage>";
    let files = [
        file("board.xml", bare),
        file("cam10/config.xml", XML),
        file("cam2/boardcorners.xml", bare),
        file("cam2/config.xml", XML),
    ];
    let imported = from_opencv(&files, &MILLIMETRES).expect("a rig");
    let names: Vec<&str> = imported.rig.cameras().iter().map(Camera::name).collect();
    assert_eq!(names, ["cam2", "cam10"]);
}

#[test]
fn matlab_s_pixel_origin_moves_the_principal_point() {
    let options = ImportOptions { pixel_origin: Some(1.0), ..MILLIMETRES };
    let imported = from_opencv(&[file("a.yml", YAML)], &options).expect("a rig");
    let k = imported.rig.cameras()[0].intrinsics();
    assert_eq!((k[(0, 2)], k[(1, 2)]), (319.0, 239.0));
}

#[track_caller]
fn check_refused(text: &str, options: &ImportOptions, message: &str) {
    let error = from_opencv(&[file("a.yml", text)], options).expect_err("refused").to_string();
    assert_eq!(error, message);
}

#[test]
fn what_is_missing_or_wrong_is_named() {
    let none = ImportOptions::default();
    check_refused(
        &YAML.replace("image_width", "image_breadth"),
        &none,
        "a.yml: image size: found nothing, expected a width and a height in pixels: give the size",
    );
    check_refused(
        &YAML.replace("640", "640.5"),
        &none,
        "a.yml: image_width: found [640.5], expected a width and a height in whole pixels",
    );
    check_refused(
        &YAML.replace("-0.1, 0., 0., 0.", "-0.1, 0., 0."),
        &none,
        "a.yml: distCoeffs: found 3 numbers for 1 x 4, \
         expected 4 or 5 numbers k1 k2 p1 p2 k3 (more only if they are zero)",
    );
    check_refused(
        &YAML.replace("T:", "where:"),
        &none,
        "a.yml: tvec (TranslationValues, T): found nothing, expected 3 numbers",
    );
    let mirrored = YAML.replace("0., -1., 0., 1.", "0., 1., 0., 1.");
    let error = from_opencv(&[file("a.yml", &mirrored)], &none).expect_err("refused");
    assert!(matches!(error, ImportError::Mirrored { .. }), "{error}");
}

#[test]
fn the_file_s_own_size_wins_with_a_warning() {
    let options = ImportOptions { size: Some((100, 100)), ..ImportOptions::default() };
    let imported = from_opencv(&[file("a.yml", YAML)], &options).expect("a rig");
    assert_eq!(imported.rig.cameras()[0].width(), 640);
    assert_eq!(imported.warnings, ["a.yml: says 640 x 480, the given size 100 x 100 is not used"]);
}
