//! OpenCV FileStorage, XML or YAML: a camera per file or per folder of files, stereo pairs, and files whose
//! keys name their cameras (EasyMocap). Extrinsics are world to camera.

mod camera;
mod groups;
mod parts;
mod roles;

use hull::Camera;
use hull::calibration_words::{
    Contradiction, changes_images, check_convention, check_takes_part, check_unit,
};

use super::entry::Entry;
use super::kind::names_camera;
use super::names::{Named, settled};
use super::xml::{self, Element};
use super::{ImportError, ImportOptions, Imported, TextFile, axes, changed_images, numbers, place, yaml};
use groups::{Group, grouped};
use parts::Parts;
use roles::Role;

/// Reads FileStorage files. A file that says all is a camera, named like the file, or like its folder
/// (`cam1/config.xml`) where each folder holds one; files that hold halves of a camera are joined by folder or
/// name (`cam1_intrinsics.yml`, `cam1_extrinsics.yml`). Files that describe no camera are left out; so are
/// cameras without a pose, with a warning, unless no camera is complete. Files that look like two versions
/// of one camera and differ are an error.
pub fn from_opencv(files: &[TextFile], options: &ImportOptions) -> Result<Imported, ImportError> {
    let mut warnings = Vec::new();
    let mut read = Vec::new();
    for file in files {
        match entries(file) {
            Ok(entries) => read.push((file, entries)),
            // A YAML of another program beside the calibration.
            Err(error) if files.len() > 1 && !names_camera(&file.text) => {
                warnings.push(format!("left out: {error}"));
            }
            Err(error) => return Err(error),
        }
    }
    let (mut described, mut said_names) = (Vec::new(), Vec::new());
    for (file, entries) in &read {
        let parts = Parts::of_file(file, entries)?;
        for entry in entries {
            entry.check_lens_model(!parts.is_empty()).map_err(|error| ImportError::LensModel {
                file: file.path.clone(),
                key: entry.key.clone(),
                error,
            })?;
        }
        if !parts.is_empty() {
            check_conventions(file, entries, options, &mut warnings)?;
            said_names.extend(said_name(entries).map(|name| (file.path.as_str(), name)));
            described.push((*file, parts));
        } else if !is_of_board(entries) {
            warnings.push(format!("{}: left out, it has no key that describes a camera", file.path));
        }
    }
    let mut worlds: Vec<World> = Vec::new();
    let mut halves = Halves::default();
    for group in grouped(described)? {
        if !group.parts.has_matrix() {
            halves.poses.push(group);
        } else if !group.parts.has_pose() {
            halves.matrices.push(group);
        } else {
            let cameras = camera::cameras(&group.name, &group.parts, options, &mut warnings)?;
            let is_pair = camera::is_pair(&group.parts);
            worlds.push(World { path: group.path().to_owned(), is_pair, cameras });
        }
    }
    check_worlds(&worlds)?;
    let cameras: Vec<Named<Camera>> = worlds.into_iter().flat_map(|world| world.cameras).collect();
    halves.check(&cameras, &mut warnings)?;
    check_names(&cameras, &said_names)?;
    let place = place(files);
    if cameras.is_empty() {
        return Err(ImportError::key(
            place,
            Role::Matrix.shown(),
            "nothing",
            "a 3 x 3 camera matrix in some file",
        ));
    }
    let cameras = settled(cameras, same, &mut warnings)?.into_iter().map(|camera| camera.value).collect();
    axes::finished(place, cameras, 1.0, options, warnings)
}

/// The name that a file's keys give its camera, if any.
fn said_name(entries: &[Entry]) -> Option<String> {
    const KEYS: [&str; 6] = ["cameraname", "cameraid", "camname", "camid", "camera", "name"];
    let is_name = |entry: &&Entry| {
        let key = entry.key.to_ascii_lowercase().replace(['_', '-'], "");
        KEYS.contains(&key.as_str()) && !entry.is_list && !entry.value().is_empty()
    };
    entries.iter().find(is_name).map(Entry::value)
}

/// An error for a file whose keys give its camera the name of another file's camera. Numbers that count from elsewhere in
/// all files (0 in `1.yml`, 1 in `2.yml`) are no names.
fn check_names(cameras: &[Named<Camera>], said: &[(&str, String)]) -> Result<(), ImportError> {
    let number = |text: &str| {
        let digits = text.len() - text.bytes().rev().take_while(u8::is_ascii_digit).count();
        text[digits..].parse::<i64>().ok()
    };
    let offset = |(path, name): &(&str, String)| {
        let own = cameras.iter().find(|camera| camera.path == *path)?;
        number(name)?.checked_sub(number(&own.name)?)
    };
    let mut offsets = said.iter().map(offset);
    if let Some(Some(first)) = offsets.next()
        && offsets.all(|offset| offset == Some(first))
    {
        return Ok(());
    }
    for (path, name) in said {
        let is_said = |camera: &&Named<Camera>| camera.name.eq_ignore_ascii_case(name);
        let is_own = cameras.iter().filter(is_said).any(|camera| camera.path == *path);
        let other = cameras.iter().find(is_said).filter(|other| !is_own && other.path != *path);
        if let Some(other) = other.filter(|_| cameras.iter().any(|camera| camera.path == *path)) {
            let found = format!("camera {name} in the keys of the one and as the name of the other");
            return Err(ImportError::conflict(path, &other.path, found, "one name for one camera"));
        }
    }
    Ok(())
}

/// The cameras of a group of files. Those of a stereo pair have a world of their own.
struct World {
    path: String,
    is_pair: bool,
    cameras: Vec<Named<Camera>>,
}

fn same(one: &Camera, other: &Camera) -> bool {
    one.clone().renamed(other.name()) == *other
}

/// An error for a stereo pair beside other cameras: their files do not say where the pair stands.
fn check_worlds(worlds: &[World]) -> Result<(), ImportError> {
    let Some(pair) = worlds.iter().find(|world| world.is_pair) else { return Ok(()) };
    let is_known = |camera: &Named<Camera>| {
        let mut own = pair.cameras.iter();
        own.any(|own| own.name == camera.name && same(&own.value, &camera.value))
    };
    match worlds.iter().find(|world| !world.cameras.iter().all(is_known)) {
        Some(other) => Err(ImportError::conflict(
            &pair.path,
            &other.path,
            "a stereo pair, whose first camera is the world's origin, and further cameras",
            "one stereo file alone, or a pose in one world for each camera",
        )),
        None => Ok(()),
    }
}

/// An error for keys that say that lengths or poses are others than those that are read, and a warning for those that
/// say that images were turned or cut.
fn check_conventions(
    file: &TextFile,
    entries: &[Entry],
    options: &ImportOptions,
    warnings: &mut Vec<String>,
) -> Result<(), ImportError> {
    check_focal_keys(file, entries)?;
    for entry in entries {
        // A map is of something else; an attribute of a camera's key is not.
        if entry.key.rsplit_once('/').is_some_and(|(around, _)| roles::meaning(around).is_none()) {
            continue;
        }
        let value = entry.value();
        let unit = if options.scale.is_none() { check_unit(entry.name(), &value) } else { Ok(()) };
        let words = unit.and_then(|()| check_convention(entry.name(), &value));
        words.and_then(|()| check_takes_part(entry.name(), &value)).map_err(
            |Contradiction { found, expected }| ImportError::key(&file.path, &entry.key, found, expected),
        )?;
        if changes_images(entry.name(), &value) {
            warnings.push(format!("{}: {}", file.path, changed_images(&entry.key, &value)));
        }
    }
    Ok(())
}

/// An error for focal lengths or a principal point beside the camera matrix that are others.
fn check_focal_keys(file: &TextFile, entries: &[Entry]) -> Result<(), ImportError> {
    /// Printed digits, as a share.
    const ROUNDED: f64 = 1e-3;
    let top = || entries.iter().filter(|entry| !entry.is_nested());
    let mut matrices = top().filter(|entry| {
        roles::meaning(&entry.key).is_some_and(|found| found.role == Role::Matrix) && Role::Matrix.fits(entry)
    });
    let (Some(matrix), None) = (matrices.next(), matrices.next()) else { return Ok(()) };
    let numbers = matrix.numbers.as_deref().unwrap_or(&[]);
    for (name, place) in [("fx", 0), ("fy", 4), ("cx", 2), ("cy", 5)] {
        let Some(&read) = numbers.get(place) else { continue };
        let is_named = |entry: &&Entry| entry.key.to_lowercase().replace(['_', '-'], "") == name;
        for entry in top().filter(is_named) {
            let Some(&[found]) = entry.numbers.as_deref() else { continue };
            if (found - read).abs() > ROUNDED * read.abs().max(1.0) {
                let keys = format!("{}, {}", matrix.key, entry.key);
                let found = format!("{read} and {found}");
                return Err(ImportError::key(&file.path, &keys, found, "one value for one camera"));
            }
        }
    }
    Ok(())
}

/// Whether a file holds the pattern, or its corners, that a calibration was made with, and nothing of a camera.
fn is_of_board(entries: &[Entry]) -> bool {
    const WORDS: [&str; 6] = ["corner", "board", "square", "marker", "pattern", "aruco"];
    let of_board = |entry: &Entry| {
        let key = entry.key.to_ascii_lowercase();
        WORDS.iter().any(|word| key.contains(word))
    };
    let of_camera = |entry: &Entry| roles::meaning(&entry.key).is_some() || Role::Matrix.fits(entry);
    entries.iter().any(of_board) && !entries.iter().any(of_camera)
}

const AT_THE_TOP: &str = "this key at the top of the file";

/// Halves of cameras without the other half.
#[derive(Default)]
struct Halves<'a> {
    matrices: Vec<Group<'a>>,
    poses: Vec<Group<'a>>,
}

impl Halves<'_> {
    /// Halves of both kinds belong together in a way that their names do not say: an error that names two. So is
    /// a half where no camera is complete; another is left out with a warning.
    fn check(&self, cameras: &[Named<Camera>], warnings: &mut Vec<String>) -> Result<(), ImportError> {
        let both = self
            .matrices
            .iter()
            .find(|group| !group.is_lens_alone())
            .zip(self.poses.iter().find(|group| !group.is_lens_alone()));
        if let Some((matrix, pose)) = both {
            return Err(ImportError::conflict(
                matrix.path(),
                pose.path(),
                "a camera matrix without a pose, and a pose without a camera matrix",
                "files of one camera in one folder, or with one name as in cam1_intrinsics.yml and \
                 cam1_extrinsics.yml",
            ));
        }
        let lone = self.matrices.first().map(|group| (group, Role::Translation, "3 numbers"));
        let lone = lone.or(self.poses.first().map(|group| (group, Role::Matrix, "3 x 3 numbers")));
        if let Some((group, role, expected)) = lone
            && cameras.is_empty()
        {
            return Err(match pose_in_map(group) {
                Some((path, key)) => ImportError::key(path, key, "a key in a map", AT_THE_TOP),
                None => ImportError::key(group.path(), role.shown(), "nothing", expected),
            });
        }
        for group in &self.matrices {
            let inner =
                pose_in_map(group).map_or(String::new(), |(_, key)| format!(": {key} stands in a map"));
            warnings.push(format!("{}: left out, it has no pose{inner}", group.path()));
        }
        for group in &self.poses {
            warnings.push(format!("{}: left out, it has no camera matrix", group.path()));
        }
        Ok(())
    }
}

/// A key of a pose that stands in a map, with its file, of a group without a pose.
fn pose_in_map<'a>(group: &Group<'a>) -> Option<(&'a str, &'a str)> {
    group.parts.in_map(Role::Translation).or(group.parts.in_map(Role::Rotation))
}

fn entries(file: &TextFile) -> Result<Vec<Entry>, ImportError> {
    if !file.text.trim_start().starts_with('<') {
        return yaml::parse(file);
    }
    let root = xml::parse(file)?;
    if root.name != "opencv_storage" {
        return Err(ImportError::syntax(file, 1, &format!("<{}>", root.name), "<opencv_storage>"));
    }
    let mut entries = Vec::new();
    for child in &root.children {
        add_entries(file, child, &child.name, &mut entries)?;
    }
    Ok(entries)
}

/// An element's entry, and those of the elements in it.
fn add_entries(
    file: &TextFile,
    element: &Element,
    key: &str,
    entries: &mut Vec<Entry>,
) -> Result<(), ImportError> {
    let whole = |name| element.child(name).and_then(|child| child.text.trim().parse::<usize>().ok());
    let shape = whole("rows").zip(whole("cols"));
    let text = element.text.trim().trim_matches('"').trim();
    let found =
        match element.child("data") {
            Some(data) if !data.children.is_empty() => {
                let found = format!("<{}> in its data", data.children[0].name);
                return Err(ImportError::key(&file.path, key, found, "numbers"));
            }
            Some(data) => Some(numbers(&data.text).map_err(|word| {
                ImportError::key(&file.path, key, format!("{word:?} in its data"), "numbers")
            })?),
            None => numbers(text).ok().filter(|numbers| !numbers.is_empty()),
        };
    let is_matrix = element.child("data").is_some();
    let text = if is_matrix { String::new() } else { text.to_owned() };
    // A list of numbers, one of which is none: all that stands there is no value.
    let words = text.split_whitespace();
    let unread = words.clone().find(|word| word.parse::<f64>().is_err()).map(str::to_owned);
    let unread = unread.filter(|_| found.is_none() && words.clone().any(|word| word.parse::<f64>().is_ok()));
    let is_list = unread.is_some() || found.as_ref().is_some_and(|found| found.len() > 1);
    entries.push(Entry { key: key.to_owned(), shape, numbers: found, text, unread, is_list });
    for (name, value) in &element.attributes {
        entries.push(Entry { key: format!("{key}/{name}"), text: value.clone(), ..Entry::default() });
    }
    for child in element.children.iter().filter(|_| !is_matrix) {
        add_entries(file, child, &format!("{key}/{}", child.name), entries)?;
    }
    Ok(())
}

#[cfg(test)]
mod ambiguous;
#[cfg(test)]
mod tests;
