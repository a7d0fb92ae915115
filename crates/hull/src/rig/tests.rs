use super::*;

const TEXT: &str = r#"
[cam_9]
name = "zebra"
size = [ 640.0, 480.0 ]
matrix = [ [ 500.0, 0, 320.0 ], [ 0.0, 510.5, 240.0 ], [ 0.0, 0.0, 1.0 ] ]
distortions = [ -0.046, 0.139, -0.0004, -0.0004 ]
rotation = [ 0.90, 0.55, 1.02 ]
translation = [ 0.30, 0.95, 4.96 ]
fisheye = false
grid_convention = "opencv"

[cam_1]
name = "ant"
size = [ 1920, 1080 ]
matrix = [ [ 1681.0, 0.25, 969.0 ], [ 0.0, 1681.0, 540.0 ], [ 0.0, 0.0, 1.0 ] ]
distortions = [ ]
rotation = [ 0.0, 0.0, 0.0 ]
translation = [ 0.0, 0.0, 1.0 ]

[metadata]
adjusted = false
"#;

#[test]
fn cameras_keep_file_order_and_all_their_bits() {
    let rig = Rig::from_toml(TEXT).expect("valid");
    let names: Vec<&str> = rig.cameras().iter().map(Camera::name).collect();
    assert_eq!(names, ["zebra", "ant"]);
    assert_eq!(rig.cameras()[0].lens().coefficients(), [-0.046, 0.139, -0.0004, -0.0004, 0.0]);
    assert_eq!(Rig::from_toml(&rig.to_toml()).expect("own text"), rig);
}

#[track_caller]
fn check_refused(from: &str, to: &str, message: &str) {
    let text = TEXT.replacen(from, to, 1);
    assert_ne!(text, TEXT);
    let error = Rig::from_toml(&text).expect_err("refused").to_string();
    assert_eq!(error, message);
}

#[test]
fn a_lens_of_another_model_is_refused_however_it_is_written() {
    for other in
        ["fisheye = 1", "fisheye = \"true\"", "camera_model = \"fisheye\"", "xi = 0.9", "model = \"ds\""]
    {
        let error = Rig::from_toml(&TEXT.replacen("fisheye = false", other, 1)).expect_err(other).to_string();
        assert!(error.starts_with("[cam_9] ") && error.contains("expected the pinhole"), "{error}");
        let error = Rig::from_toml(&format!("{TEXT}{other}\n"));
        assert_eq!(error.is_err(), !other.starts_with("xi"), "{other} in the metadata");
    }
    for other in ["distortion = [\"equidistant\"]", "method = \"fisheye\"", "omni = true", "k4 = 0.3"] {
        assert!(Rig::from_toml(&TEXT.replacen("fisheye = false", other, 1)).is_err(), "{other}");
    }
    for known in ["model = \"acA1920\"", "type = \"usb\"", "notes = \"not a fisheye\"", "k4 = 0.0"] {
        assert!(Rig::from_toml(&TEXT.replacen("fisheye = false", known, 1)).is_ok(), "{known}");
    }
    for same in [
        "k1 = -0.046",
        "distortion = [[-0.046, 0.139, -0.0004, -0.0004, 0.0]]",
        "dist_coeffs = \"-0.0460 0.139 -0.0004 -0.0004\"",
        "radial = [-0.046, 0.139]",
        "focus_dist = 2.5",
        "d = 2.3",
    ] {
        assert!(Rig::from_toml(&TEXT.replacen("fisheye = false", same, 1)).is_ok(), "{same}");
    }
    for other in
        ["p1 = 0.1", "distortion = { k1 = 0.5 }", "radial = [0.2, 0.139]", "kc = [-0.046, 0.139, 0.1, 0.2]"]
    {
        assert!(Rig::from_toml(&TEXT.replacen("fisheye = false", other, 1)).is_err(), "{other}");
    }
    for known in ["fisheye = 0", "fisheye = \"false\"", "distortion_model = \"plumb_bob\""] {
        assert!(Rig::from_toml(&TEXT.replacen("fisheye = false", known, 1)).is_ok(), "{known}");
    }
    let eight = TEXT.replacen("-0.0004, -0.0004 ]", "0, 0, 0, 0.5, 0.1, 0 ]", 1);
    assert!(Rig::from_toml(&eight).expect_err("rational").to_string().starts_with("[cam_9] distortions: "));
    assert!(Rig::from_toml(&eight.replace("0.5, 0.1, 0 ]", "0, 0, 0 ]")).is_ok());
}

#[test]
fn a_byte_order_mark_and_caliscope_s_own_file_are_known() {
    let marked = Rig::from_toml(&format!("\u{feff}{TEXT}")).expect("a rig");
    assert_eq!(marked, Rig::from_toml(TEXT).expect("a rig"));
    let error = Rig::from_toml("[cameras.0]\ncam_id = 0\n").expect_err("another file").to_string();
    assert!(error.starts_with("[cameras]: found Caliscope's camera_array.toml"), "{error}");
}

#[test]
fn a_rig_has_no_more_cameras_than_places() {
    let camera = |index| {
        TEXT.split("\n\n")
            .next()
            .expect("a camera")
            .replace("_9", &format!("_{index}"))
            .replace("zebra", &format!("zebra {index}"))
    };
    let rig = |count| Rig::from_toml(&(0..count).map(camera).collect::<String>());
    assert_eq!(rig(MAX_CAMERAS).expect("the most").cameras().len(), MAX_CAMERAS);
    let error = rig(MAX_CAMERAS + 1).expect_err("one more").to_string();
    assert_eq!(error, "1025 cameras, expected at most 1024");
}

#[test]
fn each_wrong_key_is_named_with_what_was_found() {
    check_refused("name = \"ant\"", "", "[cam_1] name: found nothing, expected a camera name");
    // In the message a blank stands for it.
    check_refused("\"ant\"", "\"a\\nnt\"", "camera name \"a nt\", expected printable characters");
    check_refused(
        "[ 640.0, 480.0 ]",
        "[ 0, 480 ]",
        "[cam_9] size is 0 x 480, expected 1 to 16384 pixels a side",
    );
    check_refused(
        "[ 0.90, 0.55, 1.02 ]",
        "[ 0.90, nan, 1.02 ]",
        "[cam_9] rotation holds NaN, expected finite numbers",
    );
    check_refused(
        "fisheye = false",
        "fisheye = true",
        "[cam_9] fisheye: found true, expected the pinhole with k1 k2 p1 p2 k3 (plumb_bob, radtan, pinhole, \
         false or 0)",
    );
    check_refused(
        "rotation = [",
        "rotation = ",
        "not a TOML file: line 7: unexpected key or value, expected newline, `#`",
    );
}

#[test]
fn numbers_that_cannot_be_of_the_image_or_the_room_are_refused() {
    let of_image = "for an image of 640 x 480, expected";
    let pixels = "is it in pixels of this size?";
    check_refused(
        "[ 500.0, 0, 320.0 ], [ 0.0, 510.5, 240.0 ]",
        "[ 0.8, 0, 0.5 ], [ 0.0, 0.8, 0.5 ]",
        &format!(
            "[cam_9] matrix has focal lengths of 0.8000 and 0.8000 pixels {of_image} a tenth of the image's side or more: {pixels}"
        ),
    );
    check_refused(
        "320.0 ], [ 0.0, 510.5",
        "960.0 ], [ 0.0, 510.5",
        &format!(
            "[cam_9] matrix has its principal point at 960.0, 240.0 {of_image} a point in the image: {pixels}"
        ),
    );
    check_refused(
        "[ 0.90, 0.55, 1.02 ]",
        "[ 0.0, 0.0, 90.0 ]",
        "[cam_9] rotation is a vector of 90.0 rad, expected at most 2 π: are these degrees?",
    );
    for (line, message) in [
        ("ignore = true", "ignore: found true, expected a camera that takes part: remove it from the file"),
        ("enabled = 0", "enabled: found 0, expected a camera that takes part: remove it from the file"),
        ("exclude = true", "exclude: found true, expected a camera that takes part: remove it from the file"),
        ("handedness = \"left\"", "handedness: found left, expected a right-handed world"),
        ("k1 = 0.5", "k1: found 0.5, expected all lens coefficients under `distortions`, k1 k2 p1 p2 k3"),
        (
            "distortion = [0.5, 0, 0, 0, 0]",
            "distortion: found [0.5, 0, 0, 0, 0], expected all lens coefficients under `distortions`, k1 k2 p1 p2 k3",
        ),
        (
            "dist = [[0.5, 0, 0, 0, 0]]",
            "dist: found [[0.5, 0, 0, 0, 0]], expected all lens coefficients under `distortions`, k1 k2 p1 p2 k3",
        ),
        (
            "calibrated = false",
            "calibrated: found false, expected a calibration that succeeded: remove the camera, or calibrate it",
        ),
        (
            "units = \"cm\"",
            "units: found cm, expected metres, or `rig import` with --scale and the unit in metres (mm: --scale 0.001)",
        ),
        (
            "cam_to_world = true",
            "cam_to_world: found true, expected a pose from world to camera: x_camera = R x_world + T",
        ),
    ] {
        check_refused("fisheye = false", line, &format!("[cam_9] {message}"));
    }
    check_refused("\"ant\"", "\"a\\nnt\"", "camera name \"a nt\", expected printable characters");
}
