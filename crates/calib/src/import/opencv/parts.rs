//! The keys of one or several files that describe cameras, looked up by what they mean.

use std::collections::BTreeSet;

use super::super::entry::Entry;
use super::super::natural_order::natural_key;
use super::super::{ImportError, TextFile};
use super::roles::{Meaning, Role, meaning};

/// A key that describes a camera, with its file.
#[derive(Clone, Debug)]
pub(super) struct Part<'a> {
    pub(super) path: &'a str,
    pub(super) entry: &'a Entry,
    meaning: Meaning,
}

/// What one file, or the files of one camera or pair, say.
#[derive(Clone, Debug, Default)]
pub(super) struct Parts<'a> {
    parts: Vec<Part<'a>>,
    /// Keys with lens coefficients that are not read.
    unread_lenses: Vec<&'a Entry>,
    /// Keys that hold the camera matrix of a further camera and are not read.
    unread_matrices: Vec<&'a Entry>,
    /// Keys of an image size that are not read, with their files.
    unread_sizes: Vec<(&'a str, &'a Entry)>,
    /// Keys of a role in maps, which are not read, with their files.
    in_maps: Vec<(&'a str, &'a Entry, Role)>,
    /// The list of the cameras' names, with its file.
    names: Option<(&'a str, &'a Entry)>,
}

impl<'a> Parts<'a> {
    /// The keys of a file that describe a camera. An error if its only camera matrices stand in maps.
    pub(super) fn of_file(file: &'a TextFile, entries: &'a [Entry]) -> Result<Parts<'a>, ImportError> {
        let mut parts = Vec::new();
        for entry in entries.iter().filter(|entry| !entry.is_nested()) {
            let is_scalar = entry.shape.is_none()
                && !entry.is_list
                && entry.numbers.as_ref().is_none_or(|found| found.len() < 2);
            if let Some(meaning) = meaning(&entry.key)
                && !(is_scalar && matches!(meaning.role, Role::Matrix | Role::Rotation | Role::Translation))
                // `k456`, of a rational model, is no matrix of a camera 456.
                && (meaning.role.fits(entry) || meaning.role == Role::Lens || !holds_lens(entry))
            {
                parts.push(Part { path: &file.path, entry, meaning });
            }
        }
        let is_unread = |entry: &&Entry| !parts.iter().any(|part: &Part| std::ptr::eq(part.entry, *entry));
        let unread = |is: fn(&Entry) -> bool| {
            entries.iter().filter(|entry| is(entry)).filter(is_unread).collect::<Vec<&Entry>>()
        };
        let (unread_lenses, unread_matrices) = (unread(holds_lens), unread(holds_intrinsics));
        let is_read = |entry: &&Entry| {
            let is_plain = |part: &&Part| part.meaning.camera.is_none() && part.meaning.role.fits(part.entry);
            let mut read = parts.iter().filter(is_plain);
            read.any(|part| std::ptr::eq(part.entry, *entry))
        };
        let path = file.path.as_str();
        let sizes = entries.iter().filter(|entry| holds_size(entry) && !is_read(entry));
        let unread_sizes = sizes.map(|entry| (path, entry)).collect();
        let inner = entries.iter().filter(|entry| entry.is_nested());
        let in_maps = inner.filter_map(|entry| {
            let role = meaning(entry.name())?.role;
            role.fits(entry).then_some((path, entry, role))
        });
        let in_maps = in_maps.collect();
        let names = entries.iter().find(|entry| entry.key == "names" && entry.is_list);
        let names = names.map(|names| (path, names));
        let parts = Parts { parts, unread_lenses, unread_matrices, unread_sizes, in_maps, names };
        check_inner(file, entries, parts.has_matrix())?;
        Ok(parts)
    }

    /// These and the others.
    pub(super) fn joined(files: impl IntoIterator<Item = Parts<'a>>) -> Parts<'a> {
        let mut joined = Parts::default();
        for file in files {
            joined.parts.extend(file.parts);
            joined.unread_lenses.extend(file.unread_lenses);
            joined.unread_matrices.extend(file.unread_matrices);
            joined.unread_sizes.extend(file.unread_sizes);
            joined.in_maps.extend(file.in_maps);
            joined.names = joined.names.or(file.names);
        }
        joined
    }

    /// The key of lens coefficients that are not read, if any.
    pub(super) fn unread_lens(&self) -> Option<&str> {
        self.unread_lenses.first().map(|entry| entry.key.as_str())
    }

    /// A key of an image size that is not read, with its file, if any.
    pub(super) fn unread_size(&self) -> Option<(&'a str, &'a Entry)> {
        self.unread_sizes.first().copied()
    }

    /// A key of this role in a map, with its file, if any.
    pub(super) fn in_map(&self, role: Role) -> Option<(&'a str, &'a str)> {
        let found = self.in_maps.iter().find(|(_, _, found)| *found == role);
        found.map(|(path, entry, _)| (*path, entry.key.as_str()))
    }

    /// The key of a further camera's matrix beside that of `camera`, if any.
    pub(super) fn further_matrix(&self, camera: Option<&str>) -> Option<&str> {
        let is_other = |part: &&Part| {
            let named = part.meaning.camera.as_deref();
            part.meaning.role == Role::Matrix && named.is_some() && named != camera
        };
        let named = self.parts.iter().filter(is_other).map(|part| part.entry);
        named
            .chain(self.unread_matrices.iter().copied())
            .find(|other| holds_intrinsics(other))
            .map(|entry| entry.key.as_str())
    }

    pub(super) fn has(&self, role: Role, camera: Option<&str>) -> bool {
        self.of(role, camera).next().is_some()
    }

    fn of(&self, role: Role, camera: Option<&str>) -> impl Iterator<Item = &Part<'a>> {
        let same = move |part: &&Part| part.meaning.role == role && part.meaning.camera.as_deref() == camera;
        self.parts.iter().filter(same)
    }

    /// The part that says this, if any. An error if two say it differently.
    pub(super) fn find(&self, role: Role, camera: Option<&str>) -> Result<Option<&Part<'a>>, ImportError> {
        let mut found: Vec<&Part> = self.of(role, camera).collect();
        let is_unread = |part: &&&Part| part.entry.unread.is_some();
        if let Some((part, word)) =
            found.iter().find(is_unread).and_then(|part| Some((part, part.entry.unread.as_ref()?)))
        {
            return Err(ImportError::key(part.path, &part.entry.key, format!("{word:?}"), "numbers"));
        }
        if found.iter().any(|part| role.fits(part.entry)) {
            found.retain(|part| role.fits(part.entry));
        }
        found.sort_by_key(|part| part.meaning.rank);
        let Some(first) = found.first() else { return Ok(None) };
        for other in &found[1..] {
            if role.agrees(first.entry, other.entry) {
                continue;
            }
            let keys = format!("{}, {}", first.entry.key, other.entry.key);
            if first.path == other.path {
                return Err(ImportError::key(
                    first.path,
                    &keys,
                    "two different values",
                    "one value for one camera",
                ));
            }
            let found = format!("different values of {}", first.entry.key);
            return Err(ImportError::conflict(
                first.path,
                other.path,
                found,
                "one value: move one file away",
            ));
        }
        Ok(Some(first))
    }

    /// The names of cameras that keys hold, in the order people count, of keys with this role.
    pub(super) fn cameras(&self, role: Role) -> Vec<&str> {
        let named = self.parts.iter().filter(|part| part.meaning.role == role && role.fits(part.entry));
        let names: BTreeSet<&str> = named.filter_map(|part| part.meaning.camera.as_deref()).collect();
        let mut names: Vec<&str> = names.into_iter().collect();
        names.sort_by_cached_key(|name| natural_key(name));
        names
    }

    /// The key of a camera's role as the file writes it, for messages.
    pub(super) fn key(&self, role: Role, camera: Option<&str>) -> &str {
        self.of(role, camera).next().map_or(role.shown(), |part| part.entry.key.as_str())
    }

    /// The file of the first camera matrix, else of the first part.
    pub(super) fn path(&self) -> &'a str {
        let matrix = self.parts.iter().find(|part| part.meaning.role == Role::Matrix);
        matrix.or(self.parts.first()).map_or("", |part| part.path)
    }

    pub(super) fn has_matrix(&self) -> bool {
        self.has(Role::Matrix, None) || !self.cameras(Role::Matrix).is_empty()
    }

    /// Whether anything says where a camera stands.
    pub(super) fn has_pose(&self) -> bool {
        self.has(Role::Rotation, None) || self.has(Role::Translation, None) || self.has_own_poses()
    }

    /// Whether keys with the names of cameras hold poses. Rotations alone are those of rectified pictures.
    pub(super) fn has_own_poses(&self) -> bool {
        !self.cameras(Role::Translation).is_empty()
    }

    /// A name in the list `names` that no key of a camera matrix has, and the keys that do.
    pub(super) fn unmatched_name(&self) -> Option<(&'a str, &'a str)> {
        let (path, names) = self.names?;
        let cameras = self.cameras(Role::Matrix);
        let name = names.text.split_whitespace().find(|name| !cameras.contains(name))?;
        Some((path, name))
    }

    /// Whether there is all that a camera or a pair needs.
    pub(super) fn is_complete(&self) -> bool {
        let shared = self.has(Role::Rotation, None) && self.has(Role::Translation, None);
        let own = self.has_own_poses() && !self.cameras(Role::Rotation).is_empty();
        self.has_matrix() && (shared || own)
    }

    /// Whether nothing in it describes a camera.
    pub(super) fn is_empty(&self) -> bool {
        let is_lens = |part: &Part| part.meaning.role == Role::Lens && Role::Lens.fits(part.entry);
        !self.has_matrix() && !self.has_pose() && !self.parts.iter().any(is_lens)
    }

    /// An error if two parts say the same of a camera differently.
    pub(super) fn check_agreement(&self) -> Result<(), ImportError> {
        let cameras: BTreeSet<Option<&str>> =
            self.parts.iter().map(|part| part.meaning.camera.as_deref()).collect();
        for camera in cameras {
            for role in Role::ALL {
                self.find(role, camera)?;
            }
        }
        Ok(())
    }
}

/// An error for a camera matrix in a map: alone the map is a camera, and beside one at the top it is another one.
fn check_inner(file: &TextFile, entries: &[Entry], is_beside: bool) -> Result<(), ImportError> {
    let is_inner = |entry: &&Entry| {
        let role = meaning(entry.name()).map(|found| found.role);
        entry.is_nested() && role == Some(Role::Matrix) && Role::Matrix.fits(entry)
    };
    let wrong =
        |inner: &Entry, found, expected| Err(ImportError::key(&file.path, &inner.key, found, expected));
    match entries.iter().find(is_inner) {
        Some(inner) if !is_beside => wrong(
            inner,
            "a camera in a map (MC-Calib writes such files)",
            "the camera's keys at the top: write one file per camera with camera_matrix, distCoeffs, R and T \
             from world to camera",
        ),
        Some(inner) if holds_intrinsics(inner) => wrong(
            inner,
            "a camera in a map, beside one at the top",
            "one camera, or a name in each camera's keys",
        ),
        _ => Ok(()),
    }
}

/// Whether an entry holds lens coefficients under some name: `k1`, `kc`, `distortion_parameters`. Distances are none.
fn holds_lens(entry: &Entry) -> bool {
    const SINGLE: [&str; 5] = ["k1", "k2", "k3", "p1", "p2"];
    const LISTS: [&str; 9] =
        ["kc", "radial", "tangential", "prism", "thinprism", "tilt", "tau", "k456", "kappa"];
    let speaks_of_lens = |name: &str| {
        let name = name.to_ascii_lowercase().replace(['_', '-'], "");
        LISTS.contains(&name.as_str())
            || (name.contains("dist") && !name.contains("distance") && !name.contains("undist"))
    };
    let around = entry.key.rsplit_once('/').map_or("", |(around, _)| around);
    let is_list = entry.numbers.as_ref().is_some_and(|numbers| numbers.len() > 1);
    let name = entry.name().to_ascii_lowercase().replace(['_', '-'], "");
    let kappa = name.strip_prefix("kappa").is_some_and(|number| number.parse::<u32>().is_ok());
    let is_single = (SINGLE.contains(&name.as_str()) || kappa) && !is_list;
    let is_named = is_single
        || (is_list && (speaks_of_lens(entry.name()) || entry.name().to_ascii_lowercase().contains("lens")))
        || around.split('/').any(speaks_of_lens);
    is_named && entry.has_value()
}

/// Whether an entry holds the size of an image, in whatever form.
fn holds_size(entry: &Entry) -> bool {
    const WHOLE: [&str; 9] = [
        "imagesize",
        "imgsize",
        "imageshape",
        "imgshape",
        "imageresolution",
        "resolution",
        "framesize",
        "videosize",
        "imagedimensions",
    ];
    const SIDES: [&str; 6] = ["width", "height", "imagewidth", "imageheight", "w", "h"];
    let plain = |text: &str| text.to_ascii_lowercase().replace(['_', '-'], "");
    let name = plain(entry.name());
    let around = entry.key.rsplit('/').nth(1).map(plain).unwrap_or_default();
    let is_whole = |name: &str| WHOLE.contains(&name) || ["size", "image", "frame"].contains(&name);
    let has_value = entry.numbers.is_some() || !entry.text.is_empty();
    let is_size = |text: &str| {
        text.split(['x', 'X', '*', '×']).filter_map(|side| side.trim().parse::<u32>().ok()).count() == 2
    };
    has_value
        && (WHOLE.contains(&name.as_str())
            || (name == "size" && !entry.is_nested() && is_size(&entry.text))
            || (SIDES.contains(&name.as_str()) && is_whole(&around)))
}

/// Whether an entry holds the camera matrix of a camera, and not of its pictures after they were rectified or scaled.
fn holds_intrinsics(entry: &Entry) -> bool {
    const DERIVED: [&str; 9] = ["new", "opt", "rect", "undist", "scale", "ideal", "init", "guess", "inv"];
    let key = entry.key.to_ascii_lowercase();
    if DERIVED.iter().any(|word| key.contains(word)) {
        return false;
    }
    matches!(entry.numbers.as_deref(), Some(&[fx, _, _, b, fy, _, c, d, one])
        if fx > 1.5 && fy > 1.5 && (b, c, d, one) == (0.0, 0.0, 0.0, 1.0))
}
