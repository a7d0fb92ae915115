//! Qualisys `.qca.txt`: XML, millimetres, camera positions and a matrix Q whose first row is r11 r12
//! r13; x_camera = diag(1, −1, −1) Q (X − C). Focal lengths and principal points are in 1/64 pixel; the
//! lens coefficients are not, whatever some converters do to them.

use hull::Camera;
use hull::lens_model::{check_general_lens_model, check_lens_model};
use hull::rotation::rotation_defect;
use nalgebra::{Matrix3, Vector3};

use super::projection::{Placement, ROUNDED, placed};
use super::xml::{self, Element};
use super::{ImportError, ImportOptions, Imported, TextFile, axes, size_of};

const SUBPIXELS: f64 = 64.0;
const MILLIMETRE: f64 = 0.001;
const CALIBRATED: &str = "a calibrated camera: calibrate it, or mark it calibrated=\"false\" to leave it out";

/// Reads a Qualisys calibration. Cameras that are not active or not calibrated are left out, with a warning;
/// what the program leaves in place of a calibration is an error.
pub fn from_qualisys(file: &TextFile, options: &ImportOptions) -> Result<Imported, ImportError> {
    let root = xml::parse(file)?;
    let list = root.child("cameras").filter(|_| root.name == "calibration").ok_or_else(|| {
        ImportError::syntax(file, 1, &format!("<{}>", root.name), "<calibration> with <cameras>")
    })?;
    let mut warnings = Vec::new();
    let mut cameras = Vec::new();
    check_units(file, &root, list, options)?;
    for (index, element) in list.children.iter().filter(|child| child.name == "camera").enumerate() {
        let name = element.attribute("serial").map_or_else(|| format!("camera{}", index + 1), str::to_owned);
        let says_no = |key| attribute(element, key).is_some_and(|text| !is_yes(text));
        let reason = match (says_no("active"), says_no("calibrated")) {
            (true, _) => Some("not active"),
            (_, true) => Some("not calibrated"),
            _ => None,
        };
        if let Some(reason) = reason {
            warnings.push(format!("{}: camera {name} is {reason}, left out", file.path));
            continue;
        }
        if let Some(turn) = element.attribute("viewrotation").filter(|&turn| turn != "0") {
            warnings.push(format!(
                "{}: camera {name} has viewrotation {turn}: the calibration is for pictures as the sensor sees \
                 them, unturned",
                file.path
            ));
        }
        let source = Source { file, name: &name, element };
        source.check_single()?;
        source.check_lens_model(&root)?;
        cameras.push(source.camera(options, &mut warnings)?);
    }
    if cameras.is_empty() {
        let found = if warnings.is_empty() { "no camera" } else { "no camera that is active and calibrated" };
        return Err(ImportError::key(&file.path, "cameras", found, "at least one calibrated camera"));
    }
    axes::finished(&file.path, cameras, MILLIMETRE, options, warnings)
}

/// An error for a unit other than the program's own, and for a second list of cameras.
fn check_units(
    file: &TextFile,
    root: &Element,
    list: &Element,
    options: &ImportOptions,
) -> Result<(), ImportError> {
    let named =
        |element: &Element| attribute(element, "units").or(attribute(element, "unit")).map(str::to_owned);
    let unit = named(root).or_else(|| named(list)).map(|unit| unit.trim().to_lowercase());
    let is_known = |unit: &String| unit == "mm" || unit.starts_with("millimet");
    if let Some(unit) = unit.filter(|unit| !is_known(unit) && options.scale.is_none()) {
        let expected = "millimetres, or the scale of this unit in metres";
        return Err(ImportError::key(&file.path, "units", unit, expected));
    }
    if root.children.iter().filter(|child| child.name == "cameras").count() > 1 {
        return Err(ImportError::key(&file.path, "cameras", "two lists", "one list of cameras"));
    }
    Ok(())
}

/// "true", "1" or "yes", in capitals or not. All else, an empty text too, does not say that a camera is calibrated.
fn is_yes(text: &str) -> bool {
    ["1", "true", "yes", "on"].contains(&text.trim().to_ascii_lowercase().as_str())
}

/// An attribute whose name may be in capitals.
fn attribute<'a>(element: &'a Element, name: &str) -> Option<&'a str> {
    element.attributes.iter().find(|(key, _)| key.eq_ignore_ascii_case(name)).map(|(_, value)| value.as_str())
}

/// One camera's element.
struct Source<'a> {
    file: &'a TextFile,
    name: &'a str,
    element: &'a Element,
}

impl Source<'_> {
    /// An error for a second pose, lens or field of one camera.
    fn check_single(&self) -> Result<(), ImportError> {
        for part in ["transform", "intrinsic", "fov_video", "fov_marker"] {
            let count = self.element.children.iter().filter(|child| child.name == part).count();
            if count > 1 {
                let key = format!("camera {} {part}", self.name);
                return Err(ImportError::key(&self.file.path, &key, format!("{count} of them"), "one"));
            }
        }
        Ok(())
    }

    /// An error if an attribute speaks of another lens, or a coefficient that is not read is not zero.
    fn check_lens_model(&self, root: &Element) -> Result<(), ImportError> {
        let shown = |key: &str| format!("camera {} {key}", self.name);
        let intrinsic = self.element.child("intrinsic");
        let of_lens = intrinsic.map_or(&[][..], |element| element.attributes.as_slice());
        // `model` and `type` of the camera are those of the device.
        let of_device = self.element.attributes.iter().chain(&root.attributes);
        let checked = of_lens.iter().map(|(key, value)| (key, value, check_lens_model(key, value)));
        let general = of_device.map(|(key, value)| (key, value, check_general_lens_model(key, value)));
        for (key, _, result) in checked.chain(general) {
            result.map_err(|error| ImportError::LensModel {
                file: self.file.path.clone(),
                key: shown(key),
                error,
            })?;
        }
        const READ: [&str; 5] = [
            "radialDistortion1",
            "radialDistortion2",
            "radialDistortion3",
            "tangentalDistortion1",
            "tangentalDistortion2",
        ];
        let more = of_lens.iter().find(|(key, value)| {
            let name = key.to_ascii_lowercase();
            name.contains("distortion")
                && !READ.contains(&key.as_str())
                && name.ends_with(|c: char| c.is_ascii_digit())
                && value.trim().parse() != Ok(0.0)
        });
        match more {
            Some((key, value)) => {
                let expected = "zero: only radialDistortion1 to 3 and tangentalDistortion1 and 2 are known";
                Err(ImportError::key(&self.file.path, &shown(key), format!("{value:?}"), expected))
            }
            None => Ok(()),
        }
    }

    /// An error for the zeros that stand in place of a calibration.
    fn check_calibrated(
        &self,
        q: &Matrix3<f64>,
        centre: &Vector3<f64>,
        k: &Matrix3<f64>,
    ) -> Result<(), ImportError> {
        let wrong = |key: &str, found: String, expected| {
            let key = format!("camera {} {key}", self.name);
            Err(ImportError::key(&self.file.path, &key, found, expected))
        };
        if q.amax() == 0.0 {
            return wrong("transform", "a rotation of zeros".to_owned(), CALIBRATED);
        }
        if *centre == Vector3::zeros() {
            return wrong("transform", "the position 0 0 0".to_owned(), CALIBRATED);
        }
        let finite = q.iter().chain(centre).chain(k).all(|number| number.is_finite());
        if !finite {
            return wrong("transform and intrinsic", "a number that is not finite".to_owned(), CALIBRATED);
        }
        let defect = rotation_defect(q);
        if q.determinant() > 0.0 && defect > ROUNDED {
            return wrong(
                "transform",
                format!("a matrix that is off from a rotation by {defect:.1e}"),
                CALIBRATED,
            );
        }
        if k[(0, 0)] <= 0.0 || k[(1, 1)] <= 0.0 {
            let found = format!("focal lengths {} and {} pixels", k[(0, 0)], k[(1, 1)]);
            return wrong("intrinsic focalLength", found, CALIBRATED);
        }
        Ok(())
    }

    fn camera(&self, options: &ImportOptions, warnings: &mut Vec<String>) -> Result<Camera, ImportError> {
        let transform = |key| self.number("transform", key);
        let q = Matrix3::new(
            transform("r11")?,
            transform("r12")?,
            transform("r13")?,
            transform("r21")?,
            transform("r22")?,
            transform("r23")?,
            transform("r31")?,
            transform("r32")?,
            transform("r33")?,
        );
        let centre = Vector3::new(transform("x")?, transform("y")?, transform("z")?);
        let rotation = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0)) * q;
        let lens = |key| self.number("intrinsic", key);
        let subpixels = |key| lens(key).map(|value| value / SUBPIXELS);
        let (left, top, size) = self.field(options, warnings)?;
        let origin = options.pixel_origin.unwrap_or(0.0);
        let k = Matrix3::new(
            subpixels("focalLengthU")?,
            self.optional("intrinsic", "skew")? / SUBPIXELS,
            subpixels("centerPointU")? - left - origin,
            0.0,
            subpixels("focalLengthV")?,
            subpixels("centerPointV")? - top - origin,
            0.0,
            0.0,
            1.0,
        );
        self.check_calibrated(&q, &centre, &k)?;
        // The format spells "tangental".
        let distortion = [
            lens("radialDistortion1")?,
            lens("radialDistortion2")?,
            lens("tangentalDistortion1")?,
            lens("tangentalDistortion2")?,
            self.optional("intrinsic", "radialDistortion3")?,
        ];
        let placement = Placement { file: &self.file.path, key: "transform", name: self.name, size };
        placed(&placement, k, distortion, &rotation, -(rotation * centre), warnings)
    }

    /// Left and top of the video's field on the sensor, and its size.
    fn field(
        &self,
        options: &ImportOptions,
        warnings: &mut Vec<String>,
    ) -> Result<(f64, f64, (u32, u32)), ImportError> {
        let field = ["fov_video", "fov_marker"].into_iter().find(|name| self.element.child(name).is_some());
        let Some(field) = field else {
            return Ok((0.0, 0.0, size_of(&self.file.path, None, options, warnings)?));
        };
        let side = |key| self.number(field, key);
        let (left, right, top, bottom) = (side("left")?, side("right")?, side("top")?, side("bottom")?);
        // The last column and row belong to the picture.
        let (width, height) = (right - left + 1.0, bottom - top + 1.0);
        let whole = |side: f64| side.fract() == 0.0 && (1.0..1e6).contains(&side);
        if !whole(width) || !whole(height) {
            let found = format!("{left}..{right} x {top}..{bottom}");
            let key = format!("camera {} {field}", self.name);
            return Err(ImportError::key(&self.file.path, &key, found, "a field of whole pixels"));
        }
        let size = size_of(&self.file.path, Some((width as u32, height as u32)), options, warnings)?;
        Ok((left, top, size))
    }

    /// A number that older files lack, which is 0 there.
    fn optional(&self, element: &str, key: &str) -> Result<f64, ImportError> {
        let found = self.element.child(element).and_then(|element| element.attribute(key));
        if found.is_some() { self.number(element, key) } else { Ok(0.0) }
    }

    fn number(&self, element: &str, key: &str) -> Result<f64, ImportError> {
        let value = self.element.child(element).and_then(|element| element.attribute(key));
        value.and_then(|text| text.trim().parse().ok()).ok_or_else(|| {
            let shown = format!("camera {} {element} {key}", self.name);
            let found = value.map_or_else(|| "nothing".to_owned(), |text| format!("{text:?}"));
            ImportError::key(&self.file.path, &shown, found, "a number")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    /// A camera 4 m up the y axis of a world with z up, looking back along −y: its x axis is −x of the
    /// world, its y axis (down) −z. So the rows of Q = diag(1, −1, −1) R are (−1 0 0), (0 0 1), (0 1 0).
    const TEXT: &str = r#"<?xml version='1.0' encoding='ASCII'?>
<calibration type="regular"><cameras>
<camera active="1" serial="left" viewrotation="0"><fov_video bottom="479" left="0" right="639" top="0"/>
<transform r11="-1" r12="0" r13="0" r21="0" r22="0" r23="1" r31="0" r32="1" r33="0" x="0" y="4000" z="1000"/>
<intrinsic centerPointU="20480" centerPointV="15360" focalLengthU="32000" focalLengthV="25600" skew="0"
 radialDistortion1="-0.1" radialDistortion2="0" radialDistortion3="0" tangentalDistortion1="0" tangentalDistortion2="0"/>
</camera><camera active="0" serial="broken"/></cameras></calibration>"#;

    fn import(text: &str) -> Result<Imported, ImportError> {
        let file = TextFile { path: "Calib.qca.txt".to_owned(), text: text.to_owned() };
        from_qualisys(&file, &ImportOptions::default())
    }

    #[test]
    fn a_point_lands_on_the_pixel_worked_by_hand() {
        let imported = import(TEXT).expect("a rig");
        let camera = &imported.rig.cameras()[0];
        // (0.4, 0, 1.8) m is 0.4 to the left, 0.8 above, 4 ahead: x/z = −0.1, y/z = −0.2, bend 0.995.
        let found = camera.project(&Point3::new(0.4, 0.0, 1.8)).expect("in front");
        let expected = nalgebra::Point2::new(320.0 - 500.0 * 0.0995, 240.0 - 400.0 * 0.199);
        assert!((found - expected).norm() < 1e-9, "{found}");
        assert_eq!((camera.name(), camera.width(), camera.height()), ("left", 640, 480));
        assert_eq!(imported.warnings, ["Calib.qca.txt: camera broken is not active, left out"]);
    }

    #[test]
    fn cameras_without_a_calibration_are_left_out_or_named() {
        let second = TEXT[TEXT.find("<camera active=\"1\"").expect("a camera")..].replace("left", "right");
        for (key, no) in [
            ("calibrated", "false"),
            ("calibrated", "FALSE"),
            ("calibrated", "0"),
            ("calibrated", ""),
            ("calibrated", "n"),
            ("calibrated", "failed"),
            ("Calibrated", "False"),
        ] {
            let marked = second.replacen("active=\"1\"", &format!("active=\"1\" {key}=\"{no}\""), 1);
            let marked = marked.replace("4000", "4400");
            let text = TEXT.replace(
                "</cameras></calibration>",
                &marked.replace(
                    "fov_video bottom=\"479\" right=\"0\" right",
                    "fov_video bottom=\"479\" left=\"0\" right",
                ),
            );
            let imported = import(&text).expect("a rig");
            assert_eq!(imported.rig.cameras().len(), 1);
            assert_eq!(imported.warnings[1], "Calib.qca.txt: camera right is not calibrated, left out");
        }
        let message =
            |from: &str, to: &str| import(&TEXT.replacen(from, to, 1)).expect_err("refused").to_string();
        let none = message("active=\"1\"", "active=\"1\" calibrated=\"false\"");
        assert!(none.contains("found no camera that is active and calibrated"), "{none}");
        let zeros = message(
            "r11=\"-1\" r12=\"0\" r13=\"0\" r21=\"0\" r22=\"0\" r23=\"1\" r31=\"0\" r32=\"1\"",
            "r11=\"0\" r12=\"0\" r13=\"0\" r21=\"0\" r22=\"0\" r23=\"0\" r31=\"0\" r32=\"0\"",
        );
        assert!(zeros.contains("camera left transform: found a rotation of zeros"), "{zeros}");
        let origin = message("y=\"4000\" z=\"1000\"", "y=\"0\" z=\"0\"");
        assert!(origin.contains("camera left transform: found the position 0 0 0"), "{origin}");
        let focal = message("focalLengthU=\"32000\"", "focalLengthU=\"0\"");
        assert!(
            focal.contains("camera left intrinsic focalLength: found focal lengths 0 and 400"),
            "{focal}"
        );
    }

    #[test]
    fn numbers_that_older_files_lack_are_zero_and_unreadable_ones_are_refused() {
        assert!(
            import(&TEXT.replacen(" radialDistortion3=\"0\"", "", 1).replacen(" skew=\"0\"", "", 1)).is_ok()
        );
        for (from, to, key) in [
            ("skew=\"0\"", "skew=\"0,5\"", "skew: found \"0,5\""),
            ("radialDistortion3=\"0\"", "radialDistortion3=\"-0,03\"", "radialDistortion3: found \"-0,03\""),
        ] {
            let message = import(&TEXT.replacen(from, to, 1)).expect_err(to).to_string();
            assert!(
                message.contains(&format!("camera left intrinsic {key}, expected a number")),
                "{message}"
            );
        }
    }

    #[test]
    fn another_lens_is_refused() {
        let message = |from: &str, to: &str| import(&TEXT.replacen(from, to, 1)).expect_err(to).to_string();
        for (from, to) in [
            ("skew=", "fisheye=\"true\" skew="),
            ("skew=", "radialDistortion4=\"0.01\" skew="),
            ("type=\"regular\"", "type=\"fisheye\""),
            ("serial=\"left\"", "serial=\"left\" lens_type=\"fisheye\""),
        ] {
            assert!(message(from, to).starts_with("Calib.qca.txt: camera left "), "{to}");
        }
        assert!(
            import(&TEXT.replacen("serial=\"left\"", "serial=\"left\" model=\"Miqus Hybrid\"", 1)).is_ok()
        );
    }

    #[test]
    fn a_cropped_field_moves_the_principal_point() {
        let imported = import(&TEXT.replace("left=\"0\" right=\"639\"", "left=\"100\" right=\"539\""));
        let rig = imported.expect("a rig").rig;
        assert_eq!((rig.cameras()[0].width(), rig.cameras()[0].intrinsics()[(0, 2)]), (440, 220.0));
    }

    #[test]
    fn what_is_missing_or_mirrored_is_named() {
        let message = |from, to| import(&TEXT.replacen(from, to, 1)).expect_err("refused").to_string();
        assert_eq!(
            message("r21=\"0\"", "r21=\"o\""),
            "Calib.qca.txt: camera left transform r21: found \"o\", expected a number"
        );
        assert_eq!(
            message("focalLengthU", "focal"),
            "Calib.qca.txt: camera left intrinsic focalLengthU: found nothing, expected a number"
        );
        let mirrored = message("r11=\"-1\"", "r11=\"1\"");
        assert!(
            mirrored.starts_with("Calib.qca.txt: found a mirrored world (transform of camera left"),
            "{mirrored}"
        );
        assert!(message("<cameras>", "<cams>").contains("Calib.qca.txt: line"));
        let twice = message("<transform", "<transform x=\"0\"/><transform");
        assert!(twice.contains("camera left transform: found 2 of them, expected one"), "{twice}");
    }
}
