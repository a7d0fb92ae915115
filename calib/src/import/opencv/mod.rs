//! OpenCV FileStorage, XML or YAML: one camera per file or per folder of files. Key names vary from
//! program to program; extrinsics are world to camera.

use std::collections::BTreeMap;

use hull::Camera;
use nalgebra::{Matrix3, Vector3};

use super::entry::Entry;
use super::natural_order::natural_key;
use super::projection::{Placement, placed};
use super::{
    ImportError, ImportOptions, Imported, TextFile, axes, from_origin, numbers, size_of, stem, xml, yaml,
};

/// The known names of each thing, in lower case without `_`.
const MATRIX: &[&str] = &["cameramatrix", "k", "m", "m1", "k1", "mtx", "intrinsicmatrix", "intrinsics"];
const LENS: &[&str] = &[
    "distortioncoefficients",
    "distortioncoeffs",
    "distcoeffs",
    "distcoefs",
    "d",
    "d1",
    "dist",
    "distortion",
];
const ROTATION: &[&str] =
    &["rvec", "rotationvalues", "rotationvector", "r", "rotation", "rotationmatrix", "rot", "rvecs"];
const TRANSLATION: &[&str] = &["tvec", "translationvalues", "translationvector", "t", "translation", "tvecs"];
const WIDTH: &[&str] = &["imagewidth", "width"];
const HEIGHT: &[&str] = &["imageheight", "height"];
const SIZE: &[&str] = &["imagesize", "size", "resolution"];

/// Reads FileStorage files. Files of one folder (`cam1/config.xml`) describe one camera, named like the
/// folder; files without a folder are a camera each, named like the file. Files without a camera matrix
/// are left out; so are cameras without a pose, with a warning, unless no camera is complete.
pub fn from_opencv(files: &[TextFile], options: &ImportOptions) -> Result<Imported, ImportError> {
    let mut groups: BTreeMap<&str, Vec<(&TextFile, Vec<Entry>)>> = BTreeMap::new();
    for file in files {
        let name = match file.path.rsplit_once('/') {
            Some((folder, _)) => folder.rsplit('/').next().unwrap_or(folder),
            None => stem(&file.path),
        };
        groups.entry(name).or_default().push((file, entries(file)?));
    }
    let mut warnings = Vec::new();
    let mut cameras = Vec::new();
    let mut incomplete = None;
    for (name, files) in in_natural_order(groups) {
        let Some((path, entries)) = chosen(&files) else { continue };
        match camera(name, path, &entries, options, &mut warnings) {
            Ok(camera) => cameras.push(camera),
            Err(error) if find(&entries, TRANSLATION).is_none() && find(&entries, ROTATION).is_none() => {
                warnings.push(format!("{path}: left out, it has no pose"));
                incomplete.get_or_insert(error);
            }
            Err(error) => return Err(error),
        }
    }
    let place = files.first().map_or("", |file| file.path.as_str());
    match incomplete {
        Some(error) if cameras.is_empty() => Err(error),
        None if cameras.is_empty() => {
            Err(ImportError::key(place, MATRIX_NAMES, "nothing", "a 3 x 3 camera matrix in some file"))
        }
        _ => axes::finished(place, cameras, 1.0, options, warnings),
    }
}

const MATRIX_NAMES: &str = "camera_matrix (CameraMatrix, cameraMatrix, K, M1)";

/// Names with numbers in them count as people count: cam2 before cam10.
fn in_natural_order<T>(groups: BTreeMap<&str, T>) -> Vec<(&str, T)> {
    let mut groups: Vec<(&str, T)> = groups.into_iter().collect();
    groups.sort_by_key(|(name, _)| natural_key(name));
    groups
}

/// The one file that says all, else all files together; `None` without a camera matrix.
fn chosen<'a>(files: &[(&'a TextFile, Vec<Entry>)]) -> Option<(&'a str, Vec<Entry>)> {
    let has = |entries: &[Entry], names| find(entries, names).is_some();
    let full =
        |entries: &[Entry]| has(entries, MATRIX) && has(entries, ROTATION) && has(entries, TRANSLATION);
    if let Some((file, entries)) = files.iter().find(|(_, entries)| full(entries)) {
        return Some((file.path.as_str(), entries.clone()));
    }
    let (file, _) = files.iter().find(|(_, entries)| has(entries, MATRIX))?;
    Some((file.path.as_str(), files.iter().flat_map(|(_, entries)| entries.iter().cloned()).collect()))
}

fn entries(file: &TextFile) -> Result<Vec<Entry>, ImportError> {
    if !file.text.trim_start().starts_with('<') {
        return yaml::parse(file);
    }
    let root = xml::parse(file)?;
    if root.name != "opencv_storage" {
        return Err(ImportError::syntax(file, 1, &format!("<{}>", root.name), "<opencv_storage>"));
    }
    root.children
        .iter()
        .map(|child| {
            let whole = |name| child.child(name).and_then(|child| child.text.trim().parse::<usize>().ok());
            let shape = whole("rows").zip(whole("cols"));
            let found = match child.child("data") {
                Some(data) => Some(numbers(&data.text).map_err(|word| {
                    ImportError::key(&file.path, &child.name, format!("{word:?} in its data"), "numbers")
                })?),
                None => numbers(&child.text).ok().filter(|numbers| !numbers.is_empty()),
            };
            Ok(Entry { key: child.name.clone(), shape, numbers: found })
        })
        .collect()
}

/// The entry under the first of the names that the file has.
fn find<'a>(entries: &'a [Entry], names: &[&str]) -> Option<&'a Entry> {
    let plain = |key: &str| key.to_ascii_lowercase().replace(['_', '-'], "");
    names.iter().find_map(|name| entries.iter().find(|entry| plain(&entry.key) == *name))
}

/// The numbers under one of the names, of one of the given counts.
fn numbers_of<'a>(
    path: &str,
    entries: &'a [Entry],
    names: &[&str],
    shown: &str,
    counts: &[usize],
    expected: &'static str,
) -> Result<(&'a str, &'a [f64]), ImportError> {
    let entry = find(entries, names).ok_or_else(|| ImportError::key(path, shown, "nothing", expected))?;
    let found = entry.numbers.as_deref().unwrap_or(&[]);
    let shaped = entry.shape.is_none_or(|(rows, cols)| rows.saturating_mul(cols) == found.len());
    if !shaped || !counts.contains(&found.len()) {
        let shape = entry.shape.map_or(String::new(), |(rows, cols)| format!(" for {rows} x {cols}"));
        return Err(ImportError::key(path, &entry.key, format!("{} numbers{shape}", found.len()), expected));
    }
    Ok((&entry.key, found))
}

fn camera(
    name: &str,
    path: &str,
    entries: &[Entry],
    options: &ImportOptions,
    warnings: &mut Vec<String>,
) -> Result<Camera, ImportError> {
    let (_, k) = numbers_of(path, entries, MATRIX, MATRIX_NAMES, &[9], "3 x 3 numbers")?;
    let k = from_origin(Matrix3::from_row_slice(k), options.pixel_origin.unwrap_or(0.0));
    let (_, t) = numbers_of(path, entries, TRANSLATION, "tvec (TranslationValues, T)", &[3], "3 numbers")?;
    let (key, r) =
        numbers_of(path, entries, ROTATION, "rvec (RotationValues, R)", &[3, 9], "3 numbers or 3 x 3")?;
    let distortion = distortion(path, entries, warnings)?;
    let size = size_of(path, said_size(path, entries)?, options, warnings)?;
    let translation = Vector3::from_row_slice(t);
    if r.len() == 3 {
        return Camera::new(name, size, k, distortion, Vector3::from_row_slice(r), translation)
            .map_err(|error| ImportError::camera(path, error));
    }
    let rotation = Matrix3::from_row_slice(r);
    let placement = Placement { file: path, key, name, size };
    placed(&placement, k, distortion, &rotation, translation, warnings)
}

fn distortion(path: &str, entries: &[Entry], warnings: &mut Vec<String>) -> Result<[f64; 5], ImportError> {
    let expected = "4 or 5 numbers k1 k2 p1 p2 k3 (more only if they are zero)";
    if find(entries, LENS).is_none() {
        warnings.push(format!("{path}: has no lens coefficients, taken as zero"));
        return Ok([0.0; 5]);
    }
    let (key, given) = numbers_of(path, entries, LENS, "distCoeffs", &[1, 2, 4, 5, 8, 12, 14], expected)?;
    if let Some(more) = given.iter().skip(5).find(|&&more| more != 0.0) {
        return Err(ImportError::key(path, key, format!("{} numbers with {more}", given.len()), expected));
    }
    let mut distortion = [0.0; 5];
    for (to, from) in distortion.iter_mut().zip(given) {
        *to = *from;
    }
    Ok(distortion)
}

fn said_size(path: &str, entries: &[Entry]) -> Result<Option<(u32, u32)>, ImportError> {
    let expected = "a width and a height in whole pixels";
    let whole = |entry: &Entry, numbers: &[f64]| {
        if numbers.iter().all(|n| n.fract() == 0.0 && (0.0..1e6).contains(n)) {
            Ok(numbers.iter().map(|&n| n as u32).collect::<Vec<u32>>())
        } else {
            Err(ImportError::key(path, &entry.key, format!("{numbers:?}"), expected))
        }
    };
    if let Some(entry) = find(entries, SIZE)
        && let Some(pair @ [_, _]) = entry.numbers.as_deref()
    {
        let pair = whole(entry, pair)?;
        return Ok(Some((pair[0], pair[1])));
    }
    let side = |names| match find(entries, names) {
        Some(entry @ Entry { numbers: Some(numbers), .. }) if numbers.len() == 1 => {
            whole(entry, numbers).map(|side| Some(side[0]))
        }
        Some(entry) => Err(ImportError::key(path, &entry.key, format!("{:?}", entry.numbers), expected)),
        None => Ok(None),
    };
    Ok(side(WIDTH)?.zip(side(HEIGHT)?))
}

#[cfg(test)]
mod tests;
