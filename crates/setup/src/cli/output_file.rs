//! Files that a command writes.

use std::path::{Path, PathBuf};

use super::failure::{Failure, Outcome};

/// Writes a file whole or not at all: beside it first, then in its place. What is no regular file (a
/// device, a pipe) is written to as it is.
pub fn write_whole(path: &Path, contents: &[u8]) -> Outcome {
    if is_special(path) {
        return std::fs::write(path, contents).map_err(|error| Failure::unwritable(path, error));
    }
    let beside = beside(path);
    let written = std::fs::write(&beside, contents).and_then(|()| std::fs::rename(&beside, path));
    written.map_err(|error| {
        // What is left of a failed attempt is of no use.
        let _ = std::fs::remove_file(&beside);
        Failure::unwritable(path, error)
    })
}

/// Asks before a long run, not after it, whether a file can be written.
pub fn check_writable(flag: &str, path: &Path) -> Outcome {
    if is_special(path) {
        return Ok(());
    }
    let beside = beside(path);
    let tried = std::fs::write(&beside, b"").and_then(|()| std::fs::remove_file(&beside));
    tried.map_err(|error| Failure::input(format_args!("{flag} {}: {error}", path.display())))
}

fn is_special(path: &Path) -> bool {
    path.metadata().is_ok_and(|metadata| !metadata.is_file())
}

fn beside(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".partial");
    path.with_file_name(name)
}
