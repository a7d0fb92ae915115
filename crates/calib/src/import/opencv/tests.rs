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
        file("cam10/config.xml", &XML.replace("0. 0. 2000.", "900. 0. 2000.")),
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
         expected 1, 2, 4 or 5 numbers k1 k2 p1 p2 k3 (more only if they are zero)",
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

/// The camera of [`YAML`] elsewhere.
fn moved(x: &str) -> String {
    YAML.replace("[ 0., 0., 2000. ]", &format!("[ {x}, 0., 2000. ]"))
}

fn names(files: &[TextFile]) -> Vec<String> {
    let imported = from_opencv(files, &MILLIMETRES).expect("a rig");
    imported.rig.cameras().iter().map(|camera| camera.name().to_owned()).collect()
}

fn message(files: &[TextFile]) -> String {
    from_opencv(files, &MILLIMETRES).expect_err("refused").to_string()
}

#[test]
fn every_file_is_a_camera_whatever_points_its_name_has() {
    let four = |name: &str| -> Vec<TextFile> {
        (1..=4).map(|n| file(&name.replace('#', &n.to_string()), &moved(&n.to_string()))).collect()
    };
    assert_eq!(names(&four("room.cam#.yml")), ["room.cam1", "room.cam2", "room.cam3", "room.cam4"]);
    assert_eq!(names(&four("192.168.1.1#.yml")).len(), 4);
    assert_eq!(names(&four("cam#.YAML.gz")), ["cam1", "cam2", "cam3", "cam4"]);
    assert_eq!(names(&four("room/cam#.yml")), ["cam1", "cam2", "cam3", "cam4"]);
    assert_eq!(names(&four("room/cam#/config.xml")), ["cam1", "cam2", "cam3", "cam4"]);
    assert_eq!(names(&four("cam (#).yml")).len(), 4);
}

#[test]
fn two_versions_of_a_camera_are_a_conflict_that_names_both() {
    for (one, other) in [
        ("cam1.yml", "cam1.old.yml"),
        ("cam1.yml", "cam1.xml"),
        ("cam1.yml", "cam1 (copy).yml"),
        ("cam1.yml", "cam1_backup.yml"),
        ("cam1.yml", "CAM1.yml"),
        ("cam1.yml", "old/cam1.yml"),
        ("cam1/c.yml", "cam1_old/c.yml"),
    ] {
        let files = [file(one, &moved("1.")), file(other, &moved("2.")), file("cam2.yml", &moved("3."))];
        let found = message(&files);
        assert!(found.contains(one) && found.contains(other), "{found}");
        let same = [file(one, YAML), file(other, YAML)];
        let imported = from_opencv(&same, &MILLIMETRES).expect("the same camera");
        assert_eq!((imported.rig.cameras().len(), imported.warnings.len()), (1, 1), "{one} {other}");
    }
    let crowded =
        [file("cam1/a.yml", YAML), file("cam1/b.yml", &moved("2.")), file("cam2/a.yml", &moved("3."))];
    let found = message(&crowded);
    assert!(found.starts_with("cam1/a.yml and cam1/b.yml: found two cameras in a folder"), "{found}");
}

/// The lines of [`YAML`] before and from the rotation.
fn halves(x: &str) -> (String, String) {
    let text = moved(x);
    let at = text.find("R:").expect("a rotation");
    (text[..at].to_owned(), format!("%YAML:1.0\n{}", &text[at..]))
}

#[test]
fn halves_of_a_camera_are_joined_by_folder_and_name() {
    let ((k1, p1), (k2, p2)) = (halves("1."), halves("2."));
    for [a, b, c, d] in [
        ["cam1/intrinsics.yml", "cam1/extrinsics.yml", "cam2/intrinsics.yml", "cam2/extrinsics.yml"],
        ["cam1/a.yml", "cam1/b.yml", "cam2/a.yml", "cam2/b.yml"],
        ["cam1_intrinsics.yml", "cam1_extrinsics.yml", "cam2_intrinsics.yml", "cam2_extrinsics.yml"],
        ["intrinsics/cam1.yml", "extrinsics/cam1.yml", "intrinsics/cam2.yml", "extrinsics/cam2.yml"],
    ] {
        let files = [file(a, &k1), file(b, &p1), file(c, &k2), file(d, &p2)];
        assert_eq!(names(&files), ["cam1", "cam2"], "{a}");
    }
    let lone = [file("cam1/a.yml", &k1), file("cam1/b.yml", &p1), file("x.yml", &k2), file("y.yml", &p2)];
    let found = message(&lone);
    assert!(found.starts_with("x.yml and y.yml: found a camera matrix without a pose"), "{found}");
    let twice = [file("cam1/c.yml", YAML), file("cam1/i.yml", &k1.replace("500.", "501."))];
    let found = message(&twice);
    assert!(
        found.starts_with("cam1/c.yml and cam1/i.yml: found different values of cameraMatrix"),
        "{found}"
    );
    let half = [file("cam1.yml", YAML), file("cam2.yml", &p2)];
    let imported = from_opencv(&half, &MILLIMETRES).expect("a rig of one");
    assert_eq!(imported.warnings, ["cam2.yml: left out, it has no camera matrix"]);
}

#[test]
fn another_lens_model_is_refused_by_name() {
    for (key, found) in [
        ("fisheye_model: 1", "1"),
        ("distortion_model: equidistant", "equidistant"),
        ("distortion_type: KANNALA_BRANDT", "KANNALA_BRANDT"),
        ("camera_model: \"omni\"", "omni"),
        ("flags_text: \"+fisheye\"", "+fisheye"),
        ("xi: 0.8", "0.8"),
        ("lens:\n   model: fisheye", "fisheye"),
    ] {
        let expected = format!("found {found}, expected the pinhole");
        let refused = message(&[file("a.yml", &format!("{YAML}{key}\n"))]);
        assert!(refused.starts_with("a.yml: ") && refused.contains(&expected), "{key}: {refused}");
    }
    let xml = XML.replace("</opencv_storage>", "<fisheye_model>1</fisheye_model></opencv_storage>");
    assert!(message(&[file("a.xml", &xml)]).starts_with("a.xml: fisheye_model: found 1, "));
    for key in ["fisheye_model: 0", "distortion_model: plumb_bob", "flags: 16384", "calibration_time: \"x\""]
    {
        assert_eq!(names(&[file("a.yml", &format!("{YAML}{key}\n"))]), ["a"], "{key}");
    }
    let other = "%YAML 1.2\n---\n- services\nweb\n";
    let imported = from_opencv(&[file("a.yml", YAML), file("b.yml", other)], &MILLIMETRES).expect("a rig");
    assert_eq!(imported.warnings, ["left out: b.yml: line 4: found \"web\", expected key: value"]);
    let board = "%YAML:1.0\ntype: charuco\n";
    assert_eq!(names(&[file("a.yml", YAML), file("board.yml", board)]), ["a"]);
}

/// A pair in the keys of OpenCV's samples, renamed: K1 D1 K2 D2 R T, the second 0.1 m beside the first.
fn pair(rename: impl Fn(&str) -> String) -> String {
    let matrix = |key: &str, rows: usize, cols: usize, data: &str| {
        let key = rename(key);
        format!("{key}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ {data} ]\n")
    };
    [
        "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\n".to_owned(),
        matrix("K1", 3, 3, "500., 0., 320., 0., 500., 240., 0., 0., 1."),
        matrix("D1", 1, 5, "0.1, 0., 0., 0., 0."),
        matrix("K2", 3, 3, "600., 0., 320., 0., 600., 240., 0., 0., 1."),
        matrix("D2", 1, 5, "0.2, 0., 0., 0., 0."),
        matrix("R", 3, 3, "0., -1., 0., 1., 0., 0., 0., 0., 1."),
        matrix("T", 3, 1, "-0.1, 0., 0."),
        matrix("R1", 3, 3, "1., 0., 0., 0., 1., 0., 0., 0., 1."),
        matrix("R2", 3, 3, "1., 0., 0., 0., 1., 0., 0., 0., 1."),
        matrix("P1", 3, 4, "1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0."),
    ]
    .concat()
}

#[test]
fn a_stereo_file_is_two_cameras() {
    let spellings: [&dyn Fn(&str) -> String; 5] = [
        &str::to_owned,
        &|key| key.replace('K', "M"),
        &|key| key.replace('K', "cameraMatrix").replace('D', "distCoeffs"),
        &|key| match key {
            "R1" | "R2" => key.to_owned(),
            _ => key.replace('1', "_left").replace('2', "_right"),
        },
        &|key| match key {
            "K1" => "left_camera_matrix".to_owned(),
            "K2" => "right_camera_matrix".to_owned(),
            "D1" => "left_distortion_coefficients".to_owned(),
            "D2" => "right_distortion_coefficients".to_owned(),
            _ => key.to_owned(),
        },
    ];
    for rename in spellings {
        let text = pair(rename);
        let rig = from_opencv(&[file("stereo.yml", &text)], &ImportOptions::default()).expect("two").rig;
        let [first, second] = rig.cameras() else { panic!("{} cameras of {text}", rig.cameras().len()) };
        assert_eq!((first.intrinsics()[(0, 0)], second.intrinsics()[(0, 0)]), (500.0, 600.0));
        assert_eq!((first.lens().coefficients()[0], second.lens().coefficients()[0]), (0.1, 0.2));
        // OpenCV: x2 = R x1 + T, so the second stands at −Rᵀ T.
        assert_eq!(first.centre_world(), Point3::origin());
        assert!((second.centre_world() - Point3::new(0.0, -0.1, 0.0)).norm() < 1e-9);
    }
    let (intrinsics, extrinsics) = pair(str::to_owned)
        .split_once("R: ")
        .map(|(k, r)| (k.to_owned(), format!("%YAML:1.0\nR: {r}")))
        .expect("two parts");
    let two = [file("extrinsics.yml", &extrinsics), file("intrinsics.yml", &intrinsics)];
    assert_eq!(names(&two), ["camera1", "camera2"]);
}

#[test]
fn a_stereo_file_that_can_be_read_in_two_ways_is_refused_with_its_keys() {
    let colour = pair(|key| match key {
        "R1" | "R2" => key.to_owned(),
        _ => key.replace('1', "_rgb").replace('2', "_ir"),
    });
    assert!(
        message(&[file("s.yml", &colour)]).starts_with("s.yml: K_ir, K_rgb: found two cameras and one pose")
    );
    let mixed = pair(|key| if key == "K1" { "K".to_owned() } else { key.to_owned() });
    assert!(
        message(&[file("s.yml", &mixed)]).starts_with("s.yml: K, K2: found keys of one camera and of others")
    );
    let poseless = pair(|key| if key == "T" { "where".to_owned() } else { key.to_owned() });
    assert!(
        message(&[file("s.yml", &poseless)]).contains("T): found nothing"),
        "{}",
        message(&[file("s.yml", &poseless)])
    );
}

/// EasyMocap's pair of files, of cameras 01 and 02.
fn easymocap() -> [TextFile; 2] {
    let matrix = |key: &str, rows: usize, cols: usize, data: &str| {
        format!("{key}: !!opencv-matrix\n  rows: {rows}\n  cols: {cols}\n  dt: d\n  data: [{data}]\n")
    };
    let (mut intri, mut extri) =
        ("%YAML:1.0\n---\nnames:\n  - \"01\"\n  - \"02\"\n".to_owned(), String::new());
    for (camera, focal) in [("01", "500."), ("02", "600.")] {
        intri += &matrix(
            &format!("K_{camera}"),
            3,
            3,
            &format!("{focal}, 0., 320., 0., {focal}, 240., 0., 0., 1."),
        );
        intri += &matrix(&format!("dist_{camera}"), 1, 5, "0., 0., 0., 0., 0.");
        intri += &format!("H_{camera}: 480\nW_{camera}: 640\n");
        extri += &matrix(&format!("R_{camera}"), 3, 1, "0., 0., 1.5707963267948966");
        extri += &matrix(&format!("Rot_{camera}"), 3, 3, "0., -1., 0., 1., 0., 0., 0., 0., 1.");
        extri += &matrix(&format!("T_{camera}"), 3, 1, &format!("0., 0., {focal}"));
    }
    [file("extri.yml", &format!("%YAML:1.0\n---\n{extri}")), file("intri.yml", &intri)]
}

#[test]
fn easymocap_s_pair_of_files_is_read() {
    let imported =
        from_opencv(&easymocap(), &ImportOptions { scale: Some(0.01), ..Default::default() }).expect("a rig");
    let cameras = imported.rig.cameras();
    let found: Vec<_> = cameras.iter().map(|c| (c.name(), c.width(), c.translation_m().z)).collect();
    assert_eq!(found, [("01", 640, 5.0), ("02", 640, 6.0)]);
    assert_eq!(imported.warnings, [""; 0]);
    let [extri, intri] = easymocap();
    let other = file("extri.yml", &extri.text.replace("-1., 0., 1., 0.", "1., 0., -1., 0."));
    assert!(message(&[other, intri.clone()]).contains("found two different values"));
    let fewer = file("intri.yml", &intri.text.replace("K_02", "old"));
    let found = message(&[extri.clone(), fewer]);
    assert!(found.contains("T_02: found no camera matrix of camera 02"), "{found}");
    assert!(message(&[extri]).starts_with("extri.yml: camera_matrix"));
}

#[test]
fn cameras_in_maps_are_refused_by_name() {
    let indented: String = YAML.lines().skip(2).map(|line| format!("   {line}\n")).collect();
    let nested = format!("%YAML:1.0\n---\nnb_camera: 1\ncamera_0:\n{indented}");
    let found = message(&[file("calibrated_cameras_data.yml", &nested)]);
    assert!(
        found.starts_with("calibrated_cameras_data.yml: camera_0/cameraMatrix: found a camera in a map"),
        "{found}"
    );
}

#[test]
fn no_message_has_an_empty_path() {
    assert!(message(&[]).starts_with("no files: "), "{}", message(&[]));
}

/// A matrix in the form of OpenCV's YAML.
fn entry(key: &str, rows: usize, cols: usize, data: &str) -> String {
    format!("{key}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ {data} ]\n")
}

const K: &str = "510., 0., 320., 0., 510., 240., 0., 0., 1.";

#[test]
fn files_without_a_camera_are_named() {
    for text in [
        "%YAML:1.0\n---\n",
        "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\n",
        "%YAML:1.0\n---\nCamera.fx: 500.\nCamera.fy: 500.\n",
        &YAML
            .replace("cameraMatrix", "Kamera")
            .replace("dist", "Linse")
            .replace("R:", "A:")
            .replace("T:", "B:"),
    ] {
        let imported = from_opencv(&[file("cam1.yml", YAML), file("cam3.yml", text)], &MILLIMETRES);
        let warnings = imported.expect("a rig").warnings;
        assert_eq!(warnings, ["cam3.yml: left out, it has no key that describes a camera"], "{text}");
    }
}

#[test]
fn names_of_matrices_and_maps_that_speak_of_another_lens_are_refused() {
    let renamed = |from: &str, to: &str| YAML.replace(from, to);
    let stereo = |key: &str| format!("{}{key}", pair(str::to_owned));
    for text in [
        renamed("cameraMatrix", "K_fisheye").replace("distCoeffs", "D_fisheye"),
        renamed("cameraMatrix", "fisheye_K").replace("distCoeffs", "fisheye_D"),
        renamed("distCoeffs", "D_fisheye"),
        renamed("distCoeffs", "distCoeffs_equidistant"),
        renamed("distCoeffs", "fisheye_coeffs"),
        format!("{YAML}{}", entry("xi", 1, 1, "1.2")),
        format!("{YAML}xi: [ 1.2 ]\n"),
        stereo("xi1: 1.2\nxi2: 1.2\n"),
        stereo(&entry("xi_1", 1, 1, "1.2")),
        format!("{YAML}fisheye:\n   enabled: 1\n"),
        format!("{YAML}mirror_parameters:\n   xi: 1.2\n"),
        format!("{YAML}distortion_model:\n   equidistant\n"),
        format!("{YAML}distortion_model:\n   - equidistant\n"),
        format!("{YAML}method: fisheye\n"),
        format!("{YAML}k4: 0.3\n"),
    ] {
        let found = message(&[file("a.yml", &text)]);
        assert!(found.contains("expected the pinhole"), "{found}: {text}");
    }
    let xml = "<xi type_id=\"opencv-matrix\"><rows>1</rows><cols>1</cols><dt>d</dt><data>1.2</data></xi>";
    let xml = XML.replace("</opencv_storage>", &format!("{xml}</opencv_storage>"));
    assert!(message(&[file("a.xml", &xml)]).starts_with("a.xml: xi: found 1.2, "));
    for key in
        ["xi: [ 0. ]\n", "fisheye:\n   enabled: 0\n", "names:\n   - fisheye\n", &entry("xi", 1, 1, "0.")]
    {
        assert_eq!(names(&[file("a.yml", &format!("{YAML}{key}"))]), ["a"], "{key}");
    }
}

#[test]
fn a_lens_under_a_key_that_is_not_read_is_refused() {
    let bare = YAML.replace("distCoeffs", "unused_numbers");
    for lens in [
        "k1: 0.1\nk2: 0.2\np1: 0.\np2: 0.\n",
        "distortion_parameters:\n   k1: 0.1\n",
        &entry("kc", 5, 1, "0.1, 0., 0., 0., 0."),
        &entry("lens_coefficients", 5, 1, "0.1, 0., 0., 0., 0."),
    ] {
        let found = message(&[file("a.yml", &format!("{bare}{lens}"))]);
        assert!(found.contains("found lens coefficients under a key that is not read"), "{found}");
    }
    for other in ["k1: 0.\n", "distance: 0.3\n", "p1: 0\n"] {
        assert_eq!(names(&[file("a.yml", &format!("{bare}{other}"))]), ["a"], "{other}");
    }
}

#[test]
fn lists_in_lines_are_read() {
    let text = "%YAML:1.0\nimage_size: [640, 480]\ncamera_matrix:\n- - 500.0\n  - 0.0\n  - 320.0\n- - 0.0\n  - 500.0\n  \
        - 240.0\n- - 0.0\n  - 0.0\n  - 1.0\ndist_coeff:\n- -0.1\n- 0.0\n- 0.0\n- 0.0\nrvec: [0, 0, 0]\ntvec: [0, 0, 3]\n";
    let imported = from_opencv(&[file("a.yml", text)], &ImportOptions::default()).expect("a rig");
    let camera = &imported.rig.cameras()[0];
    assert_eq!((camera.intrinsics()[(0, 2)], camera.lens().coefficients()[0]), (320.0, -0.1));
    assert_eq!(imported.warnings, [""; 0]);
}

#[test]
fn half_a_stereo_file_is_no_camera() {
    let nested = format!("right:\n   {}", entry("K", 3, 3, K).replace('\n', "\n   "));
    for text in [
        pair(|key| key.replace("K2", "Kr").replace("D2", "Dr")),
        format!("{YAML}{}{}", entry("K_ir", 3, 3, K), entry("D_ir", 1, 4, "0.1, 0., 0., 0.")),
        format!("{YAML}{nested}"),
        pair(str::to_owned).replace("K2:", "CM2:"),
        format!("{YAML}{}", entry("colour", 3, 3, K)),
        // The second camera's values may be the same.
        format!("{YAML}{}", entry("K_ir", 3, 3, "500., 0., 320., 0., 400., 240., 0., 0., 1.")),
    ] {
        let found = message(&[file("a.yml", &text)]);
        assert!(found.contains("of others") || found.contains("in a map"), "{found}: {text}");
    }
    for more in [
        entry("new_camera_matrix", 3, 3, K),
        entry("camera_matrix_rectified", 3, 3, K),
        entry("R1", 3, 3, "1., 0., 0., 0., 1., 0., 0., 0., 1."),
    ] {
        assert_eq!(names(&[file("a.yml", &format!("{YAML}{more}"))]), ["a"], "{more}");
    }
    let one = YAML.replace("cameraMatrix", "M1").replace("distCoeffs", "D1");
    assert_eq!(names(&[file("a.yml", &one)]), ["a"]);
}

#[test]
fn a_stereo_pair_stands_in_no_room_with_other_cameras() {
    let stereo = file("pair1.yml", &pair(str::to_owned));
    let further = file("pair2.yml", &pair(str::to_owned).replace("-0.1, 0., 0.", "-0.2, 0., 0."));
    for other in [further, file("cam3.yml", YAML)] {
        let found = message(&[stereo.clone(), other.clone()]);
        assert!(
            found.starts_with(&format!("pair1.yml and {}: found a stereo pair", other.path))
                || found.starts_with(&format!("{} and", other.path)),
            "{found}"
        );
    }
    let copy = file("pair1 (copy).yml", &stereo.text);
    assert_eq!(names(&[stereo, copy]), ["camera1", "camera2"]);
    let (matrix, pose) = halves("1.");
    let three =
        [file("cal/left.yml", &matrix), file("cal/right.yml", &matrix), file("cal/extrinsics.yml", &pose)];
    assert!(message(&three).contains("found a camera matrix without a pose"), "{}", message(&three));
}

#[test]
fn a_camera_in_a_folder_of_old_versions_is_a_conflict() {
    let one = [file("cam1.yml", YAML), file("old/cam4.yml", &moved("2."))];
    let found = message(&one);
    assert!(found.starts_with("cam1.yml and old/cam4.yml: found a camera in a folder"), "{found}");
    let kept = [file("cam1.yml", YAML), file("backup/cam1.yml", YAML), file("backup/cam4.yml", &moved("2."))];
    assert!(message(&kept).contains("backup/cam4.yml"), "{}", message(&kept));
    let versions = [file("cam1_old.yml", YAML), file("cam1_new.yml", &moved("2."))];
    assert!(message(&versions).contains("found two versions of camera"), "{}", message(&versions));
}

/// Every cut of a key is looked up: a key of a megabyte would take minutes.
#[test]
fn a_key_longer_than_any_name_describes_no_camera() {
    let key = "k".repeat(1 << 20);
    let text = YAML.replacen("image_width", &format!("{key}: 1\nimage_width"), 1);
    assert!(from_opencv(&[file("cam1.yml", &text)], &MILLIMETRES).is_ok());
}
