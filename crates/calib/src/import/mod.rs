//! Other programs' calibration files to rigs: metres, OpenCV camera axes, pixel centres at integers.
//!
//! [`import`] reads a file or a folder. The functions behind it take texts and are pure. Every format
//! ends in the same place: cameras of the source's world and unit, then [`ImportOptions`] scales them to
//! metres and, if the axis that points up is given, turns them to +Y up.

mod axes;
mod caliscope;
mod entry;
mod folder;
mod kind;
mod names;
mod natural_order;
mod opencv;
mod projection;
mod qualisys;
mod refit;
mod room;
mod scan;
mod svoboda;
mod xml;
mod yaml;

use std::iter;
use std::str::FromStr;

use hull::calibration_words::{changes_images, check_convention, check_unit};
use hull::lens_model::UnknownLensModel;
use hull::rig::check_scalars;
use hull::text::{MAX_MESSAGE_CHARS, MAX_QUOTED_CHARS, shortened, without_mark};
use hull::{Camera, CameraError, Rig, RigError};
use nalgebra::Matrix3;
use thiserror::Error;
use toml::{Table, Value};

use crate::file::ReadError;

pub use axes::{Axis, UnknownAxis};
pub use folder::{detect, import};
pub use opencv::from_opencv;
pub use projection::from_matrices;
pub use qualisys::from_qualisys;
pub use svoboda::from_svoboda;

/// A text file with the path that messages and camera names are taken from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TextFile {
    /// The path, with `/` between folders; for files of a folder, relative to that folder.
    pub path: String,
    /// What it holds.
    pub text: String,
}

/// The known formats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// OpenCV FileStorage, XML or YAML: one file, or a folder of one file (or folder) per camera.
    OpenCv,
    /// Qualisys `.qca.txt` (XML).
    Qualisys,
    /// The rig TOML of aniposelib, Pose2Sim, FreeMoCap and Caliscope: Hulltouch's own.
    Aniposelib,
    /// A folder of Svoboda's MultiCamSelfCal.
    Svoboda,
    /// Plain 3×4 projection matrices: one text file per camera.
    Matrices,
}

impl Format {
    /// All formats, in the order in which they are looked for.
    pub const ALL: [Format; 5] =
        [Format::Aniposelib, Format::Qualisys, Format::OpenCv, Format::Svoboda, Format::Matrices];

    /// The name on a command line.
    pub fn name(self) -> &'static str {
        match self {
            Format::OpenCv => "opencv",
            Format::Qualisys => "qualisys",
            Format::Aniposelib => "aniposelib",
            Format::Svoboda => "svoboda",
            Format::Matrices => "matrices",
        }
    }
}

/// Text that names no format.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("found {0:?}, expected a format: opencv, qualisys, aniposelib, svoboda or matrices")]
pub struct UnknownFormat(String);

impl FromStr for Format {
    type Err = UnknownFormat;

    fn from_str(text: &str) -> Result<Format, UnknownFormat> {
        let found = Format::ALL.into_iter().find(|format| format.name() == text);
        found.ok_or_else(|| UnknownFormat(text.to_owned()))
    }
}

/// What a source file does not say about itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImportOptions {
    /// Which axis of the source's world points up; the rig is turned to +Y up. `None` keeps the axes.
    pub up: Option<Axis>,
    /// The source's unit of length in metres. `None`: the format's own (Qualisys: millimetres), else 1.
    pub scale: Option<f64>,
    /// Image size, width and height in pixels, for sources that do not say it.
    pub size: Option<(u32, u32)>,
    /// The source's coordinates of the top left pixel's centre: 0 (OpenCV), 0.5 (OpenGL) or 1 (MATLAB).
    /// `None`: the format's own (MultiCamSelfCal: 1), else 0.
    pub pixel_origin: Option<f64>,
}

/// A rig and what its reader should know.
#[derive(Clone, Debug, PartialEq)]
pub struct Imported {
    /// The cameras, in metres.
    pub rig: Rig,
    /// One line each: guesses made, fits that failed in the source, values ignored.
    pub warnings: Vec<String>,
}

/// Why a calibration was not imported.
#[derive(Debug, Error)]
pub enum ImportError {
    /// A file or folder cannot be read.
    #[error("{file}: {error}")]
    Read {
        /// Its path, as it was given.
        file: String,
        /// What the system or the decoder says.
        error: ReadError,
    },
    /// The content is of no known format.
    #[error("{file}: found no calibration, expected {expected}")]
    Unknown {
        /// Which file or folder.
        file: String,
        /// What would do.
        expected: &'static str,
    },
    /// A folder holds no calibration that is read, and something that may be one.
    #[error("{file}: found no calibration that is read; {left_out}")]
    LeftOut {
        /// Path of the folder.
        file: String,
        /// The first file that was left out, and why.
        left_out: String,
    },
    /// A file is not even of its kind.
    #[error("{file}: line {line}: found {found}, expected {expected}")]
    Syntax {
        /// Path of the file.
        file: String,
        /// Where, from 1.
        line: usize,
        /// What stands there.
        found: String,
        /// What should.
        expected: &'static str,
    },
    /// A key is missing or holds the wrong thing.
    #[error("{file}: {key}: found {found}, expected {expected}")]
    Key {
        /// Path of the file.
        file: String,
        /// The key that is missing or wrong.
        key: String,
        /// What stands there.
        found: String,
        /// What should.
        expected: &'static str,
    },
    /// Two files contradict each other, or may be two versions of one camera.
    #[error("{one} and {other}: found {found}, expected {expected}")]
    Conflict {
        /// The one file.
        one: String,
        /// The other.
        other: String,
        /// What stands in them.
        found: String,
        /// What should.
        expected: &'static str,
    },
    /// The lens has another model than k1 k2 p1 p2 k3, or one that is not understood.
    #[error("{file}: {key}: {error}")]
    LensModel {
        /// Path of the file.
        file: String,
        /// The key of the lens model.
        key: String,
        /// What is wrong.
        error: UnknownLensModel,
    },
    /// The world is mirrored: no rotation and translation describe the camera.
    #[error(
        "{file}: found a mirrored world ({detail}), expected a right-handed one: swap two axes or negate \
         one in the points that the calibration was aligned to"
    )]
    Mirrored {
        /// Path of the file.
        file: String,
        /// The number that shows it.
        detail: String,
    },
    /// The numbers make no camera.
    #[error("{file}: {error}")]
    Camera {
        /// Path of the file.
        file: String,
        /// What is wrong.
        error: CameraError,
    },
    /// The cameras make no rig.
    #[error("{file}: {error}")]
    Rig {
        /// Which file or folder.
        file: String,
        /// What is wrong.
        error: RigError,
    },
    /// An option that makes no sense.
    #[error("option {option}: found {found}, expected {expected}")]
    Option {
        /// Its name, as on the command line.
        option: &'static str,
        /// What was given.
        found: String,
        /// What would do.
        expected: &'static str,
    },
}

impl ImportError {
    fn key(file: &str, key: &str, found: impl Into<String>, expected: &'static str) -> ImportError {
        let short = |text: &str| shortened(text, MAX_QUOTED_CHARS);
        ImportError::Key { file: file.to_owned(), key: short(key), found: short(&found.into()), expected }
    }

    fn conflict(one: &str, other: &str, found: impl Into<String>, expected: &'static str) -> ImportError {
        ImportError::Conflict { one: one.to_owned(), other: other.to_owned(), found: found.into(), expected }
    }

    fn syntax(file: &TextFile, line: usize, found: &str, expected: &'static str) -> ImportError {
        let found = shortened(found, MAX_MESSAGE_CHARS);
        ImportError::Syntax { file: file.path.clone(), line, found, expected }
    }

    fn camera(file: &str, error: CameraError) -> ImportError {
        ImportError::Camera { file: file.to_owned(), error }
    }
}

/// Reads a rig TOML of another program, Caliscope's own `camera_array.toml` too.
pub fn from_aniposelib(file: &TextFile, options: &ImportOptions) -> Result<Imported, ImportError> {
    let mut warnings = Vec::new();
    let refused = |error| ImportError::Rig { file: file.path.clone(), error };
    // Text that is no TOML is refused below.
    let table: Table = without_mark(&file.text).parse().unwrap_or_default();
    if options.scale.is_none() {
        check_scalars(&table, &check_unit).map_err(refused)?;
    }
    check_scalars(&table, &check_convention).map_err(refused)?;
    warn_of_changed_images(file, &table, &mut warnings);
    let read = match caliscope::rig(file, &mut warnings)? {
        Some(cameras) => Rig::new(cameras),
        None => Rig::from_toml_in_file_unit(&file.text),
    };
    let rig = read.map_err(refused)?;
    let shift = options.pixel_origin.unwrap_or(0.0);
    let cameras = rig
        .cameras()
        .iter()
        .map(|camera| {
            let k = from_origin(*camera.intrinsics(), shift);
            let size = (camera.width(), camera.height());
            let lens = camera.lens().coefficients();
            Camera::new(camera.name(), size, k, lens, *camera.rotation_rad(), *camera.translation_m())
                .map_err(|error| ImportError::camera(&file.path, error))
        })
        .collect::<Result<Vec<Camera>, ImportError>>()?;
    axes::finished(&file.path, cameras, 1.0, options, warnings)
}

/// A warning for each camera whose images were turned, mirrored or cut for another program.
fn warn_of_changed_images(file: &TextFile, table: &Table, warnings: &mut Vec<String>) {
    for (section, value) in table {
        let Value::Table(keys) = value else { continue };
        let inner =
            keys.iter().filter_map(|(key, value)| Some((format!("{section}.{key}"), value.as_table()?)));
        for (section, keys) in iter::once((section.clone(), keys)).chain(inner) {
            let changes = |(key, value): &(&String, &Value)| changes_images(key, &value.to_string());
            if let Some((key, value)) = keys.iter().find(changes) {
                warnings.push(format!(
                    "{}: [{section}] {}",
                    file.path,
                    changed_images(key, &value.to_string())
                ));
            }
        }
    }
}

/// The warning for a camera whose images were turned, mirrored or cut for another program.
fn changed_images(key: &str, value: &str) -> String {
    let short = |text: &str| shortened(text, MAX_QUOTED_CHARS);
    format!(
        "has {} {}: the calibration is read as one of images as the camera gives them",
        short(key),
        short(value)
    )
}

/// The size that the file says, or the option; the file wins, with a warning.
fn size_of(
    file: &str,
    said: Option<(u32, u32)>,
    options: &ImportOptions,
    warnings: &mut Vec<String>,
) -> Result<(u32, u32), ImportError> {
    match (said, options.size) {
        (Some(said), Some(given)) if said != given => {
            warnings.push(format!(
                "{file}: says {} x {}, the given size {} x {} is not used",
                said.0, said.1, given.0, given.1
            ));
            Ok(said)
        }
        (Some(said), _) => Ok(said),
        (None, Some(given)) => Ok(given),
        (None, None) => Err(ImportError::key(
            file,
            "image size",
            "nothing",
            "a width and a height in pixels: give the size",
        )),
    }
}

/// What messages about all cameras begin with: the one file, or that there are several.
fn place(files: &[TextFile]) -> &str {
    match files {
        [] => "no files",
        [file] => &file.path,
        _ => "the folder",
    }
}

/// A camera matrix whose top left pixel is (0, 0), of one that calls it (origin, origin).
fn from_origin(mut k: Matrix3<f64>, origin: f64) -> Matrix3<f64> {
    (k[(0, 2)], k[(1, 2)]) = (k[(0, 2)] - origin, k[(1, 2)] - origin);
    k
}

/// Numbers between blanks and commas; the error is the first word that is none.
fn numbers(text: &str) -> Result<Vec<f64>, &str> {
    text.split(|c: char| c.is_whitespace() || c == ',' || c == ';')
        .filter(|word| !word.is_empty())
        .map(|word| word.parse().map_err(|_| word))
        .collect()
}
