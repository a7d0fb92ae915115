//! What the cameras of a room must have in common, whatever program wrote them: places of their own, a space that all
//! look at, and principal points near the middles of their images. A file that was read in the wrong convention, or
//! twice, fails here.

use hull::Camera;
use nalgebra::{Matrix3, Point2, Point3, Vector3};

use super::ImportError;
use super::names::is_version_word;

/// Cameras farther apart than this, metres, are more likely in millimetres.
const FAR_M: f64 = 100.0;
/// Cameras of a room that are all nearer than this, metres, are more likely in another unit.
const NEAR_M: f64 = 0.1;
/// Two cameras nearer than this share of the room, and with axes closer than [`SAME_AXIS`], may be one camera.
const SAME_PLACE_SHARE: f64 = 0.03;
/// The cosine of 5°.
const SAME_AXIS: f64 = 0.996;
/// Rotations, and places as a share of the distance to the origin, that differ by less are equal but for printed digits.
const EQUAL: f64 = 1e-6;
/// Places that are equal are no farther apart than this, metres, however far the origin is.
const MOST_EQUAL_M: f64 = 1e-3;
/// The cosine of 30°: where no two axes are farther apart, the point that they pass nearest may lie behind the cameras.
const WIDE_APART: f64 = 0.866;
/// A principal point farther from the middle of its image than this share of the side is that of another size.
const OFF_MIDDLE: f64 = 0.12;
/// Pixels of which one side is so many times the other are not square.
const MOST_STRETCHED: f64 = 1.5;
/// The mean of unit vectors is longer than this if they have a common direction, and shorter than the other if not.
const COMMON: f64 = 0.8;
const NOT_COMMON: f64 = 0.3;
/// Names in one warning.
const MAX_NAMES: usize = 8;

/// An error for cameras that cannot be those of one room, and warnings for those that hardly are. Lengths are metres;
/// `rig_from_source` is the turn that the cameras' world was given.
pub(super) fn check(
    file: &str,
    cameras: &[Camera],
    rig_from_source: &Matrix3<f64>,
    warnings: &mut Vec<String>,
) -> Result<(), ImportError> {
    check_places(file, cameras, warnings)?;
    if cameras.len() > 2 {
        check_up(file, cameras, rig_from_source, warnings)?;
        check_subject(file, cameras, warnings)?;
    }
    warn_of_lenses(file, cameras, warnings);
    let off: Vec<&str> = cameras.iter().filter(is_off_middle).map(Camera::name).collect();
    if !off.is_empty() {
        warnings.push(format!(
            "{file}: the principal point of {} is far from the middle of the image: is the image size that of the \
             calibration, width first?",
            listed(&off)
        ));
    }
    Ok(())
}

/// Warnings for pixels that are far from square, and for lenses that show nothing at the middle of a side of the image.
fn warn_of_lenses(file: &str, cameras: &[Camera], warnings: &mut Vec<String>) {
    let is_stretched = |camera: &&Camera| {
        let k = camera.intrinsics();
        !(1.0 / MOST_STRETCHED..MOST_STRETCHED).contains(&(k[(0, 0)] / k[(1, 1)]))
    };
    let folds = |camera: &&Camera| {
        let (right, bottom) = (f64::from(camera.width() - 1), f64::from(camera.height() - 1));
        let sides = [(0.0, 0.5 * bottom), (right, 0.5 * bottom), (0.5 * right, 0.0), (0.5 * right, bottom)];
        sides.iter().any(|&(x, y)| camera.normalised(&Point2::new(x, y)).is_none())
    };
    let named =
        |is: &dyn Fn(&&Camera) -> bool| cameras.iter().filter(is).map(Camera::name).collect::<Vec<&str>>();
    let (stretched, folded) = (named(&is_stretched), named(&folds));
    if !stretched.is_empty() {
        warnings.push(format!(
            "{file}: the focal lengths of {} differ by more than half: are pixels that far from square?",
            listed(&stretched)
        ));
    }
    if !folded.is_empty() {
        warnings.push(format!(
            "{file}: the lens of {} shows nothing at the middle of a side of the image: are its coefficients k1 k2 p1 \
             p2 k3?",
            listed(&folded)
        ));
    }
}

/// Where the cameras stand.
fn check_places(file: &str, cameras: &[Camera], warnings: &mut Vec<String>) -> Result<(), ImportError> {
    let room_m = extent_m(cameras);
    let wrong = |one: &Camera, other: &Camera, found: &str, expected| {
        let key = format!("cameras {} and {}", one.name(), other.name());
        Err(ImportError::key(file, &key, found, expected))
    };
    let of_each = "a calibrated pose of each";
    let is_zero = |camera: &&Camera| {
        camera.rotation_rad().iter().chain(camera.translation_m()).all(|&number| number == 0.0)
    };
    let mut zeros = cameras.iter().filter(is_zero);
    if let (Some(one), Some(other)) = (zeros.next(), zeros.next()) {
        return wrong(one, other, "rotation and translation of zeros", of_each);
    }
    let mut near = Vec::new();
    for (index, one) in cameras.iter().enumerate() {
        for other in &cameras[index + 1..] {
            let distance_m = (one.centre_world() - other.centre_world()).norm();
            if distance_m <= equal_m(one) && (one.rotation() - other.rotation()).amax() < EQUAL {
                return wrong(one, other, "the same pose of both", of_each);
            }
            let is_near = cameras.len() > 2 && distance_m < SAME_PLACE_SHARE * room_m;
            if !is_near || axis(one).dot(&axis(other)) < SAME_AXIS {
                continue;
            }
            if is_version(one.name(), other.name()) || is_version(other.name(), one.name()) {
                let found = "two versions of one camera by their names and places";
                return wrong(one, other, found, "one version: move one away, or rename it");
            }
            near.push(format!("{} and {}", one.name(), other.name()));
        }
    }
    if let [one, other, ..] = cameras
        && room_m <= equal_m(one)
    {
        return wrong(one, other, "all cameras at one place, as poses from camera to world give", of_each);
    }
    if !near.is_empty() {
        let near: Vec<&str> = near.iter().map(String::as_str).collect();
        warnings.push(format!(
            "{file}: cameras {} stand at one place and look the same way: are they two versions of one camera?",
            listed(&near)
        ));
    }
    if room_m > FAR_M {
        warnings.push(format!(
            "{file}: cameras are {room_m:.0} m apart: is the source in millimetres (scale 0.001)?"
        ));
    } else if cameras.len() > 2 && room_m < NEAR_M {
        let room_mm = room_m * 1000.0;
        warnings.push(format!(
            "{file}: all cameras stand within {room_mm:.1} mm: is the scale the source's unit?"
        ));
    }
    Ok(())
}

/// Whether two cameras look in directions that are far apart. Rows and ceilings of cameras do not.
fn look_apart(cameras: &[Camera]) -> bool {
    let axes: Vec<Vector3<f64>> = cameras.iter().map(axis).collect();
    let is_wide = |index: usize| axes[index + 1..].iter().any(|other| axes[index].dot(other) < WIDE_APART);
    (0..axes.len()).any(is_wide)
}

/// Whether images have a common direction downwards, as those of cameras that stand upright have, and whether it is −y.
fn check_up(
    file: &str,
    cameras: &[Camera],
    rig_from_source: &Matrix3<f64>,
    warnings: &mut Vec<String>,
) -> Result<(), ImportError> {
    let mean = |down: &dyn Fn(&Camera) -> Vector3<f64>| {
        cameras.iter().map(down).sum::<Vector3<f64>>() / cameras.len() as f64
    };
    let down = mean(&|camera| camera.rotation().row(1).transpose());
    // What it would be if the source's poses were from camera to world. Where its world has y up it tells nothing.
    let inverse = mean(&|camera| (camera.rotation() * rig_from_source).column(1).into());
    if down.norm() < NOT_COMMON && inverse.norm() > COMMON {
        let found = "cameras that stand upright only if the poses are from camera to world";
        return Err(ImportError::key(file, "poses", found, "poses from world to camera"));
    }
    if look_apart(cameras) && down.norm() > COMMON && down.dot(&-Vector3::y()) < 0.5 {
        warnings
            .push(format!("{file}: the cameras stand upright with another axis up than y: is --up right?"));
    }
    Ok(())
}

/// Whether the cameras look at a common space.
fn check_subject(file: &str, cameras: &[Camera], warnings: &mut Vec<String>) -> Result<(), ImportError> {
    let axes: Vec<(Point3<f64>, Vector3<f64>)> =
        cameras.iter().map(|camera| (camera.centre_world(), axis(camera))).collect();
    let Some(subject) = subject(&axes).filter(|_| look_apart(cameras)) else { return Ok(()) };
    let is_behind = |(centre, axis): &&(Point3<f64>, Vector3<f64>)| axis.dot(&(subject - centre)) < 0.0;
    let named = cameras.iter().zip(&axes).filter(|(_, axis)| is_behind(axis));
    let behind: Vec<&str> = named.map(|(camera, _)| camera.name()).collect();
    if behind.len() == cameras.len() {
        let found = "cameras that all look away from where their optical axes meet";
        let expected =
            "a right-handed world, x to the right and y down in images, and poses from world to camera";
        return Err(ImportError::key(file, "poses", found, expected));
    }
    if !behind.is_empty() {
        warnings.push(format!(
            "{file}: {} look away from where the optical axes of all cameras meet: are poses from world to camera?",
            listed(&behind)
        ));
    }
    Ok(())
}

/// The point that all axes, as lines of any direction, pass nearest; `None` if they are nearly parallel. Each axis is
/// a place and a unit vector.
pub(super) fn subject(axes: &[(Point3<f64>, Vector3<f64>)]) -> Option<Point3<f64>> {
    let mut normal = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for (place, axis) in axes {
        let across = Matrix3::identity() - axis * axis.transpose();
        normal += across;
        right += across * place.coords;
    }
    let spread = normal.symmetric_eigenvalues().min() / axes.len() as f64;
    if spread < 1e-3 { None } else { normal.try_inverse().map(|inverse| Point3::from(inverse * right)) }
}

/// The optical axis in the world.
fn axis(camera: &Camera) -> Vector3<f64> {
    camera.rotation().row(2).transpose()
}

/// The largest distance of two cameras, metres.
fn extent_m(cameras: &[Camera]) -> f64 {
    let centres: Vec<Point3<f64>> = cameras.iter().map(Camera::centre_world).collect();
    let from = |one: &Point3<f64>| centres.iter().map(|other| (one - other).norm()).fold(0.0, f64::max);
    centres.iter().map(from).fold(0.0, f64::max)
}

/// Places of cameras that differ by less are equal, metres.
fn equal_m(camera: &Camera) -> f64 {
    (EQUAL * camera.translation_m().norm()).min(MOST_EQUAL_M)
}

/// Whether a name is another one with the word of a version: cam1_refined of cam1, and neither cam10 nor zed1_right.
fn is_version(name: &str, base: &str) -> bool {
    let (name, base) = (name.to_lowercase(), base.to_lowercase());
    let rest = name.strip_prefix(&base).map(|rest| rest.trim_matches(|c: char| !c.is_alphanumeric()));
    rest.is_some_and(is_version_word)
}

fn is_off_middle(camera: &&Camera) -> bool {
    let is_off = |at: f64, side: u32| {
        let side = f64::from(side);
        (at - (side - 1.0) * 0.5).abs() > OFF_MIDDLE * side
    };
    let k = camera.intrinsics();
    is_off(k[(0, 2)], camera.width()) || is_off(k[(1, 2)], camera.height())
}

/// The first names of many.
fn listed(names: &[&str]) -> String {
    let shown = names.iter().take(MAX_NAMES).copied().collect::<Vec<&str>>().join(", ");
    if names.len() > MAX_NAMES { format!("{shown} and {} more", names.len() - MAX_NAMES) } else { shown }
}

#[cfg(test)]
mod tests {
    use super::super::Axis;
    use super::*;
    use hull::rotation::matrix_from_rodrigues;

    /// A camera at a place that looks at the origin, y up.
    fn looking(name: &str, place: [f64; 3]) -> Camera {
        let centre = Vector3::from(place);
        let z = -centre.normalize();
        let x = z.cross(&Vector3::y()).normalize();
        let rotation = Matrix3::from_rows(&[x.transpose(), z.cross(&x).transpose(), z.transpose()]);
        posed(name, &rotation, -(rotation * centre))
    }

    fn posed(name: &str, rotation: &Matrix3<f64>, translation_m: Vector3<f64>) -> Camera {
        let k = Matrix3::new(1400.0, 0.0, 960.0, 0.0, 1400.0, 540.0, 0.0, 0.0, 1.0);
        Camera::from_matrices(name, (1920, 1080), k, [0.0; 5], rotation, translation_m).expect("a camera")
    }

    fn room() -> Vec<Camera> {
        let places = [[4.0, 1.5, 0.0], [-4.0, 1.5, 0.1], [0.0, 1.4, 4.0], [0.2, 1.5, -4.0]];
        (1..).zip(places).map(|(number, place)| looking(&format!("cam{number}"), place)).collect()
    }

    fn checked(cameras: &[Camera]) -> Result<Vec<String>, ImportError> {
        let mut warnings = Vec::new();
        check("rig", cameras, &Matrix3::identity(), &mut warnings).map(|()| warnings)
    }

    #[track_caller]
    fn passes(cameras: &[Camera]) {
        assert_eq!(checked(cameras).expect("a room"), [""; 0]);
    }

    #[track_caller]
    fn refused(cameras: &[Camera], message: &str) {
        let found = checked(cameras).expect_err(message).to_string();
        assert!(found.contains(message), "{found} lacks {message}");
    }

    #[track_caller]
    fn warned(cameras: &[Camera], message: &str) {
        let found = checked(cameras).expect(message);
        assert!(found.len() == 1 && found[0].contains(message), "{found:?} lacks {message}");
    }

    type Pose = (Matrix3<f64>, Vector3<f64>);

    #[test]
    fn a_room_passes() {
        passes(&room());
    }

    #[test]
    fn poses_of_other_conventions_are_refused() {
        let changed = |change: &dyn Fn(&Camera) -> Pose| -> Vec<Camera> {
            let poses = room();
            poses
                .iter()
                .map(|camera| (camera.name(), change(camera)))
                .map(|(n, (r, t))| posed(n, &r, t))
                .collect()
        };
        let flip = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
        let opengl = changed(&|camera| (flip * camera.rotation(), flip * camera.translation_m()));
        refused(&opengl, "found cameras that all look away from where their optical axes meet");
        let equal: Vec<Camera> = [[4.0, 1.5, 0.0], [-4.0, 1.5, 0.0], [0.0, 1.5, 4.0]]
            .iter()
            .zip(["a", "b", "c"])
            .map(|(place, name)| {
                let camera = looking(name, *place);
                posed(name, &camera.rotation().transpose(), camera.centre_world().coords)
            })
            .collect();
        refused(&equal, "all cameras at one place, as poses from camera to world give");
        // In a world with z up, places and heights that are not those of a perfect ring.
        let inverse: Vec<Camera> = room()
            .iter()
            .map(|camera| {
                let rotation = camera.rotation() * Axis::PlusZ.rig_from_source();
                let centre_m = -(rotation.transpose() * camera.translation_m()) * 1.1;
                posed(camera.name(), &rotation.transpose(), centre_m + Vector3::new(0.3, 0.2, 0.1))
            })
            .collect();
        refused(&inverse, "found cameras that stand upright only if the poses are from camera to world");
    }

    #[test]
    fn another_axis_that_is_up_is_named() {
        let turn = Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0);
        let turned =
            |camera: &Camera| posed(camera.name(), &(camera.rotation() * turn), *camera.translation_m());
        warned(
            &room().iter().map(turned).collect::<Vec<Camera>>(),
            "with another axis up than y: is --up right?",
        );
    }

    #[test]
    fn cameras_whose_axes_hardly_differ_pass() {
        let down = |name: &str, x: f64, y: f64, tilt_rad: f64| {
            let tilt = matrix_from_rodrigues(&Vector3::new(tilt_rad, -0.7 * tilt_rad, 0.0));
            let rotation = tilt * Matrix3::new(1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0);
            posed(name, &rotation, -(rotation * Vector3::new(x, y, 3.0)))
        };
        for tilt_rad in [0.05, -0.05, 0.09] {
            let tilts = [tilt_rad, -tilt_rad, 0.5 * tilt_rad, -0.3 * tilt_rad];
            let grid = [(0.0, 0.0), (2.0, 0.0), (0.0, 2.0), (2.0, 2.0)];
            let ceiling = grid.iter().zip(tilts).zip(["a", "b", "c", "d"]);
            passes(&ceiling.map(|((&(x, y), tilt), name)| down(name, x, y, tilt)).collect::<Vec<Camera>>());
        }
        let fan =
            [("left", -1.0, 0.1), ("middle", 0.0, 0.0), ("right", 1.0, -0.1)].map(|(name, x, turn_rad)| {
                let rotation = matrix_from_rodrigues(&Vector3::new(0.0, turn_rad, 0.0));
                posed(name, &rotation, -(rotation * Vector3::new(x, 0.0, 0.0)))
            });
        passes(&fan);
    }

    #[test]
    fn a_room_far_from_the_origin_passes() {
        let far = Vector3::new(5e5, 5.4e6, 0.0);
        let moved = |camera: &Camera| {
            posed(camera.name(), camera.rotation(), camera.translation_m() - camera.rotation() * far)
        };
        passes(&room().iter().map(moved).collect::<Vec<Camera>>());
    }

    #[test]
    fn one_camera_that_looks_away_is_named() {
        let mut cameras = room();
        let flip = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
        let one = &cameras[2];
        cameras[2] = posed("cam3", &(flip * one.rotation()), flip * one.translation_m());
        warned(&cameras, "cam3 look away from where the optical axes of all cameras meet");
    }

    #[test]
    fn a_camera_that_stands_twice_is_refused_or_named() {
        let with = |camera: Camera| -> Vec<Camera> { room().into_iter().chain([camera]).collect() };
        refused(
            &with(looking("cam5", [4.0, 1.5, 0.0])),
            "cameras cam1 and cam5: found the same pose of both",
        );
        let moved = |name| looking(name, [4.0, 1.5, 0.01]);
        refused(
            &with(moved("cam1_refined")),
            "cameras cam1 and cam1_refined: found two versions of one camera",
        );
        warned(&with(moved("cam10")), "cam1 and cam10 stand at one place and look the same way");
        warned(&with(moved("cam1_right")), "cam1 and cam1_right stand at one place and look the same way");
        passes(&with(looking("cam5", [4.0, 1.5, 0.5])));
    }

    #[test]
    fn a_size_of_another_calibration_is_named() {
        let sized = |size| -> Vec<Camera> {
            let sized = |camera: &Camera| {
                let k = *camera.intrinsics();
                Camera::from_matrices(
                    camera.name(),
                    size,
                    k,
                    [0.0; 5],
                    camera.rotation(),
                    *camera.translation_m(),
                )
            };
            room().iter().map(|camera| sized(camera).expect("a camera")).collect()
        };
        for size in [(1080, 1920), (3840, 2160), (1280, 720), (2880, 1620)] {
            warned(&sized(size), "the principal point of cam1, cam2, cam3, cam4 is far from the middle");
        }
        passes(&sized((2048, 1080)));
    }

    #[test]
    fn lenses_that_hardly_are_are_named() {
        let with = |k: [f64; 2], lens: [f64; 5]| -> Vec<Camera> {
            let made = |camera: &Camera| {
                let k = Matrix3::new(k[0], 0.0, 960.0, 0.0, k[1], 540.0, 0.0, 0.0, 1.0);
                let (rotation, translation_m) = (camera.rotation(), *camera.translation_m());
                Camera::from_matrices(camera.name(), (1920, 1080), k, lens, rotation, translation_m)
            };
            room().iter().map(|camera| made(camera).expect("a camera")).collect()
        };
        warned(&with([1400.0, 700.0], [0.0; 5]), "the focal lengths of cam1, cam2, cam3, cam4 differ");
        warned(
            &with([1400.0; 2], [-3.0, 0.0, 0.0, 0.0, 0.0]),
            "the lens of cam1, cam2, cam3, cam4 shows nothing",
        );
        passes(&with([1400.0, 1300.0], [-0.3, 0.1, 0.0, 0.0, 0.0]));
    }

    #[test]
    fn rooms_of_another_unit_are_named() {
        let scaled = |scale: f64| -> Vec<Camera> {
            let scaled =
                |camera: &Camera| posed(camera.name(), camera.rotation(), camera.translation_m() * scale);
            room().iter().map(scaled).collect()
        };
        warned(&scaled(1000.0), "m apart: is the source in millimetres");
        warned(&scaled(0.001), "all cameras stand within 8.0 mm: is the scale the source's unit?");
    }
}
