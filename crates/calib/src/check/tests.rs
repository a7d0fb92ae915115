use super::*;
use hull::rotation::matrix_from_rodrigues;
use nalgebra::{Matrix3, Point3, Vector3};

fn check(rig: &Rig, frames: &[Vec<Silhouette>]) -> Result<CheckReport, CheckError> {
    PreparedFrames::new(frames)?.check(rig)
}

/// Four cameras of 200 x 160 pixels on an uneven ring around the origin, 3 m away, that look at it.
fn rig() -> Rig {
    let cameras = [(0.0, 0.2), (1.2, -0.1), (2.7, 0.3), (4.4, 0.1)].into_iter().enumerate();
    let k = Matrix3::new(220.0, 0.0, 99.5, 0.0, 220.0, 79.5, 0.0, 0.0, 1.0);
    let camera = |(index, (around, above)): (usize, (f64, f64))| {
        let rotation = matrix_from_rodrigues(&Vector3::new(above, 0.0, 0.0))
            * matrix_from_rodrigues(&Vector3::new(0.0, around, 0.0));
        let lens = [-0.1, 0.02, 0.0, 0.0, 0.0];
        let translation_m = Vector3::new(0.0, 0.0, 3.0);
        Camera::from_matrices(format!("c{index}"), (200, 160), k, lens, &rotation, translation_m)
            .expect("valid")
    };
    Rig::new(cameras.map(camera).collect()).expect("unique names")
}

/// A body of four balls in each of four poses, drawn by asking every pixel's ray.
fn frames(rig: &Rig) -> Vec<Vec<Silhouette>> {
    let balls = |frame: usize| {
        let swing = frame as f64 * 0.12;
        [
            (Point3::new(0.0, 0.3, 0.05), 0.28),
            (Point3::new(0.1, -0.35, 0.0), 0.2),
            (Point3::new(0.45 - swing, 0.1 + swing, 0.2), 0.1),
            (Point3::new(-0.4, 0.2 - swing, -0.25 + swing), 0.12),
        ]
    };
    let draw = |camera: &Camera, balls: &[(Point3<f64>, f64); 4]| {
        let hit = |column: u32, row: u32| {
            let ray = camera.ray_world(&Point2::new(f64::from(column), f64::from(row))).expect("seen");
            balls
                .iter()
                .any(|(centre, radius_m)| (centre - camera.centre_world()).cross(&ray).norm() < *radius_m)
        };
        let pixels = (0..160).flat_map(|row| (0..200).map(move |column| (column, row)));
        let mask: Vec<u8> = pixels.map(|(column, row)| u8::from(hit(column, row))).collect();
        Silhouette::from_mask(200, 160, &mask).expect("size")
    };
    (0..4).map(|frame| rig.cameras().iter().map(|camera| draw(camera, &balls(frame))).collect()).collect()
}

fn turned(rig: &Rig, index: usize, turn_rad: Vector3<f64>) -> Rig {
    let mut cameras = rig.cameras().to_vec();
    let mut correction = refine::Correction::zeros();
    correction.fixed_rows_mut::<3>(0).copy_from(&turn_rad);
    cameras[index] = refine::corrected(&cameras[index], &correction, 3.0).expect("valid");
    Rig::new(cameras).expect("unique names")
}

#[test]
fn a_rig_that_fits_explains_everything_and_names_no_camera() {
    let rig = rig();
    let report = check(&rig, &frames(&rig)).expect("fits");
    assert_eq!(report.moved, None, "{report:?}");
    for camera in &report.cameras {
        assert!(camera.explained > 0.98 && camera.pixels > 2000, "{camera:?}");
    }
}

#[test]
fn the_camera_that_was_turned_is_named_with_the_way_back() {
    let rig = rig();
    let frames = frames(&rig);
    let prepared = PreparedFrames::new(&frames).expect("frames");
    for index in 0..4 {
        let turn_rad = Vector3::new(-0.026, 0.026, 0.0);
        let report = prepared.check(&turned(&rig, index, turn_rad)).expect("fits");
        assert_eq!(report.moved, Some(index), "{report:?}");
        // The turn moved the picture right and down by 220 · 0.026 pixels.
        let [right, down] = report.cameras[index].refinement.shift_px;
        assert!((right + 5.7).abs() < 1.0 && (down + 5.7).abs() < 1.0, "camera {index}: {right} {down}");
        let lost = report.cameras.iter().any(|camera| camera.explained < 0.93);
        assert!(lost, "{report:?}");
    }
}

#[test]
fn two_cameras_cannot_tell_which_of_them_moved() {
    let rig = rig();
    let pair = |rig: &Rig| Rig::new(rig.cameras()[..2].to_vec()).expect("two");
    let frames: Vec<_> = frames(&rig).into_iter().map(|frame| frame[..2].to_vec()).collect();
    let report = check(&turned(&pair(&rig), 0, Vector3::new(0.05, 0.0, 0.0)), &frames).expect("fits");
    assert!(report.cost > 1.0, "{report:?}");
    assert_eq!(report.moved, None);
}

#[test]
fn many_frames_give_the_shares_of_the_few() {
    let rig = rig();
    let few = frames(&rig);
    let many: Vec<_> = (0..FITTED_FRAMES * 2).map(|frame| few[frame % 4].clone()).collect();
    let (few, many) = (check(&rig, &few).expect("fits"), check(&rig, &many).expect("fits"));
    for (few, many) in few.cameras.iter().zip(&many.cameras) {
        assert!((few.explained - many.explained).abs() < 0.01, "{few:?} {many:?}");
    }
}

#[test]
fn what_does_not_belong_together_is_refused() {
    let rig = rig();
    let frames = frames(&rig);
    let message = |frames: &[Vec<Silhouette>]| check(&rig, frames).expect_err("refused").to_string();
    assert_eq!(message(&[]), "no frames of silhouettes given, expected at least one");
    assert_eq!(
        message(&[frames[0].clone(), frames[1][..3].to_vec()]),
        "frame 1 has 3 silhouettes, expected one for each of 4 cameras"
    );
    let mut wrong = frames[0].clone();
    wrong[2] = Silhouette::empty(100, 160).expect("size");
    assert_eq!(
        message(&[frames[0].clone(), wrong.clone()]),
        "silhouette of camera \"c2\" in frame 1 is 100 x 160, expected 200 x 160"
    );
    wrong[2] = Silhouette::empty(200, 160).expect("size");
    assert_eq!(message(&[wrong]), "camera \"c2\" has no foreground in any frame, expected some");
}
