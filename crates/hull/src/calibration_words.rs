//! What a calibration file says in words about its lengths, its poses and its own success. Rigs are in metres, with
//! poses from world to camera as Rodrigues vectors or matrices. A file that says otherwise is refused.

use thiserror::Error;

use crate::text::{MAX_QUOTED_CHARS, shortened};

/// A key that contradicts what is read.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("found {found}, expected {expected}")]
pub struct Contradiction {
    /// What stands under the key.
    pub found: String,
    /// What is read.
    pub expected: &'static str,
}

const UNIT_KEYS: [&str; 20] = [
    "unit",
    "units",
    "lengthunit",
    "lengthunits",
    "worldunit",
    "worldunits",
    "translationunit",
    "translationunits",
    "unitlength",
    "distanceunit",
    "distanceunits",
    "unitoflength",
    "tvecunit",
    "tvecunits",
    "tunit",
    "tunits",
    "positionunit",
    "positionunits",
    "poseunit",
    "poseunits",
];
/// Units that are read as they are: metres, and those of images and angles.
const KNOWN_UNITS: [&str; 12] =
    ["", "si", "m", "meter", "meters", "metre", "metres", "px", "pixel", "pixels", "rad", "radians"];
/// Names of poses from camera to world.
const CAMERA_TO_WORLD: [&str; 7] =
    ["cameratoworld", "camera2world", "cam2world", "camtoworld", "c2w", "worldfromcamera", "worldfromcam"];
/// Names of poses from world to camera.
const WORLD_TO_CAMERA: [&str; 7] =
    ["worldtocamera", "world2camera", "world2cam", "worldtocam", "w2c", "camerafromworld", "camfromworld"];
/// Keys of a flag that turns poses round.
const INVERSE_KEYS: [&str; 5] = ["inverse", "inverted", "invert", "poseinverse", "poseinverted"];
/// Keys of whether the world is right-handed.
const HANDEDNESS_KEYS: [&str; 5] = [
    "handedness",
    "worldhandedness",
    "coordinatehandedness",
    "coordinatesystemhandedness",
    "systemhandedness",
];
/// Keys of how matrices are written.
const ORDER_KEYS: [&str; 5] = ["matrixorder", "storageorder", "elementorder", "memoryorder", "order"];
/// Programs whose camera axes differ from OpenCV's.
const OTHER_AXES: [&str; 2] = ["opengl", "blender"];
/// Parts of keys whose values are conventions of poses.
const CONVENTION_KEY_PARTS: [&str; 7] =
    ["convention", "coordinate", "pose", "extrinsic", "transform", "direction", "format"];
/// Words for rotations that are angles about axes or quaternions.
const OTHER_ROTATIONS: [&str; 8] = ["euler", "quat", "rpy", "yaw", "xyz", "zyx", "zxy", "degree"];
const EULER_KEYS: [&str; 5] = ["rotationorder", "eulerorder", "rotorder", "eulerangles", "eulersequence"];
const ROTATION_KEYS: [&str; 6] =
    ["rotationtype", "rottype", "rotationformat", "rotationrepresentation", "rotationmodel", "rotationform"];
const SUCCESS_KEYS: [&str; 10] = [
    "calibrated",
    "valid",
    "success",
    "successful",
    "converged",
    "isextrinsicscalibrated",
    "poseestimated",
    "ok",
    "solved",
    "calibrationok",
];
/// Keys of how a calibration ended. Their numbers are passed over: 0 is success to some programs.
const STATUS_KEYS: [&str; 2] = ["status", "calibrationstatus"];
/// Keys that say that a camera takes part, and that it is left out.
const TAKES_PART_KEYS: [&str; 5] = ["enabled", "active", "use", "used", "inuse"];
const LEFT_OUT_KEYS: [&str; 7] = ["ignore", "ignored", "disable", "disabled", "exclude", "excluded", "skip"];
/// A longer text is no word of a convention.
const MAX_WORD_BYTES: usize = 40;

/// Names and words in lower case without blanks, quotes, brackets, `_` and `-`.
fn plain(text: &str) -> String {
    let kept = text.chars().filter(|c| !c.is_whitespace() && !"_-\"'[]()".contains(*c));
    kept.flat_map(char::to_lowercase).collect()
}

/// A flag that is off, in words or as a number: OpenCV writes `0.`.
fn says_no(word: &str) -> bool {
    word.parse() == Ok(0.0) || ["false", "no", "off", "n"].contains(&word) || says_failed(word)
}

fn says_failed(word: &str) -> bool {
    const FAILED: [&str; 12] = [
        "failed",
        "fail",
        "failure",
        "error",
        "bad",
        "invalid",
        "rejected",
        "notconverged",
        "diverged",
        "uncalibrated",
        "notcalibrated",
        "pending",
    ];
    FAILED.contains(&word)
}

/// A flag that is on, in words or as a number.
fn says_yes(word: &str) -> bool {
    word.parse() == Ok(1.0) || ["true", "yes", "on", "y"].contains(&word)
}

/// Whether a flag is one of these names, perhaps with `is` or `has` before it.
fn is_flag_of(key: &str, names: &[&str]) -> bool {
    let bare = ["is", "has"].iter().find_map(|prefix| key.strip_prefix(prefix)).unwrap_or(key);
    names.contains(&key) || names.contains(&bare)
}

/// An error for a unit of length that is not the metre.
pub fn check_unit(key: &str, value: &str) -> Result<(), Contradiction> {
    // "m, rad" and "meter (m)" name the length first.
    let word = plain(value.split([',', '(']).next().unwrap_or(value));
    let is_one = word.parse::<f64>() == Ok(1.0);
    if !UNIT_KEYS.contains(&plain(key).as_str()) || is_one || KNOWN_UNITS.contains(&word.as_str()) {
        return Ok(());
    }
    contradiction(value, "metres, or `rig import` with --scale and the unit in metres (mm: --scale 0.001)")
}

/// An error for poses in another convention than world to camera and Rodrigues, and for a calibration that says that
/// it failed.
pub fn check_convention(key: &str, value: &str) -> Result<(), Contradiction> {
    let (key, word) = (plain(key), plain(value));
    let is_convention = CONVENTION_KEY_PARTS.iter().any(|part| key.contains(part));
    let is_short = value.len() < MAX_WORD_BYTES;
    let names_pose = |name: &str| word.contains(name) && (name != "c2w" || word == "c2w");
    let is_word = word != "c2w" && CAMERA_TO_WORLD.contains(&word.as_str());
    let is_turned =
        is_word || is_convention && CAMERA_TO_WORLD.iter().chain(&OTHER_AXES).any(|name| names_pose(name));
    let is_said = !["", "none", "null", "~"].contains(&word.as_str()) && !says_no(&word);
    let is_flag = is_flag_of(&key, &CAMERA_TO_WORLD) && is_said
        || is_flag_of(&key, &WORLD_TO_CAMERA) && says_no(&word)
        || is_flag_of(&key, &INVERSE_KEYS) && says_yes(&word);
    if is_short && (is_turned || is_flag) {
        return contradiction(value, "a pose from world to camera: x_camera = R x_world + T");
    }
    let is_other = |word: &str| OTHER_ROTATIONS.iter().any(|other| word.contains(other));
    if HANDEDNESS_KEYS.contains(&key.as_str()) && ["left", "lefthanded", "lh", "lhs"].contains(&word.as_str())
    {
        return contradiction(value, "a right-handed world");
    }
    const COLUMNS: [&str; 6] = ["col", "column", "columns", "colmajor", "columnmajor", "columnwise"];
    if ORDER_KEYS.contains(&key.as_str()) && COLUMNS.contains(&word.as_str()) {
        return contradiction(value, "matrices row by row");
    }
    let is_euler = EULER_KEYS.contains(&key.as_str()) && is_said
        || ROTATION_KEYS.contains(&key.as_str()) && is_other(&word);
    if is_euler {
        return contradiction(value, "a Rodrigues vector or a 3 x 3 matrix, no angles about axes");
    }
    let has_failed = is_flag_of(&key, &SUCCESS_KEYS) && says_no(&word)
        || STATUS_KEYS.contains(&key.as_str()) && says_failed(&word);
    if has_failed {
        return contradiction(value, "a calibration that succeeded: remove the camera, or calibrate it");
    }
    Ok(())
}

/// An error for a key among those of one camera that says that it takes no part.
pub fn check_takes_part(key: &str, value: &str) -> Result<(), Contradiction> {
    let (key, word) = (plain(key), plain(value));
    let is_out = is_flag_of(&key, &TAKES_PART_KEYS) && says_no(&word)
        || is_flag_of(&key, &LEFT_OUT_KEYS) && says_yes(&word);
    if is_out {
        return contradiction(value, "a camera that takes part: remove it from the file");
    }
    Ok(())
}

/// Whether a key says that images were turned, mirrored or cut, and its value that they were.
pub fn changes_images(key: &str, value: &str) -> bool {
    const KEYS: [&str; 19] = [
        "rotationcount",
        "rotate",
        "rotated",
        "rotatedegrees",
        "imagerotation",
        "viewrotation",
        "flip",
        "flipped",
        "fliph",
        "flipv",
        "mirrored",
        "crop",
        "cropped",
        "roix",
        "roiy",
        "roi",
        "binning",
        "binningx",
        "binningy",
    ];
    let (key, word) = (plain(key), plain(value));
    let is_none = word.is_empty() || says_no(&word) || ["none", "null", "{}"].contains(&word.as_str());
    let is_one_to_one = key.starts_with("binning") && word.parse::<f64>() == Ok(1.0);
    let is_zeros = word.chars().all(|c| "0.,".contains(c));
    KEYS.contains(&key.as_str()) && !is_none && !is_one_to_one && !is_zeros
}

fn contradiction(found: &str, expected: &'static str) -> Result<(), Contradiction> {
    let found = shortened(found.trim_matches(['"', '\'']), MAX_QUOTED_CHARS);
    Err(Contradiction { found, expected })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_that_are_not_metres_are_refused() {
        for word in ["mm", "\"cm\"", "feet", "millimeters", "Inch", "0.001"] {
            assert!(check_unit("units", word).is_err(), "{word}");
        }
        assert!(check_unit("tvec_unit", "mm").is_err());
        let read =
            [("units", "m"), ("unit", "Metres"), ("unit", "[m]"), ("units", "m, rad"), ("unit", "1.0")];
        for (key, word) in read.into_iter().chain([("units", "pixels"), ("board_unit", "mm")]) {
            assert_eq!(check_unit(key, word), Ok(()), "{key} {word}");
        }
    }

    #[test]
    fn other_conventions_and_failures_are_refused() {
        for (key, word) in [
            ("pose_convention", "camera_to_world"),
            ("convention", "opengl"),
            ("pose", "c2w"),
            ("R_type", "cam2world"),
            ("cam_to_world", "true"),
            ("c2w", "1"),
            ("rotation_order", "xyz"),
            ("rotation_type", "euler_xyz"),
            ("rotation_type", "quaternion"),
            ("calibrated", "false"),
            ("valid", "0"),
            ("success", "False"),
            ("world_to_camera", "false"),
            ("is_world_to_camera", "0"),
            ("is_camera_to_world", "true"),
            ("inverse", "true"),
            ("handedness", "left"),
            ("coordinate_handedness", "\"left-handed\""),
            ("matrix_order", "column-major"),
            ("status", "failed"),
            ("status", "not_calibrated"),
            ("ok", "false"),
            ("valid", "0."),
            ("has_converged", "0"),
        ] {
            assert!(check_convention(key, word).is_err(), "{key} {word}");
        }
        for (key, word) in [
            ("calibrated", "true"),
            ("valid", "1"),
            ("rotation_type", "rodrigues"),
            ("rotation_format", "3x3 matrix"),
            ("cam_to_world", "false"),
            ("pose_convention", "world_to_camera"),
            ("program", "blender"),
            ("name", "mac_2_west"),
            ("serial", "AC2W-01"),
            ("rotation_type", "angle_axis"),
            ("rotation_type", "so3"),
            ("rotation_order", "none"),
            ("cam_to_world", ""),
            ("rvec", "[0.1, 0.2, 0.3]"),
            ("world_to_camera", "true"),
            ("inverse", "0"),
            ("handedness", "right"),
            ("matrix_order", "row-major"),
            ("inverse", "0."),
            ("inverse", "null"),
            ("inverse", "[1, 0, 0, 0, 1, 0, 0, 0, 1]"),
            ("matrix_order", "color"),
            ("subject_handedness", "left"),
            ("status", "ok"),
            ("status", "0"),
            ("registered", "0"),
        ] {
            assert_eq!(check_convention(key, word), Ok(()), "{key} {word}");
        }
    }

    #[test]
    fn a_camera_that_takes_no_part_is_refused() {
        for (key, word) in [
            ("enabled", "false"),
            ("is_active", "0."),
            ("use", "no"),
            ("exclude", "true"),
            ("disabled", "1."),
            ("ignore", "yes"),
        ] {
            assert!(check_takes_part(key, word).is_err(), "{key} {word}");
        }
        for (key, word) in
            [("enabled", "true"), ("skip", "3"), ("use", ""), ("ignore", "0"), ("exclude", "[]")]
        {
            assert_eq!(check_takes_part(key, word), Ok(()), "{key} {word}");
        }
    }

    #[test]
    fn changes_of_images_are_known() {
        for (key, word) in
            [("rotation_count", "1"), ("image_rotation", "90"), ("flip", "true"), ("roi_x", "320")]
        {
            assert!(changes_images(key, word), "{key} {word}");
        }
        for (key, word) in [
            ("rotation_count", "0"),
            ("flip", "false"),
            ("roi_x", "0"),
            ("binning_x", "1.0"),
            ("crop", "[0, 0, 0, 0]"),
            ("rms", "45"),
        ] {
            assert!(!changes_images(key, word), "{key} {word}");
        }
    }
}
