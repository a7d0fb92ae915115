//! What a calibration file says about its lens model in words. Only the pinhole with k1 k2 p1 p2 k3 is
//! known: reading the coefficients of another model as these moves rays by many pixels.

use thiserror::Error;

use crate::text::{MAX_QUOTED_CHARS, shortened};

/// A key that names another lens model, or one that is not understood.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("found {found}, expected the pinhole with k1 k2 p1 p2 k3 (plumb_bob, radtan, pinhole, false or 0)")]
pub struct UnknownLensModel {
    /// What stands under the key.
    pub found: String,
}

/// Values that mean the pinhole with k1 k2 p1 p2 k3, or no other model, in the form of [`plain`].
/// "rational polynomial" is judged by its coefficients: those beyond k3 must be zero.
const KNOWN: &[&str] = &[
    "",
    "0",
    "false",
    "no",
    "off",
    "none",
    "null",
    "default",
    "standard",
    "regular",
    "normal",
    "plumbbob",
    "radtan",
    "radialtangential",
    "radial",
    "pinhole",
    "pinholeradtan",
    "pinholebrown",
    "pinholecamera",
    "perspective",
    "rectilinear",
    "linear",
    "opencv",
    "opencv5",
    "pinholeopencv",
    "opencvpinhole",
    "brown",
    "brownconrady",
    "brownconradyopencv",
    "bouguet",
    "k1k2p1p2",
    "k1k2p1p2k3",
    "rationalpolynomial",
];
/// Key names that hold the name of a lens model and nothing else, in the form of [`plain`].
const MODEL_KEYS: &[&str] = &[
    "model",
    "type",
    "xi",
    "omni",
    "mirror",
    "cameramodel",
    "cameratype",
    "lens",
    "projection",
    "projectiontype",
    "modeltype",
    "modelname",
    "camtype",
    "distortionname",
    "distortionfunction",
    "calibrationmodel",
    "intrinsicsmodel",
    "intrinsicmodel",
    "intrinsicstype",
    "intrinsictype",
    "equi",
    "eucm",
    "ucm",
    "mei",
    "kb4",
    "kb8",
    "ocam",
    "ftheta",
];
/// Parts of key names that speak of a lens model.
const MODEL_KEY_PARTS: &[&str] = &[
    "fisheye",
    "omnidir",
    "equidistant",
    "kannala",
    "doublesphere",
    "lensmodel",
    "lenstype",
    "distortionmodel",
    "distortiontype",
    "distmodel",
    "disttype",
    "distortmodel",
    "projectionmodel",
    "camerageometry",
    "lensgeometry",
    "lensprojection",
    "lensdistortion",
    "lensfunction",
    "projectionfunction",
    "coefficientsmodel",
    "coeffsmodel",
    "distfunc",
    "distortionfunc",
    "rationalmodel",
    "scaramuzza",
    "meixi",
    "ucmalpha",
];
/// Words that name another model wherever a text of flags or of a kind holds them.
const FOREIGN: &[&str] = &[
    "fisheye",
    "omnidir",
    "omniradtan",
    "equidistant",
    "equidist",
    "equisolid",
    "equirect",
    "kannala",
    "kb4",
    "kb8",
    "eucm",
    "ucm",
    "doublesphere",
    "catadioptric",
    "scaramuzza",
    "ocam",
    "stereographic",
    "panoram",
    "spherical",
    "thinprism",
    "ftheta",
];

/// Words that name another model under whatever key of a camera they stand.
const FOREIGN_ANYWHERE: &[&str] = &[
    "fisheye",
    "omnidir",
    "omniradtan",
    "equidist",
    "equisolid",
    "kannala",
    "doublesphere",
    "catadioptric",
    "scaramuzza",
    "stereographic",
    "thinprism",
];

/// Keys of free text, in the form of [`plain`]: its words say nothing about the lens.
const FREE_KEYS: &[&str] = &[
    "name",
    "names",
    "cameras",
    "cameraname",
    "cameranames",
    "id",
    "cameraid",
    "serial",
    "label",
    "title",
    "author",
];

/// Parts of key names of free text.
const FREE_KEY_PARTS: &[&str] = &[
    "path",
    "file",
    "folder",
    "directory",
    "video",
    "image",
    "picture",
    "dataset",
    "session",
    "note",
    "comment",
    "description",
];

/// Keys of coefficients beyond k1 k2 p1 p2 k3, in the form of [`plain`].
const FURTHER_COEFFICIENTS: &[&str] = &["k4", "k5", "k6", "s1", "s2", "s3", "s4", "taux", "tauy"];

/// Key names under which a device's own model and kind stand too: refused is what speaks of another lens.
const DEVICE_KEYS: &[&str] = &["model", "type", "lens"];

/// Words in the names of matrices of another model.
const FOREIGN_TOKENS: &[&str] = &["omni", "equi", "eucm", "ucm", "mei", "kb", "kb4", "kb8"];

/// Names of other models that are parts of other words too.
const SHORT_FOREIGN: &[&str] = &["omni", "ds", "mei", "fov", "kb", "equi"];

/// In lower case, without blanks, quotes, `_`, `-` and `+`.
fn plain(text: &str) -> String {
    let dropped = |c: char| c.is_whitespace() || matches!(c, '_' | '-' | '+' | '"' | '\'' | '.' | ':');
    text.chars().filter(|&c| !dropped(c)).flat_map(char::to_lowercase).collect()
}

/// Whether a key's name says that it holds a lens model.
fn names_model(key: &str) -> bool {
    MODEL_KEYS.contains(&key) || MODEL_KEY_PARTS.iter().any(|part| key.contains(part)) || is_xi(key)
}

/// The mirror parameter of an omnidirectional camera, of one camera or of a pair: xi, xi1, xi_left.
fn is_xi(key: &str) -> bool {
    let bare = key.trim_end_matches(|c: char| c.is_ascii_digit());
    ["xi", "xileft", "xiright", "xil", "xir", "leftxi", "rightxi"].contains(&bare)
}

/// Whether a key holds free text or a value is a path: their words say nothing about the lens.
fn is_free(key: &str, value: &str) -> bool {
    FREE_KEYS.contains(&key)
        || FREE_KEY_PARTS.iter().any(|part| key.contains(part))
        || value.contains(['/', '\\'])
}

/// Whether the name of a map or matrix speaks of another lens model: `fisheye_D`, `K_omni`, `xi`.
pub fn names_other_lens(key: &str) -> bool {
    let name = plain(key);
    let mut tokens = key.split(|c: char| !c.is_ascii_alphanumeric());
    FOREIGN_ANYWHERE.iter().any(|foreign| name.contains(foreign))
        || is_xi(&name)
        || tokens.any(|token| FOREIGN_TOKENS.contains(&token.to_ascii_lowercase().as_str()))
}

/// An error if a camera's key speaks of a lens model that is not k1 k2 p1 p2 k3, or is not understood.
/// `value` is the text of a word or number; keys of other things are passed over.
pub fn check_lens_model(key: &str, value: &str) -> Result<(), UnknownLensModel> {
    let (name, word) = (plain(key), plain(value));
    let zero = value.trim().parse::<f64>().is_ok_and(|number| number == 0.0);
    let flags =
        name.contains("flag") || name.ends_with("kind") || name.ends_with("type") || name.ends_with("model");
    let holds = |words: &[&str]| words.iter().any(|foreign| word.contains(foreign));
    let foreign = (flags && holds(FOREIGN)) || (!is_free(&name, value) && holds(FOREIGN_ANYWHERE));
    let number = value.trim().parse::<f64>().is_ok();
    let further = number && !zero && FURTHER_COEFFICIENTS.contains(&name.as_str());
    if foreign || further || (names_model(&name) && !zero && !KNOWN.contains(&word.as_str())) {
        return Err(UnknownLensModel { found: shortened(value.trim(), MAX_QUOTED_CHARS) });
    }
    Ok(())
}

/// The same of a camera whose section also describes the device: `model = "acA1920"` and `type = "usb"` name no lens.
pub fn check_camera_lens_model(key: &str, value: &str) -> Result<(), UnknownLensModel> {
    if DEVICE_KEYS.contains(&plain(key).as_str()) {
        return check_general_lens_model(key, value);
    }
    check_lens_model(key, value)
}

/// The same of a file's general part, where `type` and `model` also name other things: refused is what
/// speaks of another lens.
pub fn check_general_lens_model(key: &str, value: &str) -> Result<(), UnknownLensModel> {
    let (name, word) = (plain(key), plain(value));
    let foreign =
        SHORT_FOREIGN.contains(&word.as_str()) || FOREIGN.iter().any(|foreign| word.contains(foreign));
    if MODEL_KEYS.contains(&name.as_str()) && !foreign {
        return Ok(());
    }
    check_lens_model(key, value)
}

/// What [`five_coefficients`] takes, for messages.
pub const LENS_COEFFICIENTS: &str = "1, 2, 4 or 5 numbers k1 k2 p1 p2 k3 (more only if they are zero)";

/// `k1 k2 p1 p2 k3` of coefficients in OpenCV's order; `None` where they say more or cannot be told apart:
/// three (k1 k2 k3 or k1 k2 p1) and those beyond the fifth must be zero.
pub fn five_coefficients(given: &[f64]) -> Option<[f64; 5]> {
    const MOST: usize = 14;
    let third_is_unclear = given.len() == 3 && given[2] != 0.0;
    if given.len() > MOST || third_is_unclear || given.iter().skip(5).any(|&more| more != 0.0) {
        return None;
    }
    let mut five = [0.0; 5];
    for (to, from) in five.iter_mut().zip(given) {
        *to = *from;
    }
    Some(five)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_models_are_refused_under_any_name() {
        for (key, value) in [
            ("fisheye_model", "1"),
            ("fisheye", "true"),
            ("fisheye", "\"true\""),
            ("is_fisheye", "yes"),
            ("distortion_model", "equidistant"),
            ("distortion_model", "\"fisheye\""),
            ("distortion_type", "KANNALA_BRANDT"),
            ("distortion_type", "1"),
            ("camera_model", "omni"),
            ("camera_model", "ds"),
            ("cameraModel", "eucm"),
            ("CameraModel", "something new"),
            ("model", "fov"),
            ("type", "OPENCV_FISHEYE"),
            ("lens-type", "f-theta"),
            ("projection", "equisolid"),
            ("projection_model", "pinhole-equi"),
            ("xi", "1.2"),
            ("calibration_flags", "+fix_skew +fisheye"),
            ("distortion", "equidistant"),
            ("calibration_method", "cv2.fisheye.calibrate"),
            ("optics", "fisheye"),
            ("lens_name", "GoPro fisheye"),
            ("omni", "true"),
            ("xi_1", "1.2"),
            ("k4", "0.3"),
            ("s1", "-0.1"),
        ] {
            assert!(check_lens_model(key, value).is_err(), "{key}: {value}");
        }
    }

    #[test]
    fn the_known_model_and_other_keys_pass() {
        for (key, value) in [
            ("fisheye_model", "0"),
            ("fisheye", "false"),
            ("fisheye", "False"),
            ("distortion_model", "plumb_bob"),
            ("distortion_type", "0"),
            ("camera_model", "PINHOLE"),
            ("camera_model", "Brown-Conrady"),
            ("model", "OPENCV"),
            ("xi", "0."),
            ("calibration_time", "Thu 09"),
            ("flags", "16384"),
            ("projection_matrix", "5"),
            ("name", "fisheye camera"),
            ("sensor_model", "OmniVision OV9281"),
            ("width", "640"),
            ("notes", "not a fisheye"),
            ("image_list", "fisheye_01.png"),
            ("taken_from", "/home/x/fisheye/1.png"),
            ("path_to_recorded_videos", "/home/x/fisheye_model/videos"),
            ("k4", "0"),
            ("K4", "500 0 320"),
        ] {
            assert_eq!(check_lens_model(key, value), Ok(()), "{key}: {value}");
        }
        assert_eq!(check_general_lens_model("type", "charuco"), Ok(()));
        assert!(check_general_lens_model("type", "fisheye").is_err());
        assert!(check_general_lens_model("model", "omni").is_err());
    }

    #[test]
    fn the_model_and_kind_of_a_device_pass() {
        for (key, value) in [("model", "acA1920"), ("type", "usb"), ("lens", "Fujinon 8mm"), ("model", "")] {
            assert_eq!(check_camera_lens_model(key, value), Ok(()), "{key}: {value}");
        }
        for (key, value) in [("model", "ds"), ("type", "fisheye"), ("model", "KB8"), ("camera_model", "new")]
        {
            assert!(check_camera_lens_model(key, value).is_err(), "{key}: {value}");
        }
    }

    #[test]
    fn names_of_matrices_and_maps_speak_of_another_lens() {
        for key in ["K_fisheye", "fisheyeD", "distCoeffs_equidistant", "xi", "xi_2", "xi_left", "K_omni"] {
            assert!(names_other_lens(key), "{key}");
        }
        for key in ["K", "D_1", "distCoeffs", "camera_matrix", "xio", "maximum", "K_left"] {
            assert!(!names_other_lens(key), "{key}");
        }
    }

    #[test]
    fn coefficients_that_can_be_read_in_two_ways_are_none() {
        assert_eq!(five_coefficients(&[1.0, 2.0, 3.0, 4.0]), Some([1.0, 2.0, 3.0, 4.0, 0.0]));
        assert_eq!(five_coefficients(&[1.0, 2.0]), Some([1.0, 2.0, 0.0, 0.0, 0.0]));
        assert_eq!(five_coefficients(&[1.0, 2.0, 3.0]), None);
        assert_eq!(
            five_coefficients(&[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
            Some([1.0, 0.0, 0.0, 0.0, 0.0])
        );
        assert_eq!(five_coefficients(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]), None);
        assert_eq!(five_coefficients(&[0.0; 15]), None);
    }
}
