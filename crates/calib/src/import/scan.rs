//! Which files of a folder are calibrations. Neighbours that are none are passed over; what looks like a
//! calibration and is not read is named, so that no camera is lost without a word.

use std::collections::BTreeSet;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

use hull::text::{MAX_QUOTED_CHARS, shortened};

use super::kind::{
    is_dressed_matrix, is_in_braces, is_matrix, is_rig, is_storage, looks_like_calibration, nearly_matrix,
    odd_word,
};
use super::natural_order::natural_key;
use super::{ImportError, TextFile};
use crate::file::{ReadError, read_text, read_unpacked};

/// Calibrations are small; anything larger is something else.
pub(super) const MAX_BYTES: u64 = 16 << 20;
/// The calibration files of a folder together.
const MAX_FOLDER_BYTES: usize = 64 << 20;
/// Folders in folders: cameras of rooms of sessions are three.
const MAX_DEPTH: usize = 4;
/// Files with the ending of a calibration: more are no folder of one.
const MAX_FILES: usize = 10_000;
/// What of a file with another ending is looked at.
const HEAD_BYTES: u64 = 4096;
/// How names of FileStorage files end, in lower case.
const STORAGE_ENDINGS: [&str; 3] = [".xml", ".yml", ".yaml"];
/// How names of other calibration files in a folder end, in lower case.
const TEXT_ENDINGS: [&str; 5] = [".txt", ".cal", ".rad", ".dat", ".p"];
/// Pictures and films, which are not looked into.
const MEDIA_ENDINGS: [&str; 16] = [
    ".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".gif", ".webp", ".pgm", ".ppm", ".raw", ".mp4",
    ".avi", ".mov", ".mkv", ".mcap",
];

/// Files of other programs that are no text, and may hold calibrations.
const BINARY_ENDINGS: [&str; 7] = [".npz", ".npy", ".pkl", ".pickle", ".h5", ".hdf5", ".mat"];

/// What a folder holds.
#[derive(Debug, Default)]
pub(super) struct Scan {
    /// The calibration files of all formats, by name in the order people count, under their paths within the folder.
    pub(super) files: Vec<TextFile>,
    /// What was passed over and may be a camera, one line each.
    pub(super) warnings: Vec<String>,
    /// The first file of all cameras (a rig .toml or .qca.txt): such a file is read where it is named itself.
    pub(super) whole_rig: Option<String>,
    /// The first file of [`BINARY_ENDINGS`], and how many there are.
    binary: Option<(String, usize)>,
    /// The first file with the name of a FileStorage that has nothing of a calibration, and how many there are.
    unknown: Option<(String, usize)>,
    bytes: usize,
    listed: usize,
    /// Folders that were visited, and files of one folder that links lead to.
    visited: BTreeSet<PathBuf>,
}

/// Reads the calibration files of a folder and of the folders in it.
pub(super) fn scan(folder: &Path) -> Result<Scan, ImportError> {
    let mut scan = Scan::default();
    scan.visit(folder, "", 0)?;
    scan.warnings.extend(with_more(&scan.unknown, "no OpenCV FileStorage"));
    scan.warnings.extend(with_more(&scan.binary, "no text: write calibrations as text"));
    scan.files.sort_by_cached_key(|file| natural_key(&file.path));
    Ok(scan)
}

impl Scan {
    fn visit(&mut self, folder: &Path, prefix: &str, depth: usize) -> Result<(), ImportError> {
        let canonical = fs::canonicalize(folder).map_err(unreadable(folder))?;
        if !self.visited.insert(canonical) {
            self.warnings.push(format!("{prefix}: a link to a folder that is read already, left out"));
            return Ok(());
        }
        let mut targets = BTreeSet::new();
        for (name, is_folder) in entries(folder)? {
            let (path, shown) = (folder.join(&name), format!("{prefix}{name}"));
            if name.contains(char::REPLACEMENT_CHARACTER) && fs::symlink_metadata(&path).is_err() {
                self.warnings.push(format!("{shown}: left out, its name is not UTF-8"));
                continue;
            }
            if is_folder {
                if name.starts_with('.') {
                    continue;
                }
                if depth == MAX_DEPTH {
                    self.warnings.push(format!("{shown}: folders more than {MAX_DEPTH} deep are not read"));
                } else if let Err(error) = self.visit(&path, &format!("{shown}/"), depth + 1) {
                    match error {
                        ImportError::Read { error: ReadError::Io(error), .. }
                            if fs::read_dir(&path).is_err() =>
                        {
                            self.warnings.push(format!("{shown}: folder not read: {error}"));
                        }
                        error => return Err(error),
                    }
                }
                continue;
            }
            if !self.is_candidate(&path, &name, &shown) {
                continue;
            }
            if let Ok(target) = fs::canonicalize(&path)
                && !targets.insert(target)
            {
                self.warnings.push(format!("{shown}: a link to another file of the folder, left out"));
                continue;
            }
            self.listed += 1;
            if self.listed > MAX_FILES {
                let found = format!("more than {MAX_FILES} files with the ending of a calibration");
                return Err(ImportError::key(
                    &folder.display().to_string(),
                    "files",
                    found,
                    "a folder of calibrations",
                ));
            }
            self.add(&path, shown)?;
        }
        Ok(())
    }

    /// Whether a file's name is that of a calibration. One with another name that begins as a FileStorage does
    /// is named in a warning.
    fn is_candidate(&mut self, path: &Path, name: &str, shown: &str) -> bool {
        let lower = name.to_ascii_lowercase();
        let plain = lower.strip_suffix(".gz").unwrap_or(&lower);
        let ends = |endings: &[&str]| endings.iter().any(|ending| plain.ends_with(ending));
        if !name.starts_with('.') && (ends(&STORAGE_ENDINGS) || ends(&TEXT_ENDINGS)) {
            return true;
        }
        if self.whole_rig.is_none()
            && !name.starts_with('.')
            && plain.ends_with(".toml")
            && is_rig(&head(path))
        {
            self.whole_rig = Some(shown.to_owned());
        }
        if ends(&MEDIA_ENDINGS) {
            return false;
        }
        let head = head(path);
        if is_matrix(&head) {
            self.warnings.push(format!(
                "{shown}: left out for its name, it is a 3 x 4 matrix: expected .txt, .dat or .P at its end"
            ));
        } else if let Some(count) = nearly_matrix(&head).filter(|_| plain.ends_with(".csv")) {
            self.warnings.push(format!("{shown}: left out for its name, it holds {count} numbers"));
        } else if ends(&BINARY_ENDINGS)
            && !name.starts_with('.')
            && head.contains(['\0', char::REPLACEMENT_CHARACTER])
        {
            self.binary.get_or_insert_with(|| (shown.to_owned(), 0)).1 += 1;
        } else if looks_like_calibration(&head) {
            self.warnings.push(format!(
                "{shown}: looks like a calibration, left out for its name: expected .xml, .yml, .yaml or .txt at its end"
            ));
        }
        false
    }

    fn add(&mut self, path: &Path, shown: String) -> Result<(), ImportError> {
        let lower = shown.to_ascii_lowercase();
        let plain = lower.strip_suffix(".gz").unwrap_or(&lower);
        let is_storage_name = STORAGE_ENDINGS.iter().any(|ending| plain.ends_with(ending));
        let text = match read_text(path, MAX_BYTES) {
            Ok(text) => text,
            Err(error @ ReadError::Encoding(_)) if other_encoding(path) => {
                return Err(ImportError::Read { file: shown, error });
            }
            Err(error @ ReadError::Packed(_)) if is_storage_name => {
                return Err(ImportError::Read { file: shown, error });
            }
            Err(ReadError::TooLarge(_) | ReadError::Encoding(_)) if !is_storage_name => return Ok(()),
            Err(error) => {
                self.warnings.push(format!("{shown}: left out: {error}"));
                return Ok(());
            }
        };
        let file = TextFile { path: shown, text };
        if self.whole_rig.is_none() && file.text.contains("<calibration") {
            self.whole_rig = Some(file.path.clone());
        }
        if is_storage(&file) || is_matrix(&file.text) || is_svoboda(&file.path) {
            self.bytes += file.text.len();
            if self.bytes > MAX_FOLDER_BYTES {
                return Err(ImportError::Read {
                    file: file.path,
                    error: ReadError::TooLarge(MAX_FOLDER_BYTES as u64),
                });
            }
            self.files.push(file);
        } else if file.text.contains('\0') && (is_storage_name || file.text.trim_matches(is_blank).is_empty())
        {
            self.warnings.push(format!("{}: left out, it holds zero bytes, expected text", file.path));
        } else if is_storage_name && (file.text.trim().is_empty() || looks_like_calibration(&file.text)) {
            let found = match file.text.trim() {
                "" => "is empty",
                text if is_in_braces(text) => "has its keys in braces, expected one key a line",
                _ => "is no OpenCV FileStorage",
            };
            self.warnings.push(format!("{}: left out, it {found}", file.path));
        } else if let Some(count) = nearly_matrix(&file.text) {
            self.warnings.push(format!(
                "{}: left out, it holds {count} numbers, expected 12 for a 3 x 4 matrix",
                file.path
            ));
        } else if let Some(word) = odd_word(&file.text) {
            self.warnings.push(format!(
                "{}: left out, it holds {:?}, expected 12 numbers for a 3 x 4 matrix",
                file.path,
                shortened(word, MAX_QUOTED_CHARS)
            ));
        } else if is_dressed_matrix(&file.text) {
            self.warnings.push(format!(
                "{}: left out, it holds more than plain numbers (words, brackets, exponents with D), expected 12 numbers for a 3 x 4 matrix",
                file.path
            ));
        } else if is_storage_name && self.whole_rig.as_ref() != Some(&file.path) {
            self.unknown.get_or_insert((file.path, 0)).1 += 1;
        }
        Ok(())
    }
}

/// A line for the first of several files, if there is one.
fn with_more(first: &Option<(String, usize)>, why: &str) -> Option<String> {
    let (first, count) = first.as_ref()?;
    let more = if *count > 1 { format!(" and {} more", count - 1) } else { String::new() };
    Some(format!("{first}{more}: left out, {why}"))
}

fn is_blank(c: char) -> bool {
    c == '\0' || c.is_whitespace()
}

/// A file of MultiCamSelfCal that is read.
pub(super) fn is_svoboda(path: &str) -> bool {
    let name = plain_name(path);
    name.ends_with(".pmat.cal") || name.ends_with(".rad") || name == "camera_order.txt" || name == "res.dat"
}

/// A file's name in lower case, without its folders and the ending of a packed file.
pub(super) fn plain_name(path: &str) -> String {
    let name = path.rsplit('/').next().unwrap_or(path).to_ascii_lowercase();
    name.strip_suffix(".gz").map(str::to_owned).unwrap_or(name)
}

/// The first bytes of a regular file, as far as they are text.
fn head(path: &Path) -> String {
    let mut bytes = Vec::new();
    if fs::metadata(path).is_ok_and(|metadata| metadata.is_file())
        && let Ok(file) = fs::File::open(path)
        && file.take(HEAD_BYTES).read_to_end(&mut bytes).is_err()
    {
        bytes.clear();
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Whether a file of another encoding than UTF-8 holds a calibration: then it is a camera that must not be lost.
fn other_encoding(path: &Path) -> bool {
    let Ok(bytes) = read_unpacked(path, MAX_BYTES) else { return false };
    // Latin letters of UTF-16 are those of ASCII between zeros.
    let letters: Vec<u8> = bytes.into_iter().filter(|&byte| byte != 0 && byte < 0x80).collect();
    let text = String::from_utf8_lossy(&letters).into_owned();
    looks_like_calibration(&text) || is_matrix(&text)
}

pub(super) fn unreadable<E: Into<ReadError>>(path: &Path) -> impl FnOnce(E) -> ImportError {
    move |error| ImportError::Read { file: path.display().to_string(), error: error.into() }
}

/// Names of a folder's entries, links last and otherwise in order, and whether they are folders.
fn entries(folder: &Path) -> Result<Vec<(String, bool)>, ImportError> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable(folder))? {
        let entry = entry.map_err(unreadable(folder))?;
        let is_link = entry.file_type().is_ok_and(|kind| kind.is_symlink());
        let name = entry.file_name().to_string_lossy().into_owned();
        found.push((is_link, name, entry.path().is_dir()));
    }
    found.sort();
    Ok(found.into_iter().map(|(_, name, is_folder)| (name, is_folder)).collect())
}
