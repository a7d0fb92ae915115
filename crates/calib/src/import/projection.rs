//! Plain 3×4 projection matrices, and the parts that all matrices of other programs go through: `P = K
//! [R t]` taken apart, rotations checked for mirrors.

use hull::Camera;
use hull::rotation::rotation_defect;
use nalgebra::{Matrix3, Matrix3x4, Vector3};

use super::names::{Named, file_names, settled};
use super::{ImportError, ImportOptions, Imported, TextFile, axes, from_origin, numbers, place, size_of};

/// A rotation farther than this from `R Rᵀ = 1` is none; nearer ones were printed with few digits.
pub(super) const ROUNDED: f64 = 1e-3;

/// Which camera of which file, for messages.
pub(super) struct Placement<'a> {
    pub(super) file: &'a str,
    pub(super) key: &'a str,
    pub(super) name: &'a str,
    pub(super) size: (u32, u32),
}

/// A projection matrix taken apart: `P = scale · K [R t]` with a positive diagonal of K.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Parts {
    pub(super) k: Matrix3<f64>,
    /// Orthonormal; its determinant has the sign of that of P's left 3×3.
    pub(super) r: Matrix3<f64>,
    pub(super) t: Vector3<f64>,
}

/// Reads plain 3×4 matrices, one file per camera, named like the file: twelve numbers between blanks or
/// commas, lines that start with `#` left out. The sign of P is arbitrary: the one that makes no mirror
/// is taken. P maps to undistorted pixels.
pub fn from_matrices(files: &[TextFile], options: &ImportOptions) -> Result<Imported, ImportError> {
    let paths: Vec<&str> = files.iter().map(|file| file.path.as_str()).collect();
    let mut warnings = Vec::new();
    let mut cameras = Vec::new();
    if let [first, ..] = files {
        warnings.push(format!(
            "{}: a 3 x 4 matrix has no lens coefficients, taken as zero in all cameras",
            first.path
        ));
    }
    for (file, name) in files.iter().zip(file_names(&paths)?) {
        let p = matrix_from(file)?;
        check_has_intrinsics(file, &p)?;
        let sign = if p.fixed_columns::<3>(0).determinant() < 0.0 { -1.0 } else { 1.0 };
        let parts = taken_apart(&file.path, &(p * sign))?;
        let k = from_origin(parts.k, options.pixel_origin.unwrap_or(0.0));
        let size = size_of(&file.path, None, options, &mut warnings)?;
        let placement = Placement { file: &file.path, key: "P", name: &name, size };
        let value = placed(&placement, k, [0.0; 5], &parts.r, parts.t, &mut warnings)?;
        cameras.push(Named { name: name.clone(), path: file.path.clone(), value });
    }
    let same = |one: &Camera, other: &Camera| one.clone().renamed(other.name()) == *other;
    let cameras = settled(cameras, same, &mut warnings)?.into_iter().map(|camera| camera.value).collect();
    axes::finished(place(files), cameras, 1.0, options, warnings)
}

/// An error for a rotation and a translation alone: as `P = K [R t]` they would be a camera with a focal length of one
/// pixel.
fn check_has_intrinsics(file: &TextFile, p: &Matrix3x4<f64>) -> Result<(), ImportError> {
    let m: Matrix3<f64> = p.fixed_columns::<3>(0) / p.fixed_view::<1, 3>(2, 0).norm();
    let m = m * m.determinant().signum();
    if rotation_defect(&m) > ROUNDED {
        return Ok(());
    }
    let found = "a rotation and a translation [R t] without a camera matrix";
    Err(ImportError::key(&file.path, "P", found, "P = K [R t], which maps to pixels"))
}

/// The twelve numbers of a file.
pub(super) fn matrix_from(file: &TextFile) -> Result<Matrix3x4<f64>, ImportError> {
    let expected = "twelve finite numbers, a 3 x 4 matrix";
    let lines: String =
        file.text.lines().filter(|line| !line.trim_start().starts_with('#')).collect::<Vec<_>>().join("\n");
    let found =
        numbers(&lines).map_err(|word| ImportError::key(&file.path, "P", format!("{word:?}"), expected))?;
    if found.len() != 12 {
        return Err(ImportError::key(&file.path, "P", format!("{} numbers", found.len()), expected));
    }
    if let Some(wrong) = found.iter().find(|number| !number.is_finite()) {
        return Err(ImportError::key(&file.path, "P", wrong.to_string(), expected));
    }
    let counts = lines.lines().map(|line| numbers(line).map_or(0, |numbers| numbers.len()));
    let counts: Vec<usize> = counts.filter(|count| *count > 0).collect();
    if counts != [4, 4, 4] && counts != [12] {
        // A pose of four lines, R above t, has twelve numbers too.
        let shown: Vec<String> = counts.iter().map(usize::to_string).collect();
        let found = format!("lines of {} numbers", shown.join(", "));
        return Err(ImportError::key(
            &file.path,
            "P",
            found,
            "three lines of four numbers, or one of twelve",
        ));
    }
    Ok(Matrix3x4::from_row_slice(&found))
}

/// RQ by Gram–Schmidt from the last row up, with a positive diagonal of K.
pub(super) fn taken_apart(file: &str, p: &Matrix3x4<f64>) -> Result<Parts, ImportError> {
    let row = |r: usize| Vector3::new(p[(r, 0)], p[(r, 1)], p[(r, 2)]);
    let scale = row(2).norm();
    let m = p.fixed_columns::<3>(0) / scale;
    let size = m.norm();
    if !(scale > 0.0 && m.determinant().abs() > 1e-12 * size * size * size) {
        let found = format!("determinant {:e}", p.fixed_columns::<3>(0).determinant());
        return Err(ImportError::key(file, "P", found, "an invertible left 3 x 3"));
    }
    let (m0, m1, r2) = (row(0) / scale, row(1) / scale, row(2) / scale);
    let cy = m1.dot(&r2);
    let rest = m1 - r2 * cy;
    let fy = rest.norm();
    let r1 = rest / fy;
    let (cx, skew) = (m0.dot(&r2), m0.dot(&r1));
    let rest = m0 - r2 * cx - r1 * skew;
    let fx = rest.norm();
    let r0 = rest / fx;
    let r = Matrix3::from_rows(&[r0.transpose(), r1.transpose(), r2.transpose()]);
    let last = p.column(3) / scale;
    // Back substitution of K t = p₄.
    let tz = last.z;
    let ty = (last.y - cy * tz) / fy;
    let tx = (last.x - cx * tz - skew * ty) / fx;
    let k = Matrix3::new(fx, skew, cx, 0.0, fy, cy, 0.0, 0.0, 1.0);
    Ok(Parts { k, r, t: Vector3::new(tx, ty, tz) })
}

/// A camera from a rotation matrix of the source: mirrors are refused with the reason, and matrices
/// printed with few digits are replaced by the nearest rotation, with a warning.
pub(super) fn placed(
    placement: &Placement,
    k: Matrix3<f64>,
    distortion: [f64; 5],
    rotation: &Matrix3<f64>,
    translation: Vector3<f64>,
    warnings: &mut Vec<String>,
) -> Result<Camera, ImportError> {
    let file = placement.file;
    let determinant = rotation.determinant();
    if determinant < 0.0 {
        let detail =
            format!("{} of camera {} has determinant {determinant:.3}", placement.key, placement.name);
        return Err(ImportError::Mirrored { file: file.to_owned(), detail });
    }
    let defect = rotation_defect(rotation);
    let mut rotation = *rotation;
    if defect > 1e-6 && defect <= ROUNDED {
        rotation = nearest_rotation(rotation);
        warnings.push(format!(
            "{file}: {} of camera {} is off from a rotation by {defect:.1e}, the nearest one is taken",
            placement.key, placement.name
        ));
    }
    Camera::from_matrices(placement.name, placement.size, k, distortion, &rotation, translation)
        .map_err(|error| ImportError::camera(file, error))
}

/// The rotation nearest to a matrix that nearly is one (Newton's iteration for the polar factor).
fn nearest_rotation(mut matrix: Matrix3<f64>) -> Matrix3<f64> {
    for _ in 0..6 {
        let Some(inverse) = matrix.try_inverse() else { break };
        matrix = (matrix + inverse.transpose()) * 0.5;
    }
    matrix
}

#[cfg(test)]
mod tests {
    use super::*;
    use hull::rotation::matrix_from_rodrigues;
    use nalgebra::{Point2, Point3, Vector4};
    use proptest::prelude::*;

    const SIZE: ImportOptions =
        ImportOptions { up: None, scale: None, size: Some((640, 480)), pixel_origin: None };

    fn text(p: &Matrix3x4<f64>) -> String {
        p.row_iter().map(|r| format!("{:?} {:?}, {:?} {:?}\n", r[0], r[1], r[2], r[3])).collect()
    }

    fn import(path: &str, text: String) -> Result<Imported, ImportError> {
        from_matrices(&[TextFile { path: path.to_owned(), text }], &SIZE)
    }

    #[test]
    fn a_matrix_worked_by_hand_is_taken_apart() {
        // K = [500 2 320; 0 400 240; 0 0 1], R = a quarter turn about z, t = (1, 2, 4), times −3.
        let p = Matrix3x4::new(
            2.0, -500.0, 320.0, 1784.0, //
            400.0, 0.0, 240.0, 1760.0, //
            0.0, 0.0, 1.0, 4.0,
        ) * -3.0;
        let imported = import("view.7.P.txt", format!("# 3x4\n{}", text(&p))).expect("a camera");
        let camera = &imported.rig.cameras()[0];
        let k = Matrix3::new(500.0, 2.0, 320.0, 0.0, 400.0, 240.0, 0.0, 0.0, 1.0);
        assert!((camera.intrinsics() - k).amax() < 1e-9);
        assert!((camera.rotation() - Matrix3::new(0., -1., 0., 1., 0., 0., 0., 0., 1.)).amax() < 1e-12);
        assert!((camera.translation_m() - Vector3::new(1.0, 2.0, 4.0)).amax() < 1e-9);
        assert_eq!(camera.name(), "view.7.P");
    }

    proptest! {
        #[test]
        fn points_land_where_p_puts_them(
            turn in prop::array::uniform3(-1.5..1.5f64), points in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), 9),
            scale in prop::sample::select(vec![-7.0, -1e-3, 1e-3, 1.0, 2e4]), skew in -3.0..3.0f64,
        ) {
            let k = Matrix3::new(900.0, skew, 310.0, 0.0, 870.0, 250.0, 0.0, 0.0, 1.0);
            let r = matrix_from_rodrigues(&Vector3::from(turn));
            let t = Vector3::new(0.1, -0.2, 4.0);
            let mut rt = Matrix3x4::zeros();
            rt.fixed_columns_mut::<3>(0).copy_from(&r);
            rt.set_column(3, &t);
            let p = k * rt * scale;
            let imported = import("c", text(&p)).expect("a camera");
            for point in points {
                let image = p * Vector4::new(point[0], point[1], point[2], 1.0);
                let expected = Point2::new(image.x / image.z, image.y / image.z);
                let found = imported.rig.cameras()[0].project(&Point3::from(point)).expect("in front");
                prop_assert!((found - expected).norm() < 1e-6, "{found} not {expected}");
            }
        }
    }

    #[test]
    fn texts_that_are_no_matrix_are_refused() {
        let message = |text: &str| import("p.txt", text.to_owned()).expect_err("refused").to_string();
        let tail = "expected twelve finite numbers, a 3 x 4 matrix";
        assert_eq!(message("1 2 3"), format!("p.txt: P: found 3 numbers, {tail}"));
        assert_eq!(message("1 2 3 x"), format!("p.txt: P: found \"x\", {tail}"));
        assert_eq!(message(&"NaN ".repeat(12)), format!("p.txt: P: found NaN, {tail}"));
        assert!(message(&"1 ".repeat(12)).contains("expected an invertible left 3 x 3"));
    }

    #[test]
    fn a_pose_alone_is_no_projection_matrix() {
        for text in ["1 0 0 0\n0 1 0 0\n0 0 1 3\n", "0 2 0 0.5\n-2 0 0 0.2\n0 0 -2 3\n"] {
            let found = import("cam1.txt", text.to_owned()).expect_err("no camera matrix").to_string();
            assert!(found.starts_with("cam1.txt: P: found a rotation and a translation [R t]"), "{found}");
        }
    }

    #[test]
    fn twelve_numbers_in_other_lines_are_no_projection_matrix() {
        for text in ["1 0 0\n0 1 0\n0 0 1\n0 0 3\n", "1 2\n3 4\n5 6\n7 8\n9 1\n2 3\n", &"1\n".repeat(12)] {
            let found = import("cam1.txt", text.to_owned()).expect_err("another form").to_string();
            assert!(
                found.starts_with("cam1.txt: P: found lines of ") && found.contains("three lines of four"),
                "{found}"
            );
        }
    }

    #[test]
    fn a_rotation_printed_with_few_digits_is_replaced_with_a_warning() {
        let r = matrix_from_rodrigues(&Vector3::new(0.3, 0.2, -0.4)).map(|x| (x * 1e4).round() * 1e-4);
        let placement = Placement { file: "f", key: "R", name: "c", size: (640, 480) };
        let k = Matrix3::new(500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0);
        let mut warnings = Vec::new();
        let camera = placed(&placement, k, [0.0; 5], &r, Vector3::zeros(), &mut warnings).expect("a camera");
        assert!((camera.rotation() - r).amax() < 1e-4 && warnings.len() == 1, "{warnings:?}");
        assert!(placed(&placement, k, [0.0; 5], &(r * 1.1), Vector3::zeros(), &mut warnings).is_err());
    }
}
