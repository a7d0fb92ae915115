//! The behaviour that other crates rely on.

use hull::Camera;
use nalgebra::{Point3, Vector3};

use crate::maths::{mixed, turn_y, turn_z};
use crate::motions::strike::{SWEEP_FROM_S, SWEEP_TO_S};
use crate::props::{BOX_REST_M, BOX_RISE_M, BOX_SIZE_M, TRAY_REST_M, box_state};
use crate::{
    CameraStage, ConvexForm, Joint, Motion, NEUTRAL_S, Prop, StageSettings, Truth, studio_rig,
    true_silhouette,
};

fn settings(motion: Motion) -> StageSettings {
    let props = match motion {
        Motion::Lift => vec![Prop::Table, Prop::LiftedBox],
        Motion::Tray => vec![Prop::Tray],
        _ => Vec::new(),
    };
    StageSettings { motion, props, ..StageSettings::default() }
}

fn camera(index: usize) -> Camera {
    studio_rig(8, (320, 240)).expect("a rig").cameras()[index].clone()
}

/// The same with a lens that distorts.
fn bent(camera: &Camera) -> Camera {
    let distortion = [-0.25, 0.08, 0.001, -0.002, 0.0];
    let (rotation, offset) = (*camera.rotation_rad(), *camera.translation_m());
    Camera::new("bent", (320, 240), *camera.intrinsics(), distortion, rotation, offset).expect("valid")
}

fn film(settings: &StageSettings, index: usize, frame: u64) -> Vec<u8> {
    let mut stage = CameraStage::new(settings, &camera(index), index);
    let mut rgb = vec![0; stage.frame_bytes()];
    stage.render(frame, &mut rgb);
    rgb
}

/// Numbers in 0..1, ever the same.
fn shares() -> impl FnMut() -> f64 {
    let mut count = 0;
    move || {
        count += 1;
        (mixed(count) >> 11) as f64 / (1u64 << 53) as f64
    }
}

const BONES: [(Joint, Joint); 18] = [
    (Joint::Pelvis, Joint::Waist),
    (Joint::Waist, Joint::Neck),
    (Joint::Neck, Joint::SkullBase),
    (Joint::SkullBase, Joint::Head),
    (Joint::LeftShoulder, Joint::LeftElbow),
    (Joint::LeftElbow, Joint::LeftWrist),
    (Joint::LeftWrist, Joint::LeftHand),
    (Joint::RightShoulder, Joint::RightElbow),
    (Joint::RightElbow, Joint::RightWrist),
    (Joint::RightWrist, Joint::RightHand),
    (Joint::LeftShoulder, Joint::RightShoulder),
    (Joint::LeftHip, Joint::LeftKnee),
    (Joint::LeftKnee, Joint::LeftAnkle),
    (Joint::LeftAnkle, Joint::LeftToe),
    (Joint::RightHip, Joint::RightKnee),
    (Joint::RightKnee, Joint::RightAnkle),
    (Joint::RightAnkle, Joint::RightToe),
    (Joint::LeftHip, Joint::RightHip),
];

#[test]
fn frames_depend_on_settings_camera_and_number_alone() {
    let wave = settings(Motion::Wave);
    let first = film(&wave, 0, 70);
    assert_eq!(film(&wave, 0, 70), first);
    // What was rendered before does not matter.
    let mut stage = CameraStage::new(&wave, &camera(0), 0);
    let mut rgb = vec![0; stage.frame_bytes()];
    for frame in [3, 200, 70] {
        stage.render(frame, &mut rgb);
    }
    assert_eq!(rgb, first);
    assert_ne!(film(&wave, 0, 71), first);
    assert_ne!(film(&wave, 1, 70), first);
    assert_ne!(film(&StageSettings { seed: 2, ..wave }, 0, 70), first);
}

#[test]
fn a_frame_is_the_same_bytes_on_every_machine() {
    let lift = settings(Motion::Lift);
    let digest = film(&lift, 3, 250).iter().fold(0, |digest, &byte| mixed(digest ^ u64::from(byte)));
    assert_eq!(
        digest, 15_223_773_770_147_867_346,
        "the film has changed: right if the picture was meant to, else a platform differs"
    );
}

#[test]
fn bones_keep_their_lengths() {
    for motion in Motion::ALL {
        for (a, b) in BONES {
            let length_m = |time_s| (motion.joint_world(a, time_s) - motion.joint_world(b, time_s)).norm();
            let at_rest_m = length_m(0.0);
            for step in 0..300 {
                let time_s = 0.05 * f64::from(step);
                let change_m = (length_m(time_s) - at_rest_m).abs();
                assert!(change_m < 1e-9, "{motion} {a:?} to {b:?} by {change_m} at {time_s}");
            }
        }
    }
}

#[test]
fn motions_start_neutral_and_loop() {
    for motion in Motion::ALL {
        for (_, joint) in BONES {
            let neutral = Motion::Idle.joint_world(joint, 0.0);
            for time_s in [0.0, 0.5, NEUTRAL_S] {
                let away_m = (motion.joint_world(joint, time_s) - neutral).norm();
                assert!(away_m < 0.01, "{motion} {joint:?} {away_m} from neutral at {time_s}");
            }
            for share in [0.0, 0.13, 0.5, 0.77] {
                let time_s = motion.loop_start_s() + share * motion.period_s();
                let here = motion.joint_world(joint, time_s);
                let later = motion.joint_world(joint, time_s + 3.0 * motion.period_s());
                assert!((here - later).norm() < 1e-9, "{motion} {joint:?} at {time_s}");
            }
        }
    }
}

#[test]
fn nothing_moves_faster_than_a_person_or_sinks_into_the_floor() {
    let step_s = 1.0 / 120.0;
    for motion in Motion::ALL {
        for (_, joint) in BONES {
            for step in 0..(120 * 16) {
                let time_s = f64::from(step) * step_s;
                let (here, next) =
                    (motion.joint_world(joint, time_s), motion.joint_world(joint, time_s + step_s));
                let speed = (next - here).norm() / step_s;
                assert!(speed < 3.2, "{motion} {joint:?} {speed} m/s at {time_s}");
                assert!(here.y > 0.02, "{motion} {joint:?} at height {} at {time_s}", here.y);
            }
        }
    }
}

#[test]
fn points_inside_fall_on_the_mask_and_rays_that_miss_do_not() {
    let mut share = shares();
    for (motion, time_s) in
        [(Motion::Wave, 2.4), (Motion::Walk, 4.1), (Motion::Lift, 5.0), (Motion::Punch, 2.3)]
    {
        let stage = settings(motion);
        let truth = Truth::new(&stage, time_s);
        let (low, high) = stage.bounds_world(time_s).expect("a person");
        for index in [0, 3, 6] {
            let camera = camera(index);
            let mask = CameraStage::new(&settings(motion), &camera, index).mask(time_s);
            let mut inside = 0;
            for _ in 0..20_000 {
                let place = Vector3::new(share(), share(), share());
                let point = Point3::from(low.coords + (high - low).component_mul(&place));
                // A pixel shows what is at its centre: up to half its diagonal away, 1.5 cm here.
                if truth.signed_distance_m(&point) < -0.015 {
                    inside += 1;
                    let pixel = camera.pixel(&point).expect("on the image");
                    let at = pixel.row as usize * 320 + pixel.column as usize;
                    assert_eq!(mask[at], 255, "{motion} {} at {point}", camera.name());
                }
            }
            assert!(inside > 100, "{inside} points inside");
            check_edge_rays(&camera, &truth, &mask);
        }
    }
}

/// Marches the viewing rays of pixels along the mask's edge: the mask must say what the march says.
#[track_caller]
fn check_edge_rays(camera: &Camera, truth: &Truth, mask: &[u8]) {
    let mut checked = 0;
    for (at, pair) in mask.windows(2).enumerate().filter(|(_, pair)| pair[0] != pair[1]).step_by(5) {
        for (at, value) in [(at, pair[0]), (at + 1, pair[1])] {
            let image = nalgebra::Point2::new((at % 320) as f64, (at / 320) as f64);
            let ray = camera.ray_world(&image).expect("a ray");
            let (mut along_m, mut least_m) = (1.0, f64::INFINITY);
            while along_m < 6.0 && least_m > 1e-5 {
                let distance_m = truth.signed_distance_m(&(camera.centre_world() + ray * along_m));
                least_m = least_m.min(distance_m);
                along_m += distance_m.max(1e-5);
            }
            checked += 1;
            // Rays that graze within a tenth of a millimetre may go either way.
            assert!((least_m <= 1e-4) || value == 0, "mask set at {image}, ray {least_m} m away");
            assert!(
                least_m > 1e-5 || value == 255 || grazes(truth, camera, &ray, along_m),
                "mask clear at {image}"
            );
        }
    }
    assert!(checked > 50, "{checked} rays");
}

fn grazes(truth: &Truth, camera: &Camera, ray: &Vector3<f64>, along_m: f64) -> bool {
    let depth = |more_m: f64| truth.signed_distance_m(&(camera.centre_world() + ray * (along_m + more_m)));
    (0..100).all(|step| depth(0.0005 * f64::from(step)) > -2e-4)
}

#[test]
fn a_bent_lens_shows_the_same_person() {
    let straight = camera(1);
    let bent = bent(&straight);
    let walk = settings(Motion::Walk);
    let truth = Truth::new(&walk, 4.0);
    let mask = CameraStage::new(&walk, &bent, 0).mask(4.0);
    check_edge_rays(&bent, &truth, &mask);
    assert!(mask.iter().filter(|&&value| value == 255).count() > 1000);
}

#[test]
fn the_person_covers_as_much_of_the_picture_as_a_person_would() {
    for index in 0..8 {
        let silhouette = true_silhouette(&settings(Motion::Idle), &camera(index), 0.0);
        let area = silhouette.expect("a size").area();
        let focal = camera(index).intrinsics()[(0, 0)];
        let square_metres = area as f64 * (3.5 / focal) * (3.5 / focal);
        assert!((0.3..0.75).contains(&square_metres), "{square_metres} m² in camera {index}");
    }
}

#[test]
fn the_empty_room_shows_neither_person_nor_props() {
    let lift = settings(Motion::Lift);
    let mut stage = CameraStage::new(&lift, &camera(2), 2);
    let mut empty = [vec![0; stage.frame_bytes()], vec![0; stage.frame_bytes()]];
    stage.render_empty(0, &mut empty[0]);
    stage.render_empty(1, &mut empty[1]);
    assert_ne!(empty[0], empty[1], "noise is new in every frame");
    let apart = |a: &[u8], b: &[u8]| {
        (0..a.len() / 3).filter(|&at| (0..3).any(|c| a[3 * at + c].abs_diff(b[3 * at + c]) > 22)).count()
    };
    assert_eq!(apart(&empty[0], &empty[1]), 0);
    let mut rgb = vec![0; stage.frame_bytes()];
    stage.render(90, &mut rgb);
    let mask = stage.mask(3.0);
    let covered = mask.iter().filter(|&&value| value == 255).count();
    let clear = (0..mask.len()).filter(|&at| {
        let far =
            (0..3).map(|c| f64::from(rgb[3 * at + c].abs_diff(empty[0][3 * at + c])).powi(2)).sum::<f64>();
        mask[at] == 255 && far.sqrt() < 35.0
    });
    let clear = clear.count();
    assert!(clear * 100 < covered * 3, "{clear} of {covered} pixels look like the room");
}

#[test]
fn a_shadow_darkens_without_another_hue() {
    let idle = settings(Motion::Idle);
    let mut stage = CameraStage::new(&idle, &camera(5), 5);
    let (mut rgb, mut empty) = (vec![0; stage.frame_bytes()], vec![0; stage.frame_bytes()]);
    stage.render(0, &mut rgb);
    stage.render_empty(0, &mut empty);
    let mask = stage.mask(0.0);
    let mut darker = 0;
    for at in (0..mask.len()).filter(|&at| mask[at] == 0) {
        let pixel = |bytes: &[u8]| Vector3::from_fn(|c, _| f64::from(bytes[3 * at + c]));
        let (here, room) = (pixel(&rgb), pixel(&empty));
        if here.norm() < 0.85 * room.norm() {
            darker += 1;
            assert!(here.norm() > 0.55 * room.norm());
            assert!(here.dot(&room) / here.norm() / room.norm() > 0.995);
        }
    }
    assert!(darker > 200, "{darker} pixels in shadow");
}

#[test]
fn the_box_rises_with_the_hands_on_its_sides() {
    let centre = |time_s| Vector3::from(box_state(Motion::Lift, true, time_s).centre_world_m());
    assert_eq!(centre(1.9), Vector3::from(BOX_REST_M));
    assert!((centre(3.5).y - BOX_REST_M[1] - BOX_RISE_M).abs() < 1e-12);
    assert_eq!(centre(11.5), Vector3::from(BOX_REST_M));
    for step in 0..100 {
        let time_s = 1.95 + 0.09 * f64::from(step);
        let state = box_state(Motion::Lift, true, time_s);
        for (joint, sign) in [(Joint::LeftHand, 1.0), (Joint::RightHand, -1.0)] {
            let away = Motion::Lift.joint_world(joint, time_s).coords - centre(time_s);
            let local = turn_z(-state.tilt_rad) * away;
            let gap_m = sign * local.x - 0.5 * BOX_SIZE_M[0];
            assert!((0.01..0.03).contains(&gap_m), "{joint:?} {gap_m} m off the side at {time_s}");
            assert!(local.y.abs() < 0.5 * BOX_SIZE_M[1] && local.z.abs() < 0.5 * BOX_SIZE_M[2]);
        }
    }
}

#[test]
fn the_tray_goes_sideways_at_a_metre_a_second_with_the_hands_under_it() {
    let stage = settings(Motion::Tray);
    let tray = |time_s| stage.prop_world(Prop::Tray, time_s).translation.vector;
    assert_eq!(tray(2.0), Vector3::from(TRAY_REST_M));
    assert_eq!(tray(11.0), Vector3::from(TRAY_REST_M));
    let mut fastest_m_s: f64 = 0.0;
    for step in 0..70 {
        let time_s = 2.1 + 0.1 * f64::from(step);
        fastest_m_s = fastest_m_s.max((tray(time_s + 0.01) - tray(time_s)).x.abs() * 100.0);
        for (joint, sign) in [(Joint::LeftHand, 1.0), (Joint::RightHand, -1.0)] {
            let away = Motion::Tray.joint_world(joint, time_s).coords - tray(time_s);
            assert!((0.2..0.28).contains(&(sign * away.x)), "{joint:?} {away} at {time_s}");
            assert!((-0.04..-0.02).contains(&away.y), "{joint:?} {away} at {time_s}");
        }
    }
    assert!((0.95..1.05).contains(&fastest_m_s), "{fastest_m_s} m/s");
    // The feet step: none slides along the floor as fast as the tray for long.
    let foot = |time_s| Motion::Tray.joint_world(Joint::LeftAnkle, time_s);
    let still = (0..190).filter(|step| {
        let time_s = 4.9 + 0.01 * f64::from(*step);
        (foot(time_s + 0.01) - foot(time_s)).norm() < 1e-3
    });
    assert!(still.count() > 50);
}

#[test]
fn fists_and_palms_are_where_scenes_need_them() {
    let at = |motion: Motion, joint, film_s| motion.joint_world(joint, film_s).coords;
    for (joint, sign) in [(Joint::LeftHand, 1.0), (Joint::RightHand, -1.0)] {
        let (before, after) = (at(Motion::Push, joint, 2.2), at(Motion::Push, joint, 3.8));
        assert!((before.y - 1.05).abs() < 0.01 && (after.y - 1.05).abs() < 0.01, "{before} {after}");
        assert!(after.z - before.z > 0.15 && (sign * after.x - 0.24).abs() < 0.02, "{before} {after}");
        // Palms are half a hand's thickness away from what they hold.
        for (film_s, aside_m) in [(1.95, 0.1684), (2.4, 0.1364), (4.9, 0.1264), (8.1, 0.1684)] {
            let palm = at(Motion::Squeeze, joint, film_s);
            assert!((sign * palm.x - aside_m).abs() < 0.003, "{palm} at {film_s}");
        }
        let rise_m = at(Motion::Squeeze, joint, 4.1).y - at(Motion::Squeeze, joint, 2.4).y;
        assert!((rise_m - 0.12).abs() < 0.003, "{rise_m}");
    }
}

/// The arms of the first sweep set out at the first of these film times, seconds, and are through at the second.
const SWEEP_S: (f64, f64) = (NEUTRAL_S + SWEEP_FROM_S, NEUTRAL_S + SWEEP_TO_S);
/// Where the knuckles of the right hand are half-way, world, metres.
const SWEEP_POINT_M: [f64; 3] = [-0.32, 0.744, 0.456];

#[test]
fn the_sweeping_hand_passes_where_it_is_said_to() {
    let hand = |time_s| Motion::Sweep.joint_world(Joint::RightHand, time_s).coords;
    let middle_s = 0.5 * (SWEEP_S.0 + SWEEP_S.1);
    let away_m = (hand(middle_s) - Vector3::from(SWEEP_POINT_M)).norm();
    assert!(away_m < 0.005, "{:?}", hand(middle_s));
    let velocity = (hand(middle_s + 0.005) - hand(middle_s - 0.005)) * 100.0;
    assert!(velocity.x < -0.4 && velocity.norm() < 0.7, "{velocity:?}");
    // Before it sets out, it stays well away.
    for step in 0..=100 {
        let before = hand(SWEEP_S.0 * f64::from(step) / 100.0);
        assert!((before - Vector3::from(SWEEP_POINT_M)).norm() > 0.25, "{before:?}");
    }
}

#[test]
fn without_the_person_the_box_stays() {
    let stage = StageSettings { person: false, ..settings(Motion::Lift) };
    let around = |stage: &StageSettings| stage.bounds_world(5.0).expect("table and box");
    let table = StageSettings { motion: Motion::Idle, ..stage.clone() };
    assert_eq!(around(&stage), around(&table));
    assert_eq!(box_state(Motion::Lift, false, 5.0).centre_world_m(), BOX_REST_M);
    let nothing = StageSettings { person: false, ..settings(Motion::Walk) };
    assert_eq!(nothing.bounds_world(2.0), None);
    let mask = CameraStage::new(&nothing, &camera(0), 0).mask(2.0);
    assert!(mask.iter().all(|&value| value == 0));
}

#[test]
fn every_camera_sees_all_that_can_happen() {
    for count in [1, 2, 3, 5, 8, 13, 32, 64, 65, 128, 256] {
        for size in [(640, 480), (1920, 1080)] {
            let rig = studio_rig(count, size).expect("a rig");
            for camera in rig.cameras() {
                for turn in 0..24 {
                    let around = turn_y(f64::from(turn) * 0.26) * Vector3::new(0.0, 0.0, 1.5);
                    for height_m in [0.3, 1.3] {
                        let point = Point3::from(around + Vector3::new(0.0, height_m, 0.0));
                        assert!(camera.pixel(&point).is_some(), "{point} in {} of {count}", camera.name());
                    }
                }
                for motion in Motion::ALL {
                    let stage = settings(motion);
                    for step in 0..16 {
                        let (low, high) = stage.bounds_world(f64::from(step)).expect("a person");
                        for corner in 0..8 {
                            let pick =
                                |axis: usize| if corner >> axis & 1 == 0 { low[axis] } else { high[axis] };
                            let point = Point3::new(pick(0), pick(1), pick(2));
                            assert!(
                                camera.pixel(&point).is_some(),
                                "{motion} at {step} s: {point} is out of view of {} of {count}",
                                camera.name()
                            );
                        }
                    }
                }
            }
        }
    }
}

/// Colour distance and angle alone, with no clean-up, tell person and props from room and shadow.
#[test]
fn plain_background_subtraction_finds_the_silhouette() {
    for motion in [Motion::Walk, Motion::Lift] {
        for index in [0, 2, 5, 7] {
            let mut stage = CameraStage::new(&settings(motion), &camera(index), index);
            let mut rgb = vec![0; stage.frame_bytes()];
            let mut mean = vec![0.0; stage.frame_bytes()];
            for frame in 0..12 {
                stage.render_empty(frame, &mut rgb);
                mean.iter_mut().zip(&rgb).for_each(|(mean, &byte)| *mean += f64::from(byte) / 12.0);
            }
            stage.render(135, &mut rgb);
            let mask = stage.mask(4.5);
            let (mut both, mut either) = (0, 0);
            for (at, (pixel, room)) in rgb.chunks(3).zip(mean.chunks(3)).enumerate() {
                let image = Vector3::from_fn(|c, _| f64::from(pixel[c]));
                let room = Vector3::from_column_slice(room);
                let apart = (image - room).norm();
                let cosine = image.dot(&room) / (image.norm() * room.norm()).max(1.0);
                let shaded = cosine > 0.996 && image.norm() < room.norm();
                let found = apart > 110.0 || (apart > 20.0 && !shaded);
                both += usize::from(found && mask[at] == 255);
                either += usize::from(found || mask[at] == 255);
            }
            let overlap = both as f64 / either as f64;
            assert!(overlap > 0.96, "{motion} camera {index}: {overlap:.3}");
        }
    }
}

#[test]
fn silhouettes_drawn_by_rows_are_the_masks() {
    for (motion, time_s) in [(Motion::Idle, 0.0), (Motion::Lift, 3.1), (Motion::Tray, 5.0)] {
        for index in [0, 3, 6] {
            let (plain, bent) = (camera(index), bent(&camera(index)));
            for camera in [plain, bent] {
                let drawn = true_silhouette(&settings(motion), &camera, time_s).expect("a size");
                assert_eq!(drawn.to_mask(), CameraStage::new(&settings(motion), &camera, 0).mask(time_s));
            }
        }
    }
    let empty = StageSettings { person: false, ..StageSettings::default() };
    assert_eq!(true_silhouette(&empty, &camera(1), 2.0).expect("a size").area(), 0);
}

#[test]
fn convex_solids_are_where_the_truth_is_and_move_without_jumps() {
    const STEP_S: f64 = 1.0 / 120.0;
    for motion in Motion::ALL {
        let settings = settings(motion);
        let mut before = settings.convex_solids(0.0);
        for step in 1..1200 {
            let time_s = f64::from(step) * STEP_S;
            let solids = settings.convex_solids(time_s);
            assert_eq!(solids.len(), before.len());
            for (at, (solid, before)) in solids.iter().zip(&before).enumerate() {
                let moved_m = (solid.world.translation.vector - before.world.translation.vector).norm();
                let turned = solid.world.rotation.angle_to(&before.world.rotation);
                assert!(moved_m < 0.1 && turned < 0.3, "{motion} at {time_s:.2}: {at} {moved_m} {turned}");
            }
            if step % 150 == 0 {
                let truth = Truth::new(&settings, time_s);
                for solid in &solids {
                    let middle = match solid.form {
                        ConvexForm::Cuboid { .. } => Point3::origin(),
                        ConvexForm::RoundCone { length_m, .. } => Point3::new(0.0, 0.5 * length_m, 0.0),
                    };
                    assert!(truth.signed_distance_m(&(solid.world * middle)) < 0.0, "{motion} at {time_s}");
                }
            }
            before = solids;
        }
    }
}
