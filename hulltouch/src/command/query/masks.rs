//! Silhouettes from image files.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use camera_node::source::read_silhouette;
use hull::{Camera, Rig, Silhouette};

use cli::{Failure, Outcome};

/// The file of every camera's silhouette, in rig order: `folder/NAME.png`, or of a frame
/// `folder/NAME/NUMBER.png`, zeros before the number allowed. Silhouettes of cameras that the rig does
/// not have are refused: the rig is another one then.
pub fn paths_of_frame(folder: &Path, rig: &Rig, frame: Option<u64>) -> Outcome<Vec<PathBuf>> {
    refuse_unknown_cameras(folder, rig, frame.is_some())?;
    let path = |camera: &Camera| {
        let Some(frame) = frame else {
            let path = folder.join(format!("{}.png", camera.name()));
            return if path.is_file() { Ok(path) } else { Err(missing(&path, camera)) };
        };
        let of_camera = folder.join(camera.name());
        let path = of_camera.join(format!("{frame}.png"));
        numbered(&of_camera)?.remove(&frame).ok_or_else(|| missing(&path, camera))
    };
    rig.cameras().iter().map(path).collect()
}

/// The numbered files `folder/NAME/NUMBER.png` of every camera, in rig order; where there is no such
/// folder, `folder/NAME.png` as frame 0.
pub fn paths_of_film(folder: &Path, rig: &Rig) -> Outcome<Vec<BTreeMap<u64, PathBuf>>> {
    let has_folders = rig.cameras().iter().any(|camera| folder.join(camera.name()).is_dir());
    if has_folders {
        refuse_unknown_cameras(folder, rig, true)?;
        return rig.cameras().iter().map(|camera| numbered(&folder.join(camera.name()))).collect();
    }
    let paths = paths_of_frame(folder, rig, None)?;
    Ok(paths.into_iter().map(|path| BTreeMap::from([(0, path)])).collect())
}

/// Reads one silhouette of the camera's size.
pub fn read(path: &Path, camera: &Camera) -> Outcome<Silhouette> {
    read_silhouette(path, camera).map_err(Failure::input)
}

/// Warns of a camera whose silhouettes are all entirely foreground, or all entirely background.
pub fn warn_if_uniform<'a>(
    folder: &Path,
    camera: &Camera,
    silhouettes: impl IntoIterator<Item = &'a Silhouette>,
) {
    let pixels = u64::from(camera.width()) * u64::from(camera.height());
    let (mut count, mut are_full, mut are_empty) = (0, true, true);
    for silhouette in silhouettes {
        count += 1;
        are_full &= silhouette.area() == pixels;
        are_empty &= silhouette.area() == 0;
    }
    let side = match (are_full, are_empty) {
        (true, false) => "foreground",
        (false, true) => "background",
        // Of no silhouette both are true.
        _ => return,
    };
    let found = if count == 1 { "its silhouette is" } else { "all of its silhouettes are" };
    tracing::warn!("camera {:?}: {}: {found} entirely {side}", camera.name(), folder.display());
}

fn missing(path: &Path, camera: &Camera) -> Failure {
    Failure::unreadable(
        path,
        format_args!("found no such file, expected the silhouette of camera {:?} of the rig", camera.name()),
    )
}

/// Refuses images (or folders) in `folder` whose names are not those of cameras.
fn refuse_unknown_cameras(folder: &Path, rig: &Rig, folders: bool) -> Outcome {
    for path in entries(folder)? {
        let is_png = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png"));
        let counts = if folders { path.is_dir() } else { is_png && path.is_file() };
        let name = if folders { path.file_name() } else { path.file_stem() };
        let name = name.map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        if counts && rig.index_of(&name).is_none() {
            let names: Vec<&str> = rig.cameras().iter().map(Camera::name).collect();
            let problem =
                format_args!("found camera {name:?}, expected one of the rig: {}", names.join(", "));
            return Err(Failure::unreadable(&path, problem));
        }
    }
    Ok(())
}

/// The PNG files of a folder whose names are numbers.
fn numbered(folder: &Path) -> Outcome<BTreeMap<u64, PathBuf>> {
    let mut found: BTreeMap<u64, PathBuf> = BTreeMap::new();
    for path in entries(folder)? {
        let is_png = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png"));
        let stem = path.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
        // A sign is no digit: `parse` alone would take "+1".
        if !is_png || stem.is_empty() || !stem.bytes().all(|byte| byte.is_ascii_digit()) {
            continue;
        }
        let number = stem.parse().map_err(|_| {
            Failure::unreadable(&path, "its name is a number over 2⁶⁴, expected the number of a frame")
        })?;
        if let Some(other) = found.insert(number, path.clone()) {
            let problem =
                format_args!("found frame {number} in {} too, expected one of the two", other.display());
            return Err(Failure::unreadable(&path, problem));
        }
    }
    if found.is_empty() {
        let problem = "found no PNG with a number for a name, expected 000012.png and the like";
        return Err(Failure::unreadable(folder, problem));
    }
    Ok(found)
}

/// A folder's entries by name.
fn entries(folder: &Path) -> Outcome<Vec<PathBuf>> {
    let refused = |error: std::io::Error| Failure::unreadable(folder, error);
    let listed = fs::read_dir(folder).map_err(refused)?;
    let mut paths = listed
        .map(|entry| entry.map(|entry| entry.path()))
        .collect::<Result<Vec<PathBuf>, _>>()
        .map_err(refused)?;
    paths.sort();
    Ok(paths)
}
