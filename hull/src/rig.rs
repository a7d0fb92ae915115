//! The rig: named cameras in one world frame, and the TOML file that aniposelib, Pose2Sim and
//! Caliscope share. Cameras count in file order. Reading never turns or scales a rig.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use nalgebra::{Matrix3, Vector3};
use thiserror::Error;
use toml::{Table, Value};

use crate::camera::{Camera, CameraError};
use crate::text::{MAX_MESSAGE_CHARS, MAX_QUOTED_CHARS, shortened};

/// The most cameras of a rig: their places travel in 16 bits, and no room has a quarter as many.
pub const MAX_CAMERAS: usize = 1024;

/// The calibrated cameras of one room.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    cameras: Vec<Camera>,
}

/// Why a rig file was refused.
#[derive(Debug, Error)]
pub enum RigError {
    /// Not TOML.
    #[error("not a TOML file: {0}")]
    Toml(String),
    /// A key is missing or has the wrong form.
    #[error("[{section}] {key}: found {found}, expected {expected}")]
    Key {
        /// The camera's section.
        section: String,
        /// The key in it.
        key: &'static str,
        /// What stands there.
        found: String,
        /// What should.
        expected: &'static str,
    },
    /// A camera's numbers make no camera.
    #[error("[{section}] {error}")]
    Camera {
        /// The camera's section.
        section: String,
        /// What is wrong.
        error: CameraError,
    },
    /// More cameras than a rig may have.
    #[error("{found} cameras, expected at most {MAX_CAMERAS}")]
    TooMany {
        /// How many.
        found: usize,
    },
    /// Two cameras share a name.
    #[error("camera name {0:?} is used twice, expected unique names")]
    Duplicate(String),
    /// No camera at all.
    #[error("no camera found, expected sections with name, size, matrix, distortions, rotation, translation")]
    Empty,
}

impl Rig {
    /// A rig of at least one camera and at most [`MAX_CAMERAS`], with unique names.
    pub fn new(cameras: Vec<Camera>) -> Result<Rig, RigError> {
        if cameras.is_empty() {
            return Err(RigError::Empty);
        }
        if cameras.len() > MAX_CAMERAS {
            return Err(RigError::TooMany { found: cameras.len() });
        }
        let mut names = BTreeSet::new();
        if let Some(twice) = cameras.iter().find(|camera| !names.insert(camera.name())) {
            return Err(RigError::Duplicate(shortened(twice.name(), MAX_QUOTED_CHARS)));
        }
        Ok(Rig { cameras })
    }

    /// The cameras in file order.
    pub fn cameras(&self) -> &[Camera] {
        &self.cameras
    }

    /// The place of the camera of that name.
    pub fn index_of(&self, name: &str) -> Option<usize> {
        self.cameras.iter().position(|camera| camera.name() == name)
    }

    /// Reads a rig file's text.
    pub fn from_toml(text: &str) -> Result<Rig, RigError> {
        let table: Table = text.parse().map_err(|error: toml::de::Error| {
            let line = error.span().map_or(1, |span| text[..span.start].matches('\n').count() + 1);
            RigError::Toml(format!("line {line}: {}", shortened(error.message(), MAX_MESSAGE_CHARS)))
        })?;
        let mut cameras = Vec::new();
        for (section, value) in &table {
            let Value::Table(keys) = value else { continue };
            if section == "metadata" {
                continue;
            }
            cameras.push(camera_from_section(section, keys)?);
        }
        Rig::new(cameras)
    }

    /// The rig file's text; reading it back gives the same rig, bit for bit.
    pub fn to_toml(&self) -> String {
        let mut text = String::new();
        for (index, camera) in self.cameras.iter().enumerate() {
            let row = |r: usize| numbers(camera.intrinsics().row(r).iter());
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "[cam_{index}]\nname = {}\nsize = [ {}, {} ]\nmatrix = [ {}, {}, {} ]\ndistortions = {}\n\
                 rotation = {}\ntranslation = {}\nfisheye = false\n",
                Value::String(camera.name().to_owned()),
                camera.width(),
                camera.height(),
                row(0),
                row(1),
                row(2),
                numbers(camera.lens().coefficients().iter()),
                numbers(camera.rotation_rad().iter()),
                numbers(camera.translation_m().iter()),
            );
        }
        text.push_str("[metadata]\nadjusted = false\nerror = 0.0\n");
        text
    }
}

fn numbers<'a>(values: impl Iterator<Item = &'a f64>) -> String {
    // `{:?}` prints the shortest text that reads back as the same bits.
    let texts: Vec<String> = values.map(|value| format!("{value:?}")).collect();
    format!("[ {} ]", texts.join(", "))
}

fn camera_from_section(section: &str, keys: &Table) -> Result<Camera, RigError> {
    let section = shortened(section, MAX_QUOTED_CHARS);
    let wrong = |key: &'static str, value: Option<&Value>, expected: &'static str| RigError::Key {
        section: section.clone(),
        key,
        found: value.map_or_else(|| "nothing".to_owned(), |it| shortened(&it.to_string(), MAX_QUOTED_CHARS)),
        expected,
    };
    let name = match keys.get("name") {
        Some(Value::String(name)) if !name.is_empty() => name.clone(),
        other => return Err(wrong("name", other, "a camera name")),
    };
    if let Some(value @ Value::Boolean(true)) = keys.get("fisheye") {
        return Err(wrong("fisheye", Some(value), "false: only the k1 k2 p1 p2 k3 lens model is known"));
    }
    let size = vector::<2>(keys.get("size"))
        .filter(|size| size.iter().all(|&side| side >= 0.0 && side.fract() == 0.0 && side < 1e6))
        .ok_or_else(|| wrong("size", keys.get("size"), "[width, height] in whole pixels"))?;
    let rows = match keys.get("matrix") {
        Some(Value::Array(rows)) if rows.len() == 3 => {
            rows.iter().map(|row| vector::<3>(Some(row))).collect::<Option<Vec<_>>>()
        }
        _ => None,
    }
    .ok_or_else(|| wrong("matrix", keys.get("matrix"), "three rows of three numbers"))?;
    let matrix = Matrix3::from_fn(|r, c| rows[r][c]);
    let mut distortion = [0.0; 5];
    let given = list(keys.get("distortions"))
        .filter(|given| given.len() <= 5)
        .ok_or_else(|| wrong("distortions", keys.get("distortions"), "up to five numbers k1 k2 p1 p2 k3"))?;
    distortion[..given.len()].copy_from_slice(&given);
    let rotation = vector::<3>(keys.get("rotation"))
        .ok_or_else(|| wrong("rotation", keys.get("rotation"), "a Rodrigues vector of three numbers"))?;
    let translation = vector::<3>(keys.get("translation"))
        .ok_or_else(|| wrong("translation", keys.get("translation"), "three numbers, metres"))?;
    Camera::new(
        name,
        (size[0] as u32, size[1] as u32),
        matrix,
        distortion,
        Vector3::from(rotation),
        Vector3::from(translation),
    )
    .map_err(|error| RigError::Camera { section: section.clone(), error })
}

fn list(value: Option<&Value>) -> Option<Vec<f64>> {
    let number = |value: &Value| match value {
        Value::Float(number) => Some(*number),
        Value::Integer(number) => Some(*number as f64),
        _ => None,
    };
    value?.as_array()?.iter().map(number).collect()
}

fn vector<const N: usize>(value: Option<&Value>) -> Option<[f64; N]> {
    list(value)?.try_into().ok()
}

#[cfg(test)]
mod tests {
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
        check_refused("\"ant\"", "\"zebra\"", "camera name \"zebra\" is used twice, expected unique names");
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
            "[cam_9] fisheye: found true, expected false: only the k1 k2 p1 p2 k3 lens model is known",
        );
        check_refused(
            "rotation = [",
            "rotation = ",
            "not a TOML file: line 7: unexpected key or value, expected newline, `#`",
        );
    }
}
