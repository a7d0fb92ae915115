//! Free space where film is written.

use std::path::{Path, PathBuf};

use rustix::fs::{Access, StatVfs};
use setup::CameraEntry;

use super::super::facts::DiskFacts;
use super::local::background;

/// The folder of recordings, and those of the films of empty rooms.
pub fn look(cameras: &[&CameraEntry], recordings: &Path) -> Vec<DiskFacts> {
    let is_writable = rustix::fs::access(recordings, Access::WRITE_OK | Access::EXEC_OK);
    let of_recordings = match is_writable {
        Ok(()) => free(recordings),
        Err(error) => Err(std::io::Error::from(error).to_string()),
    };
    let mut disks =
        vec![DiskFacts { folder: recordings.to_owned(), what: "recordings", free: of_recordings }];
    let mut folders: Vec<PathBuf> = cameras.iter().filter_map(|camera| folder(background(camera)?)).collect();
    folders.sort_unstable();
    folders.dedup();
    disks.extend(folders.into_iter().map(|folder| {
        let free = free(&folder);
        DiskFacts { folder, what: "films of the empty room", free }
    }));
    disks
}

/// The nearest folder above it that is there.
fn folder(path: &Path) -> Option<PathBuf> {
    path.ancestors().skip(1).find(|folder| folder.is_dir()).map(Path::to_owned)
}

fn free(folder: &Path) -> Result<u64, String> {
    let StatVfs { f_bavail, f_frsize, .. } =
        rustix::fs::statvfs(folder).map_err(|error| std::io::Error::from(error).to_string())?;
    Ok(f_bavail.saturating_mul(f_frsize))
}
