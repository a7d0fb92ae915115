//! The thin layer that reads files and folders and says which format they are.

use std::path::Path;

use super::kind::{is_in_braces, is_kalibr, is_matrix, is_storage};
use super::scan::{MAX_BYTES, Scan, is_svoboda, plain_name, scan, unreadable};
use super::{
    Format, ImportError, ImportOptions, Imported, TextFile, from_aniposelib, from_matrices, from_opencv,
    from_qualisys, from_svoboda,
};
use crate::file::read_text;

/// Imports a calibration file or folder, in the format that [`detect`] finds unless one is named.
pub fn import(path: &Path, format: Option<Format>, options: &ImportOptions) -> Result<Imported, ImportError> {
    let found = Found::read(path)?;
    let format = match format {
        Some(format) => format,
        None => found.format(path)?,
    };
    let (files, mut warnings) = match found {
        Found::File(file) if matches!(format, Format::Aniposelib | Format::Qualisys) => {
            (vec![file], Vec::new())
        }
        Found::File(mut file) => {
            file.path = path.file_name().map_or(file.path, |name| name.to_string_lossy().into_owned());
            (vec![file], Vec::new())
        }
        Found::Folder(scan) => of_format(path, format, scan)?,
    };
    let imported = match (format, files.as_slice()) {
        (Format::Aniposelib, [file]) => from_aniposelib(file, options),
        (Format::Qualisys, [file]) => from_qualisys(file, options),
        (Format::OpenCv, files) => from_opencv(files, options),
        (Format::Svoboda, files) => from_svoboda(files, options),
        (_, files) => from_matrices(files, options),
    }?;
    warnings.extend(imported.warnings);
    Ok(Imported { rig: imported.rig, warnings })
}

/// The format of a file or folder by its names and content.
pub fn detect(path: &Path) -> Result<Format, ImportError> {
    Found::read(path)?.format(path)
}

/// What a path leads to.
enum Found {
    File(TextFile),
    Folder(Scan),
}

impl Found {
    fn read(path: &Path) -> Result<Found, ImportError> {
        if path.is_dir() {
            return scan(path).map(Found::Folder);
        }
        let text = read_text(path, MAX_BYTES).map_err(unreadable(path))?;
        Ok(Found::File(TextFile { path: path.display().to_string().replace('\\', "/"), text }))
    }

    fn format(&self, path: &Path) -> Result<Format, ImportError> {
        let unknown = |expected| ImportError::Unknown { file: path.display().to_string(), expected };
        match self {
            Found::Folder(scan) => {
                let has = |is: &dyn Fn(&TextFile) -> bool| scan.files.iter().any(is);
                if has(&|file| plain_name(&file.path).ends_with(".pmat.cal")) {
                    Ok(Format::Svoboda)
                } else if has(&is_storage) {
                    Ok(Format::OpenCv)
                } else if has(&|file| is_matrix(&file.text)) {
                    Ok(Format::Matrices)
                } else if let Some(name) = &scan.whole_rig {
                    let left_out = format!("{name} holds all cameras: give this file, not its folder");
                    Err(ImportError::LeftOut { file: path.display().to_string(), left_out })
                } else if let Some(left_out) = scan.warnings.first() {
                    Err(ImportError::LeftOut { file: path.display().to_string(), left_out: left_out.clone() })
                } else {
                    Err(unknown(FOLDER_EXPECTED))
                }
            }
            Found::File(file) if has_ending(file, ".toml") => Ok(Format::Aniposelib),
            Found::File(file) if is_storage(file) => Ok(Format::OpenCv),
            Found::File(file) if has_ending(file, ".qca.txt") || file.text.contains("<calibration") => {
                Ok(Format::Qualisys)
            }
            Found::File(file) if is_matrix(&file.text) => Ok(Format::Matrices),
            Found::File(file) if is_kalibr(&file.text) => Err(ImportError::Key {
                file: file.path.clone(),
                key: "cam0".to_owned(),
                found: "a camera chain of Kalibr".to_owned(),
                expected: "OpenCV FileStorage, one file per camera: write each camera's matrix, lens, R and T",
            }),
            Found::File(file) if is_in_braces(&file.text) => Err(ImportError::Key {
                file: file.path.clone(),
                key: "camera".to_owned(),
                found: "keys in braces (JSON, or YAML in flow style)".to_owned(),
                expected: "OpenCV FileStorage in YAML or XML, one key a line: K: [500, 0, 320, …]",
            }),
            Found::File(_) => Err(unknown(FILE_EXPECTED)),
        }
    }
}

const FOLDER_EXPECTED: &str =
    "OpenCV FileStorage files, MultiCamSelfCal's camera1.Pmat.cal, or 3 x 4 matrices";
const FILE_EXPECTED: &str = "OpenCV FileStorage, Qualisys .qca.txt, a rig .toml, or a 3 x 4 matrix";

fn has_ending(file: &TextFile, ending: &str) -> bool {
    file.path.to_ascii_lowercase().ends_with(ending)
}

/// The files of one format, and a warning for each that is of another.
fn of_format(path: &Path, format: Format, scan: Scan) -> Result<(Vec<TextFile>, Vec<String>), ImportError> {
    let expected = match format {
        Format::OpenCv => "OpenCV FileStorage files in the folder",
        Format::Svoboda => "MultiCamSelfCal's camera1.Pmat.cal and so on in the folder",
        Format::Matrices => "text files with 3 x 4 matrices in the folder",
        Format::Aniposelib => "a rig file, not a folder",
        Format::Qualisys => "a .qca.txt file, not a folder",
    };
    let wanted = |file: &TextFile| match format {
        Format::OpenCv => is_storage(file),
        Format::Svoboda => is_svoboda(&file.path),
        Format::Matrices => is_matrix(&file.text),
        Format::Aniposelib | Format::Qualisys => false,
    };
    let mut warnings = scan.warnings;
    if let Some(name) = &scan.whole_rig {
        warnings.push(format!(
            "{name}: left out, it holds all cameras: give this file, not its folder, to read it"
        ));
    }
    let (files, others): (Vec<TextFile>, Vec<TextFile>) = scan.files.into_iter().partition(wanted);
    if files.is_empty() {
        return Err(ImportError::Unknown { file: path.display().to_string(), expected });
    }
    for other in others {
        // The tool's folder holds further matrices beside its result.
        if format != Format::Svoboda && !is_svoboda(&other.path) {
            let kind = if is_storage(&other) { "an OpenCV FileStorage" } else { "a 3 x 4 matrix" };
            warnings.push(format!("{}: left out, it is {kind}, read is {}", other.path, format.name()));
        }
    }
    Ok((files, warnings))
}

#[cfg(test)]
mod tests;
