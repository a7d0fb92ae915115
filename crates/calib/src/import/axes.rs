//! The last step of every import: metres, and +Y up.

use std::str::FromStr;

use hull::{Camera, Rig};
use nalgebra::Matrix3;
use thiserror::Error;

use super::{ImportError, ImportOptions, Imported, room};

/// An axis of the source's world, with its sign.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// Along +x.
    PlusX,
    /// Along −x.
    MinusX,
    /// Along +y.
    PlusY,
    /// Along −y.
    MinusY,
    /// Along +z.
    PlusZ,
    /// Along −z.
    MinusZ,
}

/// Text that names no axis.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("found {0:?}, expected an axis: x, y, z, +x, +y, +z, -x, -y or -z")]
pub struct UnknownAxis(String);

impl FromStr for Axis {
    type Err = UnknownAxis;

    fn from_str(text: &str) -> Result<Axis, UnknownAxis> {
        Ok(match text.to_ascii_lowercase().as_str() {
            "x" | "+x" => Axis::PlusX,
            "-x" => Axis::MinusX,
            "y" | "+y" => Axis::PlusY,
            "-y" => Axis::MinusY,
            "z" | "+z" => Axis::PlusZ,
            "-z" => Axis::MinusZ,
            _ => return Err(UnknownAxis(text.to_owned())),
        })
    }
}

impl Axis {
    /// The rotation that takes the source's world to one with this axis along +Y: a quarter or half turn
    /// about x, for ±x about z.
    pub fn rig_from_source(self) -> Matrix3<f64> {
        match self {
            Axis::PlusX => Matrix3::new(0., -1., 0., 1., 0., 0., 0., 0., 1.),
            Axis::MinusX => Matrix3::new(0., 1., 0., -1., 0., 0., 0., 0., 1.),
            Axis::PlusY => Matrix3::identity(),
            Axis::MinusY => Matrix3::new(1., 0., 0., 0., -1., 0., 0., 0., -1.),
            Axis::PlusZ => Matrix3::new(1., 0., 0., 0., 0., 1., 0., -1., 0.),
            Axis::MinusZ => Matrix3::new(1., 0., 0., 0., 0., -1., 0., 1., 0.),
        }
    }
}

/// Scales and turns cameras of the source's world and unit; `unit_m` is the format's own unit.
pub(super) fn finished(
    file: &str,
    cameras: Vec<Camera>,
    unit_m: f64,
    options: &ImportOptions,
    mut warnings: Vec<String>,
) -> Result<Imported, ImportError> {
    let scale = options.scale.unwrap_or(unit_m);
    if !(scale.is_finite() && scale > 0.0) {
        let expected = "a number above zero, metres";
        return Err(ImportError::Option { option: "scale", found: scale.to_string(), expected });
    }
    let turn = options.up.filter(|&up| up != Axis::PlusY).map(Axis::rig_from_source);
    let is_one_of_many = cameras.len() > 1;
    let cameras = cameras
        .into_iter()
        .map(|camera| {
            let name = camera.name().to_owned();
            let (size, k) = ((camera.width(), camera.height()), *camera.intrinsics());
            let (lens, translation_m) = (camera.lens().coefficients(), camera.translation_m() * scale);
            match turn {
                Some(turn) => {
                    let rotation = camera.rotation() * turn.transpose();
                    Camera::from_matrices(camera.name(), size, k, lens, &rotation, translation_m)
                }
                // Without a turn the Rodrigues vector keeps its bits.
                None => Camera::new(camera.name(), size, k, lens, *camera.rotation_rad(), translation_m),
            }
            .and_then(|camera| camera.check_image().map(|()| camera))
            .map_err(|error| {
                let place = if is_one_of_many { format!("{file}: camera {name}") } else { file.to_owned() };
                ImportError::camera(&place, error)
            })
        })
        .collect::<Result<Vec<Camera>, ImportError>>()?;
    room::check(file, &cameras, &turn.unwrap_or_else(Matrix3::identity), &mut warnings)?;
    let rig = Rig::new(cameras).map_err(|error| ImportError::Rig { file: file.to_owned(), error })?;
    Ok(Imported { rig, warnings })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn every_axis_turns_to_plus_y_without_mirroring() {
        for (text, axis) in [
            ("x", Vector3::x()),
            ("-x", -Vector3::x()),
            ("+y", Vector3::y()),
            ("-y", -Vector3::y()),
            ("Z", Vector3::z()),
            ("-z", -Vector3::z()),
        ] {
            let turn = text.parse::<Axis>().expect("an axis").rig_from_source();
            assert_eq!(turn * axis, Vector3::y(), "{text}");
            assert_eq!(turn.determinant(), 1.0, "{text}");
        }
        assert_eq!("+z".parse::<Axis>(), Ok(Axis::PlusZ));
        assert_eq!(
            "up".parse::<Axis>().expect_err("no axis").to_string(),
            "found \"up\", expected an axis: x, y, z, +x, +y, +z, -x, -y or -z"
        );
    }

    #[test]
    fn a_turned_and_scaled_camera_sees_turned_and_scaled_points_on_the_same_pixel() {
        let k = Matrix3::new(500.0, 0.0, 320.0, 0.0, 510.0, 240.0, 0.0, 0.0, 1.0);
        let (turn_rad, move_mm) = (Vector3::new(1.2, -0.4, 0.3), Vector3::new(200.0, -100.0, 4000.0));
        let source =
            Camera::new("c", (640, 480), k, [-0.1, 0.0, 0.0, 0.0, 0.0], turn_rad, move_mm).expect("ok");
        let point_mm = nalgebra::Point3::new(300.0, 150.0, 600.0);
        let options = ImportOptions { up: Some(Axis::PlusZ), scale: Some(0.001), ..Default::default() };
        let imported = finished("f", vec![source.clone()], 1.0, &options, Vec::new()).expect("a rig");
        // (x, y, z) with z up is (x, z, −y) with y up.
        let point_m = nalgebra::Point3::new(0.3, 0.6, -0.15);
        let (a, b) = (source.project(&point_mm), imported.rig.cameras()[0].project(&point_m));
        assert!((a.expect("seen") - b.expect("seen")).norm() < 1e-9);
        let bad = ImportOptions { scale: Some(0.0), ..Default::default() };
        assert!(matches!(
            finished("f", vec![source], 1.0, &bad, Vec::new()),
            Err(ImportError::Option { .. })
        ));
    }
}
