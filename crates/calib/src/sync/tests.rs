use super::*;
use hull::rotation::matrix_from_rodrigues;
use hull::{Pixel, Silhouette};
use nalgebra::{Matrix3, Point2, Point3, Vector3};

const FPS: f64 = 30.0;

/// Four cameras of 240 x 180 pixels on an uneven ring around the origin, 3 m away, that look at it.
fn cameras() -> Vec<Camera> {
    let k = Matrix3::new(225.0, 0.0, 119.5, 0.0, 225.0, 89.5, 0.0, 0.0, 1.0);
    let camera = |(index, (around, above)): (usize, (f64, f64))| {
        let rotation = matrix_from_rodrigues(&Vector3::new(above, 0.0, 0.0))
            * matrix_from_rodrigues(&Vector3::new(0.0, around, 0.0));
        let lens = [-0.05, 0.01, 0.0, 0.0, 0.0];
        Camera::from_matrices(
            format!("c{index}"),
            (240, 180),
            k,
            lens,
            &rotation,
            Vector3::new(0.0, 0.0, 3.0),
        )
        .expect("valid")
    };
    [(0.0, 0.2), (1.2, -0.1), (2.7, 0.3), (4.4, 0.1)].into_iter().enumerate().map(camera).collect()
}

fn rig() -> Rig {
    Rig::new(cameras()).expect("unique names")
}

/// A body of three balls that goes round at a speed, radians a second.
fn body(time_s: f64, speed: f64) -> [(Point3<f64>, f64); 3] {
    let turn = matrix_from_rodrigues(&Vector3::new(0.0, speed * time_s, 0.0));
    let middle = Point3::from(turn * Vector3::new(0.3, 0.0, 0.0));
    let arm = turn * Vector3::new(0.0, 0.15, 0.3);
    [(middle, 0.25), (middle + Vector3::new(0.05, -0.35, 0.0), 0.15), (middle + arm, 0.12)]
}

/// Asks the rays of the pixels around each ball.
fn silhouette(camera: &Camera, balls: &[(Point3<f64>, f64)]) -> Silhouette {
    let (width, height) = (camera.width() as i32, camera.height() as i32);
    let mut mask = vec![0; (width * height) as usize];
    for &(centre, radius_m) in balls {
        let image = camera.project(&centre).expect("in view");
        let Pixel { column, row } = Pixel::holding(image.x, image.y);
        let reach = 45;
        for y in (row - reach).max(0)..(row + reach).min(height) {
            for x in (column - reach).max(0)..(column + reach).min(width) {
                let ray = camera.ray_world(&Point2::new(f64::from(x), f64::from(y))).expect("seen");
                let hit = (centre - camera.centre_world()).cross(&ray).norm() < radius_m;
                mask[(y * width + x) as usize] |= u8::from(hit);
            }
        }
    }
    Silhouette::from_mask(camera.width(), camera.height(), &mask).expect("size")
}

/// The films of cameras that are so late.
fn films(late_s: &[f64], speed: f64) -> Vec<Vec<TimedSilhouette>> {
    let film = |(camera, late_s): (&Camera, &f64)| {
        let frame = |frame: usize| {
            let time_s = frame as f64 / FPS;
            TimedSilhouette { time_s, silhouette: silhouette(camera, &body(time_s - late_s, speed)) }
        };
        (0..60).map(frame).collect()
    };
    cameras().iter().zip(late_s).map(film).collect()
}

fn off_ms(report: &SyncReport, late_s: &[f64]) -> Vec<f64> {
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let found: Vec<f64> = report.cameras.iter().map(|camera| camera.late_s).collect();
    let common = mean(&found) - mean(late_s);
    found.iter().zip(late_s).map(|(found, late_s)| 1e3 * (found - late_s - common)).collect()
}

fn turned(rig: &Rig, index: usize, turn_rad: Vector3<f64>) -> Rig {
    let mut cameras = rig.cameras().to_vec();
    let mut correction = crate::check::refine::Correction::zeros();
    correction.fixed_rows_mut::<3>(0).copy_from(&turn_rad);
    cameras[index] = crate::check::refine::corrected(&cameras[index], &correction, 3.0).expect("valid");
    Rig::new(cameras).expect("unique names")
}

#[test]
fn late_cameras_are_found_to_a_tenth_of_a_frame_and_none_is_called_moved() {
    let late_s = [0.0, 0.042, -0.031, 0.013];
    let report = check_sync(&rig(), &films(&late_s, 3.0)).expect("moves");
    for (off_ms, camera) in off_ms(&report, &late_s).iter().zip(&report.cameras) {
        assert!(off_ms.abs() < 3.3, "{off_ms} ms, {report:?}");
        assert!(off_ms.abs() < 4.0 * 1e3 * camera.uncertainty_s + 0.5, "{off_ms} ms, {camera:?}");
    }
    assert_eq!(report.moved, None, "{report:?}");
    assert!(report.cost < 0.2 * report.cost_as_said, "{report:?}");
}

#[test]
fn frames_at_times_of_their_own_and_missing_frames_are_no_harm() {
    let late_s = [0.02, 0.0, 0.0, 0.0];
    let mut films = films(&late_s, 3.0);
    // The second camera says that it films a third of a frame later than it does: it is early by so much.
    films[1].iter_mut().for_each(|frame| frame.time_s += 0.011);
    films[2].remove(20);
    films[2].remove(33);
    let report = check_sync(&rig(), &films).expect("moves");
    let truth_s = [0.02, 0.011, 0.0, 0.0];
    assert!(off_ms(&report, &truth_s).iter().all(|off_ms| off_ms.abs() < 3.3), "{report:?}");
}

#[test]
fn a_camera_that_was_turned_is_told_from_one_that_is_late() {
    let late_s = [0.0, 0.03, 0.0, 0.0];
    let films = films(&late_s, 3.0);
    let report = check_sync(&turned(&rig(), 2, Vector3::new(0.0, 0.03, 0.0)), &films).expect("moves");
    assert_eq!(report.moved, Some(2), "{report:?}");
    assert!(off_ms(&report, &late_s).iter().all(|off_ms| off_ms.abs() < 5.0), "{report:?}");
    // The turn moved the picture right by 225 · 0.03 pixels.
    let [right, down] = report.cameras[2].refinement.shift_px;
    assert!((right + 6.75).abs() < 1.0 && down.abs() < 1.0, "{right} {down}");
}

#[test]
fn a_person_who_stands_still_has_no_time() {
    let error = check_sync(&rig(), &films(&[0.0; 4], 0.01)).expect_err("still");
    assert!(matches!(error, SyncError::Still { .. }), "{error}");
    assert!(error.to_string().starts_with("too little motion: "), "{error}");
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let films = films(&[0.0; 4], 3.0);
    let refused =
        |films: &[Vec<TimedSilhouette>]| check_sync(&rig(), films).expect_err("refused").to_string();
    assert_eq!(refused(&films[..3]), "found films of 3 cameras, expected one for each of 4");
    let short: Vec<_> = films.iter().map(|film| film[..5].to_vec()).collect();
    assert_eq!(refused(&short), "found 0.13 s of film of all cameras, expected at least 0.5 s, and best ten");
    let one: Vec<_> = films.iter().map(|film| film[..1].to_vec()).collect();
    assert!(refused(&one).starts_with("found 0.00 s of film"));
    let mut swapped = films.clone();
    swapped[1].swap(3, 4);
    assert!(refused(&swapped).starts_with("camera \"c1\": a frame of 0.1"), "{}", refused(&swapped));
    let mut empty = films.clone();
    let nothing = Silhouette::empty(240, 180).expect("size");
    empty[3].iter_mut().for_each(|frame| frame.silhouette = nothing.clone());
    assert!(refused(&empty).starts_with("found no moment at which every camera sees a person"));
    let alone = Rig::new(cameras()[..1].to_vec()).expect("one");
    let error = check_sync(&alone, &films[..1]).expect_err("refused").to_string();
    assert_eq!(error, "found 1 cameras, expected at least two");
}
