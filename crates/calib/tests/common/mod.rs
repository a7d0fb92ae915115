//! Finds the recordings that tests read and must not be copied into the project.

use std::path::{Path, PathBuf};

use hull::{Rig, Silhouette};

/// The folder of a dataset, or `None`, with the reason printed, where there are no datasets. A variable
/// that is set and leads nowhere fails the test.
pub fn dataset(name: &str) -> Option<PathBuf> {
    let (root, named) = match std::env::var_os("HULLTOUCH_DATASETS") {
        Some(root) => (PathBuf::from(root), true),
        None => (Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/datasets"), false),
    };
    let folder = root.join(name);
    if folder.is_dir() {
        return Some(folder);
    }
    assert!(!named, "HULLTOUCH_DATASETS leads to {}, which is no folder", folder.display());
    testkit::skip(format_args!("{} is no folder and HULLTOUCH_DATASETS is not set", folder.display()));
    None
}

/// Reads a rig file.
pub fn rig(path: &Path) -> Rig {
    let text = std::fs::read_to_string(path).expect("a rig file");
    Rig::from_toml(&text).expect("a valid rig")
}

/// All frames of a dataset's reference silhouettes, in rig order.
#[allow(dead_code, reason = "only some test files read silhouettes")]
pub fn silhouettes(folder: &Path, rig: &Rig) -> Vec<Vec<Silhouette>> {
    let folder = folder.join("silhouettes");
    let first = folder.join(rig.cameras()[0].name());
    let mut frames: Vec<_> = std::fs::read_dir(first)
        .expect("a folder")
        .map(|entry| entry.expect("an entry").file_name())
        .collect();
    frames.sort();
    let read = |camera: &hull::Camera, frame| {
        let path = folder.join(camera.name()).join(frame);
        let picture = image::open(&path).expect("a picture").into_luma8();
        let mask: Vec<u8> = picture.pixels().map(|pixel| u8::from(pixel.0[0] > 127)).collect();
        Silhouette::from_mask(picture.width(), picture.height(), &mask).expect("a size")
    };
    frames.iter().map(|frame| rig.cameras().iter().map(|camera| read(camera, frame)).collect()).collect()
}
