//! The thin layer that reads files and folders and says which format they are.

use std::fs;
use std::path::Path;

use super::{
    Format, ImportError, ImportOptions, Imported, TextFile, from_aniposelib, from_matrices, from_opencv,
    from_qualisys, from_svoboda,
};
use crate::file::{ReadError, read_text};

/// Calibrations are small; anything larger is something else.
const MAX_BYTES: u64 = 16 << 20;
/// The calibration files of a folder together.
const MAX_FOLDER_BYTES: u64 = 64 << 20;
/// How names of calibration files in a folder end; pictures and films may stand beside them.
const ENDINGS: [&str; 8] = [".xml", ".yml", ".yaml", ".txt", ".cal", ".rad", ".dat", ".P"];

/// Imports a calibration file or folder, in the format that [`detect`] finds unless one is named.
pub fn import(path: &Path, format: Option<Format>, options: &ImportOptions) -> Result<Imported, ImportError> {
    let format = match format {
        Some(format) => format,
        None => detect(path)?,
    };
    match format {
        Format::Aniposelib => from_aniposelib(&one(path)?, options),
        Format::Qualisys => from_qualisys(&one(path)?, options),
        Format::OpenCv => from_opencv(&several(path, is_storage)?, options),
        Format::Svoboda => from_svoboda(&several(path, |_| true)?, options),
        Format::Matrices => from_matrices(&several(path, |file| is_matrix(&file.text))?, options),
    }
}

/// The format of a file or folder by its names and content.
pub fn detect(path: &Path) -> Result<Format, ImportError> {
    if path.is_dir() {
        let files = several(path, |_| true)?;
        let has = |found: &dyn Fn(&TextFile) -> bool| files.iter().any(found);
        return if has(&|file| file.path.ends_with(".Pmat.cal")) {
            Ok(Format::Svoboda)
        } else if has(&is_storage) {
            Ok(Format::OpenCv)
        } else if has(&|file| is_matrix(&file.text)) {
            Ok(Format::Matrices)
        } else {
            let expected = "OpenCV FileStorage files, MultiCamSelfCal's camera1.Pmat.cal, or 3 x 4 matrices";
            Err(ImportError::Unknown { file: shown(path), expected })
        };
    }
    let file = one(path)?;
    if file.path.ends_with(".toml") {
        Ok(Format::Aniposelib)
    } else if is_storage(&file) {
        Ok(Format::OpenCv)
    } else if file.path.ends_with(".qca.txt") || file.text.contains("<calibration") {
        Ok(Format::Qualisys)
    } else if is_matrix(&file.text) {
        Ok(Format::Matrices)
    } else {
        let expected = "OpenCV FileStorage, Qualisys .qca.txt, a rig .toml, or a 3 x 4 matrix";
        Err(ImportError::Unknown { file: shown(path), expected })
    }
}

fn is_storage(file: &TextFile) -> bool {
    file.text.contains("<opencv_storage")
        || file.text.starts_with("%YAML")
        || file.text.contains("!!opencv-matrix")
}

fn is_matrix(text: &str) -> bool {
    let lines = text.lines().filter(|line| !line.trim_start().starts_with('#'));
    let words =
        lines.flat_map(|line| line.split([' ', '\t', ',', ';'])).filter(|word| !word.trim().is_empty());
    words.take(13).map(|word| word.trim().parse::<f64>().is_ok()).try_fold(0, |n, ok| ok.then_some(n + 1))
        == Some(12)
}

fn shown(path: &Path) -> String {
    path.display().to_string()
}

fn unreadable<E: Into<ReadError>>(path: &Path) -> impl FnOnce(E) -> ImportError {
    move |error| ImportError::Read { file: shown(path), error: error.into() }
}

/// One text file under its whole path.
fn one(path: &Path) -> Result<TextFile, ImportError> {
    let text = read_text(path, MAX_BYTES).map_err(unreadable(path))?;
    Ok(TextFile { path: shown(path).replace('\\', "/"), text })
}

/// The wanted text files of a folder and of the folders in it, by name, under their paths within it; or
/// the one file, under its own name.
fn several(path: &Path, wanted: impl Fn(&TextFile) -> bool) -> Result<Vec<TextFile>, ImportError> {
    if !path.is_dir() {
        let mut file = one(path)?;
        file.path = path.file_name().map_or(file.path, |name| name.to_string_lossy().into_owned());
        return Ok(vec![file]);
    }
    let mut names = Vec::new();
    for (name, is_folder) in entries(path)? {
        if is_folder {
            let inner = entries(&path.join(&name))?;
            names.extend(inner.into_iter().filter(|leaf| !leaf.1).map(|leaf| format!("{name}/{}", leaf.0)));
        } else {
            names.push(name);
        }
    }
    let mut files = Vec::new();
    let mut left_bytes = MAX_FOLDER_BYTES;
    for name in names.into_iter().filter(|name| ENDINGS.iter().any(|ending| name.ends_with(ending))) {
        let inner = path.join(&name);
        let text = read_text(&inner, MAX_BYTES.min(left_bytes)).map_err(unreadable(&inner))?;
        left_bytes -= text.len() as u64;
        files.push(TextFile { path: name, text });
    }
    files.retain(wanted);
    Ok(files)
}

/// Names of a folder's entries in order, and whether they are folders.
fn entries(folder: &Path) -> Result<Vec<(String, bool)>, ImportError> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable(folder))? {
        let path = entry.map_err(unreadable(folder))?.path();
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        found.push((name, path.is_dir()));
    }
    found.sort();
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twelve_numbers_are_a_matrix_and_nothing_else_is() {
        assert!(is_matrix("# P\n1 2 3 4\n5,6,7,8\r\n9 1e+002 0 -1\n"));
        assert!(!is_matrix("1 2 3 4 5 6 7 8 9 10 11"));
        assert!(!is_matrix("1 2 3 4 5 6 7 8 9 10 11 12 13"));
        assert!(!is_matrix("a b c d e f g h i j k l"));
    }

    /// A camera 4 m from the origin, as a plain matrix.
    const P: &str = "500 0 320 1280\n0 500 240 960\n0 0 1 4\n";

    fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a folder");
        for (name, text) in files {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().expect("a parent")).expect("made");
            fs::write(path, text).expect("written");
        }
        folder
    }

    const SIZE: ImportOptions =
        ImportOptions { up: None, scale: None, size: Some((640, 480)), pixel_origin: None };

    fn names(path: &Path, format: Option<Format>) -> Vec<String> {
        let imported = import(path, format, &SIZE).expect("a rig");
        imported.rig.cameras().iter().map(|camera| camera.name().to_owned()).collect()
    }

    #[test]
    fn folders_are_known_by_their_files() {
        let tool =
            folder(&[("camera2.Pmat.cal", P), ("camera10.Pmat.cal", P), ("Res.dat", "640 480\n640 480\n")]);
        assert_eq!(detect(tool.path()).expect("known"), Format::Svoboda);
        assert_eq!(names(tool.path(), None), ["camera2", "camera10"]);
        let plain =
            folder(&[("b.txt", P), ("a.P", P), ("notes.txt", "taken on Monday"), ("a.png", "no text")]);
        assert_eq!(detect(plain.path()).expect("known"), Format::Matrices);
        assert_eq!(names(plain.path(), None), ["a", "b"]);
        // The same files read as plain matrices where the format is given.
        assert_eq!(names(tool.path(), Some(Format::Matrices)), ["camera2", "camera10"]);
    }

    #[test]
    fn what_cannot_be_read_or_known_is_named() {
        let other = folder(&[("notes.txt", "taken on Monday"), ("bytes.txt.gz", "x")]);
        let message = |path: &Path| import(path, None, &SIZE).expect_err("refused").to_string();
        let found = message(other.path());
        assert!(found.contains(": found no calibration, expected OpenCV FileStorage files, "), "{found}");
        let found = message(&other.path().join("notes.txt"));
        assert!(
            found.ends_with(
                "notes.txt: found no calibration, expected OpenCV FileStorage, Qualisys .qca.txt, \
            a rig .toml, or a 3 x 4 matrix"
            ),
            "{found}"
        );
        let found = message(&other.path().join("nothing.toml"));
        assert!(found.contains("nothing.toml: "), "{found}");
        assert!(import(other.path(), Some(Format::Qualisys), &SIZE).is_err());
    }

    #[test]
    fn formats_are_found_by_their_names() {
        for format in Format::ALL {
            assert_eq!(format.name().parse(), Ok(format));
        }
        assert_eq!(
            "svb".parse::<Format>().expect_err("none").to_string(),
            "found \"svb\", expected a format: opencv, qualisys, aniposelib, svoboda or matrices"
        );
    }
}
