//! Cameras of the keys that describe them: one, the two of a stereo pair, or as many as the keys name.

use hull::Camera;
use hull::lens_model::{LENS_COEFFICIENTS, five_coefficients};
use nalgebra::{Matrix3, Vector3};

use super::super::entry::Entry;
use super::super::names::{Named, is_version_word};
use super::super::projection::{Placement, placed};
use super::super::{ImportError, ImportOptions, from_origin, size_of};
use super::parts::{Part, Parts};
use super::roles::Role;

/// Where a camera's pose is taken from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PoseSource {
    /// The keys that name no camera.
    Shared,
    /// The keys with the camera's name.
    Own,
    /// The world's origin: the first camera of a stereo pair.
    Origin,
}

/// The pairs of names that say which camera of a stereo pair is the first, in lower case.
const PAIRS: [(&str, &str); 5] = [("1", "2"), ("0", "1"), ("left", "right"), ("l", "r"), ("a", "b")];

/// Whether keys describe two cameras by the pose of one to the other.
pub(super) fn is_pair(parts: &Parts) -> bool {
    !parts.has(Role::Matrix, None) && !parts.has_own_poses() && parts.cameras(Role::Matrix).len() == 2
}

/// The cameras that keys describe; `name` is that of their file or folder.
pub(super) fn cameras(
    name: &str,
    parts: &Parts,
    options: &ImportOptions,
    warnings: &mut Vec<String>,
) -> Result<Vec<Named<Camera>>, ImportError> {
    parts.check_agreement()?;
    let named = parts.cameras(Role::Matrix);
    let mut reader = Reader { parts, options, warnings };
    if parts.has(Role::Matrix, None) {
        check_single(parts)?;
        return Ok(vec![reader.camera(name, None, PoseSource::Shared)?]);
    }
    if parts.has_own_poses() {
        check_own_poses(parts, &named)?;
        return named.iter().map(|camera| reader.camera(camera, Some(camera), PoseSource::Own)).collect();
    }
    match named[..] {
        [only] => {
            check_alone(parts, only)?;
            Ok(vec![reader.camera(name, Some(only), PoseSource::Shared)?])
        }
        [one, other] => {
            let (first, second) = ordered(parts, one, other)?;
            check_lenses(parts, &named)?;
            reader.warnings.push(format!(
                "{}: a stereo pair: camera {} stands at the world's origin, {} where {} and {} say",
                parts.path(),
                pair_name(first),
                pair_name(second),
                parts.key(Role::Rotation, None),
                parts.key(Role::Translation, None),
            ));
            Ok(vec![
                reader.camera(&pair_name(first), Some(first), PoseSource::Origin)?,
                reader.camera(&pair_name(second), Some(second), PoseSource::Shared)?,
            ])
        }
        _ => Err(ImportError::key(
            parts.path(),
            &keys(parts, Role::Matrix, &named),
            format!("{} camera matrices and one pose", named.len()),
            "a rotation and a translation for each camera, or a stereo pair",
        )),
    }
}

fn keys(parts: &Parts, role: Role, cameras: &[&str]) -> String {
    cameras.iter().map(|camera| parts.key(role, Some(camera))).collect::<Vec<&str>>().join(", ")
}

/// Whether a name is that of one camera of several.
fn is_side(camera: &&str) -> bool {
    let plain = camera.to_ascii_lowercase();
    PAIRS.iter().any(|(one, other)| plain == *one || plain == *other) || plain.parse::<u32>().is_ok()
}

/// The error of a file that describes one camera and part of another.
fn others(parts: &Parts, key: &str, other: &str) -> ImportError {
    let keys = format!("{key}, {other}");
    let expected = "one camera, or a name in each camera's keys";
    ImportError::key(parts.path(), &keys, "keys of one camera and of others", expected)
}

/// Beside the one camera matrix with a name stands nothing of another camera: half a stereo file has the pose of the
/// other camera.
fn check_alone(parts: &Parts, only: &str) -> Result<(), ImportError> {
    let key = parts.key(Role::Matrix, Some(only));
    let lenses = parts.cameras(Role::Lens);
    let lens = lenses.into_iter().find(|camera| *camera != only && is_side(camera));
    let lens = lens.filter(|_| parts.has(Role::Lens, Some(only)));
    match parts.further_matrix(Some(only)).or(lens.map(|camera| parts.key(Role::Lens, Some(camera)))) {
        Some(other) => Err(others(parts, key, other)),
        None => Ok(()),
    }
}

/// A file with one plain camera matrix describes no second camera.
fn check_single(parts: &Parts) -> Result<(), ImportError> {
    for role in [Role::Matrix, Role::Lens, Role::Translation] {
        let is_version = |camera: &&str| role == Role::Translation && is_version_word(&camera.to_lowercase());
        let others = parts.cameras(role).into_iter().filter(|camera| is_side(camera) || is_version(camera));
        let others: Vec<&str> = others.collect();
        if !others.is_empty() && (role != Role::Lens || others.len() > 1 || parts.has(Role::Lens, None)) {
            return Err(self::others(parts, parts.key(Role::Matrix, None), &keys(parts, role, &others)));
        }
    }
    match parts.further_matrix(None) {
        Some(other) => Err(others(parts, parts.key(Role::Matrix, None), other)),
        None => Ok(()),
    }
}

/// Every camera that keys name has a camera matrix and a pose, and there is no pose beside these.
fn check_own_poses(parts: &Parts, named: &[&str]) -> Result<(), ImportError> {
    if parts.has(Role::Rotation, None) || parts.has(Role::Translation, None) {
        let keys = format!(
            "{}, {}",
            parts.key(Role::Translation, None),
            parts.key(Role::Translation, Some(named[0]))
        );
        let found = "a pose of a pair and poses of single cameras";
        return Err(ImportError::key(parts.path(), &keys, found, "one of both"));
    }
    for role in [Role::Translation, Role::Rotation, Role::Lens] {
        if let Some(lone) = parts.cameras(role).into_iter().find(|camera| !named.contains(camera)) {
            let found = format!("no camera matrix of camera {lone}");
            return Err(ImportError::key(
                parts.path(),
                parts.key(role, Some(lone)),
                found,
                "the camera matrix K of each camera",
            ));
        }
    }
    if let Some((path, name)) = parts.unmatched_name() {
        let found = format!("{name}, and no camera matrix with it in its key");
        return Err(ImportError::key(path, "names", found, "K_ and a name for each of the names"));
    }
    Ok(())
}

/// Lens coefficients of a pair belong to its cameras.
fn check_lenses(parts: &Parts, named: &[&str]) -> Result<(), ImportError> {
    let lone = parts.cameras(Role::Lens).into_iter().find(|camera| !named.contains(camera));
    if lone.is_none() && !parts.has(Role::Lens, None) {
        return Ok(());
    }
    let key = parts.key(Role::Lens, lone);
    let found = format!("lens coefficients beside {}", keys(parts, Role::Matrix, named));
    Err(ImportError::key(parts.path(), key, found, "keys with the names of the same two cameras"))
}

/// Which of two cameras is the first: the one whose frame R and T start from.
fn ordered<'a>(parts: &Parts, one: &'a str, other: &'a str) -> Result<(&'a str, &'a str), ImportError> {
    let short = |name: &str| {
        let lower = name.to_ascii_lowercase();
        let bare = ["camera", "cam"].iter().find_map(|word| lower.strip_prefix(word)).unwrap_or(&lower);
        bare.trim_matches(['_', '-']).to_owned()
    };
    let is_pair = |one: &str, other: &str| PAIRS.contains(&(short(one).as_str(), short(other).as_str()));
    if is_pair(one, other) {
        return Ok((one, other));
    }
    if is_pair(other, one) {
        return Ok((other, one));
    }
    Err(ImportError::key(
        parts.path(),
        &keys(parts, Role::Matrix, &[one, other]),
        "two cameras and one pose, and not which is the first",
        "names 1 and 2 or left and right, or a pose for each camera",
    ))
}

fn pair_name(name: &str) -> String {
    match name.to_ascii_lowercase().as_str() {
        "l" => "left".to_owned(),
        "r" => "right".to_owned(),
        _ if name.bytes().all(|byte| byte.is_ascii_digit()) => format!("camera{name}"),
        _ => name.to_owned(),
    }
}

struct Reader<'a, 'b> {
    parts: &'a Parts<'b>,
    options: &'a ImportOptions,
    warnings: &'a mut Vec<String>,
}

impl Reader<'_, '_> {
    /// A camera whose keys hold `id`, or no name.
    fn camera(
        &mut self,
        name: &str,
        id: Option<&str>,
        pose: PoseSource,
    ) -> Result<Named<Camera>, ImportError> {
        let path = self.parts.path();
        let (_, k) = self.numbers(Role::Matrix, id, "3 x 3 numbers")?;
        let k = from_origin(Matrix3::from_row_slice(&k), self.options.pixel_origin.unwrap_or(0.0));
        let distortion = self.distortion(name, id)?;
        let pose_id = if pose == PoseSource::Own { id } else { None };
        let (key, rotation, translation) = if pose == PoseSource::Origin {
            (Role::Rotation.shown().to_owned(), vec![0.0; 3], Vector3::zeros())
        } else {
            let (_, t) = self.numbers(Role::Translation, pose_id, "3 numbers")?;
            let (key, r) = self.numbers(Role::Rotation, pose_id, "3 numbers or 3 x 3")?;
            (key, r, Vector3::from_row_slice(&t))
        };
        let size = size_of(path, self.size(id)?, self.options, self.warnings)?;
        let value = if rotation.len() == 3 {
            Camera::new(name, size, k, distortion, Vector3::from_row_slice(&rotation), translation)
                .map_err(|error| ImportError::camera(path, error))?
        } else {
            let placement = Placement { file: path, key: &key, name, size };
            let rotation = Matrix3::from_row_slice(&rotation);
            placed(&placement, k, distortion, &rotation, translation, self.warnings)?
        };
        Ok(Named { name: name.to_owned(), path: path.to_owned(), value })
    }

    /// The key and numbers of a role.
    fn numbers(
        &self,
        role: Role,
        id: Option<&str>,
        expected: &'static str,
    ) -> Result<(String, Vec<f64>), ImportError> {
        let found = self.parts.find(role, id)?;
        let missing = || match self.parts.in_map(role).filter(|_| id.is_none()) {
            Some((path, key)) => ImportError::key(path, key, "a key in a map", super::AT_THE_TOP),
            None => {
                let of_camera = id.map_or(String::new(), |id| format!(" of camera {id}"));
                let key = format!("{}{of_camera}", role.shown());
                ImportError::key(self.parts.path(), &key, "nothing", expected)
            }
        };
        let part = found.ok_or_else(missing)?;
        let numbers = checked(part, expected)?;
        if role.fits(part.entry) || role == Role::Lens {
            return Ok((part.entry.key.clone(), numbers.to_vec()));
        }
        Err(wrong_count(part, expected))
    }

    fn distortion(&mut self, name: &str, id: Option<&str>) -> Result<[f64; 5], ImportError> {
        let expected = LENS_COEFFICIENTS;
        let found = match (self.parts.find(Role::Lens, id)?, id) {
            // One lens for a camera whose matrix alone has its name.
            (None, Some(_)) if self.parts.cameras(Role::Matrix).len() == 1 => {
                self.parts.find(Role::Lens, None)?
            }
            // And the other way round: `K` with `D1`.
            (None, None) => match self.parts.cameras(Role::Lens)[..] {
                [only] if is_side(&only) => self.parts.find(Role::Lens, Some(only))?,
                [] => None,
                [other, ..] => {
                    let keys = (self.parts.key(Role::Matrix, None), self.parts.key(Role::Lens, Some(other)));
                    return Err(others(self.parts, keys.0, keys.1));
                }
            },
            (found, _) => found,
        };
        let path = self.parts.path();
        let Some(part) = found else {
            if let Some(key) = self.parts.unread_lens() {
                let found = "lens coefficients under a key that is not read";
                return Err(ImportError::key(path, key, found, "distortion_coefficients: k1 k2 p1 p2 k3"));
            }
            let whose = if id.is_some() { format!("camera {name} ") } else { String::new() };
            self.warnings.push(format!("{path}: {whose}has no lens coefficients, taken as zero"));
            return Ok([0.0; 5]);
        };
        let given = checked(part, expected)?;
        // A scalar `d` is something else.
        if ![1, 2, 4, 5, 8, 12, 14].contains(&given.len())
            || !(Role::Lens.fits(part.entry) || part.entry.is_list)
        {
            return Err(wrong_count(part, expected));
        }
        if let Some(key) = self.parts.unread_lens().filter(|_| given.iter().all(|&number| number == 0.0)) {
            let keys = format!("{}, {key}", part.entry.key);
            let found = "zeros, and lens coefficients under a key that is not read";
            return Err(ImportError::key(path, &keys, found, "distortion_coefficients: k1 k2 p1 p2 k3"));
        }
        five_coefficients(given).ok_or_else(|| {
            let more = given.iter().skip(5).find(|&&more| more != 0.0).unwrap_or(&0.0);
            ImportError::key(
                part.path,
                &part.entry.key,
                format!("{} numbers with {more}", given.len()),
                expected,
            )
        })
    }

    fn size(&self, id: Option<&str>) -> Result<Option<(u32, u32)>, ImportError> {
        let of = |role| match self.parts.find(role, id)? {
            None if id.is_some() => self.parts.find(role, None),
            found => Ok(found),
        };
        let pair = match of(Role::Size)? {
            Some(part) => match part.entry.numbers.as_deref() {
                Some(pair @ [_, _]) => Some((part, whole(part.path, part.entry, pair)?)),
                _ => None,
            },
            None => None,
        };
        let side = |role| match of(role)? {
            Some(part) => match part.entry.numbers.as_deref() {
                Some(numbers @ [_]) => whole(part.path, part.entry, numbers).map(|side| Some(side[0])),
                _ => {
                    Err(ImportError::key(part.path, &part.entry.key, format!("{:?}", part.entry.text), WHOLE))
                }
            },
            None => Ok(None),
        };
        let (width, height) = (side(Role::Width)?, side(Role::Height)?);
        // A file that says both wins over the option.
        let given = self.options.size.filter(|_| width.is_none() || height.is_none());
        let sides = [(Role::Width, width), (Role::Height, height)].into_iter().zip(0_usize..);
        for ((role, side), place) in sides.filter_map(|((role, side), place)| Some(((role, side?), place))) {
            let (key, other) = match (&pair, given) {
                (Some((part, pair)), _) => (part.entry.key.as_str(), pair[place]),
                (None, Some((width, height))) => ("the size given", [width, height][place]),
                (None, None) => continue,
            };
            if other != side {
                let own = of(role)?.map_or(role.shown(), |part| part.entry.key.as_str());
                let found = format!("{other} and {side}");
                let keys = format!("{key}, {own}");
                return Err(ImportError::key(self.parts.path(), &keys, found, "one image size"));
            }
        }
        let size = pair.map(|(_, pair)| (pair[0], pair[1])).or(width.zip(height));
        match self.parts.unread_size().filter(|_| size.is_none()) {
            Some((path, entry)) => {
                let list = entry.numbers.as_ref().map(|numbers| format!("{numbers:?}"));
                let found = if entry.text.is_empty() { list } else { Some(format!("{:?}", entry.text)) };
                let expected = "image_width and image_height, or image_size: [width, height] in pixels";
                Err(ImportError::key(path, &entry.key, found.unwrap_or_default(), expected))
            }
            None => Ok(size),
        }
    }
}

const WHOLE: &str = "a width and a height in whole pixels";

fn whole(path: &str, entry: &Entry, numbers: &[f64]) -> Result<Vec<u32>, ImportError> {
    if numbers.iter().all(|n| n.fract() == 0.0 && (0.0..1e6).contains(n)) {
        Ok(numbers.iter().map(|&n| n as u32).collect())
    } else {
        Err(ImportError::key(path, &entry.key, format!("{numbers:?}"), WHOLE))
    }
}

/// The numbers of a part, if they are as many as its shape says.
fn checked<'a>(part: &'a Part, expected: &'static str) -> Result<&'a [f64], ImportError> {
    let found = part.entry.numbers.as_deref().unwrap_or(&[]);
    let shaped = part.entry.shape.is_none_or(|(rows, cols)| rows.saturating_mul(cols) == found.len());
    if shaped { Ok(found) } else { Err(wrong_count(part, expected)) }
}

fn wrong_count(part: &Part, expected: &'static str) -> ImportError {
    let shape = part.entry.shape.map_or(String::new(), |(rows, cols)| format!(" for {rows} x {cols}"));
    let found = match (part.entry.numbers.as_deref(), part.entry.shape) {
        (None, None) => format!("{:?}", part.entry.text),
        (Some([only]), None) if !part.entry.is_list => format!("the single number {only}"),
        (numbers, _) => format!("{} numbers{shape}", numbers.map_or(0, <[f64]>::len)),
    };
    ImportError::key(part.path, &part.entry.key, found, expected)
}
