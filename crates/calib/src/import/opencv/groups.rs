//! Which files describe one camera.

use std::collections::{BTreeMap, BTreeSet};

use super::super::names::{are_two_cameras, file_names, folder, half_key};
use super::super::{ImportError, TextFile};
use super::parts::Parts;
use super::roles::Role;

/// The files of one camera, or of a pair or room in one file.
pub(super) struct Group<'a> {
    /// The camera's name, unless the keys name their cameras.
    pub(super) name: String,
    pub(super) parts: Parts<'a>,
    /// The first of its files.
    path: &'a str,
}

impl<'a> Group<'a> {
    /// The file that messages name.
    pub(super) fn path(&self) -> &'a str {
        self.path
    }

    /// Whether it holds lens coefficients and neither a camera matrix nor a pose.
    pub(super) fn is_lens_alone(&self) -> bool {
        !self.parts.has_matrix() && !self.parts.has_pose()
    }
}

const ONE_NAME: &str = "one name in both, or a name that says only which half it is (lens.yml)";

type Described<'a> = (&'a TextFile, Parts<'a>);

/// Files that say all, each with the halves that belong to it, and halves joined by folder or name. An error if
/// files of one camera contradict each other.
pub(super) fn grouped<'a>(files: Vec<Described<'a>>) -> Result<Vec<Group<'a>>, ImportError> {
    let (whole, halves): (Vec<Described>, Vec<Described>) =
        files.into_iter().partition(|(_, parts)| parts.is_complete());
    let paths: Vec<&str> = whole.iter().map(|(file, _)| file.path.as_str()).collect();
    let names = file_names(&paths)?;
    let mut groups: Vec<Group> = whole
        .into_iter()
        .zip(names)
        .map(|((file, parts), name)| Group { name, parts, path: &file.path })
        .collect();
    let mut left = Vec::new();
    for (file, parts) in halves {
        match owner(&paths, &file.path) {
            Some(index) => {
                if are_two_cameras(paths[index], &file.path) {
                    let found = "keys of two cameras by their names in a folder of one";
                    return Err(ImportError::conflict(paths[index], &file.path, found, ONE_NAME));
                }
                let joined = Parts::joined([groups[index].parts.clone(), parts]);
                joined.check_agreement()?;
                groups[index].parts = joined;
            }
            None => left.push((file, parts)),
        }
    }
    groups.extend(halves_by_folder(left));
    Ok(groups)
}

/// The whole file that a half belongs to: the only one of its folder, or the one of its name.
fn owner(paths: &[&str], half: &str) -> Option<usize> {
    let place = folder(half);
    let beside: Vec<usize> = (0..paths.len()).filter(|&index| folder(paths[index]) == place).collect();
    match beside[..] {
        [only] if !place.is_empty() => Some(only),
        _ => (0..paths.len()).find(|&index| half_key(paths[index]) == half_key(half)),
    }
}

/// Folders whose halves make one camera without a contradiction; other halves by their names.
fn halves_by_folder(halves: Vec<Described<'_>>) -> Vec<Group<'_>> {
    let mut folders: BTreeMap<&str, Vec<Described>> = BTreeMap::new();
    for (file, parts) in halves {
        folders.entry(folder(&file.path)).or_default().push((file, parts));
    }
    let mut groups = Vec::new();
    let mut by_name: BTreeMap<String, Vec<Described>> = BTreeMap::new();
    for (place, files) in folders {
        let joined = Parts::joined(files.iter().map(|(_, parts)| parts.clone()));
        // Matrices of several names are several cameras, though their values are the same.
        let with_matrix = files.iter().filter(|(_, parts)| parts.has(Role::Matrix, None));
        let matrices: BTreeSet<String> = with_matrix.map(|(file, _)| half_key(&file.path)).collect();
        let is_of_two =
            |(file, _): &Described| files.iter().any(|(other, _)| are_two_cameras(&file.path, &other.path));
        let is_one = matrices.len() < 2 && !files.iter().any(is_of_two);
        if !place.is_empty() && is_one && joined.is_complete() && joined.check_agreement().is_ok() {
            groups.push(group(place.rsplit('/').next().unwrap_or(place), files));
            continue;
        }
        for (file, parts) in files {
            by_name.entry(half_key(&file.path)).or_default().push((file, parts));
        }
    }
    for (key, files) in by_name {
        let name = key.rsplit('/').next().filter(|name| !name.is_empty()).unwrap_or("camera");
        groups.push(group(name, files));
    }
    groups
}

fn group<'a>(name: &str, files: Vec<Described<'a>>) -> Group<'a> {
    let first = files.iter().find(|(_, parts)| parts.has(Role::Matrix, None)).or(files.first());
    let path = first.map_or("", |(file, _)| file.path.as_str());
    Group { name: name.to_owned(), path, parts: Parts::joined(files.into_iter().map(|(_, parts)| parts)) }
}
