//! The thin layer that reads files and folders and says which format they are.

use std::fs;
use std::path::Path;

use super::{
    Format, ImportError, ImportOptions, Imported, TextFile, from_aniposelib, from_matrices, from_opencv,
    from_qualisys, from_svoboda,
};

/// Calibrations are small; anything larger is something else.
const MAX_BYTES: u64 = 16 << 20;

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

fn read_error(path: &Path) -> impl FnOnce(std::io::Error) -> ImportError {
    move |error| ImportError::Read { file: shown(path), error }
}

/// One text file under its whole path.
fn one(path: &Path) -> Result<TextFile, ImportError> {
    let size = fs::metadata(path).map_err(read_error(path))?.len();
    if size > MAX_BYTES {
        let found = format!("{size} bytes");
        return Err(ImportError::key(&shown(path), "size", found, "a calibration file under 16 MiB"));
    }
    let bytes = fs::read(path).map_err(read_error(path))?;
    let text = String::from_utf8(bytes)
        .map_err(|_| ImportError::Unknown { file: shown(path), expected: "a text file in UTF-8" })?;
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
    let mut files = Vec::new();
    for (name, is_folder) in entries(path)? {
        let inner = path.join(&name);
        if !is_folder {
            files.extend(text_file(&inner, name)?);
            continue;
        }
        for (leaf, is_folder) in entries(&inner)? {
            if !is_folder {
                files.extend(text_file(&inner.join(&leaf), format!("{name}/{leaf}"))?);
            }
        }
    }
    files.retain(wanted);
    Ok(files)
}

/// Names of a folder's entries in order, and whether they are folders.
fn entries(folder: &Path) -> Result<Vec<(String, bool)>, ImportError> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(read_error(folder))? {
        let path = entry.map_err(read_error(folder))?.path();
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        found.push((name, path.is_dir()));
    }
    found.sort();
    Ok(found)
}

/// A file of a folder if its name is that of a calibration text; pictures and films may stand beside.
fn text_file(path: &Path, name: String) -> Result<Option<TextFile>, ImportError> {
    const ENDINGS: [&str; 8] = [".xml", ".yml", ".yaml", ".txt", ".cal", ".rad", ".dat", ".P"];
    if !ENDINGS.iter().any(|ending| name.ends_with(ending)) {
        return Ok(None);
    }
    one(path).map(|file| Some(TextFile { path: name, ..file }))
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
}
