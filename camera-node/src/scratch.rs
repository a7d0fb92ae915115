//! Temporary folders. A process that is killed leaves its folder; the next one that makes a folder beside it removes it.

use std::fs::{self, File, Permissions};
use std::io;
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::path::Path;
use std::time::Duration;

use tempfile::TempDir;

/// What names of our folders begin with.
const PREFIX: &str = "hulltouch-";
/// What follows the prefix.
const RANDOM_CHARS: usize = 6;
/// A file in each folder that its process holds locked.
const LOCK: &str = ".lock";
/// A younger folder may be one that its process has not locked yet.
const YOUNGEST: Duration = Duration::from_secs(60);
/// Folders that are removed at once, at most, and entries that are looked at.
const MAX_REMOVED: usize = 64;
const MAX_ENTRIES: usize = 10_000;

/// Bytes of a folder's name.
pub const NAME_BYTES: usize = PREFIX.len() + RANDOM_CHARS;

/// A folder of this user alone, which is removed when it is dropped.
#[derive(Debug)]
pub struct ScratchFolder {
    folder: TempDir,
    /// Locked as long as the process lives.
    _lock: File,
}

impl ScratchFolder {
    /// A folder in TMPDIR.
    pub fn new() -> io::Result<ScratchFolder> {
        ScratchFolder::new_in(&std::env::temp_dir())
    }

    /// A folder in another one. Folders there of processes that were killed are removed first.
    pub fn new_in(parent: &Path) -> io::Result<ScratchFolder> {
        // What cannot be listed or removed stays.
        let _ = remove_abandoned(parent, YOUNGEST);
        let folder = tempfile::Builder::new()
            .prefix(PREFIX)
            .rand_bytes(RANDOM_CHARS)
            .permissions(Permissions::from_mode(0o700))
            .tempdir_in(parent)?;
        let lock = File::create_new(folder.path().join(LOCK))?;
        lock.lock()?;
        Ok(ScratchFolder { folder, _lock: lock })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }
}

/// Removes this user's folders of this age or older that no process holds.
fn remove_abandoned(parent: &Path, youngest: Duration) -> io::Result<()> {
    let user = rustix::process::geteuid().as_raw();
    let mut removed = 0;
    for entry in fs::read_dir(parent)?.take(MAX_ENTRIES).flatten() {
        let is_ours = entry.file_name().to_str().is_some_and(|name| name.starts_with(PREFIX));
        // Of a link this is the link's own.
        let Ok(found) = entry.metadata() else { continue };
        let is_old = found.modified()?.elapsed().is_ok_and(|age| age >= youngest);
        if !is_ours || !found.is_dir() || found.uid() != user || !is_old {
            continue;
        }
        let Ok(lock) = File::open(entry.path().join(LOCK)) else { continue };
        if lock.try_lock().is_ok() && removed < MAX_REMOVED {
            removed += usize::from(fs::remove_dir_all(entry.path()).is_ok());
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_goes_with_its_owner() {
        let parent = tempfile::tempdir().expect("a folder");
        let folder = ScratchFolder::new_in(parent.path()).expect("made");
        let path = folder.path().to_owned();
        assert_eq!(path.file_name().map(std::ffi::OsStr::len), Some(NAME_BYTES));
        assert_eq!(fs::metadata(&path).expect("there").mode() & 0o777, 0o700);
        drop(folder);
        assert!(!path.exists());
    }

    #[test]
    fn only_folders_of_processes_that_are_gone_are_removed() {
        let parent = tempfile::tempdir().expect("a folder");
        let at = |name: &str| parent.path().join(name);
        let lives = ScratchFolder::new_in(parent.path()).expect("made");
        // As a process leaves it that is killed.
        fs::create_dir(at("hulltouch-killed")).expect("made");
        fs::write(at("hulltouch-killed").join(LOCK), "").expect("written");
        fs::write(at("hulltouch-killed").join("0.sock"), "").expect("written");
        // Without a lock it is another program's, and so is one of another name.
        fs::create_dir_all(at("hulltouch-other")).expect("made");
        fs::create_dir_all(at("other")).expect("made");
        fs::write(at("other").join(LOCK), "").expect("written");
        std::os::unix::fs::symlink(at("other"), at("hulltouch-link")).expect("linked");
        remove_abandoned(parent.path(), YOUNGEST).expect("listed");
        assert!(at("hulltouch-killed").exists(), "it may be about to be locked");
        remove_abandoned(parent.path(), Duration::ZERO).expect("listed");
        assert!(!at("hulltouch-killed").exists());
        assert!(lives.path().join(LOCK).exists());
        for other in ["hulltouch-other", "other/.lock", "hulltouch-link"] {
            assert!(at(other).exists(), "{other}");
        }
    }
}
