//! The rig: named cameras in one world frame, and the TOML file that aniposelib, Pose2Sim and
//! Caliscope share. Cameras count in file order. Reading never turns or scales a rig.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use nalgebra::{Matrix3, Vector3};
use thiserror::Error;
use toml::{Table, Value};

use crate::calibration_words::{Contradiction, check_convention, check_takes_part, check_unit};
use crate::camera::{Camera, CameraError};
use crate::lens_model::{
    LENS_COEFFICIENTS, UnknownLensModel, check_camera_lens_model, check_general_lens_model, five_coefficients,
};
use crate::text::{MAX_MESSAGE_CHARS, MAX_QUOTED_CHARS, shortened, without_mark};

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
    /// A key that names another lens model than k1 k2 p1 p2 k3.
    #[error("[{section}] {key}: {error}")]
    LensModel {
        /// The section; `file` outside sections.
        section: String,
        /// The key in it.
        key: String,
        /// What is wrong.
        error: UnknownLensModel,
    },
    /// A key that says that lengths, poses or the calibration itself are others than those that are read.
    #[error("[{section}] {key}: {error}")]
    Contradiction {
        /// The section; `file` outside sections.
        section: String,
        /// The key in it.
        key: String,
        /// What is wrong.
        error: Contradiction,
    },
    /// Another program's file of cameras in a table of their own.
    #[error(
        "[cameras]: found Caliscope's camera_array.toml, expected sections with name, size, matrix, distortions, \
         rotation, translation: convert it with `hulltouch rig import`"
    )]
    Caliscope,
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
        /// Number of cameras.
        found: usize,
    },
    /// A name that would not be one line of a message.
    #[error("camera name {0:?}, expected printable characters")]
    Name(String),
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
        let is_name = |name: &str| !name.is_empty() && !name.contains(char::is_control);
        if let Some(wrong) = cameras.iter().find(|camera| !is_name(camera.name())) {
            return Err(RigError::Name(shortened(wrong.name(), MAX_QUOTED_CHARS)));
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

    /// Reads a rig file's text. Lengths are metres.
    pub fn from_toml(text: &str) -> Result<Rig, RigError> {
        let table = parsed(text)?;
        check_scalars(&table, &check_unit)?;
        Rig::from_table(&table)
    }

    /// Reads a rig file's text whatever unit of length it names: translations are in that unit.
    pub fn from_toml_in_file_unit(text: &str) -> Result<Rig, RigError> {
        Rig::from_table(&parsed(text)?)
    }

    fn from_table(table: &Table) -> Result<Rig, RigError> {
        check_scalars(table, &check_convention)?;
        let mut cameras = Vec::new();
        for (section, value) in table {
            let Value::Table(keys) = value else {
                check_general(section, "file", value)?;
                continue;
            };
            if section == "metadata" {
                for (key, value) in keys {
                    check_general(key, section, value)?;
                }
                continue;
            }
            if section == "cameras" && keys.values().any(Value::is_table) {
                return Err(RigError::Caliscope);
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
    for (key, value) in keys {
        check_camera_words(key, value).map_err(in_section(&section, key))?;
    }
    check_scalars_of(keys, &section, &check_takes_part)?;
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
    let distortion = list(keys.get("distortions"))
        .and_then(|given| five_coefficients(&given))
        .ok_or_else(|| wrong("distortions", keys.get("distortions"), LENS_COEFFICIENTS))?;
    check_one_lens(&section, keys, &distortion)?;
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
    .and_then(|camera| camera.check_image().map(|()| camera))
    .map_err(|error| RigError::Camera { section: section.clone(), error })
}

/// An error for lens coefficients under another key than `distortions` that are not zero and not the same.
fn check_one_lens(section: &str, keys: &Table, read: &[f64; 5]) -> Result<(), RigError> {
    const LISTS: [&str; 9] = [
        "distortion",
        "dist",
        "distcoeffs",
        "distcoeff",
        "distortioncoefficients",
        "distortioncoeffs",
        "lensdistortion",
        "kc",
        "d",
    ];
    /// Printed digits, as a share.
    const ROUNDED: f64 = 1e-3;
    for (key, value) in keys {
        let name = key.to_lowercase().replace(['_', '-'], "");
        let found = numbers_in(value);
        let place = ["k1", "k2", "p1", "p2", "k3"].iter().position(|known| *known == name);
        let is_beyond = ["k4", "k5", "k6"].contains(&name.as_str());
        let is_list = value.is_array() || value.is_table() || name != "d";
        let pairs: Vec<(f64, f64)> = match (place, name.as_str()) {
            _ if !found.iter().any(|&number| number != 0.0) => continue,
            (Some(place), _) => vec![(found[0], read[place])],
            (None, "radial") => found.iter().copied().zip([read[0], read[1], read[4]]).collect(),
            (None, "tangential") => found.iter().copied().zip([read[2], read[3]]).collect(),
            (None, list) if LISTS.contains(&list) && is_list => {
                let five = five_coefficients(&found).unwrap_or([f64::INFINITY; 5]);
                five.into_iter().zip(*read).collect()
            }
            _ if is_beyond => vec![(found[0], 0.0)],
            _ => continue,
        };
        let is_read = |&(found, read): &(f64, f64)| (found - read).abs() <= ROUNDED * read.abs();
        if !pairs.iter().all(is_read) {
            let found = shortened(&value.to_string(), MAX_QUOTED_CHARS);
            let expected = "all lens coefficients under `distortions`, k1 k2 p1 p2 k3";
            return Err(RigError::Contradiction {
                section: section.to_owned(),
                key: shortened(key, MAX_QUOTED_CHARS),
                error: Contradiction { found, expected },
            });
        }
    }
    Ok(())
}

/// All numbers of a value, in lists in lists and in tables too, and those of a text that holds numbers alone.
fn numbers_in(value: &Value) -> Vec<f64> {
    match value {
        Value::Float(number) => vec![*number],
        Value::Integer(number) => vec![*number as f64],
        Value::Array(values) => values.iter().flat_map(numbers_in).collect(),
        Value::Table(values) => values.values().flat_map(numbers_in).collect(),
        Value::String(text) => {
            let words = text.split([' ', ',']).filter(|word| !word.is_empty());
            words.map(|word| word.parse().ok()).collect::<Option<Vec<f64>>>().unwrap_or_default()
        }
        Value::Boolean(_) | Value::Datetime(_) => Vec::new(),
    }
}

/// The tables of a rig file's text.
fn parsed(text: &str) -> Result<Table, RigError> {
    let text = without_mark(text);
    text.parse().map_err(|error: toml::de::Error| {
        let line = error.span().map_or(1, |span| text[..span.start].matches('\n').count() + 1);
        RigError::Toml(format!("line {line}: {}", shortened(error.message(), MAX_MESSAGE_CHARS)))
    })
}

/// An error if a word or single number at the top, in `[metadata]` or in a camera's section contradicts how the file is read.
pub fn check_scalars(
    table: &Table,
    check: &dyn Fn(&str, &str) -> Result<(), Contradiction>,
) -> Result<(), RigError> {
    check_scalars_of(table, "", check)
}

fn is_camera(keys: &Table) -> bool {
    ["matrix", "rotation", "translation"].iter().any(|key| keys.contains_key(*key))
}

fn check_scalars_of(
    keys: &Table,
    section: &str,
    check: &dyn Fn(&str, &str) -> Result<(), Contradiction>,
) -> Result<(), RigError> {
    for (key, value) in keys {
        let word = match value {
            Value::Table(inner) if key == "metadata" || key == "cameras" || is_camera(inner) => {
                let section = if section.is_empty() { key.clone() } else { format!("{section}.{key}") };
                check_scalars_of(inner, &section, check)?;
                continue;
            }
            Value::Array(_) | Value::Table(_) => continue,
            Value::String(word) => word.clone(),
            single => single.to_string(),
        };
        check(key, &word).map_err(|error| RigError::Contradiction {
            section: shortened(if section.is_empty() { "file" } else { section }, MAX_QUOTED_CHARS),
            key: shortened(key, MAX_QUOTED_CHARS),
            error,
        })?;
    }
    Ok(())
}

/// An error if a key of a camera speaks of another lens model, in a word, a list, or a table in it.
pub fn check_camera_words(key: &str, value: &Value) -> Result<(), UnknownLensModel> {
    if let Value::Table(inner) = value {
        inner.iter().try_for_each(|(key, value)| check_camera_words(key, value))?;
    }
    check_words(value, &mut |word| check_camera_lens_model(key, word))
}

/// Hands the words and single numbers of a value to `check`: those of lists and tables too.
fn check_words(
    value: &Value,
    check: &mut impl FnMut(&str) -> Result<(), UnknownLensModel>,
) -> Result<(), UnknownLensModel> {
    match value {
        Value::String(text) => check(text),
        Value::Array(values) => values.iter().try_for_each(|value| check_words(value, check)),
        Value::Table(values) => values.values().try_for_each(|value| check_words(value, check)),
        single => check(&single.to_string()),
    }
}

fn in_section(section: &str, key: &str) -> impl FnOnce(UnknownLensModel) -> RigError {
    let (section, key) = (section.to_owned(), shortened(key, MAX_QUOTED_CHARS));
    move |error| RigError::LensModel { section, key, error }
}

/// A key outside the cameras' sections.
fn check_general(key: &str, section: &str, value: &Value) -> Result<(), RigError> {
    check_words(value, &mut |word| check_general_lens_model(key, word)).map_err(in_section(section, key))
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
mod tests;
