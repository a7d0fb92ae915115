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

/// Names of other models that are parts of other words too.
const SHORT_FOREIGN: &[&str] = &["omni", "ds", "mei", "fov", "kb", "equi"];

/// In lower case, without blanks, quotes, `_`, `-` and `+`.
fn plain(text: &str) -> String {
    let dropped = |c: char| c.is_whitespace() || matches!(c, '_' | '-' | '+' | '"' | '\'' | '.' | ':');
    text.chars().filter(|&c| !dropped(c)).flat_map(char::to_lowercase).collect()
}

/// Whether a key's name says that it holds a lens model.
fn names_model(key: &str) -> bool {
    MODEL_KEYS.contains(&key) || MODEL_KEY_PARTS.iter().any(|part| key.contains(part))
}

/// An error if a camera's key speaks of a lens model that is not k1 k2 p1 p2 k3, or is not understood.
/// `value` is the text of a word or number; keys of other things are passed over.
pub fn check_lens_model(key: &str, value: &str) -> Result<(), UnknownLensModel> {
    let (name, word) = (plain(key), plain(value));
    let zero = value.trim().parse::<f64>().is_ok_and(|number| number == 0.0);
    let flags =
        name.contains("flag") || name.ends_with("kind") || name.ends_with("type") || name.ends_with("model");
    let foreign = flags && FOREIGN.iter().any(|foreign| word.contains(foreign));
    if foreign || (names_model(&name) && !zero && !KNOWN.contains(&word.as_str())) {
        return Err(UnknownLensModel { found: shortened(value.trim(), MAX_QUOTED_CHARS) });
    }
    Ok(())
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
        ] {
            assert_eq!(check_lens_model(key, value), Ok(()), "{key}: {value}");
        }
        assert_eq!(check_general_lens_model("type", "charuco"), Ok(()));
        assert!(check_general_lens_model("type", "fisheye").is_err());
        assert!(check_general_lens_model("model", "omni").is_err());
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
