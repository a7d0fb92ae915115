//! Silhouettes from image files.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use camera_node::source::numbered_images;
use hull::{Camera, Rig, Silhouette};
use segment::mask::UniformFilm;

use setup::cli::{Failure, Outcome};

/// The file of every camera's silhouette, in rig order: `folder/NAME.png` (or .jpg, .jpeg), or of a frame
/// `folder/NAME/NUMBER.png`, zeros before the number allowed. Silhouettes of cameras that the rig does
/// not have are refused: the rig is another one then.
pub fn paths_of_frame(folder: &Path, rig: &Rig, frame: Option<u64>) -> Outcome<Vec<PathBuf>> {
    refuse_unknown_cameras(folder, rig, frame.is_some())?;
    let images = images(folder)?;
    let path = |camera: &Camera| {
        let Some(frame) = frame else {
            return image_of(folder, &images, camera);
        };
        let of_camera = folder.join(camera.name());
        let path = of_camera.join(format!("{frame}.png"));
        numbered(&of_camera)?.remove(&frame).ok_or_else(|| missing(&path, camera))
    };
    rig.cameras().iter().map(path).collect()
}

/// The numbered files `folder/NAME/NUMBER.png` of every camera, in rig order; where there is no such
/// folder, `folder/NAME.png` (or .jpg, .jpeg) as frame 0.
pub fn paths_of_film(folder: &Path, rig: &Rig) -> Outcome<Vec<BTreeMap<u64, PathBuf>>> {
    let has_folders = rig.cameras().iter().any(|camera| folder.join(camera.name()).is_dir());
    if has_folders {
        refuse_unknown_cameras(folder, rig, true)?;
        let images = images(folder)?;
        let mut beside = rig.cameras().iter().flat_map(|camera| images_named(&images, camera));
        if let Some(both) = beside.next() {
            let problem = "found an image beside folders of numbered ones, expected either for all cameras";
            return Err(Failure::unreadable(both, problem));
        }
        return rig.cameras().iter().map(|camera| numbered(&folder.join(camera.name()))).collect();
    }
    let paths = paths_of_frame(folder, rig, None)?;
    Ok(paths.into_iter().map(|path| BTreeMap::from([(0, path)])).collect())
}

/// The films that masks are of: of numbered ones all in the folder, which tell what foreground is.
pub fn films_around(paths: &[PathBuf], is_numbered: bool) -> Outcome<Vec<Vec<PathBuf>>> {
    let film = |path: &PathBuf| match path.parent().filter(|_| is_numbered) {
        Some(folder) => Ok(numbered(folder)?.into_values().collect()),
        None => Ok(vec![path.clone()]),
    };
    paths.iter().map(film).collect()
}

/// The endings of images, in lower case.
const ENDINGS: [&str; 3] = ["png", "jpg", "jpeg"];

fn is_image(path: &Path) -> bool {
    let ending = path.extension().map(OsStr::to_ascii_lowercase);
    path.is_file() && ENDINGS.iter().any(|known| ending.as_deref() == Some(OsStr::new(known)))
}

/// The images of a folder whose name without its ending is that of the camera.
fn images_named<'a>(images: &'a [PathBuf], camera: &'a Camera) -> impl Iterator<Item = &'a PathBuf> {
    images.iter().filter(|path| path.file_stem() == Some(OsStr::new(camera.name())))
}

/// The one image `folder/NAME.png`, or .jpg or .jpeg, of a camera.
fn image_of(folder: &Path, images: &[PathBuf], camera: &Camera) -> Outcome<PathBuf> {
    let mut images = images_named(images, camera);
    let Some(path) = images.next() else {
        return Err(missing(&folder.join(format!("{}.png (or .jpg)", camera.name())), camera));
    };
    if let Some(other) = images.next() {
        let problem = format_args!("found {} beside it, expected one of the two", other.display());
        return Err(Failure::unreadable(path, problem));
    }
    if folder.join(camera.name()).is_dir() {
        let problem = format_args!("found a folder {:?} beside it, expected one of the two", camera.name());
        return Err(Failure::unreadable(path, problem));
    }
    Ok(path.clone())
}

/// Warns of a camera whose silhouettes are all entirely foreground or background, or all inverted.
pub fn warn_if_uniform<'a>(
    folder: &Path,
    camera: &Camera,
    silhouettes: impl IntoIterator<Item = &'a Silhouette>,
) {
    let mut film = UniformFilm::default();
    silhouettes.into_iter().for_each(|silhouette| film.note(silhouette));
    let Some(pattern) = film.pattern() else { return };
    let found = if film.masks() == 1 { "its silhouette is" } else { "all of its silhouettes are" };
    tracing::warn!("camera {:?}: {}: {found} {pattern}", camera.name(), folder.display());
}

fn missing(path: &Path, camera: &Camera) -> Failure {
    Failure::unreadable(
        path,
        format_args!("found no such file, expected the silhouette of camera {:?} of the rig", camera.name()),
    )
}

/// Refuses images (or folders) in `folder` whose names are not those of cameras.
fn refuse_unknown_cameras(folder: &Path, rig: &Rig, folders: bool) -> Outcome {
    let is_file_name =
        |camera: &&Camera| ![".", ".."].contains(&camera.name()) && !camera.name().contains(['/', '\\']);
    if let Some(camera) = rig.cameras().iter().find(|camera| !is_file_name(camera)) {
        let problem =
            format_args!("found camera {:?} in the rig, expected names that a file can have", camera.name());
        return Err(Failure::unreadable(folder, problem));
    }
    for path in entries(folder)? {
        let is_ending =
            |known: &&str| path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case(known));
        let is_image = ["png", "jpg", "jpeg"].iter().any(is_ending);
        let counts = if folders { path.is_dir() } else { is_image && path.is_file() };
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

/// The images of a folder by number, as a node's source has them.
fn numbered(folder: &Path) -> Outcome<BTreeMap<u64, PathBuf>> {
    let images = numbered_images(folder).map_err(Failure::input)?;
    if images.is_empty() {
        let problem = "found no numbered image, expected 000012.png and the like";
        return Err(Failure::unreadable(folder, problem));
    }
    Ok(images.into_iter().collect())
}

/// The images of a folder, by name.
fn images(folder: &Path) -> Outcome<Vec<PathBuf>> {
    Ok(entries(folder)?.into_iter().filter(|path| is_image(path)).collect())
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
