//! What the keys of a FileStorage mean. Key names vary from program to program: `K`, `camera_matrix`,
//! `cameraMatrix1`, `K_left`, `left_K`.

use hull::rotation::matrix_from_rodrigues;
use nalgebra::{Matrix3, Vector3};

use super::super::entry::Entry;
use super::super::kind::MATRIX_NAMES;

/// What a key holds of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Role {
    Matrix,
    Lens,
    Rotation,
    Translation,
    Size,
    Width,
    Height,
}

impl Role {
    pub(super) const ALL: [Role; 7] =
        [Role::Matrix, Role::Lens, Role::Rotation, Role::Translation, Role::Size, Role::Width, Role::Height];

    /// The known names, in lower case without `_` and `-`; the first is preferred.
    fn names(self) -> &'static [&'static str] {
        match self {
            Role::Matrix => &MATRIX_NAMES,
            Role::Lens => &[
                "distortioncoefficients",
                "distortioncoeffs",
                "distortioncoeff",
                "distortionvector",
                "distortions",
                "distcoeffs",
                "distcoefs",
                "distcoeff",
                "d",
                "dist",
                "distortion",
            ],
            Role::Rotation => &[
                "rvec",
                "rotationvalues",
                "rotationvector",
                "r",
                "rotation",
                "rotationmatrix",
                "rot",
                "rvecs",
                "rmat",
            ],
            Role::Translation => {
                &["tvec", "translationvalues", "translationvector", "t", "translation", "tvecs", "trans"]
            }
            Role::Size => &["imagesize", "imgsize", "size", "resolution"],
            Role::Width => &["imagewidth", "width", "imgwidth"],
            Role::Height => &["imageheight", "height", "imgheight"],
        }
    }

    /// Further names that stand only with a camera's own name: `W_01`.
    fn names_beside(self) -> &'static [&'static str] {
        match self {
            Role::Width => &["w"],
            Role::Height => &["h"],
            _ => &[],
        }
    }

    /// Its names in messages.
    pub(super) fn shown(self) -> &'static str {
        match self {
            Role::Matrix => "camera_matrix (CameraMatrix, cameraMatrix, K, M1)",
            Role::Lens => "distCoeffs",
            Role::Rotation => "rvec (RotationValues, R)",
            Role::Translation => "tvec (TranslationValues, T)",
            Role::Size => "image_size",
            Role::Width => "image_width",
            Role::Height => "image_height",
        }
    }

    /// Whether an entry has as many numbers as this has.
    pub(super) fn fits(self, entry: &Entry) -> bool {
        let count = entry.numbers.as_ref().map_or(0, Vec::len);
        match self {
            Role::Matrix => count == 9,
            // A scalar `d` is something else.
            Role::Lens => count > 1 || entry.shape.is_some(),
            Role::Rotation => count == 3 || count == 9,
            Role::Translation => count == 3,
            Role::Size => count == 2,
            Role::Width | Role::Height => count == 1,
        }
    }

    /// Whether two entries say the same, but for digits that were not printed.
    pub(super) fn agrees(self, one: &Entry, other: &Entry) -> bool {
        let (one, other) = (values(self, one), values(self, other));
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-5 * a.abs().max(b.abs()).max(1.0);
        let length = one.len().max(other.len());
        if self != Role::Lens && one.len() != other.len() {
            return false;
        }
        let at = |values: &[f64], index: usize| values.get(index).copied().unwrap_or(0.0);
        (0..length).all(|index| near(at(&one, index), at(&other, index)))
    }
}

/// The numbers to compare: rotations as matrices.
fn values(role: Role, entry: &Entry) -> Vec<f64> {
    let numbers = entry.numbers.clone().unwrap_or_default();
    if role == Role::Rotation && numbers.len() == 3 {
        let rotation: Matrix3<f64> = matrix_from_rodrigues(&Vector3::from_row_slice(&numbers));
        return rotation.transpose().iter().copied().collect();
    }
    numbers
}

/// What a key holds, the rank of its name, and of which camera it is where it says so.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Meaning {
    pub(super) role: Role,
    pub(super) rank: usize,
    /// The camera's own name in the key, as it is written.
    pub(super) camera: Option<String>,
}

/// A longer key is no name of a matrix and a camera: every cut of a key is looked up.
const MAX_KEY_BYTES: usize = 256;

fn plain(key: &str) -> String {
    key.to_ascii_lowercase().replace(['_', '-'], "")
}

fn exact(key: &str, beside: bool) -> Option<(Role, usize)> {
    let key = plain(key);
    Role::ALL.into_iter().find_map(|role| {
        let names = role.names().iter().chain(if beside { role.names_beside() } else { &[] });
        names.into_iter().position(|name| *name == key).map(|rank| (role, rank))
    })
}

/// The meaning of a key; `None` for those that describe no camera.
pub(super) fn meaning(key: &str) -> Option<Meaning> {
    if key.len() > MAX_KEY_BYTES {
        return None;
    }
    if let Some((role, rank)) = exact(key, false) {
        return Some(Meaning { role, rank, camera: None });
    }
    let cuts = || (1..key.len()).filter(|&at| key.is_char_boundary(at)).map(|at| key.split_at(at));
    let behind = cuts().filter_map(|(head, tail)| parted(head, tail, tail)).max_by_key(|found| found.0);
    let before = || cuts().filter_map(|(head, tail)| parted(tail, head, head)).max_by_key(|found| found.0);
    behind.or_else(before).map(|(_, meaning)| meaning)
}

/// The meaning of a key that is a role's name and a camera's, and how long the role's name is.
fn parted(role: &str, camera: &str, side: &str) -> Option<(usize, Meaning)> {
    let name = camera.trim_matches(['_', '-']);
    let (found, rank) = exact(role, true)?;
    let is_side = ["left", "right", "l", "r"].contains(&side.to_ascii_lowercase().as_str());
    let is_apart = name.len() < camera.len() || role.ends_with(['_', '-']) || role.starts_with(['_', '-']);
    let clear =
        is_apart || is_side && role.len() + side.len() > 2 || name.bytes().all(|byte| byte.is_ascii_digit());
    (clear && !name.is_empty())
        .then(|| (plain(role).len(), Meaning { role: found, rank, camera: Some(name.to_owned()) }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_name_what_they_hold_and_of_which_camera() {
        let read = |key: &str| meaning(key).map(|found| (found.role, found.camera));
        let of = |role, camera: &str| Some((role, Some(camera.to_owned())));
        for key in ["camera_matrix", "cameraMatrix", "CameraMatrix", "K"] {
            assert_eq!(read(key), Some((Role::Matrix, None)), "{key}");
        }
        assert_eq!(read("distortion_coefficients"), Some((Role::Lens, None)));
        for key in ["K1", "M1", "cameraMatrix1", "camera_matrix_1"] {
            assert_eq!(read(key), of(Role::Matrix, "1"), "{key}");
        }
        for key in ["K_left", "left_K", "left_camera_matrix", "leftCameraMatrix", "cameraMatrix_left"] {
            assert_eq!(read(key), of(Role::Matrix, "left"), "{key}");
        }
        assert_eq!(read("D_right"), of(Role::Lens, "right"));
        assert_eq!(read("K_01"), of(Role::Matrix, "01"));
        assert_eq!(read("Rot_cam_2"), of(Role::Rotation, "cam_2"));
        assert_eq!(read("dist_01"), of(Role::Lens, "01"));
        assert_eq!(read("W_01"), of(Role::Width, "01"));
        for key in ["names", "Corner_0", "P1", "Q", "fisheye_model", "h", "flags", "dr", "rl"] {
            assert_eq!(read(key), None, "{key}");
        }
    }
}
