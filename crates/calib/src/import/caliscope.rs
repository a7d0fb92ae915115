//! Caliscope's own `camera_array.toml`: sections `[cameras.0]`, rotation matrices, metres, world to camera.
//! Its exports name camera 0 `cam_0`; so do we.

use hull::Camera;
use hull::lens_model::{LENS_COEFFICIENTS, five_coefficients};
use hull::rig::check_camera_words;
use nalgebra::{Matrix3, Vector3};
use toml::{Table, Value};

use super::natural_order::natural_key;
use super::projection::{Placement, placed};
use super::{ImportError, TextFile};

/// The cameras of such a file; `None` if it is another one. Cameras that the file says to ignore, and those without a
/// pose, are left out with a warning.
pub(super) fn rig(file: &TextFile, warnings: &mut Vec<String>) -> Result<Option<Vec<Camera>>, ImportError> {
    let Ok(table) = file.text.parse::<Table>() else { return Ok(None) };
    let Some(Value::Table(sections)) = table.get("cameras") else { return Ok(None) };
    if !sections.values().any(Value::is_table) {
        return Ok(None);
    }
    let mut sections: Vec<(&String, &Value)> = sections.iter().collect();
    sections.sort_by_cached_key(|(name, _)| natural_key(name));
    let mut cameras = Vec::new();
    for (number, section) in sections {
        let Value::Table(keys) = section else { continue };
        let section = Section { file, name: format!("cameras.{number}"), keys };
        if let Some(reason) = section.left_out() {
            warnings.push(format!("{}: [{}] left out, {reason}", file.path, section.name));
            continue;
        }
        section.check_id(number)?;
        cameras.push(section.camera(&format!("cam_{number}"), warnings)?);
    }
    let is_camera = |value: &Value| value.as_table().is_some_and(|keys| keys.contains_key("matrix"));
    if let Some((key, _)) = table.iter().find(|(key, value)| *key != "cameras" && is_camera(value)) {
        let found = "a camera beside sections [cameras.0] and so on";
        return Err(ImportError::key(&file.path, key, found, "all cameras in sections of one form"));
    }
    if cameras.is_empty() {
        return Err(ImportError::key(&file.path, "cameras", "no camera with a pose", "a calibrated camera"));
    }
    Ok(Some(cameras))
}

struct Section<'a> {
    file: &'a TextFile,
    name: String,
    keys: &'a Table,
}

impl Section<'_> {
    fn left_out(&self) -> Option<&'static str> {
        let is_empty = |key| match self.keys.get(key) {
            None => true,
            Some(Value::String(text)) => {
                text.is_empty() || text.eq_ignore_ascii_case("none") || text == "null"
            }
            Some(Value::Array(values)) => values.is_empty(),
            Some(_) => false,
        };
        if self.keys.get("ignore") == Some(&Value::Boolean(true)) {
            return Some("ignore is true");
        }
        (is_empty("rotation") && is_empty("translation")).then_some("it has no pose")
    }

    /// An error if the number in the camera's keys is not that of its section: either may be the camera's.
    fn check_id(&self, number: &str) -> Result<(), ImportError> {
        for key in ["cam_id", "camera_id", "port"] {
            let said = match self.keys.get(key) {
                Some(Value::Integer(said)) => said.to_string(),
                Some(Value::String(said)) => said.clone(),
                _ => continue,
            };
            if said != number && said != format!("cam_{number}") {
                return Err(self.wrong(key, "the number of its section"));
            }
        }
        Ok(())
    }

    fn camera(&self, name: &str, warnings: &mut Vec<String>) -> Result<Camera, ImportError> {
        let file = self.file.path.as_str();
        for (key, value) in self.keys {
            check_camera_words(key, value).map_err(|error| {
                let key = format!("{} {key}", self.name);
                ImportError::LensModel { file: file.to_owned(), key, error }
            })?;
        }
        let size = self.numbers("size", &[2], "[width, height] in whole pixels")?;
        if size.iter().any(|side| side.fract() != 0.0 || !(1.0..1e6).contains(side)) {
            return Err(self.wrong("size", "[width, height] in whole pixels"));
        }
        let k = Matrix3::from_row_slice(&self.numbers("matrix", &[9], "three rows of three numbers")?);
        let lens = self.numbers("distortions", &[0, 1, 2, 3, 4, 5, 8, 12, 14], LENS_COEFFICIENTS)?;
        let lens = five_coefficients(&lens).ok_or_else(|| self.wrong("distortions", LENS_COEFFICIENTS))?;
        let translation =
            Vector3::from_row_slice(&self.numbers("translation", &[3], "three numbers, metres")?);
        let rotation = self.numbers("rotation", &[9, 3], "three rows of three numbers")?;
        let size = (size[0] as u32, size[1] as u32);
        if rotation.len() == 3 {
            let rotation = Vector3::from_row_slice(&rotation);
            return Camera::new(name, size, k, lens, rotation, translation)
                .map_err(|error| ImportError::camera(file, error));
        }
        let placement = Placement { file, key: "rotation", name, size };
        placed(&placement, k, lens, &Matrix3::from_row_slice(&rotation), translation, warnings)
    }

    /// The numbers of a list, or of a list of rows.
    fn numbers(&self, key: &str, counts: &[usize], expected: &'static str) -> Result<Vec<f64>, ImportError> {
        let mut numbers = Vec::new();
        let is_list =
            matches!(self.keys.get(key), Some(list @ Value::Array(_)) if add_numbers(list, &mut numbers));
        if is_list && counts.contains(&numbers.len()) { Ok(numbers) } else { Err(self.wrong(key, expected)) }
    }

    fn wrong(&self, key: &str, expected: &'static str) -> ImportError {
        let found = self.keys.get(key).map_or_else(|| "nothing".to_owned(), ToString::to_string);
        ImportError::key(&self.file.path, &format!("[{}] {key}", self.name), found, expected)
    }
}

/// Whether a value is a number or a list of these, which are added.
fn add_numbers(value: &Value, numbers: &mut Vec<f64>) -> bool {
    match value {
        Value::Integer(number) => numbers.push(*number as f64),
        Value::Float(number) => numbers.push(*number),
        Value::Array(values) => return values.iter().all(|value| add_numbers(value, numbers)),
        _ => return false,
    }
    true
}

#[cfg(test)]
mod tests {
    use super::super::{ImportOptions, Imported, from_aniposelib};
    use super::*;

    const TEXT: &str = "[cameras.10]\ncam_id = 10\nrotation_count = 0\nignore = false\nsize = [640, 480]\n\
        matrix = [[500.0, 0.0, 320.0], [0.0, 510.0, 240.0], [0.0, 0.0, 1.0]]\n\
        distortions = [-0.1, 0.0, 0.0, 0.0, 0.0]\ntranslation = [0.1, 0.2, 3.0]\n\
        rotation = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]\n";

    fn import(text: &str) -> Result<Imported, ImportError> {
        let file = TextFile { path: "camera_array.toml".to_owned(), text: text.to_owned() };
        from_aniposelib(&file, &ImportOptions::default())
    }

    #[test]
    fn cameras_are_read_in_the_order_of_their_numbers() {
        let second =
            TEXT.replace("10]", "2]").replace("cam_id = 10", "cam_id = 2").replace("0.1, 0.2", "1.1, 0.2");
        let third = TEXT.replace("[cameras.10]", "[cameras.3]").replace("ignore = false", "ignore = true");
        let imported = import(&format!("{TEXT}\n{second}\n{third}")).expect("a rig");
        let names: Vec<&str> = imported.rig.cameras().iter().map(Camera::name).collect();
        assert_eq!(names, ["cam_2", "cam_10"]);
        let camera = &imported.rig.cameras()[1];
        assert_eq!((camera.translation_m().x, camera.rotation()[(1, 0)].round()), (0.1, 1.0));
        assert_eq!(imported.warnings, ["camera_array.toml: [cameras.3] left out, ignore is true"]);
    }

    #[test]
    fn a_number_that_is_not_that_of_the_section_is_refused() {
        let found = import(&TEXT.replace("cam_id = 10", "cam_id = 3")).expect_err("two numbers").to_string();
        assert_eq!(
            found,
            "camera_array.toml: [cameras.10] cam_id: found 3, expected the number of its section"
        );
    }

    #[test]
    fn a_camera_in_a_section_of_another_form_is_not_lost() {
        let found = import(&format!("{TEXT}\n{}", TEXT.replace("[cameras.10]", "[cam_5]")));
        let found = found.expect_err("cam_5 is lost").to_string();
        assert!(found.contains("cam_5: found a camera beside sections [cameras.0]"), "{found}");
    }

    #[test]
    fn what_is_missing_or_of_another_lens_is_named() {
        let message =
            |from: &str, to: &str| import(&TEXT.replace(from, to)).expect_err("refused").to_string();
        let found = message("ignore = false", "fisheye = true");
        assert!(
            found.starts_with("camera_array.toml: cameras.10 fisheye: found true, expected the pinhole"),
            "{found}"
        );
        for other in
            ["distortion_model = [\"fisheye\"]", "fisheye_distortions = [0.1, 0.2]", "optics = { xi = 1.2 }"]
        {
            assert!(message("ignore = false", other).contains("expected the pinhole"), "{other}");
        }
        let found = message("matrix = [[500.0, ", "matrix = [[");
        assert!(found.starts_with("camera_array.toml: [cameras.10] matrix: found "), "{found}");
        let found = message("translation =", "#").replace("rotation", "");
        assert!(found.contains("[cameras.10] translation: found nothing"), "{found}");
    }
}
